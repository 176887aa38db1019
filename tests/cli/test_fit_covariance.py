"""``fit --json``: the covariance of the coefficients, and the stationary point with and without its flat axis."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from measured_campaign import FREQUENCY, MEASURED, X, make, quadratic
from typer.testing import CliRunner

from seqrsm.cli.app import app

TWO = [(0, 0), (1, 0), (0, 1), (1, 1), (2, 0), (0, 2)]


def told(folder: Path, *options: str) -> str:
    found = CliRunner().invoke(app, ["fit", str(folder), *options], env={"COLUMNS": "400"})
    assert found.exit_code == 0, found.output
    return found.stdout


def by_hand(rows: list[dict]) -> tuple[list[str], np.ndarray, np.ndarray]:
    """Names, coefficients and covariance of the full quadratic, by the normal equations."""
    a = np.array([row["x"] for row in rows]) / 5.0 - 1.0
    b = np.log(np.array([row["frequency"] for row in rows])) / np.log(4.0) - 1.0
    y = np.array([row["score"] for row in rows])
    Z = np.column_stack([a**i * b**j for i, j in TWO])
    beta, (sse,), *_ = np.linalg.lstsq(Z, y, rcond=None)
    names = ["intercept", "x", "frequency", "x:frequency", "x^2", "frequency^2"]
    return names, beta, sse / (len(y) - 6) * np.linalg.inv(Z.T @ Z)


def full(found: dict) -> np.ndarray:
    p = len(found["terms"])
    matrix = np.zeros((p, p))
    for i, row in enumerate(found["lower_triangle"]):
        matrix[i, : i + 1] = matrix[: i + 1, i] = row
    return matrix


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make(tmp_path_factory.mktemp("plain") / "c", X + FREQUENCY, quadratic(), "", MEASURED)


@pytest.fixture(scope="module")
def ridge(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[dict]]:
    """Rising along frequency, with hardly any curvature there."""
    rng = np.random.default_rng(4)
    rows = []
    for _ in range(40):
        a, b = rng.uniform(-1, 1, 2)
        score = 70 - 9 * (a - 0.2) ** 2 + 2 * b - 0.4 * b**2 + 0.1 * rng.normal()
        rows.append({"x": 5 + 5 * a, "frequency": 4.0 * 4.0**b, "score": round(score, 6)})
    return make(tmp_path_factory.mktemp("ridge") / "c", X + FREQUENCY, rows, "", MEASURED), rows


def test_the_covariance_is_that_of_the_normal_equations(folder: Path) -> None:
    document = json.loads(told(folder, "--json"))
    names, beta, covariance = by_hand(quadratic())
    found = document["covariance"]
    order = [names.index(name) for name in found["terms"]]
    assert found["terms"] == [term["name"] for term in document["terms"]]
    np.testing.assert_allclose(full(found), covariance[np.ix_(order, order)], rtol=1e-8, atol=1e-14)
    assert [term["coded"]["estimate"] for term in document["terms"]] == pytest.approx(beta[order], rel=1e-8)
    assert [len(row) for row in found["lower_triangle"]] == [1, 2, 3, 4, 5, 6]


def exact_by_hand(rows: list[dict]) -> tuple[np.ndarray, np.ndarray]:
    """Stationary point, and its standard errors by numerical derivatives."""
    _, beta, covariance = by_hand(rows)

    def at(c: np.ndarray) -> np.ndarray:
        return np.linalg.solve([[2 * c[4], c[3]], [c[3], 2 * c[5]]], -c[1:3])

    steps = 1e-6 * np.eye(6)
    slopes = np.column_stack([(at(beta + step) - at(beta - step)) / 2e-6 for step in steps])
    return at(beta), np.sqrt(np.diag(slopes @ covariance @ slopes.T))


def natural(coded: np.ndarray) -> list[float]:
    return [5 + 5 * coded[0], 4.0 * 4.0 ** coded[1]]


def test_the_stationary_point_has_standard_errors(folder: Path) -> None:
    document = json.loads(told(folder, "--json"))["stationary_point"]
    coded, se = exact_by_hand(quadratic())
    for found in (document, document["exact"]):
        assert list(found["coded"].values()) == pytest.approx(coded, rel=1e-7)
        assert list(found["se"]["coded"].values()) == pytest.approx(se, rel=1e-6)
        assert list(found["natural"].values()) == pytest.approx(natural(coded), rel=1e-7)
        assert list(found["se"]["low"].values()) == pytest.approx(natural(coded - se), rel=1e-6)
        assert list(found["se"]["high"].values()) == pytest.approx(natural(coded + se), rel=1e-6)
    assert document["flat"] == [False, False]
    text = told(folder)
    assert "If no curvature is set to zero" not in text
    low, value, high = (natural(coded + k * se) for k in (-1, 0, 1))
    assert f"x {value[0]:.2f} ± {high[0] - value[0]:.2f} and frequency {value[1]:.2f} ({low[1]:.2f} to " in text


def test_a_rising_ridge_is_told_with_its_flat_axis_and_without(ridge: tuple[Path, list[dict]]) -> None:
    folder, rows = ridge
    document = json.loads(told(folder, "--json"))["stationary_point"]
    assert document["kind"] == "ridge"
    assert sum(document["flat"]) == 1
    coded, se = exact_by_hand(rows)
    exact = document["exact"]
    assert list(exact["coded"].values()) == pytest.approx(coded, rel=1e-6)
    assert list(exact["se"]["coded"].values()) == pytest.approx(se, rel=1e-5)
    assert list(exact["natural"].values()) == pytest.approx(natural(coded), rel=1e-6)
    assert list(exact["se"]["low"].values()) == pytest.approx(natural(coded - se), rel=1e-5)
    assert 0.0 < exact["se"]["low"]["frequency"] < exact["natural"]["frequency"] < exact["se"]["high"]["frequency"]
    assert exact["inside_region"] is bool(np.all(np.abs(coded) <= 1.0))
    assert document["se"]["coded"]["frequency"] < 0.1 * exact["se"]["coded"]["frequency"]
    assert "If no curvature is set to zero, the stationary point lies outside the region: " in " ".join(
        told(folder).split()
    )
