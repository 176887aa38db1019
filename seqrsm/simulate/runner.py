"""Many runs on the cores of one machine or on a cluster; results do not depend on how many or where.

The processes are kept from one call to the next, since a fresh one takes seconds to load what it needs.
"""

from __future__ import annotations

import importlib
import itertools
import multiprocessing
import os
import threading
from collections.abc import Callable, Collection, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import TypeVar

from seqrsm.simulate.cluster import Lost, run_on_cluster

A = TypeVar("A")
R = TypeVar("R")

MAX_TRIES = 3
"""How often a run whose process died is tried again, alone, before it is given up."""


def run_many(
    function: Callable[[A], R],
    arguments: Sequence[A],
    workers: int = 1,
    progress: Callable[[int, int], None] | None = None,
    cluster: str | None = None,
    files: Collection[str] = (),
) -> Iterator[tuple[int, R | Lost]]:
    """Apply a function to every argument and yield results as they complete.

    A worker that dies (killed, out of memory) breaks the pool. What was under way is then tried alone, up to
    `MAX_TRIES` times each, so that the run that kills its process is told from those beside it. An exception of the
    function itself ends the runs and reaches the caller. Closing the iterator, or an interrupt, cancels what has not
    begun and stops the workers.

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
    cluster : str, optional
        Address of a dask scheduler, such as ``"tcp://head:8786"``: the runs go there and `workers` is not used.
    files : collection of str
        Paths that the function reads; a cluster's workers get them once each and find them by
        `seqrsm.simulate.cluster.local_file`.

    Yields
    ------
    tuple of int and result
        Index of the argument and what the function returned, or `Lost`; in the order of completion.

    Raises
    ------
    ValueError
        `workers` is below 1.
    UserError
        The cluster cannot be reached, is lost or stands still, or its client library is not installed.
    """
    if workers < 1:
        raise ValueError(f"workers must be at least 1, got {workers}")
    results: Iterator[tuple[int, R | Lost]]
    if cluster is not None:
        results = run_on_cluster(function, arguments, cluster, files)
    elif workers == 1 or len(arguments) <= 1:
        results = ((index, function(argument)) for index, argument in enumerate(arguments))
    else:
        results = _run_in_pool(function, arguments, workers)
    for finished, result in enumerate(results, start=1):
        if progress is not None:
            progress(finished, len(arguments))
        yield result


def start_workers(module: str, workers: int) -> None:
    """Begin to start processes that load a module, for `run_many` to come."""
    if workers > 1:
        pool = _kept_pool(workers)
        for _ in range(workers):
            pool.submit(importlib.import_module, module)


_pools: dict[int, ProcessPoolExecutor] = {}


def _kept_pool(workers: int) -> ProcessPoolExecutor:
    """The pool of so many processes, begun at the first use; it ends with this process."""
    if workers not in _pools:
        _pools[workers] = _new_pool(workers)
    return _pools[workers]


def _new_pool(workers: int) -> ProcessPoolExecutor:
    # spawn, never fork: numba and BLAS threads do not survive a fork.
    return ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn"), initializer=_start_worker)


def _run_in_pool(function: Callable[[A], R], arguments: Sequence[A], workers: int) -> Iterator[tuple[int, R | Lost]]:
    waiting = dict(enumerate(arguments))
    while waiting:
        suspects = yield from _run_until_broken(function, waiting, workers)
        for index in suspects:
            for _ in range(MAX_TRIES):
                broken = yield from _run_until_broken(function, {index: arguments[index]}, 1)
                if not broken:
                    break
            else:
                yield index, Lost(f"the process that ran it died {MAX_TRIES + 1} times (out of memory, or killed)")
            del waiting[index]


def _run_until_broken(
    function: Callable[[A], R], waiting: dict[int, A], workers: int
) -> Generator[tuple[int, R], None, tuple[int, ...]]:
    """Run what waits, taking out what is done; when a process dies, return the indices that were under way."""
    pool = _kept_pool(workers) if workers > 1 else _new_pool(workers)
    clean = False
    futures: dict[Future[R], int] = {}
    queue = iter(list(waiting.items()))
    try:
        while True:
            # No more under way than there are processes: what breaks the pool is among them.
            for index, argument in itertools.islice(queue, workers - len(futures)):
                futures[pool.submit(function, argument)] = index
            if not futures:
                break
            done, _ = wait(futures, return_when=FIRST_COMPLETED)
            for future in done:
                result = future.result()
                index = futures.pop(future)
                del waiting[index]
                yield index, result
        clean = True
        return ()
    except BrokenProcessPool:
        return tuple(sorted(index for index in futures.values()))
    finally:
        if not clean:
            if workers > 1:
                _pools.pop(workers, None)
            _stop(pool)
        elif workers == 1:
            pool.shutdown()


def _start_worker() -> None:
    """Keep each worker on one core, leave Ctrl-C to the parent, and end with it, however it ends."""
    import signal

    os.environ["NUMBA_NUM_THREADS"] = "1"
    os.environ["OMP_NUM_THREADS"] = "1"
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _stop(pool: ProcessPoolExecutor) -> None:
    """Stop a pool at once: cancel what waits and end the processes that still compute."""
    processes = list((pool._processes or {}).values())
    pool.shutdown(wait=False, cancel_futures=True)
    for process in processes:
        process.terminate()
    for process in processes:
        process.join(timeout=10.0)
