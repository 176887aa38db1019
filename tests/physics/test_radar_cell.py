"""Shape and length of the resolution cell: the response to one bright element, its power, and how pixels fade."""

from __future__ import annotations

import math

import numpy as np
import pytest
from psm_cases import Table, radar, scene
from scipy.stats import norm
from shorthands import percent_correct

from seqrsm.errors import ConfigurationError
from seqrsm.scene.scene import Scene
from seqrsm.score.evidence import evidence_of
from seqrsm.simulate.radar.fading import correlated_fading
from seqrsm.simulate.radar.psm import simulate_radar
from seqrsm.simulate.radar.result import RadarImage


def response(shape: str) -> np.ndarray:
    """Power of a bright cell of 5 m over dark ground, (rows, columns) of pixels of 5 m, by a radar of 20 m."""
    cover = np.zeros((121, 121), dtype=np.uint8)
    cover[60, 60] = 1
    s = scene(np.zeros((121, 121)), 5.0, cover)
    one = radar(resolution_m=20.0, pixel_m=5.0, cell_shape=shape)
    found = simulate_radar(s, one, Table((-200.0, 0.0)), seed=1, run_id=1)
    return np.asarray(found.mean_power[0] / found.calibration_w[:, None])


@pytest.mark.parametrize("axis", [0, 1])
def test_response_has_the_shape_and_its_half_power_width(axis: int) -> None:
    laws = {
        "gaussian": lambda d: np.exp(-4.0 * math.log(2.0) * (d / 20.0) ** 2),
        "sinc_squared": lambda d: np.sinc(0.885893 * d / 20.0) ** 2,
    }
    for shape, law in laws.items():
        found = response(shape)
        line = np.take(found, np.unravel_index(found.argmax(), found.shape)[1 - axis], axis=1 - axis)
        peak = int(line.argmax())
        d = 5.0 * np.arange(-12, 13)
        np.testing.assert_allclose(line[peak - 12 : peak + 13] / line[peak], law(d), atol=0.01)
    half = law(np.array([10.0]))
    assert half == pytest.approx(0.5, abs=1e-5)


def test_a_shape_moves_power_and_makes_none() -> None:
    box = response("box").sum()
    for shape in ("gaussian", "sinc_squared"):
        assert response(shape).sum() == pytest.approx(box, rel=0.01)


def test_fine_pixels_fade_together_as_far_as_their_cells_overlap() -> None:
    looks = np.full(400, 16.0)
    key, first = (np.uint32(1), np.uint32(2)), np.zeros(1, dtype=np.int64)
    d = 4.0 * (correlated_fading((1, 400, 400), looks, first, key, (4.0, 4.0), "gaussian")[0] - 1.0)
    assert d.var() == pytest.approx(1.0, abs=0.05)
    for lag in (1, 2, 4):
        # A Gaussian's autocorrelation is a Gaussian, as wide again by the root of 2.
        law = math.exp(-2.0 * math.log(2.0) * (lag / 4.0) ** 2)
        assert np.mean(d[:, lag:] * d[:, :-lag]) == pytest.approx(law, abs=0.07)


@pytest.mark.parametrize("pixel_m", [None, 12.0])
def test_a_shape_needs_fine_pixels(pixel_m: float | None) -> None:
    with pytest.raises(ConfigurationError, match="pixels are too coarse"):
        radar(resolution_m=20.0, pixel_m=pixel_m, cell_shape="gaussian")


def stripes() -> tuple[Scene, RadarImage]:
    """Stripes of 60 m, -10 and -20 dB in turn, under cells of 20 m; pixels of 5 m, no noise, no fading."""
    stripe = np.broadcast_to(np.arange(240) // 12, (200, 240))
    ground = scene(np.zeros(stripe.shape), 5.0, stripe % 2, stripe)
    r = radar(resolution_m=20.0, pixel_m=5.0, fading="none", peak_power_w=1e9, altitude_m=1e5, prf_hz=300.0)
    return ground, simulate_radar(ground, r, Table((-10.0, -20.0)), seed=1, run_id=1)


def test_fine_pixels_are_taught_by_ground_that_fills_their_resolution_cell() -> None:
    """Of 12 pixels across a stripe the middle 10 teach, whose cells lie in it to 80 percent."""
    ground, one = stripes()
    found = percent_correct([one], ground, seed=1, run_id=1).details["per_class_percent"]
    away = np.minimum(np.arange(12), 11 - np.arange(12)) * 5.0 + 2.5  # from the nearer border [m]
    own = np.clip(0.5 + away / 20.0, 0.0, 1.0)
    seen = [10.0 * np.log10(own * 10.0**a + (1.0 - own) * 10.0**b) for a, b in ((-1.0, -2.0), (-2.0, -1.0))]
    laws = [norm(db[own > 0.8].mean(), db[own > 0.8].std()) for db in seen]
    right = [laws[k].logpdf(seen[k]) > laws[1 - k].logpdf(seen[k]) for k in (0, 1)]
    assert [int(r.sum()) for r in right] == [10, 12]
    # Ten stripes of each; the first one has no neighbour on one side.
    assert found == pytest.approx({"class 0": 100.0 * (1.0 - 19.0 / 120.0), "class 1": 100.0}, abs=0.1)


def test_a_field_is_what_resolution_cells_inside_it_show() -> None:
    ground, one = stripes()
    levels = evidence_of([one], ground, by="field", seed=1, run_id=1).features[0]
    assert np.abs(np.abs(levels + 15.0) - 5.0).max() < 0.02
