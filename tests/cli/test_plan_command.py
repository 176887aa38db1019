"""`seqrsm plan`: the page's numbers are those of designs and intervals, computed here once more."""

from __future__ import annotations

import json
import math
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from measured_campaign import FREQUENCY, HEAD, MEASURED, POL, STOP, X, make, quadratic
from scipy.stats import t as student
from typer.testing import CliRunner

from seqrsm.cli.app import app

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None)


def half_width_of(document: dict[str, Any], model: dict[str, Any], n: int, s: float) -> float:
    """Half-width of the watched interval after ``n`` runs; inf where they leave no degree of freedom."""
    df = n - model["p"]
    if df < 1:
        return math.inf
    t = document["t"][min(df, len(document["t"])) - 1]
    return float(t * s * math.sqrt(document["share"] + _between(model["designs"], n, 1)))


def loss_of(model: dict[str, Any], n: int, s: float, drop: float) -> float:
    """Expected loss at the estimated optimum of a quadratic that falls by ``drop`` from its best to the ends.

    With curvature 2 drop in each numeric factor and gradient variance s^2 g in all, it is s^2 g / (4 drop); nan for a
    model of first order, whose optimum is a corner.
    """
    if model["order"] == 1 or n <= model["p"] or not drop > 0.0:
        return math.nan
    return float(min(s * s * _between(model["designs"], n, 2) / (4.0 * drop), drop * max(model["numeric"], 1)))


def _between(designs: list[list[float]], n: int, column: int) -> float:
    """N times a variance, straight between the designs and level beyond them, over N."""
    places = [row[0] for row in designs]
    return float(np.interp(n, places, [row[0] * row[column] for row in designs])) / n


def planned(folder: Path) -> dict:
    done = CliRunner().invoke(app, ["plan", str(folder), "--json"])
    assert done.exit_code == 0, done.output
    return json.loads(done.stdout)


@pytest.fixture(scope="module")
def scored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make(tmp_path_factory.mktemp("plan") / "c", X + FREQUENCY, quadratic())


@pytest.fixture(scope="module")
def document(scored: Path) -> dict:
    return planned(scored)


def model_of(document: dict, order: int, *kept: int) -> dict:
    (found,) = [one for one in document["models"] if one["order"] == order and one["kept"] == list(kept)]
    return found


def test_half_width_is_students_of_the_fit(scored: Path, document: dict) -> None:
    fit = json.loads(CliRunner().invoke(app, ["fit", str(scored), "--json"]).stdout)
    assert document["s"] == pytest.approx(fit["s"])
    model = model_of(document, 2, 0, 1)
    assert model["p"] == 6
    n, h, _ = model["designs"][1]
    expected = student.ppf(0.975, n - 6) * fit["s"] * math.sqrt(1.0 + h)  # one future run
    assert half_width_of(document, model, n, document["s"]) == pytest.approx(expected, rel=1e-4)
    assert math.isinf(half_width_of(document, model, 6, 1.0))


def test_mean_variance_is_no_better_than_the_continuous_optimum_and_near_it(document: dict) -> None:
    """The I-optimal design for two factors, first order: all corners, N h = 1 + 2/3."""
    model = model_of(document, 1, 0, 1)
    for n, h, g in model["designs"][1:]:
        assert 5.0 / 3.0 - 1e-4 <= n * h < 1.15 * 5.0 / 3.0
        assert n * g == pytest.approx(2.0, rel=0.15)


def test_loss_of_a_parabola_is_that_of_simulated_fits(document: dict) -> None:
    model, drop, s, n = model_of(document, 2, 0), 10.0, 1.0, 12
    rng = np.random.default_rng(1)
    x = np.repeat([-1.0, 0.0, 1.0], 4)
    Z = np.column_stack([np.ones(12), x, x * x])
    y = -drop * x * x + s * rng.standard_normal((4000, 12))
    b = y @ np.linalg.pinv(Z).T
    lost = drop * (b[:, 1] / (-2.0 * b[:, 2])) ** 2
    assert loss_of(model, n, s, drop) == pytest.approx(float(lost.mean()), rel=0.3)
    assert math.isnan(loss_of(model_of(document, 1, 0), n, s, drop))


def test_fewer_factors_and_more_runs_give_narrower_intervals(document: dict) -> None:
    widths = [half_width_of(document, model_of(document, 2, 0, 1), n, 1.0) for n in (9, 12, 20, 40)]
    assert widths == sorted(widths, reverse=True)
    assert half_width_of(document, model_of(document, 2, 0), 9, 1.0) < widths[0]


def test_page_works_offline_and_shows_the_numbers(scored: Path, document: dict, tmp_path: Path) -> None:
    page = tmp_path / "plan.html"
    assert CliRunner().invoke(app, ["plan", str(scored), "--out", str(page)]).exit_code == 0
    text = page.read_text(encoding="utf-8")
    assert re.findall(r"(?:https?:|//[a-z]|@import|src=)", text) == []
    if BROWSER is None:
        pytest.skip("no Chromium is installed")
    command = [
        BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run",
        f"--user-data-dir={tmp_path / 'profile'}", "--dump-dom", page.as_uri(),
    ]  # fmt: skip
    shown = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True).stdout
    said, _ = re.findall(r'class="said"[^>]*>(.*?)</p>', shown)
    n, model = document["max_runs"], model_of(document, 2, 0, 1)
    s = float(f"{document['s']:.3g}")
    drop = float(f"{document['drop']:.3g}")
    width, lost = re.search(r"half-width ± ([\d.]+); expected loss at least ([\d.e-]+)", said).groups()  # type: ignore[union-attr]
    assert float(width) == pytest.approx(half_width_of(document, model, n, s), rel=6e-3)
    assert float(lost) == pytest.approx(loss_of(model, n, s, drop), rel=6e-3)
    (reached,) = re.findall(r"reached from (\d+) runs", said)
    assert half_width_of(document, model, int(reached), s) <= 3.0 < half_width_of(document, model, int(reached) - 1, s)
    assert len(re.findall(r'<label for="plan-', shown)) == len(re.findall(r'<input id="plan-', shown)) == 8


def test_before_any_score_nothing_is_known_of_the_noise(tmp_path: Path) -> None:
    folder = tmp_path / "c"
    folder.mkdir()
    (folder / "campaign.toml").write_text(HEAD + X + POL + MEASURED + STOP, encoding="utf-8")
    found = planned(folder)
    assert found["s"] is None
    assert {tuple(one["kept"]) for one in found["models"]} == {(0, 1), (0,), (1,)}
    assert CliRunner().invoke(app, ["plan", str(folder)]).exit_code == 0
    assert (folder / "reports" / "plan.html").exists()
