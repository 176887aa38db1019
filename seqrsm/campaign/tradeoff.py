"""``seqrsm tradeoff``: speed against accuracy of this campaign's own simulations, measured.

Some configurations spread over the region are simulated on the same occasions on the database as it is and on coarser
ones; what each of these loses is set against the time it saves. Each configuration is kept as soon as it is measured,
in ``tradeoff.json`` of the campaign's folder: the same command goes on where it was interrupted.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from seqrsm import __version__
from seqrsm.arrays import FloatArray
from seqrsm.campaign.next_runs import rounded_settings
from seqrsm.campaign.simulation import NO_RUN, carry_out, detail_of, ground_of, scene_at, task_of
from seqrsm.campaign.simulator_checks import see_parameters
from seqrsm.errors import UserError
from seqrsm.files import get_json, put_json, see_writable
from seqrsm.fit.optimum import Goal, sign_of
from seqrsm.spec.read import CampaignSpec

FILE: Final = "tradeoff.json"

FIRST_RUN: Final = 2**30
"""Run id of the first occasion: far beyond any campaign's."""

LEVELS: Final = (0, 8, 4, 2)
"""Cells of the database along a side of a pixel at least, where it is made coarser; 0: as it is."""

COARSENED: Final = "coarser data base measured"
"""Kind of the event that keeps which of them a campaign takes."""

CONFIGURATIONS, OCCASIONS = 8, 6
_CONSIDERED, _COMPARED, _OCCASIONS = 60, 3, 2


def measure_tradeoff(spec: CampaignSpec, progress: Callable[[int, int], None]) -> dict[str, Any]:
    """Measure, or go on measuring, the trade-off of a campaign: plain values, also written to `FILE`.

    `CONFIGURATIONS` settings spread over the region with the centre among them are each simulated on `OCCASIONS`
    occasions on every database, the same for all. ``progress`` is told of (done, all) configurations. SpecError without
    a simulator, or where a parameter of it is missing; SceneError of a scene that cannot be read.
    """
    see_parameters(spec)
    see_writable(spec.folder / FILE)
    scene_at(str(spec.scene_path))
    key = {"spec": spec.spec_hash, "version": __version__}
    kept = _kept(spec.folder)
    if kept.get("key") != key:
        kept = {"key": key, "rows": [], "simulation": None}
    for done, own in enumerate(_some_configurations(spec, CONFIGURATIONS)):
        if done >= len(kept["rows"]):
            kept["rows"].append(_measured(spec, own, OCCASIONS))
            put_json(spec.folder / FILE, kept)
        progress(done + 1, CONFIGURATIONS)
    kept["simulation"] = _summary(spec, kept["rows"])
    put_json(spec.folder / FILE, kept)
    return {name: value for name, value in kept.items() if name != "rows"}


def read_tradeoff(folder: Path) -> dict[str, Any] | None:
    """The last trade-off that was measured to its end; None where there is none."""
    found = _kept(folder)
    return found if found.get("simulation") else None


def _kept(folder: Path) -> dict[str, Any]:
    """What was measured so far; nothing where the file is not there, or no such one."""
    found = get_json(folder / FILE)
    return found if isinstance(found, dict) else {}


def coarsest_within(spec: CampaignSpec) -> dict[str, Any]:
    """The coarsest database whose scores differ by no more than the campaign's tolerance, root mean square.

    Measured at settings from the finest to the coarsest sensor, for which most cells are averaged. Returns ``cells``,
    of `LEVELS`; ``tolerance``; ``rms_error``, of each that was compared, the worst application's.
    """
    assert spec.simulator is not None
    tolerance = spec.simulator.tolerance
    by_detail = sorted(_some_configurations(spec, _CONSIDERED), key=lambda own: detail_of(task_of(spec, NO_RUN, own)))
    places = np.linspace(0, len(by_detail) - 1, _COMPARED).astype(int)
    rows = [_measured(spec, by_detail[k], _OCCASIONS, timed=False) for k in places]
    good = [row for row in rows if not row["failure"]]
    found = {
        cells: max(_against_full(good, cells, one.name, one.goal)["rms_error"] for one in spec.applications)
        for cells in (LEVELS[1:] if good else ())
    }
    kept = [cells for cells, error in found.items() if error <= tolerance]
    errors = {str(cells): error for cells, error in found.items()}
    return {"cells": min(kept, default=0), "tolerance": tolerance, "rms_error": errors}


def _some_configurations(spec: CampaignSpec, n: int) -> list[dict[str, float | str]]:
    """The centre of the region and ``n - 1`` feasible settings spread over it, natural units."""
    points = spec.region.candidates(limit=2000)
    keep = np.random.default_rng(spec.seed).permutation(len(points))[: n - 1]
    return rounded_settings(spec.region, np.vstack([spec.region.centre()[None, :], points[keep]]))


def _measured(
    spec: CampaignSpec, settings: Mapping[str, float | str], occasions: int, *, timed: bool = True
) -> dict[str, Any]:
    """Scores, time and blocks of cells on every database at one configuration, on the same occasions.

    ``timed``: what is done once only, compiled or cached, is done before.
    """
    out: dict[str, Any] = {"settings": dict(settings), "levels": {}, "failure": ""}
    done: dict[int, dict[str, Any]] = {}
    for cells in LEVELS:
        tasks = [task_of(spec, FIRST_RUN + k, settings, cells=cells) for k in range(occasions)]
        try:
            averaged = ground_of(tasks[0])[1]
        except UserError as error:
            return {**out, "failure": str(error)}
        if averaged not in done:
            if timed:
                carry_out(tasks[0])
            scores, seconds = [], []
            for task in tasks:
                start = time.process_time()
                found = carry_out(task)
                seconds.append(time.process_time() - start)
                if found.failure:
                    return {**out, "failure": found.failure}
                scores.append({one.application: one.score for one in found.scores})
            done[averaged] = {"averaged": averaged, "scores": scores, "seconds": seconds}
        out["levels"][str(cells)] = done[averaged]
    return out


def _summary(spec: CampaignSpec, rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Each coarser database against the one as it is, for every application."""
    good = [row for row in rows if not row["failure"]]
    assert spec.simulator is not None
    return {
        "tolerance": spec.simulator.tolerance,
        "configurations": [row["settings"] for row in good],
        "failures": [row["failure"] for row in rows if row["failure"]],
        "applications": {
            one.name: [_against_full(good, cells, one.name, one.goal) for cells in LEVELS] if good else []
            for one in spec.applications
        },
    }


def _against_full(rows: Sequence[Mapping[str, Any]], cells: int, application: str, goal: Goal) -> dict[str, Any]:
    """One database against the one as it is."""
    own, top = ([row["levels"][str(level)] for row in rows] for level in (cells, 0))
    cheap, full = (np.array([[s[application] for s in one["scores"]] for one in levels]) for levels in (own, top))
    seconds, seconds_full = (np.array([np.median(one["seconds"]) for one in levels]) for levels in (own, top))
    difference = cheap - full
    n, m = difference.shape
    error = float(np.sqrt(difference.var(axis=1, ddof=1).sum() / m) / n) if m > 1 else float("nan")
    sign = sign_of(goal)
    true, seen = sign * full.mean(axis=1), sign * cheap.mean(axis=1)
    lost = full[int(np.argmax(true))] - full[int(np.argmax(seen))]
    return {
        "cells": cells,
        "averaged": sorted({one["averaged"] for one in own}),
        "configurations": n,
        "occasions": m,
        "seconds": float(seconds.mean()),
        "time_ratio": float(seconds.sum() / seconds_full.sum()),
        "bias": float(difference.mean()),
        "bias_se": error,
        "rms_error": float(np.sqrt(np.mean(difference**2))),
        "largest_error": float(np.abs(difference).max()),
        "rank_correlation": _rank_correlation(true, seen),
        "utility_lost": float(sign * lost.mean()) + 0.0,  # no negative zero
        "utility_lost_se": float(lost.std(ddof=1) / np.sqrt(m)) if m > 1 else float("nan"),
    }


def _rank_correlation(one: FloatArray, other: FloatArray) -> float | None:
    """Spearman's; None where it does not exist."""
    from scipy.stats import spearmanr

    if len(one) < 3 or np.ptp(one) == 0.0 or np.ptp(other) == 0.0:
        return None
    return float(spearmanr(one, other).statistic)
