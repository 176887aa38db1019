"""``init --application``: what it writes is what the tables print, cut to what can be simulated, and it checks."""

from __future__ import annotations

import json
import re
import tomllib

import pytest
from typer.testing import CliRunner

from seqrsm.catalog import load_catalog, start_ranges
from seqrsm.cli.app import app
from seqrsm.errors import UserError
from seqrsm.spec.from_catalog import DEPRESSION_DEG, FREQUENCY_GHZ, RESOLUTION_M, campaign_text
from seqrsm.spec.read import load_spec


def test_soil_moisture_checks_and_says_where_its_numbers_come_from(tmp_path) -> None:
    folder = tmp_path / "soil"
    made = CliRunner().invoke(app, ["init", str(folder), "--application", "soil moisture"])
    assert made.exit_code == 0, made.output
    text = (folder / "campaign.toml").read_text(encoding="utf-8")
    # Tables A.16 and A.17: nadir angle 0 to 40, most 7 to 17 deg
    assert "# Tables A.16, A.17: 50 to 90 deg (most agree on 73 to 83)" in text
    assert 'levels = ["HH", "HV", "HH+HV"]' in text
    checked = CliRunner().invoke(app, ["check", str(folder), "--json"])
    assert checked.exit_code == 0, checked.output
    assert json.loads(checked.stdout)["target_problem"] == ""


@pytest.mark.parametrize("words", ["crop classification", "urban", "oil spill"])
def test_other_applications_check(tmp_path, words) -> None:
    folder = tmp_path / "mine"
    assert CliRunner().invoke(app, ["init", str(folder), "--application", words]).exit_code == 0
    checked = CliRunner().invoke(app, ["check", str(folder)])
    assert checked.exit_code == 0, checked.output


def test_words_are_kept_for_the_report_whatever_signs_they_hold(tmp_path) -> None:
    folder = tmp_path / "mine"
    made = CliRunner().invoke(app, ["init", str(folder), "--application", 'Soil "moisture"\n'])
    assert made.exit_code == 0, made.output
    spec = load_spec(folder)
    assert spec.applications[0].catalog == "soil moisture"
    assert spec.name == spec.applications[0].name == "soil-moisture"


def test_every_application_of_the_catalogue_gives_a_valid_file(tmp_path) -> None:
    """Whatever is printed: within what can be simulated, and within the print where that is possible."""
    limits = {"frequency": FREQUENCY_GHZ, "resolution": RESOLUTION_M, "depression_angle": DEPRESSION_DEG}
    (tmp_path / "scene.npz").write_bytes(b"x")
    tried = with_prior = 0
    for words in sorted({entry.application for entry in load_catalog().entries if entry.system == "active"}):
        try:
            start = start_ranges(words)
        except UserError:
            continue
        text = campaign_text(start)
        (tmp_path / "campaign.toml").write_text(text, encoding="utf-8")
        spec = load_spec(tmp_path)
        for name, value in spec.simulator.fixed.items():
            if name in limits:
                assert limits[name][0] <= value <= limits[name][1], words
        for item in tomllib.loads(text)["factor"]:
            if item["name"] in limits:
                low, high = limits[item["name"]]
                assert low <= item["low"] < item["high"] <= high, words
        tried += 1
        known = re.sub(r"(?m)^# (?=\[application\.prior|utility = \[|optimum = )", "", text)
        if known != text:  # the catalogue as a prior, once its signs are taken away
            (tmp_path / "campaign.toml").write_text(known, encoding="utf-8")
            prior = load_spec(tmp_path).applications[0].prior
            assert prior is not None, words
            assert prior.optimum, words
            with_prior += 1
    assert tried > 100
    assert with_prior > 30


@pytest.mark.parametrize("arguments", [["x"], ["x", "--template", "flevoland", "--application", "snow"]])
def test_a_template_or_an_application_is_needed(arguments) -> None:
    result = CliRunner().invoke(app, ["init", *arguments])
    assert result.exit_code == 2
    assert "--application" in result.output


def test_unknown_words_change_nothing(tmp_path) -> None:
    folder = tmp_path / "mine"
    result = CliRunner().invoke(app, ["init", str(folder), "--application", "soil mosture"])
    assert result.exit_code == 2
    assert "moisture" in result.output
    assert not folder.exists()
