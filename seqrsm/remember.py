"""What took long to compute, kept under all that it was made of: by a thread, by the process, or on this machine.

Objects kept on the machine are pickles, which can run code when they are read: they lie beside the compiled kernels in
the user's own cache, which nobody else may open, never in a campaign's folder, which may come from others.
"""

from __future__ import annotations

import hashlib
import pickle
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from functools import lru_cache, wraps
from importlib.metadata import version
from typing import ParamSpec, TypeVar, cast

from seqrsm.arrays import AnyArray
from seqrsm.errors import UserError
from seqrsm.files import put
from seqrsm.jit import PACKAGE, cache_root

P = ParamSpec("P")
T = TypeVar("T")

MOST_KEPT, MOST_RECALLED = 20, 8
"""On the machine, and in memory; the oldest go."""

_OF_A_KEY = 1000  # bytes, about
_recalled: dict[bytes, object] = {}


def remembered(make: Callable[[], T], made_of: object) -> T:
    """What ``make`` gives, which can be pickled, or gave before; the same bits either way.

    ``made_of`` is all that the result depends on but code, by its ``repr``.
    """
    root = cache_root()
    if root is None:
        return cast(T, pickle.loads(pickle.dumps(make())))
    folder = root / "kept"
    place = folder / f"{hashlib.sha256(f'{_code()} {made_of!r}'.encode()).hexdigest()}.pickle"
    with suppress(Exception):  # none, or a torn one
        return cast(T, pickle.loads(place.read_bytes()))
    data = pickle.dumps(make())
    with suppress(UserError, OSError):  # a place that cannot be written: it is made again next time
        put(place, data, make_folder=True)
        for old in sorted(folder.glob("*.pickle"), key=lambda file: file.stat().st_mtime)[:-MOST_KEPT]:
            old.unlink()
    return cast(T, pickle.loads(data))  # arrays that were views are none now, nor when it is read again


def recalled(make: Callable[[], T], made_of: object) -> T:
    """What ``make`` gives, or gave lately in this process: the same object.

    ``made_of`` is all that the result depends on, by its pickle.
    """
    key = pickle.dumps(made_of)
    if key not in _recalled:
        while len(_recalled) >= MOST_RECALLED:
            del _recalled[next(iter(_recalled))]
        _recalled[key] = make()
    return cast(T, _recalled[key])


def cached_by_thread(function: Callable[P, T]) -> Callable[P, T]:
    """Keep the last result, as `functools.lru_cache`, for each thread by itself: runs beside one do not push it out."""
    here = threading.local()

    @wraps(function)
    def call(*arguments: P.args, **named: P.kwargs) -> T:
        if not hasattr(here, "cached"):
            here.cached = lru_cache(maxsize=1)(function)
        return cast(T, here.cached(*arguments, **named))

    return call


def arrays_by_thread(most_bytes: int) -> Callable[[Callable[P, AnyArray]], Callable[P, AnyArray]]:
    """As `cached_by_thread`, of arrays: those asked for last, of so many bytes in all; the last however large it is."""

    def wrap(function: Callable[P, AnyArray]) -> Callable[P, AnyArray]:
        here = threading.local()

        @wraps(function)
        def call(*arguments: P.args, **named: P.kwargs) -> AnyArray:
            kept: dict[object, AnyArray] = here.__dict__.setdefault("kept", {})
            key = arguments, tuple(named.items())
            found = kept.pop(key, None)
            if found is None:
                found = function(*arguments, **named)
                here.size = getattr(here, "size", 0) + found.nbytes + _OF_A_KEY
            kept[key] = found  # behind all others
            while here.size > most_bytes and len(kept) > 1:
                here.size -= kept.pop(next(iter(kept))).nbytes + _OF_A_KEY
            return found

        return call

    return wrap


@lru_cache(maxsize=1)
def _code() -> str:
    """Digest of this package and its tables, with the versions of what it computes by."""
    digest = hashlib.sha256()
    for path in sorted((*PACKAGE.glob("**/*.py"), *PACKAGE.glob("**/*.csv"))):
        digest.update(path.read_bytes())
    return " ".join((digest.hexdigest(), sys.version, *(version(name) for name in ("numpy", "scipy", "emcee"))))
