"""Both faces of the report: complete, self-contained, equal in their numbers, safe, and the same bytes every time."""

from __future__ import annotations

import dataclasses
import io
import itertools
import re
import subprocess
import sys
from typing import get_args, get_type_hints

import numpy as np
import pytest
from pypdf import PdfReader
from report_dossiers import load, make_analysis, runs_of, truth_score, two_uses
from report_texts import Page, all_blocks, html_text, of_sections, pdf_text, squeezed, strings

from seqrsm.analysis.compromise import CompromiseEstimate, GivenUp
from seqrsm.analysis.results import Confirmation
from seqrsm.analysis.scale import Interval
from seqrsm.analysis.surfaces import surface_of
from seqrsm.campaign.dossier import Dossier
from seqrsm.design.factors import CategoricalFactor, ContinuousFactor, DiscreteFactor
from seqrsm.design.region import Region
from seqrsm.plain import counted
from seqrsm.report import wording, write_report
from seqrsm.report.blocks import (
    Cell,
    Column,
    Definitions,
    Equation,
    FigureBlock,
    KeyFigures,
    Panel,
    Paragraph,
    Report,
    Section,
    Table,
    table,
)
from seqrsm.report.content import build_report
from seqrsm.report.figures.files import named_panels
from seqrsm.report.figures.fit import look_data, paint_mean_history, read_looks
from seqrsm.report.html import render_html
from seqrsm.report.pdf import render_pdf
from seqrsm.report.rounding import NOTHING
from seqrsm.report.sections.compromise import _front_table, _paint_front, compromise_section
from seqrsm.report.sections.data import question_section
from seqrsm.report.sections.history import history_section
from seqrsm.report.sections.model import importance_section
from seqrsm.report.wording import half_width_text, number_cell
from seqrsm.spec.tables import ConsiderationSpec, SimulatorSpec, StopSpec


@pytest.fixture(scope="module")
def report(simulated, built):
    return built(simulated)


@pytest.fixture(scope="module")
def page(report):
    return render_html(report)


@pytest.fixture(scope="module")
def paper(report):
    return render_pdf(report)


def test_html_nests_and_has_a_heading_order_and_alternatives(page):
    parsed = Page(page)
    levels = [int(tag[1]) for tag, _ in parsed.tags if re.fullmatch(r"h[1-6]", tag)]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(b - a <= 1 for a, b in itertools.pairwise(levels))
    drawings = [attrs for tag, attrs in parsed.tags if tag == "svg"]
    assert len(drawings) >= 12
    assert all(attrs["role"] == "img" and len(attrs["aria-label"]) > 20 for attrs in drawings)
    assert all(len(attrs["alt"]) > 20 for tag, attrs in parsed.tags if tag == "img")
    assert sum(tag == "math" for tag, _ in parsed.tags) == 3
    identifiers = [attrs["id"] for _, attrs in parsed.tags if "id" in attrs]
    assert len(identifiers) == len(set(identifiers))
    anchors = {attrs["href"][1:] for tag, attrs in parsed.tags if tag in ("a", "use")}
    assert anchors <= set(identifiers)
    assert set(re.findall(r"url\(#([^)]*)\)", page)) <= set(identifiers)


def test_html_asks_the_network_for_nothing(page):
    assert (
        re.findall(r"(?i)(?:https?|ftp|file|wss?):|//[a-z]|@import|url\((?!#)", re.sub(r"base64,[^\"]*", "", page))
        == []
    )
    for tag, attrs in Page(page).tags:
        assert tag not in {"link", "iframe", "object", "embed", "base", "form"}
        assert all(not (name == "src" and not value.startswith("data:image/png")) for name, value in attrs.items())
        assert not any(name.startswith("on") for name in attrs)
    assert "default-src 'none'" in page
    assert len(page.encode()) < 3_000_000


@pytest.mark.parametrize("guard", get_args(get_type_hints(StopSpec)["guard"]))
def test_every_guard_has_its_words(flight, guard):
    spec = dataclasses.replace(flight.spec, stop=flight.spec.stop.model_copy(update={"guard": guard}))
    section = question_section(dataclasses.replace(flight, spec=spec))
    words = [block.text for block in section.blocks if isinstance(block, Paragraph) and "in addition, " in block.text]
    assert len(words) == 1


def test_what_members_of_a_set_have_of_their_own_is_held_fixed_too(flight):
    """Else a board reads that C band looks at HH and HV, and dates and a member's own numbers have no unit."""
    fixed = {"polarization": "HH+HV", "first_day": 120.0, "interval_days": 30.0, "X.altitude_m": 900.0}
    members = {"C": {"polarization": "VV+VH", "integration_time": 10.0, "noise_temperature": 500.0}}
    simulator = SimulatorSpec(engine="psm", scene="s.npz", fixed=fixed, members=members)
    spec = dataclasses.replace(flight.spec, simulator=simulator)
    words = [getattr(block, "text", "") for block in question_section(dataclasses.replace(flight, spec=spec)).blocks]
    (told,) = [text.replace("\u00a0", " ") for text in words if text.startswith("Sensor parameters held fixed")]
    assert told == (
        "Sensor parameters held fixed: polarization HH+HV; first day 120 d; revisit interval 30 d; X.altitude 900 m; "
        "C.polarization VV+VH; C.integration time 10 ms; C.noise temperature 500 K."
    )


def test_purposes_of_runs_are_explained(flight):
    purposes = ("start", "optimum", "regret", "spread", "repeat")
    runs = tuple(
        dataclasses.replace(run, purpose=purpose) for run, purpose in zip(flight.runs[:5], purposes, strict=True)
    )
    words = [getattr(block, "text", "") for block in question_section(dataclasses.replace(flight, runs=runs)).blocks]
    assert any(
        "Purposes: start (1), optimum: mean at the optimum (1), regret: place of the optimum (1), "
        "spread: far from other runs (1) and repeat: pure error (1)." in text.replace("\u00a0", " ")
        for text in words
    )


def test_the_formula_of_a_consideration_is_told(flight):
    price = ConsiderationSpec(name="price", expr="100 / looks", unit="kEUR", weight=2.0)
    section = question_section(
        dataclasses.replace(flight, spec=dataclasses.replace(flight.spec, considerations=(price,)))
    )
    (objectives,) = (block for block in section.blocks if "Objectives" in str(getattr(block, "caption", "")))
    assert [str(getattr(cell, "text", cell)) for cell in objectives.rows[-1]] == [
        "price [kEUR]",
        "100 / looks",
        "minimize",
        "2",
    ]


def test_both_faces_show_every_text(report, page, paper):
    in_html, in_pdf = html_text(page), pdf_text(paper)
    for text in strings(report):
        assert squeezed(text) in in_html, text
        assert squeezed(text) in in_pdf, text


def test_numbers_are_those_of_the_analysis(simulated, page):
    """The figures of the summary are computed here once more, from the fit alone."""
    analysis = simulated.analyses[0]
    fit, best = analysis.fit, analysis.optimum
    row = analysis.model.matrix(best.point[None, :])[0]
    h = row @ np.linalg.solve(fit.Z.T @ fit.Z, row)
    s = np.sqrt(np.sum((fit.y - fit.Z @ np.linalg.lstsq(fit.Z, fit.y, rcond=None)[0]) ** 2) / (len(fit.y) - len(row)))
    assert len(fit.y) - len(row) == 30
    half = 2.042272 * s * np.sqrt(1 + h)  # t(30, 0.975), any table
    mean = row @ np.linalg.lstsq(fit.Z, fit.y, rcond=None)[0]
    text = "".join(Page(page).text).replace("\u00a0", " ")
    less, of_mean = best.optimism, 2.042272 * s * np.sqrt(h)
    assert f"{mean - half - less:.1f} to {mean + half:.1f} percent" in text
    assert f"{mean - less:.1f} percent" in text
    assert f"95 % confidence interval {mean - of_mean - less:.1f} to {mean + of_mean:.1f} percent" in text
    assert abs(mean - truth_score(best.point[None, :])[0]) < 4 * s * np.sqrt(h)


NO_UNIT = {
    "df", "F", "p", "t", "Run", "Runs", "Batch", "Leverage", "Studentised", "Cook's distance", "Value", "run",
    "leverage", "studentised residual", "scored runs", "Setting", "Optimal setting, 95\u00a0% credible interval",
    "Range or levels", "frequency", "resolution", "depression angle", "looks",
}  # fmt: skip
"""Heads of counts, ratios and test statistics, of directions in coded units, and of columns whose rows have units."""


def test_no_column_of_numbers_is_without_a_unit(report):
    numbers = re.compile(r"[-\u2212\u00b1<> \d.,to]*\d[-\u2212\u00b1<> \d.,to]*")
    for block in all_blocks(report.sections):
        if isinstance(block, Table):
            bare = {
                column.title
                for k, column in enumerate(block.columns)
                if "[" not in column.heading and any(numbers.fullmatch(row[k].text) for row in block.rows)
            }
            assert "Coefficients [percent]" in block.caption or bare <= NO_UNIT, block.caption
    for *_, panel in named_panels(report):
        data = panel.data and panel.data()
        for k, name in enumerate(data.columns if data and len(data.columns) < 20 else ()):
            number = any(isinstance(row[k], float) and np.isfinite(row[k]) for row in data.rows)
            assert "[" in name or not number or name in NO_UNIT, (panel.name, name)


def test_pdf_is_tagged_and_titled_and_carries_no_date(paper):
    reader = PdfReader(io.BytesIO(paper))
    root = reader.trailer["/Root"]
    assert root["/MarkInfo"]["/Marked"]
    assert root["/Lang"] == "en"
    assert reader.metadata.title == "Campaign crop radar"
    assert reader.metadata.creation_date is None
    assert "pdfuaid" in root["/Metadata"].get_data().decode()
    assert next(item.title for item in reader.outline if not isinstance(item, list)) == "Campaign crop radar"
    width, height = reader.pages[0].mediabox[2:]
    assert (round(float(width)), round(float(height))) == (595, 842)


def test_the_summary_is_the_first_page(paper, report):
    pages = [page.extract_text() for page in PdfReader(io.BytesIO(paper)).pages]
    assert "Summary" in pages[0]
    assert "Optimum and intervals" not in pages[0]
    assert "Optimum and intervals" in pages[1]
    for text in of_sections(report.sections[:1]):
        assert squeezed(text) in squeezed(pages[0]), text
    assert len(pages) <= 12


def test_figures_and_tables_are_numbered_in_their_order_and_referred_to(report, many, built):
    for made in (report, built(many)):
        for kind, word in ((FigureBlock, "Figure"), (Table, "Table")):
            captions = [block.caption for block in all_blocks(made.sections) if isinstance(block, kind)]
            assert [text.partition(".")[0] for text in captions] == [f"{word} {i + 1}" for i in range(len(captions))]
            told = []
            for block in all_blocks(made.sections):
                if isinstance(block, Paragraph):
                    for run in re.findall(rf"\b{word}s?\u00a0(\d[\d, and to]*)", block.method):
                        first, to, last = run.strip(" ,adnot").partition(" to ")
                        told += range(int(first), int(last) + 1) if to else map(int, re.findall(r"\d+", run))
            assert sorted(told) == list(range(1, len(captions) + 1))


def test_author_and_date_stand_under_the_title(flight):
    spec = dataclasses.replace(flight.spec, author="A. Engineer", date="2026-11-23")
    report = build_report(dataclasses.replace(flight, spec=spec))
    assert "A.Engineer,2026-11-23" in html_text(render_html(report))
    assert "A.Engineer,2026-11-23" in pdf_text(render_pdf(report))


def test_same_dossier_same_bytes(simulated, page, paper, tmp_path):
    again = write_report(simulated, tmp_path / "new" / "report.html", tmp_path / "new" / "report.pdf")
    assert again[0].read_bytes() == page.encode()
    assert again[1].read_bytes() == paper
    assert sorted(path.name for path in (tmp_path / "new").iterdir()) == ["report.html", "report.pdf"]


@pytest.mark.parametrize("name", ["flight", "many", "saturated"])
def test_other_campaigns_render_without_nan(name, request, built):
    report = built(request.getfixturevalue(name))
    in_html, in_pdf = html_text(render_html(report)), pdf_text(render_pdf(report))
    for text in strings(report):
        assert squeezed(text) in in_html, text
        assert squeezed(text) in in_pdf, text
        assert not re.search(r"\bnan\b|\binf\b|None", text), text


def test_saturated_fit_says_why_there_is_no_interval(saturated, built):
    text = " ".join(strings(built(saturated)))
    assert text.count("no error estimate: as many terms as runs (28 runs, 28 terms)") >= 5
    assert "none: N = p" in text
    assert "importance of the factors cannot be tested" in text


def test_measured_scores_have_no_pictures_and_keep_their_blocks(flight, built):
    report = built(flight)
    assert "images" not in {section.key for section in report.sections}
    text = list(strings(report))
    assert "block[day 1]" in text
    assert "day 3" in text
    assert any("lowest estimated mean score" in words for words in text)


def test_more_than_six_pairs_are_cut_and_said(many, built):
    figures = [b for b in all_blocks(built(many).sections) if isinstance(b, FigureBlock)]
    contours = [f for f in figures if "orange dots" in f.caption]
    assert [panel.title for f in contours for panel in f.panels].count("Intervals at the recommended settings") == 1
    assert sum(len(f.panels) for f in contours) == 7
    assert "6 of 15 pairs are drawn, those of the most important factors." in contours[-1].caption


def test_user_text_stays_text(tmp_path):
    bad = '<script>alert(1)</script>"\'&#panic(1) $x$ *b* #eval("1") \\u{41} {{ 7*7 }} [l](x)'
    quoted = bad.replace("\\", "\\\\").replace('"', '\\"')
    text = f"""
[campaign]
name = "hostile"
description = "{quoted}"
[[factor]]
name = "power"
unit = "{quoted}"
values = [1, 2, 3]
[[factor]]
name = "film"
levels = ["{quoted}", "b"]
[[application]]
name = "a"
utility = "measured"
[model]
order = 1
[stop]
half_width = 1.0
"""
    dossier = hostile(tmp_path, text, bad)
    report = build_report(dossier)
    page, paper = render_html(report), render_pdf(report)
    parsed = Page(page)
    scripts = [attrs.get("type", "") for tag, attrs in parsed.tags if tag == "script"]
    assert sorted(scripts) == ["", "application/json"]
    in_html, in_pdf = squeezed("".join(parsed.text)), pdf_text(paper)
    assert in_html.count(squeezed(bad)) > 10
    assert squeezed(bad) in in_pdf
    for words in strings(report):
        assert squeezed(words) in in_html
    assert all(bad not in block.math for block in all_blocks(report.sections) if isinstance(block, Equation))


def hostile(folder, text, bad):
    spec = load(folder, text)
    points = np.vstack([spec.region.candidates(3)] * 2)
    scores = points[:, 0] + points[:, 1] + 0.1 * np.random.default_rng(1).standard_normal(len(points))
    runs = [
        dataclasses.replace(run, purpose=bad, block=bad) for run in runs_of(spec, points, scores, None, source="flight")
    ]
    void = dataclasses.replace(runs[0], run_id=99, state="void", reason=bad, scores=())
    analysis = dataclasses.replace(make_analysis(spec, runs, unit=bad, draws=50), warnings=(bad,))
    return Dossier(spec, (analysis,), (*runs, void), (), (), (), None, 0, (bad,), {bad: bad}, (bad,))


def test_characters_that_no_font_has_still_give_a_pdf(flight):
    odd = dataclasses.replace(flight, assumptions=("\U0001f9ff \u2e80 \ue123 rare signs",))
    assert render_pdf(build_report(odd)).startswith(b"%PDF")


def test_two_applications_have_their_own_sections(flight):
    report = build_report(two_uses(flight))
    keys = re.findall(r'<section id="([^"]+)"', render_html(report))
    assert len(keys) == len(set(keys))
    assert {"a1", "a2", "a1-model", "a2-model", "a1-result", "a2-result"} <= set(keys)


@pytest.mark.parametrize(("width", "told"), [(11.46, "11.5"), (10.02, "10.0"), (0.134, "0.134"), (8.12, "8.1")])
def test_a_half_width_has_three_digits_where_the_first_is_one(flight, width, told):
    """As the key figures tell it: 11.5 above and 11 below would be read as two numbers."""
    assert half_width_text(flight.analyses[0], width) == told


def test_a_compromise_opens_the_summary(flight):
    first = flight.analyses[0]
    settings = dict(first.optimum.settings)
    found = CompromiseEstimate(
        settings=settings,
        point=first.optimum.point,
        desirability=0.75,
        given_up=(GivenUp("first use", 61.0, 63.0, 2.0, 1.0, 3.0, 0.8, "percent", True, settings, "text"),),
        credible={},
        expected_shortfall=0.01,
        level=0.95,
        front_settings=(),
        front_values=np.empty((0, 1)),
    )
    _, sentence, table, own = build_report(two_uses(flight, compromise=found)).sections[0].blocks
    assert [row[0].text for row in own.rows] == ["drainage", "other use"]
    assert "95\u00a0% confidence and prediction intervals" in own.caption
    # A line ends before an interval, or it stood over the name beside it, never within one.
    assert all(row[1].text.count(" ") == 1 and " (" in row[1].text and " " not in row[2].text for row in own.rows)
    assert sentence.text.startswith("Recommended compromise: ")
    assert [cell.text.replace("\u00a0", " ") for cell in table.rows[0]][:4] == [
        "first use", "61.0 percent", "63.0 percent", "2.0 percent"
    ]  # fmt: skip
    for shortfall, told in ((0.01, "0.010"), (5e-4, "less than 0.001"), (0.0, "less than 0.001")):
        one = dataclasses.replace(found, expected_shortfall=shortfall)
        assert compromise_section(first.region, one).blocks[0].text.endswith(f"best compromise is {told}.")
    missed = dataclasses.replace(found.given_up[0], desirability=0.0)
    found = dataclasses.replace(found, given_up=(missed,))
    sentence = build_report(two_uses(flight, compromise=found)).sections[0].blocks[1]
    assert "It is unacceptable for first use: no setting was found that is acceptable for all." in sentence.text


def test_a_front_has_dashes_where_a_setting_has_no_effect():
    """With L alone the cell of C, and with one date the interval, would be read as part of the design."""
    names = (ContinuousFactor("interval_days", 6.0, 40.0, "d"), ContinuousFactor("C.resolution", 15.0, 60.0, "m"))
    region = Region((CategoricalFactor("frequency", ("L", "L+C")), DiscreteFactor("dates", (1.0, 4.0)), *names))
    ends = {"interval_days": 20.0, "C.resolution": 30.0}
    settings = ({"frequency": "L", "dates": 1.0} | ends, {"frequency": "L+C", "dates": 4.0} | ends)
    score = GivenUp("crops", 60.0, 63.0, 3.0, 1.0, 5.0, 0.8, "percent", True, {}, "")
    found = CompromiseEstimate(np.zeros(4), {}, 0.8, 0.0, 0.95, {}, (score,), settings, np.array([[60.0], [63.0]]))
    rows = [[getattr(cell, "text", cell) for cell in row][2:4] for row in _front_table(region, found).rows]
    assert rows == [["\u2013", "\u2013"], ["20.00", "30.0"]]


@pytest.mark.parametrize(("apart", "width"), [(1e-9, (2.0, 2.46)), (50.0, (55.0, 55.0 * 120.0 / 63.0))])
def test_points_of_a_front_closer_than_their_errors_are_not_drawn_apart(apart, width):
    """Axes are as wide as the interval of what is given up, 1 to 3 percent, or as two hundredths of an exact cost."""
    from matplotlib.figure import Figure

    score = GivenUp("use", 63.0, 63.0, 2.0, 1.0, 3.0, 0.8, "percent", True, {}, "")
    cost = GivenUp("cost", 123.0, 123.0, 0.0, np.nan, np.nan, 0.8, "kEUR", False, {}, "")
    front = np.array([[63.0, 123.0], [63.0 + apart, 123.0 + apart * 120.0 / 63.0]])
    found = CompromiseEstimate(np.zeros(1), {}, 0.8, 0.0, 0.95, {}, (score, cost), ({}, {}), front)
    axes = Figure().subplots()
    _paint_front(found, 0, 1, axes)
    assert [np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim())] == pytest.approx(width)
    assert all(axes.get_xlim()[0] < x < axes.get_xlim()[1] for x in front[:, 0])


def test_fresh_runs_that_contradict_the_model_are_on_the_first_page(simulated):
    first = simulated.analyses[0]
    fresh = Confirmation((1, 2), (50.0, 52.0), 51.0, Interval(40.0, 62.0), False, "contradicts")
    held = dataclasses.replace(first, decision=dataclasses.replace(first.decision, held=True), confirmation=fresh)
    for analysis, word in ((held, "Doubt"), (dataclasses.replace(held, confirmation=None), "Stop")):
        blocks = build_report(dataclasses.replace(simulated, analyses=(analysis,))).sections[0].blocks
        figures = next(block for block in blocks if isinstance(block, KeyFigures))
        assert figures.items[-1].value == word
        assert figures.items[-1].detail.endswith("contradict the model") == (word == "Doubt")


def test_logit_scores_are_drawn_in_percent(simulated):
    from seqrsm.fit.least_squares import fit_least_squares
    from seqrsm.report.figures.surfaces import line

    analysis = simulated.analyses[0]
    logits = np.log(analysis.data.scores / (100.0 - analysis.data.scores))
    fit = fit_least_squares(analysis.fit.Z, logits, list(analysis.model.terms))
    scale = dataclasses.replace(analysis.scale, kind="logit")
    surface = surface_of(simulated.spec, analysis.data, scale, fit, None)
    fitted = dataclasses.replace(analysis.fitted, fit=fit, scale=scale, surface=surface)
    drawn = line(dataclasses.replace(analysis, fitted=fitted), 0)
    assert np.all((drawn.prediction.low > 0.0) & (drawn.prediction.high < 100.0))
    row = analysis.model.matrix(analysis.optimum.point[None, :])
    here = np.argmin(np.abs(drawn.x - analysis.optimum.settings["frequency"]))
    at_optimum = 100.0 / (1.0 + np.exp(-(row @ fit.estimate)[0]))
    assert drawn.mean[here] == pytest.approx(at_optimum, abs=0.3)


def test_slices_share_an_axis_and_show_no_impossible_score(simulated, monkeypatch):
    """A reader compares the panels; a run moved to another setting scores no more than 100 percent there either."""
    from seqrsm.report.figures import surfaces
    from seqrsm.report.sections import optimum as section

    analysis, seen = simulated.analyses[0], []

    def paint(analysis, line, scores, axes):
        section_paint(analysis, line, scores, axes)
        seen.append((line, axes.get_ylim()))
        if line.index < 2:  # continuous: marks of runs at a bound are whole, behind the two bands
            assert not axes.collections[2].get_clip_on()

    section_paint = section.paint_slice
    monkeypatch.setattr(section, "paint_slice", paint)
    far = dataclasses.replace(analysis.fit, y=analysis.fit.y + 90.0)
    analysis = dataclasses.replace(analysis, fitted=dataclasses.replace(analysis.fitted, fit=far))
    for panel in section._slices(analysis, range(4)).panels:
        assert panel.svg
    assert len(seen) == 4
    assert len({limits for _, limits in seen}) == 1
    assert max(line.run_score.max() for line, _ in seen) == 100.0
    low, high = seen[0][1]
    assert all(low < line.prediction.low[line.allowed].min() for line, _ in seen)
    assert high > 100.0
    assert surfaces.line(analysis, 0).run_score.max() == 100.0


def test_a_factor_that_changes_the_surface_more_than_the_first_is_named(simulated):
    analysis = simulated.analyses[0]
    text = "The fitted surface changes most with "

    def told(shares):
        rows = [
            dataclasses.replace(row, share=share, share_total=share)
            for row, share in zip(analysis.importance, shares, strict=True)
        ]
        blocks = importance_section(dataclasses.replace(analysis, importance=tuple(rows)), "k").blocks
        return [block.text for block in blocks if isinstance(block, Paragraph) and block.text.startswith(text)]

    first = max(range(4), key=lambda i: analysis.importance[i].f)
    assert told([0.7 if i == first else 0.1 for i in range(4)]) == []
    assert told([float("nan")] * 4) == []
    other = (first + 1) % 4
    (found,) = told([0.6 if i == other else 0.1 for i in range(4)])
    assert "(total effect 60" in found
    assert analysis.importance[other].factor.replace("_", " ") in found


def test_importing_the_package_draws_nothing_heavy():
    code = (
        "import sys, seqrsm.report; print([m for m in ('matplotlib', 'jinja2', 'typst', 'scipy') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_tables_refuse_ragged_rows():
    with pytest.raises(ValueError, match="needs 1 cells"):
        Table((Column("a"),), ((Cell("a"), Cell("b")),), "x")


def test_a_report_of_very_many_runs_shows_the_last_and_says_so(simulated, monkeypatch):
    total = len(simulated.runs)
    monkeypatch.setattr("seqrsm.report.sections.data.MOST_RUNS", total - 3)
    section = next(one for one in build_report(simulated).sections[-1].sections if one.key == "runs")
    note, details = section.blocks
    assert f"last {total - 3} of {total} runs" in note.text
    (table,) = details.blocks
    assert [row[0].text for row in table.rows] == [str(run.run_id) for run in simulated.runs[3:]]


def test_counted_nouns():
    assert [counted(n, "cover") for n in (0, 1, 2)] == ["0 covers", "1 cover", "2 covers"]
    assert [counted(n, "batch", "batches") for n in (1, 3)] == ["1 batch", "3 batches"]


@pytest.mark.parametrize(("words", "page"), [(60, 1), (1150, 2), (1450, 2), (2000, 3)])
def test_a_section_follows_a_short_rest_and_else_begins_a_page(words: int, page: int) -> None:
    """A summary of one page stands alone; a few lines of it on the next do not."""
    summary = Section("s", "Summary", (Paragraph("word " * words),))
    rest = Section("r", "Second section", (Paragraph("more"),), new_page=True)
    pages = PdfReader(io.BytesIO(render_pdf(Report("Title", "", "state", "1", (summary, rest))))).pages
    assert [i for i, one in enumerate(pages, start=1) if "Second section" in one.extract_text()] == [page]


def svg_panel(title: str) -> Panel:
    return Panel(title, title, lambda: '<svg width="160pt" height="150pt" viewBox="0 0 160 150"></svg>')


@pytest.mark.parametrize(
    "block",
    [
        table("Tall rows", ("Cover", "Rests on"), [[name, "word " * 90] for name in ("first", *"bcdefgh")]),
        FigureBlock(lambda: tuple(svg_panel(name) for name in ("first", *"bcdef")), "Two rows of panels", columns=3),
        Definitions(tuple((name, "word " * 90) for name in ("first", *"bcdefgh"))),
    ],
    ids=["table", "figure", "definitions"],
)
def test_what_is_too_tall_for_the_rest_of_a_page_begins_there_all_the_same(block) -> None:
    """Else it would leave half of the page empty."""
    section = Section("s", "Section", (Paragraph("word " * 700), block))
    first, second = PdfReader(io.BytesIO(render_pdf(Report("Title", "", "state", "1", (section,))))).pages
    assert "first" in first.extract_text()
    assert second.extract_text()


@pytest.mark.parametrize(("words", "most"), [(20, 8), (80, 5)])
def test_a_long_caption_takes_the_width_of_the_page(words: int, most: int) -> None:
    """That of a set of sensors was squeezed into the quarter that is left beside seven panels."""
    figure = FigureBlock(lambda: tuple(svg_panel(name) for name in "abcdefg"), "word " * words, columns=4)
    paper = render_pdf(Report("Title", "", "state", "1", (Section("s", "Section", (figure,)),)))
    lines = [line for line in PdfReader(io.BytesIO(paper)).pages[0].extract_text().splitlines() if "word" in line]
    assert max(2, most - 4) <= len(lines) <= most


def test_columns_are_sorted_by_their_numbers_not_by_what_is_shown() -> None:
    """Ten digits: enough to tell values apart, and the same on any machine."""
    values = [1234.56789, 1234.56788, -2.5e-7]
    rows = [[number_cell("1230", value)] for value in values]
    shown = table("Values", ("Value",), rows)
    page = render_html(Report("Title", "", "state", "1", (Section("s", "Summary", (shown,)),)))
    keys = [float(key) for key in re.findall(r'data-value="([^"]*)"', page)]
    assert keys == pytest.approx(values, rel=1e-9)
    assert len(set(keys)) == 3


def test_the_history_draws_the_intervals_that_were_told(simulated):
    """Those of logits, and those that selection bias widens, are not symmetric about the mean."""
    from matplotlib.figure import Figure

    analysis = simulated.analyses[0]
    looks = read_looks(simulated.looks, analysis.application)
    ends = [(look.mean - 6.0, look.mean + 1.0 + i) for i, look in enumerate(looks)]
    looks = tuple(dataclasses.replace(look, confidence=pair) for look, pair in zip(looks, ends, strict=True))
    axes = Figure().subplots()
    paint_mean_history(analysis, looks, axes)
    drawn = axes.collections[0].get_paths()[0].vertices
    for look in looks:
        band = drawn[drawn[:, 0] == look.n_runs, 1]
        assert (band.min(), band.max()) == pytest.approx(look.confidence)
    assert [row[3:5] for row in look_data(analysis, looks).rows] == ends


def test_no_alternative_text_names_a_setting_of_a_sensor_that_is_left_out(simulated, monkeypatch):
    monkeypatch.setattr(wording, "without_effect", lambda factors, settings: ("frequency",))
    texts = [panel.alt for *_, panel in named_panels(build_report(simulated))]
    found = [text for text in texts if "best at" in text or "the optimum is at" in text]
    assert any("best at a set without it." in text for text in found)
    assert not [text for text in found if NOTHING in text or "GHz" in text]


def test_the_history_tells_the_loss_of_each_look_that_has_one(simulated):
    analysis, (first, *later) = simulated.analyses[0], simulated.looks
    told = dataclasses.replace(first, summary={**first.summary, "expected_loss": 0.1234})
    bare = [
        dataclasses.replace(one, summary={k: v for k, v in one.summary.items() if k != "expected_loss"})
        for one in later
    ]
    section = history_section(simulated.spec, (told, *bare), analysis, "x")
    (looks,) = section.blocks[-1].blocks
    place = [column.heading for column in looks.columns].index("Expected loss [percent]")
    assert [row[place].text for row in looks.rows] == ["0.12", *("" for _ in bare)]
    place = [column.heading for column in looks.columns].index("Mean at optimum [percent]")
    means = [row[place].text for row in looks.rows]
    assert means[0] != means[-1]
    assert section.blocks[0].panels[-1].alt.endswith(f", last {means[-1]}\u00a0percent.")
