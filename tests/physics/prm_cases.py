"""Small scenes and made emissivities whose radiation is known in closed form."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
from shorthands import percent_correct, still_radiometer

from seqrsm.scattering.atmosphere import Atmosphere
from seqrsm.scattering.calendar import SHIPPED
from seqrsm.scattering.emissivity import EmissivityLookup
from seqrsm.scene.scene import Scene
from seqrsm.sensor.radiometer import RadiometerConfiguration
from seqrsm.simulate.radiometer.frame import make_radiometer_frame
from seqrsm.simulate.radiometer.occasion import nominal_radiometer_occasion
from seqrsm.simulate.radiometer.prm import Meeting, radiation_map, simulate_radiometer


@dataclass
class Table:
    """Emissivity of each category: a number, or a function of the look angle [deg]; at nadir fields vary if told."""

    level: tuple
    field_sd: float = 0.0

    calendar = SHIPPED

    def lookup(self, categories, frequency_ghz, polarization, *, day=None):  # noqa: ARG002
        theta = np.arange(91.0)
        e = np.array([level(theta) if callable(level) else np.full(91, level) for level in self.level], dtype=float)
        e = e[: len(categories)]
        n = len(e)
        zero, one = np.zeros(n), np.ones(n)
        part = np.minimum(self.field_sd / np.maximum(1.0 - e[:, 0], 1e-9), 1.0)
        return EmissivityLookup(
            tuple(categories), e[:, None], zero.astype(bool), one, one, part, zero, zero, zero, zero,
            ("computed",) * n, ("made",),
        )  # fmt: skip


def footprint_across_m(scan) -> np.ndarray:
    """Length of each footprint of a line in the direction of the sweep, without smear [m]."""
    half = 0.5 * scan.beamwidth_rad
    return scan.height_m * (np.tan(scan.look_rad + half) - np.tan(scan.look_rad - half))


def footprint_along_m(scan) -> np.ndarray:
    """Width of each footprint of a line along the track [m]."""
    return 2.0 * scan.height_m * np.tan(0.5 * scan.beamwidth_rad) / np.cos(scan.look_rad)


def radiometer(**changes) -> RadiometerConfiguration:
    given = {
        "frequency_ghz": 10.0,
        "channels": ("H",),
        "resolution_m": 50.0,
        "integration_time_ms": 10.0,
        "bandwidth_mhz": 1e3,
        "noise_temperature_k": 500.0,
        "scan_period_s": 1.0,
        "altitude_m": 1000.0,
        "speed_m_s": 100.0,
        "atmosphere": "none",
        "temperature": "constant",
        "radiation": "rayleigh_jeans",
        "temperature_date_sd_k": 0.0,
        "temperature_field_sd_k": 0.0,
    }
    return RadiometerConfiguration(**{**given, **changes})


def scene(elevation, cell_m=10.0, cover=None, field=None, categories=None) -> Scene:
    elevation = np.asarray(elevation, dtype=np.float32)
    cover = np.zeros(elevation.shape, dtype=np.uint8) if cover is None else np.asarray(cover, dtype=np.uint8)
    n = int(cover[cover != 255].max()) + 1
    categories = tuple(f"class {k}" for k in range(n)) if categories is None else categories
    field = np.where(cover == 255, n, cover).astype(np.int32) if field is None else np.asarray(field, dtype=np.int32)
    return Scene(
        elevation_m=elevation,
        cover=cover,
        categories=categories,
        field_id=field,
        scored=(cover != 255) & np.isfinite(elevation),
        cell_m=cell_m,
    )


def image(s: Scene, r: RadiometerConfiguration, table: Table, precision="float64", temperature_k=None):
    if temperature_k is not None:
        s = replace(s, temperature_k=np.asarray(temperature_k, dtype=np.float32))
        r = replace(r, temperature="layer")
    return still_radiometer(s, r, table, seed=1, run_id=1, precision=precision)


def mapped(
    s: Scene, r: RadiometerConfiguration, table: Table, air: Atmosphere, ground_k, planck=0.0, dtype="float64", **met
):
    frame = make_radiometer_frame(s, r, dtype)
    lookups = [table.lookup(s.categories, r.frequency_ghz, channel) for channel in r.channels]
    occasion = replace(nominal_radiometer_occasion(r, lookups, s), **met)
    ground = np.broadcast_to(np.asarray(ground_k, dtype=dtype), frame.elevation_m.shape)
    met = Meeting(frame, None, lookups, occasion, air, planck, table, None)
    antenna_k, offset, state = radiation_map(met, r, np.ascontiguousarray(ground))
    return SimpleNamespace(antenna_k=antenna_k, offset=offset, state=state), frame


def isothermal_air(depth_np: float, temperature_k: float, space_k: float) -> Atmosphere:
    """Ten equal layers up to 10 km at one temperature."""
    return Atmosphere(np.full(10, depth_np / 10), np.full(10, temperature_k), np.linspace(0.0, 10.0, 11), space_k, ())


def patchwork(cell_m: float) -> Scene:
    """Fields of ten cells a side and three classes on rough ground."""
    rng = np.random.default_rng(9)
    patch = np.kron(rng.integers(0, 3, (12, 16)), np.ones((10, 10), dtype=int))
    field = np.kron(np.arange(12 * 16).reshape(12, 16), np.ones((10, 10), dtype=int))
    return scene(rng.normal(0.0, 0.3, patch.shape).cumsum(axis=0), cell_m, patch, field)


def small_score(run_id: int) -> float:
    """Percent correct of a small scene in one run; importable by worker processes."""
    s = patchwork(10.0)
    table = Table((0.8, 0.85, 0.9), field_sd=0.02)
    found = simulate_radiometer(s, radiometer(channels=("H", "V")), table, seed=3, run_id=run_id)
    return percent_correct([found], s, seed=3, run_id=run_id).value
