"""What is known of errors beside the common one: counts of decisions, and percentages on the logit scale.

A share of n decisions, each right with probability p, scatters with variance p (1 - p) / n; where decisions depend on
each other (one field, one day) with a multiple of it, the dispersion, which the residuals tell (Wedderburn 1974,
Biometrika 61, 439-447; McCullagh & Nelder 1989, Generalized Linear Models, section 4.5). On the percent scale a surface
that is quadratic in percent stays one.
"""

from __future__ import annotations

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.fit.transforms import clip_percent, logit_scores, logit_to_percent, logit_variance

_ROUNDS = 4
_LEAST_REPEATS = 3
"""Degrees of freedom of pure error from which it tells the scatter of scores; below, the residuals do."""


def share_variance(percent: FloatArray, trials: FloatArray | float) -> FloatArray:
    """Binomial variance of a score expected at ``percent`` [%] from ``trials`` decisions, percent squared.

    The probability is kept one decision in ``trials`` + 2 away from 0 and 1, where the formula would claim certainty.
    """
    n = np.asarray(trials, dtype=np.float64)
    edge = 1.0 / (n + 2.0)
    p = np.clip(np.asarray(percent, dtype=np.float64) / 100.0, edge, 1.0 - edge)
    return np.asarray(1e4 * p * (1.0 - p) / n)


def expected_shares(Z: FloatArray, percent: FloatArray, trials: FloatArray) -> FloatArray:
    """Scores (n,) that a linear model Z (n, p) expects of every run [%], each run counting by its binomial variance.

    Iteratively reweighted least squares: weights come from what is expected, since by what was scored a lucky run would
    count for more. With no more runs than terms the scores ``percent`` (n,) themselves [%], shrunk by one decision each
    way; ``trials`` (n,) are the decisions behind each, > 0.
    """
    expected: FloatArray = (percent * trials + 100.0) / (trials + 2.0)
    if len(percent) <= Z.shape[1]:
        return expected
    for _ in range(_ROUNDS):
        root = 1.0 / np.sqrt(share_variance(expected, trials))
        expected = Z @ np.linalg.lstsq(Z * root[:, None], percent * root, rcond=None)[0]
    return expected


def unbiased_logits(
    Z: FloatArray, percent: FloatArray, relative: FloatArray, trials: FloatArray | None = None, *, equal: bool = False
) -> tuple[FloatArray, FloatArray]:
    """Logits (n,) of percentages that scatter normally, and the score that the model expects of each run [%].

    A logit bends, so scores about 95 % have a mean logit above that of 95 %; and if a run counted by its own score, one
    near 100 would count for less than one as far below. Neither error shrinks with more runs. So logits are lowered by
    the excess of their mean, and weights are to go by what is expected. The empirical logit of a count has no such
    excess by the binomial's scatter, only by what is beyond it.

    With no more runs than terms of Z (n, p), with blocks, the logits are as scored, and so is what is expected.
    ``relative`` (n,) is the variance of each score over that of a typical one, beside that of its decisions where
    scores are counts of so many ``trials`` (n,). Scores without counts scatter as shares do, see `logit_variance`, or
    ``equal`` in percent.
    """
    scored = logit_scores(percent, counts=trials)
    values, expected = scored, clip_percent(percent)
    if len(percent) <= Z.shape[1]:
        return values, expected
    for _ in range(2 * _ROUNDS):
        root = 1.0 / np.sqrt(logit_variance(expected, count=trials, equal=equal) * relative)
        expected = clip_percent(logit_to_percent(Z @ np.linalg.lstsq(Z * root[:, None], values * root, rcond=None)[0]))
        binomial = 0.0 if trials is None else 1.0
        of_share = expected * (100.0 - expected) if trials is None else share_variance(expected, trials)
        each = relative if equal else relative * of_share
        beyond = max(_scatter(Z, percent, expected, each) - binomial, 0.0)
        values = scored - (_mean_logit(expected, np.sqrt(beyond * each)) - logit_scores(expected))
    return values, expected


def _scatter(Z: FloatArray, percent: FloatArray, expected: FloatArray, relative: FloatArray) -> float:
    """Variance of a typical score, percent squared: of repeated runs where there are enough, else of residuals."""
    _, group = np.unique(np.round(Z, 9), axis=0, return_inverse=True)
    group = group.reshape(-1)
    means = np.bincount(group, percent / relative) / np.bincount(group, 1.0 / relative)
    repeats = len(percent) - len(means)
    if repeats >= _LEAST_REPEATS:
        return float(np.sum(np.square(percent - means[group]) / relative) / repeats)
    return float(np.sum(np.square(percent - expected) / relative) / (len(percent) - Z.shape[1]))


def _mean_logit(percent: FloatArray, scatter: FloatArray) -> FloatArray:
    """Mean logit of scores that scatter normally about ``percent`` [%], cut at the ends as scores are."""
    nodes, shares = np.polynomial.hermite_e.hermegauss(15)
    return np.asarray(logit_scores(clip_percent(percent[:, None] + scatter[:, None] * nodes)) @ shares / shares.sum())
