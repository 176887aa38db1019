"""Eight processes propose, claim, score and ingest at once, on SQLite and PostgreSQL: none lost, none doubled."""

from __future__ import annotations

import subprocess
import sys
from collections import Counter

from postgres_server import wipe

from seqrsm.store.records import NewRun
from seqrsm.store.store import Store

PROCESSES, RUNS_EACH, FILES_EACH, ROWS = 8, 4, 2, 3

WORKER = """
import sys
from seqrsm.store.records import IngestedFile, IngestedRun
from seqrsm.store.store import NewRun, NewScore, Store
folder, url, me, runs_each, files_each, rows = sys.argv[1], sys.argv[2] or None, *map(int, sys.argv[3:])

def file(name, owner, number):
    scores = [IngestedRun(None, {"x": float(owner), "y": float(10 * number + row)}, "flight", "", 1.0,
                          (NewScore("crops", 100.0 * owner + 10.0 * number + row, source_file=name, source_row=row),))
              for row in range(rows)]
    return IngestedFile(name, f"{owner}-{number}", rows, tuple(scores))

with Store.open(folder, url=url, campaign="test") as store:
    print("ready", flush=True)
    sys.stdin.readline()
    store.add_batch([NewRun({"x": float(me)})] * runs_each)
    for number in range(files_each):
        for run in store.claim():
            print("claimed", run.run_id, flush=True)
            store.record_scores(run.run_id, [NewScore("crops", float(run.run_id))])
        store.ingest_files([file(f"{me}-{number}.csv", me, number)])
        store.ingest_files([file("shared.csv", 99, number)])  # everybody has it; it counts once
    while claimed := store.claim():
        for run in claimed:
            print("claimed", run.run_id, flush=True)
            store.record_scores(run.run_id, [NewScore("crops", float(run.run_id))])
    store.release_stale()
"""


def test_eight_writers(store, tmp_path, url):
    arguments = [sys.executable, "-c", WORKER, str(tmp_path), url or ""]
    workers = [
        subprocess.Popen(
            [*arguments, *map(str, (me, RUNS_EACH, FILES_EACH, ROWS))],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        for me in range(PROCESSES)
    ]
    for worker in workers:
        assert worker.stdout.readline() == "ready\n"
    for worker in workers:
        worker.stdin.write("go\n")
        worker.stdin.flush()
    claimed: list[int] = []
    for worker in workers:
        out, _ = worker.communicate(timeout=300)
        assert worker.returncode == 0
        claimed += [int(line.split()[1]) for line in out.splitlines()]

    runs = store.runs()
    proposed = [run for run in runs if run.source == "simulation"]
    assert len(proposed) == PROCESSES * RUNS_EACH
    assert sorted(claimed) == [run.run_id for run in proposed]  # each claimed by one process, once
    assert all((run.state, run.attempts, run.scores[0].score) == ("scored", 1, float(run.run_id)) for run in proposed)
    measured = sorted(run.scores[0].score for run in runs if run.source == "flight")
    owners = [*range(PROCESSES), 99]
    assert measured == sorted(100.0 * o + 10.0 * n + r for o in owners for n in range(FILES_EACH) for r in range(ROWS))
    assert [run.run_id for run in runs] == list(range(1, len(runs) + 1))
    assert len(store.files()) == (PROCESSES + 1) * FILES_EACH
    kinds = Counter(event.kind for event in store.events())
    assert kinds["scored"] == len(runs)
    assert kinds["running"] == len(proposed)
    assert kinds["ingested"] == (PROCESSES + 1) * FILES_EACH


def test_a_campaign_lives_in_postgres(postgres, tmp_path):
    """Through the command line, by ``[store] url``; no data base is made in the folder."""
    from typer.testing import CliRunner

    from seqrsm.cli.app import app

    wipe(postgres)
    (tmp_path / "campaign.toml").write_text(
        '[campaign]\nname = "shared"\n[[factor]]\nname = "x"\nlow = -1\nhigh = 1\n[[application]]\nname = "worth"\n'
        f'utility = "measured"\n[stop]\nhalf_width = 1\n[store]\nurl = "{postgres}"\n'
    )
    rows = [f"{k / 10 - 1},{k % 3 + k / 10}" for k in range(21)]
    (tmp_path / "scores.csv").write_text("x,score\n" + "\n".join(rows))
    for command in (["ingest", "scores.csv"], ["void", "1"], ["status"], ["propose"]):
        rest = [str(tmp_path / "scores.csv")] if command[0] == "ingest" else command[1:]
        more = ["--why", "clouds"] if command[0] == "void" else []
        result = CliRunner().invoke(app, [command[0], str(tmp_path), *rest, *more])
        assert result.exit_code == 0, result.output
    assert sorted(path.name for path in tmp_path.iterdir()) == ["campaign.toml", "scores.csv"]
    with Store.open(tmp_path, url=postgres, campaign="shared") as store:
        assert Counter(run.state for run in store.runs()) == {"scored": 20, "void": 1, "issued": 4}
    missing = postgres.replace("seqrsm@", "nobody@")
    (tmp_path / "campaign.toml").write_text((tmp_path / "campaign.toml").read_text().replace(postgres, missing))
    result = CliRunner().invoke(app, ["status", str(tmp_path)])
    assert result.exit_code == 2
    assert "Traceback" not in result.output


def test_new_runs_after_many(store):
    """Ids go on from the last one, whoever made it."""
    store.add_batch([NewRun({"x": 1.0})] * 3)
    assert store.add_batch([NewRun({"x": 1.0})]) == (4,)
