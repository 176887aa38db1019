"""Sun, shadow and exposure against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from synthetic import fractal_terrain

from seqrsm.scene.temperature import Sun, cast_shadow, sun_exposure, sun_position, sunlight_under, time_exposure


def test_sun_at_known_places_and_times():
    # Noon at the equinox (day 81): zenith distance is the latitude; at midsummer latitude - 23.45.
    assert sun_position(40.0, 81.0, 12.0).elevation_deg == pytest.approx(50.0, abs=0.1)
    assert sun_position(40.0, 172.0, 12.0).elevation_deg == pytest.approx(73.45, abs=0.05)
    assert sun_position(40.0, 81.0, 12.0).azimuth_deg == pytest.approx(180.0)
    assert sun_position(-30.0, 172.0, 12.0).azimuth_deg % 360.0 == pytest.approx(0.0, abs=1e-6)
    east = sun_position(40.0, 81.0, 6.0)
    assert east.elevation_deg == pytest.approx(0.0, abs=0.2)
    assert east.azimuth_deg == pytest.approx(90.0, abs=0.2)
    assert sun_position(40.0, 172.0, 0.0).elevation_deg < 0.0


@pytest.mark.parametrize("azimuth", [0.0, 90.0, 180.0, 270.0])
def test_shadow_of_a_tower_has_the_length_of_its_height_over_the_tangent(azimuth):
    z = np.zeros((81, 81))
    z[40, 40] = 100.0
    elevation = 30.0
    dark = cast_shadow(z, 10.0, Sun(elevation, azimuth))
    row, column = np.nonzero(dark)
    length = 100.0 / np.tan(np.deg2rad(elevation)) / 10.0
    # Away from the sun: rows grow to the south, columns to the east.
    away = {0.0: (1, 0), 90.0: (0, -1), 180.0: (-1, 0), 270.0: (0, 1)}[azimuth]
    steps = (row - 40) * away[0] + (column - 40) * away[1]
    aside = (row - 40) * away[1] + (column - 40) * away[0]
    np.testing.assert_array_equal(np.sort(steps), np.arange(1, int(length) + 1))
    assert (aside == 0).all()


@pytest.mark.parametrize("azimuth", [45.0, 110.0, 200.0, 305.0])
def test_shadow_behind_a_long_ridge_at_any_azimuth(azimuth):
    # A straight ridge along the rows: the shadow reaches h / tan(elevation) x |cos(azimuth)| across it.
    z = np.zeros((121, 121))
    z[60] = 60.0
    dark = cast_shadow(z, 10.0, Sun(25.0, azimuth))
    to_south = -np.cos(np.deg2rad(azimuth))
    reach = 6.0 / np.tan(np.deg2rad(25.0)) * abs(to_south)
    column = dark[:, 60]
    away = -1 if to_south > 0 else 1
    lit = [(60 + away * k) for k in range(1, 60)]
    assert column[lit].sum() == int(reach)
    assert not column[[60 - away * k for k in range(1, 60)]].any()


def test_night_is_dark_and_flat_ground_sees_the_sun_at_its_elevation():
    z = np.zeros((10, 12))
    assert cast_shadow(z, 5.0, Sun(-3.0, 90.0)).all()
    for elevation, cloud in ((-3.0, 0.0), (-3.0, 0.3), (0.0, 0.3)):
        np.testing.assert_array_equal(sun_exposure(z, 5.0, Sun(elevation, 90.0), cloud), 0.0)
    np.testing.assert_allclose(sun_exposure(z, 5.0, Sun(35.0, 77.0)), np.sin(np.deg2rad(35.0)))


@pytest.mark.parametrize(
    ("azimuth", "east", "north"), [(90.0, -1.0, 0.0), (180.0, 0.0, 1.0), (225.0, 0.5**0.5, 0.5**0.5)]
)
def test_only_ground_square_to_the_sun_reaches_the_highest_temperature(azimuth, east, north):
    # Ground that rises away from the sun at 90 deg less its elevation.
    elevation = 55.0
    slope = np.tan(np.deg2rad(90.0 - elevation))
    row, column = np.mgrid[0:30, 0:30] * 10.0
    z = slope * (east * column - north * row)
    exposure = sun_exposure(z, 10.0, Sun(elevation, azimuth))
    np.testing.assert_allclose(exposure, 1.0, atol=1e-12)
    np.testing.assert_allclose(sun_exposure(-z, 10.0, Sun(30.0, azimuth)).max(), 0.0, atol=0.1)


def test_exposure_stays_between_0_in_shadow_and_1():
    z = fractal_terrain(80, 90, relief_m=200.0, seed=2)
    for hour in (5.0, 9.0, 12.0, 17.0):
        sun = sun_position(35.0, 172.0, hour)
        exposure = sun_exposure(z, 10.0, sun)
        assert exposure.min() >= 0.0
        assert exposure.max() <= 1.0
        assert (exposure[cast_shadow(z, 10.0, sun)] == 0.0).all()


def test_exposure_of_time_is_the_mean_over_the_hours_before():
    z = np.zeros((6, 6))
    place = {"latitude_deg": 35.0, "day_of_year": 172.0}
    moment = time_exposure(z, 10.0, hour=12.0, **place)[0, 0]
    assert moment == pytest.approx(np.sin(np.deg2rad(sun_position(35.0, 172.0, 12.0).elevation_deg)))
    # Closed form of the mean of sin(elevation) = a + b cos(w) over six hours before noon.
    declination = np.deg2rad(23.45) * np.sin(2.0 * np.pi * (284.0 + 172.0) / 365.0)
    a, b = np.sin(np.deg2rad(35.0)) * np.sin(declination), np.cos(np.deg2rad(35.0)) * np.cos(declination)
    expected = a + b * np.sin(np.pi / 2.0) / (np.pi / 2.0)
    assert time_exposure(z, 10.0, hour=12.0, exposure_hours=6.0, **place)[0, 0] == pytest.approx(expected, rel=2e-3)


def test_a_cloud_lets_as_much_light_through_as_overcast_skies_were_measured_to():
    """A quarter, by 1 - 0.75 (N / 8)**3.4 of ten years in Hamburg (Kasten and Czeplak 1980, Solar Energy 24)."""
    assert sunlight_under(0.0, 20.0) == (1.0, 1.0)
    straight, in_all = sunlight_under(0.3, 60.0)
    assert straight < 1e-9
    assert in_all == pytest.approx(0.25, abs=0.03)
    thin = sunlight_under(0.002, 30.0)
    assert thin[0] == pytest.approx(np.exp(-0.3 / 0.5))  # an optical depth of 0.3 along a path twice as long
    assert thin[0] < thin[1] < 1.0


def test_under_cloud_slopes_and_shadows_are_as_light_as_level_ground():
    z = np.zeros((40, 40))
    z[20:, :] = 3.0 * np.arange(20)[:, None]  # a wall in the north of the sun, and a slope
    sun = Sun(35.0, 180.0)
    clear, grey = (sun_exposure(z, 10.0, sun, cloud) for cloud in (0.0, 0.3))
    assert np.ptp(clear) > 0.2
    np.testing.assert_allclose(grey, sunlight_under(0.3, 35.0)[1] * np.sin(np.deg2rad(35.0)), rtol=1e-9)
    # A haze of 1 g/m2 still has sun, and light in the shadow of a cliff.
    z[:] = 0.0
    z[:, :20] = 200.0
    straight, in_all = sunlight_under(0.001, 20.0)
    hazy = sun_exposure(z, 10.0, Sun(20.0, 270.0), 0.001)
    assert hazy[20, 21] == pytest.approx((in_all - straight) * np.sin(np.deg2rad(20.0)))
    assert hazy[20, 5] == pytest.approx(in_all * np.sin(np.deg2rad(20.0)))
