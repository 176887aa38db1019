"""JSON schemas of what commands print with ``--json``; ``json_schemas.json`` beside this file holds them.

Tests hold every command's documents against them, and no field may be missing there.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from seqrsm.errors import Problem, UserError


def output_schema(command: str) -> dict[str, Any]:
    """The schema, draft 2020-12, of a command's document, with the definitions that it needs.

    Raises
    ------
    UserError
        No command of this name prints JSON.
    """
    held = json.loads(Path(__file__).with_suffix(".json").read_text(encoding="utf-8"))
    if command not in held["commands"]:
        remedy = f"Use one of {', '.join(held['commands'])}; without a command, the schema is that of campaign.toml."
        raise UserError(Problem("no command of this name has --json", remedy, field="COMMAND", value=command))
    needed: dict[str, Any] = {}
    left = [held["commands"][command]]
    while left:
        for name in re.findall(r'"#/\$defs/(\w+)"', json.dumps(left.pop())):
            if name not in needed:
                needed[name] = held["$defs"][name]
                left.append(needed[name])
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"seqrsm {command} --json",
        **held["commands"][command],
        "$defs": needed,
    }
