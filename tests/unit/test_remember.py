"""What is kept is what was made, of the same, by the same code, and nothing else."""

from __future__ import annotations

import os
import stat
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from scored_campaigns import campaign, numeric, specification

from seqrsm import jit, remember
from seqrsm.analysis.to_json import analysis_to_json
from seqrsm.plain import plain


@pytest.fixture(autouse=True)
def kept(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "seqrsm" / "kept"


def test_a_thing_is_made_once_of_the_same_and_anew_of_another_or_by_other_code(monkeypatch, kept) -> None:
    made = iter(range(100))
    asked = ("a", "a", ("a", 1), "b", ("a", 1))
    assert [remember.remembered(lambda: next(made), of) for of in asked] == [0, 0, 1, 2, 1]
    monkeypatch.setattr(remember, "_code", lambda: "other")
    assert remember.remembered(lambda: next(made), "a") == 3
    monkeypatch.undo()
    for file in kept.glob("*"):
        file.write_bytes(file.read_bytes()[:-3])
    monkeypatch.setenv("XDG_CACHE_HOME", str(kept.parents[1]))
    assert [remember.remembered(lambda: next(made), "a") for _ in range(2)] == [4, 4]
    for of in range(2 * remember.MOST_KEPT):
        remember.remembered(lambda: next(made), of)
    assert len(list(kept.glob("*"))) == remember.MOST_KEPT


def test_a_cache_that_cannot_be_written_costs_time_alone(monkeypatch, tmp_path) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "file"))
    assert jit.cache_root() is None
    assert jit.cache_directory() is None
    assert [remember.remembered(lambda: 7, "a") for _ in range(2)] == [7, 7]


def test_in_memory_the_latest_are_kept_and_are_the_same_object(kept) -> None:
    of = [(np.arange(3.0), i) for i in range(2 * remember.MOST_RECALLED)]
    first = [remember.recalled(object, one) for one in of]
    assert len(set(map(id, first))) == len(of)
    latest = of[-remember.MOST_RECALLED :]
    assert [remember.recalled(object, (one[0].copy(), one[1])) for one in latest] == first[-remember.MOST_RECALLED :]
    assert remember.recalled(object, of[0]) is not first[0]
    assert not kept.exists()


def test_where_the_cache_cannot_be_written_it_is_a_private_folder_for_temporary_files(monkeypatch, tmp_path) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    assert jit.cache_root() == tmp_path / f"seqrsm-{os.getuid()}"
    assert stat.S_IMODE((tmp_path / f"seqrsm-{os.getuid()}").stat().st_mode) == 0o700


@pytest.mark.skipif(sys.platform == "win32", reason="owners and modes of files")
@pytest.mark.parametrize("what", ["another's", "open to others", "a link"])
def test_a_folder_that_others_may_write_is_no_cache(kept, monkeypatch, tmp_path, what) -> None:
    """Pickles and machine code run when they are read: those that somebody else put there must not be."""
    root = kept.parent
    (tmp_path / "file").touch()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "file"))
    if what == "a link":
        root.parent.mkdir()
        (tmp_path / "elsewhere").mkdir(mode=0o700)
        root.symlink_to(tmp_path / "elsewhere")
    else:
        root.mkdir(parents=True)
        root.chmod(0o777 if what == "open to others" else 0o700)
    if what == "another's":
        monkeypatch.setattr(os, "geteuid", lambda: root.stat().st_uid + 1)
    assert jit.cache_root() is None
    assert [remember.remembered(lambda: 7, "a") for _ in range(2)] == [7, 7]
    assert not list(tmp_path.rglob("*.pickle"))


def test_a_folder_that_others_may_read_is_closed_to_them(kept) -> None:
    kept.parent.mkdir(parents=True)
    kept.parent.chmod(0o755)
    assert jit.cache_root() == kept.parent
    assert stat.S_IMODE(kept.parent.stat().st_mode) == 0o700


def test_a_fit_is_made_once_until_there_is_another_score(tmp_path, monkeypatch) -> None:
    rng = np.random.default_rng(1)
    points = rng.uniform(-1.0, 1.0, (20, 2))
    scores = 50.0 - 5.0 * points[:, 0] ** 2 + rng.normal(size=20)
    made = campaign(tmp_path / "c", specification(numeric(2)), points, scores)
    (first,) = made.analyse_all(thorough=True)
    with monkeypatch.context() as patch:
        patch.setattr("seqrsm.campaign.campaign.analyse", lambda *_: None)  # takes no options: raises where called
        (again,) = made.analyse_all(thorough=True)
        assert plain(analysis_to_json(again)) == plain(analysis_to_json(first))
        with pytest.raises(TypeError):
            made.analyse_all(thorough=True, n_draws=500)
    made.store.void(made.store.runs()[0].run_id, "tried")
    assert made.analyse_all(thorough=True)[0].fit.n_runs == 19


def test_what_one_thread_asks_for_is_not_pushed_out_by_another() -> None:
    made = []

    @remember.cached_by_thread
    def make(x: int) -> int:
        made.append(x)
        return x

    assert make(1) == make(1) == 1
    with ThreadPoolExecutor(1) as other:
        assert [other.submit(make, x).result() for x in (2, 1, 1)] == [2, 1, 1]
    assert make(1) == 1
    assert made == [1, 2, 1]
    assert [make(x) for x in (3, 1)] == [3, 1]
    assert made == [1, 2, 1, 3, 1]


def test_code_and_tables_tell_what_a_result_was_made_by(tmp_path, monkeypatch) -> None:
    """A unit in a table of the package changed, and the analyses from before were still shown."""
    monkeypatch.setattr(remember, "PACKAGE", tmp_path)
    found = []
    for name, text in (("a.py", "1"), ("a.py", "2"), ("b.csv", "1"), ("b.csv", "2")):
        (tmp_path / name).write_text(text, encoding="utf-8")
        found.append(remember._code.__wrapped__())
    assert len(set(found)) == 4


def test_arrays_are_kept_up_to_so_many_bytes_those_asked_for_last_first():
    made = []

    @remember.arrays_by_thread(most_bytes=25_000)
    def zeros(n: int, *, name: str = "") -> np.ndarray:
        made.append((n, name))
        return np.zeros(n)

    first = zeros(1000)
    zeros(1000, name="other")
    assert zeros(1000) is first
    zeros(1000, name="third")  # the second is the oldest now
    assert zeros(1000) is first
    zeros(1000, name="third")
    assert made == [(1000, ""), (1000, "other"), (1000, "third")]
    zeros(1000, name="other")
    assert len(made) == 4
    # One that is larger than all that may be kept is there until the next is asked for.
    large = zeros(10_000)
    assert zeros(10_000) is large
    zeros(1)
    zeros(10_000)
    assert made[4:] == [(10_000, ""), (1, ""), (10_000, "")]
    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(zeros, 10_000).result() is not zeros(10_000)
