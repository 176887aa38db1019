"""Where no run was made: what the scores cannot rule out, for no interval tells of a peak that no run came near."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.design.factors import DiscreteFactor
from seqrsm.design.region import Region
from seqrsm.propose.cloud import climb

_SPREAD = 4000  # places at first
_RADII = (0.3 * 0.7 ** np.arange(14)).tolist()  # coded, of the steps from the best of them


@dataclass(frozen=True, slots=True)
class Gap:
    """A box of numeric factors without a run in it, at any level of the categorical ones."""

    share: float
    """Of each continuous factor's range on the coded scale, 0 to 1."""
    ranges: dict[str, tuple[float, float]]
    """Ends of the box, natural units, by the name of the numeric factor; of a discrete one, its levels within."""


def largest_gap(region: Region, points: FloatArray) -> Gap | None:
    """The largest box without a run, with sides that are equal on the coded scale and its centre in the region.

    ``points`` (n, k) are coded settings of the runs. None without continuous factors. Found by a search, so that a box
    larger by a percent or two may be missed.
    """
    if not region.continuous:
        return None
    numeric, rng = list(region.numeric), np.random.default_rng(0)

    def halves(at: FloatArray) -> FloatArray:
        return region.half_sides(at, points)

    centre = climb(halves, region, region.sample(_SPREAD, rng), rng, radii=_RADII)[0]
    half = float(halves(centre[None, :])[0])
    ends = np.tile(centre, (2, 1))
    for j in numeric:
        ends[:, j] = centre[j] - half, centre[j] + half
        factor = region.factors[j]
        if isinstance(factor, DiscreteFactor):
            within = factor.coded_levels[np.abs(factor.coded_levels - centre[j]) < max(half - 1e-9, 1e-9)]
            ends[:, j] = within.min(), within.max()
    low, high = region.decode(ends)
    names = [region.names[j] for j in numeric]
    return Gap(half, {name: (float(low[name]), float(high[name])) for name in names})
