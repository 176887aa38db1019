"""Put files in place at once, so that a reader never sees half of one."""

from __future__ import annotations

import json
import os
from contextlib import suppress
from pathlib import Path
from typing import Any

from seqrsm.errors import Problem, UserError
from seqrsm.plain import plain


def put_json(path: Path, document: Any) -> Path:
    """Write a document of plain values, see `seqrsm.plain`, as `put` does, its folder made."""
    return put(path, json.dumps(plain(document), indent=1).encode("utf-8"), make_folder=True)


def see_free(*paths: Path) -> None:
    """Refuse a file that is there already: somebody may have worked on it.

    Raises
    ------
    UserError
        For each that is.
    """
    taken = [Problem("the file exists already", "Name a new file.", file=str(path)) for path in paths if path.exists()]
    if taken:
        raise UserError(*taken)


def put(path: Path, data: bytes, *, make_folder: bool = False) -> Path:
    """Write ``data`` to a neighbouring file and rename it.

    Raises
    ------
    UserError
        The place cannot be written, or its folder is not there and is not to be made.
    """
    draft = path.with_name(f".{path.name}.{os.getpid()}.draft")
    try:
        if make_folder:
            path.parent.mkdir(parents=True, exist_ok=True)
        draft.write_bytes(data)
        draft.replace(path)
    except OSError as error:
        raise UserError(
            f"the file cannot be written: {error.strerror}", "Name another place.", file=str(path)
        ) from error
    finally:
        with suppress(OSError):
            draft.unlink(missing_ok=True)
    return path
