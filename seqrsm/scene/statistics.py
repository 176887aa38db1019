"""Numbers that describe a scene as a whole; they are computed once and decide which simplifications are sound."""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np

from seqrsm.arrays import AnyArray
from seqrsm.scene.scene import NO_COVER, Scene
from seqrsm.scene.terrain import known_slopes, rms_slope, strips

_VERSION: Final = 2
"""Of the statistics' definitions: those kept by another version are computed anew."""

PYRAMID: Final = (1, 2, 4, 8)
"""Cells along a side of the blocks over which slopes are taken."""


@dataclass(frozen=True, slots=True)
class SceneStatistics:
    """Statistics of a scene.

    Attributes
    ----------
    low_m, high_m : float
        Lowest and highest known elevation [m].
    rms_slope, max_slope : float
        Root-mean-square and largest slope along one axis [1].
    step_slope_east, step_slope_north : float
        Largest slope between neighbouring cells along each axis [1]: what proves that nothing is hidden.
    rms_slope_east, rms_slope_north : tuple of float
        Root-mean-square slope along each axis [1] of the terrain as it is, and averaged over 2, 4 and 8 cells.
    category_fractions : Mapping[str, float]
        Share of each category among the cells whose category is known.
    scored_fraction : float
        Share of the cells that are scored.
    scored_fractions : Mapping[str, float]
        Share of each category among them.
    boundary_density_1_m : float
        Length of category boundary to an area [1/m], for isotropic boundaries.
    field_boundary_density_1_m : float
        The same for the boundaries of fields.
    n_fields : int
        Fields that hold at least one cell.
    median_field_m2 : float
        Median area of a field, each field weighted by its area [m^2].
    """

    low_m: float
    high_m: float
    rms_slope: float
    max_slope: float
    step_slope_east: float
    step_slope_north: float
    rms_slope_east: tuple[float, ...]
    rms_slope_north: tuple[float, ...]
    category_fractions: Mapping[str, float]
    scored_fraction: float
    scored_fractions: Mapping[str, float]
    boundary_density_1_m: float
    field_boundary_density_1_m: float
    n_fields: int
    median_field_m2: float


def scene_statistics(scene: Scene) -> SceneStatistics:
    """Statistics of ``scene``; cells without elevation or category are left out.

    Those kept with the scene's file if they are of these very layers, else computed.
    """
    if not scene.kept_statistics:
        return _computed(scene)
    try:
        kept = json.loads(scene.kept_statistics)
        if kept["of"] != _fingerprint(scene):
            return _computed(scene)
        own: dict[str, Any] = {name: tuple(x) if isinstance(x, list) else x for name, x in kept["statistics"].items()}
        return SceneStatistics(**own)
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return _computed(scene)


def statistics_text(scene: Scene) -> str:
    """Statistics of ``scene`` as they are kept with its file, and what they are of; "" where no elevation is known."""
    if not np.isfinite(scene.elevation_m).any():
        return ""
    return json.dumps({"of": _fingerprint(scene), "statistics": asdict(_computed(scene))}, sort_keys=True)


def _fingerprint(scene: Scene) -> str:
    """Of all that the statistics depend on, this version of them among it."""
    crc = zlib.crc32(repr((_VERSION, scene.cell_m, scene.categories, scene.shape)).encode())
    for layer in (scene.elevation_m, scene.cover, scene.field_id, scene.scored):
        crc = zlib.crc32(np.ascontiguousarray(layer).data, crc)
    return f"{crc:08x}"


def _computed(scene: Scene) -> SceneStatistics:
    count = _counts(scene.cover, NO_COVER + 1)[: len(scene.categories)]
    known = max(int(count.sum()), 1)
    of_scored = _counts(scene.cover, NO_COVER + 1, scene.scored)[: len(scene.categories)]
    tested = max(int(of_scored.sum()), 1)
    size = _counts(scene.field_id, scene.n_fields)
    size = np.sort(size[size > 0])
    half = int(np.searchsorted(np.cumsum(size), 0.5 * scene.field_id.size))
    z = scene.elevation_m
    low, high = _ends(z)
    levels = [_rms_along(aggregated(z, factor), factor * scene.cell_m) for factor in PYRAMID]
    return SceneStatistics(
        low_m=low,
        high_m=high,
        rms_slope=rms_slope(z, scene.cell_m),
        max_slope=_largest_slope(z, scene.cell_m),
        step_slope_east=_largest_step(z, 1) / scene.cell_m,
        step_slope_north=_largest_step(z, 0) / scene.cell_m,
        rms_slope_east=tuple(east for east, _ in levels),
        rms_slope_north=tuple(north for _, north in levels),
        category_fractions={name: float(n) / known for name, n in zip(scene.categories, count, strict=True)},
        scored_fraction=float(scene.scored.mean()),
        scored_fractions={name: float(n) / tested for name, n in zip(scene.categories, of_scored, strict=True)},
        boundary_density_1_m=_boundary_density(scene.cover, scene.cell_m),
        field_boundary_density_1_m=_boundary_density(scene.field_id, scene.cell_m),
        n_fields=int(size.size),
        median_field_m2=float(size[half]) * scene.cell_m**2,
    )


def _counts(layer: AnyArray, n: int, kept: AnyArray | None = None) -> AnyArray:
    """How many cells hold each of the numbers 0 .. n - 1, among those kept."""
    total = np.zeros(n, dtype=np.int64)
    for own in strips(*layer.shape):
        total += np.bincount((layer[own] if kept is None else layer[own][kept[own]]).ravel(), minlength=n)
    return total


def aggregated(layer: AnyArray, factor: int) -> AnyArray:
    """Mean of the known values of every ``factor`` x ``factor`` cells; what is left over at the edges is dropped."""
    rows, cols = layer.shape[0] // factor, layer.shape[1] // factor
    if factor == 1 or min(rows, cols) < 2:
        return layer
    blocks = layer[: rows * factor, : cols * factor].reshape(rows, factor, cols, factor)
    if not np.isnan(layer).any():
        return np.asarray(blocks.mean(axis=(1, 3), dtype=np.float64))
    known = np.isfinite(blocks)
    total = np.where(known, blocks, 0.0).sum(axis=(1, 3), dtype=np.float64)
    n = known.sum(axis=(1, 3))
    return np.where(n > 0, total / np.maximum(n, 1), np.nan)


def _rms_along(z: AnyArray, cell_m: float) -> tuple[float, float]:
    """Root-mean-square slope towards east and towards north; 0 where no slope is known."""
    total, n = np.zeros(2), np.zeros(2)
    for both in known_slopes(z, cell_m):
        total += [np.add.reduce(np.square(slope)) for slope in both]
        n += [slope.size for slope in both]
    east, north = np.sqrt(total / np.maximum(n, 1.0))
    return float(east), float(north)


def _largest_slope(z: AnyArray, cell_m: float) -> float:
    """Largest slope along one axis; 0 where no slope is known."""
    return max((float(np.abs(part).max(initial=0.0)) for both in known_slopes(z, cell_m) for part in both), default=0.0)


def _largest_step(z: AnyArray, axis: int) -> float:
    """Largest difference between neighbours along an axis; a step over unknown cells counts as the whole relief."""
    largest, unknown = 0.0, False
    for own in strips(*z.shape):
        step = np.abs(np.diff(z[own.start : own.stop + (axis == 0)], axis=axis))
        known = step[np.isfinite(step)]
        largest = max(largest, float(known.max(initial=0.0)))
        unknown = unknown or known.size < step.size
    if not unknown:
        return largest
    low, high = _ends(z)
    return high - low


def _ends(z: AnyArray) -> tuple[float, float]:
    """Least and largest known elevation; nan where none is known."""
    return float(np.fmin.reduce(z, axis=None)), float(np.fmax.reduce(z, axis=None))


def _boundary_density(label: AnyArray, cell_m: float) -> float:
    """pi/4 x unlike neighbour pairs x cell / area: a grid counts an isotropic boundary 4/pi times too long."""
    unlike = np.count_nonzero(label[1:] != label[:-1]) + np.count_nonzero(label[:, 1:] != label[:, :-1])
    return 0.25 * np.pi * float(unlike) / (label.size * cell_m)
