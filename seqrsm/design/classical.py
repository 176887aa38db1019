"""Classical designs in coded units, to compare optimal ones with: factorial, central composite.

All return points (n, k) with numeric factors in [-1, 1] unless said otherwise, in standard order.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Literal, TypeAlias

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.errors import DesignError, Problem

Axial: TypeAlias = Literal["face", "rotatable", "inscribed"]

_MAX_RUNS = 1_000_000


def full_factorial(levels: Sequence[int]) -> FloatArray:
    """Every combination of equally spaced levels of each factor, the first factor changing fastest.

    Parameters
    ----------
    levels : sequence of int
        Number of levels of each factor, at least 2.

    Raises
    ------
    DesignError
        More than a million runs.
    """
    if np.prod([float(n) for n in levels]) > _MAX_RUNS:
        raise DesignError(Problem(f"the factorial has more than {_MAX_RUNS} runs", value=tuple(levels)))
    lines = [np.linspace(-1.0, 1.0, n) for n in levels]
    return np.array(list(itertools.product(*reversed(lines))))[:, ::-1].copy()


def central_composite(k: int, axial: Axial = "face", centre_runs: int = 3) -> FloatArray:
    """Central composite design (Box & Wilson 1951): factorial, axial and centre points.

    Parameters
    ----------
    k : int
        Factors, 2 or more.
    axial : {"face", "rotatable", "inscribed"}
        Axial distance: 1; F^(1/4) for a factorial of F runs (beyond [-1, 1]: the variance is then constant on spheres,
        Box & Hunter 1957); the rotatable design shrunk into [-1, 1].
    centre_runs : int
        Runs at the centre.
    """
    if k < 2:
        raise DesignError(Problem("a central composite design needs two or more factors", value=k))
    cube = full_factorial([2] * k)
    alpha = 1.0 if axial == "face" else float(cube.shape[0]) ** 0.25
    axes = alpha * np.repeat(np.eye(k), 2, axis=0) * np.tile([-1.0, 1.0], k)[:, None]
    points = np.vstack([cube, axes, np.zeros((centre_runs, k))])
    return points / alpha if axial == "inscribed" else points
