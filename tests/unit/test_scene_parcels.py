"""Parcels, ground truth and fields of a stated size in imported scenes."""

from __future__ import annotations

import numpy as np
import pytest
from test_scene_raster import command, write

from seqrsm.scene.fields import cut_patches
from seqrsm.scene.file import load_scene
from seqrsm.scene.raster import import_scene

ROWS, COLS, CELL, LEFT = 60, 80, 10.0, 1000.0


@pytest.fixture
def files(tmp_path):
    """One cover on flat ground."""
    (tmp_path / "legend.csv").write_text("code,category\n1,Wheat\n2,Trees\n", encoding="utf-8")
    return {
        "elevation": write(tmp_path / "z.tif", np.full((ROWS, COLS), 30.0, np.float32), CELL),
        "cover": write(tmp_path / "c.tif", np.ones((ROWS, COLS), np.uint8), CELL),
        "legend": tmp_path / "legend.csv",
    }


@pytest.fixture
def drawn():
    """Parcels 1 and 2, and 0 between them."""
    i, j = np.mgrid[0:ROWS, 0:COLS]
    return np.where((i - 20) ** 2 + (j - 30) ** 2 < 150, 1, np.where((i > 40) & (j > 50), 2, 0)).astype(np.uint8)


def test_parcels_divide_a_cover(files, drawn, tmp_path):
    assert import_scene(**files).n_fields == 1
    # The raster of parcels may be smaller than the site: beyond it there is none.
    parcels = write(tmp_path / "p.tif", drawn[:, 10:], CELL, left=LEFT + 10 * CELL)
    fields = import_scene(**files, layers={"parcels": parcels}).field_id
    assert np.array_equal(fields, np.where(drawn == 0, 0, drawn))
    cut = import_scene(**files, layers={"parcels": parcels}, field_m=50.0).field_id
    for k in (1, 2):
        assert len(np.unique(cut[drawn == k])) == 1
        assert not set(np.unique(cut[drawn == k])) & set(np.unique(cut[drawn != k]))
    assert len(np.unique(cut[drawn == 0])) > 50


def test_only_truth_is_scored_and_it_overrules_the_cover(files, drawn, tmp_path):
    seen = write(tmp_path / "t.tif", np.where(drawn == 1, 2, 255).astype(np.uint8), CELL, nodata=255)
    scene = import_scene(**files, layers={"truth": seen})
    assert np.array_equal(scene.scored, drawn == 1)
    assert np.array_equal(scene.cover, (drawn == 1).astype(np.uint8))


def test_large_patches_are_cut_to_the_stated_size_and_small_ones_are_not():
    patch = np.zeros((300, 400), dtype=np.int32)
    patch[:12, :12] = 1
    fields = cut_patches(patch, 10, np.zeros(patch.shape, dtype=bool), seed=1)
    sizes = np.bincount(fields.ravel())
    assert sizes[fields[0, 0]] == 144
    assert np.unique(fields[:12, :12]).size == 1
    assert sizes.mean() == pytest.approx(100.0, rel=0.1)
    assert 60 < np.median(sizes) < 140
    assert np.array_equal(fields, cut_patches(patch, 10, np.zeros(patch.shape, dtype=bool), seed=1))
    assert not np.array_equal(fields, cut_patches(patch, 10, np.zeros(patch.shape, dtype=bool), seed=2))


def test_the_command_tells_of_fields_and_warns_of_large_ones(files, tmp_path):
    files["elevation"] = write(tmp_path / "z.tif", np.full((60, 80), 30.0, np.float32), 50.0)
    files["cover"] = write(tmp_path / "c.tif", np.ones((60, 80), np.uint8), 50.0)
    plain = " ".join(command(files, tmp_path / "s.npz").output.split())
    assert "fields: 1, median 1.2e+03 ha by area" in plain
    assert "--field-m 150" in plain
    done = " ".join(command(files, tmp_path / "s.npz", "--field-m", "200").output.split())
    assert "(patches of cover: 1, 1.2e+03 ha)" in done
    assert "warning" not in done
    n = load_scene(tmp_path / "s.npz").n_fields
    assert f"fields: {n}, median" in done
    assert n == pytest.approx(60 * 80 / 16, rel=0.2)
    for wrong in ("20", "inf", "1e300"):
        refused = command(files, tmp_path / "s.npz", "--field-m", wrong)
        assert refused.exit_code == 2
        assert "a field is from a cell of 50 m" in " ".join(refused.output.split())
