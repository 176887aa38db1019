"""What one look at the scores finds: surface, optimum, intervals, posterior, decision, and what a thorough study adds.

Values only, in score units unless an attribute says otherwise. Where something cannot be known, a sentence that says
why stands in its place.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from seqrsm.analysis.belief import Fitted
from seqrsm.analysis.gap import Gap
from seqrsm.analysis.ground import Ground
from seqrsm.analysis.runs import ScoredRuns
from seqrsm.analysis.scale import Interval, ResponseScale
from seqrsm.analysis.surfaces import SourceComparison
from seqrsm.arrays import FloatArray
from seqrsm.decide.stopping import Decision
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.fit.canonical import StationaryPoint
from seqrsm.fit.least_squares import LeastSquaresFit
from seqrsm.fit.optimum import Goal, Optimum


@dataclass(frozen=True, slots=True)
class BlockResponse:
    """The recommended settings in a block not yet run, by the quadratic and not corrected for selection bias.

    Mean of the average block, its interval, that of one run.
    """

    mean: float
    confidence: Interval
    prediction: Interval


@dataclass(frozen=True, slots=True)
class BlockStudy:
    """How blocks (flight days) differ."""

    effect: str
    """Either "fixed" or "random", of the fit."""
    new: BlockResponse | str
    """In a block not yet run: the average block for the mean, one more draw of the block effect for the run."""
    sigma: float
    sigma_block: float
    """Standard deviations of a run and of the blocks by restricted maximum likelihood, on the scale of the fit; nan
    where they cannot be had."""
    ratio: tuple[float, float]
    """Credible interval of sigma_block / sigma."""
    note: str
    """Why intervals rest on the prior of how blocks differ; empty when there are blocks enough."""


@dataclass(frozen=True, slots=True)
class FactorImportance:
    """Partial F test (RSL TR 380-1 eq. (2-14)) of all terms that hold a factor, and its share of the variance.

    ``share`` is what it explains alone of the variance of the fitted surface over the region's box, ``share_total``
    that with all of its products (Sobol indices); nan where the surface is flat.
    """

    factor: str
    df: int
    f: float
    p: float
    share: float = float("nan")
    share_total: float = float("nan")


@dataclass(frozen=True, slots=True)
class OptimumEstimate:
    """The estimated optimum and the three intervals there, in score units."""

    settings: dict[str, float | str]
    """Natural units, by factor name."""
    point: FloatArray
    """(k,): coded."""
    at_bound: dict[str, str]
    """Numeric factors whose optimum lies at an end of their range, and which: "low" or "high"."""
    active_constraints: tuple[str, ...]
    """Expressions of the constraints that hold with equality there."""
    mean: float
    """Estimated mean utility there."""
    confidence: Interval
    """Of the mean utility at these settings."""
    prediction: Interval
    """Of one future run (eq. (2-23) with the factor S)."""
    prediction_mean: Interval
    """Of the mean of ``replicates`` future runs, over one ground."""
    replicates: int
    """m of ``prediction_mean``."""
    level: float
    """Two-sided probability of all."""
    whole: Interval
    by_chance: Interval
    """The interval that the stop rule watches: with what is not known of the ground, and the part of it that is the
    chance of future occasions and of the runs made."""
    ground: Ground | None = None
    """What the two parts rest on; None where they were not measured, or flights were over the real ground."""
    ties: tuple[dict[str, float | str], ...] = ()
    """Other settings that are as good, natural units."""
    ridge: bool = False
    """Those between two tied ones are as good as well: the optimum is no point."""
    exact: bool = True
    """Found by enumeration, hence certain; else the best of many climbs."""
    optimism: float = 0.0
    """What was taken off the surface there to give ``mean``, since the same scores chose the settings; score units. All
    intervals reach further by as much, at their lower end (upper where minimized)."""

    @property
    def of_ground(self) -> float:
        """Half-width that what is not known of the ground gives alone, score units; 0 where it was not measured."""
        return float(np.sqrt(max(self.whole.half_width**2 - self.by_chance.half_width**2, 0.0)))

    def width_left(self, left: float) -> float:
        """Stop-rule half-width where a share of the variance between grounds is left."""
        return float(np.sqrt(max(self.whole.half_width**2 - (1.0 - left) * self.of_ground**2, 0.0)))

    def helped(self, left: float) -> bool:
        """Whether the half-width is then less by a twentieth: where knowing covers takes off less, it tells nothing."""
        return self.width_left(left) <= 0.95 * self.whole.half_width

    def edges(self, factors: Iterable[str]) -> list[str]:
        """The ends of the ``factors``, some of `at_bound`, and the active constraints, in words: "frequency (low)"."""
        ends = [f"{name} ({self.at_bound[name]})" for name in factors]
        return ends + [f"constraint {expr}" for expr in self.active_constraints]


@dataclass(frozen=True, slots=True)
class Step:
    """One value or level of a factor against another, everything else as recommended."""

    factor: str

    level: float | str
    over: float | str
    """The value and the next smaller one; or a level of a categorical factor and the recommended level."""
    mean: float
    """Score expected at ``level``: the recommended one's is less for having been chosen, and the others' by as much as
    leaves none above it."""
    gain: float
    """By which it exceeds that at ``over``; negative where scores fall."""
    interval: Interval
    """Of the gain, at the level of ``[stop]``; further towards the other level by what choosing one may add."""
    better: float
    """Probability that the score at ``level`` is the better one, expected over all grounds; by the draws as they are,
    since choosing the best by the same scores moves means and not, or hardly, these probabilities."""
    better_here: float = float("nan")
    loss_here: float = float("nan")
    """Probability that it is the better one on the actual ground, one draw of what the tables leave open, and the score
    that ``over`` is then expected to lose; nan where simulations did not compare the two."""


@dataclass(frozen=True, slots=True)
class SettingPosterior:
    """Posterior of one factor's optimal setting.

    Numeric factors have ``mean``, ``low``, ``high`` (natural units) and ``p_at_bound``, where an end of the range or a
    constraint lets them go no further; a categorical factor has ``probabilities`` of its levels instead, and nan
    elsewhere.
    """

    factor: str
    mean: float
    low: float
    high: float
    p_at_bound: float
    probabilities: dict[str, float]


@dataclass(frozen=True, slots=True)
class EffectBound:
    """A bound that the prior puts on the change of the mean score from the low to the high end of a factor.

    ``low`` and ``high`` are on the scale of the fit, -inf and inf where there is none.
    """

    factor: str
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class PosteriorSummary:
    """Posterior of the coefficients and of the optimum."""

    sampler: dict[str, float | str | int]
    """One of "exact", "gibbs", "importance" or "emcee" under the key ``method``, with tau, ess, acceptance, r_hat,
    steps for emcee."""
    term_draws: FloatArray
    """(m, p): draws of the coded coefficients, on the scale of the fit."""
    optimum_points: FloatArray
    """(m, k): optimum of each draw, coded."""
    optimum_values: FloatArray
    """(m,): mean utility at that optimum, score units."""
    settings: tuple[SettingPosterior, ...]
    """One for each factor."""
    mean: float
    """Posterior mean of the utility at the optimum."""
    credible: Interval
    """Of the utility at the optimum."""
    predictive: Interval
    """Of one future score at the recommended settings."""
    expected_regret: float
    """Mean utility lost by acting on the recommended settings, score units."""
    p_regret_above: float
    """Probability that the recommendation loses more than ``regret_epsilon``."""
    regret_epsilon: float
    """The target of the stop rule for the loss, else a quarter of that for the half-width, score units."""
    effects: tuple[EffectBound, ...] = ()
    """Bounds of the prior that all draws hold."""
    effects_probability: float = float("nan")
    """Probability of these bounds from the scores and the rest of the prior; nan where it was not computed."""


@dataclass(frozen=True, slots=True)
class Confirmation:
    """Fresh runs at the recommended settings and the exact t interval of their mean."""

    run_ids: tuple[int, ...]
    scores: tuple[float, ...]
    mean: float
    interval: Interval
    agrees: bool
    text: str


@dataclass(frozen=True, slots=True)
class Analysis:
    """One application's response surface and what follows from it; see the attributes' own classes.

    ``fitted`` is what all was made from. ``fit`` is on ``scale``; everything else is in score units. ``of_quadratic``
    is the optimum of the fitted quadratic alone, ``optimum`` that of all that is believed. A ``thorough`` analysis adds
    ``steps``, what each value and level of a factor brings there, ``gap``, where no run was made, and ``blocks``, None
    where there is one block.
    ``known_map``: images are held against a map that exists, and not against a guess. ``warnings`` cast doubt on the
    result, ``notes`` say how it was found.
    """

    application: str
    goal: Goal
    score_unit: str
    fitted: Fitted
    importance: tuple[FactorImportance, ...]
    stationary: StationaryPoint | None
    of_quadratic: Optimum
    optimum: OptimumEstimate
    posterior: PosteriorSummary
    decision: Decision
    confirmation: Confirmation | None
    warnings: tuple[str, ...]
    notes: tuple[str, ...] = ()
    steps: tuple[Step, ...] = ()
    sources: SourceComparison | None = None
    blocks: BlockStudy | None = None
    gap: Gap | None = None
    thorough: bool = False
    known_map: bool = False

    @property
    def fit(self) -> LeastSquaresFit:
        """Least squares with blocks and sources as constants."""
        return self.fitted.fit

    @property
    def scale(self) -> ResponseScale:
        """The scale of the fit."""
        return self.fitted.scale

    @property
    def region(self) -> Region:
        """The campaign's region."""
        return self.fitted.region

    @property
    def model(self) -> QuadraticModel:
        """The fitted terms."""
        return self.fitted.model

    @property
    def data(self) -> ScoredRuns:
        """The fitted runs."""
        return self.fitted.data

    @property
    def sd_of_run(self) -> float:
        """Standard deviation of a future run at the recommended settings, score units."""
        return self.fitted.sd_of_run(self.optimum.point)

    @property
    def contradicted(self) -> bool:
        """Fresh runs at the recommended settings do not agree with the model."""
        return self.confirmation is not None and not self.confirmation.agrees

    @property
    def verdict(self) -> str:
        """What to do, in a word or two."""
        if self.decision.held:
            return "Doubt" if self.contradicted else "Stop"
        if self.decision.wants_confirmation:
            return "Confirm"
        return "Budget spent" if self.decision.budget_spent else "Continue"
