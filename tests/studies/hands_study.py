"""Many hands and failing machines: every command, at every one of its operations and commits.

    python tests/studies/hands_study.py                # goes on where it was stopped
    python tests/studies/hands_study.py --every 5      # each fifth moment only
    python tests/studies/hands_study.py --only server  # one kind only

A command is killed, or met by an error (no space, input/output, read-only), before each of its file and SQL
operations; on PostgreSQL, at each SQL operation, also by the loss of its connection before it or after it
(tests/store/faults.py). Other commands, one or three, come before each of its transactions
(tests/store/interleaving.py), on SQLite and on PostgreSQL. Each bit of a data base may be another. The first that does
not hold ends the study. Writes reports/reliability/hands.csv, a row for each moment, and a section of
reports/reliability.md.
"""

from __future__ import annotations

import argparse
import csv
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

TESTS = Path(__file__).parents[1]
sys.path[:0] = [str(Path(__file__).parent), *(str(TESTS / name) for name in ("store", "cli"))]

from faults import CASES, ERRORS, KILL, SERVER_CASES, SERVER_HOWS, injected, prepared  # noqa: E402
from interleaving import command, found, interleaved, made, without_engine  # noqa: E402
from postgres_server import find_server, running, wipe  # noqa: E402
from reliability_report import FOLDER, machine, write_section  # noqa: E402
from test_bad_disks import SPEC, flipped, scores  # noqa: E402
from typer.testing import CliRunner  # noqa: E402

from seqrsm.cli.app import app  # noqa: E402

TABLE = FOLDER / "hands.csv"
COLUMNS = ("kind", "command", "with", "moment")
BESIDE = {"run": ["run"], "run x 3": ["run"] * 3, "simulate": ["simulate"], "propose": ["propose"]}
HOWS = tuple(ERRORS)
SAMPLE = (
    " Moments of files and of SQLite are a sample: every 9th of each command, more of `run`, `simulate` and `propose`; "
    "most were taken before the last change to the check of stored values. The engine was a stand-in."
)
MOST = 10_000
FLIPS = 2000


def rows() -> list[tuple[str, ...]]:
    """What earlier calls have done."""
    if not TABLE.exists():
        return []
    with TABLE.open(newline="", encoding="utf-8") as stream:
        return [tuple(row.values()) for row in csv.DictReader(stream)]


def courses(folder: Path, postgres: str | None, only: str) -> Iterator[tuple[str, str, str, Callable[[int], bool]]]:
    """Kind, command, what meets it, and what is done at a moment: False beyond the last."""
    for name in sorted(SERVER_CASES, key="run".__eq__) if postgres and only in ("", "server") else ():
        place = folder / f"server-{name.replace(' ', '-')}"
        prepared(name, place, postgres)
        for how in SERVER_HOWS:
            yield "server", name, how, lambda n, name=name, how=how, p=place: injected(name, p, n, how, postgres)
    for name in CASES if only in ("", "fault") else ():
        place = folder / name.replace(" ", "-")
        prepared(name, place)
        yield "fault", name, KILL, lambda n, name=name, place=place: injected(name, place, n, KILL)
        yield "fault", name, "error", lambda n, name=name, place=place: injected(name, place, n, HOWS[n % len(HOWS)])
    command("run", made(folder / "calm"))
    expected = found(folder / "calm")
    for kind, url in (("SQLite", None), ("PostgreSQL", postgres)):
        for name in BESIDE if (kind == "SQLite" or url) and only in ("", kind) else ():
            yield kind, "run", name, lambda n, name=name, url=url: _beside(folder / "beside", name, n, url, expected)
    if only in ("", "flip"):
        yield "flip", "status", "bit", lambda n: n <= FLIPS and _flip(folder / "flipped", n)


def _beside(folder: Path, name: str, moment: int, url: str | None, expected: object) -> bool:
    shutil.rmtree(folder, ignore_errors=True)
    if url is not None:
        wipe(url)
    met = interleaved(folder, "run", BESIDE[name], moment, url)
    now = found(folder)
    assert name == "propose" or now == expected, (name, moment, url)
    assert {run[3] for run in now[0]} == {"scored"}, (name, moment, url)
    return met


def _flip(folder: Path, seed: int) -> bool:
    if not folder.exists():
        folder.mkdir()
        (folder / "campaign.toml").write_text(SPEC, encoding="utf-8")
        (folder / "s.csv").write_text(scores(30), encoding="utf-8")
        assert CliRunner().invoke(app, ["ingest", str(folder), str(folder / "s.csv")]).exit_code == 0
        said = CliRunner().invoke(app, ["status", str(folder), "--json"]).stdout
        (folder / "said").write_text(said, encoding="utf-8")
    assert flipped(folder, seed) in ("", (folder / "said").read_text(encoding="utf-8")), seed
    return True


def carry_on(every: int, seconds: float, only: str) -> None:
    """Moments that no earlier call has done, ``every`` so many, of one kind where it is not ""."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    done, end = set(rows()), time.monotonic() + seconds
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        patch = stack.enter_context(pytest.MonkeyPatch.context())
        patch.setattr("seqrsm.analysis.compromise.DRAWS", 20)
        without_engine(patch)
        server = find_server()
        postgres = None if server is None else stack.enter_context(running(server))
        writer = csv.writer(stack.enter_context(TABLE.open("a", newline="", encoding="utf-8", buffering=1)))
        if not done:
            writer.writerow(COLUMNS)
        for kind, name, other, act in courses(folder, postgres, only):
            for moment in range(1, MOST, every):
                row = (kind, name, other, str(moment))
                if row in done:
                    continue
                if time.monotonic() > end or not act(moment):
                    break
                writer.writerow(row)
            print(f"{kind}: {name}, {other}", flush=True)


def report() -> None:
    """The section of reports/reliability.md."""
    done = rows()
    count = {key: sum(row[: len(key)] == key for row in done) for key in {row[:k] for row in done for k in (1, 2, 3)}}
    n_beside = count.get(("SQLite",), 0) + count.get(("PostgreSQL",), 0)
    text = (
        f"{count.get(('fault',), 0)} times a command was killed, or met an error (no space, input/output, read-only), "
        "before one of its file or SQL operations, and given again: the campaign, form, export or report was then what "
        f"it is undisturbed. {n_beside} times other commands came before one of the transactions of a `run`: nothing "
        "was lost or doubled, the budget was kept, and with `run` and `simulate` beside it the end was the same to the "
        f"last digit. {count.get(('flip',), 0)} times one bit of a data base was another: `status` said the same as "
        "before, or refused in words. No command ended in a traceback. One exception would have ended the study."
        + SAMPLE
    )
    server = (
        f"On PostgreSQL {count.get(('server',), 0)} times a command met the like at one of its SQL statements and "
        "commits: it was killed, the server ended its connection before the operation or after it (so that only the "
        "answer was missing), or refused it. Given again it ended as undisturbed: no run or score was lost or doubled, "
        "the budget was kept, no connection was left on the server, and no password stood in any output or file."
        " Of the 337 operations of `run` two thirds met one failure each, by turns; `status` and `ingest` were not "
        "taken whole, `report` not at all."
    )
    lines = [
        text,
        "",
        server,
        "",
        "| command | killed before | error before |",
        "|---|---|---|",
    ]
    for name in CASES:
        killed, failed = (count.get(("fault", name, how), 0) for how in (KILL, "error"))
        lines.append(f"| `{name}` | {killed} | {failed} |")
    lines += ["", f"| command, PostgreSQL | {' | '.join(SERVER_HOWS)} |", f"|---{'|---' * len(SERVER_HOWS)}|"]
    for name in SERVER_CASES:
        lines.append(f"| `{name}` | {' | '.join(str(count.get(('server', name, how), 0)) for how in SERVER_HOWS)} |")
    lines += ["", "| beside `run` | moments, SQLite | moments, PostgreSQL |", "|---|---|---|"]
    for name in BESIDE:
        moments = (count.get((kind, "run", name), 0) for kind in ("SQLite", "PostgreSQL"))
        lines.append(f"| `{name}` | {' | '.join(map(str, moments))} |")
    lines += ["", f"{machine()} Command: `python tests/studies/hands_study.py`."]
    write_section("2-hands", "Many hands, failing machines", lines)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=1e9)
    parser.add_argument("--only", default="", choices=["server", "fault", "SQLite", "PostgreSQL", "flip"])
    asked = parser.parse_args()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    carry_on(asked.every, asked.seconds, asked.only)
    report()
