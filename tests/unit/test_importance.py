"""Variance shares: by hand, against moments of large samples, and their limits."""

from __future__ import annotations

import numpy as np
import pytest

from seqrsm.design.factors import CategoricalFactor, ContinuousFactor, DiscreteFactor
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.fit.canonical import variance_shares

MIXED = (
    ContinuousFactor("a", 1.0, 9.0, scale="log"),
    CategoricalFactor("c", ("u", "v", "w")),
    DiscreteFactor("d", (1.0, 2.0, 8.0)),
    ContinuousFactor("b", 0.0, 1.0),
)


def test_two_factors_by_hand() -> None:
    """f = 2x + 3y + 4xy + 5x^2: Var x = 1/3, Var x^2 = 4/45, Var xy = 1/9."""
    model = QuadraticModel((ContinuousFactor("x", -1.0, 1.0), ContinuousFactor("y", -1.0, 1.0)))
    first_order, total = variance_shares(model, np.array([7.0, 2, 3, 4, 5, 0]))
    parts = np.array([4 / 3 + 25 * 4 / 45, 9 / 3, 16 / 9])
    np.testing.assert_allclose(first_order, parts[:2] / parts.sum(), rtol=1e-13)
    np.testing.assert_allclose(total, (parts[:2] + parts[2]) / parts.sum(), rtol=1e-13)


def test_against_monte_carlo_by_pick_and_freeze() -> None:
    """First order by Cov(f(A), f(B with x_j of A)), total by half the mean squared change (Saltelli, Jansen)."""
    model, region = QuadraticModel(MIXED), Region(MIXED)
    rng = np.random.default_rng(0)
    beta = rng.normal(0, 2, model.p)
    first_order, total = variance_shares(model, beta)
    n = 200_000
    A, B = region.sample(n, rng), region.sample(n, rng)
    f = model.matrix(A) @ beta
    for j in range(4):
        kept, changed = B.copy(), A.copy()
        kept[:, j], changed[:, j] = A[:, j], B[:, j]
        first = np.cov(f, model.matrix(kept) @ beta)[0, 1] / f.var()
        in_all = 0.5 * np.mean((f - model.matrix(changed) @ beta) ** 2) / f.var()
        assert first_order[j] == pytest.approx(first, abs=0.015)
        assert total[j] == pytest.approx(in_all, abs=0.015)
    assert np.all(total >= first_order - 1e-12)
    assert first_order.sum() < 1.0 < total.sum()


def test_many_surfaces_at_once_and_a_flat_one() -> None:
    model = QuadraticModel(MIXED)
    betas = np.random.default_rng(1).normal(size=(6, model.p))
    betas[2, 1:] = 0.0
    first_order, total = variance_shares(model, betas)
    assert total.shape == (6, 4)
    np.testing.assert_allclose(first_order[4], variance_shares(model, betas[4])[0], rtol=1e-12)
    assert np.isnan(total[2]).all()


def test_a_factor_without_terms_has_no_share_and_first_order_models_have_no_interactions() -> None:
    model = QuadraticModel(MIXED, 1)
    beta = np.random.default_rng(2).normal(size=model.p)
    beta[model.factor_terms("c")] = 0.0
    first_order, total = variance_shares(model, beta)
    np.testing.assert_allclose(first_order, total, atol=1e-12)
    assert total[1] == pytest.approx(0.0, abs=1e-12)
    assert first_order.sum() == pytest.approx(1.0, rel=1e-12)
