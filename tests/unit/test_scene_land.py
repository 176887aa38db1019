"""Fields, slopes and statistics against closed forms and scipy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage
from scipy.spatial import cKDTree

from seqrsm.scene.fields import _mix, connected_patches, draw_index, hash_uniform, voronoi_labels
from seqrsm.scene.terrain import rms_slope, slopes


def test_hash_is_splitmix64() -> None:
    """First outputs of splitmix64 seeded with 1234567, as published with the reference code."""
    golden = 0x9E3779B97F4A7C15
    state = np.array([(1234567 + i * golden) % 2**64 for i in (1, 2, 3)], dtype=np.uint64)
    assert _mix(state).tolist() == [6457827717110365317, 3203168211198807973, 9817491932198370423]


def test_hash_uniform_is_uniform_and_seeded() -> None:
    draws = hash_uniform(np.arange(100_000), seed=5)
    count = np.histogram(draws, bins=100, range=(0.0, 1.0))[0]
    assert np.sum((count - 1000.0) ** 2 / 1000.0) < 149.0  # chi-square with 99 degrees of freedom, p = 0.001
    assert abs(np.corrcoef(draws, hash_uniform(np.arange(100_000), seed=6))[0, 1]) < 0.01
    assert abs(np.corrcoef(draws[1:], draws[:-1])[0, 1]) < 0.01
    np.testing.assert_array_equal(draws[[7, 3]], hash_uniform([7, 3], seed=5))


@pytest.mark.parametrize(("rows", "cols", "spacing"), [(60, 83, 9), (5, 7, 20), (23, 17, 1)])
def test_voronoi_is_the_nearest_centre(rows: int, cols: int, spacing: int) -> None:
    label = voronoi_labels(rows, cols, spacing, seed=2)
    n_cols = -(-cols // spacing) + 4
    number = np.arange((-(-rows // spacing) + 4) * n_cols)
    row = (number // n_cols - 2) * spacing + np.floor(hash_uniform(2 * number, 2) * spacing)
    col = (number % n_cols - 2) * spacing + np.floor(hash_uniform(2 * number + 1, 2) * spacing)
    centre = np.column_stack([row, col])
    cell = np.argwhere(np.ones((rows, cols), bool))
    nearest = cKDTree(centre).query(cell)[0]
    got = np.hypot(*(cell - centre[label.ravel()]).T)
    np.testing.assert_allclose(got, nearest)


def test_patches_are_the_connected_components() -> None:
    key = (hash_uniform(np.arange(40 * 50), 1).reshape(40, 50) * 3).astype(int)
    patch = connected_patches(key)
    number = 0
    for value in range(3):
        label, n = ndimage.label(key == value)
        number += n
        for i in range(1, n + 1):
            assert np.unique(patch[label == i]).size == 1
    assert patch.max() + 1 == number
    first = np.unique(patch, return_index=True)[1]
    assert np.all(np.diff(first) > 0)


def test_draws_follow_shares() -> None:
    index = draw_index(np.arange(50_000), [3.0, 0.0, 1.0], seed=9)
    count = np.bincount(index, minlength=3)
    assert count[1] == 0
    assert count[0] / 50_000 == pytest.approx(0.75, abs=4.0 * np.sqrt(0.75 * 0.25 / 50_000))


def test_slopes_of_a_plane() -> None:
    north, east = np.mgrid[0:6, 0:8] * 5.0
    got_east, got_north = slopes((0.3 * east - 0.1 * north).astype(np.float32), 5.0)
    assert got_east == pytest.approx(np.full((6, 8), 0.3), abs=1e-6)
    assert got_north == pytest.approx(np.full((6, 8), 0.1), abs=1e-6)  # row 0 is north: rows go south
    assert rms_slope(0.3 * east - 0.1 * north, 5.0) == pytest.approx(np.sqrt(0.05))
