"""The first page: what to build, how good it will be, how sure that is, what to do next, and on what basis."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from seqrsm.analysis.compromise import CompromiseEstimate
from seqrsm.analysis.results import Analysis, BlockResponse
from seqrsm.campaign.ingest import ranking_messages
from seqrsm.campaign.status import costs
from seqrsm.decide.stopping import BUDGET_SPENT
from seqrsm.plain import counted
from seqrsm.report.blocks import Block, Bullets, KeyFigure, KeyFigures, Paragraph, Section, Table, right, table
from seqrsm.report.figures.surfaces import ranked_factors
from seqrsm.report.rounding import (
    NOTHING,
    format_against,
    format_p,
    format_percent,
    format_plain,
    format_share,
    format_significant,
)
from seqrsm.report.sections.compromise import compromise_summary
from seqrsm.report.sections.measure import width_after_flight
from seqrsm.report.sections.optimum import first_panels
from seqrsm.report.wording import (
    CUT,
    at_bound_text,
    axis_label,
    capital,
    cost_texts,
    ground_sentence,
    half_width_text,
    interval_text,
    level_phrase,
    listing,
    loss_text,
    mean_text,
    no_error_estimate,
    no_intervals,
    optimum_setting_text,
    readable,
    readable_text,
    rounded_settings,
    score_text,
    setting_phrases,
    setting_range_text,
    setting_spreads,
    source_counts,
    told_settings,
    watched_interval,
    with_unit,
)
from seqrsm.sensor.sets import SENSORS
from seqrsm.spec.read import CampaignSpec
from seqrsm.spec.sensors import without_effect
from seqrsm.store.records import CONFIRMATION, RankingSummary, RunRecord

_TIES = 3
"""Tied optima that are named."""

_CLEAR_P = 0.05
"""Probability of the F test above which a factor is not said to matter."""

FLAT = "No factor has a significant effect"


def summary_section(
    spec: CampaignSpec,
    analyses: Sequence[Analysis],
    compromise: CompromiseEstimate | None,
    runs: Sequence[RunRecord],
    rests: Mapping[str, Mapping[str, float]] | None = None,
    rankings: Sequence[RankingSummary] = (),
) -> Section:
    """Return the summary of a campaign: of its one application, or the settings that serve all.

    There is one analysis, or all of a campaign, whose ``runs`` all tell what they cost; ``compromise`` is None where
    there is nothing else to weigh. ``rests``: by application, shares of the area by what their means rest on.
    ``rankings`` are of applications that interpreters rank.
    """
    made = (*_made(spec, runs), *(Paragraph(" ".join(ranking_messages(one))) for one in rankings))
    if compromise is None:
        found = result_section(spec, analyses[0], rests or {}, "summary", "Summary", made)
        return replace(found, blocks=(Paragraph(_question(spec, analyses)), *found.blocks))
    blocks = (*compromise_summary(spec.region, compromise), _own_table(analyses))
    todo = tuple("{}: {} ({}).".format(one.application, *_decision_words(one)) for one in analyses)
    parts = (
        Section("summary-next", "Next steps", (Bullets(todo),)),
        *((Section("summary-rests", "Basis", made),) if made else ()),
    )
    return Section("summary", "Summary", (Paragraph(_question(spec, analyses)), *blocks), parts)


def result_section(
    spec: CampaignSpec,
    analysis: Analysis,
    rests: Mapping[str, Mapping[str, float]],
    key: str,
    title: str,
    made: tuple[Paragraph, ...] = (),
) -> Section:
    """Return one application's result; ``made`` opens its basis, the other arguments are those of `summary_section`."""
    best, names = analysis.optimum, analysis.region.names
    blocks: list[Block] = []
    flat = _flat(analysis)
    blocks += [Paragraph(text, "lead") for text in flat]
    if best.ties and not best.ridge:
        others = "; ".join(rounded_settings(analysis, tie) for tie in best.ties[:_TIES])
        blocks.append(Paragraph(f"Equally good: {others}{' and more' if len(best.ties) > _TIES else ''}.", "lead"))
    blocks.append(Paragraph(recommendation(analysis), "lead"))
    blocks += [Paragraph(readable_text(text, names), "warning") for text in analysis.warnings if text not in flat]
    blocks.append(_key_figures(spec, analysis))
    blocks.append(first_panels(analysis, spec.stop_of(analysis.application)))
    blocks.append(_settings_table(analysis))
    blocks += [Paragraph(readable_text(text, names), "note") for text in analysis.notes]
    steps = tuple(readable_text(text, names) for text in (*_next_steps(spec, analysis), *_reasons(analysis)))
    basis = (*made, *_rests(spec, analysis, rests))
    parts = (
        Section(f"{key}-next", "Next steps", (Bullets(steps),)),
        *((Section(f"{key}-rests", "Basis", basis),) if basis else ()),
    )
    return Section(key, title, tuple(blocks), parts)


def _question(spec: CampaignSpec, analyses: Sequence[Analysis]) -> str:
    """The question of the campaign in a sentence."""
    factors = listing([readable(factor.name) for factor in spec.factors])
    aims = []
    for analysis in analyses:
        best = "highest" if analysis.goal == "maximize" else "lowest"
        utility = spec.application(analysis.application).utility
        what = "interpreters' rankings" if utility == "rank" else utility if ":" in utility else readable(utility)
        score = f"{best} measured score" if utility == "measured" else f"{best} score ({what})"
        aims.append(f"the {score} for {analysis.application}")
    considered = [readable(one.name) for one in spec.considerations] if len(analyses) == len(spec.applications) else []
    weighed = f", weighed against {listing(considered)}" if considered else ""
    return f"Question: which {factors} give{'s' if len(spec.factors) == 1 else ''} {listing(aims)}{weighed}?"


def _is_a_guess(analysis: Analysis) -> bool:
    """Whether no setting is shown to do better than guessing without an image."""
    return any(check.name == "guess" and check.holds is False for check in analysis.decision.checks)


def _flat(analysis: Analysis) -> list[str]:
    """The warning that no factor matters, by the test of all terms, which goes before those of single factors."""
    return [text for text in analysis.warnings if text.startswith(FLAT)]


def recommendation(analysis: Analysis) -> str:
    """Return the recommended settings in a sentence; their score stands in the key figures."""
    best = "highest" if analysis.goal == "maximize" else "lowest"
    told = told_settings(analysis.region, analysis.optimum.settings, setting_spreads(analysis))
    settings = listing(setting_phrases(analysis.region, told))
    what = f"the settings with the {best} estimated mean score in the region"
    if analysis.data.all_equal:
        return f"For {analysis.application} every setting is equally good so far, such as {settings}."
    if _is_a_guess(analysis):
        return (
            f"No setting is shown to do better than {'the existing map' if analysis.known_map else 'guessing'} for "
            f"{analysis.application}. Best of the fitted surface: {settings}, {what}."
        )
    return f"Recommended for {analysis.application}: {settings}, {what}."


def _key_figures(spec: CampaignSpec, analysis: Analysis) -> KeyFigures:
    level, stop = level_phrase(analysis), spec.stop_of(analysis.application)
    missing = no_intervals(analysis)
    target = with_unit(format_plain(stop.half_width), analysis.score_unit)
    best, terms = analysis.optimum, analysis.fitted.surface.n_terms
    mean, ends = (interval_text(analysis, one) for one in (best.confidence, best.prediction))
    watched = watched_interval(stop, best.ground is not None and stop.worlds == "count")
    watched += f", {CUT}" if math.isfinite(getattr(best, stop.interval).cut_from) else ""
    confirming = analysis.data.purposes.count(CONFIRMATION)
    extra = f" and {counted(confirming, 'confirmation run')}" if confirming else ""
    figures = (
        ("Mean score", score_text(analysis, best.mean), missing or f"{level} confidence interval {mean}"),
        (
            "One future run",
            "none" if missing else ends,
            missing or f"{level} prediction interval{_new_block(analysis)}",
        ),
        *_ends(analysis),
        ("Stop-rule half-width", _deciding(analysis, stop.half_width), f"target {target}; {watched}"),
        ("Most important factor", *_most_important(analysis)),
        ("Runs in the fit", str(analysis.fit.n_runs), f"{terms} terms; budget {stop.max_runs}{extra}"),
        ("Decision", *_decision_words(analysis)),
    )
    return KeyFigures(tuple(KeyFigure(*figure) for figure in figures))


def _new_block(analysis: Analysis) -> str:
    """What a run in a new block may score, where blocks are constants and the intervals those of the average one."""
    blocks = analysis.blocks
    if blocks is None or blocks.effect != "fixed" or not isinstance(blocks.new, BlockResponse):
        return ""
    new = blocks.new.prediction  # of the quadratic alone, with the variance of blocks
    wider = new.half_width > analysis.optimum.prediction.half_width
    ends = f", by the {analysis.model.name} alone, {interval_text(analysis, new)}" if wider else " no narrower"
    return f" in the average block; in a new block{ends}"


def _ends(analysis: Analysis) -> list[tuple[str, str, str]]:
    """Return what a guess and error-free data would score on the same ground, where it is known."""
    guess, perfect = analysis.data.guess, analysis.data.perfect
    if not (math.isfinite(guess) and math.isfinite(perfect)):
        return []
    ends = f"{score_text(analysis, guess, unit=False)} and {score_text(analysis, perfect)}"
    without = "the existing map alone" if analysis.known_map else "guessing without an image"
    return [("Reference scores", ends, f"{without}, and error-free data")]


def _deciding(analysis: Analysis, target: float = math.nan) -> str:
    """Return the watched half-width to three digits: it is held against a target."""
    width = analysis.decision.half_width
    return with_unit(format_against(width, target, 3), analysis.score_unit) if math.isfinite(width) else "none"


def _decision_words(analysis: Analysis) -> tuple[str, str]:
    needed = analysis.decision.runs_needed
    more = needed is not None and needed > analysis.fit.n_runs
    why = {
        "Doubt": "stop rule met, but the confirmation runs contradict the model",
        "Stop": "stop rule met",
        "Confirm": "only the confirmation runs are missing",
        "Budget spent": "stop rule not met",
        "Continue": f"about {needed} runs needed in total" if more else "stop rule not met yet",
    }
    return analysis.verdict, why[analysis.verdict]


def _most_important(analysis: Analysis) -> tuple[str, str]:
    tested = {row.factor: row for row in analysis.importance if math.isfinite(row.p)}
    ranked = [name for name in ranked_factors(analysis) if name in tested]
    if not ranked:
        return "not testable", no_error_estimate(analysis) or "no test exists"
    first = tested[ranked[0]]
    p = format_p(first.p)
    detail = f"F = {format_significant(first.f, 3)}, p {p if p.startswith('<') else '= ' + p}"
    if _flat(analysis) or min(row.p for row in tested.values()) > _CLEAR_P:
        return "none significant", f"{readable(ranked[0])} ranks first: {detail}"
    if then := [readable(name) for name in ranked[1:4] if tested[name].p <= _CLEAR_P]:
        detail += f"; then {listing(then)}"
    return readable(ranked[0]), detail


def _settings_table(analysis: Analysis) -> Table:
    width = 3 if analysis.region.numeric else 2  # levels have no bounds
    rows = (
        (
            axis_label(factor),
            *(
                (setting, setting_range_text(analysis, factor), at_bound_text(analysis, factor))
                if (setting := optimum_setting_text(analysis, factor, unit=False)) != NOTHING
                else (NOTHING,) * 3
            )[:width],
        )
        for factor in analysis.region.factors
    )
    credible = f"Optimal setting, {level_phrase(analysis)} credible interval"
    columns = ("Factor", *(right("Setting"), credible, right("Probability at a bound"))[:width])
    which = "Best settings of the fitted surface" if _is_a_guess(analysis) else "Recommended settings"
    return table(f"{which} for {analysis.application}", columns, rows)


def _own_table(analyses: Sequence[Analysis]) -> Table:
    """What each application would have alone; its settings stand in its own section."""
    rows = (
        (
            analysis.application,
            mean_text(analysis).replace(" ", "\u00a0").replace("\u00a0(", " ("),
            interval_text(analysis, analysis.optimum.prediction).replace(" ", "\u00a0"),
            *_most_important(analysis),
            _deciding(analysis),
            _decision_words(analysis)[0],
        )
        for analysis in analyses
    )
    numbers = (right("Best mean score"), right("One future run"))
    columns = ("Application", *numbers, "Most important factor", "Test", right("Stop-rule half-width"), "Decision")
    ends = f"{level_phrase(analyses[0])} confidence and prediction intervals"
    return table(f"Each application optimized separately, with {ends}", columns, rows)


def _can_widen(spec: CampaignSpec, settings: Mapping[str, float | str], name: str) -> bool:
    """Whether there is anything beyond a factor's end: no number of dates is below 1, and no heading a higher one."""
    if name in without_effect(spec.factors, settings):
        return False
    parameter = SENSORS[spec.simulator.engine].get(name) if spec.simulator else None
    if parameter is None:
        return True
    ends = parameter.values or (parameter.low, parameter.high)
    return settings[name] not in (min(ends), max(ends))


def _next_steps(spec: CampaignSpec, analysis: Analysis) -> Iterator[str]:
    """What to do, the first thing first; the settings are those of the first page."""
    best, decision = analysis.optimum, analysis.decision
    fresh = spec.stop.confirmation_runs
    if decision.held and analysis.contradicted:
        yield (
            "Run more around the recommended settings: the stop rule is met, but the confirmation runs contradict the "
            "model. Rely on their scores, not on the model's."
        )
    elif decision.held:
        yield f"Stop. {_loss_sentence(spec, analysis)}"
    elif decision.wants_confirmation:
        yield f"Make {counted(fresh, 'confirmation run')} at these settings. {_loss_sentence(spec, analysis)}"
    elif decision.budget_spent and _is_a_guess(analysis):
        less = "the existing map alone" if analysis.known_map else "a guess"
        yield f"Change the region or the sensor: at no setting of these are images shown to tell more than {less}."
    elif decision.budget_spent and spec.stop_of(analysis.application).half_width < decision.noise_floor:
        yield f"Accept the interval as it stands: more runs cannot reach the target. {_loss_sentence(spec, analysis)}"
    elif decision.budget_spent:
        yield f"Raise the budget or accept the result as it stands. {_loss_sentence(spec, analysis)}"
    else:
        yield f"Continue: the stop rule is not met yet. {_loss_sentence(spec, analysis)}"
    idle = {row.factor for row in analysis.importance if row.p > _CLEAR_P}
    edges = best.edges(name for name in best.at_bound if name not in idle and _can_widen(spec, best.settings, name))
    if edges and not _flat(analysis):
        yield f"Consider widening the region: the optimum lies on its edge, {listing(edges)}."
    if best.ground is not None and best.of_ground > best.by_chance.half_width:
        first = " (raise [stop] max_runs first)" if decision.budget_spent else ""
        after = half_width_text(analysis, width_after_flight(best))
        yield (
            f"Fly{first}, or measure the ground: table uncertainty makes up most of the half-width, which one flight "
            f"over the site would reduce to {after}."
        )


def _reasons(analysis: Analysis) -> Iterator[str]:
    """Why not to stop, but for what stands above: what is held against a target, a spent budget, a flat surface."""
    decision = analysis.decision
    if decision.held or decision.wants_confirmation:
        return
    told = {check.text for check in decision.checks if check.name in ("interval", "loss") and check.holds is False}
    told |= {analysis.confirmation.text} if analysis.confirmation else set()  # stands in the basis
    for text in decision.reasons:
        if text not in told and not text.endswith(BUDGET_SPENT) and not (_flat(analysis) and text.startswith(FLAT)):
            yield text


def _loss_sentence(spec: CampaignSpec, analysis: Analysis) -> str:
    posterior = analysis.posterior
    loss, limit = loss_text(analysis, posterior.expected_regret), spec.stop_of(analysis.application).loss
    if limit is not None:
        told, target = format_against(posterior.expected_regret, limit, 2), format_plain(limit)
        loss = f"{with_unit(told, analysis.score_unit)} (target: at most {with_unit(target, analysis.score_unit)})"
    epsilon = with_unit(format_plain(posterior.regret_epsilon), analysis.score_unit)
    return (
        f"Expected loss from adopting these settings now, relative to the unknown true optimum: {loss}; probability of "
        f"losing more than {epsilon}: {format_share(posterior.p_regret_above)}."
    )


def _rests(spec: CampaignSpec, analysis: Analysis, rests: Mapping[str, Mapping[str, float]]) -> Iterator[Paragraph]:
    if spec.simulator is not None and (ground := ground_sentence(analysis, spec.stop)):
        yield Paragraph(ground)
    if shares := rests.get(analysis.application):
        parts = listing([f"{format_percent(round(share, 6))} {status}" for status, share in shares.items()])
        yield Paragraph(f"Table values used at these settings, by scored area: {parts}.")
    if analysis.confirmation is not None:
        yield Paragraph(readable_text(analysis.confirmation.text, ()))


def _made(spec: CampaignSpec, runs: Sequence[RunRecord]) -> tuple[Paragraph, ...]:
    """How many runs of which source there are, and their cost; nothing without a score."""
    scored = [run for run in runs if run.state == "scored"]
    if not scored:
        return ()
    text = f"{capital(source_counts(scored))}."
    if unit := spec.cost.told_unit:
        spent, without = cost_texts(costs(runs), unit)
        sources = sorted({run.source for run in scored}, reverse=True)
        each = ", ".join(f"a {source} {with_unit(format_plain(spec.cost.of(source)), unit)}" for source in sources)
        text += f" They cost {spent} ({each}){without}."
    return (Paragraph(text),)
