"""Monte Carlo of every interval and test, each with a control that must fail; ``statistics_study.py`` runs it.

A study gives rows: what it is, the share of data sets in which it holds, what it should be, and a control in which one
thing is wrong on purpose.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy import stats

from seqrsm.design.factors import ContinuousFactor
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.fit.blocks import fit_random_blocks
from seqrsm.fit.intervals import t_quantile
from seqrsm.fit.least_squares import LeastSquaresFit, block_columns, fit_least_squares
from seqrsm.fit.natural import natural_transform

LEVEL = 0.95
COMPARED = "without the search, to compare"
DRAWS = 2000
"""Of a posterior: the quantiles of fewer are too near to the middle (of 400, 95 % becomes 94.5 %)."""


@dataclass(frozen=True)
class Row:
    """One line: the share found of ``sets``, the nominal share, whether more than that is right, too; the control."""

    name: str
    share: float
    nominal: float
    at_least: bool
    sets: int
    control: str = ""
    control_share: float = float("nan")

    @property
    def error(self) -> float:
        """Monte Carlo standard error."""
        return float(np.sqrt(self.nominal * (1.0 - self.nominal) / self.sets))

    @property
    def holds(self) -> bool:
        """Within 1 % (or above), four standard errors allowed where these are more."""
        width = max(0.01, 4.0 * self.error)
        return self.share >= self.nominal - width and (self.at_least or self.share <= self.nominal + width)


Study = Callable[[int], Iterator[Row]]


def surface(
    k: int, n: int, curvature: float = 6.0, tilt: float = 0.2
) -> tuple[QuadraticModel, Region, np.ndarray, np.ndarray]:
    """Model, region, runs and coefficients: corners and random runs, curvature and slope the same in every factor."""
    factors = tuple(ContinuousFactor(f"x{i}", -1.0, 1.0) for i in range(k))
    model, region = QuadraticModel(factors), Region(factors)
    points = region.sample(n, np.random.default_rng(1))
    corners = [[2.0 * (i >> j & 1) - 1.0 for j in range(k)] for i in range(2**k)]
    points[: 2**k] = corners
    kinds = np.array([term.kind for term in model.terms])
    beta = np.where(kinds == "square", -curvature, np.where(kinds == "linear", tilt * curvature, 0.0))
    beta[0] = 70.0
    return model, region, points, beta


def many(
    Z: np.ndarray,
    mean: np.ndarray,
    terms: list,
    sets: int,
    sigma: float,
    rng: np.random.Generator,
    w: np.ndarray | None = None,
) -> tuple[LeastSquaresFit, np.ndarray, np.ndarray, np.ndarray]:
    """A fit of the design, and scores (sets, n), estimates (sets, p) and s (sets,) of all data sets."""
    weights = np.ones(len(Z)) if w is None else w
    y = mean + sigma * rng.normal(size=(sets, len(Z))) / np.sqrt(weights)
    fit = fit_least_squares(Z, y[0], terms, weights=weights)
    estimates = (y * weights) @ Z @ fit.covariance_unscaled
    s = np.sqrt(np.sum(weights * np.square(y - estimates @ Z.T), axis=1) / fit.df_residual)
    return fit, y, estimates, s


def fixed_settings(sets: int) -> Iterator[Row]:
    """Coefficients, mean, one run, weighted run, mean of five, in blocks: settings fixed beforehand."""
    model, _, points, beta = surface(3, 18)
    rng = np.random.default_rng(1)
    w, Z = rng.uniform(0.3, 3.0, 18), model.matrix(points)
    fit, _, b, s = many(Z, Z @ beta, list(model.terms), sets, 2.0, rng, w)
    t, z = t_quantile(fit.df_residual, LEVEL), float(stats.norm.ppf(0.5 + 0.5 * LEVEL))
    size = np.sqrt(np.diagonal(fit.covariance_unscaled))
    inside = np.abs(b - beta) <= t * s[:, None] * size
    wrong = np.abs(b - beta) <= z * s[:, None] * size
    worst = int(np.argmax(np.abs(np.mean(inside, axis=0) - LEVEL)))
    yield Row(
        "coefficient (the worst of ten)",
        inside.mean(axis=0)[worst],
        LEVEL,
        False,
        sets,
        "normal quantile",
        wrong.mean(),
    )
    row = model.matrix(np.array([[0.3, -0.4, 0.6]]))
    gap, h = (b - beta) @ row[0], float(fit.variance_unscaled(row)[0])
    yield Row(
        "mean at a setting",
        np.mean(np.abs(gap) <= t * s * np.sqrt(h)),
        LEVEL,
        False,
        sets,
        "sigma of another campaign",
        np.mean(np.abs(gap) <= t * 1.5 * np.sqrt(h)),
    )
    for name, weight, m in (
        ("one future run", 1.0, 1),
        ("one future run of weight 2.5", 2.5, 1),
        ("mean of five future runs", 1.0, 5),
    ):
        own = 1.0 / (weight * m)
        miss = np.abs(gap - 2.0 * np.sqrt(own) * rng.normal(size=sets))
        yield Row(
            name,
            np.mean(miss <= t * s * np.sqrt(own + h)),
            LEVEL,
            False,
            sets,
            "without the 1 of eq. 2-23",
            np.mean(miss <= t * s * np.sqrt(h)),
        )
    factors = (ContinuousFactor("f", 1.0, 18.0, scale="log"), ContinuousFactor("x", 20.0, 70.0))
    two, region = QuadraticModel(factors), Region(factors)
    Z = two.matrix(region.sample(14, rng))
    truth = np.array([70.0, 4, -3, 2, -6, -5])
    fit, _, b, s = many(Z, Z @ truth, list(two.terms), sets, 2.0, rng)
    natural = fit.predict(natural_transform(two), LEVEL)
    half = 0.5 * (natural.confidence.high - natural.confidence.low) / fit.s * s[:, None]
    off = np.abs((b - truth) @ natural_transform(two).T)
    shares = np.mean(off <= half, axis=0)
    wrong = np.mean(off <= half * np.abs(np.diagonal(natural_transform(two))) * fit.se / natural.se_mean, axis=0)
    worst = int(np.argmax(np.abs(shares - LEVEL)))
    yield Row(
        "natural-unit coefficient (worst of six)",
        shares[worst],
        LEVEL,
        False,
        sets,
        "covariances forgotten",
        wrong.min(),
    )
    days = np.arange(18) % 3
    columns, names = block_columns(days.tolist())
    model, _, points, beta = surface(2, 18)
    Z, effect = np.hstack([model.matrix(points), columns]), np.array([1.5, -0.5, -1.0])
    fit, _, b, s = many(Z, Z[:, :6] @ beta + effect[days], [*model.terms, *names], sets, 1.0, rng)
    t = t_quantile(fit.df_residual, LEVEL)
    for name, extra, shift in (
        ("one run in a block already run (fixed)", columns[0], effect[0]),
        ("one run in the mean block (fixed)", np.zeros(2), 0.0),
    ):
        row = np.hstack([model.matrix(np.array([[0.3, -0.4]])), extra[None, :]])
        future = float(row[0, :6] @ beta) + shift + rng.normal(size=sets)
        h = float(fit.variance_unscaled(row)[0])
        miss = np.abs(b @ row[0] - future)
        control = (
            np.mean(np.abs(b[:, :6] @ row[0, :6] - future) <= t * s * np.sqrt(1 + h))
            if shift
            else np.mean(miss <= t * s * np.sqrt(h))
        )
        yield Row(
            name,
            np.mean(miss <= t * s * np.sqrt(1.0 + h)),
            LEVEL,
            False,
            sets,
            "block forgotten" if shift else "without the 1",
            control,
        )


def random_day(sets: int) -> Iterator[Row]:
    """Eight days of five runs, the ratio of standard deviations drawn from its prior, half-Cauchy cut at 10."""
    model, _, points, beta = surface(2, 40)
    Z, days, rng = model.matrix(points), np.arange(40) % 8, np.random.default_rng(2)
    row = model.matrix(np.array([[0.3, -0.4]]))
    hits = np.zeros((sets, 5), dtype=bool)
    for i in range(sets):
        ratio = float(np.tan(0.5 * np.pi * rng.uniform(0.0, 2.0 / np.pi * np.arctan(10.0))))
        effect = ratio * rng.normal(size=8)
        y = Z @ beta + effect[days] + rng.normal(size=40)
        found = fit_random_blocks(Z, y, days.tolist())
        truth = float(row[0] @ beta)
        new = found.predict(row, LEVEL)
        plain = fit_least_squares(Z, y, list(model.terms)).predict(row, LEVEL).prediction
        low, high = found.sigma_ratio_interval(LEVEL)
        tomorrow = truth + ratio * rng.normal() + rng.normal()
        several = truth + ratio * rng.normal() + rng.normal() / np.sqrt(5.0)
        five = found.predict(row, LEVEL, replicates=5).prediction
        hits[i] = (
            new.confidence.low[0] <= truth <= new.confidence.high[0],
            new.prediction.low[0] <= tomorrow <= new.prediction.high[0],
            five.low[0] <= several <= five.high[0],
            low <= ratio <= high,
            plain.low[0] <= tomorrow <= plain.high[0],
        )
    names = (
        "mean of the average block (random)",
        "one run in a new block (random)",
        "mean of five runs in a new block (random)",
        "ratio of the standard deviations",
    )
    for j, name in enumerate(names):
        yield Row(
            name,
            hits[:, j].mean(),
            LEVEL,
            False,
            sets,
            "blocks forgotten" if j == 1 else "",
            hits[:, 4].mean() if j == 1 else float("nan"),
        )


def f_tests(sets: int) -> Iterator[Row]:
    """Sizes at 5 % of partial F tests of a term, a factor, groups; of the analysis of variance; of lack of fit."""
    rng = np.random.default_rng(8)
    model, _, points, _ = surface(2, 9)
    points = np.vstack([[(a, b) for a in (-1.0, 0.0, 1.0) for b in (-1.0, 0.0, 1.0)], points[4:]])
    days = [*(np.arange(len(points)) % 3).tolist()] * 2
    points = np.vstack([points, points])  # every setting twice on its day
    columns, names = block_columns(days)
    Z, w = np.hstack([model.matrix(points), columns]), rng.uniform(0.5, 2.0, len(points))
    ids = [tuple(row) for row in points]
    asked = {
        "one term": [3],
        "a factor": model.factor_terms("x0"),
        "squares": [4, 5],
        "a named group": [1, 3, 5],
        "blocks": [6, 7],
    }
    sources = ("blocks", "first order", "interactions", "squares")
    p = np.empty((sets, len(asked) + len(sources) + 1))
    wrong = np.empty(sets)
    for i in range(sets):
        fit = fit_least_squares(
            Z, 50.0 + rng.normal(size=len(points)) / np.sqrt(w), [*model.terms, *names], weights=w, setting_ids=ids
        )
        rows = {row.source: row for row in fit.anova()}
        lack = fit.lack_of_fit()
        assert not isinstance(lack, str)
        p[i] = [*(fit.partial_f(group).p for group in asked.values()), *(rows[name].p for name in sources), lack.p]
        wrong[i] = stats.f.sf(lack.f, lack.df_lof, fit.df_residual)
    for j, name in enumerate(
        [
            *(f"partial F: {name}" for name in asked),
            *(f"analysis of variance: {name}" for name in sources),
            "lack of fit",
        ]
    ):
        last = j == p.shape[1] - 1
        yield Row(
            f"size of {name}",
            np.mean(p[:, j] < 0.05),
            0.05,
            False,
            sets,
            "residual degrees of freedom" if last else "",
            np.mean(wrong < 0.05) if last else float("nan"),
        )
