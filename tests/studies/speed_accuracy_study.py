"""What whole campaigns cost: in full, with a tolerance, and by the code as it was.

    python tests/studies/speed_accuracy_study.py --before CHECKOUT

Each site's campaign is run by ``seqrsm run`` in a process of its own, by one way after the other, in turns. CHECKOUT is
a work tree of an earlier commit, to compare with: 0a1c417 is the last that had the fidelity planner. Seconds are CPU
time of the process and its children, one thread, the least of the rounds. Every campaign is kept as soon as it is done,
in the temporary folder; the page ``reports/speed-accuracy/README.md`` is written from what there is.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import shutil
import subprocess
import sys
import zlib
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory, gettempdir
from typing import Any

from seqrsm.campaign.simulation import SimulationTask
from seqrsm.design.factors import ContinuousFactor
from seqrsm.design.region import Region
from seqrsm.scene.file import load_scene, save_scene
from seqrsm.scene.synthetic import synthetic_scene

ROOT = Path(__file__).resolve().parents[2]
OUT = ROOT / "reports" / "speed-accuracy"
KEPT = Path(gettempdir()) / f"seqrsm-study-{os.getuid()}-whole-campaigns.json"
EXAMPLES = ("langegracht-radar", "limburg-radar", "wake-radiometer", "crops-and-moisture")
ROUNDS, RUNS, TOLERANCE = 2, 60, 0.5
CROPS = ("Wheat", "Corn", "Oats", "Forage", "Trees", "Grass")
LAND = ("Water", "Trees", "Grass", "Bareground")
RADAR = {"polarization": "HH+HV", "bandwidth": 50.0, "peak_power": 30.0, "altitude_m": 8000.0, "depression_angle": 45.0}
RADIOMETER = {
    "polarization": "H+V",
    "bandwidth": 100.0,
    "noise_temperature": 500.0,
    "scan_period": 2.5,
    "altitude_m": 6000.0,
    "integration_time": 8.0,
}


@dataclass(frozen=True)
class Site:
    """A drawn scene, an engine, and what is varied."""

    name: str
    engine: str
    factors: tuple[tuple[str, float, float], ...]
    fixed: dict[str, float | str]
    synthetic: dict[str, Any] = field(default_factory=dict)

    def scene_path(self) -> str:
        """The scene's file, made at the first use."""
        made = zlib.crc32(repr(sorted(self.synthetic.items())).encode())
        path = Path(gettempdir()) / f"seqrsm-study-{os.getuid()}-{self.name.replace(' ', '-')}-{made:08x}.npz"
        if not path.exists():
            draft = path.with_suffix(".draft.npz")
            given = dict(self.synthetic)
            save_scene(synthetic_scene(**given), draft)
            draft.replace(path)
        return str(path)


def synthetic(size: int, cell: float, covers: tuple[str, ...], relief: float, field_m: float) -> dict[str, Any]:
    return {
        "rows": size, "cols": size, "cell_m": cell, "categories": covers, "field_m": field_m, "relief_m": relief,
        "exponent": 3.6, "seed": 7,
    }  # fmt: skip


RADAR_FACTORS = (("frequency", 1.25, 9.6), ("resolution", 8.0, 60.0))
PASSIVE = (("frequency", 6.0, 36.0), ("resolution", 150.0, 400.0))
FINE = {**RADAR, "altitude_m": 6000.0}
SITES = (
    Site("flat fields", "psm", RADAR_FACTORS, RADAR, synthetic(1800, 5.0, CROPS, 3.0, 200.0)),
    Site("rolling fields", "psm", RADAR_FACTORS, RADAR, synthetic(1800, 5.0, CROPS, 150.0, 200.0)),
    Site("flat land", "prm", PASSIVE, RADIOMETER, synthetic(1800, 15.0, LAND, 3.0, 600.0)),
    Site("rolling land", "prm", PASSIVE, RADIOMETER, synthetic(1800, 15.0, LAND, 150.0, 600.0)),
    Site("lidar fields", "psm", RADAR_FACTORS, FINE, synthetic(4000, 1.0, CROPS, 40.0, 100.0)),
)


def region_of(site: Site) -> Region:
    return Region(tuple(ContinuousFactor(name, low, high, scale="log") for name, low, high in site.factors))


def task(site: Site, settings: dict[str, Any], seed: int, run: int) -> SimulationTask:
    return SimulationTask(
        site.engine, run, seed, settings, site.fixed, site.scene_path(), "", (("a", "percent_correct"),)
    )


def specification(site: Site) -> str:
    factors = "".join(
        f'[[factor]]\nname = "{name}"\nlow = {low}\nhigh = {high}\nscale = "log"\n' for name, low, high in site.factors
    )
    fixed = "".join(f"{name} = {json.dumps(value)}\n" for name, value in site.fixed.items())
    return (
        f'[campaign]\nname = "study"\nseed = 7\n{factors}[[application]]\nname = "a"\nutility = "percent_correct"\n'
        f'[simulator]\nengine = "{site.engine}"\nscene = "scene.npz"\n[simulator.fixed]\n{fixed}'
        f'[stop]\ninterval = "confidence"\nhalf_width = 0.01\nmax_runs = {RUNS}\n'
    )


def prepared(folder: Path, name: str, more: str) -> None:
    """A campaign's folder; ``more``: a line of its table [simulator]."""
    if name in EXAMPLES:
        shutil.copytree(ROOT / "campaigns" / name, folder)
        text = (folder / "campaign.toml").read_text(encoding="utf-8")
    else:
        folder.mkdir()
        site = next(site for site in SITES if site.name == name)
        shutil.copy(site.scene_path(), folder / "scene.npz")
        text = specification(site)
    (folder / "campaign.toml").write_text(text.replace("[simulator]\n", f"[simulator]\n{more}\n"), encoding="utf-8")


def carried_out(name: str, code: Path, more: str) -> dict[str, Any]:
    """CPU seconds of a whole campaign, runs, and the median time of one [s]."""
    with TemporaryDirectory() as parent:
        folder = Path(parent) / "campaign"
        prepared(folder, name, more)
        env = {**os.environ, "PYTHONPATH": str(code), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        command = [sys.executable, "-m", "seqrsm", "run", str(folder), "--json"]
        done = subprocess.run(command, env=env, capture_output=True, text=True, cwd=parent, check=False)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        if done.returncode not in (0, 3):
            raise SystemExit(f"{name}: {done.stderr}")
        seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        export = [sys.executable, "-m", "seqrsm", "export", str(folder), str(folder / "all.json")]
        subprocess.run(export, env=env, check=True, capture_output=True, cwd=parent)
        runs = json.loads((folder / "all.json").read_text(encoding="utf-8"))["runs"]
        found = json.loads(done.stdout)
    each = sorted(
        run["scores"][0]["metadata"]["fidelity"]["seconds"]
        for run in runs
        if run["state"] == "scored" and run["scores"]
    )
    best = found["applications"][0]["optimum"] if "applications" in found else {}
    return {"seconds": seconds, "runs": len(each), "run_s": each[len(each) // 2], "optimum": best}


def measure(before: Path | None) -> dict[str, Any]:
    """Every site by every way, in turns."""
    kept: dict[str, Any] = json.loads(KEPT.read_text()) if KEPT.exists() else {}
    ways = {"in full": (ROOT, ""), f"tolerance {TOLERANCE}": (ROOT, f"tolerance = {TOLERANCE}")}
    if before is not None:
        ways |= {"before, in full": (before, 'fidelity = "F4"'), "before, planner": (before, "")}
    for number in range(ROUNDS):
        for name in (*EXAMPLES, *(site.name for site in SITES)):
            for way, (code, more) in ways.items():
                own = kept.setdefault(name, {}).setdefault(way, [])
                if len(own) <= number:
                    own.append(carried_out(name, code, more))
                    KEPT.write_text(json.dumps(kept))
                    print(f"{name}, {way}: {own[-1]['seconds']:.1f} s", flush=True)
    return kept


HEAD = """# Cost of campaigns on full and coarser scenes

Written by `python tests/studies/speed_accuracy_study.py --before CHECKOUT`: CPU seconds of whole campaigns by
`seqrsm run` (startup, searches, simulations, fits, posterior) on one thread, the lower of two alternating rounds, and
in brackets the median time of one simulated run in milliseconds. *Before* is commit 0a1c417, with the fidelity planner
of some 2,900 lines, which sampled the ground and bounded the error of omitting unneeded detail. *Tolerance* is
`[simulator] tolerance = 0.5`: cells are averaged as far as measured differences of the scores allow. The synthetic
sites run 60 simulations each, over frequency and resolution; the examples end by their own stop rules.

| site | cells | """


def page(kept: dict[str, Any]) -> str:
    ways = list(dict.fromkeys(way for own in kept.values() for way in own))
    lines = [HEAD + " | ".join(ways) + " |", "|---|---|" + "---|" * len(ways)]
    for name, own in kept.items():
        path = ROOT / "campaigns" / name / "scene.npz"
        if name not in EXAMPLES:
            path = Path(next(site for site in SITES if site.name == name).scene_path())
        scene = load_scene(path)
        row = f"| {name} | {scene.shape[0]} x {scene.shape[1]} of {scene.cell_m:g} m |"
        for way in ways:
            best = min(own.get(way, []), key=lambda one: one["seconds"], default=None)
            row += " |" if best is None else f" {best['seconds']:.1f} ({1000.0 * best['run_s']:.0f}) |"
        lines.append(row)
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--before", type=Path)
    kept = measure(parser.parse_args().before)
    text = page(kept)
    notes = OUT / "notes.md"
    OUT.mkdir(exist_ok=True)
    (OUT / "README.md").write_text(text + (notes.read_text(encoding="utf-8") if notes.exists() else ""))
    print(text)


if __name__ == "__main__":
    main()
