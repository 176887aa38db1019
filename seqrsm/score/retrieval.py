"""Share of open water retrieved from a radiometer's brightness, footprints trained on and tested apart."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from seqrsm.arrays import AnyArray, FloatArray, IntArray
from seqrsm.errors import Problem, SceneError
from seqrsm.scene.scene import Scene
from seqrsm.score.brightness import squares_of
from seqrsm.score.classification import UtilityScore, cluster_ratio, halves
from seqrsm.score.evidence import layers_of, pixels_of
from seqrsm.score.utilities import Asked
from seqrsm.simulate.radiometer.result import RadiometerImage

WATER = "Water"


def water_fraction_error(
    images: Sequence[RadiometerImage], scene: Scene, asked: Asked, *, seed: int, run_id: int
) -> UtilityScore:
    """Root mean square error of the share of open water [percent], on blocks of a fortieth of the scene's side.

    Tiles of ground are split at random into two halves; a least-squares polynomial of brightness (its square too, and
    the square of the look angle with and without it) is fitted to the share of water in the footprints of one half and
    retrieves it in the other. Every cell takes the value of its nearest footprint.

    Parameters
    ----------
    images : sequence of RadiometerImage
        One.
    scene : Scene
        The scene it was made of.
    asked : Asked
    seed, run_id : int
        Key of the split into halves.

    Returns
    -------
    UtilityScore
        Its confusion is empty; a guess says the mean share everywhere.

    Raises
    ------
    SceneError
        No scored cell lies in the image, or the scene has no category Water.
    """
    del asked
    image = images[0]
    if WATER not in scene.categories:
        raise SceneError(Problem("the scene has no water", "Choose another utility", field="utility"))
    pixels = pixels_of(image, scene, seed=seed, run_id=run_id)
    known = scene.scored & (scene.cover < len(scene.categories)) & (pixels.pixel >= 0)
    if not known.any():
        raise SceneError(Problem("no scored cell lies in the image", "Choose another utility", field="utility"))
    truth = 100.0 * (scene.cover == scene.categories.index(WATER))[known]
    where = pixels.pixel[known]
    count = np.bincount(where)
    used = np.flatnonzero(count)
    index = (np.cumsum(count > 0) - 1)[where]
    cells = count[used].astype(np.float64)
    mean = np.bincount(index, weights=truth) / cells
    seen = np.bincount(pixels.tile[used], minlength=len(pixels.keys)) > 0
    tile, keys = (np.cumsum(seen) - 1)[pixels.tile[used]], pixels.keys[seen]
    layers = layers_of(image)[:, used]
    retrieved = _crossed_fit(_polynomial(layers[:-1].T, layers[-1]), mean, cells, tile, keys)
    block_m = min(scene.shape) * scene.cell_m / 40.0
    error, weight, of_tile = _blocks(scene, known, np.clip(retrieved, 0.0, 100.0)[index] - truth, tile[index], block_m)
    away, *_ = _blocks(scene, known, truth - truth.mean(), tile[index], block_m)
    square, se = cluster_ratio(weight * error**2, weight, of_tile)
    rmse = math.sqrt(square)
    return UtilityScore(
        rmse,
        se / (2.0 * rmse) if rmse > 0.0 else 0.0,
        math.sqrt(float(np.average(away**2, weights=weight))),
        0.0,
        int(cells.sum()),
        len(keys),
        details={"bias": float(np.average(error, weights=weight))},
    )


def _polynomial(brightness: FloatArray, angle: FloatArray) -> FloatArray:
    """Columns 1, T, T**2, phi**2, T phi**2 of brightness (n, n_channels) [K] and angles phi**2 (n,), scaled to one."""
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
    square = squares_of(scene, block_m)[0][asked]
    _, first, block = np.unique(square, return_index=True, return_inverse=True)
    cells = np.bincount(block).astype(np.float64)
    mean = np.bincount(block, weights=error) / cells
    return mean, cells, np.unique(tile[first], return_inverse=True)[1].astype(np.int64)
