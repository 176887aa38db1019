"""What simulations of no run tell of the ground that tables leave unknown: each over several worlds, kept as events.

How far scores differ from one ground to another, what knowing covers would leave of that, and how far other levels of
categorical factors gain more or less from ground to ground; see `seqrsm.analysis.ground`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from seqrsm.analysis.ground import (
    COVERS,
    FEW_WORLDS,
    LEVEL_WORLDS,
    MEASURED,
    N_WORLDS,
    OCCASIONS,
    RANKED,
    future_sd,
    left_of_ground,
    still_ranked,
)
from seqrsm.analysis.results import Analysis
from seqrsm.analysis.runs import n_fitted
from seqrsm.arrays import FloatArray
from seqrsm.campaign.rests_on import mean_sds
from seqrsm.campaign.simulation import SimulationTask, bundle_tasks, carry_out, files_of
from seqrsm.campaign.tradeoff import COARSENED, coarsest_within
from seqrsm.design.factors import CategoricalFactor
from seqrsm.progress import tell
from seqrsm.simulate.runner import run_many
from seqrsm.spec.read import CampaignSpec
from seqrsm.store.store import Store


def scores_of(
    tasks: Sequence[SimulationTask], application: str, workers: int = 1, cluster: str | None = None
) -> FloatArray:
    """Scores (n,) of an application by simulations that are no run's; nan where one failed."""
    tasks = [replace(task, utilities=tuple(u for u in task.utilities if u[0] == application)) for task in tasks]
    files = files_of(tasks[0]) if cluster is not None else ()
    progress = partial(tell, "simulating other grounds")
    found = np.full(len(tasks), np.nan)
    for index, result in run_many(carry_out, tasks, workers, progress, cluster, files):
        for one in getattr(result, "scores", ()):
            found[index] = one.score
    return found


def cells_of_ground(spec: CampaignSpec, store: Store) -> int:
    """Cells of a coarser database along a side of a pixel at least; 0: as it is. Measured once, and kept.

    See `seqrsm.campaign.tradeoff.coarsest_within`.
    """
    if spec.simulator is None or spec.simulator.tolerance == 0.0:
        return 0
    known = [event.detail for event in store.events(kind=COARSENED)]
    found = next((detail for detail in known if detail["tolerance"] == spec.simulator.tolerance), None)
    if found is None:
        found = coarsest_within(spec)
        store.add_event(COARSENED, found, once=("tolerance",))
    return int(found["cells"])


@dataclass(frozen=True, slots=True)
class Grounds:
    """The grounds of a campaign, and where they are simulated: by ``workers`` here, or on a ``cluster``."""

    spec: CampaignSpec
    store: Store
    workers: int = 1
    cluster: str | None = None

    def measure(self) -> None:
        """Once, when there are scores enough to fit: simulate two occasions in each of some worlds.

        At the best settings so far of each application.
        """
        known = {event.detail.get("application") for event in self.store.events(kind=MEASURED)}
        wanted = [application for application in self.spec.applications if application.name not in known]
        if self.spec.simulator is None or not wanted:
            return
        runs = self.store.runs("scored", source="simulation")
        if n_fitted(self.spec, runs) <= self.spec.quadratic.p:
            return
        for application in wanted:
            found = [(score.score, run) for run in runs if (score := run.score_of(application.name)) is not None]
            pick = max if application.goal == "maximize" else min
            self._measured(application.name, pick(found, key=lambda one: one[0])[1].settings)

    def measure_at(self, analyses: Sequence[Analysis]) -> bool:
        """The same at what is recommended, where it was not done there: scatter differs from place to place.

        Whether any was measured: what the runs tell has then changed.
        """
        done = [(event.detail["application"], event.detail["settings"]) for event in self.store.events(kind=MEASURED)]
        own = [(one.application, dict(one.optimum.settings)) for one in analyses if one.optimum.ground is not None]
        added = [self._measured(*one) for one in own if one not in done]
        return any(added)

    def rank(self, analyses: Sequence[Analysis]) -> None:
        """Simulate what would be left of the variance between grounds if covers were known.

        At what is recommended. And how far other levels of its categorical factors gain more or less from ground to
        ground.
        """
        for analysis in analyses:
            known, unit = self._known(analysis)
            detail = {
                "application": analysis.application,
                "settings": dict(analysis.optimum.settings),
                "unit": unit,
                "known": known,
                "levels": self._other_levels(analysis),
            }
            self.store.add_event(RANKED, detail, once=("application", "settings", "known"))

    def _other_levels(self, analysis: Analysis) -> list[dict[str, float | str]]:
        """See `seqrsm.analysis.ground.sds_of_levels`: all are simulated on the same occasions of the same worlds."""
        settings, region = analysis.optimum.settings, self.spec.region
        others = [
            (factor.name, level)
            for factor in self.spec.factors
            if isinstance(factor, CategoricalFactor)
            for level in factor.levels
            if level != settings[factor.name] and region.feasible(region.code([{**settings, factor.name: level}]))[0]
        ]
        if not others:
            return []
        first, cells = self._bundle(analysis.application, settings)[:LEVEL_WORLDS], self._cells()
        made = [{**settings, name: level} for name, level in others]
        tasks = [task for one in made for task in bundle_tasks(self.spec, one, cells, range(LEVEL_WORLDS))]
        rest = self._scores(tasks, analysis.application).reshape(-1, LEVEL_WORLDS, OCCASIONS)
        found: list[dict[str, float | str]] = []
        for (name, level), one in zip(others, rest, strict=True):
            gain = (one - first)[np.isfinite(one - first).all(axis=1)]
            if len(gain) > 1:
                found.append({"factor": name, "level": level, "sd": round(future_sd(gain, math.inf), 4)})
        return found

    def _known(self, analysis: Analysis) -> tuple[list[dict[str, Any]], str]:
        """The covers that move the score most: what each would leave, see `left_of_ground`; and the unit.

        And what all together would, unless single ones of them help: the table is then of those.
        """
        settings, ground = analysis.optimum.settings, analysis.optimum.ground
        sds, unit = mean_sds(self.spec, settings)
        variance = ground.share * ground.variance if ground and analysis.optimum.of_ground > 0.0 else 0.0
        if not (variance > 0.0 and sds):  # nothing is told of it
            return [], unit
        bundle = bundle_tasks(self.spec, settings, self._cells())[::OCCASIONS]  # one occasion of each world
        here = self._bundle(analysis.application, settings)[:, 0]

        def moved(covers: Sequence[tuple[str, ...]], worlds: slice = slice(None)) -> FloatArray:
            # Neighbours share draws.
            tasks = [replace(task, elsewhere=own) for task in bundle[worlds] for own in covers]
            return self._scores(tasks, analysis.application).reshape(-1, len(covers)).T

        def left(own: tuple[str, ...], there: FloatArray) -> dict[str, Any]:
            both = np.isfinite(here) & np.isfinite(there)
            share, se = left_of_ground(here[both], there[both], variance)
            return {"covers": own, "mean_sd": sds[own[0]], "left": round(share, 4), "se": round(se, 4)}

        covers = [(name,) for name in sds]
        few = moved(covers, slice(FEW_WORLDS))
        kept = still_ranked(few - here[:FEW_WORLDS])
        covers = [covers[k] for k in kept]
        each = np.hstack([few[kept], moved(covers, slice(FEW_WORLDS, None))])
        found = [left(own, there) for own, there in zip(covers, each, strict=True)]
        found = sorted((one for one in found if math.isfinite(one["se"])), key=lambda one: float(one["left"]))[:COVERS]
        if len(found) > 1 and len({analysis.optimum.helped(one["left"]) for one in found}) == 1:
            names = tuple(one["covers"][0] for one in found)
            joint = left(names, moved([names])[0])
            # All leave no more than the first, whatever a few worlds say.
            joint["left"] = min(joint["left"], found[0]["left"])
            found.append(joint)
        return found, unit

    def _measured(self, application: str, settings: Mapping[str, float | str]) -> bool:
        """Two occasions in each of some worlds; an event keeps the scores. Whether there were enough."""
        whole = self._bundle(application, settings)
        whole = whole[np.isfinite(whole).all(axis=1)]
        if len(whole) > 1:
            detail = {"application": application, "settings": dict(settings), "scores": whole.tolist()}
            self.store.add_event(MEASURED, detail, once=("application", "settings"))
        return len(whole) > 1

    def _bundle(self, application: str, settings: Mapping[str, float | str]) -> FloatArray:
        """Scores (worlds, occasions) at some settings: as an event keeps them, else simulated; nan where one failed."""
        for event in self.store.events(kind=MEASURED):
            kept = event.detail
            if (kept["application"], kept["settings"]) == (application, settings) and len(kept["scores"]) == N_WORLDS:
                return np.array(kept["scores"])
        tasks = bundle_tasks(self.spec, settings, self._cells())
        return self._scores(tasks, application).reshape(N_WORLDS, OCCASIONS)

    def _scores(self, tasks: Sequence[SimulationTask], application: str) -> FloatArray:
        return scores_of(tasks, application, self.workers, self.cluster)

    def _cells(self) -> int:
        return cells_of_ground(self.spec, self.store)
