"""Cheaper rungs against the full simulation of the same occasions: Monte Carlo over flat, rolling and steep ground."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from seqrsm.campaign.engines import ENGINES, Demand
from seqrsm.scene.scene import Scene
from seqrsm.scene.synthetic import Terrain, synthetic_scene
from seqrsm.simulate.bounds import teaching_factor
from seqrsm.simulate.fidelity import RUNGS
from seqrsm.simulate.radar.sample import meet, radar_strips

COVERS = ("Wheat", "Corn", "Forage", "Trees", "Grass")
RELIEF = {"flat": 0.0, "rolling": 60.0, "steep": 600.0}
RUNS = range(1, 25)
SEED = 5


@lru_cache(maxsize=8)
def ground(kind: str, cover: tuple[str, ...] = COVERS, cell_m: float = 5.0) -> Scene:
    return synthetic_scene(
        320, 360, cell_m, categories=cover, field_m=14.0 * cell_m, terrain=Terrain(RELIEF[kind], exponent=3.6), seed=11
    )


def radar(resolution: float = 15.0, **changes: float | str) -> object:
    fixed: dict[str, float | str] = {
        "bandwidth": 50.0,
        "peak_power": 30.0,
        "altitude_m": 6000.0,
        "depression_angle": 50.0,
    }
    fixed |= {"texture_db": 0.0, **changes}
    return ENGINES["psm"].configure({"frequency": 5.4, "polarization": "HH+HV", "resolution": resolution}, fixed)


def plan(scene: Scene, sensor: object, run: int, rung: str, tolerance: float, engine: str = "psm") -> tuple:
    table = ENGINES[engine].table("")
    return ENGINES[engine].plan(scene, sensor, table, SEED, run, ("percent_correct",), Demand(tolerance, rung))


def scores(scene: Scene, sensor: object, rung: str, tolerance: float, engine: str = "psm") -> tuple[np.ndarray, object]:
    """Score of every run by a rung, and the plan of the last."""
    own = ENGINES[engine]
    found = []
    for run in RUNS:
        chosen, make = plan(scene, sensor, run, rung, tolerance, engine)
        if rung == "F4":
            image = own.simulate(scene, sensor, own.table(""), SEED, run)
            found.append(own.utilities["percent_correct"](image, scene, seed=SEED, run_id=run).value)
        else:
            sample = make(chosen.chosen)
            found.append(own.sampled["percent_correct"](sample, scene, seed=SEED, run_id=run).value)
    return np.array(found), chosen.chosen


@lru_cache(maxsize=4)
def full(kind: str) -> np.ndarray:
    return scores(ground(kind), radar(), "F4", 1.0)[0]


@pytest.mark.parametrize("kind", RELIEF)
@pytest.mark.parametrize("rung", ["F0", "F2", "F3"])
def test_a_rung_errs_by_no_more_than_its_bound(kind: str, rung: str) -> None:
    cheap, made = scores(ground(kind), radar(), rung, 4.0)
    difference = cheap - full(kind)
    mean, error = difference.mean(), difference.std(ddof=1) / np.sqrt(len(difference))
    # The bias bound is about the mean over occasions; teaching by a part of the ground costs some of the other.
    assert abs(mean) <= made.bias + 0.5 * made.sampling + 3.0 * error
    # 24 runs know a standard deviation to 14 %: three of those.
    assert difference.std(ddof=1) <= 1.45 * np.hypot(made.bias + made.sampling, 0.6)


@pytest.mark.parametrize("kind", ["flat", "rolling"])
def test_wider_cells_err_by_no_more_than_their_bound(kind: str) -> None:
    sensor = radar(40.0)
    true = scores(ground(kind), sensor, "F4", 1.0)[0]
    cheap, made = scores(ground(kind), sensor, "F1", 4.0)
    difference = cheap - true
    error = difference.std(ddof=1) / np.sqrt(len(difference))
    assert made.coarse > 1
    assert made.bound <= 4.0
    assert abs(difference.mean()) <= made.bias + 0.5 * made.sampling + 3.0 * error
    assert difference.std(ddof=1) <= 1.45 * np.hypot(made.bound, 0.6)


def test_wider_cells_are_chosen_where_a_pixel_holds_many() -> None:
    scene = synthetic_scene(
        900, 900, 2.0, categories=COVERS, field_m=150.0, terrain=Terrain(40.0, exponent=3.6), seed=11
    )
    chosen, _ = plan(scene, radar(48.0), 1, "auto", 4.0)
    assert chosen.chosen.rung == "F1"
    assert chosen.chosen.coarse >= 2
    assert "detail below some cells" in chosen.chosen.left_out


def test_the_occasion_keeps_its_spread_on_every_rung() -> None:
    """A cheaper rung that drew no fields or dates would make runs repeat each other."""
    true = full("flat").std(ddof=1)
    for rung in ("F0", "F2", "F3"):
        cheap, _ = scores(ground("flat"), radar(), rung, 4.0)
        assert cheap.std(ddof=1) > 0.6 * true
        assert np.corrcoef(cheap, full("flat"))[0, 1] > 0.5


def test_flat_ground_admits_the_cheapest_rung_and_steep_ground_does_not() -> None:
    sensor = radar()
    flat, _ = plan(ground("flat"), sensor, 1, "auto", 4.0)
    steep, _ = plan(ground("steep"), sensor, 1, "auto", 4.0)
    assert flat.of("F0").bias == 0.0
    assert {e.name: e.verdict for e in flat.effects}["cast shadow"] == "exact"
    assert flat.chosen.bound <= 4.0
    assert steep.of("F0").bias > 4.0
    assert steep.chosen.rung != "F0"
    assert {e.name: e.verdict for e in steep.effects}["local incidence"] == "needed"


def test_tighter_tolerance_never_takes_a_cheaper_model() -> None:
    efforts = [plan(ground("rolling"), radar(), 1, "auto", tolerance)[0].chosen.effort for tolerance in (0.1, 1.0, 8.0)]
    assert efforts == sorted(efforts, reverse=True)


def test_whole_image_in_strips_is_the_image() -> None:
    """All columns without fading: the same mean power to the last bits of single precision, the same registration."""
    scene, sensor = ground("rolling"), radar(fading="none")
    own = ENGINES["psm"]
    image = own.simulate(scene, sensor, own.table(""), SEED, 3)
    lookups, occasion = meet(scene, sensor, own.table(""), SEED, 3)
    sample = radar_strips(scene, sensor, lookups, occasion, seed=SEED, run_id=3)
    np.testing.assert_allclose(sample.values[0].reshape(image.intensity.shape), image.apparent_sigma0(), rtol=1e-5)
    seen = image.pixel_of_cell[image.pixel_of_cell >= 0]
    assert np.array_equal(np.bincount(seen), np.bincount(sample.pixel_of_cell[sample.pixel_of_cell >= 0]))


@pytest.mark.parametrize(
    "changes", [{}, {"resolution": 7.0}, {"resolution": 60.0, "aperture": "real", "antenna_length_m": 8.0}]
)
def test_a_strip_shows_what_the_image_shows_there(changes: dict) -> None:
    scene = ground("steep")
    sensor = radar(fading="none", **({"resolution": 15.0} | changes))
    own = ENGINES["psm"]
    image = own.simulate(scene, sensor, own.table(""), SEED, 4)
    lookups, occasion = meet(scene, sensor, own.table(""), SEED, 4)
    sample = radar_strips(scene, sensor, lookups, occasion, seed=SEED, run_id=4, columns=9)
    n_channels, n_range, n_azimuth = image.intensity.shape
    place = np.round(sample.along_m[:9] / image.azimuth_spacing_m - 0.5).astype(int)
    inner = (place > 8) & (place < n_azimuth - 9)
    strips = sample.values[0].reshape(n_channels, n_range, 9)[:, :, inner]
    np.testing.assert_allclose(strips, image.apparent_sigma0()[:, :, place[inner]], rtol=2e-4, atol=1e-9)
    wanted = np.bincount(image.pixel_of_cell[image.pixel_of_cell >= 0], minlength=n_range * n_azimuth)
    found = np.bincount(sample.pixel_of_cell[sample.pixel_of_cell >= 0], minlength=n_range * 9)
    assert np.array_equal(found.reshape(n_range, 9), wanted.reshape(n_range, n_azimuth)[:, place])


def test_flat_pixels_are_those_of_the_image_of_flat_ground() -> None:
    scene, sensor = ground("flat"), radar(fading="none")
    own = ENGINES["psm"]
    image = own.simulate(scene, sensor, own.table(""), SEED, 6)
    chosen, make = plan(scene, sensor, 6, "F0", 30.0)
    sample = make(chosen.chosen)
    row = np.round(sample.across_m / image.range_spacing_m).astype(int)
    column = np.round(sample.along_m / image.azimuth_spacing_m - 0.5).astype(int)
    true = image.apparent_sigma0()[:, row, column]
    inner = (row > 0) & (row < image.intensity.shape[1] - 1)
    np.testing.assert_allclose(sample.values[0][:, inner], true[:, inner], rtol=5e-3)


def test_integrated_fading_tends_to_the_gamma_law() -> None:
    """One class boundary at a threshold: the share of draws below it is the gamma distribution function."""
    from scipy.special import gammainc

    from seqrsm.simulate.radar.sample import faded_draws

    mean = np.full((1, 40, 50), 2.0, dtype=np.float32)
    looks = np.full(40, 3.7)
    sensor = replace(radar(), channels=("HH",))
    drawn = faded_draws(mean, np.full(40, 0.5), looks, np.ones(40), 1.0, sensor, 1, 1, 8)
    share = (drawn < 2.0).mean()
    true = gammainc(3.7, 3.7 * 2.0 / 2.5)
    assert abs(share - true) < 4.0 * np.sqrt(true * (1 - true) / drawn.size)


def test_a_utility_of_its_own_gets_the_whole_image() -> None:
    table = ENGINES["psm"].table("")
    chosen, _ = ENGINES["psm"].plan(ground("flat"), radar(), table, SEED, 1, ("package:function",), Demand(50.0))
    assert chosen.chosen.rung == "F4"
    assert all(rung.refused for rung in chosen.rungs[:-1])
    assert tuple(rung.rung for rung in chosen.rungs) == RUNGS


def radiometer() -> object:
    fixed: dict[str, float | str] = {
        "bandwidth": 100.0,
        "noise_temperature": 500.0,
        "scan_period": 2.5,
        "altitude_m": 6000.0,
    }
    fixed |= {"speed_m_s": 80.0, "integration_time": 8.0}
    return ENGINES["prm"].configure({"frequency": 18.0, "polarization": "H+V", "resolution": 150.0}, fixed)


LAND = ("Water", "Trees", "Grass", "Bareground")


@pytest.mark.parametrize(("kind", "rung"), [("flat", "F0"), ("flat", "F3"), ("rolling", "F2")])
def test_radiometer_rungs_err_by_no_more_than_their_bound(kind: str, rung: str) -> None:
    scene = ground(kind, LAND, 30.0)
    true, _ = scores(scene, radiometer(), "F4", 3.0, "prm")
    cheap, made = scores(scene, radiometer(), rung, 3.0, "prm")
    difference = cheap - true
    error = difference.std(ddof=1) / np.sqrt(len(difference))
    assert abs(difference.mean()) <= made.bias + 0.5 * made.sampling + 3.0 * error
    once = plan(scene, radiometer(), 1, rung, 3.0, "prm")[0].of("F4").scatter
    assert difference.std(ddof=1) <= 1.45 * np.hypot(made.bias + made.sampling, once)
    assert cheap.std(ddof=1) > 0.5 * true.std(ddof=1)


def test_noise_has_no_more_of_the_variance_than_the_bound_says() -> None:
    """One draw of the whole image against eight: quiet receivers decide few footprints, and the bound knows it."""
    from seqrsm.score.sampled import percent_correct_radiometer

    scene, scatter = ground("flat", LAND, 30.0), []
    for run in RUNS:
        chosen, make = plan(scene, radiometer(), run, "F3", 3.0, "prm")
        found = []
        for draws in (1, 8):
            sample = make(replace(chosen.chosen, draws=draws))
            found.append(percent_correct_radiometer(sample, scene, seed=SEED, run_id=run).value)
        scatter.append(found[0] - found[1])
    bound = chosen.of("F4").scatter
    assert bound < 50.0 * (chosen.of("F4").rows * chosen.of("F4").columns) ** -0.5
    assert 0.2 * bound < np.std(scatter, ddof=1) < 1.3 * bound


def test_relief_counts_by_the_mean_over_the_swath() -> None:
    """The emissivity curves are steep at the edge of the sweep only: the bound takes each place's own steepness."""
    from seqrsm.campaign.engines import statistics_of
    from seqrsm.simulate.radiometer.fidelity import _View
    from seqrsm.simulate.radiometer.prm import meet_radiometer

    scene, sensor = ground("rolling", LAND, 30.0), radiometer()
    met = meet_radiometer(scene, sensor, ENGINES["prm"].table(""), seed=SEED, run_id=1)
    view = _View(scene, statistics_of(scene), sensor, met, ("percent_correct",))
    slopes = view.slope_of_curves
    places = [view.percent(row) for row in slopes]
    assert view.percent(slopes) == pytest.approx(np.mean(places), rel=1e-12)
    assert min(places) < view.percent(slopes) < max(places) <= view.percent(slopes.max(axis=0))
    curves = np.concatenate([look.emissivity for look in met.lookups], axis=1)
    degree = int(np.degrees(view.edge))
    steep = view.warm_k * np.abs(np.diff(curves[:, :, : degree + 1], axis=2)).max(axis=(1, 2))
    assert (slopes.max(axis=0) >= 0.95 * steep).all()


@pytest.mark.parametrize("rung", ["F0", "F2"])
def test_a_retrieval_taught_by_few_footprints_keeps_to_its_bound(rung: str) -> None:
    """Few footprints teach a worse polynomial: without its part in score and bound the bias was half a tolerance."""
    scene = ground("flat", ("Bareground", "Grass"), 30.0)
    fixed: dict[str, float | str] = {
        "bandwidth": 100.0,
        "noise_temperature": 500.0,
        "scan_period": 2.5,
        "altitude_m": 6000.0,
    }
    fixed |= {"speed_m_s": 80.0, "integration_time": 8.0}
    own = ENGINES["prm"]
    sensor = own.configure({"frequency": 4.0, "polarization": "H+V", "resolution": 400.0}, fixed)
    difference, pixels = [], 0
    for run in RUNS:
        chosen, make = own.plan(scene, sensor, own.table(""), SEED, run, ("retrieval_error",), Demand(0.7, rung))
        image = own.simulate(scene, sensor, own.table(""), SEED, run)
        true = own.utilities["retrieval_error"](image, scene, seed=SEED, run_id=run).value
        sample = make(chosen.chosen)
        pixels = sample.values.shape[2]
        difference.append(own.sampled["retrieval_error"](sample, scene, seed=SEED, run_id=run).value - true)
    made, error = chosen.chosen, np.std(difference, ddof=1) / np.sqrt(len(difference))
    assert pixels < 0.5 * chosen.of("F4").rows * chosen.of("F4").columns
    assert made.bound <= 0.7
    assert abs(np.mean(difference)) <= 0.25 * made.bound + 3.0 * error
    assert np.sqrt(np.mean(np.square(difference))) <= made.bound


@pytest.mark.parametrize(
    ("shares", "low", "high"), [((1 / 6,) * 6, 1.1, 1.2), ((0.25,) * 4, 1.0, 1.1), ((0.005, 0.3, 0.695), 1.5, 1.7)]
)
def test_rare_classes_teach_worst(shares: tuple[float, ...], low: float, high: float) -> None:
    assert low < teaching_factor(shares) < high


def test_a_rare_class_makes_a_sample_err_more_and_stays_within_the_bound() -> None:
    """One class on a hundredth of the ground: the same number of pixels errs more than with equal shares."""
    scene = ground("flat")
    cover = scene.cover.copy()
    # Four in five of the fields of one class become another.
    cover[(cover == 1) & (scene.field_id % 20 != 0)] = 0
    rare = replace(scene, cover=cover)
    assert 0.0 < (cover == 1).mean() < 0.03
    true = scores(rare, radar(), "F4", 1.0)[0]
    cheap, made = scores(rare, radar(), "F2", 4.0)
    assert np.sqrt(np.mean((cheap - true) ** 2)) <= 1.3 * made.bound


def test_a_scene_with_little_to_score_is_seen_whole() -> None:
    scene = ground("rolling")
    few = np.zeros(scene.shape, dtype=bool)
    few[40:43, 50:53] = True
    scene = replace(scene, scored=few & (scene.cover < len(COVERS)))
    for tolerance in (5.0, 1e6):
        chosen, _ = plan(scene, radar(), 1, "auto", tolerance)
        assert chosen.chosen.rung == "F4"
        json.dumps(chosen.to_json(), allow_nan=False)
    lone = replace(scene, scored=few & (np.cumsum(few).reshape(few.shape) == 1))
    chosen, _ = plan(lone, radar(60.0), 1, "auto", 1e6)
    assert "pixels are scored" in chosen.of("F0").refused


def test_a_scene_of_one_field_is_planned_and_scored() -> None:
    scene = synthetic_scene(60, 70, 5.0, categories=("Grass",), field_m=5000.0, seed=1)
    assert scores(scene, radar(), "auto", 5.0)[0].min() == 100.0


@pytest.mark.parametrize("engine", ["psm", "prm"])
def test_a_class_of_few_pixels_is_seen_whole(engine: str) -> None:
    """A road of one cell: whether a sample teaches its class at all moved scores by up to 30 percent."""
    scene = ground("flat", LAND, 5.0 if engine == "psm" else 30.0)
    cover, field = scene.cover.copy(), scene.field_id.copy()
    cover[150], field[150] = len(LAND), scene.n_fields
    road = replace(scene, cover=cover, field_id=field, categories=(*LAND, "Asphalt"))
    sensor = radar(40.0) if engine == "psm" else radiometer()
    chosen, _ = plan(road, sensor, 1, "auto", 10.0, engine)
    assert "the rarest cover fills" in chosen.of("F0").refused
    assert chosen.chosen.rung == "F4"
    # More pixels of the class: it may be sampled again, at least as many of them.
    cover[140:160], field[140:160] = len(LAND), scene.n_fields
    wide = replace(scene, cover=cover, field_id=field, categories=(*LAND, "Asphalt"))
    chosen, _ = plan(wide, sensor, 1, "auto", 10.0, engine)
    made = chosen.of("F2")
    assert not made.refused
    assert made.bound <= 10.0
    assert made.rows * made.columns * (cover == len(LAND)).mean() >= 29.0
