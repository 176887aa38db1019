"""Whole synthetic scenes: terrain, fields and categories from a seed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from seqrsm.errors import Problem, SceneError
from seqrsm.scene.fields import connected_patches, draw_index, rectangle_labels, voronoi_labels
from seqrsm.scene.scene import Scene
from seqrsm.scene.terrain import fractal_terrain


def synthetic_scene(
    rows: int,
    cols: int,
    cell_m: float,
    *,
    categories: Sequence[str],
    shares: Sequence[float] | None = None,
    field_m: float = 150.0,
    layout: Literal["voronoi", "rectangles"] = "voronoi",
    relief_m: float = 0.0,
    rms_slope: float | None = None,
    exponent: float = 3.5,
    base_m: float = 0.0,
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
        Cover categories.
    shares : sequence of float, optional
        Relative number of fields of each category; equal if not given.
    field_m : float
        Mean side of a field [m], at least one cell.
    layout : "voronoi" or "rectangles"
        Form of the fields.
    relief_m, rms_slope, exponent : float
        See `seqrsm.scene.terrain.fractal_terrain`.
    base_m : float
        Height of the lowest point [m].
    seed : int
        Seed of terrain, fields and categories.

    Raises
    ------
    SceneError
        Impossible size, relief, slope, shares or field.
    """
    shares = [1.0] * len(categories) if shares is None else list(shares)
    if len(shares) != len(categories) or not categories or min(shares) < 0.0 or sum(shares) <= 0.0:
        message = f"{len(categories)} categories need as many shares >= 0, not all zero"
        raise SceneError(Problem(message, field="shares", value=shares))
    side = round(field_m / cell_m)
    if side < 1:
        raise SceneError(
            Problem(f"a field must be at least one cell of {cell_m} m wide", field="field_m", value=field_m)
        )
    relief = fractal_terrain(rows, cols, cell_m, relief_m=relief_m, rms_slope=rms_slope, exponent=exponent, seed=seed)
    if layout == "voronoi":
        piece = voronoi_labels(rows, cols, side, seed=seed)
    else:
        piece = rectangle_labels(rows, cols, side, side)
    return Scene(
        elevation_m=(base_m + relief).astype(np.float32),
        cover=draw_index(piece, shares, seed=seed + 1).astype(np.uint8),
        categories=tuple(categories),
        field_id=connected_patches(piece),
        scored=np.ones((rows, cols), dtype=bool),
        cell_m=cell_m,
        name=f"synthetic {rows} x {cols}, seed {seed}",
        licence="none needed: computed",
        provenance=f"seqrsm.scene.synthetic, {layout} fields of {field_m:g} m, relief {relief_m:g} m, seed {seed}",
    )
