"""Error and skill of retrieved soil moisture: of squares of ground by a radiometer, of bare fields by a radar."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np

from seqrsm.arrays import AnyArray
from seqrsm.errors import Problem, SceneError
from seqrsm.scene.layers import centres_of_fields, moisture_of_fields
from seqrsm.score.bare_soil import retrieved_fields
from seqrsm.score.brightness import retrieved_squares
from seqrsm.score.classification import UtilityScore, cluster_ratio
from seqrsm.score.utilities import Asked
from seqrsm.simulate.radar.result import RadarImage

if TYPE_CHECKING:
    from seqrsm.scene.scene import Scene
    from seqrsm.score.evidence import Image
    from seqrsm.simulate.soil import Sensor

_PAIRED: Final = 400  # squares or fields that a mean over pairs is made of


def score_moisture(images: Sequence[Image], scene: Scene, asked: Asked, *, seed: int, run_id: int) -> UtilityScore:
    """Error or skill of soil moisture over scored cells of covers that show any.

    A radiometer's image gives the mean of squares of 250 m (`seqrsm.score.brightness`), a radar's the moisture of bare
    fields (`seqrsm.score.bare_soil`). "soil_moisture_error" is the unbiased root mean square error [m3/m3]: errors
    about their mean. "soil_moisture_skill" is one less its square over the variance that the truth has on average: 0
    for a guess of the mean, 1 where all is known.

    Parameters
    ----------
    images : sequence of RadarImage or RadiometerImage
        One.
    scene : Scene
        The scene it was made of.
    asked : Asked
    seed, run_id : int
        Key of the tiles that a field larger than one is divided by.

    Returns
    -------
    UtilityScore
        Details: ``truth_sd``, of this occasion, and ``bias`` [m3/m3], ``skill``.

    Raises
    ------
    SceneError
        No scored cell in the image has a cover that shows moisture, or all are as wet.
    """
    image = images[0]
    if isinstance(image, RadarImage):
        sensor: Sensor = image.radar
        retrieved, unit = retrieved_fields(image, scene, seed, run_id)
    else:
        sensor = image.radiometer
        retrieved, unit = retrieved_squares(image, scene)
    cells, moisture = unit >= 0, image.occasion.field_moisture
    own, field = unit[cells], scene.field_id[cells]
    spread = 0.0 if moisture is None else expected_spread(sensor, scene, own, field)
    if moisture is None or spread == 0.0:
        remedy = "Choose another utility, or let fields differ (soil_moisture_field_sd, soil_moisture_region_sd)."
        raise SceneError(Problem("no scored cells show how moist the soil is", remedy, field="utility"))
    weight = np.bincount(own, minlength=len(retrieved)).astype(np.float64)
    truth = np.bincount(own, moisture[field], len(retrieved)) / np.maximum(weight, 1.0)
    error = retrieved - truth
    bias = float(np.average(error, weights=weight))
    used = weight > 0.0
    square, se = cluster_ratio((weight * (error - bias) ** 2)[used], weight[used], np.arange(int(used.sum())))
    skill = 1.0 - square / spread**2
    details: dict[str, object] = {
        "truth_sd": float(np.sqrt(np.cov(truth[used], aweights=weight[used], ddof=0))),
        "bias": bias,
        "skill": skill,
    }
    n_cells, n_used = int(weight.sum()), int(used.sum())
    if asked.name == "soil_moisture_skill":
        return UtilityScore(skill, se / spread**2, 0.0, 1.0, n_cells, n_used, details=details)
    rmse = math.sqrt(square)
    return UtilityScore(rmse, se / (2.0 * rmse) if rmse > 0.0 else 0.0, spread, 0.0, n_cells, n_used, details=details)


def expected_spread(sensor: Sensor, scene: Scene, block: AnyArray, field: AnyArray) -> float:
    """Standard deviation of the mean moisture of pieces of ground about that of the scene, over all occasions [m3/m3].

    What a single occasion has of it changes by a fifth, where a scene is but a few correlation lengths wide.

    Parameters
    ----------
    sensor : RadarConfiguration or RadiometerConfiguration
    scene : Scene
    block, field : int arrays (n,)
        Piece of ground and field of each cell that counts.
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
    cells = np.unique(block.astype(np.int64) * scene.n_fields + field, return_counts=True)
    of_block = np.bincount(cells[0] // scene.n_fields, np.square(cells[1].astype(np.float64)))[used]
    single = float(weight[used] @ (of_block / np.square(np.bincount(block)[used])))
    return math.sqrt(common + sensor.soil_moisture_field_sd**2 * single)
