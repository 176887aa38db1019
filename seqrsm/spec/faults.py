"""How a fault of ``campaign.toml`` is told to the user: with its line, in the words of the file."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping
from typing import Any

from seqrsm.errors import Problem
from seqrsm.spec.tables import Table
from seqrsm.spec.toml_lines import Path, line_of


class Reporter:
    """Collects problems of a file with their lines, from `seqrsm.spec.toml_lines.key_lines`."""

    def __init__(self, file: str, lines: dict[Path, int]) -> None:
        self.file = file
        self.lines = lines
        self.problems: list[Problem] = []
        self.names: dict[Path, str] = {}

    def add(self, path: Path, message: str, remedy: str = "", value: object | None = None) -> None:
        """Note a problem of the key or table at ``path``."""
        line = line_of(self.lines, path)
        self.problems.append(Problem(message, remedy, self.file, line, self.words(path), value))

    def words(self, path: Path) -> str:
        """The place in the user's words, such as ``factor 'frequency': low`` or ``[stop] level``."""
        if len(path) == 1 or not isinstance(path[1], int):
            head, rest = f"[{path[0]}]", path[1:]
        else:
            name = self.names.get(path[:2])
            head = f"{path[0]} no. {path[1] + 1}" if name is None else f"{path[0]} '{name}'"
            head, rest = (head + ":" if path[2:] else head), path[2:]
        tail = ""
        for part in rest:
            tail += f" no. {part + 1}" if isinstance(part, int) else (f".{part}" if tail else f"{part}")
        return f"{head} {tail}".strip()

    def unknown_key(self, path: Path, known: Iterable[str]) -> None:
        """Note a key that is not one of ``known``, with the nearest of them."""
        names = list(known)
        near = difflib.get_close_matches(str(path[-1]), names, n=1)
        others = f"Known here: {', '.join(names)}." if names else "Remove it."
        self.add(path, f"'{path[-1]}' is not a known key", f"Did you mean '{near[0]}'?" if near else others)

    def invalid(self, path: Path, detail: Mapping[str, Any], table: type[Table]) -> None:
        """Note one error of pydantic's list, of a table of this class."""
        # pydantic adds the branch of a union ("str", "float") to the place; it is no key of the file.
        location = path
        for part in detail["loc"]:
            if (*location, part) in self.lines or detail["type"] in ("missing", "extra_forbidden"):
                location = (*location, part)
        kind, value = detail["type"], detail["input"] if detail["loc"][-1:] != ("url",) else "***"
        if any(p.line == line_of(self.lines, location) and p.field == self.words(location) for p in self.problems):
            return
        if kind == "extra_forbidden":
            self.unknown_key(location, [] if len(detail["loc"]) > 1 else table.model_fields)
        elif kind == "missing":
            self.add(location, "the key is missing", f"Add: {detail['loc'][-1]} = ...")
        elif kind in ("model_type", "dict_type"):
            header = ".".join(str(part) for part in location if isinstance(part, str))
            header = f"[[{header}]]" if len(location) == 2 and isinstance(location[1], int) else f"[{header}]"
            self.add(location, "a table is expected here", f"Write it as a table: {header}.", value)
        elif kind in _WRONG_TYPE:
            self.add(location, f"{_WRONG_TYPE[kind]} is expected here", _retype(kind, location, value), value)
        else:
            message = detail["msg"].removeprefix("Input ").replace("should", "must", 1)
            options = re.findall(r"'([^']*)'", message) if kind == "literal_error" else []
            near = difflib.get_close_matches(str(value), options, n=1)
            remedy = f'Did you mean "{near[0]}"?' if near else ""
            if location[-1] == "level" and isinstance(value, int | float) and 1.0 < value < 100.0:
                remedy = f"Write {value / 100.0:g} for {value:g} %."
            self.add(location, message[:1].lower() + message[1:], remedy, value)


_WRONG_TYPE = {
    "float_type": "a number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "string_type": "text",
    "list_type": "a list",
    "finite_number": "a finite number",
}


def _retype(kind: str, location: Path, value: object) -> str:
    if kind == "string_type" and "levels" in location and isinstance(value, int | float):
        return "Put it in quotes, or give numbers as values = [...] instead of levels."
    if kind == "string_type":
        return "Put it in quotes."
    if kind == "list_type":
        return "Write it in square brackets: [ ... ]."
    if isinstance(value, str):
        return "Write the number without quotes, with a point for decimals and no unit."
    return ""
