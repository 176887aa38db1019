"""Shape and length of the resolution cell: the response to one bright element, its power, and how pixels fade."""

from __future__ import annotations

import math

import numpy as np
import pytest
from psm_cases import Table, radar, scene

from seqrsm.errors import ConfigurationError
from seqrsm.simulate.radar.fading import correlated_fading
from seqrsm.simulate.radar.psm import simulate_radar


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
