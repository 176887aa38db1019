"""From the scores of one application to its response surface, optimum, intervals, posterior and decision.

Statistics only: a pure function of the scored runs, the specification and a seed. Response transforms are applied here,
so that everything shown is in score units.
"""

from __future__ import annotations

from dataclasses import dataclass

from seqrsm.arrays import FloatArray, IntArray
from seqrsm.campaign.findings import Study
from seqrsm.campaign.interval import Interval
from seqrsm.campaign.response import ResponseScale
from seqrsm.decide.moving import RegionState
from seqrsm.decide.stopping import Decision
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.fit.anova import AnovaRow, LackOfFit
from seqrsm.fit.canonical import StationaryPoint
from seqrsm.fit.least_squares import LeastSquaresFit
from seqrsm.fit.optimum import Goal

__all__ = [
    "Analysis",
    "Confirmation",
    "FactorImportance",
    "Interval",
    "OptimumEstimate",
    "PosteriorSummary",
    "RegionChange",
    "ScoredRuns",
    "SettingPosterior",
    "SourceComparison",
]


@dataclass(frozen=True, slots=True)
class ScoredRuns:
    """The runs that enter the fit, as arrays of length n.

    Attributes
    ----------
    run_ids, batches : int arrays
        Identity and batch of each run.
    points : ndarray (n, k)
        Executed settings, coded.
    scores, score_se : ndarray (n,)
        Utility and its own standard error (nan where none was given), in score units.
    sources, purposes, blocks : tuple of str
        "simulation" or "flight"; why the run was made; block label ("" where none).
    trials, correct : ndarray (n,), optional
        Binomial counts; nan where none were given.
    model_sd : ndarray (n,), optional
        Standard deviation of what looking at a part of the ground adds to a score, in score units; 0 for others.
    model_bias : ndarray (n,), optional
        Standard deviation of the error that a score shares with the others of its rung, in score units.
    rungs : tuple of str
        Rung of the ladder of models that made each score, "" for others.
    """

    run_ids: IntArray
    batches: IntArray
    points: FloatArray
    scores: FloatArray
    score_se: FloatArray
    sources: tuple[str, ...]
    purposes: tuple[str, ...]
    blocks: tuple[str, ...]
    trials: FloatArray | None = None
    correct: FloatArray | None = None
    model_sd: FloatArray | None = None
    model_bias: FloatArray | None = None
    rungs: tuple[str, ...] = ()


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
class DepartureIntervals:
    """The intervals at the optimum with a departure from the quadratic allowed for, in score units.

    Attributes
    ----------
    mean : float
        Mean utility with the departure averaged over.
    confidence, prediction, prediction_mean : Interval
        As in `OptimumEstimate`.
    widening : float
        Half-width of the interval that the stop rule watches over that of the quadratic alone, >= 1.
    """

    mean: float
    confidence: Interval
    prediction: Interval
    prediction_mean: Interval
    widening: float


@dataclass(frozen=True, slots=True)
class OptimumEstimate:
    """The estimated optimum and the three intervals there, in score units.

    Attributes
    ----------
    settings : dict
        Natural units, by factor name.
    point : ndarray (k,)
        Coded.
    at_bound : tuple of str
        Factors whose optimum lies at a bound of the region, such as "frequency (low)".
    mean : float
        Estimated mean utility there.
    confidence : Interval
        Of the mean utility at these settings.
    prediction : Interval
        Of one future run (eq. (2-23) with the factor S).
    prediction_mean : Interval
        Of the mean of ``replicates`` future runs.
    replicates : int
        m of ``prediction_mean``.
    level : float
        Two-sided probability of all three.
    with_departure : DepartureIntervals or None
        The same where the surface may depart from the quadratic by less than can be seen; None where nothing is left
        over to judge that by, and with two sources.
    ties : tuple of dict
        Other settings that are as good, natural units.
    ridge : bool
        Those between two tied ones are as good as well: the optimum is no point.
    exact : bool
        Found by enumeration, hence certain; else the best of many climbs.
    quadratic : ndarray (k,) or None
        Optimum of the quadratic alone, coded, where a departure from it is seen: settings, mean and intervals are then
        those of both together, as in ``with_departure``. None where they are the quadratic's.
    """

    settings: dict[str, float | str]
    point: FloatArray
    at_bound: tuple[str, ...]
    mean: float
    confidence: Interval
    prediction: Interval
    prediction_mean: Interval
    replicates: int
    level: float
    with_departure: DepartureIntervals | None = None
    ties: tuple[dict[str, float | str], ...] = ()
    ridge: bool = False
    exact: bool = True
    quadratic: FloatArray | None = None


@dataclass(frozen=True, slots=True)
class SettingPosterior:
    """Posterior of one factor's optimal setting.

    Numeric factors have ``mean``, ``low``, ``high`` (natural units) and ``p_at_bound``; a categorical factor has
    ``probabilities`` of its levels instead, and nan elsewhere.
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
    """Posterior of the coefficients and of the optimum.

    Attributes
    ----------
    sampler : dict
        "exact", "gibbs" or "emcee" under the key ``method``, with tau, ess, acceptance, r_hat, steps for emcee.
    term_draws : ndarray (m, p)
        Draws of the coded coefficients, on the scale of the fit.
    optimum_points : ndarray (m, k)
        Optimum of each draw, coded.
    optimum_values : ndarray (m,)
        Mean utility at that optimum, score units.
    settings : tuple of SettingPosterior
        One for each factor.
    mean : float
        Posterior mean of the utility at the optimum.
    credible : Interval
        Of the utility at the optimum.
    predictive : Interval
        Of one future score at the recommended settings.
    expected_regret : float
        Mean utility lost by acting on the recommended settings, score units.
    p_regret_above : float
        Probability that the recommendation loses more than ``regret_epsilon``.
    regret_epsilon : float
        The loss that is tested, score units.
    effects : tuple of EffectBound
        Bounds of the prior that all draws hold.
    effects_probability : float
        Probability of these bounds from the scores and the rest of the prior; nan where it was not computed.
    """

    sampler: dict[str, float | str | int]
    term_draws: FloatArray
    optimum_points: FloatArray
    optimum_values: FloatArray
    settings: tuple[SettingPosterior, ...]
    mean: float
    credible: Interval
    predictive: Interval
    expected_regret: float
    p_regret_above: float
    regret_epsilon: float
    effects: tuple[EffectBound, ...] = ()
    effects_probability: float = float("nan")


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
class RegionChange:
    """One thing that happened to the fitted region, in natural units.

    Attributes
    ----------
    batch, n_runs : int
        After which batch, and how many scored runs there were.
    kind : str
        "shrink" (a smaller box is called for), "move" (the box follows the optimum), "filled" (the box called for has
        runs enough and is fitted from now on).
    ranges : dict
        Low and high end of every continuous factor in the box, natural units.
    text : str
        One sentence.
    """

    batch: int
    n_runs: int
    kind: str
    ranges: dict[str, tuple[float, float]]
    text: str


@dataclass(frozen=True, slots=True)
class SourceComparison:
    """Simulation against flight, in score units.

    Attributes
    ----------
    n_simulations, n_flights : int
        Scored runs of each.
    s_simulation, s_flight : float
        Standard deviation of one run of each.
    difference : float
        Flight less simulation at the recommended settings.
    interval : Interval
        Credible interval of the difference.
    prior_sd : float
        Prior standard deviation of each coefficient of the difference.
    prior_share : float
        Share of the prior variance of the difference that is left: 1 before the first flight.
    prior_driven : bool
        The difference is mostly its prior.
    text : str
        One sentence.
    """

    n_simulations: int
    n_flights: int
    s_simulation: float
    s_flight: float
    difference: float
    interval: Interval
    prior_sd: float
    prior_share: float
    prior_driven: bool
    text: str


@dataclass(frozen=True, slots=True)
class Analysis:
    """One application's response surface and what follows from it; see the attributes' own classes.

    ``fit`` is on ``scale``; everything else is in score units.
    ``region``, ``model`` and ``data.points`` are those of the fitted region, which may be a part of the campaign's;
    ``data`` holds the runs in it. ``n_scored`` counts the scored runs inside and outside. ``beta`` are the coefficients
    that the optimum belongs to: those of ``fit``, of the flight's surface where there are two sources, or of the
    average block where blocks are random. ``dropped`` names the terms that were left out by selection; ``study`` is
    there where a thorough analysis was asked for.
    """

    application: str
    goal: Goal
    scale: ResponseScale
    score_unit: str
    region: Region
    model: QuadraticModel
    data: ScoredRuns
    fit: LeastSquaresFit
    anova: tuple[AnovaRow, ...]
    lack_of_fit: LackOfFit | str
    importance: tuple[FactorImportance, ...]
    stationary: StationaryPoint | None
    optimum: OptimumEstimate
    posterior: PosteriorSummary
    decision: Decision
    confirmation: Confirmation | None
    warnings: tuple[str, ...]
    n_scored: int = 0
    beta: FloatArray | None = None
    region_state: RegionState | None = None
    region_history: tuple[RegionChange, ...] = ()
    sources: SourceComparison | None = None
    dropped: tuple[str, ...] = ()
    study: Study | None = None

    @property
    def response(self) -> str:
        """Name of the scale of the fit, "identity" or "logit"."""
        return self.scale.kind

    @property
    def contradicted(self) -> bool:
        """Fresh runs at the recommended settings do not agree with the model."""
        return self.confirmation is not None and not self.confirmation.agrees
