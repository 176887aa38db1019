"""Do intervals hold over grounds that the tables do not know? Campaigns, and then flights in worlds drawn afresh.

    OPENBLAS_NUM_THREADS=1 python tests/studies/worlds_study.py [--seeds 80] [--workers 2]

Each example campaign is run to its end with several seeds. At what it recommends five flights are simulated in each of
some fresh worlds, 200 or more in all: how many single flights, and means of five, lie in their 95 % intervals? And what
the recommended frequency does from seed to seed. And how the score of a ground departs from the mean of grounds over
the region, which is the prior of flights less simulations. Goes on where it was interrupted, from
``reports/validation/worlds.json`` and ``differences.json``, and writes ``worlds.md`` beside them.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import re
import shutil
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import nnls

from seqrsm.campaign.campaign import Campaign
from seqrsm.campaign.loop import run_campaign
from seqrsm.campaign.simulation import bundle_tasks, carry_out, task_of
from seqrsm.decide.sources import discrepancy_sd
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.spec.read import load_spec

ROOT = Path(__file__).parents[2]
OUT = ROOT / "reports" / "validation"
FRESH = 2**28  # worlds and occasions of no campaign
FLIGHTS, WORLDS = 5, 400
SETTINGS, GROUNDS = 20, 48  # of the differences between grounds
SITES = ("langegracht-radar", "limburg-radar", "wake-radiometer")
ORDERS = {"intercept": 0, "linear": 1, "category": 1, "interaction": 2, "square": 2}


def campaign(name: str, seed: int, n_worlds: int) -> dict[str, Any]:
    """One campaign to its end, and flights at what it recommends."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / name
        shutil.copytree(ROOT / "campaigns" / name, folder)
        file = folder / "campaign.toml"
        file.write_text(
            re.sub(r"(?m)^seed = .*$", f"seed = {seed}", file.read_text(encoding="utf-8")), encoding="utf-8"
        )
        start = time.perf_counter()
        outcome = run_campaign(Campaign.open(folder))
        seconds = time.perf_counter() - start
        best, (analysis, *_) = outcome.analyses[0].optimum, outcome.analyses
        spec, flights = load_spec(folder), []
        for world in range(FRESH, FRESH + n_worlds):
            ids = range(FRESH + FLIGHTS * (world - FRESH), FRESH + FLIGHTS * (world - FRESH + 1))
            tasks = [dataclasses.replace(task_of(spec, i, best.settings), world=world) for i in ids]
            flights.append([carry_out(task).scores[0].score for task in tasks])
    frequency = next(s for s in analysis.posterior.settings if s.factor == "frequency")
    return {
        "name": name,
        "seed": seed,
        "held": outcome.held,
        "runs": analysis.fit.n_runs,
        "seconds": round(seconds, 1),
        "settings": best.settings,
        "frequency_range": [frequency.low, frequency.high],
        "mean": best.mean,
        "one": [best.prediction.low, best.prediction.high],
        "five": [best.prediction_mean.low, best.prediction_mean.high],
        "chance": best.by_chance.half_width,
        "ground": best.of_ground,
        "share": 0.0 if best.ground is None else best.ground.share,
        "flights": np.round(flights, 3).tolist(),
    }


def difference(name: str) -> dict[str, Any]:
    """How grounds differ from their mean: scores of the same worlds at settings drawn from the region.

    The covariance of a ground's scores at two settings is that of means over its occasions less what chance gives them;
    standard deviations of terms by order are those whose surfaces have that covariance (non-negative least squares).
    """
    spec = load_spec(ROOT / "campaigns" / name)
    points = spec.region.sample(SETTINGS, np.random.default_rng(5))
    tasks = [task for one in spec.region.decode(points) for task in bundle_tasks(spec, one, 0, range(GROUNDS))]
    scores = np.reshape([carry_out(task).scores[0].score for task in tasks], (SETTINGS, GROUNDS, -1))
    model = QuadraticModel(spec.factors)
    order, Z = np.array([ORDERS[term.kind] for term in model.terms]), model.matrix(points)
    half = np.tril_indices(SETTINGS)
    parts = np.array([(Z[:, order == k] @ Z[:, order == k].T)[half] for k in range(3)]).T
    of_prior = Z * discrepancy_sd(model, 1.0)

    def found(worlds: np.ndarray) -> list[float]:
        own = scores[:, worlds]
        chance = own[..., 0] - own[..., 1]
        covariance = np.cov(own.mean(axis=2)) - chance @ chance.T / (4 * len(worlds))
        terms = np.sqrt(nnls(parts, covariance[half])[0])
        return [float(np.sqrt(max(np.trace(covariance), 0.0) / SETTINGS)), related(covariance), *terms]

    rng = np.random.default_rng(6)
    drawn = np.array([found(rng.integers(GROUNDS, size=GROUNDS)) for _ in range(200)])
    return {
        "name": name,
        "found": np.round(found(np.arange(GROUNDS)), 3).tolist(),
        # Half of the middle 68 %: a ratio of variances that are mostly chance has no standard deviation.
        "se": np.round(0.5 * np.diff(np.quantile(drawn, [0.16, 0.84], axis=0), axis=0)[0], 3).tolist(),
        "prior": round(related(of_prior @ of_prior.T), 3),
    }


def related(covariance: np.ndarray) -> float:
    """Mean covariance of two settings over the mean variance of one."""
    n = len(covariance)
    return float((covariance.sum() / np.trace(covariance) - 1.0) / (n - 1))


def share_inside(rows: list[dict[str, Any]], key: str) -> tuple[float, float]:
    """Share of flights, or of means of five, inside their interval, and its standard error over campaigns [percent]."""
    inside = []
    for row in rows:
        low, high = row[key]
        y = np.array(row["flights"])
        y = y if key == "one" else y.mean(axis=1, keepdims=True)
        inside.append(np.mean((y >= low) & (y <= high)))
    return 100.0 * float(np.mean(inside)), 100.0 * float(np.std(inside, ddof=1) / np.sqrt(len(inside)))


def without_ground(rows: list[dict[str, Any]]) -> float:
    """Share of means of five inside the half-width by chance alone [percent]."""
    inside = [np.abs(np.mean(row["flights"], axis=1) - row["mean"]) <= row["chance"] for row in rows]
    return 100.0 * float(np.mean(np.concatenate(inside)))


def page(rows: list[dict[str, Any]], differences: list[dict[str, Any]]) -> str:
    """The page."""
    names = list(dict.fromkeys(row["name"] for row in rows))
    lines = [
        "# Table uncertainty: coverage over grounds that depart from the tables",
        "",
        "Written by `python tests/studies/worlds_study.py`. Each campaign was run to its end, and five flights at",
        "the recommended settings were simulated in each of several new worlds, with table means and field-to-field",
        "scatter drawn from their uncertainty (`seqrsm/scattering/data/mean_sd.csv`). Nominal 95 %; standard errors",
        "over campaigns.",
        "",
        "| campaign | seeds | runs | worlds | one flight [%] | mean of five [%] | "
        "mean of five, sampling error only [%] | ± whole | ± sampling | ± tables |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for name in names:
        own = [row for row in rows if row["name"] == name]
        (one, se_one), (five, se_five) = share_inside(own, "one"), share_inside(own, "five")
        widths = [np.mean([0.5 * (row["five"][1] - row["five"][0]) for row in own])]
        widths += [np.mean([row[key] for row in own]) for key in ("chance", "ground")]
        runs, worlds = np.mean([row["runs"] for row in own]), sum(len(row["flights"]) for row in own)
        lines.append(
            f"| {name} | {len(own)} | {runs:.0f} | {worlds} | {one:.1f} ± {se_one:.1f} | {five:.1f} ± {se_five:.1f} | "
            f"{without_ground(own):.0f} | {widths[0]:.1f} | {widths[1]:.1f} | {widths[2]:.1f} |"
        )
    lines += ["", "## Recommended frequency from seed to seed", ""]
    for name in names:
        own = [row for row in rows if row["name"] == name]
        f = np.array([row["settings"]["frequency"] for row in own])
        middle = float(np.median(f))
        held = sum(
            row["frequency_range"][0] <= middle * 1.001 and middle <= row["frequency_range"][1] * 1.001 for row in own
        )
        lines.append(
            f"- {name}: {f.min():.2f} to {f.max():.2f} GHz, median {middle:.2f}; inside the reported 95 % range of "
            f"{held} of {len(own)} campaigns."
        )
    lines += [
        "",
        "## How a ground departs from the mean of grounds",
        "",
        f"Scores of {GROUNDS} worlds at {SETTINGS} settings drawn from the region, two occasions each: standard",
        "deviation of a ground, correlation of its departures at two settings, and standard deviations of the coded",
        "coefficients of a quadratic with that covariance [points], ± standard errors over worlds. A ground mostly",
        "scores more, or less, at all settings. The prior of flights less simulations has coefficients of each",
        "order half as wide as those of the order before; *prior*: the correlation that this gives.",
        "",
        "| campaign | ground | correlation | prior | intercept | first order | second order |",
        "|---|---|---|---|---|---|---|",
    ]
    for one in differences:
        told = zip(one["found"], one["se"], (1, 2, 1, 1, 1), strict=True)
        sd, corr, *terms = (f"{value:.{d}f} ± {se:.{d}f}" for value, se, d in told)
        lines.append(f"| {one['name']} | {sd} | {corr} | {one['prior']:.2f} | {' | '.join(terms)} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Make what is missing, and the page."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, default=80)
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    store = OUT / "worlds.json"
    kept: list[dict[str, Any]] = json.loads(store.read_text(encoding="utf-8")) if store.exists() else []
    done = {(row["name"], row["seed"]) for row in kept}
    wanted = [(name, s, -(-WORLDS // given.seeds)) for name in SITES for s in range(1, given.seeds + 1)]
    with ProcessPoolExecutor(given.workers) as pool:
        jobs = [pool.submit(campaign, *one) for one in wanted if one[:2] not in done]
        for job in as_completed(jobs):
            kept.append(job.result())
            store.write_text(json.dumps(kept), encoding="utf-8")
    kept.sort(key=lambda row: (row["name"], row["seed"]))
    store.write_text(json.dumps(kept), encoding="utf-8")
    of_grounds = OUT / "differences.json"
    if not of_grounds.exists():
        with ProcessPoolExecutor(given.workers) as pool:
            of_grounds.write_text(json.dumps(list(pool.map(difference, SITES))), encoding="utf-8")
    differences = json.loads(of_grounds.read_text(encoding="utf-8"))
    (OUT / "worlds.md").write_text(page(kept, differences), encoding="utf-8")


if __name__ == "__main__":
    main()
