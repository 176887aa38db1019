"""The ground as one radar meets it in one run: the table's backscatter, and everything that departs from it.

Real fields are not even inside, which matters where speckle is averaged away: rows, wet spots and trends make the
backscatter of parts of a field differ. In the AIRSAR flight over Flevoland blocks of 24 to 145 m scatter about the mean
of their field as speckle and parts of 75 m that differ by 1 dB let them (``reports/validation/flevoland.md``). Here
each field is cut into drawn pieces, and each piece departs from its field.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.scattering.readers import POLARIZATIONS
from seqrsm.scene.layers import categories_of_fields
from seqrsm.scene.scene import Scene
from seqrsm.sensor.radar import GROUND_OF, RadarConfiguration
from seqrsm.simulate.radar.frame import pieces
from seqrsm.simulate.radar.occasion import Occasion, draw_occasion
from seqrsm.simulate.visits import Visit, field_moisture, half_lasting

if TYPE_CHECKING:
    from seqrsm.scattering.sigma0 import Sigma0Lookup, Sigma0Table

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
    """Everything random of the ground on a visit: fields, date, what the scene's moisture does, texture."""
    drawn = draw_occasion(radar, lookups, categories_of_fields(scene), ground_state, visit, seed=seed, run_id=run_id)
    moisture = None
    if scene.soil_moisture is not None or max(radar.soil_moisture_field_sd, radar.soil_moisture_region_sd) > 0.0:
        moisture = field_moisture(scene, radar, ground_state[0], visit, MOISTURE_RANGE, seed=seed, run_id=run_id)
    wet = with_moisture(drawn, moisture, scene, radar, table, lookups, visit.day)
    return with_texture(wet, scene, radar, lookups, visit, seed=seed, run_id=run_id)


def with_moisture(
    occasion: Occasion,
    moisture: FloatArray | None,
    scene: Scene,
    radar: RadarConfiguration,
    table: Sigma0Table,
    lookups: list[Sigma0Lookup],
    day: float | None = None,
) -> Occasion:
    """The occasion with each field as wet as stated (n_fields,) [m3/m3]; itself where all are alike (None).

    What a field's moisture does to its category is taken at the incidence angle of the centre of the scene.
    """
    if moisture is None:
        return occasion
    nodes = np.linspace(float(moisture.min()), float(moisture.max()), MOISTURE_NODES)
    theta = math.degrees(radar.centre_incidence_rad)
    steps = [look_up(scene, radar, table, (float(node), occasion.wind_m_s), day) for node in nodes]
    category = categories_of_fields(scene)
    known = category < len(scene.categories)
    offset = occasion.field_offset_db.copy()
    for c, own in enumerate(lookups):
        base = _level_db(own, theta)
        change = np.stack([_level_db(step[c], theta) - base for step in steps])
        for k in np.flatnonzero(np.ptp(change, axis=0) + np.abs(change[0]) > 0.0):
            mine = known & (category == k)
            offset[c, mine] += np.interp(moisture[mine], nodes, change[:, k])
    return replace(occasion, field_offset_db=offset, field_moisture=moisture)


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
    """Backscatter of the scene's categories in each channel at a moisture [m3/m3], wind [m/s] and day of the year.

    RH and RV, circular waves received at H and V, are half the sum of HH or VV and HV, whose echoes are independent.
    """
    more: dict[str, float | str] = {}
    if day is not None:
        more["day"] = day
    if radar.snow != "none":
        more |= {"snow": radar.snow, "snow_depth_cm": radar.snow_depth_cm}

    def find(channel: str) -> Sigma0Lookup:
        lookup: Callable[..., Sigma0Lookup] = table.lookup
        return lookup(
            scene.categories,
            radar.frequency_ghz,
            channel,
            season=radar.season,
            wind_m_s=ground_state[1],
            soil_moisture=ground_state[0],
            **more,
        )

    found = []
    for channel in radar.channels:
        like = find(GROUND_OF[channel])
        if channel[0] == "R":
            like = replace(like, sigma0=0.5 * (like.sigma0 + find("HV").sigma0))
        found.append(like)
    return found


def with_texture(
    occasion: Occasion,
    scene: Scene,
    radar: RadarConfiguration,
    lookups: Sequence[Sigma0Lookup],
    visit: Visit,
    *,
    seed: int,
    run_id: int,
) -> Occasion:
    """The occasion with offsets of pieces in place of those of fields; itself without texture.

    Departures are Gaussian in decibels; two channels share the part of the variance that fields do, and half of it
    lasts from date to date (assumed).

    Parameters
    ----------
    occasion : Occasion
        Of the scene's own fields.
    scene, radar, lookups, visit
        As in `seqrsm.simulate.radar.occasion.draw_occasion`.
    seed, run_id : int
        Campaign and run.
    """
    if radar.texture_db == 0.0:
        return occasion
    _, parent = pieces(scene, radar.texture_m)
    # One for all channels and one for each, as far as there are any: a row's draws do not depend on those after it.
    place = [1 + POLARIZATIONS.index(GROUND_OF[channel]) for channel in radar.channels]
    shape = (1 + max(place), len(parent))
    draws = half_lasting(visit, "texture", shape, radar.frequency_ghz, seed=seed, run_id=run_id)
    offset = occasion.field_offset_db[:, parent]
    for c, lookup in enumerate(lookups):
        shared = float(np.mean(lookup.channel_correlation))
        own = draws[place[c]]
        offset[c] += radar.texture_db * (np.sqrt(shared) * draws[0] + np.sqrt(1.0 - shared) * own)
    return replace(occasion, field_offset_db=offset)
