"""The surface of a fit, whatever it is made from: one class, and one more for each further structure of its runs.

Each holds its model of errors too. What is said of a surface beyond these members is said by none: whoever looks for
the optimum, its intervals or the next runs asks them, and `surface_of` chooses the class.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar, Final

import numpy as np
from numpy.random import Generator

from seqrsm.analysis.ground import Ground, prior_of_difference
from seqrsm.analysis.runs import ScoredRuns, block_labels, counts_of
from seqrsm.analysis.scale import Interval, ResponseScale
from seqrsm.arrays import FloatArray
from seqrsm.decide.sources import (
    SourceFit,
    blocks_within,
    discrepancy_sd,
    fit_sources,
    guessed_sd,
    source_prior,
    to_flight,
)
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.errors import FitError
from seqrsm.fit.blocks import RandomBlockPosterior, fit_random_blocks
from seqrsm.fit.conjugate import LinearBounds, NormalInverseGamma, Prior, weakly_informative, with_further, within
from seqrsm.fit.error_models import Draws, ErrorModel, LinearRuns, Made, Sampler, enough
from seqrsm.fit.intervals import Prediction, known
from seqrsm.fit.least_squares import LeastSquaresFit
from seqrsm.fit.process import Blocks, Sources
from seqrsm.plain import counted
from seqrsm.spec.read import CampaignSpec

_TOO_FAR = 2.0
"""Prior standard deviations beyond which the mean discrepancy is more than its prior allows for."""

_BEYOND: Final = math.log(20.0)
"""Log Bayes factor from which the difference is no ground's that the tables allow; 20 to 1 against one (assumed)."""


@dataclass(frozen=True, slots=True)
class SourceComparison:
    """Simulation against flight, in score units."""

    both: SourceFit
    """How many runs of each there are, their scatter, and what the prior says of the difference."""
    difference: float
    """Flight less simulation at the recommended settings."""
    interval: Interval
    """Credible interval of the difference."""
    text: str
    """One sentence."""


@dataclass(frozen=True, slots=True)
class Surface:
    """A fitted response surface with its errors, on the scale of the fit; of flights where there are two sources.

    As it stands here that of least squares: one source, blocks as constants; other structures inherit, and say what is
    otherwise with them. ``rows`` are what its mean is linear in, (m, c): `rows` makes them of coded points, and
    ``draws(...).terms`` are coefficients of the same columns.
    """

    errors: ErrorModel
    """How scores scatter about it."""
    model: QuadraticModel
    data: ScoredRuns
    scale: ResponseScale

    fit: LeastSquaresFit
    """With blocks and sources as constants, behind the terms of the model."""
    estimate: FloatArray
    """(c,): coefficients of the mean whose optimum is sought."""
    s: float
    """Standard deviation of a future run of weight 1; in a new block where blocks are random."""
    df_residual: int
    """Degrees of freedom of ``s``."""
    n_terms: int
    """Terms that have used up runs."""
    note: str
    """What has to be said of it beside the figures; empty where nothing has."""

    fixed_blocks: ClassVar[bool] = True
    """Blocks, where there are some, differ by constants."""

    def rows(self, points: FloatArray) -> FloatArray:
        """Rows (m, c) of coded points (m, k)."""
        return self.model.matrix(points)

    def predict(
        self, rows: FloatArray, level: float = 0.95, weight: float | FloatArray = 1.0, replicates: float = 1
    ) -> Prediction:
        """Mean, confidence interval, and prediction interval of the mean of ``replicates`` future runs of a weight.

        Here those of the average block.
        """
        return self.fit.predict(rows, level, weight, replicates)

    def variance_unscaled(self, rows: FloatArray) -> FloatArray:
        """Variance (m,) of the mean, in units of ``s`` squared."""
        return self.fit.variance_unscaled(rows)

    @property
    def error_covariance(self) -> FloatArray:
        """Covariance (c, c) of the errors of ``estimate`` that new scores would bring."""
        return self.s**2 * self.fit.covariance_unscaled[: self.model.p, : self.model.p]

    def draws(
        self, stated: NormalInverseGamma | None, bounds: LinearBounds | None, sampler: Sampler, n: int, rng: Generator
    ) -> Draws:
        """About ``n`` posterior draws under the prior that is ``stated`` and ``bounds`` of single terms.

        By the errors; without a stated prior a flat one where runs can carry it: credible and t intervals agree.
        """
        p, fit = self.model.p, self.fit
        prior = None if fit.df_residual > 0 else weakly_informative(fit.kinds, fit.y)
        if stated is not None:
            prior = with_further(stated, p, np.zeros(fit.n_terms - p))
        weights = self.errors.sampled_weights(fit.weights, self.scale.weights)
        runs = self._runs(fit.Z, weights, prior, stated)
        return self.errors.draws(runs, bounds, sampler, n, rng)

    def for_process(self) -> tuple[Sources | None, Blocks | None]:
        """What a process beside it knows of sources and blocks."""
        return None, _of_fixed(self.fit.Z[:, self.estimate.size :])

    def compare(self, point: FloatArray, level: float, unit: str) -> SourceComparison | None:
        """Simulation against flight at a coded point (k,), in the score's unit; None where there is one source."""
        del point, level, unit
        return None

    def sd_of_run(self, weight: float) -> float:
        """Scale of the scatter of a future run of a weight; in a new block where blocks are random."""
        return self.s / float(np.sqrt(weight))

    @property
    def common_sd(self) -> float:
        """What future runs made together have in common scatters so much."""
        return 0.0

    def days(self, spec: CampaignSpec) -> RandomBlockPosterior | None:
        """Its blocks as a random effect, fitted for this where they are constants; None where errors know none."""
        return random_blocks(spec, self.data, self.scale, self.fit) if self.errors.random_blocks else None

    def _runs(self, Z: FloatArray, weights: FloatArray, prior: Prior, stated: NormalInverseGamma | None) -> LinearRuns:
        fit, p = self.fit, self.model.p
        needs = f'errors = "{self.errors.name}"'
        counts = counts_of(self.data, needs) if self.errors.of_counts else (None, None)
        return LinearRuns(fit, p, Z, fit.y, weights, prior, lambda beta: beta[:, :p], True, 1.0, stated, *counts)


@dataclass(frozen=True, slots=True)
class RandomBlocks(Surface):
    """Blocks as a random effect: the surface of the average block, and future runs in a new one."""

    posterior: RandomBlockPosterior
    """All runs of a future mean are made in one block."""

    fixed_blocks: ClassVar[bool] = False

    def predict(
        self, rows: FloatArray, level: float = 0.95, weight: float | FloatArray = 1.0, replicates: float = 1
    ) -> Prediction:
        """Of the average block, and of runs in a new one."""
        return self.posterior.predict(rows, level, weight=weight, replicates=replicates)

    def variance_unscaled(self, rows: FloatArray) -> FloatArray:
        """See `Surface`."""
        return np.square(self.posterior.predict(rows).se_mean / self.s)

    @property
    def error_covariance(self) -> FloatArray:
        """Of the mixture over the ratios of the variances."""
        found = self.posterior
        size, away = np.sqrt(found.shares) * found.s, found.mean - found.estimate
        factor = size[:, None, None] * found.factor
        return np.asarray(np.einsum("cpq,crq->pr", factor, factor) + (found.shares[:, None] * away).T @ away)

    def draws(
        self, stated: NormalInverseGamma | None, bounds: LinearBounds | None, sampler: Sampler, n: int, rng: Generator
    ) -> Draws:
        """Without emcee, whatever the sampler; the prior is flat."""
        del stated, sampler
        if not self.errors.exact:
            assert self.fit.block_ids is not None
            runs = self.rows(self.data.points), self.fit.y, self.scale.weights, self.fit.block_ids
            return self.errors.draws_of_days(*runs, bounds, n, rng)
        (beta, sigma, of_blocks), share = within(partial(self.posterior.draws, rng=rng), bounds, n)
        made: Made = {"method": "exact", "draws": len(sigma), "blocks": "random"}
        why = "exactly, not by emcee: the exact form is known with random blocks"
        return Draws(beta, sigma, made, share, sigma_block=of_blocks, instead=why)

    def for_process(self) -> tuple[Sources | None, Blocks | None]:
        """Future runs are made in a new block."""
        assert self.fit.block_ids is not None
        return None, Blocks(np.eye(1 + max(self.fit.block_ids))[self.fit.block_ids], new=True)

    def sd_of_run(self, weight: float) -> float:
        """Its weight is that of its own error alone."""
        common = self.common_sd**2
        return float(np.sqrt((self.s**2 - common) / weight + common / self.errors.run_variance))

    @property
    def common_sd(self) -> float:
        """The block."""
        return self.posterior.s_of_days

    def days(self, spec: CampaignSpec) -> RandomBlockPosterior | None:
        """Those of the fit."""
        del spec
        return self.posterior


@dataclass(frozen=True, slots=True)
class TwoSources(Surface):
    """Simulations and flights: the flight's surface."""

    both: SourceFit

    def predict(
        self, rows: FloatArray, level: float = 0.95, weight: float | FloatArray = 1.0, replicates: float = 1
    ) -> Prediction:
        """Of flights."""
        return self.both.predict(rows, level, weight, replicates)

    def variance_unscaled(self, rows: FloatArray) -> FloatArray:
        """See `Surface`."""
        return self.both.variance_unscaled(rows)

    @property
    def error_covariance(self) -> FloatArray:
        """Of the simulation's surface: the discrepancy has a prior, and what a prior holds back is not chosen by."""
        factor = self.both.s_simulation * self.both.posterior.factor[: self.model.p]
        return np.asarray(factor @ factor.T)

    def draws(
        self, stated: NormalInverseGamma | None, bounds: LinearBounds | None, sampler: Sampler, n: int, rng: Generator
    ) -> Draws:
        """Where errors are normal exact, whatever the sampler, unless hardly any draw holds the bounds."""
        both, p = self.both, self.model.p
        Z, flights = both.runs.Z, both.runs.flights
        weights = np.where(flights, both.flight_weight, 1.0) * self.scale.weights
        prior = source_prior(self.model, Z.shape[1] - 2 * p, both.prior_sd, both.s_simulation, stated)
        runs = replace(
            self._runs(Z, weights, prior, stated),
            to_terms=partial(to_flight, self.model),
            own_columns=False,
            sigma_unit=float(1.0 / np.sqrt(both.flight_weight)),
        )
        if self.errors.exact and self.fit.sse > 0.0:
            draw = partial(both.draws, rng=rng, base=stated)
            (beta, sigma), share = within(draw, runs.seen_from_all(bounds), n)
            if bounds is None or enough(len(sigma), n):
                made: Made = {"method": "exact", "draws": len(sigma), "sources": 2}
                why = "exactly, not by emcee: the exact form is known with simulations and flights"
                return Draws(to_flight(self.model, beta), sigma, made, share, instead=why)
        return self.errors.draws(runs, bounds, sampler, n, rng)

    def for_process(self) -> tuple[Sources | None, Blocks | None]:
        """The same difference, flights the own source."""
        both = self.both
        difference = discrepancy_sd(self.model, both.prior_sd)
        sources = Sources(both.runs.flights, difference, both.flight_weight, both.runs.ratio)
        return sources, _of_fixed(both.runs.Z[:, 2 * self.model.p :])

    def compare(self, point: FloatArray, level: float, unit: str) -> SourceComparison | None:
        """On a transformed scale the difference is taken in scores."""
        found, row = self.both, self.rows(point[None, :])
        simulated = float((row @ found.simulation)[0])
        mean, low, high = found.discrepancy(row[0], level)

        def in_scores(difference: float) -> float:
            ends = self.scale.in_scores(simulated, simulated + difference)
            return ends.high - ends.low

        difference, interval = in_scores(mean), Interval(in_scores(low), in_scores(high))
        source = "the prior" if found.prior_driven else "the flights"
        told, *ends = (known(value, interval.half_width) for value in (difference, interval.low, interval.high))
        sign = "+" if float(told) > 0.0 else ""
        text = (
            f"Model discrepancy at the recommended settings: flights score {f'{sign}{told} {unit}'.rstrip()} "
            f"relative to simulations ({100 * level:g} % credible interval {ends[0]} to {ends[1]}). "
            f"Over the region it rests mainly on {source} after "
            f"{counted(found.n_flights, 'flight')} ({100 * found.prior_share:.0f} % of the prior variance of its terms "
            "remains). All intervals are for flights."
        )
        return SourceComparison(found, difference, interval, text)

    def days(self, spec: CampaignSpec) -> RandomBlockPosterior | None:
        """How blocks differ is not studied beside another source."""
        del spec
        return None


def _of_fixed(contrasts: FloatArray) -> Blocks | None:
    """Effects of blocks about their mean, from contrasts (n, e) of them."""
    if not contrasts.size:
        return None
    return Blocks(contrasts @ np.linalg.pinv(np.unique(contrasts, axis=0)), new=False)


def expected_of_flights(
    spec: CampaignSpec, data: ScoredRuns, scale: ResponseScale, ground: Ground | None
) -> tuple[float, float]:
    """How flights may differ from simulations: `fit_sources`' ``prior_sd`` and ``ratio``.

    Flights share one of the grounds that simulations are drawn from: they depart from the surface of simulations as
    grounds do, and scatter by chance alone.
    """
    if ground is None or ground.sd_ground == 0.0 or scale.kind != "identity":
        return spec.model.discrepancy_sd or guessed_sd(scale.values), 1.0
    prior_sd = spec.model.discrepancy_sd or prior_of_difference(ground, spec.quadratic, data.points)
    return prior_sd, 1.0 / (1.0 - ground.share)


def surface_of(
    spec: CampaignSpec, data: ScoredRuns, scale: ResponseScale, fit: LeastSquaresFit, ground: Ground | None
) -> Surface:
    """The surface that runs and specification call for; errors of `random_blocks`.

    ``ground`` tells how flights may differ from simulations.
    """
    model = spec.quadratic
    given = (spec.errors, model, data, scale, fit)
    if spec.model.block_effect == "random" and len(set(block_labels(spec, data))) > 1:
        days = random_blocks(spec, data, scale, fit)
        note = f"{days.reason[:1].upper()}{days.reason[1:]}." if days.reason else ""
        # random blocks are no terms
        return RandomBlocks(*given, days.estimate, days.s_new_day, int(days.df), model.p, note, days)
    if len(set(data.sources)) == 1:
        return Surface(*given, fit.estimate[: model.p], fit.s, fit.df_residual, fit.n_terms, "")
    flights = np.array([source == "flight" for source in data.sources])
    prior_sd, ratio = expected_of_flights(spec, data, scale, ground)
    blocks = blocks_within(block_labels(spec, data), flights)
    fitted = partial(
        fit_sources, model, data.points, scale.values, flights, weights=fit.weights, extra=blocks, ratio=ratio
    )
    both, wide, beyond = fitted(prior_sd=prior_sd), guessed_sd(scale.values), False
    if spec.model.discrepancy_sd is None and wide > prior_sd:  # else few flights that agree pass for wild scatter
        guessed = fitted(prior_sd=wide)
        beyond = guessed.log_evidence - both.log_evidence > _BEYOND
        both = guessed if beyond else both
    off = abs(float((both.estimate - both.simulation)[0])) / both.prior_sd
    note = ""
    if off > _TOO_FAR:
        note = (
            f"Flights depart from simulations by {off:.1f} times the prior standard deviation, which draws the "
            "estimate towards the simulations: raise [model] discrepancy_sd."
        )
    elif beyond:
        note = (
            "Flights depart from simulations by far more than the uncertainty of the tables: the prior standard "
            "deviation of their difference is a guess from the scores ([model] discrepancy_sd)."
        )
    elif both.prior_driven:
        note = (
            f"With {counted(both.n_flights, 'flight')} the difference between flight and simulation is mostly what the "
            "prior says ([model] discrepancy_sd)."
        )
    return TwoSources(*given, both.estimate, both.s, int(both.df_residual), fit.n_terms, note, both)


def random_blocks(
    spec: CampaignSpec, data: ScoredRuns, scale: ResponseScale, fit: LeastSquaresFit
) -> RandomBlockPosterior:
    """Surface of the average block, with blocks as a random effect.

    FitError of one block, two sources, or no scatter.
    """
    if len(set(data.sources)) > 1:
        remedy = 'Set [model] block_effect = "fixed".'
        raise FitError("random blocks need scores from one source; here are simulations and flights", remedy)
    labels = block_labels(spec, data)
    Z = spec.quadratic.matrix(data.points)
    return fit_random_blocks(Z, scale.values, labels, weights=fit.weights, inflation=spec.errors.inflation)
