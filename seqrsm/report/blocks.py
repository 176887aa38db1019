"""Findings as data: a tree of frozen blocks that the terminal, the HTML and the PDF face all render.

Every number is already text here, so that the faces cannot differ. All text is plain: no face reads markup out of it.
Only ``Equation.math`` and ``Panel.svg`` are code, and both come from this package, never from a user.

The terminal shows less: no equations, no pictures (their numbers stand in the tables), no words on the method, and of
what is `Details.long` or `Column.extra` only that it is there. What it shows it says in the same words and digits.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal, TypeAlias

from seqrsm.plain import heading

Align: TypeAlias = Literal["left", "right"]
Tone: TypeAlias = Literal["plain", "lead", "note", "warning"]


@dataclass(frozen=True, slots=True)
class Paragraph:
    """Running text."""

    text: str
    """What was found."""
    tone: Tone = "plain"
    """Kind: "lead" is the recommendation, "note" is small print, "warning" is boxed."""
    method: str = ""
    """Goes on behind ``text`` with how it is found, which the terminal leaves out."""


@dataclass(frozen=True, slots=True)
class Bullets:
    """A list of short statements."""

    items: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class KeyFigure:
    """One number of the summary with its name and what it means."""

    label: str
    value: str
    detail: str = ""


@dataclass(frozen=True, slots=True)
class KeyFigures:
    """The numbers of the summary, side by side."""

    items: tuple[KeyFigure, ...]


@dataclass(frozen=True, slots=True)
class Column:
    """Head of a table column; ``unit`` is shown in brackets after the title, and terminals lack ``extra`` columns."""

    title: str
    unit: str = ""
    align: Align = "left"
    extra: bool = False

    @property
    def heading(self) -> str:
        """Title and unit."""
        return heading(self.title, self.unit)


@dataclass(frozen=True, slots=True)
class Cell:
    """Text of a table cell, and the number by which a column is sorted (None: sort by the text)."""

    text: str
    value: float | None = None


@dataclass(frozen=True, slots=True)
class Table:
    """A table whose first column names the row."""

    columns: tuple[Column, ...]

    rows: tuple[tuple[Cell, ...], ...]
    """Each as long as ``columns``."""
    caption: str
    """What the table shows."""
    sortable: bool = False
    """Whether the HTML face offers sorting; the rows stand in a useful order anyway."""

    def __post_init__(self) -> None:
        if any(len(row) != len(self.columns) for row in self.rows):
            raise ValueError(f"table {self.caption!r}: every row needs {len(self.columns)} cells")


Head: TypeAlias = Column | str
Entry: TypeAlias = Cell | str


def right(title: str, unit: str = "") -> Column:
    """Head of a column of numbers."""
    return Column(title, unit, "right")


def table(caption: str, columns: Iterable[Head], rows: Iterable[Iterable[Entry]], *, sortable: bool = False) -> Table:
    """Return a table; a head or a cell that is words alone may be given as text."""
    heads = tuple(Column(one) if isinstance(one, str) else one for one in columns)
    cells = tuple(tuple(Cell(one) if isinstance(one, str) else one for one in row) for row in rows)
    return Table(heads, cells, caption, sortable)


@dataclass(frozen=True, slots=True)
class PanelData:
    """The numbers behind a picture, for a CSV file."""

    columns: tuple[str, ...]
    """Names with units in brackets."""
    rows: tuple[tuple[float | str, ...], ...]
    """Numbers and words, each row as long as ``columns``; nan is an empty cell."""


@dataclass(frozen=True)
class Panel:
    """One picture of a figure, drawn when it is first asked for."""

    title: str
    """Short heading over the picture, "" for none."""
    alt: str
    """What a reader who cannot see it should know."""
    draw: Callable[[], str] | None = field(default=None, compare=False, repr=False)
    """Draws it as SVG with ``seqrsm.report.figures.drawing``; None when ``png`` is given."""
    png: bytes = b""
    """Bitmap; b"" when ``draw`` is given."""
    name: str = ""
    """Stem of the files that ``seqrsm report --figures`` writes, in letters, digits and hyphens."""
    data: Callable[[], PanelData] | None = field(default=None, compare=False, repr=False)
    """Gives what the picture shows as numbers; asked only when the figures are written to files."""

    @cached_property
    def svg(self) -> str:
        """The drawing; "" for a bitmap."""
        return "" if self.draw is None else self.draw()


@dataclass(frozen=True, slots=True)
class LegendEntry:
    """A colour and its meaning, for bitmaps."""

    color: str
    label: str


@dataclass(frozen=True)
class FigureBlock:
    """Panels, made when they are first asked for, with one caption; ``columns`` stand side by side on paper."""

    make: Callable[[], tuple[Panel, ...]]
    caption: str
    columns: int = 2
    legend: tuple[LegendEntry, ...] = ()

    @cached_property
    def panels(self) -> tuple[Panel, ...]:
        """What ``make`` gives: a terminal shows no pictures and never asks."""
        return self.make()


@dataclass(frozen=True, slots=True)
class Equation:
    """A displayed equation in Typst math, from the constants of this package only, and how it is read aloud."""

    math: str
    alt: str


@dataclass(frozen=True, slots=True)
class Definitions:
    """Labels and their values."""

    items: tuple[tuple[str, str], ...]


@dataclass(frozen=True, slots=True)
class Code:
    """Lines to be typed."""

    lines: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Details:
    """Blocks folded away under a line of text in HTML, printed in full on paper.

    The terminal prints them, too, or says the line alone where they are ``long``: a row for every run or look.
    """

    summary: str
    blocks: tuple[Block, ...]
    long: bool = False


Block: TypeAlias = Paragraph | Bullets | KeyFigures | Table | FigureBlock | Equation | Definitions | Code | Details


@dataclass(frozen=True, slots=True)
class Section:
    """A heading with its blocks and the sections under it."""

    key: str
    """Anchor, unique in the report, of letters, digits and hyphens."""
    title: str
    blocks: tuple[Block, ...]
    sections: tuple[Section, ...] = ()

    new_page: bool = False
    """Whether paper starts a page before it, unless a few lines alone would stand on the page that is left."""


def unfolded(blocks: Iterable[Block]) -> Iterator[Block]:
    """Blocks in their order, those of `Details` in its place."""
    for block in blocks:
        if isinstance(block, Details):
            yield from unfolded(block.blocks)
        else:
            yield block


@dataclass(frozen=True, slots=True)
class Report:
    """A whole report."""

    title: str
    subtitle: str

    state: str
    """Which state of which campaign it shows. No clock is read: equal campaigns give equal files."""
    version: str
    """Of the program."""
    sections: tuple[Section, ...]
    """The first is the summary."""
    byline: str = ""
    """Author and date, as the campaign's file has them."""
    profiles: tuple[tuple[str, str], ...] = ()
    """Title and JSON of each prediction profiler, which a page shows and paper cannot; see `seqrsm.report.profile`."""
