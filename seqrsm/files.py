"""Put files in place at once, so that a reader never sees half of one."""

from __future__ import annotations

import csv
import io
import json
import os
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO, Any

from seqrsm.errors import Problem, UserError
from seqrsm.plain import plain


def put_json(path: Path, document: Any) -> Path:
    """Write a document of plain values, see `seqrsm.plain`, as `put` does, its folder made."""
    return put(path, json.dumps(plain(document), indent=1).encode("utf-8"), make_folder=True)


def get_json(path: Path) -> Any:
    """What `put_json` wrote; None where there is no such file, or it holds no JSON."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None


def csv_text(rows: Iterable[Iterable[object]], end: str = "\r\n") -> str:
    """Rows, the header among them, as CSV, each line with this ``end``; None is an empty cell."""
    stream = io.StringIO(newline="")
    csv.writer(stream, lineterminator=end).writerows(rows)
    return stream.getvalue()


def see_free(*paths: Path) -> None:
    """Refuse a file that is there already, as somebody may have worked on it, or that could not be written."""
    taken = [Problem("the file exists already", "Name a new file.", file=str(path)) for path in paths if path.exists()]
    if taken:
        raise UserError(*taken)
    see_writable(*paths)


def see_writable(*paths: Path, make_folder: bool = False) -> None:
    """Refuse, as `put` does, what it could not write, before the work whose result is to be written."""
    for path in paths:
        folder = path.absolute().parent
        while make_folder and not folder.exists():
            folder = folder.parent
        try:
            with TemporaryFile(dir=folder):
                pass
            if path.is_dir():
                raise IsADirectoryError(None, "it is a folder")
        except OSError as error:
            raise _unwritable(path, error) from error


def put(path: Path, data: bytes | Callable[[IO[bytes]], object], *, make_folder: bool = False) -> Path:
    """Write ``data``, or what it writes itself, to a neighbouring file and rename it.

    Raises
    ------
    UserError
        The place cannot be written, or its folder is not there and is not to be made.
    """
    draft = path.with_name(f".{path.name}.{os.getpid()}.draft")
    try:
        if make_folder:
            path.parent.mkdir(parents=True, exist_ok=True)
        with draft.open("wb") as stream:
            stream.write(data) if isinstance(data, bytes) else data(stream)
        draft.replace(path)
    except OSError as error:
        raise _unwritable(path, error) from error
    finally:
        with suppress(OSError):
            draft.unlink(missing_ok=True)
    return path


def _unwritable(path: Path, error: OSError) -> UserError:
    remedy = "Its folder must exist and be writable; or name another place."
    return UserError(f"the file cannot be written: {error.strerror}", remedy, file=str(path))
