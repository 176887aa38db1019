"""What coarser databases gain, and at what error: single runs, and whole campaigns with a tolerance.

    python tests/studies/speed_accuracy_study.py

``seqrsm tradeoff`` measures the runs. Then each site's campaign is run to its end by ``seqrsm run``, in full and with a
tolerance in turns, each in a process of its own, and what both recommend is simulated on the same fresh occasions, in
full. Seconds are CPU time of the process and its children, one thread, the least of the rounds. Everything is kept in
the temporary folder as soon as it is done; the page is ``reports/speed-accuracy/README.md``.
"""

from __future__ import annotations

import json
import os
import resource
import shutil
import subprocess
import sys
import zlib
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory, gettempdir
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from synthetic import synthetic_scene

from seqrsm.campaign.simulation import carry_out, task_of
from seqrsm.scene.file import load_scene, save_scene
from seqrsm.spec.read import load_spec

ROOT = Path(__file__).resolve().parents[2]
OUT = ROOT / "reports" / "speed-accuracy"
KEPT = Path(gettempdir()) / f"seqrsm-study-{os.getuid()}-speed-accuracy.json"
EXAMPLES = ("langegracht-radar", "limburg-radar", "wake-radiometer", "crops-and-moisture", "langegracht-dates")
ROUNDS, RUNS, FRESH = 2, 60, 30
TOLERANCES = {"crops-and-moisture": 0.005}
"""In score units: kappa has no more than 1; percent have half a point (`TOLERANCE`)."""
TOLERANCE = 0.5
CROPS = ("Wheat", "Corn", "Oats", "Forage", "Trees", "Grass")
LAND = ("Water", "Trees", "Grass", "Bareground")
RADAR: dict[str, float | str] = {
    "polarization": "HH+HV",
    "bandwidth": 50.0,
    "peak_power": 30.0,
    "altitude_m": 8000.0,
    "depression_angle": 45.0,
}
RADIOMETER: dict[str, float | str] = {
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
    synthetic: dict[str, Any]

    def scene_path(self) -> str:
        """The scene's file, made at the first use."""
        made = zlib.crc32(repr(sorted(self.synthetic.items())).encode())
        path = Path(gettempdir()) / f"seqrsm-study-{os.getuid()}-{self.name.replace(' ', '-')}-{made:08x}.npz"
        if not path.exists():
            draft = path.with_suffix(".draft.npz")
            save_scene(synthetic_scene(**self.synthetic), draft)
            draft.replace(path)
        return str(path)


def synthetic(size: int, cell: float, covers: tuple[str, ...], relief: float, field_m: float) -> dict[str, Any]:
    return {
        "rows": size, "cols": size, "cell_m": cell, "categories": covers, "field_m": field_m, "relief_m": relief,
        "seed": 7,
    }  # fmt: skip


RADAR_FACTORS = (("frequency", 1.25, 9.6), ("resolution", 8.0, 60.0))
PASSIVE = (("frequency", 6.0, 36.0), ("resolution", 150.0, 400.0))
FINE: dict[str, float | str] = {**RADAR, "altitude_m": 6000.0}
SITES = (
    Site("flat fields", "psm", RADAR_FACTORS, RADAR, synthetic(1800, 5.0, CROPS, 3.0, 200.0)),
    Site("rolling fields", "psm", RADAR_FACTORS, RADAR, synthetic(1800, 5.0, CROPS, 150.0, 200.0)),
    Site("flat land", "prm", PASSIVE, RADIOMETER, synthetic(1800, 15.0, LAND, 3.0, 600.0)),
    Site("rolling land", "prm", PASSIVE, RADIOMETER, synthetic(1800, 15.0, LAND, 150.0, 600.0)),
    Site("lidar fields", "psm", RADAR_FACTORS, FINE, synthetic(4000, 1.0, CROPS, 40.0, 100.0)),
)


def specification(site: Site) -> str:
    factors = "".join(
        f'[[factor]]\nname = "{name}"\nlow = {low}\nhigh = {high}\nscale = "log"\n' for name, low, high in site.factors
    )
    fixed = "".join(f"{name} = {json.dumps(value)}\n" for name, value in site.fixed.items())
    return (
        f'[campaign]\nname = "study"\nseed = 7\n{factors}'
        '[[application]]\nname = "ground-cover"\nutility = "percent_correct"\n'
        f'[simulator]\nengine = "{site.engine}"\nscene = "scene.npz"\n[simulator.fixed]\n{fixed}'
        f'[stop]\ninterval = "confidence"\nhalf_width = 0.01\nmax_runs = {RUNS}\n'
    )


def prepared(folder: Path, name: str, more: str) -> None:
    """A campaign's folder; ``more``: a line of its table [simulator]."""
    if name in EXAMPLES:
        shutil.copytree(
            ROOT / "campaigns" / name, folder, ignore=shutil.ignore_patterns("campaign.db*", "tradeoff.json")
        )
        text = (folder / "campaign.toml").read_text(encoding="utf-8")
    else:
        folder.mkdir()
        site = next(site for site in SITES if site.name == name)
        shutil.copy(site.scene_path(), folder / "scene.npz")
        text = specification(site)
    (folder / "campaign.toml").write_text(text.replace("[simulator]\n", f"[simulator]\n{more}\n"), encoding="utf-8")


def told(command: str, folder: Path, *options: str) -> tuple[dict[str, Any], float]:
    """What a command prints as JSON, and its CPU seconds."""
    env = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    line = [sys.executable, "-m", "seqrsm", command, str(folder), "--json", *options]
    done = subprocess.run(line, env=env, capture_output=True, text=True, cwd=folder, check=False)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode not in (0, 3):
        raise SystemExit(f"{folder.name}: {done.stderr}")
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return json.loads(done.stdout), seconds


def carried_out(name: str, more: str) -> dict[str, Any]:
    """A whole campaign: CPU seconds, runs, what it recommends, and how that scores on fresh occasions in full."""
    with TemporaryDirectory() as parent:
        folder = Path(parent) / "campaign"
        prepared(folder, name, more)
        found, seconds = told("run", folder)
        best = found["applications"][0]["optimum"]["settings"]
        spec = load_spec(folder)
        scores = [carry_out(task_of(spec, 2**29 + k, best)).scores[0].score for k in range(FRESH)]
    return {"seconds": seconds, "runs": found["applications"][0]["n_runs"], "best": best, "scores": scores}


def tradeoff(name: str) -> dict[str, Any]:
    """What ``seqrsm tradeoff`` says of the site, by application."""
    with TemporaryDirectory() as parent:
        folder = Path(parent) / "campaign"
        prepared(folder, name, "")
        return dict(told("tradeoff", folder)[0]["simulation"]["applications"])


def measure() -> dict[str, Any]:
    """Every site, both ways in turns."""
    kept: dict[str, Any] = json.loads(KEPT.read_text()) if KEPT.exists() else {}
    for name in (*EXAMPLES, *(site.name for site in SITES)):
        own = kept.setdefault(name, {"tradeoff": None, "in full": [], "tolerance": []})
        for number in range(ROUNDS):
            for way in ("in full", "tolerance"):
                if len(own[way]) <= number:
                    tolerance = f"tolerance = {TOLERANCES.get(name, TOLERANCE)}"
                    own[way].append(carried_out(name, tolerance if way == "tolerance" else ""))
                    KEPT.write_text(json.dumps(kept))
                    print(f"{name}, {way}: {own[way][-1]['seconds']:.1f} s", flush=True)
        if own["tradeoff"] is None:
            own["tradeoff"] = tradeoff(name)
            KEPT.write_text(json.dumps(kept))
    return kept


RUNS_HEAD = """# What coarser scenes gain, and at what error

Written by `python tests/studies/speed_accuracy_study.py`. All times are CPU times on one thread; other programs ran on
the same two cores, so that differences of 10 % are not significant. The synthetic sites (fields, land) vary frequency
and resolution.

## Single runs

`seqrsm tradeoff`: 8 configurations spread over the region, 6 occasions each, on the scene as it is and on scenes whose
cells are averaged while a pixel keeps 8, 4 or 2 of them along its side. Score units: percent correct, but kappa for
crops and skill for moisture. *Utility lost*: by choosing the configuration that scores best on the coarser scene.

| site | cells | score | run [ms] | cells along a pixel | time [%] | rms error | bias ± s.e. | utility lost ± s.e. |
|---|---|---|---|---|---|---|---|---|
"""

CAMPAIGNS_HEAD = """
## Whole campaigns

`seqrsm run` (startup, searches, simulations, fits, posterior) in full and with `[simulator] tolerance`: cells are
averaged as far as measured differences of the scores allow, at most the tolerance (root mean square). The lower of two
alternating rounds. The synthetic sites run 60 simulations each; the examples end by their own stop rules. *True
difference*: mean score in full of what the campaign with a tolerance recommends, less that of what the full one does,
on {n} fresh occasions.

| site | tolerance | full [s] | with tolerance [s] | runs, full and with tolerance | true difference ± s.e. |
|---|---|---|---|---|---|
"""


def cells_of(name: str) -> str:
    path = ROOT / "campaigns" / name / "scene.npz"
    if name not in EXAMPLES:
        path = Path(next(site for site in SITES if site.name == name).scene_path())
    scene = load_scene(path)
    return f"{scene.shape[0]} x {scene.shape[1]} of {scene.cell_m:g} m"


def pair(value: float, error: float, digits: int) -> str:
    return f"{value:.{digits}f} ± {error:.{digits}f}"


def page(kept: dict[str, Any]) -> str:
    single, whole = "", ""
    for name, own in kept.items():
        for application, levels in (own["tradeoff"] or {}).items():
            full, *coarser = levels
            digits = 3 if name in TOLERANCES else 2
            for one in coarser:
                if one["averaged"] == [1]:
                    continue  # the same scene
                single += (
                    f"| {name} | {cells_of(name)} | {application} | {1000.0 * full['seconds']:.0f}"
                    f" | {one['cells']} or more"
                    f" | {100.0 * one['time_ratio']:.0f} | {one['rms_error']:.{digits}f}"
                    f" | {pair(one['bias'], one['bias_se'], digits)}"
                    f" | {pair(one['utility_lost'], one['utility_lost_se'], digits)} |\n"
                )
        full, fast = (list(own[way]) for way in ("in full", "tolerance"))
        if full and fast:
            gain = np.subtract(fast[0]["scores"], full[0]["scores"])
            tolerance = TOLERANCES.get(name, TOLERANCE)
            whole += (
                f"| {name} | {tolerance:g} | {min(one['seconds'] for one in full):.1f}"
                f" | {min(one['seconds'] for one in fast):.1f} | {full[0]['runs']}, {fast[0]['runs']}"
                f" | {pair(gain.mean(), gain.std(ddof=1) / len(gain) ** 0.5, 3 if name in TOLERANCES else 2)} |\n"
            )
    return RUNS_HEAD + single + CAMPAIGNS_HEAD.format(n=FRESH) + whole


def main() -> None:
    text = page(measure())
    notes = OUT / "notes.md"
    (OUT / "README.md").write_text(
        text + (notes.read_text(encoding="utf-8") if notes.exists() else ""), encoding="utf-8"
    )
    print(text)


if __name__ == "__main__":
    main()
