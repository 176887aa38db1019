"""The JSON schema of ``campaign.toml``: the examples are valid by it, and what the reader refuses of types is not."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from seqrsm.cli.app import app
from seqrsm.errors import SpecError
from seqrsm.spec.read import load_spec
from seqrsm.spec.schema import campaign_schema

jsonschema = pytest.importorskip("jsonschema")
EXAMPLES = sorted((Path(__file__).parents[2] / "campaigns").glob("*/campaign.toml"))
TEXT = """\
[campaign]
name = "c"
[[factor]]
name = "x"
low = 0
high = 1.5
[[application]]
name = "a"
utility = "measured"
[application.prior]
utility = [40, 90.0]
effect = { x = [0.0, inf] }
[stop]
half_width = 3
"""


@pytest.fixture(scope="module")
def validator() -> Any:
    schema = json.loads(CliRunner().invoke(app, ["schema"]).stdout)
    assert schema == json.loads(json.dumps(campaign_schema()))
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.parent.name)
def test_examples_are_valid(validator: Any, path: Path) -> None:
    assert list(validator.iter_errors(tomllib.loads(path.read_text(encoding="utf-8")))) == []


def test_the_least_is_valid(validator: Any) -> None:
    assert list(validator.iter_errors(tomllib.loads(TEXT))) == []


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("[stop]", "[stopp]"),
        ("half_width = 3", "half_width = 0"),
        ("half_width = 3", "half_widht = 3"),
        ("half_width = 3", 'half_width = "wide"'),
        ("half_width = 3", 'half_width = 3\nguard = "none"'),
        ("half_width = 3", "half_width = 3\nmax_runs = 2.5"),
        ('name = "c"', 'name = "c"\nseed = -1'),
        ("low = 0", 'low = 0\nscale = "cubic"'),
        ("utility = [40, 90.0]", "utility = [40]"),
        ('utility = "measured"', 'utility = "measured"\ngoal = "more"'),
    ],
)
def test_what_is_refused_is_not_valid(validator: Any, tmp_path: Path, old: str, new: str) -> None:
    text = TEXT.replace(old, new, 1)
    assert text != TEXT
    (tmp_path / "campaign.toml").write_text(text, encoding="utf-8")
    with pytest.raises(SpecError):
        load_spec(tmp_path)
    assert list(validator.iter_errors(tomllib.loads(text)))


def test_every_key_says_what_it_means() -> None:
    definitions = campaign_schema()["$defs"]
    silent = [
        f"{name}.{key}"
        for name, definition in definitions.items()
        for key, field in definition["properties"].items()
        if not field.get("description")
    ]
    own = {"ApplicationSpec.prior", "ExpectedOptimum.value", "ExpectedOptimum.doubt"}
    assert set(silent) == own  # said of the table that they are in
    assert definitions["StopSpec"]["properties"]["half_width"]["description"].startswith(
        "half_width: target half-width"
    )
