"""The rest of the radar: curved Earth, antenna, atmosphere, swath, headings, targets, receiver, picture, threads."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from psm_cases import Table, frame, lut_of, power_map, radar, scene
from scipy import stats

from seqrsm.errors import ConfigurationError, SceneError
from seqrsm.sensor.antenna import atmosphere_factor, elevation_gain
from seqrsm.sensor.earth import ground_range_of_look, horizon_ground_range_m, range_geometry, slant_range_of_ground
from seqrsm.sensor.swath import ground_ranges_m
from seqrsm.simulate.radar import kernels
from seqrsm.simulate.radar.echo import echo_grid, echo_sums
from seqrsm.simulate.radar.fading import correlated_fading
from seqrsm.simulate.radar.psm import simulate_radar
from seqrsm.simulate.radar.receiver import picture
from seqrsm.simulate.radar.targets import CulturalTarget
from seqrsm.simulate.runner import do_all

RE = 6_371_008.8


def quiet(s, r, table=None, **options):
    return simulate_radar(s, r, table or Table((-10.0,)), seed=1, run_id=1, **options)


def on_the_sphere(arc, z, height):
    """Slant range, incidence and look from three-dimensional vectors, in long double."""
    arc, z = np.longdouble(arc), np.longdouble(z)
    phi = arc / np.longdouble(RE)
    up = np.array([np.sin(phi), np.cos(phi)])
    point = (RE + z) * up
    antenna = np.array([np.zeros_like(phi), np.full_like(phi, np.longdouble(RE) + height)])
    back = antenna - point
    slant = np.sqrt((back**2).sum(axis=0))
    sine = back[0] * up[1] - back[1] * up[0]
    return slant, np.arctan2(np.abs(sine), (back * up).sum(axis=0)), np.arctan2(-back[0], back[1])


@pytest.mark.parametrize(("height", "far"), [(6000.0, 60e3), (850e3, 1500e3)])
def test_curved_geometry_is_that_of_vectors(height, far):
    arc = np.linspace(100.0, far, 50)
    got = range_geometry(arc, height, curved=True)
    slant, incidence, look = on_the_sphere(arc, np.zeros(50), height)
    np.testing.assert_allclose(got.slant_range_m, slant.astype(float), rtol=1e-11)
    np.testing.assert_allclose(got.incidence_rad, incidence.astype(float), atol=1e-9)
    np.testing.assert_allclose(got.look_rad, look.astype(float), atol=1e-9)
    np.testing.assert_allclose(got.chord_per_m, np.gradient(got.chord_m, arc)[:], rtol=2e-3)
    for k in (0, 25, 49):
        assert slant_range_of_ground(arc[k], height, True) == pytest.approx(float(slant[k]), rel=1e-11)
        assert slant_range_of_ground(arc[k], height, False) == pytest.approx(math.hypot(arc[k], height), rel=1e-14)
        assert ground_range_of_look(got.look_rad[k], height, True) == pytest.approx(arc[k], rel=1e-6)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("range_format", ["slant", "ground"])
def test_elements_above_a_curved_datum_are_where_vectors_put_them(dtype, range_format):
    rng = np.random.default_rng(5)
    n, height, y0, cell = 200, 850e3, 700e3, 20.0
    z = rng.uniform(-300.0, 900.0, (n, 4))
    r = radar(resolution_m=30.0, altitude_m=height, range_format=range_format, depression_angle_deg=50.0, prf_hz=2000.0)
    f = frame(z, y0, height, cell, dtype, curved=True)
    p = power_map(f, r, lut_of(lambda theta: theta), np.ones((1, 1)))
    arc = np.broadcast_to((y0 + np.arange(n) * cell)[:, None], z.shape)
    slant, _, _ = on_the_sphere(arc.ravel(), z.ravel(), height)
    if range_format == "slant":
        base, _, _ = on_the_sphere(arc[:, 0], np.zeros(n), height)
        exact = slant.reshape(z.shape) - base[:, None]
    else:
        # The arc at which flat ground lies at the same slant range: the triangle's law of cosines, inverted.
        a, b = np.longdouble(RE), np.longdouble(RE) + height
        exact = a * np.arccos((a * a + b * b - slant**2) / (2 * a * b)).reshape(z.shape) - arc
    got = p.offset.astype(float) * r.range_spacing_m
    assert np.abs(got - exact.astype(float)).max() < (0.02 if dtype is np.float32 else 0.01)


def test_flat_curved_ground_has_the_incidence_of_vectors_and_shadows_of_the_sphere():
    height, y0, cell = 6000.0, 40e3, 10.0
    z = np.zeros((300, 3))
    z[20] = 60.0
    f = frame(z, y0, height, cell, np.float64, curved=True)
    p = power_map(f, radar(), lut_of(lambda theta: theta), np.ones((1, 1)))
    arc = y0 + np.arange(300) * cell
    _, incidence, _ = on_the_sphere(arc, np.zeros(300), height)
    theta = p.power[0, :, 1] / (p.grid.geometry[:, 3])
    lit = np.r_[0:18, 295:300]
    np.testing.assert_allclose(theta[lit], incidence.astype(float)[lit], atol=1e-7)
    look = np.array([float(on_the_sphere(a, h, height)[2]) for a, h in zip(arc, z[:, 1], strict=True)])
    hidden = look < np.maximum.accumulate(np.concatenate(([-1.0], look[:-1])))
    got = (p.state[:, 1] & kernels.CAST_SHADOW) != 0
    assert abs(int(hidden.sum()) - int(got.sum())) <= 1


def test_horizon():
    assert horizon_ground_range_m(9000.0) == pytest.approx(math.sqrt(2 * RE * 9000.0), rel=1e-3)


def test_antenna_patterns():
    look = np.deg2rad(np.array([20.0, 40.0, 45.0, 50.0, 60.0]))
    sinc = elevation_gain("sinc_squared", look, math.radians(45.0), math.radians(10.0))
    assert sinc[2] == 1.0
    assert sinc[[1, 3]] == pytest.approx([0.5, 0.5], rel=1e-9)
    assert sinc.min() >= 1e-4
    csc = elevation_gain("cosecant_squared", look, math.radians(60.0), math.radians(10.0))
    depression = np.pi / 2 - look
    np.testing.assert_allclose(csc[:4], (np.sin(np.pi / 6) / np.sin(depression[:4])) ** 2, rtol=1e-12)
    table = elevation_gain("table", look, 0.0, 1.0, ((30.0, -10.0), (50.0, 0.0)))
    np.testing.assert_allclose(10 * np.log10(table), [-10.0, -5.0, -2.5, 0.0, 0.0], atol=1e-12)


def test_cosecant_squared_lights_level_ground_evenly():
    # Power of a cell of fixed area goes with G**2 / R**4, and R = H csc(depression): constant.
    r = radar(elevation_pattern="cosecant_squared", boresight_depression_deg=30.0, earth="flat")
    f = frame(np.zeros((400, 3)), 4000.0, 6000.0, 10.0)
    p = power_map(f, r, lut_of(lambda t: 0 * t + 0.1), np.ones((1, 1))).power[0, :, 1]
    np.testing.assert_allclose(p / p[0], 1.0, rtol=1e-5)


def test_the_pattern_is_taken_at_each_elements_own_look_and_calibrated_out_on_flat_ground():
    r = radar(elevation_pattern="sinc_squared", elevation_beamwidth_deg=12.0, earth="flat")
    z = np.zeros((40, 3))
    z[20] = 150.0
    f = frame(z, 5900.0, 6000.0, 5.0)
    plain = power_map(f, radar(earth="flat"), lut_of(lambda t: 0 * t + 0.1), np.ones((1, 1))).power[0, 20, 1]
    beam = power_map(f, r, lut_of(lambda t: 0 * t + 0.1), np.ones((1, 1))).power[0, 20, 1]
    look = math.atan2(6000.0, 5850.0)
    x = 2 * 0.442946470689452 * (look - math.pi / 4) / math.radians(12.0)
    assert beam / plain == pytest.approx(np.sinc(x) ** 4, rel=1e-5)
    image = quiet(scene(np.zeros((300, 40)), 5.0), r)
    apparent = image.mean_power[0] / image.calibration_w[:, None]
    assert np.abs(apparent / 0.1 - 1.0).max() < 1e-3
    edge, centre = image.noise_equivalent_sigma0[[0, len(image.looks) // 2]]
    assert edge > centre


def test_atmosphere():
    zenith, sixty, grazing = atmosphere_factor(1.0, np.deg2rad(np.array([0.0, 60.0, 90.0])))
    assert -10 * np.log10(zenith) == pytest.approx(1.0, rel=1e-12)
    assert -10 * np.log10(sixty) == pytest.approx(2.0, rel=5e-3)
    assert -10 * np.log10(grazing) == pytest.approx(math.sqrt(2 * RE / 8000.0), rel=1e-3)
    s = scene(np.zeros((60, 30)), 5.0)
    clear, hazy = quiet(s, radar(fading="none")), quiet(s, radar(fading="none", zenith_loss_db=1.5))
    row = len(clear.looks) // 2
    path = 1.0 / math.cos(math.radians(clear.incidence_angle_deg[row]))
    ratio = clear.mean_power[0, row, 1] / hazy.mean_power[0, row, 1]
    assert 10 * math.log10(ratio) == pytest.approx(3.0 * path, rel=2e-3)
    np.testing.assert_allclose(clear.apparent_sigma0()[0, row, 1], 0.1, rtol=0.05)


def test_a_swath_leaves_the_rest_of_the_scene_out():
    s = scene(np.random.default_rng(0).normal(0, 1, (300, 40)), 5.0)
    whole = quiet(s, radar())
    r = radar(near_incidence_deg=43.0, far_incidence_deg=46.0)
    part = quiet(s, r)
    assert part.incidence_angle_deg.min() > 42.8
    assert part.incidence_angle_deg.max() < 46.2
    inside = part.pixel_of_cell >= 0
    assert 0.3 < inside.mean() < 0.7
    assert (whole.pixel_of_cell >= 0).all()
    assert inside.any(axis=1).sum() * 40 == inside.sum()
    # Ground beside the swath is there, not mirrored: the same powers as in the whole image, on its own pixel grid.
    a = whole.mean_power[0][np.abs(whole.incidence_angle_deg - 44.5) < 1.0].mean()
    b = part.mean_power[0][np.abs(part.incidence_angle_deg - 44.5) < 1.0].mean()
    assert a == pytest.approx(b, rel=0.02)
    with pytest.raises(ConfigurationError, match="misses the scene"):
        quiet(s, radar(near_incidence_deg=70.0))


def test_a_pyramid_is_the_same_from_eight_headings():
    i, j = np.mgrid[-60:61, -60:61] * 5.0
    cone = np.maximum(120.0 - 0.5 * np.hypot(i, j), 0.0)
    # Of a round hill every heading sees the same; a cell's category marks its foot, so the corners stay out of it.
    cover = np.where(np.hypot(i, j) < 290.0, 0, 255)
    field = np.where(cover == 255, 1, 0)
    table = Table((-8.0,), 0.15)
    totals, shadows = [], []
    for heading in np.arange(0.0, 360.0, 45.0):
        image = quiet(
            scene(cone, 5.0, cover, field),
            radar(heading_deg=float(heading), fading="none", depression_angle_deg=25.0),
            table,
        )
        totals.append(image.mean_power.sum(dtype=float))
        shadows.append(image.shadow[cover == 0].mean())
    assert np.ptp(totals[::2]) / totals[0] < 1e-3
    assert np.ptp(totals) / np.mean(totals) < 0.01
    assert 0.05 < np.mean(shadows) < 0.6
    assert np.ptp(shadows) < 0.01


def test_an_oblique_heading_throws_shadows_its_own_way():
    z = np.zeros((80, 80))
    z[38:42, 38:42] = 40.0
    image = quiet(scene(z, 5.0), radar(heading_deg=45.0, resolution_m=10.0))
    rows, cols = np.nonzero(image.shadow)
    # Flying north-east the radar looks south-east.
    assert rows.mean() - 39.5 > 2.0
    assert cols.mean() - 39.5 > 2.0
    assert abs((rows.mean() - 39.5) - (cols.mean() - 39.5)) < 1.0
    assert image.pixel_of_cell.shape == z.shape
    assert (image.pixel_of_cell >= 0).mean() > 0.99


def target_image(target, **changes):
    s = scene(np.zeros((80, 60)), 5.0)
    r = radar(earth="flat", fading="none", **changes)
    return r, quiet(s, r, Table((-10.0,)), precision="float64"), quiet(s, r, precision="float64", targets=(target,))


def test_a_single_target_has_its_power_and_place():
    r, without, image = target_image(CulturalTarget(40, 30, 40.0))
    more = image.mean_power - without.mean_power
    row, column = np.unravel_index(int(np.argmax(more[0])), more.shape[1:])
    assert row * more.shape[2] + column == image.pixel_of_cell[40, 30]
    y, _ = ground_ranges_m(r, 80, 5.0, 0.0, 0.0)
    slant = math.hypot(y[40], 6000.0)
    constant = 100.0 * 10.0**5 * r.wavelength_m**2 * 10.0**-0.3 / (4 * math.pi) ** 3
    # One target in a pixel: the mean over the pixel's independent looks, one of which holds it.
    theta = math.radians(image.incidence_angle_deg[row])
    looks = 20.0**2 / (r.slant_resolution_m / math.sin(theta) * 1.0)
    assert more.sum() == pytest.approx(constant * 1e4 / slant**4 / looks, rel=1e-9, abs=0.0)


def test_a_target_in_shadow_is_silent_and_a_mast_rises_out_of_it():
    z = np.zeros((80, 60))
    z[30] = 60.0
    s = scene(z, 5.0)
    r = radar(earth="flat", fading="none")
    base = quiet(s, r)
    for height, seen in ((0.0, False), (55.0, True)):
        more = quiet(s, r, targets=(CulturalTarget(34, 30, 60.0, height_m=height),)).mean_power - base.mean_power
        assert bool((more > 0).any()) == seen


@pytest.mark.parametrize("heading", [0.0, 90.0, 180.0, 270.0, 30.0])
def test_specular_targets_answer_in_their_directions_only(heading):
    bearing = heading - 90.0
    for off, share in ((0.0, 1.0), (5.0, 0.5), (40.0, 0.0)):
        target = CulturalTarget(40, 30, 50.0, directions_deg=(bearing + off, bearing + 180.0), lobe_deg=10.0)
        _, without, image = target_image(target, heading_deg=heading)
        _, _, bright = target_image(CulturalTarget(40, 30, 50.0), heading_deg=heading)
        got = (image.mean_power - without.mean_power).sum() / (bright.mean_power - without.mean_power).sum()
        assert got == pytest.approx(share, abs=1e-4)
        k = image.pixel_of_cell[40, 30]
        if share == 1.0:
            assert np.argmax((image.mean_power - without.mean_power)[0]) == k


def test_targets_outside_are_refused():
    with pytest.raises(SceneError, match="outside the scene"):
        quiet(scene(np.zeros((20, 20))), radar(), targets=(CulturalTarget(20, 3, 10.0),))
    with pytest.raises(SceneError, match="impossible"):
        CulturalTarget(1, 1, 10.0, lobe_deg=0.0)


def test_receivers():
    s = scene(np.zeros((80, 60)), 5.0)
    plain = quiet(s, radar())
    flat = range_geometry(np.array([6000.0 / math.tan(math.pi / 4)]), 6000.0, False)
    theta = flat.incidence_rad
    level = float(radar(earth="flat").received_power_w(theta, flat.slant_range_m, theta)[0]) * 0.1
    p = plain.intensity.astype(float)
    expected = {
        "square_law": p * p / level,
        "saturation": np.minimum(p, level),
        "compression": p * p / (p + level),
        "numpy:sqrt": np.sqrt(p),
    }
    for name, value in expected.items():
        got = quiet(s, radar(receiver=name, receiver_level_db=-10.0)).intensity
        np.testing.assert_allclose(got, value, rtol=3e-3, atol=0.0)
    with pytest.raises(ConfigurationError, match=r"cannot be imported: .*Put its module beside"):
        quiet(s, radar(receiver="no.such:thing"))


def test_automatic_gain_follows_the_flight():
    cover = np.zeros((60, 400), dtype=int)
    cover[:, 200:] = 1
    s = scene(np.zeros((60, 400)), 5.0, cover, cover)
    r = radar(receiver="agc", receiver_level_db=-10.0, agc_length_m=60.0, fading="none")
    image = quiet(s, r, Table((-5.0, -15.0)), precision="float64")
    line = image.intensity[0].mean(axis=0)
    np.testing.assert_allclose(line[40], line[-1], rtol=1e-3)
    # Just behind the step the gain is still that of the bright ground, and recovers as exp(-x / length).
    k = 50
    follow = 1.0 + (10.0 - 1.0) * math.exp(-1.0 * 20.0 / 60.0)
    noise = float(image.noise_power_w.mean() / image.mean_power[0, :, -1].mean())
    assert noise < 0.01
    assert line[k] / line[-1] == pytest.approx(1.0 / follow, rel=0.02)


def test_saturation_holds_all_at_its_level():
    s = scene(np.zeros((60, 60)), 5.0)
    saturated = quiet(s, radar(receiver="saturation", receiver_level_db=-60.0)).intensity
    assert np.unique(saturated).size == 1


def pulses_converted(bits: int, sigma0: np.ndarray, full_scale_db: float) -> np.ndarray:
    """Mean of compressed looks of ground (n,) whose raw echo is converted: a long coded pulse, wave by wave."""
    rng = np.random.default_rng(8)
    n = len(sigma0)
    code = np.exp(2j * np.pi * rng.random(n))
    out = np.zeros(n)
    for _ in range(400):
        waves = np.sqrt(0.5 * sigma0) * (rng.standard_normal(n) + 1j * rng.standard_normal(n))
        raw = np.fft.ifft(np.fft.fft(waves, norm="ortho") * code, norm="ortho")
        scale = np.sqrt(10.0 ** (0.1 * full_scale_db) * np.mean(np.abs(raw) ** 2))
        step = 2.0 * scale / 2**bits

        def convert(x, step=step):
            return (np.clip(np.floor(x / step), -(2 ** (bits - 1)), 2 ** (bits - 1) - 1) + 0.5) * step

        y = convert(raw.real) + 1j * convert(raw.imag)
        gain = np.vdot(raw, y).real / np.vdot(raw, raw).real
        out += np.abs(np.fft.ifft(np.fft.fft(y / gain, norm="ortho") / code, norm="ortho")) ** 2 / 400
    return out


@pytest.mark.parametrize(("bits", "full_scale_db"), [(1, 8.0), (2, 3.0), (4, 8.0), (4, 16.0), (8, 8.0)])
def test_a_converter_adds_the_noise_of_raw_echoes_that_are_rounded(bits, full_scale_db):
    """Bright and dark ground share the error of the echo in which both lie before it is compressed."""
    cover = np.zeros((64, 64), dtype=int)
    cover[:, 32:] = 1
    s = scene(np.zeros((64, 64)), 5.0, cover, cover)
    r = radar(adc_bits=bits, adc_range_db=full_scale_db, fading="none", peak_power_w=1e7, altitude_m=20e3, prf_hz=150.0)
    r = replace(r, speed_m_s=150.0)  # one pulse a metre, as an antenna of 2 m needs
    image = quiet(s, r, Table((-5.0, -25.0)))
    shown = image.apparent_sigma0()[0]
    by_waves = pulses_converted(bits, np.repeat(10.0 ** np.array([-0.5, -2.5]), 512), full_scale_db)
    noise = float(image.noise_equivalent_sigma0.mean())
    np.testing.assert_allclose(shown[:, :7].mean() - noise, by_waves[:512].mean(), rtol=0.03)
    np.testing.assert_allclose(shown[:, -7:].mean() - noise, by_waves[512:].mean(), rtol=0.05)


def test_more_pulses_than_are_needed_average_the_error_of_a_converter():
    s = scene(np.zeros((40, 40)), 5.0)
    given = {"fading": "none", "peak_power_w": 1e6, "speed_m_s": 150.0, "channels": ("HH", "HV")}

    def added(**more):
        one, plain = (quiet(s, radar(adc_bits=bits, adc_range_db=8.0, **given, **more)) for bits in (2, 0))
        gain = one.apparent_sigma0() - plain.apparent_sigma0()
        (note,) = [note for note in one.notes if "2-bit converter" in note]
        shown = [float(number) for number in re.findall(r"(-[\d.]+) dB in H[HV]", note)]
        assert shown == pytest.approx(10.0 * np.log10(gain.mean(axis=(1, 2))), abs=0.06)
        assert not [note for note in plain.notes if "converter" in note]
        return gain.mean(axis=(1, 2)), plain.apparent_sigma0().mean(axis=(1, 2))

    (once, level), (four, _) = added(prf_hz=150.0), added(prf_hz=600.0)
    np.testing.assert_allclose(once / four, 4.0, rtol=1e-3)
    np.testing.assert_allclose(once / level, once[0] / level[0], rtol=1e-3)  # of each channel by its own echo


@pytest.mark.parametrize("bits", [1, 8, 16])
def test_pictures_by_each_calibration(bits):
    s = scene(np.zeros((60, 60)), 5.0)
    power = quiet(s, radar()).intensity.astype(float)
    top, mid = 2**bits - 1, float(np.median(power))

    def levels(**calibration):
        found = picture(quiet(s, radar(n_bits=bits, **calibration))).astype(float)
        assert found.min() >= 0
        assert found.max() <= top
        return found

    linear = np.clip(top / 99.0 * (power / mid - 1.0), 0, top)
    np.testing.assert_allclose(levels(i_min_w=mid), linear, atol=0.51)
    pair = levels(i_c_w=mid, i_qc=top / 2)
    assert np.median(pair) == pytest.approx(top / 2, abs=1.0)
    tone = np.clip(top / 2.0 * np.log10(power / mid), 0, top)
    np.testing.assert_allclose(levels(p_rc_w=mid, g_rc=0.0), tone, atol=0.51)
    film = np.clip(top / 2.0 * 1.5 * np.log10(power / mid), 0, top)
    np.testing.assert_allclose(levels(p_rc_w=mid, g_rc=0.0, film_gamma=1.5, film_k=3.0), film, atol=0.51)
    assert abs(np.median(levels()) - 0.5 * top) <= 0.5


def test_strips_and_threads_give_the_same_bits_and_bins_hold_the_parts_of_elements():
    rng = np.random.default_rng(3)
    # One column more than a strip: the last strip is a single column.
    z = rng.normal(0, 2.0, (200, kernels.STRIP + 1)).cumsum(axis=0)
    z -= z.mean()
    f = frame(z, 4000.0, 6000.0, 5.0, np.float32)
    r = radar(resolution_m=12.0, elevation_pattern="sinc_squared")
    lut, factor = lut_of(lambda t: np.cos(t) ** 2), rng.uniform(0.5, 2.0, (1, 1))
    grid = echo_grid(f, r)
    one = echo_sums(r, grid, lut, factor)
    for threads in (2, 3, 7):
        np.testing.assert_array_equal(echo_sums(r, grid, lut, factor, threads), one)
    p = power_map(f, r, lut, factor)
    # The elements of the map split by overlap, one by one, in double precision.
    centre = np.vstack([p.offset[:1], p.offset, p.offset[-1:]]).astype(float) + grid.base[:, None]
    edge = 0.5 * (centre[1:] + centre[:-1])
    low, high = np.minimum(edge[1:], edge[:-1]), np.maximum(edge[1:], edge[:-1])
    two = np.zeros(one.shape)
    for k in range(grid.n_bins):
        inside = np.minimum(high, grid.first + k + 1) - np.maximum(low, grid.first + k)
        two[0, k] = (p.power[0] * np.maximum(inside, 0.0) / (high - low)).sum(axis=0)
    np.testing.assert_allclose(one, two, rtol=2e-4, atol=1e-4 * two.max())
    assert one.sum(dtype=float) == pytest.approx(two.sum(), rel=1e-6)
    assert p.layover.any()


def test_whole_images_are_the_same_bits_for_any_number_of_threads():
    rng = np.random.default_rng(4)
    s = scene(rng.normal(0, 0.5, (90, 70)).cumsum(axis=0), 5.0, rng.integers(0, 3, (90, 70)))
    table = Table((-8.0, -12.0, -16.0), 0.1)
    r = radar(channels=("HH", "HV"), resolution_m=11.0)
    one = quiet(s, r, table)
    for threads in (2, 5, 64):
        np.testing.assert_array_equal(quiet(s, r, table, threads=threads).intensity, one.intensity)


def test_what_fails_in_a_thread_is_told_to_the_caller():
    done: list[int] = []

    def work(k: int) -> None:
        if k == 3:
            raise ValueError("third")
        done.append(k)

    with pytest.raises(ValueError, match="third"):
        do_all(work, 8, 4)
    do_all(done.append, 100, 7)
    assert sorted(done[-100:]) == list(range(100))


@pytest.mark.parametrize("looks", [1.0, 4.0, 40.5])
def test_fine_pixels_fade_together(looks):
    x = correlated_fading(
        (1, 300, 300), np.full(300, looks), np.zeros(1, dtype=np.int64), (np.uint32(1), np.uint32(2)), (2.5, 4.0),
    )[0]  # fmt: skip
    sample = x[::5, ::5].ravel()
    assert stats.kstest(sample, stats.gamma(looks, scale=1 / looks).cdf).pvalue > 1e-3
    d = (x - 1.0) * math.sqrt(looks)
    for lag in (1, 2, 3):
        got = np.mean(d[:, lag:] * d[:, :-lag])
        assert got == pytest.approx(1.0 - lag / 4.0, abs=0.09)
    assert abs(np.mean(d[:, 5:] * d[:, :-5])) < 0.05


def test_a_pixel_of_equal_slant_range_holds_the_same_samples_everywhere():
    r = radar(range_format="slant", bandwidth_mhz=60.0, resolution_m=30.0)
    looks = quiet(scene(np.zeros((400, 40)), 10.0), r).looks
    slant = r.range_spacing_m / (299_792_458.0 / (2 * 60e6))
    np.testing.assert_allclose(looks, 30.0 / 1.0 * slant, rtol=1e-9)  # an antenna of 2 m: a sample each metre


@pytest.mark.parametrize("range_format", ["ground", "slant"])
def test_fine_pixels_fade_together_as_far_as_their_cells_overlap_on_the_ground(range_format):
    r = radar(range_format=range_format, resolution_m=20.0, pixel_m=5.0, depression_angle_deg=60.0, altitude_m=50e3)
    image = quiet(scene(np.zeros((400, 400)), 5.0), replace(r, prf_hz=300.0, peak_power_w=1e9))
    x = (image.intensity[0] / image.mean_power[0]).astype(float)[20:-20, 20:-20] - 1.0
    for lag in (1, 2, 3):
        of_range, of_azimuth = np.mean(x[lag:] * x[:-lag]) / x.var(), np.mean(x[:, lag:] * x[:, :-lag]) / x.var()
        assert (of_range, of_azimuth) == pytest.approx((1.0 - lag / 4.0,) * 2, abs=0.05)


def test_an_image_of_fine_pixels():
    s = scene(np.zeros((120, 120)), 5.0)
    r = radar(resolution_m=30.0, pixel_m=10.0)
    image = quiet(s, r)
    assert image.intensity.shape[1:] == (60, 60)
    apparent = image.mean_power[0] / image.calibration_w[:, None]
    np.testing.assert_allclose(apparent, 0.1, rtol=3e-3)
    d = image.intensity[0] / image.mean_power[0] - 1.0
    assert np.mean(d[:, 1:] * d[:, :-1]) / d.var() > 0.5
    coarse = quiet(s, radar(resolution_m=30.0))
    np.testing.assert_array_equal(np.unique(np.round(coarse.looks, 6))[:1] > 0, [True])
    assert any("correlated" in note for note in image.notes)


def test_extremes_have_finite_images():
    rng = np.random.default_rng(1)
    orbit = quiet(
        scene(rng.normal(0, 15, (60, 60)).cumsum(axis=0), 1.0),
        radar(
            altitude_m=850e3, resolution_m=5.0, bandwidth_mhz=300.0, prf_hz=8000.0, speed_m_s=7500.0,
            antenna_length_m=10.0, peak_power_w=5000.0, antenna_gain_db=45.0, pulse_length_us=30.0,
        ),
    )  # fmt: skip
    assert np.isfinite(orbit.intensity).all()
    cliff = np.zeros((80, 40))
    cliff[40:] = 3000.0
    assert np.isfinite(quiet(scene(cliff, 5.0), radar(altitude_m=8000.0)).intensity).all()
    grazing = radar(depression_angle_deg=3.0, altitude_m=1000.0)
    image = quiet(scene(rng.normal(0, 5, (80, 40)), 5.0), grazing)
    assert image.shadow.mean() > 0.3
    assert (image.intensity > 0).all()
    tiny = quiet(scene(np.zeros((2, 2)), 5.0), radar())
    assert tiny.intensity.shape == (1, 1, 1)
