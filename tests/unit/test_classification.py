"""Percent correct against known Bayes errors, its standard error against Monte Carlo, and its bookkeeping."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import special
from scipy.stats import multivariate_normal

from seqrsm.errors import SceneError
from seqrsm.rng import generator
from seqrsm.score.classification import cluster_ratio, halves
from seqrsm.score.cover import score_evidence
from seqrsm.score.evidence import Evidence, decibels
from seqrsm.score.pixels import _keep_fields_whole, cells_in_pixels, tiles
from seqrsm.score.utilities import Asked


def of_evidence(features, counts, tile, keys, covariates=0):
    """Percent correct of pixels that teach by their cells."""
    names = [str(k) for k in range(counts.shape[1])]
    return score_evidence(Evidence(features, counts, tile, keys, covariates, counts), names, Asked("percent_correct"))


def score_pixels(power, counts, tile, *, seed, run_id):
    """Score of powers (n_pixels, n_channels), the halves drawn tile by tile."""
    keys = generator(seed, run_id, "test").random(int(tile.max()) + 1)
    return of_evidence(decibels(power.T.copy(), counts), counts, tile, keys)


def two_classes(distance_db, n=40_000, seed=0, sd=1.0, d=1):
    rng = np.random.default_rng(seed)
    truth = rng.integers(0, 2, n)
    db = rng.normal(0.0, sd, (n, d)) + distance_db * truth[:, None]
    counts = np.zeros((n, 2), dtype=np.int32)
    counts[np.arange(n), truth] = 3
    return 10.0 ** (0.1 * db), counts, np.arange(n) // 100


@pytest.mark.parametrize(("distance", "d"), [(0.0, 1), (1.0, 1), (2.0, 1), (4.0, 1), (1.0, 3)])
def test_two_gaussian_classes_reach_the_bayes_share(distance, d):
    # Equal priors and covariances: correct = Phi(sqrt(d) distance / (2 sd)).
    power, counts, tile = two_classes(distance, d=d)
    score = score_pixels(power, counts, tile, seed=1, run_id=1)
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
    score = score_pixels(10.0 ** (0.1 * db[:, None]), counts, np.arange(n) // 100, seed=1, run_id=1)
    cut = math.sqrt(2.0 * math.log(3.0) / (1.0 - 1.0 / 9.0))
    expected = 50.0 * (special.erf(cut / math.sqrt(2)) + 1.0 - special.erf(cut / 3.0 / math.sqrt(2)))
    assert score.value == pytest.approx(expected, abs=1.0)


def test_speckle_is_told_no_better_than_its_own_law_allows():
    rng = np.random.default_rng(3)
    n, looks, ratio = 60_000, 4.0, 2.0
    truth = rng.integers(0, 2, n)
    power = rng.gamma(looks, 1.0 / looks, n) * np.where(truth, ratio, 1.0)
    cut = math.log(ratio) / (1.0 - 1.0 / ratio)
    expected = 50.0 * (special.gammainc(looks, looks * cut) + special.gammaincc(looks, looks * cut / ratio))
    counts = np.eye(2, dtype=np.int32)[truth]
    score = score_pixels(power[:, None], counts, np.arange(n) // 100, seed=1, run_id=1)
    assert expected - 5.0 < score.value < expected + 1.0


def test_the_common_class_is_not_named_for_being_common():
    rng = np.random.default_rng(4)
    n = 20_000
    truth = (rng.random(n) < 0.1).astype(int)
    power = 10.0 ** (0.1 * rng.normal(0, 1, (n, 1)))
    counts = np.eye(2, dtype=np.int32)[truth]
    assert score_pixels(power, counts, np.arange(n) // 50, seed=1, run_id=1).value < 80.0


def test_every_cell_of_a_mixed_pixel_counts():
    power, counts, tile = two_classes(12.0)
    counts *= 2
    counts[:, 0] += 1
    truth = (counts[:, 1] > 0).astype(int)
    # Class 1 pixels hold one cell of class 0: a seventh of their cells cannot be right.
    score = score_pixels(power, counts, tile, seed=1, run_id=1)
    expected = 100.0 * (7 * (truth == 0).sum() + 6 * (truth == 1).sum()) / counts.sum()
    assert score.value == pytest.approx(expected, abs=0.05)
    assert score.confusion[0, 1] == (truth == 1).sum()
    assert score.confusion.sum() == score.n_cells


def test_a_class_missing_from_the_teaching_half_is_never_named():
    power, counts, tile = two_classes(5.0, n=4000)
    three = np.zeros((4000, 3), dtype=np.int32)
    three[:, :2] = counts
    three[tile == 7] = [0, 0, 3]
    score = score_pixels(power, three, tile, seed=1, run_id=1)
    assert score.confusion[2, 2] == 0
    assert score.details["per_class_percent"]["2"] == 0.0
    none = score_pixels(power[:100], three[:100], tile[:100], seed=1, run_id=1)
    assert math.isnan(none.se)
    assert none.value > 95.0  # a single tile teaches itself: there is no other ground
    with pytest.raises(SceneError, match="no scored cell"):
        score_pixels(power, np.zeros_like(three), tile, seed=1, run_id=1)


def test_a_class_of_few_pixels_and_constant_power_keeps_a_usable_covariance():
    rng = np.random.default_rng(5)
    power = np.ones((400, 3))
    power[:200] = 10.0 ** (0.1 * rng.normal(0, 1, (200, 3)))
    counts = np.zeros((400, 2), dtype=np.int32)
    counts[:200, 0] = 1
    counts[200:, 1] = 1
    score = score_pixels(power, counts, np.arange(400) % 8, seed=1, run_id=1)
    assert 75.0 < score.value <= 100.0


def test_zero_power_is_the_darkest_and_makes_no_warning():
    power, counts, tile = two_classes(6.0, n=2000)
    power[counts[:, 0] > 0] = 0.0
    assert score_pixels(power, counts, tile, seed=1, run_id=1).value > 97.0
    assert score_pixels(np.zeros_like(power), counts, tile, seed=1, run_id=1).value < 60.0


def test_the_split_is_the_runs_own_and_repeats():
    arguments = two_classes(1.0, n=3000)
    a, b, c = (score_pixels(*arguments, seed=1, run_id=k) for k in (1, 1, 2))
    assert a.value == b.value
    assert a.value != c.value


def test_cluster_error_is_that_of_repeated_samples():
    shares = np.array([0.5, 0.7, 0.65, 0.9])  # of clusters of one size: their own scatter
    assert cluster_ratio(20 * shares, np.full(4, 20)) == pytest.approx((shares.mean(), shares.std(ddof=1) / 2.0))
    # Tiles of unequal size whose share varies: the binomial error would be five times too small.
    rng = np.random.default_rng(6)
    shares, errors, naive = [], [], []
    for _ in range(800):
        size = rng.integers(20, 60, 80)
        p = np.clip(rng.normal(0.6, 0.15, 80), 0, 1)
        share, se = cluster_ratio(rng.binomial(size, p), size)
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
    field = np.array([[4, 4, 5], [6, 6, 5]], dtype=np.int32)
    scene = SimpleNamespace(cover=cover, scored=scored, field_id=field, categories=("a", "b"))
    counts, of_pixel, main = cells_in_pixels(pixel, scene, 4)
    np.testing.assert_array_equal(counts, [[1, 1], [0, 1], [0, 0], [0, 0]])
    np.testing.assert_array_equal(of_pixel, [4, 5, -1, -1])
    # Cells of two fields in a pixel, though of one class.
    field[0, 1] = 7
    assert cells_in_pixels(pixel, scene, 2)[1].tolist() == [-2, 5]
    assert main.tolist() == [4, 5, -1, -1]


def test_the_main_field_of_a_pixel_is_that_of_more_than_half_of_its_cells():
    rng = np.random.default_rng(8)
    pixel = rng.integers(-1, 400, (80, 90)).astype(np.int32)
    field = np.where(rng.random((80, 90)) < 0.55, pixel % 7, rng.integers(0, 7, (80, 90))).astype(np.int32)
    cover, scored = np.zeros((80, 90), dtype=np.uint8), rng.random((80, 90)) < 0.9
    scene = SimpleNamespace(cover=cover, scored=scored, field_id=field, categories=("a",))
    _, _, main = cells_in_pixels(pixel, scene, 400)
    told = 0
    for k in range(400):
        count = np.bincount(field[(pixel == k) & scored], minlength=7)
        assert count[main[k]] > 0
        if 2 * count.max() > count.sum():
            assert main[k] == np.argmax(count)
            told += 1
    assert 200 < told < 400


def mixed_pixels(n=3000, n_channels=2, n_classes=5, covariates=0, rare=False):
    """Pixels of nine cells, one in four of which holds two classes; some without any scored cell."""
    rng = np.random.default_rng(0)
    own = rng.integers(0, n_classes, n)
    if rare:
        own = np.where(rng.random(n) < 0.002, n_classes - 1, own % (n_classes - 1))
    other, part = rng.integers(0, n_classes, n), np.where(rng.random(n) < 0.25, rng.integers(1, 9, n), 9)
    centre = rng.normal(-10.0, 4.0, (n_channels, n_classes))
    features = (part * centre[:, own] + (9 - part) * centre[:, other]) / 9.0 + rng.normal(0.0, 2.0, (n_channels, n))
    known = rng.uniform(0.0, 1.0, (covariates, n)) * 10.0 ** -np.arange(covariates)[:, None]
    counts = np.zeros((n, n_classes), dtype=np.int32)
    np.add.at(counts, (np.arange(n), own), part)
    np.add.at(counts, (np.arange(n), other), 9 - part)
    counts[rng.random(n) < 0.05] = 0
    return np.vstack([known, features + 3.0 * known.sum(axis=0)]), counts, rng.integers(0, 60, n), rng.random(60)


def cells_named(features, counts, tile, keys, covariates):
    """Confusion by the laws of scipy, class by class, half by half: what the compiled classifier must give."""
    used = counts.any(axis=1)
    x, cells, half = features[:, used].T, counts[used], halves(keys)[tile[used]]
    d, confusion = x.shape[1], np.zeros((counts.shape[1], counts.shape[1]), dtype=np.int64)
    for tested in (0, 1):
        taught = np.flatnonzero(half != tested)
        weights = np.where(cells[taught] >= 0.8 * cells[taught].sum(axis=1, keepdims=True), cells[taught], 0.0)
        few = weights.sum(axis=0) ** 2 < 10.0 * (weights**2).sum(axis=0)
        weights[:, few | (weights.sum(axis=0) == 0.0)] = cells[taught][:, few | (weights.sum(axis=0) == 0.0)]
        total, known = weights.sum(axis=0), np.flatnonzero(weights.any(axis=0))
        mean = {k: np.average(x[taught], axis=0, weights=weights[:, k]) for k in known}
        own = {k: np.cov(x[taught].T, aweights=weights[:, k], ddof=0).reshape(d, d) for k in known}
        test, likely = x[half == tested], np.full((int((half == tested).sum()), len(total)), -np.inf)
        # One slope for all classes: least squares over what lies within them.
        weight = np.sqrt(np.concatenate([weights[:, k] for k in known]))[:, None]
        within = weight * np.concatenate([x[taught] - mean[k] for k in known])
        slopes = np.linalg.lstsq(within[:, :covariates], within[:, covariates:], rcond=None)[0]
        straight = np.hstack([-slopes.T, np.eye(d - covariates)])
        own = {k: straight @ own[k] @ straight.T for k in known}
        pooled = sum(total[k] * own[k] for k in known) / total.sum() + 1e-6 * np.eye(d - covariates)
        for k in known:
            n, prior = total[k] ** 2 / (weights[:, k] ** 2).sum(), 2.0 * (d - covariates + 1)
            law = multivariate_normal(straight @ mean[k], (n * own[k] + prior * pooled) / (n + prior))
            likely[:, k] = law.logpdf(test @ straight.T)
        named = likely.argmax(axis=1)
        np.add.at(confusion.T, named, cells[half == tested])
    return confusion


@pytest.mark.parametrize("rare", [False, True])
@pytest.mark.parametrize(("n_channels", "covariates"), [(1, 0), (2, 0), (3, 1), (2, 2)])
def test_every_cell_is_named_as_by_the_laws_of_scipy(n_channels, covariates, rare):
    features, counts, tile, keys = mixed_pixels(n_channels=n_channels, covariates=covariates, rare=rare)
    blind = np.where(counts.any(axis=1), features, np.nan)  # what lies in pixels without cells does not matter
    found = of_evidence(blind, counts, tile, keys, covariates)
    wanted = cells_named(features, counts, tile, keys, covariates)
    np.testing.assert_array_equal(found.confusion, wanted)
    assert found.value == pytest.approx(100.0 * np.trace(wanted) / wanted.sum(), rel=1e-12)
    assert 30.0 < found.value < 99.0
    # Of features that hardly scatter what is added to every variance counts.
    small = np.vstack([features[:covariates], 1e-3 * features[covariates:]])
    wanted = cells_named(small, counts, tile, keys, covariates)
    np.testing.assert_array_equal(of_evidence(small, counts, tile, keys, covariates).confusion, wanted)


def test_halves_are_cut_among_the_tiles_that_hold_cells():
    features, counts, tile, keys = mixed_pixels()
    empty = np.isin(tile, np.argsort(keys)[:20])
    counts[empty] = 0
    found = of_evidence(features, counts, tile, keys)
    kept = np.flatnonzero(~np.isin(np.arange(60), np.argsort(keys)[:20]))
    renumbered = np.full(60, -1)
    renumbered[kept] = np.arange(40)
    again = of_evidence(features[:, ~empty], counts[~empty], renumbered[tile[~empty]], keys[kept])
    assert found.n_clusters == again.n_clusters == 40
    assert (found.value, found.se) == (again.value, again.se)


def test_tiles_of_rows_and_columns_are_those_of_their_pixels():
    across, along = np.arange(7)[:, None] * 100.0, (np.arange(9) + 0.5) * 130.0
    key = {"extent_m": (600.0, 1105.0), "side_m": 250.0}
    tile, n_tiles = tiles(across, along, **key)
    spread = [x.ravel() for x in np.broadcast_arrays(across, along)]
    assert np.array_equal(tiles(*spread, **key)[0], tile)
    assert n_tiles == 3 * 5
    assert np.array_equal(tile, (spread[0] // 250).astype(int) * 5 + (spread[1] // 250).astype(int))


def test_zeros_take_the_least_power_among_the_pixels_with_cells():
    """In decibels, channel by channel; a pixel without cells does not set the floor."""
    power = np.array([[1.0, 0.0, 10.0, 1e-9], [100.0, 1000.0, 0.0, 1e-9]])
    counts = np.array([[1, 0], [0, 2], [3, 0], [0, 0]])
    every = decibels(power.copy())
    np.testing.assert_allclose(every, [[0.0, -90.0, 10.0, -90.0], [20.0, 30.0, -90.0, -90.0]])
    found = decibels(power, counts)
    np.testing.assert_allclose(found, [[0.0, 0.0, 10.0, 0.0], [20.0, 30.0, 20.0, 20.0]])
    np.testing.assert_allclose(decibels(np.array([[0.01, 10.0]]), counts[:2]), [[-20.0, 10.0]])


def test_a_small_field_belongs_to_the_tile_of_its_first_pixel_and_a_large_one_is_a_tile_but_for_one_divided() -> None:
    rng = np.random.default_rng(6)
    field, tile = rng.integers(-2, 30, 2000).astype(np.int32), rng.integers(0, 9, 2000)
    large = np.where(rng.random(30) < 0.7, 0, -1)
    large[[4, 9, 17]] = 1, 2, 3
    wanted, first = tile.copy(), {4: 9, 9: 10, 17: 11}
    for n, f in enumerate(field.tolist()):
        if f >= 0 and large[f] >= 0:
            wanted[n] = first.setdefault(f, tile[n])
    _keep_fields_whole(field, large, tile, 9)
    np.testing.assert_array_equal(tile, wanted)
    assert len(first) > 10


def test_tiles_of_a_group_are_shared_between_the_halves() -> None:
    rng = np.random.default_rng(2)
    group = np.repeat([0.0, 1.0, 4.0, 7.0], [11, 2, 5, 1])
    first = []
    for _ in range(200):
        half = halves(group + rng.random(19))
        assert [int(half[group == one].sum()) for one in (0.0, 1.0, 4.0, 7.0)] == [5, 1, 2, 0]
        first.append(half[group == 1.0][0])
    assert 0.4 < np.mean(first) < 0.6
