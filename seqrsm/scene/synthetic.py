"""Whole synthetic scenes from a seed: terrain, fields and their categories, rivers, roads and towns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from seqrsm.errors import Problem, SceneError
from seqrsm.scene.features import river_mask, road_mask, town_centres, town_mask
from seqrsm.scene.fields import connected_patches, draw_index, voronoi_labels
from seqrsm.scene.scene import HIGHEST_M, MAX_CELLS, Scene
from seqrsm.scene.terrain import fractal_terrain

_TOWN = ("Buildings", "Asphalt", "Grass")
_TOWN_SHARES = (0.5, 0.2, 0.3)
_BLOCK_M = 50.0

LARGEST_SEED: Final = 2**63 - 1


@dataclass(frozen=True, slots=True)
class Terrain:
    """Relief of a drawn scene.

    Attributes
    ----------
    relief_m, rms_slope, exponent : float
        See `seqrsm.scene.terrain.fractal_terrain`.
    base_m : float
        Height of the lowest point [m].
    """

    relief_m: float = 0.0
    rms_slope: float | None = None
    exponent: float = 3.5
    base_m: float = 0.0


@dataclass(frozen=True, slots=True)
class Features:
    """What lies on the fields of a drawn scene: numbers of rivers and towns, and whether there are roads.

    ``river_m``, ``town_m`` and ``road_m`` are the width of a river, the mean radius of a town and the width of a road
    [m].
    """

    rivers: int = 0
    towns: int = 0
    roads: bool = False
    river_m: float = 30.0
    town_m: float = 300.0
    road_m: float = 12.0


def synthetic_scene(
    rows: int,
    cols: int,
    cell_m: float,
    *,
    categories: Sequence[str],
    field_m: float = 150.0,
    terrain: Terrain | None = None,
    features: Features | None = None,
    seed: int = 0,
) -> Scene:
    """Scene of drawn fields on drawn terrain, with rivers, roads and towns if asked for.

    Rivers run through valleys, roads shun slopes and join the towns; a river is Water, a road Asphalt, and a town is
    made of blocks of Buildings, Asphalt and Grass. They are added to the categories where they are not among them.

    Parameters
    ----------
    rows, cols : int
        Size [cells].
    cell_m : float
        Side of a cell [m].
    categories : sequence of str
        Cover categories, each of as many fields on average.
    field_m : float
        Mean side of a field [m], at least one cell.
    terrain : Terrain, optional
        Flat by default.
    features : Features, optional
        None by default.
    seed : int
        Seed of everything that is drawn.

    Raises
    ------
    SceneError
        Impossible size, relief, slope, field, feature or seed.
    """
    terrain, features = terrain or Terrain(), features or Features()
    relief_m = terrain.relief_m
    if not categories:
        raise SceneError(Problem("a scene needs a category", "Name one or more", field="categories"))
    if rows * cols > MAX_CELLS:
        text = f"{rows} x {cols} cells are more than {MAX_CELLS}"
        raise SceneError(Problem(text, "Give fewer rows or columns", field="rows", value=rows))
    if not 0 <= seed <= LARGEST_SEED:
        raise SceneError(Problem("no such seed", f"Give 0 to {LARGEST_SEED}", field="seed", value=seed))
    highest = terrain.base_m + relief_m
    if not highest <= HIGHEST_M:
        text = f"the land would reach {highest:g} m, which is impossible"
        remedy = f"Give at most {HIGHEST_M - terrain.base_m:g} m of relief"
        raise SceneError(Problem(text, remedy, field="relief_m", value=relief_m))
    side = round(field_m / cell_m)
    if side < 1:
        raise SceneError(
            Problem(f"a field must be at least one cell of {cell_m} m wide", field="field_m", value=field_m)
        )
    relief = fractal_terrain(
        rows, cols, cell_m, relief_m=relief_m, rms_slope=terrain.rms_slope, exponent=terrain.exponent, seed=seed
    )
    piece = voronoi_labels(rows, cols, side, seed=seed)
    wrong = [
        Problem("must not be negative", field=name, value=getattr(features, name))
        for name in ("rivers", "towns", "river_m", "road_m")
        if getattr(features, name) < 0
    ]
    if wrong or features.town_m <= 0.0:
        raise SceneError(*(wrong or [Problem("must be above zero", field="town_m", value=features.town_m)]))
    # A draw for each piece, not for each of its cells.
    cover = draw_index(np.arange(int(piece.max()) + 1), [1.0] * len(categories), seed=seed + 1).astype(np.uint8)[piece]
    names, part = list(categories), np.zeros((rows, cols), dtype=np.int32)
    river = river_mask(relief, features.rivers, features.river_m / cell_m, seed=seed + 2)
    centres = town_centres(rows, cols, features.towns, seed=seed + 3)
    if features.towns:
        town = town_mask((rows, cols), centres, features.town_m / cell_m, seed=seed + 4)
        block = voronoi_labels(rows, cols, max(round(_BLOCK_M / cell_m), 1), seed=seed + 5)
        drawn = draw_index(np.arange(int(block.max()) + 1), _TOWN_SHARES, seed=seed + 6)
        kind = np.array([_number(names, name) for name in _TOWN], dtype=np.uint8)[drawn]
        cover[town], part[town] = kind[block[town]], 1 + block[town]
        del block, town
    if features.rivers:
        cover[river], part[river] = _number(names, "Water"), -1
    if features.roads:
        road = road_mask(relief, cell_m, centres, river, features.road_m / cell_m, seed=seed + 7)
        cover[road], part[road] = _number(names, "Asphalt"), -2
    elevation = np.empty((rows, cols), dtype=np.float32)
    np.add(terrain.base_m, relief, out=elevation, casting="same_kind")
    del relief
    piece[part != 0] = -1
    parts = ((f"{features.rivers} rivers", features.rivers), (f"{features.towns} towns", features.towns))
    made = "".join(f", {text}" for text, there in (*parts, ("roads", features.roads)) if there)
    return Scene(
        elevation_m=elevation,
        cover=cover,
        categories=tuple(names),
        field_id=connected_patches(piece, part, cover),
        scored=np.ones((rows, cols), dtype=bool),
        cell_m=cell_m,
        name=f"synthetic {rows} x {cols}, seed {seed}",
        licence="none needed: computed",
        provenance=f"seqrsm.scene.synthetic, voronoi fields of {field_m:g} m, relief {relief_m:g} m{made}, seed {seed}",
    )


def _number(names: list[str], name: str) -> int:
    """Number of a category, which is added where it is not among the names."""
    if name not in names:
        names.append(name)
    return names.index(name)
