"""What single runs do to a fit: leverage, deleted residuals, PRESS, Cook's distance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seqrsm.arrays import FloatArray

_LEVERAGE_ONE = 1e-10  # 1 - h below this: the run alone fixes a direction of the model


@dataclass(frozen=True, slots=True)
class RunDiagnostics:
    """Per-run figures of one fit; nan where undefined.

    Attributes
    ----------
    studentised : ndarray (n,)
        Externally studentised residuals, Student-t with ``df - 1`` degrees of freedom under the model.
    cooks_distance : ndarray (n,)
    press : float
        Sum of squared deleted residuals, weighted; nan when a run has leverage 1.
    leverage_one_runs : tuple of int
        Indices of runs with leverage 1.
    """

    studentised: FloatArray
    cooks_distance: FloatArray
    press: float
    leverage_one_runs: tuple[int, ...]


def run_diagnostics(r: FloatArray, leverage: FloatArray, df: int, rank: int) -> RunDiagnostics:
    """Diagnostics from weighted residuals ``r = sqrt(w) (y - fitted)`` (n,) and leverages (n,).

    ``df`` residual degrees of freedom, ``rank`` fitted parameters. Undefined figures are nan.
    """
    free = 1.0 - leverage
    fixed = free < _LEVERAGE_ONE
    free = np.where(fixed, np.nan, free)
    sse = float(r @ r)
    deleted = np.square(r) / free
    studentised = np.full(r.shape, np.nan)
    if df > 1:
        variance = (sse - deleted) / (df - 1)  # s^2 without run i
        usable = variance > 1e-14 * sse
        studentised[usable] = r[usable] / np.sqrt(variance[usable] * free[usable])
    cooks = np.full(r.shape, np.nan)
    if df > 0 and rank > 0 and sse > 0.0:
        cooks = deleted * leverage / free * df / (rank * sse)
    press = float("nan") if np.any(fixed) else float(np.sum(np.square(r / free)))
    return RunDiagnostics(studentised, cooks, press, tuple(int(i) for i in np.flatnonzero(fixed)))
