"""A campaign small enough to run in seconds: a synthetic scene, one factor of resolution, two polarizations."""

from __future__ import annotations

from pathlib import Path

import pytest

from seqrsm.scene.scene import save_scene
from seqrsm.scene.synthetic import synthetic_scene

TINY = """\
[campaign]
name = "tiny"
description = "a test"
seed = 5
batch = 3

[[factor]]
name = "polarization"
levels = ["HH", "HH+HV"]

[[factor]]
name = "resolution"
unit = "m"
low = 10.0
high = 60.0
scale = "log"

[[application]]
name = "cover"
utility = "percent_correct"

[simulator]
engine = "psm"
scene = "scene.npz"

[simulator.fixed]
frequency = 3.0
bandwidth = 60.0
peak_power = 1000.0
depression_angle = 45.0
altitude_m = 4000.0

[stop]
interval = "prediction_mean"
half_width = 9.0
max_runs = 40
confirmation_runs = 3
"""


@pytest.fixture(scope="session")
def tiny_scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scene") / "scene.npz"
    scene = synthetic_scene(
        60, 80, 10.0, categories=("Grass", "Trees", "Bareground"), field_m=120.0, relief_m=20.0, seed=3
    )
    save_scene(scene, path)
    return path


@pytest.fixture
def tiny(tmp_path: Path, tiny_scene: Path) -> Path:
    """Folder of a fresh campaign."""
    return make_tiny(tmp_path / "tiny", tiny_scene)


def make_tiny(folder: Path, scene: Path, text: str = TINY) -> Path:
    folder.mkdir()
    (folder / "campaign.toml").write_text(text, encoding="utf-8")
    (folder / "scene.npz").write_bytes(scene.read_bytes())
    return folder
