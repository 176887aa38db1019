"""The scored runs that a fit is made from: which they are, which belong together, and on which scale they count."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from seqrsm.analysis.scale import ResponseScale
from seqrsm.arrays import FloatArray, IntArray
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.errors import FitError, Problem, RegionError
from seqrsm.fit.estimability import SETTINGS_KNOWN
from seqrsm.fit.least_squares import block_columns
from seqrsm.spec.read import CampaignSpec, placed
from seqrsm.store.records import CONFIRMATION, RunRecord

_SAME_SETTING_DECIMALS = 9
LISTED_RUNS = 8


@dataclass(frozen=True, slots=True)
class ScoredRuns:
    """The runs that enter the fit, as arrays of length n."""

    run_ids: IntArray

    points: FloatArray
    """(n, k): executed settings, coded."""
    scores: FloatArray
    score_se: FloatArray
    """(n,): utility and its own standard error (nan where none was given), in score units."""
    sources: tuple[str, ...]
    blocks: tuple[str, ...]
    """Either "simulation" or "flight"; block label ("" where none)."""
    batches: IntArray

    purposes: tuple[str, ...]
    """As of `NewRun`."""
    trials: FloatArray | None = None
    correct: FloatArray | None = None
    """(n,): binomial counts; nan where none were given."""
    guess: float = np.nan
    perfect: float = np.nan
    """What a guess that looks at nothing scores, and perfect data, on average over the runs; nan where not known."""

    @property
    def all_equal(self) -> bool:
        """Whether all scores are equal, which leaves neither an optimum nor a scatter to be seen."""
        return float(np.ptp(self.scores)) == 0.0


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
        points=coded_settings(region, [run for run, _ in used]),
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


def see_names(spec: CampaignSpec, runs: Sequence[RunRecord], *applications: str) -> None:
    """Refuse applications (by default all) that seem to be renamed: new runs would be an initial design once more.

    FitError where no run has a score of one, and some have scores of a name that the campaign no longer has.
    """
    scored = dict.fromkeys(score.application for run in runs if run.state == "scored" for score in run.scores)
    others = [name for name in scored if name not in {one.name for one in spec.applications}]
    for k, name in enumerate(one.name for one in spec.applications):
        if others and name not in scored and (name in applications or not applications):
            message = f"no run has a score of '{name}'; runs have scores of {', '.join(map(repr, others))}"
            remedy = "Restore the name, ingest scores, or void those runs."
            raise FitError(placed(spec, Problem(message, remedy, field="application"), "application", k))


def coded_settings(region: Region, runs: Sequence[RunRecord]) -> FloatArray:
    """Settings (n, k) of runs, coded; RegionError names the runs with factors or levels that there are no longer."""
    if not runs:
        return np.empty((0, region.k))
    try:
        return region.code([run.settings for run in runs])
    except RegionError as error:
        groups: dict[tuple[str, str | None, object], list[int]] = {}
        for one in error.problems:
            groups.setdefault((one.message, one.field, one.value), []).append(runs[(one.line or 1) - 1].run_id)
        changed = "campaign.toml was changed since: restore the factor, or void these runs."
        told = changed, f"{changed} If the factor is new, ingest them again as exported, with its value filled in."
        raise RegionError(
            *(
                Problem(f"{_run_list(np.array(ids))}: {message}", told[value is None], field=name, value=value)
                for (message, name, value), ids in groups.items()
            )
        ) from None


def former_factors(region: Region, runs: Sequence[RunRecord], data: ScoredRuns) -> list[str]:
    """What to tell of settings in which the runs of a fit differ without a factor that accounts for it."""
    used, factors = set(data.run_ids.tolist()), set(region.names)
    found: dict[str, set[float | str]] = {}
    for run in runs:
        if run.run_id in used:
            for name in run.settings.keys() - factors:
                found.setdefault(name, set()).add(run.settings[name])
    return [
        f"The runs differ in {name}, which is no longer a factor: {_span(values)}. What it does to the score counts as "
        "scatter."
        for name, values in sorted(found.items())
        if len(values) > 1
    ]


def _span(values: set[float | str]) -> str:
    """The range of numbers; else the levels."""
    numbers = [value for value in values if not isinstance(value, str)]
    if len(numbers) == len(values):
        return f"{min(numbers):g} to {max(numbers):g}"
    return ", ".join(sorted(map(str, values)))


def n_determined(model: QuadraticModel, points: FloatArray, blocks: FloatArray | None = None) -> int:
    """Number of runs at coded ``points`` (n, k), or of the model's terms that they determine, if that is not all.

    Where columns of ``blocks`` (n, b) stand beside the terms, all must be determined together.
    """
    if not len(points):
        return 0
    Z, least = model.matrix(points), SETTINGS_KNOWN * np.sqrt(len(points))  # as in the fit
    all_columns = Z if blocks is None else np.hstack([Z, blocks])
    determined = np.linalg.matrix_rank(all_columns, least) == all_columns.shape[1]
    return len(points) if determined else int(np.linalg.matrix_rank(Z, least))


def n_fitted(spec: CampaignSpec, runs: Sequence[RunRecord]) -> int:
    """Scores that can be fitted, of the application that has the fewest: terms they determine, if that is not all."""
    scored = (scored_runs(spec.region, runs, one.name) for one in spec.applications)
    return min(n_determined(spec.quadratic, data.points, block_columns(block_labels(spec, data))[0]) for data in scored)


def _mean_of(values: Sequence[float | None]) -> float:
    """Mean of those that are known; nan where none is."""
    known = [float(value) for value in values if value is not None]
    return sum(known) / len(known) if known else float("nan")


def _counts(values: Sequence[int | None]) -> FloatArray:
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)


def setting_ids(points: FloatArray) -> list[tuple[float, ...]]:
    """Equal for equal executed settings; coded points (n, k) compared to 1e-9 of half a factor's range."""
    return [tuple(row) for row in np.round(points, _SAME_SETTING_DECIMALS) + 0.0]


NO_BLOCK: Final = "none"
"""Label of runs that name no block: where others do, a block of their own."""


def block_labels(spec: CampaignSpec, data: ScoredRuns) -> list[str]:
    """Block of each run: the flight day, where ``[model] block`` asks for it, and the source where there are two."""
    source_too = len(set(data.sources)) > 1
    found = []
    for source, block in zip(data.sources, data.blocks, strict=True):
        parts = (source if source_too else "", block if spec.model.block is not None else "")
        found.append(" ".join(part for part in parts if part))
    return [label or NO_BLOCK for label in found]


def response_scale(spec: CampaignSpec, data: ScoredRuns) -> ResponseScale:
    """Scores on the scale of ``[model] response``, with the weights of ``[model] weights``.

    FitError where these are from standard errors or counts that some scores do not have.
    """
    columns, _ = block_columns(block_labels(spec, data))
    Z = np.hstack([spec.quadratic.matrix(data.points), columns])
    if not len(data.scores):  # the fit says what is missing
        return ResponseScale.of("identity", data.scores, Z)
    if spec.of_counts:
        needs = f'errors = "{spec.errors.name}"' if spec.errors.of_counts else 'weights = "counts"'
        _, trials = counts_of(data, needs)
        return ResponseScale.of_counts(spec.model.response, data.scores, trials, Z)
    if spec.model.weights == "equal":
        return ResponseScale.of(spec.model.response, data.scores, Z)
    if not np.all(data.score_se > 0.0):
        named = _run_list(data.run_ids[~(data.score_se > 0.0)])
        remedy = 'Give every score its standard error (column se), or set [model] weights = "equal".'
        raise FitError(f"{named} without a standard error for weighting", remedy)
    return ResponseScale.of(spec.model.response, data.scores, Z, data.score_se)


def counts_of(data: ScoredRuns, what: str) -> tuple[FloatArray, FloatArray]:
    """Correct decisions and trials (n,) of every run, which ``what`` needs; FitError of runs without counts."""
    known = np.zeros(len(data.scores), dtype=np.bool_)
    if data.trials is not None and data.correct is not None:
        known = np.isfinite(data.trials) & np.isfinite(data.correct)
    if data.trials is None or data.correct is None or not np.all(known):
        remedy = "Give the columns n and correct for every score, or omit that from [model]."
        raise FitError(f"{_run_list(data.run_ids[~known])} without counts, which {what} needs", remedy)
    return data.correct, data.trials


def _run_list(ids: IntArray) -> str:
    shown = ", ".join(str(int(run)) for run in ids[:LISTED_RUNS])
    return f"run{'s' * (len(ids) > 1)} {shown}" + (", ..." if len(ids) > LISTED_RUNS else "")
