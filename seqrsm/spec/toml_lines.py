"""Finds the line on which each key of a TOML text stands.

:mod:`tomllib` tells no lines, but a message about a wrong value without its line is half a message. A text that
:mod:`tomllib` has accepted parts into statements, headers of tables and pairs, and each of them it reads alone.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from itertools import pairwise
from typing import TypeAlias

Path: TypeAlias = tuple[str | int, ...]

_STRING = re.compile(
    r'"""(?:[^\\]|\\.)*?"{3,5}' r"|'''.*?'{3,5}" r'|"(?:[^"\\\n]|\\.)*"' r"|'[^'\n]*'|#[^\n]*", re.DOTALL
)
"""A string, or a comment: brackets and commas in them part nothing."""


def key_lines(text: str) -> dict[Path, int]:
    """Line, from 1, of every table, key and array element of a text that :func:`tomllib.loads` accepts.

    A path holds keys and, for arrays, indices: ``("factor", 0, "low")``.
    """
    lines: dict[Path, int] = {(): 1}
    arrays: dict[Path, int] = {}  # of tables: index of the last
    table: Path = ()
    for line, statement, bare in _statements(text):
        found: object = tomllib.loads(statement)
        if not bare.lstrip().startswith("["):
            elements = list(_element_lines(bare.partition("=")[2].lstrip(" \t"), line))
            # The first mention wins: of a.x = 1 and a.y = 2, as of [a.b] and [a], the first opens the table.
            for path in _paths(found, table):
                index = next((part for part in path[len(table) :] if isinstance(part, int)), None)
                lines.setdefault(path, elements[index] if elements and index is not None else line)
            continue
        table = ()
        while isinstance(found, dict) and found:
            ((key, found),) = found.items()
            table = (*table, key)
            lines.setdefault(table, line)
            if isinstance(found, list):
                arrays[table] = arrays.get(table, -1) + 1
            if table in arrays:
                table = (*table, arrays[table])
                lines.setdefault(table, line)
    return lines


def _statements(text: str) -> Iterator[tuple[int, str, str]]:
    """Number of the first line of each statement, its text, and the same with but the first sign of every string."""
    bare = _STRING.sub(lambda found: found[0][0].strip("#") + re.sub(r"[^\n]", " ", found[0][1:]), text).split("\n")
    starts, depth = [], 0
    for number, row in enumerate(bare):
        if depth == 0 and row.strip():
            starts.append(number)
        depth += sum(map(_deeper, row))
    rows = [f"{row}\n" for row in text.split("\n")]
    for first, last in pairwise([*starts, len(rows)]):
        yield first + 1, "".join(rows[first:last]), "\n".join(bare[first:last])


def _deeper(sign: str) -> int:
    return (sign in "[{") - (sign in "]}")


def _element_lines(value: str, line: int) -> Iterator[int]:
    """Line on which each element of an array begins; of any other value nothing."""
    depth, begins = 0, False
    for sign in value if value.startswith("[") else "":
        if begins and not sign.isspace():
            yield line
            begins = False
        line += sign == "\n"
        depth += _deeper(sign)
        begins = begins or (depth == 1 and sign in "[,")


def _paths(value: object, path: Path) -> Iterator[Path]:
    """Path of a value, and of everything inside it."""
    yield path
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, part in inner:
        yield from _paths(part, (*path, key))


def line_of(lines: dict[Path, int], path: Path) -> int:
    """Line of ``path``, or of the nearest table around it when the key itself is not in the text."""
    while path not in lines:
        path = path[:-1]
    return lines[path]
