"""How moist each field is on a visit: one soil for radar and radiometer."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.scene.layers import centres_of_fields, moisture_of_fields
from seqrsm.simulate.visits import Visit, half_lasting, smooth_departure

if TYPE_CHECKING:
    from seqrsm.scene.scene import Scene
    from seqrsm.sensor.radar import RadarConfiguration
    from seqrsm.sensor.radiometer import RadiometerConfiguration

    Sensor: TypeAlias = RadarConfiguration | RadiometerConfiguration

_ANY_GHZ = 1.0  # a field's moisture is the same for all frequencies


def field_moisture(
    scene: Scene, sensor: Sensor, mean: float, visit: Visit, limits: tuple[float, float], *, seed: int, run_id: int
) -> FloatArray:
    """Moisture of each field (n_fields,) on a visit [m3/m3].

    The data base's, shifted by the date's mean less the middle of its range, or the date's mean with a departure that
    near fields share; and a departure of each field's own.

    Parameters
    ----------
    scene : Scene
    sensor : RadarConfiguration or RadiometerConfiguration
        Its ``soil_moisture_*``.
    mean : float
        Of the date [m3/m3].
    visit : Visit
    limits : tuple of float
        Least and largest [m3/m3].
    seed, run_id : int
        Campaign and run.
    """
    key = {"seed": seed, "run_id": run_id}
    level = known_moisture(scene, sensor, mean, limits)
    if level is None:
        level = np.full(scene.n_fields, mean)
        if sensor.soil_moisture_region_sd > 0.0:
            length = sensor.soil_moisture_region_m
            common = smooth_departure(visit, "regional moisture", centres_of_fields(scene), length, **key)
            level = level + sensor.soil_moisture_region_sd * common
    own = half_lasting(visit, "field moisture", (scene.n_fields,), _ANY_GHZ, **key)
    return np.asarray(np.clip(level + sensor.soil_moisture_field_sd * own, *limits))


def known_moisture(scene: Scene, sensor: Sensor, mean: float, limits: tuple[float, float]) -> FloatArray | None:
    """The data base's moisture of each field at a date's mean, that mean where it has none; None without the layer."""
    layer = moisture_of_fields(scene)
    if layer is None:
        return None
    shifted = np.clip(layer + mean - 0.5 * (sensor.soil_moisture_low + sensor.soil_moisture_high), *limits)
    return np.asarray(np.where(np.isfinite(layer), shifted, mean))


def moisture_spread(scene: Scene, sensor: Sensor) -> float:
    """Standard deviation of the fields' moisture about the date's mean [m3/m3], as it can be known beforehand."""
    return math.hypot(sensor.soil_moisture_field_sd, region_spread(scene, sensor))


def region_spread(scene: Scene, sensor: Sensor) -> float:
    """The part of it that near fields share [m3/m3]: that of the data base, else that of the sensor's ground."""
    layer = moisture_of_fields(scene)
    return sensor.soil_moisture_region_sd if layer is None else float(np.nanstd(layer))
