"""Speed of the statistics for k = 5 and 40 runs: ``python tests/benchmarks/bench_fit.py``.

Ratios are to statsmodels and to emcee's own stretch move in the same run: absolute times depend on the machine. Set
OPENBLAS_NUM_THREADS=1: threads cost more than they give at these sizes.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

import emcee
import numpy as np
import statsmodels.api as sm
from scipy.special import gammaln
from statsmodels.stats.outliers_influence import OLSInfluence, variance_inflation_factor

from seqrsm.design.factors import ContinuousFactor
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.fit.conjugate import posterior
from seqrsm.fit.diagnostics import autocorrelation_time
from seqrsm.fit.ensemble import sample_posterior
from seqrsm.fit.importance import variance_shares
from seqrsm.fit.least_squares import fit_least_squares
from seqrsm.fit.location import best_settings, location_region
from seqrsm.fit.natural import natural_coefficients
from seqrsm.fit.optimum import optimum, optimum_draws
from seqrsm.fit.optimum_interval import searched_interval
from seqrsm.fit.profile import box_cox_profile
from seqrsm.fit.random_blocks import fit_random_blocks
from seqrsm.fit.residuals import influential_runs, normal_plot
from seqrsm.fit.selection import average_models

NU = 4.0


def median_time(function: Callable[[], object], repeats: int) -> float:
    function()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return statistics.median(times)


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
    begin = time.perf_counter()
    sampler.run_mcmc(start, steps)
    seconds = time.perf_counter() - begin
    chain = sampler.get_chain()[steps // 4 :]
    tau = float(np.max(autocorrelation_time(chain)))
    return chain.shape[0] * walkers / tau / seconds


def main() -> None:
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
        fit.anova(), fit.vif(), fit.interval(), fit.p_value, natural_coefficients(model, fit)
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
    a, b = median_time(ours, 30), median_time(theirs, 10)
    print(
        f"{'fit with all tables':38s}{1e3 * a:9.2f} ms   target 5 ms   statsmodels {1e3 * b:.1f} ms, ratio {b / a:.1f}"
    )
    a = median_time(lambda: optimum_draws(model, region, draws), 5)
    print(f"{'optima of 1,000 posterior draws':38s}{1e3 * a:9.0f} ms   target 300 ms")
    print(f"{'optimum of one surface':38s}{1e3 * median_time(lambda: optimum(model, region, fit.estimate), 9):9.2f} ms")
    for errors in ("normal", "student_t"):
        begin = time.perf_counter()
        sample = sample_posterior(Z, y, errors=errors, nu=NU, seed=1)
        a = time.perf_counter() - begin
        text = f"{'emcee, ' + errors:38s}{a:9.2f} s    target 5 s    "
        text += f"worst ESS {sample.ess.min():.0f}, of the ends {sample.ess_ends.min():.0f}, {sample.steps} steps"
        if errors == "student_t":
            mine = sample.walkers * sample.ensembles * sample.steps / float(sample.tau.max()) / a
            stock = stretch_ess_per_second(Z, y)
            text += f"; ESS/s {mine:.0f}, stretch {stock:.0f}, ratio {mine / stock:.1f}"
            text += f" (handed out: {sample.ess.min() / a:.0f} per s, ratio {sample.ess.min() / a / stock:.1f})"
        print(text)
    others: dict[str, Callable[[], object]] = {
        "location region (Scheffe)": lambda: location_region(best_settings(model, region, fit)),
        "interval allowing for the search": lambda: searched_interval(model, region, fit),
        "average over 38,619 models": lambda: average_models(Z, y, model.terms),
        "random days, with REML": lambda: fit_random_blocks(Z, y, days),
        "Box-Cox profile": lambda: box_cox_profile(Z, y),
        "variance shares of 1,000 surfaces": lambda: variance_shares(model, draws),
    }
    for name, function in others.items():
        print(f"{name:38s}{1e3 * median_time(function, 3):9.1f} ms")


if __name__ == "__main__":
    main()
