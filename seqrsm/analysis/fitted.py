"""The fit of one application's scores: which runs, from which sources, with what errors."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from seqrsm.analysis.belief import Fitted, weigh_departure
from seqrsm.analysis.ground import Ground
from seqrsm.analysis.runs import (
    LISTED_RUNS,
    ScoredRuns,
    block_labels,
    response_scale,
    scored_runs,
    see_names,
    setting_ids,
)
from seqrsm.analysis.scale import ResponseScale
from seqrsm.analysis.surfaces import surface_of
from seqrsm.design.factors import CategoricalFactor, setting_with_unit, settings_text
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.errors import FitError
from seqrsm.fit.estimability import SETTINGS_KNOWN, missing_runs
from seqrsm.fit.least_squares import AliasedError, LeastSquaresFit, block_columns, fit_least_squares
from seqrsm.plain import counted
from seqrsm.spec.read import CampaignSpec
from seqrsm.spec.tables import ApplicationSpec
from seqrsm.store.records import RunRecord

_ONE_MORE = "score several in one more (`seqrsm propose` names them)"


def confirmation_reason(application: str) -> str:
    """What is recorded with a fresh run at an application's optimum; each application is confirmed by its own."""
    return f"fresh run at the optimum of {application}"


def fit_application(
    spec: CampaignSpec, application: ApplicationSpec, runs: Sequence[RunRecord], ground: Ground | None = None
) -> Fitted:
    """Fit one application's scores; ``ground``: what part of their scatter is the ground's; errors of `fit_surface`."""
    region = spec.region
    data = scored_runs(region, runs, application.name)
    see_names(spec, runs, application.name)
    scale = response_scale(spec, data)
    try:
        fit = fit_surface(spec, data, scale)
    except FitError as error:
        field = f"application '{application.name}'" if len(spec.applications) > 1 else None
        raise FitError(*(replace(problem, field=field) for problem in error.problems)) from None
    surface = surface_of(spec, data, scale, fit, ground)
    departure = weigh_departure(surface, spec.seed, application.prior is not None)
    if "flight" in data.sources:  # over the real ground
        ground = None
    return Fitted(application, region, surface.model, data, scale, surface.fit, surface, departure, ground)


def fit_surface(spec: CampaignSpec, data: ScoredRuns, scale: ResponseScale) -> LeastSquaresFit:
    """Least-squares fit on the scale of ``[model] response``, with blocks and sources as effects.

    FitError of fewer scores than terms, or of terms that the runs cannot tell apart: with runs that would mend it.
    """
    model, labels = spec.quadratic, block_labels(spec, data)
    columns, names = block_columns(labels)
    n, needed = len(data.scores), model.p + len(names)
    if n < needed:
        message = f"{counted(n, 'scored run')} cannot determine {needed} terms"
        if not n:
            first = "`seqrsm run` simulates some." if spec.simulator else "`seqrsm propose` names runs to score."
            raise FitError(message, first)
        if n >= model.p and 2 * len(names) >= n:  # each further run would bring a block
            message += f", {len(names)} of them for blocks"
            raise FitError(message, f"Blocks need several runs each: {_ONE_MORE}, or omit the block.")
        raise FitError(message, _remedy(spec, data, "Score more runs", needed - n))
    Z = np.hstack([model.matrix(data.points), columns])
    try:
        return fit_least_squares(
            Z,
            scale.values,
            [*model.terms, *names],
            weights=spec.errors.weights(Z, scale.values, scale.weights),
            setting_ids=setting_ids(data.points),
            block_ids=labels,
            inflation=spec.errors.inflation,
            tolerance=SETTINGS_KNOWN,
        )
    except AliasedError as error:
        problem = replace(error.problems[0], remedy=_remedy(spec, data, "Add runs", n_aliased=error.n_dependent))
        if unvaried := list(_unvaried(spec, data)):
            problem = replace(problem, message="; ".join(unvaried))
        raise FitError(problem) from None


def _unvaried(spec: CampaignSpec, data: ScoredRuns) -> Iterator[str]:
    """Levels at which no run was scored and factors of one setting: new in the campaign, which has other runs."""
    for factor, column in zip(spec.factors, data.points.T, strict=True):
        if isinstance(factor, CategoricalFactor):
            unseen = [level for code, level in enumerate(factor.levels) if code not in column]
            if unseen:
                yield f"no run has a score yet at {factor.name} {' or '.join(unseen)}"
        elif np.ptp(column) == 0.0:
            setting = spec.region.decode(data.points[:1])[0][factor.name]
            yield f"all scored runs have {factor.name} {setting_with_unit(factor, setting)}"


def _remedy(spec: CampaignSpec, data: ScoredRuns, start: str, n_short: int = 0, n_aliased: int = 0) -> str:
    """Runs that would make every term estimable, in words; or why none would."""
    model, region = spec.quadratic, spec.region
    missing, unresolved = missing_runs(model, region, data.points)
    missing_of_first, unresolved_of_first = missing_runs(QuadraticModel(region.factors, 1), region, data.points)
    plain = model.order == 2 and not unresolved_of_first and (bool(unresolved) or not len(missing_of_first))
    or_plain = ", or set [model] order = 1." if plain else "."
    if unresolved:
        return f"No run in the region separates {', '.join(unresolved)}: change the factors or constraints{or_plain}"
    if not len(missing):
        least = max(n_short, n_aliased)
        if n_aliased:
            return f"Blocks and settings are confounded: {_ONE_MORE}, or omit the block."
        return f"{start}: at least {least} more (`seqrsm propose` names good ones){or_plain}"
    shown = "; ".join(settings_text(region.factors, settings) for settings in region.decode(missing[:LISTED_RUNS]))
    count = len(missing)
    more = f" and {count - LISTED_RUNS} more (`seqrsm propose` names them)" if count > LISTED_RUNS else ""
    return f"{start}; {count} at these settings would suffice: {shown}{more}{or_plain}"
