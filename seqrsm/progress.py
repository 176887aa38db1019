"""Progress of long work: whoever works tells, whoever listens hears. Without a listener nothing happens.

The statistics know no terminal, and the command line knows neither how many steps a sampler needs nor how many local
searches a design; this is where they meet without handing a call-back through every function between them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

Listener = Callable[[str, int, int], None]

_listener: ContextVar[Listener | None] = ContextVar("listener", default=None)


def silent(*_: object) -> None:
    """Call-back that does nothing, for work whose progress nobody follows."""


def tell(what: str, done: int, total: int) -> None:
    """``done`` of ``total`` pieces of ``what`` are done; the total is the best guess at this moment."""
    listener = _listener.get()
    if listener is not None:
        listener(what, done, total)


@contextmanager
def listening(listener: Listener | None) -> Iterator[None]:
    """Hear what is told inside the block, in this thread; None: nobody does."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)
