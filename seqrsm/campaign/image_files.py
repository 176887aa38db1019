"""Pictures as files: greytone PNG, terrain-corrected GeoTIFF, and everything as npz."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from seqrsm.campaign.pictures import Picture, greytones
from seqrsm.errors import Problem, UserError
from seqrsm.scene.scene import Scene

_MODEL_PIXEL_SCALE, _MODEL_TIEPOINT, _GEO_KEYS = 33550, 33922, 34735
_PROJECTED_CS_KEY = 3072


def write_png(out: Path, picture: Picture, scene: Scene, settings: Mapping[str, float | str]) -> None:
    """Grey image of the first channel, or a composite of three (red, green, blue in the order of the channels)."""
    del scene
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    tones = greytones(picture)
    shown = np.moveaxis(tones, 0, -1) if len(tones) == 3 else tones[0]
    note = PngInfo()
    note.add_text("seqrsm settings", json.dumps(dict(settings)))
    _write(out, lambda: Image.fromarray(np.ascontiguousarray(shown)).save(out, pnginfo=note))


def write_npz(out: Path, picture: Picture, scene: Scene, settings: Mapping[str, float | str]) -> None:
    """All arrays of the image; names with units."""
    arrays: dict[str, Any] = {
        **picture.arrays,
        "channels": np.array(picture.channels),
        "scene": np.array(scene.name),
        "settings": np.array(json.dumps(dict(settings))),
    }
    _write(out, lambda: np.savez_compressed(out, **arrays))


def write_geotiff(out: Path, picture: Picture, scene: Scene, settings: Mapping[str, float | str]) -> None:
    """The quantity on the scene's own grid, terrain corrected [dB or K]; nan where nothing is seen."""
    import tifffile

    told = picture.told().reshape(len(picture.values), -1)
    known = picture.pixel_of_cell >= 0
    layers = np.full((len(told), *known.shape), np.nan, dtype=np.float32)
    layers[:, known] = told[:, picture.pixel_of_cell[known]]
    left, _, _, top = scene.bounds or (0.0, 0.0, 0.0, 0.0)
    tags: list[tuple[int, str, int, Any, bool]] = [
        (_MODEL_PIXEL_SCALE, "d", 3, (scene.cell_m, scene.cell_m, 0.0), True),
        (_MODEL_TIEPOINT, "d", 6, (0.0, 0.0, 0.0, left, top, 0.0), True),
    ]
    if scene.epsg is not None:
        # GTModelType = projected, GTRasterType = pixel is area, ProjectedCSType = EPSG code.
        keys = (1, 1, 0, 3, 1024, 0, 1, 1, 1025, 0, 1, 1, _PROJECTED_CS_KEY, 0, 1, scene.epsg)
        tags.append((_GEO_KEYS, "H", len(keys), keys, True))
    note = json.dumps(
        {
            "quantity": picture.quantity,
            "unit": picture.unit,
            "channels": list(picture.channels),
            "settings": dict(settings),
        }
    )
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
