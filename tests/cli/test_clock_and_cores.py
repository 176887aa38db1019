"""A clock that jumps, and a machine of one core: the same campaign, no score lost or doubled."""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from tiny_campaign import make_tiny
from typer.testing import CliRunner

from seqrsm.campaign.campaign import Campaign
from seqrsm.cli.app import app
from seqrsm.store import database, ledger, store, take_in


def scores(folder: Path) -> list[tuple[int, str, float]]:
    return [
        (run.run_id, json.dumps(run.settings), s.score)
        for run in Campaign.open(folder).store.runs()
        for s in run.scores
    ]


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory, tiny_scene: Path) -> list[tuple[int, str, float]]:
    folder = make_tiny(tmp_path_factory.mktemp("plain") / "c", tiny_scene)
    assert CliRunner().invoke(app, ["run", str(folder), "--max-runs", "16"]).exit_code in (0, 3)
    return scores(folder)


def test_a_clock_that_jumps_back_and_forth_changes_no_result(tmp_path, tiny_scene, monkeypatch, undisturbed) -> None:
    """Every fifth reading lies two hours back, every seventh a day ahead."""
    read = 0

    def jumping(ago_s: float = 0.0) -> str:
        nonlocal read
        read += 1
        hours = -2.0 if read % 5 == 0 else 24.0 if read % 7 == 0 else 0.0
        told = datetime.now(UTC) + timedelta(hours=hours, seconds=-ago_s)
        return told.isoformat(timespec="microseconds").replace("+00:00", "Z")

    for module in (database, ledger, store, take_in):
        monkeypatch.setattr(module, "utc_now", jumping)
    folder = make_tiny(tmp_path / "c", tiny_scene)
    assert CliRunner().invoke(app, ["run", str(folder), "--max-runs", "16"]).exit_code in (0, 3)
    assert read > 50
    assert scores(folder) == undisturbed
    told = CliRunner().invoke(app, ["status", str(folder), "--history"])  # verifies the chain of events
    assert told.exit_code == 0


def test_a_run_whose_lease_seems_over_is_scored_once(tmp_path, tiny_scene, monkeypatch) -> None:
    """The clock jumps a day ahead while another host carries runs out: they are made again, and counted once."""
    folder = make_tiny(tmp_path / "c", tiny_scene)
    mine = Campaign.open(folder)
    mine.propose(3)
    monkeypatch.setattr(store, "_this_process", lambda: "another-host:1:0")
    (first, *_) = held = mine.store.claim()
    monkeypatch.undo()
    made = score_of(mine, first.run_id)
    assert mine.store.release_stale() == ()
    monkeypatch.setattr(store, "LEASE_S", -86_400.0)
    assert mine.store.release_stale() == tuple(run.run_id for run in held)
    (again, *_) = mine.store.claim()
    assert again.run_id == first.run_id
    assert mine.store.record_scores(first.run_id, made)
    assert not mine.store.record_scores(first.run_id, made)  # the other host comes back
    assert len(Campaign.open(folder).store.runs("scored")) == 1


def score_of(campaign: Campaign, run_id: int):
    from seqrsm.campaign.simulation import carry_out, task_of

    (run,) = (run for run in campaign.store.runs() if run.run_id == run_id)
    return carry_out(task_of(campaign.spec, run_id, run.settings)).scores


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="cores cannot be taken away here")
@pytest.mark.parametrize("workers", ["1", "2"])
def test_one_core_gives_the_same_campaign(tmp_path, tiny_scene, undisturbed, workers) -> None:
    folder = make_tiny(tmp_path / "c", tiny_scene)
    command = [sys.executable, "-m", "seqrsm", "run", str(folder), "--max-runs", "16", "--workers", workers]
    one = min(os.sched_getaffinity(0))
    done = subprocess.run(command, preexec_fn=lambda: os.sched_setaffinity(0, {one}), capture_output=True, timeout=240)
    assert done.returncode in (0, 3), done.stderr
    assert scores(folder) == undisturbed


FACTORS = "".join(f'[[factor]]\nname = "{name}"\nlow = -1.0\nhigh = 1.0\n' for name in "abc")
CURVED = f"""\
[campaign]
name = "curved"
seed = 5
{FACTORS}[[factor]]
name = "polarization"
levels = ["HH", "HH+HV"]
[[application]]
name = "a"
utility = "measured"
goal = "maximize"
[stop]
half_width = 0.001
max_runs = 40
"""
CAMPAIGN = """\
import json, sys
from pathlib import Path
import numpy as np
from seqrsm.campaign.rehearsal import make_campaign
from seqrsm.spec.read import load_spec
from seqrsm.store.records import NewScore
rng = np.random.default_rng(3)
def score(at):
    fall = 40.0 / (1.0 + np.exp(-12.0 * (at[:, 0] - 0.3)))
    mean = 80.0 - 6.0 * at[:, 0] ** 2 - 9.0 * (at[:, 1] - at[:, 0]) ** 2 + 3.0 * at[:, 3] - fall
    return [NewScore("a", float(y)) for y in mean + 2.0 * rng.standard_normal(len(at))]
analysis, runs = make_campaign(load_spec(Path(sys.argv[1])), "flight", score, n_draws=50)
print(json.dumps([run.settings for run in runs]), analysis.fitted.departure.probability)
"""


@pytest.mark.skipif(platform.machine() != "x86_64", reason="the other processor is an older one of this kind")
def test_another_processor_gives_the_same_campaign(tmp_path) -> None:
    """Matrix products are then summed in another order, and exponentials are another program's.

    The last digits led to another of equal designs, and into another peak of the process's posterior: shipped campaigns
    ended at 44 to 112 runs.
    """
    (tmp_path / "campaign.toml").write_text(CURVED, encoding="utf-8")
    (tmp_path / "make.py").write_text(CAMPAIGN, encoding="utf-8")
    older = {"OPENBLAS_CORETYPE": "Prescott", "NPY_DISABLE_CPU_FEATURES": "AVX2 FMA3 AVX512F AVX512_SKX"}
    found = []
    for env in ({}, older):
        command = [sys.executable, "-W", "ignore", str(tmp_path / "make.py"), str(tmp_path)]
        done = subprocess.run(command, env={**os.environ, **env}, capture_output=True, text=True, timeout=240)
        assert done.returncode == 0, done.stderr
        settings, probability = done.stdout.rsplit(maxsplit=1)
        found.append(settings)
        assert float(probability) > 0.5
    assert found[0] == found[1]
