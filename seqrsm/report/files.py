"""Put files in place at once, so that a reader never sees half of one."""

from __future__ import annotations

from pathlib import Path

from seqrsm.errors import Problem, UserError


def put(path: Path, data: bytes) -> Path:
    """Write ``data`` to a neighbouring file and rename it; folders are made.

    Raises
    ------
    UserError
        The place cannot be written.
    """
    draft = path.with_name(f".{path.name}.draft")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        draft.write_bytes(data)
        draft.replace(path)
    except OSError as error:
        raise UserError(
            Problem(f"the file cannot be written: {error.strerror}", "Name another place.", file=str(path))
        ) from error
    return path
