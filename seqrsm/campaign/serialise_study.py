"""The study of a thorough analysis as part of the document of ``fit --json``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from seqrsm.campaign.analysis import Analysis
from seqrsm.campaign.findings import BlockResponse, BlockStudy, PathPoint, SearchedOptimum, Study, TermChoice
from seqrsm.campaign.interval import Interval
from seqrsm.campaign.term_tests import TermTest
from seqrsm.design.factors import CategoricalFactor
from seqrsm.fit.location import LocationRegion
from seqrsm.fit.profile import PowerProfile

_POINTS = 200


def interval_to_json(interval: Interval) -> dict[str, float]:
    """Ends and half-width."""
    return {"low": interval.low, "high": interval.high, "half_width": interval.half_width}


def study_to_json(analysis: Analysis, study: Study) -> dict[str, Any]:
    """Keys of the document, beside those of the fit; ``{"reason": ...}`` where something cannot be had."""
    return {
        "searched": _searched(study.searched),
        "location": [_location(analysis, region) for region in study.locations]
        if study.locations
        else {"reason": study.no_location},
        "models": _models(study.terms),
        "transform": _profile(study.profile),
        "blocks": None if study.blocks is None else _blocks(study.blocks),
        "ridge": _path(analysis, study.ridge),
        "steepest": _path(analysis, study.steepest),
    }


def study_diagnostics(analysis: Analysis, study: Study) -> dict[str, Any]:
    """Keys of ``diagnostics``."""
    ids = analysis.data.run_ids
    return {
        "extrapolated": study.extrapolated,
        "influential": [
            {
                "run_id": int(ids[run.run]),
                "leverage": run.leverage,
                "cooks_distance": run.cooks_distance,
                "studentised": run.studentised,
                "reasons": list(run.reasons),
            }
            for run in study.influential
        ],
        "normal_plot": {
            "run_ids": ids[study.normal.runs].tolist(),
            "quantiles": study.normal.quantiles,
            "residuals": study.normal.residuals,
            "correlation": study.normal.correlation,
        },
    }


def tests_to_json(tests: Sequence[TermTest]) -> list[dict[str, Any]]:
    """Partial F tests that were asked for."""
    return [
        {
            "test": one.asked,
            "terms": list(one.terms),
            "df": one.test.df,
            "ss": one.test.ss,
            "ms": one.test.ms,
            "f": one.test.f,
            "p": one.test.p,
            "reason": one.test.reason,
        }
        for one in tests
    ]


def _searched(found: SearchedOptimum | str) -> dict[str, Any]:
    if isinstance(found, str):
        return {"reason": found}
    return {
        "optimism": found.optimism,
        "confidence": interval_to_json(found.confidence),
        "prediction": interval_to_json(found.prediction),
        "prediction_mean": interval_to_json(found.prediction_mean),
    }


def _location(analysis: Analysis, region: LocationRegion) -> dict[str, Any]:
    factors: dict[str, Any] = {}
    for factor, found in zip(analysis.region.factors, region.ranges, strict=True):
        if isinstance(factor, CategoricalFactor):
            factors[found.factor] = {"levels": list(found.levels)}
        else:
            factors[found.factor] = {"low": found.low_natural, "high": found.high_natural}
    some = np.unique(np.linspace(0, max(len(region.points) - 1, 0), _POINTS).astype(np.int64))
    return {
        "method": region.method,
        "level": region.level,
        "share": region.share,
        "factors": factors,
        "points": analysis.region.decode(region.points[some]) if len(region.points) else [],
    }


def _models(found: TermChoice | str) -> dict[str, Any]:
    if isinstance(found, str):
        return {"reason": found}
    return {
        "n_models": found.n_models,
        "exhaustive": found.exhaustive,
        "units": [
            {"name": name, "inclusion": float(after), "prior": float(before)}
            for name, after, before in zip(found.units, found.inclusion, found.prior_inclusion, strict=True)
        ],
        "median": list(found.median),
        "best": [{"units": list(units), "probability": share} for units, share in found.models],
        "terms": [
            {"name": name, "mean": float(mean), "sd": float(sd)}
            for name, mean, sd in zip(found.terms, found.coefficient_mean, found.coefficient_sd, strict=True)
        ],
        "optimum": {
            "mean": found.mean,
            "confidence": interval_to_json(found.confidence),
            "prediction": interval_to_json(found.prediction),
        },
    }


def _profile(found: PowerProfile | str) -> dict[str, Any]:
    if isinstance(found, str):
        return {"reason": found}
    return {
        "family": found.family,
        "best": found.best,
        "low": found.low,
        "high": found.high,
        "level": found.level,
        "identity_inside": found.identity_inside,
        "zero_inside": found.zero_inside,
        "powers": found.powers,
        "log_likelihood": found.log_likelihood,
    }


def _blocks(found: BlockStudy) -> dict[str, Any]:
    def response(one: BlockResponse) -> dict[str, Any]:
        return {
            "block": one.block,
            "mean": one.mean,
            "confidence": interval_to_json(one.confidence),
            "prediction": interval_to_json(one.prediction),
        }

    return {
        "effect": found.effect,
        "same": [response(one) for one in found.same],
        "new": {"reason": found.new} if isinstance(found.new, str) else response(found.new),
        "s": found.sigma,
        "s_block": found.sigma_block,
        "ratio": {"low": found.ratio[0], "high": found.ratio[1]},
        "note": found.note,
    }


def _path(analysis: Analysis, path: Sequence[PathPoint]) -> list[dict[str, Any]]:
    return [
        {
            "distance": point.distance,
            "settings": point.settings,
            "coded": dict(zip(analysis.region.names, point.coded.tolist(), strict=True)),
            "mean": point.mean,
            "inside_region": point.inside,
        }
        for point in path
    ]
