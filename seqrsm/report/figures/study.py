"""Regions of the optimum's place in pairs of factors: results in, drawings out."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from seqrsm.analysis.results import Analysis
from seqrsm.arrays import FloatArray
from seqrsm.design.factors import span
from seqrsm.fit.location import LocationRegion
from seqrsm.report.figures import drawing
from seqrsm.report.figures.optimum import set_numeric_axis
from seqrsm.report.figures.surfaces import numeric_factor
from seqrsm.report.study_text import LOCATION_METHODS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COLORS = {
    "scheffe": ("blue", drawing.BLUE),
    "simulated": ("blue", drawing.BLUE),
    "box_hunter": ("green", drawing.GREEN),
    "simulation set": ("orange", drawing.ORANGE),
}
_FEW = 400  # points of a region that are drawn


def location_panel(analysis: Analysis, regions: Sequence[LocationRegion], x: int, y: int) -> str:
    """Draw the points of every region over two numeric factors, with the hull of each."""
    return drawing.draw(partial(_paint, analysis, regions, x, y), height_in=3.0)


def location_key(regions: Sequence[LocationRegion]) -> str:
    """What the colours of :func:`location_panel` stand for."""
    return "; ".join(f"{_COLORS[region.method][0]}: {LOCATION_METHODS[region.method]}" for region in regions)


def _paint(analysis: Analysis, regions: Sequence[LocationRegion], x: int, y: int, figure: Figure) -> None:
    axes = figure.add_subplot()
    across, up = numeric_factor(analysis, x), numeric_factor(analysis, y)
    for region in regions:
        color = _COLORS[region.method][1]
        coded = region.points[:, [x, y]]
        if not len(coded):
            continue
        some = coded[np.unique(np.linspace(0, len(coded) - 1, _FEW).astype(np.int64))]
        axes.scatter(across.decode(some[:, 0]), up.decode(some[:, 1]), s=5, color=color, alpha=0.45, linewidths=0)
        ring = _hull(coded)
        if len(ring) > 2:
            axes.plot(across.decode(ring[:, 0]), up.decode(ring[:, 1]), color=color, linewidth=1.1)
    best = analysis.optimum.point[[x, y]]
    axes.scatter(
        across.decode(best[:1]),
        up.decode(best[1:]),
        s=130,
        marker="*",
        facecolor=drawing.ORANGE,
        edgecolor=drawing.INK,
        linewidths=0.9,
        zorder=5,
        clip_on=False,
    )
    set_numeric_axis(axes, "x", across)
    set_numeric_axis(axes, "y", up)
    axes.set_xlim(*span(across))
    axes.set_ylim(*span(up))
    drawing.light_grid(axes)


def _hull(points: FloatArray) -> FloatArray:
    """Corners of the convex hull of points (n, 2), closed; the points themselves where they span no area."""
    from scipy.spatial import ConvexHull, QhullError

    distinct = np.unique(np.round(points, 9), axis=0)
    if len(distinct) < 3:
        return distinct
    try:
        corners = ConvexHull(distinct).vertices
    except QhullError:  # all on one line
        return distinct[[0, -1]]
    ring: FloatArray = distinct[np.append(corners, corners[0])]
    return ring
