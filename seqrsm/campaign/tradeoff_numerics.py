"""Speed against accuracy of the numbers of a campaign: draws of the posterior, precision of the engine, design search.

Every function measures on this campaign's own model, scores and scene, and returns rows; nothing is stored. Seconds
are CPU time of this process, the least of the repeats where there are several.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from seqrsm.analysis.fitted import Fitted
from seqrsm.analysis.posterior import draw_coefficients, future_scores
from seqrsm.arrays import FloatArray, Precision
from seqrsm.campaign.next_runs import CENTRE_REPEATS, rounded_settings, start_size
from seqrsm.campaign.simulation import NO_RUN, scene_at, score_images, simulate_images, task_of
from seqrsm.design.optimal import START_SEARCHES, START_SEARCHES_CONSTRAINED, optimal_design
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.errors import DesignError, UserError
from seqrsm.fit.error_models import Draws, Sampler
from seqrsm.fit.optimum import optimum, optimum_draws
from seqrsm.simulate.radiometer.result import RadiometerImage
from seqrsm.spec.read import ApplicationSpec, CampaignSpec

Quantity = Literal["future score", "utility at the optimum"]

SIZES = (250, 1000, 4000, 16_000)
"""Draws in a set; `fit` takes 4000, a look 1000."""
POOL = 80_000
"""Independent draws that are cut into sets: 5 sets of the largest size."""
CHAINS = 8
"""Runs of emcee with seeds of their own."""


def sampler_rows(
    spec: CampaignSpec,
    application: ApplicationSpec,
    fitted: Fitted,
    *,
    sizes: Sequence[int] = SIZES,
    pool: int = POOL,
    chains: int = CHAINS,
) -> list[dict[str, Any]]:
    """Draws against the Monte Carlo error of the ends of two intervals, by exact draws and by emcee.

    Parameters
    ----------
    spec, application, fitted
        The campaign, one of its applications, and its fit.
    sizes : sequence of int
        Draws in a set.
    pool, chains : int
        Exact draws in all, and runs of emcee; sizes that give fewer than two sets are left out.

    Returns
    -------
    list of dict
        The Monte Carlo error of an interval, from sets of draws. ``method``: "exact", independent draws from the exact
        posterior; "emcee", the ensemble sampler thinned to ``draws``, or the name of what took its place. ``quantity``:
        "future score" at the recommended settings, or "utility at the optimum" over the region. ``draws``, ``sets``:
        draws in a set, and how many sets there were. ``low``, ``high``: ends of the interval, the mean over the sets
        [score units]. ``error_low``, ``error_high``: Monte Carlo standard error of the ends from one set, their
        standard deviation over the sets [score units], itself uncertain by a share of 1 / sqrt(2 (sets - 1)).
        ``seconds``: CPU time of one set; emcee's is that of a whole chain, whatever is kept of it.

        Exact rows are missing where the model has no exact posterior (Student-t errors), those of emcee where the
        program draws exactly whatever is asked for (random blocks; flights beside simulations).

    Raises
    ------
    ConvergenceError
        emcee did not converge.
    """
    best = optimum(fitted.model, fitted.region, fitted.surface.estimate, application.goal)
    row = fitted.surface.rows(best.point[None, :])[0]
    rows: list[dict[str, Any]] = []
    if fitted.surface.errors.exact:
        _, drawn_values, taken = _quantities(spec, application, fitted, row, "exact", pool)
        for n in sizes:
            if pool // n >= 2:
                sets = {name: values[: pool // n * n].reshape(-1, n) for name, values in drawn_values.items()}
                rows += _sampler_rows(spec, "exact", n, sets, {name: s * n / pool for name, s in taken.items()})
    kept = [n for n in sizes if n <= max(sizes[0], 4000)]
    drawn = [
        _quantities(replace(spec, seed=spec.seed + chain), application, fitted, row, "emcee", max(kept))
        for chain in range(chains)
    ]
    methods = sorted({method for method, _, _ in drawn})  # of Student-t errors "gibbs" where emcee does not converge
    for n in kept if chains > 1 and "exact" not in methods else ():
        sets = {name: np.array([_thinned(values[name], n) for _, values, _ in drawn]) for name in drawn[0][1]}
        seconds = {name: min(own[name] for _, _, own in drawn) for name in drawn[0][1]}
        rows += _sampler_rows(spec, " or ".join(methods), n, sets, seconds)
    return rows


def _quantities(
    spec: CampaignSpec, application: ApplicationSpec, fitted: Fitted, row: FloatArray, sampler: Sampler, n: int
) -> tuple[str, dict[Quantity, FloatArray], dict[Quantity, float]]:
    """How draws were made, those (n,) of each quantity [score units], and the CPU time each took [s]."""
    start = time.process_time()
    draws: Draws = draw_coefficients(spec, fitted, sampler=sampler, n_draws=n)
    future = future_scores(spec, fitted, draws, row, 1)
    drawn = time.process_time()
    _, best = optimum_draws(fitted.model, fitted.region, draws.terms, application.goal)
    end = time.process_time()
    return (
        str(draws.made["method"]),
        {"future score": future, "utility at the optimum": fitted.scale.to_score(best)},
        {"future score": drawn - start, "utility at the optimum": end - start},
    )


def _thinned(values: FloatArray, n: int) -> FloatArray:
    """``n`` of the values, evenly spread over the chain; all where there are fewer."""
    keep = np.linspace(0, len(values) - 1, min(n, len(values))).astype(np.int64)
    return values[keep]


def _sampler_rows(
    spec: CampaignSpec,
    method: str,
    n: int,
    sets: Mapping[Quantity, FloatArray],
    seconds: Mapping[Quantity, float],
) -> list[dict[str, Any]]:
    tail = 0.5 * (1.0 - spec.stop.level)
    rows = []
    for name, values in sets.items():
        low, high = np.quantile(values, [tail, 1.0 - tail], axis=1)
        rows.append(
            {
                "method": method,
                "quantity": name,
                "draws": n,
                "sets": len(values),
                "low": float(np.mean(low)),
                "high": float(np.mean(high)),
                "error_low": float(np.std(low, ddof=1)),
                "error_high": float(np.std(high, ddof=1)),
                "seconds": seconds[name],
            }
        )
    return rows


def precision_rows(
    spec: CampaignSpec,
    configurations: Sequence[Mapping[str, float | str]],
    *,
    repeats: int = 3,
) -> list[dict[str, Any]]:
    """Engine in single against double precision, at some configurations of a campaign with a simulator.

    Parameters
    ----------
    spec : CampaignSpec
    configurations : sequence of mapping
        Levels of the factors; one whose sensor cannot be built or cannot image the scene is left out.
    repeats : int
        Images of each precision, of which the fastest counts.

    Returns
    -------
    list of dict
        One image in single and in double precision, everything random drawn alike. ``settings``: natural units.
        ``score32``, ``score64``: score of the first application [score units]. ``median_difference``,
        ``largest_difference``: relative difference of a pixel's power or brightness. ``seconds32``, ``seconds64``: CPU
        time of the image.
    """
    rows = []
    for settings in configurations:
        with contextlib.suppress(UserError):
            rows.append(_precision_row(spec, settings, repeats))
    return rows


def _precision_row(spec: CampaignSpec, settings: Mapping[str, float | str], repeats: int) -> dict[str, Any]:
    task = task_of(spec, NO_RUN, settings)
    scene = scene_at(task.scene)
    precisions: tuple[Precision, ...] = ("float32", "float64")
    pixels, scores, seconds = [], [], []
    for precision in precisions:
        times = []
        for _ in range(max(repeats, 1)):
            start = time.process_time()
            images = simulate_images(task, scene, precision)
            times.append(time.process_time() - start)
        values = [one.brightness_k if isinstance(one, RadiometerImage) else one.intensity for one in images]
        pixels.append(np.concatenate([np.asarray(one, dtype=np.float64).ravel() for one in values]))
        scores.append(score_images(task, task.utilities[0][1], images, scene).value)
        seconds.append(min(times))
    single, double = pixels
    seen = np.isfinite(double) & (double != 0.0)
    difference = np.abs(single[seen] - double[seen]) / np.abs(double[seen])
    return {
        "settings": dict(settings),
        "score32": scores[0],
        "score64": scores[1],
        "median_difference": float(np.median(difference)),
        "largest_difference": float(np.max(difference)),
        "seconds32": seconds[0],
        "seconds64": seconds[1],
    }


def some_configurations(spec: CampaignSpec, n: int) -> list[dict[str, float | str]]:
    """The centre of the region and ``n - 1`` feasible settings spread over it, natural units."""
    points = spec.region.candidates(limit=2000)
    keep = np.random.default_rng(spec.seed).permutation(len(points))[: n - 1]
    return rounded_settings(spec.region, np.vstack([spec.region.centre()[None, :], points[keep]]))


def search_rows(
    spec: CampaignSpec,
    *,
    restarts: Sequence[int] | None = None,
    searches: int = 5,
) -> list[dict[str, Any]]:
    """Restarts of the search of the campaign's start design against the efficiency reached.

    Parameters
    ----------
    spec : CampaignSpec
    restarts : sequence of int, optional
        By default one, an eighth of, as many as, and eight times as many as the campaign itself makes.
    searches : int
        Searches of each, with seeds of their own.

    Returns
    -------
    list of dict
        ``restarts``, ``searches``, ``failed``: local searches in one search, how many searches with seeds of their own,
        and how many found no design at all. ``efficiency``, ``least_efficiency``: median and smallest D-efficiency
        against the best design of all rows, in (0, 1]; nan where all failed. ``d_efficiency``: median against the best
        continuous design, None where that is not known. ``seconds``: CPU time of a search, the median.
    """
    model = QuadraticModel(spec.factors, spec.model.order)
    n = start_size(model, spec) - CENTRE_REPEATS
    centre = np.tile(spec.region.centre(), (CENTRE_REPEATS, 1))
    usual = START_SEARCHES if spec.region.is_box else START_SEARCHES_CONSTRAINED
    wanted = sorted({1, max(usual // 8, 2), usual, 8 * usual}) if restarts is None else list(restarts)
    found: list[tuple[list[float], list[float | None], list[float]]] = []
    for starts in wanted:
        values, against_bound, seconds = [], [], []
        for search in range(searches):
            begin = time.process_time()
            try:
                design = optimal_design(model, spec.region, n, seed=spec.seed + search, starts=starts, fixed=centre)
                values.append(design.value)
                against_bound.append(design.d_efficiency)
            except DesignError:
                pass  # every local search ended in a singular design: counted as failed
            seconds.append(time.process_time() - begin)
        found.append((values, against_bound, seconds))
    best = max((max(values) for values, _, _ in found if values), default=np.nan)
    return [
        {
            "restarts": starts,
            "searches": searches,
            "failed": searches - len(values),
            "efficiency": float(np.median(values)) / best if values else np.nan,
            "least_efficiency": min(values) / best if values else np.nan,
            "d_efficiency": _median([e for e in against_bound if e is not None]),
            "seconds": float(np.median(seconds)),
        }
        for starts, (values, against_bound, seconds) in zip(wanted, found, strict=True)
    ]


def _median(values: Sequence[float]) -> float | None:
    return float(np.median(values)) if values else None
