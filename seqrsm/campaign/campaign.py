"""The campaign itself, the only stateful object, and its steps: look, propose, simulate, ingest.

All state is in the store. Every step first looks at what is there, so a campaign that was killed at any moment goes on
where it was, and ends with the same result as one that was not.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Self

import numpy as np

from seqrsm.analysis.compromise import CompromiseEstimate, campaign_compromise
from seqrsm.analysis.conclude import analyse
from seqrsm.analysis.ground import MEASURED, RANKED, measured_ground
from seqrsm.analysis.results import Analysis
from seqrsm.analysis.runs import coded_settings, evidence, n_determined, n_fitted, see_names
from seqrsm.analysis.to_json import look_summary
from seqrsm.campaign.guards import see_meaning, see_units
from seqrsm.campaign.next_runs import confirmation_batch, in_random_order, next_batch, start_batch, to_confirm
from seqrsm.campaign.status import sensor_warnings
from seqrsm.errors import OvertakenError, Problem, SpecError, StoreError, UserError
from seqrsm.files import see_free
from seqrsm.fit.error_models import Sampler
from seqrsm.plain import plain
from seqrsm.progress import silent
from seqrsm.remember import remembered
from seqrsm.spec.read import SPEC_NAME, CampaignSpec, load_spec, placed
from seqrsm.spec.tables import ApplicationSpec
from seqrsm.store.records import CONFIRMATION, WAITING, LookRecord, NewRun, RunRecord
from seqrsm.store.store import Store, heartbeat

if TYPE_CHECKING:
    from seqrsm.campaign.ingest import IngestReport
    from seqrsm.score.table import TableSource

Progress = Callable[[int, int], None]
TRIES = 3
"""How often one command begins a run that the machine fails."""
MAX_ATTEMPTS = 9
"""How often commands begin a run that fails through no fault of its settings, before somebody asks for more."""


def _told(tell: Progress, before: int, n: int, done: int, more: int) -> None:
    """Tell how many runs are done of all, where ``more`` are carried out at once and ``before`` were already."""
    tell(before + done, max(n, before + more))


def all_failed(runs: Sequence[RunRecord]) -> UserError:
    """That none of these runs has a score, with each reason, the latest first, 5 at most."""
    reasons = list(dict.fromkeys(run.reason for run in reversed(runs)))[:5]
    none = "the run has no score" if len(runs) == 1 else f"none of these {len(runs)} runs has a score"
    return UserError(*(Problem(f"{none}: {reason}") for reason in reasons))


class Campaign:
    """A campaign folder, open."""

    def __init__(self, spec: CampaignSpec, store: Store) -> None:
        self.spec = spec
        self.store = store
        self.folder = spec.folder
        self._tried: set[int] = set()  # of earlier runs for a new application, which are tried once

    @classmethod
    def open(cls, folder: Path) -> Self:
        """The campaign in ``folder``, open, its store made at the first use; errors of `load_spec` and `Store.open`."""
        spec = load_spec(folder)
        store = Store.open(spec.folder, url=spec.store_url, create=True, campaign=spec.name, seed=spec.seed)
        try:
            store.verify()
        except BaseException:
            store.close()
            raise
        return cls(spec, store)

    # -- looking --------------------------------------------------------------------------------------------------

    def analyse_all(
        self, application: str | None = None, *, sampler: Sampler = "exact", n_draws: int = 4000, thorough: bool = False
    ) -> tuple[Analysis, ...]:
        """Analysis of every application, or of the one named; ``thorough`` and errors: see `analyse`; it is remembered.

        A thorough one warns of recommended settings of a sensor that is not to be used.
        """
        wanted = self.spec.applications if application is None else (self.spec.application(application),)
        runs, bundles, ranked = self.store.runs(), self.store.events(kind=MEASURED), self.store.events(kind=RANKED)
        see_meaning(self.store, self.spec, runs)

        def found(app: ApplicationSpec) -> Analysis:
            ground = measured_ground(bundles, app.name)
            made = partial(analyse, self.spec, app, runs, ground=ground, sampler=sampler, n_draws=n_draws)
            if not thorough:
                return made()
            of = (self.spec.spec_hash, app.name, runs, ground, [event.detail for event in ranked], sampler, n_draws)
            return remembered(partial(made, ranked=ranked, thorough=True), of)

        analyses = tuple(found(app) for app in wanted)
        if not thorough:
            return analyses
        more = [sensor_warnings(self.spec, one.optimum.settings) for one in analyses]
        return tuple(replace(one, warnings=one.warnings + own) for one, own in zip(analyses, more, strict=True))

    def compromise(self, analyses: Sequence[Analysis]) -> CompromiseEstimate | None:
        """Compromise over all applications and considerations, with warnings as of an analysis; None without."""
        found = campaign_compromise(self.spec, analyses)
        return None if found is None else replace(found, warnings=sensor_warnings(self.spec, found.settings))

    def record_looks(self, analyses: Sequence[Analysis]) -> None:
        """Record what was found, once: a second look at the same runs is not a look; errors of `Store.record_look`."""
        for analysis in analyses:
            last = self.store.looks(analysis.application)
            then = last[-1].summary["s"] if last and last[-1].after_run == analysis.fit.n_runs else np.inf
            # Another score in a void run's place moves s, which a look without scatter keeps as None.
            if not np.isclose(np.nan if then is None else then, analysis.fit.s, rtol=1e-9, atol=0.0, equal_nan=True):
                self.store.record_look(analysis.fit.n_runs, analysis.application, look_summary(analysis))

    def looks(self, analyses: Sequence[Analysis]) -> tuple[LookRecord, ...]:
        """Looks so far; the last of each application is what its analysis tells: scores may have come since."""
        looks = self.store.looks()
        looked = {look.application for look in looks}
        present = (
            LookRecord(len(looks) + 1, one.fit.n_runs, one.application, plain(look_summary(one)), "")
            for one in analyses
            if one.application in looked
        )
        return (*looks, *present)

    # -- proposing ------------------------------------------------------------------------------------------------

    def propose(
        self, n: int | None = None, *, source: str | None = None, csv: Path | None = None
    ) -> tuple[RunRecord, ...]:
        """Issue the next runs, flights in random order; the first call issues the initial design, which has its size.

        ``n`` runs are wanted, the campaign's batch by default, of a ``source``: "simulation", where there is a
        simulator the default; "flight", which is any measurement; or "best", which takes for each run the source that
        gains more for its cost. ``csv``: a form for a flight crew, one row a flight, the score left empty; none where
        "best" chooses no flight.

        UserError of an unknown source, a form that exists already or of simulations, too few scores and none to wait
        for, or a budget that is spent.
        """
        source = source or self.spec.own_source
        if source not in ("simulation", "flight", "best"):
            raise UserError("no such source", 'Use "simulation", "flight" or "best".', field="source", value=source)
        if csv is not None:  # known before any run is issued
            see_free(csv)
            if source == "simulation":
                message = "these runs are to be simulated, and a form is for flights"
                raise UserError(message, "Add --source flight, or leave out --csv.", field="csv", value=str(csv))
        records: tuple[RunRecord, ...] | None = None
        while records is None:  # where another process decided meanwhile, choose again from what there is now
            self.store.mark()
            with suppress(OvertakenError):
                records = self.decide(n, source)
        flights = [run for run in records if run.source == "flight"]
        if csv is not None and flights:
            self.write_form(csv, flights)
        return records

    def write_form(self, file: Path, runs: Sequence[RunRecord] | None = None) -> int:
        """Write the form of runs for a flight crew, by default of all flights that are issued; how many they are.

        UserError where there is none, or the file exists or cannot be written.
        """
        from seqrsm.campaign.export import write_form

        wanted = self.store.runs("issued", source="flight") if runs is None else runs
        if not wanted:
            raise UserError("no flight is issued", "Issue flights first: seqrsm propose DIR --source flight")
        write_form(file, self.spec, wanted)
        return len(wanted)

    def decide(
        self,
        n: int | None = None,
        source: str = "simulation",
        budget: int | None = None,
        analyses: Sequence[Analysis] | None = None,
    ) -> tuple[RunRecord, ...]:
        """Issue the next runs, as `propose`, from the state that the store has marked.

        OvertakenError where another process decided meanwhile; nothing was issued.
        """
        if load_spec(self.folder).spec_hash != self.spec.spec_hash:
            message = "campaign.toml was changed while this command was running"
            raise SpecError(message, "Repeat the command.", file=str(self.folder / SPEC_NAME))
        made, budget = self.store.runs(), budget or self.spec.stop.max_runs
        see_names(self.spec, made)
        see_meaning(self.store, self.spec, made)
        if source != "flight":
            self._see_simulator(note=False)
        left = budget - self.store.n_used()
        self.store.see_mark()  # else what another process decided would be told as the user's fault
        analyses = analyses or self._looked(made, left)
        own = self.spec.own_source if source == "best" else source  # of runs that are not chosen between sources
        waiting = any(run.purpose == CONFIRMATION and run.state in WAITING for run in made)
        if not waiting and (due := to_confirm(analyses, left)):
            fresh = confirmation_batch(self.spec, due, own)
            ids = self.store.add_batch(fresh)  # beyond the budget
        elif left <= 0:
            spent = Problem(f"the budget of {budget} runs is spent", "Raise [stop] max_runs.")
            raise StoreError(placed(self.spec, spent, "stop", "max_runs"))
        else:
            proposed = self._proposals(made, min(n or self.spec.batch, left), source, own, analyses)[:left]
            runs = in_random_order(proposed, self.spec.seed, len(made))
            ids = self.store.add_batch(runs, budget=budget)
        return tuple(run for run in self.store.runs() if run.run_id in set(ids))

    def _looked(self, runs: Sequence[RunRecord], left: int) -> tuple[Analysis, ...]:
        """Look at what is scored, where it can be fitted and something may be proposed after it; else nothing."""
        if (left <= 0 and self.spec.stop.guard == "runs") or n_fitted(self.spec, runs) <= self.spec.quadratic.p:
            return ()
        analyses = self.analyse_all()
        self.record_looks(analyses)  # whoever proposes and ingests only has looked, too
        return analyses

    def _proposals(
        self, runs: Sequence[RunRecord], n: int, source: str, own: str, analyses: Sequence[Analysis]
    ) -> list[NewRun]:
        active = [run for run in evidence(runs) if run.state in (*WAITING, "scored")]
        model = self.spec.quadratic
        failed = [run for run in runs if run.state == "failed" and run.fault != "machine"]
        if not active:
            return start_batch(self.spec, own, failed=failed)
        if not analyses:
            if own == "simulation" and self._without_a_score() and (unscored := self._unscored()):
                message = f"no simulated run has a score of '{unscored[0]}' yet"
                raise StoreError(message, "`seqrsm simulate` scores those that there are, from the same images.")
            waiting = [run for run in active if run.state in WAITING]
            names = [one.name for one in self.spec.applications]
            sets = ([run for run in active if run.state in WAITING or run.score_of(name)] for name in names)
            active = min(sets, key=lambda made: n_determined(model, coded_settings(self.spec.region, made)))
            if not waiting or n_determined(model, coded_settings(self.spec.region, active)) <= model.p:
                return start_batch(self.spec, own, active, failed, n)
            message = f"the scored runs are too few for {model.p} terms, and {len(waiting)} runs are waiting"
            raise StoreError(message, "Complete them first (`seqrsm simulate` or `seqrsm ingest`).")
        return next_batch(self.spec, analyses, active, n, source, failed)

    # -- carrying out ---------------------------------------------------------------------------------------------

    def simulate(
        self, *, workers: int = 1, cluster: str | None = None, on_progress: Progress = silent
    ) -> tuple[RunRecord, ...]:
        """Carry out every issued simulation run; each score is durable as soon as it is there.

        Returns the runs carried out in this call, failed ones and earlier ones for a new application included.
        StoreError, FitError or SpecError where what scores are made from has changed since the runs so far, or what
        they are scores of; see `seqrsm.campaign.experiment`, `see_names` and `see_units`. Or a new application scores
        no earlier run.
        """
        from seqrsm.campaign.grounds import Grounds  # the engines: not loaded for fit or status

        see_names(self.spec, runs := self.store.runs())
        see_units(self.spec, runs)
        coded_settings(self.spec.region, [run for run in evidence(runs) if run.state in (*WAITING, "scored")])
        self._see_simulator(note=True)
        self.store.release_stale()
        self.store.retry(attempts=MAX_ATTEMPTS)
        n_issued = sum(run.state in WAITING for run in self.store.runs(source="simulation"))
        carried: set[int] = set()
        try:
            # One at a time leaves the others to further processes, as those of a job array are.
            while claimed := self.store.claim(1 if workers == 1 and cluster is None else None):
                told = partial(_told, on_progress, len(carried), n_issued)
                carried |= {run.run_id for run in claimed}
                self._carry_out(claimed, workers, cluster, told)
        finally:
            self.store.release()
        if not self.store.runs("running", source="simulation"):  # the last to finish knows all scores
            if earlier := [run for run in self._without_a_score() if run.run_id not in self._tried]:
                self._tried |= (late := {run.run_id for run in earlier})
                self._carry_out(earlier, workers, cluster, on_progress)
                carried |= late - {run.run_id for run in self._without_a_score()}
            Grounds(self.spec, self.store, workers, cluster).measure()
        return tuple(run for run in self.store.runs() if run.run_id in carried)

    def _see_simulator(self, *, note: bool) -> None:
        """Refuse a simulator that is not that of the runs so far, or lacks what its runs need."""
        if self.spec.simulator is not None:
            from seqrsm.campaign.experiment import see_experiment
            from seqrsm.campaign.simulator_checks import see_parameters  # the engines: not loaded for fit or status

            see_experiment(self.store, self.spec, note=note)
            see_parameters(self.spec)

    def _without_a_score(self) -> list[RunRecord]:
        """Runs simulated here before an application was added: its score is of the same images, simulated again."""
        names = {one.name for one in self.spec.applications} if self.spec.simulator else set()
        runs = self.store.runs("scored", source="simulation")
        own = (run for run in runs if not any(score.source_file for score in run.scores))
        return [run for run in own if names - {score.application for score in run.scores}]

    def _unscored(self) -> list[str]:
        """Applications that no simulated run has a score of."""
        made = self.store.runs("scored", source="simulation")
        return [one.name for one in self.spec.applications if not any(run.score_of(one.name) for run in made)]

    def _carry_out(
        self, claimed: Sequence[RunRecord], workers: int, cluster: str | None, on_progress: Progress
    ) -> None:
        """Simulate runs that this process holds; those that failed through no fault of theirs are issued again.

        Or runs that are scored, for applications that they have no score of: the others stay; StoreError if none of
        them could be scored.
        """
        from seqrsm.campaign.grounds import cells_of_ground
        from seqrsm.campaign.simulation import carry_out, files_of, task_of
        from seqrsm.simulate.runner import Lost, run_many

        cells = cells_of_ground(self.spec, self.store)
        tasks = [task_of(self.spec, run.run_id, run.proposed, cells) for run in claimed]
        for k, run in enumerate(claimed):
            if run.state == "scored":
                missing = tuple(utility for utility in tasks[k].utilities if run.score_of(utility[0]) is None)
                tasks[k] = replace(tasks[k], utilities=missing)
        files = files_of(tasks[0]) if cluster is not None else ()
        lost: list[str] = []
        with heartbeat(self.store):
            for index, result in run_many(carry_out, tasks, workers, on_progress, cluster, files):
                run = claimed[index]
                if run.state == "scored":
                    if scores := getattr(result, "scores", ()):
                        self.store.record_scores(run.run_id, scores)
                    else:
                        lost.append(result.reason if isinstance(result, Lost) else result.failure)
                elif isinstance(result, Lost):
                    self.store.fail(run.run_id, result.reason)
                elif not result.failure:
                    self.store.record_scores(run.run_id, result.scores)
                else:
                    self.store.fail(run.run_id, result.failure, result.fault)
                    if result.fault == "machine" and run.attempts % TRIES:
                        self.store.retry([run.run_id], MAX_ATTEMPTS)
        if lost and (names := self._unscored()):
            k = [one.name for one in self.spec.applications].index(names[0])
            problem = Problem(f"earlier runs cannot be scored for '{names[0]}': {lost[0]}")
            raise StoreError(placed(self.spec, problem, "application", k))

    def ingest(self, *files: TableSource, dry_run: bool = False, accept: bool = False) -> tuple[IngestReport, ...]:
        """Take in files or tables of measured scores or rankings, all or none; see `seqrsm.campaign.ingest`."""
        from seqrsm.campaign.ingest import ingest_files

        return ingest_files(self.store, self.spec, files, dry_run=dry_run, accept=accept)
