from __future__ import annotations

import pickle

import numpy as np
import pytest

from seqrsm.design.constraints import Constraint
from seqrsm.design.factors import CategoricalFactor, ContinuousFactor, DiscreteFactor
from seqrsm.design.region import Region
from seqrsm.errors import RegionError

FACTORS = (
    ContinuousFactor("frequency", 1.2, 17.0, "GHz", "log"),
    DiscreteFactor("looks", (1, 2, 4, 8, 16), scale="log"),
    CategoricalFactor("polarization", ("HH", "VV", "HV")),
    ContinuousFactor("resolution", 3.0, 50.0, "m", "log"),
)
LOOKS = "looks <= 4 * (resolution / 12.1) ** 2"


def disc(*more: str) -> Region:
    return Region(
        (ContinuousFactor("x", -1.0, 1.0), ContinuousFactor("y", -1.0, 1.0)),
        (Constraint("x**2 + y**2 <= 0.64"), *(Constraint(text) for text in more)),
    )


def test_settings_and_points_round_trip():
    region = Region(FACTORS)
    settings = [
        {"frequency": 1.2, "looks": 8.0, "polarization": "HV", "resolution": 12.1},
        {"frequency": 9.6, "looks": 1.0, "polarization": "HH", "resolution": 50.0},
    ]
    back = region.decode(region.code(settings))
    for want, got in zip(settings, back, strict=True):
        assert got["polarization"] == want["polarization"]
        for name in ("frequency", "looks", "resolution"):
            assert got[name] == pytest.approx(want[name], rel=1e-14)


def test_numbers_may_come_as_text_and_further_keys_are_left_alone():
    region = Region(FACTORS)
    point = region.code([{"frequency": "1.2", "looks": " 4", "polarization": "VV ", "resolution": "3e0", "score": "x"}])
    assert point.tolist() == [[-1.0, 0.0, 1.0, -1.0]]


def test_every_wrong_setting_is_named_with_its_row():
    with pytest.raises(RegionError) as caught:
        Region(FACTORS).code(
            [
                {"frequency": 1.2, "looks": 1, "polarization": "RL", "resolution": 3.0},
                {"frequency": "high", "looks": float("nan"), "polarization": "HH"},
            ]
        )
    found = [(p.line, p.field) for p in caught.value.problems]
    assert found == [(1, "polarization"), (2, "frequency"), (2, "looks"), (2, "resolution")]
    assert "HH, VV, HV" in str(caught.value)


def test_feasible_looks_at_bounds_levels_and_constraints():
    region = Region(FACTORS, (Constraint(LOOKS),))
    good = region.code([{"frequency": 5.0, "looks": 4, "polarization": "HH", "resolution": 12.1}])
    assert region.feasible(good)[0]
    for name, value in (("looks", 8), ("looks", 3), ("frequency", 17.1), ("resolution", 12.0)):
        setting = region.decode(good)[0] | {name: value}
        assert not region.feasible(region.code([setting]))[0], (name, value)
    bad = good.copy()
    bad[0, 2] = 3.0
    assert not region.feasible(bad)[0]
    bad[0, 2] = np.nan
    assert not region.feasible(bad)[0]


def test_slack_agrees_with_the_same_formula_in_numpy():
    region = Region(FACTORS, (Constraint(LOOKS),))
    points = region.sample(500, np.random.default_rng(1))
    points[::2, 3] -= 0.3
    settings = region.decode(points)
    looks = np.array([s["looks"] for s in settings])
    bound = 4.0 * (np.array([s["resolution"] for s in settings]) / 12.1) ** 2
    # The square counts twice in the size: an error of its base does so in its value.
    np.testing.assert_allclose(region.slack(points), (bound - looks) / (2.0 * bound + looks), rtol=1e-12)


def test_sample_is_uniform_in_the_disc():
    points = disc().sample(20_000, np.random.default_rng(5))
    assert np.all(np.hypot(*points.T) <= 0.8)
    # E r^2 = R^2 / 2 with variance R^4 / 12.
    mean = np.mean(np.sum(points**2, axis=1))
    assert abs(mean - 0.32) < 4.0 * 0.64 / np.sqrt(12.0 * 20_000)
    np.testing.assert_array_equal(points, disc().sample(20_000, np.random.default_rng(5)))


def test_a_thin_region_is_found_and_sampled():
    thin = Region(
        (ContinuousFactor("x", 0.0, 1.0), ContinuousFactor("y", 0.0, 1.0)),
        (Constraint("y - x <= 1e-5"), Constraint("x - y <= 1e-5")),
    )
    points = thin.sample(20, np.random.default_rng(2))
    assert points.shape == (20, 2)
    assert np.all(thin.feasible(points))
    assert np.max(np.abs(points[:, 0] - points[:, 1])) <= 2.1e-5


def test_candidates_hold_the_grid_and_the_boundary():
    box = Region(FACTORS).candidates()
    assert box.shape == (5 * 5 * 3 * 5, 4)
    region = disc()
    points = region.candidates()
    assert np.all(region.feasible(points, tol=0.0))
    radius = np.hypot(*points.T)
    assert np.count_nonzero(np.abs(radius - 0.8) < 1e-12) >= 8
    assert any(np.allclose(point, (0.8, 0.0), atol=1e-12) for point in points)
    assert np.unique(np.round(points, 9), axis=0).shape == points.shape


def test_many_factors_do_not_explode_the_candidates():
    factors = tuple(ContinuousFactor(f"x{i}", -1.0, 1.0) for i in range(12))
    points = Region(factors).candidates(limit=3000)
    assert 3000 <= points.shape[0] <= 8000
    assert np.all(np.abs(points) <= 1.0)


def test_line_intervals_end_on_the_boundary():
    region = disc()
    interval = region.line_intervals(np.array([0.0, 0.3]), 0)
    edge = np.sqrt(0.64 - 0.09)
    np.testing.assert_allclose(interval, [[-edge, edge]], atol=1e-14)
    ring = disc("x**2 + y**2 >= 0.25").line_intervals(np.array([0.6, 0.0]), 0)
    np.testing.assert_allclose(ring, [[-0.8, -0.5], [0.5, 0.8]], atol=1e-14)
    assert region.line_intervals(np.array([0.0, 0.9]), 0).shape == (0, 2)


def test_line_through_a_box_is_its_whole_range():
    box = Region((ContinuousFactor("x", 0.0, 10.0), ContinuousFactor("y", 0.0, 1.0)))
    assert box.line_intervals(np.array([0.3, -1.0]), 0).tolist() == [[-1.0, 1.0]]


def test_line_intervals_of_levels_are_the_feasible_levels():
    region = Region(FACTORS, (Constraint(LOOKS), Constraint('polarization != "HV" or frequency <= 5')))
    point = region.code([{"frequency": 10.0, "looks": 4, "polarization": "VV", "resolution": 12.1}])[0]
    np.testing.assert_allclose(region.line_intervals(point, 1), [[-1.0, -1.0], [-0.5, -0.5], [0.0, 0.0]], atol=1e-15)
    assert region.line_intervals(point, 2).tolist() == [[0.0, 0.0], [1.0, 1.0]]


def test_the_centre_is_feasible_and_central():
    assert Region(FACTORS).centre().tolist() == [0.0, 0.0, 0.0, 0.0]
    even = Region((DiscreteFactor("n", (1.0, 2.0, 4.0, 6.0)), ContinuousFactor("x", 0.0, 1.0)))
    assert even.decode(even.centre())[0] == {"n": 4.0, "x": 0.5}
    moved = disc("x + y >= 0.5")
    centre = moved.centre()
    assert moved.feasible(centre)[0]
    assert moved.slack(centre)[0] > 0.01


def test_level_combinations():
    assert Region(FACTORS[:2]).level_combinations() == ((),)
    two = Region((FACTORS[2], CategoricalFactor("season", ("dry", "wet"))))
    assert two.level_combinations() == ((0, 0), (0, 1), (1, 0), (1, 1), (2, 0), (2, 1))


def test_contradictory_constraints_are_named_and_no_others():
    with pytest.raises(RegionError) as caught:
        Region(FACTORS, tuple(Constraint(t) for t in ("frequency < 5", "looks >= 2", "frequency > 6", LOOKS)))
    assert [p.value for p in caught.value.problems] == ["frequency < 5", "frequency > 6"]
    with pytest.raises(RegionError, match="no setting of the factors satisfies this constraint"):
        Region(FACTORS, (Constraint("looks > 16 * frequency"), Constraint("frequency < 5")))


@pytest.mark.parametrize(
    ("text", "fragment"),
    [
        ("altitude < 5", "is not a factor"),
        ("polarization < 5", "categorical factor stands where"),
        ('polarization == "RL"', "has no such level"),
        ('looks == "HH"', "are for categorical factors"),
    ],
)
def test_names_are_checked_against_the_factors(text, fragment):
    with pytest.raises(RegionError, match=fragment):
        Region(FACTORS, (Constraint(text),))


def test_factor_names_must_differ():
    with pytest.raises(RegionError, match="same name"):
        Region((FACTORS[0], FACTORS[0]))
    with pytest.raises(RegionError, match="at least one factor"):
        Region(())


def test_regions_travel_between_processes():
    region = Region(FACTORS, (Constraint(LOOKS),))
    other = pickle.loads(pickle.dumps(region))
    assert other == region
    points = Region(FACTORS).sample(50, np.random.default_rng(0))
    np.testing.assert_array_equal(other.feasible(points), region.feasible(points))


@pytest.mark.parametrize(
    ("expr", "refused"),
    [
        ("dates > 1 or x <= 10", True),
        ("1 < dates", True),
        ("count(frequency) > 1", True),
        ("x <= 10 and 1 < dates < 4", True),
        ("dates > 3", False),  # between two of its values
        ("dates >= 2 or x < 10", False),
    ],
)
def test_an_end_that_a_discrete_factor_takes_is_not_excluded_by_a_sign_that_includes_it(expr, refused) -> None:
    """Slack 0 is feasible, on which a search along a bound relies: dates > 1 would allow one date."""
    factors = (DiscreteFactor("dates", (1.0, 2.0, 4.0)), ContinuousFactor("x", 6.0, 40.0))
    factors = (*factors, CategoricalFactor("frequency", ("L", "C", "L+C")))
    if not refused:
        Region(factors, (Constraint(expr),))
        return
    with pytest.raises(RegionError, match=r"< and > include their end") as told:
        Region(factors, (Constraint(expr),))
    assert {problem.remedy for problem in told.value.problems} == {
        "Write <= or >= with the nearest value that is allowed."
    }
