"""Optimal designs against the best known, and their time on one core: ``python tests/benchmarks/bench_design.py``.

Options: ``--criterion D|I``, ``--factors 3 4``, ``--seeds 3``. A ratio above 1 is better than the best known.
"""

from __future__ import annotations

import argparse
import csv
import time
from pathlib import Path

from seqrsm.design.factors import CategoricalFactor, ContinuousFactor
from seqrsm.design.optimal import optimal_design, start_design
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region

TABLE = Path(__file__).parents[1] / "reference" / "data" / "optimal_designs.csv"


def build(k: int, levels: str) -> tuple[QuadraticModel, Region]:
    factors: list = [ContinuousFactor(f"x{i}", -1.0, 1.0) for i in range(k)]
    if levels:
        factors.append(CategoricalFactor("c", tuple("ABCDEFG"[: int(levels)])))
    return QuadraticModel(tuple(factors)), Region(tuple(factors))


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--criterion", choices=("D", "I"), default="D")
    parser.add_argument("--factors", type=int, nargs="*", default=[1, 2, 3, 4, 5, 6])
    parser.add_argument("--seeds", type=int, default=3)
    options = parser.parse_args()
    optimal_design(*build(2, ""), 6, starts=2)
    print("k levels  N  p  worst ratio - 1  best ratio - 1   CPU s  hits/searches")
    with TABLE.open() as file:
        rows = [row for row in csv.DictReader(file) if int(row["k"]) in options.factors]
    for row in rows:
        if options.criterion == "I" and not row["N_I_best"]:
            continue
        model, region = build(int(row["k"]), row["categorical_levels"])
        ratios, seconds = [], []
        for seed in range(options.seeds):
            start = time.process_time()
            design = optimal_design(model, region, int(row["N"]), options.criterion, seed=seed)
            seconds.append(time.process_time() - start)
            if options.criterion == "D":
                ratios.append(design.d_value / float(row["D_best"]))
            else:
                ratios.append(float(row["N_I_best"]) / design.i_value)
        print(
            f"{row['k']} {row['categorical_levels'] or '-':>6} {row['N']:>2} {row['p']:>2}"
            f"  {min(ratios) - 1.0:+15.2e} {max(ratios) - 1.0:+15.2e}  {max(seconds):6.3f}"
            f"  {design.hits}/{design.starts}",
            flush=True,
        )
    factors = (
        ContinuousFactor("frequency", 1.2, 17.0, "GHz", "log"),
        ContinuousFactor("resolution", 3.0, 50.0, "m", "log"),
        ContinuousFactor("depression_angle", 20.0, 60.0, "deg"),
        ContinuousFactor("peak_power", 10.0, 1000.0, "W", "log"),
        CategoricalFactor("polarization", ("HH", "VV", "HV", "HH+HV")),
    )
    model, region = QuadraticModel(factors), Region(factors)
    start = time.process_time()
    start_design(model, region, model.p + 6)
    print(
        f"start design, 4 continuous and 1 categorical of 4 levels, p = {model.p}: {time.process_time() - start:.3f} s"
    )


if __name__ == "__main__":
    main()
