"""The report as data: from the dossier of a campaign to a tree of blocks that both faces render."""

from __future__ import annotations

import seqrsm
from seqrsm.campaign.analysis import Analysis
from seqrsm.campaign.dossier import Dossier
from seqrsm.report.blocks import Report, Section
from seqrsm.report.section_compromise import compromise_section
from seqrsm.report.section_data import data_section, question_section, run_section
from seqrsm.report.section_history import history_section
from seqrsm.report.section_literature import literature_section
from seqrsm.report.section_model import diagnostics_section, importance_section, model_section
from seqrsm.report.section_optimum import optimum_section, posterior_section, surface_section
from seqrsm.report.section_sources import assumption_section, image_section, provenance_section
from seqrsm.report.section_study import location_section
from seqrsm.report.section_summary import summary_section


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
    sections = [summary_section(dossier), question_section(dossier), data_section(dossier)]
    for number, analysis in enumerate(dossier.analyses, 1):
        parts = _application_sections(dossier, analysis, f"a{number}")
        if len(dossier.analyses) == 1:
            sections += parts
        else:
            sections.append(Section(f"a{number}", f"Application {analysis.application}", (), parts, new_page=True))
    weighed = compromise_section(dossier)
    sections += [weighed] if weighed is not None else []
    images = image_section(dossier)
    sections += [images] if images is not None else []
    written = literature_section(dossier)
    sections += [written] if written is not None else []
    sections += [assumption_section(dossier), provenance_section(dossier)]
    if dossier.runs:
        sections.append(run_section(dossier))
    return Report(
        title=f"Campaign {dossier.spec.name}",
        subtitle="Response surface, optimum and intervals of a sensor design",
        state=_state_text(dossier),
        version=seqrsm.__version__,
        sections=(sections[0], *_on_new_page(sections[1:])),
    )


def _application_sections(dossier: Dossier, analysis: Analysis, key: str) -> tuple[Section, ...]:
    place = location_section(analysis, key)
    return (
        model_section(analysis, key),
        importance_section(analysis, key),
        optimum_section(analysis, key, dossier.spec.stop),
        *(() if place is None else (place,)),
        surface_section(analysis, key),
        posterior_section(analysis, key),
        history_section(dossier, analysis, key),
        diagnostics_section(analysis, key),
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
