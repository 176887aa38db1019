"""Statistics of a scene are kept with its file, and are used for the very layers that they are of only."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from seqrsm.cli.app import app
from seqrsm.scene import statistics
from seqrsm.scene.file import load_scene, save_scene
from seqrsm.scene.statistics import scene_statistics
from seqrsm.scene.synthetic import synthetic_scene

ROOT = Path(__file__).parents[2]


def made() -> object:
    return synthetic_scene(40, 50, 10.0, categories=("Wheat", "Trees"), field_m=90.0, relief_m=30.0, seed=3)


def refuse(scene: object) -> None:
    raise AssertionError(f"computed again: {scene}")


def test_a_file_keeps_what_was_computed_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = made()
    wanted = asdict(scene_statistics(scene))
    save_scene(scene, tmp_path / "s.npz")
    monkeypatch.setattr(statistics, "_computed", refuse)
    assert asdict(scene_statistics(load_scene(tmp_path / "s.npz"))) == wanted


@pytest.mark.parametrize("change", ["elevation_m", "cover", "field_id", "scored", "cell_m"])
def test_changed_layers_get_statistics_of_their_own(tmp_path: Path, change: str) -> None:
    save_scene(made(), tmp_path / "s.npz")
    scene = load_scene(tmp_path / "s.npz")
    if change == "cell_m":
        other = replace(scene, cell_m=20.0)
    else:
        layer = getattr(scene, change).copy()
        if change == "cover":
            layer = 1 - layer
        elif change == "field_id":
            layer[:20] += scene.n_fields
        else:
            layer[:7, :9] = {"elevation_m": 900.0, "scored": False}[change]
        other = replace(scene, **{change: layer})
    fresh = replace(other, kept_statistics="")
    assert asdict(scene_statistics(other)) == asdict(scene_statistics(fresh))
    assert asdict(scene_statistics(other)) != asdict(scene_statistics(scene))


@pytest.mark.parametrize("text", ["", "{", "[]", "7", "null", '{"of": "x"}', '{"statistics": {}}', "[" * 5000])
def test_spoilt_statistics_are_computed(text: str) -> None:
    scene = made()
    assert scene_statistics(replace(scene, kept_statistics=text)) == scene_statistics(scene)


def test_statistics_of_other_names_are_computed() -> None:
    scene = made()
    kept = json.loads(statistics.statistics_text(scene))
    kept["statistics"]["another"] = 1.0
    assert scene_statistics(replace(scene, kept_statistics=json.dumps(kept))) == scene_statistics(scene)


@pytest.mark.parametrize("name", ["crops-and-moisture", "langegracht-radar", "limburg-radar", "wake-radiometer"])
def test_shipped_scenes_hold_theirs(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = load_scene(ROOT / "campaigns" / name / "scene.npz")
    wanted = asdict(scene_statistics(replace(scene, kept_statistics="")))
    monkeypatch.setattr(statistics, "_computed", refuse)
    for key, value in asdict(scene_statistics(scene)).items():
        assert value == wanted[key] or np.allclose(value, wanted[key], rtol=1e-9), key


def test_a_scene_with_one_known_elevation_has_statistics(tmp_path: Path) -> None:
    scene = made()
    z = np.full_like(scene.elevation_m, np.nan)
    z[5, 5] = 12.0
    lone = replace(scene, elevation_m=z, scored=np.isfinite(z))
    save_scene(lone, tmp_path / "s.npz")
    found = scene_statistics(load_scene(tmp_path / "s.npz"))
    assert (found.rms_slope, found.max_slope, found.low_m, found.high_m) == (0.0, 0.0, 12.0, 12.0)


def test_a_scene_without_elevations_is_shown_without_warnings(tmp_path: Path) -> None:
    scene = made()
    z = np.full_like(scene.elevation_m, np.nan)
    save_scene(replace(scene, elevation_m=z, scored=np.isfinite(z)), tmp_path / "s.npz")
    result = CliRunner().invoke(app, ["scene", "show", str(tmp_path / "s.npz")])
    assert result.exit_code == 0, repr(result.exception)
    assert "low_m: -" in result.stdout
