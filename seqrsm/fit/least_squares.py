"""Weighted least squares: coefficients, standard errors, intervals and tests (RSL TR 380-1 chapter 2.2).

Rows of the model matrix ``Z`` are runs in coded units. Weights are inverse *relative* variances: run i has variance
sigma^2 / weight_i. Terms that the runs cannot tell apart are refused by name: `AliasedError`.

Beside the coefficients: what single runs do to a fit, in leverage, deleted residuals, PRESS and Cook's distance; the
influential ones by name, the normal plot, and which points are extrapolations.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import compress

import numpy as np
from scipy.special import fdtrc, ndtri, stdtr

from seqrsm.arrays import BoolArray, FloatArray, IntArray
from seqrsm.design.quadratic import Term
from seqrsm.errors import FitError, Problem
from seqrsm.fit import linear_system
from seqrsm.fit.intervals import (
    AnovaRow,
    FTest,
    Interval,
    LackOfFit,
    Prediction,
    group_index,
    pure_error,
    sequential_ss,
    t_quantile,
)

_GROUPS = {
    "block": "blocks",
    "linear": "first order",
    "category": "categories",
    "interaction": "interactions",
    "square": "squares",
}
_LEVERAGE_ONE = 1e-10  # 1 - h below this: the run alone fixes a direction of the model


def _run_diagnostics(
    r: FloatArray, leverage: FloatArray, df: int, rank: int, tolerance: float
) -> tuple[FloatArray, FloatArray, float, tuple[int, ...]]:
    """Studentised residuals, Cook's distances, PRESS and the runs of leverage 1, see `LeastSquaresFit`; nan: undefined.

    From weighted residuals ``r = sqrt(w) (y - fitted)`` (n,) and leverages (n,), with ``df`` residual degrees of
    freedom and ``rank`` fitted parameters.
    """
    free = 1.0 - leverage
    fixed = free < max(_LEVERAGE_ONE, tolerance**2)
    free = np.where(fixed, np.nan, free)
    sse = float(r @ r)
    deleted = np.square(r) / free
    studentised = np.full(r.shape, np.nan)
    if df > 1:
        variance = (sse - deleted) / (df - 1)  # s^2 without run i
        usable = variance > 1e-14 * sse
        studentised[usable] = r[usable] / np.sqrt(variance[usable] * free[usable])
    cooks = np.full(r.shape, np.nan)
    if df > 0 and rank > 0 and sse > 0.0:
        cooks = deleted * leverage / free * df / (rank * sse)
    press = float("nan") if np.any(fixed) else float(np.sum(np.square(r / free)))
    return studentised, cooks, press, tuple(int(i) for i in np.flatnonzero(fixed))


_DUST = 1e-9  # of a unit vector of the null space: a term with less takes no part in a dependence


_NAMED = 12  # terms of a dependence


class AliasedError(FitError):
    """The runs cannot tell some terms apart, of ``n_dependent`` linear dependences."""

    def __init__(self, terms: Sequence[str], n_dependent: int) -> None:
        more = f" and {len(terms) - _NAMED} more" if len(terms) > _NAMED else ""
        shown = ", ".join(terms[:_NAMED])
        super().__init__(Problem(f"the runs cannot separate these terms: {shown}{more}", "Add runs."))
        self.n_dependent = n_dependent


@dataclass(frozen=True, slots=True)
class LeastSquaresFit:
    """A fitted model; see :func:`fit_least_squares`."""

    names: tuple[str, ...]
    kinds: tuple[str, ...]
    """Of the p columns."""
    estimate: FloatArray
    se: FloatArray
    """(p,): coefficients and standard errors; ``se`` is nan where s is 0 or nan: no scatter seen is none known."""
    covariance_unscaled: FloatArray
    """(p, p): (Z'WZ)^-1 times ``inflation``."""
    s: float
    """Residual standard deviation of a run of weight 1 (RSL TR 380-1 eq. 2-13); nan when ``df_residual`` is 0."""
    n_runs: int
    n_terms: int
    df_residual: int

    sse: float
    sst: float
    """Weighted residual and total sum of squares, the latter about the mean when there is an intercept."""
    r2: float
    r2_adjusted: float
    press: float
    r2_predicted: float

    fitted: FloatArray
    residuals: FloatArray
    leverage: FloatArray
    studentised: FloatArray
    cooks_distance: FloatArray
    """(n,): ``residuals`` are unweighted; ``studentised`` externally; nan where undefined."""
    condition_number: float
    """Of the weighted model matrix with columns of unit length."""
    leverage_one_runs: tuple[int, ...]
    """Indices of runs that the model must pass through; PRESS is undefined when there are any."""
    reason: str
    """Why s, standard errors or tests are undefined; empty when they are not."""
    Z: FloatArray
    y: FloatArray
    weights: FloatArray
    setting_ids: IntArray | None
    block_ids: IntArray | None
    """The data as fitted."""
    factor: FloatArray
    """(p, p): L with ``covariance_unscaled`` = LL'."""
    inflation: float
    """Variance of the coefficients over s^2 (Z'WZ)^-1: 1, more where weights were chosen by the scores themselves."""

    @property
    def t(self) -> FloatArray:
        """Student-t statistic of every coefficient (p,); nan where the standard error is undefined."""
        return np.asarray(self.estimate / self.se, dtype=np.float64)

    @property
    def p_value(self) -> FloatArray:
        """Two-sided p value of every coefficient (p,)."""
        return np.asarray(2.0 * stdtr(float(self.df_residual), -np.abs(self.t)), dtype=np.float64)

    def interval(self, level: float = 0.95) -> Interval:
        """Confidence interval of every coefficient at ``level`` in (0, 1)."""
        half = t_quantile(self.df_residual, level) * self.se
        return Interval(self.estimate - half, self.estimate + half)

    def rows_with_mean_block(self, rows: FloatArray) -> FloatArray:
        """Rows (m, p) from rows without block columns, which are set to 0: the mean of the blocks."""
        rows = np.atleast_2d(np.asarray(rows, dtype=np.float64))
        if rows.shape[1] == self.n_terms:
            return rows
        model = np.array([kind != "block" for kind in self.kinds])
        full = np.zeros((rows.shape[0], self.n_terms))
        full[:, model] = rows
        return full

    def variance_unscaled(self, rows: FloatArray) -> FloatArray:
        """Variance z'(Z'WZ)^-1 z times ``inflation`` at each row (m, p) -> (m,) (RSL TR 380-1 eq. 2-17)."""
        return np.asarray(np.sum(np.square(self.rows_with_mean_block(rows) @ self.factor), axis=1))

    def predict(
        self, rows: FloatArray, level: float = 0.95, weight: float | FloatArray = 1.0, replicates: float = 1
    ) -> Prediction:
        """Estimated response, confidence and prediction interval at model rows (m, p), in ``level`` of cases.

        Rows without the block columns mean the average block. Future runs have a ``weight`` > 0, one or (m,); covered
        is the mean of ``replicates`` >= 1 of them, whose variance about the true mean response is sigma^2 / (replicates
        * weight) (RSL TR 380-1 eq. 2-18 ... 2-23).
        """
        rows = self.rows_with_mean_block(rows)
        mean = rows @ self.estimate
        h, s = self.variance_unscaled(rows), known_scatter(self.s)
        se_mean = s * np.sqrt(h)
        se_prediction = s * np.sqrt(1.0 / (replicates * np.asarray(weight, dtype=np.float64)) + h)  # eq. 2-23
        quantile = t_quantile(self.df_residual, level)
        return Prediction(
            mean,
            Interval(mean - quantile * se_mean, mean + quantile * se_mean),
            Interval(mean - quantile * se_prediction, mean + quantile * se_prediction),
            se_mean,
        )

    def partial_f(self, indices: Sequence[int] | IntArray) -> FTest:
        """F test that all coefficients in ``indices`` are zero, given the other terms (RSL TR 380-1 eq. 2-14).

        The extra sum of squares is b'(C_gg)^-1 b over the group.
        """
        group = np.unique(np.asarray(indices, dtype=np.int64))
        _, R = np.linalg.qr(self.factor[group].T)
        df, wald = int(group.size), float(np.sum(np.square(np.linalg.solve(R.T, self.estimate[group]))))
        ss = wald * self.inflation
        nan = float("nan")
        if self.df_residual == 0:
            return FTest(df, ss, ss / df, nan, nan, "no residual degrees of freedom")
        if self.sse == 0.0:
            reason = "the model reproduces every score exactly, so there is no error to test against"
            return FTest(df, ss, ss / df, nan, nan, reason)
        f = (wald / df) / (self.sse / self.df_residual)
        return FTest(df, ss, ss / df, f, float(fdtrc(df, self.df_residual, f)))

    def lack_of_fit(self) -> LackOfFit | str:
        """Lack-of-fit test against pure error, or a sentence that says why the runs do not allow it."""
        if self.df_residual == 0:
            return "no residual degrees of freedom: as many terms as runs"
        if self.setting_ids is None:
            return "which runs repeat a setting is not known"
        df_pe, ss_pe, n_groups = pure_error(self.y, self.weights, self.setting_ids, self.block_ids)
        df_lof = n_groups - self.n_terms
        if df_pe == 0:
            twice = len(np.unique(self.setting_ids)) < len(self.setting_ids)
            where = "no setting was run twice" if not twice else "no setting was run twice in one block"
            return f"{where}, so there is no pure error to test against"
        if df_lof <= 0:
            return "no more distinct settings than terms, so the model passes through all means of repeats"
        if ss_pe == 0.0 or self.sse == 0.0:  # of an exact fit rounding alone is left
            return "all repeated runs gave the same score: pure error is zero and F is undefined"
        ss_lof = max(self.sse - ss_pe, 0.0)
        f = (ss_lof / df_lof) / (ss_pe / df_pe)
        return LackOfFit(df_lof, df_pe, ss_lof, ss_pe, f, float(fdtrc(df_lof, df_pe, f)))

    @property
    def df_pure_error(self) -> int:
        """Degrees of freedom of pure error: runs that repeat a setting within a block."""
        if self.setting_ids is None:
            return 0
        return pure_error(self.y, self.weights, self.setting_ids, self.block_ids)[0]

    def anova(self) -> tuple[AnovaRow, ...]:
        """Sequential analysis of variance; groups of terms that the model does not hold are left out.

        The order is that of R's ``rsm``: blocks, first order (FO), categories, interactions (TWI), squares (PQ),
        residual, the residual split into lack of fit and pure error, total.
        """
        root, nan = np.sqrt(self.weights), float("nan")
        X = self.Z * root[:, None]
        kind = np.array(self.kinds)
        held = [key for key in _GROUPS if key in self.kinds]
        constant = "intercept" in self.kinds and np.ptp(self.y) == 0.0
        scores = self.y - self.y[0] if constant else self.y  # equal scores leave no rounding dust
        parts = sequential_ss([X[:, kind == "intercept"], *(X[:, kind == key] for key in held)], scores * root)
        ms_error = _over(self.sse, self.df_residual)
        rows = []
        for key, (df, ss) in zip(held, parts[1:], strict=True):
            f = _over(_over(ss, df), ms_error * self.inflation)
            rows.append(AnovaRow(_GROUPS[key], df, ss, _over(ss, df), f, float(fdtrc(df, self.df_residual, f))))
        rows.append(AnovaRow("residual", self.df_residual, self.sse, ms_error, nan, nan))
        lack = self.lack_of_fit()
        if isinstance(lack, LackOfFit):
            rows.append(AnovaRow("lack of fit", lack.df_lof, lack.ss_lof, lack.ss_lof / lack.df_lof, lack.f, lack.p))
            rows.append(AnovaRow("pure error", lack.df_pe, lack.ss_pe, lack.ss_pe / lack.df_pe, nan, nan))
        rows.append(AnovaRow("total", self.n_runs - parts[0][0], self.sst, nan, nan, nan))
        return tuple(rows)

    def vif(self) -> FloatArray:
        """Variance inflation factors (p,): variance over that of the column alone; nan for the intercept."""
        w = self.weights[:, None]
        centre = np.sum(w * self.Z, axis=0) / np.sum(w) if "intercept" in self.kinds else np.zeros(self.n_terms)
        own = np.sum(w * np.square(self.Z - centre), axis=0)
        vif = np.diagonal(self.covariance_unscaled) * own / self.inflation
        return np.where(np.array(self.kinds) == "intercept", np.nan, vif)


def known_scatter(s: float) -> float:
    """Standard deviation ``s`` of runs, nan where it is 0: that none was seen does not mean that there is none."""
    return s if s > 0.0 else float("nan")


def _check_runs(Z: FloatArray, y: FloatArray, weights: FloatArray) -> None:
    """Refuse runs whose score, weight or setting cannot be used, all at once and by number."""
    problems = []
    for bad, what in (
        (~np.isfinite(y), "a score that is not a finite number"),
        (~(np.isfinite(weights) & (weights > 0.0)), "a weight that is not a positive finite number"),
        (~np.all(np.isfinite(Z), axis=1), "a setting that is not a finite number"),
    ):
        if np.any(bad):
            runs = ", ".join(str(i + 1) for i in np.flatnonzero(bad))
            problems.append(Problem(f"run {runs} (counted from 1) has {what}", "void it or correct it"))
    if problems:
        raise FitError(*problems)


def fit_least_squares(
    Z: FloatArray,
    y: FloatArray,
    terms: Sequence[Term | str],
    *,
    weights: FloatArray | None = None,
    setting_ids: Sequence[object] | IntArray | None = None,
    block_ids: Sequence[object] | IntArray | None = None,
    inflation: float = 1.0,
    tolerance: float = 0.0,
) -> LeastSquaresFit:
    """Fit ``y = Z b + e``, Var e_i = sigma^2 / weight_i, by refined orthogonal factorisation.

    Parameters
    ----------
    Z : ndarray (n, p)
        Model matrix in coded units, n >= p.
    y : ndarray (n,)
        Scores.
    terms : sequence (p,)
        Terms of the columns; a plain string names a block column (see :func:`block_columns`).
    weights : ndarray (n,), optional
        Inverse relative variances, > 0; default 1.
    setting_ids : sequence (n,), optional
        Equal for runs with the same *executed* settings; needed for pure error.
    block_ids : sequence (n,), optional
        Pure error is taken within blocks; by default those that the block columns tell apart.
    inflation : float
        See `LeastSquaresFit`.
    tolerance : float
        Root-mean-square error of the elements of ``Z``: a combination of columns that is no larger is zero.

    Raises
    ------
    FitError
        Fewer runs than terms, or a score, weight or setting that is not a finite number; all such runs are named.
    AliasedError
        Terms that take part in a linear dependence.
    """
    Z = np.ascontiguousarray(Z, dtype=np.float64)
    y = np.ascontiguousarray(y, dtype=np.float64)
    w = np.ones(y.shape[0]) if weights is None else np.ascontiguousarray(weights, dtype=np.float64)
    names = tuple(term if isinstance(term, str) else term.name for term in terms)
    kinds = tuple("block" if isinstance(term, str) else term.kind for term in terms)
    _check_runs(Z, y, w)
    if y.size < len(names):
        remedy = f"add {len(names) - y.size} runs, use fewer terms, or fit with an informative prior"
        raise FitError(f"{y.size} runs cannot determine {len(names)} terms", remedy)
    (n, p), intercept = Z.shape, "intercept" in kinds
    if block_ids is None and "block" in kinds:
        block_ids = [tuple(row) for row in Z[:, np.array(kinds) == "block"].tolist()]
    root = np.sqrt(w)
    factors = linear_system.factorise(Z * root[:, None])
    _, sizes, rows = np.linalg.svd(Z, full_matrices=False)
    null = factors.null if factors.rank < p else rows[sizes <= tolerance * np.sqrt(n)].T
    if null.size:
        involved = np.any(np.abs(null) > max(_DUST, 10.0 * tolerance), axis=1)
        raise AliasedError([*compress(names, involved)], null.shape[1])
    estimate, r = linear_system.solve(factors, y * root)
    # Residuals below the rounding of the scores as stored carry no information: the fit is exact.
    if np.linalg.norm(r) <= max(n, p) * linear_system.EPSILON * np.linalg.norm(y * root) or n == p:
        r = np.zeros(n)
    if intercept and float(np.ptp(y)) == 0.0:  # no rounding dust, whose sign would place an optimum
        estimate = np.where(np.array(kinds) == "intercept", y[0], 0.0)
    L = linear_system.covariance_factor(factors)
    C = inflation * linear_system.covariance(factors, L)
    sse = float(r @ r)
    s = float(np.sqrt(_over(sse, n - p)))
    leverage = np.minimum(np.sum(np.square(factors.Q), axis=1), 1.0)
    shifted = y - y[0]  # no digits are lost to a large mean
    centred = shifted - np.sum(w * shifted) / np.sum(w) if intercept else y
    sst = float(np.sum(w * np.square(centred)))
    studentised, cooks_distance, press, leverage_one_runs = _run_diagnostics(r, leverage, n - p, p, tolerance)
    r2 = 1.0 - _over(sse, sst)
    return LeastSquaresFit(
        names=names,
        kinds=kinds,
        estimate=estimate,
        se=known_scatter(s) * np.sqrt(np.diagonal(C)),
        covariance_unscaled=C,
        s=s,
        n_runs=n,
        n_terms=p,
        df_residual=n - p,
        sse=sse,
        sst=sst,
        r2=r2,
        r2_adjusted=1.0 - _over((1.0 - r2) * (n - intercept), n - p),
        press=press,
        r2_predicted=1.0 - _over(press, sst),
        fitted=y - r / root,
        residuals=r / root,
        leverage=leverage,
        studentised=studentised,
        cooks_distance=cooks_distance,
        condition_number=factors.condition_number,
        leverage_one_runs=leverage_one_runs,
        reason=_reason(n, p, sse),
        Z=Z,
        y=y,
        weights=w,
        setting_ids=group_index(setting_ids),
        block_ids=group_index(block_ids),
        factor=np.sqrt(inflation) * L,
        inflation=inflation,
    )


def _over(part: float, whole: float) -> float:
    """A share or mean; nan where there is nothing that it could be of."""
    return part / whole if whole > 0.0 else float("nan")


def block_columns(block_ids: Iterable[object]) -> tuple[FloatArray, tuple[str, ...]]:
    """Sum-to-zero contrasts (n, b - 1) of blocks (flight days, sources), by order of first appearance, and names.

    Column j is 1 in block j, -1 in the last block, else 0; zeros are the unweighted mean of the blocks. Names
    ``"block[<id>]"`` are to be appended to the terms: a plain string is a block column.
    """
    ids = list(block_ids)
    order = list(dict.fromkeys(ids))
    index = np.array([order.index(i) for i in ids], dtype=np.int64)
    contrasts = np.vstack([np.eye(len(order) - 1), -np.ones(len(order) - 1)]) if len(order) > 1 else np.zeros((1, 0))
    return contrasts[index] if ids else np.zeros((0, 0)), tuple(f"block[{name}]" for name in order[:-1])


def _reason(n: int, p: int, sse: float) -> str:
    if n == p:
        return "as many terms as runs: no residual degrees of freedom"
    return "the model reproduces every score exactly: s is 0 and F tests are undefined" if sse == 0.0 else ""


OUTLIER = 0.05  # familywise level of the outlier test


@dataclass(frozen=True, slots=True)
class NormalPlot:
    """Ordered studentised residuals beside the normal quantiles they should follow."""

    runs: IntArray
    """(m,): index of the run of each residual; runs without one (leverage 1) are left out."""
    quantiles: FloatArray
    residuals: FloatArray
    """(m,): Blom's normal scores, and the externally studentised residuals in ascending order."""
    correlation: float
    """Of the two; near 1 for normal errors, nan for fewer than 3 runs."""


@dataclass(frozen=True, slots=True)
class InfluentialRun:
    """A run that stands out."""

    run: int
    """Index."""
    leverage: float
    cooks_distance: float
    studentised: float

    reasons: tuple[str, ...]
    """Sentences with the figure and the limit it passes."""


def normal_plot(fit: LeastSquaresFit) -> NormalPlot:
    """Data of the normal plot; empty where no residual is defined."""
    runs = np.flatnonzero(np.isfinite(fit.studentised)).astype(np.int64)
    runs = runs[np.argsort(fit.studentised[runs], kind="stable")]
    residuals = fit.studentised[runs]
    quantiles = np.asarray(ndtri((np.arange(1.0, runs.size + 1.0) - 0.375) / (runs.size + 0.25)), dtype=np.float64)
    spread = runs.size > 2 and float(np.ptp(residuals)) > 0.0
    correlation = float(np.corrcoef(quantiles, residuals)[0, 1]) if spread else float("nan")
    return NormalPlot(runs, quantiles, residuals, correlation)


def outlier_p(fit: LeastSquaresFit) -> FloatArray:
    """P of Bonferroni's outlier test of each run: n p(|t|), t externally studentised; nan where it has none."""
    if fit.df_residual < 2:
        return np.full(fit.n_runs, np.nan)
    tested = np.count_nonzero(np.isfinite(fit.studentised))
    chance: FloatArray = 2.0 * tested * stdtr(fit.df_residual - 1.0, -np.abs(fit.studentised))
    return chance


def influential_runs(fit: LeastSquaresFit) -> tuple[InfluentialRun, ...]:
    """Runs with Cook's distance above 4/n, leverage above 2p/n, or a residual that fails the outlier test.

    The largest Cook's distance first.
    """
    n, p = fit.n_runs, fit.n_terms
    chance, tested = outlier_p(fit), int(np.count_nonzero(np.isfinite(fit.studentised)))
    found = []
    for i in range(n):
        h, d, t = float(fit.leverage[i]), float(fit.cooks_distance[i]), float(fit.studentised[i])
        reasons = []
        if i in fit.leverage_one_runs:
            reasons.append("leverage 1, so its score cannot be checked")
        elif h > 2.0 * p / n:
            reasons.append(f"high leverage ({h:.2f}, above 2p/n = {2.0 * p / n:.2f})")
        if d > 4.0 / n:
            reasons.append(f"influential (Cook's distance {d:.3g}, above 4/n = {4.0 / n:.2g})")
        if chance[i] < OUTLIER:
            size = f"{t:.1f}".replace("-", "\u2212")
            reasons.append(f"outlier (studentised residual {size}, p = {max(chance[i], 1e-6):.2g} over {tested} runs)")
        if reasons:
            found.append(InfluentialRun(i, h, d, t, tuple(reasons)))
    return tuple(sorted(found, key=lambda run: -run.cooks_distance if np.isfinite(run.cooks_distance) else -np.inf))


def extrapolated(fit: LeastSquaresFit, rows: FloatArray) -> BoolArray:
    """Which model rows (m, p) are further from the runs than any run is: z'Cz above that of every run.

    Both sides leave out the weights: a precise run does not reach further.
    """
    limit = float(np.max(fit.variance_unscaled(fit.Z)))
    return np.asarray(fit.variance_unscaled(rows) > limit * (1.0 + 1e-9))
