"""Block effects: flight days and sources as sum-to-zero columns."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from seqrsm.arrays import FloatArray


def block_columns(block_ids: Iterable[object]) -> tuple[FloatArray, tuple[str, ...]]:
    """Sum-to-zero contrasts of blocks (flight days, sources).

    Parameters
    ----------
    block_ids : iterable (n,)
        Block of each run; blocks are taken in the order of first appearance.

    Returns
    -------
    columns : ndarray (n, b - 1)
        Column j is 1 in block j, -1 in the last block, else 0; zeros are the unweighted mean of the blocks.
    names : tuple of str
        ``"block[<id>]"``, to be appended to the terms: a plain string is a block column.
    """
    ids = list(block_ids)
    order = list(dict.fromkeys(ids))
    index = np.array([order.index(i) for i in ids], dtype=np.int64)
    contrasts = np.vstack([np.eye(len(order) - 1), -np.ones(len(order) - 1)]) if len(order) > 1 else np.zeros((1, 0))
    return contrasts[index] if ids else np.zeros((0, 0)), tuple(f"block[{name}]" for name in order[:-1])
