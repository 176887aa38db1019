"""Numbers that describe a scene as a whole."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from seqrsm.arrays import AnyArray
from seqrsm.scene.scene import NO_COVER, Scene
from seqrsm.scene.terrain import known_slopes, rms_slope, strips


@dataclass(frozen=True, slots=True)
class SceneStatistics:
    """Statistics of a scene."""

    low_m: float
    high_m: float
    """Lowest and highest known elevation [m]."""
    rms_slope: float
    max_slope: float
    """Root-mean-square and largest slope along one axis [1]."""
    category_fractions: Mapping[str, float]
    """Share of each category among the cells whose category is known."""
    scored_fraction: float
    """Share of the cells that are scored."""
    n_fields: int
    """Fields that hold at least one cell of a known category."""
    median_field_m2: float
    """Median area of a field, each field weighted by its area [m^2]."""


def scene_statistics(scene: Scene) -> SceneStatistics:
    """Statistics of ``scene``; cells without elevation or category are left out."""
    count = _counts(scene.cover, NO_COVER + 1)[: len(scene.categories)]
    known = max(int(count.sum()), 1)
    n_fields, median = field_sizes(scene.field_id, scene.cover)
    z = scene.elevation_m
    slopes = (part for both in known_slopes(z, scene.cell_m) for part in both)
    return SceneStatistics(
        low_m=float(np.fmin.reduce(z, axis=None)),  # nan where none is known
        high_m=float(np.fmax.reduce(z, axis=None)),
        rms_slope=rms_slope(z, scene.cell_m),
        max_slope=max((float(np.abs(part).max(initial=0.0)) for part in slopes), default=0.0),
        category_fractions={name: float(n) / known for name, n in zip(scene.categories, count, strict=True)},
        scored_fraction=float(scene.scored.mean()),
        n_fields=n_fields,
        median_field_m2=median * scene.cell_m**2,
    )


def field_sizes(field_id: AnyArray, cover: AnyArray) -> tuple[int, float]:
    """How many fields hold a cell of a known category, and their median size [cells], each weighted by its size."""
    size = _counts(field_id, int(field_id.max()) + 1, cover != NO_COVER)
    size = np.sort(size[size > 0])
    middle = int(np.searchsorted(np.cumsum(size), 0.5 * size.sum()))
    return int(size.size), float(size[middle]) if size.size else 0.0


def _counts(layer: AnyArray, n: int, counted: AnyArray | None = None) -> AnyArray:
    """How many cells hold each of the numbers 0 .. n - 1; ``counted``: of these cells alone."""
    total = np.zeros(n, dtype=np.int64)
    for own in strips(*layer.shape):
        total += np.bincount(layer[own].ravel() if counted is None else layer[own][counted[own]], minlength=n)
    return total
