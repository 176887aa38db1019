"""All sections on one application: its findings, and how they were found; what ``seqrsm fit`` tells is both."""

from __future__ import annotations

from collections.abc import Sequence

from seqrsm.analysis.results import Analysis
from seqrsm.report.blocks import Section
from seqrsm.report.sections.history import history_section
from seqrsm.report.sections.model import diagnostics_section, importance_section, model_section
from seqrsm.report.sections.optimum import optimum_section
from seqrsm.report.sections.shape import shape_section
from seqrsm.spec.read import CampaignSpec
from seqrsm.store.records import LookRecord


def application_sections(
    spec: CampaignSpec, looks: Sequence[LookRecord], analysis: Analysis, key: str
) -> tuple[Section, ...]:
    """Return the findings on one application; ``looks`` are of any, the keys of the sections begin with ``key``."""
    found = (optimum_section(analysis, key, spec.stop), importance_section(analysis, key))
    history = history_section(spec, looks, analysis, key)
    return found if history is None else (*found, history)


def method_sections(analysis: Analysis, key: str) -> tuple[Section, ...]:
    """Return how the findings on one application were found: model, shape, paths, diagnostics."""
    return model_section(analysis, key), shape_section(analysis, key), diagnostics_section(analysis, key)
