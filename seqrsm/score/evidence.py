"""What images show of each unit of ground that is classified: pixels, their neighbourhood, segments or fields.

Pixels are those of the finest image; another image's values are averaged over the cells of each. Tiles of ground are
the groups that are taught and tested apart: all that a field shows belongs to one of them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
import scipy

from seqrsm.arrays import AnyArray, BoolArray, FloatArray, IntArray
from seqrsm.scene.scene import Scene
from seqrsm.score import kernels_classify
from seqrsm.score.known_map import KnownMap, parts_by_label
from seqrsm.score.pixels import Image, Pixels, fields_of, finest, pixels_of, side_m
from seqrsm.sensor.radar import RadarConfiguration
from seqrsm.simulate.radar.result import RadarImage
from seqrsm.units import LN10_OVER_10

WINDOW = 7
"""Side of the neighbourhood [pixels]."""

BY_NOISE = 1e-6
"""Chance at which noise alone makes two pieces of ground differ so much that a segmentation keeps them apart."""

_FEW = 20  # fields or pixels of a class, in both halves
_SOME = 10_000


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """What is known of each unit of ground."""

    features: FloatArray
    """(d, n): the covariates, then decibels of radars and brightness of radiometers [K]."""
    counts: AnyArray
    """(n, n_classes): scored cells of each class in each unit."""
    tile: IntArray
    keys: FloatArray
    """As of `Pixels`."""
    covariates: int
    """So many of the first features are no evidence of a class: squares of look angles."""
    teaching: AnyArray
    """(n, n_classes): cells with which a unit teaches each class; of fine pixels those in the resolution cell."""
    label: IntArray | None = None
    """(n,): label of each unit in a map that is there already, by which units are divided; None without one."""
    log_share: FloatArray = field(default_factory=lambda: np.zeros((1, 1)))
    """(n_labels, n_classes): what each label says for each class, see `seqrsm.score.known_map`."""
    seen: BoolArray | None = None
    """(n_tiles,): as of `Pixels`, where it is known already; else ``counts`` tell."""


def evidence_of(
    images: Sequence[Image], scene: Scene, *, by: str = "pixel", seed: int, run_id: int, known: KnownMap | None = None
) -> Evidence:
    """What images of one ground, one at least, show of it together.

    ``by`` is the unit of ground: "pixel"; "neighbourhood", a pixel after an adaptive filter over its neighbours
    (`WINDOW`); "segment" of the images, by the mean over its pixels; "field" of the scene, by the mean over the pixels
    that lie inside it, or over its cells where none does. ``seed`` and ``run_id`` key the split of tiles into halves;
    ``known`` is a map of the ground that is there already.
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
    teaching = _shown(base, pixels, cells)
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
        cell_m = max(side_m(image), image.radar.resolution_m) if isinstance(image, RadarImage) else side_m(image)
        independent = noise * max(cell_m / side_m(base), 1.0) ** 2
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


def _shown(image: Image, pixels: Pixels, cells: AnyArray) -> AnyArray:
    """Cells with which each pixel teaches, (n_pixels, n_classes): none where a radar sees little of them but shadow.

    Nobody takes it for an example of what stands there. Lit ground teaches however weak its echo: were it only where
    fading or slopes lift it above the noise, a class would be taught brighter than it is. ``cells`` are those of what a
    pixel shows.
    """
    if not isinstance(image, RadarImage):
        return cells
    hidden = np.asarray(image.mean_power.max(axis=0) < image.noise_power_w[:, None]).ravel()
    if not hidden.any() or not (hidden := hidden & pixels.dark()).any():
        return cells
    teaching = cells.copy()
    teaching[hidden] = 0
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


def _same_grid(one: Image, other: Image) -> bool:
    """Whether two images have the same pixels: those of one radar on two dates."""
    if isinstance(one, RadarImage) and isinstance(other, RadarImage):
        return one.radar == other.radar
    return one is other
