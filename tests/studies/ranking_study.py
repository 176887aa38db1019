"""What it costs to leave covers out of the ranking after a few worlds: are those that move the score most still found?

    python tests/studies/ranking_study.py [--worlds 96]

Every cover of three examples is drawn anew in many worlds. Then sets of 16 of these worlds are drawn, and ranked as
`seqrsm.campaign.grounds.Grounds.rank` does, with all covers in all worlds beside it.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from seqrsm.analysis.ground import COVERS, FEW_WORLDS, N_WORLDS, OCCASIONS, still_ranked
from seqrsm.arrays import FloatArray
from seqrsm.campaign.grounds import scores_of
from seqrsm.campaign.rests_on import mean_sds
from seqrsm.campaign.simulation import bundle_tasks
from seqrsm.spec.read import load_spec

ROOT = Path(__file__).parents[2]
SETS = 4000
AT: dict[str, list[dict[str, float | str]]] = {
    "langegracht-radar": [
        {"frequency": 1.25, "polarization": "HH+HV+VV+phase", "resolution": 13.6, "depression_angle": 30.0},
        {"frequency": 5.0, "polarization": "HH+HV", "resolution": 30.0, "depression_angle": 45.0},
    ],
    "limburg-radar": [{"frequency": 1.25, "polarization": "HH+HV+VV+phase", "resolution": 15.0}],
    "wake-radiometer": [{"frequency": 16.4, "polarization": "H+V", "resolution": 67.0, "integration_time": 5.47}],
}


def moved(name: str, settings: dict[str, float | str], worlds: int) -> tuple[list[str], FloatArray]:
    """Covers of an example, and what each does to the score in each world, (worlds, covers)."""
    spec = load_spec(ROOT / "campaigns" / name)
    covers = list(mean_sds(spec, settings)[0])
    tasks = bundle_tasks(spec, settings, 0, range(worlds))[::OCCASIONS]
    asked = [replace(task, elsewhere=own) for task in tasks for own in ((), *((cover,) for cover in covers))]
    scores = scores_of(asked, spec.applications[0].name).reshape(worlds, -1)
    return covers, scores[:, 1:] - scores[:, :1]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", type=int, default=96)
    worlds = parser.parse_args().worlds
    print("| example | first three | simulations | of | same three | same first | first left out |")
    print("|---|---|---|---|---|---|---|")
    for name, places in AT.items():
        for settings in places:
            covers, steps = moved(name, settings, worlds)
            best, rng = np.argsort(-np.square(steps).mean(axis=0)), np.random.default_rng(1)
            rows = []
            for _ in range(SETS):
                own = steps[rng.choice(worlds, N_WORLDS, replace=False)]
                order = np.argsort(-np.square(own).mean(axis=0))
                kept = np.isin(np.arange(len(covers)), still_ranked(own[:FEW_WORLDS].T))
                used = FEW_WORLDS * len(covers) + (N_WORLDS - FEW_WORLDS) * int(kept.sum())
                rows.append((used, kept[order[:COVERS]].all(), kept[order[0]], not kept[best[0]]))
            used, three, first, lost = np.mean(np.array(rows, dtype=np.float64), axis=0)
            shares = " | ".join(f"{100.0 * share:.1f} %" for share in (three, first, lost))
            first_three = ", ".join(covers[k] for k in best[:COVERS])
            print(f"| {name} | {first_three} | {used:.0f} | {N_WORLDS * len(covers)} | {shares} |")


if __name__ == "__main__":
    main()
