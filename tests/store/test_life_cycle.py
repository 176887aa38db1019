"""Leases of runs across hosts, and failures that are tried again a bounded number of times."""

from __future__ import annotations

import time

import pytest
import sqlalchemy as sa

from seqrsm.campaign import experiment, simulation, simulator_checks
from seqrsm.campaign.campaign import MAX_ATTEMPTS, TRIES, Campaign
from seqrsm.campaign.simulation import SimulationResult
from seqrsm.errors import StoreError
from seqrsm.simulate import runner
from seqrsm.simulate.runner import Lost
from seqrsm.store import store as store_module
from seqrsm.store.records import NewRun, NewScore
from seqrsm.store.schema import RUNS
from seqrsm.store.store import Store, heartbeat

RUN = NewRun({"x": 1.0})


def unheard_since(store, run_id, moment):
    with store._database.write() as connection:
        connection.execute(sa.update(RUNS).where(RUNS.c.id == run_id).values(seen_at=moment, started_at=moment))


def test_runs_of_another_host_are_taken_back_when_it_falls_silent(store, monkeypatch):
    ids = store.add_batch([RUN, RUN])
    with monkeypatch.context() as elsewhere:
        elsewhere.setattr(store_module.socket, "gethostname", lambda: "elsewhere")
        store.claim()
        unheard_since(store, ids[0], "2020-01-01T00:00:00.000000Z")
        unheard_since(store, ids[1], "2020-01-01T00:00:00.000000Z")
        store.beat()
        unheard_since(store, ids[0], "2020-01-01T00:00:00.000000Z")
    assert store.release_stale() == (ids[0],)
    assert [run.state for run in store.runs()] == ["issued", "running"]
    # It was only asleep: its score is kept once, whoever comes first.
    assert store.claim()[0].attempts == 2
    assert store.record_scores(ids[0], [NewScore("crops", 5.0)])
    assert not store.record_scores(ids[0], [NewScore("crops", 5.0)])


def test_a_batch_beyond_the_budget_is_not_kept(store):
    store.add_batch([RUN, RUN], budget=3)
    with pytest.raises(StoreError, match="2 of the 3 runs of the budget are used: there is no room for 2"):
        store.add_batch([RUN, RUN], budget=3)
    assert len(store.runs()) == 2
    store.add_batch([RUN], budget=3)
    with pytest.raises(StoreError, match="budget"):
        store.add_batch([RUN], budget=3)
    assert store.n_used() == 3


def test_only_runs_that_are_still_held_are_given_back(store, monkeypatch):
    ids = store.add_batch([RUN, RUN])
    store.claim()
    store.add_batch([RUN])
    store.record_scores(ids[0], [NewScore("crops", 5.0)])
    with monkeypatch.context() as elsewhere:
        elsewhere.setattr(store_module.socket, "gethostname", lambda: "elsewhere")
        store.claim()
    assert store.release() == (ids[1],)
    assert [run.state for run in store.runs()] == ["scored", "issued", "running"]


def test_the_heart_beats_while_runs_are_held(store, monkeypatch):
    monkeypatch.setattr(store_module, "BEAT_S", 0.01)
    (run_id,) = store.add_batch([RUN])
    (claimed,) = store.claim()
    with heartbeat(store):
        deadline = time.monotonic() + 30.0
        while store.runs()[run_id - 1].seen_at == claimed.seen_at and time.monotonic() < deadline:
            time.sleep(0.01)
    seen = store.runs()[run_id - 1].seen_at
    assert seen > claimed.seen_at
    assert len(store.events()) == 3  # a beat is no event


SPEC = """\
[campaign]
name = "test"
[[factor]]
name = "x"
low = -1
high = 1
[[application]]
name = "crops"
utility = "measured"
[stop]
half_width = 2
"""


@pytest.fixture
def campaign(tmp_path, monkeypatch):
    """Campaign of one issued run, whose attempts end as told."""

    def make(*ends):
        (tmp_path / "campaign.toml").write_text(SPEC)
        opened = Campaign.open(tmp_path)
        opened.store.add_batch([RUN])
        left = iter(ends)
        monkeypatch.setattr(runner, "run_many", lambda *_: iter([(0, next(left))]))
        monkeypatch.setattr(simulation, "task_of", lambda *_: None)
        monkeypatch.setattr(simulator_checks, "see_parameters", lambda spec: None)
        monkeypatch.setattr(experiment, "experiment_of", lambda spec: {"seqrsm": "stub"})
        return opened

    return make


def result(failure="", fault=""):
    return SimulationResult(() if failure else (NewScore("crops", 1.0),), failure, fault)


FULL = result("OSError: no space", "machine")


def test_a_failure_of_the_machine_is_tried_again(campaign):
    opened = campaign(result("MemoryError: ", "machine"), result())
    (run,) = opened.simulate()
    assert (run.state, run.attempts, run.reason, run.fault) == ("scored", 2, "", "")
    assert [event.detail["reason"] for event in opened.store.events(kind="failed")] == ["MemoryError: "]


def test_by_each_command_but_not_for_ever(campaign):
    opened = campaign(*[FULL] * (MAX_ATTEMPTS + 1), result())
    for attempts in (TRIES, 2 * TRIES, MAX_ATTEMPTS):
        (run,) = opened.simulate()
        assert (run.state, run.attempts, run.reason, run.fault) == ("failed", attempts, "OSError: no space", "machine")
    assert opened.simulate() == ()
    assert opened.store.retry() == (1,)
    (run,) = opened.simulate()
    assert (run.state, run.attempts) == ("scored", 2)


def test_what_nobody_knows_is_tried_once_by_each_command(campaign):
    opened = campaign(Lost("its processes died"), result())
    (run,) = opened.simulate()
    assert (run.state, run.attempts, run.reason, run.fault) == ("failed", 1, "its processes died", "unknown")
    (run,) = opened.simulate()
    assert (run.state, run.attempts) == ("scored", 2)


def test_a_failure_of_the_settings_is_final_until_somebody_names_the_run(campaign):
    opened = campaign(result("the sensor cannot fly", "settings"), result())
    (run,) = opened.simulate()
    assert (run.state, run.attempts, run.reason) == ("failed", 1, "the sensor cannot fly")
    assert opened.simulate() == ()
    assert opened.store.retry() == ()
    assert opened.store.retry([1]) == (1,)
    assert opened.simulate()[0].state == "scored"
    with pytest.raises(StoreError, match="has not failed"):
        opened.store.retry([1])


def test_an_interrupt_gives_the_runs_back(campaign, monkeypatch):
    opened = campaign()

    def interrupted(*_):
        raise KeyboardInterrupt
        yield

    monkeypatch.setattr(runner, "run_many", interrupted)
    with pytest.raises(KeyboardInterrupt):
        opened.simulate()
    with Store.open(opened.folder) as store:
        assert store.runs()[0].state == "issued"


def test_an_interrupt_before_the_first_simulation_gives_them_back_too(campaign, monkeypatch):
    """The claim is durable before this process knows of it: an interrupt in between leaves no run in its hands."""
    opened = campaign()
    claim = opened.store.claim

    def interrupted(limit):
        claim(limit)
        raise KeyboardInterrupt

    monkeypatch.setattr(opened.store, "claim", interrupted)
    with pytest.raises(KeyboardInterrupt):
        opened.simulate()
    with Store.open(opened.folder) as store:
        assert store.runs()[0].state == "issued"
