"""The data base turned into the radar's frame: rows of constant ground range, columns along the flight."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from seqrsm.arrays import AnyArray, FloatArray, IntArray
from seqrsm.errors import Problem, SceneError
from seqrsm.scene.layers import known_heights, levelled, turned
from seqrsm.scene.scene import NO_COVER, Scene
from seqrsm.scene.terrain import strips
from seqrsm.sensor.radar import RadarConfiguration
from seqrsm.sensor.swath import ground_ranges_m, ring_ranges_m
from seqrsm.simulate.radar.ppi import PolarLayers, bilinear, polar_layers
from seqrsm.simulate.radar.texture import ground_of


@dataclass(frozen=True, slots=True, eq=False)
class RadarFrame:
    """A scene as one radar flies past it.

    Attributes
    ----------
    elevation_m : float array (rows, m)
        Height above the datum, the scene's mean elevation [m]; gaps filled.
    top_m : float array (rows, m)
        Height of the top of what stands on it [m]: trees and buildings; the same array where nothing does.
    cover : uint8 array (rows, m)
        Category; 255 where category or elevation is not known.
    field : int32 array (rows, m)
    source : int64 array (n,)
        Row of the layers that stands in each row of the frame; beyond the edges of the scene its mirror image.
    ground_range_m : float64 array (n,)
        Ground range of each row's centre [m].
    height_m : float
        Flight line above the datum [m].
    cell_m : float
        Side of a cell [m].
    near_edge_m, centre_m : float
        Ground range of the swath's near edge, and of the scene's centre [m].
    pad_near, n_rows : int
        Rows before the swath's own, and the number of those.
    quarter_turns : int
        ``numpy.rot90(layer, quarter_turns)`` turns a scene layer into this frame, or nearly so for other headings.
    curved : bool
        Whether the datum is a sphere.
    cell_of_scene : int64 array or None
        For headings not along the grid: place of each cell of the scene in the frame's layers.
    lowest_m, highest_m : float array (rows,)
        Extremes of each row of `elevation_m` [m].
    edge_m : tuple of float
        Medians of the elevations' rise where trees or buildings begin, and of the height of these [m].
    column_m : float64 array (n,) or None
        Distance between columns on each ring of a plan-position indicator [m]; None: `cell_m`.
    wrapped : int
        Columns of such a frame that repeat the other end, on either side; one pixel's worth.
    """

    elevation_m: AnyArray
    top_m: AnyArray
    cover: AnyArray
    field: AnyArray
    source: IntArray
    ground_range_m: FloatArray
    height_m: float
    cell_m: float
    near_edge_m: float
    centre_m: float
    pad_near: int
    n_rows: int
    quarter_turns: int
    curved: bool
    cell_of_scene: IntArray | None
    lowest_m: AnyArray
    highest_m: AnyArray
    edge_m: tuple[float, float] = (0.0, 0.0)
    column_m: FloatArray | None = None
    wrapped: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class _Turned:
    """A scene's layers in the orientation of a heading."""

    elevation_m: AnyArray
    cover: AnyArray
    field: AnyArray
    mean_m: float
    peak_m: float
    lowest_m: AnyArray
    highest_m: AnyArray
    relief_m: AnyArray
    turns: int
    cell_of_scene: IntArray | None


def make_frame(scene: Scene, radar: RadarConfiguration, precision: str) -> RadarFrame:
    """Turn a scene so that the radar looks along its rows, and fill its gaps.

    Relief moves echoes in range, so image rows at the rim would lack echoes from ground outside the swath. Rows beyond
    the swath, mirrored at the edges of the scene, stand in for that ground; they are never scored.

    Parameters
    ----------
    scene : Scene
    radar : RadarConfiguration
    precision : {"float32", "float64"}
        Element type of the elevations.

    Returns
    -------
    RadarFrame

    Raises
    ------
    ConfigurationError
        The swath is impossible from this flight line.
    SceneError
        No cell has an elevation.
    """
    scene = ground_of(scene, radar)
    if radar.scan == "ppi":
        return _polar_frame(scene, radar, precision)
    layers = _turned(scene, radar.heading_deg, precision)
    n_rows = layers.elevation_m.shape[0]
    y, rows = ground_ranges_m(radar, n_rows, scene.cell_m, layers.mean_m, layers.peak_m)
    height = radar.altitude_m - layers.mean_m
    own = y[rows]
    near, far = _padding(layers.relief_m[rows], own, height, scene.cell_m, radar.resolution_m)
    steps = np.arange(rows.start - near, rows.stop + far)
    # Mirrored at the edges of the scene: -1 is row 0 again, n is row n - 1. ~k is -1 - k.
    mirrored = np.maximum(steps, ~steps)
    np.minimum(mirrored, 2 * n_rows - 1 - mirrored, out=mirrored)
    top, edge = _tops(layers, scene.categories, radar.tree_height_m, radar.building_height_m)
    return RadarFrame(
        elevation_m=layers.elevation_m,
        top_m=top,
        cover=layers.cover,
        field=layers.field,
        source=mirrored,
        ground_range_m=y[0] + steps * scene.cell_m,
        height_m=height,
        cell_m=scene.cell_m,
        near_edge_m=float(own[0]) - 0.5 * scene.cell_m,
        centre_m=0.5 * float(y[0] + y[-1]),
        pad_near=near,
        n_rows=len(own),
        quarter_turns=layers.turns,
        curved=radar.curved,
        cell_of_scene=layers.cell_of_scene,
        lowest_m=layers.lowest_m,
        highest_m=layers.highest_m,
        edge_m=edge,
    )


def _polar_frame(scene: Scene, radar: RadarConfiguration, precision: str) -> RadarFrame:
    """Frame of a plan-position indicator: rings around the antenna; those outside the swath stand beside it."""
    known_heights(scene)
    east, north = radar.antenna_east_m, radar.antenna_north_m
    polar = polar_layers(scene, east, north, radar.azimuth_beamwidth_rad, precision)
    n_rings = polar.elevation_m.shape[0]
    y, rows = ring_ranges_m(radar, n_rings, scene.cell_m, polar.mean_m, polar.peak_m)
    if (polar.cover == NO_COVER).all():
        text = "the antenna does not see the scene"
        raise SceneError(Problem(text, "Move it closer", field="antenna_east_m", value=east))
    top, edge = _tops(polar, scene.categories, radar.tree_height_m, radar.building_height_m)
    return RadarFrame(
        elevation_m=polar.elevation_m,
        top_m=top,
        cover=polar.cover,
        field=polar.field,
        source=np.arange(n_rings),
        ground_range_m=y,
        height_m=radar.altitude_m - polar.mean_m,
        cell_m=scene.cell_m,
        near_edge_m=float(y[rows][0]) - 0.5 * scene.cell_m,
        centre_m=0.5 * float(y[rows][0] + y[rows][-1]),
        pad_near=rows.start,
        n_rows=rows.stop - rows.start,
        quarter_turns=0,
        curved=radar.curved,
        cell_of_scene=polar.cell_of_scene,
        lowest_m=polar.elevation_m.min(axis=1),
        highest_m=polar.elevation_m.max(axis=1),
        edge_m=edge,
        column_m=y * polar.column_rad,
        wrapped=polar.columns_a_pixel,
    )


def to_scene(layer: AnyArray, frame: RadarFrame, scene_shape: tuple[int, int], missing: int) -> AnyArray:
    """Layer (rows, m) of the frame's layers in the scene's own extent and orientation; ``missing`` beyond them."""
    if frame.cell_of_scene is None:
        return np.ascontiguousarray(np.rot90(layer, -frame.quarter_turns))
    seen = layer.ravel()
    out = np.full(scene_shape, missing, dtype=layer.dtype)
    for row, place in zip(out, frame.cell_of_scene.reshape(scene_shape), strict=True):
        inside = (place >= 0) & (place < seen.size)
        row[inside] = seen[place[inside]]
    return out


# The layers do not depend on the run, so the runs of a campaign share them.
@lru_cache(maxsize=2)
def _tops(
    layers: _Turned | PolarLayers, categories: tuple[str, ...], trees_m: float, buildings_m: float
) -> tuple[AnyArray, tuple[float, float]]:
    """Height of the top of what stands on each cell, and ``edge_m`` of `RadarFrame`."""
    height = np.zeros(NO_COVER + 1, dtype=layers.elevation_m.dtype)
    for name, own in (("Trees", trees_m), ("Buildings", buildings_m)):
        if name in categories:
            height[categories.index(name)] = own
    ground, tall = layers.elevation_m, height[layers.cover]
    stands = tall > 0.0
    if not stands.any():
        return ground, (0.0, 0.0)
    one, other = np.s_[:, :-2], np.s_[:, 2:]
    edge = stands[one] != stands[other]
    rise = np.where(stands[other][edge], 1.0, -1.0) * (ground[other][edge] - ground[one][edge])
    return ground + tall, (float(np.median(rise)) if rise.size else 0.0, float(np.median(tall[stands])))


@lru_cache(maxsize=2)
def _turned(scene: Scene, heading_deg: float, precision: str) -> _Turned:
    _, mean, highest = known_heights(scene)
    turns = round((heading_deg - 90.0) / 90.0)
    place: IntArray | None = None
    if heading_deg % 90.0 == 0.0:
        elevation, cover, field = turned(scene, turns, precision)
    else:
        elevation, cover, field, place = _rotated(scene, math.radians(heading_deg), precision)
        if np.isnan(elevation).all():
            text = "turned to the heading, no cell has an elevation"
            remedy = "Fly along the grid: a heading of 0, 90, 180 or 270 deg"
            raise SceneError(Problem(text, remedy, field="heading_deg", value=heading_deg))
    cover = levelled(elevation, cover, mean)
    lowest, top = elevation.min(axis=1), elevation.max(axis=1)
    return _Turned(elevation, cover, field, mean, highest, lowest, top, np.maximum(top, -lowest), turns, place)


def _rotated(scene: Scene, heading_rad: float, precision: str) -> tuple[AnyArray, AnyArray, AnyArray, IntArray]:
    """Layers on a grid along the heading, of the scene's cell size and wide enough for all of it."""
    rows, cols = scene.shape
    sine, cosine = math.sin(heading_rad), math.cos(heading_rad)
    m = math.ceil(cols * abs(sine) + rows * abs(cosine))
    n = math.ceil(cols * abs(cosine) + rows * abs(sine))
    if max(m, n) == 2:
        # One cell: the middle of the grid must be the middle of a cell, or all of them miss it.
        m, n = 3, 3
    elevation = np.empty((n, m), dtype=precision)
    cover, field = np.empty((n, m), dtype=np.uint8), np.empty((n, m), dtype=np.int32)
    # Some rows at a time: whole arrays of positions would take many times the memory of the layers.
    for part in strips(n, m):
        # Range (to the right of the heading) and azimuth of each frame cell from the centre, then east and south of it.
        away = (np.arange(part.start, part.stop) - 0.5 * (n - 1))[:, None]
        along = (np.arange(m) - 0.5 * (m - 1))[None, :]
        col = 0.5 * (cols - 1) + along * sine + away * cosine
        row = 0.5 * (rows - 1) - along * cosine + away * sine
        inside = (row > -0.5) & (row < rows - 0.5) & (col > -0.5) & (col < cols - 0.5)
        i = np.rint(np.clip(row, 0, rows - 1)).astype(np.int64)
        j = np.rint(np.clip(col, 0, cols - 1)).astype(np.int64)
        elevation[part] = np.where(inside, bilinear(scene.elevation_m, row, col), np.nan)
        cover[part] = np.where(inside, scene.cover[i, j], np.uint8(NO_COVER))
        field[part] = scene.field_id[i, j]
    place = np.empty((rows, cols), dtype=np.int64)
    own_col = np.arange(cols)[None, :] - 0.5 * (cols - 1)
    for part in strips(rows, cols):
        own_row = np.arange(part.start, part.stop)[:, None] - 0.5 * (rows - 1)
        a = np.rint(own_col * sine - own_row * cosine + 0.5 * (m - 1)).astype(np.int64)
        r = np.rint(own_col * cosine + own_row * sine + 0.5 * (n - 1)).astype(np.int64)
        place[part] = np.clip(r, 0, n - 1) * m + np.clip(a, 0, m - 1)
    return elevation, cover, field, place


def _padding(relief: AnyArray, y: FloatArray, height_m: float, cell_m: float, resolution_m: float) -> tuple[int, int]:
    """Rows to add before and behind the swath: twice the relief displacement beyond the edge, and one pixel."""
    moved = relief * (height_m / y)
    out = []
    for reach, room in (
        (float((y[0] - y + moved).max()), int((y[0] - 0.5 * cell_m) / cell_m)),
        (float((y - y[-1] + moved).max()), len(y)),
    ):
        wanted = math.ceil((2.0 * max(reach, 0.0) + resolution_m) / cell_m) + 1
        out.append(max(min(wanted, room, len(y)), 0))
    return out[0], out[1]
