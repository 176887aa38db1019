"""Processes of small data sets, and the covariance of their scores written down entry by entry."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from seqrsm.design.factors import CategoricalFactor, ContinuousFactor
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.fit.process import Blocks, Process

VAGUE, JITTER = 100.0, 1e-9
Surface = Callable[[np.ndarray], np.ndarray]


def factors(k: int, levels: tuple[int, ...] = ()) -> tuple[ContinuousFactor | CategoricalFactor, ...]:
    """``k`` numeric factors from -1 to 1, then categories with so many levels."""
    numeric = tuple(ContinuousFactor(f"x{i}", -1.0, 1.0) for i in range(k))
    return numeric + tuple(CategoricalFactor(f"c{i}", tuple("abcdefgh"[:m])) for i, m in enumerate(levels))


def spread(n: int, k: int, levels: tuple[int, ...] = (), seed: int = 1) -> np.ndarray:
    """Coded settings (n, k + categories) at random."""
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.uniform(-1.0, 1.0, (n, k)), *(rng.integers(m, size=n) for m in levels)])


def hill(x: np.ndarray) -> np.ndarray:
    """A narrow top: no quadratic."""
    return 50.0 + 30.0 * np.exp(-4.0 * np.sum((x - 0.3) ** 2, axis=1))


def bowl(x: np.ndarray) -> np.ndarray:
    """A quadratic with its top at 0.2."""
    return 80.0 - 10.0 * np.sum((x - 0.2) ** 2, axis=1)


def fitted(
    points: np.ndarray,
    y: np.ndarray,
    *,
    levels: tuple[int, ...] = (),
    weights: np.ndarray | None = None,
    blocks: Blocks | None = None,
    seed: int = 5,
) -> Process:
    """The process, with nothing beside the surface but what is given."""
    n = len(y)
    return Process(
        QuadraticModel(factors(points.shape[1] - len(levels), levels)),
        points,
        y,
        np.ones(n) if weights is None else weights,
        np.random.default_rng(seed),
        blocks=blocks,
    )


def trend(points: np.ndarray, k: int, levels: tuple[int, ...] = ()) -> np.ndarray:
    """Gram-ready rows: numeric, contrasts, products of any two of different factors, squares, contrasts by squares.

    The contrasts of a category are any with the scalar products of the program's, which its own tests check.
    """
    contrasts = [
        CategoricalFactor("c", tuple("abcdefgh"[:m])).contrasts[points[:, k + i].astype(int)]
        for i, m in enumerate(levels)
    ]
    groups = [points[:, [j]] for j in range(k)] + contrasts
    rows = list(groups)
    for i in range(len(groups)):
        for j in range(i):
            rows += [
                groups[i][:, [a]] * groups[j][:, [b]]
                for a in range(groups[i].shape[1])
                for b in range(groups[j].shape[1])
            ]
    rows += [points[:, [j]] ** 2 for j in range(k)]
    rows += [c[:, [a]] * points[:, [j]] ** 2 for c in contrasts for a in range(c.shape[1]) for j in range(k)]
    return np.hstack(rows)


def lengths_of(t: np.ndarray) -> np.ndarray:
    """Lengths of factors by what is sampled: beyond the median far longer than its exponential."""
    z = np.maximum((t - np.log(1.2)) / 0.9, 0.0)
    return np.exp(t) * np.exp(2.0 * z * z)


def bent(points: np.ndarray, bends: np.ndarray) -> np.ndarray:
    """Numeric coordinates along ``integral of exp(b x)``, scaled to -1 and 1 at the ends."""
    found = points.copy()
    for j, b in enumerate(bends):
        found[:, j] = 2.0 * np.expm1(b * (points[:, j] + 1.0)) / np.expm1(2.0 * b) - 1.0
    return found


def prior_covariance(
    theta: np.ndarray, a: np.ndarray, b: np.ndarray, k: int, levels: tuple[int, ...] = ()
) -> np.ndarray:
    """Of the surface between coded points a and b, in units of the scatter; ``theta`` as the process samples it."""
    scale, size = np.exp(theta[0]), np.exp(theta[1])
    between = 1.0 / (1.0 + np.exp(-theta[3])) if levels else 1.0
    lengths, bends = lengths_of(theta[3 + bool(levels) :][:k]), theta[3 + bool(levels) + k :][:k]
    a, b = bent(a, bends), bent(b, bends)
    rows_a, rows_b = trend(a, k, levels), trend(b, k, levels)
    found = np.empty((len(a), len(b)))
    for i in range(len(a)):
        for j in range(len(b)):
            r = np.sqrt(5.0) * np.linalg.norm((a[i, :k] - b[j, :k]) / lengths)
            differ = np.count_nonzero(a[i, k:] != b[j, k:])
            matern = size**2 * (1.0 + r + r**2 / 3.0) * np.exp(-r) * between**differ
            found[i, j] = VAGUE + scale**2 * (rows_a[i] @ rows_b[j]) + matern
    return found


def noise_covariance(theta: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Of scores about the surface, in units of the scatter."""
    return np.diag(np.exp(theta[2]) ** 2 / weights + JITTER)
