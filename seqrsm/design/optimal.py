"""Optimal designs by exchange, with fixed runs, prior information, factors of any kind, and constraints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.design.evaluate import (
    inestimable_terms,
    largest_variance,
    nearly_inestimable_terms,
)
from seqrsm.design.exchange import Task, search_box, search_candidates, search_constrained
from seqrsm.design.minimax import search_minimax
from seqrsm.design.moments import region_moments
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.errors import DesignError, Problem

Criterion: TypeAlias = Literal["D", "I", "A", "G"]

_START_SEARCHES, _START_CANDIDATES = 8, 3**8
_MINIMAX_STARTS, _MINIMAX_STARTS_CONSTRAINED = 60, 24
_MINIMAX_D_STARTS_CONSTRAINED = 4  # of the D-optimal design among them, which is dear where constraints cut the box


@dataclass(frozen=True, slots=True)
class Design:
    """Runs of an optimal design; how good they are else, `evaluate_design` tells.

    Attributes
    ----------
    points : ndarray (n, k)
        The runs chosen, coded.
    value : float
        Value of the criterion: D |M|^(1/p) / N, to be large; I and A tr(W M^-1), G the largest z'M^-1 z over the
        region, to be small. M = Z'Z + prior precision over all N runs, the fixed ones too.
    hits, starts : int
        How many of the local searches ended at this value: one or two of hundreds mean that a longer search may find
        a better design.
    seed : int
        Seed that gives this design again.
    """

    points: FloatArray
    value: float
    hits: int
    starts: int
    seed: int


def optimal_design(
    model: QuadraticModel,
    region: Region,
    n_runs: int,
    criterion: Criterion = "D",
    *,
    seed: int = 0,
    starts: int | None = None,
    fixed: FloatArray | None = None,
    prior_precision: FloatArray | None = None,
) -> Design:
    """Choose the runs that estimate the model best.

    Parameters
    ----------
    model, region : QuadraticModel, Region
        Over the same factors.
    n_runs : int
        Runs to choose, beside the fixed ones; a run may be repeated.
    criterion : {"D", "I", "A", "G"}
        ``"D"``: smallest confidence region of the coefficients; ``"I"``: smallest mean prediction variance over the
        region; ``"A"``: smallest mean variance of the coefficients; ``"G"``: smallest largest prediction variance.
    seed : int
        The same seed gives the same design on any machine with IEEE arithmetic.
    starts : int, optional
        Local searches; by default enough to reach the best designs known up to six factors.
    fixed : ndarray (m, k), optional
        Runs already made or decided: counted, never moved.
    prior_precision : ndarray (p, p), optional
        Precision of the coefficients before the runs, over the noise variance (R = sigma^2 Sigma^-1): Bayesian
        designs (DuMouchel & Jones 1994, Technometrics 36, 37-47), and fewer runs than terms.

    Raises
    ------
    DesignError
        Fewer runs than terms without a prior that carries the rest, terms that no runs in the region can tell apart,
        or arguments that do not fit.
    """
    prior = _checked_prior(model, region, prior_precision)
    kept = _checked_fixed(model, fixed)
    _check_counts(model, n_runs, criterion, kept, prior)
    Z_fixed = model.matrix(kept)
    precision = prior + Z_fixed.T @ Z_fixed
    if not region.is_box and not np.any(precision):
        # A region may be so thin that terms coincide on it: told at once, before any search.
        lost = inestimable_terms(model, region.candidates(limit=2000))
        if lost:
            raise _coinciding(lost)
    moments = region_moments(model, region)
    if criterion == "G":
        return _minimax(model, region, n_runs, kept, prior, moments, seed, starts)
    weights = {"D": None, "I": moments, "A": np.eye(model.p)}[criterion]
    task = Task(n_runs, np.ascontiguousarray(precision), None if weights is None else np.ascontiguousarray(weights))
    if region.is_box:
        chains, random_starts, moves = _effort(model, starts, task.weight is not None, n_runs)
        total = chains * (random_starts + moves)
        points, hits = search_box(model, region, task, chains, random_starts, moves, seed % 2**63)
    else:
        total = 12 if starts is None else max(starts, 1)
        points, hits = search_constrained(model, region, task, total, seed % 2**63)
    if hits == 0:
        raise _singular(model, region)
    value = _value(model, region, np.vstack([kept, points]), criterion, moments, prior)
    return Design(points, value, hits, total, seed)


def _minimax(
    model: QuadraticModel,
    region: Region,
    n_runs: int,
    fixed: FloatArray,
    prior: FloatArray,
    moments: FloatArray,
    seed: int,
    starts: int | None,
) -> Design:
    """G-optimal design, from random designs and a D-optimal one, which sometimes is G-optimal, too."""
    given = prior if np.any(prior) else None
    quick = _MINIMAX_STARTS if region.is_box else _MINIMAX_D_STARTS_CONSTRAINED
    start = optimal_design(model, region, n_runs, seed=seed, starts=quick, fixed=fixed, prior_precision=given)
    rng = np.random.default_rng([seed % 2**63, 2])
    total = (_MINIMAX_STARTS if region.is_box else _MINIMAX_STARTS_CONSTRAINED) if starts is None else max(starts, 1)
    first = [start.points] + [region.sample(n_runs, rng) for _ in range(total - 1)]
    Z_fixed = model.matrix(fixed)
    points, hits = search_minimax(model, region, prior + Z_fixed.T @ Z_fixed, first)
    value = _value(model, region, np.vstack([fixed, points]), "G", moments, prior)
    return Design(points, value, hits, total, seed)


def start_design(
    model: QuadraticModel,
    region: Region,
    n_runs: int,
    centre_repeats: int = 3,
    seed: int = 0,
    fixed: FloatArray | None = None,
) -> FloatArray:
    """First runs of a campaign: repeats of the central point and runs around them that tell the terms apart.

    The runs are D-optimal among three levels of each continuous factor, all levels of others and points on the
    constraints: 0.97 to 1 of the D-efficiency of `optimal_design`, found without compiling anything.

    Parameters
    ----------
    model, region : QuadraticModel, Region
        Over the same factors.
    n_runs : int
        Runs in all, at least p + ``centre_repeats`` - 1.
    centre_repeats : int
        Repeats of :meth:`Region.centre` (coded 0; the discrete level nearest to it; the first level of each categorical
        factor; a feasible point next to it where constraints cut it off). All at one setting, so that they give
        ``centre_repeats - 1`` degrees of freedom of pure error.
    seed : int
        As in :func:`optimal_design`.
    fixed : ndarray (m, k), optional
        Runs already made, in place of the repeats at the centre: counted in ``n_runs``, and not given back.

    Returns
    -------
    ndarray (n_runs, k) or (n_runs - m, k)
        Coded points, the repeats first; the order is no run order.

    Raises
    ------
    DesignError
        As `optimal_design`; more repeats than runs.
    """
    if not 0 <= centre_repeats <= n_runs:
        raise DesignError(Problem("the repeats at the centre are not between 0 and the runs", value=centre_repeats))
    kept = np.tile(region.centre(), (centre_repeats, 1)) if fixed is None else np.asarray(fixed, dtype=np.float64)
    n = n_runs - len(kept)
    _check_counts(model, n, "D", kept, np.zeros((model.p, model.p)))
    candidates = region.candidates(3, limit=_START_CANDIDATES)
    Z = model.matrix(kept)
    task, rng = Task(n, np.ascontiguousarray(Z.T @ Z), None), np.random.default_rng([seed % 2**63, 3])
    value, points = search_candidates(model, candidates, task, _START_SEARCHES, rng)[0]
    if not np.isfinite(value):
        raise _singular(model, region)
    return np.vstack([kept, points]) if fixed is None else points


def _effort(model: QuadraticModel, starts: int | None, linear: bool, n_runs: int) -> tuple[int, int, int]:
    """Chains, random starts and perturbations in each, chosen so that the best designs known are reached."""
    if starts is not None:
        chains = max(starts // 320, 1)
        each = max(starts // chains, 1)
        return chains, max(each // 5, 1), each - max(each // 5, 1)
    p = model.p
    if p <= 10:
        return 1, 100, 100
    spare = max(n_runs - p, 0)
    # A local search of a linear criterion takes several times longer; with few runs beyond p its optima are few.
    if p <= 15:
        return (2 if linear and spare <= 5 else 4), 30, 160
    if p <= 21:
        return (min(2 + spare // 4, 5) if linear else 6), 20, 250
    # The landscape of six factors has deep, narrow optima: many short chains find what few long ones miss. Runs as many
    # as terms make each search slower and the optima fewer.
    if linear:
        return max(int(min(16 + spare, 32) * min(1.0, (28.0 / p) ** 3)), 1), 10, 50
    return max(int(min(40 + 4 * spare, 60) * min(1.0, (28.0 / p) ** 3)), 1), 20, 100


def _checked_prior(model: QuadraticModel, region: Region, prior: FloatArray | None) -> FloatArray:
    if model.factors != region.factors:
        raise DesignError(Problem("model and region have different factors", "Build both from the same tuple."))
    if prior is None:
        return np.zeros((model.p, model.p))
    R = np.asarray(prior, dtype=np.float64)
    if R.shape != (model.p, model.p) or not np.all(np.isfinite(R)):
        raise DesignError(Problem(f"the prior precision is no finite {model.p} x {model.p} matrix", value=R.shape))
    if np.max(np.abs(R - R.T)) > 1e-9 * np.max(np.abs(R), initial=1e-300):
        raise DesignError(Problem("the prior precision is not symmetric"))
    if np.min(np.linalg.eigvalsh(R)) < -1e-9 * np.max(np.abs(R), initial=1e-300):
        raise DesignError(Problem("the prior precision has a negative eigenvalue", "Give a covariance's inverse."))
    return 0.5 * (R + R.T)


def _checked_fixed(model: QuadraticModel, fixed: FloatArray | None) -> FloatArray:
    if fixed is None:
        return np.empty((0, model.k))
    points = np.asarray(fixed, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != model.k or not np.all(np.isfinite(points)):
        raise DesignError(Problem(f"fixed runs must be finite rows of {model.k} coded values", value=points.shape))
    return points


def _check_counts(model: QuadraticModel, n_runs: int, criterion: str, fixed: FloatArray, prior: FloatArray) -> None:
    if criterion not in get_args(Criterion):
        names = ", ".join(get_args(Criterion))
        raise DesignError(Problem("unknown criterion", f"Use {names}.", field="criterion", value=criterion))
    if n_runs < 1:
        raise DesignError(Problem("a design needs at least one run", "Ask for more.", field="n_runs", value=n_runs))
    known = model.matrix(fixed)
    carried = int(np.linalg.matrix_rank(prior + known.T @ known, hermitian=True))
    if carried + n_runs < model.p:
        raise DesignError(
            Problem(
                f"{n_runs} runs cannot estimate {model.p} terms ({carried} are carried by fixed runs or a prior)",
                f"Ask for at least {model.p - carried} runs, use order = 1, fewer factors or levels, or give a prior.",
                field="n_runs",
                value=n_runs,
            )
        )


def _singular(model: QuadraticModel, region: Region) -> DesignError:
    lost = inestimable_terms(model, region.candidates(limit=5000))
    if lost:
        return _coinciding(lost)
    near = nearly_inestimable_terms(model, region.candidates(limit=5000))
    if near:
        message = f"the region is so thin that these terms can hardly be told from the others: {', '.join(near)}"
        return DesignError(Problem(message, "Loosen the constraints, or replace the factors that go together by one."))
    return DesignError(Problem("every design tried was singular", "Ask for more runs or more starts."))


def _coinciding(terms: tuple[str, ...]) -> DesignError:
    return DesignError(
        Problem(
            f"no runs in the region can tell these terms apart from the others: {', '.join(terms)}",
            "Loosen the constraints or the levels, or leave the terms out.",
        )
    )


def _value(
    model: QuadraticModel,
    region: Region,
    runs: FloatArray,
    criterion: Criterion,
    moments: FloatArray,
    prior: FloatArray,
) -> float:
    """Value of the criterion, from all runs (N, k) alone: nothing of the search's running values is trusted."""
    Z = model.matrix(runs)
    M = prior + Z.T @ Z
    if criterion == "D":
        return float(np.exp(np.linalg.slogdet(M)[1] / model.p)) / len(Z)
    inverse = np.asarray(np.linalg.inv(M), dtype=np.float64)
    if criterion == "G":
        return largest_variance(model, region, inverse)[0]
    return float(np.sum(moments * inverse) if criterion == "I" else np.trace(inverse))
