"""Terminal output: messages, progress, JSON, exit codes. Results go to stdout, everything else to stderr."""

from __future__ import annotations

import _thread
import functools
import io
import itertools
import json
import math
import os
import re
import signal
import sys
import textwrap
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from contextvars import ContextVar
from typing import Annotated, Any, NamedTuple, NoReturn, ParamSpec, TextIO, TypeVar

import typer
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    Task,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Column
from rich.text import Text

from seqrsm.errors import ConvergenceError, UserError
from seqrsm.plain import plain
from seqrsm.progress import listening

EXIT_USER_ERROR = 2
EXIT_BUDGET_SPENT = 3
EXIT_INTERRUPTED = 130
EXIT_CLOSED_PIPE = 141
"""The reader of the output has gone; a shell reports this code for a program that SIGPIPE ended."""
EXIT_TERMINATED = 143
_INTERRUPTED = "interrupted"
_KEPT = "; all scores so far are kept, and the same command goes on from them"
"""Where a campaign is open."""
_AGAIN_S = 0.1
"""After this time an interrupt comes again that a callback has swallowed."""

AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON document on stdout and nothing else.")]
"""The option that every command with a result has."""


class StoppedError(BaseException):
    """SIGINT or SIGTERM; not KeyboardInterrupt, which the parser of arguments would turn into an error of its own."""


_signals: list[int] = []
"""Signals that the program was asked to end with."""

_said: list[str] = []
"""What the running command has written to stdout: no empty line goes before the first."""

_to_do: list[Callable[[], None]] = []

_documents: list[tuple[TextIO, list[str]]] = []
"""The stdout of a command that prints a document, and what it is to print there when it ends."""

_shown: list[Console] = []
"""The console of the bar that is shown."""

P = ParamSpec("P")
T = TypeVar("T")


_page: ContextVar[io.StringIO | None] = ContextVar("_page", default=None)
"""Takes what this thread would write to stdout."""
_PAGE_COLUMNS = 100


def on_page(show: Callable[[], None]) -> str:
    """What this writes to stdout, as a text; what other threads write meanwhile goes where it went."""
    page = io.StringIO()
    token = _page.set(page)
    try:
        show()
    finally:
        _page.reset(token)
    return page.getvalue().strip("\n")


def stdout() -> Console:
    """Console for results; plain text when piped, no colour with NO_COLOR."""
    return Console(file=_page.get(), highlight=False, emoji=False, soft_wrap=not _on_terminal())


def _on_terminal() -> bool:
    return _page.get() is None and sys.stdout.isatty()


def stderr() -> Console:
    """Console for messages: that of the bar while one is shown, which makes room for them."""
    return _shown[-1] if _shown else Console(stderr=True, highlight=False, emoji=False, soft_wrap=True)


def say(text: str) -> None:
    """One statement for people, on stderr, taken literally (no markup); on a terminal wrapped at words."""
    console, text = stderr(), ascii_signs(text)
    if console.is_terminal:
        text = textwrap.fill(text, max(console.width, 20), subsequent_indent="    ", break_on_hyphens=False)
    console.print(text, markup=False)


def fail(text: str, code: int) -> NoReturn:
    """End with a message on stderr and an exit code."""
    console = stderr()
    if console.is_terminal:
        wrap = textwrap.TextWrapper(max(console.width, 20), break_long_words=False, break_on_hyphens=False)
        text = "\n".join(wrap.fill(part) for part in text.splitlines())
    console.print(text, markup=False, style="red" if sys.stderr.isatty() else None)
    raise typer.Exit(code)


def guarded(command: Callable[P, T]) -> Callable[P, T]:
    """Turn what a user can cause into a message and an exit code; leave our own bugs as tracebacks (exit code 1)."""

    @functools.wraps(command)
    def wrapper(*args: P.args, **kwargs: P.kwargs) -> T:
        _said.clear()
        swallowed: list[threading.Timer] = []
        try:
            with _heeding_interrupts(swallowed), _apart(bool(kwargs.get("as_json"))):
                return command(*args, **kwargs)
        except UserError as error:
            fail("\n".join(f"error: {problem}" for problem in error.problems), EXIT_USER_ERROR)
        except ConvergenceError as error:
            fail(f"error: {error}", EXIT_USER_ERROR)
        except MemoryError as error:
            what = f": {error}" if str(error) else ""
            fail(f"error: not enough memory{what}. Use a smaller scene, or a machine with more", EXIT_USER_ERROR)
        except (KeyboardInterrupt, StoppedError):
            fail_stopped()
        except Exception:
            # What an interrupt cuts short may fail later, or turn it into another error, as the import of a compiled
            # library does.
            if swallowed or _signals:
                fail_stopped()
            raise
        finally:
            while _to_do:
                _to_do.pop()()

    return wrapper


def fail_stopped() -> NoReturn:
    """End with the message and exit code of an interrupted command; a second Ctrl-C is ignored."""
    if _signals:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)
    fail(_INTERRUPTED + (_KEPT if _to_do else ""), EXIT_TERMINATED if signal.SIGTERM in _signals else EXIT_INTERRUPTED)


def stop_on_signals() -> None:
    """From here on SIGINT and SIGTERM raise `StoppedError`; for a process that is a command and nothing else."""

    def stop(number: int, _frame: Any) -> None:
        _signals.append(number)
        raise StoppedError

    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) is not signal.SIG_IGN:  # a shell's background job is deaf to SIGINT
            signal.signal(number, stop)


def _interrupt() -> None:
    """Interrupt the main thread as Ctrl-C does; a real signal, where there are such, also ends a blocking call."""
    if sys.platform == "win32":
        _thread.interrupt_main()
    else:
        signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)


@contextmanager
def _heeding_interrupts(swallowed: list[threading.Timer]) -> Iterator[None]:
    """Give an interrupt once more that a library's callback, such as a compiler's, has swallowed.

    Python hands an exception that a callback from C cannot raise to ``sys.unraisablehook``, and goes on.
    """
    before = sys.unraisablehook

    def again(found: Any) -> None:
        if not issubclass(found.exc_type, KeyboardInterrupt | StoppedError):
            before(found)
            return
        swallowed.append(threading.Timer(_AGAIN_S, _interrupt))
        swallowed[-1].daemon = True
        swallowed[-1].start()

    sys.unraisablehook = again
    try:
        yield
    finally:
        sys.unraisablehook = before
        for timer in swallowed:
            timer.cancel()


def at_end(call: Callable[[], None]) -> None:
    """Call this when the running command ends, however it ends."""
    _to_do.append(call)


@contextmanager
def _apart(as_json: bool) -> Iterator[None]:
    """Where a command prints a document, what else goes to stdout, such as from the user's own code, goes to stderr."""
    if not as_json:
        yield
        return
    stream, texts = sys.stdout, list[str]()
    saved = _descriptor_apart(stream)
    _documents.append((stream, texts))
    try:
        with redirect_stdout(sys.stderr):
            yield
    finally:
        _documents.pop()
        if saved is not None:
            os.dup2(saved, 1)
            os.close(saved)
        stream.write("".join(texts))


def _descriptor_apart(stream: TextIO) -> int | None:
    """Send the stdout of child processes to stderr; a copy of descriptor 1, None if stdout is another one."""
    try:
        if stream.fileno() != 1 or sys.stderr is None:
            return None
    except (OSError, ValueError):
        return None
    stream.flush()
    saved = os.dup(1)
    os.dup2(2, 1)
    return saved


def print_json(document: Any) -> None:
    """One JSON document on stdout and nothing else; in ASCII where the encoding is not UTF-8."""
    stream, texts = _documents[-1] if _documents else (sys.stdout, None)
    escaped = (stream.encoding or "").casefold().replace("-", "") != "utf8"
    text = json.dumps(plain(document), indent=2, ensure_ascii=escaped, allow_nan=False) + "\n"
    if texts is None:
        stream.write(text)
    else:
        texts.append(text)


_PLAIN = str.maketrans({"\u2212": "-", "\u2013": "-", "\u2003": "  "})
_FIXED_BLANK = "\u00a0"


def ascii_signs(text: str) -> str:
    """The report's minus signs, dashes and fixed blanks as a keyboard has them, so that output can be searched."""
    return text.translate(_PLAIN).replace(_FIXED_BLANK, " ")


def _bound(text: str) -> str:
    """The text with fixed blanks within p < 0.001, \u00b1 2.4 and 76 %, where no line may end."""
    return re.sub(r"(?<=[<>=\u00b1]) | (?=[<>=] )|(?<=\d) (?=%)", _FIXED_BLANK, text.translate(_PLAIN))


def width() -> int | None:
    """Columns to keep to: those of the terminal or page; in a pipe those of COLUMNS, none without it."""
    if _page.get() is not None:
        return _PAGE_COLUMNS
    if sys.stdout.isatty():
        return max(stdout().width, 20)
    asked = os.environ.get("COLUMNS", "")
    return max(int(asked), 20) if asked.isdecimal() and int(asked) > 0 else None


def line(text: str = "", indent: int = 0) -> None:
    """One statement on stdout, taken literally; where there is a width, wrapped under its own beginning."""
    columns = width()
    if columns is not None:
        hang = indent + (2 if text.startswith("- ") else 0)
        # Wrapped before fixed blanks become plain ones, so that a number stays beside its unit.
        text = textwrap.fill(
            _bound(text), columns, initial_indent=" " * indent, subsequent_indent=" " * hang, break_on_hyphens=False
        )
    else:
        text = " " * indent + text
    text = ascii_signs(text)
    _said.append(text)
    stdout().print(text.rstrip(), markup=False)


def heading(text: str) -> None:
    """Title of what follows, after an empty line unless it is the first."""
    if _said:
        stdout().print()
    _said.append(text)
    columns = width()
    shown = ascii_signs(text if columns is None else textwrap.fill(text, columns, break_on_hyphens=False))
    stdout().print(shown, markup=False, style="bold")


def show_table(
    columns: Sequence[str], rows: Sequence[Sequence[str]], *, title: str = "", sides: Sequence[str] = ("left", "right")
) -> None:
    """A table on stdout: ruled on a terminal, blanks between columns when piped; columns and ``title`` may be empty.

    Where its words do not fit beside each other the last columns follow below, beside the first one again. ``sides``
    are "left" or "right": to which side each column keeps; the last one holds for the columns beyond.
    """
    if title:
        heading(title)
    if not rows:
        return
    sides = [sides[min(k, len(sides) - 1)] for k in range(len(rows[0]))]
    left = list(range(len(sides)))
    while left:
        shown = left
        while (laid := _laid(columns or [""] * len(sides), rows, shown)).cut and len(shown) > 2:
            shown = shown[:-1]
        keep = [sides[k] for k in shown]
        if columns:
            for text in _row_lines(laid.head, laid, keep):
                stdout().print(text, markup=False, style="bold")
            if _on_terminal():
                stdout().print("\u2500" * (sum(laid.widths) + laid.gap * (len(shown) - 1)))
        for row in laid.cells:
            for text in _row_lines(row, laid, keep):
                stdout().print(text, markup=False)
        left = [left[0], *left[len(shown) :]] if len(shown) < len(left) else []
        if left:
            stdout().print()


class _Laid(NamedTuple):
    """A table as it fits: heads and cells, widths of columns, blanks between them, and whether words must be cut."""

    head: list[str]
    cells: list[list[str]]
    widths: list[int]
    gap: int
    cut: bool


def _laid(columns: Sequence[str], rows: Sequence[Sequence[str]], shown: Sequence[int]) -> _Laid:
    """Some of the columns; where words would be cut blanks are saved, then numbers leave their units."""
    tied = [[_tied(row[k]) for k in shown] for row in (columns, *rows)]
    loose = [[cell.replace(_FIXED_BLANK, " ") for cell in row] for row in tied]
    for gap, (head, *cells) in ((_GAP, tied), (1, tied), (1, loose)):
        laid = _Laid(head, cells, *_widths(head, cells, width(), gap))
        if not laid.cut:
            break
    return laid


_GAP = 2
"""Blanks between the columns of a table."""


def _tied(cell: str) -> str:
    """A cell whose product names, such as A \u00d7 B, break only after the sign."""
    cell = _bound(cell)
    return cell.replace(" ", _FIXED_BLANK).replace("\u00d7\u00a0", "\u00d7 ") if "\u00d7" in cell else cell


def _widths(head: list[str], rows: list[list[str]], room: int | None, gap: int) -> tuple[list[int], int, bool]:
    """Widths of columns, ``gap``, and whether words must be cut: where room is scarce, heads break first."""
    cells = [max(map(len, column)) for column in zip(*rows, strict=True)]
    widths = [max(size, len(name)) for size, name in zip(cells, head, strict=True)]
    space = math.inf if room is None else room - gap * (len(widths) - 1)
    if sum(widths) <= space:
        return widths, gap, False
    names = [max(map(len, name.split(" "))) for name in head]
    words = [max(len(word) for cell in column for word in cell.split(" ")) for column in zip(*rows, strict=True)]
    widths, least = (list(map(max, sizes, names)) for sizes in (cells, words))
    while sum(widths) > space and max(widths) > 1:
        k = max(range(len(widths)), key=lambda k: (widths[k] > least[k], widths[k]))
        widths[k] -= 1
    return widths, gap, any(size < word for size, word in zip(widths, least, strict=True))


def _row_lines(row: Sequence[str], laid: _Laid, sides: Sequence[str]) -> Iterator[str]:
    """Lines of one row of a table."""
    widths = laid.widths
    parts = (textwrap.wrap(cell, max(size, 1), break_on_hyphens=False) for cell, size in zip(row, widths, strict=True))
    for line_parts in itertools.zip_longest(*parts, fillvalue=""):
        padded = (
            part.ljust(size) if side == "left" else part.rjust(size)
            for part, size, side in zip(line_parts, widths, sides, strict=True)
        )
        yield ascii_signs((" " * laid.gap).join(padded).rstrip())


class Display:
    """What is being done: one line that moves on a terminal, with count, rate and time left where they are known."""

    def __init__(self, bar: Progress | None, label: str) -> None:
        self._bar = bar
        self._label = label
        self._task = None if bar is None else bar.add_task(label, total=None)

    def step(self, text: str) -> None:
        """Something begins whose length is not known yet."""
        self._label = text
        if self._bar is not None and self._task is not None:
            # A total cannot be taken back from a task: a new one has none.
            self._bar.remove_task(self._task)
            self._task = self._bar.add_task(text, total=None)

    def count(self, text: str, done: int, total: int) -> None:
        """So many pieces of this are done of so many."""
        if text != self._label:
            self.step(text)
        if self._bar is not None and self._task is not None:
            self._bar.update(self._task, completed=done, total=total)


@contextmanager
def display(label: str, *, inner: bool = True) -> Iterator[Display]:
    """Show what the block does, and, unless ``inner`` is False, what `seqrsm.progress` tells of it; piped, nothing."""
    if not sys.stderr.isatty():
        yield Display(None, label)
        return
    console = Console(stderr=True, highlight=False, emoji=False)
    with Progress(*_bar_columns(console.width), console=console, transient=True) as bar:
        shown = Display(bar, label)
        _shown.append(console)
        try:
            with listening(shown.count if inner else None):
                yield shown
        finally:
            _shown.pop()


def _bar_columns(columns: int) -> tuple[ProgressColumn, ...]:
    """Columns of the one line; where there is little room neither rate nor the time that went by."""

    def whole() -> Column:
        return Column(no_wrap=True)

    more = (_RateColumn(whole()), TimeElapsedColumn(whole())) if columns >= _WIDE else ()
    # A bar without a total pulses: it tells that the program lives.
    return (
        TextColumn("{task.description}", table_column=Column(no_wrap=True, overflow="ellipsis")),
        BarColumn(bar_width=20 if more else 10),
        _CountColumn(table_column=whole()),
        *more,
        _LeftColumn(table_column=whole()),
    )


_WIDE = 80


class _CountColumn(MofNCompleteColumn):
    """Things done of how many, where that is known."""

    def render(self, task: Task) -> Text:
        return Text("") if task.total is None else super().render(task)


class _LeftColumn(TimeRemainingColumn):
    """Time left, where it is known."""

    def render(self, task: Task) -> Text:
        if task.total is None or task.time_remaining is None:
            return Text("")
        return Text.assemble(super().render(task), " left")


class _RateColumn(ProgressColumn):
    """Things done in a second, or seconds for each where it takes longer than one."""

    def render(self, task: Task) -> Text:
        speed = task.finished_speed or task.speed
        if not speed:
            return Text("")
        return Text(f"{speed:.1f}/s" if speed >= 1.0 else f"{1.0 / speed:.1f} s each")
