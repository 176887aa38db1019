"""Runs that repeat executed settings have these settings to the last digit, however many digits they have."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from measured_campaign import FREQUENCY, MEASURED, POL, X, days, make, quadratic

from seqrsm.campaign.campaign import Campaign
from seqrsm.campaign.next_runs import next_batch
from seqrsm.store.records import NewRun

NAMES = ("x", "frequency")


def proposed(folder: Path, n: int, source: str) -> list[NewRun]:
    campaign = Campaign.open(folder)
    found = next_batch(campaign.spec, campaign.analyse_all(n_draws=500), campaign.store.runs(), n, source)
    campaign.store.close()
    return found


def apart(n: int = 24) -> list[dict]:
    """No setting twice, and settings of many digits right at the best ones."""
    rows = quadratic(n)
    near = np.random.default_rng(7).normal(scale=0.02, size=(n, 2))
    for i in range(0, n, 3):
        rows[i]["x"], rows[i]["frequency"] = 6.0 + 5 * near[i, 0], 4.0 * 4.0 ** (-0.1 + near[i, 1])
    return rows


CASES = {
    "a process": (X + FREQUENCY, apart(), "", "flight"),
    "a first-order model": (X + FREQUENCY, apart(), "[model]\norder = 1\n", "simulation"),
    "a category": (
        X + FREQUENCY + POL,
        [row | {"pol": ("HH", "VV")[i % 2]} for i, row in enumerate(apart())],
        "[model]\norder = 1\n",
        "simulation",
    ),
    "a new day": (X + FREQUENCY, days(24, 2.0, 2)[0], '[model]\nblock = "block"\n', "flight"),
    "either source": (
        X + FREQUENCY,
        [row | {"source": ("simulation", "flight")[i % 2]} for i, row in enumerate(quadratic())],
        "[cost]\nflight = 3.0\n",
        "best",
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_a_repeat_has_the_settings_of_the_run_to_the_last_digit(case: str, tmp_path: Path) -> None:
    factors, rows, more, source = CASES[case]
    folder = make(tmp_path / "c", factors, rows, more, MEASURED)
    runs = proposed(folder, 12, source)
    repeats = [run for run in runs if "repeats settings run or proposed before" in run.why]
    assert repeats
    names = [name for name in (*NAMES, "pol") if name in rows[0]]
    made = {tuple(row[name] for name in names) for row in rows}
    in_batch = [tuple(run.settings[name] for name in names) for run in runs]
    for run in repeats:
        here = tuple(run.settings[name] for name in names)
        assert here in made or in_batch.count(here) > 1, here
    if case == "a new day":  # the others repeat what they have just proposed
        assert any(here in made for here in in_batch)
    others = [run for run in runs if run not in repeats]
    assert all(len(f"{run.settings['x']:.15g}".lstrip("0.").replace(".", "")) <= 4 for run in others)


def test_pure_error_gets_what_a_repeat_promises(tmp_path: Path) -> None:
    """Scores of the repeats, taken in, are pure error: as many degrees of freedom as there are repeats."""
    rows = apart()
    folder = make(tmp_path / "c", X + FREQUENCY, rows, "[model]\norder = 1\n", MEASURED)
    campaign = Campaign.open(folder)
    (before,) = campaign.analyse_all(n_draws=200)
    batch = next_batch(campaign.spec, [before], campaign.store.runs(), 8, "simulation")
    campaign.store.close()
    repeats = sum("repeats settings run or proposed before" in run.why for run in batch)
    assert repeats > 0
    rng = np.random.default_rng(1)
    again = [{name: run.settings[name] for name in NAMES} | {"score": round(70 + rng.normal(), 3)} for run in batch]
    both = make(tmp_path / "both", X + FREQUENCY, rows + again, "[model]\norder = 1\n", MEASURED)
    (after,) = Campaign.open(both).analyse_all(n_draws=200)
    assert after.fit.df_pure_error >= before.fit.df_pure_error + repeats
