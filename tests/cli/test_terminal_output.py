"""What a terminal and a pipe get: width, colours, rules, trailing blanks, and statements in order."""

from __future__ import annotations

import os
import pty
import re
import select
import struct
import sys
import termios
from fcntl import ioctl
from pathlib import Path

import pytest
from tiny_campaign import make_tiny
from typer.testing import CliRunner

from seqrsm.campaign.notes import group_notes, summarise_notes
from seqrsm.cli.app import app

NOTES = (
    "Wheat: short vegetation (computed: flevoland)",
    "Wheat: 2.6 GHz interpolated between 1.25 and 3 GHz",
    "Corn: 2.6 GHz interpolated between 1.25 and 3 GHz",
    "Corn HH: field sd 1.50 dB (assumed: assumed_variability)",
    "Corn HV: field sd 1.50 dB (assumed: assumed_variability)",
    "antenna gain is the same over the swath",
    "antenna gain is the same over the swath",
)


def on_terminal(*arguments: object, **environment: str) -> str:
    """Output of a command on a terminal of 80 columns."""
    child, terminal = pty.fork()
    if child == 0:
        ioctl(1, termios.TIOCSWINSZ, struct.pack("HHHH", 50, 80, 0, 0))
        kept = {name: value for name, value in os.environ.items() if name not in ("NO_COLOR", "FORCE_COLOR", "CI")}
        settings = {**kept, "TERM": "xterm-256color", "COLUMNS": "80", "LINES": "50", **environment}
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


def test_notes_are_grouped_by_what_they_are_about():
    grouped = group_notes(NOTES, ("Wheat", "Corn"))
    assert dict(grouped.about_covers)["2.6 GHz interpolated between 1.25 and 3 GHz"] == ("Wheat", "Corn")
    assert [(cover, channel) for cover, channel, _ in grouped.about_channels] == [("Corn", "HH"), ("Corn", "HV")]
    assert grouped.others == ("antenna gain is the same over the swath",)
    lines = summarise_notes(NOTES, ("Wheat", "Corn"))
    assert lines[0] == "mean backscatter of 2 covers: 1 computed, 2 derived"
    assert lines[1] == "scatter among fields and dates, 2 pairs of cover and channel: 2 assumed"


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
    long = CliRunner().invoke(app, ["check", str(folder), "-v"])
    assert short.exit_code == long.exit_code == 0, short.output + long.output
    assert short.stdout.count("\n- ") < 15 < long.stdout.count("\n- ")
    assert "mean backscatter of 3 covers" in short.stdout
    assert short.stdout.rstrip().endswith("All is in order.")


@pytest.mark.parametrize("command", [["catalog", "soil", "moisture"], ["init", "--list"], ["catalog"]])
def test_piped_output_is_plain(command) -> None:
    text = CliRunner().invoke(app, command).stdout
    assert text
    assert not re.search(r"[\u2500-\u257f\x1b\u00a0\u2212]", text)
    assert all(line == line.rstrip() for line in text.splitlines())
