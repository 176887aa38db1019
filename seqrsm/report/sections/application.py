"""All sections on one application: what the report holds between its common parts, and what ``seqrsm fit`` tells."""

from __future__ import annotations

from collections.abc import Sequence

from seqrsm.analysis.results import Analysis
from seqrsm.report.blocks import Section
from seqrsm.report.sections.history import history_section
from seqrsm.report.sections.model import diagnostics_section, importance_section, model_section
from seqrsm.report.sections.optimum import optimum_section, posterior_section, surface_section
from seqrsm.report.sections.study import location_section
from seqrsm.spec.read import CampaignSpec
from seqrsm.store.records import LookRecord


def application_sections(
    spec: CampaignSpec, looks: Sequence[LookRecord], analysis: Analysis, key: str
) -> tuple[Section, ...]:
    """Return the sections on one application.

    Parameters
    ----------
    spec : CampaignSpec
    looks : sequence of LookRecord
        Of any application of the campaign.
    analysis : Analysis
    key : str
        With which the keys of the sections begin.
    """
    sections = (
        model_section(analysis, key),
        importance_section(analysis, key),
        optimum_section(analysis, key, spec.stop),
        location_section(analysis, key),
        surface_section(analysis, key),
        posterior_section(analysis, key),
        history_section(spec, looks, analysis, key),
        diagnostics_section(analysis, key),
    )
    return tuple(section for section in sections if section is not None)
