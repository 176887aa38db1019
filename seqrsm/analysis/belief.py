"""What is believed of the surface: the quadratic, or a process that need not be one, each by its probability.

The probability is that given the scores. Settings, intervals, the place of the optimum and what the settings may lose
come from both; the quadratic's own analysis stays a description.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtr, ndtri, stdtr, stdtrit

from seqrsm.analysis.ground import Ground
from seqrsm.analysis.runs import ScoredRuns
from seqrsm.analysis.scale import Interval, ResponseScale
from seqrsm.analysis.surfaces import Surface
from seqrsm.arrays import FloatArray, IntArray
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.fit.conjugate import where_reached
from seqrsm.fit.error_models import Draws, ErrorModel
from seqrsm.fit.intervals import Interval as Ends
from seqrsm.fit.intervals import Prediction, t_quantile
from seqrsm.fit.least_squares import LeastSquaresFit
from seqrsm.fit.optimum import Goal, Optimum, active_constraints, at_bound, sign_of
from seqrsm.fit.process import FEW, LEAST_RUNS, MOST_SETTINGS, Process, kinds
from seqrsm.plain import counted
from seqrsm.propose.cloud import RADII, climb, cloud_of
from seqrsm.remember import recalled
from seqrsm.rng import generator
from seqrsm.spec.tables import ApplicationSpec

STATED = "a prior is given for its coefficients"
"""Why no process is weighed."""
FAR = "at the optimum of least squares, far from the runs, their mean has a standard error of over two runs' scatter"
"""Why a process is believed alone, whatever the scores favour."""
PRIOR_LOG_ODDS = 0.0
"""Of the process against the quadratic, before the scores: even odds."""

_CERTAIN = 0.01  # a process less probable is left out
_LEAST_DF = 4
"""With fewer residual degrees of freedom the quadratic is believed as the process's trend alone, its coefficients
shrunk: by least squares through nearly every score, their mean may be told at twice the best of them."""
_FAR = 4.0
"""Variance of the quadratic's mean at its own optimum, over that of a run, above which the same holds: of runs that lie
close together least squares were as wild, and told means of ten times the best score."""
_DRAWS, _TINY = 4000, 1e-300
_PAIRS, _OF_SCATTER, _OF_LARGEST = 32, 0.5, 0.1  # of `Fitted.acting_terms`
_MOST_RUNS = 100  # drawn of a mean of future runs


@dataclass(frozen=True, slots=True)
class Departure:
    """What the scores say of a surface that is no quadratic."""

    process: Process | None
    """None where it was not weighed, for ``reason``."""
    log_bayes_factor: float
    """Natural logarithm of the evidence for it over that for the quadratic; nan where it was not weighed."""
    by_scores: float
    """Probability of the process given the scores; 0 where it is below 0.01, or was not weighed."""
    reason: str = ""
    """Why it was not weighed, or is believed alone."""

    @property
    def probability(self) -> float:
        """With which the process is believed: 1 where it is believed alone, else that by the scores."""
        return 1.0 if self.process is not None and self.reason else self.by_scores

    @property
    def believed(self) -> Process | None:
        """The process where it has a probability."""
        return self.process if self.probability > 0.0 else None

    @property
    def favoured(self) -> bool:
        """The scores favour it over the quadratic, of which they leave enough degrees of freedom."""
        return self.by_scores > 0.5 and self.reason in ("", FAR)

    def sd_of_run(self, s: float, errors: ErrorModel, weight: float = 1.0) -> float:
        """Standard deviation of a run of a weight, of scale ``s`` about the quadratic, which holds what that misses."""
        process = self.believed
        s = s if self.probability < 1.0 else 0.0  # of as many scores as terms there is none
        found = errors.run_variance * (1.0 - self.probability) * s**2 + self.common_variance
        if process is not None:
            found += self.probability * errors.run_variance * float(np.mean(process.noise_variance)) / weight
        return float(np.sqrt(found))

    @property
    def common_variance(self) -> float:
        """Of what future runs have in common by the process, times its probability; as `Surface.common_sd` a mean."""
        of_process = 0.0 if self.believed is None else float(np.mean(np.sqrt(self.believed.common_variance)))
        return self.probability * of_process**2


def weigh_departure(surface: Surface, seed: int, stated: bool) -> Departure:
    """Fit a process to the scores that the quadratic was fitted to, and weigh the two; see `Departure`.

    ``stated``: campaign.toml states a prior of its coefficients, which a process knows nothing of.
    """
    model, fit, n = surface.model, surface.fit, len(surface.fit.y)
    reason = STATED if stated else ""
    if not reason and (surface.data.all_equal or (fit.df_residual and not surface.s > 0.0)):
        reason = "it passes through every score"
    if not reason and n < LEAST_RUNS:
        reason = f"it is considered from {LEAST_RUNS} runs on, and there are {n}"
    given, beside = (model, surface.data.points, fit.y, fit.weights), surface.for_process()
    if not reason and (m := len(np.unique(kinds(model, surface.data.points, *beside), axis=0))) > MOST_SETTINGS:
        reason = f"it is considered with up to {MOST_SETTINGS} combinations of levels and blocks, and there are {m}"
    if reason:
        return Departure(None, float("nan"), 0.0, reason)
    # What a look found is confirmed and sampled from by the same scores.
    process = recalled(lambda: Process(*given, generator(seed, n, "process"), *beside), (given, seed, beside))
    if fit.df_residual < _LEAST_DF:
        reason = f"least squares of {counted(n, 'score')} leave fewer than {_LEAST_DF} degrees of freedom"
    probability = 1.0 / (1.0 + np.exp(-np.clip(process.log_bayes_factor + PRIOR_LOG_ODDS, -50.0, 50.0)))
    return Departure(process, process.log_bayes_factor, 0.0 if probability < _CERTAIN else float(probability), reason)


@dataclass(frozen=True, slots=True)
class Fitted:
    """A fitted surface with what it was fitted to, and what is believed of it: both surfaces by their probabilities."""

    application: ApplicationSpec

    region: Region
    model: QuadraticModel
    """The campaign's region, and the terms that are fitted over it."""
    data: ScoredRuns
    scale: ResponseScale

    fit: LeastSquaresFit
    """With blocks and sources as constants: what tests and diagnostics are made of."""
    surface: Surface
    """What the optimum is sought on: that of ``fit``, of the flight where there are two sources, or of the average
    block where blocks are random."""
    departure: Departure
    """What the scores say of a surface that is no quadratic."""
    ground: Ground | None = None
    """What part of the scatter is one ground against another, where it was measured."""

    @property
    def goal(self) -> Goal:
        """Of the application."""
        return self.application.goal

    @property
    def ground_share(self) -> float:
        """Share of a run's variance that future runs over one ground have in common; 0 where it was not measured."""
        return 0.0 if self.ground is None else self.ground.share

    @property
    def run_ratio(self) -> float:
        """Variance of a run where the ground was measured, near the optimum, over that by the scores of the region.

        1 where the scores are not on their own scale, their errors not normal, or no scatter was seen there.
        """
        s, variance = self.fit.s, 0.0 if self.ground is None else self.ground.variance
        if self.scale.kind != "identity" or not (self.surface.errors.exact and s > 0.0 and variance > 0.0):
            return 1.0
        return float(variance / self.departure.sd_of_run(s, self.surface.errors) ** 2)

    def without_far(self, of_quadratic: Optimum) -> Fitted:
        """The same, or with the process alone where the quadratic's optimum is far from all runs: see `_FAR`."""
        departure, at = self.departure, self.surface.rows(of_quadratic.point[None, :])
        if departure.process is None or departure.reason or self.surface.variance_unscaled(at)[0] <= _FAR:
            return self
        return replace(self, departure=replace(departure, reason=FAR))

    def mean(self, points: FloatArray) -> FloatArray:
        """Expected surface (m,) at coded points (m, k)."""
        return self._mean(points, self.departure.believed)

    def _mean(self, points: FloatArray, process: Process | None) -> FloatArray:
        found, share = self.surface.rows(points) @ self.surface.estimate, self.departure.probability
        return found if process is None else (1.0 - share) * found + share * process.mean(points)

    def best(self, of_quadratic: Optimum, made: FloatArray, rng: np.random.Generator) -> Optimum:
        """Where the expected surface is best; the quadratic's optimum where that is taken to be true."""
        process = self.departure.believed
        if process is None:
            return of_quadratic
        sign, few = sign_of(self.goal), process.some(FEW)
        cover = self.region.candidates(limit=1000)
        starts = np.vstack([of_quadratic.point[None, :], cover, made[self.region.feasible(made)]])
        near = climb(lambda at: sign * self._mean(at, few), self.region, starts, rng)[:8]
        (point, *_) = climb(lambda at: sign * self.mean(at), self.region, near, rng, radii=RADII[-2:])
        return replace(
            of_quadratic,
            point=point,
            value=float(self.mean(point[None, :])[0]),
            at_bound=at_bound(self.region, point),
            active_constraints=active_constraints(self.region, point),
            ties=np.empty((0, self.region.k)),
            flat=False,
            exact=False,
        )

    def bands(
        self,
        points: FloatArray,
        level: float,
        weight: Callable[[FloatArray], FloatArray] | FloatArray | float = 1.0,
        replicates: float = 1,
    ) -> Prediction:
        """Mean, confidence interval, and prediction interval of the mean of ``replicates`` runs at points (m, k).

        Quantiles of Student's distribution and normal ones together; on the scale of the fit. ``weight`` may be a
        function of the mean (m,), as `ResponseScale.weight_at`.
        """
        rows, process, share = self.surface.rows(points), self.departure.believed, self.departure.probability
        mean = rows @ self.surface.estimate
        if process is not None:
            means, variances = process.marginals(points)
            mean = (1.0 - share) * mean + share * means.mean(axis=0)
        weight = (weight(mean) if callable(weight) else weight) / (self.surface.errors.run_variance * self.run_ratio)
        of_quadratic = self.surface.predict(rows, level, weight, replicates)
        if process is None:
            return of_quadratic
        noise = process.noise_variance[:, None] / (weight * replicates) + process.common_variance[:, None]
        df = max(self.surface.df_residual, 1)  # without any the process has all weight

        def mixed(own: Ends, added: FloatArray | float) -> Ends:
            # A surface whose intervals are mixtures keeps them: with few flights Student's are twice as wide.
            sd = np.sqrt(variances + added)
            se = 0.5 * (own.high - own.low) / t_quantile(df, level) if share < 1.0 else np.zeros(len(mean))
            tails = (0.5 * (1.0 - level), 0.5 * (1.0 + level))
            return Ends(*(_mixture_quantile(tail, df, of_quadratic.mean, se, means, sd, share) for tail in tails))

        return replace(
            of_quadratic,
            mean=mean,
            confidence=mixed(of_quadratic.confidence, 0.0),
            prediction=mixed(of_quadratic.prediction, noise),
        )

    @property
    def common_sd(self) -> float:
        """Standard deviation of what future runs made together have in common: a new block, where blocks are random."""
        of_quadratic = (1.0 - self.departure.probability) * self.surface.common_sd**2
        return math.sqrt(of_quadratic + self.departure.common_variance)

    def scatter(self, point: FloatArray) -> tuple[float, float]:
        """Standard deviation of a future run, and variance of the mean in its square, at a coded point (k,).

        On the scale of the fit; the run has the weight that is expected there, and a new block where blocks are random.
        """
        at, surface = point[None, :], self.surface
        process, share = self.departure.believed, self.departure.probability
        weight = float(surface.scale.weight_at(self.mean(at))[0])
        of_scores = self.departure.sd_of_run(surface.sd_of_run(weight), surface.errors, weight)
        both = of_scores * math.sqrt(self.run_ratio)
        s = surface.s if share < 1.0 else 0.0
        of_mean = (1.0 - share) * s**2 * float(surface.variance_unscaled(surface.rows(at))[0])
        if process is not None:
            means, variances = process.marginals(at)
            off = np.square(float((surface.rows(at) @ surface.estimate)[0]) - means.mean())
            of_mean += share * float(np.mean(variances) + np.var(means) + (1.0 - share) * off)
        return both, of_mean / both**2 if both else math.nan

    def acting_terms(self) -> int:
        """Terms of the quadratic in factors that matter, where another surface is likelier than it; 0 elsewhere.

        A factor does not matter if its total effect, the standard deviation of the surface where it alone is drawn
        anew (Jansen 1999, Comput. Phys. Commun. 117, 35-43), over all that the scores leave open, is less than half of
        a run's scatter and less than a tenth of the largest.
        """
        process = self.departure.process
        if process is None or not self.departure.favoured:
            return 0
        at, anew = np.split(self.region.sample(2 * _PAIRS, generator(0, 0, "factors that matter")), 2)
        moved = np.repeat(at[None], self.region.k, axis=0)
        each = np.arange(self.region.k)
        moved[each, :, each] = anew.T
        means, covariances = process.some(FEW).joint(np.vstack([at, *moved]))
        i = np.arange(_PAIRS)
        j = _PAIRS * (1 + each[:, None]) + i
        steps = np.square(means[:, j] - means[:, None, i])
        steps += covariances[:, None, i, i] + covariances[:, j, j] - 2.0 * covariances[:, i, j]
        effects = np.sqrt(0.5 * np.mean(steps, axis=(0, 2)))
        scatter = math.sqrt(float(np.mean(process.noise_variance)))
        matter = effects >= min(_OF_SCATTER * scatter, _OF_LARGEST * float(effects.max()))
        names = {name for name, matters in zip(self.region.names, matter, strict=True) if matters}
        return sum(names.issuperset(term.factors) for term in self.surface.model.terms)

    def sd_of_run(self, point: FloatArray, reach: float = 1.0) -> float:
        """Standard deviation of a future run at a coded point (k,) in score units, from so many to either side."""
        half = reach * self.scatter(point)[0]
        low, high = self.scale.to_score(self.mean(point[None, :]), scatter=np.array([-half, half]))
        return float(high - low) / (2.0 * reach)

    def optima(
        self, point: FloatArray, made: FloatArray, n: int, seed: int | np.random.Generator
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """About ``n`` draws of the process's optimum: coded points (n, k), values (n,) there and at ``point`` (k,)."""
        process = self.departure.process
        assert process is not None
        sign = sign_of(self.goal)
        cloud, rng = cloud_of(process, self.region, point, made, sign, seed)
        draws = cloud.draws(-(-n // len(cloud.means)), rng)
        draws = draws[rng.permutation(len(draws))[:n]]
        best = np.argmax(draws, axis=1)
        return cloud.points[best], sign * np.max(draws, axis=1), sign * draws[:, cloud.hat]


def mixed_quantiles(parts: Sequence[tuple[FloatArray, float]], level: float) -> Interval:
    """Equal-tailed interval of samples that are mixed by their shares, 1 in all."""
    values = np.concatenate([sample for sample, _ in parts])
    weights = np.concatenate([np.full(len(sample), share / len(sample)) for sample, share in parts])
    order = np.argsort(values, kind="stable")
    reached = np.cumsum(weights[order]) - 0.5 * weights[order]
    tail = 0.5 * (1.0 - level)
    low, high = np.interp([tail, 1.0 - tail], reached, values[order])
    return Interval(float(low), float(high))


def intervals(
    fitted: Fitted, point: FloatArray, level: float, replicates: Sequence[float], taken_off: float
) -> tuple[float, tuple[Interval, ...]]:
    """Mean, its interval, and intervals of the mean of so many future runs each, at coded settings (k,), score units.

    ``replicates`` need not be whole: n independent runs scatter as the mean of m that have a part in common. The mean
    is less by ``taken_off``, which is `optimism`. That is right on average, of single data sets it is not known much
    better than that it is somewhere between none and twice as much: the intervals reach lower by it and are not moved.
    Where errors are not normal, see `intervals_by_draws`.
    """
    at = point[None, :]
    weight = float(fitted.scale.weight_at(fitted.surface.predict(fitted.surface.rows(at)).mean)[0])
    bands = {m: fitted.bands(at, level, weight, m) for m in dict.fromkeys(replicates)}
    first = bands[replicates[0]]
    plain = (first.confidence, *(bands[m].prediction for m in replicates))
    of_mean, *wide = (Interval(float(one.low[0]), float(one.high[0])).also_less(taken_off) for one in plain)
    ends = [fitted.scale.of_runs(of_mean, one, m) for one, m in zip(wide, replicates, strict=True)]
    found = [
        fitted.scale.in_scores(of_mean.low, of_mean.high),
        *(Interval(float(low), float(high)) for low, high in ends),
    ]
    # Counts that scatter less than counts can: what single runs may score would not hold the mean, see `to_score`.
    held = tuple(one.around(found[0]) for one in found)
    return float(fitted.scale.to_score(first.mean - taken_off)[0]), held


def _mixture_quantile(
    tail: float, df: float, mean: FloatArray, se: FloatArray, means: FloatArray, sd: FloatArray, share: float
) -> FloatArray:
    """Where (m,) the mixture's distribution function is ``tail``.

    Of Student's distributions about ``mean`` (m,), and by ``share`` of normal ones about ``means`` (d, m), each as
    probable, with standard deviations ``se`` (m,) and ``sd`` (d, m).
    """
    se, sd = np.maximum(se, _TINY), np.maximum(sd, _TINY)
    each = np.vstack([mean + se * stdtrit(df, tail), means + sd * ndtri(tail)])
    margin = 1e-9 * (np.abs(each).max(axis=0) + se)

    def below(x: FloatArray, k: IntArray) -> FloatArray:
        of_process = np.mean(ndtr((x - means[:, k]) / sd[:, k]), axis=0)
        return np.asarray((1.0 - share) * stdtr(df, (x - mean[k]) / se[k]) + share * of_process)

    return where_reached(tail, each, margin, below)


def intervals_by_draws(
    fitted: Fitted,
    point: FloatArray,
    level: float,
    replicates: Sequence[float],
    taken_off: float,
    draws: Draws,
    rng: np.random.Generator,
) -> tuple[float, tuple[Interval, ...]]:
    """The same where errors are not normal: Student's interval of least squares knows nothing of heavy tails or counts.

    These are quantiles of posterior draws; ``replicates`` are rounded.
    """
    errors, scale, departure = fitted.surface.errors, fitted.scale, fitted.departure
    process, share = departure.believed, departure.probability
    row = fitted.surface.rows(point[None, :])
    draws = replace(draws, sigma=math.sqrt(fitted.run_ratio) * draws.sigma)
    mean = (1.0 - share) * float(fitted.surface.predict(row).mean[0])
    parts = [(draws.terms @ row[0], draws, 1.0 - share)]
    if process is not None:
        found, spread = process.marginals(point[None, :])
        means, variances = found[:, 0], spread[:, 0]
        mean += share * float(np.mean(means))
        noise, common = fitted.run_ratio * process.noise_variance, process.common_variance
        own = draws.first(_DRAWS)
        of = rng.integers(len(means), size=len(own.sigma))
        here = means[of] + np.sqrt(variances[of]) * rng.standard_normal(len(of))
        block = None if own.sigma_block is None else np.sqrt(common[of])
        parts.append((here, replace(own, sigma=np.sqrt(noise[of]), sigma_block=block), share))
    parts = [part for part in parts if part[2] > 0.0]
    runs = [round(min(max(m, 1), _MOST_RUNS)) for m in replicates]  # without end, where a mean is watched

    def nested(less: float) -> dict[int, Interval]:
        at = [(here - less, own, of) for here, own, of in parts]
        last = mixed_quantiles([(scale.to_score(here), of) for here, _, of in at], level)
        ends = {0: last}
        for m in sorted(set(runs), reverse=True):
            future = [(np.mean(errors.future_scores(own, scale, here, m, rng), axis=1), of) for here, own, of in at]
            # Where the mean is known far worse than runs scatter, draws alone would make one shorter than the other.
            last = ends[m] = mixed_quantiles(future, level).around(last)
        return ends

    plain = nested(0.0)
    wide = {m: one.around(plain[m]) for m, one in nested(taken_off).items()} if taken_off else plain
    return float(scale.to_score(np.array([mean - taken_off]))[0]), (wide[0], *(wide[m] for m in runs))
