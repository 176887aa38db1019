"""The many statements that a simulation makes on its assumptions, put in order: by what they are about."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

CHANNELS = ("HH", "HV", "VH", "VV")

_STATUS = re.compile(r"\((assumed|computed|public|public_code|public_data|interpolated)\b")


@dataclass(frozen=True, slots=True)
class GroupedNotes:
    """Statements by subject.

    Attributes
    ----------
    about_covers : tuple of (str, tuple of str)
        A statement and the cover categories it is made on, in the order of their first mention.
    about_channels : tuple of (str, str, str)
        Category, channel, and a statement on both.
    others : tuple of str
        Statements on the whole simulation.
    """

    about_covers: tuple[tuple[str, tuple[str, ...]], ...]
    about_channels: tuple[tuple[str, str, str], ...]
    others: tuple[str, ...]


def group_notes(notes: Iterable[str], categories: Sequence[str]) -> GroupedNotes:
    """Sort statements of the form "category: ..." and "category channel: ..." from the others.

    Parameters
    ----------
    notes : iterable of str
        As `RadarImage.notes` has them; repeated ones count once.
    categories : sequence of str
        Names of the scene's cover categories.
    """
    known = set(categories)
    covers: dict[str, list[str]] = {}
    channels: list[tuple[str, str, str]] = []
    others: list[str] = []
    for note in dict.fromkeys(notes):
        subject, colon, text = note.partition(": ")
        head, _, tail = subject.rpartition(" ")
        if colon and subject in known:
            covers.setdefault(text, []).append(subject)
        elif colon and head in known and tail in CHANNELS:
            channels.append((head, tail, text))
        else:
            others.append(note)
    return GroupedNotes(
        tuple((text, tuple(dict.fromkeys(names))) for text, names in covers.items()), tuple(channels), tuple(others)
    )


def summarise_notes(notes: Iterable[str], categories: Sequence[str]) -> tuple[str, ...]:
    """One line for each kind of statement, with counts, for a terminal.

    Parameters
    ----------
    notes, categories :
        As for `group_notes`.
    """
    grouped = group_notes(notes, categories)
    lines = []
    if grouped.about_covers:
        covers = {name for _, names in grouped.about_covers for name in names}
        texts = [text for text, names in grouped.about_covers for _ in names]
        lines.append(f"mean backscatter of {len(covers)} covers: {_statuses(texts)}")
    if grouped.about_channels:
        pairs = len(grouped.about_channels)
        texts = [text for _, _, text in grouped.about_channels]
        lines.append(f"scatter among fields and dates, {pairs} pairs of cover and channel: {_statuses(texts)}")
    return (*lines, *grouped.others)


def _statuses(texts: Sequence[str]) -> str:
    """How many statements rest on what."""
    counts: dict[str, int] = {}
    for text in texts:
        for status in set(_STATUS.findall(text)) or {"derived"}:
            plain = "public" if status.startswith("public") else status
            counts[plain] = counts.get(plain, 0) + 1
    order = ("assumed", "computed", "public", "interpolated", "derived")
    return ", ".join(f"{counts[status]} {status}" for status in order if status in counts)
