"""How HH and VV of one ground are related: the mean of their product, which polarimetric phases show.

A radar that sends both polarizations knows, beside the powers of HH, HV and VV, the mean of HH times conjugate VV. It
is given here over the root of both powers, as a complex number of magnitude below 1; HV is taken as related to neither
(reflection symmetry). It is the same at all incidence angles; where a crop leaves soil bare it is the soil's (assumed).
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np

from seqrsm.arrays import AnyArray, FloatArray
from seqrsm.scattering.readers import Row, shipped_rows
from seqrsm.scattering.worlds import World, drawn_by_frequency

FIELD_SD: Final = 0.08
"""Standard deviation of either part between fields of a cover: whole fields of the L-band flight over Flevoland."""

_SOIL: Final = "Bareground"

MOST: Final = 0.98
"""Largest magnitude."""


@dataclass(frozen=True, slots=True, eq=False)
class Coherence:
    """Relation of HH and VV of some covers at one frequency.

    Attributes
    ----------
    mean : complex array (n_categories,)
        Mean of HH times conjugate VV over the root of both powers [1].
    mean_sd : float64 array (n_categories,)
        Standard deviation of either part of it about that of a given ground [1].
    status : tuple of str
        What each cover's rests on.
    notes : tuple of str
        Sources, one a cover.
    """

    mean: AnyArray
    mean_sd: FloatArray
    status: tuple[str, ...]
    notes: tuple[str, ...]


def coherence(
    categories: Sequence[str], frequency_ghz: float, world: World | None = None, closed: FloatArray | float = 1.0
) -> Coherence:
    """Relation of HH and VV of covers, of the table or as a world has it; an unknown cover has that of most others.

    Parameters
    ----------
    categories : sequence of str
    frequency_ghz : float
        Above 0 [GHz]; between nodes linear over its logarithm, held beyond.
    world : World, optional
    closed : float64 array (n_categories,) or float
        Share of the ground that a cover hides, 0 to 1; the rest is bare soil.
    """
    mean, sd, status, notes = np.empty(len(categories), complex), np.empty(len(categories)), [], []
    for k, name in enumerate(categories):
        nodes = _nodes().get(name) or _nodes()[""]
        at = np.log([float(row.text("frequency_ghz")) for row in nodes])
        real, imaginary, sd[k] = (
            np.interp(math.log(frequency_ghz), at, [float(row.text(column)) for row in nodes])
            for column in ("real", "imaginary", "mean_sd")
        )
        mean[k] = complex(real, imaginary)
        near = nodes[int(np.argmin(np.abs(at - math.log(frequency_ghz))))]
        status.append(near.text("status"))
        value = f"{abs(mean[k]):.2f} at {np.angle(mean[k], deg=True):.0f} deg"
        notes.append(f"{name}: HH and VV related by {value} ({near.text('status')}: {near.text('source')})")
        if world is not None:
            mean[k] += sd[k] * complex(*_departure(world, name, frequency_ghz))
    if np.any(np.asarray(closed) < 1.0):
        mean = closed * mean + (1.0 - np.asarray(closed)) * coherence((_SOIL,), frequency_ghz, world).mean
    return Coherence(limited(mean), sd, tuple(status), tuple(notes))


def limited(relation: AnyArray) -> AnyArray:
    """Complex numbers of any size with their magnitude held at `MOST`."""
    return np.asarray(relation * (MOST / np.maximum(np.abs(relation), MOST)))


def added_power(first: AnyArray, second: AnyArray, part: AnyArray) -> AnyArray:
    """Power of two waves added, each with half of its own, where ``part`` of the root of both is their mean product."""
    return np.asarray(0.5 * (first + second) + part * np.sqrt(first * second))


def _departure(world: World, category: str, frequency_ghz: float) -> FloatArray:
    """Standard normal (2,) of a cover in a world."""
    number = world.numbers(category)[1]
    return drawn_by_frequency(world.seed, number, f"world coherence {category}", (2,), frequency_ghz)


@cache
def _nodes() -> dict[str, list[Row]]:
    """Rows of the table by cover, frequency rising."""
    found: dict[str, list[Row]] = defaultdict(list)
    for row in shipped_rows("coherence.csv"):
        found[row.text("category")].append(row)
    return dict(found)
