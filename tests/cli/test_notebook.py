"""``seqrsm.Campaign``: the numbers of the commands on the same store, and the example notebook as it is shipped."""

from __future__ import annotations

import ast
import builtins
import io
import json
import multiprocessing
import re
import shlex
import shutil
import subprocess
import sys
import threading
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import redirect_stdout
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from commands import ok
from threadpoolctl import threadpool_info, threadpool_limits
from tiny_campaign import make_tiny
from typer.testing import CliRunner

import seqrsm
from seqrsm.campaign.dossier import assemble
from seqrsm.cli.app import app
from seqrsm.cli.console import line
from seqrsm.cli.results import Shown
from seqrsm.errors import SpecError, UserError
from seqrsm.plain import plain

NOTEBOOK = Path(__file__).parents[2] / "campaigns" / "notebook.ipynb"
FACTORS = {
    "frequency": {"low": 1.25, "high": 9.6, "unit": "GHz", "scale": "log"},
    "looks": (4, 64),
    "pol": ["HH", "VV"],
}


def ok_or_spent(*args: object) -> str:
    done = CliRunner().invoke(app, [str(arg) for arg in args])
    assert done.exit_code in (0, 3), done.output
    return done.stdout


def measured(plan: pd.DataFrame) -> np.ndarray:
    """A score with a peak inside, and scatter that follows from the run's id."""
    noise = [np.random.default_rng(int(run)).normal() for run in plan["run_id"]]
    mean = 70 - 5 * np.log2(plan["frequency"] / 4) ** 2 - 0.01 * (plan["looks"] - 30) ** 2 + 2 * (plan["pol"] == "HH")
    return (mean + noise).to_numpy()


@pytest.mark.filterwarnings("ignore:.* runs instead of 3")  # the initial design
def test_ten_lines_give_the_commands_numbers(tmp_path: Path) -> None:
    mine = seqrsm.Campaign.create(tmp_path / "mine", factors=FACTORS, half_width=3.0)
    theirs = tmp_path / "theirs"
    theirs.mkdir()
    shutil.copy(mine.folder / "campaign.toml", theirs)
    for n in (3, 3):
        plan = mine.propose(n)
        taken = mine.ingest(plan.assign(score=measured(plan)))
        ok("propose", theirs, "-n", n, "--csv", tmp_path / "form.csv")
        form = pd.read_csv(tmp_path / "form.csv").rename(columns={"frequency [GHz]": "frequency"})
        shown = ["run_id", "frequency", "looks", "pol", "note"]
        pd.testing.assert_frame_equal(form[shown], plan[shown], check_dtype=False)  # whole numbers have no decimals
        form.assign(score=measured(form)).to_csv(tmp_path / "filled.csv", index=False)
        ok("ingest", theirs, tmp_path / "filled.csv")
        (tmp_path / "form.csv").unlink()
        assert [report.n_scores for report in taken.reports] == [len(plan)]
    sources = {run.source for run in mine.opened.store.runs()}
    assert sources == {"flight"}  # there is no simulator
    fit = mine.fit()
    assert json.loads(json.dumps(fit.to_json())) == json.loads(ok("fit", theirs, "--json"))
    status = json.loads(ok("status", theirs, "--json"))
    assert mine.status().to_json() == {**status, "campaign": "mine"}
    assert ok("fit", theirs).rstrip().endswith(ok_summary(repr(fit)))
    frame = fit.to_frame()
    assert frame.loc[0, "score_unit"] == fit.analyses[0].score_unit
    assert frame.loc[0, "mean"] == fit.analyses[0].optimum.mean
    assert frame.loc[0, "prediction_low"] == fit.analyses[0].optimum.prediction.low
    assert "Recommended settings" in fit._repr_html_()
    assert '<br><span class="detail">95' in fit._repr_html_()  # a cell has no style to part them
    assert "data:image/svg+xml" in fit.plot()._repr_html_()
    assert "posterior draws" in repr(fit.plot())
    assert len(mine.runs()) == len(plan) + 15


@pytest.mark.filterwarnings("ignore:.* runs instead of 3")  # the initial design
def test_a_campaign_that_is_open_sees_that_its_file_was_edited(tmp_path: Path) -> None:
    """Its fit went by the target of before, and propose refused with 'Repeat the command', which never helped."""
    mine = seqrsm.Campaign.create(tmp_path / "mine", factors=FACTORS, half_width=3.0)
    plan = mine.propose(3)
    mine.ingest(plan.assign(score=measured(plan)))
    file = mine.folder / "campaign.toml"
    file.write_text(re.sub(r"half_width = 3(\.0)?", "half_width = 0.5", file.read_text("utf-8")), "utf-8")
    assert any("target is ± 0.5" in text for text in mine.fit().analyses[0].decision.reasons)
    assert mine.spec.stop.half_width == 0.5
    assert len(mine.propose(2)) == 2


def ok_summary(text: str) -> str:
    """The last line, which no width wraps."""
    return text.splitlines()[-1]


def test_an_image_is_that_of_the_command(tmp_path: Path, tiny_scene: Path) -> None:
    folder = make_tiny(tmp_path / "tiny", tiny_scene)
    out = tmp_path / "image.npz"
    told = json.loads(ok("image", folder, "--out", out, "--set", "resolution=20", "--json"))
    image = seqrsm.Campaign(folder).image(resolution=20)
    with np.load(out) as kept:
        for name in ("intensity_w", "incidence_angle_deg", "shadow"):
            assert np.array_equal(image[name], kept[name])
        assert json.loads(kept["settings"].item())["resolution [m]"] == 20.0
    assert image.attrs["resolution [m]"] == 20.0
    assert image.attrs["score of cover [percent]"] == told["scores"]["cover"]
    assert image["image"].dims == ("channel", "line", "sample")
    assert image["image"].attrs["units"] == "dB"


def test_errors_name_arguments_that_a_notebook_has_too(tiny: Path) -> None:
    """They named options of the commands: "--set resolution: outside the region", "--number: no such image"."""
    c = seqrsm.Campaign(tiny)
    for wrong, said in (
        (lambda: c.image(resolution=2e4), "resolution: outside the campaign's region"),
        (lambda: c.image(resolution="wide"), "resolution: not a finite number"),
        (lambda: c.image(number=9), "number: no such image"),
        (lambda: c.image(sharpness=2), "not a valid setting"),
        (lambda: c.propose(1, source="satellite"), "source: no such source"),
    ):
        with pytest.raises(UserError) as caught:
            wrong()
        assert str(caught.value).startswith(said)
        assert "--" not in str(caught.value)
    with pytest.raises(UserError, match=r'why: voiding needs a reason.*in Python why="clouds"'):
        c.void(1, "")


def test_without_xarray_an_image_is_arrays(tiny: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = builtins.__import__

    def without(name: str, *args: object, **more: object) -> object:
        if name == "xarray":
            raise ImportError(name)
        return found(name, *args, **more)

    monkeypatch.setattr(builtins, "__import__", without)
    image = seqrsm.Campaign(tiny).image({"resolution": 20})
    assert isinstance(image, dict)
    assert image["image"].ndim == 3
    assert image["resolution [m]"] == 20.0


def test_importing_it_loads_nothing_heavy() -> None:
    code = "import sys, seqrsm; seqrsm.Campaign, seqrsm.Fit; print(' '.join(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = {name.split(".")[0] for name in done.stdout.split()}
    assert not loaded & {"numpy", "scipy", "pandas", "numba", "matplotlib", "sqlalchemy", "pydantic"}


@pytest.mark.parametrize(
    ("method", "place"),
    [
        ("issue", "seqrsm.campaign.campaign.Campaign.propose"),
        ("carry_out", "seqrsm.campaign.campaign.Campaign.simulate"),
        ("run", "seqrsm.campaign.loop.run_campaign"),
        ("fit", "seqrsm.campaign.campaign.Campaign.analyse_all"),
        ("candidates", "seqrsm.campaign.candidates.measure_candidates"),
        ("status", "seqrsm.campaign.status.campaign_status"),
        ("report", "seqrsm.campaign.dossier.assemble"),
    ],
)
def test_matrix_libraries_keep_to_one_thread_while_it_computes(
    tiny: Path, monkeypatch: pytest.MonkeyPatch, method: str, place: str
) -> None:
    def threads() -> set[int]:
        return {one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"}

    class Reached(Exception):  # noqa: N818
        pass

    def reached(*_: object, **__: object) -> None:
        raise Reached(threads())

    c = seqrsm.Campaign(tiny)
    monkeypatch.setattr(place, reached)
    with threadpool_limits(limits=2, user_api="blas"):
        assert threads() == {2}
        with pytest.raises(Reached) as told:
            getattr(c, method)()
        assert told.value.args == ({1},)
        assert threads() == {2}


def test_threads_show_their_results_apart_and_leave_stdout_as_it_was() -> None:
    """Each put its page in place of stdout for all; the last to end left one there: a notebook printed no more."""
    begun, ended = [threading.Event(), threading.Event()], [threading.Event(), threading.Event()]

    class Slow(Shown):
        def __init__(self, number: int) -> None:
            self.number = number

        def show(self) -> None:
            line(f"begun {self.number}")
            begun[self.number].set()
            assert ended[self.number].wait(20)
            line(f"ended {self.number}")

    text = io.StringIO()
    with ThreadPoolExecutor(2) as pool, redirect_stdout(text):
        told = []
        for number in (0, 1):
            told.append(pool.submit(repr, Slow(number)))
            assert begun[number].wait(20)
        print("meanwhile")
        for number in (0, 1):
            ended[number].set()
        assert [one.result() for one in told] == ["begun 0\nended 0", "begun 1\nended 1"]
        assert sys.stdout is text
        repr(told := Slow(0))
        told.show()  # by this thread, once it was on a page
    assert text.getvalue() == "meanwhile\nbegun 0\nended 0\n"


@pytest.mark.usefixtures("few_draws")
def test_the_end_of_a_run_shows_what_the_command_prints(tiny: Path) -> None:
    """As the last line of a cell it displayed a thousand lines of arrays."""
    ended = seqrsm.Campaign(tiny).run(max_runs=12)
    printed = CliRunner().invoke(app, ["run", str(tiny), "--max-runs", "12"], env={"COLUMNS": "100"}).stdout
    shown, told = (text.split("in total; time:")[0] for text in (repr(ended), printed))
    assert shown == told
    assert "Summary\nQuestion: which" in shown
    document = json.loads(ok_or_spent("run", tiny, "--max-runs", 12, "--json"))
    assert {**plain(ended.to_json()), "seconds": 0} == {**document, "seconds": 0}
    assert ended.held is ended.outcome.held is document["held"]


def test_an_open_campaign_goes_to_another_process(tmp_path: Path) -> None:
    """It ended in 'Can't pickle local object' of a library."""
    c = seqrsm.Campaign.create(tmp_path / "mine", factors={"x": (0, 9)}, half_width=1)
    plan = c.propose()
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        assert pool.submit(seqrsm.Campaign.form, c).result().equals(plan)


def test_a_report_names_every_table_of_one_name_and_how_one_in_memory_was_ingested(tmp_path: Path) -> None:
    """Of three only the last was told, with its hash, and a command that read a file named DataFrame."""
    c = seqrsm.Campaign.create(tmp_path / "mine", factors={"x": (0, 9)}, half_width=1)
    texts = []
    for _ in range(2):
        plan = c.propose()
        texts.append(plan.assign(score=10 - (plan["x"] - 4) ** 2 + np.sin(9 * plan["run_id"])))
        c.ingest(texts[-1])
    shown = assemble(c.opened)
    hashes = [file.sha256 for file in c.opened.store.files()]
    assert [key for key in shown.provenance if "file" in key] == ["scores file DataFrame"]
    told = shown.provenance["scores file DataFrame"]
    assert told == f"{len(texts[0])} rows, SHA-256 {hashes[0]}; {len(texts[1])} rows, SHA-256 {hashes[1]}"
    in_python = "seqrsm.Campaign('mine').ingest(table)  # in Python: a DataFrame of {} rows"
    assert [step for step in shown.reproduce if "ingest" in step] == [in_python.format(len(one)) for one in texts]


def test_commands_that_reproduce_a_report_hold_names_with_blanks(tmp_path: Path) -> None:
    """`seqrsm ingest my flights my flights/May 3.csv` was told, of five words."""
    c = seqrsm.Campaign.create(tmp_path / "my flights", factors={"x": (0, 9)}, half_width=1)
    plan = c.propose()
    file = c.folder / "May 3.csv"
    plan.assign(score=10 - (plan["x"] - 4) ** 2).to_csv(file, index=False)
    c.ingest(file)
    c.void([1, 2], "a cloud")  # one command; each run had its own
    c.void(3, "rain")
    told = [shlex.split(step) for step in assemble(c.opened).reproduce]
    assert told == [
        ["seqrsm", "propose", "my flights"],
        ["seqrsm", "ingest", "my flights", "my flights/May 3.csv"],
        ["seqrsm", "void", "my flights", "1", "2", "--why", "a cloud"],
        ["seqrsm", "void", "my flights", "3", "--why", "rain"],
        ["seqrsm", "fit", "my flights"],
        ["seqrsm", "report", "my flights"],
    ]


def test_no_simulation_is_issued_where_there_is_no_simulator(tmp_path: Path) -> None:
    c = seqrsm.Campaign.create(tmp_path / "mine", factors=FACTORS, half_width=3.0)
    with pytest.raises(UserError, match="no simulator"):
        c.propose(source="simulation")
    for wrong in ({}, {"looks": 10}, {"looks": 1000}, {"lokos": 10}):
        with pytest.raises(UserError, match=r"campaign\.toml: this campaign has no simulator"):
            c.image(wrong)
    assert c.runs().empty


@pytest.mark.parametrize(
    ("more", "says"),
    [
        ({"factors": {"looks": (9, 4)}}, "low"),
        ({"factors": {"looks": "many"}}, "neither a range nor levels"),
        ({"stop": {"max_run": 30}}, "max_runs"),
        ({"half_width": None}, "half_width"),
        ({"template": "flevoland"}, "template"),
        ({"template": "flevoland", "factors": None, "half_width": None, "constraints": "x < 1"}, "template"),
        ({"template": "flevoland", "factors": None, "half_width": None, "application": "crops"}, "template"),
        ({"application": {"name": "a", "utility": "percent"}}, "percent_correct"),
        ({"factors": ["looks", "pol"]}, "mapping"),
        ({"half_width": "three"}, "half_width"),
        ({"application": 5}, "application.*table"),
        ({"model": 1}, "model.*table"),
        ({"stop": 30}, "stop.*table"),
        ({"constraints": "looks < 3 * pol"}, "pol"),
    ],
)
def test_what_cannot_be_leaves_no_folder(tmp_path: Path, more: dict, says: str) -> None:
    given = {"factors": FACTORS, "half_width": 3.0, **more}
    with pytest.raises(UserError, match=says) as caught:
        seqrsm.Campaign.create(tmp_path / "mine", **given)
    assert ".init" not in str(caught.value)
    assert not (tmp_path / "mine").exists()


@pytest.mark.parametrize(
    ("method", "given", "least"),
    [
        ("propose", {"n": 2.5}, 1),
        ("simulate", {"workers": 0}, 1),
        ("run", {"workers": True}, 1),
        ("candidates", {"worlds": 2}, 4),
        ("candidates", {"workers": 0}, 1),
        ("image", {"threads": 0}, 1),
        ("image", {"number": "2"}, 1),
    ],
)
def test_whole_numbers_are_asked_for_as_by_the_commands(tmp_path: Path, method: str, given: dict, least: int) -> None:
    c = seqrsm.Campaign.create(tmp_path / "mine", factors=FACTORS, half_width=3.0)
    ((name, value),) = given.items()
    with pytest.raises(UserError, match=rf"{name} is a whole number from {least} \(got {value!r}\)"):
        getattr(c, method)(**given)


def test_what_a_notebook_gets_wrong_is_told_and_changes_nothing(tmp_path: Path) -> None:
    c = seqrsm.Campaign.create(
        tmp_path / "m", factors={"x": (0, 9)}, half_width=1, model={"order": 1}, constraints="x < 8"
    )
    for n in (0, -1, 2.5, "3", True):
        with pytest.raises(UserError, match="whole number"):
            c.propose(n)  # type: ignore[arg-type]
    for table in ({"x": [1], "score": [3]}, [1, 2], None):
        with pytest.raises(UserError, match="DataFrame"):
            c.ingest(table)  # type: ignore[arg-type]
    plain, table, array = object(), pd.DataFrame({"x": [1]}), np.array([1, 2])
    for call in (
        *(lambda value=value: seqrsm.Campaign(value) for value in (1, None, ["m"])),
        *(lambda value=value: seqrsm.Campaign.create(value, template="flevoland") for value in (1, None)),
        *(
            lambda value=value: seqrsm.Campaign.create(tmp_path / "n", template=value)
            for value in (1, ["flevoland"], table)
        ),
        *(
            lambda given=given: seqrsm.Campaign.create(
                tmp_path / "n", **{"factors": {"x": (0, 9)}, "half_width": 1, **given}
            )
            for given in ({"factors": array}, {"half_width": {1: 2}}, {"constraints": None}, {"model": array})
        ),
        *(lambda value=value: c.void(value, "why") for value in (np.array([0.5]), None, "1", [1, "x"])),
        *(lambda value=value: c.void(1, value) for value in (None, 1, ["why"])),
        *(lambda value=value: c.propose(value) for value in (array, np.array(["a"]), [1], table)),
        *(lambda value=value: c.propose(1, source=value) for value in (array, 1, ["flight"], table)),
        *(lambda value=value: c.form(value) for value in (1, "x", ["x"], [plain], [None], [99], table)),
        *(lambda value=value: c.run(max_runs=value) for value in ("x", 0, array, 2.5)),
        *(lambda value=value: c.run(batch=value) for value in ("x", 0, array, 2.5)),
        *(lambda value=value: c.simulate(value) for value in (array, None, "1")),
        *(lambda value=value: c.fit(value) for value in (array, 1, ["score"])),
        *(lambda value=value: c.fit(test=value) for value in (None, 1, array, [1], b"x")),
        *(lambda value=value: c.candidates(worlds=value) for value in (array, None, "9")),
        *(lambda value=value: c.image(value) for value in (-1, array, "x", [1], table)),
        *(lambda value=value: c.image(number=value) for value in (array, None, "1")),
        *(lambda value=value: c.report(html=value) for value in (0, "", ["a.html"], array)),
    ):
        with pytest.raises(UserError):
            call()
    assert not (tmp_path / "n").exists()
    assert c.runs().empty
    with pytest.warns(UserWarning, match="8 runs instead of 4: the initial design is issued whole"):
        plan = c.propose(np.int64(4))
    assert c.form(plan["run_id"]).equals(plan)
    assert c.form([8, 2])["run_id"].tolist() == [8, 2]
    c.ingest(plan.assign(score=plan["x"] * 2 + np.arange(len(plan)) % 3))
    assert c.fit(test="x,first order").to_json()["tests"] == c.fit(test=["x,first order"]).to_json()["tests"]
    c.void(1, "clouds")
    assert c.runs().set_index("run_id").loc[1, ["state", "reason"]].tolist() == ["void", "clouds"]
    for run_id, state in ((1, "void"), (2, "scored")):  # a form filled in for these would be refused
        with pytest.raises(UserError, match=f"awaits no score: it is {state}"):
            c.form([run_id])
    with pytest.raises(UserError, match="no such run"):
        c.void(99, "clouds")
    with pytest.warns(UserWarning, match=r"73 runs instead of 99: the budget, \[stop\] max_runs, leaves no more"):
        c.propose(99)
    assert {"Campaign", "Fit"} <= set(dir(seqrsm))


def test_all_kinds_of_tables_are_written_as_they_were_meant(tmp_path: Path) -> None:
    c = seqrsm.Campaign.create(
        tmp_path / "m",
        factors={
            "a_b": [1, 2.5, 4],
            "c": (np.float64(0.5), np.int64(3)),
            "pol": np.array(["HH", "VV", "HV"]),
            "d": pd.Series([1, 2, 4]),
        },
        half_width=2,
        application={
            "name": "yield",
            "utility": "percent_correct",
            "prior": {"utility": [40.0, 90.0], "optimum": {"c": {"value": 1.0, "doubt": 0.3}}},
        },
        constraints=["c <= 4 * 1.5"],
        campaign={"description": 'He said "no" \\ yes\n\x7f', "seed": 7},
        model={"order": 1},
        stop={"max_runs": 30},
    )
    spec = c.spec
    assert (spec.seed, spec.model.order, spec.stop.max_runs) == (7, 1, 30)
    assert spec.description == 'He said "no" \\ yes\n\x7f'
    assert spec.applications[0].prior.optimum["c"].doubt == 0.3
    assert [factor.name for factor in spec.factors] == ["a_b", "c", "pol", "d"]
    with pytest.raises(SpecError):
        seqrsm.Campaign(tmp_path / "nothing")


def test_the_notebook_runs_as_it_is_shipped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    cells = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
    names: dict[str, object] = {}
    shown = []
    for cell in cells:
        if cell["cell_type"] != "code":
            continue
        body = ast.parse("".join(cell["source"])).body
        last = body.pop() if isinstance(body[-1], ast.Expr) else None
        exec(compile(ast.Module(body, []), "notebook", "exec"), names)
        if last is not None:
            value = eval(compile(ast.Expression(last.value), "notebook", "eval"), names)
            shown.append(value._repr_html_() if hasattr(value, "_repr_html_") else repr(value))
    assert any("highest measured score for soil?" in text for text in shown)
    assert any("data:image/svg+xml" in text for text in shown)
    assert any("Decision" in text for text in shown)
    assert names["c"].spec.name == "soil"
