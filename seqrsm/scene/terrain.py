"""Slopes of a terrain, and synthetic terrain of a given relief and roughness."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.optimize import brentq

from seqrsm.arrays import AnyArray, FloatArray
from seqrsm.errors import Problem, SceneError

_EXPONENTS = (0.0, 12.0)

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


def fractal_terrain(
    rows: int,
    cols: int,
    cell_m: float,
    *,
    relief_m: float,
    seed: int,
    rms_slope: float | None = None,
    exponent: float = 3.5,
) -> FloatArray:
    """Terrain with a power-law spectrum and random phases.

    Parameters
    ----------
    rows, cols : int
        Size [cells].
    cell_m : float
        Side of a cell [m].
    relief_m : float
        Difference between the highest and the lowest point [m]; 0 gives a plane.
    seed : int
        Seed of the phases.
    rms_slope : float, optional
        Wanted root-mean-square slope along one axis [1]; the exponent is then found for it.
    exponent : float
        The two-dimensional power spectrum falls as wavenumber ** -exponent: 2 is rough, 4 is smooth (natural terrain
        about 3 to 4).

    Returns
    -------
    float64 array (rows, cols)
        Height above the lowest point [m].

    Raises
    ------
    SceneError
        No terrain of this size has that relief and that slope together.

    Notes
    -----
    Spectral synthesis, Voss 1985, "Random fractal forgeries". The grid is made twice as large as wanted and cut, since
    the synthesis is periodic.
    """
    if relief_m < 0.0 or cell_m <= 0.0 or min(rows, cols) < 2:
        message = f"no terrain of {rows} x {cols} cells of {cell_m} m with {relief_m} m relief"
        raise SceneError(Problem(message, "Give at least 2 x 2 cells, a positive cell and a relief >= 0"))
    if relief_m == 0.0:
        return np.zeros((rows, cols))
    synthesis = _Synthesis(rows, cols, seed)
    if rms_slope is not None:
        exponent = _exponent_of_slope(synthesis, cell_m, relief_m, rms_slope)
    terrain = synthesis.unit_terrain(exponent, last=True)
    terrain *= relief_m
    return terrain


class _Synthesis:
    """Random phases of one terrain, from which it can be made with any exponent.

    The spectrum of white noise, of twice the rows and columns, is kept in blocks of its columns, and every transform is
    done along one axis of some rows or of one block: a large one is never held twice.
    """

    def __init__(self, rows: int, cols: int, seed: int) -> None:
        self.rows, self.cols = rows, cols
        self.k_row, self.k_col = np.fft.fftfreq(2 * rows), np.fft.rfftfreq(2 * cols)
        width = max(_CELLS_AT_ONCE // (2 * rows), 1)
        self.columns = [slice(k, min(k + width, cols + 1)) for k in range(0, cols + 1, width)]
        self.blocks = [np.empty((2 * rows, own.stop - own.start), dtype=np.complex128) for own in self.columns]
        draw = np.random.default_rng(seed)
        for own in strips(2 * rows, 2 * cols):
            noise = np.fft.rfft(draw.standard_normal((own.stop - own.start, 2 * cols)), axis=1)
            for block, part in zip(self.blocks, self.columns, strict=True):
                block[own] = noise[:, part]
        for block in self.blocks:
            block[:] = np.fft.fft(block, axis=0)
        # The least is along an axis: there are no shorter waves' numbers than one period.
        self.longest = min(float(np.abs(self.k_row[1])), float(self.k_col[1]))

    def unit_terrain(self, exponent: float, *, last: bool = False) -> FloatArray:
        """Terrain between 0 and 1; the last one uses the phases up, which saves a large one half of its memory."""
        shaped = []
        for k, part in enumerate(self.columns):
            amplitude = np.hypot(self.k_row[:, np.newaxis], self.k_col[np.newaxis, part])
            if part.start == 0:
                amplitude[0, 0] = np.inf
            amplitude /= self.longest
            amplitude **= -0.5 * exponent
            amplitude = self.blocks[k] * amplitude
            if last:
                self.blocks[k] = np.empty((0, 0), dtype=np.complex128)
            # Only the rows that are wanted go on.
            shaped.append(np.fft.ifft(amplitude, axis=0)[: self.rows].copy())
        terrain = np.empty((self.rows, self.cols))
        for own in strips(self.rows, 2 * self.cols):
            rows = np.concatenate([block[own] for block in shaped], axis=1)
            terrain[own] = np.fft.irfft(rows, 2 * self.cols, axis=1)[:, : self.cols]
        lowest = terrain.min()
        spread = terrain.max() - lowest
        terrain -= lowest
        terrain /= spread
        return terrain


def _exponent_of_slope(synthesis: _Synthesis, cell_m: float, relief_m: float, wanted: float) -> float:
    """Exponent at which the terrain of relief ``relief_m`` has the rms slope ``wanted``."""

    def excess(exponent: float) -> float:
        return relief_m * rms_slope(synthesis.unit_terrain(exponent), cell_m) - wanted

    steepest, smoothest = excess(_EXPONENTS[0]), excess(_EXPONENTS[1])
    if not smoothest < 0.0 < steepest:
        low, high = wanted + smoothest, wanted + steepest
        message = f"a relief of {relief_m} m on this grid allows rms slopes of {low:.3g} to {high:.3g}"
        raise SceneError(Problem(message, "Change the relief, the slope or the size", field="rms_slope", value=wanted))
    return float(brentq(excess, *_EXPONENTS, xtol=1e-4))
