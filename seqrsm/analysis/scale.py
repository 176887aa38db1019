"""The scale on which the response surface is fitted, the way back to score units, and intervals in them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.fit.intervals import Interval as Ends
from seqrsm.fit.transforms import logit_scores, logit_to_percent, logit_variance
from seqrsm.fit.weights import expected_shares, share_variance, unbiased_logits


@dataclass(frozen=True, slots=True)
class Interval:
    """A two-sided interval in score units."""

    low: float
    high: float

    cut_from: float = float("nan")
    """Half-width before bounds of the score cut it; nan where none did."""

    @property
    def half_width(self) -> float:
        """Half of ``high - low``; not shortened where bounds of the score cut the interval."""
        return 0.5 * (self.high - self.low) if np.isnan(self.cut_from) else self.cut_from

    def within(self, low: float, high: float) -> Interval:
        """The part of it that lies between two bounds; its half-width stays."""
        if low <= self.low and self.high <= high:
            return self
        return Interval(min(max(self.low, low), high), min(max(self.high, low), high), self.half_width)

    def around(self, other: Interval) -> Interval:
        """The smallest interval that holds both."""
        return Interval(min(self.low, other.low), max(self.high, other.high))

    def also_less(self, taken_off: float) -> Interval:
        """The smallest that holds this one and the same less ``taken_off``."""
        return Interval(self.low - max(taken_off, 0.0), self.high - min(taken_off, 0.0))


@dataclass(frozen=True, slots=True)
class ResponseScale:
    """Identity, or the logit of percent scores; these scatter as shares do, or by counts, or as is stated.

    Logits of scores are lowered by the excess of their mean, see `seqrsm.fit.weights.unbiased_logits`.
    """

    kind: Literal["identity", "logit"]

    values: FloatArray
    weights: FloatArray
    """(n,): the scores on the scale of the fit, and their relative weights."""
    variance_unit: float
    """Variance that weight 1 stands for: of a logit for a scatter of 1 percent at 50, of a count's binomial; else 1."""
    trials: float = float("nan")
    """Decisions behind a future score, where scores are counts; nan where they are not."""
    se: float = float("nan")
    """Standard error of a future score, where runs count by theirs; nan where they do not."""

    @classmethod
    def of(
        cls, kind: Literal["identity", "logit"], scores: FloatArray, Z: FloatArray, se: FloatArray | None = None
    ) -> ResponseScale:
        """Put scores (n,) on the scale; ``Z`` (n, p) is the model matrix with blocks.

        ``se`` (n,), > 0, are standard errors that runs count by; a future run has their median. By default all count
        alike. FitError of "logit" with scores outside 0 to 100.
        """
        usual = float("nan") if se is None or not len(se) else float(np.median(se))
        relative = np.ones(len(scores)) if se is None or not len(se) else np.square(usual / se)
        if kind == "identity":
            return cls(kind, scores, relative, 1.0, se=usual)
        equal = bool(np.isfinite(usual))
        values, expected = unbiased_logits(Z, scores, 1.0 / relative, equal=equal)
        variance = logit_variance(expected, equal=equal)
        unit = float(1.0 / np.mean(1.0 / variance))
        return cls(kind, values, unit / variance * relative, unit, se=usual)

    @classmethod
    def of_counts(
        cls, kind: Literal["identity", "logit"], scores: FloatArray, trials: FloatArray, Z: FloatArray
    ) -> ResponseScale:
        """Put shares of correct decisions on the scale; each run counts by the binomial variance of what is expected.

        Scores (n,) [%] rest on so many ``trials`` (n,) each; ``Z`` (n, p) is the model matrix with blocks.
        """
        if kind == "identity":
            values, variance = scores, share_variance(expected_shares(Z, scores, trials), trials)
        else:
            values, expected = unbiased_logits(Z, scores, np.ones(len(scores)), trials)
            variance = logit_variance(expected, count=trials)
        unit = float(1.0 / np.mean(1.0 / variance))
        return cls(kind, values, unit / variance, unit, float(np.median(trials)))

    def to_score(self, values: FloatArray, runs: float = np.inf, scatter: FloatArray | float = 0.0) -> FloatArray:
        """Score units of values on the scale of the fit: of means, or of what so many future ``runs`` score on average.

        ``scatter`` is what runs depart by from the mean. Of percentages without counts it is not bent as logits are,
        which near 100 % would leave out 100 and reach far too low.
        Of few decisions these differ: 10 correct of 10 have the empirical logit of 95 percent. Scores are then those
        that there can be: an end at 99.9 percent would leave out 100 correct of 100.
        """
        if self.kind == "identity":
            return np.asarray(values + scatter)
        if np.isfinite(self.trials):
            values, scatter = values + scatter, 0.0
        percent, count = logit_to_percent(values), self.trials * runs
        percent = percent + percent * (1.0 - percent / 100.0) * scatter
        if not np.isfinite(count):
            return np.asarray(percent)
        return np.asarray(100.0 / count * np.rint(np.clip(percent * (count + 1.0) / 100.0 - 0.5, 0.0, count)))

    def centred(self, scores: FloatArray, counts: FloatArray | None = None) -> FloatArray:
        """Repeated scores on the scale of the fit, with the value of all decisions together as their mean."""
        if self.kind == "identity":
            return scores
        if not np.isfinite(self.trials):
            counts = None
        shares = np.ones(len(scores)) if counts is None else counts
        total = None if counts is None else np.array([np.sum(counts)])
        logits = logit_scores(scores, counts=counts)
        together = logit_scores(np.average(scores, weights=shares, keepdims=True), counts=total)
        return np.asarray(logits - np.mean(logits) + together)

    def in_scores(self, low: float, high: float) -> Interval:
        """An interval of a mean on the scale of the fit, in score units."""
        ends = self.to_score(np.array([low, high]))
        return Interval(float(ends[0]), float(ends[1]))

    def of_runs(self, mean: Interval | Ends, future: Interval | Ends, runs: float) -> tuple[FloatArray, FloatArray]:
        """Ends in score units of prediction intervals of the mean of so many ``runs``; ``mean``: those of the mean."""
        ends, own = np.array([future.low, future.high]), np.array([mean.low, mean.high])
        if self.kind == "identity" or np.isfinite(self.trials):
            low, high = self.to_score(ends, runs)
            return low, high
        middle = ends.mean(axis=0)
        centre = self.to_score(middle)
        chance = 0.5 * np.sqrt(np.maximum(np.square(ends[1] - ends[0]) - np.square(own[1] - own[0]), 0.0))
        low, high = np.hypot(self.to_score(own) - centre, self.to_score(middle, runs, chance) - centre)
        return centre - low, centre + high

    def weight_at(self, values: FloatArray) -> FloatArray:
        """Relative weight of a future run whose expected response is ``values``."""
        counted = np.isfinite(self.trials)
        if self.kind == "identity":
            return self.variance_unit / share_variance(values, self.trials) if counted else np.ones(np.shape(values))
        count = self.trials if counted else None
        equal = bool(np.isfinite(self.se))
        return self.variance_unit / logit_variance(logit_to_percent(values), count=count, equal=equal)
