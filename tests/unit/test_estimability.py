"""Runs that make aliased terms estimable: smallest in number, and they do."""

from __future__ import annotations

import numpy as np
import pytest

from seqrsm.design.constraints import Constraint
from seqrsm.design.factors import CategoricalFactor, ContinuousFactor, DiscreteFactor
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.fit.estimability import missing_runs

A, B = ContinuousFactor("a", 0.0, 10.0), ContinuousFactor("b", -1.0, 1.0)
C = CategoricalFactor("c", ("u", "v", "w"))


def rank(model: QuadraticModel, points: np.ndarray) -> int:
    return int(np.linalg.matrix_rank(model.matrix(points)))


@pytest.mark.parametrize(
    "points",
    [
        np.empty((0, 3)),
        np.zeros((5, 3)),
        np.array([[x, y, c] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for c in (0.0, 1.0)]),
        np.array([[x, x, c] for x in (-1.0, 0.0, 1.0) for c in (0.0, 1.0, 2.0)]),
    ],
    ids=["none", "all at one setting", "one level missing and no middle", "two factors alike"],
)
def test_as_many_runs_as_dependences_and_then_all_is_estimable(points: np.ndarray) -> None:
    factors = (A, B, C)
    model, region = QuadraticModel(factors), Region(factors)
    found, unresolved = missing_runs(model, region, points)
    before = rank(model, points) if len(points) else 0
    assert len(found) == model.p - before
    assert region.feasible(found).all()
    after = np.vstack([points, found])
    assert rank(model, after) == model.p
    assert np.linalg.cond(model.matrix(after)) < 100
    assert unresolved == ()


def test_nothing_is_missing() -> None:
    model, region = QuadraticModel((A, B)), Region((A, B))
    found, unresolved = missing_runs(model, region, region.sample(20, np.random.default_rng(0)))
    assert (len(found), unresolved) == (0, ())


def test_what_the_region_itself_forbids_is_said() -> None:
    """On the diagonal a = b no run separates the two; a categorical level that is never allowed stays unknown."""
    factors = (DiscreteFactor("a", (0.0, 1.0, 2.0)), DiscreteFactor("b", (0.0, 1.0, 2.0)), C)
    model, region = QuadraticModel(factors, 1), Region(factors, (Constraint("a <= b <= a"),))
    found, unresolved = missing_runs(model, region, np.empty((0, 3)))
    assert unresolved == ("a", "b")
    assert len(found) == model.p - 1
