"""What a thorough analysis adds, on the terminal: where the optimum may lie, which terms, blocks, paths, runs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from seqrsm.cli.console import heading, line, number, show_table
from seqrsm.report.rounding import format_p, format_percent, format_significant
from seqrsm.report.study_text import (
    LOCATION_METHODS,
    averaged_text,
    block_rows,
    block_text,
    location_text,
    path_rows,
    profile_text,
    searched_rows,
    searched_text,
)
from seqrsm.report.wording import interval_text, level_phrase, score_text

if TYPE_CHECKING:
    from seqrsm.analysis.results import Analysis, Study, TermChoice
    from seqrsm.analysis.study import TermTest

_SHOWN_RUNS = 5


def show_study(analysis: Analysis, study: Study) -> None:
    """Everything that `seqrsm fit` adds to the fit."""
    heading("At the optimum, allowing for its having been searched for")
    line(searched_text(analysis, study), 2)
    for name, text, half in searched_rows(analysis, study):
        line(f"{level_phrase(analysis)} {name}: {text} (\u00b1 {half})", 2)
    _show_locations(analysis, study)
    _show_terms(analysis, study)
    heading("Diagnostics")
    vif = analysis.fit.vif()
    known = [i for i in range(len(vif)) if math.isfinite(vif[i]) and analysis.fit.kinds[i] != "block"]
    if known:
        worst = max(known, key=lambda i: float(vif[i]))
        line(f"Largest variance inflation factor: {number(float(vif[worst]), 3)} ({analysis.fit.names[worst]})", 2)
    if math.isfinite(study.normal.correlation):
        line(f"Correlation of the normal plot: {study.normal.correlation:.3f}", 2)
    line(profile_text(study), 2)
    line(
        "The recommended settings lie further from the runs than any run does: an extrapolation."
        if study.extrapolated
        else "The recommended settings are no extrapolation.",
        2,
    )
    for run in study.influential[:_SHOWN_RUNS]:
        line(f"run {analysis.data.run_ids[run.run]}: {'; '.join(run.reasons)}", 2)
    if len(study.influential) > _SHOWN_RUNS:
        line(f"and {len(study.influential) - _SHOWN_RUNS} more runs that stand out (`--json` names them)", 2)
    if study.blocks is not None:
        rows = block_rows(analysis, study.blocks)
        level = level_phrase(analysis)
        columns = ["block", "mean", f"{level} confidence", f"{level} prediction, one run"]
        show_table(columns, rows, title="The recommended settings by block")
        line(block_text(study.blocks), 2)
    for title, path in (
        ("Ridge analysis: best settings by coded distance from the centre", study.ridge),
        ("Path of steepest ascent from the centre of the region", study.steepest),
    ):
        if len(path) > 1:
            names = [factor.name for factor in analysis.region.factors]
            columns = ["distance", *names, "mean", ""]
            show_table(columns, path_rows(analysis, path), title=title)


def _show_locations(analysis: Analysis, study: Study) -> None:
    if not study.locations:
        line(f"No confidence region of the optimum's place: {study.no_location}")
        return
    rows = [
        [factor.name, *(location_text(region, j) for region in study.locations)]
        for j, factor in enumerate(analysis.region.factors)
    ]
    columns = ["factor", *(LOCATION_METHODS[region.method] for region in study.locations)]
    show_table(columns, rows, title=f"Where the optimum may lie, {level_phrase(analysis)}")


def _show_terms(analysis: Analysis, study: Study) -> None:
    found = study.terms
    if isinstance(found, str):
        line(f"No average over models: {found}")
        return
    rows = [
        [name, format_percent(float(share)), format_percent(float(before))]
        for name, share, before in _by_inclusion(found)
    ]
    show_table(["term", "probability", "before"], rows, title="Terms: averaging over hierarchical models")
    line(averaged_text(found), 2)
    line(
        f"averaged over models, at the recommended settings: {score_text(analysis, found.mean)}, "
        f"{level_phrase(analysis)} credible {interval_text(analysis, found.confidence)}, one future run "
        f"{interval_text(analysis, found.prediction)}",
        2,
    )


def _by_inclusion(found: TermChoice) -> list[tuple[str, float, float]]:
    rows = zip(found.units, found.inclusion.tolist(), found.prior_inclusion.tolist(), strict=True)
    return sorted(rows, key=lambda row: -row[1])


def show_tests(tests: Sequence[TermTest]) -> None:
    """Partial F tests that were asked for."""
    if not tests:
        return
    rows = [
        [
            one.asked,
            str(one.test.df),
            format_significant(one.test.ss, 4) if math.isfinite(one.test.ss) else "",
            format_significant(one.test.f, 4) if math.isfinite(one.test.f) else one.test.reason,
            format_p(one.test.p) if math.isfinite(one.test.p) else "",
            ", ".join(one.terms),
        ]
        for one in tests
    ]
    show_table(["test", "df", "SS", "F", "p", "terms"], rows, title="Partial F tests")
