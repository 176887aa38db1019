"""Tables of scores, rankings and maps as text cells, with the line on which each row begins.

They come as a file of text, a spreadsheet, a Parquet file, or a DataFrame. Whatever it is becomes text in CSV first, so
that all are read by the same rules, and a table that comes again is known by its hash.
"""

from __future__ import annotations

import csv
import hashlib
import io
import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias
from warnings import catch_warnings

from seqrsm.errors import ScoresFileError
from seqrsm.files import csv_text

if TYPE_CHECKING:
    from pandas import DataFrame

TableSource: TypeAlias = "Path | str | DataFrame | TableText"

#: The largest file that is read [bytes]; a campaign's scores are some kilobytes.
MAX_BYTES = 10_000_000

#: Name of a table that comes from memory.
IN_MEMORY = "DataFrame"

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

    A file has at most `MAX_BYTES`: ``.xlsx`` (one sheet; needs openpyxl), ``.parquet`` (needs pyarrow), anything else
    is text. Of a DataFrame the columns count, and an index that has a name; its header is line 1.

    Raises
    ------
    ScoresFileError
        Absent, too large, not to be read, or a library is missing.
    """
    if isinstance(source, TableText):
        return source
    if not isinstance(source, (Path, str)):
        if not hasattr(source, "to_numpy") or not hasattr(source, "columns"):
            remedy = "Give a pandas DataFrame, or the name of a file."
            raise ScoresFileError("this is no table", remedy, value=type(source).__name__)
        data = _csv_of(_rows_of(source))
        return TableText(IN_MEMORY, hashlib.sha256(data).hexdigest(), data)
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
        if kind == ".parquet":
            import pandas as pd

            __import__(library)
            return list(_rows_of(pd.read_parquet(path)))
        from openpyxl import load_workbook

        # Cells as last computed: pandas would make a missing value of an error such as #DIV/0!.
        with catch_warnings(action="ignore"):  # of what is not read, such as rules for what a cell may hold
            book = load_workbook(path, data_only=True)
    except ImportError:
        remedy = f"Install it: pip install 'seqrsm[{extra}]', or save the table as CSV in UTF-8."
        raise ScoresFileError(f"a {kind} file needs {library}", remedy, file=str(path)) from None
    except Exception as error:  # the libraries raise whatever they like over a broken file
        remedy = "Save it anew, or as CSV in UTF-8."
        raise ScoresFileError(f"the file cannot be read: {error}", remedy, file=str(path)) from None
    sheets = {sheet.title: list(sheet.values) for sheet in book.worksheets}
    full = {name: rows for name, rows in sheets.items() if any(cell is not None for row in rows for cell in row)}
    if len(full) > 1:
        message = f"the workbook has {len(full)} sheets with content: {', '.join(full)}"
        raise ScoresFileError(message, "Leave the one with the scores.", file=str(path))
    return next(iter(full.values()), [])


def _csv_of(rows: Iterable[Iterable[Any]]) -> bytes:
    return csv_text((map(_cell, row) for row in rows), "\n").encode("utf-8")


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
        raise ScoresFileError("there is no such file", "Check the name.", file=str(path))
    size = path.stat().st_size
    if size > MAX_BYTES:
        remedy = f"A file of scores has at most {MAX_BYTES // 1_000_000} MB; split it."
        raise ScoresFileError(f"the file has {size / 1e6:.1f} MB", remedy, file=str(path))
    try:
        return path.read_bytes()
    except OSError as error:
        raise ScoresFileError(f"the file cannot be read: {error.strerror}", file=str(path)) from None


DELIMITERS = (",", ";", "\t", "|")

_BEGINNINGS = (
    (b"\xff\xfe", "the file is UTF-16 text"),
    (b"\xfe\xff", "the file is UTF-16 text"),
    (b"PK\x03\x04", "the file is a spreadsheet or an archive, not text"),
    (b"\xd0\xcf\x11\xe0", "the file is an old spreadsheet, not text"),
    (b"\x1f\x8b", "the file is compressed"),
)
_SAVE_AS = "Save it as CSV in UTF-8; spreadsheets call it 'CSV UTF-8'."


@dataclass(frozen=True, slots=True)
class Table:
    """Cells as written."""

    name: str
    """Of the file, for messages."""
    delimiter: str
    """One of ",", ";", tab and "|"."""
    header_line: int
    """1-based line of the header."""
    header: tuple[str, ...]

    rows: tuple[tuple[int, tuple[str, ...]], ...]
    """First line and cells of each row that is not blank."""


def read_table(name: str, data: bytes, is_known: Callable[[str], bool]) -> Table:
    """Read the bytes of a CSV file, UTF-8 with or without a byte order mark, any line ends; ``name`` is for messages.

    ``is_known`` tells whether a header cell is a column that the caller wants; the separator that yields most of them
    is taken. ScoresFileError: empty, not UTF-8, not a table.
    """
    text = _decode(name, data)
    if not text.strip():
        raise ScoresFileError("the file is empty", "Give a header and a row for each score.", file=name)

    text = _without_preamble(text, is_known)

    def merit(delimiter: str) -> tuple[int, int]:
        header = next(_records(name, text, delimiter, lenient=True), (1, ()))[1]
        return sum(is_known(cell) for cell in header), len(header)

    delimiter = max(DELIMITERS, key=merit)
    (header_line, header), *rows = list(_records(name, text, delimiter)) or [(1, ())]
    return Table(name, delimiter, header_line, header, tuple(rows))


def _without_preamble(text: str, is_known: Callable[[str], bool]) -> str:
    """The text with the lines before its header made blank: a spreadsheet's ``sep=;`` and comments after ``#``."""
    lines = text.splitlines(keepends=True)
    for number, line in enumerate(lines):
        bare = line.strip()
        comment = bare.startswith("#") and not any(is_known(cell) for cell in re.split("[,;\t|]", bare))
        if bare and not comment and not re.fullmatch(r'"?sep=[,;\t]?"?', bare, re.IGNORECASE):
            break
        lines[number] = "\n"
    return "".join(lines)


def _decode(name: str, data: bytes) -> str:
    for beginning, message in _BEGINNINGS:
        if data.startswith(beginning):
            raise ScoresFileError(message, _SAVE_AS, file=name, line=1)
    if b"\0" in data:
        line = data.count(b"\n", 0, data.index(b"\0")) + 1
        message = "the file holds zero bytes: it is UTF-16 without a mark, or not text"
        raise ScoresFileError(message, _SAVE_AS, file=name, line=line)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        message = "the file is not UTF-8 text, perhaps Latin-1 (Windows-1252)"
        raise ScoresFileError(
            message, _SAVE_AS, file=name, line=line, value=data[error.start : error.start + 1]
        ) from None


def _records(name: str, text: str, delimiter: str, *, lenient: bool = False) -> Iterator[tuple[int, tuple[str, ...]]]:
    """Rows that are not blank, each with its first line; ``lenient``: end at a broken row without an error."""
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter, strict=True)
    while True:
        line = reader.line_num + 1
        try:
            cells = next(reader)
        except StopIteration:
            return
        except csv.Error as error:
            if lenient:
                return
            remedy = 'Close every quote, and write a quote inside a quoted cell twice: "".'
            raise ScoresFileError(f"the row cannot be read: {error}", remedy, file=name, line=line) from None
        if any(cell.strip() for cell in cells):
            yield line, tuple(cells)
