"""What is known before the next run: of the coefficients, and of the optimum that is sought.

With C the unscaled covariance of the coefficients, a run with model row z and relative weight w lowers the variance of
every contrast ``l'beta`` by ``(l'Cz)^2 / (1/w + z'Cz)`` (in units of sigma squared). Scores do not enter, so a batch is
built run by run, and runs that are still pending count like scored ones.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region

Rows = Callable[[FloatArray], FloatArray]
"""Model rows (n, p) of coded points (n, k)."""

VALUE = 0.3
"""What a variance of the value at the optimum counts, where that of the loss counts 1.

With 1 runs gather where the optimum seems to be, which tells little of where it is; see `reports/peers`.
"""

_WEAK_PRECISION = 1e-2
_MAX_TARGETS = 128


@dataclass(frozen=True, slots=True)
class Evidence:
    """Runs made and pending, and what was known before them."""

    rows: FloatArray
    """(r, p) or (r, p + e): model rows; e further columns (blocks) are nuisance and zero for new runs."""
    points: FloatArray | None = None
    """(r, k): coded settings, which repeats are chosen from."""
    weights: FloatArray | None = None
    """(r,): relative weights; 1 by default."""
    prior_precision: FloatArray | None = None
    """(p, p) or (p + e, p + e): added to Z'WZ, in units of 1/sigma squared."""
    df_pure_error: int = 0
    """Degrees of freedom of pure error, with those that pending repeats will bring."""
    barred: FloatArray | None = None
    """(b, k): settings that could not be carried out: nothing within 0.1 (coded) of one of them is proposed, unless
    that leaves nothing."""


@dataclass(frozen=True, slots=True)
class Sought:
    """The optimum that is sought, as far as it is known."""

    x_hat: FloatArray
    """(k,): estimated optimum, coded."""
    points: FloatArray
    """(m, k): optima of posterior draws, coded; 64 or more are advised."""
    rows: Rows | None = None
    """Model rows of the runs that the campaign is about, where these are not simply those of the model: a simulated run
    has no discrepancy, the flights that it is to predict have."""
    common: float = 0.0
    """Variance of what a future run has beyond its own error, in units of sigma squared: its day's effect."""


class Known:
    """The unscaled covariance C (p, p) of the coefficients, nuisance columns too, and the contrasts that matter.

    ``x_hat`` (k,) and ``targets`` (m, k), at most 128, are where the optimum is, as estimated and by posterior draws;
    ``value`` and ``regret`` those of `optimum_targets`; ``weight`` that of a new run. C and ``df_pure_error`` follow
    the runs taken.
    """

    def __init__(
        self, model: QuadraticModel, region: Region, evidence: Evidence, sought: Sought, weight: float = 1.0
    ) -> None:
        self.model, self.region, self.sought, self.weight = model, region, sought, weight
        self.C = unscaled_covariance(evidence.rows, evidence.weights, evidence.prior_precision)
        self.df_pure_error = evidence.df_pure_error
        self.x_hat = np.asarray(sought.x_hat, dtype=np.float64)
        points = np.atleast_2d(np.asarray(sought.points, dtype=np.float64))
        self.targets = points[:: max(1, -(-len(points) // _MAX_TARGETS))]
        rows = model.matrix if sought.rows is None else sought.rows
        self._z_hat = self.padded(rows(self.x_hat[None, :]))[0]
        self.value, self.regret = optimum_targets(self._z_hat, self.padded(rows(self.targets)))

    def padded(self, rows: FloatArray) -> FloatArray:
        """Model rows, with zeros for nuisance columns."""
        extra = len(self.C) - rows.shape[1]
        return np.hstack([rows, np.zeros((len(rows), extra))]) if extra else rows

    def narrowing(self, row: FloatArray) -> str:
        """What a run at this row does to the two intervals at the estimated optimum."""
        h = float(self._z_hat @ self.C @ self._z_hat)
        C = downdate(self.C, row, self.weight)
        h_new = max(float(self._z_hat @ C @ self._z_hat), 0.0)
        of_run = 1.0 / self.weight + self.sought.common
        prediction = 1.0 - np.sqrt((of_run + h_new) / (of_run + h))
        confidence = 1.0 - np.sqrt(h_new / h) if h > 0.0 else 0.0
        return (
            f"narrows the prediction interval at the optimum by {percent(prediction)}, the confidence interval of the "
            f"mean by {percent(confidence)}"
        )

    def take(self, row: FloatArray, repeats: bool) -> None:
        """Count a run at this row as made."""
        self.C = downdate(self.C, row, self.weight)
        self.df_pure_error += repeats


def percent(share: float) -> str:
    """A share in percent, two digits."""
    shown = 100.0 * share
    return "less than 0.01 %" if shown < 0.01 else f"{shown:.2g} %" if shown < 99.5 else "100 %"


def unscaled_covariance(Z: FloatArray, weights: FloatArray | None, prior: FloatArray | None) -> FloatArray:
    """``(Z'WZ + prior)^-1`` (p, p), symmetric, of rows Z (n, p) with weights (n,) > 0, 1 by default.

    ``prior`` (q, q) is the precision of the first q <= p coefficients, in units of 1/sigma squared. Where runs and
    prior leave a coefficient undetermined 0.01 is added to all: coefficients within 10 sigma.
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


def downdate(C: FloatArray, z: FloatArray, weight: float = 1.0) -> FloatArray:
    """Unscaled covariance (p, p) after one more run with row z (p,) and a weight (Sherman-Morrison); symmetric."""
    Cz = C @ z
    return np.asarray(C - np.outer(Cz, Cz) / (1.0 / weight + np.sum(z * Cz)))


def optimum_targets(z_hat: FloatArray, z_star: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Matrices W (p, p) of the default criterion: the value at the optimum, and the expected regret.

    ``trace(W_regret C)`` is the mean variance of the difference between the place where the optimum seems to be and
    those where posterior draws put it, which is what choosing wrongly costs; ``trace(W_value C)`` is `VALUE` times that
    of the estimated response at the optimum, where it seems to be (one half) and where the draws put it (the other).
    ``z_hat`` (p,) and ``z_star`` (s, p) are the model rows there.
    """
    s = max(len(z_star), 1)
    spread = z_star - z_hat
    draws = z_star.T @ z_star / s
    return np.asarray(0.5 * VALUE * (np.outer(z_hat, z_hat) + draws)), np.asarray(spread.T @ spread / s)
