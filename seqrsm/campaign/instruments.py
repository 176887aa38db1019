"""A named sensor as it would be simulated over a campaign's ground, and the optimum with one property of it.

It keeps its own noise, angles, looks, cell and dates; platform and ground are the campaign's.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from seqrsm.campaign.engines import ENGINES, Settings
from seqrsm.campaign.simulation import SimulationTask, ground_of
from seqrsm.design.factors import CategoricalFactor, span
from seqrsm.errors import ConfigurationError
from seqrsm.sensor.exchange import PROPERTIES, Sensor, as_parameters, exchanged
from seqrsm.sensor.named import NamedSensor, noise_equivalent_db, radar_of, radiometer_of
from seqrsm.sensor.radar import RadarConfiguration
from seqrsm.spec.read import CampaignSpec

_COARSER: Final = (1.0, 1.4, 2.0, 2.8, 4.0)

_NO_IMAGE: Final = {"prf_hz", "pulse_length_us", "antenna_gain_db", "peak_power", "speed_m_s", "antenna_limit_m"}


@dataclass(frozen=True, slots=True)
class Instrument:
    """Sensors and their dates, as simulated: several of a set, or one."""

    sensors: tuple[Sensor, ...]
    days: tuple[tuple[float, ...], ...]

    def task(self, task: SimulationTask) -> SimulationTask:
        """The task with these sensors in place of its own."""
        told = [
            as_parameters(sensor) | ({"days": "+".join(f"{day:.12g}" for day in days)} if days else {})
            for sensor, days in zip(self.sensors, self.days, strict=True)
        ]
        if len(told) == 1:
            return replace(task, engine=_engine(self.sensors[0]), settings=told[0], fixed={}, members={})
        engines = map(_engine, self.sensors)
        members = {f"no{k}": {**own, "engine": e} for k, (own, e) in enumerate(zip(told, engines, strict=True))}
        return replace(task, settings={"frequency": "+".join(members)}, fixed={}, members=members)


def _engine(sensor: Sensor) -> str:
    return "psm" if isinstance(sensor, RadarConfiguration) else "prm"


def instrument_of(task: SimulationTask) -> Instrument:
    """The sensors of a task."""
    made = task.acquisitions
    members = dict.fromkeys(one.member for one in made)
    own = [[one for one in made if one.member == member] for member in members]
    days = tuple(tuple(one.visit.day for one in of if one.visit.day is not None) for of in own)
    return Instrument(tuple(of[0].sensor for of in own), days)


def nearest_to(sensor: NamedSensor, base: Instrument) -> Sensor:
    """The sensor of ``base`` of the named one's kind and nearest in frequency; ConfigurationError where it has none."""
    own = [one for one in base.sensors if _engine(one) == sensor.engine]
    if not own:
        raise ConfigurationError("the optimum has no sensor of its kind")
    wanted = sensor.values["frequency_ghz"]
    return min(own, key=lambda one: abs(math.log(one.frequency_ghz / wanted)))


def middle_deg(sensor: NamedSensor) -> float:
    """Incidence angle at the middle of the swath [deg]."""
    return sensor.incidences_deg[len(sensor.incidences_deg) // 2]


def over_ground(
    sensor: NamedSensor, channels: str, own: Settings, base: Sensor, angle: float, cell_m: float | None
) -> Sensor:
    """A named ``sensor``, with one of its sets of channels, over the ground of a campaign whose own is ``base``.

    Both are of one kind. ``own`` are parameters in place of the named one's, ``angle`` is the incidence angle of a
    radar [deg], ``cell_m`` the side of the cell [m]; None: as the sensor has it.
    """
    if isinstance(base, RadarConfiguration):
        made: Sensor = exchanged(base, radar_of(sensor, channels, angle, cell_m), PROPERTIES)
    else:
        # One that sweeps does so as the campaign's.
        names = PROPERTIES if sensor.conical_incidence_deg > 0.0 else tuple(p for p in PROPERTIES if p != "angle")
        made = exchanged(base, radiometer_of(sensor, channels, cell_m), names)
    if own:
        made = ENGINES[sensor.engine].configure({**as_parameters(made), **own}, {})
    return made


def with_parameters(task: SimulationTask, own: Settings) -> Instrument:
    """The sensors of a task with some parameters in place of theirs."""
    fixed = {name: value for name, value in task.fixed.items() if name not in own}
    return instrument_of(replace(task, settings={**task.settings, **own}, fixed=fixed))


def passes(spec: CampaignSpec, sensor: NamedSensor, wanted: tuple[float, ...]) -> tuple[tuple[float, ...], int | None]:
    """Dates on which a sensor looks, and how many it offers between the first and last of those ``wanted``.

    It passes every so many days, first half of that after the season's first day, which is the mean over all
    phases; as many passes are used as the campaign would fly at most. Aircraft fly when they are wanted.
    """
    repeat = None if sensor.platform == "aircraft" else sensor.values.get("revisit_days")
    if not wanted or repeat is None:
        return wanted, None
    dates = [factor for factor in spec.factors if factor.name.rpartition(".")[2] == "dates"]
    most = max((int(span(one)[1]) for one in dates if not isinstance(one, CategoricalFactor)), default=len(wanted))
    first, last = wanted[0], wanted[-1]
    days = np.arange(first + 0.5 * repeat, max(last, first + 0.5 * repeat) + 1e-9, repeat)
    kept = days[np.unique(np.linspace(0, len(days) - 1, min(most, len(days))).round().astype(int))]
    return tuple(float(day) for day in kept), len(days)


def cells_of(spec: CampaignSpec, sensor: NamedSensor, base: Sensor) -> list[float]:
    """Sides of the cell to choose from [m]: the campaign's, at least the sensor's; several where it is a factor."""
    own = sensor.cell_m(middle_deg(sensor))
    factor = next((f for f in spec.factors if f.name.rpartition(".")[2] == "resolution"), None)
    if factor is None or isinstance(factor, CategoricalFactor):
        return [max(own, base.resolution_m)]
    low, high = span(factor)
    return [size for size in (max(own, low) * more for more in _COARSER) if size <= max(high, own)]


def mixtures(base: Instrument, other: Instrument) -> Iterator[tuple[str, Instrument]]:
    """``base`` with one property of ``other``, for each in which they differ and that can be built.

    Sets of equally many are taken member by member; else all of ``base`` take the property of the first of ``other``.
    """
    sensor, days, alike = other.sensors[0], other.days[0], len(other.sensors) == len(base.sensors)
    theirs = other.sensors if alike else (sensor,) * len(base.sensors)
    for name in PROPERTIES:
        if name == "angle" and not isinstance(sensor, RadarConfiguration):
            continue  # an orbit's speed would smear what the campaign's scan does not
        try:
            sensors = tuple(
                exchanged(one, own, (name,)) if type(one) is type(own) else one  # type: ignore[type-var]
                for one, own in zip(base.sensors, theirs, strict=True)
            )
        except ConfigurationError:
            continue
        if name == "frequency" and not alike:
            sensors = sensors[:1]  # one band in place of a set
        mixed = Instrument(sensors, base.days[: len(sensors)])
        if _facts(mixed) != _facts(base):
            yield name, mixed
    if days and any(own != days for own in base.days):
        yield "dates", Instrument(base.sensors, tuple(days for _ in base.days))


def examine(instrument: Instrument, task: SimulationTask) -> None:
    """Refuse what cannot be simulated over the task's scene, with the reason."""
    task = instrument.task(task)
    scene, _ = ground_of(task)
    for one in task.acquisitions:
        ENGINES[one.engine].examine(scene, one.sensor, task.scattering(one.engine), one.visit.day)


def _facts(instrument: Instrument) -> list[dict[str, Any]]:
    """What images are made of, to six digits: the noise in place of pulses, power and gain."""
    found: list[dict[str, Any]] = []
    for sensor in instrument.sensors:
        told = {name: value for name, value in as_parameters(sensor).items() if name not in _NO_IMAGE}
        noise = round(noise_equivalent_db(sensor), 5) if isinstance(sensor, RadarConfiguration) else 0.0
        found.append({**rounded(told), "noise": noise})
    return found


def rounded(settings: Settings) -> dict[str, float | str]:
    """Settings to six digits, by which they are known again."""
    return {name: float(f"{x:.6g}") if isinstance(x, float) else x for name, x in settings.items()}


def as_factors(spec: CampaignSpec, sensor: NamedSensor, channels: str) -> dict[str, float | str]:
    """What a named sensor says of the factors, at the middle of its swath and in a cell that the region holds."""
    numeric = [factor for factor in spec.factors if not isinstance(factor, CategoricalFactor)]
    low = next((span(factor)[0] for factor in numeric if factor.name == "resolution"), None)
    is_radar = sensor.kind == "sar"
    made = radar_of(sensor, channels, middle_deg(sensor), low) if is_radar else radiometer_of(sensor, channels, low)
    told = as_parameters(made)
    for factor in spec.factors:
        if factor.name == "polarization" and isinstance(factor, CategoricalFactor):
            own = set(channels.split("+"))
            told["polarization"] = next((x for x in factor.levels if set(x.split("+")) == own), channels)
    return {name: told[name] for name in spec.region.names if name in told}


def place_in_swath(place: Instrument) -> dict[str, Any]:
    """Where in the swath, and with which cell, looks and noise."""
    sensor = place.sensors[0]
    found: dict[str, Any] = {"cell_m": sensor.resolution_m}
    if isinstance(sensor, RadarConfiguration):
        theta = np.array([sensor.centre_incidence_rad])
        found["incidence_deg"] = float(np.rad2deg(theta[0]))
        found["looks"] = float(sensor.looks_used(theta)[0])
        found["noise_db"] = noise_equivalent_db(sensor)
    elif sensor.conical:
        found |= {"incidence_deg": sensor.conical_incidence_deg, "footprint_m": list(sensor.footprint_m)}
    return found
