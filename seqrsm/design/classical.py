"""Classical designs in coded units: factorial, central composite, Box-Behnken, Latin hypercube, Sobol.

All return points (n, k) with numeric factors in [-1, 1] unless said otherwise, in standard order.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from functools import lru_cache
from typing import Literal, TypeAlias

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.errors import DesignError, Problem

Axial: TypeAlias = Literal["face", "rotatable", "inscribed"]

_MAX_RUNS = 1_000_000

# Box & Behnken (1960), Technometrics 2, 455-475, table 4: which factors vary together at +-1 (others at 0), and the
# runs at the centre.
_BOX_BEHNKEN: dict[int, tuple[tuple[tuple[int, ...], ...], int]] = {
    3: (((0, 1), (0, 2), (1, 2)), 3),
    4: (((0, 1), (2, 3), (0, 3), (1, 2), (0, 2), (1, 3)), 3),
    5: (((0, 1), (2, 3), (1, 4), (0, 2), (3, 4), (1, 2), (0, 3), (2, 4), (0, 4), (1, 3)), 6),
    6: (((0, 1, 3), (1, 2, 4), (2, 3, 5), (0, 3, 4), (1, 4, 5), (0, 2, 5)), 6),
    7: (((3, 4, 5), (0, 5, 6), (1, 4, 6), (0, 1, 3), (2, 3, 6), (0, 2, 4), (1, 2, 5)), 6),
}


def full_factorial(levels: Sequence[int]) -> FloatArray:
    """Every combination of equally spaced levels of each factor, the first factor changing fastest.

    Parameters
    ----------
    levels : sequence of int
        Number of levels of each factor, at least 2.

    Raises
    ------
    DesignError
        No factor, fewer than two levels, or more than a million runs.
    """
    if not levels or any(n < 2 for n in levels):
        raise DesignError(Problem("a factorial needs two or more levels of each factor", value=tuple(levels)))
    if np.prod([float(n) for n in levels]) > _MAX_RUNS:
        raise DesignError(Problem(f"the factorial has more than {_MAX_RUNS} runs", value=tuple(levels)))
    lines = [np.linspace(-1.0, 1.0, n) for n in levels]
    return np.array(list(itertools.product(*reversed(lines))))[:, ::-1].copy()


@lru_cache(maxsize=1)
def minimum_aberration(k: int, runs: int) -> tuple[FloatArray, tuple[tuple[int, ...], ...]]:
    """Two-level fraction of k factors whose defining relation has the fewest short words.

    Fries & Hunter (1980), Technometrics 22, 601-608: fewest words of the shortest length, among these fewest of the
    next, and so on, by trying every choice of generators.

    Parameters
    ----------
    k : int
        Factors, 3 to 8.
    runs : int
        A power of two above k and below 2^k.

    Returns
    -------
    points : ndarray (runs, k)
        The first log2(runs) factors in standard order, the others products of these.
    words : tuple of tuple of int
        The defining relation: in each word the product of these columns is 1; shortest first. The length of the
        shortest is the resolution.

    Raises
    ------
    DesignError
        There is no such fraction.
    """
    sizes = [2**b for b in range(2, k) if 2**b > k]
    if not 3 <= k <= 8 or runs not in sizes:
        remedy = f"For {k} factors there are fractions of {' or '.join(map(str, sizes))} runs." if 3 <= k <= 8 else ""
        raise DesignError(Problem("there is no such two-level fraction (3 to 8 factors)", remedy, value=(k, runs)))
    basic = runs.bit_length() - 1
    products = sorted((mask for mask in range(runs) if mask.bit_count() > 1), key=lambda mask: -mask.bit_count())
    best: tuple[list[int], list[int]] = ([k + 1] * (k + 1), [])
    for chosen in itertools.combinations(products, k - basic):
        words = [0]
        for extra, mask in enumerate(chosen):
            words += [word ^ mask ^ (1 << (basic + extra)) for word in words]
        lengths = [word.bit_count() for word in words[1:]]
        pattern = [lengths.count(length) for length in range(k + 1)]
        if pattern < best[0]:
            best = (pattern, words[1:])
    words = best[1]
    cube = full_factorial([2] * basic)
    # Of the 2^e - 1 words those at places 2^i - 1 end in factor basic + i alone: they are the generators.
    columns = [
        np.prod(cube[:, [j for j in range(basic) if words[2**i - 1] >> j & 1]], axis=1) for i in range(k - basic)
    ]
    relation = (tuple(j for j in range(k) if word >> j & 1) for word in words)
    points = np.column_stack([cube, *columns])
    points.setflags(write=False)  # it is kept: whoever tells the relation asks again
    return points, tuple(sorted(relation, key=lambda word: (len(word), word)))


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
    if k < 2 or centre_runs < 0:
        raise DesignError(Problem("a central composite design needs two or more factors", value=k))
    if axial not in ("face", "rotatable", "inscribed"):
        raise DesignError(Problem("unknown axial distance", "Use face, rotatable or inscribed.", value=axial))
    cube = full_factorial([2] * k)
    alpha = 1.0 if axial == "face" else float(cube.shape[0]) ** 0.25
    axes = alpha * np.repeat(np.eye(k), 2, axis=0) * np.tile([-1.0, 1.0], k)[:, None]
    points = np.vstack([cube, axes, np.zeros((centre_runs, k))])
    return points / alpha if axial == "inscribed" else points


def box_behnken(k: int, centre_runs: int | None = None) -> FloatArray:
    """Box-Behnken design for 3 to 7 factors: 12, 24, 40, 48 or 56 runs and those at the centre.

    Parameters
    ----------
    k : int
        Factors, 3 to 7.
    centre_runs : int, optional
        By default as published: 3, 3, 6, 6, 6 (15, 27, 46, 54, 62 runs in all).
    """
    if k not in _BOX_BEHNKEN:
        raise DesignError(Problem("Box-Behnken designs are given for 3 to 7 factors", "Use another.", value=k))
    blocks, published = _BOX_BEHNKEN[k]
    rows = []
    for block in blocks:
        cube = full_factorial([2] * len(block))
        part = np.zeros((cube.shape[0], k))
        part[:, list(block)] = cube
        rows.append(part)
    count = published if centre_runs is None else centre_runs
    if count < 0:
        raise DesignError(Problem("the number of centre runs is negative", value=count))
    return np.vstack([*rows, np.zeros((count, k))])


def latin_hypercube(n: int, k: int, seed: int, centred: bool = False) -> FloatArray:
    """Latin hypercube (McKay, Beckman & Conover 1979): each factor once in each of n equal intervals of [-1, 1].

    Parameters
    ----------
    n, k : int
        Runs and factors.
    seed : int
        Same seed, same design.
    centred : bool
        Points in the middle of their intervals instead of anywhere in them.
    """
    if n < 1 or k < 1:
        raise DesignError(Problem("a Latin hypercube needs a run and a factor", value=(n, k)))
    rng = np.random.default_rng(seed)
    cells = np.column_stack([rng.permutation(n) for _ in range(k)])
    inside = np.full((n, k), 0.5) if centred else rng.random((n, k))
    return 2.0 * (cells + inside) / n - 1.0


def sobol(n: int, k: int, seed: int | None = None) -> FloatArray:
    """First n points of the Sobol sequence on [-1, 1]^k, scrambled where a seed is given.

    A power of two is best: then every factor is once in each of n equal intervals.
    """
    if n < 1 or k < 1:
        raise DesignError(Problem("a Sobol sequence needs a run and a factor", value=(n, k)))
    from scipy.stats import qmc  # scipy.stats takes half a second to import

    engine = qmc.Sobol(k, scramble=seed is not None, seed=None if seed is None else np.random.default_rng(seed))
    points: FloatArray = 2.0 * engine.random_base2(int(np.ceil(np.log2(n))))[:n] - 1.0
    return points


def definitive_screening(k: int, centre_runs: int = 1) -> FloatArray:
    """Definitive screening design (Jones & Nachtsheim 2011, J. Quality Technology 43, 1-15): [C; -C; 0].

    C is a conference matrix of even order (Xiao, Lin & Bai 2012, J. Quality Technology 44, 2-8), here by Paley's
    construction; for an odd number of factors a column of the next order is left out. Main effects are clear of each
    other and of all second-order terms; the full quadratic needs more runs from four factors on.

    Parameters
    ----------
    k : int
        Factors, 3 to 8.
    centre_runs : int
        Runs at the centre, 1 or more.
    """
    order = k + k % 2
    if not 3 <= k <= 8 or centre_runs < 1:
        raise DesignError(Problem("definitive screening designs are given for 3 to 8 factors", "Use another.", value=k))
    q = order - 1
    squares = {(i * i) % q for i in range(1, q)}
    character = [0 if i == 0 else 1 if i in squares else -1 for i in range(q)]
    C = np.ones((order, order))
    C[0, 0] = 0.0
    C[1:, 1:] = [[character[(i - j) % q] for j in range(q)] for i in range(q)]
    if q % 4 == 3:
        C[1:, 0] = -1.0
    C = C[:, :k]
    return np.vstack([C, -C, np.zeros((centre_runs, k))])
