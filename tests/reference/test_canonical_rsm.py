"""Stationary points and eigenvalues of R's rsm 2.10.6 and of 60-digit arithmetic.

The numbers and their provenance are in tests/reference/data/rsm. They agree to 1e-10.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from seqrsm.design.factors import ContinuousFactor
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.fit import canonical
from seqrsm.fit.canonical import stationary_point

DATA = Path(__file__).parent / "data" / "rsm"


def load(name: str) -> Any:
    return json.loads((DATA / f"{name}_expected.json").read_text(encoding="utf-8"))


def beta_from(coefficients: dict[str, dict[str, float]], k: int, block: str = "") -> tuple[QuadraticModel, np.ndarray]:
    """Coefficients of an rsm fit in the order of QuadraticModel, at the mean of two blocks if there are any."""
    model = QuadraticModel(tuple(ContinuousFactor(f"x{i + 1}", -1.0, 1.0) for i in range(k)))
    values = {name: float(row["estimate"]) for name, row in coefficients.items()}
    values["intercept"] = values["(Intercept)"] + (0.5 * values[block] if block else 0.0)
    return model, np.array([values[name] for name in model.term_names])


def check_canonical(model: QuadraticModel, beta: np.ndarray, expected: Any) -> None:
    found = stationary_point(model, Region(model.factors), beta)
    names = expected["variable_order"]
    want = np.array([expected["stationary_point_coded"][name] for name in names])
    np.testing.assert_allclose(found.point, want, rtol=1e-10, atol=1e-11)
    eigenvalues = np.where(found.flat, 0.0, found.eigenvalues)
    np.testing.assert_allclose(eigenvalues, expected["eigenvalues"], rtol=1e-10, atol=1e-12)
    for j, vector in enumerate(expected["eigenvectors_columns"]):
        mine = found.eigenvectors[:, j] * np.sign(found.eigenvectors[:, j] @ np.array(vector))
        np.testing.assert_allclose(mine, vector, atol=1e-10)


def test_chemreact_second_order() -> None:
    expected = load("ChemReact")["second_order_blocked"]
    model, beta = beta_from(expected["coefficients"], 2)
    check_canonical(model, beta, expected["canonical"])
    point = stationary_point(model, Region(model.factors), beta)
    assert point.kind == "maximum"
    assert point.inside_region
    assert point.value == pytest.approx(expected["predicted_at_stationary"]["1"], abs=1e-10)


def test_chemreact_in_natural_units() -> None:
    expected = load("ChemReact")["second_order_blocked"]
    factors = (ContinuousFactor("Time", 80.0, 90.0), ContinuousFactor("Temp", 170.0, 180.0))
    _, beta = beta_from(expected["coefficients"], 2)
    region = Region(factors)
    found = stationary_point(QuadraticModel(factors), region, beta)
    natural = region.decode(found.point)[0]
    for name, value in expected["stationary_point_natural"].items():
        assert natural[name] == pytest.approx(value, rel=1e-12)


def test_heli_saddle() -> None:
    expected = load("heli")
    model, beta = beta_from(expected["coefficients"], 4)
    check_canonical(model, beta, expected["canonical"])
    point = stationary_point(model, Region(model.factors), beta)
    assert point.kind == "saddle"
    assert point.value == pytest.approx(expected["predicted_at_stationary"]["1"], abs=1e-9)
    at_mean = beta_from(expected["coefficients"], 4, "block2")[1]
    both = expected["predicted_at_stationary"]
    mean = stationary_point(model, Region(model.factors), at_mean).value
    assert mean == pytest.approx(0.5 * (both["1"] + both["2"]), abs=1e-9)


def test_codata_ridge_with_and_without_threshold(monkeypatch: pytest.MonkeyPatch) -> None:
    expected = load("codata")
    model, beta = beta_from(expected["coefficients"], 2)
    check_canonical(model, beta, expected["canonical_rsm_default_threshold"]["canonical"])
    ridge = stationary_point(model, Region(model.factors), beta)
    assert ridge.kind == "ridge"
    assert ridge.inside_region
    far = expected["canonical_threshold0"]["stationary_point_coded"]
    np.testing.assert_allclose(ridge.exact_point, [far["x1"], far["x2"]], rtol=1e-10)
    monkeypatch.setattr(canonical, "FLAT", 0.0)
    check_canonical(model, beta, expected["canonical_threshold0"])
    assert stationary_point(model, Region(model.factors), beta).kind == "saddle"


def test_chemical_process_to_ten_digits() -> None:
    expected = load("chemical")
    model = QuadraticModel(tuple(ContinuousFactor(name, -1.0, 1.0) for name in ("x1", "x2")))
    values = dict(zip(expected["terms"], expected["coefficients"], strict=True))
    values["intercept"] = values["1"]
    beta = np.array([values[name] for name in model.term_names])
    found = stationary_point(model, Region(model.factors), beta)
    np.testing.assert_allclose(found.point, expected["stationary_point"], rtol=1e-12)
    np.testing.assert_allclose(found.eigenvalues, expected["eigenvalues"], rtol=1e-13)
    np.testing.assert_allclose(found.eigenvectors.T, expected["eigenvectors_rows_sign_largest_positive"], atol=1e-13)
    assert found.value == pytest.approx(expected["predicted_at_stationary"], rel=1e-14)
