"""What a terminal and a pipe get: width, colours, rules, trailing blanks, and statements in order."""

from __future__ import annotations

import json
import os
import pty
import re
import select
import struct
import subprocess
import sys
import termios
import textwrap
from fcntl import ioctl
from pathlib import Path

import numpy as np
import pytest
from measured_campaign import X, make, quadratic
from tiny_campaign import TINY, make_tiny
from typer.testing import CliRunner

from seqrsm.campaign import rehearsal
from seqrsm.cli.app import app
from seqrsm.cli.console import line, show_table
from seqrsm.report.sections.sources import _cover_table, group_notes

NOTES = (
    "Wheat: short vegetation (computed: flevoland)",
    "Wheat: 2.6 GHz interpolated between 1.25 and 3 GHz",
    "Corn: 2.6 GHz interpolated between 1.25 and 3 GHz",
    "Corn HH: field sd 1.50 dB (assumed: assumed_variability)",
    "Corn HV: field sd 1.50 dB (assumed: assumed_variability)",
    "antenna gain is the same over the swath",
    "antenna gain is the same over the swath",
)


MEASURED = """\
[campaign]
name = "measured"
seed = 1
[[factor]]
name = "frequency"
unit = "GHz"
low = 1.0
high = 10.0
[[factor]]
name = "depression_angle"
unit = "deg"
low = 30.0
high = 60.0
[[factor]]
name = "polarization"
levels = ["VV", "HH+HV", "HH"]
[[application]]
name = "ground-cover"
utility = "percent_correct"
[stop]
half_width = 3.0
"""


def on_terminal(*arguments: object, columns: int = 80, **environment: str) -> str:
    """Output of a command on a terminal."""
    child, terminal = pty.fork()
    if child == 0:
        ioctl(1, termios.TIOCSWINSZ, struct.pack("HHHH", 50, columns, 0, 0))
        kept = {name: value for name, value in os.environ.items() if name not in ("NO_COLOR", "FORCE_COLOR", "CI")}
        settings = {**kept, "TERM": "xterm-256color", "COLUMNS": str(columns), "LINES": "50", **environment}
        command = [sys.executable, "-m", "seqrsm", *(str(argument) for argument in arguments)]
        os.execve(sys.executable, command, settings)
    read = b""
    while select.select([terminal], [], [], 120.0)[0]:
        try:
            data = os.read(terminal, 65536)
        except OSError:
            break
        if not data:
            break
        read += data
    os.close(terminal)
    os.waitpid(child, 0)
    return read.decode()


def without_codes(text: str) -> list[str]:
    plain = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", text)
    return [line.split("\r")[-1] for line in plain.replace("\r\n", "\n").split("\n")]


def screen(text: str, columns: int) -> list[str]:
    """Lines as they stand on a terminal of endless height in the end."""
    rows, at, column = [""], 0, 0
    for code, moved, letter, sign in re.findall(r"(\x1b\[([0-9;?]*)([A-Za-z]))|(\r|\n|.)", text, re.DOTALL):
        if code:
            if letter == "A":
                at = max(at - int(moved or 1), 0)
            elif letter == "K":
                rows[at] = "" if moved == "2" else rows[at][:column]
        elif sign == "\r":
            column = 0
        elif sign == "\n" or column == columns:
            at, column = at + 1, 0
            rows += [""] * (at + 1 - len(rows))
        if sign and sign not in "\r\n":
            rows[at] = rows[at].ljust(column)[:column] + sign + rows[at][column + 1 :]
            column += 1
    return [row.rstrip() for row in rows]


@pytest.mark.parametrize("columns", [60, 100])
def test_messages_and_bars_do_not_meet(tiny: Path, columns: int) -> None:
    text = on_terminal("run", tiny, "--max-runs", 14, columns=columns)
    assert "\u2501" in text  # there was a bar
    lines = screen(text, columns)
    assert not any("\u2501" in line for line in lines)  # and nothing is left of it
    assert max(map(len, lines)) <= columns
    said = " ".join(line.strip() for line in lines)
    assert "checking the simulator with one image at the centre of the region searching for an initial design" in said
    starts = [line for line in lines if re.match(r" +\d+ runs  ", line)]
    assert len(starts) >= 1
    assert all("target 22" in line for line in starts)


def test_an_error_is_wrapped_at_words(tiny: Path) -> None:
    path = tiny / "campaign.toml"
    path.write_text(path.read_text(encoding="utf-8").replace("altitude_m = 4000.0", "wings = 2"), encoding="utf-8")
    lines = screen(on_terminal("check", tiny, columns=60), 60)
    short = [line for line in lines if len(line) <= 60 and "/" not in line]
    assert len(short) > 2
    words = " ".join(lines)
    assert "altitude_m" in words
    assert "[simulator.fixed]" in words


def test_statements_on_a_cover_stand_together_and_those_on_every_cover_last() -> None:
    notes = ("Water: a.", "Soil: b.", "Water: c.", "Soil: c.", "Water: wind 4 m/s.", "Soil: wet.", "Water: wind 2 m/s.")
    shown = [tuple(cell.text for cell in row) for row in _cover_table(group_notes(notes, ("Water", "Soil"))[0]).rows]
    covers = [cover for cover, _ in shown]
    assert covers == ["Water", "Water", "Water", "Soil", "Soil", "every cover"]
    assert [text.lower() for _, text in shown[:3]] == ["a.", "wind 4 m/s.", "wind 2 m/s."]


def test_notes_are_grouped_by_what_they_are_about():
    about_covers, about_channels, others = group_notes(NOTES, ("Wheat", "Corn"))
    assert about_covers["2.6 GHz interpolated between 1.25 and 3 GHz"] == ["Wheat", "Corn"]
    assert [(cover, channel) for cover, channel, _ in about_channels] == [("Corn", "HH"), ("Corn", "HV")]
    assert others == ("antenna gain is the same over the swath",)


def test_status_fits_a_terminal_and_honours_no_color(tiny: Path) -> None:
    coloured = on_terminal("status", tiny)
    assert "\x1b[1m" in coloured
    lines = without_codes(coloured)
    assert max(map(len, lines)) <= 80
    assert any("campaign tiny" in line for line in lines)
    colours = re.compile(r"\x1b\[(?:3[0-7]|38|9[0-7])")
    assert not colours.search(on_terminal("status", tiny, NO_COLOR="1"))


def test_check_groups_its_statements_and_tells_all_when_asked(tmp_path, tiny_scene) -> None:
    folder = make_tiny(tmp_path / "tiny", tiny_scene)
    short = CliRunner().invoke(app, ["check", str(folder)])
    long = CliRunner().invoke(app, ["check", str(folder), "--json"])
    assert short.exit_code == long.exit_code == 0, short.output + long.output
    assert short.stdout.count("\n- ") < 15 < len(json.loads(long.stdout)["notes"])
    assert "with those on single covers" in short.stdout
    assert short.stdout.rstrip().endswith("No problems found.")
    for old, new, ends in (
        ("peak_power = 1000.0", "peak_power = 0.001", "See the notes on the region and the scene."),
        ("half_width = 22.0", "half_width = 0.5", None),
    ):
        make_tiny(tmp_path / new, tiny_scene, TINY.replace(old, new))
        told = CliRunner().invoke(app, ["check", str(tmp_path / new)]).stdout.rstrip()
        assert "No problems found." not in told
        assert told.endswith(ends or "")


@pytest.mark.parametrize("command", [["catalog", "soil", "moisture"], ["init", "--list"], ["catalog"]])
def test_piped_output_is_plain(command) -> None:
    text = CliRunner().invoke(app, command).stdout
    assert text
    assert not re.search(r"[\u2500-\u257f\x1b\u00a0\u2212]", text)
    assert all(line == line.rstrip() for line in text.splitlines())


@pytest.mark.parametrize("command", ["fit", "status", "check"])
def test_commands_keep_to_columns_in_a_pipe(measured: Path, command: str) -> None:
    wide = CliRunner().invoke(app, [command, str(measured)], env={"COLUMNS": ""})
    assert wide.exit_code == 0, wide.output
    for columns in (80, 60):
        narrow = CliRunner().invoke(app, [command, str(measured)], env={"COLUMNS": str(columns)})
        assert narrow.exit_code == 0, narrow.output
        lines = narrow.stdout.splitlines()
        assert max(map(len, lines)) <= columns
        assert all(line == line.rstrip() for line in lines)
        assert not re.search(r"[\u2500-\u257f\x1b\u00a0\u2212]", narrow.stdout)
        # the same words and numbers in the same order, but for where a cell is folded
        assert sorted(re.sub(r"\s", "", narrow.stdout)) == sorted(re.sub(r"\s", "", wide.stdout))


@pytest.mark.parametrize("noise", [0.3, 9.0])
def test_status_gives_the_mean_to_the_digits_of_the_report(tmp_path: Path, noise: float) -> None:
    """To 60.7 where the report had 61, or 0.607 where it had 0.61."""
    (tmp_path / "campaign.toml").write_text(MEASURED, encoding="utf-8")
    rng, rows = np.random.default_rng(1), ["frequency,depression_angle,polarization,score"]
    for i in range(36):
        f, d = rng.uniform(1, 10), rng.uniform(30, 60)
        rows.append(
            f"{f:.3f},{d:.2f},{('HH', 'VV', 'HH+HV')[i % 3]},{60 - 0.3 * (f - 5) ** 2 + noise * rng.normal():.4f}"
        )
    (tmp_path / "scores.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    assert CliRunner().invoke(app, ["ingest", str(tmp_path), str(tmp_path / "scores.csv")]).exit_code == 0
    told = [CliRunner().invoke(app, [command, str(tmp_path)]).stdout for command in ("status", "fit")]
    (status,) = re.findall(r"^mean score (.*)$", told[0], flags=re.M)
    (fit,) = re.findall(r"^Mean score  +(\S+(?: percent)?)  ", told[1], flags=re.M)
    assert status == fit
    (width,) = re.findall(r"^ +confidence interval of the mean: ± (\S+)", told[0], flags=re.M)
    assert re.findall(r"^Mean score +\S+ to \S+(?: percent)? +(\S+)(?: percent)?$", told[1], flags=re.M) == [width]


def test_fit_fits_a_terminal_of_80_columns_without_folding_a_term(measured: Path) -> None:
    lines = without_codes(on_terminal("fit", measured))
    assert max(map(len, lines)) <= 80
    at = next(
        i for i, line in enumerate(lines) if line.startswith("polarization[HH+HV] \u00d7") and "frequency" not in line
    )
    assert lines[at + 1].strip() == "depression angle"  # two lines, but no word is cut


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign of measured scores with long names."""
    folder = tmp_path_factory.mktemp("measured") / "campaign"
    folder.mkdir()
    (folder / "campaign.toml").write_text(MEASURED, encoding="utf-8")
    rng = np.random.default_rng(0)
    rows = ["frequency,depression_angle,polarization,score"]
    for i in range(36):
        f, d = rng.uniform(1, 10), rng.uniform(30, 60)
        score = 70 - 0.3 * (f - 5) ** 2 - 0.02 * (d - 40) ** 2 + (i % 3) * 2 + rng.normal()
        rows.append(f"{f:.3f},{d:.2f},{('HH', 'VV', 'HH+HV')[i % 3]},{score:.2f}")
    (folder / "scores.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    done = CliRunner().invoke(app, ["ingest", str(folder), str(folder / "scores.csv")])
    assert done.exit_code == 0, done.output
    return folder


PATH = (
    ("Distance", "frequency [GHz]", "polarization", "depression angle [deg]"),
    [("0.25", "2.304", "HH+HV+VV", "42.19"), ("1.00", "1.548", "HH", "34.47")],
)


@pytest.mark.parametrize(
    ("columns", "shown"),
    [
        (
            34,
            """\
            Distance  frequency  polarization
                          [GHz]
                0.25      2.304      HH+HV+VV
                1.00      1.548            HH

            Distance  depression angle [deg]
                0.25                   42.19
                1.00                   34.47
            """,
        ),
        (
            43,  # blanks are saved between columns
            """\
            Distance frequency polarization depression
                         [GHz]                   angle
                                                 [deg]
                0.25     2.304     HH+HV+VV      42.19
                1.00     1.548           HH      34.47
            """,
        ),
    ],
)
def test_columns_that_do_not_fit_follow_below(
    columns: int, shown: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", str(columns))
    show_table(*PATH, sides=("right",))
    assert capsys.readouterr().out == textwrap.dedent(shown)


def test_no_line_ends_before_a_number(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    for columns in range(20, 40):
        monkeypatch.setenv("COLUMNS", str(columns))
        line("a slope of 2.5 ± 1.25 (F = 6.49, p < 0.001) explains 76 % of it, the others p = 0.24")
        told = capsys.readouterr().out
        assert not re.search(r"[±<>=Fp]\n|\n[%<>=]", told)
        assert " ".join(told.split()).endswith("explains 76 % of it, the others p = 0.24")


@pytest.mark.parametrize(
    "command",
    ["--help", "--version", "fit --help", "parameters psm", "parameters psm --json", "help rankings", "catalog"],
)
@pytest.mark.parametrize("stream", ["stdout", "both"])
def test_a_closed_pipe_is_no_error(command: str, stream: str) -> None:
    """As behind `| head`: nothing is said, and the exit code is that of a program whose pipe was closed."""
    read, write = os.pipe()
    os.close(read)
    err = subprocess.PIPE if stream == "stdout" else write
    done = subprocess.run([sys.executable, "-m", "seqrsm", *command.split()], stdout=write, stderr=err, check=False)
    os.close(write)
    assert done.returncode in (0, 141)
    assert not done.stderr


OPENS_A_FILE = """
import atexit, os, sys
from seqrsm.__main__ import main
sys.argv = ["seqrsm", "--version"]
atexit.register(lambda: os.write(3, str(open(os.devnull).fileno() > 2).encode()))
main()
"""


@pytest.mark.parametrize(
    ("command", "ends", "code", "says"),
    [
        ("-m seqrsm --version", ">&- 2>&- <&-", 0, ""),  # as a service may begin it
        ("-m seqrsm --version", ">/dev/full", 2, "the output cannot be written: No space left on device"),
        # No file that is opened becomes stdout or stderr, where libraries write.
        (f"-c '{OPENS_A_FILE}'", ">&-", 0, "True"),
    ],
)
def test_output_that_nobody_takes_ends_without_a_traceback(command: str, ends: str, code: int, says: str) -> None:
    shell = f"({sys.executable} {command} {ends}) 3>&1"
    done = subprocess.run(["sh", "-c", shell], capture_output=True, text=True, check=False)
    assert done.returncode == code
    assert says in done.stdout + done.stderr
    assert "Traceback" not in done.stderr


def test_a_cost_is_told_in_its_unit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ended = {"held": True, "runs": 20, "loss": 0.1, "rule": 1.0, "prediction": 0.95, "confidence": 1.0}
    monkeypatch.setattr(rehearsal, "_rehearsed", lambda *_: ended)
    folder = make(tmp_path / "c", X, quadratic(), '[model]\norder = 1\n[cost]\nunit = "kEUR"\nflight = 12.5\n')
    text = (folder / "campaign.toml").read_text(encoding="utf-8")
    for stated in ("flight = 12.5", ""):
        (folder / "campaign.toml").write_text(text.replace('unit = "kEUR"\nflight = 12.5', stated), encoding="utf-8")
        for command, cost in (("check", "cost 1000 units"), ("status", "cost spent 300 units")):
            told = CliRunner().invoke(app, [command, str(folder)]).stdout.replace("\u00a0", " ")
            assert cost in told if stated else "cost" not in told
    (folder / "campaign.toml").write_text(text, encoding="utf-8")
    for command, says in (("check", "cost 1000 kEUR"), ("status", "cost spent 300 kEUR"), ("rehearse", "250 kEUR")):
        told = CliRunner().invoke(app, [command, str(folder)]).stdout.replace("\u00a0", " ")
        assert says in told, told
    assert CliRunner().invoke(app, ["void", str(folder), "3", "--why", "clouds"]).exit_code == 0
    status = CliRunner().invoke(app, ["status", str(folder)]).stdout.replace("\u00a0", " ")
    assert "cost spent 287.5 kEUR, without 12.5 kEUR of voided runs" in " ".join(status.split())
    fit = CliRunner().invoke(app, ["fit", str(folder)]).stdout.replace("\u00a0", " ")
    assert "They cost 287.5 kEUR (a flight 12.5 kEUR), without 12.5 kEUR of voided runs." in " ".join(fit.split())


def test_status_tells_the_decision_of_the_report(tmp_path: Path) -> None:
    folder = make(tmp_path / "c", X, quadratic())
    text = (folder / "campaign.toml").read_text(encoding="utf-8")
    for stop, says in (
        ("half_width = 8.0\n", "stop"),
        ("half_width = 0.1\nmax_runs = 24\n", "budget spent"),
        ('half_width = 8.0\nguard = "confirmation"\n', "confirm"),
        ("half_width = 0.1\n", "continue"),
    ):
        (folder / "campaign.toml").write_text(text.replace("half_width = 3.0\n", stop), encoding="utf-8")
        told, fitted = (CliRunner().invoke(app, [command, str(folder)]).stdout for command in ("status", "fit"))
        assert f"Decision: {says}\n" in told
        assert re.search(rf"Decision +{says}", fitted, re.IGNORECASE)


def test_an_encoding_without_our_signs_loses_only_those(tmp_path: Path) -> None:
    """As in a pipe on Windows: the square of R becomes a question mark, and JSON is whole."""
    folder = make(tmp_path / "c", X, [{"x": row["x"], "score": row["score"]} for row in quadratic()])
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    command = [sys.executable, "-m", "seqrsm", "fit", str(folder)]
    done = subprocess.run(command, env=environment, capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (0, b"")
    assert b"R? adjusted" in done.stdout
    done = subprocess.run([*command, "--json"], env=environment, capture_output=True, check=False)
    assert json.loads(done.stdout.decode("ascii"))["n_runs"] == 24
