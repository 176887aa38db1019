from __future__ import annotations

import numpy as np
import pytest

from seqrsm.design.classical import central_composite, full_factorial
from seqrsm.design.evaluate import prediction_variance
from seqrsm.design.factors import ContinuousFactor
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.errors import DesignError


def model(k: int) -> QuadraticModel:
    return QuadraticModel(tuple(ContinuousFactor(f"x{i}", -1.0, 1.0) for i in range(k)))


def sphere(k: int, radius: float) -> np.ndarray:
    points = np.random.default_rng(0).normal(size=(200, k))
    return radius * points / np.linalg.norm(points, axis=1)[:, None]


def test_factorial_holds_every_combination_once():
    points = full_factorial([2, 3, 4])
    assert points.shape == (24, 3)
    assert np.unique(points, axis=0).shape == (24, 3)
    assert points[:2].tolist() == [[-1.0, -1.0, -1.0], [1.0, -1.0, -1.0]]
    np.testing.assert_allclose(points.mean(axis=0), 0.0, atol=1e-16)


@pytest.mark.parametrize("k", [2, 3, 4, 5])
@pytest.mark.parametrize("axial", ["rotatable", "inscribed"])
def test_rotatable_designs_have_the_same_variance_on_spheres(k, axial):
    points = central_composite(k, axial)
    assert points.shape[0] == 2**k + 2 * k + 3
    for radius in (0.3, 1.0):
        variance = prediction_variance(model(k), points, sphere(k, radius))
        assert np.ptp(variance) < 1e-10 * variance.mean()
    if axial == "inscribed":
        assert np.max(np.abs(points)) == 1.0
    assert np.ptp(prediction_variance(model(k), central_composite(k, "face"), sphere(k, 1.0))) > 0.1


@pytest.mark.parametrize("make", [lambda: full_factorial([2] * 30), lambda: central_composite(1)])
def test_impossible_designs_are_refused(make):
    with pytest.raises(DesignError):
        make()
