"""What images show of each unit of ground that is classified: pixels, their neighbourhood, segments or fields.

Pixels are those of the finest image; another image's values are averaged over the cells of each. Tiles of ground are
the groups that are taught and tested apart: all that a field shows belongs to one of them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from typing import TypeAlias
from weakref import WeakKeyDictionary

import numpy as np
import scipy

from seqrsm.arrays import AnyArray, BoolArray, FloatArray, IntArray
from seqrsm.rng import generator
from seqrsm.scene.layers import categories_of_fields
from seqrsm.scene.scene import Scene
from seqrsm.score import kernels_classify
from seqrsm.score.known_map import KnownMap, parts_by_label
from seqrsm.sensor.radar import RadarConfiguration
from seqrsm.simulate.radar.result import RadarImage
from seqrsm.simulate.radiometer.result import RadiometerImage
from seqrsm.units import LN10_OVER_10

Image: TypeAlias = RadarImage | RadiometerImage

TILE_M = 250.0
"""Side of a tile [m], half that of a scene of less than 500 m: about the size of a farm's block of fields."""

TILES_ACROSS = 8
"""Tiles of a radiometer's image along the shorter side of a scene of 2 km and more."""

_CELLS_A_TILE = 2.0
"""Least side of a tile in cells of the coarsest image: what one shows of the ground in it, no half is to teach the
other."""

WINDOW = 7
"""Side of the neighbourhood [pixels]."""

BY_NOISE = 1e-6
"""Chance at which noise alone makes two pieces of ground differ so much that a segmentation keeps them apart."""

_FEW = 20  # fields or pixels of a class, in both halves
_SOME = 10_000


@dataclass(frozen=True, slots=True, eq=False)
class Pixels:
    """The pixels of an image, and the ground in them.

    Attributes
    ----------
    pixel : int32 array (rows, columns)
        Of each cell of the scene; -1 for none.
    counts : int32 array (n_pixels, n_classes)
        Scored cells of each class.
    field : int32 array (n_pixels,)
        Field that all scored cells of a pixel belong to; -1 where it has none, -2 where it has several.
    tile : int64 array (n_pixels,)
    seen : bool array (n_tiles,)
        Tiles that hold a scored cell.
    keys : float64 array (n_tiles,)
        See `seqrsm.score.classification.halves`.
    side_m : float
        Side of a tile [m].
    """

    pixel: AnyArray
    counts: AnyArray
    field: AnyArray
    tile: IntArray
    seen: BoolArray
    keys: FloatArray
    side_m: float


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """What is known of each unit of ground.

    Attributes
    ----------
    features : float64 array (d, n)
        The covariates, then decibels of radars and brightness of radiometers [K].
    counts : int array (n, n_classes)
        Scored cells of each class in each unit.
    tile, keys
        As of `Pixels`.
    covariates : int
        So many of the first features are no evidence of a class: squares of look angles.
    teaching : array (n, n_classes)
        Cells with which a unit teaches each class; of fine pixels those in the resolution cell.
    label : int64 array (n,) or None
        Label of each unit in a map that is there already, by which units are divided; None without one.
    log_share : float64 array (n_labels, n_classes)
        What each label says for each class, see `seqrsm.score.known_map`.
    seen : bool array (n_tiles,) or None
        As of `Pixels`, where it is known already; else ``counts`` tell.
    """

    features: FloatArray
    counts: AnyArray
    tile: IntArray
    keys: FloatArray
    covariates: int
    teaching: AnyArray
    label: IntArray | None = None
    log_share: FloatArray = field(default_factory=lambda: np.zeros((1, 1)))
    seen: BoolArray | None = None


def evidence_of(
    images: Sequence[Image], scene: Scene, *, by: str = "pixel", seed: int, run_id: int, known: KnownMap | None = None
) -> Evidence:
    """What images of one ground show of it together.

    Parameters
    ----------
    images : sequence of RadarImage or RadiometerImage
        One at least.
    scene : Scene
        The scene they were made of.
    by : {"pixel", "neighbourhood", "segment", "field"}
        Unit of ground: a pixel; a pixel after an adaptive filter over its neighbours (`WINDOW`); a segment of the
        images, by the mean over its pixels; a field of the scene, by the mean over the pixels that lie inside it, or
        over its cells where none does.
    seed, run_id : int
        Key of the split of tiles into halves.
    known : KnownMap, optional
        A map of the ground that is there already.
    """
    base = finest(images)
    pixels = pixels_of(images, scene, seed=seed, run_id=run_id)
    each = _on_pixels(images, base, pixels, lambda image: layers_of(image, smooth=by == "neighbourhood"))
    radar = [isinstance(image, RadarImage) for image in images]
    angles = [layers[:1] for layers, is_radar in zip(each, radar, strict=True) if not is_radar]
    powers = [layers if is_radar else layers[1:] for layers, is_radar in zip(each, radar, strict=True)]
    is_power = np.repeat([*(False for _ in angles), *radar], [len(layers) for layers in (*angles, *powers)])
    # Those of one image are in this order already, and nobody else's.
    layers = np.asarray(each[0] if len(each) == 1 else np.vstack([*angles, *powers]), dtype=np.float64)
    counts, tile, unit = pixels.counts, pixels.tile, None
    cells, inside = _in_resolution_cells(base, pixels, scene.cell_m)
    teaching = _shown(base, counts, cells, scene.scored)
    seen = None if by == "field" else pixels.seen
    if by == "field":
        layers, counts, tile, teaching, unit = _of_fields(layers, pixels, inside, scene)
    elif by == "segment":
        segment = _segments(images, base, pixels)
        layers, counts, tile, teaching, unit = _of_segments(layers, pixels, teaching, segment)
    if is_power.all():
        layers = decibels(layers, counts)
    else:
        layers[is_power] = decibels(layers[is_power], counts)
    if np.isnan(layers).any():
        _fill_unseen(layers, holds_cells(counts))
    found = Evidence(layers, counts, tile, pixels.keys, len(angles), teaching, seen=seen)
    if known is None:
        return found
    of, label, counts = parts_by_label(known, scene, pixels.pixel if unit is None else unit, seed)
    again = np.diff(of, prepend=-1) == 0  # a unit teaches once
    return replace(
        found,
        features=np.take(layers, of, axis=1),
        counts=counts,
        tile=tile[of],
        teaching=np.where(again[:, None], 0, teaching[of]),
        label=label,
        log_share=known.log_share,
    )


def layers_of(image: Image, *, smooth: bool = False) -> AnyArray:
    """What an image shows, (d, n_pixels): sigma0, linear; or the square of the look angle [rad2] and brightness [K].

    ``smooth``: after Lee's adaptive filter over `WINDOW` pixels, with the image's own noise: of decibels, where speckle
    adds.
    """
    if isinstance(image, RadarImage):
        if smooth:
            return np.asarray(10.0 ** (0.1 * _smoothed(*_values(image))).reshape(len(image.intensity), -1))
        power = image.apparent_sigma0()
        return np.asarray(power.reshape(len(power), -1))
    brightness = _smoothed(*_values(image)) if smooth else image.brightness_k
    angle = np.repeat(np.square(image.scan.look_rad), brightness.shape[2])
    return np.vstack([angle, brightness.reshape(-1, angle.size)], dtype=np.float64)


def _values(image: Image) -> tuple[AnyArray, AnyArray]:
    """Decibels or brightness [K] of pixels, (d, rows, columns), and the variance of its noise, which adds to either."""
    if not isinstance(image, RadarImage):
        return image.brightness_k, np.square(image.nedt_k)
    power = image.apparent_sigma0()
    db = decibels(power.reshape(len(power), -1).astype(np.float64)).reshape(power.shape)
    # Variance of ln of a gamma variable: the trigamma function of its looks.
    noise = (10.0 / math.log(10.0)) ** 2 * scipy.special.polygamma(1, image.looks)[:, None]
    return db, np.broadcast_to(noise, db.shape)


def _smoothed(values: AnyArray, noise: AnyArray) -> FloatArray:
    """What `_values` gives, after Lee's filter."""
    return np.stack([_lee(value, variance) for value, variance in zip(values, noise, strict=True)])


def _lee(layer: AnyArray, noise: AnyArray) -> FloatArray:
    """Lee's filter (1980, IEEE Trans. PAMI-2, 165-168) of noise that adds, of variance ``noise``; nan is left out."""
    seen = np.isfinite(layer)
    share = np.maximum(scipy.ndimage.uniform_filter(seen.astype(np.float64), WINDOW), 1e-9)
    value = np.where(seen, layer, 0.0).astype(np.float64)
    mean = scipy.ndimage.uniform_filter(value, WINDOW) / share
    variance = np.maximum(scipy.ndimage.uniform_filter(value**2, WINDOW) / share - mean**2, 0.0)
    noise = np.nan_to_num(noise, nan=0.0)
    gain = np.where(variance > noise, 1.0 - noise / np.maximum(variance, 1e-30), 0.0)
    return np.where(seen, mean + gain * (value - mean), np.nan)


def pixels_of(images: Sequence[Image], scene: Scene, *, seed: int, run_id: int) -> Pixels:
    """Pixels of the finest of some images, the ground in them, and the tiles that they belong to.

    A pixel belongs to the tile of the first pixel of the field that most of it lies in: no field is taught in one half
    and tested in the other but by the ends of its border pixels. A field larger than a tile is one itself; those of a
    cover are shared between the halves. One that is most of its cover's ground is divided by the tiles of its pixels'
    centres: kept whole, it would leave a half with little to learn the cover from.
    """
    image = finest(images)
    coarsest = max(one.radar.resolution_m if isinstance(one, RadarImage) else _side_m(one) for one in images)
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
        pixel = image.pixel_of_cell
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
        pixel = seen_pixels(image)
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
    return Pixels(pixel, counts, field, tile, seen, keys, side)


def _keep_fields_whole(field: IntArray, large: IntArray, tile: IntArray, n_tiles: int) -> None:
    """Give all pixels of a field the tile of the first of them, or the one that it is itself.

    Parameters
    ----------
    field : int32 array (n_pixels,)
        Below 0 for a pixel of none.
    large : int64 array (n_fields,)
        Of `large_fields`.
    tile : int64 array (n_pixels,)
        Written to.
    n_tiles : int
        Tiles that are no field.
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

    Of ground that is scored.
    """
    cells, scored = (
        np.bincount(field.ravel(), minlength=scene.n_fields) for field in (scene.field_id, scene.field_id[scene.scored])
    )
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


def reach_pixels(radar: RadarConfiguration, cell_m: float) -> int:
    """Pixels on either side of a pixel that its resolution cell reaches, of fine ones at least a scene's cell [m]."""
    return math.ceil(0.5 * max(radar.resolution_m, cell_m) / radar.pixel_spacing_m - 0.5 - 1e-9)


def _in_resolution_cells(image: Image, pixels: Pixels, cell_m: float) -> tuple[AnyArray, BoolArray]:
    """Scored cells of each class (n_pixels, n_classes) in what each pixel shows, and whether that is one field.

    A resolution cell reaches beyond a pixel that is finer, into the ground beside it.
    """
    counts, field = pixels.counts, pixels.field
    if not isinstance(image, RadarImage) or not image.radar.finer_pixels:
        return counts, np.asarray(field >= 0)
    shape, reach = image.intensity.shape[1:], reach_pixels(image.radar, cell_m)
    half = 0.5 * image.radar.resolution_m / image.radar.pixel_spacing_m
    covered = np.clip(half + 0.5 - np.abs(np.arange(-reach, reach + 1)), 0.0, 1.0)
    cells = counts.reshape(*shape, -1)
    for axis in (0, 1):
        cells = scipy.ndimage.convolve1d(cells, np.rint(4.0 * covered), axis=axis, mode="constant")
    cells = np.where(holds_cells(counts)[:, None], cells.reshape(counts.shape), 0)
    return cells, np.asarray(in_one_field(field.reshape(shape), reach).ravel() & (field >= 0))


def in_one_field(field: AnyArray, reach: int) -> BoolArray:
    """Whether all ground within so many pixels of each is one field's.

    ``field`` (rows, columns) of a pixel, -1 where it has no ground, -2 where it has several.
    """
    several, size = field.max() + 1, 2 * reach + 1
    known = np.where(field == -2, several, field)
    highest = scipy.ndimage.maximum_filter(known, size)
    lowest = scipy.ndimage.minimum_filter(np.where(known == -1, several, known), size)
    return np.asarray((highest == lowest) & (highest < several))


def _of_fields(
    layers: FloatArray, pixels: Pixels, inside: BoolArray, scene: Scene
) -> tuple[FloatArray, AnyArray, IntArray, AnyArray, AnyArray]:
    """Layers, scored cells by class, tile and teaching of each field, and the field of each cell.

    A field is what pixels show whose resolution cells lie ``inside`` (n_pixels,) it, or where there are none those that
    do themselves, else all. It teaches by the first; of a class with few such fields all do.
    """
    unit, counts, tile = fields_of(pixels, scene)
    own = pixels.field >= 0
    found, *others = (
        kernels_classify.mean_of_pixels(unit, pixels.pixel, np.where(used, layers, np.nan), len(counts))
        for used in ((inside, True) if (inside == own).all() else (inside, own, True))
    )
    taught = np.asarray(np.isfinite(found).any(axis=0))
    teaching = np.where(taught[:, None], counts, 0)
    for other in others:
        found = np.where(np.isnan(found), other, found)
    return found, counts, tile, _or_all(teaching, counts), unit


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


def _on_pixels(
    images: Sequence[Image], base: Image, pixels: Pixels, layers_of_one: Callable[[Image], AnyArray]
) -> list[AnyArray]:
    """Layers (d, n_pixels) of each image on the pixels of the finest, ``base``."""
    places: list[tuple[Image, AnyArray]] = [(base, pixels.pixel)]
    found = []
    for image in images:
        layers = layers_of_one(image)
        own = next((place for other, place in places if _same_grid(other, image)), None)
        if own is None:
            own = image.pixel_of_cell
            places.append((image, own))
        if own is not pixels.pixel:
            layers = kernels_classify.mean_of_pixels(pixels.pixel, own, layers, len(pixels.counts))
        found.append(layers)
    return found


def _segments(images: Sequence[Image], base: Image, pixels: Pixels) -> IntArray:
    """Segment (n_pixels,) of each pixel of ``base``: parcels found in the images alone, each inside one tile.

    Neighbours are merged, the most alike after Lee's filter first, unless the means of their segments differ by more
    than noise does at a chance of `BY_NOISE`. A coarser image has as many fewer values that are independent.
    """

    def in_noise(image: Image, *, smooth: bool) -> AnyArray:
        values, noise = _values(image)
        values = _smoothed(values, noise) if smooth else values
        # Side of the ground over which noise is one value.
        cell_m = max(_side_m(image), image.radar.resolution_m) if isinstance(image, RadarImage) else _side_m(image)
        independent = noise * max(cell_m / _side_m(base), 1.0) ** 2
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray((values / np.sqrt(independent)).reshape(len(values), -1))

    x, smooth = (
        np.vstack(_on_pixels(images, base, pixels, partial(in_noise, smooth=smooth)), dtype=np.float64)
        for smooth in (False, True)
    )
    for layers in (x, smooth):
        _fill_unseen(layers, np.ones(layers.shape[1], dtype=bool))
    rows, columns = (base.intensity if isinstance(base, RadarImage) else base.brightness_k).shape[1:]
    at = np.arange(rows * columns).reshape(rows, columns)
    one = np.concatenate([at[:, :-1].ravel(), at[:-1].ravel()])
    other = np.concatenate([at[:, 1:].ravel(), at[1:].ravel()])
    within = pixels.tile[one] == pixels.tile[other]
    one, other = one[within], other[within]
    order = np.argsort(np.square(smooth[:, one] - smooth[:, other]).sum(axis=0), kind="stable")
    threshold = float(scipy.special.chdtri(len(x), BY_NOISE))
    found = kernels_classify.merge_pixels(x, one[order], other[order], threshold)
    return np.asarray(np.unique(found, return_inverse=True)[1])


def _of_segments(
    layers: FloatArray, pixels: Pixels, teaching: AnyArray, segment: IntArray
) -> tuple[FloatArray, AnyArray, IntArray, AnyArray, AnyArray]:
    """As `_of_fields`, of segments."""
    n = int(segment.max()) + 1

    def summed(rows: AnyArray) -> FloatArray:
        return np.stack([np.bincount(segment, row, n) for row in rows])

    seen = np.isfinite(layers)
    mean = summed(np.where(seen, layers, 0.0)) / np.where(summed(seen) > 0.0, summed(seen), np.nan)
    counts, teaching = (summed(cells.T).T.astype(np.int32) for cells in (pixels.counts, teaching))
    tile = np.empty(n, dtype=np.int64)
    tile[segment] = pixels.tile
    unit = np.where(pixels.pixel >= 0, segment[pixels.pixel], -1).astype(np.int32)
    return mean, counts, tile, teaching, unit


def _shown(image: Image, counts: AnyArray, cells: AnyArray, scored: BoolArray) -> AnyArray:
    """Cells with which each pixel teaches, (n_pixels, n_classes): none where a radar sees little of them but shadow.

    Nobody takes it for an example of what stands there. Lit ground teaches however weak its echo: were it only where
    fading or slopes lift it above the noise, a class would be taught brighter than it is. ``counts`` are those of the
    pixel itself, ``cells`` of what it shows.
    """
    if not isinstance(image, RadarImage):
        return cells
    hidden = np.asarray(image.mean_power.max(axis=0) < image.noise_power_w[:, None]).ravel()
    if not hidden.any():
        return cells
    dark = image.pixel_of_cell[image.shadow & scored]
    in_shadow = np.bincount(dark[dark >= 0], minlength=hidden.size)
    teaching = cells.copy()
    teaching[hidden & (2 * in_shadow > np.einsum("nk->n", counts))] = 0
    return _or_all(teaching, cells)


def _or_all(teaching: AnyArray, counts: AnyArray) -> AnyArray:
    """``teaching``, in place, with all units of a class where few of them would teach it."""
    step = len(counts) // _SOME + 1
    for own, every in zip(teaching.T, counts.T, strict=True):
        # Most classes are many already among some of the units.
        if np.count_nonzero(own[::step]) < _FEW and np.count_nonzero(own) < _FEW:
            own[:] = every
    return teaching


def holds_cells(counts: AnyArray) -> BoolArray:
    """Units (n,) that hold a cell, from ``counts`` (n, n_classes); any, sum and the like take six times as long."""
    return np.asarray(np.einsum("nk->n", counts) > 0)


def decibels(power: FloatArray, counts: AnyArray | None = None) -> FloatArray:
    """Decibels of linear power (n_channels, n_pixels), in place; zeros, of a noiseless radar only, are the darkest.

    They take the least positive value of their channel among the pixels that hold cells: ``counts`` (n_pixels, n).
    """
    if power.size and not np.nanmin(power, initial=1.0) > 0.0:
        held = (power > 0.0) if counts is None else (power > 0.0) & counts.any(axis=1)
        floor = np.min(power, axis=1, keepdims=True, where=held, initial=np.inf)
        np.maximum(power, np.where(np.isfinite(floor), floor, 1.0), out=power)
    np.log(power, out=power)  # half the time of the logarithm to base 10
    power /= LN10_OVER_10
    return power


def _fill_unseen(layers: FloatArray, used: AnyArray) -> None:
    """What an image does not see of a unit is taken for the mean of what it sees, in place."""
    for row in layers:
        unseen = np.isnan(row)
        if unseen.any():
            seen = used & ~unseen
            row[unseen] = row[seen].mean() if seen.any() else 0.0


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
    return min(images, key=_side_m)


def _side_m(image: Image) -> float:
    """Side of a pixel on the ground [m]."""
    return image.radar.pixel_spacing_m if isinstance(image, RadarImage) else image.radiometer.resolution_m


def _same_grid(one: Image, other: Image) -> bool:
    """Whether two images have the same pixels: those of one radar on two dates."""
    if isinstance(one, RadarImage) and isinstance(other, RadarImage):
        return one.radar == other.radar
    return one is other
