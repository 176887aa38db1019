"""The images that one run makes: which sensor of a set, on which date."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from seqrsm.campaign.engines import ENGINES, Sensor
from seqrsm.errors import ConfigurationError, Problem
from seqrsm.scattering.sigma0 import DEFAULT_SEASON
from seqrsm.sensor.radar import RadarConfiguration
from seqrsm.sensor.sets import Member, members_of
from seqrsm.simulate.visits import Visit

Settings = Mapping[str, float | str]


@dataclass(frozen=True, slots=True)
class Acquisition:
    """One image of a run.

    Attributes
    ----------
    member : str
        Name of the sensor in its set, "" where it is alone.
    engine : str
    sensor : RadarConfiguration or RadiometerConfiguration
    visit : Visit
        Its date.
    """

    member: str
    engine: str
    sensor: Sensor
    visit: Visit

    @property
    def label(self) -> str:
        """Member and day in words, "" where there is but one image."""
        day = "" if self.visit.day is None else f"day {self.visit.day:g}"
        return ", ".join(part for part in (self.member, day) if part)

    def record(self) -> dict[str, Any]:
        """What is kept with a score."""
        return {"member": self.member, "engine": self.engine, "day": self.visit.day}


def acquisitions_of(
    engine: str, settings: Settings, fixed: Settings, members: Mapping[str, Settings]
) -> tuple[Acquisition, ...]:
    """All images of a run, sensor by sensor and date by date; parameters as of `seqrsm.sensor.sets.members_of`.

    Raises
    ------
    ConfigurationError
        Parameters that contradict each other or physics, of any member; dates of some members only; a season besides
        the dates.
    """
    found = members_of(engine, settings, fixed, members)
    dated = [bool(member.dates.on) for member in found]
    if any(dated) and not all(dated):
        name = found[dated.index(False)].name
        text = f"the sensor {name} of the set has no date, others have"
        raise ConfigurationError(Problem(text, "Give first_day to all of them, or to none", field="first_day"))
    days = tuple(sorted({day for member in found for day in member.dates.on}))
    return tuple(one for number, member in enumerate(found) for one in _of_member(number, member, days))


def _of_member(number: int, member: Member, days: tuple[float, ...]) -> list[Acquisition]:
    try:
        sensor = ENGINES[member.engine].configure(member.settings, member.fixed)
    except ConfigurationError as error:
        if not member.name:
            raise
        told = (replace(p, message=f"sensor {member.name} of the set: {p.message}") for p in error.problems)
        raise ConfigurationError(*told) from error
    if not days:
        return [Acquisition(member.name, member.engine, sensor, Visit(member=number))]
    if isinstance(sensor, RadarConfiguration):
        if sensor.season != DEFAULT_SEASON or sensor.snow != "none":
            text = "the season follows from the dates"
            remedy = "Leave season and snow out, or first_day"
            raise ConfigurationError(Problem(text, remedy, field="season", value=sensor.season))
        on = dict.fromkeys(member.dates.on, sensor)
    else:
        on = {day: replace(sensor, day_of_year=day) for day in member.dates.on}
    return [
        Acquisition(member.name, member.engine, own, Visit(days, days.index(day), number)) for day, own in on.items()
    ]
