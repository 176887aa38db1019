"""Simulated pictures: one written to a file, or the panels of a report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from seqrsm.campaign.dossier import ImagePanel, TruthPanel
from seqrsm.campaign.image_files import image_greytones
from seqrsm.campaign.simulation import NO_RUN, scene_at, simulate_image, task_of, utility_function
from seqrsm.campaign.next_runs import rounded_settings
from seqrsm.campaign.spec import CampaignSpec
from seqrsm.errors import FitError, Problem, UserError
from seqrsm.simulate.psm import RadarImage
from seqrsm.units import linear_to_db

if TYPE_CHECKING:
    from seqrsm.campaign.loop import Campaign

SUFFIXES = (".png", ".tif", ".tiff", ".npz")


def write_image(campaign: Campaign, assignments: Sequence[str], run_id: int, out: Path) -> dict[str, Any]:
    """Simulate one image and write it: greytone as PNG, decibels as GeoTIFF, everything as npz.

    Parameters
    ----------
    campaign : Campaign
    assignments : sequence of str
        "name=value" for factors; the others are those of the last optimum, or of the centre of the region.
    run_id : int
        Whose occasion to draw; 0 belongs to no run.
    out : Path
        File to write; its suffix tells the form.

    Raises
    ------
    UserError
        Unknown factor, value or suffix, or a sensor that cannot be.
    """
    if out.suffix.lower() not in SUFFIXES:
        raise UserError(Problem("unknown kind of image file", f"Use one of {', '.join(SUFFIXES)}.", file=str(out)))
    spec = campaign.spec
    settings = _settings(campaign, assignments)
    task = task_of(spec, run_id, settings)
    image, scene = simulate_image(task)
    from seqrsm.campaign import image_files

    writer = {".png": image_files.write_png, ".npz": image_files.write_npz}.get(
        out.suffix.lower(), image_files.write_geotiff
    )
    writer(out, image, scene, settings)
    scores = {
        name: utility_function(utility)(image, scene, seed=task.seed, run_id=run_id).value
        for name, utility in task.utilities
    }
    shown = ", ".join(
        f"{name} = {value:.4g}" if isinstance(value, float) else f"{name} = {value}" for name, value in settings.items()
    )
    found = ", ".join(f"{name} {value:.2f}" for name, value in scores.items())
    return {
        "file": str(out),
        "settings": settings,
        "shape": list(image.intensity.shape),
        "looks": [float(image.looks.min()), float(image.looks.max())],
        "noise_equivalent_sigma0_db": [float(x) for x in np.sort(linear_to_db(image.noise_equivalent_sigma0))[[0, -1]]],
        "scores": scores,
        "notes": list(image.notes),
        "summary": f"{shown}; {image.intensity.shape[1]} x {image.intensity.shape[2]} pixels; {found}",
    }


def _settings(campaign: Campaign, assignments: Sequence[str]) -> dict[str, float | str]:
    region = campaign.spec.region
    looks = campaign.store.looks()
    settings = dict(looks[-1].summary["optimum"]["settings"]) if looks else region.decode(region.centre())[0]
    for assignment in assignments:
        name, sign, value = assignment.partition("=")
        if not sign or name not in region.names:
            raise UserError(
                Problem(
                    "not a setting",
                    f"Write NAME=VALUE with one of {', '.join(region.names)}.",
                    field="--set",
                    value=assignment,
                )
            )
        settings[name] = value
    point = region.code([settings])
    if not region.feasible(point)[0]:
        raise UserError(
            Problem("the settings lie outside the region", "See campaign.toml.", field="--set", value=list(assignments))
        )
    return rounded_settings(region, point)[0]


def report_panels(campaign: Campaign, chosen: Mapping[str, Mapping[str, float | str]]) -> tuple[ImagePanel, ...]:
    """Simulated images at the settings ``chosen`` (title to settings), all on the same occasion."""
    spec = campaign.spec
    panels = []
    for title, settings in chosen.items():
        task = task_of(spec, NO_RUN, settings)
        image, scene = simulate_image(task)
        name, utility = task.utilities[0]
        score = utility_function(utility)(image, scene, seed=spec.seed, run_id=NO_RUN)
        panels.append(
            ImagePanel(
                title=title,
                settings=dict(settings),
                channels=image.radar.channels,
                greytone=image_greytones(image),
                pixel_m=image.azimuth_spacing_m,
                score=score.value,
                score_se=score.se,
                caption=_caption(image, name, score.value, score.se, spec.applications[0].unit),
            )
        )
    return tuple(panels)


def _caption(image: RadarImage, application: str, score: float, se: float, unit: str) -> str:
    looks = f"{image.looks.min():.3g} to {image.looks.max():.3g} looks"
    return (
        f"{application}: {score:.1f} ± {se:.1f} {unit} on this one occasion (standard error within the image); "
        f"{looks}; near range at the top; fading, fields and date drawn at random."
    )


def truth_panel(spec: CampaignSpec, quarter_turns: int) -> TruthPanel | None:
    """Ground truth of the campaign's scene in the frame of the images."""
    if spec.scene_path is None:
        return None
    scene = scene_at(str(spec.scene_path))
    return TruthPanel(
        cover=np.rot90(scene.cover, quarter_turns),
        categories=scene.categories,
        cell_m=scene.cell_m,
        name=scene.name,
        licence=scene.licence,
        provenance=scene.provenance,
    )


def chosen_settings(campaign: Campaign) -> dict[str, dict[str, float | str]]:
    """Settings worth a picture: the optimum, the best run, and the fitted worst of the region."""
    from seqrsm.fit.optimum import optimum

    try:
        analysis = campaign.analyse_all(campaign.spec.applications[0].name)[0]
    except FitError:
        return {}
    beta = analysis.fit.estimate[: analysis.model.p]
    opposite = "minimize" if analysis.goal == "maximize" else "maximize"
    worst = optimum(analysis.model, analysis.region, beta, "minimize" if opposite == "minimize" else "maximize")
    pick = np.argmax if analysis.goal == "maximize" else np.argmin
    observed = analysis.data.points[int(pick(analysis.data.scores))]
    region = analysis.region
    return {
        "At the optimum": dict(analysis.optimum.settings),
        "Best observed run": region.decode(observed)[0],
        "Worst of the region": region.decode(worst.point)[0],
    }
