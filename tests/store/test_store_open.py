"""Stores that cannot be opened say why and what to do."""

from __future__ import annotations

import os
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from contextlib import closing
from pathlib import Path

import pytest
from postgres_server import restarted, wipe

from seqrsm.errors import StoreError
from seqrsm.store import database as store_connection
from seqrsm.store.database import Database, network_file_system
from seqrsm.store.records import NewRun, NewScore
from seqrsm.store.store import STORE_NAME, Store

RUN = NewRun({"x": 1.0})


@pytest.fixture
def folder(tmp_path):
    with Store.open(tmp_path, create=True, campaign="test") as store:
        store.add_batch([RUN] * 300)
        store.record_scores(1, [NewScore("crops", 3.0)])
    return tmp_path


def test_durability_settings(folder):
    with Store.open(folder) as store, store._database.read() as connection:
        pragma = {
            name: connection.exec_driver_sql(f"PRAGMA {name}").scalar()
            for name in ("journal_mode", "synchronous", "foreign_keys", "busy_timeout")
        }
    assert pragma == {"journal_mode": "wal", "synchronous": 2, "foreign_keys": 1, "busy_timeout": 30000}


@pytest.mark.parametrize("create", [False, True])
def test_absent(tmp_path, create):
    with pytest.raises(StoreError, match=r"no such folder.*seqrsm init"):
        Store.open(tmp_path / "absent", create=create)
    if not create:
        with pytest.raises(StoreError, match=r"no database yet.*seqrsm run"):
            Store.open(tmp_path)
        assert not (tmp_path / STORE_NAME).exists()


def test_a_folder_in_its_place(tmp_path):
    (tmp_path / STORE_NAME).mkdir()
    with pytest.raises(StoreError, match="a folder stands"):
        Store.open(tmp_path, create=True)


@pytest.mark.parametrize("create", [False, True])
def test_empty_file_is_no_new_campaign(tmp_path, create):
    (tmp_path / STORE_NAME).touch()
    with pytest.raises(StoreError, match=r"no tables"):
        Store.open(tmp_path, create=create, campaign="a")
    assert not (tmp_path / STORE_NAME).stat().st_size


def test_file_into_which_nobody_wrote_goes_again(tmp_path):
    first, second = (Store.open(tmp_path, create=True, campaign="a") for _ in range(2))
    first.leave()
    assert second.runs() == ()  # which another process has open
    second.add_event("x", {})
    second.leave()
    Store.open(tmp_path, create=True).leave()
    assert [path.name for path in tmp_path.iterdir()] == [STORE_NAME]
    (tmp_path / "b").mkdir()
    Store.open(tmp_path / "b", create=True, campaign="b").leave()
    assert not list((tmp_path / "b").iterdir())


def test_no_data_base(tmp_path):
    (tmp_path / STORE_NAME).write_text("name = 'x'\n" * 100)
    with pytest.raises(StoreError, match=r"not a database.*copy"):
        Store.open(tmp_path, create=True)
    assert (tmp_path / STORE_NAME).read_text() == "name = 'x'\n" * 100


def test_truncated(folder):
    path = folder / STORE_NAME
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(StoreError, match=r"damaged.*copy"), Store.open(folder) as store:
        store.events()


def test_overwritten_page(folder):
    path = folder / STORE_NAME
    data = bytearray(path.read_bytes())
    data[4096:] = b"\xa5" * (len(data) - 4096)
    path.write_bytes(data)
    with pytest.raises(StoreError, match=r"damaged.*copy"), Store.open(folder) as store:
        store.runs()


def test_newer_schema(folder):
    with sqlite3.connect(folder / STORE_NAME) as connection:
        connection.execute("UPDATE alembic_version SET version_num = '9999'")
    connection.close()
    with pytest.raises(StoreError, match=r"another version.*9999.*Use the version"):
        Store.open(folder)


def test_another_campaign(folder):
    with pytest.raises(StoreError, match="belongs to the campaign 'test', not 'other'"):
        Store.open(folder, campaign="other")


def test_read_only_folder(folder):
    """As a user who may read but not write; root may write everywhere, so it becomes nobody first."""
    place = Path(tempfile.mkdtemp())
    try:
        shutil.copy(folder / STORE_NAME, place / STORE_NAME)
        (place / STORE_NAME).chmod(0o444)
        place.chmod(0o555)
        script = (
            "import os; from seqrsm.store.store import Store, NewRun\n"
            "from seqrsm.errors import StoreError\n"
            "if os.geteuid() == 0: os.setuid(65534)\n"
            "try:\n"
            f"    with Store.open({str(place)!r}) as s: s.add_batch([NewRun({{}})])\n"
            "except StoreError as error: print(error)\n"
        )
        done = subprocess.run(
            [sys.executable, "-c", script], capture_output=True, text=True, check=True, cwd=os.getcwd()
        )
        assert "may be written" in done.stdout or "Obtain write permission" in done.stdout
    finally:
        place.chmod(0o755)
        shutil.rmtree(place)


@pytest.mark.parametrize(
    ("url", "says"),
    [
        ("nonsense", "not usable"),
        ("postgresql+psycopg://u:secret@h:port/n", "not usable"),
        ("postgresql+psycopg://u:secret@h:5432:1/n", "not usable"),
        ("nodialect+x://u:secret@h/n", "not usable"),
        ("postgresql+psycopg://u:secret@127.0.0.1:1/n?connect_timeout=2", "server does not answer"),
    ],
)
def test_unusable_addresses_and_no_password_in_the_message(tmp_path, url, says):
    with pytest.raises(StoreError, match=says) as caught:
        Store.open(tmp_path, url=url, create=True)
    assert "secret" not in str(caught.value)


def test_a_store_that_is_left_open_is_closed_with_its_last_name(folder):
    """Python 3.13 and later warn of each connection that is left."""
    place, links = str(folder / STORE_NAME), Path("/proc/self/fd")
    if not links.exists():
        pytest.skip("no list of open files here")

    def held():
        return sum(os.path.realpath(one) == os.path.realpath(place) for one in links.iterdir())

    store = Store.open(folder)
    assert len(store.runs()) == 300
    assert held() > 0
    del store  # no garbage collection is waited for
    assert held() == 0


def test_a_held_lock_is_reported(folder, monkeypatch):
    monkeypatch.setattr(store_connection, "BUSY_TIMEOUT_S", 0.2)
    holder = sqlite3.connect(folder / STORE_NAME, isolation_level=None)
    holder.execute("BEGIN IMMEDIATE")
    with Store.open(folder) as store:
        with pytest.raises(StoreError, match=r"another process held"):
            store.add_batch([RUN])
        assert len(store.runs()) == 300  # readers are not held up
    holder.close()


def test_network_file_systems_are_recognised(folder, monkeypatch, tmp_path):
    mounts = "/dev/a / ext4 rw 0 0\nhost:/x /home nfs4 rw 0 0\n//h/y /mnt/my\\040disk cifs rw 0 0\n"
    mounts += "/dev/b /home/me ext4 rw 0 0\n"
    places = {"/home/you/c": "nfs4", "/home/me/c": "", "/mnt/my disk/c": "cifs", "/srv": "", "/homes": ""}
    found = {place: network_file_system(Path(place), mounts) for place in places}
    assert found == places
    (tmp_path / "mounts").write_text(f"host:/x {folder.resolve()} nfs rw 0 0\n")
    monkeypatch.setattr("seqrsm.store.database._MOUNTS", tmp_path / "mounts")
    with Store.open(folder) as store, store._database.read() as connection:
        assert "network file system (nfs): work on it from one host" in store.note
        assert connection.exec_driver_sql("PRAGMA journal_mode").scalar() == "delete"


@pytest.mark.parametrize("how", ["deleted", "replaced", "moved with its folder"])
def test_a_file_that_vanished_is_missed_at_once_and_what_it_held_is_kept(tmp_path, how):
    place = tmp_path / "campaign"
    place.mkdir()
    with Store.open(place, create=True, campaign="test") as store:
        store.add_batch([RUN] * 3)
        if how == "moved with its folder":
            place.rename(tmp_path / "moved")
        for path in place.glob(f"{STORE_NAME}*"):
            path.unlink()
        if how == "replaced":
            (place / STORE_NAME).touch()
        for _ in range(2):
            with pytest.raises(StoreError, match="no longer the file that was opened"):
                store.add_batch([RUN])
        with pytest.raises(StoreError, match="no longer the file"):
            store.runs()
    if how == "moved with its folder":
        assert not place.exists()
    else:
        (kept,) = place.glob("*.rescued")
        assert [path.name for path in place.iterdir() if path != kept] == [STORE_NAME] * (how == "replaced")
        (tmp_path / "moved").mkdir()
        kept.rename(tmp_path / "moved" / STORE_NAME)
    with Store.open(tmp_path / "moved", campaign="test") as store:
        assert len(store.runs()) == 3


def test_what_was_written_into_a_file_that_vanished_is_not_acknowledged(folder):
    def write_and_lose(store):
        with store._write() as ledger:
            (folder / STORE_NAME).unlink()
            ledger.log("stop", [(None, {})])

    with Store.open(folder) as store, pytest.raises(StoreError, match="no longer the file"):
        write_and_lose(store)


def test_a_log_that_goes_while_it_is_looked_at_is_none(tmp_path, monkeypatch):
    """Another process that closes the database last takes it away."""
    place, log, exists = tmp_path / STORE_NAME, tmp_path / f"{STORE_NAME}-wal", Path.exists
    log.write_bytes(b"log")
    assert store_connection._log_size(place) == 3

    def gone(path):
        found = exists(path)
        log.unlink(missing_ok=True)
        return found

    with monkeypatch.context() as meanwhile:
        meanwhile.setattr(Path, "exists", gone)
        assert store_connection._log_size(place) in (0, 3)
    log.unlink(missing_ok=True)
    assert store_connection._log_size(place) == 0


def test_the_address_of_a_file_counts_from_the_campaign(folder, monkeypatch):
    (folder / STORE_NAME).rename(folder / "other.db")
    for place in (folder, folder.parent):
        monkeypatch.chdir(place)
        with Store.open(folder, url="sqlite:///other.db") as store:
            assert len(store.runs()) == 300
    with Store.open(folder.parent, url=f"sqlite:///{folder / 'other.db'}") as store:
        assert len(store.runs()) == 300


def test_a_server_that_is_started_again_is_waited_for(tmp_path, postgres):
    wipe(postgres)
    with Store.open(tmp_path, url=postgres, create=True, campaign="test") as store:
        store.add_batch([RUN])
        with restarted(postgres):
            assert store.add_batch([RUN]) == (2,)


def test_a_server_that_another_holds_is_not_waited_for_for_ever(tmp_path, postgres, monkeypatch):
    monkeypatch.setattr(store_connection, "_SERVER_LIMITS", "-c lock_timeout=200ms")
    wipe(postgres)
    with (
        Store.open(tmp_path, url=postgres, create=True, campaign="test") as one,
        Store.open(tmp_path, url=postgres, campaign="test") as other,
        one._write(),
        pytest.raises(StoreError, match="did not answer in time"),
    ):
        other.add_batch([RUN])


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_waits_for_the_end_of_a_transaction(tmp_path, number) -> None:
    """Between two statements it would leave the lock with a process that then waits for it itself."""

    class Stopped(BaseException):
        pass

    def stop(*_: object) -> None:
        raise Stopped

    def interrupted_within(transaction) -> None:
        with transaction():
            os.kill(os.getpid(), number)
            time.sleep(0.05)
            done.append(transaction)

    opened = Database(tmp_path / STORE_NAME, create=True, campaign="c")
    before, done = signal.signal(number, stop), []
    try:
        for transaction in (opened.write, opened.read):
            with pytest.raises(Stopped):
                interrupted_within(transaction)
            assert signal.getsignal(number) is stop
    finally:
        signal.signal(number, before)
    assert done == [opened.write, opened.read]
    with closing(sqlite3.connect(tmp_path / STORE_NAME, timeout=0.0)) as other:
        other.execute("BEGIN IMMEDIATE")
    opened.close()
