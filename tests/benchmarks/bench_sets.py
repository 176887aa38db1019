"""What five dates of two bands cost over one date of one band, images and score: CPU time, alternating.

OPENBLAS_NUM_THREADS=1 python tests/benchmarks/bench_sets.py
"""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

from seqrsm.campaign.simulation import acquisitions_of
from seqrsm.scattering.sigma0 import load_sigma0_table
from seqrsm.scene.file import load_scene
from seqrsm.scene.scene import Scene
from seqrsm.score.cover import score_cover
from seqrsm.score.utilities import Asked
from seqrsm.simulate.radar.psm import simulate_radar

SCENE = Path(__file__).parents[2] / "campaigns" / "langegracht-radar" / "scene.npz"
FIXED = {"bandwidth": 50.0, "peak_power": 100.0, "altitude_m": 6000.0, "depression_angle": 45.0}
ROUNDS = 5


def seconds(scene: Scene, run: int, frequency: str, days: str, resolution: float) -> tuple[float, float]:
    """CPU time of the images of a run, and of their score [s]; draws of another run are no help."""
    table = load_sigma0_table()
    settings = {"frequency": frequency, "polarization": "VV+VH", "days": days, "resolution": resolution}
    start = time.process_time()
    images = [
        simulate_radar(scene, one.sensor, table, seed=1, run_id=run, visit=one.visit)
        for one in acquisitions_of("psm", settings, FIXED, {})
    ]
    made = time.process_time()
    score_cover(images, scene, Asked("percent_correct"), seed=1, run_id=run)
    return made - start, time.process_time() - made


def main() -> None:
    """Print a row for each resolution."""
    scene, season = load_scene(SCENE), "120+145+170+195+220"
    for resolution in (40.0, 20.0, 10.0, 6.0):
        seconds(scene, 0, "C", "150", resolution)
        rounds = [
            (seconds(scene, 2 * k + 1, "C", "150", resolution), seconds(scene, 2 * k + 2, "L+C", season, resolution))
            for k in range(ROUNDS)
        ]
        one, ten = np.median(np.array(rounds), axis=0)
        ratio = ten.sum() / one.sum()
        print(f"{resolution:4.0f} m: one {one[0]:.3f} + {one[1]:.3f} s, ten {ten[0]:.3f} + {ten[1]:.3f} s: {ratio:.1f}")


if __name__ == "__main__":
    main()
