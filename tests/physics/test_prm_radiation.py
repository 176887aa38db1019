"""Program POWER against closed forms: eq. (3-35), enclosure, limits of the loss, blocking, look angle, temperature."""

from __future__ import annotations

import math

import numpy as np
import pytest
from prm_cases import Table, footprint_across_m, image, isothermal_air, mapped, radiometer, scene

from seqrsm.errors import ConfigurationError, SceneError
from seqrsm.scattering.atmosphere import Atmosphere, make_atmosphere, radiation_equivalent_k
from seqrsm.simulate.radiometer import kernels_prm, kernels_scan
from seqrsm.simulate.radiometer.prm import _sky_polynomial

ROUGH = np.random.default_rng(4).normal(0.0, 1.0, (41, 30)).cumsum(axis=0)
MIXED = np.random.default_rng(5).integers(0, 3, (41, 30))


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_isothermal_enclosure_returns_its_temperature(dtype):
    table = Table((0.0, 0.37, 1.0))
    air = isothermal_air(0.4, 290.0, 290.0)
    found, _ = mapped(scene(ROUGH, cover=MIXED), radiometer(), table, air, 290.0, dtype=dtype)
    seen = found.state == 0
    np.testing.assert_allclose(found.antenna_k[0][seen], 290.0, rtol=1e-12 if dtype == "float64" else 1e-6)


def test_isothermal_enclosure_by_plancks_law_and_through_the_scan():
    x = radiometer(frequency_ghz=36.0).planck_offset_k
    s = scene(ROUGH, cover=MIXED)
    equal = radiation_equivalent_k(290.0, x)
    found, _ = mapped(s, radiometer(), Table((0.0, 0.37, 1.0)), isothermal_air(0.4, equal, equal), 290.0, x)
    np.testing.assert_allclose(found.antenna_k[0][found.state == 0], equal, rtol=1e-12)
    # Without air the sky is space: a black ground alone keeps the enclosure's temperature.
    black = image(s, radiometer(frequency_ghz=36.0, radiation="planck"), Table((1.0, 1.0, 1.0)))
    np.testing.assert_allclose(black.mean_k, 300.0, rtol=1e-12)


def test_loss_of_one_and_of_infinity():
    s, table = scene(np.zeros((21, 10))), Table((0.6,))
    clear = Atmosphere(np.zeros(1), np.array([250.0]), np.array([0.0, 10.0]), 40.0, ())
    found, _ = mapped(s, radiometer(), table, clear, 300.0)
    np.testing.assert_allclose(found.antenna_k, 0.6 * 300.0 + 0.4 * 40.0, rtol=1e-13)
    # A thousand nepers below the craft: only the air is seen.
    found, _ = mapped(s, radiometer(), table, isothermal_air(1e4, 250.0, 3.0), 300.0)
    np.testing.assert_allclose(found.antenna_k, 250.0, rtol=1e-13)


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_fields_and_dates_depart_by_a_part_of_what_they_reflect(dtype):
    """As roughness does, exp(-h) of a Fresnel reflectivity: emissivity stays within 0 and 1 whatever is drawn."""
    cover = np.repeat([[0, 0, 1, 1, 2, 2]], 21, axis=0)
    field = np.repeat([[0, 1, 2, 3, 4, 5]], 21, axis=0)
    s, table = scene(np.zeros((21, 6)), 50.0, cover, field), Table((0.6, 0.95, 0.1))
    clear = Atmosphere(np.zeros(1), np.array([250.0]), np.array([0.0, 10.0]), 40.0, ())
    of_dates, of_fields = np.array([0.1, -0.2, 0.0]), np.array([0.25, -0.25, 1.5, 0.0, -0.5, 0.5])
    met = {"class_offset": of_dates[None], "field_offset": of_fields[None]}
    found, _ = mapped(s, radiometer(), table, clear, 300.0, dtype=dtype, **met)
    reflected = np.array([0.4, 0.4, 0.05, 0.05, 0.9, 0.9]) * (1.0 - of_dates[cover[0]])
    reflected = np.clip(reflected * (1.0 - of_fields), 0.0, 1.0)
    expected = np.broadcast_to(300.0 - 260.0 * reflected, (21, 6))
    np.testing.assert_allclose(found.antenna_k[0], expected, rtol=1e-13 if dtype == "float64" else 1e-6)


def test_equation_3_35_term_by_term():
    s, air = scene(np.zeros((41, 6)), 50.0), isothermal_air(0.3, 260.0, 2.7)
    found, frame = mapped(s, radiometer(), Table((lambda t: 0.9 - t / 200.0,)), air, 310.0)
    theta = np.arctan(np.abs(frame.across_m) / 1000.0)
    loss = np.exp(0.3 * 0.1 / np.cos(theta))  # 1 of 10 km lies below the craft
    sky = 260.0 + (2.7 - 260.0) * np.exp(-0.3 / np.cos(theta))
    e = 0.9 - np.degrees(theta) / 200.0
    expected = (1.0 - 1.0 / loss) * 260.0 + e * 310.0 / loss + (1.0 - e) * sky / loss
    np.testing.assert_allclose(found.antenna_k[0], np.broadcast_to(expected[:, None], (41, 6)), rtol=2e-6)


def test_energy_is_split_between_emission_and_reflection():
    s, air = scene(ROUGH), isothermal_air(0.2, 270.0, 2.7)
    whole, none = (mapped(s, radiometer(), Table((e,)), air, 300.0)[0] for e in (1.0, 0.0))
    part, _ = mapped(s, radiometer(), Table((0.3,)), air, 300.0)
    np.testing.assert_allclose(part.antenna_k, 0.3 * whole.antenna_k + 0.7 * none.antenna_k, rtol=1e-12)


def test_sky_warmer_than_the_ground_makes_reflectors_bright():
    found, _ = mapped(scene(np.zeros((11, 8)), cover=np.arange(88).reshape(11, 8) % 2), radiometer(), Table((0.2, 0.9)),
                      isothermal_air(0.0, 1.0, 400.0), 280.0)  # fmt: skip
    reflector = (np.arange(88).reshape(11, 8) % 2) == 0
    assert found.antenna_k[0][reflector].min() > found.antenna_k[0][~reflector].max()
    np.testing.assert_allclose(found.antenna_k[0][reflector], 0.2 * 280.0 + 0.8 * 400.0)


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize(("across", "along"), [(0.0, 0.0), (0.3, 0.0), (-0.4, 0.0), (0.0, 0.5), (0.25, -0.35)])
def test_local_look_angle_of_tilted_planes(dtype, across, along):
    n, m, cell = 61, 30, 20.0
    i, j = np.mgrid[0:n, 0:m] * cell
    z = across * (i - i.mean()) + along * (j - j.mean())
    found, frame = mapped(scene(z, cell), radiometer(altitude_m=2000.0), Table((lambda t: t / 90.0,)),
                          isothermal_air(0.0, 1.0, 0.0), 300.0, dtype=dtype)  # fmt: skip
    y = frame.across_m[:, None] * np.ones((1, m))
    to_antenna = np.stack([np.zeros_like(z), -y, 2000.0 - z], axis=-1)
    normal = np.array([-along, -across, 1.0])
    cosine = to_antenna @ normal / (np.linalg.norm(to_antenna, axis=-1) * np.linalg.norm(normal))
    seen = found.state == 0
    assert seen.mean() > 0.95
    got = found.antenna_k[0][seen] * 0.3
    np.testing.assert_allclose(got, np.degrees(np.arccos(cosine))[seen], atol=2e-3)


def test_polynomial_of_the_sky_follows_its_layers():
    theta = np.deg2rad(np.linspace(0.0, 75.0, 100))
    for f, weather in ((1.4, "clear"), (22.235, "clear"), (36.0, "rain")):
        air = make_atmosphere(f, weather=weather)
        most, *power = _sky_polynomial(air)
        t = 2.0 * np.sin(0.5 * theta) ** 2 / most - 1.0
        np.testing.assert_allclose(np.polynomial.polynomial.polyval(t, power), air.sky_k(theta), atol=1e-3)


def test_a_wall_blocks_what_lies_behind_it_on_either_side():
    cell, height = 10.0, 1000.0
    for n in (200, 201):
        across = (np.arange(n) - 0.5 * (n - 1)) * cell
        z = np.zeros((n, 5))
        wall = np.flatnonzero(np.abs(across) >= 495.0)[[0, -1]]
        inner = [int(np.flatnonzero(across <= -495.0)[-1]), int(np.flatnonzero(across >= 495.0)[0])]
        z[inner] = 400.0
        assert wall.size == 2
        found, _ = mapped(scene(z, cell), radiometer(altitude_m=height), Table((0.9,)), isothermal_air(0, 1, 3), 300.0)
        blocked = (found.state[:, 2] & kernels_prm.BLOCKED) != 0
        level = float(z.mean())
        top, distance = 400.0, abs(across[inner[0]])
        shadow_end = distance * height / (height - top)
        expected = (np.abs(across) > distance) & (np.abs(across) < shadow_end)
        assert expected.sum() >= 60
        np.testing.assert_array_equal(blocked, expected, err_msg=f"{n} rows, mean {level}")
        assert (found.antenna_k[0][:, 2][blocked] == 0.0).all()


def test_what_is_seen_fills_the_view_whatever_the_relief():
    z = 60.0 * np.sin(np.arange(300) / 12.0)[:, None] + np.zeros((1, 12))
    found, frame = mapped(scene(z), radiometer(altitude_m=1500.0), Table((0.8,)), isothermal_air(0.0, 1.0, 3.0), 300.0)
    total = np.zeros_like(found.antenna_k)
    weight = np.zeros(frame.elevation_m.shape)
    kernels_scan.bin_angle(found.antenna_k, found.offset, found.state, total, weight)
    inside = weight[20:-20]
    assert (found.state != 0).sum() == 0 or inside.min() > 0.4
    np.testing.assert_allclose(np.median(inside), 1.0, atol=1e-9)
    np.testing.assert_allclose((total[0] / np.where(weight > 0, weight, 1.0))[weight > 0], 0.8 * 300.0 + 0.2 * 3.0)


def test_raised_ground_is_seen_farther_out():
    # A plateau of height z at distance y appears where flat ground at y h / (h - z) would.
    n, cell = 101, 10.0
    across = (np.arange(n) - 50) * cell
    z = np.where(np.abs(across) > 200.0, 100.0, 0.0)[:, None] * np.ones((1, 4))
    found, frame = mapped(scene(z, cell), radiometer(), Table((0.8,)), isothermal_air(0.0, 1.0, 3.0), 300.0)
    height = frame.height_m
    expected = across * height / (height - frame.elevation_m[:, 0].astype(float)) - across
    np.testing.assert_allclose(found.offset[:, 0] * cell, expected, atol=1e-9)


def test_temperature_layer_and_its_refusals():
    s = scene(np.zeros((30, 40)))
    layer = np.linspace(280.0, 330.0, 1200).reshape(30, 40)
    found = image(s, radiometer(beam="box"), Table((1.0,)), temperature_k=layer)
    assert 280.0 < found.mean_k.min() < 300.0 < 310.0 < found.mean_k.max() < 330.0
    with pytest.raises(SceneError, match="layers differ in size: temperature_k"):
        image(s, radiometer(), Table((1.0,)), temperature_k=layer[1:])
    with pytest.raises(SceneError, match="1200 cells lie outside 150 to 500 K"):
        image(s, radiometer(), Table((1.0,)), temperature_k=0.0 * layer)
    with pytest.raises(SceneError, match="no layer of temperature"):
        image(s, radiometer(temperature="layer"), Table((1.0,)))


@pytest.mark.parametrize(("f", "low", "high"), [(1.4, 0.03, 0.04), (36.0, 0.8, 0.9)])
def test_error_of_rayleigh_jeans(f, low, high):
    # h f / 2 k for warm ground: 0.024 K a gigahertz.
    x = radiometer(frequency_ghz=f).planck_offset_k
    assert low < 300.0 - radiation_equivalent_k(300.0, x) < high
    assert 300.0 - radiation_equivalent_k(300.0, x) == pytest.approx(0.5 * x, rel=2e-3)
    # The cold sky is where the two laws differ otherwise.
    assert 2.7 - radiation_equivalent_k(2.7, x) < 0.5 * x


def test_planck_is_taken_when_rayleigh_jeans_errs_by_more_than_the_noise():
    s = scene(np.zeros((30, 40)))
    fine = image(s, radiometer(frequency_ghz=36.0, radiation="auto", integration_time_ms=20.0), Table((0.9,)))
    coarse = image(s, radiometer(frequency_ghz=36.0, radiation="auto", integration_time_ms=0.2), Table((0.9,)))
    assert any("Planck's law" in note for note in fine.notes)
    assert any("Rayleigh-Jeans" in note for note in coarse.notes)
    # Calibrated in kelvin either way: the laws differ by the sky's share only.
    assert abs(float(fine.mean_k.mean() - coarse.mean_k.mean())) < 0.02


def test_183_ghz_lies_outside_the_tables():
    with pytest.raises(ConfigurationError, match="170"):
        radiometer(frequency_ghz=183.3)


def test_emissivity_zero_and_one():
    s = scene(np.zeros((30, 40)))
    assert image(s, radiometer(), Table((0.0,))).mean_k == pytest.approx(2.72548)
    assert image(s, radiometer(), Table((1.0,))).mean_k == pytest.approx(300.0)


def test_grazing_and_vertical_looks_stay_finite():
    # A wall of 89.9 deg and a sweep of 75 deg on either side.
    z = np.zeros((300, 6))
    z[100:110] = 5000.0
    found = image(scene(z, 10.0), radiometer(altitude_m=6000.0, scan_half_angle_deg=75.0), Table((lambda t: t / 90.0,)))
    reached = np.abs(found.scan.look_rad) < np.arctan(1500.0 / 6000.0) - found.scan.beamwidth_rad
    assert reached.sum() > 5
    assert np.isfinite(found.mean_k[:, reached]).all()
    beyond = np.abs(found.scan.look_rad) > np.arctan(1600.0 / 6000.0) + 2.0 * found.scan.beamwidth_rad
    assert np.isnan(found.mean_k[:, beyond]).all()
    assert math.isfinite(float(footprint_across_m(found.scan).max()))


def test_level_ground_at_noon_is_as_warm_as_the_sun_is_high():
    """At 40 deg north on day 172 the sun stands 90 - 40 + 23.45 deg high: 40 K times the sine over 300 K."""
    given = {"temperature": "exposure", "temperature_low_k": 300.0, "temperature_high_k": 340.0}
    found = image(scene(np.zeros((60, 60))), radiometer(**given, latitude_deg=40.0, day_of_year=172.0), Table((1.0,)))
    high = np.sin(np.deg2rad(90.0 - 40.0 + 23.45))
    np.testing.assert_allclose(found.mean_k[np.isfinite(found.mean_k)], 300.0 + 40.0 * high, rtol=1e-4)
    # Under a cloud of 0.3 kg/m2, of optical depth 45, two parts of 8.75 of that light are left, in rain as well.
    for weather in ("cloud", "rain"):
        found = image(scene(np.zeros((60, 60))), radiometer(**given, weather=weather, cloud_kg_m2=0.3), Table((1.0,)))
        np.testing.assert_allclose(found.mean_k[np.isfinite(found.mean_k)], 300.0 + 80.0 / 8.75 * high, rtol=1e-4)
