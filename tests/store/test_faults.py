"""Each command, killed or met by an error at some of its operations; at all of them: tests/studies/hands_study.py."""

from __future__ import annotations

import sys

import pytest
from faults import CASES, ERRORS, KILL, SERVER_HOWS, injected, prepared
from interleaving import without_engine

pytestmark = [
    pytest.mark.usefixtures("few_draws"),
    pytest.mark.skipif(sys.platform == "win32", reason="forks"),
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
]


@pytest.mark.parametrize("name", CASES)
def test_a_command_that_fails_at_any_operation_ends_as_one_that_did_not(tmp_path, monkeypatch, name):
    without_engine(monkeypatch)
    prepared(name, tmp_path)
    hows = [KILL, *ERRORS]
    met = [injected(name, tmp_path, 3 + 11 * k, hows[k % len(hows)]) for k in range(4)]
    assert met[0]


@pytest.mark.parametrize("name", ["run", "propose", "ingest", "void"])
def test_a_server_that_fails_a_command_anywhere_loses_and_doubles_nothing(tmp_path, monkeypatch, name, postgres):
    without_engine(monkeypatch)
    prepared(name, tmp_path, postgres)
    # Statements of opening and reading, and those of a change with its commit, by turns.
    met = [injected(name, tmp_path, 5 + 7 * k, SERVER_HOWS[(k + len(name)) % 4], postgres) for k in range(4)]
    assert met[0]
