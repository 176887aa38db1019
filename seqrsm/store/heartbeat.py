"""A process that holds runs says now and then that it is alive, so that another host may tell when it died."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from seqrsm.errors import StoreError
from seqrsm.store.store import Store

BEAT_S = 60.0
"""Much less than `seqrsm.store.store.LEASE_S`."""


@contextmanager
def heartbeat(store: Store, every_s: float = BEAT_S) -> Iterator[None]:
    """Let a thread say every ``every_s`` [s] that this process is alive while the block runs."""
    done = threading.Event()

    def beat() -> None:
        while not done.wait(every_s):
            with suppress(StoreError):  # a busy or absent data base: the next beat may get through
                store.beat()

    thread = threading.Thread(target=beat, daemon=True, name="heartbeat")
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join(timeout=5.0)
