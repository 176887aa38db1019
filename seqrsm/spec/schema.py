"""JSON schema of ``campaign.toml``, by which editors complete and check it; what each key means comes along.

It says what keys there are, and of what type; what they must be together only `seqrsm.spec.read` knows.
"""

from __future__ import annotations

import re
from typing import Any

from pydantic.json_schema import models_json_schema

from seqrsm.spec import read
from seqrsm.spec.tables import Table


def campaign_schema() -> dict[str, Any]:
    """The schema, draft 2020-12."""
    tables: dict[str, type[Table]] = {**read.SINGLE, **read.REPEATED}
    _, found = models_json_schema([(table, "validation") for table in tables.values()])
    definitions: dict[str, Any] = found["$defs"]
    clauses = _clauses(read.__doc__ or "")
    by_class = {table.__name__: name for name, table in tables.items()} | {"KnowledgeSpec": "application.prior"}
    for name, definition in definitions.items():
        definition["description"] = definition.get("description", "").split("\n\n")[0].replace("``", "")
        for key, field in definition["properties"].items():
            field.pop("title", None)
            if text := _told(clauses.get(by_class.get(name, ""), []), key):
                field["description"] = text
    properties: dict[str, Any] = {}
    for name, table in tables.items():
        one = {"$ref": f"#/$defs/{table.__name__}"}
        properties[name] = {"type": "array", "minItems": 1, "items": one} if name in read.REPEATED else one
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "campaign.toml of seqrsm",
        "type": "object",
        "properties": properties,
        "required": list(read.REQUIRED),
        "additionalProperties": False,
        "$defs": definitions,
    }


def _clauses(text: str) -> dict[str, list[str]]:
    """What the module that reads the file says of each table, cut where a clause begins with a key."""
    found = {}
    for part in re.split(r"(?m)^(?=``\[)", text)[1:]:
        head, _, body = part.partition("\n")
        table = re.sub(r"[\[\]]", "", head.split("``")[1])
        found[table] = re.split(r"(?:; |\. |: )(?=``\w)|; and either ", " ".join(body.split()))
    return found


def _told(clauses: list[str], key: str) -> str:
    """The clause that begins with a key, else the first that names it; "" for none."""
    name = rf"``{key}\b"
    first = next((one for one in clauses if re.match(rf"(``\w+``( \([^)]*\))?(,| and|, and) )*{name}", one)), "")
    clause = first or next((one for one in clauses if re.search(name, one)), "")
    return clause.replace("``", "").replace(":mod:", "").strip(" .;")
