"""The utilities that ship, a row of ``data/utilities.csv`` each: what specification, engines and pages know of them.

A campaign names one as ``NAME``, ``NAME of COVER, COVER`` where it is about certain covers, and of those that classify
``NAME by UNIT``, a unit of `UNITS_OF_GROUND`: "f1 of Corn by field". A further one is a module of this package and a
row there. Functions are named and not imported, since they load the engines, which the specification does without.
"""

from __future__ import annotations

import csv
import difflib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

UNITS_OF_GROUND: Final = ("pixel", "neighbourhood", "segment", "field")
"""What is classified as a whole."""


@dataclass(frozen=True, slots=True)
class Utility:
    """What a score measures."""

    words: str = ""
    """What it is, in a line."""
    unit: str = ""
    """Of the scores; "" where they have none."""
    least: float = -math.inf
    most: float = math.inf
    """Ends that no score can leave; infinite where there are none."""
    is_percent: bool = False
    """Scores are percentages from 0 to 100."""
    is_error: bool = False
    """Scores are errors, which are made small."""
    function: str = ""
    """Function "module:function" that scores images of either engine; "" of what is measured only."""
    classifies: bool = False
    """It names covers, by a unit of ground."""
    of_covers: bool = False
    """It is about certain covers, which must be named."""
    of_one_kind: bool = False
    """On each date radars see it, or one radiometer: no combination."""


def _table() -> Mapping[str, Utility]:
    """Rows of ``data/utilities.csv``; traits, which are fields of `Utility`, are separated by blanks."""
    found = {}
    with (Path(__file__).parent / "data" / "utilities.csv").open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            traits: dict[str, Any] = dict.fromkeys(row["traits"].split(), True)
            ends = float(row["least"] or -math.inf), float(row["most"] or math.inf)
            found[row["name"]] = Utility(row["words"], row["unit"], *ends, function=row["function"], **traits)
    return found


UTILITIES: Final = _table()
"""By the names of ``campaign.toml``."""

_BY_CELLS: Final = ("percent_correct", "kappa", "f1")  # a map's score alone knows how common covers are

OF_THE_USER: Final = Utility()
"""What is known of a function of the user's own."""


@dataclass(frozen=True, slots=True)
class Asked:
    """A utility as a campaign asks for it."""

    name: str
    """Of `UTILITIES`."""
    covers: tuple[str, ...] = ()
    """That it is about; empty for all."""
    by: str = "pixel"
    """Unit of ground, of `UNITS_OF_GROUND`."""

    @property
    def row(self) -> Utility:
        """What is known of it."""
        return UTILITIES[self.name]

    def knows_areas(self, mapped: bool) -> bool:
        """Whether the classifier knows how common each cover is, without or beside (``mapped``) an existing map."""
        return self.name == "area_error" or (mapped and self.name in _BY_CELLS)


def asked_for(text: str) -> Asked:
    """A utility from the words of ``campaign.toml``.

    Raises
    ------
    ValueError
        What is wrong with them, in a sentence.
    """
    rest, _, by = text.partition(" by ")
    name, _, covers = rest.partition(" of ")
    named = tuple(part.strip() for part in covers.split(",") if part.strip())
    if name not in UTILITIES:
        near = difflib.get_close_matches(name, UTILITIES, n=1)
        own = 'or name your own function, "package.module:function"'
        hint = f'did you mean "{near[0]}"?' if near else f"use {', '.join(UTILITIES)}, {own}"
        raise ValueError(f"no utility is called {name!r}; {hint}")
    row = UTILITIES[name]
    if by and not row.classifies:
        raise ValueError(f'"{name}" does not classify: leave "{text[len(rest) :]}" out')
    if by and by not in UNITS_OF_GROUND:
        raise ValueError(f"ground is classified by {', '.join(UNITS_OF_GROUND)}, not by {by!r}")
    if named and not row.of_covers:
        raise ValueError(f'"{name}" applies to all covers: leave " of {covers}" out')
    if row.of_covers and not named:
        raise ValueError(f'"{name}" applies to named covers: write "{name} of" and their names, as in the scene')
    return Asked(name, named, by or "pixel")


def utility_of(text: str) -> Utility:
    """What is known of a utility in the words of ``campaign.toml``; `OF_THE_USER` of a function of the user's own."""
    try:
        return asked_for(text).row
    except ValueError:
        return OF_THE_USER
