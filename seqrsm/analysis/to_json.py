"""``fit --json``: an analysis as the document that users script against."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from seqrsm.analysis.results import Analysis, BlockStudy, OptimumEstimate
from seqrsm.analysis.scale import Interval
from seqrsm.analysis.study import TermTest
from seqrsm.analysis.surfaces import SourceComparison
from seqrsm.arrays import FloatArray
from seqrsm.fit.canonical import within_error
from seqrsm.fit.intervals import LackOfFit
from seqrsm.fit.least_squares import extrapolated, influential_runs, known_scatter, normal_plot
from seqrsm.fit.natural import natural_transform


def analysis_to_json(analysis: Analysis) -> dict[str, Any]:
    """The whole analysis; undefined numbers are nan (null once written)."""
    fit, decision = analysis.fit, analysis.decision
    document = {
        **_of(analysis, "application", "goal"),
        "response": analysis.scale.kind,
        **_of(analysis, "score_unit"),
        **_of(fit, "n_runs", "n_terms", "df_residual", "s", "r2", "r2_adjusted", "r2_predicted", "press"),
        "terms": _terms(analysis),
        "covariance": _covariance(analysis),
        "anova": _value(fit.anova()),
        "lack_of_fit": _lack_of_fit(fit.lack_of_fit()),
        "factors_importance": _value(analysis.importance),
        "stationary_point": _stationary(analysis),
        "departure": _departure(analysis),
        **_of(analysis, "steps"),
        "optimum": optimum_to_json(analysis),
        "posterior": _posterior(analysis),
        "diagnostics": _diagnostics(analysis),
        **_of(analysis, "confirmation"),
        "stop": {
            **_of(decision, "held", "reasons", "checks", "half_width", "noise_floor"),
            **_of(analysis.data, "guess", "perfect"),
            **_of(decision, "attainable_half_width", "runs_needed"),
        },
        "sources": None if analysis.sources is None else _sources(analysis.sources),
        **_of(analysis, "warnings", "notes"),
    }
    if analysis.thorough:
        document["blocks"] = None if analysis.blocks is None else _blocks(analysis.blocks)
        document["largest_gap"] = _value(analysis.gap)
        document["diagnostics"] |= _unusual(analysis)
    return document


def fields_to_json(found: Any, but: str = "") -> dict[str, Any]:
    """The fields of a dataclass by their names, ``but`` one; those that are dataclasses as documents of their own."""
    return _of(found, *(field.name for field in fields(found) if field.name != but))


def _of(found: Any, *names: str) -> dict[str, Any]:
    return {name: _value(getattr(found, name)) for name in names}


def _value(value: Any) -> Any:
    if isinstance(value, Interval):
        return interval_to_json(value)
    if is_dataclass(value):
        return fields_to_json(value)
    return [_value(one) for one in value] if isinstance(value, tuple) else value


def _departure(analysis: Analysis) -> dict[str, Any]:
    """What the scores say of a surface that is no quadratic; lengths coded, noise on the scale of the fit."""
    found = analysis.fitted.departure
    document: dict[str, Any] = {
        **_of(found, "probability", "log_bayes_factor", "reason"),
        "optimum_of_quadratic": analysis.region.decode(analysis.of_quadratic.point)[0],
    }
    if found.process is not None:
        hyper, names = found.process.hyper, analysis.region.names
        lengths = np.median(hyper.lengths, axis=0).tolist()
        document["lengths"] = dict(zip([names[j] for j in analysis.model.numeric], lengths, strict=True))
        document["noise_sd"] = float(np.median(hyper.noise)) * found.process.scatter
    return document


def optimum_to_json(analysis: Analysis) -> dict[str, Any]:
    """Settings of the optimum and the intervals there."""
    best = analysis.optimum
    return {
        "settings": best.settings,
        "coded": dict(zip(analysis.region.names, best.point.tolist(), strict=True)),
        "at_bound": best.edges(best.at_bound),
        **_of(best, "mean", "optimism", "confidence", "prediction"),
        "prediction_mean": {**interval_to_json(best.prediction_mean), "replicates": best.replicates},
        **_of(best, "level", "whole", "by_chance"),
        "ground": _ground(best),
        **_of(best, "ties", "ridge", "exact"),
    }


def _ground(best: OptimumEstimate) -> dict[str, Any] | None:
    """What simulations in several worlds say of what is not known of the ground; None where there were none."""
    ground = best.ground
    if ground is None:
        return None
    return {
        "half_width": best.of_ground,
        "share_of_variance": ground.share,
        **_of(ground, "sd_ground", "sd_chance", "n_worlds", "n_simulations"),
    }


def look_summary(analysis: Analysis) -> dict[str, Any]:
    """What the store keeps of a look: enough for the history of the interval and of futility."""
    decision = analysis.decision
    return {
        **_of(analysis.fit, "n_runs", "s"),
        "optimum": optimum_to_json(analysis),
        "settings_spread": {one.factor: 0.5 * (one.high - one.low) for one in analysis.posterior.settings},
        **_of(decision, "half_width"),
        "expected_loss": analysis.posterior.expected_regret,
        **_of(analysis.data, "guess", "perfect"),
        **_of(decision, "noise_floor", "held", "reasons", "futility"),
        "decision": analysis.verdict,
    }


def _terms(analysis: Analysis) -> list[dict[str, Any]]:
    fit = analysis.fit
    interval = fit.interval(analysis.optimum.level)
    columns = np.column_stack([fit.estimate, fit.se, fit.t, fit.p_value, interval.low, interval.high])
    coded = [dict(zip(("estimate", "se", "t", "p", "low", "high"), row, strict=True)) for row in columns.tolist()]
    return [
        {"name": name, "coded": own, "natural": natural}
        for name, own, natural in zip(fit.names, coded, _natural(analysis), strict=True)
    ]


def _covariance(analysis: Analysis) -> dict[str, Any]:
    """Covariance s^2 (Z'WZ)^-1 of the coded coefficients, by the rows of its lower triangle."""
    fit = analysis.fit
    matrix = known_scatter(fit.s) ** 2 * fit.covariance_unscaled
    return {"terms": list(fit.names), "lower_triangle": [matrix[i, : i + 1] for i in range(fit.n_terms)]}


def _natural(analysis: Analysis) -> list[dict[str, float]]:
    """Natural-unit coefficients, in log10 of a factor on a log scale; nan for blocks."""
    found = analysis.fit.predict(natural_transform(analysis.model), analysis.optimum.level)
    columns, band = np.full((analysis.fit.n_terms, 4), np.nan), found.confidence
    columns[: analysis.model.p] = np.column_stack([found.mean, found.se_mean, band.low, band.high])
    return [dict(zip(("estimate", "se", "low", "high"), row, strict=True)) for row in columns.tolist()]


def _lack_of_fit(lack: LackOfFit | str) -> dict[str, Any]:
    if isinstance(lack, str):
        return {"reason": lack}
    return {"df": lack.df_lof, "df_pure_error": lack.df_pe, "ss": lack.ss_lof, "f": lack.f, "p": lack.p}


def _stationary(analysis: Analysis) -> dict[str, Any] | None:
    point = analysis.stationary
    if point is None:
        return None
    numeric = [analysis.region.names[j] for j in analysis.region.numeric]
    return {
        **_place(analysis, point.point, point.se),
        **_of(point, "value", "kind"),
        "factors": numeric,
        **_of(point, "eigenvalues", "eigenvectors", "inside_region", "flat"),
        "exact": {
            **_place(analysis, point.exact_point, point.exact_se),
            "value": point.exact_value,
            "inside_region": point.exact_inside_region,
        },
        "warning": point.warning,
    }


def _place(analysis: Analysis, point: FloatArray, se: FloatArray) -> dict[str, Any]:
    """Settings at a coded point (k,), and standard errors of the numeric ones."""
    region, natural = analysis.region, None
    ends = within_error(region, point, se)
    if np.all(np.isfinite(point)):
        with np.errstate(over="ignore"):  # a stationary point may lie anywhere
            natural = region.decode(point)[0]
    return {
        "natural": natural,
        "coded": dict(zip(region.names, point.tolist(), strict=True)),
        "se": {
            "natural": {name: 0.5 * (high - low) for name, (low, high) in ends.items()},
            "coded": {region.names[j]: float(se[j]) for j in region.numeric},
            "low": {name: low for name, (low, _) in ends.items()},
            "high": {name: high for name, (_, high) in ends.items()},
        },
    }


def _posterior(analysis: Analysis) -> dict[str, Any]:
    posterior = analysis.posterior
    tail = 0.5 * (1.0 - analysis.optimum.level)
    low, high = np.quantile(posterior.term_draws, [tail, 1.0 - tail], axis=0)
    return {
        "sampler": posterior.sampler,
        "terms": [
            {
                "name": term.name,
                "mean": float(np.mean(posterior.term_draws[:, i])),
                "sd": float(np.std(posterior.term_draws[:, i], ddof=1)),
                "low": low[i],
                "high": high[i],
            }
            for i, term in enumerate(analysis.model.terms)
        ],
        "optimum": {
            "settings": {
                row.factor: {"probabilities": row.probabilities}
                if row.probabilities
                else _of(row, "mean", "low", "high", "p_at_bound")
                for row in posterior.settings
            },
            **_of(posterior, "mean", "credible", "predictive", "expected_regret", "p_regret_above", "regret_epsilon"),
        },
        **_of(posterior, "effects", "effects_probability"),
    }


def _diagnostics(analysis: Analysis) -> dict[str, Any]:
    fit = analysis.fit
    names = ("score", "residual", "leverage", "studentised", "cooks_distance")
    columns = np.column_stack([analysis.data.scores, fit.residuals, fit.leverage, fit.studentised, fit.cooks_distance])
    return {
        **_of(fit, "condition_number"),
        "rank": fit.n_terms,
        "vif": dict(zip(fit.names, fit.vif().tolist(), strict=True)),
        "runs": [
            {"run_id": int(run_id), **dict(zip(names, row, strict=True))}
            for run_id, row in zip(analysis.data.run_ids, columns.tolist(), strict=True)
        ],
    }


def interval_to_json(interval: Interval) -> dict[str, float]:
    """Ends and half-width."""
    return {"low": interval.low, "high": interval.high, "half_width": interval.half_width}


def _unusual(analysis: Analysis) -> dict[str, Any]:
    """Further keys of ``diagnostics``: what single runs do, and whether the quadratic's optimum is far from all."""
    fit, ids = analysis.fit, analysis.data.run_ids
    normal, row = normal_plot(fit), analysis.model.matrix(analysis.of_quadratic.point[None, :])
    found = influential_runs(fit)
    return {
        "extrapolated": bool(extrapolated(fit, row)[0]),
        "influential": [{"run_id": int(ids[one.run]), **fields_to_json(one, but="run")} for one in found],
        "normal_plot": {"run_ids": ids[normal.runs].tolist(), **fields_to_json(normal, but="runs")},
    }


def tests_to_json(tests: Sequence[TermTest]) -> list[dict[str, Any]]:
    """Partial F tests that were asked for."""
    return [{"test": one.asked, "terms": list(one.terms), **fields_to_json(one.test)} for one in tests]


def _sources(found: SourceComparison) -> dict[str, Any]:
    return {
        **_of(found.both, "n_simulations", "n_flights", "s_simulation"),
        "s_flight": found.both.s,
        **_of(found, "difference", "interval"),
        **_of(found.both, "prior_sd", "prior_share", "prior_driven"),
        "text": found.text,
    }


def _blocks(found: BlockStudy) -> dict[str, Any]:
    return {
        **_of(found, "effect"),
        "new": {"reason": found.new} if isinstance(found.new, str) else fields_to_json(found.new),
        "s": found.sigma,
        "s_block": found.sigma_block,
        "ratio": {"low": found.ratio[0], "high": found.ratio[1]},
        "note": found.note,
    }
