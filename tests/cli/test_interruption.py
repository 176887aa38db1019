"""A campaign that is interrupted says so and goes on; kills are in test_kills.py."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from tiny_campaign import TINY, make_tiny
from typer.testing import CliRunner

from seqrsm.analysis.ground import MEASURED
from seqrsm.campaign import grounds
from seqrsm.campaign.campaign import Campaign
from seqrsm.cli.app import app

pytestmark = pytest.mark.usefixtures("few_draws")


def _heed_interrupts() -> None:
    """A shell's background jobs inherit deafness to SIGINT."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def start(*arguments: object) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "seqrsm", *(str(argument) for argument in arguments)]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=os.environ, preexec_fn=_heed_interrupts
    )


LOADING = """
import sys, time

class Slow:
    def find_spec(self, name, *_):
        if name == "typer":
            print("loading", flush=True)
            time.sleep(50)

sys.meta_path.insert(0, Slow())
from seqrsm.__main__ import main
main()
"""


def test_an_interrupt_while_the_command_is_loaded_leaves_no_traceback() -> None:
    command = [sys.executable, "-c", LOADING]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, **pipes, preexec_fn=_heed_interrupts) as process:
        assert process.stdout.readline() == "loading\n"
        process.send_signal(signal.SIGINT)
        assert process.stderr.read() == ""
    assert process.returncode == -signal.SIGINT


SWALLOWED = """
import ctypes, time
from seqrsm.cli.console import guarded

@ctypes.CFUNCTYPE(None)
def callback():
    raise KeyboardInterrupt

@guarded
def command():
    callback()
    {then}

command()
"""


@pytest.mark.parametrize("then", ["time.sleep(60)", 'raise RuntimeError("no compiled object yet")'])
def test_an_interrupt_that_a_compiler_swallows_ends_the_command_all_the_same(then: str) -> None:
    code = "import sys, typer\ntry:\n    exec(sys.argv[1])\nexcept typer.Exit as end:\n    sys.exit(end.exit_code)"
    done = subprocess.run(
        [sys.executable, "-c", code, SWALLOWED.format(then=then)],
        stderr=subprocess.PIPE, text=True, timeout=50, preexec_fn=_heed_interrupts, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (130, "interrupted\n")


def finish(*arguments: object) -> str:
    process = start(*arguments)
    out, err = process.communicate(timeout=120)
    assert process.returncode == 0, err
    return out


def result(folder: Path) -> list:
    out = folder.parent / f"{folder.name}.json"
    finish("export", folder, out)
    document = json.loads(out.read_text(encoding="utf-8"))
    return [
        (
            run["run_id"],
            run["batch"],
            run["purpose"],
            run["proposed"],
            run["state"],
            [s["score"] for s in run["scores"]],
        )
        for run in document["runs"]
    ]


def test_interrupt_says_how_to_go_on(tmp_path, tiny_scene) -> None:
    folder = make_tiny(tmp_path / "tiny", tiny_scene, ENDLESS)
    process = start("run", folder)
    deadline = time.monotonic() + 60.0
    while time.monotonic() < deadline and not (folder / "campaign.db").exists():
        time.sleep(0.05)
    time.sleep(1.0)
    # A library that compiles may swallow one interrupt; a second one, as a person would give, must end the command.
    err = ""
    for _ in range(20):
        process.send_signal(signal.SIGINT)
        try:
            _, err = process.communicate(timeout=5)
            break
        except subprocess.TimeoutExpired:
            continue
    assert process.returncode == 130, err
    assert "goes on from them" in err
    assert "Traceback" not in err
    # no run is left in the hands of the process that is gone
    assert "running" not in {run[4] for run in result(folder)}


ENDLESS = TINY.replace("half_width = 22.0", "half_width = 3.5").replace("max_runs = 40", "max_runs = 2000")


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_ends_a_run_with_two_workers(tmp_path, tiny_scene, how) -> None:
    folder = make_tiny(tmp_path / "tiny", tiny_scene, ENDLESS)
    process = start("run", folder, "--workers", 2)
    assert process.stderr is not None
    assert any("initial design of" in line for line in process.stderr)  # runs begin
    time.sleep(1.0)
    process.send_signal(how)
    _, err = process.communicate(timeout=120)
    assert process.returncode == (130 if how == signal.SIGINT else 143), err
    assert "goes on from them" in err
    assert "Traceback" not in err
    assert "running" not in {run[4] for run in result(folder)}


INTERRUPTING = """
import atexit, os, signal, sys, seqrsm.cli.app as cli
from seqrsm.cli.console import guarded

interrupt = lambda: os.kill(os.getpid(), signal.SIGINT)
"""


def _ends_as_interrupted(code: str, command: str = "") -> None:
    """``command``: name of a function of the code that is the command."""
    named = f"cli.app.command('it')(guarded({command}))\nsys.argv = ['seqrsm', 'it']\n" if command else ""
    done = subprocess.run(
        [sys.executable, "-c", f"{INTERRUPTING}{code}\n{named}cli.main()"],
        stderr=subprocess.PIPE, text=True, timeout=50, preexec_fn=_heed_interrupts, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (130, "interrupted\n")  # without a campaign there is nothing to continue


def test_an_interrupt_before_a_command_has_begun() -> None:
    _ends_as_interrupted("cli.app = interrupt")


def test_a_second_interrupt_does_not_disturb_the_end() -> None:
    """On a busy machine the end takes long, and a person gives Ctrl-C again."""
    _ends_as_interrupted("atexit.register(interrupt)", "interrupt")


def test_an_interrupt_that_an_import_makes_its_own_error_of_ends_the_command() -> None:
    """As compiled libraries do: "ImportError: initialization failed", from what was raised in between."""
    load = "def load():\n    try:\n        interrupt()\n    except BaseException as error:\n"
    _ends_as_interrupted(load + "        raise ImportError('initialization failed') from error", "load")


def test_a_scene_that_was_away_changes_nothing(tmp_path, tiny_scene) -> None:
    """Its settings are not given up, and no others take their place: the end is that of an undisturbed campaign."""
    calm, folder = make_tiny(tmp_path / "calm", tiny_scene), make_tiny(tmp_path / "tiny", tiny_scene)
    assert CliRunner().invoke(app, ["run", str(calm)]).exit_code == 0
    assert CliRunner().invoke(app, ["propose", str(folder)]).exit_code == 0
    (folder / "scene.npz").rename(folder / "away.npz")
    for _ in range(2):
        away = CliRunner().invoke(app, ["run", str(folder)])
        assert away.exit_code == 2, away.output
        assert "scene.npz" in away.output
    (folder / "away.npz").rename(folder / "scene.npz")
    assert CliRunner().invoke(app, ["run", str(folder)]).exit_code == 0
    assert result(folder) == result(calm)


def test_an_interrupted_bundle_of_worlds_is_made_by_the_next_call(tmp_path, tiny_scene, monkeypatch) -> None:
    """Before the next look: else an interrupted campaign would see other intervals than one that was not."""
    two = TINY.replace("[simulator]", '[[application]]\nname = "again"\nutility = "percent_correct"\n\n[simulator]', 1)
    folder = make_tiny(tmp_path / "tiny", tiny_scene, two)
    simulated, calls, settings = grounds.scores_of, [], []

    def once(tasks, application, *rest):
        calls.append(application)
        settings.append(tasks[0].settings)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return simulated(tasks, application, *rest)

    monkeypatch.setattr(grounds, "scores_of", once)
    campaign = Campaign.open(folder)
    campaign.propose()
    with pytest.raises(KeyboardInterrupt):
        campaign.simulate()
    campaign = Campaign.open(folder)
    assert campaign.simulate() == ()
    campaign.simulate()
    measured = [event.detail["application"] for event in campaign.store.events(kind=MEASURED)]
    assert measured == ["cover", "again"]
    assert calls == ["cover", "again", "again"]
    best = max(campaign.store.runs("scored"), key=lambda run: run.score_of("cover").score)
    assert settings[0] == best.settings
