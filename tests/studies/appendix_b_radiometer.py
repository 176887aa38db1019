"""Figures B.15 to B.17 of RSL TR 380-1 again: two beamwidths, constant and varying temperature of the ground.

Called by ``python tests/studies/appendix_b.py``.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt
from shorthands import still_radiometer

from seqrsm.scattering.emissivity import load_emissivity_table
from seqrsm.scene.scene import Scene
from seqrsm.sensor.radiometer import RadiometerConfiguration
from seqrsm.simulate.radar.receiver import film_density, greytone, to_levels
from seqrsm.simulate.radiometer.result import RadiometerImage

ALTITUDE_M = 3000.0
SPEED_M_S = 70.0
HOUR = 9.0
BLACK_K, WHITE_K = 240.0, 330.0
FIGURES = (
    ("B.15a", 0.01, "exposure"),
    ("B.15b", 0.0175, "exposure"),
    ("B.16a", 0.0175, "constant"),
    ("B.16b", 0.0175, "exposure"),
    ("B.17a", 0.01, "constant"),
    ("B.17b", 0.0175, "constant"),
)
WORDS = {"exposure": "varying temperature", "constant": "constant temperature"}


def simulated(scene: Scene, beamwidth_rad: float, temperature: str) -> RadiometerImage:
    """Image at 20 GHz, H, for which Table 3 is taken to hold, by a uniform beam, its lines side by side at nadir."""
    height_m = ALTITUDE_M - float(np.nanmean(scene.elevation_m))
    footprint_m = 2.0 * height_m * math.tan(0.5 * beamwidth_rad)
    radiometer = RadiometerConfiguration(
        frequency_ghz=20.0,
        channels=("H",),
        resolution_m=footprint_m,
        integration_time_ms=0.01,
        bandwidth_mhz=100.0,
        noise_temperature_k=500.0,
        scan_period_s=2.0 * footprint_m / SPEED_M_S,
        altitude_m=ALTITUDE_M,
        speed_m_s=SPEED_M_S,
        beam="box",
        temperature=temperature,
        latitude_deg=50.7,
        day_of_year=172.0,
        hour=HOUR,
        temperature_date_sd_k=0.0,
        temperature_field_sd_k=0.0,
    )
    return still_radiometer(scene, radiometer, load_emissivity_table(), seed=1979, run_id=0)


def on_cells(image: RadiometerImage) -> np.ndarray:
    """Brightness of each cell of the scene by its nearest footprint (rows, cols) [K]; nan for none."""
    kelvin = image.mean_k[0].ravel().astype(float)
    return np.where(image.pixel_of_cell >= 0, kelvin[np.maximum(image.pixel_of_cell, 0)], np.nan)


def greytones(brightness_k: np.ndarray) -> np.ndarray:
    """Grey tone of an antenna temperature: eq. (3-50), from black at ``BLACK_K`` to white at ``WHITE_K``."""
    black = float(film_density(np.asarray(BLACK_K), 1.0))
    return greytone(film_density(brightness_k, 1.0), black, 0.0, 8, 10.0 * math.log10(WHITE_K / BLACK_K))


def write_radiometer(scene: Scene, out: Path) -> str:
    """Write ``radiometer.png`` into ``out``; the section of the page that tells of it."""
    made = {(beam, warm): simulated(scene, beam, warm) for _, beam, warm in FIGURES}
    height, width = (n * scene.cell_m / 1000.0 for n in scene.shape)
    figure, axes = plt.subplots(3, 2, figsize=(10.5, 10.4), constrained_layout=True)
    for ax, (name, beam, warm) in zip(axes.flat, FIGURES, strict=True):
        image = made[beam, warm]
        shown = to_levels(greytones(on_cells(image)))
        ax.imshow(shown, cmap="gray", vmin=0, vmax=255, extent=(0, width, 0, height), interpolation="nearest")
        ax.set_title(f"{name}: {beam:g} rad, {WORDS[warm]}", fontsize=9)
        ax.tick_params(labelsize=7)
    axes[2, 0].set_xlabel("east [km]", fontsize=8)
    axes[0, 0].set_ylabel("north [km]", fontsize=8)
    figure.savefig(out / "radiometer.png", dpi=110)
    plt.close(figure)
    rows = [
        "| figure | beamwidth | footprint at nadir | lines x footprints | mean | spread |",
        "|---|---|---|---|---|---|",
    ]
    for name, beam, warm in FIGURES:
        image = made[beam, warm]
        kelvin = image.mean_k[0]
        size = f"{image.radiometer.resolution_m:.1f} m"
        count = f"{image.scan.n_lines} x {len(image.scan.look_rad)}"
        rows.append(
            f"| {name} | {beam:g} rad, {WORDS[warm]} | {size} | {count} | {np.nanmean(kelvin):.1f} K | "
            f"{np.nanstd(kelvin):.1f} K |"
        )
    apart = on_cells(made[0.01, "exposure"]) - on_cells(made[0.01, "constant"])
    low, high = np.nanquantile(apart, [0.01, 0.99])
    degrees = math.radians(0.0175)
    return f"""## Radiometer: figures B.15 to B.17

![radiometer](radiometer.png)

As the report's first-order simulation: Table 3 at its own frequency, uniform beam, no receiver noise, lines side by
side at nadir, over the Langegracht catchment from {ALTITUDE_M:g} m, flight to the east over the middle. Grey tones by
eq. (3-50), {BLACK_K:g} K black and {WHITE_K:g} K white in all pictures. Constant temperature is 300 K; varying
temperature runs from 300 K without sun to 340 K square to it, at {HOUR:g} h solar time of midsummer at 50.7 deg north.
Scene, hour and height are choices: the report names neither for its Watertown site.

**Radians, not degrees.** The captions of the report give the beamwidths as "0.01" and "0.0175", its text as degrees.
0.0175 is one degree in radians (pi / 180 = 0.01745). As degrees, a beam of 0.0175 deg would be {1e3 * degrees:.2f} mrad
wide: {ALTITUDE_M * degrees:.2f} m on the ground from {ALTITUDE_M:g} m, smaller than any cell of the data base, from an
antenna of {1.22 * 0.299792458 / 20.0 / degrees:.0f} m at 20 GHz. As radians the footprints hold some {
        (made[0.01, "constant"].radiometer.resolution_m / scene.cell_m) ** 2:.0f} and {
        (made[0.0175, "constant"].radiometer.resolution_m / scene.cell_m) ** 2:.0f} cells, and the antennas measure {
        1.22 * 0.299792458 / 20.0 / 0.01:.1f} m and {1.22 * 0.299792458 / 20.0 / 0.0175:.1f} m.
So radians are meant, and `beamwidth` here is the half-power beam in radians.

What the pictures show: the wider beam loses the narrow fields and roads; by exposure the ground is warmer everywhere,
by {low:.0f} K to {high:.0f} K (1 % to 99 % of the cells) in antenna temperature, most where it faces
the sun; every cell shows its nearest footprint.

{chr(10).join(rows)}
"""
