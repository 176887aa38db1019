"""Which runs to make next: the initial design, then batches chosen for the interval at the optimum."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from seqrsm.analysis.fitted import confirmation_reason
from seqrsm.analysis.posterior import stated_prior
from seqrsm.analysis.results import Analysis
from seqrsm.analysis.runs import coded_settings, n_determined
from seqrsm.analysis.surfaces import expected_of_flights
from seqrsm.arrays import FloatArray
from seqrsm.decide.sources import blocks_within, source_prior, stacked_rows
from seqrsm.design.factors import CategoricalFactor, ContinuousFactor, plain_setting
from seqrsm.design.region import ROUNDING, Region
from seqrsm.errors import Problem, SpecError
from seqrsm.fit.optimum import sign_of
from seqrsm.propose.batch import FOR_THE_OPTIMUM, PLAN, Proposal, Spread, propose_batch
from seqrsm.propose.candidates import Source
from seqrsm.propose.cloud import Runs, new_blocks, propose_from_process
from seqrsm.propose.known import Evidence, Sought
from seqrsm.rng import batch_seed, generator
from seqrsm.spec.read import CampaignSpec, placed
from seqrsm.store.records import CONFIRMATION, NewRun, RunRecord

START = "start"
CENTRE_REPEATS = 3
EXTRA_RUNS = 6
"""Runs of the initial design beyond one for each term: campaign studies found 4 to 6 enough for a first look."""

_ALL_EQUAL = "all scores so far are equal, so no settings are known to be better than others"
_DAY_PRECISION = 1.0  # prior, of a new day's effect beside fixed ones: days differ as much as runs do
_ALIKE = 1e-6  # least variance of days over that of a run
_WEAK = 0.05  # prior precision of an initial design that is completed: the runs cannot determine the model yet
_TARGETS = 256
_IMPROBABLE = 0.15  # a process that proposes no runs
_CERTAIN = 0.99
"""Up to this probability of a process a run in four goes where none was near: the scores so far do not tell of a peak
there. Once the quadratic is refuted, the process itself tells where to look; see `reports/peers`."""


def start_size(spec: CampaignSpec) -> int:
    """Runs of the initial design: at most the budget; SpecError where that cannot determine the model and its noise."""
    model = spec.quadratic
    least = model.p + CENTRE_REPEATS - 1
    if spec.stop.max_runs < least:
        message = f"{spec.stop.max_runs} runs cannot determine {model.p} terms and the noise"
        remedy = f"Raise max_runs to {least} or more, use fewer factors or levels, or set [model] order = 1."
        problem = Problem(message, remedy, field="[stop] max_runs", value=spec.stop.max_runs)
        raise SpecError(placed(spec, problem, "stop", "max_runs"))
    return min(model.p + EXTRA_RUNS, spec.stop.max_runs)


def start_batch(
    spec: CampaignSpec, source: str, made: Sequence[RunRecord] = (), failed: Sequence[RunRecord] = (), of_day: int = 1
) -> list[NewRun]:
    """Start design, or what is missing of it when ``made`` holds runs already; away from what ``failed``.

    Where ``made`` determine the model, and not the blocks beside it, ``of_day`` runs, at least two, of one more block.
    """
    from seqrsm.design.optimal import start_design

    model, n = spec.quadratic, start_size(spec)
    fixed = coded_settings(spec.region, made)
    determined = n_determined(model, fixed)
    blocked = determined > model.p
    least = len(made) + (max(of_day, 2) if blocked else max(1, model.p - determined))
    if failed:
        centre = spec.region.centre()
        proposals = propose_batch(
            model,
            spec.region,
            Evidence(
                model.matrix(fixed),
                fixed,
                prior_precision=_WEAK * np.eye(model.p),
                barred=spec.region.code([run.proposed for run in failed]),
            ),
            Sought(centre, centre[None, :]),
            max(n, least) - len(made),
            [(Spread, 1.0)],
            seed=batch_seed(spec.seed, len(made)),
        )
        points = np.array([proposal.point for proposal in proposals])
    elif made:
        points = start_design(model, spec.region, max(n, least), seed=spec.seed, fixed=fixed)
    else:
        points = start_design(model, spec.region, n, CENTRE_REPEATS, spec.seed)
    why = f"initial design: {n} runs for a model of {model.p} terms"
    if len(made) >= n:
        of_days = " beside the blocks: all of these on one more day"
        beside = (of_days if spec.model.block else " beside the difference between sources") * blocked
        why = f"the runs so far do not determine all {model.p} terms of the model{beside}"
    cost = spec.cost.of(source)
    return [NewRun(settings, START, why, source, cost) for settings in rounded_settings(spec.region, points)]


def to_confirm(analyses: Sequence[Analysis], left: int) -> list[Analysis]:
    """Those whose confirmation runs are due: nothing else is missing for any application, or no budget is left for it.

    Runs made afterwards for another application would take them into the fit, and they would have to be made again.
    """
    wanted = [one for one in analyses if one.decision.wants_confirmation]
    return wanted if left <= 0 or all(one.decision.held or one.decision.wants_confirmation for one in analyses) else []


def confirmation_batch(spec: CampaignSpec, analyses: Sequence[Analysis], source: str) -> list[NewRun]:
    """Fresh runs at the recommended settings; several applications each get their own, those that have some none."""
    return [
        NewRun(
            rounded_settings(spec.region, spec.region.code([analysis.optimum.settings]))[0],
            CONFIRMATION,
            confirmation_reason(analysis.application),
            source,
            spec.cost.of(source),
        )
        for analysis in analyses
        if analysis.confirmation is None
        for _ in range(spec.stop.confirmation_runs)
    ]


@dataclass(frozen=True, slots=True)
class _Made:
    """A run that is made, pending, or chosen just now."""

    settings: dict[str, float | str]
    source: str
    block: str
    day: int = 1
    """0 of a run that is made; else the day to come, 1 being that of the runs chosen now."""

    @property
    def pending(self) -> bool:
        return self.day > 0


class _Chooser:
    """What the choice of one application's runs is made from."""

    def __init__(self, spec: CampaignSpec, analysis: Analysis) -> None:
        self.spec, self.analysis = spec, analysis
        self.model = spec.quadratic
        self.target = analysis.optimum.point

    def batch(
        self, done: Sequence[_Made], n: int, source: str, df_pure_error: int, barred: FloatArray
    ) -> tuple[Proposal, ...]:
        """``n`` runs of one source, after those that are ``done``.

        By the process where one was weighed that knows of runs of this source, unless it is improbable: of two it is
        that of flights.
        """
        departure = self.analysis.fitted.departure
        process = departure.process
        scored = {run.source for run in done if not run.pending}
        others_wait = any(run.pending and run.source != source for run in done)
        known = not others_wait and (scored == {source} or (source == "flight" and source in scored))
        if process is None or not known or departure.probability < _IMPROBABLE:
            return self.batch_by_quadratic(done, n, source, df_pure_error, barred)
        return propose_from_process(
            process,
            self.spec.region,
            self.target,
            Runs(self.spec.region.code([run.settings for run in done]), np.array([run.day for run in done]), barred),
            n,
            weight=float(self.weights(self.target[None, :])[0]),
            sign=sign_of(self.analysis.goal),
            far=departure.probability <= _CERTAIN or departure.reason != "",
            seed=batch_seed(self.spec.seed, len(done)),
        )

    def batch_by_quadratic(
        self, done: Sequence[_Made], n: int, source: str, df_pure_error: int, barred: FloatArray
    ) -> tuple[Proposal, ...]:
        """The same by the quadratic alone; where a process was weighed no run has to test it, as the process does."""
        points = self.spec.region.code([run.settings for run in done])
        flights = np.array([run.source == "flight" for run in done], dtype=np.bool_)
        two = len({run.source for run in done} | {source}) > 1
        Z = stacked_rows(self.model, points, flights) if two else self.model.matrix(points)
        blocked = self.spec.model.block is not None
        new_day = blocked and source == "flight"
        blocks = [run.block if blocked else "" for run in done]
        surface, of_day, common = self.analysis.fitted.surface, _DAY_PRECISION, 0.0
        random = not surface.fixed_blocks
        if random:
            common = surface.common_sd**2 / (surface.s**2 - surface.common_sd**2)
            of_day = 1.0 / max(common, _ALIKE)
        columns = _day_columns(done, random) if new_day else blocks_within(blocks, flights)
        rows = (lambda at: stacked_rows(self.model, at, np.full(len(at), source == "flight"))) if two else None
        of_model, precision = rows or self.model.matrix, self.precision(two)
        if new_day:
            n_days = columns.shape[1]
            ahead = n_days if random else len(new_blocks(run.day for run in done))
            rows = lambda at: np.hstack([of_model(at), np.tile(np.eye(n_days)[-1], (len(at), 1))])  # noqa: E731
            precision = _with_days(precision, Z.shape[1] + n_days, ahead, of_day)
        weights, weight = self.weights(points), float(self.weights(self.target[None, :])[0])
        if two:
            of_flight = self.difference()[1]
            weights = np.where(flights, of_flight * weights, weights)
            weight *= of_flight if source == "flight" else 1.0
        return propose_batch(
            self.model,
            self.spec.region,
            Evidence(
                rows=np.hstack([Z, columns]),
                points=points,
                weights=weights,
                prior_precision=precision,
                df_pure_error=df_pure_error,
                barred=barred,
            ),
            self.sought(two, common),
            n,
            PLAN if self.analysis.fitted.departure.process is None else FOR_THE_OPTIMUM,
            source=Source(rows, weight, self.spec.cost.compared(source)),
            seed=batch_seed(self.spec.seed, len(done)),
        )

    def sought(self, two: bool, common: float) -> Sought:
        """Where the optimum is; see `Sought` for ``common``."""
        found = self.analysis.posterior.optimum_points[:_TARGETS]
        rows = (lambda at: stacked_rows(self.model, at, np.ones(len(at), dtype=np.bool_))) if two else None
        return Sought(self.target, found, rows, common)

    def difference(self) -> tuple[float, float, float]:
        """Prior sd of flights less simulations, weight of a flight, sigma of simulations; expected before flights."""
        fitted, found = self.analysis.fitted, self.analysis.sources
        if found is not None:
            return found.both.prior_sd, found.both.flight_weight, found.both.s_simulation
        expected = expected_of_flights(self.spec, fitted.data, self.analysis.scale, fitted.ground)
        return *expected, self.analysis.fit.s

    def weights(self, points: FloatArray) -> FloatArray:
        """Relative weights of runs, by the response expected there."""
        return self.analysis.scale.weight_at(self.model.matrix(points) @ self.analysis.fitted.surface.estimate)

    def precision(self, two: bool) -> FloatArray | None:
        """Prior precision of the model terms, and of the discrepancy where there are two sources."""
        application = self.spec.application(self.analysis.application)
        prior = stated_prior(self.spec, application, self.analysis.fit)
        if two:
            sd, _, sigma = self.difference()
            return source_prior(self.model, 0, sd, sigma, prior).Lambda0
        return None if prior is None else prior.Lambda0


def _day_columns(used: Sequence[_Made], random: bool) -> FloatArray:
    """Columns of the blocks flown, and of the days that pending and new runs will be flown on, these the last.

    Of random blocks about the average of all days; of others contrasts, one less than there are blocks flown, whose
    zeros are their mean: what the surface is known for now, and the new days are to be compared with.
    """
    flights = np.array([run.source == "flight" for run in used], dtype=np.bool_)
    day = flights * np.array([run.day for run in used])
    pending = day > 0
    blocks = np.array([run.block for run in used])[~pending]
    known = blocks[:, None] == np.unique(blocks)
    flown = known.astype(np.float64) if random else blocks_within(blocks.tolist(), flights[~pending])
    ahead = new_blocks(day.tolist())
    columns = np.zeros((len(used), flown.shape[1] + len(ahead)))
    columns[~pending, : flown.shape[1]] = flown
    columns[pending, flown.shape[1] :] = day[pending, None] == ahead
    return columns


def _with_days(precision: FloatArray | None, size: int, days: int, of_day: float) -> FloatArray:
    """Prior precision (size, size) with that of effects of days in so many of the last places."""
    found = np.diag(np.repeat([0.0, of_day], [size - days, days]))
    if precision is not None:
        found[: len(precision), : len(precision)] = precision
    return found


def next_batch(
    spec: CampaignSpec,
    analyses: Sequence[Analysis],
    active: Sequence[RunRecord],
    n: int,
    source: str,
    failed: Sequence[RunRecord] = (),
) -> list[NewRun]:
    """The next ``n`` runs; several applications take turns, by weight.

    ``active`` are scored and pending runs; pending ones count as made. A batch of flights is flown on one day: one of
    which nothing is scored on its own, what is left over of another with the new runs. ``source``: "simulation",
    "flight" or "best", which takes for each run the source that gains more for its cost. Settings that ``failed`` could
    not be carried out; nothing is proposed beside them.
    """
    region = spec.region
    barred = region.code([run.proposed for run in failed]) if failed else np.empty((0, region.k))
    flown = {run.batch for run in active if run.state == "scored"}
    done = []
    for run in active:
        own = run.source == "flight" and run.batch not in flown
        done.append(_Made(run.settings, run.source, run.block, 0 if run.state == "scored" else 1 + own * run.batch))
    made: list[NewRun] = []
    for index, share in _shares(spec, n):
        chooser = _Chooser(spec, analyses[index])
        repeats = sum(run.state != "scored" and run.purpose == "repeat" for run in active)
        pure = analyses[index].fit.df_pure_error + repeats
        batch: Iterable[tuple[Proposal, str]]
        if source == "best":
            batch = (_best_source(chooser, done, pure, barred) for _ in range(share))
        else:
            batch = [(proposal, source) for proposal in chooser.batch(done, share, source, pure, barred)]
        for proposal, chosen in batch:
            pure += proposal.repeats
            setting = _settings_of(region, proposal, done)
            # What a run gains is in units of a scatter that equal scores do not show.
            why = _ALL_EQUAL if chooser.analysis.fitted.data.all_equal else proposal.why
            why = why if len(analyses) == 1 else f"{chooser.analysis.application}: {why}"
            made.append(NewRun(setting, proposal.purpose, why, chosen, spec.cost.of(chosen)))
            done.append(_Made(setting, chosen, ""))
    return made


def _settings_of(region: Region, proposal: Proposal, done: Sequence[_Made]) -> dict[str, float | str]:
    """Settings of a proposal in round numbers; those of the run that it repeats to their last digit."""
    if not proposal.repeats:
        return rounded_settings(region, proposal.point[None, :])[0]
    distance = np.sum(np.square(region.code([run.settings for run in done]) - proposal.point), axis=1)
    repeated = done[int(np.argmin(distance))].settings
    return {name: repeated[name] for name in region.names}


def in_random_order(runs: Sequence[NewRun], seed: int, n_made: int) -> list[NewRun]:
    """The runs of a batch, flown on one occasion, with their flights in random order, each simulation in its place.

    What drifts while they are flown (the season, a calibration) is then no longer mixed up with the settings, and
    repeats are not flown one after the other, which would make them look alike (Box, Hunter & Hunter 2005, Statistics
    for Experimenters, 3.1). A simulation's score does not depend on its place. The campaign's ``seed`` and the number
    of runs before this batch, ``n_made``, give each batch an order of its own.
    """
    places = [index for index, run in enumerate(runs) if run.source == "flight"]
    found = list(runs)
    for place, index in zip(places, generator(seed, n_made, "order of flights").permutation(places), strict=True):
        found[place] = runs[index]
    return found


def _best_source(
    chooser: _Chooser, done: Sequence[_Made], df_pure_error: int, barred: FloatArray
) -> tuple[Proposal, str]:
    """The next run and its source: the larger gain for the cost; runs kept for repeats or spread go to the cheaper.

    Both are judged by the quadratic, as a process knows of one source.
    """
    sources = ("simulation", "flight")
    found = {source: chooser.batch_by_quadratic(done, 1, source, df_pure_error, barred)[0] for source in sources}
    kept = {"repeat", "spread"}
    if any(proposal.purpose in kept for proposal in found.values()):
        source = min(found, key=lambda name: chooser.spec.cost.of(name))
    else:
        source = max(found, key=lambda name: found[name].gain)
    return found[source], source


def _shares(spec: CampaignSpec, n: int) -> list[tuple[int, int]]:
    """Runs of the batch for each application, in proportion to the weights; the largest remainders round up."""
    weights = np.array([application.weight for application in spec.applications])
    wanted = n * weights / weights.sum()
    counts = np.floor(wanted).astype(int)
    for index in np.argsort(counts - wanted, kind="stable")[: n - int(counts.sum())]:
        counts[index] += 1
    return [(index, int(count)) for index, count in enumerate(counts) if count]


def rounded_settings(region: Region, points: FloatArray) -> list[dict[str, float | str]]:
    """Natural settings with the digits that people set, where rounding does not leave the region."""
    found = []
    for point, settings in zip(points, region.decode(points), strict=True):
        rounded = dict(settings)
        for factor, place in zip(region.factors, point, strict=True):
            # A bound is a number the user wrote.
            if not isinstance(factor, CategoricalFactor) and abs(place) < 1.0 - ROUNDING:
                rounded[factor.name] = plain_setting(factor, float(settings[factor.name]))
        found.append(rounded if region.feasible(region.code([rounded]))[0] else _rounded_inside(region, point, rounded))
    return found


def _rounded_inside(region: Region, point: FloatArray, rounded: dict[str, float | str]) -> dict[str, float | str]:
    """Settings a unit of their fourth digit up or down from ``rounded``, inside the region; else those of ``point``."""
    choices: list[list[float | str]] = []
    for name, value in rounded.items():
        factor = region.factors[region.names.index(name)]
        if isinstance(value, str) or not isinstance(factor, ContinuousFactor) or value == 0.0:
            choices.append([value])
            continue
        step = 10.0 ** (np.floor(np.log10(abs(value))) - 3.0)
        choices.append([float(f"{value + k * step:.4g}") for k in (0.0, -1.0, 1.0)])
    settings = [dict(zip(rounded, combination, strict=True)) for combination in itertools.product(*choices)]
    points = region.code(settings)
    inside = region.feasible(points)
    if not inside.any():
        return dict(region.decode(point)[0])
    distance = np.where(inside, np.square(points - point).sum(axis=1), np.inf)
    return settings[int(np.argmin(distance))]
