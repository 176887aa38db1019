"""The table of emissivity: e(category, frequency, polarization, look angle, soil moisture), RSL TR 380-1 Table 3.

Table 3 holds at its nodes to the last digit. The report states neither its frequency nor its polarization; H at about
20 GHz is inferred. A model of vegetation over ground, fitted to it, carries the table to V, to other frequencies and to
other soil moistures by the ratio of reflectivities, 1 - e = (1 - e_table) r_model(f, p, mv) / r_model(20 GHz, H, 0.2),
so that H and V meet at nadir and the table stays exact where it stands. What the model misses of a crop is its
canopy's and goes with its water: without any the ground emits, is heated and departs as bare soil does, whatever was
sown.

What differs from field to field, date to date and ground to ground is roughness, canopy and soil, each a factor of the
reflectivity. So departures are parts of 1 - e: one effective roughness, whatever the angle and polarization, does for
each of seven plots at L band, from rolled to deeply ploughed (Wigneron et al. 2001, IEEE TGRS 39(8)). Standard
deviations in emissivity hold at nadir, where H and V have one, or at the lowest angle of a user's rows, at
`REFERENCE_MOISTURE` and at every frequency alike: long waves see less of roughness but more of the soil, and no
measurement at hand says which prevails.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from seqrsm.arrays import BoolArray, FloatArray
from seqrsm.errors import Problem, ScatteringDataError
from seqrsm.scattering.calendar import SHIPPED, Calendar, season_depth
from seqrsm.scattering.curves import THETA_DEG, shares_of, whole_degrees
from seqrsm.scattering.emissivity_curves import POLARIZATIONS, EmissivityCurve, between_nodes, read_curves
from seqrsm.scattering.longtable import EMISSIVITY_GHZ
from seqrsm.scattering.models import ComplexLike, permittivity_soil, permittivity_water_ulaby14, reflectivity_fresnel
from seqrsm.scattering.readers import DATA, for_each, shipped_rows, unknown_covers
from seqrsm.scattering.worlds import BARE_SOIL, World, default_mean_sd, over_soil, related_covers

TABLE_FREQUENCY_GHZ: Final = 20.0
"""Frequency at which Table 3 is taken to hold [GHz], inferred from its row of water."""

REFERENCE_MOISTURE: Final = 0.2
"""Volumetric soil moisture at which Table 3 is taken to hold [m3/m3], assumed."""

MOISTURE_NODES: Final[FloatArray] = np.round(np.arange(0.02, 0.51, 0.03), 2)
"""Soil moistures at which a look-up gives emissivity [m3/m3]."""

WATER_TEMPERATURE_C: Final = 20.0

MEASURED_GHZ: Final = 100.0
"""Frequency up to which measured land bears out the fits [GHz]: Prigent et al. 2000, IEEE TGRS 38(5)."""

_DEFAULT_FIELD_SD: Final = 0.012
_DEFAULT_RELATED: Final = 0.9
_SOIL_MODEL_HIGH_GHZ: Final = 18.0
_HELD: Final = np.minimum(np.arange(THETA_DEG.size), 80)
# Beyond the table's last angle everything is held: there a layer hides the ground and the ratio is 0/0.


@dataclass(frozen=True, slots=True)
class GroundModel:
    """Vegetation over ground of one category, fitted to its row of Table 3."""

    ground: str
    """One of "soil", "water", "wet" and "constant": what permittivity follows: soil moisture and frequency, water, the
    frequency of water, nothing."""
    permittivity: float
    """Real part at 20 GHz (loss tangent 0.15), for "wet" and "constant"."""
    roughness: float
    """h at 20 GHz: the ground's reflectivity is multiplied by exp(-h). That of soil falls with frequency."""
    tau_20ghz: float
    omega: float
    tau_exponent: float
    """Optical depth of the vegetation at 20 GHz [Np], its albedo, and the power of frequency the depth follows. The
    depth of a canopy whose water is known is that which a radar sees in its course through the year."""
    heating: float
    """Share of the sun's heating of bare ground that this cover shows."""

    def reflectivity(
        self, frequency_ghz: float, polarization: str, moisture: FloatArray, canopy: float = 1.0
    ) -> FloatArray:
        """1 - emissivity for each of n moistures on `THETA_DEG`, (n, 91); ``canopy``: factor of the optical depth."""
        roughness = self.roughness
        if self.ground == "soil":
            permittivity = permittivity_soil(frequency_ghz, moisture[:, None])
            roughness *= min(frequency_ghz / TABLE_FREQUENCY_GHZ, 1.0)  # of which long waves see less
        else:
            only = complex(self.permittivity, 0.15 * self.permittivity)
            if self.ground == "water":
                only = complex(permittivity_water_ulaby14(frequency_ghz, WATER_TEMPERATURE_C))
            if self.ground == "wet":
                water = permittivity_water_ulaby14([frequency_ghz, TABLE_FREQUENCY_GHZ], WATER_TEMPERATURE_C)
                only *= abs(complex(water[0] / water[1]))
            permittivity = np.full((len(moisture), 1), only)
        tau = canopy * self.tau_20ghz * (frequency_ghz / TABLE_FREQUENCY_GHZ) ** self.tau_exponent
        theta = np.deg2rad(THETA_DEG)
        return 1.0 - emissivity_mo82(permittivity, roughness, tau, self.omega, theta, polarization)


@lru_cache(maxsize=64)
def _reference(model: GroundModel) -> FloatArray:
    """Reflectivity (91,) that a model gives where Table 3 was measured."""
    return np.asarray(model.reflectivity(TABLE_FREQUENCY_GHZ, "H", np.array([REFERENCE_MOISTURE]))[0])


@lru_cache(maxsize=256)  # worlds and occasions of a setting ask for the same again
def _ratio(model: GroundModel, frequency_ghz: float, polarization: str, canopy: float) -> FloatArray:
    """Reflectivity over `_reference`, for each moisture on `THETA_DEG`, (1 or n_moistures, 91)."""
    moistures = MOISTURE_NODES if model.ground == "soil" else np.array([REFERENCE_MOISTURE])
    own = model.reflectivity(frequency_ghz, polarization, moistures, canopy)
    return np.asarray(own[:, _HELD] / _reference(model)[_HELD])


@dataclass(frozen=True, slots=True, eq=False)
class EmissivityLookup:
    """Emissivity of some categories for one polarization."""

    categories: tuple[str, ...]

    emissivity: FloatArray
    """(n_categories, n_moistures, 91): on `MOISTURE_NODES`, or with one node only if nothing here depends on moisture,
    and at `THETA_DEG` [1]."""
    moist: BoolArray
    """(n_categories,): whether the category depends on soil moisture."""
    heating: FloatArray
    """(n_categories,): share of the sun's heating."""
    closed: FloatArray
    """(n_categories,): share of the soil that a category hides; 0 of bare soil on a day, 1 where the season stands for
    the day."""
    field_part: FloatArray
    date_part: FloatArray
    mean_part: FloatArray
    """(n_categories,): standard deviation from field to field, of the whole category from date to date, and of its mean
    about that of a given ground, as parts of the reflectivity 1 - e, 0 to 1."""
    channel_correlation: FloatArray
    """(n_categories,): correlation of the draws of H and V at grazing; at nadir, where both see the same, it is 1
    (`seen_at`)."""
    mean_sd: FloatArray
    """(n_categories,): standard deviation of the mean in emissivity, at nadir and `REFERENCE_MOISTURE` [1]."""
    status: tuple[str, ...]
    notes: tuple[str, ...]
    """What each category rests on; sources and assumptions."""

    def seen_at(self, squared_sine: float) -> EmissivityLookup:
        """The same with the correlation of H and V at a look angle, told by the square of its sine."""
        return replace(self, channel_correlation=1.0 - squared_sine * (1.0 - self.channel_correlation))

    def at_angles(self, theta_deg: ArrayLike) -> FloatArray:
        """Emissivity (n_categories, n_moistures, ...) at look angles, linear between whole degrees."""
        k, part = whole_degrees(theta_deg)
        return np.asarray((1.0 - part) * self.emissivity[:, :, k] + part * self.emissivity[:, :, k + 1])

    def at_nodes(self, nodes: Sequence[int]) -> FloatArray:
        """Emissivity (n_categories, n, 91) at some moisture nodes; one only if nothing here depends on moisture."""
        return self.emissivity[:, nodes] if self.emissivity.shape[1] > 1 else self.emissivity


def of_mixtures(value: FloatArray, share: FloatArray, theta_deg: FloatArray) -> FloatArray:
    """Sums (..., n) over covers of values (n_categories, n, 91), at angles (...) by shares (..., n_categories)."""
    k, part = whole_degrees(theta_deg)
    table = np.ascontiguousarray(np.moveaxis(value, -1, 0))
    above = share * part[..., None]
    return np.asarray(((share - above)[..., None, :] @ table[k] + above[..., None, :] @ table[k + 1])[..., 0, :])


def departed(emissivity: FloatArray, part: FloatArray) -> FloatArray:
    """Emissivity, within 0 and 1, of ground that reflects less by some part."""
    return np.clip(1.0 - (1.0 - emissivity) * (1.0 - part), 0.0, 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class EmissivityTable:
    """All categories; made by `load_emissivity_table`."""

    curves: Mapping[str, EmissivityCurve]
    """Curve by category."""
    models: Mapping[str, GroundModel]
    """`GroundModel` by category."""
    spread: Mapping[str, tuple[float, float, float]]
    """(field sd, date sd, channel correlation) by category; in emissivity, at nadir."""
    file: str = ""
    """The user's file, or ""."""
    mean_sd: Mapping[str, float] = field(default_factory=dict)
    """Standard deviation of the mean that a user states, by category; likewise."""
    mixes: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Shares of other categories, by category, of those that have no curve of their own."""
    world: World | None = None
    """The world whose means are looked up; None: the table's own."""
    calendar: Calendar = SHIPPED
    """Of the ground."""

    def in_world(self, world: World | None) -> EmissivityTable:
        """The table with its means and field spreads as a world has them; None: as they stand."""
        return replace(self, world=world)

    def lookup(
        self, categories: Sequence[str], frequency_ghz: float, polarization: str, *, day: ArrayLike | None = None
    ) -> EmissivityLookup:
        """Emissivity of ``categories``, repeats allowed, for one channel.

        0.3 to 170 GHz, with wider errors above 40 and 100; a user's own categories at most a third of an octave beyond
        their nodes. On a ``day`` of the year, or one for each category (n_categories,), the vegetation's optical depth
        goes with the water of its canopy; None: the table's, which are taken for those of the growing season.

        Raises
        ------
        ScatteringDataError
            A category without data, an unknown polarization, a frequency out of range: all at once.
        """
        names = tuple(categories)
        self.refuse(names, frequency_ghz, polarization)
        f = float(frequency_ghz)
        days = np.broadcast_to(0.0 if day is None else day, len(names)).tolist()
        stages = list(zip(names, days, strict=True))
        canopy = for_each(stages, lambda stage: 1.0 if day is None else self.calendar.canopy_share(*stage))
        found = for_each(stages, lambda stage: self._evaluate(stage[0], f, polarization, canopy[stage]))
        n_nodes = max((value.shape[0] for value, _, _ in found.values()), default=1)
        value = [np.broadcast_to(found[stage][0], (n_nodes, THETA_DEG.size)) for stage in stages]
        status = tuple(found[stage][1] for stage in stages)
        assumed = [default_mean_sd("emissivity", *own, f, polarization) for own in zip(names, status, strict=True)]
        mean_sd = [self.mean_sd.get(name, sd) for name, sd in zip(names, assumed, strict=True)]
        if day is not None:
            course = for_each(stages, lambda stage: self.calendar.emission(stage[0], f, polarization, stage[1]))
            value = [np.clip(own + course[stage][0], 0.0, 1.0) for own, stage in zip(value, stages, strict=True)]
            mean_sd = [math.hypot(sd, course[stage][1]) for sd, stage in zip(mean_sd, stages, strict=True)]
        closed = np.array([1.0 if day is None else self._closed(*stage) for stage in stages])
        spread = np.array(
            [self.spread.get(name, (_DEFAULT_FIELD_SD, 0.0, _DEFAULT_RELATED)) for name in (*names, BARE_SOIL)]
        )
        if self.world is not None:
            spread[:, 0] *= [self.world.field_factor(name) for name in (*names, BARE_SOIL)]
        sds = np.array([*(closed * spread[:-1, :2].T + (1.0 - closed) * spread[-1, :2, None]), mean_sd])
        nadir = np.array([1.0 - np.interp(REFERENCE_MOISTURE, MOISTURE_NODES[: len(own)], own[:, 0]) for own in value])
        of_fields, of_dates, of_means = np.minimum(sds / np.maximum(nadir, 1e-9), 1.0)
        if self.world is not None:
            soil = self.world.departure(BARE_SOIL, "", f, polarization)
            for k, name in enumerate(names):
                own = self.world.departure(name, "", f, polarization)
                value[k] = departed(value[k], of_means[k] * over_soil(own, soil, closed[k], related_covers("", "")))
        return EmissivityLookup(
            categories=names,
            emissivity=np.array(value),
            moist=np.array([found[stage][0].shape[0] > 1 for stage in stages]),
            heating=np.array([self._heating(stage[0], min(canopy[stage], 1.0)) for stage in stages]),
            closed=closed,
            field_part=of_fields,
            date_part=of_dates,
            mean_part=of_means,
            channel_correlation=spread[:-1, 2],
            mean_sd=np.array(mean_sd),
            status=status,
            notes=(
                *dict.fromkeys(note for _, _, notes in found.values() for note in notes),
                *(self.calendar.notes(names, polarization) if day is not None else ()),
            ),
        )

    def refuse(
        self, categories: Sequence[str], frequency_ghz: float, polarization: str, day: float | None = None
    ) -> None:
        """Refuse what `lookup` would, with its errors, in a tenth of the time."""
        problems: list[Problem] = []
        if polarization not in POLARIZATIONS:
            remedy = f"One of: {', '.join(POLARIZATIONS)}"
            problems.append(Problem("no such polarization", remedy, field="polarization", value=polarization))
        low, high = EMISSIVITY_GHZ
        if not low <= frequency_ghz <= high:
            remedy = f"Stay within {low:g} to {high:g} GHz"
            problems.append(Problem("outside the emissivity table", remedy, field="frequency", value=frequency_ghz))
        problems += unknown_covers("emissivity", (*self.curves, *self.mixes), self.file, categories)
        if problems:
            raise ScatteringDataError(*problems)
        for name in dict.fromkeys(categories):
            if name in self.curves and not (curve := self.curves[name]).printed:
                between_nodes(name, curve, frequency_ghz, polarization, self.file)
            if day is not None:
                self.calendar.canopy_share(name, day)
                self.calendar.emission(name, frequency_ghz, polarization, day)

    def _closed(self, name: str, day: float) -> float:
        """See `EmissivityLookup.closed`."""
        return 0.0 if name == BARE_SOIL else self.calendar.closed(name, day)

    def _heating(self, name: str, canopy: float) -> float:
        """Share of the sun's heating of bare ground that a category shows with a share of its canopy's water."""
        if name in self.models:
            return canopy * self.models[name].heating + (1.0 - canopy) * self.models[BARE_SOIL].heating
        mix = self.mixes.get(name, {})
        return sum(share * self._heating(part, canopy) for part, share in mix.items()) or 1.0

    def _evaluate(
        self, name: str, f: float, polarization: str, canopy: float
    ) -> tuple[FloatArray, str, tuple[str, ...]]:
        """Emissivity (1 or n_moistures, 91) of a category with a share of its canopy's water, its status, and notes."""
        if name not in self.curves:
            parts = {part: self._evaluate(part, f, polarization, canopy) for part in self.mixes[name]}
            value = sum(share * parts[part][0] for part, share in self.mixes[name].items())
            shares = " and ".join(f"{100.0 * share:.0f} % {part}" for part, share in self.mixes[name].items())
            said = [f"{name} emits as {shares.removeprefix('100 % ')} (assumed)"]
            return np.asarray(value), "assumed", (*said, *(note for _, _, notes in parts.values() for note in notes))
        curve = self.curves[name]
        if not curve.printed:
            return between_nodes(name, curve, f, polarization, self.file)[None], curve.status, (curve.note,)
        table = curve.value[TABLE_FREQUENCY_GHZ, "H"]
        model = self.models[name]
        reflected = (1.0 - table) * _ratio(model, f, polarization, canopy)
        if canopy < 1.0:
            soil = _shipped_table()._evaluate(BARE_SOIL, f, polarization, 1.0)[0]
            own = (1.0 - table) * _ratio(model, f, polarization, 0.0)
            reflected = reflected * (canopy + (1.0 - canopy) * (1.0 - soil) / own)
        value = np.clip(1.0 - reflected, 0.0, 1.0)
        if (f, polarization) == (TABLE_FREQUENCY_GHZ, "H") and model.ground != "soil" and canopy == 1.0:
            return table[None], curve.status, (curve.note,)
        notes = [curve.note, "Table 3 is carried to V, other frequencies and moistures by tau-omega fits (assumed)"]
        if model.ground == "soil" and f > _SOIL_MODEL_HIGH_GHZ:
            notes.append(f"soil permittivity above {_SOIL_MODEL_HIGH_GHZ:g} GHz lies outside its model (assumed)")
        if f > MEASURED_GHZ:
            notes.append(f"emissivity above {MEASURED_GHZ:g} GHz goes on by these fits, unmeasured (assumed)")
        return value, "assumed", tuple(notes)


def emissivity_mo82(
    permittivity: ComplexLike,
    roughness: ArrayLike,
    tau: ArrayLike,
    omega: ArrayLike,
    theta: ArrayLike,
    polarization: str,
) -> FloatArray:
    """Emissivity of vegetation over rough ground, both at one temperature (tau-omega), at angles 0 to pi/2 [rad].

    Of the ground, its permittivity, and ``roughness`` h >= 0: reflectivity x exp(-h). Of the vegetation, optical depth
    ``tau`` at the vertical [Np] and single-scattering albedo ``omega``. Mo, Choudhury, Schmugge, Wang and Jackson 1982,
    J. Geophys. Res. 87(C13): e = (1 - R) g + (1 - omega)(1 - g)(1 + R g), g = exp(-tau / cos theta).
    """
    theta = np.asarray(theta, dtype=np.float64)
    fresnel = reflectivity_fresnel(permittivity, theta)
    r = (fresnel.h if polarization == "H" else fresnel.v) * np.exp(-np.asarray(roughness, dtype=np.float64))
    # cos(90 deg) is 6e-17, not 0: no division by zero, and g is 0 there unless tau is.
    g = np.exp(-np.asarray(tau, dtype=np.float64) / np.cos(theta))
    return np.asarray((1.0 - r) * g + (1.0 - np.asarray(omega)) * (1.0 - g) * (1.0 + r * g))


def load_emissivity_table(path: str | Path | None = None, needed: bool = True) -> EmissivityTable:
    """The shipped table, or the shipped table with the categories of a user's file in place of its own.

    ``path``: long CSV with the columns of a sigma0 table (`seqrsm.scattering.longtable`): quantity ``emissivity``, unit
    ``1``, polarization ``H`` or ``V``, optional ``sd`` (from field to field) and ``mean_sd`` (of the mean), in
    emissivity at the lowest angle of the rows; elsewhere they go with the reflectivity 1 - e. ScatteringDataError tells
    that it cannot be read, all wrong rows, each with line and column, or that no rows are of emissivity where they are
    ``needed``.
    """
    shipped = _shipped_table()
    if path is None:
        return shipped
    curves, sd, mean_sd = read_curves(path, printed=False, needed=needed)
    spread = dict(shipped.spread)
    for name, value in sd.items():
        own = shipped.spread.get(name, (0.0, 0.0, _DEFAULT_RELATED))
        spread[name] = (value, own[1], own[2])
    return EmissivityTable({**shipped.curves, **curves}, shipped.models, spread, str(path), mean_sd, shipped.mixes)


@lru_cache(maxsize=1)
def _shipped_table() -> EmissivityTable:
    curves, *_ = read_curves(DATA / "emissivity_table3.csv", printed=True)
    models = {
        row.text("category"): GroundModel(
            row.text("ground"),
            float(row.text("permittivity") or "nan"),
            float(row.text("roughness")),
            float(row.text("tau_20ghz") or season_depth(row.text("category"), TABLE_FREQUENCY_GHZ)),
            float(row.text("omega")),
            float(row.text("tau_exponent")),
            float(row.text("heating")),
        )
        for row in shipped_rows("emissivity_models.csv")
    }
    numbers = ("field_sd", "date_sd", "channel_correlation")
    spread = {
        row.text("category"): (float(row.text(numbers[0])), float(row.text(numbers[1])), float(row.text(numbers[2])))
        for row in shipped_rows("emissivity_variability.csv")
    }
    mixes = {row.text("category"): shares_of(row.text("mix")) for row in shipped_rows("emissivity_mixes.csv")}
    return EmissivityTable(curves, models, spread, mixes=mixes)
