"""What tests and studies ask for in one call: a score in tiles, an image of still ground, draws, what days leave."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from threading import current_thread, main_thread
from typing import Any
from unittest import mock

import numpy as np
from scipy.optimize import brentq
from scipy.special import gamma, kv

from seqrsm.fit import ensemble
from seqrsm.fit.target import build_target
from seqrsm.scene.layers import categories_of_fields
from seqrsm.scene.scene import Scene
from seqrsm.score import pixels
from seqrsm.score.classification import UtilityScore
from seqrsm.score.cover import score_cover
from seqrsm.score.pixels import Image
from seqrsm.score.utilities import Asked
from seqrsm.simulate.radiometer import prm
from seqrsm.simulate.radiometer.occasion import (
    RadiometerOccasion,
    Stages,
    draw_radiometer_occasion,
    nominal_radiometer_occasion,
)
from seqrsm.simulate.radiometer.result import RadiometerImage
from seqrsm.simulate.visits import Visit


@contextmanager
def tiles_of(side_m: float) -> Iterator[None]:
    """Tiles of ground of this side [m], whatever image and scene: for the whole process, so in no thread of several."""
    assert current_thread() is main_thread()  # two that end in the wrong order would leave it to all later tests
    with mock.patch.object(pixels, "tile_m", return_value=side_m):
        yield


def percent_correct(
    images: Sequence[Image], scene: Scene, *, by: str = "pixel", tile_m: float | None = None, **key: int
) -> UtilityScore:
    """Percent of scored cells named rightly; ``tile_m``: side of a tile of ground [m], else that of a campaign."""
    with nullcontext() if tile_m is None else tiles_of(tile_m):
        return score_cover(images, scene, Asked("percent_correct", by=by), **key)


def still_radiometer(scene: Scene, radiometer: Any, table: Any, **options: Any) -> RadiometerImage:
    """Image of ground as the table has it, at the middle of the moistures; options as of `simulate_radiometer`."""

    def still(radiometer: Any, lookups: Any, _: Stages, scene: Scene, *__: Any, **___: int) -> Any:
        return nominal_radiometer_occasion(radiometer, lookups, scene)

    with mock.patch.object(prm, "draw_radiometer_occasion", still):
        return prm.simulate_radiometer(scene, radiometer, table, **options)


def left(gap: float, memory: float) -> float:
    """Matérn's correlation of order 3/2 (Rasmussen and Williams 2006, eq. 4.14), 1/e after the memory; both in days."""

    def related(x: float) -> float:
        return 2.0**-0.5 / gamma(1.5) * x**1.5 * kv(1.5, x) if x > 0.0 else 1.0

    return related(gap / memory * brentq(lambda x: related(x) - np.exp(-1.0), 1.0, 4.0))


def met_on_time(radiometer: Any, lookups: Any, scene: Scene, visit: Visit, **key: int) -> RadiometerOccasion:
    """What a radiometer meets where neither years nor fields are early or late."""
    names = lookups[0].categories
    stages = Stages(names, None, np.arange(len(names)), categories_of_fields(scene))
    return draw_radiometer_occasion(radiometer, lookups, stages, scene, visit, **key)


def sample_posterior(
    Z: np.ndarray, y: np.ndarray, w: Any = 1.0, *, errors: Any = None, prior: Any = None, bounds: Any = None, seed: int
) -> ensemble.Sampled:
    """Draws of the ensemble sampler; without more said of normal errors of one variance, under a flat prior."""
    target = build_target(Z, y, np.broadcast_to(w, len(y)), errors, prior, bounds)
    return ensemble.sample(target, seed)
