"""Simulated campaigns that move in step, for the rehearsal of a stop rule.

The noise e stands for the scores: with b the truth, y = Zb + e, so that the estimate is ``b + C Z'e`` and the sums of
squares are those of e; nothing is lost to cancellation, and hundreds of campaigns share each matrix product.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.special import fdtrc

from seqrsm.arrays import BoolArray, FloatArray, IntArray
from seqrsm.decide.intervals import half_width, t_quantile
from seqrsm.decide.rule import StopRule, conditions, rule_half_width
from seqrsm.design.evaluate import is_saturated
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.errors import DesignError, Problem
from seqrsm.fit.optimum import Goal, optimum_draws
from seqrsm.fit.rank_one import downdate, is_reserved_run, optimum_targets


class Stage:
    """What all campaigns share: settings that can be run, their model rows and products of these.

    Parameters
    ----------
    model, region : QuadraticModel, Region
    start : ndarray (n0, k)
        Coded start design, with its repeats; n0 > p and estimable.
    rule : StopRule
    batch_size : int
        Runs between two looks, >= 1.
    goal : "maximize" or "minimize"
    spread_share : float
        Share of a campaign's runs kept for repeats and spread, in [0, 1].
    n_targets : int
        Posterior draws of the optimum per look.
    n_candidates : int
        Points to choose runs from.

    Raises
    ------
    DesignError
        The start design cannot estimate the model and its noise.
    """

    def __init__(
        self,
        model: QuadraticModel,
        region: Region,
        start: FloatArray,
        rule: StopRule,
        batch_size: int = 4,
        goal: Goal = "maximize",
        spread_share: float = 0.25,
        n_targets: int = 16,
        n_candidates: int = 700,
    ) -> None:
        start = np.atleast_2d(np.asarray(start, dtype=np.float64))
        if len(start) <= model.p or np.linalg.matrix_rank(model.matrix(start)) < model.p:
            raise DesignError(
                Problem(
                    f"{len(start)} start runs cannot estimate {model.p} terms and the noise",
                    f"Start with an optimal design of {model.p + 4} runs or more.",
                    field="start_points",
                )
            )
        self.model, self.region, self.rule, self.goal = model, region, rule, goal
        self.batch_size, self.spread_share, self.n_targets = max(1, batch_size), spread_share, n_targets
        settings = np.vstack([start, region.candidates(limit=n_candidates)])
        _, first, inverse = np.unique(np.round(settings, 9) + 0.0, axis=0, return_index=True, return_inverse=True)
        self.Z = model.matrix(settings[first])
        self.start = inverse.ravel()[: len(start)]
        self.saturated = is_saturated(model, region)
        # z'Hz of every setting for many symmetric H at once: products of columns, off-diagonal ones twice.
        self.upper = np.triu_indices(model.p)
        self.products = self.Z[:, self.upper[0]] * self.Z[:, self.upper[1]]
        self.twice = np.where(self.upper[0] == self.upper[1], 1.0, 2.0)

    def forms(self, H: FloatArray) -> FloatArray:
        """Quadratic forms z'Hz for symmetric H (g, p, p) at all settings: (g, settings)."""
        packed = H[:, self.upper[0], self.upper[1]] * self.twice
        return np.asarray(packed @ self.products.T)


class Campaigns:
    """Campaigns with their own truths and noise, one look at a time."""

    def __init__(self, stage: Stage, betas: FloatArray, sigmas: FloatArray, rng: np.random.Generator) -> None:
        self.stage, self.betas, self.sigmas, self.rng = stage, betas, sigmas, rng
        g, p, j = len(betas), stage.model.p, len(stage.Z)
        self.A = np.zeros((g, p, p))
        self.Ze = np.zeros((g, p))
        self.ee = np.zeros(g)
        self.counts = np.zeros((g, j))
        self.sums = np.zeros((g, j))
        self.alive = np.arange(g)
        self.extra = np.zeros(g, dtype=np.int64)
        self.best = optimum_draws(stage.model, stage.region, betas, stage.goal, refine=False)[1]
        names = ("stopped", "runs", "half_width", "covers_rule", "covers_new_run", "covers_mean")
        self.out = {name: np.zeros(g) for name in (*names, "covers_confirmation", "regret", "s_ratio")}
        self.n = 0
        for index in stage.start:
            self.execute(np.full(g, index))

    def execute(self, settings: IntArray) -> None:
        """One run of every campaign that is alive."""
        rows, z = self.alive, self.stage.Z[settings]
        e = self.sigmas[rows] * self.rng.standard_normal(len(rows))
        self.A[rows] += z[:, :, None] * z[:, None, :]
        self.Ze[rows] += z * e[:, None]
        self.ee[rows] += e**2
        self.counts[rows, settings] += 1.0
        self.sums[rows, settings] += e
        self.n += 1

    def run(self, report: Callable[[int], None]) -> dict[str, FloatArray]:
        """Carry all campaigns to their end; ``report`` gets the number that have ended after each look."""
        total = len(self.betas)
        while len(self.alive):
            C, estimate, s, z_hat = self.look()
            report(total - len(self.alive))
            if len(self.alive):
                self.batch(C, estimate, s, z_hat)
        return self.out

    def look(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Fit, apply the rule, close campaigns that end; return the fits of those that go on."""
        stage, rule, rows, p = self.stage, self.stage.rule, self.alive, self.stage.model.p
        C = np.linalg.inv(self.A[rows])
        error = (C @ self.Ze[rows][:, :, None])[..., 0]
        sse = np.maximum(self.ee[rows] - np.sum(self.Ze[rows] * error, axis=1), 0.0)
        s = np.sqrt(sse / (self.n - p))
        estimate = self.betas[rows] + error
        points, _ = optimum_draws(stage.model, stage.region, estimate, stage.goal, refine=False)
        z_hat = stage.model.matrix(points)
        h = np.sum((C @ z_hat[:, :, None])[..., 0] * z_hat, axis=1)
        before = max(self.n - stage.batch_size, 0) if self.n > len(stage.start) else 0
        width = rule_half_width(rule, s, self.n - p, h, p, n_runs=self.n, n_before=before)
        df_pure, lof_p = self.lack_of_fit(rows, sse)
        runs = np.full(len(rows), self.n)
        found = conditions(rule, n_runs=runs, n_terms=p, df_pure_error=df_pure, lack_of_fit_p=lof_p, half_width=width)
        stop = np.logical_and.reduce([np.broadcast_to(v, len(rows)) for v in found.values()])
        fresh = self.sigmas[rows, None] * self.rng.standard_normal((len(rows), rule.replicates))
        miss = np.sum(z_hat * error, axis=1)
        if rule.guard == "confirmation":
            limit = half_width("prediction_mean", s, self.n - p, h, rule.level, rule.replicates)
            self.extra[rows[stop]] += rule.replicates
            stop &= np.abs(fresh.mean(axis=1) - miss) <= limit
        ends = stop | (self.n + self.extra[rows] >= rule.max_runs)
        self.close(rows, ends, stop, s, h, width, miss, fresh, z_hat)
        self.alive = rows[~ends]
        return C[~ends], estimate[~ends], s[~ends], z_hat[~ends]

    def lack_of_fit(self, rows: IntArray, sse: FloatArray) -> tuple[IntArray, FloatArray]:
        """Degrees of freedom of pure error and p of the lack-of-fit test (nan where it cannot be made)."""
        counts = self.counts[rows]
        distinct = np.count_nonzero(counts, axis=1)
        df_pure, df_lof = self.n - distinct, distinct - self.stage.model.p
        between = np.sum(self.sums[rows] ** 2 / np.maximum(counts, 1.0), axis=1)
        ss_pure = np.maximum(self.ee[rows] - between, 0.0)
        testable = (df_pure > 0) & (df_lof > 0)
        with np.errstate(divide="ignore", invalid="ignore"):
            f = np.maximum(sse - ss_pure, 0.0) / df_lof / (ss_pure / df_pure)
        if self.stage.saturated:
            return df_pure, np.ones(len(rows))
        p = fdtrc(np.maximum(df_lof, 1), np.maximum(df_pure, 1), np.where(testable, f, 0.0))
        return df_pure, np.where(testable, p, np.nan)

    def close(
        self,
        rows: IntArray,
        ends: BoolArray,
        stop: BoolArray,
        s: FloatArray,
        h: FloatArray,
        width: FloatArray,
        miss: FloatArray,
        fresh: FloatArray,
        z_hat: FloatArray,
    ) -> None:
        """Record what the intervals of the campaigns that end are worth."""
        rule, df = self.stage.rule, self.n - self.stage.model.p
        new_run = self.sigmas[rows] * self.rng.standard_normal(len(rows))
        new_mean = (self.sigmas[rows, None] * self.rng.standard_normal((len(rows), rule.replicates))).mean(axis=1)
        future = {"prediction": new_run, "prediction_mean": new_mean, "confidence": np.zeros(len(rows))}[rule.interval]
        t_fresh = t_quantile(rule.replicates - 1, rule.level) / np.sqrt(rule.replicates)
        sign = 1.0 if self.stage.goal == "maximize" else -1.0
        reached = np.sum(z_hat * self.betas[rows], axis=1)
        found = {
            "stopped": stop,
            "runs": self.n + self.extra[rows],
            "half_width": width,
            "covers_rule": np.abs(future - miss) <= width,
            "covers_new_run": np.abs(new_run - miss) <= half_width("prediction", s, df, h, rule.level),
            "covers_mean": np.abs(miss) <= half_width("confidence", s, df, h, rule.level),
            "covers_confirmation": np.abs(fresh.mean(axis=1)) <= t_fresh * fresh.std(axis=1, ddof=1),
            "regret": np.maximum(sign * (self.best[rows] - reached), 0.0),
            "s_ratio": np.divide(s, self.sigmas[rows], out=np.ones(len(rows)), where=self.sigmas[rows] > 0.0),
        }
        for name, values in found.items():
            self.out[name][rows[ends]] = values[ends]

    def batch(self, C: FloatArray, estimate: FloatArray, s: FloatArray, z_hat: FloatArray) -> None:
        """Choose and carry out the next runs of every campaign that is alive."""
        stage, rows = self.stage, self.alive
        W = self.targets(C, estimate, s, z_hat)
        left = stage.rule.max_runs - self.n - int(self.extra[rows].max())
        for _ in range(max(1, min(stage.batch_size, left))):
            variance = 1.0 + stage.forms(C)
            executed = self.counts[rows] > 0.0
            if is_reserved_run(self.n, stage.spread_share):
                short = (self.n - np.count_nonzero(executed, axis=1) < stage.rule.min_df_pure_error)[:, None]
                repeat = np.where(executed, stage.forms(C @ W @ C) / variance, -np.inf)
                spread = np.where(executed, -np.inf, variance)
                gains = np.where(short, repeat, spread)
            else:
                gains = stage.forms(C @ W @ C) / variance
            settings = np.argmax(gains, axis=1)
            self.execute(settings)
            C = downdate(C, stage.Z[settings])

    def targets(self, C: FloatArray, estimate: FloatArray, s: FloatArray, z_hat: FloatArray) -> FloatArray:
        """Matrix W of the default criterion from posterior draws of every campaign."""
        stage, (g, p) = self.stage, estimate.shape
        df = self.n - p
        sigma = s[:, None] * np.sqrt(df / self.rng.chisquare(df, size=(g, stage.n_targets)))
        normal = self.rng.standard_normal((g, stage.n_targets, p))
        root = np.linalg.cholesky(0.5 * (C + np.swapaxes(C, 1, 2)))
        draws = estimate[:, None, :] + sigma[..., None] * (normal @ np.swapaxes(root, 1, 2))
        points, _ = optimum_draws(stage.model, stage.region, draws.reshape(-1, p), stage.goal, refine=False)
        z_star = stage.model.matrix(points).reshape(g, stage.n_targets, p)
        value, regret = optimum_targets(z_hat, z_star)
        return value + regret
