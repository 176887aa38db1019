"""Published response surfaces, from the campaign's folder to the document of ``fit --json``.

* ``smell``: SAS/STAT User's Guide, The RSREG Procedure, "A Response Surface with a Simple Optimum" (Schneider and
  Stockett 1963, in John 1971): a Box-Behnken design, smaller is better; figures as printed there.
* ``yield``: Montgomery, Design and Analysis of Experiments, 5th ed., example 11-1: a central composite design.
* ``stackloss``: Brownlee (1965), first order in three factors, from statsmodels; Cook's distances as in Daniel & Wood.

Besides the printed digits, everything is compared with statsmodels.
"""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import statsmodels.api as sm
from statsmodels.stats.outliers_influence import OLSInfluence

from seqrsm.analysis.to_json import analysis_to_json
from seqrsm.campaign.campaign import Campaign
from seqrsm.campaign.ingest import ingest_files
from seqrsm.fit.least_squares import fit_least_squares

SMELL = """66 40 .3 4  39 120 .3 4  43 40 .7 4  49 120 .7 4  58 40 .5 2  17 120 .5 2  -5 40 .5 6  -40 120 .5 6
65 80 .3 2  7 80 .7 2  43 80 .3 6  -22 80 .7 6  -31 80 .5 4  -35 80 .5 4  -26 80 .5 4"""
YIELD = """76.5 80 170  77 80 180  78 90 170  79.5 90 180  79.9 85 175  80.3 85 175  80 85 175  79.7 85 175  79.8 85 175
78.4 92.07 175  75.6 77.93 175  78.5 85 182.07  77 85 167.93"""


def analysed(folder: Path, text: str, factors: dict[str, tuple[float, float]], goal: str) -> tuple[dict, np.ndarray]:
    """Document of the thorough fit, and the table: score, factors."""
    table = np.array(text.split(), float).reshape(-1, 1 + len(factors))
    toml = '[campaign]\nname = "published"\n'
    toml += "".join(
        f'[[factor]]\nname = "{name}"\nlow = {low}\nhigh = {high}\n' for name, (low, high) in factors.items()
    )
    toml += f'[[application]]\nname = "a"\nutility = "measured"\ngoal = "{goal}"\n'
    toml += "[stop]\nhalf_width = 5.0\n"
    (folder / "campaign.toml").write_text(toml, encoding="utf-8")
    rows = [",".join(["score", *factors]), *(",".join(repr(float(v)) for v in row) for row in table)]
    (folder / "scores.csv").write_text("\n".join(rows), encoding="utf-8")
    campaign = Campaign.open(folder)
    ingest_files(campaign.store, campaign.spec, [folder / "scores.csv"])
    (analysis,) = campaign.analyse_all(thorough=True)
    return analysis_to_json(analysis), table


def check_against_statsmodels(found: dict, table: np.ndarray, factors: dict[str, tuple[float, float]]) -> None:
    coded = [2.0 * (table[:, j + 1] - low) / (high - low) - 1.0 for j, (low, high) in enumerate(factors.values())]
    columns = [np.ones(len(table)), *coded]
    k = len(coded)
    columns += [coded[i] * coded[j] for i in range(k) for j in range(i + 1, k)]
    columns += [x * x for x in coded]
    theirs = sm.OLS(table[:, 0], np.column_stack(columns)).fit()
    terms = {
        key: np.array([term["coded"][key] for term in found["terms"]])
        for key in ("estimate", "se", "t", "p", "low", "high")
    }
    for key, want in zip(
        terms, (theirs.params, theirs.bse, theirs.tvalues, theirs.pvalues, *theirs.conf_int().T), strict=True
    ):
        np.testing.assert_allclose(terms[key], want, rtol=1e-9, atol=1e-12, err_msg=key)
    assert found["s"] == pytest.approx(np.sqrt(theirs.mse_resid), rel=1e-10)
    assert found["r2"] == pytest.approx(theirs.rsquared, rel=1e-10)
    assert found["r2_adjusted"] == pytest.approx(theirs.rsquared_adj, rel=1e-10)
    influence = OLSInfluence(theirs)
    runs = found["diagnostics"]["runs"]
    for key, want in (
        ("leverage", influence.hat_matrix_diag),
        ("studentised", influence.resid_studentized_external),
        ("cooks_distance", influence.cooks_distance[0]),
    ):
        np.testing.assert_allclose([run[key] for run in runs], want, rtol=1e-7, atol=1e-12, err_msg=key)
    assert found["press"] == pytest.approx(float(np.sum(np.square(influence.resid_press))), rel=1e-9)


def fit_matrix(Z, y, names):
    """Least squares with any columns; the first one of ones is the intercept."""
    ones = np.flatnonzero(np.all(Z == 1.0, axis=0))[:1]
    kinds = ["intercept" if i in ones else "linear" for i in range(len(names))]
    return fit_least_squares(Z, y, [SimpleNamespace(name=n, kind=k) for n, k in zip(names, kinds, strict=True)])


def test_odour_of_a_chemical(tmp_path: Path) -> None:
    factors = {"T": (40.0, 120.0), "R": (0.3, 0.7), "H": (2.0, 6.0)}
    found, table = analysed(tmp_path, SMELL, factors, "minimize")
    check_against_statsmodels(found, table, factors)
    assert found["s"] == pytest.approx(22.478508, abs=5e-7)
    assert found["r2"] == pytest.approx(0.8820, abs=5e-5)
    rows = {row["source"]: row for row in found["anova"]}
    for source, df, ss, f, p in (
        ("first order", 3, 7143.25, 4.71, 0.0641),
        ("squares", 3, 11445.233333, 7.55, 0.0264),
        ("interactions", 3, 293.5, 0.19, 0.8965),
        ("lack of fit", 3, 2485.75, 40.75, 0.0240),
        ("pure error", 2, 40.666667, None, None),
        ("residual", 5, 2526.416667, None, None),
    ):
        assert (rows[source]["df"], rows[source]["ss"]) == (df, pytest.approx(ss, abs=5e-7))
        if f is not None:
            assert (rows[source]["f"], rows[source]["p"]) == (pytest.approx(f, abs=5e-3), pytest.approx(p, abs=5e-5))
    printed = {"T": (2.60, 0.1613), "R": (5.46, 0.0454), "H": (1.89, 0.2510)}
    for row in found["factors_importance"]:
        f, p = printed[row["factor"]]
        assert (row["df"], row["f"], row["p"]) == (4, pytest.approx(f, abs=5e-3), pytest.approx(p, abs=5e-5))
    point = found["stationary_point"]
    np.testing.assert_allclose(point["eigenvalues"], [48.858807, 31.103461, 6.037732], atol=5e-7)
    # R's rsm and this program take flat axes apart at 10 %; SAS has none, and the smallest here is 12 %.
    assert point["value"] == pytest.approx(-52.024631, abs=5e-7)
    assert point["kind"] == "minimum"
    for name, want in (("T", 84.876502), ("R", 0.539915), ("H", 7.541050)):
        assert point["natural"][name] == pytest.approx(want, abs=5e-7)
    assert point["inside_region"] is False
    assert found["optimum"]["at_bound"] == ["H (high)"]


def test_yield_of_a_chemical_process(tmp_path: Path) -> None:
    factors = {"time": (80.0, 90.0), "temperature": (170.0, 180.0)}
    found, table = analysed(tmp_path, YIELD, factors, "maximize")
    check_against_statsmodels(found, table, factors)
    natural = {term["name"]: term["natural"]["estimate"] for term in found["terms"]}
    for name, want, digits in (
        ("intercept", -1430.52285, 0.3),  # the book's axial runs lie at 1.41421, printed as 1.414
        ("time", 7.80749, 2e-3),
        ("temperature", 13.27053, 2e-3),
        ("time^2", -0.05505, 1e-5),
        ("temperature^2", -0.04005, 1e-5),
        ("time:temperature", 0.01, 1e-6),
    ):
        assert natural[name] == pytest.approx(want, abs=digits), name
    rows = {row["source"]: row for row in found["anova"]}
    assert rows["residual"]["ms"] == pytest.approx(0.071, abs=5e-4)
    assert (rows["lack of fit"]["ss"], rows["lack of fit"]["f"]) == (
        pytest.approx(0.28, abs=5e-3),
        pytest.approx(1.78, abs=1e-2),
    )
    assert rows["lack of fit"]["p"] == pytest.approx(0.2897, abs=4e-3)
    assert rows["pure error"]["ss"] == pytest.approx(0.212, abs=5e-4)
    assert rows["interactions"]["f"] == pytest.approx(3.53, abs=5e-3)
    best = found["departure"]["optimum_of_quadratic"]
    assert found["stationary_point"]["value"] == pytest.approx(80.21, abs=5e-3)
    assert found["optimum"]["mean"] == pytest.approx(80.21, abs=0.1)
    assert (best["time"], best["temperature"]) == (pytest.approx(87.0, abs=0.1), pytest.approx(176.5, abs=0.1))


def test_stack_loss_with_a_matrix_of_its_own() -> None:
    """A linear model that is given as a matrix: Brownlee's first order, and one with cubes and products."""
    data = sm.datasets.stackloss.load_pandas()
    y, X = data.endog.to_numpy(), data.exog.to_numpy(float)
    Z = np.column_stack([np.ones(21), X])
    fit = fit_matrix(Z, y, ["1", *data.exog.columns])
    np.testing.assert_allclose(fit.estimate, [-39.919674, 0.715640, 1.295286, -0.152123], atol=5e-7)  # as published
    assert fit.s == pytest.approx(3.243, abs=5e-4)
    assert fit.cooks_distance[20] == pytest.approx(0.692, abs=5e-4)
    air, water, acid = ((X - X.mean(axis=0)) / X.std(axis=0)).T
    Z = np.column_stack([np.ones(21), air, water, acid, air**2, air**3, air * water * acid, np.sin(acid)])
    ours, theirs = fit_matrix(Z, y, [f"z{i}" for i in range(8)]), sm.OLS(y, Z).fit()
    np.testing.assert_allclose(ours.estimate, theirs.params, rtol=1e-9)
    np.testing.assert_allclose(ours.se, theirs.bse, rtol=1e-9)
    assert ours.r2 == pytest.approx(theirs.rsquared, rel=1e-10)
    assert ours.partial_f([5, 6, 7]).f == pytest.approx(float(theirs.f_test(np.eye(8)[5:]).fvalue), rel=1e-9)
    without = fit_matrix(Z[:, 1:], y, [f"z{i}" for i in range(1, 8)])
    assert without.r2 == pytest.approx(sm.OLS(y, Z[:, 1:]).fit().rsquared, rel=1e-9)  # about zero, as statsmodels
