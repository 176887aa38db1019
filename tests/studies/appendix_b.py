"""The plates of RSL TR 380-1 Appendix B again, on a real site: radar by Table B.1, radiometer of B.15 to B.17.

    python tests/studies/appendix_b.py

Every picture of the radar is one run of its engine over the Langegracht catchment (terrain and parcels real, crops
drawn), grey tones of eq. (3-18) with one calibration pair for all, so that seasons and bands can be compared. Writes
``reports/appendix-b/plate.png``, ``radiometer.png`` and their captions, and prints the mean backscatter of each.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]
mpl.use("Agg")
from appendix_b_radiometer import write_radiometer  # noqa: E402
from matplotlib import pyplot as plt  # noqa: E402

from seqrsm.scattering.sigma0 import load_sigma0_table  # noqa: E402
from seqrsm.scene.file import load_scene  # noqa: E402
from seqrsm.scene.scene import Scene  # noqa: E402
from seqrsm.sensor.radar import RadarConfiguration  # noqa: E402
from seqrsm.simulate.radar.psm import simulate_radar  # noqa: E402
from seqrsm.simulate.radar.receiver import film_density, greytone, to_levels  # noqa: E402

OUT = ROOT / "reports" / "appendix-b"
RESOLUTIONS_M = (25.0, 50.0, 100.0, 250.0)
MIDDLE_DB, RANGE_DB = -12.0, 20.0


@dataclass(frozen=True)
class Row:
    """One line of the plate."""

    band: str
    frequency_ghz: float
    label: str
    season: str
    snow: str = "none"


ROWS = (
    Row("L", 1.25, "spring/summer", "spring_summer"),
    Row("L", 1.25, "fall", "fall"),
    Row("S", 3.0, "spring/summer", "spring_summer"),
    Row("S", 3.0, "fall", "fall"),
    Row("X", 9.6, "winter, 15 cm of dry snow", "winter", "dry"),
    Row("X", 9.6, "spring/summer", "spring_summer"),
    Row("Ku", 13.6, "spring/summer", "spring_summer"),
)


def picture(scene: Scene, row: Row, resolution_m: float) -> tuple[np.ndarray, float]:
    """Grey tones with north up, and the scene's mean apparent backscatter [dB]."""
    radar = RadarConfiguration(
        frequency_ghz=row.frequency_ghz,
        channels=("HH",),
        resolution_m=resolution_m,
        bandwidth_mhz=15.0,
        peak_power_w=5000.0,
        depression_angle_deg=45.0,
        altitude_m=6000.0,
        looks=20.0,
        season=row.season,
        snow=row.snow,
        snow_depth_cm=15.0,
    )
    image = simulate_radar(scene, radar, load_sigma0_table(), seed=1979, run_id=0)
    sigma0 = image.apparent_sigma0()
    darkest = 0.1 * (MIDDLE_DB - 0.5 * RANGE_DB)
    tones = to_levels(greytone(film_density(sigma0), darkest, 0.0, 8, RANGE_DB))
    return np.rot90(tones[0], -image.quarter_turns), 10.0 * float(np.log10(sigma0.mean()))


def main() -> None:
    scene = load_scene(ROOT / "campaigns" / "langegracht-radar" / "scene.npz")
    height, width = (n * scene.cell_m / 1000.0 for n in scene.shape)
    figure, axes = plt.subplots(len(ROWS), 4, figsize=(13.0, 15.6), constrained_layout=True)
    lines = ["| band | season | " + " | ".join(f"{r:g} m" for r in RESOLUTIONS_M) + " |", "|---|---|" + "---|" * 4]
    for i, row in enumerate(ROWS):
        means = []
        for j, resolution in enumerate(RESOLUTIONS_M):
            tones, mean_db = picture(scene, row, resolution)
            means.append(f"{mean_db:.1f}")
            ax = axes[i, j]
            ax.imshow(tones, cmap="gray", vmin=0, vmax=255, extent=(0, width, 0, height), interpolation="nearest")
            ax.set_title(f"{row.band} band, {row.label}, {resolution:g} m", fontsize=8)
            ax.set_xticks([0, 2, 4] if i == len(ROWS) - 1 else [])
            ax.set_yticks([0, 1, 2, 3] if j == 0 else [])
            ax.tick_params(labelsize=7)
        lines.append(f"| {row.band} | {row.label} | " + " | ".join(means) + " |")
    axes[-1, 0].set_xlabel("east [km]", fontsize=8)
    axes[0, 0].set_ylabel("north [km]", fontsize=8)
    figure.savefig(OUT / "plate.png", dpi=110)
    text = f"""# Appendix B of RSL TR 380-1 again, on a real site

## Radar: figures B.1 to B.14

![plate](plate.png)

Written by `python tests/studies/appendix_b.py`: every simulation of the report's Table B.1, over the Langegracht
catchment in Flanders (terrain and parcels real, crops drawn). HH, flight to the east at 6 km looking south, 45 deg
depression, 20 looks. Grey tones by eq. (3-18): {RANGE_DB:g} dB from black to white, mid-grey at an apparent backscatter
of {MIDDLE_DB:g} dB in all pictures. All pictures are of one occasion's fields and of independent fading.

What is assumed and what is known of the seasons is in `seqrsm/scattering/data/seasons.csv` and `sources.csv`: fall and
winter rest on assumed shares of bare and frozen soil, X and Ku band of most covers on the continuation of L, S and C.
At 9.6 GHz 15 cm of dry snow changes a field by less than 0.3 dB; the difference between summer and winter comes from
frozen ground and dead vegetation.

Mean apparent backscatter of the site [dB]:

{chr(10).join(lines)}

{write_radiometer(scene, OUT)}"""
    (OUT / "appendix-b.md").write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
