"""Some footprints of a radiometer's image without the image: the cheaper rungs of the fidelity ladder.

Rung F0 takes single footprints of flat ground, the beam as equally weighted points; F3 the whole image. Both draw the
same occasion as the full image of that run; the receiver's noise is drawn as often as asked for. There are no strips:
beams reach over several lines to either side, so that a strip would need more ground than it scores.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from seqrsm.arrays import AnyArray, BoolArray, FloatArray, IntArray
from seqrsm.rng import generator
from seqrsm.scattering.emissivity import EmissivityTable
from seqrsm.scene.scene import Scene
from seqrsm.sensor.radiometer import RadiometerConfiguration
from seqrsm.sensor.scan import BEAM_STEPS_A_WIDTH
from seqrsm.simulate import kernels_prm
from seqrsm.simulate.fidelity import RungPlan
from seqrsm.simulate.prm import Meeting, radiation_map, simulate_radiometer
from seqrsm.simulate.prm_frame import RadiometerFrame, surface_temperature_k
from seqrsm.simulate.prm_image import RadiometerImage
from seqrsm.simulate.sample import Sample, places

BEAM_POINTS = 8
"""Points of equal weight along each axis of the beam."""

_MOST_CELLS = 8


def radiometer_sample(
    scene: Scene,
    radiometer: RadiometerConfiguration,
    table: EmissivityTable,
    met: Meeting,
    rung: RungPlan,
    *,
    seed: int,
    run_id: int,
) -> Sample:
    """The footprints that a rung below the top looks at."""
    if rung.rung == "F0":
        return _flat_sample(scene, radiometer, met, rung, seed, run_id)
    image = simulate_radiometer(scene, radiometer, table, seed=seed, run_id=run_id)
    return _whole(scene, image, met, rung.draws, seed, run_id)


def _noisy(mean: FloatArray, radiometer: RadiometerConfiguration, draws: int, seed: int, run_id: int) -> FloatArray:
    """Brightness (n_draws, n_channels, n_pixels) with as many draws of the receiver's noise [K]."""
    flat = mean.reshape(len(mean), -1)
    normal = generator(seed, run_id, "receiver noise of draws").standard_normal((draws, *flat.shape))
    return np.asarray(flat + radiometer.nedt_k(flat) * normal)


def _whole(scene: Scene, image: RadiometerImage, met: Meeting, draws: int, seed: int, run_id: int) -> Sample:
    """Every footprint of an image."""
    mean = image.mean_k.astype(np.float64)
    n_samples, n_lines = mean.shape[1:]
    sample, line = np.divmod(np.arange(n_samples * n_lines), n_lines)
    return Sample(
        values=_noisy(mean, image.radiometer, draws, seed, run_id),
        **_grid(met, sample, line),
        column=line,
        share=1.0,
        pixel_of_cell=image.pixel_of_cell,
        cover=scene.cover,
        field=scene.field_id,
        scored=scene.scored,
        moist=met.lookups[0].moist,
        occasion=met.occasion,
        record=image.record(scene.categories),
    )


def _grid(met: Meeting, sample: IntArray, line: FloatArray | IntArray) -> dict[str, Any]:
    """Places of footprints by their number in a line and their line."""
    scan = met.scan
    half = 0.5 * len(met.frame.elevation_m) * met.frame.cell_m
    look = scan.look_rad[sample]
    away = scan.height_m * np.tan(np.clip(look, -1.5, 1.5))
    return {
        "looks": np.ones(len(look)),
        "across_m": np.clip(away, -half, half) + half,
        "along_m": (line + 0.5) * scan.advance_m,
        "extent_m": (2.0 * half, (scan.n_lines - 0.5) * scan.advance_m),
        "covariates": np.square(look)[:, None],
    }


def _gathered(frame: RadiometerFrame, at: tuple[AnyArray, AnyArray], across_m: FloatArray) -> RadiometerFrame:
    """Cells of a frame as a frame of their own."""
    return RadiometerFrame(
        np.ascontiguousarray(frame.elevation_m[at]),
        np.ascontiguousarray(frame.cover[at]),
        np.ascontiguousarray(frame.field[at]),
        across_m,
        frame.height_m,
        frame.cell_m,
        frame.quarter_turns,
    )


def _flat_sample(
    scene: Scene, radiometer: RadiometerConfiguration, met: Meeting, rung: RungPlan, seed: int, run_id: int
) -> Sample:
    """Single footprints of flat ground."""
    frame, scan = met.frame, met.scan
    start = generator(seed, run_id, "strips").random(2)
    line = places(scan.n_lines, rung.columns, float(start[0]))
    sample = places(len(scan.look_rad), rung.rows, float(start[1]))
    look = scan.look_rad[sample]
    n_s, n_l, n_p = len(sample), len(line), BEAM_POINTS
    row = _cells(scan.height_m * np.tan(look[:, None] + scan.beamwidth_rad * _quantiles(scan.across)), frame, 0)
    widths = radiometer.resolution_m / np.cos(look)
    centre = (line + 0.5) * scan.advance_m
    column = _cells(centre[None, :, None] + widths[:, None, None] * _quantiles(scan.along), frame, 1)
    at = (
        np.broadcast_to(row[:, :, None, None], (n_s, n_p, n_l, n_p)).reshape(n_s * n_p, n_l * n_p),
        np.broadcast_to(column[:, None], (n_s, n_p, n_l, n_p)).reshape(n_s * n_p, n_l * n_p),
    )
    gathered = _gathered(frame, at, frame.across_m[row.ravel()])
    ground_k = surface_temperature_k(scene, gathered, radiometer, met.lookups[0], met.occasion, at=at)
    flat = replace(gathered, elevation_m=np.zeros_like(gathered.elevation_m))
    mapped = radiation_map(flat, radiometer, met.lookups, met.air, ground_k, met.occasion, met.planck_k)
    seen = ((mapped.state & kernels_prm.NO_DATA) == 0).reshape(n_s, n_p, n_l, n_p)
    sums = (mapped.antenna_k.reshape(-1, n_s, n_p, n_l, n_p) * seen).sum(axis=(2, 4), dtype=np.float64)
    points = seen.sum(axis=(1, 3))
    mean = np.where(points > 0, sums / np.maximum(points, 1), np.nan)
    if met.planck_k > 0.0:
        mean = met.planck_k / np.log1p(met.planck_k / mean)
    rows, inside_rows = _boxed(
        scan.height_m * np.tan(look), scan.height_m * scan.step_rad / np.cos(look) ** 2, frame, 0
    )
    columns, inside_columns = _boxed(centre, np.full(n_l, scan.advance_m), frame, 1)
    inside = inside_rows.ravel()[:, None] & inside_columns.ravel()[None, :]
    own = np.ix_(rows.ravel(), columns.ravel())
    number = np.repeat(np.arange(n_s), rows.shape[1])[:, None] * n_l + np.repeat(np.arange(n_l), columns.shape[1])
    return Sample(
        values=_noisy(mean, radiometer, rung.draws, seed, run_id),
        **_grid(met, np.repeat(sample, n_l), np.tile(line, n_s)),
        column=np.arange(n_s * n_l),
        share=n_s * n_l / (len(scan.look_rad) * scan.n_lines),
        pixel_of_cell=np.where(inside, number, -1).astype(np.int32),
        cover=frame.cover[own],
        field=frame.field[own],
        scored=np.rot90(scene.scored, frame.quarter_turns)[own],
        moist=met.lookups[0].moist,
        occasion=met.occasion,
        record=_record(scene, radiometer, met, mean),
    )


def _quantiles(integral: FloatArray) -> FloatArray:
    """Middles of equal parts of a beam's weight [beamwidths]."""
    reach = 0.5 * (len(integral) - 1) / BEAM_STEPS_A_WIDTH
    u = np.linspace(-reach, reach, len(integral))
    return np.interp((np.arange(BEAM_POINTS) + 0.5) / BEAM_POINTS, integral, u)


def _cells(place_m: FloatArray, frame: RadiometerFrame, axis: int) -> IntArray:
    """Number of the cell at a distance from nadir (axis 0) or from the beginning (axis 1), held at the edges."""
    size = frame.elevation_m.shape[axis]
    middle = 0.5 * size if axis == 0 else 0.0
    return np.clip(np.floor(place_m / frame.cell_m + middle).astype(np.int64), 0, size - 1)


def _boxed(centre_m: AnyArray, size_m: AnyArray, frame: RadiometerFrame, axis: int) -> tuple[IntArray, BoolArray]:
    """Cells whose middle lies nearest to each footprint, thinned out where they are many."""
    size = frame.elevation_m.shape[axis]
    middle = 0.5 * size if axis == 0 else 0.0
    low = (centre_m - 0.5 * size_m) / frame.cell_m + middle
    long = size_m / frame.cell_m
    step = max(math.ceil(float(long.max()) / _MOST_CELLS), 1)
    count = math.ceil(float(long.max()) / step) + 1
    cell = np.ceil(low - 0.5).astype(np.int64)[:, None] + step * np.arange(count)
    inside = (cell >= 0) & (cell < size) & (cell + 0.5 < (low + long)[:, None])
    return np.clip(cell, 0, size - 1), inside


def _record(scene: Scene, radiometer: RadiometerConfiguration, met: Meeting, mean: FloatArray) -> dict[str, Any]:
    """What is kept with a score: plain numbers and names."""
    scan = met.scan
    nedt = radiometer.nedt_k(mean)
    return {
        "engine": "prm",
        "mode": radiometer.mode,
        "nedt_k": [round(float(np.nanmedian(layer)), 4) for layer in nedt],
        "beamwidth_deg": round(math.degrees(scan.beamwidth_rad), 5),
        "lines_and_samples": [scan.n_lines, len(scan.look_rad)],
        "advance_m": round(scan.advance_m, 4),
        "dwell_ms": round(scan.dwell_ms, 5) if math.isfinite(scan.dwell_ms) else None,
        "smear_beams": round(scan.smear, 5),
        "occasion": dict(met.occasion.record(radiometer.channels, scene.categories)),
        "scan_notes": list(scan.notes),
    }
