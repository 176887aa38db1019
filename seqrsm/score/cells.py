"""Cells of a table of scores or rankings: columns found by name, units converted, numbers read for certain or not."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from seqrsm.errors import Problem, ScoresFileError
from seqrsm.plain import heading
from seqrsm.score.table import TableSource, read_table, table_text
from seqrsm.units import reciprocal_factor, unit_factor, units_like

MAX_PROBLEMS = 100

_HEADER = re.compile(r"\s*(?P<name>[^\[\]()]*?)\s*(?:[\[(]\s*(?P<unit>[^\[\]()]*?)\s*[\])])?\s*")
# How names of months begin in English, German, French, Spanish, Italian, Portuguese and Dutch; "GHz" is none.
_MONTH = (
    "(?:jan|ene|gen|f[eé]b|f[eé]v|mar|m[aä]r|mrz|mrt|apr|abr|avr|ma[iyg]|mei|jun|jui|giu|jul|lug|aug|ago|ao[uû]"
    r"|se[pt]|o[ckt]t|out|nov|d[eé][cz]|dic)[^\W\d_]{0,7}"
)
# What spreadsheets make of 1.5 or 5-1 where they take it for a day: "01. Mai", "5-Jan", "Mai 05", "2024-05-01".
_DATE = re.compile(
    rf"\d{{1,2}}[. -]+{_MONTH}\.?([ -]\d{{2,4}})?|{_MONTH}[. -]+\d{{2,4}}|\d{{1,4}}([-/.])\d{{1,2}}\2\d{{2,4}}",
    re.IGNORECASE,
)
_RECIPROCALS = {"wavelength": "frequency", "frequency": "wavelength"}
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
    unit: str = ""

    @property
    def score_unit(self) -> str:
        """Unit in words."""
        return "percent" if self.is_percent else self.unit


def split_header(text: str) -> tuple[str, str]:
    """Name and unit of a header cell such as ``frequency [GHz]`` or ``frequency (GHz)``."""
    match = _HEADER.fullmatch(text)
    return (match["name"], match["unit"] or "") if match else (text.strip(), "")


WORDS_FOR_NOTHING = frozenset(
    ("na", "n/a", "nan", "none", "null", "nil", "missing", "#n/a", "#nv", "#n/d", "k.a.", "k. a.", "-", "--", "?", "x")
)
_SENTINELS = frozenset(
    sign * size for sign in (-1.0, 1.0) for size in (99.0, 999.0, 9999.0, 99999.0, 999999.0, 32767.0, 32768.0, 65535.0)
)


def is_sentinel(value: float) -> bool:
    """Whether programs write this number for no value."""
    return value in _SENTINELS


def nearest(text: str, names: Iterable[str]) -> str:
    """The name that the text may stand for, case, blanks and signs aside; "" where none is near."""
    plain = {_letters(name) or name: name for name in names}
    near = difflib.get_close_matches(_letters(text), plain, n=1)
    return plain[near[0]] if near else ""


def same_name(text: str, names: Iterable[str]) -> str:
    """The name that the text is, case, blanks and signs aside, or but for one letter of five or more; "" for none."""
    bare = _letters(text)
    for name in names:
        other = _letters(name)
        if bare == other or (len(other) > 4 and difflib.SequenceMatcher(None, bare, other).ratio() > 0.85):
            return name
    return ""


def _letters(text: str) -> str:
    return re.sub(r"[\W_]+", "", text.casefold())


_ADD = "Add it."

_SHORT = {"bw": "bandwidth"}
"""Short forms of factors' names that do not begin them; those that do, such as "pol" or "freq", are known by that."""


def _rename_hint(factor: FactorColumn, free: Sequence[str]) -> str:
    """Which column may be the factor's; one whose name ends in a unit must keep it, or values change their meaning."""
    own = factor.name.rpartition(".")[2].casefold()
    begins = (name for name in free if name.casefold().startswith(factor.name.casefold()))
    short = (name for name in free if (word := _first_word(name)) and (own.startswith(word) or _SHORT.get(word) == own))
    near = next(begins, "") or nearest(factor.name, free) or next(short, "")
    if not near:
        return _ADD
    whole = near.casefold().startswith(factor.name.casefold())
    rest = near[len(factor.name if whole else _first_word(near)) :].strip(" _-./[](),:")
    unit = next((unit for unit in units_like(factor.unit) if unit.casefold() == rest.casefold()), "")
    return f"Rename the column '{near}' to '{heading(factor.name, unit)}'."


def _first_word(name: str) -> str:
    """The word that a column's name begins with, such as "freq" of "Freq_MHz"; "" where two letters tell nothing."""
    word = re.match(r"[^\W\d_]*", name.casefold())[0]  # type: ignore[index]
    return word if len(word) > 2 or word in _SHORT else ""


class CellReader:
    """Opens a table, finds its columns and reads its cells, and collects what is wrong.

    ``source``: see `seqrsm.score.table.table_text`. ``measures``: applications that may stand in the file.
    """

    optional: tuple[str, ...] = ()
    """Columns besides the factors' that have a meaning."""

    def __init__(self, source: TableSource, factors: Sequence[FactorColumn], measures: Sequence[Measure] = ()) -> None:
        self.file = table_text(source)
        self.factors = factors
        self.table = read_table(self.file.name, self.file.data, lambda text: split_header(text)[0] in self.meant)
        self.measures = {measure.name: measure for measure in measures}
        self.told_units: dict[str, str] = {}
        self.problems: list[Problem] = []
        self.columns: dict[str, int] = {}
        self.scales: dict[str, float] = {}
        self.reciprocals: dict[str, float] = {}
        self.seen: dict[tuple[int, str], int] = {}
        self.decimal_signs: dict[str, int] = {}

    @property
    def meant(self) -> set[str]:
        """Names of the columns that have a meaning."""
        return {*self.optional, *(factor.name for factor in self.factors)}

    def add(self, message: str, remedy: str, line: int, column: str | None = None, value: object = None) -> None:
        """Note a problem at a place of the file."""
        self.problems.append(Problem(message, remedy, self.table.name, line, column, value))

    def refuse(self) -> None:
        """Raise ScoresFileError where anything is wrong, with the first `MAX_PROBLEMS` places."""
        if self.problems:
            more = len(self.problems) - MAX_PROBLEMS
            rest = [Problem(f"and {more} more problems", file=self.table.name)] if more > 0 else []
            raise ScoresFileError(*self.problems[:MAX_PROBLEMS], *rest)

    # -- header ---------------------------------------------------------------------------------------------------

    def header(self) -> None:
        """Find the columns by name, and the units that they are in."""
        line = self.table.header_line
        known = self.meant
        for index, text in enumerate(self.table.header):
            name, unit = split_header(text)
            name = self._reciprocal_of(name, unit, known)
            if name not in known:  # a column of the user's own is kept under its full name, unit and all
                name, unit = text.strip(), ""
            if not name:
                if any(index < len(cells) and cells[index].strip() for _, cells in self.table.rows):
                    self.add(f"column {index + 1} has no name", "Name it in the first line, or remove it.", line)
            elif name in self.columns:
                self.add("two columns have this name", "Rename or remove one.", line, name)
            else:
                self.columns[name] = index
                if unit:
                    self.unit(name, unit, line)
        self.missing(line)

    def _reciprocal_of(self, name: str, unit: str, known: set[str]) -> str:
        """A wavelength's column is the frequency's, and the other way round, where that has none."""
        twin = _RECIPROCALS.get(name.casefold(), "")
        factor = next((factor for factor in self.factors if factor.name == twin), None)
        if name in known or factor is None or any(split_header(text)[0] == twin for text in self.table.header):
            return name
        return name if reciprocal_factor(unit, factor.unit) is None else twin

    def unit(self, name: str, unit: str, line: int) -> None:
        """Note the number that turns a column's unit into the factor's."""
        factor = next((factor for factor in self.factors if factor.name == name and factor.levels is None), None)
        if factor is not None:
            self._factor_unit(factor, unit, line)
        elif name in ("score", "se"):
            theirs = {one.score_unit for one in self.measures.values()}
            self.told_units[name] = {"%": "percent"}.get(unit, unit)
            if self.told_units[name] not in theirs:
                headers = " or ".join(f"{name} [{one}]" if one else name for one in sorted(theirs))
                remedy = f"Convert them where needed, and write the header as: {headers}"
                self.add("this is not the unit of the scores", remedy, line, name, unit)
        elif name in self.optional:
            self.add("this column has no unit", f"Write the header as: {name}", line, name, unit)

    def _factor_unit(self, factor: FactorColumn, unit: str, line: int) -> None:
        scale, reciprocal = unit_factor(unit, factor.unit), reciprocal_factor(unit, factor.unit)
        if scale is not None:
            self.scales[factor.name] = scale
        elif reciprocal is not None and factor.name.rpartition(".")[2] in _RECIPROCALS:
            self.reciprocals[factor.name] = reciprocal
        else:
            like = units_like(factor.unit)
            near = nearest(unit, like)
            wanted = f"Did you mean {near}?" if near else f"Give it in {' or '.join(like) or factor.unit}."
            wanted = wanted if factor.unit else "It is dimensionless: omit the unit."
            self.add("the unit cannot be converted", wanted, line, factor.name, unit)

    def missing(self, line: int) -> None:
        """Columns that must be there and are not."""
        free = self.free_columns()
        if free and self.factors and self.no_factor():
            names = ", ".join(one.name for one in self.factors)
            remedy = f"Begin the file with a line of names: {names}. Remove what stands above it."
            # Whatever else is wrong with the line is so for this reason.
            raise ScoresFileError("this line is no header: it names no factor", remedy, file=self.table.name, line=line)
        for one in self.factors:
            if one.name not in self.columns:
                hint = _rename_hint(one, free)
                if hint == _ADD and free:
                    hint = f"Add it, or rename the one that contains it to '{one.name}': {', '.join(free)}."
                self.add("no column for this factor", hint, line, one.name)
        self.missing_application(line)

    def no_factor(self) -> bool:
        """Whether no column is a factor's, nor may be one under another name unless the next line names one."""
        below = {split_header(text)[0] for _, cells in self.table.rows[:1] for text in cells}
        names, free = {one.name for one in self.factors}, self.free_columns()
        hints = () if names & below else (_rename_hint(one, free) for one in self.factors)
        return names.isdisjoint(self.columns) and all(hint == _ADD for hint in hints)

    def missing_application(self, line: int) -> None:
        """The column that tells one application from another."""
        if len(self.measures) > 1 and "application" not in self.columns:
            names = ", ".join(self.measures)
            self.add("the campaign has several applications", f"Add a column with: {names}.", line, "application")

    # -- cells ----------------------------------------------------------------------------------------------------

    def complete_rows(self) -> Iterator[tuple[int, Sequence[str]]]:
        """Rows with a cell for each column; the others are noted as problems."""
        width = len(self.table.header)
        for line, cells in self.table.rows:
            if cells == self.table.header:
                self.add("this is the header again", "Remove the line.", line)
            elif len(cells) != width and any(cell.strip() for cell in cells[width:]) | (len(cells) < width):
                remedy = "Every row needs a cell for each column; decimal commas need semicolons between the cells."
                self.add(f"the row has {len(cells)} cells, the header {width}", remedy, line)
            else:
                yield line, cells

    def cell(self, cells: Sequence[str], name: str) -> str:
        """Text of a row's cell; "" where the file has no such column."""
        index = self.columns.get(name)
        text = "" if index is None else cells[index].strip()
        # An apostrophe keeps a spreadsheet from running text as a formula; the export writes it, see there.
        return text[1:] if text[:1] == "'" and text[1:2] in ("=", "+", "-", "@") else text

    def application(self, text: str, line: int) -> str:
        """Application of a row; "" and a problem when it is none of the campaign's."""
        if text in self.measures:
            return text
        if not text and len(self.measures) == 1:
            return next(iter(self.measures))
        message = "no such application" if text else "the cell is empty"
        near = nearest(text, self.measures)
        hint = f"Did you mean '{near}'? " if near else ""
        self.add(message, f"{hint}Applications: {', '.join(self.measures)}.", line, "application", text or None)
        return ""

    def setting(self, factor: FactorColumn, cells: Sequence[str], line: int) -> float | str:
        """Value of a factor in its own unit, or its level; a problem when it is neither."""
        text = self.cell(cells, factor.name)
        if factor.levels is None:
            number = self.number(text, line, factor.name, required=True)
            reciprocal = self.reciprocals.get(factor.name)
            if number is None or reciprocal is None:
                scale = self.scales.get(factor.name, 1.0)
                found = math.nan if number is None else number * scale
                return found if scale == 1.0 else float(f"{found:.15g}")  # 1130 MHz are 1.13 GHz, to the last digit
            if number <= 0.0:
                self.add("a wavelength or frequency must be above 0", "Correct it.", line, factor.name, text)
            return reciprocal / number if number > 0.0 else math.nan
        if text not in factor.levels:
            same = (level for level in factor.levels if sorted(level.split("+")) == sorted(text.split("+")))
            near = next(same, "") or nearest(text, factor.levels)
            hint = f"Did you mean '{near}'?" if near else f"Levels: {', '.join(factor.levels)}."
            self.add("no such level" if text else "the cell is empty", hint, line, factor.name, text or None)
        return text

    def number(self, text: str, line: int, column: str, *, required: bool = False) -> float | None:
        """A finite number; None when the cell is empty, and, with a problem, when it is not a number."""
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
        remedy = "Give a finite number without unit or thousands separator."
        if _DATE.fullmatch(text):
            remedy = "A spreadsheet turned a number into a date: set the column format to 'Text' and enter it again."
        elif text.casefold() in WORDS_FOR_NOTHING:
            remedy = "Leave the cell empty if there is no value."
        elif text.endswith("%") and column in ("score", "se"):
            remedy = f"Remove the percent sign; the header may be: {column} [%]."
        elif (text.isalpha() and not text.casefold().startswith("inf")) or text.endswith("%"):
            remedy = "Units go into the header, as frequency [GHz]; remove lines that are not runs."
        elif "," in text and self.table.delimiter == ",":
            remedy = "Use a decimal point, or, in a text file, separate the cells by semicolons."
        self.add("this is not a number", remedy, line, column, text)
        return None

    def check_decimal_sign(self, text: str, line: int, column: str) -> None:
        """Where a comma may be decimal, a file that has both signs is not to be read: 1,234 may be a thousand."""
        signs = {sign for sign in ",." if sign in text}
        if self.table.delimiter == "," or len(signs) != 1 or not any(map(str.isdigit, text)):
            return
        for sign in signs - self.decimal_signs.keys():
            self.decimal_signs[sign] = line
            if len(self.decimal_signs) == 2:
                other = ({",", "."} - signs).pop()
                message = f"decimal sign '{sign}' here, '{other}' in line {self.decimal_signs[other]}"
                self.add(message, "Use one decimal sign throughout and no thousands separator.", line, column, text)

    def whole(self, text: str, line: int, column: str, least: int) -> int | None:
        """A whole number from ``least`` up; None as of `number`."""
        if not text:
            return None
        value = self.number(text, line, column)
        if value is None:
            return None
        if value != int(value) or not least <= value <= 2**31 - 1:
            self.add(f"a whole number of at least {least} is expected", "Correct it.", line, column, text)
            return None
        return int(value)

    def free_columns(self) -> list[str]:
        """Columns that are the user's own, or that bear a name we do not know."""
        return [name for name in self.columns if name not in self.meant]
