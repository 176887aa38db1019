"""Coverage of every interval, size of every F test, calibration of every posterior, rates of the lack-of-fit decision.

    python tests/benchmarks/statistics_study.py [--sets 10000] [--sbc 400] [--out reports/statistics] [--only STUDY ...]

Finished studies are kept in OUT/results.json and not run again (delete it to start afresh), so an interrupted study
goes on. The last step writes OUT/README.md and two pictures. Set OPENBLAS_NUM_THREADS=1.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import sys
import time
from pathlib import Path

import numpy as np
from scipy import stats

sys.path.insert(0, str(Path(__file__).parents[1] / "statistical"))
sys.path.insert(0, str(Path(__file__).parent))
import sbc_samplers
import statistics_cases
from lack_of_fit_cases import DEPARTURES, rates
from statistics_cases import Row

from seqrsm.errors import ConvergenceError

LACK = "decision on lack of fit"
SBC = "calibration of posteriors"
BINS = 20


def lack_of_fit(sets: int) -> list[dict]:
    """Rates of blocking and coverage, k = 2 and 3."""
    cases: list[tuple[str, dict]] = [("equal noise", {})]
    cases += [(f"noise at the optimum {ratio} of that elsewhere", {"ratio": ratio}) for ratio in (0.4, 0.55, 0.7)]
    cases += [
        (f"{name}, {size:g} sigma", {"departure": name, "size": size})
        for name in DEPARTURES
        for size in (0.5, 1.0, 2.0)
    ]
    return [
        {"k": k, "case": name, **dataclasses.asdict(rates(k, sets, **settings))}
        for k in (2, 3)
        for name, settings in cases
    ]


def calibration(sets: int) -> list[dict]:
    """Ranks of truths drawn from the prior, of every parameter, and of a control half as wide."""
    found = []
    for name, study in sbc_samplers.STUDIES.items():
        rng, ranks, narrow, refused = np.random.default_rng(1), [], [], 0
        for i in range(10 * sets if "exact" in name else sets):  # those without a sampler cost next to nothing
            try:
                truth, draws = study(rng, i)
            except ConvergenceError:
                refused += 1
                continue
            middle = np.median(draws, axis=0)
            ranks.append(np.mean(draws < truth, axis=0))
            narrow.append(np.mean(middle + 0.5 * (draws - middle) < truth, axis=0))
        columns, wrong = np.array(ranks).T, np.array(narrow).T
        found.append(
            {
                "name": name,
                "sets": len(ranks),
                "refused": refused,
                "p": [float(stats.kstest(column, "uniform").pvalue) for column in columns],
                "control": min(float(stats.kstest(column, "uniform").pvalue) for column in wrong),
                "histograms": [np.histogram(column, BINS, (0.0, 1.0))[0].tolist() for column in columns],
            }
        )
        print(f"  {name}: p {', '.join(f'{p:.3f}' for p in found[-1]['p'])}", flush=True)
    return found


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
    for name in (*statistics_cases.STUDIES, LACK, SBC):
        if name in results or (asked.only and name not in asked.only):
            continue
        print(name, flush=True)
        begin = time.process_time()
        if name == LACK:
            rows = lack_of_fit(min(asked.sets, 2000))
        elif name == SBC:
            rows = calibration(asked.sbc)
        else:
            rows = [dataclasses.asdict(row) for row in statistics_cases.STUDIES[name](asked.sets)]
        load = os.getloadavg()[0]
        results[name] = {"rows": rows, "cpu_s": time.process_time() - begin, "load": load}
        store.write_text(json.dumps(results, indent=1), encoding="utf-8")
    write(asked.out, results)


def write(out: Path, results: dict) -> None:
    from statistics_pages import coverage_picture, page, rank_picture

    rows = {name: [Row(**row) for row in results[name]["rows"]] for name in statistics_cases.STUDIES if name in results}
    if rows:
        coverage_picture(out / "coverage.png", rows)
    if SBC in results:
        rank_picture(out / "ranks.png", results[SBC]["rows"])
    (out / "README.md").write_text(page(results, rows, LACK, SBC), encoding="utf-8")


if __name__ == "__main__":
    main()
