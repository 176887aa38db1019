"""Values as JSON can hold them, and as sentences show them. No numpy import: the command line starts without it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any


def plain(value: Any) -> Any:
    """``value`` with numpy scalars and arrays as Python's, and nan and infinities as None.

    Mappings keep their order with keys as text, dataclasses are mappings of their fields; sequences and sets become
    lists; anything else becomes its text.
    """
    if hasattr(value, "__dataclass_fields__"):
        value = shallow(value)
    if isinstance(value, Mapping):
        return {str(key): plain(inner) for key, inner in value.items()}
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, str | int | bool) or value is None:
        return value
    if isinstance(value, Sequence | set | frozenset):
        return [plain(inner) for inner in value]
    return str(value)


def shallow(found: Any) -> dict[str, Any]:
    """The fields of a dataclass by their names, what they hold as it is (`dataclasses.asdict` copies it)."""
    return {name: getattr(found, name) for name in found.__dataclass_fields__}


def counted(n: int, one: str, many: str = "") -> str:
    """Return ``"1 cover"`` or ``"3 covers"``; ``many`` where that is not ``one`` with an s."""
    return f"{n} {one if n == 1 else many or f'{one}s'}"


def few(numbers: Sequence[int | None]) -> str:
    """The first ten, as in "1, 2, 5"."""
    return ", ".join(str(number) for number in numbers[:10]) + (", ..." if len(numbers) > 10 else "")


def lines_of(numbers: Sequence[int | None]) -> str:
    """The first ten lines of a file, as in "line 3" or "lines 3, 4"."""
    return f"{'line' if len(numbers) == 1 else 'lines'} {few(numbers)}"


def more_rows(lines: Sequence[int | None]) -> str:
    """What follows a message that holds for further lines of a file, too; "" for none."""
    return f" (so {counted(len(lines), 'more row')}: {lines_of(lines)})" if lines else ""


def heading(title: str, unit: str) -> str:
    """Title with its unit, where it has one, as on an axis or over a column."""
    return f"{title} [{unit}]" if unit else title
