"""Scores of a radiometer's image: classification in kelvin, retrieval, disjoint training, standard errors."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "physics"))

from prm_cases import Table, image, radiometer, scene

from seqrsm.errors import ConfigurationError, SceneError
from seqrsm.scattering.emissivity import load_emissivity_table
from seqrsm.score.classification import score_pixels
from seqrsm.score.retrieval import (
    _crossed_fit,
    percent_correct_radiometer,
    retrieval_error,
    soil_moisture_error,
    water_fraction_error,
)
from seqrsm.simulate.radiometer.prm import simulate_radiometer

PATCH = np.kron(np.random.default_rng(9).integers(0, 2, (12, 16)), np.ones((10, 10), dtype=int))
FIELD = np.kron(np.arange(12 * 16).reshape(12, 16), np.ones((10, 10), dtype=int))
FINE = {
    "resolution_m": 20.0,
    "scan_period_s": 0.3,
    "speed_m_s": 100.0,
    "integration_time_ms": 0.3,
    "bandwidth_mhz": 1e3,
}


def land(categories, cover=PATCH, cell_m=10.0):
    return scene(np.zeros(cover.shape), cell_m, cover, FIELD, categories)


def test_plain_ground_is_classified_and_alike_ground_is_not():
    s = land(("class 0", "class 1"))
    good = percent_correct_radiometer(image(s, radiometer(**FINE), Table((0.5, 0.9))), s, seed=1, run_id=1)
    assert good.value > 88.0
    # Emissivities alike: equal priors leave chance.
    noise = percent_correct_radiometer(image(s, radiometer(**FINE), Table((0.7, 0.7))), s, seed=1, run_id=1)
    assert noise.value == pytest.approx(50.0, abs=8.0)
    assert good.n_cells == PATCH.size
    assert good.confusion.sum() == PATCH.size
    assert set(good.details["per_class_percent"]) == {"class 0", "class 1"}


def test_coarse_beams_pay_for_mixed_ground_and_gaps_for_what_they_miss():
    s = land(("class 0", "class 1"))
    table = Table((0.5, 0.9))

    def score(**changes):
        found = image(s, radiometer(**{**FINE, **changes}), table)
        return percent_correct_radiometer(found, s, seed=1, run_id=1).value

    assert score() > score(resolution_m=80.0) + 3.0
    assert score() > score(scan_period_s=4.0, integration_time_ms=4.0) + 10.0


def test_the_look_angle_is_no_evidence_but_is_accounted_for():
    # Emission falls with the angle by more than the classes differ.
    s = land(("class 0", "class 1"))
    steep = Table((lambda t: 0.9 - 1.5e-4 * t**2, lambda t: 0.85 - 1.5e-4 * t**2))
    found = image(s, radiometer(altitude_m=700.0, **FINE), steep)
    with_angle = percent_correct_radiometer(found, s, seed=1, run_id=1).value
    rng = np.random.default_rng(0)
    n = 4000
    label = rng.integers(0, 2, n)
    angle = rng.uniform(0.0, 1.0, (n, 1))
    x = label + 20.0 * angle[:, 0] + rng.normal(0.0, 0.1, n)
    counts = np.stack([1 - label, label], axis=1)
    where = (counts, np.arange(n) // 50, rng.random(n // 50 + 1))
    blind = score_pixels(x[None], *where).value
    told = score_pixels(np.vstack([x, angle[:, 0]]), *where, covariates=1).value
    assert with_angle > 85.0
    assert blind < 60.0
    assert told > 99.0
    # A covariate that gives the class away is not used as evidence of it.
    given_away = np.vstack([rng.normal(size=n), label + rng.normal(0.0, 0.3, n)])
    useless = score_pixels(given_away, *where, covariates=1).value
    assert useless < 60.0


def test_soil_moisture_is_retrieved_at_l_band_and_hidden_at_k_band():
    s = land(("Bareground", "Grass"))
    table = load_emissivity_table()
    errors = []
    for f in (1.4, 20.0):
        given = {**FINE, "bandwidth_mhz": 300.0, "channels": ("H", "V"), "soil_moisture_field_sd": 0.08}
        found = simulate_radiometer(s, radiometer(frequency_ghz=f, **given), table, seed=2, run_id=1)
        score = soil_moisture_error(found, s, seed=2, run_id=1)
        errors.append(score.value)
        assert 0.0 < score.se < score.value
    spread = score.details["truth_sd"]
    assert errors[0] < 0.75 * spread
    assert errors[0] < errors[1] <= 1.1 * spread


def test_retrieval_error_is_the_root_mean_square_of_a_known_case():
    # Noiseless, one field to a footprint: emissivity falls with moisture, retrieval is nearly exact inside fields.
    s = land(("Bareground",), np.zeros_like(PATCH))
    r = radiometer(
        frequency_ghz=1.4, channels=("H",), resolution_m=10.0, scan_period_s=0.2, integration_time_ms=0.05,
        beam="box", noise_temperature_k=0.0, bandwidth_mhz=1000.0, altitude_m=3000.0,
        soil_moisture_low=0.2, soil_moisture_high=0.2,
    )  # fmt: skip
    quiet = load_emissivity_table()
    quiet = type(quiet)(quiet.curves, quiet.models, {"Bareground": (0.0, 0.0, 0.0)}, quiet.citations)
    found = simulate_radiometer(s, r, quiet, seed=2, run_id=1)
    score = retrieval_error(found, s, seed=2, run_id=1)
    moisture = 100.0 * found.occasion.field_moisture[s.field_id]
    assert score.details["truth_sd"] == pytest.approx(moisture.std())
    assert score.value < 0.5 * score.details["truth_sd"]
    assert abs(score.details["bias"]) < 0.2


def test_water_fraction_in_blocks_beats_single_cells():
    s = land(("Grass", "Water"))
    found = simulate_radiometer(s, radiometer(**FINE), load_emissivity_table(), seed=2, run_id=1)
    cell = retrieval_error(found, s, seed=2, run_id=1, quantity="water_fraction")
    block = water_fraction_error(found, s, seed=2, run_id=1)
    coarse = retrieval_error(found, s, seed=2, run_id=1, quantity="water_fraction", block_m=400.0)
    assert coarse.value < block.value <= cell.value < 45.0
    assert block.confusion.size == 0


def test_training_and_test_tiles_are_disjoint():
    # Features without meaning explain what they were fitted to, and nothing of the other half.
    rng = np.random.default_rng(1)
    features, target = rng.normal(size=(200, 40)), rng.normal(size=200)
    blind = _crossed_fit(features, target, np.ones(200), np.arange(200) // 10, rng.random(20))
    assert np.sqrt(np.mean((blind - target) ** 2)) > 1.1 * target.std()
    s = land(("Bareground",), np.zeros_like(PATCH))
    found = simulate_radiometer(s, radiometer(**FINE, frequency_ghz=5.0), load_emissivity_table(), seed=2, run_id=1)
    a = retrieval_error(found, s, seed=2, run_id=1)
    b = retrieval_error(found, s, seed=2, run_id=2)
    assert a.value != b.value
    assert a.value == retrieval_error(found, s, seed=2, run_id=1).value
    assert a.n_clusters > 20


def test_standard_error_covers_the_spread_over_scenes():
    # The se over tiles stands for another piece of ground: compare with the spread over drawn scenes.
    table = Table((0.78, 0.82), field_sd=0.03)
    values, errors = [], []
    for k in range(12):
        cover = np.kron(np.random.default_rng(k).integers(0, 2, (12, 16)), np.ones((10, 10), dtype=int))
        s = land(("class 0", "class 1"), cover)
        found = simulate_radiometer(s, radiometer(**FINE), table, seed=k, run_id=1)
        score = percent_correct_radiometer(found, s, seed=k, run_id=1, tile_m=100.0)
        values.append(score.value)
        errors.append(score.se)
    ratio = float(np.std(values, ddof=1)) / math.sqrt(float(np.mean(np.square(errors))))
    assert 0.5 < ratio < 1.9


def test_what_cannot_be_scored_is_refused():
    s = land(("Water", "Asphalt"))
    found = simulate_radiometer(s, radiometer(**FINE), load_emissivity_table(), seed=2, run_id=1)
    with pytest.raises(SceneError, match="soil_moisture"):
        retrieval_error(found, s, seed=1, run_id=1)
    with pytest.raises(ConfigurationError, match="no such quantity"):
        retrieval_error(found, s, seed=1, run_id=1, quantity="salinity")
    dry = land(("Grass", "Asphalt"))
    other = simulate_radiometer(dry, radiometer(**FINE), load_emissivity_table(), seed=2, run_id=1)
    with pytest.raises(SceneError, match="water_fraction"):
        water_fraction_error(other, dry, seed=1, run_id=1)
