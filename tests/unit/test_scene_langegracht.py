"""The shipped example scene: what SCENE.md says of it holds, and its builder does what it says."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from seqrsm.scattering.sigma0 import load_sigma0_table
from seqrsm.scene.fields import connected_patches
from seqrsm.scene.file import load_scene, save_scene
from seqrsm.scene.scene import NO_COVER
from seqrsm.scene.statistics import scene_statistics

FOLDER = Path(__file__).parents[2] / "campaigns" / "langegracht-radar"


def builder_of(folder: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"build_{folder.name.replace('-', '_')}", folder / "build_scene.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def builder() -> ModuleType:
    return builder_of(FOLDER)


def test_every_campaign_over_the_site_sees_the_same_ground(tmp_path: Path) -> None:
    coarse = FOLDER.parent / "crops-and-moisture"
    save_scene(builder_of(coarse).thin(load_scene(FOLDER / "scene.npz")), tmp_path / "scene.npz")
    fresh, shipped = (np.load(folder / "scene.npz", allow_pickle=False) for folder in (tmp_path, coarse))
    assert fresh.files == shipped.files
    for name in fresh.files:
        np.testing.assert_array_equal(fresh[name], shipped[name], err_msg=name)
    dates = FOLDER.parent / "langegracht-dates" / "scene.npz"
    assert dates.read_bytes() == (coarse / "scene.npz").read_bytes()


def test_shipped_scene() -> None:
    assert (FOLDER / "scene.npz").stat().st_size < 2_500_000
    scene = load_scene(FOLDER / "scene.npz")
    found = scene_statistics(scene)
    assert scene.shape == (735, 1134)
    assert (scene.cell_m, scene.epsg) == (5.0, 31370)
    assert (found.low_m, found.high_m) == pytest.approx((32.04, 106.67), abs=0.01)
    assert np.count_nonzero(scene.cover == NO_COVER) == 1355
    np.testing.assert_array_equal(np.isnan(scene.elevation_m), scene.cover == NO_COVER)
    assert found.scored_fraction == pytest.approx(0.725, abs=0.001)
    assert set(scene.categories) <= set(load_sigma0_table().categories)
    np.testing.assert_array_equal(connected_patches(scene.field_id), scene.field_id)  # every field is connected


def test_every_category_has_fields_enough_to_train_and_test() -> None:
    scene = load_scene(FOLDER / "scene.npz")
    for index, name in enumerate(scene.categories):
        cells = scene.field_id[(scene.cover == index) & scene.scored]
        large = np.count_nonzero(np.bincount(cells) * 25.0 >= 2000.0)
        assert large >= (8 if name == "Water" else 30), name


def test_only_parcels_may_be_large() -> None:
    """Forest, grass, infrastructure and water lie in pieces of at most 4 ha."""
    scene = load_scene(FOLDER / "scene.npz")
    for name in ("Trees", "Grass", "Settlement", "Water"):
        cells = scene.field_id[scene.cover == scene.categories.index(name)]
        assert np.bincount(cells).max() * 25.0 < 4e4


def test_builder_on_a_small_source(builder: ModuleType) -> None:
    use = np.repeat(np.array([[1] * 40 + [2] * 4 + [3] * 40 + [0] * 2], np.uint8), 60, axis=0)
    parcel = np.zeros(use.shape, np.uint16)
    parcel[:30, :40], parcel[30:, :40] = 77, 10
    elevation = np.full(use.shape, 5000, np.int16)
    elevation[use == 0] = -32768
    source = {
        "cover": use, "parcel": parcel, "elevation_cm": elevation, "cell_m": np.array(5.0), "epsg": np.array(31370),
        "bounds": np.array([0.0, 0.0, 86 * 5.0, 60 * 5.0]),
    }  # fmt: skip
    scene = builder.build(source)
    assert np.unique(scene.cover[:30, :40]).size == 1  # one crop on the parcel
    assert np.unique(scene.field_id[:30, :40]).size == 1
    assert scene.scored[:30, :40].all()
    assert not scene.scored[30:, :40].any()  # no parcel id: drawn, not scored
    assert (scene.cover[:, 44:84] == scene.categories.index("Trees")).all()
    assert (scene.cover[use == 0] == NO_COVER).all()
    assert not scene.scored[use == 0].any()
    again = builder.build(source)
    np.testing.assert_array_equal(scene.field_id, again.field_id)
    np.testing.assert_array_equal(scene.cover, again.cover)


def test_crop_shares_of_the_shipped_parcels(builder: ModuleType) -> None:
    """The drawn crops follow the documented shares, counted over the drawn fields and parcels."""
    scene = load_scene(FOLDER / "scene.npz")
    crops = list(builder.CROP_SHARES)
    large = np.bincount(scene.field_id.ravel()) >= 40
    cover_of = np.zeros(scene.n_fields, np.uint8)
    cover_of[scene.field_id.ravel()] = scene.cover.ravel()
    count = np.array([np.count_nonzero(large & (cover_of == scene.categories.index(c))) for c in crops])
    expected = np.array(list(builder.CROP_SHARES.values()))
    assert count / count.sum() == pytest.approx(expected, abs=4.0 * np.sqrt(0.25 / count.sum()))
