"""The table of backscatter: sigma0(category, frequency, polarization, incidence angle, season), RSL TR 380-1 3.2.2.3.

Rules of interpolation, with their measured errors over the published formulas: linear in dB over a 1-degree grid of
incidence angle (0.12 dB at most), linear in dB over the logarithm of frequency between nodes: 1.2 dB rms half-way, and
towards either node as a parabola to 0, as of a curve of even bend (assumed). Extrapolation reaches at most one octave
and is assumed: below the lowest node the first slope goes on, above the highest half the slope of the straight line
through all nodes, since canopies and rough ground saturate; its error grows by 2.4 dB an octave. Within a tenth of an
octave of a node a value rests on what that node rests on.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.errors import ScatteringDataError
from seqrsm.scattering.calendar import SHIPPED, Calendar, Course, on_day
from seqrsm.scattering.coherence import Relation
from seqrsm.scattering.curves import (
    MOISTURE_FELT,
    THETA_DEG,
    Curve,
    limit_db,
    moisture_change_db,
    shipped_curves,
    weakest,
)
from seqrsm.scattering.longtable import read_long_table
from seqrsm.scattering.readers import POLARIZATIONS, for_each, shipped_rows, unknown_covers
from seqrsm.scattering.seasons import Snow, seasonal_curves, under_snow
from seqrsm.scattering.variability import (
    ROUGHNESS_NOTE,
    UNKNOWN,
    FieldSpread,
    Variability,
    alike_at_nadir,
    shipped_variability,
)
from seqrsm.scattering.worlds import BARE_SOIL, OWN, World, co_apart, default_mean_sd, over_soil, related_covers
from seqrsm.units import db_to_linear, linear_to_db

DEFAULT_SEASON: Final = "spring_summer"

INTERPOLATION_SD_DB: Final = 1.2
"""Error of sigma0 half-way between node frequencies [dB rms], from predicting S band by L and C (60 cases)."""

_EXTRAPOLATION_SD_DB: Final = 2.4  # an octave beyond the nodes; assumed: twice the interpolation's
_APART: Final = co_apart(THETA_DEG)
_OCTAVE: Final = 2.0
_AT_NODE_OCTAVES, _BESIDE_NODE_OCTAVES = 0.01, 0.1
_BARE_NOTE: Final = (
    "ground that is bare or under snow departs from the table, and feels moisture, as bare soil does (under snow: "
    "assumed)"
)
_LEVEL_DEG = 40
_ABOVE_SNOW: Final = ("Trees", "Buildings")


@dataclass(frozen=True, slots=True, eq=False)
class Sigma0Lookup:
    """Backscatter of some categories for one channel."""

    categories: tuple[str, ...]
    """The categories asked for."""
    theta_deg: FloatArray
    """(91,): incidence angles 0, 1, ..., 90 [deg]."""
    sigma0: FloatArray
    """(n_categories, 91): mean backscatter coefficient, linear [1]."""
    field_sd_db: FloatArray
    date_sd_db: FloatArray
    """(n_categories,): standard deviation from field to field, and from date to date common to all fields of the
    category [dB]."""
    mean_sd_db: FloatArray
    """(n_categories,): standard deviation of the mean about that of a given ground [dB], interpolation in frequency
    included."""
    channel_correlation: float
    """Correlation of the field-to-field draws of two channels."""
    status: tuple[str, ...]
    """What each category rests on."""
    notes: tuple[str, ...]
    """Every source and assumption used, one a line."""
    roughness_share: FloatArray
    """(n_categories,): part of the standard deviation from field to field that is owed to roughness, at 40 deg; 0 but
    for bare soil."""
    closed: FloatArray
    """(n_categories,): share of the soil that is hidden; what is not, or is under snow, departs as bare soil does."""
    nadir_sd_db: FloatArray
    """(n_categories,): as ``field_sd_db`` without roughness, at nadir, where HH and VV have the mean of both."""
    course: Course | None = None
    """How the categories go through the year, where a day was asked for."""

    def of_fields_db(self, theta_deg: float) -> tuple[FloatArray, FloatArray]:
        """Standard deviations (n_categories,) between fields at an incidence angle [deg] that add in squares [dB].

        Of what each frequency, angle and date sees more or less apart, and of the roughness of bare soil, which all of
        them see alike; this grows with the sine of the angle, that goes from `nadir_sd_db` to its own at 40 deg.
        """
        apart = float(co_apart(theta_deg))
        sine = math.sin(math.radians(theta_deg)) / math.sin(math.radians(_LEVEL_DEG))
        smooth = self.field_sd_db * np.sqrt(1.0 - np.square(self.roughness_share))
        return apart * smooth + (1.0 - apart) * self.nadir_sd_db, self.field_sd_db * self.roughness_share * sine


@dataclass(frozen=True, slots=True, eq=False)
class Sigma0Table:
    """All curves and variabilities; made by `load_sigma0_table`."""

    curves: Mapping[tuple[str, str], Curve]
    """Curve by (category, season)."""
    variability: Mapping[tuple[str, str], Variability]
    """Variability by (category, polarization)."""
    channel_correlation: float
    """Correlation of the field-to-field draws of two channels."""
    file: str = ""
    """The user's file, or "" for the shipped table."""
    relations: Mapping[str, Sequence[Relation]] = field(default_factory=dict)
    """How HH and VV of the user's categories are related, where the file says so."""
    world: World | None = None
    """The world whose means are looked up; None: the table's own."""
    calendar: Calendar = SHIPPED
    """Of the ground."""

    def in_world(self, world: World | None) -> Sigma0Table:
        """The table with its means and field spreads as a world has them; None: as they stand."""
        return replace(self, world=world)

    @property
    def categories(self) -> tuple[str, ...]:
        """Names of all categories."""
        return tuple(dict.fromkeys(category for category, _ in self.curves))

    def lookup(
        self,
        categories: Sequence[str],
        frequency_ghz: float,
        polarization: str,
        *,
        season: str = DEFAULT_SEASON,
        wind_m_s: float = 5.0,
        soil_moisture: float = 0.2,
        snow: Snow = "none",
        snow_depth_cm: float = 15.0,
        day: float | None = None,
    ) -> Sigma0Lookup:
        """Backscatter of ``categories``, repeats allowed, for one channel: HH, HV, VH (the same as HV) or VV.

        Parameters
        ----------
        frequency_ghz : float
            At most one octave beyond a category's nodes [GHz].
        wind_m_s : float
            Wind at 10 m [m/s], which only water feels: 2 to 10.
        soil_moisture : float
            Volumetric moisture [m^3/m^3]: 0 to 0.6, effective from 0.04 to 0.45. Bare soil feels it and, on a day or
            out of the growing season, other covers by the part of their echo that is bare soil's.
        snow, snow_depth_cm : {"none", "dry", "wet"}, float
            Snow on everything but trees and buildings, whose echo comes from above it, and its depth >= 0 [cm].
        day : float or None
            Day of the year on which the covers are met, one year as the next; None: in the middle of ``season``.

        Raises
        ------
        ScatteringDataError
            Unknown category, season, polarization, or a frequency or wind out of range: all at once.
        """
        channel = "HV" if polarization == "VH" else polarization
        if channel not in POLARIZATIONS:
            remedy = f"One of: {', '.join(POLARIZATIONS)}"
            raise ScatteringDataError("no such polarization", remedy, field="polarization", value=polarization)
        frequency = float(frequency_ghz)
        state = _State(frequency, float(wind_m_s), float(soil_moisture), snow, 0.01 * float(snow_depth_cm))
        unknown = unknown_covers("backscatter", self.categories, self.file, categories)
        usual = day is None and (season, snow) == (DEFAULT_SEASON, "none")
        world = self.world if usual else None  # else it departs by the part of a cover that is closed
        found = for_each(categories, lambda name: _evaluate(self._curve(name, season), channel, state, world), unknown)
        names = tuple(categories)
        value = np.array([found[name].value_db for name in names]).reshape(-1, THETA_DEG.size)
        sd = np.array([found[name].mean_sd_db[_LEVEL_DEG] for name in names])
        closed = np.array([found[name].closed for name in names])
        # Part that spreads as the table has it: of bare soil all, but on a day none, when all that is bare is one soil.
        own_spread, through = closed, None
        if not usual:
            value, sd, closed, through = self._over_soil(names, found, channel, state, season, day)
        if through:
            own_spread = closed
        spread = {name: self.variability.get((name, channel), UNKNOWN) for name in found}
        soil = np.array([found[name].soil for name in names])
        of_fields = FieldSpread(self.variability, names, frequency, soil, own_spread, day is not None, self.world)
        field_sd, rough = of_fields.spread_db(channel)
        soil_sd = self.variability[BARE_SOIL, channel].date_sd_db
        return Sigma0Lookup(
            categories=names,
            theta_deg=THETA_DEG,
            sigma0=db_to_linear(value),
            field_sd_db=field_sd,
            date_sd_db=own_spread * [spread[name].date_sd_db for name in names] + (1.0 - own_spread) * soil_sd,
            mean_sd_db=sd,
            channel_correlation=self.channel_correlation,
            status=tuple(found[name].status for name in names),
            roughness_share=rough,
            nadir_sd_db=of_fields.nadir_db(channel),
            notes=(
                *(f"{name}: {note}" for name, item in found.items() for note in item.notes),
                *(f"{name} {channel}: {own.note}" for name, own in spread.items()),
                *(f"{name}: {ROUGHNESS_NOTE}" for name, item in found.items() if item.soil),
                f"correlation of the field-to-field draws of two channels: {self.channel_correlation:g} "
                "(computed: flevoland)",
                *(self.calendar.notes(names, channel) if through else ()),
                *((_BARE_NOTE,) if not through and (closed < 1.0).any() else ()),
            ),
            closed=closed,
            course=through,
        )

    def _over_soil(
        self,
        names: tuple[str, ...],
        found: Mapping[str, _Found],
        channel: str,
        state: _State,
        season: str,
        day: float | None,
    ) -> tuple[FloatArray, FloatArray, FloatArray, Course | None]:
        """Values (n, 91) [dB] and standard deviations (n,) of means, from those of no world; part that is closed (n,).

        Of a season, or on a day, with the course to it. A world departs from them by the part of covers that are
        closed, and of bare soil.
        """
        of_soil = self.curves.get((BARE_SOIL, season)) or _shipped_table().curves[BARE_SOIL, season]
        at_reference = state._replace(soil_moisture=of_soil.reference_moisture)
        met, soil = (_evaluate(of_soil, channel, one, None) for one in (state, at_reference))
        kin = {name: item.kin for name, item in found.items()} | {BARE_SOIL: soil.kin}
        value = np.array([found[name].value_db for name in names]).reshape(-1, THETA_DEG.size)
        closed = np.array([0.0 if name == BARE_SOIL else found[name].closed for name in names])
        ghz, through, of_course = state.frequency_ghz, None, np.zeros(len(names))
        share = np.array([self._curve(name, season).soil_share for name in names])[:, None]
        bare = share * db_to_linear(soil.value_db - value)  # of the echo
        if day is not None:
            bare_db = float(soil.value_db[_LEVEL_DEG])
            through = self.calendar.course(names, kin, ghz, channel, value[:, _LEVEL_DEG], bare_db, self.world)
            value = value + through.at_angles(day, THETA_DEG)
            closed, of_course = on_day(through.closed, day), on_day(through.sd_db, day)
            bare = on_day(through.soil_share, day)[:, None]
        felt = bare * ~np.array([found[name].soil for name in names])[:, None]  # bare soil has it in its values
        value = value + linear_to_db(1.0 + felt * (db_to_linear(met.value_db - soil.value_db) - 1.0))
        hidden = closed[:, None]
        sd = hidden * np.array([found[name].mean_sd_db for name in names]) + (1.0 - hidden) * soil.mean_sd_db
        if self.world is not None:
            departed = self.world.departure(BARE_SOIL, soil.kin, ghz, channel)
            for k, name in enumerate(names):
                own = self.world.departure(name, kin[name], ghz, channel)
                value[k] += sd[k] * over_soil(own, departed, closed[k], related_covers(kin[name], soil.kin))
        return value, np.hypot(sd[:, _LEVEL_DEG], of_course), closed, through

    def _curve(self, category: str, season: str) -> Curve:
        curve = self.curves.get((category, season))
        if curve is not None:
            return curve
        seasons = ", ".join(s for c, s in self.curves if c == category)
        message = f"the table has no backscatter of {category} in this season"
        raise ScatteringDataError(message, f"It has: {seasons}", file=self.file or None, field="season", value=season)


class _State(NamedTuple):
    """What a look-up asks of a curve."""

    frequency_ghz: float
    wind_m_s: float
    soil_moisture: float
    snow: Snow
    snow_depth_m: float


@dataclass(frozen=True, slots=True, eq=False)
class _Found:
    """What a look-up finds of a category: sigma0 [dB] and sd of its mean [dB] (91,), status, kin, if it is soil, notes.

    ``closed``: the part of it, at 40 deg, that is neither bare soil nor snow.
    """

    value_db: FloatArray
    mean_sd_db: FloatArray
    closed: float
    status: str
    kin: str
    soil: bool
    notes: tuple[str, ...]


def _evaluate(curve: Curve, channel: str, state: _State, world: World | None) -> _Found:
    """One curve at one state."""
    if curve.wind_m_s.size == 1:
        state = state._replace(wind_m_s=0.0)
    if curve.soil_rms_height_m is None:
        state = state._replace(soil_moisture=0.0)
    return _in_world(curve, channel, state, world and world.of(curve.category))


@lru_cache(maxsize=256)  # occasions of one world, and worlds in which other covers differ, ask for the same
def _in_world(curve: Curve, channel: str, state: _State, world: World | None) -> _Found:
    values, closed, sds, statuses, notes = _of_all_channels(curve, state)
    c = POLARIZATIONS.index(channel)
    at_channel = values[c]
    if np.isnan(at_channel).any():
        text = f"the table has no {channel} of {curve.category} for {state.frequency_ghz:g} GHz"
        raise ScatteringDataError(text, "Add its rows at every frequency of the category", field="polarization")
    alike = [k for k in map(POLARIZATIONS.index, alike_at_nadir(channel)) if np.isfinite(values[k]).all()]
    at_nadir = float(np.mean([sds[k] for k in alike]))
    sd = at_nadir + _APART * (sds[c] - at_nadir)
    if world is not None:
        at_channel = at_channel + sd * world.departure(curve.category, curve.kin, state.frequency_ghz, channel)
    soil = curve.soil_rms_height_m is not None
    return _Found(at_channel, sd, closed[c], statuses[c], curve.kin, soil, notes)


@lru_cache(maxsize=256)  # the channels of a run, and runs of one frequency, ask for the same
def _of_all_channels(
    curve: Curve, state: _State
) -> tuple[FloatArray, tuple[float, ...], tuple[float, ...], tuple[str, ...], tuple[str, ...]]:
    """Values (3, 91) of a curve at a state [dB], parts closed, s.d. of their means [dB], statuses and notes."""
    notes = list(curve.notes)
    value, sd, statuses = _at_frequency(curve, _at_wind(curve, state.wind_m_s), state.frequency_ghz, notes)
    if curve.soil_rms_height_m is not None and state.soil_moisture != curve.reference_moisture:
        value = value + _moisture(curve, state, notes)
        statuses = ("assumed",) * 3  # the roughness is
    if curve.wind_m_s.size > 1:
        notes.append(f"wind {state.wind_m_s:.3g} m/s")
    closed = np.full(len(POLARIZATIONS), 1.0 - curve.soil_share)
    if state.snow != "none" and state.snow_depth_m > 0.0 and curve.category not in _ABOVE_SNOW:
        value, from_ground, note = under_snow(value, state.frequency_ghz, state.snow, state.snow_depth_m)
        closed = closed * from_ground[:, _LEVEL_DEG]
        notes.append(note)
        statuses = tuple(weakest((status, "computed")) for status in statuses)
    limited = value if curve.as_given else limit_db(value, surface=curve.surface, water=curve.water)
    sds = tuple(math.hypot(_mean_sd_db(curve, channel, state.frequency_ghz), sd) for channel in POLARIZATIONS)
    return limited, tuple(closed.tolist()), sds, statuses, tuple(notes)


def _mean_sd_db(curve: Curve, channel: str, frequency_ghz: float) -> float:
    """Standard deviation of the mean [dB], linear over the logarithm of frequency, held beyond the nodes."""
    c = POLARIZATIONS.index(channel)
    known = (curve.category, channel) in shipped_variability()
    by_status = [
        default_mean_sd("sigma0", curve.category if known else OWN, status[c], float(f), channel)
        for f, status in zip(curve.frequency_ghz, curve.status, strict=True)
    ]
    stated = np.full(len(by_status), np.nan) if curve.mean_sd_db is None else curve.mean_sd_db[:, c]
    at_nodes = np.where(np.isfinite(stated), stated, by_status)
    return float(np.interp(math.log(frequency_ghz), np.log(curve.frequency_ghz), at_nodes))


def _at_wind(curve: Curve, wind_m_s: float) -> FloatArray:
    """Values (n_frequency, 3, 91) at a wind, linear in dB between node winds."""
    winds = curve.wind_m_s
    if winds.size == 1:
        return np.asarray(curve.value_db[0])
    if not winds[0] <= wind_m_s <= winds[-1]:
        message = f"{curve.category} is known for winds of {winds[0]:g} to {winds[-1]:g} m/s"
        raise ScatteringDataError(
            message, "Keep wind_low_m_s and wind_high_m_s there", field="wind_m_s", value=wind_m_s
        )
    lower = int(np.clip(np.searchsorted(winds, wind_m_s) - 1, 0, winds.size - 2))
    share = (wind_m_s - winds[lower]) / (winds[lower + 1] - winds[lower])
    return np.asarray((1.0 - share) * curve.value_db[lower] + share * curve.value_db[lower + 1])


def _at_frequency(
    curve: Curve, value_db: FloatArray, frequency_ghz: float, notes: list[str]
) -> tuple[FloatArray, float, tuple[str, ...]]:
    """Values (3, 91) at a frequency from those at the nodes (n_frequency, 3, 91), error [dB] and statuses (3,)."""
    nodes = curve.frequency_ghz
    ends = float(nodes[0]), float(nodes[-1])
    low, high = ends[0] / _OCTAVE, ends[1] * _OCTAVE
    if not low <= frequency_ghz <= high:
        message = f"sigma0 of {curve.category} is known at {' to '.join(dict.fromkeys(f'{x:g}' for x in ends))} GHz"
        remedy = f"Stay within one octave of that: {low:g} to {high:g} GHz, or give a table that covers it"
        raise ScatteringDataError(message, remedy, field="frequency", value=frequency_ghz)
    position = np.log2(nodes / frequency_ghz)
    near = int(np.argmin(np.abs(position)))
    beside = abs(position[near]) < _BESIDE_NODE_OCTAVES
    if abs(position[near]) < _AT_NODE_OCTAVES:
        return value_db[near], 0.0, curve.status[near]
    if nodes[0] < frequency_ghz < nodes[-1]:
        upper = int(np.searchsorted(nodes, frequency_ghz))
        share = -position[upper - 1] / (position[upper] - position[upper - 1])
        value = (1.0 - share) * value_db[upper - 1] + share * value_db[upper]
        error = 4.0 * share * (1.0 - share) * INTERPOLATION_SD_DB
        notes.append(
            f"{frequency_ghz:g} GHz interpolated between {nodes[upper - 1]:g} and {nodes[upper]:g} GHz "
            f"(rms error {error:.1f} dB)"
        )
        rests_on = [curve.status[near]] if beside else curve.status[upper - 1 : upper + 1]
        return value, error, tuple(map(weakest, zip(*rests_on, strict=True)))
    told = "" if beside else " (assumed)"
    notes.append(f"{frequency_ghz:g} GHz extrapolated beyond the node at {nodes[near]:g} GHz{told}")
    value = value_db[near] - position[near] * _end_slope(position, value_db, near)
    error = abs(float(position[near])) * _EXTRAPOLATION_SD_DB
    return value, error, curve.status[near] if beside else ("assumed",) * 3


def _end_slope(position: FloatArray, value_db: FloatArray, end: int) -> FloatArray:
    """Slope (3, 91) [dB/octave] beyond the node ``end``, the first or the last; see the module's head."""
    if position.size == 1:
        return np.zeros(value_db.shape[1:])
    if end == 0:
        return np.asarray((value_db[1] - value_db[0]) / (position[1] - position[0]))
    deviation = position - position.mean()
    return np.asarray(0.5 * np.tensordot(deviation, value_db, axes=1) / np.sum(deviation**2))


def _moisture(curve: Curve, state: _State, notes: list[str]) -> FloatArray:
    """Change (3, 91) [dB] that soil moisture makes."""
    mv, reference = state.soil_moisture, curve.reference_moisture
    low, high = MOISTURE_FELT
    held = "" if low <= mv <= high else f", held at {low if mv < low else high:g}"
    notes.append(
        f"soil moisture {mv:.3g} m3/m3 against {reference:g} by Oh 2004 and "
        f"Baghdadi et al. 2016{held} (rms height assumed)"
    )
    return moisture_change_db(state.frequency_ghz, float(curve.soil_rms_height_m or 0.0), mv, reference)


@lru_cache(maxsize=1)
def _shipped_table() -> Sigma0Table:
    """The shipped table, read once in a process."""
    correlation = next(r for r in shipped_rows("model_parameters.csv") if r.text("parameter") == "channel_correlation")
    curves = shipped_curves()
    curves |= seasonal_curves(curves)
    return Sigma0Table(curves, shipped_variability(), float(correlation.text("value")))


def load_sigma0_table(path: str | Path | None = None, needed: bool = True) -> Sigma0Table:
    """The shipped table, or the shipped table with the categories of a user's file in place of its own.

    The columns of ``path`` are in `seqrsm.scattering.longtable`. ScatteringDataError tells that it cannot be read, all
    wrong rows, each with line and column, or that no rows are of sigma0 where they are ``needed``.
    """
    shipped = _shipped_table()
    if path is None:
        return shipped
    curves, field_sd_db, relations = read_long_table(path, needed=needed)
    replaced = {category for category, _ in curves}
    variability = dict(shipped.variability)
    for key, sd in field_sd_db.items():
        date = shipped.variability[key].date_sd_db if key in shipped.variability else 0.0
        variability[key] = Variability(
            (sd, sd), date, f"field sd {sd:g} dB (from {Path(path).name}), date sd {date:g} dB (assumed)"
        )
    kept = {key: curve for key, curve in shipped.curves.items() if key[0] not in replaced}
    return Sigma0Table({**kept, **curves}, variability, shipped.channel_correlation, str(path), relations)
