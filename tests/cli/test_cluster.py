"""A real dask cluster: scheduler and two workers in processes of their own."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager
from pathlib import Path

import cluster_jobs
import pytest
from commands import call
from tiny_campaign import TINY, make_tiny

from seqrsm.campaign.campaign import Campaign
from seqrsm.errors import UserError
from seqrsm.simulate import runner
from seqrsm.simulate.runner import Lost, run_many
from seqrsm.store.store import Store

distributed = pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")
# The client's background tasks outlive a scheduler that was killed; what they say then is no fault of ours.
pytestmark = pytest.mark.filterwarnings("ignore")

SERVE = """
import sys
import dask
from distributed import LocalCluster
if __name__ == "__main__":
    # A worker that takes longer to come back than 15 s, as one may on a busy machine, would be given up for good.
    dask.config.set({"distributed.worker.daemon": True, "distributed.deploy.lost-worker-timeout": "1h",
        "distributed.scheduler.allowed-failures": 1})
    cluster = LocalCluster(n_workers=int(sys.argv[1]), threads_per_worker=1, dashboard_address=None, host="127.0.0.1")
    print(cluster.scheduler_address, flush=True)
    sys.stdin.readline()
"""


@contextmanager
def serving(folder: Path, workers: int = 2) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """Address of a scheduler with its workers, and the process that holds them."""
    script = folder / "serve.py"
    script.write_text(SERVE, encoding="utf-8")
    path = os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")])
    process = subprocess.Popen(
        [sys.executable, str(script), str(workers)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env={**os.environ, "PYTHONPATH": path, "OPENBLAS_NUM_THREADS": "1"},
        start_new_session=True,
        cwd=folder,
    )
    assert process.stdout is not None
    try:
        yield process.stdout.readline().strip(), process
    finally:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate(timeout=60)


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with serving(tmp_path_factory.mktemp("cluster")) as (found, _):
        yield found


def test_a_cluster_does_the_same_as_one_process(address, tmp_path):
    calls: list[tuple[int, int]] = []
    found = dict(run_many(cluster_jobs.draw, range(20), cluster=address, progress=lambda d, n: calls.append((d, n))))
    assert found == dict(run_many(cluster_jobs.draw, range(20)))  # to the last bit
    assert calls == [(k, 20) for k in range(1, 21)]

    # a worker killed in mid-run: its run is done by another
    path = str(tmp_path / "died")
    again = dict(run_many(cluster_jobs.die_once, [(path, x) for x in range(6)], cluster=address))
    assert again == {x: 10 * x for x in range(6)}
    assert Path(path).exists()

    # a file is written once by each worker, however many runs and calls need it
    scene = tmp_path / "scene.txt"
    scene.write_text("hills", encoding="utf-8")
    tasks = [(str(scene), k) for k in range(12)]
    told = [
        result
        for _ in range(2)
        for _, result in run_many(cluster_jobs.read_and_tell, tasks, cluster=address, files=[str(scene)])
    ]
    assert {content for content, *_ in told} == {"hills"}
    assert all(place != str(scene) for _, _, place, _ in told)
    assert len({place for _, _, place, _ in told}) <= 2
    assert len({(place, written) for _, _, place, written in told}) == len({place for _, _, place, _ in told})


def test_a_run_that_kills_every_worker_is_given_up(address):
    found = dict(run_many(cluster_jobs.die_always, range(3), cluster=address))
    assert (found[0], found[2]) == (0, 20)
    assert isinstance(found[1], Lost)


def test_a_run_that_only_ran_beside_dying_workers_is_not_given_up(address, tmp_path):
    """Two dead workers make this scheduler blame a run, whoever killed them; alone it then succeeds."""
    path = str(tmp_path / "deaths")
    assert dict(run_many(cluster_jobs.die_twice, [(path, x) for x in range(3)], cluster=address)) == {
        0: 0,
        1: 10,
        2: 20,
    }
    assert Path(path).stat().st_size == 2


def test_a_result_lost_with_its_worker_before_it_was_fetched_is_made_again(address, tmp_path):
    path = str(tmp_path / "died")
    found = {}
    for index, result in run_many(cluster_jobs.die_when_done, [(path, x) for x in range(2)], cluster=address):
        found[index] = result
        deadline = time.monotonic() + 20
        while not Path(path).exists() and time.monotonic() < deadline:
            time.sleep(0.05)
        time.sleep(0.5)  # the client hears of the dead worker while the other run's result waits
    assert found == {0: 0, 1: 10}


def test_a_result_that_is_not_there_when_it_is_fetched_is_waited_for(address, monkeypatch):
    """The worker died, and the client hears of it only while it fetches."""
    fetch, tries = distributed.Future.result, []

    def late(future: distributed.Future, timeout: float) -> float:
        tries.append(future.key)
        if len(tries) == 1:
            raise TimeoutError
        return fetch(future, timeout)

    monkeypatch.setattr("distributed.Future.result", late)
    assert dict(run_many(cluster_jobs.draw, range(2), cluster=address)) == dict(run_many(cluster_jobs.draw, range(2)))
    assert len(tries) == 3


def test_a_run_that_fails_for_want_of_time_is_not_taken_for_one_whose_result_is_late(address, monkeypatch):
    monkeypatch.setattr(runner, "PATIENCE_S", 1)
    with pytest.raises(TimeoutError, match=r"^[01]$"):
        list(run_many(cluster_jobs.time_out, range(2), cluster=address))


@pytest.mark.parametrize("job", [cluster_jobs.want_a_file, cluster_jobs.lose_a_connection, cluster_jobs.be_cancelled])
def test_an_error_of_a_run_itself_is_told_as_without_a_cluster(address, job):
    """Python counts a missing file and a broken connection alike, and only the scheduler's is a lost cluster."""
    with pytest.raises((OSError, CancelledError)) as alone:
        list(run_many(job, [1]))
    with pytest.raises(type(alone.value)) as caught:
        list(run_many(job, [1], cluster=address))
    assert type(caught.value) is type(alone.value)
    assert str(caught.value) == str(alone.value)


def test_a_run_that_finds_no_room_fails_as_without_a_cluster(address, tiny_scene, tmp_path):
    """An error of the disk in a user's own utility: runs fail with its words, and the cluster is not blamed."""
    told = []
    for name, where in (("alone", ()), ("cluster", ("--cluster", address))):
        folder = make_tiny(tmp_path / name, tiny_scene, TINY.replace('"percent_correct"', '"mine:score"'))
        body = "def score(image, scene, *, seed, run_id):\n    raise OSError(28, 'No space left on device')\n"
        (folder / "mine.py").write_text(body, encoding="utf-8")
        call("propose", folder)
        call("simulate", folder, *where, code=2)
        with Store.open(folder) as store:
            told.append([(run.state, run.reason.partition(". See line")[0], run.attempts) for run in store.runs()])
    assert told[0] == told[1]
    assert all(state == "failed" and "No space left" in reason for state, reason, _ in told[0])


def test_a_file_that_cannot_be_sent_is_named(address, tmp_path):
    with pytest.raises(UserError, match="nowhere") as caught:
        list(run_many(cluster_jobs.draw, range(2), cluster=address, files=[str(tmp_path / "nowhere")]))
    assert "lost" not in str(caught.value)


def test_what_was_fetched_is_not_kept_on_the_cluster_and_made_again_when_a_worker_dies(address, tmp_path):
    runs = run_many(cluster_jobs.wait_for, [(str(tmp_path / "go"), x) for x in range(2)], cluster=address)
    assert next(runs) == (0, 0)
    with distributed.Client(address, set_as_default=False) as other:
        deadline = time.monotonic() + 20
        while len(kept := other.run_on_scheduler(cluster_jobs.tasks)) > 1 and time.monotonic() < deadline:
            time.sleep(0.05)
    assert len(kept) == 1
    (tmp_path / "go").touch()
    assert dict(runs) == {1: 10}


def test_a_long_run_is_waited_for(address, monkeypatch):
    monkeypatch.setattr(runner, "PATIENCE_S", 1)
    assert dict(run_many(cluster_jobs.doze, [4.5], cluster=address)) == {0: 4.5}


def test_a_run_that_the_scheduler_forgot_is_sent_again(address, tmp_path, monkeypatch):
    monkeypatch.setattr(runner, "PATIENCE_S", 1)
    runs = run_many(cluster_jobs.wait_for, [(str(tmp_path / "go"), x) for x in range(2)], cluster=address)
    assert next(runs) == (0, 0)
    with distributed.Client(address, set_as_default=False) as other:
        other.run_on_scheduler(cluster_jobs.forget)
    (tmp_path / "go").touch()
    assert dict(runs) == {1: 10}


def test_a_cluster_that_stands_still_is_given_up(tmp_path, monkeypatch):
    """Its workers died and did not come back."""
    monkeypatch.setattr(runner, "PATIENCE_S", 0.2)
    with serving(tmp_path, workers=0) as (empty, _), pytest.raises(UserError, match="is idle"):
        list(run_many(cluster_jobs.draw, range(3), cluster=empty))


def test_a_scheduler_that_does_not_answer_is_lost(tmp_path, monkeypatch):
    monkeypatch.setattr(runner, "PATIENCE_S", 1)
    with serving(tmp_path, workers=1) as (frozen, process):
        runs = run_many(cluster_jobs.wait_for, [(str(tmp_path / "go"), x) for x in range(2)], cluster=frozen)
        assert next(runs) == (0, 0)
        monkeypatch.setattr(runner, "CONNECT_S", 1)
        os.kill(process.pid, signal.SIGSTOP)
        with pytest.raises(UserError, match="lost during runs"):
            list(runs)


def scores(folder: Path) -> dict[int, list[float]]:
    with Store.open(folder) as store:
        return {run.run_id: [score.score for score in run.scores] for run in store.runs()}


def test_a_campaign_scores_the_same_on_a_cluster_that_goes_away_in_mid_run(address, tiny, tiny_scene, tmp_path):
    alone = make_tiny(tmp_path / "alone", tiny_scene)
    for folder in (tiny, alone):
        call("propose", folder)
    call("simulate", alone)
    expected = scores(alone)
    with serving(tmp_path, workers=1) as (gone, process):
        campaign = Campaign.open(tiny)

        def kill_at_third(done: int, _total: int) -> None:
            if done == 3:
                os.killpg(process.pid, signal.SIGKILL)

        with pytest.raises(UserError, match="lost during runs"):
            campaign.simulate(cluster=gone, on_progress=kill_at_third)
        campaign.store.close()
    kept = {run_id: found for run_id, found in scores(tiny).items() if found}
    assert 3 <= len(kept) < len(expected)
    assert kept.items() <= expected.items()
    with Store.open(tiny) as store:
        assert {run.state for run in store.runs()} == {"scored", "issued"}
    call("simulate", tiny, "--cluster", address)
    assert scores(tiny) == expected  # to the last bit


def test_a_connection_that_breaks_between_the_end_of_a_run_and_its_result(address, monkeypatch):
    def broken(_future: object, **_: object) -> None:
        raise CancelledError("scheduler-connection-lost")

    monkeypatch.setattr("distributed.Future.result", broken)
    with pytest.raises(UserError, match="lost during runs"):
        list(run_many(cluster_jobs.draw, range(3), cluster=address))


def test_no_scheduler_at_all(monkeypatch):
    monkeypatch.setattr(runner, "CONNECT_S", 1)
    with pytest.raises(UserError, match="no cluster responds"):
        list(run_many(cluster_jobs.draw, range(3), cluster="tcp://127.0.0.1:9"))
