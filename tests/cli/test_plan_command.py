"""`seqrsm plan`: its numbers are those of `seqrsm check`, and the page shows them."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from measured_campaign import FREQUENCY, HEAD, MEASURED, POL, STOP, X, make, quadratic
from typer.testing import CliRunner

from seqrsm.cli.app import app

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None)


def amount_of(model: dict[str, Any], name: str, n: int) -> float:
    """Half-width or loss after ``n`` runs: straight over the logarithm of the degrees of freedom."""
    df = np.array(model["runs"]) - model["p"]
    return float(np.interp(np.log(n - model["p"]), np.log(df), model[name]))


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


def test_it_says_what_check_says(scored: Path, document: dict) -> None:
    found = json.loads(CliRunner().invoke(app, ["check", str(scored), "--json"]).stdout)
    assert document["source"] == found["surfaces"]
    assert document["s"] == found["noise"]
    whole, first, _, one = found["plans"]  # as it is, of first order, and each factor fixed
    for plan, model in ((whole, (2, 0, 1)), (first, (1, 0, 1)), (one, (2, 0))):
        same = model_of(document, *model)
        assert (same["p"], same["asked"]) == (plan["n_terms"], plan["asked"])
        assert amount_of(same, "half_widths", plan["runs"]) == pytest.approx(plan["half_width"], rel=0.06)
        assert amount_of(same, "losses", plan["runs"]) == pytest.approx(plan["loss"], rel=0.4)


def test_runs_are_those_that_leave_degrees_of_freedom(document: dict) -> None:
    for model in document["models"]:
        assert model["runs"][0] == model["p"] + 1
        assert model["runs"][-1] == document["most"] == max(3 * document["max_runs"], 60)
        assert len(model["runs"]) == len(model["half_widths"]) == len(model["losses"])
        assert model["half_widths"][0] > 3.0 * model["half_widths"][-1]


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
    scale = float(f"{document['s']:.3g}") / document["s"]  # the page begins with three digits
    width, lost = re.search(r"half-width ± ([\d.]+); expected loss ([\d.e-]+)", said).groups()  # type: ignore[union-attr]
    assert float(width) == pytest.approx(scale * amount_of(model, "half_widths", n), rel=6e-3)
    assert float(lost) == pytest.approx(scale * amount_of(model, "losses", n), rel=6e-3)
    (reached,) = map(int, re.findall(r"reached with (\d+) runs", said))
    assert scale * amount_of(model, "half_widths", reached) <= 3.0
    assert reached == model["asked"] or scale * amount_of(model, "half_widths", reached - 1) > 3.0
    assert len(re.findall(r'<label for="plan-', shown)) == len(re.findall(r'<input id="plan-', shown)) == 7


def test_before_any_score_nothing_is_known_of_the_noise(tmp_path: Path) -> None:
    folder = tmp_path / "c"
    folder.mkdir()
    (folder / "campaign.toml").write_text(HEAD + X + POL + MEASURED + STOP, encoding="utf-8")
    found = planned(folder)
    assert found["s"] is None
    assert {tuple(one["kept"]) for one in found["models"]} == {(0, 1), (0,), (1,)}
    assert CliRunner().invoke(app, ["plan", str(folder)]).exit_code == 0
    assert (folder / "reports" / "plan.html").exists()
