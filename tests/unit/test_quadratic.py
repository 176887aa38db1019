from __future__ import annotations

import numpy as np
import pytest

from seqrsm.design.factors import CategoricalFactor, ContinuousFactor, DiscreteFactor
from seqrsm.design.quadratic import QuadraticModel

F = ContinuousFactor("frequency", 1.0, 10.0)
R = ContinuousFactor("resolution", 1.0, 10.0)
P = CategoricalFactor("polarization", ("VV", "HH", "HV"))
S = CategoricalFactor("season", ("dry", "wet"))
TWO = DiscreteFactor("bits", (1.0, 2.0))


def test_order_and_names_of_the_terms():
    model = QuadraticModel((F, P, R))
    assert model.term_names == (
        "intercept",
        "frequency",
        "resolution",
        "polarization[VV]",
        "polarization[HH]",
        "polarization[VV]:frequency",
        "polarization[HH]:frequency",
        "frequency:resolution",
        "polarization[VV]:resolution",
        "polarization[HH]:resolution",
        "frequency^2",
        "resolution^2",
    )
    assert model.p == 12
    kinds = [term.kind for term in model.terms]
    assert kinds == ["intercept"] + ["linear"] * 2 + ["category"] * 2 + ["interaction"] * 5 + ["square"] * 2


@pytest.mark.parametrize("k", range(1, 8))
def test_number_of_terms_counts_each_pair_once(k):
    factors = tuple(ContinuousFactor(f"x{i}", 0.0, 1.0) for i in range(k))
    assert QuadraticModel(factors).p == 1 + 2 * k + k * (k - 1) // 2
    assert QuadraticModel(factors, order=1).p == 1 + k


def test_rows_by_hand():
    model = QuadraticModel((F, P, R))
    x, y = 0.3, -0.7
    rows = model.matrix(np.array([[x, 0, y], [x, 1, y], [x, 2, y]]))
    for row, (a, b) in zip(rows, [(1, 0), (0, 1), (-1, -1)], strict=True):
        np.testing.assert_allclose(row, [1, x, y, a, b, a * x, b * x, x * y, a * y, b * y, x * x, y * y], atol=1e-16)


def test_two_categories_multiply_and_two_levels_have_no_square():
    model = QuadraticModel((P, S, TWO))
    assert "polarization[VV]:season[dry]" in model.term_names
    assert not any(name.endswith("^2") for name in model.term_names)
    every = np.array([[a, b, c] for a in range(3) for b in range(2) for c in (-1.0, 1.0)])
    assert np.linalg.matrix_rank(model.matrix(every)) == model.p == 1 + 1 + 3 + 2 + 2 + 1


def test_columns_of_a_full_crossing_sum_to_zero():
    model = QuadraticModel((F, P, S), order=2)
    points = np.array([[x, a, b] for x in (-1.0, 1.0) for a in range(3) for b in range(2)])
    Z = model.matrix(points)
    sums = {term.name: total for term, total in zip(model.terms, Z.sum(axis=0), strict=True)}
    assert all(total == 0.0 for name, total in sums.items() if name not in ("intercept", "frequency^2"))


def test_factor_terms_hold_the_factor():
    model = QuadraticModel((F, P, R))
    names = {model.terms[i].name for i in model.factor_terms("polarization")}
    assert names == {name for name in model.term_names if "polarization" in name}
    assert {model.terms[i].name for i in model.factor_terms("resolution")} == {
        "resolution",
        "frequency:resolution",
        "polarization[VV]:resolution",
        "polarization[HH]:resolution",
        "resolution^2",
    }


def test_wrong_points_are_refused():
    model = QuadraticModel((F, P))
    for bad in ([[0.0, 3.0]], [[0.0, -1.0]], [[0.0, 0.5]]):
        with pytest.raises(ValueError):
            model.matrix(np.array(bad))
