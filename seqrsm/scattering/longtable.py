"""A user's own tables: one CSV row for each node.

Columns ``quantity, category, frequency_ghz, polarization, theta_deg, value, unit, status, source`` are required;
``season`` (empty: spring_summer), ``sd`` (field-to-field standard deviation [dB]), ``mean_sd`` (standard deviation of
the mean [dB]; empty: by the status), ``wind_m_s``, ``coherence`` and ``phase_deg`` (magnitude and phase of the mean of
HH times conjugate VV over the root of both powers; the phase asks for HV, too) are optional; ``moisture`` and
``snow_cm`` must be empty. ``quantity`` is ``sigma0`` (``unit``: ``dB`` or ``1``) or ``emissivity`` (``1``); each table
takes the rows of its own.
Between the angles given sigma0 is linear in dB; it is held before the first, and after the last up to 75 degrees, from
where on gamma is.

A calendar has ``day`` (of the year) in place of ``theta_deg``, and of the optional columns ``mean_sd``. Its ``value``
is what the day adds to the table's sigma0 [dB] or emissivity [1].
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.errors import Problem, ScatteringDataError
from seqrsm.scattering.coherence import MOST, Relation
from seqrsm.scattering.curves import THETA_DEG, Curve, continued_db, weakest
from seqrsm.scattering.readers import POLARIZATIONS, STATUSES, Row, read_rows

REQUIRED: Final = (
    "quantity", "category", "frequency_ghz", "polarization", "theta_deg", "value", "unit", "status", "source",
)  # fmt: skip
OPTIONAL: Final = ("season", "moisture", "snow_cm", "wind_m_s", "sd", "coherence", "phase_deg", "mean_sd")
CALENDAR: Final = tuple("day" if name == "theta_deg" else name for name in REQUIRED)

EMISSIVITY_GHZ: Final = (0.3, 170.0)
"""Lowest and highest frequency of a table of emissivity [GHz]."""

_SEASONS: Final = ("spring_summer", "fall", "winter")
K = TypeVar("K")

_NO_WIND: Final = 0.0
_PHASE: Final = ("coherence", "phase_deg")
_PHASE_ENDS: Final = ((0.0, MOST), (-180.0, 180.0))
_KNOWN_SD, _UNKNOWN_SD = 0.1, 0.2  # of a relation of HH and VV (assumed, as in the shipped table)
_MOST_TOLD: Final = 50


@dataclass(frozen=True, slots=True)
class Node:
    """One good row at an incidence angle [deg] or a day: [dB] of sigma0, [1] of emissivity; nan where not given.

    ``relation``: mean of HH times conjugate VV over the root of both powers.
    """

    row: Row
    category: str
    season: str
    frequency_ghz: float
    wind_m_s: float
    channel: str
    place: float
    value: float
    sd: float
    mean_sd: float
    relation: complex


def read_nodes(path: str | Path, quantity: str | None, *, needed: bool = True) -> list[Node]:
    """Nodes of a quantity, those of another left out; None: all of a calendar.

    Raises
    ------
    ScatteringDataError
        No table of these columns, faults in its rows, or no rows of the quantity where they are ``needed``.
    """
    problems: list[Problem] = []
    columns, optional = (REQUIRED, OPTIONAL) if quantity else (CALENDAR, OPTIONAL[-1:])
    nodes = [_node(row, quantity is None, problems) for row in read_rows(path, columns, optional)]
    refuse(problems, path)  # or a curve would seem to lack the nodes of these rows
    own = [node for node in nodes if node is not None and quantity in (None, node.row.text("quantity"))]
    if needed and not own:
        text = f"the table has no rows of {quantity}" if quantity else "the table has no rows"
        raise ScatteringDataError(text, f"Columns: {', '.join(columns)}", file=str(path))
    return own


def refuse(problems: list[Problem], path: str | Path) -> None:
    """Raise ScatteringDataError where there are problems, with the first of them."""
    if problems:
        more = len(problems) - _MOST_TOLD
        rest = [Problem(f"{more} more problems like these", file=str(path))] if more > 0 else []
        raise ScatteringDataError(*problems[:_MOST_TOLD], *rest)


def in_order(block: list[Node], at: str, problems: list[Problem], column: str = "theta_deg") -> list[Node]:
    """The nodes of one curve by rising angle or day, two at least; else none, with the fault added to ``problems``."""
    places = [node.place for node in block]
    found = [node.row.problem(column, f"{at}: it is given twice") for node in block if places.count(node.place) > 1]
    if len(block) == 1:
        found = [block[0].row.problem(column, f"{at}: 1 row, at least 2 are needed", "Add some")]
    problems += found
    return [] if found else sorted(block, key=lambda node: node.place)


def read_long_table(
    path: str | Path, *, needed: bool = True
) -> tuple[dict[tuple[str, str], Curve], dict[tuple[str, str], float], dict[str, list[Relation]]]:
    """Curves by (category, season), field-to-field standard deviation by (category, polarization), relations of HH, VV.

    Raises
    ------
    ScatteringDataError
        Every wrong row, with its line and column; nodes that are missing or given twice; a table all above 0 dB.
    """
    problems: list[Problem] = []
    nodes = read_nodes(path, "sigma0", needed=needed)
    if nodes and all(node.value > 0.0 and node.row.text("unit") == "dB" for node in nodes):
        remedy = 'Give linear numbers the unit "1", and decibels their sign'
        text = "every value is above 0 dB, as on no natural ground"
        raise ScatteringDataError(text, remedy, file=str(path), field="value")
    groups: dict[tuple[str, str], list[Node]] = defaultdict(list)
    for node in nodes:
        groups[node.category, node.season].append(node)
    curves = {key: curve for key, group in groups.items() if (curve := _curve(key, group, problems)) is not None}
    refuse(problems, path)
    return curves, stated(nodes, "sd", lambda node: (node.category, node.channel)), _relations(nodes)


def _relations(nodes: list[Node]) -> dict[str, list[Relation]]:
    """How HH and VV are related by category, frequency rising: means over the rows of each that state it."""
    found: dict[str, list[Relation]] = defaultdict(list)
    given = stated(nodes, "relation", lambda node: (node.category, node.frequency_ghz))
    for (category, ghz), mean in sorted(given.items()):
        rows = [node.row for node in nodes if (node.category, node.frequency_ghz) == (category, ghz)]
        status = weakest(row.text("status") for row in rows)
        sd = _KNOWN_SD if status == "measured" else _UNKNOWN_SD
        found[category].append(Relation(ghz, mean, sd, status, rows[0].text("source")))
    return found


def weights_of_nodes(nodes: Sequence[float], frequency_ghz: float) -> FloatArray:
    """What each of rising frequencies (n,) counts on straight lines over the logarithm, held beyond the ends."""
    place = np.interp(np.log(frequency_ghz), np.log(nodes), np.arange(len(nodes)))
    return np.maximum(1.0 - np.abs(np.arange(len(nodes)) - place), 0.0)


def stated(nodes: list[Node], name: str, key: Callable[[Node], K]) -> dict[K, Any]:
    """Mean of "sd", "mean_sd" or "relation" over the nodes of each key that state it."""
    found: dict[K, list[complex]] = defaultdict(list)
    for node in nodes:
        if np.isfinite(value := getattr(node, name)):
            found[key(node)].append(value)
    return {own: np.mean(values).item() for own, values in found.items()}


def _node(row: Row, of_day: bool, problems: list[Problem]) -> Node | None:
    """The node of a row, or None after its faults are appended to ``problems``; ``of_day``: of a calendar."""
    before = len(problems)
    quantity = row.choice("quantity", problems, ("sigma0", "emissivity"))
    if len(problems) > before:
        return None  # what else is wrong depends on it
    if quantity == "sigma0":
        limits, limits_ghz = {"dB": (-100.0, 40.0), "1": (1e-10, 1e4)}, (0.1, 300.0)
        channels, states, most_sd, most_mean_sd = [*POLARIZATIONS, "VH"], ["wind_m_s", "season", *_PHASE], 20.0, 20.0
    else:
        limits, limits_ghz = {"1": (0.0, 1.0)}, EMISSIVITY_GHZ
        channels, states, most_sd, most_mean_sd = ["H", "V"], [], 0.5, 1.0
    if of_day:
        limits = {"1": (-1.0, 1.0)} if quantity == "emissivity" else {"dB": (-40.0, 40.0)}
    unit = row.choice("unit", problems, tuple(limits))
    row.choice("status", problems, STATUSES)
    empty = [column for column in ("category", "source") if not row.text(column)]
    problems += [row.problem(column, "empty", "Every row needs a category and a source") for column in empty]
    every = "moisture", "snow_cm", "wind_m_s", "season", *_PHASE
    others = [name for name in every if row.text(name) and name not in states]
    problems += [row.problem(name, "a table by this state is not supported", "Leave it empty") for name in others]
    stated = {column for column in (*states, "sd", "mean_sd") if row.text(column)}
    season = row.choice("season", problems, _SEASONS) if "season" in stated else _SEASONS[0]
    channel = row.choice("polarization", problems, channels)
    frequency = row.number("frequency_ghz", problems, *limits_ghz)
    place = row.number("day", problems, 1.0, 365.0) if of_day else row.number("theta_deg", problems, 0.0, 90.0)
    wind = row.number("wind_m_s", problems, 0.1, 50.0) if "wind_m_s" in stated else _NO_WIND
    sd = row.number("sd", problems, 0.0, most_sd) if "sd" in stated else np.nan
    mean_sd = row.number("mean_sd", problems, 0.0, most_mean_sd) if "mean_sd" in stated else np.nan
    value = row.number("value", problems, *limits.get(unit, (-np.inf, np.inf)))
    relation = complex(np.nan)
    if any(name in stated for name in _PHASE):
        size, turn = (row.number(name, problems, *ends) for name, ends in zip(_PHASE, _PHASE_ENDS, strict=True))
        relation = size * complex(np.exp(1j * np.deg2rad(turn)))
    if len(problems) > before:
        return None
    if quantity == "sigma0" and unit == "1":
        value = float(10.0 * np.log10(value))
    channel = "HV" if channel == "VH" else channel
    return Node(row, row.text("category"), season, frequency, wind, channel, place, value, sd, mean_sd, relation)


def _curve(key: tuple[str, str], nodes: list[Node], problems: list[Problem]) -> Curve | None:
    """Curve of the nodes of one category and season."""
    frequencies = sorted({node.frequency_ghz for node in nodes})
    winds = sorted({node.wind_m_s for node in nodes})
    channels = sorted({node.channel for node in nodes})
    before = len(problems)
    value = np.full((len(winds), len(frequencies), len(POLARIZATIONS), THETA_DEG.size), np.nan)
    for (w, wind), (f, frequency), channel in product(enumerate(winds), enumerate(frequencies), channels):
        block = [n for n in nodes if (n.wind_m_s, n.frequency_ghz, n.channel) == (wind, frequency, channel)]
        at = f"{key[0]}, {key[1]}, {frequency:g} GHz, {channel}"
        if block and (curve := in_order(block, at, problems)):
            level = np.interp(THETA_DEG, [node.place for node in curve], [node.value for node in curve])
            value[w, f, POLARIZATIONS.index(channel)] = continued_db(level, curve[-1].place)  # gamma held beyond
    if len(problems) > before:
        return None
    status = [weakest(n.row.text("status") for n in nodes if n.frequency_ghz == f) for f in frequencies]
    of_mean = stated(nodes, "mean_sd", lambda node: (node.frequency_ghz, node.channel))
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
        status=tuple((own,) * 3 for own in status),
        notes=(f"rows of {Path(nodes[0].row.file).name} ({'; '.join(sources)})",),
        as_given=True,
        mean_sd_db=np.array([[of_mean.get((f, p), np.nan) for p in POLARIZATIONS] for f in frequencies]),
    )
