"""Compiled passes over a scene's layers, in one self-contained file."""

from __future__ import annotations

import math

import numpy as np

from seqrsm.arrays import AnyArray
from seqrsm.jit import kernel


@kernel
def elevation_summary(elevation: AnyArray) -> tuple[int, float, float]:
    """Number, mean and maximum of the finite elevations; mean and maximum are 0 where there is none.

    Parameters
    ----------
    elevation : float array (rows, columns)
        nan where it is not known [m].

    Returns
    -------
    tuple of int, float, float
    """
    rows, columns = elevation.shape
    count = 0
    total = 0.0
    highest = -math.inf
    for i in range(rows):
        part = 0.0
        for j in range(columns):
            if not math.isnan(elevation[i, j]):
                count += 1
                part += elevation[i, j]
                highest = max(highest, elevation[i, j])
        total += part
    return (count, total / count, highest) if count > 0 else (0, 0.0, 0.0)


@kernel
def fill_no_data(elevation: AnyArray) -> None:
    """Give cells without elevation that of the nearest cell of their row, and empty rows that of a neighbour row.

    Geometry needs a surface everywhere; the cells stay without power and without score.

    Parameters
    ----------
    elevation : float array (rows, columns)
        Changed in place; at least one cell is finite.
    """
    rows, columns = elevation.shape
    full = np.zeros(rows, dtype=np.bool_)
    for i in range(rows):
        last = -1
        for j in range(columns):
            if not math.isnan(elevation[i, j]):
                if last + 1 < j:
                    for m in range(last + 1, j):
                        if last >= 0 and m - last <= j - m:
                            elevation[i, m] = elevation[i, last]
                        else:
                            elevation[i, m] = elevation[i, j]
                last = j
        if last >= 0:
            full[i] = True
            for m in range(last + 1, columns):
                elevation[i, m] = elevation[i, last]
    for i in range(rows):
        if not full[i]:
            step = 1
            while not ((i - step >= 0 and full[i - step]) or (i + step < rows and full[i + step])):
                step += 1
            source = i - step if i - step >= 0 and full[i - step] else i + step
            for j in range(columns):
                elevation[i, j] = elevation[source, j]


@kernel
def categories_of_fields(field: AnyArray, cover: AnyArray, n_fields: int) -> AnyArray:
    """Category of each field: that of its cells (of the last one met, should they differ); 255 where it has none.

    Parameters
    ----------
    field : int32 array (rows, columns)
    cover : uint8 array (rows, columns)
    n_fields : int

    Returns
    -------
    uint8 array (n_fields,)
    """
    out = np.full(n_fields, 255, dtype=np.uint8)
    rows, columns = field.shape
    for i in range(rows):
        for j in range(columns):
            if field[i, j] >= 0 and cover[i, j] != 255:
                out[field[i, j]] = cover[i, j]
    return out
