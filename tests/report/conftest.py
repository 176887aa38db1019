"""Fixtures of the report: dossiers of synthetic campaigns and their reports, made once."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from report_dossiers import flight_dossier, many_dossier, simulated_dossier

from seqrsm.campaign.dossier import Dossier
from seqrsm.report.content import Report, build_report


@pytest.fixture(scope="session")
def built() -> Callable[[Dossier], Report]:
    """Reports of the dossiers below, each made once."""
    made: dict[int, Report] = {}

    def build(dossier: Dossier) -> Report:
        if id(dossier) not in made:
            made[id(dossier)] = build_report(dossier)
        return made[id(dossier)]

    return build


@pytest.fixture(scope="session")
def simulated(tmp_path_factory) -> Dossier:
    return simulated_dossier(tmp_path_factory.mktemp("simulated"))


@pytest.fixture(scope="session")
def flight(tmp_path_factory) -> Dossier:
    return flight_dossier(tmp_path_factory.mktemp("flight"))


@pytest.fixture(scope="session")
def many(tmp_path_factory) -> Dossier:
    return many_dossier(tmp_path_factory.mktemp("many"))


@pytest.fixture(scope="session")
def saturated(tmp_path_factory) -> Dossier:
    return many_dossier(tmp_path_factory.mktemp("saturated"), saturated=True)
