"""Numerical stability at the extremes: digits of the statistics, precision of the engines, NIST's linear sets.

    OPENBLAS_NUM_THREADS=1 python tests/studies/stability_study.py [--out reports/stability]

Writes ``README.md``, three plots and ``stability.csv`` with every number. Nothing is timed and nothing depends on the
load of the machine: the same version gives the same files.
"""

from __future__ import annotations

import argparse
import csv
import math
import os
import sys
from collections.abc import Sequence
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
import stability_engine as engine
import stability_exact as exact
import stability_fit as fit

ENOUGH = 6.0  # digits that no decision of a campaign can tell from the exact number
SAME = 3.0  # digits in which an answer, which rests on a search for a process's lengths, should not change
TOLERABLE = 1e-3  # relative error of a pixel's power, 0.004 dB; of a brightness, as a share of the noise

MEASURES = fit.MEASURES
COLOURS = {
    "coefficients": "#0072b2",
    "standard errors": "#d55e00",
    "stationary point": "#cc79a7",
    "answer": "#009e73",
    "coefficients, limit of double columns": "0.55",
    "uncoded, this solver": "#e69f00",
    "uncoded, numpy lstsq": "black",
}
AXES = {
    "coding, linear": "offset of a factor over its range",
    "coding, log": "offset of a factor over its range, logarithmic scale",
    "near-singular design": "share of its own in the second factor",
    "noise": "noise [score units], surface of range 10 around 60",
    "offset of the scores": "constant added to scores of noise 1",
    "unit of the scores": "unit of the scores",
    "factors": "factors k, p + 10 runs",
}
LINEAR_AXES = ("factors", "radar incidence [deg]", "radar dynamic range [dB]", "radiometer sweep [deg]")
CURVES = {
    "radar dynamic range [dB]": (
        "whole pixels, float32",
        "whole pixels, float64",
        "pixels of 2.5 cells, float32",
        "pixels of 2.5 cells, float64",
    ),
    "radar looks": ("largest", "spread lost in float32"),
}
RADAR = ("median", "99 %", "largest", "with noise, largest")
RADIOMETER = ("median [K]", "99 % [K]", "largest [K]", "noise [K]")


def curves(study: str) -> tuple[str, ...]:
    return CURVES.get(study, RADIOMETER if study.startswith("radiometer") else RADAR)


def judged(study: str) -> str:
    """The curve that decides whether a case of an engine has broken."""
    return (
        "pixels of 2.5 cells, float32"
        if "dynamic" in study
        else "99 % [K]"
        if study.startswith("radiometer")
        else "99 %"
    )


def fit_breaks(rows: Sequence[fit.Row]) -> list[fit.Row]:
    """Cases that are refused, or have fewer digits than `ENOUGH` in some measure or `SAME` in the answer."""
    return [r for r in rows if r.does.startswith(("refuses", "No error")) or _least(r) < ENOUGH]


def _least(row: fit.Row) -> float:
    """Least digits of any measure; those of an answer count as far as they are fewer than `SAME`."""
    answer = row.digits.get("answer", 16.0)
    return min(answer if answer < SAME else 16.0, *(row.digits.get(m, 16.0) for m in MEASURES[:-1]))


def engine_breaks(study: str, rows: Sequence[engine.Row]) -> list[engine.Row]:
    """Cases that are refused, or err by more than `TOLERABLE`."""
    out = []
    for row in rows:
        error = row.values.get(judged(study), 0.0) / row.values.get("noise [K]", 1.0)
        if row.does.startswith("refuses") or error > TOLERABLE:
            out.append(row)
    return out


def short(text: str, length: int = 110) -> str:
    return text if len(text) <= length else f"{text[: length - 1]}…"


def number(x: float) -> str:
    return f"{x:g}" if 1e-3 <= abs(x) < 1e5 or x == 0 else f"{x:.0e}"


def tidy(value: float, digits: int = 1) -> str:
    return "–" if not math.isfinite(value) else f"{value:.{digits}f}"


# -- plots --------------------------------------------------------------------------------------------------------


def figure(n: int, columns: int):
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib.figure import Figure

    rows = -(-n // columns)
    made = Figure(figsize=(5.2 * columns, 3.7 * rows), layout="constrained")
    return made, made.subplots(rows, columns, squeeze=False).ravel()


def save(made, path: Path) -> None:
    made.savefig(path, dpi=110, metadata={"Software": None})


def mark(axes, xs: Sequence[float], broken: Sequence[object]) -> None:
    """Shade what breaks, and say what the program does there."""
    zones: list[tuple[str, list[int]]] = []
    for i, row in sorted((list(xs).index(row.x), row) for row in broken):  # type: ignore[attr-defined]
        word = _does(row.does)  # type: ignore[attr-defined]
        if zones and zones[-1][0] == word and zones[-1][1][-1] == i - 1:
            zones[-1][1].append(i)
        else:
            zones.append((word, [i]))
    for word, own in zones:
        left = xs[own[0]] if own[0] == 0 else _between(xs[own[0] - 1], xs[own[0]], axes)
        right = xs[own[-1]] if own[-1] == len(xs) - 1 else _between(xs[own[-1]], xs[own[-1] + 1], axes)
        axes.axvspan(left, right, color="#f4c7c3" if word in REFUSALS else "#fdf0c4", lw=0, zorder=0)
        first, last = number(xs[own[0]]), number(xs[own[-1]])
        where = f"at {first}" if first == last else f"{first} to {last}"
        axes.text(
            _between(left, right, axes), 0.03, f"{word}, {where}", rotation=90, ha="center", va="bottom", fontsize=7,
            color="#33383e", transform=axes.get_xaxis_transform(),
            bbox={"facecolor": "white", "alpha": 0.75, "lw": 0, "pad": 0.8}, zorder=5,
        )  # fmt: skip


REFUSALS = ("refuses", "says that s is unknown")


def _does(text: str) -> str:
    """What the program does, in a word or two."""
    if text.startswith("refuses"):
        return "refuses"
    if text.startswith("No error"):
        return "says that s is unknown"
    if "below the noise" in text:
        return "computes, lost in the noise"
    return "warns" if text and not text.startswith("computes") else "computes, few digits"


def _between(a: float, b: float, axes) -> float:
    return math.sqrt(a * b) if axes.get_xscale() == "log" and a > 0 and b > 0 else 0.5 * (a + b)


def plot_fit(studies: dict[str, list[fit.Row]], path: Path) -> None:
    made, panels = figure(len(studies) + 1, 2)
    for axes, (name, rows) in zip(panels, studies.items(), strict=False):
        x = [r.x for r in rows]
        if name not in LINEAR_AXES:
            axes.set_xscale("log")
        for measure, colour in COLOURS.items():
            y = [r.digits.get(measure, math.nan) for r in rows]
            if np.isfinite(y).any():
                style = "--" if "limit" in measure else "-"
                width = 4.0 if "limit" in measure else 1.6
                axes.plot(x, y, style, color=colour, lw=width, marker="o", ms=3, label=measure)
        condition = np.array([r.condition for r in rows], dtype=float)
        axes.plot(
            x, 16.0 - np.log10(condition), ":", color="#33383e", lw=1.0, label="16 - log10 of the condition number"
        )
        mark(axes, x, fit_breaks(rows))
        if name == "near-singular design":
            axes.invert_xaxis()
        axes.axhline(ENOUGH, color="0.7", lw=0.8)
        axes.set(ylim=(-0.5, 16.8), xlabel=AXES[name], ylabel="correct digits", title=name)
    handles = {h.get_label(): h for axes in panels for h in axes.get_legend_handles_labels()[0]}
    panels[len(studies)].legend(
        handles.values(), handles.keys(), loc="center", frameon=False,
        title="yellow: too few digits; red: refused, or s = 0 said to be unknown",
    )  # fmt: skip
    for axes in panels[len(studies) :]:
        axes.axis("off")
    save(made, path)


def plot_nist(rows: Sequence[dict[str, object]], path: Path) -> None:
    made, (axes,) = figure(1, 1)
    made.set_size_inches(9, 4)
    names = [str(r["set"]) for r in rows]
    for i, (key, colour) in enumerate(
        (("coefficients", "#0072b2"), ("standard errors", "#d55e00"), ("coded coefficients", "#56b4e9"),
         ("coded standard errors", "#e69f00"))
    ):  # fmt: skip
        y = [float(r.get(key, math.nan)) for r in rows]  # type: ignore[arg-type]
        axes.bar(np.arange(len(rows)) + 0.2 * (i - 1.5), y, 0.2, color=colour, label=key)
    axes.set_xticks(range(len(rows)), names, rotation=30)
    axes.set(ylabel="digits of NIST's certified value", ylim=(0, 19.5))
    axes.legend(ncols=4, fontsize=8, frameon=False, loc="upper left")
    save(made, path)


def plot_engine(studies: dict[str, list[engine.Row]], path: Path) -> None:
    made, panels = figure(len(studies), 2)
    for axes, (name, rows) in zip(panels, studies.items(), strict=True):
        rows = sorted((r for r in rows if math.isfinite(r.x)), key=lambda r: r.x)
        x = [r.x for r in rows]
        if name not in LINEAR_AXES:
            axes.set_xscale("log")
        axes.set_yscale("log")
        for key, colour in zip(curves(name), ("#0072b2", "#009e73", "#d55e00", "0.5"), strict=False):
            y = [r.values.get(key, math.nan) or math.nan for r in rows]
            axes.plot(x, y, "--" if "noise" in key else "-", color=colour, marker="o", ms=3, label=key)
        mark(axes, x, engine_breaks(name, rows))
        if not name.startswith("radiometer"):
            axes.axhline(TOLERABLE, color="0.7", lw=0.8)
        axes.set(xlabel=name, title=name.partition(" [")[0])
        axes.set_ylabel("error [K]" if name.startswith("radiometer") else "relative error of a pixel's power")
        axes.legend(fontsize=8, frameon=False)
    save(made, path)


# -- words --------------------------------------------------------------------------------------------------------

HEAD = """# Numerical stability at the extremes

    python tests/studies/stability_study.py

regenerates this page, its plots and [`stability.csv`](stability.csv), which holds every number. Nothing here is timed.

Digits of the statistics are counted against least squares in {digits}-digit decimal arithmetic on the same doubles
(itself checked against rational arithmetic: {check:.0f} digits). What is measured is what `seqrsm fit --json` prints.
`limit of double columns` is the exact solution from model columns rounded to double: no solver that is handed such
columns can do better. *Answer*: digits in which the recommended settings (coded) and the half-width of the prediction
interval are those of the first case, where the axis should not change them; they rest on the posterior of quadratic and
departure, whose search for lengths ends at 8 digits or so. A case counts as broken when a coefficient, a standard error
or a coordinate of the stationary point has fewer than {enough:g} correct digits, the answer fewer than {same:g}, or the
program refuses it.

## In short

{summary}![Correct digits of coefficients, standard errors, stationary point and answer](fit.png)

"""

READING = {
    "coding, linear": "Coding takes all of it: the columns the solver sees do not depend on where a range lies. "
    "Without coding the same solver loses two digits for each decade and refuses at 1e7; numpy's `lstsq` is wrong "
    "without a word from 1e4 on. The runs' own settings are rounded, to 1e-6 of the range at 1e10: from 1e11 on that "
    "moves the answer.",
    "coding, log": "The logarithm of a value next to the low end is taken of their ratio, by `log1p`. As a difference "
    "of two logarithms, as it was before this study, 2 digits were left at 1e12. The answer holds to 1e8.",
    "near-singular design": "Digits fall with the condition number as they must for columns held as doubles: the "
    "solver stays on that limit. From a condition number of 1e3 on `fit` warns, from about 1e15 it refuses and names "
    "the terms.",
    "noise": "Scores around 60 end at 1e-14, so what is left of a scatter below 1e-12 is rounding. There the fit is "
    "declared exact, and s, standard errors and intervals are said to be unknown instead of being printed as rounding. "
    "Before that they lose a digit a decade with the columns; coefficients lose none.",
    "offset of the scores": "Coefficients, s and standard errors are those of the scores as given, to the last digit, "
    "thanks to refinement with residuals in twice the precision. The half-width is taken from the two ends of the "
    "interval, which are numbers near the offset: at 1e9 it has {at_1e9:.0f} digits. At 1e15 the scores themselves "
    "hold no scatter any more, and `fit` says so.",
    "unit of the scores": "No unit matters from 1e-150 to 1e150.",
    "factors": "Condition numbers of designs of p + 10 random runs stay below 100 up to eight factors and 45 terms.",
}


def fit_table(name: str, rows: Sequence[fit.Row]) -> list[str]:
    keep = rows if len(rows) <= 19 else rows[:: -(-len(rows) // 15)]
    lines = [
        f"| {AXES[name].partition(',')[0]} | condition | coefficients | limit | standard errors | stationary point | "
        "answer | what `fit` says |",
        "|---:|---:|---:|---:|---:|---:|---:|---|",
    ]
    for r in keep:
        cells = [tidy(r.digits.get(m, math.nan)) for m in MEASURES]
        limit = tidy(r.digits.get("coefficients, limit of double columns", math.nan))
        lines.append(
            f"| {number(r.x)} | {r.condition:.2g} | {cells[0]} | {limit} | {cells[1]} | {cells[2]} | {cells[3]} | "
            f"{short(r.does)} |"
        )
    return lines


def outcome(rows: Sequence[fit.Row]) -> tuple[str, str]:
    """Where a study of the statistics breaks, and what the program does from there on."""
    broken = fit_breaks(rows)
    if not broken:
        return f"nowhere between {number(rows[0].x)} and {number(rows[-1].x)}", "computes"
    # From the sound side: the noise breaks at its low end, the others at their high end.
    ordered = list(rows) if rows[0] not in broken else list(reversed(rows))
    first = next(r for r in ordered if r in broken)
    left = _least(first)
    says = next((r for r in ordered if r in broken and r.does.startswith(("refuses", "No error"))), None)
    does = f"computes, {left:.1f} digits are left" + (f", and warns: {first.does}" if first.does else "")
    if says is not None:
        verb = "" if says.does.startswith("refuses") else "says: "
        does += f"; from {number(says.x)} on {verb}{says.does}"
    return f"{number(first.x)}", does


def engine_outcome(study: str, rows: Sequence[engine.Row]) -> tuple[str, str]:
    """Where a study of an engine breaks, and what the program does there."""
    sound = [r.x for r in rows if r not in engine_breaks(study, rows) and math.isfinite(r.x)]
    broken = [r for r in engine_breaks(study, rows) if math.isfinite(r.x)]
    if not broken:
        return f"nowhere between {number(min(sound))} and {number(max(sound))}", "computes"
    ends = []
    for side, chosen in (("below", max), ("above", min)):
        beyond = [r for r in broken if (r.x < min(sound)) == (side == "below")]
        if beyond:
            row = chosen(beyond, key=lambda r: r.x)
            ends.append((number(row.x), f"{side}: {short(row.does, 150)}"))
    return " and ".join(end for end, _ in ends), "; ".join(does for _, does in ends)


def summary(fits: dict[str, list[fit.Row]], engines: dict[str, list[engine.Row]]) -> str:
    """One line a study."""
    lines = ["| study | axis | breaks at | what the program does there |", "|---|---|---|---|"]
    for name, rows in fits.items():
        where, does = outcome(rows)
        lines.append(f"| {name} | {AXES[name]} | {where} | {does} |")
    for study, found in engines.items():
        where, does = engine_outcome(study, found)
        lines.append(f"| {study.partition(' [')[0]} | {study} | {where} | {does} |")
    return "\n".join([*lines, "", ""])


def fit_words(studies: dict[str, list[fit.Row]]) -> str:
    at_1e9 = next(r for r in studies["offset of the scores"] if r.x == 1e9).digits["answer"]
    out = []
    for name, rows in studies.items():
        out += [f"## {name.capitalize()}", "", READING[name].format(at_1e9=at_1e9), "", *fit_table(name, rows), ""]
    return "\n".join(out)


def nist_words(rows: Sequence[dict[str, object]]) -> str:
    lines = [
        "## NIST's certified linear sets", "",
        "Digits of the certified values, the worst coefficient of each set: in the units of the data, and for "
        "polynomials also through columns coded on [-1, 1], taken back by exact arithmetic. Filip's powers rounded to "
        "double limit any solver to 7.6 digits; coding lifts the limit. Wampler's coefficients of size 1 come out of "
        "coded ones of size 1e6 that are kept to one double each, which is why coding costs digits there.", "",
        "![Digits of NIST's certified values](nist.png)", "",
        "| set | condition | coefficients | standard errors | s | coded condition | coded coefficients | "
        "coded standard errors | what the fit says |",
        "|---|---:|---:|---:|---:|---:|---:|---:|---|",
    ]  # fmt: skip
    for r in rows:
        numbers = [
            tidy(float(r.get(key, math.nan)))  # type: ignore[arg-type]
            for key in ("coefficients", "standard errors", "s")
        ]
        coded = [tidy(float(r.get(f"coded {key}", math.nan))) for key in ("coefficients", "standard errors")]  # type: ignore[arg-type]
        condition = float(r.get("coded condition", math.nan))  # type: ignore[arg-type]
        shown = "–" if math.isnan(condition) else f"{condition:.2g}"
        lines.append(
            f"| {r['set']} | {r['condition']:.2g} | {' | '.join(numbers)} | {shown} | {' | '.join(coded)} | "
            f"{r['does']} |"
        )
    return "\n".join([*lines, ""])


ENGINE_HEAD = """## Engines: single against double precision

Campaigns simulate in single precision. Everything random is drawn alike in both; compared are the mean power of pixels
(before noise), the same with noise and fading, or the brightness, and the state of every cell. A case counts as broken
where 99 % of the pixels are not within {tolerable:g} of the double-precision power, or of the receiver's noise for a
brightness, or the program refuses it.

![Errors of single precision](engine.png)

"""

ENGINE_READING = {
    "radar altitude [m]": "Ranges are a row constant in double precision and a small offset in single, so altitude "
    "costs nothing up to the highest orbit accepted. Below, geometry refuses: a scene of 2 km seen from less than the "
    "height that puts it all on one side of the flight line.",
    "radar incidence [deg]": "Steep from 700 km, grazing from 200 m, so that neither nadir nor horizon cuts the scene. "
    "Near nadir a step of ground range is a small step of slant range and near grazing half the ground lies in shadow: "
    "the largest errors are single pixels at the rim of a shadow. Outside 0.5 to 89.5 deg the program refuses.",
    "radar looks": "Fading of any number of looks has the moments of the gamma distribution (a million pixels each; "
    "largest departure {looks_sigma:.1f} standard errors). A float32 pixel cannot show the spread of more than some "
    "1e12 looks, which no radar has.",
    "radar dynamic range [dB]": "Weak fields of flat ground beside strong ones, against the closed form. Pixels of "
    "whole cells are summed on their own and lose nothing. Other pixels, and the beam of a real aperture, are "
    "differences of a row's running sum, double in either precision: what is lost lies {below:.0f} dB below the "
    "strongest echo of the "
    "row, this radar's noise {noise:.0f} dB below it.",
    "radar echo level [W]": "Below 1e-38 W single precision has fewer digits, and below 1e-45 W none. The noise of "
    "any receiver lies twenty decades above: with noise the images agree everywhere.",
    "radiometer altitude [m]": "Sweeps from edge to edge of the scene: 89.6 deg from nadir at 7 m, a pencil from "
    "orbit. Errors stay 1e-4 of the receiver's noise.",
    "radiometer sweep [deg]": "A sweep of its own reach; beyond 75 deg it is refused.",
    "radiometer least emissivity": "Cold ground beside warm: errors do not grow with the contrast.",
}


def engine_words(studies: dict[str, list[engine.Row]]) -> str:
    dynamic = studies["radar dynamic range [dB]"]
    worst = max(
        r.values[f"{key}, in its standard errors"] for r in studies["radar looks"] for key in ("mean", "variance")
    )
    facts = {
        "below": min(r.values["pixels of 2.5 cells, error below strong [dB]"] for r in dynamic if r.x >= 40.0),
        "noise": dynamic[0].values["noise below strong [dB]"],
        "looks_sigma": worst,
    }
    out = []
    for name, rows in studies.items():
        broken = engine_breaks(name, rows)
        out += [f"### {name[0].upper()}{name[1:]}", "", ENGINE_READING[name].format(**facts), ""]
        keys = [*curves(name), *(k for k in ("shadow", "shadow flips", "blocked", "blocked flips", "score difference")
                                 if any(k in r.values for r in rows))]  # fmt: skip
        out += [f"| {name} | {' | '.join(keys)} | what the program does |", f"|---:|{'---:|' * len(keys)}---|"]
        for r in rows:
            at = "–" if math.isnan(r.x) else number(float(f"{r.x:.3g}"))
            cells = ["" if k not in r.values else f"{r.values[k]:.1e}" if r.values[k] else "0" for k in keys]
            does = r.does if r in broken and r.does else "computes"
            out.append(f"| {at} | {' | '.join(cells)} | {short(does, 140)} |")
        out.append("")
    return "\n".join(out)


def write_csv(
    fits: dict[str, list[fit.Row]], nist: Sequence[dict[str, object]], engines: dict[str, list[engine.Row]], path: Path
) -> None:
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(["study", "at", "quantity", "value", "says"])
        for name, rows in fits.items():
            for r in rows:
                for key, value in {"condition number": r.condition, **r.digits}.items():
                    writer.writerow([name, repr(r.x), key, f"{value:.4g}", r.does])
        for one in nist:
            for key, value in one.items():
                if isinstance(value, float):
                    writer.writerow(["NIST", one["set"], key, f"{value:.4g}", one["does"]])
        for name, found in engines.items():
            for row in found:
                for key, value in (row.values or {"refused": 1.0}).items():
                    writer.writerow([name, repr(row.x), key, f"{value:.3g}", row.does])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("reports/stability"))
    folder: Path = parser.parse_args().out
    folder.mkdir(parents=True, exist_ok=True)
    fits: dict[str, list[fit.Row]] = {}
    for name, study in fit.STUDIES.items():
        fits[name] = list(study())
        print(f"{name}: {len(fits[name])} cases", flush=True)
    nist = fit.nist_sets()
    engines: dict[str, list[engine.Row]] = {}
    for name, study in engine.STUDIES.items():
        engines[name] = list(study())
        print(f"{name}: {len(engines[name])} cases", flush=True)
    plot_fit(fits, folder / "fit.png")
    plot_nist(nist, folder / "nist.png")
    plot_engine(engines, folder / "engine.png")
    write_csv(fits, nist, engines, folder / "stability.csv")
    table = summary(fits, engines)
    head = HEAD.format(digits=exact.getcontext().prec, check=exact.check(), enough=ENOUGH, same=SAME, summary=table)
    text = head + fit_words(fits) + "\n" + nist_words(nist) + "\n" + ENGINE_HEAD.format(tolerable=TOLERABLE)
    (folder / "README.md").write_text(text + engine_words(engines), encoding="utf-8")


if __name__ == "__main__":
    main()
