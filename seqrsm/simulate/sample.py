"""What a cheaper rung hands to a utility: some pixels of the image, and what they stand for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from seqrsm.arrays import AnyArray, BoolArray, FloatArray, IntArray


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """Pixels of one occasion, a part of an image or all of it.

    Attributes
    ----------
    values : float64 array (n_draws, n_channels, n_pixels)
        What the image shows: apparent sigma0 [1] or brightness [K], once for each draw of fading or receiver noise.
    across_m, along_m : float64 array (n_pixels,)
        Centre of each pixel from the image's near or left edge, and from its beginning [m].
    extent_m : tuple of float
        Of the whole image across and along [m].
    column : int64 array (n_pixels,)
        Number of the sampled column a pixel belongs to, 0, 1, ... in the order of place; of the pixel itself where
        single pixels are sampled.
    share : float
        Part of the image's pixels that were taken, 0 to 1.
    pixel_of_cell : int32 array (a, b)
        Pixel of each cell of the data base that was looked at; -1 for none.
    cover : uint8 array (a, b)
    field : int32 array (a, b)
    scored : bool array (a, b)
        Layers of those cells.
    covariates : float64 array (n_pixels, n) or None
        Known for each pixel, no evidence of its class.
    moist : bool array (n_categories,) or None
        Categories whose emissivity depends on soil moisture.
    occasion : object
        State of the ground in this run.
    record : Mapping
        What is kept with a score.
    """

    values: FloatArray
    across_m: FloatArray
    along_m: FloatArray
    extent_m: tuple[float, float]
    column: IntArray
    share: float
    pixel_of_cell: AnyArray
    cover: AnyArray
    field: AnyArray
    scored: BoolArray
    covariates: FloatArray | None
    moist: BoolArray | None
    occasion: Any
    record: Mapping[str, Any]


def places(n: int, k: int, start: float) -> IntArray:
    """``k`` of ``n`` numbers in equal steps from a start in [0, 1) of the first step; all of them where k >= n."""
    if k >= n:
        return np.arange(n, dtype=np.int64)
    return np.minimum(((start + np.arange(k)) * (n / k)).astype(np.int64), n - 1)
