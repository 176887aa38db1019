"""Measured scores into the campaign: rows of a file are matched with proposed runs, all or nothing.

A row with a ``run_id`` is the score of that run; the settings of the row are kept beside the proposed ones. A row
without one becomes a new run: flights that nobody proposed and old data are welcome, and settings outside the region
are accepted with a remark. Rows that follow one another with the same settings and different applications are one run.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from seqrsm.campaign.records import FileRecord, IngestedRun, NewScore
from seqrsm.campaign.spec import CampaignSpec
from seqrsm.campaign.store import Store
from seqrsm.design.factors import CategoricalFactor
from seqrsm.errors import Problem, RegionError, ScoresFileError
from seqrsm.score.cells import FactorColumn, Measure
from seqrsm.score.flight import MeasuredScore, ScoresFile, read_scores


@dataclass(frozen=True, slots=True)
class IngestReport:
    """What was taken in, or would be.

    Attributes
    ----------
    file, sha256 : str
        Name without folder, and hash of the content.
    dry_run : bool
        Nothing was written.
    already : FileRecord or None
        The same content was taken in before: nothing was done.
    n_scores : int
        Scores in the file.
    matched, created, unchanged : tuple of int
        Runs that now have scores; new runs; runs that had exactly these scores already.
    replaced : tuple of (int, int)
        Void run and the new run in its place (also under ``created``).
    outside_region : tuple of int
        Lines whose settings lie outside the campaign's region.
    unscored : tuple of int
        Lines of proposed runs that have no score yet.
    messages : tuple of str
        The above in sentences.
    """

    file: str
    sha256: str
    dry_run: bool
    already: FileRecord | None = None
    n_scores: int = 0
    matched: tuple[int, ...] = ()
    created: tuple[int, ...] = ()
    unchanged: tuple[int, ...] = ()
    replaced: tuple[tuple[int, int], ...] = ()
    outside_region: tuple[int, ...] = ()
    unscored: tuple[int, ...] = ()
    messages: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """The report as JSON can hold it."""
        return asdict(self)


def ingest_file(store: Store, spec: CampaignSpec, path: Path | str, *, dry_run: bool = False) -> IngestReport:
    """Take a file of measured scores into the store.

    Parameters
    ----------
    store : Store
        Open.
    spec : CampaignSpec
        Its factors and applications name the columns.
    path : Path or str
        The file, see :mod:`seqrsm.score.flight`.
    dry_run : bool
        Check and report, write nothing.

    Raises
    ------
    ScoresFileError
        The file is wrong; nothing was changed.
    StoreError
        Rows that do not fit the runs of the campaign; nothing was changed.
    """
    columns = [
        FactorColumn(factor.name, levels=factor.levels)
        if isinstance(factor, CategoricalFactor)
        else FactorColumn(factor.name, factor.unit)
        for factor in spec.factors
    ]
    measures = [Measure(application.name, application.is_percent) for application in spec.applications]
    file = read_scores(path, columns, measures)
    already = store.find_file(file.sha256)
    if already is not None:
        message = f"The same content was taken in already, as '{already.name}' at {already.ingested_at}: nothing done."
        return IngestReport(file.name, file.sha256, dry_run, already, len(file.scores), messages=(message,))
    outside = _outside(spec, file)
    runs = _runs(spec, file)
    repeats = _look_like_repeats(store, runs)
    outcome = store.ingest_scores(runs, name=file.name, sha256=file.sha256, row_count=len(file.scores), dry_run=dry_run)
    report = IngestReport(
        file=file.name,
        sha256=file.sha256,
        dry_run=dry_run,
        n_scores=len(file.scores),
        matched=outcome.matched,
        created=outcome.created,
        unchanged=outcome.unchanged,
        replaced=outcome.replaced,
        outside_region=outside,
        unscored=file.unscored,
        messages=tuple(_messages(spec, file, runs, outside, repeats)),
    )
    return report


def _outside(spec: CampaignSpec, file: ScoresFile) -> tuple[int, ...]:
    """Lines outside the region; ScoresFileError for settings that have no place on a factor's scale at all."""
    lines, problems = [], []
    for score in file.scores:
        try:
            if not bool(spec.region.feasible(spec.region.code([score.settings]))[0]):
                lines.append(score.line)
        except RegionError as error:
            problems += [
                Problem(problem.message, problem.remedy, file.name, score.line, problem.field, problem.value)
                for problem in error.problems
            ]
    if problems:
        raise ScoresFileError(*problems)
    return tuple(lines)


def _block(spec: CampaignSpec, score: MeasuredScore) -> str:
    column = spec.model.block
    if column is None or column == "block":
        return score.block
    if column in ("source", "date", "note"):
        return str(getattr(score, column))
    return score.metadata.get(column, "")


def _runs(spec: CampaignSpec, file: ScoresFile) -> list[IngestedRun]:
    """Runs of the file: rows with the same run id, or neighbours with the same settings, are one run."""
    groups: list[list[MeasuredScore]] = []
    by_id: dict[int, list[MeasuredScore]] = {}
    problems: list[Problem] = []
    for score in file.scores:
        group = by_id.get(score.run_id) if score.run_id is not None else (groups[-1] if groups else None)
        if group is not None and _same_run(spec, group, score):
            group.append(score)
            continue
        if group is not None and score.run_id is not None:
            message = f"run {score.run_id} has other settings, block or source in line {group[0].line}"
            problems.append(Problem(message, "One run has one setting.", file.name, score.line, "run_id", score.run_id))
        groups.append([score])
        if score.run_id is not None:
            by_id.setdefault(score.run_id, groups[-1])
    if problems:
        raise ScoresFileError(*problems)
    return [_ingested(spec, file.name, group) for group in groups]


def _same_run(spec: CampaignSpec, group: Sequence[MeasuredScore], score: MeasuredScore) -> bool:
    first = group[0]
    return (
        score.run_id == first.run_id
        and score.settings == first.settings
        and _block(spec, score) == _block(spec, first)
        and (score.source, score.date) == (first.source, first.date)
        and all(score.application != other.application for other in group)
    )


def _ingested(spec: CampaignSpec, name: str, group: Sequence[MeasuredScore]) -> IngestedRun:
    first = group[0]
    scores = []
    for row in group:
        named = {key: text for key in ("date", "note") if (text := getattr(row, key))}
        metadata = {**row.metadata, **named}
        scores.append(NewScore(row.application, row.score, row.se, row.n, row.correct, metadata, name, row.line))
    cost = spec.cost.simulation if first.source == "simulation" else spec.cost.flight
    return IngestedRun(first.run_id, first.settings, first.source, _block(spec, first), cost, tuple(scores))


def _look_like_repeats(store: Store, runs: Sequence[IngestedRun]) -> int:
    """Rows without a run id that equal, to the last digit, a score that came from another file."""
    known = {
        (tuple(sorted(run.settings.items())), score.application, score.score)
        for run in store.runs(["scored"])
        for score in run.scores
        if score.source_file
    }
    return sum(
        (tuple(sorted(run.settings.items())), score.application, score.score) in known
        for run in runs
        if run.run_id is None
        for score in run.scores
    )


def _messages(
    spec: CampaignSpec, file: ScoresFile, runs: Sequence[IngestedRun], outside: Sequence[int], repeats: int
) -> list[str]:
    messages = []
    if outside:
        lines = ", ".join(str(line) for line in outside[:10]) + (", ..." if len(outside) > 10 else "")
        messages.append(f"{len(outside)} scores lie outside the campaign's region (lines {lines}); they are kept.")
    if file.unscored:
        messages.append(f"{len(file.unscored)} proposed runs of the file have no score yet.")
    if repeats:
        messages.append(
            f"{repeats} scores without a run id equal earlier ones to the last digit. If the file is an earlier one"
            " that has grown, void the doubles and give only the new rows next time."
        )
    if spec.model.block is not None and any(not run.block for run in runs):
        messages.append(f"Some rows say nothing in the block column '{spec.model.block}'.")
    return messages
