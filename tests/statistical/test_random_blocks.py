"""Random days: REML against statsmodels, conditional formulas against dense algebra, coverage by simulation."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from half_widths import half_width
from scipy import stats
from scipy.integrate import dblquad
from statsmodels.regression.mixed_linear_model import MixedLM

from seqrsm.design.factors import ContinuousFactor
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.errors import FitError
from seqrsm.fit.blocks import fit_random_blocks
from seqrsm.fit.least_squares import fit_least_squares
from seqrsm.fit.process import Blocks, Process

BETA = np.array([70.0, 4, -3, 2, -6, -5])


def problem(n: int, days: int, sigma_day: float, seed: int, sigma: float = 1.0):
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(-1, 1, (2, n))
    Z = np.column_stack([np.ones(n), a, b, a * b, a * a, b * b])
    day = np.arange(n) * days // n
    return Z, Z @ BETA + sigma_day * rng.normal(size=days)[day] + sigma * rng.normal(size=n), day


@pytest.mark.parametrize(
    ("seed", "days", "sigma_day"), [(0, 6, 1.5), (1, 5, 3.0), (2, 8, 0.7), (3, 4, 2.0), (4, 10, 1.0)]
)
def test_reml_against_statsmodels(seed: int, days: int, sigma_day: float) -> None:
    Z, y, day = problem(40, days, sigma_day, seed)
    found = fit_random_blocks(Z, y, day.tolist())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        theirs = MixedLM(y, Z, day).fit(reml=True, method=["bfgs", "nm"], gtol=1e-10, xtol=1e-12)
    assert found.sigma**2 == pytest.approx(float(theirs.scale), rel=2e-4)
    assert found.sigma_day**2 == pytest.approx(float(np.asarray(theirs.cov_re).item()), rel=2e-3)


def test_given_the_ratio_it_is_generalised_least_squares() -> None:
    Z, y, day = problem(20, 4, 2.0, 5)
    w = np.random.default_rng(1).uniform(0.3, 3, 20)
    found = fit_random_blocks(Z, y, day.tolist(), weights=w)
    c = int(np.argmax(found.shares))
    ratio = found.ratios[c]
    J = (day[:, None] == np.arange(4)).astype(float)
    V = np.diag(1 / w) + ratio * J @ J.T
    C = np.linalg.inv(Z.T @ np.linalg.solve(V, Z))
    beta = C @ Z.T @ np.linalg.solve(V, y)
    s2 = (y - Z @ beta) @ np.linalg.solve(V, y - Z @ beta) / 14
    np.testing.assert_allclose(found.mean[c], beta, rtol=1e-9)
    np.testing.assert_allclose(found.factor[c] @ found.factor[c].T, C, rtol=1e-8, atol=1e-12)
    assert found.s[c] ** 2 == pytest.approx(s2, rel=1e-9)
    one = found.__class__(**{**{f: getattr(found, f) for f in found.__dataclass_fields__}, **_only(found, c)})
    row = np.array([[1.0, 0.2, 0.4, 0.08, 0.04, 0.16]])
    t = stats.t(14).ppf(0.975)
    new = one.predict(row, replicates=4)
    assert half_width(new.confidence)[0] == pytest.approx(t * np.sqrt(s2 * row[0] @ C @ row[0]), rel=1e-8)
    wanted = t * np.sqrt(s2 * (row[0] @ C @ row[0] + ratio + 0.25))
    assert half_width(new.prediction)[0] == pytest.approx(wanted, rel=1e-8)


def _only(found: object, c: int) -> dict[str, np.ndarray]:
    part = {name: getattr(found, name)[c : c + 1] for name in ("ratios", "mean", "factor", "s")}
    return {**part, "shares": np.ones(1)}


def test_posterior_of_the_ratio_by_quadrature() -> None:
    """One mean, five days of two runs: integrate likelihood and priors over log sigma and the mean for two ratios."""
    rng = np.random.default_rng(7)
    day = np.repeat(np.arange(5), 2)
    y = 3.0 + rng.normal(size=5)[day] + 0.6 * rng.normal(size=10)
    found = fit_random_blocks(np.ones((10, 1)), y, day.tolist())
    J = (day[:, None] == np.arange(5)).astype(float)
    picks = [int(np.argmin(np.abs(found.ratios - r))) for r in (0.3, 3.0)]
    masses = []
    for c in picks:
        V = np.eye(10) + found.ratios[c] * J @ J.T
        log_det = np.linalg.slogdet(V)[1]
        inverse = np.linalg.inv(V)

        def density(mu: float, t: float, inverse: np.ndarray = inverse, log_det: float = log_det) -> float:
            r = y - mu
            return float(np.exp(-10 * t - 0.5 * log_det - 0.5 * (r @ inverse @ r) * np.exp(-2 * t)))

        root = np.sqrt(found.ratios[c])
        masses.append(dblquad(density, -2.5, 2.0, -4, 10, epsrel=1e-8)[0] * root / (1 + root**2))
    assert found.shares[picks[1]] / found.shares[picks[0]] == pytest.approx(masses[1] / masses[0], rel=1e-5)


def test_coverage_of_the_mean_and_on_a_new_day() -> None:
    """Six days of six runs; the plug-in and the fit that forgets days must cover a new day less."""
    sets, level = 300, 0.9
    hits = dict.fromkeys(("mean", "new", "mean of 3", "forgets"), 0)
    row = np.array([[1.0, 0.3, -0.4, -0.12, 0.09, 0.16]])
    for seed in range(sets):
        rng = np.random.default_rng(1000 + seed)
        Z, _, day = problem(36, 6, 0.0, 11)
        effect = 1.5 * rng.normal(size=6)
        y = Z @ BETA + effect[day] + rng.normal(size=36)
        truth = float(row[0] @ BETA)
        found = fit_random_blocks(Z, y, day.tolist())
        new = found.predict(row, level)
        several = found.predict(row, level, replicates=3)
        tomorrow = truth + 1.5 * rng.normal()
        run = tomorrow + rng.normal()
        plain = fit_least_squares(Z, y, ["intercept"] + ["x"] * 5).predict(row, level)
        for key, interval, value in (
            ("mean", new.confidence, truth),
            ("new", new.prediction, run),
            ("mean of 3", several.prediction, tomorrow + rng.normal() / np.sqrt(3)),
            ("forgets", plain.confidence, truth),
        ):
            hits[key] += bool(interval.low[0] <= value <= interval.high[0])
    error = 4 * np.sqrt(level * (1 - level) / sets)
    for key in ("mean", "new", "mean of 3"):
        assert hits[key] / sets == pytest.approx(level, abs=error), key
    assert hits["forgets"] / sets < level - error


def test_days_that_do_not_differ_and_days_that_do() -> None:
    Z, y, day = problem(40, 8, 0.0, 21)
    alike = fit_random_blocks(Z, y, day.tolist())
    plain = fit_least_squares(Z, y, ["intercept"] + ["x"] * 5)
    assert (alike.sigma_day / alike.sigma) ** 2 < 0.2
    assert np.max(np.abs(alike.estimate - plain.estimate)) < plain.se.max()
    Z, y, day = problem(40, 8, 50.0, 22)
    apart = fit_random_blocks(Z, y, day.tolist())
    low, high = apart.sigma_ratio_interval()
    means = np.array([np.mean(y[day == d] - Z[day == d] @ apart.estimate) for d in range(8)])
    assert low < np.std(means, ddof=1) < high
    half_widths = half_width(apart.predict(np.eye(Z.shape[1])).confidence)
    assert half_widths[0] > 5 * half_widths[1]


def test_refused_and_warned() -> None:
    Z, y, day = problem(20, 3, 1.0, 0)
    assert "3 blocks" in fit_random_blocks(Z, y, day.tolist()).reason
    for Z_bad, y_bad, days, match in (
        (Z, y, [0] * 20, "one block"),
        (Z[:6], y[:6], day[:6].tolist(), "determine|one block"),
        (np.column_stack([Z, Z[:, 1]]), y, day.tolist(), "determine"),
        (Z, np.full(20, 5.0), day.tolist(), "exactly"),
    ):
        with pytest.raises(FitError, match=match):
            fit_random_blocks(Z_bad, y_bad, days)


def test_draws_are_those_of_the_intervals() -> None:
    """Exact draws of coefficients and of a run on a new day against the mixture's quantiles."""
    Z, y, day = problem(36, 6, 1.5, 5)
    found = fit_random_blocks(Z, y, day.tolist())
    rng = np.random.default_rng(6)
    n = 200_000
    beta, sigma, of_days = found.draws(n, rng)
    row = np.array([[1.0, 0.3, -0.4, -0.12, 0.09, 0.16]])
    run = beta @ row[0] + np.hypot(sigma, of_days) * rng.normal(size=n)
    exact = found.predict(row, 0.9)
    for draws, interval in ((beta @ row[0], exact.confidence), (run, exact.prediction)):
        below = [np.mean(draws < interval.low[0]), np.mean(draws < interval.high[0])]
        np.testing.assert_allclose(below, [0.05, 0.95], atol=5 * np.sqrt(0.0475 / n))
    np.testing.assert_allclose(beta.mean(axis=0), found.estimate, atol=0.02)
    ratio = np.mean(of_days / sigma < found.sigma_ratio_interval(0.9)[1])
    assert ratio == pytest.approx(0.95, abs=0.02)  # the grid is coarse
    low, high = exact.confidence.low[0], exact.confidence.high[0]
    wrong = found.estimate @ row[0] + 0.5 * (beta @ row[0] - found.estimate @ row[0])
    assert np.mean((wrong > low) & (wrong < high)) > 0.93  # control
    # The variance beside it is that of the draws but for the doubt about sigma.
    assert found.predict(row).se_mean[0] ** 2 == pytest.approx(np.var(beta @ row[0]), rel=0.15)


def test_intervals_of_a_process_cover_the_mean_and_a_new_day() -> None:
    """A narrow top by 40 runs on 8 days: 60 data sets, means over the region, and five runs of a ninth day."""
    model = QuadraticModel(tuple(ContinuousFactor(name, -1.0, 1.0) for name in "ab"))
    rng, days, covered = np.random.default_rng(12), np.arange(40) % 8, []

    def hill(points: np.ndarray) -> np.ndarray:
        return 50.0 + 30.0 * np.exp(-4.0 * np.sum((points - 0.3) ** 2, axis=1))

    for _ in range(60):
        points, at = rng.uniform(-1.0, 1.0, (2, 40, 2))
        y = hill(points) + 2.0 * rng.normal(size=8)[days] + rng.normal(size=40)
        process = Process(model, points, y, np.ones(40), rng, blocks=Blocks(np.eye(8)[days], new=True))
        means, variances = process.marginals(at)
        future = hill(at) + np.hypot(2.0, 1.0 / np.sqrt(5.0)) * rng.normal(size=40)
        more = (process.common_variance + process.noise_variance / 5.0)[:, None]
        reached = (
            stats.norm.cdf(true, means, np.sqrt(spread)).mean(axis=0)
            for true, spread in ((hill(at), variances), (future, variances + more))
        )
        covered.append([np.mean(np.abs(one - 0.5) < 0.475) for one in reached])
    for one in np.array(covered).T:
        assert one.mean() == pytest.approx(0.95, abs=3.0 * one.std() / np.sqrt(60))
