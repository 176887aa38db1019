"""A process of simulations and flights against the normal distribution written down entry by entry."""

from __future__ import annotations

import numpy as np
import pytest
from process_cases import JITTER, VAGUE, factors, hill, prior_covariance, spread
from scipy import stats
from scipy.special import logsumexp

from seqrsm.design.quadratic import QuadraticModel
from seqrsm.fit.process import Blocks, Process, Sources

K, LEVELS, N = 2, (3,), 30
MODEL = QuadraticModel(factors(K, LEVELS))
SD = np.linspace(0.5, 2.0, MODEL.p)


def given() -> dict[str, np.ndarray]:
    """Flights, every third run, score five less; the last two repeat the first two but for their source."""
    rng, points = np.random.default_rng(2), spread(N, K, LEVELS)
    flights = np.arange(N) % 3 == 0
    points[-2:], flights[-2:] = points[:2], ~flights[:2]
    y = hill(points[:, :K]) + points[:, -1] - 5.0 * flights + np.where(flights, 0.5, 2.0) * rng.normal(size=N)
    days = np.where(np.arange(N) % 2, 1.0, -1.0)[:, None] * flights[:, None]
    return {"points": points, "y": y, "flights": flights, "weights": np.exp(rng.normal(size=N)), "days": days}


def process_of(data: dict[str, np.ndarray], seed: int = 5) -> Process:
    sources = Sources(data["flights"], SD, 4.0)
    rng = np.random.default_rng(seed)
    blocks = Blocks(data["days"], new=False)
    return Process(MODEL, data["points"], data["y"], data["weights"], rng, sources, blocks)


def difference(theta: np.ndarray, a: np.ndarray, b: np.ndarray, scatter: float) -> np.ndarray:
    """Covariance of the flights' difference, in units of the scatter."""
    return np.exp(theta[-3]) ** 2 * (MODEL.matrix(a) * (SD / scatter) ** 2) @ MODEL.matrix(b).T


def of_scores(theta: np.ndarray, data: dict[str, np.ndarray]) -> np.ndarray:
    """Covariance of the scores, in units of their scatter."""
    points, flights, scatter = data["points"], data["flights"], float(np.std(data["y"]))
    found = prior_covariance(theta, points, points, K, LEVELS)
    found += np.exp(theta[-1]) ** 2 * data["days"] @ data["days"].T
    found += difference(theta, points, points, scatter) * np.outer(flights, flights)
    noise = np.exp(theta[2]) * np.where(flights, np.exp(theta[-2]), 1.0)  # flights are the own source
    return found + np.diag(noise**2 / data["weights"] + JITTER)


def test_likelihood_is_that_of_the_normal_distribution() -> None:
    data = given()
    process = process_of(data)
    mean, sd = process._prior
    thetas = mean + sd * np.random.default_rng(3).normal(size=(6, len(mean)))
    y = (data["y"] - data["y"].mean()) / data["y"].std()
    for theta, found in zip(thetas, process._log_likelihood(thetas), strict=True):
        of_normal = stats.multivariate_normal(np.zeros(N), of_scores(theta, data))
        assert found - 0.5 * N * np.log(2.0 * np.pi) == pytest.approx(of_normal.logpdf(y), rel=1e-9)


def test_mean_and_covariance_are_those_of_flights() -> None:
    """Rasmussen & Williams (2006), eqs. 2.23 and 2.24, with new points that are flights."""
    data, at = given(), spread(7, K, LEVELS, seed=9)
    process = process_of(data)
    mean, sd = process._prior
    theta = mean + sd * np.random.default_rng(4).normal(size=(3, len(mean)))
    process._keep(theta)
    scatter = float(np.std(data["y"]))
    means, covariances = process.joint(at)
    _, variances = process.marginals(at)
    for d, one in enumerate(theta):
        V = of_scores(one, data)
        cross = prior_covariance(one, at, data["points"], K, LEVELS)
        cross += difference(one, at, data["points"], scatter) * data["flights"]
        inside = prior_covariance(one, at, at, K, LEVELS) + difference(one, at, at, scatter)
        told = data["y"].mean() + cross @ np.linalg.solve(V, data["y"] - data["y"].mean())
        left = scatter**2 * (inside - cross @ np.linalg.solve(V, cross.T))
        np.testing.assert_allclose(means[d], told, rtol=1e-6)
        np.testing.assert_allclose(process.means(at)[d], told, rtol=1e-6)
        np.testing.assert_allclose(covariances[d], left, rtol=1e-5, atol=1e-5 * np.abs(left).max())
        np.testing.assert_allclose(variances[d], np.diag(left), rtol=1e-5)


def test_drawn_surfaces_have_the_mean_and_covariance_of_flights() -> None:
    data, at = given(), spread(4, K, LEVELS, seed=9)
    process = process_of(data)
    process._keep(np.asarray(process._prior[0])[None, :])
    (mean,), (covariance,) = process.joint(at)
    rng = np.random.default_rng(1)
    drawn = np.array([process.draw(rng)[0](at) for _ in range(1500)])
    sd = np.sqrt(np.diag(covariance))
    assert np.all(np.abs(drawn.mean(axis=0) - mean) < 4.0 * sd / np.sqrt(1500.0))
    np.testing.assert_allclose(drawn.std(axis=0), sd, rtol=0.1)


def test_flights_differ_and_scatter_less() -> None:
    """Flights are five less and scatter by 0.5, simulations by 4; both are found."""
    rng, points, at = np.random.default_rng(3), spread(60, K, LEVELS), spread(40, K, LEVELS, seed=11)
    flights = np.arange(60) % 2 == 0
    truth = lambda x: hill(x[:, :K]) + x[:, -1]  # noqa: E731
    y = truth(points) - 5.0 * flights + np.where(flights, 0.5, 4.0) * rng.normal(size=60)
    sources = Sources(flights, np.full(MODEL.p, 4.0), 4.0)
    process = Process(MODEL, points, y, np.ones(60), np.random.default_rng(1), sources)
    assert np.sqrt(process.variance_of_runs[~flights]) == pytest.approx(4.0, rel=0.35)
    assert np.all(process.variance_of_runs[flights] < 0.25 * process.variance_of_runs[~flights])
    assert abs(float(np.mean(process.mean(at) - truth(at) + 5.0))) < 1.0


def test_evidence_of_the_quadratic_is_the_integral_written_down() -> None:
    """Over the scales of coefficients and noise; a flight counts for four simulations, the difference is as stated."""
    data = given()
    points, flights, scatter = data["points"], data["flights"], float(np.std(data["y"]))
    y = (data["y"] - data["y"].mean()) / scatter
    differs = (MODEL.matrix(points) * (SD / scatter) ** 2) @ MODEL.matrix(points).T * np.outer(flights, flights)
    of_days = data["days"] @ data["days"].T
    rows, weights = MODEL.matrix(points)[:, 1:], data["weights"] * np.where(flights, 4.0, 1.0)
    z, fine = np.linspace(-3.5, 3.5, 25), np.linspace(-3.5, 3.5, 121)
    logs = []
    for a in z:
        b, c = (one[..., None, None] for one in np.meshgrid(fine, z))
        V = VAGUE + differs + (0.5 * np.exp(a)) ** 2 * rows @ rows.T + (0.2 * np.exp(1.2 * c)) ** 2 * of_days
        V = V + ((0.2 * np.exp(1.2 * b)) ** 2 + JITTER) * np.diag(1.0 / weights)
        left = np.linalg.solve(V, np.broadcast_to(y[:, None], (25, 121, N, 1)))[..., 0] @ y
        logs.append(-0.5 * (np.linalg.slogdet(V).logabsdet + left + a**2 + b[..., 0, 0] ** 2 + c[..., 0, 0] ** 2))
    steps = 2.0 * np.log(z[1] - z[0]) + np.log(fine[1] - fine[0])
    expected = logsumexp(logs) + steps - 1.5 * np.log(2.0 * np.pi)
    assert process_of(data)._log_evidence_of_quadratic() == pytest.approx(expected, abs=2e-3)


def test_without_difference_and_with_equal_noise_sources_are_one() -> None:
    """The quadratic's evidence does not know of a source that says the same."""
    data = given()
    same = Sources(data["flights"], np.zeros(MODEL.p), 1.0)
    arguments, blocks = (MODEL, data["points"], data["y"], data["weights"]), Blocks(data["days"], new=False)
    one, two = (Process(*arguments, np.random.default_rng(1), sources, blocks) for sources in (None, same))
    assert two._log_evidence_of_quadratic() == pytest.approx(one._log_evidence_of_quadratic(), rel=1e-9)
