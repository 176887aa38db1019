"""Prior knowledge in natural terms, made into a conjugate prior.

Three kinds of statement: the range of the utility ('between 60 and 95'), where the optimum of a factor is expected
('near 5 GHz'), and how well a run repeats: what a person or a catalogue can say without knowing of coefficients.

The range spreads over the coefficients so that the mean response at a random setting of the region lies in it with the
stated probability. An optimum near x* is a statement on the slope there, ``df/dx_j (x*) = 0 +- |curvature| * doubt``,
which is linear in the coefficients and enters as one more row of the prior, beside a curvature of the right sign.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from seqrsm.arrays import FloatArray
from seqrsm.design.factors import CategoricalFactor, span
from seqrsm.design.moments import region_moments
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.errors import FitError, Problem
from seqrsm.fit.conjugate import NormalInverseGamma
from seqrsm.fit.optimum import Goal, sign_of

_DEFAULT_NOISE = 0.1  # of the range of the utility, when nothing is said of repeats
_SHARE_CURVATURE = 1.0  # fall from the optimum over half a factor's range, in standard deviations of the utility


@dataclass(frozen=True, slots=True)
class UtilityRange:
    """'The utility lies between ``low`` and ``high``', at a setting taken at random, with ``probability``."""

    low: float
    high: float
    probability: float = 0.95


@dataclass(frozen=True, slots=True)
class OptimumNear:
    """'The best value of ``factor`` is near ``value``'.

    Attributes
    ----------
    factor : str
        A numeric factor.
    value : float
        Natural units.
    doubt : float, optional
        Standard deviation of that, as a share of half the factor's (coded) range; default 0.5.
    """

    factor: str
    value: float
    doubt: float = 0.5


@dataclass(frozen=True, slots=True)
class RepeatScatter:
    """'Runs repeated at one setting scatter by ``sd``', said with the weight of ``runs`` observations."""

    sd: float
    runs: float = 3.0


def elicited_prior(
    model: QuadraticModel,
    region: Region,
    utility: UtilityRange,
    *,
    optima: Sequence[OptimumNear] = (),
    scatter: RepeatScatter | None = None,
    goal: Goal = "maximize",
) -> NormalInverseGamma:
    """Conjugate prior of the model's coefficients that says what the statements say.

    Parameters
    ----------
    model, region : QuadraticModel, Region
    utility : UtilityRange
    optima : sequence of OptimumNear
        At most one for each factor.
    scatter : RepeatScatter, optional
        Default: a tenth of the range of the utility, worth three runs.
    goal : "maximize" or "minimize"
        Sign of the curvature that an optimum implies.

    Returns
    -------
    NormalInverseGamma
        With sigma at its prior guess the statements hold as made; through sigma's own doubt the tails are heavier.

    Raises
    ------
    FitError
        Every statement that is empty, contradictory, or about no numeric factor of the model.
    """
    scatter = RepeatScatter(_DEFAULT_NOISE * (utility.high - utility.low)) if scatter is None else scatter
    _check(model, utility, optima, scatter)
    centre = 0.5 * (utility.low + utility.high)
    spread = 0.5 * (utility.high - utility.low) / float(ndtri(0.5 + 0.5 * utility.probability))
    order_two = model.order == 2
    curvature = -sign_of(goal) * _SHARE_CURVATURE * spread
    mean, precision = np.zeros(model.p), np.zeros((model.p, model.p))
    place = {name: i for i, name in enumerate(model.term_names)}
    mean[0] = centre
    for statement in optima if order_two else ():
        j = region.names.index(statement.factor)
        factor = model.factors[j]
        assert not isinstance(factor, CategoricalFactor)
        at = float(factor.code(statement.value))
        linear, square = place.get(statement.factor), place.get(f"{statement.factor}^2")
        if linear is None or square is None:
            continue
        # c (x - x*)^2 about its own mean over the region, c x^2 - 2 c x* x
        mean[square] = curvature
        mean[linear] = -2.0 * curvature * at
        mean[0] -= curvature / 3.0
        row = np.zeros(model.p)
        row[linear], row[square] = 1.0, 2.0 * at
        precision += np.outer(row, row) / (2.0 * curvature * statement.doubt) ** 2
    precision += _spread_precision(model, region, mean, spread, precision)
    a0 = 0.5 * scatter.runs
    return NormalInverseGamma(mean, precision * scatter.sd**2, a0, a0 * scatter.sd**2)


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


def _check(model: QuadraticModel, utility: UtilityRange, optima: Sequence[OptimumNear], scatter: RepeatScatter) -> None:
    problems = []
    if not (np.isfinite(utility.low) and np.isfinite(utility.high) and utility.low < utility.high):
        value = (utility.low, utility.high)
        problems.append(Problem("the utility's range is empty", "Give low < high.", field="utility", value=value))
    if not 0.5 <= utility.probability < 1.0:
        remedy = "Give a value from 0.5 to below 1."
        problems.append(Problem("not a usable probability", remedy, field="utility", value=utility.probability))
    if not (scatter.sd > 0.0 and scatter.runs > 0.0):
        problems.append(Problem("the scatter of repeats must be positive", field="scatter", value=scatter.sd))
    numeric = {model.factors[j].name: model.factors[j] for j in model.numeric}
    seen: set[str] = set()
    for statement in optima:
        factor = numeric.get(statement.factor)
        if factor is None:
            remedy = f"Numeric factors are {', '.join(numeric)}."
            problems.append(Problem("no numeric factor of this name", remedy, field="optimum", value=statement.factor))
            continue
        assert not isinstance(factor, CategoricalFactor)
        low, high = span(factor)
        if not low <= statement.value <= high:
            what, remedy = "an optimum is expected outside the factor's range", f"Give {low:g} to {high:g}."
            problems.append(Problem(what, remedy, field=statement.factor, value=statement.value))
        if statement.factor in seen or not statement.doubt > 0.0:
            what = "each factor takes one statement, with a positive doubt"
            problems.append(Problem(what, field=statement.factor, value=statement.doubt))
        seen.add(statement.factor)
    if problems:
        raise FitError(*problems)
