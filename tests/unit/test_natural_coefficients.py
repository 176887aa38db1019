"""Coefficients in natural units against the surface they must reproduce and a fit made in natural units."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from seqrsm.design.factors import CategoricalFactor, ContinuousFactor, DiscreteFactor
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.fit.least_squares import block_columns, fit_least_squares
from seqrsm.fit.natural import natural_transform

FACTORS = (
    ContinuousFactor("frequency", 1.0, 18.0, "GHz", "log"),
    CategoricalFactor("polarization", ("HH", "HV", "VV")),
    ContinuousFactor("angle", 20.0, 70.0, "deg"),
    DiscreteFactor("looks", (1.0, 4.0), scale="log"),
    CategoricalFactor("season", ("summer", "winter")),
)


def natural_matrix(model: QuadraticModel, region: Region, points: np.ndarray) -> np.ndarray:
    """Terms evaluated by their names from the natural settings, without the package's coding."""
    rows = []
    for setting in region.decode(points):
        value: dict[str, float] = {"intercept": 1.0}
        for factor in model.factors:
            x = setting[factor.name]
            if isinstance(factor, CategoricalFactor):
                for level in factor.levels[:-1]:
                    value[f"{factor.name}[{level}]"] = (x == level) - float(x == factor.levels[-1])
            else:
                value[factor.name] = float(np.log10(x)) if factor.scale == "log" else float(x)
        row = []
        for name in model.term_names:
            if name.endswith("^2"):
                row.append(value[name[:-2]] ** 2)
            else:
                row.append(np.prod([value[part] for part in name.split(":")]))
        rows.append(row)
    return np.array(rows)


def problem(order: int, seed: int = 0, n: int = 80):
    model, region = QuadraticModel(FACTORS, order), Region(FACTORS)
    rng = np.random.default_rng(seed)
    points = region.sample(n, rng)
    y = 50 + model.matrix(points) @ rng.normal(0, 3, model.p) + rng.normal(size=n)
    return model, region, points, y


@pytest.mark.parametrize("order", [1, 2])
def test_same_surface_and_the_standard_errors_of_a_fit_in_natural_units(order: int) -> None:
    model, region, points, y = problem(order)
    coded = fit_least_squares(model.matrix(points), y, model.terms)
    found = coded.predict(natural_transform(model), 0.9)
    direct = fit_least_squares(natural_matrix(model, region, points), y, model.terms)
    np.testing.assert_allclose(found.mean, direct.estimate, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.se_mean, direct.se, rtol=1e-9)
    np.testing.assert_allclose(found.confidence.low, direct.interval(0.9).low, rtol=1e-9, atol=1e-9)
    new = region.sample(200, np.random.default_rng(5))
    surface = natural_matrix(model, region, new) @ found.mean
    np.testing.assert_allclose(surface, coded.predict(model.matrix(new)).mean, rtol=1e-10)


def test_blocks_are_left_alone() -> None:
    model, _, points, y = problem(2, 1)
    columns, names = block_columns(["a", "b"] * 40)
    fit = fit_least_squares(np.hstack([model.matrix(points), columns]), y, [*model.terms, *names])
    found = fit.predict(natural_transform(model))
    assert found.mean.shape == (model.p,)
    np.testing.assert_allclose(found.mean, natural_transform(model) @ fit.estimate[: model.p], rtol=1e-12)


def test_transform_of_two_factors_by_hand() -> None:
    """c = (x - 30) / 10 and d = (log10 f - 1) / 1: 1, c, d, cd, c^2, d^2 written out."""
    model = QuadraticModel((ContinuousFactor("x", 20.0, 40.0), ContinuousFactor("f", 1.0, 100.0, scale="log")))
    T = natural_transform(model)
    expected = np.array(
        [
            [1, -3, -1, 3, 9, 1],
            [0, 0.1, 0, -0.1, -0.6, 0],
            [0, 0, 1, -3, 0, -2],
            [0, 0, 0, 0.1, 0, 0],
            [0, 0, 0, 0, 0.01, 0],
            [0, 0, 0, 0, 0, 1],
        ]
    )
    np.testing.assert_allclose(T, expected, atol=1e-14)


@pytest.mark.parametrize("width", [1e-12, 1e12])
def test_range_of_any_width(width: float) -> None:
    """A slope per natural unit is the coded slope over half the range, at 1e-12 as at 1e12."""
    factors = (ContinuousFactor("x", 0.0, width), ContinuousFactor("z", -1.0, 1.0))
    model, region = QuadraticModel(factors), Region(factors)
    points = np.array(list(itertools.product([-1.0, 0.0, 1.0], repeat=2)) * 2)
    y = 5 + model.matrix(points)[:, 1] + np.random.default_rng(0).normal(0, 0.1, 18)
    fit = fit_least_squares(model.matrix(points), y, model.terms)
    found = fit.predict(natural_transform(model))
    half, (b0, b1, b2, b12, b11, b22) = 0.5 * width, fit.estimate
    by_hand = [b0 - b1 + b11, (b1 - 2 * b11) / half, b2 - b12, b12 / half, b11 / half**2, b22]
    np.testing.assert_allclose(found.mean, by_hand, rtol=1e-9)
    natural = natural_matrix(model, region, points)
    np.testing.assert_allclose(natural @ found.mean, fit.fitted, rtol=1e-10)
