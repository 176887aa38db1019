"""What is random in a simulated flight of a radiometer: the state of the ground on its date."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final, NamedTuple

import numpy as np

from seqrsm.arrays import AnyArray, FloatArray, IntArray
from seqrsm.rng import generator
from seqrsm.scattering.calendar import Calendar
from seqrsm.scattering.emissivity import MOISTURE_NODES, EmissivityLookup
from seqrsm.scattering.worlds import emission_as_ghz, over_soil
from seqrsm.scene.layers import categories_of_fields
from seqrsm.scene.scene import NO_COVER, Scene
from seqrsm.sensor.radiometer import CHANNELS, RadiometerConfiguration
from seqrsm.simulate.visits import (
    FAST_DAYS,
    Visit,
    field_moisture,
    field_shift_days,
    half_lasting,
    kept_deviates,
    known_moisture,
    moisture_share,
    over_dates,
    year_shift_days,
)

MOISTURE_LIMITS: Final = (float(MOISTURE_NODES[0]), float(MOISTURE_NODES[-1]))
"""Moistures that the table of emissivity knows [m3/m3]."""


_STAGE_DAYS: Final = 5.0  # to which early and late fields are rounded; twice as many, and so on, where stages get many


class Stages(NamedTuple):
    """Categories as they stand on a date: a scene's own by the calendar, then as early and late fields have them."""

    categories: tuple[str, ...]
    """Names (n_stages)."""
    day: FloatArray | None
    """(n_stages,): day of the year on which they are so by the calendar."""
    parent: IntArray
    """(n_stages,): category of the scene."""
    of_field: AnyArray
    """(n_fields,): stage of each field, 255 for none."""

    def of_cells(self, cover: AnyArray, field: AnyArray) -> AnyArray:
        """Stage of cells, uint8, from their cover and field; that of its cover where it is not the field's."""
        if self.day is None:
            return cover
        parent = np.append(self.parent, NO_COVER)[np.minimum(self.of_field, len(self.parent))]
        return np.where(parent[field] == cover, self.of_field[field], cover)


def stages_of(scene: Scene, calendar: Calendar, visit: Visit, *, seed: int, run_id: int) -> Stages:
    """In which stage of its calendar each field is met on a visit, for its year and itself being early or late."""
    categories, of_field = scene.categories, categories_of_fields(scene)
    parent = np.arange(len(categories))
    if visit.day is None:
        return Stages(categories, None, parent, of_field)
    key = {"seed": seed, "run_id": run_id}
    known = of_field < len(categories)
    category = np.where(known, of_field, 0).astype(np.int64)
    of_year = year_shift_days(len(categories), **key)
    late = of_year[category] + field_shift_days(calendar.shift_days(categories)[category], **key)
    late *= known & np.array([calendar.emission_changes(name) for name in categories])[category]
    step, room = _STAGE_DAYS, NO_COVER - len(categories)
    while True:
        steps = np.round(late / step)
        moved = steps != 0.0
        met, own = np.unique(np.stack([category, steps])[:, moved], axis=1, return_inverse=True)
        if met.shape[1] <= room:
            break
        step *= 2.0
    of_field = of_field.copy()
    of_field[moved] = len(categories) + own.ravel()
    parent = np.append(parent, met[0].astype(np.int64))
    day = visit.day - np.append(np.zeros(len(categories)), step * met[1])
    return Stages(tuple(categories[k] for k in parent), day, parent, of_field)


@dataclass(frozen=True, slots=True, eq=False)
class RadiometerOccasion:
    """State of the ground in one run."""

    soil_moisture: float
    """Mean volumetric soil moisture of the date [m3/m3]."""
    field_moisture: FloatArray
    """(n_fields,): soil moisture of each field [m3/m3]."""
    class_offset: FloatArray
    """(n_channels, n_stages): part by which each category, and stage of one, reflects less on this date than by the
    table [1]."""
    field_offset: FloatArray
    """(n_channels, n_fields): part by which each field reflects less than its stage [1]."""
    temperature_offset_k: float
    """Departure of the date's ground temperature [K]."""
    field_temperature_k: FloatArray
    """(n_fields,): departure of each field's temperature from the date's [K]."""

    def record(self, channels: Sequence[str], categories: Sequence[str]) -> Mapping[str, object]:
        """What is kept with a score: plain numbers and names, fields by their spread."""
        return {
            "soil_moisture": round(self.soil_moisture, 5),
            "field_moisture_sd": round(float(self.field_moisture.std()), 5),
            "class_offset": {
                channel: {name: round(float(x), 5) for name, x in zip(categories, row, strict=False)}
                for channel, row in zip(channels, self.class_offset, strict=True)
            },
            "field_offset_sd": [round(float(row.std()), 5) for row in self.field_offset],
            "temperature_offset_k": round(self.temperature_offset_k, 4),
            "field_temperature_sd_k": round(float(self.field_temperature_k.std()), 4),
        }


def draw_radiometer_occasion(
    radiometer: RadiometerConfiguration,
    lookups: Sequence[EmissivityLookup],
    stages: Stages,
    scene: Scene,
    visit: Visit,
    *,
    seed: int,
    run_id: int,
) -> RadiometerOccasion:
    """Draw the ground's state of one visit, of campaign and run; there is a lookup of all stages for each channel.

    Offsets are Gaussian with the table's standard deviations; H and V share the part of the variance that the table
    gives as their correlation, and a channel's draw does not depend on which others are received. What covers depart by
    on a date fades with its weather; where crops leave soil bare it is the soil's. Moistures stay between the table's
    ends.
    """
    n_stages, n_categories, n_fields = len(stages.parent), int(stages.parent.max()) + 1, len(stages.of_field)
    key = {"seed": seed, "run_id": run_id}
    low, high = radiometer.soil_moisture_low, radiometer.soil_moisture_high
    mean = float(low + moisture_share(visit, **key) * (high - low))

    def weather(purpose: str, n: int) -> FloatArray:
        return over_dates(visit, purpose, lambda name: generator(seed, run_id, name).standard_normal(n), FAST_DAYS)

    warm = float(radiometer.temperature_date_sd_k * weather("temperature", 1)[0])
    moisture = field_moisture(scene, radiometer, mean, visit, MOISTURE_LIMITS, **key)
    temperature = weather("field temperature", n_fields)
    parts, f = 1 + len(CHANNELS), emission_as_ghz(radiometer.frequency_ghz)
    by_name = partial(kept_deviates, seed, run_id, shape=(parts, n_categories), frequency_ghz=f)
    dates = over_dates(visit, "date emissivity", by_name, FAST_DAYS)
    soil = over_dates(visit, "date bare soil", partial(by_name, shape=(parts, 1)), FAST_DAYS)
    dates = over_soil(dates[:, stages.parent], soil, lookups[0].closed)
    plots = half_lasting(visit, "field emissivity", (parts, n_fields), f, **key)
    known = stages.of_field < n_stages
    stage = np.where(known, stages.of_field, 0).astype(np.int64)
    class_offset = np.empty((len(lookups), n_stages))
    field_offset = np.empty((len(lookups), n_fields))
    for c, (channel, lookup) in enumerate(zip(radiometer.channels, lookups, strict=True)):
        own = 1 + CHANNELS.index(channel)
        shared, apart = np.sqrt(lookup.channel_correlation), np.sqrt(1.0 - lookup.channel_correlation)
        class_offset[c] = lookup.date_part * (shared * dates[0] + apart * dates[own])
        deviate = shared[stage] * plots[0] + apart[stage] * plots[own]
        field_offset[c] = np.where(known, lookup.field_part[stage] * deviate, 0.0)
    spread = radiometer.temperature_field_sd_k * temperature
    return RadiometerOccasion(mean, moisture, class_offset, field_offset, warm, spread)


def nominal_radiometer_occasion(
    radiometer: RadiometerConfiguration, lookups: Sequence[EmissivityLookup], scene: Scene
) -> RadiometerOccasion:
    """The table's own state and the middle of the moistures: for pictures and tests, not for scores."""
    mean = 0.5 * (radiometer.soil_moisture_low + radiometer.soil_moisture_high)
    known = known_moisture(scene, radiometer, mean, MOISTURE_LIMITS)
    n_channels, n_fields = len(lookups), scene.n_fields
    return RadiometerOccasion(
        mean,
        np.full(n_fields, mean) if known is None else known,
        np.zeros((n_channels, len(lookups[0].categories))),
        np.zeros((n_channels, n_fields)),
        0.0,
        np.zeros(n_fields),
    )
