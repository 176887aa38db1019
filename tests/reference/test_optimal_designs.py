"""Optimal designs against the best known (tests/reference/data/optimal_designs.README.md)."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from short_search import optimal_design

from seqrsm.design.evaluate import continuous_bound, evaluate_design
from seqrsm.design.factors import CategoricalFactor, ContinuousFactor
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region

DATA = Path(__file__).parent / "data"
with (DATA / "optimal_designs.csv").open() as _file:
    TABLE = list(csv.DictReader(_file))
GOLDEN = json.loads((DATA / "optimal_designs_golden.json").read_text())
WITHIN = 0.005
"""Share of the best known value that a search may miss: which optimum it ends in, rounding may decide."""
NUMERIC = [row for row in TABLE if not row["categorical_levels"]]


def build(k: int, levels: int = 0) -> tuple[QuadraticModel, Region]:
    factors: list = [ContinuousFactor(f"x{i}", -1.0, 1.0) for i in range(k)]
    if levels:
        factors.append(CategoricalFactor("c", tuple("ABC"[:levels])))
    return QuadraticModel(tuple(factors)), Region(tuple(factors))


def direct(points: np.ndarray) -> np.ndarray:
    """Model rows written out anew: intercept, linear, products, squares."""
    n, k = points.shape
    pairs = [points[:, i] * points[:, j] for i in range(k) for j in range(i, k)]
    return np.column_stack([np.ones(n), points, *pairs])


# Saturated designs, some a little larger, and some of twice as many runs: their neighbours are alike.
SOME = {"1": "3 4 7 10 13", "2": "6 7 9 12 16 26", "3": "10 11 14 17 20 30", "4": "18 25"}
CASES = [
    pytest.param(row, id=f"k{row['k']}N{row['N']}") for row in NUMERIC if row["N"] in SOME.get(row["k"], "").split()
]


@pytest.mark.parametrize("row", CASES)
def test_d_optimal_designs_come_close_to_the_best_known(row):
    k, n, p = (int(row[key]) for key in ("k", "N", "p"))
    design = optimal_design(*build(k), n, "D", seed=1)
    report = evaluate_design(*build(k), design.points)
    # From the points alone, by another route than the package's.
    Z = direct(design.points)
    value = np.exp(np.linalg.slogdet(Z.T @ Z)[1] / p) / n
    assert np.max(np.abs(design.points)) <= 1.0
    assert value >= float(row["D_best"]) * (1.0 - WITHIN)
    assert value <= float(row["D_continuous"]) * (1.0 + 1e-9)
    assert report.d_value == pytest.approx(value, rel=1e-10)
    assert report.d_efficiency == pytest.approx(value / float(row["D_continuous"]), rel=1e-8)


def cube_moments(k: int) -> np.ndarray:
    """Moments of the cube by Gauss-Legendre quadrature in the order of ``direct``."""
    nodes, weights = np.polynomial.legendre.leggauss(4)
    points = np.stack([m.ravel() for m in np.meshgrid(*[nodes] * k, indexing="ij")], axis=1)
    mass = np.prod(np.stack([m.ravel() for m in np.meshgrid(*[weights / 2] * k, indexing="ij")], axis=1), axis=1)
    Z = direct(points)
    return Z.T @ (Z * mass[:, None])


@pytest.mark.parametrize("row", CASES)
def test_i_optimal_designs_come_close_to_the_best_known(row):
    k, n = int(row["k"]), int(row["N"])
    design = optimal_design(*build(k), n, "I", seed=1)
    report = evaluate_design(*build(k), design.points)
    Z = direct(design.points)
    value = n * float(np.trace(np.linalg.solve(Z.T @ Z, cube_moments(k))))
    assert value <= float(row["N_I_best"]) * (1.0 + WITHIN)
    assert value >= float(row["N_I_continuous"]) * (1.0 - 1e-9)
    assert report.i_value == pytest.approx(value, rel=1e-9)
    assert report.i_efficiency == pytest.approx(float(row["N_I_continuous"]) / value, rel=1e-8)


@pytest.mark.parametrize("k", [5, 6])
def test_more_factors_come_close_in_a_short_search(k):
    row = next(r for r in NUMERIC if int(r["k"]) == k)
    design = optimal_design(*build(k), int(row["N"]), "D", seed=3, starts=100)
    assert evaluate_design(*build(k), design.points).d_value >= 0.98 * float(row["D_best"])


@pytest.mark.parametrize(
    "row",
    [
        pytest.param(row, id=f"k{row['k']}L{row['categorical_levels']}N{row['N']}")
        for row in TABLE
        if row["categorical_levels"] and int(row["k"]) <= 3
    ],
)
def test_designs_with_a_category_come_close_to_the_best_known(row):
    built = build(int(row["k"]), int(row["categorical_levels"]))
    design = optimal_design(*built, int(row["N"]), seed=1, starts=100)
    assert evaluate_design(*built, design.points).d_value >= float(row["D_best"]) * (1.0 - WITHIN)


def base_points(case) -> np.ndarray:
    k = case["k"]
    cube = np.array(np.meshgrid(*[[-1.0, 1.0]] * k, indexing="ij")).reshape(k, -1).T
    if "(3-1)" in case["base"]:
        cube = cube[np.prod(cube, axis=1) == 1.0]
    return np.vstack([cube, np.zeros((case["n_base"] - cube.shape[0], k))])


@pytest.mark.parametrize("case", GOLDEN["augment"][::2], ids=lambda c: f"{c['base']}+{c['n_add']}".replace(" ", ""))
def test_augmented_designs_come_close_to_the_best_known(case):
    base = base_points(case)
    design = optimal_design(*build(case["k"]), case["n_add"], seed=4, fixed=base)
    Z = direct(np.vstack([base, design.points]))
    assert np.linalg.slogdet(Z.T @ Z)[1] >= case["logdet"] - Z.shape[1] * WITHIN
    assert design.points.shape == (case["n_add"], case["k"])


def test_continuous_bounds_are_those_of_the_table():
    for entry in json.loads((DATA / "optimal_designs_continuous.json").read_text()):
        model, _ = build(entry["k"])
        assert continuous_bound(model, entry["crit"]) == pytest.approx(entry["value"], rel=2e-9)
