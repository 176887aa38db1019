"""Optimal designs against the best known ones and the clock: ``reports/designs``.

    OPENBLAS_NUM_THREADS=1 python tests/benchmarks/bench_design.py [--seeds 3] [--factors 1 2 3 4 5 6] [--out DIR]

Every row of the table of best known designs, every criterion it has a value for, by default settings from the public
function. A search that is done is kept in ``DIR/searches.csv``: the same command goes on where it was.
"""

from __future__ import annotations

import argparse
import csv
import os
import time
from collections.abc import Iterator
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
import numpy as np

from seqrsm.design.evaluate import evaluate_design
from seqrsm.design.factors import CategoricalFactor, ContinuousFactor
from seqrsm.design.optimal import optimal_design, start_design
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region

DATA = Path(__file__).parents[1] / "reference" / "data"
FIELDS = ("k", "levels", "N", "criterion", "seed", "known", "reached", "cpu_s", "hits", "starts")
SECONDS = {1: 0.1, 2: 0.1, 3: 0.1, 4: 0.5, 5: 2.0, 6: 10.0}
"""Time on one core that the project asks for."""


def build(k: int, levels: str = "") -> tuple[QuadraticModel, Region]:
    factors: list = [ContinuousFactor(f"x{i}", -1.0, 1.0) for i in range(k)]
    if levels:
        factors.append(CategoricalFactor("c", tuple("ABCDEFG"[: int(levels)])))
    return QuadraticModel(tuple(factors)), Region(tuple(factors))


def tasks(seeds: int) -> Iterator[tuple[int, str, int, str, int, float]]:
    """(k, levels, N, criterion, seed, best known value) of every search."""
    with (DATA / "optimal_designs.csv").open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    for criterion, column in (("D", "D_best"), ("I", "N_I_best")):
        for row in rows:
            if row[column]:
                for seed in range(seeds):
                    known = float(row[column])
                    yield int(row["k"]), row["categorical_levels"], int(row["N"]), criterion, seed, known


def search(k: int, levels: str, n: int, criterion: str, seed: int) -> tuple[float, float, int, int]:
    """Value reached, CPU seconds, hits and starts."""
    model, region = build(k, levels)
    began = time.process_time()
    design = optimal_design(model, region, n, criterion, seed=seed)
    seconds = time.process_time() - began
    report = evaluate_design(model, region, design.points)
    return report.d_value if criterion == "D" else report.i_value, seconds, design.hits, design.starts


def shortfall(row: dict[str, str]) -> float:
    """By how much a design misses the best known, as a share of it; < 0: better."""
    known, reached = float(row["known"]), float(row["reached"])
    return 1.0 - reached / known if row["criterion"] == "D" else reached / known - 1.0


def limit(row: dict[str, str]) -> float:
    """What the project allows."""
    return 0.005 if int(row["k"]) <= 3 else 0.02


HEAD = """# Optimal designs against the best known

`OPENBLAS_NUM_THREADS=1 python tests/benchmarks/bench_design.py` makes this page: every row of
`tests/reference/data/optimal_designs.csv`, for each criterion with a value, with the defaults of `optimal_design`.
A row counts as reached if the *worst* of its seeds is within the limit. Shortfall: as a share of the best known value;
negative is better than that. Times are CPU seconds of one search on one core; other load made them somewhat too long.

| designs | k | rows | limit | reached | worst shortfall | median CPU s | longest | asked |
|---|---|---|---|---|---|---|---|---|
"""


def write(rows: list[dict[str, str]], folder: Path) -> None:
    """README.md of ``folder``."""
    groups: dict[tuple[str, bool, int], list[dict[str, str]]] = {}
    for row in rows:
        groups.setdefault((row["criterion"], bool(row["levels"]), int(row["k"])), []).append(row)
    lines, missed = [], []
    for (criterion, mixed, k), group in sorted(groups.items()):
        cells: dict[tuple[str, str], list[dict[str, str]]] = {}
        for row in group:
            cells.setdefault((row["levels"], row["N"]), []).append(row)
        worst = {cell: max(shortfall(row) for row in some) for cell, some in cells.items()}
        bound = limit(group[0])
        good = sum(value <= bound for value in worst.values())
        seconds = [float(row["cpu_s"]) for row in group]
        name = criterion + (" with a category" if mixed else "")
        asked = "" if mixed else f"{SECONDS[k]:g}"
        lines.append(
            f"| {name} | {k} | {len(cells)} | {bound:g} | {good} | {max(worst.values()):.1e} | "
            f"{np.median(seconds):.2f} | {max(seconds):.2f} | {asked} |"
        )
        missed += [
            f"| {name} | {k} | {cell[0] if mixed else ''} | {cell[1]} | {value:.2e} | {bound:g} |"
            for cell, value in worst.items()
            if value > bound
        ]
    text = HEAD + "\n".join(lines) + "\n"
    if missed:
        text += "\n## Missed\n\n| designs | k | levels | N | shortfall | limit |\n|---|---|---|---|---|---|\n"
        text += "\n".join(missed) + "\n"
    notes = folder / "notes.md"
    text += "\n" + notes.read_text(encoding="utf-8") if notes.exists() else ""
    (folder / "README.md").write_text(text, encoding="utf-8")


def mixed_start() -> float:
    """CPU seconds of a start design of four continuous factors and one of four levels."""
    factors = (
        ContinuousFactor("frequency", 1.2, 17.0, "GHz", "log"),
        ContinuousFactor("resolution", 3.0, 50.0, "m", "log"),
        ContinuousFactor("depression_angle", 20.0, 60.0, "deg"),
        ContinuousFactor("peak_power", 10.0, 1000.0, "W", "log"),
        CategoricalFactor("polarization", ("HH", "VV", "HV", "HH+HV")),
    )
    model, region = QuadraticModel(factors), Region(factors)
    began = time.process_time()
    start_design(model, region, model.p + 6)
    return time.process_time() - began


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--factors", type=int, nargs="*", default=[1, 2, 3, 4, 5, 6])
    parser.add_argument("--criteria", nargs="*", default=["D", "I"])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--out", type=Path, default=Path("reports/designs"))
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    path = given.out / "searches.csv"
    rows: list[dict[str, str]] = []
    if path.exists():
        with path.open(newline="", encoding="utf-8") as stream:
            rows = list(csv.DictReader(stream))
    done = {tuple(row[name] for name in FIELDS[:5]) for row in rows}
    with path.open("a", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, FIELDS)
        if not rows:
            writer.writeheader()
        for k, levels, n, criterion, seed, known in tasks(given.seeds):
            key = (str(k), levels, str(n), criterion, str(seed))
            if key in done or k not in given.factors or criterion not in given.criteria:
                continue
            value, seconds, hits, starts = search(k, levels, n, criterion, seed)
            figures = (repr(known), repr(value), f"{seconds:.4f}", str(hits), str(starts))
            row = dict(zip(FIELDS, (*key, *figures), strict=True))
            rows.append(row)
            writer.writerow(row)
            stream.flush()
            print(*key, f"{shortfall(row):.2e} {seconds:.2f} s", flush=True)
    write(rows, given.out)
    print(f"start design, 4 continuous factors and one of 4 levels: {mixed_start():.3f} s")


if __name__ == "__main__":
    main()
