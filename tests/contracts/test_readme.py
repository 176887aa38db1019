"""README: its commands and options exist, its campaign.toml is valid, its two commands are where the gate looks."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner, Result

from seqrsm.cli.app import app
from seqrsm.scene.file import save_scene
from seqrsm.scene.synthetic import synthetic_scene
from seqrsm.spec.read import load_spec

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


def test_own_table_and_utility_work_as_written(tmp_path: Path) -> None:
    (block,) = re.findall(r"((?:    (?:quantity,category|sigma0,).*\n)+)", README)
    (tmp_path / "mine.csv").write_text(re.sub(r"^    ", "", block, flags=re.M), encoding="utf-8")
    (code,) = re.findall(r"```python\n(.*?)```", README, flags=re.S)
    (tmp_path / "mine.py").write_text(code, encoding="utf-8")
    (text,) = re.findall(r"```toml\n(.*?)```", README, flags=re.S)
    text = text.replace('# table = "mine.csv"', 'table = "mine.csv"').replace('"percent_correct"', '"mine:score"')
    (tmp_path / "campaign.toml").write_text(text.replace('["HH", "HH+HV"]', '["HH", "HV"]'), encoding="utf-8")
    scene = synthetic_scene(40, 60, 10.0, categories=["Grass", "Rapeseed"], field_m=80.0, relief_m=5.0, seed=1)
    save_scene(scene, tmp_path / "scene.npz")

    def image(polarization: str) -> Result:
        arguments = ["--set", f"polarization={polarization}", "--set", "resolution=30", "--json"]
        return CliRunner().invoke(app, ["image", str(tmp_path), *arguments, "--out", str(tmp_path / "i.npz")])

    found = image("HH")
    assert found.exit_code == 0, found.output
    assert json.loads(found.stdout)["scores"]["ground-cover"] > 0.0
    missing = image("HV")
    assert missing.exit_code == 2
    assert "Rapeseed" in missing.output
    assert "HV" in missing.output
