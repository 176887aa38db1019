"""The data base turned into the radar's frame: rows of constant ground range, columns along the flight."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from seqrsm.arrays import AnyArray, FloatArray
from seqrsm.errors import Problem, SceneError
from seqrsm.scene.scene import NO_COVER, Scene
from seqrsm.sensor.radar import RadarConfiguration
from seqrsm.simulate import kernels


@dataclass(frozen=True, slots=True, eq=False)
class RadarFrame:
    """A scene as one radar flies past it.

    Attributes
    ----------
    elevation_m : float array (n, m)
        Height above the datum, the scene's mean elevation [m]; gaps filled.
    cover : uint8 array (n, m)
        Category; 255 where category or elevation is not known.
    field : int32 array (n, m)
    ground_range_m : float64 array (n,)
        Ground range of each row's centre [m].
    height_m : float
        Flight line above the datum [m].
    cell_m : float
        Side of a cell [m].
    near_edge_m, centre_m : float
        Ground range of the scene's near edge and centre [m].
    pad_near, n_rows : int
        Mirrored rows before the scene's own, and the number of those.
    quarter_turns : int
        ``numpy.rot90(layer, quarter_turns)`` turns a scene layer into this frame.
    """

    elevation_m: AnyArray
    cover: AnyArray
    field: AnyArray
    ground_range_m: FloatArray
    height_m: float
    cell_m: float
    near_edge_m: float
    centre_m: float
    pad_near: int
    n_rows: int
    quarter_turns: int


def make_frame(scene: Scene, radar: RadarConfiguration, precision: str) -> RadarFrame:
    """Turn a scene so that the radar looks along its rows, and fill its gaps.

    Relief moves echoes in range, so image rows at the rim would lack echoes from ground outside the data base. Rows
    mirrored at the near and far edge stand in for that ground; they are never scored.

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
    known, mean, highest = kernels.elevation_summary(scene.elevation_m)
    if known == 0:
        raise SceneError(Problem("no cell has an elevation", "Give at least one", field="elevation_m"))
    turns = round((radar.heading_deg - 90.0) / 90.0)
    n_rows = scene.elevation_m.shape[turns % 2]
    y = radar.ground_ranges_m(n_rows, scene.cell_m, mean, highest)
    elevation = np.rot90(scene.elevation_m, turns).astype(precision)
    elevation -= elevation.dtype.type(mean)
    cover = np.rot90(scene.cover, turns)
    if known < elevation.size:
        cover = np.where(np.isnan(elevation), np.uint8(NO_COVER), cover)
        kernels.fill_no_data(elevation)
    height = radar.altitude_m - mean
    near, far = _padding(elevation, y, height, scene.cell_m, radar.resolution_m)
    pad = ((near, far), (0, 0))
    steps = np.arange(-near, n_rows + far)
    return RadarFrame(
        elevation_m=np.pad(elevation, pad, mode="symmetric"),
        cover=np.pad(cover, pad, mode="symmetric"),
        field=np.pad(np.rot90(scene.field_id, turns), pad, mode="symmetric"),
        ground_range_m=y[0] + steps * scene.cell_m,
        height_m=height,
        cell_m=scene.cell_m,
        near_edge_m=float(y[0]) - 0.5 * scene.cell_m,
        centre_m=0.5 * float(y[0] + y[-1]),
        pad_near=near,
        n_rows=n_rows,
        quarter_turns=turns,
    )


def unpadded(layer: AnyArray, frame: RadarFrame) -> AnyArray:
    """Layer of the frame in the scene's own extent and orientation."""
    own = layer[frame.pad_near : frame.pad_near + frame.n_rows]
    return np.ascontiguousarray(np.rot90(own, -frame.quarter_turns))


def _padding(
    elevation: AnyArray, y: FloatArray, height_m: float, cell_m: float, resolution_m: float
) -> tuple[int, int]:
    """Rows to mirror before and behind the scene: twice the relief displacement beyond the edge, and one pixel."""
    moved = np.abs(elevation).max(axis=1) * (height_m / y)
    out = []
    for reach, room in (
        (float(np.max(y[0] - y + moved)), int((y[0] - 0.5 * cell_m) / cell_m)),
        (float(np.max(y - y[-1] + moved)), len(y)),
    ):
        wanted = math.ceil((2.0 * max(reach, 0.0) + resolution_m) / cell_m) + 1
        out.append(max(min(wanted, room, len(y)), 0))
    return out[0], out[1]
