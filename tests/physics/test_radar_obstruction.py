"""Trees and buildings hide what lies behind them: shadows by closed forms, what stands where, who teaches in shadow."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from psm_cases import Table, radar, scene
from shorthands import percent_correct

from seqrsm.score.evidence import _shown, evidence_of
from seqrsm.score.pixels import _dark, pixels_of
from seqrsm.sensor.named import with_noise
from seqrsm.simulate.radar.echo import out_of_order
from seqrsm.simulate.radar.frame import make_frame
from seqrsm.simulate.radar.psm import simulate_radar, tops_counted_twice
from seqrsm.simulate.radar.targets import CulturalTarget

LOW = {"tree_height_m": 0.0, "building_height_m": 0.0}
TABLE = Table((-10.0, -8.0))


def still(s, r, table, **options):
    return simulate_radar(s, r, table, seed=1, run_id=1, **options)


def row_of(name: str, cell_m: float = 2.0, at: int = 40):
    """Level grass with one row of trees or buildings across the line of sight of a flight to the east."""
    cover = np.zeros((120, 40), dtype=np.uint8)
    cover[at] = 1
    return scene(np.zeros(cover.shape), cell_m, cover, categories=("Grass", name))


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize(("name", "tall"), [("Trees", 15.0), ("Buildings", 8.0), ("Trees", 30.0)])
@pytest.mark.parametrize("depression", [30.0, 45.0])
def test_the_shadow_of_a_row_is_as_long_as_its_height_over_the_slope_of_the_ray(name, tall, depression, precision):
    r = radar(earth="flat", depression_angle_deg=depression, resolution_m=5.0, **{_height(name): tall})
    image = still(row_of(name), r, TABLE, precision=precision)
    hidden = image.shadow.sum(axis=0)
    assert np.ptp(hidden) == 0
    # The radar flies north of the scene and looks south, or the other way: behind is one side of the row alone.
    beside = [image.shadow[:40].any(), image.shadow[41:].any()]
    assert sorted(beside) == [False, True]
    assert hidden[0] == pytest.approx(tall / np.tan(np.radians(depression)) / 2.0, abs=1.1)


def _height(name: str) -> str:
    return {"Trees": "tree_height_m", "Buildings": "building_height_m"}[name]


@pytest.mark.parametrize("name", ["Trees", "Buildings"])
def test_nothing_but_the_hidden_ground_changes(name):
    r = radar(earth="flat", depression_angle_deg=30.0, resolution_m=5.0)
    s = row_of(name)
    bare, stands = (
        still(s, radar(earth="flat", depression_angle_deg=30.0, resolution_m=5.0, **LOW), TABLE),
        still(s, r, TABLE),
    )
    assert not bare.shadow.any()
    np.testing.assert_array_equal(bare.pixel_of_cell, stands.pixel_of_cell)
    np.testing.assert_array_equal(bare.layover, stands.layover)
    touched = np.unique(stands.pixel_of_cell[stands.shadow])
    same = np.ones(bare.mean_power[0].size, dtype=bool)
    same[touched] = False
    np.testing.assert_array_equal(bare.mean_power[0].ravel()[same], stands.mean_power[0].ravel()[same])
    assert (stands.mean_power[0].ravel()[touched] < bare.mean_power[0].ravel()[touched]).all()
    assert any("hide what lies behind" in note for note in stands.notes)
    assert not any("hide what lies behind" in note for note in bare.notes)


def test_other_covers_hide_nothing():
    r = radar(earth="flat", depression_angle_deg=30.0, resolution_m=5.0)
    assert not still(row_of("Corn"), r, TABLE).shadow.any()


def test_trees_on_the_far_side_are_hidden_by_taller_ground_only():
    s = row_of("Trees")
    wood = s.cover.copy()
    wood[40:70] = 1  # a wood: all of its tops are as high
    image = still(
        scene(np.zeros(wood.shape), 2.0, wood, categories=s.categories), radar(earth="flat", resolution_m=5.0), TABLE
    )
    assert not image.shadow[40:70].any()
    assert image.shadow.any()


@pytest.mark.parametrize("heading", [0.0, 90.0, 180.0, 270.0, 30.0])
def test_shadow_lies_behind_whatever_the_heading(heading):
    cover = np.zeros((120, 120), dtype=np.uint8)
    cover[58:62, 58:62] = 1
    s = scene(np.zeros(cover.shape), 2.0, cover, categories=("Grass", "Trees"))
    rows, cols = np.nonzero(still(s, radar(earth="flat", heading_deg=heading, resolution_m=5.0), TABLE).shadow)
    toward = np.radians(heading + 90.0)
    behind = (cols.mean() - 59.5) * np.sin(toward) - (rows.mean() - 59.5) * np.cos(toward)
    aside = (cols.mean() - 59.5) * np.cos(toward) + (rows.mean() - 59.5) * np.sin(toward)
    assert behind > 2.0
    assert abs(aside) < 0.7


def test_trees_around_a_rotating_antenna_hide_what_is_farther_out():
    cover = np.zeros((161, 161), dtype=np.uint8)
    cover[78:83, 118:123] = 1
    s = scene(np.zeros(cover.shape), 5.0, cover, categories=("Grass", "Trees"))
    r = radar(
        scan="ppi",
        aperture="real",
        depression_angle_deg=40.0,
        altitude_m=300.0,
        azimuth_beamwidth_deg=3.0,
        pulse_length_us=0.1,
        tree_height_m=30.0,
    )
    rows, cols = np.nonzero(still(s, r, TABLE).shadow)
    assert len(rows) > 10
    assert cols.min() >= 120
    assert np.abs(rows - 80).max() <= 6


def test_a_target_behind_trees_is_silent_and_one_above_their_shadow_is_not():
    s, at = row_of("Trees"), {True: 37, False: 43}
    base = still(s, radar(earth="flat", depression_angle_deg=30.0, fading="none"), TABLE)
    behind = at[bool(base.shadow[37, 20])]
    for height, seen in ((0.0, False), (14.0, True)):
        target = CulturalTarget(behind, 20, 60.0, height_m=height)
        r = radar(earth="flat", depression_angle_deg=30.0, fading="none")
        more = still(s, r, TABLE, targets=(target,)).mean_power - base.mean_power
        assert bool((more > 0).any()) == seen


def test_what_noise_hides_does_not_teach():
    rng = np.random.default_rng(2)
    cover = np.kron(rng.integers(0, 2, (12, 12)), np.ones((10, 10), dtype=int)).astype(np.uint8)
    s = scene(np.zeros(cover.shape), 5.0, cover, np.arange(cover.size).reshape(cover.shape) // 1, ("Grass", "Trees"))
    r = radar(earth="flat", depression_angle_deg=20.0, resolution_m=10.0, tree_height_m=25.0)
    image = still(s, r, Table((-10.0, -8.0)))
    found = evidence_of([image], s, seed=1, run_id=1)
    dark = np.all(image.mean_power < image.noise_power_w[:, None], axis=0).ravel()
    held = found.counts.any(axis=1)
    assert 0.02 < np.mean(dark[held]) < 0.9
    np.testing.assert_array_equal(found.teaching.any(axis=1), held & ~dark)
    np.testing.assert_array_equal(found.teaching[~dark], found.counts[~dark])
    # Of a class that shadow hides but for a few pixels all teach: without any it could never be named.
    few = np.where(dark[image.pixel_of_cell] | (np.cumsum(cover == 1).reshape(cover.shape) < 40), cover, 0)
    rare = replace(s, cover=few.astype(np.uint8))
    found = evidence_of([still(rare, r, Table((-10.0, -8.0)))], rare, seed=1, run_id=1)
    np.testing.assert_array_equal(found.teaching[:, 1], found.counts[:, 1])


def test_a_pixel_teaches_unless_it_is_mostly_shadow_and_dark_in_all_channels():
    s = scene(np.zeros((16, 16)), 5.0)
    image = still(s, radar(earth="flat", resolution_m=10.0), Table((-10.0,)))
    pixel, n = image.pixel_of_cell, image.mean_power[0].size
    shadow, scored = np.zeros((16, 16), dtype=bool), np.ones((16, 16), dtype=bool)
    whole = np.flatnonzero(np.bincount(pixel.ravel(), minlength=n) == 4)[:5]
    for k, cells in zip(whole, (4, 3, 2, 3, 3), strict=True):
        shadow[tuple(np.argwhere(pixel == k)[:cells].T)] = True
    scored[(pixel == whole[4]) & shadow] = False  # and what is scored of the last is lit
    power = np.full((2, n), 0.5)
    power[1, whole[3]] = power[0, -1] = 2.0  # noise is 1
    power, noise = power.reshape(2, *image.mean_power.shape[1:]), np.ones_like(image.noise_power_w)
    seen = replace(image, mean_power=power, noise_power_w=noise, in_shadow=lambda: shadow, laid_over=None)
    pixels = pixels_of([seen], replace(s, scored=scored), seed=1, run_id=1)
    silent = np.flatnonzero(_shown(seen, pixels, pixels.counts)[:, 0] == 0)
    np.testing.assert_array_equal(np.intersect1d(silent, whole), whole[:2])


@pytest.mark.parametrize("noise_db", [-40.0, -17.0, -12.0, -8.0])
def test_lit_ground_is_named_as_the_laws_of_its_classes_let_however_much_noise_there_is(noise_db):
    rng = np.random.default_rng(4)
    one = np.ones((10, 10), dtype=int)
    kind = rng.integers(0, 2, (20, 20))
    s = scene(np.zeros((200, 200)), 20.0, np.kron(kind, one), np.kron(np.arange(400).reshape(20, 20), one))
    levels, sd_db, looks = (-12.0, -22.0), 3.0, 16.0
    r = with_noise(radar(earth="flat", looks=looks, altitude_m=2e5), noise_db)
    found = []
    for run in range(6):
        image = simulate_radar(s, r, Table(levels, field_sd_db=sd_db), seed=4, run_id=run)
        found.append(percent_correct([image], s, seed=4, run_id=run).value)
    # Fields are Gaussian in decibels, noise adds, fading of so many looks multiplies; Gaussian laws in decibels.
    power = [10.0 ** (0.1 * rng.normal(level, sd_db, 200_000)) + 10.0 ** (0.1 * noise_db) for level in levels]
    shown = [10.0 * np.log10(p * rng.gamma(looks, 1.0 / looks, p.size)) for p in power]
    cost = [[((x - y.mean()) / y.std()) ** 2 + 2.0 * np.log(y.std()) for y in shown] for x in shown]
    expected = 50.0 * (np.mean(cost[0][0] < cost[0][1]) + np.mean(cost[1][1] < cost[1][0]))
    assert np.mean(found) == pytest.approx(expected, abs=1.5)


@pytest.mark.parametrize(("of_tops", "told"), [(0.0, 0), (0.3, 0), (1.0, 1)])
def test_elevations_that_hold_the_trees_already_are_told(of_tops, told):
    rng = np.random.default_rng(3)
    cover = np.kron(rng.integers(0, 2, (12, 12)), np.ones((10, 10), dtype=int)).astype(np.uint8)
    z = 15.0 * of_tops * cover + rng.normal(0.0, 1.0, cover.shape)
    s = scene(z, 5.0, cover, categories=("Grass", "Trees"))
    assert len(tops_counted_twice(make_frame(s, radar(), "float32"))) == told
    assert not tops_counted_twice(make_frame(s, radar(**LOW), "float32"))


def test_ground_that_has_no_pixel_darkens_none() -> None:
    """Of the second pixel one cell of two lies in shadow, as does one that no pixel shows."""
    pixel, shadow = np.array([[-1, 0], [1, 1]]), np.array([[True, False], [True, False]])
    of_ground = SimpleNamespace(scored=np.ones((2, 2), dtype=bool))
    counts = np.array([[1], [2]])
    assert not _dark(lambda: shadow, pixel, counts, of_ground).any()
    shadow[1, 1] = True
    np.testing.assert_array_equal(_dark(lambda: shadow, pixel, counts, of_ground), [False, True])


def test_layover_is_ground_whose_range_other_ground_has_passed() -> None:
    """Against all pairs of rows, of relief that reaches over many."""
    rng = np.random.default_rng(3)
    base, offset = np.cumsum(rng.uniform(0.5, 1.5, 60)), rng.normal(0.0, 1.5, (60, 40))
    offset[20, :10] += 15.0
    offset[40, 5:20] -= 15.0
    place, row = base[:, None] + offset, np.arange(60)
    before = row[:, None] < row
    expected = [
        [((one >= one[i]) & before[:, i]).any() or ((one <= one[i]) & before[i]).any() for i in row] for one in place.T
    ]
    np.testing.assert_array_equal(out_of_order(offset, base), np.transpose(expected))
    assert 0.2 < np.mean(expected) < 0.95
