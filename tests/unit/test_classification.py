"""Percent correct against known Bayes errors, its standard error against Monte Carlo, and its bookkeeping."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import special

from seqrsm.score.classification import cluster_ratio, score_pixels
from seqrsm.simulate.radar.kernels import count_classes


def two_classes(distance_db, n=40_000, seed=0, sd=1.0, d=1):
    rng = np.random.default_rng(seed)
    truth = rng.integers(0, 2, n)
    db = rng.normal(0.0, sd, (n, d)) + distance_db * truth[:, None]
    counts = np.zeros((n, 2), dtype=np.int32)
    counts[np.arange(n), truth] = 3
    return 10.0 ** (0.1 * db), np.full(n, 10.0), counts, np.arange(n) // 100


@pytest.mark.parametrize(("distance", "d"), [(0.0, 1), (1.0, 1), (2.0, 1), (4.0, 1), (1.0, 3)])
def test_two_gaussian_classes_reach_the_bayes_share(distance, d):
    # Equal priors and covariances: correct = Phi(sqrt(d) distance / (2 sd)).
    power, looks, counts, tile = two_classes(distance, d=d)
    score = score_pixels(power, looks, counts, tile, seed=1, run_id=1)
    expected = 100.0 * float(special.ndtr(0.5 * distance * math.sqrt(d)))
    assert score.value == pytest.approx(expected, abs=4.5 * 100 * 0.5 / math.sqrt(40_000))
    assert score.n_cells == 120_000
    assert score.n_clusters == 400


def test_unequal_spreads_reach_the_quadratic_bayes_share():
    rng = np.random.default_rng(2)
    n = 60_000
    truth = rng.integers(0, 2, n)
    db = rng.normal(0.0, np.where(truth, 3.0, 1.0))
    counts = np.eye(2, dtype=np.int32)[truth]
    score = score_pixels(10.0 ** (0.1 * db[:, None]), np.ones(n), counts, np.arange(n) // 100, seed=1, run_id=1)
    cut = math.sqrt(2.0 * math.log(3.0) / (1.0 - 1.0 / 9.0))
    expected = 50.0 * (special.erf(cut / math.sqrt(2)) + 1.0 - special.erf(cut / 3.0 / math.sqrt(2)))
    assert score.value == pytest.approx(expected, abs=1.0)


def test_gamma_law_reaches_the_bayes_share_of_speckle():
    rng = np.random.default_rng(3)
    n, looks, ratio = 60_000, 4.0, 2.0
    truth = rng.integers(0, 2, n)
    power = rng.gamma(looks, 1.0 / looks, n) * np.where(truth, ratio, 1.0)
    cut = math.log(ratio) / (1.0 - 1.0 / ratio)
    expected = 50.0 * (special.gammainc(looks, looks * cut) + special.gammaincc(looks, looks * cut / ratio))
    counts = np.eye(2, dtype=np.int32)[truth]
    arguments = (power[:, None], np.full(n, looks), counts, np.arange(n) // 100)
    gamma = score_pixels(*arguments, seed=1, run_id=1, likelihood="gamma")
    gaussian = score_pixels(*arguments, seed=1, run_id=1)
    assert gamma.value == pytest.approx(expected, abs=1.0)
    assert gaussian.value < gamma.value + 0.3


def test_area_priors_name_the_common_class_when_nothing_else_is_known():
    rng = np.random.default_rng(4)
    n = 20_000
    truth = (rng.random(n) < 0.1).astype(int)
    power = 10.0 ** (0.1 * rng.normal(0, 1, (n, 1)))
    arguments = (power, np.ones(n), np.eye(2, dtype=np.int32)[truth], np.arange(n) // 50)
    assert score_pixels(*arguments, seed=1, run_id=1, priors="area").value == pytest.approx(90.0, abs=1.0)
    assert score_pixels(*arguments, seed=1, run_id=1).value < 80.0


def test_every_cell_of_a_mixed_pixel_counts():
    power, looks, counts, tile = two_classes(12.0)
    counts[:, 0] += 1
    truth = (counts[:, 1] > 0).astype(int)
    # Class 1 pixels hold one cell of class 0: a quarter of their cells cannot be right.
    score = score_pixels(power, looks, counts, tile, seed=1, run_id=1, training_purity=0.7)
    expected = 100.0 * (4 * (truth == 0).sum() + 3 * (truth == 1).sum()) / counts.sum()
    assert score.value == pytest.approx(expected, abs=0.05)
    assert score.confusion[0, 1] == (truth == 1).sum()
    assert score.confusion.sum() == score.n_cells


def test_a_class_missing_from_the_teaching_half_is_never_named():
    power, looks, counts, tile = two_classes(5.0, n=4000)
    three = np.zeros((4000, 3), dtype=np.int32)
    three[:, :2] = counts
    three[tile == 7] = [0, 0, 3]
    score = score_pixels(power, looks, three, tile, seed=1, run_id=1)
    assert score.confusion[2, 2] == 0
    assert score.details["per_class_percent"][2] == 0.0
    none = score_pixels(power[:100], looks[:100], three[:100], tile[:100], seed=1, run_id=1)
    assert math.isnan(none.se)


def test_a_class_of_few_pixels_and_constant_power_keeps_a_usable_covariance():
    rng = np.random.default_rng(5)
    power = np.ones((400, 3))
    power[:200] = 10.0 ** (0.1 * rng.normal(0, 1, (200, 3)))
    counts = np.zeros((400, 2), dtype=np.int32)
    counts[:200, 0] = 1
    counts[200:, 1] = 1
    score = score_pixels(power, np.ones(400), counts, np.arange(400) % 8, seed=1, run_id=1)
    assert 75.0 < score.value <= 100.0


def test_zero_power_is_the_darkest_and_makes_no_warning():
    power, looks, counts, tile = two_classes(6.0, n=2000)
    power[counts[:, 0] > 0] = 0.0
    assert score_pixels(power, looks, counts, tile, seed=1, run_id=1).value > 97.0
    assert score_pixels(np.zeros_like(power), looks, counts, tile, seed=1, run_id=1).value < 60.0


def test_the_split_is_the_runs_own_and_repeats():
    arguments = two_classes(1.0, n=3000)
    a, b, c = (score_pixels(*arguments, seed=1, run_id=k) for k in (1, 1, 2))
    assert a.value == b.value
    assert a.value != c.value


def test_cluster_error_is_that_of_repeated_samples():
    # Tiles of unequal size whose share varies: the binomial error would be five times too small.
    rng = np.random.default_rng(6)
    shares, errors, naive = [], [], []
    for _ in range(800):
        size = rng.integers(20, 60, 80)
        p = np.clip(rng.normal(0.6, 0.15, 80), 0, 1)
        share, se = cluster_ratio(rng.binomial(size, p), size, np.arange(80))
        shares.append(share)
        errors.append(se)
        naive.append(math.sqrt(share * (1 - share) / size.sum()))
    spread = np.std(shares, ddof=1)
    # Monte Carlo error of a standard deviation from 800 values is 2.5 %.
    assert np.mean(errors) == pytest.approx(spread, rel=0.09)
    assert np.mean(naive) < 0.75 * spread


def test_counts_leave_out_what_is_not_scored_not_known_or_not_seen():
    pixel = np.array([[0, 0, 1], [1, -1, 1]], dtype=np.int32)
    cover = np.array([[0, 1, 1], [255, 0, 0]], dtype=np.uint8)
    scored = np.array([[True, True, True], [True, True, False]])
    np.testing.assert_array_equal(count_classes(pixel, cover, scored, 2, 2), [[1, 1], [0, 1]])
