"""Statistics of a scene whose elevations are not all known."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
from synthetic import synthetic_scene
from typer.testing import CliRunner

from seqrsm.cli.app import app
from seqrsm.scene.file import load_scene, save_scene
from seqrsm.scene.scene import NO_COVER
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
    assert re.search(r"^elevation +- to - m$", result.stdout, re.MULTILINE)


def test_a_scene_is_shown_in_words_and_units(tmp_path: Path) -> None:
    save_scene(made(), tmp_path / "s.npz")
    result = CliRunner().invoke(app, ["scene", "show", str(tmp_path / "s.npz")])
    for words in (
        r"elevation +0\.000 to 30\.00 m",
        r"scored cells +100 %",
        r"fields +\d+, median [\d.]+ ha by area",
        r"slope +rms [\d.]+ m/m, at most [\d.]+ m/m",
    ):
        assert re.search(rf"^{words}$", result.stdout, re.MULTILINE), result.stdout
    assert "_" not in result.stdout


def test_ground_of_no_cover_is_no_field() -> None:
    """It was the largest of all, and the median by area where it covers more than half of the scene."""
    scene = made()
    all_of_it = scene_statistics(scene)
    cover = np.pad(scene.cover, ((0, 80), (0, 0)), constant_values=NO_COVER)
    rest = {name: np.pad(getattr(scene, name), ((0, 80), (0, 0))) for name in ("elevation_m", "scored")}
    field = np.pad(scene.field_id, ((0, 80), (0, 0)), constant_values=scene.n_fields)
    found = scene_statistics(replace(scene, cover=cover, field_id=field, **rest))
    assert (found.n_fields, found.median_field_m2) == (all_of_it.n_fields, all_of_it.median_field_m2)
    assert found.category_fractions == {"Wheat": np.mean(scene.cover == 0), "Trees": np.mean(scene.cover == 1)}
    bare = replace(scene, cover=np.full_like(scene.cover, NO_COVER), scored=np.zeros_like(scene.scored))
    assert scene_statistics(bare).n_fields == 0
