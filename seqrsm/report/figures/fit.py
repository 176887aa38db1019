"""Residuals, crop calendar, how the campaign converged: results in, drawings and their numbers out."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from seqrsm.analysis.results import Analysis
from seqrsm.arrays import FloatArray
from seqrsm.fit.least_squares import LeastSquaresFit, normal_plot
from seqrsm.plain import heading
from seqrsm.report.blocks import PanelData
from seqrsm.report.figures import drawing
from seqrsm.report.figures.optimum import factor_column, run_texts, score_column, score_label
from seqrsm.report.wording import fitted_unit
from seqrsm.store.records import LookRecord

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis

    from seqrsm.campaign.rests_on import CropCalendar


def paint_calendar(calendar: CropCalendar, channel: int, axes: Axes) -> None:
    """Draw backscatter of crops over the year in one channel, with the days on which they are looked at."""
    day = np.arange(1.0, 366.0)
    for k, crop in enumerate(calendar.crops):
        style = "-" if k < len(drawing.SERIES) else ":"
        axes.plot(day, calendar.sigma0_db[channel, k], style, color=drawing.SERIES[k % len(drawing.SERIES)], label=crop)
    for one in calendar.days:
        axes.axvline(one, color=drawing.MUTED, linestyle="--", linewidth=0.8, zorder=1)
    axes.set(xlim=(1.0, 365.0), xlabel="day of the year", ylabel="sigma0 [dB]")
    drawing.legend_above(axes)
    axes.grid(visible=True, zorder=0)


def calendar_data(calendar: CropCalendar, channel: int) -> PanelData:
    """Backscatter of crops over the year in one channel."""
    rows = zip(range(1, 366), *calendar.sigma0_db[channel].tolist(), strict=True)
    return PanelData(("day", *(f"{crop} [dB]" for crop in calendar.crops)), tuple(rows))


def residual_paints(analysis: Analysis) -> tuple[tuple[str, Callable[[Axes], None]], ...]:
    """Titles and painters of studentised residuals against fitted score, normal quantile and run number.

    Empty where studentised residuals do not exist.
    """
    studentised = analysis.fit.studentised
    known = np.isfinite(studentised)
    if np.count_nonzero(known) < 3:
        return ()
    fitted, label = analysis.scale.to_score(analysis.fit.fitted), score_label(analysis)
    ids, y = analysis.data.run_ids[known], studentised[known]
    texts, runs = run_texts(ids, y, "residual"), ids.astype(np.float64)
    return (
        ("Residuals against fitted score", partial(_paint_residuals, fitted[known], y, f"fitted {label}", texts)),
        ("Residuals against normal quantiles", partial(_paint_normal, analysis.fit)),
        ("Residuals against run", partial(_paint_residuals, runs, y, "run", texts)),
    )


def _paint_residuals(x: FloatArray, residuals: FloatArray, label: str, texts: list[str], axes: Axes) -> None:
    axes.axhline(0.0, color=drawing.MUTED, linewidth=0.8)
    for height in (-2.0, 2.0):
        axes.axhline(height, color=drawing.MUTED, linewidth=0.8, linestyle=":")
    marks = axes.scatter(x, residuals, s=16, facecolor="none", edgecolor=drawing.BLUE, linewidths=1.0)
    drawing.tell(marks, texts)
    axes.set(xlabel=label, ylabel="studentised residual")


def _paint_normal(fit: LeastSquaresFit, axes: Axes) -> None:
    plot = normal_plot(fit)
    axes.plot(plot.quantiles, plot.quantiles, color=drawing.MUTED, linewidth=0.8, linestyle="--")
    axes.scatter(plot.quantiles, plot.residuals, s=16, facecolor="none", edgecolor=drawing.BLUE, linewidths=1.0)
    axes.set(xlabel="normal quantile", ylabel="studentised residual")


def residual_data(analysis: Analysis) -> PanelData:
    """Observed and fitted score, residual and leverage of every run."""
    fit = analysis.fit
    columns = ("run", score_column(analysis, "observed"), score_column(analysis, "fitted"))
    fitted = analysis.scale.to_score(fit.fitted)
    values = (analysis.data.run_ids, analysis.data.scores, fitted, fit.residuals, fit.studentised, fit.leverage)
    rows = zip(*(value.tolist() for value in values), strict=True)
    residual = heading("residual", fitted_unit(analysis))
    return PanelData((*columns, residual, "studentised residual", "leverage"), tuple(rows))


@dataclass(frozen=True, slots=True)
class Look:
    """One look."""

    n_runs: int
    """Scored runs it was based on."""
    half_width: float
    """Of the interval that the stop rule watches, score units; nan where it was not defined yet."""
    confidence: tuple[float, float]
    """Ends of the confidence interval of the mean at the optimum of that look, score units."""
    prediction_half_width: float
    """There, score units."""
    mean: float
    """Estimated score at that optimum."""
    settings: Mapping[str, float | str]
    """Optimum of that look, natural units."""
    held: bool
    """Whether the stop rule held."""
    loss: float
    """Expected of that optimum, score units; nan in records of earlier versions."""


def read_looks(records: Sequence[LookRecord], application: str) -> tuple[Look, ...]:
    """Read the looks of one application, in order; of two at the same number of runs the later one counts.

    Their summaries are those of `seqrsm.analysis.to_json.look_summary`.
    """
    looks: dict[int, Look] = {}
    for record in sorted((r for r in records if r.application == application), key=lambda r: r.look):
        summary, best = record.summary, record.summary["optimum"]
        found = (
            summary["half_width"],
            best["confidence"]["low"],
            best["confidence"]["high"],
            best["prediction"]["half_width"],
            best["mean"],
            summary.get("expected_loss"),
        )
        width, low, high, prediction, mean, loss = (math.nan if number is None else number for number in found)
        looks[record.after_run] = Look(
            record.after_run, width, (low, high), prediction, mean, dict(best["settings"]), summary["held"], loss
        )
    return tuple(looks[n] for n in sorted(looks))


def paint_half_widths(analysis: Analysis, looks: Sequence[Look], target: float, axes: Axes) -> None:
    """Draw the watched half-width against the number of runs with the target and the noise floor."""
    widths, floor = np.array([look.half_width for look in looks]), analysis.decision.noise_floor
    axes.plot(_runs(looks), widths, marker="o", markersize=4, color=drawing.BLUE, label="half-width")
    axes.axhline(target, color=drawing.GREEN, linestyle="--", linewidth=1.3, label="target")
    if np.isfinite(floor) and floor > 0.0:
        axes.axhline(floor, color=drawing.MUTED, linestyle=":", linewidth=1.3, label="noise floor")
    axes.set_ylim(0.0, 1.12 * np.nanmax(np.append(widths[np.isfinite(widths)], target)))
    _whole_numbers(axes.xaxis)
    axes.set(xlabel="scored runs", ylabel=score_label(analysis).replace("score", "half-width", 1))
    drawing.legend_above(axes)
    axes.grid(visible=True, zorder=0)


def paint_mean_history(analysis: Analysis, looks: Sequence[Look], axes: Axes) -> None:
    """Draw the estimated score at the optimum of every look with its confidence interval."""
    mean = np.array([look.mean for look in looks])
    low, high = np.array([look.confidence for look in looks]).T
    axes.fill_between(_runs(looks), low, high, color=drawing.BLUE, alpha=0.25, linewidth=0)
    axes.plot(_runs(looks), mean, marker="o", markersize=4, color=drawing.BLUE)
    _whole_numbers(axes.xaxis)
    axes.set(xlabel="scored runs", ylabel=score_label(analysis))
    axes.grid(visible=True, zorder=0)


def look_data(analysis: Analysis, looks: Sequence[Look]) -> PanelData:
    """What every look found: half-widths, mean and settings of the optimum."""
    factors = analysis.region.factors
    rows = tuple(
        (
            look.n_runs,
            look.half_width,
            look.mean,
            *look.confidence,
            look.prediction_half_width,
            *(look.settings.get(factor.name, "") for factor in factors),
        )
        for look in looks
    )
    intervals = ("low end of the confidence interval", "high end of the confidence interval", "prediction half-width")
    names = ("deciding half-width", "mean at the optimum", *intervals)
    columns = ("scored runs", *(score_column(analysis, name) for name in names), *map(factor_column, factors))
    return PanelData(columns, rows)


def _runs(looks: Sequence[Look]) -> FloatArray:
    return np.array([look.n_runs for look in looks], dtype=np.float64)


def _whole_numbers(axis: Axis) -> None:
    from matplotlib.ticker import MaxNLocator

    axis.set_major_locator(MaxNLocator(6, integer=True, min_n_ticks=1))
