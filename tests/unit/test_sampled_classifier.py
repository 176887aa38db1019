"""The compiled classifier of samples against the array code that scores whole images: the same cells, named alike."""

from types import SimpleNamespace

import numpy as np
import pytest

from seqrsm.score import sampled
from seqrsm.score.classification import decibels, halves, score_pixels, systematic_se, tiles


def sample(n=3000, n_channels=2, n_classes=5, draws=1, covariates=False, rare=False, seed=0):
    """Pixels of one cell in four of which hold two classes, some without any scored cell, some not seen."""
    rng = np.random.default_rng(seed)
    own = rng.integers(0, n_classes, n)
    if rare:
        own = np.where(rng.random(n) < 0.002, n_classes - 1, own % (n_classes - 1))
    other = rng.integers(0, n_classes, n)
    part = np.where(rng.random(n) < 0.25, rng.integers(1, 9, n), 9)
    db = rng.normal(-10.0, 4.0, (n_channels, n_classes))
    mean = (part * db[:, own] + (9 - part) * db[:, other]) / 9.0
    power = 10.0 ** (0.1 * (mean + rng.normal(0.0, 2.0, (draws, n_channels, n))))
    power[:, :, rng.random(n) < 0.02] = np.nan
    pixel = np.repeat(np.arange(n, dtype=np.int32)[:, None], 9, axis=1)
    cover = np.where(np.arange(9) < part[:, None], own[:, None], other[:, None]).astype(np.uint8)
    return SimpleNamespace(
        values=power,
        across_m=rng.uniform(0.0, 3999.0, n),
        along_m=rng.uniform(0.0, 2999.0, n),
        extent_m=(3999.0, 2999.0),
        column=rng.integers(0, 40, n),
        share=0.2,
        pixel_of_cell=pixel,
        cover=cover,
        scored=np.repeat(rng.random((n, 1)) > 0.05, 9, axis=1),
        covariates=rng.uniform(0.0, 1.0, (n, 1)) if covariates else None,
    )


def by_arrays(sample, n_classes, linear):
    """The same score by the code of whole images, which takes each draw as a pixel of its own."""
    draws, n_channels, n = sample.values.shape
    counts = np.zeros((n, n_classes), dtype=np.int64)
    np.add.at(counts, (sample.pixel_of_cell[sample.scored], sample.cover[sample.scored]), 1)
    used = np.flatnonzero(counts.any(axis=1) & np.isfinite(sample.values[0]).all(axis=0))
    tile, keys = tiles(sample.across_m[used], sample.along_m[used], sample.extent_m, 250.0, seed=1, run_id=2)
    return score_pixels(
        sample.values[:, :, used].transpose(0, 2, 1).reshape(draws * used.size, n_channels),
        np.tile(counts[used], (draws, 1)),
        np.tile(tile, draws),
        seed=1,
        run_id=2,
        scale="linear" if linear else "decibel",
        covariates=None if sample.covariates is None else np.tile(sample.covariates[used], (draws, 1)),
        tile_keys=keys,
    )


@pytest.mark.parametrize("rare", [False, True])
@pytest.mark.parametrize(("n_channels", "draws", "covariates"), [(1, 1, False), (2, 3, False), (3, 2, True)])
def test_cells_are_named_as_the_array_code_names_them(n_channels, draws, covariates, rare):
    made = sample(n_channels=n_channels, draws=draws, covariates=covariates, rare=rare)
    # As few pixels stand for five times as many, classes are taught by fewer; here each stands for itself.
    made.share = 1.0 / draws
    scene = SimpleNamespace(categories=tuple("abcde"))
    found = sampled._percent_correct(made, scene, 250.0, linear=covariates, seed=1, run_id=2)
    true = by_arrays(made, 5, linear=covariates)
    assert found.value == true.value
    assert found.se == pytest.approx(true.se, rel=1e-12)
    assert np.array_equal(found.confusion, true.confusion)
    assert found.n_cells * draws == true.n_cells
    assert found.n_clusters == true.n_clusters
    assert list(found.details["per_class_percent"].values()) == list(true.details["per_class_percent"].values())
    assert 30.0 < found.value < 99.0


def test_the_standard_error_of_the_columns_counts_every_draw_of_a_pixel_once():
    made = sample(draws=2)
    made.column = np.argsort(np.argsort(made.along_m)) // 100
    once, twice = (SimpleNamespace(**{**made.__dict__, "values": made.values[[0] * draws]}) for draws in (1, 2))
    scene = SimpleNamespace(categories=tuple("abcde"))
    one, two = (sampled._percent_correct(x, scene, 250.0, linear=False, seed=1, run_id=2) for x in (once, twice))
    assert two.details["sampling_se"] == pytest.approx(one.details["sampling_se"], rel=0.05)


def test_a_sample_whose_powers_are_zero_somewhere_is_scored():
    made = sample()
    made.values[0, 0, ::7] = 0.0
    scene = SimpleNamespace(categories=tuple("abcde"))
    made.share = 1.0
    found = sampled._percent_correct(made, scene, 250.0, linear=False, seed=1, run_id=2)
    assert found.value == by_arrays(made, 5, linear=False).value


def test_a_sample_that_misses_the_narrow_tiles_at_the_edge_is_split_as_the_whole_image():
    """Halves are cut at the middle key: with a line of tiles passed over, whole tiles changed sides."""
    n, extent = 101, (2010.0, 2010.0)
    across, along = (x.ravel() for x in np.meshgrid(*2 * [np.linspace(0.0, 2010.0, n)], indexing="ij"))
    key = {"tile_m": 250.0, "seed": 1, "run_id": 2}
    whole, keys = tiles(across, along, extent, **key)
    some = np.flatnonzero((np.arange(n * n) % n % 4 == 1) & (np.arange(n * n) // n % 4 == 1))
    assert len(np.unique(whole)) == 81
    assert along[some].max() < 2000.0
    tile, own = tiles(across[some], along[some], extent, **key, sample=True)
    assert np.array_equal(halves(own)[tile], halves(keys)[whole][some])
    short, few = tiles(across[some], along[some], extent, **key)
    assert not np.array_equal(halves(few)[short], halves(keys)[whole][some])


def test_both_halves_of_a_small_sample_keep_pixels():
    across = np.arange(8) * 100.0 + 50.0
    for run in range(30):
        tile, keys = tiles(across, np.zeros(8), (1010.0, 10.0), 250.0, seed=1, run_id=run, sample=True)
        assert set(halves(keys)[tile]) == {0, 1}


def test_systematic_error_of_groups_that_agree_is_zero():
    assert systematic_se(np.full(20, 3.0), np.full(20, 6.0), np.arange(20) // 4) == 0.0


def test_zeros_take_the_least_power_among_the_pixels_asked_for() -> None:
    """In decibels, channel by channel; a pixel left out does not set the floor."""
    power = np.array([[[1.0, 0.0, 10.0, 1e-9], [100.0, 1000.0, 0.0, 1e-9]]])
    found = decibels(power, (0, 2), np.array([0, 1, 2]))
    np.testing.assert_allclose(found[0], [[0.0, 0.0, 10.0, 0.0], [20.0, 30.0, 20.0, 20.0]])
    np.testing.assert_allclose(decibels(power, (0, 2))[0], [[0.0, -90.0, 10.0, -90.0], [20.0, 30.0, -90.0, -90.0]])
    np.testing.assert_allclose(decibels(power[0].T), decibels(power, (0, 2))[0].T)
    np.testing.assert_allclose(decibels(np.array([[0.01], [10.0]])), [[-20.0], [10.0]])
