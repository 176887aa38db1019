"""Derived quantities of the radar against textbook forms, and every refusal with its numbers."""

from __future__ import annotations

import dataclasses
import math
import re

import numpy as np
import pytest

from seqrsm.errors import ConfigurationError
from seqrsm.sensor.named import noise_equivalent_db
from seqrsm.sensor.radar import RadarConfiguration, from_settings
from seqrsm.sensor.swath import ground_ranges_m

SETTINGS = {
    "frequency": 5.3,
    "polarization": "HH+HV",
    "resolution": 20.0,
    "bandwidth": 50.0,
    "peak_power": 100.0,
    "depression_angle": 45.0,
}
FIXED = {"altitude_m": 6000.0, "earth": "flat", "antenna_length_m": 3.0}
C = 299792458.0


def radar(**changes) -> RadarConfiguration:
    return from_settings(SETTINGS, {**FIXED, **changes})


def test_names_of_table_1_become_fields():
    r = from_settings({**SETTINGS, "looks": 4}, {**FIXED, "season": "winter", "n_bits": 12.0})
    assert r.channels == ("HH", "HV")
    assert (r.frequency_ghz, r.resolution_m, r.looks, r.season, r.n_bits) == (5.3, 20.0, 4.0, "winter", 12)
    assert r.n_transmit == 1
    assert from_settings({**SETTINGS, "polarization": "HH+HV+VV"}, FIXED).n_transmit == 2


def test_resolutions_and_looks_by_the_printed_equations():
    r = radar()
    assert r.wavelength_m == pytest.approx(C / 5.3e9, rel=1e-14)
    assert r.slant_resolution_m == pytest.approx(C / 1e8, rel=1e-14)
    assert r.ground_resolution_m(math.pi / 6) == pytest.approx(2 * C / 1e8, rel=1e-12)
    assert r.azimuth_resolution_m(8000.0) == 1.5
    real = radar(aperture="real")
    assert real.azimuth_resolution_m(8000.0) == pytest.approx(8000.0 * C / 5.3e9 / 3.0, rel=1e-14)
    beam = radar(aperture="real", azimuth_beamwidth_deg=1.5)
    assert beam.azimuth_resolution_m(8000.0) == pytest.approx(8000.0 * math.radians(1.5))
    # N = (20 / 1.5) * (20 / (c / 2B sin theta)).
    expected = (20.0 / 1.5) * 20.0 / (C / 1e8 / math.sin(math.pi / 4))
    assert r.looks_available(math.pi / 4) == pytest.approx(expected, rel=1e-12)
    # Rows of a slant-range image: 60 deg from the vertical, 20 m on the ground.
    slant = from_settings({**SETTINGS, "depression_angle": 30.0}, {**FIXED, "range_format": "slant"})
    assert slant.range_spacing_m == pytest.approx(20.0 * math.sqrt(0.75))


def test_looks_reduce_to_equation_3_8_for_a_real_aperture_footprint():
    # resolution = R lambda / L and resolution bandwidth B: N = (2 R lambda / L**2)(B_c / B).
    R, B_c = 9000.0, 50e6
    probe = radar(aperture="real")
    resolution = R * probe.wavelength_m / probe.antenna_length_m
    r = from_settings({**SETTINGS, "resolution": resolution}, {**FIXED, "aperture": "real"})
    theta = math.radians(40.0)
    B = C / (2.0 * resolution * math.sin(theta))
    expected = (2.0 * R * r.wavelength_m / r.antenna_length_m**2) * (B_c / B)
    assert r.looks_available(theta) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("aperture", ["synthetic", "real"])
def test_a_given_beam_has_the_samples_of_its_own_doppler_bandwidth(aperture):
    # Frequencies of the echoes in a beam spread over 2 v beta / lambda; in the time in which the craft flies the cell.
    beta, v = math.radians(0.8), 100.0
    r = radar(aperture=aperture, azimuth_beamwidth_deg=0.8)
    doppler_hz = 2.0 * v * beta / r.wavelength_m
    across = 20.0 / r.ground_resolution_m(math.pi / 4)
    assert r.looks_available(math.pi / 4) == pytest.approx(20.0 / v * doppler_hz * across, rel=1e-12)
    if aperture == "synthetic":
        assert r.azimuth_resolution_m(8000.0) == pytest.approx(v / doppler_hz, rel=1e-12)
    same = radar(aperture=aperture, antenna_length_m=r.wavelength_m / beta)
    assert same.looks_available(0.7) == pytest.approx(r.looks_available(0.7), rel=1e-12)


def test_noise_of_a_synthetic_aperture_does_not_depend_on_its_beam_at_one_gain():
    # The textbook equation below knows neither length nor beam.
    beams = ({"azimuth_beamwidth_deg": 0.5}, {"azimuth_beamwidth_deg": 2.0}, {})
    one, other, plain = (noise_equivalent_db(radar(**beam)) for beam in beams)
    assert one == pytest.approx(plain, abs=1e-9)
    assert other == pytest.approx(plain, abs=1e-9)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"azimuth_beamwidth_deg": 0.05}, "a beam of 0.05 deg resolves 32.41 m in azimuth.* 32.4.* m or a wider beam"),
        ({"azimuth_beamwidth_deg": 10.0, "prf_hz": 400.0}, "prf_hz.* Use at least 617.1"),
    ],
)
def test_what_a_given_beam_cannot_do_is_refused(changes, words):
    with pytest.raises(ConfigurationError, match=words):
        radar(**changes)


@pytest.mark.parametrize("beam", [{"antenna_length_m": 2.5}, {"azimuth_beamwidth_deg": math.degrees(0.02)}])
def test_just_as_many_pulses_as_are_needed_do(beam):
    along = 1.25 if "antenna_length_m" in beam else 0.5 * radar().wavelength_m / 0.02
    needed, rounding = 100.0 / along, 0.0 if along == 1.25 else 1e-9
    assert radar(speed_m_s=100.0, prf_hz=needed * (1.0 + rounding), **beam).sample_m == pytest.approx(along)
    with pytest.raises(ConfigurationError, match=f"a pulse every {along:.4g} m flown"):
        radar(speed_m_s=100.0, prf_hz=needed * (1.0 - 1e-6), **beam)


def test_signal_to_noise_is_the_textbook_synthetic_aperture_equation():
    # SNR = P_avg G**2 lambda**3 sigma0 d_g / (2 (4 pi)**3 R**3 v k T0 F) x losses (Moore; Curlander and McDonough).
    r = radar(noise_figure_db=4.0, loss_db=3.0)
    R, theta = 8485.3, math.radians(45.0)
    average = 100.0 * 5e-6 * 1000.0
    ground = C / (2 * 50e6 * math.sin(theta))
    snr = average * 10**5.0 * (C / 5.3e9) ** 3 * 0.1 * ground * 10**-0.3
    snr /= 2 * (4 * math.pi) ** 3 * R**3 * 100.0 * 1.380649e-23 * 290.0 * 10**0.4
    got = 0.1 * r.received_power_w(theta, R, theta) / r.noise_power_w(np.array([R]))[0]
    assert got == pytest.approx(snr, rel=1e-10)
    nesz = r.noise_equivalent_sigma0(np.array([theta]), np.array([R]), np.array([theta]))[0]
    assert 0.1 / nesz == pytest.approx(snr, rel=1e-10)


@pytest.mark.parametrize(
    ("altitude", "incidence", "length"), [(514e3, 25.0, 4.8), (693e3, 38.0, 12.3), (850e3, 23.0, 10.0)]
)
def test_a_satellite_resolves_what_its_path_in_space_and_the_ground_below_it_let(altitude, incidence, length):
    """A pass in vectors: Doppler at both edges of the beam, its time between them, and the beam's way over ground."""
    R, wavelength = 6371008.8, C / 5.3e9
    turn = math.sqrt(3.986004418e14 / (R + altitude) ** 3)  # rad/s
    look = math.asin(R / (R + altitude) * math.sin(math.radians(incidence)))
    off = math.radians(incidence) - look
    target = R * np.array([math.cos(off), 0.0, math.sin(off)])

    def seen(t):
        """Sine of the target's angle from broadside, and the slant range."""
        place = (R + altitude) * np.array([math.cos(turn * t), math.sin(turn * t), 0.0])
        toward = target - place
        slant = np.linalg.norm(toward)
        return float(toward @ [-math.sin(turn * t), math.cos(turn * t), 0.0]) / slant, float(slant)

    low, high = 0.0, 5.0
    while high - low > 1e-12:  # when the target leaves the half-power beam
        middle = 0.5 * (low + high)
        low, high = (middle, high) if abs(seen(middle)[0]) < 0.5 * wavelength / length else (low, middle)
    step = 1e-5
    doppler_hz = 2.0 * abs(seen(low + step)[1] - seen(low - step)[1]) / (2.0 * step) / wavelength * 2.0
    on_ground = turn * R  # m/s
    r = from_settings(
        {**SETTINGS, "resolution": 30.0, "depression_angle": 90.0 - math.degrees(look)},
        {"altitude_m": altitude, "speed_m_s": on_ground, "antenna_length_m": length, "prf_hz": 5000.0},
    )
    slant = seen(0.0)[1]
    # The track of a place beside that of the satellite is shorter by the cosine of the angle between them.
    assert r.azimuth_resolution_m(slant) == pytest.approx(on_ground / doppler_hz, rel=1e-3)
    assert r.coherent_pulses(slant) == pytest.approx(5000.0 * 2.0 * low, rel=0.01)
    assert r.looks_available(math.radians(incidence)) == pytest.approx(
        30.0 / (on_ground / doppler_hz) * 30.0 / (C / 1e8 / math.sin(math.radians(incidence))), rel=1e-3
    )


def test_noise_from_orbit_is_that_of_the_speed_in_space():
    # NESZ = 256 pi**3 R**3 V sin(theta) k T0 B F / (P G**2 lambda**3 c tau PRF) x losses, V that of the satellite.
    look, height = math.radians(30.0), 700e3
    theta = math.asin((6371008.8 + height) / 6371008.8 * math.sin(look))
    R = 6371008.8 * math.sin(theta - look) / math.sin(look)
    V = math.sqrt(3.986004418e14 / (6371008.8 + height))
    ground = V * 6371008.8 / (6371008.8 + height)
    beams = {}, {"azimuth_beamwidth_deg": 0.3}
    for beam in beams:
        fixed = {"altitude_m": height, "speed_m_s": ground, "antenna_length_m": 10.0, "prf_hz": 4000.0, **beam}
        r = from_settings({**SETTINGS, "depression_angle": 60.0}, fixed)
        nesz = 256 * math.pi**3 * R**3 * V * math.sin(theta) * 1.380649e-23 * 290.0 * 50e6 * 10**0.4 * 10**0.3
        nesz /= 100.0 * 10**5.0 * (C / 5.3e9) ** 3 * C * 5e-6 * 4000.0
        assert noise_equivalent_db(r) == pytest.approx(10.0 * math.log10(nesz), abs=1e-3)


def test_pulses_from_orbit_sample_the_doppler_of_the_speed_in_space():
    V = math.sqrt(3.986004418e14 / (6371008.8 + 700e3))
    orbit = {"altitude_m": 700e3, "speed_m_s": V * 6371008.8 / 7071008.8, "antenna_length_m": 10.0}
    settings = {**SETTINGS, "depression_angle": 60.0}
    assert from_settings(settings, {**orbit, "prf_hz": 1.0001 * 2.0 * V / 10.0}).prf_hz > 0.0
    with pytest.raises(ConfigurationError, match="prf_hz"):
        from_settings(settings, {**orbit, "prf_hz": 0.9999 * 2.0 * V / 10.0})


def test_two_transmit_polarizations_share_the_pulses():
    one, two = (from_settings({**SETTINGS, "polarization": p}, FIXED) for p in ("HH+HV", "HH+VV"))
    R = np.array([8000.0])
    np.testing.assert_allclose(two.noise_power_w(R), 2.0 * one.noise_power_w(R))  # approx would allow 1e-12 W


def test_thermal_noise_and_gains():
    r = radar(noise_figure_db=0.0)
    np.testing.assert_allclose(r.thermal_noise_w(), 1.380649e-23 * 290.0 * 50e6, rtol=1e-12)
    assert r.compression_gain == 250.0
    assert r.coherent_pulses(8000.0) == pytest.approx(1000.0 * 8000.0 * r.wavelength_m / 3.0 / 100.0)
    assert radar(aperture="real").coherent_pulses(8000.0) == 1.0
    # A pulse too short to be compressed, and an antenna that flies its length between two pulses, lose nothing.
    assert radar(pulse_length_us=0.01).compression_gain == 1.0
    assert radar(speed_m_s=1400.0).coherent_pulses(20.0) == 1.0


def test_looks_used_are_those_asked_for_where_there_are_as_many():
    r = from_settings({**SETTINGS, "looks": 50.0}, FIXED)
    theta = np.radians([10.0, 45.0])
    np.testing.assert_allclose(r.looks_used(theta), [r.looks_available(theta[0]), 50.0])
    assert radar().looks_used(theta)[1] == radar().looks_available(theta[1])
    # One sample where the cell is no wider than what the pulse and the antenna resolve.
    one = from_settings({**SETTINGS, "bandwidth": C / 20e6}, {**FIXED, "antenna_length_m": 40.0})
    np.testing.assert_allclose(one.looks_used(np.radians([20.0, 30.0])), 1.0, rtol=1e-9)


def test_depression_points_at_the_centre_of_the_scene():
    y, rows = ground_ranges_m(radar(), 101, 5.0, 100.0, 200.0)
    assert rows == slice(0, 101)
    assert y[50] == pytest.approx(5900.0)
    np.testing.assert_allclose(np.diff(y), 5.0)


def test_grey_tones_are_asked_for_by_a_calibration_or_the_film():
    asked = ({}, {"film_gamma": 1.1}, {"film_k": 1.1}, {"dynamic_range_db": 25.0}, {"i_min_w": 1e-12})
    assert [radar(**changes).calibrated for changes in asked] == [False, True, True, True, True]


def messages(**changes) -> str:
    settings = {**SETTINGS, **{k: v for k, v in changes.items() if k in SETTINGS or k == "looks"}}
    fixed = {**FIXED, **{k: v for k, v in changes.items() if k not in settings}}
    with pytest.raises(ConfigurationError) as caught:
        from_settings(settings, fixed)
    return str(caught.value)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"resolution": 4.0}, ["50 MHz", "4.24", "52.997 MHz"]),
        ({"resolution": 4.5, "antenna_length_m": 12.0}, ["12 m", "6 m"]),
        ({"looks": 200.0}, ["62.9", "at most 62.897 looks"]),
        ({"looks": 0.5}, ["looks", "1 to 1e+06"]),
        ({"heading_deg": 450.0}, ["-360 to 360"]),
        ({"frequency": 0.0}, ["frequency: out of range", "0.1 to 100 GHz"]),
        ({"frequency": math.nan}, ["frequency: out of range"]),
        ({"polarization": "HH+RL"}, ["HH, HV, VV"]),
        ({"polarization": "HH+HH"}, ["each once"]),
        ({"polarization": "HV+VH"}, ["HV and VH carry the same information"]),
        ({"polarization": "RH+HH"}, ["sends circular waves or linear ones", "Use RH+RV, or HH+HV+VV"]),
        ({"polarization": "VH+RV+RH"}, ["sends circular waves or linear ones"]),
        ({"polarization": ""}, ["set of channels"]),
        ({"prf_hz": 50.0}, ["66.667 Hz"]),
        ({"pulse_length_us": 2000.0}, ["1000 us"]),
        ({"aperture": "lens"}, ["synthetic, real"]),
        ({"season": "monsoon"}, ["spring_summer"]),
        ({"wind_low_m_s": 9.0}, ["wind_high_m_s"]),
        ({"peak_power": "much"}, ["not a number", "much"]),
        ({"n_bits": 99}, ["n_bits"]),
        ({"receiver": "magic"}, ["saturation", "package.module:function"]),
        ({"elevation_pattern": "table"}, ["pattern_table"]),
        ({"pattern_table": "10:0"}, ["not a pattern"]),
        ({"pattern_table": "10:0, 5:-3"}, ["rising look angles"]),
        ({"near_incidence_deg": 60.0, "far_incidence_deg": 40.0}, ["beyond the far edge"]),
        ({"i_min_w": 1e-12, "p_rc_w": 1e-12, "g_rc": 0.0}, ["more than one calibration", "i_min_w; p_rc_w and g_rc"]),
        ({"i_c_w": 1e-12}, ["half of a calibration pair", "i_c_w and i_qc"]),
        ({"snow": "wet"}, ["winter only"]),
        ({"pixel_m": 30.0}, ["coarser than the resolution"]),
        ({"earth": "curved", "depression_angle": 1.0}, ["horizon, 2.486 deg", "at least 2.4857 deg"]),
    ],
)
def test_impossible_sets_are_refused_with_numbers(changes, words):
    text = messages(**changes)
    for word in words:
        assert word in text


def test_all_problems_are_told_at_once():
    with pytest.raises(ConfigurationError) as caught:
        from_settings({"frequency": 5.0, "colour": "red", "frequency_ghz": 6.0}, {"altitude_m": "high"})
    fields = [p.field for p in caught.value.problems]
    for name in ("colour", "frequency_ghz", "polarization", "resolution", "bandwidth", "peak_power", "altitude_m"):
        assert name in fields
    with pytest.raises(ConfigurationError) as caught:
        dataclasses.replace(radar(), frequency_ghz=-1.0, noise_figure_db=-3.0, speed_m_s=0.0)
    assert len(caught.value.problems) == 3


def test_what_a_message_allows_is_allowed_and_hardly_more():
    limit = float(re.search(r"at most ([0-9.]+) looks", messages(looks=200.0))[1])
    assert from_settings({**SETTINGS, "looks": limit}, FIXED).looks == limit
    assert "looks" in messages(looks=1.001 * limit)
    assert radar(pulse_length_us=999.0).pulse_length_us == 999.0
    assert "Keep it below 1000 us" in messages(pulse_length_us=1001.0)
    bandwidth, resolution = map(float, re.findall(r"at least ([0-9.]+) M?H?z?m?", messages(resolution=4.0)))
    assert from_settings({**SETTINGS, "resolution": 4.0, "bandwidth": bandwidth}, FIXED).bandwidth_mhz == bandwidth
    assert from_settings({**SETTINGS, "resolution": resolution}, FIXED).resolution_m == resolution
    assert "resolution" in messages(resolution=0.999 * resolution)


@pytest.mark.parametrize(
    ("changes", "settings", "words"),
    [
        ({}, {"depression_angle": 80.0}, ["1453 m behind nadir", "67.1"]),
        ({"altitude_m": 20.0}, {"depression_angle": 10.0}, ["above the ground"]),
        ({"altitude_m": 9000.0}, {"depression_angle": 0.6}, ["horizon"]),
        ({"aperture": "real", "antenna_length_m": 2.0}, {}, ["real beam", "far edge"]),
        ({"pulse_length_us": 60.0}, {}, ["near edge"]),
        ({"prf_hz": 60000.0}, {}, ["overlap"]),
    ],
)
def test_swaths_that_cannot_be_flown_are_refused(changes, settings, words):
    r = from_settings({**SETTINGS, **settings}, {**FIXED, **changes})
    with pytest.raises(ConfigurationError) as caught:
        ground_ranges_m(r, 1001, 5.0, 50.0, 100.0)
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize(("name", "bad"), [("prf_hz", 60000.0), ("pulse_length_us", 60.0)])
def test_what_a_swath_allows_at_most_can_be_flown_and_more_cannot(name, bad):
    with pytest.raises(ConfigurationError, match=name) as caught:
        ground_ranges_m(radar(**{name: bad}), 1001, 5.0, 50.0, 100.0)
    limit = float(re.search(r"(?:at most|below) ([0-9.]+)", str(caught.value))[1])
    assert limit < bad
    ground_ranges_m(radar(**{name: limit}), 1001, 5.0, 50.0, 100.0)
    with pytest.raises(ConfigurationError, match=name):
        ground_ranges_m(radar(**{name: 1.001 * limit}), 1001, 5.0, 50.0, 100.0)
