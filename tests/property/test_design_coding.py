from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from seqrsm.design.factors import CategoricalFactor, ContinuousFactor, DiscreteFactor
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region

numbers = st.floats(-1e6, 1e6, allow_nan=False).map(lambda x: round(x, 6))
coded = st.floats(-1.0, 1.0)


@settings(deadline=None)
@given(numbers, st.floats(1e-3, 1e6), coded)
def test_linear_coding_round_trips(low, span, t):
    factor = ContinuousFactor("x", low, low + span)
    natural = float(factor.decode(t))
    assert factor.low <= natural <= factor.high
    # The span may be small against the value: rounding of the value is all that is lost.
    assert abs(float(factor.code(natural)) - t) <= 8e-16 * (4.0 + (abs(low) + span) / (factor.high - factor.low))


@settings(deadline=None)
@given(st.floats(1e-9, 1e6), st.floats(1.01, 1e9), coded)
def test_log_coding_round_trips(low, ratio, t):
    factor = ContinuousFactor("x", low, low * ratio, scale="log")
    natural = float(factor.decode(t))
    assert factor.low <= natural <= factor.high
    assert abs(float(factor.code(natural)) - t) <= 1e-14 * (1.0 + abs(np.log(low)) + np.log(ratio)) / np.log(ratio)


@given(
    st.lists(st.floats(0.01, 1e4).map(lambda x: float(f"{x:.4g}")), min_size=2, max_size=9, unique=True), st.booleans()
)
def test_discrete_levels_survive_text_and_coding(values, log):
    factor = DiscreteFactor("x", tuple(values), scale="log" if log else "linear")
    np.testing.assert_array_equal(factor.decode(factor.coded_levels), sorted(values))
    texts = [float(f"{v:.6g}") for v in factor.values]
    np.testing.assert_array_equal(factor.decode(factor.code(texts)), sorted(values))


@st.composite
def models(draw):
    kinds = draw(st.lists(st.sampled_from("ncd"), min_size=1, max_size=5))
    factors = []
    for i, kind in enumerate(kinds):
        if kind == "n":
            factors.append(ContinuousFactor(f"f{i}", 1.0, 9.0, scale=draw(st.sampled_from(["linear", "log"]))))
        elif kind == "d":
            factors.append(DiscreteFactor(f"f{i}", tuple(range(1, 2 + draw(st.integers(1, 4))))))
        else:
            factors.append(CategoricalFactor(f"f{i}", tuple("ABCD"[: draw(st.integers(2, 4))])))
    return QuadraticModel(tuple(factors), order=draw(st.sampled_from([1, 2])))


@settings(deadline=None, max_examples=40)
@given(models(), st.integers(0, 2**32 - 1))
def test_forms_give_the_value_of_the_model(model, seed):
    rng = np.random.default_rng(seed)
    points = Region(model.factors).sample(5, rng)
    beta = rng.normal(size=(3, model.p))
    values = model.matrix(points) @ beta.T
    for point, want in zip(points, values, strict=True):
        levels = tuple(int(point[i]) for i in model.categorical)
        c, b, B = model.forms(beta, levels)
        x = point[list(model.numeric)]
        np.testing.assert_allclose(c + b @ x + np.einsum("i,mij,j->m", x, B, x), want, rtol=0, atol=1e-12)
        np.testing.assert_array_equal(B, np.swapaxes(B, 1, 2))


@settings(deadline=None, max_examples=40)
@given(models())
def test_every_term_can_be_estimated_from_the_candidates(model):
    Z = model.matrix(Region(model.factors).candidates(n_continuous_levels=3))
    assert np.linalg.matrix_rank(Z) == model.p
    assert len(set(model.term_names)) == model.p


@settings(deadline=None, max_examples=40)
@given(models(), st.integers(0, 2**32 - 1))
def test_points_survive_decoding(model, seed):
    region = Region(model.factors)
    points = region.sample(6, np.random.default_rng(seed))
    np.testing.assert_allclose(region.code(region.decode(points)), points, atol=1e-13)
    assert np.all(region.feasible(points, tol=0.0))
