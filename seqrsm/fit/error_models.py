"""How scores scatter about their surface: each model of errors is one class here, registered by its name.

A class knows the weights that runs get, the posterior of a linear model, what single future runs add to the mean, what
``campaign.toml`` may combine it with, and its words. A further one is a further class and its place in `ERROR_MODELS`;
nothing else asks which it is.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, ClassVar, Final, Literal, Protocol, TypeAlias

import numpy as np

from seqrsm.arrays import FloatArray, IntArray
from seqrsm.errors import ConvergenceError
from seqrsm.fit.conjugate import LinearBounds, NormalInverseGamma, Prior, posterior, with_further, within
from seqrsm.fit.least_squares import LeastSquaresFit
from seqrsm.fit.robust import STUDENT_DF, likely_weights, student_draws, student_draws_of_days, student_share
from seqrsm.fit.score_models import CoefficientPrior, beta_binomial_model
from seqrsm.fit.target import build_target, draws_by_importance, general_target

if TYPE_CHECKING:
    from seqrsm.fit.ensemble import Sampled

Sampler: TypeAlias = Literal["exact", "emcee"]

Made: TypeAlias = dict[str, float | str | int]

_LEAST_SHARE = 0.25  # of the draws wanted that must hold the bounds, else the ensemble sampler works inside them
_ROWS_PER_DRAW = 6  # of Gibbs sampling, for each independent draw that they are to be worth
_MOST_ROUNDS = 12  # of Gibbs sampling, in search of draws that hold the bounds
_LOGIT_SD, _LOGIT_INTERCEPT_SD = 2.5, 10.0  # prior of the coefficients of a logit of which nothing is stated


class Scale(Protocol):
    """The scale of the fit; ``seqrsm.analysis.scale.ResponseScale`` is one."""

    def to_score(self, values: FloatArray, runs: float = ..., scatter: FloatArray = ...) -> FloatArray:
        """Score units of values on the scale of the fit: of means, or of what so many future ``runs`` score."""

    def weight_at(self, values: FloatArray) -> FloatArray:
        """Relative weight of a future run whose expected response is ``values``."""


@dataclass(frozen=True, slots=True)
class Draws:
    """Posterior draws of the surface whose optimum is sought, on the scale of the fit."""

    terms: FloatArray
    """(m, p): coded coefficients; those of the flight's surface where there are two sources."""
    sigma: FloatArray
    """(m,): standard deviation (scale, of Student-t errors) of a future run of weight 1."""
    made: Made
    """How they were made."""
    share: float | None = None
    """Probability of the bounds of the prior without them; None where it is not known."""
    bounds: LinearBounds | None = None
    """Bounds of single terms that all draws hold."""
    sigma_block: FloatArray | None = None
    """(m,): standard deviation of random blocks."""
    more: Mapping[str, FloatArray] = field(default_factory=dict)
    """Other parameters of the errors, (m,) each, by name."""
    instead: str = ""
    """How they were made in place of emcee, and why; "" where nothing stands in its place."""

    def first(self, n: int) -> Draws:
        """The first ``n`` draws."""
        block = None if self.sigma_block is None else self.sigma_block[:n]
        more = {name: values[:n] for name, values in self.more.items()}
        return replace(self, terms=self.terms[:n], sigma=self.sigma[:n], sigma_block=block, more=more)

    def of_blocks(self, rng: np.random.Generator) -> FloatArray:
        """Effects (m, 1) of the random block that future runs share."""
        if self.sigma_block is None:
            return np.zeros((len(self.terms), 1))
        return np.asarray(self.sigma_block[:, None] * rng.standard_normal((len(self.terms), 1)))


@dataclass(frozen=True, slots=True)
class LinearRuns:
    """A linear model and the runs that it was fitted to, as its posterior needs them."""

    fit: LeastSquaresFit
    """With blocks and sources as constants behind the model's terms."""
    p: int
    """Terms of the model."""
    Z: FloatArray
    y: FloatArray
    """(n, c), (n,): rows and scores of what is sampled: the columns of ``fit``, and others maybe."""
    weights: FloatArray
    """(n,): relative weights, `ErrorModel.sampled_weights`."""
    prior: Prior
    """Of the c coefficients."""
    to_terms: Callable[[FloatArray], FloatArray]
    """(m, c) coefficients -> (m, p) terms of the surface whose optimum is sought."""
    own_columns: bool
    """The first of the c columns are those of ``fit``, with nothing else on them."""
    sigma_unit: float
    """Standard deviation of a future run of weight 1 over that of a run of weight 1 among these."""
    stated: NormalInverseGamma | None
    """Prior of the p terms that the user states."""
    correct: FloatArray | None = None
    trials: FloatArray | None = None
    """(n,): decisions of each run, where the errors are those of counts."""

    def seen_from_all(self, bounds: LinearBounds | None) -> LinearBounds | None:
        """Bounds of terms as bounds of the c coefficients."""
        if bounds is None:
            return None
        return LinearBounds(bounds.rows @ self.to_terms(np.eye(self.Z.shape[1])).T, bounds.low, bounds.high)


class ErrorModel:
    """What all models of errors share; see the module."""

    name: ClassVar[str]
    """As ``[model] errors`` has it."""
    words: ClassVar[str]
    """After "errors of different runs are independent, "."""
    exact: ClassVar[bool] = False
    """The posterior of a linear model is known exactly, and least squares have t intervals: only normal errors have."""
    of_counts: ClassVar[bool] = False
    """Scores are counts of correct decisions, which carry their own weights."""
    response: ClassVar[str] = ""
    """The scale that they must be modelled on; "" for any."""
    random_blocks: ClassVar[bool] = False
    """Blocks may be random."""
    run_variance: ClassVar[float] = 1.0
    """Variance of a run of weight 1 over the square of the errors' scale, which is what least squares tell as s."""
    inflation: ClassVar[float] = 1.0
    """Variance of the most likely coefficients over that which least squares with their weights tell."""

    def weights(self, Z: FloatArray, y: FloatArray, given: FloatArray) -> FloatArray:
        """Relative weights (n,) for least squares, of rows Z (n, p), scores y (n,) as fitted, given weights (n,)."""
        del Z, y
        return given

    def sampled_weights(self, fitted: FloatArray, given: FloatArray) -> FloatArray:
        """Relative weights (n,) of runs in the posterior, from those of least squares and those from the scale.

        What errors make of the weights of least squares is told by the draws themselves.
        """
        del fitted
        return given

    def law(self, weighted: bool) -> tuple[str, str]:
        """Distribution of an error about the linear model, as an equation and in words; w is a run's weight."""
        over = (" \\/ w", " over w") if weighted else ("", "")
        return f'"N"(0, sigma^2{over[0]})', f"normal with mean zero and variance sigma squared{over[1]}"

    def draws(
        self, runs: LinearRuns, bounds: LinearBounds | None, sampler: Sampler, n: int, rng: np.random.Generator
    ) -> Draws:
        """About ``n`` posterior draws that hold ``bounds`` of single terms; ConvergenceError of emcee."""
        raise NotImplementedError

    def draws_of_days(
        self, Z: FloatArray, y: FloatArray, weights: FloatArray, days: IntArray, bounds: LinearBounds | None, n: int,
        rng: np.random.Generator,
    ) -> Draws:  # fmt: skip
        """The same by runs (n) on random ``days``, which are numbered from 0; the prior of coefficients is flat."""
        raise NotImplementedError

    def noise(self, size: tuple[int, int], rng: np.random.Generator) -> FloatArray:
        """Errors of scale 1."""
        raise NotImplementedError

    def future_scores(
        self, draws: Draws, scale: Scale, here: FloatArray, replicates: int, rng: np.random.Generator
    ) -> FloatArray:
        """Scores (m, replicates) of future runs whose mean response is ``here`` (m,): blocks and single runs add."""
        block = draws.of_blocks(rng)
        noise = self.noise((len(here), replicates), rng)
        spread = draws.sigma[:, None] / np.sqrt(scale.weight_at(here[:, None] + block))
        return scale.to_score(here[:, None] + block, 1.0, spread * noise)


class Additive(ErrorModel):
    """Errors that add to a linear model: drawn by a sampler of their own where there is one, else by emcee.

    A class tells their `log_likelihood` and `share` (see `seqrsm.fit.target.Errors`), and `noise`.
    """

    def log_likelihood(self, square: FloatArray) -> FloatArray:
        """Log density (m,) of the errors of each row of their squares over the scale (m, n)."""
        raise NotImplementedError

    def share(self, square: FloatArray) -> FloatArray:
        """Weight of each run in the most likely fit."""
        raise NotImplementedError

    def weights(self, Z: FloatArray, y: FloatArray, given: FloatArray) -> FloatArray:
        """Weights that make least squares the most likely fit."""
        return given if self.exact else likely_weights(Z, y, given, self.share)

    def draws(
        self, runs: LinearRuns, bounds: LinearBounds | None, sampler: Sampler, n: int, rng: np.random.Generator
    ) -> Draws:
        """See `ErrorModel.draws`."""
        inner, share = runs.seen_from_all(bounds), None
        # A surface through every score leaves nothing to sample: sigma is 0.
        through = runs.fit.sse == 0.0
        own = NORMAL.independent if through else self.independent
        if (through or sampler == "exact") and (found := own(runs, inner, n, rng)) is not None:
            (beta, sigma), made, share = found
            if through and runs.own_columns and not np.any(sigma):
                beta[:, : len(runs.fit.estimate)] = runs.fit.estimate  # no rounding dust, which has a best end
            if through or enough(len(sigma), n):
                passes = "exactly, not by emcee: the surface passes through every score" if through else ""
                return _of_terms(runs, (beta, sigma), made, share, passes)
        from seqrsm.fit.ensemble import sample  # emcee: only where it is asked for

        errors, seed = None if self.exact else self, int(rng.integers(2**31))
        target = partial(build_target, runs.Z, runs.y, runs.weights, errors, runs.prior)
        try:
            chain = sample(target(inner), seed)
        except ConvergenceError:
            found = self.independent(runs, inner, n, rng)
            if found is None:
                raise
            # A wild score makes a posterior of several hills, between which the ensemble hardly moves.
            how = "exactly" if found[1]["method"] == "exact" else "by Gibbs sampling"
            return _of_terms(runs, *found, f"{how} because emcee did not converge")
        keep = chain.draws[_spread(len(chain.draws), n)]
        if inner is not None and share is None:
            free = self.independent(runs, None, n, rng)
            share = float(np.mean(inner.hold(sample(target(None), seed).draws[:, :-1] if free is None else free[0][0])))
        made = _sampled(chain, self.name, len(keep))
        return _of_terms(runs, (keep[:, :-1], keep[:, -1]), made, share)

    def independent(
        self, runs: LinearRuns, bounds: LinearBounds | None, n: int, rng: np.random.Generator
    ) -> tuple[tuple[FloatArray, ...], Made, float | None] | None:
        """Coefficients and sigma drawn without emcee, how, and the share of all draws in the bounds; None: no way."""
        del runs, bounds, n, rng
        return None


class Normal(Additive):
    """Independent normal errors of one variance, or of one up to known weights."""

    name = "normal"
    words = "normal"
    exact = True
    random_blocks = True

    def sampled_weights(self, fitted: FloatArray, given: FloatArray) -> FloatArray:
        """Those of least squares: the posterior is of the same model."""
        del given
        return fitted

    def independent(
        self, runs: LinearRuns, bounds: LinearBounds | None, n: int, rng: np.random.Generator
    ) -> tuple[tuple[FloatArray, ...], Made, float | None]:
        """Draws of the exact posterior: independent ones, or by Gibbs sampling where hardly any hold several bounds."""
        exact = posterior(runs.Z, runs.y, runs.weights, runs.prior)
        found, share = within(partial(exact.draws, rng=rng), bounds, n)
        method = "exact"
        if bounds is not None and exact.b > 0.0 and not enough(len(found[1]), n):
            found = exact.draws_inside(bounds, n, rng)
            method = "exact" if len(bounds.low) == 1 else "gibbs"
        return found, {"method": method, "draws": len(found[1])}, share

    def noise(self, size: tuple[int, int], rng: np.random.Generator) -> FloatArray:
        """Standard normal errors."""
        return rng.standard_normal(size)


class StudentT(Additive):
    """Independent Student-t errors of known degrees of freedom: wild scores count for little.

    The weights that make least squares the most likely fit come from the scores; the information is that of Lange,
    Little & Taylor (1989, J. Am. Stat. Assoc. 84, 881-896): (nu + 1) / (nu + 3) of a normal error's of the same scale.
    """

    name = "student_t"
    words = f"Student-t with {STUDENT_DF:g} degrees of freedom"
    run_variance = STUDENT_DF / (STUDENT_DF - 2.0)
    random_blocks = True
    inflation = (STUDENT_DF + 3.0) / (STUDENT_DF + 1.0)

    def law(self, weighted: bool) -> tuple[str, str]:
        """See `ErrorModel.law`."""
        scale = ("sigma \\/ sqrt(w) dot", "sigma over the root of w") if weighted else ("sigma", "sigma")
        words = f"{scale[1]} times Student's t with {STUDENT_DF:g} degrees of freedom"
        return f"{scale[0]} t_{STUDENT_DF:g}", words

    def log_likelihood(self, square: FloatArray) -> FloatArray:
        """See `Additive`."""
        return np.asarray(-0.5 * (STUDENT_DF + 1.0) * np.sum(np.log1p(square / STUDENT_DF), axis=1))

    def share(self, square: FloatArray) -> FloatArray:
        """See `Additive`."""
        return student_share(square)

    def independent(
        self, runs: LinearRuns, bounds: LinearBounds | None, n: int, rng: np.random.Generator
    ) -> tuple[tuple[FloatArray, ...], Made, float | None]:
        """Draws by Gibbs sampling, so many that they are worth ``n`` independent ones."""
        rows = _ROWS_PER_DRAW * n
        *found, reached = student_draws(runs.Z, runs.y, runs.weights, runs.prior, rows, rng)
        made: Made = {"method": "gibbs", "errors": self.name, "draws": len(found[1]), **reached}
        first = [tuple(found)]

        def more(m: int) -> tuple[FloatArray, ...]:
            if first:
                return first.pop()
            return student_draws(runs.Z, runs.y, runs.weights, runs.prior, m, rng)[:2]

        held, share = within(more, bounds, rows, _MOST_ROUNDS)
        return held, made | {"draws": len(held[1])}, share

    def draws_of_days(
        self, Z: FloatArray, y: FloatArray, weights: FloatArray, days: IntArray, bounds: LinearBounds | None, n: int,
        rng: np.random.Generator,
    ) -> Draws:  # fmt: skip
        """See `ErrorModel.draws_of_days`: by Gibbs sampling."""
        made: Made = {"method": "gibbs", "errors": self.name, "blocks": "random"}

        def draw(m: int) -> tuple[FloatArray, ...]:
            *found, reached = student_draws_of_days(Z, y, weights, days, m, rng)
            made.update(reached)
            return tuple(found)

        (beta, sigma, of_days), share = within(draw, bounds, _ROWS_PER_DRAW * n, _MOST_ROUNDS)
        why = "by Gibbs sampling, not by emcee, which knows no random blocks"
        return Draws(beta, sigma, made | {"draws": len(sigma)}, share, sigma_block=of_days, instead=why)

    def noise(self, size: tuple[int, int], rng: np.random.Generator) -> FloatArray:
        """Student-t errors of scale 1."""
        return rng.standard_t(STUDENT_DF, size)


class BetaBinomial(ErrorModel):
    """Counts of correct decisions, which are correlated within a run: more scatter than the binomial."""

    name = "beta_binomial"
    words = "beta-binomial, with one correlation of the decisions within a run"
    of_counts = True
    response = "logit"

    def draws(
        self, runs: LinearRuns, bounds: LinearBounds | None, sampler: Sampler, n: int, rng: np.random.Generator
    ) -> Draws:
        """Draws by importance, or by emcee where these are few; blocks and sources are constants."""
        assert runs.correct is not None
        assert runs.trials is not None
        prior = _logit_prior(runs)
        if bounds is not None:
            low, high = (np.full(len(prior.mean), end) for end in (-np.inf, np.inf))
            terms = np.argmax(bounds.rows, axis=1)
            low[terms], high[terms] = bounds.low, bounds.high
            prior = replace(prior, low=low, high=high)
        model, usual = beta_binomial_model(runs.fit.Z, runs.correct, runs.trials, prior), float(np.median(runs.trials))
        if sampler == "exact" and (found := draws_by_importance(model, n, rng)) is not None:
            values, worth = found
            made: Made = {"method": "importance", "errors": self.name, "draws": n, "ess": worth}
        else:
            from seqrsm.fit.ensemble import sample  # emcee: only where it is asked for

            chain = sample(general_target(model), int(rng.integers(2**31)))
            values = chain.draws[_spread(len(chain.draws), n)]
            made = _sampled(chain, self.name, len(values))
        correlation = values[:, -1]
        made |= {"correlation": float(np.mean(correlation)), "trials": usual}
        more = {"correlation": correlation, "trials": np.full(len(values), usual)}
        return Draws(values[:, : runs.p], np.full(len(values), runs.fit.s), made, more=more)

    def future_scores(
        self, draws: Draws, scale: Scale, here: FloatArray, replicates: int, rng: np.random.Generator
    ) -> FloatArray:
        """Shares of as many decisions as a run has in the median [%]."""
        size, trials = (len(here), replicates), max(round(float(draws.more["trials"][0])), 1)
        share = scale.to_score(here)[:, None] / 100.0
        phi = (1.0 / draws.more["correlation"] - 1.0)[:, None]
        success = rng.beta(np.maximum(share * phi, 1e-9), np.maximum((1.0 - share) * phi, 1e-9), size)
        return np.asarray(100.0 * rng.binomial(trials, success) / trials)


NORMAL: Final = Normal()

ERROR_MODELS: Final[Mapping[str, ErrorModel]] = {model.name: model for model in (NORMAL, StudentT(), BetaBinomial())}
"""Every model of errors by its name in ``campaign.toml``; the first is the default."""


def enough(found: int, wanted: int) -> bool:
    """Whether so many draws that hold the bounds do."""
    return found >= _LEAST_SHARE * wanted


def _of_terms(
    runs: LinearRuns, found: tuple[FloatArray, ...], made: Made, share: float | None, instead: str = ""
) -> Draws:
    beta, sigma = found
    return Draws(runs.to_terms(beta), sigma * runs.sigma_unit, made, share, instead=instead)


def _logit_prior(runs: LinearRuns) -> CoefficientPrior:
    """Of the logit: as stated, else N(0, 10^2) for the intercept and N(0, 2.5^2) for the others."""
    kinds = np.array(runs.fit.kinds)
    sd = np.where(kinds == "intercept", _LOGIT_INTERCEPT_SD, _LOGIT_SD)
    if runs.stated is None:
        return CoefficientPrior(np.zeros(len(kinds)), np.diag(1.0 / np.square(sd)))
    stated = with_further(runs.stated, runs.p, np.zeros(len(kinds) - runs.p))
    silent = np.diagonal(stated.Lambda0) == 0.0
    # The precision with sigma at its prior guess.
    precision = stated.Lambda0 * (stated.a0 / stated.b0) + np.diag(np.where(silent, 1.0 / np.square(sd), 0.0))
    return CoefficientPrior(stated.m0, precision)


def _spread(n: int, wanted: int) -> IntArray:
    return np.linspace(0, n - 1, min(wanted, n)).astype(np.int64)


def _sampled(chain: Sampled, errors: str, draws: int) -> Made:
    return {
        "method": "emcee",
        "errors": errors,
        "draws": draws,
        "steps": chain.steps,
        "tau": float(np.max(chain.tau)),
        "ess": float(np.min(chain.ess)),
        "ess_ends": float(np.min(chain.ess_ends)),
        "acceptance": float(np.mean(list(chain.acceptance.values()))),
        "r_hat": float(np.max(chain.r_hat)),
    }
