"""Radar images as files: greytone PNG, terrain-corrected GeoTIFF, and everything as npz."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from seqrsm.arrays import AnyArray
from seqrsm.errors import Problem, UserError
from seqrsm.scene.scene import Scene
from seqrsm.simulate.psm import RadarImage
from seqrsm.simulate.receiver import film_density, greytone, to_levels
from seqrsm.units import linear_to_db

_MODEL_PIXEL_SCALE, _MODEL_TIEPOINT, _GEO_KEYS = 33550, 33922, 34735
_PROJECTED_CS_KEY = 3072


def image_greytones(image: RadarImage) -> AnyArray:
    """Grey tones of every channel by RSL TR 380-1 eq. (3-18), uint8 (channels, range, azimuth).

    The calibration pair puts the channel's median in the middle of the scale, so that half the dynamic range lies on
    either side of it. Film with gamma = 1; a pixel without any power is black.
    """
    radar = image.radar
    sigma0 = image.apparent_sigma0()
    planes = []
    for plane in sigma0:
        lit = plane[plane > 0.0]
        middle = float(np.median(lit)) if lit.size else 1.0
        with np.errstate(divide="ignore"):
            density = film_density(plane)
        darkest = float(np.log10(middle)) - 0.05 * radar.dynamic_range_db
        tone = greytone(density, darkest, 0.0, radar.n_bits, radar.dynamic_range_db)
        planes.append(to_levels(tone * (255.0 / (2**radar.n_bits - 1)), 8))
    return np.stack(planes)


def write_png(out: Path, image: RadarImage, scene: Scene, settings: Mapping[str, float | str]) -> None:
    """Grey image of the first channel, or a colour composite of three (red HH, green HV, blue VV)."""
    del scene
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    tones = image_greytones(image)
    picture = np.moveaxis(tones, 0, -1) if len(tones) == 3 else tones[0]
    note = PngInfo()
    note.add_text("seqrsm settings", json.dumps(dict(settings)))
    _write(out, lambda: Image.fromarray(np.ascontiguousarray(picture)).save(out, pnginfo=note))


def write_npz(out: Path, image: RadarImage, scene: Scene, settings: Mapping[str, float | str]) -> None:
    """All arrays of the image; names and units as in `RadarImage`."""
    arrays: dict[str, Any] = {
        "intensity_w": image.intensity,
        "mean_power_w": image.mean_power,
        "noise_power_w": image.noise_power_w,
        "looks": image.looks,
        "noise_equivalent_sigma0": image.noise_equivalent_sigma0,
        "slant_range_m": image.slant_range_m,
        "ground_range_m": image.ground_range_m,
        "incidence_angle_deg": image.incidence_angle_deg,
        "pixel_of_cell": image.pixel_of_cell,
        "shadow": image.shadow,
        "layover": image.layover,
        "channels": np.array(image.radar.channels),
        "scene": np.array(scene.name),
        "settings": np.array(json.dumps(dict(settings))),
    }
    _write(out, lambda: np.savez_compressed(out, **arrays))


def write_geotiff(out: Path, image: RadarImage, scene: Scene, settings: Mapping[str, float | str]) -> None:
    """Apparent sigma0 [dB] on the scene's own grid, terrain corrected; nan where the scene has no data."""
    import tifffile

    decibels = linear_to_db(image.apparent_sigma0().astype(np.float64)).reshape(len(image.intensity), -1)
    known = image.pixel_of_cell >= 0
    layers = np.full((len(decibels), *known.shape), np.nan, dtype=np.float32)
    layers[:, known] = decibels[:, image.pixel_of_cell[known]]
    left, _, _, top = scene.bounds or (0.0, 0.0, 0.0, 0.0)
    tags: list[tuple[int, str, int, Any, bool]] = [
        (_MODEL_PIXEL_SCALE, "d", 3, (scene.cell_m, scene.cell_m, 0.0), True),
        (_MODEL_TIEPOINT, "d", 6, (0.0, 0.0, 0.0, left, top, 0.0), True),
    ]
    if scene.epsg is not None:
        # GTModelType = projected, GTRasterType = pixel is area, ProjectedCSType = EPSG code.
        keys = (1, 1, 0, 3, 1024, 0, 1, 1, 1025, 0, 1, 1, _PROJECTED_CS_KEY, 0, 1, scene.epsg)
        tags.append((_GEO_KEYS, "H", len(keys), keys, True))
    note = json.dumps({"unit": "dB", "channels": list(image.radar.channels), "settings": dict(settings)})
    _write(
        out,
        lambda: tifffile.imwrite(
            out,
            layers,
            photometric="minisblack",
            planarconfig="separate",
            extratags=tags,
            description=note,
            metadata=None,
        ),
    )


def _write(out: Path, action: Any) -> None:
    try:
        action()
    except OSError as error:
        raise UserError(
            Problem(f"cannot write the file: {error.strerror}", "Name another file.", file=str(out))
        ) from error
