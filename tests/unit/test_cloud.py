"""The next runs that a process asks for: where they may be, what counts as known, and against direct conditioning."""

from __future__ import annotations

import numpy as np
import pytest
from process_cases import bowl, fitted, hill, spread

from seqrsm.design.constraints import Constraint
from seqrsm.design.factors import CategoricalFactor, ContinuousFactor, DiscreteFactor
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.fit.process import Process
from seqrsm.propose.cloud import Cloud, Runs, _Ahead, climb, propose_from_process

BOX = Region(tuple(ContinuousFactor(f"x{i}", -1.0, 1.0) for i in range(2)))
TOP = np.array([0.3, 0.3])
NONE = np.empty((0, 2))


@pytest.fixture(scope="module")
def found() -> tuple[Process, np.ndarray]:
    """A narrow top at (0.3, 0.3), seen through noise at twenty settings."""
    points = np.round(spread(20, 2), 3)
    return fitted(points, hill(points) + np.random.default_rng(1).normal(size=20)), points


def proposed(process: Process, made: np.ndarray, n: int, pending=NONE, barred=None, **more) -> np.ndarray:
    waits = np.arange(len(made) + len(pending)) >= len(made)
    settings = np.vstack([made, pending])
    chosen = propose_from_process(process, BOX, TOP, Runs(settings, waits, barred), n, **{"seed": 3} | more)
    return np.array([one.point for one in chosen])


def test_runs_lie_where_the_optimum_may_be(found) -> None:
    process, made = found
    points = proposed(process, made, 6)
    assert len(points) == 6
    assert np.mean(np.linalg.norm(points - TOP, axis=1) < 0.8) > 0.5
    assert len(proposed(process, made, 0)) == 0


def test_seed_decides(found) -> None:
    process, made = found
    np.testing.assert_array_equal(proposed(process, made, 4), proposed(process, made, 4))
    assert not np.array_equal(proposed(process, made, 4), proposed(process, made, 4, seed=4))


def test_two_calls_with_the_first_runs_pending_tell_as_much_as_one(found) -> None:
    """Of the surface round the optimum, by conditioning; their places differ, being drawn at random."""
    process, made = found
    cloud = Cloud(process, BOX, TOP, made, 1.0, np.random.default_rng(5))

    def left(runs: np.ndarray) -> float:
        at = [int(np.argmin(np.sum(np.square(cloud.points - run), axis=1))) for run in runs]
        across = cloud.covariance[at]
        told = across.T @ np.linalg.solve(across[:, at] + cloud.noise * np.eye(len(at)), across)
        near = np.linalg.norm(cloud.points - TOP, axis=1) < 0.5
        return float(np.diag(cloud.covariance - told)[near].mean())

    once, twice, again = [], [], []
    for seed in range(12):
        four = proposed(process, made, 4, seed=seed)
        once.append(left(four))
        twice.append(left(np.vstack([four[:2], proposed(process, made, 2, pending=four[:2], seed=seed)])))
        again.append(left(np.vstack([four[:2], four[:2]])))
    assert np.mean(twice) == pytest.approx(np.mean(once), rel=0.05)
    assert np.mean(again) > 1.08 * np.mean(once)


def test_runs_in_hand_are_not_asked_for_again(found) -> None:
    """A run that is pending, made many times over, tells all there is to be told there."""
    process, made = found
    first = proposed(process, made, 1)
    after = proposed(process, made, 1, pending=np.repeat(first, 500, axis=0))
    assert np.linalg.norm(after[0] - first[0]) > 0.01


def test_the_best_forty_of_many_executed_settings_may_be_repeated() -> None:
    points = np.round(spread(70, 2), 3)
    process = fitted(points, hill(points) + np.random.default_rng(1).normal(size=70))
    cloud = Cloud(process, BOX, TOP, points, 1.0, np.random.default_rng(2))
    best = points[np.argsort(-process.mean(points), kind="stable")[:40]]
    kept = cloud.points[cloud.executed]
    np.testing.assert_array_equal(kept[np.lexsort(kept.T)], best[np.lexsort(best.T)])


def test_settings_that_failed_are_left_alone(found) -> None:
    process, made = found
    barred = proposed(process, made, 3)
    points = proposed(process, made, 6, barred=barred)
    assert np.all(np.max(np.abs(points[:, None] - barred[None]), axis=2) > 0.1)
    everything = np.stack(np.meshgrid(*[np.linspace(-1.0, 1.0, 21)] * 2), axis=-1).reshape(-1, 2)
    assert len(proposed(process, made, 2, barred=everything)) == 2  # nothing is left: as if none were barred
    np.testing.assert_array_equal(proposed(process, made, 3, barred=NONE), barred)


def test_minimizing_mirrors_maximizing(found) -> None:
    _, made = found
    y = hill(made) + np.random.default_rng(2).normal(size=len(made))
    up, down = fitted(made, y), fitted(made, -y)
    np.testing.assert_array_equal(proposed(up, made, 4), proposed(down, made, 4, sign=-1.0))


def test_gain_is_what_conditioning_takes_off(found) -> None:
    """First run: variance of the value, and of the loss over drawn optima, against matrices solved anew."""
    process, made = found
    rng = np.random.default_rng(3)
    cloud = Cloud(process, BOX, TOP, made, 1.0, rng)
    assert cloud.noise == pytest.approx(np.mean((process.scatter * process.some(20).hyper.noise) ** 2))
    best = np.argmax(cloud.draws(12, rng), axis=1)
    (one,) = propose_from_process(process, BOX, TOP, Runs(made, np.zeros(len(made), dtype=bool)), 1, seed=3, weight=2.0)
    index = int(np.argmin(np.sum((cloud.points - one.point) ** 2, axis=1)))

    def doubt(covariance: np.ndarray) -> tuple[float, float]:
        contrast = np.eye(len(covariance))[best] - np.eye(len(covariance))[cloud.hat]
        loss = np.sum(contrast @ covariance * contrast, axis=1)
        return float(covariance[cloud.hat, cloud.hat]), float(loss.mean())

    def after(at: int) -> np.ndarray:
        row = cloud.covariance[at]
        return cloud.covariance - np.outer(row, row) / (row[at] + cloud.noise / 2.0)

    gains = [sum(doubt(cloud.covariance)) - sum(doubt(after(at))) for at in range(len(cloud.points))]
    assert one.gain == pytest.approx(gains[index], rel=1e-9)
    assert gains[index] == pytest.approx(max(gains), rel=1e-9)
    np.testing.assert_array_equal(cloud.points[cloud.hat], TOP)


def test_counting_run_by_run_is_counting_them_together() -> None:
    rng = np.random.default_rng(5)
    half = rng.normal(size=(12, 12))
    before, noise = half @ half.T, 1.3
    for block in (0.0, 2.5):  # runs of a new block share its effect
        ahead, runs = _Ahead(before, noise, block), [3, 7, 3, 0]
        for index in runs:
            ahead.count(index)
        cross = before[:, runs]
        of_runs = before[np.ix_(runs, runs)] + block + noise * np.eye(len(runs))
        wanted = before - cross @ np.linalg.solve(of_runs, cross.T)
        np.testing.assert_allclose(ahead.covariance, wanted, rtol=1e-8, atol=1e-10)
        left = before + block - (before[:, runs] + block) @ np.linalg.solve(of_runs, before[runs] + block)
        np.testing.assert_allclose(ahead.total, np.diag(left) + noise, rtol=1e-8)
        left = before - cross @ np.linalg.solve(of_runs, before[runs] + block)
        np.testing.assert_allclose(ahead.cross, left, rtol=1e-8, atol=1e-10)


def test_draws_have_the_mean_and_covariance_of_the_process(found) -> None:
    process, made = found
    cloud = Cloud(process, BOX, TOP, made, 1.0, np.random.default_rng(3))
    draws = cloud.draws(400, np.random.default_rng(4))
    assert draws.shape == (400 * len(cloud.means), len(cloud.points))
    np.testing.assert_allclose(cloud.mean, process.some(20).mean(cloud.points), rtol=1e-9)
    sd = np.sqrt(np.diag(cloud.covariance))
    np.testing.assert_allclose(draws.mean(axis=0), cloud.mean, atol=float(5.0 * sd.max() / np.sqrt(len(draws))))
    np.testing.assert_allclose(draws.std(axis=0), sd, rtol=0.1)
    at = cloud.points[cloud.executed]
    assert len(at) == len(made)
    assert {tuple(row) for row in at} == {tuple(row) for row in made}


def test_climb_finds_the_top_of_a_known_surface() -> None:
    starts = spread(30, 2, seed=4)
    found = climb(hill, BOX, starts, np.random.default_rng(1))
    np.testing.assert_allclose(found[0], TOP, atol=0.02)
    assert np.all(np.diff(hill(found)) <= 0.0)


# regions --------------------------------------------------------------------------------------------------------------

HARD = Region(
    (
        ContinuousFactor("frequency", 1.0, 18.0, scale="log"),
        DiscreteFactor("looks", (1.0, 2.0, 4.0, 16.0), scale="log"),
        CategoricalFactor("polarization", ("HH", "HV", "VV")),
    ),
    (Constraint("looks <= frequency"), Constraint("frequency <= 12")),
)


def hard_scores(points: np.ndarray) -> np.ndarray:
    return 60.0 - 8.0 * np.abs(points[:, 0] - 0.2) + 3.0 * points[:, 1] - 2.0 * points[:, 2]


@pytest.mark.parametrize("region", [HARD, Region(HARD.factors[1:])], ids=["constraints", "a grid"])
def test_runs_are_settings_of_the_region(region: Region) -> None:
    rng = np.random.default_rng(6)
    made = region.sample(30, rng)
    y = hard_scores(made if region.k == 3 else np.column_stack([np.zeros(30), made])) + rng.normal(size=30)
    process = Process(QuadraticModel(region.factors), made, y, np.ones(30), rng)
    best = made[int(np.argmax(y))]
    found = propose_from_process(process, region, best, Runs(made, np.zeros(30, dtype=bool)), 8, seed=2)
    points = np.array([one.point for one in found])
    assert np.all(region.feasible(points))
    for settings in region.decode(points):
        assert settings["looks"] in (1.0, 2.0, 4.0, 16.0)
        assert settings["polarization"] in ("HH", "HV", "VV")
    for one in found:
        again = bool(np.any(np.all(np.isclose(made, one.point, atol=1e-9), axis=1)))
        earlier = [other for other in found if np.array_equal(other.point, one.point)]
        assert one.repeats == (again or one is not earlier[0])
        assert one.repeats == ("repeats settings run or proposed before" in one.why)


def test_runs_made_outside_the_region_are_not_repeated() -> None:
    rng, made = np.random.default_rng(6), spread(24, 2)
    region = Region(BOX.factors, (Constraint("x0 <= 0.1"),))
    process = fitted(made, bowl(made) + rng.normal(size=24))
    waits = np.arange(24) >= 20  # pending ones, too, from before the constraint
    best = np.array([0.1, 0.2])
    points = np.array([one.point for one in propose_from_process(process, region, best, Runs(made, waits), 6)])
    assert np.all(region.feasible(points))


def test_eight_factors() -> None:
    points = spread(60, 8)
    region = Region(tuple(ContinuousFactor(f"x{i}", -1.0, 1.0) for i in range(8)))
    process = fitted(points, bowl(points) + np.random.default_rng(3).normal(size=60))
    found = propose_from_process(process, region, np.full(8, 0.2), Runs(points, np.zeros(60, dtype=bool)), 4)
    assert np.all(region.feasible(np.array([one.point for one in found])))
    assert all(np.isfinite(one.gain) and one.gain > 0.0 for one in found)


@pytest.mark.parametrize("scale", [1e9, 1e-9])
def test_unit_of_the_scores_does_not_matter(found, scale: float) -> None:
    _, made = found
    y = hill(made) + np.random.default_rng(1).normal(size=len(made))
    points = proposed(fitted(made, scale * y), made, 4)
    assert np.all(np.isfinite(points))
    assert np.mean(np.linalg.norm(points - TOP, axis=1) < 0.8) >= 0.5


def test_a_surface_known_without_error() -> None:
    points = spread(20, 2)
    process = fitted(points, bowl(points))
    assert np.all(np.isfinite(proposed(process, points, 3)))
    cloud = Cloud(process, BOX, TOP, points, 1.0, np.random.default_rng(3))
    draws = cloud.draws(2, np.random.default_rng(4))
    # Single draws may still be bent: the chain is short, and scores without noise leave it little room to move in.
    np.testing.assert_allclose(np.median(draws, axis=0), bowl(cloud.points), atol=1.0)
    np.testing.assert_allclose(draws, np.tile(bowl(cloud.points), (len(draws), 1)), atol=10.0)


def test_optima_of_draws_spread_as_widely_with_many_factors() -> None:
    """Of eight factors the first has hardly an effect: where its optimum lies is not known, by draws of functions too.

    A thousand random places are far apart in eight dimensions: none is nearly as good as the top, and the top's near
    surroundings alone tell a setting that draws doubt as if it were known well.
    """
    rng = np.random.default_rng(2)
    points = rng.choice([-1.0, 0.0, 1.0], size=(70, 8))
    y = points @ np.arange(8.0) - np.sum(points**2, axis=1) + rng.normal(size=70)
    process, region = fitted(points, y), Region(tuple(ContinuousFactor(f"x{i}", -1.0, 1.0) for i in range(8)))
    top = climb(process.mean, region, np.vstack([points, region.sample(500, rng)]), rng)[0]
    cloud = Cloud(process, region, top, points, 1.0, np.random.default_rng(3))
    of_cloud = cloud.points[np.argmax(cloud.draws(30, rng), axis=1), 0]
    starts = np.where(np.arange(8) == 0, np.linspace(-1.0, 1.0, 81)[:, None], top)
    of_functions = [climb(process.draw(rng)[0], region, starts, rng)[0][0] for _ in range(25)]
    assert np.std(of_functions) > 0.2
    assert np.std(of_cloud) > 0.6 * np.std(of_functions)


@pytest.mark.parametrize("n_continuous", [0, 5])
def test_the_climb_moves_between_levels(n_continuous: int) -> None:
    """Of 1000 starts none has the best levels of all factors: a surface of single factors is climbed one by one."""
    rng = np.random.default_rng(4)
    values = tuple(float(value) for value in range(1, 6))
    levels = tuple("ABCDE")
    discrete = [DiscreteFactor(f"d{i}", values) for i in range(3)] + [CategoricalFactor(f"c{i}", levels) for i in "xyz"]
    region = Region((*discrete, *(ContinuousFactor(f"x{i}", -1.0, 1.0) for i in range(n_continuous))))
    gains = [rng.standard_normal(5) for _ in discrete]

    def mean(points: np.ndarray) -> np.ndarray:
        index = [np.searchsorted(one.coded_levels, points[:, j] - 1e-9) for j, one in enumerate(discrete)]
        found = sum(gain[at] for gain, at in zip(gains, index, strict=True))
        return np.asarray(found - 0.1 * np.sum(np.square(points[:, len(discrete) :]), axis=1))

    starts = region.sample(1000, rng)
    best = sum(gain.max() for gain in gains)
    assert mean(starts).max() < best - 0.1
    top = climb(mean, region, starts, rng)[0]
    assert mean(np.where(np.arange(region.k) < len(discrete), top, 0.0)[None, :])[0] == pytest.approx(best)


def test_one_run_in_four_lies_far_from_all_runs() -> None:
    """Runs everywhere but in one corner of the square, and a surface whose top is elsewhere: the fourth goes there."""
    rng = np.random.default_rng(5)
    points = np.round(rng.uniform(-1.0, 1.0, (60, 2)), 3)
    points = points[np.any(points < 0.0, axis=1)][:32]  # none within (0, 1) x (0, 1)
    top = np.array([-0.4, -0.3])
    process = fitted(points, bowl(points - top) + rng.normal(size=len(points)))
    found = propose_from_process(
        process, BOX, top, Runs(points, np.zeros(len(points), dtype=bool)), 8, far=True, seed=3
    )
    assert [one.purpose == "spread" for one in found] == [False, False, False, True] + 4 * [
        False
    ]  # no large box is left
    assert np.all(found[3].point > 0.0)
    assert "no run so far in the box of" in found[3].why
    share = 1.0 - np.max(np.abs(found[3].point))
    nearest = np.min(np.max(np.abs(points - found[3].point), axis=1))
    assert f"box of {100.0 * min(share, nearest):.2g} %" in found[3].why
    assert np.mean(np.linalg.norm([one.point - top for one in found if one.purpose != "spread"], axis=1) < 0.8) > 0.5
    (one,) = propose_from_process(process, BOX, top, Runs(points[:31], np.zeros(31, dtype=bool)), 1, seed=3)
    assert one.purpose != "spread"  # not asked for


def test_places_farthest_from_all_runs_are_in_the_cloud() -> None:
    """Those beside a pending run are not."""
    rng = np.random.default_rng(5)
    points = np.round(rng.uniform(-1.0, 1.0, (60, 2)), 3)
    points = points[np.any(points < 0.0, axis=1)][:32]
    middle, top = np.array([[0.5, 0.5]]), np.array([-0.4, -0.3])
    process = fitted(points, bowl(points - top) + rng.normal(size=len(points)))

    def beside(pending: np.ndarray | None) -> int:
        cloud = Cloud(process, BOX, top, points, 1.0, np.random.default_rng(3), pending)
        return int(np.sum(np.max(np.abs(cloud.points - middle), axis=1) < 0.2))

    assert beside(None) >= 20
    assert beside(middle) < 15


def test_levels_alone_have_no_box() -> None:
    region = Region((DiscreteFactor("looks", (1.0, 2.0, 3.0, 4.0, 5.0)), CategoricalFactor("bands", ("L", "C", "X"))))
    rng = np.random.default_rng(6)
    points = region.sample(60, rng)
    points = points[points[:, 0] < 0.5][:19]  # none of the two highest levels
    y = points[:, 0] - np.square(points[:, 0]) + points[:, 1] + 0.3 * rng.normal(size=19)
    process = Process(QuadraticModel(region.factors), points, y, np.ones(19), rng)
    (one,) = propose_from_process(process, region, points[0], Runs(points, np.zeros(19, dtype=bool)), 1, far=True)
    assert one.purpose in ("optimum", "regret")
