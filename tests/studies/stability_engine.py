"""Single against double precision of the radar and radiometer engines, at the extremes of what they accept."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parents[1] / "physics"))
import prm_cases
import psm_cases
from shorthands import percent_correct, still_radiometer
from synthetic import synthetic_scene

from seqrsm.errors import UserError
from seqrsm.rng import stream_key
from seqrsm.scene.scene import Scene
from seqrsm.simulate.radar.fading import gamma_tables, normal_table
from seqrsm.simulate.radar.kernels_speckle import add_speckle, work_lines
from seqrsm.simulate.radar.psm import simulate_radar

CATEGORIES = ("class 0", "class 1", "class 2")
SIDE = 200
CELL_M = 10.0


@dataclass
class Row:
    """One case: place on its axis, differences of single from double precision, what the program said."""

    study: str
    x: float
    values: dict[str, float] = field(default_factory=dict)
    does: str = ""


def rolling(relief_m: float = 60.0) -> Scene:
    """Fields on hills of 2 km by 2 km."""
    return synthetic_scene(SIDE, SIDE, CELL_M, categories=CATEGORIES, field_m=150.0, relief_m=relief_m, seed=4)


def relative(single: np.ndarray, double: np.ndarray) -> dict[str, float]:
    """Median, 99 % and largest relative difference where there is power at all."""
    double = np.asarray(double, dtype=np.float64)
    lit = double > 0.0
    if not lit.any():
        return {}
    error = np.abs(np.asarray(single, dtype=np.float64)[lit] - double[lit]) / double[lit]
    return {"median": float(np.median(error)), "99 %": float(np.quantile(error, 0.99)), "largest": float(error.max())}


def radar_row(study: str, x: float, scene: Scene, table: object, **changes: object) -> Row:
    """Images of both precisions, speckle and occasion drawn alike."""
    row = Row(study, x)
    try:
        given = psm_cases.radar(**changes)
        one, two = (
            simulate_radar(scene, given, table, seed=1, run_id=1, precision=p)  # type: ignore[arg-type]
            for p in ("float32", "float64")
        )
    except UserError as error:
        row.does = f"refuses: {error.problems[0]}"
        return row
    row.values = relative(one.mean_power, two.mean_power)
    row.values |= {f"with noise, {k}": v for k, v in relative(one.intensity, two.intensity).items()}
    row.values["shadow flips"] = float(np.mean(one.shadow != two.shadow))
    row.values["shadow"] = float(np.mean(two.shadow))
    a, b = (percent_correct([image], scene, seed=1, run_id=1).value for image in (one, two))
    row.values["score difference"] = abs(a - b)
    row.values["weakest power [W]"] = float(two.mean_power[two.mean_power > 0.0].min(initial=np.inf))
    row.does = "; ".join(note for note in two.notes if "made" not in note)
    return row


def altitude() -> Iterator[Row]:
    """Radar from 100 m over the hills to beyond the highest satellite orbits accepted."""
    scene, table = rolling(), psm_cases.Table((-8.0, -11.0, -14.0), 0.1)
    for h in (30, 100, 300, 1e3, 3e3, 1e4, 3e4, 1e5, 3e5, 7e5, 2e6, 5e6):
        yield radar_row("radar altitude [m]", h, scene, table, altitude_m=float(h), peak_power_w=100.0)


def incidence() -> Iterator[Row]:
    """Incidence from nadir to 89.9 deg, from orbit where steep and from low altitude where grazing.

    So the scene of 2 km lies neither behind nadir nor beyond the horizon.
    """
    scene, table = rolling(), psm_cases.Table((-8.0, -11.0, -14.0), 0.1)
    for theta in (0.0, 0.3, 0.5, 1.0, 3.0, 10.0, 20.0, 30.0, 45.0, 60.0, 75.0, 85.0, 88.0, 89.0, 89.5, 89.7, 89.9):
        bandwidth = min(7.5 / max(math.sin(math.radians(theta)), 1e-3) * 1.3, 1e4)
        yield radar_row(
            "radar incidence [deg]", theta, scene, table, depression_angle_deg=round(90.0 - theta, 6),
            bandwidth_mhz=bandwidth, altitude_m=7e5 if theta < 15.0 else 200.0 if theta > 80.0 else 6000.0,
        )  # fmt: skip


def dynamic_range() -> Iterator[Row]:
    """Weak fields beside strong ones: what is left of the weak ones far from any border, against the closed form."""
    cover = np.kron(np.tile([0, 1], (10, 5)), np.ones((20, 20), dtype=np.uint8)).astype(np.uint8)
    scene = psm_cases.scene(np.zeros(cover.shape), CELL_M, cover)
    strong, floor = psm_cases.Table((0.0, 0.0)), math.nan
    for contrast in range(0, 201, 10):
        weak = psm_cases.Table((0.0, -float(contrast)))
        row = Row("radar dynamic range [dB]", float(contrast), does="computes; the loss lies below the noise")
        for kind, resolution in (("whole pixels", 20.0), ("pixels of 2.5 cells", 25.0)):
            given = psm_cases.radar(fading="none", earth="flat", resolution_m=resolution)
            for precision in ("float32", "float64"):
                image, plain = (
                    simulate_radar(scene, given, table, seed=1, run_id=1, precision=precision)  # type: ignore[arg-type]
                    for table in (weak, strong)
                )
                # Pixels wholly inside weak fields: their power is that of a strong one less the contrast.
                pixel = _pure(image, scene)
                ratio = (image.mean_power[0].astype(float) / plain.mean_power[0])[pixel]
                error = float(np.max(np.abs(ratio * 10.0 ** (0.1 * contrast) - 1.0)))
                row.values[f"{kind}, {precision}"] = error
                floor = float(np.median(image.noise_power_w[:, None] / plain.mean_power[0]))
            # How far below the strong echo the error lies, and how far below it the noise of this radar.
            row.values[f"{kind}, error below strong [dB]"] = contrast - 10.0 * math.log10(error + 1e-300)
        row.values["noise below strong [dB]"] = -10.0 * math.log10(floor)
        yield row


def _pure(image: object, scene: Scene) -> np.ndarray:
    """Pixels (n_range, n_azimuth) all of whose cells, and those of their neighbours, are weak."""
    shape = image.mean_power.shape[1:]  # type: ignore[attr-defined]
    place = image.pixel_of_cell.ravel()  # type: ignore[attr-defined]
    seen = place >= 0
    weak = np.bincount(place[seen], scene.cover.ravel()[seen] == 1, minlength=shape[0] * shape[1])
    count = np.bincount(place[seen], minlength=shape[0] * shape[1])
    pure = ((count > 0) & (weak == count)).reshape(shape)
    inner = pure.copy()
    for axis in (0, 1):
        for step in (-1, 1):
            inner &= np.roll(pure, step, axis)
    inner[[0, -1]] = False
    inner[:, [0, -1]] = False
    return inner


def echo_level() -> Iterator[Row]:
    """Ever weaker echoes: transmitted power down to what single precision cannot hold."""
    scene, table = rolling(), psm_cases.Table((-8.0, -11.0, -14.0), 0.1)
    for exponent in range(9, -7, -1):
        row = radar_row(
            "radar echo level [W]", 10.0**exponent, scene, table, altitude_m=2e6, peak_power_w=10.0**exponent,
            antenna_gain_db=-10.0,
        )  # fmt: skip
        row.x = row.values.get("weakest power [W]", math.nan)
        yield row


def looks() -> Iterator[Row]:
    """Fading from one look to a million: moments against the gamma distribution, single against double precision."""
    n = 1000
    for shape in (1.0, 1.5, 2.0, 3.7, 10.0, 1e2, 1e3, 1e4, 1e5, 1e6, 1e9, 1e12):
        images = []
        for dtype in (np.float32, np.float64):
            out = np.empty((1, n, n), dtype=dtype)
            ones, key = np.ones((1, n, n), dtype=dtype), stream_key(1, 1, "speckle")
            given = np.full(n, shape**-0.5), np.array([0]), normal_table(), *key, 0, out, *work_lines(n)
            add_speckle(ones, np.zeros(n), *gamma_tables(np.full(n, shape)), *given)
            images.append(out.astype(np.float64))
        z = (images[1] - 1.0) * math.sqrt(shape)
        row = Row("radar looks", shape, relative(*images))
        row.values["mean, in its standard errors"] = float(abs(z.mean()) * n)
        # fourth moment of a gamma variate of mean 1: kurtosis 3 + 6/N
        row.values["variance, in its standard errors"] = float(abs(z.var() - 1.0) * n / math.sqrt(2.0 + 6.0 / shape))
        row.values["spread lost in float32"] = float(abs(images[0].std() / images[1].std() - 1.0))
        row.does = "computes"
        yield row


def radiometer_row(study: str, x: float, scene: Scene, table: object, **changes: object) -> Row:
    """Brightness in both precisions [K]."""
    row = Row(study, x)
    try:
        given = prm_cases.radiometer(atmosphere="us_standard", **changes)
        one, two = (
            still_radiometer(scene, given, table, seed=1, run_id=1, precision=p) for p in ("float32", "float64")
        )
    except UserError as error:
        row.does = f"refuses: {error.problems[0]}"
        return row
    seen = np.isfinite(two.mean_k) & np.isfinite(one.mean_k)
    error = np.abs(one.mean_k.astype(float) - two.mean_k)[seen]
    row.values = {
        "median [K]": float(np.median(error)),
        "99 % [K]": float(np.quantile(error, 0.99)),
        "largest [K]": float(error.max()),
        "noise [K]": float(np.nanmedian(two.nedt_k)),
        "blocked flips": float(np.mean(one.blocked != two.blocked)),
        "blocked": float(np.mean(two.blocked)),
        "seen flips": float(np.mean(np.isfinite(two.mean_k) != np.isfinite(one.mean_k))),
    }
    row.does = "; ".join(note for note in two.notes if "made" not in note)
    return row


def emissivities(low: float = 0.6) -> prm_cases.Table:
    return prm_cases.Table((lambda t: 0.95 - 0.001 * t, lambda t: low + 0.0 * t, lambda t: 0.9 - 0.002 * t))


def radiometer_altitude() -> Iterator[Row]:
    """Sweeps from edge to edge of 2 km: 89.9 deg from nadir at the lowest, a pencil at the highest."""
    scene = rolling(5.0)
    for h in (2.0, 7.0, 12.0, 20.0, 50.0, 100.0, 300.0, 1e3, 1e4, 1e5, 8e5, 2e6):
        yield radiometer_row(
            "radiometer altitude [m]", h, scene, emissivities(), altitude_m=h, resolution_m=min(50.0, 0.5 * h),
        )  # fmt: skip


def radiometer_angle() -> Iterator[Row]:
    """Sweeps that reach from 1 to 89.9 deg from nadir."""
    scene = rolling(30.0)
    for angle in (1.0, 10.0, 30.0, 45.0, 60.0, 75.0, 85.0, 88.0, 89.0, 89.5, 89.9, 90.0):
        yield radiometer_row(
            "radiometer sweep [deg]", angle, scene, emissivities(), scan_half_angle_deg=angle, altitude_m=200.0,
        )  # fmt: skip


def radiometer_contrast() -> Iterator[Row]:
    """Ground of emissivity 1 to 1e-6 beside warm ground."""
    scene = rolling()
    for exponent in range(7):
        low = 10.0**-exponent
        yield radiometer_row("radiometer least emissivity", low, scene, emissivities(min(low, 0.99)))


STUDIES = {
    "radar altitude [m]": altitude,
    "radar incidence [deg]": incidence,
    "radar looks": looks,
    "radar dynamic range [dB]": dynamic_range,
    "radar echo level [W]": echo_level,
    "radiometer altitude [m]": radiometer_altitude,
    "radiometer sweep [deg]": radiometer_angle,
    "radiometer least emissivity": radiometer_contrast,
}
