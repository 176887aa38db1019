"""Speed of the Point Scattering Model against a straightforward whole-array numpy version, in one run.

    python tests/benchmarks/bench_psm.py [rows] [columns]

Both do shadow, local incidence, sigma0 by category and angle, the radar equation and range binning in float64 and
float32; the numpy version assigns each element to one bin (the report's rule), the kernel splits it by exact overlap.
Times are CPU time of this thread, the best of several.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "physics"))

from psm_cases import Table, radar, scene

from seqrsm.simulate import kernels
from seqrsm.simulate.frame import RadarFrame, make_frame
from seqrsm.simulate.occasion import nominal_ground_state, nominal_occasion
from seqrsm.simulate.psm import power_map, sigma0_lut, simulate_radar


def best_of(n: int, call: Callable[[], object]) -> float:
    times = []
    for _ in range(n):
        start = time.thread_time()
        call()
        times.append(time.thread_time() - start)
    return min(times)


def naive(f: RadarFrame, sigma0: np.ndarray, spacing: float) -> np.ndarray:
    """Power of each range bin and column, as one would first write it."""
    z, y = f.elevation_m, f.ground_range_m[:, None]
    look = y / (f.height_m - z)
    shadow = look < np.maximum.accumulate(look, axis=0)
    zy, zx = np.gradient(z, f.cell_m)
    r = np.hypot(y, f.height_m - z)
    tilt = np.sqrt(1.0 + zx**2 + zy**2)
    theta = np.degrees(np.arccos(np.clip((y * zy + f.height_m - z) / (r * tilt), -1.0, 1.0)))
    value = np.zeros_like(z)
    for k in range(len(sigma0)):
        here = f.cover == k
        value[here] = np.interp(theta[here], np.arange(91.0), sigma0[k])
    power = np.where(shadow | (theta >= 90.0), 0.0, value * tilt / r**4)
    ground = np.sqrt(np.maximum(r**2 - f.height_m**2, 0.0))
    bins = np.floor((ground - f.near_edge_m) / spacing).astype(np.int64)
    bins -= bins.min()
    column = np.broadcast_to(np.arange(z.shape[1]), z.shape)
    n = int(bins.max()) + 1
    return np.bincount((bins * z.shape[1] + column).ravel(), power.ravel(), n * z.shape[1]).reshape(n, -1)


def main() -> None:
    n, m = (int(a) for a in (sys.argv[1:] + ["1000", "1000"])[:2])
    rng = np.random.default_rng(0)
    z = rng.normal(0.0, 1.0, (n, m)).cumsum(axis=0) * 0.3 + rng.normal(0.0, 1.0, (n, m)).cumsum(axis=1) * 0.3
    # Fields of 40 x 40 cells: real covers are patches, and so are the memory accesses they cause.
    cover = np.kron(rng.integers(0, 10, (n // 40 + 1, m // 40 + 1)), np.ones((40, 40), dtype=int))[:n, :m]
    field = np.arange((n // 40 + 1) * (m // 40 + 1)).reshape(n // 40 + 1, -1)
    field = np.kron(field, np.ones((40, 40), dtype=int))[:n, :m]
    s = scene(z, 5.0, cover, field)
    table = Table(tuple(np.linspace(-20.0, -6.0, 10)), 0.15)
    r = radar(resolution_m=25.0, depression_angle_deg=40.0)
    for precision in ("float32", "float64"):
        f = make_frame(s, r, precision)
        state = nominal_ground_state(r)
        look = table.lookup(s.categories, 5.3, "VV", season="fall", wind_m_s=5.0, soil_moisture=0.2)
        occasion = nominal_occasion([look], np.zeros(s.n_fields), state)
        lut, factor = sigma0_lut([look], occasion), np.ones((1, s.n_fields))
        sums = np.zeros((1, n, m), dtype=precision)

        def compiled(f: RadarFrame = f, lut: np.ndarray = lut, factor: np.ndarray = factor, sums: np.ndarray = sums):
            p = power_map(f, r, lut, factor)
            kernels.bin_range(p.power, p.offset, p.base, -50, sums)

        cells = f.elevation_m.size
        t = best_of(9, compiled)
        whole = best_of(
            9, lambda precision=precision: simulate_radar(s, r, table, seed=1, run_id=1, precision=precision)
        )
        slow = best_of(3, lambda f=f: naive(f, look.sigma0, 25.0))
        print(
            f"{precision}: power map + exact-overlap bins {t * 1e3:.1f} ms ({cells / t / 1e6:.0f} Mcell/s), "
            f"numpy {slow * 1e3:.0f} ms ({cells / slow / 1e6:.1f} Mcell/s), ratio {slow / t:.0f}; "
            f"whole image {whole * 1e3:.1f} ms"
        )


if __name__ == "__main__":
    main()
