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

_FEW_BINS = 6


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
    lut: AnyArray,
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
    geometry : float64 array (n, 9)
        For each row of the frame, datum being ground at height 0: distance of the antenna along the local horizontal
        [m]; slant range of the datum [m]; ``cell / distance`` of the row before (0 in row 0); ``(reference range /
        slant range)**4``; height of the antenna over the local horizontal, here and in the row before [m]; range
        position of the datum [m]; bins to a metre of that position; angle of the local vertical from that of nadir
        [rad].
    cell : float
        Side of a cell [m].
    ground_format : bool
        True: position is ground range; False: slant range.
    lut : float array (n_channels, n_categories + 1, k)
        sigma0 at ``k - 2`` equal steps of sin(theta/2) from 0 to sin(45 deg), and the last value once more. The last
        category is none, of sigma0 = 0.
    field_factor : float array (n_channels, n_fields)
        Factor of each field's sigma0 on this occasion; n_fields = 0 stands for 1 everywhere.
    pattern : float64 array (k,)
        Two-way factor of antenna and atmosphere at equal steps of the look angle from 0 to 90 deg; empty stands for 1.
    power : float array (n_channels, n, m)
        Written: sigma0 x surface area / cell**2 x (reference range / range)**4.
    offset : float array (n, m)
        Written: range position minus that of the datum in the same row [bins].
    state : uint8 array (n, m)
        Written: bits CAST_SHADOW, SELF_SHADOW, NO_DATA.
    """
    n = source.shape[0]
    m = z.shape[1]
    n_channels = lut.shape[0]
    none = np.uint8(lut.shape[1] - 1)
    ray = np.empty(m, dtype=z.dtype)
    lit = np.empty(m, dtype=z.dtype)
    where = np.empty(m, dtype=z.dtype)
    gain = np.empty(m, dtype=z.dtype)
    slope_x = np.empty(m, dtype=z.dtype)
    part = np.empty(m, dtype=z.dtype)
    index = np.empty(m, dtype=np.uint32)
    tables = lut.reshape(n_channels, lut.shape[1] * lut.shape[2])
    for i in range(n):
        row = source[i]
        span = min(i + 1, n - 1) - max(i - 1, 0)
        _shadow_row(z[row], geometry[i], i == 0, ray, lit)
        _central_slope(z, row, 0, cell, slope_x)
        _incidence_row(
            z[source[max(i - 1, 0)]],
            z[row],
            z[source[min(i + 1, n - 1)]],
            slope_x,
            geometry[i],
            1.0 / (cell * span) if span > 0 else 0.0,
            lut.shape[2] - 2,
            where,
            gain,
        )
        kind = cover[row]
        _state_row(lit, gain, kind, none, state[i])
        if pattern.shape[0] > 0:
            _pattern_row(z[row], geometry[i], pattern, gain)
        _offset_row(z[row], geometry[i], ground_format, offset[i])
        _index_row(where, kind, lut.shape[1] - 1, lut.shape[2], index, part)
        for c in range(n_channels):
            _echo_row(tables[c], index, part, gain, lit, power[c, i])
            if field_factor.shape[1] > 0:
                _field_row(field[row], field_factor[c], power[c, i])


@kernel
def mark_cells(
    z: AnyArray,
    source: AnyArray,
    cover: AnyArray,
    none: int,
    geometry: AnyArray,
    cell: float,
    ground_format: bool,
    offset: AnyArray,
    state: AnyArray,
) -> None:
    """`power_cells` without the power: range position and mask bits of every element.

    Parameters
    ----------
    z, source, cover, geometry, cell, ground_format, offset, state
        As in `power_cells`.
    none : int
        Least category that stands for no data.
    """
    n = source.shape[0]
    m = z.shape[1]
    ray = np.empty(m, dtype=z.dtype)
    lit = np.empty(m, dtype=z.dtype)
    where = np.empty(m, dtype=z.dtype)
    gain = np.empty(m, dtype=z.dtype)
    slope_x = np.empty(m, dtype=z.dtype)
    for i in range(n):
        row = source[i]
        above, below = max(i - 1, 0), min(i + 1, n - 1)
        per_range = 1.0 / (cell * (below - above)) if below > above else 0.0
        _shadow_row(z[row], geometry[i], i == 0, ray, lit)
        _central_slope(z, row, 0, cell, slope_x)
        _incidence_row(z[source[above]], z[row], z[source[below]], slope_x, geometry[i], per_range, 1, where, gain)
        _offset_row(z[row], geometry[i], ground_format, offset[i])
        _state_row(lit, gain, cover[row], np.uint8(none), state[i])


@kernel
def sum_echoes(
    z: AnyArray,
    source: AnyArray,
    cover: AnyArray,
    field: AnyArray,
    geometry: AnyArray,
    cell: float,
    ground_format: bool,
    lut: AnyArray,
    field_factor: AnyArray,
    pattern: AnyArray,
    base: AnyArray,
    first: int,
    nearest: bool,
    low: int,
    high: int,
    out: AnyArray,
) -> None:
    """`power_cells` and `bin_range` in one pass over columns `low` to `high`, without arrays of cells.

    Every column stands alone, so any division into strips, in any number of threads, gives the same bits.

    Parameters
    ----------
    z, source, cover, field, geometry, cell, ground_format, lut, field_factor, pattern
        As in `power_cells`.
    base, first, nearest, out
        As in `bin_range`.
    low, high : int
        Columns to do, ``low <= j < high``.
    """
    n = source.shape[0]
    m = high - low
    n_channels = lut.shape[0]
    ray = np.empty(m, dtype=z.dtype)
    lit = np.empty(m, dtype=z.dtype)
    where = np.empty(m, dtype=z.dtype)
    gain = np.empty(m, dtype=z.dtype)
    slope_x = np.empty(m, dtype=z.dtype)
    part = np.empty(m, dtype=z.dtype)
    index = np.empty(m, dtype=np.uint32)
    tables = lut.reshape(n_channels, lut.shape[1] * lut.shape[2])
    share = np.empty(m, dtype=z.dtype)
    power = np.empty(m, dtype=z.dtype)
    start = np.empty(m, dtype=np.int32)
    stop = np.empty(m, dtype=np.int32)
    before = np.empty(m, dtype=z.dtype)
    now = np.empty(m, dtype=z.dtype)
    after = np.empty(m, dtype=z.dtype)
    _offset_row(z[source[0], low:high], geometry[0], ground_format, now)
    before[:] = now
    for i in range(n):
        row = source[i]
        here = z[row, low:high]
        span = min(i + 1, n - 1) - max(i - 1, 0)
        _shadow_row(here, geometry[i], i == 0, ray, lit)
        _central_slope(z, row, low, cell, slope_x)
        _incidence_row(
            z[source[max(i - 1, 0)], low:high],
            here,
            z[source[min(i + 1, n - 1)], low:high],
            slope_x,
            geometry[i],
            1.0 / (cell * span) if span > 0 else 0.0,
            lut.shape[2] - 2,
            where,
            gain,
        )
        if pattern.shape[0] > 0:
            _pattern_row(here, geometry[i], pattern, gain)
        if i + 1 < n:
            _offset_row(z[source[i + 1], low:high], geometry[i + 1], ground_format, after)
        else:
            after[:] = now
        origin = math.floor(base[i + 1])
        least, most, long = _edges_row(before, now, after, base, i, origin, nearest, share, start, stop)
        shift = origin - first
        _index_row(where, cover[row, low:high], lut.shape[1] - 1, lut.shape[2], index, part)
        for c in range(n_channels):
            _echo_row(tables[c], index, part, gain, lit, power)
            if field_factor.shape[1] > 0:
                _field_row(field[row, low:high], field_factor[c], power)
            _add_row(power, share, start, stop, shift, least, most, long, low, out[c])
            if long > 1:
                _add_long(power, before, now, after, base, i, origin, shift, low, out[c])
        before, now, after = now, after, before


@kernel
def _shadow_row(here: AnyArray, geometry: AnyArray, first: bool, ray: AnyArray, lit: AnyArray) -> None:
    """Advance the height of the shadow ray by one row; `lit` is 1 where the ground reaches it, else 0."""
    one = here.dtype.type(1.0)
    zero = here.dtype.type(0.0)
    if first:
        for j in range(here.shape[0]):
            ray[j] = here[j]
            lit[j] = one
    else:
        descent = here.dtype.type(geometry[2])
        height = here.dtype.type(geometry[5])
        for j in range(here.shape[0]):
            # One step down the line from the antenna through the highest point so far.
            s = ray[j] - (height - ray[j]) * descent
            lit[j] = zero if here[j] < s else one
            ray[j] = max(s, here[j])


@kernel
def _incidence_row(
    above: AnyArray,
    here: AnyArray,
    below: AnyArray,
    slope_x: AnyArray,
    geometry: AnyArray,
    per_range: float,
    steps: int,
    where: AnyArray,
    gain: AnyArray,
) -> None:
    """Position in the table of sigma0, and tilt x (reference range / range)**4; 0 where the ground faces away."""
    number = here.dtype.type
    one, half, zero = number(1.0), number(0.5), number(0.0)
    h = number(geometry[4])
    y = number(geometry[0])
    row_gain = number(geometry[3])
    inverse_r = number(1.0 / geometry[1])
    inverse_r2 = number(1.0 / geometry[1] ** 2)
    per_slope = number(per_range)
    per_q = number(steps / math.sqrt(0.5))
    last = number(steps)
    for j in range(here.shape[0]):
        slope_y = (below[j] - above[j]) * per_slope
        # u = (R**2 - R_datum**2) / R_datum**2 from the height alone: no difference of two large numbers.
        u = -here[j] * (h + h - here[j]) * inverse_r2
        closer = one / math.sqrt(one + u)
        inverse = inverse_r * closer
        toward = (h - here[j]) * inverse
        along = y * inverse
        tilt2 = one + slope_x[j] * slope_x[j] + slope_y * slope_y
        tilt = math.sqrt(tilt2)
        facing = along * slope_y + toward
        across = toward * slope_y - along
        # sin(theta/2)**2 from the vector product: exact near theta = 0, where 1 - cos would lose its digits.
        sine2 = across * across + slope_x[j] * slope_x[j]
        half_sine2 = half * sine2 / (tilt2 + tilt * max(facing, zero))
        where[j] = min(math.sqrt(half_sine2) * per_q, last)
        closer2 = closer * closer
        gain[j] = row_gain * (closer2 * closer2) * tilt if facing > zero else zero


@kernel
def _state_row(lit: AnyArray, gain: AnyArray, cover: AnyArray, none: np.uint8, state: AnyArray) -> None:
    """Bits CAST_SHADOW, SELF_SHADOW and NO_DATA."""
    zero = gain.dtype.type(0.0)
    for j in range(gain.shape[0]):
        flag = np.uint8(0)
        if lit[j] == zero:
            flag |= np.uint8(CAST_SHADOW)
        if gain[j] == zero:
            flag |= np.uint8(SELF_SHADOW)
        if cover[j] >= none:
            flag |= np.uint8(NO_DATA)
        state[j] = flag


@kernel
def _pattern_row(here: AnyArray, geometry: AnyArray, pattern: AnyArray, gain: AnyArray) -> None:
    """Multiply by the antenna's and the atmosphere's two-way factor at each element's own look angle."""
    steps = pattern.shape[0] - 1
    for j in range(here.shape[0]):
        look = math.atan2(geometry[0], geometry[4] - here[j]) - geometry[8]
        x = min(max(look * (steps / (0.5 * math.pi)), 0.0), float(steps))
        k = min(int(x), steps - 1)
        gain[j] *= pattern[k] + (x - k) * (pattern[k + 1] - pattern[k])


@kernel
def _index_row(where: AnyArray, cover: AnyArray, none: int, width: int, index: AnyArray, part: AnyArray) -> None:
    """Place of each element in the flat table of sigma0, and the part of a step beyond it."""
    number = where.dtype.type
    last = np.int32(none)
    stride = np.int32(width)
    for j in range(where.shape[0]):
        k = np.int32(where[j])
        part[j] = where[j] - number(k)
        index[j] = np.uint32(min(np.int32(cover[j]), last) * stride + k)


@kernel
def _echo_row(table: AnyArray, index: AnyArray, part: AnyArray, gain: AnyArray, lit: AnyArray, power: AnyArray) -> None:
    """sigma0 of each element's category at its angle, times gain, where it is lit."""
    for j in range(power.shape[0]):
        # Unsigned indices: spares the test for indices counted from the end.
        k = np.uint64(index[j])
        low = table[k]
        power[j] = (low + part[j] * (table[k + np.uint64(1)] - low)) * (gain[j] * lit[j])


@kernel
def _field_row(field: AnyArray, factor: AnyArray, power: AnyArray) -> None:
    """Multiply by the factor of each element's field."""
    for j in range(power.shape[0]):
        power[j] *= factor[np.uint32(field[j])]


@kernel
def _central_slope(z: AnyArray, row: int, low: int, cell: float, out: AnyArray) -> None:
    """Slope along the track by central differences, one-sided at the ends of the row, 0 for a single cell."""
    m = z.shape[1]
    height = z[row]
    per_two = z.dtype.type(0.5 / cell)
    begin = max(low, 1)
    end = min(low + out.shape[0], m - 1)
    if end > begin:
        left = height[begin - 1 : end - 1]
        right = height[begin + 1 : end + 1]
        inner = out[begin - low : end - low]
        for j in range(inner.shape[0]):
            inner[j] = (right[j] - left[j]) * per_two
    per_one = z.dtype.type(1.0 / cell)
    if low == 0:
        out[0] = (height[1] - height[0]) * per_one if m > 1 else z.dtype.type(0.0)
    if m > 1 and low + out.shape[0] == m:
        out[m - 1 - low] = (height[m - 1] - height[m - 2]) * per_one


@kernel
def offset_rows(z: AnyArray, geometry: AnyArray, ground_format: bool, out: AnyArray) -> None:
    """Range position minus that of the datum [bins] of heights in some rows (see `power_cells`).

    Parameters
    ----------
    z : float array (n, k)
        Heights over the datum [m].
    geometry : float64 array (n, 9)
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
def bin_range(power: AnyArray, offset: AnyArray, base: AnyArray, first: int, nearest: bool, out: AnyArray) -> None:
    """Add every element's power to the range bins it overlaps: eqs. (3-21) to (3-23), split by exact overlap.

    An element reaches half way to its neighbours in range, so the elements of a column cover it without gap; layover
    falls out by itself. Bins beyond `out` drop what falls there.

    Parameters
    ----------
    power : float array (n_channels, n, m)
    offset : float array (n, m)
        Range position minus the row's [bins].
    base : float64 array (n + 2,)
        Range position of the datum in each row [bins], with one row more at both ends.
    first : int
        Bin of ``out[:, 0]``.
    nearest : bool
        Give an element whole to the bin of its centre, as the report does; a homogeneous plane then shows a ripple.
    out : float array (n_channels, n_bins, m)
        Zeroed by the caller; sums are added.
    """
    n_channels, n, m = power.shape
    start = np.empty(m, dtype=np.int32)
    stop = np.empty(m, dtype=np.int32)
    share = np.empty(m, dtype=offset.dtype)
    for i in range(n):
        above, here, below = offset[max(i - 1, 0)], offset[i], offset[min(i + 1, n - 1)]
        origin = math.floor(base[i + 1])
        least, most, long = _edges_row(above, here, below, base, i, origin, nearest, share, start, stop)
        shift = origin - first
        for c in range(n_channels):
            _add_row(power[c, i], share, start, stop, shift, least, most, long, 0, out[c])
            if long > 1:
                _add_long(power[c, i], above, here, below, base, i, origin, shift, 0, out[c])


@kernel
def _edges_row(
    above: AnyArray,
    here: AnyArray,
    below: AnyArray,
    base: AnyArray,
    i: int,
    origin: int,
    nearest: bool,
    share: AnyArray,
    start: AnyArray,
    stop: AnyArray,
) -> tuple[int, int, int]:
    """First and last bin of each element counted from `origin`, and the share of the first.

    Returns the least first bin, the greatest last bin and the greatest number of bins beyond the first.
    """
    number = here.dtype.type
    half, one, zero = number(0.5), number(1.0), number(0.0)
    if nearest:
        middle = number(base[i + 1] - origin)
        for j in range(here.shape[0]):
            start[j] = _floor(middle + here[j])
            stop[j] = start[j]
            share[j] = one
    else:
        near = number(0.5 * (base[i] + base[i + 1]) - origin)
        beyond = number(0.5 * (base[i + 1] + base[i + 2]) - origin)
        for j in range(here.shape[0]):
            a = near + half * (above[j] + here[j])
            b = beyond + half * (here[j] + below[j])
            low = min(a, b)
            high = max(a, b)
            k0 = _floor(low)
            width = high - low
            # The share of the first bin; with one bin it is all.
            part = (number(k0) + one - low) / width if width > zero else one
            share[j] = min(part, one)
            start[j] = k0
            stop[j] = _floor(high)
    least = np.int32(2147483647)
    most = np.int32(-2147483648)
    long = np.int32(0)
    for j in range(here.shape[0]):
        least = min(least, start[j])
        most = max(most, stop[j])
        long = max(long, np.int32(stop[j] - start[j]))
    return int(least), int(most), int(long)


@kernel
def _floor(x: float) -> np.int32:
    """Largest whole number not above `x`, as int32: cast and compare, which vectorise where floor does not."""
    k = np.int32(x)
    return np.int32(k - np.int32(1)) if x < k else k


@kernel
def _add_row(
    power: AnyArray,
    share: AnyArray,
    start: AnyArray,
    stop: AnyArray,
    shift: int,
    least: int,
    most: int,
    long: int,
    low: int,
    out: AnyArray,
) -> None:
    """Add the elements of a row that reach over one or two bins, leaving out what falls beyond `out`."""
    n_bins = out.shape[0]
    m = power.shape[0]
    zero = power.dtype.type(0.0)
    if long <= 1 and most - least < _FEW_BINS:
        # Bin by bin over the whole row: more arithmetic, but no scatter, so it vectorises.
        for k in range(max(least, -shift), min(most, n_bins - 1 - shift) + 1):
            line = out[k + shift, low : low + m]
            this = np.int32(k)
            before = np.int32(k - 1)
            for j in range(m):
                s = power[j] * share[j]
                line[j] += (s if start[j] == this else zero) + (power[j] - s if start[j] == before else zero)
    else:
        for j in range(m):
            k = start[j] + shift
            if stop[j] - start[j] <= 1:
                s = power[j] * share[j]
                if 0 <= k < n_bins:
                    out[k, low + j] += s
                if 0 <= k + 1 < n_bins:
                    out[k + 1, low + j] += power[j] - s


@kernel
def _add_long(
    power: AnyArray,
    above: AnyArray,
    here: AnyArray,
    below: AnyArray,
    base: AnyArray,
    i: int,
    origin: int,
    shift: int,
    column: int,
    out: AnyArray,
) -> None:
    """Add the elements of a row that reach over three or more bins (see `bin_range`)."""
    number = here.dtype.type
    n_bins = out.shape[0]
    half = number(0.5)
    near = number(0.5 * (base[i] + base[i + 1]) - origin)
    beyond = number(0.5 * (base[i + 1] + base[i + 2]) - origin)
    for j in range(here.shape[0]):
        a = near + half * (above[j] + here[j])
        b = beyond + half * (here[j] + below[j])
        low = min(a, b)
        high = max(a, b)
        k0 = np.int64(_floor(low))
        k1 = np.int64(_floor(high))
        if k1 - k0 > 1:
            density = power[j] / (high - low)
            for k in range(k0, k1 + 1):
                if 0 <= k + shift < n_bins:
                    inside = min(high, number(k + 1)) - max(low, number(k))
                    out[k + shift, column + j] += density * inside


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
    for c in range(n_channels):
        for i in range(n_bins):
            total[0] = 0.0
            for j in range(m):
                total[j + 1] = total[j] + sums[c, i, j]
            if beam[i] > 1.0:
                smooth = np.empty(m, dtype=np.float64)
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
