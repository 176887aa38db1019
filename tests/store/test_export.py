"""The export holds everything, reads back, and runs nothing in a spreadsheet."""

from __future__ import annotations

import csv
import json
import math
from dataclasses import asdict

import pytest

from seqrsm.campaign.export import export
from seqrsm.campaign.ingest import ingest_files
from seqrsm.errors import StoreError, UserError
from seqrsm.spec.read import load_spec
from seqrsm.store.records import NewRun, NewScore

SPEC = """\
[campaign]
name = "test"
[[factor]]
name = "x"
low = -1
high = 1
[[factor]]
name = "kind"
levels = ["=1+1", "plain"]
[[application]]
name = "a"
utility = "measured"
unit = "dB"
[[application]]
name = "b"
utility = "measured"
[stop]
half_width = 1
"""


@pytest.fixture
def filled(store, tmp_path):
    (tmp_path / "campaign.toml").write_text(SPEC)
    store.add_batch(
        [NewRun({"x": -0.1, "kind": "=1+1"}, "start", "=cmd|' /C calc'!A0"), NewRun({"x": 1, "kind": "plain"})]
    )
    scores = [NewScore("a", 0.1 + 0.2, metadata={"q": [1]}), NewScore("b", -2.0, 0.5)]
    with store._write() as ledger:
        ledger.log_settings(1, {"x": -0.2, "kind": "=1+1"})
    store.record_scores(1, scores)
    store.void(2, "@home")
    store.record_look(1, "a", {"half_width": math.inf})
    return store, load_spec(tmp_path), tmp_path


def rows(path):
    with path.open(newline="", encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


def test_json_holds_everything(filled):
    store, spec, folder = filled
    assert export(store, spec, folder / "all.json") == (folder / "all.json",)
    document = json.loads((folder / "all.json").read_text(encoding="utf-8"), parse_constant=pytest.fail)
    assert document["runs"] == json.loads(json.dumps([asdict(run) for run in store.runs()]))
    assert document["events"] == [asdict(event) for event in store.events()]
    assert document["looks"] == [asdict(look) for look in store.looks()]
    assert document["spec_hash"] == spec.spec_hash


def test_csv_has_a_row_for_each_score(filled):
    store, spec, folder = filled
    paths = export(store, spec, folder / "all.csv")
    assert [path.name for path in paths] == ["all.csv", "all.looks.csv", "all.events.csv", "all.files.csv"]
    first, second, third = rows(paths[0])
    assert (first["score_unit"], third["score_unit"]) == ("dB", "")
    assert (first["run_id"], second["run_id"], third["run_id"]) == ("1", "1", "2")
    assert float(first["score"]) == 0.1 + 0.2
    assert (first["application"], second["application"], third["score"], third["state"]) == ("a", "b", "", "void")
    assert (first["x"], first["proposed_x"], second["score"]) == ("-0.2", "-0.1", "-2")  # numbers stay numbers
    assert json.loads(first["metadata"]) == {"q": [1]}
    assert len(rows(paths[2])) == len(store.events())
    assert len(rows(paths[1])) == 1
    assert paths[3].read_text().startswith("name,sha256")


def test_csv_names_units_and_the_column_of_blocks(store, tmp_path):
    """What comes out goes in again under the names that it had: an export is a scores file like any other."""
    text = SPEC.replace("high = 1\n", 'high = 1\nunit = "K"\n') + '[model]\nblock = "day"\n[cost]\nunit = "kEUR"\n'
    (tmp_path / "campaign.toml").write_text(text)
    spec = load_spec(tmp_path)
    head = "x [K],kind,day,application,score\n"
    (tmp_path / "s.csv").write_text(head + "0.5,plain,Mon,a,3\n-0.5,plain,Tue,a,4\n")
    ingest_files(store, spec, [tmp_path / "s.csv"])
    export(store, spec, tmp_path / "all.csv")
    first, second = rows(tmp_path / "all.csv")
    assert (first["x [K]"], first["proposed_x [K]"], first["cost [kEUR]"]) == ("0.5", "0.5", "1")
    assert (first["day"], second["day"], "block" in first) == ("Mon", "Tue", False)
    (report,) = ingest_files(store, spec, [tmp_path / "all.csv"])
    assert (report.unchanged, report.messages) == ((1, 2), ())
    lines = (tmp_path / "all.csv").read_text(encoding="utf-8").splitlines()
    (tmp_path / "no ids.csv").write_text("\n".join(line.split(",", 1)[1] for line in lines))
    (report,) = ingest_files(store, spec, [tmp_path / "no ids.csv"])
    assert [row.run_id for row in report.equal] == [1, 2]


def test_a_factor_named_as_a_column_of_runs_keeps_its_name(store, tmp_path):
    (tmp_path / "campaign.toml").write_text(SPEC.replace('"x"', '"cost"'))
    spec = load_spec(tmp_path)
    store.add_batch([NewRun({"cost": 0.5, "kind": "plain"}, cost=3.0)])
    export(store, spec, tmp_path / "all.csv")
    header = (tmp_path / "all.csv").read_text(encoding="utf-8").splitlines()[0].split(",")
    assert len(set(header)) == len(header)
    assert [rows(tmp_path / "all.csv")[0][name] for name in ("cost", "run_cost")] == ["0.5", "3"]


def test_no_cell_is_a_formula(filled):
    store, spec, folder = filled
    for path in export(store, spec, folder / "all.csv"):
        for row in rows(path):
            for value in row.values():
                if value[:1] in "=+-@\t\r":
                    float(value or 0)
    first, _, third = rows(folder / "all.csv")
    assert first["kind"] == "'=1+1"
    assert first["why"].startswith("'=cmd")
    assert third["reason"] == "'@home"


def test_unknown_kind_and_unwritable_place(filled):
    store, spec, folder = filled
    with pytest.raises(StoreError, match=r"\.csv or \.json"):
        export(store, spec, folder / "all.xlsx")
    with pytest.raises(UserError, match="cannot be written"):
        export(store, spec, folder / "absent" / "all.json")
    assert not list(folder.glob("*.draft"))


@pytest.mark.parametrize("name", ["all.csv", "all.json", "all.events.csv"])
def test_nothing_that_is_there_already_is_overwritten(filled, name):
    store, spec, folder = filled
    (folder / name).write_text("mine")
    with pytest.raises(UserError, match=f"{name}: the file exists already. Name a new file"):
        export(store, spec, folder / name.replace(".events", ""))
    assert (folder / name).read_text() == "mine"
    assert len(list(folder.glob("all*"))) == 1
