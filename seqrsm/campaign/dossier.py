"""Everything a report shows, as data: the one object that passes from the campaign to ``seqrsm.report``."""

from __future__ import annotations

import platform
import shlex
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from typing import Any

from seqrsm import __version__
from seqrsm.analysis.compromise import CompromiseEstimate
from seqrsm.analysis.results import Analysis
from seqrsm.campaign.campaign import Campaign
from seqrsm.campaign.candidates import read_candidates
from seqrsm.campaign.experiment import changed_since, experiment_of
from seqrsm.campaign.images import ImagePanel, chosen_settings, report_pictures
from seqrsm.campaign.rests_on import CropCalendar, crop_calendar, rests_on
from seqrsm.campaign.simulation import scene_at
from seqrsm.campaign.tradeoff import read_tradeoff
from seqrsm.plain import counted
from seqrsm.progress import silent
from seqrsm.remember import remembered
from seqrsm.scene.scene import Scene
from seqrsm.score.table import IN_MEMORY
from seqrsm.score.utilities import asked_for, utility_of
from seqrsm.spec.read import CampaignSpec
from seqrsm.store.records import CONFIRMATION, EventRecord, LookRecord, RankingSummary, RunRecord


@dataclass(frozen=True, slots=True)
class Dossier:
    """A campaign as it stands, ready to be shown."""

    spec: CampaignSpec
    """What was asked."""
    analyses: tuple[Analysis, ...]
    """One for each application, in the order of ``campaign.toml``."""
    runs: tuple[RunRecord, ...]
    """Every run, void and failed ones included."""
    looks: tuple[LookRecord, ...]
    """The interval at the optimum after each batch."""
    events: tuple[EventRecord, ...]
    """The history."""
    images: tuple[ImagePanel, ...]
    """Simulated images; empty for a campaign without a simulator."""
    scene: Scene | None
    """The simulated site."""
    quarter_turns: int
    """``numpy.rot90`` of its layers by so many has the orientation of the first image."""
    assumptions: tuple[str, ...]
    """Every assumption of the simulation, one sentence each."""
    provenance: Mapping[str, str]
    """Versions, seed, hashes, data sources: label to value, in the order to be shown. No times of day: equal campaigns
    have equal reports."""
    reproduce: tuple[str, ...]
    """Commands that reproduce this campaign."""
    compromise: CompromiseEstimate | None = None
    """Of several applications, or of one with other considerations."""
    tradeoff: Mapping[str, Any] | None = None
    """What ``seqrsm tradeoff`` measured last, see `seqrsm.campaign.tradeoff`."""
    candidates: Mapping[str, Any] | None = None
    """What ``seqrsm candidates`` found last, see `seqrsm.campaign.candidates`."""
    rests: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """What each application's recommended settings rest on, see `seqrsm.campaign.rests_on`."""
    rankings: tuple[RankingSummary, ...] = ()
    """Of each application that interpreters rank."""
    calendar: CropCalendar | None = None
    """Of a campaign with dates, at the recommended settings."""


def assemble(campaign: Campaign, step: Callable[[str], None] = silent) -> Dossier:
    """Dossier of a campaign as it stands; ``step`` is told what is being done; errors of `Campaign.analyse_all`."""
    spec, store = campaign.spec, campaign.store
    step("sampling the posterior")
    analyses = campaign.analyse_all(sampler="emcee", thorough=True)
    compromise = campaign.compromise(analyses)
    images: tuple[ImagePanel, ...] = ()
    turns, notes = 0, _measured_assumptions(campaign, analyses)
    scene = None if spec.scene_path is None else scene_at(str(spec.scene_path))
    if scene is not None:
        step("simulating images")
        chosen = chosen_settings(analyses, compromise)
        made_of = (spec.spec_hash, experiment_of(spec), chosen)
        images, turns, more = remembered(lambda: report_pictures(spec, chosen), made_of)
        notes += more
        if changed := changed_since(store, spec):
            names = ", ".join(changed)
            notes = (
                f"since runs were simulated this has changed: {names}; images, and what is said of tables and covers, "
                "are as it is now",
                *notes,
            )
    compared, tradeoff = read_candidates(spec, analyses), read_tradeoff(spec.folder)
    more_asked = [name for name, found in (("tradeoff", tradeoff), ("candidates", compared)) if found is not None]
    return Dossier(
        spec=spec,
        analyses=analyses,
        runs=store.runs(),
        looks=campaign.looks(analyses),
        events=store.events(),
        images=images,
        scene=scene,
        quarter_turns=turns,
        assumptions=notes,
        provenance=_provenance(campaign, scene),
        reproduce=_reproduce(campaign, more_asked),
        compromise=compromise,
        tradeoff=tradeoff,
        candidates=compared,
        rests={} if spec.simulator is None else {a.application: rests_on(spec, a.optimum.settings) for a in analyses},
        rankings=store.ranking_summaries(),
        calendar=crop_calendar(spec, (compromise or analyses[0].optimum).settings) if spec.simulator else None,
    )


def _measured_assumptions(campaign: Campaign, analyses: Sequence[Analysis]) -> tuple[str, ...]:
    spec = campaign.spec
    weighed = any(one.fitted.departure.probability > 0.0 for one in analyses)
    logit = spec.model.response == "logit"
    variance = {
        "equal": "variance proportional to that of a share" if logit else "equal variance",
        "se": "variance proportional to the square of their standard errors",
        "counts": "variance proportional to that of the counted number of independent decisions",
    }[spec.model.weights]
    scale = " in percent, on the logit scale" if logit else ""
    found = [
        f"errors of different runs are independent, {spec.errors.words}"
        + ("" if spec.errors.of_counts else f", with {variance}{scale}"),
        f"the utility is a polynomial of order {spec.model.order} in the coded factors over the whole region"
        + (", or a Gaussian process about one" if weighed else ""),
    ]
    if spec.simulator is not None:
        known = spec.simulator
        engines = {own.get("engine", known.engine) for own in known.members.values()} | {known.engine}
        drawn = {
            "psm": "backscatter of fields and dates, soil moisture, wind, fading",
            "prm": "emissivity, temperature and soil moisture of fields and of the date",
        }
        of_run = ", ".join(words for engine, words in drawn.items() if engine in engines)
        found.append(
            f"each simulated run is one occasion with its own draw of the tables: table means, {of_run}, receiver "
            "noise and the training sample are drawn from the campaign's seed and the run's id"
        )
        maps = {
            one.name: asked_for(one.utility).knows_areas(bool(known.known_map))
            for one in spec.applications
            if utility_of(one.utility).classifies
        }
        if maps:
            equal, informed = ([name for name in maps if maps[name] == knows] for knows in (False, True))
            of_equal, of_informed = (f" of {', '.join(some)}" * (some != list(maps)) for some in (equal, informed))
            if equal:
                found.append(
                    f"all covers are equally probable to the classifier{of_equal} before it sees the image, so that a "
                    "poor image can score less than a guess that names the commonest cover everywhere"
                )
            if informed:
                found.append(f"the classifier{of_informed} knows how common each cover is before it sees the image")
            if known.known_map:
                found.append(
                    f"beside the images the classifier has a label of an existing map for each field, which every run "
                    f"draws from the confusion table {known.known_map}, independently between fields"
                )
    return tuple(found)


def _provenance(campaign: Campaign, scene: Scene | None) -> dict[str, str]:
    spec, store = campaign.spec, campaign.store
    found = {
        "campaign": spec.name,
        "specification (SHA-256)": spec.spec_hash,
        "seed": str(spec.seed),
        "seqrsm": __version__,
        "Python": platform.python_version(),
        "libraries": ", ".join(f"{name} {version(name)}" for name in ("numpy", "scipy", "numba", "emcee")),
    }
    for file in store.files():
        text, before = f"{counted(file.row_count, 'row')}, SHA-256 {file.sha256}", found.get(f"scores file {file.name}")
        found[f"scores file {file.name}"] = text if before is None else f"{before}; {text}"
    if scene is not None:
        told = {"scene": scene.name, "scene, licence": scene.licence, "scene, provenance": scene.provenance}
        found |= {name: text for name, text in told.items() if text}
    return found


def _reproduce(campaign: Campaign, more: Sequence[str]) -> tuple[str, ...]:
    """The commands that made the campaign, in their order: what was proposed, ingested and voided, then the results."""
    folder, runs = campaign.folder.name, {run.run_id: run for run in campaign.store.runs()}
    name = shlex.quote(folder)
    run_it, flight = (f"run {name}", " --source flight") if campaign.spec.simulator is not None else ("", "")
    steps, sizes = [run_it] if run_it else [], Counter(run.batch for run in runs.values())
    sources = Counter(batch for batch, _ in {(run.batch, run.source) for run in runs.values()})
    seen: set[object] = {"measured"}
    voids: tuple[str, list[str]] = ("", [])  # why the last runs were void, and the step that says so
    for event in campaign.store.events():
        run, why = runs.get(event.run_id or 0), shlex.quote(str(event.detail.get("reason")))
        if event.kind == "ingested":
            file, rows = event.detail["name"], counted(event.detail["row_count"], "row")
            path = f"{folder}/{file}" if (campaign.folder / file).exists() else file
            read = f"ingest {name} {shlex.quote(path)}"
            in_python = f"seqrsm.Campaign({folder!r}).ingest(table)  # in Python: a {IN_MEMORY} of {rows}"
            steps.append(in_python if file == IN_MEMORY else read)
        elif event.kind in ("void", "void ranking"):
            what, end = event.run_id or f"--ranking {event.detail['ranking']}", f" --why {why}"
            before = steps.pop().removesuffix(end) if event.run_id and voids == (end, steps[-1:]) else f"void {name}"
            steps.append(f"{before} {what}{end}")
            voids = (end, steps[-1:]) if event.run_id else ("", [])
        elif run and event.kind == "proposed" and {run.batch, run.purpose}.isdisjoint(seen) and run.replaces is None:
            seen.add(run.batch)
            size = "" if run.purpose in ("start", CONFIRMATION) else f" -n {sizes[run.batch]}"
            own = run_it if run.source == "simulation" else f"propose {name}{size}{flight}"
            made = [f"propose {name}{size} --source best", f"simulate {name}"] if sources[run.batch] > 1 else [own]
            steps += made if steps[-1:] != made else []
    fit = [f"fit {name}"] if steps != [run_it] else []
    return tuple(
        step if step.startswith("seqrsm.") else f"seqrsm {step}"
        for step in (*steps, *fit, *(f"{command} {name}" for command in more), f"report {name}")
    )
