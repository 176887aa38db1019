"""A user's own backscatter table: one CSV row for each node.

Columns ``quantity, category, frequency_ghz, polarization, theta_deg, value, unit, status, source`` are required;
``season`` (empty: spring_summer), ``sd`` (field-to-field standard deviation [dB]), ``mean_sd`` (standard deviation of
the mean [dB]; empty: by the status) and ``wind_m_s`` are optional, and so are ``moisture`` and ``snow_cm``, which must
be empty. ``quantity`` is ``sigma0``, ``unit`` is ``dB`` or ``1``.
Between the angles given sigma0 is linear in dB; it is held before the first, and after the last up to 75 degrees, from
where on gamma is.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.errors import Problem, ScatteringDataError
from seqrsm.scattering.curves import THETA_DEG, Curve, continued_db, weakest
from seqrsm.scattering.readers import POLARIZATIONS, STATUSES, Row, read_rows

REQUIRED: Final = (
    "quantity", "category", "frequency_ghz", "polarization", "theta_deg", "value", "unit", "status", "source",
)  # fmt: skip
OPTIONAL: Final = ("season", "moisture", "snow_cm", "wind_m_s", "sd", "mean_sd")

_SEASONS: Final = ("spring_summer", "fall", "winter")
_NO_WIND: Final = 0.0
_MOST_TOLD: Final = 50


@dataclass(frozen=True, slots=True)
class _Node:
    """One good row."""

    row: Row
    key: tuple[str, str]
    frequency_ghz: float
    wind_m_s: float
    channel: str
    theta_deg: float
    value_db: float
    sd_db: float
    mean_sd_db: float


def read_long_table(path: str | Path) -> tuple[dict[tuple[str, str], Curve], dict[tuple[str, str], float]]:
    """Curves by (category, season) and field-to-field standard deviation by (category, polarization).

    Raises
    ------
    ScatteringDataError
        Every wrong row, with its line and column; and nodes that are missing or given twice.
    """
    problems: list[Problem] = []
    nodes = [node for row in read_rows(path, REQUIRED, OPTIONAL) if (node := _node(row, problems)) is not None]
    groups: dict[tuple[str, str], list[_Node]] = defaultdict(list)
    for node in nodes:
        groups[node.key].append(node)
    if not groups and not problems:
        problems.append(Problem("the table has no rows", f"Columns: {', '.join(REQUIRED)}", str(path)))
    curves = {key: curve for key, group in groups.items() if (curve := _curve(key, group, problems)) is not None}
    if problems:
        more = len(problems) - _MOST_TOLD
        rest = [Problem(f"{more} more problems like these", file=str(path))] if more > 0 else []
        raise ScatteringDataError(*problems[:_MOST_TOLD], *rest)
    spread: dict[tuple[str, str], list[float]] = defaultdict(list)
    for node in nodes:
        if np.isfinite(node.sd_db):
            spread[node.key[0], node.channel].append(node.sd_db)
    return curves, {key: float(np.mean(values)) for key, values in spread.items()}


def _node(row: Row, problems: list[Problem]) -> _Node | None:
    """The node of a row, or None after its faults are appended to ``problems``."""
    before = len(problems)
    row.choice("quantity", problems, ("sigma0",))
    unit = row.choice("unit", problems, ("dB", "1"))
    row.choice("status", problems, STATUSES)
    problems += [
        row.problem(column, "empty", "Every row needs a category and a source")
        for column in ("category", "source")
        if not row.text(column)
    ]
    problems += [
        row.problem(column, "a table by this state is not supported", "Leave it empty")
        for column in ("moisture", "snow_cm")
        if row.text(column)
    ]
    season = row.choice("season", problems, _SEASONS) if row.text("season") else _SEASONS[0]
    channel = row.choice("polarization", problems, (*POLARIZATIONS, "VH"))
    frequency = row.number("frequency_ghz", problems, 0.1, 300.0)
    theta = row.number("theta_deg", problems, 0.0, 90.0)
    wind = row.number("wind_m_s", problems, 0.1, 50.0) if row.text("wind_m_s") else _NO_WIND
    sd = row.number("sd", problems, 0.0, 20.0) if row.text("sd") else np.nan
    mean_sd = row.number("mean_sd", problems, 0.0, 20.0) if row.text("mean_sd") else np.nan
    value = row.number("value", problems, *((-100.0, 40.0) if unit == "dB" else (1e-10, 1e4)))
    if len(problems) > before:
        return None
    value_db = value if unit == "dB" else float(10.0 * np.log10(value))
    channel = "HV" if channel == "VH" else channel
    return _Node(row, (row.text("category"), season), frequency, wind, channel, theta, value_db, sd, mean_sd)


def _curve(key: tuple[str, str], nodes: list[_Node], problems: list[Problem]) -> Curve | None:
    """Curve of the nodes of one category and season."""
    frequencies = sorted({node.frequency_ghz for node in nodes})
    winds = sorted({node.wind_m_s for node in nodes})
    channels = sorted({node.channel for node in nodes})
    before = len(problems)
    value = np.full((len(winds), len(frequencies), len(POLARIZATIONS), THETA_DEG.size), np.nan)
    for w, wind in enumerate(winds):
        for f, frequency in enumerate(frequencies):
            for channel in channels:
                block = [n for n in nodes if (n.wind_m_s, n.frequency_ghz, n.channel) == (wind, frequency, channel)]
                at = f"{key[0]}, {key[1]}, {frequency:g} GHz, {channel}"
                value[w, f, POLARIZATIONS.index(channel)] = _resampled(block, nodes[0].row.file, at, problems)
    if len(problems) > before:
        return None
    stated = np.array(
        [
            [_mean([n.mean_sd_db for n in nodes if (n.frequency_ghz, n.channel) == (f, p)]) for p in POLARIZATIONS]
            for f in frequencies
        ]
    )
    sources = sorted({f"{n.row.text('status')}: {n.row.text('source')}" for n in nodes})
    return Curve(
        category=key[0],
        season=key[1],
        frequency_ghz=np.array(frequencies),
        wind_m_s=np.array(winds),
        value_db=value,
        surface=False,
        water=False,
        soil_rms_height_m=None,
        reference_moisture=0.2,
        status=tuple(
            (weakest(n.row.text("status") for n in nodes if n.frequency_ghz == frequency),) * 3
            for frequency in frequencies
        ),
        sources=tuple(dict.fromkeys(n.row.text("source") for n in nodes)),
        notes=(f"rows of {Path(nodes[0].row.file).name} ({'; '.join(sources)})",),
        rows=tuple(f"{Path(n.row.file).name}:{n.row.line} ({n.row.text('status')})" for n in nodes),
        as_given=True,
        mean_sd_db=stated,
    )


def _mean(values: list[float]) -> float:
    """Mean of those that are there, nan if none is."""
    there = [value for value in values if np.isfinite(value)]
    return float(np.mean(there)) if there else np.nan


def _resampled(block: list[_Node], file: str, at: str, problems: list[Problem]) -> FloatArray:
    """Values on the 1-degree grid, linear in dB, held at the ends; gamma held beyond 75 deg and the last angle."""
    angles = [node.theta_deg for node in block]
    if len(angles) < 2:
        message = f"{at}: {len(angles)} incidence angles, at least 2 are needed"
        problems.append(Problem(message, "Give every channel at every frequency and wind", file, field="theta_deg"))
        return np.full(THETA_DEG.size, np.nan)
    problems += [
        node.row.problem("theta_deg", f"{at}: the angle is given twice")
        for node in block
        if angles.count(node.theta_deg) > 1
    ]
    order = np.argsort(angles)
    value = np.interp(THETA_DEG, np.array(angles)[order], np.array([node.value_db for node in block])[order])
    return continued_db(np.asarray(value), max(angles))
