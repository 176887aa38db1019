"""Coverage of every interval, size of every F test, calibration of every posterior.

    python tests/studies/statistics_study.py [--sets 10000] [--sbc 400] [--out reports/statistics] [--only STUDY ...]

Finished parts of studies are kept in OUT/results.json and not run again with as many data sets or fewer (delete it to
start afresh), so an interrupted study goes on. The last step writes OUT/README.md and two pictures. Set
OPENBLAS_NUM_THREADS=1; all of it takes about half an hour of one core.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from scipy import stats

sys.path.insert(0, str(Path(__file__).parents[1] / "statistical"))
sys.path.insert(0, str(Path(__file__).parent))
import sbc_samplers
import statistics_cases as cases
import told_optimum
from statistics_cases import Row, Study

from seqrsm.errors import ConvergenceError

SBC = "calibration of posteriors"
TOLD = "at the recommended settings"
ANALYSES = 25
"""Data sets of a formula for each one that goes through the whole analysis."""
COVERAGE: dict[str, dict[str, Study]] = {
    "settings fixed beforehand": {"all": cases.fixed_settings},
    "random blocks": {"all": cases.random_day},
    TOLD: {
        **{f"k = {k}": partial(told_optimum.at_the_optimum, k=k) for k in (2, 3, 4)},
        **{name: partial(told_optimum.at_the_optimum, k=3, name=name) for name in list(told_optimum.CASES)[1:]},
    },
    "F tests": {"all": cases.f_tests},
}
"""Studies and their parts; an interrupted study goes on with the part it was in."""
STUDIES = (*COVERAGE, SBC)
BINS = 20


def calibration(sets: int, name: str) -> list[dict]:
    """Ranks of truths drawn from the prior, of every parameter, and of a control half as wide."""
    rng, ranks, narrow, refused = np.random.default_rng(1), [], [], 0
    for i in range(10 * sets if "exact" in name else sets):  # those without a sampler cost next to nothing
        try:
            truth, draws = sbc_samplers.STUDIES[name](rng, i)
        except ConvergenceError:
            refused += 1
            continue
        middle = np.median(draws, axis=0)
        ranks.append(np.mean(draws < truth, axis=0))
        narrow.append(np.mean(middle + 0.5 * (draws - middle) < truth, axis=0))
    columns, wrong = np.array(ranks).T, np.array(narrow).T
    found = {
        "name": name,
        "sets": len(ranks),
        "refused": refused,
        "p": [float(stats.kstest(column, "uniform").pvalue) for column in columns],
        "control": min(float(stats.kstest(column, "uniform").pvalue) for column in wrong),
        "histograms": [np.histogram(column, BINS, (0.0, 1.0))[0].tolist() for column in columns],
    }
    return [found]


def parts(study: str, sets: int, sbc: int) -> dict[str, tuple[int, Callable[[], list[dict]]]]:
    """Parts of a study by name: data sets asked for, and what makes the rows."""
    if study == SBC:
        return {name: (sbc, partial(calibration, sbc, name)) for name in sbc_samplers.STUDIES}
    sets = sets // ANALYSES if study == TOLD else sets
    return {
        name: (sets, lambda make=make: [dataclasses.asdict(row) for row in make(sets)])
        for name, make in COVERAGE[study].items()
    }


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--sets", type=int, default=10_000)
    parser.add_argument("--sbc", type=int, default=400)
    parser.add_argument("--out", type=Path, default=Path("reports/statistics"))
    parser.add_argument("--only", nargs="*", default=[])
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    store = asked.out / "results.json"
    results = json.loads(store.read_text(encoding="utf-8")) if store.exists() else {}
    for study in STUDIES:
        if asked.only and study not in asked.only:
            continue
        done = results.setdefault(study, {})
        for name, (sets, make) in parts(study, asked.sets, asked.sbc).items():
            if name in done and done[name]["asked"] >= sets:
                continue
            print(f"{study}, {name}: {sets} data sets", flush=True)
            begin = time.process_time()
            rows = make()
            cpu = time.process_time() - begin
            done[name] = {"asked": sets, "rows": rows, "cpu_s": cpu, "load": os.getloadavg()[0]}
            # Whole or not at all, and in one order however the parts were made.
            ordered = {key: results[key] for key in STUDIES if results.get(key)}
            unfinished = store.with_suffix(".part")
            unfinished.write_text(json.dumps(ordered, indent=1), encoding="utf-8")
            unfinished.replace(store)
    write(asked.out, {key: joined(results[key]) for key in STUDIES if results.get(key)})


def joined(found: dict) -> dict:
    """The rows of all parts of a study, its CPU time and the largest load of the machine."""
    return {
        "rows": [row for part in found.values() for row in part["rows"]],
        "cpu_s": sum(part["cpu_s"] for part in found.values()),
        "load": max(part["load"] for part in found.values()),
    }


def write(out: Path, results: dict) -> None:
    from statistics_pages import coverage_picture, page, rank_picture

    rows = {name: [Row(**row) for row in results[name]["rows"]] for name in COVERAGE if name in results}
    if rows:
        coverage_picture(out / "coverage.png", rows)
    if SBC in results:
        rank_picture(out / "ranks.png", results[SBC]["rows"])
    (out / "README.md").write_text(page(results, rows, SBC), encoding="utf-8")


if __name__ == "__main__":
    main()
