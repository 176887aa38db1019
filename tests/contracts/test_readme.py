"""README and guides: their commands exist, their campaign.toml is valid, two commands are where the gate looks."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path

import pytest
import typer
from synthetic import synthetic_scene
from typer.testing import CliRunner, Result

from seqrsm.cli.app import app
from seqrsm.cli.guides import topics
from seqrsm.scattering.calendar import load_calendar
from seqrsm.scene.file import save_scene
from seqrsm.spec.read import load_spec

ROOT = Path(__file__).parents[2]
PAGES = {
    name: (ROOT / name).read_text(encoding="utf-8")
    for name in ("README.md", "campaigns/README.md", "reports/README.md", "seqrsm/README.md")
}
README, GUIDE = PAGES["README.md"], PAGES["campaigns/README.md"]
ALL = "\n".join(PAGES.values())
LINES = re.findall(r"^(?:    |\$ )seqrsm (.+?)(?:\s+#.*)?$", ALL, flags=re.M)
INLINE = re.findall(r"`seqrsm ([^`]+)`", ALL)


def test_two_commands_stand_indented() -> None:
    commands = re.findall(r"^    (python3 .*)$", README, flags=re.M)
    assert len(commands) == 2
    assert commands[0].endswith("seqrsm run campaigns/langegracht-radar")
    assert commands[1].endswith("pytest -n 2")


@pytest.mark.parametrize("line", sorted({*LINES, *INLINE}))
def test_command_and_options_exist(line: str) -> None:
    command = typer.main.get_command(app)
    words = line.split("&&")[0].split()
    while hasattr(command, "commands") and not words[0].startswith("-"):
        command = command.commands[words.pop(0)]
    known = {option for parameter in command.params for option in parameter.opts}
    for word in words:
        if word.startswith("-") and not re.match(r"-\d", word):
            assert word in known, f"seqrsm {line}: {word} is no option"


def test_campaign_file_is_valid(tmp_path: Path) -> None:
    (text,) = re.findall(r"```toml\n(.*?)```", GUIDE, flags=re.S)
    save_scene(synthetic_scene(20, 30, 5.0, categories=["Grass"], relief_m=1.0, seed=1), tmp_path / "scene.npz")
    (tmp_path / "campaign.toml").write_text(text, encoding="utf-8")
    spec = load_spec(tmp_path)
    assert spec.region.names == ("resolution", "polarization")


@pytest.mark.parametrize("page", PAGES)
def test_pictures_and_pages_that_it_names_are_there(page: str) -> None:
    for name in re.findall(r"\]\(((?!http)[^)#]+)\)", PAGES[page]):
        assert ((ROOT / page).parent / name).exists(), name


def test_readme_is_a_page_and_a_half_with_few_links() -> None:
    assert len(README.splitlines()) <= 120
    assert len(re.findall(r"^\* \[", README, flags=re.M)) == 5


def test_help_prints_each_part_of_the_guides() -> None:
    listed = CliRunner().invoke(app, ["help"])
    assert listed.exit_code == 0
    titles = [line.strip() for line in listed.stdout.splitlines()]
    assert len(titles) == len(topics()) > 30
    for topic in topics():
        shown = CliRunner().invoke(app, ["help", *topic.title.replace("`", "").split()])  # as a shell passes it
        assert shown.exit_code == 0, shown.output
        assert topic.title in shown.stdout
        assert not re.search(r"\]\(|^\||^!", shown.stdout, re.M)  # links, tables and pictures are no text
    assert "Recommended for ground-cover" in CliRunner().invoke(app, ["help", "ten", "minutes"]).stdout  # what it holds
    assert "Plackett-Luce" in CliRunner().invoke(app, ["help", "rankings"]).stdout
    assert CliRunner().invoke(app, ["help", "no such matter"]).exit_code == 2


def test_guides_are_shipped() -> None:
    """The wheel's file list, by the rules of pyproject.toml, holds what `seqrsm help` reads."""
    rules = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["hatch"]["build"]["targets"]
    assert "/reports/README.md" in rules["wheel"]["include"]
    assert rules["wheel"]["sources"] == {"campaigns": "seqrsm/_campaigns", "reports": "seqrsm/_reports"}


def test_own_table_and_utility_work_as_written(tmp_path: Path) -> None:
    for name, block in zip(
        ("mine.csv", "crops.csv"), re.findall(r"((?:    (?:quantity,category|sigma0,).*\n)+)", GUIDE), strict=True
    ):
        (tmp_path / name).write_text(re.sub(r"^    ", "", block, flags=re.M), encoding="utf-8")
    assert load_calendar(tmp_path / "crops.csv").own["Soybean"]["HV"].change[0, 29] == 0.5
    (code,) = re.findall(r"```python\n(.*?)```", GUIDE, flags=re.S)
    (tmp_path / "mine.py").write_text(code, encoding="utf-8")
    (text,) = re.findall(r"```toml\n(.*?)```", GUIDE, flags=re.S)
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
