"""Simulated pictures: one written to a file, or the panels of a report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from seqrsm.analysis.compromise import CompromiseEstimate
from seqrsm.analysis.results import Analysis
from seqrsm.arrays import AnyArray, FloatArray
from seqrsm.campaign.engines import ENGINES
from seqrsm.campaign.guards import see_meaning
from seqrsm.campaign.next_runs import rounded_settings
from seqrsm.campaign.simulation import (
    NO_RUN,
    Acquisition,
    SimulationTask,
    scene_at,
    score_images,
    simulate_images,
    task_of,
)
from seqrsm.campaign.status import latest_look
from seqrsm.design.factors import ContinuousFactor, DiscreteFactor, settings_text, with_units
from seqrsm.design.region import ROUNDING, Region
from seqrsm.errors import ConfigurationError, Problem, RegionError, ScatteringDataError, SceneError, UserError
from seqrsm.files import see_writable
from seqrsm.progress import tell
from seqrsm.scene.scene import Scene
from seqrsm.score.classification import UtilityScore
from seqrsm.simulate.pictures import (
    GreyScale,
    Picture,
    grey_scales,
    greytones,
    picture_of,
    write_geotiff,
    write_mask,
    write_npz,
    write_png,
)
from seqrsm.simulate.radar.result import RadarImage
from seqrsm.simulate.radiometer.result import RadiometerImage
from seqrsm.spec.read import CampaignSpec, fixed_problem

if TYPE_CHECKING:
    from seqrsm.campaign.campaign import Campaign

SUFFIXES = (".png", ".tif", ".tiff", ".npz")


def write_image(
    campaign: Campaign, assignments: Sequence[str], out: Path, *, mask: str, threads: int, number: int
) -> dict[str, Any]:
    """Simulate one image and write it: greytone as PNG, decibels as GeoTIFF, everything as npz; or one of its masks.

    ``assignments``, "name=value", are of factors; the others are those of the first application's optimum, or of the
    centre of the region. The suffix of ``out`` tells the form. ``mask``: "shadow" or "layover" of a radar, "blocked" of
    a radiometer, on the scene's grid; "" for the image itself. ``threads`` share one image of a radar, which does not
    depend on their number. ``number``: which image of a set or of several dates is written, from 1; all of them are
    scored.

    UserError of an unknown factor, value, mask or suffix, a sensor that cannot be, or a place that cannot be written.
    """
    if out.suffix.lower() not in SUFFIXES:
        raise UserError("unknown kind of image file", f"Use one of {', '.join(SUFFIXES)}.", file=str(out))
    see_writable(out)
    made = simulated(campaign, assignments, mask=mask, threads=threads, number=number)
    picture, settings = picture_of(made.image), with_units(campaign.spec.factors, made.task.settings)
    share, remarks = None, ""
    if mask:
        layer = np.asarray(picture.arrays[mask], dtype=np.bool_)
        share = float(layer.mean())
        write_mask(out, mask, layer, made.scene, settings)
    else:
        writer = {".png": write_png, ".npz": write_npz}.get(out.suffix.lower(), write_geotiff)
        writer(out, picture, made.scene, settings)
        remarks = "".join(f"; {remark}" for remark in _remarks(picture, out))
    shape = picture.values.shape
    del picture  # of a large scene, much memory that scoring can use
    told = made.told(shape)
    return {
        "file": str(out),
        **told,
        "summary": told["summary"]
        + (f"; {mask} on {100.0 * share:.2f} percent of the scene" if share is not None else remarks),
        **({} if share is None else {"mask": mask, "mask_share": share}),
    }


@dataclass(frozen=True, slots=True, eq=False)
class Simulated:
    """One image of a campaign's sensor, and what it was made of."""

    campaign: Campaign

    task: SimulationTask
    """Its settings among it."""
    scene: Scene

    images: Sequence[RadarImage | RadiometerImage]
    """All that the settings make, in the order of ``task.acquisitions``."""
    number: int
    """Which of them is wanted, from 1."""

    @property
    def image(self) -> RadarImage | RadiometerImage:
        """The one that is wanted."""
        return self.images[self.number - 1]

    def told(self, shape: Sequence[int]) -> dict[str, Any]:
        """Settings, shape, record of the engine, scores and notes, and all of it in a sentence."""
        spec, task, made = self.campaign.spec, self.task, self.task.acquisitions
        scores, found = {}, []
        for name, utility in task.utilities:
            try:
                scores[name] = score_images(task, utility, self.images, self.scene).value
                found.append(f"{name} {scores[name]:.4g} {spec.application(name).score_unit}".rstrip())
            except SceneError as error:  # of this ground; the image is one all the same
                found.append(f"no score for {name}: {error.problems[0].message}")
        shown = settings_text(spec.factors, task.settings)
        if label := made[self.number - 1].label:
            shown += f"; image {self.number} of {len(made)}: {label}"
        return {
            "settings": dict(task.settings),
            "shape": list(shape),
            "record": dict(self.image.record(self.scene.categories)),
            "scores": scores,
            "notes": list(self.image.notes),
            "summary": f"{shown}; {shape[1]} x {shape[2]} pixels; {', '.join(found)}",
        }


def simulated(
    campaign: Campaign, assignments: Sequence[str], *, mask: str = "", threads: int = 1, number: int = 1
) -> Simulated:
    """Simulate what `write_image` writes; arguments and errors are as there."""
    spec = campaign.spec
    task = task_of(spec, NO_RUN, {})  # the simulator before any setting
    task = replace(task, settings=_settings(campaign, assignments))
    try:
        made = task.acquisitions
        if not 1 <= number <= len(made):
            labels = ", ".join(f"{i} {one.label}".rstrip() for i, one in enumerate(made, start=1))
            raise UserError("no such image", f"These settings give {labels}.", field="number", value=number)
        engine = ENGINES[made[number - 1].engine]
        if mask and mask not in engine.masks:
            remedy = f"This engine has {', '.join(engine.masks)}."
            raise UserError("no such mask", remedy, field="mask", value=mask)
        scene = scene_at(task.scene)
        return Simulated(campaign, task, scene, simulate_images(task, scene, threads=threads), number)
    except (ConfigurationError, ScatteringDataError, SceneError) as error:
        of_sensor = {name for one in ENGINES.values() for name in one.parameters} - task.settings.keys()
        problems = (
            fixed_problem(spec, one) if one.file is None and one.field in of_sensor else one for one in error.problems
        )
        raise type(error)(*problems) from error


def _remarks(picture: Picture, out: Path) -> list[str]:
    """What a look at the file would not tell: channels left out, grey tones that are all the same."""
    remarks = []
    names = picture.channels
    if out.suffix.lower() == ".png" and len(names) not in (1, 3):
        shown = f"shown is {names[0]}" if len(names) == 2 else f"shown are {', '.join(names[:3])}"
        remarks.append(f"{shown}, the .tif and the .npz hold {' and '.join((', '.join(names[:-1]), names[-1]))}")
    levels = picture.levels
    for channel, plane in zip(picture.channels, () if levels is None else levels, strict=False):
        if plane.size > 1 and plane.min() == plane.max():
            power = picture.arrays["intensity_w"][picture.channels.index(channel)]
            remarks.append(
                f"every pixel of {channel} has the grey tone {plane.flat[0]}: the calibration does not fit intensities "
                f"of {power.min():.3g} to {power.max():.3g} W"
            )
    return remarks


def _settings(campaign: Campaign, assignments: Sequence[str]) -> dict[str, float | str]:
    spec, region = campaign.spec, campaign.spec.region
    runs = campaign.store.runs()
    see_meaning(campaign.store, spec, runs)
    look = latest_look(spec, spec.applications[0], runs)["last_look"]
    settings = dict(look["optimum"]["settings"]) if look else region.decode(region.centre())[0]
    given: dict[str, str] = {}
    for assignment in assignments:
        name, sign, value = assignment.partition("=")
        if not sign or name not in region.names:
            remedy = f"Write NAME=VALUE with one of {', '.join(region.names)}; other parameters stand in campaign.toml."
            raise UserError("not a valid setting", remedy, value=assignment)
        if name in given:
            raise UserError("this factor is set twice", "Set each once.", field=name, value=value)
        given[name] = value
    settings |= given
    try:
        point = region.code([settings])
    except RegionError as error:
        raise UserError(*(replace(problem, line=None) for problem in error.problems)) from None
    problems = _outside(region, point, settings)
    if problems:
        raise UserError(*problems)
    return rounded_settings(region, point)[0]


def _outside(region: Region, point: FloatArray, settings: Mapping[str, float | str]) -> list[Problem]:
    """Why settings lie outside the region; empty if they do not."""
    if region.feasible(point)[0]:
        return []
    problems = []
    for j in region.numeric:
        factor = region.factors[j]
        if isinstance(factor, DiscreteFactor):
            inside = bool(factor.match(point[0, j])[1])
            allowed = " or ".join(f"{value:g}" for value in factor.values)
        else:
            assert isinstance(factor, ContinuousFactor)
            inside, allowed = abs(point[0, j]) <= 1.0 + ROUNDING, f"{factor.low:g} to {factor.high:g}"
        if not inside:
            remedy = f"Give {allowed} {factor.unit}".rstrip() + "."
            text, value = "outside the campaign's region", settings[factor.name]
            problems.append(Problem(text, remedy, field=factor.name, value=value))
    shown = settings_text(region.factors, region.decode(point)[0])
    for constraint in region.constraints if not problems else ():
        if constraint.slack(region.decode(point)[0])[0] < 0.0:
            text = f"{shown} breaks the constraint {constraint.expr}"
            problems.append(Problem(text, "Set the other factors as well"))
    return problems or [Problem(f"{shown} lies outside the campaign's region", "See campaign.toml")]


@dataclass(frozen=True, slots=True)
class ImagePanel:
    """One simulated image with what is needed to read it."""

    title: str
    """For example "At the optimum"."""
    settings: Mapping[str, float | str]
    """Sensor settings in natural units, by factor name."""
    engine: str
    """That of its sensor."""
    channels: tuple[str, ...]
    """Polarization of each plane of ``greytone``."""
    greytone: AnyArray
    """(channels, across, along): RSL TR 380-1 eq. (3-18); across the track from near to far range, or in the direction
    of the sweep."""
    pixel_m: float
    """Ground size of a pixel [m]."""
    score: float
    score_se: float
    """Utility of this image and its standard error, in score units."""
    caption: str
    """What the image shows and what was drawn at random."""


def report_pictures(
    spec: CampaignSpec, chosen: Mapping[str, Mapping[str, float | str]]
) -> tuple[tuple[ImagePanel, ...], int, tuple[str, ...]]:
    """Simulate the pictures of a report at settings of `chosen_settings`, all on one occasion, in one calibration.

    Of several images the first of each sensor. Beside the panels the quarter turns that bring the scene's layers into
    the frame of the first image, and what the simulations assumed.
    """
    made: list[tuple[str, Mapping[str, float | str], Acquisition, Picture, UtilityScore]] = []
    notes: dict[str, list[str]] = {}
    cell_m = 0.0
    for title, settings in chosen.items():
        tell("simulating images", len(notes), len(chosen))
        task = task_of(spec, NO_RUN, settings)
        scene, taken = scene_at(task.scene), task.acquisitions
        images = simulate_images(task, scene)
        score = score_images(task, task.utilities[0][1], images, scene)
        notes[title] = [note for one in images for note in one.notes]
        for k, (one, image) in enumerate(zip(taken, images, strict=True)):
            which = f" (image {k + 1} of {len(taken)}, {one.label})" if len(taken) > 1 else ""
            if one.member not in [other.member for other in taken[:k]]:
                made.append((f"{title}{which}", settings, one, picture_of(image), score))
        cell_m = scene.cell_m
    scales = grey_scales(picture for *_, picture, _ in made)
    panels = []
    for title, settings, one, picture, score in made:
        # Footprints of a sweep are longer to the sides, and lines lie apart by the flight: no pixel is square.
        swept, grey = one.engine == "prm", greytones(picture, scales)
        panels.append(
            ImagePanel(
                title=title,
                settings=dict(settings),
                engine=one.engine,
                channels=picture.channels,
                greytone=_on_ground(grey, picture) if swept else grey,
                pixel_m=cell_m if swept else picture.pixel_m,
                score=score.value,
                score_se=score.se,
                caption=_caption(picture, scales),
            )
        )
    turns = made[0][3].quarter_turns if made else 0
    return tuple(panels), turns, _notes(notes, scene.categories if made else ())


def _notes(of_images: Mapping[str, Sequence[str]], covers: Sequence[str]) -> tuple[str, ...]:
    """What the simulations assumed; where it is no cover's, and not of every image, with the image before it."""
    about = tuple(f"{cover}{end}" for cover in covers for end in (" ", ":"))
    shared = [note for own in of_images.values() for note in own if all(note in one for one in of_images.values())]
    others = [
        note if note.startswith(about) else f"{title}: {note}"
        for title, own in of_images.items()
        for note in own
        if note not in shared
    ]
    return tuple(dict.fromkeys([*shared, *others]))


def _on_ground(grey: AnyArray, picture: Picture) -> AnyArray:
    """Grey tones (channels, pixels ...) on the cells of the scene, in the frame of the ground truth; 255 for none."""
    place = np.rot90(picture.pixel_of_cell, picture.quarter_turns)
    flat = grey.reshape(len(grey), -1)
    return np.where(place >= 0, flat[:, np.maximum(place, 0)], np.uint8(255))


def _caption(picture: Picture, scales: Mapping[str, GreyScale]) -> str:
    tones = ", ".join(f"{channel} {scales[channel]}" for channel in picture.channels if channel in scales)
    return f"{picture.remark}; {picture.quantity}, black to white, {tones}."


def chosen_settings(
    analyses: Sequence[Analysis], compromise: CompromiseEstimate | None
) -> dict[str, dict[str, float | str]]:
    """Settings worth a picture: what is recommended, and the fitted worst of the region for the first application."""
    from seqrsm.fit.optimum import optimum

    analysis = analyses[0]
    worst = optimum(
        analysis.model,
        analysis.region,
        analysis.fit.estimate[: analysis.model.p],
        "minimize" if analysis.goal == "maximize" else "maximize",
    )
    title, best = ("At the compromise", compromise) if compromise else ("At the optimum", analysis.optimum)
    return {title: dict(best.settings), "Worst of the region": analysis.region.decode(worst.point)[0]}
