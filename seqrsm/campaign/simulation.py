"""Where a point of the design becomes a sensor: settings -> image -> scores. Functions of their arguments alone."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

from seqrsm.campaign.engines import ENGINES, Image, Sensor, modified_ns
from seqrsm.campaign.own_utility import file_of, located
from seqrsm.campaign.records import NewScore
from seqrsm.campaign.spec import CampaignSpec
from seqrsm.errors import Problem, SpecError, UserError
from seqrsm.scene.scene import Scene, load_scene
from seqrsm.simulate.cluster import local_file
from seqrsm.simulate.psm import Precision

NO_RUN = 0
"""Run id of pictures that belong to no run; scored runs count from 1."""


@dataclass(frozen=True, slots=True)
class SimulationTask:
    """One simulated run, complete in itself, so that any process on any machine can carry it out.

    Attributes
    ----------
    engine : "psm" or "prm"
    run_id, seed : int
        Key of everything random in the run.
    settings, fixed : Mapping
        Levels of the factors, and every other sensor parameter.
    scene : str
        Path of the data base.
    table : str
        Path of the user's table of sigma0 or emissivity, "" for the shipped one alone.
    utilities : tuple of (application, utility)
        What to score.
    """

    engine: str
    run_id: int
    seed: int
    settings: Mapping[str, float | str]
    fixed: Mapping[str, float | str]
    scene: str
    table: str
    utilities: tuple[tuple[str, str], ...]


@dataclass(frozen=True, slots=True)
class SimulationResult:
    """Scores of a run, or the reason why there are none; ``seconds`` is what it took.

    ``again``: the failure was the machine's (memory, disk) and not the sensor's; another attempt may do better.
    """

    run_id: int
    scores: tuple[NewScore, ...]
    failure: str
    seconds: float
    again: bool = False


def task_of(spec: CampaignSpec, run_id: int, settings: Mapping[str, float | str]) -> SimulationTask:
    """Task of one run of a campaign.

    Raises
    ------
    SpecError
        The campaign has no simulator, or one that cannot score what is asked for.
    """
    if spec.simulator is None or spec.scene_path is None:
        raise SpecError(
            Problem("this campaign has no simulator", "Ingest measured scores, or add a [simulator] table.")
        )
    utilities = tuple((one.name, located(spec.folder, one.utility)) for one in spec.applications)
    engine = ENGINES[spec.simulator.engine]
    for _, name in utilities:
        engine.check_utility(name)
    fixed = dict(spec.simulator.fixed)
    fixed.update({name: str(spec.folder / str(fixed[name])) for name in engine.files if fixed.get(name)})
    return SimulationTask(
        spec.simulator.engine,
        run_id,
        spec.seed,
        dict(settings),
        fixed,
        str(spec.scene_path),
        str(spec.folder / spec.simulator.table) if spec.simulator.table else "",
        utilities,
    )


@lru_cache(maxsize=4)
def _scene(path: str, modified_ns: int) -> Scene:
    del modified_ns  # part of the key: a rebuilt scene is read again
    return load_scene(Path(path))


def scene_at(path: str) -> Scene:
    """The data base at ``path``, read once per process."""
    return _scene(path, modified_ns(path))


def configuration(task: SimulationTask) -> Sensor:
    """The sensor that a task describes.

    Raises
    ------
    ConfigurationError
        Its parameters contradict each other or physics.
    """
    sensor: Sensor = ENGINES[task.engine].configure(task.settings, task.fixed)
    return sensor


def simulate_image(task: SimulationTask, precision: Precision = "float32", threads: int = 1) -> tuple[Image, Scene]:
    """Image of a task, and the scene it shows."""
    scene = scene_at(task.scene)
    engine = ENGINES[task.engine]
    table = engine.table(task.table)
    more = {"threads": threads} if engine.threads else {}
    image: Image = engine.simulate(scene, configuration(task), table, task.seed, task.run_id, precision, **more)
    return image, scene


def carry_out(task: SimulationTask) -> SimulationResult:
    """Simulate and score; a sensor that cannot work is a failure with its reason, not an exception."""
    start = time.perf_counter()
    task = on_this_machine(task)
    try:
        image, scene = simulate_image(task)
        scores = tuple(_score(task, image, scene, application, name) for application, name in task.utilities)
    except UserError as error:
        return SimulationResult(task.run_id, (), str(error), time.perf_counter() - start)
    except (MemoryError, OSError) as error:
        reason = f"{type(error).__name__}: {error}"
        return SimulationResult(task.run_id, (), reason, time.perf_counter() - start, again=True)
    return SimulationResult(task.run_id, scores, "", time.perf_counter() - start)


def files_of(task: SimulationTask) -> frozenset[str]:
    """Paths of the files that a task reads."""
    own = (str(task.fixed[name]) for name in ENGINES[task.engine].files if task.fixed.get(name))
    code = (file_of(name) for _, name in task.utilities)
    return frozenset(path for path in (task.scene, task.table, *own, *code) if path)


def on_this_machine(task: SimulationTask) -> SimulationTask:
    """The task with the places where its files lie here; a cluster's worker has copies."""
    own = {name: local_file(str(task.fixed[name])) for name in ENGINES[task.engine].files if task.fixed.get(name)}
    utilities = tuple(
        (application, f"{local_file(file)}:{name.rpartition(':')[2]}" if (file := file_of(name)) else name)
        for application, name in task.utilities
    )
    fixed = {**task.fixed, **own}
    return replace(task, scene=local_file(task.scene), table=local_file(task.table), fixed=fixed, utilities=utilities)


def _score(task: SimulationTask, image: Image, scene: Scene, application: str, utility: str) -> NewScore:
    engine = ENGINES[task.engine]
    found = engine.score(utility, image, scene, seed=task.seed, run_id=task.run_id)
    metadata = {
        **engine.record(image, scene),
        "n_cells": found.n_cells,
        "n_tiles": found.n_clusters,
        **found.details,
    }
    return NewScore(application, found.value, se=found.se if found.se > 0.0 else None, metadata=metadata)
