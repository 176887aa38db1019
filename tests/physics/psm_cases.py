"""Small scenes and tables whose echoes are known in closed form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import prm_cases
from shorthands import percent_correct

from seqrsm.jit import kernel
from seqrsm.scene.scene import Scene
from seqrsm.sensor.radar import RadarConfiguration
from seqrsm.simulate.radar import kernels
from seqrsm.simulate.radar.echo import LUT_STEPS, EchoGrid, echo_grid, out_of_order, paired_table, range_offset
from seqrsm.simulate.radar.frame import RadarFrame
from seqrsm.simulate.radar.psm import simulate_radar
from seqrsm.simulate.radar.result import RadarImage


@dataclass
class PowerMap:
    """What every element returns, by the rows of the kernel that adds them up.

    ``power`` (n_channels, n, m): sigma0 x surface area / cell area x (reference range / range)**4 x antenna pattern x
    atmosphere, both two-way and relative to their best; 0 where nothing returns. ``offset`` (n, m): range position
    minus that of flat ground in the same row [bins]. ``state`` (n, m): bits of shadow.
    """

    frame: RadarFrame
    grid: EchoGrid
    power: np.ndarray
    offset: np.ndarray
    state: np.ndarray

    @property
    def layover(self) -> np.ndarray:
        return out_of_order(self.offset, self.base[1:-1])

    @property
    def base(self) -> np.ndarray:
        return self.grid.base

    @property
    def reference_range_m(self) -> float:
        return self.grid.reference_range_m


@kernel
def power_cells(
    z,
    top,
    source,
    cover,
    field,
    geometry,
    rows,
    first,
    table,
    n_categories,
    field_factor,
    pattern,
    power,
    offset,
    state,
    w,
    pairs,
    index,
):
    """Power, position and state of every element by the rows of `kernels.sum_echoes`, which adds them up."""
    n = source.shape[0]
    steps = table.shape[1] // (n_categories + 1) - 1
    for begin in range(0, z.shape[1], kernels.STRIP):
        left, m = np.uint64(begin), np.uint64(min(kernels.STRIP, z.shape[1] - begin))
        for j in range(m):
            w[kernels._RAY + j] = top[source[0], left + j]
            w[kernels._OFFSET + j] = w[kernels._EDGE + j] = first[left + j]
        for i in range(n):
            row = source[i]
            kernels._slope_row(z, row, left, m, geometry[i, 9], w)
            kernels._facing_row(z, top, source[max(i - 1, 0)], row, source[min(i + 1, n - 1)], left, m, rows, i, w)
            for j in range(m):
                offset[i, left + j] = w[kernels._OFFSET + j]
            kernels._range_row(z, source[min(i + 1, n - 1)], left, m, rows, i, 0.0, 1.0, w)
            for j in range(m):
                state[i, left + j] = np.uint8(w[kernels._DARK + j])
            if pattern.shape[0] > 0:
                kernels._pattern_row(z, row, geometry, i, pattern, left, m, w)
            kernels._index_row(cover, row, n_categories, steps, left, m, index, w)
            for c in range(power.shape[0]):
                kernels._echo_row(table, index, field, row, field_factor, c, pairs, left, m, w)
                own = kernels._POWER + np.uint64(c * kernels._LINE)
                for j in range(m):
                    power[c, i, left + j] = w[own + j] * (w[kernels._HIGH + j] - w[kernels._LOW + j])


def power_map(frame: RadarFrame, radar: RadarConfiguration, lut: np.ndarray, field_factor: np.ndarray) -> PowerMap:
    """Geometry, propagation and mean power of every element; ``lut`` and ``field_factor`` as `echo_sums` takes them."""
    dtype = frame.elevation_m.dtype
    grid = echo_grid(frame, radar)
    shape = (len(frame.source), frame.elevation_m.shape[1])
    power = np.empty((lut.shape[0], *shape), dtype=dtype)
    offset = np.empty(shape, dtype=dtype)
    state = np.empty(shape, dtype=np.uint8)
    table = paired_table(lut, dtype)
    power_cells(
        frame.elevation_m,
        frame.top_m,
        frame.source,
        frame.cover,
        frame.field,
        grid.geometry,
        grid.rows.astype(dtype),
        range_offset(frame.elevation_m[frame.source[:1]], grid.geometry[:1], radar.range_format == "ground")[0],
        table,
        lut.shape[1],
        field_factor.astype(dtype),
        radar.pattern_lut().astype(dtype),
        power,
        offset,
        state,
        *kernels.work_lines(frame.elevation_m, table),
    )
    return PowerMap(frame, grid, power, offset, state)


@dataclass
class Lookup:
    sigma0: np.ndarray
    theta_deg: np.ndarray
    field_sd_db: np.ndarray
    date_sd_db: np.ndarray
    channel_correlation: float = 0.0
    notes: tuple = ()

    @property
    def closed(self):
        return np.ones_like(self.date_sd_db)

    def of_fields_db(self, theta_deg):  # noqa: ARG002
        return self.field_sd_db, np.zeros_like(self.field_sd_db)


@dataclass(eq=False)
class Table:
    """sigma0 in dB at 0 deg of each category, falling by a slope; no natural variability unless told."""

    level_db: tuple
    slope_db_deg: float = 0.0
    field_sd_db: float = 0.0
    date_sd_db: float = 0.0
    channel_correlation: float = 0.0

    def lookup(self, categories, frequency_ghz, polarization, *, season, wind_m_s, soil_moisture):  # noqa: ARG002
        theta = np.arange(91.0)
        n = len(categories)
        level = np.array(self.level_db[:n], dtype=float) - (6.0 if polarization == "HV" else 0.0)
        sigma0 = 10.0 ** (0.1 * (level[:, None] - self.slope_db_deg * theta))
        spread = np.full(n, self.field_sd_db)
        return Lookup(sigma0, theta, spread, np.full(n, self.date_sd_db), self.channel_correlation, ("made",))


def radar(**changes) -> RadarConfiguration:
    given = {
        "frequency_ghz": 5.3,
        "channels": ("VV",),
        "resolution_m": 20.0,
        "bandwidth_mhz": 50.0,
        "peak_power_w": 100.0,
        "depression_angle_deg": 45.0,
        "altitude_m": 6000.0,
        "texture_db": 0.0,
    }
    return RadarConfiguration(**{**given, **changes})


def scene(elevation, cell_m=5.0, *layers, **named) -> Scene:
    """As `prm_cases.scene`, of cells of 5 m."""
    return prm_cases.scene(elevation, cell_m, *layers, **named)


def frame(z, y0, height, cell, dtype=np.float64, curved=False) -> RadarFrame:
    """Frame of elevations about the datum, without margins, its first row at ground range ``y0``."""
    z = np.atleast_2d(np.asarray(z, dtype=dtype))
    y = y0 + np.arange(z.shape[0]) * cell
    return RadarFrame(
        elevation_m=z,
        top_m=z,
        cover=np.zeros(z.shape, dtype=np.uint8),
        field=np.zeros(z.shape, dtype=np.int32),
        mean_m=0.0,
        peak_m=float(z.max()),
        source=np.arange(z.shape[0]),
        ground_range_m=y,
        height_m=height,
        cell_m=cell,
        near_edge_m=y0 - 0.5 * cell,
        centre_m=0.5 * float(y[0] + y[-1]),
        pad_near=0,
        n_rows=z.shape[0],
        quarter_turns=0,
        curved=curved,
        cell_of_scene=None,
        lowest_m=z.min(axis=1),
        highest_m=z.max(axis=1),
    )


def lut_of(function) -> np.ndarray:
    """Look-up table of one channel and one category from sigma0(theta in rad)."""
    q = np.minimum(np.arange(LUT_STEPS + 2) / LUT_STEPS, 1.0) * np.sqrt(0.5)
    return np.asarray(function(2.0 * np.arcsin(q)), dtype=float)[None, None, :] * np.ones((1, 1, 1))


def mapped(z, y0, height, cell, configuration, dtype=np.float64, sigma0=lambda theta: 0.0 * theta + 0.1) -> PowerMap:
    return power_map(frame(z, y0, height, cell, dtype), configuration, lut_of(sigma0), np.ones((1, 1)))


def quiet(s, r, table=None, **options) -> RadarImage:
    """Image of even ground of -10 dB, or as a table has it."""
    return simulate_radar(s, r, table or Table((-10.0,)), seed=1, run_id=1, **options)


def small_score(run_id: int) -> float:
    """Percent correct of a small three-class scene in one run; importable by worker processes."""
    s = prm_cases.patchwork(5.0)
    table = Table((-8.0, -10.0, -12.0), 0.1, field_sd_db=1.0, date_sd_db=0.5, channel_correlation=0.5)
    image = simulate_radar(s, radar(channels=("HH", "HV"), resolution_m=15.0), table, seed=3, run_id=run_id)
    return percent_correct([image], s, seed=3, run_id=run_id).value
