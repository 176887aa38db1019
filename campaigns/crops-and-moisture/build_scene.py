"""Build ``scene.npz`` of this campaign from that of ``langegracht-radar``: every second cell, cells of 10 m.

    python build_scene.py ../langegracht-radar/scene.npz [scene.npz]

A radiometer's footprint is many cells wide: nothing is lost, and a run takes a quarter of the time.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

from seqrsm.scene.file import load_scene, save_scene
from seqrsm.scene.scene import Scene

STEP = 2


def thin(scene: Scene) -> Scene:
    """Every second cell of a scene."""
    rows, columns = (STEP * (n // STEP) for n in scene.cover.shape)

    def layer(values):  # type: ignore[no-untyped-def]
        return values[:rows:STEP, :columns:STEP].copy()

    left, bottom, right, top = scene.bounds
    lost = (scene.cover.shape[0] - rows) * scene.cell_m, (scene.cover.shape[1] - columns) * scene.cell_m
    return replace(
        scene,
        elevation_m=layer(scene.elevation_m),
        cover=layer(scene.cover),
        field_id=layer(scene.field_id),
        scored=layer(scene.scored),
        cell_m=STEP * scene.cell_m,
        bounds=(left, bottom + lost[0], right - lost[1], top),
        provenance=f"{scene.provenance} Thinned to every second cell by build_scene.py of crops-and-moisture.",
    )


if __name__ == "__main__":
    source, *target = sys.argv[1:]
    save_scene(thin(load_scene(Path(source))), Path(target[0] if target else "scene.npz"))
