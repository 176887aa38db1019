"""Which terms: averaging over hierarchical sub-models by their evidence.

A *unit* is what enters or leaves together: the linear term of a factor, all contrasts of a categorical factor, all
products of a pair of factors, a square. A model is hierarchical when each product or square comes with the first-order
units of its factors. Intercept and block columns belong to every model.

Coefficients have Zellner's g prior about zero, N(0, g sigma^2 (X'WX)^-1) with X centred on intercept and blocks, which
are flat, as is log sigma. It is invariant to units, coding and contrasts, and the evidence against the model without
units is closed form, ``(1 + g)^((m - r) / 2) / (1 + g (1 - R^2))^(m / 2)`` with m runs less the columns always present,
r the columns of the units and R^2 their share of the variation left by the former (Liang et al. 2008). Given a model
everything is Student-t, so predictions are mixtures of Student-t distributions: they carry the doubt about the terms
that an interval from one selected model leaves out.

References
----------
Liang, Paulo, Molina, Clyde, Berger (2008), Mixtures of g priors for Bayesian variable selection, JASA 103, 410-423.
Fernandez, Ley, Steel (2001), Benchmark priors for Bayesian model averaging, J. Econometrics 100, 381-427.
Madigan, York (1995), Bayesian graphical models for discrete data, Int. Stat. Rev. 63, 215-232 (MC3).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from seqrsm.arrays import BoolArray, FloatArray, IntArray
from seqrsm.fit.checks import check_runs
from seqrsm.fit.conjugate import ConjugatePosterior
from seqrsm.fit.intervals import Prediction
from seqrsm.fit.mixture import mixture_interval
from seqrsm.fit.model_space import FactorTerm, ModelSpace, Unit, hierarchical_models, search_models, units_of

_MAX_LISTED = 50_000
_KEPT_SHARE = 0.999
_MAX_KEPT = 400


@dataclass(frozen=True, slots=True)
class ModelAverage:
    """Posterior over hierarchical sub-models.

    Attributes
    ----------
    units : tuple of Unit
    inclusion : ndarray (u,)
        Posterior probability that each unit belongs to the model.
    prior_inclusion : ndarray (u,)
        The same before the data.
    models : ndarray (c, u) of bool
        The most probable models, which together hold ``_KEPT_SHARE`` of the probability (at most 400).
    probability : ndarray (c,)
        Of each, renormalised to 1.
    held : float
        Share of the probability, of all models listed or visited, that they hold.
    n_models : int
        Models listed, or visited by the search.
    exhaustive : bool
        All hierarchical models were listed; else a random search visited the probable ones.
    g : float
        Of the g prior.
    posteriors : tuple of ConjugatePosterior
        Of each model, for its columns.
    columns : tuple of ndarray
        Columns of Z in each model.
    """

    units: tuple[Unit, ...]
    inclusion: FloatArray
    prior_inclusion: FloatArray
    models: BoolArray
    probability: FloatArray
    held: float
    n_models: int
    exhaustive: bool
    g: float
    posteriors: tuple[ConjugatePosterior, ...]
    columns: tuple[IntArray, ...]

    def names(self, model: BoolArray) -> tuple[str, ...]:
        """Names of the units in a model (u,)."""
        return tuple(unit.name for unit, present in zip(self.units, model, strict=True) if present)

    @property
    def median_model(self) -> BoolArray:
        """Units with inclusion above one half, and what they need (Barbieri and Berger 2004)."""
        chosen: BoolArray = self.inclusion > 0.5
        for unit, present in zip(self.units, chosen.tolist(), strict=True):
            chosen[list(unit.parents)] |= present
        return chosen

    def coefficients(self) -> tuple[FloatArray, FloatArray]:
        """Posterior mean and standard deviation (p,) of every coefficient, 0 in the models that lack it.

        The standard deviation is nan for 2 or fewer degrees of freedom, where it does not exist.
        """
        p = 1 + max(int(columns.max()) for columns in self.columns)
        p = max(p, 1 + max((max(unit.columns) for unit in self.units), default=0))
        mean, square = np.zeros(p), np.zeros(p)
        for share, columns, post in zip(self.probability, self.columns, self.posteriors, strict=True):
            mean[columns] += share * post.mean
            square[columns] += share * (np.square(post.marginal_sd) + np.square(post.mean))
        return mean, np.sqrt(np.maximum(square - np.square(mean), 0.0))

    def predict(self, rows: FloatArray, level: float = 0.95, weight: float = 1.0, replicates: int = 1) -> Prediction:
        """Model-averaged response with credible and predictive intervals; arguments as in ``LeastSquaresFit.predict``.

        Rows (m, p) have all columns of Z, zeros for blocks meaning their mean.
        """
        rows = np.atleast_2d(np.asarray(rows, dtype=np.float64))
        centre, h = (np.empty((rows.shape[0], len(self.posteriors))) for _ in range(2))
        for i, (columns, post) in enumerate(zip(self.columns, self.posteriors, strict=True)):
            centre[:, i] = rows[:, columns] @ post.mean
            h[:, i] = post.variance_unscaled(rows[:, columns])
        s = np.array([post.scale for post in self.posteriors])
        df = np.array([post.df for post in self.posteriors])
        new = s * np.sqrt(1.0 / (replicates * weight) + h)
        mean = centre @ self.probability
        between = np.square(centre - mean[:, None])
        se = [np.sqrt((np.square(scale) + between) @ self.probability) for scale in (s * np.sqrt(h), new)]
        confidence = mixture_interval(level, self.probability, df, centre, s * np.sqrt(h))
        prediction = mixture_interval(level, self.probability, df, centre, new)
        return Prediction(mean, confidence, prediction, se[0], se[1], level, "")

    def draws(self, n: int, rng: np.random.Generator, p: int) -> tuple[FloatArray, FloatArray]:
        """Independent draws from the mixture: beta (n, p) with zeros for absent terms, and sigma (n,)."""
        beta, sigma = np.zeros((n, p)), np.empty(n)
        which = rng.choice(len(self.posteriors), size=n, p=self.probability)
        for i in np.unique(which):
            at = np.flatnonzero(which == i)
            beta[np.ix_(at, self.columns[i])], sigma[at] = self.posteriors[i].draws(at.size, rng)
        return beta, sigma


def average_models(
    Z: FloatArray,
    y: FloatArray,
    terms: Sequence[FactorTerm | str],
    *,
    weights: FloatArray | None = None,
    g: float | None = None,
    first_order: float = 0.5,
    second_order: float = 0.5,
    steps: int = 20_000,
    seed: int = 0,
) -> ModelAverage:
    """Posterior over the hierarchical sub-models of ``y = Z beta + e``.

    Parameters
    ----------
    Z, y, weights
        As in :func:`seqrsm.fit.least_squares.fit_least_squares`; more columns than runs are allowed, models with as
        many columns as runs have no evidence and are left out.
    terms : sequence (p,)
        Terms of the columns, with the names of their factors; a plain string is a block column, always present.
    g : float, optional
        Default max(n, u^2) with u the columns that may be left out: the benchmark prior of Fernandez et al.
    first_order, second_order : float
        Prior probability that a first-order unit is present, and that a second-order unit is when all it needs are.
    steps : int
        Of the random search, when there are more than 50 000 models.
    seed : int
        Of that search.

    Raises
    ------
    FitError
        Scores that cannot be used, or that do not vary.
    """
    Z, y = np.asarray(Z, dtype=np.float64), np.asarray(y, dtype=np.float64)
    w = np.ones(y.shape[0]) if weights is None else np.asarray(weights, dtype=np.float64)
    check_runs(Z, y, w, len(terms))
    units = units_of(terms)
    if not units:
        raise ValueError("no term can be left out")
    space = ModelSpace(Z, y, w, terms, units, g, (first_order, second_order))
    listed = hierarchical_models(units, _MAX_LISTED)
    if listed is not None:
        models, score = listed, space.log_posterior(listed)
        prior = np.exp(space.log_prior(listed))
    else:
        models, score = search_models(space, units, steps, np.random.default_rng(seed))
        prior = np.zeros(0)
    usable = np.isfinite(score)
    models, score = models[usable], score[usable]
    probability = np.exp(score - np.max(score))
    probability /= np.sum(probability)
    order = np.argsort(-probability, kind="stable")
    kept = order[: min(int(np.searchsorted(np.cumsum(probability[order]), _KEPT_SHARE)) + 1, _MAX_KEPT)]
    share = probability[kept]
    fits = [space.fit(models[i]) for i in kept]
    return ModelAverage(
        units,
        probability @ models,
        prior @ listed if listed is not None else space.prior_inclusion(),
        models[kept],
        share / np.sum(share),
        float(np.sum(share)),
        len(models),
        listed is not None,
        space.g,
        tuple(post for post, _ in fits),
        tuple(columns for _, columns in fits),
    )
