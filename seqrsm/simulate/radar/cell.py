"""Resolution cells of a shape: GREY TONE's autocorrelation of given shape and length, RSL TR 380-1 section 3.2.

The length is the half-power width. A box is averaged in the kernels; other shapes are weights of pixels that are finer.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from scipy import ndimage

from seqrsm.arrays import AnyArray, FloatArray
from seqrsm.sensor.antenna import SINC_SQUARED_HALF

_REACH: Final = 8.0  # half-power widths to either side; 1.5 % of a sinc**2 lies beyond


def weights(shape: str, width: float) -> FloatArray:
    """Weights of a pixel and its neighbours in a line, which add up to 1.

    Parameters
    ----------
    shape : {"gaussian", "sinc_squared"}
        Of the response in power.
    width : float
        Between its half-power points [pixels].
    """
    away = np.arange(-math.ceil(_REACH * width), math.ceil(_REACH * width) + 1) / width
    w = 0.5 ** np.square(2.0 * away) if shape == "gaussian" else np.sinc(2.0 * SINC_SQUARED_HALF * away) ** 2
    return np.asarray(w / w.sum())


def spread(image: AnyArray, shape: str, down: FloatArray, along: FloatArray) -> AnyArray:
    """Average over resolution cells; at the rim over the part inside the image.

    Parameters
    ----------
    image : float array (n_channels, n_rows, n_columns)
        Power of each pixel's own ground.
    shape : str
        As of `weights`.
    down, along : float64 arrays (n_rows,)
        Half-power widths of each row's cells across the rows and along them [pixels].
    """
    n, one = image.shape[1], np.ones(image.shape[2])
    rows = np.empty_like(image)
    for i, width in enumerate(along):
        w = weights(shape, width)
        inside = ndimage.convolve1d(one, w, mode="constant")
        rows[:, i] = ndimage.convolve1d(image[:, i], w, mode="constant") / inside
    out = np.empty_like(image)
    for i, width in enumerate(down):
        w = weights(shape, width)
        first = i - len(w) // 2
        w = w[max(-first, 0) : n - first]
        first = max(first, 0)
        out[:, i] = np.tensordot(rows[:, first : first + len(w)], w / w.sum(), axes=(1, 0))
    return out
