"""`seqrsm fit` on measured scores: options of the model, what a statistician asks for, and the extremes."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import statsmodels.api as sm
from measured_campaign import FREQUENCY, HEAD, MEASURED, PERCENT, POL, STOP, X, counted, days, make, quadratic
from scipy.stats import t as student
from typer.testing import CliRunner

from seqrsm.analysis.belief import Departure, Fitted, intervals
from seqrsm.analysis.results import Analysis
from seqrsm.analysis.to_json import analysis_to_json
from seqrsm.campaign.campaign import Campaign
from seqrsm.campaign.dossier import _measured_assumptions
from seqrsm.cli.app import app
from seqrsm.errors import FitError, SpecError


def fit(folder: Path) -> dict:
    """Document of ``fit --json`` with the exact posterior: no sampler to wait for."""
    (analysis,) = Campaign.open(folder).analyse_all(thorough=True)
    return analysis_to_json(analysis)


def command(*arguments: object) -> tuple[int, str, str]:
    done = CliRunner().invoke(app, [str(argument) for argument in arguments])
    return done.exit_code, done.stdout, done.output


def matrix(rows: list[dict]) -> np.ndarray:
    a = np.array([row["x"] for row in rows]) / 5 - 1
    b = np.log(np.array([row["frequency"] for row in rows]) / 4) / np.log(4)
    return np.column_stack([np.ones(len(rows)), a, b, a * b, a * a, b * b])


def of(document: dict, key: str = "estimate") -> np.ndarray:
    return np.array([term["coded"][key] for term in document["terms"]])


def of_quadratic(analysis: Analysis) -> Fitted:
    """What is believed where no other surface is."""
    return replace(analysis.fitted, departure=Departure(None, float("nan"), 0.0))


def test_everything_that_a_thorough_fit_shows(tmp_path: Path) -> None:
    rows = quadratic()
    folder = make(tmp_path / "c", X + FREQUENCY, rows)
    code, out, _ = command("fit", folder, "--test", "x", "--test", "squares", "--test", "term:x,x^2", "--json")
    assert code == 0
    found = json.loads(out)
    theirs = sm.OLS([row["score"] for row in rows], matrix(rows)).fit()
    np.testing.assert_allclose(of(found), theirs.params, rtol=1e-9)
    np.testing.assert_allclose(of(found, "se"), theirs.bse, rtol=1e-9)
    for test, places in zip(found["tests"], ([1, 3, 4], [4, 5], [1, 4]), strict=True):
        want = theirs.f_test(np.eye(6)[places])
        assert (test["df"], test["f"]) == (len(places), pytest.approx(float(want.fvalue), rel=1e-9))
        assert test["p"] == pytest.approx(float(want.pvalue), rel=1e-7)
    at = theirs.get_prediction(matrix([found["departure"]["optimum_of_quadratic"]]))
    (analysis,) = Campaign.open(folder).analyse_all()
    for less in (0.0, 0.3):
        told = intervals(of_quadratic(analysis), analysis.of_quadratic.point, 0.95, (1,), less)
        for name, single, interval in (("mean", False, told[1][0]), ("run", True, told[1][1])):
            low, high = at.conf_int(obs=single)[0]
            assert (interval.low, interval.high) == (pytest.approx(low - less), pytest.approx(high)), name
        assert told[0] == pytest.approx(float(at.predicted_mean[0]) - less)
    plot = found["diagnostics"]["normal_plot"]
    assert plot["residuals"] == sorted(plot["residuals"])
    assert sorted(plot["run_ids"]) == list(range(1, 25))
    assert found["diagnostics"]["extrapolated"] is False
    vif = np.diagonal(np.linalg.inv(np.corrcoef(matrix(rows)[:, 1:].T)))
    np.testing.assert_allclose(
        [found["diagnostics"]["vif"][term["name"]] for term in found["terms"][1:]], vif, rtol=1e-8
    )
    assert found["posterior"]["sampler"]["ess_ends"] > 1000
    code, out, _ = command("fit", folder, "--test", "interactions")
    assert code == 0
    assert "Partial F tests" in out


def test_unknown_test_is_refused_with_the_names(tmp_path: Path) -> None:
    folder = make(tmp_path / "c", X + FREQUENCY, quadratic())
    code, _, output = command("fit", folder, "--test", "x,resolution")
    assert code == 2
    assert "error: test: no term, factor or group of this name (got 'resolution')" in output  # a notebook has it, too
    assert "interactions" in output


def test_weights_from_standard_errors(tmp_path: Path) -> None:
    se = np.round(np.random.default_rng(5).uniform(0.5, 3.0, 24), 3)
    rows = quadratic(se=se)
    folder = make(tmp_path / "c", X + FREQUENCY, rows, '[model]\nweights = "se"\n')
    found = fit(folder)
    theirs = sm.WLS([row["score"] for row in rows], matrix(rows), weights=1 / se**2).fit()
    np.testing.assert_allclose(of(found), theirs.params, rtol=1e-9)
    np.testing.assert_allclose(of(found, "se"), theirs.bse, rtol=1e-9)
    # A future run has the median standard error, and the reader is told so.
    _, shown, _ = command("fit", folder)
    assert f"weighted by 1/se\u00b2; a future run has the median se, {np.median(se):.3g}." in " ".join(shown.split())
    (analysis,) = Campaign.open(folder).analyse_all()
    row = np.asarray(matrix([found["departure"]["optimum_of_quadratic"]]))
    half = float(theirs.get_prediction(row, weights=1 / np.median(se) ** 2).conf_int(obs=True)[0] @ [-0.5, 0.5])
    point = analysis.of_quadratic.point
    _, (_, prediction, _) = intervals(of_quadratic(analysis), point, 0.95, (1, 5), 0.0)
    assert prediction.half_width == pytest.approx(half, rel=1e-7)
    rows[4]["se"] = ""
    with pytest.raises(FitError, match="run 5 without a standard error"):
        fit(make(tmp_path / "d", X + FREQUENCY, rows, '[model]\nweights = "se"\n'))


def test_the_scatter_of_logits_is_told_as_that_of_shares(tmp_path: Path) -> None:
    """It was told as alike in percent, which runs are weighted by only where their standard errors are stated."""
    folder = make(tmp_path / "c", X, quadratic(), '[model]\nresponse = "logit"\n', PERCENT)
    told = " ".join(command("fit", folder)[1].split())
    assert "Scores are taken to scatter as shares do, most at 50 percent and less towards 0 and 100." in told
    made = Campaign.open(folder)
    assumed, *_ = _measured_assumptions(made, made.analyse_all())
    assert assumed.endswith("with variance proportional to that of a share in percent, on the logit scale")


def test_a_future_run_is_never_known_better_than_the_mean(tmp_path: Path) -> None:
    """Heavy tails, an optimum far from the runs: next to no scatter of a run beside the doubt about the mean."""
    rng = np.random.default_rng(1)
    rows = [
        {"x": round(x, 4), "frequency": 4.0, "score": round(60 + 300 * x + 0.01 * rng.standard_t(4), 6)}
        for x in rng.uniform(0.0, 0.3, 9)
    ]
    rows = [{key: row[key] for key in ("x", "score")} for row in rows]
    heavy = make(tmp_path / "c", X, rows, '[model]\nerrors = "student_t"\n')
    # All but two of 50 right, or all but none: of so few decisions a run and its probability have different ends.
    rows = [{"x": x, "n": 50, "correct": 48 + 2 * (2 < x < 8)} for x in np.tile(np.linspace(0.0, 10.0, 6), 3)]
    model = '[model]\nweights = "counts"\nresponse = "logit"\n'
    for folder in (heavy, make(tmp_path / "d", X, rows, model, PERCENT)):
        best = fit(folder)["optimum"]
        assert best["prediction"]["low"] <= best["prediction_mean"]["low"] <= best["confidence"]["low"]
        assert best["prediction"]["high"] >= best["prediction_mean"]["high"] >= best["confidence"]["high"]


def test_random_blocks(tmp_path: Path) -> None:
    rows, day = days(36, 3.0, 2)
    model = '[model]\nblock = "block"\n'
    fixed = fit(make(tmp_path / "f", X + FREQUENCY, rows, model))
    found = fit(make(tmp_path / "r", X + FREQUENCY, rows, model + 'block_effect = "random"\n'))
    theirs = sm.MixedLM([row["score"] for row in rows], matrix(rows), groups=day).fit(reml=True)
    for document in (fixed, found):
        assert document["blocks"]["s"] == pytest.approx(np.sqrt(theirs.scale), rel=2e-3)
        assert document["blocks"]["s_block"] == pytest.approx(np.sqrt(float(np.squeeze(theirs.cov_re))), rel=2e-2)
    mean = np.array([term["mean"] for term in found["posterior"]["terms"]])
    np.testing.assert_allclose(mean, theirs.fe_params, atol=0.3 * theirs.bse_fe.max())
    # A new day brings its own effect.
    new = found["blocks"]["new"]
    best, half = found["optimum"], new["prediction"]["half_width"]
    assert found["departure"]["probability"] < 0.6  # both surfaces say much the same of a quadratic
    assert best["prediction"]["half_width"] == pytest.approx(half + 0.5 * best["optimism"], rel=0.03)
    assert fixed["optimum"]["prediction"]["half_width"] < new["prediction"]["half_width"]
    # The mean of five runs on one new day is no better known than that day: the floor of its interval tells so.
    with (tmp_path / "r" / "campaign.toml").open("a", encoding="utf-8") as file:
        file.write('interval = "prediction_mean"\n')
    of_mean = fit(tmp_path / "r")["stop"]["noise_floor"]
    days_share, runs_share = float(np.squeeze(theirs.cov_re)), theirs.scale
    expected = (days_share + runs_share / 5) / (days_share + runs_share)
    assert (of_mean / found["stop"]["noise_floor"]) ** 2 == pytest.approx(expected, rel=0.1)
    assert of_mean > 1.96 * np.sqrt(days_share)


def test_runs_without_a_day_are_told_to_be_one_of_their_own(tmp_path: Path) -> None:
    rows = quadratic(24, block=["" if i < 5 else f"day{i % 2}" for i in range(24)])
    found = fit(make(tmp_path / "c", X + FREQUENCY, rows, '[model]\nblock = "block"\n'))
    assert "Runs without a block, which count as one block of their own: 5." in found["warnings"]
    assert "block[none]" in [term["name"] for term in found["terms"]]
    both = [row | {"source": "flight"} for row in rows]
    both += [row | {"block": "", "source": "simulation"} for row in quadratic(20, 3)]
    told = fit(make(tmp_path / "s", X + FREQUENCY, both, '[model]\nblock = "block"\n'))["warnings"]
    assert "Runs without a block, which count as one block of their own: 5." in told  # flights: simulations have none
    alone = fit(make(tmp_path / "d", X + FREQUENCY, quadratic(24), '[model]\nblock = "block"\n'))
    assert not any("without a block" in text for text in alone["warnings"])


def test_days_of_one_run_each_are_told(tmp_path: Path) -> None:
    rows = quadratic(12, block=[f"day{i}" for i in range(12)])
    with pytest.raises(FitError, match=r"17 terms, 11 of them for blocks\. Blocks need several runs each"):
        fit(make(tmp_path / "c", X + FREQUENCY, rows, '[model]\nblock = "block"\n'))


@pytest.mark.parametrize(
    ("model", "words"),
    [
        ('block_effect = "random"', "block_effect needs a block"),
        ('block = ""', "needs a name that means nothing else"),
        ('block = "x"', "needs a name that means nothing else"),
        ('block = "score"', "needs a name that means nothing else"),
        (
            'block = "block"\nblock_effect = "random"\nerrors = "beta_binomial"\nresponse = "logit"',
            "beta_binomial errors have no random blocks",
        ),
        ('errors = "beta_binomial"', "logit scale"),
        ('errors = "beta_binomial"\nresponse = "logit"\nweights = "counts"', "weights from the counts"),
        ('weights = "counts"\n[simulator]\nengine = "psm"\nscene = "s.npz"', "without counts"),
        ('terms = "stepwise"', "terms"),
        (
            'response = "logit"\nerrors = "beta_binomial"\n[simulator]\nengine = "psm"\nscene = "s.npz"',
            "without counts",
        ),
    ],
)
def test_model_keys_that_exclude_each_other(tmp_path: Path, model: str, words: str) -> None:
    text = HEAD + X + PERCENT + f"[model]\n{model}\n" + STOP
    (tmp_path / "campaign.toml").write_text(text, encoding="utf-8")
    with pytest.raises(SpecError, match=words):
        Campaign.open(tmp_path)


def test_counts_with_beta_binomial_errors(tmp_path: Path) -> None:
    model = '[model]\nresponse = "logit"\nerrors = "beta_binomial"\n'
    found = fit(make(tmp_path / "c", X, counted(), model, PERCENT))
    sampler = found["posterior"]["sampler"]
    assert sampler["errors"] == "beta_binomial"
    assert 0.0 < sampler["correlation"] < 0.1
    best = found["optimum"]
    assert 0 < best["prediction"]["low"] < best["confidence"]["low"] < best["mean"] < best["confidence"]["high"] < 100
    theirs = sm.GLM(
        [[row["correct"], 200 - row["correct"]] for row in counted()],
        [[1, row["x"] / 5 - 1, (row["x"] / 5 - 1) ** 2] for row in counted()],
        family=sm.families.Binomial(),
    ).fit()
    terms = found["posterior"]["terms"]
    assert all(abs(term["mean"] - want) < 0.5 * term["sd"] for term, want in zip(terms, theirs.params, strict=True))
    assert all(term["sd"] > se for term, se in zip(terms, theirs.bse, strict=True))  # more scatter than the binomial
    rows = [{"x": row["x"], "score": 50 + i} for i, row in enumerate(counted())]
    with pytest.raises(FitError, match="without counts"):
        fit(make(tmp_path / "d", X, rows, model, PERCENT))


@pytest.mark.filterwarnings("ignore:The Identity link")
def test_counts_weigh_by_their_binomial_variance(tmp_path: Path) -> None:
    """Poor shares scatter most: the interval at the optimum is narrower than with one scatter for all."""
    rng = np.random.default_rng(4)
    rows = []
    for i in range(30):
        a = -1 + 2 * (i % 5) / 4
        share = 0.97 - 0.45 * (a - 0.2) ** 2
        rows.append({"x": 5 + 5 * a, "n": 150, "correct": int(rng.binomial(150, share))})
    equal = fit(make(tmp_path / "e", X, rows, "", PERCENT))
    found = fit(make(tmp_path / "c", X, rows, '[model]\nweights = "counts"\n', PERCENT))
    theirs = sm.GLM(
        [[row["correct"], 150 - row["correct"]] for row in rows],
        [[1, row["x"] / 5 - 1, (row["x"] / 5 - 1) ** 2] for row in rows],
        family=sm.families.Binomial(sm.families.links.Identity()),
    ).fit()
    share = np.array([row["correct"] / 150 for row in rows])
    dispersion = float(np.sum(150 * (share - theirs.mu) ** 2 / (theirs.mu * (1 - theirs.mu)))) / 27
    coded = [term["coded"]["estimate"] for term in found["terms"]]
    np.testing.assert_allclose(coded, 100.0 * theirs.params, rtol=2e-2, atol=0.1)
    half = found["optimum"]["prediction"]["half_width"]
    best = found["optimum"]["mean"] / 100
    at = found["optimum"]["coded"]["x"]
    row = np.array([1, at, at**2])
    se = 100 * np.sqrt(dispersion * (best * (1 - best) / 150 + row @ theirs.cov_params() @ row))
    of_quadratic = student.ppf(0.975, 27) * se  # the process that is believed beside it makes it a little wider
    assert 0.98 * of_quadratic < half < 1.3 * of_quadratic
    assert half < 0.8 * equal["optimum"]["prediction"]["half_width"]
    assert any('weights = "counts"' in text for text in equal["notes"])
    assert not any('weights = "counts"' in text for text in found["notes"])


def test_counts_that_are_missing(tmp_path: Path) -> None:
    rows = [{"x": row["x"], "score": 50 + i} for i, row in enumerate(counted())]
    with pytest.raises(FitError, match="without counts"):
        fit(make(tmp_path / "d", X, rows, '[model]\nweights = "counts"\n', PERCENT))


def test_prior_in_natural_terms(tmp_path: Path) -> None:
    rows = quadratic(9)
    known = (
        "[application.prior]\nutility = [50, 80]\nrepeat_sd = 1.0\n"
        "[application.prior.optimum]\nfrequency = 8.0\nx = { value = 9.0, doubt = 0.02 }\n"
    )
    plain = fit(make(tmp_path / "p", X + FREQUENCY, rows))["posterior"]["optimum"]["settings"]
    found = fit(make(tmp_path / "k", X + FREQUENCY, rows, application=MEASURED + known))["posterior"]["optimum"][
        "settings"
    ]
    assert found["x"]["high"] - found["x"]["low"] < plain["x"]["high"] - plain["x"]["low"]
    assert found["x"]["mean"] > plain["x"]["mean"]  # drawn towards 9
    assert found["frequency"]["mean"] > plain["frequency"]["mean"] - 0.5
    # What `fit` says of its reach: settings and intervals of the score are those without it.
    _, shown, _ = command("fit", tmp_path / "k")
    assert "the intervals of the score rest on the scores alone" in " ".join(shown.split())
    best, departure = (fit(tmp_path / "k")[key] for key in ("optimum", "departure"))
    assert best["settings"] == departure["optimum_of_quadratic"]


@pytest.mark.parametrize(
    ("prior", "words"),
    [
        ("utility = [80, 50]", "not a range of scores"),
        ("utility = [50, 180]", "not a range of scores"),
        ("utility = [50]", "utility"),
        ("utility = [50, 80]\noptimum = { x = 11.0 }", "outside the factor's range"),
        ("utility = [50, 80]\noptimum = { y = 1.0 }", "not a numeric factor"),
        ("utility = [50, 80]\noptimum = { x = { value = 5.0, doubt = 0.0 } }", "doubt"),
        ("optimum = { x = 5.0 }", "range of the utility is missing"),
        ("repeat_sd = 1.0", "range of the utility is missing"),
        ("effect = { y = [0.0, inf] }", "not a numeric factor"),
        ("effect = { x = [3.0, 3.0] }", "empty or contradictory"),
        ("effect = { x = [-inf, inf] }", "empty or contradictory"),
        ("effect = { x = [nan, 3.0] }", "empty or contradictory"),
        ("effect = { x = [0.0] }", "effect"),
    ],
)
def test_impossible_priors_are_told(tmp_path: Path, prior: str, words: str) -> None:
    text = HEAD + X + PERCENT + f"[application.prior]\n{prior}\n" + STOP
    (tmp_path / "campaign.toml").write_text(text, encoding="utf-8")
    with pytest.raises(SpecError, match=words) as caught:
        Campaign.open(tmp_path)
    assert all(problem.line for problem in caught.value.problems)


def weak_slope(n: int, slope: float, seed: int) -> list[dict]:
    rng = np.random.default_rng(seed)
    return [
        {"x": round(x, 3), "frequency": 4.0, "score": round(60 + slope * (x - 5) + 3 * float(rng.normal()), 4)}
        for x in rng.uniform(0, 10, n)
    ]


LINE = "[model]\norder = 1\n"
EFFECT = "[application.prior]\neffect = {{ x = [{}] }}\n"


@pytest.mark.parametrize(("low", "high"), [(0.0, np.inf), (-np.inf, 0.0), (2.0, 3.0)])
def test_bounded_effect(tmp_path: Path, low: float, high: float) -> None:
    """The posterior of a slope is its t distribution cut off: exact draws and emcee against quadrature."""
    from scipy import integrate, stats

    rows = weak_slope(12, 0.25, 3)
    folder = make(tmp_path / "c", X, [{k: v for k, v in row.items() if k != "frequency"} for row in rows], LINE)
    spec = (folder / "campaign.toml").read_text()
    (folder / "campaign.toml").write_text(spec.replace(LINE, EFFECT.format(f"{low}, {high}") + LINE))
    a = np.array([row["x"] for row in rows]) / 5 - 1
    theirs = sm.OLS([row["score"] for row in rows], sm.add_constant(a)).fit()
    t = stats.t(10, theirs.params[1], theirs.bse[1])
    ends = [max(0.5 * low, t.ppf(1e-9)), min(0.5 * high, t.ppf(1 - 1e-9))]
    mass = t.cdf(ends[1]) - t.cdf(ends[0])
    mean = integrate.quad(lambda v: v * t.pdf(v) / mass, *ends)[0]
    sd = np.sqrt(integrate.quad(lambda v: (v - mean) ** 2 * t.pdf(v) / mass, *ends)[0])
    for sampler, error in (("exact", sd / 60), ("emcee", sd / 55)):
        (analysis,) = Campaign.open(folder).analyse_all(sampler=sampler)
        found = analysis_to_json(analysis)["posterior"]
        slope = found["terms"][1]
        assert abs(slope["mean"] - mean) < 5 * error
        assert slope["sd"] == pytest.approx(sd, rel=0.08)
        assert 0.5 * low <= slope["low"] < slope["high"] <= 0.5 * high
        assert found["effects"] == [{"factor": "x", "low": low, "high": high}]
        assert found["sampler"]["method"] == sampler
        assert found["effects_probability"] == pytest.approx(mass, abs=0.03)
    code, out, _ = command("fit", folder)
    assert code == 0
    assert "Prior constraint, from the low to the high end of the range: x " in " ".join(out.split())
    assert "Without this prior its probability is " in " ".join(out.split())


def test_bounds_of_effects_with_other_errors_sources_and_blocks(tmp_path: Path) -> None:
    """Every sampler holds the bounds; without them a good share of its draws does not."""
    rows = [{**row, "block": f"d{i % 5}"} for i, row in enumerate(weak_slope(20, 0.1, 1))]
    for row in rows:
        row.pop("frequency")
    flown = [{**row, "source": ("simulation", "flight")[i % 3 == 0]} for i, row in enumerate(rows)]
    counts = [{"x": row["x"], "n": 50, "correct": round(row["score"] / 2)} for row in rows]
    cases = {
        "student": (rows, LINE + 'errors = "student_t"\n', MEASURED),
        "days": (rows, LINE + 'block = "block"\nblock_effect = "random"\n', MEASURED),
        "flights": (flown, LINE, MEASURED),
        "counts": (counts, LINE + 'response = "logit"\nerrors = "beta_binomial"\n', PERCENT),
    }
    for name, (scores, model, application) in cases.items():
        folder = make(tmp_path / name, X, scores, model, application + EFFECT.format("0.0, inf"))
        for sampler in ("exact", "emcee"):
            (analysis,) = Campaign.open(folder).analyse_all(sampler=sampler)
            slopes = analysis.posterior.term_draws[:, 1]
            assert len(slopes) >= 1000, (name, sampler)
            assert slopes.min() >= 0.0, (name, sampler)
            assert np.quantile(slopes, 0.05) < 0.35 * np.median(slopes), (name, sampler)  # cut off, not only shifted
            assert not any("[application.prior]" in warning for warning in analysis.warnings)


def test_search_is_allowed_for_with_other_errors_sources_and_blocks(tmp_path: Path) -> None:
    flat = [{**row, "score": round(60 + (row["score"] - 60) / 8, 5)} for row in quadratic(30)]
    cases = {
        "student": ({}, '[model]\nerrors = "student_t"\n'),
        "logit": ({}, '[model]\nerrors = "student_t"\nresponse = "logit"\n'),
        "days": ({"block": [f"d{i % 5}" for i in range(30)]}, '[model]\nblock = "block"\nblock_effect = "random"\n'),
        "flights": ({"source": ["simulation", "flight", "simulation"] * 10}, ""),
    }
    for name, (more, model) in cases.items():
        rows = [{**row, **{key: values[i] for key, values in more.items()}} for i, row in enumerate(flat)]
        found = fit(make(tmp_path / name, X + FREQUENCY, rows, model, PERCENT))
        best = found["optimum"]
        assert best["optimism"] > 0.0 or name in ("student", "logit", "days"), name  # there a process smooths as much
        assert best["confidence"]["half_width"] < best["prediction_mean"]["half_width"], name
        assert best["prediction_mean"]["half_width"] < best["prediction"]["half_width"], name
    assert "selection bias" in " ".join(command("fit", tmp_path / name)[1].split())


def test_contradicted_bounds_of_effects(tmp_path: Path) -> None:
    rows = [{"x": row["x"], "score": row["score"]} for row in weak_slope(14, 3.0, 2)]
    folder = make(tmp_path / "c", X, rows, LINE, MEASURED + EFFECT.format("-inf, 0.0"))
    for sampler in ("exact", "emcee"):
        (analysis,) = Campaign.open(folder).analyse_all(sampler=sampler)
        assert analysis.posterior.sampler["method"] == sampler
        assert len(analysis.posterior.term_draws) == 4000
        assert analysis.posterior.term_draws[:, 1].max() <= 0.0
    blocked = [{**row, "block": f"d{i % 4}"} for i, row in enumerate(rows)]
    model = LINE + 'block = "block"\nblock_effect = "random"\n'
    folder = make(tmp_path / "b", X, blocked, model, MEASURED + EFFECT.format("-inf, 0.0"))
    (analysis,) = Campaign.open(folder).analyse_all()
    assert analysis.posterior.effects == ()
    assert "the scores contradict it" in " ".join(analysis.warnings)
    same = [{"x": row["x"], "score": 50.0} for row in rows]
    folder = make(tmp_path / "s", X, same, LINE, MEASURED + EFFECT.format("1.0, inf"))
    (analysis,) = Campaign.open(folder).analyse_all()
    assert "the scores contradict it" in " ".join(analysis.warnings)


def test_logit_bounds_are_signs(tmp_path: Path) -> None:
    text = HEAD + X + PERCENT + EFFECT.format("5.0, inf") + '[model]\nresponse = "logit"\n' + STOP
    (tmp_path / "campaign.toml").write_text(text, encoding="utf-8")
    with pytest.raises(SpecError, match="only the sign"):
        Campaign.open(tmp_path)


def test_aliased_terms_are_named_with_runs_that_would_mend_it(tmp_path: Path) -> None:
    """Two factors that never differ: exit 2, the terms, and settings that make the model estimable when run."""
    rows = [
        {"x": v, "frequency": 4.0 * 4.0 ** (v / 5 - 1), "score": 50.0 + v + 0.1 * i}
        for i, v in enumerate([0, 10, 5, 2, 8, 5, 0, 10])
    ]
    folder = make(tmp_path / "c", X + FREQUENCY, rows)
    code, _, output = command("fit", folder)
    assert code == 2
    flat = " ".join(output.split())
    assert "cannot separate these terms" in flat
    assert "x:frequency" in flat
    from seqrsm.analysis.runs import scored_runs
    from seqrsm.design.quadratic import QuadraticModel
    from seqrsm.fit.estimability import missing_runs

    campaign = Campaign.open(folder)
    data = scored_runs(campaign.spec.region, campaign.store.runs(), "a")
    region = campaign.spec.region
    missing = region.decode(missing_runs(QuadraticModel(campaign.spec.factors), region, data.points)[0])
    assert all(f"x {settings['x']:.4g}" in flat for settings in missing)
    more = [{**settings, "score": 60.0 + i} for i, settings in enumerate(missing)]
    (folder / "more.csv").write_text(
        "x,frequency,score\n" + "".join(f"{m['x']},{m['frequency']},{m['score']}\n" for m in more)
    )
    assert command("ingest", folder, folder / "more.csv")[0] == 0
    assert np.all(np.isfinite(of(fit(folder))))


def test_a_factor_added_since_is_named_in_place_of_all_its_terms(tmp_path: Path) -> None:
    rows = [{"x": v, "frequency": 4.0, "score": 50.0 + i % 5} for i, v in enumerate([0.0, 5.0, 10.0] * 4)]
    code, _, output = command("fit", make(tmp_path / "c", X + FREQUENCY, rows))
    assert code == 2
    flat = " ".join(output.split())
    assert "error: all scored runs have frequency 4 GHz. Add runs; 3 at these settings would suffice: x " in flat


def test_too_few_runs_names_settings(tmp_path: Path) -> None:
    folder = make(tmp_path / "c", X + FREQUENCY, [{"x": 5.0, "frequency": 4.0, "score": 50.0 + i} for i in range(7)])
    code, _, output = command("fit", folder)  # all runs at one point
    assert code == 2
    assert "5 at these settings would suffice" in " ".join(output.split())
    assert "order = 1" not in output  # which these runs do not determine either
    corners = [{"x": x, "frequency": f, "score": 50.0 + x - f} for x in (0.0, 10.0) for f in (1.0, 16.0)]
    code, _, output = command("fit", make(tmp_path / "d", X + FREQUENCY, corners))
    assert code == 2
    assert "or set [model] order = 1." in " ".join(output.split())


def test_settings_that_are_as_good_are_named(tmp_path: Path) -> None:
    """A saddle along x: both ends are best; and the shares of the surface's variance, x^2 alone."""
    rows = [{"x": x, "frequency": f, "score": 50.0 + (x - 5) ** 2} for x, f in EXTREME_DESIGN]
    found = fit(make(tmp_path / "c", X + FREQUENCY, rows))
    best = found["optimum"]
    assert {best["settings"]["x"], *(tie["x"] for tie in best["ties"])} == {0.0, 10.0}
    assert best["exact"] is True
    shares = {row["factor"]: (row["share"], row["share_total"]) for row in found["factors_importance"]}
    np.testing.assert_allclose(shares["x"], 1.0, atol=1e-9)
    np.testing.assert_allclose(shares["frequency"], 0.0, atol=1e-9)


def test_check_takes_no_scatter_for_what_the_quadratic_misses(tmp_path: Path) -> None:
    """A step with repeats within 1: a target of 3 was refused for a scatter of 10, beside a fit that knew better."""
    rng = np.random.default_rng(9)
    rows = [
        {"x": x, "score": (90 if x > 5.5 else 50) + 0.5 * rng.normal()} for x in np.repeat(np.linspace(0, 10, 9), 3)
    ]
    code, output, error = command("check", make(tmp_path / "c", X, rows))
    assert code == 0, error
    assert 0.3 < float(re.findall(r"run-to-run standard deviation +([0-9.]+)", output)[0]) < 1.0
    told = " ".join(output.split())
    assert "surfaces drawn from the posterior of the 27 scores so far, which favour another surface than" in told
    assert "[model] order = 1" not in told  # a plane, which scores refute still more


def test_shares_of_variance_say_what_they_are_taken_over(tmp_path: Path) -> None:
    """A constraint makes factors dependent: shares are those of the box."""
    whole = make(tmp_path / "c", X + FREQUENCY, quadratic())
    cut = make(tmp_path / "d", X + FREQUENCY, quadratic(), '[[constraint]]\nexpr = "x + frequency <= 20"\n')
    for folder, over in ((whole, "the region, alone"), (cut, "all ranges, constraints left out, alone")):
        assert f"surface's variance over {over}" in " ".join(command("fit", folder)[1].split())


EXTREME_DESIGN = [(0, 1), (10, 1), (0, 16), (10, 16), (5, 4), (5, 1), (5, 16), (0, 4), (10, 4), (5, 4), (2, 8), (7, 2)]


@pytest.mark.parametrize("n", [6, 7])
def test_as_many_runs_as_terms_and_one_more(tmp_path: Path, n: int) -> None:
    rng = np.random.default_rng(1)
    rows = [
        {"x": x, "frequency": f, "score": 50 + round(float(rng.normal()), 3)}
        for x, f in [EXTREME_DESIGN[i] for i in (0, 1, 2, 4, 5, 7, 8)[:n]]
    ]
    found = fit(make(tmp_path / "c", X + FREQUENCY, rows))
    np.testing.assert_allclose(
        matrix(rows)[:6] @ of(found), [row["score"] for row in rows[:6]], rtol=1e-9 if n == 6 else 1.0
    )
    assert found["df_residual"] == n - 6
    shown = " ".join(command("fit", tmp_path / "c")[1].split())
    assert ("fewer than three runs have a studentised residual" in shown) == (n == 7)
    if n == 6:
        assert np.isnan(found["s"])
        assert "no residual degrees of freedom" in " ".join(found["warnings"])
        assert found["optimum"]["optimism"] == 0.0
        assert found["lack_of_fit"]["reason"]
    else:
        assert np.isfinite(found["optimum"]["confidence"]["half_width"])


@pytest.mark.parametrize("slope", [0.0, 30.0])
def test_a_surface_that_no_parameter_moves_is_told(tmp_path: Path, slope: float) -> None:
    rng = np.random.default_rng(5)
    rows = [{"x": x, "frequency": f, "score": 50.0 + slope * x + rng.normal()} for x, f in EXTREME_DESIGN]
    found = fit(make(tmp_path / "c", X + FREQUENCY, rows))
    assert ("No factor has a significant effect" in " ".join(found["warnings"])) == (slope == 0.0)


def test_scores_of_nothing_and_everything(tmp_path: Path) -> None:
    rows = [{"x": x, "frequency": f, "score": (0, 100, 100)[i % 3]} for i, (x, f) in enumerate(EXTREME_DESIGN)]
    for name, model in (("i", ""), ("l", '[model]\nresponse = "logit"\n')):
        found = fit(make(tmp_path / name, X + FREQUENCY, rows, model, PERCENT))
        assert np.all(np.isfinite(of(found)))
        if name == "l":
            best = found["optimum"]
            assert 0.0 <= best["prediction"]["low"] <= best["mean"] <= best["prediction"]["high"] <= 100.0


@pytest.mark.parametrize("size", [1e-12, 1e12])
def test_ranges_of_any_size(tmp_path: Path, size: float) -> None:
    """The same design in other units: the same coded fit and the same optimum."""
    rng = np.random.default_rng(3)
    rows = [
        {"x": x, "frequency": f, "score": 60 - 0.3 * (x - 6) ** 2 + round(float(rng.normal()), 3)}
        for x, f in EXTREME_DESIGN
    ]
    plain = fit(make(tmp_path / "p", X + FREQUENCY, rows))
    other = [{**row, "x": row["x"] * size} for row in rows]
    found = fit(make(tmp_path / "o", X.replace("10.0", repr(10.0 * size)) + FREQUENCY, other))
    np.testing.assert_allclose(of(found), of(plain), rtol=1e-7, atol=1e-9)
    assert found["optimum"]["settings"]["x"] == pytest.approx(plain["optimum"]["settings"]["x"] * size, rel=1e-6)
    assert found["optimum"]["prediction"]["half_width"] == pytest.approx(
        plain["optimum"]["prediction"]["half_width"], rel=1e-7
    )


def test_level_that_was_never_run(tmp_path: Path) -> None:
    rows = [{**row, "pol": "HH"} for row in quadratic(16)]
    code, _, output = command("fit", make(tmp_path / "c", X + FREQUENCY + POL, rows))
    assert code == 2
    flat = " ".join(output.split())
    assert "error: no run has a score yet at pol VV. Add runs; 3 at these settings would suffice: x " in flat


def test_a_run_that_alone_makes_r2_predicted_negative_is_named(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    ends = [(1e-3 * (i % 3) if i % 2 else 10.0 - 1e-3 * (i % 3)) for i in range(12)]
    rows = [{"x": x, "score": round(50 + 3 * (x < 5) + rng.normal(), 4)} for x in ends] + [{"x": 5.0, "score": 58.0}]
    _, text, _ = command("fit", make(tmp_path / "c", X, rows))
    assert re.search(r"R² predicted \(leave-one-out\) +-\d+\n", text)  # and not -11957.573
    assert "R² predicted is negative because of run 13, whose leverage of 0.999999 leaves little to predict" in text


def test_differences_between_blocks_have_the_unit_of_the_scores(tmp_path: Path) -> None:
    rows, _ = days(24, 3.0, 2)
    _, text, _ = command("fit", make(tmp_path / "c", X, rows, '[model]\nblock = "block"\n', PERCENT))
    assert re.search(r"Standard deviation of a run [\d.]+ percent, of the blocks [\d.]+ percent \(restricted", text)


def test_terms_that_only_rounding_separates_are_refused(tmp_path: Path) -> None:
    """The centre 3.4641016 GHz is issued as 3.464: its products are no zeros, and tell nothing."""
    factors = X + FREQUENCY.replace("low = 1.0", "low = 1.2").replace("16.0", "10.0")
    places = [(0, 3.464), (10, 3.4641), (5, 3.464), (5, 3.464), (5, 1.2), (5, 10), (10, 3.464), (0, 3.464)]
    rows = [{"x": x, "frequency": f, "score": 70 + i * i % 5} for i, (x, f) in enumerate(places)]
    code, _, told = command("fit", make(tmp_path / "c", factors, rows))
    assert code == 2
    assert "the runs cannot separate these terms: x:frequency. Add runs; 1 at these settings" in told
    # With one run at a corner the product rests on this run alone, whose leverage is 1 but for rounding, as of 5 and 6.
    corner = {"x": 10, "frequency": 10, "score": 74}
    found = fit(make(tmp_path / "d", factors, [*rows, corner]))
    assert np.isnan(found["press"])
    assert "The model must pass through runs 5, 6, 9 (leverage 1): their scores cannot be checked." in found["warnings"]


def test_runs_of_leverage_one_are_told_in_the_plural_where_there_are_others(tmp_path: Path) -> None:
    def told(name: str, *places: float) -> str:
        rows = [{"x": x, "score": x * x + i % 2} for i, x in enumerate(places)]
        return command("fit", make(tmp_path / name, X, rows))[1]

    text = told("c", 0.0, 0.0, 4.0, 10.0)
    assert "The model must pass through runs 3, 4 (leverage 1): their scores cannot be checked." in text
    text = told("saturated", 0.0, 4.0, 10.0)
    assert "as many terms as runs" in text
    assert "leverage 1" not in text


def test_loss_without_an_interval_ignores_the_origin_of_scores(tmp_path: Path) -> None:
    def told(name: str, origin: float) -> str:
        rows = [{"x": x, "score": origin + x * (12.0 - x)} for x in (0.0, 5.0, 10.0)]
        text = " ".join(command("fit", make(tmp_path / name, X, rows))[1].split())
        return text.split("unknown true optimum: ")[1].split(";")[0]

    assert told("near", 0.0) == told("far", 1000.0)


def test_scores_without_scatter_give_no_intervals(tmp_path: Path) -> None:
    """That no scatter was seen is not to say that a future run has none."""
    rows = [{"x": x, "pol": pol, "score": 70.1} for x in (0, 2.5, 5, 10) for pol in ("HH", "VV") for _ in range(2)]
    folder = make(tmp_path / "c", X + POL, rows)
    text = CliRunner().invoke(app, ["fit", str(folder)]).stdout
    assert "All scores are equal" in text
    assert "no error estimate: the model passes through every score" in text
    assert "70.1 to 70.1" not in text
    assert [line.split() for line in text.splitlines() if line.startswith("pol[HH]  ")] == [["pol[HH]", "0.00"]]
    found = json.loads(CliRunner().invoke(app, ["fit", str(folder), "--json"]).stdout)
    assert found["optimum"]["prediction"]["half_width"] is None
    unknown = dict.fromkeys(("se", "t", "p", "low", "high"))
    assert all(term["coded"] == {"estimate": term["coded"]["estimate"]} | unknown for term in found["terms"])
    assert all(term["natural"]["se"] is None for term in found["terms"])
    assert found["covariance"]["lower_triangle"][0] == [None]
    assert not found["stop"]["held"]
    assert "± 0" not in CliRunner().invoke(app, ["status", str(folder)]).stdout
    check = json.loads(CliRunner().invoke(app, ["check", str(folder), "--json"]).stdout)
    assert check["noise"] is None
    assert check["unit"] == "s.d. of a run"
    told = CliRunner().invoke(app, ["check", str(folder)]).stdout
    assert "Half-width [s.d. of a run]" in told
    assert "[s]" not in told  # which would be seconds


def test_runs_may_cost_nothing(tmp_path: Path) -> None:
    rows = [row | {"source": ("simulation", "flight")[i % 2]} for i, row in enumerate(quadratic())]
    for simulation, flight in ((0, 2), (0, 0)):
        cost = f"[cost]\nsimulation = {simulation}\nflight = {flight}\n"
        folder = make(tmp_path / f"c{flight}", X + FREQUENCY, rows, cost)
        runs = list(Campaign.open(folder).propose(3, source="best"))
        assert len(runs) == 3
        assert all(run.cost == (flight if run.source == "flight" else simulation) for run in runs)


def test_flights_far_from_simulations_are_told(tmp_path: Path) -> None:
    """The default prior draws a difference of 20 towards 0; that is to be known."""
    rows = [row | {"source": ("simulation", "flight")[i % 2]} for i, row in enumerate(quadratic(30))]
    near, far = (
        [row | {"score": row["score"] - (off if row["source"] == "flight" else 0.0)} for row in rows]
        for off in (0.5, 20)
    )
    says = "raise [model] discrepancy_sd"
    for name, given, model, told in (
        ("near", near, "", False),
        ("far", far, "", True),
        ("raised", far, "[model]\ndiscrepancy_sd = 20.0\n", False),
    ):
        warnings = fit(make(tmp_path / name, X + FREQUENCY, given, model))["warnings"]
        assert any(says in text for text in warnings) == told


def test_blocks_that_the_model_leaves_out_are_told(tmp_path: Path) -> None:
    rows, _ = days(24, 2.0, 1)
    told = "The runs are of 6 blocks"
    left_out = fit(make(tmp_path / "a", X + FREQUENCY, rows))
    assert sum(told in text for text in left_out["warnings"]) == 1
    used = fit(make(tmp_path / "b", X + FREQUENCY, rows, '[model]\nblock = "block"\n'))
    assert not any(told in text for text in used["warnings"])
    one = fit(make(tmp_path / "c", X + FREQUENCY, quadratic(24, block=["day"] * 24)))
    assert not any("blocks" in text for text in one["warnings"])
