"""The profiler's numbers are those of the fit at every setting of its grid, and the browser shows them."""

from __future__ import annotations

import html
import itertools
import json
import re
import subprocess
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from report_dossiers import two_uses
from test_browser import BROWSER

from seqrsm.design.factors import CategoricalFactor, ContinuousFactor
from seqrsm.report.figures.surfaces import chosen_pairs, line, surface
from seqrsm.report.html import render_html
from seqrsm.report.profile import MOST_NODES, _levels, profile, profile_text
from seqrsm.report.rounding import format_number
from seqrsm.report.wording import optimum_setting_text


@pytest.mark.parametrize("name", ["simulated", "flight", "many", "saturated"])
def test_each_row_is_the_fit_at_its_settings(name, request):
    """The quadratic and its covariance, evaluated here once more at the settings as they are written."""
    analysis = request.getfixturevalue(name).analyses[0]
    found = profile(analysis)
    places = list(itertools.product(*(range(len(factor["values"])) for factor in found["factors"])))
    assert len(found["rows"]) == len(places) <= 2 * MOST_NODES
    start = places.index(tuple(factor["start"] for factor in found["factors"]))
    half = 0.51 * 10.0 ** -found["places"]
    best, first = analysis.optimum, found["rows"][start]
    assert first[0] == pytest.approx(best.mean, abs=half)
    if first[1] is not None:
        assert first[1:3] == pytest.approx([best.confidence.low, best.confidence.high], abs=half)
        assert first[3:5] == pytest.approx([best.prediction.low, best.prediction.high], abs=half)
    assert first[5] == 1
    some = np.random.default_rng(1).choice(len(places), 20)
    for i in some.tolist():
        point = np.array(
            [
                place if isinstance(factor, CategoricalFactor) else 2.0 * shown["x"][place] - 1.0
                for factor, shown, place in zip(analysis.region.factors, found["factors"], places[i], strict=True)
            ],
            dtype=float,
        )
        row = analysis.model.matrix(point[None, :])[0]
        if len(row) == len(analysis.fit.estimate):  # without blocks
            mean = float(analysis.scale.to_score(np.array([row @ analysis.fit.estimate]))[0])
            assert found["rows"][i][0] == pytest.approx(mean, abs=half + 0.002 * np.ptp(analysis.data.scores))


@pytest.mark.parametrize("place", [-1.0, -0.97, 0.8, 0.1, 1.0])
def test_many_factors_have_three_settings_each(place):
    """Eight factors of four settings are 65,536 rows, a minute's work; the ends and the recommended one stay."""
    factors = tuple(ContinuousFactor(f"x{j}", 0.0, 1.0) for j in range(8))
    best = np.full(8, place)
    analysis = SimpleNamespace(region=SimpleNamespace(factors=factors), optimum=SimpleNamespace(point=best))
    middle = 0.0 if abs(place) == 1.0 else place
    assert _levels(analysis) == [[-1.0, middle, 1.0]] * 8


def test_nothing_is_drawn_that_no_score_can_be(simulated):
    """Slices, contours and sliders end where scores do."""
    analysis = simulated.analyses[0]
    most = analysis.optimum.mean - 1.0
    percent = SimpleNamespace(goal=analysis.goal, score_limits=(0.0, most))
    cut = replace(analysis, fitted=replace(analysis.fitted, application=percent))
    assert max(row[0] for row in profile(analysis)["rows"]) > most + 0.5
    beyond = [row for row in profile(cut)["rows"] if max(row[:5]) > most + 0.05]
    assert len(beyond) == 1  # that of the recommended settings, which the analysis cuts
    for index in range(cut.region.k):
        drawn = line(cut, index)
        assert max(np.max(drawn.prediction.high), np.max(drawn.confidence.high), np.max(drawn.mean)) == most
    assert np.max(surface(cut, *chosen_pairs(cut)[0]).mean) == most


@pytest.mark.parametrize("off", [1.5, -1.5])
def test_the_correction_of_the_first_page_is_in_every_row(simulated, off):
    analysis = simulated.analyses[0]
    best = analysis.optimum
    changed = {name: getattr(best, name).also_less(off) for name in ("confidence", "prediction")}
    corrected = replace(analysis, optimum=replace(best, mean=best.mean - off, optimism=off, **changed))
    plain, found = profile(analysis), profile(corrected)
    assert [factor["start"] for factor in found["factors"]] == [factor["start"] for factor in plain["factors"]]
    before, after = np.array(plain["rows"]), np.array(found["rows"])
    less, more = max(off, 0.0), min(off, 0.0)
    expected = np.tile([off, less, more, less, more, 0.0], (len(before), 1))
    np.testing.assert_allclose(before - after, expected, atol=1.1 * 10.0 ** -found["places"])
    shape = [len(factor["values"]) for factor in found["factors"]]
    start = after[np.ravel_multi_index([factor["start"] for factor in found["factors"]], shape)]
    ends = (corrected.optimum.confidence.low, corrected.optimum.prediction.high)
    assert start[[0, 1, 4]] == pytest.approx([best.mean - off, *ends], abs=0.51 * 10.0 ** -found["places"])


def test_the_recommended_settings_are_those_of_the_first_page(simulated):
    analysis = simulated.analyses[0]
    for factor, shown in zip(analysis.region.factors, profile(analysis)["factors"], strict=True):
        assert shown["values"][shown["start"]] == optimum_setting_text(analysis, factor)


def test_beside_a_compromise_it_says_where_it_begins(flight, simulated, built):
    """Its button, "Recommended settings", led to those of one application, and page 1 recommends the compromise."""
    for dossier, alone in ((two_uses(flight), False), (simulated, True)):
        page = html.unescape(render_html(built(dossier)))
        names = re.findall(r"begin at the optimum of ([^<]*?) alone, not at the compromise", page)
        assert names == ([] if alone else [one.application for one in dossier.analyses])
        assert [f'data-start="Optimum of {name} alone"' in page for name in names] == [True] * len(names)
        assert ('data-start="Recommended settings"' in page) == alone


def test_text_cannot_end_its_element(simulated):
    assert "<" not in profile_text(simulated.analyses[0])
    assert json.loads(profile_text(simulated.analyses[0])) == profile(simulated.analyses[0])


@pytest.mark.skipif(BROWSER is None, reason="no Chromium is installed")
@pytest.mark.parametrize("power", [0, 8, -9])
def test_the_browser_shows_the_first_row(simulated, built, tmp_path, power):
    """In the digits of the report's text: with powers of ten where scores are huge or tiny."""
    analysis = simulated.analyses[0]
    found = profile(analysis)
    places = found["places"] - power
    rows = [[*(None if value is None else value * 10.0**power for value in row[:5]), row[5]] for row in found["rows"]]
    other = json.dumps({**found, "rows": rows, "places": places})
    page = render_html(built(simulated)).replace(profile_text(analysis), other)
    (tmp_path / "page.html").write_text(page, encoding="utf-8")
    command = [
        BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run",
        f"--user-data-dir={tmp_path / 'profile'}", "--dump-dom", (tmp_path / "page.html").as_uri(),
    ]  # fmt: skip
    shown = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True).stdout
    (said,) = re.findall(r'<p aria-live="polite" class="said">(.*?)</p>', shown)
    best = analysis.optimum
    mean, low = (
        format_number(round(value, found["places"]) * 10.0**power, places) for value in (best.mean, best.confidence.low)
    )
    assert html.unescape(said).startswith(f"Mean score {mean} (95\u00a0% confidence {low} to ")
    names = "".join(rf", {name} [^,]*" for name in ("depression angle", "looks", "polarization"))
    assert re.search(
        rf"percent at frequency [^,]*{names}\.$", html.unescape(said)
    )  # "at 9.1 GHz, 45 deg, 4, HH" told less
    assert shown.count("<circle") == len(simulated.spec.factors[3].levels)  # there is nothing between two levels
    assert shown.count("<polyline fill") == 3
    assert len(re.findall(r'<input id="profile-0-', shown)) == simulated.spec.region.k
    assert len(re.findall(r'<label for="profile-0-', shown)) == simulated.spec.region.k
