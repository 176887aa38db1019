"""A data base of wider cells against sums by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from synthetic import synthetic_scene

from seqrsm.scene.layers import cells_in_one, centres_of_fields, coarse_scene


def made(rows=43, cols=50):
    return synthetic_scene(rows, cols, 10.0, categories=("Wheat", "Trees"), field_m=90.0, relief_m=30.0, seed=3)


def test_elevations_are_means_and_the_rest_is_that_of_the_middle_cell() -> None:
    scene = made()
    z = scene.elevation_m.copy()
    z[0, 0] = z[6, 6] = np.nan  # at the edge of a block, and in the middle of one
    kelvin = np.random.default_rng(1).uniform(280.0, 300.0, z.shape).astype(np.float32)
    scene = replace(scene, elevation_m=z, scored=np.isfinite(z), temperature_k=kelvin)
    found = coarse_scene(scene, 4)
    assert found.shape == (10, 12)
    assert found.cell_m == 40.0
    assert found.elevation_m[0, 0] == pytest.approx(np.nanmean(z[:4, :4]))
    assert np.isnan(found.elevation_m[1, 1])
    assert found.temperature_k[9, 11] == pytest.approx(kelvin[36:40, 44:48].mean())
    for name in ("cover", "field_id", "scored"):
        assert np.array_equal(getattr(found, name), getattr(scene, name)[2:40:4, 2:48:4]), name


def test_a_data_base_that_would_be_too_small_stays() -> None:
    scene = made(20, 60)
    assert coarse_scene(scene, 1) is scene
    assert coarse_scene(scene, 4) is scene
    assert coarse_scene(scene, 2).shape == (10, 30)
    own = np.arange(1200, dtype=np.int32).reshape(20, 60)
    assert coarse_scene(replace(scene, field_id=own), 2).shape == (20, 60)


@pytest.mark.parametrize(
    ("cell_m", "detail_m", "cells", "wanted"),
    [(5.0, 20.0, 0, 1), (5.0, 20.0, 4, 1), (5.0, 20.0, 2, 2), (5.0, 39.0, 2, 2), (5.0, 40.0, 2, 4), (1.0, 1e4, 2, 16)],
)
def test_blocks_leave_so_many_cells_in_a_pixel(cell_m, detail_m, cells, wanted) -> None:
    assert cells_in_one(cell_m, detail_m, cells) == wanted


def test_a_field_lies_where_its_cells_do() -> None:
    """Of the first two rows and of the rest of 6 by 4 cells of 10 m, from the north-western corner."""
    whole = made(6, 4)
    field = np.repeat([0, 0, 1, 1, 1, 1], 4).reshape(6, 4).astype(np.int32)
    scene = replace(whole, field_id=field, cover=np.zeros_like(whole.cover))
    np.testing.assert_allclose(centres_of_fields(scene), [[10.0, 40.0], [20.0, 20.0]])
