"""What every fit asks of its runs."""

from __future__ import annotations

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.errors import FitError, Problem


def check_runs(Z: FloatArray, y: FloatArray, weights: FloatArray, n_terms: int) -> None:
    """Refuse runs whose score, weight or setting cannot be used, all at once and by number.

    Raises
    ------
    FitError
        A score or setting that is not finite, a weight that is not positive and finite.
    ValueError
        Shapes that disagree: a mistake of the calling program.
    """
    n = y.shape[0] if y.ndim == 1 else -1
    if n_terms < 1 or Z.ndim != 2 or Z.shape != (n, n_terms) or weights.shape != (n,):
        raise ValueError(f"shapes disagree: Z {Z.shape}, y {y.shape}, weights {weights.shape}, {n_terms} terms")
    problems = []
    for bad, what in (
        (~np.isfinite(y), "a score that is not a finite number"),
        (~(np.isfinite(weights) & (weights > 0.0)), "a weight that is not a positive finite number"),
        (~np.all(np.isfinite(Z), axis=1), "a setting that is not a finite number"),
    ):
        if np.any(bad):
            runs = ", ".join(str(i + 1) for i in np.flatnonzero(bad))
            problems.append(Problem(f"run {runs} (counted from 1) has {what}", "void it or correct it"))
    if problems:
        raise FitError(*problems)
