"""A campaign of measured scores whose guard are confirmation flights: the program issues them, and then it stops."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from commands import document, seqrsm
from measured_campaign import X, make, quadratic

GUARD = 'guard = "confirmation"\nconfirmation_runs = 3\nmax_runs = 24\n[cost]\nflight = 7.5\n'  # no more than were made


@pytest.fixture
def campaign(tmp_path: Path) -> Path:
    """Nothing is missing of its rule but the confirmation."""
    rows = [{"x": row["x"], "score": row["score"]} for row in quadratic()]
    folder = make(tmp_path / "c", X, rows)
    file = folder / "campaign.toml"
    file.write_text(file.read_text(encoding="utf-8").replace("half_width = 3.0", "half_width = 9.0") + GUARD)
    return folder


def flown(folder: Path, runs: list[dict], mean: float, name: str) -> None:
    """The scores of ``runs``, about ``mean``."""
    with (folder / name).open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["run_id", "x", "score"])
        for run, away in zip(runs, (-1, 0, 1), strict=True):
            writer.writerow([run["run_id"], run["settings"]["x"], mean + away])
    document("ingest", folder, folder / name)


@pytest.mark.parametrize(("away", "held"), [(0.0, True), (-40.0, False)])
def test_confirmation_flights_are_issued_and_decide(campaign: Path, away: float, held: bool) -> None:
    before = document("fit", campaign)
    assert "Confirmation runs at the recommended settings are still to be made." in before["stop"]["reasons"]
    runs = document("propose", campaign, "-n", 1)
    best = before["optimum"]["settings"]["x"]
    assert [(run["purpose"], run["source"], run["state"]) for run in runs] == [("confirmation", "flight", "issued")] * 3
    np.testing.assert_allclose([run["settings"]["x"] for run in runs], best, rtol=1e-3)
    again = seqrsm("propose", campaign)  # one set is enough, and the budget of other runs is spent
    assert again.exit_code == 2
    line = 1 + (campaign / "campaign.toml").read_text(encoding="utf-8").splitlines().index("max_runs = 24")
    assert f"campaign.toml:{line}: the budget of 24 runs is spent" in again.stderr
    flown(campaign, runs, before["optimum"]["mean"] + away, "flights.csv")
    after, status = document("fit", campaign), document("status", campaign)
    assert after["n_runs"] == before["n_runs"]
    assert after["confirmation"]["agrees"] is held
    assert after["stop"]["held"] is status["held"] is held
    (known,) = status["applications"]
    assert known["last_look"]["reasons"] == after["stop"]["reasons"]
    assert seqrsm("propose", campaign).exit_code == 2


@pytest.mark.parametrize(("budget", "confirmation"), [(40, 0), (24, 3)])
def test_confirmation_waits_for_what_another_application_lacks(tmp_path: Path, budget: int, confirmation: int) -> None:
    """The flights of the other would enter the fit with those that follow; without a budget none follow."""
    rows = [
        {"x": row["x"], "score": row["score"], "application": name} for row in quadratic() for name in ("done", "wide")
    ]
    uses = (
        '[[application]]\nname = "done"\nutility = "measured"\n'
        '[[application]]\nname = "wide"\nutility = "measured"\nhalf_width = 0.1\n'
    )
    folder = make(tmp_path / "c", X, rows, application=uses)
    file, guard = folder / "campaign.toml", GUARD.replace("max_runs = 24", f"max_runs = {budget}")
    file.write_text(file.read_text(encoding="utf-8").replace("half_width = 3.0", "half_width = 9.0") + guard)
    runs = document("propose", folder, "-n", 2)
    confirming = [run["why"] for run in runs if run["purpose"] == "confirmation"]
    assert len(confirming) == confirmation
    assert len(runs) == (confirmation or 2)
    assert all("done" in why for why in confirming)
