"""Has a sampler converged: rank-normalised R-hat, effective sample sizes, integrated autocorrelation time.

References
----------
Vehtari, Gelman, Simpson, Carpenter, Buerkner (2021), Rank-normalization, folding, and localization: an improved R-hat
for assessing convergence of MCMC, Bayesian Analysis 16, 667-718.
Sokal (1997), Monte Carlo methods in statistical mechanics, section 3.3 (automatic windowing).
"""

from __future__ import annotations

import numpy as np
import scipy
from scipy.special import ndtri

from seqrsm.arrays import FloatArray

_WINDOW = 5.0  # the sum ends at the first lag M >= _WINDOW * tau(M)


def r_hat(chains: FloatArray) -> float:
    """Rank-normalised split R-hat of m chains of n draws (m, n), n >= 4: the larger of the bulk and the folded one.

    Near 1 when the chains agree; nan for constant chains. Walkers of one ensemble are not independent chains.
    """
    halves = _split(chains)
    folded = np.abs(halves - np.median(halves))
    return max(_r_hat(_rank_normalise(halves)), _r_hat(_rank_normalise(folded)))


def ess(chains: FloatArray) -> float:
    """Effective sample size of the mean; chains (m, n), n >= 4."""
    return _ess(_split(chains))


def ess_tail(chains: FloatArray, ends_at: tuple[float, float] = (0.05, 0.95)) -> float:
    """Smaller of the effective sample sizes of two quantiles, by default 5 % and 95 %; chains (m, n), n >= 4."""
    chains = np.asarray(chains, dtype=np.float64)
    ends = np.quantile(chains, ends_at)
    return min(_ess(_split((chains <= end).astype(np.float64))) for end in ends)


def autocorrelation_time(chain: FloatArray) -> FloatArray:
    """Integrated autocorrelation time (d,) of an ensemble (steps, walkers, d), in steps.

    The autocovariance is averaged over walkers about the pooled mean. At least about 1 for a chain that mixes; trust it
    when steps > 50 tau. inf for a constant chain.
    """
    steps, _, d = chain.shape
    length = scipy.fft.next_fast_len(2 * steps, real=True)
    tau = np.full(d, np.inf)
    for j in range(d):
        x = chain[:, :, j] - np.mean(chain[:, :, j])
        power = np.sum(np.square(np.abs(scipy.fft.rfft(x, length, axis=0))), axis=1)
        covariance = scipy.fft.irfft(power, length)[:steps]
        if covariance[0] <= 0.0:
            continue
        sums = 2.0 * np.cumsum(covariance / covariance[0]) - 1.0
        inside = np.arange(steps) < _WINDOW * np.maximum(sums, 1.0)
        end = int(np.argmin(inside)) if not np.all(inside) else steps - 1
        tau[j] = sums[end]
    return tau


def _split(chains: FloatArray) -> FloatArray:
    """Each chain cut into halves (2m, n // 2); the middle draw of an odd chain is left out."""
    chains = np.atleast_2d(np.asarray(chains, dtype=np.float64))
    half = chains.shape[1] // 2
    return np.concatenate([chains[:, :half], chains[:, -half:]])


def _rank_normalise(chains: FloatArray) -> FloatArray:
    """Normal scores of average ranks over all chains (Blom's fractions)."""
    flat = chains.ravel()
    _, inverse, counts = np.unique(flat, return_inverse=True, return_counts=True)
    last = np.cumsum(counts)
    rank = (last - 0.5 * (counts - 1))[inverse]
    return np.asarray(ndtri((rank - 0.375) / (flat.size + 0.25)).reshape(chains.shape), dtype=np.float64)


def _r_hat(chains: FloatArray) -> float:
    n = chains.shape[1]
    within = float(np.mean(np.var(chains, axis=1, ddof=1)))
    between = float(np.var(np.mean(chains, axis=1), ddof=1))
    if within == 0.0:
        return float("nan")
    return float(np.sqrt((n - 1) / n + between / within))


def _ess(chains: FloatArray) -> float:
    """Effective sample size by Geyer's initial monotone sequence over split chains (Vehtari et al. eq. 10-13)."""
    m, n = chains.shape
    if np.ptp(chains) == 0.0:
        return float(m * n)
    length = scipy.fft.next_fast_len(2 * n, real=True)
    x = chains - np.mean(chains, axis=1, keepdims=True)
    covariance = scipy.fft.irfft(np.square(np.abs(scipy.fft.rfft(x, length, axis=1))), length, axis=1)[:, :n] / n
    mean_covariance = np.mean(covariance, axis=0)
    within = mean_covariance[0] * n / (n - 1.0)
    pooled = mean_covariance[0] + (np.var(np.mean(chains, axis=1), ddof=1) if m > 1 else 0.0)
    rho = 1.0 - (within - mean_covariance) / pooled
    rho[0] = 1.0
    n_pairs = max((n - 3) // 2, 1)  # of the last pair of lags only the even one counts
    pairs = rho[0 : 2 * n_pairs : 2] + rho[1 : 2 * n_pairs : 2]
    negative = np.flatnonzero(pairs < 0.0)
    kept = int(negative[0]) if negative.size else n_pairs
    monotone = np.minimum.accumulate(pairs[:kept])
    # The even lag after the last positive pair still improves the estimate for antithetic chains.
    tail = max(float(rho[2 * kept]), 0.0) if 2 * kept < n else 0.0
    tau = -1.0 + 2.0 * float(np.sum(monotone)) + tail
    tau = max(tau, 1.0 / np.log10(m * n))
    return float(m * n / tau)
