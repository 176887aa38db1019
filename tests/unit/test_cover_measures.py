"""Measures of mapping against scikit-learn; fields, neighbourhoods and false alarms as they are said to be."""

from __future__ import annotations

import math
from dataclasses import replace
from unittest import mock

import numpy as np
import pytest
from scipy import ndimage
from scipy.stats import loggamma, norm
from shorthands import percent_correct, tiles_of
from sklearn import metrics
from synthetic import synthetic_scene

from seqrsm.errors import SceneError
from seqrsm.scattering.sigma0 import load_sigma0_table
from seqrsm.scene.scene import Scene
from seqrsm.score.classification import areas_taught, halves, knowing_areas, taught
from seqrsm.score.cover import FALSE_ALARMS, ends_of, measure, score_cover, score_evidence
from seqrsm.score.evidence import WINDOW, Evidence, _lee, _of_segments, evidence_of, in_one_field, layers_of
from seqrsm.score.pixels import fields_of, large_fields, pixels_of
from seqrsm.score.utilities import Asked, asked_for
from seqrsm.sensor.radar import from_settings
from seqrsm.simulate.radar.psm import simulate_radar

KEY = {"seed": 3, "run_id": 1}


def fields(side: int = 8, n: int = 160, cell_m: float = 10.0) -> Scene:
    """Square fields of four covers, `side` cells wide."""
    rng = np.random.default_rng(5)
    kinds = rng.integers(0, 4, (n // side, n // side))
    field = np.kron(np.arange(kinds.size).reshape(kinds.shape), np.ones((side, side), dtype=int)).astype(np.int32)
    flat = synthetic_scene(n, n, cell_m, categories=("Wheat",), relief_m=0.0)
    cover = np.kron(kinds, np.ones((side, side), dtype=int)).astype(np.uint8)
    return replace(flat, cover=cover, field_id=field, categories=("Wheat", "Corn", "Grass", "Vegetables"))


def image(scene: Scene, resolution: float = 20.0, frequency: float = 1.25, run_id: int = 1, **fixed: float):
    radar = from_settings(
        {"frequency": frequency, "polarization": "HH+HV", "resolution": resolution, "depression_angle": 45.0},
        {"bandwidth": 80.0, "peak_power": 300.0, "altitude_m": 6000.0, **fixed},
    )
    return simulate_radar(scene, radar, load_sigma0_table(), seed=3, run_id=run_id)


SCENE = fields()
IMAGE = image(SCENE)


def names_and_truth(n: int = 3000, classes: int = 4):
    rng = np.random.default_rng(2)
    truth = rng.choice(classes, n, p=[0.5, 0.3, 0.15, 0.05])
    named = np.where(rng.random(n) < 0.7, truth, rng.integers(0, classes, n))
    confusion = np.zeros((classes, classes), dtype=np.int64)
    np.add.at(confusion, (truth, named), 1)
    return truth, named, confusion


def test_measures_are_those_of_scikit_learn() -> None:
    truth, named, confusion = names_and_truth()
    wanted = {
        "percent_correct": 100.0 * metrics.accuracy_score(truth, named),
        "class_mean_correct": 100.0 * metrics.balanced_accuracy_score(truth, named),
        "worst_class_correct": 100.0 * metrics.recall_score(truth, named, average=None).min(),
        "kappa": metrics.cohen_kappa_score(truth, named),
    }
    for name, value in wanted.items():
        assert float(measure(confusion, name)) == pytest.approx(value, rel=1e-12), name
    each = metrics.f1_score(truth, named, average=None)
    assert float(measure(confusion, "f1", [1])) == pytest.approx(100.0 * each[1], rel=1e-12)
    assert float(measure(confusion, "f1", [1, 3])) == pytest.approx(100.0 * each[[1, 3]].mean(), rel=1e-12)
    for covers in ([2], [1, 2]):
        area, true = np.isin(named, covers).sum(), np.isin(truth, covers).sum()
        assert float(measure(confusion, "area_error", covers)) == pytest.approx(100.0 * abs(area - true) / true)
    both = np.isin(truth, [0, 3])
    found = 100.0 * np.isin(named[both], [0, 3]).mean()
    assert float(measure(confusion, "detection", [0, 3])) == pytest.approx(found, rel=1e-12)
    # A stack of matrices is measured one by one.
    np.testing.assert_allclose(measure(np.stack([confusion, 2 * confusion]), "kappa"), wanted["kappa"])


@pytest.mark.parametrize(
    ("name", "covers"),
    [("percent_correct", []), ("class_mean_correct", []), ("worst_class_correct", []), ("kappa", []), ("f1", [1]),
     ("f1", [1, 3])],
)  # fmt: skip
def test_a_guess_scores_the_floor_and_the_truth_the_ceiling(name: str, covers: list[int]) -> None:
    truth, _, _ = names_and_truth()
    true = np.bincount(truth, minlength=4)
    floor, ceiling = ends_of(true, name, covers)
    guesses = []
    for k in range(4):
        confusion = np.zeros((4, 4))
        confusion[:, k] = true
        guesses.append(float(measure(confusion, name, covers)))
    assert floor == pytest.approx(max(guesses))
    assert ceiling == pytest.approx(float(measure(np.diag(true), name, covers)))


def test_standard_errors_of_other_measures_are_those_of_repeated_ground() -> None:
    rng = np.random.default_rng(1)
    values, errors = [], []
    for _ in range(200):
        n, tiles = 1200, 60
        skill = np.clip(rng.normal(0.7, 0.15, tiles), 0.0, 1.0)
        tile, truth = np.arange(n) % tiles, rng.integers(0, 3, n)
        named = np.where(rng.random(n) < skill[tile], truth, (truth + 1) % 3)
        by_tile = np.zeros((tiles, 3, 3), dtype=np.int64)
        np.add.at(by_tile, (tile, truth, named), 1)
        from seqrsm.score.cover import _jackknife

        values.append(float(measure(by_tile.sum(axis=0), "kappa")))
        errors.append(_jackknife(by_tile, "kappa", []))
    assert np.mean(errors) == pytest.approx(np.std(values, ddof=1), rel=0.15)


def test_no_field_is_both_taught_and_tested() -> None:
    """A field's inner pixels lie in one tile, though tiles cut through fields by their centres."""
    with tiles_of(130.0):
        pixels = pixels_of([IMAGE], SCENE, **KEY)
    inside = pixels.field >= 0
    for field in np.unique(pixels.field[inside]):
        assert len(np.unique(pixels.tile[pixels.field == field])) == 1
    # Nor are the pixels that lie in it for the most part: at 23 m one of four lies in several fields.
    with tiles_of(130.0):
        pixels = pixels_of([image(SCENE, 23.0)], SCENE, **KEY)
    cells = np.zeros((len(pixels.field), SCENE.n_fields), dtype=int)
    seen = pixels.pixel >= 0
    np.add.at(cells, (pixels.pixel[seen], SCENE.field_id[seen]), 1)
    most = 2 * cells.max(axis=1) > cells.sum(axis=1)
    assert np.count_nonzero(most & (pixels.field == -2)) > 600
    for field in range(SCENE.n_fields):
        assert len(np.unique(pixels.tile[most & (np.argmax(cells, axis=1) == field)])) <= 1
    # A field larger than a tile that is most of its cover's ground is in many tiles.
    one = replace(SCENE, cover=np.zeros_like(SCENE.cover), field_id=np.zeros_like(SCENE.field_id))
    with tiles_of(130.0):
        assert len(np.unique(pixels_of([image(one)], one, **KEY).tile)) > 50


@pytest.mark.parametrize("kind", [np.int32, np.int64])
def test_ground_within_reach_is_one_fields_where_a_window_holds_no_other(kind: type) -> None:
    rng = np.random.default_rng(4)
    field = np.kron(rng.integers(0, 5, (5, 6)), np.ones((4, 4), dtype=int)).astype(kind)
    field[rng.random(field.shape) < 0.1] = -1
    field[rng.random(field.shape) < 0.03] = -2
    for reach in (0, 1, 2):
        padded = np.pad(field, reach, "symmetric")
        windows = np.lib.stride_tricks.sliding_window_view(padded, (2 * reach + 1, 2 * reach + 1))
        wanted = [set(one.ravel().tolist()) - {-1} for one in windows.reshape(-1, *windows.shape[2:])]
        expected = np.array([len(one) == 1 and -2 not in one for one in wanted]).reshape(field.shape)
        np.testing.assert_array_equal(in_one_field(field, reach), expected)


def test_a_scene_smaller_than_a_tile_is_not_taught_what_it_is_tested_on() -> None:
    """Fields of one cover that go by four names: a quarter is right by chance. Taught on itself it had 47 %."""
    scene, scores = fields(side=16, n=96, cell_m=2.5), []
    one = replace(scene, cover=np.zeros_like(scene.cover))
    for run in range(12):
        names = np.random.default_rng(run).permutation(np.arange(36) % 4).astype(np.uint8)
        named = replace(scene, cover=names[scene.field_id])
        key = {"seed": 3, "run_id": run}
        scores.append(percent_correct([image(one, 10.0, run_id=run)], named, by="field", **key).value)
    assert np.mean(scores) < 33.0


@pytest.mark.parametrize("by", ["pixel", "segment", "field"])
def test_large_fields_are_not_taught_what_they_are_tested_on(by: str) -> None:
    """Fields of 9 ha of one cover that go by four names, a quarter is right by chance: divided, 43 to 47 % were."""
    scene, scores = fields(side=30, n=240), []
    one = replace(scene, cover=np.zeros_like(scene.cover))
    for run in range(12):
        names = np.random.default_rng(run).permutation(np.arange(64) % 4).astype(np.uint8)
        named = replace(scene, cover=names[scene.field_id])
        found = percent_correct([image(one, run_id=run)], named, by=by, seed=3, run_id=run)
        assert found.confusion.sum(axis=0).all()  # no cover is missing from what taught
        scores.append(found.value)
    assert np.mean(scores) < 31.0


def test_a_field_is_large_by_its_cells_and_most_of_its_cover_by_those_that_are_scored() -> None:
    scene = fields(side=40, n=160)
    scene = replace(scene, cover=np.array([0, 0, 0, 1, *[2] * 12], dtype=np.uint8)[scene.field_id])
    masked = replace(scene, scored=~np.isin(scene.field_id, (1, 2)) | (np.indices(scene.shape)[1] % 8 < 3))
    for ground, first in ((scene, 1), (masked, -1)):
        found = large_fields(ground, 250.0)
        assert found[0] == first
        assert found[3] == -1
        np.testing.assert_array_equal(np.sort(found[found > 0]), np.arange(1, (found > 0).sum() + 1))
    assert large_fields(scene, 399.0).all()
    assert not large_fields(scene, 400.0).any()
    # As units of ground they keep the tiles that they are, though a pixel at their edge is another's.
    pixels = pixels_of([image(scene, 37.0)], scene, **KEY)
    large, whole = large_fields(scene, 250.0), len(pixels.keys) - 16
    unit, _, tile = fields_of(pixels, scene)
    for field in np.flatnonzero(large > 0):
        (own,) = np.unique(unit[(scene.field_id == field) & (unit >= 0)])
        assert tile[own] == whole + large[field]


def test_a_field_is_large_by_all_its_ground_and_most_of_its_cover_by_what_is_scored() -> None:
    """Where a tile holds 4 of 8 cells of the first field, of which 3 are scored, as all 8 of the second's are."""
    field, cover = np.repeat([0, 1], 8).astype(np.int32).reshape(2, 8), np.zeros((2, 8), np.uint8)
    base = synthetic_scene(2, 8, 10.0, categories=("Wheat",))
    ground = replace(base, field_id=field, cover=cover, scored=np.arange(16).reshape(2, 8) >= 5)
    assert large_fields(ground, 20.0).tolist() == [1, -1]
    assert not large_fields(ground, 30.0).any()


def test_covers_of_two_large_fields_have_one_in_each_half() -> None:
    """And a cover of one is in both."""
    scene = fields(side=40, n=160)
    few = replace(
        scene, cover=np.array([1, 1, 0, 0, 2, 2, 2, 2, 2, 3, 2, 2, 1, 1, 2, 2], dtype=np.uint8)[scene.field_id]
    )
    lone = replace(few, field_id=np.where(few.cover == 0, 2, few.field_id).astype(np.int32))
    for ground, in_one in ((few, True), (lone, False)):
        pixels = pixels_of([image(ground)], ground, seed=3, run_id=1)
        for run in range(24):
            keys = pixels_of([image(ground)], ground, seed=3, run_id=run).keys
            keys[pixels.seen] = halves(keys[pixels.seen])
            half = keys[pixels.tile]
            for cover in range(4):
                assert len(np.unique(half[(pixels.counts[:, cover] > 0) & (pixels.field >= 0)])) == 2
            assert (len(np.unique(half[pixels.field == 2])) == 1) == in_one


def test_an_image_has_the_tiles_of_the_side_that_is_asked_for() -> None:
    """What lies in its pixels is kept from one look to the next, also when another utility asks for larger tiles."""
    found = []
    for side in (130.0, 390.0, 130.0):
        with tiles_of(side):
            found.append(pixels_of([IMAGE], SCENE, **KEY).tile)
    fine, coarse, again = found
    assert len(np.unique(fine)) > 3 * len(np.unique(coarse))
    np.testing.assert_array_equal(again, fine)


@pytest.mark.parametrize("name", ["percent_correct", "kappa", "worst_class_correct"])
def test_an_image_of_one_cover_is_refused(name: str) -> None:
    """A narrow swath over it scored 100 %, or nan."""
    rows, _ = np.nonzero(SCENE.cover == 2)
    one = replace(SCENE, scored=(SCENE.cover == 2) & (np.arange(160)[:, None] < rows.mean()))
    with pytest.raises(SceneError, match="all scored ground in the image is Grass"):
        score_cover([image(one)], one, Asked(name), **KEY)


@pytest.mark.parametrize("by", ["pixel", "neighbourhood", "segment"])
def test_tiles_that_hold_scored_cells_are_those_of_units_with_counts(by: str) -> None:
    unscored = replace(SCENE, scored=SCENE.scored & (np.arange(SCENE.shape[1]) < SCENE.shape[1] // 3))
    found = evidence_of([image(unscored, 12.0)], unscored, by=by, **KEY)
    assert found.counts.dtype == found.teaching.dtype == np.int32  # of one type, or kernels are compiled for each
    assert found.seen is not None
    assert np.flatnonzero(found.seen).tolist() == sorted(set(found.tile[found.counts.any(axis=1)].tolist()))
    assert not found.seen.all()


def test_evidence_of_a_field_is_the_mean_over_the_pixels_inside_it() -> None:
    pixels = pixels_of([IMAGE], SCENE, **KEY)
    found = evidence_of([IMAGE], SCENE, by="field", **KEY)
    power = IMAGE.apparent_sigma0().reshape(2, -1)
    fields_seen = np.unique(SCENE.field_id[pixels.pixel >= 0])
    assert found.features.shape == (2, len(fields_seen))
    for place, field in enumerate(fields_seen[::17]):
        mine = (SCENE.field_id == field) & (pixels.pixel >= 0)
        where = pixels.pixel[mine]
        inner = where[pixels.field[where] == field]
        mean = power[:, inner if inner.size else where].mean(axis=1)
        np.testing.assert_allclose(found.features[:, 17 * place], 10.0 * np.log10(mean), rtol=1e-6)
        assert found.counts[17 * place].sum() == mine.sum()


def test_cells_of_a_field_are_its_own_and_a_field_that_is_most_of_its_cover_is_one_in_each_tile() -> None:
    side, wide = 130.0, np.arange(160) >= 80
    field = np.where(wide, SCENE.n_fields, SCENE.field_id).astype(np.int32)
    scene = replace(SCENE, field_id=field, cover=np.where(wide, 2, SCENE.cover).astype(np.uint8),
                    scored=np.random.default_rng(1).random(field.shape) < 0.7)  # fmt: skip
    with tiles_of(side):
        pixels = pixels_of([image(scene)], scene, **KEY)
    unit, counts, tile = fields_of(pixels, scene)
    used = (pixels.pixel >= 0) & scene.scored
    np.testing.assert_array_equal(unit >= 0, used)
    own, its_tile = field[used], pixels.tile[pixels.pixel[used]]
    large = own == SCENE.n_fields
    pieces = set(zip(own.tolist(), np.where(large, its_tile, -1).tolist(), strict=True))
    assert len(pieces) == len(counts) > len(np.unique(own)) + 20
    for place in np.unique(unit[used])[::7]:
        mine = unit[used] == place
        wanted = np.bincount(scene.cover[used][mine], minlength=4)
        assert len(np.unique(own[mine])) == np.count_nonzero(wanted) == 1
        np.testing.assert_array_equal(counts[place], wanted)
        assert (its_tile[mine & large] == tile[place]).all()


def test_fields_that_hold_no_pixel_do_not_teach_but_are_tested() -> None:
    """Small fields among large ones: their mixed pixels count in the score, not in the laws."""
    fine = np.kron(np.arange(6400).reshape(80, 80), np.ones((2, 2), dtype=int)) + SCENE.n_fields
    field = np.where(np.arange(160) < 120, SCENE.field_id, fine)
    _, number = np.unique(field, return_inverse=True)
    scene = replace(SCENE, field_id=number.reshape(field.shape).astype(np.int32))
    evidence = evidence_of([image(scene, 30.0)], scene, by="field", **KEY)
    cells = evidence.counts.sum(axis=1)
    assert (evidence.teaching[cells >= 40].sum(axis=1) > 0).all()
    assert (evidence.teaching[cells <= 4].sum(axis=1) > 0).mean() < 0.05  # pixels cut by the scene's edge
    assert (cells <= 4).sum() > 1000
    assert np.isfinite(evidence.features[:, cells > 0]).all()


def test_windows_help_pixels_and_fields_hardly_need_them() -> None:
    """Over the windows of a multilook: by pixel the score climbs and stays, by field it is high from the start."""
    scene = fields(side=16, n=192, cell_m=5.0)
    by_pixel, by_field = [], []
    for resolution in (5.0, 15.0, 35.0, 75.0):
        made = [image(scene, resolution, 1.25, run_id=k) for k in range(1, 5)]
        for found, by in ((by_pixel, "pixel"), (by_field, "field")):
            found.append(np.mean([percent_correct([one], scene, by=by, **KEY).value for one in made]))
    assert by_pixel[1] > by_pixel[0] + 1.5
    assert by_field[0] > max(by_field) - 2.0
    assert min(f - p for f, p in zip(by_field, by_pixel, strict=True)) > 1.0
    assert by_field[0] - by_pixel[0] > by_field[1] - by_pixel[1]
    # The best window of pixels is coarser than the least that fields need.
    assert int(np.argmax(np.array(by_field) > max(by_field) - 1.5)) < int(np.argmax(by_pixel))


def test_the_filter_keeps_edges_and_takes_noise() -> None:
    rng = np.random.default_rng(4)
    truth = np.where(np.arange(80) < 40, 0.0, 30.0)[:, None] + np.zeros((80, 60))
    noisy = truth + rng.normal(0.0, 1.0, truth.shape)
    smooth = _lee(noisy, np.array(1.0))
    flat = np.s_[10:30, 10:50]
    assert smooth[flat].std() < 0.3
    edge = smooth[39:41].mean(axis=1)
    assert edge[1] - edge[0] > 25.0
    # Where the variance is the noise's or less, it is the window's mean.
    np.testing.assert_allclose(_lee(noisy, np.array(1e9)), ndimage.uniform_filter(noisy, WINDOW), atol=1e-9)
    noisy[5, 5] = math.nan
    assert np.isnan(_lee(noisy, np.array(1.0))[5, 5])
    assert np.isfinite(_lee(noisy, np.array(1.0))).sum() == noisy.size - 1


def test_neighbours_are_filtered_in_decibels_with_the_noise_of_their_looks() -> None:
    db = 10.0 * np.log10(IMAGE.apparent_sigma0())
    # Decibels of a gamma variable: scipy's log-gamma law.
    noise = (10.0 / math.log(10.0)) ** 2 * loggamma(IMAGE.looks).var()[:, None] * np.ones(db.shape[1:])
    wanted = np.stack([_lee(layer, noise) for layer in db]).reshape(2, -1)
    np.testing.assert_allclose(10.0 * np.log10(layers_of(IMAGE, smooth=True)), wanted, rtol=1e-4)


def test_neighbours_help_where_speckle_is_strong() -> None:
    scene = fields(side=16, n=192, cell_m=5.0)
    made = image(scene, 5.0, 5.4)
    plain, smooth = (percent_correct([made], scene, by=by, **KEY).value for by in ("pixel", "neighbourhood"))
    assert smooth > plain + 3.0


def parcels_found(images, scene: Scene) -> tuple[float, Evidence, np.ndarray]:
    """Adjusted Rand index of the segments and the fields, over cells; what is known of the segments; each cell's."""
    with mock.patch("seqrsm.score.evidence._of_segments", wraps=_of_segments) as made:
        found = evidence_of(images, scene, by="segment", **KEY)
    _, pixels, _, segment = made.call_args.args
    unit = np.where(pixels.pixel >= 0, segment[pixels.pixel], -1)
    return metrics.adjusted_rand_score(scene.field_id[unit >= 0], unit[unit >= 0]), found, unit


def test_segments_are_the_parcels_where_these_differ() -> None:
    """Squares of covers that differ from all their neighbours; with little speckle the image shows the parcels."""
    kinds = (np.arange(12)[:, None] + 2 * np.arange(12)) % 4
    field = np.kron(np.arange(144).reshape(12, 12), np.ones((16, 16), dtype=int)).astype(np.int32)
    cover = np.kron(kinds, np.ones((16, 16), dtype=int)).astype(np.uint8)
    scene = replace(fields(side=16, n=192, cell_m=5.0), cover=cover, field_id=field)
    few = image(scene, 5.0, 1.25, texture_db=0.0)
    index, found, unit_of_cell = parcels_found([few], scene)
    assert index > 0.75  # 0.72 where neighbours are merged in the order of what speckle leaves alike
    many = replace(few, intensity=few.mean_power + few.noise_power_w[:, None], looks=np.full_like(few.looks, 1000.0))
    clear, *_ = parcels_found([many], scene)
    assert clear > 0.95
    # Two dates and another radar's coarser pixels tell more than one image.
    more = [few, image(scene, 5.0, 1.25, run_id=2, texture_db=0.0), image(scene, 10.0, 5.4, texture_db=0.0)]
    assert parcels_found(more, scene)[0] > index
    # All cells are in one segment each, whose evidence is the mean over its pixels; a segment lies in one tile.
    pixels = pixels_of([few], scene, **KEY)
    assert found.counts.sum() == pixels.counts.sum()
    place = int(found.counts.sum(axis=1).argmax())
    mine = np.unique(pixels.pixel[unit_of_cell == place])
    mean = few.apparent_sigma0().reshape(2, -1)[:, mine].mean(axis=1)
    np.testing.assert_allclose(found.features[:, place], 10.0 * np.log10(mean), rtol=1e-6)
    for unit in np.unique(unit_of_cell)[:50]:
        assert len(np.unique(pixels.tile[pixels.pixel[unit_of_cell == unit]])) == 1
    np.testing.assert_array_equal(found.features, parcels_found([few], scene)[1].features)


def test_even_ground_is_not_cut_by_the_noise_of_coarser_pixels() -> None:
    """Each tile is one segment: finer pixels have one value of a coarser image or cell, and its noise."""
    even = fields(side=16, n=192, cell_m=5.0)
    even = replace(even, cover=np.zeros_like(even.cover), field_id=np.zeros_like(even.field_id))
    fine, coarse = image(even, 5.0, 1.25, texture_db=0.0), image(even, 20.0, 5.4, texture_db=0.0)
    for images in ([fine, coarse], [image(even, 20.0, 5.4, texture_db=0.0, pixel_m=5.0)]):
        found = evidence_of(images, even, by="segment", **KEY)
        assert found.features.shape[1] == pytest.approx(len(np.unique(pixels_of(images[:1], even, **KEY).tile)), abs=2)


def test_segments_score_between_pixels_and_fields() -> None:
    scene = fields(side=16, n=192, cell_m=5.0)
    for frequency in (1.25, 5.4):
        units = ("pixel", "segment", "field")
        made = [image(scene, 5.0, frequency, run) for run in range(4)]
        each = [[percent_correct([one], scene, by=by, **KEY).value for by in units] for one in made]
        pixel, segment, field = np.mean(each, axis=0)
        assert pixel + 3.0 < segment < field


@pytest.mark.parametrize("distance", [0.5, 2.0, 4.0])
def test_detection_holds_its_false_alarms_and_finds_what_separates(distance: float) -> None:
    rng = np.random.default_rng(0)
    n = 20_000
    truth = (rng.random(n) < 0.2).astype(int)
    x = rng.normal(0.0, 1.0, n) + distance * truth
    kind = truth * (1 + np.arange(n) % 2)  # two covers that look alike
    counts = np.eye(3, dtype=int)[kind]
    evidence = Evidence(x[None], counts, np.arange(n) // 100, rng.random(n // 100), 0, counts)
    score = score_evidence(evidence, ("other", "one", "two"), Asked("detection", ("one", "two")))
    alarms = score.confusion[0, 1:].sum() / score.confusion[0].sum()
    assert alarms == pytest.approx(FALSE_ALARMS, abs=0.003)
    found = norm.cdf(distance - norm.isf(FALSE_ALARMS))  # of two normal laws so many standard deviations apart
    assert score.value == pytest.approx(100.0 * found, abs=250.0 * math.sqrt(found * (1.0 - found) / truth.sum()))
    assert (score.guess, score.perfect, score.n_cells) == (5.0, 100.0, n)
    right = np.diagonal(score.confusion) / np.bincount(kind)
    assert list(score.details["per_class_percent"].values()) == pytest.approx(100.0 * right)


@pytest.mark.parametrize("m", [0.1, 0.5, 1.0, 2.0])
def test_the_area_of_a_rare_cover_is_mapped_the_better_the_more_images_tell(m: float) -> None:
    """A tenth of the ground at -m, the rest at m, unit noise: all is named the common cover where nothing tells them.

    By equal priors 368 % too much was mapped at m = 0.1, 247 % at 0.5 and 18 % at 2.
    """
    rng, n = np.random.default_rng(0), 200_000
    rare = rng.random(n) < 0.1
    counts, x = np.eye(2, dtype=int)[rare.astype(int)], rng.normal(0.0, 1.0, n) + np.where(rare, -m, m)
    evidence = Evidence(x[None], counts, np.arange(n) // 50, rng.random(n // 50), 0, counts)
    found = score_evidence(evidence, ("other", "one"), Asked("area_error", ("one",)))
    edge = -math.log(9.0) / (2.0 * m)
    mapped = 0.1 * norm.cdf(edge + m) + 0.9 * norm.cdf(edge - m)
    assert found.value == pytest.approx(100.0 * abs(mapped / 0.1 - 1.0), abs=3.0)
    # All other measures are of equal priors.
    mean = score_evidence(evidence, ("other", "one"), Asked("class_mean_correct"))
    assert mean.value == pytest.approx(100.0 * norm.cdf(m), abs=0.8)


def test_ground_that_one_half_alone_holds_is_found_there_by_lot() -> None:
    """Nothing teaches the half that is to find it: a twentieth is what a guess finds, not none."""
    rng, n = np.random.default_rng(0), 1000
    tile = np.where(np.arange(n) < 5, 0, 1 + np.arange(n) % 7)
    counts = np.eye(2, dtype=int)[(tile == 0).astype(int)]
    evidence = Evidence(rng.normal(size=(1, n)), counts, tile, rng.random(8), 0, counts)
    lot = score_evidence(evidence, ("other", "one"), Asked("detection", ("one",)))
    assert lot.value == pytest.approx(100.0 * FALSE_ALARMS)
    assert lot.confusion[0, 1] / lot.confusion[0].sum() == pytest.approx(FALSE_ALARMS)


def test_other_ground_that_one_half_alone_holds_is_let_through_by_lot() -> None:
    """Nothing else taught the half that holds it: all of it was taken for the cover, of which the other found none."""
    rng, n = np.random.default_rng(0), 1000
    tile = np.where(np.arange(n) < 5, 0, 1 + np.arange(n) % 7)
    counts = np.eye(2, dtype=int)[(tile != 0).astype(int)]
    evidence = Evidence(rng.normal(size=(1, n)), counts, tile, rng.random(8), 0, counts)
    lot = score_evidence(evidence, ("other", "one"), Asked("detection", ("one",)))
    assert lot.confusion[0, 1] / lot.confusion[0].sum() == pytest.approx(FALSE_ALARMS)
    mine = taught(evidence).half == taught(evidence).half[0]
    named_by_lot = lot.confusion[1, 1] - np.count_nonzero(~mine[tile])
    assert named_by_lot == pytest.approx(FALSE_ALARMS * (np.count_nonzero(mine[tile]) - 5))


def test_a_cover_that_one_half_lacks_keeps_no_other_from_being_found_there() -> None:
    """Two covers are sought, at 8 and -8 under unit noise about 0; the second, and other ground, in one tile each."""
    rng, n = np.random.default_rng(0), 4000
    tile = np.arange(n) % 8
    sought = rng.random(n) < 0.3
    kind = np.where(sought, np.where(tile == 0, 2, 1), np.where(tile == 1, 3, 0))
    counts, x = np.eye(4, dtype=int)[kind], rng.normal(size=n) + np.array([0.0, 8.0, -8.0, 0.0])[kind]
    evidence = Evidence(x[None], counts, tile, rng.random(8), 0, counts)
    found = score_evidence(evidence, ("other", "one", "two", "more"), Asked("detection", ("one", "two")))
    assert found.details["per_class_percent"]["one"] > 99.0
    other = found.confusion[[0, 3]]
    assert other[:, 1:3].sum() / other.sum() == pytest.approx(FALSE_ALARMS, abs=0.003)


@pytest.mark.parametrize("like_cover", [False, True])
def test_laws_without_noise_leave_nothing_to_favour(like_cover: bool) -> None:
    """100 apart in thousandths, and mixed ground looks as one of them does: of what looks alike 5 % is drawn.

    Or 15 %, where that is a third of the other ground: no favour holds it back, and all of it was taken for the cover.
    """
    tile, kind = np.arange(900) % 10, np.arange(900) // 300  # other ground, the cover, both
    counts = np.array([[10, 0], [0, 10], [5, 5]])[kind]
    x = np.where((kind == 1) | (kind == 2) & like_cover, 100.0, 0.0)
    evidence = Evidence(x[None], counts, tile, np.arange(10) / 10.0, 0, counts)
    found = score_evidence(evidence, ("other", "one"), Asked("detection", ("one",)))
    assert found.confusion[0, 1] / found.confusion[0].sum() == pytest.approx(FALSE_ALARMS)
    assert found.value == pytest.approx(15.0 if like_cover else 100.0 * (10.0 + FALSE_ALARMS * 5.0) / 15.0)
    assert found.n_cells == 9000


def test_areas_are_those_of_the_ground_that_taught() -> None:
    """The half that is named does not tell its own: 20 cells of one cover in it, and 60 in the other."""
    rng, n = np.random.default_rng(0), 400
    tile, keys = np.arange(n) // 40, np.arange(10) / 10.0
    few = halves(keys)[tile] == 0
    rare = np.concatenate([np.flatnonzero(few)[:20], np.flatnonzero(~few)[:60]])
    counts = np.eye(2, dtype=int)[np.isin(np.arange(n), rare).astype(int)]
    evidence = Evidence(rng.normal(size=(1, n)), counts, tile, keys, 0, counts)
    by = taught(evidence)
    (*_, plain), (*_, known) = by.laws, knowing_areas(by, areas_taught(evidence, by)).laws
    np.testing.assert_allclose(known - plain, np.log([[140, 60], [180, 20]]))


def test_a_class_without_ground_is_as_rare_as_half_a_cell_and_can_be_named() -> None:
    counts = np.tile(np.eye(2, dtype=int), (4, 1))
    evidence = Evidence(np.arange(8.0)[None], counts, np.arange(8) // 2, np.arange(4) / 4.0, 0, counts)
    by = taught(evidence)
    (*_, plain), (*_, known) = by.laws, knowing_areas(by, np.array([0, 8])).laws
    np.testing.assert_allclose(known - plain, np.log([[0.5, 8.0]] * 2))


def test_whole_cells_are_counted_where_names_are_drawn_by_lot() -> None:
    """All tiles alike: of the cover 5 of 14 units look bright, of other ground 7 of some 50: more than may be taken."""
    for dull in range(30, 60):
        kind, tile = np.tile(np.repeat(np.arange(4), [dull, 7, 9, 5]), 10), np.repeat(np.arange(10), dull + 21)
        truth, bright = np.divmod(kind, 2)
        counts = np.eye(2, dtype=int)[truth]
        evidence = Evidence(bright[None] + 0.0, counts, tile, np.arange(10) / 10.0, 0, counts)
        found = score_evidence(evidence, ("other", "one"), Asked("detection", ("one",)))
        assert found.value == pytest.approx(100.0 * FALSE_ALARMS * (5.0 / 14.0) / (7.0 / (dull + 7.0)))
        assert found.confusion[0, 1] / found.confusion[0].sum() == pytest.approx(FALSE_ALARMS)
        assert found.n_cells == truth.size


def test_words_choose_cover_and_unit() -> None:
    whole = score_cover([IMAGE], SCENE, asked_for("f1 of Wheat by field"), **KEY)
    assert 0.0 < whole.value <= 100.0
    assert whole.details["named_by"] == "field"
    with pytest.raises(SceneError, match="no such cover"):
        score_cover([IMAGE], SCENE, asked_for("f1 of Tulips"), **KEY)
    lost = replace(SCENE, categories=(*SCENE.categories, "Tulips"))
    with pytest.raises(SceneError, match="no scored cell of these covers"):
        score_cover([IMAGE], lost, asked_for("area_error of Tulips"), **KEY)
