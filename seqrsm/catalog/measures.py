"""Which utility that ships measures an application of the catalogue, or why none does.

``measures.csv``: patterns, the first of which that is found in the words counts; the utility as in ``campaign.toml``,
and the engine that it needs or suits; or why there is none.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import lru_cache

from seqrsm.catalog.reader import rows_of


@dataclass(frozen=True, slots=True)
class Measure:
    """What an application is measured by.

    Attributes
    ----------
    utility : str
        As in ``campaign.toml``; "" where none that ships measures it.
    engine : str
        "psm" or "prm", which the utility needs or suits; "" without one.
    says : str
        Why there is none; "" where there is one.
    """

    utility: str
    engine: str
    says: str


def measure_of(words: str) -> Measure:
    """The measure of an application, from its words: the first row of ``measures.csv`` whose pattern is in them."""
    text = words.lower()
    return next(found for pattern, found in _measures() if pattern.search(text))


@lru_cache(maxsize=1)
def _measures() -> list[tuple[re.Pattern[str], Measure]]:
    rows = rows_of("measures.csv")
    return [(re.compile(row["pattern"]), Measure(row["utility"], row["engine"], row["says"])) for row in rows]
