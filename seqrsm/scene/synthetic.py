"""Whole synthetic scenes from a seed: terrain, fields and their categories."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from seqrsm.errors import SceneError
from seqrsm.scene.fields import connected_patches, draw_index, voronoi_labels
from seqrsm.scene.scene import HIGHEST_M, MAX_CELLS, Scene
from seqrsm.scene.terrain import fractal_terrain

LARGEST_SEED: Final = 2**63 - 1


def synthetic_scene(
    rows: int,
    cols: int,
    cell_m: float,
    *,
    categories: Sequence[str],
    field_m: float = 150.0,
    relief_m: float = 0.0,
    seed: int = 0,
) -> Scene:
    """Scene of drawn fields on drawn terrain.

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
    relief_m : float
        Of the terrain, see `seqrsm.scene.terrain.fractal_terrain`; flat by default.
    seed : int
        Seed of everything that is drawn.

    Raises
    ------
    SceneError
        Impossible size, relief, field or seed.
    """
    if rows * cols > MAX_CELLS:
        text = f"{rows} x {cols} cells are more than {MAX_CELLS}"
        raise SceneError(text, "Give fewer rows or columns", field="rows", value=rows)
    if not 0 <= seed <= LARGEST_SEED:
        raise SceneError("no such seed", f"Give 0 to {LARGEST_SEED}", field="seed", value=seed)
    if not relief_m <= HIGHEST_M:
        text, remedy = f"the land would reach {relief_m:g} m, which is impossible", f"Give at most {HIGHEST_M:g} m"
        raise SceneError(text, f"{remedy} of relief", field="relief_m", value=relief_m)
    side = round(field_m / cell_m)
    if side < 1:
        raise SceneError(f"a field must be at least one cell of {cell_m} m wide", field="field_m", value=field_m)
    elevation = fractal_terrain(rows, cols, relief_m=relief_m, seed=seed).astype(np.float32)
    piece = voronoi_labels(rows, cols, side, seed=seed)
    # A draw for each piece, not for each of its cells.
    cover = draw_index(np.arange(int(piece.max()) + 1), [1.0] * len(categories), seed=seed + 1).astype(np.uint8)[piece]
    return Scene(
        elevation_m=elevation,
        cover=cover,
        categories=tuple(categories),
        field_id=connected_patches(piece, cover),
        scored=np.ones((rows, cols), dtype=bool),
        cell_m=cell_m,
        name=f"synthetic {rows} x {cols}, seed {seed}",
        licence="none needed: computed",
        provenance=f"seqrsm.scene.synthetic, voronoi fields of {field_m:g} m, relief {relief_m:g} m, seed {seed}",
    )
