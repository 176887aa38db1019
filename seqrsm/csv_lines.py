"""Small tables that users write by hand or by a spreadsheet: legends, scattering tables, targets, antenna patterns."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator
from pathlib import Path

from seqrsm.errors import UserError

_MAX_BYTES = 50_000_000

_DECIMAL_COMMA = re.compile(r"^([-+]?\d*),(\d+(?:[eE][-+]?\d+)?)$")


def read_cells(
    path: str | Path, what: str, error: type[UserError], field: str | None = None
) -> list[tuple[int, list[str]]]:
    """Line number and cells of each line of a CSV file that holds text and is no comment, which begins with #.

    Parameters
    ----------
    path : str or Path
        UTF-8 with or without byte-order mark. The header tells whether commas, semicolons or tabs separate cells; where
        commas do not, numbers may have a decimal comma, which becomes a point. Cells lose blanks at their ends.
    what, field : str
        What the file is and what names it, for messages.
    error : type
        Of what is raised: no such file, too large, not UTF-8, a quote that is left open.
    """
    file = str(path)
    try:
        if Path(path).stat().st_size > _MAX_BYTES:
            raise error(f"{what} is larger than {_MAX_BYTES / 1e6:.0f} MB", "Cut it", file=file, field=field)
        text = Path(path).read_text(encoding="utf-8-sig")
    except OSError as fault:
        raise error(f"cannot read {what}: {fault.strerror}", file=file, field=field) from fault
    except UnicodeDecodeError as fault:
        raise error(f"cannot read {what}: not UTF-8 text", "Save it as UTF-8", file=file, field=field) from fault
    return list(_cells(text, file, error))


def _cells(text: str, file: str, error: type[UserError]) -> Iterator[tuple[int, list[str]]]:
    delimiter = ""
    for number, line in enumerate(text.splitlines(), start=1):
        if line.strip() and not line.startswith("#"):
            delimiter = delimiter or max(",;\t", key=line.count)
            try:
                cells = [cell.strip() for cell in next(csv.reader([line], strict=True, delimiter=delimiter))]
            except csv.Error as fault:
                remedy = 'Close every quote on its line, and write a quote inside a quoted cell twice: "".'
                raise error(f"not a CSV line: {fault}", remedy, file=file, line=number) from fault
            if any(cells):
                yield number, cells if delimiter == "," else [_DECIMAL_COMMA.sub(r"\1.\2", cell) for cell in cells]
