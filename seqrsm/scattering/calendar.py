"""The calendar of the ground: how the backscatter of covers goes through the year, and how long a field stays itself.

A table's level is that of the growing season; the calendar gives the course about it. In C band the course is measured
by month (`data/calendar_c_band.csv`, several sites, about each site's own mean of May to August). In L band, where no
season was measured, it is a water cloud over the table's bare soil,

    sigma0(d) = canopy (1 - T(d)) + soil T(d),    T(d) = exp(-2 b W(d) / cos theta),

with the water W of the day (`data/calendar_canopy.csv`), b = 0.15 f / 1.4 GHz (grass 0.20), and the canopy's own return
such that the mean of 22 June to 19 July, when the two L-band flights took place, is the table's level. Between L and C
band the course is linear in the logarithm of frequency; X and Ku bands follow C band, cereals to 0.7 and 0.5 of it
(assumed). A radiometer sees the same canopy, and the same fields early and late.

Fields of a cover differ by a lasting departure, one that fades within weeks, and the days by which they are early or
late (`data/calendar_fields.csv`). All dates see the same draw of them. Where crops leave soil bare, nothing but their
mean course tells one from the other, or from bare ground: they depart from it as one soil, differ between fields alike,
and feel its moisture by the soil's part of the echo: in L band that of the water cloud, from C band on the part of the
ground that is bare (assumed). All this is of Europe: elsewhere it may come some days later, and covers may have a
course of the user's own.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from seqrsm.arrays import BoolArray, FloatArray
from seqrsm.errors import Problem, ScatteringDataError
from seqrsm.scattering.longtable import Node, in_order, read_nodes, refuse, stated, weights_of_nodes
from seqrsm.scattering.readers import COVER, Row, shipped_rows
from seqrsm.scattering.worlds import BARE_SOIL, World, course_deviation, default_mean_sd, over_soil, related_covers

DAYS: Final[FloatArray] = np.arange(1.0, 366.0)
"""Days of the year for which a course is given."""

_MID_MONTH: Final = np.array([16, 45, 75, 105, 136, 166, 197, 228, 258, 289, 319, 350], dtype=np.float64)
_SUMMER: Final = slice(4, 8)  # May to August
_SUMMER_DAYS: Final = slice(120, 243)
_FLIGHTS: Final = slice(172, 200)  # 22 June to 19 July
_L_GHZ, _C_GHZ, _X_GHZ, _KU_GHZ = 1.25, 5.4, 9.6, 13.6
_B_GHZ: Final = 1.4
_B_M2_KG: Final = {"grass": 0.20}  # of ECMWF's CMEM; crops have 0.15
_THETA_DEG: Final = 40.0
_HELD_DEG: Final = (20.0, 60.0)
_TILT_DB_PER_DEG: Final = 0.28  # bare soil falls by 0.4 dB a degree, a closed canopy by 0.12
_CANOPY_LEAST: Final = 0.3  # of the level: more is not laid on the soil
_C_SD_DB, _CEREAL_SD_DB, _X_SD_DB = (1.0, 1.2), 2.0, 2.5
_BARE_FIELDS_DB: Final = (1.9, 1.6)
"""HH and VV, HV: maize, soybean, sunflower, barley and wheat of western France, lasting and seasonal.

Of the whole year, canopies and all, but over 5 degrees of latitude: assumed to hold for bare fields of one scene in all
bands. Potato parcels of Flevoland, bare or ridged, have 2 to 3.4 dB.
"""
_OCTAVE: Final = 2.0  # beyond its nodes a user's course is held so far, and not known further
_AS_ASSUMED: Final = "Vegetables"  # how fields of a cover that is not in the shipped calendar keep theirs
_EVEN_DAYS: Final[FloatArray] = np.full(DAYS.size, 1.0 / DAYS.size)


@dataclass(frozen=True, slots=True)
class Fields:
    """How the fields of a cover keep the calendar."""

    group: str
    """One of "cereal", "broadleaf", "grass", "even" and "soil": kind of the crop; the same all year where "even" or
    bare "soil"."""
    lasting_share: tuple[float, float]
    """Share of the variance between fields that stays for the year, of HH and VV, and of HV."""
    memory_days: tuple[float, float]
    """In which the rest falls to 1/e of itself [d]."""
    shift_days: float
    """By which fields are early or late, standard deviation [d]."""
    level_water_kg_m2: float
    """Water with which the L-band level was measured [kg/m2]; nan: the canopy's own of that time of the year."""


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """One channel of some categories through the year."""

    change_db: FloatArray
    """(n_categories, 365): backscatter of the day at 40 degrees less the table's level [dB]."""
    tilt_db_per_deg: FloatArray
    """(n_categories, 365): what a degree of incidence angle beyond 40 adds to it [dB]; the angle is held at 20 and
    60."""
    closed: FloatArray
    """(n_categories, 365): share of the soil that is hidden, 1 of covers without a course, 0 of bare soil."""
    soil_share: FloatArray
    """(n_categories, 365): part of the echo that is bare soil's at 40 degrees."""
    sd_db: FloatArray
    """(n_categories, 365): standard deviation of the course about that of a given ground [dB]."""
    lasting_share: FloatArray
    memory_days: FloatArray
    shift_days: FloatArray
    """(n_categories,): see `Fields`."""
    even: BoolArray
    """(n_categories,): covers that neither are bare soil nor have a course."""

    def at_angles(self, day: float, theta_deg: FloatArray) -> FloatArray:
        """Change of each category on a day [dB], (n_categories, n), at incidence angles (n,) [deg]."""
        beyond = np.clip(theta_deg, *_HELD_DEG) - _THETA_DEG
        return np.asarray(on_day(self.change_db, day)[:, None] + on_day(self.tilt_db_per_deg, day)[:, None] * beyond)


def on_day(year: FloatArray, day: float | FloatArray) -> FloatArray:
    """Values (...) or (..., n) on a day or days (n,) of what is given on `DAYS` (..., 365).

    Straight lines between, one year as the next.
    """
    within = np.remainder(day, DAYS.size)
    before = np.floor(within).astype(np.intp)  # day 0 is the last of the year before
    lower, upper = year[..., before - 1], year[..., before % DAYS.size]
    return np.asarray((upper - lower) * (within - before) + lower)


def bare_fields_db(channel: str, world: World | None) -> float:
    """Standard deviation between fields of bare soil, whatever their crop, in a world [dB]."""
    return _BARE_FIELDS_DB[channel == "HV"] * (world.field_factor(BARE_SOIL) if world is not None else 1.0)


@lru_cache(maxsize=64)
def level_days(frequency_ghz: float) -> FloatArray:
    """Weights (365,) of the days for which the tables' levels hold: the L-band flights', May to August from C band."""
    share, weights = share_of_c(frequency_ghz), np.zeros(DAYS.size)
    weights[_FLIGHTS] += (1.0 - share) / (_FLIGHTS.stop - _FLIGHTS.start)
    weights[_SUMMER_DAYS] += share / (_SUMMER_DAYS.stop - _SUMMER_DAYS.start)
    return weights


class OwnCourse(NamedTuple):
    """A user's course of a cover in a channel: at n rising frequencies what the day adds to the table, (n, 365).

    In decibels of sigma0 or in emissivity [1], as its standard deviation (n,) about that of a given ground.
    """

    frequency_ghz: tuple[float, ...]
    change: FloatArray
    mean_sd: FloatArray
    note: str


@dataclass(frozen=True, slots=True, eq=False)
class Calendar:
    """The calendar of some ground, made by `load_calendar`.

    ``own``: courses of the user's ``file`` ("": none) by category, and in it by channel: HH, HV, VV of sigma0, H, V of
    emissivity. ``late_days``: by which the shipped courses come later on this ground than in Europe [d].
    """

    own: Mapping[str, Mapping[str, OwnCourse]] = field(default_factory=dict)
    late_days: int = 0
    file: str = ""

    def course(
        self,
        categories: tuple[str, ...],
        kin: Mapping[str, str],
        frequency_ghz: float,
        channel: str,
        level_db: FloatArray,
        soil_db: float,
        world: World | None,
    ) -> Course:
        """Course of the backscatter of categories through the year, departing as in a world.

        ``kin``: class by category, and of bare soil, as of `World.departure`. ``level_db`` (n_categories,) and
        ``soil_db``: the table's sigma0 of them and of bare soil at 40 degrees [dB]. ScatteringDataError tells of
        categories without a calendar, or without rows in the user's.
        """
        rows, cross = self._fields(categories), int(channel == "HV")
        years, bare_sd = np.empty((5, len(rows), DAYS.size)), _sd_db("soil", frequency_ghz, cross)
        for k, (name, row) in enumerate(zip(categories, rows, strict=True)):
            days, late, closed = level_days(frequency_ghz), self.late_days, self._closed(name)
            change, tilt, sd, soil_share = 0.0 * DAYS, 0.0 * DAYS, 0.0 * DAYS, 1.0 - closed
            if name in self.own:
                change, of_course = self._of_own(name, frequency_ghz, channel)
                days, late, sd = _EVEN_DAYS, 0, sd + of_course
            elif row.group != "even":
                sd = closed * _sd_db(row.group, frequency_ghz, cross) + (1.0 - closed) * bare_sd
                if row.group != "soil":
                    change, soil_share = _course_db(name, row, frequency_ghz, channel, soil_db - level_db[k])
                    tilt = -_TILT_DB_PER_DEG * (closed[_FLIGHTS].mean() - closed)
            if world is not None:
                own, soil = (world.season(one, kin[one], frequency_ghz, channel, days) for one in (name, BARE_SOIL))
                change = change + sd * over_soil(own, soil, closed, related_covers(kin[name], kin[BARE_SOIL]))
            years[:, k] = np.roll([change, tilt, closed, soil_share, sd * course_deviation(days)], late, axis=1)
        changes, tilts, closeds, shares, sds = years
        even = np.array([row.group == "even" for row in rows])
        kept = [(row.lasting_share[cross], row.memory_days[cross], row.shift_days) for row in rows]
        lasting, memory, shift = np.array(kept).reshape(-1, 3).T
        return Course(changes, tilts, closeds, shares, sds, lasting, memory, shift, even)

    def closed(self, category: str, day: float) -> float:
        """Share of the soil that a cover hides on a day; 1 where even, or with a user's course; 0 of bare soil."""
        return float(on_day(self._closed(category), day - self.late_days))

    def canopy_share(self, category: str, day: float) -> float:
        """Water of a cover's canopy on a day over that of the growing season; 1 where even, or with a user's course."""
        self._fields((category,))
        water = _canopy(category)[0]
        if category in self.own or not water.any():
            return 1.0
        return float(on_day(water, day - self.late_days)) / _season_water(category)

    def emission_changes(self, category: str) -> bool:
        """Whether a cover's emission has a course through the year."""
        return category in self.own or bool(np.ptp(_canopy(category)[0]) > 0.0)

    def shift_days(self, categories: tuple[str, ...]) -> FloatArray:
        """Days by which fields of categories are early or late, standard deviation (n_categories,)."""
        return np.array([row.shift_days for row in self._fields(categories)])

    def emission(self, category: str, frequency_ghz: float, polarization: str, day: float) -> tuple[float, float]:
        """What the user's course adds to a cover's emissivity on a day, and its standard deviation; 0 without one."""
        if category not in self.own:
            return 0.0, 0.0
        change, sd = self._of_own(category, frequency_ghz, polarization)
        return float(on_day(change, day)), sd

    def notes(self, categories: tuple[str, ...], channel: str) -> tuple[str, ...]:
        """What the user's courses of a channel rest on, and by how much the shipped ones are moved."""
        when = f"{abs(self.late_days)} days {'later' if self.late_days > 0 else 'earlier'}"
        moved = [f"the built-in calendar of crops comes {when} (as configured)"] if self.late_days else []
        return *moved, *(self.own[name][channel].note for name in dict.fromkeys(categories) if name in self.own)

    def _closed(self, category: str) -> FloatArray:
        """See `closed`, through a year that is not late (365,)."""
        even = category != BARE_SOIL and (category in self.own or not has_course(category))
        return np.ones(DAYS.size) if even else _canopy(category)[1]

    def _fields(self, categories: tuple[str, ...]) -> list[Fields]:
        """How fields of covers keep the calendar; a user's course of a cover that has no other, as another crop's."""
        known = dict(fields_by_category())
        known |= {name: known[_AS_ASSUMED] for name in self.own if not has_course(name)}
        remedy = f"Leave first_day out, or add its rows to a [simulator] calendar; known: {', '.join(known)}"
        if missing := [name for name in dict.fromkeys(categories) if name not in known]:
            text, file = "no calendar of this category", self.file or None
            told = {missing[-1]: remedy}
            raise ScatteringDataError(
                *(Problem(text, told.get(name, ""), file, field=COVER, value=name) for name in missing)
            )
        return [known[name] for name in categories]

    def _of_own(self, category: str, frequency_ghz: float, channel: str) -> tuple[FloatArray, float]:
        """A user's course (365,) and its standard deviation, linear in the logarithm of frequency."""
        course = self.own[category].get(channel)
        nodes = course.frequency_ghz if course else ()
        if course is None or not nodes[0] / _OCTAVE <= frequency_ghz <= nodes[-1] * _OCTAVE:
            text = f"the calendar has no {channel} of {category} within an octave of {frequency_ghz:g} GHz"
            raise ScatteringDataError(text, "Add its rows", file=self.file, field="polarization", value=channel)
        weights = weights_of_nodes(nodes, frequency_ghz)
        return weights @ course.change, float(weights @ course.mean_sd)


SHIPPED: Final = Calendar()  # of Europe


def load_calendar(path: str | Path | None, late_days: int = 0) -> Calendar:
    """The shipped calendar, moved by some days, and the courses of a user's file in place of its own.

    The columns of ``path`` are in `seqrsm.scattering.longtable`. Where it states no standard deviation that of assumed
    emissivity, or of sigma0 that of closed cereals, the largest shipped, is taken. ScatteringDataError tells all wrong
    rows.
    """
    problems: list[Problem] = []
    groups: dict[tuple[str, str], dict[float, list[Node]]] = defaultdict(lambda: defaultdict(list))
    for node in read_nodes(path, None) if path else ():
        groups[node.category, node.channel][node.frequency_ghz].append(node)
    own: dict[str, dict[str, OwnCourse]] = defaultdict(dict)
    for (category, channel), blocks in groups.items():
        change, sds = [], []
        for ghz, block in sorted(blocks.items()):
            year = in_order(block, f"{category}, {ghz:g} GHz, {channel}", problems, "day") or block[:1]
            place, value = np.array([(node.place, node.value) for node in year]).T
            change.append(np.interp(DAYS, place, value, period=float(DAYS.size)))
            radar = len(channel) == 2
            assumed = _sd_db("cereal", ghz, 0) if radar else default_mean_sd("emissivity", "", "", ghz, channel)
            sds.append(stated(block, "mean_sd", lambda node: node.channel).get(channel, assumed))
        rows = [node.row for block in blocks.values() for node in block]
        sources = "; ".join(sorted({f"{row.text('status')}: {row.text('source')}" for row in rows}))
        like = "" if has_course(category) else f"; fields as those of {_AS_ASSUMED} (assumed)"
        note = f"{category} {channel}: course of {Path(rows[0].file).name} ({sources}){like}"
        own[category][channel] = OwnCourse(tuple(sorted(blocks)), np.array(change), np.array(sds), note)
    refuse(problems, path or "")
    return Calendar(own, late_days, str(path or ""))


def has_course(category: str) -> bool:
    """Whether a cover changes through the year in the shipped calendar."""
    return category in fields_by_category() and fields_by_category()[category].group not in ("even", "soil")


def season_depth(category: str, frequency_ghz: float) -> float:
    """Optical depth [Np], at the vertical, of a canopy in the growing season, when the tables' levels hold.

    0 of a cover whose water is not known.
    """
    return _depth(fields_by_category()[category].group, frequency_ghz) * _season_water(category)


def _depth(group: str, frequency_ghz: float) -> float:
    """Optical depth at the vertical of a kilogram of water on a square metre [Np m2/kg]."""
    return _B_M2_KG.get(group, 0.15) * frequency_ghz / _B_GHZ


def _season_water(category: str) -> float:
    """Water of a canopy [kg/m2] when the L-band levels were measured."""
    level = fields_by_category()[category].level_water_kg_m2
    return float(_canopy(category)[0][_FLIGHTS].mean()) if math.isnan(level) else level


@lru_cache(maxsize=1)
def fields_by_category() -> dict[str, Fields]:
    """What `data/calendar_fields.csv` holds."""

    def pair(row: Row, name: str) -> tuple[float, float]:
        return float(row.text(f"{name}_co")), float(row.text(f"{name}_cross"))

    return {
        row.text("category"): Fields(
            row.text("group"),
            pair(row, "lasting_share"),
            pair(row, "memory_days"),
            float(row.text("shift_days")),
            float(row.text("level_water_kg_m2") or "nan"),
        )
        for row in shipped_rows("calendar_fields.csv")
    }


def _course_db(
    category: str, fields: Fields, frequency_ghz: float, channel: str, soil_db: float
) -> tuple[FloatArray, FloatArray]:
    """Course of one cover [dB], and the part of its echo that is bare soil's, (365,) each.

    ``soil_db``: bare soil over the cover's level.
    """
    at_c = _c_band_db(category, "HV" if channel == "HV" else "VV")
    if channel == "HH" and fields.group == "cereal":
        at_c = np.where(at_c < 0.0, 0.5 * at_c, at_c)
    if fields.group == "cereal":
        at_c = at_c * np.interp(math.log(frequency_ghz), np.log([_C_GHZ, _X_GHZ, _KU_GHZ]), [1.0, 0.7, 0.5])
    share, (water, closed) = share_of_c(frequency_ghz), _canopy(category)
    if share == 1.0:
        return at_c, 1.0 - closed
    rate = 2.0 * _depth(fields.group, frequency_ghz) / math.cos(math.radians(_THETA_DEG))
    through = np.exp(-rate * water)
    at_level = math.exp(-rate * fields.level_water_kg_m2)
    reference = float(through[_FLIGHTS].mean()) if math.isnan(at_level) else at_level
    soil = min(10.0 ** (0.1 * soil_db), (1.0 - _CANOPY_LEAST) / reference)
    own = (1.0 - soil * reference) / (1.0 - reference)
    of_soil = soil * through
    power = own * (1.0 - through) + of_soil
    change = share * at_c + (1.0 - share) * 10.0 * np.log10(power)
    return change, share * (1.0 - closed) + (1.0 - share) * of_soil / power


def share_of_c(frequency_ghz: float) -> float:
    """Where a frequency lies from L band, 0, to C band and beyond, 1."""
    return float(np.clip(math.log(frequency_ghz / _L_GHZ) / math.log(_C_GHZ / _L_GHZ), 0.0, 1.0))


@lru_cache(maxsize=64)
def _c_band_db(category: str, channel: str) -> FloatArray:
    """Course (365,) in C band [dB]: mean over sites, straight lines between the middles of the months."""
    every = shipped_rows("calendar_c_band.csv")
    rows = [r for r in every if (r.text("category"), r.text("polarization")) == (category, channel)]
    months = np.array([[float(r.text(f"month_{m}_db")) for m in range(1, 13)] for r in rows])
    own = months - months[:, _SUMMER].mean(axis=1, keepdims=True)
    source = np.array([r.text("source") for r in rows])
    mean = np.mean([own[source == name].mean(axis=0) for name in np.unique(source)], axis=0)
    return np.asarray(np.interp(DAYS, _MID_MONTH, mean, period=365.0))


def _sd_db(group: str, frequency_ghz: float, cross: int) -> float:
    """Standard deviation of a closed cover's course about that of a given ground, or of bare soil's [dB].

    What sites differ by in C band. Assumed: the same in L band (water clouds leave 1.6 to 3.3 dB of SMAPVEX12's fields,
    but fields of one crop and day differ by as much); 2.5 dB in X band and above.
    """
    at_c = _CEREAL_SD_DB if group == "cereal" else _C_SD_DB[cross]
    return float(np.interp(math.log(frequency_ghz), np.log([_C_GHZ, _X_GHZ]), [at_c, _X_SD_DB]))


@lru_cache(maxsize=64)
def _canopy(category: str) -> tuple[FloatArray, FloatArray]:
    """Water of the canopy [kg/m2] and share of the ground covered, (365,) each; bare where nothing is known."""
    rows = [r for r in shipped_rows("calendar_canopy.csv") if r.text("category") == category]
    if not rows:
        return np.zeros(DAYS.size), np.zeros(DAYS.size)
    day, water, cover = (np.array([float(r.text(n)) for r in rows]) for n in ("day", "water_kg_m2", "cover_fraction"))
    return np.interp(DAYS, day, water, period=365.0), np.interp(DAYS, day, cover, period=365.0)
