"""Retrieved soil moisture: exact where nothing disturbs, against a scalar optimal estimate, and by band."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import integrate, sparse, special, stats

sys.path.insert(0, str(Path(__file__).parents[1] / "physics"))

from prm_cases import radiometer, scene
from shorthands import still_radiometer

from seqrsm.errors import SceneError
from seqrsm.scattering.calendar import SHIPPED
from seqrsm.scattering.coherence import limited
from seqrsm.scattering.curves import moisture_change_db
from seqrsm.scattering.emissivity import MOISTURE_NODES, load_emissivity_table
from seqrsm.scattering.sigma0 import load_sigma0_table
from seqrsm.scattering.worlds import World
from seqrsm.scene.file import load_scene
from seqrsm.score import bare_soil, brightness, moisture
from seqrsm.score.bare_soil import _away_from_edges, _covariance, _departures_db, _looked_up, retrieved_fields
from seqrsm.score.brightness import (
    GRID,
    _costs,
    _expected_k,
    _held_pixels,
    _weights,
    expected_ground,
    own_of_squares,
    posterior_mean,
    retrieved_squares,
)
from seqrsm.score.brightness import _covariance as _of_brightness
from seqrsm.score.moisture import expected_spread, refuse_alike, score_moisture
from seqrsm.score.pixels import seen_pixels
from seqrsm.score.utilities import asked_for
from seqrsm.sensor.named import with_noise
from seqrsm.sensor.radar import from_settings
from seqrsm.simulate.radar import occasion
from seqrsm.simulate.radar.frame import pieces
from seqrsm.simulate.radar.psm import expected_image, simulate_radar
from seqrsm.simulate.radiometer.frame import local_angle_deg
from seqrsm.simulate.radiometer.prm import simulate_radiometer
from seqrsm.simulate.visits import Visit, regional_moisture

SIDE = 160
FIELD = np.kron(np.arange(400).reshape(20, 20), np.ones((8, 8), dtype=int))
KINDS = np.kron(np.random.default_rng(9).integers(0, 2, (20, 20)), np.ones((8, 8), dtype=int))
BAND = {
    "channels": ("H", "V"), "resolution_m": 60.0, "altitude_m": 2000.0, "bandwidth_mhz": 25.0, "scan_period_s": 0.6,
    "integration_time_ms": 2.0, "temperature_date_sd_k": 3.0, "temperature_field_sd_k": 1.0,
}  # fmt: skip
ERROR, SKILL = asked_for("soil_moisture_error"), asked_for("soil_moisture_skill")


def land(categories, cover=KINDS):
    return scene(np.zeros(cover.shape), 10.0, cover, FIELD, categories)


def quiet_table():
    """The shipped table without any variability of its own, and means known for certain."""
    table = load_emissivity_table()
    names = table.curves
    return replace(table, spread=dict.fromkeys(names, (0.0, 0.0, 0.0)), mean_sd=dict.fromkeys(names, 0.0))


@pytest.mark.parametrize("cone_deg", [0.0, 40.0])
def test_without_disturbance_the_moisture_is_found(cone_deg: float) -> None:
    s = land(("Bareground",), np.zeros_like(KINDS))
    r = radiometer(
        frequency_ghz=1.4, **{**BAND, "temperature_date_sd_k": 0.0, "temperature_field_sd_k": 0.0},
        noise_temperature_k=0.0, soil_moisture_field_sd=0.0, soil_moisture_region_m=400.0,
        conical_incidence_deg=cone_deg,
    )  # fmt: skip
    made = [simulate_radiometer(s, replace(r, bandwidth_mhz=1e3), quiet_table(), seed=2, run_id=k) for k in range(5)]
    each = [score_moisture([one], s, SKILL, seed=2, run_id=k) for k, one in enumerate(made)]
    assert np.median([one.value for one in each]) > (0.995 if cone_deg else 0.93)  # beams see beyond their squares
    found, score = made[2], each[2]
    assert (score.guess, score.perfect) == (0.0, 1.0)
    error = score_moisture([found], s, ERROR, seed=2, run_id=1)
    assert error.guess == pytest.approx(error.details["truth_sd"], rel=0.5)
    assert error.value == pytest.approx(error.guess * np.sqrt(1.0 - score.value))
    truth = found.occasion.field_moisture[FIELD]
    blocks = truth[:150, :150].reshape(6, 25, 6, 25).mean(axis=(1, 3))
    assert blocks.std() == pytest.approx(error.details["truth_sd"], rel=0.25)


@pytest.mark.parametrize(("bend", "noise", "sd"), [(0.0, 4.0, 0.05), (0.0, 4.0, 0.006), (300.0, 20.0, 0.3)])
def test_the_posterior_is_that_of_quadrature(bend: float, noise: float, sd: float) -> None:
    """One Gaussian observation of a line, straight or bent, under a Gaussian prior, by scipy's integrals."""
    slope, seen, mean = -150.0, 250.0, 0.2

    def shown(m):
        return 280.0 + slope * (m - 0.1) + bend * (m - 0.1) ** 2

    def law(m: float) -> float:
        return float(stats.norm.pdf(seen, shown(m), noise) * stats.norm.pdf(m, mean, sd))

    whole = integrate.quad(law, GRID[0], GRID[-1], points=[0.2, 0.3])[0]
    wanted = integrate.quad(lambda m: m * law(m), GRID[0], GRID[-1], points=[0.2, 0.3])[0] / whole
    cost = np.square((seen - shown(GRID)) / noise)
    assert posterior_mean(cost[None], GRID, mean, sd)[0] == pytest.approx(wanted, abs=1e-3)
    if bend:
        return
    # Conjugate, far from the ends.
    shrunk = (mean / sd**2 + 0.3 * (slope / noise) ** 2) / (1.0 / sd**2 + (slope / noise) ** 2)
    assert wanted == pytest.approx(shrunk, abs=1e-4)
    certain = posterior_mean(np.stack([cost, cost]), GRID, GRID[20], np.array([[0.0], [sd]]))
    assert certain[0] == pytest.approx(GRID[20])


def test_longer_waves_see_moister_soil_and_dense_crops_hide_it() -> None:
    """Skill falls from L to K band; under wheat and grass at K band little is left."""
    s = land(("Wheat", "Grass"))
    skills = {}
    for f in (1.4, 6.9, 18.7):
        found = []
        for run in range(24):
            table = load_emissivity_table().in_world(World(4, run))
            one = simulate_radiometer(s, radiometer(frequency_ghz=f, **BAND), table, seed=4, run_id=run)
            found.append(score_moisture([one], s, SKILL, seed=4, run_id=run))
        skills[f] = float(np.mean([score.value for score in found]))
    assert skills[1.4] > 0.6
    assert skills[1.4] - 0.1 > skills[6.9] > skills[18.7] + 0.3
    assert skills[18.7] < 0.3


def mean_skill(s, frequency: float) -> float:
    found = []
    for run in range(8):
        table = load_emissivity_table().in_world(World(4, run))
        one = simulate_radiometer(s, radiometer(frequency_ghz=frequency, **BAND), table, seed=4, run_id=run)
        found.append(score_moisture([one], s, SKILL, seed=4, run_id=run).value)
    return float(np.mean(found))


def test_footprints_of_one_field_do_not_count_as_so_many_fields() -> None:
    """25 fields under some 700 footprints: counted apart they would be believed too much (skill 0.1)."""
    large = np.kron(np.arange(25).reshape(5, 5), np.ones((32, 32), dtype=int))
    assert mean_skill(scene(np.zeros((SIDE, SIDE)), 10.0, np.zeros((SIDE, SIDE)), large, ("Grass",)), 10.7) > 0.35


@pytest.mark.parametrize("channel", ["H", "V"])
@pytest.mark.parametrize("shared_sd", [0.045, 0.0])
@pytest.mark.parametrize("field_m", [250.0, 1000.0])
def test_large_fields_are_known_as_well_as_their_brightness_lets(
    field_m: float, shared_sd: float, channel: str
) -> None:
    """Against the mean of moisture given the brightness of a field, found by counting in a million draws of one."""
    cells, one = 160, round(field_m / 25.0)
    of_cell = np.arange(cells) // one
    field = of_cell[:, None] * (cells // one) + of_cell
    s = scene(np.zeros((cells, cells)), 25.0, np.zeros((cells, cells)), field, ("Bareground",))
    r = radiometer(**{
        "frequency_ghz": 1.4, "channels": (channel,), "resolution_m": 100.0, "integration_time_ms": 2.0,
        "bandwidth_mhz": 25.0, "scan_period_s": 1.0, "altitude_m": 3000.0, "speed_m_s": 100.0,
        "conical_incidence_deg": 40.0, "soil_moisture_low": 0.2, "soil_moisture_high": 0.2, "atmosphere": "none",
        "soil_moisture_field_sd": 0.05, "soil_moisture_region_sd": shared_sd, "temperature": "constant",
    })  # fmt: skip
    table, skills = load_emissivity_table(), []
    for run in range(8):
        found = simulate_radiometer(s, r, table, seed=4, run_id=run)
        skills.append(score_moisture([found], s, SKILL, seed=4, run_id=run).value)
    rng, n = np.random.default_rng(1), 1_000_000
    look = table.lookup(["Bareground"], 1.4, channel)
    wet = np.clip(rng.normal(0.2, np.hypot(0.05, shared_sd), n), 0.02, 0.5)
    reflected = 1.0 - np.interp(wet, MOISTURE_NODES, look.emissivity[0, :, 40])
    reflected *= 1.0 - look.field_part[0] * rng.standard_normal(n)
    warm = r.temperature_low_k + r.temperature_field_sd_k * rng.standard_normal(n)
    noise_k = float(np.nanmean(found.nedt_k)) / np.sqrt(
        found.brightness_k[0].size / 16.0**2
    )  # of a square's footprints
    seen = warm - reflected * (warm - 2.7) + noise_k * rng.standard_normal(n)
    ideal = 1.0 - np.mean(wet[np.argsort(seen)].reshape(1000, -1).var(axis=1)) / wet.var()
    # Footprints at the edges of small fields see two of them.
    assert -0.1 < np.mean(skills) - ideal < 0.08


@pytest.mark.parametrize("field_m", [100.0, 1000.0])
def test_the_mean_of_a_date_is_known_as_well_as_its_brightness_lets(field_m: float) -> None:
    """As above, of the brightness of a scene: however large its fields, what a date departs by is in each of them."""
    of_cell = np.arange(80) // round(field_m / 25.0)
    field = of_cell[:, None] * (of_cell[-1] + 1) + of_cell
    s = scene(np.zeros((80, 80)), 25.0, np.zeros((80, 80)), field, ("Bareground",))
    r = radiometer(**{
        "frequency_ghz": 1.4, "channels": ("H",), "resolution_m": 100.0, "integration_time_ms": 2.0,
        "bandwidth_mhz": 25.0, "scan_period_s": 1.0, "altitude_m": 3000.0, "speed_m_s": 100.0,
        "conical_incidence_deg": 40.0, "soil_moisture_low": 0.1, "soil_moisture_high": 0.3, "atmosphere": "none",
        "soil_moisture_field_sd": 0.02, "soil_moisture_region_sd": 0.0, "temperature": "constant",
    })  # fmt: skip
    table, errors = load_emissivity_table(), []
    for run in range(48):
        found = simulate_radiometer(s, r, table.in_world(World(3, run)), seed=4, run_id=run)
        errors.append(score_moisture([found], s, ERROR, seed=4, run_id=run).details["bias"])
    rng, n = np.random.default_rng(1), 1_000_000
    look = table.lookup(["Bareground"], 1.4, "H")
    wet = rng.uniform(0.1, 0.3, n)
    departed = np.hypot(look.mean_part[0], look.date_part[0]) * rng.standard_normal(n)
    reflected = (1.0 - np.interp(wet, MOISTURE_NODES, look.emissivity[0, :, 40])) * (1.0 - departed)
    warm = r.temperature_low_k + r.temperature_date_sd_k * rng.standard_normal(n)
    seen = warm - reflected * (warm - 2.7)
    ideal = np.sqrt(np.mean(wet[np.argsort(seen)].reshape(1000, -1).var(axis=1)))
    assert 0.7 * ideal < np.sqrt(np.mean(np.square(errors))) < 1.3 * ideal


def test_a_square_has_of_fields_what_its_mean_keeps() -> None:
    block = np.repeat([[0, 0, 1, 1, 2, 2]], 4, axis=0)
    field = np.array([[0, 0, 1, 2, 5, 3]] * 2 + [[0, 0, 1, 2, 5, 4]] * 2)
    s = scene(np.zeros((4, 6)), 10.0, np.repeat([[0, 0, 0, 0, 1, 0]], 4, axis=0), field, ("Bareground", "Trees"))
    np.testing.assert_allclose(own_of_squares(s, block, 4, np.array([True, False])), [1.0, 0.5, 0.5, 0.0])
    drawn = np.random.default_rng(2).standard_normal((200_000, 6))
    of_square = drawn[:, field].reshape(len(drawn), -1)[:, (block == 1).ravel()].mean(axis=1)
    assert of_square.var() == pytest.approx(0.5, rel=0.02)


def test_what_a_table_has_wrong_may_change_with_the_angle() -> None:
    """One level a cover for all angles would leave less (0.62)."""
    assert mean_skill(land(("Bareground", "Grass")), 10.7) > 0.69


@pytest.mark.parametrize(("frequency", "radiation"), [(1.4, "rayleigh_jeans"), (36.0, "planck")])
def test_what_is_expected_is_what_an_undisturbed_image_shows(frequency: float, radiation: str) -> None:
    s = land(("Bareground", "Grass"))
    r = radiometer(frequency_ghz=frequency, **{**BAND, "radiation": radiation})
    found = still_radiometer(s, r, load_emissivity_table(), seed=1, run_id=1)
    ground = expected_ground(found, s, seen_pixels(found))
    np.testing.assert_allclose(ground.share.sum(axis=-1), 1.0)
    np.testing.assert_allclose(ground.temperature_k, 300.0, atol=0.01)
    at = _expected_k(ground, slice(8, 9), [6])[:, 0, :, 0]  # 0.2
    # Half a kelvin of NEDT scale: the beam is a Gaussian there, and shares of cells here.
    away = found.mean_k[:, 8] - at
    assert np.abs(np.mean(away, axis=1)).max() < 1.0
    assert np.std(away, axis=1).max() < 3.0


@pytest.mark.parametrize(("heading_deg", "cone_deg"), [(90.0, 55.0), (0.0, 40.0), (180.0, 0.0), (270.0, 0.0)])
def test_the_angle_to_tilted_ground_is_that_of_vectors(heading_deg: float, cone_deg: float) -> None:
    """A plane that rises by 0.2 to the east and 0.1 to the north, seen from the line of flight or ahead of it."""
    row, column = np.indices((21, 31))
    east, north = 10.0 * (column - 15.0), -10.0 * (row - 10.0)
    height = 0.2 * east + 0.1 * north
    turns = radiometer(heading_deg=heading_deg, conical_incidence_deg=cone_deg).quarter_turns
    found = local_angle_deg(scene(height + 50.0), turns, 1050.0, cone_deg)
    flight = np.array([np.sin(np.radians(heading_deg)), np.cos(np.radians(heading_deg))])
    # From the ground to the craft: back along the flight, or to the line of flight over the middle.
    back = 1000.0 * np.tan(np.radians(cone_deg))
    aside = 0.0 * east if cone_deg else east * flight[1] - north * flight[0]
    ray = np.array([-back * flight[0] - aside * flight[1], -back * flight[1] + aside * flight[0], 1000.0 - height])
    cosine = (ray[2] - 0.2 * ray[0] - 0.1 * ray[1]) / np.linalg.norm(ray, axis=0) / np.sqrt(1.05)
    np.testing.assert_allclose(found, np.degrees(np.arccos(cosine)), atol=2e-3)


def test_slopes_are_not_taken_for_moisture() -> None:
    """Over hills of 8 deg the skill from H was 0.48 while they were taken for flat ground, where it is 0.92."""
    skills, x = [], np.arange(SIDE)
    hills = 10.0 * np.sin(x / 6.0) + 10.0 * np.cos(x / 7.0)[:, None]
    r = radiometer(frequency_ghz=6.9, conical_incidence_deg=45.0, **{**BAND, "channels": ("H",)})
    for z in (0.0 * hills, hills):
        s = replace(land(("Bareground",), np.zeros_like(KINDS)), elevation_m=z.astype(np.float32))
        for run in range(6):
            found = simulate_radiometer(s, r, load_emissivity_table(), seed=5, run_id=run)
            skills.append(score_moisture([found], s, SKILL, seed=5, run_id=run).value)
    assert np.mean(skills[6:]) > np.mean(skills[:6]) - 0.15


def test_costs_on_the_grid_are_squared_distances_from_what_is_expected_there() -> None:
    s = land(("Bareground", "Grass"))
    found = simulate_radiometer(s, radiometer(frequency_ghz=10.7, **BAND), load_emissivity_table(), seed=1, run_id=1)
    ground = expected_ground(found, s, seen_pixels(found))
    nodes = _expected_k(ground, slice(None), range(len(MOISTURE_NODES)))
    covariance = np.broadcast_to([[4.0, 1.5], [1.5, 3.0]], (*nodes.shape[1:3], 2, 2))[..., : len(nodes), : len(nodes)]
    weights = sparse.random_array((5, nodes[0, ..., 0].size), density=0.3, rng=np.random.default_rng(2), format="csc")
    costs = _costs(found, ground, weights, None, covariance)
    expected = np.apply_along_axis(lambda at: np.interp(GRID, MOISTURE_NODES, at), -1, nodes)
    away = found.brightness_k[..., None] - expected
    squares = np.einsum("aslm,slab,bslm->slm", away, np.linalg.inv(covariance), away)
    np.testing.assert_allclose(costs, weights @ squares.reshape(-1, len(GRID)), rtol=1e-6)


def test_the_covariance_is_that_of_what_is_drawn() -> None:
    """Fields, dates and means depart by parts of what their cover reflects at that angle and moisture."""
    s = land(("Bareground", "Grass"))
    r = radiometer(frequency_ghz=1.4, **BAND, conical_incidence_deg=40.0, soil_moisture_field_sd=0.0)
    found = simulate_radiometer(s, r, load_emissivity_table(), seed=1, run_id=1)
    ground = expected_ground(found, s, seen_pixels(found))
    place, node = (len(ground.share) // 2, 5), 4
    share, angle = ground.share[place], ground.angle_deg[place]
    _, through, sky = ground.air[:, place[0]]
    for common in (False, True):
        wanted = np.empty((2, 2))
        for a, one in enumerate(ground.lookups):
            for b, other in enumerate(ground.lookups):
                related = 1.0 if a == b else 1.0 - 0.1 * np.sin(np.deg2rad(40.0)) ** 2
                reflected = [
                    [1.0 - np.interp(angle, np.arange(91.0), kind[node]) for kind in look.emissivity]
                    for look in (one, other)
                ]
                parts = related * one.field_part * other.field_part
                if common:
                    parts = parts + related * one.date_part * other.date_part + one.mean_part * other.mean_part
                departed = np.sum(share**2 * parts * reflected[0] * reflected[1])
                wanted[a, b] = (through * (ground.temperature_k[place] - sky)) ** 2 * departed
                wanted[a, b] += through**2 * (1.0 + (9.0 if common else 0.0))
        ground = replace(ground, footprints_a_piece=3.0)
        wanted *= 1.0 if common else 3.0
        wanted += np.diag(found.nedt_k[(slice(None), *place)] ** 2)
        nothing = np.zeros((2, *ground.temperature_k.shape))
        own = None if common else nothing[0]
        made = _of_brightness(found, ground, nothing, float(MOISTURE_NODES[node]) + 1e-6, own)
        np.testing.assert_allclose(made[place], wanted, rtol=2e-3)


@pytest.mark.parametrize("resolution_m", [60.0, 500.0])
def test_footprints_of_a_field_in_a_square_are_counted_by_their_areas(resolution_m: float, monkeypatch) -> None:
    """Over four fields of 800 m and squares of 250 m, of which a footprint of 500 m holds several."""
    field = np.kron(np.arange(4).reshape(2, 2), np.ones((80, 80), dtype=int))
    s = scene(np.zeros((SIDE, SIDE)), 10.0, np.zeros((SIDE, SIDE)), field, ("Bareground",))
    r = radiometer(frequency_ghz=1.4, **{**BAND, "resolution_m": resolution_m})
    found, own = simulate_radiometer(s, r, load_emissivity_table(), seed=1, run_id=1), []
    ground = expected_ground(found, s, seen_pixels(found))
    n = np.count_nonzero(ground.share.sum(axis=-1))
    assert ground.footprints_a_piece == pytest.approx(max(n * 250.0**2 / 1600.0**2, 1.0))
    assert (ground.footprints_a_piece == 1.0) == (resolution_m == 500.0)
    # Squares that are one field each, and footprints in one or over several of them, have all that a field has.
    monkeypatch.setattr("seqrsm.score.brightness._covariance", lambda *a: own.append(a[4:]) or _of_brightness(*a))
    of = np.arange(SIDE) // 25
    even = replace(s, field_id=(7 * of[:, None] + of).astype(np.int32))
    retrieved_squares(found, even)
    np.testing.assert_allclose(own[1][0][ground.share.sum(axis=-1) > 0.0], 1.0)


def test_what_the_table_has_wrong_of_a_cover_by_the_square_of_the_angle_is_no_moisture() -> None:
    """5 K more at both ends of a sweep than in its middle, which straight lines leave 1 K of."""
    s = land(("Grass",), np.zeros_like(KINDS))
    found = simulate_radiometer(s, radiometer(frequency_ghz=1.4, **BAND), quiet_table(), seed=3, run_id=1)
    aside = np.square(found.scan.look_rad / found.scan.look_rad.max())[:, None]
    bent = replace(found, brightness_k=found.brightness_k + 5.0 * (aside - aside.mean()))
    (plain, _), (value, _) = (retrieved_squares(image, s) for image in (found, bent))
    assert np.ptp(plain) > 0.05
    np.testing.assert_allclose(value, plain, atol=1e-3)


@pytest.mark.parametrize("channels", [("H",), ("V",), ("H", "V")])
def test_a_radiometer_believes_its_brightness_as_far_as_it_may(channels: tuple[str, ...]) -> None:
    """The truth of squares regressed on what is retrieved has about the slope 1, in worlds that the table misses."""
    s, slopes = land(("Bareground", "Grass")), []
    r = radiometer(frequency_ghz=1.4, **{**BAND, "channels": channels}, conical_incidence_deg=40.0)
    for run in range(24):
        found = simulate_radiometer(s, r, load_emissivity_table().in_world(World(4, run)), seed=4, run_id=run)
        value, unit = retrieved_squares(found, s)
        cells = unit >= 0
        truth = np.bincount(unit[cells], found.occasion.field_moisture[s.field_id[cells]]) / np.bincount(unit[cells])
        slopes.append(np.cov(value, truth)[0, 1] / value.var(ddof=1))
    assert 0.85 < np.mean(slopes) < 1.15


def test_a_footprint_tells_of_the_cells_that_it_holds_or_if_it_holds_none_of_the_nearest() -> None:
    """The first holds two of three cells, and the gap's is not its own; the second, between centres, has one."""
    seen = SimpleNamespace(coverage=np.array([[1, 2, 0, 0, 1, 0]]), brightness_k=np.zeros((2, 1, 4)))
    held = _held_pixels(seen, np.array([[0, 0, 0, 1, 3, -1]]))
    np.testing.assert_array_equal(held, [[0, 0, -1, 1, 3, -1]])


@pytest.mark.parametrize("cone_deg", [0.0, 40.0])
def test_ground_between_sweeps_is_not_known_by_them(cone_deg: float) -> None:
    """Sweeps 400 m apart that see 60 m each: squares in gaps had the nearest's moisture, and skill was below a guess's.

    They have the mean of all; what the others tell is believed as far as it may.
    """
    s, slopes, skills = land(("Bareground", "Grass")), [], []
    apart = {**BAND, "scan_period_s": 400.0 / 70.0 * (1.0 if cone_deg else 2.0), "speed_m_s": 70.0}
    r = radiometer(frequency_ghz=1.4, **apart, conical_incidence_deg=cone_deg, soil_moisture_region_m=200.0)
    for run in range(24):
        found = simulate_radiometer(s, r, load_emissivity_table().in_world(World(4, run)), seed=4, run_id=run)
        value, unit = retrieved_squares(found, s)
        cells = unit >= 0
        truth = np.bincount(unit[cells], found.occasion.field_moisture[s.field_id[cells]]) / np.bincount(unit[cells])
        seen = np.bincount(unit[cells], found.coverage[cells]) > 0
        assert 0 < np.count_nonzero(~seen) < len(seen)
        assert np.ptp(value[~seen]) < 0.01  # moisture has ends
        slopes.append(np.cov(value[seen], truth[seen])[0, 1] / value[seen].var(ddof=1))
        skills.append(score_moisture([found], s, SKILL, seed=4, run_id=run).value)
    assert 0.8 < np.mean(slopes) < 1.2
    assert np.mean(skills) > 0.1


def test_moisture_that_fields_have_of_their_own_is_no_sign_of_more_noise() -> None:
    """Where all of it is one field's, noise as stated: the truth regressed on what is retrieved has the slope 1."""
    of = np.arange(160) // 40  # 1 km: beams at edges of fields see two of them
    s = scene(np.zeros((160, 160)), 25.0, np.zeros((160, 160)), of[:, None] * 4 + of, ("Grass",))
    state = {"soil_moisture_low": 0.2, "soil_moisture_high": 0.2, "soil_moisture_field_sd": 0.04}
    r = radiometer(
        frequency_ghz=1.4, **{**BAND, "channels": ("H",), "resolution_m": 100.0, "altitude_m": 3000.0,
           "temperature_field_sd_k": 0.0}, **state, soil_moisture_region_sd=0.0, conical_incidence_deg=40.0,
    )  # fmt: skip
    slopes = []
    for run in range(16):
        found = simulate_radiometer(s, r, quiet_table(), seed=4, run_id=run)
        value, unit = retrieved_squares(found, s)
        truth = np.bincount(unit[unit >= 0], found.occasion.field_moisture[s.field_id[unit >= 0]]) / 100.0
        slopes.append(np.cov(value, truth)[0, 1] / value.var(ddof=1))
    assert np.mean(slopes) == pytest.approx(1.0, abs=0.06)


def test_squares_and_footprints_tell_of_each_other_by_what_they_share() -> None:
    pixel = np.repeat(np.repeat(np.arange(4).reshape(2, 2), 4, axis=0), 4, axis=1)
    fine = np.arange(64).reshape(8, 8)
    whole = np.zeros((8, 8), dtype=np.int64)
    np.testing.assert_allclose(_weights(pixel, whole, 4, 1).toarray(), 1.0)  # footprints inside a square
    np.testing.assert_allclose(_weights(pixel, fine, 4, 64).toarray().sum(axis=1), 1.0)  # squares inside footprints
    half = np.repeat([[0, 0, 0, 0, 0, 0, 1, 1]], 8, axis=0)
    np.testing.assert_allclose(_weights(pixel, half, 4, 2).toarray(), [[1, 0.5, 1, 0.5], [0, 0.5, 0, 0.5]])


def test_fields_near_each_other_are_as_wet() -> None:
    """Correlation of 1/e at the stated length, standard deviation of 1: over 300 draws."""
    places = np.array([[500.0, 500.0, 500.0], [500.0, 1500.0, 4500.0]])
    drawn = np.array([regional_moisture(Visit(), places, 1000.0, seed=1, run_id=k) for k in range(600)])
    assert drawn.std(axis=0) == pytest.approx(1.0, abs=0.08)
    correlation = np.corrcoef(drawn.T)
    assert correlation[0, 1] == pytest.approx(np.exp(-1.0), abs=0.09)
    assert abs(correlation[0, 2]) < 0.12


def test_ground_that_shows_no_moisture_is_refused() -> None:
    s = land(("Water", "Asphalt"))
    found = simulate_radiometer(s, radiometer(**BAND), load_emissivity_table(), seed=2, run_id=1)
    with pytest.raises(SceneError, match="retrievable soil moisture"):
        score_moisture([found], s, ERROR, seed=1, run_id=1)


def test_a_scene_within_one_square_is_told_to_be_larger() -> None:
    """It was told to let fields differ, which helps nowhere where there is one square."""
    s = scene(np.zeros((24, 24)), 10.0, np.zeros((24, 24), int), FIELD[:24, :24], ("Bareground",))
    found = simulate_radiometer(s, radiometer(**BAND), load_emissivity_table(), seed=2, run_id=1)
    words = "soil moisture shows in a single square of 250 m: there is nothing to compare.* Use a larger scene"
    with pytest.raises(SceneError, match=words) as told:
        score_moisture([found], s, ERROR, seed=1, run_id=1)
    assert "differ" not in str(told.value)


def test_a_radar_that_sees_a_single_bare_field_is_told_so() -> None:
    cover = np.where(FIELD[:40, :40] == 0, 0, 1)
    s = scene(np.zeros((40, 40)), 10.0, cover, FIELD[:40, :40], ("Bareground", "Trees"))
    found = radar_image(s, load_sigma0_table())
    with pytest.raises(SceneError, match="soil moisture shows in a single field"):
        score_moisture([found], s, ERROR, seed=1, run_id=1)


def test_footprints_that_scatter_more_than_is_stated_are_believed_less() -> None:
    """30 K of noise that nothing accounts for: taken at its word it would spread squares by 0.036 m3/m3, not 0.009."""
    s = land(("Bareground", "Grass"))
    found = simulate_radiometer(s, radiometer(frequency_ghz=1.4, **BAND), load_emissivity_table(), seed=2, run_id=1)
    noise = 30.0 * np.random.default_rng(1).standard_normal(found.brightness_k.shape)
    value, _ = retrieved_squares(replace(found, brightness_k=found.brightness_k + noise), s)
    assert value.std() < 0.02


def test_blind_footprints_leave_the_mean() -> None:
    s = land(("Bareground", "Grass"))
    found = simulate_radiometer(s, radiometer(frequency_ghz=1.4, **BAND), load_emissivity_table(), seed=2, run_id=1)
    blind = replace(found, brightness_k=np.full_like(found.brightness_k, np.nan))
    value, _ = retrieved_squares(blind, s)
    assert value == pytest.approx(0.2, abs=0.005)  # the prior, cut at the grid's ends


def test_the_spread_expected_is_that_of_many_occasions() -> None:
    s = land(("Bareground",), np.zeros_like(KINDS))
    r = radiometer(frequency_ghz=1.4, **BAND, soil_moisture_region_m=600.0)
    drawn, floors = [], []
    for run in range(80):
        found = simulate_radiometer(s, r, quiet_table(), seed=5, run_id=run)
        score = score_moisture([found], s, ERROR, seed=5, run_id=run)
        drawn.append(score.details["truth_sd"])
        floors.append(score.guess)
    assert np.ptp(floors) == 0.0
    # 80 occasions whose spread varies by a quarter or so.
    assert np.sqrt(np.mean(np.square(drawn))) == pytest.approx(floors[0], rel=0.08)


def test_a_guess_has_no_skill_however_few_the_fields() -> None:
    """Of four fields a quarter of their own variance goes with the date's mean: a guess of it had a skill of 0.25."""
    s = land(("Bareground",), np.zeros_like(KINDS))
    field = np.repeat([3, 40, 41, 200], [50, 150, 100, 300])
    block = np.repeat([0, 1, 2], [50, 250, 300])  # the middle one holds two fields
    r = radiometer(frequency_ghz=1.4, **BAND, soil_moisture_field_sd=0.04, soil_moisture_region_sd=0.0)
    own = 0.04 * np.random.default_rng(1).standard_normal((40_000, 4))
    value = np.stack([own[:, 0], own[:, 1:3] @ [0.6, 0.4], own[:, 3]])
    weight = np.array([50.0, 250.0, 300.0]) / 600.0
    variance = np.mean(weight @ np.square(value - weight @ value))
    assert expected_spread(r, s, block, field) == pytest.approx(np.sqrt(variance), rel=0.01)


def bare_and_wooded(layer: bool = False):
    """Bare fields beside trees, whose backscatter shows no moisture."""
    s = land(("Bareground", "Trees"))
    wet = np.linspace(0.08, 0.28, 400)[np.random.default_rng(0).permutation(400)][FIELD]
    return replace(s, soil_moisture=wet.astype(np.float32) if layer else None)


def radar_image(
    s,
    table,
    run_id=1,
    frequency=5.4,
    polarization="HH+VV",
    resolution=20.0,
    member=0,
    visit=None,
    noise_db=None,
    **more,
):
    given = {"soil_moisture_field_sd": 0.04, "soil_moisture_region_sd": 0.045, "depression_angle": 50.0, **more}
    radar = from_settings(
        {"frequency": frequency, "polarization": polarization, "resolution": resolution},
        {"bandwidth": 80.0, "peak_power": 3000.0, "altitude_m": 6000.0, **given},
    )
    if noise_db is not None:
        radar = with_noise(radar, noise_db)
    return simulate_radar(s, radar, table, seed=5, run_id=run_id, visit=visit or Visit(member=member))


def test_a_radar_finds_the_moisture_of_bare_fields_where_nothing_else_differs() -> None:
    s, table = bare_and_wooded(), load_sigma0_table()
    even = {
        (n, p): replace(table.variability[n, p], field_sd_db=(0.0, 0.0), date_sd_db=0.0) for n, p in table.variability
    }
    even_table = replace(table, variability=even)
    found = radar_image(s, even_table, fading="none", texture_db=0.0, tree_height_m=0.0)
    value, unit = retrieved_fields([found], s, 5, 1)
    assert set(np.unique(s.cover[unit >= 0])) == {0}  # bare fields alone
    truth = np.zeros(len(value))
    truth[unit[unit >= 0]] = found.occasion.field_moisture[FIELD][unit >= 0]
    assert np.corrcoef(value, truth)[0, 1] > 0.97
    assert score_moisture([found], s, SKILL, seed=5, run_id=1).value > 0.6


def test_a_radars_skill_lies_between_a_guess_and_all_that_roughness_leaves() -> None:
    s, table = bare_and_wooded(), load_sigma0_table()
    skills = []
    for run in range(6):
        found = radar_image(s, table.in_world(World(4, run)), run)
        score = score_moisture([found], s, SKILL, seed=5, run_id=run)
        skills.append(score.value)
        assert (score.guess, score.perfect) == (0.0, 1.0)
    assert 0.15 < np.mean(skills) < 0.8


def test_the_moisture_of_fields_that_lie_bare_is_found_whatever_is_sown_in_them() -> None:
    """In January fields of maize are bare ground; in July their canopy hides the soil."""
    table, skills = load_sigma0_table(), {}
    for name in ("Bareground", "Corn"):
        s = land((name, "Trees"))
        given = {"visit": Visit((15.0,)), "soil_moisture_field_sd": 0.12}
        found = [radar_image(s, table.in_world(World(4, k)), k, **given) for k in range(12)]
        skills[name] = [score_moisture([one], s, SKILL, seed=5, run_id=k).value for k, one in enumerate(found)]
    assert np.mean(skills["Corn"]) > 0.15
    assert np.mean(skills["Corn"]) == pytest.approx(np.mean(skills["Bareground"]), abs=0.12)
    july = radar_image(s, table, visit=Visit((195.0,)))
    with pytest.raises(SceneError, match="no scored cells have retrievable soil moisture"):
        score_moisture([july], s, SKILL, seed=5, run_id=1)


def test_a_crops_field_shows_moisture_where_half_of_its_echo_is_the_soils() -> None:
    """By the channel that shows most, received or not: from C band on HV where it is 0.48, HH not before 0.59.

    Else levels of polarization would be scored over different fields.
    """
    half = []
    for frequency in (1.25, 2.6, 5.4, 9.6, 13.6):
        wet, dry = (10.0 ** (0.1 * moisture_change_db(frequency, 0.01, mv, 0.2)[:, 40]) for mv in (0.52, 0.04))
        half += (10.0 * np.log10((1.0 + wet) / (1.0 + dry))).tolist()
    assert min(half) < bare_soil._SEEN_DB < max(half) < min(half) + 1.0
    s, table = land(("Corn", "Trees")), load_sigma0_table()
    day = next(day for day in np.arange(120.0, 200.0, 0.25) if SHIPPED.closed("Corn", day) > 0.45)
    shown = {
        channels: (retrieved_fields([radar_image(s, table, 1, 5.4, channels, visit=Visit((day,)))], s, 5, 1)[1] >= 0)
        for channels in ("HH", "HV", "HH+HV")
    }
    for one in shown.values():
        np.testing.assert_array_equal(one, s.cover == 0)


@pytest.mark.parametrize(
    ("channel", "noise_db"), [("VV", -40.0), ("VV", -15.0), ("VV", -8.0), ("HV", -25.0), ("HV", -18.0), ("HV", -8.0)]
)
def test_noise_lessens_skill_by_what_it_hides_and_no_more(channel: str, noise_db: float) -> None:
    """Against the mean of moisture given the power of a field, found by counting in a million draws of one."""
    s, table, sd = land(("Bareground",), np.zeros_like(KINDS)), load_sigma0_table(), 0.08
    state = {"soil_moisture_low": 0.2, "soil_moisture_high": 0.2, "soil_moisture_field_sd": sd}
    state |= {"soil_moisture_region_sd": 0.0, "texture_db": 0.0, "altitude_m": 2e5, "speed_m_s": 300.0}
    skills = []
    for run in range(8):
        given = {"resolution": 10.0, "polarization": channel, "bandwidth": 300.0, "prf_hz": 500.0, "noise_db": noise_db}
        found = radar_image(s, table, run, **given, **state)
        skills.append(score_moisture([found], s, SKILL, seed=5, run_id=run).value)
    rng, grid = np.random.default_rng(1), np.linspace(0.0, 0.6, 61)
    theta = round(np.rad2deg(found.radar.centre_incidence_rad))
    looks = [table.lookup(["Bareground"], 5.4, channel, soil_moisture=float(m)) for m in grid]
    level = 10.0 * np.log10([look.sigma0[0, theta] for look in looks])
    wet = np.clip(rng.normal(0.2, sd, 1_000_000), 0.0, 0.6)
    echo_db = np.interp(wet, grid, level) + rng.normal(0.0, looks[0].field_sd_db[0], wet.size)
    n = found.looks.mean() * _away_from_edges(found, s).sum() / 400.0  # pixels of one cell of the scene
    seen = (10.0 ** (0.1 * echo_db) + 10.0 ** (0.1 * noise_db)) * rng.gamma(n, 1.0 / n, wet.size)
    order = wet[np.argsort(seen)].reshape(1000, -1)
    ideal = 1.0 - np.mean(order.var(axis=1)) / wet.var()
    assert np.mean(skills) == pytest.approx(ideal, abs=0.05)


@pytest.mark.parametrize("noise_db", [-40.0, -8.0])
def test_noise_lessens_what_dates_differ_by_as_it_does_their_moisture(noise_db: float) -> None:
    """Against the mean of moisture given the power of a date, found by counting in a million draws of one."""
    s, table = land(("Bareground",), np.zeros_like(KINDS)), load_sigma0_table()
    state = {"soil_moisture_low": 0.05, "soil_moisture_high": 0.4, "soil_moisture_field_sd": 0.0, "texture_db": 0.0}
    state |= {"soil_moisture_region_sd": 0.0, "altitude_m": 2e5, "speed_m_s": 300.0, "prf_hz": 500.0}
    grid, rng, told = np.linspace(0.0, 0.6, 61), np.random.default_rng(1), []
    looks = [table.lookup(["Bareground"], 5.4, "VV", soil_moisture=float(m)) for m in grid]
    wet = np.clip(rng.normal(0.225, 0.35 / np.sqrt(12.0), 1_000_000), 0.04, 0.52)
    parts = (looks[0].field_sd_db[0], looks[0].date_sd_db[0], looks[0].mean_sd_db[0])
    away = np.linalg.norm(parts) * rng.standard_normal(wet.size)
    for run in range(4):
        given = {"resolution": 10.0, "polarization": "VV", "bandwidth": 300.0, "noise_db": noise_db}
        found = radar_image(s, table, run, **given, **state)
        theta, met = round(np.rad2deg(found.radar.centre_incidence_rad)), found.occasion
        level = 10.0 * np.log10([look.sigma0[0, theta] for look in looks])

        def seen_db(moisture, offset_db, level=level):
            return 10.0 * np.log10(
                10.0 ** (0.1 * (np.interp(moisture, grid, level) + offset_db)) + 10 ** (0.1 * noise_db)
            )

        near = np.abs(seen_db(wet, away) - seen_db(met.soil_moisture, met.class_offset_db[0, 0])) < 0.03
        told.append((retrieved_fields([found], s, 5, run)[0].mean(), wet[near].mean()))
    value, wanted = np.transpose(told)
    assert 0.5 < np.ptp(value) / np.ptp(wanted) < 1.1
    assert value == pytest.approx(wanted, abs=0.04)


def test_a_channel_full_of_noise_takes_nothing_from_another() -> None:
    s, table = land(("Bareground",), np.zeros_like(KINDS)), load_sigma0_table()
    skills = []
    for run in range(8):
        for polarization in ("VV", "VV+VH"):
            found = radar_image(s, table, run, polarization=polarization, noise_db=-18.0)  # 4 dB above bare soil at VH
            skills.append(score_moisture([found], s, SKILL, seed=5, run_id=run).value)
    assert np.mean(skills[1::2]) > np.mean(skills[::2])


def test_a_radar_knows_the_slopes_of_fields() -> None:
    """Over hills of 9 deg the skill was 0.11 and the slope of the test below 0.48; flat ground has 0.27 and 0.82."""
    x, skills = np.arange(SIDE), []
    hills = 10.0 * np.sin(x / 6.0) + 10.0 * np.cos(x / 7.0)[:, None]
    for z in (0.0 * hills, hills):
        s = replace(land(("Bareground",), np.zeros_like(KINDS)), elevation_m=z.astype(np.float32))
        for run in range(8):
            found = radar_image(s, load_sigma0_table(), run)
            skills.append(score_moisture([found], s, SKILL, seed=5, run_id=run).value)
    assert np.mean(skills[8:]) > np.mean(skills[:8]) - 0.05


@pytest.mark.parametrize("more", [{}, {"range_format": "slant"}, {"receiver": "agc"}])
def test_the_image_expected_is_that_of_a_run_without_chance(more) -> None:
    """Beside a run in which nothing is drawn: no scatter of fields, dates, moisture and wind, no texture, no fading."""
    x = np.arange(SIDE)
    slopes = np.add.outer(x, 3.0 * np.sin(x / 9.0)).astype(np.float32)
    s, table = replace(bare_and_wooded(), elevation_m=slopes), load_sigma0_table()
    even = {key: replace(one, field_sd_db=(0.0, 0.0), date_sd_db=0.0) for key, one in table.variability.items()}
    table = replace(table, variability=even)
    narrow = {"soil_moisture_low": 0.2, "soil_moisture_high": 0.2, "wind_low_m_s": 4.0, "wind_high_m_s": 4.0}
    quiet = {"soil_moisture_field_sd": 0.0, "soil_moisture_region_sd": 0.0, "texture_db": 0.0, "fading": "none"}
    found = radar_image(s, table, **narrow, **quiet, **more)
    usual = expected_image(s, found.radar, table, None)
    np.testing.assert_allclose(usual.intensity, found.intensity, rtol=1e-4)


def test_a_radar_believes_its_backscatter_as_far_as_it_may() -> None:
    """Retrieved moisture is a mean given the image: the truth regressed on it has about the slope 1.

    Ignorant of the parts within fields the slope is 0.68, with all variances taken for four times as large 2.2.
    """
    s, slopes = bare_and_wooded(), []
    for run in range(24):
        found = radar_image(s, load_sigma0_table(), run)
        value, unit = retrieved_fields([found], s, 5, run)
        cells = unit >= 0
        truth = np.bincount(unit[cells], found.occasion.field_moisture[s.field_id[cells]]) / np.bincount(unit[cells])
        slopes.append(np.cov(value, truth)[0, 1] / value.var())
    assert 0.75 < np.mean(slopes) < 1.15


def covariance_of(found, s, place):
    """Of the field whose cells have place 0."""
    steps, kind = _looked_up(found, s, found.radar.recorded, bare_soil.GRID), np.array([0])
    _, *variances = _departures_db(found, s, place, kind, steps)
    return _covariance([found], steps[0], kind, *variances)


def test_a_bare_field_departs_by_roughness_its_parts_and_speckle() -> None:
    table, one = load_sigma0_table(), np.zeros((SIDE, SIDE), dtype=int)
    s = replace(land(("Bareground",), one), field_id=one.astype(np.int32))
    found = radar_image(s, table, texture_db=2.0, texture_m=40.0)
    place = np.full(one.shape, -1, dtype=np.int32)
    place[70:78, 70:78] = 0
    covariance = covariance_of(found, s, place)
    hh, vv = (table.lookup(["Bareground"], 5.4, channel) for channel in ("HH", "VV"))
    row = found.pixel_of_cell[place == 0] // found.intensity.shape[2]
    parts, looks = 2.0**2 / (80.0**2 / 40.0**2), found.looks[row].mean() * 80.0**2 / 20.0**2
    speckle = (10.0 / np.log(10.0)) ** 2 * special.polygamma(1, looks)  # variance of the logarithm of a gamma variate
    # Noise of a power n beside an echo of p makes d decibels of the echo d p / (p + n) of what is seen.
    theta, noise = found.incidence_angle_deg[row].mean(), found.noise_equivalent_sigma0[row].mean()
    power = np.array([np.interp(theta, look.theta_deg, look.sigma0[0]) for look in (hh, vv)])
    echo = power / (power + noise)
    at_40 = np.array([8.6, 7.1]) * np.sin(np.deg2rad(40.0)) * 0.2  # Baghdadi et al. 2016, heights 0.2 decades apart
    rest = np.sqrt(np.square([hh.field_sd_db[0], vv.field_sd_db[0]]) - at_40**2)
    rough = at_40 * np.sin(found.radar.centre_incidence_rad) / np.sin(np.deg2rad(40.0))
    own = (rest**2 + rough**2 + parts) * echo**2 + speckle
    assert covariance[0].diagonal() == pytest.approx(own, rel=1e-5)
    both = (hh.channel_correlation * (rest.prod() + parts) + rough.prod()) * echo.prod()
    assert covariance[0, 0, 1] == covariance[0, 1, 0] == pytest.approx(both, rel=1e-5)


@pytest.mark.parametrize("more", [{"pixel_m": 4.0}, {"range_format": "slant"}])
def test_pixels_do_not_change_how_much_speckle_a_field_has(more) -> None:
    """A resolution cell holds its looks, whatever the spacing of the pixels that show it."""
    one = np.zeros((SIDE, SIDE), dtype=int)
    s = replace(land(("Bareground",), one), field_id=one.astype(np.int32))
    place = np.full(one.shape, -1, dtype=np.int32)
    place[70:78, 70:78] = 0
    variances = []
    for changes in ({}, more):
        found = radar_image(s, load_sigma0_table(), looks=1.0, **changes)
        covariance = covariance_of(found, s, place)
        variances.append(covariance[0, 0, 0])
    assert variances[1] == pytest.approx(variances[0], rel=1e-3)


@pytest.mark.parametrize("more", [{"pixel_m": 5.0}, {"resolution": 5.0}, {"resolution": 40.0}, {"heading_deg": 33.0}])
def test_any_pixels_inside_a_field_tell_of_its_moisture(more) -> None:
    """Pixels of 20 m along fields of 80 m have a skill of 0.26. It was 0.09, a guess, with pixels finer than cells, of
    which most hold none, and of 40 m, which all have another field beside them; 0.17 with pixels across the fields.
    """
    s, skills = bare_and_wooded(), []
    for run in range(6):
        for changes in ({}, more):
            found = radar_image(s, load_sigma0_table(), run, **changes)
            skills.append(score_moisture([found], s, SKILL, seed=5, run_id=run).value)
            value, unit = retrieved_fields([found], s, 5, run)
            assert len(np.unique(value)) > 0.9 * len(np.unique(unit[unit >= 0]))
    assert np.mean(skills[1::2]) > np.mean(skills[::2]) - 0.05


def test_ground_beside_a_hole_is_not_compared() -> None:
    """Beside ground without data a pixel holds less echo, which is not that of drier soil."""
    s = bare_and_wooded()
    holed = s.elevation_m.copy()
    holed[40:48, 40:48] = np.nan
    found = radar_image(replace(s, elevation_m=holed, scored=np.isfinite(holed)), load_sigma0_table(), pixel_m=5.0)
    inside = _away_from_edges(found, s)
    assert inside[:38, :38].any()
    assert not inside[38:50, 38:50].any()


def test_what_lies_beside_small_bare_fields_does_not_outshine_them(monkeypatch) -> None:
    """At L band it is 15 dB brighter at HV: with the pixels at the edges, the control, some skills are below -1."""
    s = load_scene(Path(__file__).parents[2] / "campaigns" / "langegracht-radar" / "scene.npz")
    given = {"bandwidth": 50.0, "peak_power": 30.0, "altitude_m": 6000.0, "soil_moisture_field_sd": 0.04}
    settings = {"frequency": 1.25, "polarization": "HH+HV+VV", "resolution": 24.0, "depression_angle": 50.0}
    radar, skills, control = from_settings(settings, given), [], []
    for run in range(900, 912):
        found = simulate_radar(s, radar, load_sigma0_table().in_world(World(1979, run)), seed=1979, run_id=run)
        skills.append(score_moisture([found], s, SKILL, seed=1979, run_id=run).value)
        with monkeypatch.context() as patched:
            patched.setattr(bare_soil, "_away_from_edges", lambda image, _: image.pixel_of_cell >= 0)
            control.append(score_moisture([found], s, SKILL, seed=1979, run_id=run).value)
    assert np.mean(skills) > max(np.mean(control) + 0.2, 0.0)
    assert min(skills) > -0.6 > -1.0 > min(control)


def test_several_dates_and_bands_are_scored_together() -> None:
    """Each date by itself, errors about its own mean; two bands of one date tell more than each."""
    s, table, days = bare_and_wooded(), load_sigma0_table(), (100.0, 140.0)

    def seen(frequency: float, number: int, run: int):
        radar = from_settings(
            {"frequency": frequency, "polarization": "HH+VV", "resolution": 20.0, "depression_angle": 50.0},
            {"bandwidth": 80.0, "peak_power": 3000.0, "altitude_m": 6000.0, "soil_moisture_field_sd": 0.04},
        )
        at = table.in_world(World(4, run))
        return simulate_radar(s, radar, at, seed=5, run_id=run, visit=Visit(days, number))

    gains = []
    for run in range(6):
        first, second, other = seen(5.4, 0, run), seen(5.4, 1, run), seen(1.25, 0, run)
        key = {"seed": 5, "run_id": run}
        one, two = (score_moisture([image], s, ERROR, **key) for image in (first, second))
        both = score_moisture([second, first], s, ERROR, **key)
        assert both.value == pytest.approx(np.sqrt(0.5 * (one.value**2 + two.value**2)))
        assert both.n_cells == one.n_cells + two.n_cells
        assert both.guess == pytest.approx(one.guess)
        spreads = [score.details["truth_sd"] for score in (one, two)]
        assert both.details["truth_sd"] == pytest.approx(np.sqrt(np.mean(np.square(spreads))))
        alone = [score_moisture([image], s, SKILL, **key).value for image in (first, other)]
        gains.append(score_moisture([first, other], s, SKILL, **key).value - np.mean(alone))
    assert np.mean(gains) > 0.0
    r = radiometer(frequency_ghz=1.4, **BAND)
    felt = [simulate_radiometer(s, r, load_emissivity_table(), seed=5, run_id=1, visit=Visit(days, k)) for k in (0, 1)]
    squares = [score_moisture([image], s, ERROR, seed=5, run_id=1).value ** 2 for image in felt]
    assert score_moisture(felt, s, ERROR, seed=5, run_id=1).value == pytest.approx(np.sqrt(np.mean(squares)))
    with pytest.raises(SceneError, match="not by a combination"):
        score_moisture([felt[0], seen(5.4, 0, 1)], s, ERROR, seed=5, run_id=1)


def test_another_radar_does_not_make_a_retrieval_worse() -> None:
    """One at nearly the same frequency sees the same roughness again, and a coarse one only a few of the fields.

    Taken as independent of the first, the former made answers 1.52 times as wide; fields that the latter does not
    see were left at the date's mean, which made the error that of a guess.
    """
    s, table = bare_and_wooded(), load_sigma0_table()
    change, gains = [], []
    for run in range(6):
        at = table.in_world(World(4, run))
        radars = (5.4, "HH+VV", 20.0), (5.41, "HH+VV", 20.0, 1), (1.25, "HH", 60.0, 1)
        one, near, coarse = (radar_image(s, at, run, *radar) for radar in radars)
        alone, both = (retrieved_fields(images, s, 5, run)[0] for images in ([one], [one, near]))
        change.append(np.std(both) / np.std(alone))
        skills = [score_moisture(images, s, SKILL, seed=5, run_id=run).value for images in ([one], [one, coarse])]
        gains.append(skills[1] - skills[0])
    assert np.mean(change) == pytest.approx(1.0, abs=0.03)
    assert np.mean(gains) > -0.02


def low_and_high(s, table, run, polarization="HH+VV"):
    visits = (Visit(), Visit(member=1, angles_deg=(23.0, 43.0)))
    return [
        radar_image(s, table, run, 5.4, polarization, visit=visit, depression_angle=90.0 - angle, earth="flat")
        for visit, angle in zip(visits, (23.0, 43.0), strict=True)
    ]


def test_roughness_at_two_angles_is_related_as_it_is_drawn() -> None:
    s = bare_and_wooded()
    images = low_and_high(s, load_sigma0_table(), 1)
    steps = [look for image in images for look in _looked_up(image, s, image.radar.recorded, bare_soil.GRID)[0]]
    nothing = np.zeros((4, 1))
    found = _covariance(images, steps, np.array([0]), nothing, nothing, nothing + 1.0)[0]
    many, drawn = np.zeros(100_000, dtype=np.uint8), []
    for image, visit in zip(images, (Visit(), Visit(member=1, angles_deg=(23.0, 43.0))), strict=True):
        looks = [load_sigma0_table().lookup(["Bareground"], 5.4, channel) for channel in ("HH", "VV")]
        met = occasion.draw_occasion(image.radar, looks, many, (0.2, 5.0), visit, seed=1, run_id=1)
        drawn.append(met.field_offset_db)
    np.testing.assert_allclose(found, np.cov(np.vstack(drawn)), atol=0.03)


def test_parts_of_fields_are_related_by_the_angle_as_fields_are() -> None:
    """Their texture: what of a part's offset its field has not."""
    s, sky = bare_and_wooded(), {"earth": "flat", "soil_moisture_field_sd": 0.0, "soil_moisture_region_sd": 0.0}
    parts = []
    for visit, angle in zip((Visit(), Visit(member=1, angles_deg=(23.0, 43.0))), (23.0, 43.0), strict=True):
        own = {"visit": visit, "depression_angle": 90.0 - angle, "texture_m": 10.0, **sky}
        rough, plain = (radar_image(s, load_sigma0_table(), texture_db=db, **own).occasion for db in (1.0, 0.0))
        _, parent = pieces(s, 10.0)
        parts.append((rough.field_offset_db - plain.field_offset_db[:, parent])[0])
    assert len(parts[0]) > 5000
    assert np.corrcoef(parts)[0, 1] == pytest.approx(np.exp(-20.0 / 45.0), abs=0.03)


def test_the_relation_of_hh_and_vv_of_fields_differs_by_the_angle_as_their_powers_do(monkeypatch) -> None:
    drawn: list[np.ndarray] = []
    monkeypatch.setattr(occasion, "limited", lambda relation: drawn.append(relation) or limited(relation))
    s = land(("Bareground",), np.zeros_like(KINDS))
    for run in range(12):
        low_and_high(s, load_sigma0_table(), run, "HH+HV+VV+phase")
    low, high = np.concatenate(drawn[::2]), np.concatenate(drawn[1::2])
    assert len(low) >= 12 * 400
    for one, other in ((low.real, high.real), (low.imag, high.imag)):
        assert np.corrcoef(one, other)[0, 1] == pytest.approx(np.exp(-20.0 / 45.0), abs=0.04)


def test_a_second_angle_tells_moisture_from_roughness() -> None:
    """In worlds that the table does not know, too; and the answer is believed as far as it may.

    While fields departed alike at all angles the second took 0.06 from the skill, and the slope was 0.63. Of 80 worlds
    it adds 0.016 +- 0.004.
    """
    s, gains, slopes = bare_and_wooded(), [], []
    for run in range(64):
        images = low_and_high(s, load_sigma0_table().in_world(World(4, run)), run)
        skills = [score_moisture(used, s, SKILL, seed=5, run_id=run).value for used in (images[:1], images)]
        gains.append(skills[1] - skills[0])
        value, unit = retrieved_fields(images, s, 5, run)
        cells = unit >= 0
        truth = np.bincount(unit[cells], images[0].occasion.field_moisture[s.field_id[cells]])
        slopes.append(np.cov(value, truth / np.bincount(unit[cells]))[0, 1] / value.var())
    assert np.mean(gains) > 2.0 * np.std(gains, ddof=1) / np.sqrt(len(gains))
    assert 0.75 < np.mean(slopes) < 1.15


def test_radar_and_radiometer_draw_the_same_moisture() -> None:
    """The same fields are wet for both, with the same spread; a layer of the data base counts for both, too."""
    for s in (bare_and_wooded(), bare_and_wooded(layer=True)):
        seen = radar_image(s, load_sigma0_table(), run_id=3).occasion.field_moisture
        r = radiometer(frequency_ghz=1.4, **BAND)
        felt = simulate_radiometer(s, r, load_emissivity_table(), seed=5, run_id=3).occasion.field_moisture
        np.testing.assert_allclose(seen, felt, atol=0.021)  # the tables' ends differ by 0.02
        assert np.corrcoef(seen, felt)[0, 1] > 0.99


def test_a_radar_whose_fields_are_alike_has_no_moisture_to_find() -> None:
    s = bare_and_wooded()
    found = radar_image(s, load_sigma0_table(), soil_moisture_field_sd=0.0, soil_moisture_region_sd=0.0)
    assert found.occasion.field_moisture is None
    with pytest.raises(SceneError, match=r"ground of a run has the same soil moisture.*Let fields differ"):
        score_moisture([found], s, ERROR, seed=5, run_id=1)
    woods = land(("Trees", "Water"))
    with pytest.raises(SceneError, match="retrievable soil moisture"):
        score_moisture([radar_image(woods, load_sigma0_table())], woods, ERROR, seed=5, run_id=1)


def test_standard_errors_are_those_of_normal_errors(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of n errors of sd s: s / sqrt(2 n) of the root mean square, s^2 sqrt(2 / n) of its square, over the variance."""
    n, sd, spread = 20_000, 0.03, 0.05
    draw = np.random.default_rng(0).standard_normal((2, n))
    date = moisture._Date(np.ones(n), spread * draw[0], sd * draw[1], 0.0, spread, n)
    monkeypatch.setattr(moisture, "_compared", lambda *_: date)
    images = [SimpleNamespace(day=None)]
    error, skill = (score_moisture(images, None, asked, seed=0, run_id=0) for asked in (ERROR, SKILL))
    assert (error.value, error.se) == pytest.approx((sd, sd / np.sqrt(2.0 * n)), rel=0.06)
    assert skill.value == pytest.approx(1.0 - (sd / spread) ** 2, abs=0.02)
    assert skill.se == pytest.approx(sd**2 * np.sqrt(2.0 / n) / spread**2, rel=0.06)


@pytest.mark.parametrize("pieces", [0, 1])
def test_a_date_on_which_nothing_is_compared_does_not_change_the_skill(
    pieces: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Guessing is as good on it as one likes: crops hide all fields on the second of two dates, or all but one."""
    none = np.zeros(0)
    dates = {
        "bare": moisture._Date(np.full(2, 30.0), np.array([-0.05, 0.05]), np.array([0.01, -0.01]), 0.0, 0.05, 2),
        "few": moisture._Date(np.full(2, 10.0), np.array([-0.01, 0.01]), np.array([0.02, -0.02]), 0.0, 0.01, 2),
        "closed": moisture._Date(none, none, none, 0.0, 0.0, pieces),
    }
    monkeypatch.setattr(moisture, "_compared", lambda images, *_: dates[images[0].day])

    def scored(asked, *days: str):
        return score_moisture([SimpleNamespace(day=day) for day in days], None, asked, seed=0, run_id=0)

    assert scored(SKILL, "bare", "closed").value == pytest.approx(1.0 - (0.01 / 0.05) ** 2)
    assert scored(ERROR, "bare", "closed").guess == pytest.approx(0.05)
    # Cells count alike in errors and in what a guess is wrong by, whatever their date.
    expected = 1.0 - (60.0 * 0.01**2 + 20.0 * 0.02**2) / (60.0 * 0.05**2 + 20.0 * 0.01**2)
    assert scored(SKILL, "bare", "few").value == pytest.approx(expected)


def test_a_date_is_as_moist_as_one_between_the_stated_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    """The prior of the date's mean is that of a uniform draw, and of the ground's own departure about it."""
    asked: list[tuple[float, float]] = []

    def seen(costs, grid, mean, sd):
        asked.append((mean, sd))
        return posterior_mean(costs, grid, mean, sd)

    monkeypatch.setattr(brightness, "posterior_mean", seen)
    s = land(("Bareground",), np.zeros_like(KINDS))
    r = radiometer(
        frequency_ghz=1.4, **BAND, soil_moisture_low=0.1, soil_moisture_high=0.4, soil_moisture_region_sd=0.05
    )
    retrieved_squares(simulate_radiometer(s, r, quiet_table(), seed=2, run_id=1), s)
    of_date = stats.uniform(0.1, 0.3)
    assert asked[0] == pytest.approx((of_date.mean(), np.hypot(of_date.std(), 0.05)))


def test_ground_is_alike_unless_the_scene_or_a_sensor_lets_it_differ() -> None:
    still, differing = (SimpleNamespace(soil_moisture_field_sd=0.0, soil_moisture_region_sd=sd) for sd in (0.0, 0.04))
    plain, layered = SimpleNamespace(soil_moisture=None), SimpleNamespace(soil_moisture=np.full((4, 4), 0.2))
    with pytest.raises(SceneError, match="the same soil moisture"):
        refuse_alike([still, still], plain)
    refuse_alike([still, differing], plain)
    refuse_alike([still], layered)
