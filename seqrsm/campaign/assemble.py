"""Gather what a report shows, from the store and fresh pictures."""

from __future__ import annotations

import platform
from importlib.metadata import version

from seqrsm import __version__
from seqrsm.campaign.dossier import Dossier, ImagePanel
from seqrsm.campaign.images import chosen_settings, report_panels, truth_panel
from seqrsm.campaign.loop import Campaign
from seqrsm.campaign.simulation import simulate_image, task_of


def assemble(campaign: Campaign) -> Dossier:
    """Dossier of a campaign as it stands.

    Raises
    ------
    FitError
        Too few scores for a response surface.
    ConvergenceError
        The sampler did not converge.
    """
    spec, store = campaign.spec, campaign.store
    analyses = campaign.analyse_all(sampler="emcee")
    images: tuple[ImagePanel, ...] = ()
    truth, assumptions = None, _measured_assumptions(campaign)
    if spec.simulator is not None:
        chosen = chosen_settings(campaign)
        images = report_panels(campaign, chosen)
        image, _ = simulate_image(task_of(spec, 0, next(iter(chosen.values()))))
        truth = truth_panel(spec, image.quarter_turns)
        assumptions = (*assumptions, *image.notes)
    return Dossier(
        spec=spec,
        analyses=analyses,
        runs=store.runs(),
        looks=store.looks(),
        events=store.events(),
        images=images,
        truth=truth,
        assumptions=assumptions,
        provenance=_provenance(campaign),
        reproduce=_reproduce(campaign),
    )


def _measured_assumptions(campaign: Campaign) -> tuple[str, ...]:
    spec = campaign.spec
    errors = "normal" if spec.model.errors == "normal" else "Student-t with 4 degrees of freedom"
    found = [
        f"errors of different runs are independent, {errors}, with equal variance"
        + (" in percent, on the logit scale" if spec.model.response == "logit" else ""),
        f"the utility is a polynomial of order {spec.model.order} in the coded factors over the whole region",
    ]
    if spec.simulator is not None:
        found.append(
            "each simulated run is one occasion: backscatter of fields and dates, soil moisture, wind, fading, "
            "receiver noise and the training sample are drawn anew from the campaign's seed and the run's id"
        )
    return tuple(found)


def _provenance(campaign: Campaign) -> dict[str, str]:
    spec, store = campaign.spec, campaign.store
    found = {
        "campaign": spec.name,
        "specification (SHA-256)": spec.spec_hash,
        "seed": str(spec.seed),
        "seqrsm": __version__,
        "Python": platform.python_version(),
        "libraries": ", ".join(f"{name} {version(name)}" for name in ("numpy", "scipy", "numba", "emcee")),
    }
    last = max((score.scored_at for run in store.runs() for score in run.scores), default="")
    if last:
        found["last score"] = last
    for file in store.files():
        found[f"scores file {file.name}"] = f"{file.row_count} rows, SHA-256 {file.sha256}, {file.ingested_at}"
    truth = truth_panel(spec, 0)
    if truth is not None:
        found["scene"] = truth.name
        found["scene, licence"] = truth.licence
        found["scene, provenance"] = truth.provenance
    return found


def _reproduce(campaign: Campaign) -> tuple[str, ...]:
    name = campaign.folder.name
    if campaign.spec.simulator is not None:
        return (f"seqrsm run {name}", f"seqrsm report {name}")
    files = [f"seqrsm ingest {name} {file.name}" for file in campaign.store.files()]
    return (*files, f"seqrsm fit {name}", f"seqrsm report {name}")
