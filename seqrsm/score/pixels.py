"""The pixels of an image: the ground in them, and the tiles of ground that teach a classifier or test it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache, partial
from typing import TypeAlias
from weakref import WeakKeyDictionary

import numpy as np

from seqrsm.arrays import AnyArray, BoolArray, FloatArray, IntArray
from seqrsm.rng import generator
from seqrsm.scene.layers import categories_of_fields
from seqrsm.scene.scene import Scene
from seqrsm.scene.terrain import strips
from seqrsm.score import kernels_classify
from seqrsm.simulate.radar.result import RadarImage
from seqrsm.simulate.radiometer.result import RadiometerImage

Image: TypeAlias = RadarImage | RadiometerImage

TILE_M = 250.0
"""Side of a tile [m], half that of a scene of less than 500 m: about the size of a farm's block of fields."""

TILES_ACROSS = 8
"""Tiles of a radiometer's image along the shorter side of a scene of 2 km and more."""

_CELLS_A_TILE = 2.0
"""Least side of a tile in cells of the coarsest image: what one shows of the ground in it, no half is to teach the
other."""


@dataclass(frozen=True, slots=True, eq=False)
class Pixels:
    """The pixels of an image, and the ground in them."""

    pixel: AnyArray
    """(rows, columns): of each cell of the scene; -1 for none."""
    counts: AnyArray
    """(n_pixels, n_classes): scored cells of each class."""
    field: AnyArray
    """(n_pixels,): field that all scored cells of a pixel belong to; -1 where it has none, -2 where it has several."""
    tile: IntArray
    """(n_pixels,)."""
    seen: BoolArray
    """(n_tiles,): tiles that hold a scored cell."""
    keys: FloatArray
    """(n_tiles,): see `seqrsm.score.classification.halves`."""
    side_m: float
    """Side of a tile [m]."""
    dark: Callable[[], BoolArray]
    """Gives which pixels of a radar (n_pixels,) have more than half of their scored cells in shadow; made when asked
    for, and once."""


def pixels_of(images: Sequence[Image], scene: Scene, *, seed: int, run_id: int) -> Pixels:
    """Pixels of the finest of some images, the ground in them, and the tiles that they belong to.

    A pixel belongs to the tile of the first pixel of the field that most of it lies in: no field is taught in one half
    and tested in the other but by the ends of its border pixels. A field larger than a tile is one itself; those of a
    cover are shared between the halves. One that is most of its cover's ground is divided by the tiles of its pixels'
    centres: kept whole, it would leave a half with little to learn the cover from.
    """
    image = finest(images)
    coarsest = max(one.radar.resolution_m if isinstance(one, RadarImage) else side_m(one) for one in images)
    side = tile_m(scene, radar=isinstance(image, RadarImage), cell_m=coarsest)
    kept = _known_ground.setdefault(image.registration, {}) if isinstance(image, RadarImage) else {}
    if (scene, side) not in kept:
        kept.clear()
        kept[scene, side] = _ground_in_pixels(image, scene, side)
    found = kept[scene, side]
    return replace(found, keys=found.keys + generator(seed, run_id, "training tiles").random(len(found.keys)))


_known_ground: WeakKeyDictionary[Callable[[], AnyArray], dict[tuple[Scene, float], Pixels]] = WeakKeyDictionary()
"""By the registration that all occasions of a radar share: what `_ground_in_pixels` gave last."""


def _ground_in_pixels(image: Image, scene: Scene, side: float) -> Pixels:
    """As `pixels_of`, with tiles of a side [m]; keys are whole numbers."""
    if isinstance(image, RadarImage):
        _, n_rows, n_columns = image.intensity.shape
        pixel, in_shadow = image.pixel_of_cell, image.in_shadow
        ground = image.ground_range_m
        # Rows and columns of a strip are straight lines on the ground, so their places are not spread over the image.
        across, along = image.place_m(*np.indices((n_rows, n_columns), sparse=True))
        if image.radar.scan == "slar":
            across = across - ground[0]
            extent = (float(ground[-1] - ground[0]), (n_columns - 0.5) * image.azimuth_spacing_m)
        else:
            reach = float(ground[-1])
            across, along, extent = across + reach, along + reach, (2.0 * reach, 2.0 * reach)
    else:
        n_rows, n_columns = image.brightness_k.shape[1:]
        pixel, in_shadow = seen_pixels(image), lambda: np.zeros(scene.shape, dtype=np.bool_)
        scan = image.scan
        half = 0.5 * scene.shape[image.quarter_turns % 2] * scene.cell_m
        # From the left edge of the scene, held at its edges.
        away = scan.from_m * np.tan(np.clip(scan.place_rad, -1.5, 1.5))
        across = (np.clip(away, -half, half) + half)[:, None]
        along = np.asarray((np.arange(n_columns) + 0.5) * scan.advance_m, dtype=np.float64)
        extent = (2.0 * half, (scan.n_lines - 0.5) * scan.advance_m)
    counts, field, main = cells_in_pixels(pixel, scene, n_rows * n_columns)
    tile, n_tiles = tiles(across, along, extent, side)
    large = large_fields(scene, side)
    own = np.flatnonzero(large > 0)
    _keep_fields_whole(main, large, tile, n_tiles)
    keys = np.append(np.zeros(n_tiles), 1.0 + categories_of_fields(scene)[own])
    seen = np.bincount(tile[field != -1], minlength=len(keys)) > 0
    return Pixels(pixel, counts, field, tile, seen, keys, side, cache(partial(_dark, in_shadow, pixel, counts, scene)))


def _dark(in_shadow: Callable[[], BoolArray], pixel: AnyArray, counts: AnyArray, scene: Scene) -> BoolArray:
    """See `Pixels.dark`; ``in_shadow`` tells it of each cell."""
    of_cells = pixel[in_shadow() & scene.scored]
    cells = np.bincount(of_cells[of_cells >= 0], minlength=len(counts))
    found, some = np.zeros(len(counts), dtype=np.bool_), np.flatnonzero(cells)  # shadow is rare: few rows of counts
    found[some] = 2 * cells[some] > counts[some].sum(axis=1)
    return found


def _keep_fields_whole(field: IntArray, large: IntArray, tile: IntArray, n_tiles: int) -> None:
    """Give all pixels of a field the tile of the first of them, or the one that it is itself.

    ``field`` (n_pixels,) is below 0 for a pixel of none, ``large`` (n_fields,) of `large_fields`, ``tile`` (n_pixels,)
    written to; ``n_tiles`` are no field.
    """
    inside = np.flatnonzero(field >= 0)
    own = field[inside]
    kept = large[own] >= 0
    inside, own = inside[kept], own[kept]
    first = np.empty(len(large), dtype=np.int64)
    first[own[::-1]] = tile[inside[::-1]]
    first = np.where(large > 0, n_tiles - 1 + large, first)
    tile[inside] = first[own]


def tile_m(scene: Scene, *, radar: bool, cell_m: float = 0.0) -> float:
    """Side of a tile of a radar's image, or of a radiometer's [m]: whatever the scene, there is more than one.

    ``cell_m``: side of the coarsest cell that any image of the set has [m].
    """
    sides = [cells * scene.cell_m for cells in scene.shape]
    wanted = TILE_M if radar else max(TILE_M, min(sides) / TILES_ACROSS)
    return min(max(wanted, _CELLS_A_TILE * cell_m), 0.5 * max(sides))


@lru_cache(maxsize=6)
def large_fields(scene: Scene, side_m: float) -> IntArray:
    """Fields larger than a tile (n_fields,), numbered from 1; -1 where one is most of its cover's ground, 0: smaller.

    Larger with all their ground, most of what is scored.
    """
    cells, scored = np.zeros((2, scene.n_fields), dtype=np.int64)
    for rows in strips(*scene.shape):  # numpy counts in 8 bytes a cell
        field = scene.field_id[rows]
        cells += np.bincount(field.ravel(), minlength=scene.n_fields)
        scored += np.bincount(field[scene.scored[rows]], minlength=scene.n_fields)
    cover = categories_of_fields(scene)
    large = cells * scene.cell_m**2 > side_m**2
    most = 2.0 * scored > np.bincount(cover, scored)[cover]
    return np.asarray(np.where(large, np.where(most, -1, np.cumsum(large & ~most)), 0), dtype=np.int64)


def cells_in_pixels(pixel: AnyArray, scene: Scene, n_pixels: int) -> tuple[AnyArray, AnyArray, AnyArray]:
    """``counts`` and ``field`` of `Pixels`, from the pixel of each cell of the scene, -1 for none; and the main field.

    That of more than half of a pixel's scored cells, -1 where it has none; one of them where no field has as many.
    """
    # Made here and not in the kernel: numpy asks for large pages, which a large image fills far sooner.
    counts = np.zeros((n_pixels, len(scene.categories)), dtype=np.int32)
    field, main = np.full((2, n_pixels), -1, dtype=np.int32)
    votes = np.zeros(n_pixels, dtype=np.int32)
    kernels_classify.add_cells(pixel, scene.cover, scene.scored, scene.field_id, counts, field, main, votes)
    return counts, field, main


def fields_of(pixels: Pixels, scene: Scene) -> tuple[AnyArray, AnyArray, IntArray]:
    """Field (rows, columns) of each scored cell that is seen, -1 for none; cells by class (n, n_classes), tile (n,).

    One that tiles divide is a field in each: see `pixels_of`.
    """
    cells = np.flatnonzero((pixels.pixel >= 0) & scene.scored & (scene.cover < len(scene.categories)))
    unit = np.full(scene.shape, -1, dtype=np.int32)
    of_cell, at = scene.field_id.ravel()[cells], pixels.tile[pixels.pixel.ravel()[cells]]
    large = large_fields(scene, pixels.side_m)
    code = of_cell.astype(np.int64) + np.where(large[of_cell] >= 0, 0, (1 + at) * scene.n_fields)
    codes, first, own = np.unique(code, return_index=True, return_inverse=True)
    unit.ravel()[cells] = own
    counts = np.zeros((len(codes), len(scene.categories)), dtype=np.int32)  # as of pixels: kernels compile once
    field = codes % scene.n_fields
    counts[np.arange(len(codes)), categories_of_fields(scene)[field]] = np.bincount(own)
    itself = len(pixels.keys) - 1 - large.max() + large[field]
    return unit, counts, np.where(large[field] > 0, itself, at[first])


def tiles(
    across_m: FloatArray, along_m: FloatArray, extent_m: tuple[float, float], side_m: float
) -> tuple[IntArray, int]:
    """Square tile (rows * columns,) of ground that each pixel belongs to, and how many there are.

    Centres of the pixels [m] broadcast to (rows, columns); ``extent_m`` is the largest value of either in the whole
    image, ``side_m`` that of a tile.
    """
    wide, long = (max(math.floor(size / side_m), 0) + 1 for size in extent_m)
    away = np.clip(np.floor(across_m / side_m).astype(np.int64), 0, wide - 1)
    ahead = np.clip(np.floor(along_m / side_m).astype(np.int64), 0, long - 1)
    return np.ravel(away * long + ahead), wide * long


def seen_pixels(image: RadiometerImage) -> AnyArray:
    """Footprint of each cell, -1 also where the footprint saw nothing."""
    blind = np.isnan(image.brightness_k).any(axis=0).ravel()
    if not blind.any():
        return image.pixel_of_cell
    pixel = image.pixel_of_cell.copy()
    pixel[(pixel >= 0) & blind[np.maximum(pixel, 0)]] = -1
    return pixel


def finest(images: Sequence[Image]) -> Image:
    """The image with the smallest pixels, the first of several."""
    return min(images, key=side_m)


def side_m(image: Image) -> float:
    """Side of a pixel on the ground [m]."""
    return image.radar.pixel_spacing_m if isinstance(image, RadarImage) else image.radiometer.resolution_m
