"""Every compiled kernel of the simulator, in one self-contained file.

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
    mean: AnyArray, noise: AnyArray, looks: AnyArray, numbers: AnyArray, k0: np.uint32, k1: np.uint32, out: AnyArray
) -> None:
    """Add the receiver's noise in power, then fading: RSL TR 380-1 eq. (3-11), once per resolution cell.

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
    out : float array, shape of `mean`
        Written: power with noise and speckle [W].
    """
    n_channels, n_range, n_azimuth = mean.shape
    for c in range(n_channels):
        for i in range(n_range):
            shape = looks[i]
            scale = shape - 1.0 / 3.0
            root = 1.0 / math.sqrt(9.0 * scale)
            for j in range(n_azimuth):
                fading = gamma_mean_one(shape, i, j, numbers[c], k0, k1, scale, root)
                out[c, i, j] = (mean[c, i, j] + noise[i]) * fading


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
    cover: AnyArray,
    field: AnyArray,
    geometry: AnyArray,
    height: float,
    cell: float,
    ground_format: bool,
    bin_m: float,
    lut: AnyArray,
    field_factor: AnyArray,
    power: AnyArray,
    offset: AnyArray,
    state: AnyArray,
) -> None:
    """Mean power and range position of every data-base element: the report's program POWER.

    Shadow by the height of the shadow ray, local incidence by eqs. (3-30) and (3-31) from the cell's own position, area
    of the sloping element, sigma0 of the element's own category, fourth power of the range.

    Parameters
    ----------
    z : float array (n, m)
        Elevation above the datum [m], no gaps.
    cover : uint8 array (n, m)
        Category, 255 where there is none.
    field : int32 array (n, m)
        Field, >= 0 wherever there is a category.
    geometry : float64 array (n, 4)
        For each row: ground range y [m]; slant range of the datum [m]; ``cell / y`` of the row before (0 in row 0);
        ``(reference range / slant range)**4``.
    height : float
        Height of the antenna above the datum [m].
    cell : float
        Side of a cell [m].
    ground_format : bool
        True: position is flat-ground range; False: slant range.
    bin_m : float
        Spacing of the range bins, in the units of the format [m].
    lut : float array (n_channels, n_categories, k)
        sigma0 at ``k - 1`` equal steps of sin(theta/2) from 0 to sin(45 deg), and the last value once more.
    field_factor : float array (n_channels, n_fields)
        Factor of each field's sigma0 on this occasion.
    power : float array (n_channels, n, m)
        Written: sigma0 x surface area / cell**2 x (reference range / range)**4.
    offset : float array (n, m)
        Written: range position minus that of the datum in the same row [bins].
    state : uint8 array (n, m)
        Written: bits CAST_SHADOW, SELF_SHADOW, NO_DATA.
    """
    n, m = z.shape
    n_channels = lut.shape[0]
    steps = lut.shape[2] - 2
    one = z.dtype.type(1.0)
    half = z.dtype.type(0.5)
    zero = z.dtype.type(0.0)
    h = z.dtype.type(height)
    per_q = z.dtype.type(steps / math.sqrt(0.5))
    last = z.dtype.type(steps)
    ray = np.empty(m, dtype=z.dtype)
    where = np.empty(m, dtype=z.dtype)
    gain = np.empty(m, dtype=z.dtype)
    slope_x = np.zeros(m, dtype=z.dtype)
    for i in range(n):
        above = z[max(i - 1, 0)]
        here = z[i]
        below = z[min(i + 1, n - 1)]
        flags = state[i]
        y = z.dtype.type(geometry[i, 0])
        row_gain = z.dtype.type(geometry[i, 3])
        inverse_r = z.dtype.type(1.0 / geometry[i, 1])
        inverse_r2 = z.dtype.type(1.0 / geometry[i, 1] ** 2)
        span = min(i + 1, n - 1) - max(i - 1, 0)
        per_range = z.dtype.type(1.0 / (cell * span)) if span > 0 else zero
        # Short loops over the row, each of few arrays: one long loop with a gather in it would not vectorise.
        if i == 0:
            for j in range(m):
                ray[j] = here[j]
                flags[j] = np.uint8(0)
        else:
            descent = z.dtype.type(geometry[i, 2])
            for j in range(m):
                # One step down the line from the antenna through the highest point so far.
                s = ray[j] - (h - ray[j]) * descent
                flags[j] = np.uint8(CAST_SHADOW) if here[j] < s else np.uint8(0)
                ray[j] = max(s, here[j])
        _central_slope(here, cell, slope_x)
        for j in range(m):
            slope_y = (below[j] - above[j]) * per_range
            # u = (R**2 - R_datum**2) / R_datum**2 from the height alone: no difference of two large numbers.
            u = -here[j] * (h + h - here[j]) * inverse_r2
            inverse = inverse_r / math.sqrt(one + u)
            toward = (h - here[j]) * inverse
            along = y * inverse
            tilt2 = one + slope_x[j] * slope_x[j] + slope_y * slope_y
            tilt = math.sqrt(tilt2)
            cosine = (along * slope_y + toward) / tilt
            across = toward * slope_y - along
            sine2 = (across * across + slope_x[j] * slope_x[j]) / tilt2
            # sin(theta/2), from the vector product: exact near theta = 0, where 1 - cos would lose its digits.
            where[j] = min(math.sqrt(half * sine2 / (one + max(cosine, zero))) * per_q, last)
            r4 = one / ((one + u) * (one + u))
            gain[j] = row_gain * r4 * tilt if cosine > zero else zero
        for j in range(m):
            if gain[j] == zero:
                flags[j] |= np.uint8(SELF_SHADOW)
            if cover[i, j] == 255:
                flags[j] |= np.uint8(NO_DATA)
        _range_offset(
            here, geometry[i, 0] if ground_format else geometry[i, 1], height, bin_m, ground_format, offset[i]
        )
        for c in range(n_channels):
            for j in range(m):
                value = zero
                if flags[j] == 0:
                    k = np.uint32(where[j])
                    f = where[j] - z.dtype.type(k)
                    kind = np.uint32(cover[i, j])
                    low = lut[c, kind, k]
                    value = (low + f * (lut[c, kind, k + 1] - low)) * gain[j] * field_factor[c, np.uint32(field[i, j])]
                power[c, i, j] = value


@kernel
def _central_slope(height: AnyArray, cell: float, out: AnyArray) -> None:
    """Slope of a profile by central differences, one-sided at its ends, 0 for a single cell."""
    m = height.shape[0]
    per_two = height.dtype.type(0.5 / cell)
    for j in range(1, m - 1):
        out[j] = (height[j + 1] - height[j - 1]) * per_two
    if m > 1:
        per_one = height.dtype.type(1.0 / cell)
        out[0] = (height[1] - height[0]) * per_one
        out[m - 1] = (height[m - 1] - height[m - 2]) * per_one


@kernel
def _range_offset(
    z: AnyArray, position: float, height: float, bin_m: float, ground_format: bool, out: AnyArray
) -> None:
    """Range position of a row of elements minus `position`, that of flat ground [bins].

    sqrt(p**2 + d) - p = d / (p (1 + sqrt(1 + d / p**2))) with d = -z (2 H - z): the same in both formats, where p is
    the ground or the slant range of the datum.
    """
    one = z.dtype.type(1.0)
    zero = z.dtype.type(0.0)
    h = z.dtype.type(height)
    inverse_p2 = z.dtype.type(1.0 / position**2)
    to_bins = z.dtype.type(1.0 / (bin_m * position))
    # A point closer than the nadir return has no place on the ground: it is put at nadir.
    least = z.dtype.type(-position / bin_m)
    for j in range(z.shape[0]):
        rise = -z[j] * (h + h - z[j])
        out[j] = rise * to_bins / (one + math.sqrt(max(one + rise * inverse_p2, zero)))
    if ground_format:
        for j in range(z.shape[0]):
            out[j] = max(out[j], least)


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
def bin_range(power: AnyArray, offset: AnyArray, base: AnyArray, first: int, out: AnyArray) -> None:
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
    out : float array (n_channels, n_bins, m)
        Zeroed by the caller; sums are added.
    """
    n_channels, n, m = power.shape
    n_bins = out.shape[1]
    half = offset.dtype.type(0.5)
    one = offset.dtype.type(1.0)
    zero = offset.dtype.type(0.0)
    start = np.empty(m, dtype=np.int64)
    stop = np.empty(m, dtype=np.int64)
    share = np.empty(m, dtype=offset.dtype)
    for i in range(n):
        above = max(i - 1, 0)
        below = min(i + 1, n - 1)
        origin = math.floor(base[i + 1])
        near = offset.dtype.type(0.5 * (base[i] + base[i + 1]) - origin)
        beyond = offset.dtype.type(0.5 * (base[i + 1] + base[i + 2]) - origin)
        shift = np.int64(origin) - first
        several = False
        for j in range(m):
            a = near + half * (offset[above, j] + offset[i, j])
            b = beyond + half * (offset[i, j] + offset[below, j])
            low = min(a, b)
            high = max(a, b)
            k0 = math.floor(low)
            k1 = math.floor(high)
            width = high - low
            # The share of the first bin; with one bin it is all.
            part = (k0 + one - low) / width if width > zero else one
            share[j] = min(part, one)
            start[j] = np.int64(k0) + shift
            stop[j] = np.int64(k1) + shift
            several |= k1 > k0 + one
        for c in range(n_channels):
            for j in range(m):
                p = power[c, i, j]
                k = start[j]
                if p != zero and (stop[j] - k <= 1):
                    s = p * share[j]
                    if 0 <= k < n_bins:
                        out[c, k, j] += s
                    if 0 <= k + 1 < n_bins:
                        out[c, k + 1, j] += p - s
            if several:
                _bin_long(power, offset, base, first, out, c, i)


@kernel
def _bin_long(power: AnyArray, offset: AnyArray, base: AnyArray, first: int, out: AnyArray, c: int, i: int) -> None:
    """Add the elements of row `i` that reach over three or more bins (see `bin_range`)."""
    n, m = offset.shape
    n_bins = out.shape[1]
    above = max(i - 1, 0)
    below = min(i + 1, n - 1)
    half = offset.dtype.type(0.5)
    origin = math.floor(base[i + 1])
    near = offset.dtype.type(0.5 * (base[i] + base[i + 1]) - origin)
    beyond = offset.dtype.type(0.5 * (base[i + 1] + base[i + 2]) - origin)
    shift = np.int64(origin) - first
    for j in range(m):
        a = near + half * (offset[above, j] + offset[i, j])
        b = beyond + half * (offset[i, j] + offset[below, j])
        low = min(a, b)
        high = max(a, b)
        k0 = np.int64(math.floor(low))
        k1 = np.int64(math.floor(high))
        if k1 - k0 > 1:
            density = power[c, i, j] / (high - low)
            for k in range(k0, k1 + 1):
                inside = min(high, offset.dtype.type(k + 1)) - max(low, offset.dtype.type(k))
                if 0 <= k + shift < n_bins:
                    out[c, k + shift, j] += density * inside


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
