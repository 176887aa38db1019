"""Several processes on one store: nothing is claimed twice, nothing is lost; a killed writer leaves it consistent."""

from __future__ import annotations

import random
import signal
import sqlite3
import subprocess
import sys
import time
from collections import Counter

import pytest

from seqrsm.store.records import NewRun
from seqrsm.store.store import STORE_NAME, Store

WORKER = """
import sys, time
from seqrsm.store.store import NewScore, Store
folder, url, n = sys.argv[1], sys.argv[2] or None, int(sys.argv[3])
with Store.open(folder, url=url, create=True, campaign="test") as store:
    print("ready", flush=True)
    sys.stdin.readline()
    while len(store.runs("scored")) < n:
        for run in store.claim():
            time.sleep(0.01)  # the run itself, without which one worker may be done before the other gets a turn
            store.record_scores(run.run_id, [NewScore("crops", run.settings["x"])])
            print(run.run_id, flush=True)
"""

PROPOSER = """
import sys
from seqrsm.store.store import NewRun, NewScore, Store
with Store.open(sys.argv[1], create=True, campaign="test") as store:
    print("ready", flush=True)
    sys.stdin.readline()
    while True:
        ids = store.add_batch([NewRun({"x": 1.0})] * 3)
        print("batch", *ids, flush=True)
        store.claim()
        store.record_scores(ids[0], [NewScore("a", 1.0), NewScore("b", 2.0)])
        print("score", ids[0], flush=True)
        store.fail(ids[1], "tried")
        print("fail", ids[1], flush=True)
"""


def start(script: str, *arguments: object) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", script, *map(str, arguments)]
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)


def go(process: subprocess.Popen[str]) -> None:
    assert process.stdin is not None
    process.stdin.write("go\n")
    process.stdin.flush()


def test_processes_share_the_runs(store, tmp_path, url):
    workers = [start(WORKER, tmp_path, url or "", 80) for _ in range(2)]
    for worker in workers:
        assert worker.stdout.readline() == "ready\n"
    for worker in workers:
        go(worker)
    ids = []
    for i in range(80):
        ids += store.add_batch([NewRun({"x": float(i)})])
        time.sleep(0.02)  # else whoever comes first claims all that wait
    done = [[int(line) for line in worker.communicate(timeout=120)[0].split()] for worker in workers]
    assert all(worker.returncode == 0 for worker in workers)
    assert all(done), "one worker did everything: the test shows nothing"
    assert sorted(done[0] + done[1]) == ids
    runs = store.runs()
    assert all(run.state == "scored" and run.attempts == 1 for run in runs)
    assert [run.scores[0].score for run in runs] == [float(i) for i in range(80)]
    assert Counter(event.kind for event in store.events()) == dict.fromkeys(
        ("proposed", "issued", "running", "scored"), 80
    )


def test_processes_propose_at_once(store, tmp_path, url):
    script = (
        "import sys; from seqrsm.store.store import NewRun, Store\n"
        "with Store.open(sys.argv[1], url=sys.argv[2] or None) as store:\n"
        "    for _ in range(15): print(*store.add_batch([NewRun({'x': 1.0})] * 2))"
    )
    workers = [start(script, tmp_path, url or "") for _ in range(2)]
    ids = [[int(word) for word in worker.communicate(timeout=120)[0].split()] for worker in workers]
    assert sorted(ids[0] + ids[1]) == list(range(1, 61))
    assert Counter(run.batch for run in store.runs()) == dict.fromkeys(range(1, 31), 2)


def test_processes_create_the_same_store(tmp_path):
    for number in range(2):
        folder = tmp_path / str(number)
        folder.mkdir()
        workers = [start(WORKER, folder, "", 0) for _ in range(2)]
        for worker in workers:
            out, _ = worker.communicate("go\n", timeout=120)
            assert (worker.returncode, out) == (0, "ready\n")
        with Store.open(folder, campaign="test") as store:
            assert store.info()["campaign"] == "test"


@pytest.mark.skipif(sys.platform == "win32", reason="kills by signal")
@pytest.mark.parametrize("seed", range(5))
def test_killed_in_mid_write(tmp_path, seed):
    """What was acknowledged is there; what was not is there whole or not at all."""
    process = start(PROPOSER, tmp_path)
    assert process.stdout.readline() == "ready\n"
    go(process)
    first = process.stdout.readline()  # however busy the machine, something has been acknowledged
    time.sleep(random.Random(seed).uniform(0.0, 0.22))
    process.send_signal(signal.SIGKILL)
    printed = first + process.communicate(timeout=120)[0]
    lines = [line.split() for line in printed.splitlines(keepends=True) if line.endswith("\n")]
    assert lines, "nothing was written before the kill: the test shows nothing"

    connection = sqlite3.connect(tmp_path / STORE_NAME)
    assert connection.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
    assert connection.execute("PRAGMA foreign_key_check").fetchall() == []
    connection.close()
    with Store.open(tmp_path, campaign="test") as store:
        runs = {run.run_id: run for run in store.runs()}
        for kind, *ids in lines:
            for run_id in map(int, ids):
                assert run_id in runs
                if kind != "batch":
                    assert runs[run_id].state == {"score": "scored", "fail": "failed"}[kind]
        assert list(runs) == list(range(1, len(runs) + 1))
        assert len(runs) % 3 == 0  # batches are whole
        assert all(len(run.scores) == (2 if run.state == "scored" else 0) for run in runs.values())
        events = Counter((event.run_id, event.kind) for event in store.events())
        # An event for each change, and for each score.
        assert all(events[run_id, run.state] == max(1, len(run.scores)) for run_id, run in runs.items())
        # The campaign goes on: what the dead process held is free again.
        held = [run.run_id for run in runs.values() if run.state == "running"]
        assert list(store.release_stale()) == held
        assert store.add_batch([NewRun({"x": 2.0})]) == (len(runs) + 1,)
