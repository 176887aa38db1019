"""Single pixels of a radar on flat ground, and the cells of single footprints: one self-contained kernel file."""

from __future__ import annotations

import math

import numpy as np

from seqrsm.arrays import AnyArray
from seqrsm.jit import kernel


@kernel
def flat_pixels(
    cover: AnyArray,
    field: AnyArray,
    rows: AnyArray,
    columns: AnyArray,
    row_weight: AnyArray,
    column_weight: AnyArray,
    row_inside: AnyArray,
    column_inside: AnyArray,
    curve: AnyArray,
    factor: AnyArray,
    kind: AnyArray,
    piece: AnyArray,
    pixel: AnyArray,
    mean: AnyArray,
) -> None:
    """Mean sigma0 of the pixels where some rows of pixels cross some columns, and what their cells are.

    Parameters
    ----------
    cover : uint8 array (n, m)
        Of the whole frame.
    field : int32 array (n, m)
    rows, columns : int64 arrays (a, p), (b, q)
        Cells of the frame under each row and column of pixels.
    row_weight, column_weight : float64 arrays (a, p), (b, q)
        Part of the pixel that each fills.
    row_inside, column_inside : bool arrays (a, p), (b, q)
        Whether the middle of the cell lies in the pixel.
    curve : float64 array (n_channels, n_categories + 1, a, p)
        sigma0 of each category at the incidence of each row; 0 for no category.
    factor : float64 array (n_channels, n_fields)
        Of each field; no columns where fields do not differ.
    kind : uint8 array (a * p, b * q)
        Written: cover of the cells.
    piece : int32 array (a * p, b * q)
        Written: their field.
    pixel : int32 array (a * p, b * q)
        Written: number of the pixel, row by row, where the middle of the cell lies in it; else -1.
    mean : float64 array (n_channels, a, b)
        Written.
    """
    n_channels, last = curve.shape[0], curve.shape[1] - 1
    p, q = rows.shape[1], columns.shape[1]
    differ = factor.shape[1] > 0
    total = np.empty(n_channels)
    for i in range(rows.shape[0]):
        for j in range(columns.shape[0]):
            number = np.int32(i * columns.shape[0] + j)
            total[:] = 0.0
            for u in range(p):
                row, y = rows[i, u], i * p + u
                for v in range(q):
                    column, x = columns[j, v], j * q + v
                    k, f = cover[row, column], field[row, column]
                    kind[y, x], piece[y, x] = k, f
                    pixel[y, x] = number if row_inside[i, u] and column_inside[j, v] else np.int32(-1)
                    own, weight = min(int(k), last), row_weight[i, u] * column_weight[j, v]
                    for c in range(n_channels):
                        power = weight * curve[c, own, i, u]
                        total[c] += power * factor[c, f] if differ else power
            for c in range(n_channels):
                mean[c, i, j] = total[c]


@kernel
def label_cells(
    z: AnyArray,
    cover: AnyArray,
    field: AnyArray,
    scored: AnyArray,
    none: int,
    height: float,
    cell: float,
    relief: bool,
    rows: AnyArray,
    columns: AnyArray,
    of_row: AnyArray,
    of_column: AnyArray,
    n_columns: int,
    kind: AnyArray,
    piece: AnyArray,
    told: AnyArray,
    pixel: AnyArray,
) -> None:
    """Footprint and layers of the cells that are seen where some rows of cells cross some columns.

    Parameters
    ----------
    z, cover, field, scored : float, uint8, int32, bool arrays (n, m)
        Layers of the whole frame.
    none, height, cell, relief
        As in `kernels_prm.see_points`: ground at the height z of the flat place is seen there from y (1 - z / height).
    rows, columns : int64 arrays (a,), (b,)
        Cells of flat ground.
    of_row, of_column : int64 arrays (a,), (b,)
        Row and column of footprints that they belong to.
    n_columns : int
        Columns of footprints.
    kind, piece, told : uint8, int32, bool arrays (a, b)
        Written: the layers.
    pixel : int32 array (a, b)
        Written: number of the footprint, row by row; -1 where no known category is seen.
    """
    n = z.shape[0]
    middle = 0.5 * n
    for i in range(rows.shape[0]):
        place = (rows[i] + 0.5 - middle) * cell
        first = of_row[i] * n_columns
        for j in range(columns.shape[0]):
            r, c = rows[i], columns[j]
            if relief:
                r = min(max(math.floor(place * (1.0 - z[r, c] / height) / cell + middle), 0), n - 1)
            kind[i, j], piece[i, j], told[i, j] = cover[r, c], field[r, c], scored[r, c]
            pixel[i, j] = np.int32(first + of_column[j]) if cover[r, c] < none else np.int32(-1)
