"""Errors that runs share: scores of one cheaper simulation are off together, which more of them do not average out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seqrsm.arrays import FloatArray

_NOTHING = 1e-9


@dataclass(frozen=True, slots=True)
class SharedError:
    """What shared errors do to the fitted mean at one point, given the scores.

    Attributes
    ----------
    shift : float
        Expected true mean less fitted mean, in the unit of the scores.
    variance : float
        Variance of the fitted mean's error that the scores leave open, the same unit squared; >= 0.
    errors : ndarray (r,)
        Expected shared errors, in units of their prior standard deviations.
    """

    shift: float
    variance: float
    errors: FloatArray


def shared_error(
    Z: FloatArray, y: FloatArray, weights: FloatArray, loadings: FloatArray, row: FloatArray
) -> SharedError:
    """Shared errors in y = Z beta + C delta + e, delta ~ N(0, 1), e_i ~ N(0, sigma^2 / w_i), beta flat.

    The fit is the least-squares one, which does not know of delta: its mean at a point is off by use' C delta, where
    use holds what each score counts in it. Contrasts of the scores that the model cannot follow tell of delta; sigma is
    taken from those that delta does not touch. Shift and variance together give the generalised least-squares mean
    and its variance (Henderson 1975, Biometrics 31, 423; tested against it).

    Parameters
    ----------
    Z : float64 array (n, p)
        Model matrix of full rank.
    y, weights : float64 array (n,)
        Scores, and inverse relative variances.
    loadings : float64 array (n, r)
        C: prior standard deviation of each shared error in each score, 0 for scores that it does not touch.
    row : float64 array (p,)
        Model row of the point.

    Returns
    -------
    SharedError
        Nothing shifted and all of the prior's variance where no degrees of freedom are left to learn from.
    """
    n, p = Z.shape
    root = np.sqrt(weights)
    Q, R = np.linalg.qr(Z * root[:, None])
    use = root * (Q @ np.linalg.solve(R.T, row))
    carried = use @ loadings
    contrasts, seen = root * y, loadings * root[:, None]
    contrasts, seen = contrasts - Q @ (Q.T @ contrasts), seen - Q @ (Q.T @ seen)
    basis, size, _ = np.linalg.svd(seen, full_matrices=False)
    basis = basis[:, size > _NOTHING * max(float(np.abs(loadings).max(initial=0.0)), 1e-300)]
    df = n - p - basis.shape[1]
    left = contrasts - basis @ (basis.T @ contrasts)
    sigma2 = float(left @ left) / df if df > 0 else 0.0
    r = loadings.shape[1]
    if not sigma2 > 0.0:
        return SharedError(0.0, float(carried @ carried), np.zeros(r))
    precision = np.eye(r) + seen.T @ seen / sigma2
    errors = np.asarray(np.linalg.solve(precision, seen.T @ contrasts / sigma2), dtype=np.float64)
    variance = float(carried @ np.linalg.solve(precision, carried))
    return SharedError(-float(carried @ errors), max(variance, 0.0), errors)
