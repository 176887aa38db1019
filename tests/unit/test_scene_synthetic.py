"""Synthetic scenes: what a seed draws and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from seqrsm.errors import SceneError
from seqrsm.scene.synthetic import synthetic_scene


def land(seed=4, relief_m=40.0):
    return synthetic_scene(200, 260, 5.0, categories=("Wheat", "Grass"), relief_m=relief_m, seed=seed)


def test_the_seed_is_all():
    one, two, other = land(), land(), land(seed=5)
    for layer in ("elevation_m", "cover", "field_id"):
        np.testing.assert_array_equal(getattr(one, layer), getattr(two, layer))
        assert not np.array_equal(getattr(one, layer), getattr(other, layer))


def test_fields_hold_one_cover():
    scene = land()
    for number in np.unique(scene.field_id)[::7]:
        assert len(np.unique(scene.cover[scene.field_id == number])) == 1


@pytest.mark.parametrize("change", [{"seed": 2**64}, {"seed": -1}, {"relief_m": 9500.0}])
def test_impossible_land_is_refused(change):
    with pytest.raises(SceneError, match=next(iter(change))):
        land(**change)


def test_a_scene_too_large_is_refused_before_anything_is_drawn():
    with pytest.raises(SceneError, match="more than 100000000"):
        synthetic_scene(20_000, 20_000, 5.0, categories=("Wheat",))
