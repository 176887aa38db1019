"""The one numba decorator of the package and the place of its compile cache.

numba's file cache does not see an edit in another file, so kernels call those of kernel files alone, and the cache
folder is named by the version of the package and the content of all of them: an edited or upgraded kernel never meets a
stale binary. What lies there is run when it is read, so nobody else may be able to write it.
"""

from __future__ import annotations

import gc
import hashlib
import os
import stat
import sys
import tempfile
from collections.abc import Callable
from contextlib import suppress
from functools import cached_property, update_wrapper
from pathlib import Path
from typing import Any, TypeVar, cast

from seqrsm import __version__

PACKAGE = Path(__file__).parent
_KERNEL_FILES = "**/kernels*.py"

F = TypeVar("F", bound=Callable[..., Any])


def cache_root() -> Path | None:
    """Folder of the user's own for what can be made again: in the user's cache, else in the temporary folder, or none.

    Nobody else may open it: it is made with mode 700, and one that another user owns or may write into is not used.
    """
    places = [Path(tempfile.gettempdir()) / f"seqrsm-{getattr(os, 'getuid', int)()}"]
    with suppress(RuntimeError):  # there is no home
        places.insert(0, Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "seqrsm")
    return next((place for place in places if _is_own(place)), None)


def _is_own(folder: Path) -> bool:
    """Whether a folder, made where there is none, is the user's alone and can be written."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = folder.lstat()  # a link may lead anywhere
        if sys.platform != "win32":  # where a user's folders are private by the system's own lists of rights
            if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.geteuid() or found.st_mode & 0o022:
                return False
            folder.chmod(0o700)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def cache_directory() -> Path | None:
    """Folder of the compiled kernels, unique to this version and content; None where they cannot be kept safely."""
    digest = hashlib.sha256()
    for path in sorted(PACKAGE.glob(_KERNEL_FILES)):
        digest.update(path.read_bytes())
    root = cache_root()
    return None if root is None else root / f"kernels-{__version__}-{digest.hexdigest()[:12]}"


class _Kernel:
    """A function that is compiled when it is first called, or first met within another that is."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function

    @cached_property
    def compiled(self) -> Any:
        """What numba makes of it."""
        if "NUMBA_CACHE_DIR" not in os.environ and (folder := cache_directory()) is not None:
            os.environ["NUMBA_CACHE_DIR"] = str(folder)
        import numba

        gc.freeze()  # compiling makes so many objects that all those of libraries would be searched again and again
        # No entry for C, which nobody calls, nor for Python into what only kernels call: a sixth less to compile.
        within = self._function.__name__.startswith("_")
        options: Any = {
            "cache": "NUMBA_CACHE_DIR" in os.environ and not within,
            "nogil": True,
            "error_model": "numpy",
            "no_cfunc_wrapper": True,
            "no_cpython_wrapper": within,
        }
        return numba.njit(**options)(self._function)

    @property
    def _numba_type_(self) -> Any:
        """Type that numba gives a global of a kernel."""
        return self.compiled._numba_type_

    def __call__(self, *arguments: Any) -> Any:
        return self.compiled(*arguments)


def kernel(function: F) -> F:
    """Compile ``function`` with numba: cached on disk where it is safe, no interpreter lock, IEEE arithmetic kept.

    ``error_model="numpy"`` lets a division by zero give inf or nan instead of raising, as in numpy; no fast-math flag
    is set, so results are the same bits for any vector width. numba takes longer to load than a fit, so that it is
    loaded when a kernel is first called.
    """
    return cast(F, update_wrapper(_Kernel(function), function))
