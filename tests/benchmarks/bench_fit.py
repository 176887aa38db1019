"""Speed of the statistics for k = 5 and 40 runs: ``python tests/benchmarks/bench_fit.py [--write]``.

Ratios are to statsmodels and to emcee's own stretch move in the same run: absolute times depend on the machine. Set
OPENBLAS_NUM_THREADS=1: threads cost more than they give at these sizes.
"""

from __future__ import annotations

import os
import shutil
import sys
import time
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
import emcee
import numpy as np
import statsmodels
import statsmodels.api as sm
from scipy.special import gammaln
from shorthands import sample_posterior
from statsmodels.stats.outliers_influence import OLSInfluence, variance_inflation_factor

from seqrsm.design.factors import ContinuousFactor
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.fit.blocks import fit_random_blocks
from seqrsm.fit.canonical import variance_shares
from seqrsm.fit.conjugate import LinearBounds, posterior
from seqrsm.fit.convergence import autocorrelation_time
from seqrsm.fit.ensemble import ENSEMBLES, WALKERS, Sampled, sample
from seqrsm.fit.error_models import StudentT
from seqrsm.fit.least_squares import fit_least_squares, influential_runs, normal_plot
from seqrsm.fit.natural import natural_transform
from seqrsm.fit.optimum import optimum, optimum_draws
from seqrsm.fit.score_models import CoefficientPrior, beta_binomial_model
from seqrsm.fit.target import general_target

NU = 4.0


def cpu_time(function: Callable[[], object], repeats: int) -> float:
    """Least CPU time of several calls [s], after one that compiles and loads."""
    function()
    times = []
    for _ in range(repeats):
        start = time.process_time()
        function()
        times.append(time.process_time() - start)
    return min(times)


def stretch_ess_per_second(Z: np.ndarray, y: np.ndarray, steps: int = 6000) -> float:
    """emcee with its default move on the Student-t model with flat priors, vectorised, started at the solution."""
    p = Z.shape[1]
    beta = np.linalg.lstsq(Z, y, rcond=None)[0]
    log_s = float(np.log(np.std(y - Z @ beta)))

    def log_prob(x: np.ndarray) -> np.ndarray:
        z = (y - x[:, :p] @ Z.T) * np.exp(-x[:, p])[:, None]
        value = -0.5 * (NU + 1) * np.sum(np.log1p(z**2 / NU), axis=1) - y.size * x[:, p]
        return value + y.size * (gammaln(0.5 * (NU + 1)) - gammaln(0.5 * NU))

    walkers = 128
    rng = np.random.default_rng(1)
    start = np.append(beta, log_s) + 0.1 * rng.normal(size=(walkers, p + 1))
    sampler = emcee.EnsembleSampler(walkers, p + 1, log_prob, vectorize=True)
    begin = time.process_time()
    sampler.run_mcmc(start, steps)
    seconds = time.process_time() - begin
    chain = sampler.get_chain()[steps // 4 :]
    tau = float(np.max(autocorrelation_time(chain)))
    return chain.shape[0] * walkers / tau / seconds


def samplers(Z: np.ndarray, y: np.ndarray, rng: np.random.Generator) -> dict[str, Callable[[], Sampled]]:
    """Every posterior that emcee samples, on the same 40 runs."""
    p = Z.shape[1]
    share = 1.0 / (1.0 + np.exp(-(y - 60.0) / 10.0))
    correct, trials = rng.binomial(200, share).astype(float), np.full(40, 200.0)
    logit = CoefficientPrior(np.zeros(p), np.diag(np.where(np.arange(p) == 0, 10.0, 2.5) ** -2.0))
    bounds = LinearBounds(np.eye(p)[1:3], np.array([0.0, -np.inf]), np.array([np.inf, 0.0]))
    return {
        "normal errors, flat prior": lambda: sample_posterior(Z, y, seed=1),
        "Student-t errors": lambda: sample_posterior(Z, y, errors=StudentT(), seed=1),
        "bounded effects of two factors": lambda: sample_posterior(Z, y, bounds=bounds, seed=1),
        "beta-binomial counts": lambda: sample(general_target(beta_binomial_model(Z, correct, trials, logit)), 1),
    }


def measure() -> list[str]:
    """The lines of the page."""
    factors = tuple(ContinuousFactor(f"x{i}", -1.0, 1.0) for i in range(5))
    model, region = QuadraticModel(factors), Region(factors)
    rng = np.random.default_rng(0)
    points = region.sample(40, rng)
    points[36:] = points[32:36]
    Z = model.matrix(points)
    beta = np.concatenate([[70.0], rng.normal(0, 3, 15), np.full(5, -5.0)])
    y = Z @ beta + rng.standard_t(4, size=40)
    ids = [tuple(row) for row in points]
    days = (np.arange(40) // 7).tolist()

    def ours() -> None:
        fit = fit_least_squares(Z, y, model.terms, setting_ids=ids)
        fit.anova(), fit.vif(), fit.interval(), fit.p_value, fit.predict(natural_transform(model))
        for factor in factors:
            fit.partial_f(model.factor_terms(factor.name))
        influential_runs(fit), normal_plot(fit)

    def theirs() -> None:
        fit = sm.OLS(y, Z).fit()
        fit.conf_int(), fit.pvalues
        influence = OLSInfluence(fit)
        _ = influence.resid_studentized_external, influence.cooks_distance, influence.resid_press
        [variance_inflation_factor(Z, i) for i in range(1, model.p)]
        for factor in factors:
            fit.f_test(np.eye(model.p)[model.factor_terms(factor.name)])
        for kind in ("linear", "interaction", "square"):
            sm.OLS(y, Z[:, [i for i, t in enumerate(model.terms) if t.kind != kind]]).fit().ssr  # noqa: B018

    fit = fit_least_squares(Z, y, model.terms, setting_ids=ids)
    draws = posterior(Z, y).draws(1000, rng)[0]
    a, b = cpu_time(ours, 30), cpu_time(theirs, 10)
    text = ["| what | CPU | aim | beside it |", "|---|---|---|---|"]
    text.append(
        f"| fit with all tables | {1e3 * a:.2f} ms | 5 ms | statsmodels, as many of the tables as it has: "
        f"{1e3 * b:.1f} ms, {b / a:.1f} times as long |"
    )
    a = cpu_time(lambda: optimum_draws(model, region, draws), 9)
    text.append(f"| exact optimum of 1,000 posterior draws | {1e3 * a:.0f} ms | 300 ms | |")
    text += [
        f"| {name} | {1e3 * cpu_time(function, 3):.1f} ms | | |"
        for name, function in {
            "exact optimum of one surface": lambda: optimum(model, region, fit.estimate),
            "random days, exact, with REML": lambda: fit_random_blocks(Z, y, days),
            "variance shares of 1,000 surfaces": lambda: variance_shares(model, draws),
        }.items()
    ]
    text += [
        "",
        "## emcee",
        "",
        "| posterior | CPU | aim | worst ESS | of interval ends | steps |",
        "|---|---|---|---|---|---|",
    ]
    for name, sampler in samplers(Z, y, rng).items():
        begin = time.process_time()
        sample = sampler()
        seconds = time.process_time() - begin
        text.append(
            f"| {name} | {seconds:.2f} s | 5 s | {sample.ess.min():.0f} | {sample.ess_ends.min():.0f} "
            f"| {sample.steps} |"
        )
        if name == "Student-t errors":
            mine = WALKERS * ENSEMBLES * sample.steps / float(sample.tau.max()) / seconds
            handed = sample.ess.min() / seconds
    stock = stretch_ess_per_second(Z, y)
    text += [
        "",
        "Student-t errors beside stock emcee (stretch moves, the same density vectorised, started at the solution, no",
        f"convergence rule): {mine:.0f} effective draws of the worst parameter per second of CPU against {stock:.0f},",
        f"{mine / stock:.0f} times as many (aim: 4 times); {handed / stock:.0f} times as many among those handed out, "
        "tuning and checks included.",
    ]
    return text


def main() -> None:
    before = os.getloadavg()[0]
    lines = measure()
    r = "R is present, but this program does not run it." if shutil.which("Rscript") else "R is not on this machine."
    text = "\n".join(
        [
            "# Speed of the statistics",
            "",
            "Written by `OPENBLAS_NUM_THREADS=1 python tests/benchmarks/bench_fit.py --write` with numpy",
            f"{np.__version__}, statsmodels {statsmodels.__version__}, emcee {emcee.__version__}, on one core of a",
            f"machine with a load of {before:.1f} before and {os.getloadavg()[0]:.1f} after on {os.cpu_count()} cores.",
            "CPU time: the least of several repeats; samplers run once. Five factors, 21 terms, 40 runs.",
            "",
            *lines,
            "",
            "Worst ESS: effective draws of the worst parameter among those handed out; a sampler that does not reach",
            f"4,000 with R-hat at most 1.01 and 50 autocorrelation times raises an error instead. {r}",
            "",
        ]
    )
    print(text)
    if "--write" in sys.argv:
        (Path(__file__).parents[2] / "reports" / "performance-statistics.md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
