"""What is wrong with a campaign's simulator, before any run is issued or made: scene, sensors, data, and one image."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from seqrsm.campaign.engines import ENGINES, NOT_TO_BE_USED, Settings, loaded
from seqrsm.campaign.simulation import NO_RUN, SimulationTask, carry_out, scene_at, task_of
from seqrsm.design.factors import settings_text
from seqrsm.errors import ConfigurationError, Problem, SpecError, UserError
from seqrsm.scattering.readers import COVER
from seqrsm.scene.layers import categories_of_fields
from seqrsm.scene.scene import Scene
from seqrsm.score.brightness import BLOCK_M
from seqrsm.score.known_map import load_known_map
from seqrsm.score.moisture import refuse_alike, refuse_combination
from seqrsm.score.pixels import large_fields, tile_m
from seqrsm.score.utilities import utility_of
from seqrsm.spec.read import CampaignSpec, fixed_problem, placed

_NUMBERS = re.compile(r"\d[\d.]*(e[+-]?\d+)?")
_OTHER_GROUND: Final = (
    f"moisture is that of squares of {BLOCK_M:g} m with a radiometer, of bare fields with radars: errors of the two do "
    "not compare; soil_moisture_skill holds each against its own guess"
)
_MOST_DIVIDED: Final = 0.5  # of the scored ground in fields that training and test divide


def see_parameters(spec: CampaignSpec) -> None:
    """Refuse parameters of which no sensor can be built at the centre of the region, before any run is issued or made.

    One may be missing since its factor was left out.
    """
    try:
        _ = task_of(spec, NO_RUN, spec.region.decode(spec.region.centre())[0]).acquisitions
    except ConfigurationError as error:
        told = (p if p.field in spec.region.names else fixed_problem(spec, p) for p in error.problems)
        raise SpecError(*told) from error


def check_simulator(spec: CampaignSpec) -> tuple[str, ...]:
    """Scene, sensor at the corners of the region, scattering data, and one image at its centre, before any run.

    Returns what combinations of the parameters do, such as gaps between lines, and where; UserError tells what is
    wrong.
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
    own: list[str] = []
    for name, engine in ENGINES.items() if spec.simulator.table else ():
        curves, shipped = task.scattering(name).curves, engine.table("").curves
        own += [k if isinstance(k, str) else k[0] for k, one in curves.items() if one is not shipped.get(k)]
    notes = []
    calendar = task.scattering(spec.simulator.engine).calendar
    for file, names in ((spec.simulator.table, own), (spec.simulator.calendar, calendar.own)):
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

    Returns each kind of note of the sensors, how often it was met, and one example; SpecError tells the settings that
    cannot be flown, with the numbers.
    """
    scene = scene_at(str(spec.scene_path))
    points = spec.region.candidates(n_continuous_levels=3, limit=3000)[:3000]
    of_one_kind = any(utility_of(one.utility).of_one_kind for one in spec.applications)
    found: dict[str, list[tuple[Problem, str]]] = {}  # by what is wrong, whatever its numbers
    met: dict[str, list[str]] = {}
    engines = set()
    for settings in spec.region.decode(points):
        shown = settings_text(spec.factors, settings)
        try:
            task = task_of(spec, 0, settings)
            made = task.acquisitions
            for day in {one.visit.day for one in made} if of_one_kind else ():
                refuse_combination([one.sensor for one in made if one.visit.day == day])
            if of_one_kind:
                refuse_alike([one.sensor for one in made], scene)
                engines |= {one.engine for one in made}
            # One of each kind, of which several sensors of a set may have their own.
            for kind, note in {note.partition(":")[0]: note for _, note in _sensor_notes(task, scene)}.items():
                met.setdefault(kind, []).append(f"{note} (at {shown})")
        except UserError as error:
            for problem in error.problems:
                # A cover goes by its name, numbers and all.
                told = str(problem) if problem.field == COVER else _NUMBERS.sub("0", str(problem))
                found.setdefault(told, []).append((problem, shown))
    if found:
        raise SpecError(*[_sensor_problem(spec, met, len(points)) for met in found.values()][:10])
    by_error = any(one.utility == "soil_moisture_error" for one in spec.applications)
    other = (_OTHER_GROUND,) if by_error and len(engines) > 1 else ()
    return other + tuple(
        f"{kind} at {len(notes)} of {len(points)} settings, for instance {notes[0].partition(': ')[2]}"
        for kind, notes in met.items()
    )


def _sensor_notes(task: SimulationTask, scene: Scene) -> list[tuple[str, str]]:
    """Name of each sensor of a task, "" where it is alone, with what its parameters do; refuses what cannot be made."""
    made = task.acquisitions
    notes = []
    for one in made:
        if one.visit.day == next(other.visit.day for other in made if other.member == one.member):
            told = ENGINES[one.engine].examine(scene, one.sensor, task.scattering(one.engine), one.visit.day)
            notes += [(one.member, note) for note in told]
    return notes


def not_to_be_used(spec: CampaignSpec, settings: Settings) -> tuple[str, ...]:
    """Warnings where a sensor of these settings cannot be built, sees nothing, or needs a large antenna.

    UserError or OSError where they cannot be simulated as things stand.
    """
    notes = _sensor_notes(task_of(spec, NO_RUN, settings), scene_at(str(spec.scene_path)))
    return tuple(
        f"Sensor {member} at these settings: {note}." if member else f"At these settings {note}."
        for member, note in notes
        if note.startswith(NOT_TO_BE_USED)
    )


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
    place = ("factor", names.index(name)) if name in names else ("simulator", "fixed", name)
    return placed(spec, Problem(text, remedy), *place)
