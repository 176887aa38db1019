"""The compiled kernels of the Point Scattering Model's geometry and image.

Arrays are ``[range, azimuth]`` with azimuth contiguous: each step is independent along the contiguous axis, so the
inner loops vectorise, and a row has one ground range. Long offsets (ranges of hundreds of kilometres) stay in float64
row constants; the arrays of cells hold only small differences from them, so single precision loses nothing that counts.

min, max and int are functions that numba compiles for each type they are called with, some 0.03 s each: a condition
stands where a type is met once.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from seqrsm.arrays import AnyArray
from seqrsm.jit import kernel

CAST_SHADOW = 1
SELF_SHADOW = 2

STRIP = 1024
"""Columns done at a time: the work lines of a strip stay in the core's first cache."""

_BLOCK = np.uint64(64)  # columns whose bins are found together: the fewer, the fewer bins relief spreads them over

# Columns and places in lines are unsigned here: a signed index that may be negative would need a test at each access,
# and the loops would not vectorise. Slices would do as well, but each costs two locked counts of references.
_ZERO, _ONE = np.uint64(0), np.uint64(1)

# Begin of each line in the work array of a strip. One array with fixed distances lets the compiler see that its lines
# do not overlap, and vectorise without tests for it; the distance is no power of two, which caches would fold together.
_LINE = STRIP + 80
_RAY, _SLOPE, _OFFSET = np.uint64(0), np.uint64(_LINE), np.uint64(2 * _LINE)
_EDGE, _DARK, _WHERE = np.uint64(3 * _LINE), np.uint64(4 * _LINE), np.uint64(5 * _LINE)
_GAIN, _LOW, _HIGH = np.uint64(6 * _LINE), np.uint64(7 * _LINE), np.uint64(8 * _LINE)
_FACTOR, _POWER = np.uint64(9 * _LINE), np.uint64(10 * _LINE)  # the latter of each channel
_LINES = 10

_CACHE_LINE = 64


@kernel
def sum_echoes(
    z: AnyArray,
    top: AnyArray,
    source: AnyArray,
    cover: AnyArray,
    field: AnyArray,
    geometry: AnyArray,
    rows: AnyArray,
    offset: AnyArray,
    table: AnyArray,
    n_categories: int,
    field_factor: AnyArray,
    pattern: AnyArray,
    base: AnyArray,
    first: int,
    low: int,
    high: int,
    out: AnyArray,
    dark: AnyArray,
    w: AnyArray,
    pairs: AnyArray,
    index: AnyArray,
) -> None:
    """Mean power of every data-base element, summed over range bins: the report's program POWER, eqs. (3-21) to (3-23).

    Shadow by the height of the shadow ray, local incidence by eqs. (3-30) and (3-31) from the cell's own position, area
    of the sloping element, sigma0 of the element's own category, fourth power of the range.

    An element reaches half way to its neighbours in range, so the elements of a column cover it without gap; layover
    falls out by itself. Bins beyond `out` drop what falls there. Every column stands alone, so any division into
    strips, in any number of threads, gives the same bits.

    Parameters
    ----------
    z : float array (rows, m)
        Elevation above the datum [m], no gaps.
    top : float array (rows, m)
        Elevation of the top of what stands there [m], at least `z`: what it hides lies in shadow.
    source : int64 array (n,)
        Row of `z` that stands in each row of the frame (mirrored rows beyond the edges).
    cover : uint8 array (rows, m)
        Category; the number of categories or more where there is none.
    field : int32 array (rows, m)
        Field, >= 0 wherever there is a category.
    geometry : float64 array (n, 10)
        For each row of the frame, datum being ground at height 0: distance of the antenna along the local horizontal
        [m]; slant range of the datum [m]; ``cell / distance`` of the row before (0 in row 0); ``(reference range /
        slant range)**4``; height of the antenna over the local horizontal, here and in the row before [m]; range
        position of the datum [m]; bins to a metre of that position; tangent of half the angle of the local vertical
        from that of nadir; distance between columns [m].
    rows : float array (n, 14)
        `EchoGrid.rows`, as `_facing_row` (0 to 8) and `_range_row` (9 to 13, of the row behind) take them.
    offset : float array (m,)
        Range position of row 0 of the frame minus that of the datum [bins].
    table : complex array (n_channels, (n_categories + 1) * k)
        For each category and each of k - 1 equal steps of sin(theta/2) from 0 to sin(45 deg), and the end: sigma0 as
        the real and its rise to the next step as the imaginary part, so that one access fetches both. The last category
        is none, of sigma0 = 0.
    n_categories : int
    field_factor : float array (n_channels, n_fields)
        Factor of each field's sigma0 on this occasion; n_fields = 0 stands for 1 everywhere.
    pattern : float array (k,)
        Two-way factor of the antenna at equal steps of tan(look / 2) from 0 to 1; empty stands for 1.
    base : float64 array (n + 2,)
        Range position of the datum in each row [bins], with one row more at both ends.
    first : int
        Bin of ``out[:, 0]``.
    low, high : int
        Columns to do, ``low <= j < high``.
    out : float array (n_channels, n_bins, m)
        Zeroed by the caller; sums of sigma0 x surface area / cell**2 x (reference range / range)**4 are added.
    dark : uint8 array (n, m)
        Written where there are no channels: bits CAST_SHADOW and SELF_SHADOW, and nothing else is worked out.
    w, pairs, index : arrays
        Of `work_lines`.
    """
    n = source.shape[0]
    steps = table.shape[1] // (n_categories + 1) - 1
    for begin in range(low, high, STRIP):
        left, m = np.uint64(begin), np.uint64(min(STRIP, high - begin))
        for j in range(m):  # what each row hands on to the next: before row 0 lies the same ground
            w[_RAY + j] = top[source[0], left + j]
            w[_OFFSET + j] = w[_EDGE + j] = offset[left + j]
        for i in range(n):
            row = source[i]
            _slope_row(z, row, left, m, geometry[i, 9], w)
            _facing_row(z, top, source[max(i - 1, 0)], row, source[min(i + 1, n - 1)], left, m, rows, i, w)
            if out.shape[0] == 0:
                for j in range(m):
                    dark[i, left + j] = np.uint8(w[_DARK + j])
                continue
            # Bins are counted from one near the row, so that single precision holds their fractions.
            origin = math.floor(base[i + 1])
            near = 0.5 * (base[i] + base[i + 1]) - origin
            beyond = 0.5 * (base[i + 1] + base[i + 2]) - origin
            _range_row(z, source[min(i + 1, n - 1)], left, m, rows, i, near, beyond, w)
            if pattern.shape[0] > 0:
                _pattern_row(z, row, geometry, i, pattern, left, m, w)
            _index_row(cover, row, n_categories, steps, left, m, index, w)
            for c in range(out.shape[0]):
                _echo_row(table, index, field, row, field_factor, c, pairs, left, m, w)
            _add_row(origin - first, left, m, w, out)


def work_lines(z: AnyArray, table: AnyArray) -> tuple[AnyArray, AnyArray, AnyArray]:
    """Space for a strip in `sum_echoes`, its work lines beginning with a line of the cache."""
    whole = np.empty((_LINES + max(len(table), 1)) * _LINE + _CACHE_LINE, dtype=z.dtype)
    w = whole[(-whole.ctypes.data % _CACHE_LINE) // whole.itemsize :]
    return w, np.empty(STRIP, dtype=table.dtype), np.empty(STRIP, dtype=np.uint32)


@kernel
def _slope_row(z: AnyArray, row: int, left: np.uint64, m: np.uint64, cell: float, w: AnyArray) -> None:
    """Slope along the track: central differences, one-sided at the ends, 0 for one cell."""
    number = z.dtype.type
    per_two = number(0.5 / cell)
    # Unsigned: with a single column the range would have no end. Each min or max would be compiled for its own types.
    for j in range(_ONE, m - _ONE if m > _ONE else _ONE):
        w[_SLOPE + j] = (z[row, left + j + _ONE] - z[row, left + j - _ONE]) * per_two
    for end in (_ZERO, m - _ONE):
        k: Any = np.int64(left + end)
        first, last = k - 1 if k > 0 else k, k + 1 if k < z.shape[1] - 1 else k
        per_metre = number(1.0 / (cell * (last - first))) if last > first else number(0.0)
        w[_SLOPE + end] = (z[row, last] - z[row, first]) * per_metre


@kernel
def _facing_row(
    z: AnyArray,
    top: AnyArray,
    before: int,
    row: int,
    after: int,
    left: np.uint64,
    m: np.uint64,
    rows: AnyArray,
    i: int,
    w: AnyArray,
) -> None:
    """Shadow, local incidence and area of row `i`, and its power by range.

    Afterwards `_WHERE` is sin(theta/2)**2; `_GAIN` is tilt x (reference range / range)**4, 0 where nothing returns;
    `_DARK` has the bits CAST_SHADOW and SELF_SHADOW.
    """
    number = w.dtype.type
    one, half, zero = number(1.0), number(0.5), number(0.0)
    cast, turned = number(CAST_SHADOW), number(SELF_SHADOW)
    per_slope, y, h, per_range, twice_h = rows[i, 0], rows[i, 1], rows[i, 2], rows[i, 3], rows[i, 4]
    per_range2, descent, height, row_gain = rows[i, 5], rows[i, 6], rows[i, 7], rows[i, 8]
    for j in range(m):
        here, up_to = z[row, left + j], top[row, left + j]
        # The ray of shadow one step down the line from the antenna through the highest point so far.
        ray = w[_RAY + j] - (height - w[_RAY + j]) * descent
        w[_RAY + j] = max(ray, up_to)
        slope_y = (z[after, left + j] - z[before, left + j]) * per_slope
        slope_x = w[_SLOPE + j]
        # (R / R_datum)**2 from the height alone: no difference of two large numbers.
        range2 = one + here * (here - twice_h) * per_range2
        distance = math.sqrt(range2)
        toward = h - here * per_range
        tilt2 = one + slope_x * slope_x + slope_y * slope_y
        tilt = math.sqrt(tilt2)
        facing = y * slope_y + toward
        across = toward * slope_y - y
        # From the vector product of normal and ray: exact near theta = 0, where 1 - cos would lose its digits.
        sine2 = across * across + slope_x * slope_x * range2
        w[_WHERE + j] = half * sine2 / (distance * (tilt2 * distance + tilt * max(facing, zero)))
        dark = (cast if up_to < ray else zero) + (zero if facing > zero else turned)
        w[_DARK + j] = dark
        gain = row_gain * tilt / (range2 * range2)
        w[_GAIN + j] = gain if dark == zero else zero


@kernel
def _range_row(
    z: AnyArray,
    after: int,
    left: np.uint64,
    m: np.uint64,
    rows: AnyArray,
    i: int,
    near: float,
    beyond: float,
    w: AnyArray,
) -> None:
    """Edges of row `i` in range, `_LOW` and `_HIGH` [bins], `near` and `beyond` being those of flat ground.

    `_GAIN` is divided by the width, of which an element seen edge on keeps a least one. The lines `_OFFSET` (as of
    `_offset_row`) and `_EDGE` (half way to the row behind) come from the row before and go to the next.
    """
    number = w.dtype.type
    one, half, zero = number(1.0), number(0.5), number(0.0)
    twice_h, per_place2, to_bins, nadir = rows[i, 9], rows[i, 10], rows[i, 11], rows[i, 12]
    is_last = rows[i, 13] == zero
    this, there = number(near), number(beyond)
    thin = number(1e-3 if w.itemsize == 4 else 1e-9)
    for j in range(m):
        height = z[after, left + j]
        rise = height * (height - twice_h)
        behind = max(rise * to_bins / (one + math.sqrt(max(one + rise * per_place2, zero))), nadir)
        if is_last:
            behind = w[_OFFSET + j]
        edge = half * (w[_OFFSET + j] + behind)
        a, b = this + w[_EDGE + j], there + edge
        low = min(a, b)
        high = max(max(a, b), low + thin)
        w[_OFFSET + j] = behind
        w[_EDGE + j] = edge
        w[_LOW + j] = low
        w[_HIGH + j] = high
        w[_GAIN + j] /= high - low


@kernel
def _pattern_row(
    z: AnyArray, row: int, geometry: AnyArray, i: int, pattern: AnyArray, left: np.uint64, m: np.uint64, w: AnyArray
) -> None:
    """Multiply by the antenna's two-way factor at each element's own look angle, from the tangent of half of it."""
    number = w.dtype.type
    one, zero = number(1.0), number(0.0)
    steps = number(pattern.shape[0] - 1)
    last = np.int32(pattern.shape[0] - 2)
    y, h, vertical = number(geometry[i, 0]), number(geometry[i, 4]), number(geometry[i, 8])
    for j in range(m):
        up = h - z[row, left + j]
        half_angle = y / (up + math.sqrt(y * y + up * up))
        # tan((a - b) / 2) of the angle from the local vertical and that of the local vertical from nadir's.
        x = (half_angle - vertical) / (one + half_angle * vertical) * steps
        w[_POWER + j] = min(max(x, zero), steps)
    for j in range(m):
        k = min(np.int32(w[_POWER + j]), last)
        low = pattern[np.uint32(k)]
        w[_GAIN + j] *= low + (w[_POWER + j] - number(k)) * (pattern[np.uint32(k + np.int32(1))] - low)


@kernel
def _index_row(
    cover: AnyArray, row: int, none: int, steps: int, left: np.uint64, m: np.uint64, index: AnyArray, w: AnyArray
) -> None:
    """Place of each element in the flat table of sigma0, and in `_WHERE` the part of a step beyond it."""
    number = w.dtype.type
    per_q, end = number(steps / math.sqrt(0.5)), number(steps)
    last, stride = np.int32(none), np.int32(steps + 1)
    for j in range(m):
        where = min(math.sqrt(w[_WHERE + j]) * per_q, end)
        k = np.int32(where)
        w[_WHERE + j] = where - number(k)
        index[j] = np.uint32(min(np.int32(cover[row, left + j]), last) * stride + k)


@kernel
def _echo_row(
    table: AnyArray,
    index: AnyArray,
    field: AnyArray,
    row: int,
    factor: AnyArray,
    c: int,
    pairs: AnyArray,
    left: np.uint64,
    m: np.uint64,
    w: AnyArray,
) -> None:
    """Power in channel `c`: sigma0 of each element's category at its angle, and of its field, times `_GAIN`.

    The accesses that cannot be vectorised stand in loops of their own; they would keep the arithmetic from it.
    """
    for j in range(m):
        pairs[j] = table[c, index[j]]
    power = _POWER + np.uint64(c * _LINE)
    for j in range(m):
        w[power + j] = (pairs[j].real + w[_WHERE + j] * pairs[j].imag) * w[_GAIN + j]
    if factor.shape[1] > 0:
        for j in range(m):
            w[_FACTOR + j] = factor[c, np.uint32(field[row, left + j])]
        for j in range(m):
            w[power + j] *= w[_FACTOR + j]


@kernel
def _floor(x: float) -> np.int32:
    """Largest whole number not above `x`, as int32: cast and compare, which vectorise where floor does not."""
    k = np.int32(x)
    return np.int32(k - np.int32(1)) if x < k else k


@kernel
def _add_row(shift: int, left: np.uint64, m: np.uint64, w: AnyArray, out: AnyArray) -> None:
    """Add a row of elements, of densities `_POWER`, to the bins they overlap, leaving out what falls beyond `out`.

    Bin by bin over a whole block of columns: more arithmetic than element by element, but no scatter, so it vectorises.
    """
    number = w.dtype.type
    zero = number(0.0)
    for first in range(_ZERO, m, _BLOCK):
        end_of = first + _BLOCK if m - first > _BLOCK else m
        # The bins that hold all elements; a cast rounds towards 0, so there may be one too many at either end.
        least, most = np.int32(2147483647), np.int32(-2147483648)
        for j in range(first, end_of):
            low, high = np.int32(w[_LOW + j]), np.int32(w[_HIGH + j])
            least = low if low < least else least
            most = high if high > most else most
        lowest: Any = np.int64(least) - 1 if least <= 0 else np.int64(least)
        highest: Any = np.int64(most)
        lowest = lowest if lowest > -shift else -shift
        highest = highest if highest < out.shape[1] - 1 - shift else out.shape[1] - 1 - shift
        for k in range(lowest, highest + 1):
            begin, end = number(k), number(k + 1)
            line = np.uint64(k + shift)
            for j in range(first, end_of):
                w[_FACTOR + j] = max(min(w[_HIGH + j], end) - max(w[_LOW + j], begin), zero)
            for c in range(out.shape[0]):
                power = _POWER + np.uint64(c * _LINE)
                for j in range(first, end_of):
                    out[c, line, left + j] += w[power + j] * w[_FACTOR + j]


@kernel
def _offset_row(geometry: AnyArray, i: int, ground_format: bool, m: np.uint64, line: AnyArray) -> None:
    """Turn heights in row `i` into their range position minus that of flat ground [bins], in place.

    sqrt(p**2 + d) - p = d / (p (1 + sqrt(1 + d / p**2))) with d = -z (2 h - z): the same in both formats, where p is
    the ground or the slant range of the datum.
    """
    number = line.dtype.type
    one, zero = number(1.0), number(0.0)
    twice_h = number(2.0 * geometry[i, 4])
    per_place2 = number(1.0 / geometry[i, 6] ** 2)
    to_bins = number(geometry[i, 7] / geometry[i, 6])
    # A point closer than the nadir return has no place on the ground: it is put at nadir.
    least = number(-geometry[i, 6] * geometry[i, 7]) if ground_format else number(-math.inf)
    for j in range(m):
        rise = line[j] * (line[j] - twice_h)
        line[j] = max(rise * to_bins / (one + math.sqrt(max(one + rise * per_place2, zero))), least)


@kernel
def average_azimuth(
    sums: AnyArray,
    beam: AnyArray,
    cells_a_pixel: float,
    factor: AnyArray,
    out: AnyArray,
    total: AnyArray,
    smooth: AnyArray,
) -> None:
    """Average every range bin over the beam and then over the pixels in azimuth: eqs. (3-24) to (3-28), squared off.

    Parameters
    ----------
    sums : float array (n_channels, n_bins, m)
        Power of each bin and azimuth column.
    beam : float64 array (n_bins,)
        Width of the running box, R x lambda / L [cells]; 1 or less leaves the columns as they are.
    cells_a_pixel : float
        Azimuth cells in a pixel, any positive number.
    factor : float64 array (n_bins,)
        Factor of each bin, turns the sums into power [W].
    out : float array (n_channels, n_bins, n_pixels)
        Written. At the rim the mean is over the part inside the data base.
    total, smooth : float64 arrays (m + 1,), (m,)
        Work space. A float32 sum over rows with strong echoes would lose the weak ones.
    """
    n_channels, n_bins, m = sums.shape
    n_pixels = out.shape[2]
    whole = np.int64(cells_a_pixel)
    for c in range(n_channels):
        for i in range(n_bins):
            if beam[i] <= 1.0 and whole == cells_a_pixel:
                # Nothing runs over the edges of pixels: their own cells are all that is added.
                for k in range(n_pixels):
                    cells = min(m - k * whole, whole)
                    mean = 0.0
                    for j in range(cells):
                        mean += sums[c, i, k * whole + j]
                    out[c, i, k] = mean / cells * factor[i]
                continue
            total[0] = 0.0
            for j in range(m):
                total[j + 1] = total[j] + sums[c, i, j]
            if beam[i] > 1.0:
                for j in range(m):
                    low = max(j + 0.5 - 0.5 * beam[i], 0.0)
                    high = min(j + 0.5 + 0.5 * beam[i], float(m))
                    smooth[j] = (_integral(total, high, m) - _integral(total, low, m)) / (high - low)
                for j in range(m):
                    total[j + 1] = total[j] + smooth[j]
            low, before = 0.0, 0.0
            for k in range(n_pixels):
                high = min((k + 1) * cells_a_pixel, float(m))
                after = _integral(total, high, m)
                out[c, i, k] = max((after - before) / (high - low), 0.0) * factor[i]
                low, before = high, after


@kernel
def _integral(total: AnyArray, x: float, m: int) -> float:
    """Integral of a row of unit-wide steps from 0 to `x`, `total` being its running sum."""
    k = np.int64(x) if x < m else m - 1
    return total[k] + (x - k) * (total[k + 1] - total[k])


@kernel
def register_cells(
    z: AnyArray,
    cover: AnyArray,
    none: int,
    geometry: AnyArray,
    base: AnyArray,
    ground_format: bool,
    first: int,
    n_bins: np.int32,
    n_pixels: np.int32,
    column: AnyArray,
    line: AnyArray,
    out: AnyArray,
) -> None:
    """Pixel into which each element's own power falls (terrain-corrected registration).

    Parameters
    ----------
    z : float array (n, m)
        Elevation above the datum of the swath's own rows [m], no gaps.
    cover : uint8 array (n, m)
    none : int
        Number of categories: `cover` from there on is none.
    geometry, base : float64 arrays (n, 10), (n,)
        As in `sum_echoes`, of those rows.
    ground_format : bool
    first : int
        First range bin of the image.
    n_bins, n_pixels : int32
        Of the image.
    column : int32 array (m,)
        Column of pixels that each column of cells lies in.
    line : float array (m,)
        Work space.
    out : int32 array (n, m)
        Written: ``bin * n_pixels + pixel``; -1 without data or outside the image.
    """
    n, m = z.shape
    for i in range(n):
        for j in range(m):
            line[j] = z[i, j]
        _offset_row(geometry, i, ground_format, np.uint64(m), line)
        origin = math.floor(base[i])
        rest = z.dtype.type(base[i] - origin)
        shift = np.int32(np.int64(origin) - first)
        for j in range(m):
            k = np.int32(_floor(rest + line[j]) + shift)
            inside = np.int32(0) <= k and k < n_bins and cover[i, j] < none
            out[i, j] = np.int32(k * n_pixels + column[j]) if inside else np.int32(-1)
