"""Vectorised moves for several independent ensembles of walkers in one array.

Walkers e*W ... (e+1)*W - 1 are ensemble e; a move never mixes ensembles, so each is a chain of its own and R-hat across
them means something. Objects here follow emcee's protocol ``propose(model, state) -> (state, accepted)``.

The snooker move uses the Hastings factor |x' - z|^(d-1) / |x - z|^(d-1) and the orthogonal projection of the original
paper. emcee 3.1.6's own ``DESnookerMove`` has half that exponent and another projection; on a unit normal in 10
dimensions it settles at a variance of 0.61, so it is not used.

References
----------
ter Braak (2006), A Markov chain Monte Carlo version of the genetic algorithm differential evolution, Stat. Comput. 16.
ter Braak, Vrugt (2008), Differential evolution Markov chain with snooker updater and fewer chains, Stat. Comput. 18.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from seqrsm.arrays import BoolArray, FloatArray


class Distribution(Protocol):
    """What an independence proposal must offer."""

    def draw(self, random: Any, n: int) -> FloatArray:
        """Draw (n, d) with a ``numpy.random.RandomState``."""

    def log_density(self, x: FloatArray) -> FloatArray:
        """Normalised log density (n, d) -> (n,)."""

    def tuned(self, draws: FloatArray) -> Distribution:
        """The member of the family with the moments of ``draws`` (n, d)."""


class Move:
    """Base of the moves: accepts, and counts what was ``accepted`` of all ``proposed``."""

    def __init__(self) -> None:
        self.accepted = 0
        self.proposed = 0

    def _accept(self, log_ratio: FloatArray, random: Any) -> BoolArray:
        accepted: BoolArray = np.log(random.random_sample(log_ratio.shape)) < log_ratio
        self.accepted += int(np.count_nonzero(accepted))
        self.proposed += accepted.size
        return accepted


class IndependenceMove(Move):
    """Propose every walker afresh from a fixed mixture of distributions by their ``shares``, 1 in all."""

    def __init__(self, proposals: Sequence[Distribution], shares: Sequence[float]) -> None:
        super().__init__()
        self._proposals = proposals
        self._shares = shares

    def propose(self, model: Any, state: Any) -> tuple[Any, BoolArray]:
        """One step of all walkers."""
        old = state.coords
        counts = model.random.multinomial(old.shape[0], self._shares)
        parts = [q.draw(model.random, n) for q, n in zip(self._proposals, counts, strict=True)]
        new = np.concatenate(parts)[model.random.permutation(old.shape[0])]
        log_prob = model.log_prob_fn(new)
        hastings = self._log_density(old) - self._log_density(new)
        accepted = self._accept(log_prob - state.log_prob + hastings, model.random)
        old[accepted] = new[accepted]
        state.log_prob[accepted] = log_prob[accepted]
        return state, accepted

    def _log_density(self, x: FloatArray) -> FloatArray:
        parts = [np.log(share) + q.log_density(x) for q, share in zip(self._proposals, self._shares, strict=True)]
        return np.asarray(np.logaddexp.reduce(parts, axis=0))


class _PairedMove(Move, ABC):
    """Moves one random half of each ensemble given the other, then the other way round."""

    def __init__(self, ensembles: int) -> None:
        super().__init__()
        self._ensembles = ensembles

    def propose(self, model: Any, state: Any) -> tuple[Any, BoolArray]:
        """One step of all walkers."""
        n, _ = state.coords.shape
        walkers = n // self._ensembles
        order = np.argsort(model.random.random_sample((self._ensembles, walkers)), axis=1)
        order += walkers * np.arange(self._ensembles)[:, None]
        halves = order[:, : walkers // 2], order[:, walkers // 2 :]
        accepted = np.zeros(n, dtype=np.bool_)
        for moving, fixed in (halves, halves[::-1]):
            index = moving.ravel()
            new, hastings = self._propose(state.coords[moving], state.coords[fixed], model.random)
            new = new.reshape(index.size, -1)
            log_prob = model.log_prob_fn(new)
            ok = self._accept(log_prob - state.log_prob[index] + hastings.ravel(), model.random)
            state.coords[index[ok]] = new[ok]
            state.log_prob[index[ok]] = log_prob[ok]
            accepted[index] = ok
        return state, accepted

    @abstractmethod
    def _propose(self, moving: FloatArray, fixed: FloatArray, random: Any) -> tuple[FloatArray, FloatArray]:
        """Proposals (e, m, d) and log Hastings factors (e, m) for ``moving``, given ``fixed`` (e, f, d)."""


class DifferentialMove(_PairedMove):
    """x' = x + gamma (z1 - z2) with z1, z2 from the other half; gamma = 2.38 / sqrt(2d), one time in ten 1.

    The long jumps are ter Braak's device for separated modes; the relative jitter of gamma is 1e-5 as in emcee.
    """

    def _propose(self, moving: FloatArray, fixed: FloatArray, random: Any) -> tuple[FloatArray, FloatArray]:
        e, m, d = moving.shape
        first, second = _distinct(fixed.shape[1], (e, m), 2, random)
        row = np.arange(e)[:, None]
        gamma = np.where(random.random_sample((e, m, 1)) < 0.1, 1.0, 2.38 / np.sqrt(2.0 * d))
        gamma = gamma * (1.0 + 1e-5 * random.standard_normal((e, m, 1)))
        return moving + gamma * (fixed[row, first] - fixed[row, second]), np.zeros((e, m))


class SnookerMove(_PairedMove):
    """Along the line from z through x by 1.7 times the projected difference of two other walkers."""

    def _propose(self, moving: FloatArray, fixed: FloatArray, random: Any) -> tuple[FloatArray, FloatArray]:
        e, m, d = moving.shape
        first, second, third = _distinct(fixed.shape[1], (e, m), 3, random)
        row = np.arange(e)[:, None]
        anchor = fixed[row, first]
        line = moving - anchor
        length = np.sqrt(np.sum(np.square(line), axis=2))
        length = np.where(length > 0.0, length, np.nan)  # x on its anchor: nan log ratio, the move is refused
        unit = line / length[:, :, None]
        gap = fixed[row, second] - fixed[row, third]
        step = 1.7 * np.sum(unit * gap, axis=2)
        new_length = np.abs(length + step)
        with np.errstate(divide="ignore"):
            hastings = (d - 1.0) * (np.log(new_length) - np.log(length))
        stuck = ~np.isfinite(hastings)
        step, hastings = np.where(stuck, 0.0, step), np.where(stuck, -np.inf, hastings)
        unit = np.where(stuck[:, :, None], 0.0, unit)
        return moving + step[:, :, None] * unit, hastings


def _distinct(n: int, shape: tuple[int, int], count: int, random: Any) -> list[Any]:
    """Return ``count`` arrays of distinct random indices below n."""
    first = random.randint(n, size=shape)
    second = (first + 1 + random.randint(n - 1, size=shape)) % n
    if count == 2:
        return [first, second]
    third = random.randint(n - 2, size=shape)
    low, high = np.minimum(first, second), np.maximum(first, second)
    third = third + (third >= low)
    return [first, second, third + (third >= high)]
