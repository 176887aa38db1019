"""Large scenes are worked on in strips of rows: these give what the whole gives."""

from __future__ import annotations

from dataclasses import asdict, replace

import numpy as np
import pytest
from synthetic import synthetic_scene

from seqrsm.scene import terrain
from seqrsm.scene.file import load_scene, save_scene
from seqrsm.scene.statistics import scene_statistics


def made():
    return synthetic_scene(67, 90, 5.0, categories=("Wheat", "Trees"), field_m=60.0, relief_m=30.0, seed=3)


@pytest.mark.parametrize("cells", [1, 400, 1000])
def test_strips_have_the_same_statistics(monkeypatch, cells):
    whole = made()
    holes = whole.elevation_m.copy()
    holes[20:23, 30:35] = np.nan
    holed = replace(whole, elevation_m=holes, scored=whole.scored & np.isfinite(holes))
    wanted = [asdict(scene_statistics(scene)) for scene in (whole, holed)]
    monkeypatch.setattr(terrain, "_CELLS_AT_ONCE", cells)
    for scene, expected in zip((whole, holed), wanted, strict=True):
        for name, value in asdict(scene_statistics(scene)).items():
            assert value == pytest.approx(expected[name], rel=1e-13), name


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
