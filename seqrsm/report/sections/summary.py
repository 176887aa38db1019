"""The first page: what to build, how good it will be, how sure that is, and whether to go on."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from seqrsm.analysis.compromise import CompromiseEstimate
from seqrsm.analysis.results import Analysis
from seqrsm.report.blocks import Block, Bullets, KeyFigure, KeyFigures, Paragraph, Section, Table, right, table
from seqrsm.report.figures.surfaces import ranked_factors
from seqrsm.report.rounding import format_p, format_plain, format_share, format_significant
from seqrsm.report.sections.compromise import compromise_summary
from seqrsm.report.wording import (
    at_bound_text,
    axis_label,
    format_settings,
    ground_sentence,
    half_width_text,
    interval_text,
    level_phrase,
    listing,
    loss_text,
    mean_text,
    no_error_estimate,
    optimum_setting_text,
    parts_of_width,
    readable,
    readable_text,
    score_text,
    setting_range_text,
    settings_sentence,
    watched_interval,
    with_unit,
)
from seqrsm.spec.read import CampaignSpec
from seqrsm.store.records import RunRecord

_TIES = 3
"""Tied optima that are named."""


def summary_section(
    spec: CampaignSpec,
    analyses: Sequence[Analysis],
    compromise: CompromiseEstimate | None,
    runs: Sequence[RunRecord],
    rests: Mapping[str, Mapping[str, float]] | None = None,
) -> Section:
    """Return the summary of a campaign: the compromise, if there is one, and one part for each application.

    Parameters
    ----------
    spec : CampaignSpec
    analyses : sequence of Analysis
        Empty where no application has scored runs enough.
    compromise : CompromiseEstimate or None
    runs : sequence of RunRecord
        All of the campaign: what they cost is told.
    rests : Mapping, optional
        By application, shares of the area by what their means rest on.
    """
    spent = sum(run.cost for run in runs if run.state == "scored")
    common = () if compromise is None else compromise_summary(spec.factors, compromise)
    if len(analyses) == 1:
        return Section("summary", "Summary", (*_summary(spec, analyses[0], spent, rests or {}), *common))
    parts = tuple(
        Section(f"summary-{number}", analysis.application, _summary(spec, analysis, spent, rests or {}))
        for number, analysis in enumerate(analyses, 1)
    )
    if not parts:
        note = "No application of this campaign has enough scored runs for its model yet: there is no result to show."
        return Section("summary", "Summary", (Paragraph(note, "warning"),))
    return Section("summary", "Summary", common, parts)


def _summary(
    spec: CampaignSpec, analysis: Analysis, spent: float, rests: Mapping[str, Mapping[str, float]]
) -> tuple[Block, ...]:
    blocks: list[Block] = [Paragraph(recommendation(analysis), "lead"), _key_figures(spec, analysis, spent)]
    if spec.simulator is not None and (text := ground_sentence(analysis, spec.stop)):
        blocks.append(Paragraph(text))
    if shares := rests.get(analysis.application):
        blocks.append(Paragraph(_rests_text(shares)))
    blocks.append(_settings_table(analysis))
    best = analysis.optimum
    if best.ties and not best.ridge:
        others = "; ".join(format_settings(analysis.region.factors, tie) for tie in best.ties[:_TIES])
        blocks.append(Paragraph(f"As good: {others}{' and more' if len(best.ties) > _TIES else ''}.", "note"))
    if best.at_bound:
        edges = listing([_edge(text) for text in best.at_bound])
        text = f"The optimum lies at the edge of the region: {edges}. A better setting may lie beyond it."
        blocks.append(Paragraph(text, "note"))
    names = analysis.region.names
    blocks += [Paragraph(readable_text(text, names), "warning") for text in analysis.warnings]
    blocks.append(Paragraph(_verdict(analysis)))
    blocks.append(Bullets(tuple(readable_text(text, names) for text in analysis.decision.reasons)))
    if analysis.confirmation is not None:
        blocks.append(Paragraph(analysis.confirmation.text))
    return tuple(blocks)


def _rests_text(shares: Mapping[str, float]) -> str:
    """Return what the mean backscatter or emissivity behind the recommendation rests on, by area."""
    parts = listing([f"{100.0 * share:.0f} % {status}" for status, share in shares.items()])
    return f"By area, the means behind the score at these settings are {parts}."


def _edge(text: str) -> str:
    """Return a bound in words; the text of a constraint stays as the user wrote it."""
    return text if text.startswith("constraint ") else readable(text)


def recommendation(analysis: Analysis) -> str:
    """Return the recommendation in words and numbers."""
    optimum, level = analysis.optimum, level_phrase(analysis)
    best = "highest" if analysis.goal == "maximize" else "lowest"
    text = f"Recommended for {analysis.application}: {settings_sentence(analysis)}. "
    text += f"There the {best} mean score in the region is expected, "
    missing = no_error_estimate(analysis)
    if missing:
        return text + f"estimated at {score_text(analysis, optimum.mean)} ({missing})."
    text += mean_text(analysis)
    text += f" (confidence {level}); one future run there should score {interval_text(analysis, optimum.prediction)}"
    return text + f" (prediction interval, {level})."


def _key_figures(spec: CampaignSpec, analysis: Analysis, spent: float) -> KeyFigures:
    optimum, level, stop = analysis.optimum, level_phrase(analysis), spec.stop
    missing = no_error_estimate(analysis)
    target = with_unit(format_plain(stop.half_width), analysis.score_unit)
    ends, half = interval_text(analysis, optimum.prediction), half_width_text(analysis, optimum.prediction.half_width)
    cost = f"cost so far {format_plain(float(f'{spent:.6g}'))}"
    figures = (
        ("1. Optimum: mean score", mean_text(analysis), missing or f"confidence interval {level}"),
        ("2. Most important", *_most_important(analysis)),
        (
            "3. Prediction interval there",
            "none" if missing else ends,
            missing or f"one future run, {level}; half-width {half}",
        ),
        (
            "Half-width that decides",
            _deciding(analysis),
            f"target {target}{parts_of_width(analysis)}: {watched_interval(stop)}",
        ),
        (
            "Scored runs in the fit",
            str(analysis.fit.n_runs),
            f"{analysis.fit.n_terms} terms; budget {stop.max_runs} runs; {cost}",
        ),
        ("Decision", *_decision_words(analysis)),
    )
    return KeyFigures(tuple(KeyFigure(*figure) for figure in figures))


def _deciding(analysis: Analysis) -> str:
    """Return the watched half-width to three digits: it is held against a target."""
    width = analysis.decision.half_width
    return with_unit(format_significant(width, 3), analysis.score_unit) if math.isfinite(width) else "none"


def _decision_words(analysis: Analysis) -> tuple[str, str]:
    if analysis.decision.held and analysis.contradicted:
        return "Doubt", "the stop rule holds, but fresh runs contradict the model"
    if analysis.decision.held:
        return "Stop", "the stop rule holds"
    if analysis.decision.wants_confirmation:
        return "Confirm", "only fresh runs at the optimum are missing"
    if analysis.decision.budget_spent:
        return "Budget spent", "before the stop rule held"
    needed = analysis.decision.runs_needed
    if needed is not None and needed > analysis.fit.n_runs:
        return "Go on", f"about {needed} runs in all are needed"
    return "Go on", "the stop rule does not hold yet"


def _most_important(analysis: Analysis) -> tuple[str, str]:
    tested = {row.factor: row for row in analysis.importance if math.isfinite(row.p)}
    ranked = [name for name in ranked_factors(analysis) if name in tested]
    if not ranked:
        return "not testable", no_error_estimate(analysis) or "no test exists"
    first = tested[ranked[0]]
    p = format_p(first.p)
    detail = f"F = {format_significant(first.f, 3)}, p {p if p.startswith('<') else '= ' + p}"
    if len(ranked) > 1:
        detail += f"; then {listing([readable(name) for name in ranked[1:4]])}"
    return readable(ranked[0]), detail


def _settings_table(analysis: Analysis) -> Table:
    rows = (
        (
            axis_label(factor),
            optimum_setting_text(analysis, factor, unit=False),
            setting_range_text(analysis, factor),
            at_bound_text(analysis, factor),
        )
        for factor in analysis.region.factors
    )
    credible = f"Credible interval {level_phrase(analysis)} of the optimal setting"
    columns = ("Factor", right("Setting"), credible, right("Probability at a bound"))
    return table(f"Recommended settings for {analysis.application}", columns, rows)


def _verdict(analysis: Analysis) -> str:
    posterior = analysis.posterior
    if analysis.decision.held and analysis.contradicted:
        text = (
            "The stop rule holds, but the fresh runs at the recommended settings contradict the model: the score there "
            "is what they say, and more runs around them would show why."
        )
    elif analysis.decision.held:
        text = "The campaign can stop."
    elif analysis.decision.budget_spent:
        text = "The budget is spent and the stop rule does not hold."
    else:
        text = "The stop rule does not hold yet."
    if math.isfinite(posterior.expected_regret):
        loss = loss_text(analysis, posterior.expected_regret)
        text += f" Acting on these settings now is expected to lose {loss} against the unknown true optimum"
        if math.isfinite(posterior.p_regret_above) and posterior.regret_epsilon > 0.0:
            epsilon = with_unit(format_plain(posterior.regret_epsilon), analysis.score_unit)
            text += f", and more than {epsilon} with a probability of {format_share(posterior.p_regret_above)}"
        text += "."
    return text
