"""Phase one against closed forms: eq. (3-20), (3-30), (3-31), shadow, layover, range position."""

from __future__ import annotations

import numpy as np
import pytest
from psm_cases import frame, lut_of, mapped, power_map, radar

from seqrsm.simulate.radar import kernels

TIGHT = {np.float64: 1e-12, np.float32: 1e-6}


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("height", [1500.0, 850e3])
def test_flat_plane_obeys_the_radar_equation(dtype, height):
    y0, cell = 0.8 * height, 5.0
    r = radar(range_format="ground")
    p = mapped(np.zeros((200, 7)), y0, height, cell, r, dtype)
    got = p.power[0].astype(float) * cell**2 * r.radar_constant_w_m2() / p.reference_range_m**4
    y = y0 + np.arange(200) * cell
    wavelength = 299792458.0 / 5.3e9
    gain = 10.0**2.5
    expected = 100.0 * gain**2 * wavelength**2 * 0.1 * cell**2 / ((4 * np.pi) ** 3 * (y**2 + height**2) ** 2)
    expected *= 10.0 ** (-0.3)
    np.testing.assert_allclose(got, np.broadcast_to(expected[:, None], got.shape), rtol=TIGHT[dtype])


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize(
    ("across", "along"), [(0.0, 0.0), (0.2, 0.0), (-0.3, 0.0), (0.0, 0.4), (0.25, -0.35), (0.9, 0.1), (-0.5, 0.7)]
)
def test_local_incidence_of_tilted_planes(dtype, across, along):
    n, m, cell, y0, height = 40, 30, 5.0, 4000.0, 6000.0
    i, j = np.mgrid[0:n, 0:m] * cell
    z = across * (i - i.mean()) + along * (j - j.mean())
    # sigma0 = theta: the power tells the angle.
    p = mapped(z, y0, height, cell, radar(), dtype, sigma0=lambda theta: theta)
    y = (y0 + np.arange(n) * cell)[:, None]
    r2 = y**2 + (height - z) ** 2
    tilt = np.sqrt(1.0 + across**2 + along**2)
    theta = p.power[0] / ((p.reference_range_m**2 / r2) ** 2 * tilt)
    to_antenna = np.stack([np.zeros_like(z), -np.broadcast_to(y, z.shape), height - z], axis=-1)
    normal = np.array([-along, -across, 1.0])
    cosine = to_antenna @ normal / (np.linalg.norm(to_antenna, axis=-1) * np.linalg.norm(normal))
    lit = (p.state & (kernels.CAST_SHADOW | kernels.SELF_SHADOW)) == 0
    assert lit.sum() > 0.9 * lit.size
    np.testing.assert_allclose(theta[lit], np.arccos(cosine)[lit], atol=1e-5 if dtype is np.float32 else 1e-7)


def test_incidence_near_normal_keeps_its_digits_in_single_precision():
    # A plane turned towards the antenna: theta is a small difference; 1 - cos would lose it.
    n, cell, y0, height = 400, 1.0, 4000.0, 4000.0
    z = 1.0 * (np.arange(n) - n / 2)[:, None] * cell * np.ones((1, 3))
    y = y0 + np.arange(n)[:, None] * cell
    p = mapped(z, y0, height, cell, radar(), np.float32, sigma0=lambda theta: theta)
    r2 = y**2 + (height - z) ** 2
    theta = p.power[0] / ((p.reference_range_m**2 / r2) ** 2 * np.sqrt(2.0))
    exact = np.abs(np.arctan2(y, height - z) - np.pi / 4)
    np.testing.assert_allclose(theta, exact, atol=2e-6)


def test_slopes_facing_away_return_nothing():
    n, cell, y0, height = 60, 5.0, 4000.0, 2000.0
    z = -1.0 * np.arange(n)[:, None] * cell * np.ones((1, 4)) + 150.0
    p = mapped(z, y0, height, cell, radar(), np.float64)
    assert (p.power == 0.0).all()
    assert ((p.state & kernels.SELF_SHADOW) != 0).all()
    assert ((p.state[1:] & kernels.CAST_SHADOW) != 0).all()


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize(("height", "wall", "y0", "cell"), [(3000.0, 40.0, 5000.0, 2.0), (850e3, 30.0, 500e3, 1.0)])
def test_shadow_of_a_wall_has_its_length(dtype, height, wall, y0, cell):
    z = np.zeros((300, 5))
    z[20] = wall
    p = mapped(z, y0, height, cell, radar(), dtype)
    y_wall = y0 + 20 * cell
    length = y_wall * wall / (height - wall)
    cast = (p.state & kernels.CAST_SHADOW) != 0
    assert not cast[:21].any()
    count = cast.sum(axis=0)
    assert np.all(np.abs(count - length / cell) <= 1.0)
    assert np.array_equal(cast[21 : 21 + count[0], 0], np.ones(count[0], dtype=bool))


def test_shadow_is_the_running_maximum_of_the_look_angle():
    rng = np.random.default_rng(3)
    n, m, cell, y0, height = 500, 64, 5.0, 6000.0, 1200.0
    z = np.cumsum(rng.normal(0, 1.5, (n, m)), axis=0)
    z -= z.mean()
    p = mapped(z, y0, height, cell, radar(), np.float64)
    look = (y0 + np.arange(n) * cell)[:, None] / (height - z)
    before = np.vstack([np.full((1, m), -np.inf), np.maximum.accumulate(look, axis=0)[:-1]])
    assert np.array_equal((p.state & kernels.CAST_SHADOW) != 0, look < before)
    assert 0.05 < (look < before).mean() < 0.95


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_layover_mask_is_that_of_the_sorted_ranges(dtype):
    rng = np.random.default_rng(4)
    n, m, cell, y0, height = 300, 40, 5.0, 1500.0, 6000.0
    z = np.cumsum(rng.normal(0, 3.0, (n, m)), axis=0)
    z -= z.mean()
    p = mapped(z, y0, height, cell, radar(), dtype)
    r = np.hypot((y0 + np.arange(n) * cell)[:, None], height - z)
    before = np.vstack([np.full((1, m), -np.inf), np.maximum.accumulate(r, axis=0)[:-1]])
    after = np.vstack([np.minimum.accumulate(r[::-1], axis=0)[::-1][1:], np.full((1, m), np.inf)])
    expected = (r <= before) | (r >= after)
    got = p.layover
    assert 0.05 < expected.mean() < 0.95
    assert np.mean(got != expected) <= (0.0 if dtype is np.float64 else 1e-3)


@pytest.mark.parametrize("range_format", ["ground", "slant"])
def test_range_position_at_orbital_height_in_single_precision(range_format):
    rng = np.random.default_rng(5)
    n, height, y0, cell = 400, 850e3, 500e3, 1.0
    z = rng.uniform(-400.0, 400.0, (n, 20))
    r = radar(range_format=range_format, resolution_m=5.0)
    offset = {}
    for dtype in (np.float32, np.float64):
        offset[dtype] = mapped(z, y0, height, cell, r, dtype).offset.astype(float) * r.range_spacing_m
    y = (y0 + np.arange(n) * cell)[:, None].astype(np.longdouble)
    slant = np.sqrt(y**2 + (height - z.astype(np.longdouble)) ** 2)
    exact = slant - np.hypot(y, height) if range_format == "slant" else np.sqrt(slant**2 - height**2) - y
    np.testing.assert_allclose(offset[np.float64], exact.astype(float), atol=1e-8)
    assert np.abs(offset[np.float32] - exact.astype(float)).max() < 1e-3


def test_terrain_above_the_nadir_range_is_put_at_nadir():
    p = mapped(np.full((3, 4), 300.0), 20.0, 1000.0, 5.0, radar(), np.float64)
    np.testing.assert_allclose(p.offset * 20.0, -np.array([20.0, 25.0, 30.0])[:, None] * np.ones((1, 4)))


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize(("y0", "height"), [(6.0, 5000.0), (9000.0, 60.0), (60_000.0, 100.0)])
def test_nadir_and_grazing_angles_are_right(y0, height, dtype):
    p = mapped(np.zeros((50, 3)), y0, height, 5.0, radar(), dtype, sigma0=lambda theta: theta)
    y = y0 + np.arange(50) * 5.0
    theta = p.power[0, :, 0] / (p.reference_range_m**2 / (y**2 + height**2)) ** 2
    np.testing.assert_allclose(theta, np.arctan2(y, height), atol=2e-6)


def test_each_element_uses_its_own_category_and_field():
    f = frame(np.zeros((4, 4)), 3000.0, 3000.0, 5.0)
    f.cover[:, 2:] = 1
    f.cover[0, 0] = 255
    f.field[2:] = 1
    lut = np.concatenate([lut_of(lambda t: 0 * t + 0.1), lut_of(lambda t: 0 * t + 0.4)], axis=1)
    p = power_map(f, radar(), lut, np.array([[1.0, 3.0]]))
    r4 = (p.reference_range_m**2 / (f.ground_range_m**2 + 3000.0**2)) ** 2
    expected = np.where(f.cover == 1, 0.4, 0.1) * np.where(f.field == 1, 3.0, 1.0) * r4[:, None]
    expected[0, 0] = 0.0
    np.testing.assert_allclose(p.power[0], expected, rtol=1e-12)
