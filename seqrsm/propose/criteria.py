"""The criteria a batch can be chosen by, and the covariance they start from."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.design.moments import region_moments
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.fit.rank_one import linear_gain

#: "optimum": half value at the optimum, half expected regret; "D": information on all coefficients; "I": mean
#: prediction variance over the region; "thompson": optima of posterior draws; "steepest": along the path of steepest
#: ascent.
CRITERIA = ("optimum", "D", "I", "thompson", "steepest")

_WEAK_PRECISION = 1e-2


@lru_cache(maxsize=8)
def average_matrix(model: QuadraticModel, region: Region) -> FloatArray:
    """Mean of ``zz'`` over the region: W of the I criterion, kept for the next call.

    Parameters
    ----------
    model, region : QuadraticModel, Region

    Returns
    -------
    ndarray (p, p)
        Read-only.
    """
    W = region_moments(model, region)
    W.setflags(write=False)
    return W


def unscaled_covariance(Z: FloatArray, weights: FloatArray | None, prior: FloatArray | None) -> FloatArray:
    """``(Z'WZ + prior)^-1``, with a weak prior where these do not determine all coefficients.

    Parameters
    ----------
    Z : ndarray (n, p)
        Rows of scored and pending runs.
    weights : ndarray (n,), optional
        Relative weights, > 0.
    prior : ndarray (q, q), optional
        Precision of the first q <= p coefficients, in units of 1/sigma squared.

    Returns
    -------
    ndarray (p, p)
        Symmetric. Where the runs and the prior are not enough, 0.01 was added: coefficients within 10 sigma.
    """
    Z = np.asarray(Z, dtype=np.float64)
    root = np.ones(len(Z)) if weights is None else np.sqrt(np.asarray(weights, dtype=np.float64))
    X = Z * root[:, None]
    M = X.T @ X
    if prior is not None:
        M[: len(prior), : len(prior)] += prior
    scale = np.sqrt(np.maximum(np.diag(M), 1e-300))
    if float(np.linalg.eigvalsh(M / np.outer(scale, scale))[0]) < 1e-10:
        M = M + _WEAK_PRECISION * np.eye(len(M))
    C = np.linalg.inv(M)
    return np.asarray(0.5 * (C + C.T))


def relative_drop(C: FloatArray, W: FloatArray, z: FloatArray, weight: float = 1.0) -> float:
    """Share by which a run at row ``z`` (p,) lowers ``trace(WC)``; 0 where that is 0 already."""
    total = float(np.sum(W * C))
    return float(linear_gain(C, W, z[None, :], weight)[0]) / total if total > 0.0 else 0.0
