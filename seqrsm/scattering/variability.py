"""How far fields and dates of a cover depart from its mean backscatter, and the part of it that is roughness."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Final

import numpy as np

from seqrsm.arrays import BoolArray, FloatArray
from seqrsm.scattering.calendar import bare_fields_db, share_of_c
from seqrsm.scattering.models import soil_response_baghdadi16
from seqrsm.scattering.readers import POLARIZATIONS, Row, shipped_rows
from seqrsm.scattering.worlds import BARE_SOIL, World

_LEVEL_DEG: Final = 40.0
_ROUGHNESS_DECADES: Final = 0.2
"""Standard deviation of the logarithm, base 10, of the rms height between fields of one ground (assumed)."""
ROUGHNESS_NOTE: Final = (
    f"heights of fields differ by {_ROUGHNESS_DECADES:g} decades (assumed), which shows with the sine of the incidence "
    "angle, alike in all bands and on all dates (computed: baghdadi16)"
)
_UNKNOWN_SD_DB: Final = 2.0


@dataclass(frozen=True, slots=True)
class Variability:
    """Natural variability of one category at one polarization."""

    field_sd_db: tuple[float, float]
    """Standard deviation from field to field on one date in L band and below, and in C band and above [dB]."""
    date_sd_db: float
    """Standard deviation from date to date, common to all fields [dB]."""
    note: str
    """Status of both."""


UNKNOWN: Final = Variability((_UNKNOWN_SD_DB,) * 2, 0.0, f"field sd {_UNKNOWN_SD_DB:g} dB (assumed: none is given)")
"""Of a cover of which nothing is said."""


@dataclass(frozen=True, slots=True, eq=False)
class FieldSpread:
    """How fields of some covers differ in a look-up."""

    variability: Mapping[tuple[str, str], Variability]
    """By (category, polarization); a cover without one of a channel there has that of the channel looked up."""
    names: Sequence[str]
    """The covers."""
    frequency_ghz: float

    soil: BoolArray
    """(n_categories,): covers that are bare soil."""
    own_share: FloatArray
    """(n_categories,): part of a cover that spreads as it does; the rest as bare fields do."""
    dated: bool
    """On a day of the year."""
    world: World | None

    def spread_db(self, channel: str, among: str = "") -> tuple[FloatArray, FloatArray]:
        """Standard deviation at 40 deg (n_categories,) [dB], and the part of it that is owed to roughness.

        ``among``: channel whose variability stands in where there is none.
        """
        own, share = [], share_of_c(self.frequency_ghz)
        for name in self.names:
            factor = self.world.field_factor(name) if self.world else 1.0
            known = self.variability.get((name, channel)) or self.variability.get((name, among), UNKNOWN)
            own.append(factor * np.interp(share, (0.0, 1.0), known.field_sd_db))
        sd = self.own_share * own + (1.0 - self.own_share) * bare_fields_db(channel, self.world)
        return np.asarray(sd), np.asarray(_roughness_share(channel, self.dated) * self.soil)

    def nadir_db(self, channel: str) -> FloatArray:
        """That without roughness (n_categories,) at nadir, the mean over the channels that are alike there [dB]."""
        each = (self.spread_db(one, channel) for one in alike_at_nadir(channel))
        return np.asarray(np.mean([sd * np.sqrt(1.0 - np.square(share)) for sd, share in each], axis=0))


def alike_at_nadir(channel: str) -> tuple[str, ...]:
    """Channels that see the same as this one there."""
    return ("HV",) if channel == "HV" else ("HH", "VV")


@lru_cache(maxsize=2 * len(POLARIZATIONS))
def _roughness_share(channel: str, dated: bool) -> float:
    """Part of the shipped spread of fields of bare soil, undated or on a day, owed to their roughness, at 40 deg."""
    _, by_height = soil_response_baghdadi16(math.radians(_LEVEL_DEG))
    undated = shipped_variability()[BARE_SOIL, channel].field_sd_db[0]
    spread = bare_fields_db(channel, None) if dated else undated
    return float(_ROUGHNESS_DECADES * by_height[POLARIZATIONS.index(channel)] / spread)


def _variability_of(row: Row) -> Variability:
    """What a row of `data/variability.csv` says."""
    low, high = row.text("field_sd_db"), row.text("c_band_field_sd_db")
    note = f"field sd {low} dB ({row.text('field_status')}: {row.text('field_source')})"
    if high:
        note += f", from C band on {high} dB ({row.text('c_band_status')}: {row.text('c_band_source')})"
    note += f", date sd {row.text('date_sd_db')} dB ({row.text('date_status')}: {row.text('date_source')})"
    return Variability((float(low), float(high or low)), float(row.text("date_sd_db")), note)


@cache
def shipped_variability() -> Mapping[tuple[str, str], Variability]:
    """`data/variability.csv` by (category, polarization)."""
    return {
        (row.text("category"), row.text("polarization")): _variability_of(row)
        for row in shipped_rows("variability.csv")
    }
