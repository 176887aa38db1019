"""Where a point of the design becomes a sensor: settings -> image -> scores. Functions of their arguments alone."""

from __future__ import annotations

import math
import os
import pickle
import re
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache, partial
from typing import Any, Final

import numpy as np

from seqrsm.analysis.ground import N_WORLDS, OCCASIONS
from seqrsm.campaign.engines import ENGINES, NOT_TO_BE_USED, Settings, check_utility, loaded, score_by
from seqrsm.design.factors import settings_text
from seqrsm.errors import ConfigurationError, Problem, SpecError, UserError
from seqrsm.own_code import file_of, located
from seqrsm.scattering.calendar import load_calendar
from seqrsm.scattering.readers import COVER
from seqrsm.scattering.sigma0 import DEFAULT_SEASON
from seqrsm.scattering.worlds import World
from seqrsm.scene.file import load_scene
from seqrsm.scene.layers import categories_of_fields, cells_in_one, coarse_scene
from seqrsm.scene.scene import Scene
from seqrsm.score.classification import ENDS, UtilityScore
from seqrsm.score.known_map import load_known_map
from seqrsm.score.moisture import refuse_combination
from seqrsm.score.pixels import Image, large_fields, tile_m
from seqrsm.score.utilities import utility_of
from seqrsm.sensor.exchange import Sensor
from seqrsm.sensor.radar import RadarConfiguration
from seqrsm.sensor.sets import NEXT_YEAR, YEAR_DAYS, Member, day_of_year, members_of
from seqrsm.simulate.runner import local_file
from seqrsm.simulate.visits import Visit
from seqrsm.spec.read import SPEC_NAME, CampaignSpec, fixed_problem, placed
from seqrsm.store.records import NewScore

_NUMBERS = re.compile(r"\d[\d.]*(e[+-]?\d+)?")
_BUNDLE = 2**30  # ids beyond any run's
_FILES: Final = ("scene", "table", "known_map", "calendar")  # of a task and of [simulator]
_MOST_DIVIDED: Final = 0.5  # of the scored ground in fields that training and test divide
NO_RUN = 0
"""Run id of pictures that belong to no run; scored runs count from 1."""


@dataclass(frozen=True, slots=True)
class Acquisition:
    """One image of a run.

    Attributes
    ----------
    member : str
        Name of the sensor in its set, "" where it is alone.
    engine : str
    sensor : RadarConfiguration or RadiometerConfiguration
    visit : Visit
        Its date.
    """

    member: str
    engine: str
    sensor: Sensor
    visit: Visit

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

    Raises
    ------
    ConfigurationError
        Parameters that contradict each other or physics, of any member; dates of some members only; a season besides
        the dates.
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
        told = (replace(p, message=f"sensor {member.name} of the set: {p.message}") for p in error.problems)
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
    cells : int
        Of a coarser data base that are left along a side of a pixel at least; 0: the data base as it is.
    members : Mapping
        What members of a set of sensors have of their own, by name.
    world : int or None
        Number of the world (`seqrsm.scattering.worlds`); None: the table's own means.
    elsewhere : tuple of str
        Covers whose own parts are as in another world.
    known_map : str
        Path of the confusion table of a map that is there already, "" for none.
    calendar, late_days : str, int
        Path of the user's calendar of crops, "" for the shipped one alone, and days by which that one comes later.
    """

    engine: str
    run_id: int
    seed: int
    settings: Mapping[str, float | str]
    fixed: Mapping[str, float | str]
    scene: str
    table: str
    utilities: tuple[tuple[str, str], ...]
    cells: int = 0
    members: Mapping[str, Mapping[str, float | str]] = field(default_factory=dict)
    world: int | None = None
    elsewhere: tuple[str, ...] = ()
    known_map: str = ""
    calendar: str = ""
    late_days: int = 0

    @cached_property
    def acquisitions(self) -> tuple[Acquisition, ...]:
        """The images that the run makes.

        Raises
        ------
        ConfigurationError
            Parameters of a sensor contradict each other or physics.
        """
        return _kept_acquisitions(pickle.dumps((self.engine, self.settings, self.fixed, self.members)))

    def scattering(self, engine: str) -> Any:
        """An engine's table of sigma0 or emissivity in the task's world; the user's own is for the main engine."""
        table = ENGINES[engine].table(self.table if engine == self.engine else "")
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

    Raises
    ------
    SpecError
        The campaign has no simulator, or one that cannot score what is asked for.
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
        more = {"threads": threads} if engine.threads else {}
        table = task.scattering(one.engine)
        images.append(
            engine.simulate(scene, one.sensor, table, seed=task.seed, run_id=task.run_id, visit=one.visit, **more)
        )
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


def see_parameters(spec: CampaignSpec) -> None:
    """Refuse parameters of which no sensor can be built at the centre of the region, before any run is issued or made.

    One may be missing since its factor was left out.

    Raises
    ------
    SpecError
    """
    try:
        _ = task_of(spec, NO_RUN, spec.region.decode(spec.region.centre())[0]).acquisitions
    except ConfigurationError as error:
        raise SpecError(
            *(p if p.field in spec.region.names else fixed_problem(spec, p) for p in error.problems)
        ) from error


def check_simulator(spec: CampaignSpec) -> tuple[str, ...]:
    """Scene, sensor at the corners of the region, scattering data, and one image at its centre, before any run.

    Returns what combinations of the parameters do, such as gaps between lines, and where.

    Raises
    ------
    UserError
        What is wrong with them.
    """
    centre = task_of(spec, NO_RUN, spec.region.decode(spec.region.centre())[0])  # the utilities, before any sensor
    assert spec.simulator is not None
    scene = scene_at(str(spec.scene_path))
    if not bool(np.any(scene.scored)):
        raise SpecError("no cell of the scene is scored", "Set the layer `scored`.", file=str(spec.scene_path))
    classifies = any(utility_of(one.utility).classifies for one in spec.applications)
    if spec.simulator.known_map and not classifies:
        text = "no utility of this campaign classifies covers, so a map has no effect"
        remedy = "Remove known_map, or add an [[application]] that classifies."
        problem = Problem(text, remedy, field="[simulator] known_map")
        raise SpecError(placed(spec, problem, "simulator", "known_map"))
    fields = _notes_on_fields(spec, scene) if classifies else ()
    if centre.known_map:
        loaded(load_known_map, centre.known_map, scene.categories)
    combinations = _check_sensors(spec)
    first = carry_out(centre)
    if first.failure:
        raise SpecError(f"the centre of the region cannot be simulated: {first.failure}", file=str(spec.folder))
    return (*combinations, *fields, *_idle_rows(spec, scene, centre))


def _idle_rows(spec: CampaignSpec, scene: Scene, task: SimulationTask) -> tuple[str, ...]:
    """What of the user's table and calendar has no effect: covers that the scene has not, perhaps by a slip."""
    assert spec.simulator is not None
    shipped = ENGINES[spec.simulator.engine].table("").curves
    table = task.scattering(spec.simulator.engine)
    own = (k if isinstance(k, str) else k[0] for k, curve in table.curves.items() if curve is not shipped.get(k))
    notes = []
    for file, names in ((spec.simulator.table, own), (spec.simulator.calendar, table.calendar.own)):
        if idle := [name for name in dict.fromkeys(names) if name not in scene.categories]:
            has = ", ".join(scene.categories)
            notes.append(f"rows of {file} for {', '.join(idle)} have no effect: the scene has {has}")
    if (task.calendar or task.late_days) and task.acquisitions[0].visit.day is None:
        notes.append("the calendar has no effect, as there are no dates: give first_day")
    return tuple(notes)


def _notes_on_fields(spec: CampaignSpec, scene: Scene) -> tuple[str, ...]:
    """What is to be said of covers of one field, and of large fields; refuses a scene with nothing to tell apart."""
    cells = np.bincount(scene.field_id[scene.scored], minlength=scene.n_fields)
    fields = np.flatnonzero(cells)
    cover_of, area_m2 = categories_of_fields(scene)[fields], cells[fields] * scene.cell_m**2
    covers, n_fields = np.unique(cover_of, return_counts=True)
    if len(covers) == 1:
        text = f"all scored ground is {scene.categories[covers[0]]}: there is nothing to tell apart"
        remedy = "Use a scene with at least two covers, or a utility that needs one, such as soil_moisture_error."
        raise SpecError(text, remedy, file=str(spec.scene_path))
    assert spec.simulator is not None
    divided = large_fields(scene, tile_m(scene, radar=spec.simulator.engine == "psm"))[fields] < 0
    share = float(area_m2[divided].sum() / area_m2.sum())
    notes = [
        f"{scene.categories[k]} is one field of {area_m2[own][0] / 1e4:.3g} ha, not taught where it is tested: "
        "it is wrong at every setting. Give its code another cover, or none, in the legend"
        for k, own in ((k, cover_of == k) for k in covers[n_fields == 1])
        if not divided[own].any()
    ]
    if share > _MOST_DIVIDED:
        notes.append(
            f"{100.0 * share:.0f} % of the scored ground lies in fields that are most of their cover's, parts of which "
            "teach what the others are: scores are too high. Import the scene with --parcels FILE or --field-m"
        )
    return tuple(notes)


def _check_sensors(spec: CampaignSpec) -> tuple[str, ...]:
    """Build the sensor at every corner of the region, so that no run fails for a contradiction of its parameters.

    Returns each kind of note of the sensors, how often it was met, and one example.

    Raises
    ------
    SpecError
        The settings that cannot be flown, with the numbers.
    """
    scene = scene_at(str(spec.scene_path))
    points = spec.region.candidates(n_continuous_levels=3, limit=3000)[:3000]
    of_one_kind = any(utility_of(one.utility).of_one_kind for one in spec.applications)
    found: dict[str, list[tuple[Problem, str]]] = {}  # by what is wrong, whatever its numbers
    met: dict[str, list[str]] = {}
    for settings in spec.region.decode(points):
        shown = settings_text(spec.factors, settings)
        try:
            task = task_of(spec, 0, settings)
            made = task.acquisitions
            for day in {one.visit.day for one in made} if of_one_kind else ():
                refuse_combination([one.sensor for one in made if one.visit.day == day])
            # One of each kind, of which several sensors of a set may have their own.
            for kind, note in {note.partition(":")[0]: note for note in sensor_notes(task, scene)}.items():
                met.setdefault(kind, []).append(f"{note} (at {shown})")
        except UserError as error:
            for problem in error.problems:
                # A cover goes by its name, numbers and all.
                told = str(problem) if problem.field == COVER else _NUMBERS.sub("0", str(problem))
                found.setdefault(told, []).append((problem, shown))
    if found:
        raise SpecError(*[_sensor_problem(spec, met, len(points)) for met in found.values()][:10])
    return tuple(
        f"{kind} at {len(notes)} of {len(points)} settings, for instance {notes[0].partition(': ')[2]}"
        for kind, notes in met.items()
    )


def sensor_notes(task: SimulationTask, scene: Scene) -> list[str]:
    """What the parameters of a task's sensors do, each once; refuses what cannot be simulated."""
    made = task.acquisitions
    notes: list[str] = []
    for one in made:
        if one.visit.day == next(other.visit.day for other in made if other.member == one.member):
            notes += ENGINES[one.engine].examine(scene, one.sensor, task.scattering(one.engine), one.visit.day)
    return notes


def not_to_be_used(spec: CampaignSpec, settings: Settings) -> tuple[str, ...]:
    """Warnings where a sensor of these settings cannot be built, sees nothing, or needs a large antenna.

    None where it cannot be simulated as things stand: results do not need it.
    """
    try:
        notes = sensor_notes(task_of(spec, NO_RUN, settings), scene_at(str(spec.scene_path)))
    except (UserError, OSError):
        return ()
    return tuple(f"At these settings {note}." for note in notes if note.startswith(NOT_TO_BE_USED))


def _sensor_problem(spec: CampaignSpec, met: Sequence[tuple[Problem, str]], n_points: int) -> Problem:
    """A sensor's problem with its place in campaign.toml: what is wrong everywhere does not lie with a factor."""
    problem, shown = met[0]
    if problem.file is not None:
        return problem
    alike = all(str(other) == str(problem) for other, _ in met)
    fixed = len(met) == n_points and problem.field not in spec.region.names
    if alike and fixed:
        return fixed_problem(spec, problem)
    if isinstance(problem.value, float):
        problem = replace(problem, value=float(f"{problem.value:.10g}"))  # a setting, once more in its own unit
    where = f"{len(met)} of {n_points} settings, for instance at {shown}"
    text = f"{str(problem).rstrip('.')}. This happens at {where}"
    remedy = "Change it or all ranges." if fixed else "Narrow the factor's range, or add a [[constraint]]."
    if problem.message.endswith("missing"):  # of one sensor of a set; no range gives it
        remedy = ""
    name, names = str(problem.field), spec.region.names
    return placed(
        spec, Problem(text, remedy), *(("factor", names.index(name)) if name in names else ("simulator", "fixed", name))
    )
