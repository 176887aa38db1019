"""The report as data: from the dossier of a campaign to a tree of blocks that all faces render."""

from __future__ import annotations

import seqrsm
from seqrsm.campaign.dossier import Dossier
from seqrsm.report.blocks import Report, Section
from seqrsm.report.sections.application import application_sections
from seqrsm.report.sections.candidates import candidate_section
from seqrsm.report.sections.compromise import compromise_section
from seqrsm.report.sections.data import data_section, question_section, run_section
from seqrsm.report.sections.literature import literature_section
from seqrsm.report.sections.measure import measure_section
from seqrsm.report.sections.sources import (
    assumption_section,
    calendar_section,
    image_section,
    provenance_section,
)
from seqrsm.report.sections.speed import speed_section
from seqrsm.report.sections.summary import summary_section


def build_report(dossier: Dossier) -> Report:
    """Build the report of a campaign.

    Parameters
    ----------
    dossier : Dossier
        The campaign as it stands.

    Returns
    -------
    Report
        The same for the same campaign and seed: it carries no time of day, neither of its making nor of a score.
    """
    spec, analyses = dossier.spec, dossier.analyses
    sections = [
        summary_section(spec, analyses, dossier.compromise, dossier.runs, dossier.rests),
        question_section(dossier),
        data_section(dossier),
    ]
    for number, analysis in enumerate(analyses, 1):
        parts = application_sections(spec, dossier.looks, analysis, f"a{number}")
        measure = measure_section(analysis, dossier.events, f"a{number}-measure")
        parts = parts if measure is None else (*parts, measure)
        if len(analyses) == 1:
            sections += parts
        else:
            sections.append(Section(f"a{number}", f"Application {analysis.application}", (), parts, new_page=True))
    last = (
        None if dossier.compromise is None else compromise_section(spec.factors, dossier.compromise),
        candidate_section(dossier.candidates),
        calendar_section(dossier),
        image_section(dossier),
        speed_section(dossier),
        literature_section(dossier),
        assumption_section(dossier),
        provenance_section(dossier),
        run_section(dossier) if dossier.runs else None,
    )
    sections += [section for section in last if section is not None]
    return Report(
        title=f"Campaign {dossier.spec.name}",
        subtitle="Response surface, optimum and intervals of a sensor design",
        state=_state_text(dossier),
        version=seqrsm.__version__,
        sections=(sections[0], *_on_new_page(sections[1:])),
    )


def _on_new_page(sections: list[Section]) -> tuple[Section, ...]:
    """Let the section after the summary start a page, so that the summary is a page of its own."""
    first, *rest = sections
    return (Section(first.key, first.title, first.blocks, first.sections, new_page=True), *rest)


def _state_text(dossier: Dossier) -> str:
    """Which state of which campaign the report shows."""
    scored = sum(run.state == "scored" for run in dossier.runs)
    if not scored:
        return f"no score yet; specification {dossier.spec.spec_hash[:12]}"
    last = max(run.run_id for run in dossier.runs)
    return f"{scored} scored runs, up to run {last}; specification {dossier.spec.spec_hash[:12]}"
