"""An export makes the campaign anew: the same export, the same fit, the same next runs; damaged ones are refused."""

from __future__ import annotations

import base64
import errno
import hashlib
import json
import math
import os
import sys
from pathlib import Path

import pytest
from tiny_campaign import make_tiny
from typer.testing import CliRunner

from seqrsm.campaign.export import export
from seqrsm.campaign.rebuild import rebuild
from seqrsm.cli.app import app
from seqrsm.spec.read import load_spec
from seqrsm.store.store import Store

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
def flown(tmp_path: Path) -> Path:
    """A campaign with everything in it: proposals, scores, blocks, repeats, void and replaced runs, rankings."""
    folder = tmp_path / "flown"
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


@pytest.fixture
def simulated(tiny: Path) -> Path:
    call("propose", tiny)
    call("simulate", tiny)
    return tiny


@pytest.mark.parametrize("campaign", ["flown", "simulated"])
def test_round_trip(request, tmp_path, campaign):
    folder = request.getfixturevalue(campaign)
    call("export", folder, tmp_path / "first.json")
    again = tmp_path / "again"
    call("init", "--from", tmp_path / "first.json", again)
    call("export", again, tmp_path / "second.json")
    assert (tmp_path / "second.json").read_bytes() == (tmp_path / "first.json").read_bytes()
    application = ["--application", "worth"] if campaign == "flown" else []
    assert call("fit", again, "--json", *application) == call("fit", folder, "--json", *application)
    if campaign == "simulated":
        assert (again / "scene.npz").read_bytes() == (folder / "scene.npz").read_bytes()
    # life goes on: the next runs are the same too, with ids of their own
    first, second = (json.loads(call("propose", place, "--json")) for place in (folder, again))
    assert first == second
    history = call("status", again, "--history")
    assert "scored run 1" in history


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


def damages():
    yield "format", lambda d: d.update(format="other")
    yield "no runs", lambda d: d.pop("runs")
    yield "state", lambda d: d["runs"][0].update(state="flown")
    yield "id", lambda d: d["runs"][0].update(run_id="1; DROP TABLE runs")
    yield "twice", lambda d: d["runs"].append(d["runs"][0])
    yield "score of nobody", lambda d: d["runs"][0]["scores"][0].update(score="high")
    yield "event of nobody", lambda d: d["events"][0].update(run_id=10**6)
    yield "no number", lambda d: [one.update(hash="", detail={"settings": math.nan}) for one in d["events"]]
    yield "other spec", lambda d: d.update(campaign_toml=d["campaign_toml"].replace("tiny", "huge"))
    yield "attached", lambda d: d["attached"][0].update(base64=base64.b64encode(b"x").decode())
    yield "not base64", lambda d: d["attached"][0].update(base64="?")
    yield "outside", lambda d: d["attached"][0].update(path="../stolen.npz")
    yield "absolute", lambda d: d["attached"][0].update(path="/tmp/stolen-by-seqrsm.npz")
    yield "missing", lambda d: d["attached"][0].update(base64=None)


def test_damaged_exports_are_refused_and_leave_nothing(simulated, tmp_path):
    call("export", simulated, tmp_path / "good.json")
    good = (tmp_path / "good.json").read_text(encoding="utf-8")
    place = tmp_path / "deep"
    place.mkdir()
    for _, change in damages():
        document = json.loads(good)
        change(document)
        (place / "bad.json").write_text(json.dumps(document), encoding="utf-8")
        call("init", "--from", place / "bad.json", place / "made", code=2)
        assert not (place / "made").exists()
    (place / "bad.json").write_text(good[: len(good) // 2], encoding="utf-8")
    call("init", "--from", place / "bad.json", place / "made", code=2)
    call("init", "--from", place / "absent.json", place / "made", code=2)
    assert sorted(path.name for path in place.iterdir()) == ["bad.json"]
    assert not (tmp_path / "stolen.npz").exists()
    assert not Path("/tmp/stolen-by-seqrsm.npz").exists()


@pytest.mark.parametrize(("form", "remedy"), [("seqrsm-export-2", "pip install --upgrade"), ("other", "Export the")])
def test_an_export_of_another_form_says_what_to_do(tmp_path, form, remedy):
    (tmp_path / "x.json").write_text(json.dumps({"format": form}), encoding="utf-8")
    assert remedy in call("init", tmp_path / "new", "--from", tmp_path / "x.json", code=2)


def test_a_large_scene_is_named_by_its_hash(simulated, tmp_path, monkeypatch):
    monkeypatch.setattr("seqrsm.campaign.export.MAX_ATTACHED", 10)
    call("export", simulated, tmp_path / "all.json")
    assert json.loads((tmp_path / "all.json").read_text())["attached"][0]["base64"] is None
    assert "does not contain" in call("init", "--from", tmp_path / "all.json", tmp_path / "again", code=2)
    (tmp_path / "scene.npz").write_bytes((simulated / "scene.npz").read_bytes())
    call("init", "--from", tmp_path / "all.json", tmp_path / "again")
    assert (tmp_path / "again" / "scene.npz").exists()


def test_a_folder_in_use_is_left_alone(flown, tmp_path, tiny_scene):
    call("export", flown, tmp_path / "all.json")
    other = make_tiny(tmp_path / "other", tiny_scene)
    before = sorted(path.name for path in other.iterdir())
    assert "not empty" in call("init", "--from", tmp_path / "all.json", other, code=2)
    assert sorted(path.name for path in other.iterdir()) == before


# -- exports of strangers ---------------------------------------------------------------------------------------------

SECRET = '[store]  # ours\nurl = "postgresql+psycopg://u:hunter2@127.0.0.1:1/n"\n'


def exported(flown: Path, tmp_path: Path, **changes: object) -> Path:
    call("export", flown, tmp_path / "all.json")
    document = json.loads((tmp_path / "all.json").read_text(encoding="utf-8")) | changes
    (tmp_path / "all.json").write_text(json.dumps(document), encoding="utf-8")
    return tmp_path / "all.json"


@pytest.mark.parametrize("rest", ["", "[cost]\nflight = 3.0\n"])
def test_an_export_tells_no_address_and_no_password(flown, tmp_path, rest):
    with Store.open(flown) as store:
        toml = flown / "campaign.toml"
        toml.write_text(toml.read_text(encoding="utf-8-sig") + SECRET + rest, encoding="utf-8")
        export(store, load_spec(flown), tmp_path / "all.json")
    text = (tmp_path / "all.json").read_text(encoding="utf-8")
    assert "hunter2" not in text
    assert "postgresql" not in text
    call("init", "--from", tmp_path / "all.json", tmp_path / "again")
    assert load_spec(tmp_path / "again").store_url is None
    assert load_spec(tmp_path / "again").cost.flight == (3.0 if rest else 1.0)


@pytest.mark.parametrize(
    "more",
    ['\n[store]\nurl = "sqlite:///{}"\n', '\n["store"]\nurl = "sqlite:///{}"\n', '\n[ store ]\nurl="sqlite:///{}"'],
)
def test_the_data_base_lies_in_the_folder_whatever_the_export_says(flown, tmp_path, more):
    outside = tmp_path / "outside.db"
    file = exported(flown, tmp_path, campaign_toml=MEASURED + more.format(outside))
    quoted = '["store"]' in more
    call("init", "--from", file, tmp_path / "again", code=2 if quoted else 0)
    assert not outside.exists()
    assert (tmp_path / "again" / "campaign.db").exists() is not quoted


@pytest.mark.parametrize("place", ["campaign.db", "campaign.toml", "../x", "/tmp/x", "a/../../x"])
def test_nothing_else_is_written_in_the_place_of_the_campaign(flown, tmp_path, place):
    one = {"path": place, "sha256": hashlib.sha256(b"x").hexdigest(), "base64": base64.b64encode(b"x").decode()}
    call("init", "--from", exported(flown, tmp_path, attached=[one]), tmp_path / "again", code=2)
    assert not (tmp_path / "again").exists()
    assert not (tmp_path / "x").exists()


def test_code_that_comes_with_a_campaign_is_taken_when_it_is_trusted(tiny, tmp_path):
    (tiny / "mine.py").write_text("def f(image, scene, *, seed, run_id):\n    return 5.0\n", encoding="utf-8")
    toml = (tiny / "campaign.toml").read_text(encoding="utf-8").replace('"percent_correct"', '"mine:f"')
    (tiny / "campaign.toml").write_text(toml, encoding="utf-8")
    call("export", tiny, tmp_path / "all.json")
    says = call("init", "--from", tmp_path / "all.json", tmp_path / "again", code=2)
    digest = hashlib.sha256((tiny / "mine.py").read_bytes()).hexdigest()
    assert all(word in says for word in ("mine.py", "mine:f", digest, "--trust-code"))
    assert not (tmp_path / "again").exists()
    call("init", "--from", tmp_path / "all.json", tmp_path / "again", "--trust-code")
    assert (tmp_path / "again" / "mine.py").read_bytes() == (tiny / "mine.py").read_bytes()
    with Store.open(tmp_path / "again") as store:
        (event,) = store.events(kind="code trusted")
    assert event.detail["code"] == {"mine.py": digest, "mine:f": digest}


@pytest.mark.parametrize("address", ["postgres://u:hunter2@h/n", "postgresql+psycopg://u:hunter2@h:1x/n"])
def test_a_mistyped_address_is_told_without_its_password(flown, address):
    toml = (flown / "campaign.toml").read_text(encoding="utf-8-sig")
    (flown / "campaign.toml").write_text(f'{toml}[store]\nurl = "{address}"\n', encoding="utf-8")
    says = call("status", flown, code=2)
    assert "url" in says
    assert "hunter2" not in says


@pytest.mark.skipif(sys.platform == "win32", reason="forks")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.parametrize("there", [False, True])
@pytest.mark.parametrize("killed", [False, True])
def test_a_folder_that_init_left_unfinished_is_made_anew(flown, tmp_path, there, killed):
    """Killed, or the disk full, before each of its files comes to its place."""
    call("export", flown, tmp_path / "all.json")
    real = Path.replace
    for moment in range(10):
        again = tmp_path / f"again{moment}"
        if there:
            again.mkdir()
        left = [moment]

        def replace(self, target, left=left):
            left[0] -= 1
            if left[0] < 0 and killed:
                os._exit(9)
            if left[0] < 0:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            return real(self, target)

        child = os.fork()
        if child == 0:
            Path.replace = replace
            try:
                rebuild(tmp_path / "all.json", again)
                os._exit(0)
            finally:
                os._exit(9)
        ended = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        assert (again / "campaign.toml").exists() is (ended == 0)
        if ended == 0:
            break
        call("init", "--from", tmp_path / "all.json", again)
        call("export", again, tmp_path / "second.json")
        assert (tmp_path / "second.json").read_bytes() == (tmp_path / "all.json").read_bytes()
        assert not (again / ".init").exists()
    assert moment > 0


def test_the_form_of_flights_that_are_issued_is_written_again(flown, tmp_path):
    call("propose", flown, "-n", 2, "--csv", tmp_path / "first.csv")
    call("propose", flown, "--form", tmp_path / "all.csv")
    lines = (tmp_path / "first.csv").read_text().splitlines()
    assert (tmp_path / "all.csv").read_text().splitlines()[-len(lines) + 1 :] == lines[1:]
    assert "exists already" in call("propose", flown, "--form", tmp_path / "all.csv", code=2)
    assert not list(tmp_path.glob("*.part"))
