"""What must hold of ``[[candidate]]``: known sensors, channels that they have, parameters that there are."""

from __future__ import annotations

from collections.abc import Sequence

from seqrsm.sensor.named import nearest_names, sensors_called
from seqrsm.spec.checks import Reporter, Sensors
from seqrsm.spec.tables import CandidateSpec


def check_candidates(
    tables: Sequence[CandidateSpec | None], instruments: Sensors, factors: Sequence[str], report: Reporter
) -> None:
    """Note every fault of the candidates; ``factors``: names of the campaign's."""
    names: set[str] = set()
    for index, table in enumerate(tables):
        if table is None:
            continue
        path = ("candidate", index)
        own = table.name or f"{table.sensor} {table.polarization}".strip()
        if own in names:
            report.add(path, "this candidate is listed twice", "Remove one.", own)
        names.add(own)
        if table.sensor:
            _check_sensor(path, table, instruments, report)
        elif not table.name or not table.parameters:
            remedy = 'Give sensor = "Sentinel-1 IW GRDH", or name and parameters = { frequency = 5.4 }.'
            report.add(path, "a candidate is a known sensor, or a name with parameters", remedy)
        for key, value in table.parameters.items():
            place, row = (*path, "parameters", key), instruments.parameter(key)
            if instruments.engine is None and key not in factors:
                remedy = f"Factors are {', '.join(factors)}."
                report.add(place, "without a simulator a candidate is defined by its factors", remedy, value)
            elif instruments.engine is not None and row is None:
                report.unknown_key(place, instruments.table(""))
            elif instruments.engine is not None and row is not None and row.kind != "file" and key != "frequency":
                for problem in row.level_problems(value):
                    report.add(place, problem.message, f"{problem.remedy}.", value)


def _check_sensor(path: tuple[str, int], table: CandidateSpec, instruments: Sensors, report: Reporter) -> None:
    found = sensors_called(table.sensor)
    place = (*path, "sensor")
    if not found:
        near = nearest_names(table.sensor)
        known = f"Did you mean {' or '.join(near)}?" if near else "`seqrsm catalog NAME` lists them."
        report.add(place, "no sensor has this name", known, table.sensor)
        return
    fitting = [one for one in found if instruments.engine in (None, one.engine)]
    if not fitting:
        kind = "radars" if instruments.engine == "psm" else "radiometers"
        report.add(place, f"the engine '{instruments.engine}' simulates {kind}", "Name one of these.", table.sensor)
        return
    asked = table.polarization
    if asked and not any(set(asked.split("+")) == set(own.split("+")) for one in fitting for own in one.channels):
        there = dict.fromkeys(own for one in fitting for own in one.channels)
        remedy = f"It has {', or '.join(there)}."
        report.add((*path, "polarization"), "the sensor has no such set of channels", remedy, asked)
