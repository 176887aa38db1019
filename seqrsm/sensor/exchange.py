"""One sensor with some properties of another: what a difference between two sensors is owed to, one at a time."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Any, Final, TypeVar

from seqrsm.constants import SPEED_OF_LIGHT_M_S
from seqrsm.sensor.named import GROUND_K, noise_equivalent_db, pulses, with_noise
from seqrsm.sensor.parameters import RADAR, RADIOMETER, Parameter
from seqrsm.sensor.radar import RadarConfiguration
from seqrsm.sensor.radiometer import RadiometerConfiguration

Sensor = RadarConfiguration | RadiometerConfiguration
S = TypeVar("S", RadarConfiguration, RadiometerConfiguration)

PROPERTIES: Final = ("frequency", "channels", "cell and looks", "angle", "noise")
"""What a sensor's image is owed to, each a part of its parameters (`Parameter.part`); dates are the sixth."""


def exchanged(base: S, other: S, properties: Collection[str]) -> S:
    """``base`` with some `PROPERTIES` of ``other``, which is of its kind, all else as it is.

    Of radars the cell on the ground, the looks in it and the noise-equivalent sigma0 at the centre stay what they are
    unless they are exchanged, whatever the angle and the frequency become.

    Raises
    ------
    ConfigurationError
        The mixture contradicts itself.
    """
    of: dict[str, Any] = {name: other if name in properties else base for name in PROPERTIES}
    table = RADAR if isinstance(base, RadarConfiguration) else RADIOMETER
    taken = {row.field: getattr(of[row.part], row.field) for row in table.values() if row.part}
    return _radar(base, of, taken) if isinstance(base, RadarConfiguration) else _radiometer(base, other, of, taken)


def _radar(base: RadarConfiguration, of: Mapping[str, RadarConfiguration], taken: dict[str, Any]) -> RadarConfiguration:
    angle, cell = of["angle"], of["cell and looks"]
    across_m = float(cell.ground_resolution_m(cell.centre_incidence_rad))
    sine = angle.slant_resolution_m / float(angle.ground_resolution_m(angle.centre_incidence_rad))
    taken["bandwidth_mhz"] = SPEED_OF_LIGHT_M_S / (2e6 * across_m * sine)
    # A synthetic aperture's cell is given by the antenna's length, that of a real one by its beam.
    beam_m = of["frequency"].wavelength_m / cell.azimuth_beamwidth_rad
    sample_m = cell.sample_m if cell.aperture == "synthetic" else 0.5 * beam_m * angle.ground_share
    taken |= {"antenna_length_m": 2.0 * sample_m / angle.ground_share, "azimuth_beamwidth_deg": None}
    taken |= pulses(taken["channels"], sample_m, angle.speed_m_s)
    return with_noise(replace(base, **taken), noise_equivalent_db(of["noise"]))


def _radiometer(
    base: RadiometerConfiguration,
    other: RadiometerConfiguration,
    of: Mapping[str, RadiometerConfiguration],
    taken: dict[str, Any],
) -> RadiometerConfiguration:
    angle = of["angle"]
    taken["scan_period_s"] = angle.scan_period_s * taken["resolution_m"] / angle.resolution_m
    # A turn moves the beam by many footprints in the time that another scan may integrate.
    taken["integration_time_ms"] = (angle if angle.conical else base).integration_time_ms
    taken["antenna_limit_m"] = max(base.antenna_limit_m, other.antenna_limit_m)  # what is asked is not what is carried
    if of["noise"] is other:
        # By the receiver's temperature, so that a pixel stays what the integration time makes of it; by the bandwidth
        # where even a receiver without noise would have too much.
        noise_k = float(other.nedt_k(GROUND_K))
        system_k = noise_k * float(1e3 * base.bandwidth_mhz * taken["integration_time_ms"]) ** 0.5
        wider = max(GROUND_K / system_k, 1.0) ** 2
        taken |= {"receiver": "total_power", "gain_fluctuation": 0.0, "bandwidth_mhz": base.bandwidth_mhz * wider}
        taken["noise_temperature_k"] = max(system_k - GROUND_K, 0.0)
    return replace(base, **taken)


def as_parameters(sensor: Sensor) -> dict[str, float | str]:
    """A sensor by the names and values of ``campaign.toml``; what is not set is left out."""
    table: Mapping[str, Parameter] = RADAR if isinstance(sensor, RadarConfiguration) else RADIOMETER
    found: dict[str, float | str] = {}
    for row in table.values():
        value = getattr(sensor, row.field)
        if value is None or value in ((), ""):
            continue
        if row.kind == "channels":
            value = "+".join(value)
        elif row.kind == "pattern":
            value = ", ".join(f"{look!r}:{gain!r}" for look, gain in value)
        found[row.name] = value
    return found
