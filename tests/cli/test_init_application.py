"""``init --application``: what it writes is what the tables print, cut to what can be simulated, and it checks."""

from __future__ import annotations

import json
import re
import tomllib
from dataclasses import replace

import pytest
from typer.testing import CliRunner

from seqrsm.campaign import check
from seqrsm.catalog.start import measure_of, start_ranges
from seqrsm.catalog.tables import load_catalog
from seqrsm.cli.app import app
from seqrsm.errors import UserError
from seqrsm.score.utilities import asked_for
from seqrsm.spec.from_catalog import (
    DEPRESSION_DEG,
    FREQUENCY_GHZ,
    RESOLUTION_M,
    Site,
    applications_of,
    campaign_text,
    engine_for,
)
from seqrsm.spec.read import load_spec
from seqrsm.spec.templates import packaged


@pytest.fixture
def few_probes(monkeypatch) -> None:
    """What runs cost and scatter, from few settings of the region."""
    monkeypatch.setattr(check, "PROBES", 5)


@pytest.fixture(autouse=True)
def probed_once(monkeypatch) -> None:
    """`init` simulates to settle the target, which moves no score: `check` of the same folder need not do so again."""
    real, found = check._probe, {}

    def probe(spec, progress):
        if spec.folder not in found:
            found[spec.folder] = real(spec, progress)
        return found[spec.folder]

    monkeypatch.setattr(check, "_probe", probe)


def made(folder, *words, code=0):
    given = [part for one in words for part in ("--application", one)]
    result = CliRunner().invoke(app, ["init", str(folder), *given])
    assert result.exit_code == code, result.output
    return result.output


@pytest.mark.usefixtures("few_probes")
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
    ("words", "utility", "widened"),
    [("land use mapping", "percent_correct by field", False), ("flood", "detection of Water", True)],
)
def test_a_campaign_passes_its_own_check_and_says_why_its_target_is_wide(
    tmp_path, words, utility, widened, request
) -> None:
    """What is not known of the ground is most of a detection's scatter: 14 percent was written, which none reaches."""
    if widened:  # five widen any
        request.getfixturevalue("few_probes")
    folder = tmp_path / "mine"
    said = made(folder, words)
    assert f"measured by {utility}" in said
    checked = CliRunner().invoke(app, ["check", str(folder), "--json"])
    assert checked.exit_code == 0, checked.output
    found = json.loads(checked.stdout)
    assert found["target_problem"] == found["refused"] == ""
    as_it_is = found["plans"][0]
    assert not as_it_is["change"]
    assert 14.0 <= found["target"] == load_spec(folder).stop.half_width
    assert found["target_loss"] == load_spec(folder).stop.loss
    assert as_it_is["loss"] <= found["target_loss"] <= max(1.0, 1.32 * as_it_is["loss"])
    assert as_it_is["half_width"] <= found["target"]
    assert load_spec(folder).applications[0].utility == utility
    text = (folder / "campaign.toml").read_text(encoding="utf-8")
    for told in (said, text):
        assert ("are expected to give" in " ".join(told.split())) == widened
    if widened:  # no wider than it must be, and the reason is that of the check
        assert found["target"] <= 1.32 * as_it_is["half_width"]
        assert f"{100 * found['ground_share']:.0f} % of a run's variance" in " ".join(text.replace("# ", "").split())
        assert found["ground_share"] > 0.05
    else:
        assert found["target"] == 14.0


@pytest.mark.usefixtures("few_probes")
def test_tables_are_no_reason_for_a_wide_target_where_they_scatter_nothing(tmp_path, monkeypatch) -> None:
    real = check.check_campaign
    monkeypatch.setattr(check, "check_campaign", lambda *given: replace(real(*given), ground_share=0.0))
    said = " ".join(made(tmp_path / "mine", "flood").split())
    assert "are expected to give" in said
    assert "table uncertainty" not in said


@pytest.mark.usefixtures("few_probes")
@pytest.mark.parametrize("name", ["crops-and-moisture", "flevoland", "limburg-radar"])
def test_a_template_passes_its_own_check(tmp_path, name) -> None:
    folder = tmp_path / "mine"
    assert CliRunner().invoke(app, ["init", str(folder), "--template", name]).exit_code == 0
    checked = CliRunner().invoke(app, ["check", str(folder), "--json"])
    assert checked.exit_code == 0, checked.output
    assert json.loads(checked.stdout)["target_problem"] == ""


@pytest.mark.parametrize(
    ("words", "why"),
    [
        ("sea state", "has a sea"),
        ("snow", "write utility = 'detection of Ice' over a scene"),
        ("oil spill", "write utility = 'detection of Oil' over a scene"),
        ("geologic mapping", "utility = 'rank'"),
        ("storms over land", "not the weather"),
    ],
)
def test_what_no_utility_measures_is_said_and_waits_for_measured_scores(tmp_path, words, why) -> None:
    folder = tmp_path / "mine"
    told = made(folder, words)
    assert "no built-in utility measures" in told
    assert why in " ".join(told.split())
    assert max(map(len, (folder / "campaign.toml").read_text(encoding="utf-8").splitlines())) <= 120
    spec = load_spec(folder)
    assert spec.simulator is None
    assert spec.applications[0].utility == "measured"
    proposed = CliRunner().invoke(app, ["propose", str(folder)])
    assert proposed.exit_code == 0, proposed.output


@pytest.mark.usefixtures("few_probes")
def test_two_applications_make_one_campaign_of_both(tmp_path) -> None:
    made(tmp_path / "two", "crops", "soil moisture")
    spec = load_spec(tmp_path / "two")
    assert [(one.name, one.utility) for one in spec.applications] == [
        ("crops", "kappa by field"),
        ("soil-moisture", "soil_moisture_skill"),
    ]
    checked = CliRunner().invoke(app, ["check", str(tmp_path / "two")])
    assert checked.exit_code == 0, checked.output
    assert "Make a separate campaign" in made(tmp_path / "three", "flood", "oil spill", code=2)
    assert not (tmp_path / "three").exists()


@pytest.mark.usefixtures("few_probes")
def test_a_scene_of_ones_own_is_taken_and_must_have_the_covers(tmp_path) -> None:
    wake = packaged("campaigns") / "wake-radiometer" / "scene.npz"
    given = ["--application", "flood", "--scene", str(wake)]
    assert CliRunner().invoke(app, ["init", str(tmp_path / "own"), *given]).exit_code == 0
    assert (tmp_path / "own" / "scene.npz").read_bytes() == wake.read_bytes()
    # The scene is 13.5 km deep: from 24 km above its ground the swath stays beside nadir to atan(24 / 7.2) only.
    assert "altitude_m = 24200.0" in (tmp_path / "own" / "campaign.toml").read_text(encoding="utf-8")
    steep = campaign_text(applications_of(["forest"]), Site(30.0, 450 * 30.0))
    assert "83 deg (most agree on 30 to 70)\n# cut: an aircraft sees the scene at 10 to 73 deg" in steep
    assert "Langegracht" not in steep
    coarse = campaign_text(applications_of(["crop"]), Site(80.0, 29000.0))  # 10 to 50 m are printed
    assert "not attainable here, the scene has cells of 80 m: the full range instead" in coarse
    assert "low = 80.0\nhigh = 800.0" in coarse
    small = campaign_text(applications_of(["soil moisture"]), Site(20.0, 1600.0))  # a radiometer's
    assert "low = 60.0\nhigh = 200.0" in small
    assert "altitude_m = 1500.0" in small
    assert "5 GHz (most agree on 1.5 to 5)\n# cut: the tables are reliable from 1 to 36 GHz\n" in small
    # A site of 30 km is seen at the angles of the template's 3.68 km.
    alps = Site(10.0, 3000.0, 1800.0, 3900.0)
    for words, altitude_m in (("soil moisture", 4200.0), ("crop", 7800.0)):
        assert f"altitude_m = {altitude_m}\n" in campaign_text(applications_of([words]), alps)
    large = tomllib.loads(campaign_text(applications_of(["soil moisture"]), Site(10.0, 30000.0)))
    assert large["simulator"]["fixed"]["altitude_m"] == pytest.approx(1500.0 * 30.0 / 3.68, rel=0.03)
    checked = CliRunner().invoke(app, ["check", str(tmp_path / "own")])
    assert checked.exit_code == 0, checked.output
    assert "Warning" not in checked.output
    given[1] = "corn"
    refused = CliRunner().invoke(app, ["init", str(tmp_path / "none"), *given])
    assert refused.exit_code == 2
    assert "Corn" in refused.output
    assert not (tmp_path / "none").exists()


def test_every_entry_of_every_table_has_a_utility_or_a_sentence() -> None:
    catalogue = load_catalog()
    measured = 0
    for entry in catalogue.entries:
        found = measure_of(entry.application)
        assert bool(found.utility) != bool(found.says), entry.application
        assert bool(found.utility) == bool(found.engine)
        if found.utility:
            assert asked_for(found.utility).row.function
            measured += 1
    assert measured > 60
    # What is measured by a name is about that.
    for words, utility in {
        "Flood Mapping": "detection of Water", "Ground Water Exploration": "", "Water Pollution": "",
        "Forest/Non-Forest Discrimination": "detection of Trees", "Crop Stress": "", "Timberline": "",
        "Soil Moisture for Yield Estimate": "soil_moisture_skill", "Soil Mapping": "", "Yield Prediction": "",
        "Crop Identification": "percent_correct by field", "Ship Navigation and Routing": "", "Sea Ice": "",
        "Wetland Hydrology and Delineation": "detection of Water", "Corn": "f1 of Corn by field", "Farm Practices": "",
        "Cultivated Vegetation": "percent_correct by field", "Natural Vegetation": "percent_correct by field",
        "Land Use Resources and Geographic Applications": "percent_correct by field",
        "Land Use (Suburban and Rural)": "percent_correct by field", "Density of Woody Vegetation": "",
    }.items():  # fmt: skip
        assert measure_of(words).utility == utility, words
    for words, says in {
        "Hurricane Damage Assessment": "how that fares", "Storms Over Land": "weather", "Rainfall": "weather",
        "Wind Stress Over Oceans": "sea", "Sea Ice Navigation and Mapping": "ice", "Traffic": "targets",
        # Groups of section 1.2.
        "Water Resources": "entries to choose from", "Oceanography": "sea", "Mineral Resources": "relief",
        "Damage Assessment and Hazard Surveys": "how that fares",
        "Irrigation": "irrigated", "Runoff Coefficient Estimate": "hydrologist", "Resource Management": "no one thing",
    }.items():  # fmt: skip
        assert says in measure_of(words).says, words


@pytest.mark.parametrize(("words", "kind"), [("A.16", "table"), ("a.38", "table"), ("Seasat", "spacecraft")])
def test_a_table_and_a_spacecraft_are_no_applications(tmp_path, words, kind) -> None:
    told = " ".join(made(tmp_path / "mine", words, code=2).split())
    assert f"this is a {kind}, not an application" in told
    assert f"`seqrsm catalog {words}` shows the {kind}" in told


def test_words_of_neither_kind_of_system_are_said_to_be_of_none(tmp_path) -> None:
    told = made(tmp_path / "mine", "Calamity", code=2)
    assert "no application of Tables A.1 to A.20" in told


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
