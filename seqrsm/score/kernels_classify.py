"""What pixels hold, and a maximum likelihood classifier taught and tested on them: one self-contained kernel file."""

from __future__ import annotations

import numpy as np

from seqrsm.arrays import AnyArray
from seqrsm.jit import kernel


@kernel
def count_classes(pixel: AnyArray, cover: AnyArray, scored: AnyArray, n_pixels: int, n_classes: int) -> AnyArray:
    """Scored data-base cells of each class in each pixel.

    Parameters
    ----------
    pixel : int32 array (rows, columns)
        Pixel of each cell, -1 for none.
    cover : uint8 array (rows, columns)
        Category, 255 for none.
    scored : bool array (rows, columns)
    n_pixels, n_classes : int

    Returns
    -------
    int32 array (n_pixels, n_classes)
    """
    out = np.zeros((n_pixels, n_classes), dtype=np.int32)
    rows, columns = pixel.shape
    for i in range(rows):
        for j in range(columns):
            kind = np.int64(cover[i, j])
            k = np.int64(pixel[i, j])
            if k >= 0 and kind < n_classes and scored[i, j]:
                out[k, kind] += 1
    return out


@kernel
def cells_of_pixels(counts: AnyArray, values: AnyArray) -> AnyArray:
    """Scored cells of each pixel; 0 where the first draw of a channel is not finite.

    Parameters
    ----------
    counts : int array (n_pixels, n_classes)
    values : float64 array (n_draws, n_channels, n_pixels)

    Returns
    -------
    float64 array (n_pixels,)
    """
    out = np.zeros(counts.shape[0])
    for n in range(counts.shape[0]):
        total = 0
        for k in range(counts.shape[1]):
            total += counts[n, k]
        for c in range(values.shape[1]):
            if not np.isfinite(values[0, c, n]):
                total = 0
        out[n] = total
    return out


@kernel
def teach(
    features: AnyArray, covariates: AnyArray, counts: AnyArray, cells: AnyArray, half: AnyArray, purity: float
) -> tuple[AnyArray, AnyArray, AnyArray]:
    """Sums over the pixels of each half and class, of those that the class fills to a purity and of the others.

    Parameters
    ----------
    features : float64 array (n_draws, n_channels, n_pixels)
    covariates : float64 array (n_pixels, n_covariates)
    counts : int array (n_pixels, n_classes)
    cells : float64 array (n_pixels,)
        Of `cells_of_pixels`; pixels with 0 are left out.
    half : int64 array (n_pixels,)
        0 or 1.
    purity : float

    Returns
    -------
    weight, mean, second : float64 arrays (2, 2, n_classes, 2), (2, 2, n_classes, d), (2, 2, n_classes, d, d)
        By half, by pure or not, by class: sums of the cells and of their squares; of the cells times each feature and
        covariate; of the cells times the product of each two.
    """
    n_draws, n_channels, n_pixels = features.shape
    n_classes, n_more = counts.shape[1], covariates.shape[1]
    d = n_channels + n_more
    weight = np.zeros((2, 2, n_classes, 2))
    mean = np.zeros((2, 2, n_classes, d))
    second = np.zeros((2, 2, n_classes, d, d))
    x = np.empty(d)
    for n in range(n_pixels):
        if cells[n] <= 0.0:
            continue
        h, least = half[n], purity * cells[n]
        for c in range(n_more):
            x[n_channels + c] = covariates[n, c]
        for draw in range(n_draws):
            for c in range(n_channels):
                x[c] = features[draw, c, n]
            for k in range(n_classes):
                w = float(counts[n, k])
                if w > 0.0:
                    s = 0 if w >= least else 1
                    weight[h, s, k, 0] += w
                    weight[h, s, k, 1] += w * w
                    for i in range(d):
                        wx = w * x[i]
                        mean[h, s, k, i] += wx
                        for j in range(i + 1):
                            second[h, s, k, i, j] += wx * x[j]
    for h in range(2):
        for s in range(2):
            for k in range(n_classes):
                for i in range(d):
                    for j in range(i):
                        second[h, s, k, j, i] = second[h, s, k, i, j]
    return weight, mean, second


@kernel
def name_classes(
    features: AnyArray,
    covariates: AnyArray,
    counts: AnyArray,
    cells: AnyArray,
    half: AnyArray,
    centre: AnyArray,
    scale: AnyArray,
    known_scale: AnyArray,
    constant: AnyArray,
) -> tuple[AnyArray, AnyArray]:
    """Give each draw of each pixel the class under whose law it is likeliest, and count what is right.

    Parameters
    ----------
    features, covariates, counts, cells, half
        As in `teach`.
    centre : float64 array (2, n_classes, d)
        By the half that is tested.
    scale : float64 array (2, n_classes, d, d)
        Lower triangles that turn differences from the centre into standard normal ones.
    known_scale : float64 array (2, n_classes, n_covariates, n_covariates)
        The same for the covariates alone.
    constant : float64 array (2, n_classes)
        Added to the log likelihood; -inf for a class that cannot be named.

    Returns
    -------
    correct : float64 array (n_pixels,)
        Cells of the class named, summed over the draws.
    confusion : int64 array (n_classes, n_classes)
        Cells of class (row) that were given class (column), summed over the draws.
    """
    n_draws, n_channels, n_pixels = features.shape
    n_classes, n_more = counts.shape[1], covariates.shape[1]
    d = n_channels + n_more
    correct = np.zeros(n_pixels)
    confusion = np.zeros((n_classes, n_classes), dtype=np.int64)
    x, away, base = np.empty(d), np.empty(d), np.empty(n_classes)
    for n in range(n_pixels):
        if cells[n] <= 0.0:
            continue
        h = half[n]
        for c in range(n_more):
            x[n_channels + c] = covariates[n, c]
        for k in range(n_classes):
            square = 0.0
            for i in range(n_more):
                z = 0.0
                for j in range(i + 1):
                    z += known_scale[h, k, i, j] * (x[n_channels + j] - centre[h, k, n_channels + j])
                square += z * z
            base[k] = constant[h, k] + 0.5 * square
        for draw in range(n_draws):
            for c in range(n_channels):
                x[c] = features[draw, c, n]
            best, named = -np.inf, 0
            for k in range(n_classes):
                square = 0.0
                for i in range(d):
                    away[i] = x[i] - centre[h, k, i]
                    z = 0.0
                    for j in range(i + 1):
                        z += scale[h, k, i, j] * away[j]
                    square += z * z
                likely = base[k] - 0.5 * square
                if likely > best:
                    best, named = likely, k
            correct[n] += counts[n, named]
            for k in range(n_classes):
                confusion[k, named] += counts[n, k]
    return correct, confusion
