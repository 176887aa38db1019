"""No feasible point is better than the optimum, whatever the surface and the region."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seqrsm.design.constraints import Constraint
from seqrsm.design.factors import CategoricalFactor, ContinuousFactor, DiscreteFactor
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.fit.optimum import optimum, optimum_draws

FACTORS = (
    ContinuousFactor("frequency", 1.2, 17.0, "GHz", "log"),
    ContinuousFactor("resolution", 5.0, 100.0, "m", "log"),
    DiscreteFactor("looks", (1.0, 2.0, 4.0, 8.0), scale="log"),
    CategoricalFactor("polarization", ("HH", "VV")),
    ContinuousFactor("depression", 20.0, 70.0, "deg"),
)
MODEL = QuadraticModel(FACTORS)
REGIONS = {
    "box": Region(FACTORS),
    "curved": Region(FACTORS, (Constraint("looks <= 4 * (resolution / 12.1) ** 2"),)),
    "several": Region(
        FACTORS,
        (
            Constraint("frequency * resolution >= 40"),
            Constraint("depression <= 30 or frequency <= 6"),
            Constraint('polarization == "HH" or looks >= 2'),
        ),
    ),
}
SAMPLES = {name: region.sample(100_000, np.random.default_rng(1)) for name, region in REGIONS.items()}
ROWS = {name: MODEL.matrix(points) for name, points in SAMPLES.items()}


@pytest.mark.parametrize("name", REGIONS)
@settings(max_examples=8, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**32 - 1), curvature=st.floats(-3.0, 3.0), kill=st.floats(0.0, 0.8))
def test_no_feasible_point_is_better(name: str, seed: int, curvature: float, kill: float) -> None:
    rng = np.random.default_rng(seed)
    beta = rng.normal(size=MODEL.p) * (rng.random(MODEL.p) >= kill)
    beta[[t for t, term in enumerate(MODEL.terms) if term.kind == "square"]] += curvature
    region = REGIONS[name]
    best = optimum(MODEL, region, beta)
    assert region.feasible(best.point[None, :])[0]
    scan = ROWS[name] @ beta
    slack = 1e-9 * (1.0 + np.abs(beta).sum())
    assert best.value >= scan.max() - slack
    lowest = optimum(MODEL, region, beta, "minimize")
    assert lowest.value <= scan.min() + slack
    points, values = optimum_draws(MODEL, region, beta[None, :])
    assert region.feasible(points).all()
    assert values[0] <= best.value + slack
