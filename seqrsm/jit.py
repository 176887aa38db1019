"""The one numba decorator of the package and the place of its compile cache.

numba's file cache does not see an edit in another file, so each kernel file is complete in itself and the cache folder
is named by the version of the package and the content of all kernel files: an edited or upgraded kernel never meets a
stale binary.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

from seqrsm import __version__

PACKAGE = Path(__file__).parent
_KERNEL_FILES = "**/kernels*.py"

F = TypeVar("F", bound=Callable[..., Any])


def cache_root() -> Path:
    """Folder of the user's own for what can be made again."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "seqrsm"


def cache_directory() -> Path:
    """Folder of the compiled kernels, unique to this version and content, writable or in the temporary folder."""
    digest = hashlib.sha256()
    for path in sorted(PACKAGE.glob(_KERNEL_FILES)):
        digest.update(path.read_bytes())
    folder = cache_root() / f"kernels-{__version__}-{digest.hexdigest()[:12]}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError:
        folder = Path(tempfile.gettempdir()) / f"seqrsm-{os.getuid()}" / folder.name
        folder.mkdir(parents=True, exist_ok=True)
    return folder


def kernel(function: F) -> F:
    """Compile ``function`` with numba: cached on disk, without the interpreter lock, IEEE arithmetic kept.

    ``error_model="numpy"`` lets a division by zero give inf or nan instead of raising, as in numpy; no fast-math flag
    is set, so results are the same bits for any vector width.
    """
    os.environ.setdefault("NUMBA_CACHE_DIR", str(cache_directory()))
    import numba

    # No entry for C, which nobody calls: a tenth less to compile.
    options: Any = {"cache": True, "nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}
    return cast(F, numba.njit(**options)(function))
