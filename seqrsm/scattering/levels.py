"""Levels of vegetation that its backscatter is expected to have on another ground, from those measured on a few."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np

from seqrsm.scattering.models import backscatter_ulaby89_db
from seqrsm.scattering.readers import Row

HH_OVER_VV: Final = "HH - VV"

_BySource: TypeAlias = dict[tuple[float, str], dict[str, dict[str, float]]]
"""Values by (node, channel), cover and source."""


@dataclass(frozen=True, slots=True)
class Lifts:
    """How far levels lie above the class regressions of their covers [dB], mean over what a source has of a cover."""

    measured: _BySource
    """With the difference of HH and VV as a further channel, `HH_OVER_VV`."""
    assumed: _BySource

    @classmethod
    def of(cls, levels: Sequence[Row], regressions: Sequence[Row], class_of: Mapping[str, str]) -> Lifts:
        """Of rows of levels, whose covers are of one class of the regressions each."""
        measured, assumed = (
            _above([x for x in levels if (x.text("status") == "measured") is asked], regressions, class_of)
            for asked in (True, False)
        )
        for frequency in {f for f, _ in measured}:
            hh, vv = (measured.get((frequency, channel), {}) for channel in ("HH", "VV"))
            both = {c: {s: hh[c][s] - vv[c][s] for s in hh[c].keys() & vv[c].keys()} for c in hh.keys() & vv.keys()}
            measured[frequency, HH_OVER_VV] = both
        return cls(measured, assumed)

    def sources(self, category: str, frequency_ghz: float, channel: str) -> set[str]:
        """Names of those that say something of a cover there."""
        place = frequency_ghz, channel
        return {s for kind in (self.measured, self.assumed) for s in kind.get(place, {}).get(category, {})}

    def expected(self, category: str, frequency_ghz: float, channel: str) -> float:
        """Best linear prediction for another ground: as if one source more had all covers at their common mean.

        That holds where half of the variance between the covers of a ground is the covers' own, the same on all
        grounds, and half is that ground's (Robinson 1991, That BLUP is a good thing, Statist. Sci. 6, 15-32). By the
        measured levels it is 0.4. Contrasts on a ground that is left out are then foretold with an error of 2.2 dB, by
        means of the other grounds with 2.7 dB. Assumed levels stay as they are.
        """
        place = frequency_ghz, channel
        if own := self.assumed.get(place, {}).get(category):
            return float(np.mean([*own.values()]))
        covers = self.measured[place]
        middle = np.mean([np.mean([*of.values()]) for of in covers.values() if of])
        return float(np.mean([*covers.get(category, {}).values(), middle]))


def _above(levels: Sequence[Row], regressions: Sequence[Row], class_of: Mapping[str, str]) -> _BySource:
    """Levels less the class regressions of their covers [dB], mean of each source."""
    found: dict[tuple[float, str], dict[str, dict[str, list[float]]]] = {}
    for r in regressions:
        place = float(r.text("frequency_ghz")), r.text("polarization")
        for x in levels:
            category = x.text("category")
            if class_of[category] == r.text("class") and holds(x, *place):
                there = float(backscatter_ulaby89_db(regression_of(r), math.radians(float(x.text("theta_deg")))))
                own = found.setdefault(place, {}).setdefault(category, {}).setdefault(x.text("source"), [])
                own.append(float(x.text("sigma0_db")) - there)
    return {
        place: {cover: {source: float(np.mean(v)) for source, v in of.items()} for cover, of in covers.items()}
        for place, covers in found.items()
    }


def regression_of(row: Row) -> list[float]:
    """Parameters of a class regression, see `backscatter_ulaby89_db`."""
    return [float(row.text(f"p{i}")) for i in range(1, 7)]


def holds(row: Row, frequency_ghz: float | None, channel: str) -> bool:
    """Whether a row is of a node and channel; an empty frequency or polarization holds for all."""
    at = row.text("frequency_ghz")
    return (not at or float(at) == frequency_ghz) and row.text("polarization") in ("", channel)
