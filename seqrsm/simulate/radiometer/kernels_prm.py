"""The compiled kernels of what the ground radiates towards a radiometer; `kernels_scan` has those of the scan.

Arrays are ``[across, along]`` the track with the track contiguous: a row has one ground range from nadir and one look
angle for flat ground, and every step along it is independent, so the inner loops vectorise.
"""

from __future__ import annotations

import math

import numpy as np

from seqrsm.arrays import AnyArray
from seqrsm.jit import kernel

BLOCKED = 1
NO_DATA = 2


@kernel
def emit_cells(
    z: AnyArray,
    cover: AnyArray,
    field: AnyArray,
    surface: AnyArray,
    geometry: AnyArray,
    height: float,
    cell: float,
    lut: AnyArray,
    sky: AnyArray,
    place: AnyArray,
    field_factor: AnyArray,
    out: AnyArray,
    state: AnyArray,
) -> None:
    """Radiation of every data-base element towards the antenna: the report's program POWER.

    Blocking by the height of the line of sight on both sides of nadir, local look angle, emissivity of the element's
    own category and moisture, reflected sky, loss and radiation of the air below the antenna: eq. (3-35).

    Parameters
    ----------
    z : float array (n, m)
        Elevation above the datum [m], no gaps.
    cover : uint8 array (n, m)
        Category, 255 where there is none.
    field : int32 array (n, m)
        Field, >= 0.
    surface : float array (n, m)
        Physical temperature, or its Planck equivalent [K].
    geometry : float64 array (n, 5)
        For each row: distance from nadir [m]; ``cell / distance`` of the next row towards nadir (0: nothing there
        blocks); +1 or -1, the side; radiation of the air below the antenna [K]; 1 / L.
    height : float
        Antenna above the datum [m].
    cell : float
        Side of a cell [m].
    lut : uint64 or complex128 array (n_channels, n_categories, n_moistures, k), contiguous
        Emissivity at ``k - 1`` equal steps of sin(theta/2) from 0 to sin(45 deg), and the last value once more; each
        element is a pair of numbers of the type of ``z``, emissivity and its step to the next, that one load fetches.
    sky : float64 array (11,)
        Radiation of the sky on the ground [K]: the largest sin(theta/2)**2 that counts, then the ten coefficients of a
        polynomial in ``2 sin(theta/2)**2 / largest - 1``.
    place : float array (n_fields,)
        Place of each field's moisture among those of the table, 0 .. n_moistures - 1.
    field_factor : float array (n_channels, n_fields)
        Of each field's reflectivity, 1 - emissivity; no columns: 1.
    out : float array (n_channels, n, m)
        Written: antenna temperature of the element [K]; 0 where it is not seen.
    state : uint8 array (n, m)
        Written: bits BLOCKED, NO_DATA.
    """
    n, m = z.shape
    n_channels, n_categories, n_moistures, width = lut.shape
    none = np.uint8(n_categories)
    tables = lut.reshape(n_channels, n_categories * n_moistures * width)
    ray = np.empty(m, dtype=z.dtype)
    lit = np.empty(m, dtype=z.dtype)
    where = np.empty(m, dtype=z.dtype)
    part = np.empty(m, dtype=z.dtype)
    wetter = np.empty(m, dtype=z.dtype)
    index = np.empty(m, dtype=np.uint32)
    slope_x = np.zeros(m, dtype=z.dtype)
    e = np.empty(m, dtype=z.dtype)
    fetched = np.empty(m, dtype=lut.dtype)
    pairs = fetched.view(z.dtype)
    reflected = np.empty(m, dtype=z.dtype)
    middle = 0
    while middle < n - 1 and geometry[middle, 2] < 0.0:
        middle += 1
    # From nadir outward: the right side first, then the left.
    for step in range(n):
        i = middle + step if middle + step < n else n - 1 - step
        here = z[i]
        _block_row(here, geometry[i, 1], height, ray, lit)
        _slope_row(here, cell, slope_x)
        span = min(i + 1, n - 1) - max(i - 1, 0)
        per_out = geometry[i, 2] / (cell * span) if span > 0 else 0.0
        _look_row(z[max(i - 1, 0)], here, z[min(i + 1, n - 1)], slope_x, geometry[i, 0], per_out, height, width - 2,
                  where, lit)  # fmt: skip
        _state_row(lit, cover[i], none, state[i])
        _index_row(where, cover[i], none, width * n_moistures, index, part)
        if n_moistures > 1:
            _moisture_row(field[i], place, width, index, wetter)
        for c in range(n_channels):
            if n_moistures > 1:
                _moist_row(tables[c], index, part, wetter, width, fetched, pairs, e)
            else:
                _dry_row(tables[c], index, part, fetched, pairs, e)
            if field_factor.shape[1] > 0:
                _field_row(field[i], field_factor[c], e)
            if c == 0:
                _sky_row(where, sky, 0.5 / (width - 2) ** 2, reflected)
            _radiate_row(e, reflected, surface[i], geometry[i, 3], geometry[i, 4], state[i], out[c, i])


@kernel
def _block_row(here: AnyArray, descent: float, height: float, ray: AnyArray, lit: AnyArray) -> None:
    """Advance the height of the highest line of sight by one row; `lit` is 1 where the ground rises to it, else 0."""
    number = here.dtype.type
    one, zero = number(1.0), number(0.0)
    if descent == 0.0:
        for j in range(here.shape[0]):
            ray[j] = here[j]
            lit[j] = one
    else:
        h, fall = number(height), number(descent)
        for j in range(here.shape[0]):
            s = ray[j] - (h - ray[j]) * fall
            lit[j] = zero if here[j] < s else one
            ray[j] = max(s, here[j])


@kernel
def _slope_row(here: AnyArray, cell: float, out: AnyArray) -> None:
    """Slope along the track by central differences, one-sided at the ends of the row."""
    m = here.shape[0]
    if m < 2:
        return
    number = here.dtype.type
    per_two, per_one = number(0.5 / cell), number(1.0 / cell)
    left, right, inner = here[: m - 2], here[2:], out[1 : m - 1]
    for j in range(m - 2):
        inner[j] = (right[j] - left[j]) * per_two
    out[0] = (here[1] - here[0]) * per_one
    out[m - 1] = (here[m - 1] - here[m - 2]) * per_one


@kernel
def _look_row(
    above: AnyArray,
    here: AnyArray,
    below: AnyArray,
    slope_x: AnyArray,
    distance: float,
    per_out: float,
    height: float,
    steps: int,
    where: AnyArray,
    lit: AnyArray,
) -> None:
    """Place of the local look angle in the tables; ground that faces away is not lit."""
    number = here.dtype.type
    one, half, zero = number(1.0), number(0.5), number(0.0)
    h, y, per_slope = number(height), number(distance), number(per_out)
    per_q, last = number(steps / math.sqrt(0.5)), number(steps)
    for j in range(here.shape[0]):
        slope_y = (below[j] - above[j]) * per_slope
        drop = h - here[j]
        # Vectors to the antenna and of the slope, neither normalised: one root for both lengths.
        lengths2 = (y * y + drop * drop) * (one + slope_x[j] * slope_x[j] + slope_y * slope_y)
        facing = y * slope_y + drop
        across = drop * slope_y - y
        # sin(theta/2)**2 from the vector product: exact near theta = 0, where 1 - cos would lose its digits.
        sine2 = across * across + (y * y + drop * drop) * (slope_x[j] * slope_x[j])
        half_sine2 = half * sine2 / (lengths2 + math.sqrt(lengths2) * max(facing, zero))
        where[j] = min(math.sqrt(half_sine2) * per_q, last)
        lit[j] = lit[j] if facing > zero else zero


@kernel
def _state_row(lit: AnyArray, cover: AnyArray, none: np.uint8, state: AnyArray) -> None:
    """Bits BLOCKED and NO_DATA."""
    zero = lit.dtype.type(0.0)
    for j in range(lit.shape[0]):
        flag = np.uint8(BLOCKED) if lit[j] == zero else np.uint8(0)
        if cover[j] >= none:
            flag |= np.uint8(NO_DATA)
        state[j] = flag


@kernel
def _index_row(where: AnyArray, cover: AnyArray, none: np.uint8, stride: int, index: AnyArray, part: AnyArray) -> None:
    """Place of each element in a flat table, and the part of a step beyond it; category 0 where there is none."""
    number = where.dtype.type
    jump = np.uint32(stride)
    for j in range(where.shape[0]):
        k = np.int32(where[j])
        part[j] = where[j] - number(k)
        kind = np.uint32(cover[j]) if cover[j] < none else np.uint32(0)
        index[j] = kind * jump + np.uint32(k)


@kernel
def _dry_row(table: AnyArray, index: AnyArray, part: AnyArray, fetched: AnyArray, pairs: AnyArray, e: AnyArray) -> None:
    """Emissivity from a table over the angle; `pairs` is `fetched` seen as single numbers."""
    for j in range(e.shape[0]):
        # Unsigned indices: spares the test for indices counted from the end.
        fetched[j] = table[np.uint64(index[j])]
    for j in range(e.shape[0]):
        e[j] = pairs[2 * j] + part[j] * pairs[2 * j + 1]


@kernel
def _moisture_row(field: AnyArray, place: AnyArray, width: int, index: AnyArray, wetter: AnyArray) -> None:
    """Move the place in the table to the moisture of each element's field; the part of a step beyond it."""
    number = wetter.dtype.type
    row = np.uint32(width)
    for j in range(index.shape[0]):
        at = place[np.uint32(field[j])]
        p = np.int32(at)
        wetter[j] = at - number(p)
        index[j] += np.uint32(p) * row


@kernel
def _moist_row(
    table: AnyArray,
    index: AnyArray,
    part: AnyArray,
    wetter: AnyArray,
    width: int,
    fetched: AnyArray,
    pairs: AnyArray,
    e: AnyArray,
) -> None:
    """Emissivity from a table over moisture and angle."""
    row = np.uint64(width)
    _dry_row(table, index, part, fetched, pairs, e)
    for j in range(e.shape[0]):
        fetched[j] = table[np.uint64(index[j]) + row]
    for j in range(e.shape[0]):
        wet = pairs[2 * j] + part[j] * pairs[2 * j + 1]
        e[j] += wetter[j] * (wet - e[j])


@kernel
def _field_row(field: AnyArray, factor: AnyArray, e: AnyArray) -> None:
    """Multiply each element's reflectivity by its field's factor; emissivity stays within 0 and 1."""
    zero, one = e.dtype.type(0.0), e.dtype.type(1.0)
    for j in range(e.shape[0]):
        e[j] = one - (one - e[j]) * factor[np.uint32(field[j])]
    for j in range(e.shape[0]):
        e[j] = min(max(e[j], zero), one)


@kernel
def _sky_row(where: AnyArray, sky: AnyArray, per_step2: float, out: AnyArray) -> None:
    """Radiation of the sky at each element's local angle: a polynomial, which vectorises where a table would not."""
    number = where.dtype.type
    two, one = number(2.0), number(1.0)
    scale = number(per_step2 * 2.0 / sky[0])
    c0, c1, c2, c3, c4 = number(sky[1]), number(sky[2]), number(sky[3]), number(sky[4]), number(sky[5])
    c5, c6, c7, c8, c9 = number(sky[6]), number(sky[7]), number(sky[8]), number(sky[9]), number(sky[10])
    for j in range(where.shape[0]):
        t = min(where[j] * where[j] * scale, two) - one
        out[j] = c0 + t * (c1 + t * (c2 + t * (c3 + t * (c4 + t * (c5 + t * (c6 + t * (c7 + t * (c8 + t * c9))))))))


@kernel
def _radiate_row(
    e: AnyArray,
    reflected: AnyArray,
    surface: AnyArray,
    upwelling: float,
    transmission: float,
    state: AnyArray,
    out: AnyArray,
) -> None:
    """Emitted and reflected radiation through the air below the antenna, eq. (3-35); 0 where nothing is seen."""
    number = e.dtype.type
    zero, up, through = number(0.0), number(upwelling), number(transmission)
    for j in range(e.shape[0]):
        value = up + through * (reflected[j] + e[j] * (surface[j] - reflected[j]))
        out[j] = value if state[j] == 0 else zero
