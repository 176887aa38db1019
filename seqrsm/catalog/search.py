"""Look-up by words: case and word endings do not matter, and every word has to be found."""

from __future__ import annotations

import re
from collections.abc import Iterable
from functools import lru_cache

from seqrsm.catalog.tables import Entry, Platform, Table, load_catalog

_WORD = re.compile(r"[^\W_]+")
_TABLE = re.compile(r"a\.?\s*(\d{1,2})", re.IGNORECASE)
_ENDINGS = (
    "ifications", "ification", "ifying", "ified", "ifies", "ify",
    "ations", "ation", "ating", "ated", "ates", "ate",
    "ings", "ing", "ions", "ion", "ies", "ed", "es", "s", "y", "e",
)  # fmt: skip
_SHORTEST_STEM = 3
_SHORTEST_PREFIX = 4

#: Words that Tables A.1 to A.20 use for one another; each group counts as one word.
SYNONYMS: tuple[frozenset[str], ...] = (
    frozenset({"classification", "identification"}),
    frozenset({"moisture", "moist"}),
    frozenset({"corn", "maize"}),
    frozenset({"slick", "spill"}),
)


@lru_cache(maxsize=4096)
def stem(word: str) -> str:
    """``word``, in any case, without its ending: "mapping", "maps" and "map" give the same.

    At least three letters are left of a word that has them.
    """
    word = word.lower()
    if word.endswith("ss"):
        return word
    for ending in _ENDINGS:
        if word.endswith(ending) and len(word) - len(ending) >= _SHORTEST_STEM:
            kept = word.removesuffix(ending)
            # classify and classification keep what tells them from class: the i of -ify
            if ending.startswith("if"):
                return kept + "if"
            return kept[:-1] if len(kept) > _SHORTEST_STEM and kept[-1] == kept[-2] else kept
    return word


def words_of(text: str) -> tuple[str, ...]:
    """Words of ``text`` in lower case, without punctuation."""
    return tuple(_WORD.findall(text.lower()))


def _same(word: str) -> frozenset[str]:
    """Stems of ``word`` and its synonyms."""
    own = stem(word)
    for group in SYNONYMS:
        stems = frozenset(stem(other) for other in group)
        if own in stems:
            return stems
    return frozenset({own})


def _weight(word: str, text: str) -> int:
    """2 where ``text`` has the word, 1 where a word of it begins so ("snow" in "Snowfield"), 0 else."""
    stems = {stem(other) for other in words_of(text)}
    if _same(word) & stems:
        return 2
    beginnings = tuple(part for part in (word, stem(word)) if len(part) >= _SHORTEST_PREFIX)
    return int(any(other.startswith(beginnings) for other in words_of(text)))


def _rank(words: Iterable[str], entry: Entry) -> tuple[int, int] | None:
    """(words found in the application itself, their weight), or None where a word is found nowhere."""
    application = f"{entry.group} {entry.application} {entry.reading}"
    in_name, weight = 0, 0
    for word in words:
        here = _weight(word, application)
        there = _weight(word, entry.category)
        if not here and not there:
            return None
        in_name += here > 0
        weight += 2 * here if here else there
    return in_name, weight


def search(words: str, *, system: str | None = None) -> tuple[Entry, ...]:
    """Entries of Tables A.1 to A.20 whose application or user category holds every one of ``words``, the best first.

    Words may stand in any order and case; without any, every entry is found. ``system``, "active" or "passive": only
    radar or only radiometer entries. The best have most words in the application itself (and not only in its user
    category), then whole words before beginnings of words, tables with numbers on the sensor (A.16 to A.20) before the
    lists, then as printed. The statements "None" are never among them.
    """
    wanted = words_of(words)
    found = []
    for place, entry in enumerate(load_catalog().entries):
        if entry.is_none or system not in (None, entry.system):
            continue
        rank = _rank(wanted, entry)
        if rank is not None:
            found.append((-rank[0], -rank[1], not entry.polarization, place, entry))
    found.sort(key=lambda item: item[:4])
    return tuple(item[-1] for item in found)


def entries_about(words: str, *, system: str | None = None) -> tuple[Entry, ...]:
    """The entries of `search` that name all of ``words`` in the application itself; all found, if none does.

    Numbers are taken from these: "water pollution" then means that application and not every pollution entry that
    stands under Water Resources.
    """
    found = search(words, system=system)
    wanted = words_of(words)
    named = tuple(entry for entry in found if (_rank(wanted, entry) or (0, 0))[0] == len(wanted))
    return named or found


def table_called(text: str) -> Table | None:
    """The table of a number, such as "A.32"; None where ``text`` is no such number."""
    found = _TABLE.fullmatch(text.strip())
    return next((t for t in load_catalog().tables if found and t.number == f"A.{int(found[1])}"), None)


def platforms_called(words: str) -> tuple[Platform, ...]:
    """Platforms of Tables A.21 to A.39 whose name holds every one of ``words``, or begins one of its own so."""
    wanted = words_of(words)
    return tuple(
        platform
        for platform in load_catalog().platforms
        if wanted and all(any(own.startswith(word) for own in words_of(platform.name)) for word in wanted)
    )
