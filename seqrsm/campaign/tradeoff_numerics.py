"""Speed against accuracy of the numbers of a campaign: draws of the posterior, precision of the engine, design search.

Every function measures on this campaign's own model, scores and scene, and returns rows; nothing is stored. Seconds
are CPU time of this process, the least of the repeats where there are several.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from seqrsm.analysis.fitted import Fitted
from seqrsm.analysis.posterior import Draws, Sampler, draw_coefficients, future_scores
from seqrsm.arrays import FloatArray
from seqrsm.campaign.engines import ENGINES
from seqrsm.campaign.next_runs import CENTRE_REPEATS, rounded_settings, start_size
from seqrsm.campaign.simulation import NO_RUN, simulate_image, task_of
from seqrsm.design.optimal import START_SEARCHES, START_SEARCHES_CONSTRAINED, optimal_design
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.errors import DesignError, UserError
from seqrsm.fit.optimum import optimum, optimum_draws
from seqrsm.simulate.radar.psm import Precision
from seqrsm.simulate.radiometer.result import RadiometerImage
from seqrsm.spec.read import ApplicationSpec, CampaignSpec

Quantity = Literal["future score", "utility at the optimum"]

SIZES = (250, 1000, 4000, 16_000)
"""Draws in a set; `fit` takes 4000, a look 1000."""
POOL = 80_000
"""Independent draws that are cut into sets: 5 sets of the largest size."""
CHAINS = 8
"""Runs of emcee with seeds of their own."""


@dataclass(frozen=True, slots=True)
class SamplerRow:
    """Monte Carlo error of an interval of the posterior, from sets of draws.

    Attributes
    ----------
    method : str
        "exact": independent draws from the exact posterior; "emcee": the ensemble sampler thinned to ``draws``, or the
        name of what took its place.
    quantity : str
        "future score" at the recommended settings, or "utility at the optimum" over the region.
    draws, sets : int
        Draws in a set, and how many sets there were.
    low, high : float
        Ends of the interval, the mean over the sets [score units].
    error_low, error_high : float
        Monte Carlo standard error of the ends from one set: their standard deviation over the sets [score units].
        It is itself uncertain by a share of 1 / sqrt(2 (sets - 1)).
    seconds : float
        CPU time of one set; emcee's is that of a whole chain, whatever is kept of it.
    """

    method: str
    quantity: Quantity
    draws: int
    sets: int
    low: float
    high: float
    error_low: float
    error_high: float
    seconds: float


@dataclass(frozen=True, slots=True)
class PrecisionRow:
    """One image in single and in double precision, everything random drawn alike.

    Attributes
    ----------
    settings : dict
        Natural units.
    score32, score64 : float
        Score of the first application [score units].
    median_difference, largest_difference : float
        Relative difference of a pixel's power or brightness.
    seconds32, seconds64 : float
        CPU time of the image.
    """

    settings: dict[str, float | str]
    score32: float
    score64: float
    median_difference: float
    largest_difference: float
    seconds32: float
    seconds64: float


@dataclass(frozen=True, slots=True)
class SearchRow:
    """Start designs found with a number of restarts.

    Attributes
    ----------
    restarts, searches, failed : int
        Local searches in one search, how many searches with seeds of their own, and how many found no design at all.
    efficiency, least_efficiency : float
        Median and smallest D-efficiency against the best design of all rows, in (0, 1]; nan where all failed.
    d_efficiency : float or None
        Median against the best continuous design, where that is known.
    seconds : float
        CPU time of a search, the median.
    """

    restarts: int
    searches: int
    failed: int
    efficiency: float
    least_efficiency: float
    d_efficiency: float | None
    seconds: float


def sampler_rows(
    spec: CampaignSpec,
    application: ApplicationSpec,
    fitted: Fitted,
    *,
    sizes: Sequence[int] = SIZES,
    pool: int = POOL,
    chains: int = CHAINS,
) -> tuple[SamplerRow, ...]:
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
    tuple of SamplerRow
        Exact rows are missing where the model has no exact posterior (Student-t errors), those of emcee where the
        program draws exactly whatever is asked for (random blocks; flights beside simulations).

    Raises
    ------
    ConvergenceError
        emcee did not converge.
    """
    best = optimum(fitted.model, fitted.region, fitted.beta, application.goal)
    row = fitted.model.matrix(best.point[None, :])[0]
    exact = spec.model.errors == "normal"
    rows: list[SamplerRow] = []
    if exact:
        one = _quantities(spec, application, fitted, row, "exact", pool)
        for n in sizes:
            if pool // n >= 2:
                sets = {name: values[: pool // n * n].reshape(-1, n) for name, values in one.values.items()}
                rows += _sampler_rows(spec, "exact", n, sets, {name: s * n / pool for name, s in one.seconds.items()})
    kept = [n for n in sizes if n <= max(sizes[0], 4000)]
    drawn = [
        _quantities(replace(spec, seed=spec.seed + chain), application, fitted, row, "emcee", max(kept))
        for chain in range(chains)
    ]
    methods = sorted({one.method for one in drawn})  # of Student-t errors "gibbs" where emcee does not converge
    for n in kept if chains > 1 and "exact" not in methods else ():
        sets = {name: np.array([_thinned(one.values[name], n) for one in drawn]) for name in drawn[0].values}
        seconds = {name: min(one.seconds[name] for one in drawn) for name in drawn[0].values}
        rows += _sampler_rows(spec, " or ".join(methods), n, sets, seconds)
    return tuple(rows)


@dataclass(frozen=True, slots=True)
class _Drawn:
    """Draws (m,) of each quantity [score units], how they were made, and the CPU time each took [s]."""

    method: str
    values: dict[Quantity, FloatArray]
    seconds: dict[Quantity, float]


def _quantities(
    spec: CampaignSpec, application: ApplicationSpec, fitted: Fitted, row: FloatArray, sampler: Sampler, n: int
) -> _Drawn:
    start = time.process_time()
    draws: Draws = draw_coefficients(spec, fitted, sampler=sampler, n_draws=n)
    future = future_scores(spec, fitted, draws, row, 1)
    drawn = time.process_time()
    _, best = optimum_draws(fitted.model, fitted.region, draws.terms, application.goal)
    end = time.process_time()
    return _Drawn(
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
) -> list[SamplerRow]:
    tail = 0.5 * (1.0 - spec.stop.level)
    rows = []
    for name, values in sets.items():
        low, high = np.quantile(values, [tail, 1.0 - tail], axis=1)
        rows.append(
            SamplerRow(
                method,
                name,
                n,
                len(values),
                float(np.mean(low)),
                float(np.mean(high)),
                float(np.std(low, ddof=1)),
                float(np.std(high, ddof=1)),
                seconds[name],
            )
        )
    return rows


def precision_rows(
    spec: CampaignSpec,
    configurations: Sequence[Mapping[str, float | str]],
    *,
    repeats: int = 3,
) -> tuple[PrecisionRow, ...]:
    """Engine in single against double precision, at some configurations of a campaign with a simulator.

    Parameters
    ----------
    spec : CampaignSpec
    configurations : sequence of mapping
        Levels of the factors; one whose sensor cannot be built or cannot image the scene is left out.
    repeats : int
        Images of each precision, of which the fastest counts.
    """
    rows = []
    for settings in configurations:
        with contextlib.suppress(UserError):
            rows.append(_precision_row(spec, settings, repeats))
    return tuple(rows)


def _precision_row(spec: CampaignSpec, settings: Mapping[str, float | str], repeats: int) -> PrecisionRow:
    task = task_of(spec, NO_RUN, settings)
    engine, utility = ENGINES[task.engine], task.utilities[0][1]
    precisions: tuple[Precision, ...] = ("float32", "float64")
    pixels, scores, seconds = [], [], []
    for precision in precisions:
        times = []
        for _ in range(max(repeats, 1)):
            start = time.process_time()
            image, scene = simulate_image(task, precision)
            times.append(time.process_time() - start)
        values = image.brightness_k if isinstance(image, RadiometerImage) else image.intensity
        pixels.append(np.asarray(values, dtype=np.float64))
        scores.append(engine.score(utility, image, scene, seed=task.seed, run_id=task.run_id).value)
        seconds.append(min(times))
    single, double = pixels
    seen = np.isfinite(double) & (double != 0.0)
    difference = np.abs(single[seen] - double[seen]) / np.abs(double[seen])
    return PrecisionRow(
        dict(settings),
        scores[0],
        scores[1],
        float(np.median(difference)),
        float(np.max(difference)),
        seconds[0],
        seconds[1],
    )


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
) -> tuple[SearchRow, ...]:
    """Restarts of the search of the campaign's start design against the efficiency reached.

    Parameters
    ----------
    spec : CampaignSpec
    restarts : sequence of int, optional
        By default one, an eighth of, as many as, and eight times as many as the campaign itself makes.
    searches : int
        Searches of each, with seeds of their own.
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
    return tuple(
        SearchRow(
            starts,
            searches,
            searches - len(values),
            float(np.median(values)) / best if values else np.nan,
            min(values) / best if values else np.nan,
            _median([e for e in against_bound if e is not None]),
            float(np.median(seconds)),
        )
        for starts, (values, against_bound, seconds) in zip(wanted, found, strict=True)
    )


def _median(values: Sequence[float]) -> float | None:
    return float(np.median(values)) if values else None
