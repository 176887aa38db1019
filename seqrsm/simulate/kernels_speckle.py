"""Random numbers of the image: fading and receiver noise, by a counter-based generator.

One self-contained file, as every kernel file. A pixel's number is a function of key and pixel, so it does not depend on
the size of the image, the order of the loops or the number of threads.
"""

from __future__ import annotations

import math

import numpy as np

from seqrsm.arrays import AnyArray
from seqrsm.jit import kernel

_M0 = np.uint64(0xD2511F53)
_M1 = np.uint64(0xCD9E8D57)
_W0 = np.uint32(0x9E3779B9)
_W1 = np.uint32(0xBB67AE85)
_LOW = np.uint64(0xFFFFFFFF)
_SHIFT = np.uint64(32)


@kernel
def philox4x32(
    c0: np.uint32, c1: np.uint32, c2: np.uint32, c3: np.uint32, k0: np.uint32, k1: np.uint32
) -> tuple[np.uint32, np.uint32, np.uint32, np.uint32]:
    """Four random words of a counter and a key: Philox4x32 with ten rounds (Salmon et al. 2011).

    Parameters
    ----------
    c0, c1, c2, c3 : uint32
        Counter.
    k0, k1 : uint32
        Key.

    Returns
    -------
    tuple of four uint32
    """
    for _ in range(10):
        p0 = np.uint64(c0) * _M0
        p1 = np.uint64(c2) * _M1
        c0, c1, c2, c3 = (
            np.uint32(np.uint32(p1 >> _SHIFT) ^ c1 ^ k0),
            np.uint32(p1 & _LOW),
            np.uint32(np.uint32(p0 >> _SHIFT) ^ c3 ^ k1),
            np.uint32(p0 & _LOW),
        )
        k0 = np.uint32(k0 + _W0)
        k1 = np.uint32(k1 + _W1)
    return c0, c1, c2, c3


@kernel
def normal_at(row: int, column: int, channel: int, k0: np.uint32, k1: np.uint32) -> float:
    """Standard normal variate of a pixel by Box and Muller, from a stream of its own.

    Parameters
    ----------
    row, column, channel : int
        Pixel, < 2**32.
    k0, k1 : uint32
        Key.

    Returns
    -------
    float
    """
    w0, w1, w2, _ = philox4x32(np.uint32(row), np.uint32(column), np.uint32(channel), np.uint32(1), k0, k1)
    u = ((w0 >> np.uint32(5)) * 67108864.0 + (w1 >> np.uint32(6)) + 0.5) / 9007199254740992.0
    return math.sqrt(-2.0 * math.log(u)) * math.cos(2.0 * math.pi * ((w2 + 0.5) / 4294967296.0))


@kernel
def fill_normal(channel: int, row: int, column: int, k0: np.uint32, k1: np.uint32, out: AnyArray) -> None:
    """Standard normal variates of pixels from (row, column) on.

    Parameters
    ----------
    channel, row, column : int
        Channel and first pixel.
    k0, k1 : uint32
        Key.
    out : float64 array (n_range, n_azimuth)
        Written.
    """
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = normal_at(row + i, column + j, channel, k0, k1)


@kernel
def gamma_mean_one(
    shape: float, row: int, column: int, channel: int, k0: np.uint32, k1: np.uint32, scale: float, root: float
) -> float:
    """One gamma variate of mean 1 and variance 1/shape at a pixel, exact for any real shape >= 1.

    Marsaglia and Tsang (2000), A simple method for generating gamma variables. The attempt is part of the counter, so a
    rejection at one pixel moves no other pixel's numbers.

    Parameters
    ----------
    shape : float
        Number of looks N, >= 1.
    row, column, channel : int
        Pixel, < 2**32; channel < 2**16.
    k0, k1 : uint32
        Key.
    scale, root : float
        ``shape - 1/3`` and ``1 / sqrt(9 * scale)``, the same for a whole row.

    Returns
    -------
    float
    """
    attempt = 0
    while True:
        counter = np.uint32(channel * 65536 + attempt)
        w0, w1, w2, w3 = philox4x32(np.uint32(row), np.uint32(column), counter, np.uint32(0), k0, k1)
        # 53 bits for the radius, so that the normal's tail reaches 8.5 sd; never zero.
        u = ((w0 >> np.uint32(5)) * 67108864.0 + (w1 >> np.uint32(6)) + 0.5) / 9007199254740992.0
        x = math.sqrt(-2.0 * math.log(u)) * math.cos(2.0 * math.pi * ((w2 + 0.5) / 4294967296.0))
        v = 1.0 + root * x
        if v > 0.0:
            v = v * v * v
            accept = (w3 + 0.5) / 4294967296.0
            x2 = x * x
            if accept < 1.0 - 0.0331 * x2 * x2 or math.log(accept) < 0.5 * x2 + scale * (1.0 - v + math.log(v)):
                return scale * v / shape
        attempt += 1


@kernel
def add_speckle(
    mean: AnyArray,
    noise: AnyArray,
    looks: AnyArray,
    numbers: AnyArray,
    k0: np.uint32,
    k1: np.uint32,
    gaussian: bool,
    first_row: int,
    out: AnyArray,
) -> None:
    """Add the receiver's noise in power, then fading, once per resolution cell: RSL TR 380-1 eqs. (3-11), (3-12).

    Parameters
    ----------
    mean : float array (n_channels, n_range, n_azimuth)
        Mean power of the ground [W].
    noise : float64 array (n_range,)
        Mean power of the receiver noise [W].
    looks : float64 array (n_range,)
        Independent samples N of a pixel, >= 1.
    numbers : int64 array (n_channels,)
        Number of each channel in the counter: a channel fades alike whoever is imaged beside it.
    k0, k1 : uint32
        Key of the run's speckle.
    gaussian : bool
        Eq. (3-12) in place of (3-11): 1 + Z/sqrt(N), and 0 where that is negative.
    first_row : int
        Row of the image in which these arrays begin.
    out : float array, shape of `mean`
        Written: power with noise and speckle [W].
    """
    n_channels, n_range, n_azimuth = mean.shape
    for c in range(n_channels):
        for i in range(n_range):
            shape = looks[i]
            scale = shape - 1.0 / 3.0
            root = 1.0 / math.sqrt(9.0 * scale)
            if gaussian:
                spread = 1.0 / math.sqrt(shape)
                for j in range(n_azimuth):
                    normal = normal_at(first_row + i, j, numbers[c], k0, k1)
                    out[c, i, j] = (mean[c, i, j] + noise[i]) * max(1.0 + spread * normal, 0.0)
                continue
            for j in range(n_azimuth):
                fading = gamma_mean_one(shape, first_row + i, j, numbers[c], k0, k1, scale, root)
                out[c, i, j] = (mean[c, i, j] + noise[i]) * fading
