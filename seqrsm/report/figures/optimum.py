"""Response surfaces, slices and posterior of the optimum: results in, drawings out, and the numbers behind them.

Nothing is estimated here.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from seqrsm.analysis.results import Analysis
from seqrsm.analysis.scale import Interval
from seqrsm.arrays import BoolArray, FloatArray, IntArray
from seqrsm.design.factors import CategoricalFactor, DiscreteFactor, Factor, NumericFactor, span
from seqrsm.plain import heading
from seqrsm.report.blocks import PanelData
from seqrsm.report.figures import drawing
from seqrsm.report.figures.surfaces import Line, Surface, numeric_factor
from seqrsm.report.rounding import format_range
from seqrsm.report.wording import axis_label, level_labels, level_probabilities, score_decimals, shortened, with_unit
from seqrsm.spec.tables import StopSpec

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MANY = 150
"""Marks of runs that are drawn in full size."""
_CLOUD_POINTS = 220
_AXIS_LETTERS = 30
"""That fit below the axis of a panel."""
_FAR = 3.0
"""Times the widest interval beyond which a target is not drawn: the intervals would be points."""
Row = tuple[float | str, ...]
_WHITE = "#ffffff"
_BLACK = "#000000"


def paint_contours(analysis: Analysis, surface: Surface, limits: tuple[float, float], axes: Axes) -> None:
    """Draw contours of the fitted mean over two factors with runs, posterior cloud and optimum.

    ``limits`` are scores at the ends of the colour scale, the same for all pairs so that panels can be compared.
    """
    x_factor, y_factor = numeric_factor(analysis, surface.x_index), numeric_factor(analysis, surface.y_index)
    levels = np.linspace(limits[0], limits[1], 17)
    filled = axes.contourf(
        surface.x, surface.y, surface.mean, levels=levels, cmap=drawing.SURFACE_COLORS, extend="both"
    )
    bar = axes.figure.colorbar(filled, ax=axes, pad=0.02, aspect=28)
    bar.outline.set_visible(False)
    bar.ax.tick_params(labelsize=7)
    bar.set_ticks(_round_ticks(limits))
    lines = axes.contour(surface.x, surface.y, surface.mean, levels=6, colors=_BLACK, linewidths=0.6, zorder=1.5)
    kwargs: dict[str, Any] = {} if max(map(abs, limits)) < 1e6 else {"fmt": "%.3g"}
    labels = axes.clabel(lines, fontsize=7, inline_spacing=2, zorder=1.6, **kwargs)
    if np.any(surface.slack < 0.0):
        forbidden: dict[str, Any] = {"levels": [-2.0, 0.0], "colors": [drawing.PAPER], "hatches": ["////"]}
        axes.contourf(surface.x, surface.y, surface.slack, zorder=2.0, **forbidden)
        axes.contour(
            surface.x, surface.y, surface.slack, levels=[0.0], colors=[drawing.INK], linewidths=1.2, zorder=2.1
        )
    set_numeric_axis(axes, "x", x_factor)
    set_numeric_axis(axes, "y", y_factor)
    for label in labels:  # one at the frame would be cut
        place = (axes.transData - axes.transAxes).transform(label.get_position())
        if np.min(np.minimum(place, 1.0 - place)) < 0.05:
            label.remove()
    _scatter_over_surface(axes, analysis, surface)


def _scatter_over_surface(axes: Axes, analysis: Analysis, surface: Surface) -> None:
    pair = [surface.x_index, surface.y_index]
    x_factor, y_factor = (numeric_factor(analysis, index) for index in pair)
    cloud = thinned(analysis.posterior.optimum_points)[:, pair]
    places, member = np.unique(analysis.data.points[:, pair], axis=0, return_inverse=True)
    layers: tuple[tuple[FloatArray, dict[str, Any]], ...] = (
        (cloud, {"s": 5, "color": drawing.ORANGE, "alpha": 0.55, "linewidths": 0, "zorder": 3}),
        (places, {**_sized(20, len(places), 0.8), "facecolor": _WHITE, "edgecolor": _BLACK, "zorder": 4}),
        (
            analysis.optimum.point[None, pair],
            {"s": 130, "marker": "*", "facecolor": drawing.ORANGE, "edgecolor": _BLACK, "linewidths": 0.9, "zorder": 5},
        ),
    )
    for coded, style in layers:
        marks = axes.scatter(x_factor.decode(coded[:, 0]), y_factor.decode(coded[:, 1]), clip_on=False, **style)
        if coded is places:
            drawing.tell(marks, [_runs_at(analysis, member.ravel() == i) for i in range(len(places))])


def _sized(area: float, n: int, edge: float = 0.0) -> dict[str, Any]:
    """Size of ``n`` marks and width of their edges [pt2, pt]: many are smaller, or they hide what they lie on."""
    share = min(1.0, _MANY / max(n, 1))  # none where the region was narrowed between the runs
    return {"s": max(area * share, 2.0), "linewidths": edge * share**0.5}


def _runs_at(analysis: Analysis, here: BoolArray) -> str:
    """Runs at one place of a contour plot, in words."""
    ids, scores = analysis.data.run_ids[here], analysis.data.scores[here]
    shown = ", ".join(str(run) for run in ids[:6].tolist()) + (", \u2026" if ids.size > 6 else "")
    ends = " to ".join(dict.fromkeys(f"{end:.4g}" for end in (scores.min(), scores.max())))
    return f"run {shown}: score {with_unit(ends, shortened(analysis.score_unit, 20))}"


def contour_data(analysis: Analysis, surface: Surface) -> PanelData:
    """Grid of the fitted mean, runs, posterior draws of the optimum and the recommended settings over two factors."""
    pair = [surface.x_index, surface.y_index]
    x_factor, y_factor = (numeric_factor(analysis, index) for index in pair)
    rows: list[Row] = [
        ("fitted mean", float(x), float(y), float(surface.mean[j, i]), "yes" if surface.slack[j, i] >= 0.0 else "no")
        for j, y in enumerate(surface.y)
        for i, x in enumerate(surface.x)
    ]
    layers: tuple[tuple[str, FloatArray, FloatArray], ...] = (
        ("run", analysis.data.points, analysis.data.scores),
        ("posterior draw of the optimum", *_cloud(analysis)),
        ("recommended", analysis.optimum.point[None, :], np.array([analysis.optimum.mean])),
    )
    for layer, points, values in layers:
        x, y = x_factor.decode(points[:, pair[0]]), y_factor.decode(points[:, pair[1]])
        rows += [(layer, *(float(v) for v in row), "yes") for row in zip(x, y, values, strict=True)]
    columns = ("layer", factor_column(x_factor), factor_column(y_factor), score_column(analysis), "allowed")
    return PanelData(columns, tuple(rows))


def _cloud(analysis: Analysis) -> tuple[FloatArray, FloatArray]:
    posterior = analysis.posterior
    return thinned(posterior.optimum_points), thinned(posterior.optimum_values[:, None])[:, 0]


def run_texts(runs: IntArray, values: FloatArray, what: str) -> list[str]:
    """Run and value of every mark, in words."""
    return [f"run {run}: {what} {value:.4g}" for run, value in zip(runs.tolist(), values, strict=True)]


def paint_slice(analysis: Analysis, line: Line, scores: tuple[float, float], axes: Axes) -> None:
    """Draw mean, confidence and prediction band along one factor through the optimum, with the runs moved there.

    ``scores`` are the least and greatest of all slices, which share an axis so that they can be compared.
    """
    factor = analysis.region.factors[line.index]
    stepwise = isinstance(factor, (CategoricalFactor, DiscreteFactor))
    (_paint_levels if stepwise else _paint_bands)(analysis, line, axes)
    margin = 0.05 * (scores[1] - scores[0]) or 0.05 * abs(scores[0]) or 1.0
    axes.set_ylim(scores[0] - margin, scores[1] + margin)


def paint_lines(analysis: Analysis, category: int, lines: tuple[Line, ...], axes: Axes) -> None:
    """Draw the fitted mean at a numeric factor's values with its confidence intervals, a line for each other level."""
    factor = numeric_factor(analysis, lines[0].index)
    levels = analysis.region.factors[category]
    assert isinstance(levels, CategoricalFactor)
    labels = level_labels(levels)
    for place, (one, label) in enumerate(zip(lines, labels, strict=True)):
        # Side by side on the axis, which may be logarithmic, so that intervals can be told apart.
        x = factor.decode(factor.code(one.x) + 0.024 * (place - 0.5 * (len(lines) - 1)))
        color, low, high = drawing.SERIES[place % len(drawing.SERIES)], one.confidence.low, one.confidence.high
        axes.vlines(x[one.allowed], low[one.allowed], high[one.allowed], color=color, clip_on=False)
        mean = np.where(one.allowed, one.mean, np.nan)
        axes.plot(x, mean, color=color, marker="o", markersize=3.5, label=shortened(label, 24), clip_on=False)
    set_numeric_axis(axes, "x", factor)
    axes.set_ylabel(score_label(analysis))
    axes.legend(fontsize=7)
    axes.grid(visible=True, zorder=0)


def _paint_bands(analysis: Analysis, line: Line, axes: Axes) -> None:
    factor = numeric_factor(analysis, line.index)
    mean = np.where(line.allowed, line.mean, np.nan)
    for band, alpha in ((line.prediction, 0.14), (line.confidence, 0.32)):
        axes.fill_between(line.x, band.low, band.high, where=line.allowed, color=drawing.BLUE, alpha=alpha, linewidth=0)
    axes.plot(line.x, mean, color=drawing.BLUE)
    cut = bool(np.any(np.abs(analysis.data.points[:, line.index]) > 1.0 + 1e-9))  # runs outside the region; else whole
    size = _sized(9, len(line.run_x))
    marks = axes.scatter(line.run_x, line.run_score, color=drawing.MUTED, zorder=1.9, clip_on=cut, **size)
    drawing.tell(marks, run_texts(line.run_ids, line.run_score, "score here"))
    _mark_optimum(analysis, line.index, axes)
    set_numeric_axis(axes, "x", factor)
    axes.set_ylabel(score_label(analysis))
    axes.grid(visible=True, zorder=0)


def _mark_optimum(analysis: Analysis, index: int, axes: Axes) -> None:
    """Dash the recommended setting of a numeric factor, over the frame where it is a bound."""
    at = float(numeric_factor(analysis, index).decode(analysis.optimum.point[index]))
    axes.axvline(at, color=drawing.ORANGE, linestyle="--", linewidth=1.2, clip_on=False, zorder=3)


def _paint_levels(analysis: Analysis, line: Line, axes: Axes) -> None:
    factor = analysis.region.factors[line.index]
    assert isinstance(factor, (CategoricalFactor, DiscreteFactor))
    position = np.arange(line.x.size, dtype=np.float64)
    order = {float(value): place for place, value in enumerate(line.x)}
    shown = np.array([order.get(float(value), np.nan) for value in line.run_x])
    for band, alpha in ((line.prediction, 0.25), (line.confidence, 0.6)):
        axes.vlines(position, band.low, band.high, color=drawing.BLUE, alpha=alpha, linewidth=7.0)
    axes.scatter(
        position[line.allowed], line.mean[line.allowed], s=34, marker="D", color=drawing.BLUE, zorder=4, linewidths=0
    )
    axes.scatter(
        position[~line.allowed], line.mean[~line.allowed], s=34, marker="D", facecolor="none", edgecolor=drawing.BLUE
    )
    marks = axes.scatter(shown + 0.16, line.run_score, s=9, color=drawing.MUTED, linewidths=0, zorder=3)
    if np.all(np.isfinite(shown)):
        drawing.tell(marks, run_texts(line.run_ids, line.run_score, "score here"))
    best = analysis.optimum.settings[factor.name]
    labels = [shortened(label, 20) for label in level_labels(factor)]
    here = factor.levels.index(str(best)) if isinstance(factor, CategoricalFactor) else order.get(float(best))
    if here is not None:
        axes.axvline(here, color=drawing.ORANGE, linestyle="--", linewidth=1.2, zorder=1)
    axes.set_xticks(position, labels, **_label_style(labels))
    axes.set(xlim=(-0.6, line.x.size - 0.4), xlabel=shortened(axis_label(factor), 40), ylabel=score_label(analysis))
    axes.grid(visible=True, zorder=0)


def slice_data(analysis: Analysis, line: Line) -> PanelData:
    """Fitted mean and bands along one factor, and the runs moved there."""
    factor = analysis.region.factors[line.index]
    bands = (line.mean, line.confidence.low, line.confidence.high, line.prediction.low, line.prediction.high)
    rows: list[Row] = [
        ("fitted", level, *(float(band[i]) for band in bands), "yes" if line.allowed[i] else "no", math.nan)
        for i, level in enumerate(_natural(factor, line.x))
    ]
    gap = (math.nan,) * 4
    rows += [
        ("run, moved to the slice", level, float(score), *gap, "", int(run))
        for level, score, run in zip(_natural(factor, line.run_x), line.run_score, line.run_ids.tolist(), strict=True)
    ]
    names = ("score", "confidence low", "confidence high", "prediction low", "prediction high")
    columns = ("layer", factor_column(factor), *(score_column(analysis, name) for name in names), "allowed", "run")
    return PanelData(columns, tuple(rows))


def levels_data(analysis: Analysis, category: int, lines: tuple[Line, ...]) -> PanelData:
    """Fitted mean and its interval along a numeric factor for each level of a categorical one."""
    factor, levels = analysis.region.factors[lines[0].index], analysis.region.factors[category]
    assert isinstance(levels, CategoricalFactor)
    rows: list[Row] = [
        (level, float(x), float(mean), float(low), float(high), "yes" if allowed else "no")
        for level, one in zip(levels.levels, lines, strict=True)
        for x, mean, low, high, allowed in zip(
            one.x, one.mean, one.confidence.low, one.confidence.high, one.allowed, strict=True
        )
    ]
    names = (score_column(analysis, name) for name in ("score", "confidence low", "confidence high"))
    return PanelData((levels.name, factor_column(factor), *names, "allowed"), tuple(rows))


def _natural(factor: Factor, values: FloatArray) -> list[float | str]:
    """Natural values of a factor; level names of a categorical one."""
    if isinstance(factor, CategoricalFactor):
        return [factor.levels[int(value)] for value in values]
    return [float(value) for value in values]


def paint_optimum_posterior(analysis: Analysis, index: int, axes: Axes) -> None:
    """Draw the posterior of one factor's optimal setting: histogram, or probabilities of its levels."""
    factor = analysis.region.factors[index]
    if isinstance(factor, (CategoricalFactor, DiscreteFactor)):
        shares = level_probabilities(analysis, factor)
        labels = [shortened(label, 20) for label in shares]
        axes.bar(np.arange(len(labels)), list(shares.values()), color=drawing.BLUE, width=0.6)
        axes.set_xticks(np.arange(len(labels)), labels, **_label_style(labels))
        axes.set(ylim=(0.0, 1.0), ylabel="probability")
    else:
        edges = np.linspace(-1.0, 1.0, 33)
        draws = analysis.posterior.optimum_points[:, index]
        share = np.histogram(draws, edges)[0] / max(draws.size, 1)
        natural = factor.decode(edges)
        axes.bar(natural[:-1], share, np.diff(natural), align="edge", color=drawing.BLUE, linewidth=0)
        _mark_optimum(analysis, index, axes)
        set_numeric_axis(axes, "x", factor)
        axes.set_ylabel("share of draws")
    axes.set_xlabel(shortened(axis_label(factor), 40))
    axes.grid(visible=True, zorder=0)


def optimum_draws_data(analysis: Analysis, index: int) -> PanelData:
    """Every posterior draw of one factor's optimal setting."""
    factor = analysis.region.factors[index]
    draws = analysis.posterior.optimum_points[:, index]
    natural = draws if isinstance(factor, CategoricalFactor) else factor.decode(draws)
    return PanelData((factor_column(factor),), tuple((value,) for value in _natural(factor, natural)))


def paint_intervals(analysis: Analysis, intervals: Sequence[tuple[str, Interval]], stop: StopSpec, axes: Axes) -> None:
    """Draw intervals at the optimum, each a bar, with the mean and the target about it."""
    mean = analysis.optimum.mean
    for place, (_, one) in enumerate(intervals):
        y = len(intervals) - 1 - place
        axes.hlines(y, one.low, one.high, color=drawing.BLUE, linewidth=5, alpha=0.9 if place == 0 else 0.5)
        axes.scatter([mean], [y], s=22, color=drawing.INK, zorder=3)
        if np.isfinite(one.half_width):
            text, middle = format_range(one.low, one.high, score_decimals(analysis)), 0.5 * (one.low + one.high)
            clear = {"facecolor": drawing.PAPER, "edgecolor": "none", "pad": 0.5}  # of the target's lines
            axes.annotate(text, (middle, y), (0, 4), textcoords="offset points", ha="center", va="bottom", bbox=clear)
    for end in (mean - stop.half_width, mean + stop.half_width) if target_is_near(intervals, stop) else ():
        axes.axvline(end, color=drawing.GREEN, linestyle="--", linewidth=1.3)
    names = [name.replace(", ", ",\n") for name, _ in intervals]
    axes.set_yticks(range(len(intervals) - 1, -1, -1), names)
    axes.set_ylim(-0.6, len(intervals) - 0.3)
    axes.margins(x=0.2)
    axes.locator_params(axis="x", nbins=3)  # small scores have long labels
    axes.set_xlabel(score_label(analysis))
    axes.grid(visible=True, axis="x")


def target_is_near(intervals: Sequence[tuple[str, Interval]], stop: StopSpec) -> bool:
    """Whether the target half-width can be drawn with the intervals."""
    widest = max((one.half_width for _, one in intervals if np.isfinite(one.half_width)), default=stop.half_width)
    return stop.half_width < _FAR * widest


def score_label(analysis: Analysis) -> str:
    """Return the label of an axis of scores."""
    return heading("score", shortened(analysis.score_unit, 20))


def score_column(analysis: Analysis, name: str = "score") -> str:
    """Name of a column of scores, with their unit."""
    return heading(name, analysis.score_unit)


def factor_column(factor: Factor) -> str:
    """Name of a factor's column, with its unit."""
    return heading(factor.name, factor.unit)


def _label_style(labels: list[str]) -> dict[str, Any]:
    """Slant labels that would run into each other."""
    sizes, room = [len(label) for label in labels], _AXIS_LETTERS / len(labels)
    if all(0.5 * (one + following) + 1.0 <= room for one, following in itertools.pairwise(sizes)):
        return {}
    return {"rotation": 35, "ha": "right", "rotation_mode": "anchor"}


def thinned(draws: FloatArray) -> FloatArray:
    """Evenly spaced rows of draws, few enough for a cloud."""
    if draws.shape[0] <= _CLOUD_POINTS:
        return draws
    return draws[np.linspace(0, draws.shape[0] - 1, _CLOUD_POINTS).astype(np.intp)]


def set_numeric_axis(axes: Axes, which: Literal["x", "y"], factor: NumericFactor) -> None:
    """Limits, scale, label and plain ticks of a numeric factor's axis."""
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

    low, high = span(factor)
    axis = axes.xaxis if which == "x" else axes.yaxis
    if factor.scale == "log":
        (axes.set_xscale if which == "x" else axes.set_yscale)("log")
        axis.set_minor_locator(NullLocator())
    ticks = list(factor.values) if isinstance(factor, DiscreteFactor) and len(factor.values) <= 8 else None
    if ticks is None and factor.scale == "log":
        ticks = _log_ticks(low, high)
    if ticks is not None:
        axis.set_major_locator(FixedLocator(ticks))
    # Of 2e-06 and 2e+06 a power of ten would be set apart, over the end of the label.
    if ticks is not None or not 1e-4 <= max(abs(low), abs(high)) < 1e6:
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    (axes.set_xlim if which == "x" else axes.set_ylim)(low, high)
    axis.set_label_text(shortened(axis_label(factor), 40 if which == "x" else 28))


def _log_ticks(low: float, high: float) -> list[float]:
    """Round numbers between two ends of a logarithmic axis: from 1, 2, 5 to powers of ten as the span grows."""
    decades = np.log10(high / low)
    if decades < 0.7:
        step = 10.0 ** np.floor(np.log10((high - low) / 3.0))
        for factor in (1.0, 2.0, 5.0, 10.0):
            if (high - low) / (step * factor) <= 6.0:
                step *= factor
                break
        return [float(f"{value:.6g}") for value in np.arange(np.ceil(low / step), np.floor(high / step) + 1) * step]
    mantissas = (1.0, 2.0, 5.0) if decades < 2.2 else (1.0, 3.0) if decades < 3.2 else (1.0,)
    exponents = np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1)
    ticks = [float(f"{mantissa * 10.0**exponent:.6g}") for exponent in exponents for mantissa in mantissas]
    return [tick for tick in ticks if low * (1 - 1e-9) <= tick <= high * (1 + 1e-9)]


def _round_ticks(limits: tuple[float, float]) -> list[float]:
    from matplotlib.ticker import MaxNLocator

    ticks = MaxNLocator(6).tick_values(*limits)
    return [float(tick) for tick in ticks if limits[0] <= tick <= limits[1]]
