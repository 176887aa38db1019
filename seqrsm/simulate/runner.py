"""Many runs on the cores of one machine or on a cluster; results do not depend on how many or where."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Any, TypeVar

from seqrsm.errors import Problem, UserError

A = TypeVar("A")
R = TypeVar("R")

MAX_REBUILDS = 3
"""How often a pool that lost a worker is built anew, and how often a cluster tries a run whose worker died."""


def run_many(
    function: Callable[[A], R],
    arguments: Sequence[A],
    workers: int = 1,
    progress: Callable[[int, int], None] | None = None,
    cluster: str | None = None,
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
    cluster : str, optional
        Address of a dask scheduler, such as ``"tcp://head:8786"``: the runs go there and `workers` is not used.

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
    UserError
        The cluster cannot be reached, is lost, or its client library is not installed.
    """
    if workers < 1:
        raise ValueError(f"workers must be at least 1, got {workers}")
    results: Iterator[tuple[int, R]]
    if cluster is not None:
        results = _run_on_cluster(function, arguments, cluster)
    elif workers == 1 or len(arguments) <= 1:
        results = ((index, function(argument)) for index, argument in enumerate(arguments))
    else:
        results = _run_in_pool(function, arguments, min(workers, len(arguments)))
    for finished, result in enumerate(results, start=1):
        if progress is not None:
            progress(finished, len(arguments))
        yield result


def _run_on_cluster(function: Callable[[A], R], arguments: Sequence[A], address: str) -> Iterator[tuple[int, R]]:
    """Yield results of a dask cluster as they complete; a run whose worker died is tried again there."""
    try:
        from distributed import Client, as_completed
    except ImportError as error:
        remedy = "Install it: pip install 'seqrsm[cluster]'"
        raise UserError(
            Problem("running on a cluster needs the package distributed", remedy, field="cluster")
        ) from error
    try:
        client: Any = Client(address, timeout="30s", set_as_default=False)
    except (OSError, ValueError) as error:
        remedy = "Start a scheduler there (dask scheduler), or correct the address"
        raise UserError(Problem(f"no cluster answers: {error}", remedy, field="cluster", value=address)) from error
    futures: list[Any] = []
    try:
        # pure=False: equal arguments are runs of their own, never looked up in the cluster's memory.
        futures = [client.submit(function, a, retries=MAX_REBUILDS, pure=False) for a in arguments]
        index_of = {future.key: index for index, future in enumerate(futures)}
        for future in as_completed(futures):
            if future.cancelled() or future.status == "lost":
                raise _lost(address)
            yield index_of[future.key], future.result()
    except OSError as error:
        raise _lost(address) from error
    finally:
        for future in futures:
            if not future.done():
                future.cancel()
        client.close()


def _lost(address: str) -> UserError:
    text = "the cluster was lost while runs were under way"
    return UserError(Problem(text, "Start it again; finished runs are kept", field="cluster", value=address))


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
