"""``seqrsm check``: everything that can be known before the first run."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import chdtri

from seqrsm.arrays import FloatArray
from seqrsm.campaign.analyse import stop_rule
from seqrsm.campaign.engines import ENGINES
from seqrsm.campaign.next_runs import start_size
from seqrsm.campaign.simulation import NO_RUN, carry_out, configuration, scene_at, task_of
from seqrsm.campaign.spec import SPEC_NAME, CampaignSpec, fixed_problem, load_spec
from seqrsm.campaign.store import STORE_NAME, Store
from seqrsm.decide.stopping import target_problem
from seqrsm.design.factors import setting_text
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.errors import Problem, SpecError, UserError

PROBES = 4
"""Simulations at the centre of the region, for each level of the categorical factors, that measure noise and time; they
belong to no run and are not kept."""

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
    """

    name: str
    n_factors: int
    n_terms: int
    start_runs: int
    min_runs: int
    max_runs: int
    seconds_per_run: float
    noise: float
    noise_source: str
    cost: float
    target_problem: str
    notes: tuple[str, ...]
    covers: tuple[str, ...] = ()
    combinations: tuple[str, ...] = ()

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
    noise, df, seconds, source = float("nan"), 0, float("nan"), "not known before the first repeats"
    notes: tuple[str, ...] = ()
    covers: tuple[str, ...] = ()
    combinations: tuple[str, ...] = ()
    if spec.simulator is not None:
        combinations = check_simulator(spec)
        noise, df, seconds, notes = _probe(spec, progress)
        covers = scene_at(str(spec.scene_path)).categories
        source = f"simulations at the centre, {df} degrees of freedom"
    elif (spec.folder / STORE_NAME).exists() or spec.store_url:
        noise, df, source = _noise_of_scores(spec)
    unit = spec.applications[0].unit
    problem = target_problem(rule, noise, model.p, unit) if np.isfinite(noise) else ""
    least = noise * np.sqrt(df / chdtri(df, 1.0 - REFUSAL_LEVEL)) if df else 0.0
    hopeless = target_problem(rule, least, model.p, unit) if least > 0.0 else ""
    result = CheckResult(
        name=spec.name,
        n_factors=spec.region.k,
        n_terms=model.p,
        start_runs=start_size(model, spec),
        min_runs=rule.min_runs(model.p),
        max_runs=rule.max_runs,
        seconds_per_run=seconds,
        noise=noise,
        noise_source=source,
        cost=rule.max_runs * (spec.cost.simulation if spec.simulator is not None else spec.cost.flight),
        target_problem=problem,
        notes=notes,
        covers=covers,
        combinations=combinations,
    )
    if hopeless:
        remedy = "Widen [stop] half_width, raise max_runs, or choose another interval."
        raise SpecError(Problem(problem or hopeless, remedy, file=str(spec.folder / SPEC_NAME), field="[stop]"))
    return result


def check_simulator(spec: CampaignSpec) -> tuple[str, ...]:
    """Scene, sensor at the corners of the region, scattering data, and one image at its centre, before any run.

    Returns
    -------
    tuple of str
        What combinations of the parameters do, such as gaps between lines, and where.

    Raises
    ------
    UserError
        What is wrong with them.
    """
    if spec.simulator is None:
        raise SpecError(
            Problem(
                "this campaign has no simulator: its scores are measured",
                "Propose flights (`seqrsm propose --source flight`), then `seqrsm ingest` and `seqrsm fit`.",
            )
        )
    if not bool(np.any(scene_at(str(spec.scene_path)).scored)):
        raise SpecError(
            Problem("no cell of the scene is to be scored", "Set the layer `scored`.", file=str(spec.scene_path))
        )
    centre = task_of(spec, NO_RUN, spec.region.decode(spec.region.centre())[0])  # the utilities, before any sensor
    combinations = _check_sensors(spec)
    first = carry_out(centre)
    if first.failure:
        raise SpecError(
            Problem(f"the centre of the region cannot be simulated: {first.failure}", file=str(spec.folder))
        )
    return combinations


def _check_sensors(spec: CampaignSpec) -> tuple[str, ...]:
    """Build the sensor at every corner of the region, so that no run fails for a contradiction of its parameters.

    Returns
    -------
    tuple of str
        Each kind of note of the sensors, how often it was met, and one example.

    Raises
    ------
    SpecError
        The settings that cannot be flown, with the numbers.
    """
    scene = scene_at(str(spec.scene_path))
    points = _corners(spec)
    found: dict[str, tuple[Problem, list[str]]] = {}
    met: dict[str, list[str]] = {}
    for settings in spec.region.decode(points):
        shown = ", ".join(f"{f.name} = {setting_text(f, settings[f.name])}" for f in spec.factors)
        try:
            task = task_of(spec, 0, settings)
            engine = ENGINES[task.engine]
            for note in engine.examine(scene, configuration(task), engine.table(task.table)):
                met.setdefault(note.partition(":")[0], []).append(f"{note} (at {shown})")
        except UserError as error:
            for problem in error.problems:
                found.setdefault(str(problem), (problem, []))[1].append(shown)
    if found:
        told = [_sensor_problem(spec, problem, where, len(points)) for problem, where in found.values()]
        raise SpecError(*told[:10])
    return tuple(
        f"{kind} at {len(notes)} of {len(points)} settings, for instance {notes[0].partition(': ')[2]}"
        for kind, notes in met.items()
    )


def _sensor_problem(spec: CampaignSpec, problem: Problem, where: Sequence[str], n_points: int) -> Problem:
    """A sensor's problem with its place in campaign.toml: what is wrong everywhere does not lie with a factor."""
    if problem.file is not None:
        return problem
    if len(where) == n_points and problem.field not in spec.region.names:
        return fixed_problem(spec, problem)
    text = f"{str(problem).rstrip('.')}. This happens at {where[0]}"
    return Problem(text, "Narrow the factor, or add a [[constraint]].", file=str(spec.folder / SPEC_NAME))


def _corners(spec: CampaignSpec) -> FloatArray:
    corners = spec.region.candidates(n_continuous_levels=3, limit=3000)
    return corners[:3000]


def _probe(spec: CampaignSpec, progress: Callable[[int, int], None]) -> tuple[float, int, float, tuple[str, ...]]:
    """Noise, its degrees of freedom, and seconds of a simulated run, from runs that are not kept."""
    from seqrsm.campaign.simulation import simulate_image

    points = [_with_levels(spec, levels) for levels in spec.region.level_combinations()]
    settings = [spec.region.decode(point)[0] for point in points if spec.region.feasible(point)[0]][:8]
    # Ids far beyond any campaign's: their occasions are no run's.
    tasks = [task_of(spec, 2**31 - 1 - i, setting) for i, setting in enumerate(np.repeat(np.array(settings), PROBES))]
    progress(0, len(tasks))
    # Levels rest on assumptions of their own; the first image also compiles the kernels, which is not to be timed.
    levels = [replace(tasks[0], settings=setting) for setting in settings]
    notes = dict.fromkeys(note for task in levels for note in simulate_image(task)[0].notes)
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
    groups = scores.reshape(len(settings), PROBES, -1)
    pooled = np.sqrt(np.mean(np.var(groups, axis=1, ddof=1), axis=0))
    return float(np.max(pooled)), len(settings) * (PROBES - 1), seconds, tuple(notes)


def _with_levels(spec: CampaignSpec, levels: tuple[int, ...]) -> FloatArray:
    point = spec.region.centre()
    point[list(spec.region.categorical)] = levels
    return point


def _noise_of_scores(spec: CampaignSpec) -> tuple[float, int, str]:
    """Residual standard deviation of the scores already there, and its degrees of freedom."""
    from seqrsm.campaign.loop import Campaign
    from seqrsm.errors import FitError

    store = Store.open(spec.folder, url=spec.store_url, campaign=spec.name, seed=spec.seed)
    try:
        analyses: Sequence[Any] = Campaign(spec, store).analyse_all()
    except FitError:
        return float("nan"), 0, "too few scores"
    worst = max(analyses, key=lambda analysis: float(analysis.fit.s))
    return float(worst.fit.s), worst.fit.df_residual, f"residuals of {worst.fit.n_runs} scored runs"
