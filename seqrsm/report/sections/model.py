"""The fitted model: equation, analysis of variance, coefficients, importance, diagnostics."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import numpy as np

from seqrsm.analysis.results import Analysis, BlockResponse, BlockStudy
from seqrsm.analysis.study import TermTest
from seqrsm.arrays import FloatArray
from seqrsm.fit.intervals import LackOfFit
from seqrsm.fit.least_squares import OUTLIER, extrapolated, influential_runs, normal_plot, outlier_p
from seqrsm.plain import counted, heading
from seqrsm.report.blocks import (
    Block,
    Bullets,
    Cell,
    Column,
    Details,
    Entry,
    Equation,
    FigureBlock,
    Head,
    Paragraph,
    Section,
    Table,
    right,
    table,
)
from seqrsm.report.figures import drawing
from seqrsm.report.figures.fit import residual_data, residual_paints
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
    capital,
    decimal_cell,
    fitted_unit,
    interval_text,
    is_weighted,
    level_phrase,
    listing,
    no_error_estimate,
    number_cell,
    p_cell,
    readable,
    readable_term,
    readable_text,
    score_text,
    share_cell,
    significant_cell,
    whole_cell,
    with_unit,
)

_TERMS = {
    1: ("beta_0 + sum_(i) beta_i x_i", "beta zero plus the sum of beta i x i"),
    2: (
        "beta_0 + sum_(i) beta_i x_i + sum_(i < j) beta_(i j) x_i x_j + sum_(i) beta_(i i) x_i^2",
        "beta zero plus the sum of beta i x i plus the sum over pairs of beta i j x i x j plus the sum of beta i i x i "
        "squared",
    ),
}
PARTIAL_F_EQUATION = Equation(
    'F = (("SSE"_1 - "SSE") \\/ (p - q)) / ("SSE" \\/ (N - p))',
    "F equals the quotient of SSE one minus SSE over p minus q, and SSE over N minus p",
)

MAX_INFLUENCE_ROWS = 10
MAX_NAMED = 3
_WILD = 0.25
"""Share of the full weight below which a score is called wild: about 3.5 standard deviations off."""


def model_section(analysis: Analysis, key: str) -> Section:
    """Return model, fit statistics, analysis of variance and coefficients."""
    blocks: list[Block] = []
    if analysis.sources is not None:
        blocks.append(Paragraph(readable_text(analysis.sources.text, analysis.region.names)))
    blocks += [
        Paragraph(_weights_text(analysis), method=_model_text(analysis)),
        _model_equation(analysis),
        _statistics_table(analysis),
    ]
    if analysis.fit.reason:
        blocks.append(Paragraph(f"{capital(analysis.fit.reason)}.", "warning"))
    blocks.append(_anova_table(analysis))
    blocks.append(Paragraph(_lack_of_fit_text(analysis)))
    blocks.append(Details(f"All {analysis.fit.n_terms} coefficients", (_coefficient_table(analysis),)))
    blocks += _by_block(analysis)
    return Section(f"{key}-model", "Model and analysis of variance", tuple(blocks))


def _model_equation(analysis: Analysis) -> Equation:
    terms, law = _TERMS[analysis.model.order], analysis.fitted.surface.errors.law(is_weighted(analysis))
    written = f"y = {terms[0]} + epsilon, quad epsilon tilde {law[0]}"
    return Equation(written, f"y equals {terms[1]} plus epsilon, which is {law[1]}")


def _model_text(analysis: Analysis) -> str:
    order = "second" if analysis.model.order == 2 else "first"
    text = f"The score y is a {order}-order polynomial in the coded factors x (RSL TR 380-1, eq. (2-1) to (2-6)"
    text += ", each pair counted once)." if analysis.model.order == 2 else ")."
    if any(kind == "category" for kind in analysis.fit.kinds):
        text += " Categorical factors enter as sum-to-zero contrasts and their products, without squares."
    if any(kind == "block" for kind in analysis.fit.kinds):
        text += " Blocks enter as sum-to-zero effects; results are for the average block."
    if analysis.scale.kind == "logit":
        text += " The model is fitted to the logit of the score; coefficients and sums of squares are on that scale."
    return f"{text} w is the weight of a run." if is_weighted(analysis) else text


def _weights_text(analysis: Analysis) -> str:
    """How the runs count, and what is taken of a future run, where they do not count alike; else empty."""
    scale, trials = analysis.scale, analysis.data.trials
    if trials is not None and analysis.fitted.surface.errors.of_counts:
        usual = str(round(float(np.median(trials))))
        found = f"Intervals are those of counts; a future run has n = {usual}, the median."
    elif math.isfinite(scale.trials):
        usual = format_plain(scale.trials)
        found = f"Runs are weighted by their binomial variance; a future run has n = {usual}, the median."
    elif math.isfinite(scale.se):
        usual = with_unit(format_significant(scale.se, 3), analysis.score_unit)
        found = f"Runs are weighted by 1/se\u00b2; a future run has the median se, {usual}."
    else:
        as_shares = "Scores are taken to scatter as shares do, most at 50 percent and less towards 0 and 100."
        found = as_shares if scale.kind == "logit" else ""
    if np.min(_share_counted(analysis)) < 1.0 - 1e-9:
        found += f" Errors are {analysis.fitted.surface.errors.words}: a run far from the surface counts for less here."
    found += _inflation_text(analysis)
    return f"{found.lstrip()} " if found else ""


def _inflation_text(analysis: Analysis) -> str:
    inflation = analysis.fit.inflation
    what = "variances of coefficients and the denominators of their F are"
    return (
        f" As the scores choose their weights, {what} {inflation:g} times those of least squares."
        if inflation > 1.0
        else ""
    )


def _share_counted(analysis: Analysis) -> FloatArray:
    """What its error leaves of the weight of each run (n,), of a run on the surface 1."""
    share = analysis.fit.weights / analysis.scale.weights
    return np.asarray(share / np.max(share))


def _statistics_table(analysis: Analysis) -> Table:
    fit = analysis.fit
    unit = fitted_unit(analysis)
    condition = fit.condition_number
    pairs: list[tuple[str, Cell]] = [
        ("Runs N", whole_cell(fit.n_runs)),
        ("Terms p, blocks included" if fit.n_terms > analysis.model.p else "Terms p", whole_cell(fit.n_terms)),
        ("Residual degrees of freedom", whole_cell(fit.df_residual)),
        *((title, _known(with_unit(format_significant(s, 3), unit), s, analysis)) for title, s in _scatter(analysis)),
        ("R\u00b2", _known(format_number(fit.r2, 3), fit.r2, analysis)),
        ("R\u00b2 adjusted", _known(format_number(fit.r2_adjusted, 3), fit.r2_adjusted, analysis)),
        (
            "R\u00b2 predicted (leave-one-out)",
            _known(format_number(fit.r2_predicted, 3 if fit.r2_predicted > -10.0 else 0), fit.r2_predicted, analysis),
        ),
        ("Condition number, columns of unit length", number_cell(format_significant(condition, 3), condition)),
    ]
    worst = _largest_vif(analysis)
    if worst is not None:
        pairs.append((f"Largest variance inflation factor, of {worst[0]}", significant_cell(worst[1], 3)))
    return table("Quality of the fit", ("Quantity", right("Value")), pairs)


def _scatter(analysis: Analysis) -> list[tuple[str, float]]:
    s, variance = analysis.fit.s, analysis.fitted.surface.errors.run_variance
    if variance == 1.0:
        return [("Residual standard deviation s", s)]
    return [("Residual scale s", s), ("Standard deviation of a run", math.sqrt(variance) * s)]


def _known(text: str, value: float, analysis: Analysis) -> Cell:
    """Return the cell of a number, or why there is none."""
    if math.isfinite(value):
        return number_cell(text, value)
    if analysis.fit.df_residual == 0:
        return Cell("none: N = p")
    return Cell("undefined: a run is fitted exactly" if analysis.fit.leverage_one_runs else "undefined")


def _anova_table(analysis: Analysis) -> Table:
    rows = (
        (
            f"\u2003{row.source}" if row.source in ("lack of fit", "pure error") else row.source,
            whole_cell(row.df),
            number_cell(format_significant(row.ss, 4), row.ss),
            significant_cell(row.ms, 4),
            significant_cell(row.f, 3),
            p_cell(row.p),
        )
        for row in analysis.fit.anova()
    )
    squares = (right(title, _squared(fitted_unit(analysis))) for title in ("Sum of squares", "Mean square"))
    columns: tuple[Head, ...] = ("Source", right("df"), *squares, right("F"), right("p"))
    divided = isinstance(analysis.fit.lack_of_fit(), LackOfFit)
    caption = "Sequential analysis of variance"
    caption += "; the residual divides into lack of fit and pure error" if divided else ""
    if "block" in analysis.fit.kinds:
        caption += "; blocks come first, not adjusted for the settings of their runs"
    return table(caption, columns, rows)


def _squared(unit: str) -> str:
    return f"{unit}\u00b2" if unit.isalpha() else f"({unit})\u00b2" if unit else ""


def _lack_of_fit_text(analysis: Analysis) -> str:
    test = analysis.fit.lack_of_fit()
    if not isinstance(test, LackOfFit):
        return f"Lack of fit cannot be tested: {test.rstrip('.')}."
    p = format_p(test.p)
    numbers = f"F({test.df_lof}, {test.df_pe}) = {format_significant(test.f, 3)}, p {p if p[0] == '<' else '= ' + p}"
    verdict = next((check for check in analysis.decision.checks if check.name == "lack_of_fit"), None)
    if verdict is not None and verdict.holds is not None:
        text = f"Test of lack of fit: {numbers}. {readable_text(verdict.text, analysis.region.names)}"
        return text if verdict.holds else f"{text} {_NOT_COVERED}"
    if test.p < 0.05:
        weighed = analysis.fitted.departure.process is not None
        return f"Lack of fit is significant: {numbers}. {_COVERED if weighed else _NOT_COVERED}"
    return f"No significant lack of fit: {numbers}."


_COVERED = (
    "The surface departs from the polynomial by more than the scatter of repeated runs; the intervals allow for "
    "another surface."
)
_NOT_COVERED = (
    "The surface departs from the polynomial by more than the scatter of repeated runs; the intervals may not reach "
    "their nominal coverage."
)


def _coefficient_table(analysis: Analysis) -> Table:
    fit = analysis.fit
    band = fit.interval(analysis.optimum.level)
    draws = analysis.posterior.term_draws
    rows: list[tuple[Entry, ...]] = []
    for i, name in enumerate(fit.names):
        estimate, se = float(fit.estimate[i]), float(fit.se[i])
        places = decimals_for(se, decimals_of_significant(estimate, 3))
        has_draws = i < draws.shape[1] and draws.shape[0] > 1 and math.isfinite(se)
        mean, sd = (float(np.mean(draws[:, i])), float(np.std(draws[:, i], ddof=1))) if has_draws else (math.nan,) * 2
        rows.append(
            (
                readable_term(name),
                *(decimal_cell(value, places) for value in (estimate, se)),
                decimal_cell(float(fit.t[i]), 1),
                p_cell(float(fit.p_value[i])),
                *(decimal_cell(value, places) for value in (float(band.low[i]), float(band.high[i]), mean, sd)),
            )
        )
    level = level_phrase(analysis)
    columns: tuple[Head, ...] = (
        "Term",
        *map(right, ("Estimate", "s.e.", "t", "p", f"{level} low", f"{level} high")),
        *(Column(title, align="right", extra=True) for title in ("Posterior mean", "Posterior sd")),
    )
    what = heading("Coefficients", fitted_unit(analysis))
    caption = f"{what} in coded units with their {level} confidence intervals"
    return table(caption, columns, rows, sortable=True)


def importance_section(analysis: Analysis, key: str) -> Section:
    """Return the relative importance of the sensor parameters."""
    rows = {row.factor: row for row in analysis.importance}
    tested = [row for row in analysis.importance if math.isfinite(row.f)]
    blocks: list[Block] = [
        Paragraph(
            f"{_inflation_text(analysis)} ".lstrip(),
            method="The importance of a factor is tested by the partial F test of all terms that contain it (RSL TR "
            "380-1, eq. (2-14)); SSE\u2081 is the residual sum of squares without them, q the number of terms left.",
        ),
        PARTIAL_F_EQUATION,
    ]
    if not tested:
        reason = no_error_estimate(analysis) or "no test exists for these runs"
        blocks.append(Paragraph(f"The importance of the factors cannot be tested: {reason}.", "warning"))
        return Section(f"{key}-importance", "Importance of the sensor parameters", tuple(blocks))
    ranked = [rows[name] for name in ranked_factors(analysis) if name in rows]
    most = max(ranked, key=lambda row: row.share_total if math.isfinite(row.share_total) else -1.0)
    if most.share_total > ranked[0].share_total:
        text = f"The fitted surface changes most with {readable(most.factor)} (total effect "
        text += f"{format_share(most.share_total)}); the order is that of F, a mean over the factor's terms."
        blocks.append(Paragraph(text))
    cells = (
        (
            readable(row.factor),
            whole_cell(row.df),
            significant_cell(row.f, 3),
            p_cell(row.p),
            share_cell(row.share),
            share_cell(row.share_total),
        )
        for row in ranked
    )
    columns: tuple[Head, ...] = ("Factor", *map(right, ("df", "F", "p", "Main effect", "Total effect")))
    caption = (
        "Factors in order of importance. Main and total effect: the factor's share of the fitted surface's variance "
        f"over {'the region' if analysis.region.is_box else 'all ranges, constraints left out'}, alone and with its "
        "interactions"
    )
    blocks.append(table(caption, columns, cells, sortable=True))
    return Section(f"{key}-importance", "Importance of the sensor parameters", tuple(blocks))


def diagnostics_section(analysis: Analysis, key: str) -> Section:
    """Return residual plots and what stands out in them."""
    blocks: list[Block] = []
    paints = residual_paints(analysis)
    if paints:
        blocks.append(Bullets(_findings(analysis)))
        alt = "Scatter plot of {}; the list above it names what stands out."
        data = partial(residual_data, analysis)
        drawn = tuple(
            drawing.panel(title, alt.format(title[:1].lower() + title[1:]), paint, title, data)
            for title, paint in paints
        )
        caption = "Externally studentised residuals; about 95 % should lie between the dotted lines at \u22122 and 2."
        blocks.append(FigureBlock(lambda: drawn, caption, columns=3))
        details = Details("Residuals, leverage and influence of runs", (_influence_table(analysis),), long=True)
        blocks.append(details)
    else:
        reason = no_error_estimate(analysis) or "fewer than three runs have a studentised residual"
        blocks.append(Paragraph(f"No residuals can be examined: {reason}."))
    return Section(f"{key}-diagnostics", "Diagnostics", tuple(blocks))


def _findings(analysis: Analysis) -> tuple[str, ...]:
    fit, ids = analysis.fit, analysis.data.run_ids
    flagged = ids[outlier_p(fit) < OUTLIER]
    found = []
    if (wild := ids[_share_counted(analysis) < _WILD]).size:  # its small weight hides it from the test of outliers
        name = analysis.model.name
        found.append(f"Far off the {name}, and counted for less than a quarter of a score on it: {_runs(wild)}.")
    elif flagged.size:
        found.append(f"Outliers (5 % level, Bonferroni): {_runs(flagged)}.")
    else:
        found.append("No run is an outlier (5 % level, Bonferroni).")
    if fit.leverage_one_runs:
        exact = ids[list(fit.leverage_one_runs)]
        found.append(f"The model must pass through {_runs(exact)} (leverage 1), where residuals tell nothing.")
    if fit.r2_predicted < 0.0:
        left_out = np.square(fit.residuals / (1.0 - fit.leverage)) * fit.weights
        worst = int(np.argmax(left_out))
        if left_out[worst] > 0.5 * fit.press:
            found.append(
                f"R\u00b2 predicted is negative because of {_runs(ids[[worst]])}, whose leverage of "
                f"{format_number(float(fit.leverage[worst]), 6)} leaves little to predict it from."
            )
    correlation = normal_plot(fit).correlation
    if np.isfinite(correlation):
        found.append(f"Correlation of residuals with normal quantiles: {correlation:.3f}.")
    outside = extrapolated(fit, analysis.model.matrix(analysis.optimum.point[None, :]))[0]
    far = "an extrapolation: their leverage exceeds every run's" if outside else "not an extrapolation"
    found.append(f"The recommended settings are {far}.")
    influential = [one for one in influential_runs(fit) if one.run not in fit.leverage_one_runs]
    if influential:
        shown = influential if len(influential) == MAX_NAMED + 1 else influential[:MAX_NAMED]  # not "and 1 more"
        named = [str(int(ids[run.run])) for run in shown]
        what = "further run" if fit.leverage_one_runs else "run"
        more, high = len(influential) - len(named), 2.0 * fit.n_terms / fit.n_runs
        found.append(
            f"{counted(len(influential), what)} with {f'leverage above 2p/n = {high:.2f}, ' if high < 1.0 else ''}"
            f"Cook's distance above 4/n = {4.0 / fit.n_runs:.2g} or an outlying residual: "
            f"{listing([*named, f'{more} more'] if more else named)}."
        )
    inside = np.abs(fit.studentised[np.isfinite(fit.studentised)]) <= 2.0
    found.append(f"{format_percent(float(np.mean(inside)))} of the studentised residuals lie within \u22122 and 2.")
    return tuple(found)


def _runs(ids: np.ndarray) -> str:
    numbers = [str(int(i)) for i in ids]
    return f"run {numbers[0]}" if len(numbers) == 1 else f"runs {listing(numbers)}"


def _influence_table(analysis: Analysis) -> Table:
    fit, data = analysis.fit, analysis.data
    # A quarter of s, so that residuals within it still show their differences.
    places = decimals_for(fit.s / 4.0) if math.isfinite(fit.s) and fit.s > 0.0 else 3
    chosen = np.arange(fit.n_runs)
    if fit.n_runs > MAX_INFLUENCE_ROWS:
        chosen = np.argsort(-np.nan_to_num(fit.cooks_distance), kind="stable")[:MAX_INFLUENCE_ROWS]
    rows = (
        (
            whole_cell(int(data.run_ids[i])),
            *(decimal_cell(float(values[i]), places) for values in (fit.y, fit.fitted, fit.residuals)),
            decimal_cell(float(fit.studentised[i]), 2),
            *(decimal_cell(float(values[i]), 3) for values in (fit.leverage, fit.cooks_distance)),
        )
        for i in chosen
    )
    scores = (right(title, fitted_unit(analysis)) for title in ("Observed", "Fitted", "Residual"))
    columns = (right("Run"), *scores, *map(right, ("Studentised", "Leverage", "Cook's distance")))
    share = (
        f", the {MAX_INFLUENCE_ROWS} of {fit.n_runs} runs with the largest Cook's distance"
        if len(chosen) < fit.n_runs
        else ""
    )
    return table(f"Residuals and influence{share}", columns, rows, sortable=True)


def _by_block(analysis: Analysis) -> list[Block]:
    """How blocks differ, and what a new one would give, folded away; empty without blocks."""
    found = analysis.blocks
    if found is None:
        return []
    blocks: list[Block] = [Paragraph(_block_text(found, fitted_unit(analysis)))]
    if isinstance(found.new, BlockResponse) and found.effect == "fixed":  # else the summary's interval is that
        level, new = level_phrase(analysis), found.new
        ends = (interval_text(analysis, new.confidence), interval_text(analysis, new.prediction))
        columns = ("Mean", f"{level} confidence", f"{level} prediction, one run")
        whose = analysis.model.name
        title = f"The recommended settings in a new block, by the {whose}, not corrected for selection bias"
        blocks.insert(0, table(title, columns, [(score_text(analysis, new.mean), *ends)]))
    return [Details("Differences between blocks", tuple(blocks))]


def _block_text(found: BlockStudy, unit: str) -> str:
    """How much blocks differ."""
    if isinstance(found.new, str):
        return f"Differences between blocks cannot be estimated: {found.new}."
    ratio = " to ".join(format_significant(end, 2) for end in found.ratio)
    run, block = (with_unit(format_significant(sigma, 3), unit) for sigma in (found.sigma, found.sigma_block))
    text = (
        f"Blocks are {found.effect} effects. Standard deviation of a run {run}, of the blocks {block} (restricted "
        f"maximum likelihood); credible interval of their ratio {ratio}. A run in a new block includes that block's "
        "effect."
    )
    if found.effect == "random":
        text += " Coefficients, analysis of variance and F tests are those of fixed blocks."
    return f"{text} {capital(found.note)}." if found.note else text


def _largest_vif(analysis: Analysis) -> tuple[str, float] | None:
    """Term of the largest variance inflation factor, and that factor; None where there is none."""
    vif = analysis.fit.vif()
    known = [i for i in range(len(vif)) if np.isfinite(vif[i]) and analysis.fit.kinds[i] != "block"]
    if not known:
        return None
    worst = max(known, key=lambda i: float(vif[i]))
    return readable_term(analysis.fit.names[worst]), float(vif[worst])


def term_test_table(analysis: Analysis, tests: Sequence[TermTest]) -> Table:
    """Partial F tests that were asked for."""
    rows = (
        (
            one.asked,
            whole_cell(one.test.df),
            significant_cell(one.test.ss, 4),
            significant_cell(one.test.f, 4) if math.isfinite(one.test.f) else one.test.reason,
            p_cell(one.test.p),
            ", ".join(map(readable_term, one.terms)),
        )
        for one in tests
    )
    squares = right("Sum of squares", _squared(fitted_unit(analysis)))
    columns = ("Test", right("df"), squares, right("F"), right("p"), "Terms")
    return table("Partial F tests", columns, rows)
