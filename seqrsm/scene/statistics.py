"""Numbers that describe a scene as a whole; they are computed once and decide which simplifications are sound."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from seqrsm.scene.scene import NO_COVER, Scene
from seqrsm.scene.terrain import rms_slope, slopes


@dataclass(frozen=True, slots=True)
class SceneStatistics:
    """Statistics of a scene.

    Attributes
    ----------
    low_m, high_m : float
        Lowest and highest known elevation [m].
    rms_slope, max_slope : float
        Root-mean-square and largest slope along one axis [1].
    category_fractions : Mapping[str, float]
        Share of each category among the cells whose category is known.
    scored_fraction : float
        Share of the cells that are scored.
    boundary_density_1_m : float
        Length of category boundary to an area [1/m], for isotropic boundaries.
    n_fields : int
        Fields that hold at least one cell.
    median_field_m2 : float
        Median area of a field, each field weighted by its area [m^2].
    """

    low_m: float
    high_m: float
    rms_slope: float
    max_slope: float
    category_fractions: Mapping[str, float]
    scored_fraction: float
    boundary_density_1_m: float
    n_fields: int
    median_field_m2: float


def scene_statistics(scene: Scene) -> SceneStatistics:
    """Statistics of ``scene``; cells without elevation or category are left out."""
    count = np.bincount(scene.cover.ravel(), minlength=NO_COVER + 1)[: len(scene.categories)]
    known = max(int(count.sum()), 1)
    size = np.bincount(scene.field_id.ravel())
    size = np.sort(size[size > 0])
    half = int(np.searchsorted(np.cumsum(size), 0.5 * scene.field_id.size))
    return SceneStatistics(
        low_m=float(np.nanmin(scene.elevation_m)),
        high_m=float(np.nanmax(scene.elevation_m)),
        rms_slope=rms_slope(scene.elevation_m, scene.cell_m),
        max_slope=float(np.nanmax(np.abs(slopes(scene.elevation_m, scene.cell_m)))),
        category_fractions={name: float(n) / known for name, n in zip(scene.categories, count, strict=True)},
        scored_fraction=float(scene.scored.mean()),
        boundary_density_1_m=_boundary_density(scene),
        n_fields=int(size.size),
        median_field_m2=float(size[half]) * scene.cell_m**2,
    )


def _boundary_density(scene: Scene) -> float:
    """pi/4 x unlike neighbour pairs x cell / area: a grid counts an isotropic boundary 4/pi times too long."""
    cover = scene.cover
    unlike = np.count_nonzero(cover[1:] != cover[:-1]) + np.count_nonzero(cover[:, 1:] != cover[:, :-1])
    return 0.25 * np.pi * float(unlike) / (cover.size * scene.cell_m)
