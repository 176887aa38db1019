"""Models without a closed form: sampled and compared with a grid, another formula or a special case."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from scipy.special import expit

from seqrsm.errors import ConvergenceError, FitError
from seqrsm.fit import ensemble
from seqrsm.fit.conjugate import NormalInverseGamma
from seqrsm.fit.error_models import BetaBinomial, Draws, LinearRuns
from seqrsm.fit.least_squares import fit_least_squares
from seqrsm.fit.score_models import CoefficientPrior, beta_binomial_model
from seqrsm.fit.target import GeneralModel, StudentProposal, draws_by_importance, general_target

INF = np.array([np.inf])
ONE = CoefficientPrior(np.array([0.0]), np.array([[1 / 25]]))


def sample_model(model: GeneralModel, *, seed: int, **effort: float) -> ensemble.Sampled:
    """A sample with another effort than that of a campaign, by the names of its module in small letters."""
    with pytest.MonkeyPatch.context() as patch:
        for name, value in effort.items():
            patch.setattr(ensemble, name.upper(), value)
        return ensemble.sample(general_target(model), seed)


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


def mean_of(y: np.ndarray, bounds: tuple[float, float] = (-np.inf, np.inf), start: float = 0.0) -> GeneralModel:
    """Mean of normal scores of standard deviation 1, flat prior between the bounds."""
    low, high = np.array(bounds)[:, None]
    return GeneralModel(np.array([start]), low, high, lambda v: -0.5 * np.sum(np.square(y - v), axis=1))


@pytest.mark.parametrize("bounds", [(0.0, np.inf), (0.5, 1.0), (-np.inf, 0.5), (-np.inf, np.inf)])
def test_bounded_prior_is_the_truncated_posterior(bounds: tuple[float, float]) -> None:
    y = np.array([0.2, -0.6, 0.5, 0.9])
    start = {(0.0, np.inf): 0.3, (0.5, 1.0): 0.6}.get(bounds, 0.25)
    sample = sample_model(mean_of(y, bounds, start), seed=5)
    centre, sd = y.mean(), 0.5
    a, b = (np.array(bounds) - centre) / sd
    exact = stats.truncnorm(a, b, centre, sd)
    levels = np.array([0.05, 0.25, 0.5, 0.75, 0.95])
    shares = np.mean(sample.draws[:, :1] <= exact.ppf(levels), axis=0)
    assert np.max(np.abs(shares - levels) / np.sqrt(levels * (1 - levels) / sample.ess.min())) < 4.5
    assert sample.draws.min() >= bounds[0]
    assert sample.draws.max() <= bounds[1]


@pytest.mark.parametrize("by", ["ensemble", "importance"])
def test_beta_binomial_against_a_grid(by: str) -> None:
    c, m = np.array([18.0, 12, 20, 9, 15, 20]), np.full(6, 20.0)
    model = beta_binomial_model(np.ones((6, 1)), c, m, ONE)
    if by == "ensemble":
        sample = sample_model(model, seed=6)
        found, worth = sample.draws, float(sample.ess.min())
    else:
        found, worth = draws_by_importance(model, 4000, np.random.default_rng(6))
        assert 2000.0 < worth < 4000.0
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
    r = found[:, -1]
    draws = [found[:, 0], np.log(r) - np.log1p(-r)]
    gaps = [scores(d, worth, axis, cdf) for d, axis, cdf in zip(draws, axes, margins, strict=True)]
    assert np.max(np.abs(gaps)) < 4.5
    # control: the binomial posterior, which knows no scatter between runs, is much narrower
    binomial = stats.norm.logpdf(axes[0], 0, 5) + sum(stats.binom.logpmf(int(v), 20, expit(axes[0])) for v in c)
    density = np.exp(binomial - binomial.max())
    assert np.max(np.abs(scores(draws[0], worth, axes[0], np.cumsum(density) / density.sum()))) > 6


def test_draws_by_importance_meet_the_ensemble() -> None:
    rng = np.random.default_rng(2)
    X = rng.uniform(-1, 1, (40, 3))
    Z = np.column_stack([np.ones(40), X, X**2, X[:, [0]] * X[:, 1:]])
    p = expit(1.5 + Z[:, 1:] @ rng.normal(0.0, 0.5, 8))
    correct = rng.binomial(300, rng.beta(30 * p, 30 * (1 - p))).astype(float)
    low = np.append(np.full(8, -np.inf), 0.0)  # one coefficient is bounded where it has half of its probability
    prior = CoefficientPrior(np.zeros(9), np.eye(9) / 2.5**2, low, np.full(9, np.inf))
    model = beta_binomial_model(Z, correct, np.full(40, 300.0), prior)
    (found, worth), chain = draws_by_importance(model, 4000, np.random.default_rng(1)), sample_model(model, seed=1)
    assert found[:, 8].min() > 0.0
    for level in (0.025, 0.5, 0.975):
        share = np.mean(found <= np.quantile(chain.draws, level, axis=0), axis=0)
        assert np.max(np.abs(share - level)) < 4.5 * np.sqrt(level * (1.0 - level) * (1.0 / worth + 1.0 / 4000.0))


def test_few_draws_by_importance_are_none() -> None:
    """A bent ridge, which no distribution about its mode follows."""

    def log_density(v):
        return -0.5 * v[:, 0] ** 2 - 0.5 * ((v[:, 1] - 5.0 * v[:, 0] ** 2) / 0.02) ** 2

    model = GeneralModel(np.zeros(2), np.full(2, -np.inf), np.full(2, np.inf), log_density)
    assert draws_by_importance(model, 1000, np.random.default_rng(1)) is None


def test_scores_of_none_and_all_have_a_posterior() -> None:
    Z = np.column_stack([np.ones(6), np.linspace(-1, 1, 6)])
    prior = CoefficientPrior(np.zeros(2), np.eye(2) / 9)
    sample = sample_model(beta_binomial_model(Z, np.array([0.0, 0, 0, 50, 50, 50]), np.full(6, 50.0), prior), seed=7)
    assert np.isfinite(sample.draws).all()
    assert np.quantile(sample.draws[:, 1], 0.025) > 1.0


def test_error_of_the_interval_ends_is_what_ess_ends_says() -> None:
    """Eight seeds: the scatter of the 97.5 % point agrees with its effective number of draws."""
    y = np.array([0.2, -0.6, 0.5, 0.9, 1.4])
    made = [sample_model(mean_of(y), seed=seed, min_ess=1000) for seed in range(8)]
    exact = stats.norm(y.mean(), 1 / np.sqrt(5))
    shares = np.array([np.mean(m.draws[:, 0] <= exact.ppf(0.975)) for m in made])
    claimed = np.array([np.sqrt(0.975 * 0.025 / m.ess_ends[0]) for m in made])
    spread = np.sqrt(np.mean(((shares - 0.975) / claimed) ** 2))
    assert 0.3 < spread < 1.9  # root of chi squared / 8: 0.34 and 1.86 at 1 in 1000


def test_reproducible_and_failures() -> None:
    model = beta_binomial_model(np.ones((4, 1)), np.array([10.0, 14, 7, 12]), np.full(4, 20.0), ONE)
    first, second = (sample_model(model, seed=9, min_ess=500) for _ in range(2))
    np.testing.assert_array_equal(first.draws, second.draws)
    with pytest.raises(ConvergenceError):
        sample_model(model, seed=9, max_steps=60, min_ess=1e9)
    with pytest.raises(FitError, match="not finite"):
        sample_model(GeneralModel(np.zeros(1), -INF, INF, lambda v: np.full(len(v), -np.inf)), seed=1)


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
    Z = np.column_stack([np.ones(10), x])
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    sd = np.array([2.0, 0.3])
    plain = CoefficientPrior(np.array([1.0, -1.0]), np.diag(sd**-2.0))
    turned = CoefficientPrior(turn @ plain.mean, turn @ plain.inverse @ turn.T)
    beta = rng.normal(size=(5, 2))
    np.testing.assert_allclose(turned.log_density(beta @ turn.T), plain.log_density(beta), rtol=1e-12)
    correct, trials = rng.integers(1, 20, 10).astype(float), np.full(10, 20.0)
    one, other = (beta_binomial_model(Z @ t, correct, trials, p) for t, p in ((np.eye(2), plain), (turn.T, turned)))
    correlation = rng.uniform(0.05, 0.5, (5, 1))
    found = other.log_density(np.hstack([beta @ turn.T, correlation]))
    np.testing.assert_allclose(found, one.log_density(np.hstack([beta, correlation])), atol=1e-9)


def test_upper_bound_alone() -> None:
    """A coefficient below 0: the posterior is the one of the mirrored problem with a lower bound."""
    rng = np.random.default_rng(4)
    Z = np.column_stack([np.ones(10), np.linspace(-1, 1, 10)])
    correct, trials = rng.binomial(40, expit(Z @ [1.0, 0.1])).astype(float), np.full(10, 40.0)
    none = np.full(2, np.inf)
    upper = CoefficientPrior(np.zeros(2), np.eye(2) / 9, -none, np.array([np.inf, 0.0]))
    lower = CoefficientPrior(np.zeros(2), np.eye(2) / 9, np.array([-np.inf, 0.0]), none)
    mirrored = Z * np.array([1.0, -1.0])
    found = sample_model(beta_binomial_model(Z, correct, trials, upper), seed=1, min_ess=2000).draws
    other = sample_model(beta_binomial_model(mirrored, correct, trials, lower), seed=2, min_ess=2000).draws
    assert found[:, 1].max() <= 0.0
    quantiles = [0.05, 0.25, 0.5, 0.75, 0.95]
    sd = np.std(other, axis=0)
    for j, sign in ((0, 1.0), (1, -1.0)):
        wanted = np.sort(sign * np.quantile(other[:, j], quantiles))
        np.testing.assert_allclose(np.quantile(found[:, j], quantiles), wanted, atol=0.1 * sd[j])


@pytest.mark.parametrize("trials", [1.0, 7.0, 300.0, 40_000.0])
def test_beta_binomial_density_is_that_of_scipy(trials: float) -> None:
    rng = np.random.default_rng(3)
    share = np.array([0.02, 0.3, 0.5, 0.97])
    correct = np.round(trials * share)
    prior = CoefficientPrior(np.zeros(4), np.zeros((4, 4)))
    model = beta_binomial_model(np.eye(4), correct, np.full(4, trials), prior)
    logit = np.log(share / (1 - share)) + 0.3 * rng.normal(size=4)
    correlations = np.array([0.6, 0.1, 1e-3, 1e-5])
    found = model.log_density(np.column_stack([np.tile(logit, (4, 1)), correlations])) - 8.0 * np.log1p(-correlations)
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
    prior = CoefficientPrior(np.zeros(3), np.diag(np.array([10.0, 2.5, 2.5]) ** -2))
    found = sample_model(beta_binomial_model(Z, correct, np.full(15, n), prior), seed=1, min_ess=2000)
    want = np.linalg.lstsq(Z, np.log(correct / (n - correct)), rcond=None)[0]
    sd = np.std(found.draws[:, :-1], axis=0)
    np.testing.assert_allclose(np.mean(found.draws[:, :-1], axis=0), want, atol=0.5 * sd.max())
    size = max(scatter, np.sqrt(n / 4)) / (n / 4)  # scatter of a logit
    assert sd[1] == pytest.approx(size / np.sqrt(np.sum(x**2)), rel=0.6)


@pytest.mark.parametrize("correlation", [0.02, 0.5])
def test_future_shares_scatter_as_decisions_that_go_together(correlation: float) -> None:
    """Of n decisions of one run: the binomial's variance times 1 + (n - 1) correlation."""

    class Percent:
        def to_score(self, values: np.ndarray) -> np.ndarray:
            return values

    m, n, p = 40_000, 10, 0.3
    more = {"correlation": np.full(m, correlation), "trials": np.full(m, float(n))}
    draws = Draws(np.zeros((m, 1)), np.ones(m), {}, more=more)
    rng = np.random.default_rng(0)
    found = BetaBinomial().future_scores(draws, Percent(), np.full(m, 100.0 * p), 1, rng)
    assert np.mean(found) == pytest.approx(100.0 * p, rel=0.02)
    assert np.var(found) == pytest.approx(1e4 * p * (1.0 - p) / n * (1.0 + (n - 1) * correlation), rel=0.05)


def test_decisions_that_say_nothing_leave_the_prior_that_is_stated() -> None:
    """Precisions are relative to the scatter of a run, guessed at 0.5 logits: beta ~ N(m0, 0.5^2 / precision)."""
    Z = np.column_stack([np.ones(8), np.linspace(-1.0, 1.0, 8)])
    fit = fit_least_squares(Z, np.linspace(-1.0, 1.0, 8) ** 3, ["1", "x"])
    precision, mean = np.array([4.0, 25.0]), np.array([0.5, -1.0])
    stated = NormalInverseGamma(mean, np.diag(precision), 2.0, 2.0 * 0.5**2)
    trials = np.full(8, 1e-6)
    runs = LinearRuns(fit, 2, Z, fit.y, np.ones(8), stated, lambda b: b, True, 1.0, stated, 0.5 * trials, trials)
    found = BetaBinomial().draws(runs, None, "exact", 4000, np.random.default_rng(1)).terms
    np.testing.assert_allclose(found.mean(axis=0), mean, atol=0.02)
    np.testing.assert_allclose(found.std(axis=0), 0.5 / np.sqrt(precision), rtol=0.06)
