"""What an ingest tells its user in sentences."""

from __future__ import annotations

from collections.abc import Sequence

from seqrsm.score.flight import ScoresFile
from seqrsm.spec.read import CampaignSpec
from seqrsm.store.records import IngestedRun, IngestOutcome, RankingSummary


def file_messages(
    spec: CampaignSpec, file: ScoresFile, runs: Sequence[IngestedRun], outside: Sequence[int]
) -> list[str]:
    """Remarks on a file of scores by itself."""
    messages = outside_messages(outside)
    if file.unscored:
        messages.append(f"{len(file.unscored)} proposed runs of the file have no score yet.")
    if spec.model.block is not None and any(not run.block for run in runs):
        messages.append(f"Some rows say nothing in the block column '{spec.model.block}'.")
    for application in spec.applications:
        scores = [score.score for score in file.scores if score.application == application.name]
        if application.is_percent and len(scores) > 1 and 0.0 < max(scores) <= 1.0:
            messages.append(f"All scores of '{application.name}' are at most 1 percent: were fractions meant?")
    return messages


def outside_messages(outside: Sequence[int]) -> list[str]:
    """Settings outside the region."""
    if not outside:
        return []
    return [f"{len(outside)} scores lie outside the campaign's region (lines {_few(outside)}); they are kept."]


def outcome_messages(outcome: IngestOutcome) -> list[str]:
    """Remarks on what became of a file in the store."""
    if outcome.already is not None:
        name, at = outcome.already.name, outcome.already.ingested_at
        return [f"The same content was taken in already, as '{name}' at {at}: nothing done."]
    messages = []
    if outcome.moved:
        text = f"{len(outcome.moved)} proposed runs were carried out at other settings ({_few(outcome.moved)})"
        messages.append(f"{text}; both are kept.")
    if outcome.equal:
        lines = _few([row.line for row in outcome.equal])
        messages.append(
            f"{len(outcome.equal)} scores without a run id equal earlier ones in all that is told of them (lines "
            f"{lines}): they are taken for the same, and not doubled. A real repeat differs in a column such as date."
        )
    for row in outcome.equal:
        if row.state == "void":
            remedy = f"with run_id {row.run_id} it is taken in again"
            messages.append(f"Line {row.line} equals run {row.run_id}, which is void, and stays out; {remedy}.")
    for summary in outcome.ranked:
        messages += _ranking_messages(summary)
    return messages


def _ranking_messages(summary: RankingSummary) -> list[str]:
    count, who = summary.rankings, len(summary.interpreters)
    scored = f"{len(summary.scores)} runs their scores"
    messages = [f"{count} rankings of '{summary.application}' by {who} interpreters give {scored}."]
    if summary.apart:
        messages.append(
            f"No chain of rankings joins runs {_few(summary.apart)} with the others: they have no score until somebody "
            "ranks images of both together."
        )
    return messages


def _few(numbers: Sequence[int | None]) -> str:
    return ", ".join(str(number) for number in numbers[:10]) + (", ..." if len(numbers) > 10 else "")
