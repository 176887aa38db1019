"""Simulation and flight together: the prior as extra rows, coverage of the flight's optimum, what few flights say."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from scipy.linalg import null_space
from scipy.special import logsumexp

from seqrsm.decide.sources import _RATIOS, discrepancy_sd, fit_sources, source_prior, stacked_rows, to_flight
from seqrsm.design.factors import CategoricalFactor, ContinuousFactor
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.fit.conjugate import NormalInverseGamma, posterior

FACTORS = (ContinuousFactor("a", -1.0, 1.0), ContinuousFactor("b", -1.0, 1.0))
MODEL = QuadraticModel(FACTORS)
BETA = np.array([60.0, 3.0, -2.0, 1.0, -6.0, -5.0])


def campaign(n_sim: int, n_flight: int, seed: int, gamma=(3.0, 1.0, -1.0), s_sim=1.0, s_flight=2.0):
    rng = np.random.default_rng(seed)
    X = rng.uniform(-1, 1, (n_sim + n_flight, 2))
    flight = np.arange(len(X)) >= n_sim
    Z = stacked_rows(MODEL, X, flight)
    noise = np.where(flight, s_flight, s_sim) * rng.normal(size=len(X))
    return X, Z @ np.concatenate([BETA, np.pad(gamma, (0, MODEL.p - len(gamma)))]) + noise, flight


def test_rows_of_the_two_sources() -> None:
    model = QuadraticModel((*FACTORS, CategoricalFactor("c", ("x", "y", "z"))))
    sd = discrepancy_sd(model, 3.0)
    for value, names in (
        (3.0, ["intercept"]),
        (1.5, ["a", "b", "c[x]", "c[y]"]),
        (0.75, ["a:b", "c[x]:a", "c[y]:a", "c[x]:b", "c[y]:b", "a^2", "b^2"]),
    ):
        assert [model.term_names[t] for t in np.flatnonzero(sd == value)] == names
    points = np.array([[0.5, -0.5, 1.0], [0.5, -0.5, 1.0]])
    rows = stacked_rows(model, points, np.array([False, True]))
    np.testing.assert_array_equal(rows[0, model.p :], 0.0)
    np.testing.assert_array_equal(rows[1, model.p :], model.matrix(points)[1])


def test_posterior_is_least_squares_with_the_prior_as_rows() -> None:
    X, y, flight = campaign(20, 8, 1)
    found = fit_sources(MODEL, X, y, flight, prior_sd=2.0)
    Z = stacked_rows(MODEL, X, flight)
    w = np.where(flight, found.flight_weight, 1.0)
    sd = np.array([2.0, 1.0, 1.0, 0.5, 0.5, 0.5])
    K = np.hstack([np.zeros((6, 6)), np.diag(found.s_simulation / sd)])
    rows = np.vstack([Z * np.sqrt(w)[:, None], K])
    target = np.concatenate([y * np.sqrt(w), np.zeros(6)])
    beta, rss, _, _ = np.linalg.lstsq(rows, target, rcond=None)
    np.testing.assert_allclose(found.posterior.mean, beta, rtol=1e-6)
    np.testing.assert_allclose(found.estimate, to_flight(MODEL, beta[None, :])[0], rtol=1e-6)
    assert found.s_simulation == pytest.approx(np.sqrt(rss[0] / (28 - 6)), rel=1e-3)
    row = MODEL.matrix(np.array([[0.3, 0.1]]))
    C = np.linalg.inv(rows.T @ rows)
    left = found.s_simulation**2 * np.trace(C[6:, 6:]) / np.sum(sd**2)
    assert found.prior_share == pytest.approx(left, rel=1e-3)
    z = found.flight_rows(row)[0]
    h = z @ C @ z
    predicted = found.predict(row)
    assert predicted.se_mean[0] == pytest.approx(found.s_simulation * np.sqrt(h), rel=1e-6)


def test_each_source_has_its_own_variance() -> None:
    X, y, flight = campaign(300, 300, 2)
    found = fit_sources(MODEL, X, y, flight, prior_sd=5.0)
    assert found.s_simulation == pytest.approx(1.0, rel=0.1)
    assert found.s == pytest.approx(2.0, rel=0.1)
    assert not found.prior_driven


def test_weights_of_all_runs_alike_change_only_their_unit() -> None:
    X, y, flight = campaign(30, 12, 3)
    plain, heavy = (fit_sources(MODEL, X, y, flight, weights=w, prior_sd=2.0) for w in (None, np.full(42, 4.0)))
    np.testing.assert_allclose(heavy.estimate, plain.estimate, rtol=1e-6)
    assert (heavy.s, heavy.s_simulation) == pytest.approx((2.0 * plain.s, 2.0 * plain.s_simulation), rel=1e-6)
    row = MODEL.matrix(np.array([[0.3, 0.1]]))
    mean, future = heavy.predict(row), heavy.predict(row, weight=4.0)
    assert mean.confidence.high == pytest.approx(plain.predict(row).confidence.high, rel=1e-6)
    assert future.prediction.high == pytest.approx(plain.predict(row).prediction.high, rel=1e-6)


def test_few_flights_are_said_to_be_prior() -> None:
    X, y, flight = campaign(30, 2, 3)
    few = fit_sources(MODEL, X, y, flight, prior_sd=2.0)
    assert few.prior_driven
    X, y, flight = campaign(30, 40, 3)
    many = fit_sources(MODEL, X, y, flight, prior_sd=2.0)
    assert many.prior_share < 0.25 < few.prior_share
    mean, low, high = many.discrepancy(MODEL.matrix(np.zeros((1, 2)))[0])
    assert low < 3.0 < high
    assert mean == pytest.approx(3.0, abs=1.5)


def test_tight_prior_is_the_simulation_and_a_wide_one_the_flights() -> None:
    X, y, flight = campaign(30, 30, 4, gamma=(8.0, 0.0, 0.0))
    tight = fit_sources(MODEL, X, y, flight, prior_sd=1e-4)
    np.testing.assert_allclose(tight.estimate, tight.simulation, atol=0.01)
    wide = fit_sources(MODEL, X, y, flight, prior_sd=1e4)
    assert wide.estimate[0] - wide.simulation[0] == pytest.approx(8.0, abs=1.5)


def test_interval_shrinks_with_flights_and_covers_new_ones() -> None:
    """40 simulations and 12 flights, discrepancy drawn from the prior: the 95 % interval of a new flight."""
    covered, widths = [], {4: [], 12: []}
    row = MODEL.matrix(np.array([[0.2, -0.2]]))
    for seed in range(120):
        rng = np.random.default_rng(10_000 + seed)
        gamma = discrepancy_sd(MODEL, 2.0) * rng.normal(size=MODEL.p)
        X, y, flight = campaign(40, 12, seed, gamma=gamma)
        for n in widths:
            keep = slice(None, 40 + n)
            found = fit_sources(MODEL, X[keep], y[keep], flight[keep], prior_sd=2.0)
            interval = found.predict(row).prediction
            widths[n].append(float(interval.high[0] - interval.low[0]))
        truth = row @ (BETA + gamma)
        fresh = truth[0] + 2.0 * rng.normal(size=20)
        covered.append(np.mean((fresh >= interval.low[0]) & (fresh <= interval.high[0])))
    se = np.std(covered) / np.sqrt(len(covered))
    assert np.mean(covered) == pytest.approx(0.95, abs=0.02 + 2 * se)
    assert np.median(widths[12]) < np.median(widths[4]) * 1.1


def test_intervals_hold_their_level_of_the_draws() -> None:
    """Six flights do not tell the ratio of the variances: both are mixtures over it, made in two ways."""
    X, y, flight = campaign(20, 6, 7, s_sim=0.5)
    found = fit_sources(MODEL, X, y, flight, prior_sd=2.0)
    row = MODEL.matrix(np.array([[0.4, -0.7]]))
    rng = np.random.default_rng(2)
    beta, sigma = found.draws(200_000, rng)
    means = to_flight(MODEL, beta) @ row[0]
    for weight, replicates in ((1.0, 1), (2.0, 5)):
        predicted = found.predict(row, 0.9, weight, replicates)
        future = means + sigma / np.sqrt(weight * replicates) * rng.normal(size=len(sigma))
        for interval, values in ((predicted.confidence, means), (predicted.prediction, future)):
            inside = np.mean((values >= interval.low[0]) & (values <= interval.high[0]))
            assert inside == pytest.approx(0.9, abs=4 * np.sqrt(0.09 / len(values)))


def test_draws_carry_the_doubt_about_the_ratio_of_variances() -> None:
    """The standard deviation of a flight against the mixture of inverse gammas, its shares by the evidence."""
    rng = np.random.default_rng(8)
    X = rng.uniform(-1, 1, (26, 2))
    flight = np.arange(26) < 6
    y = MODEL.matrix(X) @ rng.normal(size=MODEL.p) + np.where(flight, 2.0, 0.5) * rng.normal(size=26)
    found = fit_sources(MODEL, X, y, flight, prior_sd=1.0)
    base = NormalInverseGamma(np.zeros(MODEL.p), np.diag(np.full(MODEL.p, 0.01)), 1.0, 0.5)
    prior = source_prior(MODEL, 0, 1.0, found.s_simulation, base)
    beta, sigma = found.draws(20_000, np.random.default_rng(1), base)
    ratios = np.exp(np.linspace(np.log(0.01), np.log(100.0), 25))
    given = [posterior(stacked_rows(MODEL, X, flight), y, np.where(flight, r, 1.0), prior) for r in ratios]
    Z = stacked_rows(MODEL, X, flight)
    unscaled = [np.diag(1.0 / np.where(flight, r, 1.0)) + Z @ np.linalg.solve(prior.Lambda0, Z.T) for r in ratios]
    shapes = [prior.b0 / prior.a0 * one for one in unscaled]
    log_share = np.array([stats.multivariate_t(Z @ prior.m0, one, df=2 * prior.a0).logpdf(y) for one in shapes])
    log_share += np.log(ratios / (1 + ratios) ** 2)
    share = np.exp(log_share - log_share.max())
    share /= share.sum()
    for quantile in np.quantile(sigma, [0.05, 0.25, 0.5, 0.75, 0.95]):
        parts = [stats.invgamma(one.a, scale=one.b / r).cdf(quantile**2) for one, r in zip(given, ratios, strict=True)]
        assert float(share @ np.array(parts)) == pytest.approx(np.mean(sigma <= quantile), abs=0.012)
    mean = share @ np.array([one.mean for one in given])
    assert np.all(np.abs(beta.mean(axis=0) - mean) < 5.0 * beta.std(axis=0) / np.sqrt(len(beta)))
    # The ratio is not known from six flights: a plug-in ratio would make sigma far too certain.
    plug_in = found.posterior.draws(20_000, np.random.default_rng(1))[1] / np.sqrt(found.flight_weight)
    assert np.std(np.log(sigma)) > 1.5 * np.std(np.log(plug_in))


def test_evidence_for_one_prior_over_another_is_that_of_the_scores_free_of_the_surface() -> None:
    """Restricted likelihood (Patterson & Thompson 1971, Biometrika 58, 545-554): of contrasts that no surface moves."""
    X, y, flight = campaign(22, 8, 3)

    def log_evidence(found, sd: float) -> float:
        Z = MODEL.matrix(X)
        free, of_difference = null_space(Z.T), Z * flight[:, None]
        prior = np.diag(np.square(discrepancy_sd(MODEL, sd) / found.s_simulation))
        contrasts, logs = free.T @ y, []
        for ratio in _RATIOS:
            S = free.T @ (np.diag(np.where(flight, 1.0 / ratio, 1.0)) + of_difference @ prior @ of_difference.T) @ free
            left = contrasts @ np.linalg.solve(S, contrasts)
            guess = np.log(ratio / 0.5) - 2.0 * np.log1p(ratio / 0.5)
            logs.append(guess - 0.5 * np.linalg.slogdet(S)[1] - 0.5 * len(contrasts) * np.log(left))
        return float(logsumexp(logs))

    narrow, wide = (fit_sources(MODEL, X, y, flight, prior_sd=sd, ratio=0.5) for sd in (0.3, 4.0))
    expected = log_evidence(wide, 4.0) - log_evidence(narrow, 0.3)
    assert abs(expected) > 0.5
    assert wide.log_evidence - narrow.log_evidence == pytest.approx(expected, abs=1e-5)
