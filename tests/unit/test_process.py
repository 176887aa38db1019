"""The Gaussian process against direct formulas, scipy's distributions and integrals by brute force."""

from __future__ import annotations

import numpy as np
import pytest
from emcee.moves import StretchMove
from process_cases import VAGUE, bowl, factors, fitted, hill, noise_covariance, prior_covariance, spread, trend
from scipy import stats
from scipy.special import logsumexp

from seqrsm.design.quadratic import QuadraticModel
from seqrsm.fit.ensemble import _sampler
from seqrsm.fit.process import MOST_SETTINGS, Blocks, Hyper, Process, bent, prior_covariances, trend_columns

CASES = {
    "two factors": (2, (), 25),
    "one factor": (1, (), 9),
    "a category": (2, (3,), 30),
    "two categories": (1, (3, 2), 30),
    "categories alone": (0, (3, 3), 20),
}


def made(k: int, levels: tuple[int, ...], n: int, seed: int = 2) -> tuple[Process, dict[str, np.ndarray]]:
    """With weights and two blocks, and a new one to come."""
    rng, points = np.random.default_rng(seed), spread(n, k, levels)
    weights, blocks = np.exp(rng.normal(size=n)), Blocks(np.eye(2)[np.arange(n) % 2], new=True)
    y = hill(points[:, :k]) + (2.0 * points[:, -1] if levels else 0.0) + rng.normal(size=n)
    process = fitted(points, y, levels=levels, weights=weights, blocks=blocks)
    return process, {"points": points, "y": y, "weights": weights, "blocks": blocks.columns}


def thetas(process: Process, n: int, seed: int = 3) -> np.ndarray:
    """Hyperparameters from the prior."""
    mean, sd = process._prior
    return mean + sd * np.random.default_rng(seed).normal(size=(n, len(mean)))


def of_scores(theta: np.ndarray, given: dict, k: int, levels: tuple[int, ...]) -> np.ndarray:
    """Covariance of the scores, in units of their scatter."""
    found = prior_covariance(theta, given["points"], given["points"], k, levels)
    found += np.exp(theta[-1]) ** 2 * given["blocks"] @ given["blocks"].T
    return found + noise_covariance(theta, given["weights"])


@pytest.mark.parametrize("case", CASES)
def test_likelihood_is_that_of_the_normal_distribution(case: str) -> None:
    k, levels, n = CASES[case]
    process, given = made(k, levels, n)
    y = (given["y"] - given["y"].mean()) / given["y"].std()
    found = process._log_likelihood(thetas(process, 6))
    for theta, one in zip(thetas(process, 6), found, strict=True):
        of_normal = stats.multivariate_normal(np.zeros(n), of_scores(theta, given, k, levels))
        assert one - 0.5 * n * np.log(2.0 * np.pi) == pytest.approx(of_normal.logpdf(y), rel=1e-9)


def test_likelihood_of_equal_runs_is_that_of_the_normal_distribution() -> None:
    """Six settings, five runs each of a weight of their own: they are one place to the process."""
    rng = np.random.default_rng(1)
    points, weights = np.repeat(spread(6, 2), 5, axis=0), np.repeat(np.exp(rng.normal(size=6)), 5)
    given = {"points": points, "weights": weights, "blocks": np.empty((30, 0))}
    y = hill(points) + rng.normal(size=30)
    process = fitted(points, y, weights=weights)
    thetas_of = thetas(process, 5)
    scores = (y - y.mean()) / y.std()
    for theta, one in zip(thetas_of, process._log_likelihood(thetas_of), strict=True):
        of_normal = stats.multivariate_normal(np.zeros(30), of_scores(theta, given, 2, ()))
        assert one - 15.0 * np.log(2.0 * np.pi) == pytest.approx(of_normal.logpdf(scores), rel=1e-9)


@pytest.mark.parametrize("levels", [(), (2,), (4,), (3, 2)])
def test_rows_of_the_trend_have_the_scalar_products_of_those_written_down(levels: tuple[int, ...]) -> None:
    points = spread(12, 2, levels)
    model = QuadraticModel(factors(2, levels))
    rows, direct = np.prod(model.base(points)[:, trend_columns(model)], axis=-1), trend(points, 2, levels)
    np.testing.assert_allclose(rows @ rows.T, direct @ direct.T, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("bend", [-4.0, -1e-3, -9.99e-5, 0.0, 1.01e-4, 1.0, 4.0])
def test_a_bent_axis_keeps_its_ends_and_rises(bend: float) -> None:
    x = np.linspace(-1.0, 1.0, 201)
    found = bent(x, np.array(bend))
    np.testing.assert_allclose(found[[0, -1]], [-1.0, 1.0], rtol=1e-12)
    assert np.all(np.diff(found) > 0.0)
    slopes = np.diff(found)  # proportional to exp(bend x)
    np.testing.assert_allclose(slopes[1:] / slopes[:-1], np.exp(bend * 0.01), rtol=1e-6)


@pytest.mark.parametrize("case", CASES)
def test_mean_and_covariance_are_those_of_the_textbook(case: str) -> None:
    """Rasmussen & Williams (2006), eqs. 2.23 and 2.24."""
    k, levels, n = CASES[case]
    process, given = made(k, levels, n)
    chosen = thetas(process, 4)
    process._keep(chosen)
    points, y = spread(7, k, levels, seed=8), given["y"]
    points[0] = given["points"][0]
    means, covariances = process.joint(points)
    for d, theta in enumerate(chosen):
        V = of_scores(theta, given, k, levels)
        cross = prior_covariance(theta, points, given["points"], k, levels)
        own = prior_covariance(theta, points, points, k, levels)
        mean = y.mean() + cross @ np.linalg.solve(V, y - y.mean())
        covariance = np.var(y) * (own - cross @ np.linalg.solve(V, cross.T))
        np.testing.assert_allclose(means[d], mean, rtol=1e-8)
        np.testing.assert_allclose(covariances[d], covariance, rtol=1e-6, atol=1e-8 * VAGUE * np.var(y))
    np.testing.assert_allclose(process.means(points), means, rtol=1e-9)
    np.testing.assert_allclose(process.mean(points), means.mean(axis=0), rtol=1e-9)
    same, variances = process.marginals(points)
    np.testing.assert_allclose(same, means, rtol=1e-12)
    np.testing.assert_allclose(
        variances, np.diagonal(covariances, axis1=1, axis2=2), rtol=1e-6, atol=1e-9 * VAGUE * np.var(y)
    )


@pytest.mark.parametrize("case", ["two factors", "a category"])
def test_drawn_surfaces_have_the_mean_and_covariance_of_the_process(case: str) -> None:
    """By random features: the process's part of the prior is right on average over the waves."""
    k, levels, n = CASES[case]
    process, _ = made(k, levels, n)
    process._keep(process._prior[0][None, :])
    points, rng = spread(5, k, levels, seed=8), np.random.default_rng(6)
    drawn = [process.draw(rng) for _ in range(600)]
    values = np.array([surface(points) for surface, _, _ in drawn])
    (mean,), (covariance,) = process.joint(points)
    se = np.sqrt(np.diag(covariance) / len(values))
    np.testing.assert_array_less(np.abs(values.mean(axis=0) - mean), 5.0 * se)
    sd = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(np.cov(values.T) / np.outer(sd, sd), covariance / np.outer(sd, sd), atol=0.25)
    assert drawn[0][1] ** 2 == pytest.approx(process.noise_variance[0], rel=1e-12)
    assert drawn[0][2] == pytest.approx(process.scatter * process.hyper.block[0], rel=1e-12)


# evidence -------------------------------------------------------------------------------------------------------------


def one_factor(surface: str) -> tuple[Process, np.ndarray, np.ndarray]:
    rng, points = np.random.default_rng(11), np.linspace(-1.0, 1.0, 12)[:, None]
    of = {"quadratic": bowl(points), "kink": 60.0 - 20.0 * np.abs(points[:, 0] - 0.1)}[surface]
    weights = np.exp(0.5 * rng.normal(size=12))
    y = of + rng.normal(size=12) / np.sqrt(weights)
    return fitted(points, y, weights=weights), (y - y.mean()) / y.std(), weights


def of_quadratic(points: np.ndarray, y: np.ndarray, weights: np.ndarray, fixed: float | np.ndarray = 0.0) -> float:
    """Log evidence of the quadratic, summed over a fine grid of the two scales; ``fixed`` is known of the scores."""
    rows, axis = np.hstack([points, points**2]), np.linspace(-5.0, 5.0, 81)
    z, t = np.meshgrid(axis, axis)
    of_trend, of_noise = ((0.5 * np.exp(z)) ** 2)[..., None, None], ((0.2 * np.exp(1.2 * t)) ** 2)[..., None, None]
    V = fixed + VAGUE + of_trend * (rows @ rows.T) + of_noise * np.diag(1.0 / weights)
    left = np.sum(y * np.linalg.solve(V, np.broadcast_to(y[:, None], (*z.shape, len(y), 1)))[..., 0], axis=-1)
    logs = -0.5 * (np.linalg.slogdet(V).logabsdet + left + z**2 + t**2)
    return float(logsumexp(logs)) + 2.0 * np.log(axis[1] - axis[0]) - np.log(2.0 * np.pi)


@pytest.mark.parametrize("surface", ["quadratic", "kink"])
def test_bayes_factor_is_the_ratio_of_two_integrals(surface: str) -> None:
    process, y, weights = one_factor(surface)
    quadratic = process._log_evidence_of_quadratic()
    assert quadratic == pytest.approx(of_quadratic(process._points, y, weights), abs=5e-3)
    logs = process._log_likelihood(thetas(process, 200_000, seed=21))
    drawn = float(logsumexp(logs)) - np.log(len(logs))
    shares = np.exp(logs - logsumexp(logs))
    effective = 1.0 / float(np.sum(shares**2))
    assert effective > 500.0
    error = np.sqrt(1.0 / effective + 1.0 / process.effective_draws)
    assert process.log_bayes_factor == pytest.approx(drawn - quadratic, abs=4.0 * error)


@pytest.mark.parametrize("n", [60, 240])
def test_evidence_of_the_quadratic_is_as_exact_with_many_runs(n: int) -> None:
    """The noise is known to 1 / sqrt(2 n) of itself: between nodes a third apart it was lost."""
    points = np.linspace(-1.0, 1.0, n)[:, None]
    for seed in range(2):
        y = bowl(points) + 6.0 * np.random.default_rng(seed).normal(size=n)
        process = fitted(points, y)
        rows, scores = np.hstack([np.full_like(points, np.sqrt(VAGUE)), points, points**2]), (y - y.mean()) / y.std()
        of_trend = 0.5 * np.exp(np.linspace(-4.0, 4.0, 81))
        at = np.log(np.std(scores - rows @ np.linalg.lstsq(rows, scores, rcond=None)[0]))
        of_noise = np.exp(at + np.linspace(-8.0, 8.0, 161) / np.sqrt(2.0 * n))  # where the likelihood is not nothing
        logs = np.empty((81, 161))
        for i, trend_sd in enumerate(of_trend):  # by the matrix determinant lemma and Woodbury's identity
            sized = rows * [1.0, trend_sd, trend_sd]
            gram, moment = sized.T @ sized, sized.T @ scores
            for j, noise in enumerate(of_noise):
                inner = np.eye(3) + gram / noise**2
                left = scores @ scores / noise**2 - moment @ np.linalg.solve(inner, moment) / noise**4
                logs[i, j] = -0.5 * (2.0 * n * np.log(noise) + np.log(np.linalg.det(inner)) + left)
        logs += stats.norm.logpdf(np.log(of_trend / 0.5))[:, None] + stats.norm.logpdf(
            np.log(of_noise / 0.2), scale=1.2
        )
        steps = np.log(np.log(of_trend[1] / of_trend[0])) + np.log(np.log(of_noise[1] / of_noise[0]))
        expected = float(logsumexp(logs) + steps)
        assert process._log_evidence_of_quadratic() == pytest.approx(expected, abs=0.02)


@pytest.mark.slow
def test_a_quadratic_is_not_taken_for_another_surface_the_more_runs_there_are() -> None:
    for n, seed in ((300, 9), (1200, 7), (1200, 8)):  # 5, 25 and 29 before
        points = np.linspace(-1.0, 1.0, n)[:, None]
        y = 80.0 - 20.0 * (points[:, 0] + 0.4) ** 2 + 6.0 * np.random.default_rng(seed).normal(size=n)
        assert fitted(points, y).log_bayes_factor < 0.0


def test_evidence_of_the_quadratic_is_averaged_over_the_size_of_blocks() -> None:
    points, blocks = np.linspace(-1.0, 1.0, 12)[:, None], np.eye(4)[np.arange(12) % 4]
    y = bowl(points) + 3.0 * np.array([1.0, -1.0, 0.5, 0.0])[np.arange(12) % 4]
    y += np.random.default_rng(11).normal(size=12)
    process, scores = fitted(points, y, blocks=Blocks(blocks, new=True)), (y - y.mean()) / y.std()
    nodes = np.linspace(-4.0, 4.0, 17)
    logs = [
        of_quadratic(process._points, scores, np.ones(12), (0.2 * np.exp(1.2 * z)) ** 2 * blocks @ blocks.T)
        for z in nodes
    ]
    expected = logsumexp(logs, b=0.5 * stats.norm.pdf(nodes))
    assert process._log_evidence_of_quadratic() == pytest.approx(expected, abs=0.01)


def test_the_size_of_blocks_is_found() -> None:
    """Eight days that differ by a standard deviation of 5, runs by 1: what the scores say of both, and of the mean."""
    rng, points, at = np.random.default_rng(4), spread(64, 2), spread(30, 2, seed=9)
    days = np.arange(64) % 8
    effects = 5.0 * stats.norm.ppf((np.arange(8) + 0.5) / 8.0)
    y = hill(points) + effects[days] + rng.normal(size=64)
    process = fitted(points, y, blocks=Blocks(np.eye(8)[days], new=True))
    assert np.sqrt(np.mean(process.noise_variance)) == pytest.approx(1.0, rel=0.3)
    assert np.sqrt(np.median(process.common_variance)) == pytest.approx(5.0, rel=0.3)
    np.testing.assert_array_equal(process.common_variance, process.block_variance)
    means, variances = process.marginals(at)
    assert np.mean(np.abs(means.mean(axis=0) - hill(at)) < 2.0 * np.sqrt(variances.mean(axis=0))) > 0.9
    centred = np.eye(8)[days] - 1.0 / 8.0  # the mean of the eight: known far better
    of_mean = fitted(points, y, blocks=Blocks(centred, new=False))
    assert np.all(of_mean.common_variance == 0.0)
    assert np.median(of_mean.marginals(at)[1]) < 0.3 * np.median(variances)


def test_bayes_factor_tells_a_narrow_top_from_a_quadratic() -> None:
    points, rng = spread(40, 2), np.random.default_rng(4)
    assert fitted(points, hill(points) + rng.normal(size=40)).log_bayes_factor > 5.0
    assert fitted(points, bowl(points) + rng.normal(size=40)).log_bayes_factor < 1.0


def test_bayes_factors_of_seeds_differ_by_little() -> None:
    """A natural log of 3 turns a belief: draws of another seed must not."""
    for k, levels in ((2, ()), (3, (3,))):
        points = spread(45, k, levels)
        y = hill(points[:, :k]) + np.random.default_rng(1).normal(size=45)
        found = [fitted(points, y, levels=levels, seed=seed).log_bayes_factor for seed in range(4)]
        assert np.std(found, ddof=1) < 1.0


# invariance -----------------------------------------------------------------------------------------------------------


def test_mirrored_scores_give_the_mirrored_process() -> None:
    points = spread(20, 2)
    y = hill(points) + np.random.default_rng(1).normal(size=20)
    up, down = fitted(points, y), fitted(points, -y)
    assert up.log_bayes_factor == down.log_bayes_factor
    at = spread(9, 2, seed=3)
    np.testing.assert_array_equal(up.means(at), -down.means(at))
    np.testing.assert_array_equal(up.noise_variance, down.noise_variance)


@pytest.mark.parametrize("scale", [2.0**30, 2.0**-30])
def test_unit_of_the_scores_does_not_matter(scale: float) -> None:
    points, at = spread(20, 2), spread(9, 2, seed=3)
    y = hill(points) + np.random.default_rng(1).normal(size=20)
    one, other = fitted(points, y), fitted(points, scale * y)
    assert one.log_bayes_factor == other.log_bayes_factor  # a power of two: to the last bit
    np.testing.assert_array_equal(scale * one.means(at), other.means(at))
    np.testing.assert_array_equal(scale**2 * one.marginals(at)[1], other.marginals(at)[1])


def test_seed_decides() -> None:
    points = spread(15, 2)
    one, same, other = (fitted(points, hill(points), seed=seed) for seed in (1, 1, 2))
    assert one.log_bayes_factor == same.log_bayes_factor != other.log_bayes_factor
    np.testing.assert_array_equal(one.hyper.lengths, same.hyper.lengths)


# extremes -------------------------------------------------------------------------------------------------------------


def sound(process: Process, points: np.ndarray) -> None:
    """Finite, with variances that are none below zero, and a mean that is near what was scored."""
    means, variances = process.marginals(points)
    assert np.all(np.isfinite(means))
    assert np.all(np.isfinite(variances))
    assert np.all(variances >= 0.0)
    assert np.isfinite(process.log_bayes_factor)
    assert 1.0 <= process.effective_draws <= 1024.0
    assert np.all(process.noise_variance > 0.0)
    np.linalg.cholesky(process.joint(points)[1] + 1e-6 * process.scatter**2 * np.eye(len(points)))


def test_eight_runs_and_one_degree_of_freedom() -> None:
    rng, points = np.random.default_rng(2), spread(11, 3)  # 10 terms
    sound(fitted(points, bowl(points) + rng.normal(size=11)), spread(6, 3, seed=9))
    points = spread(8, 1)
    sound(fitted(points, bowl(points) + rng.normal(size=8)), spread(6, 1, seed=9))


def test_settings_that_are_all_repeated() -> None:
    points = np.repeat(spread(8, 2), 3, axis=0)
    y = bowl(points) + np.random.default_rng(3).normal(size=24)
    process = fitted(points, y)
    sound(process, points[::3])
    np.testing.assert_allclose(process.mean(points[::3]), y.reshape(-1, 3).mean(axis=1), atol=3.0)


def test_factors_without_effect_fall_out() -> None:
    """Two of five have one: what is told of the top hardly depends on the others."""
    points = spread(50, 5, seed=1)
    y = (
        50.0
        + 30.0 * np.exp(-3.0 * np.sum((points[:, :2] - 0.3) ** 2, axis=1))
        + np.random.default_rng(1).normal(size=50)
    )
    process = fitted(points, y)
    lengths = np.median(process.hyper.lengths, axis=0)
    assert np.all(lengths[:2] < 1.5)
    assert np.all(lengths[2:] > 20.0)
    _, variances = process.marginals(np.array([[0.3, 0.3, 0.0, 0.0, 0.0], [0.3, 0.3, 1.0, 1.0, 1.0]]))
    middle, corner = np.sqrt(np.mean(variances, axis=0))
    assert corner < 1.4 * middle


def test_eight_factors() -> None:
    points = spread(60, 8)
    process = fitted(points, bowl(points) + np.random.default_rng(3).normal(size=60))
    sound(process, spread(6, 8, seed=9))
    assert process.hyper.lengths.shape == (100, 8)
    assert process.some(20).hyper.lengths.shape == (20, 8)


def test_scores_of_nothing_and_of_everything() -> None:
    points = spread(24, 2)
    sound(fitted(points, np.where(points[:, 0] > 0.0, 100.0, 0.0)), spread(6, 2, seed=9))


def test_one_score_far_from_all_others() -> None:
    points, y = spread(20, 2), np.zeros(20)
    y[7] = 1e6
    sound(fitted(points, y), spread(6, 2, seed=9))


def test_weights_that_span_a_million() -> None:
    rng, points = np.random.default_rng(6), spread(30, 2)
    weights = np.exp(rng.uniform(np.log(1e-3), np.log(1e3), 30))
    y = bowl(points) + rng.normal(size=30) / np.sqrt(weights)
    process = fitted(points, y, weights=weights)
    sound(process, points)
    heavy = weights > 100.0
    np.testing.assert_allclose(process.mean(points)[heavy], y[heavy], atol=0.5)


@pytest.mark.parametrize("scale", [1e9, 1e-9])
def test_large_and_small_scores(scale: float) -> None:
    points = spread(20, 2)
    y = hill(points) + np.random.default_rng(1).normal(size=20)
    process = fitted(points, scale * y)
    sound(process, spread(6, 2, seed=9))
    assert process.log_bayes_factor == pytest.approx(fitted(points, y).log_bayes_factor, abs=1.0)
    np.testing.assert_allclose(process.mean(points), scale * y, atol=8.0 * scale)


def test_exact_quadratic_without_noise() -> None:
    points, at = spread(20, 2), spread(6, 2, seed=9)
    process = fitted(points, bowl(points))
    sound(process, at)
    np.testing.assert_allclose(process.mean(at), bowl(at), atol=0.5)


@pytest.mark.slow
def test_most_runs() -> None:
    points = spread(MOST_SETTINGS, 2)
    sound(fitted(points, hill(points) + np.random.default_rng(1).normal(size=MOST_SETTINGS)), spread(6, 2, seed=9))


def test_hyperparameters_by_name() -> None:
    theta = np.array([[0.1, 0.2, 0.3, 0.0, -1.0, 2.0, -1.0, 3.0]])
    h = Hyper.of(theta, 2, categories=True, sources=False, blocks=False)
    assert (h.trend[0], h.process[0], h.noise[0]) == tuple(np.exp([0.1, 0.2, 0.3]))
    assert h.between[0] == 0.5
    far = ((2.0 - np.log(1.2)) / 0.9) ** 2
    np.testing.assert_allclose(h.lengths, np.exp([[-1.0, 2.0 + 2.0 * far]]), rtol=1e-14)
    np.testing.assert_array_equal(h.bends, [[-1.0, 3.0]])
    assert Hyper.of(theta[:, :5], 1, categories=False, sources=False, blocks=False).between[0] == 1.0
    assert (h.difference[0], h.other_noise[0], h.block[0]) == (0.0, 0.0, 0.0)
    two = Hyper.of(np.append(theta, [[0.5, -0.5, -1.5]], axis=1), 2, categories=True, sources=True, blocks=True)
    assert two.block[0] == np.exp(-1.5)
    assert (two.difference[0], two.other_noise[0]) == tuple(np.exp([0.5, 0.3]))
    assert two.noise[0] == pytest.approx(np.exp(0.3 - 0.5))  # of the own source: a share of the other's
    np.testing.assert_array_equal(two.bends, h.bends)


def test_an_interrupt_prints_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    def interrupted(_: np.ndarray) -> np.ndarray:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        _sampler(4, 2, interrupted, [(StretchMove(), 1.0)]).run_mcmc(np.eye(4, 2), 4)
    told = capsys.readouterr()
    assert told.out == told.err == ""


def test_covariances_of_the_prior_are_those_written_down():
    """Logarithms of scale, process and noise, the logit between levels, of each factor a length and a bend."""
    points = spread(12, 2, (3,))
    median = [np.log(0.5), np.log(0.6), np.log(0.2), 0.0, np.log(1.2), np.log(1.2), 0.0, 0.0]
    sd = [1.0, 1.0, 1.2, 1.2, 0.9, 0.9, 0.7, 0.7]
    rng = np.random.default_rng(4)
    for found in prior_covariances(QuadraticModel(factors(2, (3,))), points, 3, np.random.default_rng(4)):
        theta = median + sd * rng.standard_normal(8)
        np.testing.assert_allclose(found, prior_covariance(theta, points, points, 2, (3,)) - VAGUE, atol=1e-9)
