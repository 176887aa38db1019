"""Sensors by name: radars and radiometers that flew, fly or are planned, as configurations of our own.

A row of ``data/sensors.csv`` is one mode of one sensor in the terms of its makers; each value was seen at its source,
derived from others, or only recalled (``data/README.md``). Here a row becomes a radar or radiometer of ours:

* The final cell is a square: the largest of the product's range and azimuth resolution and what the pulse resolves.
  Looks grow with the area of the cell. An equivalent antenna length gives them, since bursts and spotlights do not
  resolve half their antenna.
* Incidence is at the ground; the depression angle follows over a sphere.
* Noise is that of the product: an equivalent antenna gain is set so that the noise-equivalent sigma0 at the centre of
  the scene is that of the row, or of the annotated noise at that angle. Nothing else in an image depends on the gain.
* A radiometer has the noise temperature that gives its resolution over ground of 300 K. One that looks at one incidence
  scans on a cone: its beam is round, its footprint as large as the row says, and it turns as fast. Several feeds draw
  as many lines a turn, as on a craft that is so many times slower. One that does not turn is flown as a turn so slow
  that its beam stays while it integrates. Synthesis of many angles is one of its views.
"""

from __future__ import annotations

import csv
import difflib
import fnmatch
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

from seqrsm.constants import EARTH_RADIUS_M, SPEED_OF_LIGHT_M_S
from seqrsm.sensor.earth import ground_range_of_look, ground_share, slant_range_of_ground
from seqrsm.sensor.hardware import orbit_speed_m_s
from seqrsm.sensor.radar import PHASE, RadarConfiguration
from seqrsm.sensor.radiometer import RadiometerConfiguration

_DATA: Final = Path(__file__).with_name("data")
_WORDS: Final = ("name", "mode", "kind", "status", "platform", "channels", "derived", "recalled", "sources", "notes")
_AIRCRAFT_M_S: Final = 100.0
GROUND_K: Final = 300.0
_GAIN_DB: Final = 40.0
_VIEW_DEG: Final = 40.0  # of all that a synthesis from orbit offers: that at which products are told (recalled)
_STAYS: Final = 10.0  # times the integration in which a beam that does not turn moves by its width
_AIRBORNE_NOISE_DB, _NOISE_DB = -35.0, -20.0  # assumed where nothing is known

Resting = Literal["seen", "derived", "recalled", "assumed"]


@dataclass(frozen=True, slots=True)
class NamedSensor:
    """One mode of a radar, or one channel of a radiometer."""

    name: str
    mode: str
    """Such as "Sentinel-1" and "IW GRDH"."""
    kind: str
    """Either "sar" or "radiometer"."""
    status: str
    """One of "operating", "planned" and "past"."""
    platform: str
    """One of "satellite", "aircraft" and "shuttle"."""
    channels: tuple[str, ...]
    """Sets of channels that it can record, one or another, such as "VV+VH"."""
    values: Mapping[str, float]
    """What is known, by the columns of the file, whose names tell the units."""
    derived: frozenset[str]
    recalled: frozenset[str]
    """Columns whose values were worked out, and those that were not checked at a source."""
    sources: str
    notes: str

    noise: tuple[tuple[float, float, float], ...] = ()
    """Incidence [deg], and annotated noise-equivalent sigma0 of like and cross polarization [dB] there."""

    @property
    def title(self) -> str:
        """Name and mode."""
        return f"{self.name} {self.mode}"

    @property
    def engine(self) -> str:
        """Engine that simulates it."""
        return "psm" if self.kind == "sar" else "prm"

    def resting(self, column: str) -> Resting:
        """What a value rests on."""
        if column not in self.values and column != "channels":
            return "assumed"
        return "recalled" if column in self.recalled else "derived" if column in self.derived else "seen"

    @property
    def incidences_deg(self) -> tuple[float, ...]:
        """Near edge, middle and far edge of its swath, or of the angles that it can be pointed to [deg]."""
        near, far = (self.values.get(f"incidence_{edge}_deg", 40.0) for edge in ("near", "far"))
        return (near,) if near == far else (near, 0.5 * (near + far), far)

    @property
    def conical_incidence_deg(self) -> float:
        """Incidence angle at which a radiometer looks [deg]; 0 of radars and of aircraft that sweep over many."""
        if self.kind == "sar" or (self.platform == "aircraft" and len(self.incidences_deg) > 1):
            return 0.0
        return _VIEW_DEG if self.many_views else self.incidences_deg[0]

    @property
    def many_views(self) -> bool:
        """Whether a radiometer sees each place at many angles, of which one is simulated."""
        return self.kind == "radiometer" and self.platform == "satellite" and len(self.incidences_deg) > 1

    def noise_db(self, incidence_deg: float) -> float:
        """Noise-equivalent sigma0 [dB] at an incidence angle [deg].

        As annotated, like and cross polarization averaged; else typical in the middle third of the swath and worst
        beyond, where both are known; assumed where neither is.
        """
        if self.noise:
            angles, like, cross = np.array(self.noise).T
            return float(np.interp(incidence_deg, angles, 0.5 * (like + cross)))
        known = [self.values[name] for name in ("nesz_db", "nesz_worst_db") if name in self.values]
        if not known:
            return _AIRBORNE_NOISE_DB if self.platform == "aircraft" else _NOISE_DB
        near, far = self.incidences_deg[0], self.incidences_deg[-1]
        middle = abs(incidence_deg - 0.5 * (near + far)) <= (far - near) / 6.0
        return known[0] if middle else known[-1]

    @property
    def noise_rests(self) -> Resting:
        """What the noise rests on."""
        return "seen" if self.noise else self.resting("nesz_db" if "nesz_db" in self.values else "nesz_worst_db")

    def cell_m(self, incidence_deg: float) -> float:
        """Side of the smallest square cell of the product [m]; of a radiometer, of its footprint's area."""
        if self.kind == "radiometer":
            if "effective" in self.notes:  # spread by the turn, across the direction of view
                stretch = math.sqrt(math.cos(math.radians(self.conical_incidence_deg)))
                return 1e3 * self.values["footprint_major_km"] * stretch
            return 1e3 * self.values["footprint_km"]
        along, across = self._resolutions_m(incidence_deg)
        return max(along, across, 1.001 * self._pulse_m(incidence_deg))

    def looks(self, incidence_deg: float, cell_m: float | None = None) -> float:
        """Equivalent number of independent looks in a square cell [m], by default the smallest."""
        cell = self.cell_m(incidence_deg) if cell_m is None else cell_m
        along, across = self._resolutions_m(incidence_deg)
        return max(self.values.get("looks", 1.0) * cell**2 / (along * across), 1.0)

    def _resolutions_m(self, incidence_deg: float) -> tuple[float, float]:
        across = self.values.get("resolution_range_m", self._pulse_m(incidence_deg))
        return self.values.get("resolution_azimuth_m", across), across

    def _pulse_m(self, incidence_deg: float) -> float:
        return SPEED_OF_LIGHT_M_S / (2e6 * self.values["bandwidth_mhz"] * math.sin(math.radians(incidence_deg)))

    @property
    def speed_m_s(self) -> float:
        """Ground speed [m/s]: of a circular orbit, or assumed for aircraft."""
        if self.platform == "aircraft":
            return _AIRCRAFT_M_S
        return orbit_speed_m_s(1e3 * self.values["altitude_km"])

    @property
    def calibration_sd_db(self) -> float:
        """Standard deviation of the calibration of an image [dB]; 0 where it is not known."""
        stated = self.values.get("radiometric_accuracy_db", 0.0)
        return stated / 3.0 if "3 sigma" in self.notes else stated


@lru_cache(maxsize=1)
def named_sensors() -> tuple[NamedSensor, ...]:
    """All of them, as in the file."""
    with (_DATA / "noise.csv").open(encoding="utf-8", newline="") as file:
        noise = list(csv.DictReader(file))
    with (_DATA / "sensors.csv").open(encoding="utf-8", newline="") as file:
        return tuple(_sensor(row, noise) for row in csv.DictReader(file))


def _sensor(row: Mapping[str, str], noise: Iterable[Mapping[str, str]]) -> NamedSensor:
    own = [n for n in noise if n["name"] == row["name"] and row["mode"].split()[0] == n["mode"]]
    words: dict[str, Any] = {name: row[name] for name in _WORDS}
    words |= {"channels": tuple(row["channels"].split("|"))}
    words |= {name: frozenset(row[name].split()) for name in ("derived", "recalled")}
    return NamedSensor(
        **words,
        values={name: float(text) for name, text in row.items() if name not in _WORDS and text},
        noise=tuple((float(n["incidence_deg"]), float(n["like_db"]), float(n["cross_db"])) for n in own),
    )


def sensors_called(text: str) -> tuple[NamedSensor, ...]:
    """Sensors of a name: exactly that title; else those whose title has every word, the words' beginnings enough.

    ``*`` stands for anything, as in "Sentinel-1 IW*" and "*".
    """
    wanted = " ".join(text.lower().split())
    exact = tuple(one for one in named_sensors() if one.title.lower() == wanted)
    if exact or not wanted:
        return exact
    if "*" in wanted:
        return tuple(one for one in named_sensors() if fnmatch.fnmatchcase(one.title.lower(), wanted))
    return tuple(
        one
        for one in named_sensors()
        if all(any(own.startswith(word) for own in _words(one.title)) for word in wanted.split())
    )


def _words(title: str) -> list[str]:
    """Words of a title, whole and at their hyphens and slashes."""
    words = title.lower().split()
    return words + [part for word in words for own in word.split("/") for part in (own, *own.split("-"))]


def nearest_names(text: str, others: Iterable[str] = ()) -> list[str]:
    """Names most like one that is unknown, at most three, the likest first."""
    names = [name for one in named_sensors() for name in (one.name, one.title, *one.name.split("/"))]
    known = {name.partition(" (")[0].lower(): name for name in (*names, *others)}
    return [known[near] for near in difflib.get_close_matches(text.lower(), known, n=3, cutoff=0.5)]


def to_json(sensor: NamedSensor) -> dict[str, Any]:
    """A sensor as plain values: each with its status, then its sources."""
    values = {name: {"value": value, "status": sensor.resting(name)} for name, value in sensor.values.items()}
    words = ("title", "kind", "status", "platform", "channels", "sources", "notes")
    return {**{name: getattr(sensor, name) for name in words}, "channels": list(sensor.channels), "values": values}


def noise_equivalent_db(radar: RadarConfiguration) -> float:
    """Noise-equivalent sigma0 of flat ground at the centre of the scene [dB]."""
    look = math.radians(90.0 - radar.depression_angle_deg)
    ground = ground_range_of_look(look, radar.altitude_m, radar.curved)
    slant = np.array([slant_range_of_ground(ground, radar.altitude_m, radar.curved)])
    incidence = np.array([radar.centre_incidence_rad])
    return float(10.0 * np.log10(radar.noise_equivalent_sigma0(incidence, slant, np.array([look])))[0])


def with_noise(radar: RadarConfiguration, noise_db: float) -> RadarConfiguration:
    """The same radar with the antenna gain that gives this noise-equivalent sigma0 [dB] at the centre of the scene."""
    gain = radar.antenna_gain_db + 0.5 * (noise_equivalent_db(radar) - noise_db)
    return replace(radar, antenna_gain_db=gain)


def pulses(channels: tuple[str, ...], sample_m: float, speed_m_s: float) -> dict[str, Any]:
    """Pulse rate and length: one of each transmit polarization on the way from sample to sample, and a tenth over."""
    transmit = len({channel[0] for channel in channels if channel != PHASE})
    rate = 1.1 * transmit * speed_m_s / sample_m
    return {"prf_hz": rate, "pulse_length_us": min(5.0, 0.5e6 / rate)}


def radar_of(
    sensor: NamedSensor, channels: str, incidence_deg: float, cell_m: float | None = None
) -> RadarConfiguration:
    """A named radar over a scene, at one incidence angle in its centre, with channels such as "VV+VH".

    ``cell_m``: side of the final cell; finer ones than the product's become that. ConfigurationError says that the
    radar is impossible.
    """
    own_cell = sensor.cell_m(incidence_deg)
    cell = max(cell_m or own_cell, own_cell)
    looks = sensor.looks(incidence_deg, cell)
    across = max(cell / sensor._pulse_m(incidence_deg), 1.0)
    sample = cell * min(across / looks, 1.0) * 0.999
    altitude = 1e3 * sensor.values["altitude_km"]
    look = math.asin(EARTH_RADIUS_M / (EARTH_RADIUS_M + altitude) * math.sin(math.radians(incidence_deg)))
    both = tuple(channels.split("+"))
    radar = RadarConfiguration(
        frequency_ghz=sensor.values["frequency_ghz"],
        channels=both,
        resolution_m=cell,
        bandwidth_mhz=sensor.values["bandwidth_mhz"],
        peak_power_w=sensor.values.get("peak_power_w", 1e3),
        depression_angle_deg=90.0 - math.degrees(look),
        altitude_m=altitude,
        looks=looks,
        antenna_length_m=2.0 * sample / ground_share(altitude, True),
        antenna_gain_db=_GAIN_DB,
        speed_m_s=sensor.speed_m_s,
        calibration_sd_db=sensor.calibration_sd_db,
        **pulses(both, sample, sensor.speed_m_s),
    )
    return with_noise(radar, sensor.noise_db(incidence_deg))


def radiometer_of(sensor: NamedSensor, channels: str, cell_m: float | None = None) -> RadiometerConfiguration:
    """A named radiometer over a scene: at its incidence, or its footprint as a square at nadir, line beside line.

    The rest as of `radar_of`.
    """
    known = sensor.values
    cell = max(cell_m or 0.0, sensor.cell_m(0.0))
    system_k = known["nedt_k"] * math.sqrt(1e3 * known["bandwidth_mhz"] * known["integration_time_ms"])
    made = RadiometerConfiguration(
        frequency_ghz=known["frequency_ghz"],
        channels=tuple(channels.split("+")),
        resolution_m=cell,
        integration_time_ms=known["integration_time_ms"],
        bandwidth_mhz=known["bandwidth_mhz"],
        noise_temperature_k=max(system_k - GROUND_K, 0.0),
        scan_period_s=60.0 / known["rotation_rpm"] if "rotation_rpm" in known else 2.0 * cell / sensor.speed_m_s,
        altitude_m=1e3 * known["altitude_km"],
        speed_m_s=sensor.speed_m_s / known.get("feeds", 1.0),
        conical_incidence_deg=sensor.conical_incidence_deg,
    )
    if not made.conical or "rotation_rpm" in known:
        return made
    length, width = made.footprint_m
    around_m = 2.0 * math.pi * made.reach_m(made.altitude_m)[1]
    period_s = _STAYS * 1e-3 * made.integration_time_ms * around_m / width
    return replace(made, scan_period_s=period_s, speed_m_s=length / period_s)
