"""Results as tables for a terminal of 80 columns; plain text when piped."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from seqrsm.cli.blocks import show_blocks
from seqrsm.cli.console import heading, line, show_table
from seqrsm.design.factors import settings_text
from seqrsm.plain import counted
from seqrsm.report.rounding import format_against, format_percent, format_significant
from seqrsm.spec.read import CampaignSpec
from seqrsm.store.records import RunRecord

if TYPE_CHECKING:
    from seqrsm.campaign.ingest import IngestReport
    from seqrsm.scene.scene import Scene


def known_text(value: float | None, digits: int = 3, target: float = math.nan) -> str:
    """A stored score, half-width or loss, which is None where there was none; held against a target."""
    return "-" if value is None else format_against(value, target, digits)


def run_row(run: RunRecord) -> dict[str, Any]:
    """A run as JSON."""
    return {
        **{name: getattr(run, name) for name in ("run_id", "batch", "state", "source", "purpose", "why", "settings")},
        "scores": {score.application: {"score": score.score, "se": score.se} for score in run.scores},
        "reason": run.reason,
    }


def show_proposals(spec: CampaignSpec, runs: Sequence[RunRecord], *, of_source: bool) -> None:
    """Issued runs with the reason for each; ``of_source``: whether to say who makes it."""
    for run in runs:
        source = f" ({run.source})" * of_source
        line(f"run {run.run_id}{source}: {settings_text(spec.factors, run.proposed)}")
        line(f"{run.purpose}: {run.why}", 6)


def show_runs(spec: CampaignSpec, runs: Sequence[RunRecord]) -> None:
    """Runs that were carried out."""
    for run in runs:
        scores = ", ".join(f"{score.application} {format_significant(score.score, 4)}" for score in run.scores)
        line(f"run {run.run_id}: {run.state}, {scores or run.reason} ({settings_text(spec.factors, run.settings)})")
    failed = sum(run.state == "failed" for run in runs)
    line(f"{counted(len(runs), 'run')} completed" + f", {failed} without a score" * bool(failed))


def show_ingest(report: IngestReport) -> None:
    """What became of a file of scores."""
    from seqrsm.report.sections.data import interpreter_table  # of numerical libraries, which few commands here need

    if report.already is None:
        parts = [
            counted(len(ids), f"{what} run") + done
            for ids, what, done in (
                (report.matched, "proposed", " ranked" if report.rankings else " scored"),
                (report.created, "new", ""),
                (report.unchanged, "unchanged", ""),
            )
            if ids
        ]
        would = "would be ingested" if report.dry_run else "ingested"
        what = counted(report.n_new, "rank" if report.ranked or report.rankings else "score")
        if report.rankings:
            first, last = report.rankings[0], report.rankings[-1]
            parts.append(f"ranking {first}" if first == last else f"rankings {first} to {last}")
        line(f"{report.file}: {f'{what} {would}: ' if parts else ''}{', '.join(parts) or 'nothing new'}")
    for message in report.messages:
        line(f"{report.file}: {message}")
    if report.ranked:
        line()
    show_blocks(interpreter_table(one) for one in report.ranked)


# -- the rest -----------------------------------------------------------------------------------------------------


def show_scene(scene: Scene, statistics: Mapping[str, Any]) -> None:
    """What a scene holds."""
    line(f"{scene.name}: {scene.elevation_m.shape[0]} x {scene.elevation_m.shape[1]} cells of {scene.cell_m:g} m")
    line(f"licence: {scene.licence or 'not stated'}")
    line(f"provenance: {scene.provenance or 'not stated'}")
    low, high, rms, most = (known_text(statistics[n], 4) for n in ("low_m", "high_m", "rms_slope", "max_slope"))
    shares = {"scored cells": statistics["scored_fraction"], **statistics["category_fractions"]}
    rows = (
        ("elevation", f"{low} to {high} m"),
        ("slope", f"rms {rms} m/m, at most {most} m/m"),
        ("fields", f"{statistics['n_fields']}, median {1e-4 * statistics['median_field_m2']:.3g} ha by area"),
        *((name, format_percent(share)) for name, share in shares.items()),
    )
    show_table((), rows, sides=("left",))
    if scene.temperature_k is not None:
        known = scene.temperature_k[scene.valid()]
        line(f"ground temperature: {known.min():.1f} to {known.max():.1f} K")
    if scene.soil_moisture is not None:
        known = scene.soil_moisture[scene.valid()]
        line(f"soil moisture: {known.min():.3f} to {known.max():.3f} m3/m3")


_OF_DESIGN = {
    "d_efficiency": "D-efficiency against the best continuous design",
    "i_efficiency": "I-efficiency, likewise",
    "d_value": "D criterion, |Z'Z|^(1/p) / N",
    "a_value": "A criterion, N tr((Z'Z)^-1) / p",
    "i_value": "I criterion, mean scaled prediction variance",
    "condition_number": "condition number, columns of unit length",
}


def show_design(result: Mapping[str, Any]) -> None:
    """A stand-alone design and its quality."""
    rows = []
    for i, settings in enumerate(result["settings"]):
        cells = [value if isinstance(value, str) else f"{round(value, 4) + 0.0:.5g}" for value in settings.values()]
        rows.append([str(i + 1), *cells])
    show_table(["run", *result["names"]], rows)
    known = [[words, f"{result[name]:.4g}"] for name, words in _OF_DESIGN.items() if result[name] is not None]
    show_table((), known, sides=("left",))
    curve = result["fraction_of_design_space"]
    if curve[0] is not None:
        shares = ", ".join(f"{curve[at]:.4g} over {at} %" for at in (50, 90, 100))
        line(f"scaled prediction variance at most {shares} of the region")
    line(f"{result['n_distinct']} distinct settings, {result['df_pure_error']} degrees of freedom of pure error")
    for warning in result["warnings"]:
        line(f"Warning: {warning}")


def show_parameters(rows: Sequence[Mapping[str, Any]]) -> None:
    """Parameters of a sensor, one statement each."""
    for head, chosen in (
        ("Required, as a factor or fixed", [row for row in rows if row["required"]]),
        ("Optional", [row for row in rows if not row["required"]]),
    ):
        heading(head)
        for row in chosen:
            default = "" if row["default"] in (None, "") else f"; default {row['default']}"
            never = "" if row["factor"] else "; cannot be a factor"
            line(f"- {row['name']}: {row['what']}; {row['allowed']}{default}{never}")
