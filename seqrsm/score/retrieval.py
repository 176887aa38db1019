"""Utilities of a radiometer's image: percent of ground classified right, and the error of retrieved quantities.

Every scored cell counts by the footprint nearest to it, so coarse beams pay for mixed ground and gaps in the scan for
what they miss. Footprints are trained on and tested in disjoint tiles of ground.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Literal

import numpy as np

from seqrsm.arrays import AnyArray, FloatArray, IntArray
from seqrsm.errors import ConfigurationError, Problem, SceneError
from seqrsm.score.classification import (
    UtilityScore,
    cluster_ratio,
    count_classes,
    halves,
    score_pixels,
    tiles,
    with_names,
)

if TYPE_CHECKING:
    from seqrsm.scene.scene import Scene
    from seqrsm.simulate.radiometer.result import RadiometerImage

Quantity = Literal["soil_moisture", "water_fraction"]

TILES_ACROSS = 8
"""Tiles along the shorter side of the scene, unless their side is given."""

WATER = "Water"


def percent_correct_radiometer(
    image: RadiometerImage,
    scene: Scene,
    *,
    seed: int,
    run_id: int,
    tile_m: float | None = None,
) -> UtilityScore:
    """Percent of scored cells that a Gaussian maximum likelihood classifier names rightly from brightness [K].

    As `seqrsm.score.classification.percent_correct`, with one footprint in the place of a pixel. Emission changes with
    the look angle over a sweep; each class's mean is a straight line in the square of that angle.

    Parameters
    ----------
    image : RadiometerImage
    scene : Scene
        The scene the image was made of.
    seed, run_id : int
        Key of the split into halves.
    tile_m : float, optional
        Side of a tile [m]; an eighth of the scene's shorter side if not given.

    Returns
    -------
    UtilityScore

    Raises
    ------
    SceneError
        No scored cell lies in the image.
    """
    _, counts, tile, keys = pixels_of_radiometer(image, scene, seed=seed, run_id=run_id, tile_m=tile_m)
    return with_names(score_pixels(brightness_and_angle(image), counts, tile, keys, covariates=1), scene.categories)


def pixels_of_radiometer(
    image: RadiometerImage, scene: Scene, *, seed: int, run_id: int, tile_m: float | None = None
) -> tuple[AnyArray, AnyArray, IntArray, FloatArray]:
    """`seqrsm.score.classification.pixels_of_radar` of footprints; -1 also where a footprint saw nothing."""
    n_samples, n_lines = image.brightness_k.shape[1:]
    pixel = _seen_pixels(image)
    counts = count_classes(pixel, scene, n_samples * n_lines)
    return pixel, counts, *_tiles(image, scene, np.arange(n_samples)[:, None], np.arange(n_lines), tile_m, seed, run_id)


def brightness_and_angle(image: RadiometerImage) -> FloatArray:
    """Brightness of each channel [K] and the square of the look angle [rad2], (n_channels + 1, n_pixels)."""
    angle = np.repeat(np.square(image.scan.look_rad), image.brightness_k.shape[2])
    return np.vstack([image.brightness_k.reshape(-1, angle.size), angle], dtype=np.float64)


def soil_moisture_error(image: RadiometerImage, scene: Scene, *, seed: int, run_id: int) -> UtilityScore:
    """`retrieval_error` of volumetric soil moisture in percent, cell by cell."""
    return retrieval_error(image, scene, seed=seed, run_id=run_id, quantity="soil_moisture")


def water_fraction_error(image: RadiometerImage, scene: Scene, *, seed: int, run_id: int) -> UtilityScore:
    """`retrieval_error` of the fraction of open water in percent, on blocks of a fortieth of the scene's side."""
    block = min(scene.shape) * scene.cell_m / 40.0
    return retrieval_error(image, scene, seed=seed, run_id=run_id, quantity="water_fraction", block_m=block)


def retrieval_error(
    image: RadiometerImage,
    scene: Scene,
    *,
    seed: int,
    run_id: int,
    quantity: Quantity = "soil_moisture",
    block_m: float = 0.0,
    tile_m: float | None = None,
) -> UtilityScore:
    """Root mean square error of a quantity retrieved from brightness, in percent.

    Tiles of ground are split at random into two halves; a least-squares polynomial of brightness (its square too, and
    the square of the look angle with and without it) is fitted to the mean of the quantity over the footprints of one
    half and retrieves it in the other. Every cell takes the value of its nearest footprint.

    Parameters
    ----------
    image : RadiometerImage
    scene : Scene
        The scene the image was made of.
    seed, run_id : int
        Key of the split into halves.
    quantity : {"soil_moisture", "water_fraction"}
        Volumetric moisture of the fields whose emissivity depends on it [percent], or share of open water [percent].
    block_m : float
        Side of the squares of ground over which truth and retrieval are averaged before they are compared [m]; 0
        compares cell by cell.
    tile_m : float, optional
        Side of a tile [m]; an eighth of the scene's shorter side if not given.

    Returns
    -------
    UtilityScore
        Its confusion is empty; details hold the bias and the spread of the truth.

    Raises
    ------
    SceneError
        No scored cell lies in the image, or nothing in the scene depends on the quantity.
    ConfigurationError
        The quantity is not known.
    """
    truth, asked = _truth(image, scene, quantity)
    pixel = _seen_pixels(image)
    asked &= pixel >= 0
    if not asked.any():
        raise SceneError(Problem(f"no scored cell tells of {quantity}", "Choose another utility", field="utility"))
    where = pixel[asked]
    value = truth[asked]
    count = np.bincount(where)
    used = np.flatnonzero(count)
    index = (np.cumsum(count > 0) - 1)[where]
    cells = count[used].astype(np.float64)
    mean = np.bincount(index, weights=value) / cells
    n_lines = image.brightness_k.shape[2]
    sample, line = np.divmod(used, n_lines)
    tile, keys = _tiles(image, scene, sample, line, tile_m, seed, run_id)
    seen = np.bincount(tile, minlength=len(keys)) > 0
    tile, keys = (np.cumsum(seen) - 1)[tile], keys[seen]
    brightness = image.brightness_k.reshape(len(image.brightness_k), -1)[:, used].T.astype(np.float64)
    retrieved = retrieve(brightness, np.square(image.scan.look_rad[sample]), mean, cells, tile, keys)
    low, high = (0.0, 100.0) if quantity == "water_fraction" else (float(mean.min()), float(mean.max()))
    error = np.clip(retrieved, low, high)[index] - value
    unit_tile = tile[index]
    if block_m > 0.0:
        error, weight, unit_tile = _blocks(scene, asked, error, unit_tile, block_m)
    else:
        weight = np.ones(error.size)
    square, se = cluster_ratio(weight * error**2, weight, unit_tile)
    rmse = math.sqrt(square)
    details: dict[str, object] = {
        "quantity": quantity,
        "bias": float(np.average(error, weights=weight)),
        "truth_sd": float(value.std()),
    }
    n_tiles = int(tile.max()) + 1
    se_root = se / (2.0 * rmse) if rmse > 0.0 else 0.0
    return UtilityScore(rmse, se_root, int(cells.sum()), n_tiles, details=details)


def _truth(image: RadiometerImage, scene: Scene, quantity: str) -> tuple[FloatArray, AnyArray]:
    """The quantity in each cell [percent], and the scored cells that tell of it."""
    known = scene.scored & (scene.cover < len(scene.categories))
    kind = np.where(known, scene.cover, 0)
    if quantity == "soil_moisture":
        return 100.0 * image.occasion.field_moisture[scene.field_id], known & image.moist[kind]
    if quantity == "water_fraction":
        water = scene.categories.index(WATER) if WATER in scene.categories else -1
        return 100.0 * (scene.cover == water), known if water >= 0 else np.zeros_like(known)
    remedy = "Known: soil_moisture, water_fraction"
    raise ConfigurationError(Problem("no such quantity", remedy, field="quantity", value=quantity))


def _seen_pixels(image: RadiometerImage) -> AnyArray:
    """Footprint of each cell, -1 also where the footprint saw nothing."""
    blind = np.isnan(image.brightness_k).any(axis=0).ravel()
    if not blind.any():
        return image.pixel_of_cell
    pixel = image.pixel_of_cell.copy()
    pixel[(pixel >= 0) & blind[np.maximum(pixel, 0)]] = -1
    return pixel


def tile_side_m(scene: Scene) -> float:
    """Side of a tile where it is not given [m]."""
    return min(scene.shape) * scene.cell_m / TILES_ACROSS


def _tiles(
    image: RadiometerImage,
    scene: Scene,
    sample: IntArray,
    line: IntArray,
    tile_m: float | None,
    seed: int,
    run_id: int,
) -> tuple[IntArray, FloatArray]:
    """Tile of each footprint by its centre, and the tiles' keys."""
    scan = image.scan
    half = 0.5 * scene.shape[image.quarter_turns % 2] * scene.cell_m
    across = across_of_look(scan.look_rad[sample], scan.height_m, half)
    extent = (2.0 * half, (scan.n_lines - 0.5) * scan.advance_m)
    along = np.asarray((line + 0.5) * scan.advance_m, dtype=np.float64)
    return tiles(across, along, extent, tile_m or tile_side_m(scene), seed=seed, run_id=run_id)


def across_of_look(look_rad: FloatArray, height_m: float, half_m: float) -> FloatArray:
    """Distance of footprints from the left edge of a scene ``2 half_m`` wide [m], held at its edges."""
    away = height_m * np.tan(np.clip(look_rad, -1.5, 1.5))
    return np.asarray(np.clip(away, -half_m, half_m) + half_m)


def retrieve(
    brightness: FloatArray, angle: FloatArray, target: FloatArray, cells: FloatArray, tile: IntArray, keys: FloatArray
) -> FloatArray:
    """Quantity of each footprint, from the polynomial that the other half of the tiles teaches.

    Parameters
    ----------
    brightness : float64 array (n, n_channels)
        [K]
    angle : float64 array (n,)
        Square of the look angle.
    target, cells : float64 array (n,)
        Mean of the quantity over each footprint, and the cells that tell of it.
    tile, keys
        Of `seqrsm.score.classification.tiles`.
    """
    return _crossed_fit(_polynomial(brightness, angle), target, cells, tile, keys)


def polynomial_terms(n_channels: int) -> int:
    """Coefficients of the polynomial of `retrieve`."""
    return 2 + 3 * n_channels


def _polynomial(brightness: FloatArray, angle: FloatArray) -> FloatArray:
    """Columns 1, T, T**2, phi**2, T phi**2 of each channel, scaled to the order of one."""
    scaled = (brightness - brightness.mean(axis=0)) / np.maximum(brightness.std(axis=0), 1e-6)
    spread = (angle - angle.mean()) / max(float(angle.std()), 1e-9)
    columns = [np.ones(len(angle)), spread]
    for channel in scaled.T:
        columns += [channel, channel**2, channel * spread]
    return np.stack(columns, axis=1)


def _crossed_fit(
    features: FloatArray, target: FloatArray, cells: FloatArray, tile: IntArray, keys: FloatArray
) -> FloatArray:
    """Target of each footprint, retrieved by the fit to the other half of the tiles; weights are cells."""
    n_tiles = len(keys)
    half = halves(keys)[tile]
    out = np.full(len(target), float(np.average(target, weights=cells)))
    for tested in (0, 1):
        test = half == tested
        train = test if n_tiles == 1 else ~test
        if not test.any() or not train.any():
            continue
        root = np.sqrt(cells[train])[:, None]
        gram = (root * features[train]).T @ (root * features[train])
        # A millionth of ridge keeps few footprints from a singular fit.
        gram += 1e-6 * np.trace(gram) / len(gram) * np.eye(len(gram))
        out[test] = features[test] @ np.linalg.solve(gram, features[train].T @ (cells[train] * target[train]))
    return out


def _blocks(
    scene: Scene, asked: AnyArray, error: FloatArray, tile: IntArray, block_m: float
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Mean error of each block, its cells, and the tile of its first cell."""
    row, column = np.nonzero(asked)
    size = max(block_m / scene.cell_m, 1.0)
    across = math.ceil(scene.shape[1] / size) + 1
    code = np.floor(row / size).astype(np.int64) * across + np.floor(column / size).astype(np.int64)
    _, first, block = np.unique(code, return_index=True, return_inverse=True)
    cells = np.bincount(block).astype(np.float64)
    mean = np.bincount(block, weights=error) / cells
    return mean, cells, np.unique(tile[first], return_inverse=True)[1].astype(np.int64)
