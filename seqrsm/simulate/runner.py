"""Many runs on the cores of one machine; results do not depend on how many."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import TypeVar

A = TypeVar("A")
R = TypeVar("R")

MAX_REBUILDS = 3
"""How often a pool that lost a worker is built anew."""


def run_many(
    function: Callable[[A], R],
    arguments: Sequence[A],
    workers: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> Iterator[tuple[int, R]]:
    """Apply a function to every argument and yield results as they complete.

    A worker that dies (killed, out of memory) breaks the pool; the pool is built anew and what had not finished is run
    again, up to `MAX_REBUILDS` times. An exception of the function itself ends the runs and reaches the caller.
    Closing the iterator, or an interrupt, cancels what has not begun and stops the workers.

    Parameters
    ----------
    function : callable
        Importable by name when ``workers > 1``: it is sent to spawned processes.
    arguments : sequence
        One argument for each run.
    workers : int
        Processes; 1 runs in this process.
    progress : callable, optional
        Called with (finished, all) after each run.

    Yields
    ------
    tuple of int and result
        Index of the argument and what the function returned; in the order of completion.

    Raises
    ------
    concurrent.futures.process.BrokenProcessPool
        The pool broke more than `MAX_REBUILDS` times.
    ValueError
        `workers` is below 1.
    """
    if workers < 1:
        raise ValueError(f"workers must be at least 1, got {workers}")
    if workers == 1 or len(arguments) <= 1:
        results: Iterator[tuple[int, R]] = ((index, function(argument)) for index, argument in enumerate(arguments))
    else:
        results = _run_in_pool(function, arguments, min(workers, len(arguments)))
    for finished, result in enumerate(results, start=1):
        if progress is not None:
            progress(finished, len(arguments))
        yield result


def _run_in_pool(function: Callable[[A], R], arguments: Sequence[A], workers: int) -> Iterator[tuple[int, R]]:
    open_runs = dict(enumerate(arguments))
    rebuilds = 0
    while open_runs:
        # spawn, never fork: numba and BLAS threads do not survive a fork.
        pool = ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn"), initializer=_start_worker)
        clean = False
        try:
            futures: dict[Future[R], int] = {pool.submit(function, a): index for index, a in open_runs.items()}
            while futures:
                done, _ = wait(futures, return_when=FIRST_COMPLETED)
                for future in done:
                    index = futures.pop(future)
                    result = future.result()
                    del open_runs[index]
                    yield index, result
            clean = True
        except BrokenProcessPool:
            rebuilds += 1
            if rebuilds > MAX_REBUILDS:
                raise
        finally:
            if clean:
                pool.shutdown()
            else:
                _stop(pool)


def _start_worker() -> None:
    """Keep each worker on one core and leave Ctrl-C to the parent."""
    import signal

    os.environ["NUMBA_NUM_THREADS"] = "1"
    os.environ["OMP_NUM_THREADS"] = "1"
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _stop(pool: ProcessPoolExecutor) -> None:
    """Stop a pool at once: cancel what waits and end the processes that still compute."""
    processes = list((pool._processes or {}).values())
    pool.shutdown(wait=False, cancel_futures=True)
    for process in processes:
        process.terminate()
    for process in processes:
        process.join(timeout=10.0)
