"""`[stop] loss` in a campaign of flights: forms, files without settings, status, fit and report tell the same."""

from __future__ import annotations

import csv
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from measured_campaign import FREQUENCY, HEAD, X
from typer.testing import CliRunner

from seqrsm.campaign.campaign import Campaign
from seqrsm.campaign.dossier import assemble
from seqrsm.cli.app import app
from seqrsm.cli.notebook import Campaign as Notebook
from seqrsm.cli.show_fit import show_look
from seqrsm.decide.stopping import Check
from seqrsm.report.sections.data import question_section

pytestmark = pytest.mark.usefixtures("few_draws")

TWO = """\
[[application]]
name = "cover"
utility = "measured"
unit = "percent"
half_width = 8.0
loss = LIMIT
[[application]]
name = "moisture"
utility = "measured"
goal = "minimize"
unit = "m3/m3"
half_width = 0.03
[stop]
half_width = 1.0
max_runs = 30
"""


def seqrsm(*words: object, code: int = 0) -> str:
    done = CliRunner().invoke(app, [str(word) for word in words])
    assert done.exit_code == code, done.output
    return " ".join(done.output.split())


def flown(folder: Path, form: Path) -> Path:
    """The form filled in, and its settings left out."""
    rows = list(csv.DictReader(form.read_text().splitlines()))
    rng = np.random.default_rng(len(rows))
    for row in rows:
        a, b = float(row["x"]) / 5.0 - 1.0, np.log2(float(row["frequency [GHz]"])) / 2.0 - 1.0
        away, noise = (a - 0.2) ** 2 + (b + 0.1) ** 2, rng.normal()
        row["score"] = str(
            80 - 9 * away + noise if row["application"] == "cover" else 0.05 + 0.03 * away + 0.003 * noise
        )
    kept = [name for name in rows[0] if name not in ("x", "frequency [GHz]")]
    with (folder / "flown.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, kept, extrasaction="ignore")
        writer.writeheader()
        writer.writerows(rows)
    return folder / "flown.csv"


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("loss") / "c"
    folder.mkdir()
    (folder / "campaign.toml").write_text(HEAD + X + FREQUENCY + TWO.replace("LIMIT", "2.0"), encoding="utf-8")
    for number in range(3):
        form = folder / f"form{number}.csv"
        seqrsm("propose", folder, "--source", "flight", "--csv", form)
        assert "No settings are given" in seqrsm("ingest", folder, flown(folder, form))
    return folder


def limited(campaign: Path, limit: float) -> Path:
    (campaign / "campaign.toml").write_text(HEAD + X + FREQUENCY + TWO.replace("LIMIT", repr(limit)), encoding="utf-8")
    return campaign


def look(folder: Path) -> dict[str, Any]:
    return json.loads(seqrsm("status", folder, "--json"))["applications"][0]["last_look"]


def test_every_face_tells_the_limit_of_the_application_that_has_one(campaign: Path) -> None:
    folder = limited(campaign, 2.0)
    told = json.loads(seqrsm("status", folder, "--json"))
    cover, moisture = told["applications"]
    assert (cover["target_loss"], moisture["target_loss"]) == (2.0, None)
    fit = json.loads(seqrsm("fit", folder, "--json"))["applications"]
    losses = [one["posterior"]["optimum"]["expected_regret"] for one in fit]
    assert [one["last_look"]["expected_loss"] for one in told["applications"]] == pytest.approx(losses, rel=0.2)
    assert cover["last_look"]["expected_loss"] == losses[0]  # with a limit, of the same draws
    assert [check["name"] for check in fit[0]["stop"]["checks"]].count("loss") == 1
    assert "loss" not in [check["name"] for check in fit[1]["stop"]["checks"]]
    status = seqrsm("status", folder)
    assert "expected loss, at most 2 percent for cover" in status
    assert status.count("target at most 2 percent") == 1
    assert Notebook(folder).fit().to_frame()["expected_loss"][0] == losses[0]
    made = Campaign.open(folder)
    question = str(question_section(assemble(made)))
    made.store.close()
    assert "and the settings an expected loss of at most 2\\xa0percent for cover; in addition" in question


def test_a_limit_that_is_missed_by_little_is_told_with_the_digits_that_show_it(campaign: Path, capsys) -> None:
    loss = json.loads(seqrsm("status", limited(campaign, 2.0), "--json"))["applications"][0]["last_look"][
        "expected_loss"
    ]
    limit = float(f"{loss:.2g}") if float(f"{loss:.2g}") < loss else float(f"{0.9999 * loss:.4g}")
    folder = limited(campaign, limit)
    assert not look(folder)["held"]
    made = Campaign.open(folder)
    show_look(made.spec, made.analyse_all(n_draws=1000)[0])
    made.store.close()
    said = capsys.readouterr().err
    lost = re.search(rf" loss (\S+) \(target {limit:g}\)  not met: .*loss", said)
    assert lost is not None, said
    assert float(lost[1]) > limit
    assert "The settings are expected to lose" not in seqrsm("fit", folder)  # but once, in the next steps
    for text in (seqrsm("status", folder), seqrsm("fit", folder)):
        place = text.index(f"at most {limit:g} percent")
        assert f"{limit:g} percent" not in text[place - 40 : place]
    assert f"too small for an expected loss of {0.001:g} percent" in seqrsm("status", limited(campaign, 0.001))


KNOWN = "[application.prior]\nutility = [{}]\nrepeat_sd = {}\n"


def test_check_judges_the_targets_of_each_application(tmp_path: Path) -> None:
    """Told was that whose half-width is the farthest off; the other's limit of the loss was said to be no problem."""
    cover, moisture = KNOWN.format("50, 90", 3.0), KNOWN.format("0.03, 0.1", 0.004)
    two = TWO.replace("LIMIT\n", f"1.0\n{cover}").replace("0.03\n", f"0.03\nloss = 1e-5\n{moisture}")
    toml = tmp_path / "campaign.toml"
    toml.write_text(HEAD + X + FREQUENCY + two, encoding="utf-8")
    told = seqrsm("check", tmp_path)
    assert "Warning: moisture: 30 runs are not expected to reach the targets." in told
    assert "No problems found" not in told
    assert "What the budget can achieve, cover" in told
    found = json.loads(seqrsm("check", tmp_path, "--json"))
    (cover_found,) = found["others"]
    assert (found["application"], found["target"], found["target_loss"]) == ("moisture", 0.03, 1e-5)
    assert (cover_found["application"], cover_found["target"], cover_found["target_loss"]) == ("cover", 8.0, 1.0)
    assert cover_found["target_problem"] == ""
    toml.write_text(toml.read_text("utf-8").replace("loss = 1e-5", "loss = 0.01"), "utf-8")
    assert "No problems found." in seqrsm("check", tmp_path)
    toml.write_text(toml.read_text("utf-8").replace("loss = 1.0", "loss = 0.001"), "utf-8")
    assert "Warning: cover: 30 runs are not expected to reach the targets." in seqrsm("check", tmp_path)


def test_an_interim_line_says_what_the_score_is_held_against(campaign: Path, capsys) -> None:
    """It said "not met: guess", also beside an existing map."""
    made = Campaign.open(limited(campaign, 2.0))
    analysis = made.analyse_all(n_draws=1000)[0]
    failed = replace(analysis.decision, held=False, checks=(Check("guess", False, ""), Check("pure_error", False, "")))
    for known_map, what in ((False, "a guess"), (True, "the map")):
        show_look(made.spec, replace(analysis, decision=failed, known_map=known_map))
        assert f"not met: better than {what}, pure error" in " ".join(capsys.readouterr().err.split())
    made.store.close()
