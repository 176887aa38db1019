"""The South Limburg scene: what SCENE.md says of it holds, and its settings make a radar that sees it."""

from __future__ import annotations

import hashlib
import tomllib
from pathlib import Path

import numpy as np
import pytest
from shorthands import percent_correct

from seqrsm.scattering.sigma0 import load_sigma0_table
from seqrsm.scene.fields import connected_patches
from seqrsm.scene.file import load_scene
from seqrsm.scene.scene import NO_COVER
from seqrsm.scene.statistics import scene_statistics
from seqrsm.sensor.radar import from_settings
from seqrsm.simulate.radar.psm import simulate_radar

FOLDER = Path(__file__).parents[2] / "campaigns" / "limburg-radar"


def test_shipped_scene_is_what_its_page_says():
    path = FOLDER / "scene.npz"
    assert path.stat().st_size < 300_000
    page = (FOLDER / "SCENE.md").read_text(encoding="utf-8")
    assert hashlib.sha256(path.read_bytes()).hexdigest() in page
    scene = load_scene(path)
    assert scene.shape == (550, 430)
    assert (scene.cell_m, scene.epsg, scene.bounds) == (2.0, None, None)
    counts = np.bincount(scene.cover.ravel(), minlength=256)
    for index, name in enumerate(scene.categories):
        assert f"| {index} | {name} |" in page
        assert f"{counts[index]:,} |" in page
    assert f"{counts[NO_COVER]:,} |" in page
    found = scene_statistics(scene)
    assert (found.low_m, found.high_m) == pytest.approx((78.37, 111.40), abs=0.01)
    assert found.rms_slope == pytest.approx(0.056, abs=5e-4)
    assert found.scored_fraction == pytest.approx(0.624, abs=5e-4)
    # Fields hold together: cutting them again along their own numbers changes nothing.
    again = connected_patches(scene.cover, scene.field_id)
    assert again.max() == scene.field_id.max()


def test_the_campaigns_centre_scores_better_than_chance():
    spec = tomllib.loads((FOLDER / "campaign.toml").read_text(encoding="utf-8"))
    radar = from_settings({"frequency": 3.5, "polarization": "HH+HV", "resolution": 7.7}, spec["simulator"]["fixed"])
    scene = load_scene(FOLDER / "scene.npz")
    # The farm has 34 fields of its two crops: which of them teach decides much.
    found = []
    for run in range(1, 7):
        image = simulate_radar(scene, radar, load_sigma0_table(), seed=2019, run_id=run)
        found.append(percent_correct([image], scene, seed=2019, run_id=run).value)
    assert 30.0 < sum(found) / 6 < 95.0
