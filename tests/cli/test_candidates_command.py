"""`seqrsm candidates`: the optimum loses nothing, a poorer radar what it lacks; by the surface where that can tell."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from commands import ok
from measured_campaign import FREQUENCY, MEASURED, X, days, make, quadratic
from scipy import stats
from tiny_campaign import TINY, make_tiny
from typer.testing import CliRunner

import seqrsm
from seqrsm.campaign import candidates
from seqrsm.campaign.campaign import Campaign
from seqrsm.campaign.candidates import FILE, candidates_of
from seqrsm.campaign.dossier import assemble
from seqrsm.cli.app import app
from seqrsm.cli.results import Candidates
from seqrsm.report.content import build_report
from seqrsm.spec.read import load_spec

pytestmark = pytest.mark.usefixtures("few_draws")

CANDIDATES = """
[[candidate]]
name = "the same"
parameters = { altitude_m = 4000.0 }
[[candidate]]
name = "coarse"
parameters = { resolution = 45.0 }
[[candidate]]
name = "weak"
parameters = { peak_power = 0.001 }
[[candidate]]
sensor = "NISAR S DP 25"
[[candidate]]
sensor = "Capella Spotlight"
parameters = { frequency = 0.2 }
"""


@pytest.fixture(scope="module")
def compared(tmp_path_factory: pytest.TempPathFactory, tiny_scene: Path) -> Path:
    folder = make_tiny(tmp_path_factory.mktemp("compared") / "tiny", tiny_scene, TINY + CANDIDATES)
    assert CliRunner().invoke(app, ["run", str(folder), "--max-runs", "16"]).exit_code in (0, 3)
    ok("candidates", folder, "--worlds", 4)
    return folder


def found(folder: Path) -> dict[str, dict]:
    measured = json.loads((folder / FILE).read_text(encoding="utf-8"))
    (application,) = measured["applications"].values()
    return {row["name"]: row for row in application["candidates"]}


def test_the_optimum_loses_nothing_and_a_weak_radar_its_power(compared: Path) -> None:
    rows = found(compared)
    same, weak = rows["the same"], rows["weak"]
    assert (same["how"], same["difference"], same["probability"]) == ("simulation", 0.0, 1.0)
    assert same["owed_to"] == []
    assert weak["difference"] < -10.0
    assert [one["property"] for one in weak["owed_to"]] == ["noise"]
    assert weak["owed_to"][0]["difference"] == pytest.approx(weak["difference"], abs=5.0)  # of half the occasions
    assert weak["probability"] < 0.5


def test_settings_within_the_region_are_judged_by_the_surface(compared: Path) -> None:
    row = found(compared)["coarse"]
    assert row["how"] == "surface"
    low, high = row["confidence"]["low"], row["confidence"]["high"]
    assert low < row["difference"] < high
    # Grounds differ by more than is not known of the surface.
    assert row["one_ground"]["low"] < low
    assert row["one_ground"]["high"] > high


def test_a_named_sensor_is_simulated_over_its_swath_with_what_it_lacks(compared: Path) -> None:
    row = found(compared)["NISAR S DP 25, HH+HV"]
    assert [round(place["incidence_deg"]) for place in row["places"]] == [33, 40, 47]
    assert all(place["noise_db"] == pytest.approx(-20.0) for place in row["places"])
    assert {one["property"] for one in row["owed_to"]} >= {"cell and looks", "angle", "noise"}
    assert "noise" in row["recalled"]
    assert row["one_ground"]["low"] < row["confidence"]["low"] < row["difference"]


def test_the_first_is_compared_again_in_worlds_that_had_no_part_in_its_choice(compared: Path, monkeypatch) -> None:
    """Of many as good in truth the first is one that the worlds favour, by more than its interval allows for."""
    drawn = []
    scores_of = candidates.scores_of

    def seen(tasks: list, *others: object) -> object:
        drawn.append({task.world for task in tasks})
        return scores_of(tasks, *others)

    monkeypatch.setattr(candidates, "scores_of", seen)
    told = ok("candidates", compared, "--worlds", 4)
    first, *others = json.loads((compared / FILE).read_text(encoding="utf-8"))["applications"]["cover"]["candidates"]
    assert len(drawn[-1]) == 4
    assert all(drawn[-1].isdisjoint(worlds) for worlds in drawn[:-1])
    assert first["again"].keys() == {"name", "how", "score", "difference", "confidence", "one_ground", "probability"}
    assert not any("again" in row for row in others)
    assert {row["name"] for row in others if "beside_first" in row} == {"weak", "NISAR S DP 25, HH+HV"}
    assert f"The first of {len(others)} candidates may owe its place to chance." in " ".join(told.split())


def test_in_a_notebook_it_is_the_same(compared: Path) -> None:
    theirs = json.loads(ok("candidates", compared, "--worlds", 4, "--json"))
    mine = seqrsm.Campaign(compared).candidates(worlds=4)
    assert mine.to_json() == theirs
    frame = mine.to_frame().set_index("candidate")
    rows = theirs["applications"]["cover"]["candidates"]
    assert list(frame.index) == [row["name"] for row in rows]
    assert set(frame["application"]) == {"cover"}
    weak = next(row for row in rows if row["name"] == "weak")
    assert frame.loc["weak", "difference"] == weak["difference"]
    assert frame.loc["weak", "probability"] == weak["probability"]
    assert frame.loc["weak", "one_ground_low"] == weak["one_ground"]["low"]
    assert "noise" in frame.loc["NISAR S DP 25, HH+HV", "recalled"]
    assert np.isnan(frame.loc["Capella Spotlight GEO, HH", "score"])
    assert frame.loc["Capella Spotlight GEO, HH", "why"]
    assert repr(mine).startswith("Candidate sensors\n")
    assert "The optimum's score is" in repr(mine)
    page = mine._repr_html_()
    assert "data:image/svg+xml" in page
    assert "NISAR S DP 25, HH+HV" in page


def test_what_cannot_be_built_says_why(compared: Path) -> None:
    row = found(compared)["Capella Spotlight GEO, HH"]
    assert row["how"] == "none"
    assert row["why"]


def test_terminal_json_and_report_tell_it(compared: Path) -> None:
    text = (compared / "campaign.toml").read_text(encoding="utf-8")
    asked = text.replace("[[application]]", "[[application]]\nsufficient = 100.0", 1)
    (compared / "campaign.toml").write_text(asked, encoding="utf-8")
    document = json.loads(ok("candidates", compared, "--worlds", 5, "--json"))
    rows = document["applications"]["cover"]["candidates"]
    assert max(row.get("probability", 0.0) for row in rows if row["how"] == "simulation") < 0.2
    assert document["applications"]["cover"]["relative"] is False
    dossier = assemble(Campaign.open(compared))
    assert "candidates" in [section.key for section in build_report(dossier).sections]
    # A sensor may well score less than a guess does: the report says why.
    assert any("less than a guess" in text for text in dossier.assumptions)
    other = asked.replace("peak_power = 0.001", "peak_power = 0.002")
    assert other != asked
    (compared / "campaign.toml").write_text(other, encoding="utf-8")
    dossier = assemble(Campaign.open(compared))
    assert dossier.candidates is None  # others were compared
    (told,) = (section for section in build_report(dossier).sections if section.key == "candidates")
    assert "have not been compared with this optimum: run `seqrsm candidates`" in str(told)
    (compared / "campaign.toml").write_text(text, encoding="utf-8")


def test_without_candidates_it_says_what_to_add(tiny: Path) -> None:
    done = CliRunner().invoke(app, ["candidates", str(tiny)])
    assert done.exit_code == 2
    assert "[[candidate]]" in done.stderr


def test_where_no_sensor_fits_the_ranges_it_says_so(tiny: Path) -> None:
    """It was told to add sensor = "*", which was there."""
    path = tiny / "campaign.toml"
    text = path.read_text(encoding="utf-8")
    text = text.replace("low = 10.0", "low = 0.1").replace("high = 60.0", "high = 0.11")  # m: finer than any sensor
    path.write_text(f'{text}\n[[candidate]]\nsensor = "*"\n', encoding="utf-8")
    result = CliRunner().invoke(app, ["candidates", str(tiny)])
    assert result.exit_code == 2
    assert 'no sensor of sensor = "*" fits the ranges of frequency and resolution' in " ".join(result.stderr.split())


def test_measured_campaigns_judge_by_the_surface_alone(tmp_path: Path) -> None:
    more = """[[candidate]]
sensor = "Sentinel-1 IW GRDH"
[[candidate]]
sensor = "BIOMASS SM SLC"
"""
    folder = make(tmp_path / "m", X + FREQUENCY, quadratic(), model=more)
    ok("candidates", folder)
    rows = found(folder)
    sentinel, biomass = rows["Sentinel-1 IW GRDH, VV+VH"], rows["BIOMASS SM SLC, HH+HV+VV+phase"]
    assert sentinel["how"] == "surface"
    assert sentinel["settings"]["frequency"] == 5.405
    assert (biomass["how"], "outside the region" in biomass["why"]) == ("none", True)


@pytest.mark.parametrize("goal", ["maximize", "minimize"])
def test_by_the_surface_the_optimum_loses_nothing_and_its_neighbour_gains_nothing(tmp_path: Path, goal: str) -> None:
    """The optimum's mean is corrected for selection bias; the same settings beside it were told as better."""
    sign = 1.0 if goal == "maximize" else -1.0
    rows = [row | {"score": sign * row["score"]} for row in quadratic()]
    folder = make(tmp_path / "m", X + FREQUENCY, rows, application=f'{MEASURED}goal = "{goal}"\n')
    best = seqrsm.Campaign(folder).fit().analyses[0].optimum
    assert sign * best.optimism > 0.0
    x = best.settings["x"]
    lines = [
        f'[[candidate]]\nname = "{name}"\nparameters = {{ x = {at} }}\n'
        for name, at in (("same", x), ("near", x + 1e-3))
    ]
    file = folder / "campaign.toml"
    file.write_text(file.read_text("utf-8") + "".join(lines), "utf-8")
    ok("candidates", folder)
    same, near = found(folder)["same"], found(folder)["near"]
    assert same["score"] == pytest.approx(best.mean)
    assert (same["difference"], same["confidence"]["low"], same["confidence"]["high"]) == pytest.approx((0.0, 0.0, 0.0))
    assert sign * near["difference"] <= 0.0


def test_nothing_is_told_where_nothing_is_known_of_scatter(tmp_path: Path) -> None:
    """As many runs as terms."""
    rows = [{"x": x, "score": score} for x, score in ((0.0, 1.0), (5.0, 4.0), (10.0, 2.0))]
    folder = make(tmp_path / "m", X, rows, model='[[candidate]]\nname = "other"\nparameters = { x = 3.0 }\n')
    assert "other could not be evaluated: nothing is known of the scatter" in " ".join(ok("candidates", folder).split())


@pytest.mark.parametrize("effect", [0.0, 20.0])
def test_one_measured_occasion_scatters_with_either_sensor(tmp_path: Path, effect: float) -> None:
    """The interval of a mean difference was told for that of one occasion, and a sensor sufficed too surely.

    A random day, which both sensors share, widens what one sensor alone will score.
    """
    blocks = '[model]\nblock = "block"\nblock_effect = "random"\n' if effect else ""
    rows, _ = days(60, effect, 0)
    more = f'[[candidate]]\nname = "other"\nparameters = {{ frequency = 8.0 }}\n{blocks}'
    use = MEASURED + "sufficient = 60.0\n" if effect else MEASURED
    folder = make(tmp_path / "m", X + FREQUENCY, rows, model=more, application=use)
    ok("candidates", folder)
    row = found(folder)["other"]
    low, high = (0.5 * (row[of]["high"] - row[of]["low"]) / 1.96 for of in ("confidence", "one_ground"))
    assert np.sqrt(high**2 - low**2) == pytest.approx(np.sqrt(2.0), rel=0.25)  # scores scatter by 1, and 60 tell so
    if effect:
        shift = np.std(effect * np.random.default_rng(0).normal(size=6), ddof=1)
        least, most = (stats.norm.sf(60.0, row["score"], times * shift) for times in (2.0, 0.6))
        assert least < row["probability"] < most


def test_all_that_fit_are_neither_past_nor_beyond_the_factors(tmp_path: Path, tiny_scene: Path) -> None:
    text = TINY.replace("frequency = 3.0\n", "").replace("[[factor]]", FREQUENCY + "[[factor]]", 1)
    folder = make_tiny(tmp_path / "wide", tiny_scene, text + '[[candidate]]\nsensor = "*"\n')
    names = [one.name for one in candidates_of(load_spec(folder))]
    assert "Sentinel-1 IW GRDH, VV+VH" in names
    assert not [name for name in names if name.startswith(("BIOMASS", "ERS", "Seasat", "SMAP", "Envisat"))]
    assert "Sentinel-1 EW GRDM, VV+VH" not in names  # cells of 93 m, the factor ends at 60 m


DATED = """
[campaign]
name = "dated"
seed = 5
batch = 3
[[factor]]
name = "frequency"
levels = ["L", "L+C"]
[[factor]]
name = "dates"
values = [1, 2, 4]
[[factor]]
name = "interval_days"
low = 20.0
high = 40.0
[[application]]
name = "cover"
utility = "percent_correct"
[simulator]
engine = "psm"
scene = "scene.npz"
[simulator.fixed]
polarization = "HH+HV"
resolution = 20.0
bandwidth = 60.0
peak_power = 1000.0
depression_angle = 45.0
altitude_m = 4000.0
first_day = 330.0
[stop]
half_width = 20.0
max_runs = 24
[[candidate]]
sensor = "Sentinel-1 IW GRDH"
[[candidate]]
sensor = "RADARSAT-2 Standard SGF"
[[candidate]]
sensor = "UAVSAR L MLC"
"""


def test_dates_are_those_on_which_a_sensor_passes_and_a_set_is_taken_apart(tmp_path: Path, tiny_scene: Path) -> None:
    folder = make_tiny(tmp_path / "dated", tiny_scene, DATED)
    assert CliRunner().invoke(app, ["run", str(folder), "--max-runs", "24"]).exit_code in (0, 3)
    ok("candidates", folder, "--worlds", 4)
    rows = found(folder)
    (application,) = json.loads((folder / FILE).read_text(encoding="utf-8"))["applications"].values()
    best = application["settings"]
    days = [330.0 + k * best["interval_days"] for k in range(int(best["dates"]))]  # on over the new year
    assert days[-1] > 366.0
    sentinel, radarsat = rows["Sentinel-1 IW GRDH, VV+VH"], rows["RADARSAT-2 Standard SGF, HH+HV"]
    assert rows["UAVSAR L MLC, HH+HV+VV+phase"]["dates"] == {  # flies when asked
        "used": pytest.approx([day - 365.0 if day >= 366.0 else day for day in days]),
        "offered": None,
    }
    for row, repeat in ((sentinel, 6.0), (radarsat, 24.0)):
        used, offered = [day + 365.0 * (day < 330.0) for day in row["dates"]["used"]], row["dates"]["offered"]
        assert used[0] == 330.0 + repeat / 2
        assert all((day - used[0]) % repeat == pytest.approx(0.0) for day in used)
        assert len(used) == min(offered, 4)
        assert offered == 1 + max(int((days[-1] - used[0]) // repeat), 0)
    if best["frequency"] == "L+C":
        assert "frequency" in {one["property"] for one in radarsat["owed_to"]}


def test_a_radiometer_larger_than_the_fields_is_judged_by_its_footprint(tmp_path: Path, tiny_scene: Path) -> None:
    text = TINY.replace('"HH", "HH+HV"', '"H", "H+V"').replace('engine = "psm"', 'engine = "prm"')
    text = text.replace("peak_power = 1000.0\ndepression_angle = 45.0", "integration_time = 20.0\nscan_period = 1.0")
    text = text.replace("bandwidth = 60.0", "bandwidth = 60.0\nnoise_temperature = 400.0")
    text += '[[candidate]]\nsensor = "AMSR2 10.65"\n[[candidate]]\nsensor = "PALS"\n'
    folder = make_tiny(tmp_path / "passive", tiny_scene, text)
    assert CliRunner().invoke(app, ["run", str(folder), "--max-runs", "16"]).exit_code in (0, 3)
    ok("candidates", folder, "--worlds", 4)
    rows = found(folder)
    coarse, fine = rows["AMSR2 10.65 GHz, H+V"], rows["PALS L 1.413 GHz low, H+V"]
    # A round beam at 55 deg with the area of the published 42 by 24 km.
    assert coarse["places"][0]["footprint_m"] == pytest.approx([41.92e3, 24.05e3], rel=1e-3)
    assert coarse["places"][0]["incidence_deg"] == 55.0
    assert fine["places"][0]["incidence_deg"] == 40.0
    assert fine["places"][0]["cell_m"] == 490.0
    assert max(coarse["scene_km"]) < 24.0
    assert "scene_km" not in fine
    measured = json.loads((folder / FILE).read_text(encoding="utf-8"))
    told = " ".join(repr(Candidates(measured)).split())
    assert "footprint 41.9 by 24.0 km at 55 deg" in told
    assert "larger than the scene of" in told
    assert coarse["difference"] < -10.0
    assert "cell and looks" in {one["property"] for one in fine["owed_to"]}
    assert "angle" not in {one["property"] for one in fine["owed_to"]}
