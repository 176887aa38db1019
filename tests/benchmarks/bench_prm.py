"""Speed of the Point Radiation Model against a straightforward whole-array numpy version, in one run.

    python tests/benchmarks/bench_prm.py [rows] [columns]

Both do blocking on both sides of nadir, local look angle, emissivity by category and angle, and eq. (3-35), in float64
and float32; moisture is timed apart. Times are CPU time of this
thread, the best of several.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "physics"))

from prm_cases import Table, radiometer, scene

from seqrsm.scattering.atmosphere import make_atmosphere
from seqrsm.scattering.emissivity import load_emissivity_table
from seqrsm.simulate import kernels_prm
from seqrsm.simulate.prm import RadiationMap, radiation_map, simulate_radiometer
from seqrsm.simulate.prm_frame import RadiometerFrame, make_radiometer_frame
from seqrsm.simulate.prm_occasion import nominal_radiometer_occasion


def best_of(n: int, call: Callable[[], object]) -> float:
    times = []
    for _ in range(n):
        start = time.thread_time()
        call()
        times.append(time.thread_time() - start)
    return min(times)


def naive(f: RadiometerFrame, emissivity: np.ndarray, ground: np.ndarray, air) -> np.ndarray:
    """Antenna temperature of every element, as one would first write it."""
    z, y = f.elevation_m, np.abs(f.across_m)[:, None]
    n = len(z)
    tangent = y / (f.height_m - z)
    blocked = np.empty(z.shape, dtype=bool)
    right, left = tangent[n // 2 :], tangent[: n // 2][::-1]
    blocked[n // 2 :] = right < np.maximum.accumulate(right, axis=0)
    blocked[: n // 2] = (left < np.maximum.accumulate(left, axis=0))[::-1]
    zy, zx = np.gradient(z, f.cell_m)
    r = np.hypot(y, f.height_m - z)
    outward = np.sign(f.across_m)[:, None] * zy
    cosine = (y * outward + f.height_m - z) / (r * np.sqrt(1.0 + zx**2 + zy**2))
    theta = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
    e = np.zeros_like(z)
    for k in range(len(emissivity)):
        here = f.cover == k
        e[here] = np.interp(theta[here], np.arange(91.0), emissivity[k])
    sky = np.interp(theta, np.arange(91.0), air.sky_k(np.deg2rad(np.arange(91.0))))
    look = np.arctan(y / f.height_m)
    up, through = air.upwelling_k(look, f.height_m), air.transmission(look, f.height_m)
    return np.where(blocked | (cosine <= 0.0), 0.0, up + through * (sky + e * (ground - sky)))


def main() -> None:
    n, m = (int(a) for a in [*sys.argv[1:], "1000", "1000"][:2])
    rng = np.random.default_rng(0)
    z = rng.normal(0.0, 1.0, (n, m)).cumsum(axis=0) * 0.3 + rng.normal(0.0, 1.0, (n, m)).cumsum(axis=1) * 0.3
    cover = np.kron(rng.integers(0, 10, (n // 40 + 1, m // 40 + 1)), np.ones((40, 40), dtype=int))[:n, :m]
    field = np.arange((n // 40 + 1) * (m // 40 + 1)).reshape(n // 40 + 1, -1)
    field = np.kron(field, np.ones((40, 40), dtype=int))[:n, :m]
    names = ("Trees", "Grass", "Wheat", "Corn", "Bareground", "Gravel", "Asphalt", "Water", "Scrub", "Swamp")
    s = scene(z, 5.0, cover, field, names)
    table = Table(tuple(lambda t, k=k: 0.95 - 0.03 * k - t * 1e-3 for k in range(10)))
    r = radiometer(resolution_m=25.0, altitude_m=3000.0, scan_period_s=0.5, integration_time_ms=0.2)
    air = make_atmosphere(10.7)
    for precision in ("float32", "float64"):
        f = make_radiometer_frame(s, r, precision)
        ground = rng.uniform(300.0, 340.0, (n, m)).astype(precision)
        kernel, whole = {}, {}
        for label, source in (("plain", table), ("moist", load_emissivity_table())):
            look = source.lookup(s.categories, 10.0, "H")
            occasion = nominal_radiometer_occasion(r, [look], s.n_fields)

            def mapped(look=look, occasion=occasion, ground=ground, f=f) -> RadiationMap:
                return radiation_map(f, r, [look], air, ground, occasion)

            arguments = arguments_of(mapped)
            kernel[label] = best_of(15, lambda a=arguments: kernels_prm.emit_cells(*a))
            whole[label] = best_of(9, mapped)
            if source is table:
                e = look.emissivity[:, 0]
                slow = best_of(5, lambda f=f, e=e, ground=ground: naive(f, e, ground, air))
                ours, theirs = mapped().antenna_k[0], naive(f, e, ground, air)
                both = (ours > 0.0) & (theirs > 0.0)
                apart = float(np.quantile(np.abs(ours - theirs)[both], 0.999))
        image = best_of(
            5, lambda p=precision: simulate_radiometer(s, r, load_emissivity_table(), seed=1, run_id=1, precision=p)
        )
        t = kernel["plain"]
        print(
            f"{precision}: cell kernel {t * 1e3:.2f} ms ({n * m / t / 1e6:.0f} Mcell/s), with 17 moistures "
            f"{kernel['moist'] * 1e3:.2f} ms; numpy {slow * 1e3:.0f} ms ({n * m / slow / 1e6:.1f} Mcell/s); "
            f"ratio {slow / t:.0f}; they agree to {apart:.2g} K; radiation map {whole['plain'] * 1e3:.1f} ms, "
            f"whole image {image * 1e3:.1f} ms"
        )


def arguments_of(call: Callable[[], object]) -> tuple:
    """Arguments with which `call` runs the cell kernel."""
    kept = []
    kernel = kernels_prm.emit_cells
    kernels_prm.emit_cells = lambda *arguments: kept.append(arguments)
    try:
        call()
    finally:
        kernels_prm.emit_cells = kernel
    return kept[0]


if __name__ == "__main__":
    main()
