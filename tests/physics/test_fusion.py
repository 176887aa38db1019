"""Several images scored together: against scipy's Gaussians, and against single images."""

from __future__ import annotations

import numpy as np
import prm_cases
import psm_cases
import pytest
from scipy.stats import multivariate_normal
from shorthands import left, met_on_time, percent_correct

from seqrsm.campaign.simulation import acquisitions_of
from seqrsm.scattering.emissivity import load_emissivity_table
from seqrsm.scattering.sigma0 import load_sigma0_table
from seqrsm.scene.scene import Scene
from seqrsm.score.classification import halves
from seqrsm.score.cover import score_cover, score_evidence
from seqrsm.score.evidence import Evidence, decibels
from seqrsm.score.kernels_classify import mean_of_pixels
from seqrsm.score.pixels import pixels_of
from seqrsm.score.utilities import Asked
from seqrsm.sensor.radar import from_settings
from seqrsm.simulate.radar.occasion import draw_ground_state
from seqrsm.simulate.radar.psm import simulate_radar
from seqrsm.simulate.radiometer.prm import lookups_of, simulate_radiometer
from seqrsm.simulate.visits import Visit

CROPS = ("Wheat", "Corn", "Grass", "Vegetables")
TABLE = load_sigma0_table()


def number_of(n: int, side: int):
    """Numbers of square fields on a square of n cells."""
    place = np.arange(n) // side
    return (place[:, None] * (n // side) + place[None, :]).astype(np.int32)


def fields(side: int = 8, n: int = 192) -> Scene:
    """Square fields of four covers on flat ground, 10 m cells."""
    number = number_of(n, side)
    cover = np.random.default_rng(4).integers(len(CROPS), size=number.max() + 1).astype(np.uint8)[number]
    shape = (n, n)
    return Scene(np.zeros(shape, np.float32), cover, CROPS, number, np.ones(shape, np.bool_), 10.0)


SCENE = fields()


def radar(frequency=5.4, polarization="VV+VH", resolution=20.0, **more):
    settings = {"frequency": frequency, "polarization": polarization, "resolution": resolution, "bandwidth": 50.0}
    return from_settings({**settings, "peak_power": 200.0, "depression_angle": 50.0}, {"altitude_m": 6000.0, **more})


def image(configuration, visit, run_id=1, scene=SCENE):
    return simulate_radar(scene, configuration, TABLE, seed=2, run_id=run_id, visit=visit)


def dates(n, member=0, run_id=1, **more):
    days = tuple(130.0 + 20.0 * k for k in range(n))
    return [image(radar(**more), Visit(days, k, member), run_id) for k in range(n)]


def score(images, run_id=1) -> float:
    return percent_correct(images, SCENE, seed=2, run_id=run_id).value


def test_ground_that_one_image_does_not_see_counts_by_the_others() -> None:
    wide = image(radar(), Visit((150.0,)))
    part = image(radar(1.25, "HH+HV", far_incidence_deg=40.0), Visit((150.0,), 0, 1))
    assert (part.pixel_of_cell < 0).mean() > 0.2
    alone, both = (percent_correct(images, SCENE, seed=2, run_id=1) for images in ([wide], [wide, part]))
    assert both.n_cells == alone.n_cells
    assert both.value > alone.value
    # The mean of what is seen stands for the rest: written out.
    found = pixels_of([wide], SCENE, seed=2, run_id=1)
    pixel, counts = found.pixel, found.counts
    seen = mean_of_pixels(pixel, part.pixel_of_cell, part.apparent_sigma0().reshape(2, -1), len(counts))
    with np.errstate(invalid="ignore"):
        rows = 10.0 * np.log10(seen)
    used = counts.any(axis=1) & np.isfinite(rows[0])
    rows = np.where(np.isfinite(rows), rows, rows[:, used].mean(axis=1, keepdims=True))
    features = np.vstack([decibels(wide.apparent_sigma0().reshape(2, -1), counts), rows], dtype=np.float64)
    written = Evidence(features, counts, found.tile, found.keys, 0, counts)
    np.testing.assert_array_equal(both.confusion, score_evidence(written, CROPS, Asked("percent_correct")).confusion)


def test_radar_and_radiometer_meet_the_same_soil() -> None:
    passive = prm_cases.radiometer(soil_moisture_low=0.10, soil_moisture_high=0.30)
    table, found = load_emissivity_table(), []
    for run in range(20):
        for visit in (Visit((120.0, 150.0), 1), Visit()):
            wet, _ = draw_ground_state(radar(), visit, seed=2, run_id=run)
            looked = [table.lookup(CROPS, 10.0, "H")]
            other = met_on_time(passive, looked, SCENE, visit, seed=2, run_id=run)
            assert other.soil_moisture == pytest.approx(wet)
            found.append(wet)
    assert np.std(found) > 0.03


def test_covers_depart_on_a_date_nearly_alike_at_two_frequencies_of_a_radiometer():
    """As places of one class do in TELSEM2: 0.95 between 19 and 37 GHz, 0.73 between 19 and 85."""
    n, found = 4000, []
    for ghz in (19.35, 37.0, 85.5):
        looked = load_emissivity_table().lookup(("Grass",) * n, ghz, "V")
        sensor = prm_cases.radiometer(frequency_ghz=ghz, channels=("V",))
        met = met_on_time(sensor, [looked], SCENE, Visit(), seed=1, run_id=2)
        found.append(met.class_offset[0])
    assert np.corrcoef(found)[0, 1:] == pytest.approx([0.95, 0.73], abs=0.05)


def test_h_and_v_see_fields_alike_at_nadir_and_as_covers_at_53_degrees():
    """At nadir they are one channel: were fields not the same to both, H+V would tell covers apart by H seen twice."""
    table, found = load_emissivity_table(), []
    for more in ({"altitude_m": 200e3}, {"altitude_m": 1000.0}, {"conical_incidence_deg": 53.0}):
        both = prm_cases.radiometer(channels=("H", "V"), **more)
        looks = lookups_of(SCENE, both, table, None)
        met = [met_on_time(both, looks, SCENE, Visit(), seed=1, run_id=run) for run in range(8)]
        parts = np.hstack([one.field_offset / np.array([look.field_part[0] for look in looks])[:, None] for one in met])
        found.append(np.corrcoef(parts)[0, 1])
    # 1920 m wide, from 1 km: the mean of the sine's square, by a sum over the cells.
    across = (np.arange(192) - 95.5) * 10.0
    of_sweep = 1.0 - 0.1 * np.mean(across**2 / (across**2 + 1e6))
    assert found == pytest.approx([1.0, of_sweep, 1.0 - 0.1 * np.sin(np.deg2rad(53.0)) ** 2], abs=0.01)
    assert found[0] > 0.9999


def test_wide_footprints_that_tell_nothing_gain_nothing():
    """Where a footprint was wider than a tile, its noise told the half that it tests where the other had found what."""
    made, gain = prm_cases.Table((0.9, 0.9)), []
    for run in range(32):
        which = np.random.default_rng(run).permutation(np.arange(100) % 2).reshape(10, 10)
        ground = psm_cases.scene(np.zeros((100, 100)), 40.0, np.kron(which, np.ones((10, 10), int)), number_of(100, 2))
        fine = psm_cases.radar(resolution_m=40.0, altitude_m=20e3, peak_power_w=1e5)
        wide = {"channels": ("H", "V"), "resolution_m": 400.0, "altitude_m": 20e3, "scan_period_s": 8.0}
        blind = prm_cases.radiometer(**wide, noise_temperature_k=1e5)
        key = {"seed": 1, "run_id": run}
        images = [
            simulate_radar(ground, fine, psm_cases.Table((-10.0, -10.0)), **key),
            simulate_radiometer(ground, blind, made, visit=Visit(member=1), **key),
        ]
        assert [pixels_of(some, ground, **key).side_m for some in (images[:1], images)] == [250.0, 800.0]
        asked = Asked("class_mean_correct", by="field")
        gain.append(np.subtract(*(score_cover(some, ground, asked, **key).value for some in (images, images[:1]))))
    assert abs(np.mean(gain)) < 2.5 * np.std(gain) / np.sqrt(31.0) < 2.0


def test_what_a_radiometer_meets_tomorrow_is_nearly_what_it_met_today():
    """Emissivities of covers depart with the weather, which falls to 1/e in 4.5 days, as backscatter does."""
    days, n = (120.0, 121.0, 130.0), 4000
    looked = load_emissivity_table().lookup(("Grass",) * n, 10.7, "H")
    sensor = prm_cases.radiometer(frequency_ghz=10.7)

    def met(*days):
        visits = [Visit(days, t) for t in range(len(days))]
        return np.array([met_on_time(sensor, [looked], SCENE, v, seed=1, run_id=2).class_offset[0] for v in visits])

    found = met(*days)
    wanted = [[left(abs(one - other), 4.5) for one in days] for other in days]
    np.testing.assert_allclose(np.corrcoef(found), wanted, atol=0.05)
    np.testing.assert_allclose(found.std(axis=1), looked.date_part[0], rtol=0.05)
    np.testing.assert_array_equal(met(days[0]), found[:1])


def test_a_radiometer_that_looks_again_within_the_hour_meets_the_same_fields() -> None:
    """Else a second look would average away what fields differ by, and not its own noise alone."""
    ground = {"temperature_date_sd_k": 3.0, "temperature_field_sd_k": 1.0, "soil_moisture_field_sd": 0.04}
    days, sensor = (150.0, 150.04, 153.0), prm_cases.radiometer(frequency_ghz=6.9, **ground)
    looked = [load_emissivity_table().lookup(CROPS, 6.9, "H", day=day) for day in days]
    met = [
        [met_on_time(sensor, [looked[t]], SCENE, Visit(days, t), seed=1, run_id=k) for t in range(3)] for k in range(40)
    ]
    for of in (
        lambda one: one.field_offset[0],
        lambda one: one.field_temperature_k,
        lambda one: one.field_moisture - one.soil_moisture,
        lambda one: np.array([one.temperature_offset_k]),
    ):
        first, again, later = (np.concatenate([of(run[t]) for run in met]) for t in range(3))
        assert np.corrcoef(first, again)[0, 1] > 0.98
        assert np.corrcoef(first, later)[0, 1] < 0.9


def test_several_dates_are_one_gaussian_law_over_all_channels() -> None:
    """Moments, shrinking and law written out by numpy and scipy."""
    images = dates(3)
    found = pixels_of(images[:1], SCENE, seed=2, run_id=1)
    counts, tile, keys = found.counts, found.tile, found.keys
    x = np.vstack([decibels(i.apparent_sigma0().reshape(2, -1), counts) for i in images]).T.astype(np.float64)
    cells = counts.sum(axis=1)
    seen = np.bincount(tile, cells, minlength=len(keys)) > 0
    half = np.zeros(len(keys), dtype=int)
    half[seen] = halves(keys[seen])
    own, right, d = half[tile], 0, x.shape[1]
    for tested in (0, 1):
        teach, test = (cells > 0) & (own != tested), (cells > 0) & (own == tested)
        moments = []
        for k in range(len(CROPS)):
            w = np.where(counts[teach, k] >= 0.8 * cells[teach], counts[teach, k], 0).astype(float)
            mean = w @ x[teach] / w.sum()
            covariance = np.cov(x[teach].T, aweights=w, bias=True)
            moments.append((w.sum(), mean, covariance, w.sum() ** 2 / (w**2).sum()))
        total = sum(m[0] for m in moments)
        pooled = sum(m[0] * m[2] for m in moments) / total + 1e-6 * np.eye(d)
        prior = 2.0 * (d + 1)
        laws = [
            multivariate_normal(mean, (n * covariance + prior * pooled) / (n + prior)).logpdf(x[test])
            for _, mean, covariance, n in moments
        ]
        named = np.argmax(laws, axis=0)
        right += counts[test][np.arange(test.sum()), named].sum()
    found = percent_correct(images, SCENE, seed=2, run_id=1)
    assert found.value == pytest.approx(100.0 * right / cells.sum(), abs=0.02)


def test_pixels_of_another_image_are_averaged_over_cells() -> None:
    rng = np.random.default_rng(1)
    unit = rng.integers(-1, 30, (40, 50)).astype(np.int32)
    pixel = rng.integers(-1, 70, (40, 50)).astype(np.int32)
    layers = rng.random((2, 70))
    layers[:, 5] = np.nan
    both = (unit >= 0) & (pixel >= 0) & (pixel != 5)
    n = np.bincount(unit[both], minlength=31)
    expected = [np.bincount(unit[both], row[pixel[both]], minlength=31) for row in layers]
    found = mean_of_pixels(unit, pixel, layers, 31)
    np.testing.assert_allclose(found[:, n > 0], np.array(expected)[:, n > 0] / n[n > 0])
    assert np.isnan(found[:, n == 0]).all()


def test_dates_and_bands_add_up_and_do_not_depend_on_their_order() -> None:
    one, three = score(dates(1)), score(dates(3))
    other = dates(3, member=1, frequency=1.25, polarization="HH+HV", resolution=40.0)
    both = score([*dates(3), *other])
    assert three > one + 3.0
    assert both > max(three, score(other)) + 1.0
    assert score([*other, *dates(3)]) == pytest.approx(both, abs=0.3)


def test_a_radiometer_beside_a_radar_scores_over_the_radars_pixels() -> None:
    passive = simulate_radiometer(
        SCENE,
        prm_cases.radiometer(altitude_m=2000.0, resolution_m=100.0),
        load_emissivity_table(),
        seed=2,
        run_id=1,
        visit=Visit((150.0,), 0, 1),
    )
    active = image(radar(), Visit((150.0,), 0, 0))
    both = percent_correct([passive, active], SCENE, seed=2, run_id=1)
    alone = percent_correct([active], SCENE, seed=2, run_id=1)
    assert both.n_cells == alone.n_cells
    assert both.value > alone.value - 2.0


def test_a_member_alone_meets_the_same_ground_as_in_the_set() -> None:
    fixed = {"bandwidth": 50.0, "peak_power": 30.0, "altitude_m": 6000.0, "depression_angle": 45.0, "first_day": 150.0}
    settings = {"polarization": "HH+HV", "resolution": 20.0}
    (alone,) = acquisitions_of("psm", {**settings, "frequency": "L"}, fixed, {})
    together = acquisitions_of("psm", {**settings, "frequency": "L+C"}, fixed, {})
    one, two = (image(a.sensor, a.visit) for a in (alone, together[0]))
    np.testing.assert_array_equal(one.intensity, two.intensity)
