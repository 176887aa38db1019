"""Models without a closed form: each sampled and compared with a grid, another formula or a special case."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from scipy.special import expit

from seqrsm.errors import ConvergenceError, FitError
from seqrsm.fit.ensemble import GeneralPosterior, sample_model
from seqrsm.fit.score_models import CoefficientPrior, Discrepancy, beta_binomial_model, normal_model
from seqrsm.fit.target import GeneralModel, Parameter, StudentProposal

ONE = CoefficientPrior(np.array([0.0]), np.array([5.0]))


def grid_margins(axes: list[np.ndarray], log_density: np.ndarray) -> list[np.ndarray]:
    """Cumulative margins on the axes (even steps) of a density on their product."""
    density = np.exp(log_density - log_density.max())
    margins = []
    for j in range(len(axes)):
        margin = density.sum(axis=tuple(i for i in range(len(axes)) if i != j))
        margins.append((np.cumsum(margin) - 0.5 * margin) / margin.sum())
    return margins


def scores(sample: np.ndarray, ess: float, axis: np.ndarray, cumulative: np.ndarray) -> list[float]:
    """Gaps between shares of draws below the grid's quantiles and those quantiles' levels, in Monte Carlo errors."""
    found = []
    for level in (0.05, 0.25, 0.5, 0.75, 0.95):
        share = np.mean(sample <= np.interp(level, cumulative, axis))
        found.append((share - level) / np.sqrt(level * (1 - level) / ess + 1e-6))
    return found


def test_two_sources_with_their_own_variances_against_a_grid() -> None:
    y = np.array([1.0, 1.3, 0.8, 1.1, 1.2, 3.0, -0.5, 2.2])
    w = np.array([1.0, 2.0, 0.5, 1.0, 1.0, 1.0, 1.5, 1.0])
    source = ["simulation"] * 5 + ["flight"] * 3
    sample = sample_model(normal_model(np.ones((8, 1)), y, ONE, weights=w, sources=source, sigma_scale=2.0), seed=1)
    axes = [np.linspace(-1, 3, 161), np.linspace(-4, 2.0, 121), np.linspace(-2.5, 2.5, 101)]
    mu, first, second = np.meshgrid(*axes, indexing="ij")
    value = stats.norm.logpdf(mu, 0, 5) + first + second
    value += stats.halfnorm.logpdf(np.exp(first), scale=2) + stats.halfnorm.logpdf(np.exp(second), scale=2)
    for yi, wi, name in zip(y, w, source, strict=True):
        value += stats.norm.logpdf(yi, mu, np.exp(first if name == "simulation" else second) / np.sqrt(wi))
    margins = grid_margins(axes, value)
    draws = [sample.of("beta")[:, 0], np.log(sample.of("sigma[simulation]")), np.log(sample.of("sigma[flight]"))]
    gaps = [scores(d, sample.ess.min(), axis, c) for d, axis, c in zip(draws, axes, margins, strict=True)]
    assert np.max(np.abs(gaps)) < 4.5
    swapped = scores(draws[1], sample.ess.min(), axes[2], margins[2])  # control: the other source's variance
    assert np.max(np.abs(swapped)) > 6
    assert np.median(sample.of("sigma")[:, 1]) > 3 * np.median(sample.of("sigma")[:, 0])


def test_random_days_against_a_grid_of_the_balanced_formula() -> None:
    """b days of m runs: the sums of squares between and within days and the mean are sufficient."""
    rng = np.random.default_rng(3)
    b, m = 5, 3
    day = np.repeat(np.arange(b), m)
    y = 2.0 + 1.2 * rng.normal(size=b)[day] + 0.7 * rng.normal(size=b * m)
    model = normal_model(np.ones((b * m, 1)), y, ONE, days=day.tolist(), sigma_scale=2.0, day_scale=3.0)
    sample = sample_model(model, seed=2)
    means = y.reshape(b, m).mean(axis=1)
    within = np.sum((y.reshape(b, m) - means[:, None]) ** 2)
    axes = [np.linspace(-2, 6, 161), np.linspace(-1.8, 1.2, 101), np.linspace(-6, 2.5, 141)]
    mu, log_s, log_t = np.meshgrid(*axes, indexing="ij")
    s, t = np.exp(log_s), np.exp(log_t)
    value = stats.norm.logpdf(mu, 0, 5) + stats.halfnorm.logpdf(s, scale=2) + log_s
    value += stats.halfnorm.logpdf(t, scale=3) + log_t - b * (m - 1) * log_s - 0.5 * within / s**2
    for mean in means:
        value += stats.norm.logpdf(mean, mu, np.sqrt(t**2 + s**2 / m))
    margins = grid_margins(axes, value)
    draws = [sample.of("beta")[:, 0], np.log(sample.of("sigma[all]")), np.log(sample.of("sigma_day"))]
    gaps = [scores(d, sample.ess.min(), axis, c) for d, axis, c in zip(draws, axes, margins, strict=True)]
    assert np.max(np.abs(gaps)) < 4.5
    control = scores(draws[0], sample.ess.min(), axes[0], stats.norm.cdf(axes[0], y.mean(), s.min() + 0.2))
    assert np.max(np.abs(control)) > 6


def test_discrepancy_with_known_variances_is_normal_in_closed_form() -> None:
    rng = np.random.default_rng(4)
    n = 16
    x = rng.uniform(-1, 1, n)
    flight = np.arange(n) >= 10
    Z = np.column_stack([np.ones(n), x, x**2])
    delta = np.column_stack([np.ones(n), x])
    y = Z @ np.array([5.0, 1, -2]) + flight * (0.8 - 0.5 * x) + np.where(flight, 0.6, 0.2) * rng.normal(size=n)
    prior = CoefficientPrior(np.zeros(3), np.array([10.0, 5, 5]))
    model = normal_model(
        Z, y, prior, sources=flight.tolist(), sigma_known=(0.2, 0.6), discrepancy=Discrepancy(delta, flight, np.ones(2))
    )
    sample = sample_model(model, seed=3)
    assert sample.names == ("beta[0]", "beta[1]", "beta[2]", "gamma[0]", "gamma[1]")
    full = np.hstack([Z, delta * flight[:, None]])
    weights = 1 / np.where(flight, 0.6, 0.2) ** 2
    precision = (full.T * weights) @ full + np.diag(1 / np.array([10.0, 5, 5, 1, 1]) ** 2)
    covariance = np.linalg.inv(precision)
    mean, sd = covariance @ full.T @ (weights * y), np.sqrt(np.diag(covariance))
    assert np.max(np.abs(normal_scores(sample, mean, sd))) < 4.5
    assert np.max(np.abs(normal_scores(sample, mean, 1.15 * sd))) > 6  # control


def normal_scores(sample: GeneralPosterior, mean: np.ndarray, sd: np.ndarray) -> np.ndarray:
    ess = sample.ess.min()
    return np.concatenate(
        [
            (sample.draws.mean(axis=0) - mean) / (sd / np.sqrt(ess)),
            (sample.draws.std(axis=0) / sd - 1.0) * np.sqrt(2.0 * ess),
        ]
    )


def test_integrated_and_joint_densities_agree() -> None:
    """Joint = marginal of the hyperparameters times the exact law of the coefficients given them, at any values."""
    rng = np.random.default_rng(12)
    n = 14
    Z = np.column_stack([np.ones(n), rng.uniform(-1, 1, (n, 2))])
    flight, w = np.arange(n) >= 9, rng.uniform(0.5, 2, n)
    y = 5 + Z @ np.array([0.0, 1, 2]) + rng.normal(size=n)
    extra = Discrepancy(np.column_stack([np.ones(n), Z[:, 1]]), flight, np.array([1.0, 0.5]), scale_sd=0.3)
    sd, mean = np.array([6.0, 2, 2]), np.array([4.0, 0, 0])
    days = (np.arange(n) // 3).tolist()
    make = {"weights": w, "sources": flight.tolist(), "days": days, "discrepancy": extra}
    marginal = normal_model(Z, y, CoefficientPrior(mean, sd), **make)
    wide = CoefficientPrior(mean, sd, np.full(3, -np.inf), np.full(3, np.inf))
    joint = normal_model(Z, y, wide, **make)
    assert marginal.complete is not None
    hyper = np.column_stack([rng.uniform(0.3, 2, (3, 3)), rng.uniform(0.7, 1.3, 3)])
    gaps = []
    for v in hyper:
        names, draws = marginal.complete(np.tile(v, (20_000, 1)), rng)
        assert names[:5] == ("beta[0]", "beta[1]", "beta[2]", "gamma[0]", "gamma[1]")
        # the joint density at five points fixes the normal law of the coefficients up to its constant
        law = stats.multivariate_normal(draws[:, :5].mean(axis=0), np.cov(draws[:, :5], rowvar=False))
        at = draws[:200]
        difference = joint.log_density(at) - law.logpdf(at[:, :5])
        assert difference.std() < 0.1
        gaps.append(difference.mean() - marginal.log_density(v[None, :])[0])
    np.testing.assert_allclose(gaps, gaps[0], atol=0.05)


def test_scale_between_simulation_and_flight_against_a_grid() -> None:
    """Surface known from many simulation runs; the scale's posterior is then that of a regression on it."""
    rng = np.random.default_rng(5)
    x = np.concatenate([np.linspace(-1, 1, 40), np.linspace(-1, 1, 8)])
    flight = np.arange(48) >= 40
    Z = np.column_stack([np.ones(48), x])
    y = np.where(flight, 1.3, 1.0) * (4 + 2 * x) + np.where(flight, 0.5, 0.001) * rng.normal(size=48)
    prior = CoefficientPrior(np.zeros(2), np.full(2, np.inf))
    discrepancy = Discrepancy(np.zeros((48, 1)), flight, np.ones(1), scale_sd=0.5)
    model = normal_model(Z, y, prior, sources=flight.tolist(), sigma_known=(0.001, 0.5), discrepancy=discrepancy)
    sample = sample_model(model, seed=4)
    f = Z[flight] @ np.linalg.lstsq(Z[~flight], y[~flight], rcond=None)[0]
    precision = f @ f / 0.25 + 4.0
    mean = (f @ y[flight] / 0.25 + 4.0) / precision
    scale = sample.of("scale")
    assert scale.mean() == pytest.approx(mean, abs=4.5 / np.sqrt(precision * sample.ess.min()) + 1e-4)
    assert scale.std() == pytest.approx(1 / np.sqrt(precision), rel=0.06)


@pytest.mark.parametrize("bounds", [(0.0, np.inf), (0.5, 1.0), (-np.inf, np.inf)])
def test_bounded_prior_is_the_truncated_posterior(bounds: tuple[float, float]) -> None:
    y = np.array([0.2, -0.6, 0.5, 0.9])
    prior = CoefficientPrior(np.zeros(1), np.array([np.inf]), np.array([bounds[0]]), np.array([bounds[1]]))
    sample = sample_model(normal_model(np.ones((4, 1)), y, prior, sigma_known=(1.0,)), seed=5)
    centre, sd = y.mean(), 0.5
    a, b = (np.array(bounds) - centre) / sd
    exact = stats.truncnorm(a, b, centre, sd)
    levels = np.array([0.05, 0.25, 0.5, 0.75, 0.95])
    shares = np.mean(sample.draws[:, :1] <= exact.ppf(levels), axis=0)
    assert np.max(np.abs(shares - levels) / np.sqrt(levels * (1 - levels) / sample.ess.min())) < 4.5
    assert sample.draws.min() >= bounds[0]
    assert sample.draws.max() <= bounds[1]


def test_beta_binomial_against_a_grid() -> None:
    c, m = np.array([18.0, 12, 20, 9, 15, 20]), np.full(6, 20.0)
    sample = sample_model(beta_binomial_model(np.ones((6, 1)), c, m, ONE), seed=6)
    axes = [np.linspace(-1, 4.5, 221), np.linspace(-8, 2.5, 211)]
    eta, logit = np.meshgrid(*axes, indexing="ij")
    correlation = expit(logit)
    phi = 1 / correlation - 1
    value = (
        stats.norm.logpdf(eta, 0, 5) + stats.beta.logpdf(correlation, 1, 9) + np.log(correlation * (1 - correlation))
    )
    for ci, mi in zip(c, m, strict=True):
        value += stats.betabinom.logpmf(int(ci), int(mi), expit(eta) * phi, (1 - expit(eta)) * phi)
    margins = grid_margins(axes, value)
    r = sample.of("correlation")
    draws = [sample.of("beta")[:, 0], np.log(r) - np.log1p(-r)]
    gaps = [scores(d, sample.ess.min(), axis, cdf) for d, axis, cdf in zip(draws, axes, margins, strict=True)]
    assert np.max(np.abs(gaps)) < 4.5
    # control: the binomial posterior, which knows no scatter between runs, is much narrower
    binomial = stats.norm.logpdf(axes[0], 0, 5) + sum(stats.binom.logpmf(int(v), 20, expit(axes[0])) for v in c)
    density = np.exp(binomial - binomial.max())
    assert np.max(np.abs(scores(draws[0], sample.ess.min(), axes[0], np.cumsum(density) / density.sum()))) > 6


def test_scores_of_none_and_all_have_a_posterior() -> None:
    Z = np.column_stack([np.ones(6), np.linspace(-1, 1, 6)])
    prior = CoefficientPrior(np.zeros(2), np.full(2, 3.0))
    sample = sample_model(beta_binomial_model(Z, np.array([0.0, 0, 0, 50, 50, 50]), np.full(6, 50.0), prior), seed=7)
    assert np.isfinite(sample.draws).all()
    assert np.quantile(sample.of("beta")[:, 1], 0.025) > 1.0


def test_simulation_based_calibration_of_the_two_source_model() -> None:
    """Truths from the prior rank uniformly; ranks against posteriors that ignore the second source do not."""
    rng = np.random.default_rng(8)
    sets = 32
    Z = np.column_stack([np.ones(10), np.linspace(-1, 1, 10)])
    source = np.arange(10) % 2
    prior = CoefficientPrior(np.zeros(2), np.full(2, 2.0))
    ranks, wrong = np.empty((sets, 4)), np.empty(sets)
    for i in range(sets):
        beta, sigma = 2.0 * rng.normal(size=2), np.abs(np.array([1.0, 1.0]) * rng.normal(size=2)) + 1e-3
        y = Z @ beta + sigma[source] * rng.normal(size=10)
        model = normal_model(Z, y, prior, sources=source.tolist(), sigma_scale=1.0)
        sample = sample_model(model, seed=i, min_ess=300, walkers=32, ensembles=2)
        truth = np.concatenate([beta, sigma])
        ranks[i] = np.mean(sample.draws < truth, axis=0)
        wrong[i] = np.mean(sample.draws[:, 2] < sigma[1])
    assert min(stats.kstest(column, "uniform").pvalue for column in ranks.T) > 1e-3
    assert stats.kstest(wrong, "uniform").pvalue < 1e-3


def test_error_of_the_interval_ends_is_what_ess_ends_says() -> None:
    """Eight seeds: the scatter of the 97.5 % point agrees with its effective number of draws."""
    y = np.array([0.2, -0.6, 0.5, 0.9, 1.4])
    prior = CoefficientPrior(np.zeros(1), np.full(1, np.inf))
    model = normal_model(np.ones((5, 1)), y, prior, sigma_known=(1.0,))
    made = [sample_model(model, seed=seed, min_ess=1000) for seed in range(8)]
    exact = stats.norm(y.mean(), 1 / np.sqrt(5))
    shares = np.array([np.mean(m.draws[:, 0] <= exact.ppf(0.975)) for m in made])
    claimed = np.array([np.sqrt(0.975 * 0.025 / m.ess_ends[0]) for m in made])
    spread = np.sqrt(np.mean(((shares - 0.975) / claimed) ** 2))
    assert 0.3 < spread < 1.9  # root of chi squared / 8: 0.34 and 1.86 at 1 in 1000


def test_reproducible_and_failures() -> None:
    y = np.array([1.0, 1.4, 0.7, 1.2])
    model = normal_model(np.ones((4, 1)), y, ONE)
    first, second = (sample_model(model, seed=9, min_ess=500) for _ in range(2))
    np.testing.assert_array_equal(first.draws, second.draws)
    with pytest.raises(KeyError):
        first.of("tau")
    with pytest.raises(ConvergenceError):
        sample_model(model, seed=9, max_steps=60, min_ess=1e9)
    with pytest.raises(FitError, match="not finite"):
        sample_model(GeneralModel((Parameter("a", 0.0),), lambda v: np.full(len(v), -np.inf)), seed=1)
    with pytest.raises(FitError, match="run 2 "):
        beta_binomial_model(np.ones((2, 1)), np.array([1.0, 5.0]), np.array([3.0, 4.0]), ONE)
    empty = CoefficientPrior(np.zeros(1), np.ones(1), np.array([1.0]), np.array([0.0]))
    with pytest.raises(FitError, match="bounds"):
        normal_model(np.ones((4, 1)), y, empty)


def test_proposal_density_is_that_of_scipy() -> None:
    covariance = np.array([[2.0, 0.5], [0.5, 1.0]])
    proposal = StudentProposal.of(np.array([1.0, -1.0]), covariance)
    x = np.random.default_rng(0).normal(size=(7, 2))
    expected = stats.multivariate_t(np.array([1.0, -1.0]), covariance, df=6).logpdf(x)
    np.testing.assert_allclose(proposal.log_density(x), expected, rtol=1e-12)
    draws = proposal.draw(np.random.RandomState(1), 50_000)
    np.testing.assert_allclose(np.cov(draws, rowvar=False), covariance * 6 / 4, rtol=0.1, atol=0.05)


def test_prior_of_dependent_coefficients_is_that_of_rotated_independent_ones() -> None:
    """A precision matrix: the posterior in other coordinates of the same prior and the same surface."""
    rng = np.random.default_rng(9)
    x = np.linspace(-1, 1, 10)
    Z, y = np.column_stack([np.ones(10), x]), 3.0 + 2.0 * x + rng.normal(size=10)
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    sd = np.array([2.0, 0.3])
    plain = CoefficientPrior(np.array([1.0, -1.0]), sd)
    turned = CoefficientPrior(turn @ plain.mean, sd, precision=turn @ np.diag(sd**-2.0) @ turn.T)
    beta = rng.normal(size=(5, 2))
    np.testing.assert_allclose(turned.log_density(beta @ turn.T), plain.log_density(beta), rtol=1e-12)
    known = {"sigma_known": [1.0]}
    one, other = normal_model(Z, y, plain, **known), normal_model(Z @ turn.T, y, turned, **known)
    gap = other.log_density(beta @ turn.T) - one.log_density(beta)
    np.testing.assert_allclose(gap, gap[0], atol=1e-9)
    sampled = normal_model(Z @ turn.T, y, turned, sources=["a"] * 10)
    free = normal_model(Z, y, plain, sources=["a"] * 10)
    v = np.array([[0.7], [1.0], [1.6]])
    np.testing.assert_allclose(sampled.log_density(v), free.log_density(v), atol=1e-9)


def test_upper_bound_alone() -> None:
    """A coefficient below 0: the posterior is the conjugate one of the mirrored problem with a lower bound."""
    rng = np.random.default_rng(4)
    Z = np.column_stack([np.ones(10), np.linspace(-1, 1, 10)])
    y = Z @ [1.0, 0.1] + 0.5 * rng.normal(size=10)
    none = np.full(2, np.inf)
    upper = CoefficientPrior(np.zeros(2), np.full(2, 3.0), -none, np.array([np.inf, 0.0]))
    lower = CoefficientPrior(np.zeros(2), np.full(2, 3.0), np.array([-np.inf, 0.0]), none)
    mirrored = Z * np.array([1.0, -1.0])
    found = sample_model(normal_model(Z, y, upper), seed=1, min_ess=2000).of("beta")
    other = sample_model(normal_model(mirrored, y, lower), seed=2, min_ess=2000).of("beta")
    assert found[:, 1].max() <= 0.0
    quantiles = [0.05, 0.25, 0.5, 0.75, 0.95]
    sd = np.std(other, axis=0)
    for j, sign in ((0, 1.0), (1, -1.0)):
        wanted = np.sort(sign * np.quantile(other[:, j], quantiles))
        np.testing.assert_allclose(np.quantile(found[:, j], quantiles), wanted, atol=0.1 * sd[j])


def test_sources_that_cannot_tell_the_terms_apart_alone() -> None:
    """Many terms, one source with fewer runs than terms, scores far from zero: sampled, and the same when moved."""
    rng = np.random.default_rng(0)
    Z = np.column_stack([np.ones(24), rng.uniform(-1, 1, (24, 9))])
    sources = [int(i % 3 == 0) for i in range(24)]
    y = np.round(Z @ np.concatenate([[70.0], np.full(9, 2.0)]) + rng.normal(size=24), 3)
    found = []
    for shift in (0.0, 1e9):
        prior = CoefficientPrior(np.where(np.arange(10) == 0, 70.0 + shift, 0.0), np.full(10, 20.0))
        sample = sample_model(normal_model(Z, y + shift, prior, sources=sources), seed=1, min_ess=1000)
        found.append(sample.of("beta") - np.where(np.arange(10) == 0, 70.0 + shift, 0.0))
    sd = np.std(found[0], axis=0)
    np.testing.assert_allclose(np.mean(found[1], axis=0), np.mean(found[0], axis=0), atol=0.1 * sd.min())
    np.testing.assert_allclose(np.std(found[1], axis=0), sd, rtol=0.05)


@pytest.mark.parametrize("trials", [1.0, 7.0, 300.0, 40_000.0])
def test_beta_binomial_density_is_that_of_scipy(trials: float) -> None:
    rng = np.random.default_rng(3)
    share = np.array([0.02, 0.3, 0.5, 0.97])
    correct = np.round(trials * share)
    prior = CoefficientPrior(np.zeros(4), np.full(4, np.inf))
    model = beta_binomial_model(np.eye(4), correct, np.full(4, trials), prior, overdispersion=1.0)
    logit = np.log(share / (1 - share)) + 0.3 * rng.normal(size=4)
    correlations = np.array([0.6, 0.1, 1e-3, 1e-5])
    found = model.log_density(np.column_stack([np.tile(logit, (4, 1)), correlations]))
    phi = 1.0 / correlations - 1.0
    p = expit(logit)
    counted = stats.binom(trials, 0.5).logpmf(correct) + trials * np.log(2.0)  # the binomial coefficient
    want = [np.sum(stats.betabinom(trials, p * f, (1 - p) * f).logpmf(correct) - counted) for f in phi]
    np.testing.assert_allclose(found, want, rtol=1e-9, atol=1e-6)
    # Without correlation it is binomial: no digits are lost on the way there.
    limit = model.log_density(np.append(logit, 1e-18)[None, :])[0]
    assert limit == pytest.approx(np.sum(stats.binom(trials, p).logpmf(correct) - counted), rel=1e-9, abs=1e-6)


@pytest.mark.parametrize("scatter", [0.0, 500.0, 3000.0])
def test_counts_of_a_million_pixels(scatter: float) -> None:
    """The posterior mean of the coefficients is the least-squares fit of the logits, as good as counts this large."""
    rng = np.random.default_rng(1)
    x = np.linspace(-1, 1, 15)
    Z, n = np.column_stack([np.ones(15), x, x**2]), 1e6
    correct = np.round(n * expit(Z @ [0.4, 0.1, -0.5]) + scatter * rng.normal(size=15))
    prior = CoefficientPrior(np.zeros(3), np.array([10.0, 2.5, 2.5]))
    found = sample_model(beta_binomial_model(Z, correct, np.full(15, n), prior), seed=1, min_ess=2000)
    want = np.linalg.lstsq(Z, np.log(correct / (n - correct)), rcond=None)[0]
    sd = np.std(found.of("beta"), axis=0)
    np.testing.assert_allclose(np.mean(found.of("beta"), axis=0), want, atol=0.5 * sd.max())
    size = max(scatter, np.sqrt(n / 4)) / (n / 4)  # scatter of a logit
    assert sd[1] == pytest.approx(size / np.sqrt(np.sum(x**2)), rel=0.6)
