"""``seqrsm check``: everything that can be known before the first run."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import chdtri

from seqrsm.analysis.conclude import stop_rule
from seqrsm.analysis.ground import MOST_SHARE, OCCASIONS, ground_of_scores
from seqrsm.arrays import FloatArray
from seqrsm.campaign.campaign import Campaign
from seqrsm.campaign.engines import frame_limits
from seqrsm.campaign.next_runs import start_size
from seqrsm.campaign.simulation import carry_out, check_simulator, scene_at, simulate_images, task_of
from seqrsm.decide.stopping import StopRule, flights_needed, target_problem
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.errors import FitError, Problem, SpecError
from seqrsm.sensor.radar import RadarConfiguration
from seqrsm.simulate.radar.frame import make_frame
from seqrsm.spec.read import SPEC_NAME, CampaignSpec, load_spec
from seqrsm.store.store import STORE_NAME, Store

PROBE_WORLDS = 4
"""Worlds, with `OCCASIONS` in each, of simulations at the centre of the region, for each level of the categorical
factors; they measure noise and time, belong to no run and are not kept."""

REFUSAL_LEVEL = 0.99
"""A target is refused only when noise this improbably small could not reach it either."""


@dataclass(frozen=True, slots=True)
class CheckResult:
    """What `check_campaign` found; all is in order, else it would have raised.

    Attributes
    ----------
    name : str
    n_factors, n_terms, start_runs, min_runs, max_runs : int
        Size of the model, of the start design, the fewest runs the stop rule asks for, and the budget.
    seconds_per_run : float
        Measured on this machine [s]; nan without a simulator.
    noise : float
        Standard deviation among the probes, score units; nan without a simulator.
    ground_share : float
        Share of its variance that is one ground against another; 0 without a simulator.
    noise_source : str
        Where ``noise`` comes from.
    cost : float
        Of the whole budget, in the campaign's cost unit.
    target_problem : str
        Why the stop target may be out of reach; empty if it is not.
    notes, covers : tuple of str
        What the simulation rests on, and the cover categories of its scene.
    combinations : tuple of str
        What combinations of the parameters do, such as gaps between the lines of a scan, and where.
    hardware : tuple of str
        Whether the radars at the best settings so far could be built, rule by rule with its margin; empty before.
    """

    name: str
    n_factors: int
    n_terms: int
    start_runs: int
    min_runs: int
    max_runs: int
    seconds_per_run: float
    noise: float
    ground_share: float
    noise_source: str
    cost: float
    target_problem: str
    notes: tuple[str, ...]
    covers: tuple[str, ...] = ()
    combinations: tuple[str, ...] = ()
    hardware: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """The result as a JSON document."""
        return {name: getattr(self, name) for name in self.__slots__}


def check_campaign(folder: Path, progress: Callable[[int, int], None] = lambda done, total: None) -> CheckResult:
    """Validate a campaign and estimate what it will take; nothing is written.

    Parameters
    ----------
    folder : Path
    progress : callable
        Told how many simulations are done of how many.

    Raises
    ------
    UserError
        Everything that is wrong with the specification, or with the sensor at the corners of the region; or a stop
        target that cannot be reached.
    """
    spec = load_spec(folder)
    model = QuadraticModel(spec.factors, spec.model.order)
    rule = stop_rule(spec)
    noise, share, df, seconds, source = float("nan"), 0.0, 0, float("nan"), "not known before the first repeats"
    notes: tuple[str, ...] = ()
    covers: tuple[str, ...] = ()
    combinations: tuple[str, ...] = ()
    if spec.simulator is not None:
        combinations = check_simulator(spec)
        noise, share, df, seconds, notes = _probe(spec, progress)
        rule = replace(rule, ground_share=share)
        covers = scene_at(str(spec.scene_path)).categories
        source = f"simulations at the centre, {df} degrees of freedom"
    elif (spec.folder / STORE_NAME).exists() or spec.store_url:
        noise, df, source = _noise_of_scores(spec)
    unit = spec.applications[0].unit
    problem = target_problem(rule, noise, model.p, unit) if np.isfinite(noise) else ""
    least = noise * np.sqrt(df / chdtri(df, 1.0 - REFUSAL_LEVEL)) if df else 0.0
    if problem and share > 0.0 and rule.counts_ground:
        problem += _by_flights(rule, noise)
    # What the ground adds does not refuse a target: flights may follow.
    hopeless = target_problem(replace(rule, counts_ground=False), least, model.p, unit) if least > 0.0 else ""
    result = CheckResult(
        name=spec.name,
        n_factors=spec.region.k,
        n_terms=model.p,
        start_runs=start_size(model, spec),
        min_runs=rule.min_runs(model.p),
        max_runs=rule.max_runs,
        seconds_per_run=seconds,
        noise=noise,
        ground_share=share,
        noise_source=source,
        cost=rule.max_runs * (spec.cost.simulation if spec.simulator is not None else spec.cost.flight),
        target_problem=problem,
        notes=notes,
        covers=covers,
        combinations=combinations,
        hardware=_hardware(spec),
    )
    if hopeless:
        remedy = "Widen [stop] half_width, raise max_runs, or choose another interval."
        raise SpecError(Problem(problem or hopeless, remedy, file=str(spec.folder / SPEC_NAME), field="[stop]"))
    return result


def _hardware(spec: CampaignSpec) -> tuple[str, ...]:
    """The rules of hardware at what the last look of each application recommends."""
    if spec.simulator is None or not (spec.store_url or (spec.folder / STORE_NAME).exists()):
        return ()
    with Store.open(spec.folder, url=spec.store_url, campaign=spec.name, seed=spec.seed) as store:
        looks = {look.application: look.summary["optimum"]["settings"] for look in store.looks()}
    scene, found = scene_at(str(spec.scene_path)), []
    for settings in looks.values():
        sensors = dict.fromkeys(one.sensor for one in task_of(spec, 0, settings).acquisitions)
        for sensor in (one for one in sensors if isinstance(one, RadarConfiguration)):
            rules = frame_limits(sensor, make_frame(scene, sensor, "float32"))
            found += [f"{rule.name}, margin {rule.margin:.3g}: {rule.text}" for rule in rules]
    return tuple(dict.fromkeys(found))


def _by_flights(rule: StopRule, noise: float) -> str:
    """What flights can do where simulation alone cannot."""
    flights = flights_needed(rule, noise)
    share = f"{100.0 * rule.ground_share:.0f} % of a run's variance is what is not known of the ground"
    if flights is None:
        return f" {share}, and the rest is too much for a thousand flights."
    return (
        f" {share}, which no simulation narrows: about {flights} flights at the recommended settings reach the target; "
        'or [stop] worlds = "ignore" leaves that part out.'
    )


def _probe(
    spec: CampaignSpec, progress: Callable[[int, int], None]
) -> tuple[float, float, int, float, tuple[str, ...]]:
    """Noise, the ground's share of its variance, degrees of freedom, seconds of a simulated run, and notes."""
    points = [_with_levels(spec, levels) for levels in spec.region.level_combinations()]
    settings = [spec.region.decode(point)[0] for point in points if spec.region.feasible(point)[0]][:8]
    # Ids far beyond any campaign's: their occasions are no run's.
    probes = PROBE_WORLDS * OCCASIONS
    tasks = [
        replace(task_of(spec, 2**31 - 1 - i, setting), world=2**31 - 1 - i // OCCASIONS)
        for i, setting in enumerate(np.repeat(np.array(settings), probes))
    ]
    progress(0, len(tasks))
    # Levels rest on assumptions of their own; the first image also compiles the kernels, which is not to be timed.
    levels = [replace(tasks[0], settings=setting) for setting in settings]
    made = (image for task in levels for image in simulate_images(task, scene_at(task.scene)))
    notes = dict.fromkeys(note for image in made for note in image.notes)
    start = time.perf_counter()
    results = []
    for task in tasks:
        results.append(carry_out(task))
        progress(len(results), len(tasks))
    seconds = (time.perf_counter() - start) / len(tasks)
    failed = [result.failure for result in results if result.failure]
    if failed:
        raise SpecError(*(Problem(reason, file=str(spec.folder / SPEC_NAME)) for reason in dict.fromkeys(failed)))
    scores = np.array([[score.score for score in result.scores] for result in results])
    groups = scores.reshape(len(settings), PROBE_WORLDS, OCCASIONS, -1)
    found = []
    for k in range(groups.shape[-1]):
        of = [ground_of_scores(group[:, :, k]) for group in groups]
        ground, chance = (np.mean([getattr(one, name) ** 2 for one in of]) for name in ("sd_ground", "sd_chance"))
        found.append((float(np.sqrt(ground + chance)), float(ground / max(ground + chance, 1e-300))))
    noise, share = max(found)
    return noise, min(share, MOST_SHARE), len(settings) * (PROBE_WORLDS - 1), seconds, tuple(notes)


def _with_levels(spec: CampaignSpec, levels: tuple[int, ...]) -> FloatArray:
    point = spec.region.centre()
    point[list(spec.region.categorical)] = levels
    return point


def _noise_of_scores(spec: CampaignSpec) -> tuple[float, int, str]:
    """Residual standard deviation of the scores already there, and its degrees of freedom."""
    store = Store.open(spec.folder, url=spec.store_url, campaign=spec.name, seed=spec.seed)
    try:
        analyses: Sequence[Any] = Campaign(spec, store).analyse_all()
    except FitError:
        return float("nan"), 0, "too few scores"
    worst = max(analyses, key=lambda analysis: float(analysis.fit.s))
    return float(worst.fit.s), worst.fit.df_residual, f"residuals of {worst.fit.n_runs} scored runs"
