"""Slopes of a terrain."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from seqrsm.arrays import AnyArray, FloatArray

_CELLS_AT_ONCE = 4_000_000
"""Cells of a large terrain worked on at a time: the work space of all of them would be many times their own."""


def strips(rows: int, cols: int) -> Iterator[slice]:
    """Rows of a large layer by and by."""
    step = max(_CELLS_AT_ONCE // max(cols, 1), 1)
    return (slice(first, min(first + step, rows)) for first in range(0, rows, step))


def slopes(elevation_m: AnyArray, cell_m: float) -> tuple[FloatArray, FloatArray]:
    """Slope towards east and towards north, rise over run (rows, cols) [1], of heights (rows, cols) [m].

    Row 0 is in the north, nan where the height is not known. By central differences inside and one-sided ones at the
    edges; nan beside a nan. Of a single row or column nothing is known across it, and it is taken as level.
    """
    z = np.asarray(elevation_m, dtype=np.float64)
    east, south = (np.gradient(z, cell_m, axis=k) if z.shape[k] > 1 else 0.0 * z for k in (1, 0))
    return np.asarray(east), np.asarray(-south)


def known_slopes(elevation_m: AnyArray, cell_m: float) -> Iterator[tuple[FloatArray, FloatArray]]:
    """`slopes` of some rows at a time; cells beside unknown ones left out, so each is a flat array."""
    rows, cols = elevation_m.shape
    for own in strips(rows, cols):
        first = max(own.start - 1, 0)
        around = slopes(elevation_m[first : own.stop + 1], cell_m)
        east, north = (slope[own.start - first : own.stop - first] for slope in around)
        yield east[np.isfinite(east)], north[np.isfinite(north)]


def rms_slope(elevation_m: AnyArray, cell_m: float) -> float:
    """Root of the mean squared slope [1] along one axis, over both axes; cells beside unknown ones left out.

    0 where no slope is known.
    """
    total, n = 0.0, 0
    for both in known_slopes(elevation_m, cell_m):
        slope = np.concatenate(both)
        total += float(np.add.reduce(np.square(slope)))
        n += slope.size
    return float(np.sqrt(total / n)) if n else 0.0
