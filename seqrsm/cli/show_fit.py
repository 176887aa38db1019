"""What was found in the scores, on the terminal: the sections of the report, the summary last."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from seqrsm.cli.blocks import show_blocks, show_sections
from seqrsm.cli.console import heading, line
from seqrsm.report.sections.application import application_sections
from seqrsm.report.sections.compromise import compromise_section
from seqrsm.report.sections.model import importance_section
from seqrsm.report.sections.study import term_test_table
from seqrsm.report.sections.summary import summary_section

if TYPE_CHECKING:
    from seqrsm.analysis.compromise import CompromiseEstimate
    from seqrsm.analysis.results import Analysis
    from seqrsm.analysis.study import TermTest
    from seqrsm.campaign.campaign import Campaign
    from seqrsm.campaign.loop import Outcome


def show_fit(
    campaign: Campaign,
    analyses: Sequence[Analysis],
    tests: Sequence[Sequence[TermTest]],
    compromise: CompromiseEstimate | None,
) -> None:
    """Everything `seqrsm fit` has to say; ``tests`` are those that were asked for of each analysis."""
    spec, looks = campaign.spec, campaign.store.looks()
    for analysis, asked in zip(analyses, tests, strict=True):
        if len(analyses) > 1:
            heading(f"Application {analysis.application}")
        show_sections(application_sections(spec, looks, analysis, ""))
        if asked:
            line()
            show_blocks([term_test_table(asked)])
    if compromise is not None:
        show_sections([compromise_section(spec.factors, compromise)])
    # What the applications give up is said above.
    show_sections([summary_section(spec, analyses, None, campaign.store.runs())])


def show_outcome(campaign: Campaign, outcome: Outcome) -> None:
    """End of `seqrsm run`: importance, recommendation, intervals, reasons, time split."""
    show_sections(importance_section(analysis, "") for analysis in outcome.analyses)
    show_sections([summary_section(campaign.spec, outcome.analyses, outcome.compromise, campaign.store.runs())])
    line()
    if not outcome.held:
        line("Stopped for futility." if outcome.futile else "The budget ended the campaign.")
    split = ", ".join(f"{stage} {seconds:.1f} s" for stage, seconds in outcome.seconds.items())
    line(f"{outcome.n_scored} runs scored in all; time: {split}")
