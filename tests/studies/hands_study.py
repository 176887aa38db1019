"""Many hands and failing machines: every command, at every one of its operations and commits.

    python tests/studies/hands_study.py                # goes on where it was stopped
    python tests/studies/hands_study.py --only server  # one kind only
    python tests/studies/hands_study.py --anew         # again from the first moment

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
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
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
    ("run", "propose, simulate, run"): ["propose", "simulate", "run"],
    ("propose", "propose"): ["propose"],
    ("propose", "propose x 3"): ["propose"] * 3,
    ("propose", "run"): ["run"],
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
    folder: Path, postgres: str | None, kind: str, whole: Collection[tuple[str, str, str]]
) -> Iterator[tuple[str, str, Callable[[int], bool]]]:
    """Command, what meets it, and what is done at a moment, from the first: False beyond the last."""
    if kind in ("server", "fault"):
        url = postgres if kind == "server" else None
        hows = (*SERVER_HOWS, LOST + LASTING, REFUSED + LASTING) if url else (KILL, "error", "error" + LASTING)
        for how in hows:
            for name in SERVER_CASES if url else CASES:
                if (kind, name, how) not in whole:
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


def carry_on(kinds: Sequence[str], seconds: float, anew: bool) -> None:
    """Moments that no earlier call has done, in courses not whole yet."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    done, end = rows(), time.monotonic() + seconds
    if anew:
        done = {key: row for key, row in done.items() if key[0] not in kinds}
    now = package()
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        patch = stack.enter_context(pytest.MonkeyPatch.context())
        patch.setattr("seqrsm.analysis.compromise.DRAWS", 20)
        without_engine(patch)
        server = find_server()
        postgres = None if server is None else stack.enter_context(running(server))
        for kind in kinds:
            for name, met, act in courses(folder, postgres, kind, {key for key, row in done.items() if row.whole}):
                key = (kind, name, met)
                old = done.get(key, Row(*key, 0, False, now))
                if old.whole:
                    continue
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
    part = [f"`{row.command}`, {row.met} ({row.kind})" for row in done.values() if not row.whole]
    lines = [
        f"{count['fault']} times a command was killed, or met an error (no space, input/output, read-only, by turns), "
        "before one of its file or SQL operations, and given again (once from each state that "
        "was left, times apart): the campaign, form, export or report was then what it is undisturbed. "
        f"{count['server']} times a command met the like at one of its SQL statements and commits on PostgreSQL: it "
        "was killed, the server ended its connection before the operation or after it (so that only the answer was "
        "missing), or refused it. Given again it ended as undisturbed: no "
        "run or score was lost or doubled, the budget was kept, no connection was left on the server, and no password "
        "stood in any output or file.",
        "",
        f"{count['SQLite'] + count['PostgreSQL']} times one or three other commands came before one of the "
        "transactions of a command, readers' included: no `run` ended in an error, nothing was lost or doubled, the "
        "budget was kept, and `run` with `run` and `simulate` beside it ended the same to the last digit. "
        f"{count['flip']} times one bit of a data base was another: `status` said the same as before, or refused in "
        "words. No command ended in a traceback. One exception would have ended the study.",
        "",
        "A number is of all operations (transactions, for commands beside others) that the command has"
        + (
            f", apart from {'; '.join(part)}: those were not taken to the end; a dash: not begun."
            if part
            else "; a dash: not begun."
        )
        + " Simulations were replaced by a formula, and each different analysis was made once.",
        "",
    ]
    for kind, title in (("fault", "files and SQLite"), ("server", "PostgreSQL")):
        hows = list(dict.fromkeys(row.met for row in of[kind]))
        lines += [f"| command, {title} | {' | '.join(hows)} |", f"|---{'|---' * len(hows)}|"]
        for name in dict.fromkeys(row.command for row in of[kind]):
            cells = (done.get((kind, name, how)) for how in hows)
            lines.append(f"| `{name}` | {' | '.join('-' if row is None else str(row.moments) for row in cells)} |")
        lines.append("")
    lines += ["| command | beside it | transactions, SQLite | transactions, PostgreSQL |", "|---|---|---|---|"]
    for first, other in BESIDE:
        cells = (done.get((kind, first, other)) for kind in ("SQLite", "PostgreSQL"))
        lines.append(
            f"| `{first}` | `{other}` | {' | '.join('-' if row is None else str(row.moments) for row in cells)} |"
        )
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
    parser.add_argument("--anew", action="store_true")
    asked = parser.parse_args()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    carry_on([asked.only] if asked.only else KINDS, asked.seconds, asked.anew)
    report()
