"""The ground as one radar meets it in one run: the table's backscatter, and everything that departs from it.

A future flight would see other soil, wind and crops than the last one. Each run therefore draws its own state of the
ground, keyed by the campaign's seed and the run's id, and repeats of one setting differ as repeated flights would.

Real fields are not even inside, which matters where speckle is averaged away: rows, wet spots and trends make the
backscatter of parts of a field differ. In the AIRSAR flight over Flevoland blocks of 24 to 145 m scatter about the mean
of their field as speckle and parts of 75 m that differ by 1 dB let them (``reports/validation/flevoland.md``). Here
each field is cut into drawn pieces, and each piece departs from its field.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Final

import numpy as np
from scipy.special import ndtr, ndtri

from seqrsm.arrays import AnyArray, FloatArray, IntArray
from seqrsm.remember import cached_by_thread
from seqrsm.rng import generator
from seqrsm.scattering.calendar import Course, on_day
from seqrsm.scattering.coherence import FIELD_SD, Coherence, added_power, by_angle, circular, coherence, limited
from seqrsm.scattering.readers import POLARIZATIONS
from seqrsm.scattering.sigma0 import Sigma0Lookup, Sigma0Table
from seqrsm.scattering.worlds import co_apart, over_soil, own_weights
from seqrsm.scene.layers import categories_of_fields
from seqrsm.scene.scene import Scene
from seqrsm.sensor.radar import GROUND_OF, LAYERS, PHASE, RadarConfiguration
from seqrsm.simulate.radar.frame import pieces
from seqrsm.simulate.visits import (
    FAST_DAYS,
    OWN_OF_FIELDS,
    Visit,
    at_angle,
    field_moisture,
    field_shift_days,
    half_lasting,
    kept_deviates,
    moisture_share,
    over_dates,
    year_shift_days,
)
from seqrsm.units import db_to_linear, linear_to_db

_WEATHER_DB: Final = (0.8, 1.1)  # common to all crops on a date, HH and VV, HV
_CROP_WEATHER_DB: Final = (0.5, 0.85)
"""A crop's own: 10-day means of wheat, maize and grass of western France, less those of all crops and of 50 days and
what their number leaves open, depart by 0.32 and 0.55 dB rms, which is 0.64 of what such a series does."""
_CROP_DAYS: Final = 10.0
"""In which that falls to 1/e: those means are related by 0.0 from one to the next, as in such a series; of weather it
would be -0.2, of sampling -0.3."""
_FIELD_WEATHER_DB: Final = (0.4, 0.55)
"""In proportion to `_WEATHER_DB` (assumed). Fields of SMAPVEX12 differ on days up to four apart by 0.37 (HH) and 0.85
dB (VV; five pairs each, over the root of 2), where what fades in weeks leaves 0.1."""
_YEAR_DB: Final = 1.0  # assumed


@dataclass(frozen=True, slots=True, eq=False)
class Occasion:
    """State of the ground in one run."""

    soil_moisture: float
    """Volumetric moisture of bare soil [m3/m3]."""
    wind_m_s: float
    """Wind speed over water [m/s]."""
    class_offset_db: FloatArray
    """(n_layers, n_categories): departure of each class on this date from the table [dB]."""
    field_offset_db: FloatArray
    """(n_layers, n_fields): departure of each field from its class [dB]."""
    field_moisture: FloatArray | None = None
    """(n_fields,): soil moisture of each field [m3/m3]; None: that of the date, in all."""

    def record(self, layers: Sequence[str], categories: Sequence[str]) -> Mapping[str, object]:
        """What is kept with a score: all but the fields, whose spread stands for them; plain numbers and names."""
        return {
            "soil_moisture": self.soil_moisture,
            "wind_m_s": self.wind_m_s,
            "class_offset_db": {
                layer: {name: round(float(x), 4) for name, x in zip(categories, row, strict=True)}
                for layer, row in zip(layers, self.class_offset_db, strict=True)
            },
            "field_offset_sd_db": [round(float(row.std()), 4) for row in self.field_offset_db],
        }


def draw_ground_state(radar: RadarConfiguration, visit: Visit, *, seed: int, run_id: int) -> tuple[float, float]:
    """Soil moisture [m3/m3] and wind speed [m/s] of a visit, uniform between the radar's stated ends.

    ``seed`` and ``run_id`` are those of campaign and run.
    """
    moisture = moisture_share(visit, seed=seed, run_id=run_id)
    wind = over_dates(visit, "wind", lambda name: ndtri(generator(seed, run_id, name).random(1)), FAST_DAYS)
    return (
        float(radar.soil_moisture_low + moisture * (radar.soil_moisture_high - radar.soil_moisture_low)),
        float(radar.wind_low_m_s + ndtr(wind[0]) * (radar.wind_high_m_s - radar.wind_low_m_s)),
    )


def draw_occasion(
    radar: RadarConfiguration,
    lookups: Sequence[Sigma0Lookup],
    field_category: AnyArray,
    ground_state: tuple[float, float],
    visit: Visit,
    *,
    seed: int,
    run_id: int,
) -> Occasion:
    """Draw the offsets of classes and fields of one visit.

    Offsets are Gaussian in decibels with the table's standard deviations, so the table's value is their median. Two
    channels share the part of the variance that the table gives as their correlation, and HH and VV, looking steeply,
    more of it, `own_weights`. A channel's draw does not depend on which other channels there are, on sensors of the
    same dates that look no more steeply, or on later dates.

    On a day of the year the table's spread from date to date gives way to the calendar: the weather of the date,
    common to all crops (0.8 dB, 1.1 dB at HV), a crop's own (0.5, 0.85 dB), a level (1 dB) and a shift of the year, and
    fields with a lasting departure, one that fades, part of it (0.4, 0.55 dB) as weather does, and a shift of their own
    (`seqrsm.scattering.calendar`). Where a crop leaves soil bare, its weather and level are those of all bare soil, and
    the part of its echo that is the soil's has the date's moisture in place of the weather that crops share. The
    spread was measured with early and late fields in it, so what their shift makes of it on a day is taken off what
    fades. The roughness of a field of bare ground is the same for all channels, sensors and dates; a crop's that lies
    bare has none that lasts, as almost nothing of it was measured to. Layers of `TOGETHER` are left at 0.

    Parameters
    ----------
    radar : RadarConfiguration
    lookups : sequence of Sigma0Lookup
        One for each of the radar's layers.
    field_category : uint8 array (n_fields,)
        Category of each field, 255 for none.
    ground_state : tuple of float
        Of `draw_ground_state`.
    visit : Visit
    seed, run_id : int
        Campaign and run.
    """
    n_categories = lookups[0].sigma0.shape[0]
    known = field_category < n_categories
    category = np.where(known, field_category, 0).astype(np.int64)
    class_offset = np.zeros((len(lookups), n_categories))
    field_offset = np.zeros((len(lookups), len(field_category)))
    theta = math.degrees(radar.centre_incidence_rad)
    calibration = generator(seed, run_id, visit.purpose("calibration")).standard_normal(len(LAYERS))
    height = generator(seed, run_id, "roughness").standard_normal(known.size)
    for c, channel, lookup in _recorded(radar, lookups):
        of, related = GROUND_OF[channel], lookup.channel_correlation
        draw = _Draws(visit, seed, run_id, radar.frequency_ghz, of, own_weights(of, theta), related)
        sd, rough = lookup.of_fields_db(theta)
        if visit.day is None or lookup.course is None:
            date, soil = draw("date backscatter", n_categories), draw("date bare soil", 1)
            class_offset[c] = lookup.date_sd_db * over_soil(date, soil, lookup.closed)
            deviation = sd[category] * draw.of_fields("field backscatter", category.size)
        else:
            class_offset[c], deviation = _dated(draw, lookup, lookup.course, sd, category, visit, visit.day)
        field_offset[c] = np.where(known, deviation + rough[category] * height, 0.0)
        class_offset[c] += radar.calibration_sd_db * calibration[LAYERS.index(channel)]
    return Occasion(ground_state[0], ground_state[1], class_offset, field_offset)


def _recorded(radar: RadarConfiguration, lookups: Sequence[Sigma0Lookup]) -> list[tuple[int, str, Sigma0Lookup]]:
    """Place, name and look-up of the layers that are channels."""
    return [(c, *of) for c, of in enumerate(zip(radar.recorded, lookups, strict=False))]


@dataclass(frozen=True, slots=True)
class _Draws:
    """Standard normal draws of one channel on a visit."""

    visit: Visit
    seed: int
    run_id: int
    frequency_ghz: float
    channel: str
    own: FloatArray
    """Of `own_weights`."""
    shared: float

    def of_fields(self, purpose: str, n: int) -> FloatArray:
        """As the visit's angle sees them, with a share that only near frequencies have in common."""
        return at_angle(self.visit, purpose, lambda name: self(name, n, OWN_OF_FIELDS))

    def __call__(self, purpose: str, n: int, own_share: float = 0.0) -> FloatArray:
        shape = 1 + len(POLARIZATIONS), n
        drawn = kept_deviates(self.seed, self.run_id, purpose, shape, self.frequency_ghz, own_share)
        return _mixed(drawn, self.own, self.shared)


def _mixed(drawn: FloatArray, own: FloatArray, shared: float) -> FloatArray:
    """Standard normal (n,) of a channel, of what all share and, by weights (3,), what HH, HV and VV have of their own.

    ``drawn`` (parts, n): as many rows as have a weight.
    """
    each = drawn[1:]
    return np.asarray(math.sqrt(shared) * drawn[0] + math.sqrt(1.0 - shared) * (own[: len(each)] @ each))


def _dated(
    draw: _Draws, lookup: Sigma0Lookup, course: Course, sd: FloatArray, category: IntArray, visit: Visit, day: float
) -> tuple[FloatArray, FloatArray]:
    """Offsets of classes (n_categories,) and of fields (n_fields,) on a day of the year [dB]."""
    key = {"seed": draw.seed, "run_id": draw.run_id}
    n = len(course.even)
    late = np.where(course.even, 0.0, year_shift_days(n, **key))
    moved = np.array([on_day(year, day - shift) for year, shift in zip(course.change_db, late, strict=True)])
    now = on_day(course.change_db, day)
    closed = on_day(course.closed, day)
    own = over_dates(
        visit, "date backscatter", lambda name: draw(name, n), np.where(course.even, FAST_DAYS, _CROP_DAYS)
    )
    soil = over_dates(visit, "date bare soil", lambda name: draw(name, 1), FAST_DAYS)
    own = over_soil(own, soil, closed)
    common = over_dates(visit, "weather", lambda name: draw(name, 1), FAST_DAYS)
    canopy = 1.0 - on_day(course.soil_share, day)
    weather = _WEATHER_DB[draw.channel == "HV"] * canopy * common + _CROP_WEATHER_DB[draw.channel == "HV"] * own
    year = _YEAR_DB * over_soil(draw("year backscatter", n), draw("year bare soil", 1), closed)
    offset = np.where(course.even, lookup.date_sd_db * own, moved - now + year + weather)
    lasts = draw.of_fields("lasting backscatter", category.size)
    fades, quick = (
        over_dates(visit, name, lambda name: draw.of_fields(name, category.size), days, of)
        for name, days, of in (("field backscatter", course.memory_days, category), ("field weather", FAST_DAYS, None))
    )
    spread = np.square(sd)
    lasting, fading = course.lasting_share * spread, (1.0 - course.lasting_share) * spread
    shifts, shifted = field_shift_days(course.shift_days[category], **key), np.zeros(category.size)
    for k in np.flatnonzero(course.shift_days > 0.0):
        mine, at = category == k, day - late[k]
        early, behind = on_day(course.change_db[k], at + course.shift_days[k] * np.array([1.0, -1.0]))
        fading[k] = max(fading[k] - 0.25 * (early - behind) ** 2, 0.0)
        shifted[mine] = on_day(course.change_db[k], at - shifts[mine]) - moved[k]
    fast = np.minimum(_FIELD_WEATHER_DB[draw.channel == "HV"] ** 2, fading)
    parts = ((lasting, lasts), (fading - fast, fades), (fast, quick))
    return offset, sum(np.sqrt(variance)[category] * drawn for variance, drawn in parts) + shifted


def nominal_ground_state(radar: RadarConfiguration) -> tuple[float, float]:
    """Soil moisture [m3/m3] and wind speed [m/s] in the middle of their ranges."""
    return (
        0.5 * (radar.soil_moisture_low + radar.soil_moisture_high),
        0.5 * (radar.wind_low_m_s + radar.wind_high_m_s),
    )


MOISTURE_RANGE: Final = (0.0, 0.6)
"""Soil moisture that tables know [m3/m3]."""

MOISTURE_NODES: Final = 7
"""Moistures at which the effect on backscatter is looked up; straight lines between."""


def met_occasion(
    scene: Scene,
    radar: RadarConfiguration,
    table: Sigma0Table,
    lookups: list[Sigma0Lookup],
    ground_state: tuple[float, float],
    visit: Visit,
    *,
    seed: int,
    run_id: int,
) -> Occasion:
    """Everything random of the ground on a visit: fields, date, what the scene's moisture does, texture.

    What a field's moisture does to its category is taken at the incidence angle of the centre of the scene. Departures
    of parts of fields are Gaussian in decibels; two channels share the part of the variance that fields do, and half of
    it lasts from date to date and half fades as weather does (assumed). Offsets are then those of pieces in place of
    fields.
    """
    key = {"seed": seed, "run_id": run_id}
    category = categories_of_fields(scene)
    met = draw_occasion(radar, lookups, category, ground_state, visit, **key)
    offset, moisture = met.field_offset_db, None
    if scene.soil_moisture is not None or max(radar.soil_moisture_field_sd, radar.soil_moisture_region_sd) > 0.0:
        moisture = field_moisture(scene, radar, ground_state[0], visit, MOISTURE_RANGE, **key)
        nodes = np.linspace(float(moisture.min()), float(moisture.max()), MOISTURE_NODES)
        theta = math.degrees(radar.centre_incidence_rad)
        steps = [look_up(scene, radar, table, (float(node), met.wind_m_s), visit.day) for node in nodes]
        known = category < len(scene.categories)
        for c, _, own in _recorded(radar, lookups):
            base = _level_db(own, theta)
            change = np.stack([_level_db(step[c], theta) - base for step in steps])
            for k in np.flatnonzero(np.ptp(change, axis=0) + np.abs(change[0]) > 0.0):
                mine = known & (category == k)
                offset[c, mine] += np.interp(moisture[mine], nodes, change[:, k])
    parent = np.arange(len(category))
    if radar.texture_db > 0.0:
        _, parent = pieces(scene, radar.texture_m)
        # Rows as far as they are asked for: a row's draws do not depend on those after it.
        theta = math.degrees(radar.centre_incidence_rad)
        weights = [own_weights(GROUND_OF[name], theta) for name in radar.recorded]
        parts = 2 + int(np.flatnonzero(np.any(weights, axis=0))[-1])
        draws = at_angle(
            visit, "texture", lambda own: half_lasting(visit, own, (parts, len(parent)), radar.frequency_ghz, **key)
        )
        offset = offset[:, parent]
        for c, of_channel in enumerate(weights):
            offset[c] += radar.texture_db * _mixed(draws, of_channel, lookups[c].channel_correlation)
    met = replace(met, field_offset_db=offset, field_moisture=moisture)
    if PHASE not in radar.channels:
        return met
    theta = math.degrees(radar.centre_incidence_rad)
    of_ground = replace(radar, channels=("HH", "HV", "VV"), calibration_sd_db=0.0)
    linear = look_up(scene, of_ground, table, ground_state, visit.day)
    relation, cross = _related(radar.frequency_ghz, table, linear[0]).mean, _cross_at_nadir(*linear[:2])
    mean = by_angle(relation, cross, theta)[:, 0]
    departure = at_angle(
        visit, "coherence", lambda own: half_lasting(visit, own, (2, len(category)), radar.frequency_ghz, **key)
    )
    known = np.where(category < len(scene.categories), category, 0)
    apart, cross = float(co_apart(theta)), cross[known]
    if apart < 1.0:  # else HV says nothing of it
        fields = draw_occasion(of_ground, linear, category, ground_state, visit, **key)
        of_hh, of_hv, _ = fields.class_offset_db[:, known] + fields.field_offset_db
        cross = cross * db_to_linear(of_hv - of_hh)
    seen = by_angle(relation[known], cross, theta)[:, 0]
    of_fields = limited(seen + FIELD_SD * apart * (departure[0] + 1j * departure[1]))
    if radar.pair == ("RH", "RV"):
        powers = np.array([db_to_linear(_level_db(look, theta)) for look in linear])
        mean, of_fields = circular(mean, *powers), circular(of_fields, *powers[:, known])
    return _added(radar, lookups, met, mean, category[parent], of_fields[parent])


@cached_by_thread  # asked for by look-ups and by fields
def _related(frequency_ghz: float, table: Sigma0Table, hh: Sigma0Lookup) -> Coherence:
    """How HH and VV of the categories of a look-up are related."""
    return coherence(hh.categories, frequency_ghz, table.world, hh.closed, table.relations)


def _added(
    radar: RadarConfiguration,
    lookups: Sequence[Sigma0Lookup],
    met: Occasion,
    related: AnyArray,
    category: IntArray,
    of_fields: AnyArray,
) -> Occasion:
    """An occasion with the offsets of the radar's pair added, at the incidence angle of the centre of the scene.

    ``category`` and ``of_fields`` (n_fields,): of each field or piece, the latter how its pair is related; ``related``
    (n_categories,): how that of covers is.
    """
    theta = math.degrees(radar.centre_incidence_rad)
    one, other = (radar.layers.index(channel) for channel in radar.pair)
    known = np.where(category < len(related), category, 0)
    of_class, of_field = met.class_offset_db.copy(), met.field_offset_db.copy()
    table = [db_to_linear(_level_db(lookups[c], theta)) for c in (one, other)]
    on_date = [power * db_to_linear(of_class[c]) for power, c in zip(table, (one, other), strict=True)]
    here = [power[known] * db_to_linear(of_field[c]) for power, c in zip(on_date, (one, other), strict=True)]
    for c, part in zip((-2, -1), (np.real, np.imag), strict=True):
        nominal, dated = (added_power(first, second, part(related)) for first, second in (table, on_date))
        of_class[c] = linear_to_db(dated / nominal)
        offset = linear_to_db(added_power(here[0], here[1], part(of_fields)) / dated[known])
        of_field[c] = np.where(category < len(related), offset, 0.0)
    return replace(met, class_offset_db=of_class, field_offset_db=of_field)


def _cross_at_nadir(hh: Sigma0Lookup, hv: Sigma0Lookup) -> FloatArray:
    """Power of HV over that of HH at nadir (n_categories,)."""
    return np.asarray(hv.sigma0[:, 0] / hh.sigma0[:, 0])


def _level_db(lookup: Sigma0Lookup, theta_deg: float) -> FloatArray:
    """sigma0 of each category at an angle [dB]; 0 where it has none."""
    level = np.array([np.interp(theta_deg, lookup.theta_deg, row) for row in lookup.sigma0])
    return np.asarray(10.0 * np.log10(np.where(level > 0.0, level, 1.0)))


def look_up(
    scene: Scene,
    radar: RadarConfiguration,
    table: Sigma0Table,
    ground_state: tuple[float, float],
    day: float | None = None,
) -> list[Sigma0Lookup]:
    """Backscatter of the scene's categories in each layer at a moisture [m3/m3], wind [m/s] and day of the year.

    RH and RV, circular waves received at H and V, are half the sum of HH or VV and HV, whose echoes are independent.
    """
    more: dict[str, float | str] = {}
    if day is not None:
        more["day"] = day
    if radar.snow != "none":
        more |= {"snow": radar.snow, "snow_depth_cm": radar.snow_depth_cm}

    def find(channel: str) -> Sigma0Lookup:
        return _found(
            table,
            scene.categories,
            radar.frequency_ghz,
            channel,
            season=radar.season,
            wind_m_s=ground_state[1],
            soil_moisture=ground_state[0],
            **more,
        )

    found = []
    for channel in radar.recorded:
        like = find(GROUND_OF[channel])
        if channel[0] == "R":
            like = replace(like, sigma0=0.5 * (like.sigma0 + find("HV").sigma0))
        found.append(like)
    if PHASE not in radar.channels:
        return found
    one, other = (found[radar.layers.index(channel)] for channel in radar.pair)
    related = _related(radar.frequency_ghz, table, one)
    hh, hv, vv = (find(channel) for channel in ("HH", "HV", "VV"))
    mean = by_angle(related.mean, _cross_at_nadir(hh, hv), hh.theta_deg)
    if radar.pair == ("RH", "RV"):
        mean = circular(mean, hh.sigma0, hv.sigma0, vv.sigma0)
    for part in (mean.real, mean.imag):
        both = added_power(one.sigma0, other.sigma0, part)
        found.append(replace(one, sigma0=both, status=related.status, notes=related.notes))
    return found


@lru_cache(maxsize=32)  # settings that are checked one after another ask for few frequencies, channels and states
def _found(table: Sigma0Table, *where: Any, **state: Any) -> Sigma0Lookup:
    return table.lookup(*where, **state)
