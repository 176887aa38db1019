"""Campaigns whose commands are killed at random moments, and what must hold after each kill and at the end.

An episode carries one campaign through one command (run, ingest, void or report), killing the command with SIGKILL at
moments drawn uniformly over the time it takes undisturbed, and repeating it until it ends. Imports are done before the
clock starts, so that kills fall into the work and not into the start of Python.
"""

from __future__ import annotations

import json
import os
import random
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tiny_campaign import TINY, make_tiny
from typer.testing import CliRunner

from seqrsm.campaign.export import export
from seqrsm.campaign.ingest import ingest_files
from seqrsm.cli.app import app
from seqrsm.spec.read import load_spec
from seqrsm.store.store import STORE_NAME, Store

COMMANDS = ("run", "ingest", "void", "report")

CHILD = """
import sys
import seqrsm.campaign.ingest, seqrsm.campaign.campaign
from seqrsm.cli.app import app
if sys.argv[1] == "run":
    import seqrsm.campaign.check, seqrsm.design.optimal, seqrsm.fit.ensemble
if sys.argv[1] == "report":
    import seqrsm.campaign.dossier, seqrsm.report
print("ready", flush=True)
sys.stdin.readline()
app(sys.argv[1:])
"""

MEASURED = """\
[campaign]
name = "measured"
seed = 2
[[factor]]
name = "x"
low = -1.0
high = 1.0
[[factor]]
name = "y"
low = -1.0
high = 1.0
[[application]]
name = "worth"
utility = "measured"
[stop]
half_width = 0.5
"""
ROWS = 40


@dataclass(slots=True)
class Kill:
    """One attempt: the command, when it was killed [s after it began], and whether it was still alive then."""

    command: str
    moment_s: float
    alive: bool


@dataclass(slots=True)
class Episode:
    """What happened: every attempt, and how many campaigns ended as the undisturbed one."""

    kills: list[Kill] = field(default_factory=list)
    campaigns: int = 0


def call(arguments: list[object], kill_after_s: float | None = None, clock: list[float] | None = None) -> bool:
    """Run a command; True when it ended with exit code 0, False when it was killed before.

    ``clock`` gets the time that it took [s] after its imports.
    """
    process = subprocess.Popen(
        [sys.executable, "-c", CHILD, *map(str, arguments)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        start_new_session=True,
    )
    assert process.stdout is not None
    assert process.stdin is not None
    assert process.stdout.readline() == "ready\n"
    begin = time.monotonic()
    process.stdin.write("go\n")
    process.stdin.flush()
    if kill_after_s is not None:
        try:
            process.wait(timeout=kill_after_s)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
    _, err = process.communicate(timeout=600)
    if clock is not None:
        clock.append(time.monotonic() - begin)
    if process.returncode == -signal.SIGKILL:
        return False
    assert process.returncode == 0, err
    return True


# -- what must hold ---------------------------------------------------------------------------------------------------


def check_consistent(folder: Path) -> None:
    """The file is sound, references hold, and runs, scores, files and events tell the same story."""
    if not (folder / STORE_NAME).exists():
        return
    with sqlite3.connect(folder / STORE_NAME) as connection:
        assert connection.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
        assert connection.execute("PRAGMA foreign_key_check").fetchall() == []
        tables = {row[0] for row in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
    connection.close()
    if "runs" not in tables:
        return  # killed before the tables were made: they are made at once or not at all
    spec = load_spec(folder)
    with Store.open(folder, campaign=spec.name) as store:
        runs, events, files = store.runs(), store.events(), store.files()
    assert [run.run_id for run in runs] == list(range(1, len(runs) + 1))
    for run in runs:
        assert (run.state == "scored") <= bool(run.scores)
        assert run.scores == () or run.state in ("scored", "void")
        names = [score.application for score in run.scores]
        assert len(set(names)) == len(names)
    scored = [event.run_id for event in events if event.kind == "scored"]
    assert sorted(scored) == sorted(run.run_id for run in runs for _ in run.scores)
    voided = [event.run_id for event in events if event.kind == "void"]
    assert sorted(voided) == [run.run_id for run in runs if run.state == "void"]
    assert len(files) == len([event for event in events if event.kind == "ingested"])
    rows = sum(file.row_count for file in files)
    assert rows == sum(bool(score.source_file) for run in runs for score in run.scores)


def outcome(folder: Path) -> Any:
    """All that a campaign found, without times, owners and numbers of attempts."""
    spec = load_spec(folder)
    with Store.open(folder, campaign=spec.name) as store:
        export(store, spec, folder / "all.json")
    document = json.loads((folder / "all.json").read_text(encoding="utf-8"))
    times = {"attempts", "owner", "scored_at", "proposed_at", "issued_at", "started_at", "ended_at", "seen_at"}
    for run in document["runs"]:
        for score in run["scores"]:
            score.pop("scored_at")
            score["metadata"].get("fidelity", {}).pop("seconds", None)
        for name in times & run.keys():
            run.pop(name)
    looks = [(look["after_run"], look["application"], look["summary"]) for look in document["looks"]]
    files = [(file["name"], file["sha256"], file["row_count"]) for file in document["files"]]
    return document["runs"], looks, files


def acknowledged(folder: Path) -> dict[int, list[float]]:
    """Scores that a reader sees now; none may ever change or be lost."""
    if not (folder / STORE_NAME).exists():
        return {}
    with Store.open(folder, create=True, campaign=load_spec(folder).name) as store:
        return {run.run_id: [score.score for score in run.scores] for run in store.runs() if run.scores}


# -- episodes ---------------------------------------------------------------------------------------------------------


@dataclass(slots=True)
class Course:
    """How a campaign is made, and its commands in order."""

    make: Callable[[Path], Path]
    steps: Callable[[Path], Iterator[list[object]]]


def _write_scores(folder: Path, n: int) -> None:
    rng = random.Random(7)
    for k in range(n):
        rows = [f"{rng.uniform(-1, 1)!r},{rng.uniform(-1, 1)!r},{rng.gauss(0, 1)!r},{k}" for _ in range(ROWS)]
        (folder / f"scores{k}.csv").write_text("x,y,score,day\n" + "\n".join(rows) + "\n", encoding="utf-8")


def _make_measured(folder: Path, n: int) -> Path:
    folder.mkdir()
    (folder / "campaign.toml").write_text(MEASURED, encoding="utf-8")
    _write_scores(folder, n)
    return folder


def _make_ingested(folder: Path) -> Path:
    _make_measured(folder, 1)
    with Store.open(folder, create=True, campaign="measured", seed=2) as store:
        ingest_files(store, load_spec(folder), [folder / "scores0.csv"])
    return folder


def course(command: str, scene: Path, n: int) -> Course:
    """Course of an episode of ``n`` commands, of which `run` needs but one."""
    if command == "run":
        text = TINY.replace("batch = 3", "batch = 4").replace("half_width = 22.0", "half_width = 24.0")
        return Course(lambda folder: make_tiny(folder, scene, text), lambda folder: iter([["run", folder]]))
    if command == "ingest":
        return Course(
            lambda folder: _make_measured(folder, n),
            lambda folder: (["ingest", folder, folder / f"scores{k}.csv"] for k in range(n)),
        )
    if command == "void":
        return Course(
            _make_ingested, lambda folder: (["void", folder, k, "--why", f"cloud {k}"] for k in range(3, 3 + n))
        )
    return Course(_make_ingested, lambda folder: iter([["report", folder]] * n))


def undisturbed(command: str, scene: Path, folder: Path, n: int) -> tuple[Any, list[float]]:
    """Outcome of a campaign that is let alone, and the time of each of its steps [s], in this process."""
    plan = course(command, scene, n)
    place = plan.make(folder)
    seconds = []
    for step in plan.steps(place):
        begin = time.monotonic()
        result = CliRunner().invoke(app, [str(argument) for argument in step])
        assert result.exit_code == 0, result.output
        seconds.append(time.monotonic() - begin)
    return outcome(place), seconds


def episode(
    command: str, scene: Path, folder: Path, n: int, rng: random.Random, expected: Any, step_s: float, max_kills: int
) -> Episode:
    """Kill the ``n`` steps of a campaign at random, at most ``max_kills`` times, then let it end; check all along."""
    plan = course(command, scene, n)
    place = plan.make(folder)
    found = Episode()
    seen = acknowledged(place)
    left = max_kills
    for step in plan.steps(place):
        ended = False
        while not ended:
            moment = rng.uniform(0.0, step_s) if left > 0 else None
            ended = call(step, moment) if not _has_taken_effect(command, step, place) else True
            if moment is not None:
                found.kills.append(Kill(command, moment, not ended))
                left -= not ended
            check_consistent(place)
            now = acknowledged(place)
            assert seen.items() <= now.items(), "an acknowledged score was lost or changed"
            seen = now
            if command == "report":
                check_reports(place)
    assert outcome(place) == expected
    found.campaigns = 1
    return found


def _has_taken_effect(command: str, step: list[object], folder: Path) -> bool:
    """Whether a killed void did its work before it could say so: a second one would rightly be refused."""
    if command != "void":
        return False
    with Store.open(folder) as store:
        return store.runs()[int(str(step[2])) - 1].state == "void"


def check_reports(folder: Path) -> None:
    """A report is there whole or not at all."""
    for path in (folder / "reports").glob("report.*"):
        content = path.read_bytes()
        if path.suffix == ".html":
            assert content.rstrip().endswith(b"</html>")
        elif path.suffix == ".pdf":
            assert content.rstrip().endswith(b"%%EOF")
