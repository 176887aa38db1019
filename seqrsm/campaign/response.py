"""The scale on which the response surface is fitted, and the way back to score units."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.special import logit

from seqrsm.arrays import FloatArray
from seqrsm.fit.transforms import logit_scores, logit_to_percent, logit_variance


@dataclass(frozen=True, slots=True)
class ResponseScale:
    """Identity, or the logit of percent scores with the weights that keep their scatter equal in percent.

    Attributes
    ----------
    kind : "identity" or "logit"
    values, weights : ndarray (n,)
        The scores on the scale of the fit, and their relative weights.
    variance_unit : float
        Logit variance of weight 1 for a scatter of 1 percent; 1 for the identity.
    """

    kind: Literal["identity", "logit"]
    values: FloatArray
    weights: FloatArray
    variance_unit: float

    @classmethod
    def of(cls, kind: Literal["identity", "logit"], scores: FloatArray, se: FloatArray | None = None) -> ResponseScale:
        """Put scores (n,) on the scale.

        Parameters
        ----------
        kind : "identity" or "logit"
        scores : ndarray (n,)
        se : ndarray (n,), optional
            Standard errors that runs count by, > 0; a future run has their median. By default all count alike.

        Raises
        ------
        FitError
            "logit" with scores outside 0 to 100.
        """
        relative = np.ones(len(scores)) if se is None or not len(se) else np.square(float(np.median(se)) / se)
        if kind == "identity":
            return cls(kind, scores, relative, 1.0)
        logits = logit_scores(scores)
        return cls(kind, logits.value, logits.weight * relative, logits.variance_unit)

    def to_score(self, values: FloatArray) -> FloatArray:
        """Score units of values on the scale of the fit."""
        return values if self.kind == "identity" else logit_to_percent(values)

    def of_score(self, scores: FloatArray) -> FloatArray:
        """Scores on the scale of the fit."""
        return scores if self.kind == "identity" else logit(scores / 100.0)

    def weight_at(self, values: FloatArray) -> FloatArray:
        """Relative weight of a future run whose expected response is ``values``."""
        if self.kind == "identity":
            return np.ones(np.shape(values))
        return self.variance_unit / logit_variance(logit_to_percent(values))
