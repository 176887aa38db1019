"""Fixtures of the tiny campaign."""

from __future__ import annotations

from pathlib import Path

import pytest
from synthetic import synthetic_scene
from tiny_campaign import make_tiny

from seqrsm.scene.file import save_scene


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
