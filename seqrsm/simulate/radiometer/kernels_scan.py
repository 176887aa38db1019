"""The compiled kernels of a radiometer's scan: footprints of the beam, and the noise of the receiver.

Arrays are as in `seqrsm.simulate.radiometer.kernels_prm`; random numbers are those of the radar's kernels.
"""

from __future__ import annotations

import math

import numpy as np

from seqrsm.arrays import AnyArray
from seqrsm.jit import kernel
from seqrsm.simulate.radar.kernels_speckle import philox4x32
from seqrsm.simulate.radiometer.kernels_prm import BLOCKED, NO_DATA


@kernel
def bin_angle(emitted: AnyArray, offset: AnyArray, state: AnyArray, total: AnyArray, weight: AnyArray) -> None:
    """Put every seen element where the antenna sees it, on rows of flat ground, split by exact overlap.

    Raised ground is seen farther out. An element reaches half way to its neighbours, so what is seen fills the view
    without gap, and an element counts by the angle it fills.

    Parameters
    ----------
    emitted : float array (n_channels, n, m)
    offset : float array (n, m)
        Displacement along the rows' index [cells].
    state : uint8 array (n, m)
        Elements with any bit are left out.
    total : float array (n_channels, n, m)
        Zeroed by the caller; sums of emitted x overlap.
    weight : float array (n, m)
        Zeroed by the caller; sums of overlap.
    """
    n_channels, n, m = emitted.shape
    for i in range(n):
        above = offset[max(i - 1, 0)]
        here = offset[i]
        below = offset[min(i + 1, n - 1)]
        for j in range(m):
            if state[i, j] != 0:
                continue
            a = i - 0.5 + 0.5 * (above[j] + here[j])
            b = i + 0.5 + 0.5 * (here[j] + below[j])
            low = min(a, b) + 0.5
            high = max(a, b) + 0.5
            first = max(math.floor(low), 0)
            past = min(math.floor(high), n - 1)
            for k in range(first, past + 1):
                part = min(high, k + 1.0) - max(low, float(k))
                if part > 0.0:
                    weight[k, j] += part
                    for c in range(n_channels):
                        total[c, k, j] += part * emitted[c, i, j]


@kernel
def _beam_share(integral: AnyArray, u: float, per_width: float) -> float:
    """Share of a beam below ``u`` [beamwidths], by the table of its running integral."""
    x = u * per_width + 0.5 * (integral.shape[0] - 1)
    if x <= 0.0:
        return 0.0
    if x >= integral.shape[0] - 1:
        return 1.0
    k = int(x)
    return integral[k] + (x - k) * (integral[k + 1] - integral[k])


@kernel
def average_along(
    total: AnyArray,
    weight: AnyArray,
    part: AnyArray,
    width: AnyArray,
    advance: float,
    cell: float,
    integral: AnyArray,
    per_width: float,
    out: AnyArray,
    seen: AnyArray,
) -> None:
    """Beam-weighted sums along the track, for each row and each line.

    Parameters
    ----------
    total : float array (n_channels, n, m)
    weight : float array (n, m)
        Of `bin_angle`.
    part : float64 array (n,)
        Share of the sweep from left to right that has passed when the axis crosses the row, 0 to 1.
    width : float64 array (n,)
        Half-power width of the beam along the track in the row [m].
    advance, cell : float
        Way between lines; side of a cell [m].
    integral : float64 array (2 q + 1,)
        Running integral of the beam.
    per_width : float
        Its steps in one beamwidth.
    out : float64 array (n_channels, n, n_lines)
        Written.
    seen : float64 array (n, n_lines)
        Written: sums of the weights.
    """
    n_channels, n, m = total.shape
    n_lines = seen.shape[1]
    middle = 0.5 * (integral.shape[0] - 1)
    below = np.empty(m + 1)
    for i in range(n):
        reach = middle / per_width * width[i]
        per_cell = cell / width[i] * per_width
        for line in range(n_lines):
            # Odd sweeps come back.
            centre = advance * (line + (part[i] if line % 2 == 0 else 1.0 - part[i]))
            first = min(max(math.floor((centre - reach) / cell), 0), m)
            past = max(min(math.ceil((centre + reach) / cell), m), first)
            _shares_row(integral, middle - centre / cell * per_cell, per_cell, first, past, below)
            # Two sums beside each other: one alone waits for its own last addition.
            norm = first_sum = 0.0
            for j in range(first, past):
                share = below[j + 1] - below[j]
                norm += share * weight[i, j]
                first_sum += share * total[0, i, j]
            seen[i, line] = norm
            out[0, i, line] = first_sum
            for c in range(1, n_channels):
                value = 0.0
                for j in range(first, past):
                    value += (below[j + 1] - below[j]) * total[c, i, j]
                out[c, i, line] = value


@kernel
def _shares_row(integral: AnyArray, start: float, per_cell: float, first: int, past: int, out: AnyArray) -> None:
    """Share of a beam below the edge of each cell from ``first`` to ``past``; `start` is the place of edge 0."""
    last = integral.shape[0] - 1.0
    for j in range(first, past + 1):
        x = min(max(start + j * per_cell, 0.0), last)
        k = np.uint64(min(x, last - 1.0))
        low = integral[k]
        out[j] = low + (x - k) * (integral[k + np.uint64(1)] - low)


@kernel
def average_across(
    rows: AnyArray,
    seen: AnyArray,
    edge: AnyArray,
    look: AnyArray,
    beamwidth: float,
    integral: AnyArray,
    per_width: float,
    out: AnyArray,
) -> None:
    """Footprints: beam-weighted means of the rows' sums in the direction of the sweep.

    Parameters
    ----------
    rows : float64 array (n_channels, n, n_lines)
    seen : float64 array (n, n_lines)
        Of `average_along`.
    edge : float64 array (n + 1,)
        Look angles of the rows' edges [rad], rising.
    look : float64 array (n_samples,)
        Look angles of the footprints [rad].
    beamwidth : float
        [rad]
    integral : float64 array (2 q + 1,)
        Running integral of the beam with its smear.
    per_width : float
        Its steps in one beamwidth.
    out : float array (n_channels, n_samples, n_lines)
        Written [K]; nan where nothing is seen.
    """
    n_channels, n, n_lines = rows.shape
    n_samples = look.shape[0]
    reach = 0.5 * (integral.shape[0] - 1) / per_width * beamwidth
    total = np.empty((n_channels, n_lines))
    norm = np.empty(n_lines)
    for s in range(n_samples):
        total[:] = 0.0
        norm[:] = 0.0
        for i in range(n):
            if edge[i + 1] < look[s] - reach or edge[i] > look[s] + reach:
                continue
            share = _beam_share(integral, (edge[i + 1] - look[s]) / beamwidth, per_width) - _beam_share(
                integral, (edge[i] - look[s]) / beamwidth, per_width
            )
            if share <= 0.0:
                continue
            for line in range(n_lines):
                norm[line] += share * seen[i, line]
            for c in range(n_channels):
                for line in range(n_lines):
                    total[c, line] += share * rows[c, i, line]
        for c in range(n_channels):
            for line in range(n_lines):
                out[c, s, line] = total[c, line] / norm[line] if norm[line] > 0.0 else math.nan


@kernel
def register_cells(offset: AnyArray, state: AnyArray, scan: AnyArray, footprint: AnyArray, coverage: AnyArray) -> None:
    """Nearest footprint of every element, and how many half-power footprints of single sweeps hold its centre.

    Parameters
    ----------
    offset : float array (n, m)
        Displacement by height [cells].
    state : uint8 array (n, m)
    scan : float64 array (13,)
        Height [m], cell [m], half-power width with its smear [rad], half angle of the sweep [rad], first look angle and
        step of the footprints [rad], their number, width of the footprint at nadir [m], way between sweeps [m], number
        of sweeps, sweeps averaged into a line, number of lines, farthest look angle at which something is seen [rad].
    footprint : int32 array (n, m)
        Written: ``sample * n_lines + line``; -1 without data and beyond the sweep.
    coverage : int32 array (n, m)
        Written.
    """
    n, m = offset.shape
    height, cell, half_angle = scan[0], scan[1], scan[3]
    look = np.empty(m)
    place = np.empty(m)
    part = np.empty(m)
    half_width = np.empty(m)
    line = np.empty(m)
    for i in range(n):
        y = (i - 0.5 * (n - 1)) * cell
        _look_angle_row(offset[i], y, height, cell, look, half_width)
        for j in range(m):
            part[j] = min(max(0.5 + 0.5 * look[j] / half_angle, 0.0), 1.0) if half_angle > 0.0 else 0.5
            half_width[j] *= 0.5 * scan[7]
            place[j] = (j + 0.5) * cell
        _nearest_line_row(place, part, scan[8], scan[10], scan[11], line)
        _sweeps_over_row(place, part, half_width, scan[8], scan[9], coverage[i])
        _footprint_row(look, line, state[i], scan, footprint[i], coverage[i])


@kernel
def _look_angle_row(
    offset: AnyArray, y: float, height: float, cell: float, look: AnyArray, per_cosine: AnyArray
) -> None:
    """Look angle of the place where each element of a row is seen, and 1 / cos of it."""
    straight = math.atan(y / height)
    most = 0.0
    for j in range(look.shape[0]):
        shift = offset[j] * cell
        t = shift * height / (height * height + y * (y + shift))
        most = max(most, abs(t))
        # The difference of two arc tangents is the arc tangent of t, which is small: its series to t**7.
        look[j] = straight + t * (1.0 - t * t * (1.0 / 3.0 - t * t * (0.2 - t * t * (1.0 / 7.0))))
        s = (y + shift) / height
        per_cosine[j] = math.sqrt(1.0 + s * s)
    if not most < 0.1:
        for j in range(look.shape[0]):
            look[j] = math.atan((y + offset[j] * cell) / height)


@kernel
def _nearest_line_row(
    place: AnyArray, part: AnyArray, advance: float, averaged: float, lines: float, out: AnyArray
) -> None:
    """Nearest image line of each element of a row; of two at one distance the first.

    A line is the mean of some sweeps: an odd number of them zigzags as one sweep does, by a square of the number less;
    an even number is straight.
    """
    per_pair = 0.5 / (advance * averaged)
    less = 1.0 / (averaged * averaged) if averaged % 2.0 == 1.0 else 0.0
    last_even, last_odd = np.floor(0.5 * (lines - 1.0)), np.floor(0.5 * (lines - 2.0))
    for j in range(place.shape[0]):
        half = 0.5 * (0.5 + (part[j] - 0.5) * less)
        # In pairs of lines: even ones lie at q + half, odd ones at q + 1 - half.
        even = place[j] * per_pair - half
        odd = place[j] * per_pair - 1.0 + half
        a = min(max(np.floor(even + 0.5), 0.0), last_even)
        b = min(max(np.floor(odd + 0.5), 0.0), last_odd)
        to_a = abs(even - a)
        to_b = abs(odd - b) if last_odd >= 0.0 else math.inf
        first, second = 2.0 * a, 2.0 * b + 1.0
        nearer = first if to_a < to_b else second
        out[j] = min(first, second) if to_a == to_b else nearer


@kernel
def _sweeps_over_row(
    place: AnyArray, part: AnyArray, half_width: AnyArray, advance: float, sweeps: float, out: AnyArray
) -> None:
    """Number of single sweeps whose half-power beam holds each element of a row."""
    per_pair = 0.5 / advance
    last_even, last_odd = np.floor(0.5 * (sweeps - 1.0)), np.floor(0.5 * (sweeps - 2.0))
    for j in range(place.shape[0]):
        half = 0.5 * part[j]
        reach = half_width[j] * per_pair
        even = place[j] * per_pair - half
        odd = place[j] * per_pair - 1.0 + half
        n_even = min(np.floor(even + reach), last_even) - max(np.ceil(even - reach), 0.0) + 1.0
        n_odd = min(np.floor(odd + reach), last_odd) - max(np.ceil(odd - reach), 0.0) + 1.0
        out[j] = np.int32(max(n_even, 0.0) + max(n_odd, 0.0))


@kernel
def _footprint_row(
    look: AnyArray, line: AnyArray, state: AnyArray, scan: AnyArray, footprint: AnyArray, coverage: AnyArray
) -> None:
    """Number of each element's footprint, and its count of sweeps times that of the footprints of one sweep."""
    beamwidth, start, step, samples, n_lines, farthest = scan[2], scan[4], scan[5], scan[6], scan[11], scan[12]
    for j in range(look.shape[0]):
        at = (look[j] - start) / step
        reach = 0.5 * beamwidth / step
        held = min(np.floor(at + reach), samples - 1.0) - max(np.ceil(at - reach), 0.0) + 1.0
        sample = min(max(np.floor(at + 0.5), 0.0), samples - 1.0)
        inside = abs(look[j]) <= farthest and (state[j] & NO_DATA) == 0
        footprint[j] = np.int32(sample * n_lines + line[j]) if inside else np.int32(-1)
        seen = inside and (state[j] & BLOCKED) == 0
        coverage[j] = coverage[j] * np.int32(max(held, 0.0)) if seen else np.int32(0)


@kernel
def add_receiver_noise(
    mean: AnyArray, nedt: AnyArray, numbers: AnyArray, k0: np.uint32, k1: np.uint32, out: AnyArray
) -> None:
    """Add one Gaussian draw to each footprint's antenna temperature (n_channels, n_samples, n_lines) [K].

    ``out`` is written. ``nedt``: standard deviation [K], same shape. ``numbers`` (n_channels,): of each channel in the
    counter, so that its noise is the same whoever is received beside it.
    """
    n_channels, n_samples, n_lines = mean.shape
    for c in range(n_channels):
        for s in range(n_samples):
            for line in range(n_lines):
                w0, w1, w2, _ = philox4x32(np.uint32(s), np.uint32(line), np.uint32(numbers[c]), np.uint32(0), k0, k1)
                u = ((w0 >> np.uint32(5)) * 67108864.0 + (w1 >> np.uint32(6)) + 0.5) / 9007199254740992.0
                x = math.sqrt(-2.0 * math.log(u)) * math.cos(2.0 * math.pi * ((w2 + 0.5) / 4294967296.0))
                out[c, s, line] = mean[c, s, line] + nedt[c, s, line] * x
