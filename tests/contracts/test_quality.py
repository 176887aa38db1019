"""The whole tree obeys its linters, its types and its import contracts."""

import ast
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
BIN = Path(sys.executable).parent


@pytest.mark.parametrize(
    "command",
    [
        ["ruff", "check", "."],
        ["ruff", "format", "--check", "."],
        pytest.param(["mypy"], marks=pytest.mark.skipif(np.__version__ < "2", reason="types are those of numpy 2")),
        ["lint-imports", "--no-cache"],
    ],
    ids=lambda c: "-".join(c[:2]),
)
def test_tool_finds_nothing(command: list[str]) -> None:
    done = subprocess.run([BIN / command[0], *command[1:]], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_studies_and_benchmarks_call_what_is_there() -> None:
    """They run seldom: a function that lost an argument would be noticed when its page is to be made anew."""
    options = ["--config-file=", "--cache-dir=.mypy_cache/studies", "--ignore-missing-imports", "--check-untyped-defs"]
    # Other packages are not looked into, which takes four fifths of the time: it is our own functions that change.
    command = [BIN / "mypy", *options, "--no-site-packages", "tests/studies", "tests/benchmarks"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert "checked" in done.stdout, done.stdout + done.stderr
    lost = ("[call-arg]", "[name-defined]", "Too many", "multiple values", 'error: Module "seqrsm')
    assert not [line for line in done.stdout.splitlines() if any(mark in line for mark in lost)]


MOST_ARGUMENTS = 10


def crowded(root: Path) -> list[str]:
    """Functions that take more arguments; kernels aside, and commands, whose arguments are their options."""
    found = []
    for path in sorted(root.rglob("*.py")):
        if path.stem.startswith("kernels"):
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
                continue
            of = node.args
            names = [one.arg for one in (*of.posonlyargs, *of.args, *of.kwonlyargs, of.vararg, of.kwarg) if one]
            decorators = [ast.unparse(one) for one in getattr(node, "decorator_list", [])]
            command = path.parent.name == "cli" and "guarded" in decorators
            if not command and len(names) - (names[:1] in (["self"], ["cls"])) > MOST_ARGUMENTS:
                found.append(f"{path.relative_to(root).as_posix()}:{getattr(node, 'name', 'lambda')}")
    return found


def test_no_function_takes_more_than_ten_arguments() -> None:
    assert not crowded(ROOT / "seqrsm")


def test_a_function_of_eleven_arguments_would_be_seen(tmp_path: Path) -> None:
    names = [f"a{i}" for i in range(11)]
    (tmp_path / "cli").mkdir()
    (tmp_path / "kernels_of.py").write_text(f"def echo({', '.join(names)}): ...\n", encoding="utf-8")
    (tmp_path / "cli" / "app.py").write_text(
        f"@guarded\ndef told({', '.join(names)}): ...\ndef helper({', '.join(names)}): ...\n", encoding="utf-8"
    )
    (tmp_path / "a.py").write_text(
        f"class A:\n    def ten(self, {', '.join(names[1:])}): ...\n    def more(self, *, {', '.join(names)}): ...\n"
        f"def rest({', '.join(names[1:])}, **options): ...\n",
        encoding="utf-8",
    )
    assert crowded(tmp_path) == ["a.py:rest", "a.py:more", "cli/app.py:helper"]
