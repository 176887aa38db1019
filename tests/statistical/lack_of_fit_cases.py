"""Simulated campaigns' data for the lack-of-fit decision: right quadratics with equal and unequal noise, wrong ones.

Runs lie as a campaign lays them: start design with three repeats at the centre, runs about the optimum and some spread
over the region, and four repeats at the optimum. The scores have a quadratic mean, curvature 6 noise standard
deviations, with a departure whose standard deviation over the region, beside the best quadratic, is ``size`` times the
noise. Unequal noise falls smoothly to ``ratio`` of its size elsewhere at the optimum.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from seqrsm.decide.discrepancy import evidence_limit, find_discrepancy
from seqrsm.decide.rule import StopRule
from seqrsm.decide.stopping import Adequacy, Departure, Look, decide
from seqrsm.design.factors import ContinuousFactor
from seqrsm.design.optimal import start_design
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.fit.anova import LackOfFit
from seqrsm.fit.least_squares import fit_least_squares
from seqrsm.fit.optimum import optimum

BEST = 0.25
DEPARTURES: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "cubic": lambda x: (x[:, 0] - BEST) ** 3,
    "peak": lambda x: np.exp(-2.0 * np.sum((x - BEST) ** 2, axis=1)),
    "saturating": lambda x: -np.exp(-2.0 * (x[:, 0] + 1.0)),
    "kink": lambda x: -np.abs(x[:, 0] - 0.5),
    "step": lambda x: (x[:, 0] > 0.4).astype(float),
    "wave": lambda x: np.sin(4.0 * x[:, 0] + 1.0) * np.cos(3.0 * x[:, -1]),
    "rough": lambda x: np.sin(1e4 * x @ np.arange(1.0, x.shape[1] + 1.0)),
}


@dataclass(frozen=True)
class Rates:
    """Shares of data sets: blocked by the rule, by the test against pure error alone (p < 0.05), excused by the rule
    though that test rejects; coverage of 95 % prediction intervals at the fitted optimum, of one run and of the mean of
    five, in all data sets and where the rule does not block; and of one run where the rule excuses."""

    sets: int
    blocked: float
    pure_error: float
    excused: float
    one_run: float
    mean_of_five: float
    one_run_passed: float
    mean_passed: float
    one_run_excused: float


def case(k: int) -> tuple[QuadraticModel, Region, np.ndarray]:
    """Model, region and runs: 3 p runs for k = 2 and more, of p terms."""
    model = QuadraticModel(tuple(ContinuousFactor(f"x{i}", -1.0, 1.0) for i in range(k)))
    region = Region(model.factors)
    start = start_design(model, region, model.p + 6, 3, 1)
    left = max(3 * model.p, model.p + 18) - len(start) - 4
    rng = np.random.default_rng(3)
    near = np.clip(BEST + 0.3 * rng.standard_normal((left * 3 // 4, k)), -1.0, 1.0)
    spread = rng.uniform(-1.0, 1.0, (left - len(near), k))
    return model, region, np.vstack([start, near, spread, np.full((4, k), BEST)])


def rates(k: int, sets: int, *, ratio: float = 1.0, departure: str = "", size: float = 0.0, seed: int = 0) -> Rates:
    model, region, points = case(k)
    rng = np.random.default_rng(seed)
    scale = 0.0
    if departure:
        cover = np.random.default_rng(9).uniform(-1.0, 1.0, (4000, k))
        rest = DEPARTURES[departure](cover)
        rest -= model.matrix(cover) @ np.linalg.lstsq(model.matrix(cover), rest, rcond=None)[0]
        scale = size / float(np.std(rest))

    def mean(x: np.ndarray) -> np.ndarray:
        return 70.0 - 6.0 * np.sum((x - BEST) ** 2, axis=1) + (scale * DEPARTURES[departure](x) if departure else 0.0)

    def noise(x: np.ndarray) -> np.ndarray:
        return 1.0 - (1.0 - ratio) * np.exp(-2.0 * np.sum((x - BEST) ** 2, axis=1))

    Z, ids = model.matrix(points), [tuple(row) for row in points]
    rule = StopRule(half_width=10.0)
    found = np.zeros((sets, 5), dtype=bool)
    for i in range(sets):
        y = mean(points) + noise(points) * rng.standard_normal(len(points))
        fit = fit_least_squares(Z, y, model.terms, setting_ids=ids)
        seen = find_discrepancy(model, points, Z, y)
        lack = fit.lack_of_fit()
        assert isinstance(lack, LackOfFit)
        limit = evidence_limit(fit.df_residual)
        smooth = Departure(seen.evidence, limit, seen.noise_evidence, float(np.exp(0.5 * seen.noise_slope)))
        look = Look(fit.n_runs, fit.n_terms, fit.s, fit.df_residual, lack.df_pe, h=0.1)
        decision = decide(rule, look, Adequacy(lack.p, departure=smooth))
        (check,) = (check for check in decision.checks if check.name == "lack_of_fit")
        at = optimum(model, region, fit.estimate).point[None, :]
        one, five = (fit.predict(model.matrix(at), replicates=m).prediction for m in (1, 5))
        truth, spread = float(mean(at)[0]), float(noise(at)[0])
        future = truth + spread * rng.standard_normal(2) / np.sqrt([1.0, 5.0])
        found[i] = (
            not check.holds,
            lack.p < 0.05,
            bool(check.holds) and lack.p < 0.05,
            one.low[0] <= future[0] <= one.high[0],
            five.low[0] <= future[1] <= five.high[0],
        )
    passed, excused = ~found[:, 0], found[:, 2]

    def share(of: np.ndarray) -> float:
        return float(np.mean(of)) if of.size else float("nan")

    return Rates(
        sets,
        *(share(found[:, j]) for j in range(5)),
        share(found[passed, 3]),
        share(found[passed, 4]),
        share(found[excused, 3]),
    )
