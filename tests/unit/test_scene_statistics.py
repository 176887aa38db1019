"""Statistics of a scene whose elevations are not all known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from synthetic import synthetic_scene
from typer.testing import CliRunner

from seqrsm.cli.app import app
from seqrsm.scene.file import load_scene, save_scene
from seqrsm.scene.statistics import scene_statistics


def made() -> object:
    return synthetic_scene(40, 50, 10.0, categories=("Wheat", "Trees"), field_m=90.0, relief_m=30.0, seed=3)


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
