"""Fixtures of the report: dossiers of synthetic campaigns, made once."""

from __future__ import annotations

import pytest
from report_dossiers import flight_dossier, many_dossier, simulated_dossier

from seqrsm.campaign.dossier import Dossier


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
