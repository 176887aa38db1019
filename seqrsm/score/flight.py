"""Files of measured scores: what a flight crew or an interpreter hands in.

A table as text, UTF-8 with or without a byte order mark, cells separated by comma, semicolon, tab or ``|``. One column
for each factor by its name, in natural units, and ``score``; optional ``run_id``, ``application``, ``se``, ``n`` and
``correct``, ``block``, ``source``, ``date``, ``note``; every other column is kept as metadata. A factor's column may
name its unit, ``frequency [MHz]`` or ``frequency (MHz)``, and is converted. Lines before the header that begin with
``#``, and a spreadsheet's ``sep=;``, are passed over. Where no comma separates cells, numbers may have a decimal comma.

Nothing is guessed: what cannot be read for certain is an error with its line and column, and all errors come at once.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from seqrsm.score.cells import CellReader, FactorColumn, Measure, is_sentinel, nearest, same_name
from seqrsm.score.table import TableSource

SOURCES = ("flight", "simulation")
MEANT = ("run_id", "application", "se", "n", "correct", "block", "source")
"""Columns without which a row says something else."""
OPTIONAL = ("run_id", "application", "score", "se", "n", "correct", "block", "source", "date", "note")
_NO_SETTINGS = "Give them, or remove a line of means, totals or units; units go into the header, as frequency [GHz]."


@dataclass(frozen=True, slots=True)
class MeasuredScore:
    """One row of the file."""

    line: int
    """1-based line of the file on which the row begins."""
    run_id: int | None
    """The proposal that the row carries out."""
    application: str
    """Name of the application."""
    settings: dict[str, float | str]
    """Executed settings in the factors' own units, by factor name."""
    score: float
    se: float | None
    """In score units; of a percentage with ``n`` and ``correct`` they are computed from the counts when not given."""
    n: int | None
    correct: int | None
    """Binomial counts."""
    block: str = ""
    source: str = ""
    date: str = ""
    note: str = ""
    """As written, "" where the file is silent."""
    metadata: dict[str, str] = field(default_factory=dict)
    """Every other column, as written."""


@dataclass(frozen=True, slots=True)
class ScoresFile:
    """A file that was read without errors."""

    name: str
    """File name without its folder."""
    sha256: str
    """Of the bytes."""
    scores: tuple[MeasuredScore, ...]
    """In the order of the file."""
    unscored: tuple[int, ...]
    """Lines whose score is still empty."""
    near: tuple[tuple[str, str], ...] = ()
    """Columns of the user's own that are nearly named as one that has a meaning, and that."""
    bare: bool = False
    """It has run ids and no settings: those of the runs named are taken."""


def read_scores(
    source: TableSource,
    factors: Sequence[FactorColumn],
    measures: Sequence[Measure],
    block: str = "block",
    recorded: Mapping[int, Mapping[str, float | str]] | None = None,
) -> ScoresFile:
    """Read a file, or a table (`seqrsm.score.table.table_text`), of measured scores.

    Every factor must have its column, or none with a column ``run_id``; ``recorded`` then has the settings of the
    campaign's runs, by run id. Where there is one application, one of ``measures``, the column ``application`` may be
    absent. ``block`` is the column that the campaign takes blocks from.

    Raises
    ------
    ScoresFileError
        With all problems, each with file, line, column, value and remedy (at most `seqrsm.score.cells.MAX_PROBLEMS`).
    """
    reader = _Reader(source, factors, measures)
    reader.recorded = recorded or {}
    scores, unscored = reader.rows()
    reader.refuse()
    file, near, bare = reader.file, reader.near(block), not reader.factors
    return ScoresFile(file.name, file.sha256, tuple(scores), tuple(unscored), near, bare)


def binomial_percent(n: int, correct: int) -> tuple[float, float]:
    """Percentage of ``correct`` in ``n`` >= 1 and its binomial standard error, both in percent.

    The proportion in the error is kept half a count away from 0 and 1, where the formula would claim certainty.
    """
    p = min(max(correct / n, 0.5 / n), 1.0 - 0.5 / n)
    return 100.0 * correct / n, 100.0 * math.sqrt(p * (1.0 - p) / n)


class _Reader(CellReader):
    """Turns the cells of a table into scores."""

    optional = OPTIONAL
    recorded: Mapping[int, Mapping[str, float | str]]

    def missing(self, line: int) -> None:
        ids = next((name for name in self.free_columns() if same_name(name, ["run_id"])), "")
        if ("run_id" in self.columns or ids) and self.no_factor():
            self.factors = ()  # the runs that are named say what was flown
            if "run_id" not in self.columns:
                self.add("no column tells the runs", f"Rename the column '{ids}' to 'run_id'.", line, "run_id")
        super().missing(line)
        counts, percent = {"n", "correct"} <= self.columns.keys(), any(one.is_percent for one in self.measures.values())
        if "score" not in self.columns and not (counts and percent):
            free = self.free_columns()
            near = [name for name in free if "score" in name.casefold() or "percent" in name.casefold()]
            correct = [name for name in free if "correct" in name.casefold()]
            hint = "Add it, or n and correct (counts: correct of n cases)." if percent else "Add it."
            if counts:
                hint = "Add it: n and correct make a percentage, and no application here is one."
            if free:
                hint = f"Rename the column that contains them to 'score'; unknown columns: {', '.join(free)}."
            if near:
                hint = f"Rename the column '{near[0]}' to 'score'."
            elif correct:
                rename = f"Rename the column '{correct[0]}' to 'score' if it contains percentages"
                hint = f"{rename}; counts are two columns, n and correct."
            self.add("there is no column of scores", hint, line, "score")

    def near(self, block: str) -> tuple[tuple[str, str], ...]:
        """Columns of the user's own that are nearly named as one that has a meaning and is not there."""
        absent = [name for name in dict.fromkeys((*MEANT, block)) if name not in self.columns]
        own = (name for name in self.free_columns() if name != block)
        found = [(name, meant) for name in own if (meant := same_name(name, absent))]
        if block in absent and "block" in self.columns:
            found.append(("block", block))
        return tuple(found)

    # -- rows -----------------------------------------------------------------------------------------------------

    def rows(self) -> tuple[list[MeasuredScore], list[int]]:
        self.header()
        scores: list[MeasuredScore] = []
        unscored: list[int] = []
        if self.problems:
            return scores, unscored
        for line, cells in self.complete_rows():
            score = self.row(line, cells)
            if score is not None:
                scores.append(score)
            else:
                unscored.append(line)
        if not self.problems and not scores:
            remedy = "Fill in the column 'score'." if unscored else "Add a row for each score."
            self.add("the file has no scores", remedy, self.table.header_line)
        return scores, unscored

    def row(self, line: int, cells: Sequence[str]) -> MeasuredScore | None:
        """The row's score; None when it has errors or is not scored yet."""
        before = len(self.problems)
        if self.factors and not self.has_settings(cells):
            self.add("the row has no settings", _NO_SETTINGS, line)
            return None
        text = {name: self.cell(cells, name) for name in OPTIONAL}
        run_id = self.whole(text["run_id"], line, "run_id", 1)
        application = self.application(text["application"], line)
        settings = {factor.name: self.setting(factor, cells, line) for factor in self.factors}
        if run_id is not None and application:
            first = self.seen.setdefault((run_id, application), line)
            if first != line:
                self.add(f"line {first} has a score of this run already", "Keep one of them.", line, "run_id", run_id)
        if text["source"] not in ("", *SOURCES):
            near = nearest(text["source"], SOURCES)
            hint = f"Did you mean {near}?" if near else "Any other measurement counts as a flight."
            self.add("no such source", f"Write {' or '.join(SOURCES)}. {hint}", line, "source", text["source"])
        if not (text["score"] or text["n"] or text["correct"]):
            return None
        if not self.factors:
            settings = dict(self.recorded.get(run_id or 0, {}))
            if not settings and (run_id or not text["run_id"]):
                message, remedy = "no run has this id", "Give that of a proposed run, or a column for each factor."
                self.add(message if run_id else "the cell is empty", remedy, line, "run_id", run_id)
        measure = self.measures.get(application, Measure(application))
        for name, unit in self.told_units.items():
            if text[name] and application in self.measures and unit != measure.score_unit:
                message = f"scores of '{application}' are in {measure.score_unit or 'no unit'}"
                self.add(message, "Convert them, and omit the unit of the header.", line, name, unit)
        numbers = self.numbers(text, line, measure)
        if len(self.problems) > before:
            return None
        score, se, n, correct = numbers
        others = [name for name in self.columns if name not in OPTIONAL and name not in settings]
        metadata = {name: self.cell(cells, name) for name in others}
        named = {name: text[name] for name in ("block", "source", "date", "note")}
        return MeasuredScore(line, run_id, application, settings, score, se, n, correct, **named, metadata=metadata)

    def has_settings(self, cells: Sequence[str]) -> bool:
        """Whether any factor's cell holds a level or something with a digit; in place of levels alone anything may."""
        given = [(factor.levels, text) for factor in self.factors if (text := self.cell(cells, factor.name))]
        if all(factor.levels is not None for factor in self.factors):
            return len(given) == len(self.factors)
        return any(any(map(str.isdigit, text)) if levels is None else text in levels for levels, text in given)

    def numbers(
        self, text: Mapping[str, str], line: int, measure: Measure
    ) -> tuple[float, float | None, int | None, int | None]:
        """Score, standard error and counts of a row, each computed from the others where it may be."""
        n = self.whole(text["n"], line, "n", 1)
        correct = self.whole(text["correct"], line, "correct", 0)
        se = self.number(text["se"], line, "se")
        if se is not None and se <= 0.0:
            self.add("a standard error must be above 0", "Leave it empty if it is unknown.", line, "se", se)
        if correct is not None and (correct > n if n is not None else not text["n"]):
            self.add(
                "'correct' needs a larger 'n'", "Give n, the number of cases; correct <= n.", line, "correct", correct
            )
            return math.nan, se, n, correct
        counted = bool(text["n"] and text["correct"]) and measure.is_percent  # what is wrong there is told above
        score = self.number(text["score"], line, "score", required=not counted)
        if n is not None and correct is not None and measure.is_percent:
            percent, binomial_se = binomial_percent(n, correct)
            se = binomial_se if se is None else se
            if score is not None and abs(score - percent) > 0.5:
                remedy = f"{correct} of {n} are {percent:.2f} percent; correct one of them."
                self.add("the score contradicts n and correct", remedy, line, "score", score)
            score = percent if score is None else score
        if measure.is_percent and score is not None and not 0.0 <= score <= 100.0:
            remedy = "Leave the cell empty if there is no score." if is_sentinel(score) else "Correct it."
            self.add("a percentage lies from 0 to 100", remedy, line, "score", score)
        return math.nan if score is None else score, se, n, correct
