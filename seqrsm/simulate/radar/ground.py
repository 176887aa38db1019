"""The ground as one radar meets it in one run: the table's backscatter, and everything that departs from it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.scene.layers import categories_of_fields
from seqrsm.scene.scene import Scene
from seqrsm.sensor.radar import GROUND_OF, RadarConfiguration
from seqrsm.simulate.radar.occasion import Occasion, draw_occasion
from seqrsm.simulate.radar.texture import with_texture
from seqrsm.simulate.soil import field_moisture
from seqrsm.simulate.visits import Visit

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
