"""Files of rankings: interpreters' orders of the images of runs, one row for each image that an interpreter ranked.

Columns ``run_id``, ``interpreter`` and ``rank`` (1 for the best; equal ranks are ties; an empty rank: not looked at);
``application`` where the campaign has several; ``session`` where an interpreter ranked more than once; the factors'
columns, all or none, for settings really flown; every other column is kept as metadata. The rows of one interpreter,
session and application are one ranking.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from seqrsm.score.cells import CellReader, FactorColumn, Measure, split_header
from seqrsm.score.table import TableSource

COLUMNS = ("run_id", "interpreter", "rank", "application", "session")
REQUIRED = ("run_id", "interpreter", "rank")
_HAS = "A ranking has run_id, interpreter and rank."


@dataclass(frozen=True, slots=True)
class RankedImage:
    """One row: where it stands, the run whose image it is, its rank, settings where given, other columns."""

    line: int
    run_id: int
    rank: float
    settings: dict[str, float | str] | None
    metadata: dict[str, str]


@dataclass(frozen=True, slots=True)
class MeasuredRanking:
    """One interpreter's ranking of two images or more."""

    application: str
    interpreter: str
    session: str
    images: tuple[RankedImage, ...]


def is_rankings_file(source: TableSource, expected: bool = False) -> bool:
    """Whether the header has columns ``interpreter`` and ``rank``, in whatever case; if ``expected``, no ``score``."""
    names = {split_header(text)[0].casefold() for text in _Reader(source, ()).table.header}
    return {"interpreter", "rank"} <= names or (expected and "score" not in names)


def read_rankings(
    source: TableSource, factors: Sequence[FactorColumn], measures: Sequence[Measure]
) -> tuple[MeasuredRanking, ...]:
    """The rankings of a file, in its order, of the applications whose utility is a ranking.

    Columns of ``factors`` stand all in the file, or none of them.

    Raises
    ------
    ScoresFileError
        With all problems, each with file, line, column, value and remedy.
    """
    reader = _Reader(source, factors, measures)
    rankings = reader.rankings()
    reader.refuse()
    return rankings


class _Reader(CellReader):
    """Turns the cells of a table into rankings and collects what is wrong."""

    optional = COLUMNS

    def missing(self, line: int) -> None:
        near = {name.casefold(): name for name in self.free_columns()}
        for name in REQUIRED:
            if name not in self.columns:
                hint = f"Rename the column '{near[name]}' to '{name}'." if name in near else _HAS
                self.add("there is no such column", hint, line, name)
        given = [factor.name for factor in self.factors if factor.name in self.columns]
        for factor in self.factors:
            if given and factor.name not in given:
                self.add("no column for this factor", "Give the settings of all factors or none.", line, factor.name)
        self.missing_application(line)

    def rankings(self) -> tuple[MeasuredRanking, ...]:
        self.header()
        found: dict[tuple[str, str, str], list[RankedImage]] = {}
        if not self.problems:
            for line, cells in self.complete_rows():
                self.image(found, line, cells)
        whole = not self.problems
        for (_, interpreter, session), images in found.items():
            if whole and len(images) < 2:  # else an image may be missing for another reason
                remedy = "A ranking compares two images or more."
                of = f"{interpreter}{f', session {session}' if session else ''}"
                self.add(f"the ranking of {of} has one image", remedy, images[0].line, "rank")
        if not self.problems and not found:
            self.add("the file has no rankings", "Fill in the column 'rank'.", self.table.header_line)
        return tuple(MeasuredRanking(*key, tuple(images)) for key, images in found.items())

    def image(self, found: dict[tuple[str, str, str], list[RankedImage]], line: int, cells: Sequence[str]) -> None:
        before = len(self.problems)
        run_id = self.whole(self.cell(cells, "run_id"), line, "run_id", 1)
        if run_id is None and len(self.problems) == before:
            self.add("the cell is empty", "Give the id of the run whose image was ranked.", line, "run_id")
        interpreter, session = self.cell(cells, "interpreter"), self.cell(cells, "session")
        if not interpreter:
            self.add("the cell is empty", "Name the interpreter; a letter suffices.", line, "interpreter")
        application = self.application(self.cell(cells, "application"), line)
        rank = self.number(self.cell(cells, "rank"), line, "rank")
        if rank is not None and rank <= 0.0:
            self.add("a rank is 1 or more", "The best image has rank 1.", line, "rank", self.cell(cells, "rank"))
        given = bool(self.factors) and self.factors[0].name in self.columns
        settings = {f.name: self.setting(f, cells, line) for f in self.factors} if given else None
        if rank is None or run_id is None or len(self.problems) > before:
            return
        images = found.setdefault((application, interpreter, session), [])
        twice = next((image for image in images if image.run_id == run_id), None)
        if twice is not None:
            message = f"line {twice.line} has a rank of this run by this interpreter already"
            remedy = "Keep one of them, or separate rankings in a column 'session'."
            self.add(message, remedy, line, "run_id", run_id)
            return
        taken = {*COLUMNS, *(settings or ())}
        metadata = {name: text for name in self.columns if name not in taken and (text := self.cell(cells, name))}
        images.append(RankedImage(line, run_id, rank, settings, metadata))
