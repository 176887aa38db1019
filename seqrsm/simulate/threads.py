"""Threads that share the work on one image; the kernels and numpy's functions let go of the interpreter's lock."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor


def in_threads(do: Callable[[int], None], n: int, threads: int) -> None:
    """Call ``do(k)`` for k < n, by that many threads, the caller's among them."""
    todo = iter(range(n))

    def work() -> None:
        # Taking the next number is one step of the interpreter, so no number is taken twice.
        for k in todo:
            do(k)

    if threads == 1 or n == 1:
        work()
        return
    with ThreadPoolExecutor(min(threads, n) - 1) as pool:
        others = [pool.submit(work) for _ in range(min(threads, n) - 1)]
        work()
        for other in others:
            other.result()


def block(k: int, n_rows: int, parts: int) -> tuple[slice, slice]:
    """Channel and rows of the k-th piece of work on ``parts`` pieces a channel: contiguous in memory."""
    channel, part = divmod(k, parts)
    return slice(channel, channel + 1), slice(part * n_rows // parts, (part + 1) * n_rows // parts)
