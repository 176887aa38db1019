"""Smooth surfaces of the studies, drawn anew for every seed: scores of tens of points over the region."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from seqrsm.arrays import FloatArray

Surface = Callable[[FloatArray], FloatArray]


def saturating(rng: np.random.Generator, k: int) -> Surface:
    """Gains that level off, less a cost that does not."""
    a, b, best = rng.uniform(14, 26, k), rng.uniform(2.0, 3.5, k), rng.uniform(-0.3, 0.9, k)
    c = a * b * np.exp(-b * (best + 1))
    return lambda x: 40 + np.sum(a * (1 - np.exp(-b * (x + 1))) - c * (x + 1), axis=-1)


def asymmetric(rng: np.random.Generator, k: int) -> Surface:
    """A slow slope on one side, a cliff on the other (LINEX)."""
    steep, best, size = (
        rng.uniform(2.0, 3.0, k) * rng.choice([-1, 1], k),
        rng.uniform(-0.4, 0.4, k),
        rng.uniform(1, 2, k),
    )
    return lambda x: 85 - np.sum(size * (np.exp(steep * (x - best)) - steep * (x - best) - 1), axis=-1)


def two_humped(rng: np.random.Generator, k: int) -> Surface:
    """Two hills of different height on opposite sides of the centre."""
    side = rng.normal(size=k)
    side *= 0.55 / np.linalg.norm(side)

    def value(x: FloatArray) -> FloatArray:
        high, low = np.sum((x - side) ** 2, axis=-1), np.sum((x + side) ** 2, axis=-1)
        return 45 + 35 * np.exp(-high / 0.32) + 27 * np.exp(-low / 0.32)

    return value


def plateau(rng: np.random.Generator, k: int) -> Surface:
    """A tilted table with steep sides."""
    centre, tilt, size = rng.uniform(-0.25, 0.25, k), rng.normal(size=k), rng.uniform(0.8, 1.1, k)
    tilt /= np.linalg.norm(tilt)

    def value(x: FloatArray) -> FloatArray:
        far = np.sum(((x - centre) / size) ** 2, axis=-1)
        return 50 + 35 / (1 + np.exp(8 * (far - 0.8))) + 5 * (x - centre) @ tilt

    return value


def quadratic(rng: np.random.Generator, k: int, reach: float = 0.6) -> Surface:
    """A rotated quadratic, its top within ``reach`` of the centre in every coordinate."""
    turn, _ = np.linalg.qr(rng.normal(size=(k, k)))
    B = turn @ np.diag(rng.uniform(4, 14, k)) @ turn.T
    best = rng.uniform(-reach, reach, k)
    return lambda x: 90 - np.einsum("...i,ij,...j->...", x - best, B, x - best)


def border(rng: np.random.Generator, k: int) -> Surface:
    """A quadratic whose top lies beyond one face."""
    turn, _ = np.linalg.qr(rng.normal(size=(k, k)))
    B = turn @ np.diag(rng.uniform(4, 14, k)) @ turn.T
    best = rng.uniform(-0.5, 0.5, k)
    best[0] = 1.3
    return lambda x: 90 - np.einsum("...i,ij,...j->...", x - best, B, x - best)
