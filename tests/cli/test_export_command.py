"""What an export tells, and what it does not; the form of flights that are issued."""

from __future__ import annotations

import json
import re
import shutil
from html import unescape
from pathlib import Path

import pytest
from scipy.stats import kendalltau
from typer.testing import CliRunner

from seqrsm.campaign.campaign import Campaign
from seqrsm.campaign.dossier import _reproduce
from seqrsm.campaign.export import export
from seqrsm.cli.app import app
from seqrsm.spec.read import load_spec
from seqrsm.store.store import Store

pytestmark = pytest.mark.usefixtures("few_draws")

MEASURED = """\
[campaign]
name = "flown"
[[factor]]
name = "x"
low = -1.0
high = 1.0
[[factor]]
name = "kind"
levels = ["a", "b"]
[[application]]
name = "worth"
utility = "measured"
[[application]]
name = "clear"
utility = "rank"
[stop]
half_width = 0.5
"""


def call(*arguments: object, code: int = 0) -> str:
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert result.exit_code == code, result.output
    assert "Traceback" not in result.output
    return result.output if code else result.stdout


@pytest.fixture
def flown(tmp_path: Path, made: Path) -> Path:
    """A copy of the campaign, the test's own."""
    return shutil.copytree(made, tmp_path / "flown")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign with everything in it: proposals, scores, blocks, repeats, void and replaced runs, rankings."""
    folder = tmp_path_factory.mktemp("made") / "flown"
    folder.mkdir()
    (folder / "campaign.toml").write_bytes(("\ufeff" + MEASURED + "# caf\u00e9\n").replace("\n", "\r\n").encode())
    rows = [f"{k / 5 - 1!r},{'ab'[k % 2]},{(k * 0.7) % 1 + k / 30!r},worth,=note {k}" for k in range(12)]
    (folder / "s.csv").write_text("x,kind,score,application,note\n" + "\n".join(rows), encoding="utf-8")
    call("ingest", folder, folder / "s.csv")
    call("void", folder, 3, "--why", "clouds")
    (folder / "t.csv").write_text("run_id,x,kind,score,application\n3,0.125,a,0.5,worth\n", encoding="utf-8")
    ranks = [
        f"{run},{who},{1 + (run * step) % 7}" for who, step in (("ann", 3), ("bo", 5)) for run in (1, 2, *range(4, 13))
    ]
    (folder / "r.csv").write_text("run_id,interpreter,rank\n" + "\n".join(ranks) + "\n", encoding="utf-8")
    call("ingest", folder, folder / "t.csv", folder / "r.csv")
    call("propose", folder)
    return folder


def test_the_report_tells_what_rankings_mean_and_all_commands(flown: Path, tmp_path: Path) -> None:
    """A board reads what a logit is, how far scores are apart, and whom they are from; another makes it all again."""
    call("void", flown, "--ranking", 2, "--why", "the wrong screen")
    call("report", flown, "--html", flown / "r.html")
    page = unescape(re.sub(r"<[^>]+>", " ", (flown / "r.html").read_text(encoding="utf-8")))
    text = " ".join(page.split())
    assert "the highest score (interpreters' rankings) for clear" in text
    assert "1 ranking of 'clear' by 1 interpreter gives 11 runs their scores, in logits: of two images" in text
    assert "1 / (1 + exp(-d))" in text
    assert "known to within a factor of" in text
    ranks = {run: (run * 3) % 7 for run in (1, 2, *range(4, 13))}
    call("export", flown, tmp_path / "all.json")
    runs = json.loads((tmp_path / "all.json").read_text(encoding="utf-8"))["runs"]
    scores = {run["run_id"]: s["score"] for run in runs for s in run["scores"] if s["application"] == "clear"}
    tau = kendalltau([-rank for rank in ranks.values()], [scores[run] for run in ranks]).statistic
    assert re.search(rf"ann 1 1\.0 [\d.]+ to [\d.]+ {tau:.2f}", text)
    (made,) = re.findall(r"seqrsm ingest flown flown/s.csv.*?seqrsm report flown\b", text)
    assert made.split(" seqrsm ") == [
        "seqrsm ingest flown flown/s.csv",
        "void flown 3 --why clouds",
        "ingest flown flown/t.csv",
        "ingest flown flown/r.csv",
        "propose flown -n 4",
        "void flown --ranking 2 --why 'the wrong screen'",
        "fit flown",
        "report flown",
    ]


def test_runs_void_for_one_reason_stand_in_one_command_where_nothing_was_done_between(flown: Path) -> None:
    for what in ((4,), ("--ranking", 2), (5,), (6, 7)):
        call("void", flown, *what, "--why", "clouds")
    told = [step.split(" flown ")[1] for step in _reproduce(Campaign.open(flown), ()) if "void" in step]
    assert told == [f"{which} --why clouds" for which in ("3", "4", "--ranking 2", "5 6 7")]


def test_each_score_traces_to_its_file_row_and_decision(flown, tmp_path):
    call("export", flown, tmp_path / "all.json")
    document = json.loads((tmp_path / "all.json").read_text(encoding="utf-8"))
    for run in document["runs"]:
        for score in run["scores"]:
            if score["application"] == "clear":
                ranks = [r for r in document["rankings"] if r["run_id"] == run["run_id"]]
                assert ranks
                assert all((r["source_file"], r["source_row"] > 1) == ("r.csv", True) for r in ranks)
                continue
            lines = (flown / score["source_file"]).read_text(encoding="utf-8").splitlines()
            assert repr(score["score"]) in lines[score["source_row"] - 1].split(",")
            told = [e for e in document["events"] if e["kind"] == "scored" and e["run_id"] == run["run_id"]]
            assert any(e["detail"].get("file") == score["source_file"] for e in told)
        proposed = [e for e in document["events"] if e["kind"] == "proposed" and e["run_id"] == run["run_id"]]
        assert [e["detail"]["purpose"] for e in proposed] == [run["purpose"]]
        assert run["why"]


SECRET = '[store]  # ours\nurl = "postgresql+psycopg://u:hunter2@127.0.0.1:1/n"\n'


def test_every_file_of_an_export_is_named(flown, tmp_path):
    told = CliRunner().invoke(app, ["export", str(flown), str(tmp_path / "all.csv")]).stderr.splitlines()
    assert sorted(told) == sorted(f"wrote {file}" for file in tmp_path.glob("all*.csv"))
    assert len(told) == 5


@pytest.mark.parametrize("rest", ["", "[cost]\nflight = 3.0\n"])
def test_an_export_tells_no_address_and_no_password(flown, tmp_path, rest):
    with Store.open(flown) as store:
        toml = flown / "campaign.toml"
        toml.write_text(toml.read_text(encoding="utf-8-sig") + SECRET + rest, encoding="utf-8")
        export(store, load_spec(flown), tmp_path / "all.json")
    text = (tmp_path / "all.json").read_text(encoding="utf-8")
    assert "hunter2" not in text
    assert "postgresql" not in text
    assert ("flight = 3.0" in text) is bool(rest)


@pytest.mark.parametrize("address", ["postgres://u:hunter2@h/n", "postgresql+psycopg://u:hunter2@h:1x/n"])
def test_a_mistyped_address_is_told_without_its_password(flown, address):
    toml = (flown / "campaign.toml").read_text(encoding="utf-8-sig")
    (flown / "campaign.toml").write_text(f'{toml}[store]\nurl = "{address}"\n', encoding="utf-8")
    says = call("status", flown, code=2)
    assert "url" in says
    assert "hunter2" not in says


def test_the_form_of_flights_that_are_issued_is_written_again(flown, tmp_path):
    call("propose", flown, "-n", 2, "--csv", tmp_path / "first.csv")
    call("propose", flown, "--form", tmp_path / "all.csv")
    lines = (tmp_path / "first.csv").read_text().splitlines()
    assert (tmp_path / "all.csv").read_text().splitlines()[-len(lines) + 1 :] == lines[1:]
    assert "exists already" in call("propose", flown, "--form", tmp_path / "all.csv", code=2)
    told = call("propose", flown, "--source", "flight", "--form", tmp_path / "new.csv", code=2)  # "issue flights first"
    assert "Use --csv FILE to issue flights and write their form" in told
    assert not list(tmp_path.glob("*.part"))
