"""The data base turned into the radar's frame: rows of constant ground range, columns along the flight.

Of a plan-position indicator, a rotating antenna over one point (RSL TR 380-1 section 3.2.3), rows are rings of one
ground range and columns bearings, on which the same kernels work; pixels are as wide as the real beam, a constant
angle. `seqrsm.simulate.radar.result` turns that picture back into rectangular coordinates, north up.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Final

import numpy as np

from seqrsm.arrays import AnyArray, FloatArray, IntArray
from seqrsm.errors import ConfigurationError, SceneError
from seqrsm.plain import shallow
from seqrsm.scene.fields import voronoi_labels
from seqrsm.scene.layers import fill_gaps, known_heights, levelled, turned
from seqrsm.scene.scene import NO_COVER, Scene
from seqrsm.scene.terrain import strips
from seqrsm.sensor.radar import RadarConfiguration
from seqrsm.sensor.swath import ground_ranges_m

_MOST_CELLS: Final = 400_000_000
_SEED: Final = 1979
"""Of the pieces' outlines, which are the same in every run; their backscatter is drawn anew."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FrameLayers:
    """A scene's layers in the orientation of a heading, or on rings around the antenna, whatever the run."""

    elevation_m: AnyArray
    """(rows, m): height above the datum, the scene's mean elevation [m]; gaps filled."""
    cover: AnyArray
    """(rows, m): category; 255 where category or elevation is not known."""
    field: AnyArray
    """(rows, m)."""
    mean_m: float
    peak_m: float
    """Of the scene's elevations [m]."""
    lowest_m: AnyArray
    highest_m: AnyArray
    """(rows,): extremes of each row of `elevation_m` [m]."""
    quarter_turns: int
    """``numpy.rot90(layer, quarter_turns)`` turns a scene layer into this frame, or nearly so for other headings."""
    cell_of_scene: IntArray | None
    """(rows, cols): place of each cell of the scene in the layers, where they do not lie along its grid."""
    wrapped: int = 0
    """Columns of a pixel of a plan-position indicator, else 0. Its columns go clockwise from north; the first and the
    last so many repeat the other end, so that slopes and beams run over north without a seam."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RadarFrame(FrameLayers):
    """A scene as one radar flies past it."""

    top_m: AnyArray
    """(rows, m): height of the top of what stands on it [m]: trees and buildings; the same array where nothing does."""
    source: IntArray
    """(n,): row of the layers that stands in each row of the frame; beyond the edges of the scene its mirror image."""
    ground_range_m: FloatArray
    """(n,): ground range of each row's centre [m]."""
    height_m: float
    """Flight line above the datum [m]."""
    cell_m: float
    """Side of a cell [m]."""
    near_edge_m: float
    centre_m: float
    """Ground range of the swath's near edge, and of the scene's centre [m]."""
    pad_near: int
    n_rows: int
    """Rows before the swath's own, and the number of those."""
    curved: bool
    """Whether the datum is a sphere."""
    edge_m: tuple[float, float] = (0.0, 0.0)
    """Medians of the elevations' rise where trees or buildings begin, and of the height of these [m]."""
    column_m: FloatArray | None = None
    """(n,): distance between columns on each ring of a plan-position indicator [m]; None: `cell_m`."""


@lru_cache(maxsize=6)
def pieces(scene: Scene, texture_m: float) -> tuple[Scene, IntArray]:
    """Fields cut into Voronoi pieces of ``texture_m`` [m] on average a side, at least a cell.

    The scene whose ``field_id`` numbers pieces, and the field that each piece is of (n_pieces,).
    """
    rows, cols = scene.shape
    cut = voronoi_labels(rows, cols, max(round(texture_m / scene.cell_m), 1), seed=_SEED)
    width = int(cut.max()) + 1
    key = scene.field_id.astype(np.int64).ravel()
    key *= width
    key += cut.ravel()
    # Runs of like cells stand for their cells: there are far fewer to sort.
    first = np.flatnonzero(np.concatenate([[True], key[1:] != key[:-1]]))
    found, number = np.unique(key[first], return_inverse=True)
    piece = np.repeat(number.astype(np.int32), np.diff(first, append=key.size))
    return replace(scene, field_id=piece.reshape(rows, cols)), found // width


def ground_of(scene: Scene, radar: RadarConfiguration) -> Scene:
    """The scene as a radar's frame wants it: with pieces in place of fields where it asks for texture."""
    return pieces(scene, radar.texture_m)[0] if radar.texture_db > 0.0 else scene


def make_frame(scene: Scene, radar: RadarConfiguration, precision: str) -> RadarFrame:
    """Turn a scene so that the radar looks along its rows, and fill its gaps.

    Relief moves echoes in range, so image rows at the rim would lack echoes from ground outside the swath. Rows beyond
    the swath, mirrored at the edges of the scene, stand in for that ground; they are never scored. Rings of a
    plan-position indicator stand there themselves. ``precision``, "float32" or "float64", is that of the elevations.

    Raises
    ------
    ConfigurationError
        The swath is impossible from this flight line.
    SceneError
        No cell has an elevation, or the antenna sees none.
    """
    scene = ground_of(scene, radar)
    cell = scene.cell_m
    if radar.scan == "ppi":
        known_heights(scene)
        place = radar.antenna_east_m, radar.antenna_north_m
        layers = polar_layers(scene, *place, radar.azimuth_beamwidth_rad, precision)
    else:
        layers = _turned(scene, radar.heading_deg, precision)
    n_rows = len(layers.elevation_m)
    y, rows = ground_ranges_m(radar, n_rows, cell, layers.mean_m, layers.peak_m)
    if layers.wrapped and (layers.cover == NO_COVER).all():
        text = "the antenna does not see the scene"
        raise SceneError(text, "Move it closer", field="antenna_east_m", value=radar.antenna_east_m)
    height, own = radar.altitude_m - layers.mean_m, y[rows]
    if layers.wrapped:
        source, pad_near, ranges, centred = np.arange(n_rows), rows.start, y, own
    else:
        pad_near, far = _padding(layers, rows, own, height, cell, radar.resolution_m)
        steps = np.arange(rows.start - pad_near, rows.stop + far)
        # Mirrored at the edges of the scene: -1 is row 0 again, n is row n - 1. ~k is -1 - k.
        source = np.maximum(steps, ~steps)
        np.minimum(source, 2 * n_rows - 1 - source, out=source)
        ranges, centred = y[0] + steps * cell, y
    top, edge = _tops(layers, scene.categories, radar.tree_height_m, radar.building_height_m)
    column_rad = 2.0 * math.pi / (layers.elevation_m.shape[1] - 2 * layers.wrapped)
    return RadarFrame(
        **shallow(layers),
        top_m=top,
        source=source,
        ground_range_m=ranges,
        height_m=height,
        cell_m=cell,
        near_edge_m=float(own[0]) - 0.5 * cell,
        centre_m=0.5 * float(centred[0] + centred[-1]),
        pad_near=pad_near,
        n_rows=len(own),
        curved=radar.curved,
        edge_m=edge,
        column_m=y * column_rad if layers.wrapped else None,
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
    layers: FrameLayers, categories: tuple[str, ...], trees_m: float, buildings_m: float
) -> tuple[AnyArray, tuple[float, float]]:
    """Height of the top of what stands on each cell, and ``edge_m`` of `RadarFrame`."""
    height = np.zeros(NO_COVER + 1, dtype=layers.elevation_m.dtype)
    for name, own in (("Trees", trees_m), ("Buildings", buildings_m)):
        if name in categories:
            height[categories.index(name)] = own
    ground = layers.elevation_m
    if not height.any() or not (stands := (height > 0.0)[layers.cover]).any():
        return ground, (0.0, 0.0)
    tall = height[layers.cover]
    one, other = np.s_[:, :-2], np.s_[:, 2:]
    edge = stands[one] != stands[other]
    rise = np.where(stands[other][edge], 1.0, -1.0) * (ground[other][edge] - ground[one][edge])
    return ground + tall, (float(np.median(rise)) if rise.size else 0.0, float(np.median(tall[stands])))


@lru_cache(maxsize=2)
def _turned(scene: Scene, heading_deg: float, precision: str) -> FrameLayers:
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
            raise SceneError(text, remedy, field="heading_deg", value=heading_deg)
    cover = levelled(elevation, cover, mean)
    return _layers(elevation, cover, field, mean_m=mean, peak_m=highest, quarter_turns=turns, cell_of_scene=place)


def _layers(elevation: AnyArray, cover: AnyArray, field: AnyArray, **more: Any) -> FrameLayers:
    ends: dict[str, Any] = {"lowest_m": elevation.min(axis=1), "highest_m": elevation.max(axis=1)}
    return FrameLayers(elevation_m=elevation, cover=cover, field=field, **ends, **more)


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
        elevation[part], cover[part], field[part] = _sampled(scene, row, col)
    place = np.empty((rows, cols), dtype=np.int64)
    own_col = np.arange(cols)[None, :] - 0.5 * (cols - 1)
    for part in strips(rows, cols):
        own_row = np.arange(part.start, part.stop)[:, None] - 0.5 * (rows - 1)
        a = np.rint(own_col * sine - own_row * cosine + 0.5 * (m - 1)).astype(np.int64)
        r = np.rint(own_col * cosine + own_row * sine + 0.5 * (n - 1)).astype(np.int64)
        place[part] = np.clip(r, 0, n - 1) * m + np.clip(a, 0, m - 1)
    return elevation, cover, field, place


def _padding(
    layers: FrameLayers, rows: slice, y: FloatArray, height_m: float, cell_m: float, resolution_m: float
) -> tuple[int, int]:
    """Rows to add before and behind the swath: twice the relief displacement beyond the edge, and one pixel."""
    relief = np.maximum(layers.highest_m, -layers.lowest_m)[rows]
    moved = relief * (height_m / y)
    out = []
    for reach, room in (
        (float((y[0] - y + moved).max()), int((y[0] - 0.5 * cell_m) / cell_m)),
        (float((y - y[-1] + moved).max()), len(y)),
    ):
        wanted = math.ceil((2.0 * max(reach, 0.0) + resolution_m) / cell_m) + 1
        out.append(max(min(wanted, room, len(y)), 0))
    return out[0], out[1]


@lru_cache(maxsize=2)
def polar_layers(scene: Scene, east_m: float, north_m: float, beamwidth_rad: float, precision: str) -> FrameLayers:
    """Scene in polar coordinates: elevation by straight lines, category and field by the nearest cell.

    Rings are a cell apart and reach the farthest corner of the scene; columns are at most a cell apart on the farthest
    ring. What lies outside the scene is no data. The antenna stands east and north of the middle of the scene [m].
    Pixels are as wide as the half-power beam in azimuth, rounded so that their number is a multiple of 4.

    Raises
    ------
    ConfigurationError
        The antenna stands so far away that the rings would not fit into memory.
    """
    rows, cols = scene.shape
    cell = scene.cell_m
    corner = math.hypot(0.5 * cols * cell + abs(east_m), 0.5 * rows * cell + abs(north_m))
    rings = math.ceil(corner / cell)
    pixels = max(4 * round(0.5 * math.pi / beamwidth_rad), 4)  # around
    wide = max(math.ceil(2.0 * math.pi * rings / pixels), 1)
    columns = (pixels + 2) * wide
    if rings * columns > _MOST_CELLS:
        text = f"the farthest corner of the scene is {corner:.0f} m away: {rings} rings of {columns} cells"
        remedy = f"Move the antenna closer, or coarsen the scene: at most {_MOST_CELLS} cells are possible"
        raise ConfigurationError(text, remedy, field="antenna_east_m", value=east_m)
    step = 2.0 * math.pi / (pixels * wide)
    bearing = (np.arange(-wide, (pixels + 1) * wide) + 0.5)[None, :] * step
    _, mean, peak = known_heights(scene)
    elevation = np.empty((rings, columns), dtype=precision)
    cover = np.empty(elevation.shape, dtype=np.uint8)
    field = np.empty(elevation.shape, dtype=np.int32)
    # Some rings at a time: whole arrays of positions would take many times the memory of the layers.
    for part in strips(rings, columns):
        radius = np.arange(part.start + 1.0, part.stop + 1.0)[:, None]
        col = 0.5 * (cols - 1) + east_m / cell + radius * np.sin(bearing)
        row = 0.5 * (rows - 1) - north_m / cell - radius * np.cos(bearing)
        height, kind, field[part] = _sampled(scene, row, col)
        elevation[part] = height - mean
        cover[part] = np.where(np.isnan(height), np.uint8(NO_COVER), kind)
    if np.isnan(elevation).any() and not np.isnan(elevation).all():
        fill_gaps(elevation)
    place = np.empty((rows, cols), dtype=np.int64)
    east = (np.arange(cols) - 0.5 * (cols - 1)) - east_m / cell
    for k in range(rows):
        north = (0.5 * (rows - 1) - k) - north_m / cell
        ring = np.clip(np.rint(np.hypot(east, north)).astype(np.int64) - 1, 0, rings - 1)
        column = np.floor(np.mod(np.arctan2(east, north), 2.0 * math.pi) / step).astype(np.int64)
        place[k] = ring * columns + wide + np.minimum(column, pixels * wide - 1)
    more = {"mean_m": mean, "peak_m": peak, "quarter_turns": 0, "cell_of_scene": place, "wrapped": wide}
    return _layers(elevation, cover, field, **more)


def _sampled(scene: Scene, row: FloatArray, col: FloatArray) -> tuple[FloatArray, AnyArray, AnyArray]:
    """Elevation [m] by straight lines, category and field by the nearest cell; nan and no category beyond the scene."""
    rows, cols = scene.shape
    inside = (row > -0.5) & (row < rows - 0.5) & (col > -0.5) & (col < cols - 0.5)
    i = np.rint(np.clip(row, 0, rows - 1)).astype(np.int64)
    j = np.rint(np.clip(col, 0, cols - 1)).astype(np.int64)
    elevation = np.where(inside, bilinear(scene.elevation_m, row, col), np.nan)
    return elevation, np.where(inside, scene.cover[i, j], np.uint8(NO_COVER)), scene.field_id[i, j]


def bilinear(layer: AnyArray, row: FloatArray, col: FloatArray) -> FloatArray:
    """Values of a layer between its cells by straight lines; held at the edges, beside nan the nearest cell's."""
    rows, cols = layer.shape
    r, c = np.clip(row, 0.0, rows - 1.0), np.clip(col, 0.0, cols - 1.0)
    i, j = np.minimum(r.astype(np.int64), max(rows - 2, 0)), np.minimum(c.astype(np.int64), max(cols - 2, 0))
    fr, fc = r - i, c - j
    down, right = np.minimum(i + 1, rows - 1), np.minimum(j + 1, cols - 1)
    upper = (1.0 - fc) * layer[i, j] + fc * layer[i, right]
    lower = (1.0 - fc) * layer[down, j] + fc * layer[down, right]
    out = (1.0 - fr) * upper + fr * lower
    beside = np.isnan(out)
    if beside.any():
        # A cell beside a hole keeps what is known of it.
        nearest = layer[np.rint(r).astype(np.int64), np.rint(c).astype(np.int64)]
        out = np.where(beside, nearest, out)
    return np.asarray(out)
