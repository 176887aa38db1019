"""Finds the line on which each key of a TOML text stands.

:mod:`tomllib` tells no lines, but a message about a wrong value without its line is half a message. The scanner runs
only on text that :mod:`tomllib` has accepted, so it may take the syntax for granted and need not build values.
"""

from __future__ import annotations

import re
import tomllib
from bisect import bisect_right
from collections.abc import Callable
from typing import TypeAlias

Path: TypeAlias = tuple[str | int, ...]

_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")
_BASIC_STRING = re.compile(r'"(?:[^"\\\n]|\\.)*"')
_LITERAL_STRING = re.compile(r"'[^'\n]*'")
_LONG_BASIC_STRING = re.compile(r'"""(?:[^\\]|\\.)*?"{3,5}', re.DOTALL)
_LONG_LITERAL_STRING = re.compile(r"'''.*?'{3,5}", re.DOTALL)
_STRINGS = {'"""': _LONG_BASIC_STRING, "'''": _LONG_LITERAL_STRING, '"': _BASIC_STRING, "'": _LITERAL_STRING}
_PLAIN_VALUE = re.compile(r"[^,\]}#\n]+")
_BLANK = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
_SPACE = re.compile(r"[ \t]*")


class _Scanner:
    def __init__(self, text: str) -> None:
        self.text = text
        self.position = 0
        self.newlines = [match.start() for match in re.finditer("\n", text)]
        self.lines: dict[Path, int] = {(): 1}
        self.array_lengths: dict[Path, int] = {}

    def take(self, pattern: re.Pattern[str]) -> str:
        match = pattern.match(self.text, self.position)
        if match is None:
            raise ValueError(f"no {pattern.pattern} at {self.position}")
        self.position = match.end()
        return match.group()

    def at(self, token: str) -> bool:
        return self.text.startswith(token, self.position)

    def mark(self, path: Path, position: int) -> None:
        # The first mention wins: of [a.b] and [a], or of a.x = 1 and a.y = 2, the first opens the table.
        self.lines.setdefault(path, bisect_right(self.newlines, position - 1) + 1)

    def document(self) -> None:
        table: Path = ()
        self.take(_BLANK)
        while self.position < len(self.text):
            if self.at("["):
                table = self.header()
            else:
                self.pair(table)
            self.take(_BLANK)

    def keys(self) -> list[tuple[str, int]]:
        """Parts of a possibly dotted key, each with its position."""
        parts: list[tuple[str, int]] = []
        while True:
            self.take(_SPACE)
            start = self.position
            if self.at('"'):
                parts.append((str(tomllib.loads("k = " + self.take(_BASIC_STRING))["k"]), start))
            elif self.at("'"):
                parts.append((self.take(_LITERAL_STRING)[1:-1], start))
            else:
                parts.append((self.take(_BARE_KEY), start))
            self.take(_SPACE)
            if not self.at("."):
                return parts
            self.position += 1

    def header(self) -> Path:
        start = self.position
        double = self.at("[[")
        self.position += 2 if double else 1
        path: Path = ()
        parts = self.keys()
        for index, (key, _) in enumerate(parts):
            path += (key,)
            if double and index == len(parts) - 1:
                self.mark(path, start)
                number = self.array_lengths.get(path, 0)
                self.array_lengths[path] = number + 1
                path += (number,)
            elif path in self.array_lengths:
                path += (self.array_lengths[path] - 1,)
            self.mark(path, start)
        self.position += 2 if double else 1
        return path

    def pair(self, table: Path) -> None:
        path = table
        for key, position in self.keys():
            path += (key,)
            self.mark(path, position)
        self.position += 1  # the equals sign
        self.take(_SPACE)
        self.value(path)

    def value(self, path: Path) -> None:
        if self.at("["):
            self.parts("]", lambda number: self.element((*path, number)))
        elif self.at("{"):
            self.parts("}", lambda _: self.pair(path))
        else:
            self.take(next((string for start, string in _STRINGS.items() if self.at(start)), _PLAIN_VALUE))

    def element(self, path: Path) -> None:
        self.mark(path, self.position)
        self.value(path)

    def parts(self, end: str, take_part: Callable[[int], None]) -> None:
        """All between two brackets, by commas."""
        self.position += 1
        self.take(_BLANK)
        number = 0
        while not self.at(end):
            take_part(number)
            number += 1
            self.take(_BLANK)
            if self.at(","):
                self.position += 1
                self.take(_BLANK)
        self.position += 1


def key_lines(text: str) -> dict[Path, int]:
    """Line of every table, key and array element of a valid TOML text.

    Parameters
    ----------
    text : str
        Text that :func:`tomllib.loads` accepts.

    Returns
    -------
    dict of path to int
        1-based lines. A path holds keys and, for arrays, indices: ``("factor", 0, "low")``.
    """
    scanner = _Scanner(text)
    scanner.document()
    return scanner.lines


def line_of(lines: dict[Path, int], path: Path) -> int:
    """Line of ``path``, or of the nearest table around it when the key itself is not in the text."""
    while path not in lines:
        path = path[:-1]
    return lines[path]
