"""The report as data: from the dossier of a campaign to a tree of blocks that all faces render."""

from __future__ import annotations

from collections.abc import Iterable

import seqrsm
from seqrsm.campaign.dossier import Dossier
from seqrsm.report.blocks import Report, Section
from seqrsm.report.numbering import numbered
from seqrsm.report.profile import profile_text
from seqrsm.report.sections.application import application_sections, method_sections
from seqrsm.report.sections.candidates import candidate_section
from seqrsm.report.sections.compromise import compromise_section
from seqrsm.report.sections.data import question_section, run_section
from seqrsm.report.sections.literature import literature_section, printed_section
from seqrsm.report.sections.measure import measure_section
from seqrsm.report.sections.sources import (
    assumption_section,
    calendar_section,
    cover_section,
    image_section,
    provenance_section,
)
from seqrsm.report.sections.speed import speed_section
from seqrsm.report.sections.summary import has_one_result, result_section, summary_section


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
    spec, analyses, runs = dossier.spec, dossier.analyses, dossier.runs
    sections: list[Section | None] = [summary_section(spec, analyses, dossier.compromise, runs, dossier.rests)]
    methods: list[Section | None] = []
    alone = has_one_result(analyses, dossier.compromise)
    if dossier.compromise is not None:
        sections.append(compromise_section(spec.factors, dossier.compromise))
    for number, analysis in enumerate(analyses, 1):
        key = f"a{number}"
        parts: list[Section | None] = list(application_sections(spec, dossier.looks, analysis, key))
        parts.append(measure_section(analysis, dossier.events, f"{key}-measure"))
        how = method_sections(analysis, key)
        if alone:
            sections += parts
            methods += how
        else:
            parts.insert(
                0,
                result_section(
                    spec, analysis, runs, dossier.rests, f"{key}-result", "Optimum for this application alone"
                ),
            )
            sections.append(Section(key, f"Application {analysis.application}", (), _there(parts)))
            methods.append(Section(f"{key}-methods", f"Methods of {analysis.application}", (), how))
    sections += (
        candidate_section(dossier.candidates),
        calendar_section(dossier),
        image_section(dossier),
        literature_section(dossier),
        question_section(dossier),
        assumption_section(dossier),
    )
    methods += (
        speed_section(dossier),
        printed_section(dossier),
        cover_section(dossier),
        provenance_section(dossier),
        run_section(dossier) if runs else None,
    )
    appendix = Section("appendix", "Appendix: methods and all runs", (), _there(methods))
    return Report(
        title=f"Campaign {spec.name}",
        subtitle=spec.description or "Response surface, optimum and intervals of a sensor design",
        state=_state_text(dossier),
        version=seqrsm.__version__,
        sections=numbered((*(_on_new_page(_there(sections)) if alone else _there(sections)), appendix)),
        profiles=tuple(("" if len(analyses) == 1 else one.application, profile_text(one)) for one in analyses),
        byline=", ".join(text for text in (spec.author, spec.date) if text),
    )


def _there(sections: Iterable[Section | None]) -> tuple[Section, ...]:
    return tuple(section for section in sections if section is not None)


def _on_new_page(sections: tuple[Section, ...]) -> tuple[Section, ...]:
    """Let the section after the summary of one application start a page: the summary fills one."""
    summary, first, *rest = sections
    return (summary, Section(first.key, first.title, first.blocks, first.sections, new_page=True), *rest)


def _state_text(dossier: Dossier) -> str:
    """Which state of which campaign the report shows."""
    scored = sum(run.state == "scored" for run in dossier.runs)
    if not scored:
        return f"no score yet; specification {dossier.spec.spec_hash[:12]}"
    last = max(run.run_id for run in dossier.runs)
    return f"{scored} scored runs, up to run {last}; specification {dossier.spec.spec_hash[:12]}"
