"""Backscatter of fall and winter, and of ground under snow, from that of spring and summer.

RSL TR 380-1 section 3.2.2.3, seasonal or meteorological targets. What is assumed is told in the notes of every curve.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Final, Literal

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.constants import wavenumber_rad_m
from seqrsm.scattering.curves import FLOOR_DB, MODEL_THETA, THETA_DEG, Curve, at_nodes, limit_db, weakest
from seqrsm.scattering.models import (
    backscatter_oh92,
    backscatter_ulaby89_db,
    permittivity_soil,
    permittivity_wet_snow_hallikainen86,
    reflectivity_fresnel,
)
from seqrsm.scattering.readers import POLARIZATIONS, Row, numbers_of, shipped_rows
from seqrsm.scattering.worlds import BARE_SOIL
from seqrsm.units import db_to_linear, linear_to_db

Snow = Literal["none", "dry", "wet"]

_SOIL_RMS_M, _ICE_RMS_M = 0.01, 0.003
_MOISTURE: Final = 0.2
_FROZEN, _ICE = 4.5 + 0.2j, 3.15 + 0.001j
_WET_SNOW_PERCENT, _WET_SNOW_DENSITY = 3.0, 0.3


def seasonal_curves(curves: Mapping[tuple[str, str], Curve]) -> dict[tuple[str, str], Curve]:
    """Curves of fall and winter by (category, season), made from those of spring and summer."""
    out = {}
    for row in shipped_rows("seasons.csv"):
        category, season = row.text("category"), row.text("season")
        out[category, season] = _season(row, curves[category, "spring_summer"], curves[BARE_SOIL, "spring_summer"])
    return out


def frozen_change_db(frequency_ghz: float) -> FloatArray:
    """Change of bare soil by freezing, float64 (3, 91) [dB]: Oh 1992 at both permittivities and the same roughness."""
    ks = wavenumber_rad_m(frequency_ghz) * _SOIL_RMS_M
    moist = complex(permittivity_soil(frequency_ghz, _MOISTURE))
    theta = np.deg2rad(np.clip(THETA_DEG, 10.0, 70.0))
    frozen, thawed = (np.stack(backscatter_oh92(p, ks, theta)) for p in (_FROZEN, moist))
    return linear_to_db(frozen / thawed)


def _season(row: Row, own: Curve, soil: Curve) -> Curve:
    """Curve of one row of seasons.csv."""
    model = row.text("model")
    note = f"{row.text('season')}: {row.text('note')} ({row.text('status')}: {row.text('source')})"
    frequencies, wind = own.frequency_ghz, own.wind_m_s
    share = 0.0
    if model == "unchanged":
        status, value = own.status, own.value_db
    elif model == "ice":
        wind = np.zeros(1)
        ice = [backscatter_oh92(_ICE, wavenumber_rad_m(float(f)) * _ICE_RMS_M, MODEL_THETA) for f in frequencies]
        value = np.maximum(linear_to_db(np.array(ice)), FLOOR_DB)[np.newaxis]
        status = (("assumed",) * 3,) * len(frequencies)
    else:
        offset = np.array([[float(row.text(f"offset_{p.lower()}_db"))] for p in POLARIZATIONS])
        ground = at_nodes(soil, frequencies)
        if model == "frozen_mix":
            ground = ground + np.stack([frozen_change_db(float(f)) for f in frequencies])
            note += "; frozen soil by Oh 1992 with permittivity 4.5 + 0.2j (assumed)"
        share = float(row.text("soil_share"))
        mixed = share * db_to_linear(ground) + (1.0 - share) * db_to_linear(own.value_db[0] + offset)
        value = linear_to_db(mixed)[np.newaxis]
        status = tuple(tuple(weakest((s, row.text("status"))) for s in node) for node in own.status)
    # Frozen ground does not feel the moisture of the occasion.
    moist = own.soil_rms_height_m if model == "unchanged" else None
    surface = own.surface or model == "ice"
    return replace(
        own,
        season=row.text("season"),
        wind_m_s=wind,
        value_db=limit_db(value, surface=surface, water=own.water and model != "ice"),
        surface=surface,
        water=own.water and model != "ice",
        soil_rms_height_m=moist,
        soil_share=share,
        status=status,
        notes=(*(own.notes if model != "ice" else ()), note),
    )


def snow_volume(frequency_ghz: float, depth_m: float, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Dry snow: backscatter of its volume at HH and VV (2, n), linear, and two-way transmission to the ground (n,).

    At 1.25 to 36 GHz, held at the ends, and incidence angles in air (n,) [rad] below pi/2. Single scattering of a layer
    of a depth >= 0 [m] with refraction at its top; grains of 0.2 mm correlation length, 250 kg/m3 (assumed). The
    volume's HV is negligible below Ka band.
    """
    data = numbers_of("snow_dry.csv", ("frequency_ghz", "scattering_per_m", "absorption_per_m", "permittivity"))
    at = np.log(frequency_ghz)
    ks, ka = (float(np.exp(np.interp(at, np.log(data[:, 0]), np.log(data[:, k])))) for k in (1, 2))
    eps = float(data[0, 3])
    extinction, albedo = ks + ka, ks / (ks + ka)
    cosine = np.cos(theta)
    inside = np.sqrt(1.0 - np.sin(theta) ** 2 / eps)
    two_way = np.exp(-2.0 * extinction * depth_m / inside)
    reflected = reflectivity_fresnel(eps, theta)
    volume = (cosine / inside) ** 2 / eps * 0.75 * albedo * inside * (1.0 - two_way)
    return np.stack([(1.0 - r) ** 2 * volume for r in (reflected.h, reflected.v)]), two_way


def under_snow(
    value_db: FloatArray, frequency_ghz: float, snow: Snow, depth_m: float
) -> tuple[FloatArray, FloatArray, str]:
    """Backscatter (3, 91) [dB] of ground under snow >= 0 [m] deep, the ground's part of its power, what was assumed.

    From the ground's own sigma0 [dB] at HH, HV, VV against `THETA_DEG`. Dry: the ground seen through the snow plus the
    snow's volume. Wet (3 percent water): between the ground and Ulaby and Dobson's wet snow, by the snow's absorption.
    """
    ground = db_to_linear(value_db)
    if snow == "dry":
        volume, two_way = snow_volume(frequency_ghz, depth_m, MODEL_THETA)
        total = ground * two_way + np.stack([volume[0], np.zeros_like(volume[0]), volume[1]])
        note = f"under {100 * depth_m:g} cm of dry snow (computed: snow_iba; grain size assumed)"
        return np.maximum(linear_to_db(total), FLOOR_DB), ground * two_way / total, note
    eps = complex(permittivity_wet_snow_hallikainen86(frequency_ghz, _WET_SNOW_DENSITY, _WET_SNOW_PERCENT))
    absorption = 2.0 * wavenumber_rad_m(frequency_ghz) * np.sqrt(eps).imag
    inside = np.sqrt(1.0 - np.sin(MODEL_THETA) ** 2 / eps.real)
    two_way = np.exp(-2.0 * absorption * depth_m / inside)
    total = ground * two_way + db_to_linear(_wet_snow_db(frequency_ghz)) * (1.0 - two_way)
    note = f"under {100 * depth_m:g} cm of wet snow (public_code: dartstst; absorption with 3 percent water, assumed)"
    return np.maximum(linear_to_db(total), FLOOR_DB), ground * two_way / total, note


def _wet_snow_db(frequency_ghz: float) -> FloatArray:
    """Ulaby and Dobson's wet snow (3, 91) [dB], linear over log frequency between L, S, C, held beyond."""
    rows = shipped_rows("snow_wet.csv")
    nodes = sorted({float(r.text("frequency_ghz")) for r in rows})
    value = np.empty((len(nodes), len(POLARIZATIONS), THETA_DEG.size))
    for r in rows:
        at = nodes.index(float(r.text("frequency_ghz"))), POLARIZATIONS.index(r.text("polarization"))
        value[at] = backscatter_ulaby89_db([float(r.text(f"p{k}")) for k in range(1, 7)], MODEL_THETA)
    position = np.clip(np.log(frequency_ghz), np.log(nodes[0]), np.log(nodes[-1]))
    upper = int(np.clip(np.searchsorted(np.log(nodes), position), 1, len(nodes) - 1))
    share = (position - np.log(nodes[upper - 1])) / np.log(nodes[upper] / nodes[upper - 1])
    return limit_db((1.0 - share) * value[upper - 1] + share * value[upper], surface=False, water=False)
