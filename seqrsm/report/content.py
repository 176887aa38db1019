"""The report as data: from the dossier of a campaign to a tree of blocks that both faces render."""

from __future__ import annotations

from typing import TypeVar

import seqrsm
from seqrsm.analysis.results import Analysis
from seqrsm.campaign.dossier import Dossier
from seqrsm.progress import tell
from seqrsm.report.blocks import Report, Section
from seqrsm.report.sections.compromise import compromise_section
from seqrsm.report.sections.data import data_section, question_section, run_section
from seqrsm.report.sections.history import history_section
from seqrsm.report.sections.literature import literature_section
from seqrsm.report.sections.model import diagnostics_section, importance_section, model_section
from seqrsm.report.sections.optimum import optimum_section, posterior_section, surface_section
from seqrsm.report.sections.sources import assumption_section, image_section, provenance_section
from seqrsm.report.sections.speed import speed_section
from seqrsm.report.sections.study import location_section
from seqrsm.report.sections.summary import summary_section

_Made = TypeVar("_Made", bound=Section | None)


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
    told = _Teller(9 + 8 * len(dossier.analyses))
    sections = [told(summary_section(dossier)), told(question_section(dossier)), told(data_section(dossier))]
    for number, analysis in enumerate(dossier.analyses, 1):
        parts = _application_sections(dossier, analysis, f"a{number}", told)
        if len(dossier.analyses) == 1:
            sections += parts
        else:
            sections.append(Section(f"a{number}", f"Application {analysis.application}", (), parts, new_page=True))
    last = (
        told(compromise_section(dossier)),
        told(image_section(dossier)),
        told(speed_section(dossier)),
        told(literature_section(dossier)),
        told(assumption_section(dossier)),
        told(provenance_section(dossier)),
        told(run_section(dossier) if dossier.runs else None),
    )
    sections += [section for section in last if section is not None]
    return Report(
        title=f"Campaign {dossier.spec.name}",
        subtitle="Response surface, optimum and intervals of a sensor design",
        state=_state_text(dossier),
        version=seqrsm.__version__,
        sections=(sections[0], *_on_new_page(sections[1:])),
    )


class _Teller:
    """Passes sections on and tells how many of them there are so far."""

    def __init__(self, total: int) -> None:
        self._done, self._total = 0, total

    def __call__(self, section: _Made) -> _Made:
        self._done += 1
        tell("drawing", self._done, self._total)
        return section


def _application_sections(dossier: Dossier, analysis: Analysis, key: str, told: _Teller) -> tuple[Section, ...]:
    model, importance = told(model_section(analysis, key)), told(importance_section(analysis, key))
    best, place = told(optimum_section(analysis, key, dossier.spec.stop)), told(location_section(analysis, key))
    return (
        model,
        importance,
        best,
        *(() if place is None else (place,)),
        told(surface_section(analysis, key)),
        told(posterior_section(analysis, key)),
        told(history_section(dossier, analysis, key)),
        told(diagnostics_section(analysis, key)),
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
