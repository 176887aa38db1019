"""Differences between sensors against draws of known variances; one property exchanged leaves the others."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from seqrsm.analysis.candidates import Sufficing, compared
from seqrsm.analysis.ground import future_sds
from seqrsm.campaign.candidates import _Comparer, why_not
from seqrsm.campaign.instruments import Instrument, mixtures
from seqrsm.errors import Problem, SceneError
from seqrsm.sensor.exchange import PROPERTIES, as_parameters, exchanged
from seqrsm.sensor.named import noise_equivalent_db, radar_of, radiometer_of, sensors_called
from seqrsm.sensor.radar import RadarConfiguration, from_settings
from seqrsm.sensor.radiometer import RadiometerConfiguration

OURS = RadarConfiguration(1.25, ("HH", "HV", "VV"), 13.0, 50.0, 30.0, 30.0, 6000.0, texture_db=0.5)
AIRBORNE = RadiometerConfiguration(17.0, ("H", "V"), 100.0, 8.0, 100.0, 300.0, 2.0, 3000.0)


def named(title: str, channels: str, angle: float) -> RadarConfiguration:
    (sensor,) = sensors_called(title)
    return radar_of(sensor, channels, angle, 20.0)


@pytest.mark.parametrize(("runs", "occasions"), [(1.0, 2), (5.0, 2), (np.inf, 3)])
def test_intervals_and_probability_hold_for_drawn_grounds(runs: float, occasions: int) -> None:
    """Over a new ground the mean of so many occasions lies in the interval, and suffices as often as is said."""
    rng = np.random.default_rng(11)
    ground, chance, level, n = 4.0, 2.0, 0.9, 1500
    inside_mean = inside_ground = promised = kept = 0.0
    for _ in range(n):
        difference = -3.0 + ground * rng.normal(size=(12, 1)) + chance * rng.normal(size=(12, occasions))
        optimum = 70.0 + rng.normal(size=(12, occasions))
        found = compared((optimum + difference)[None], optimum, Sufficing(-5.0, True, 1.0), level, runs)
        future = -3.0 + ground * rng.normal() + (chance * rng.normal() / np.sqrt(runs) if np.isfinite(runs) else 0.0)
        inside_mean += found.confidence.low < -3.0 < found.confidence.high
        inside_ground += found.one_ground.low < future < found.one_ground.high
        promised += found.probability
        kept += future >= -5.0
    assert inside_mean / n == pytest.approx(level, abs=0.025)
    assert inside_ground / n == pytest.approx(level, abs=0.025)
    assert promised / n == pytest.approx(kept / n, abs=0.05)


@pytest.mark.parametrize(("runs", "share"), [(5.0, 0.4), (np.inf, 0.3)])
def test_an_interval_counts_that_few_worlds_tell_little_of_chance(runs: float, share: float) -> None:
    """More occasions than were simulated, most of whose variance is chance: Student's t would hold 94 and 88 %."""
    rng, inside = np.random.default_rng(5), []
    future = stats.norm(0.0, np.sqrt(share + (1.0 - share) / runs))
    for _ in range(600):
        made = np.sqrt(share) * rng.normal(size=(16, 1)) + np.sqrt(1.0 - share) * rng.normal(size=(16, 2))
        found = compared(made[None], np.zeros((16, 2)), Sufficing(0.0, True, 1.0), 0.95, runs).one_ground
        inside.append(future.cdf(found.high) - future.cdf(found.low))
    assert np.mean(inside) == pytest.approx(0.955, abs=0.01)


def test_chance_between_few_occasions_is_its_estimate_on_average() -> None:
    """Worlds have one mean here, and the mean of three future occasions a third of the variance within them."""
    scores = np.zeros((4, 1)) + np.sqrt(0.5) * np.array([-1.0, 1.0])
    assert np.mean(np.square(future_sds(scores, 3.0))) == pytest.approx(1.0 / 3.0, rel=0.05)


def test_of_one_occasion_a_world_all_variance_is_the_grounds_and_known_by_few() -> None:
    """A future mean has the scaled inverse chi-squared variance, and the error of the mean so far beside it."""
    scores = np.random.default_rng(3).normal(size=(5, 1))
    variance, parts = float(np.sum(np.square(scores - scores.mean()))) / 4.0, (np.arange(30) + 0.5) / 30.0
    sds = np.sqrt(variance * 4.0 / stats.chi2.isf(parts, 4))
    np.testing.assert_allclose(np.sort(future_sds(scores, 5.0)), np.sort(sds))
    found = compared(scores[None], np.zeros((5, 1)), Sufficing(0.0, True, 1.0), 0.95, 5.0)
    away = (np.array([found.one_ground.low, found.one_ground.high, 0.0]) - scores.mean())[:, None]
    below = stats.norm.cdf(away / np.hypot(sds, np.sqrt(variance / 5.0))).mean(axis=1)
    np.testing.assert_allclose(below, [0.025, 0.975, 1.0 - found.probability], atol=1e-7)
    half = stats.t.ppf(0.975, 4) * np.sqrt(variance / 5.0)
    assert found.confidence.high == pytest.approx(scores.mean() + half)
    # What an edge of the swath gains another loses: their mean is known to be 0.
    both = compared(np.stack([scores, -scores]), np.zeros((5, 1)), Sufficing(0.0, True, 1.0), 0.95, 5.0)
    assert (both.confidence.low, both.confidence.high) == pytest.approx((0.0, 0.0), abs=1e-12)


def test_no_score_is_further_from_another_than_the_scale_is_long() -> None:
    """A detection of 4 percent beside one of 90 was told to be 114 to 60 percent lower on one ground."""
    optimum = 90.0 + 20.0 * np.random.default_rng(3).standard_normal((8, 2)).clip(-1.0, 0.5)
    found = compared(np.full((1, 8, 2), 4.0), optimum, Sufficing(-30.0, True, 1.0, 100.0), 0.95, 1.0)
    free = compared(np.full((1, 8, 2), 4.0), optimum, Sufficing(-30.0, True, 1.0), 0.95, 1.0)
    assert free.one_ground.low < -100.0 == found.one_ground.low
    assert (found.one_ground.high, found.confidence) == (free.one_ground.high, free.confidence)
    few = compared(
        np.zeros((1, 2, 2)), np.array([[90.0, 90.0], [100.0, 100.0]]), Sufficing(-30.0, True, 1.0, 100.0), 0.95, 1.0
    )
    assert (few.difference, few.confidence.low) == (-95.0, -100.0)


@pytest.mark.parametrize("beside", [0.0, [0.0, 15.0]])
def test_one_ground_lies_at_any_place_of_the_swath(beside: float | list[float]) -> None:
    """Where the edges of a swath differ a ground scores as one of them, of either; interval and probability agree."""
    rng = np.random.default_rng(3)
    optimum = 60.0 + rng.normal(size=(16, 2))
    at = np.array([-20.0, -12.0, 2.0])
    own = optimum + at[:, None, None] + 2.0 * rng.normal(size=(3, 16, 1)) + rng.normal(size=(3, 16, 2))
    optimum = optimum + np.asarray(beside)[..., None, None] if np.ndim(beside) else optimum
    found = compared(own, optimum, Sufficing(0.0, True, 1.0), 0.95, 1.0)
    ground = 2.0 * rng.normal(size=20_000) + rng.normal(size=20_000)
    future = rng.choice(at, 20_000) - rng.choice(np.atleast_1d(beside), 20_000) + ground
    assert np.mean((future > found.one_ground.low) & (future < found.one_ground.high)) == pytest.approx(0.95, abs=0.03)
    assert found.confidence.low < -10.0 - np.mean(beside) < found.confidence.high  # the mean of the places
    for end, share in ((found.one_ground.low, 0.975), (found.one_ground.high, 0.025)):
        there = compared(own, optimum, Sufficing(end, True, 1.0), 0.95, 1.0)
        assert there.probability == pytest.approx(share, abs=1e-9)


def test_a_target_counts_the_scores_themselves_and_small_ones_where_they_are_good() -> None:
    rng = np.random.default_rng(2)
    optimum = 10.0 + rng.normal(size=(16, 2))
    own = optimum[None] + np.array([0.0, 8.0])[:, None, None]  # at one edge of its swath as good, at the other not
    rule = Sufficing(14.0, False, -1.0)
    assert compared(own, optimum, rule, 0.95, 5.0).probability == pytest.approx(0.5, abs=0.05)
    assert compared(own[:1], optimum, replace(rule, sign=1.0), 0.95, 5.0).probability < 0.05
    assert compared(own[:1], optimum, Sufficing(0.0, True, -1.0), 0.95, 5.0).probability == 1.0


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_next_less_the_first_is_the_paired_t_interval_of_worlds_where_both_have_scores(sign: float) -> None:
    """Interval and sign by scipy's paired t-test of the worlds' means; a twin of the first differs by 0."""
    rng, worlds = np.random.default_rng(8), 8.0 * np.random.default_rng(9).normal(size=(12, 1))
    first, swath = ["a"], ["b near", "b middle", "b far"]
    places = {"first": first, "twin": ["twin"], "swath": swath, "third": ["third"], "fourth": ["fourth"]}
    made = [one for own in (["optimum"], *places.values()) for one in own]
    scores = {one: 60.0 - 2.0 * sign * k + worlds + rng.normal(size=(12, 2)) for k, one in enumerate(made)}
    scores["twin"] = scores["a"].copy()
    scores["b far"][3, 1] = np.nan  # a run that failed
    rows = [{"name": name} for name in ("first", "by the surface", *list(places)[1:])]
    comparer = SimpleNamespace(
        places=places, base="optimum", fresh=(), rule=Sufficing(50.0, False, sign), level=0.9, runs=5.0,
        _simulated=lambda asked, _: np.array([scores[one] for one in asked]),
    )  # fmt: skip
    _Comparer.compare_again(comparer, rows)
    assert [sorted(row.keys() - {"name"}) for row in rows] == [["again"], [], *[["beside_first"]] * 3, []]
    twin = rows[2]["beside_first"]
    assert (twin["difference"], twin["confidence"]["half_width"], twin["probability"]) == (0.0, 0.0, 1.0)
    for row, key, other in ((rows[0], "again", "optimum"), *((row, "beside_first", "a") for row in rows[3:5])):
        told, own = row[key], np.mean([scores[one] for one in places[row["name"]]], axis=(0, 2))
        whole = np.isfinite(own)
        assert whole.sum() == (11 if row["name"] == "swath" else 12)
        found = stats.ttest_rel(own[whole], scores[other].mean(axis=1)[whole])
        ends = found.confidence_interval(0.9)
        assert (told["confidence"]["low"], told["confidence"]["high"]) == pytest.approx((ends.low, ends.high))
        assert told["difference"] == pytest.approx(0.5 * (ends.low + ends.high))
        assert sign * told["difference"] < 0.0  # worse than the other
        assert told["score"] == pytest.approx(own[whole].mean())
    assert rows[4]["beside_first"]["probability"] < 0.01  # as good as the first, not as the target


def facts(radar: RadarConfiguration) -> dict[str, tuple[object, ...]]:
    theta = np.array([radar.centre_incidence_rad])
    return {
        "frequency": (radar.frequency_ghz,),
        "channels": radar.channels,
        "cell and looks": (radar.resolution_m, round(float(radar.looks_used(theta)[0]), 4)),
        "angle": (round(float(theta[0]), 6), radar.altitude_m),
        "noise": (round(noise_equivalent_db(radar), 6),),
    }


@pytest.mark.parametrize("name", PROPERTIES)
@pytest.mark.parametrize("beam_deg", [None, 2.0])
@pytest.mark.parametrize("title", ["Sentinel-1 IW GRDH", "SAOCOM-1 Stripmap quad", "Envisat ASAR APP"])
def test_one_property_of_a_radar_is_exchanged_and_no_other(name: str, title: str, beam_deg: float | None) -> None:
    (sensor,) = sensors_called(title)
    other = named(title, sensor.channels[0], 35.0)
    ours = replace(OURS, azimuth_beamwidth_deg=beam_deg)
    mixed = exchanged(ours, other, (name,))
    expected = {**facts(ours), name: facts(other)[name]}
    assert facts(mixed) == expected
    assert mixed.texture_db == 0.5  # of the ground


@pytest.mark.parametrize("more", [{}, {"scan": "ppi", "near_incidence_deg": 40.0, "far_incidence_deg": 70.0}])
def test_a_given_beam_that_makes_the_cell_stays_at_another_frequency(more: dict[str, object]) -> None:
    ours = replace(OURS, azimuth_beamwidth_deg=2.0, aperture="real", **more)
    mixed = exchanged(ours, named("Sentinel-1 IW GRDH", "VV+VH", 38.0), ("frequency",))
    assert mixed.frequency_ghz == 5.405
    assert np.rad2deg(mixed.azimuth_beamwidth_rad) == pytest.approx(2.0)


def test_all_properties_make_the_other_radar_over_the_same_ground() -> None:
    other = named("Sentinel-1 IW GRDH", "VV+VH", 38.0)
    mixed = exchanged(OURS, other, PROPERTIES)
    assert facts(mixed) == facts(other)
    assert from_settings(as_parameters(mixed)) == mixed
    assert facts(exchanged(OURS, other, ())) == facts(OURS)


def test_noise_of_a_radiometer_is_exchanged_without_its_times() -> None:
    (pals,) = sensors_called("PALS L 1.413 GHz low")
    other = radiometer_of(pals, "H+V")
    mixed = exchanged(AIRBORNE, other, ("noise",))
    assert float(mixed.nedt_k(300.0)) == pytest.approx(float(other.nedt_k(300.0)), rel=1e-6)
    assert mixed.integration_time_ms == AIRBORNE.integration_time_ms
    coarse = exchanged(AIRBORNE, other, ("cell and looks",))
    assert (coarse.resolution_m, coarse.altitude_m) == (other.resolution_m, 3000.0)
    assert coarse.scan_period_s == pytest.approx(2.0 * 4.9)


def test_a_set_with_less_power_differs_in_noise_alone() -> None:
    pair = (OURS, replace(OURS, frequency_ghz=5.4, channels=("HH", "HV")))
    base, weak = (Instrument(tuple(replace(one, peak_power_w=p) for one in pair), ((), ())) for p in (30.0, 0.3))
    ((name, mixed),) = mixtures(base, weak)
    assert name == "noise"
    assert [noise_equivalent_db(one) for one in mixed.sensors] == pytest.approx(
        [noise_equivalent_db(one) + 20.0 for one in base.sensors]
    )


def test_why_a_candidate_cannot_be_judged_is_short() -> None:
    def told(*messages: str) -> str:
        return why_not(SceneError(*(Problem(one) for one in messages)))

    assert told("no L band", "no L band", "no HV") == "no L band; no HV"
    assert told(*(f"nothing of cover {k}" for k in range(15))) == (
        "nothing of cover 0; nothing of cover 1; nothing of cover 2; and 12 more"
    )
