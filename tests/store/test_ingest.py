"""Measured scores and runs: matched, added, recognised, refused as a whole."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import pytest

from seqrsm.campaign.export import write_form
from seqrsm.campaign.ingest import ingest_files
from seqrsm.errors import ScoresFileError, StoreError
from seqrsm.spec.read import load_spec
from seqrsm.store.records import NewRun, NewScore

SPEC = """\
[campaign]
name = "test"
[[factor]]
name = "frequency"
unit = "GHz"
low = 1
high = 10
scale = "log"
[[factor]]
name = "looks"
values = [1, 4, 16]
[[factor]]
name = "polarization"
levels = ["HH", "VV"]
[[constraint]]
expr = "looks <= 3 * frequency"
[[application]]
name = "crops"
utility = "percent_correct"
{more}
[cost]
flight = 250
simulation = 2
[stop]
half_width = 2
"""
HEADER = "frequency,looks,polarization,score"


@pytest.fixture
def campaign(tmp_path, store):
    """Ingest text into the store; ``more`` goes into campaign.toml."""

    def ingest(text, more="", name="scores.csv", **options):
        (tmp_path / "campaign.toml").write_text(SPEC.format(more=more))
        path = tmp_path / name
        path.write_text(text)
        return ingest_files(store, load_spec(tmp_path), [path], **options)[0]

    return ingest


def snapshot(store):
    return store.runs(), store.events(), store.files()


def test_new_runs_are_flights(campaign, store):
    report = campaign(HEADER + ",se,block,date,camera\n2,4,HH,70,1.5,day 1,1979-05-01,A\n2,4,HH,71,,day 1,,\n")
    assert (report.created, report.matched, report.n_scores, report.messages) == ((1, 2), (), 2, ())
    first, second = store.runs()
    assert (first.source, first.state, first.cost, first.block, first.purpose) == (
        "flight",
        "scored",
        250.0,
        "day 1",
        "measured",
    )
    assert first.proposed == first.executed == {"frequency": 2.0, "looks": 4.0, "polarization": "HH"}
    score = first.score_of("crops")
    assert (score.score, score.se, score.source_file, score.source_row) == (70.0, 1.5, "scores.csv", 2)
    assert score.metadata == {"camera": "A", "date": "1979-05-01"}
    assert second.settings == first.settings  # a repeat is a run of its own
    assert [file.row_count for file in store.files()] == [2]


def test_proposed_runs_keep_both_settings(campaign, store):
    proposed = {"frequency": 2.0, "looks": 4.0, "polarization": "HH"}
    store.add_batch([NewRun(proposed, "optimum", "why", "flight", 250.0, "day 1")] * 3)
    report = campaign("run_id," + HEADER + "\n1,2.1,4,HH,70\n2,2,4,HH,71\n3,2,4,HH,\n")
    assert (report.matched, report.created, report.unscored) == ((1, 2), (), (4,))
    run = store.runs()[0]
    assert (run.proposed, run.executed) == (proposed, {**proposed, "frequency": 2.1})
    assert (run.purpose, run.block, run.source) == ("optimum", "day 1", "flight")
    assert store.runs()[2].state == "issued"


def test_the_form_goes_out_and_comes_back(campaign, store, tmp_path):
    settings = [{"frequency": 10 / 3, "looks": 4.0, "polarization": p} for p in ("HH", "VV")]
    ids = store.add_batch([NewRun(s, source="flight") for s in settings])
    (tmp_path / "campaign.toml").write_text(SPEC.format(more=""))
    write_form(tmp_path / "form.csv", load_spec(tmp_path), store.runs())
    with (tmp_path / "form.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert {"run_id", "frequency [GHz]", "looks", "polarization", "score", "se"} <= set(rows[0])
    with (tmp_path / "filled.csv").open("w", newline="") as stream:
        writer = csv.DictWriter(stream, rows[0])
        writer.writeheader()
        writer.writerows([row | {"score": 60 + i, "se": 2} for i, row in enumerate(rows)])
    report = campaign((tmp_path / "filled.csv").read_text(), name="filled.csv")
    assert report.matched == ids
    assert [run.executed for run in store.runs()] == settings


def test_a_form_without_settings_is_of_the_runs_that_it_names(campaign, store):
    """Flown as proposed, and said so; the same scores again, with settings or without, are no new ones."""
    settings = [{"frequency": 2.0, "looks": 4.0, "polarization": p} for p in ("HH", "VV", "HH")]
    store.add_batch([NewRun(s, source="flight") for s in settings])
    report = campaign("run_id,score,pilot\n1,70,Ann\n2,71,Bob\n3,,Bob\n")
    assert (report.matched, report.created, report.unscored) == ((1, 2), (), (4,))
    assert "No settings are given: those of the runs named are taken." in report.messages
    assert [run.executed for run in store.runs()[:2]] == settings[:2]
    assert store.runs()[0].score_of("crops").metadata == {"pilot": "Ann"}
    assert campaign("run_id,score\n1,70\n2,71\n3,72\n").matched == (3,)
    assert campaign("run_id," + HEADER + "\n1,2,4,HH,70\n").unchanged == (1,)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("run_id,score\n1,70\n9,71\n", r"scores\.csv:3: run_id: no run has this id \(got 9\)"),
        ("run_id,score\n1,70\n,71\n", r"scores\.csv:3: run_id: the cell is empty\. Give that of a proposed run"),
        ("run_id,score\n1,70\nx,71\n", r"scores\.csv:3: run_id: this is not a number \(got 'x'\)"),
        ("run_id,Freq [GHz],score\n1,2,70\n", r"Rename the column 'Freq \[GHz\]' to 'frequency \[GHz\]'"),
        ("run_id,looks,score\n1,4,70\n", "frequency: no column for this factor"),
        ("flight,score\n1,70\n", "it names no factor"),
    ],
)
def test_without_settings_every_run_is_named_or_nothing_taken(campaign, store, text, words):
    store.add_batch([NewRun({"frequency": 2.0, "looks": 4.0, "polarization": "HH"}, source="flight")])
    before = snapshot(store)
    with pytest.raises(ScoresFileError, match=words) as caught:
        campaign(text)
    assert len({problem.field for problem in caught.value.problems}) == len(caught.value.problems)
    assert snapshot(store) == before


def test_outside_the_region_is_kept_with_a_remark(campaign, store):
    report = campaign(HEADER + "\n2,4,HH,70\n20,4,HH,71\n2,5,HH,72\n1,16,HH,73\n")
    assert report.outside_region == (3, 4, 5)
    assert "): 3." in report.messages[0]
    assert len(store.runs("scored")) == 4


def test_no_place_on_the_scale(campaign, store):
    before = snapshot(store)
    with pytest.raises(ScoresFileError) as caught:
        campaign(HEADER + "\n2,4,HH,70\n0,4,HH,71\n-1,4,HH,71\n")
    assert [problem.line for problem in caught.value.problems] == [3, 4]
    assert snapshot(store) == before


def test_same_content_again(campaign, store):
    text = HEADER + "\n2,4,HH,70\n"
    campaign(text)
    before = snapshot(store)
    report = campaign(text, name="copy.csv")
    assert report.already is not None
    assert "before, as 'scores.csv'" in report.messages[0]
    assert snapshot(store) == before
    assert report.already.name == "scores.csv"


def test_a_file_that_has_grown(campaign, store):
    store.add_batch([NewRun({"frequency": 2.0, "looks": 4.0, "polarization": "HH"})] * 2)
    text = "run_id," + HEADER + "\n1,2,4,HH,70\n"
    campaign(text)
    report = campaign(text + "2,2,4,HH,71\n")
    assert (report.matched, report.unchanged) == ((2,), (1,))
    assert len(store.runs()[0].scores) == 1


def test_doubles_without_run_id_are_remarked(campaign):
    campaign(HEADER + "\n2,4,HH,70\n")
    report = campaign(HEADER + "\n2,4,HH,70\n2,4,HH,71\n")
    assert "1 score without a run id not counted twice" in report.messages[0]


@pytest.mark.parametrize("state", ["new", "grown"])
def test_dry_run_reports_the_same_and_writes_nothing(campaign, store, state):
    store.add_batch([NewRun({"frequency": 2.0, "looks": 4.0, "polarization": "HH"})])
    if state == "grown":
        campaign(HEADER + "\n3,4,HH,70\n")
    before = snapshot(store)
    text = "run_id," + HEADER + "\n1,2,4,HH,70\n,20,4,HH,71\n"
    dry = campaign(text, dry_run=True)
    assert snapshot(store) == before
    wet = campaign(text)
    assert dry.dry_run
    assert replace(dry, dry_run=False) == wet
    assert len(store.runs()) == len(before[0]) + 1


def test_a_row_without_run_id_may_be_of_a_flight_that_waits_and_of_no_simulation(campaign, store):
    settings = {"frequency": 2.0, "looks": 4.0, "polarization": "HH"}
    store.add_batch([NewRun(settings, source="simulation")])
    assert campaign(HEADER + "\n2,4,HH,70\n").created == (2,)
    store.add_batch([NewRun(settings, source="flight")])
    assert campaign(HEADER + ",source\n2,4,HH,71,simulation\n").created == (4,)
    with pytest.raises(ScoresFileError, match=r"waits for its score.*Give the run ids \(3\)"):
        campaign(HEADER + "\n2,4,HH,72\n")


def test_all_or_nothing(campaign, store):
    store.add_batch([NewRun({"frequency": 2.0, "looks": 4.0, "polarization": "HH"})] * 2)
    store.record_scores(1, [NewScore("crops", 50.0)])
    before = snapshot(store)
    with pytest.raises(StoreError) as caught:
        campaign("run_id," + HEADER + "\n2,2,4,HH,70\n1,2,4,HH,71\n99,2,4,HH,72\n,2,4,HH,73\n")
    first, second = caught.value.problems
    assert (first.line, first.field, "scored already" in first.message) == (3, "score", True)
    assert (second.line, second.field, second.value) == (4, "run_id", 99)
    assert "seqrsm void" in first.remedy
    assert snapshot(store) == before


def test_other_settings_for_a_scored_run(campaign):
    campaign(HEADER + "\n2,4,HH,70\n")
    with pytest.raises(StoreError, match="other settings"):
        campaign("run_id," + HEADER + "\n1,2,4,VV,70\n")


def test_other_settings_for_a_simulated_run(campaign, store):
    """Its row has another setting than it was simulated at: no run was as the row says."""
    store.add_batch([NewRun({"frequency": 2.0, "looks": 4.0, "polarization": "HH"}, source="simulation")])
    store.record_scores(1, [NewScore("crops", 70.0)])
    before = snapshot(store)
    with pytest.raises(StoreError, match=r"run 1 was made at other settings: frequency 2, looks 4, polarization HH\. "):
        campaign("run_id," + HEADER + "\n1,2,4,VV,70\n")
    assert snapshot(store) == before


def test_a_void_run_is_replaced_and_kept(campaign, store):
    store.add_batch([NewRun({"frequency": 2.0, "looks": 4.0, "polarization": "HH"}, "repeat", block="b")])
    store.record_scores(1, [NewScore("crops", 50.0)])
    store.void(1, "wrong field")
    report = campaign("run_id," + HEADER + "\n1,2.5,4,HH,70\n")
    assert (report.created, report.replaced, report.matched) == ((2,), ((1, 2),), ())
    old, new = store.runs()
    assert (old.state, old.scores[0].score) == ("void", 50.0)
    assert (new.replaces, new.purpose, new.block, new.scores[0].score) == (1, "repeat", "b", 70.0)
    assert (new.proposed["frequency"], new.executed["frequency"]) == (2.0, 2.5)


SECOND = '[[application]]\nname = "ice"\nutility = "measured"'


def test_several_applications_of_one_run(campaign, store):
    text = HEADER + ",application\n2,4,HH,70,crops\n2,4,HH,-5,ice\n2,4,HH,71,crops\n3,4,HH,-6,ice\n"
    report = campaign(text, SECOND)
    assert report.created == (1, 2, 3)
    assert [[s.application for s in run.scores] for run in store.runs()] == [["crops", "ice"], ["crops"], ["ice"]]


def test_scores_of_one_application_after_those_of_another_are_of_the_same_flights(campaign, store):
    rows = "2,4,HH,70,crops\n3,4,HH,60,crops\n2,4,HH,71,crops\n2,4,HH,-5,ice\n2,4,HH,-6,ice\n3,4,HH,-7,ice\n"
    text = HEADER + ",application\n" + rows
    assert campaign(text, SECOND).created == (1, 2, 3)
    found = [{score.application: score.score for score in run.scores} for run in store.runs()]
    assert found == [{"crops": 70, "ice": -6}, {"crops": 60, "ice": -7}, {"crops": 71, "ice": -5}]
    assert sum(run.cost for run in store.runs()) == 3 * 250
    assert campaign(text + "4,4,VV,50,crops\n4,4,VV,-8,ice\n", SECOND, "more.csv").created == (4,)


def test_a_second_score_told_before_as_that_of_another_run_is_not_doubled(campaign, store):
    campaign(HEADER + ",application\n2,4,HH,70,crops\n", SECOND)
    campaign(HEADER + ",application\n2,4,HH,-5,ice\n", SECOND, "ice.csv")
    both = campaign(HEADER + ",application\n2,4,HH,70,crops\n2,4,HH,-5,ice\n", SECOND, "both.csv")
    assert (both.created, both.matched) == ((), ())
    assert [[score.score for score in run.scores] for run in store.runs()] == [[70], [-5]]


def test_second_application_later(campaign, store):
    store.add_batch([NewRun({"frequency": 2.0, "looks": 4.0, "polarization": "HH"})])
    campaign("run_id," + HEADER + ",application\n1,2,4,HH,70,crops\n", SECOND)
    campaign("run_id," + HEADER + ",application\n1,2,4,HH,-5,ice\n", SECOND)
    assert [score.score for score in store.runs()[0].scores] == [70.0, -5.0]


def test_one_run_with_two_settings_in_a_file(campaign, store):
    store.add_batch([NewRun({"frequency": 2.0, "looks": 4.0, "polarization": "HH"})])
    text = "run_id," + HEADER + ",application\n1,2,4,HH,70,crops\n1,3,4,HH,-5,ice\n"
    with pytest.raises(ScoresFileError, match="other settings, block or source in line 2"):
        campaign(text, SECOND)


@pytest.mark.parametrize("column", ["block", "date", "day"])
def test_block_column(campaign, store, column):
    text, more = f"{HEADER},{column}\n2,4,HH,70,May 1\n2,4,HH,70,\n", f'[model]\nblock = "{column}"'
    with pytest.raises(ScoresFileError, match=f"scores.csv:3: {column}: no block"):
        campaign(text, more)
    campaign(text, more, accept=True)
    assert [run.block for run in store.runs()] == ["May 1", ""]


def test_simulated_scores_of_another_program(campaign, store):
    campaign(HEADER + ",source\n2,4,HH,70,simulation\n")
    assert (store.runs()[0].source, store.runs()[0].cost) == ("simulation", 2.0)


def test_flevoland(store):
    """The real scores: 224 rows, as counted by `wc -l`, none outside the region."""
    folder = Path(__file__).parents[2] / "campaigns" / "flevoland"
    spec = load_spec(folder)
    report = ingest_files(store, spec, [folder / "flight_scores.csv"])[0]
    assert (report.n_scores, len(report.created), report.outside_region) == (224, 224, ())
    lines = (folder / "flight_scores.csv").read_text().splitlines()[1:]
    for run, line in zip(store.runs(), lines, strict=True):
        polarization, looks, resolution, score, n = line.split(",")
        assert run.settings == {"polarization": polarization, "looks": float(looks), "resolution": float(resolution)}
        assert run.scores[0].score == float(score)
        assert (run.scores[0].n, run.scores[0].metadata) == (None, {"n_test_pixels": n})
