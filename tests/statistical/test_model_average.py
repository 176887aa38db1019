"""Averaging over hierarchical sub-models: evidence by other routes, enumeration, search and predictions."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy import linalg, stats
from scipy.integrate import quad

from seqrsm.design.factors import CategoricalFactor, ContinuousFactor, DiscreteFactor
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.errors import FitError
from seqrsm.fit.conjugate import mixture_cdf, mixture_quantile
from seqrsm.fit.selection import ModelSpace, average_models, hierarchical_models, search_models, units_of


def numeric(k: int) -> tuple[ContinuousFactor, ...]:
    return tuple(ContinuousFactor(f"x{i}", -1.0, 1.0) for i in range(k))


def problem(k: int, n: int, seed: int = 0, sigma: float = 0.5):
    model, region = QuadraticModel(numeric(k)), Region(numeric(k))
    rng = np.random.default_rng(seed)
    points = region.sample(n, rng)
    y = 50 + 3 * points[:, 0] - 4 * points[:, 0] ** 2 + 2 * points[:, 1] + sigma * rng.normal(size=n)
    return model, region, points, y


def test_units_and_hierarchy() -> None:
    factors = (*numeric(2), CategoricalFactor("c", ("u", "v", "w")), DiscreteFactor("d", (0.0, 1.0)))
    model = QuadraticModel(factors)
    units = units_of([*model.terms, "block[1]"])
    names = [unit.name for unit in units]
    pairs = {"x0:x1", "c:x0", "x0:d", "c:x1", "x1:d", "c:d"}
    assert set(names) == {"x0", "x1", "d", "c", "x0^2", "x1^2"} | pairs
    assert sorted(i for unit in units for i in unit.columns) == list(range(1, model.p))
    assert len(units[names.index("c:x0")].columns) == 2
    assert {names[v] for v in units[names.index("c:x0")].parents} == {"c", "x0"}


@pytest.mark.parametrize("k", [1, 2, 3])
def test_all_hierarchical_models_are_listed_once(k: int) -> None:
    units = units_of(QuadraticModel(numeric(k)).terms)
    found = hierarchical_models(units, 10**6)
    assert found is not None
    brute = [
        row
        for row in itertools.product([False, True], repeat=len(units))
        if all(not row[u] or all(row[v] for v in unit.parents) for u, unit in enumerate(units))
    ]
    assert {tuple(row) for row in found.tolist()} == set(brute)
    assert len(found) == len(brute) == {1: 3, 2: 13, 3: 95}[k]
    assert hierarchical_models(units, len(brute) - 1) is None


def test_evidence_is_the_density_of_the_scores_freed_of_intercept_and_blocks() -> None:
    """In the space orthogonal to intercept and block the scores are N(0, sigma^2 (I + g P)); sigma integrated out."""
    model, _, points, y = problem(2, 15)
    w = np.random.default_rng(1).uniform(0.3, 3, 15)
    day = np.where(np.arange(15) % 3 == 0, 1.0, -1.0)
    Z = np.column_stack([model.matrix(points), day])
    terms = [*model.terms, "day"]
    units = units_of(terms)
    space = ModelSpace(Z, y, w, terms, units)
    models = hierarchical_models(units, 100)
    assert models is not None
    found = space.log_posterior(models) - space.log_prior(models)
    root = np.sqrt(w)
    free = linalg.null_space((Z[:, [0, 6]] * root[:, None]).T).T
    t = free @ (root * y)
    for value, row in zip(found, models, strict=True):
        columns = [c for unit, inside in zip(units, row, strict=True) if inside for c in unit.columns]
        X = free @ (Z[:, columns] * root[:, None])
        shape = np.eye(13) + space.g * X @ np.linalg.pinv(X)
        expected = -0.5 * np.linalg.slogdet(shape)[1] - 6.5 * np.log(t @ np.linalg.solve(shape, t) / (t @ t))
        assert value == pytest.approx(expected, abs=1e-9)


def test_bayes_factor_of_one_slope_by_quadrature() -> None:
    rng = np.random.default_rng(2)
    x = rng.uniform(-1, 1, 9)
    y = 3 + 1.5 * x + 0.8 * rng.normal(size=9)
    model = QuadraticModel(numeric(1), 1)
    average = average_models(model.matrix(x[:, None]), y, model.terms)
    xc, yc = x - x.mean(), y - y.mean()
    sxx = xc @ xc

    def likelihood(log_sigma: float, slope: float | None) -> float:
        sigma = np.exp(log_sigma)
        part = 1.0 if slope is None else stats.norm.pdf(slope, 0, sigma * np.sqrt(9.0 / sxx))
        r = yc - (0.0 if slope is None else slope) * xc
        return float(part * sigma**-8 * np.exp(-0.5 * (r @ r) / sigma**2))

    def integrated(log_sigma: float) -> float:
        return quad(lambda b: likelihood(log_sigma, b), -15, 15, limit=200, points=[1.5])[0]

    with_slope = quad(integrated, -2.5, 3, limit=200)[0]
    without = quad(lambda t: likelihood(t, None), -2.5, 6, limit=200)[0]
    assert average.inclusion[0] == pytest.approx(with_slope / (with_slope + without), rel=1e-6)


def test_probabilities_add_up_and_favour_the_truth() -> None:
    model, _, points, y = problem(3, 30)
    found = average_models(model.matrix(points), y, model.terms)
    assert found.exhaustive
    assert found.n_models == 95
    inclusion = dict(zip([u.name for u in found.units], found.inclusion, strict=True))
    assert min(inclusion[name] for name in ("x0", "x1", "x0^2")) > 0.99
    assert max(inclusion[name] for name in ("x2", "x2^2", "x0:x2")) < 0.3
    assert set(found.names(found.median_model)) == {"x0", "x1", "x0^2"}
    assert set(found.names(found.models[0])) == {"x0", "x1", "x0^2"}
    np.testing.assert_allclose(found.prior_inclusion, [0.5] * 3 + [0.125] * 3 + [0.25] * 3)


def test_invariant_to_units_order_and_contrasts() -> None:
    factors = (*numeric(2), CategoricalFactor("c", ("u", "v", "w")))
    model, region = QuadraticModel(factors), Region(factors)
    rng = np.random.default_rng(4)
    points = region.sample(30, rng)
    y = 5 + points[:, 0] + 2.0 * (points[:, 2] == 1) + 0.4 * rng.normal(size=30)
    first = average_models(model.matrix(points), y, model.terms)
    turned = points.copy()
    turned[:, 2] = (points[:, 2] + 1) % 3
    order = rng.permutation(30)
    second = average_models(model.matrix(turned)[order] * np.linspace(1, 9, model.p), 7 - 3 * y[order], model.terms)
    np.testing.assert_allclose(first.inclusion, second.inclusion, rtol=1e-8)


def test_search_agrees_with_the_list() -> None:
    model, _, points, y = problem(4, 30, sigma=2.0)
    Z, units = model.matrix(points), units_of(model.terms)
    space = ModelSpace(Z, y, np.ones(30), model.terms, units)
    listed = hierarchical_models(units, 10_000)
    assert listed is not None
    score = space.log_posterior(listed)
    share = np.exp(score - score.max())
    exact = share / share.sum() @ listed
    models, found = search_models(space, units, 6000, np.random.default_rng(0))
    assert len({m.tobytes() for m in models}) == len(models) < len(listed)
    weight = np.exp(found - found.max())
    np.testing.assert_allclose(weight / weight.sum() @ models, exact, atol=0.02)
    brief, score_brief = search_models(space, units, 20, np.random.default_rng(0))
    weight = np.exp(score_brief - score_brief.max())
    assert np.max(np.abs(weight / weight.sum() @ brief - exact)) > 0.02  # control: too short a search is seen


def test_mixture_quantiles() -> None:
    shares, df = np.array([0.3, 0.7]), np.array([2.5, 9.0])
    centre, scale = np.array([[0.0, 4.0], [1.0, 1.0]]), np.array([[1.0, 0.2], [3.0, 3.0]])
    for level in (1e-6, 0.025, 0.5, 0.975):
        q = mixture_quantile(level, shares, df, centre, scale)
        np.testing.assert_allclose(mixture_cdf(q, shares, df, centre, scale), level, rtol=1e-9)
    one = mixture_quantile(0.9, np.array([1.0]), np.array([4.0]), np.array([[2.0]]), np.array([[3.0]]))
    assert one[0] == pytest.approx(2.0 + 3.0 * stats.t.ppf(0.9, 4), rel=1e-12)


def test_inclusion_is_calibrated_over_its_own_prior() -> None:
    """Truths from the prior over models: of units that are told with a probability, that share belongs to the truth."""
    rng = np.random.default_rng(6)
    model, region = QuadraticModel(numeric(2)), Region(numeric(2))
    points = region.sample(12, rng)
    Z, units = model.matrix(points), units_of(model.terms)
    models = hierarchical_models(units, 100)
    assert models is not None
    space = ModelSpace(Z, rng.normal(size=12), np.ones(12), model.terms, units)
    prior = np.exp(space.log_prior(models))
    assert prior.sum() == pytest.approx(1.0, rel=1e-12)
    told, true = [], []
    for _ in range(400):
        truth = models[rng.choice(len(models), p=prior)]
        columns = [c for unit, present in zip(units, truth, strict=True) if present for c in unit.columns]
        beta, sigma = np.zeros(model.p), float(np.exp(rng.normal()))
        centred = Z[:, columns] - Z[:, columns].mean(axis=0)
        L = np.linalg.cholesky(np.linalg.inv(centred.T @ centred / space.g)) if columns else np.zeros((0, 0))
        beta[columns] = sigma * (L @ rng.normal(size=len(columns)))
        beta[0] = 100.0 * rng.normal()
        told.append(average_models(Z, Z @ beta + sigma * rng.normal(size=12), model.terms).inclusion)
        true.append(truth)
    share, there = np.concatenate(told), np.concatenate(true)
    for low, high in ((0.0, 0.2), (0.2, 0.5), (0.5, 0.8), (0.8, 1.0)):
        some = (share >= low) & (share <= high)
        error = np.sqrt(np.mean(share[some] * (1 - share[some])) / np.count_nonzero(some))
        assert abs(np.mean(share[some]) - np.mean(there[some])) < 4 * error
    assert abs(np.mean(share) - np.mean(~there)) > 0.05  # control: the probability that a unit is not there


def test_more_terms_than_runs_and_the_limits() -> None:
    model, _, points, y = problem(5, 14)
    found = average_models(model.matrix(points), y, model.terms)  # 21 terms, 14 runs, 38 619 models
    assert found.n_models <= 38_619
    assert (
        max(sum(len(u.columns) for u, inside in zip(found.units, m, strict=True) if inside) for m in found.models) < 13
    )
    with pytest.raises(FitError, match="vary"):
        average_models(model.matrix(points), np.full(14, 3.0), model.terms)
