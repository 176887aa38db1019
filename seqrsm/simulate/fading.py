"""Fading of pixels finer than the resolution cell: neighbours see part of the same ground and fade together."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import gammainccinv, gammaincinv, ndtr

from seqrsm.arrays import AnyArray, FloatArray, IntArray
from seqrsm.simulate.kernels_speckle import fill_normal


def correlated_fading(
    shape: tuple[int, ...],
    looks: FloatArray,
    numbers: IntArray,
    key: tuple[np.uint32, np.uint32],
    cell_pixels: tuple[float, float],
    *,
    gaussian: bool,
) -> FloatArray:
    """Factor X of eq. (3-11) or (3-12) with the autocorrelation of overlapping resolution cells.

    White normal variates are averaged over the resolution cell, which correlates two pixels by the share of their cells
    that overlap; each is then turned into the gamma variate of the same probability. The law of one pixel is exact, and
    the correlation is that of the normal variates to a few hundredths.

    Parameters
    ----------
    shape : tuple of int
        (n_channels, n_range, n_azimuth).
    looks : float64 array (n_range,)
        N, >= 1.
    numbers : int array (n_channels,)
        Number of each channel in the random counter.
    key : tuple of uint32
    cell_pixels : tuple of float
        Size of the resolution cell in range and azimuth [pixels], >= 1.
    gaussian : bool
        Eq. (3-12), 0 where it is negative.

    Returns
    -------
    float64 array of `shape`
    """
    n_channels, n_range, n_azimuth = shape
    weights = [_box(size) for size in cell_pixels]
    out = np.empty(shape)
    for c in range(n_channels):
        white = np.empty((n_range + len(weights[0]) - 1, n_azimuth + len(weights[1]) - 1))
        fill_normal(int(numbers[c]), 0, 0, *key, white)
        down = sum(w * white[k : k + n_range] for k, w in enumerate(weights[0]))
        z = sum(w * np.asarray(down)[:, k : k + n_azimuth] for k, w in enumerate(weights[1]))
        out[c] = _quantile(np.asarray(z), looks[:, None], gaussian)
    return out


def _box(size: float) -> FloatArray:
    """Weights of a box of ``size`` pixels with broken ends, whose squares add up to 1."""
    whole = math.floor(size)
    rest = size - whole
    weights = np.ones(whole) if rest < 1e-9 else np.concatenate(([rest], np.ones(whole)))
    return np.asarray(weights / math.sqrt(float(weights @ weights)))


def _quantile(z: FloatArray, looks: FloatArray, gaussian: bool) -> FloatArray:
    """Fading of mean 1 at the probability of normal variates."""
    if gaussian:
        return np.asarray(np.maximum(1.0 + z / np.sqrt(looks), 0.0))
    shape: AnyArray = np.broadcast_to(looks, z.shape)
    # Each tail from its own side: 1 - p would lose the digits of the upper one.
    low = gammaincinv(shape, ndtr(np.minimum(z, 0.0)))
    high = gammainccinv(shape, ndtr(-np.maximum(z, 0.0)))
    return np.asarray(np.where(z < 0.0, low, high) / shape)
