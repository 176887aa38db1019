"""Division of land into fields: reproducible draws, Voronoi pieces and connected patches.

Draws come from an integer hash and distances are integers, so a division is the same on every platform and with every
version of numpy.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from seqrsm.arrays import AnyArray, FloatArray, IntArray

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)


def hash_uniform(keys: ArrayLike, seed: int) -> FloatArray:
    """Uniform numbers in [0, 1), one for each integer key, from the splitmix64 finaliser.

    Another seed, >= 0, gives independent numbers. Steele, Lea and Flood 2014, "Fast splittable pseudorandom number
    generators", doi 10.1145/2660193.2660195.
    """
    with np.errstate(over="ignore"):
        state = np.asarray(keys).astype(np.uint64) * _GOLDEN + _mix(np.asarray(seed, dtype=np.uint64) + _GOLDEN)
        word = _mix(state + _GOLDEN)
    return np.asarray((word >> np.uint64(11)).astype(np.float64) * 2.0**-53)


def _mix(z: NDArray[np.uint64] | np.uint64) -> NDArray[np.uint64]:
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.asarray(z ^ (z >> np.uint64(31)))


def voronoi_labels(rows: int, cols: int, spacing: int, *, seed: int) -> NDArray[np.int32]:
    """Number (rows, cols) of the Voronoi piece around one drawn centre in each square of ``spacing`` cells.

    A piece has ``spacing``**2 cells on average, and may fall apart where a mask cuts it; see `connected_patches`.
    """
    n_rows, n_cols = -(-rows // spacing) + 4, -(-cols // spacing) + 4
    number = np.arange(n_rows * n_cols)
    square_row, square_col = np.divmod(number, n_cols)
    centre_row = (square_row - 2) * spacing + np.floor(hash_uniform(2 * number, seed) * spacing).astype(np.int64)
    centre_col = (square_col - 2) * spacing + np.floor(hash_uniform(2 * number + 1, seed) * spacing).astype(np.int64)
    label, col = np.empty((rows, cols), dtype=np.int32), np.arange(cols)
    for first in range(0, rows, spacing):  # a row of squares
        row = np.arange(first, min(first + spacing, rows))[:, None]
        best = np.full((row.size, cols), np.iinfo(np.int64).max)
        for d_row, d_col in itertools.product(range(5), range(5)):  # the nearest centre lies within two squares
            candidate = (first // spacing + d_row) * n_cols + col // spacing + d_col
            # Square of the distance and number of the centre in one integer: of two as near the lower number counts.
            key = (row - centre_row[candidate]) ** 2
            key += (col - centre_col[candidate]) ** 2
            key *= number.size
            key += candidate
            np.minimum(best, key, out=best)
        label[row[:, 0]] = best % number.size
    return label


def cut_patches(patch: AnyArray, spacing: int, whole: AnyArray, *, seed: int) -> NDArray[np.int32]:
    """Fields of the patches: those of more than two fields' area are cut into Voronoi pieces, as `voronoi_labels` does.

    ``patch`` (rows, cols): number >= 0 of the patch. ``spacing``: mean side of a field [cells]. ``whole`` (rows, cols):
    patches that are fields already, not cut however large.
    """
    large = np.bincount(patch.ravel()) > 2 * spacing**2
    piece = voronoi_labels(patch.shape[0], patch.shape[1], spacing, seed=seed)
    piece[~large[patch] | whole] = -1
    return connected_patches(patch, piece)


def connected_patches(*keys: AnyArray) -> NDArray[np.int32]:
    """Number the patches of cells that touch by a side and agree in every key (rows, cols).

    Keys are category, parcel number, piece: a patch has one value of each. Numbers 0, 1, 2, ... are in the order in
    which patches first appear row by row.
    """
    rows, cols = keys[0].shape
    # Runs of like cells in a row stand for their cells: there are far fewer of them.
    starts, down = np.zeros((rows, cols), dtype=bool), np.ones((rows - 1, cols), dtype=bool)
    starts[:, 0] = True
    for key in keys:
        starts[:, 1:] |= key[:, 1:] != key[:, :-1]
        down &= key[1:] == key[:-1]
    run = np.cumsum(starts.ravel(), dtype=np.int32).reshape(rows, cols)
    run -= np.int32(1)
    # Two runs that touch do so from where one of them starts.
    down &= starts[1:] | starts[:-1]
    n_runs = int(run[-1, -1]) + 1
    graph = scipy.sparse.coo_array(
        (np.ones(int(down.sum()), dtype=bool), (run[:-1][down], run[1:][down])), shape=(n_runs, n_runs)
    )
    label = scipy.sparse.csgraph.connected_components(graph, directed=False)[1]
    _, first, inverse = np.unique(label, return_index=True, return_inverse=True)
    order = np.empty(first.size, dtype=np.int32)
    order[np.argsort(first)] = np.arange(first.size, dtype=np.int32)
    numbers = order[inverse]
    for row in run:
        row[:] = numbers[row]
    return run


def draw_index(keys: ArrayLike, shares: Sequence[float], *, seed: int) -> IntArray:
    """Draw an index 0 .. len(shares) - 1 for each key with probability proportional to its share."""
    edges = np.cumsum(np.asarray(shares, dtype=np.float64))
    return np.searchsorted(edges[:-1] / edges[-1], hash_uniform(keys, seed), side="right")
