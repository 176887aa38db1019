"""README: its commands and options exist, its campaign.toml is valid, its two commands are where the gate looks."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import typer

from seqrsm.campaign.spec import load_spec
from seqrsm.cli.app import app
from seqrsm.scene.scene import save_scene
from seqrsm.scene.synthetic import synthetic_scene

README = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")
LINES = re.findall(r"^(?:    |\$ )seqrsm (.+?)(?:\s+#.*)?$", README, flags=re.M)
INLINE = re.findall(r"`seqrsm ([^`]+)`", README)


def test_two_commands_stand_indented() -> None:
    commands = re.findall(r"^    (python3 .*)$", README, flags=re.M)
    assert len(commands) == 2
    assert commands[0].endswith("seqrsm run campaigns/langegracht-radar")
    assert commands[1].endswith("pytest -n 2")


@pytest.mark.parametrize("line", sorted({*LINES, *INLINE}))
def test_command_and_options_exist(line: str) -> None:
    group = typer.main.get_command(app)
    words = line.split("&&")[0].split()
    command = group.commands[words.pop(0)]
    while hasattr(command, "commands"):
        command = command.commands[words.pop(0)]
    known = {option for parameter in command.params for option in parameter.opts}
    for word in words:
        if word.startswith("-") and not re.match(r"-\d", word):
            assert word in known, f"seqrsm {line}: {word} is no option"


def test_campaign_file_is_valid(tmp_path: Path) -> None:
    (text,) = re.findall(r"```toml\n(.*?)```", README, flags=re.S)
    save_scene(synthetic_scene(20, 30, 5.0, categories=["Grass"], relief_m=1.0, seed=1), tmp_path / "scene.npz")
    (tmp_path / "campaign.toml").write_text(text, encoding="utf-8")
    spec = load_spec(tmp_path)
    assert spec.region.names == ("resolution", "polarization")


def test_pictures_and_pages_that_it_names_are_there() -> None:
    root = Path(__file__).parents[2]
    for name in re.findall(r"\]\(((?!http)[^)#]+)\)", README):
        assert (root / name).exists(), name
