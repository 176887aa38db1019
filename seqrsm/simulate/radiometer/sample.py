"""Some footprints of a radiometer's image without the image: the cheaper rungs of the fidelity ladder.

Rungs F0 and F2 take single footprints, the beam of each as equally weighted points: F0 of flat ground, F2 of the ground
as it lies, each cell where the antenna sees it. F3 is the whole image. All draw the same occasion as the full image of
that run; the receiver's noise is drawn as often as asked for. There are no strips: beams reach over several lines to
either side, so that a strip would need more ground than it scores.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from typing import Any, Final

import numpy as np

from seqrsm.arrays import AnyArray, BoolArray, FloatArray, IntArray
from seqrsm.rng import generator
from seqrsm.scattering.atmosphere import radiation_equivalent_k
from seqrsm.scattering.emissivity import EmissivityTable
from seqrsm.scene.scene import Scene
from seqrsm.sensor.radiometer import RadiometerConfiguration
from seqrsm.sensor.scan import BEAM_STEPS_A_WIDTH
from seqrsm.simulate import kernels_sample
from seqrsm.simulate.fidelity import RungPlan
from seqrsm.simulate.radiometer import kernels_prm
from seqrsm.simulate.radiometer.frame import RadiometerFrame, surface_temperature_k
from seqrsm.simulate.radiometer.prm import Meeting, emission_tables, row_geometry, simulate_radiometer
from seqrsm.simulate.radiometer.result import RadiometerImage
from seqrsm.simulate.sample import Sample, places

BEAM_POINTS: Final = (21, 34, 55, 89, 144, 233, 377)
"""Points of equal weight that may stand for a beam: Fibonacci's numbers."""


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
    if rung.rung != "F3":
        return _point_sample(scene, radiometer, met, rung, seed, run_id)
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


def _point_sample(
    scene: Scene, radiometer: RadiometerConfiguration, met: Meeting, rung: RungPlan, seed: int, run_id: int
) -> Sample:
    """Footprints where some lines cross some directions of the sweep, the beam of each as points of equal weight."""
    frame, scan = met.frame, met.scan
    relief = rung.rung != "F0"
    draw = generator(seed, run_id, "strips")
    start = draw.random(2)
    line = places(scan.n_lines, rung.columns, float(start[0]))
    sample = places(len(scan.look_rad), rung.rows, float(start[1]))
    look = scan.look_rad[sample]
    n_s, n_l, n_p = len(sample), len(line), rung.points
    u, v = (lattice(n_p)[:, None] + draw.random((2, n_s))[:, :, None]) % 1.0
    angle = look[:, None] + scan.beamwidth_rad * _quantiles(scan.across, u)
    point_m = np.asarray(frame.height_m * np.tan(np.clip(angle, -1.5, 1.5)).ravel(), dtype=np.float64)
    # A line is the mean of its sweeps: each takes its part of the points.
    sweep = np.minimum(line * scan.sweeps_a_line + np.arange(n_p)[:, None] % scan.sweeps_a_line, scan.n_sweeps - 1)
    part = np.clip(0.5 + 0.5 * angle / scan.half_angle_rad, 0.0, 1.0)[:, :, None]
    back = sweep % 2 == 1  # every other sweep runs the other way
    along = np.where(back, -scan.sweep_advance_m, scan.sweep_advance_m) * part + scan.sweep_advance_m * (sweep + back)
    along += (radiometer.resolution_m / np.cos(angle) * _quantiles(scan.along, v))[:, :, None]
    at, seen = _seen(frame, met, point_m, along.reshape(n_s * n_p, n_l), relief=relief)
    antenna = _radiation(scene, radiometer, met, point_m, at, seen, relief=relief)
    sums = antenna.reshape(-1, n_s, n_p, n_l).sum(axis=2, dtype=np.float64)
    points = seen.reshape(n_s, n_p, n_l).sum(axis=1, dtype=np.int32)
    mean = np.where(points > 0, sums / np.maximum(points, 1), np.nan)
    if met.planck_k > 0.0:
        mean = met.planck_k / np.log1p(met.planck_k / mean)
    # An element's nearest line is the one of which it lies within the way flown, wherever the sweep is.
    # The outermost footprints stand for what the sweep sees beyond them, too.
    half, past = 0.5 * scan.step_rad, scan.half_angle_rad + 0.5 * scan.beamwidth_rad
    left = np.where(sample == 0, np.minimum(look - half, -past), look - half)
    right = np.where(sample == len(scan.look_rad) - 1, np.maximum(look + half, past), look + half)
    low, high = (frame.height_m * np.tan(np.clip(edge, -1.5, 1.5)) for edge in (left, right))
    phase = draw.random(2)
    cells = math.ceil(math.sqrt(n_p))  # along each side, so that shares of covers are known as well as the beam's
    rows, inside_rows = _boxed(low, high, frame, 0, cells, float(phase[0]))
    ahead = (line * scan.advance_m, (line + 1) * scan.advance_m)
    columns, inside_columns = _boxed(*ahead, frame, 1, cells, float(phase[1]))
    of_row, of_column = (np.nonzero(inside)[0] for inside in (inside_rows, inside_columns))
    shape = (of_row.size, of_column.size)
    cover, field = np.empty(shape, dtype=frame.cover.dtype), np.empty(shape, dtype=frame.field.dtype)
    scored, pixel = np.empty(shape, dtype=np.bool_), np.empty(shape, dtype=np.int32)
    kernels_sample.label_cells(
        frame.elevation_m,
        frame.cover,
        frame.field,
        np.ascontiguousarray(np.rot90(scene.scored, frame.quarter_turns)),
        len(met.lookups[0].categories),
        frame.height_m,
        frame.cell_m,
        relief,
        rows[inside_rows],
        columns[inside_columns],
        of_row,
        of_column,
        n_l,
        cover,
        field,
        scored,
        pixel,
    )
    return Sample(
        values=_noisy(mean, radiometer, rung.draws, seed, run_id),
        **_grid(met, np.repeat(sample, n_l), np.tile(line, n_s)),
        column=np.arange(n_s * n_l),
        share=n_s * n_l / (len(scan.look_rad) * scan.n_lines),
        pixel_of_cell=pixel,
        cover=cover,
        field=field,
        scored=scored,
        moist=met.lookups[0].moist,
        occasion=met.occasion,
        record=_record(scene, radiometer, met, mean),
    )


def _seen(
    frame: RadiometerFrame, met: Meeting, place_m: AnyArray, along_m: AnyArray, *, relief: bool
) -> tuple[tuple[AnyArray, AnyArray], BoolArray]:
    """Cell that is seen in each direction (a, b), and whether there is any."""
    rows, columns = np.empty(along_m.shape, dtype=np.intp), np.empty(along_m.shape, dtype=np.intp)
    seen = np.empty(along_m.shape, dtype=np.bool_)
    kernels_prm.see_points(
        frame.elevation_m,
        frame.cover,
        len(met.lookups[0].categories),
        frame.height_m,
        frame.cell_m,
        relief,
        place_m,
        np.ascontiguousarray(along_m),
        rows,
        columns,
        seen,
    )
    return (rows, columns), seen


def _radiation(
    scene: Scene,
    radiometer: RadiometerConfiguration,
    met: Meeting,
    place_m: FloatArray,
    at: tuple[AnyArray, AnyArray],
    seen: BoolArray,
    *,
    relief: bool,
) -> AnyArray:
    """Antenna temperature (n_channels, a, b) that single cells give [K]; `seen` loses those that face away."""
    frame = met.frame
    # The temperature asks the elevations for their shape and precision only: they are not gathered.
    unread = np.empty(seen.shape, dtype=frame.elevation_m.dtype)
    cell = at[0] * frame.cover.shape[1] + at[1]
    gathered = replace(frame, elevation_m=unread, cover=frame.cover.take(cell), field=frame.field.take(cell))
    ground_k = surface_temperature_k(scene, gathered, radiometer, met.lookups[0], met.occasion, at=cell)
    if met.planck_k > 0.0:
        ground_k = radiation_equivalent_k(ground_k, met.planck_k).astype(ground_k.dtype)
    out = np.empty((len(met.lookups), *seen.shape), dtype=ground_k.dtype)
    kernels_prm.emit_points(
        frame.elevation_m,
        *at,
        seen,
        gathered.cover,
        gathered.field,
        ground_k,
        row_geometry(place_m, frame, met.air, scattered=True),
        frame.height_m,
        frame.cell_m,
        relief,
        *emission_tables(met.lookups, met.air, met.occasion, ground_k.dtype),
        out,
    )
    return out


def lattice(n: int) -> FloatArray:
    """Fibonacci's lattice (2, n) of the unit square, n one of `BEAM_POINTS`; shifted at random it is unbiased."""
    before = {b: a for a, b in pairwise((13, *BEAM_POINTS))}
    k = np.arange(n)
    return np.stack([k / n, k * before[n] % n / n])


def _quantiles(integral: FloatArray, share: FloatArray) -> FloatArray:
    """Where a beam's running integral reaches a share [beamwidths]."""
    reach = 0.5 * (len(integral) - 1) / BEAM_STEPS_A_WIDTH
    return np.interp(share, integral, np.linspace(-reach, reach, len(integral)))


def _boxed(
    low_m: AnyArray, high_m: AnyArray, frame: RadiometerFrame, axis: int, least: int, phase: float
) -> tuple[IntArray, BoolArray]:
    """Cells whose middle lies nearest to each footprint: of all or of every so many-th, so that each counts alike.

    ``least``: cells along the shortest side at least, where there are so many.
    """
    size = frame.elevation_m.shape[axis]
    middle = 0.5 * size if axis == 0 else 0.0
    low, high = low_m / frame.cell_m + middle, high_m / frame.cell_m + middle
    step = max(math.floor(float((high - low).min()) / least), 1)
    start = math.floor(phase * step)
    count = math.ceil(float((high - low).max()) / step) + 1
    first = start + step * np.ceil((low - 0.5 - start) / step).astype(np.int64)
    cell = first[:, None] + step * np.arange(count)
    inside = (cell >= 0) & (cell < size) & (cell + 0.5 < high[:, None])
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
