"""A table of text cells from the bytes of a CSV file, with the line on which each row begins."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from seqrsm.errors import Problem, ScoresFileError

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
    """Cells as written.

    Attributes
    ----------
    name : str
        Of the file, for messages.
    delimiter : str
        "," or ";" or tab or "|".
    header_line : int
        1-based line of the header.
    header : tuple of str
    rows : tuple of (int, tuple of str)
        First line and cells of each row that is not blank.
    """

    name: str
    delimiter: str
    header_line: int
    header: tuple[str, ...]
    rows: tuple[tuple[int, tuple[str, ...]], ...]


def read_table(name: str, data: bytes, is_known: Callable[[str], bool]) -> Table:
    """Read the bytes of a CSV file.

    Parameters
    ----------
    name : str
        File name, for messages.
    data : bytes
        UTF-8, with or without a byte order mark; any line ends.
    is_known : callable
        Whether a header cell is a column that the caller wants; the separator that yields most of them is taken.

    Raises
    ------
    ScoresFileError
        Empty, not UTF-8, not a table.
    """
    text = _decode(name, data)
    if not text.strip():
        raise ScoresFileError(Problem("the file is empty", "Give a header and a row for each score.", file=name))

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
            raise ScoresFileError(Problem(message, _SAVE_AS, file=name, line=1))
    if b"\0" in data:
        line = data.count(b"\n", 0, data.index(b"\0")) + 1
        message = "the file holds zero bytes: it is UTF-16 without a mark, or not text"
        raise ScoresFileError(Problem(message, _SAVE_AS, file=name, line=line))
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        message = "the file is not UTF-8 text, perhaps Latin-1 (Windows-1252)"
        raise ScoresFileError(
            Problem(message, _SAVE_AS, file=name, line=line, value=data[error.start : error.start + 1])
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
            raise ScoresFileError(Problem(f"the row cannot be read: {error}", remedy, file=name, line=line)) from None
        if any(cell.strip() for cell in cells):
            yield line, tuple(cells)
