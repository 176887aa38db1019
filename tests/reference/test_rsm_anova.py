"""Fits, analyses of variance and lack of fit against R's rsm and 60-digit arithmetic."""

from __future__ import annotations

import json
from itertools import combinations
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from seqrsm.fit.intervals import LackOfFit
from seqrsm.fit.least_squares import LeastSquaresFit, block_columns, fit_least_squares

DATA = Path(__file__).parent / "data" / "rsm"
REL = 1e-10  # the expected files hold 15 significant digits; R's own rounding is near 1e-13 of the largest term


def expected(name: str) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((DATA / f"{name}_expected.json").read_text())
    return content


def fit(
    table: pd.DataFrame, response: str, factors: list[str], order: str, block: str | None = None
) -> LeastSquaresFit:
    x = {f: table[f].to_numpy(float) for f in factors}
    columns = [("(Intercept)", "intercept", np.ones(len(table)))]
    columns += [(f, "linear", x[f]) for f in factors]
    if "TWI" in order:
        columns += [(f"{f}:{g}", "interaction", x[f] * x[g]) for f, g in combinations(factors, 2)]
    if "PQ" in order:
        columns += [(f"{f}^2", "square", x[f] ** 2) for f in factors]
    Z = np.stack([c for *_, c in columns], axis=1)
    terms: list[Any] = [SimpleNamespace(name=n, kind=k) for n, k, _ in columns]
    if block is not None:
        extra, names = block_columns(table[block])
        Z, terms = np.hstack([Z, extra]), [*terms, *names]
    settings = list(zip(*(table[f] for f in factors), strict=True))
    return fit_least_squares(
        Z,
        table[response].to_numpy(float),
        terms,
        setting_ids=settings,
        block_ids=None if block is None else table[block],
    )


def same(value: float, reference: Any, rel: float = REL) -> None:
    if reference == "NA":
        assert np.isnan(value)
    else:
        assert value == pytest.approx(reference, rel=rel)


def check_anova(result: LeastSquaresFit, reference: dict[str, Any]) -> None:
    translation = {
        "blocks": "block",
        "first order": "FO",
        "interactions": "TWI",
        "squares": "PQ",
        "residual": "Residual",
        "lack of fit": "Lack of fit",
        "pure error": "Pure error",
    }
    rows = {row.source: row for row in result.anova()}
    total = rows.pop("total")
    assert len(rows) == len(reference)
    for source, row in rows.items():
        key = next(k for k in reference if k.lower().startswith(translation[source].lower()))
        want = reference[key]
        assert row.df == want["df"]
        same(row.ss, want["ss"], 1e-9)
        same(row.ms, want["ms"], 1e-9)
        same(row.f, want.get("F", "NA"), 1e-9)
        same(row.p, want.get("p", "NA"), 1e-8)
    model = [r for s, r in rows.items() if s not in ("lack of fit", "pure error")]
    assert total.df == sum(r.df for r in model)
    assert total.ss == pytest.approx(sum(r.ss for r in model), rel=1e-12)


def check_fit(result: LeastSquaresFit, reference: dict[str, Any], block: str | None = None) -> None:
    numbers = reference["fit"]
    same(result.r2, numbers["r_squared"])
    same(result.r2_adjusted, numbers["adj_r_squared"], 1e-9)
    same(result.s, numbers["residual_se"])
    assert result.df_residual == numbers["df_residual"]
    test = result.partial_f([i for i, k in enumerate(result.kinds) if k != "intercept"])
    same(test.f, numbers["f_statistic"], 1e-9)
    same(test.p, numbers["f_p"], 1e-8)
    index = {name: i for i, name in enumerate(result.names)}
    p_values = result.p_value
    for name, want in reference["coefficients"].items():
        if block is not None and (name == "(Intercept)" or name.lower().startswith("block")):
            continue
        i = index[name]
        scale = max(abs(want["estimate"]), want["std_error"])
        assert result.estimate[i] == pytest.approx(want["estimate"], abs=1e-11 * scale)
        same(result.se[i], want["std_error"])
        assert result.t[i] == pytest.approx(want["t"], rel=1e-10, abs=1e-10)
        same(p_values[i], want["p"], 1e-7)
    if block is not None:  # treatment contrasts there, sum-to-zero here
        shift = next(v for k, v in reference["coefficients"].items() if k.lower().startswith("block"))
        intercept = reference["coefficients"]["(Intercept)"]["estimate"]
        assert result.estimate[0] == pytest.approx(intercept + shift["estimate"] / 2, rel=1e-12)
        last = result.n_terms - 1
        assert -2.0 * result.estimate[last] == pytest.approx(shift["estimate"], rel=1e-11)
        same(2.0 * result.se[last], shift["std_error"])


def test_chemreact_first_order() -> None:
    table, want = pd.read_csv(DATA / "ChemReact1.csv"), expected("ChemReact")
    table["x1"], table["x2"] = (table["Time"] - 85) / 5, (table["Temp"] - 175) / 5
    for key, order in (("first_order", "FO"), ("first_order_plus_interaction", "FO+TWI")):
        result = fit(table, "Yield", ["x1", "x2"], order)
        check_fit(result, want[key])
        check_anova(result, want[key]["anova"])


def test_chemreact_second_order_in_two_blocks() -> None:
    table, want = pd.read_csv(DATA / "ChemReact_joined_blocks.csv"), expected("ChemReact")["second_order_blocked"]
    result = fit(table, "Yield", ["x1", "x2"], "FO+TWI+PQ", "Block")
    check_fit(result, want, "Block")
    check_anova(result, want["anova"])
    # At the stationary point: the mean of the two blocks' predictions.
    a, b = want["canonical"]["stationary_point_coded"].values()
    mean = result.predict(np.array([[1.0, a, b, a * b, a * a, b * b]])).mean[0]
    assert mean == pytest.approx(np.mean(list(want["predicted_at_stationary"].values())), rel=1e-12)


def test_helicopters() -> None:
    table, want = pd.read_csv(DATA / "heli_coded.csv"), expected("heli")
    result = fit(table, "ave", ["x1", "x2", "x3", "x4"], "FO+TWI+PQ", "block")
    check_fit(result, want, "block")
    check_anova(result, want["anova"])


def test_codata() -> None:
    table, want = pd.read_csv(DATA / "codata.csv"), expected("codata")
    result = fit(table, "y", ["x1", "x2"], "FO+TWI+PQ")
    check_fit(result, want)
    check_anova(result, want["anova"])


def test_chemical_process() -> None:
    table, want = pd.read_csv(DATA / "chemical.csv"), expected("chemical")
    result = fit(table, "y", ["x1", "x2"], "FO+TWI+PQ")
    np.testing.assert_allclose(result.estimate, want["coefficients"], rtol=1e-12)
    np.testing.assert_allclose(result.se, want["std_errors"], rtol=1e-12)
    np.testing.assert_allclose(result.p_value, want["p_values"], rtol=1e-9)
    assert result.press == pytest.approx(want["PRESS"], rel=1e-12)
    assert result.r2 == pytest.approx(want["r_squared"], rel=1e-13)
    assert result.s == pytest.approx(want["residual_sd"], rel=1e-13)
    check_anova(result, want["anova"])
    lof = result.lack_of_fit()
    assert isinstance(lof, LackOfFit)
    assert lof.f == pytest.approx(want["anova"]["Lack of fit"]["F"], rel=1e-11)
