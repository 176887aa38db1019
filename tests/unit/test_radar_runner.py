"""Running many simulations: the same results from any number of processes, after a killed worker too."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import time
import types
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from seqrsm.errors import UserError
from seqrsm.rng import generator
from seqrsm.simulate.runner import run_many


def draw(run_id: int) -> float:
    return float(generator(1, run_id, "x").standard_normal())


def fail_at_two(x: int) -> int:
    if x == 2:
        raise ValueError("two")
    return x


def sleep_unless_first(x: int) -> int:
    time.sleep(0.0 if x == 0 else 60.0)
    return x


def die_once(argument: tuple[str, int]) -> int:
    path, x = argument
    if x == 1 and not Path(path).exists():
        Path(path).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return 10 * x


def test_processes_do_not_change_results():
    serial = dict(run_many(draw, range(6)))
    calls = []
    parallel = dict(run_many(draw, range(6), workers=2, progress=lambda done, total: calls.append((done, total))))
    assert serial == parallel
    assert calls == [(k, 6) for k in range(1, 7)]
    assert np.unique(list(serial.values())).size == 6


def test_a_killed_worker_costs_nothing_but_time(tmp_path):
    path = str(tmp_path / "died")
    assert dict(run_many(die_once, [(path, x) for x in range(4)], workers=2)) == {x: 10 * x for x in range(4)}
    assert Path(path).exists()


def test_errors_of_the_function_reach_the_caller():
    with pytest.raises(ValueError, match="two"):
        list(run_many(fail_at_two, range(4)))
    with pytest.raises(ValueError, match="two"):
        list(run_many(fail_at_two, range(4), workers=2))


def test_serial_runs_are_lazy_and_can_be_left():
    seen = []
    for index, _ in run_many(lambda x: seen.append(x), range(5)):
        if index == 1:
            break
    assert seen == [0, 1]


def test_leaving_a_parallel_run_stops_its_workers():
    start = time.monotonic()
    for index, _ in run_many(sleep_unless_first, range(4), workers=2):
        assert index == 0
        break
    assert time.monotonic() - start < 30.0
    while multiprocessing.active_children() and time.monotonic() - start < 30.0:
        time.sleep(0.05)
    assert not multiprocessing.active_children()


def test_no_workers_is_refused():
    with pytest.raises(ValueError, match="at least 1"):
        list(run_many(draw, [1], workers=0))


class FakeFuture:
    def __init__(self, key, call):
        self.key, self.call, self.status, self.stopped = key, call, "finished", False

    def result(self):
        return self.call()

    def cancelled(self):
        return self.status == "cancelled"

    def done(self):
        return self.status == "finished"

    def cancel(self):
        self.stopped = True


class FakeClient:
    """Stands for the client of dask: what `run_many` uses of it, answering out of order."""

    made: ClassVar[list] = []
    lose_after: ClassVar[int | None] = None

    def __init__(self, address, **options):
        if address == "tcp://nowhere:1":
            raise OSError("timed out")
        self.address, self.options, self.futures, self.closed = address, options, [], False
        FakeClient.made.append(self)

    def submit(self, function, argument, *, retries, pure):
        assert retries == 3
        assert pure is False
        self.futures.append(FakeFuture(f"k{len(self.futures)}", lambda: function(argument)))
        return self.futures[-1]

    def close(self):
        self.closed = True


def as_completed_backwards(futures):
    for n, future in enumerate(reversed(futures)):
        if FakeClient.lose_after is not None and n >= FakeClient.lose_after:
            future.status = "cancelled"
        yield future


@pytest.fixture
def fake_cluster(monkeypatch):
    module = types.ModuleType("distributed")
    module.Client, module.as_completed = FakeClient, as_completed_backwards
    monkeypatch.setitem(sys.modules, "distributed", module)
    monkeypatch.setattr(FakeClient, "made", [])
    monkeypatch.setattr(FakeClient, "lose_after", None)


@pytest.mark.usefixtures("fake_cluster")
def test_a_cluster_gives_the_results_of_one_process():
    calls = []
    found = list(run_many(draw, range(5), cluster="tcp://head:8786", progress=lambda d, n: calls.append((d, n))))
    assert [index for index, _ in found] == [4, 3, 2, 1, 0]
    assert dict(found) == dict(run_many(draw, range(5)))
    assert calls[-1] == (5, 5)
    assert FakeClient.made[0].closed
    with pytest.raises(ValueError, match="two"):
        list(run_many(fail_at_two, range(4), cluster="tcp://head:8786"))


@pytest.mark.usefixtures("fake_cluster")
def test_a_cluster_that_is_lost_or_not_there_is_told(monkeypatch):
    with pytest.raises(UserError, match="no cluster answers: timed out"):
        list(run_many(draw, range(3), cluster="tcp://nowhere:1"))
    monkeypatch.setattr(FakeClient, "lose_after", 2)
    with pytest.raises(UserError, match="lost while runs were under way"):
        list(run_many(draw, range(4), cluster="tcp://head:8786"))
    assert FakeClient.made[-1].closed


def test_a_missing_client_library_is_told_with_the_line_to_install_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(UserError, match=r"seqrsm\[cluster\]"):
        list(run_many(draw, range(3), cluster="tcp://head:8786"))
