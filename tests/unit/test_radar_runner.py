"""Running many simulations: the same results from any number of processes, after a killed worker too."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from seqrsm.errors import UserError
from seqrsm.rng import generator
from seqrsm.simulate.runner import Lost, run_many, start_workers


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


def own_process(_: int) -> int:
    time.sleep(0.05)
    return os.getpid()


def test_processes_are_kept_from_call_to_call():
    start_workers("seqrsm.rng", 2)
    first, second = ({pid for _, pid in run_many(own_process, range(6), workers=2)} for _ in range(2))
    assert first | second <= {child.pid for child in multiprocessing.active_children()}
    assert len(first | second) == 2
    with pytest.raises(ValueError, match="two"):
        list(run_many(fail_at_two, range(4), workers=2))
    assert not {pid for _, pid in run_many(own_process, range(6), workers=2)} & (first | second)


def test_processes_end_with_the_one_that_began_them():
    code = (
        "import os, signal; from seqrsm.simulate.runner import run_many\n"
        "if __name__ == '__main__':\n"
        "    print(*{pid for _, pid in run_many(os.path.realpath, ['/proc/self'] * 6, workers=2)}, flush=True)\n"
        "    os.kill(os.getpid(), signal.SIGKILL)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    begun = [Path(path) for path in done.stdout.split()]
    assert begun, done.stderr
    end = time.monotonic() + 30.0
    while any(path.exists() for path in begun) and time.monotonic() < end:
        time.sleep(0.05)
    assert not any(path.exists() for path in begun)


def test_no_workers_is_refused():
    with pytest.raises(ValueError, match="at least 1"):
        list(run_many(draw, [1], workers=0))


def die_always(argument: tuple[str, int]) -> int:
    path, x = argument
    if x == 1:
        with Path(path).open("a") as stream:
            stream.write("died\n")
        os.kill(os.getpid(), signal.SIGKILL)
    return 10 * x


def test_a_run_that_always_kills_its_process_is_given_up_alone(tmp_path):
    path = tmp_path / "died"
    found = dict(run_many(die_always, [(str(path), x) for x in range(4)], workers=2))
    assert {index: value for index, value in found.items() if index != 1} == {0: 0, 2: 20, 3: 30}
    assert isinstance(found[1], Lost)
    assert "died 4 times" in found[1].reason
    assert len(path.read_text().splitlines()) == 4


def test_a_missing_client_library_is_told_with_the_line_to_install_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(UserError, match=r"seqrsm\[cluster\]"):
        list(run_many(draw, range(3), cluster="tcp://head:8786"))
