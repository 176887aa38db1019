"""The next batch of runs, chosen one by one for what each adds to those before it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.progress import tell
from seqrsm.propose.candidates import Search, Source
from seqrsm.propose.criteria import MakeCriterion, Optimum, Proposal, Testing
from seqrsm.propose.known import Evidence, Known, Sought

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
    """Choose the next ``n`` runs.

    Each run is proposed by the criterion whose turn it is, given all runs before it in the batch: as a rule the
    candidate with the largest gain per cost. Candidates cover the region, the estimated optimum and posterior draws of
    it with a cloud around them, and the executed settings.

    Parameters
    ----------
    model, region : QuadraticModel, Region
    evidence : Evidence
        Runs made and pending.
    sought : Sought
        The optimum, as far as it is known.
    n : int
        Runs to propose, >= 0.
    plan : Plan
        Criteria and their shares; shares are counted over the whole campaign, so that one run in four is kept for any
        size of batch.
    source : Source, optional
        Who makes the runs; by default such as have the rows of ``model``, weight 1 and equal cost.
    seed : int
        Fixes the cloud; equal inputs and seed give equal proposals.
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
