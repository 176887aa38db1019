"""What a thorough analysis finds beyond the fit and its optimum; see :mod:`seqrsm.campaign.study` for how.

Where something cannot be known, a sentence that says why stands in its place.
"""

from __future__ import annotations

from dataclasses import dataclass

from seqrsm.arrays import FloatArray
from seqrsm.campaign.interval import Interval
from seqrsm.fit.location import LocationRegion
from seqrsm.fit.profile import PowerProfile
from seqrsm.fit.residuals import InfluentialRun, NormalPlot


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
