"""Reading of the scattering tables: CSV with a header, comment lines that begin with #, every fault with its place."""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final, TypeVar

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.csv_lines import read_cells
from seqrsm.errors import Problem, ScatteringDataError

STATUSES: Final = ("public", "public_code", "public_code_refit", "measured", "computed", "assumed")
"""What a row may rest on: a publication or public code, a measurement, a computation, or an assumption."""

POLARIZATIONS: Final = ("HH", "HV", "VV")
"""Channels of a table, in the order of its arrays; VH is HV."""

DATA: Final = Path(__file__).parent / "data"
"""Folder of the shipped tables."""

COVER: Final = "cover"
"""Field of a problem that lies with the name of a ground cover."""

K = TypeVar("K", bound=Hashable)
T = TypeVar("T")


def unknown_covers(quantity: str, known: Sequence[str], file: str, names: Iterable[str]) -> list[Problem]:
    """Each cover that a table of this quantity has not; what the table has is told with the last."""
    missing = [name for name in dict.fromkeys(names) if name not in known]
    has = f"The table has: {', '.join(known)}. Give a cover one of these names in the scene's legend, or its "
    has += "rows in a table of your own"
    problems = []
    for name in missing:
        near = difflib.get_close_matches(name.capitalize(), known, n=1)
        remedies = [*(f"Did you mean {one}?" for one in near), *[has] * (name == missing[-1])]
        text = f"no {quantity} of this ground cover"
        problems.append(Problem(text, " ".join(remedies), file or None, field=COVER, value=name))
    return problems


@dataclass(frozen=True, slots=True)
class Row:
    """One line of a table."""

    file: str
    """Name of the file."""
    line: int
    """1-based line number."""
    cells: Mapping[str, str]
    """Text by column."""

    def text(self, column: str) -> str:
        """Text of a column, "" if the table lacks it."""
        return self.cells.get(column, "")

    def problem(self, column: str, message: str, remedy: str = "") -> Problem:
        """Problem at this line and column."""
        return Problem(message, remedy, self.file, self.line, column, self.text(column))

    def number(self, column: str, problems: list[Problem], low: float, high: float) -> float:
        """Number of a column between ``low`` and ``high``; a fault is appended to ``problems`` and gives nan."""
        try:
            value = float(self.text(column))
        except ValueError:
            value = math.nan
        if not low <= value <= high:
            remedy = "Use a decimal point" if "," in self.text(column) else ""
            problems.append(self.problem(column, f"not a number from {low:g} to {high:g}", remedy))
            return math.nan
        return value

    def choice(self, column: str, problems: list[Problem], choices: Sequence[str]) -> str:
        """Text of a column, which must be one of ``choices``."""
        value = self.text(column)
        if value not in choices:
            problems.append(self.problem(column, "unknown or missing", f"One of: {', '.join(choices)}"))
        return value


def read_rows(path: str | Path, required: Sequence[str], optional: Sequence[str] = ()) -> list[Row]:
    """Rows of a CSV file (`seqrsm.csv_lines.read_cells`) with columns that must and that may be there.

    ScatteringDataError: no such file, wrong columns, or a line with a wrong number of cells.
    """
    file = str(path)
    lines = read_cells(path, "the table", ScatteringDataError)
    if not lines:
        raise ScatteringDataError("the table is empty", f"Columns: {', '.join(required)}", file=file)
    (first, header), *rows = lines
    known = [*required, *optional]
    problems = [Problem("the column is missing", "", file, first, name) for name in required if name not in header]
    remedy = f"Known: {', '.join(known)}"
    problems += [Problem("no such column", remedy, file, first, name) for name in header if name not in known]
    width = len(header)
    problems += [
        Problem(f"{len(own)} cells, the header has {width}", "", file, line) for line, own in rows if len(own) != width
    ]
    if problems:
        raise ScatteringDataError(*problems)
    return [Row(file, line, dict(zip(header, own, strict=True))) for line, own in rows]


def for_each(keys: Iterable[K], find: Callable[[K], T], unknown: Sequence[Problem] = ()) -> dict[K, T]:
    """What is found for each category or the like, repeats once.

    ScatteringDataError with the problems of all, those of ``unknown`` ones, which are not looked for, too.
    """
    found: dict[K, T] = {}
    problems = list(unknown)
    left = {problem.value for problem in unknown}
    for key in (one for one in dict.fromkeys(keys) if one not in left):
        try:
            found[key] = find(key)
        except ScatteringDataError as error:
            problems += error.problems
    if problems:
        raise ScatteringDataError(*dict.fromkeys(problems))
    return found


@cache
def shipped_rows(name: str) -> tuple[Row, ...]:
    """Rows of one of the package's own tables, read once."""
    (_, header), *lines = read_cells(DATA / name, name, ScatteringDataError)
    return tuple(Row(name, line, dict(zip(header, cells, strict=True))) for line, cells in lines)


def numbers_of(name: str, columns: Sequence[str]) -> FloatArray:
    """Numbers (n, columns) of one of the package's own tables."""
    return np.array([[float(row.text(column)) for column in columns] for row in shipped_rows(name)])
