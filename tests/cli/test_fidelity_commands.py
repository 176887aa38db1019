"""Explain, trade-off and the online check of the fidelity planner through the command line and the campaign."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from tiny_campaign import TINY, make_tiny
from typer.testing import CliRunner

from seqrsm.campaign.campaign import Campaign
from seqrsm.campaign.fidelity_watch import VIOLATED, fidelity_of, violation, widening_of
from seqrsm.campaign.simulation import FidelityCheck
from seqrsm.campaign.tradeoff import FILE, read_tradeoff
from seqrsm.cli.app import app
from seqrsm.scene.file import save_scene
from seqrsm.scene.synthetic import synthetic_scene

LOOSE = TINY.replace('scene = "scene.npz"', 'scene = "scene.npz"\ntolerance = 12.0')


def call(*arguments: object) -> tuple[int, str, str]:
    found = CliRunner().invoke(app, [str(a) for a in arguments])
    return found.exit_code, found.stdout, found.stderr


def test_explain_gives_a_verdict_on_every_effect(tiny: Path) -> None:
    code, out, _ = call("image", tiny, "--explain", "--set", "resolution=40", "--json")
    assert code == 0
    plan = json.loads(out)["fidelity"]
    assert plan["settings"]["resolution"] == 40.0
    assert [rung["rung"] for rung in plan["rungs"]] == ["F0", "F1", "F2", "F3", "F4"]
    assert {effect["verdict"] for effect in plan["effects"]} <= {"exact", "bounded", "needed"}
    # One verdict for every row of table 4.1 that a side-looking radar has.
    assert {e["name"] for e in plan["effects"]} == {
        "cast shadow", "layover", "local incidence", "own range and angle of raised ground", "detail below some cells",
        "ground between the strips", "one draw of fading", "fading", "a normal law for fading",
        "shape of the azimuth beam", "several categories in a pixel", "range and gain over the swath", "receiver noise",
        "atmosphere over the swath", "curvature of the Earth", "azimuth beam wider than a cell", "quantisation",
        "cultural targets", "double precision",
    }  # fmt: skip
    chosen = next(rung for rung in plan["rungs"] if rung["rung"] == plan["rung"])
    assert not chosen["refused"]
    assert chosen["bound"] <= plan["tolerance"] == 0.5
    code, out, _ = call("image", tiny, "--explain", "--set", "resolution=40")
    assert code == 0
    assert "resolution 40 m" in out.splitlines()[0]
    assert {"cast shadow", "quantisation", "needed"} <= {part.strip() for part in re.split(r"\s{2,}|\n", out)}


def test_image_without_anything_to_do_is_refused(tiny: Path) -> None:
    code, _, err = call("image", tiny)
    assert code == 2
    assert "--out" in err


def test_a_rung_that_cannot_be_used_is_refused(tmp_path: Path, tiny_scene: Path) -> None:
    text = TINY.replace('scene = "scene.npz"', 'scene = "scene.npz"\nfidelity = "F0"').replace(
        "altitude_m = 4000.0", 'altitude_m = 4000.0\nrange_format = "slant"'
    )
    folder = make_tiny(tmp_path / "forced", tiny_scene, text)
    code, _, err = call("run", folder)
    assert code == 2
    assert "slant range" in err


def test_every_score_keeps_rung_bound_and_seconds(tmp_path: Path, tiny_scene: Path) -> None:
    campaign = Campaign.open(make_tiny(tmp_path / "loose", tiny_scene, LOOSE))
    campaign.propose()
    runs = campaign.simulate()
    rungs = {fidelity_of(run)["rung"] for run in runs}
    assert rungs <= {"F0", "F1", "F2", "F3", "F4"}
    code, out, _ = call("status", campaign.folder, "--json")
    assert code == 0
    found = json.loads(out)["simulated_by"]
    assert sum(row["runs"] for row in found["rungs"].values()) == len(runs)
    for rung, row in found["rungs"].items():
        own = [fidelity_of(run) for run in runs if fidelity_of(run)["rung"] == rung]
        assert row["bound"] == max(kept["bound"] for kept in own)
        assert row["seconds"] > 0.0
        assert set(row["left_out"]) == {name for kept in own for name in kept["left_out"]}
    code, out, _ = call("status", campaign.folder)
    assert code == 0
    assert "simulated by" in out
    assert call("export", campaign.folder, tmp_path / "all.csv")[0] == 0
    assert '""rung"": ' in (tmp_path / "all.csv").read_text(encoding="utf-8")
    for run in runs:
        kept = fidelity_of(run)
        assert 0.0 <= kept["bound"] <= 12.0
        assert kept["seconds"] > 0.0
        assert isinstance(kept["left_out"], list)


def test_a_violated_bound_sends_runs_to_a_safer_rung(tmp_path: Path) -> None:
    # Large enough that strips save time.
    scene = synthetic_scene(
        320, 400, 5.0, categories=("Grass", "Trees", "Bareground"), field_m=80.0, relief_m=20.0, seed=3
    )
    save_scene(scene, tmp_path / "wide.npz")
    campaign = Campaign.open(make_tiny(tmp_path / "watched", tmp_path / "wide.npz", LOOSE))
    campaign.propose()
    runs = campaign.simulate()
    cheap = [run for run in runs if fidelity_of(run)["rung"] != "F4"]
    assert cheap, "the tolerance must let some run take a cheaper rung"
    rung = fidelity_of(cheap[0])["rung"]
    concerned = [run for run in cheap if fidelity_of(run)["rung"] == rung and fidelity_of(run)["bound"] * 30.0 > 12.0]
    check = FidelityCheck(rung, "F4", "cover", 30.0, 1.0)
    assert check.violated
    campaign.store.add_event(VIOLATED, violation(check, {}), cheap[0].run_id)
    assert widening_of(campaign.store.events())[rung] == pytest.approx(30.0)
    again = campaign.simulate()
    assert {run.replaces for run in again} == {run.run_id for run in concerned}
    after = {run.run_id: run for run in campaign.store.runs()}
    for run in again:
        old = after[run.replaces]
        assert old.state == "void"
        assert (run.settings, run.purpose, run.batch) == (old.settings, old.purpose, old.batch)
        assert fidelity_of(run)["rung"] != rung or fidelity_of(run)["bound"] <= 12.0
    assert campaign.simulate() == ()


def test_a_difference_within_the_limit_is_no_violation() -> None:
    assert not FidelityCheck("F0", "F2", "cover", -0.9, 1.0).violated
    assert FidelityCheck("F0", "F2", "cover", -1.1, 1.0).violated


def test_tradeoff_measures_every_rung_and_goes_on(tiny: Path) -> None:
    arguments = ("tradeoff", tiny, "--configurations", 3, "--occasions", 2, "--no-numerics", "--json")
    code, out, _ = call(*arguments)
    assert code == 0
    found = json.loads(out)
    rows = {row["rung"]: row for row in found["simulation"]["applications"]["cover"]}
    assert {"F2", "F3", "F4", "auto"} <= set(rows)
    top = rows["F4"]
    assert (top["time_ratio"], top["bias"], top["rms_error"], top["utility_lost"]) == (1.0, 0.0, 0.0, 0.0)
    assert rows["F3"]["largest_error"] >= rows["F3"]["rms_error"] > 0.0
    assert read_tradeoff(tiny)["simulation"] == found["simulation"]
    raw = json.loads((tiny / FILE).read_text())
    # An interruption after the first configuration: it is not measured again.
    raw["rows"], raw["simulation"] = raw["rows"][:1], None
    raw["rows"][0]["rungs"]["F4"]["seconds"] = [7.0, 7.0]
    (tiny / FILE).write_text(json.dumps(raw))
    assert read_tradeoff(tiny) is None
    code, _, _ = call(*arguments)
    assert code == 0
    after = json.loads((tiny / FILE).read_text())
    assert after["rows"][0]["rungs"]["F4"]["seconds"] == [7.0, 7.0]
    assert len(after["rows"]) == 3


def test_tradeoff_without_a_simulator_says_so(tmp_path: Path) -> None:
    folder = tmp_path / "flevoland"
    assert call("init", folder, "--template", "flevoland")[0] == 0
    code, out, _ = call("tradeoff", folder, "--no-numerics")
    assert code == 0
    assert "no simulator" in out


def test_explain_of_a_turning_antenna_says_why_all_is_simulated(tmp_path: Path, tiny_scene: Path) -> None:
    text = TINY.replace("altitude_m = 4000.0", 'altitude_m = 4000.0\nscan = "ppi"\naperture = "real"')
    code, out, _ = call("image", make_tiny(tmp_path / "ppi", tiny_scene, text), "--explain", "--json")
    assert code == 0
    plan = json.loads(out)["fidelity"]
    assert plan["rung"] == "F4"
    assert [effect["name"] for effect in plan["effects"]] == ["turning antenna"]
    assert "antenna turns" in plan["why"]
