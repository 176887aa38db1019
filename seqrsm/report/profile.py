"""The prediction profiler: mean and intervals at every setting of a grid, for a page that needs no program behind it.

A browser shows numbers of this table and computes none, so that they are those of ``fit`` whatever the surface is: a
quadratic, a Gaussian process about it, on a logit scale, with blocks.
"""

from __future__ import annotations

import itertools
import json
from typing import Any

import numpy as np

from seqrsm.analysis.results import Analysis
from seqrsm.arrays import FloatArray
from seqrsm.design.factors import CategoricalFactor, ContinuousFactor, Factor
from seqrsm.report.figures.surfaces import predict
from seqrsm.report.rounding import NOTHING
from seqrsm.report.wording import axis_label, format_setting, level_phrase, optimum_setting_text, score_decimals

MOST_NODES = 3000
"""Settings of the table, at most, where the factors allow it: some 60 kB in a page."""

_LEAST, _MOST = 3, 15


def profile(analysis: Analysis) -> dict[str, Any]:
    """Return the profiler of one application as a JSON document.

    ``factors``: each with ``label``, ``levels`` (whether its values are no numbers), ``values`` (text), ``x`` (places
    on an axis from 0 to 1) and ``start``, the place of the recommended setting among them; ``rows``: mean, ends of the
    confidence and of the prediction interval, 1 or 0 for allowed or not, the last factor running fastest; None where
    there is no interval. Every row is corrected as `OptimumEstimate.optimism` corrects that of the recommended
    settings.
    """
    region, best = analysis.region, analysis.optimum
    levels = _levels(analysis)
    starts = [int(np.argmin(np.abs(np.array(coded) - best.point[j]))) for j, coded in enumerate(levels)]
    points = np.array(list(itertools.product(*levels)))
    places, scale = score_decimals(analysis), analysis.scale
    lower, upper = max(best.optimism, 0.0), min(best.optimism, 0.0)

    def scores(some: FloatArray) -> FloatArray:
        found = predict(analysis, some)
        means, future = (found.mean, found.confidence.low, found.confidence.high), found.prediction
        return np.column_stack([*map(scale.to_score, means), *scale.of_runs(found.confidence, future, 1.0)])

    # By parts: of many settings and runs the covariances would not stay in the processor's cache.
    table = np.vstack([scores(some) for some in np.array_split(points, len(points) // MOST_NODES + 1)])
    table = np.clip(table - [best.optimism, lower, upper, lower, upper], *analysis.fitted.application.score_limits)
    ends = (best.confidence.low, best.confidence.high, best.prediction.low, best.prediction.high)
    table[np.ravel_multi_index(starts, [len(coded) for coded in levels])] = (best.mean, *ends)  # as on the first page
    allowed = region.allowed(points)
    rows = [
        [*(round(value, places) if np.isfinite(value) else None for value in row), int(ok)]
        for row, ok in zip(table.tolist(), allowed.tolist(), strict=True)
    ]
    factors = [
        {
            "label": axis_label(factor),
            "levels": isinstance(factor, CategoricalFactor),
            # Where the page begins the digits are those of the first page.
            "values": [_text(factor, x) if i != start or told == NOTHING else told for i, x in enumerate(coded)],
            "x": _axis(factor, coded),
            "start": start,
        }
        for factor, coded, start in zip(region.factors, levels, starts, strict=True)
        for told in (optimum_setting_text(analysis, factor),)
    ]
    return {
        "name": analysis.application,
        "unit": analysis.score_unit,
        "level": level_phrase(analysis),
        "places": places,
        "factors": factors,
        "rows": rows,
    }


def profile_text(analysis: Analysis) -> str:
    """`profile` as JSON that may stand inside a script element."""
    return json.dumps(profile(analysis), separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")


def _levels(analysis: Analysis) -> list[list[float]]:
    """Coded values of each factor on the grid, the recommended setting among them."""
    factors, best = analysis.region.factors, analysis.optimum.point
    fixed = 1
    for factor in factors:
        fixed *= 1 if isinstance(factor, ContinuousFactor) else len(factor.coded_levels)
    free = sum(isinstance(factor, ContinuousFactor) for factor in factors)
    count = int(np.clip((MOST_NODES / fixed) ** (1.0 / max(free, 1)), _LEAST, _MOST))
    found = []
    for j, factor in enumerate(factors):
        if isinstance(factor, ContinuousFactor):
            # The node nearest to the recommended setting gives way to it: the page begins where the report stands.
            # Of three the middle one, since a fourth would make ten times as many settings of eight factors.
            nodes = np.linspace(-1.0, 1.0, count)
            near = nodes[1:-1] if count == _LEAST and abs(best[j]) < 1.0 else nodes
            near[np.argmin(np.abs(near - best[j]))] = best[j]
            found.append(sorted({-1.0, *nodes.tolist(), 1.0}))
        else:
            found.append(factor.coded_levels.tolist())
    return found


def _text(factor: Factor, coded: float) -> str:
    if isinstance(factor, CategoricalFactor):
        return factor.levels[int(coded)]
    return format_setting(factor, float(factor.decode(np.array([coded]))[0]))


def _axis(factor: Factor, coded: list[float]) -> list[float]:
    values: FloatArray = np.array(coded)
    if isinstance(factor, CategoricalFactor):
        values = (values + 0.5) / len(coded) * 2.0 - 1.0
    return [round(value, 4) for value in (0.5 * (values + 1.0)).tolist()]
