"""Statements in natural terms: the prior predictive says what was said, and data overrule it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from seqrsm.analysis.posterior import stated_prior
from seqrsm.design.factors import CategoricalFactor, ContinuousFactor, DiscreteFactor
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.fit.conjugate import NormalInverseGamma, posterior
from seqrsm.fit.elicitation import elicited_prior
from seqrsm.fit.intervals import t_quantile
from seqrsm.fit.least_squares import fit_least_squares
from seqrsm.fit.optimum import optimum_draws
from seqrsm.spec.read import load_spec

FACTORS = (
    ContinuousFactor("frequency", 1.0, 18.0, "GHz", "log"),
    CategoricalFactor("polarization", ("HH", "HV", "VV")),
    ContinuousFactor("angle", 20.0, 70.0, "deg"),
)
MODEL, REGION = QuadraticModel(FACTORS), Region(FACTORS)


def elicited(model, region, low=60.0, high=95.0, probability=0.9, repeats=None, optimum=None, goal="maximize"):
    """By default repeats scatter by a tenth of the range of the utility, worth three runs."""
    sd, runs = repeats or (0.1 * (high - low), 3.0)
    said = {"probability": probability, "repeat_sd": sd, "repeat_runs": runs, "optimum": optimum or {}, "goal": goal}
    return elicited_prior(model, region, (low, high), **said)


def prior_draws(prior, n: int = 20_000) -> np.ndarray:
    """Coefficients with sigma at its prior guess."""
    sigma = np.sqrt(prior.b0 / prior.a0)
    L = np.linalg.cholesky(np.linalg.inv(prior.Lambda0))
    return prior.m0 + sigma * (np.random.default_rng(0).normal(size=(n, MODEL.p)) @ L.T)


@pytest.mark.parametrize("optimum", [{}, {"frequency": (5.0, 0.3)}])
def test_response_lies_in_the_stated_range_with_the_stated_probability(optimum: dict[str, tuple[float, float]]) -> None:
    prior = elicited(MODEL, REGION, optimum=optimum, repeats=(2.0, 4.0))
    assert (prior.a0, prior.b0) == (2.0, 8.0)
    beta = prior_draws(prior)
    Z = MODEL.matrix(REGION.sample(len(beta), np.random.default_rng(1)))
    response = np.sum(Z * beta, axis=1)
    assert np.mean(response) == pytest.approx(77.5, abs=0.6)
    assert np.std(response) == pytest.approx(35.0 / 2 / 1.6448536269514722, rel=0.04)
    assert np.mean((response > 60) & (response < 95)) == pytest.approx(0.9, abs=0.02)


@pytest.mark.parametrize("goal", ["maximize", "minimize"])
def test_optimum_is_expected_near_what_was_said(goal: str) -> None:
    informed = elicited(MODEL, REGION, optimum={"frequency": (5.0, 0.2)}, goal=goal)
    silent = elicited(MODEL, REGION, goal=goal)
    at = float(FACTORS[0].code(5.0))
    share = []
    for prior in (informed, silent):
        beta = prior_draws(prior, 1000)
        points, _ = optimum_draws(MODEL, REGION, beta, goal)
        share.append(np.mean(np.abs(points[:, 0] - at) < 0.4))
    # the slope at 5 GHz is zero within the doubt whatever the interactions do
    row = np.zeros(MODEL.p)
    row[MODEL.term_names.index("frequency")], row[MODEL.term_names.index("frequency^2")] = 1.0, 2.0 * at
    assert row @ informed.m0 == pytest.approx(0.0, abs=1e-12)
    sigma = np.sqrt(informed.b0 / informed.a0)
    slope_sd = sigma * np.sqrt(row @ np.linalg.solve(informed.Lambda0, row))
    curvature = abs(informed.m0[MODEL.term_names.index("frequency^2")])
    assert slope_sd <= 2 * curvature * 0.2 * (1 + 1e-9)
    assert share[0] > 1.5 * share[1]


def test_one_factor_optimum_has_the_stated_doubt() -> None:
    """Without interactions the stationary point of the prior draws scatters by about what was said."""
    factor = (ContinuousFactor("x", 0.0, 10.0),)
    model, region = QuadraticModel(factor), Region(factor)
    prior = elicited(model, region, 0.0, 100.0, 0.95, optimum={"x": (6.0, 0.1)})
    sigma = np.sqrt(prior.b0 / prior.a0)
    L = np.linalg.cholesky(np.linalg.inv(prior.Lambda0))
    beta = prior.m0 + sigma * (np.random.default_rng(0).normal(size=(20_000, 3)) @ L.T)
    concave = beta[beta[:, 2] < 0.5 * prior.m0[2]]
    turning = 5.0 - 5.0 * concave[:, 1] / (2 * concave[:, 2])
    assert np.median(turning) == pytest.approx(6.0, abs=0.1)
    quarter = np.quantile(turning, [0.1587, 0.8413])
    assert 0.5 * np.ptp(quarter) == pytest.approx(0.5, rel=0.35)


def test_data_overrule() -> None:
    rng = np.random.default_rng(3)
    points = REGION.sample(60, rng)
    truth = rng.normal(0, 8, MODEL.p) + 200.0 * (np.arange(MODEL.p) == 0)
    y = MODEL.matrix(points) @ truth + rng.normal(size=60)
    prior = elicited(MODEL, REGION, optimum={"frequency": (5.0, 0.5)})
    found, flat = posterior(MODEL.matrix(points), y, None, prior), posterior(MODEL.matrix(points), y)
    np.testing.assert_allclose(found.mean, flat.mean, atol=4.0)
    few = posterior(MODEL.matrix(points[:4]), y[:4], None, prior)
    assert np.all(np.isfinite(few.mean))


def test_first_order_and_two_level_factors_take_no_optimum() -> None:
    factors = (ContinuousFactor("x", 0.0, 1.0), DiscreteFactor("d", (1.0, 2.0)))
    region = Region(factors)
    for model in (QuadraticModel(factors, 1), QuadraticModel(factors)):
        prior = elicited(model, region, optimum={"d": (1.5, 0.5)})
        assert np.linalg.eigvalsh(prior.Lambda0)[0] > 0
        assert prior.m0[0] == 77.5


STATED = """\
[campaign]
name = "t"
[[factor]]
name = "x"
low = 0.0
high = 10.0
[[application]]
name = "a"
utility = "percent_correct"
[application.prior]
utility = [{low}, {high}]
{more}
[model]
response = "{response}"
[stop]
half_width = 3.0
"""


def prior_stated(folder: Path, low: float, high: float, more: str = "", response: str = "identity"):
    """The prior of a campaign's model, and the model."""
    text = STATED.format(low=low, high=high, more=more, response=response)
    (folder / "campaign.toml").write_text(text, encoding="utf-8")
    spec = load_spec(folder)
    model = QuadraticModel(spec.factors)
    prior = stated_prior(spec, spec.applications[0])
    assert prior is not None
    return prior, model


def same(one: NormalInverseGamma, other: NormalInverseGamma) -> bool:
    arrays = (one.m0, other.m0), (one.Lambda0, other.Lambda0)
    return (one.a0, one.b0) == (other.a0, other.b0) and all(np.array_equal(*pair) for pair in arrays)


@pytest.mark.parametrize("response", ["identity", "logit"])
def test_nothing_said_of_repeats_is_a_tenth_of_the_utility_worth_three_runs(tmp_path: Path, response: str) -> None:
    silent, model = prior_stated(tmp_path, 60.0, 90.0, response=response)
    assert same(silent, prior_stated(tmp_path, 60.0, 90.0, "repeat_sd = 3.0\nrepeat_runs = 3", response)[0])
    assert not same(silent, prior_stated(tmp_path, 60.0, 90.0, "repeat_sd = 2.9", response)[0])
    assert not same(silent, prior_stated(tmp_path, 60.0, 90.0, "repeat_runs = 4", response)[0])
    if response == "identity":
        region = Region(model.factors)
        assert same(silent, elicited(model, region, 60.0, 90.0, 0.95))


@pytest.mark.parametrize(("sd", "runs"), [(None, None), (1.5, None), (0.5, 8.0)])
def test_scatter_of_repeats_is_that_of_so_many_runs_at_one_setting(
    tmp_path: Path, sd: float | None, runs: float | None
) -> None:
    """With n repeats about the prior mean, sigma^2 is pooled: (runs sd^2 + sum of squares) / (runs + n)."""
    said = "" if sd is None else f"repeat_sd = {sd}\n"
    said += "" if runs is None else f"repeat_runs = {runs}"
    prior, model = prior_stated(tmp_path, 50.0, 80.0, said)
    sd, runs = sd or 3.0, runs or 3.0
    off = np.array([-1.7, -0.4, 0.9, 1.2])
    Z = model.matrix(np.full((4, 1), 0.3))
    found = posterior(Z, Z @ prior.m0 + off, None, prior)
    assert found.b / found.a == pytest.approx((runs * sd**2 + off @ off) / (runs + 4))
    assert 2.0 * prior.a0 == runs


def test_scatter_of_repeats_on_the_logit_scale_is_that_of_scores_in_the_middle(tmp_path: Path) -> None:
    """Scores of 75 +- 0.5 percent differ by so much in log(p / (1 - p))."""
    prior, _ = prior_stated(tmp_path, 60.0, 90.0, "repeat_sd = 0.5", "logit")
    share = np.array([0.745, 0.755])
    by_hand = 0.5 * float(np.diff(np.log(share / (1.0 - share)))[0])
    assert np.sqrt(prior.b0 / prior.a0) == pytest.approx(by_hand, rel=1e-3)


@pytest.mark.parametrize("sd", [1.0, 4.0, 9.0])
def test_a_true_prior_that_says_nothing_of_repeats_helps_whatever_their_scatter(tmp_path: Path, sd: float) -> None:
    """Intervals of the mean hold it as often as they say and are no wider than without: 2.4 times they were at 1."""
    text = STATED.format(low=50.0, high=90.0, more="", response="identity")
    (tmp_path / "campaign.toml").write_text(text, encoding="utf-8")
    spec, rng = load_spec(tmp_path), np.random.default_rng(7)
    model, (application,) = spec.quadratic, spec.applications
    said = stated_prior(spec, application)
    assert said is not None
    root = np.linalg.cholesky(np.linalg.inv(said.Lambda0) * said.b0 / said.a0)
    inside, half, alone = [], [], []
    for _ in range(600):
        Z, at = model.matrix(rng.uniform(-1.0, 1.0, (12, 1))), model.matrix(rng.uniform(-1.0, 1.0, (1, 1)))[0]
        true = said.m0 + root @ rng.normal(size=model.p)
        fit = fit_least_squares(Z, Z @ true + sd * rng.normal(size=12), model.terms)
        found = posterior(Z, fit.y, None, stated_prior(spec, application, fit))
        half.append(t_quantile(found.df, 0.95) * np.sqrt(found.b / found.a) * np.linalg.norm(at @ found.factor))
        inside.append(abs(at @ (found.mean - true)) < half[-1])
        told = fit.predict(at[None]).confidence
        alone.append(0.5 * float((told.high - told.low)[0]))
    assert np.mean(inside) == pytest.approx(0.95, abs=0.03)
    assert np.median(half) < 1.08 * np.median(alone)
