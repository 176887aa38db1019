"""Commands of the program as users type them, in this process."""

from __future__ import annotations

import json
from typing import Any

from typer.testing import CliRunner, Result

from seqrsm.cli.app import app


def seqrsm(*arguments: object) -> Result:
    """Outcome of a command, whatever it is."""
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def call(*arguments: object, code: int = 0) -> Result:
    """Outcome of a command that must end with this exit code."""
    result = seqrsm(*arguments)
    assert result.exit_code == code, result.output + repr(result.exception)
    assert "Traceback" not in result.output
    return result


def ok(*arguments: object) -> str:
    """What a command that must succeed prints on stdout."""
    return call(*arguments).stdout


def document(*arguments: object) -> Any:
    """What a command that must succeed prints with ``--json``."""
    return json.loads(ok(*arguments, "--json"))
