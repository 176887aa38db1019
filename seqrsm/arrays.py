"""Array types used in annotations, one name for each element type; the precision asked of an engine; choice of one."""

from __future__ import annotations

from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]
Float32Array: TypeAlias = NDArray[np.float32]
IntArray: TypeAlias = NDArray[np.int64]
BoolArray: TypeAlias = NDArray[np.bool_]
AnyArray: TypeAlias = NDArray[Any]

Precision: TypeAlias = Literal["float32", "float64"]
"""Element type of an engine's arrays."""

_TIE = 1e-9  # of the largest size


def first_of_largest(values: FloatArray) -> int:
    """Place of the first value (n,) that rounding does not tell from the largest; -inf stands for none.

    The last digits of a matrix are the processor's: between equals they must not choose.
    """
    size = float(np.max(np.abs(values), where=np.isfinite(values), initial=0.0))
    return int(np.argmax(values >= np.max(values) - _TIE * size))
