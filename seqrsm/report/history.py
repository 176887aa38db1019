"""The looks at the data in the order they were taken: how optimum and intervals moved as runs came in."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from seqrsm.store.records import LookRecord


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
    held : bool or None
        Whether the stop rule held; None where it was not recorded.
    """

    n_runs: int
    half_width: float
    confidence_half_width: float
    prediction_half_width: float
    mean: float
    settings: Mapping[str, float | str]
    held: bool | None


def read_looks(records: tuple[LookRecord, ...], application: str) -> tuple[Look, ...]:
    """Read the looks of one application, in order; of two at the same number of runs the later one counts.

    The summary is either flat or shaped like ``fit --json`` (``optimum`` and ``stop`` inside).
    """
    looks: dict[int, Look] = {}
    for record in sorted((r for r in records if r.application == application), key=lambda r: r.look):
        looks[record.after_run] = _read(record)
    return tuple(looks[n] for n in sorted(looks))


def _read(record: LookRecord) -> Look:
    summary = record.summary
    optimum = _mapping(summary.get("optimum")) or summary
    stop = _mapping(summary.get("stop"))
    held = summary.get("held", stop.get("held"))
    settings = _mapping(optimum.get("settings")) or _mapping(summary.get("settings"))
    return Look(
        n_runs=record.after_run,
        half_width=_number(summary.get("half_width", stop.get("half_width"))),
        confidence_half_width=_half_width(optimum, "confidence"),
        prediction_half_width=_half_width(optimum, "prediction"),
        mean=_number(optimum.get("mean")),
        settings={str(name): value if isinstance(value, str) else _number(value) for name, value in settings.items()},
        held=held if isinstance(held, bool) else None,
    )


def _mapping(value: object) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}


def _number(value: object) -> float:
    return float(value) if isinstance(value, (int, float)) and not isinstance(value, bool) else math.nan


def _half_width(optimum: Mapping[str, Any], name: str) -> float:
    flat = optimum.get(f"{name}_half_width")
    if flat is not None:
        return _number(flat)
    interval = optimum.get(name)
    if isinstance(interval, Mapping):
        if interval.get("half_width") is not None:
            return _number(interval["half_width"])
        return 0.5 * (_number(interval.get("high")) - _number(interval.get("low")))
    return math.nan
