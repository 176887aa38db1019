"""What pixels hold, and a maximum likelihood classifier taught and tested on them: one self-contained kernel file."""

from __future__ import annotations

import numpy as np

from seqrsm.arrays import AnyArray
from seqrsm.jit import kernel

_BLOCK = 384


@kernel
def add_cells(
    pixel: AnyArray,
    cover: AnyArray,
    scored: AnyArray,
    field_id: AnyArray,
    out: AnyArray,
    field: AnyArray,
    main: AnyArray,
    votes: AnyArray,
) -> None:
    """Count the scored data-base cells of each class in each pixel, and tell which field they belong to.

    The main field of a pixel is found in one pass (Boyer and Moore 1991, MJRTY: a fast majority vote algorithm).

    Parameters
    ----------
    pixel : int32 array (rows, columns)
        Pixel of each cell, -1 for none.
    cover : uint8 array (rows, columns)
        Category, 255 for none.
    scored : bool array (rows, columns)
    field_id : int32 array (rows, columns)
    out : int32 array (n_pixels, n_classes)
        Added to.
    field : int32 array (n_pixels,)
        Given as -1; -2 where cells of several fields lie in a pixel.
    main, votes : int32 array (n_pixels,)
        Given as -1 and 0: the field of more than half of the cells of a pixel; where there is none, one of its fields.
    """
    rows, columns = pixel.shape
    n_classes = out.shape[1]
    # By blocks: where the image is turned against the data base, the pixels of a whole row are more than a cache holds.
    side = 64
    for top in range(0, rows, side):
        for left in range(0, columns, side):
            for i in range(top, min(top + side, rows)):
                for j in range(left, min(left + side, columns)):
                    kind, k = np.int64(cover[i, j]), np.int64(pixel[i, j])
                    if k >= 0 and kind < n_classes and scored[i, j]:
                        out[k, kind] += np.int32(1)
                        own = field_id[i, j]
                        if field[k] != own:
                            field[k] = own if field[k] == -1 else np.int32(-2)
                        if votes[k] == 0:
                            main[k] = own
                        votes[k] += np.int32(1) if main[k] == own else np.int32(-1)


@kernel
def mean_of_pixels(unit: AnyArray, pixel: AnyArray, layers: AnyArray, n_units: int) -> AnyArray:
    """What one image shows, averaged over the cells of another's pixels (d, n_units); nan where it sees none of them.

    ``unit`` and ``pixel`` (rows, columns): pixel of each cell in the other image, and in this; -1 for none. ``layers``
    (d, n_pixels) of this image are nan where it sees nothing.
    """
    d = layers.shape[0]
    out, cells = np.zeros((d, n_units)), np.zeros(n_units)
    rows, columns = unit.shape
    for i in range(rows):
        for j in range(columns):
            u, p = unit[i, j], pixel[i, j]
            if u >= 0 and p >= 0 and layers[0, p] == layers[0, p]:
                cells[u] += 1.0
                for c in range(d):
                    out[c, u] += layers[c, p]
    for u in range(n_units):
        for c in range(d):
            out[c, u] = out[c, u] / cells[u] if cells[u] > 0.0 else np.nan
    return out


@kernel
def merge_pixels(x: AnyArray, one: AnyArray, other: AnyArray, threshold: float) -> AnyArray:
    """Merge neighbours into segments whose means do not differ: Nock and Nielsen (2004, IEEE Trans. PAMI-26, 1452).

    ``x`` (d, n_pixels) is in units of its noise; ``one`` and ``other`` (n_pairs,) are neighbours, the pairs that differ
    least first. Two segments are one up to a ``threshold`` of the square of the difference of their means, over its
    variance by noise. Returns the pixel that stands for each pixel's segment (n_pixels,).
    """
    d, n_pixels = x.shape
    of, size, mean = np.arange(n_pixels), np.ones(n_pixels), x.copy()
    for p in range(one.shape[0]):
        i, j = one[p], other[p]
        while of[i] != i:
            of[i] = of[of[i]]
            i = of[i]
        while of[j] != j:
            of[j] = of[of[j]]
            j = of[j]
        square, cells = 0.0, size[i] + size[j]
        for c in range(d):
            square += (mean[c, i] - mean[c, j]) ** 2
        if i == j or square * size[i] * size[j] > threshold * cells:
            continue
        for c in range(d):
            mean[c, i] += (mean[c, j] - mean[c, i]) * size[j] / cells
        of[j], size[i] = i, cells
    for i in range(n_pixels):
        while of[i] != of[of[i]]:
            of[i] = of[of[i]]
    return of


@kernel
def teach(
    features: AnyArray, counts: AnyArray, tile: AnyArray, half: AnyArray, purity: float, out: AnyArray, x: AnyArray
) -> None:
    """Sums over the pixels of each half and class, of those that the class fills to a purity and of the others.

    Parameters
    ----------
    features : float64 array (d, n_pixels)
    counts : array (n_pixels, n_classes)
        Cells, or their share.
    tile : int64 array (n_pixels,)
    half : int64 array (n_tiles,)
        0 or 1.
    purity : float
    out : float64 array (2, 2, n_classes, 2 + d + d (d + 1) / 2)
        By half, by pure or not, by class: sums of the cells and of their squares; of the cells times each feature; of
        the cells times the product of each two, by rows of the lower triangle. Added to.
    x : float64 array (d,)
        Work space.
    """
    d, n_pixels = features.shape
    n_classes = counts.shape[1]
    for n in range(n_pixels):
        cells = 0.0
        for k in range(n_classes):
            cells += counts[n, k]
        if cells == 0.0:
            continue
        h, least, left = half[tile[n]], purity * cells, cells
        for i in range(d):
            x[i] = features[i, n]
        for k in range(n_classes):
            if counts[n, k] == 0:
                continue
            w = float(counts[n, k])
            left -= w
            own = out[h, 0 if w >= least else 1, k]
            own[0] += w
            own[1] += w * w
            at = 2 + d
            for i in range(d):
                wx = w * x[i]
                own[2 + i] += wx
                for j in range(i + 1):
                    own[at] += wx * x[j]
                    at += 1
            if left == 0.0:  # most pixels hold one class
                break


@kernel
def _likeliest(
    x: AnyArray,
    m: int,
    centre: AnyArray,
    scale: AnyArray,
    constant: AnyArray,
    square: AnyArray,
    z: AnyArray,
    best: AnyArray,
    named: AnyArray,
) -> None:
    """Class of each of the first ``m`` columns of ``x`` (d, n), by the laws of one half; written to ``named``.

    Loops over pixels inside, so that they become vectors.
    """
    for n in range(m):
        best[n], named[n] = -np.inf, 0
    for k in range(centre.shape[0]):
        if constant[k] == -np.inf:
            continue
        for n in range(m):
            square[n] = 0.0
        _add_squares(x, m, centre[k], scale[k], square, z)
        for n in range(m):
            likely = constant[k] - 0.5 * square[n]
            better = likely > best[n]
            best[n] = likely if better else best[n]
            named[n] = k if better else named[n]


@kernel
def _add_squares(x: AnyArray, m: int, centre: AnyArray, scale: AnyArray, square: AnyArray, z: AnyArray) -> None:
    """Add the squares of ``scale @ (x - centre)`` of each of the first ``m`` columns of ``x``."""
    for i in range(x.shape[0]):
        a, c = scale[i, 0], centre[0]
        if i == 0:
            for n in range(m):
                y = a * (x[0, n] - c)
                square[n] += y * y
            continue
        for n in range(m):
            z[n] = a * (x[0, n] - c)
        for j in range(1, i):
            a, c = scale[i, j], centre[j]
            for n in range(m):
                z[n] += a * (x[j, n] - c)
        a, c = scale[i, i], centre[i]
        for n in range(m):
            y = z[n] + a * (x[i, n] - c)
            square[n] += y * y


def work_lines(d: int) -> tuple[AnyArray, ...]:
    """Space for blocks of pixels with ``d`` features in `name_classes`: to get it there takes longer to compile."""
    pixel, filled = np.empty((2, _BLOCK), dtype=np.int64), np.zeros(2, dtype=np.int64)
    return np.empty((2, d, _BLOCK)), pixel, filled, *np.empty((3, _BLOCK)), np.empty(_BLOCK, dtype=np.int64)


@kernel
def name_classes(
    features: AnyArray,
    counts: AnyArray,
    tile: AnyArray,
    half: AnyArray,
    centre: AnyArray,
    scale: AnyArray,
    constant: AnyArray,
    confusion: AnyArray,
    x: AnyArray,
    pixel: AnyArray,
    filled: AnyArray,
    square: AnyArray,
    z: AnyArray,
    best: AnyArray,
    named: AnyArray,
) -> None:
    """Give each pixel the class under whose law it is likeliest, and count what is right.

    Parameters
    ----------
    features, counts, tile, half
        As in `teach`.
    centre : float64 array (2, n_classes, d)
        By the half that is tested.
    scale : float64 array (2, n_classes, d, d)
        Lower triangles that turn differences from the centre into standard normal ones.
    constant : float64 array (2, n_classes)
        Added to the log likelihood; -inf for a class that cannot be named.
    confusion : int64 array (n_tiles, n_classes, n_classes)
        By tile, cells of class (row) that were given class (column). Added to.
    x, pixel, filled, square, z, best, named : arrays
        Of `work_lines`.
    """
    d, n_pixels = features.shape
    n_classes = counts.shape[1]
    block = square.shape[0]  # of pixels of each half, gathered before it is named
    for n in range(n_pixels + 2):
        # Past the last pixel, what is left of either half.
        h = n - n_pixels
        if n < n_pixels:
            cells = 0
            for k in range(n_classes):
                cells += counts[n, k]
            if cells == 0:
                continue
            h = half[tile[n]]
            at = filled[h]
            for i in range(d):
                x[h, i, at] = features[i, n]
            pixel[h, at] = n
            filled[h] = at + 1
            if filled[h] < block:
                continue
        m = filled[h]
        _likeliest(x[h], m, centre[h], scale[h], constant[h], square, z, best, named)
        filled[h] = 0
        for i in range(m):
            p, name = pixel[h, i], named[i]
            for k in range(n_classes):
                if counts[p, k] != 0:
                    confusion[tile[p], k, name] += counts[p, k]
