"""What moving and zooming is worth: final true regret and coverage against the fixed whole-region quadratic.

    python tests/studies/zoom_study.py [--repeats 40] [--runs 80] [--out reports/coverage]

Pairs by seed: both campaigns of a pair see the same surface, start runs and noise stream. Set OPENBLAS_NUM_THREADS=1.
"""

from __future__ import annotations

import argparse
import csv
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
import sequential_surfaces as surfaces

CASES = {
    "saturating, k = 4": (surfaces.saturating, 4),
    "asymmetric, k = 3": (surfaces.asymmetric, 3),
    "two humps, k = 2": (surfaces.two_humped, 2),
    "plateau, k = 3": (surfaces.plateau, 3),
    "quadratic, k = 3": (surfaces.quadratic, 3),
    "quadratic, k = 4": (surfaces.quadratic, 4),
    "quadratic, border, k = 3": (surfaces.border, 3),
}
CHECKPOINTS = (40, 60, 80, 120)


def campaign(surface, k: int, sigma: float, n_runs: int, seed: int, moving: bool) -> list[dict[str, float]]:
    model, region, start = surfaces.stage(k)
    rng = np.random.default_rng(seed + 1000)
    eyes = np.random.default_rng(seed + 5000)  # what is measured must not change what is done
    X, y = start, surface(start) + sigma * rng.standard_normal(len(start))
    plan, state = surfaces.begin(k, n_runs, moving)
    best, rows, batch = surfaces.true_optimum(surface, k), [], 1
    while True:
        state = surfaces.step(plan, state, X, y, batch)
        found = surfaces.fit_box(state, model, region, X, y, moving=moving)
        if any(c <= len(X) < c + 4 for c in CHECKPOINTS):
            truth = float(surface(found.point))
            fresh = truth + sigma * eyes.standard_normal(400)

            def covered(values: np.ndarray, kind: str, found=found) -> float:
                low, high = found.ends(kind)
                return float(np.mean((values >= low) & (values <= high)))

            half = 0.5 * (np.array(state.box.high) - np.array(state.box.low))
            rows.append(
                {
                    "runs": max(c for c in CHECKPOINTS if c <= len(X)),
                    "regret": best - truth,
                    "mean": covered(np.array([truth]), "confidence"),
                    "new_run": covered(fresh, "prediction"),
                    "half_width": float(np.diff(found.ends("confidence"))[0]) / 2.0,
                    "box": float(half.max()),
                }
            )
        if len(X) >= n_runs:
            return rows
        new = surfaces.next_points(state, found, k, X, 4, rng, seed * 131 + len(X))
        X = np.vstack([X, new])
        y = np.append(y, surface(new) + sigma * rng.standard_normal(len(new)))
        batch += 1


def study(repeats: int, n_runs: int, sigmas: tuple[float, ...], first: int) -> list[dict[str, object]]:
    table = []
    for sigma in sigmas:
        for name, (make, k) in CASES.items():
            found: dict[tuple[int, bool], list[dict[str, float]]] = {}
            began = time.perf_counter()
            for seed in range(first, first + repeats):
                surface = make(np.random.default_rng(seed), k)
                for moving in (False, True):
                    for row in campaign(surface, k, sigma, n_runs, seed, moving):
                        found.setdefault((int(row["runs"]), moving), []).append(row)
            for runs in sorted({key[0] for key in found}):
                fixed, zoomed = found[runs, False], found[runs, True]

                def median(rows, key="regret"):
                    return float(np.median([row[key] for row in rows]))

                def mean(rows, key):
                    return float(np.mean([row[key] for row in rows]))

                ratios = np.array([row["regret"] for row in zoomed]), np.array([row["regret"] for row in fixed])
                table.append(
                    {
                        "surface": name, "sigma": sigma, "runs": runs, "repeats": len(fixed),
                        "regret_fixed": median(fixed), "regret_zoom": median(zoomed),
                        "regret_fixed_mean": mean(fixed, "regret"), "regret_zoom_mean": mean(zoomed, "regret"),
                        "better": float(np.mean(ratios[0] < ratios[1])),
                        "new_run_fixed": mean(fixed, "new_run"), "new_run_zoom": mean(zoomed, "new_run"),
                        "new_run_zoom_se": float(np.std([r["new_run"] for r in zoomed]) / np.sqrt(len(zoomed))),
                        "mean_fixed": mean(fixed, "mean"), "mean_zoom": mean(zoomed, "mean"),
                        "half_width_fixed": median(fixed, "half_width"),
                        "half_width_zoom": median(zoomed, "half_width"), "box": median(zoomed, "box"),
                    }
                )  # fmt: skip
                print({k: round(v, 3) if isinstance(v, float) else v for k, v in table[-1].items()}, flush=True)
            print(f"{name}: {time.perf_counter() - began:.0f} s", flush=True)
    return table


LINE = (
    "| {surface} | {sigma:g} | {runs} | {regret_fixed:.3f} ({regret_fixed_mean:.2f}) | "
    "{regret_zoom:.3f} ({regret_zoom_mean:.2f}) | {ratio:.2f} | {better:.0f} % | {new_run_fixed:.1f} % | "
    "{new_run_zoom:.1f} ± {new_run_zoom_se:.1f} % | {mean_fixed:.0f} % | {mean_zoom:.0f} % | {half_width_fixed:.2f} | "
    "{half_width_zoom:.2f} | {box:.2f} |"
)
HEAD = """# Moving and zooming against the fixed whole-region quadratic

`python tests/studies/zoom_study.py --repeats {repeats} --runs {runs}`: pairs of campaigns on the same randomly drawn
surface (defined in `tests/studies/sequential_surfaces.py`), start design of p + 6 runs, batches of 4 by the default
criterion. *Fixed* keeps the quadratic over the whole region; *zoom* is the default of `[model] region = "adaptive"`.
Regret is the true optimum less the true mean at the recommended settings, in score units (medians, with means in
brackets); coverage is that of the 95 % prediction interval of one new run there, and of the confidence interval of the
mean; *box* is the median half-width of the fitted box (1: the whole region).

| surface | sigma | runs | regret fixed | regret zoom | ratio | zoom better in | new run covered: fixed | zoom | mean covered: fixed | zoom | half-width of the mean: fixed | zoom | box |
|---|---|---|---|---|---|---|---|---|---|---|---|---|---|
"""  # noqa: E501


def write(table: list[dict[str, object]], folder: Path, repeats: int, runs: int) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "zoom.csv").open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, list(table[0]))
        writer.writeheader()
        writer.writerows(table)
    lines = []
    for row in table:
        ratio = row["regret_zoom"] / row["regret_fixed"] if row["regret_fixed"] else float("nan")
        fields = {**row, "ratio": ratio}
        for key in ("better", "new_run_fixed", "new_run_zoom", "new_run_zoom_se", "mean_fixed", "mean_zoom"):
            fields[key] = 100 * row[key]
        lines.append(LINE.format(**fields))
    notes = folder / "zoom_notes.md"
    tail = "\n" + notes.read_text(encoding="utf-8") if notes.exists() else ""
    text = HEAD.format(repeats=repeats, runs=runs) + "\n".join(lines) + "\n" + tail
    (folder / "zoom.md").write_text(text, encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=40)
    parser.add_argument("--runs", type=int, default=80)
    parser.add_argument("--first", type=int, default=1000, help="first seed; 0 to 23 chose the numbers of the rule")
    parser.add_argument("--sigma", type=float, nargs="+", default=[1.0, 2.0])
    parser.add_argument("--out", type=Path, default=Path("reports/coverage"))
    given = parser.parse_args()
    table = study(given.repeats, given.runs, tuple(given.sigma), given.first)
    write(table, given.out, given.repeats, given.runs)


if __name__ == "__main__":
    main()
