"""``seqrsm help``: the guides that stand beside what they explain, read from the installed package or a checkout."""

from __future__ import annotations

import re
from dataclasses import dataclass

from seqrsm.cli.console import ascii_signs, heading, line, show_table, stdout
from seqrsm.errors import UserError
from seqrsm.spec.templates import packaged

_GUIDES = ("campaigns", "reports", "seqrsm")
_HEADING = re.compile(r"^(#{1,3}) (.+)$")
_HIDDEN = re.compile(r"^(<!-- .* -->|!\[.*\]\(.*\))\n", re.M)  # a picture is none on a terminal
_LINK = re.compile(r"\[([^\]]+)\]\([^)]+\)")


@dataclass(frozen=True, slots=True)
class Topic:
    """A heading of a guide with the text under it; ``level`` 1 is the guide's title."""

    title: str
    level: int
    text: str


def topics() -> list[Topic]:
    """All headings of all guides, in their order."""
    return [topic for name in _GUIDES for topic in _split(packaged(name).joinpath("README.md").read_text("utf-8"))]


def _split(text: str) -> list[Topic]:
    found: list[tuple[str, int, list[str]]] = []
    fenced = False
    for row in _HIDDEN.sub("", text).splitlines():
        fenced ^= row.startswith("```")
        match = None if fenced else _HEADING.match(row)
        if match:
            found.append((match[2], len(match[1]), []))
        elif not row.startswith("```"):
            found[-1][2].append(f"    {row}" if fenced else row)
    return [Topic(title, level, "\n".join(lines).strip()) for title, level, lines in found]


def show(topic: Topic) -> None:
    """Print a topic: paragraphs and tables as wide as the terminal, what is to be typed as it is."""
    heading(topic.title)
    for part in re.split(r"\n{2,}", topic.text):
        lines = (part if part.startswith("    ") else _LINK.sub(r"\1", part)).splitlines()
        if part.startswith("|"):
            head, _, *rows = ([cell.strip() for cell in one.strip("|").split("|")] for one in lines)
            show_table(head, rows, sides=("left",))
        elif all(one.startswith(("    ", "* ", "  ")) for one in lines):
            for one in lines:
                stdout().print(ascii_signs(one), markup=False, highlight=False, soft_wrap=True)
        else:
            line(" ".join(lines))
        line()


def about(words: str) -> list[Topic]:
    """Topics whose title holds the words, with all under them, else those whose text does; UserError without any."""
    wanted, known = words.replace("`", "").casefold(), topics()
    found, under = [], 9
    for one in known:
        if wanted in one.title.replace("`", "").casefold():
            under = min(under, one.level)
        elif one.level <= under:
            under = 9
        if under < 9:
            found.append(one)
    found = found or [one for one in known if wanted in one.text.casefold()]
    if not found:
        raise UserError("no guide covers this topic", "seqrsm help lists the topics.", value=words)
    return found
