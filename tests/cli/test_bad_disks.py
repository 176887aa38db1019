"""Full disks, folders that may not be written, damaged and newer data bases: a clear word, exit code 2, no damage."""

from __future__ import annotations

import os
import random
import resource
import shutil
import sqlite3
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest
from kill_episodes import check_consistent
from typer.testing import CliRunner

from seqrsm.campaign.ingest import ingest_files
from seqrsm.cli.app import app
from seqrsm.spec.read import load_spec
from seqrsm.store import database
from seqrsm.store.store import STORE_NAME, Store

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="limits and rights of Unix")

SPEC = """\
[campaign]
name = "disk"
[[factor]]
name = "x"
low = -1.0
high = 1.0
[[application]]
name = "worth"
utility = "measured"
[stop]
half_width = 0.5
"""


def scores(n: int, start: int = 0) -> str:
    rows = [f"{(k % 21) / 10 - 1},{(k % 21) / 10 - 1 + 0.01 * (k % 7)},day {k}" for k in range(start, start + n)]
    return "x,score,note\n" + "\n".join(rows) + "\n"


def call(*arguments: object, code: int = 0) -> str:
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert result.exit_code == code, result.output
    assert "Traceback" not in result.output
    return result.output


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    place = tmp_path / "campaign"
    place.mkdir()
    (place / "campaign.toml").write_text(SPEC, encoding="utf-8")
    (place / "first.csv").write_text(scores(30), encoding="utf-8")
    (place / "second.csv").write_text(scores(800, start=100), encoding="utf-8")
    with Store.open(place, create=True, campaign="disk") as store:
        ingest_files(store, load_spec(place), [place / "first.csv"])
    return place


def snapshot(folder: Path) -> tuple[object, ...]:
    with Store.open(folder, campaign=load_spec(folder).name) as store:
        return store.runs(), store.events(), store.files()


def on_a_full_disk(limit: int, *command: object) -> subprocess.CompletedProcess[str]:
    """A command none of whose files may grow beyond so many bytes: SQLite meets the same errors as on a full disk."""
    return subprocess.run(
        [sys.executable, "-m", "seqrsm", *map(str, command)],
        capture_output=True,
        text=True,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
        timeout=300,
        check=False,
    )


@pytest.mark.parametrize("spare", [0, 30_000])
def test_a_full_disk(folder, spare):
    before = snapshot(folder)
    limit = max((folder / STORE_NAME).stat().st_size, 100_000) + spare
    child = on_a_full_disk(limit, "ingest", folder, folder / "second.csv")
    assert child.returncode == 2, child.stderr
    assert "disk" in child.stderr
    assert "Traceback" not in child.stderr
    check_consistent(folder)
    assert snapshot(folder) == before
    call("ingest", folder, folder / "second.csv")
    assert len(snapshot(folder)[0]) == 830


def test_a_full_disk_in_mid_checkpoint_is_no_damage(folder, tmp_path):
    """The header was brought into the file and its last pages were not: the log holds them. All was told to be lost."""
    path, before = folder / STORE_NAME, snapshot(folder)
    with closing(sqlite3.connect(path)) as writer:
        writer.execute("PRAGMA wal_autocheckpoint = 0")
        writer.execute("CREATE TABLE more AS SELECT zeroblob(300000) AS much")
        writer.commit()
        pages = writer.execute("PRAGMA page_count").fetchone()[0]
        other = tmp_path / "other"
        shutil.copytree(folder, other)  # as it lies on the disk, the log beside it
    with (other / STORE_NAME).open("r+b") as file:
        file.seek(28)
        file.write(pages.to_bytes(4, "big"))
    limit = max((other / STORE_NAME).stat().st_size, 100_000)
    child = on_a_full_disk(limit, "ingest", other, folder / "second.csv")
    assert child.returncode == 2, child.stderr
    assert "Check the disk and its free space" in child.stderr
    assert "damaged" not in child.stderr
    assert snapshot(other) == before


@pytest.mark.parametrize(
    "command", [["export", "all.json"], ["export", "all.csv"], ["report", "--html", "report.html"]]
)
def test_files_that_cannot_be_written_leave_the_old_ones(folder, command):
    (folder / command[-1]).write_text("old", encoding="utf-8")
    name, *rest = command
    child = on_a_full_disk(4096, name, folder, *rest[:-1], folder / rest[-1])
    assert child.returncode == 2, child.stderr
    assert "Traceback" not in child.stderr
    assert (folder / command[-1]).read_text(encoding="utf-8") == "old"


def test_a_file_that_the_disk_does_not_hold_leaves_no_draft(tmp_path):
    code = """
import resource, sys
from pathlib import Path
from seqrsm.files import put
resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))
put(Path(sys.argv[1]), bytes(5000))
"""
    child = subprocess.run([sys.executable, "-c", code, str(tmp_path / "all.json")], capture_output=True, text=True)
    assert "UserError" in child.stderr
    assert list(tmp_path.iterdir()) == []


@contextmanager
def as_nobody() -> Iterator[None]:
    """Root may write everywhere: be somebody else."""
    if os.geteuid() != 0:
        yield
        return
    os.seteuid(65534)
    try:
        yield
    finally:
        os.seteuid(0)


@pytest.fixture
def readable(folder) -> Iterator[Path]:
    """The campaign in a folder that anybody may read and nobody may write."""
    place = Path(tempfile.mkdtemp())
    place.chmod(0o755)
    shutil.copytree(folder, place / "campaign")
    with sqlite3.connect(place / "campaign" / STORE_NAME) as connection:
        connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    connection.close()
    for path in (place / "campaign").iterdir():
        path.chmod(0o444)
    (place / "campaign").chmod(0o555)
    yield place / "campaign"
    (place / "campaign").chmod(0o755)
    shutil.rmtree(place)


@pytest.mark.parametrize("command", ["ingest", "void"])
def test_a_folder_that_may_not_be_written(readable, command):
    rest = {"ingest": [readable / "second.csv"], "void": [1, "--why", "clouds"]}[command]
    content = (readable / STORE_NAME).read_bytes()
    with as_nobody():
        says = call(command, readable, *rest, code=2)
    assert "may not be written" in says or "may be written" in says
    assert (readable / STORE_NAME).read_bytes() == content


def work(*_: object, **__: object) -> None:
    raise AssertionError("worked although the result cannot be written")


@pytest.mark.parametrize(
    ("long", "command"),
    [
        ("seqrsm.campaign.images.simulated", "image {} --out {}/none/a.png"),
        ("seqrsm.campaign.dossier.assemble", "report {} --html {}/first.csv/a.html"),
        ("seqrsm.campaign.dossier.assemble", "report {} --pdf {}"),
        ("seqrsm.campaign.dossier.assemble", "report {} --figures {}/first.csv"),
        ("seqrsm.cli.designs.standalone_design", "design --factors 2 --runs 9 --csv {}/none/a.csv"),
        ("seqrsm.scene.raster.read_geotiff", "scene import --elevation a --cover b --legend c --out {}/none/a.npz"),
        ("seqrsm.campaign.campaign.Campaign.decide", "propose {} --csv {}/none/a.csv"),
    ],
)
def test_a_result_that_cannot_be_written_is_told_before_the_work(folder, monkeypatch, long, command):
    monkeypatch.setattr(long, work)
    assert "the file cannot be written: " in call(*command.replace("{}", str(folder)).split(), code=2)


@pytest.mark.parametrize("command", ["candidates", "tradeoff"])
def test_a_file_of_the_campaign_that_may_not_be_written_is_told_before_the_work(readable, monkeypatch, command):
    monkeypatch.setattr("seqrsm.campaign.candidates.candidates_of", lambda spec: [spec])
    monkeypatch.setattr("seqrsm.campaign.campaign.Campaign.analyse_all", work)
    monkeypatch.setattr("seqrsm.campaign.tradeoff.see_parameters", lambda *_: None)
    monkeypatch.setattr("seqrsm.campaign.tradeoff.scene_at", work)
    with as_nobody():
        assert f"{command}.json: the file cannot be written: Permission denied" in call(command, readable, code=2)


def test_a_medium_that_cannot_be_written_can_be_read(folder, tmp_path, monkeypatch):
    expected = {command: call(command, folder, "--json") for command in ("status", "fit")}
    call("export", folder, tmp_path / "one.json")
    with sqlite3.connect(folder / STORE_NAME) as connection:
        connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    connection.close()
    before = {path.name: path.stat().st_mtime_ns for path in folder.iterdir()}
    monkeypatch.setattr(database, "_may_write", lambda path: path.parent != folder and path != folder)
    for command, said in expected.items():
        assert call(command, folder, "--json") == said
    call("export", folder, tmp_path / "two.json")
    assert (tmp_path / "two.json").read_bytes() == (tmp_path / "one.json").read_bytes()
    call("report", folder, "--html", tmp_path / "report.html")
    assert "may not be written" in call("void", folder, 1, "--why", "clouds", code=2)
    after = {path.name: path.stat().st_mtime_ns for path in folder.iterdir()}
    assert after == before


def test_a_new_campaign_in_a_folder_that_may_not_be_written(readable):
    (readable.parent / "empty").mkdir()
    shutil.copy(readable / "campaign.toml", readable.parent / "empty")
    with as_nobody():
        says = call("propose", readable.parent / "empty", code=2)
    assert "may be written" in says
    assert not (readable.parent / "empty" / STORE_NAME).exists()


@pytest.mark.parametrize("keep", [0.2, 0.5, 0.9, 0.999])
@pytest.mark.parametrize("command", ["status", "ingest"])
def test_a_truncated_data_base(folder, keep, command):
    path = folder / STORE_NAME
    content = path.read_bytes()
    damaged = content[: int(keep * len(content))]
    path.write_bytes(damaged)
    says = call(command, folder, *([folder / "second.csv"] if command == "ingest" else []), code=2)
    assert "damaged" in says or "not a database" in says
    assert path.read_bytes() == damaged  # nothing made worse


def test_an_empty_file_is_no_data_base_of_this_campaign(folder):
    """No scores would seem lost where all are: a campaign begins with a whole database."""
    (folder / STORE_NAME).write_bytes(b"")
    assert "delete it if the campaign is new" in call("status", folder, code=2)
    assert (folder / STORE_NAME).read_bytes() == b""


def test_a_data_base_of_another_version(folder):
    with sqlite3.connect(folder / STORE_NAME) as connection:
        connection.execute("UPDATE alembic_version SET version_num = '9999'")
    connection.close()
    content = (folder / STORE_NAME).read_bytes()
    for command in (["status"], ["void", 1, "--why", "x"], ["ingest", folder / "second.csv"]):
        assert "another version of seqrsm" in call(command[0], folder, *command[1:], code=2)
    assert (folder / STORE_NAME).read_bytes() == content


def flipped(folder: Path, seed: int) -> str:
    """What ``status`` says when one bit of the data base is another; the same as before, or an error in words."""
    for log in folder.glob(f"{STORE_NAME}-*"):
        log.unlink()
    content = (folder / STORE_NAME).read_bytes()
    rng = random.Random(seed)
    damaged = bytearray(content)
    damaged[rng.choice([i for i, byte in enumerate(content) if byte])] ^= 1 << rng.randrange(8)
    (folder / STORE_NAME).write_bytes(damaged)
    result = CliRunner().invoke(app, ["status", str(folder), "--json"])
    (folder / STORE_NAME).write_bytes(content)
    assert result.exit_code in (0, 2), (seed, result.output, result.exc_info)
    return "" if result.exit_code else result.stdout


def test_flipped_bits_tell_no_other_scores(folder):
    expected = call("status", folder, "--json")
    with sqlite3.connect(folder / STORE_NAME) as connection:
        connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    connection.close()
    said = {flipped(folder, seed) for seed in range(60)}
    assert said == {expected, ""}
