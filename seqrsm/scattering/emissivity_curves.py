"""Emissivity curves over the look angle, as read from long CSV tables and interpolated between their nodes."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from scipy.interpolate import PchipInterpolator

from seqrsm.arrays import FloatArray
from seqrsm.errors import Problem, ScatteringDataError
from seqrsm.scattering.curves import THETA_DEG
from seqrsm.scattering.readers import STATUSES, Row, read_rows

POLARIZATIONS: Final = ("H", "V")

FREQUENCY_RANGE_GHZ: Final = (0.3, 100.0)
"""Lowest and highest frequency of a table [GHz]."""

_REQUIRED: Final = (
    "quantity", "category", "frequency_ghz", "polarization", "theta_deg", "value", "unit", "status", "source",
)  # fmt: skip
_OPTIONAL: Final = ("season", "moisture", "snow_cm", "wind_m_s", "sd", "mean_sd")
_THIRD_OCTAVE: Final = 2.0 ** (1.0 / 3.0)


@dataclass(frozen=True, slots=True, eq=False)
class EmissivityCurve:
    """Nodes of one category: emissivity (91,) by (frequency [GHz], polarization), its status and note."""

    value: Mapping[tuple[float, str], FloatArray]
    status: str
    note: str
    printed: bool


def between_nodes(name: str, curve: EmissivityCurve, f: float, polarization: str, file: str) -> FloatArray:
    """A user's curve (91,) at a frequency: linear in the logarithm of frequency between nodes.

    Parameters
    ----------
    name : str
        Category, for messages.
    curve : EmissivityCurve
    f : float
        Frequency [GHz], at most a third of an octave beyond the nodes, where the curve is held.
    polarization : {"H", "V"}
    file : str
        For messages, or "".

    Raises
    ------
    ScatteringDataError
        No such polarization, or too far from the nodes.
    """
    nodes = sorted(node for node, p in curve.value if p == polarization)
    if not nodes:
        message = f"the table has no {polarization} emissivity of {name}"
        raise ScatteringDataError(Problem(message, "Add its rows", file or None, field="polarization"))
    low, high = nodes[0] / _THIRD_OCTAVE, nodes[-1] * _THIRD_OCTAVE
    if not low <= f <= high:
        message = f"emissivity of {name} at {polarization} is known at {nodes[0]:g} to {nodes[-1]:g} GHz"
        remedy = f"Stay within {low:.4g} to {high:.4g} GHz, or add rows"
        raise ScatteringDataError(Problem(message, remedy, file or None, field="frequency", value=f))
    upper = int(np.clip(np.searchsorted(nodes, f), 1, max(len(nodes) - 1, 1)))
    if len(nodes) == 1:
        return np.asarray(curve.value[nodes[0], polarization])
    share = float(np.clip(np.log(f / nodes[upper - 1]) / np.log(nodes[upper] / nodes[upper - 1]), 0.0, 1.0))
    below, above = curve.value[nodes[upper - 1], polarization], curve.value[nodes[upper], polarization]
    return np.asarray((1.0 - share) * below + share * above)


def interpolated(theta_deg: Sequence[float], value: Sequence[float]) -> FloatArray:
    """Emissivity on `THETA_DEG`: shape-preserving cubics through the nodes, held beyond the first and the last.

    Fritsch and Carlson 1980, Monotone piecewise cubic interpolation: monotone between two nodes, so it never leaves
    their values. Straight where there are only two nodes.
    """
    angle, e = np.asarray(theta_deg, dtype=np.float64), np.asarray(value, dtype=np.float64)
    at = np.clip(THETA_DEG, angle[0], angle[-1])
    out = np.asarray(PchipInterpolator(angle, e)(at)) if angle.size > 2 else np.interp(at, angle, e)
    # The cubic's own rounding must not show at a node, nor beyond the outer ones.
    out[angle[0] >= THETA_DEG] = e[0]
    out[angle[-1] <= THETA_DEG] = e[-1]
    for a, v in zip(angle, e, strict=True):
        out[a == THETA_DEG] = v
    return np.asarray(out)


def read_curves(
    path: str | Path, *, printed: bool
) -> tuple[dict[str, EmissivityCurve], dict[str, float], dict[str, float]]:
    """Curves, field-to-field standard deviations and stated standard deviations of the mean, by category.

    Parameters
    ----------
    path : str or Path
        Long CSV; its columns are those of `seqrsm.scattering.longtable`.
    printed : bool
        True for the shipped transcription of Table 3.

    Raises
    ------
    ScatteringDataError
        Every wrong row, with its line and column.
    """
    problems: list[Problem] = []
    nodes: dict[str, dict[tuple[float, str], list[tuple[float, float, Row]]]] = defaultdict(lambda: defaultdict(list))
    sd: dict[str, list[float]] = defaultdict(list)
    mean_sd: dict[str, list[float]] = defaultdict(list)
    rows: dict[str, list[Row]] = defaultdict(list)
    for row in read_rows(path, _REQUIRED, _OPTIONAL):
        node = _node(row, problems)
        if node is not None:
            name = row.text("category")
            nodes[name][node[0], node[1]].append((node[2], node[3], row))
            rows[name].append(row)
            if np.isfinite(node[4]):
                sd[name].append(node[4])
            if row.text("mean_sd"):
                mean_sd[name].append(row.number("mean_sd", problems, 0.0, 1.0))
    if not nodes and not problems:
        problems.append(Problem("the table has no rows", f"Columns: {', '.join(_REQUIRED)}", str(path)))
    curves = {}
    for name, groups in nodes.items():
        value = {key: _angles(name, key, group, problems) for key, group in groups.items()}
        status = max((row.text("status") for row in rows[name]), key=STATUSES.index)
        if printed:
            note = "Table 3 of RSL TR 380-1; its frequency (20 GHz), polarization (H) and moisture (0.2) are inferred"
        else:
            sources = ", ".join(sorted({row.text("source") for row in rows[name]}))
            note = f"{name}: rows of {Path(path).name} ({status}: {sources})"
        curves[name] = EmissivityCurve(value, status, note, printed)
    if problems:
        raise ScatteringDataError(*problems)
    of_fields, of_means = ({name: float(np.mean(x)) for name, x in found.items()} for found in (sd, mean_sd))
    return curves, of_fields, of_means


def _node(row: Row, problems: list[Problem]) -> tuple[float, str, float, float, float] | None:
    """Frequency, polarization, angle, emissivity and sd of a row, or None after its faults are noted."""
    before = len(problems)
    row.choice("quantity", problems, ("emissivity",))
    row.choice("unit", problems, ("1",))
    row.choice("status", problems, STATUSES)
    polarization = row.choice("polarization", problems, POLARIZATIONS)
    problems += [
        row.problem(column, "empty", "Every row needs a category and a source")
        for column in ("category", "source")
        if not row.text(column)
    ]
    problems += [
        row.problem(column, "an emissivity table by this state is not supported", "Leave it empty")
        for column in ("moisture", "snow_cm", "wind_m_s", "season")
        if row.text(column)
    ]
    frequency = row.number("frequency_ghz", problems, *FREQUENCY_RANGE_GHZ)
    theta = row.number("theta_deg", problems, 0.0, 90.0)
    value = row.number("value", problems, 0.0, 1.0)
    sd = row.number("sd", problems, 0.0, 0.5) if row.text("sd") else np.nan
    return None if len(problems) > before else (frequency, polarization, theta, value, sd)


def _angles(
    name: str, key: tuple[float, str], group: list[tuple[float, float, Row]], problems: list[Problem]
) -> FloatArray:
    """One curve on `THETA_DEG` from its nodes."""
    group = sorted(group, key=lambda node: node[0])
    angles = [node[0] for node in group]
    at = f"{name}, {key[0]:g} GHz, {key[1]}"
    problems += [
        node[2].problem("theta_deg", f"{at}: the angle is given twice")
        for node, following in zip(group[1:], angles[:-1], strict=True)
        if node[0] == following
    ]
    if len(set(angles)) < 2:
        problems.append(Problem(f"{at}: at least 2 look angles are needed", "", group[0][2].file, field="theta_deg"))
        return np.zeros(THETA_DEG.size)
    if len(set(angles)) < len(angles):
        return np.zeros(THETA_DEG.size)
    return interpolated(angles, [node[1] for node in group])
