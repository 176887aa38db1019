"""Error and skill of retrieved soil moisture: of squares of ground by a radiometer, of bare fields by a radar."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from seqrsm.arrays import AnyArray, FloatArray
from seqrsm.errors import SceneError
from seqrsm.scene.layers import centres_of_fields, moisture_of_fields
from seqrsm.scene.scene import Scene
from seqrsm.score.bare_soil import retrieved_fields
from seqrsm.score.brightness import BLOCK_M, cells_of_pairs, retrieved_squares
from seqrsm.score.classification import UtilityScore, cluster_ratio
from seqrsm.score.pixels import Image
from seqrsm.score.utilities import Asked
from seqrsm.sensor.exchange import Sensor
from seqrsm.sensor.radar import RadarConfiguration
from seqrsm.simulate.radar.result import RadarImage

_DUST: Final = 1e-12  # [m6/m6]: rounding where all the ground is one field
_PAIRED: Final = 400  # squares or fields that a mean over pairs is made of
_ALIKE: Final = (
    "all the ground of a run has the same soil moisture",
    "Let fields differ: set soil_moisture_field_sd, such as 0.04 m3/m3, or soil_moisture_region_sd.",
)


def score_moisture(images: Sequence[Image], scene: Scene, asked: Asked, *, seed: int, run_id: int) -> UtilityScore:
    """Error or skill of soil moisture over scored cells of covers that show any.

    A radiometer's image gives the mean of squares of 250 m (`seqrsm.score.brightness`), radars' images the moisture of
    bare fields (`seqrsm.score.bare_soil`), on each date by itself. "soil_moisture_error" is the unbiased root mean
    square error [m3/m3]: errors about their mean of each date. "soil_moisture_skill" is one less its square over the
    variance that the truth has on average: 0 for a guess of the mean, 1 where all is known. Images are of one ground,
    by one radiometer, or radars; seed and run id key the tiles that a field larger than one is divided by. Details:
    ``truth_sd``, of this occasion, and ``bias`` [m3/m3], ``skill``.

    Raises
    ------
    SceneError
        No scored cell in the image has a cover that shows moisture, or one square or field of them, or all are equally
        moist.
    """
    days = dict.fromkeys(image.day for image in images)
    dates = [_compared([one for one in images if one.day == day], scene, seed, run_id) for day in days]
    weight, truth, error = (np.concatenate(parts) for parts in zip(*(date[:3] for date in dates), strict=True))
    # As of errors, by cells: a date on which nothing is compared has none.
    variance = float(sum(date.spread**2 * date.weight.sum() for date in dates) / max(weight.sum(), 1.0))
    if not any(date.pieces for date in dates):
        text = "no scored cells have retrievable soil moisture"
        remedy = "Choose another utility, bare soil that is not frozen, or days on which fields lie bare."
        raise SceneError(text, remedy, field="utility")
    if all(date.pieces <= 1 for date in dates):
        piece = "field" if isinstance(images[0], RadarImage) else f"square of {BLOCK_M:g} m"
        text = f"soil moisture shows in a single {piece}: there is nothing to compare"
        raise SceneError(text, "Use a larger scene, or choose another utility.", field="utility")
    if variance == 0.0:
        raise SceneError(*_ALIKE, field="utility")
    square, se = cluster_ratio(weight * error**2, weight)
    skill = 1.0 - square / variance
    details: dict[str, object] = {
        "truth_sd": float(np.sqrt(np.cov(truth, aweights=weight, ddof=0))),
        "bias": float(np.mean([date.bias for date in dates])),
        "skill": skill,
    }
    spread = math.sqrt(variance)
    n_cells, n_used = int(weight.sum()), len(weight)
    if asked.name == "soil_moisture_skill":
        return UtilityScore(skill, se / variance, 0.0, 1.0, n_cells, n_used, details=details)
    rmse = math.sqrt(square)
    return UtilityScore(rmse, se / (2.0 * rmse) if rmse > 0.0 else 0.0, spread, 0.0, n_cells, n_used, details=details)


class _Date(NamedTuple):
    """Pieces of ground on one date: scored cells, moisture and error about their means (n,); bias, expected spread.

    ``pieces``: how many show moisture in scored cells.
    """

    weight: FloatArray
    truth: FloatArray
    error: FloatArray
    bias: float
    spread: float
    pieces: int


def _compared(images: Sequence[Image], scene: Scene, seed: int, run_id: int) -> _Date:
    """What the images of one date tell of its moisture, beside the truth."""
    sensors = [image.radar if isinstance(image, RadarImage) else image.radiometer for image in images]
    refuse_combination(sensors)
    if isinstance(images[0], RadarImage):
        radars = [image for image in images if isinstance(image, RadarImage)]
        retrieved, unit = retrieved_fields(radars, scene, seed, run_id)
    else:
        retrieved, unit = retrieved_squares(images[0], scene)
    cells, moisture = unit >= 0, images[0].occasion.field_moisture
    own, field = unit[cells], scene.field_id[cells]
    weight = np.bincount(own, minlength=len(retrieved)).astype(np.float64)
    used = weight > 0.0
    n_pieces = int(used.sum())
    spread = 0.0 if moisture is None else expected_spread(sensors[0], scene, own, field)
    if moisture is None or spread == 0.0:
        return _Date(np.zeros(0), np.zeros(0), np.zeros(0), 0.0, 0.0, n_pieces)
    truth = np.bincount(own, moisture[field], len(retrieved))[used] / weight[used]
    error = retrieved[used] - truth
    level, bias = np.average(truth, weights=weight[used]), float(np.average(error, weights=weight[used]))
    return _Date(weight[used], truth - level, error - bias, bias, spread, n_pieces)


def refuse_combination(sensors: Sequence[Sensor]) -> None:
    """Refuse with SceneError sensors from which moisture on a date is not retrieved together."""
    if len(sensors) > 1 and not all(isinstance(one, RadarConfiguration) for one in sensors):
        text = "moisture on a date is retrieved by radars or by one radiometer, not by a combination"
        remedy = (
            "Let each set hold radars only, or one radiometer, and compare such sets as levels of frequency; "
            "or give a radiometer dates of its own, by first_day in its [simulator.members]"
        )
        raise SceneError(text, remedy, field="utility")


def refuse_alike(sensors: Sequence[Sensor], scene: Scene) -> None:
    """Refuse with SceneError the sensors of a run whose ground is equally moist everywhere."""
    differ = any(one.soil_moisture_field_sd or one.soil_moisture_region_sd for one in sensors)
    if scene.soil_moisture is None and not differ:
        raise SceneError(*_ALIKE, field="utility")


def expected_spread(sensor: Sensor, scene: Scene, block: AnyArray, field: AnyArray) -> float:
    """Standard deviation of the mean moisture of pieces of ground about that of the scene, over all occasions [m3/m3].

    What a single occasion has of it changes by a fifth, where a scene is but a few correlation lengths wide. ``block``
    and ``field`` (n,): piece of ground and field of each cell that counts.
    """
    if not len(block):
        return 0.0
    weight = np.bincount(block) / len(block)
    used = np.flatnonzero(weight)
    layer = moisture_of_fields(scene)
    if layer is None:
        # A few hundred squares suffice for a mean over pairs.
        some = used[:: max(len(used) // _PAIRED, 1)]
        share, places = weight[some] / weight[some].sum(), centres_of_fields(scene)
        at = np.stack([np.bincount(block, side[field])[some] for side in places]) / np.bincount(block)[some]
        apart = at[:, :, None] - at[:, None, :]
        related = np.exp(-np.square(apart / sensor.soil_moisture_region_m).sum(axis=0))
        common = sensor.soil_moisture_region_sd**2 * float(1.0 - share @ related @ share)
    else:
        mean = np.bincount(block, layer[field])[used] / np.bincount(block)[used]
        common = float(np.cov(mean, aweights=weight[used], ddof=0))
    counts = cells_of_pairs(block, field, (len(weight), scene.n_fields))
    of_block, sizes = counts.power(2).sum(axis=1)[used], counts.sum(axis=1)[used]
    single = float(weight[used] @ (of_block / np.square(sizes)))
    single -= float(np.square(np.bincount(field) / len(field)).sum())  # what goes with the mean of all
    variance = common + sensor.soil_moisture_field_sd**2 * single
    return math.sqrt(variance) if variance > _DUST else 0.0
