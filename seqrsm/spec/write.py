"""A campaign's folder from Python values: its ``campaign.toml`` is written, then read and checked as any other."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from seqrsm.errors import SpecError
from seqrsm.spec.read import SPEC_NAME, load_spec
from seqrsm.spec.templates import new_folder


def create_campaign(folder: Path, tables: Mapping[str, Any]) -> None:
    """Make a campaign's folder, new or empty, of the tables of ``campaign.toml``, repeated ones as lists.

    UserError where the folder cannot be made, or of everything that is wrong in the tables; then there is no folder.
    """
    is_new = not folder.exists()
    with new_folder(folder) as part:
        (part / SPEC_NAME).write_text(toml_text(tables), encoding="utf-8")
    try:
        load_spec(folder)
    except SpecError as error:
        (folder / SPEC_NAME).unlink()
        with suppress(OSError):
            if is_new:
                folder.rmdir()
        raise SpecError(*(replace(one, file=None, line=None) for one in error.problems)) from None


def factor_tables(factors: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Tables of factors: a tuple of two numbers is a range, a list or array its values or levels, a mapping the keys.

    SpecError of anything else.
    """
    tables = []
    for name, value in factors.items():
        given = value.tolist() if hasattr(value, "tolist") else value  # an array or a column of a table
        if isinstance(given, Mapping):
            keys = dict(given)
        elif isinstance(given, tuple) and len(given) == 2 and not any(isinstance(one, str) for one in given):
            keys = dict(zip(("low", "high"), given, strict=True))
        elif isinstance(given, Sequence) and not isinstance(given, str):
            keys = {"levels" if any(isinstance(one, str) for one in given) else "values": list(given)}
        else:
            remedy = 'Give (low, high), ["level", ...], or {"low": 1.0, "high": 9.0, "unit": "GHz", "scale": "log"}.'
            raise SpecError(f"factor '{name}': {given!r} has neither a range nor levels. {remedy}")
        tables.append({"name": name, **keys})
    return tables


def toml_text(tables: Mapping[str, Any]) -> str:
    """TOML of tables, and lists of tables, of plain values; SpecError for what is no table."""
    parts = []
    for name, given in tables.items():
        for table in given if isinstance(given, list) else [given]:
            if not isinstance(table, Mapping):
                raise SpecError(f"[{name}] is a table", "Give a mapping of its keys.", value=table)
            head = f"[[{name}]]" if isinstance(given, list) else f"[{name}]"
            parts.append("\n".join([head, *_lines(table)]))
    return "\n\n".join(parts) + "\n"


def _lines(table: Mapping[str, Any]) -> Iterator[str]:
    for key, value in table.items():
        if value is not None:
            text = str(key)
            name = text if re.fullmatch(r"[A-Za-z0-9_-]+", text) else json.dumps(text, ensure_ascii=False)
            yield f"{name} = {_value(value)}"


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{ " + ", ".join(_lines(value)) + " }"
    if isinstance(value, (list, tuple, np.ndarray)):
        return "[" + ", ".join(map(_value, value)) + "]"
    if isinstance(value, (bool, np.bool_)):
        return str(value).lower()
    if isinstance(value, (int, np.integer)):
        return str(int(value))
    if isinstance(value, (float, np.floating)):
        return repr(float(value))
    return json.dumps(str(value), ensure_ascii=False).replace("\x7f", "\\u007f")
