"""What one look at the scores finds: surface, optimum, intervals, posterior, decision, and what a thorough study adds.

Values only, in score units unless an attribute says otherwise. Where something cannot be known, a sentence that says
why stands in its place.
"""

from __future__ import annotations

from dataclasses import dataclass

from seqrsm.analysis.scale import ResponseScale
from seqrsm.arrays import FloatArray, IntArray
from seqrsm.decide.moving import RegionState
from seqrsm.decide.stopping import Decision
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.fit.anova import AnovaRow, LackOfFit
from seqrsm.fit.canonical import StationaryPoint
from seqrsm.fit.least_squares import LeastSquaresFit
from seqrsm.fit.location import LocationRegion
from seqrsm.fit.optimum import Goal
from seqrsm.fit.profile import PowerProfile
from seqrsm.fit.residuals import InfluentialRun, NormalPlot


@dataclass(frozen=True, slots=True)
class Interval:
    """A two-sided interval in score units."""

    low: float
    high: float

    @property
    def half_width(self) -> float:
        """Half of ``high - low``."""
        return 0.5 * (self.high - self.low)

    def around(self, other: Interval) -> Interval:
        """The smallest interval that holds both."""
        return Interval(min(self.low, other.low), max(self.high, other.high))


@dataclass(frozen=True, slots=True)
class SearchedOptimum:
    """Intervals at the recommended settings that allow for their having been searched for in the same scores.

    Attributes
    ----------
    optimism : float
        By how much the estimated mean there is too good, on average; score units, on the scale of the fit for a logit.
    confidence, prediction, prediction_mean : Interval
        As in the optimum, never shorter.
    """

    optimism: float
    confidence: Interval
    prediction: Interval
    prediction_mean: Interval


@dataclass(frozen=True, slots=True)
class TermChoice:
    """Averaging over hierarchical sub-models.

    Attributes
    ----------
    units : tuple of str
        What enters or leaves together: a factor, a product of two, a square.
    inclusion, prior_inclusion : ndarray (u,)
        Probability that each belongs to the model, after and before the scores.
    models : tuple of (units, probability)
        The most probable ones, at most ten.
    median : tuple of str
        Units that are more likely than not, with all that they need.
    n_models : int
        Models listed or visited.
    exhaustive : bool
        All hierarchical models were listed.
    coefficient_mean, coefficient_sd : ndarray (p,)
        Averaged over models, 0 where a model lacks the term; the order of ``terms``.
    terms : tuple of str
    mean : float
        Averaged score at the recommended settings.
    confidence, prediction : Interval
        Credible interval of the mean and of one future run there, the doubt about the terms included.
    """

    units: tuple[str, ...]
    inclusion: FloatArray
    prior_inclusion: FloatArray
    models: tuple[tuple[tuple[str, ...], float], ...]
    median: tuple[str, ...]
    n_models: int
    exhaustive: bool
    coefficient_mean: FloatArray
    coefficient_sd: FloatArray
    terms: tuple[str, ...]
    mean: float
    confidence: Interval
    prediction: Interval


@dataclass(frozen=True, slots=True)
class BlockResponse:
    """The recommended settings in one block: mean, its interval, and that of one future run there."""

    block: str
    mean: float
    confidence: Interval
    prediction: Interval


@dataclass(frozen=True, slots=True)
class BlockStudy:
    """How blocks (flight days) differ.

    Attributes
    ----------
    effect : str
        "fixed" or "random", of the fit.
    same : tuple of BlockResponse
        In each block that was run.
    new : BlockResponse or str
        In a block not yet run: the average block for the mean, one more draw of the block effect for the run.
    sigma, sigma_block : float
        Standard deviations of a run and of the blocks by restricted maximum likelihood, on the scale of the fit; nan
        where they cannot be had.
    ratio : tuple of float
        Credible interval of sigma_block / sigma.
    note : str
        Why intervals for a new block rest on the prior; empty when there are blocks enough.
    """

    effect: str
    same: tuple[BlockResponse, ...]
    new: BlockResponse | str
    sigma: float
    sigma_block: float
    ratio: tuple[float, float]
    note: str


@dataclass(frozen=True, slots=True)
class PathPoint:
    """A point of a path over the surface.

    Attributes
    ----------
    distance : float
        Coded, from the start of the path.
    settings : dict
        Natural units.
    coded : ndarray (k,)
    mean : float
        Fitted score.
    inside : bool
        Whether it belongs to the region.
    """

    distance: float
    settings: dict[str, float | str]
    coded: FloatArray
    mean: float
    inside: bool


@dataclass(frozen=True, slots=True)
class Study:
    """Everything that a thorough analysis adds; a string is the reason why something is not there.

    Attributes
    ----------
    searched : SearchedOptimum or str
    locations : tuple of LocationRegion
        Where the optimum may lie, by method; points are coded in the fitted region, natural ranges in units.
    no_location : str
        Why there is none; empty when there is.
    terms : TermChoice or str
    profile : PowerProfile or str
        On which scale the scores obey the model.
    normal : NormalPlot
    influential : tuple of InfluentialRun
        ``run`` is the place among the fitted runs.
    extrapolated : bool
        The recommended settings are further from the runs than any run is.
    blocks : BlockStudy or None
        None where there is one block.
    ridge : tuple of PathPoint
        Best settings at growing distance from the centre (R's ``steepest``); empty without numeric factors.
    steepest : tuple of PathPoint
        Path of steepest ascent from the centre of the region, to where a bound, a constraint or the optimum ends it.
    """

    searched: SearchedOptimum | str
    locations: tuple[LocationRegion, ...]
    no_location: str
    terms: TermChoice | str
    profile: PowerProfile | str
    normal: NormalPlot
    influential: tuple[InfluentialRun, ...]
    extrapolated: bool
    blocks: BlockStudy | None
    ridge: tuple[PathPoint, ...]
    steepest: tuple[PathPoint, ...]


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
