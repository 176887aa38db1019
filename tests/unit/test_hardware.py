"""Rules of the drawing board: radars that flew pass with a margin, the impossible does not."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import pytest

from seqrsm.constants import EARTH_RADIUS_M, SPEED_OF_LIGHT_M_S
from seqrsm.sensor.earth import incidence_of_look
from seqrsm.sensor.hardware import data_rate_bit_s, limits, orbit_speed_m_s
from seqrsm.sensor.radar import RadarConfiguration


def built(
    size_m: tuple[float, float], ghz: float, altitude_m: float, incidence_deg: float, prf_hz: float, pulse_us: float
) -> RadarConfiguration:
    """A satellite of these published numbers whose antenna has an efficiency of 0.7."""
    length, height = size_m
    wavelength = SPEED_OF_LIGHT_M_S / (ghz * 1e9)
    look = math.asin(EARTH_RADIUS_M / (EARTH_RADIUS_M + altitude_m) * math.sin(math.radians(incidence_deg)))
    gain = 10.0 * math.log10(4.0 * math.pi * 0.7 * length * height / wavelength**2)
    return RadarConfiguration(
        ghz, ("HH",), 30.0, 30.0, 4e3, 90.0 - math.degrees(look), altitude_m, antenna_length_m=length,
        antenna_gain_db=gain, prf_hz=prf_hz, pulse_length_us=pulse_us, speed_m_s=orbit_speed_m_s(altitude_m),
    )  # fmt: skip


def margins(radar: RadarConfiguration, swath_km: float) -> dict[str, float]:
    look = math.radians(90.0 - radar.depression_angle_deg)
    centre = EARTH_RADIUS_M * (incidence_of_look(look, radar.altitude_m, True) - look)
    return {one.name: one.margin for one in limits(radar, centre - 500.0 * swath_km, centre + 500.0 * swath_km)}


SENTINEL_IW2 = built((12.3, 0.821), 5.405, 693e3, 38.0, 1452.0, 62.0)
FLOWN = [
    pytest.param(SENTINEL_IW2, 85.0, id="Sentinel-1 IW2"),
    pytest.param(built((10.0, 1.0), 5.3, 785e3, 23.0, 1680.0, 37.0), 100.0, id="ERS"),
    pytest.param(built((10.7, 2.16), 1.2757, 800e3, 22.5, 1575.0, 34.0), 100.0, id="Seasat"),
    pytest.param(built((9.9, 2.9), 1.2365, 628e3, 35.0, 2000.0, 30.0), 70.0, id="PALSAR-2"),
]


@pytest.mark.parametrize(("radar", "swath_km"), FLOWN)
def test_radars_that_flew_keep_every_rule(radar: RadarConfiguration, swath_km: float) -> None:
    found = margins(radar, swath_km)
    assert set(found) == {
        *("swath against pulse rate", "gain against beam", "antenna area against ambiguities", "speed against orbit")
    }
    assert min(found.values()) > 1.0


def test_what_cannot_be_says_which_rule_and_by_how_much() -> None:
    bright = replace(SENTINEL_IW2, antenna_gain_db=55.0)
    assert margins(bright, 85.0)["gain against beam"] < 1.0
    assert margins(replace(SENTINEL_IW2, speed_m_s=100.0), 85.0)["speed against orbit"] < 0.1


@pytest.mark.parametrize("channels", [("HH", "HV"), ("HH", "HV", "VV"), ("RH", "RV")])
def test_an_antenna_is_large_enough_where_what_its_beam_lights_fits_between_pulses(channels: tuple[str, ...]) -> None:
    """At the least pulse rate: two for each transmit polarization in the length flown."""
    radar = replace(SENTINEL_IW2, channels=channels, prf_hz=3000.0)
    length, height = 12.3, 0.821 * 0.7  # of an antenna of full efficiency with this gain
    theta = radar.centre_incidence_rad
    look = math.radians(90.0 - radar.depression_angle_deg)
    slant = EARTH_RADIUS_M * math.sin(theta - look) / math.sin(look)
    lit = radar.wavelength_m / height * slant * math.tan(theta)  # depth in slant range
    in_space = math.sqrt(3.986004418e14 / (EARTH_RADIUS_M + 693e3))
    rate = 2.0 * in_space / length * len({channel[0] for channel in channels})
    centre = EARTH_RADIUS_M * (theta - look)
    (margin,) = (one.margin for one in limits(radar, centre, centre + 1.0) if "area" in one.name)
    assert margin == pytest.approx(0.5 * SPEED_OF_LIGHT_M_S / rate / lit, rel=1e-3)


def test_the_window_of_echoes_is_that_between_pulses() -> None:
    """As deep as the swath: c/2 times what the pulse leaves of the time to the next one."""
    (rule, *_) = limits(replace(SENTINEL_IW2, earth="flat", pulse_length_us=50.0), 500e3, 500e3 + 50e3)
    depth = math.hypot(550e3, 693e3) - math.hypot(500e3, 693e3)
    assert rule.margin == pytest.approx(0.5 * SPEED_OF_LIGHT_M_S * (1.0 / 1452.0 - 50e-6) / depth)


def test_a_rotating_antenna_has_no_such_rules() -> None:
    radar = RadarConfiguration(5.0, ("HH",), 30.0, 30.0, 1e3, 30.0, 3e3, scan="ppi", aperture="real")
    assert limits(radar, 0.0, 5e3) == ()


# Swath [km], bits of each of I and Q, published rate [Mbit/s]: crisp.nus.edu.sg/ers, adsabs 1976sdds.conf.....J, and
# ISPRS Archives XXXI B1 (1996), Table 2 (3 bits I and 3 bits Q). Seasat's link was analog; its rate is that of 5 bits.
RATES = [
    pytest.param(built((10.0, 1.0), 5.3, 785e3, 23.0, 1680.0, 37.0), 15.55, 100.0, 5, 105.0, id="ERS"),
    pytest.param(built((10.7, 2.16), 1.2757, 800e3, 22.5, 1647.0, 34.0), 19.0, 100.0, 5, 110.0, id="Seasat"),
    pytest.param(built((11.9, 2.4), 1.275, 568e3, 38.7, 1550.0, 35.0), 15.0, 75.0, 3, 60.0, id="JERS-1"),
]


@pytest.mark.parametrize(("radar", "bandwidth_mhz", "swath_km", "bits", "published"), RATES)
def test_the_data_rate_is_that_of_radars_that_flew(
    radar: RadarConfiguration, bandwidth_mhz: float, swath_km: float, bits: int, published: float
) -> None:
    radar = replace(radar, bandwidth_mhz=bandwidth_mhz, adc_bits=bits)
    look = math.radians(90.0 - radar.depression_angle_deg)
    centre = EARTH_RADIUS_M * (incidence_of_look(look, radar.altitude_m, True) - look)
    rate = data_rate_bit_s(radar, centre - 500.0 * swath_km, centre + 500.0 * swath_km)
    assert 1e-6 * rate == pytest.approx(published, rel=0.2)


def test_the_data_rate_counts_what_each_pulse_brings_back() -> None:
    flat = replace(SENTINEL_IW2, earth="flat", adc_bits=8, prf_hz=2400.0)
    depth = math.hypot(550e3, 693e3) - math.hypot(500e3, 693e3)
    echo_s = 2.0 * depth / SPEED_OF_LIGHT_M_S + 62e-6
    one = data_rate_bit_s(flat, 500e3, 550e3)
    assert one == pytest.approx(2 * 8 * 1.15 * 30e6 * echo_s * 2400.0)
    for channels, times in ((("HH", "HV"), 2.0), (("HH", "VV"), 1.0), (("HH", "HV", "VV"), 1.5)):
        assert data_rate_bit_s(replace(flat, channels=channels), 500e3, 550e3) == pytest.approx(times * one)
    assert data_rate_bit_s(replace(flat, adc_bits=0), 500e3, 550e3) == pytest.approx(0.5 * one)  # 4 bits


@pytest.mark.parametrize("more_db", [0.0, 2.0, 5.0])
def test_the_margin_of_the_gain_is_that_of_the_two_numbers_beside_it(more_db) -> None:
    """A beam of less than the specified gain with a margin above 1 would read as a slip."""
    radar = replace(SENTINEL_IW2, antenna_gain_db=SENTINEL_IW2.antenna_gain_db + more_db)
    (rule,) = [one for one in limits(radar, 750e3, 835e3) if one.name == "gain against beam"]
    most, specified = (float(number) for number in re.findall(r"(-?[\d.]+) dB", rule.text)[::2])
    assert rule.margin == pytest.approx(10.0 ** (0.1 * (most - specified)), rel=0.02)
