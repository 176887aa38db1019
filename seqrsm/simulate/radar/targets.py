"""Cultural targets: man-made objects with an echo of their own, RSL TR 380-1 section 3.2.2.3.

Each is an isotropic radiator of so many decibels, or specular in named directions from true north.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from seqrsm.arrays import AnyArray
from seqrsm.csv_lines import read_cells
from seqrsm.errors import Problem, SceneError
from seqrsm.sensor.earth import range_geometry
from seqrsm.sensor.radar import RadarConfiguration
from seqrsm.simulate.radar.echo import EchoGrid, range_offset
from seqrsm.simulate.radar.frame import RadarFrame

MOST_DBM2: Final = 120.0
"""Largest cross section either way [dB over 1 m2]: ships and corner reflectors have 80 at most."""

_HEIGHTS_M: Final = (-100.0, 1000.0)  # from a ship in a lock to the tallest building


@dataclass(frozen=True, slots=True)
class CulturalTarget:
    """One man-made object.

    Raises
    ------
    SceneError
        A lobe without width, a value that is not finite, or a cross section or height out of range.
    """

    row: int
    column: int
    """Cell of the scene it stands in."""
    cross_section_dbm2: float
    """Radar cross section towards the radar, of the lobe's centre if it has lobes [dB over 1 m2], -120 to 120."""
    height_m: float = 0.0
    """Of its scattering centre over the ground [m], -100 to 1000."""
    directions_deg: tuple[float, ...] = ()
    """Bearings from true north in which it is specular, seen from the target [deg]; empty: isotropic."""
    lobe_deg: float = 10.0
    """Half-power width of each lobe [deg], > 0."""

    def __post_init__(self) -> None:
        numbers = (self.cross_section_dbm2, self.height_m, self.lobe_deg, *self.directions_deg)
        if (
            not all(math.isfinite(x) for x in numbers)
            or self.lobe_deg <= 0.0
            or abs(self.cross_section_dbm2) > MOST_DBM2
            or not _HEIGHTS_M[0] <= self.height_m <= _HEIGHTS_M[1]
        ):
            heights = f"{_HEIGHTS_M[0]:g} to {_HEIGHTS_M[1]:g} m of height"
            remedy = (
                f"Give {-MOST_DBM2:g} to {MOST_DBM2:g} dBm2, {heights}, finite directions and a lobe wider than 0 deg"
            )
            raise SceneError("an impossible cultural target", remedy, field="targets", value=str(self))

    def cross_section_m2(self, bearing_deg: float) -> float:
        """Cross section [m2] towards a bearing from true north [deg]: Gaussian lobes of the given half-power width."""
        peak = 10.0 ** (0.1 * self.cross_section_dbm2)
        if not self.directions_deg:
            return float(peak)
        away = min(abs((bearing_deg - d + 180.0) % 360.0 - 180.0) for d in self.directions_deg)
        return float(peak * 2.0 ** -((2.0 * away / self.lobe_deg) ** 2))


_REQUIRED: Final[Mapping[str, Callable[[str], Any]]] = {"row": int, "column": int, "cross_section_dbm2": float}
_OPTIONAL: Final[Mapping[str, Callable[[str], Any]]] = {
    "height_m": float,
    "directions_deg": lambda words: tuple(float(word) for word in words.replace(";", " ").split()),
    "lobe_deg": float,
}


def load_targets(path: str) -> tuple[CulturalTarget, ...]:
    """Cultural targets of a CSV file.

    Its columns are the attributes of `CulturalTarget`; ``row``, ``column`` and ``cross_section_dbm2`` are required,
    directions are separated by blanks. See `seqrsm.csv_lines.read_cells`.

    Raises
    ------
    SceneError
        Not readable, an unknown or missing column, a value that is not a number or impossible; with file and line.
    """
    name = Path(path).name
    (first, header), *lines = read_cells(path, "the cultural targets", SceneError, "targets_file") or [(1, [])]
    read = {**_REQUIRED, **_OPTIONAL}
    if not _REQUIRED.keys() <= set(header) <= read.keys() or len(set(header)) < len(header):
        text = "its columns are not those of cultural targets" if header else "the file is empty"
        remedy = f"Give {', '.join(_REQUIRED)}, and where needed {', '.join(_OPTIONAL)}"
        raise SceneError(text, remedy, file=name, line=first)
    targets: list[CulturalTarget] = []
    problems: list[Problem] = []
    for number, words in lines:
        try:
            if len(words) > len(header):
                raise ValueError
            given = {key: read[key](word) for key, word in zip(header, words, strict=False) if word}
            targets.append(CulturalTarget(**given))
        except (TypeError, ValueError):  # a number that is none, or that is not given
            remedy = (
                "Give whole numbers for row and column, numbers for the rest, several directions with spaces between"
            )
            problems.append(Problem("not a cultural target", remedy, file=name, line=number, value=",".join(words)))
        except SceneError as error:
            problems += [replace(one, file=name, line=number, value=",".join(words)) for one in error.problems]
    if problems:
        raise SceneError(*problems)
    return tuple(targets)


def check_targets(targets: Sequence[CulturalTarget], scene_shape: tuple[int, int]) -> None:
    """Refuse with SceneError targets that lie outside a scene of so many rows and columns."""
    rows, cols = scene_shape
    outside = [t for t in targets if not (0 <= t.row < rows and 0 <= t.column < cols)]
    if outside:
        text, remedy = "the target lies outside the scene", f"Rows are 0 to {rows - 1}, columns 0 to {cols - 1}"
        raise SceneError(*(Problem(text, remedy, field="targets_file", value=(t.row, t.column)) for t in outside))


def add_targets(
    sums: AnyArray,
    targets: Sequence[CulturalTarget],
    scene_shape: tuple[int, int],
    radar: RadarConfiguration,
    grid: EchoGrid,
) -> None:
    """Add the echoes of targets to the range bins; one hidden by the ground in front of it returns nothing.

    ``sums`` (n_channels, n_bins, m) of `echo_sums` are changed in place, all channels alike. SceneError says that a
    target lies outside the scene.
    """
    check_targets(targets, scene_shape)
    frame, m = grid.frame, sums.shape[2]
    own = slice(frame.pad_near, frame.pad_near + frame.n_rows)
    first_row = int(frame.source[frame.pad_near])
    flat = range_geometry(frame.ground_range_m, frame.height_m, frame.curved)
    vertical = 2.0 * np.arctan(grid.geometry[:, 8])
    pattern = radar.pattern_lut()
    for target in targets:
        row, column = _place(target, scene_shape, frame)
        i = row - first_row + frame.pad_near
        if not own.start <= i < own.stop:
            continue
        tops = frame.top_m[frame.source, column].astype(np.float64)
        look = np.arctan2(flat.along_m, flat.up_m - tops) - vertical
        z = float(frame.elevation_m[frame.source[i], column]) + target.height_m
        own_look = math.atan2(flat.along_m[i], flat.up_m[i] - z) - vertical[i]
        if i > 0 and float(look[:i].max()) > own_look:
            continue
        offset = range_offset(np.full((1, 1), z), grid.geometry[i : i + 1], radar.range_format == "ground")
        k = math.floor(grid.base[i + 1] + float(offset[0, 0])) - grid.first
        if not 0 <= k < grid.n_bins:
            continue
        slant2 = flat.slant_range_m[i] ** 2 - z * (2.0 * flat.up_m[i] - z)
        # The bearing from which the radar looks, seen from the target.
        bearing = radar.heading_deg - 90.0
        if frame.wrapped:
            bearing = 180.0 + (column + 0.5 - frame.wrapped) * 360.0 / (m - 2 * frame.wrapped)
        echo = target.cross_section_m2(bearing) * (grid.reference_range_m**2 / slant2) ** 2 / frame.cell_m**2
        echo *= float(radar.atmosphere(flat.incidence_rad[i : i + 1])[0])
        if pattern.size:
            echo *= float(radar.elevation_gain(np.array([own_look]))[0]) ** 2
        sums[:, k, column] += echo
        if frame.wrapped:
            # The columns that repeat the other end.
            around = m - 2 * frame.wrapped
            for other in (column - around, column + around):
                if 0 <= other < m:
                    sums[:, k, other] += echo


def _place(target: CulturalTarget, scene_shape: tuple[int, int], frame: RadarFrame) -> tuple[int, int]:
    """Row and column of the frame's layers."""
    if frame.cell_of_scene is not None:
        place = int(frame.cell_of_scene.ravel()[target.row * scene_shape[1] + target.column])
        m = int(frame.elevation_m.shape[1])
        return place // m, place % m
    row, column = target.row, target.column
    cols, rows = scene_shape[1], scene_shape[0]
    for _ in range(frame.quarter_turns % 4):
        row, column = cols - 1 - column, row
        rows, cols = cols, rows
    return row, column
