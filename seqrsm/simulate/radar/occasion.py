"""What is random in a simulated run: the occasion on which the radar meets the ground.

A future flight would see other soil, wind and crops than the last one. Each run therefore draws its own state of the
ground, keyed by the campaign's seed and the run's id, and repeats of one setting differ as repeated flights would.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seqrsm.arrays import AnyArray, FloatArray
from seqrsm.rng import generator
from seqrsm.sensor.radar import CHANNELS, RadarConfiguration

if TYPE_CHECKING:
    from seqrsm.scattering.sigma0 import Sigma0Lookup


@dataclass(frozen=True, slots=True, eq=False)
class Occasion:
    """State of the ground in one run.

    Attributes
    ----------
    soil_moisture : float
        Volumetric moisture of bare soil [m3/m3].
    wind_m_s : float
        Wind speed over water [m/s].
    class_offset_db : float64 array (n_channels, n_categories)
        Departure of each class on this date from the table [dB].
    field_offset_db : float64 array (n_channels, n_fields)
        Departure of each field from its class [dB].
    """

    soil_moisture: float
    wind_m_s: float
    class_offset_db: FloatArray
    field_offset_db: FloatArray

    def record(self, channels: Sequence[str], categories: Sequence[str]) -> Mapping[str, object]:
        """What is kept with a score: all but the fields, whose spread stands for them; plain numbers and names."""
        return {
            "soil_moisture": self.soil_moisture,
            "wind_m_s": self.wind_m_s,
            "class_offset_db": {
                channel: {name: round(float(x), 4) for name, x in zip(categories, row, strict=True)}
                for channel, row in zip(channels, self.class_offset_db, strict=True)
            },
            "field_offset_sd_db": [round(float(row.std()), 4) for row in self.field_offset_db],
        }


def draw_ground_state(radar: RadarConfiguration, *, seed: int, run_id: int) -> tuple[float, float]:
    """Soil moisture [m3/m3] and wind speed [m/s] of a run, uniform between the radar's stated ends.

    Parameters
    ----------
    radar : RadarConfiguration
    seed, run_id : int
        Campaign and run.
    """
    moisture, wind = generator(seed, run_id, "ground state").random(2)
    return (
        float(radar.soil_moisture_low + moisture * (radar.soil_moisture_high - radar.soil_moisture_low)),
        float(radar.wind_low_m_s + wind * (radar.wind_high_m_s - radar.wind_low_m_s)),
    )


def draw_occasion(
    radar: RadarConfiguration,
    lookups: Sequence[Sigma0Lookup],
    field_category: AnyArray,
    ground_state: tuple[float, float],
    *,
    seed: int,
    run_id: int,
) -> Occasion:
    """Draw the offsets of classes and fields of one run.

    Offsets are Gaussian in decibels with the table's standard deviations, so the table's value is their median. Two
    channels share the part of the variance that the table gives as their correlation. A channel's draw does not depend
    on which other channels are imaged.

    Parameters
    ----------
    radar : RadarConfiguration
    lookups : sequence of Sigma0Lookup
        One for each of the radar's channels.
    field_category : uint8 array (n_fields,)
        Category of each field, 255 for none.
    ground_state : tuple of float
        Of `draw_ground_state`.
    seed, run_id : int
        Campaign and run.

    Returns
    -------
    Occasion
    """
    n_categories = lookups[0].sigma0.shape[0]
    n_fields = len(field_category)
    dates = generator(seed, run_id, "date backscatter").standard_normal((1 + len(CHANNELS), n_categories))
    plots = generator(seed, run_id, "field backscatter").standard_normal((1 + len(CHANNELS), n_fields))
    known = field_category < n_categories
    category = np.where(known, field_category, 0).astype(np.int64)
    class_offset = np.empty((len(lookups), n_categories))
    field_offset = np.empty((len(lookups), n_fields))
    for c, (channel, lookup) in enumerate(zip(radar.channels, lookups, strict=True)):
        own = 1 + CHANNELS.index(channel)
        shared = np.broadcast_to(np.asarray(lookup.channel_correlation, dtype=np.float64), (n_categories,))
        class_offset[c] = lookup.date_sd_db * (np.sqrt(shared) * dates[0] + np.sqrt(1.0 - shared) * dates[own])
        part = shared[category]
        deviate = np.sqrt(part) * plots[0] + np.sqrt(1.0 - part) * plots[own]
        field_offset[c] = np.where(known, lookup.field_sd_db[category] * deviate, 0.0)
    return Occasion(ground_state[0], ground_state[1], class_offset, field_offset)


def nominal_ground_state(radar: RadarConfiguration) -> tuple[float, float]:
    """Soil moisture [m3/m3] and wind speed [m/s] in the middle of their ranges."""
    return (
        0.5 * (radar.soil_moisture_low + radar.soil_moisture_high),
        0.5 * (radar.wind_low_m_s + radar.wind_high_m_s),
    )


def nominal_occasion(
    lookups: Sequence[Sigma0Lookup], field_category: AnyArray, ground_state: tuple[float, float]
) -> Occasion:
    """The table's own state: no offset of any class or field. For pictures and tests, not for scores."""
    n_channels = len(lookups)
    return Occasion(
        ground_state[0],
        ground_state[1],
        np.zeros((n_channels, lookups[0].sigma0.shape[0])),
        np.zeros((n_channels, len(field_category))),
    )
