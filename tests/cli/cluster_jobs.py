"""What the workers of the test cluster are told to do; they find this module by their path."""

from __future__ import annotations

import os
import signal
import threading
import time
from concurrent.futures import CancelledError
from pathlib import Path
from typing import Any

from seqrsm.rng import generator
from seqrsm.simulate.runner import local_file


def draw(run_id: int) -> float:
    return float(generator(1, run_id, "x").standard_normal())


def die_once(argument: tuple[str, int]) -> int:
    path, x = argument
    if x == 1 and not Path(path).exists():
        Path(path).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return 10 * x


def die_always(x: int) -> int:
    if x == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return 10 * x


def die_twice(argument: tuple[str, int]) -> int:
    """As a run that sits beside a killer does: its worker dies as often as makes the scheduler give it up."""
    path, x = argument
    if x == 1 and (not Path(path).exists() or Path(path).stat().st_size < 2):
        with Path(path).open("a", encoding="utf-8") as deaths:
            deaths.write("x")
        os.kill(os.getpid(), signal.SIGKILL)
    return 10 * x


def die_when_done(argument: tuple[str, int]) -> int:
    """Run 1 ends well and its worker dies before the result is fetched; made again, it takes its time."""
    path, x = argument

    def die() -> None:
        time.sleep(0.3)
        Path(path).touch()
        os.kill(os.getpid(), signal.SIGKILL)

    if x == 1:
        time.sleep(1.5 if Path(path).exists() else 0.3)
        if not Path(path).exists():
            threading.Thread(target=die).start()
    return 10 * x


def wait_for(argument: tuple[str, int]) -> int:
    """Run 1 ends when the file is there."""
    path, x = argument
    deadline = time.monotonic() + 300
    while x == 1 and not Path(path).exists() and time.monotonic() < deadline:
        time.sleep(0.05)
    return 10 * x


def doze(seconds: float) -> float:
    time.sleep(seconds)
    return seconds


def time_out(x: int) -> None:
    raise TimeoutError(x)


def want_a_file(x: int) -> int:
    """Run 1 finds its file missing."""
    if x == 1:
        raise FileNotFoundError(2, "gone for this run", "tables.npz")
    return 10 * x


def lose_a_connection(x: int) -> int:
    """As a run that asks another service does: nothing to do with the scheduler."""
    raise ConnectionResetError(f"the licence server hung up on {x}")


def be_cancelled(x: int) -> int:
    raise CancelledError(x)


def tasks(dask_scheduler: Any) -> list[str]:
    """On the scheduler: what it keeps or has under way."""
    return list(dask_scheduler.tasks)


def forget(dask_scheduler: Any) -> None:
    """On the scheduler: forget all tasks, and say so to nobody."""
    for name, client in list(dask_scheduler.clients.items()):
        dask_scheduler.client_releases_keys([task.key for task in client.wants_what], name)


def read_and_tell(argument: tuple[str, int]) -> tuple[str, int, str, float]:
    """Content, process, place and time of writing of a file that was sent."""
    place = local_file(argument[0])
    time.sleep(0.05)
    return Path(place).read_text(encoding="utf-8"), os.getpid(), place, Path(place).stat().st_mtime_ns
