"""The ground-truth data base that the engines look at: one value of each layer for every cell."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from seqrsm.arrays import AnyArray, BoolArray, Float32Array
from seqrsm.errors import Problem, SceneError

NO_COVER: Final = 255
"""Value of ``cover`` where the category is not known."""

MAX_CELLS: Final = 100_000_000
"""Largest scene that is read (10 000 x 10 000 cells)."""

_MIN_CELL_M: Final = 0.05
_MAX_CELL_M: Final = 1e5
LOWEST_M, HIGHEST_M = -500.0, 9000.0
# Lowest and highest value of the layers of the ground's state, that range in words, and what to give.
_STATES = {
    "temperature_k": (150.0, 500.0, "150 to 500 K", "kelvin"),
    "soil_moisture": (0.0, 0.6, "0 to 0.6 m3/m3", "volumetric moisture"),
}


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """Ground-truth data base on a square grid; row 0 lies in the north, column 0 in the west.

    Raises
    ------
    SceneError
        Layers of different size or wrong type, unknown category, impossible cell size: all at once.
    """

    elevation_m: Float32Array
    """(rows, cols): height of the ground [m]; nan where it is not known."""
    cover: NDArray[np.uint8]
    """(rows, cols): index into ``categories``; 255 where the category is not known."""
    categories: tuple[str, ...]
    """Names of the cover categories, as in the scattering table."""
    field_id: NDArray[np.int32]
    """(rows, cols): number >= 0 of the field, stand or patch a cell belongs to: one category, one draw of natural
    variability."""
    scored: BoolArray
    """(rows, cols): True where the cell's category is ground truth that a classifier is scored on."""
    cell_m: float
    """Side of a cell [m]."""
    epsg: int | None = None
    """Code of the projected coordinate system."""
    bounds: tuple[float, float, float, float] | None = None
    """Left, bottom, right, top [m]."""
    name: str = ""
    licence: str = ""
    provenance: str = ""
    """What it is, under which terms, and how it was made."""
    category_notes: Mapping[str, str] = field(default_factory=dict)
    """Remark on a category, for instance that it was drawn and not observed."""
    temperature_k: Float32Array | None = None
    """(rows, cols): physical temperature of the ground [K], 150 to 500, known in every valid cell; None: not in this
    data base."""
    soil_moisture: Float32Array | None = None
    """(rows, cols): volumetric moisture of the soil [m3/m3], 0 to 0.6, known in every valid cell; None: the same
    everywhere."""

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

    @property
    def states(self) -> dict[str, Float32Array]:
        """Layers of the ground's state that the scene has, by name."""
        layers = {"temperature_k": self.temperature_k, "soil_moisture": self.soil_moisture}
        return {name: layer for name, layer in layers.items() if layer is not None}

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
        *((name, layer, np.float32) for name, layer in scene.states.items()),
    ]
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
            text = f"layers differ in size: {name} is {_size(np.shape(layer))}, elevation_m is {_size(shape)}"
            problems.append(Problem(text, "Resample all layers to one grid", field=name))
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
    elif cell > _MAX_CELL_M:
        problems.append(Problem(f"a cell larger than {_MAX_CELL_M:g} m", "Give metres.", field="cell_m", value=cell))
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
    for name, layer in scene.states.items():
        low, high, limits, quantity = _STATES[name]
        values = layer[scene.valid()]
        wrong = ~((values >= low) & (values <= high))
        if wrong.any():
            message = f"{int(wrong.sum())} cells lie outside {limits} or are not known"
            remedy = f"Give {quantity}, in every cell that has an elevation and a category"
            problems.append(Problem(message, remedy, field=name, value=float(values[wrong][0])))
    return problems
