"""Which platforms of Tables A.21 to A.39 could carry the sensor an entry asks for.

The rule. The report finds that space-borne vehicles limit a microwave sensor by the size of a rigid antenna only, so
the antenna decides. A radar is taken as one of synthetic aperture that maps the whole footprint of its beam; its
antenna then needs at least the area ``4 v lambda R tan(theta) / c`` to stay free of range and azimuth ambiguities, and
a length along the track of at most twice the resolution accepted. ``lambda`` is the longest wavelength asked for,
``theta`` the largest printed angle from the vertical, taken at the ground, ``R`` the slant range on a round Earth from
the highest printed altitude, ``v`` the speed on a circular orbit. The antenna is a rectangle whose diagonal is the
printed limit of size.

* ``fits``: the antenna fits at every wavelength and angle asked for.
* ``in part``: it fits at the shorter wavelengths asked for; the text says from which frequency.
* ``exceeds``: it does not fit unless it is folded, or the radar gives up part of the swath.
* ``unknown``: a number is missing on either side. Unknown is never taken for fitting.

Power, mass, data rate and revisit are shown and left unknown: no entry prints what it needs of them.

Source of the area: range and azimuth ambiguity limits of synthetic aperture radar, Freeman et al. 2000,
IEEE Trans. Geosci. Remote Sensing 38(1), 320-324, who also show when it may be undercut.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from seqrsm.catalog.reader import load_catalog
from seqrsm.catalog.tables import Catalog, Entry, Platform
from seqrsm.constants import EARTH_RADIUS_M, SPEED_OF_LIGHT_M_S

EARTH_GRAVITY_M3_S2 = 3.986_004_418e14
"""Gravitational constant times mass of the Earth [m3/s2] (IERS Conventions 2010, Table 1.1)."""

BITS_PER_CELL = 8
"""Bits of one resolution cell, for the swath that a printed data rate allows (n of RSL TR 380-1 eq. 3-16)."""

VERDICTS = ("fits", "in part", "exceeds", "unknown")


@dataclass(frozen=True, slots=True)
class Check:
    """One printed limit of a platform against one entry.

    Attributes
    ----------
    name : {"antenna", "power", "mass", "data rate", "revisit"}
        What is compared.
    verdict : {"fits", "in part", "exceeds", "unknown"}
        The outcome.
    text : str
        Numbers and reason.
    """

    name: str
    verdict: str
    text: str


@dataclass(frozen=True, slots=True)
class PlatformFit:
    """A platform and whether it could carry what an entry asks for.

    Attributes
    ----------
    platform : Platform
        The platform.
    verdict : {"fits", "in part", "exceeds", "unknown"}
        That of the antenna.
    checks : tuple of Check
        Antenna, power, mass, data rate, revisit.
    """

    platform: Platform
    verdict: str
    checks: tuple[Check, ...]

    @property
    def unknown(self) -> tuple[str, ...]:
        """Names of the checks that the print does not decide."""
        return tuple(check.name for check in self.checks if check.verdict == "unknown")


def slant_range_m(altitude_m: float, incidence_angle_deg: float) -> float:
    """Distance [m] from ``altitude_m`` [m] to where the ray meets a round Earth at ``incidence_angle_deg`` [deg]."""
    along = EARTH_RADIUS_M * math.cos(math.radians(incidence_angle_deg))
    # the product form keeps its digits at aircraft heights, where the two terms nearly cancel
    growth = altitude_m * (2.0 * EARTH_RADIUS_M + altitude_m)
    return growth / (along + math.sqrt(along * along + growth))


def antenna_area_m2(frequency_ghz: float, altitude_m: float, incidence_angle_deg: float) -> float:
    """Least antenna area [m2] of an unambiguous synthetic aperture radar on a circular orbit.

    Parameters
    ----------
    frequency_ghz : float
        Frequency [GHz], > 0.
    altitude_m : float
        Altitude [m], > 0.
    incidence_angle_deg : float
        Largest angle from the vertical at the ground [deg], 0 to below 90.

    Returns
    -------
    float
        4 v lambda R tan(theta) / c [m2] (Freeman et al. 2000).
    """
    speed_m_s = math.sqrt(EARTH_GRAVITY_M3_S2 / (EARTH_RADIUS_M + altitude_m))
    range_m = slant_range_m(altitude_m, incidence_angle_deg)
    return 4.0 * speed_m_s * range_m * math.tan(math.radians(incidence_angle_deg)) / (frequency_ghz * 1e9)


def antenna_size_m(area_m2: float, resolution_m: float) -> float:
    """Diagonal [m] of the smallest rectangle of ``area_m2`` [m2] no longer than twice ``resolution_m`` [m]."""
    length_m = min(math.sqrt(area_m2), 2.0 * resolution_m)
    return math.hypot(length_m, area_m2 / length_m) if area_m2 > 0.0 else 0.0


@dataclass(frozen=True, slots=True)
class _Need:
    """Numbers of an entry that the antenna depends on, each the hardest asked for."""

    lowest_ghz: float
    highest_ghz: float
    angle_deg: float
    resolution_m: float

    def size_m(self, frequency_ghz: float, altitude_m: float) -> float:
        return antenna_size_m(antenna_area_m2(frequency_ghz, altitude_m, self.angle_deg), self.resolution_m)


def _need(entry: Entry) -> _Need | str:
    """What the entry needs, or what it does not print."""
    lows = [r.low for r in entry.frequency_ghz]
    highs = [r.high if r.high is not None else r.low for r in entry.frequency_ghz]
    angles = [r.high for r in entry.nadir_angle_deg]
    resolution = entry.resolution_accepted_m or entry.resolution_wanted_m
    low = min((f for f in lows if f is not None), default=None)
    high = max((f for f in highs if f is not None), default=None)
    angle = max((a for a in angles if a is not None), default=None)
    missing = [
        text
        for text, absent in (
            ("frequency", low is None or None in lows),
            ("largest angle", angle is None or None in angles),
            ("resolution", resolution is None),
        )
        if absent
    ]
    if low is None or high is None or angle is None or resolution is None or missing:
        return f"the entry prints no {', no '.join(missing)}"
    return _Need(low, high, angle, resolution)


def _largest(platform: Platform, quantity: str) -> float | None:
    """Highest printed value of ``quantity``; for antennas, which print their limit per launcher, the lowest."""
    highs = [q.value.high for q in platform.values(quantity) if q.value.high is not None]
    if not highs:
        return None
    return min(highs) if quantity == "antenna size" else max(highs)


def _limit(platform: Platform, quantity: str, highest: bool = True) -> float | None:
    """Highest, or lowest, of the printed upper values of ``quantity``; None where none is printed."""
    values = [q.value.high for q in platform.values(quantity) if q.value.high is not None]
    if not values:
        return None
    return max(values) if highest else min(values)


def _edge(holds: Callable[[float], bool], inside: float, outside: float) -> float:
    """Last value, from ``inside`` (where ``holds`` is true) towards ``outside``, for which it is still true."""
    if holds(outside):
        return outside
    for _ in range(60):
        middle = math.sqrt(inside * outside)
        inside, outside = (middle, outside) if holds(middle) else (inside, middle)
    return inside


def _antenna(entry: Entry, platform: Platform) -> Check:
    # Table A.21 prints 2 m, and 4 m for the shuttle only: the lower one holds for any launcher
    size_m, altitude_km = _limit(platform, "antenna size", highest=False), _limit(platform, "altitude")
    printed = "platform: no limit of the antenna" if size_m is None else f"platform: antenna at most {size_m:g} m"
    if entry.system != "active":
        return Check("antenna", "unknown", f"{_footprint(entry, size_m, altitude_km)}; {printed}")
    need = _need(entry)
    if isinstance(need, str):
        return Check("antenna", "unknown", f"{need}; {printed}")
    if altitude_km is None:
        return Check("antenna", "unknown", f"platform: no altitude; {printed}{_reach(need, size_m)}")
    needed_m = need.size_m(need.lowest_ghz, altitude_km * 1e3)
    where = f"{need.lowest_ghz:.3g} GHz, {need.angle_deg:g} deg, {altitude_km:g} km"
    text = f"needs {_short(needed_m)} m at {where}; {printed}"
    if size_m is None:
        return Check("antenna", "unknown", text)
    if needed_m <= size_m:
        return Check("antenna", "fits", text)

    def fits(frequency_ghz: float) -> bool:
        return need.size_m(frequency_ghz, altitude_km * 1e3) <= size_m

    if fits(need.highest_ghz):
        from_ghz = _edge(fits, need.highest_ghz, need.lowest_ghz)
        return Check("antenna", "in part", f"{text}, enough from {_short(from_ghz)} GHz")
    return Check("antenna", "exceeds", f"{text} unless folded")


def _reach(need: _Need, size_m: float | None) -> str:
    """Altitude up to which an antenna of ``size_m`` [m] is large enough, as words."""
    if size_m is None:
        return ""

    def fits(altitude_m: float) -> bool:
        return need.size_m(need.lowest_ghz, altitude_m) <= size_m

    lowest_orbit_m, geostationary_m = 150e3, 35_786e3
    if not fits(lowest_orbit_m):
        return f", too small at {need.lowest_ghz:.3g} GHz for any orbit unless folded"
    highest_km = _edge(fits, lowest_orbit_m, geostationary_m) / 1e3
    return f", enough at {need.lowest_ghz:.3g} GHz up to {_short(highest_km)} km"


def _footprint(entry: Entry, size_m: float | None, altitude_km: float | None) -> str:
    """Footprint of a radiometer at nadir, lambda h / D, where all three are printed, as words."""
    missing = "the entry prints no resolution" if entry.resolution_class_m is None else "the entry prints no frequency"
    if not entry.frequency_ghz or size_m is None or altitude_km is None:
        return missing
    ends = [f for r in entry.frequency_ghz for f in (r.high, r.low) if f is not None]
    sizes = [SPEED_OF_LIGHT_M_S / (f * 1e9) * altitude_km / size_m for f in (max(ends), min(ends))]
    return f"{missing}; footprint at nadir {_short(sizes[0])} to {_short(sizes[1])} km from {altitude_km:g} km"


def _data_rate(entry: Entry, platform: Platform) -> Check:
    rate_bit_s, altitude_km = _limit(platform, "data rate"), _limit(platform, "altitude")
    resolution_m = entry.resolution_accepted_m or entry.resolution_wanted_m
    if rate_bit_s is None:
        return Check("data rate", "unknown", "platform: no data rate")
    text = f"platform: at most {rate_bit_s:g} bit/s; the entry prints no swath"
    if resolution_m is not None and altitude_km is not None:
        orbit_m = EARTH_RADIUS_M + altitude_km * 1e3
        ground_speed_m_s = math.sqrt(EARTH_GRAVITY_M3_S2 / orbit_m) * EARTH_RADIUS_M / orbit_m
        swath_m = rate_bit_s * resolution_m**2 / (BITS_PER_CELL * ground_speed_m_s)
        text += (
            f"; sent at once, {BITS_PER_CELL} bits a cell, the swath is {_short(swath_m)} m wide at {resolution_m:g} m"
        )
    return Check("data rate", "unknown", text)


def _short(value: float) -> str:
    """Two digits, without an exponent."""
    return f"{float(f'{value:.2g}'):.10g}"


def _not_printed(name: str, quantity: str, platform: Platform) -> Check:
    """A limit that no entry states its need of: the platform's number is shown."""
    values = []
    for q in platform.values(quantity):
        number = f"at most {q.value.high:g}" if q.value.low is None else str(q.value)
        values.append(f"{number} {q.unit}" + (f" ({q.scope})" if q.scope else ""))
    return Check(name, "unknown", f"platform: {', '.join(values) or f'no {quantity}'}; the entry prints no {quantity}")


def platforms_for(entry: Entry, *, catalog: Catalog | None = None) -> tuple[PlatformFit, ...]:
    """Every platform, and whether its printed limits allow what ``entry`` asks for, by the rule above.

    Parameters
    ----------
    entry : Entry
        An entry of Tables A.1 to A.20. Only A.16 to A.20 print enough for an answer other than "unknown".
    catalog : Catalog, optional
        Default is the whole catalogue.

    Returns
    -------
    tuple of PlatformFit
        Those that fit first, then in part, exceeding, unknown; each group in the order of the tables.
    """
    fits = []
    for platform in (catalog or load_catalog()).platforms:
        antenna = _antenna(entry, platform)
        others = (
            _not_printed("power", "power", platform),
            _not_printed("mass", "mass", platform),
            _data_rate(entry, platform),
            Check(
                "revisit",
                "unknown",
                "platform: no repeat of the orbit; the entry prints " + (entry.auxiliary or "none"),
            ),
        )
        fits.append(PlatformFit(platform, antenna.verdict, (antenna, *others)))
    return tuple(sorted(fits, key=lambda fit: VERDICTS.index(fit.verdict)))
