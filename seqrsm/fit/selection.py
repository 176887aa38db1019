"""Which terms: the probability of each over hierarchical sub-models, by their evidence.

A *unit* is what enters or leaves together: the linear term of a factor, all contrasts of a categorical factor, all
products of a pair of factors, a square. A model is hierarchical when each product or square comes with the first-order
units of its factors. Intercept and block columns belong to every model.

A unit is present with probability one half, one of second order when all that it needs are. Coefficients have Zellner's
g prior about zero, N(0, g sigma^2 (X'WX)^-1) with X centred on intercept and blocks, which are flat, as is log sigma.
It is invariant to units, coding and contrasts, and the evidence against the model without units is closed form,
``(1 + g)^((m - r) / 2) / (1 + g (1 - R^2))^(m / 2)`` with m runs less the columns always present,
r the columns of the units and R^2 their share of the variation left by the former (Liang et al. 2008).

References
----------
Liang, Paulo, Molina, Clyde, Berger (2008), Mixtures of g priors for Bayesian variable selection, JASA 103, 410-423.
Fernandez, Ley, Steel (2001), Benchmark priors for Bayesian model averaging, J. Econometrics 100, 381-427.
Madigan, York (1995), Bayesian graphical models for discrete data, Int. Stat. Rev. 63, 215-232 (MC3).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from seqrsm.arrays import BoolArray, FloatArray
from seqrsm.design.quadratic import Term
from seqrsm.errors import FitError, Problem
from seqrsm.fit.intervals import sequential_ss
from seqrsm.fit.linear_system import check_runs

_CHUNK = 2048
_SECOND_ORDER = ("interaction", "square")
_RIDGE = 1e-13  # keeps the factorisation of a singular model going; such models are then refused
_ALIASED = 1e-10  # share of a column's length that the others leave: below, the model is singular


@dataclass(frozen=True, slots=True)
class Unit:
    """Columns that enter together, and the units (by position) that they need."""

    name: str
    columns: tuple[int, ...]
    parents: tuple[int, ...]


def units_of(terms: Sequence[Term | str]) -> tuple[Unit, ...]:
    """Group the columns into units; a plain string is a block column and belongs to none."""
    groups: dict[tuple[bool, bool, tuple[str, ...]], list[int]] = {}
    names: dict[tuple[bool, bool, tuple[str, ...]], str] = {}
    for i, term in enumerate(terms):
        if not isinstance(term, str) and term.kind != "intercept":
            key = (term.kind in _SECOND_ORDER, term.kind == "square", tuple(sorted(term.factors)))
            groups.setdefault(key, []).append(i)
            names.setdefault(key, ":".join(term.factors) + ("^2" if key[1] else ""))
    place = {key[2][0]: position for position, key in enumerate(groups) if not key[0]}
    units = []
    for key, columns in groups.items():
        second, _, factors = key
        parents = tuple(place[f] for f in factors if f in place) if second else ()
        units.append(Unit(names[key], tuple(columns), parents))
    return tuple(units)


class ModelSpace:
    """Evidence and prior of models given as rows of booleans over the units."""

    def __init__(
        self,
        Z: FloatArray,
        y: FloatArray,
        w: FloatArray,
        terms: Sequence[Term | str],
        units: tuple[Unit, ...],
    ) -> None:
        self.units = units
        self._Z, self._y, self._w = Z, y, w
        free = [i for unit in units for i in unit.columns]
        self.always = np.array([i for i in range(len(terms)) if i not in set(free)], dtype=np.int64)
        self._unit = np.array([u for u, unit in enumerate(units) for _ in unit.columns])
        self._free = np.array(free, dtype=np.int64)
        root = np.sqrt(w)
        base = Z[:, self.always] * root[:, None]
        Q = np.linalg.qr(base)[0] if self.always.size else np.zeros((len(y), 0))
        X, t = Z[:, self._free] * root[:, None], y * root
        for _ in range(2):
            X, t = X - Q @ (Q.T @ X), t - Q @ (Q.T @ t)
        self.m = len(y) - sum(df for df, _ in sequential_ss([base], t))
        total = float(t @ t)
        if self.m < 2:
            what = f"{len(y)} runs are too few to select terms besides the mean and the blocks"
            raise FitError(Problem(what, 'Add runs, or set [model] terms = "full".'))
        if total <= (1e-14 * float(np.linalg.norm(y * root))) ** 2:
            raise FitError(Problem("the scores do not vary, so no term can be selected", "Add runs."))
        length = np.linalg.norm(X, axis=0)
        self._X = X / np.where(length > 0.0, length, 1.0)
        self._gram, self._cross = self._X.T @ self._X, self._X.T @ t / np.sqrt(total)
        self.g = float(max(len(y), self._free.size**2))  # the benchmark prior of Fernandez et al.

    def log_posterior(self, models: BoolArray) -> FloatArray:
        """Log evidence plus log prior (c,), up to one constant; -inf for models that the runs cannot carry."""
        found = [self._log_evidence(models[i : i + _CHUNK]) for i in range(0, len(models), _CHUNK)]
        return np.concatenate(found) + self.log_prior(models)

    def _log_evidence(self, models: BoolArray) -> FloatArray:
        inside = models[:, self._unit]
        size = np.count_nonzero(inside, axis=1)
        both = inside[:, :, None] & inside[:, None, :]
        gram: FloatArray = np.where(both, self._gram, 0.0)
        diagonal = np.arange(gram.shape[1])
        gram[:, diagonal, diagonal] += np.where(inside, _RIDGE, 1.0)
        cross = np.where(inside, self._cross, 0.0)
        L = np.linalg.cholesky(gram)
        ok = (np.min(np.square(L[:, diagonal, diagonal]), axis=1) > _ALIASED) & (size < self.m)
        projected = np.linalg.solve(L, cross[:, :, None])[:, :, 0]
        r2 = np.clip(np.sum(np.square(projected), axis=1), 0.0, 1.0)
        log_bf = 0.5 * (self.m - size) * np.log1p(self.g) - 0.5 * self.m * np.log1p(self.g * (1.0 - r2))
        return np.where(ok, log_bf, -np.inf)

    def log_prior(self, models: BoolArray) -> FloatArray:
        """Log prior probability (c,) of hierarchical models."""
        value = np.zeros(len(models))
        for unit in self.units:
            value += np.where(np.all(models[:, list(unit.parents)], axis=1), np.log(0.5), 0.0)
        return value

    def prior_inclusion(self) -> FloatArray:
        """Prior probability (u,) that each unit is present."""
        return np.array([0.5 ** (1 + len(unit.parents)) for unit in self.units])


def hierarchical_models(units: tuple[Unit, ...], limit: int) -> BoolArray | None:
    """All hierarchical models (c, u), or None when there are more than ``limit``."""
    first = [u for u, unit in enumerate(units) if not unit.parents]
    second = [u for u, unit in enumerate(units) if unit.parents]
    count, rows = 0, []
    for chosen in _subsets(first):
        present = set(chosen)
        allowed = [u for u in second if present.issuperset(units[u].parents)]
        count += 2 ** len(allowed)
        if count > limit:
            return None
        block = np.zeros((2 ** len(allowed), len(units)), dtype=np.bool_)
        block[:, chosen] = True
        codes = np.arange(2 ** len(allowed))
        for bit, u in enumerate(allowed):
            block[:, u] = (codes >> bit) & 1
        rows.append(block)
    return np.vstack(rows)


def _subsets(items: list[int]) -> Iterator[list[int]]:
    # The largest set has most models: beginning with it a space that is too large is noticed at once.
    for code in range(2 ** len(items) - 1, -1, -1):
        yield [item for bit, item in enumerate(items) if code >> bit & 1]


def search_models(
    space: ModelSpace, units: tuple[Unit, ...], steps: int, rng: np.random.Generator
) -> tuple[BoolArray, FloatArray]:
    """Distinct models met by Metropolis walks that add or drop one unit (MC3), and their log posterior."""
    children: list[list[int]] = [[] for _ in units]
    for u, unit in enumerate(units):
        for parent in unit.parents:
            children[parent].append(u)
    seen: dict[bytes, float] = {}

    def score(model: BoolArray) -> float:
        key = model.tobytes()
        if key not in seen:
            seen[key] = float(space.log_posterior(model[None, :])[0])
        return seen[key]

    def moves(model: BoolArray) -> list[int]:
        return [
            u
            for u, unit in enumerate(units)
            if (not model[u] and all(model[v] for v in unit.parents))
            or (model[u] and not any(model[v] for v in children[u]))
        ]

    starts = [np.zeros(len(units), dtype=np.bool_), np.array([not unit.parents for unit in units])]
    for model in starts:
        here, open_moves = score(model), moves(model)
        for _ in range(steps // len(starts)):
            new = model.copy()
            u = open_moves[int(rng.integers(len(open_moves)))]
            new[u] = not new[u]
            there, new_moves = score(new), moves(new)
            ratio = there - here + np.log(len(open_moves) / len(new_moves))
            if np.log(rng.random()) < ratio or not np.isfinite(here):
                model, here, open_moves = new, there, new_moves
    models = np.array([np.frombuffer(key, dtype=np.bool_) for key in seen])
    return models, np.array(list(seen.values()))


_MAX_LISTED = 50_000
_STEPS = 20_000
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
    n_models : int
        Models listed, or visited by the search.
    exhaustive : bool
        All hierarchical models were listed; else a random search visited the probable ones.
    """

    units: tuple[Unit, ...]
    inclusion: FloatArray
    prior_inclusion: FloatArray
    models: BoolArray
    probability: FloatArray
    n_models: int
    exhaustive: bool

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


def average_models(
    Z: FloatArray,
    y: FloatArray,
    terms: Sequence[Term | str],
    *,
    weights: FloatArray | None = None,
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
    seed : int
        Of the random search, when there are more than 50 000 models.

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
        raise ValueError("no term can be dropped")
    space = ModelSpace(Z, y, w, terms, units)
    listed = hierarchical_models(units, _MAX_LISTED)
    if listed is not None:
        models, score = listed, space.log_posterior(listed)
        prior = np.exp(space.log_prior(listed))
    else:
        models, score = search_models(space, units, _STEPS, np.random.default_rng(seed))
        prior = np.zeros(0)
    usable = np.isfinite(score)
    models, score = models[usable], score[usable]
    probability = np.exp(score - np.max(score))
    probability /= np.sum(probability)
    order = np.argsort(-probability, kind="stable")
    kept = order[: min(int(np.searchsorted(np.cumsum(probability[order]), _KEPT_SHARE)) + 1, _MAX_KEPT)]
    share = probability[kept]
    return ModelAverage(
        units,
        probability @ models,
        prior @ listed if listed is not None else space.prior_inclusion(),
        models[kept],
        share / np.sum(share),
        len(models),
        listed is not None,
    )
