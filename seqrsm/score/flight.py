"""Files of measured scores: what a flight crew or an interpreter hands in.

A table as text, UTF-8 with or without a byte order mark, cells separated by comma, semicolon or tab. One column for
each factor by its name, in natural units, and ``score``; optional ``run_id``, ``application``, ``se``, ``n`` and
``correct``, ``block``, ``source``, ``date``, ``note``; every other column is kept as metadata. A factor's column may
name its unit, ``frequency [MHz]`` or ``frequency (MHz)``, and is converted. Lines before the header that begin with
``#``, and a spreadsheet's ``sep=;``, are passed over. Where cells are separated by semicolon or tab, numbers may have a
decimal comma.

Nothing is guessed: what cannot be read for certain is an error with its line and column, and all errors come at once.
"""

from __future__ import annotations

import difflib
import hashlib
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from seqrsm.errors import Problem, ScoresFileError
from seqrsm.score.table import Table, read_table
from seqrsm.units import PARAMETER_UNITS

#: The largest file that is read [bytes]; a campaign's scores are some kilobytes.
MAX_BYTES = 10_000_000
MAX_PROBLEMS = 100
SOURCES = ("flight", "simulation")
OPTIONAL = ("run_id", "application", "score", "se", "n", "correct", "block", "source", "date", "note")

_HEADER = re.compile(r"\s*(?P<name>[^\[\]()]*?)\s*(?:[\[(]\s*(?P<unit>[^\[\]()]*?)\s*[\])])?\s*")
# What spreadsheets make of 1.5 or 5-1 where they take it for a day: "01. Mai", "5-Jan", "Mai 05", "2024-05-01".
_DATE = re.compile(
    r"\d{1,2}[. -]+[^\W\d_]{3,9}\.?([ -]\d{2,4})?|[^\W\d_]{3,9}[. -]+\d{2,4}|\d{1,4}([-/.])\d{1,2}\2\d{2,4}"
)
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?", re.ASCII)


@dataclass(frozen=True, slots=True)
class FactorColumn:
    """What the column of one factor must hold: numbers in ``unit``, or one of ``levels`` where these are given."""

    name: str
    unit: str = ""
    levels: tuple[str, ...] | None = None


@dataclass(frozen=True, slots=True)
class Measure:
    """An application whose scores may stand in the file; ``is_percent``: they are percentages from 0 to 100."""

    name: str
    is_percent: bool = False


@dataclass(frozen=True, slots=True)
class MeasuredScore:
    """One row of the file.

    Attributes
    ----------
    line : int
        1-based line of the file on which the row begins.
    run_id : int or None
        The proposal that the row carries out.
    application : str
        Name of the application.
    settings : dict
        Executed settings in the factors' own units, by factor name.
    score, se : float, float or None
        In score units; of a percentage with ``n`` and ``correct`` they are computed from the counts when not given.
    n, correct : int or None
        Binomial counts.
    block, source, date, note : str
        As written, "" where the file is silent.
    metadata : dict
        Every other column, as written.
    """

    line: int
    run_id: int | None
    application: str
    settings: dict[str, float | str]
    score: float
    se: float | None
    n: int | None
    correct: int | None
    block: str = ""
    source: str = ""
    date: str = ""
    note: str = ""
    metadata: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class ScoresFile:
    """A file that was read without errors.

    Attributes
    ----------
    name : str
        File name without its folder.
    sha256 : str
        Of the bytes.
    scores : tuple of MeasuredScore
        In the order of the file.
    unscored : tuple of int
        Lines of proposed runs (with a ``run_id``) whose score is still empty.
    """

    name: str
    sha256: str
    scores: tuple[MeasuredScore, ...]
    unscored: tuple[int, ...]


def read_scores(path: Path | str, factors: Sequence[FactorColumn], measures: Sequence[Measure]) -> ScoresFile:
    """Read a file of measured scores.

    Parameters
    ----------
    path : Path or str
        The file; at most `MAX_BYTES`.
    factors : sequence of FactorColumn
        Every factor must have its column.
    measures : sequence of Measure
        The campaign's applications; with one, the column ``application`` may be absent.

    Raises
    ------
    ScoresFileError
        With all problems, each with file, line, column, value and remedy (at most `MAX_PROBLEMS`).
    """
    place = Path(path)
    data = read_bytes(place)
    known = {*OPTIONAL, *(factor.name for factor in factors)}
    table = read_table(place.name, data, lambda text: split_header(text)[0] in known)
    reader = _Reader(table, factors, measures)
    scores, unscored = reader.rows()
    if reader.problems:
        more = len(reader.problems) - MAX_PROBLEMS
        rest = [Problem(f"and {more} more problems", file=place.name)] if more > 0 else []
        raise ScoresFileError(*reader.problems[:MAX_PROBLEMS], *rest)
    return ScoresFile(place.name, hashlib.sha256(data).hexdigest(), tuple(scores), tuple(unscored))


def binomial_percent(n: int, correct: int) -> tuple[float, float]:
    """Percentage of ``correct`` in ``n`` >= 1 and its binomial standard error, both in percent.

    The proportion in the error is kept half a count away from 0 and 1, where the formula would claim certainty.
    """
    p = min(max(correct / n, 0.5 / n), 1.0 - 0.5 / n)
    return 100.0 * correct / n, 100.0 * math.sqrt(p * (1.0 - p) / n)


def unit_factor(unit: str, wanted: str) -> float | None:
    """Number that turns a value in ``unit`` into ``wanted``; None when the table of units has no such pair."""
    if unit == wanted:
        return 1.0
    for entry in PARAMETER_UNITS.values():
        if unit in entry.accepted and wanted in entry.accepted:
            return entry.accepted[unit] / entry.accepted[wanted]
    return None


def read_bytes(path: Path) -> bytes:
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


def split_header(text: str) -> tuple[str, str]:
    """Name and unit of a header cell such as ``frequency [GHz]`` or ``frequency (GHz)``."""
    match = _HEADER.fullmatch(text)
    return (match["name"], match["unit"] or "") if match else (text.strip(), "")


def _rename_hint(factor: FactorColumn, free: Sequence[str]) -> str:
    """Which column may be the factor's; one whose name ends in a unit must keep it, or values change their meaning."""
    near = [name for name in free if name.casefold().startswith(factor.name.casefold())]
    near += difflib.get_close_matches(factor.name, free, n=1)
    if not near:
        return "Add it."
    rest = near[0][len(factor.name) :].strip(" _-./")
    units = [unit for entry in PARAMETER_UNITS.values() for unit in entry.accepted if factor.unit in entry.accepted]
    unit = next((unit for unit in units if unit and unit.casefold() == rest.casefold()), "")
    return f"Rename the column '{near[0]}' to '{factor.name}{f' [{unit}]' if unit else ''}'."


class _Reader:
    """Turns the cells of a table into scores and collects what is wrong."""

    def __init__(self, table: Table, factors: Sequence[FactorColumn], measures: Sequence[Measure]) -> None:
        self.table = table
        self.factors = factors
        self.measures = {measure.name: measure for measure in measures}
        self.problems: list[Problem] = []
        self.columns: dict[str, int] = {}
        self.scales: dict[str, float] = {}
        self.seen: dict[tuple[int, str], int] = {}
        self.decimal_signs: dict[str, int] = {}

    def add(self, message: str, remedy: str, line: int, column: str | None = None, value: object = None) -> None:
        self.problems.append(Problem(message, remedy, self.table.name, line, column, value))

    # -- header ---------------------------------------------------------------------------------------------------

    def header(self) -> None:
        line = self.table.header_line
        known = {*OPTIONAL, *(factor.name for factor in self.factors)}
        for index, text in enumerate(self.table.header):
            name, unit = split_header(text)
            if name not in known:  # a column of the user's own is kept under its full name, unit and all
                name, unit = text.strip(), ""
            if not name:
                if any(index < len(cells) and cells[index].strip() for _, cells in self.table.rows):
                    self.add(f"column {index + 1} has no name", "Name it in the first line, or remove it.", line)
            elif name in self.columns:
                self.add("two columns have this name", "Rename or remove one.", line, name)
            else:
                self.columns[name] = index
                self.unit(name, unit, line)
        self.missing(line)

    def unit(self, name: str, unit: str, line: int) -> None:
        factor = next((factor for factor in self.factors if factor.name == name), None)
        if factor is not None and unit and factor.levels is None:
            scale = unit_factor(unit, factor.unit)
            if scale is None:
                wanted = f"Give it in {factor.unit}." if factor.unit else "It is a pure number: drop the unit."
                self.add("the unit cannot be converted", wanted, line, name, unit)
            else:
                self.scales[name] = scale
        elif unit and name in OPTIONAL and not (name in ("score", "se") and unit == "%"):
            self.add("this column has no unit", f"Write the header as: {name}", line, name, unit)

    def missing(self, line: int) -> None:
        free = [name for name in self.columns if name not in OPTIONAL]
        for factor in self.factors:
            if factor.name not in self.columns:
                self.add("there is no column for this factor", _rename_hint(factor, free), line, factor.name)
        if "score" not in self.columns and not {"n", "correct"} <= self.columns.keys():
            near = [name for name in free if "score" in name.casefold() or "correct" in name.casefold()]
            hint = f"Rename the column '{near[0]}' to 'score'." if near else "Add it, or n and correct."
            self.add("there is no column of scores", hint, line, "score")
        if len(self.measures) > 1 and "application" not in self.columns:
            names = ", ".join(self.measures)
            self.add("the campaign has several applications", f"Add a column with: {names}.", line, "application")

    # -- rows -----------------------------------------------------------------------------------------------------

    def rows(self) -> tuple[list[MeasuredScore], list[int]]:
        self.header()
        scores: list[MeasuredScore] = []
        unscored: list[int] = []
        if self.problems:
            return scores, unscored
        width = len(self.table.header)
        for line, cells in self.table.rows:
            if len(cells) != width and any(cell.strip() for cell in cells[width:]) | (len(cells) < width):
                remedy = (
                    "Every row needs a cell for each column; a number with a decimal comma needs semicolons between"
                )
                self.add(f"the row has {len(cells)} cells, the header {width}", remedy + " cells.", line)
                continue
            score = self.row(line, cells)
            if score is not None:
                scores.append(score)
            elif self.cell(cells, "run_id"):
                unscored.append(line)
        if not self.problems and not scores:
            remedy = "Fill in the column 'score'." if unscored else "Add a row for each score."
            self.add("the file has no scores", remedy, self.table.header_line)
        return scores, unscored

    def cell(self, cells: Sequence[str], name: str) -> str:
        index = self.columns.get(name)
        text = "" if index is None else cells[index].strip()
        # An apostrophe keeps a spreadsheet from running text as a formula; the export writes it, see there.
        return text[1:] if text[:1] == "'" and text[1:2] in ("=", "+", "-", "@") else text

    def row(self, line: int, cells: Sequence[str]) -> MeasuredScore | None:
        """The row's score; None when it has errors or is not scored yet."""
        before = len(self.problems)
        text = {name: self.cell(cells, name) for name in OPTIONAL}
        run_id = self.whole(text["run_id"], line, "run_id", 1)
        application = self.application(text["application"], line)
        settings = {factor.name: self.setting(factor, cells, line) for factor in self.factors}
        if run_id is not None and application:
            first = self.seen.setdefault((run_id, application), line)
            if first != line:
                self.add(f"line {first} has a score of this run already", "Keep one of them.", line, "run_id", run_id)
        if text["source"] not in ("", *SOURCES):
            self.add("no such source", f"Write {' or '.join(SOURCES)}, or nothing.", line, "source", text["source"])
        if run_id is not None and not (text["score"] or text["n"] or text["correct"]):
            return None
        numbers = self.numbers(text, line, self.measures.get(application, Measure(application)))
        if len(self.problems) > before:
            return None
        score, se, n, correct = numbers
        others = [name for name in self.columns if name not in OPTIONAL and name not in settings]
        metadata = {name: self.cell(cells, name) for name in others}
        named = {name: text[name] for name in ("block", "source", "date", "note")}
        return MeasuredScore(line, run_id, application, settings, score, se, n, correct, **named, metadata=metadata)

    def application(self, text: str, line: int) -> str:
        if text in self.measures:
            return text
        if not text and len(self.measures) == 1:
            return next(iter(self.measures))
        message = "no such application" if text else "the cell is empty"
        self.add(message, f"Applications: {', '.join(self.measures)}.", line, "application", text or None)
        return ""

    def setting(self, factor: FactorColumn, cells: Sequence[str], line: int) -> float | str:
        text = self.cell(cells, factor.name)
        if factor.levels is None:
            number = self.number(text, line, factor.name, required=True)
            return math.nan if number is None else number * self.scales.get(factor.name, 1.0)
        if text not in factor.levels:
            near = difflib.get_close_matches(text, factor.levels, n=1)
            hint = f"Did you mean '{near[0]}'?" if near else f"Levels: {', '.join(factor.levels)}."
            self.add("no such level" if text else "the cell is empty", hint, line, factor.name, text or None)
        return text

    def numbers(
        self, text: Mapping[str, str], line: int, measure: Measure
    ) -> tuple[float, float | None, int | None, int | None]:
        """Score, standard error and counts of a row, each computed from the others where it may be."""
        n = self.whole(text["n"], line, "n", 1)
        correct = self.whole(text["correct"], line, "correct", 0)
        se = self.number(text["se"], line, "se")
        if se is not None and se <= 0.0:
            self.add("a standard error must be above 0", "Leave it empty where it is unknown.", line, "se", se)
        if correct is not None and (correct > n if n is not None else not text["n"]):
            self.add(
                "'correct' needs a larger 'n'", "Give n, the number of cases; correct <= n.", line, "correct", correct
            )
            return math.nan, se, n, correct
        counted = n is not None and correct is not None and measure.is_percent
        score = self.number(text["score"], line, "score", required=not counted)
        if n is not None and correct is not None and measure.is_percent:
            percent, binomial_se = binomial_percent(n, correct)
            se = binomial_se if se is None else se
            if score is not None and abs(score - percent) > 0.5:
                remedy = f"{correct} of {n} are {percent:.2f} percent; correct one of them."
                self.add("the score contradicts n and correct", remedy, line, "score", score)
            score = percent if score is None else score
        if measure.is_percent and score is not None and not 0.0 <= score <= 100.0:
            self.add("a percentage lies from 0 to 100", "Correct it.", line, "score", score)
        return math.nan if score is None else score, se, n, correct

    def number(self, text: str, line: int, column: str, *, required: bool = False) -> float | None:
        if not text:
            if required:
                self.add("the cell is empty", "Give a number.", line, column)
            return None
        digits = text.replace("\u2212", "-")
        self.check_decimal_sign(digits, line, column)
        if self.table.delimiter != "," and "." not in digits:
            digits = digits.replace(",", ".", 1)
        if _NUMBER.fullmatch(digits) and math.isfinite(value := float(digits)):
            return value
        remedy = "Give a plain finite number, without unit and without a sign between thousands."
        if _DATE.fullmatch(text):
            remedy = "A spreadsheet has made a date of a number: give the column the format 'Text' and type it again."
        elif "," in text and self.table.delimiter == ",":
            remedy = "Use a decimal point, or separate the cells by semicolons."
        self.add("this is no number", remedy, line, column, text)
        return None

    def check_decimal_sign(self, text: str, line: int, column: str) -> None:
        """Where a comma may be decimal, a file that has both signs is not to be read: 1,234 may be a thousand."""
        signs = {sign for sign in ",." if sign in text}
        if self.table.delimiter == "," or len(signs) != 1:
            return
        for sign in signs - self.decimal_signs.keys():
            self.decimal_signs[sign] = line
            if len(self.decimal_signs) == 2:
                other = ({",", "."} - signs).pop()
                message = f"a number with '{sign}' here, one with '{other}' in line {self.decimal_signs[other]}"
                self.add(message, "Use one decimal sign throughout, and none between thousands.", line, column, text)

    def whole(self, text: str, line: int, column: str, least: int) -> int | None:
        if not text:
            return None
        value = self.number(text, line, column)
        if value is None:
            return None
        if value != int(value) or not least <= value <= 2**31 - 1:
            self.add(f"a whole number from {least} up is expected", "Correct it.", line, column, text)
            return None
        return int(value)
