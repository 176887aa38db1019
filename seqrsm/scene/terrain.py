"""Slopes of a terrain, and synthetic terrain of a given relief and roughness."""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq

from seqrsm.arrays import AnyArray, FloatArray
from seqrsm.errors import Problem, SceneError

_EXPONENTS = (0.0, 12.0)


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


def rms_slope(elevation_m: AnyArray, cell_m: float) -> float:
    """Root of the mean squared slope [1] along one axis, over both axes; cells beside unknown ones left out.

    0 where no slope is known.
    """
    slope = np.asarray(slopes(elevation_m, cell_m))
    known = slope[np.isfinite(slope)]
    return float(np.sqrt(np.mean(np.square(known)))) if known.size else 0.0


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
    return relief_m * synthesis.unit_terrain(exponent, last=True)


class _Synthesis:
    """Random phases of one terrain, from which it can be made with any exponent."""

    def __init__(self, rows: int, cols: int, seed: int) -> None:
        self.rows, self.cols = rows, cols
        noise = np.random.default_rng(seed).standard_normal((2 * rows, 2 * cols))
        self.spectrum = np.fft.rfft2(noise)
        k_row, k_col = np.fft.fftfreq(2 * rows), np.fft.rfftfreq(2 * cols)
        self.wavenumber = np.hypot(k_row[:, np.newaxis], k_col[np.newaxis, :])
        self.wavenumber[0, 0] = np.inf

    def unit_terrain(self, exponent: float, *, last: bool = False) -> FloatArray:
        """Terrain between 0 and 1; the last one uses the phases up, which saves a large one half of its memory."""
        amplitude = self.wavenumber / self.wavenumber.min()
        amplitude **= -0.5 * exponent
        shaped = self.spectrum if last else self.spectrum.copy()
        shaped *= amplitude
        del amplitude
        if last:
            del self.spectrum, self.wavenumber
        terrain = np.fft.irfft2(shaped, s=(2 * self.rows, 2 * self.cols))
        del shaped
        terrain = terrain[: self.rows, : self.cols]
        return np.asarray((terrain - terrain.min()) / np.ptp(terrain))


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
