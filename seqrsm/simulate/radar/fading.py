"""Resolution cells of a shape, and fading: the gamma law of any real number of looks, its correlation in fine pixels.

Cells have GREY TONE's autocorrelation of given shape and length, RSL TR 380-1 section 3.2, which is the half-power
width. A box is averaged in the kernels; other shapes are weights of pixels that are finer.

A uniform word becomes a normal variate by a table of quantiles, and that a gamma variate of the same probability by a
table of y in ``X = (1 + y / (3 sqrt(N)))**3``, in which y is smooth in the normal variate and in 1 / sqrt(N) and tends
to the normal variate itself for large N (Wilson and Hilferty 1931). The tables move no probability by more than 1e-6,
nor by more than 2e-5 of itself above 1e-4; fading ends at the probability 2**-33 on either side.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Final

import numpy as np
import scipy
from numpy.polynomial import chebyshev
from scipy.special import gammainccinv, gammaincinv, ndtr, ndtri

from seqrsm.arrays import AnyArray, FloatArray, IntArray
from seqrsm.sensor.antenna import SINC_SQUARED_HALF
from seqrsm.simulate.radar import kernels_speckle
from seqrsm.simulate.radar.kernels_speckle import CUBE_ROOT_REACH, CUBE_ROOT_STEPS, NORMAL_STEPS

_REACH: Final = 8.0  # half-power widths to either side; 1.5 % of a sinc**2 lies beyond


def cell_weights(shape: str, width: float) -> FloatArray:
    """Weights of a pixel and its neighbours in a line, which add up to 1.

    Of a response in power of a shape, "gaussian" or "sinc_squared", so wide between its half-power points [pixels].
    """
    away = np.arange(-math.ceil(_REACH * width), math.ceil(_REACH * width) + 1) / width
    w = 0.5 ** np.square(2.0 * away) if shape == "gaussian" else np.sinc(2.0 * SINC_SQUARED_HALF * away) ** 2
    return np.asarray(w / w.sum())


def spread_over_cells(image: AnyArray, shape: str, down: FloatArray, along: FloatArray) -> AnyArray:
    """Average power of pixels (n_channels, n_rows, n_columns) over resolution cells of a shape as of `cell_weights`.

    At the rim over the part inside the image. ``down`` and ``along`` (n_rows,): half-power widths of each row's cells
    across the rows and along them [pixels].
    """
    n, one = image.shape[1], np.ones(image.shape[2])
    rows = np.empty_like(image)
    for i, width in enumerate(along):
        w = cell_weights(shape, width)
        inside = scipy.ndimage.convolve1d(one, w, mode="constant")
        rows[:, i] = scipy.ndimage.convolve1d(image[:, i], w, mode="constant") / inside
    out = np.empty_like(image)
    for i, width in enumerate(down):
        w = cell_weights(shape, width)
        first = i - len(w) // 2
        w = w[max(-first, 0) : n - first]
        first = max(first, 0)
        out[:, i] = np.tensordot(rows[:, first : first + len(w)], w / w.sum(), axes=(1, 0))
    return out


_ORDER = 16
"""Order of the Chebyshev series of y in 1 / sqrt(N), 0 to 1: it is right to 2e-6."""


@lru_cache(maxsize=1)
def normal_table() -> AnyArray:
    """Normal quantiles of probabilities from 2**-33 to 1/2, and their rise to the next: real and imaginary part."""
    octave, step = np.divmod(np.arange(32 * NORMAL_STEPS + 1), NORMAL_STEPS)
    z = ndtri((1.0 + step / NORMAL_STEPS) * 2.0 ** (octave - 33.0))
    return np.asarray(z + 1j * np.append(np.diff(z), 0.0))


def gamma_tables(looks: FloatArray) -> tuple[FloatArray, IntArray]:
    """Tables of y for the rows of an image, by its numbers of ``looks`` (n_range,), N >= 1.

    float64 (n_tables, k), four coefficients of a cubic in each step of the normal variate, a table for each N; and
    which of them each row takes (n_range,).
    """
    return _tables(looks.tobytes())


@lru_cache(maxsize=4)  # the channels of an image ask for the same, and the phase for that of one look
def _tables(looks: bytes) -> tuple[FloatArray, IntArray]:
    different, which = np.unique(np.frombuffer(looks), return_inverse=True)
    # T_k(cos a) = cos(k a): the recurrence in Python takes ten times as long.
    angle = np.arccos(2.0 / np.sqrt(different) - 1.0)
    return np.cos(np.arange(_ORDER + 1) * angle[:, None]) @ _series(), which


@lru_cache(maxsize=1)
def _series() -> FloatArray:
    """Chebyshev coefficients in 1 / sqrt(N) of the coefficients of every step's cubic (order + 1, k)."""
    nodes = np.arange(-1, 2 * round(CUBE_ROOT_REACH * CUBE_ROOT_STEPS) + 3) / CUBE_ROOT_STEPS - CUBE_ROOT_REACH
    at = np.cos(math.pi * (np.arange(_ORDER + 1) + 0.5) / (_ORDER + 1))
    spread = (0.5 * (at + 1.0))[:, None]
    # Each tail from its own side: 1 - p would lose the digits of the upper one.
    low = gammaincinv(spread**-2, ndtr(np.minimum(nodes, 0.0)))
    high = gammainccinv(spread**-2, ndtr(-np.maximum(nodes, 0.0)))
    y = 3.0 * (np.cbrt(np.where(nodes < 0.0, low, high) * spread**2) - 1.0) / spread
    series = np.linalg.solve(chebyshev.chebvander(at, _ORDER), y)
    # The cubic through the nodes on either side of a step and the next ones beyond.
    a, b, c, d = (series[:, k : series.shape[1] - 3 + k] for k in range(4))
    cubic = (b, c - a / 3.0 - b / 2.0 - d / 6.0, 0.5 * (a + c) - b, (d - a) / 6.0 + 0.5 * (b - c))
    return np.asarray(np.stack(cubic, axis=2).reshape(len(series), -1))


def correlated_fading(
    shape: tuple[int, ...],
    looks: FloatArray,
    numbers: IntArray,
    key: tuple[np.uint32, np.uint32],
    cell_pixels: tuple[float, float],
    cell_shape: str = "box",
) -> FloatArray:
    """Factor X of eq. (3-11) with the autocorrelation of overlapping resolution cells, float64 of ``shape``.

    White normal variates are averaged over the resolution cell, which correlates two pixels by the share of their cells
    that overlap; each is then turned into the gamma variate of the same probability. The law of one pixel is that of a
    pixel on its own, and the correlation is that of the normal variates to a few hundredths.

    ``shape``: (n_channels, n_range, n_azimuth). ``looks`` (n_range,): N >= 1. ``numbers`` (n_channels,): of each
    channel in the random counter. ``cell_pixels``: size of the resolution cell in range and azimuth [pixels], >= 1.
    ``cell_shape``: as of `RadarConfiguration`.
    """
    n_channels, n_range, n_azimuth = shape
    around = [_unit(_box(size) if cell_shape == "box" else cell_weights(cell_shape, size)) for size in cell_pixels]
    (tables, which), spread = gamma_tables(looks), 1.0 / np.sqrt(looks)
    out = np.empty(shape)
    for c in range(n_channels):
        white = np.empty((n_range + len(around[0]) - 1, n_azimuth + len(around[1]) - 1))
        kernels_speckle.fill_normal(int(numbers[c]), normal_table(), *key, white)
        down = sum(w * white[k : k + n_range] for k, w in enumerate(around[0]))
        z = sum(w * np.asarray(down)[:, k : k + n_azimuth] for k, w in enumerate(around[1]))
        kernels_speckle.fade(np.asarray(z), tables, which, spread, out[c])
    return out


def _box(size: float) -> FloatArray:
    """Weights of a box of ``size`` pixels with broken ends."""
    whole = math.floor(size)
    rest = size - whole
    return np.ones(whole) if rest < 1e-9 else np.concatenate(([rest], np.ones(whole)))


def _unit(weights: FloatArray) -> FloatArray:
    """Weights whose squares add up to 1."""
    return np.asarray(weights / math.sqrt(float(weights @ weights)))


def fade_together(
    hh: AnyArray,
    vv: AnyArray,
    both: AnyArray,
    noise: FloatArray,
    looks: FloatArray,
    free: AnyArray,
    out_hh: AnyArray,
    out_vv: AnyArray,
    out_both: AnyArray,
) -> None:
    """Fading of HH and VV as they are related, and of them added: the complex Wishart law of N looks, any real one.

    Bartlett's decomposition (Goodman 1963, Ann. Math. Stat. 34, 152-177): HH fades as it does alone, and VV is in part
    what HH is, in part what it would be alone. Of the latter a share of the law Beta(1, N - 1) has a phase.

    Parameters
    ----------
    hh, vv : float arrays (n_range, n_azimuth)
        Mean power of the ground [W].
    both : float array (2, n_range, n_azimuth)
        Mean power of HH + VV and of HH + i VV, each over 2 [W].
    noise, looks : float64 arrays (n_range,)
        Mean power of the receiver noise [W]; N, >= 1.
    free : float array (2, n_range, n_azimuth)
        Fading of one look: the law exp(-x).
    out_hh, out_vv : float arrays (n_range, n_azimuth)
        Power with noise and fading, each faded alone [W]; that of VV is written anew.
    out_both : float array (2, n_range, n_azimuth)
        Written.
    """
    m, per_rest = hh.shape[1], 1.0 / np.maximum(looks - 1.0, 1e-9)
    planes = hh, vv, *both, out_hh, out_vv, *free, *out_both
    *means, hh, vv, first, second, plus, turned = (plane.reshape(-1) for plane in planes)
    w = np.empty((8, kernels_speckle.LINE))
    for begin in range(0, hh.size, kernels_speckle.LINE):
        at = slice(begin, min(begin + kernels_speckle.LINE, hh.size))
        line, row = w[:, : at.stop - begin], np.arange(begin, at.stop) // m
        add = noise[row]
        for own, mean in zip(line, means, strict=False):
            np.add(mean[at], add, out=own)
        line[4], line[5], line[7] = hh[at], vv[at], np.exp(-second[at])
        np.exp(-first[at] * per_rest[row], out=line[6])
        kernels_speckle.relate(w.reshape(-1), np.uint64(line.shape[1]))
        vv[at], plus[at], turned[at] = line[5], line[2], line[3]
