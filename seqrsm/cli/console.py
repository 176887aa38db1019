"""Terminal output: messages, progress, JSON, exit codes. Results go to stdout, everything else to stderr."""

from __future__ import annotations

import functools
import json
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NoReturn, ParamSpec, TypeVar

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table

from seqrsm.errors import ConvergenceError, UserError
from seqrsm.plain import plain

EXIT_USER_ERROR = 2
EXIT_BUDGET_SPENT = 3
EXIT_INTERRUPTED = 130

P = ParamSpec("P")
T = TypeVar("T")


def stdout() -> Console:
    """Console for results; plain text when piped, no colour with NO_COLOR."""
    return Console(highlight=False, soft_wrap=not sys.stdout.isatty())


def stderr() -> Console:
    """Console for messages and progress."""
    return Console(stderr=True, highlight=False, soft_wrap=True)


def say(text: str) -> None:
    """One line for people, on stderr, taken literally (no markup)."""
    stderr().print(text, markup=False)


def fail(text: str, code: int) -> NoReturn:
    """End with a message on stderr and an exit code."""
    stderr().print(text, markup=False, style="red" if sys.stderr.isatty() else None)
    raise typer.Exit(code)


def guarded(command: Callable[P, T]) -> Callable[P, T]:
    """Turn what a user can cause into a message and an exit code; leave our own bugs as tracebacks (exit code 1)."""

    @functools.wraps(command)
    def wrapper(*args: P.args, **kwargs: P.kwargs) -> T:
        try:
            return command(*args, **kwargs)
        except UserError as error:
            fail("\n".join(f"error: {problem}" for problem in error.problems), EXIT_USER_ERROR)
        except ConvergenceError as error:
            fail(f"error: {error}", EXIT_USER_ERROR)
        except KeyboardInterrupt:
            fail("interrupted; every score so far is kept, and the same command goes on from here", EXIT_INTERRUPTED)

    return wrapper


def print_json(document: Any) -> None:
    """One JSON document on stdout and nothing else."""
    sys.stdout.write(json.dumps(plain(document), indent=2, ensure_ascii=False, allow_nan=False) + "\n")


def table(
    columns: Sequence[str], rows: Sequence[Sequence[str]], *, title: str | None = None, left: bool = False
) -> Table:
    """A plain table; every column but the first is right-aligned, unless all hold words; cells are taken literally."""
    from rich.box import SIMPLE_HEAD
    from rich.text import Text

    out = Table(box=SIMPLE_HEAD, title=title, title_justify="left", title_style="bold", pad_edge=False)
    for number, name in enumerate(columns):
        out.add_column(name, justify="left" if left or number == 0 else "right", overflow="fold")
    for row in rows:
        out.add_row(*(Text(cell) for cell in row))
    return out


@contextmanager
def progress_bar(label: str) -> Iterator[Callable[[int, int], None]]:
    """Yield ``update(done, total)``; a bar with rate and time left on a terminal, nothing when piped."""
    if not sys.stderr.isatty():
        yield lambda done, total: None
        return
    columns = (TextColumn(label), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    with Progress(*columns, console=stderr(), transient=True) as bar:
        task = bar.add_task(label, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def number(value: float, digits: int = 4) -> str:
    """A float to ``digits`` significant digits; a dash where there is none."""
    if not math.isfinite(value):
        return "-"
    if value != 0 and (abs(value) >= 10 ** max(digits, 4) or abs(value) < 1e-4):
        return f"{value:.{digits - 1}e}"
    decimals = max(0, digits - 1 - (math.floor(math.log10(abs(value))) if value else 0))
    return f"{value:.{decimals}f}"
