"""Pictures as files: greytone PNG, terrain-corrected GeoTIFF, and everything as npz."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from seqrsm.arrays import AnyArray, BoolArray
from seqrsm.campaign.pictures import Picture, greytones
from seqrsm.errors import Problem, UserError
from seqrsm.scene.scene import Scene
from seqrsm.simulate.radar.result import rectangular

_MODEL_PIXEL_SCALE, _MODEL_TIEPOINT, _GEO_KEYS = 33550, 33922, 34735
_PROJECTED_CS_KEY = 3072


def write_png(out: Path, picture: Picture, scene: Scene, settings: Mapping[str, float | str]) -> None:
    """Grey image of the first channel, or a composite of three (red, green, blue in the order of the channels).

    Grey tones of more than 8 bits that the sensor asks for are written as 16 bits, where there is one channel.
    """
    del scene
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    tones = greytones(picture) if picture.levels is None else _shown_levels(picture)
    shown = np.moveaxis(tones, 0, -1) if len(tones) == 3 else tones[0]
    note = PngInfo()
    note.add_text("seqrsm settings", json.dumps(dict(settings)))
    _write(out, lambda: Image.fromarray(np.ascontiguousarray(shown)).save(out, pnginfo=note))


def _shown_levels(picture: Picture) -> AnyArray:
    """Levels of a calibrated picture spread over 8 or 16 bits: black is 0, white the greatest level."""
    assert picture.levels is not None
    deep = picture.n_bits > 8 and len(picture.levels) != 3
    top = 65535.0 if deep else 255.0
    planes = picture.levels * (top / (2.0**picture.n_bits - 1.0))
    if picture.arrange is not None:
        planes = np.nan_to_num(rectangular(planes, picture.arrange), nan=0.0)
    return np.asarray(np.rint(planes), dtype=np.uint16 if deep else np.uint8)


def write_mask(out: Path, name: str, mask: BoolArray, scene: Scene, settings: Mapping[str, float | str]) -> None:
    """A mask on the scene's own grid: 255 where it holds, else 0; PNG, GeoTIFF or npz."""
    from PIL import Image

    layer = np.where(mask, np.uint8(255), np.uint8(0))
    if out.suffix.lower() == ".png":
        _write(out, lambda: Image.fromarray(layer).save(out))
    elif out.suffix.lower() == ".npz":
        arrays: dict[str, Any] = {name: mask, "settings": np.array(json.dumps(dict(settings)))}
        _write(out, lambda: np.savez_compressed(out, **arrays))
    else:
        _write_layers(out, layer[None], scene, {"quantity": name, "unit": "", "settings": dict(settings)})


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
    told = picture.told().reshape(len(picture.values), -1).astype(np.float32)
    pixel = picture.pixel_of_cell
    layers = np.empty((len(told), *pixel.shape), dtype=np.float32)
    for row in range(len(pixel)):  # row by row: a scene of 10,000 x 10,000 cells takes no work space
        layers[:, row] = np.where(pixel[row] >= 0, told[:, pixel[row]], np.nan)
    note = {
        "quantity": picture.quantity,
        "unit": picture.unit,
        "channels": list(picture.channels),
        "settings": dict(settings),
    }
    _write_layers(out, layers, scene, note)


def _write_layers(out: Path, layers: AnyArray, scene: Scene, note: Mapping[str, Any]) -> None:
    """Layers (n, rows, cols) of the scene's own grid as GeoTIFF."""
    import tifffile

    left, _, _, top = scene.bounds or (0.0, 0.0, 0.0, 0.0)
    tags: list[tuple[int, str, int, Any, bool]] = [
        (_MODEL_PIXEL_SCALE, "d", 3, (scene.cell_m, scene.cell_m, 0.0), True),
        (_MODEL_TIEPOINT, "d", 6, (0.0, 0.0, 0.0, left, top, 0.0), True),
    ]
    if scene.epsg is not None:
        # GTModelType = projected, GTRasterType = pixel is area, ProjectedCSType = EPSG code.
        keys = (1, 1, 0, 3, 1024, 0, 1, 1, 1025, 0, 1, 1, _PROJECTED_CS_KEY, 0, 1, scene.epsg)
        tags.append((_GEO_KEYS, "H", len(keys), keys, True))
    _write(
        out,
        lambda: tifffile.imwrite(
            out,
            layers,
            photometric="minisblack",
            planarconfig="separate" if len(layers) > 1 else None,
            extratags=tags,
            description=json.dumps(dict(note)),
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
