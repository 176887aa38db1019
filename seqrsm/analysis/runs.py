"""The scored runs that a fit is made from: which they are, which belong together, and on which scale they count.

Common random numbers: runs of one occasion meet the same fields, date, moisture, fading and receiver noise, so that
their scores differ by the settings more than by chance; as chance moves them together they are not independent, which
(2-6) of RSL TR 380-1 asks for, and are fitted as a block. The run's block is the record: it tells fit and simulator
alike, whatever the specification says by then.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from seqrsm.analysis.scale import ResponseScale
from seqrsm.arrays import FloatArray, IntArray
from seqrsm.design.factors import CategoricalFactor, Factor
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.errors import FitError, Problem
from seqrsm.fit.least_squares import block_columns
from seqrsm.fit.weights import expected_shares
from seqrsm.spec.read import CampaignSpec
from seqrsm.store.records import CONFIRMATION, NewRun, RunRecord

STREAM_0 = 10**9
"""Occasion n draws what a run of this id + n would: no run of a campaign comes near it."""

NEAR = 0.5
"""Coded distance, a quarter of a factor's range, below which settings of one occasion are kept apart."""

REACH = 1.5
"""Coded distance over which the effect of an occasion changes with the settings."""

_SAME_SETTING_DECIMALS = 9
LISTED_RUNS = 8


@dataclass(frozen=True, slots=True)
class ScoredRuns:
    """The runs that enter the fit, as arrays of length n.

    Attributes
    ----------
    run_ids : int array
    points : ndarray (n, k)
        Executed settings, coded.
    scores, score_se : ndarray (n,)
        Utility and its own standard error (nan where none was given), in score units.
    sources, blocks : tuple of str
        "simulation" or "flight"; block label ("" where none).
    batches : int array
    purposes : tuple of str
        As of `NewRun`.
    trials, correct : ndarray (n,), optional
        Binomial counts; nan where none were given.
    guess, perfect : float
        What a guess that looks at nothing scores, and perfect data, on average over the runs; nan where not known.
    """

    run_ids: IntArray
    points: FloatArray
    scores: FloatArray
    score_se: FloatArray
    sources: tuple[str, ...]
    blocks: tuple[str, ...]
    batches: IntArray
    purposes: tuple[str, ...]
    trials: FloatArray | None = None
    correct: FloatArray | None = None
    guess: float = np.nan
    perfect: float = np.nan


def evidence(runs: Sequence[RunRecord]) -> list[RunRecord]:
    """Runs that a fit is made of, once they are scored: a set of confirmation runs is held back until others follow it.

    It then tests what was recommended; from the next runs on it counts as they do.
    """
    last = max((run.batch for run in runs if run.state == "scored" and run.purpose != CONFIRMATION), default=0)
    return [run for run in runs if run.purpose != CONFIRMATION or run.batch < last]


def scored_runs(region: Region, runs: Sequence[RunRecord], application: str) -> ScoredRuns:
    """Runs that enter the fit of ``application``: those of `evidence` that are scored and not void, in order of id."""
    used = [
        (run, score)
        for run in evidence(runs)
        if run.state == "scored" and (score := run.score_of(application)) is not None
    ]
    return ScoredRuns(
        run_ids=np.array([run.run_id for run, _ in used], dtype=np.int64),
        points=region.code([run.settings for run, _ in used]) if used else np.empty((0, region.k)),
        scores=np.array([score.score for _, score in used], dtype=np.float64),
        score_se=np.array([np.nan if score.se is None else score.se for _, score in used], dtype=np.float64),
        sources=tuple(run.source for run, _ in used),
        blocks=tuple(run.block for run, _ in used),
        batches=np.array([run.batch for run, _ in used], dtype=np.int64),
        purposes=tuple(run.purpose for run, _ in used),
        trials=_counts([score.n for _, score in used]),
        correct=_counts([score.correct for _, score in used]),
        guess=_mean_of([score.metadata.get("guess") for _, score in used]),
        perfect=_mean_of([score.metadata.get("perfect") for _, score in used]),
    )


def _mean_of(values: Sequence[float | None]) -> float:
    """Mean of those that are known; nan where none is."""
    known = [float(value) for value in values if value is not None]
    return sum(known) / len(known) if known else float("nan")


def _counts(values: Sequence[int | None]) -> FloatArray:
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)


def setting_ids(points: FloatArray) -> list[tuple[float, ...]]:
    """Equal for equal executed settings; coded points (n, k) compared to 1e-9 of half a factor's range."""
    return [tuple(row) for row in np.round(points, _SAME_SETTING_DECIMALS) + 0.0]


def occasion_of(source: str, block: str) -> int | None:
    """Number of the occasion, from 1, that a run's block says it shares; None where it has one of its own."""
    found = re.fullmatch(r"occasion ([1-9]\d{0,8})", block) if source == "simulation" else None
    return None if found is None else int(found[1])


def shared_occasions(runs: Iterable[tuple[str, str]]) -> dict[int, int]:
    """Numbers of the occasions that two or more of the runs share, and of how many; a run: its source and block."""
    members = Counter(number for run in runs if (number := occasion_of(*run)) is not None)
    return {number: n for number, n in members.items() if n > 1}


def block_labels(spec: CampaignSpec, data: ScoredRuns, *, with_source: bool = True) -> list[str]:
    """Block of each run.

    The occasion that simulated runs share; the flight day, where ``[model] block`` asks for it; and the source where
    there are two. Runs alone in their occasions are one block: a constant for each would leave nothing of them.
    """
    source_too = with_source and len(set(data.sources)) > 1
    with_block = spec.model.block is not None
    together = shared_occasions(zip(data.sources, data.blocks, strict=True))
    found = []
    for source, block in zip(data.sources, data.blocks, strict=True):
        number = occasion_of(source, block)
        counts = with_block if number is None else number in together
        found.append(" ".join(part for part in (source if source_too else "", block if counts else "") if part))
    return [label or "all" for label in found]


def columns_within_sources(spec: CampaignSpec, data: ScoredRuns) -> FloatArray:
    """Columns (n, b) of blocks where flights and simulations differ by terms of their own.

    Contrasts of the flight days, and of the occasions that simulated runs share: 0 for every other run, which met one
    from the same source of occasions, so that flights are not told from simulations by them.
    """
    shared = np.array([occasion_of(*each) is not None for each in zip(data.sources, data.blocks, strict=True)])
    labels = np.array(block_labels(spec, data, with_source=False), dtype=object)
    days, _ = block_columns(["all" if own else label for own, label in zip(shared, labels, strict=True)])
    occasions, names = block_columns(labels[shared & (labels != "all")])
    within = np.zeros((len(labels), len(names)))
    within[shared & (labels != "all")] = occasions[:, : len(names)]
    return np.hstack([days, within])


def occasions_shared(data: ScoredRuns) -> int:
    """How many occasions the simulated runs share; 0 where each run has its own."""
    return len(shared_occasions(zip(data.sources, data.blocks, strict=True)))


def response_scale(spec: CampaignSpec, data: ScoredRuns) -> ResponseScale:
    """Scores on the scale of ``[model] response``, with the weights of ``[model] weights``.

    Raises
    ------
    FitError
        Weights from standard errors or counts that some scores do not have.
    """
    if spec.model.weights == "equal":
        return ResponseScale.of(spec.model.response, data.scores)
    if spec.model.weights == "counts":
        _, trials = counts_of(data, 'weights = "counts"')
        columns, _ = block_columns(block_labels(spec, data))
        Z = np.hstack([QuadraticModel(spec.factors, spec.model.order).matrix(data.points), columns])
        return ResponseScale.of_counts(
            spec.model.response, data.scores, trials, expected_shares(Z, data.scores, trials)
        )
    if not np.all(data.score_se > 0.0):
        named = _run_list(data.run_ids[~(data.score_se > 0.0)])
        remedy = 'Give every score its standard error (column se), or set [model] weights = "equal".'
        raise FitError(Problem(f"{named} have no standard error for weighting", remedy))
    return ResponseScale.of(spec.model.response, data.scores, data.score_se)


def counts_of(data: ScoredRuns, what: str) -> tuple[FloatArray, FloatArray]:
    """Correct decisions and trials (n,) of every run, which ``what`` needs.

    Raises
    ------
    FitError
        Runs without counts.
    """
    known = np.zeros(len(data.scores), dtype=np.bool_)
    if data.trials is not None and data.correct is not None:
        known = np.isfinite(data.trials) & np.isfinite(data.correct)
    if data.trials is None or data.correct is None or not np.all(known):
        remedy = "Give the columns n and correct for every score, or omit that from [model]."
        raise FitError(Problem(f"{_run_list(data.run_ids[~known])} have no counts, which {what} needs", remedy))
    return data.correct, data.trials


def _run_list(ids: IntArray) -> str:
    shown = ", ".join(str(int(run)) for run in ids[:LISTED_RUNS])
    return f"runs {shown}" + (", ..." if len(ids) > LISTED_RUNS else "")


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
