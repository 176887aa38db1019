"""What commands print with ``--json`` is what ``seqrsm schema COMMAND`` says: every field, and no other."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
import typer
from measured_campaign import FREQUENCY, HEAD, MEASURED, POL, STOP, X, days, make, quadratic
from test_candidates_command import CANDIDATES
from tiny_campaign import TINY, make_tiny
from typer.testing import CliRunner

from seqrsm.campaign import rehearsal
from seqrsm.cli.app import app
from seqrsm.cli.standalone import output_schema

jsonschema = pytest.importorskip("jsonschema")
EXAMPLES = Path(__file__).parents[2] / "campaigns"
TWO = f"""\
{MEASURED}
[[application]]
name = "b"
utility = "measured"
goal = "minimize"
[[consideration]]
name = "expense"
expr = "x + frequency"
goal = "minimize"
unacceptable = 30
ideal = 1
"""


def document(*arguments: object, codes: tuple[int, ...] = (0,)) -> Any:
    """What a command prints, which must be as its schema says."""
    words = [str(one) for one in arguments]
    done = CliRunner().invoke(app, [*words, "--json"])
    assert done.exit_code in codes, done.output
    found = json.loads(done.stdout)
    command = "scene show" if words[0] == "scene" else words[0]
    assert faults(command, found) == []
    return found


def faults(command: str, found: Any) -> list[str]:
    errors = jsonschema.Draft202012Validator(output_schema(command)).iter_errors(found)
    return [f"{one.json_path}: {one.message[:200]}" for one in errors]


def commands_with_json() -> set[str]:
    group = typer.main.get_command(app)
    named = {**group.commands, "scene show": group.commands["scene"].commands["show"]}
    return {name for name, one in named.items() if any("--json" in parameter.opts for parameter in one.params)}


def test_every_command_has_a_schema_and_every_field_is_described() -> None:
    for command in commands_with_json():
        done = CliRunner().invoke(app, ["schema", *command.split()])
        assert done.exit_code == 0, done.output
        schema = json.loads(done.stdout)
        jsonschema.Draft202012Validator.check_schema(schema)
        for definition in schema["$defs"].values():
            fields = definition.get("properties")
            assert definition["description"]
            assert fields is None or definition["additionalProperties"] is False
            assert all(field["description"] for field in (fields or {}).values())
            assert set(definition.get("required", ())) <= set(fields or ())


def test_an_unknown_command_is_told_which_there_are() -> None:
    done = CliRunner().invoke(app, ["schema", "void"])
    assert done.exit_code == 2
    told = done.stderr.replace("\n", " ")
    assert all(command in told for command in commands_with_json())


@pytest.mark.parametrize(
    "words",
    [
        "design --factors 2 --runs 10",
        "design --factor x=1:10 --factor pol=HH,HV --runs 9 --seed 3",
        "catalog",
        "catalog soil moisture",
        "catalog Seasat",
        "catalog A.1",
        "catalog A.32",
        "catalog A.26",
        "parameters psm",
        "parameters prm",
        f"scene show {EXAMPLES}/langegracht-radar/scene.npz",
    ],
)
def test_commands_without_a_campaign(words: str) -> None:
    document(*words.split())


def test_a_campaign_before_its_first_score(tmp_path: Path) -> None:
    shutil.copytree(EXAMPLES / "flevoland", tmp_path / "c")
    assert document("status", tmp_path / "c")["applications"][0]["last_look"] is None
    scores = tmp_path / "c" / "flight_scores.csv"
    (found,) = document("ingest", tmp_path / "c", scores, "--dry-run")
    assert found["n_scores"] == 224
    document("ingest", tmp_path / "c", scores)
    (found,) = document("ingest", tmp_path / "c", scores)
    assert found["already"]["row_count"] == 224


def test_an_empty_campaign_is_planned(tmp_path: Path) -> None:
    (tmp_path / "campaign.toml").write_text(HEAD + X + MEASURED + STOP, encoding="utf-8")
    assert document("check", tmp_path)["noise"] is None
    assert document("propose", tmp_path, "-n", 12)[0]["state"] == "issued"


def test_a_target_that_is_refused(tmp_path: Path) -> None:
    text = HEAD + X + FREQUENCY + MEASURED + STOP + "max_runs = 5\n"
    (tmp_path / "campaign.toml").write_text(text, encoding="utf-8")
    assert document("check", tmp_path, codes=(2,))["refused"]


def test_fits_of_blocks_and_of_tied_levels(tmp_path: Path) -> None:
    blocked, _ = days(24, 2.0, 2)
    model = '[model]\nblock = "block"\nblock_effect = "random"\n'
    assert document("fit", make(tmp_path / "days", X + FREQUENCY, blocked, model))["blocks"]["effect"] == "random"
    places = [(a, b, pol) for a in (-1, -0.5, 0, 0.5, 1) for b in (-1, 1) for pol in ("HH", "VV")]
    alike = [{"x": 5 + 5 * a, "pol": pol, "score": 70 - 9 * a * a + 0.3 * b} for a, b, pol in places]
    assert document("fit", make(tmp_path / "alike", X + POL, alike))["optimum"]["ties"]


def test_a_fit_of_simulations_and_flights_with_a_test(tmp_path: Path) -> None:
    rows = [row | {"source": ("simulation", "flight")[i % 3 == 1]} for i, row in enumerate(quadratic())]
    found = document("fit", make(tmp_path / "c", X + FREQUENCY, rows), "--test", "x")
    assert found["sources"]["n_flights"] == 8
    assert found["tests"][0]["test"] == "x"


def test_fewer_scores_than_terms(tmp_path: Path) -> None:
    folder = make(tmp_path / "c", X + FREQUENCY, quadratic(4))
    assert "4 scored runs" in document("status", folder)["applications"][0]["reason"]


@pytest.mark.usefixtures("few_draws")
def test_several_applications_and_their_compromise(tmp_path: Path) -> None:
    rows = [row | {"application": "a"} for row in quadratic()]
    rows += [row | {"application": "b", "score": -row["score"]} for row in quadratic(24, 1)]
    found = document("fit", make(tmp_path / "c", X + FREQUENCY, rows, "", TWO))
    assert len(found["applications"]) == 2
    assert len(found["compromise"]["given_up"]) == 3


def test_rehearse(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ended = {"held": True, "runs": 20, "loss": 0.1, "rule": 1.0, "prediction": 0.95, "confidence": 1.0}
    monkeypatch.setattr(rehearsal, "_rehearsed", lambda *_: ended)
    found = document("rehearse", make(tmp_path / "c", X, quadratic()), "--campaigns", 10)
    assert found["campaigns"] == 10


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory, tiny_scene: Path) -> Path:
    folder = make_tiny(tmp_path_factory.mktemp("schemas") / "tiny", tiny_scene, TINY + CANDIDATES)
    document("propose", folder)
    document("simulate", folder)
    document("run", folder, "--max-runs", 16, codes=(0, 3))
    return folder


@pytest.mark.parametrize("words", ["status --history", "fit", "check", "candidates --worlds 4", "tradeoff"])
def test_a_campaign_with_a_simulator(simulated: Path, words: str) -> None:
    command, *options = words.split()
    document(command, simulated, *options)


def test_images_and_masks(simulated: Path, tmp_path: Path) -> None:
    document("image", simulated, "--out", tmp_path / "a.npz", "--mask", "shadow")
    shutil.copytree(EXAMPLES / "wake-radiometer", tmp_path / "c")
    assert document("image", tmp_path / "c", "--out", tmp_path / "a.png")["record"]["engine"] == "prm"


def test_another_field_a_missing_one_and_a_wrong_type_are_faults(simulated: Path) -> None:
    found = document("status", simulated)
    look = found["applications"][0]["last_look"]
    for wrong in ({"new": 1}, {"held": None}, {"optimum": {}}):
        changed = found | {"applications": [found["applications"][0] | {"last_look": look | wrong}]}
        assert faults("status", changed)
    assert faults("status", {name: value for name, value in found.items() if name != "held"})
