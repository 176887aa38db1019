"""Runs on a dask cluster (extra ``cluster``): scenes travel once per worker, and a lost worker loses nothing."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Collection, Generator, Iterator, Sequence
from concurrent.futures import CancelledError
from pathlib import Path
from typing import Any, TypeVar

from seqrsm.errors import Problem, UserError
from seqrsm.simulate.lost import Lost

A = TypeVar("A")
R = TypeVar("R")

CONNECT_S = 30
"""How long a scheduler may take to answer [s], at the beginning and when the connection broke."""

_PLACES: dict[str, str] = {}
"""On a worker: where the files lie that were sent, by their paths on the sender's machine."""


def local_file(path: str) -> str:
    """Where a file lies on this machine: the copy that was sent to a worker, else the path itself."""
    return _PLACES.get(path, path)


def keep_files(folder: Path, contents: dict[str, bytes]) -> None:
    """Write files that were sent into a worker's folder, named by their content."""
    for path, content in contents.items():
        place = folder / f"{hashlib.sha256(content).hexdigest()[:16]}-{Path(path).name}"
        if not place.exists():
            part = place.with_suffix(".part")
            part.write_bytes(content)
            part.replace(place)
        _PLACES[path] = str(place)


def run_on_cluster(
    function: Callable[[A], R], arguments: Sequence[A], address: str, files: Collection[str] = ()
) -> Iterator[tuple[int, R | Lost]]:
    """Yield results of a dask cluster as they complete; see `seqrsm.simulate.runner.run_many`.

    A run whose worker died is tried again there as often as the scheduler allows (``allowed-failures``, 3 by default),
    and then once more in the same way after all others, alone: what kills its workers is told from what ran beside it.
    """
    try:
        from distributed import Client
    except ImportError as error:
        remedy = "Install it: pip install 'seqrsm[cluster]'"
        raise UserError(
            Problem("running on a cluster needs the package distributed", remedy, field="cluster")
        ) from error
    try:
        client: Any = Client(address, timeout=f"{CONNECT_S}s", set_as_default=False)
    except (OSError, ValueError) as error:
        remedy = "Start a scheduler there (dask scheduler), or correct the address"
        raise UserError(Problem(f"no cluster answers: {error}", remedy, field="cluster", value=address)) from error
    try:
        if files:
            _send_files(client, files)
        killers = yield from _run_all(client, function, dict(enumerate(arguments)))
        for index, reason in sorted(killers.items()):
            killed: Collection[int] = (index,)
            if _has_worker(client):
                killed = yield from _run_all(client, function, {index: arguments[index]})
            if killed:
                yield index, Lost(reason)
    except (OSError, CancelledError) as error:
        text = "the cluster was lost while runs were under way"
        raise UserError(
            Problem(text, "Start it again; finished runs are kept", field="cluster", value=address)
        ) from error
    finally:
        client.close()


def _run_all(
    client: Any, function: Callable[[A], R], arguments: dict[int, A]
) -> Generator[tuple[int, R], None, dict[int, str]]:
    """Yield results as they complete; return the indices whose workers died again and again, each with the reason.

    A connection that is lost cancels every future: `CancelledError`.
    """
    from distributed import KilledWorker, as_completed

    killed: dict[int, str] = {}
    # pure=False: equal arguments are runs of their own, never looked up in the cluster's memory.
    futures = {client.submit(function, argument, pure=False): index for index, argument in arguments.items()}
    finished = as_completed(futures, loop=client.loop)
    try:
        for future in finished:
            if future.status == "lost":  # its worker died before the result was fetched: it is being done again
                finished.add(future)
                continue
            try:
                result: R = future.result()
            except KilledWorker as error:
                killed[futures[future]] = f"the workers that ran it died: {error}"
            else:
                yield futures[future], result
    finally:
        for future in futures:
            if not future.done():
                future.cancel()
    return killed


def _has_worker(client: Any) -> bool:
    """Whether a worker is there, or comes back, within `CONNECT_S`."""
    try:
        client.wait_for_workers(1, timeout=CONNECT_S)
    except TimeoutError:
        return False
    return True


def _send_files(client: Any, files: Collection[str]) -> None:
    """Give the files to every worker that is there or will come; what the scheduler has already is not sent again."""
    from distributed import WorkerPlugin

    contents = {path: Path(path).read_bytes() for path in sorted(files)}
    digest = hashlib.sha256()
    for path, content in contents.items():
        digest.update(path.encode() + b"\0" + hashlib.sha256(content).digest())
    name = f"seqrsm-files-{digest.hexdigest()[:16]}"

    class Files(WorkerPlugin):  # type: ignore[misc]
        """Local, so that it is sent by value."""

        def __init__(self) -> None:
            self.name = name
            self.contents = contents

        def setup(self, worker: Any) -> None:
            keep_files(Path(worker.local_directory), self.contents)

    if not client.run_on_scheduler(lambda dask_scheduler: name in dask_scheduler.worker_plugins):
        client.register_plugin(Files())
