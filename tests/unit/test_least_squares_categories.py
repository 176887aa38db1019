"""The fit with a categorical factor: nothing may depend on the order in which its levels are listed."""

from __future__ import annotations

import numpy as np
import pytest

from seqrsm.design.factors import CategoricalFactor, ContinuousFactor
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.fit.least_squares import LeastSquaresFit, fit_least_squares


def fit(levels: tuple[str, ...]) -> tuple[LeastSquaresFit, QuadraticModel, np.ndarray]:
    rng = np.random.default_rng(0)
    x = rng.uniform(-1, 1, (36, 2))
    names = rng.choice(["HH", "HV", "VV"], 36)
    effect = {"HH": 2.0, "HV": -4.0, "VV": 1.0}
    y = 70 + 3 * x[:, 0] - 5 * x[:, 1] ** 2 + np.array([effect[n] * (1 + x[i, 0]) for i, n in enumerate(names)])
    y += rng.normal(0, 1, 36)
    factors = (
        ContinuousFactor("frequency", 1.0, 10.0, "GHz", "log"),
        ContinuousFactor("resolution", 5.0, 100.0, "m", "log"),
        CategoricalFactor("polarization", levels),
    )
    model = QuadraticModel(factors)
    points = np.column_stack([x, [levels.index(n) for n in names]])
    new = np.array([[0.2, -0.4, levels.index(n)] for n in ("HH", "HV", "VV")], dtype=np.float64)
    return fit_least_squares(model.matrix(points), y, model.terms), model, new


def test_order_of_levels_does_not_matter() -> None:
    a, model_a, new_a = fit(("HH", "HV", "VV"))
    b, model_b, new_b = fit(("VV", "HH", "HV"))
    first, second = a.predict(model_a.matrix(new_a)), b.predict(model_b.matrix(new_b))
    np.testing.assert_allclose(first.mean, second.mean, rtol=1e-12)
    np.testing.assert_allclose(first.prediction.low, second.prediction.low, rtol=1e-11)
    for x, y in zip(a.anova(), b.anova(), strict=True):
        assert (x.source, x.df) == (y.source, y.df)
        assert x.ss == pytest.approx(y.ss, rel=1e-10)
    one = a.partial_f(model_a.factor_terms("polarization"))
    two = b.partial_f(model_b.factor_terms("polarization"))
    assert one.df == 6  # two contrasts alone and two with each of two numeric factors
    assert one.f == pytest.approx(two.f, rel=1e-10)
    assert one.p < 1e-6
    # x1, x2; two contrasts; x1 x2 and 2 x 2 contrast products; two squares
    assert [(r.source, r.df) for r in a.anova()][:4] == [
        ("first order", 2),
        ("categories", 2),
        ("interactions", 5),
        ("squares", 2),
    ]
