"""Measured scores into the campaign: rows of a file are matched with proposed runs, all or nothing.

A row with a ``run_id`` is the score of that run; the settings of the row are kept beside the proposed ones. In a file
without any settings these are those of the runs. A row without one becomes a new run: flights that nobody proposed and
old data are welcome, and settings outside the region are accepted with a remark. Rows of one file with the same
settings, block and date and of different applications are one run. Rows that say what an earlier file has said already
are recognised, with or without run id, and never doubled. A file with the columns ``interpreter`` and ``rank`` holds
rankings, from which scores follow.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from seqrsm.campaign.export import factor_columns
from seqrsm.campaign.guards import block_of, is_moved, ranking_suspects, see_meaning, suspects
from seqrsm.errors import Problem, RegionError, ScoresFileError
from seqrsm.plain import counted, few, lines_of, shallow
from seqrsm.score.cells import Measure
from seqrsm.score.flight import MeasuredScore, ScoresFile, read_scores
from seqrsm.score.ranking_file import is_rankings_file, read_rankings
from seqrsm.score.table import TableSource, TableText, table_text
from seqrsm.spec.read import CampaignSpec
from seqrsm.store.records import IngestedFile, IngestedRun, IngestOutcome, NewScore, RankingSummary, RunRecord, Settings
from seqrsm.store.store import Store


@dataclass(frozen=True, slots=True, kw_only=True)
class IngestReport(IngestOutcome):
    """What was taken in, or would be: what became of the rows in the store, and what is known of the file."""

    file: str
    sha256: str
    """Name without folder, and SHA-256 of the bytes."""
    dry_run: bool
    """Nothing was written."""
    n_scores: int = 0
    """Scores, or ranks, in the file."""
    outside_region: tuple[int, ...] = ()
    """Lines whose settings lie outside the campaign's region."""
    unscored: tuple[int, ...] = ()
    """Lines that have no score yet."""
    messages: tuple[str, ...] = ()
    """The above in sentences."""


_AGAINST = -0.3  # agreement: of two rankings of a dozen images by a guess two standard deviations
_Read = tuple[IngestedFile, tuple[int, ...], tuple[int, ...], list[str], ScoresFile | None]
"""A file on its way into the store; lines outside the region; lines without score; remarks; what was read of scores."""


def ingest_files(
    store: Store, spec: CampaignSpec, sources: Sequence[TableSource], *, dry_run: bool = False, accept: bool = False
) -> tuple[IngestReport, ...]:
    """Take files or tables of measured scores or rankings into the store, in order; all of them or none.

    ``sources`` are files or tables, see :mod:`seqrsm.score.table`; what stands in them: :mod:`seqrsm.score.flight` and
    :mod:`seqrsm.score.ranking_file`; factors and applications of the specification name their columns. ``dry_run``:
    check and report, write nothing. ``accept``: take in also what looks wrong, see `seqrsm.campaign.guards`.

    ScoresFileError where a file is wrong, or something in it looks wrong and is not accepted; StoreError or SpecError
    of rows that do not fit the runs of the campaign, or runs that do not fit its region. Nothing was changed then.
    """
    runs = store.runs()
    see_meaning(store, spec, runs)
    read: list[_Read] = []
    problems: list[Problem] = []
    only_ranked = all(one.utility == "rank" for one in spec.applications)
    for source in sources:
        try:
            text = table_text(source)
            ranks = is_rankings_file(text, only_ranked)
            read.append(_read_rankings(spec, text) if ranks else _read_scores(spec, text, runs))
        except ScoresFileError as error:
            problems += error.problems
    if problems:
        raise ScoresFileError(*problems)
    if not accept:
        _hold_back(store, spec, read)
    outcomes = store.ingest_files([file for file, *_ in read], dry_run=dry_run)
    return tuple(_report(one, outcome, dry_run) for one, outcome in zip(read, outcomes, strict=True))


def _hold_back(store: Store, spec: CampaignSpec, read: Sequence[_Read]) -> None:
    """ScoresFileError where rows look wrong that the store does not have already."""
    runs, files, stored = store.runs(), [one[-1] for one in read], store.rankings()
    problems = [problem for ingested, *_ in read for problem in ranking_suspects(ingested, stored)]
    if not any(one is None or suspects(spec, one, runs) for one in files):
        return
    outcomes = store.ingest_files([one[0] for one in read], dry_run=True)
    for summary in {one.application: one for outcome in outcomes for one in outcome.ranked}.values():
        ranked = (run for run in runs if run.state == "scored" and run.score_of(summary.application) is not None)
        lost = [run.run_id for run in ranked if run.run_id in summary.apart]
        if lost:
            what = f"run{'s' * (len(lost) > 1)} {few(lost)} would lose their scores of '{summary.application}'"
            message = f"{what}: no chain of rankings joins them with the others"
            problems.append(Problem(message, "Rank some of their images together with the others.", read[-1][0].name))
    for file, outcome in zip(files, outcomes, strict=True):
        if file is not None and outcome.already is None:
            equal = {row.line for row in outcome.equal}
            known = {run.run_id: run for run in runs if run.run_id in outcome.unchanged}
            new = (
                row
                for row in file.scores
                if row.line not in equal and (row.run_id not in known or is_moved(spec, row, known[row.run_id]))
            )
            again = {row.run_id for row in outcome.equal}
            others = [run for run in runs if run.run_id not in again]
            problems += suspects(spec, replace(file, scores=tuple(new)), others)
    if problems:
        message = "nothing was ingested: the rows listed above look wrong"
        remedy = "Correct them, or ingest everything as it is with --accept (accept=True in Python)."
        raise ScoresFileError(*problems, Problem(message, remedy))


def _report(read: _Read, outcome: IngestOutcome, dry_run: bool) -> IngestReport:
    file, outside, unscored, remarks, _ = read
    new = outcome.already is None
    return IngestReport(
        **shallow(outcome),
        file=file.name,
        sha256=file.sha256,
        dry_run=dry_run,
        n_scores=file.row_count,
        outside_region=outside if new else (),
        unscored=unscored if new else (),
        messages=(*(remarks if new else ()), *outcome_messages(outcome)),
    )


def _read_scores(spec: CampaignSpec, text: TableText, runs: Sequence[RunRecord]) -> _Read:
    measures = [Measure(one.name, one.is_percent, one.score_unit) for one in spec.applications]
    recorded = {run.run_id: run.settings for run in runs}
    file = read_scores(text, factor_columns(spec.factors), measures, spec.model.block or "block", recorded)
    for score in file.scores:
        if spec.application(score.application).utility == "rank":
            message, remedy = (f"the scores of '{score.application}' come from rankings", "Give rankings.")
            raise ScoresFileError(message, remedy, file=file.name, line=score.line, field="score")
    outside = _outside(spec, file.name, {score.line: score.settings for score in file.scores})
    ingested = IngestedFile(file.name, file.sha256, len(file.scores), tuple(_runs(spec, file, frozenset(outside))))
    remarks = ["No settings are given: those of the runs named are taken."] if file.bare else []
    return ingested, outside, file.unscored, [*remarks, *_remarks(outside, file.unscored)], file


def _read_rankings(spec: CampaignSpec, text: TableText) -> _Read:
    ranked = [application for application in spec.applications if application.utility == "rank"]
    name = text.name
    if not ranked:
        message = "these are rankings, but no application of the campaign uses rankings"
        raise ScoresFileError(message, 'Set utility = "rank" for one, or provide scores.', file=name)
    for application in ranked:
        if application.goal != "maximize":
            message = f"scores from rankings grow with worth, and the goal of '{application.name}' is \"minimize\""
            raise ScoresFileError(message, 'Rank 1 is the best image: set goal = "maximize".', file=name)
    rankings = read_rankings(text, factor_columns(spec.factors), [Measure(application.name) for application in ranked])
    images = [image for ranking in rankings for image in ranking.images]
    outside = _outside(spec, name, {im.line: im.settings for im in images if im.settings is not None})
    ingested = IngestedFile(name, text.sha256, len(images), rankings=rankings)
    return ingested, outside, (), _remarks(outside), None


def _outside(spec: CampaignSpec, name: str, settings: Mapping[int, Settings]) -> tuple[int, ...]:
    """Lines outside the region; ScoresFileError for settings that have no place on a factor's scale at all."""
    lines, problems = [], []
    for line, values in settings.items():
        try:
            if not bool(spec.region.feasible(spec.region.code([values]))[0]):
                lines.append(line)
        except RegionError as error:
            problems += [replace(problem, file=name, line=line) for problem in error.problems]
    if problems:
        raise ScoresFileError(*problems)
    return tuple(lines)


def _runs(spec: CampaignSpec, file: ScoresFile, outside: frozenset[int]) -> list[IngestedRun]:
    """Runs of the file: rows of different applications with the same run id, or alike and without one, are one run.

    Of runs that are alike the one in the line above is completed first, then the earliest without a score of the
    application: a table may list all scores of one application after those of another.
    """
    groups: list[list[MeasuredScore]] = []
    by_id: dict[int, list[MeasuredScore]] = {}
    alike: dict[object, list[list[MeasuredScore]]] = {}
    complete: dict[object, int] = {}  # how many of them, from the first on, have a score of the application
    problems: list[Problem] = []
    for score in file.scores:
        kind = _kind(spec, score)
        if score.run_id is not None:
            group = by_id.get(score.run_id)
        elif groups and _lacks(groups[-1], score) and _kind(spec, groups[-1][0]) == kind:
            group = groups[-1]
        else:
            equal, key = alike.setdefault(kind, []), (kind, score.application)
            while (n := complete.get(key, 0)) < len(equal) and not _lacks(equal[n], score):
                complete[key] = n + 1
            group = equal[n] if n < len(equal) else None
        if group is not None and _lacks(group, score) and _kind(spec, group[0]) == kind:
            group.append(score)
            continue
        if group is not None:
            message = f"run {score.run_id} has other settings, block or source in line {group[0].line}"
            problems.append(Problem(message, "One run has one setting.", file.name, score.line, "run_id", score.run_id))
        groups.append([score])
        if score.run_id is None:
            alike[kind].append(groups[-1])
        else:
            by_id.setdefault(score.run_id, groups[-1])
    if problems:
        raise ScoresFileError(*problems)
    return [_ingested(spec, file.name, group, outside) for group in groups]


def _kind(spec: CampaignSpec, score: MeasuredScore) -> object:
    """What the rows of one run have in common."""
    settings = tuple(sorted(score.settings.items()))
    return score.run_id, settings, block_of(spec, score), score.source, score.date


def _lacks(group: Sequence[MeasuredScore], score: MeasuredScore) -> bool:
    return all(score.application != other.application for other in group)


def _ingested(spec: CampaignSpec, name: str, group: Sequence[MeasuredScore], outside: frozenset[int]) -> IngestedRun:
    first = group[0]
    scores = []
    for row in group:
        named = {key: text for key in ("date", "note") if (text := getattr(row, key))}
        metadata: dict[str, Any] = {**row.metadata, **named}
        if row.line in outside:
            metadata["outside_region"] = True
        scores.append(NewScore(row.application, row.score, row.se, row.n, row.correct, metadata, name, row.line))
    cost, block = spec.cost.of(first.source), block_of(spec, first)
    return IngestedRun(first.run_id, first.settings, first.source, block, cost, tuple(scores))


def _remarks(outside: Sequence[int], unscored: Sequence[int] = ()) -> list[str]:
    """Lines with settings outside the region, and lines without a score."""
    found = []
    if outside:
        found.append(f"Scores kept although outside the campaign's region ({lines_of(outside)}): {len(outside)}.")
    if unscored:
        rows = counted(len(unscored), "row has", "rows have")
        found.append(f"{rows} no score yet and may be ingested later ({lines_of(unscored)}).")
    return found


def outcome_messages(outcome: IngestOutcome) -> list[str]:
    """Remarks on what became of a file in the store."""
    if outcome.already is not None:
        name, at = outcome.already.name, outcome.already.ingested_at
        return [f"The same content was ingested before, as '{name}' at {at}: nothing done."]
    messages = []
    if outcome.replaced:
        old, new = zip(*outcome.replaced, strict=True)
        one, many = "Run {} takes the place of run {}, which is", "Runs {} take the places of runs {}, which are"
        messages.append(f"{(one if len(old) == 1 else many).format(few(new), few(old))} void.")
    if outcome.moved:
        count = f"{counted(len(outcome.moved), 'proposed run')} {'was' if len(outcome.moved) == 1 else 'were'}"
        messages.append(f"{count} made at other settings ({few(outcome.moved)}); both are kept.")
    if outcome.equal:
        lines = lines_of([row.line for row in outcome.equal])
        messages.append(
            f"{counted(len(outcome.equal), 'score')} without a run id not counted twice, equal to earlier scores in "
            f"every column that both have ({lines}). A true repeat must differ in a column such as date."
        )
    for row in outcome.equal:
        if row.state == "void":
            remedy = f"with run_id {row.run_id} and --accept it is taken in again"
            messages.append(f"Line {row.line} equals run {row.run_id}, which is void, and stays out; {remedy}.")
    for summary in outcome.ranked:
        messages += ranking_messages(summary)
    return messages


def ranking_messages(summary: RankingSummary) -> list[str]:
    """What an application's rankings say, and what its scores mean."""
    count = f"{counted(summary.rankings, 'ranking')} of '{summary.application}' by"
    count += f" {counted(len(summary.interpreters), 'interpreter')} {'gives' if summary.rankings == 1 else 'give'}"
    messages = [
        f"{count} {counted(len(summary.scores), 'run')} their scores, in logits: of "
        "two images whose scores differ by d, the better is preferred with probability 1 / (1 + exp(-d)). Zero is the "
        "mean of the first batch."
    ]
    if summary.scale_se > 0.0:
        factor = f"{math.exp(1.96 * summary.scale_se):.2g}"
        messages.append(
            f"Their common scale is known to within a factor of about {factor}, which no interval includes."
        )
    against = ", ".join(one.interpreter for one in summary.interpreters if (one.agreement or 0.0) < _AGAINST)
    if against:
        messages.append(
            f"Ranked against the scores by {against}: is 1 the rank of the best image? If not, void these rankings "
            "and ingest them the other way round."
        )
    if summary.apart:
        messages.append(
            f"No chain of rankings joins runs {few(summary.apart)} with the others: they have no score until somebody "
            "ranks images of both together."
        )
    return messages
