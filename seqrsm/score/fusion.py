"""Percent of ground classified correctly by all images of a set together: dates, bands, radar beside radiometer.

Pixels are those of the finest image; another image's values are averaged over the cells of each. The classifier's law
is one Gaussian over all channels of all images, so it knows that a field which is late on one date is late on the next.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from seqrsm.arrays import AnyArray
from seqrsm.score import kernels_classify
from seqrsm.score.classification import UtilityScore, decibels, pixels_of_radar, score_pixels, with_names
from seqrsm.score.retrieval import brightness_and_angle, pixels_of_radiometer
from seqrsm.simulate.radar.result import RadarImage

if TYPE_CHECKING:
    from seqrsm.scene.scene import Scene
    from seqrsm.simulate.radiometer.result import RadiometerImage

    Image = RadarImage | RadiometerImage


def percent_correct_of_set(images: Sequence[Image], scene: Scene, *, seed: int, run_id: int) -> UtilityScore:
    """Percent of scored cells named rightly by what all images show; see `seqrsm.score.classification.percent_correct`.

    Decibels of radars, brightness of radiometers, the latter conditional on the look angle. What an image does not see
    of a pixel is taken for the mean of what it sees.

    Parameters
    ----------
    images : sequence of RadarImage or RadiometerImage
        Of one ground, one at least.
    scene : Scene
        The scene they were made of.
    seed, run_id : int
        Key of the split into halves.

    Raises
    ------
    SceneError
        No scored cell lies in the finest image.
    """
    base = min(images, key=_side_m)
    key = {"seed": seed, "run_id": run_id}
    if isinstance(base, RadarImage):
        pixel, counts, tile, keys = pixels_of_radar(base, scene, **key)
    else:
        pixel, counts, tile, keys = pixels_of_radiometer(base, scene, **key)
    places: list[tuple[Image, AnyArray]] = [(base, pixel)]
    evidence, angles = [], []
    for image in images:
        if isinstance(image, RadarImage):
            layers = np.asarray(image.apparent_sigma0().reshape(len(image.intensity), -1))
        else:
            layers = brightness_and_angle(image)
        own = next((found for other, found in places if _same_grid(other, image)), None)
        if own is None:
            own = image.pixel_of_cell
            places.append((image, own))
        if own is not pixel:
            layers = kernels_classify.mean_of_pixels(pixel, own, layers, len(counts))
        if isinstance(image, RadarImage):
            evidence.append(decibels(layers, counts))
        else:
            evidence.append(layers[:-1])
            angles.append(layers[-1:])
    features = np.vstack([*evidence, *angles], dtype=np.float64)
    used = counts.any(axis=1)
    for row in features:
        unseen = np.isnan(row)
        if unseen.any():
            seen = used & ~unseen
            row[unseen] = row[seen].mean() if seen.any() else 0.0
    return with_names(score_pixels(features, counts, tile, keys, covariates=len(angles)), scene.categories)


def _side_m(image: Image) -> float:
    """Side of a pixel on the ground [m]."""
    return image.radar.pixel_spacing_m if isinstance(image, RadarImage) else image.radiometer.resolution_m


def _same_grid(one: Image, other: Image) -> bool:
    """Whether two images have the same pixels: those of one radar on two dates."""
    if isinstance(one, RadarImage) and isinstance(other, RadarImage):
        return one.radar == other.radar
    return one is other
