"""The report as data: a tree of frozen blocks that the HTML and the PDF face both render.

Every number is already text here, so that the two faces cannot differ. All text is plain: neither face reads markup
out of it. Only ``Equation.math`` and ``Panel.svg`` are code, and both come from this package, never from a user.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

Align: TypeAlias = Literal["left", "right"]
Tone: TypeAlias = Literal["plain", "lead", "note", "warning"]


@dataclass(frozen=True, slots=True)
class Paragraph:
    """Running text. ``tone`` "lead" is the recommendation, "note" is small print, "warning" is boxed."""

    text: str
    tone: Tone = "plain"


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
    """Head of a table column; ``unit`` is shown in brackets after the title."""

    title: str
    unit: str = ""
    align: Align = "left"

    @property
    def heading(self) -> str:
        """Title and unit."""
        return f"{self.title} [{self.unit}]" if self.unit else self.title


@dataclass(frozen=True, slots=True)
class Cell:
    """Text of a table cell, and the number by which a column is sorted (None: sort by the text)."""

    text: str
    value: float | None = None


@dataclass(frozen=True, slots=True)
class Table:
    """A table whose first column names the row.

    Attributes
    ----------
    columns : tuple of Column
    rows : tuple of tuple of Cell
        Each as long as ``columns``.
    caption : str
        What the table shows.
    sortable : bool
        Whether the HTML face offers sorting; the rows stand in a useful order anyway.
    """

    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]
    caption: str
    sortable: bool = False

    def __post_init__(self) -> None:
        if any(len(row) != len(self.columns) for row in self.rows):
            raise ValueError(f"table {self.caption!r}: every row needs {len(self.columns)} cells")


@dataclass(frozen=True, slots=True)
class PanelData:
    """The numbers behind a picture, for a CSV file.

    Attributes
    ----------
    columns : tuple of str
        Names with units in brackets.
    rows : tuple of tuple
        Numbers and words, each row as long as ``columns``; nan is an empty cell.
    """

    columns: tuple[str, ...]
    rows: tuple[tuple[float | str, ...], ...]


@dataclass(frozen=True, slots=True)
class Panel:
    """One picture of a figure.

    Attributes
    ----------
    title : str
        Short heading over the picture, "" for none.
    alt : str
        What a reader who cannot see it should know.
    svg : str
        Drawing made by ``seqrsm.report.figures.drawing``; "" when ``png`` is given.
    png : bytes
        Bitmap; b"" when ``svg`` is given.
    name : str
        Stem of the files that ``seqrsm report --figures`` writes, in letters, digits and hyphens.
    data : callable
        Gives what the picture shows as numbers; asked only when the figures are written to files.
    """

    title: str
    alt: str
    svg: str = ""
    png: bytes = b""
    name: str = ""
    data: Callable[[], PanelData] | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class LegendEntry:
    """A colour and its meaning, for bitmaps."""

    color: str
    label: str


@dataclass(frozen=True, slots=True)
class FigureBlock:
    """Panels with one caption; ``columns`` is how many stand side by side on paper."""

    panels: tuple[Panel, ...]
    caption: str
    columns: int = 2
    legend: tuple[LegendEntry, ...] = ()


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
    """Blocks folded away under a line of text in HTML, and printed in full on paper."""

    summary: str
    blocks: tuple[Block, ...]


Block: TypeAlias = Paragraph | Bullets | KeyFigures | Table | FigureBlock | Equation | Definitions | Code | Details


@dataclass(frozen=True, slots=True)
class Section:
    """A heading with its blocks and the sections under it.

    Attributes
    ----------
    key : str
        Anchor, unique in the report, of letters, digits and hyphens.
    new_page : bool
        Whether paper starts a page before it.
    """

    key: str
    title: str
    blocks: tuple[Block, ...]
    sections: tuple[Section, ...] = ()
    new_page: bool = False


@dataclass(frozen=True, slots=True)
class Report:
    """A whole report.

    Attributes
    ----------
    title, subtitle : str
    state : str
        Which state of which campaign it shows. No clock is read: equal campaigns give equal files.
    version : str
        Of the program.
    sections : tuple of Section
        The first is the summary.
    """

    title: str
    subtitle: str
    state: str
    version: str
    sections: tuple[Section, ...]
