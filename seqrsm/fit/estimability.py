"""Runs that would make terms estimable which the present runs cannot tell apart."""

from __future__ import annotations

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region

SETTINGS_KNOWN = 5e-5
"""Root-mean-square error of coded settings, which are issued and told to four digits: rounding separates no terms."""
_TOLERANCE = 1e-9
_CANDIDATES = 5000  # settings to choose from


def missing_runs(model: QuadraticModel, region: Region, points: FloatArray) -> tuple[FloatArray, tuple[str, ...]]:
    """The smallest set of further runs (r, k) after which the model is estimable, and the terms that no run would mend.

    Each run removes one dependence at most, so a greedy choice that removes one with every run is a smallest set. Of
    the candidates that do, the one is taken that is most informative on what is still undetermined. ``points`` (n, k)
    are coded settings of the runs made so far; n may be 0. Of the terms that no run of the region can tell apart the
    factors or constraints are at fault, not the runs.
    """
    points = np.asarray(points, dtype=np.float64).reshape(-1, region.k)
    candidates = region.candidates(3, limit=_CANDIDATES)
    Z = model.matrix(candidates)
    null = _null_space(model.matrix(points)) if len(points) else np.eye(model.p)
    chosen = []
    while null.shape[1]:
        shadow = Z @ null
        size = np.sum(np.square(shadow), axis=1)
        best = int(np.argmax(np.round(size / max(float(size.max()), 1e-300), 9)))  # the first of equals
        if size[best] <= _TOLERANCE:
            break
        chosen.append(candidates[best])
        # Rotate the basis so that its first vector carries all of this run, and drop that one.
        Q, _ = np.linalg.qr(np.column_stack([shadow[best], np.eye(null.shape[1])]))
        null = null @ Q[:, 1 : null.shape[1]]
    return np.array(chosen).reshape(-1, region.k), _named(model, null)


def _null_space(Z: FloatArray) -> FloatArray:
    _, values, rows = np.linalg.svd(Z, full_matrices=True)
    rank = int(np.count_nonzero(values > SETTINGS_KNOWN * np.sqrt(len(Z))))
    return np.asarray(rows[rank:].T)


def _named(model: QuadraticModel, null: FloatArray) -> tuple[str, ...]:
    if not null.shape[1]:
        return ()
    involved = np.any(np.abs(null) > _TOLERANCE, axis=1)
    return tuple(name for name, hit in zip(model.term_names, involved.tolist(), strict=True) if hit)
