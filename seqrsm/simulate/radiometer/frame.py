"""The data base turned into a radiometer's frame, and the physical temperature of its elements."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from seqrsm.arrays import AnyArray, Float32Array, FloatArray
from seqrsm.errors import SceneError
from seqrsm.scattering.emissivity import EmissivityLookup
from seqrsm.scene.layers import fill_gaps, known_heights, levelled, turned
from seqrsm.scene.scene import NO_COVER, Scene
from seqrsm.scene.temperature import time_exposure
from seqrsm.scene.terrain import slopes
from seqrsm.sensor.radiometer import RadiometerConfiguration
from seqrsm.simulate.radiometer.occasion import RadiometerOccasion


@dataclass(frozen=True, slots=True, eq=False)
class RadiometerFrame:
    """A scene as the craft flies over its middle: rows across the track, left edge first, columns along it.

    Of a conical scan the rows follow each other in the direction of flight, in which it looks.
    """

    elevation_m: AnyArray
    """(n, m): height above the datum, the scene's mean elevation [m]; gaps filled."""
    cover: AnyArray
    """(n, m): category; 255 where category or elevation is not known."""
    field: AnyArray
    """(n, m)."""
    across_m: FloatArray
    """(n,): distance of each row's centre from the middle, right positive [m]."""
    away_m: FloatArray
    """(n,): from how far it is seen [m]: `across_m` of a sweep; the same for every row on a cone."""
    height_m: float
    """Flight line above the datum [m]."""
    cell_m: float

    quarter_turns: int
    """``numpy.rot90(layer, quarter_turns)`` turns a scene layer into this frame."""


def make_radiometer_frame(scene: Scene, radiometer: RadiometerConfiguration, precision: str) -> RadiometerFrame:
    """Turn a scene so that the craft flies along its columns over the middle, and fill its gaps.

    Raises
    ------
    SceneError
        No cell has an elevation.
    """
    turns = radiometer.quarter_turns
    elevation, cover, field, mean_m = _layers(scene, turns, precision)
    n, height_m = len(elevation), radiometer.altitude_m - mean_m
    return RadiometerFrame(
        elevation_m=elevation,
        cover=cover,
        field=field,
        across_m=_away_m(n, scene.cell_m, height_m, 0.0),
        away_m=_away_m(n, scene.cell_m, height_m, radiometer.conical_incidence_deg),
        height_m=height_m,
        cell_m=scene.cell_m,
        quarter_turns=turns,
    )


def _away_m(n: int, cell_m: float, height_m: float, incidence_deg: float) -> FloatArray:
    """`RadiometerFrame.away_m` of so many rows, of a conical scan at an incidence angle [deg] or of a sweep, 0."""
    if incidence_deg > 0.0:
        return np.full(n, height_m * math.tan(math.radians(incidence_deg)))
    return np.asarray((np.arange(n) - 0.5 * (n - 1)) * cell_m, dtype=np.float64)


# The layers do not depend on the run, so the runs of a campaign share them.
@lru_cache(maxsize=2)
def _layers(scene: Scene, turns: int, precision: str) -> tuple[AnyArray, AnyArray, AnyArray, float]:
    """Elevation, cover and field in the orientation of a heading, and the mean elevation [m]."""
    _, mean_m, _ = known_heights(scene)
    elevation, cover, field = turned(scene, turns, precision)
    return elevation, levelled(elevation, cover, mean_m), field, mean_m


@lru_cache(maxsize=2)
def local_angle_deg(scene: Scene, turns: int, altitude_m: float, incidence_deg: float) -> AnyArray:
    """Angle between a radiometer's line of sight and the normal of the ground, float32 (rows, cols) [deg].

    Quarter turns of its frame, altitude [m], and the incidence angle of a conical scan [deg], 0 of a sweep.
    """
    elevation, _, _, mean_m = _layers(scene, turns, "float32")
    away_m = _away_m(len(elevation), scene.cell_m, altitude_m - mean_m, incidence_deg)[:, None]
    along, back = slopes(elevation, scene.cell_m)
    drop, outward = altitude_m - mean_m - elevation, -back * np.where(away_m < 0.0, -1.0, 1.0)
    away_m = np.abs(away_m)
    cosine = (drop + away_m * outward) / np.sqrt((away_m**2 + drop**2) * (1.0 + along**2 + outward**2))
    return np.rot90(np.rad2deg(np.arccos(np.clip(cosine, 0.0, 1.0))).astype(np.float32), -turns)


def surface_temperature_k(
    scene: Scene,
    frame: RadiometerFrame,
    radiometer: RadiometerConfiguration,
    lookup: EmissivityLookup,
    occasion: RadiometerOccasion,
) -> AnyArray:
    """Physical temperature of every element (n, m) in the frame [K], with the occasion's departures.

    Raises
    ------
    SceneError
        The layer of temperature is asked for, and the scene has none.
    """
    if radiometer.temperature == "layer":
        layer = temperature_layer(scene)
        base = np.rot90(np.where(np.isfinite(layer), layer, np.nanmean(layer)), frame.quarter_turns)
    elif radiometer.temperature == "constant":
        base = np.full(frame.elevation_m.shape, radiometer.temperature_low_k)
    else:
        sun = (radiometer.latitude_deg, radiometer.day_of_year, radiometer.hour, radiometer.exposure_hours)
        cloud_kg_m2 = 0.0 if radiometer.weather == "clear" else radiometer.cloud_kg_m2
        exposure = _exposure(scene, *sun, cloud_kg_m2, frame.quarter_turns)
        heating = np.ones(NO_COVER + 1)
        heating[: len(lookup.heating)] = lookup.heating
        low_k, high_k = radiometer.temperature_low_k, radiometer.temperature_high_k
        base = low_k + np.take(heating, frame.cover) * exposure * (high_k - low_k)
    departure = np.take(occasion.temperature_offset_k + occasion.field_temperature_k, frame.field)
    return np.ascontiguousarray(np.maximum(base + departure, 1.0), dtype=frame.elevation_m.dtype)


def temperature_layer(scene: Scene) -> Float32Array:
    """Layer of temperature (rows, cols) of a scene [K]; SceneError where it has none."""
    if scene.temperature_k is None:
        remedy = 'Import one with `seqrsm scene import --temperature`, or choose temperature = "exposure" or "constant"'
        raise SceneError("the scene has no layer of temperature", remedy, field="temperature", value="layer")
    return scene.temperature_k


@lru_cache(maxsize=4)
def _exposure(
    scene: Scene,
    latitude_deg: float,
    day_of_year: float,
    hour: float,
    exposure_hours: float,
    cloud_kg_m2: float,
    turns: int,
) -> FloatArray:
    """Exposure of a scene in the orientation of a heading; the sun does not change from run to run."""
    elevation = scene.elevation_m.astype(np.float64)
    fill_gaps(elevation)
    exposure = time_exposure(
        elevation,
        scene.cell_m,
        latitude_deg=latitude_deg,
        day_of_year=day_of_year,
        hour=hour,
        exposure_hours=exposure_hours,
        cloud_kg_m2=cloud_kg_m2,
    )
    return np.ascontiguousarray(np.rot90(exposure, turns))
