"""Bounds of linear combinations of coefficients: a prior that is cut off, and draws of a posterior under it.

A posterior under a prior that is cut off is the posterior under the whole prior, cut off in the same place. So draws of
the latter that hold the bounds are draws of the former; where too few do, the ensemble sampler works inside the bounds.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from seqrsm.arrays import BoolArray, FloatArray

_MOST = 60  # times the draws wanted, before rejection gives up
_FIRST_STEP = 0.3  # largest distance from a bound at which a walker starts, in standard deviations


@dataclass(frozen=True, slots=True)
class LinearBounds:
    """``low <= rows @ beta <= high``.

    Attributes
    ----------
    rows : ndarray (c, p)
        Linearly independent.
    low, high : ndarray (c,)
        -inf and inf where there is no bound; low < high.
    """

    rows: FloatArray
    low: FloatArray
    high: FloatArray

    def hold(self, beta: FloatArray) -> BoolArray:
        """Which coefficients (n, p) lie inside."""
        value = beta @ self.rows.T
        return np.asarray(np.all((value >= self.low) & (value <= self.high), axis=1))

    def seen_from(self, mean: FloatArray, transform: FloatArray) -> LinearBounds:
        """The same bounds of u (p,), with ``beta = mean + transform @ u``."""
        offset = self.rows @ mean
        return LinearBounds(self.rows @ transform, self.low - offset, self.high - offset)

    def moved_inside(self, u: FloatArray, random: Any) -> FloatArray:
        """Points (n, p) moved to inside, by the shortest way and to random distances from the bounds they broke.

        ``u`` is whitened: one step is about a standard deviation. ``random`` is a ``numpy.random.RandomState``.
        """
        value = u @ self.rows.T
        step = _FIRST_STEP * np.linalg.norm(self.rows, axis=1)
        step = np.where(np.isfinite(self.high - self.low), np.minimum(step, 0.5 * (self.high - self.low)), step)
        depth = step * random.uniform(0.01, 1.0, size=value.shape)
        wanted = np.where(value < self.low, self.low + depth, value)
        wanted = np.where(value > self.high, self.high - depth, wanted)
        back = np.linalg.lstsq(self.rows, (wanted - value).T, rcond=None)[0]
        return np.asarray(u + back.T)


def bounded_draws(
    draw: Callable[[int], tuple[FloatArray, ...]], bounds: LinearBounds, n: int
) -> tuple[tuple[FloatArray, ...], float]:
    """Draws that hold the bounds, and the share of all draws that do: the probability without bounds.

    Parameters
    ----------
    draw : callable
        So many draws -> coefficients (m, p) and whatever belongs to them, each (m, ...).
    bounds : LinearBounds
    n : int
        Draws wanted; fewer are given where hardly any hold.
    """
    kept: list[tuple[FloatArray, ...]] = []
    made = found = 0
    while found < n and made < _MOST * n:
        new = draw(n)
        inside = bounds.hold(new[0])
        made, found = made + len(inside), found + int(np.count_nonzero(inside))
        kept.append(tuple(column[inside] for column in new))
    together = tuple(np.concatenate(columns)[:n] for columns in zip(*kept, strict=True))
    return together, found / made
