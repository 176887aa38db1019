"""Rivers, roads and towns of synthetic scenes: where they run, how wide they are, what joins them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import label
from typer.testing import CliRunner

from seqrsm.cli.app import app
from seqrsm.errors import SceneError
from seqrsm.scene.features import river_mask, road_mask, town_centres, town_mask
from seqrsm.scene.file import load_scene
from seqrsm.scene.synthetic import synthetic_scene

AROUND = np.ones((3, 3), dtype=int)


def land(**changes):
    given = {"categories": ("Wheat", "Grass"), "relief_m": 40.0, "seed": 4, "rivers": 1, "towns": 3, "roads": True}
    return synthetic_scene(200, 260, 5.0, **{**given, **changes})


def where(scene, name):
    return scene.cover == scene.categories.index(name)


def test_a_river_runs_from_edge_to_edge_in_the_valleys():
    scene = land(towns=0, roads=False)
    water = where(scene, "Water")
    assert label(water, AROUND)[1] == 1
    assert water[:, 0].any()
    assert water[:, -1].any()
    height = scene.elevation_m
    assert height[water].mean() < np.quantile(height, 0.35)
    # 30 m on cells of 5 m, seen from north to south, as the river runs at a slant.
    assert 5 <= np.median(water.sum(axis=0)) <= 9


def test_rivers_by_turns_go_both_ways():
    mask = [river_mask(np.zeros((90, 120)), n, 3.0, seed=1) for n in range(4)]
    assert not mask[0].any()
    assert mask[1][:, 0].any()
    assert mask[2][0].any()
    assert mask[2][-1].any()
    assert (mask[3] & ~mask[2]).any()


def test_a_valley_of_known_course_is_found():
    i, j = np.mgrid[0:120, 0:150]
    z = np.abs(i - 60.0 - 25.0 * np.sin(j / 25.0)) * 3.0
    river = river_mask(z, 1, 3.0, seed=2)
    rows, cols = np.nonzero(river)
    assert np.abs(rows - 60.0 - 25.0 * np.sin(cols / 25.0)).mean() < 3.0


def test_roads_join_the_towns_and_the_edges():
    scene = land()
    centres = town_centres(200, 260, 3, seed=4 + 3)
    river = where(scene, "Water")
    road = road_mask(scene.elevation_m, 5.0, centres, river, 12.0 / 5.0, seed=4 + 7)
    assert label(road, AROUND)[1] == 1
    assert road[:, 0].any()
    assert road[:, -1].any()
    for i, j in centres:
        assert road[max(i - 5, 0) : i + 6, max(j - 5, 0) : j + 6].any()
    # The scene's own road was laid before the river's bridges took its place.
    assert (where(scene, "Asphalt") & road).sum() > 0.95 * road.sum()


def test_a_road_goes_round_a_mountain():
    i, j = np.mgrid[0:100, 0:100]
    z = 80.0 * np.exp(-((i - 50.0) ** 2 + (j - 22.0) ** 2) / 60.0)
    none = np.zeros(z.shape, dtype=bool)
    level, round_it = (road_mask(ground, 5.0, [], none, 1.0, seed=0) for ground in (np.zeros_like(z), z))
    assert z[level].max() > 60.0
    assert z[round_it].max() < 20.0


def test_towns_lie_apart_and_have_their_size():
    centres = town_centres(400, 400, 4, seed=9)
    gaps = [np.hypot(a[0] - b[0], a[1] - b[1]) for k, a in enumerate(centres) for b in centres[:k]]
    assert min(gaps) > 80.0
    area = town_mask((400, 400), [(200, 200)], 40.0, seed=1).sum() / (np.pi * 40.0**2)
    assert 0.4 < area < 2.0
    scene = land()
    assert {"Buildings", "Asphalt", "Grass", "Water"} <= set(scene.categories)
    assert where(scene, "Buildings").mean() > 0.02


def test_the_seed_is_all():
    one, two, other = land(), land(), land(seed=5)
    for layer in ("elevation_m", "cover", "field_id"):
        np.testing.assert_array_equal(getattr(one, layer), getattr(two, layer))
        assert not np.array_equal(getattr(one, layer), getattr(other, layer))


def test_fields_hold_one_cover_and_features_cut_them():
    scene = land()
    for number in np.unique(scene.field_id)[::7]:
        assert len(np.unique(scene.cover[scene.field_id == number])) == 1
    assert scene.n_fields > land(rivers=0, towns=0, roads=False).n_fields


@pytest.mark.parametrize(
    "change",
    [
        {"rivers": -1},
        {"towns": -1},
        {"town_m": 0.0},
        {"road_m": -1.0},
        {"seed": 2**64},
        {"seed": -1},
        {"relief_m": 9500.0},
    ],
)
def test_impossible_features_are_refused(change):
    with pytest.raises(SceneError, match=next(iter(change))):
        land(**change)


def test_a_scene_too_large_is_refused_before_anything_is_drawn(tmp_path, monkeypatch):
    given = ["scene", "synthetic", "--out", str(tmp_path / "land.npz"), "--rows", "20000", "--cols", "20000"]
    result = CliRunner().invoke(app, given)
    assert result.exit_code == 2
    assert "more than 100000000" in result.stderr

    def none_left(*_arguments, **_options):
        raise MemoryError("Unable to allocate 3 GiB")

    monkeypatch.setattr("seqrsm.scene.synthetic.fractal_terrain", none_left)
    result = CliRunner().invoke(app, given[:4])
    assert result.exit_code == 2
    assert "not enough memory: Unable to allocate 3 GiB" in result.stderr
    assert not (tmp_path / "land.npz").exists()


def test_the_command_draws_a_scene(tmp_path):
    out = tmp_path / "land.npz"
    given = ["scene", "synthetic", "--out", str(out), "--rows", "90", "--cols", "120", "--towns", "2", "--seed", "3"]
    result = CliRunner().invoke(app, given)
    assert result.exit_code == 0, result.output
    scene = load_scene(out)
    assert scene.shape == (90, 120)
    assert "Water" in scene.categories
    assert CliRunner().invoke(app, ["scene", "show", str(out)]).exit_code == 0
    bad = CliRunner().invoke(app, [*given, "--field-m", "0.5"])
    assert bad.exit_code == 2
    assert "field" in bad.stderr
