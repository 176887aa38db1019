"""The numbers behind each picture, as the columns of a CSV file: what a reader needs to draw it anew."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seqrsm.analysis.results import Analysis
from seqrsm.arrays import AnyArray, FloatArray
from seqrsm.design.factors import CategoricalFactor, Factor
from seqrsm.report.blocks import PanelData
from seqrsm.report.figures.optimum import thinned
from seqrsm.report.figures.surfaces import Line, Surface, numeric_factor
from seqrsm.store.records import LookRecord

if TYPE_CHECKING:
    from seqrsm.campaign.rests_on import CropCalendar

Row = tuple[float | str, ...]


def factor_column(factor: Factor) -> str:
    """Name of a factor's column, with its unit."""
    unit = "" if isinstance(factor, CategoricalFactor) else factor.unit
    return f"{factor.name} [{unit}]" if unit else factor.name


def score_column(analysis: Analysis, name: str = "score") -> str:
    """Name of a column of scores, with their unit."""
    return f"{name} [{analysis.score_unit}]" if analysis.score_unit else name


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


def slice_data(analysis: Analysis, line: Line) -> PanelData:
    """Fitted mean and bands along one factor, and the runs moved there."""
    factor = analysis.region.factors[line.index]
    bands = (line.mean, line.confidence_low, line.confidence_high, line.prediction_low, line.prediction_high)
    rows: list[Row] = [
        ("fitted", level, *(float(band[i]) for band in bands), "yes" if line.allowed[i] else "no", math.nan)
        for i, level in enumerate(_natural(factor, line.x))
    ]
    gap = (math.nan,) * 4
    rows += [
        ("run, moved to the slice", level, float(score), *gap, "", int(run))
        for level, score, run in zip(
            _natural(factor, line.run_x), line.run_score, analysis.data.run_ids.tolist(), strict=True
        )
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
            one.x, one.mean, one.confidence_low, one.confidence_high, one.allowed, strict=True
        )
    ]
    names = (score_column(analysis, name) for name in ("score", "confidence low", "confidence high"))
    return PanelData((levels.name, factor_column(factor), *names, "allowed"), tuple(rows))


def calendar_data(calendar: CropCalendar, channel: int) -> PanelData:
    """Backscatter of crops over the year in one channel."""
    rows = zip(range(1, 366), *calendar.sigma0_db[channel].tolist(), strict=True)
    return PanelData(("day", *(f"{crop} [dB]" for crop in calendar.crops)), tuple(rows))


def _natural(factor: Factor, values: FloatArray) -> list[float | str]:
    """Natural values of a factor; level names of a categorical one."""
    if isinstance(factor, CategoricalFactor):
        return [factor.levels[int(value)] for value in values]
    return [float(value) for value in values]


def optimum_draws_data(analysis: Analysis, index: int) -> PanelData:
    """Every posterior draw of one factor's optimal setting."""
    factor = analysis.region.factors[index]
    draws = analysis.posterior.optimum_points[:, index]
    natural = draws if isinstance(factor, CategoricalFactor) else factor.decode(draws)
    return PanelData((factor_column(factor),), tuple((value,) for value in _natural(factor, natural)))


def coefficient_data(analysis: Analysis) -> PanelData:
    """Coded coefficients with confidence and credible intervals."""
    fit, draws = analysis.fit, analysis.posterior.term_draws
    band = fit.interval(analysis.optimum.level)
    tail = 0.5 * (1.0 - analysis.optimum.level)
    rows: list[Row] = []
    for i, name in enumerate(fit.names):
        known = draws.shape[0] > 0 and i < draws.shape[1]
        ends = np.quantile(draws[:, i], [tail, 1.0 - tail]) if known else np.full(2, math.nan)
        mean = float(np.mean(draws[:, i])) if known else math.nan
        numbers = (fit.estimate[i], fit.se[i], band.low[i], band.high[i], mean, *ends)
        rows.append((name, *(float(number) for number in numbers)))
    names = ("estimate", "se", "confidence low", "confidence high", "posterior mean", "credible low", "credible high")
    return PanelData(("term", *names), tuple(rows))


def residual_data(analysis: Analysis) -> PanelData:
    """Observed and fitted score, residual and leverage of every run."""
    fit = analysis.fit
    columns = ("run", score_column(analysis, "observed"), score_column(analysis, "fitted"))
    fitted = analysis.scale.to_score(fit.fitted)
    values = (analysis.data.run_ids, analysis.data.scores, fitted, fit.residuals, fit.studentised, fit.leverage)
    rows = zip(*(value.tolist() for value in values), strict=True)
    return PanelData((*columns, "residual", "studentised residual", "leverage"), tuple(rows))


@dataclass(frozen=True, slots=True)
class Look:
    """One look.

    Attributes
    ----------
    n_runs : int
        Scored runs it was based on.
    half_width : float
        Of the interval that the stop rule watches, score units; nan where it was not defined yet.
    confidence_half_width, prediction_half_width : float
        At the optimum of that look, score units.
    mean : float
        Estimated score at that optimum.
    settings : Mapping
        Optimum of that look, natural units.
    held : bool
        Whether the stop rule held.
    """

    n_runs: int
    half_width: float
    confidence_half_width: float
    prediction_half_width: float
    mean: float
    settings: Mapping[str, float | str]
    held: bool


def read_looks(records: Sequence[LookRecord], application: str) -> tuple[Look, ...]:
    """Read the looks of one application, in order; of two at the same number of runs the later one counts.

    Their summaries are those of `seqrsm.analysis.to_json.look_summary`.
    """
    looks: dict[int, Look] = {}
    for record in sorted((r for r in records if r.application == application), key=lambda r: r.look):
        summary, best = record.summary, record.summary["optimum"]
        found = (
            summary["half_width"],
            best["confidence"]["half_width"],
            best["prediction"]["half_width"],
            best["mean"],
        )
        width, confidence, prediction, mean = (math.nan if number is None else number for number in found)
        looks[record.after_run] = Look(
            record.after_run, width, confidence, prediction, mean, dict(best["settings"]), summary["held"]
        )
    return tuple(looks[n] for n in sorted(looks))


def look_data(analysis: Analysis, looks: Sequence[Look]) -> PanelData:
    """What every look found: half-widths, mean and settings of the optimum."""
    factors = analysis.region.factors
    rows = tuple(
        (
            look.n_runs,
            look.half_width,
            look.mean,
            look.confidence_half_width,
            look.prediction_half_width,
            *(look.settings.get(factor.name, "") for factor in factors),
        )
        for look in looks
    )
    names = ("deciding half-width", "mean at the optimum", "confidence half-width", "prediction half-width")
    columns = ("scored runs", *(score_column(analysis, name) for name in names), *map(factor_column, factors))
    return PanelData(columns, rows)


def picture_data(pixels: AnyArray, pixel_m: float) -> PanelData:
    """Pixels of a bitmap: a row for each range, a column for each azimuth, in metres from the near left corner."""
    columns = ("across track [m] \\ along track [m]", *(f"{pixel_m * j:.10g}" for j in range(pixels.shape[1])))
    rows = tuple((pixel_m * i, *line) for i, line in enumerate(pixels.tolist()))
    return PanelData(columns, rows)
