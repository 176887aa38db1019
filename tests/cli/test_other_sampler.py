"""Who drew the posterior is told where it is not the sampler that was asked for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from measured_campaign import FREQUENCY, MEASURED, X, days, make, quadratic

from seqrsm.campaign.campaign import Campaign
from seqrsm.errors import ConvergenceError

BLOCKED, _ = days(24, 2.0, 2)
FLOWN = [row | {"source": ("simulation", "flight", "simulation")[i % 3]} for i, row in enumerate(quadratic(24, 1))]
THROUGH = [
    {"x": 5 + 5 * a, "frequency": 4.0 * 4.0**b, "score": 70 - a * a - b * b}
    for a, b in np.random.default_rng(0).uniform(-1, 1, (6, 2)).tolist()
]
STUDENT = '[model]\nerrors = "student_t"\n'


def drawn(folder: Path, rows: list[dict], model: str, sampler: str) -> tuple[str, list[str]]:
    campaign = Campaign.open(make(folder, X + FREQUENCY, rows, model, MEASURED))
    (analysis,) = campaign.analyse_all(sampler=sampler)
    campaign.store.close()
    assert "emcee" not in " ".join(analysis.warnings)
    return analysis.posterior.sampler["method"], [one for one in analysis.notes if "emcee" in one]


@pytest.mark.parametrize(
    ("rows", "model", "reason"),
    [
        (BLOCKED, '[model]\nblock = "block"\nblock_effect = "random"\n', "known with random blocks"),
        (FLOWN, "", "known with simulations and flights"),
        (THROUGH, "", "passes through every score"),
    ],
)
def test_exact_draws_instead_of_emcee_are_told_once(rows, model, reason, tmp_path) -> None:
    method, told = drawn(tmp_path / "asked", rows, model, "emcee")
    assert method == "exact"
    assert len(told) == 1
    assert reason in told[0]
    assert drawn(tmp_path / "not", rows, model, "exact") == ("exact", [])


@pytest.mark.parametrize(
    ("model", "method", "how"), [("", "exact", "exactly"), (STUDENT, "gibbs", "by Gibbs sampling")]
)
def test_other_draws_where_emcee_does_not_converge_are_told(model, method, how, tmp_path, monkeypatch) -> None:
    def never(*_args, **_more):
        raise ConvergenceError("no")

    monkeypatch.setattr("seqrsm.fit.ensemble.sample", never)
    found, told = drawn(tmp_path / "c", quadratic(), model, "emcee")
    assert found == method
    assert told == [f"The posterior was drawn {how} because emcee did not converge."]


@pytest.mark.parametrize("model", ["", STUDENT])
def test_nothing_is_told_where_emcee_was_asked_for_and_drew(model, tmp_path) -> None:
    assert drawn(tmp_path / "c", quadratic(), model, "emcee") == ("emcee", [])


def test_gibbs_draws_that_were_asked_for_need_no_word(tmp_path) -> None:
    assert drawn(tmp_path / "c", quadratic(), STUDENT, "exact") == ("gibbs", [])
