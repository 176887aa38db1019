"""The compiled kernels of the Point Scattering Model's geometry and image, in one self-contained file.

This file may be longer than others: the compile cache of numba does not see edits in a second file.

Arrays are ``[range, azimuth]`` with azimuth contiguous: each step is independent along the contiguous axis, so the
inner loops vectorise, and a row has one ground range. Long offsets (ranges of hundreds of kilometres) stay in float64
row constants; the arrays of cells hold only small differences from them, so single precision loses nothing that counts.
"""

from __future__ import annotations

import math

import numpy as np

from seqrsm.arrays import AnyArray
from seqrsm.jit import kernel

CAST_SHADOW = 1
SELF_SHADOW = 2
LAYOVER = 4
NO_DATA = 8

STRIP = 1024
"""Columns done at a time: the work lines of a strip stay in the core's first cache."""

_FEW_BINS = 12

# Begin of each line in the work array of a strip. One array with fixed distances lets the compiler see that its lines
# do not overlap, and vectorise without tests for it; the distance is no power of two, which caches would fold together.
_LINE = STRIP + 80
_ABOVE, _HERE, _BELOW = 0 * _LINE, 1 * _LINE, 2 * _LINE
_SLOPE, _SLOPE_BELOW, _RAY = 3 * _LINE, 4 * _LINE, 5 * _LINE
_DARK, _WHERE, _GAIN = 6 * _LINE, 7 * _LINE, 8 * _LINE
_BEFORE, _NOW, _LOW = 9 * _LINE, 10 * _LINE, 11 * _LINE
_HIGH, _POWER, _FACTOR = 12 * _LINE, 13 * _LINE, 14 * _LINE
_LINES = 15


@kernel
def elevation_summary(elevation: AnyArray) -> tuple[int, float, float]:
    """Number, mean and maximum of the finite elevations; mean and maximum are 0 where there is none.

    Parameters
    ----------
    elevation : float array (rows, columns)
        nan where it is not known [m].

    Returns
    -------
    tuple of int, float, float
    """
    rows, columns = elevation.shape
    count = 0
    total = 0.0
    highest = -math.inf
    for i in range(rows):
        part = 0.0
        for j in range(columns):
            if not math.isnan(elevation[i, j]):
                count += 1
                part += elevation[i, j]
                highest = max(highest, elevation[i, j])
        total += part
    return (count, total / count, highest) if count > 0 else (0, 0.0, 0.0)


@kernel
def fill_no_data(elevation: AnyArray) -> None:
    """Give cells without elevation that of the nearest cell of their row, and empty rows that of a neighbour row.

    Geometry needs a surface everywhere; the cells stay without power and without score.

    Parameters
    ----------
    elevation : float array (rows, columns)
        Changed in place; at least one cell is finite.
    """
    rows, columns = elevation.shape
    full = np.zeros(rows, dtype=np.bool_)
    for i in range(rows):
        last = -1
        for j in range(columns):
            if not math.isnan(elevation[i, j]):
                if last + 1 < j:
                    for m in range(last + 1, j):
                        if last >= 0 and m - last <= j - m:
                            elevation[i, m] = elevation[i, last]
                        else:
                            elevation[i, m] = elevation[i, j]
                last = j
        if last >= 0:
            full[i] = True
            for m in range(last + 1, columns):
                elevation[i, m] = elevation[i, last]
    for i in range(rows):
        if not full[i]:
            step = 1
            while not ((i - step >= 0 and full[i - step]) or (i + step < rows and full[i + step])):
                step += 1
            source = i - step if i - step >= 0 and full[i - step] else i + step
            for j in range(columns):
                elevation[i, j] = elevation[source, j]


@kernel
def categories_of_fields(field: AnyArray, cover: AnyArray, n_fields: int) -> AnyArray:
    """Category of each field: that of its cells (of the last one met, should they differ); 255 where it has none.

    Parameters
    ----------
    field : int32 array (rows, columns)
    cover : uint8 array (rows, columns)
    n_fields : int

    Returns
    -------
    uint8 array (n_fields,)
    """
    out = np.full(n_fields, 255, dtype=np.uint8)
    rows, columns = field.shape
    for i in range(rows):
        for j in range(columns):
            if field[i, j] >= 0 and cover[i, j] != 255:
                out[field[i, j]] = cover[i, j]
    return out


@kernel
def power_cells(
    z: AnyArray,
    source: AnyArray,
    cover: AnyArray,
    field: AnyArray,
    geometry: AnyArray,
    cell: float,
    ground_format: bool,
    table: AnyArray,
    n_categories: int,
    field_factor: AnyArray,
    pattern: AnyArray,
    power: AnyArray,
    offset: AnyArray,
    state: AnyArray,
) -> None:
    """Mean power and range position of every data-base element: the report's program POWER.

    Shadow by the height of the shadow ray, local incidence by eqs. (3-30) and (3-31) from the cell's own position, area
    of the sloping element, sigma0 of the element's own category, fourth power of the range.

    Parameters
    ----------
    z : float array (rows, m)
        Elevation above the datum [m], no gaps.
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
    cell : float
        Distance between rows [m].
    ground_format : bool
        True: position is ground range; False: slant range.
    table : complex array (n_channels, (n_categories + 1) * k)
        For each category and each of k - 1 equal steps of sin(theta/2) from 0 to sin(45 deg), and the end: sigma0 as
        the real and its rise to the next step as the imaginary part, so that one access fetches both. The last category
        is none, of sigma0 = 0. No channels leaves the power out.
    n_categories : int
    field_factor : float array (n_channels, n_fields)
        Factor of each field's sigma0 on this occasion; n_fields = 0 stands for 1 everywhere.
    pattern : float array (k,)
        Two-way factor of the antenna at equal steps of tan(look / 2) from 0 to 1; empty stands for 1.
    power : float array (n_channels, n, m)
        Written: sigma0 x surface area / cell**2 x (reference range / range)**4.
    offset : float array (n, m)
        Written: range position minus that of the datum in the same row [bins].
    state : uint8 array (n, m)
        Written: bits CAST_SHADOW, SELF_SHADOW, NO_DATA.
    """
    n = source.shape[0]
    steps = table.shape[1] // (n_categories + 1) - 1
    w = np.empty(_LINES * _LINE, dtype=z.dtype)
    pairs = np.empty(STRIP, dtype=table.dtype)
    index = np.empty(STRIP, dtype=np.uint32)
    for left in range(0, z.shape[1], STRIP):
        m = min(STRIP, z.shape[1] - left)
        own = slice(left, left + m)
        _first_row(z, source[0], left, m, geometry[0], ground_format, w)
        for i in range(n):
            kind = cover[source[i], own]
            line = offset[i, own]
            for j in range(m):
                line[j] = w[_NOW + j]
            _next_row(z, source, i, left, m, geometry, w)
            _arithmetic_row(geometry, i, cell, ground_format, 0.0, 1.0, steps, m, w)
            _state_row(kind, n_categories, m, w, state[i, own])
            if pattern.shape[0] > 0:
                _pattern_row(geometry[i], pattern, m, w)
            _index_row(kind, n_categories, steps + 1, index, m, w)
            for c in range(power.shape[0]):
                _echo_row(table[c], index, field[source[i], own], field_factor[c], pairs, m, w)
                line = power[c, i, own]
                for j in range(m):
                    line[j] = w[_POWER + j] * (w[_HIGH + j] - w[_LOW + j])


@kernel
def sum_echoes(
    z: AnyArray,
    source: AnyArray,
    cover: AnyArray,
    field: AnyArray,
    geometry: AnyArray,
    cell: float,
    ground_format: bool,
    table: AnyArray,
    n_categories: int,
    field_factor: AnyArray,
    pattern: AnyArray,
    base: AnyArray,
    first: int,
    nearest: bool,
    low: int,
    high: int,
    out: AnyArray,
) -> None:
    """Add the power of `power_cells` to the range bins that each element overlaps: eqs. (3-21) to (3-23), in one pass.

    An element reaches half way to its neighbours in range, so the elements of a column cover it without gap; layover
    falls out by itself. Bins beyond `out` drop what falls there. Every column stands alone, so any division into
    strips, in any number of threads, gives the same bits.

    Parameters
    ----------
    z, source, cover, field, geometry, cell, ground_format, table, n_categories, field_factor, pattern
        As in `power_cells`.
    base : float64 array (n + 2,)
        Range position of the datum in each row [bins], with one row more at both ends.
    first : int
        Bin of ``out[:, 0]``.
    nearest : bool
        Give an element whole to the bin of its centre, as the report does; a homogeneous plane then shows a ripple.
    low, high : int
        Columns to do, ``low <= j < high``.
    out : float array (n_channels, n_bins, m)
        Zeroed by the caller; sums are added.
    """
    n = source.shape[0]
    steps = table.shape[1] // (n_categories + 1) - 1
    w = np.empty(_LINES * _LINE, dtype=z.dtype)
    pairs = np.empty(STRIP, dtype=table.dtype)
    index = np.empty(STRIP, dtype=np.uint32)
    for left in range(low, high, STRIP):
        m = min(STRIP, high - left)
        own = slice(left, left + m)
        _first_row(z, source[0], left, m, geometry[0], ground_format, w)
        for i in range(n):
            # Bins are counted from one near the row, so that single precision holds their fractions.
            origin = math.floor(base[i + 1])
            near = 0.5 * (base[i] + base[i + 1]) - origin
            beyond = 0.5 * (base[i + 1] + base[i + 2]) - origin
            if nearest:
                _keep_centres(base[i + 1] - origin, m, w)
            _next_row(z, source, i, left, m, geometry, w)
            _arithmetic_row(geometry, i, cell, ground_format, near, beyond, steps, m, w)
            if nearest:
                _fill_centres(m, w)
            if pattern.shape[0] > 0:
                _pattern_row(geometry[i], pattern, m, w)
            least, most = _reach_row(m, w)
            _index_row(cover[source[i], own], n_categories, steps + 1, index, m, w)
            for c in range(out.shape[0]):
                _echo_row(table[c], index, field[source[i], own], field_factor[c], pairs, m, w)
                _add_row(origin - first, least, most, left, m, w, out[c])


@kernel
def _first_row(z: AnyArray, row: int, left: int, m: int, geometry: AnyArray, ground_format: bool, w: AnyArray) -> None:
    """Fill the work lines so that `_next_row` and `_arithmetic_row` can begin at row 0."""
    _load_row(z, row, left, m, geometry[9], w)
    _offset_row(w[_BELOW : _BELOW + m], geometry, ground_format, w[_NOW : _NOW + m])
    for j in range(m):
        w[_ABOVE + j] = w[_BELOW + j]
        w[_HERE + j] = w[_BELOW + j]
        w[_RAY + j] = w[_BELOW + j]
        w[_SLOPE + j] = w[_SLOPE_BELOW + j]
        w[_BEFORE + j] = w[_NOW + j]


@kernel
def _next_row(z: AnyArray, source: AnyArray, i: int, left: int, m: int, geometry: AnyArray, w: AnyArray) -> None:
    """Fetch the heights behind row `i`; behind the last one stand its own."""
    if i + 1 < source.shape[0]:
        _load_row(z, source[i + 1], left, m, geometry[i + 1, 9], w)
    else:
        for j in range(m):
            w[_BELOW + j] = w[_HERE + j]


@kernel
def _load_row(z: AnyArray, row: int, left: int, m: int, cell: float, w: AnyArray) -> None:
    """Heights of a row, and its slope along the track: central differences, one-sided at the ends, 0 for one cell."""
    line = z[row]
    here = line[left : left + m]
    for j in range(m):
        w[_BELOW + j] = here[j]
    number = z.dtype.type
    per_two = number(0.5 / cell)
    for j in range(1, m - 1):
        w[_SLOPE_BELOW + j] = (w[_BELOW + 1 + j] - w[_BELOW - 1 + j]) * per_two
    for j in (0, m - 1):
        k = left + j
        first, last = max(k - 1, 0), min(k + 1, line.shape[0] - 1)
        per_metre = number(1.0 / (cell * (last - first))) if last > first else number(0.0)
        w[_SLOPE_BELOW + j] = (line[last] - line[first]) * per_metre


@kernel
def _arithmetic_row(
    geometry: AnyArray,
    i: int,
    cell: float,
    ground_format: bool,
    near: float,
    beyond: float,
    steps: int,
    m: int,
    w: AnyArray,
) -> None:
    """Everything of row `i` that is arithmetic: shadow, local incidence, area, power by range, edges in range.

    Afterwards `_WHERE` is the position in the table of sigma0; `_GAIN` is tilt x (reference range / range)**4 / width
    in bins, 0 where nothing returns; `_LOW` and `_HIGH` are the element's edges in range [bins], `near` and `beyond`
    being those of flat ground; `_DARK` has the bits CAST_SHADOW and SELF_SHADOW; the lines of the row before are those
    of this row, and those of this row are the next one's. An element seen edge on keeps a least width.
    """
    number = w.dtype.type
    one, half, zero = number(1.0), number(0.5), number(0.0)
    n = geometry.shape[0]
    after = min(i + 1, n - 1)
    span = after - max(i - 1, 0)
    per_slope = number(1.0 / (cell * span) if span > 0 else 0.0)
    y, h = number(geometry[i, 0]), number(geometry[i, 4])
    inverse_r, inverse_r2 = number(1.0 / geometry[i, 1]), number(1.0 / geometry[i, 1] ** 2)
    descent, height = number(geometry[i, 2]), number(geometry[i, 5])
    row_gain = number(geometry[i, 3])
    per_q, last = number(steps / math.sqrt(0.5)), number(steps)
    # Of the row behind: its range position (see `_offset_row`).
    h_after, inverse_p2 = number(geometry[after, 4]), number(1.0 / geometry[after, 6] ** 2)
    to_bins = number(geometry[after, 7] / geometry[after, 6])
    nadir = number(-geometry[after, 6] * geometry[after, 7]) if ground_format else number(-math.inf)
    here, there = number(near), number(beyond)
    thin = number(1e-3 if w.itemsize == 4 else 1e-9)
    cast, turned = number(CAST_SHADOW), number(SELF_SHADOW)
    for j in range(m):
        z, z_after = w[_HERE + j], w[_BELOW + j]
        # The ray of shadow one step down the line from the antenna through the highest point so far.
        ray = w[_RAY + j] - (height - w[_RAY + j]) * descent
        w[_RAY + j] = max(ray, z)
        slope_y = (z_after - w[_ABOVE + j]) * per_slope
        slope_x = w[_SLOPE + j]
        # u = (R**2 - R_datum**2) / R_datum**2 from the height alone: no difference of two large numbers.
        u = -z * (h + h - z) * inverse_r2
        closer = one / math.sqrt(one + u)
        inverse = inverse_r * closer
        toward = (h - z) * inverse
        along = y * inverse
        tilt2 = one + slope_x * slope_x + slope_y * slope_y
        tilt = math.sqrt(tilt2)
        facing = along * slope_y + toward
        across = toward * slope_y - along
        # sin(theta/2)**2 from the vector product: exact near theta = 0, where 1 - cos would lose its digits.
        sine2 = across * across + slope_x * slope_x
        half_sine2 = half * sine2 / (tilt2 + tilt * max(facing, zero))
        w[_WHERE + j] = min(math.sqrt(half_sine2) * per_q, last)
        rise = -z_after * (h_after + h_after - z_after)
        behind = max(rise * to_bins / (one + math.sqrt(max(one + rise * inverse_p2, zero))), nadir)
        if i == after:
            behind = w[_NOW + j]
        a = here + half * (w[_BEFORE + j] + w[_NOW + j])
        b = there + half * (w[_NOW + j] + behind)
        low = min(a, b)
        high = max(max(a, b), low + thin)
        w[_LOW + j] = low
        w[_HIGH + j] = high
        dark = (cast if z < ray else zero) + (zero if facing > zero else turned)
        w[_DARK + j] = dark
        closer2 = closer * closer
        gain = row_gain * (closer2 * closer2) * tilt / (high - low)
        w[_GAIN + j] = gain if dark == zero else zero
        w[_ABOVE + j] = z
        w[_HERE + j] = z_after
        w[_SLOPE + j] = w[_SLOPE_BELOW + j]
        w[_BEFORE + j] = w[_NOW + j]
        w[_NOW + j] = behind


@kernel
def _state_row(cover: AnyArray, none: int, m: int, w: AnyArray, state: AnyArray) -> None:
    """Bits CAST_SHADOW, SELF_SHADOW and NO_DATA."""
    for j in range(m):
        state[j] = np.uint8(w[_DARK + j]) | np.uint8(NO_DATA if cover[j] >= none else 0)


@kernel
def _pattern_row(geometry: AnyArray, pattern: AnyArray, m: int, w: AnyArray) -> None:
    """Multiply by the antenna's two-way factor at each element's own look angle, from the tangent of half of it."""
    number = w.dtype.type
    one, zero = number(1.0), number(0.0)
    steps = number(pattern.shape[0] - 1)
    last = np.int32(pattern.shape[0] - 2)
    y, h, vertical = number(geometry[0]), number(geometry[4]), number(geometry[8])
    for j in range(m):
        # The lines have moved on: ABOVE is this row.
        up = h - w[_ABOVE + j]
        half_angle = y / (up + math.sqrt(y * y + up * up))
        # tan((a - b) / 2) of the angle from the local vertical and that of the local vertical from nadir's.
        x = (half_angle - vertical) / (one + half_angle * vertical) * steps
        w[_POWER + j] = min(max(x, zero), steps)
    for j in range(m):
        k = min(np.int32(w[_POWER + j]), last)
        low = pattern[np.uint32(k)]
        w[_GAIN + j] *= low + (w[_POWER + j] - number(k)) * (pattern[np.uint32(k + np.int32(1))] - low)


@kernel
def _index_row(cover: AnyArray, none: int, width: int, index: AnyArray, m: int, w: AnyArray) -> None:
    """Place of each element in the flat table of sigma0, and in `_WHERE` the part of a step beyond it."""
    number = w.dtype.type
    last = np.int32(none)
    stride = np.int32(width)
    for j in range(m):
        k = np.int32(w[_WHERE + j])
        w[_WHERE + j] -= number(k)
        index[j] = np.uint32(min(np.int32(cover[j]), last) * stride + k)


@kernel
def _echo_row(
    table: AnyArray, index: AnyArray, field: AnyArray, factor: AnyArray, pairs: AnyArray, m: int, w: AnyArray
) -> None:
    """Power: sigma0 of each element's category at its angle, and of its field, times `_GAIN`.

    The accesses that cannot be vectorised stand in loops of their own; they would keep the arithmetic from it.
    """
    for j in range(m):
        # Unsigned indices: spares the test for indices counted from the end.
        pairs[j] = table[np.uint64(index[j])]
    for j in range(m):
        w[_POWER + j] = (pairs[j].real + w[_WHERE + j] * pairs[j].imag) * w[_GAIN + j]
    if factor.shape[0] > 0:
        for j in range(m):
            w[_FACTOR + j] = factor[np.uint32(field[j])]
        for j in range(m):
            w[_POWER + j] *= w[_FACTOR + j]


@kernel
def _reach_row(m: int, w: AnyArray) -> tuple[int, int]:
    """Bins that hold all elements of a row; a cast rounds towards 0, so there may be one too many at either end."""
    least = np.int32(2147483647)
    most = np.int32(-2147483648)
    for j in range(m):
        least = min(least, np.int32(w[_LOW + j]))
        most = max(most, np.int32(w[_HIGH + j]))
    return int(least) - 1 if least <= 0 else int(least), int(most)


@kernel
def _keep_centres(middle: float, m: int, w: AnyArray) -> None:
    """Keep the bin of each element's centre in `_POWER`, before the lines move on."""
    number = w.dtype.type
    centre = number(middle)
    for j in range(m):
        w[_POWER + j] = number(_floor(centre + w[_NOW + j]))


@kernel
def _fill_centres(m: int, w: AnyArray) -> None:
    """Make every element fill the bin that `_keep_centres` found, in place of its own edges."""
    for j in range(m):
        w[_GAIN + j] *= w[_HIGH + j] - w[_LOW + j]
        w[_LOW + j] = w[_POWER + j]
        w[_HIGH + j] = w[_POWER + j] + w.dtype.type(1.0)


@kernel
def _floor(x: float) -> np.int32:
    """Largest whole number not above `x`, as int32: cast and compare, which vectorise where floor does not."""
    k = np.int32(x)
    return np.int32(k - np.int32(1)) if x < k else k


@kernel
def _add_row(shift: int, least: int, most: int, left: int, m: int, w: AnyArray, out: AnyArray) -> None:
    """Add a row of elements, of density `_POWER`, to the bins they overlap, leaving out what falls beyond `out`."""
    number = w.dtype.type
    zero = number(0.0)
    n_bins = out.shape[0]
    if most - least < _FEW_BINS:
        # Bin by bin over the whole row: more arithmetic, but no scatter, so it vectorises.
        for k in range(max(least, -shift), min(most, n_bins - 1 - shift) + 1):
            line = out[k + shift, left : left + m]
            begin, end = number(k), number(k + 1)
            for j in range(m):
                line[j] += w[_POWER + j] * max(min(w[_HIGH + j], end) - max(w[_LOW + j], begin), zero)
    else:
        for j in range(m):
            low, high = w[_LOW + j], w[_HIGH + j]
            k0, k1 = int(_floor(low)), int(_floor(high))
            for k in range(max(k0, -shift), min(k1, n_bins - 1 - shift) + 1):
                out[k + shift, left + j] += w[_POWER + j] * max(min(high, number(k + 1)) - max(low, number(k)), zero)


@kernel
def offset_rows(z: AnyArray, geometry: AnyArray, ground_format: bool, out: AnyArray) -> None:
    """Range position minus that of the datum [bins] of heights in some rows (see `power_cells`).

    Parameters
    ----------
    z : float array (n, k)
        Heights over the datum [m].
    geometry : float64 array (n, 10)
    ground_format : bool
    out : float array (n, k)
        Written.
    """
    for i in range(z.shape[0]):
        _offset_row(z[i], geometry[i], ground_format, out[i])


@kernel
def _offset_row(z: AnyArray, geometry: AnyArray, ground_format: bool, out: AnyArray) -> None:
    """Range position of a row of elements minus that of flat ground [bins].

    sqrt(p**2 + d) - p = d / (p (1 + sqrt(1 + d / p**2))) with d = -z (2 h - z): the same in both formats, where p is
    the ground or the slant range of the datum.
    """
    number = z.dtype.type
    one, zero = number(1.0), number(0.0)
    h = number(geometry[4])
    inverse_p2 = number(1.0 / geometry[6] ** 2)
    to_bins = number(geometry[7] / geometry[6])
    # A point closer than the nadir return has no place on the ground: it is put at nadir.
    least = number(-geometry[6] * geometry[7]) if ground_format else number(-math.inf)
    for j in range(z.shape[0]):
        rise = -z[j] * (h + h - z[j])
        out[j] = max(rise * to_bins / (one + math.sqrt(max(one + rise * inverse_p2, zero))), least)


@kernel
def mark_layover(offset: AnyArray, base: AnyArray, state: AnyArray) -> None:
    """Set the LAYOVER bit where the order of slant ranges differs from the order on the ground; two sweeps, no sort.

    Parameters
    ----------
    offset : float array (n, m)
        Range position minus the row's [bins].
    base : float64 array (n,)
        Range position of the datum in each row [bins].
    state : uint8 array (n, m)
        Changed in place.
    """
    n, m = offset.shape
    bit = np.uint8(LAYOVER)
    far = np.empty(m, dtype=offset.dtype)
    for j in range(m):
        far[j] = offset[0, j]
    for i in range(1, n):
        step = offset.dtype.type(base[i] - base[i - 1])
        for j in range(m):
            reach = far[j] - step
            if offset[i, j] <= reach:
                state[i, j] |= bit
            far[j] = max(reach, offset[i, j])
    for j in range(m):
        far[j] = offset[n - 1, j]
    for i in range(n - 2, -1, -1):
        step = offset.dtype.type(base[i + 1] - base[i])
        for j in range(m):
            reach = far[j] + step
            if offset[i, j] >= reach:
                state[i, j] |= bit
            far[j] = min(reach, offset[i, j])


@kernel
def average_azimuth(sums: AnyArray, beam: AnyArray, cells_a_pixel: float, factor: AnyArray, out: AnyArray) -> None:
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
    """
    n_channels, n_bins, m = sums.shape
    n_pixels = out.shape[2]
    # Running sums in float64: a float32 sum over rows with strong echoes would lose the weak ones.
    total = np.empty(m + 1, dtype=np.float64)
    smooth = np.empty(m, dtype=np.float64)
    whole = int(cells_a_pixel)
    for c in range(n_channels):
        for i in range(n_bins):
            line = sums[c, i]
            if beam[i] <= 1.0 and whole == cells_a_pixel:
                # Nothing runs over the edges of pixels: their own cells are all that is added.
                for k in range(n_pixels):
                    end = min((k + 1) * whole, m)
                    mean = 0.0
                    for j in range(k * whole, end):
                        mean += line[j]
                    out[c, i, k] = mean / (end - k * whole) * factor[i]
                continue
            total[0] = 0.0
            for j in range(m):
                total[j + 1] = total[j] + line[j]
            if beam[i] > 1.0:
                for j in range(m):
                    low = max(j + 0.5 - 0.5 * beam[i], 0.0)
                    high = min(j + 0.5 + 0.5 * beam[i], float(m))
                    smooth[j] = (_integral(total, high, m) - _integral(total, low, m)) / (high - low)
                for j in range(m):
                    total[j + 1] = total[j] + smooth[j]
            for k in range(n_pixels):
                low = k * cells_a_pixel
                high = min((k + 1) * cells_a_pixel, float(m))
                mean = (_integral(total, high, m) - _integral(total, low, m)) / (high - low)
                out[c, i, k] = max(mean, 0.0) * factor[i]


@kernel
def _integral(total: AnyArray, x: float, m: int) -> float:
    """Integral of a row of unit-wide steps from 0 to `x`, `total` being its running sum."""
    k = min(int(x), m - 1)
    return total[k] + (x - k) * (total[k + 1] - total[k])


@kernel
def smear_range(image: AnyArray, width: AnyArray) -> None:
    """Average over the range response where it is wider than a bin (near range, shallow bandwidth).

    Parameters
    ----------
    image : float array (n_channels, n_bins, n_pixels)
        Changed in place.
    width : float64 array (n_bins,)
        Width of the range response [bins]; rows with 1 or less are left alone.
    """
    n_channels, n_bins, n_pixels = image.shape
    line = np.empty(n_bins, dtype=np.float64)
    total = np.empty(n_bins + 1, dtype=np.float64)
    for c in range(n_channels):
        for k in range(n_pixels):
            total[0] = 0.0
            for i in range(n_bins):
                line[i] = image[c, i, k]
                total[i + 1] = total[i] + line[i]
            for i in range(n_bins):
                if width[i] > 1.0:
                    low = max(i + 0.5 - 0.5 * width[i], 0.0)
                    high = min(i + 0.5 + 0.5 * width[i], float(n_bins))
                    image[c, i, k] = (_integral(total, high, n_bins) - _integral(total, low, n_bins)) / (high - low)


@kernel
def register_cells(
    offset: AnyArray, base: AnyArray, state: AnyArray, first: int, n_bins: int, cells_a_pixel: float, n_pixels: int
) -> AnyArray:
    """Pixel into which each element's own power falls (terrain-corrected registration).

    Parameters
    ----------
    offset, base, first
        As in `bin_range`, `base` without the two further rows.
    state : uint8 array (n, m)
    n_bins, n_pixels : int
        Size of the image.
    cells_a_pixel : float
        Azimuth cells in a pixel.

    Returns
    -------
    int32 array (n, m)
        ``bin * n_pixels + pixel``; -1 without data or outside the image.
    """
    n, m = offset.shape
    out = np.empty((n, m), dtype=np.int32)
    column = np.empty(m, dtype=np.int32)
    for j in range(m):
        column[j] = min(int((j + 0.5) / cells_a_pixel), n_pixels - 1)
    for i in range(n):
        origin = math.floor(base[i])
        rest = offset.dtype.type(base[i] - origin)
        shift = np.int32(np.int64(origin) - first)
        for j in range(m):
            k = np.int32(math.floor(rest + offset[i, j])) + shift
            inside = 0 <= k < n_bins and (state[i, j] & np.uint8(NO_DATA)) == 0
            out[i, j] = k * np.int32(n_pixels) + column[j] if inside else np.int32(-1)
    return out


@kernel
def count_classes(pixel: AnyArray, cover: AnyArray, scored: AnyArray, n_pixels: int, n_classes: int) -> AnyArray:
    """Scored data-base cells of each class in each pixel.

    Parameters
    ----------
    pixel : int32 array (rows, columns)
        Pixel of each cell, -1 for none.
    cover : uint8 array (rows, columns)
        Category, 255 for none.
    scored : bool array (rows, columns)
    n_pixels, n_classes : int

    Returns
    -------
    int32 array (n_pixels, n_classes)
    """
    out = np.zeros((n_pixels, n_classes), dtype=np.int32)
    rows, columns = pixel.shape
    for i in range(rows):
        for j in range(columns):
            kind = np.int64(cover[i, j])
            k = np.int64(pixel[i, j])
            if k >= 0 and kind < n_classes and scored[i, j]:
                out[k, kind] += 1
    return out
