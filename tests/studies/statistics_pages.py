"""Page and pictures of ``statistics_study.py``."""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from scipy import stats
from statistics_cases import COMPARED, Row


def coverage_picture(path: Path, rows: dict[str, list[Row]]) -> None:
    """Coverage (or size) less nominal with two standard errors, and the band of one percent."""
    groups = {name: found for name, found in rows.items() if found}
    heights = [len(found) + 1.5 for found in groups.values()]
    figure, axes = plt.subplots(
        len(groups), 1, figsize=(9.0, 0.21 * sum(heights)), height_ratios=heights, sharex=True, squeeze=False
    )
    for axis, (name, found) in zip(axes[:, 0], groups.items(), strict=True):
        place = np.arange(len(found))[::-1]
        gap = [100.0 * (row.share - row.nominal) for row in found]
        error = [200.0 * row.error for row in found]
        colours = ["#0072b2" if row.holds else "#d55e00" for row in found]
        axis.axvspan(-1.0, 1.0, color="#d5dae0", zorder=0)
        axis.axvline(0.0, color="#5c6670", linewidth=0.8)
        axis.errorbar(gap, place, xerr=error, fmt="none", ecolor="#5c6670", linewidth=1.0)
        axis.scatter(gap, place, c=colours, s=18, zorder=3)
        axis.set_yticks(place, [f"{row.name}{' (at least)' if row.at_least else ''}" for row in found], fontsize=7)
        axis.set_title(name, loc="left", fontsize=9)
        axis.set_ylim(-0.7, len(found) - 0.3)
    every = [row for found in groups.values() for row in found]
    ends = [100.0 * (row.share - row.nominal + side * 2.0 * row.error) for row in every for side in (-1.0, 1.0)]
    axes[0, 0].set_xlim(min(-4.0, *ends) - 0.2, max(6.0, *ends) + 0.2)
    axes[-1, 0].set_xlabel("share less nominal [%]; bars: two Monte Carlo standard errors; band: 1 %")
    figure.tight_layout()
    figure.savefig(path, dpi=110, bbox_inches="tight")
    plt.close(figure)


def rank_picture(path: Path, found: list[dict]) -> None:
    """Rank histograms of every parameter of every posterior, with the band that holds 99 % of the bars."""
    width = max(len(one["histograms"]) for one in found)
    figure, axes = plt.subplots(len(found), width, figsize=(1.5 * width, 1.25 * len(found)), squeeze=False)
    for line, one in zip(axes, found, strict=True):
        for axis in line:
            axis.set_axis_off()
        for j, fine in enumerate(one["histograms"]):
            # With few data sets bars are put together, so that each is worth looking at.
            counts = np.array(fine) if one["sets"] >= 500 else np.reshape(fine, (-1, 2)).sum(axis=1)
            axis = line[j]
            axis.set_axis_on()
            bins = len(counts)
            low, high = stats.binom(one["sets"], 1.0 / bins).ppf([0.005, 0.995])
            axis.axhspan(low, high, color="#d5dae0", zorder=0)
            axis.bar(np.arange(bins), counts, width=0.9, color="#0072b2")
            axis.set_xticks([])
            axis.set_yticks([])
            axis.set_title(f"p = {one['p'][j]:.3f}", fontsize=7)
        line[0].set_ylabel(one["name"], fontsize=6.5, rotation=0, ha="right", va="center")
    figure.tight_layout()
    figure.savefig(path, dpi=110, bbox_inches="tight")
    plt.close(figure)


NOTES = {
    "at the recommended settings": (
        "Each data set goes through the program's whole analysis. The scores that chose the settings also estimate "
        "their mean, so the estimate is corrected for selection bias and the intervals extend by the correction. Bias "
        "and correction are in units of the error's s.d. The last column is the t interval of RSL TR 380-1 "
        "eq. (2-17) at the quadratic's own optimum, as if the settings had been fixed beforehand: on a flat surface it "
        "covers as little as 52 %, the program's 93 to 97 %."
    )
}


def page(results: dict, rows: dict[str, list[Row]], sbc: str) -> str:
    """The whole page."""
    every = [row for found in rows.values() for row in found]
    missed = [row for row in every if not row.holds]
    controls = [row for row in every if row.control not in ("", COMPARED)]
    blind = [row for row in controls if abs(row.control_share - row.nominal) <= 0.01]
    text = [
        "# Coverage of intervals, levels of tests, calibration of posteriors",
        "",
        "Written by `OPENBLAS_NUM_THREADS=1 python tests/studies/statistics_study.py`. Every share is over",
        "simulated data sets with known truth, on a fixed design of fixed size. An interval or test passes if its",
        "share is within 1 % of nominal (or four Monte Carlo standard errors, if larger); those marked *at least* are",
        "conservative by construction and may lie above. A control is wrong in one respect on purpose.",
        "",
        f"{len(every) - len(missed)} of {len(every)} rows pass. Of {len(controls)} controls",
        f"{len(controls) - len(blind)} fail by more than 1 %, as they should."
        + (f" Not seen: {'; '.join(f'{row.name} ({row.control})' for row in blind)}." if blind else ""),
        "",
        "![coverage](coverage.png)",
        "",
    ]
    if missed:
        text += ["**Missed**", ""]
        text += [
            f"- {row.name}: {row.share:.3f} for {row.nominal:g} (standard error {row.error:.4f})" for row in missed
        ]
        text.append("")
    for name, found in rows.items():
        text += [
            f"## {name[0].upper()}{name[1:]}",
            "",
            *([NOTES[name], ""] if name in NOTES else []),
            "| what | share | nominal | s.e. | data sets | control | its share |",
        ]
        text.append("|---|---|---|---|---|---|---|")
        for row in found:
            nominal = f"{'≥ ' if row.at_least else ''}{row.nominal:g}"
            control = f"{row.control_share:.3f}" if row.control else ""
            numbers = f"{row.share:.4f} | {nominal} | {row.error:.4f} | {row.sets}"
            text.append(f"| {row.name} | {numbers} | {row.control} | {control} |")
        text += ["", _cost(results[name]), ""]
    if sbc in results:
        text += _calibration(results[sbc])
    return "\n".join(text).rstrip() + "\n"


def _cost(result: dict) -> str:
    return f"CPU {result['cpu_s']:.0f} s on one core; load of the machine up to {result['load']:.1f}."


def _calibration(result: dict) -> list[str]:
    text = [
        "## Calibration of posteriors",
        "",
        "Simulation-based calibration (Talts et al. 2018): truths are drawn from the prior and scores from the truths;",
        "the ranks of the truths among the posterior draws must be uniform. Kolmogorov-Smirnov p for every parameter;",
        "the control is the posterior at half its width. Band of the figure: 99 % of the bars. Refused: the sampler",
        "reported that it had not converged, within the small limits of this study, and gave no draws.",
        "",
        "![ranks](ranks.png)",
        "",
        "| posterior | data sets | refused | p, parameter by parameter | control, smallest p |",
        "|---|---|---|---|---|",
    ]
    for one in result["rows"]:
        p = ", ".join(f"{value:.3f}" for value in one["p"])
        text.append(f"| {one['name']} | {one['sets']} | {one['refused']} | {p} | {one['control']:.0e} |")
    every = [value for one in result["rows"] for value in one["p"]]
    chance = 1.0 - (1.0 - min(every)) ** len(every)
    text += [
        "",
        f"The smallest of {len(every)} p values is {min(every):.3f}; if all posteriors are correct, a value this",
        f"small occurs in {100.0 * chance:.0f} % of such studies.",
    ]
    return [*text, "", _cost(result), ""]
