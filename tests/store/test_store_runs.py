"""States, scores, looks and events."""

from __future__ import annotations

import math
import subprocess
import sys

import numpy as np
import pytest
from held import hold

from seqrsm import __version__
from seqrsm.errors import StoreError
from seqrsm.store.records import NewRun, NewScore
from seqrsm.store.schema import STATES, TRANSITIONS
from seqrsm.store.store import Store

HERE = {"frequency": 1.25, "polarization": "HH"}
RUN = NewRun(HERE, "start", "first design")


def bring(store: Store, state: str) -> int:
    """A new run in this state."""
    (run_id,) = store.add_batch([RUN])
    if state == "running":
        hold(store, [run_id])
    elif state == "failed":
        store.fail(run_id, "no fuel")
    elif state == "scored":
        store.record_scores(run_id, [NewScore("crops", 50.0)])
    elif state == "void":
        store.void(run_id, "wrong day")
    assert store.runs()[run_id - 1].state == state
    return run_id


def test_ids_count_from_one_and_repeats_stay_apart(store):
    assert store.add_batch([RUN, RUN, NewRun({**HERE, "frequency": 9.0})]) == (1, 2, 3)
    assert store.add_batch([RUN]) == (4,)
    assert store.add_batch([]) == ()
    runs = store.runs()
    assert [run.run_id for run in runs] == [1, 2, 3, 4]
    assert [run.batch for run in runs] == [1, 1, 1, 2]
    assert runs[0].proposed == runs[1].proposed == HERE


def test_settings_come_back_as_the_same_numbers(store):
    values = {"a": 0.1 + 0.2, "b": 1e-300, "c": math.pi, "d": -0.0, "name": "HH+HV \u00fc '\";--"}
    (run_id,) = store.add_batch([NewRun(values)])
    assert store.runs()[run_id - 1].settings == values
    assert list(store.runs()[run_id - 1].settings) == list(values)
    (run_id,) = store.add_batch([NewRun({"a": np.float64(0.1), "b": np.str_("x")})])
    assert store.runs()[run_id - 1].settings == {"a": 0.1, "b": "x"}


def test_the_ordinary_way(store):
    (run_id,) = store.add_batch([NewRun(HERE, "optimum", "narrows the interval", "simulation", 2.5, "day 1")])
    (claimed,) = store.claim()
    assert (claimed.run_id, claimed.state, claimed.attempts) == (run_id, "running", 1)
    assert store.record_scores(
        run_id, [NewScore("crops", 71.5, se=1.5, n=10, correct=7, metadata={"a": [1, math.nan]})]
    )
    run = store.runs()[run_id - 1]
    assert (run.state, run.purpose, run.why, run.cost, run.block) == (
        "scored",
        "optimum",
        "narrows the interval",
        2.5,
        "day 1",
    )
    assert run.owner == ""
    score = run.score_of("crops")
    assert (score.score, score.se, score.n, score.correct, score.metadata) == (71.5, 1.5, 10, 7, {"a": [1, None]})
    assert run.score_of("ice") is None
    assert run.proposed_at <= run.issued_at <= run.started_at <= run.ended_at
    events = store.events()
    assert {event.run_id for event in events} == {run_id}
    assert [event.kind for event in events] == ["proposed", "issued", "running", "scored"]
    assert {(event.version, event.seed) for event in events} == {(__version__, 7)}


@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("target", ["scored", "failed", "void"])
def test_only_legal_transitions(store, state, target):
    run_id = bring(store, state)
    before = store.runs()[run_id - 1], store.events()
    action = {
        "scored": lambda: store.record_scores(run_id, [NewScore("ice", 1.0)]),
        "failed": lambda: store.fail(run_id, "why"),
        "void": lambda: store.void(run_id, "why"),
    }[target]
    # A scored run takes the score of another application.
    if target in TRANSITIONS[state] or state == target == "scored":
        action()
        assert store.runs()[run_id - 1].state == target
    else:
        text = "already" if state == target else f"and cannot become {target}"
        with pytest.raises(StoreError, match=f"run {run_id} is {state} {text}"):
            action()
        assert (store.runs()[run_id - 1], store.events()) == before


def test_one_illegal_run_stops_the_whole_change(store):
    good, bad = bring(store, "failed"), bring(store, "void")
    with pytest.raises(StoreError, match=f"run {bad} is void"):
        store.void([good, bad], "clouds")
    assert store.runs()[good - 1].state == "failed"
    with pytest.raises(StoreError, match="no such run"):
        store.void([good, 99], "clouds")
    assert store.runs()[good - 1].state == "failed"


def test_a_score_is_recorded_once(store):
    run_id = bring(store, "scored")
    assert not store.record_scores(run_id, [NewScore("crops", 50.0)])
    with pytest.raises(StoreError, match="scored already"):
        store.record_scores(run_id, [NewScore("crops", 50.5)])
    assert len(store.runs()[run_id - 1].scores) == 1


@pytest.mark.parametrize("score", [NewScore("a", math.nan), NewScore("a", math.inf), NewScore("a", 1.0, 0.0)])
def test_numbers_that_are_no_scores(store, score):
    run_id = bring(store, "issued")
    with pytest.raises(StoreError, match="not a usable number"):
        store.record_scores(run_id, [score])
    assert store.runs()[run_id - 1].state == "issued"


def test_a_failed_run_can_be_tried_again(store):
    run_id = bring(store, "failed")
    assert store.runs()[run_id - 1].reason == "no fuel"
    store.retry([run_id])
    (run,) = store.claim()
    assert (run.run_id, run.reason, run.attempts) == (run_id, "", 1)


def test_void_needs_a_reason_and_keeps_the_score(store):
    run_id = bring(store, "scored")
    with pytest.raises(StoreError, match="voiding needs a reason"):
        store.void(run_id, "  ")
    store.void(run_id, "cloud")
    assert (store.runs()[run_id - 1].reason, len(store.runs()[run_id - 1].scores)) == ("cloud", 1)


def test_claim_takes_waiting_simulations_only(store):
    ids = store.add_batch([RUN, RUN, NewRun(HERE, source="flight"), RUN])
    later = bring(store, "issued")
    hold(store, ids[:1])
    assert [run.run_id for run in store.claim()] == [ids[1], ids[3], later]
    assert store.claim() == ()
    assert store.runs()[ids[2] - 1].state == "issued"
    with pytest.raises(StoreError, match="no such run"):
        store.retry([99])


def test_runs_of_dead_processes_are_released(store, tmp_path, url, monkeypatch):
    ids = store.add_batch([RUN])
    script = (
        "import sys; from seqrsm.store.store import Store\n"
        f"with Store.open({str(tmp_path)!r}, url={url!r}) as s: s.claim()"
    )
    subprocess.run([sys.executable, "-c", script], check=True)
    ids += store.add_batch([RUN])
    store.claim()
    assert store.release_stale() == (ids[0],)
    assert [run.state for run in store.runs()] == ["issued", "running"]
    monkeypatch.setattr("seqrsm.store.store.LEASE_S", -1.0)
    assert store.release_stale() == (ids[1],)
    assert store.release_stale() == ()
    assert [event.kind for event in store.events() if event.run_id == ids[0]][-1] == "released"


def test_an_earlier_process_of_the_same_number_is_dead(store, monkeypatch):
    (run_id,) = store.add_batch([RUN])
    store.claim()
    assert store.release_stale() == ()
    monkeypatch.setattr("seqrsm.store.store._TOKEN", "another")
    assert store.release_stale() == (run_id,)


def test_selection_of_runs(store):
    ids = {state: bring(store, state) for state in STATES}
    assert [run.run_id for run in store.runs(["scored", "void"])] == [ids["scored"], ids["void"]]
    assert [run.run_id for run in store.runs("failed")] == [ids["failed"]]
    assert store.runs(source="flight") == ()
    with pytest.raises(StoreError, match="no such run"):
        store.void(99, "clouds")


def test_looks(store):
    assert store.record_look(8, "crops", {"half_width": np.float64(2.5), "x": (1, 2), "s": math.nan}) == 1
    assert store.record_look(12, "crops", {}) == 2
    store.record_look(12, "ice", {})
    first, second = store.looks("crops")
    assert (first.look, first.after_run, first.summary) == (1, 8, {"half_width": 2.5, "x": [1, 2], "s": None})
    assert (second.after_run, len(store.looks())) == (12, 3)


def test_events_that_are_no_runs(store):
    store.add_event("stop", {"held": True})
    (event,) = store.events(kind="stop")
    assert (event.run_id, event.detail) == (None, {"held": True})


def test_everything_is_there_after_reopening(store, tmp_path, url):
    bring(store, "scored")
    before = store.runs(), store.events()
    store.close()
    with Store.open(tmp_path, url=url, campaign="test") as again:
        assert (again.runs(), again.events()) == before
        assert again.info()["created_version"] == __version__
