"""The scene file: a numpy ``.npz`` without pickled objects.

Elevations that are whole centimetres are kept as 16-bit integers, which the loader turns back into the same float32
values.
"""

from __future__ import annotations

import math
import zipfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from seqrsm.arrays import AnyArray, Float32Array
from seqrsm.errors import SceneError
from seqrsm.files import put
from seqrsm.scene.scene import MAX_CELLS, Scene

SCHEMA: Final = 1
"""Version of the scene file."""

_MEMBERS: Final = (
    "schema", "cover", "field_id", "scored", "cell_m", "categories", "category_notes", "epsg", "bounds", "name",
    "licence", "provenance",
)  # fmt: skip
_NO_CENTIMETRES: Final = -32768
_MAX_BYTES: Final = 16 * MAX_CELLS


def save_scene(scene: Scene, path: str | Path) -> None:
    """Write ``scene`` to the ``.npz`` file ``path``; the same scene always gives the same bytes.

    Raises
    ------
    UserError
        The file cannot be written.
    """
    notes = dict(scene.category_notes)
    members: dict[str, Any] = {
        "schema": np.array(SCHEMA),
        **_packed_elevation(scene.elevation_m),
        "cover": scene.cover,
        "field_id": scene.field_id,
        "scored": scene.scored,
        "cell_m": np.array(scene.cell_m, dtype=np.float64),
        "categories": np.array(scene.categories),
        "category_notes": np.array([notes.get(name, "") for name in scene.categories]),
        "epsg": np.array(-1 if scene.epsg is None else scene.epsg),
        "bounds": np.array([] if scene.bounds is None else scene.bounds, dtype=np.float64),
        "name": np.array(scene.name),
        "licence": np.array(scene.licence),
        "provenance": np.array(scene.provenance),
        **scene.states,
    }
    put(Path(path), lambda stream: np.savez_compressed(stream, **members))


def _packed_elevation(elevation_m: Float32Array) -> dict[str, AnyArray]:
    """Elevation as 16-bit centimetres where that gives back the same float32 values, else as it is."""
    packed = np.empty(elevation_m.shape, dtype=np.int16)
    # Row by row: the work space of a large scene would be many times the scene.
    for metres, own in zip(elevation_m, packed, strict=True):
        known = np.isfinite(metres)
        centimetres = np.round(np.where(known, metres, 0.0).astype(np.float64) * 100.0)
        if not np.abs(centimetres).max() < -_NO_CENTIMETRES:
            return {"elevation_m": elevation_m}
        own[:] = np.where(known, centimetres, _NO_CENTIMETRES)
        if not np.array_equal(_unpacked_elevation(own[None])[0], metres, equal_nan=True):
            return {"elevation_m": elevation_m}
    return {"elevation_cm": packed}


def _unpacked_elevation(centimetres: AnyArray) -> Float32Array:
    metres = np.empty(centimetres.shape, dtype=np.float32)
    for own, row in zip(metres, centimetres, strict=True):
        own[:] = row / 100.0
        own[row == _NO_CENTIMETRES] = np.nan
    return metres


def load_scene(path: str | Path) -> Scene:
    """Read a scene written by `save_scene`.

    Raises
    ------
    SceneError
        The file is missing, no scene file, of another schema, too large, or holds a wrong scene.
    """
    file = str(path)
    try:
        _check_archive(path)
        with np.load(path, allow_pickle=False) as archive:
            members = {name: archive[name] for name in archive.files}
    except SceneError:
        raise
    except FileNotFoundError as error:
        raise SceneError("no such scene file", file=file) from error
    except Exception as error:  # a damaged archive makes numpy and zipfile raise whatever comes to hand
        remedy = "Write it with seqrsm.scene.file.save_scene or `seqrsm scene import`"
        raise SceneError(f"not a readable scene file: {error}", remedy, file=file) from error
    return _scene_of(members, file)


def _check_archive(path: str | Path) -> None:
    """Refuse an archive whose members would take more memory than any scene, before reading them."""
    with zipfile.ZipFile(path) as archive:
        size = sum(member.file_size for member in archive.infolist())
        if size > _MAX_BYTES:
            message = f"the unpacked scene would take {size / 1e9:.1f} GB, more than {_MAX_BYTES / 1e9:.1f} GB"
            raise SceneError(message, "Cut or coarsen the scene", file=str(path))
        for member in archive.infolist():
            _check_header(archive, member)


def _check_header(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> None:
    """Refuse an array that says it is larger than what the archive holds of it: numpy makes room before it reads."""
    with archive.open(member) as stream:
        version = np.lib.format.read_magic(stream)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, dtype = read(stream)
    if math.prod(shape) * dtype.itemsize > member.file_size:
        raise ValueError(f"{member.filename} is shorter than its header says")


def _scene_of(members: Mapping[str, AnyArray], file: str) -> Scene:
    """Scene of the members of a file, with the file's name in every problem."""
    missing = [name for name in _MEMBERS if name not in members]
    if not {"elevation_m", "elevation_cm"} & set(members):
        missing.append("elevation_m")
    if missing:
        remedy = "`seqrsm scene import` makes a scene of rasters, seqrsm.scene.file.save_scene of arrays"
        raise SceneError(f"this is no scene: it has no {', '.join(missing)}", remedy, file=file)
    try:
        if int(members["schema"]) != SCHEMA:
            message = f"written for schema {int(members['schema'])}, this version reads {SCHEMA}"
            raise SceneError(message, "Use the seqrsm that wrote it, or build it again", file=file)
        packed = "elevation_cm" in members
        elevation = _unpacked_elevation(members["elevation_cm"]) if packed else members["elevation_m"]
        names = tuple(str(name) for name in members["categories"].ravel())
        notes = [str(note) for note in members["category_notes"].ravel()]
        epsg, bounds = int(members["epsg"]), [float(edge) for edge in members["bounds"].ravel()]
        return Scene(
            elevation_m=elevation,
            cover=members["cover"],
            categories=names,
            field_id=members["field_id"],
            scored=members["scored"],
            cell_m=float(members["cell_m"]),
            epsg=None if epsg < 0 else epsg,
            bounds=(bounds[0], bounds[1], bounds[2], bounds[3]) if bounds else None,
            name=str(members["name"]),
            licence=str(members["licence"]),
            provenance=str(members["provenance"]),
            category_notes={name: note for name, note in zip(names, notes, strict=True) if note},
            temperature_k=members.get("temperature_k"),
            soil_moisture=members.get("soil_moisture"),
        )
    except SceneError as error:
        raise SceneError(*(replace(problem, file=file) for problem in error.problems)) from None
    except Exception as error:  # members of any type and shape
        raise SceneError(f"a member has the wrong form: {error}", "Write it with save_scene", file=file) from error
