"""The radiometer campaign's scene: what SCENE.md says of it holds, and its settings make a radiometer that runs."""

from __future__ import annotations

import hashlib
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from shorthands import percent_correct

from seqrsm.errors import ConfigurationError
from seqrsm.scattering.emissivity import load_emissivity_table
from seqrsm.scene.fields import connected_patches
from seqrsm.scene.file import load_scene
from seqrsm.scene.scene import NO_COVER
from seqrsm.scene.statistics import scene_statistics
from seqrsm.sensor.radiometer import from_settings
from seqrsm.simulate.radiometer.prm import check_radiometer, simulate_radiometer

FOLDER = Path(__file__).parents[2] / "campaigns" / "wake-radiometer"


def test_shipped_scene_is_what_its_page_says():
    path = FOLDER / "scene.npz"
    assert path.stat().st_size < 1_000_000
    page = (FOLDER / "SCENE.md").read_text(encoding="utf-8")
    assert hashlib.sha256(path.read_bytes()).hexdigest() in page
    scene = load_scene(path)
    assert scene.shape == (450, 500)
    assert (scene.cell_m, scene.epsg) == (30.0, 32119)
    counts = np.bincount(scene.cover.ravel(), minlength=256)
    for index, name in enumerate(scene.categories):
        assert f"| {name} |" in page
        assert f"{counts[index]:,} |" in page
    assert counts[NO_COVER] == 450
    found = scene_statistics(scene)
    assert (found.low_m, found.high_m) == pytest.approx((55.17, 156.39), abs=0.01)
    assert found.rms_slope == pytest.approx(0.051, abs=5e-4)
    np.testing.assert_array_equal(connected_patches(scene.field_id), scene.field_id)
    table = load_emissivity_table()
    assert set(scene.categories) <= {*table.curves, *table.mixes}


def test_campaign_names_a_radiometer_that_scores():
    spec = tomllib.loads((FOLDER / "campaign.toml").read_text(encoding="utf-8"))
    assert spec["simulator"]["engine"] == "prm"
    middle = {f["name"]: (f["low"] * f["high"]) ** 0.5 if "low" in f else f["levels"][-1] for f in spec["factor"]}
    assert middle["resolution"] * middle["frequency"] >= 1100.0
    scene = load_scene(FOLDER / "scene.npz")
    radiometer = from_settings(middle, spec["simulator"]["fixed"])
    image = simulate_radiometer(scene, radiometer, load_emissivity_table(), seed=1979, run_id=1)
    scan = check_radiometer(scene, radiometer, load_emissivity_table())
    assert (scan.n_lines, scan.notes) == (image.scan.n_lines, image.scan.notes)
    np.testing.assert_array_equal(scan.look_rad, image.scan.look_rad)
    with pytest.raises(ConfigurationError, match="antenna"):
        check_radiometer(scene, replace(radiometer, resolution_m=20.0), load_emissivity_table())
    score = percent_correct([image], scene, seed=1979, run_id=1)
    assert 55.0 < score.value < 85.0
    assert 0.5 < score.se < 4.0
    # The antenna's limit is the constraint: at its edge the beam can just be made.
    for frequency in (12.0, 36.0):
        edge = {**middle, "frequency": frequency, "resolution": max(1100.0 / frequency, 50.0)}
        made = from_settings(edge, spec["simulator"]["fixed"])
        assert made.antenna_m(6000.0 - 104.0) <= made.antenna_limit_m
