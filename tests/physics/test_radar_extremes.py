"""The radar at the ends of what can be asked: each has a defined result, checked against what is known of it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from psm_cases import Table, mapped, radar, scene

from seqrsm.errors import ConfigurationError
from seqrsm.scattering.sigma0 import load_sigma0_table
from seqrsm.scene import terrain
from seqrsm.sensor.swath import ground_ranges_m
from seqrsm.simulate.radar import kernels
from seqrsm.simulate.radar.psm import simulate_radar
from seqrsm.simulate.radar.receiver import picture


def quiet(s, r, table=None, **options):
    return simulate_radar(s, r, table or Table((-10.0,)), seed=1, run_id=1, **options)


def apparent(image):
    return image.mean_power[0] / image.calibration_w[:, None]


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_grazing_at_89_9_degrees(dtype):
    y0, height = 60_000.0, 100.0
    p = mapped(np.zeros((50, 3)), y0, height, 5.0, radar(), dtype, sigma0=lambda theta: theta)
    y = y0 + np.arange(50) * 5.0
    theta = p.power[0, :, 0] / (p.reference_range_m**2 / (y**2 + height**2)) ** 2
    assert np.rad2deg(theta.min()) > 89.9
    np.testing.assert_allclose(theta, np.arctan2(y, height), atol=2e-6)


def test_a_bump_of_a_millimetre_hides_ground_at_grazing_angles_and_a_flat_plane_hides_none():
    flat = np.zeros((200, 3))
    bump = flat.copy()
    bump[50] = 0.01
    shadow = [
        (mapped(z, 60_000.0, 100.0, 5.0, radar(), np.float32).state[:, 1] & kernels.CAST_SHADOW) != 0
        for z in (flat, bump)
    ]
    assert not shadow[0].any()
    # 0.01 m x 60 km / 100 m = 6 m: one cell.
    assert shadow[1].sum() == 1
    assert shadow[1][51]


def test_nadir():
    r = radar(depression_angle_deg=89.5, bandwidth_mhz=9000.0, altitude_m=8000.0, earth="flat")
    image = quiet(scene(np.zeros((6, 40)), 10.0), r, Table((-10.0,), 0.2))
    assert image.incidence_angle_deg.max() < 1.0
    expected = 10.0 ** (-1.0 - 0.02 * image.incidence_angle_deg)
    np.testing.assert_allclose(apparent(image), np.broadcast_to(expected[:, None], apparent(image).shape), rtol=0.01)


def test_metre_cells_from_850_km():
    rng = np.random.default_rng(1)
    z = rng.normal(0.0, 0.05, (80, 60)).cumsum(axis=0)
    r = radar(
        altitude_m=850e3, prf_hz=1600.0, speed_m_s=7000.0, antenna_length_m=10.0, resolution_m=5.0, bandwidth_mhz=100.0
    )
    image = {p: quiet(scene(z, 1.0), r, precision=p) for p in ("float32", "float64")}
    ratio = image["float32"].mean_power / image["float64"].mean_power
    assert np.abs(ratio - 1.0).max() < 2e-3
    assert np.mean(image["float32"].pixel_of_cell != image["float64"].pixel_of_cell) < 2e-3
    assert (image["float32"].pixel_of_cell >= 0).all()
    flat = quiet(scene(np.zeros((80, 60)), 1.0), r)
    np.testing.assert_allclose(apparent(flat), 0.1, rtol=2e-3)


@pytest.mark.parametrize("height_m", [30.0, 3000.0])
def test_relief_of_thirty_and_of_three_thousand_metres(height_m):
    z = height_m * 0.5 * (1.0 + np.sin(np.arange(120) / 9.0))[:, None] * np.ones((1, 50))
    r = radar(altitude_m=12_000.0, prf_hz=500.0, resolution_m=60.0)
    image = {p: quiet(scene(z, 30.0), r, precision=p) for p in ("float32", "float64")}
    for made in image.values():
        assert np.isfinite(made.intensity).all()
        assert (made.intensity > 0.0).all()
    total = [float(i.mean_power.sum(dtype=float)) for i in image.values()]
    assert total[0] == pytest.approx(total[1], rel=1e-5)
    # Slopes of 15 m in 9 cells of 30 m are always lit; those of 1500 m are steeper than the line of sight.
    assert image["float32"].shadow.any() == image["float32"].layover.any() == (height_m > 1000.0)


def test_a_vertical_cliff_hides_ground_and_keeps_its_power():
    z = np.zeros((120, 40))
    z[40:60] = 200.0
    r = radar(earth="flat", resolution_m=10.0, bandwidth_mhz=100.0)
    image = quiet(scene(z, 5.0), r, precision="float64")
    # Behind the far edge, at ground range y of row 59, the shadow is 200 m x y / (height - 200 m).
    mean = z.mean()
    y, _ = ground_ranges_m(r, 120, 5.0, mean, 200.0)
    length = 200.0 * y[59] / (6000.0 - 200.0)
    hidden = image.shadow[60:, 20].sum() * 5.0
    assert abs(hidden - length) <= 5.0
    # The front is laid over the ground before it: as far as the top lies before the foot in ground range.
    top = np.sqrt(y[40] ** 2 + 5800.0**2 - 6000.0**2)
    laid = image.layover[:40, 20].sum() * 5.0
    assert abs(laid - (y[40] - top)) <= 10.0


@pytest.mark.parametrize("looks", [1.0, 1000.0, 1e6])
def test_looks_from_one_to_a_million(looks):
    r = radar(looks=looks, resolution_m=2000.0, bandwidth_mhz=100.0, altitude_m=200e3, prf_hz=500.0, peak_power_w=1e6)
    image = simulate_radar(scene(np.zeros((60, 60)), 500.0), r, Table((-5.0,)), seed=1, run_id=1)
    ratio = image.intensity[0] / (image.mean_power[0] + image.noise_power_w[:, None])
    se = 1.0 / np.sqrt(looks * ratio.size)
    assert ratio.mean() == pytest.approx(1.0, abs=5.0 * se)
    assert ratio.std() * np.sqrt(looks) == pytest.approx(1.0, abs=5.0 * np.sqrt((1.0 + 3.0 / looks) / ratio.size))


def test_ground_without_echo_is_noise_and_its_picture_has_every_level_defined():
    s = scene(np.zeros((60, 60)), 5.0, cover=np.where(np.arange(60)[:, None] < 30, 0, 255) * np.ones((1, 60)))
    image = quiet(s, radar(fading="none", peak_power_w=1e-6), Table((-300.0,)))
    np.testing.assert_allclose(
        image.intensity[0], np.broadcast_to(image.noise_power_w[:, None], image.intensity[0].shape)
    )
    tones = picture(image)
    assert tones.dtype == np.uint8
    assert np.abs(tones.astype(float) - 127.5).max() < 5.0


@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (40, 1)])
@pytest.mark.parametrize("heading_deg", [0.0, 90.0, 180.0, 270.0])
def test_one_cell_one_row_and_one_column(shape, heading_deg):
    image = quiet(scene(np.full(shape, 12.0), 10.0), radar(fading="none", heading_deg=heading_deg))
    # Flat ground of -10 dB in every pixel of 2 x 2 cells; what a pixel lacks of cells is as those that it has.
    np.testing.assert_allclose(apparent(image), 0.1, rtol=2e-3)
    along_rows = heading_deg % 180.0 == 0.0
    rows, cols = shape if not along_rows else shape[::-1]
    assert image.intensity.shape[1:] == (max(rows // 2, 1), max(cols // 2, 1))
    assert (image.pixel_of_cell >= 0).all()
    assert not image.shadow.any()
    assert picture(image).shape == image.intensity.shape


@pytest.mark.parametrize("heading_deg", [30.0, 45.0, 359.0])
def test_one_cell_seen_across_the_grid_keeps_its_power(heading_deg):
    s = scene(np.full((1, 1), 12.0), 10.0)
    across = quiet(s, radar(fading="none", heading_deg=heading_deg))
    along = quiet(s, radar(fading="none"))
    assert np.isfinite(across.intensity).all()
    # A cell of 10 m in pixels of 20 m.
    total = apparent(across).sum() * 20.0**2
    assert total == pytest.approx(0.1 * 10.0**2, rel=0.01)
    assert apparent(along) == pytest.approx(0.1, rel=1e-3)


@pytest.mark.parametrize("heading_deg", [90.0, 33.0])
def test_one_known_cell_among_holes_is_imaged(heading_deg):
    z, cover = np.full((9, 9), np.nan), np.full((9, 9), 255)
    z[4, 4], cover[4, 4] = 50.0, 0
    image = quiet(scene(z, 10.0, cover), radar(fading="none", heading_deg=heading_deg))
    assert image.pixel_of_cell[4, 4] >= 0
    assert apparent(image).sum() * 20.0**2 == pytest.approx(0.1 * 10.0**2, rel=0.05)


def test_two_by_two_cells_are_one_pixel():
    image = quiet(scene(np.zeros((2, 2)), 10.0), radar(fading="none"))
    assert image.intensity.shape == (1, 1, 1)
    assert apparent(image) == pytest.approx(0.1, rel=1e-3)
    np.testing.assert_array_equal(image.pixel_of_cell, 0)


@pytest.mark.parametrize("earth", ["curved", "flat"])
def test_an_image_at_grazing_angles_of_89_9_degrees(earth):
    # Over the sphere the horizon of 5 m lies 8 km away, 0.07 deg below the horizontal.
    r = radar(
        depression_angle_deg=0.1, altitude_m=5.0, earth=earth, fading="none",
        pulse_length_us=1.0,
    )  # fmt: skip
    image = quiet(scene(np.zeros((60, 40)), 5.0), r, Table((-10.0,), 0.1))
    assert image.incidence_angle_deg.min() > 89.8
    expected = 10.0 ** (-1.0 - 0.01 * image.incidence_angle_deg)
    np.testing.assert_allclose(apparent(image), np.broadcast_to(expected[:, None], apparent(image).shape), rtol=5e-3)
    assert not image.shadow.any()
    # A wall of a metre hides all behind it: 1 m x 3 km / 5 m is longer than the scene.
    z = np.zeros((60, 40))
    z[30] = 1.0
    walled = quiet(scene(z, 5.0), r)
    assert walled.shadow[31:].all()
    assert not walled.shadow[:30].any()
    assert np.isfinite(walled.intensity).all()


@pytest.mark.parametrize("earth", ["curved", "flat"])
def test_gamma_is_constant_up_to_the_horizon(tmp_path, earth):
    rows = "".join(f"sigma0,class 0,5,{p},{a},-10,dB,measured,made,0,0\n" for p in ("HH", "VV") for a in (0, 75))
    header = "quantity,category,frequency_ghz,polarization,theta_deg,value,unit,status,source,sd,mean_sd\n"
    (tmp_path / "even.csv").write_text(header + rows, encoding="utf-8")
    r = radar(frequency_ghz=5.0, depression_angle_deg=1.0, altitude_m=500.0, earth=earth, fading="none", texture_db=0.0)
    image = quiet(scene(np.zeros((60, 40)), 5.0), r, load_sigma0_table(tmp_path / "even.csv"))
    assert (abs(image.incidence_angle_deg - 89.15) < 0.18).all()
    expected = 0.1 * np.cos(np.deg2rad(image.incidence_angle_deg)) / math.cos(math.radians(75.0))
    np.testing.assert_allclose(apparent(image), np.broadcast_to(expected[:, None], apparent(image).shape), rtol=0.02)


def test_an_image_a_tenth_of_a_degree_from_nadir():
    r = radar(
        depression_angle_deg=89.9, altitude_m=850e3, resolution_m=200.0, bandwidth_mhz=5000.0, prf_hz=1600.0,
        speed_m_s=7000.0, antenna_length_m=10.0, fading="none",
    )  # fmt: skip
    image = quiet(scene(np.zeros((60, 40)), 40.0), r, Table((-10.0,), 0.2))
    assert 0.0 < image.incidence_angle_deg.min() < 0.05
    assert image.incidence_angle_deg.max() < 0.25
    expected = 10.0 ** (-1.0 - 0.02 * image.incidence_angle_deg)
    np.testing.assert_allclose(apparent(image), np.broadcast_to(expected[:, None], apparent(image).shape), rtol=0.01)
    assert (image.looks >= 1.0).all()


@pytest.mark.parametrize(("angle", "words"), [(90.0, "0.05 to 89.95"), (0.0, "0.05 to 89.95"), (0.06, "horizon")])
def test_at_nadir_and_beyond_the_horizon_nothing_is_resolved(angle, words):
    with pytest.raises(ConfigurationError, match=words):
        radar(depression_angle_deg=angle)


def test_a_swath_that_reaches_behind_nadir_is_refused_with_the_angle_that_does():
    s = scene(np.zeros((60, 40)), 40.0)
    changes = {"altitude_m": 6000.0, "resolution_m": 200.0, "bandwidth_mhz": 500.0}
    with pytest.raises(ConfigurationError, match=r"behind nadir.*less than 78.69 deg"):
        quiet(s, radar(depression_angle_deg=85.0, **changes))
    assert np.isfinite(quiet(s, radar(depression_angle_deg=78.6, **changes)).intensity).all()


@pytest.mark.parametrize("near", [0.0, 44.9])
def test_a_large_scene_turned_in_strips_is_the_same(monkeypatch, near):
    rng = np.random.default_rng(3)
    cover = np.kron(rng.integers(0, 3, (8, 9)), np.ones((10, 10), dtype=int))

    def made():
        z = np.random.default_rng(4).normal(0.0, 1.0, cover.shape)
        r = radar(heading_deg=37.0, near_incidence_deg=near, resolution_m=15.0)
        return simulate_radar(scene(z, cover=cover), r, Table((-8.0, -10.0, -12.0)), seed=1, run_id=1)

    whole = made()
    monkeypatch.setattr(terrain, "_CELLS_AT_ONCE", 250)
    parts = made()
    for name in ("intensity", "pixel_of_cell", "shadow", "layover"):
        np.testing.assert_array_equal(getattr(parts, name), getattr(whole, name))
    outside = (whole.pixel_of_cell < 0).mean()
    assert 0.2 < outside < 0.8 if near else outside < 0.02
