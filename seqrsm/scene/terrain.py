"""Slopes of a terrain, and synthetic terrain of a given relief and roughness."""

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
    """Slope towards east and towards north.

    Parameters
    ----------
    elevation_m : array (rows, cols)
        Height [m], row 0 in the north; nan where it is not known.
    cell_m : float
        Side of a cell [m].

    Returns
    -------
    east, north : float64 arrays (rows, cols)
        Rise over run [1], by central differences inside and one-sided ones at the edges; nan beside a nan. Of a single
        row or column nothing is known across it, and it is taken as level.
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


def fractal_terrain(rows: int, cols: int, *, relief_m: float, seed: int, exponent: float = 3.5) -> FloatArray:
    """Terrain with a power-law spectrum and random phases.

    The spectrum of white noise, of twice the rows and columns, is kept in blocks of its columns, and every transform is
    done along one axis of some rows or of one block: a large one is never held twice.

    Parameters
    ----------
    rows, cols : int
        Size [cells], two at least.
    relief_m : float
        Difference between the highest and the lowest point [m], 0 at least, which gives a plane.
    seed : int
        Seed of the phases.
    exponent : float
        The two-dimensional power spectrum falls as wavenumber ** -exponent: 2 is rough, 4 is smooth (natural terrain
        about 3 to 4).

    Returns
    -------
    float64 array (rows, cols)
        Height above the lowest point [m].

    Notes
    -----
    Spectral synthesis, Voss 1985, "Random fractal forgeries". The grid is made twice as large as wanted and cut, since
    the synthesis is periodic.
    """
    if relief_m == 0.0:
        return np.zeros((rows, cols))
    k_row, k_col = np.fft.fftfreq(2 * rows), np.fft.rfftfreq(2 * cols)
    width = max(_CELLS_AT_ONCE // (2 * rows), 1)
    columns = [slice(k, min(k + width, cols + 1)) for k in range(0, cols + 1, width)]
    blocks = [np.empty((2 * rows, own.stop - own.start), dtype=np.complex128) for own in columns]
    draw = np.random.default_rng(seed)
    for own in strips(2 * rows, 2 * cols):
        noise = np.fft.rfft(draw.standard_normal((own.stop - own.start, 2 * cols)), axis=1)
        for block, part in zip(blocks, columns, strict=True):
            block[own] = noise[:, part]
    # The least is along an axis: there are no shorter waves' numbers than one period.
    longest = min(float(np.abs(k_row[1])), float(k_col[1]))
    for k, part in enumerate(columns):
        amplitude = np.hypot(k_row[:, np.newaxis], k_col[np.newaxis, part])
        if part.start == 0:
            amplitude[0, 0] = np.inf
        amplitude /= longest
        amplitude **= -0.5 * exponent
        # Only the rows that are wanted go on.
        blocks[k] = np.fft.ifft(np.fft.fft(blocks[k], axis=0) * amplitude, axis=0)[:rows].copy()
    terrain = np.empty((rows, cols))
    for own in strips(rows, 2 * cols):
        terrain[own] = np.fft.irfft(np.concatenate([block[own] for block in blocks], axis=1), 2 * cols, axis=1)[
            :, :cols
        ]
    lowest = terrain.min()
    spread = terrain.max() - lowest
    terrain -= lowest
    terrain /= spread
    terrain *= relief_m
    return terrain
