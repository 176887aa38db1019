"""Fraction-of-design-space plot of a stand-alone design."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from seqrsm.errors import Problem, UserError
from seqrsm.report.figures.drawing import BLUE, GRID, INK

_ENDINGS = (".png", ".svg", ".pdf")


def write_design_figure(path: Path, curve: Sequence[float | None], n_terms: int) -> None:
    """Draw the scaled prediction variance that a share of the region does not exceed.

    Parameters
    ----------
    path : Path
        ``.png``, ``.svg`` or ``.pdf``.
    curve : sequence of float
        At 0, 1 ... 100 % of the region; None where the design cannot estimate the model.
    n_terms : int
        Its largest value cannot fall below this.

    Raises
    ------
    UserError
        Another ending, a design without variances, or a file that cannot be written.
    """
    if path.suffix.lower() not in _ENDINGS:
        remedy = f"Use {', '.join(_ENDINGS)}."
        raise UserError(Problem("unknown kind of picture", remedy, field="--plot", value=path.name))
    if any(value is None for value in curve):
        remedy = "Add runs, or leave terms out (--order 1)."
        raise UserError(Problem("the design cannot estimate the model: there is nothing to draw", remedy, "--plot"))
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.0, 3.8), layout="constrained")
    axes = figure.add_subplot()
    axes.plot(np.linspace(0.0, 100.0, len(curve)), [float(value or 0.0) for value in curve], color=BLUE)
    axes.axhline(n_terms, color=INK, linewidth=0.8, linestyle="--")
    axes.annotate(f"{n_terms} terms: least possible maximum", (2, n_terms), va="bottom", fontsize=8, color=INK)
    axes.set_xlabel("share of the region [%]")
    axes.set_ylabel("scaled prediction variance, not exceeded")
    axes.set_xlim(0, 100)
    axes.set_ylim(bottom=0)
    axes.grid(color=GRID, linewidth=0.6)
    try:
        figure.savefig(path, dpi=150)
    except OSError as error:
        raise UserError(Problem(f"cannot write the file: {error.strerror}", file=str(path))) from error
