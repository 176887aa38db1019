"""Where a table of scores or rankings comes from: a file of text, a spreadsheet, a Parquet file, or a DataFrame.

Whatever it is becomes text in CSV first, so that all are read by the same rules, and a table that comes again is known
by its hash.
"""

from __future__ import annotations

import csv
import hashlib
import io
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from seqrsm.errors import Problem, ScoresFileError

if TYPE_CHECKING:
    from pandas import DataFrame

    TableSource: TypeAlias = "Path | str | DataFrame | TableText"

#: The largest file that is read [bytes]; a campaign's scores are some kilobytes.
MAX_BYTES = 10_000_000

_NEEDS = {".xlsx": ("openpyxl", "excel"), ".parquet": ("pyarrow", "parquet")}
"""Of the kinds of files that are no text: the library that reads them, and our extra that brings it."""


@dataclass(frozen=True, slots=True)
class TableText:
    """A table as text: its name for messages, SHA-256 of what it was read from, and its bytes."""

    name: str
    sha256: str
    data: bytes


def table_text(source: TableSource) -> TableText:
    """Text of a table.

    Parameters
    ----------
    source : Path, str, DataFrame or TableText
        A file of at most `MAX_BYTES`: ``.xlsx`` (one sheet; needs openpyxl), ``.parquet`` (needs pyarrow), anything
        else is text. Of a DataFrame the columns count, and an index that has a name; its header is line 1.

    Raises
    ------
    ScoresFileError
        Absent, too large, not to be read, or a library is missing.
    """
    if isinstance(source, TableText):
        return source
    if not isinstance(source, (Path, str)):
        data = _csv_of(_rows_of(source))
        return TableText("DataFrame", hashlib.sha256(data).hexdigest(), data)
    path = Path(source)
    raw = _read_bytes(path)
    kind = path.suffix.lower()
    text = _csv_of(_foreign_rows(path, kind)) if kind in _NEEDS else raw
    return TableText(path.name, hashlib.sha256(raw).hexdigest(), text)


def _rows_of(frame: DataFrame) -> Iterable[Iterable[Any]]:
    if any(name is not None for name in frame.index.names):
        frame = frame.reset_index()
    yield map(str, frame.columns)
    yield from frame.to_numpy(dtype=object)


def _foreign_rows(path: Path, kind: str) -> Iterable[Iterable[Any]]:
    """Rows of a spreadsheet or a Parquet file, its header first."""
    library, extra = _NEEDS[kind]
    try:
        __import__(library)
        import pandas as pd

        if kind == ".parquet":
            return list(_rows_of(pd.read_parquet(path)))
        sheets = pd.read_excel(path, sheet_name=None, header=None, dtype=object, keep_default_na=False)
    except ImportError:
        remedy = f"Install it: pip install 'seqrsm[{extra}]', or save the table as CSV in UTF-8."
        raise ScoresFileError(Problem(f"a {kind} file needs {library}", remedy, file=str(path))) from None
    except Exception as error:  # the libraries raise whatever they like over a broken file
        remedy = "Save it anew, or as CSV in UTF-8."
        raise ScoresFileError(Problem(f"the file cannot be read: {error}", remedy, file=str(path))) from None
    full = {name: sheet for name, sheet in sheets.items() if not sheet.empty}
    if len(full) > 1:
        message = f"the workbook has {len(full)} sheets with content: {', '.join(map(str, full))}"
        raise ScoresFileError(Problem(message, "Leave the one with the scores.", file=str(path)))
    return [row for sheet in full.values() for row in sheet.to_numpy(dtype=object)]


def _csv_of(rows: Iterable[Iterable[Any]]) -> bytes:
    stream = io.StringIO(newline="")
    csv.writer(stream, lineterminator="\n").writerows(map(_cell, row) for row in rows)
    return stream.getvalue().encode("utf-8")


def _cell(value: Any) -> str:
    """Text of a cell, numbers to their last digit; what is missing, None, nan or NaT, is empty."""
    if value is None or (value != value) is not False:  # nan is not a number, NA not even comparable
        return ""
    if isinstance(value, datetime) and value.time() == datetime.min.time():
        return value.date().isoformat()
    item = getattr(value, "item", None)  # numpy's own scalars print their type
    return str(item() if callable(item) else value)


def _read_bytes(path: Path) -> bytes:
    """Bytes of a file of at most `MAX_BYTES`; ScoresFileError when it is absent, larger, or cannot be read."""
    if not path.is_file():
        raise ScoresFileError(Problem("there is no such file", "Check the name.", file=str(path)))
    size = path.stat().st_size
    if size > MAX_BYTES:
        remedy = f"A file of scores has at most {MAX_BYTES // 1_000_000} MB; split it."
        raise ScoresFileError(Problem(f"the file has {size / 1e6:.1f} MB", remedy, file=str(path)))
    try:
        return path.read_bytes()
    except OSError as error:
        raise ScoresFileError(Problem(f"the file cannot be read: {error.strerror}", file=str(path))) from None
