"""The decision on lack of fit, on simulated data sets; in full by tests/studies/statistics_study.py."""

from __future__ import annotations

import numpy as np
import pytest
from lack_of_fit_cases import case, rates

from seqrsm.decide.discrepancy import find_discrepancy

SETS = 300


def error(p: float) -> float:
    """Four standard errors of a share."""
    return 4.0 * float(np.sqrt(p * (1.0 - p) / SETS))


def test_right_quadratics_pass_and_are_covered() -> None:
    found = rates(2, SETS)
    assert found.blocked < 0.05 + error(0.05)
    assert found.excused < 0.02 + error(0.02)
    assert found.one_run == pytest.approx(0.95, abs=error(0.95))
    assert found.mean_of_five == pytest.approx(0.95, abs=error(0.95))


def test_noise_that_is_smaller_at_the_repeats_seldom_blocks() -> None:
    found = rates(3, SETS, ratio=0.4)
    assert found.pure_error > 0.336 - error(0.336)  # what the test alone would block
    assert found.blocked < 0.236 + error(0.236)
    assert found.one_run > 0.97  # wide beside the noise at the optimum: the error is on the safe side


def test_wrong_quadratics_are_seen() -> None:
    found = rates(2, SETS, departure="peak", size=1.0)
    assert found.blocked > 0.96 - error(0.96)
    assert found.pure_error < 0.8  # the test alone sees fewer
    assert found.excused < 0.02


def test_unequal_noise_is_found_and_equal_noise_is_not() -> None:
    model, _, points = case(3)
    rng = np.random.default_rng(4)
    mean = 70.0 - 6.0 * np.sum((points - 0.25) ** 2, axis=1)
    slope = 1.5 * (mean.max() - mean) / np.ptp(mean)
    found = [
        [
            find_discrepancy(model, points, model.matrix(points), mean + noise * rng.standard_normal(len(points)))
            for _ in range(100)
        ]
        for noise in (np.ones(len(points)), np.exp(slope))
    ]
    share = [np.mean([one.noise_evidence > 2.7 for one in each]) for each in found]
    assert share[0] < 0.13
    assert share[1] > 0.4
    assert np.mean([one.noise_slope for one in found[1]]) > 1.5
    flipped = find_discrepancy(model, points, model.matrix(points), -mean, goal="minimize")
    straight = find_discrepancy(model, points, model.matrix(points), mean)
    assert flipped.noise_slope == straight.noise_slope
