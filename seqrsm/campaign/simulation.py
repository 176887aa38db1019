"""Where a point of the design becomes a sensor: settings -> image -> scores. Functions of their arguments alone."""

from __future__ import annotations

import math
import os
import pickle
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache, partial
from typing import Any, Final

from seqrsm.analysis.ground import N_WORLDS, OCCASIONS
from seqrsm.campaign.engines import ENGINES, Settings, check_utility, loaded, score_by
from seqrsm.errors import ConfigurationError, SpecError, UserError
from seqrsm.own_code import file_of, located
from seqrsm.scattering.calendar import load_calendar
from seqrsm.scattering.sigma0 import DEFAULT_SEASON
from seqrsm.scattering.worlds import World
from seqrsm.scene.file import load_scene
from seqrsm.scene.layers import cells_in_one, coarse_scene
from seqrsm.scene.scene import Scene
from seqrsm.score.classification import ENDS, UtilityScore
from seqrsm.score.known_map import load_known_map
from seqrsm.score.pixels import Image
from seqrsm.sensor.exchange import Sensor
from seqrsm.sensor.radar import RadarConfiguration
from seqrsm.sensor.sets import NEXT_YEAR, YEAR_DAYS, Member, day_of_year, members_of
from seqrsm.simulate.runner import local_file
from seqrsm.simulate.visits import Visit
from seqrsm.spec.read import SPEC_NAME, CampaignSpec, placed
from seqrsm.store.records import NewScore

_BUNDLE = 2**30  # ids beyond any run's
_FILES: Final = ("scene", "table", "known_map", "calendar")  # of a task and of [simulator]
NO_RUN = 0
"""Run id of pictures that belong to no run; scored runs count from 1."""


@dataclass(frozen=True, slots=True)
class Acquisition:
    """One image of a run."""

    member: str
    """Name of the sensor in its set, "" where it is alone."""
    engine: str
    sensor: Sensor

    visit: Visit
    """Its date."""

    @property
    def label(self) -> str:
        """Member and day in words, "" where there is but one image."""
        day = "" if self.visit.day is None else f"day {day_of_year(self.visit.day):.4g}"
        return ", ".join(part for part in (self.member, day) if part)

    def record(self) -> dict[str, Any]:
        """What is kept with a score."""
        day = None if self.visit.day is None else day_of_year(self.visit.day)
        return {"member": self.member, "engine": self.engine, "day": day}


def acquisitions_of(
    engine: str, settings: Settings, fixed: Settings, members: Mapping[str, Settings]
) -> tuple[Acquisition, ...]:
    """All images of a run, sensor by sensor and date by date; parameters as of `seqrsm.sensor.sets.members_of`.

    ConfigurationError of parameters that contradict each other or physics, of any member; dates of some members only; a
    season besides the dates.
    """
    found = members_of(engine, settings, fixed, members)
    dated = [bool(member.dates.on) for member in found]
    if any(dated) and not all(dated):
        name = found[dated.index(False)].name
        text = f"the sensor {name} of the set has no date, others have"
        raise ConfigurationError(text, "Give first_day to all of them, or to none", field="first_day")
    days = tuple(sorted({day for member in found for day in member.dates.on}))
    if days and days[-1] - days[0] >= YEAR_DAYS:
        text = f"the dates span {days[-1] - days[0]:g} days, more than one year of crops"
        raise ConfigurationError(text, f"Give fewer dates or a shorter interval. {NEXT_YEAR}", field="first_day")
    return _with_angles([one for number, member in enumerate(found) for one in _of_member(number, member, days)])


def _with_angles(made: Sequence[Acquisition]) -> tuple[Acquisition, ...]:
    """With the incidence angles of the radars that look more steeply than each, and its own."""
    own = [math.degrees(getattr(one.sensor, "centre_incidence_rad", math.nan)) for one in made]
    steeper = [sorted({other for other in own if other < mine}) for mine in own]
    return tuple(
        replace(one, visit=replace(one.visit, angles_deg=(*others, mine))) if others else one
        for one, mine, others in zip(made, own, steeper, strict=True)
    )


@lru_cache(maxsize=8)  # simulations of one setting in many worlds share them
def _kept_acquisitions(arguments: bytes) -> tuple[Acquisition, ...]:
    return acquisitions_of(*pickle.loads(arguments))


def _of_member(number: int, member: Member, days: tuple[float, ...]) -> list[Acquisition]:
    try:
        sensor = ENGINES[member.engine].configure(member.settings, member.fixed)
    except ConfigurationError as error:
        if not member.name:
            raise
        own = f"[simulator.fixed] or, for {member.name} alone, [simulator.members.{member.name}]"
        told = (
            replace(
                p,
                message=f"sensor {member.name} of the set: {p.message}",
                remedy=p.remedy.replace("[simulator.fixed]", own),
            )
            for p in error.problems
        )
        raise ConfigurationError(*told) from error
    if not days:
        return [Acquisition(member.name, member.engine, sensor, Visit(member=number))]
    if isinstance(sensor, RadarConfiguration):
        if sensor.season != DEFAULT_SEASON or sensor.snow != "none":
            text = "the season follows from the dates"
            remedy = "Leave season and snow out, or first_day"
            raise ConfigurationError(text, remedy, field="season", value=sensor.season)
        on = dict.fromkeys(member.dates.on, sensor)
    else:
        on = {day: replace(sensor, day_of_year=day_of_year(day)) for day in member.dates.on}
    return [
        Acquisition(member.name, member.engine, own, Visit(days, days.index(day), number)) for day, own in on.items()
    ]


@dataclass(frozen=True)
class SimulationTask:
    """One simulated run, complete in itself, so that any process on any machine can carry it out."""

    engine: str

    run_id: int
    seed: int
    """Key of everything random in the run."""
    settings: Mapping[str, float | str]
    fixed: Mapping[str, float | str]
    """Levels of the factors, and every other sensor parameter."""
    scene: str
    """Path of the data base."""
    table: str
    """Path of the user's table of sigma0 or emissivity, "" for the shipped one alone."""
    utilities: tuple[tuple[str, str], ...]
    """What to score."""
    cells: int = 0
    """Of a coarser data base that are left along a side of a pixel at least; 0: the data base as it is."""
    members: Mapping[str, Mapping[str, float | str]] = field(default_factory=dict)
    """What members of a set of sensors have of their own, by name."""
    world: int | None = None
    """Number of the world (`seqrsm.scattering.worlds`); None: the table's own means."""
    elsewhere: tuple[str, ...] = ()
    """Covers whose own parts are as in another world."""
    known_map: str = ""
    """Path of the confusion table of a map that is there already, "" for none."""
    calendar: str = ""
    late_days: int = 0
    """Path of the user's calendar of crops, "" for the shipped one alone, and days by which that one comes later."""

    @cached_property
    def acquisitions(self) -> tuple[Acquisition, ...]:
        """The images that the run makes; errors of `acquisitions_of`."""
        return _kept_acquisitions(pickle.dumps((self.engine, self.settings, self.fixed, self.members)))

    def scattering(self, engine: str) -> Any:
        """An engine's table of sigma0 or emissivity in the task's world; the user's has rows for the main engine."""
        table = ENGINES[engine].table(self.table, engine == self.engine)
        if self.calendar or self.late_days:
            table = replace(table, calendar=loaded(load_calendar, self.calendar, self.late_days))
        return table if self.world is None else table.in_world(World(self.seed, self.world, self.elsewhere))


@dataclass(frozen=True, slots=True)
class SimulationResult:
    """Scores of a run, or the reason why there are none.

    ``fault``: where a failure lies, `seqrsm.store.schema.FAULTS`.
    """

    scores: tuple[NewScore, ...]
    failure: str
    fault: str = ""


def task_of(spec: CampaignSpec, run_id: int, settings: Mapping[str, float | str], cells: int = 0) -> SimulationTask:
    """Task of one run of a campaign.

    ``cells``: see `SimulationTask`. Every run lies in a world of its own; what is no run meets the table's own means.
    SpecError without a simulator, or of one that cannot score what is asked for.
    """
    if spec.simulator is None or spec.scene_path is None:
        message = "this campaign has no simulator: its scores are measured"
        remedy = (
            "Issue runs with `seqrsm propose DIR --csv FILE`, fly them, fill in the scores, `seqrsm ingest DIR FILE`."
        )
        raise SpecError(message, remedy, file=str(spec.folder / SPEC_NAME))
    utilities = tuple((one.name, located(spec.folder, one.utility)) for one in spec.applications)
    for k, (_, name) in enumerate(utilities):
        try:
            check_utility(name)
        except SpecError as error:
            raise SpecError(*(placed(spec, one, "application", k, "utility") for one in error.problems)) from error
    place = partial(_placed, file=lambda path: str(spec.folder / path), function=partial(located, spec.folder))
    given = {name: getattr(spec.simulator, name) for name in _FILES}
    files: dict[str, Any] = {name: str(spec.folder / path) if path else "" for name, path in given.items()}
    task = SimulationTask(
        engine=spec.simulator.engine,
        run_id=run_id,
        seed=spec.seed,
        settings=dict(settings),
        fixed=place(spec.simulator.fixed),
        utilities=utilities,
        cells=cells,
        members={name: place(own) for name, own in spec.simulator.members.items()},
        late_days=spec.simulator.calendar_shift_days,
        **files,
    )
    return task if run_id == NO_RUN else replace(task, world=run_id)


def bundle_tasks(
    spec: CampaignSpec,
    settings: Mapping[str, float | str],
    cells: int = 0,
    worlds: Iterable[int] = range(N_WORLDS),
    key: Callable[[int], int] = lambda number: _BUNDLE + number,
) -> list[SimulationTask]:
    """Simulations of one setting on `OCCASIONS` occasions in each of some worlds, worlds in order.

    ``key`` makes ids that are no run's of numbers of worlds, and of occasions over all worlds.
    """
    return [
        replace(task_of(spec, key(OCCASIONS * w + k), settings, cells=cells), world=key(w))
        for w in worlds
        for k in range(OCCASIONS)
    ]


def scene_at(path: str) -> Scene:
    """The data base at ``path``, read once per process."""
    found: Scene = loaded(load_scene, path)
    return found


def simulate_images(task: SimulationTask, scene: Scene, threads: int = 1) -> list[Image]:
    """Images of a task over a scene, in the order of its acquisitions."""
    images = []
    for one in task.acquisitions:
        engine = ENGINES[one.engine]
        how: dict[str, Any] = {"seed": task.seed, "run_id": task.run_id, "visit": one.visit}
        how |= {"threads": threads} if engine.threads else {}
        images.append(engine.simulate(scene, one.sensor, task.scattering(one.engine), **how))
    return images


def score_images(task: SimulationTask, utility: str, images: Sequence[Image], scene: Scene) -> UtilityScore:
    """Score of a task's images by a utility; several are scored together."""
    known = None
    if task.known_map:
        ground = task.run_id if task.world is None else task.world
        known = replace(loaded(load_known_map, task.known_map, scene.categories), key=ground)
    return score_by(utility, images, scene, seed=task.seed, run_id=task.run_id, known=known)


def detail_of(task: SimulationTask) -> float:
    """Side of the least that a task's sensors tell apart [m]; 0 where its data base must stay as it is."""
    return min(ENGINES[one.engine].detail_m(one.sensor) for one in task.acquisitions)


def ground_of(task: SimulationTask) -> tuple[Scene, int]:
    """The data base that a task is simulated on, and the cells along a side of the blocks that each of its cells is."""
    scene = scene_at(task.scene)
    detail_m = detail_of(task) if task.cells else 0.0
    coarse = coarse_scene(scene, cells_in_one(scene.cell_m, detail_m, task.cells))
    return coarse, round(coarse.cell_m / scene.cell_m)


def carry_out(task: SimulationTask) -> SimulationResult:
    """Simulate and score; a sensor that cannot work is a failure with its reason, not an exception."""
    start = time.perf_counter()
    task = on_this_machine(task)
    try:
        scene, averaged = ground_of(task)
        made, images = task.acquisitions, simulate_images(task, scene)
        found = [(name, score_images(task, utility, images, scene)) for name, utility in task.utilities]
    except (UserError, MemoryError, OSError) as error:
        reason = str(error) if isinstance(error, UserError) else f"{type(error).__name__}: {error}"
        return SimulationResult((), reason, _fault(error, task))
    seconds = time.perf_counter() - start
    record = {
        **images[0].record(scene.categories),
        **({} if made[0].label == "" else {"images": [one.record() for one in made]}),
        "fidelity": {"averaged": averaged, "seconds": round(seconds, 4)},
    }
    return SimulationResult(tuple(_new_score(*one, record) for one in found), "")


def _fault(error: Exception, task: SimulationTask) -> str:
    """Where a failure lies: with the machine where files are gone, nobody knows where with code of the user's own."""
    try:
        scene_at(task.scene)
        readable = all(os.path.isfile(path) for path in files_of(task))
    except (UserError, OSError):
        readable = False
    if not readable or isinstance(error, MemoryError | OSError):
        return "machine"
    return "unknown" if isinstance(error, SpecError) else "settings"


def files_of(task: SimulationTask) -> frozenset[str]:
    """Paths of the files that a task reads."""
    found = {getattr(task, name) for name in _FILES} | {file_of(utility) for _, utility in task.utilities}

    def see(path: str) -> str:
        found.add(path)
        return path

    for values in (task.fixed, *task.members.values()):
        _placed(values, see, lambda name: see(file_of(name)))
    return frozenset(path for path in found if path)


def _placed(values: Settings, file: Callable[[str], str], function: Callable[[str], str]) -> dict[str, float | str]:
    """Parameters of a sensor, or of a member of a set, with the files and functions that they name as these tell."""
    found = dict(values)
    for name, value in values.items():
        own = name.rpartition(".")[2]
        if value and any(own in engine.files for engine in ENGINES.values()):
            found[name] = file(str(value))
        elif any(own in engine.functions for engine in ENGINES.values()):
            found[name] = function(str(value))
    return found


def on_this_machine(task: SimulationTask) -> SimulationTask:
    """The task with the places where its files lie here; a cluster's worker has copies."""
    place = partial(_placed, file=local_file, function=_local_function)
    members = {name: place(own) for name, own in task.members.items()}
    utilities = tuple((application, _local_function(name)) for application, name in task.utilities)
    files: dict[str, Any] = {name: local_file(getattr(task, name)) for name in _FILES}
    return replace(task, **files, fixed=place(task.fixed), members=members, utilities=utilities)


def _local_function(name: str) -> str:
    file = file_of(name)
    return f"{local_file(file)}:{name.rpartition(':')[2]}" if file else name


def _new_score(application: str, found: UtilityScore, record: Mapping[str, Any]) -> NewScore:
    ends = {name: getattr(found, name) for name in ENDS if math.isfinite(getattr(found, name))}
    metadata = {**record, "n_cells": found.n_cells, "n_tiles": found.n_clusters, **ends, **found.details}
    return NewScore(application, found.value, se=found.se if found.se > 0.0 else None, metadata=metadata)
