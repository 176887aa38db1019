"""Large scenes are worked on in strips of rows: these give what the whole gives."""

from __future__ import annotations

from dataclasses import asdict, replace

import numpy as np
import pytest

from seqrsm.scene import terrain
from seqrsm.scene.file import load_scene, save_scene
from seqrsm.scene.statistics import scene_statistics
from seqrsm.scene.synthetic import synthetic_scene


def made():
    return synthetic_scene(67, 90, 5.0, categories=("Wheat", "Trees"), field_m=60.0, relief_m=30.0, seed=3)


@pytest.mark.parametrize("cells", [1, 400, 1000])
def test_strips_make_the_same_scene_and_statistics(monkeypatch, cells):
    whole = made()
    holes = whole.elevation_m.copy()
    holes[20:23, 30:35] = np.nan
    holed = replace(whole, elevation_m=holes, scored=whole.scored & np.isfinite(holes))
    wanted = [asdict(scene_statistics(scene)) for scene in (whole, holed)]
    monkeypatch.setattr(terrain, "_CELLS_AT_ONCE", cells)
    again = made()
    for layer in ("elevation_m", "cover", "field_id", "scored"):
        np.testing.assert_array_equal(getattr(again, layer), getattr(whole, layer))
    for scene, expected in zip((whole, holed), wanted, strict=True):
        for name, value in asdict(scene_statistics(scene)).items():
            assert value == pytest.approx(expected[name], rel=1e-13), name


def test_terrain_is_the_filtered_noise_of_its_seed():
    rows, cols, exponent, seed = 21, 34, 3.1, 5
    noise = np.random.default_rng(seed).standard_normal((2 * rows, 2 * cols))
    k = np.hypot(np.fft.fftfreq(2 * rows)[:, None], np.fft.fftfreq(2 * cols)[None, :])
    k[0, 0] = np.inf
    whole = np.fft.ifft2(np.fft.fft2(noise) * k ** (-0.5 * exponent)).real[:rows, :cols]
    expected = 12.0 * (whole - whole.min()) / np.ptp(whole)
    got = terrain.fractal_terrain(rows, cols, relief_m=12.0, exponent=exponent, seed=seed)
    np.testing.assert_allclose(got, expected, atol=1e-11)


@pytest.mark.parametrize("row", [np.nan, 400.0, 0.123456])
def test_elevations_come_back_whatever_a_late_row_holds(tmp_path, row):
    # Centimetres in 16 bits hold all rows or none.
    scene = made()
    heights = np.round(scene.elevation_m, 2).astype(np.float32)
    heights[-1] = row
    scene = replace(scene, elevation_m=heights, scored=scene.scored & np.isfinite(heights))
    save_scene(scene, tmp_path / "s.npz")
    np.testing.assert_array_equal(load_scene(tmp_path / "s.npz").elevation_m, heights)
    with np.load(tmp_path / "s.npz") as members:
        assert ("elevation_cm" in members.files) == (row != row)
