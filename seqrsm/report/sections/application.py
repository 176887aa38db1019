"""All sections on one application: its findings, and how they were found; what ``seqrsm fit`` tells is both."""

from __future__ import annotations

from collections.abc import Sequence

from seqrsm.analysis.results import Analysis
from seqrsm.report.blocks import Section
from seqrsm.report.sections.history import history_section
from seqrsm.report.sections.model import diagnostics_section, importance_section, model_section
from seqrsm.report.sections.optimum import optimum_section, shape_section
from seqrsm.spec.read import CampaignSpec
from seqrsm.store.records import LookRecord


def application_sections(
    spec: CampaignSpec, looks: Sequence[LookRecord], analysis: Analysis, key: str
) -> tuple[Section, ...]:
    """Return the findings on one application.

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
        optimum_section(analysis, key, spec.stop),
        importance_section(analysis, key),
        history_section(spec, looks, analysis, key),
    )
    return tuple(section for section in sections if section is not None)


def method_sections(analysis: Analysis, key: str) -> tuple[Section, ...]:
    """Return how the findings on one application were found: model, shape, paths, diagnostics."""
    sections = (model_section(analysis, key), shape_section(analysis, key), diagnostics_section(analysis, key))
    return tuple(section for section in sections if section is not None)
