"""A campaign small enough to run in seconds: a synthetic scene, one factor of resolution, two polarizations."""

from __future__ import annotations

from pathlib import Path

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
half_width = 22.0
max_runs = 40
confirmation_runs = 3
"""


def make_tiny(folder: Path, scene: Path, text: str = TINY) -> Path:
    folder.mkdir()
    (folder / "campaign.toml").write_text(text, encoding="utf-8")
    (folder / "scene.npz").write_bytes(scene.read_bytes())
    return folder
