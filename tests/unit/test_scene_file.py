"""Scenes: what is accepted, what is refused and how it is said, and the file."""

from __future__ import annotations

import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from synthetic import synthetic_scene

from seqrsm.errors import SceneError, UserError
from seqrsm.scene import file as scene_file
from seqrsm.scene.file import load_scene, save_scene
from seqrsm.scene.scene import NO_COVER, Scene


def small(**changes: Any) -> Scene:
    rows, cols = 3, 4
    parts: dict[str, Any] = {
        "elevation_m": np.arange(12.0, dtype=np.float32).reshape(rows, cols),
        "cover": np.repeat(np.array([[0, 0, 1, 1]], dtype=np.uint8), rows, axis=0),
        "categories": ("Wheat", "Trees"),
        "field_id": np.repeat(np.array([[0, 0, 1, 1]], dtype=np.int32), rows, axis=0),
        "scored": np.ones((rows, cols), dtype=bool),
        "cell_m": 5.0,
    }
    return Scene(**{**parts, **changes})


def test_round_trip(tmp_path: Path) -> None:
    z = np.array([[1.25, np.nan], [-3.1, 106.67]], dtype=np.float32)
    scene = Scene(
        elevation_m=z,
        cover=np.array([[0, NO_COVER], [0, 1]], dtype=np.uint8),
        categories=("Wheat", "Trees"),
        field_id=np.array([[0, 1], [0, 2]], dtype=np.int32),
        scored=np.array([[True, False], [True, False]]),
        cell_m=5.0,
        epsg=31370,
        bounds=(0.0, 0.0, 10.0, 10.0),
        name="näme",
        licence="CC0",
        provenance="made",
        category_notes={"Wheat": "drawn"},
    )
    save_scene(scene, tmp_path / "s.npz")
    got = load_scene(tmp_path / "s.npz")
    for layer in ("elevation_m", "cover", "field_id", "scored"):
        np.testing.assert_array_equal(getattr(got, layer), getattr(scene, layer))
        assert getattr(got, layer).dtype == getattr(scene, layer).dtype
    for part in ("categories", "cell_m", "epsg", "bounds", "name", "licence", "provenance", "category_notes"):
        assert getattr(got, part) == getattr(scene, part)


def test_layer_of_temperature_comes_back_and_is_checked(tmp_path: Path) -> None:
    kelvin = np.linspace(280.0, 320.0, 12, dtype=np.float32).reshape(3, 4)
    save_scene(small(temperature_k=kelvin), tmp_path / "s.npz")
    np.testing.assert_array_equal(load_scene(tmp_path / "s.npz").temperature_k, kelvin)
    save_scene(small(), tmp_path / "none.npz")
    assert load_scene(tmp_path / "none.npz").temperature_k is None
    celsius = kelvin - 273.15
    with pytest.raises(SceneError, match=r"12 cells lie outside 150 to 500 K.*kelvin"):
        small(temperature_k=celsius)
    hole = kelvin.copy()
    hole[1, 2] = np.nan
    with pytest.raises(SceneError, match="1 cells lie outside"):
        small(temperature_k=hole)
    # Where the ground itself is not known its temperature need not be.
    z = np.arange(12.0, dtype=np.float32).reshape(3, 4)
    z[1, 2] = np.nan
    scored = np.isfinite(z)
    assert small(elevation_m=z, scored=scored, temperature_k=hole).temperature_k is hole


def test_the_same_scene_gives_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        save_scene(synthetic_scene(20, 30, 5.0, categories=["A", "B"], relief_m=10.0, seed=3), tmp_path / name)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def int32(*rows: list[int]) -> np.ndarray:
    return np.array(rows, dtype=np.int32)


BROKEN: list[tuple[dict[str, Any], str]] = [
    ({"cover": np.zeros((3, 5), np.uint8)}, "cover is 3 x 5, elevation_m is 3 x 4"),
    ({"field_id": np.zeros((2, 4), np.int32)}, "field_id is 2 x 4"),
    ({"elevation_m": np.zeros((3, 4))}, "elevation_m: the layer must be of type float32"),
    ({"cover": np.zeros((3, 4), np.int64)}, "numpy.asarray\\(cover, dtype=numpy.uint8\\)"),
    ({"cover": np.full((3, 4), 7, np.uint8)}, "category number beyond the 2 categories.*Use 0 to 1, or 255"),
    ({"cell_m": 0.0}, "cell_m: the cell size must be a positive number"),
    ({"cell_m": float("nan")}, "cell_m"),
    ({"cell_m": 0.000277}, "degrees: project it to metres"),
    ({"epsg": 4326}, "epsg: a geographic coordinate system.*project it"),
    ({"bounds": (0.0, 0.0, 99.0, 15.0)}, "bounds: .*do not span 4 x 3 cells of 5.0 m"),
    ({"categories": ("Wheat", "Wheat")}, "unique"),
    ({"categories": ()}, "1 to 255 categories"),
    ({"category_notes": {"Corn": "x"}}, "category_notes"),
    ({"field_id": int32(*[[-1, 0, 1, 1]] * 3)}, "between 0 and 11.*got -1"),
    ({"field_id": int32(*[[0, 0, 99, 99]] * 3)}, "got 99"),
    ({"field_id": int32(*[[0, 0, 0, 1]] * 3)}, "a field holds two categories"),
    ({"elevation_m": np.full((3, 4), 1e5, np.float32)}, "12 cells lie outside -500 to 9000 m"),
    ({"elevation_m": np.full((3, 4), np.inf, np.float32)}, "outside"),
    ({"elevation_m": np.full((3, 4), np.nan, np.float32)}, "12 scored cells have no elevation"),
    ({"elevation_m": np.zeros((0, 4), np.float32)}, "a row and a column at least"),
]


@pytest.mark.parametrize(("changes", "message"), BROKEN)
def test_broken_scene_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        small(**changes)


def test_all_problems_at_once() -> None:
    with pytest.raises(SceneError) as caught:
        small(cell_m=-1.0, cover=np.zeros((3, 5), np.uint8), epsg=4326)
    assert len(caught.value.problems) == 3


def write(path: Path, **changes: Any) -> Path:
    save_scene(small(), path)
    with np.load(path) as archive:
        members = {name: archive[name] for name in archive.files}
    np.savez(path, **{k: v for k, v in {**members, **changes}.items() if v is not None})
    return path


def test_file_is_named_with_the_layer(tmp_path: Path) -> None:
    path = write(tmp_path / "s.npz", cover=np.zeros((9, 9), np.uint8))
    with pytest.raises(SceneError, match=r"s\.npz: cover: layers differ in size: cover is 9 x 9"):
        load_scene(path)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"scored": None}, "this is no scene: it has no scored. "),
        ({"elevation_cm": None}, "this is no scene: it has no elevation_m. "),
        ({"schema": np.array(99)}, "schema 99"),
        ({"schema": np.array("x")}, "wrong form"),
        ({"category_notes": np.array(["a"])}, "wrong form"),
        ({"bounds": np.array([1.0])}, "wrong form"),
    ],
)
def test_broken_file(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        load_scene(write(tmp_path / "s.npz", **changes))


def test_other_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"none\.npz: no such scene file"):
        load_scene(tmp_path / "none.npz")
    (tmp_path / "text.npz").write_text("hello")
    with pytest.raises(SceneError, match="not a readable scene file"):
        load_scene(tmp_path / "text.npz")
    save_scene(small(), tmp_path / "cut.npz")
    (tmp_path / "cut.npz").write_bytes((tmp_path / "cut.npz").read_bytes()[:300])
    with pytest.raises(SceneError, match="not a readable scene file"):
        load_scene(tmp_path / "cut.npz")


def test_pickles_are_not_read(tmp_path: Path) -> None:
    path = write(tmp_path / "s.npz", name=np.array({"a": 1}, dtype=object))
    with pytest.raises(SceneError, match="not a readable scene file"):
        load_scene(path)


def test_zip_bomb_is_refused_unread(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with zipfile.ZipFile(tmp_path / "bomb.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("elevation_m.npy", b"\0" * 3_000_000)
    assert (tmp_path / "bomb.npz").stat().st_size < 10_000
    monkeypatch.setattr(scene_file, "_MAX_BYTES", 2_000_000)
    with pytest.raises(SceneError, match="unpacked scene would take"):
        load_scene(tmp_path / "bomb.npz")


def test_cannot_write(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="cannot be written"):
        save_scene(small(), tmp_path / "missing" / "s.npz")


def test_derived_values() -> None:
    scene = small()
    assert (scene.shape, scene.n_fields) == ((3, 4), 2)
    hole = replace(scene, cover=np.full((3, 4), NO_COVER, np.uint8), scored=np.zeros((3, 4), bool))
    assert not hole.valid().any()
