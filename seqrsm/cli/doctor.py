"""``seqrsm doctor``: the installation."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import re
import time
from dataclasses import replace
from typing import Any

from seqrsm import __version__
from seqrsm.cli.console import AsJson, display, guarded, print_json


@guarded
def doctor(as_json: AsJson = False) -> None:
    """Check the installation. Also compiles the kernels."""
    from seqrsm.cli.show import show_doctor

    with display("compiling the kernels"):
        result = examine()
    print_json(result) if as_json else show_doctor(result)


def examine() -> dict[str, Any]:
    """Versions, processor count, compile cache, and seconds to compile or load every kernel used by a campaign."""
    from seqrsm.jit import cache_directory

    needed, extras = [], {}
    for row in importlib.metadata.requires("seqrsm") or ():
        name, extra = re.match(r"[\w-]+", row), re.search(r"extra == ['\"](\w+)['\"]", row)
        if name and extra is None:
            needed.append(name[0])
        elif name and extra and extra[1] != "dev":
            extras[name[0]] = extra[1]
    return {
        "seqrsm": __version__,
        "python": platform.python_version(),
        "system": f"{platform.system()} {platform.machine()}",
        "cpus": os.cpu_count() or 1,
        "packages": {name: _version(name) for name in needed},
        "extras": {name: _version(name) or f"absent; pip install 'seqrsm[{extra}]'" for name, extra in extras.items()},
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
    import numpy as np

    from seqrsm.scattering.emissivity import load_emissivity_table
    from seqrsm.scattering.sigma0 import load_sigma0_table
    from seqrsm.scene.synthetic import synthetic_scene
    from seqrsm.score.cover import percent_correct
    from seqrsm.sensor import radiometer
    from seqrsm.sensor.radar import from_settings
    from seqrsm.simulate.radar.psm import simulate_radar
    from seqrsm.simulate.radiometer.prm import simulate_radiometer

    start = time.perf_counter()
    scene = synthetic_scene(60, 60, 10.0, categories=("Grass", "Trees"), relief_m=20.0)
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
