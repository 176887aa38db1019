"""Prior knowledge in natural terms, made into a conjugate prior.

Three kinds of statement: the range of the utility ('between 60 and 95'), where the optimum of a factor is expected
('near 5 GHz'), and how well a run repeats: what a person or a catalogue can say without knowing of coefficients.

The range spreads over the coefficients so that the mean response at a random setting of the region lies in it with the
stated probability. An optimum near x* is a statement on the slope there, ``df/dx_j (x*) = 0 +- |curvature| * doubt``,
which is linear in the coefficients and enters as one more row of the prior, beside a curvature of the right sign.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.special import ndtri

from seqrsm.arrays import FloatArray
from seqrsm.design.evaluate import region_moments
from seqrsm.design.factors import CategoricalFactor
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.fit.conjugate import NormalInverseGamma
from seqrsm.fit.optimum import Goal, sign_of

_SHARE_CURVATURE = 1.0  # fall from the optimum over half a factor's range, in standard deviations of the utility


def elicited_prior(
    model: QuadraticModel,
    region: Region,
    utility: tuple[float, float],
    *,
    probability: float,
    repeat_sd: float,
    repeat_runs: float,
    optimum: Mapping[str, tuple[float, float]],
    goal: Goal,
) -> NormalInverseGamma:
    """Conjugate prior of the model's coefficients that says what the statements say.

    The ``utility`` at a setting taken at random lies between low < high with ``probability`` in [0.5, 1). Runs repeated
    at one setting scatter by ``repeat_sd``, said with the weight of ``repeat_runs`` observations, both > 0.
    ``optimum``: by numeric factor where its best value is expected, natural units, and the standard deviation of that
    as a share of half the factor's (coded) range, > 0; the ``goal`` gives the curvature's sign. With sigma at its prior
    guess the statements hold as made; through sigma's own doubt the tails are heavier.
    """
    low, high = utility
    spread = 0.5 * (high - low) / float(ndtri(0.5 + 0.5 * probability))
    order_two = model.order == 2
    curvature = -sign_of(goal) * _SHARE_CURVATURE * spread
    mean, precision = np.zeros(model.p), np.zeros((model.p, model.p))
    place = {name: i for i, name in enumerate(model.term_names)}
    mean[0] = 0.5 * (low + high)
    for name, (value, doubt) in optimum.items() if order_two else ():
        factor = model.factors[region.names.index(name)]
        assert not isinstance(factor, CategoricalFactor)
        at = float(factor.code(value))
        linear, square = place.get(name), place.get(f"{name}^2")
        if linear is None or square is None:
            continue
        # c (x - x*)^2 about its own mean over the region, c x^2 - 2 c x* x
        mean[square] = curvature
        mean[linear] = -2.0 * curvature * at
        mean[0] -= curvature / 3.0
        row = np.zeros(model.p)
        row[linear], row[square] = 1.0, 2.0 * at
        precision += np.outer(row, row) / (2.0 * curvature * doubt) ** 2
    precision += _spread_precision(model, region, mean, spread, precision)
    a0 = 0.5 * repeat_runs
    return NormalInverseGamma(mean, precision * repeat_sd**2, a0, a0 * repeat_sd**2)


def _spread_precision(
    model: QuadraticModel, region: Region, mean: FloatArray, spread: float, known: FloatArray
) -> FloatArray:
    """Diagonal precision that gives the response at a random setting the standard deviation ``spread``.

    Half the variance is the intercept's; the other terms share the rest in inverse proportion to their mean squares
    over the region. One factor scales them all so that the prior mean's own variation and what ``known`` has taken
    away are allowed for.
    """
    W = region_moments(model, region)
    size = np.diagonal(W)
    share = np.full(model.p, 0.5 / max(model.p - 1, 1))
    share[0] = 0.5
    if model.p == 1:
        share[0] = 1.0
    centred = W - np.outer(W[0], W[0])
    explained = min(float(mean @ centred @ mean), 0.75 * spread**2)
    wanted = spread**2 - explained
    low, high = -20.0, 20.0
    variance = share / size
    for _ in range(80):
        middle = 0.5 * (low + high)
        diagonal = np.diag(1.0 / (variance * wanted * np.exp(middle)))
        reached = float(np.sum(W * np.linalg.inv(diagonal + known)))
        low, high = (middle, high) if reached < wanted else (low, middle)
    return np.diag(1.0 / (variance * wanted * np.exp(low)))
