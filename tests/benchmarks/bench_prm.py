"""Speed of the Point Radiation Model against a straightforward whole-array numpy version, in one run.

    python tests/benchmarks/bench_prm.py [rows columns] [--write]

The cell kernel and numpy both do blocking on both sides of nadir, local look angle, emissivity by category and angle,
and eq. (3-35), in float64 and float32; moisture is timed apart. The whole image adds the scan: numpy puts every cell at
the place where it is seen and takes the beam-weighted mean of a window of cells for each footprint, in a loop over
footprints, then the receiver's noise and the nearest footprint of every cell. Times are CPU time of this thread, the
best of several.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parents[1] / "physics"))

import bench_psm
from prm_cases import Table, radiometer, scene
from shorthands import still_radiometer
from synthetic import fractal_terrain

from seqrsm.scattering.atmosphere import make_atmosphere
from seqrsm.scattering.emissivity import load_emissivity_table
from seqrsm.simulate.radiometer import kernels_prm
from seqrsm.simulate.radiometer.frame import RadiometerFrame, make_radiometer_frame
from seqrsm.simulate.radiometer.occasion import nominal_radiometer_occasion
from seqrsm.simulate.radiometer.prm import Meeting, radiation_map, simulate_radiometer
from seqrsm.simulate.radiometer.result import RadiometerImage

best_of = partial(bench_psm.best_of, clock=time.thread_time)


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


def naive_image(f: RadiometerFrame, antenna: np.ndarray, image: RadiometerImage) -> tuple[np.ndarray, ...]:
    """Every footprint without and with noise, and nearest footprint of every cell, as one would first write it."""
    scan, cell = image.scan, f.cell_m
    n, m = antenna.shape
    seen_at = f.across_m[:, None] * f.height_m / (f.height_m - f.elevation_m)
    phi = np.arctan2(seen_at, f.height_m)
    x = np.broadcast_to((np.arange(m) + 0.5) * cell, (n, m))
    part = np.clip(0.5 + 0.5 * phi / scan.half_angle_rad, 0.0, 1.0)
    width = image.radiometer.resolution_m / np.cos(phi)
    seen = antenna > 0.0
    out = np.empty((len(scan.look_rad), scan.n_sweeps))
    relief = int(np.abs(seen_at - f.across_m[:, None]).max() / cell) + 2
    for s, look in enumerate(scan.look_rad):
        low, high = (f.height_m * np.tan(look + side * 1.75 * scan.beamwidth_rad) for side in (-1.0, 1.0))
        rows = slice(max(int(low / cell + 0.5 * n) - relief, 0), min(int(high / cell + 0.5 * n) + relief + 1, n))
        reach = 1.75 * image.radiometer.resolution_m / np.cos(look)
        for line in range(scan.n_sweeps):
            at = scan.sweep_advance_m * (line + (part[rows] if line % 2 == 0 else 1.0 - part[rows]))
            middle = float(at.mean())
            columns = slice(max(int((middle - reach) / cell), 0), min(int((middle + reach) / cell) + 2, m))
            u = (phi[rows, columns] - look) / scan.beamwidth_rad
            v = (x[rows, columns] - at[:, columns]) / width[rows, columns]
            weight = np.where(seen[rows, columns], np.exp(-4.0 * np.log(2.0) * (u * u + v * v)), 0.0)
            total = weight.sum()
            out[s, line] = (weight * antenna[rows, columns]).sum() / total if total > 0.0 else np.nan
    noise = image.radiometer.nedt_k(out) * np.random.default_rng(1).standard_normal(out.shape)
    sample = np.abs(phi[..., None] - scan.look_rad[None, None, ::16]).argmin(axis=-1)  # a sixteenth of the work
    nearest = np.clip(x / scan.sweep_advance_m - part, 0, scan.n_sweeps - 1).astype(int)
    return out, out + noise, sample * scan.n_sweeps + nearest


def main() -> None:
    write = "--write" in sys.argv
    n, m = (int(a) for a in [*(a for a in sys.argv[1:] if a != "--write"), "1000", "1000"][:2])
    rows = []
    rng = np.random.default_rng(0)
    z = fractal_terrain(n, m, relief_m=100.0, seed=0)
    cover = np.kron(rng.integers(0, 10, (n // 40 + 1, m // 40 + 1)), np.ones((40, 40), dtype=int))[:n, :m]
    field = np.arange((n // 40 + 1) * (m // 40 + 1)).reshape(n // 40 + 1, -1)
    field = np.kron(field, np.ones((40, 40), dtype=int))[:n, :m]
    names = ("Trees", "Grass", "Wheat", "Corn", "Bareground", "Gravel", "Asphalt", "Water", "Scrub", "Swamp")
    s = scene(z, 5.0, cover, field, names)
    table = Table(tuple(lambda t, k=k: 0.95 - 0.03 * k - t * 1e-3 for k in range(10)))
    r = radiometer(resolution_m=25.0, altitude_m=3000.0, scan_period_s=0.5, integration_time_ms=0.02)
    air = make_atmosphere(10.7)
    for precision in ("float32", "float64"):
        f = make_radiometer_frame(s, r, precision)
        ground = rng.uniform(300.0, 340.0, (n, m)).astype(precision)
        kernel, whole = {}, {}
        for label, source in (("plain", table), ("moist", load_emissivity_table())):
            look = source.lookup(s.categories, 10.0, "H")
            occasion = nominal_radiometer_occasion(r, [look], s)

            met = Meeting(f, None, [look], occasion, air, 0.0, source, None)

            def mapped(met=met, ground=ground) -> np.ndarray:
                return radiation_map(met, r, ground)[0]

            arguments = arguments_of(mapped)
            kernel[label] = best_of(15, lambda a=arguments: kernels_prm.emit_cells(*a))
            whole[label] = best_of(9, mapped)
            if source is table:
                e = look.emissivity[:, 0]
                slow = best_of(5, lambda f=f, e=e, ground=ground: naive(f, e, ground, air))
                ours, theirs = mapped()[0], naive(f, e, ground, air)
                both = (ours > 0.0) & (theirs > 0.0)
                apart = float(np.quantile(np.abs(ours - theirs)[both], 0.999))
        made = []
        image = best_of(
            9,
            lambda p=precision, made=made: made.append(
                simulate_radiometer(s, r, load_emissivity_table(), seed=1, run_id=1, precision=p)
            ),
        )
        look = load_emissivity_table().lookup(s.categories, r.frequency_ghz, "H")
        still = nominal_radiometer_occasion(r, [look], s)
        no_air = make_atmosphere(r.frequency_ghz, atmosphere="none")
        quiet_air = Meeting(f, None, [look], still, no_air, 0.0, table, None)
        antenna = radiation_map(quiet_air, r, np.full_like(ground, 300.0))[0][0]
        slow_scan = best_of(3, lambda f=f, a=antenna, i=made[-1]: naive_image(f, a, i))
        quiet = still_radiometer(s, r, load_emissivity_table(), seed=1, run_id=1, precision=precision)
        difference = np.abs(naive_image(f, antenna, quiet)[0] - quiet.mean_k[0])
        scans_apart = float(np.nanquantile(difference, 0.9))
        t, both = kernel["plain"], slow + slow_scan
        rows.append(
            f"| {precision} | cell kernel | {t * 1e3:.2f} | {slow * 1e3:.0f} | {slow / t:.0f} | {apart:.2g} K |"
        )
        rows.append(f"| {precision} | cell kernel, 17 moistures | {kernel['moist'] * 1e3:.2f} | | | |")
        rows.append(f"| {precision} | radiation map | {whole['plain'] * 1e3:.1f} | | | |")
        ours_theirs = f"{image * 1e3:.1f} | {both * 1e3:.0f} | {both / image:.0f} | {scans_apart:.2g} K |"
        rows.append(f"| {precision} | whole image | {ours_theirs}")
    text = f"""# Speed of the radiometer engine

Written by `python tests/benchmarks/bench_prm.py --write` with numpy {np.__version__}, load average
{os.getloadavg()[0]:.1f} on {os.cpu_count()} cores: CPU time of one thread, best of several, {n} x {m} cells, one
channel, 100 m of relief. The numpy version is straightforward: whole arrays for the cells, a loop over footprints with
a window of cells each for the scan. It works in float64 whatever the type of its input; its search for the nearest
footprint is spared fifteen sixteenths of the footprints. "Apart" is how far the two lie from each other (quantile
0.999 of cells, 0.9 of footprints; numpy puts cells where they are seen as points, the engine by their exact overlap).

| precision | part | package [ms] | numpy [ms] | ratio | apart |
|---|---|---|---|---|---|
{chr(10).join(rows)}

Production images are made in float32. Beside the cell kernel an image takes the sums over footprints, the displacement
by relief, the registration of cells and their temperature.
"""
    print(text)
    if write:
        (Path(__file__).parents[2] / "reports" / "performance-radiometer.md").write_text(text, encoding="utf-8")


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
