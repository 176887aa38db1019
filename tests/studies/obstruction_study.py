"""What trees and buildings hide from a radar, and what that does to a score.

    OPENBLAS_NUM_THREADS=1 python tests/studies/obstruction_study.py [--worlds 16]

Writes ``reports/validation/obstruction.md``: percent of the scored ground in shadow and percent correct, by height of
the trees, depression angle and resolution, over two shipped scenes; the same worlds and occasions in every column.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from seqrsm.scattering.sigma0 import load_sigma0_table
from seqrsm.scattering.worlds import World
from seqrsm.scene.file import load_scene
from seqrsm.score.cover import score_cover
from seqrsm.score.utilities import Asked
from seqrsm.sensor.radar import RadarConfiguration
from seqrsm.simulate.radar.psm import simulate_radar

ROOT = Path(__file__).parents[2]
TABLE = load_sigma0_table()
HEIGHTS = (0.0, 10.0, 15.0, 20.0)  # of trees [m]; buildings 8 m where trees are not 0
SCENES = {"langegracht-radar": (8.0, 14.0, 30.0), "limburg-radar": (4.2, 8.0, 16.0)}  # resolutions [m]
ANGLES = (30.0, 45.0, 60.0)
FIXED = {"bandwidth_mhz": 80.0, "peak_power_w": 100.0, "altitude_m": 6000.0, "frequency_ghz": 1.25}


def scored(name: str, resolution: float, angle: float, tall: float, worlds: int) -> tuple[float, np.ndarray]:
    """Percent of the scored cells in shadow, and the scores (worlds,)."""
    scene = load_scene(ROOT / "campaigns" / name / "scene.npz")
    radar = RadarConfiguration(
        **FIXED,
        channels=("HH", "HV", "VV"),
        resolution_m=resolution,
        depression_angle_deg=angle,
        tree_height_m=tall,
        building_height_m=8.0 if tall else 0.0,
    )
    found = []
    for world in range(worlds):
        image = simulate_radar(scene, radar, TABLE.in_world(World(1979, world)), seed=1979, run_id=world)
        found.append(score_cover([image], scene, Asked("percent_correct"), seed=1979, run_id=world).value)
    return 100.0 * float(image.shadow[scene.scored].mean()), np.array(found)


def main() -> None:
    """Write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worlds", type=int, default=16)
    worlds = parser.parse_args().worlds
    text = [
        "# What trees and buildings hide",
        "",
        "Written by `python tests/studies/obstruction_study.py`. Radar at 1.25 GHz, HH+HV+VV, 6000 m; elevations are",
        "those of the ground. *Hidden*: percent of the scored ground in shadow. *Score*: percent of cells classified",
        f"correctly, mean over {worlds} worlds; the change against no height is paired by world and occasion, ± its",
        "standard error. Trees hide ground wherever the ray is lower than their tops; they are taken as opaque.",
        "",
    ]
    head = " | ".join(f"trees {tall:g} m: hidden | change" for tall in HEIGHTS[1:])
    for name, resolutions in SCENES.items():
        text += [f"## {name}", "", f"| depression | resolution | bare: hidden | score | {head} |"]
        text.append("|" + "---|" * (4 + 2 * (len(HEIGHTS) - 1)))
        for angle in ANGLES:
            for resolution in resolutions:
                (hidden, bare), *others = (scored(name, resolution, angle, tall, worlds) for tall in HEIGHTS)
                cells = [f"{angle:g} deg", f"{resolution:g} m", f"{hidden:.1f}", f"{bare.mean():.1f}"]
                for dark, own in others:
                    change = own - bare
                    cells += [f"{dark:.1f}", f"{change.mean():+.1f} ± {change.std(ddof=1) / np.sqrt(worlds):.1f}"]
                text.append("| " + " | ".join(cells) + " |")
        text.append("")
    (ROOT / "reports" / "validation" / "obstruction.md").write_text("\n".join(text), encoding="utf-8")


if __name__ == "__main__":
    main()
