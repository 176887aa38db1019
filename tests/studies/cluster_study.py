"""What a dask cluster costs: scaling on two workers, and the constants that tell what 1,000 workers saturate first.

    python tests/studies/cluster_study.py

Writes its section of reports/reliability.md.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1] / "cli")]

import cluster_jobs  # noqa: E402
from reliability_report import machine, write_section  # noqa: E402

from seqrsm.simulate.runner import run_many  # noqa: E402
from seqrsm.store.records import NewRun, NewScore  # noqa: E402
from seqrsm.store.store import Store  # noqa: E402

BUSY_S, RUNS = 0.5, 40
SMALL = 1000
SCENE_BYTES = 20_000_000
WORKERS = 1000
NETWORK_BYTES_PER_S = 1e9
"""Of the scheduler's link, assumed: 10 Gbit/s, of which four fifths are of use."""


def sleepers(address: str) -> float:
    """Time of runs that take `BUSY_S` each and no processor [s]: what is measured is the handing out."""
    begin = time.monotonic()
    list(run_many(time.sleep, [BUSY_S] * RUNS, cluster=address))
    return time.monotonic() - begin


def per_task(address: str) -> float:
    """Time that the scheduler and the client spend on a run of no duration [s]."""
    begin = time.monotonic()
    list(run_many(cluster_jobs.draw, range(SMALL), cluster=address))
    return (time.monotonic() - begin) / SMALL


def per_byte(address: str, folder: Path) -> float:
    """Time to send a scene to the workers, for each worker and byte [s]."""
    scene = folder / "scene.bin"
    scene.write_bytes(os.urandom(SCENE_BYTES))
    list(run_many(cluster_jobs.draw, range(2), cluster=address))
    begin = time.monotonic()
    list(run_many(cluster_jobs.draw, range(2), cluster=address, files=[str(scene)]))
    return (time.monotonic() - begin) / 2 / SCENE_BYTES


def per_score(folder: Path) -> float:
    """Time that the store needs for a durable score, one at a time [s]."""
    with Store.open(folder, create=True, campaign="c") as store:
        ids = store.add_batch([NewRun({"x": 1.0})] * 200)
        store.claim()
        begin = time.monotonic()
        for run_id in ids:
            store.record_scores(run_id, [NewScore("a", 1.0)])
        return (time.monotonic() - begin) / len(ids)


def main() -> None:
    """Measure, reckon, write."""
    from distributed import LocalCluster

    found: dict[int, float] = {}
    with tempfile.TemporaryDirectory() as name:
        for n in (1, 2):
            with LocalCluster(n_workers=n, threads_per_worker=1, dashboard_address=None, host="127.0.0.1") as cluster:
                address = cluster.scheduler_address
                list(run_many(cluster_jobs.draw, range(10), cluster=address))
                found[n] = min(sleepers(address) for _ in range(2))
                if n == 2:
                    task_s = min(per_task(address) for _ in range(2))
                    byte_s = per_byte(address, Path(name))
        score_s = per_score(Path(name))
    efficiency = found[1] / found[2] / 2
    first = "scheduler" if task_s > score_s else "store"
    slowest = max(task_s, score_s)
    link_s = WORKERS * SCENE_BYTES / NETWORK_BYTES_PER_S
    lines = [
        f"{RUNS} runs of {BUSY_S} s that need no processor (so that two workers do not share this machine's cores",
        f"with other work) took {found[1]:.1f} s on one worker and {found[2]:.1f} s on two: efficiency",
        f"{100 * efficiency:.0f} %. Real simulations of a campaign score to the last bit as without a cluster, with",
        "workers killed in mid-run and a scheduler that goes away (`tests/cli/test_cluster.py`).",
        "",
        "| constant | measured | at 1,000 workers |",
        "|---|---|---|",
        f"| scheduler and client, for each run | {1e3 * task_s:.2f} ms | at most {1 / task_s:.0f} runs/s |",
        f"| store, for each durable score (SQLite, this disk) | {1e3 * score_s:.2f} ms "
        f"| at most {1 / score_s:.0f} runs/s |",
        f"| scene to a worker, by the scheduler | {byte_s * 1e9:.1f} ns/byte | {WORKERS * SCENE_BYTES * byte_s:.0f} s "
        f"for {SCENE_BYTES // 10**6} MB to all, once; {link_s:.0f} s at {NETWORK_BYTES_PER_S / 1e9:.0f} GB/s "
        "(assumed) |",
        "",
        "Model: a batch of n runs of t seconds on w workers takes",
        "max(n t / w, n max(c_scheduler, c_store)) + w b c_scene the first time (b: bytes of the scene), without",
        f"the last term after it. The first to saturate is the {first}: {WORKERS} workers are kept busy by runs of",
        f"at least {WORKERS * slowest:.1f} s; shorter ones leave workers idle. A batch must hold at least as many runs",
        "as there are workers: `run --batch`.",
        "",
        f"{machine()} Command: `python tests/studies/cluster_study.py`.",
    ]
    write_section("3-cluster", "Many machines", lines)


if __name__ == "__main__":
    main()
