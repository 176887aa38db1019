from __future__ import annotations

import numpy as np
import pytest

from seqrsm.design.classical import (
    box_behnken,
    central_composite,
    full_factorial,
    latin_hypercube,
    minimum_aberration,
    sobol,
)
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


# Word-length patterns (words of length 3, 4, ...) of minimum-aberration fractions: Fries & Hunter (1980), Technometrics
# 22, 601-608, and Chen, Sun & Wu (1993), Int. Stat. Review 61, 131-145, tables of 8-, 16-, 32- and 64-run designs.
FRACTIONS = {
    (3, 4): (1,), (4, 8): (0, 1), (5, 8): (2, 1, 0), (5, 16): (0, 0, 1), (6, 8): (4, 3, 0, 0), (6, 16): (0, 3, 0, 0),
    (6, 32): (0, 0, 0, 1), (7, 8): (7, 7, 0, 0, 1), (7, 16): (0, 7, 0, 0, 0), (7, 32): (0, 1, 2, 0, 0),
    (7, 64): (0, 0, 0, 0, 1), (8, 16): (0, 14, 0, 0, 0, 1), (8, 32): (0, 3, 4, 0, 0, 0), (8, 64): (0, 0, 2, 1, 0, 0),
}  # fmt: skip


@pytest.mark.parametrize(("k", "runs"), FRACTIONS)
def test_fractions_have_minimum_aberration(k, runs):
    points, words = minimum_aberration(k, runs)
    assert points.shape == (runs, k)
    np.testing.assert_array_equal(points.T @ points, runs * np.eye(k))
    lengths = [len(word) for word in words]
    pattern = FRACTIONS[k, runs]
    assert [lengths.count(3 + i) for i in range(len(pattern))] == list(pattern)
    assert len(words) == 2 ** (k - int(np.log2(runs))) - 1 == sum(pattern)
    for word in words:
        np.testing.assert_array_equal(np.prod(points[:, list(word)], axis=1), 1.0)


def interactions(points):
    k = points.shape[1]
    return [points[:, i] * points[:, j] for i in range(k) for j in range(i + 1, k)]


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


@pytest.mark.parametrize(("k", "edge", "total"), [(3, 12, 15), (4, 24, 27), (5, 40, 46), (6, 48, 54), (7, 56, 62)])
def test_box_behnken_counts_and_balance(k, edge, total):
    points = box_behnken(k)
    assert points.shape == (total, k)
    assert box_behnken(k, 1).shape == (edge + 1, k)
    assert np.all(np.isin(points, (-1.0, 0.0, 1.0)))
    Z = model(k).matrix(points)
    moment = Z.T @ Z
    # Linear terms and products are orthogonal to everything; every factor is moved equally often.
    free = [i for i, term in enumerate(model(k).terms) if term.kind in ("linear", "interaction")]
    block = moment[np.ix_(free, range(moment.shape[0]))].copy()
    block[np.arange(len(free)), free] = 0.0
    np.testing.assert_array_equal(block, 0.0)
    assert len(set(np.sum(points**2, axis=0))) == 1
    assert np.linalg.matrix_rank(Z) == Z.shape[1]


@pytest.mark.parametrize("k", [4, 7])
def test_box_behnken_of_four_and_seven_factors_is_rotatable(k):
    variance = prediction_variance(model(k), box_behnken(k), sphere(k, 1.0))
    assert np.ptp(variance) < 1e-10 * variance.mean()


@pytest.mark.parametrize("centred", [False, True])
def test_latin_hypercube_has_one_point_in_each_interval(centred):
    points = latin_hypercube(17, 4, seed=3, centred=centred)
    cells = np.floor((points + 1.0) / 2.0 * 17).astype(int)
    np.testing.assert_array_equal(np.sort(cells, axis=0), np.tile(np.arange(17)[:, None], (1, 4)))
    np.testing.assert_array_equal(points, latin_hypercube(17, 4, seed=3, centred=centred))
    assert not np.array_equal(points, latin_hypercube(17, 4, seed=4, centred=centred))


@pytest.mark.parametrize("seed", [None, 1])
def test_sobol_has_one_point_in_each_interval(seed):
    points = sobol(64, 3, seed)
    cells = np.floor((points + 1.0) / 2.0 * 64).astype(int)
    np.testing.assert_array_equal(np.sort(cells, axis=0), np.tile(np.arange(64)[:, None], (1, 3)))
    assert sobol(50, 3, seed).tolist() == points[:50].tolist()


@pytest.mark.parametrize(
    "make",
    [
        lambda: full_factorial([]),
        lambda: full_factorial([1, 2]),
        lambda: full_factorial([2] * 30),
        lambda: central_composite(1),
        lambda: central_composite(3, "oblique"),
        lambda: box_behnken(2),
        lambda: box_behnken(3, -1),
        lambda: latin_hypercube(0, 2, 1),
        lambda: sobol(4, 0),
    ],
)
def test_impossible_designs_are_refused(make):
    with pytest.raises(DesignError):
        make()
