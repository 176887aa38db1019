"""The closed loop: simulate, fit, decide and propose until the stop rule holds or the budget is spent."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Literal

from seqrsm.analysis.compromise import CompromiseEstimate
from seqrsm.analysis.conclude import LOOK_DRAWS
from seqrsm.analysis.ground import RANKED
from seqrsm.analysis.results import Analysis
from seqrsm.analysis.runs import n_fitted
from seqrsm.analysis.to_json import analysis_to_json
from seqrsm.campaign.campaign import MAX_ATTEMPTS, Campaign, Progress, all_failed
from seqrsm.campaign.grounds import Grounds
from seqrsm.campaign.next_runs import confirmation_batch, start_size, to_confirm
from seqrsm.campaign.rests_on import rests_on
from seqrsm.campaign.simulator_checks import check_simulator
from seqrsm.errors import OvertakenError, StoreError, UserError
from seqrsm.plain import counted
from seqrsm.progress import silent
from seqrsm.store.records import WAITING, RunRecord

Ending = Literal["stop", "budget spent"]
WAIT_S = 1.0
"""How often runs in the hands of another process are looked at [s]."""
_BROKEN_BATCHES = 3  # in a row, without any score: the campaign ends


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a call of `run_campaign` ended."""

    held: bool
    """The stop rule holds; otherwise the budget is spent."""
    analyses: tuple[Analysis, ...]
    """One for each application."""
    seconds: dict[str, float]
    """Time spent by stage in this call [s]."""
    n_scored: int
    """Scored runs in all, confirmation runs included."""
    compromise: CompromiseEstimate | None = None
    """Over several applications and considerations."""
    rests: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """By application, the shares of the area that its recommended settings see by measured, published, computed and
    assumed means; see `seqrsm.campaign.rests_on`."""

    def to_json(self) -> dict[str, Any]:
        """Outcome as a JSON document."""
        return {
            "held": self.held,
            "n_scored": self.n_scored,
            "seconds": self.seconds,
            "rests_on": {name: dict(shares) for name, shares in self.rests.items()},
            "applications": [analysis_to_json(analysis) for analysis in self.analyses],
            "compromise": None if self.compromise is None else self.compromise.to_json(),
        }


def run_campaign(
    campaign: Campaign,
    *,
    max_runs: int | None = None,
    batch: int | None = None,
    workers: int = 1,
    cluster: str | None = None,
    on_progress: Progress = silent,
    on_look: Callable[[Analysis], None] = silent,
    say: Callable[[str], None] = silent,
) -> Outcome:
    """Simulate, fit, decide and propose until the stop rule holds or the budget is spent.

    ``max_runs`` and ``batch`` stand in place of the campaign's own; ``workers`` and ``cluster`` tell where to simulate.
    ``on_progress`` is told of every run (done, total), ``on_look`` of every look, ``say`` of every step in words.
    UserError where no run of the initial design, or of several batches after it, gave a score, and with what reasons.
    """
    simulate = partial(campaign.simulate, workers=workers, cluster=cluster, on_progress=on_progress)
    loop = _ClosedLoop(campaign, simulate, Grounds(campaign.spec, campaign.store, workers, cluster), on_look, say)
    return loop.run(max_runs or campaign.spec.stop.max_runs, batch or campaign.spec.batch)


@dataclass(frozen=True, slots=True)
class _ClosedLoop:
    """One call of `run_campaign`; ``simulate`` does so where the user wants it, ``seconds``: by stage."""

    campaign: Campaign
    simulate: Callable[[], Sequence[RunRecord]]
    grounds: Grounds
    on_look: Callable[[Analysis], None]
    say: Callable[[str], None]
    seconds: dict[str, float] = field(default_factory=dict)

    def run(self, budget: int, batch: int) -> Outcome:
        """Go on from what is in the store to the end; ``budget``: runs of the whole campaign, confirmation apart."""
        campaign, spec = self.campaign, self.campaign.spec
        self._refuse_less_than_a_start(budget)
        if spec.simulator is None and not campaign.store.runs(source="simulation"):
            check_simulator(spec)
        end: tuple[Ending, tuple[Analysis, ...]] | None = None
        while end is None:
            self._refuse_hopeless(self._simulated())
            try:
                end = self._step(budget, batch)
            except OvertakenError:
                self.say("another command advanced this campaign meanwhile; analysing again")
        return self._finish(*end)

    def _step(self, budget: int, batch: int) -> tuple[Ending, tuple[Analysis, ...]] | None:
        """Look at what is scored, and issue what is next, or end with that look; `OvertakenError` if others decided."""
        campaign, spec = self.campaign, self.campaign.spec
        left = budget - campaign.store.n_used()
        if left == budget:
            self.say("checking the simulator with one image at the centre of the region")
            check_simulator(spec)
            self.say("searching for an initial design")
            with self._timed("propose"):
                runs = campaign.decide(budget=budget)
            self.say(f"initial design of {len(runs)} runs")
            return None
        if self._too_few() and left > 0:
            self.say("the scores do not determine the model yet; adding the runs that it needs")
            with self._timed("propose"):
                campaign.decide(budget=budget)
            return None
        with self._timed("fit"):
            analyses = campaign.analyse_all(n_draws=LOOK_DRAWS)
        if left <= 0 or all(analysis.decision.held for analysis in analyses):
            with self._timed("rank"):
                if spec.simulator is not None and self.grounds.measure_at(analyses):
                    return None  # the end may not be one: runs scatter there as they do, not as elsewhere
        campaign.record_looks(analyses)
        for analysis in analyses:
            self.on_look(analysis)
        if all(analysis.decision.held for analysis in analyses):
            analyses = self._confirmed(analyses)
            # Fresh runs that contradict the model are evidence against it: they enter the fit with the next ones.
            if left <= 0 or not any(analysis.contradicted for analysis in analyses):
                return "stop", analyses
            self.say("the confirmation runs contradict the model; continuing")
        if due := to_confirm(analyses, left):
            self._add_confirmation(due)
            return None
        if left <= 0:
            return "budget spent", analyses
        with self._timed("propose"):
            campaign.decide(batch, budget=budget, analyses=analyses)
        return None

    def _simulated(self) -> list[RunRecord]:
        """Carry out what is issued, wait for what others carry out, and mark the store; the runs carried out here."""
        with self._timed("simulate"):
            made = list(self.simulate())
            self.campaign.store.mark()
            while others := self.campaign.store.runs(WAITING, source="simulation"):
                if running := sum(run.state == "running" for run in others):
                    self.say(f"waiting for {counted(running, 'run')} of another command")
                    time.sleep(WAIT_S)
                made += self.simulate()
                self.campaign.store.mark()
        return made

    @contextmanager
    def _timed(self, stage: str) -> Iterator[None]:
        since = time.perf_counter()
        yield
        self.seconds[stage] = self.seconds.get(stage, 0.0) + time.perf_counter() - since

    def _too_few(self) -> bool:
        """Whether an application's scores cannot be fitted, so that simulated runs of the initial design must come.

        StoreError where they wait for flights that nobody has scored.
        """
        spec, runs = self.campaign.spec, self.campaign.store.runs()
        fitted = n_fitted(spec, runs)
        terms = spec.quadratic.p
        flights = [run.run_id for run in runs if run.state in WAITING and run.source == "flight"]
        if fitted > terms or not flights:
            return fitted <= terms
        message = f"{fitted} scores cannot determine {terms} terms, and {len(flights)} flights have no scores yet"
        remedy = "Add their scores with `seqrsm ingest`, or cancel them with `seqrsm void`; `run` only simulates."
        raise StoreError(message, remedy)

    def _refuse_less_than_a_start(self, budget: int) -> None:
        """A smaller budget for one call ends the campaign early, and nothing else; the initial design is made whole."""
        spec = self.campaign.spec
        least = start_size(spec)
        if budget < least and self.campaign.store.n_used() == 0:
            remedy = f"Give {least} or more, or omit it."
            raise UserError(f"the initial design has {least} runs", remedy, field="max_runs", value=budget)

    def _refuse_hopeless(self, made: Sequence[RunRecord]) -> None:
        """No others replace runs that the machine failed; batches without a single score would come for ever."""
        broken = [run for run in self.campaign.store.runs("failed") if run.fault == "machine"]
        if broken:
            text = f"{counted(len(broken), 'run')} failed because of this machine, to be repeated: {broken[-1].reason}"
            remedy = f"Fix the cause and repeat the command; after {MAX_ATTEMPTS} attempts, run `seqrsm retry` first."
            raise UserError(text, remedy)
        if not made or any(run.state != "failed" for run in made):
            return
        runs = [run for run in self.campaign.store.runs(source="simulation") if run.state in ("scored", "failed")]
        batches = list(dict.fromkeys(run.batch for run in reversed(runs)))[:_BROKEN_BATCHES]
        last = [run for run in runs if run.batch in batches]
        never = not any(run.state == "scored" for run in runs)
        if never or (len(batches) == _BROKEN_BATCHES and all(run.state == "failed" for run in last)):
            raise all_failed(last)

    def _confirmed(self, analyses: tuple[Analysis, ...]) -> tuple[Analysis, ...]:
        """The analyses, with fresh runs at what they recommend where there are none yet."""
        if self.campaign.spec.simulator is None or all(a.confirmation is not None for a in analyses):
            return analyses
        self._add_confirmation(analyses)
        self._simulated()
        return self.campaign.analyse_all(n_draws=LOOK_DRAWS)

    def _finish(self, kind: Ending, analyses: tuple[Analysis, ...]) -> Outcome:
        """Sample the posterior of the last look, after other grounds were simulated at what it recommends."""
        campaign, store, held = self.campaign, self.campaign.store, kind == "stop"
        rests = {}
        if campaign.spec.simulator is not None:
            told = [event.detail["settings"] for event in store.events(kind=RANKED) if "known" in event.detail]
            if any(one.optimum.settings not in told for one in analyses):
                self.say("simulating other grounds at the recommended settings")
                with self._timed("rank"):
                    self.grounds.rank(analyses)
            rests = {one.application: rests_on(campaign.spec, one.optimum.settings) for one in analyses}
        self.say("sampling the posterior")
        with self._timed("sample"):
            thorough = campaign.analyse_all(sampler="emcee", thorough=True)  # as `fit` and `report` will ask for it
            analyses = tuple(replace(one, steps=(), thorough=False) for one in thorough)
        n_scored = len(store.runs("scored"))
        store.add_event(kind, {"n_scored": n_scored}, once=("n_scored",))
        return Outcome(held, analyses, self.seconds, n_scored, campaign.compromise(analyses), rests)

    def _add_confirmation(self, analyses: Sequence[Analysis]) -> None:
        """Fresh runs at the recommended settings; several applications each get their own."""
        runs = confirmation_batch(self.campaign.spec, analyses, "simulation")
        self.say(f"{len(runs)} confirmation runs at the recommended settings")
        self.campaign.store.add_batch(runs)
