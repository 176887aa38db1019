"""Files as users' spreadsheets and text editors make them, through the command line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from seqrsm.cli.app import app
from seqrsm.spec.read import load_spec
from seqrsm.store.store import Store

SPEC = """\
[campaign]
name = "real"
seed = 4
[[factor]]
name = "frequency"
unit = "GHz"
low = 1.0
high = 12.0
scale = "log"
[[factor]]
name = "resolution"
unit = "m"
low = 5.0
high = 60.0
[[factor]]
name = "polarization"
levels = ["HH", "VV"]
[[application]]
name = "crops"
utility = "percent_correct"
{more}
[stop]
half_width = 3
"""
HEADER = "frequency,resolution,polarization,score"


class Folder:
    """A campaign that is driven by its command line."""

    def __init__(self, path: Path, spec: str) -> None:
        self.path = path
        (path / "campaign.toml").write_text(spec, encoding="utf-8")

    def call(self, command: str, *arguments: object, code: int = 0) -> str:
        result = CliRunner().invoke(app, [command, str(self.path), *(str(a) for a in arguments)])
        assert result.exit_code == code, result.output
        assert "Traceback" not in result.output
        return result.output

    def write(self, content: str | bytes, name: str = "scores.csv") -> Path:
        path = self.path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    def ingest(self, content: str | bytes, *options: str, name: str = "scores.csv", code: int = 0) -> str:
        return self.call("ingest", self.write(content, name), *options, code=code)

    def document(self) -> dict[str, Any]:
        file = self.path / "all.json"
        file.unlink(missing_ok=True)
        self.call("export", file)
        found: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
        return found

    def runs(self) -> list[dict[str, Any]]:
        return list(self.document()["runs"])


@pytest.fixture
def make(tmp_path):
    def made(more: str = "") -> Folder:
        return Folder(tmp_path, SPEC.format(more=more))

    return made


EXCEL = (
    "frequency [MHz];resolution (m);polarization;score;day;operator\r\n"
    '1500,5;12,5;HH;73,25;Tag 1;"Müller; ""Mops"""\r\n'
    "3000;20;VV;80;Tag 2;\r\n;;;;;\r\n"
)


@pytest.mark.parametrize(
    "content", [EXCEL.encode("utf-8-sig"), ("sep=;\r\n" + EXCEL).encode(), ("# May flights\n\n" + EXCEL).encode()]
)
def test_a_german_spreadsheet(make, content):
    folder = make('[model]\nblock = "day"')
    folder.ingest(content)
    first, second = folder.runs()
    assert first["executed"]["frequency"] == pytest.approx(1.5005, rel=1e-12)
    assert (first["executed"]["resolution"], first["executed"]["polarization"]) == (12.5, "HH")
    assert (first["block"], second["block"]) == ("Tag 1", "Tag 2")
    assert first["scores"][0]["score"] == 73.25
    assert first["scores"][0]["metadata"]["operator"] == 'Müller; "Mops"'


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (EXCEL.encode("latin-1"), "Latin-1"),
        (EXCEL.encode("utf-16"), "UTF-16"),
        (b"PK\x03\x04 xlsx", "spreadsheet"),
        (f"{HEADER}\n01. Mai,12,HH,70\n", "turned a number into a date"),
        (f"{HEADER}\n1.5,5-Jan,HH,70\n", "turned a number into a date"),
        (f"{HEADER}\n1.5,MRZ 05,HH,70\n", "turned a number into a date"),
        (f"{HEADER}\n10 GHz,12,HH,70\n", "Give a finite number without unit"),
        (f"{HEADER}\n1.5,12,HH,about 70\n", "Give a finite number"),
        (f"{HEADER}\n1.5,12,HH,#DIV/0!\n", "not a number"),
        ("frequency_MHz,resolution,polarization,score\n1500,12,HH,70\n", "to 'frequency [MHz]'"),
        ("frequency [furlong],resolution,polarization,score\n1500,12,HH,70\n", "cannot be converted"),
        (f"run_id,{HEADER}\n77,1.5,12,HH,70\n", "no such run"),
        ("", "empty"),
    ],
)
def test_refused_with_the_place_and_the_remedy(make, content, says):
    folder = make()
    assert says in folder.ingest(content, code=2)
    assert folder.runs() == []


def test_a_word_with_points_has_no_decimal_sign(make):
    told = make().ingest("frequency;resolution;polarization;score\n1,5;12;HH;70,5\n1,6;12;HH;k. A.\n", code=2)
    assert "(got 'k. A.'). Leave the cell empty if there is no value." in told
    assert "decimal sign" not in told


@pytest.mark.parametrize("model", ['weights = "counts"', 'response = "logit"\nerrors = "beta_binomial"'])
def test_where_scores_count_by_decisions_the_form_asks_for_them_and_none_goes_without(make, model):
    """One score without counts would keep the campaign from every fit until it is void."""
    folder = make(f"[model]\n{model}")
    folder.call("propose", "--source", "flight", "--csv", folder.path / "form.csv")
    header, *rows = (folder.path / "form.csv").read_text(encoding="utf-8").splitlines()
    assert header.split(",")[-5:] == ["block", "score", "n", "correct", "note"]
    told = folder.ingest(f"{HEADER}\n1.5,12,HH,70\n1.7,12,HH,70\n", code=2)
    assert "scores.csv:2: n: no counts, which [model] needs (so 1 more row: line 3). Give n and correct." in told
    filled = [",".join([*row.split(",")[:5], "", "80", str(50 + k), "x"]) for k, row in enumerate(rows)]
    folder.ingest("\n".join([header, *filled]), name="filled.csv")
    assert [run["scores"][0]["n"] for run in folder.runs()] == [80] * len(rows)


def test_columns_of_the_users_own_keep_their_unit(make):
    folder = make()
    folder.ingest(f"{HEADER},altitude [ft],camera (left)\n1.5,12,HH,70,9000,A\n")
    (run,) = folder.runs()
    assert run["scores"][0]["metadata"] == {"altitude [ft]": "9000", "camera (left)": "A"}


def test_dates_stay_as_written(make):
    folder = make('[model]\nblock = "date"')
    folder.ingest(f"{HEADER},date\n1.5,12,HH,70,12.05.1979\n1.5,12,HH,71,05/12/1979\n1.5,12,HH,72,28987\n", "--accept")
    assert [run["block"] for run in folder.runs()] == ["12.05.1979", "05/12/1979", "28987"]


@pytest.mark.parametrize("dialect", ["same bytes", "CRLF", "semicolons", "sorted", "fewer columns", "more columns"])
def test_a_file_twice_never_doubles_a_score(make, dialect):
    folder = make()
    text = f"{HEADER},date\n1.5,12,HH,70,1979-05-12\n1.5,12,HH,70,1979-05-12\n9,20,VV,55.5,1979-05-13\n"
    folder.ingest(text, "--accept")
    lines = text.splitlines()
    again = {
        "same bytes": text,
        "CRLF": text.replace("\n", "\r\n"),
        "semicolons": text.replace(",", ";").replace("1.5", "1,5").replace("55.5", "55,5"),
        "sorted": "\n".join([lines[0], *sorted(lines[1:], reverse=True)]),
        "fewer columns": "\n".join(line.rsplit(",", 1)[0] for line in lines),
        "more columns": "\n".join([lines[0] + ",pilot", *(line + ",Ann" for line in lines[1:])]),
    }[dialect]
    says = folder.ingest(again, name="again.csv")
    assert "ingested before" in says or "not counted twice" in says
    assert len(folder.runs()) == 3  # two of them a real repeat, told by standing in one file
    says = folder.ingest(again + "\n1.5,12,HH,70,1979-06-01\n", name="grown.csv") if dialect == "CRLF" else ""
    assert len(folder.runs()) == (4 if dialect == "CRLF" else 3)  # another date: another flight


@pytest.mark.parametrize(
    ("first", "then"),
    [
        (
            "n,correct\n1.5,12,HH,223,158\n1.5,12,HH,40,20\n",
            "n,correct,score\n1.5,12,HH,223,158,70.85\n1.5,12,HH,40,20,50\n",
        ),
        ("score\n1.5,12,HH,70\n1.5,12,HH,70\n", "score,se\n1.5,12,HH,70,2\n1.5,12,HH,70,3\n"),
        ("score,se\n1.5,12,HH,70,2\n1.5,12,HH,70,3\n", "score\n1.5,12,HH,70\n1.5,12,HH,70\n"),
        ("score\n1.5,12,HH,70.85\n2,12,HH,50\n", "score,n,correct\n1.5,12,HH,70.85,223,158\n2,12,HH,50,40,20\n"),
    ],
)
def test_a_file_with_one_more_column_of_numbers_doubles_no_score(make, first, then):
    folder = make()
    start = HEADER.removesuffix("score")
    folder.ingest(start + first, "--accept")
    told = folder.ingest(start + then, "--accept", name="again.csv")
    assert "2 scores without a run id not counted twice" in told
    assert len(folder.runs()) == 2
    other = (
        then.replace("223,158", "223,157")
        .replace("70,2", "71,2")
        .replace("HH,70\n", "HH,71\n")
        .replace("70.85", "70.4")
    )
    folder.ingest(start + other, "--accept", name="other.csv")
    assert len(folder.runs()) > 2  # another score is another run


def test_a_void_row_stays_out_when_its_file_comes_again(make):
    folder = make()
    folder.ingest(f"{HEADER}\n1.5,12,HH,70\n")
    folder.call("void", 1, "--why", "clouds")
    assert "equals run 1, which is void" in folder.ingest(f"{HEADER}\n1.5,12,HH,70\n2,12,HH,71\n", name="grown.csv")
    assert [run["state"] for run in folder.runs()] == ["void", "scored"]


def test_the_form_comes_back_with_other_settings_and_its_block(make):
    folder = make('[model]\nblock = "day"')
    folder.call("propose", "--source", "flight", "--csv", folder.path / "form.csv")
    rows = (folder.path / "form.csv").read_text(encoding="utf-8").splitlines()
    assert rows[0] == "run_id,frequency [GHz],resolution [m],polarization,day,score,se,note"
    cells = rows[1].split(",")
    filled = [cells[0], "1.7", cells[2], cells[3], "Monday", "66", "2.5", "windy"]
    says = folder.ingest("\n".join([rows[0], ",".join(filled)]), name="filled.csv")
    assert "made at other settings (1)" in says
    run = folder.runs()[0]
    assert (run["executed"]["frequency"], run["block"], run["scores"][0]["se"]) == (1.7, "Monday", 2.5)
    assert run["proposed"]["frequency"] != 1.7


def test_outside_the_region_is_flagged_for_good(make):
    folder = make()
    assert "outside the campaign's region (line 3)" in folder.ingest(f"{HEADER}\n1.5,12,HH,70\n35,12,HH,71\n")
    assert [run["scores"][0]["metadata"].get("outside_region") for run in folder.runs()] == [None, True]


def test_several_files_are_all_taken_in_or_none(make):
    folder = make()
    good = folder.write(f"{HEADER}\n1.5,12,HH,70\n", "good.csv")
    same = folder.write(f"{HEADER}\n1.5,12,HH,70\n", "same.csv")
    more = folder.write(f"{HEADER}\n1.6,12,HH,70\n", "more.csv")
    bad = folder.write(f"{HEADER}\n1.5,12,XX,70\n", "bad.csv")
    assert "bad.csv:2" in folder.call("ingest", good, bad, code=2)
    assert folder.runs() == []
    dry = json.loads(folder.call("ingest", good, same, more, "--dry-run", "--json"))
    assert folder.runs() == []
    wet = json.loads(folder.call("ingest", good, same, more, "--json"))
    for report in (*dry, *wet):
        report.pop("dry_run")
        if report["already"]:
            report["already"].pop("ingested_at")
            report.pop("messages")
    assert dry == wet
    assert [report["created"] for report in wet] == [[1], [], [2]]


def test_export_comes_back_without_doubles_and_without_formulas(make):
    folder = make()
    folder.ingest(f"{HEADER},note,who\n1.5,12,HH,70,=1+2,@me\n1.5,12,VV,60,-x,+y\n")
    folder.call("export", folder.path / "all.csv")
    text = (folder.path / "all.csv").read_text(encoding="utf-8")
    assert "'=1" not in text.split("\n", maxsplit=1)[0]
    before = folder.runs()
    folder.call("ingest", folder.path / "all.csv")
    assert [(r["run_id"], r["scores"]) for r in folder.runs()] == [(r["run_id"], r["scores"]) for r in before]


def test_fractions_are_held_back(make):
    folder, text = make(), f"{HEADER}\n1.5,12,HH,0.7\n1.5,12,VV,0.6\n"
    told = folder.ingest(text, code=2)
    assert "scores.csv:2: score: no score is above 1 percent (so 1 more row: line 3) (got 0.7). Are they fract" in told
    assert folder.runs() == []
    assert "2 new runs" in folder.ingest(text, "--accept")


def test_a_percent_sign_is_told_where_it_may_stand(make):
    folder = make()
    told = folder.ingest(f"{HEADER}\n1.5,12,HH,70.48 %\n", code=2)
    assert "score: this is not a number (got '70.48 %'). Remove the percent sign; the header may be: score [%]." in told
    folder.ingest(f"{HEADER} [%]\n1.5,12,HH,70.48\n")


def test_one_of_a_kind_is_told_in_the_singular(make):
    folder = make()
    folder.call("propose", "-n", "12", "--source", "flight")
    assert "1 proposed run was made at other settings (1)" in folder.ingest(f"run_id,{HEADER}\n1,1.7,12,HH,70\n")
    folder.ingest(f"{HEADER}\n1.5,12,HH,70\n", name="b.csv")
    told = folder.ingest(f"{HEADER},note\n1.5,12,HH,70,\n", name="c.csv")
    assert (
        "1 score without a run id not counted twice, equal to earlier scores in every column that both have (line 2)"
        in told
    )


# -- rankings ---------------------------------------------------------------------------------------------------------


@pytest.fixture
def ranked(tmp_path):
    """A campaign with six runs issued, whose images are to be ranked."""
    first = '[[application]]\nname = "crops"\nutility = "percent_correct"'
    folder = Folder(tmp_path, SPEC.format(more="").replace(first, '[[application]]\nname = "clear"\nutility = "rank"'))
    assert "ranked along" not in folder.call("propose", "--source", "flight")  # there are no earlier ones
    return folder


def ranking_file(**orders: str) -> str:
    rows = [
        f"{run_id},{interpreter},{rank}"
        for interpreter, order in orders.items()
        for rank, run_ids in enumerate(order.split(), start=1)
        for run_id in run_ids.split("=")
    ]
    return "run_id,interpreter,rank\n" + "\n".join(rows) + "\n"


def test_rankings_give_scores_with_errors(ranked):
    says = ranked.ingest(ranking_file(ann="1 2 3 4 5 6", bob="1 3 2 4 6 5", cy="6 5 4 3 2 1"), "--json")
    (report,) = json.loads(says)
    assert (report["matched"], report["rankings"]) == ([1, 2, 3, 4, 5, 6], [1, 2, 3])
    assert load_spec(ranked.path).applications[0].score_unit == "logit"  # no interval of a report is without its unit
    effects = {one["interpreter"]: one for one in report["ranked"][0]["interpreters"]}
    assert effects["cy"]["agreement"] < 0 < effects["ann"]["agreement"]
    runs = [run for run in ranked.runs() if run["state"] == "scored"]
    scores = [run["scores"][0] for run in runs]
    assert sum(score["score"] for score in scores) == pytest.approx(0.0, abs=1e-9)
    assert scores[0]["score"] > scores[3]["score"]
    assert all(score["se"] > 0.1 for score in scores)
    assert scores[0]["metadata"]["derived"] == "Plackett-Luce"


def test_new_rankings_change_all_scores_and_void_takes_them_back(ranked):
    first = ranking_file(ann="1 2 3 4", bob="1 2=3 4")
    ranked.ingest(first)
    before = [run["scores"] for run in ranked.runs()]
    ranked.ingest(ranking_file(cy="4 5 1"), name="more.csv")
    after = ranked.document()
    changed = [run["scores"] for run in after["runs"]]
    assert changed[0][0]["score"] != before[0][0]["score"]
    assert changed[4]
    assert not before[4]
    assert len(after["rankings"]) == 11  # the rows as handed in
    assert [event["kind"] for event in after["events"]].count("rankings scored") == 2
    ranked.call("void", "--ranking", 3, "--why", "looked at the wrong screen")
    restored = ranked.document()
    assert [[s["score"] for s in run["scores"]] for run in restored["runs"]] == [
        [s["score"] for s in x] for x in before
    ]
    assert restored["runs"][4]["state"] == "issued"
    assert {rank["reason"] for rank in restored["rankings"]} == {"", "looked at the wrong screen"}
    assert "already void" in ranked.call("void", "--ranking", 3, "--why", "again", code=2)


def test_zero_stays_where_it_was_when_better_images_are_ranked(ranked):
    """That of the initial design: the mean of all would rise towards the optimum, and the optimum's score fall."""
    start = [run["run_id"] for run in ranked.runs()]
    order = " ".join(map(str, start))
    ranked.ingest(ranking_file(ann=order, bob=order))
    assert "ranked along with some earlier ones" in ranked.call("propose", "-n", "2")
    better = [run["run_id"] for run in ranked.runs()[len(start) :]]
    told = ranked.ingest(ranking_file(cy=" ".join(map(str, [*better, *start]))), name="more.csv")
    assert "Zero is the mean of the first batch." in told
    scores = {run["run_id"]: run["scores"][0]["score"] for run in ranked.runs()}
    assert sum(scores[run_id] for run_id in start) == pytest.approx(0.0, abs=1e-9)
    assert all(scores[run_id] > scores[start[0]] for run_id in better)


def test_the_same_rankings_again_do_not_count_twice(ranked):
    ranked.ingest(ranking_file(ann="1 2 3", bob="2 1 3"))
    before = ranked.document()["rankings"]
    ranked.ingest(ranking_file(bob="2 1 3", ann="1 2 3"), name="again.csv")
    assert ranked.document()["rankings"] == before


def test_rankings_known_already_are_nothing_new(ranked):
    assert "3 proposed runs ranked" in ranked.ingest(ranking_file(ann="1 2 3", bob="2 1 3"))
    assert ranked.ingest(ranking_file(bob="2 1 3"), name="again.csv").strip() == "again.csv: nothing new"


@pytest.mark.parametrize("again", ["2 1 3 4", "1 2 3", "1 2 3 4 5", "1=2 3 4"])
def test_a_ranking_corrected_or_extended_is_held_back(ranked, again):
    """It would count beside the earlier one, as a second opinion of the same interpreter."""
    ranked.ingest(ranking_file(ann="1 2 3 4", bob="1 2 3 5"))
    told = ranked.ingest(ranking_file(ann=again), name="again.csv", code=2)
    assert "again.csv:2: interpreter: ann has ranked these images before, in ranking 1 (got 'ann')" in told
    assert "void DIR --ranking 1" in told
    ranked.ingest(ranking_file(ann="4 5 6"), name="others.csv")  # other images with some of the same
    ranked.call("void", "--ranking", 1, "--why", "a slip")
    ranked.ingest(ranking_file(ann=again), name="again.csv")
    header, *rows = ranking_file(ann="4 3 2 1").split()
    ranked.ingest("\n".join([f"{header},session", *(f"{row},2" for row in rows)]), name="session.csv")
    ranked.ingest(ranking_file(bob="3 2 1"), "--accept", name="accepted.csv")
    assert max(rank["ranking"] for rank in ranked.document()["rankings"]) == 6


def test_no_ranking_takes_scores_away_unasked(ranked):
    """Images that are ranked among themselves say nothing of earlier ones, which fewer runs would then be."""
    ranked.ingest(ranking_file(ann="1 2"))
    apart = ranking_file(bob="3 4 5")
    told = ranked.ingest(apart, name="apart.csv", code=2)
    assert "runs 1, 2 would lose their scores of 'clear': no chain of rankings joins them with the others" in told
    assert [run["state"] for run in ranked.runs()[:3]] == ["scored", "scored", "issued"]
    (ranked.path / "bridge.csv").write_text(ranking_file(cy="2 3"), encoding="utf-8")
    ranked.ingest(apart, ranked.path / "bridge.csv", name="apart.csv")
    assert [run["state"] for run in ranked.runs()[:6]] == ["scored"] * 5 + ["issued"]


def test_runs_that_no_ranking_joins_wait_for_one_that_does(ranked):
    assert "1 ranking of 'clear' by 1 interpreter gives 3 runs their" in ranked.ingest(ranking_file(ann="1 2 3"))
    says = ranked.ingest(ranking_file(ann="4 5"), name="apart.csv")
    assert "No chain of rankings joins runs 4, 5" in says
    assert [run["state"] for run in ranked.runs()[:6]] == ["scored"] * 3 + ["issued"] * 3
    ranked.ingest(ranking_file(bob="4 1"), name="bridge.csv")
    assert [run["state"] for run in ranked.runs()[:6]] == ["scored"] * 5 + ["issued"]


def test_rankings_the_wrong_way_round_are_named(ranked):
    assert "against" not in ranked.ingest(ranking_file(ann="1 2 3 4 5 6", bob="1 2 4 3 5 6"))
    says = " ".join(ranked.ingest(ranking_file(cy="6 5 4 3 2 1"), name="cy.csv").split())
    assert "Ranked against the scores by cy: is 1 the rank of the best image?" in says


def test_rankings_that_are_all_void_say_nothing(ranked):
    ranked.ingest(ranking_file(ann="1 2 3"))
    ranked.call("void", "--ranking", 1, "--why", "a slip")
    with Store.open(ranked.path, seed=4) as store:
        assert store.ranking_summaries() == ()


def test_a_void_run_leaves_the_scores(ranked):
    ranked.ingest(ranking_file(ann="1 2 3", bob="2 1 3"))
    ranked.call("void", 3, "--why", "wrong field")
    scores = [run["scores"][0]["score"] for run in ranked.runs() if run["state"] == "scored"]
    assert scores == pytest.approx([0.0, 0.0], abs=1e-9)  # each was preferred once


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("run_id,interpreter,rank\n1,ann,1\n99,ann,2\n", "no such run"),
        ("run_id,interpreter,rank\n1,ann,1\n1,ann,2\n", "already"),
        ("run_id,interpreter,rank\n1,ann,1\n", "has one image"),
        ("run_id,interpreter,rank\n1,ann,first\n2,ann,2\n", "not a number"),
        ("run_id,interpreter,rank\n1,,1\n2,,2\n", "Name the interpreter"),
        ("run_id,interpreter,rank\n1,ann,0\n2,ann,1\n", "best image has rank 1"),
        ("interpreter,rank\nann,1\nbob,2\n", "run_id"),
        (
            "run_id,interpreter,rank,frequency\n1,ann,1,2\n2,ann,2,2\n",
            "resolution: no column for this factor. Give the",
        ),
        ("run_id,ann,bob\n1,1,2\n2,2,1\n", "rank: there is no such column. A ranking has run_id, interpreter and rank"),
    ],
)
def test_bad_rankings(ranked, content, says):
    assert says in ranked.ingest(content, code=2)
    assert ranked.document()["rankings"] == []


def test_a_bad_rank_is_told_once_and_as_it_was_written(ranked):
    told = ranked.ingest("run_id,interpreter,rank\n1,ann,0\n2,ann,1\n", code=2)
    assert told.strip() == "error: scores.csv:2: rank: a rank is 1 or more (got '0'). The best image has rank 1."


def test_a_score_by_hand_is_no_ranking(ranked):
    """Nobody knows its scale: scores of rankings are in logits."""
    told = ranked.ingest(f"run_id,{HEADER}\n1,1.5,12,HH,2\n", code=2)
    assert "scores.csv:2: score: the scores of 'clear' come from rankings" in told


def test_the_columns_of_a_ranking_are_told_their_names(ranked):
    told = ranked.ingest("Run_ID,Interpreter,Rank\n1,ann,1\n2,ann,2\n", code=2)
    assert "interpreter: there is no such column. Rename the column 'Interpreter' to 'interpreter'." in told
    assert "score" not in told.replace("scores.csv", "")


def test_rankings_and_scores_do_not_mix(ranked, make):
    ranked.ingest(ranking_file(ann="1 2 3"))
    assert "come from rankings" in ranked.ingest(f"{HEADER}\n1.5,12,HH,2\n", name="scores2.csv", code=2)
    measured = make()
    assert "no application" in measured.ingest(ranking_file(ann="1 2 3"), name="r.csv", code=2)


def test_settings_flown_stand_in_the_rankings(ranked):
    text = f"run_id,interpreter,rank,{HEADER[: -len(',score')]}\n1,ann,1,1.7,12,HH\n2,ann,2,30,13,VV\n"
    assert "outside the campaign's region (line 3)" in ranked.ingest(text)
    assert ranked.runs()[0]["executed"] == {"frequency": 1.7, "resolution": 12.0, "polarization": "HH"}


def test_status_is_remembered_until_anything_changes(make, monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    folder = make()
    rows = [f"{1 + k % 7},{10 + 5 * (k % 5)},{('HH', 'VV')[k % 2]},{50 + (7 * k) % 11 + k % 7}" for k in range(40)]
    folder.ingest(HEADER + "\n" + "\n".join(rows) + "\n")
    first = json.loads(folder.call("status", "--json"))
    with monkeypatch.context() as patch:
        patch.setattr("seqrsm.analysis.conclude.analyse", lambda *_: None)  # takes no options: raises where called
        assert json.loads(folder.call("status", "--json")) == first
    folder.call("void", 5, "--why", "clouds")
    second = json.loads(folder.call("status", "--json"))
    assert second["applications"][0]["last_look"]["n_runs"] == first["applications"][0]["last_look"]["n_runs"] - 1


def test_a_block_that_is_another_but_for_case_or_blanks_is_held_back(tmp_path):
    """Each would be a day of its own, with an effect of its own."""
    folder = Folder(tmp_path, SPEC.format(more='[model]\nblock = "day"'))
    rows = "2,10,HH,Day 1,61\n3,20,VV,day 2,62\n"
    folder.call("ingest", folder.write(f"frequency,resolution,polarization,day,score\n{rows}"))
    again = folder.write("frequency,resolution,polarization,day,score\n4,10,HH,day1,63\n5,20,VV,Day 2,64\n", "more.csv")
    told = folder.call("ingest", again, code=2)
    assert "more.csv:2: day: the block 'Day 1' differs by case, blanks or notation alone (got 'day1')" in told
    assert "more.csv:3: day: the block 'day 2'" in told
    assert "2 new runs" in folder.call("ingest", again, "--accept")


def test_a_corrected_score_does_not_count_beside_the_wrong_one(make):
    """An agency delivers its table again with one score corrected: the rest is known, and that row is no repeat."""
    folder = make()
    head = f"{HEADER},date\n"
    first, second = "1.5,12,HH,70,3 June\n", "1.5,12,HH,71,3 June\n"
    folder.ingest(head + first + second)
    told = folder.ingest(head + first + "1.5,12,HH,75,3 June\n", name="corrected.csv", code=2)
    assert "corrected.csv:3: score: run 2 has score 71 and the rest is the same (got 75.0)" in told
    assert "seqrsm void DIR 2 --why TEXT" in told
    assert [run["scores"][0]["score"] for run in folder.runs()] == [70, 71]
    folder.call("void", 2, "--why", "corrected")
    again = folder.ingest(head + first + "1.5,12,HH,75,3 June\n", name="corrected.csv")
    assert "corrected.csv: 1 score ingested: 1 new run, 1 unchanged run" in again
    assert [run["scores"][0]["score"] for run in folder.runs() if run["state"] == "scored"] == [70, 75]
    folder.ingest(head + "1.5,12,HH,76,4 June\n", name="repeat.csv")


def test_a_run_that_is_told_again_without_its_error_is_unchanged(make):
    folder = make()
    folder.ingest(f"{HEADER},se\n1.5,12,HH,70,2\n")
    assert "0 scores ingested: 1 unchanged run" in folder.ingest(f"run_id,{HEADER}\n1,1.5,12,HH,70\n", name="again.csv")
    assert folder.runs()[0]["scores"][0]["se"] == 2
    told = folder.ingest(f"run_id,{HEADER}\n1,1.5,12,HH,71\n", name="other.csv", code=2)
    assert "run 1 is scored already for 'crops' (70) (got 71.0)" in told


def test_a_setting_just_outside_is_not_taken_for_feet(make):
    folder = make()
    assert "outside the campaign's region" in folder.ingest(f"{HEADER}\n1.5,65,HH,70\n")


def test_a_wrong_count_is_told_once(tmp_path):
    folder = Folder(tmp_path, SPEC.format(more=""))
    told = folder.call("ingest", folder.write("frequency,resolution,polarization,n,correct\n2,10,HH,0,0\n"), code=2)
    assert "n: a whole number of at least 1 is expected (got '0')" in told
    assert "score" not in told.replace("scores.csv", "")


@pytest.mark.parametrize("more", ["", '[[application]]\nname = "yield"\nutility = "measured"\n[stop]'])
def test_the_form_of_images_to_be_ranked_asks_for_no_score_of_them(tmp_path, more):
    first = '[[application]]\nname = "crops"\nutility = "percent_correct"'
    text = SPEC.format(more="").replace(first, '[[application]]\nname = "clear"\nutility = "rank"')
    folder = Folder(tmp_path, text.replace("[stop]", more or "[stop]"))
    folder.call("propose", "--source", "flight", "--csv", tmp_path / "form.csv")
    header, *rows = (tmp_path / "form.csv").read_text(encoding="utf-8-sig").splitlines()
    assert ("score" in header) == bool(more)
    assert len(rows) == len(folder.runs())
    assert all(",yield," in row for row in rows) == bool(more)


def form_rows(scores: dict[int, float], **other: str) -> str:
    """The form of the issued runs, with the scores so far: crews hand in the whole form every week."""
    rows = [f"run_id,{HEADER}{''.join(f',{name}' for name in other)}"]
    for run_id, score in scores.items():
        rows.append(f"{run_id},{1 + run_id},12,HH,{score}{''.join(f',{text}' for text in other.values())}")
    return "\n".join(rows) + "\n"


def test_many_runs_that_are_void_and_come_back_are_told_in_a_line_each(make):
    """A new factor makes all runs void and takes them in again: two lines for each run were told."""
    folder = make()
    folder.ingest(f"{HEADER}\n2,12,HH,70\n3,12,HH,71\n4,12,HH,72\n")
    assert folder.call("void", 1, 2, 3, "--why", "new factor") == "runs 1, 2, 3 are void: new factor\n"
    told = folder.ingest(form_rows({1: 70, 2: 71, 3: 72}), "--accept", name="again.csv")
    assert "Runs 4, 5, 6 take the places of runs 1, 2, 3, which are void." in told


def test_a_form_that_comes_again_after_a_correction_adds_no_run(make):
    """Run 4 took the place of run 2: from then on what the form says of run 2 is run 4's."""
    folder = make()
    folder.ingest(f"{HEADER}\n2,12,HH,70\n3,12,HH,71\n4,12,HH,72\n")
    folder.call("void", 2, "--why", "corrected")
    told = folder.ingest(form_rows({1: 70, 2: 75, 3: 72}), name="w2.csv")
    assert "1 new run, 2 unchanged runs" in told
    assert "Run 4 takes the place of run 2, which is void." in told
    told = folder.ingest(form_rows({1: 70, 2: 75, 3: 72}, crew="A"), name="w3.csv")
    assert "0 scores ingested: 3 unchanged runs" in told
    assert [run["state"] for run in folder.runs()] == ["scored", "void", "scored", "scored"]
    told = folder.ingest(form_rows({2: 76}), name="w4.csv", code=2)
    assert "run 4 is scored already for 'crops' (75)" in told


def test_a_second_application_of_a_flight_that_was_corrected(make):
    folder = make('[[application]]\nname = "ice"\nutility = "measured"\nhalf_width = 1.0')
    folder.ingest(f"{HEADER},application\n2,12,HH,70,crops\n3,12,HH,71,crops\n")
    folder.call("void", 2, "--why", "corrected")
    folder.ingest(form_rows({2: 75}, application="crops"), name="w2.csv")
    folder.ingest(form_rows({1: 5, 2: 6}, application="ice"), name="ice.csv")
    assert [len(run["scores"]) for run in folder.runs()] == [2, 1, 2]


def test_new_scores_are_counted_where_a_form_of_two_applications_comes_again(make):
    folder = make('[[application]]\nname = "ice"\nutility = "measured"\nhalf_width = 1.0')
    head = f"run_id,{HEADER.replace('score', 'application,score')}"
    rows = [f"{i},{1 + i},12,HH,{use},{score + i}" for i in (1, 2, 3) for use, score in (("crops", 70), ("ice", 0))]
    first = [line.partition(",")[2] for line in (head, *rows[:-1])]  # nobody proposed these runs
    assert "5 scores ingested: 3 new runs" in folder.ingest("\n".join(first) + "\n")
    told = folder.ingest("\n".join([head, *rows]) + "\n", name="again.csv")
    assert "again.csv: 1 score ingested: 1 proposed run scored, 2 unchanged runs" in told


def test_the_score_of_a_void_run_comes_back_only_on_demand(make):
    """The form of a day that was declared void still has its scores."""
    folder = make()
    folder.ingest(f"{HEADER}\n2,12,HH,70\n3,12,HH,71\n")
    folder.call("void", 1, 2, "--why", "icing")
    assert [run["state"] for run in folder.runs()] == ["void", "void"]
    told = folder.ingest(form_rows({1: 70, 2: 72}), name="w2.csv", code=2)
    assert "w2.csv:2: score: run 1 is void (icing) and had this score (got 70.0)" in told
    assert "w2.csv:3" not in told
    assert "2 new runs" in folder.ingest(form_rows({1: 70, 2: 72}), "--accept", name="w2.csv")


def test_a_run_voided_by_mistake_comes_back_with_the_very_file_it_came_from(make):
    folder = make()
    form = form_rows({1: 70, 2: 72})
    folder.ingest(f"{HEADER}\n2,12,HH,70\n3,12,HH,72\n")
    folder.ingest(form, name="form.csv")
    folder.call("void", 1, "--why", "a slip")
    told = folder.ingest(form, name="form.csv", code=2)
    assert "form.csv:2: score: run 1 is void (a slip) and had this score (got 70.0)" in told
    told = folder.ingest(form, "--accept", name="form.csv")
    assert "Run 3 takes the place of run 1, which is void." in told
    assert "nothing done" in folder.ingest(form, name="form.csv")
    assert [run["state"] for run in folder.runs()] == ["void", "scored", "scored"]
    assert folder.call("status", "--history").count("ingested:") == 3


def test_a_file_without_run_ids_is_known_again_while_a_run_of_another_file_is_void(make):
    """It brings nothing back: its rows were told as repeats that should differ in a date."""
    folder = make()
    first = f"{HEADER}\n2,12,HH,70\n3,12,HH,72\n"
    folder.ingest(first, name="a.csv")
    folder.ingest(f"{HEADER}\n4,12,HH,75\n", name="b.csv")
    folder.call("void", 3, "--why", "a slip")
    assert "The same content was ingested before, as 'a.csv'" in folder.ingest(first, name="a.csv")
    folder.call("void", 1, "--why", "a slip")
    assert "Line 2 equals run 1, which is void, and stays out; with run_id 1" in folder.ingest(first, name="a.csv")
    assert [run["state"] for run in folder.runs()] == ["void", "scored", "void"]


@pytest.mark.parametrize("day", ["03.02.2026", "3.2.26", "2/3/2026", "2026-02-03 00:00:00", "20260203"])
def test_a_day_in_another_notation_makes_no_repeat(make, day):
    """A spreadsheet that saves a file again writes its days as it likes."""
    folder = make()
    folder.ingest(f"{HEADER},date\n2,12,HH,70,2026-02-03\n3,12,HH,71,2026-02-03\n")
    again = f"{HEADER},date\n2,12,HH,70,{day}\n3,12,HH,72,{day}\n"
    told = folder.ingest(again, name="again.csv", code=2)
    assert (
        "again.csv:2: score: run 1 has this score, and the rest is the same but for notation or se (got 70.0)" in told
    )
    assert "again.csv:3: score: run 2 has score 71 and the rest is the same" in told
    assert "2 new runs" in folder.ingest(again.replace("2026", "2027").replace(".26", ".27"), name="next.csv")


@pytest.mark.parametrize(("day", "held"), [("2026-02-03", True), ("3.2.2026", True), ("02.03.2026", False)])
def test_a_block_in_another_notation_is_held_back(make, day, held):
    folder = make('[model]\nblock = "day"')
    folder.ingest(f"{HEADER},day\n2,12,HH,70,03.02.2026\n")
    told = folder.ingest(f"{HEADER},day\n3,12,HH,71,{day}\n", name="more.csv", code=2 * held)
    assert ("more.csv:2: day: the block '03.02.2026' differs by case, blanks or notation alone" in told) == held


@pytest.mark.parametrize(
    ("times", "held"),
    [
        (["2026-02-03T09:30", "2026-02-03T09:50", "2026-02-03T10:10"], True),
        (["3.2.2026 9:30:00", "3.2.2026 9:50:00", "3.2.2026 10:10:00"], True),
        (["2/3/26 9:30 AM", "2/3/26 1:50 PM", "2/3/26 2:10 PM"], True),
        (["2026-02-03T09:30+02:00", "2026-02-03T09:30+02:00", "2026-02-03T14:10+02:00"], False),  # two flights
        (["2026-02-03T09:30", "2026-02-04T09:50", "2026-02-05T10:10"], False),  # a run a day
    ],
)
def test_days_with_the_time_of_each_run_are_held_back(make, times, held):
    """Each run was a block of its own, and the fit of a small campaign failed."""
    folder = make('[model]\nblock = "day"')
    rows = "".join(f"{2 + k},12,HH,{70 + k},{time}\n" for k, time in enumerate(times))
    told = folder.ingest(f"{HEADER},day\n{rows}", code=2 * held)
    assert ("has a time of its own, and so a block of its own (so 2 more rows: lines 3, 4)" in told) == held


@pytest.mark.parametrize("word", ["NA", "nan", "#N/A", "#NV"])
def test_a_word_for_no_day_is_no_day(make, word):
    """R writes NA where a day is missing: all such flights were of one day of that name."""
    folder = make('[model]\nblock = "day"')
    told = folder.ingest(f"{HEADER},day\n2,12,HH,70,Monday\n3,12,HH,71,{word}\n", code=2)
    assert f"scores.csv:3: day: no block (got '{word}')" in told


@pytest.mark.parametrize(
    ("one", "other", "held"),
    [
        ("1", "1.0", True),  # a spreadsheet, or pandas where a cell is empty
        ("7", "07", True),
        ("day 07", "Day_7", True),
        ("1", "10", False),
        ("1", "1.05", False),
        ("15", "1.5", False),
        ("100", "10", False),
        ("202602030", "2026-02-030", False),
        ("20260203", "2026-02-03", True),
        ("a.0", "a.1", False),
    ],
)
def test_a_numbered_block_in_another_notation_is_held_back(make, one, other, held):
    folder = make('[model]\nblock = "day"')
    folder.ingest(f"{HEADER},day\n2,12,HH,70,{one}\n")
    told = folder.ingest(f"{HEADER},day\n3,12,HH,71,{other}\n", name="more.csv", code=2 * held)
    assert (f"more.csv:2: day: the block '{one}' differs by case, blanks or notation alone" in told) == held


def test_a_scored_run_on_another_day_is_held_back(make):
    """A form with its day corrected was taken for one seen before, and the run stayed where it was."""
    folder = make('[model]\nblock = "day"')
    form = "run_id,frequency,resolution,polarization,score,day\n1,2,12,HH,70,Monday\n2,3,12,HH,71,{}\n"
    folder.ingest(f"{HEADER},day\n2,12,HH,70,Monday\n3,12,HH,71,Monday\n")
    assert "2 unchanged runs" in folder.ingest(form.format("monday"), name="again.csv")
    told = folder.ingest(form.format("Tuesday"), name="corrected.csv", code=2)
    assert "corrected.csv:3: day: run 2 is of the block 'Monday' (got 'Tuesday')" in told
    assert "seqrsm void DIR 2 --why TEXT" in told
    folder.call("void", 2, "--why", "wrong day")
    folder.ingest(form.format("Tuesday"), "--accept", name="corrected.csv")
    assert [run["block"] for run in folder.runs()] == ["Monday", "Monday", "Tuesday"]


def test_an_empty_block_among_others_is_held_back(make):
    """Of merged cells only the first has the content."""
    folder = make('[model]\nblock = "day"')
    rows = f"{HEADER},day\n2,12,HH,70,Monday\n3,12,HH,71,\n4,12,HH,72,\n"
    told = folder.ingest(rows, code=2)
    assert "scores.csv:3: day: no block (so 1 more row: line 4)" in told
    assert "3 new runs" in folder.ingest(rows, "--accept")


def test_a_column_of_days_that_is_not_there_is_told(make):
    """It was told to fill in cells of a column that the file has not."""
    folder = make('[model]\nblock = "day"')
    told = folder.ingest(f"{HEADER},Flight day\n2,12,HH,70,Monday\n3,12,HH,71,Monday\n", code=2)
    assert "scores.csv:2: day: there is no such column (so 1 more row: line 3)" in told
    assert "Add it, or name a column of yours so: Flight day" in told
    assert "there is no such column. Add it.\n" in folder.ingest(f"{HEADER}\n2,12,HH,70\n", code=2)


@pytest.mark.parametrize("column", ["Status", "state", "note"])
def test_a_score_of_a_run_that_its_row_calls_void_is_held_back(make, column):
    rows = "2,12,HH,70,avoided clouds\n3,12,HH,61,Void: plane broken\n4,12,HH,,void\n5,12,HH,62,INVALID\n"
    told = make().ingest(f"{HEADER},{column}\n{rows}", code=2)
    assert f"scores.csv:3: {column}: the run is told to be void and has a score (so 1 more row: line 5)" in told
    assert "(got 'Void: plane broken')" in told
    assert "scores.csv:2" not in told
    assert "scores.csv:4" not in told


def test_run_ids_of_another_campaign_have_one_error(make):
    """An export had one for each of its 65 rows."""
    told = make().ingest(f"run_id,{HEADER}\n1,2,12,HH,70\n2,3,12,HH,71\n3,4,12,HH,72\n", code=2)
    assert told.count("there is no such run") == 1
    assert "scores.csv:2: run_id: there is no such run (so 2 more rows: lines 3, 4) (got 1)" in told
    assert "This campaign has no runs yet: remove the column run_id, and rows of void runs." in told


def test_flights_that_wait_are_not_flown_twice_for_want_of_their_run_ids(make):
    """A column "Run" was kept as one of the user's own: the flights were new runs, and the proposed ones waited on."""
    folder = make()
    folder.call("propose", "-n", 3, "--csv", folder.path / "form.csv")
    header, *rows = (folder.path / "form.csv").read_text(encoding="utf-8").splitlines()
    names = header.replace("run_id", "Run").split(",")
    score = names.index("score")
    flown = [row.split(",")[:score] + [str(60 + k)] + [""] * (len(names) - score - 1) for k, row in enumerate(rows)]
    text = "\n".join(",".join(row) for row in [names, *flown])
    told = folder.ingest(text, code=2)
    ids = [row.split(",")[0] for row in rows]
    assert f"scores.csv:2: run_id: settings of a flight that waits for its score (so {len(ids) - 1} more rows" in told
    assert f"Give the run ids ({', '.join(ids[:8])}" in told
    assert "proposed runs scored" in folder.ingest(text.replace("Run,", "run_id,", 1))


@pytest.mark.parametrize("unit", ["percent", "%"])
def test_fractions_are_no_percentages_of_a_measured_score_either(tmp_path, unit):
    spec = SPEC.format(more=f'unit = "{unit}"').replace("percent_correct", "measured")
    folder = Folder(tmp_path, spec)
    told = folder.ingest(f"{HEADER}\n2,12,HH,0.7\n3,12,HH,0.8\n", code=2)
    assert "scores.csv:2: score: no score is above 1 percent (so 1 more row: line 3)" in told
    folder.ingest(f"{HEADER}\n2,12,HH,-3\n3,12,HH,170\n")


@pytest.mark.parametrize("name", ["runid", "run id", "Run_ID", "RUN-ID"])
def test_a_form_without_settings_whose_run_ids_have_another_name_is_told_the_name(tmp_path: Path, name: str) -> None:
    """It was told to begin with a line of names of factors."""
    folder = Folder(tmp_path, SPEC.format(more=""))
    folder.call("propose", "--source", "flight", "--csv", tmp_path / "form.csv")
    told = " ".join(folder.call("ingest", folder.write(f"{name},score\n1,80\n"), code=2).split())
    assert f"scores.csv:1: run_id: no column tells the runs. Rename the column '{name}' to 'run_id'." in told
    assert "no header" not in told
    assert "No settings are given" in folder.call("ingest", folder.write("run_id,score\n1,80\n"))
