"""Coverage of the intervals after stopping, over whole campaigns.

    OPENBLAS_NUM_THREADS=1 python tests/studies/coverage_study.py [--campaigns 2000] [--workers 1] [--out DIR]

Every campaign starts from an optimal design, proposes by the default criterion, and stops by the default rule (guard
"runs": half-width, 3 runs a term, pure error, no lack of fit); then it makes five confirmation runs. Results are kept
after each chunk in ``DIR/chunks.csv``: the same command goes on where it was.
"""

from __future__ import annotations

import argparse
import csv
import itertools
import os
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
import sequential_surfaces as surfaces

from seqrsm.decide.intervals import confirmation_interval, counted_confirmation
from seqrsm.decide.rule import StopRule
from seqrsm.decide.stopping import Adequacy, Decision, Look, decide
from seqrsm.fit.anova import LackOfFit

CASES = {
    "quadratic, k = 2": (surfaces.quadratic, 2),
    "quadratic, k = 4": (surfaces.quadratic, 4),
    "quadratic, k = 6": (surfaces.quadratic, 6),
    "border, k = 3": (surfaces.border, 3),
    "saturating, k = 3": (surfaces.saturating, 3),
    "two humps, k = 2": (surfaces.two_humped, 2),
}
PLAIN = " as normal"
ERRORS = ("normal", "student_t", "binomial", "student_t" + PLAIN, "binomial" + PLAIN)
"""How scores scatter; the fit is told of it (errors = "student_t"; weights = "counts"), or it is not."""
SIGMAS = (1.0, 3.0)
CHUNK = 50
FIELDS = (
    "surface", "errors", "sigma", "chunk", "campaigns", "stopped", "new_run", "new_run_sq", "mean", "confirmation",
    "new_run_all", "runs", "regret", "regret_max", "seconds",
)  # fmt: skip


def noisy(truth: np.ndarray, sigma: float, errors: str, rng: np.random.Generator) -> np.ndarray:
    """Scores around ``truth``; every kind has about the standard deviation sigma at the optimum."""
    if errors == "normal":
        return truth + sigma * rng.standard_normal(truth.shape)
    if errors == "student_t":
        return truth + sigma / np.sqrt(2.0) * rng.standard_t(4.0, truth.shape)
    n = trials(sigma)
    return 100.0 * rng.binomial(n, np.clip(truth, 0.0, 100.0) / 100.0) / n


def scaled(surface: surfaces.Surface, k: int, errors: str) -> surfaces.Surface:
    """For binomial scores the surface is put between 40 (its lowest corner or random point) and 85 percent."""
    if not errors.startswith("binomial"):
        return surface
    corners = np.array(list(itertools.product((-1.0, 1.0), repeat=k)))
    low = float(surface(np.vstack([corners, np.random.default_rng(1).uniform(-1, 1, (4000, k))])).min())
    high = surfaces.true_optimum(surface, k)
    return lambda x: 40.0 + 45.0 * (surface(x) - low) / (high - low)


def trials(sigma: float) -> int:
    """Cells classified, such that the scatter at 80 percent is sigma."""
    return round(80.0 * 20.0 / sigma**2)


def decision_at(rule: StopRule, found: surfaces.Fitted, pure: int) -> Decision:
    """The rule at one look."""
    lack = found.fit.lack_of_fit()
    half = float("nan")
    # Draws of a posterior are made only where nothing else keeps the rule from holding.
    if not found.told.student or (found.fit.n_runs >= rule.min_runs(found.model.p) and pure >= rule.min_df_pure_error):
        half = found.half_width(rule.interval, rule.level, rule.replicates)
    look = Look(
        n_runs=found.fit.n_runs,
        n_terms=found.model.p,
        s=found.s,
        df_residual=found.fit.df_residual,
        df_pure_error=pure,
        h=found.h,
        half_width=half,
    )
    adequacy = Adequacy(lack.p if isinstance(lack, LackOfFit) else None, departure=found.departure)
    return decide(rule, look, adequacy)


def campaign(surface: surfaces.Surface, k: int, sigma: float, errors: str, seed: int) -> dict[str, float]:
    """One campaign to its end."""
    model, region, start = surfaces.stage(k)
    rng, eyes = np.random.default_rng(seed), np.random.default_rng(seed + 10**9)
    max_runs = max(80, 4 * model.p)
    rule = StopRule(interval="prediction_mean", half_width=1.3 * sigma, max_runs=max_runs)
    kind = errors.removesuffix(PLAIN)
    told = surfaces.Told(errors, trials(sigma))
    X, y = start, noisy(surface(start), sigma, kind, rng)
    while True:
        spent = len(y) >= max_runs
        least = 0 if spent else rule.min_runs(model.p)
        found = surfaces.fit_scores(model, region, X, y, told, least)
        if found.fit.n_runs >= least:  # with fewer the rule cannot hold
            decision = decision_at(rule, found, surfaces.pure_error(found))
            if decision.held or spent:
                break
        new = surfaces.next_points(found, k, X, 4, rng, seed * 131 % 2**31 + len(X))
        X, y = np.vstack([X, new]), np.append(y, noisy(surface(new), sigma, kind, rng))
    truth = float(surface(found.point[None, :])[0])
    fresh = noisy(np.full(500, truth), sigma, kind, eyes)
    five = noisy(np.full(5, truth), sigma, kind, eyes)
    if kind == "binomial":
        n = trials(sigma)
        confirmed = counted_confirmation(np.round(five * n / 100.0), np.full(5, n))
    else:
        confirmed = confirmation_interval(five)

    def covered(values: np.ndarray, kind: str) -> float:
        low, high = found.ends(kind)
        return float(np.mean((values >= low) & (values <= high)))

    return {
        "stopped": float(decision.held),
        "new_run": covered(fresh, "prediction"),
        "mean": covered(np.array([truth]), "confidence"),
        "confirmation": float(confirmed.low <= truth <= confirmed.high),
        "runs": float(len(y)),
        "regret": surfaces.true_optimum(surface, k) - truth,
    }


def chunk(task: tuple[str, str, float, int, int]) -> dict[str, object]:
    """``CHUNK`` campaigns of one cell."""
    name, errors, sigma, number, size = task
    make, k = CASES[name]
    began, rows = time.perf_counter(), []
    for i in range(size):
        seed = 1_000_003 * (1 + list(CASES).index(name)) + number * CHUNK + i
        surface = scaled(make(np.random.default_rng(seed), k), k, errors)
        rows.append(campaign(surface, k, sigma, errors, seed))
    held = [row for row in rows if row["stopped"]]
    return {
        "surface": name, "errors": errors, "sigma": sigma, "chunk": number, "campaigns": len(rows),
        "stopped": len(held), "new_run": sum(r["new_run"] for r in held),
        "new_run_sq": sum(r["new_run"] ** 2 for r in held), "mean": sum(r["mean"] for r in held),
        "confirmation": sum(r["confirmation"] for r in rows), "new_run_all": sum(r["new_run"] for r in rows),
        "runs": float(np.median([r["runs"] for r in rows])), "regret": float(np.median([r["regret"] for r in rows])),
        "regret_max": max(r["regret"] for r in rows), "seconds": time.perf_counter() - began,
    }  # fmt: skip


def todo(done: set[tuple[str, str, float, int]], campaigns: int, names: list[str], kinds: list[str]) -> Iterator[tuple]:
    """Chunks that are missing, one round over all cells at a time, so that an early end leaves an even table.

    Scores that the fit is not told of have every fourth round.
    """
    for number in range(-(-campaigns // CHUNK)):
        for name in names:
            for errors in kinds:
                if errors.endswith(PLAIN) and number % 4:
                    continue
                for sigma in SIGMAS:
                    if (name, errors, sigma, number) not in done:
                        yield name, errors, sigma, number, min(CHUNK, campaigns - number * CHUNK)


def read(path: Path) -> list[dict[str, str]]:
    if not path.exists():
        return []
    with path.open(newline="", encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


def summary(rows: list[dict[str, str]]) -> list[dict[str, object]]:
    """One line for each cell."""
    table = []
    for name in CASES:
        for errors in ERRORS:
            for sigma in SIGMAS:
                cell = [r for r in rows if (r["surface"], r["errors"], float(r["sigma"])) == (name, errors, sigma)]
                if not cell:
                    continue

                def total(key: str, cell=cell) -> float:
                    return sum(float(r[key]) for r in cell)

                n, held = total("campaigns"), max(total("stopped"), 1.0)
                new, mean, confirmed = total("new_run") / held, total("mean") / held, total("confirmation") / n
                spread = max(total("new_run_sq") / held - new**2, 0.0)
                table.append(
                    {
                        "surface": name, "errors": errors, "sigma": sigma, "campaigns": int(n),
                        "stopped": total("stopped") / n, "new_run": new, "new_run_se": float(np.sqrt(spread / held)),
                        "new_run_all": total("new_run_all") / n,
                        "mean": mean, "mean_se": float(np.sqrt(mean * (1.0 - mean) / held)),
                        "confirmation": confirmed,
                        "confirmation_se": float(np.sqrt(confirmed * (1 - confirmed) / n)),
                        "runs": float(np.mean([float(r["runs"]) for r in cell])),
                        "regret": float(np.mean([float(r["regret"]) for r in cell])),
                    }
                )  # fmt: skip
    return table


HEAD = """# Coverage after stopping

`OPENBLAS_NUM_THREADS=1 python tests/studies/coverage_study.py` regenerates this page, goes on where it was, and takes
`--workers N`. Every campaign has its own random surface and noise. It begins with an optimal design of p + 6 runs,
makes batches of 4 by the default criterion, and stops by the default rule on the prediction interval of the mean of
five runs (target 1.3 sigma, budget max(80, 4p)). Then it makes five confirmation runs. Scores scatter normally, by a Student t with 4 degrees of freedom, or as counts, with about the standard deviation
sigma at the optimum; the fit is told of it (`errors = "student_t"`; `weights = "counts"`) or fits them *as normal*.
Surfaces for counts are put between 40 and 85 percent.

*New run* is the coverage of the 95 % interval of one new run at the recommended settings, among the campaigns that
stopped by the rule (500 fresh runs each, so that its error is that of the campaigns). *Mean* is the same for the interval of the mean; *confirmation* is the coverage of the interval of the five fresh runs (t; of counts a score interval). ± is one Monte Carlo
standard error. Runs and regret (score units) are medians by chunk of 50, averaged.

![Coverage by surface and errors](coverage.png)

| surface | errors | sigma | campaigns | stopped | new run | mean | confirmation | runs | regret |
|---|---|---|---|---|---|---|---|---|---|
"""  # noqa: E501


def write(table: list[dict[str, object]], folder: Path) -> None:
    """README, CSV and plot."""
    with (folder / "coverage.csv").open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, list(table[0]))
        writer.writeheader()
        writer.writerows(table)
    lines = [
        f"| {r['surface']} | {r['errors']} | {r['sigma']:g} | {r['campaigns']} | {100 * r['stopped']:.0f} % | "
        f"{100 * r['new_run']:.1f} ± {100 * r['new_run_se']:.1f} % | "
        f"{100 * r['mean']:.1f} ± {100 * r['mean_se']:.1f} % | "
        f"{100 * r['confirmation']:.1f} ± {100 * r['confirmation_se']:.1f} % | "
        f"{r['runs']:.0f} | {r['regret']:.2f} |"
        for r in table
    ]
    notes = folder / "notes.md"
    tail = "\n" + notes.read_text(encoding="utf-8") if notes.exists() else ""
    (folder / "README.md").write_text(HEAD + "\n".join(lines) + "\n" + tail, encoding="utf-8")
    plot(table, folder / "coverage.png")


def plot(table: list[dict[str, object]], path: Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(9, 5), layout="constrained")
    axes.axhspan(94, 96, color="0.9", label="95 ± 1 %")
    names = list(dict.fromkeys(r["surface"] for r in table))
    marks = {"normal": "o", "student_t": "s", "binomial": "^", "student_t as normal": "x", "binomial as normal": "+"}
    for i, (errors, mark) in enumerate(marks.items()):
        cells = [r for r in table if r["errors"] == errors]
        shift = 0.16 * (i - 2)
        x = [names.index(r["surface"]) + shift + (0.06 if r["sigma"] == SIGMAS[1] else 0.0) for r in cells]
        y = [100 * r["new_run"] for r in cells]
        bars = [200 * r["new_run_se"] for r in cells]
        axes.errorbar(x, y, yerr=bars, fmt=mark, capsize=2, label=errors.replace("_", "-"))
    axes.set_xticks(range(len(names)), names)
    axes.set_ylabel("coverage of 95 % intervals after stopping [%]")
    axes.set_ylim(86, 100)
    axes.legend(loc="lower left", fontsize=8, title="new run; bars: 2 s.e.", ncols=2)
    figure.savefig(path, dpi=120)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--campaigns", type=int, default=2000, help="for each cell")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--minutes", type=float, default=1e9, help="begin no chunk after this time")
    parser.add_argument("--surfaces", nargs="+", default=list(CASES), choices=list(CASES))
    parser.add_argument("--errors", nargs="+", default=list(ERRORS), choices=list(ERRORS))
    parser.add_argument("--out", type=Path, default=Path("reports/coverage"))
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    path = given.out / "chunks.csv"
    rows = read(path)
    done = {(r["surface"], r["errors"], float(r["sigma"]), int(r["chunk"])) for r in rows}
    tasks = list(todo(done, given.campaigns, given.surfaces, given.errors))
    end = time.perf_counter() + 60 * given.minutes
    new = not path.exists()
    with path.open("a", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, FIELDS)
        if new:
            writer.writeheader()
        pool = ProcessPoolExecutor(given.workers, mp_context=get_context("spawn")) if given.workers > 1 else None
        for first in range(0, len(tasks), given.workers):
            if time.perf_counter() > end:
                break
            some = tasks[first : first + given.workers]
            for row in pool.map(chunk, some) if pool else map(chunk, some):
                writer.writerow(row)
                stream.flush()
                print(row["surface"], row["errors"], row["sigma"], row["chunk"], f"{row['seconds']:.0f} s", flush=True)
        if pool:
            pool.shutdown()
    write(summary(read(path)), given.out)


if __name__ == "__main__":
    main()
