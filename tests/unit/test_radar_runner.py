"""Running many simulations: the same results from any number of threads, and none begins after one is left."""

from __future__ import annotations

import sys
import threading

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


def test_threads_do_not_change_results():
    serial = dict(run_many(draw, range(6)))
    calls = []
    parallel = dict(run_many(draw, range(6), workers=2, progress=lambda done, total: calls.append((done, total))))
    assert serial == parallel
    assert calls == [(k, 6) for k in range(1, 7)]
    assert np.unique(list(serial.values())).size == 6


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


def test_as_many_runs_as_workers_are_under_way_at_once():
    """Each waits for two others: with fewer at once, or in turns, the barrier breaks."""
    barrier = threading.Barrier(3)
    found = dict(run_many(lambda _: barrier.wait(timeout=30.0), range(9), workers=3))
    assert sorted(found) == list(range(9))
    assert {sorted(found.values()).count(k) for k in range(3)} == {3}


def test_leaving_a_parallel_run_begins_no_other_and_waits_for_none():
    begun, go_on = [], threading.Event()

    def wait_unless_first(x: int) -> int:
        begun.append(x)
        assert x == 0 or go_on.wait(timeout=60.0)
        return x

    before = set(threading.enumerate())
    for index, _ in run_many(wait_unless_first, range(5), workers=2):
        assert index == 0
        break
    go_on.set()
    for thread in set(threading.enumerate()) - before:
        thread.join(timeout=60.0)
        assert not thread.is_alive()
    assert len(begun) <= 3


def test_a_missing_client_library_is_told_with_the_line_to_install_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(UserError, match=r"seqrsm\[cluster\]"):
        list(run_many(draw, range(3), cluster="tcp://head:8786"))
