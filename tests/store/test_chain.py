"""What is changed behind the program's back is told, and which run it is."""

from __future__ import annotations

import pytest
import sqlalchemy as sa
from held import hold

from seqrsm.errors import StoreError
from seqrsm.store.records import IngestedFile, IngestedRun, NewRun, NewScore
from seqrsm.store.store import Store


@pytest.fixture
def filled(store):
    ids = store.add_batch([NewRun({"x": float(i)}, "start") for i in range(4)])
    hold(store, ids[:1])
    store.record_scores(ids[0], [NewScore("a", 50.0, 2.0, metadata={"cells": 3})])
    store.fail(ids[1], "no memory", "machine")
    store.void(ids[2], "clouds")
    flown = IngestedRun(
        ids[3], {"x": 3.5}, "flight", "day 1", 9.0, (NewScore("a", 7.0, source_file="f", source_row=2),)
    )
    new = IngestedRun(None, {"x": 0.5}, "flight", "day 2", 9.0, (NewScore("a", 8.0, source_file="f", source_row=3),))
    store.ingest_files([IngestedFile("f", "0", 2, (flown, new))])
    store.record_look(2, "a", {"half_width": 2.5})
    store.verify()
    return store


@pytest.mark.parametrize(
    ("statement", "says"),
    [
        ("UPDATE scores SET score = 51 WHERE run_id = 1", "score of run 1 for 'a' is not the one"),
        ("UPDATE scores SET se = NULL WHERE run_id = 1", "score of run 1"),
        ("UPDATE scores SET metadata = '{\"cells\": 4}' WHERE run_id = 1", "score of run 1"),
        ("DELETE FROM scores WHERE run_id = 5", "run 5 has lost its score"),
        ("UPDATE runs SET proposed = '{\"x\": 0.25}' WHERE id = 2", "run 2 is not what was proposed"),
        ("UPDATE runs SET executed = '{\"x\": 0.25}' WHERE id = 4", "run 4 is not what was proposed and carried out"),
        ("UPDATE runs SET block = '' WHERE id = 5", "run 5 is not"),
        ("UPDATE runs SET batch = 7 WHERE id = 2", "run 2 is not"),
        ("UPDATE runs SET purpose = 'confirmation' WHERE id = 2", "run 2 is not"),
        ("UPDATE runs SET why = 'another' WHERE id = 2", "run 2 is not"),
        ("UPDATE runs SET source = 'flight' WHERE id = 2", "run 2 is not"),
        ("UPDATE runs SET cost = 0.5 WHERE id = 5", "run 5 is not"),
        ("UPDATE scores SET source_row = 9 WHERE run_id = 5", "score of run 5"),
        ("UPDATE runs SET state = 'issued' WHERE id = 3", "run 3 is issued, and was void"),
        ("UPDATE looks SET summary = '{\"half_width\": 2.0}'", "look 1 is not"),
        ("UPDATE events SET detail = '{}' WHERE id = 3", "event 3 (proposed) or one before it"),
        ("UPDATE events SET at = 'flip' WHERE id = 4", "event 4"),
        ("DELETE FROM events WHERE id = 9", "event 10"),
        ("DELETE FROM events WHERE id = 1", "event 2"),
    ],
)
def test_changes_are_told(filled, statement, says):
    with filled._database.write() as connection:
        connection.execute(sa.text(statement.replace(":", "\\:")))
    with pytest.raises(StoreError) as caught:
        filled.verify()
    assert says in str(caught.value)


def test_runs_that_are_issued_again_were_not_changed(store):
    """A run that was let go, one tried again, and one whose failure lay with a machine."""
    store.add_batch([NewRun({"x": float(i)}, "start") for i in range(3)])
    store.claim()
    store.fail(2, "no fuel")
    store.fail(3, "no memory", "machine")
    store.release()
    store.retry([2])
    store.retry([3], 9)
    assert [run.state for run in store.runs()] == ["issued"] * 3
    store.verify()


def test_hashes_that_were_taken_away_are_told(filled):
    with filled._database.write() as connection:
        connection.execute(sa.text("UPDATE events SET hash = ''"))
    with pytest.raises(StoreError, match="event 1 "):
        filled.verify()


def test_text_that_became_bytes(tmp_path):
    """What SQLite makes of one bit in the header of a row."""
    with Store.open(tmp_path, create=True, campaign="test") as store:
        store.add_batch([NewRun({"x": 1.0})])
        with store._database.write() as connection:
            connection.execute(sa.text("UPDATE events SET at = CAST(at AS BLOB)"))
        with pytest.raises(StoreError, match="at of event 1 is b'"):
            store.verify()
