"""Optimal designs by exchange and descent, with fixed runs, factors of any kind, and constraints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from seqrsm.arrays import FloatArray, first_of_largest
from seqrsm.design.evaluate import inestimable_terms, region_moments
from seqrsm.design.exchange import Task, search_candidates, search_region
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.errors import DesignError

Criterion: TypeAlias = Literal["D", "I", "A"]

SEARCHES, MANY_SEARCHES, _FEW_TERMS = 300, 400, 10
"""Local searches at most: they come within 0.5 % of the best designs known up to five factors, within 2 % with six."""
_START_SEARCHES, _START_CANDIDATES = 8, 3**8
_INNER, _INSIDE = 0.25, 0.5
"""Share of the first runs that are drawn in, and how much of their distance from the centre they keep."""
_LEAST_RATIO = 0.01  # of the determinant, after a run is drawn in to before


@dataclass(frozen=True, slots=True)
class Design:
    """Runs of an optimal design; how good they are else, `evaluate_design` tells."""

    points: FloatArray
    """(n, k): the runs chosen, coded."""
    hits: int
    starts: int
    """How many of the local searches ended at its value: one or two of hundreds mean that a longer search may find a
    better design."""


def optimal_design(
    model: QuadraticModel,
    region: Region,
    n_runs: int,
    criterion: Criterion = "D",
    *,
    seed: int = 0,
    fixed: FloatArray | None = None,
) -> Design:
    """Choose ``n_runs`` runs, beside the ``fixed`` ones (m, k), that estimate the model best; a run may be repeated.

    The criterion is "D": smallest confidence region of the coefficients; "I": smallest mean prediction variance over
    the region; or "A": smallest mean variance of the coefficients. Fixed runs are counted, never moved. The same seed
    gives the same design; where matrices are rounded otherwise, now and then another one as good. DesignError of fewer
    runs than terms that fixed runs do not carry, or of terms that no runs in the region can tell apart.
    """
    kept = np.empty((0, model.k)) if fixed is None else np.asarray(fixed, dtype=np.float64)
    _check_count(model, n_runs, kept)
    Z_fixed = model.matrix(kept)
    precision = Z_fixed.T @ Z_fixed
    see_separable(model, region, kept)
    weights = None if criterion == "D" else region_moments(model, region) if criterion == "I" else np.eye(model.p)
    searches = SEARCHES if model.p <= _FEW_TERMS else MANY_SEARCHES
    task = Task(n_runs, precision, weights)
    points, hits, made = search_region(model, region, task, searches, seed % 2**63)
    if hits == 0:
        raise _singular(model, region)
    return Design(points, hits, made)


def start_design(
    model: QuadraticModel,
    region: Region,
    n_runs: int,
    centre_repeats: int = 3,
    seed: int = 0,
    fixed: FloatArray | None = None,
) -> FloatArray:
    """First runs of a campaign (n_runs, k), coded: repeats of the central point, then runs that tell the terms apart.

    The runs are D-optimal among three levels of each continuous factor, all levels of others and points on the
    constraints. One in four is then drawn in half-way to the centre, those that cost the determinant least: runs at the
    edges alone cannot tell a gain that levels off from a slope, and see no hump between them (Box & Draper 1959, J. Am.
    Stat. Assoc. 54, 622-654: against bias, designs are drawn in). Their order is no run order.

    There are p + ``centre_repeats`` - 1 at least. Repeats are all at :meth:`Region.centre`, so that they give
    ``centre_repeats - 1`` degrees of freedom of pure error. Runs already made, ``fixed`` (m, k), take their place: they
    are counted in ``n_runs``, and not given back. Seed and errors are those of `optimal_design`.
    """
    kept = np.tile(region.centre(), (centre_repeats, 1)) if fixed is None else np.asarray(fixed, dtype=np.float64)
    n = n_runs - len(kept)
    _check_count(model, n, kept)
    candidates = region.candidates(3, limit=_START_CANDIDATES)
    Z = model.matrix(kept)
    task, rng = Task(n, Z.T @ Z, None), np.random.default_rng([seed % 2**63, 3])
    value, points = search_candidates(model, candidates, task, _START_SEARCHES, rng)
    if not np.isfinite(value):
        raise _singular(model, region)
    points = _drawn_in(model, region, task.precision, points)
    return np.vstack([kept, points]) if fixed is None else points


def see_separable(model: QuadraticModel, region: Region, fixed: FloatArray) -> None:
    """DesignError of terms that neither ``fixed`` runs (m, k) nor any in the region tell apart, before any search."""
    points = np.empty((0, model.k)) if region.is_box else np.vstack([region.candidates(limit=2000), fixed])
    if len(points) and (lost := inestimable_terms(model, points)):
        raise _coinciding(lost)


def _drawn_in(model: QuadraticModel, region: Region, precision: FloatArray, points: FloatArray) -> FloatArray:
    """Some of the runs (n, k) half-way to the centre, one by one where the determinant falls least."""
    free, centre, points = list(region.continuous), region.centre(), points.copy()
    inside = points.copy()
    inside[:, free] += (1.0 - _INSIDE) * (centre - points)[:, free]
    left = region.feasible(inside) & np.any(inside != points, axis=1)
    Z, Z_inside = model.matrix(points), model.matrix(inside)
    for _ in range(int(_INNER * len(points))):
        D = np.linalg.inv(precision + Z.T @ Z)
        old, new, both = (np.sum(a @ D * b, axis=1) for a, b in ((Z, Z), (Z_inside, Z_inside), (Z, Z_inside)))
        ratios = np.where(left, (1.0 - old) * (1.0 + new) + both**2, 0.0)
        chosen = first_of_largest(ratios)
        if ratios[chosen] < _LEAST_RATIO:
            break
        points[chosen], Z[chosen], left[chosen] = inside[chosen], Z_inside[chosen], False
    return points


def _check_count(model: QuadraticModel, n_runs: int, fixed: FloatArray) -> None:
    Z = model.matrix(fixed)
    carried = int(np.linalg.matrix_rank(Z.T @ Z, hermitian=True))
    if carried + n_runs < model.p:
        known = f", of which runs at the centre and earlier ones estimate {carried}" if carried else ""
        text = f"{n_runs} runs cannot estimate {model.p} terms{known}"
        remedy = f"Ask for at least {model.p - carried} runs, use order = 1, or fewer factors or levels."
        raise DesignError(text, remedy, field="runs", value=n_runs)


def _singular(model: QuadraticModel, region: Region) -> DesignError:
    lost = inestimable_terms(model, region.candidates(limit=5000))
    if lost:
        return _coinciding(lost)
    near = inestimable_terms(model, region.candidates(limit=5000), 1e-3)
    if near:
        message = f"the region is so thin that these terms can hardly be separated from the others: {', '.join(near)}"
        return DesignError(message, "Relax the constraints, or replace factors that vary together by one.")
    return DesignError("every design tried was singular", "Ask for more runs or more starts.")


def _coinciding(terms: tuple[str, ...]) -> DesignError:
    text = f"no runs in the region can separate these terms from the others: {', '.join(terms)}"
    return DesignError(text, "Relax the constraints, leave out levels that they exclude, or use order = 1.")
