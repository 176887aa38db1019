"""Campaigns with the fidelity planner against campaigns with everything on.

    python tests/studies/speed_accuracy_study.py

For each site some campaigns are simulated by the full simulation (F4) and with the planner at some tolerances: the same
design, the same occasions. A control repeats each full campaign on other occasions. Each gives a fitted surface and its
optimum, and the full simulation says, on fresh occasions common to all, what each optimum is worth. Every campaign is
kept as soon as it is done, in ``reports/speed-accuracy/measurements.json``: the same command goes on where it was
interrupted, and ``--pages`` writes the page from what there is. The ways of a campaign and the sites take turns, so
that a machine that is busier for a while slows them all alike. At the end two of the synthetic sites are drawn smaller
and larger, for how the gain grows with the scene.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import gettempdir
from typing import Any

import numpy as np

from seqrsm.campaign.engines import ENGINES, Demand
from seqrsm.campaign.simulation import SimulationResult, SimulationTask, carry_out, plan_of, score_by, simulate_image
from seqrsm.design.factors import ContinuousFactor
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.fit.least_squares import fit_least_squares
from seqrsm.fit.optimum import optimum
from seqrsm.scene.file import load_scene, save_scene
from seqrsm.scene.synthetic import synthetic_scene

ROOT = Path(__file__).resolve().parents[2]
OUT = ROOT / "reports" / "speed-accuracy"
CAMPAIGNS, RUNS, FRESH = 10, 20, 6
CONTROL, OTHER_OCCASIONS = "control", 5_000
SIZED, SIZES = ("flat fields", "flat land"), (450, 900, 1800, 2700)
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
    """A scene, an engine, and what is asked of it."""

    name: str
    kind: str
    engine: str
    utility: str
    tolerances: tuple[float, ...]
    factors: tuple[tuple[str, float, float], ...]
    fixed: dict[str, float | str]
    scene: str = ""
    synthetic: dict[str, Any] = field(default_factory=dict)

    @property
    def minimize(self) -> bool:
        return self.utility == "retrieval_error"

    def scene_path(self) -> str:
        """The scene's file; a synthetic one is made at the first use."""
        if self.scene:
            return str(ROOT / "campaigns" / self.scene / "scene.npz")
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
        "exponent": 3.6, "seed": 7,
    }  # fmt: skip


BAND = ("frequency", 1.25, 9.6)
RADAR_FACTORS = (BAND, ("resolution", 8.0, 60.0))
PASSIVE = (("frequency", 6.0, 36.0), ("resolution", 150.0, 400.0))
WET = (("frequency", 1.4, 10.0), ("resolution", 600.0, 1500.0))
LOW = {**RADIOMETER, "antenna_limit_m": 5.0}
PERCENT = "percent_correct"
TOLERANCES = (0.5, 1.0, 2.0)
SITES = (
    Site("flat fields", "flat", "psm", PERCENT, TOLERANCES, RADAR_FACTORS, RADAR,
         synthetic=synthetic(1800, 5.0, CROPS, 3.0, 200.0)),
    Site("rolling fields", "rolling", "psm", PERCENT, TOLERANCES, RADAR_FACTORS, RADAR,
         synthetic=synthetic(1800, 5.0, CROPS, 150.0, 200.0)),
    Site("steep ground", "steep", "psm", PERCENT, TOLERANCES, RADAR_FACTORS, RADAR,
         synthetic=synthetic(1800, 5.0, CROPS, 1500.0, 200.0)),
    Site("Langegracht", "rolling", "psm", PERCENT, TOLERANCES, RADAR_FACTORS, RADAR, scene="langegracht-radar"),
    Site("flat land", "flat", "prm", PERCENT, TOLERANCES, PASSIVE, RADIOMETER,
         synthetic=synthetic(1800, 15.0, LAND, 3.0, 600.0)),
    Site("rolling land", "rolling", "prm", PERCENT, TOLERANCES, PASSIVE, RADIOMETER,
         synthetic=synthetic(1800, 15.0, LAND, 150.0, 600.0)),
    Site("steep land", "steep", "prm", PERCENT, TOLERANCES, PASSIVE, RADIOMETER,
         synthetic=synthetic(1800, 15.0, LAND, 2500.0, 600.0)),
    Site("flat soils", "flat", "prm", "retrieval_error", (0.25, 0.5), WET, LOW,
         synthetic=synthetic(900, 30.0, ("Bareground", "Grass"), 3.0, 2000.0)),
    Site("Wake County", "rolling", "prm", PERCENT, TOLERANCES, PASSIVE, {**RADIOMETER, "speed_m_s": 80.0},
         scene="wake-radiometer"),
)  # fmt: skip


def region_of(site: Site) -> Region:
    return Region(tuple(ContinuousFactor(name, low, high, scale="log") for name, low, high in site.factors))


def task(site: Site, settings: dict[str, Any], seed: int, run: int, tolerance: float, fidelity: str) -> SimulationTask:
    return SimulationTask(
        site.engine, run, seed, settings, site.fixed, site.scene_path(), "", (("a", site.utility),),
        Demand(tolerance, fidelity),
    )  # fmt: skip


def design(site: Site, number: int) -> tuple[np.ndarray, list[dict[str, Any]]]:
    """Coded points and settings of a campaign."""
    region = region_of(site)
    rng = np.random.default_rng(1000 + number)
    points = np.vstack([np.zeros((2, region.k)), region.sample(RUNS - 2, rng)])
    return points, region.decode(points)


def carried_out(
    site: Site, number: int, ways: tuple[str, ...]
) -> tuple[dict[str, list[SimulationResult]], dict[str, float]]:
    """The runs of a campaign by each way, one way after the other, and the CPU seconds of each."""
    seed, results, seconds = 1000 + number, {}, {}
    settings = design(site, number)[1]
    for way in ways:
        tolerance, fidelity = (1.0, "F4") if way in ("F4", CONTROL) else (float(way), "auto")
        first = OTHER_OCCASIONS if way == CONTROL else 1
        begin = time.process_time()
        runs = [carry_out(task(site, own, seed, run, tolerance, fidelity)) for run, own in enumerate(settings, first)]
        seconds[way] = time.process_time() - begin
        if any(run.failure for run in runs):
            raise SystemExit(f"{site.name}: {next(run.failure for run in runs if run.failure)}")
        results[way] = runs
    return results, seconds


def campaign(site: Site, number: int) -> dict[str, Any]:
    """One campaign by each way: scores, CPU seconds, rungs, and the optimum that follows."""
    region, seed = region_of(site), 1000 + number
    model = QuadraticModel(region.factors, 2)
    points, _ = design(site, number)
    results, seconds = carried_out(site, number, ("F4", *map(str, site.tolerances), CONTROL))
    out: dict[str, Any] = {}
    for way, runs in results.items():
        scores = [run.scores[0].score for run in runs]
        rungs = [run.scores[0].metadata["fidelity"]["rung"] for run in runs]
        fit = fit_least_squares(model.matrix(points), np.array(scores), model.terms)
        best = optimum(model, region, fit.estimate, "minimize" if site.minimize else "maximize")
        out[way] = {
            "scores": scores,
            "seconds": seconds[way],
            "rungs": {rung: rungs.count(rung) for rung in sorted(set(rungs))},
            "checks": [[run.check.difference, run.check.limit] for run in runs if run.check is not None],
            "optimum": region.decode(best.point[None, :])[0],
        }
    worth: dict[str, list[float]] = {}
    for found in out.values():
        key = repr(sorted(found["optimum"].items()))
        if key not in worth:
            tasks = [task(site, found["optimum"], seed, 10_000 + k, 1.0, "F4") for k in range(FRESH)]
            worth[key] = [score_by(one, "F4")[0]["a"] for one in tasks]
        found["true"] = worth[key]
    return out


def warm_up(site: Site) -> None:
    """Compile, read and cache what is done once in a process."""
    region = region_of(site)
    for point in (region.centre(), -np.ones(region.k)):
        for fidelity in ("F4", "auto"):
            carry_out(task(site, region.decode(point[None, :])[0], 1, 1, site.tolerances[-1], fidelity))


def measure(path: Path, campaigns: int) -> None:
    """Every site's first campaign, then every site's second: interrupted, it holds as many of each as can be."""
    kept = read(path)
    warm = set()
    for number in range(campaigns):
        for site in SITES:
            own = kept["campaigns"].setdefault(site.name, [])
            if len(own) > number:
                continue
            if site.name not in warm:
                warm_up(site)
                warm.add(site.name)
            begin = time.perf_counter()
            own.append(campaign(site, number))
            keep(path, kept)
            print(f"{site.name}: campaign {number + 1} of {campaigns}, {time.perf_counter() - begin:.0f} s", flush=True)
    for site in (site for site in SITES if site.name in SIZED):
        own = kept["sizes"].setdefault(site.name, {})
        for size in (size for size in SIZES if str(size) not in own):
            other = replace(site, synthetic={**site.synthetic, "rows": size, "cols": size})
            warm_up(other)
            own[str(size)] = carried_out(other, 0, ("F4", *map(str, site.tolerances)))[1]
            keep(path, kept)
            print(f"{site.name}: {size} cells a side", flush=True)
        if site.name not in kept["scoring"]:
            kept["scoring"][site.name] = scoring(site)
            keep(path, kept)


def scoring(site: Site) -> dict[str, float]:
    """CPU seconds a run of the whole image, of its score, and of its score by the compiled code that samples have."""
    spent = np.zeros(3)
    for run, settings in enumerate(design(site, 0)[1], 1):
        own = task(site, settings, 1000, run, 1.0, "F3")
        key = {"seed": own.seed, "run_id": own.stream}
        plan, make, scene, _ = plan_of(own)
        sample = make(replace(plan.chosen, draws=1))
        begin = time.process_time()
        image = simulate_image(own)[0]
        made = time.process_time()
        ENGINES[site.engine].utilities[site.utility](image, scene, **key)
        scored = time.process_time()
        ENGINES[site.engine].sampled[site.utility](sample, scene, **key)
        spent += np.diff([begin, made, scored, time.process_time()])
    return dict(zip(("image", "score", "compiled"), (spent / RUNS).tolist(), strict=True))


def keep(path: Path, kept: dict[str, Any]) -> None:
    """Write what was measured, with the load and the version of the program that measured it."""
    kept["loads"].append(os.getloadavg()[0])
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True).stdout
    kept["commits"] = sorted({*kept["commits"], commit.strip()})
    draft = path.with_suffix(".draft")
    draft.write_text(json.dumps(kept, indent=1))
    draft.replace(path)


def read(path: Path) -> dict[str, Any]:
    """What was measured by these very settings; nothing where they have changed."""
    sites = [[s.name, s.tolerances, s.factors, s.fixed, s.synthetic] for s in SITES]
    settings = json.loads(json.dumps({"runs": RUNS, "fresh": FRESH, "sites": sites}))
    kept: dict[str, Any] = json.loads(path.read_text()) if path.exists() else {}
    new = {"settings": settings, "loads": [], "commits": [], "campaigns": {}, "sizes": {}, "scoring": {}}
    return kept if kept.get("settings") == settings else new


def summary(site: Site, rows: list[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    """Speed and loss at each tolerance, and the loss of a second campaign by the full simulation."""
    sign = -1.0 if site.minimize else 1.0

    def lost(way: str) -> np.ndarray:
        return np.array([sign * (np.array(row["F4"]["true"]) - np.array(row[way]["true"])).mean() for row in rows])

    for tolerance in site.tolerances:
        way = str(tolerance)
        full, own = (np.array([row[name]["seconds"] for row in rows]) for name in ("F4", way))
        error = np.array([np.array(row[way]["scores"]) - np.array(row["F4"]["scores"]) for row in rows])
        rungs: dict[str, int] = {}
        for row in rows:
            for rung, count in row[way]["rungs"].items():
                rungs[rung] = rungs.get(rung, 0) + count
        checks = [check for row in rows for check in row[way]["checks"]]
        noise = [np.std(row["F4"]["true"], ddof=1) for row in rows]
        each = full / own
        yield {
            "site": site, "tolerance": tolerance, "full_s": float(full.sum() / (len(rows) * RUNS)),
            "speed": float(full.sum() / own.sum()), "speed_se": float(each.std(ddof=1) / np.sqrt(len(each))),
            "rungs": dict(sorted(rungs.items())),
            "bias": float(error.mean()), "rms": float(np.sqrt(np.mean(error**2))),
            "loss": lost(way), "control": lost(CONTROL), "checks": len(checks),
            "violated": sum(abs(difference) > limit for difference, limit in checks), "noise": float(np.mean(noise)),
        }  # fmt: skip


def plot(rows: list[dict[str, Any]], path: Path) -> None:
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(10.5, 7.6), sharey=True, constrained_layout=True)
    places = np.arange(len(rows))[::-1]
    colors = {"flat": "#009e73", "rolling": "#0072b2", "steep": "#d55e00"}
    engines = {"psm": "radar", "prm": "radiometer"}
    names = [f"{row['site'].name}, {engines[row['site'].engine]}, \u00b1{row['tolerance']:g}" for row in rows]
    for place, row in zip(places, rows, strict=True):
        color = colors[row["site"].kind]
        left.barh(place, row["speed"] - 1.0, left=1.0, color=color, height=0.7)
        left.text(max(row["speed"], 1.0) * 1.06, place, f"{row['speed']:.1f}", va="center", fontsize=8)
        for key, style, shift in (
            ("control", {"color": "#9aa3ad", "marker": "x"}, -0.2),
            ("loss", {"color": color, "marker": "o"}, 0.15),
        ):
            lost = row[key] / row["tolerance"]
            right.plot(lost, np.full(len(lost), place + shift), linestyle="", markersize=3.5, alpha=0.7, **style)
    for kind, color in colors.items():
        left.barh(-5, 0, color=color, label=kind)
    left.axvline(20, color="#009e73", ls=":", lw=1)
    left.axvline(5, color="#0072b2", ls=":", lw=1)
    left.set(xscale="log", xlim=(0.5, 200), xlabel="times faster than everything on (dotted: the aims)")
    left.set_xticks([1, 2, 5, 10, 20, 50, 100], ["1", "2", "5", "10", "20", "50", "100"])
    left.set_ylim(-0.8, len(rows) - 0.2)
    left.set_yticks(places, names, fontsize=8)
    above = {"loc": "lower left", "bbox_to_anchor": (0.0, 1.0), "ncols": 3, "fontsize": 8, "frameon": False}
    left.legend(**above)
    right.axvline(1.0, color="#5c6670", lw=1)
    right.plot([], [], "o", ms=3.5, color="#33383e", label="planned campaign")
    right.plot([], [], "x", ms=3.5, color="#9aa3ad", label="second full campaign, other occasions")
    right.legend(**above)
    right.set(xlabel="utility lost / tolerance (line: 1; beyond -6 not shown)", xlim=(-6.0, 8.0))
    right.grid(visible=True, axis="x", color="#d5dae0", lw=0.6)
    figure.savefig(path, dpi=130)


HEAD = """# Speed and accuracy of campaigns with the fidelity planner

Written by `python tests/studies/speed_accuracy_study.py` in one run (version {commits}), {n} campaigns of {runs}
runs for each site, over frequency and resolution: once with every run by the full simulation (F4), and once with the
planner at each tolerance (0.5 is the program's default for percent correct), with the same settings and occasions.
Times are CPU times of one process, the planner's own decisions and the checks of a twentieth of the runs included, of
all {n} campaigns, each carried out once; ways and sites take turns, campaign by campaign. Other programs ran beside
them (load {low:.1f} to {high:.1f} on {cores} cores), so that ratios tell more than seconds; their \u00b1 is the
standard error over campaigns.

What an optimum is worth is the mean of {fresh} fresh full simulations on occasions common to all ways. A campaign of
{runs} runs finds its optimum only as well as occasions let it: the *control* is a second full campaign of the same
settings on other occasions, so that its loss is chance alone and the planner's own part is what a planned campaign
loses beyond it.

![Times faster, and utility lost, for each site](speed-accuracy.png)

## Sites

{sites}

## Speed and loss

| site | engine, utility | tolerance | rungs of the runs | s a run by F4 | times faster | bias, rms of a score | \
utility lost | within tolerance | control lost | control within | checks, violated | sd between occasions |
|---|---|---|---|---|---|---|---|---|---|---|---|---|"""

CAUSES = """\
- The bound is mostly the standard error of looking at a part of the ground, which falls only with the root of what is
  seen: half the tolerance takes four times the pixels. The observed rms errors are smaller than the tolerance, and one
  full simulation scatters from occasion to occasion by more than it. Errors against bounds of random sensors on other
  sites stand in [bounds.md](bounds.md).
- The gain grows with the scene: a planned run takes some milliseconds on any (the planner's decision, the tables of
  backscatter or emissivity, teaching and testing the classifier), a full one grows with its cells. Langegracht and
  Wake County, the real sites, are small (0.8 and 0.2 million cells): there rare classes make the planner look at most
  of the ground, or at all of it.
- On steep ground the radar's shadows need whole range lines (strips), and the radiometer's hidden ground the whole
  image.
- F1 (wider cells) pays where a pixel holds many cells: here from some 40 m on cells of 5 m. On finer pixels its error
  at the borders of fields takes more of the tolerance than its time is worth.
- A twentieth of the runs is checked by the next rung. Where every planned run is strips or footprints (F2) that is the
  whole image: of a radiometer it takes as long as a full run, so that the checks alone limit the gain to a factor of
  twenty. A campaign of {runs} runs meets none or three of them by chance: the \u00b1 above.
- The whole image of a radar is cheap to make; most of a full run's time goes into teaching and testing the classifier
  on its pixels. A sample of them is taught and tested by compiled code, which names the same cells; the full
  simulation's stays as it is, so that scores already kept can be made again to the bit. A part of the gain is owed to
  that: {scoring}."""


def write(rows: list[dict[str, Any]], n: int, kept: dict[str, Any]) -> str:
    loads = kept["loads"]
    head = HEAD.format(
        n=n, runs=RUNS, low=min(loads), high=max(loads), cores=os.cpu_count(), fresh=FRESH,
        commits=", ".join(kept["commits"]), sites=_sites(kept["sizes"]),
    )  # fmt: skip
    lines = [head.replace("\\\n", "")]
    for row in rows:
        site, loss, control = row["site"], row["loss"], row["control"]
        rungs = ", ".join(f"{rung} {count}" for rung, count in row["rungs"].items())
        engine = "radar" if site.engine == "psm" else "radiometer"
        lines.append(
            f"| {site.name} | {engine}, {site.utility} | {row['tolerance']:g} | {rungs} | {row['full_s']:.3f} | "
            f"**{row['speed']:.1f}** \u00b1 {row['speed_se']:.1f} | {row['bias']:+.2f}, {row['rms']:.2f} | "
            f"{_mean(loss)} | {_share(loss <= row['tolerance'])} | {_mean(control)} | "
            f"{_share(control <= row['tolerance'])} | {row['checks']}, {row['violated']} | {row['noise']:.1f} |"
        )
    lines += ["", "## Aims and what was reached", "", *_findings(rows), *_within(rows)]
    causes = CAUSES.format(runs=RUNS, scoring=_scoring(rows, kept["scoring"]))
    return "\n".join([*lines, causes, ""])


def _scoring(rows: list[dict[str, Any]], scoring: dict[str, dict[str, float]]) -> str:
    """What the full simulation's own classifier costs, and the gains without it."""
    parts = []
    for name, found in scoring.items():
        full, fast = found["image"] + found["score"], found["image"] + found["compiled"]
        gains = " / ".join(f"{row['speed'] * fast / full:.1f}" for row in rows if row["site"].name == name)
        parts.append(
            f"on {name} an image takes {1000 * found['image']:.0f} ms, its score {1000 * found['score']:.0f} ms, and "
            f"would take {1000 * found['compiled']:.0f} ms compiled; campaigns would then be {gains} times faster at "
            "the tolerances above than such a full simulation"
        )
    return "; ".join(parts)


def _sites(sizes: dict[str, dict[str, dict[str, float]]]) -> str:
    """What the sites are, and how the gain grows with them."""
    lines = ["| site | ground | cells | covers |", "|---|---|---|---|"]
    for site in SITES:
        scene = load_scene(Path(site.scene_path()))
        high = float(np.nanmax(scene.elevation_m) - np.nanmin(scene.elevation_m))
        made = f"real: the scene of the example campaign `{site.scene}`" if site.scene else (
            f"drawn (`seqrsm.scene.synthetic`), fields of some {site.synthetic['field_m']:g} m"
        )  # fmt: skip
        rows, columns = scene.shape
        covers = ", ".join(scene.categories)
        cells = f"{rows} x {columns} of {scene.cell_m:g} m"
        lines.append(f"| {site.name} | {made}; {high:.0f} m from lowest to highest | {cells} | {covers} |")
    lines += [
        "",
        "The drawn sites are large (1800 cells a side, in a first study 900 for the radiometer) because a campaign",
        "that needs a planner is one whose full images are dear: a full simulation takes time in proportion to the",
        "cells, a planned one hardly. How much faster one campaign was on such ground drawn smaller and larger:",
        "",
        "| site | cells a side | s a run by F4 | " + " | ".join(f"tolerance {t:g}" for t in TOLERANCES) + " |",
        "|---|---|---|" + "---|" * len(TOLERANCES),
    ]
    for name, found in sizes.items():
        for size, seconds in found.items():
            ratios = " | ".join(f"{seconds['F4'] / seconds[str(t)]:.1f}" for t in TOLERANCES)
            lines.append(f"| {name} | {size} | {seconds['F4'] / RUNS:.3f} | {ratios} |")
    return "\n".join(lines)


def _mean(x: np.ndarray) -> str:
    return f"{x.mean():+.2f} \u00b1 {x.std(ddof=1) / np.sqrt(len(x)):.2f}"


def _share(x: np.ndarray) -> str:
    return f"{int(x.sum())} of {len(x)}"


def _within(rows: list[dict[str, Any]]) -> list[str]:
    """The issue's criterion over all campaigns with a cheaper model, beside what chance alone does to it."""
    cheaper = [row for row in rows if set(row["rungs"]) != {"F4"}]
    own, control = (np.concatenate([row[key] <= row["tolerance"] for row in cheaper]) for key in ("loss", "control"))
    parts = [np.concatenate([row[key] / row["tolerance"] for row in cheaper]) for key in ("loss", "control")]
    share, chance = (100.0 * float(x.mean()) for x in (own, control))
    error = 100.0 * float(np.sqrt(own.mean() * (1.0 - own.mean()) / own.size))
    verdict = "reached" if share >= 95.0 else "missed"
    return [
        f"- Of the {own.size} campaigns with any cheaper model (not F4 alone) {share:.0f} \u00b1 {error:.0f} % lost no "
        f"more than the tolerance; the aim of 95 % is {verdict}. Of second full campaigns, which no planner touched, "
        f"{chance:.0f} % did. Planned campaigns lost {_mean(parts[0])} tolerances on average, second full ones "
        f"{_mean(parts[1])}."
    ]


def _findings(rows: list[dict[str, Any]]) -> list[str]:
    out = []
    for kind, aim in (("flat", 20.0), ("rolling", 5.0)):
        for row in (r for r in rows if r["site"].kind == kind):
            short = aim / row["speed"]
            verdict = (
                "reached" if short <= 1.0 else "just missed" if short < 1.05 else f"missed by a factor {short:.1f}"
            )
            name = f"{row['site'].name} (tolerance {row['tolerance']:g})"
            out.append(f"- {name}: {row['speed']:.1f} times faster; the aim of {aim:g} is {verdict}.")
    for row in (r for r in rows if r["site"].kind == "steep"):
        loss, se = row["loss"].mean(), row["loss"].std(ddof=1) / np.sqrt(len(row["loss"]))
        verdict = "no loss beyond Monte Carlo error" if loss <= 2.0 * se else "a loss"
        out.append(
            f"- {row['site'].name} (tolerance {row['tolerance']:g}): {verdict} ({loss:+.2f} \u00b1 {se:.2f}), "
            f"{row['speed']:.1f} times faster."
        )
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--campaigns", type=int, default=CAMPAIGNS)
    parser.add_argument("--pages", action="store_true", help="write the page from what was measured, measure nothing")
    asked = parser.parse_args()
    OUT.mkdir(parents=True, exist_ok=True)
    path = OUT / "measurements.json"
    if not asked.pages:
        measure(path, asked.campaigns)
    kept = read(path)
    n = min(len(kept["campaigns"].get(site.name, [])) for site in SITES)
    if n < 2:
        sys.exit("fewer than two campaigns of each site are measured")
    rows = [row for site in SITES for row in summary(site, kept["campaigns"][site.name][:n])]
    plot(rows, OUT / "speed-accuracy.png")
    (OUT / "README.md").write_text(write(rows, n, kept), encoding="utf-8")
    print(f"wrote {OUT}")


if __name__ == "__main__":
    main()
