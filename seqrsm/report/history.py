"""The looks at the data in the order they were taken: how optimum and intervals moved as runs came in."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

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
        looks[record.after_run] = _read(record)
    return tuple(looks[n] for n in sorted(looks))


def _read(record: LookRecord) -> Look:
    summary, optimum = record.summary, record.summary["optimum"]
    return Look(
        n_runs=record.after_run,
        half_width=_number(summary["half_width"]),
        confidence_half_width=_number(optimum["confidence"]["half_width"]),
        prediction_half_width=_number(optimum["prediction"]["half_width"]),
        mean=_number(optimum["mean"]),
        settings=dict(optimum["settings"]),
        held=summary["held"],
    )


def _number(value: float | None) -> float:
    return math.nan if value is None else value
