"""Many runs on the cores of one machine or on a dask cluster; results do not depend on how many or where.

On one machine they are threads of this process: the engines' kernels run without the interpreter's lock, and a process
of its own would take seconds to load what it needs. On a cluster (extra ``cluster``) scenes travel once per worker, and
a lost worker loses nothing.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Collection, Generator, Iterator, Sequence
from concurrent.futures import CancelledError
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from queue import SimpleQueue
from threading import Event, Thread
from typing import Any, TypeVar

from seqrsm.errors import Problem, UserError

A = TypeVar("A")
R = TypeVar("R")

CONNECT_S = 30
"""How long a scheduler may take to answer [s], at the beginning and when the connection broke."""

PATIENCE_S = 300
"""After how long without a result the scheduler is asked whether any worker is at work [s]."""

MAX_STANDSTILLS = 3
"""How often in a row, without a result between, a cluster may stand still; each time what is missing is sent again."""

POLL_S = 0.05
"""How often futures are looked at [s]."""

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
    """Yield results of a dask cluster as they complete; see `run_many`.

    A run whose worker died is tried again there as often as the scheduler allows (``allowed-failures``, 3 by default),
    and then once more in the same way after all others, alone: what kills its workers is told from what ran beside it.
    Runs may take as long as they like, but a cluster that stands still is given up. What a run itself raises reaches
    the caller as it is: only an error of the connection to the scheduler says that the cluster was lost.
    """
    try:
        from distributed import Client
    except ImportError as error:
        remedy = "Install it: pip install 'seqrsm[cluster]'"
        raise UserError("running on a cluster needs the package distributed", remedy, field="cluster") from error
    contents = _contents(files)
    try:
        client: Any = Client(address, timeout=f"{CONNECT_S}s", set_as_default=False)
    except (OSError, ValueError) as error:
        remedy = "Start a scheduler there (dask scheduler), or correct the address"
        raise UserError(f"no cluster responds: {error}", remedy, field="cluster", value=address) from error
    try:
        if contents:
            _send_files(client, contents)
        killers = yield from _run_all(client, function, dict(enumerate(arguments)))
        for index, reason in sorted(killers.items()):
            killed: Collection[int] = (index,)
            if _has_worker(client):
                killed = yield from _run_all(client, function, {index: arguments[index]})
            if killed:
                yield index, Lost(reason)
    except _RunError as found:
        raise found.error from found.error.__cause__
    except (OSError, CancelledError) as error:
        text = "the connection to the cluster was lost during runs"
        raise UserError(text, "Restart it; finished runs are kept", field="cluster", value=address) from error
    finally:
        client.close()


@dataclass(frozen=True, slots=True)
class Lost:
    """Takes the place of a result: the processes that ran this argument died, again and again."""

    reason: str


class _RunError(Exception):
    """Carries what a run raised past what is made of errors of the connection, which may be of the same class."""

    def __init__(self, error: Exception) -> None:
        super().__init__(error)
        self.error = error


def _run_all(
    client: Any, function: Callable[[A], R], arguments: dict[int, A]
) -> Generator[tuple[int, R], None, dict[int, str]]:
    """Yield results as they complete; return the indices whose workers died again and again, each with the reason.

    A connection that is lost cancels every future: `CancelledError`. A cluster that stands still is given up after
    `MAX_STANDSTILLS`: `UserError`. What a run raises comes as `_RunError`.
    """
    missing = dict(arguments)
    killed: dict[int, str] = {}
    standstills = 0
    while missing:
        before = len(missing)
        yield from _run_until_still(client, function, missing, killed)
        standstills = standstills + 1 if len(missing) == before else 0
        if standstills == MAX_STANDSTILLS:
            text = "the cluster is idle: runs are waiting, but no worker is active"
            remedy = "Start workers, or look at the scheduler's log; finished runs are kept"
            raise UserError(text, remedy, field="cluster", value=client.scheduler.address)
    return killed


def _run_until_still(
    client: Any, function: Callable[[A], R], missing: dict[int, A], killed: dict[int, str]
) -> Iterator[tuple[int, R]]:
    """Run what is missing and take out what is done, until all is done or no worker has anything to do.

    A run may take as long as it likes. What is lost with its worker the scheduler makes again, if it has another: one
    whose workers do not come back (a `LocalCluster` gives up those that stay away for 15 s) would wait for ever.
    """
    from distributed import KilledWorker

    # pure=False: equal arguments are runs of their own, never looked up in the cluster's memory.
    futures = {index: client.submit(function, argument, pure=False) for index, argument in missing.items()}
    quiet_since = time.monotonic()
    try:
        while futures:
            before = len(futures)
            for index in list(futures):
                # Looked at anew each time: "finished" becomes "lost", and "finished" again, as workers die.
                if futures[index].status not in ("finished", "error", "cancelled"):
                    continue
                try:
                    result: R = futures[index].result(timeout=CONNECT_S)
                except KilledWorker as error:
                    killed[index] = f"the workers that ran it died: {error}"
                    del futures[index], missing[index]
                except Exception as error:
                    if futures[index].status == "error":
                        raise _RunError(error) from error
                    if not isinstance(error, TimeoutError):  # else its worker died before it was fetched
                        raise
                else:
                    del futures[index], missing[index]  # let go of: the scheduler need not make it again
                    yield index, result
            if len(futures) < before:
                quiet_since = time.monotonic()
            elif time.monotonic() - quiet_since < PATIENCE_S:
                time.sleep(POLL_S)
            elif _is_at_work(client):
                quiet_since = time.monotonic()
            else:
                return
    finally:
        for future in futures.values():
            if not future.done():
                future.cancel()


def _is_at_work(client: Any) -> bool:
    """Whether any worker has something to do, whoever sent it; `TimeoutError` if the scheduler does not answer."""
    tasks = client.sync(client.scheduler.processing, workers=None, callback_timeout=CONNECT_S)
    return any(tasks.values())


def _has_worker(client: Any) -> bool:
    """Whether a worker is there, or comes back, within `CONNECT_S`."""
    try:
        client.wait_for_workers(1, timeout=CONNECT_S)
    except TimeoutError:
        return False
    return True


def _contents(files: Collection[str]) -> dict[str, bytes]:
    """What the files hold, by their paths."""
    found = {}
    for path in sorted(files):
        try:
            found[path] = Path(path).read_bytes()
        except OSError as error:
            problem = Problem(f"a file that runs need cannot be read: {error.strerror}", file=path)
            raise UserError(problem) from error
    return found


def _send_files(client: Any, contents: dict[str, bytes]) -> None:
    """Give the files to every worker that is there or will come; what the scheduler has already is not sent again."""
    from distributed import WorkerPlugin

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


def run_many(
    function: Callable[[A], R],
    arguments: Sequence[A],
    workers: int = 1,
    progress: Callable[[int, int], None] | None = None,
    cluster: str | None = None,
    files: Collection[str] = (),
) -> Iterator[tuple[int, R | Lost]]:
    """Apply a function to every argument and yield results as they complete, each with the index of its argument.

    An exception of the function ends the runs and reaches the caller. After that, and after an interrupt or when the
    iterator is closed, no run begins; what is under way is not waited for, and what it returns is lost.

    Parameters
    ----------
    function : callable
        Several threads call it at once when ``workers > 1``; importable by name for a cluster.
    workers : int
        Runs at the same time on this machine, each in a thread; 1 runs in the caller's own.
    progress : callable, optional
        Called with (finished, all) after each run.
    cluster : str, optional
        Address of a dask scheduler, such as ``"tcp://head:8786"``: the runs go there and `workers` is not used. Results
        may then be `Lost`.
    files : collection of str
        Paths that the function reads; a cluster's workers get them once each and find them by `local_file`.

    Raises
    ------
    UserError
        The cluster cannot be reached, is lost or stands still, or its client library is not installed.
    """
    results: Iterator[tuple[int, R | Lost]]
    if cluster is not None:
        results = run_on_cluster(function, arguments, cluster, files)
    elif workers == 1 or len(arguments) <= 1:
        results = ((index, function(argument)) for index, argument in enumerate(arguments))
    else:
        results = _run_in_threads(function, arguments, workers)
    for finished, result in enumerate(results, start=1):
        if progress is not None:
            progress(finished, len(arguments))
        yield result


def do_all(do: Callable[[int], object], n: int, threads: int) -> None:
    """Call ``do(k)`` for all k < n, by that many threads."""
    for _ in run_many(do, range(n), threads):
        pass


def _run_in_threads(function: Callable[[A], R], arguments: Sequence[A], workers: int) -> Iterator[tuple[int, R]]:
    waiting = iter(enumerate(arguments))  # taking the next is one step of the interpreter: none is taken twice
    left = Event()
    done: SimpleQueue[tuple[int, R] | BaseException] = SimpleQueue()

    def work() -> None:
        try:
            for index, argument in takewhile(lambda _: not left.is_set(), waiting):
                done.put((index, function(argument)))
        except BaseException as error:
            done.put(error)

    try:
        for _ in range(min(workers, len(arguments))):
            Thread(target=work, daemon=True).start()  # daemons: an interrupted command need not wait for them
        for _ in arguments:
            result = done.get()
            if isinstance(result, BaseException):
                raise result
            yield result
    finally:
        left.set()
