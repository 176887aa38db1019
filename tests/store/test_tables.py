"""Tables follow from records: they stay those that data bases of their version have, which are read and written."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa

from seqrsm.score.ranking_file import MeasuredRanking, RankedImage
from seqrsm.store.records import IngestedFile, IngestedRun, NewRun, NewScore
from seqrsm.store.schema import VERSION
from seqrsm.store.store import STORE_NAME, Store

MADE = (Path(__file__).parent / "tables_0003.sql").read_text(encoding="utf-8")


def engine_of(folder: Path, url: str | None) -> sa.Engine:
    return sa.create_engine(url or f"sqlite:///{folder / STORE_NAME}")


@pytest.fixture
def earlier(tmp_path: Path, url: str | None) -> Path:
    """Folder of a campaign whose data base has the tables of the file."""
    engine = engine_of(tmp_path, url)
    text = MADE.replace("DOUBLE", "DOUBLE PRECISION") if url else MADE
    if url:  # runs are numbered by the program, the others by the server
        text = re.sub(r"(CREATE TABLE (?!runs)\w+ \(\s+id) INTEGER", r"\1 SERIAL", text)
    more = "CREATE TABLE alembic_version (version_num VARCHAR(32) PRIMARY KEY);"
    more += "INSERT INTO alembic_version VALUES ('0003'); INSERT INTO meta VALUES ('campaign', 'test')"
    with engine.begin() as connection:
        for statement in f"{text}{more}".split(";"):
            connection.exec_driver_sql(statement)
    engine.dispose()
    return tmp_path


def tables(folder: Path, url: str | None) -> dict[str, Any]:
    """What is asked of the columns of a data base; lengths of texts and whole numbers are not."""
    engine = engine_of(folder, url)
    seen = sa.inspect(engine)
    found = {}
    for name in seen.get_table_names():
        columns = [
            (c["name"], {"String": "Text"}.get(kind := c["type"]._type_affinity.__name__, kind), c["nullable"])
            for c in seen.get_columns(name)
        ]
        keys = [(k["constrained_columns"], k["referred_table"]) for k in seen.get_foreign_keys(name)]
        unique = [k["column_names"] for k in seen.get_unique_constraints(name)]
        indices = [(k["name"], k["column_names"]) for k in seen.get_indexes(name) if "duplicates_constraint" not in k]
        checks = [re.sub(r"\W", "", k["sqltext"]) for k in seen.get_check_constraints(name)]
        primary = seen.get_pk_constraint(name)["constrained_columns"]
        found[name] = columns, primary, sorted(map(str, keys)), sorted(unique), indices, checks
    engine.dispose()
    return found


def test_the_tables_are_those_of_their_version(earlier: Path, url: str | None, tmp_path_factory) -> None:
    """Whoever changes a record that is kept changes the tables: then VERSION and this file change, too."""
    assert VERSION == "0003"
    before = tables(earlier, url)
    if url:
        engine = engine_of(earlier, url)
        with engine.begin() as connection:
            connection.exec_driver_sql("DROP SCHEMA public CASCADE")
            connection.exec_driver_sql("CREATE SCHEMA public")
        engine.dispose()
    folder = tmp_path_factory.mktemp("new")
    Store.open(folder, url=url, create=True, campaign="test").close()
    assert tables(folder, url) == before


def test_a_data_base_that_has_them_lives_on(earlier: Path, url: str | None) -> None:
    """Through every table: proposed, simulated, failed, tried again, void, measured, ranked, looked at, verified."""
    here = {"x": 1.5, "kind": "a"}
    with Store.open(earlier, url=url, campaign="test", seed=7) as store:
        store.add_batch([NewRun(here)] * 4)
        assert {run.state for run in store.claim()} == {"running"}
        for run_id in (1, 2):
            store.record_scores(run_id, [NewScore("crops", 70.0, se=1.5, n=10, correct=7, metadata={"a": [1]})])
        store.fail(3, "no memory", "machine")
        assert store.runs("failed")[0].fault == "machine"
        store.void(2, "a slip")
        store.retry([3])
        score = NewScore("crops", 71.0, source_file="a.csv", source_row=2)
        measured = IngestedRun(2, here, "flight", "day 1", 2.5, (score,))
        rows = [replace(measured, run_id=None), measured]
        (outcome,) = store.ingest_files([IngestedFile("a.csv", "0" * 64, 2, tuple(rows))])
        assert (outcome.created, outcome.replaced) == ((5, 6), ((2, 6),))
        images = tuple(RankedImage(rank + 1, run_id, float(rank), None, {}) for rank, run_id in enumerate((3, 4), 1))
        ranked = IngestedFile("r.csv", "1" * 64, 2, (), (MeasuredRanking("ice", "Ann", "", images),))
        assert store.ingest_files([ranked])[0].rankings == (1,)
        store.void_ranking(1, "asleep")
        store.record_look(3, "crops", {"mean": 70.5})
        store.add_event("note", {"text": "\u00fc"})
        store.verify()
    with Store.open(earlier, url=url) as store:
        assert [run.state for run in store.runs()] == ["scored", "void", "issued", "issued", "scored", "scored"]
        assert store.runs()[0].scores[0].n == 10
        assert (store.looks()[0].summary, store.rankings()[0].rank) == ({"mean": 70.5}, 1.0)
        assert {event.seed for event in store.events()} == {7}
        assert [file.name for file in store.files()] == ["a.csv", "r.csv"]
