"""Common random numbers: do intervals cover with occasions fitted as blocks, and without?

    python tests/studies/common_random_numbers.py

One design is simulated on many occasions, every setting on each, by the full simulation. What a score differs from its
setting's mean over all occasions is the error of a run, and the errors of one occasion are correlated as the engine
makes them. Campaigns are drawn from these: runs dealt out to shared occasions as the program does, or each on one of
its own; fitted with the blocks, without, and as independent runs. The truth is then known to be flat.
"""

from __future__ import annotations

import argparse
import json
import os
from pathlib import Path
from tempfile import gettempdir

import numpy as np
import speed_accuracy_study as study
from speed_accuracy_study import CROPS, LAND, PASSIVE, RADAR, RADAR_FACTORS, RADIOMETER, Site, synthetic

from seqrsm.analysis.runs import REACH, occasion_of, share_occasions, similarity
from seqrsm.campaign.simulation import carry_out
from seqrsm.design.optimal import optimal_design
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.fit.blocks import fit_random_blocks
from seqrsm.fit.least_squares import fit_least_squares
from seqrsm.store.records import NewRun

OUT = study.OUT / "common-random-numbers.md"
KEPT = Path(gettempdir()) / f"seqrsm-study-{os.getuid()}-common-random-numbers.json"
"""What was simulated so far: interrupted, the same command goes on."""
OCCASIONS, RUNS, SIZE, CAMPAIGNS, LEVEL, SEVERAL = 1000, 32, 8, 4000, 0.95, 5
SITES = (
    Site("fields", "psm", RADAR_FACTORS, RADAR,
         synthetic=synthetic(200, 5.0, CROPS, 3.0, 100.0)),
    Site("land", "prm", PASSIVE, RADIOMETER,
         synthetic=synthetic(200, 15.0, LAND, 3.0, 300.0)),
)  # fmt: skip
WAYS = (
    "shared occasions, fitted as blocks",
    "the same, one number for each block",
    "shared occasions, blocks forgotten",
    "an occasion for each run",
)
ASKED = ("mean", "one new run", f"mean of {SEVERAL} new runs", "difference of far settings", "difference of near ones")


def points_of(site: Site) -> np.ndarray:
    """Coded settings (n, 2): an optimal design and a grid, so that occasions can hold settings apart."""
    region = study.region_of(site)
    chosen = optimal_design(QuadraticModel(region.factors, 2), region, 12, seed=1).points
    grid = np.array([(x, y) for x in (-1.0, -0.33, 0.33, 1.0) for y in (-1.0, -0.33, 0.33, 1.0)])
    return np.vstack([chosen, grid, np.zeros((RUNS - 28, 2))])


def measured(site: Site, kept: dict[str, list[list[float]]]) -> np.ndarray:
    """Errors (occasions, settings) of runs; made in pieces, each kept."""
    settings = study.region_of(site).decode(points_of(site))
    rows = kept.setdefault(site.name, [])
    while len(rows) < OCCASIONS:
        for stream in range(len(rows) + 1, len(rows) + 51):
            rows.append([carry_out(study.task(site, own, 7, stream)).scores[0].score for own in settings])
        KEPT.write_text(json.dumps(kept))
        print(site.name, len(rows), flush=True)
    scores = np.array(rows)
    return scores - scores.mean(axis=0)


def pairs_of(points: np.ndarray) -> tuple[int, int, int]:
    """Numbers of the setting that is asked for, of a far one, and of a near one."""
    asked, other = int(np.argmax(points.sum(axis=1))), int(np.argmin(points.sum(axis=1)))
    return asked, other, int(np.argmin(np.square(points - points[asked] + [0.0, 0.67]).sum(axis=1)))


Table = dict[tuple[str, str], tuple[float, float]]


def coverage(site: Site, errors: np.ndarray) -> Table:
    """Share of intervals that hold the truth and their mean half-width, by way and what is asked."""
    region, points = study.region_of(site), points_of(site)
    model = QuadraticModel(region.factors, 2)
    Z, rng = model.matrix(points), np.random.default_rng(5)
    asked, other, near = pairs_of(points)
    rows, alike = np.vstack([Z[asked], Z[asked] - Z[other], Z[asked] - Z[near]]), similarity(region.factors, points)
    hits: dict[tuple[str, str], list[tuple[bool, float]]] = {}
    numbers = np.zeros(RUNS, dtype=int)
    for _ in range(CAMPAIGNS):
        order = rng.permutation(RUNS)
        runs = [NewRun(settings) for settings in region.decode(points[order])]
        dealt = share_occasions(runs, (), size=SIZE, region=region)
        numbers[order] = [occasion_of(run.source, run.block) or 0 for run in dealt]
        streams = rng.permutation(OCCASIONS)
        shared = errors[streams[numbers], np.arange(RUNS)]
        alone = errors[streams[:RUNS], np.arange(RUNS)]
        future = errors[streams[-SEVERAL:], asked]
        with_blocks = fit_random_blocks(Z, shared, numbers.tolist(), similarity=alike)
        one_number = fit_random_blocks(Z, shared, numbers.tolist())
        for way, predict in (
            (WAYS[0], lambda m, fit=with_blocks: fit.predict(rows, LEVEL, replicates=m, apart=True)),
            (WAYS[1], lambda m, fit=one_number: fit.predict(rows, LEVEL, replicates=m, apart=True)),
            (WAYS[2], lambda m, y=shared: fit_least_squares(Z, y, model.terms).predict(rows, LEVEL, replicates=m)),
            (WAYS[3], lambda m, y=alone: fit_least_squares(Z, y, model.terms).predict(rows, LEVEL, replicates=m)),
        ):
            one, several = predict(1), predict(SEVERAL)
            for what, interval, k, truth in zip(
                ASKED,
                (one.confidence, one.prediction, several.prediction, one.confidence, one.confidence),
                (0, 0, 0, 1, 2),
                (0.0, future[0], future.mean(), 0.0, 0.0),
                strict=True,
            ):
                low, high = float(interval.low[k]), float(interval.high[k])
                hits.setdefault((way, what), []).append((low <= truth <= high, 0.5 * (high - low)))
    return {key: (float(np.mean([h for h, _ in x])), float(np.mean([w for _, w in x]))) for key, x in hits.items()}


HEAD = """# Common random numbers: coverage with and without occasions as blocks

Written by `python tests/studies/common_random_numbers.py`. A design of {runs} runs over frequency and resolution was
simulated on {occasions} occasions, every setting on each, by the full simulation of a small drawn site (200 x 200
cells). {campaigns} campaigns were drawn from these errors: runs assigned to occasions of at most {size} by the
program's rule (similar settings are separated), or each on its own occasion. New runs have their own occasions. The
intervals should cover {level:.0f} %; as the campaigns are drawn from the same {occasions} occasions,
Monte Carlo errors are some {error:.1f} points.

Errors of different settings of one occasion are correlated, by {low:.2f} to {high:.2f} (mean {mean:.2f}) for the radar
and by {low2:.2f} to {high2:.2f} (mean {mean2:.2f}) for the radiometer: the
nearer, the more. The random effect of a block changes with the settings accordingly, over {reach:g} coded units.
"""


def page(found: list[tuple[Site, Table, np.ndarray]]) -> str:
    spread = []
    for _, _, errors in found:
        distinct = np.unique(points_of(SITES[0]), axis=0, return_index=True)[1]
        pairs = np.corrcoef(errors[:, distinct].T)[np.triu_indices(len(distinct), 1)]
        spread.append((float(pairs.min()), float(pairs.max()), float(pairs.mean())))
    (low, high, mean), (low2, high2, mean2) = spread
    error = 100.0 * float(np.sqrt(0.05 * 0.95 / (OCCASIONS / 4)))
    lines = [
        HEAD.format(
            runs=RUNS, occasions=OCCASIONS, campaigns=CAMPAIGNS, size=SIZE, level=100 * LEVEL, error=error,
            reach=REACH, low=low, high=high, mean=mean, low2=low2, high2=high2, mean2=mean2,
        ),
        "| site | way | " + " | ".join(f"{what}: covered (half-width)" for what in ASKED) + " |",
        "|---|---|" + "---|" * len(ASKED),
    ]  # fmt: skip
    for site, table, _ in found:
        engine = "radar" if site.engine == "psm" else "radiometer"
        for way in WAYS:
            cells = (table[way, what] for what in ASKED)
            lines.append(
                f"| {site.name}, {engine} | {way} | "
                + " | ".join(f"{100 * share:.1f} % (± {width:.2f})" for share, width in cells) + " |"
            )  # fmt: skip
    lines += ["", *_words(found), ""]
    return "\n".join(lines)


def _words(found: list[tuple[Site, Table, np.ndarray]]) -> list[str]:
    blocks, one_number, forgotten, alone = WAYS
    mean, far, near = ASKED[0], *ASKED[3:]
    out = []
    for site, table, errors in found:
        asked, far_one, near_one = pairs_of(points_of(site))
        taken = similarity(study.region_of(site).factors, points_of(site))[asked]
        measured_as = np.corrcoef(errors.T)[asked]
        parts = {key: 100.0 * table[key][0] for key in table}
        change = {what: 100.0 * (table[blocks, what][1] / table[alone, what][1] - 1.0) for what in (mean, far, near)}
        out.append(
            f"- {site.name}: forgetting the blocks lets the interval of the mean cover {parts[forgotten, mean]:.1f} % "
            f"instead of {parts[blocks, mean]:.1f} %; one number for each block lets that of the difference of far "
            f"settings cover {parts[one_number, far]:.1f} % instead of {parts[blocks, far]:.1f} %. Against runs with "
            f"occasions of their own, the length of intervals changes by {change[mean]:+.0f} % (mean), "
            f"{change[far]:+.0f} % (difference of far settings) and {change[near]:+.0f} % (of near ones). Errors of "
            f"the far settings are correlated by {measured_as[far_one]:.2f}, where the fit takes {taken[far_one]:.2f} "
            f"of the block's share; of the near ones by {measured_as[near_one]:.2f} and {taken[near_one]:.2f}"
            + (
                ": near settings differ by more of their own than one law for the region says, which few and coarse "
                "pixels on a small site make, and the interval of their difference covers too little."
                if parts[blocks, near] < 92.0
                else "."
            )
        )
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.parse_args()
    kept = json.loads(KEPT.read_text()) if KEPT.exists() else {}
    found = []
    for site in SITES:
        errors = measured(site, kept)
        found.append((site, coverage(site, errors), errors))
    OUT.write_text(page(found), encoding="utf-8")
    print(f"wrote {OUT}; load {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
