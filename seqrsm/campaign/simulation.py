"""Where a point of the design becomes a sensor: settings -> image -> scores. Functions of their arguments alone."""

from __future__ import annotations

import importlib
import time
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Protocol

from seqrsm.campaign.records import NewScore
from seqrsm.campaign.spec import CampaignSpec
from seqrsm.errors import ConfigurationError, Problem, SpecError, UserError
from seqrsm.scattering.sigma0 import Sigma0Table, load_sigma0_table
from seqrsm.scene.scene import Scene, load_scene
from seqrsm.score.classification import UtilityScore, percent_correct
from seqrsm.sensor.radar import RadarConfiguration, from_settings
from seqrsm.simulate.psm import RadarImage, simulate_radar

NO_RUN = 0
"""Run id of pictures that belong to no run; scored runs count from 1."""


class Utility(Protocol):
    """A utility measure of a simulated image, keyed by campaign seed and run."""

    def __call__(self, image: RadarImage, scene: Scene, *, seed: int, run_id: int) -> UtilityScore:
        """Score the image."""


@dataclass(frozen=True, slots=True)
class SimulationTask:
    """One simulated run, complete in itself, so that any process on any machine can carry it out.

    Attributes
    ----------
    run_id, seed : int
        Key of everything random in the run.
    settings, fixed : Mapping
        Levels of the factors, and every other sensor parameter.
    scene : str
        Path of the data base.
    utilities : tuple of (application, utility)
        What to score.
    """

    run_id: int
    seed: int
    settings: Mapping[str, float | str]
    fixed: Mapping[str, float | str]
    scene: str
    utilities: tuple[tuple[str, str], ...]


@dataclass(frozen=True, slots=True)
class SimulationResult:
    """Scores of a run, or the reason why there are none; ``seconds`` is what it took."""

    run_id: int
    scores: tuple[NewScore, ...]
    failure: str
    seconds: float


def task_of(spec: CampaignSpec, run_id: int, settings: Mapping[str, float | str]) -> SimulationTask:
    """Task of one run of a campaign.

    Raises
    ------
    SpecError
        The campaign has no simulator that this version can run.
    """
    if spec.simulator is None or spec.scene_path is None:
        raise SpecError(
            Problem("this campaign has no simulator", "Ingest measured scores, or add a [simulator] table.")
        )
    if spec.simulator.engine != "psm":
        raise SpecError(
            Problem(
                "this version simulates imaging radars only",
                'Use engine = "psm", or ingest measured radiometer scores.',
                field="[simulator] engine",
                value=spec.simulator.engine,
            )
        )
    utilities = tuple((application.name, application.utility) for application in spec.applications)
    for _, name in utilities:
        utility_function(name)
    return SimulationTask(run_id, spec.seed, dict(settings), spec.simulator.fixed, str(spec.scene_path), utilities)


def utility_function(name: str) -> Utility:
    """The utility measure called ``name``: "percent_correct" or "package.module:function".

    Raises
    ------
    SpecError
        It needs measured scores, or cannot be imported.
    """
    if name == "percent_correct":
        return percent_correct
    if ":" not in name:
        raise SpecError(
            Problem(
                "this utility cannot be simulated",
                'Use "percent_correct" or "package.module:function", or ingest measured scores.',
                field="utility",
                value=name,
            )
        )
    module, function = name.split(":")
    try:
        found: Utility = getattr(importlib.import_module(module), function)
    except (ImportError, AttributeError) as error:
        raise SpecError(
            Problem(f"the utility cannot be imported: {error}", "Install its package.", field="utility", value=name)
        ) from error
    return found


@lru_cache(maxsize=4)
def _scene(path: str, modified_ns: int) -> Scene:
    del modified_ns  # part of the key: a rebuilt scene is read again
    return load_scene(Path(path))


def scene_at(path: str) -> Scene:
    """The data base at ``path``, read once per process."""
    return _scene(path, Path(path).stat().st_mtime_ns if Path(path).exists() else 0)


@lru_cache(maxsize=1)
def scattering_table() -> Sigma0Table:
    """The shipped sigma0 table, read once per process."""
    return load_sigma0_table()


def configuration(task: SimulationTask) -> RadarConfiguration:
    """The radar that a task describes.

    Raises
    ------
    ConfigurationError
        Its parameters contradict each other or physics.
    """
    return from_settings(task.settings, task.fixed)


def simulate_image(task: SimulationTask) -> tuple[RadarImage, Scene]:
    """Image of a task, and the scene it shows."""
    scene = scene_at(task.scene)
    image = simulate_radar(scene, configuration(task), scattering_table(), seed=task.seed, run_id=task.run_id)
    return image, scene


def carry_out(task: SimulationTask) -> SimulationResult:
    """Simulate and score; a sensor that cannot work is a failure with its reason, not an exception."""
    start = time.perf_counter()
    try:
        image, scene = simulate_image(task)
        scores = tuple(_score(task, image, scene, application, name) for application, name in task.utilities)
    except (ConfigurationError, UserError) as error:
        return SimulationResult(task.run_id, (), str(error), time.perf_counter() - start)
    return SimulationResult(task.run_id, scores, "", time.perf_counter() - start)


def _score(task: SimulationTask, image: RadarImage, scene: Scene, application: str, utility: str) -> NewScore:
    found = utility_function(utility)(image, scene, seed=task.seed, run_id=task.run_id)
    metadata: dict[str, Any] = {
        "engine": "psm",
        "looks": [float(image.looks.min()), float(image.looks.max())],
        "noise_equivalent_sigma0_db": _decibel_range(image),
        "occasion": dict(image.occasion.record(image.radar.channels, scene.categories)),
        "n_cells": found.n_cells,
        "n_tiles": found.n_clusters,
        **found.details,
    }
    return NewScore(application, found.value, se=found.se if found.se > 0.0 else None, metadata=metadata)


def _decibel_range(image: RadarImage) -> list[float]:
    from seqrsm.units import linear_to_db

    levels = linear_to_db(image.noise_equivalent_sigma0)
    return [round(float(levels.min()), 2), round(float(levels.max()), 2)]
