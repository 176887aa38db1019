"""Synthetic scenes: what a seed draws, what is refused, and the command."""

from __future__ import annotations

import numpy as np
import pytest
from typer.testing import CliRunner

from seqrsm.cli.app import app
from seqrsm.errors import SceneError
from seqrsm.scene.file import load_scene
from seqrsm.scene.synthetic import synthetic_scene


def land(seed=4, relief_m=40.0):
    return synthetic_scene(200, 260, 5.0, categories=("Wheat", "Grass"), relief_m=relief_m, seed=seed)


def test_the_seed_is_all():
    one, two, other = land(), land(), land(seed=5)
    for layer in ("elevation_m", "cover", "field_id"):
        np.testing.assert_array_equal(getattr(one, layer), getattr(two, layer))
        assert not np.array_equal(getattr(one, layer), getattr(other, layer))


def test_fields_hold_one_cover():
    scene = land()
    for number in np.unique(scene.field_id)[::7]:
        assert len(np.unique(scene.cover[scene.field_id == number])) == 1


@pytest.mark.parametrize("change", [{"seed": 2**64}, {"seed": -1}, {"relief_m": 9500.0}])
def test_impossible_land_is_refused(change):
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
    given = ["scene", "synthetic", "--out", str(out), "--rows", "90", "--cols", "120", "--seed", "3"]
    result = CliRunner().invoke(app, given)
    assert result.exit_code == 0, result.output
    scene = load_scene(out)
    assert scene.shape == (90, 120)
    assert "Wheat" in scene.categories
    assert CliRunner().invoke(app, ["scene", "show", str(out)]).exit_code == 0
    bad = CliRunner().invoke(app, [*given, "--field-m", "0.5"])
    assert bad.exit_code == 2
    assert "field" in bad.stderr
