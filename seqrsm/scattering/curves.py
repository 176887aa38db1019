"""Mean backscatter of each category at its node frequencies, made from the shipped tables and models.

A curve is a dense array over wind, node frequency, polarization and incidence angle 0, 1, ..., 90 degrees, in dB.
What the published formulas do not say near nadir and near grazing is settled by `limit_db`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from seqrsm.arrays import FloatArray, IntArray
from seqrsm.constants import wavenumber_rad_m
from seqrsm.scattering.levels import HH_OVER_VV, Lifts, holds, regression_of
from seqrsm.scattering.models import (
    Backscatter,
    backscatter_layer_ulaby14,
    backscatter_oh04,
    backscatter_oh92,
    backscatter_ulaby89_db,
    permittivity_soil,
    reflectivity_fresnel,
    soil_response_baghdadi16,
)
from seqrsm.scattering.readers import POLARIZATIONS, STATUSES, Row, numbers_of, shipped_rows
from seqrsm.scattering.worlds import co_apart
from seqrsm.units import db_to_linear, linear_to_db

THETA_DEG: Final[FloatArray] = np.arange(91.0)
"""Incidence angles of every table [deg]."""

FLOOR_DB: Final = -60.0
"""Smallest backscatter kept [dB]: below it any receiver's noise rules."""

_GRAZING_DEG, _STEEP_DEG = 75, 20
_LAND_CAP_DB, _WATER_CAP_DB, _CROSS_CAP_DB = 12.0, 20.0, -3.0
_CROSS_BELOW_CO_DB: Final = 3.0
_MODEL_NODES_GHZ: Final = (1.25, 3.0, 5.4, 9.6, 13.6)
_HIGH_BANDS_GHZ: Final = (9.6, 13.6)

Statuses: TypeAlias = tuple[tuple[str, ...], ...]
"""Status by node frequency and channel."""

_COMPUTED: Final[Statuses] = (("computed",) * 3,) * len(_MODEL_NODES_GHZ)
_OH04_MOISTURE, _OH04_KS, _OH04_THETA_DEG = (0.04, 0.291), (0.13, 6.98), (10.0, 70.0)
MOISTURE_FELT: Final = (0.04, 0.45)
"""Volumetric moisture of bare soil beyond which nothing changes (assumed) [m3/m3]."""
_BAGHDADI16_THETA_DEG = (18.0, 57.0)
MODEL_THETA: Final[FloatArray] = np.deg2rad(np.minimum(THETA_DEG, 89.0))
"""Angles at which models are asked [rad]; beyond 75 degrees constant gamma takes over."""


def whole_degrees(theta_deg: ArrayLike) -> tuple[IntArray, FloatArray]:
    """Place on `THETA_DEG` at or before angles [deg], and the part of the way to the next."""
    position = np.minimum(np.asarray(theta_deg, dtype=np.float64), THETA_DEG[-1])
    k = np.minimum(position.astype(np.int64), THETA_DEG.size - 2)
    return k, position - k


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """Mean backscatter of one category in one season."""

    category: str
    season: str
    """Key of the curve."""
    frequency_ghz: FloatArray
    """(n_frequency,): node frequencies [GHz], rising."""
    wind_m_s: FloatArray
    """(n_wind,): node winds [m/s]; one entry when wind does not matter."""
    value_db: FloatArray
    """(n_wind, n_frequency, 3, 91): sigma0 [dB] at HH, HV, VV; nan for a channel the source lacks."""
    surface: bool
    """A bare surface, whose HV stays 3 dB below both co-polarized channels."""
    water: bool
    """Water, with its higher cap at nadir."""
    soil_rms_height_m: float | None
    """Roughness with which soil moisture is taken into account [m]; None if it does not matter."""
    reference_moisture: float
    """Soil moisture the curve holds for [m^3/m^3]."""
    status: Statuses
    """What the values at each node frequency rest on at HH, HV, VV: the weakest status of the rows used there."""
    notes: tuple[str, ...]
    """Source and assumptions, without the category's name."""
    kin: str = ""
    """Class of ground whose covers share part of what is not known of their means; "" for none."""
    soil_share: float = 0.0
    """Part of it that is bare soil, in a season that leaves it bare."""
    as_given: bool = False
    """A user's own numbers, which `limit_db` leaves alone."""
    mean_sd_db: FloatArray | None = None
    """(n_frequency, 3): standard deviation of the mean that the user states [dB]; nan or None where it follows from the
    status."""


# Most at HH, HV, VV over land, and over water.
_CAPS_DB = np.array([[[cap], [_CROSS_CAP_DB], [cap]] for cap in (_LAND_CAP_DB, _WATER_CAP_DB)])
_GRAZING_FALL_DB = linear_to_db(
    np.maximum(np.cos(np.deg2rad(THETA_DEG[_GRAZING_DEG:])) / np.cos(np.deg2rad(_GRAZING_DEG)), 1e-30)
)

_STEEP_SHARE = co_apart(THETA_DEG[: _STEEP_DEG + 1], _STEEP_DEG)


def limit_db(value_db: FloatArray, *, surface: bool, water: bool) -> FloatArray:
    """Backscatter (..., 3, 91) [dB] at HH, HV, VV against `THETA_DEG`, with both ends of the angles settled.

    No ground that is the same from all sides tells HH from VV at nadir: they keep their mean from 20 degrees down, and
    their difference falls with the square of the sine. It is capped near nadir (+20 dB water, +12 dB land, HV -3 dB),
    continued from 75 degrees on as constant gamma, HV of a surface at least 3 dB below HH and VV, and never below -60
    dB. A nan channel stays nan. ``surface`` and ``water``: see `Curve`.
    """
    value = np.array(value_db)
    co = value[..., [0, 2], : _STEEP_DEG + 1]
    middle = np.broadcast_to(co.mean(axis=-2, keepdims=True), co.shape)
    alike = middle + (co - middle)[..., -1:] * _STEEP_SHARE
    value[..., [0, 2], : _STEEP_DEG + 1] = np.where(np.isnan(alike), co, alike)
    value = np.minimum(value, _CAPS_DB[int(water)])
    value[..., _GRAZING_DEG:] = value[..., _GRAZING_DEG, np.newaxis] + _GRAZING_FALL_DB
    if surface:
        value[..., 1, :] = np.minimum(
            value[..., 1, :], np.fmin(value[..., 0, :], value[..., 2, :]) - _CROSS_BELOW_CO_DB
        )
    return np.asarray(np.maximum(value, FLOOR_DB))


def continued_db(value_db: FloatArray, last_deg: float) -> FloatArray:
    """Curve (91,) [dB] with constant gamma beyond 75 deg and the last angle that is known, and a floor there."""
    held = max(math.ceil(last_deg), _GRAZING_DEG)
    fall = _GRAZING_FALL_DB[held - _GRAZING_DEG :] - _GRAZING_FALL_DB[held - _GRAZING_DEG]
    beyond = np.minimum(value_db[held], np.maximum(value_db[held] + fall, FLOOR_DB))
    return np.concatenate([value_db[:held], beyond])


def moisture_change_db(frequency_ghz: float, rms_height_m: float, moisture: float, reference: float) -> FloatArray:
    """Change of bare-soil backscatter from ``reference`` to ``moisture``: float64 array (3, 91) [dB].

    Half of what Oh 2004 says of prepared fields and half of what Baghdadi et al. 2016 say of farmed ones, which differ
    by a factor of two at most. Moisture, roughness and angle are held at the edges of each one's range (0.04 to 0.291,
    ks 0.13 to 6.98, 10 to 70 degrees, and 0.04 to 0.45, 18 to 57 degrees).
    """
    ks = float(np.clip(wavenumber_rad_m(frequency_ghz) * rms_height_m, *_OH04_KS))
    theta = np.deg2rad(np.clip(THETA_DEG, *_OH04_THETA_DEG))
    wet, dry = (
        np.stack(backscatter_oh04(float(np.clip(mv, *_OH04_MOISTURE)), ks, theta)) for mv in (moisture, reference)
    )
    by_moisture, _ = soil_response_baghdadi16(np.deg2rad(np.clip(THETA_DEG, *_BAGHDADI16_THETA_DEG)))
    more = float(np.clip(moisture, *MOISTURE_FELT) - np.clip(reference, *MOISTURE_FELT))
    return 0.5 * (linear_to_db(wet / dry) + more * by_moisture)


@dataclass(frozen=True, slots=True)
class _Parameters:
    """The rows of model_parameters.csv that belong to one category."""

    rows: tuple[Row, ...]

    def get(self, name: str, frequency_ghz: float | None = None, polarization: str = "") -> float:
        for row in self.rows:
            if row.text("parameter") == name and holds(row, frequency_ghz, polarization):
                return float(row.text("value"))
        raise KeyError(name)  # a gap in the shipped file, not a user's error

    def note(self) -> str:
        told: dict[str, list[str]] = {}
        for row in self.rows:
            value, unit = row.text("value").replace("-", "\u2212"), row.text("unit")
            name = row.text("parameter").removesuffix(f"_{unit.lower()}").replace("_", " ")
            where = f" at {row.text('frequency_ghz')} GHz" if row.text("frequency_ghz") else ""
            text = f"{name} {value}{'' if unit == '1' else f' {unit}'}{where} {row.text('polarization')}".rstrip()
            text = re.sub("^hh below vv limit (.*) HH$", r"HH below VV by at most \1", text)
            told.setdefault(row.text("status"), []).append(text)
        return "; ".join(f"{', '.join(texts)} ({status})" for status, texts in told.items())


def shipped_curves() -> dict[tuple[str, str], Curve]:
    """Curves of the shipped categories by (category, season)."""
    parameters, regressions, levels = (
        shipped_rows(f"{name}.csv") for name in ("model_parameters", "ulaby_dobson", "levels")
    )
    by_model = {
        "oh04": _soil_curve, "oh92": _ground_curve, "layer": _forest_curve, "water": _water_curve,
        "constant_gamma": _gamma_curve,
    }  # fmt: skip
    categories = shipped_rows("categories.csv")
    lifts = Lifts.of(levels, regressions, {r.text("category"): r.text("base") for r in categories})
    curves: dict[tuple[str, str], Curve] = {}
    for row in categories:
        category = row.text("category")
        own = _Parameters(tuple(p for p in parameters if p.text("category") == category))
        if row.text("model") == "ulaby_dobson":
            classes = [r for r in regressions if r.text("class") == row.text("base")]
            curve = _regression_curve(row, classes, [r for r in levels if r.text("category") == category], lifts)
        elif row.text("model") == "mix":
            curve = _mixed_curve(row, curves)
        else:
            curve = by_model[row.text("model")](row, own)
        curves[category, curve.season] = curve
    return curves


def weakest(statuses: Iterable[str]) -> str:
    """The status of what rests on several rows."""
    return max(statuses, key=STATUSES.index)


def _statuses(rows: Sequence[Row], frequency_ghz: Sequence[float] | FloatArray) -> Statuses:
    """Weakest status of the rows of each node and channel."""
    return tuple(
        tuple(weakest(r.text("status") for r in rows if holds(r, float(f), p)) for p in POLARIZATIONS)
        for f in frequency_ghz
    )


def _curve(
    row: Row,
    frequency_ghz: Sequence[float] | FloatArray,
    value_db: FloatArray,
    *,
    surface: bool = False,
    wind_m_s: Sequence[float] = (0.0,),
    soil: _Parameters | None = None,
    notes: Sequence[str] = (),
    rows: Sequence[Row] = (),
    status: Statuses | None = None,
) -> Curve:
    """Curve of a row of categories.csv with its limits applied."""
    water = row.text("model") == "water"
    value = np.asarray(value_db).reshape(len(wind_m_s), len(frequency_ghz), 3, THETA_DEG.size)
    return Curve(
        category=row.text("category"),
        season=row.text("season"),
        frequency_ghz=np.asarray(frequency_ghz, dtype=np.float64),
        wind_m_s=np.asarray(wind_m_s, dtype=np.float64),
        value_db=limit_db(value, surface=surface, water=water),
        surface=surface,
        water=water,
        soil_rms_height_m=soil.get("rms_height_m") if soil else None,
        reference_moisture=soil.get("reference_moisture") if soil else 0.2,
        status=status or _statuses([row, *rows], frequency_ghz),
        notes=(f"{row.text('note')} ({row.text('status')}: {row.text('source')})", *notes),
        kin=row.text("base") if row.text("model") == "ulaby_dobson" else "",
    )


def _regression_curve(row: Row, classes: list[Row], levels: list[Row], lifts: Lifts) -> Curve:
    """Ulaby and Dobson's class regression, moved at each node to the level that the category is expected to have.

    HH is moved as VV, and by what sources of both say of their difference. X and Ku bands go with the last node.
    """
    category = row.text("category")
    nodes = sorted({float(r.text("frequency_ghz")) for r in classes})
    value = np.full((len(nodes), 3, THETA_DEG.size), np.nan)
    move = np.full((len(nodes), 3), np.nan)
    status = [[""] * 3 for _ in nodes]
    for r in classes:
        frequency, channel = float(r.text("frequency_ghz")), r.text("polarization")
        n, p = nodes.index(frequency), POLARIZATIONS.index(channel)
        value[n, p] = backscatter_ulaby89_db(regression_of(r), MODEL_THETA)
        own = [x for x in levels if holds(x, frequency, channel)]
        status[n][p] = weakest([row.text("status"), r.text("status"), *(x.text("status") for x in own)])
        if own:
            move[n, p] = lifts.expected(category, frequency, channel)
    for frequency, like, of in zip(nodes, status, move, strict=True):
        hh, vv = (lifts.sources(category, frequency, channel) for channel in ("HH", "VV"))
        if vv and hh != vv:
            of[0] = of[2] + lifts.expected(category, frequency, HH_OVER_VV)
            if not hh:
                like[0] = weakest(["computed", like[2]])
    _fill_gaps(nodes, move, status)
    moved = np.pad(value + move[:, :, None], ((0, len(_HIGH_BANDS_GHZ)), (0, 0), (0, 0)), mode="edge")
    kinds = sorted({f"{r.text('status')}: {r.text('source')}" for r in levels})
    drawn = any(r.text("status") == "measured" for r in levels)
    told = f"level{', drawn to that of all covers,' * drawn} with the regression's course over angle"
    notes = [f"{told} ({'; '.join(kinds)})"] if kinds else []
    notes.append("X and Ku bands at the level of C band (assumed: assumed_high_bands)")
    assumed = (("assumed",) * 3,) * len(_HIGH_BANDS_GHZ)
    return _curve(row, [*nodes, *_HIGH_BANDS_GHZ], moved, notes=notes, status=(*(tuple(s) for s in status), *assumed))


def _fill_gaps(nodes: Sequence[float], move: FloatArray, status: list[list[str]]) -> None:
    """Move nodes between two with levels by what lies between, and others without levels not at all; in place."""
    at = np.log(nodes)
    for p in range(3):
        told = np.flatnonzero(~np.isnan(move[:, p]))
        for n in np.flatnonzero(np.isnan(move[:, p])):
            move[n, p] = 0.0
            if told.size and told[0] < n < told[-1]:
                move[n, p] = np.interp(at[n], at[told], move[told, p])
                status[n][p] = weakest(["computed", *(status[k][p] for k in told)])


def _soil_curve(row: Row, own: _Parameters) -> Curve:
    """Bare soil by Oh 2004, held beyond the last angle of its range."""
    theta = np.deg2rad(np.minimum(THETA_DEG, _OH04_THETA_DEG[1]))
    mv = own.get("reference_moisture")
    value = [_db(backscatter_oh04(mv, _ks(frequency, own), theta)) for frequency in _MODEL_NODES_GHZ]
    return _curve(row, _MODEL_NODES_GHZ, np.stack(value), surface=True, soil=own, notes=(own.note(),), status=_COMPUTED)


def _ground_curve(row: Row, own: _Parameters) -> Curve:
    """Rough ground by Oh 1992."""
    permittivity = complex(own.get("permittivity_real"), own.get("permittivity_imaginary"))
    least = own.get("least_ks")
    value = [_db(backscatter_oh92(permittivity, max(_ks(f, own), least), MODEL_THETA)) for f in _MODEL_NODES_GHZ]
    return _curve(row, _MODEL_NODES_GHZ, np.stack(value), surface=True, notes=(own.note(),), rows=own.rows)


def _mixed_curve(row: Row, curves: Mapping[tuple[str, str], Curve]) -> Curve:
    """Several covers in one cell, in power."""
    parts = [(curves[name, row.text("season")], share) for name, share in shares_of(row.text("base")).items()]
    nodes = parts[0][0].frequency_ghz
    value = linear_to_db(sum(share * db_to_linear(at_nodes(curve, nodes)) for curve, share in parts))
    return _curve(row, nodes, np.asarray(value))


def shares_of(mix: str) -> dict[str, float]:
    """Shares of area of the covers in one cell, written as "name share name share ..."."""
    words = mix.split()
    return dict(zip(words[::2], map(float, words[1::2]), strict=True))


def at_nodes(curve: Curve, frequency_ghz: FloatArray) -> FloatArray:
    """Values (n, 3, 91) of a curve without wind at some frequencies, linear in dB over log frequency, held beyond."""
    position = np.log(frequency_ghz)
    nodes = np.log(curve.frequency_ghz)
    upper = np.clip(np.searchsorted(nodes, position), 1, len(nodes) - 1)
    share = np.clip((position - nodes[upper - 1]) / (nodes[upper] - nodes[upper - 1]), 0.0, 1.0)[:, None, None]
    return np.asarray((1.0 - share) * curve.value_db[0][upper - 1] + share * curve.value_db[0][upper])


def _forest_curve(row: Row, own: _Parameters) -> Curve:
    """Layer of scatterers over soil; HV from an assumed ratio to HH."""
    moisture = own.get("soil_moisture")
    value = []
    for frequency in _MODEL_NODES_GHZ:
        permittivity = complex(permittivity_soil(frequency, moisture))
        reflectivity = reflectivity_fresnel(permittivity, MODEL_THETA)
        ground = backscatter_oh04(moisture, _ks(frequency, own), MODEL_THETA)
        layer = own.get("albedo", frequency), own.get("optical_depth", frequency)
        hh = backscatter_layer_ulaby14(ground.hh, reflectivity.h, *layer, MODEL_THETA)
        vv = backscatter_layer_ulaby14(ground.vv, reflectivity.v, *layer, MODEL_THETA)
        hv = hh * db_to_linear(own.get("cross_ratio_db", frequency, "HV"))
        value.append(_db(Backscatter(hh, hv, vv)))
    return _curve(row, _MODEL_NODES_GHZ, np.stack(value), notes=(own.note(),), rows=own.rows)


def _water_curve(row: Row, own: _Parameters) -> Curve:
    """Composite water surface by wind, HV from the C-band function."""
    data = numbers_of("water_composite_sigma0.csv", ("frequency_ghz", "wind_m_s", "theta_deg", "hh_db", "vv_db"))
    frequencies, winds = np.unique(data[:, 0]), np.unique(data[:, 1])
    value = np.full((winds.size, frequencies.size, 3, THETA_DEG.size), np.nan)
    for w, wind in enumerate(winds):
        cross = _water_cross_db(float(wind))
        for f, frequency in enumerate(frequencies):
            block = data[(data[:, 0] == frequency) & (data[:, 1] == wind)]
            vv = _resampled(block[:, 2], block[:, 4])
            hh = np.maximum(_resampled(block[:, 2], block[:, 3]), vv - own.get("hh_below_vv_limit_db", None, "HH"))
            value[w, f] = np.stack([hh, cross, vv])
    notes = (own.note(), "HV of C band used at every frequency (assumed)", "HV held 3 dB below HH and VV")
    return _curve(row, frequencies, value, surface=True, wind_m_s=list(winds), notes=notes, rows=own.rows)


def _resampled(theta_deg: FloatArray, value_db: FloatArray) -> FloatArray:
    """Values on the 1-degree grid; the last slope goes on up to grazing, where constant gamma takes over."""
    value = np.interp(THETA_DEG, theta_deg, value_db)
    slope = (value_db[-1] - value_db[-2]) / (theta_deg[-1] - theta_deg[-2])
    beyond = theta_deg[-1] < THETA_DEG
    value[beyond] = value_db[-1] + slope * (THETA_DEG[beyond] - theta_deg[-1])
    return value


def _water_cross_db(wind_m_s: float) -> FloatArray:
    """HV of water [dB] at one wind: straight lines in log wind, and in angle with the end slopes going on."""
    data = numbers_of("water_cross_sigma0.csv", ("wind_m_s", "theta_deg", "hv_db"))
    winds, angles = np.unique(data[:, 0]), np.unique(data[:, 1])
    grid = data[np.lexsort((data[:, 1], data[:, 0])), 2].reshape(winds.size, angles.size)
    lower = int(np.clip(np.searchsorted(winds, wind_m_s, side="right") - 1, 0, winds.size - 2))
    share = np.log(wind_m_s / winds[lower]) / np.log(winds[lower + 1] / winds[lower])
    at_wind = grid[lower] + share * (grid[lower + 1] - grid[lower])
    slope, level = np.polyfit(angles, at_wind, 1)  # the function is a straight line in angle to 0.01 dB
    return np.asarray(level + slope * THETA_DEG)


def _gamma_curve(row: Row, own: _Parameters) -> Curve:
    """Constant gamma: sigma0 = gamma cos theta."""
    gamma = np.array([[[own.get("gamma_db", f, channel)] for channel in POLARIZATIONS] for f in _MODEL_NODES_GHZ])
    return _curve(row, _MODEL_NODES_GHZ, gamma + linear_to_db(np.cos(MODEL_THETA)), notes=(own.note(),), rows=own.rows)


def _ks(frequency_ghz: float, own: _Parameters) -> float:
    return wavenumber_rad_m(frequency_ghz) * own.get("rms_height_m")


def _db(backscatter: Backscatter) -> FloatArray:
    """Decibels (3, 91) of a model's result, with values under the floor lifted to it."""
    return np.maximum(linear_to_db(np.stack(backscatter)), FLOOR_DB)
