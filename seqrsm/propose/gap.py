"""How far places lie from every run: no score rules out a peak that no run came near."""

from __future__ import annotations

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.design.region import Region


def half_sides(region: Region, runs: FloatArray, at: FloatArray) -> FloatArray:
    """Half the side of the largest box about each place that has no run in it and lies within the ranges.

    Parameters
    ----------
    region : Region
    runs, at : ndarray (r, k), (n, k)
        Coded settings.

    Returns
    -------
    ndarray (n,)
        Coded, 0 to 1; 0 at a run, whatever its level of the categorical factors. Below 0 outside the ranges.
    """
    numeric = list(region.numeric)
    found: FloatArray = 1.0 - np.max(np.abs(at[:, list(region.continuous)]), axis=1, initial=0.0)
    for run in np.unique(runs[:, numeric], axis=0):
        np.minimum(found, np.max(np.abs(at[:, numeric] - run), axis=1, initial=0.0), out=found)
    return found
