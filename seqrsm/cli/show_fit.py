"""A fit on the terminal, in the words and digits of the report."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from seqrsm.cli.console import heading, line, number, show_table
from seqrsm.cli.show_study import show_study
from seqrsm.design.factors import setting_text, settings_text
from seqrsm.report.figures.surfaces import ranked_factors
from seqrsm.report.rounding import (
    decimals_for,
    decimals_of_significant,
    format_number,
    format_p,
    format_percent,
    format_plain,
    format_share,
    format_significant,
)
from seqrsm.report.wording import (
    effects_text,
    interval_text,
    level_phrase,
    loss_text,
    mean_text,
    no_error_estimate,
    of_quadratic,
    optimum_setting_text,
    setting_posterior,
    setting_range_text,
    with_unit,
)

if TYPE_CHECKING:
    from seqrsm.analysis.compromise import CompromiseEstimate
    from seqrsm.analysis.results import Analysis
    from seqrsm.design.factors import Factor


def show_fit(analysis: Analysis) -> None:
    """Everything `seqrsm fit` has to say."""
    _show_coefficients(analysis)
    fit = analysis.fit
    line(
        f"{fit.n_runs} runs, {fit.n_terms} terms, s = {format_significant(fit.s, 3)} on {fit.df_residual} df, "
        f"R2 = {format_number(fit.r2, 3)}, adjusted {format_number(fit.r2_adjusted, 3)}, "
        f"predicted {format_number(fit.r2_predicted, 3)}"
    )
    if fit.reason:
        line(f"No error estimate: {fit.reason}")
    _show_anova(analysis)
    show_importance(analysis)
    _show_stationary(analysis)
    show_optimum(analysis)
    sampler = analysis.posterior.sampler
    if sampler["method"] == "emcee":
        line(
            f"Posterior by emcee: {sampler['steps']} steps, tau {number(float(sampler['tau']), 3)}, "
            f"least ESS {float(sampler['ess']):.0f}, at the ends of the intervals {float(sampler['ess_ends']):.0f}, "
            f"R-hat {number(float(sampler['r_hat']), 5)}"
        )
    elif sampler["method"] == "gibbs":
        line(
            f"Posterior by Gibbs sampling of Student-t errors: {sampler['steps']} sweeps, "
            f"least ESS {float(sampler['ess']):.0f}, R-hat {number(float(sampler['r_hat']), 5)}"
        )
    if effects := effects_text(analysis):
        line(effects)
    if analysis.study is not None:
        show_study(analysis, analysis.study)
    _show_decision(analysis)
    show_warnings(analysis.warnings)


def _show_coefficients(analysis: Analysis) -> None:
    fit = analysis.fit
    interval = fit.interval(analysis.optimum.level)
    rows = []
    for i, name in enumerate(fit.names):
        estimate, se = float(fit.estimate[i]), float(fit.se[i])
        places = decimals_for(se, decimals_of_significant(estimate, 3))
        band = (float(interval.low[i]), float(interval.high[i]))
        rows.append(
            [
                name,
                format_number(estimate, places),
                format_number(se, places),
                format_number(float(fit.t[i]), 1),
                format_p(float(fit.p_value[i])),
                *(format_number(end, places) for end in band),
            ]
        )
    scale = ", logit scale" if analysis.response == "logit" else ""
    level = level_phrase(analysis)
    title = f"Coefficients of {analysis.application}, coded units{scale}; {level} confidence"
    show_table(["term", "estimate", "se", "t", "p", "low", "high"], rows, title=title)


def _show_anova(analysis: Analysis) -> None:
    rows = [
        [
            f"  {row.source}" if row.source in ("lack of fit", "pure error") else row.source,
            str(row.df),
            format_significant(row.ss, 4),
            _blank_or(row.ms, 4),
            _blank_or(row.f, 3),
            format_p(row.p) if math.isfinite(row.p) else "",
        ]
        for row in analysis.anova
    ]
    show_table(["source", "df", "SS", "MS", "F", "p"], rows, title="Analysis of variance")
    if isinstance(analysis.lack_of_fit, str):
        line(f"Lack of fit cannot be tested: {analysis.lack_of_fit}")


def _blank_or(value: float, digits: int) -> str:
    return format_significant(value, digits) if math.isfinite(value) else ""


def show_importance(analysis: Analysis) -> None:
    """Partial F test of every factor, the most important first."""
    found = {row.factor: row for row in analysis.importance}
    rows = [
        [
            name,
            str(found[name].df),
            _blank_or(found[name].f, 3),
            format_p(found[name].p),
            *("" if math.isnan(x) else format_percent(x) for x in (found[name].share, found[name].share_total)),
        ]
        for name in ranked_factors(analysis)
        if name in found
    ]
    columns = ["factor", "df", "F", "p", "variance alone", "with products"]
    show_table(columns, rows, title="Importance of the sensor parameters")


def _show_stationary(analysis: Analysis) -> None:
    point = analysis.stationary
    if point is None:
        return
    heading("Shape of the surface")
    values = ", ".join(format_significant(float(x), 3) for x in point.eigenvalues)
    where = "inside" if point.inside_region else "outside"
    line(f"Stationary point: {point.kind}, {where} the region; curvatures {values}")
    if point.warning:
        line(point.warning, 2)


def show_optimum(analysis: Analysis) -> None:
    """Recommended settings, the three intervals there, and what may be lost."""
    best, level = analysis.optimum, level_phrase(analysis)
    rows = []
    for factor in analysis.region.factors:
        posterior = setting_posterior(analysis, factor)
        at_bound = math.nan if posterior is None else posterior.p_at_bound
        rows.append(
            [
                factor.name,
                optimum_setting_text(analysis, factor),
                setting_range_text(analysis, factor),
                "" if math.isnan(at_bound) else format_share(at_bound),
            ]
        )
    columns = ["factor", "recommended", f"{level} credible{of_quadratic(analysis)}", "at a bound"]
    show_table(columns, rows, title=f"Optimum of {analysis.application}")
    line(f"Mean score there: {mean_text(analysis)}")
    missing = no_error_estimate(analysis)
    if missing:
        line(missing, 2)
    else:
        for name, interval in (
            ("prediction interval of one future run", best.prediction),
            (f"prediction interval of the mean of {best.replicates} runs", best.prediction_mean),
            ("confidence interval of the mean", best.confidence),
        ):
            half = format_significant(interval.half_width, 2)
            line(f"{level} {name}: {interval_text(analysis, interval)} (\u00b1\u00a0{half})", 2)
        if best.with_departure is not None and best.quadratic is None:
            allowed = best.with_departure
            half = format_significant(allowed.prediction.half_width, 2)
            line(
                f"{level} prediction interval of one future run, allowing for a departure from the quadratic too small "
                f"to be seen: {interval_text(analysis, allowed.prediction)} (\u00b1\u00a0{half})",
                2,
            )
    if best.ties and not best.ridge:
        others = "; ".join(settings_text(analysis.region.factors, tie) for tie in best.ties[:3])
        line(f"as good: {others}{' and more' if len(best.ties) > 3 else ''}", 2)
    if best.at_bound:
        line(f"at the border of the region: {', '.join(best.at_bound)}", 2)
    regret = analysis.posterior
    if math.isfinite(regret.expected_regret):
        limit = with_unit(format_plain(regret.regret_epsilon), analysis.score_unit)
        line(
            f"expected loss against the unknown true optimum: {loss_text(analysis, regret.expected_regret)}; more than "
            f"{limit} with probability {format_share(regret.p_regret_above)}",
            2,
        )


def decision_heading(analysis: Analysis) -> str:
    """Stop or go on, in a line; a stop that fresh runs contradict is told as such."""
    if not analysis.decision.held:
        return "Decision: go on"
    return "Decision: stop, but fresh runs contradict the model" if analysis.contradicted else "Decision: stop"


def _show_decision(analysis: Analysis) -> None:
    heading(decision_heading(analysis))
    for check in analysis.decision.checks:
        mark = {True: "holds", False: "not yet", None: "unknown"}[check.holds]
        line(f"- {mark}: {check.text}", 2)
    for text in analysis.decision.futility:
        line(text, 2)
    if analysis.confirmation is not None:
        line(f"- {analysis.confirmation.text}", 2)


def show_compromise(factors: Sequence[Factor], found: CompromiseEstimate) -> None:
    """Settings that serve all applications, and what each gives up."""
    rows = []
    for factor in factors:
        interval = found.credible.get(factor.name)
        ends = () if interval is None else (setting_text(factor, end) for end in (interval.low, interval.high))
        rows.append([factor.name, setting_text(factor, found.settings[factor.name]), " to ".join(ends)])
    level = f"{100 * found.level:g} %"
    show_table(["factor", "setting", f"{level} credible"], rows, title="Compromise")
    line(f"Desirability {found.desirability:.3g}; expected shortfall {found.expected_shortfall:.2g}")
    for item in found.given_up:
        line(f"- {item.text}", 2)


def show_warnings(warnings: Sequence[str]) -> None:
    """What to be careful about."""
    for warning in warnings:
        line(f"Warning: {warning}")
