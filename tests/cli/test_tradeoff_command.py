"""Trade-off, and simulation on a coarser data base, through the command line and the campaign."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from tiny_campaign import TINY, make_tiny
from typer.testing import CliRunner

from seqrsm.campaign import tradeoff
from seqrsm.campaign.campaign import Campaign
from seqrsm.campaign.tradeoff import COARSENED, FILE, read_tradeoff
from seqrsm.cli.app import app

WIDE = TINY.replace("low = 10.0", "low = 40.0").replace("high = 60.0", "high = 120.0")
"""Cells of 10 m, so that 4 to 12 of them lie along a side of a pixel."""

LOOSE = WIDE.replace('scene = "scene.npz"', 'scene = "scene.npz"\ntolerance = 50.0')


def call(*arguments: object) -> tuple[int, str, str]:
    found = CliRunner().invoke(app, [str(a) for a in arguments])
    return found.exit_code, found.stdout, found.stderr


def test_image_without_anything_to_do_is_refused(tiny: Path) -> None:
    code, _, err = call("image", tiny)
    assert code == 2
    assert "--out" in err


def test_a_tolerance_takes_the_coarsest_data_base_that_meets_it(tmp_path: Path, tiny_scene: Path) -> None:
    campaign = Campaign.open(make_tiny(tmp_path / "loose", tiny_scene, LOOSE))
    campaign.propose()
    runs = campaign.simulate()
    (event,) = campaign.store.events(kind=COARSENED)
    assert event.detail["cells"] == 2
    assert set(event.detail["rms_error"]) == {"8", "4", "2"}
    for run in runs:
        kept = run.scores[0].metadata["fidelity"]
        assert kept["averaged"] == (4 if run.settings["resolution"] >= 80.0 else 2)
        assert kept["seconds"] > 0.0
    assert len({run.scores[0].metadata["fidelity"]["averaged"] for run in runs}) == 2
    # What was measured once is measured no more.
    campaign.propose(1)
    campaign.simulate()
    assert len(campaign.store.events(kind=COARSENED)) == 1
    code, out, _ = call("status", campaign.folder)
    assert code == 0
    assert "2 x 2 cells averaged" in out


def test_a_tolerance_below_every_difference_keeps_the_data_base(tmp_path: Path, tiny_scene: Path) -> None:
    text = LOOSE.replace("tolerance = 50.0", "tolerance = 1e-9")
    campaign = Campaign.open(make_tiny(tmp_path / "tight", tiny_scene, text))
    campaign.propose()
    runs = campaign.simulate()
    (event,) = campaign.store.events(kind=COARSENED)
    assert event.detail["rms_error"]["2"] > event.detail["rms_error"]["8"] == 0.0
    assert {run.scores[0].metadata["fidelity"]["averaged"] for run in runs} == {1}


def test_tradeoff_measures_every_data_base_and_goes_on(
    tmp_path: Path, tiny_scene: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tradeoff, "CONFIGURATIONS", 3)
    monkeypatch.setattr(tradeoff, "OCCASIONS", 2)
    tiny = make_tiny(tmp_path / "wide", tiny_scene, WIDE)
    arguments = ("tradeoff", tiny, "--json")
    code, out, _ = call(*arguments)
    assert code == 0
    found = json.loads(out)
    rows = {row["cells"]: row for row in found["simulation"]["applications"]["cover"]}
    assert list(rows) == [0, 8, 4, 2]
    top = rows[0]
    assert (top["time_ratio"], top["bias"], top["rms_error"], top["utility_lost"]) == (1.0, 0.0, 0.0, 0.0)
    assert top["averaged"] == [1]
    for row in rows.values():  # the two columns of the table are one measurement
        assert row["time_ratio"] == pytest.approx(row["seconds"] / top["seconds"])
    assert set(rows[2]["averaged"]) <= {2, 4}
    assert rows[2]["largest_error"] >= rows[2]["rms_error"] > 0.0
    assert read_tradeoff(tiny)["simulation"] == found["simulation"]
    raw = json.loads((tiny / FILE).read_text())
    # An interruption after the first configuration: it is not measured again.
    raw["rows"], raw["simulation"] = raw["rows"][:1], None
    raw["rows"][0]["levels"]["0"]["seconds"] = [7.0, 7.0]
    (tiny / FILE).write_text(json.dumps(raw))
    assert read_tradeoff(tiny) is None
    code, _, _ = call(*arguments)
    assert code == 0
    after = json.loads((tiny / FILE).read_text())
    assert after["rows"][0]["levels"]["0"]["seconds"] == [7.0, 7.0]
    assert len(after["rows"]) == 3


def test_figures_of_a_coarser_data_base_by_hand() -> None:
    """Three configurations on two occasions; the coarser data base takes the third for the best, and not the second."""
    full, cheap = ((50, 52), (60, 64), (55, 53)), ((51, 53), (58, 60), (59, 61))
    seconds = {"0": ((2, 2, 9), (4, 3, 5), (6, 6, 6)), "8": ((1, 0, 1), (2, 2, 2), (3, 9, 2))}
    rows = [
        {
            "levels": {
                cells: {"averaged": 1, "scores": [{"cover": y} for y in of[k]], "seconds": seconds[cells][k]}
                for cells, of in (("0", full), ("8", cheap))
            }
        }
        for k in range(3)
    ]
    found = tradeoff._against_full(rows, 8, "cover", "maximize")
    assert (found["seconds"], found["time_ratio"]) == (2.0, 0.5)
    # Differences 1, 1; -2, -4; 4, 8: variances 0, 2 and 8, of a configuration's mean half of them.
    assert (found["bias"], found["bias_se"]) == pytest.approx((8 / 6, 5**0.5 / 3))
    assert (found["rms_error"], found["largest_error"]) == pytest.approx((17**0.5, 8.0))
    # By the full one the second's scores are better than the third's by 5 and 11.
    assert (found["utility_lost"], found["utility_lost_se"]) == pytest.approx((8.0, 3.0))
    assert found["rank_correlation"] == pytest.approx(0.5)
    assert tradeoff._against_full(rows, 8, "cover", "minimize")["utility_lost"] == 0.0


def test_tradeoff_without_a_simulator_says_so(tmp_path: Path) -> None:
    folder = tmp_path / "flevoland"
    assert call("init", folder, "--template", "flevoland")[0] == 0
    code, _, err = call("tradeoff", folder)
    assert code == 2
    assert "no simulator" in err
    assert err == call("run", folder)[2] == call("simulate", folder)[2]


def test_tradeoff_of_a_scene_that_cannot_be_read_says_so_once(tmp_path: Path, tiny_scene: Path) -> None:
    tiny = make_tiny(tmp_path / "wide", tiny_scene, WIDE)
    (tiny / "scene.npz").write_text("no scene", encoding="utf-8")
    code, out, err = call("tradeoff", tiny)
    assert (code, out) == (2, "")
    assert err.count("not a readable scene file") == 1
