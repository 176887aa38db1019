"""What one more run does to a fit: rank-one gains for any linear criterion.

With C the unscaled covariance of the coefficients, a run with model row z and relative weight w lowers the variance of
every contrast ``l'beta`` by ``(l'Cz)^2 / (1/w + z'Cz)`` (in units of sigma squared). Scores do not enter, so a batch is
built run by run, and runs that are still pending count like scored ones. Leading axes are batched throughout: many
campaigns at once in the rehearsal, one in a proposal.
"""

from __future__ import annotations

import numpy as np

from seqrsm.arrays import FloatArray


def linear_gain(C: FloatArray, W: FloatArray, Z: FloatArray, weight: float = 1.0) -> FloatArray:
    """Gain ``z'CWCz / (1/w + z'Cz)`` of every candidate: the drop of ``trace(WC)``.

    Parameters
    ----------
    C : ndarray (p, p)
        Unscaled covariance.
    W : ndarray (p, p)
        ``sum_s q_s l_s l_s'`` of the contrasts that matter.
    Z : ndarray (n, p)
        Model rows of the candidates.
    weight : float
        Relative weight of the new run.

    Returns
    -------
    ndarray (n,)
        >= 0, in units of sigma squared.
    """
    CZ = Z @ C
    gain: FloatArray = np.sum((CZ @ W) * CZ, axis=1) / (1.0 / weight + np.sum(CZ * Z, axis=1))
    return gain


def information_gain(C: FloatArray, Z: FloatArray, weight: float = 1.0) -> FloatArray:
    """Gain of the D criterion, ``1/2 log(1 + w z'Cz)``: the information on all coefficients together [nats].

    Parameters
    ----------
    C : ndarray (p, p)
    Z : ndarray (n, p)
    weight : float

    Returns
    -------
    ndarray (n,)
    """
    gain: FloatArray = 0.5 * np.log1p(weight * np.sum((Z @ C) * Z, axis=1))
    return gain


def downdate(C: FloatArray, z: FloatArray, weight: float = 1.0) -> FloatArray:
    """Unscaled covariance after one more run (Sherman-Morrison).

    Parameters
    ----------
    C : ndarray (..., p, p)
    z : ndarray (..., p)
    weight : float

    Returns
    -------
    ndarray (..., p, p)
        Symmetric.
    """
    Cz = (C @ z[..., None])[..., 0]
    scale = 1.0 / weight + np.sum(z * Cz, axis=-1)
    lowered: FloatArray = C - Cz[..., :, None] * Cz[..., None, :] / scale[..., None, None]
    return lowered


def optimum_targets(z_hat: FloatArray, z_star: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Matrices W of the default criterion: half the value at the optimum, half the expected regret.

    Both halves are variances of scores, so they are added as they are: ``trace(W_value C)`` is the mean variance of the
    estimated response at the optimum, where it seems to be (one half) and where posterior draws put it (the other), and
    ``trace(W_regret C)`` that of the difference between the two places, which is what choosing wrongly costs.

    Parameters
    ----------
    z_hat : ndarray (..., p)
        Model row at the estimated optimum.
    z_star : ndarray (..., s, p)
        Model rows at the optima of s posterior draws.

    Returns
    -------
    W_value, W_regret : ndarray (..., p, p)
    """
    s = max(z_star.shape[-2], 1)
    spread = z_star - z_hat[..., None, :]
    draws = np.swapaxes(z_star, -1, -2) @ z_star / s
    value: FloatArray = 0.25 * z_hat[..., :, None] * z_hat[..., None, :] + 0.25 * draws
    regret: FloatArray = 0.5 * np.swapaxes(spread, -1, -2) @ spread / s
    return value, regret


def is_reserved_run(n_before: int, share: float) -> bool:
    """Whether run number ``n_before + 1`` is one of the share kept for repeats and spread.

    Counted over the whole campaign, so that one run in four is kept for any size of batch.
    """
    return int(np.floor((n_before + 1) * share + 1e-9)) > int(np.floor(n_before * share + 1e-9))
