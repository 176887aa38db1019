"""Kinds of surfaces on which sequential methods are compared, each drawn anew for every seed.

A kind has numeric factors, coded on [-1, 1], and at most one category, the last column, by the number of its level.
Scores are percentages in size: tens of points over the region, noise of a point or two. Whoever searches sees the same
surface and the same stream of noise for the same seed.
"""

from __future__ import annotations

import itertools
import sys
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from scipy.optimize import minimize

sys.path.insert(0, str(Path(__file__).parent))
import surfaces

Array = np.ndarray
Value = Callable[[Array], Array]
Make = Callable[[np.random.Generator], Value]
SD = 2.0
"""Standard deviation of a run, in points, where a kind has no other noise."""
TRIALS = 400
"""Decisions that a score of the kind "counts" is the percentage correct of."""


def constant(means: Array) -> Array:
    """The same noise everywhere."""
    return np.full(np.shape(means), SD)


def student(means: Array) -> Array:
    """Of Student-t noise with 4 degrees of freedom and scale `SD`."""
    return np.full(np.shape(means), SD * np.sqrt(2.0))


def unequal(means: Array, top: float = 85.0) -> Array:
    """Poor scores scatter up to five times as much as good ones."""
    return 1.0 + np.clip((top - means) / 12.0, 0.0, 4.0)


def counts(means: Array) -> Array:
    """Binomial."""
    return np.sqrt(means * (100.0 - means) / TRIALS)


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of surface.

    Attributes
    ----------
    name : str
    factors : int
        Numeric ones.
    make : callable
        Draws the true means as a function of coded points (n, factors), and the level in one more column.
    runs : int
        Budget of a campaign.
    noise : callable
        Standard deviation of a run from its true mean.
    levels : int
        Of the category; 0 where there is none.
    errors : "normal", "student_t" or "counts"
        How scores scatter.
    of_day : float
        Standard deviation of what the runs of a batch, made on one day, have in common, in points.
    """

    name: str
    factors: int
    make: Make
    runs: int = 40
    noise: Callable[[Array], Array] = constant
    levels: int = 0
    errors: str = "normal"
    of_day: float = 0.0

    def draw(self, seed: int) -> Drawn:
        """The surface of a seed."""
        return Drawn(self, self.make(np.random.default_rng([seed, 1, zlib.crc32(self.name.encode())])))


@dataclass(frozen=True, slots=True)
class Drawn:
    """One surface of a kind: ``value`` gives the true means (n,) of coded points (n, columns)."""

    kind: Kind
    value: Value

    def noise_sd(self, X: Array) -> Array:
        """Standard deviations (n,) of runs."""
        return self.kind.noise(self.value(X))

    def score(self, X: Array, rng: np.random.Generator) -> Array:
        """Scores (n,) of runs of one day."""
        means = self.value(X)
        if self.kind.of_day:
            means = means + self.kind.of_day * rng.standard_normal()
        if self.kind.errors == "counts":
            return 100.0 * rng.binomial(TRIALS, means / 100.0) / TRIALS
        if self.kind.errors == "student_t":
            return means + SD * rng.standard_t(4.0, len(means))
        return means + self.kind.noise(means) * rng.standard_normal(len(means))


def cliff(rng: np.random.Generator) -> Value:
    """Gains that level off along the first factor, and end in a drop of 25 points within 0.2."""
    best, edge = rng.uniform(-0.5, 0.3, 2), rng.uniform(0.2, 0.6)

    def value(X: Array) -> Array:
        rise = 20.0 * (1.0 - np.exp(-1.5 * (X[:, 0] + 1.0)))
        drop = 25.0 / (1.0 + np.exp(-22.0 * (X[:, 0] - edge)))
        return 55.0 + rise - drop - (X[:, 1:] - best) ** 2 @ np.array([6.0, 5.0])

    return value


def ridge(rng: np.random.Generator) -> Value:
    """Two factors trade off along a bend, as looks and the area of a cell on log axes do; quadratic in the others."""
    at, bend, best = rng.uniform(0.3, 0.7), rng.uniform(0.8, 1.4), rng.uniform(-0.4, 0.4, 3)

    def value(X: Array) -> Array:
        off = X[:, 0] + bend * X[:, 1] ** 2 + 0.4 * X[:, 1] - at
        return 85.0 - 30.0 * (1.0 - np.exp(-2.5 * off**2)) - (X[:, 1:] - best) ** 2 @ np.array([6.0, 7.0, 6.0])

    return value


TOPS = (85.0, 83.0, 80.0)


def categories(rng: np.random.Generator) -> Value:
    """Every level of a category has a quadratic of its own: another top, another place, other curvatures."""
    best, bend, top = rng.uniform(-0.8, 0.8, (3, 3)), rng.uniform(4.0, 16.0, (3, 3)), rng.permutation(TOPS)

    def value(X: Array) -> Array:
        level = X[:, 3].astype(int)
        return top[level] - np.sum(bend[level] * (X[:, :3] - best[level]) ** 2, axis=1)

    return value


def sparse(rng: np.random.Generator) -> Value:
    """A bell over two of six factors; the others do nothing."""
    two = rng.choice(6, 2, replace=False)
    best, width = rng.uniform(-0.5, 0.5, 2), rng.uniform(0.3, 0.6, 2)
    return lambda X: 50.0 + 35.0 * np.exp(-np.sum((X[:, two] - best) ** 2 / width, axis=1))


def narrow(rng: np.random.Generator) -> Value:
    """A bell of 22 points, a seventh of the range wide, on a slope of a few points."""
    best, slope = rng.uniform(-0.6, 0.6, 3), rng.uniform(-4.0, 4.0, 3)
    return lambda X: 60.0 + X @ slope + 22.0 * np.exp(-np.sum((X - best) ** 2, axis=1) / (2.0 * 0.3**2))


HEIGHTS = np.array([1.0, 1.2, 3.0, 3.2])
STEEP = np.array(
    [[10, 3, 17, 3.5, 1.7, 8], [0.05, 10, 17, 0.1, 8, 14], [3, 3.5, 1.7, 10, 17, 8], [17, 8, 0.05, 10, 0.1, 14]]
)
PEAKS = 1e-4 * np.array(
    [
        [1312, 1696, 5569, 124, 8283, 5886],
        [2329, 4135, 8307, 3736, 1004, 9991],
        [2348, 1451, 3522, 2883, 3047, 6650],
        [4047, 8828, 8732, 5743, 1091, 381],
    ]
)


def hartmann6(rng: np.random.Generator) -> Value:
    """Four bells in six factors (Hartmann 1973), the factors in random order and direction; flat at most edges."""
    order, signs = rng.permutation(6), rng.choice([-1.0, 1.0], 6)

    def value(X: Array) -> Array:
        unit = (0.5 * (X * signs + 1.0))[:, order]
        return 45.0 + 11.0 * np.exp(-np.sum(STEEP * (unit[:, None] - PEAKS) ** 2, axis=2)) @ HEIGHTS

    return value


def cubic(rng: np.random.Generator, k: int = 3) -> Value:
    """A quadratic and terms of third order that add 3 to 5 points at most."""
    base = surfaces.quadratic(rng, k)
    powers = [p for p in itertools.product(range(4), repeat=k) if sum(p) == 3]
    weights, largest = rng.normal(size=len(powers)), rng.uniform(3.0, 5.0)

    def third(X: Array) -> Array:
        return np.stack([np.prod(X ** np.array(p), axis=1) for p in powers], axis=1) @ weights

    grid = np.array(list(itertools.product(np.linspace(-1.0, 1.0, 21), repeat=k)))
    share = largest / np.max(np.abs(third(grid)))
    return lambda X: base(X) + share * third(X)


def shares(rng: np.random.Generator) -> Value:
    """A quadratic within what a percentage can be."""
    base = surfaces.quadratic(rng, 3)
    return lambda X: np.clip(base(X), 2.0, 98.0)


def _old(surface: Callable[[np.random.Generator, int], Value], k: int) -> Make:
    return partial(_made, surface, k)


def _made(surface: Callable[[np.random.Generator, int], Value], k: int, rng: np.random.Generator) -> Value:
    return surface(rng, k)


KINDS: dict[str, Kind] = {
    kind.name: kind
    for kind in (
        Kind("quadratic, k = 3", 3, _old(surfaces.quadratic, 3)),
        Kind("quadratic, k = 4", 4, _old(surfaces.quadratic, 4)),
        Kind("quadratic, k = 5", 5, _old(surfaces.quadratic, 5)),
        Kind("quadratic, k = 6", 6, _old(surfaces.quadratic, 6), runs=60),
        Kind("border, k = 3", 3, _old(surfaces.border, 3)),
        Kind("border, k = 4", 4, _old(surfaces.border, 4)),
        Kind("cubic", 3, cubic),
        Kind("saturating, k = 3", 3, _old(surfaces.saturating, 3)),
        Kind("saturating, k = 4", 4, _old(surfaces.saturating, 4)),
        Kind("asymmetric", 3, _old(surfaces.asymmetric, 3)),
        Kind("unequal noise", 3, _old(surfaces.asymmetric, 3), noise=unequal),
        Kind("two humps", 2, _old(surfaces.two_humped, 2)),
        Kind("plateau", 3, _old(surfaces.plateau, 3)),
        Kind("cliff", 3, cliff),
        Kind("ridge", 4, ridge),
        Kind("categories", 3, categories, levels=3),
        Kind("sparse", 6, sparse, runs=60),
        Kind("narrow", 3, narrow),
        Kind("hartmann6", 6, hartmann6, runs=60),
        Kind("days, saturating", 3, _old(surfaces.saturating, 3), of_day=SD),
        Kind("days, cliff", 3, cliff, of_day=SD),
        Kind("student", 3, _old(surfaces.quadratic, 3), noise=student, errors="student_t"),
        Kind("counts", 3, shares, noise=counts, errors="counts"),
    )
}


def spread(kind: Kind, n: int, rng: np.random.Generator) -> Array:
    """Random points (n, columns) of the region."""
    X = rng.uniform(-1.0, 1.0, (n, kind.factors))
    return np.column_stack([X, rng.integers(kind.levels, size=n)]) if kind.levels else X


def highest(value: Value, kind: Kind, X: Array) -> Array:
    """The best of points ``X``, and of points ever nearer to the best four: the top of a rough or smooth function."""
    rng, k = np.random.default_rng(0), kind.factors
    best = X[np.argsort(-value(X))[:4]]
    for radius in (0.2, 0.1, 0.05, 0.02, 0.01):
        near = np.repeat(best, 60, axis=0)
        near[:, :k] = np.clip(near[:, :k] + radius * rng.standard_normal((len(near), k)), -1.0, 1.0)
        near = np.vstack([best, near])
        best = near[np.argsort(-value(near))[:4]]
    return best[0]


def true_optimum(drawn: Drawn) -> tuple[Array, float]:
    """Place and value of the largest true mean: a dense search, and climbs from its best points of every level."""
    kind, k = drawn.kind, drawn.kind.factors
    X = np.random.default_rng(0).uniform(-1.0, 1.0, (20_000, k))
    found = []
    for level in range(max(kind.levels, 1)):
        own = np.array([level] if kind.levels else [], dtype=float)

        def loss(x: Array, own: Array = own) -> float:
            return -float(drawn.value(np.append(x, own)[None, :])[0])

        values = drawn.value(np.column_stack([X, np.tile(own, (len(X), 1))]))
        for start in X[np.argsort(-values)[:6]]:
            climb = minimize(loss, start, bounds=[(-1.0, 1.0)] * k, method="L-BFGS-B", options={"ftol": 1e-13})
            found.append((-float(climb.fun), np.append(climb.x, own)))
    value, place = max(found, key=lambda one: one[0])
    return place, value


def true_top(drawn: Drawn) -> float:
    """The largest true mean."""
    return true_optimum(drawn)[1]
