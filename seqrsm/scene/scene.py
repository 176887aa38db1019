"""The ground-truth data base that the engines look at: one value of each layer for every cell.

A scene file is a numpy ``.npz`` without pickled objects. Elevations that are whole centimetres are kept as 16-bit
integers, which the loader turns back into the same float32 values.
"""

from __future__ import annotations

import math
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from seqrsm.arrays import AnyArray, BoolArray, Float32Array
from seqrsm.errors import Problem, SceneError

NO_COVER: Final = 255
"""Value of ``cover`` where the category is not known."""

SCHEMA: Final = 1
"""Version of the scene file."""

MAX_CELLS: Final = 100_000_000
"""Largest scene that is read (10 000 x 10 000 cells)."""

_MEMBERS: Final = (
    "schema", "cover", "field_id", "scored", "cell_m", "categories", "category_notes", "epsg", "bounds", "name",
    "licence", "provenance",
)  # fmt: skip
_NO_CENTIMETRES: Final = -32768
_MAX_BYTES: Final = 16 * MAX_CELLS
_MIN_CELL_M: Final = 0.05
LOWEST_M, HIGHEST_M = -500.0, 9000.0
_COLDEST_K, _WARMEST_K = 150.0, 500.0
_WETTEST = 0.6


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """Ground-truth data base on a square grid; row 0 lies in the north, column 0 in the west.

    Attributes
    ----------
    elevation_m : float32 array (rows, cols)
        Height of the ground [m]; nan where it is not known.
    cover : uint8 array (rows, cols)
        Index into ``categories``; 255 where the category is not known.
    categories : tuple of str
        Names of the cover categories, as in the scattering table.
    field_id : int32 array (rows, cols)
        Number >= 0 of the field, stand or patch a cell belongs to: one category, one draw of natural variability.
    scored : bool array (rows, cols)
        True where the cell's category is ground truth that a classifier is scored on.
    cell_m : float
        Side of a cell [m].
    epsg : int or None
        Code of the projected coordinate system.
    bounds : tuple of float or None
        Left, bottom, right, top [m].
    name, licence, provenance : str
        What it is, under which terms, and how it was made.
    category_notes : Mapping[str, str]
        Remark on a category, for instance that it was drawn and not observed.
    temperature_k : float32 array (rows, cols) or None
        Physical temperature of the ground [K], 150 to 500, known in every valid cell; None: not in this data base.
    soil_moisture : float32 array (rows, cols) or None
        Volumetric moisture of the soil [m3/m3], 0 to 0.6, known in every valid cell; None: the same everywhere.
    kept_statistics : str
        What `seqrsm.scene.statistics.scene_statistics` found when the file was written, and of which layers.

    Raises
    ------
    SceneError
        Layers of different size or wrong type, unknown category, impossible cell size: all at once.
    """

    elevation_m: Float32Array
    cover: NDArray[np.uint8]
    categories: tuple[str, ...]
    field_id: NDArray[np.int32]
    scored: BoolArray
    cell_m: float
    epsg: int | None = None
    bounds: tuple[float, float, float, float] | None = None
    name: str = ""
    licence: str = ""
    provenance: str = ""
    category_notes: Mapping[str, str] = field(default_factory=dict)
    temperature_k: Float32Array | None = None
    soil_moisture: Float32Array | None = None
    kept_statistics: str = ""

    def __post_init__(self) -> None:
        problems = [*_layer_problems(self), *_grid_problems(self)]
        if not problems:
            problems = _content_problems(self)
        if problems:
            raise SceneError(*problems)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        rows, cols = self.elevation_m.shape
        return rows, cols

    @property
    def n_fields(self) -> int:
        """One more than the largest field number: the length of an array with one entry for each field."""
        return int(self.field_id.max()) + 1

    def valid(self) -> BoolArray:
        """Cells (rows, cols) whose elevation and category are both known."""
        return np.asarray(np.isfinite(self.elevation_m) & (self.cover != NO_COVER))


def _layer_problems(scene: Scene) -> list[Problem]:
    """Type and shape of each layer."""
    wanted: list[tuple[str, AnyArray, type[np.generic]]] = [
        ("elevation_m", scene.elevation_m, np.float32),
        ("cover", scene.cover, np.uint8),
        ("field_id", scene.field_id, np.int32),
        ("scored", scene.scored, np.bool_),
    ]
    if scene.temperature_k is not None:
        wanted.append(("temperature_k", scene.temperature_k, np.float32))
    if scene.soil_moisture is not None:
        wanted.append(("soil_moisture", scene.soil_moisture, np.float32))
    problems = []
    shape = np.shape(scene.elevation_m)
    if len(shape) != 2 or min(shape) < 1:
        problems.append(
            Problem("the layer must have a row and a column at least", field="elevation_m", value=tuple(shape))
        )
    elif shape[0] * shape[1] > MAX_CELLS:
        problems.append(Problem(f"more than {MAX_CELLS} cells", "Cut or coarsen the scene", value=tuple(shape)))
    for name, layer, dtype in wanted:
        if not isinstance(layer, np.ndarray) or layer.dtype != dtype:
            got = getattr(layer, "dtype", type(layer).__name__)
            remedy = f"Convert it: numpy.asarray({name}, dtype=numpy.{np.dtype(dtype).name})"
            problems.append(
                Problem(f"the layer must be of type {np.dtype(dtype).name}", remedy, field=name, value=str(got))
            )
        if np.shape(layer) != shape:
            problems.append(
                Problem(
                    f"layers differ in size: {name} is {_size(np.shape(layer))}, elevation_m is {_size(shape)}",
                    "Resample all layers to one grid",
                    field=name,
                )
            )
    return problems


def _size(shape: tuple[int, ...]) -> str:
    return " x ".join(str(n) for n in shape) or "a single number"


def _grid_problems(scene: Scene) -> list[Problem]:
    """Cell size, coordinates and category names."""
    problems = []
    cell = scene.cell_m
    degrees = "The grid seems to be in degrees: project it to metres (for instance to UTM)"
    if not np.isfinite(cell) or cell <= 0.0:
        problems.append(Problem("the cell size must be a positive number of metres", field="cell_m", value=cell))
    elif cell < _MIN_CELL_M:
        problems.append(Problem(f"a cell smaller than {_MIN_CELL_M} m", degrees, field="cell_m", value=cell))
    if scene.epsg is not None and 4000 < scene.epsg < 5000:
        problems.append(Problem("a geographic coordinate system", degrees, field="epsg", value=scene.epsg))
    shape = np.shape(scene.elevation_m)
    if scene.bounds is not None and len(shape) == 2:
        left, bottom, right, top = scene.bounds
        extent = np.array([right - left, top - bottom])
        if not np.allclose(extent, np.array([shape[1], shape[0]]) * cell, rtol=0.01):
            message = f"left, bottom, right, top do not span {shape[1]} x {shape[0]} cells of {cell} m"
            problems.append(Problem(message, "Give the outer edges [m]", field="bounds", value=scene.bounds))
    names = scene.categories
    if not 1 <= len(names) <= NO_COVER:
        problems.append(Problem(f"1 to {NO_COVER} categories are possible", field="categories", value=len(names)))
    if len(set(names)) < len(names) or not all(names):
        problems.append(Problem("category names must be unique and not empty", field="categories", value=names))
    unknown = sorted(set(scene.category_notes) - set(names))
    if unknown:
        problems.append(Problem("notes on categories the scene lacks", field="category_notes", value=unknown))
    return problems


def _content_problems(scene: Scene) -> list[Problem]:
    """Values inside the layers, given that types and shapes are right."""
    problems = []
    cover = scene.cover
    bad = (cover >= len(scene.categories)) & (cover != NO_COVER)
    if bad.any():
        message = f"{int(bad.sum())} cells hold a category number beyond the {len(scene.categories)} categories"
        remedy = f"Use 0 to {len(scene.categories) - 1}, or {NO_COVER} for no data"
        problems.append(Problem(message, remedy, field="cover", value=int(cover[bad].max())))
    z = scene.elevation_m
    wild = np.isinf(z) | (z < LOWEST_M) | (z > HIGHEST_M)
    if wild.any():
        message = f"{int(wild.sum())} cells lie outside {LOWEST_M:.0f} to {HIGHEST_M:.0f} m"
        problems.append(
            Problem(message, "Mark missing elevations with nan", field="elevation_m", value=float(z[wild][0]))
        )
    fields = scene.field_id
    if fields.min() < 0 or fields.max() >= fields.size:
        message = f"field numbers must lie between 0 and {fields.size - 1}"
        value = int(fields.min() if fields.min() < 0 else fields.max())
        problems.append(Problem(message, "Number the fields 0, 1, 2, ...", field="field_id", value=value))
    else:
        cover_of = np.zeros(int(fields.max()) + 1, dtype=np.uint8)
        cover_of[fields.ravel()] = cover.ravel()
        mixed = cover_of[fields] != cover
        if mixed.any():
            number = int(fields[mixed][0])
            problems.append(Problem("a field holds two categories", "Split it", field="field_id", value=number))
    blind = scene.scored & ~scene.valid()
    if blind.any():
        message = f"{int(blind.sum())} scored cells have no elevation or no category"
        problems.append(Problem(message, "Set scored to False there", field="scored"))
    if scene.temperature_k is not None:
        kelvin = scene.temperature_k[scene.valid()]
        cold = ~((kelvin >= _COLDEST_K) & (kelvin <= _WARMEST_K))
        if cold.any():
            message = f"{int(cold.sum())} cells lie outside {_COLDEST_K:.0f} to {_WARMEST_K:.0f} K or are not known"
            remedy = "Give kelvin, in every cell that has an elevation and a category"
            problems.append(Problem(message, remedy, field="temperature_k", value=float(kelvin[cold][0])))
    if scene.soil_moisture is not None:
        moisture = scene.soil_moisture[scene.valid()]
        wrong = ~((moisture >= 0.0) & (moisture <= _WETTEST))
        if wrong.any():
            message = f"{int(wrong.sum())} cells lie outside 0 to {_WETTEST:g} m3/m3 or are not known"
            remedy = "Give volumetric moisture, in every cell that has an elevation and a category"
            problems.append(Problem(message, remedy, field="soil_moisture", value=float(moisture[wrong][0])))
    return problems


def save_scene(scene: Scene, path: str | Path) -> None:
    """Write ``scene`` to the ``.npz`` file ``path``; the same scene always gives the same bytes.

    Raises
    ------
    SceneError
        The file cannot be written.
    """
    from seqrsm.scene.statistics import statistics_text

    notes = dict(scene.category_notes)
    members: dict[str, AnyArray] = {
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
        "statistics": np.array(statistics_text(scene)),
    }
    if scene.temperature_k is not None:
        members["temperature_k"] = scene.temperature_k
    if scene.soil_moisture is not None:
        members["soil_moisture"] = scene.soil_moisture
    try:
        with open(path, "wb") as stream:
            np.savez_compressed(stream, allow_pickle=False, **members)
    except OSError as error:
        raise SceneError(Problem(f"cannot write the scene: {error.strerror}", file=str(path))) from error


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
        raise SceneError(Problem("no such scene file", file=file)) from error
    except Exception as error:  # a damaged archive makes numpy and zipfile raise whatever comes to hand
        remedy = "Write it with seqrsm.scene.scene.save_scene or `seqrsm scene import`"
        raise SceneError(Problem(f"not a readable scene file: {error}", remedy, file=file)) from error
    return _scene_of(members, file)


def _check_archive(path: str | Path) -> None:
    """Refuse an archive whose members would take more memory than any scene, before reading them."""
    with zipfile.ZipFile(path) as archive:
        size = sum(member.file_size for member in archive.infolist())
        if size > _MAX_BYTES:
            message = f"the unpacked scene would take {size / 1e9:.1f} GB, more than {_MAX_BYTES / 1e9:.1f} GB"
            raise SceneError(Problem(message, "Cut or coarsen the scene", file=str(path)))
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
        raise SceneError(*(Problem("the layer is missing", "Write it with save_scene", file, field=n) for n in missing))
    try:
        if int(members["schema"]) != SCHEMA:
            message = f"written for schema {int(members['schema'])}, this version reads {SCHEMA}"
            raise SceneError(Problem(message, "Use the seqrsm that wrote it, or build it again", file))
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
            kept_statistics=str(members.get("statistics", "")),
        )
    except SceneError as error:
        raise SceneError(*(replace(problem, file=file) for problem in error.problems)) from None
    except Exception as error:  # members of any type and shape
        raise SceneError(Problem(f"a member has the wrong form: {error}", "Write it with save_scene", file)) from error
