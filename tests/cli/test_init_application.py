"""``init --application``: what it writes is what the tables print, cut to what can be simulated, and it checks."""

from __future__ import annotations

import json
import re
import tomllib

import pytest
from typer.testing import CliRunner

from seqrsm.catalog import load_catalog, start_ranges
from seqrsm.catalog.measures import measure_of
from seqrsm.cli.app import app
from seqrsm.errors import UserError
from seqrsm.score.utilities import asked_for
from seqrsm.spec.from_catalog import (
    DEPRESSION_DEG,
    FREQUENCY_GHZ,
    RESOLUTION_M,
    applications_of,
    campaign_text,
    engine_for,
)
from seqrsm.spec.read import load_spec
from seqrsm.spec.templates import template_folder


def made(folder, *words, code=0):
    given = [part for one in words for part in ("--application", one)]
    result = CliRunner().invoke(app, ["init", str(folder), *given])
    assert result.exit_code == code, result.output
    return result.output


def test_soil_moisture_is_measured_by_its_skill_and_says_where_its_numbers_come_from(tmp_path) -> None:
    """No campaign under a false name: soil moisture is not a percentage of covers named rightly."""
    folder = tmp_path / "soil"
    assert "measured by soil_moisture_skill" in made(folder, "soil moisture")
    text = (folder / "campaign.toml").read_text(encoding="utf-8")
    assert "# Tables A.13, A.14: 0.4 to 5 GHz" in text
    spec = load_spec(folder)
    assert (spec.simulator.engine, spec.applications[0].utility) == ("prm", "soil_moisture_skill")
    checked = CliRunner().invoke(app, ["check", str(folder), "--json"])
    assert checked.exit_code == 0, checked.output
    assert json.loads(checked.stdout)["target_problem"] == ""


@pytest.mark.parametrize(
    ("words", "utility"),
    [
        ("crop classification", "percent_correct by field"),
        ("flood", "detection of Water"),
        ("forest", "detection of Trees"),
    ],
)
def test_other_applications_check(tmp_path, words, utility) -> None:
    folder = tmp_path / "mine"
    assert f"measured by {utility}" in made(folder, words)
    checked = CliRunner().invoke(app, ["check", str(folder)])
    assert checked.exit_code == 0, checked.output
    assert load_spec(folder).applications[0].utility == utility


@pytest.mark.parametrize(
    ("words", "why"), [("sea state", "has a sea"), ("snow", "snow or ice"), ("oil spill", "pollut")]
)
def test_what_no_utility_measures_is_said_and_waits_for_measured_scores(tmp_path, words, why) -> None:
    folder = tmp_path / "mine"
    told = made(folder, words)
    assert "no utility that ships measures" in told
    assert why in told
    spec = load_spec(folder)
    assert spec.simulator is None
    assert spec.applications[0].utility == "measured"
    proposed = CliRunner().invoke(app, ["propose", str(folder)])
    assert proposed.exit_code == 0, proposed.output


def test_two_applications_make_one_campaign_of_both(tmp_path) -> None:
    made(tmp_path / "two", "crops", "soil moisture")
    spec = load_spec(tmp_path / "two")
    assert [(one.name, one.utility) for one in spec.applications] == [
        ("crops", "kappa by field"),
        ("soil-moisture", "soil_moisture_skill"),
    ]
    checked = CliRunner().invoke(app, ["check", str(tmp_path / "two")])
    assert checked.exit_code == 0, checked.output
    assert "Make a campaign of its own" in made(tmp_path / "three", "flood", "oil spill", code=2)
    assert not (tmp_path / "three").exists()


def test_a_scene_of_ones_own_is_taken_and_must_have_the_covers(tmp_path) -> None:
    wake = template_folder() / "wake-radiometer" / "scene.npz"
    given = ["--application", "flood", "--scene", str(wake)]
    assert CliRunner().invoke(app, ["init", str(tmp_path / "own"), *given]).exit_code == 0
    assert (tmp_path / "own" / "scene.npz").read_bytes() == wake.read_bytes()
    given[1] = "urban"
    refused = CliRunner().invoke(app, ["init", str(tmp_path / "none"), *given])
    assert refused.exit_code == 2
    assert "Settlement" in refused.output
    assert not (tmp_path / "none").exists()


def test_every_entry_of_every_table_has_a_utility_or_a_sentence() -> None:
    catalogue = load_catalog()
    measured = 0
    for entry in catalogue.entries:
        found = measure_of(entry.application)
        assert bool(found.utility) != bool(found.says), entry.application
        assert bool(found.utility) == bool(found.engine)
        if found.utility:
            assert found.engine in asked_for(found.utility).row.engines
            measured += 1
    assert measured > 60
    # What is measured by a name is about that.
    for words, utility in {
        "Flood Mapping": "detection of Water", "Ground Water Exploration": "", "Water Pollution": "",
        "Forest/Non-Forest Discrimination": "detection of Trees", "Crop Stress": "", "Timberline": "",
        "Soil Moisture for Yield Estimate": "soil_moisture_skill", "Soil Mapping": "", "Yield Prediction": "",
        "Crop Identification": "percent_correct by field", "Ship Navigation and Routing": "", "Sea Ice": "",
    }.items():  # fmt: skip
        assert measure_of(words).utility == utility, words


def test_words_are_kept_for_the_report_whatever_signs_they_hold(tmp_path) -> None:
    folder = tmp_path / "mine"
    made(folder, 'Soil "moisture"\n')
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
            start_ranges(words)
        except UserError:
            continue
        wanted = applications_of([words])
        text = campaign_text(wanted)
        (tmp_path / "campaign.toml").write_text(text, encoding="utf-8")
        spec = load_spec(tmp_path)
        tried += 1
        if engine_for(wanted) != "psm":
            continue
        for name, value in spec.simulator.fixed.items():
            if name in limits:
                assert limits[name][0] <= value <= limits[name][1], words
        for item in tomllib.loads(text)["factor"]:
            if item["name"] in limits:
                low, high = limits[item["name"]]
                assert low <= item["low"] < item["high"] <= high, words
        known = re.sub(r"(?m)^# (?=\[application\.prior|utility = \[|optimum = )", "", text)
        if known != text:  # the catalogue as a prior, once its signs are taken away
            (tmp_path / "campaign.toml").write_text(known, encoding="utf-8")
            prior = load_spec(tmp_path).applications[0].prior
            assert prior is not None, words
            assert prior.optimum, words
            with_prior += 1
    assert tried > 100
    assert with_prior > 2


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
