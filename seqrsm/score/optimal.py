"""Optimal estimation of one number from several: distances and posterior means on a grid of its values."""

from __future__ import annotations

import numpy as np

from seqrsm.arrays import FloatArray


def mahalanobis(away: FloatArray, covariance: FloatArray) -> FloatArray:
    """Squares of Mahalanobis distances (n, m) of departures (d, n, m) with covariances (n, d, d)."""
    root = np.linalg.inv(np.linalg.cholesky(covariance + 1e-9 * np.eye(len(away))))
    return np.asarray(np.square(np.einsum("nab,bnm->anm", root, away)).sum(axis=0))


def posterior_mean(costs: FloatArray, grid: FloatArray, mean: float, sd: float) -> FloatArray:
    """Posterior means (n,) on a grid (m,), from squared distances (n, m) and a Gaussian prior."""
    cost = costs + np.square((grid - mean) / sd)
    weight = np.exp(-0.5 * (cost - cost.min(axis=1, keepdims=True)))
    return np.asarray((weight @ grid) / weight.sum(axis=1))
