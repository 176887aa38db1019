"""Random numbers of the image: fading and receiver noise, by a counter-based generator.

One self-contained file, as every kernel file. A pixel's number is a function of key and pixel, so it does not depend on
the size of the image, the order of the loops or the number of threads.
"""

from __future__ import annotations

import numpy as np

from seqrsm.arrays import AnyArray
from seqrsm.jit import kernel

_M0 = np.uint64(0xD2511F53)
_M1 = np.uint64(0xCD9E8D57)
_W0 = np.uint32(0x9E3779B9)
_W1 = np.uint32(0xBB67AE85)
_LOW = np.uint64(0xFFFFFFFF)
_SHIFT = np.uint64(32)

LINE = 4160
"""Length of the lines of `relate`: no power of two, which caches would fold together."""

_FIRST, _SECOND, _REAL, _IMAGINARY = (np.uint64(k * LINE) for k in range(4))
_HH, _VV, _REST, _ANGLE = (np.uint64(k * LINE) for k in range(4, 8))

NORMAL_STEPS = 128
"""Steps of the table of normal quantiles in each factor of 2 of the probability, 32 of them from 2**-33 to 1/2."""

CUBE_ROOT_STEPS = 8
"""Steps of the tables of gamma quantiles in a unit of the normal variate."""

CUBE_ROOT_REACH = 6.5
"""Normal variate at which those tables end on either side."""


@kernel
def philox4x32(
    c0: np.uint32, c1: np.uint32, c2: np.uint32, c3: np.uint32, k0: np.uint32, k1: np.uint32
) -> tuple[np.uint32, np.uint32, np.uint32, np.uint32]:
    """Four random words of a counter c and a key k: Philox4x32 with ten rounds (Salmon et al. 2011)."""
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
def fill_normal(channel: int, table: AnyArray, k0: np.uint32, k1: np.uint32, out: AnyArray) -> None:
    """Standard normal variates of pixels, by the quantile of a uniform word, as far as 6.33 either way.

    ``out`` (n_range, n_azimuth) is written; ``table``: of `seqrsm.simulate.radar.fading.normal_table`.
    """
    blocks = (out.shape[1] + 3) // 4
    words, places = np.empty(4 * blocks, dtype=np.uint32), np.empty(4 * blocks, dtype=np.int32)
    pairs = np.empty(4 * blocks, dtype=table.dtype)
    for i in range(out.shape[0]):
        _words_row(i, channel, blocks, k0, k1, words)
        _normal_row(words, table, places, pairs, out[i])


@kernel
def _words_row(row: int, channel: int, blocks: int, k0: np.uint32, k1: np.uint32, words: AnyArray) -> None:
    """Random words of a row of pixels; the four words of a counter go to four neighbours."""
    for block in range(blocks):
        four = philox4x32(np.uint32(row), np.uint32(block), np.uint32(channel), np.uint32(0), k0, k1)
        words[4 * block] = four[0]
        words[4 * block + 1] = four[1]
        words[4 * block + 2] = four[2]
        words[4 * block + 3] = four[3]


@kernel
def _normal_row(words: AnyArray, table: AnyArray, places: AnyArray, pairs: AnyArray, out: AnyArray) -> None:
    """Normal quantiles of a row of words: the top bit is the sign, the rest the probability beyond it.

    Exponent and leading bits of the probability as a floating number are the place in the table, so that its steps are
    fine in the tail. The access to the table stands in a loop of its own, so that the others vectorise.
    """
    for j in range(out.shape[0]):
        bits = np.float32(np.float32(words[j] & np.uint32(0x7FFFFFFF)) + np.float32(0.5)).view(np.int32)
        # 23 bits of mantissa: 7 for the step, 16 for the part of it.
        places[j] = (bits >> np.int32(16)) - np.int32(126 * NORMAL_STEPS)
        out[j] = (bits & np.int32(0xFFFF)) * (1.0 / 65536.0)
    for j in range(out.shape[0]):
        pairs[j] = table[np.uint32(places[j])]
    for j in range(out.shape[0]):
        z = pairs[j].real + out[j] * pairs[j].imag
        out[j] = z if words[j] >> np.uint32(31) else -z


@kernel
def fade(normal: AnyArray, tables: AnyArray, which: AnyArray, spread: AnyArray, out: AnyArray) -> None:
    """Fading of mean 1 at the probability of normal variates (n_range, n_azimuth): RSL TR 380-1 eq. (3-11).

    ``tables`` and ``which``, the table of each row: of `seqrsm.simulate.radar.fading.gamma_tables`. ``spread``
    (n_range,): 1 / sqrt(N), at most 1. ``out`` is written: the factor X.
    """
    places, cubic = np.empty(normal.shape[1], dtype=np.int32), np.empty(4 * normal.shape[1])
    factor = np.empty(normal.shape[1])
    for i in range(normal.shape[0]):
        _fading_row(normal[i], tables[which[i]], spread[i], places, cubic, factor)
        for j in range(normal.shape[1]):
            out[i, j] = factor[j]


@kernel
def _fading_row(z: AnyArray, row: AnyArray, spread: float, places: AnyArray, cubic: AnyArray, out: AnyArray) -> None:
    """Fading at normal variates: the cube of 1 + spread y / 3, y being near z (Wilson and Hilferty 1931)."""
    m = z.shape[0]
    for j in range(m):
        place = (min(max(z[j], -CUBE_ROOT_REACH), CUBE_ROOT_REACH) + CUBE_ROOT_REACH) * CUBE_ROOT_STEPS
        places[j] = np.int32(place)
        out[j] = place - places[j]
    for j in range(m):
        k = np.uint64(np.uint32(places[j])) * np.uint64(4)
        for q in range(4):
            cubic[4 * j + q] = row[k + np.uint64(q)]
    for j in range(m):
        f = out[j]
        y = cubic[4 * j] + f * (cubic[4 * j + 1] + f * (cubic[4 * j + 2] + f * cubic[4 * j + 3]))
        root = max(1.0 + spread * y * (1.0 / 3.0), 0.0)
        out[j] = root * root * root


@kernel
def relate(w: AnyArray, m: np.uint64) -> None:
    """Fade the first ``m`` pixels of lines of `LINE` in ``w``: the arithmetic of `fading.fade_together`.

    Given are means with noise of HH, VV, HH + VV and HH + i VV (over 2); HH and VV faded alone; the share of the wave
    that has no phase, and its angle in turns. Written are VV in its place, and the powers of both in those of means.
    """
    for j in range(m):
        first, second = w[_FIRST + j], w[_SECOND + j]
        root, middle = np.sqrt(first * second), 0.5 * (first + second)
        per_root = 1.0 / root if root > 0.0 else 0.0
        real, imaginary = (w[_REAL + j] - middle) * per_root, (w[_IMAGINARY + j] - middle) * per_root
        per_size = 1.0 / max(np.sqrt(real * real + imaginary * imaginary), 1.0)
        real, imaginary = real * per_size, imaginary * per_size
        apart2 = 1.0 - min(real * real + imaginary * imaginary, 1.0)
        x = np.sqrt(w[_HH + j] * (second * per_root * per_root))
        alone = apart2 * w[_VV + j] * (first * per_root * per_root)
        size = np.sqrt(alone * (1.0 - w[_REST + j]))
        # Cosine and sine of a whole turn from those of half of it, -90 to 90 deg: by their series, right to 1e-9.
        half = np.pi * (w[_ANGLE + j] - 0.5)
        t = half * half
        sine = 1.0 - t / 110.0 * (1.0 - t / 156.0 * (1.0 - t / 210.0))
        sine = half * (1.0 - t / 6.0 * (1.0 - t / 20.0 * (1.0 - t / 42.0 * (1.0 - t / 72.0 * sine))))
        cosine = 1.0 - t / 90.0 * (1.0 - t / 132.0 * (1.0 - t / 182.0))
        cosine = 1.0 - t / 2.0 * (1.0 - t / 12.0 * (1.0 - t / 30.0 * (1.0 - t / 56.0 * cosine)))
        # The wave that VV is: what it has of HH, and its own.
        a, b = real * x + size * (2.0 * sine * sine - 1.0), size * (-2.0 * sine * cosine) - imaginary * x
        power = second * (a * a + b * b + alone * w[_REST + j]) if root > 0.0 else w[_VV + j]
        w[_VV + j] = power
        middle = 0.5 * (w[_HH + j] + power)
        w[_REAL + j] = middle + root * x * a
        w[_IMAGINARY + j] = middle - root * x * b


def work_lines(m: int) -> tuple[AnyArray, ...]:
    """Space for a row of ``m`` pixels in `add_speckle`: to get it there takes a sixth more to compile."""
    words, places = np.empty(m + 3, dtype=np.uint32), np.empty(m + 3, dtype=np.int32)
    return words, places, np.empty(m + 3, dtype=np.complex128), np.empty(m), np.empty(4 * m), np.empty(m)


@kernel
def add_speckle(
    mean: AnyArray,
    noise: AnyArray,
    tables: AnyArray,
    which: AnyArray,
    spread: AnyArray,
    numbers: AnyArray,
    table: AnyArray,
    k0: np.uint32,
    k1: np.uint32,
    first_row: int,
    out: AnyArray,
    words: AnyArray,
    places: AnyArray,
    pairs: AnyArray,
    normal: AnyArray,
    cubic: AnyArray,
    factor: AnyArray,
) -> None:
    """Add the receiver's noise in power, then fading, once per resolution cell: RSL TR 380-1 eq. (3-11).

    Parameters
    ----------
    mean : float array (n_channels, n_range, n_azimuth)
        Mean power of the ground [W].
    noise : float64 array (n_range,)
        Mean power of the receiver noise [W].
    tables, which, spread
        As in `fade`.
    numbers : int64 array (n_channels,)
        Number of each channel in the counter: a channel fades alike whoever is imaged beside it.
    table : complex array
        Of `seqrsm.simulate.radar.fading.normal_table`.
    k0, k1 : uint32
        Key of the run's speckle.
    first_row : int
        Row of the image in which these arrays begin.
    out : float array, shape of `mean`
        Written: power with noise and speckle [W].
    words, places, pairs, normal, cubic, factor : arrays
        Of `work_lines`.
    """
    m = mean.shape[2]
    blocks = (m + 3) // 4
    for c in range(mean.shape[0]):
        for i in range(mean.shape[1]):
            _words_row(first_row + i, numbers[c], blocks, k0, k1, words)
            _normal_row(words, table, places, pairs, normal)
            _fading_row(normal, tables[which[i]], spread[i], places, cubic, factor)
            add = noise[i]
            for j in range(m):
                out[c, i, j] = (mean[c, i, j] + add) * factor[j]
