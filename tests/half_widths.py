"""Half-widths of the intervals of `seqrsm.fit`."""

from __future__ import annotations

import numpy as np

from seqrsm.fit.intervals import Interval


def half_width(interval: Interval) -> np.ndarray:
    return np.asarray(0.5 * (interval.high - interval.low))
