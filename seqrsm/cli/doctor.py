"""``seqrsm doctor``: is this machine fit for a campaign, and are the kernels compiled."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import time
from dataclasses import replace
from typing import Any

import numpy as np

from seqrsm import __version__
from seqrsm.jit import cache_directory

PACKAGES = (
    "numpy", "scipy", "pandas", "matplotlib", "numba", "emcee", "typer", "rich", "pydantic", "sqlalchemy", "alembic",
    "jinja2", "typst", "tifffile", "pillow",
)  # fmt: skip
EXTRAS = {"distributed": "cluster", "psycopg": "postgres", "pyogrio": "vector"}


def examine() -> dict[str, Any]:
    """Versions, processor count, compile cache, and seconds to compile or load every kernel used by a campaign."""
    return {
        "seqrsm": __version__,
        "python": platform.python_version(),
        "system": f"{platform.system()} {platform.machine()}",
        "cpus": os.cpu_count() or 1,
        "packages": {name: _version(name) for name in PACKAGES},
        "extras": {name: _version(name) or f"absent; pip install 'seqrsm[{extra}]'" for name, extra in EXTRAS.items()},
        "kernel_cache": os.environ.get("NUMBA_CACHE_DIR") or str(cache_directory() or ""),
        "warm_up_s": _warm_up(),
    }


def _version(name: str) -> str:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return ""


def _warm_up() -> dict[str, float]:
    """Run each kernel once on a tiny problem; the compiled code stays in the cache."""
    from seqrsm.scattering.emissivity import load_emissivity_table
    from seqrsm.scattering.sigma0 import load_sigma0_table
    from seqrsm.scene.synthetic import Terrain, synthetic_scene
    from seqrsm.score.cover import percent_correct
    from seqrsm.sensor import radiometer
    from seqrsm.sensor.radar import from_settings
    from seqrsm.simulate.radar.psm import simulate_radar
    from seqrsm.simulate.radiometer.prm import simulate_radiometer

    start = time.perf_counter()
    scene = synthetic_scene(60, 60, 10.0, categories=("Grass", "Trees"), terrain=Terrain(20.0))
    radar = from_settings(
        {"frequency": 5.4, "polarization": "HH", "resolution": 20.0, "depression_angle": 45.0},
        {"bandwidth": 50.0, "peak_power": 1000.0, "altitude_m": 6000.0},
    )
    for aperture in ("synthetic", "real"):
        one = replace(radar, aperture=aperture, resolution_m=20.0 if aperture == "synthetic" else 400.0)
        image = simulate_radar(scene, one, load_sigma0_table(), seed=0, run_id=0)
        percent_correct([image], scene, by="field", seed=0, run_id=0)
    assert np.isfinite(image.intensity).all()
    passive = radiometer.from_settings(
        {"frequency": 10.7, "polarization": "H", "resolution": 40.0, "scan_period": 0.8, "integration_time": 1.0},
        {"bandwidth": 100.0, "noise_temperature": 500.0, "altitude_m": 1000.0},
    )
    scanned = simulate_radiometer(scene, passive, load_emissivity_table(), seed=0, run_id=0)
    percent_correct([scanned], scene, seed=0, run_id=0)
    return {"simulation": time.perf_counter() - start}
