"""What each effect amounts to in a scene, against the radiometric resolution: that decides what may be left out."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from seqrsm.arrays import AnyArray
from seqrsm.scattering.atmosphere import Atmosphere
from seqrsm.scattering.emissivity import EmissivityLookup
from seqrsm.sensor.radiometer import RadiometerConfiguration
from seqrsm.simulate.radiometer.frame import RadiometerFrame


def planck_offset_used_k(radiometer: RadiometerConfiguration) -> float:
    """The offset h f / k [K] if radiation is to follow Planck's law, else 0, by the configuration's `radiation`."""
    offset = radiometer.planck_offset_k
    if radiometer.radiation == "auto":
        return offset if 0.5 * offset > float(radiometer.nedt_k(300.0)) else 0.0
    return offset if radiometer.radiation == "planck" else 0.0


def effects_k(
    radiometer: RadiometerConfiguration,
    lookups: Sequence[EmissivityLookup],
    air: Atmosphere,
    frame: RadiometerFrame,
    ground_k: AnyArray,
) -> dict[str, float]:
    """Size of each effect in this scene [K]: what decides, against ``nedt``, whether it may be left out.

    Parameters
    ----------
    radiometer : RadiometerConfiguration
    lookups : sequence of EmissivityLookup
        One for each channel.
    air : Atmosphere
    frame : RadiometerFrame
    ground_k : float array (n, m)
        Physical temperature [K].

    Returns
    -------
    dict
        By name: the radiometric resolution, then the effects.
    """
    edge = math.atan(float(np.abs(frame.away_m).max()) / frame.height_m)
    warm = float(ground_k.mean())
    present = np.unique(frame.cover)
    e = np.stack([look.emissivity[present[present < len(look.categories)]] for look in lookups])
    e = e[..., : max(math.ceil(math.degrees(edge)), 1) + 1]
    least = float(e.min()) if e.size else 1.0
    up, through = float(air.upwelling_k(edge, frame.height_m)), float(air.transmission(edge, frame.height_m))
    seen = least * warm
    # A third of the rows suffices for a root mean square that only has to decide.
    z = frame.elevation_m[::3]
    tilt = float(np.sqrt(np.mean(np.square(np.diff(z, axis=1) / frame.cell_m)))) if z.shape[1] > 1 else 0.0
    steepest = float(np.abs(np.diff(e, axis=-1)).max()) if e.size else 0.0
    return {
        "nedt": float(radiometer.nedt_k(warm)),
        "air below the antenna": abs(up + (through - 1.0) * seen),
        "reflected sky": (1.0 - least) * float(air.sky_k(edge)),
        "cosmic background": (1.0 - least) * air.space_k,
        "Rayleigh-Jeans against Planck": 0.5 * radiometer.planck_offset_k,
        "slopes of the ground": math.degrees(tilt) * steepest * warm,
        "ground temperature": float(ground_k.std()),
    }


def _digits(value: float) -> str:
    """Two significant digits, never with a power of ten."""
    return f"{float(f'{value:.2g}'):.10g}"


def effect_notes(sizes_k: Mapping[str, float], planck_offset_k: float) -> tuple[str, ...]:
    """The effects in words; the engine computes all of them whatever their size."""
    nedt = sizes_k["nedt"]
    others = {name: size for name, size in sizes_k.items() if name != "nedt"}
    above = [f"{name} {_digits(size)} K" for name, size in others.items() if size > nedt]
    below = [f"{name} {_digits(size)} K" for name, size in others.items() if size <= nedt]
    law = "Planck's law" if planck_offset_k > 0.0 else "Rayleigh-Jeans"
    notes = [f"radiation by {law}; they differ by {sizes_k['Rayleigh-Jeans against Planck']:.2g} K in power"]
    if above:
        notes.append(f"above the radiometric resolution of {nedt:.2g} K: {', '.join(above)}")
    if below:
        notes.append(f"below it, so that they might be left out here: {', '.join(below)}")
    return tuple(notes)
