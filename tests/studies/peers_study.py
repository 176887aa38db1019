"""seqrsm and Bayesian-optimisation packages on the same kinds of surfaces and budgets: ``reports/peers``.

    python tests/studies/peers_study.py [--mode budget] [--kinds NAME...] [--drivers NAME...] [--seeds 0:20] [--out DIR]

``--mode budget`` compares what is recommended when the budget is spent. ``--mode stop`` runs ``seqrsm`` alone until its
stop rule holds (at most 80 runs), and counts how often what it tells is true; ``--mode many`` does so of 400 scores of
random settings that were there before. The kinds are in :mod:`kinds`, what runs
a campaign in :mod:`peers_drivers`. Every finished campaign is kept in ``DIR/campaigns.csv``: the same command goes on
where it was, and writes the page anew (``--seeds 0:0`` only writes it).

The packages are no part of ``seqrsm`` and go into an environment of their own, first of all a build of PyTorch without
CUDA, which is much smaller than the default (here torch 2.13.0+cpu), then ``seqrsm`` and the rest:

    python -m venv PEERS && PEERS/bin/pip install torch && PEERS/bin/pip install -e . botorch optuna ax-platform baybe

Without them ``--drivers seqrsm``, the default, works all the same. One campaign takes a package 5 to 25 CPU seconds.
"""

from __future__ import annotations

import argparse
import csv
import importlib.metadata
import math
import os
import sys
import time
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from kinds import KINDS, Array, Drawn, true_optimum
from peers_drivers import DRIVERS, STOP_INTERVAL, Answer, Interval, many

LONGEST = 80
"""Runs at which a campaign of the mode "stop" ends."""
MANY = 400
"""Runs of the mode "many"."""
LIMIT = 0.625
"""Loss whose chance ``seqrsm`` tells: a quarter of the half-width asked for."""
NEW = 400
"""New runs, and means of new runs, by which the coverage of one campaign's intervals is counted."""
FIELDS = (
    "kind", "driver", "mode", "seed", "version", "runs", "stopped", "regret", "bias", "half_width", "covered",
    "new_run", "mean_of_several", "places", "told_loss", "told_chance", "above", "cpu_s",
)  # fmt: skip
Row = dict[str, str]


def campaign(name: str, driver: str, mode: str, seed: int) -> dict[str, object]:
    """One campaign of one driver on one surface, and whether what it told is true."""
    drawn = KINDS[name].draw(seed)
    more = {"stops": mode == "stop"} if driver == "seqrsm" and mode != "many" else {}
    distribution, run = DRIVERS[driver]
    run, budget = (many, MANY) if mode == "many" else (run, LONGEST if mode == "stop" else drawn.kind.runs)
    began = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        answer = run(drawn, seed, budget, **more)
    seconds = time.process_time() - began
    told = {
        "kind": name,
        "driver": driver,
        "mode": mode,
        "seed": seed,
        "version": f"{distribution} {importlib.metadata.version(distribution)}",
        "cpu_s": round(seconds, 3),
    }
    found = told | judged(drawn, answer, seed)
    return {key: float(f"{value:.6g}") if isinstance(value, float) else value for key, value in found.items()}


def judged(drawn: Drawn, answer: Answer, seed: int) -> dict[str, object]:
    """An answer beside the truth."""
    best, top = true_optimum(drawn)
    truth = float(drawn.value(answer.point[None, :])[0])
    rng, at = np.random.default_rng([seed, 11]), np.tile(answer.point, (answer.replicates, 1))
    if drawn.kind.of_day:
        scores = np.concatenate([drawn.score(at, rng) for _ in range(NEW)])
    else:
        scores = drawn.score(np.tile(at, (NEW, 1)), rng)
    means = scores.reshape(NEW, answer.replicates).mean(axis=1)
    places = [
        low - 1e-9 <= best[j] <= high + 1e-9 for j, (low, high) in answer.places.items() if matters(drawn, best, j)
    ]
    return {
        "runs": answer.runs,
        "stopped": float(answer.stopped),
        "regret": top - truth,
        "bias": answer.mean - truth,
        "half_width": 0.5 * (answer.confidence[1] - answer.confidence[0]),
        "covered": share(answer.confidence, np.array([truth])),
        "new_run": share(answer.prediction, scores),
        "mean_of_several": share(answer.prediction_mean, means),
        "places": float(np.mean(places)) if places else math.nan,
        "told_loss": answer.loss,
        "told_chance": answer.chance,
        "above": float(top - truth > answer.limit) if np.isfinite(answer.limit) else math.nan,
    }


def matters(drawn: Drawn, best: Array, j: int) -> bool:
    """Whether the mean depends on factor j: else its best setting is any."""
    along = np.tile(best, (21, 1))
    along[:, j] = np.linspace(-1.0, 1.0, 21)
    return bool(np.ptp(drawn.value(along)) > 1e-9)


def share(interval: Interval, values: Array) -> float:
    """Share of the values inside; nan where there is no interval."""
    low, high = interval
    return float(np.mean((values >= low) & (values <= high))) if np.isfinite(high - low) else math.nan


# -- page -------------------------------------------------------------------------------------------------------------

HEAD = """# Comparison with Bayesian-optimization packages

`python tests/studies/peers_study.py` writes this page from `campaigns.csv` beside it; the file says how to install
the packages, which `seqrsm` does not need. Every campaign draws a new surface of a kind (`tests/studies/kinds.py`).
With the same seed all search the same surface, scored in percent; noise is {sd:g} points unless stated otherwise.
Packages start with 12 Sobol points, `seqrsm` with its own initial design; all then use batches of 4.
Versions: {versions}.
"""
BUDGET = """
## Regret when the budget is spent

40 runs ("sparse": 60). The answer is the setting with the best mean score under the driver's own model
(`optuna_gp`: by BoTorch's model of the runs that Optuna chose). *Regret*: the largest true mean minus the true mean at
the answer, in points; median ± its standard error (bootstrap over campaigns).
"""
PAIRED = """
Regret of a package minus that of `seqrsm`, paired by seed: median of the differences ± its standard error. Above
zero, `seqrsm` is closer to the optimum. **Bold**: more than two standard errors from zero.
"""
WIDTHS = """
## Intervals of the mean score at the answer

Median half-width of the 95 % interval [points] and its coverage of the true mean (packages: 1.96 posterior standard
deviations about the mean of their model).
"""
STOP = """
## Results of seqrsm at its stop rule

Campaigns that run until the stop rule is met (`half_width = 2.5` points, `interval = "{interval}"`) or to {longest}
runs. *Stopped*: share in which it was met; *runs*: median over all; other columns are for those that stopped. Coverage
of 95 % intervals, all at the recommended settings ({new} new runs, and means of new runs, for each campaign), for *one
new run*, the *mean of 5* new runs, the *true mean*, and the *place* of the true optimum, factor by factor. *Loss*: mean
of the reported expected loss and of the true loss [points]; *loss above {limit:g}*: mean reported probability and
actual frequency; both over campaigns that report it (*tell*). ± is one standard error over campaigns.
"""
PLACES = {"new_run": "one new run", "mean_of_several": "mean of 5", "covered": "true mean", "places": "place"}


def numbers(rows: Sequence[Row], key: str) -> Array:
    """A column, without what is not a number."""
    found = np.array([float(row[key]) for row in rows])
    return found[np.isfinite(found)]


def median_se(values: Array) -> float:
    """Standard error of a median by the bootstrap."""
    rng = np.random.default_rng(0)
    return float(np.std(np.median(rng.choice(values, (2000, len(values))), axis=1)))


def median_text(values: Array) -> str:
    """Median and standard error."""
    if not len(values):
        return ""
    return f"{np.median(values):.2f}" + (f" ± {median_se(values):.2f}" if len(values) > 1 else "")


def difference_text(values: Array) -> str:
    """The same, bold where it is more than two standard errors from zero."""
    text = median_text(values)
    return f"**{text}**" if len(values) > 4 and abs(np.median(values)) > 2.0 * median_se(values) else text


def share_text(values: Array) -> str:
    """Mean of shares in percent, with the standard error over campaigns."""
    if not len(values):
        return ""
    return f"{100.0 * np.mean(values):.0f} ± {100.0 * np.std(values) / math.sqrt(len(values)):.0f}"


def mean_text(values: Array) -> str:
    """Mean with one digit more than a point."""
    return f"{np.mean(values):.2f}" if len(values) else ""


def table(head: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    """A table, its first column words."""
    rows = [head, ["---"] * len(head), *lines]
    return "\n".join("| " + " | ".join(row) + " |" for row in rows) + "\n"


def by_seed(rows: Sequence[Row], key: str) -> dict[str, float]:
    """A column by seed."""
    return {row["seed"]: float(row[key]) for row in rows}


def budget_page(rows: Sequence[Row]) -> str:
    """Regret, paired differences, intervals."""
    drivers = [driver for driver in DRIVERS if any(row["driver"] == driver for row in rows)]
    kinds = [name for name in KINDS if any(row["kind"] == name for row in rows)]

    def of(name: str, driver: str) -> list[Row]:
        return [row for row in rows if (row["kind"], row["driver"]) == (name, driver)]

    def lines(text: Callable[[str, str], str], whom: Sequence[str]) -> list[list[str]]:
        return [[name, *(text(name, driver) for driver in whom)] for name in kinds]

    def regret(name: str, driver: str) -> str:
        return median_text(numbers(of(name, driver), "regret"))

    def paired(name: str, driver: str) -> str:
        ours, theirs = by_seed(of(name, "seqrsm"), "regret"), by_seed(of(name, driver), "regret")
        return difference_text(np.array([theirs[seed] - ours[seed] for seed in ours if seed in theirs]))

    def width(name: str, driver: str) -> str:
        half, covered = (numbers(of(name, driver), key) for key in ("half_width", "covered"))
        return f"{np.median(half):.2f}; {100.0 * np.mean(covered):.0f} %" if len(half) else ""

    counts = ["campaigns", *(str(sum(row["driver"] == driver for row in rows)) for driver in drivers)]
    times = [numbers([row for row in rows if row["driver"] == driver], "cpu_s") for driver in drivers]
    seconds = ["CPU s, median", *(f"{np.median(found):.2g}" for found in times)]
    page = BUDGET + "\n" + table(["kind", *drivers], [*lines(regret, drivers), counts, seconds])
    others = [driver for driver in drivers if driver != "seqrsm"]
    if "seqrsm" in drivers and others:
        page += PAIRED + "\n" + table(["kind", *others], lines(paired, others))
    overall = ["all kinds, covers"]
    overall += [share_text(numbers([row for row in rows if row["driver"] == one], "covered")) + " %" for one in drivers]
    return page + WIDTHS + "\n" + table(["kind", *drivers], [*lines(width, drivers), overall])


def stop_page(rows: Sequence[Row]) -> str:
    """Coverage and loss of campaigns that stopped by the rule."""
    head = ["kind", "campaigns", "stopped %", "runs", *(f"{word} %" for word in PLACES.values()), "tell"]
    head += ["loss told", "loss true", "chance told %", "loss above %"]
    lines = []
    for name in [*KINDS, "all kinds"]:
        every = [row for row in rows if name in (row["kind"], "all kinds")]
        some = [row for row in every if float(row["stopped"])]
        if not every:
            continue
        tell = [row for row in some if math.isfinite(float(row["told_loss"]))]
        line = [name, str(len(every)), share_text(numbers(every, "stopped"))]
        line += [f"{np.median(numbers(every, 'runs')):.0f}", *(share_text(numbers(some, key)) for key in PLACES)]
        line += [str(len(tell)), *(mean_text(numbers(tell, key)) for key in ("told_loss", "regret"))]
        lines.append(line + [share_text(numbers(tell, key)) for key in ("told_chance", "above")])
    return STOP.format(interval=STOP_INTERVAL, longest=LONGEST, new=NEW, limit=LIMIT) + "\n" + table(head, lines)


MANY_RUNS = """
## Many scores that were there before

{many} runs at random settings, in one file, as they were flown or simulated without the program. *Covers*: the 95 %
interval of the true mean at the recommended settings, and of the place of the true optimum, factor by factor. *Loss*:
told and true, means. ± is one standard error over campaigns.
"""


def many_page(rows: Sequence[Row]) -> str:
    """Regret, intervals and loss told of many runs."""
    head = ["kind", "campaigns", "regret", "half-width", "true mean %", "place %", "loss told", "loss true"]
    lines = []
    for name in [*KINDS, "all kinds"]:
        some = [row for row in rows if name in (row["kind"], "all kinds")]
        if some:
            line = [name, str(len(some)), median_text(numbers(some, "regret"))]
            line += [mean_text(numbers(some, "half_width")), share_text(numbers(some, "covered"))]
            line += [share_text(numbers(some, "places"))]
            lines.append(line + [mean_text(numbers(some, key)) for key in ("told_loss", "regret")])
    return MANY_RUNS.format(many=MANY) + "\n" + table(head, lines)


def write(rows: Sequence[Row], folder: Path) -> None:
    """README.md of ``folder``."""
    versions = sorted({row["version"] for row in rows})
    page = HEAD.format(sd=2.0, versions=", ".join(versions))
    for mode, part in (("budget", budget_page), ("stop", stop_page), ("many", many_page)):
        some = [row for row in rows if row["mode"] == mode]
        page += part(some) if some else ""
    notes = folder / "notes.md"
    page += "\n" + notes.read_text(encoding="utf-8") if notes.exists() else ""
    (folder / "README.md").write_text(page, encoding="utf-8")


def seeds_of(text: str) -> range:
    """The seeds of "a:b"."""
    first, last = text.split(":")
    return range(int(first), int(last))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--mode", choices=("budget", "stop", "many"), default="budget")
    parser.add_argument("--kinds", nargs="+", choices=list(KINDS), metavar="KIND", help=f"of {', '.join(KINDS)}")
    parser.add_argument("--drivers", nargs="+", choices=list(DRIVERS), default=["seqrsm"])
    parser.add_argument("--seeds", type=seeds_of, default=range(20), metavar="a:b")
    parser.add_argument("--out", type=Path, default=Path("reports/peers"))
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    path, rows = given.out / "campaigns.csv", []
    if path.exists():
        with path.open(newline="", encoding="utf-8") as stream:
            rows = list(csv.DictReader(stream))
    done = {(row["kind"], row["driver"], row["mode"], row["seed"]) for row in rows}
    told = ("student", "counts", "days, saturating", "days, cliff")  # only seqrsm can be told of such scores
    with path.open("a", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, FIELDS)
        if not rows:
            writer.writeheader()
        for seed in given.seeds:
            for name in given.kinds or KINDS:
                for driver in given.drivers:
                    elsewhere = driver != "seqrsm" and (given.mode != "budget" or name in told)
                    endless = (
                        given.mode != "budget" and KINDS[name].of_day
                    )  # days alone scatter by more than the target
                    if elsewhere or endless or (name, driver, given.mode, str(seed)) in done:
                        continue
                    try:
                        found = campaign(name, driver, given.mode, seed)
                    except Exception as error:  # what fails is left out, and tried by the next call
                        print(name, driver, seed, "failed:", repr(error)[:300], flush=True)
                        continue
                    rows.append({key: str(found[key]) for key in FIELDS})
                    writer.writerow(rows[-1])
                    stream.flush()
                    print(*rows[-1].values(), flush=True)
            write(rows, given.out)
    write(rows, given.out)


if __name__ == "__main__":
    main()
