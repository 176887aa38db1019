"""Simulation and flights together, on real scores: 24 AIRSAR scores correct the simulated ones over Flevoland.

    OPENBLAS_NUM_THREADS=1 python tests/studies/flevoland_flights.py [--repeats 20]

Simulated and real scores of the same 196 configurations stand in ``reports/validation/flevoland_scores.csv`` (column
"measured": simulated from measured class means). A campaign takes all simulated scores of its region in, then real ones
four at a time, as ``seqrsm propose --source flight`` asks for them (the nearest configuration not flown yet). The real
scores that are left test the prediction interval of a flight. Writes ``reports/validation/flevoland_flights.md``.
"""

from __future__ import annotations

import argparse
import csv
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np

from seqrsm.campaign.campaign import Campaign
from seqrsm.store.records import IngestedFile, IngestedRun, NewScore

ROOT = Path(__file__).parents[2]
OUT = ROOT / "reports" / "validation" / "flevoland_flights.md"
BATCH, FLIGHTS, LEVEL, NEAR = 4, 24, 0.95, 0.5


class Region(NamedTuple):
    """Ranges of looks, and of resolution [m]."""

    looks: tuple[float, float]
    resolution_m: tuple[float, float]


DESCRIBED = Region((16.0, 400.0), (24.2, 121.0))
WHOLE = Region((4.0, 2304.0), (12.1, 290.4))
SPEC = """
[campaign]
name = "flevoland-both"
seed = {seed}
batch = 4
[[factor]]
name = "polarization"
levels = ["HH", "HV", "VV", "HH+HV", "HV+VV", "HH+VV", "HH+HV+VV"]
[[factor]]
name = "looks"
low = {looks[0]}
high = {looks[1]}
scale = "log"
[[factor]]
name = "resolution"
unit = "m"
low = {resolution_m[0]}
high = {resolution_m[1]}
scale = "log"
[[constraint]]
expr = "looks <= 4.01 * (resolution / 12.1) ** 2"
[[application]]
name = "crops"
utility = "measured"
[stop]
half_width = 6.0
level = 0.95
max_runs = 400
"""


def table(region: Region) -> tuple[list[dict[str, float | str]], np.ndarray, np.ndarray]:
    """Settings, simulated and real scores of the configurations in a region."""
    with (ROOT / "reports/validation/flevoland_scores.csv").open(newline="", encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    (fewest, most), (finest, coarsest) = region
    rows = [r for r in rows if fewest <= float(r["looks"]) <= most and finest <= float(r["resolution_m"]) <= coarsest]
    settings = [
        {"polarization": r["polarization"], "looks": float(r["looks"]), "resolution": float(r["resolution_m"])}
        for r in rows
    ]
    return settings, np.array([float(r["measured"]) for r in rows]), np.array([float(r["flight"]) for r in rows])


def take_in(campaign: Campaign, settings, scores: np.ndarray, source: str, name: str) -> None:
    runs = [
        IngestedRun(None, one, source, "", 1.0, (NewScore("crops", float(score)),))
        for one, score in zip(settings, scores, strict=True)
    ]
    campaign.store.ingest_files([IngestedFile(name, name, len(runs), tuple(runs))])


def look(campaign: Campaign, points: np.ndarray, real: np.ndarray, flown: list[int]) -> dict[str, float]:
    """Interval at the recommended settings, and how it does on real scores that were not taken in."""
    (analysis,) = campaign.analyse_all(n_draws=400)
    best = analysis.optimum
    index = np.setdiff1d(np.arange(len(points)), flown)
    found = analysis.belief.bands(points[index], LEVEL)
    hit = (real[index] >= found.prediction.low) & (real[index] <= found.prediction.high)
    here = best.point
    near = (points[index, 0] == here[0]) & (np.max(np.abs(points[index, 1:] - here[1:]), axis=1) <= NEAR)
    same = np.flatnonzero(points[:, 0] == here[0])
    nearest = same[int(np.argmin(np.sum((points[same, 1:] - here[1:]) ** 2, axis=1)))]
    return {
        "flights": len(flown),
        "mean": best.mean,
        "half": best.prediction.half_width,
        "half_mean": best.confidence.half_width,
        "real": float(real[nearest]),
        "lost": float(real.max() - real[nearest]),
        "covered": float(hit.mean()) if len(hit) else np.nan,
        "tested": float(len(hit)),
        "covered_near": float(hit[near].mean()) if near.any() else np.nan,
        "tested_near": float(near.sum()),
        "prior_share": analysis.sources.prior_share if analysis.sources else 1.0,
        "difference": analysis.sources.difference if analysis.sources else np.nan,
    }


def campaign(seed: int, asked: bool, region: Region) -> list[dict[str, float]]:
    """Looks after 0, 4 ... 24 flights; flights as proposed, or drawn at random."""
    settings, simulated, real = table(region)
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "c"
        place.mkdir()
        (place / "campaign.toml").write_text(SPEC.format(seed=1979 + seed, **region._asdict()), encoding="utf-8")
        made = Campaign.open(place)
        points = made.spec.region.code(settings)
        take_in(made, settings, simulated, "simulation", "simulated")
        rng, flown = np.random.default_rng(seed), []
        looks = [look(made, points, real, flown)]
        while len(flown) < FLIGHTS:
            wanted = []
            if asked:
                for run in made.propose(BATCH, source="flight"):
                    target = made.spec.region.code([run.proposed])[0]
                    far = np.sum((points[:, 1:] - target[1:]) ** 2, axis=1) + 10.0 * (points[:, 0] != target[0])
                    far[flown + wanted] = np.inf
                    wanted.append(int(np.argmin(far)))
                    made.store.void(run.run_id, "flown at the nearest configuration of the recording")
            else:
                free = np.setdiff1d(np.arange(len(real)), flown)
                wanted = rng.choice(free, BATCH, replace=False).tolist()
            take_in(made, [settings[i] for i in wanted], real[wanted], "flight", f"flights {len(flown)}")
            flown += wanted
            looks.append(look(made, points, real, flown))
    return looks


HEAD = """# Simulation and flights together: Flevoland

Written by `python tests/studies/flevoland_flights.py --repeats {repeats}`. All simulated scores of the region (from
measured class means; reports/validation/flevoland.md) are taken in, then real AIRSAR scores four at a time. The model
is the flight's surface = the simulation's + a discrepancy with the same terms, those of second order with half the
prior standard deviation, each source with its own variance; all intervals are for flights. Figures are means of
{repeats} campaigns with seeds of their own. *Half-width* is that of the 95 % prediction interval of one flight at the
recommended settings, and behind it that of the confidence interval of the mean; *lost* is the best real score less the
real score of the configuration nearest to the recommendation; *covered* counts the real scores in the fitted region
that were not taken in, and behind it those of the recommended channels within half of the coded range; *prior* is what
is left of the discrepancy's prior variance.

The region is one in which the simulated scores alone depart little from the quadratic (natural log of the Bayes factor
14): 16 to 400 looks and 24.2 to 121 m, 77 configurations. Over all 196 (4 to 2304 looks, 12.1 to 290 m) it is 126; that
case stands last. With flights the surface is a quadratic; without any (first line) both surfaces count.
"""
COLUMNS = """
| flights | half-width | of the mean | predicted | real there | lost | covered | of | near the optimum | of | prior |
|---|---|---|---|---|---|---|---|---|---|---|
"""


def lines(looks: list[list[dict[str, float]]]) -> str:
    """One line for each number of flights, averaged over campaigns."""
    text = []
    for step in range(len(looks[0])):
        one = {}
        for key in looks[0][step]:
            values = np.array([run[step][key] for run in looks])
            one[key] = float(np.mean(values[~np.isnan(values)])) if np.any(~np.isnan(values)) else np.nan
        near = "-" if np.isnan(one["covered_near"]) else f"{100 * one['covered_near']:.0f} %"
        cells = [
            f"{one['flights']:.0f}",
            *(f"{one[key]:.1f}" for key in ("half", "half_mean", "mean", "real", "lost")),
            f"{100 * one['covered']:.0f} %",
            f"{one['tested']:.0f}",
            near,
            f"{one['tested_near']:.0f}",
            f"{100 * one['prior_share']:.0f} %",
        ]
        text.append(f"| {' | '.join(cells)} |")
    return COLUMNS + "\n".join(text) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=20, help="campaigns of each kind")
    repeats = parser.parse_args().repeats
    text = HEAD.format(repeats=repeats)
    for title, asked, region in (
        ("Flights as proposed", True, DESCRIBED),
        ("Flights drawn at random", False, DESCRIBED),
        ("Flights as proposed, over all configurations, where the quadratic does not hold", True, WHOLE),
    ):
        text += f"\n## {title}\n" + lines([campaign(seed, asked, region) for seed in range(repeats)])
    notes = OUT.with_name("flevoland_flights_notes.md")
    text += "\n" + notes.read_text(encoding="utf-8") if notes.exists() else ""
    OUT.write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
