"""Common random numbers: which simulated runs share one occasion, and that the record says so.

Runs of one occasion meet the same fields, date, moisture, fading and receiver noise, so that their scores differ by the
settings more than by chance; as chance moves them together they are not independent, which (2-6) of RSL TR 380-1 asks
for, and are fitted as a block. The run's block is the record: it tells fit and simulator alike, whatever the
specification says by then.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.design.factors import CategoricalFactor, Factor
from seqrsm.design.region import Region
from seqrsm.store.records import CONFIRMATION, NewRun, RunRecord

STREAM_0 = 10**9
"""Occasion n draws what a run of this id + n would: no run of a campaign comes near it."""

NEAR = 0.5
"""Coded distance, a quarter of a factor's range, below which settings of one occasion are kept apart."""

REACH = 1.5
"""Coded distance over which the effect of an occasion changes with the settings."""


def occasion_of(source: str, block: str) -> int | None:
    """Number of the occasion, from 1, that a run's block says it shares; None where it has one of its own."""
    found = re.fullmatch(r"occasion ([1-9]\d{0,8})", block) if source == "simulation" else None
    return None if found is None else int(found[1])


def shared_occasions(runs: Iterable[tuple[str, str]]) -> dict[int, int]:
    """Numbers of the occasions that two or more of the runs share, and of how many; a run: its source and block."""
    members = Counter(number for run in runs if (number := occasion_of(*run)) is not None)
    return {number: n for number, n in members.items() if n > 1}


def sharing(runs: Sequence[RunRecord]) -> tuple[int, int]:
    """How many scored runs share an occasion with another one, and how many occasions those are."""
    shared = shared_occasions((run.source, run.block) for run in runs if run.state == "scored")
    return sum(shared.values()), len(shared)


def share_occasions(runs: Sequence[NewRun], made: Sequence[RunRecord], *, size: int, region: Region) -> list[NewRun]:
    """Deal simulated runs out to occasions of at most ``size`` runs; earlier ones are filled up first.

    Settings that are alike go to different occasions: the same setting would give the same number twice, which is no
    repeat, and neighbours nearly so, as if they were known far better than the block's one variance says. Confirmation
    runs keep occasions of their own.

    Parameters
    ----------
    runs : sequence of NewRun
        To be proposed, in order.
    made : sequence of RunRecord
        All runs of the campaign so far, void ones included.
    size : int
        Most runs to an occasion, >= 2.
    region : Region
        Of the campaign.

    Returns
    -------
    list of NewRun
        The runs, with their occasions as blocks.
    """
    earlier = [(number, run) for run in made if (number := occasion_of(run.source, run.block)) is not None]
    points = region.code([*(run.proposed for _, run in earlier), *(run.settings for run in runs)])
    members: dict[int, list[FloatArray]] = {}
    for (number, _), point in zip(earlier, points[: len(earlier)], strict=True):
        members.setdefault(number, []).append(point)
    last = max(members, default=0)
    shared = [run.source == "simulation" and run.purpose != CONFIRMATION for run in runs]
    room = sum(max(size - len(own), 0) for own in members.values())
    for number in range(last + 1, last + 1 - (-max(sum(shared) - room, 0) // size)):
        members[number] = []
    found: list[NewRun] = []
    for fresh, belongs, point in zip(runs, shared, points[len(earlier) :], strict=True):
        if not belongs:
            found.append(fresh)
            continue
        free = [n for n, own in members.items() if len(own) < size and not any(_alike(region, point, x) for x in own)]
        # Old occasions are filled up in order; new ones in turn, so that each gets settings from all over the region.
        number = min(free, key=lambda n: (n > last, n if n <= last else len(members[n]), n), default=0)
        number = number or max(members) + 1
        members.setdefault(number, []).append(point)
        found.append(replace(fresh, block=f"occasion {number}"))
    return found


def similarity(factors: Sequence[Factor], points: FloatArray) -> FloatArray:
    """Correlation (n, n) of what one occasion does to the scores at coded settings (n, k): near 1 for near ones.

    A fixed shape and scale: the campaign tells the variance alone. Scores of one occasion are correlated by 0.2 to 1,
    the less the further apart their settings are; one number for all would make differences of far settings look better
    known than they are (``reports/speed-accuracy/common-random-numbers.md``).
    """
    square = np.zeros((len(points), len(points)))
    for column, factor in zip(points.T, factors, strict=True):
        apart = column[:, None] - column[None, :]
        square += (apart != 0.0) if isinstance(factor, CategoricalFactor) else np.square(apart)
    return np.asarray(np.exp(-0.5 * square / REACH**2), dtype=np.float64)


def _alike(region: Region, one: FloatArray, other: FloatArray) -> bool:
    """Whether two coded settings (k,) are equal, or near each other in every numeric factor, whatever their levels."""
    numeric = list(region.numeric)
    near = bool(np.all(np.abs(one[numeric] - other[numeric]) < NEAR)) and len(numeric) > 0
    return near or bool(np.allclose(one, other, atol=1e-9))
