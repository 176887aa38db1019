"""The next batch of runs, chosen one by one for what each adds to those before it.

Criteria are classes with a ``gain`` and what they ``_says`` of it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.fit.intervals import MIN_DF_PURE_ERROR
from seqrsm.progress import tell
from seqrsm.propose.candidates import Choice, Search, Source
from seqrsm.propose.known import Evidence, Known, Sought, percent


@dataclass(frozen=True, slots=True)
class Proposal:
    """One run to be made."""

    point: FloatArray
    """(k,): coded settings, feasible."""
    purpose: str
    """"optimum" (value there), "regret" (place of it), "repeat" (pure error), or "spread" (whole region, lack of
    fit)."""
    gain: float
    """Drop of the criterion per unit of cost; only comparable within a purpose."""
    why: str
    """One line with the number behind it."""
    repeats: bool
    """The settings were run, or are pending, already."""


class Criterion(Protocol):
    """Proposes one run at a time, given all before it: those made, and those of the batch."""

    def propose(self, search: Search) -> Proposal:
        """The next run."""


MakeCriterion = Callable[[Known], Criterion]
"""A criterion for a batch; what is known follows the runs taken."""


class Greedy:
    """Proposes the candidate with the largest gain per cost, of ``among``: all, those run already, or new ones."""

    among: Literal["all", "executed", "new"] = "all"

    def __init__(self, known: Known) -> None:
        self.known = known

    def gain(self, rows: FloatArray) -> FloatArray:
        """What a run at each of the model rows (n, p) would gain, (n,)."""
        raise NotImplementedError

    def _says(self, choice: Choice) -> tuple[str, str]:
        """Purpose of a run, and why it is proposed."""
        raise NotImplementedError

    def propose(self, search: Search) -> Proposal:
        """The next run."""
        executed = search.candidates.executed
        # Where all settings were run already, one of them is the best there is.
        allowed = {"all": np.ones_like(executed), "executed": executed, "new": ~executed | executed.all()}[self.among]
        choice = search.best(self.gain, allowed)
        purpose, why = self._says(choice)
        return Proposal(choice.point, purpose, choice.gain, why, choice.executed)


class Optimum(Greedy):
    """Lowers the variance of the value at the optimum and of the loss against it; a run is for what it gains more of.

    Where the optimum is: where it seems to be, and where posterior draws put it.
    """

    def gain(self, rows: FloatArray) -> FloatArray:
        """Drop of the mean variance ``trace(WC)``, in units of sigma squared."""
        return self._drop(self.known.value + self.known.regret, rows)

    def _drop(self, W: FloatArray, rows: FloatArray) -> FloatArray:
        """``z'CWCz / (1/w + z'Cz)``."""
        CZ = rows @ self.known.C
        return np.asarray(np.sum((CZ @ W) * CZ, axis=1) / (1.0 / self.known.weight + np.sum(CZ * rows, axis=1)))

    def _says(self, choice: Choice) -> tuple[str, str]:
        row, W = choice.row[None, :], self.known.regret
        of_regret = float(self._drop(W, row)[0])
        if of_regret <= self._drop(self.known.value, row)[0]:
            return "optimum", f"{self.known.narrowing(choice.row)}{choice.again}"
        total = float(np.sum(W * self.known.C))
        share = percent(of_regret / total if total > 0.0 else 0.0)
        return "regret", f"reduces the variance of the loss from a misplaced optimum by {share}{choice.again}"


class Spread(Greedy):
    """Information on all coefficients (D criterion): the least known of the settings that were not run yet."""

    among = "new"

    def gain(self, rows: FloatArray) -> FloatArray:
        """Information ``1/2 log(1 + w z'Cz)`` on all coefficients together [nats]."""
        return np.asarray(0.5 * np.log1p(self.known.weight * np.sum((rows @ self.known.C) * rows, axis=1)))

    def _says(self, choice: Choice) -> tuple[str, str]:
        se = np.sqrt(choice.row @ self.known.C @ choice.row)  # in units of sigma
        why = (
            f"the mean is least certain here (standard error {se:.2g} times that of a run): keeps lack of fit testable "
            "over the region"
        )
        return "spread", f"{why}{choice.again}"


class Repeat(Optimum):
    """Settings run already, for pure error: of these the best for the optimum."""

    among = "executed"

    def _says(self, choice: Choice) -> tuple[str, str]:
        df = self.known.df_pure_error
        why = f"repeats settings run or proposed before: pure error gets {df + 1} degrees of freedom instead of {df}"
        return "repeat", f"{why}; {self.known.narrowing(choice.row)}"


class Testing:
    """Keeps the model testable: repeats until there is enough pure error, from then on the least known places."""

    def __init__(self, known: Known) -> None:
        self._known, self._repeat, self._spread = known, Repeat(known), Spread(known)

    def propose(self, search: Search) -> Proposal:
        """The next run."""
        repeat = self._known.df_pure_error < MIN_DF_PURE_ERROR and search.candidates.executed.any()
        return (self._repeat if repeat else self._spread).propose(search)


Plan = Sequence[tuple[MakeCriterion, float]]
"""Criteria with their shares of the runs of a campaign, 1 in all."""

FOR_THE_OPTIMUM: Plan = ((Optimum, 1.0),)
PLAN: Plan = ((Testing, 0.25), (Optimum, 0.75))
"""A share of the runs keeps the model testable, by repeats and spread."""


def propose_batch(
    model: QuadraticModel,
    region: Region,
    evidence: Evidence,
    sought: Sought,
    n: int,
    plan: Plan = PLAN,
    *,
    source: Source | None = None,
    seed: int = 0,
) -> tuple[Proposal, ...]:
    """Choose the next ``n`` >= 0 runs, by default of a ``source`` with the rows of ``model``, weight 1 and equal cost.

    Each run is proposed by the criterion whose turn it is, given all runs before it in the batch: as a rule the
    candidate with the largest gain per cost. Candidates cover the region, the estimated optimum and posterior draws of
    it with a cloud around them, which ``seed`` fixes, and the executed settings. The shares of the ``plan`` are counted
    over the whole campaign, so that one run in four is kept for any size of batch.
    """
    if n <= 0:
        return ()
    source = Source() if source is None else source
    known = Known(model, region, evidence, sought, source.weight)
    criteria = [make(known) for make, _ in plan]
    search = Search(known, source, np.random.default_rng(seed), evidence)
    proposals = []
    for i in range(n):
        tell("choosing the next runs", i, n)
        proposal = criteria[_whose_turn([share for _, share in plan], len(evidence.rows) + i)].propose(search)
        proposals.append(proposal)
        search.take(proposal.point, proposal.repeats)
    return tuple(proposals)


def _whose_turn(shares: Sequence[float], n_before: int) -> int:
    """Place in a plan whose turn it is after ``n_before`` runs: each has its share of those that the ones before leave.

    The last has the rest.
    """
    left = 1.0
    for place, share in enumerate(shares[:-1]):
        before, after = (int(np.floor(n * (share / left) + 1e-9)) for n in (n_before, n_before + 1))
        if after > before:
            return place
        n_before -= before
        left -= share
    return len(shares) - 1
