"""How HH and VV of one ground are related: the mean of their product, which polarimetric phases show.

A radar that sends both polarizations knows, beside the powers of HH, HV and VV, the mean of HH times conjugate VV. It
is given here over the root of both powers, as a complex number of magnitude below 1; HV is taken as related to neither
(reflection symmetry). It is the same from 40 degrees on, and goes to what symmetry leaves at nadir, `by_angle`; where a
crop leaves soil bare it is the soil's (assumed).
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from types import MappingProxyType
from typing import Final, NamedTuple

import numpy as np

from seqrsm.arrays import AnyArray, FloatArray
from seqrsm.scattering.readers import shipped_rows
from seqrsm.scattering.worlds import BARE_SOIL, World, co_apart, drawn_by_frequency

FIELD_SD: Final = 0.08
"""Standard deviation of either part between fields of a cover: whole fields of the L-band flight over Flevoland."""

_DRIFT: Final = 0.017
"""Variance of either part in an octave: six crops differ by 0.24 rms from L to C band, two grounds by 0.14."""
_BESIDE_OCTAVES: Final = 0.1  # so near a node what it rests on holds

MOST: Final = 0.98
"""Largest magnitude."""


@dataclass(frozen=True, slots=True, eq=False)
class Coherence:
    """Relation of HH and VV of some covers at one frequency."""

    mean: AnyArray
    """(n_categories,): mean of HH times conjugate VV over the root of both powers [1]."""
    status: tuple[str, ...]
    """What each cover's rests on."""
    notes: tuple[str, ...]
    """Sources, one a cover."""


class Relation(NamedTuple):
    """A node of a table: frequency [GHz], mean product over the root of both powers [1], its sd, what it rests on."""

    frequency_ghz: float
    mean: complex
    mean_sd: float
    status: str
    source: str


def coherence(
    categories: Sequence[str],
    frequency_ghz: float,
    world: World | None = None,
    closed: FloatArray | float = 1.0,
    own: Mapping[str, Sequence[Relation]] = MappingProxyType({}),
) -> Coherence:
    """Relation of HH and VV of covers, of the table or as a world has it; an unknown cover has that of most others.

    Between nodes it is linear over the logarithm of frequency, held beyond. ``closed``, (n_categories,) or one: share
    of the ground that a cover hides, 0 to 1; the rest is bare soil. ``own``: nodes of covers in a user's table,
    frequency rising, in place of the shipped ones.
    """
    mean, status, notes = np.empty(len(categories), complex), [], []
    for k, name in enumerate(categories):
        nodes = own.get(name) or _shipped().get(name) or _shipped()[""]
        mean[k], sd, rests_on, told = _at_frequency(tuple(nodes), frequency_ghz)
        status.append(rests_on)
        notes.append(f"{name}: {told}")
        if world is not None:
            mean[k] += sd * complex(*_departure(world.seed, world.numbers(name)[1], name, frequency_ghz))
    if np.any(np.asarray(closed) < 1.0):
        mean = closed * mean + (1.0 - np.asarray(closed)) * coherence((BARE_SOIL,), frequency_ghz, world, 1.0, own).mean
    return Coherence(limited(mean), tuple(status), tuple(notes))


@lru_cache(maxsize=64)
def _at_frequency(nodes: tuple[Relation, ...], frequency_ghz: float) -> tuple[complex, float, str, str]:
    """Mean, its standard deviation, what they rest on and a note of one cover."""
    away = np.log2([node.frequency_ghz / frequency_ghz for node in nodes])  # octaves
    mean = complex(np.interp(0.0, away, np.array([node.mean for node in nodes])))
    below, above = away[away <= 0.0], away[away > 0.0]
    apart = [float(np.min(np.abs(side))) for side in (below, above) if side.size]
    drift = math.prod(apart) / sum(apart) if len(apart) == 2 else apart[0]  # of a bridge, or of a random walk
    sd = math.hypot(np.interp(0.0, away, [node.mean_sd for node in nodes]), math.sqrt(_DRIFT * drift))
    near = nodes[int(np.argmin(np.abs(away)))]
    status = "assumed" if len(apart) < 2 and apart[0] > _BESIDE_OCTAVES else near.status
    value = f"{abs(mean):.2f} at {np.angle(mean, deg=True):.0f} deg"
    return mean, sd, status, f"HH and VV related by {value} ({status}: {near.source})"


def limited(relation: AnyArray) -> AnyArray:
    """Complex numbers of any size with their magnitude held at `MOST`."""
    return np.asarray(relation * (MOST / np.maximum(np.abs(relation), MOST)))


def by_angle(relation: AnyArray, cross_over_co: AnyArray, theta_deg: FloatArray | float) -> AnyArray:
    """How HH and VV of covers are related at incidence angles, from their relation at 40 degrees and more.

    Complex (n_categories, n) at angles (n,) [deg], or (n_categories, 1) at one. Ground that is the same from all sides
    has at nadir one less twice the power of HV over that of HH (Nghiem et al. 1992, Radio Science 27(2), 111-131), of
    which ``cross_over_co`` (n_categories,) is the ratio there [1]; between, straight lines over the square of the sine
    (assumed).
    """
    apart = co_apart(theta_deg)
    return np.asarray(apart * relation[:, None] + (1.0 - apart) * limited(1.0 - 2.0 * cross_over_co)[:, None])


def circular(relation: AnyArray, hh: AnyArray, hv: AnyArray, vv: AnyArray) -> AnyArray:
    """How RH and RV are related where HH and VV are by ``relation`` and HV to neither, from the powers of the three.

    A right circular wave is (1, -i) in H and V over the root of 2, so that the mean of RH times conjugate RV is i/2
    times that of HH and VV less the power of HV (Raney 2007, IEEE Trans. Geosci. Remote Sensing 45(11), 3397-3404).
    """
    return np.asarray(1j * (relation * np.sqrt(hh * vv) - hv) / np.sqrt((hh + hv) * (vv + hv)))


def added_power(first: AnyArray, second: AnyArray, part: AnyArray) -> AnyArray:
    """Power of two waves added, each with half of its own, where ``part`` of the root of both is their mean product."""
    return np.asarray(0.5 * (first + second) + part * np.sqrt(first * second))


@lru_cache(maxsize=256)  # occasions of one world, and worlds in which other covers differ, ask for the same
def _departure(seed: int, number: int, category: str, frequency_ghz: float) -> FloatArray:
    """Standard normal (2,) of a cover in a world."""
    return drawn_by_frequency(seed, number, f"world coherence {category}", (2,), frequency_ghz)


@cache
def _shipped() -> Mapping[str, Sequence[Relation]]:
    """The shipped table by cover, frequency rising."""
    found: dict[str, list[Relation]] = defaultdict(list)
    for row in shipped_rows("coherence.csv"):
        ghz, real, imaginary, sd = (
            float(row.text(column)) for column in ("frequency_ghz", "real", "imaginary", "mean_sd")
        )
        node = Relation(ghz, complex(real, imaginary), sd, row.text("status"), row.text("source"))
        found[row.text("category")].append(node)
    return found
