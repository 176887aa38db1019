"""``seqrsm check``: everything that can be known before the first run, and what runs can give."""

from __future__ import annotations

import math
import re
import textwrap
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.special import chdtri, ndtri

from seqrsm.analysis.conclude import as_found, stop_rule
from seqrsm.analysis.ground import OCCASIONS, ground_of_scores
from seqrsm.analysis.posterior import draw_coefficients
from seqrsm.analysis.results import Analysis
from seqrsm.analysis.runs import coded_settings, see_names
from seqrsm.arrays import FloatArray
from seqrsm.campaign.budget import N_CAMPAIGNS, Budget, Plan, Surfaces, plans_by_process, random_surfaces, way_out
from seqrsm.campaign.campaign import Campaign
from seqrsm.campaign.engines import frame_limits, frame_swath
from seqrsm.campaign.experiment import see_experiment
from seqrsm.campaign.next_runs import start_size
from seqrsm.campaign.simulation import bundle_tasks, carry_out, scene_at, simulate_images, task_of
from seqrsm.campaign.simulator_checks import check_simulator
from seqrsm.decide.stopping import StopRule, amount, flights_needed, target_problem
from seqrsm.design.optimal import see_separable
from seqrsm.errors import FitError, Problem, SpecError
from seqrsm.progress import silent
from seqrsm.rng import generator
from seqrsm.scattering.calendar import has_course
from seqrsm.sensor.earth import LOWEST_ORBIT_M
from seqrsm.sensor.hardware import ASSUMED_BITS, data_rate_bit_s
from seqrsm.sensor.named import named_sensors
from seqrsm.sensor.radar import RadarConfiguration
from seqrsm.simulate.radar.frame import make_frame
from seqrsm.spec.read import SPEC_NAME, CampaignSpec, load_spec, placed
from seqrsm.spec.tables import ApplicationSpec
from seqrsm.store.store import Store

PROBES, PROBE_WORLDS = 16, 2
"""Random settings of the region, and worlds with `OCCASIONS` in each, that are simulated at each of them.

They tell noise, how much the score varies over the region, and time; they belong to no run and are not kept."""

ASSUMED_SPREAD = 3.0

REFUSAL_LEVEL = 0.99
"""A target is refused only when noise this improbably small could not reach it either."""

_UTM_SOUTH = 327  # EPSG 32701 to 32760
_SEASON_DAYS = 61.0  # by which a shift may be off half a year: crops of one hemisphere lie so far apart
_NEAR_OCTAVES = 0.8
"""Nearer bands have means of covers that differ by more than twice what fields do: from L to C, by 1.4 times."""
_ROOM = 1.2
"""By how much a target may be above the median half-width that the budget gives."""
_RUN_SD = "s.d. of a run"  # unit of half-widths where nothing is known yet of the scatter
_TOLD_SHARE = 0.05  # of the variance: less is not why a target is out of reach


@dataclass(frozen=True)
class Judged:
    """What runs can give of one application, and whether its targets are in reach."""

    application: str
    """Its name."""
    noise: float
    """Standard deviation of a run, score units; nan where it is not known yet."""
    ground_share: float
    """Share of its variance that is one ground against another; 0 without a simulator."""
    noise_source: str
    """Where ``noise`` comes from."""
    min_runs: int
    """The fewest runs the stop rule asks for on the flight days so far."""
    min_runs_departed: int
    """The same if the scores favour another surface than the model, and all factors matter."""
    further_days: int | None
    """Flight days to come for whose constants the budget is enough; None where days are no constants."""
    target_problem: str
    """Why the stop target may be out of reach; empty if it is not."""
    plans: tuple[Plan, ...] = ()
    over: tuple[Plan, ...] = ()
    """What the budget can give in different ways, and what other numbers of runs give, see `seqrsm.campaign.budget`."""
    surfaces: str = ""
    """From what surfaces ``plans`` and ``over`` were found."""
    target: float = float("nan")
    unit: str = ""
    """Target half-width, nan where half-widths are told in standard deviations of a run; their unit."""
    refused: str = ""
    """Why the target cannot be reached, and what could; empty if it may."""
    target_loss: float = float("nan")
    """Limit of the expected loss in that unit, nan without one and where ``target`` is."""
    loss_departed: float = float("nan")
    """Loss expected of the budget in that unit if the surface is no quadratic; nan once there are scores, and of
    logits, a first-order model or more than 250 runs."""

    @property
    def away(self) -> tuple[bool, bool, float]:
        """Sort key: the farther from its targets, the larger."""
        of = ((self.plans[0].half_width, self.target), (self.plans[0].loss, self.target_loss))
        return bool(self.refused), bool(self.target_problem), max(np.nan_to_num(x / y, nan=-1.0) for x, y in of)


@dataclass(frozen=True, kw_only=True)
class CheckResult(Judged):
    """What `check_campaign` found; all is in order, else it would have raised.

    Of several applications it is itself the one that is the farthest from its targets.
    """

    name: str
    """Of the campaign."""
    n_factors: int
    n_terms: int
    start_runs: int
    max_runs: int
    """Size of the model, of the start design, and the budget."""
    seconds_per_run: float
    """Measured on this machine [s]; nan without a simulator."""
    cost: float
    cost_unit: str
    """Of the whole budget, see `seqrsm.spec.tables.CostSpec`."""
    notes: tuple[str, ...]
    covers: tuple[str, ...] = ()
    """What the simulation rests on, and the cover categories of its scene."""
    combinations: tuple[str, ...] = ()
    """What combinations of the parameters do, such as gaps between the lines of a scan, and where."""
    hardware: tuple[str, ...] = ()
    """Whether the radars at the best settings so far could be built, rule by rule with its margin; empty before."""
    others: tuple[Judged, ...] = ()
    """The other applications, the farthest first."""

    @property
    def judged(self) -> tuple[Judged, ...]:
        """All applications, the farthest from its targets first."""
        return self, *self.others


def check_campaign(folder: Path, progress: Callable[[int, int], None] = silent) -> CheckResult:
    """Validate a campaign and estimate what it will take; nothing is written.

    ``progress`` is told how many simulations are done of how many. UserError tells everything that is wrong with the
    specification, or with the sensor at the corners of the region; or that what runs so far were simulated from has
    changed.
    """
    spec = load_spec(folder)
    model = spec.quadratic
    combinations = () if spec.simulator is None else combinations_of(spec)
    analyses, made = _so_far(spec)
    if not analyses:
        see_separable(model, spec.region, made)
    found, seconds = [_Scatter()] * len(spec.applications), float("nan")
    covers: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    if spec.simulator is not None:
        found, seconds, notes = _probe(spec, progress)
        covers = scene_at(str(spec.scene_path)).categories
    start, no_start = None, ""
    try:
        start = start_size(spec)
    except SpecError as error:
        no_start = error.problems[0].message + "."
    judged = [
        _judged(spec, application, scatter, analyses.get(application.name), no_start)
        for application, scatter in zip(spec.applications, found, strict=True)
    ]
    own, *others = sorted(judged, key=lambda one: one.away, reverse=True)
    return CheckResult(
        **vars(own),
        name=spec.name,
        n_factors=spec.region.k,
        n_terms=model.p,
        start_runs=own.min_runs if start is None else start,
        max_runs=spec.stop.max_runs,
        seconds_per_run=seconds,
        cost=spec.stop.max_runs * spec.cost.of(spec.own_source),
        cost_unit=spec.cost.told_unit,
        notes=notes,
        covers=covers,
        combinations=combinations,
        hardware=_hardware(spec, [one.optimum.settings for one in analyses.values()]),
        others=tuple(others),
    )


def combinations_of(spec: CampaignSpec) -> tuple[str, ...]:
    """Notes on the sensor at the design's settings, and on where the tables end; errors of `check_simulator`."""
    doubts = (text for settings in spec.region.decode(_centres(spec)) for text in _doubts(spec, settings))
    return tuple(dict.fromkeys([*check_simulator(spec), *doubts]))


def _judged(
    spec: CampaignSpec, application: ApplicationSpec, simulated: _Scatter, analysis: Analysis | None, no_start: str
) -> Judged:
    """One application; ``no_start`` says why there can be no start design."""
    model, found = spec.quadratic, _so_far_or(simulated, analysis)
    rule, (noise, share, df, source, *_) = _rule_of(spec, application, found.share, analysis), found
    unit = application.score_unit
    terms = model.p if analysis is None else analysis.fitted.surface.n_terms
    constants = spec.model.block is not None and spec.model.block_effect == "fixed" and spec.own_source == "flight"
    asked = [rule.min_runs(terms + days) for days in range(1 + rule.max_runs)]
    problem = target_problem(rule, noise if np.isfinite(noise) else 0.0, terms, unit)
    least = noise * np.sqrt(df / chdtri(df, 1.0 - REFUSAL_LEVEL)) if df else 0.0
    if problem and share > 0.0 and rule.counts_ground and rule.max_runs >= rule.min_runs(terms):
        problem += _by_flights(rule, noise)
    if problem and df and analysis is None and rule.max_runs >= rule.min_runs(terms):
        problem += " This is the scatter all over the region; at the optimum it may be less."
    # What the ground adds does not refuse a target: flights may follow.
    hopeless = target_problem(replace(rule, counts_ground=share == 0.0), least, terms, unit) if least > 0.0 else ""
    departed = float("nan")
    if analysis is not None and analysis.fitted.departure.favoured:
        plans, over = plans_by_process(analysis, rule, spec.seed)
        surfaces = f"surfaces drawn from the posterior of the {analysis.fit.n_runs} scores so far"
        surfaces += ", which favour another surface than the model"
        in_units = True
    else:
        known = _surfaces(spec, application, found, analysis)
        at = spec.region.centre() if analysis is None else analysis.optimum.point  # where factors would be fixed
        budget = Budget(spec.region, spec.model.order, application.goal, rule, known, at, spec.seed, terms - model.p)
        plans, over = budget.plans(spec.stop.confirmation_runs)
        surfaces = f"{known.source}; other surfaces lose more"
        if analysis is None and spec.model.order == 2 and not known.logit:
            departed = budget.loss_off_quadratics()
        in_units = bool(np.isfinite(noise)) or known.noise != 1.0  # else the scatter of a run is one
    refused = no_start or (problem or hopeless if hopeless else "")
    target, unit = (rule.half_width, unit) if in_units else (float("nan"), _RUN_SD)
    target_loss = rule.loss if in_units and math.isfinite(rule.loss) else float("nan")
    if not problem and not plans[0].reaches(target, target_loss):
        problem = f"{rule.max_runs} runs are not expected to reach the targets."
    if refused or problem:
        own = [key for key in ("half_width", "loss") if getattr(application, key) is not None]
        out = way_out(plans, over, target, target_loss, unit, own)
        of = f"{application.name}: " if len(spec.applications) > 1 else ""
        refused, problem = (f"{of}{text} {out}" if text else "" for text in (refused, problem))
    return Judged(
        application=application.name,
        noise=noise,
        ground_share=share,
        noise_source=source,
        min_runs=asked[0],
        min_runs_departed=replace(rule, acting_terms=terms).min_runs(terms),
        further_days=sum(n <= rule.max_runs for n in asked[1:]) if constants else None,
        target_problem=problem,
        plans=plans,
        over=over,
        surfaces=surfaces,
        target=target,
        unit=unit,
        refused=refused,
        target_loss=target_loss,
        loss_departed=departed,
    )


def refusals(folder: Path, result: CheckResult) -> list[Problem]:
    """Targets that cannot be reached, with their places in ``campaign.toml``."""
    refused = [one for one in result.judged if one.refused]
    if not refused:
        return []
    spec, found = load_spec(folder), []
    for one in refused:
        k = [each.name for each in spec.applications].index(one.application)
        own = spec.applications[k].half_width is not None and spec.stop.max_runs >= one.min_runs
        field, *path = ("[[application]] half_width", "application", k, "half_width") if own else ("[stop]", "stop")
        found.append(placed(spec, Problem(one.refused, field=field), *path))
    return found


def settle_target(folder: Path, progress: Callable[[int, int], None] = silent) -> str:
    """Widen the stop targets of a new simulated campaign, where they are out of reach, to what its budget reaches.

    Its ``campaign.toml`` has lines ``half_width = NUMBER`` and ``loss = NUMBER``, over which the reason is written.
    Returns the reasons; "" where nothing is changed. ``progress`` and errors are those of `check_campaign`.
    """
    result = check_campaign(folder, progress)
    path, reasons = folder / SPEC_NAME, []
    text = path.read_text(encoding="utf-8")
    for key, target in (("half_width", "target"), ("loss", "target_loss")):
        one = max(result.judged, key=lambda one: float(getattr(one.plans[0], key)))
        expected, allowed = getattr(one.plans[0], key), getattr(one, target)
        if not expected > allowed:
            continue
        reason = f"{key} {amount(allowed, one.unit)} is out of reach: {result.max_runs} runs are expected to give "
        reason += amount(expected, "", allowed)
        if key == "half_width" and one.ground_share >= _TOLD_SHARE:
            reason += (
                f"; {100.0 * one.ground_share:.0f} % of a run's variance is table uncertainty, which flights "
                'reduce and simulations do not ([stop] worlds = "ignore" excludes it)'
            )
        unit = 10.0 ** (math.floor(math.log10(_ROOM * expected)) - 1)
        lines = [f"# {line}" for line in textwrap.wrap(reason, 110)]
        lines.append(f"{key} = {unit * math.ceil(_ROOM * expected / unit):.10g}".ljust(30))
        text = re.sub(rf"(?m)^{key} = \S+ *", "\n".join(lines), text)
        reasons.append(reason)
    path.write_text(text, encoding="utf-8")
    return "; ".join(reasons)


def _hardware(spec: CampaignSpec, recommended: Sequence[Mapping[str, float | str]]) -> tuple[str, ...]:
    """The rules of hardware at the settings that are recommended."""
    if spec.simulator is None:
        return ()
    scene, found = scene_at(str(spec.scene_path)), []
    for settings in recommended:
        sensors = dict.fromkeys((one.sensor, one.member) for one in task_of(spec, 0, settings).acquisitions)
        for sensor, member in sensors:
            if not isinstance(sensor, RadarConfiguration):
                continue
            frame, who = make_frame(scene, sensor, "float32"), f"{member}, " if member else ""
            found += [f"{who}{one.name}, margin {one.margin:.3g}: {one.text}" for one in frame_limits(sensor, frame)]
            if sensor.scan == "slar":
                bits = f"{sensor.adc_bits} bits" if sensor.adc_bits else f"{ASSUMED_BITS} bits (assumed)"
                rate = 1e-6 * data_rate_bit_s(sensor, *frame_swath(frame))
                told = f"{rate:.3g} Mbit/s over this swath with {bits} each for I and Q"
                orbits = sensor.altitude_m > LOWEST_ORBIT_M
                found.append(f"{who}data rate, {f'margin {_downlinks(told, rate)}' if orbits else told}")
    return tuple(dict.fromkeys(found))


def _downlinks(told: str, rate: float) -> str:
    """Margin of the fastest downlink that is known over a data rate [Mbit/s], the rate as told, and all of them."""
    known = {one.name: one for one in named_sensors() if "downlink_mbit_s" in one.values}
    rates = {name: one.values["downlink_mbit_s"] for name, one in known.items()}
    marks = {name: "?" if one.resting("downlink_mbit_s") == "recalled" else "" for name, one in known.items()}
    sent = ", ".join(f"{name} {rates[name]:g}{marks[name]}" for name in sorted(rates, key=rates.__getitem__))
    checked = max(rates[name] for name in rates if not marks[name])
    return f"{checked / rate:.3g}: {told}; downlinks of known sensors in Mbit/s: {sent}; ? recalled"


def _by_flights(rule: StopRule, noise: float) -> str:
    """What flights can do where simulation alone cannot."""
    flights = flights_needed(rule, noise)
    share = f"{100.0 * rule.ground_share:.0f} % of a run's variance is table uncertainty"
    if flights is None:
        return f" {share}, and even a thousand flights do not reach the target."
    return (
        f" {share}, which simulations do not reduce: about {flights} flights at the recommended settings reach the "
        'target; or [stop] worlds = "ignore" excludes it.'
    )


class _Scatter(NamedTuple):
    """Scatter of a run of one application: standard deviation, the ground's share of its variance, what they rest on.

    ``level`` and ``spread`` are mean and standard deviation of the expected score over the region; all in score units.
    """

    noise: float = float("nan")
    share: float = 0.0
    df: int = 0
    source: str = "unknown before the first repeats"
    spread: float = float("nan")
    level: float = float("nan")


def _rule_of(spec: CampaignSpec, application: ApplicationSpec, share: float, analysis: Analysis | None) -> StopRule:
    """The application's stop rule as `status` applies it, to the scores so far where there are any."""
    rule = stop_rule(spec.stop_of(application.name), share)
    return rule if analysis is None else as_found(rule, analysis.fitted, analysis.optimum.point)


def _so_far_or(found: _Scatter, analysis: Analysis | None) -> _Scatter:
    """The scatter by the scores so far where there are any, else as found by simulations."""
    if analysis is None or not analysis.fitted.surface.s > 0.0:
        return found
    ground, source = analysis.fitted.ground, f"residuals of {analysis.fit.n_runs} scored runs"
    share = found.share if ground is None else ground.share
    if ground is not None and analysis.fitted.run_ratio != 1.0:
        source = f"{ground.n_simulations} simulations near the optimum, in {ground.n_worlds} draws of the tables"
    return _Scatter(analysis.sd_of_run, share, analysis.fitted.surface.df_residual, source)


def _probe(spec: CampaignSpec, progress: Callable[[int, int], None]) -> tuple[list[_Scatter], float, tuple[str, ...]]:
    """The scatter of each application's runs by simulations all over the region, seconds of a run, and notes."""
    points = spec.region.sample(PROBES, generator(spec.seed, 0, "spread"))
    each = PROBE_WORLDS * OCCASIONS
    tasks = [
        task
        for i, setting in enumerate(spec.region.decode(points))
        for task in bundle_tasks(
            spec, setting, worlds=range(PROBE_WORLDS * i, PROBE_WORLDS * (i + 1)), key=lambda number: 2**31 - 1 - number
        )
    ]
    progress(0, len(tasks))
    # Levels rest on assumptions of their own; the first image also compiles the kernels, which is not to be timed.
    levels = [replace(tasks[0], settings=setting) for setting in spec.region.decode(_centres(spec)[:8])]
    made = (image for task in levels for image in simulate_images(task, scene_at(task.scene)))
    notes = dict.fromkeys(note for image in made for note in image.notes)
    start = time.perf_counter()
    results = []
    for task in tasks:
        results.append(carry_out(task))
        progress(len(results), len(tasks))
    seconds = (time.perf_counter() - start) / len(tasks)
    whole = [of for of in zip(*[iter(results)] * each, strict=True) if not any(one.failure for one in of)]
    if len(whole) < PROBES // 2:
        reasons = dict.fromkeys(result.failure for result in results if result.failure)
        raise SpecError(*(Problem(reason, file=str(spec.folder / SPEC_NAME)) for reason in reasons))
    scores = np.array([[[score.score for score in one.scores] for one in of] for of in whole])
    groups = scores.reshape(len(whole), PROBE_WORLDS, OCCASIONS, -1)
    df = len(whole) * (PROBE_WORLDS - 1)
    source = f"simulations at {len(whole)} settings of the region, {df} degrees of freedom"
    found = []
    for k in range(len(spec.applications)):
        ground = ground_of_scores(groups[..., k])
        noise = math.sqrt(ground.variance)
        of_mean = ground.sd_ground**2 / PROBE_WORLDS + ground.sd_chance**2 / each
        over = float(np.var(scores[:, :, k].mean(axis=1), ddof=1)) - of_mean
        spread = math.sqrt(max(over, (0.5 * noise) ** 2))
        found.append(_Scatter(noise, ground.share, df, source, spread, float(scores[:, :, k].mean())))
    return found, seconds, tuple(notes)


def _centres(spec: CampaignSpec) -> FloatArray:
    """The centre of the region at every combination of levels, coded, as far as constraints allow."""
    levels_of = list(spec.region.level_combinations())
    centres = np.tile(spec.region.centre(), (len(levels_of), 1))
    centres[:, list(spec.region.categorical)] = levels_of
    return centres[spec.region.feasible(centres)]


def _doubts(spec: CampaignSpec, settings: Mapping[str, float | str]) -> Iterator[str]:
    """Where the tables end: radars of a set in bands too near to know how much alike they see the ground; the south."""
    task = task_of(spec, 0, settings)
    made, scene = task.acquisitions, scene_at(task.scene)
    south = (scene.epsg or 0) // 100 == _UTM_SOUTH or any(getattr(o.sensor, "latitude_deg", 0.0) < 0.0 for o in made)
    own = task.scattering(task.engine).calendar.own
    crops = [name for name in scene.categories if has_course(name) and name not in own]
    late = task.late_days
    if south and made[0].visit.day is not None and crops and abs(late % 365 - 182.5) > _SEASON_DAYS:
        moved = f", {late} days later," if late else ""
        where = f"the built-in calendar{moved} is of the northern hemisphere, the scene in the southern"
        yield f"{', '.join(crops)}: {where}; set [simulator] calendar_shift_days = 182, or give rows in a calendar"
    bands = sorted({one.sensor.frequency_ghz for one in made if isinstance(one.sensor, RadarConfiguration)})
    for low, high in pairwise(bands):
        if (octaves := math.log2(high / low)) < _NEAR_OCTAVES:
            yield (
                f"radars at {low:g} and {high:g} GHz are {octaves:.2g} octave apart: how differently two near bands "
                "see a cover is assumed, and with it the gain of the second"
            )


def _so_far(spec: CampaignSpec) -> tuple[dict[str, Analysis], FloatArray]:
    """Analyses of applications, none where scores are too few; and coded settings (n, k) of scored runs."""
    analyses: dict[str, Analysis] = {}
    if not Store.exists(spec.folder, spec.store_url):
        return analyses, np.empty((0, spec.region.k))
    with Store.open(spec.folder, url=spec.store_url, campaign=spec.name, seed=spec.seed) as store:
        store.verify()
        if spec.simulator is not None:
            see_experiment(store, spec, note=False)
        see_names(spec, store.runs())
        for one in spec.applications:
            with suppress(FitError):
                (analyses[one.name],) = Campaign(spec, store).analyse_all(one.name)
        return analyses, coded_settings(spec.region, store.runs("scored"))


def _surfaces(spec: CampaignSpec, application: ApplicationSpec, found: _Scatter, analysis: Analysis | None) -> Surfaces:
    """What is known of the surface: by scores, else by simulations, else as stated, else assumed."""
    prior, noise, spread, level = application.prior, found.noise, found.spread, found.level
    logit = spec.model.response == "logit"
    as_shares = logit and spec.model.weights != "se"
    if analysis is not None and analysis.fitted.surface.s > 0.0:
        draws = draw_coefficients(spec, analysis.fitted, sampler="exact", n_draws=N_CAMPAIGNS)
        source = f"quadratics drawn from the posterior of the {analysis.fit.n_runs} scores so far"
        ratio, at_best = math.sqrt(analysis.fitted.run_ratio), analysis.sd_of_run
        top = analysis.optimum.mean if as_shares else math.nan
        return Surfaces(analysis.model, draws.terms, at_best / ratio, source, logit, ratio, top)
    if np.isfinite(spread):
        source = "random quadratics with the variation over the region of these simulations"
    elif prior is not None and prior.utility is not None:
        low, high = prior.utility
        spread, level = float((high - low) / (2.0 * ndtri(0.5 + 0.5 * prior.probability))), 0.5 * (low + high)
        noise = prior.repeat_sd or 0.1 * (high - low)
        source = "random quadratics with the variation over the region given by [application.prior]"
    else:
        noise = noise if np.isfinite(noise) else 1.0
        spread = ASSUMED_SPREAD * noise
        source = f"random quadratics varying over the region {ASSUMED_SPREAD:g} times as much as a run (assumed)"
    # Without a level half-widths are in standard deviations of a run, on the scale of the fit.
    of_logits = level if logit and math.isfinite(level) else None
    known = random_surfaces(spec.region, noise, spread, source, spec.seed, of_logits)
    return replace(known, level=level) if as_shares else known
