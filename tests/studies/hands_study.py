"""Many hands and failing machines: every command, at every one of its operations and commits.

    python tests/studies/hands_study.py                # goes on where it was stopped
    python tests/studies/hands_study.py --only server  # one kind only
    python tests/studies/hands_study.py --anew         # again from the first moment
    python tests/studies/hands_study.py --only server --command run --anew  # one command of a kind again

A command is killed, or met by an error (no space, input/output, read-only), before each of its file and SQL
operations; on PostgreSQL, at each SQL operation, also by the loss of its connection before it or after it
(tests/store/faults.py). Other commands, one or three, come before each of its transactions
(tests/store/interleaving.py), on SQLite and on PostgreSQL. Each bit of a data base may be another. The first that does
not hold ends the study. Writes reports/reliability/hands.csv, a row for each command and what meets it, with the
package (`git rev-parse HEAD:seqrsm`) that it was tried on, and a section of reports/reliability.md.
"""

from __future__ import annotations

import argparse
import csv
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import NamedTuple

import pytest

TESTS = Path(__file__).parents[1]
sys.path[:0] = [str(Path(__file__).parent), *(str(TESTS / name) for name in ("store", "cli"))]

from faults import CASES, ERRORS, KILL, LASTING, LOST, REFUSED, SERVER_CASES, SERVER_HOWS, injected, prepared  # noqa: E402
from interleaving import command, found, interleaved, made, without_engine  # noqa: E402
from postgres_server import find_server, running, wipe  # noqa: E402
from reliability_report import FOLDER, machine, package, write_section  # noqa: E402
from test_bad_disks import SPEC, flipped, scores  # noqa: E402
from typer.testing import CliRunner  # noqa: E402

from seqrsm.cli.app import app  # noqa: E402

TABLE = FOLDER / "hands.csv"
COLUMNS = ("kind", "command", "with", "moments", "whole", "package")
BESIDE: dict[tuple[str, str], list[str]] = {
    ("run", "run"): ["run"],
    ("run", "run x 3"): ["run"] * 3,
    ("run", "simulate"): ["simulate"],
    ("run", "propose"): ["propose"],
    ("propose", "propose"): ["propose"],
    ("propose", "propose x 3"): ["propose"] * 3,
    ("propose", "run"): ["run"],
    ("run", "propose, simulate, run"): ["propose", "simulate", "run"],
}
SAME_END = ("run", "run x 3", "simulate")
HOWS = tuple(ERRORS)
KINDS = ("server", "fault", "SQLite", "PostgreSQL", "flip")
FLIPS = 2000


class Row(NamedTuple):
    """What was done of a course: so many moments from the first, to the last or not, on what package."""

    kind: str
    command: str
    met: str
    moments: int
    whole: bool
    package: str


def rows() -> dict[tuple[str, str, str], Row]:
    """What earlier calls have done."""
    if not TABLE.exists():
        return {}
    with TABLE.open(newline="", encoding="utf-8") as stream:
        found = [tuple(row.values()) for row in csv.DictReader(stream)]
    return {(k, c, m): Row(k, c, m, int(n), whole == "yes", of) for k, c, m, n, whole, of in found}


def courses(
    folder: Path, postgres: str | None, kind: str, skip: Callable[[tuple[str, str, str]], bool]
) -> Iterator[tuple[str, str, Callable[[int], bool]]]:
    """Command, what meets it, and what is done at a moment, from the first: False beyond the last."""
    if kind in ("server", "fault"):
        url = postgres if kind == "server" else None
        hows = (*SERVER_HOWS, LOST + LASTING, REFUSED + LASTING) if url else (KILL, "error", "error" + LASTING)
        for how in hows:
            for name in SERVER_CASES if url else CASES:
                if not skip((kind, name, how)):
                    shutil.rmtree(folder / "course", ignore_errors=True)
                    prepared(name, folder / "course", url)
                    yield name, how, partial(_injected, name, folder / "course", how, url)
    elif kind == "flip":
        yield "status", "bit", lambda n: n <= FLIPS and _flip(folder / "flipped", n)
    else:
        shutil.rmtree(folder / "calm", ignore_errors=True)
        command("run", made(folder / "calm"))
        expected = found(folder / "calm")
        for first, other in BESIDE:
            url = postgres if kind == "PostgreSQL" else None
            yield first, other, partial(_beside, folder / "beside", first, other, url, expected)


def _injected(name: str, place: Path, how: str, url: str | None, moment: int) -> bool:
    """Errors by turns; one that lasts is another than the one that does not."""
    kind = HOWS[(moment + how.endswith(LASTING)) % len(HOWS)]
    return injected(name, place, moment, how.replace("error", kind), url)


def _beside(folder: Path, first: str, other: str, url: str | None, expected: object, moment: int) -> bool:
    shutil.rmtree(folder, ignore_errors=True)
    if url is not None:
        wipe(url)
    met = interleaved(folder, first, BESIDE[first, other], moment, url)
    runs, looks = found(folder)  # within the budget
    where = (first, other, moment, url)
    assert len({run[0] for run in runs}) == len(runs), where
    if first == "run":
        assert {run[3] for run in runs} == {"scored"}, where
        assert other not in SAME_END or (runs, looks) == expected, where
    elif other != "run":
        assert [run[1] for run in runs] == [1] * 9, where
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


def carry_on(kinds: Sequence[str], first: str, seconds: float, anew: bool) -> None:
    """Moments that no earlier call has done, in courses not whole yet, of one command or of all ("")."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    done, end = rows(), time.monotonic() + seconds
    if anew:
        done = {key: row for key, row in done.items() if key[0] not in kinds or first not in ("", key[1])}

    def skip(key: tuple[str, str, str]) -> bool:
        return first not in ("", key[1]) or (key in done and done[key].whole)

    now = package()
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        patch = stack.enter_context(pytest.MonkeyPatch.context())
        patch.setattr("seqrsm.analysis.compromise.DRAWS", 20)
        without_engine(patch)
        server = find_server()
        postgres = None if server is None else stack.enter_context(running(server))
        for kind in kinds:
            for name, met, act in courses(folder, postgres, kind, skip):
                key = (kind, name, met)
                if skip(key):
                    continue
                old = done.get(key, Row(*key, 0, False, now))
                if time.monotonic() > end:
                    break
                moment, whole = old.moments + 1, False
                while not whole and time.monotonic() < end:
                    whole, moment = not act(moment), moment + 1
                packages = dict.fromkeys((*old.package.split(), now))
                done[key] = Row(*key, moment - 1 - whole, whole, " ".join(packages))
                _write(done.values())
                print(f"{kind}: {name}, {met}: {done[key].moments}", flush=True)


def _write(done: Iterable[Row]) -> None:
    with TABLE.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows(row._replace(whole="yes" if row.whole else "no") for row in sorted(done))


def report() -> None:
    """The section of reports/reliability.md."""
    done = rows()
    of = {kind: [row for row in done.values() if row.kind == kind] for kind in KINDS}
    count = {kind: sum(row.moments for row in of[kind]) for kind in KINDS}
    packages = {kind: ", ".join(sorted({name for row in of[kind] for name in row.package.split()})) for kind in KINDS}

    def cell(kind: str, command: str, met: str) -> str:
        row = done.get((kind, command, met))
        return "-" if row is None else str(row.moments) if row.whole else f"first {row.moments}"

    lines = [
        "Commands were interrupted at each of their operations in turn, then given again. On files and SQLite, an "
        "operation is a change of a file, an SQL statement or a commit. Before it, the command was killed (`kill`) or "
        "met an error (`error`: disk full, input/output error and read-only file system, in turn): "
        f"{count['fault']} interruptions. On PostgreSQL, an operation is an SQL statement or a commit. The command was "
        "killed before it, the server closed the connection before it (`lost`) or after it, so that only the reply was "
        f"missing (`lost after`), or the server refused it (`refused`): {count['server']} interruptions. An error "
        "`from then on` met every later operation, too. Given again, every command ended as it does undisturbed, "
        "with the same campaign, form, export or report. No run or score was lost or duplicated, the budget was kept, "
        "no connection stayed open on the server, and no password appeared in any output or file. Where several "
        "interruptions left the same state, the command was given again from it once.",
        "",
        "One or three other commands were run just before each transaction of a command, "
        f"{count['SQLite']} times on SQLite and {count['PostgreSQL']} times on PostgreSQL. No `run` ended in an error, "
        "nothing was lost or duplicated, the budget was kept, `propose` beside `propose` issued one start design, and "
        "`run` beside `run` or `simulate` gave the same results to the last digit. One random bit of a database was "
        f"flipped {count['flip']} times: `status` reported the same as before, or refused the file with an error "
        "message. No command ended in a traceback; the study stops at the first failure.",
        "",
        "The tables count the operations (or transactions) at which a command was disturbed: all that it has, or the "
        "first so many where this is said; a dash means not tried. `propose` issues the start design, `propose more` "
        "two further runs, and `init` makes a campaign from an export. A formula took the place of the simulator, and "
        "analyses of equal data were computed once. Two versions of the package on one campaign are tested in "
        "`tests/store/test_store_open.py`, `tests/cli/test_bad_disks.py` and `tests/cli/test_one_experiment.py`, "
        "clocks that jump and machines of one core in `tests/cli/test_clock_and_cores.py`.",
        "",
    ]
    for kind, title in (("fault", "files and SQLite"), ("server", "PostgreSQL")):
        hows = sorted({row.met for row in of[kind]}, key=lambda how: (LASTING in how, how != KILL, how))
        lines += [f"| command, {title} | {' | '.join(hows)} |", f"|---{'|---' * len(hows)}|"]
        for name in dict.fromkeys(row.command for row in of[kind]):
            lines.append(f"| `{name}` | {' | '.join(cell(kind, name, how) for how in hows)} |")
        lines.append("")
    lines += ["| command | beside it | transactions, SQLite | transactions, PostgreSQL |", "|---|---|---|---|"]
    for first, other in BESIDE:
        cells = " | ".join(cell(kind, first, other) for kind in ("SQLite", "PostgreSQL"))
        lines.append(f"| `{first}` | `{other}` | {cells} |")
    lines += [
        "",
        f"Package (`git rev-parse --short HEAD:seqrsm`): {'; '.join(f'{kind} {packages[kind]}' for kind in KINDS)}. "
        f"{machine()} Command: `python tests/studies/hands_study.py`.",
    ]
    write_section("2-hands", "Many hands, failing machines", lines)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=1e9)
    parser.add_argument("--only", default="", choices=["", *KINDS])
    parser.add_argument("--command", default="", choices=["", *CASES])
    parser.add_argument("--anew", action="store_true")
    asked = parser.parse_args()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    carry_on([asked.only] if asked.only else KINDS, asked.command, asked.seconds, asked.anew)
    report()
