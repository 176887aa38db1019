"""The report as data: from the dossier of a campaign to a tree of blocks that both faces render."""

from __future__ import annotations

from datetime import UTC, datetime

import seqrsm
from seqrsm.campaign.analysis import Analysis
from seqrsm.campaign.dossier import Dossier
from seqrsm.report.blocks import Report, Section
from seqrsm.report.section_data import data_section, question_section
from seqrsm.report.section_history import history_section
from seqrsm.report.section_model import diagnostics_section, importance_section, model_section
from seqrsm.report.section_optimum import optimum_section, posterior_section, surface_section
from seqrsm.report.section_sources import assumption_section, image_section, provenance_section
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
        The same for the same dossier: it carries the time of the last score, not that of its making.
    """
    sections = [summary_section(dossier), question_section(dossier), data_section(dossier)]
    for number, analysis in enumerate(dossier.analyses, 1):
        parts = _application_sections(dossier, analysis, f"a{number}")
        if len(dossier.analyses) == 1:
            sections += parts
        else:
            sections.append(Section(f"a{number}", f"Application {analysis.application}", (), parts, new_page=True))
    images = image_section(dossier)
    sections += [images] if images is not None else []
    sections += [assumption_section(dossier), provenance_section(dossier)]
    timestamp = last_score_time(dossier)
    return Report(
        title=f"Campaign {dossier.spec.name}",
        subtitle="Response surface, optimum and intervals of a sensor design",
        timestamp=timestamp,
        date=_date_text(timestamp),
        version=seqrsm.__version__,
        sections=(sections[0], *_on_new_page(sections[1:])),
    )


def _application_sections(dossier: Dossier, analysis: Analysis, key: str) -> tuple[Section, ...]:
    return (
        model_section(analysis, key),
        importance_section(analysis, key),
        optimum_section(analysis, key, dossier.spec.stop),
        surface_section(analysis, key),
        posterior_section(analysis, key),
        history_section(dossier, analysis, key),
        diagnostics_section(analysis, key),
    )


def _on_new_page(sections: list[Section]) -> tuple[Section, ...]:
    """Let the section after the summary start a page, so that the summary is a page of its own."""
    first, *rest = sections
    return (Section(first.key, first.title, first.blocks, first.sections, new_page=True), *rest)


def last_score_time(dossier: Dossier) -> int:
    """Time of the last score [s since 1970-01-01 UTC]; 0 where there is none."""
    moments = [_seconds(score.scored_at) for run in dossier.runs for score in run.scores]
    return max(moments, default=0)


def _seconds(text: str) -> int:
    moment = datetime.fromisoformat(text)
    return int((moment if moment.tzinfo is not None else moment.replace(tzinfo=UTC)).timestamp())


def _date_text(timestamp: int) -> str:
    if timestamp == 0:
        return "no score yet"
    return f"last score {datetime.fromtimestamp(timestamp, UTC):%Y-%m-%d %H:%M} UTC"
