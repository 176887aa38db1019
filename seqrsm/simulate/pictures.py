"""What a picture of either engine needs: one face for radar and radiometer images."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from seqrsm.arrays import AnyArray, BoolArray, FloatArray, IntArray
from seqrsm.files import put
from seqrsm.scene.scene import Scene
from seqrsm.simulate.radar.receiver import film_density, greytone, to_levels
from seqrsm.simulate.radar.receiver import picture as quantised_picture
from seqrsm.simulate.radar.result import RadarImage, rectangular, rectangular_pixels
from seqrsm.simulate.radiometer.result import RadiometerImage
from seqrsm.units import linear_to_db

_TAIL = 0.02
_LEAST_RATIO = {"dB": 4.0, "K": 1.02}


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """An image as it is shown."""

    channels: tuple[str, ...]

    values: FloatArray
    """(n_channels, n, m): positive linear quantity: apparent sigma0, or antenna temperature [K]; nan or 0 where nothing
    is seen."""
    quantity: str
    unit: str
    """What the values are, and the unit they are told in: "dB" (of the linear values) or "K"."""
    pixel_m: float
    """Ground size of a pixel, at nadir for a radiometer [m]."""
    n_bits: int
    """Bits of a grey tone."""
    pixel_of_cell: AnyArray
    """(rows, cols): pixel of each cell of the scene, -1 for none."""
    quarter_turns: int
    """``numpy.rot90(scene layer, quarter_turns)`` has the picture's orientation."""
    remark: str
    """What a caption says of this image."""
    arrays: Mapping[str, Any]
    """Everything worth keeping in a file, names with units."""
    arrange: IntArray | None = None
    """(height, width, points): pixels of `values` that each pixel shown looks at, where it is not shown as it is
    (plan-position indicator)."""
    levels: AnyArray | None = None
    """As `values`: grey tones of `n_bits` where the sensor says how they are made; None: as `greytones` finds good."""

    def told(self) -> FloatArray:
        """The values in ``unit``."""
        return linear_to_db(self.values) if self.unit == "dB" else self.values


@dataclass(frozen=True, slots=True)
class GreyScale:
    """Calibration of grey tones: the linear values that are black and white, logarithmic between; told in ``unit``."""

    black: float
    white: float
    unit: str

    def __str__(self) -> str:
        ends = (linear_to_db(x) if self.unit == "dB" else x for x in (self.black, self.white))
        return " to ".join(f"{x:.1f}".replace("-", "\u2212") for x in ends) + f" {self.unit}"


def picture_of(image: RadarImage | RadiometerImage) -> Picture:
    """The picture of an image of either engine."""
    return _radar_picture(image) if isinstance(image, RadarImage) else _radiometer_picture(image)


def _radar_picture(image: RadarImage) -> Picture:
    arrange, remark, more = None, "near range at the top", {}
    if image.radar.scan == "ppi":
        arrange, remark = rectangular_pixels(image), "north at the top"
        n_azimuth = image.intensity.shape[2]
        more = {
            "azimuth_deg": (np.arange(n_azimuth) + 0.5) * 360.0 / n_azimuth,
            "rectangular_intensity_w": rectangular(image.intensity, arrange),
        }
    radar = image.radar
    levels = quantised_picture(image)
    fewest, most = (f"{float(f'{looks:.3g}'):.7g}" for looks in (image.looks.min(), image.looks.max()))
    looks = f"{fewest} to {most} looks" if fewest != most else f"{most} look{'s' * (most != '1')}"
    return Picture(
        channels=radar.layers,
        values=image.apparent_sigma0().astype(np.float64),
        quantity="apparent sigma0",
        unit="dB",
        pixel_m=image.azimuth_spacing_m,
        n_bits=radar.n_bits,
        pixel_of_cell=image.pixel_of_cell,
        quarter_turns=image.quarter_turns,
        remark=f"{looks}; {remark}",
        arrange=arrange,
        levels=levels if radar.calibrated else None,
        arrays={
            **more,
            "film_density": film_density(image.intensity, radar.film_gamma, radar.film_k),
            "greytone": levels,
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
        },
    )


def _radiometer_picture(image: RadiometerImage) -> Picture:
    nedt = float(np.nanmedian(image.nedt_k))
    first = "first turn" if image.radiometer.conical else "left edge of the sweep"
    return Picture(
        channels=image.radiometer.channels,
        values=image.brightness_k.astype(np.float64),
        quantity="antenna temperature",
        unit="K",
        pixel_m=image.radiometer.resolution_m,
        n_bits=8,
        pixel_of_cell=image.pixel_of_cell,
        quarter_turns=image.quarter_turns,
        remark=f"receiver noise {nedt:.2g} K a footprint; {first} at the top",
        arrays={
            "brightness_k": image.brightness_k,
            "mean_k": image.mean_k,
            "nedt_k": image.nedt_k,
            "look_rad": image.scan.look_rad,
            "pixel_of_cell": image.pixel_of_cell,
            "coverage": image.coverage,
            "blocked": image.blocked,
        },
    )


def labelled_arrays(picture: Picture) -> dict[str, tuple[tuple[str, ...], AnyArray, dict[str, str]]]:
    """The arrays of a picture by name, each with the names of its axes and its attributes, as xarray takes them.

    ``image`` is the picture in dB or K, by ``line`` and ``sample``; ``row`` and ``column`` are the scene's own.
    """
    n_lines, n_samples = picture.values.shape[1:]
    found: dict[str, tuple[tuple[str, ...], AnyArray, dict[str, str]]] = {
        "image": (("channel", "line", "sample"), picture.told(), {"long_name": picture.quantity, "units": picture.unit})
    }
    for name, given in picture.arrays.items():
        values = np.asarray(given)
        if values.shape == picture.values.shape:
            axes: tuple[str, ...] = ("channel", "line", "sample")
        elif values.shape == picture.pixel_of_cell.shape:
            axes = ("row", "column")
        elif values.shape == (n_lines, n_samples):
            axes = ("line", "sample")
        elif values.shape == (n_lines,):
            axes = ("line",)
        else:
            axes = tuple(f"{name}_axis_{k}" for k in range(values.ndim))
        found[name] = (axes, values, {})
    return found


def grey_scales(pictures: Iterable[Picture]) -> dict[str, GreyScale]:
    """Calibration of each channel, common to all of ``pictures``, so that they can be compared.

    Black is the lowest of the 2 % quantiles over pixels that see something, white the highest of the 98 % quantiles: no
    picture is saturated. They are at least 6 dB, or 2 % of the temperature, apart. Where a radar sees its own noise,
    as in shadow and off the scene, is black if it sees more elsewhere.
    """
    ends: dict[str, list[tuple[float, float, str]]] = {}
    for picture in pictures:
        for k, (channel, plane) in enumerate(zip(picture.channels, picture.values, strict=True)):
            seen = np.isfinite(plane) & (plane > 0.0)
            if "noise_power_w" in picture.arrays:
                shown = seen & (picture.arrays["mean_power_w"][k] >= picture.arrays["noise_power_w"][:, None])
                seen = shown if shown.any() else seen
            lit = plane[seen]
            if lit.size:
                low, high = np.quantile(lit, [_TAIL, 1.0 - _TAIL])
                ends.setdefault(channel, []).append((float(low), float(high), picture.unit))
    scales = {}
    for channel, found in ends.items():
        unit = found[0][2]
        low, high = min(low for low, _, _ in found), max(high for _, high, _ in found)
        widen = max(1.0, np.sqrt(_LEAST_RATIO[unit] * low / high))
        scales[channel] = GreyScale(low / widen, high * widen, unit)
    return scales


def greytones(picture: Picture, scales: Mapping[str, GreyScale] | None = None) -> AnyArray:
    """Grey tones of every channel by RSL TR 380-1 eqs. (3-18) and (3-50), uint8 (channels, n, m).

    Film with gamma = 1; the known target of the calibration is the black end. What is not seen is black. ``scales``:
    calibration by channel; made from the picture itself if not given.
    """
    if scales is None:
        scales = grey_scales([picture])
    planes = []
    for channel, plane in zip(picture.channels, picture.values, strict=True):
        scale = scales.get(channel)
        if picture.arrange is not None:
            plane = rectangular(plane, picture.arrange)
        if scale is None:
            planes.append(np.zeros(plane.shape, dtype=np.uint8))
            continue
        with np.errstate(divide="ignore"):
            density = film_density(np.fmax(plane, 0.0))
        black, white = np.log10(scale.black), np.log10(scale.white)
        tone = np.rint(greytone(density, black, 0.0, picture.n_bits, 10.0 * (white - black)))
        planes.append(to_levels(tone * (255.0 / (2**picture.n_bits - 1)), 8))
    return np.stack(planes)


_MODEL_PIXEL_SCALE, _MODEL_TIEPOINT, _GEO_KEYS = 33550, 33922, 34735
_GDAL_METADATA, _GDAL_NODATA = 42112, 42113
_PROJECTED_CS_KEY = 3072


def write_png(out: Path, picture: Picture, scene: Scene, settings: Mapping[str, float | str]) -> None:
    """Grey image of the first channel, or a composite of the first three (red, green, blue in their order).

    Grey tones of more than 8 bits that the sensor asks for are written as 16 bits, where there is one channel.
    """
    del scene
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    tones = greytones(picture) if picture.levels is None else _shown_levels(picture)
    shown = np.moveaxis(tones[:3], 0, -1) if len(tones) > 2 else tones[0]
    note = PngInfo()
    note.add_text("seqrsm settings", json.dumps(dict(settings)))
    put(out, lambda stream: Image.fromarray(np.ascontiguousarray(shown)).save(stream, "PNG", pnginfo=note))


def _shown_levels(picture: Picture) -> AnyArray:
    """Levels of a calibrated picture spread over 8 or 16 bits: black is 0, white the greatest level."""
    assert picture.levels is not None
    deep = picture.n_bits > 8 and len(picture.levels) < 3
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
        put(out, lambda stream: Image.fromarray(layer).save(stream, "PNG"))
    elif out.suffix.lower() == ".npz":
        arrays: dict[str, Any] = {name: mask, "settings": np.array(json.dumps(dict(settings)))}
        put(out, lambda stream: np.savez_compressed(stream, **arrays))
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
    put(out, lambda stream: np.savez_compressed(stream, **arrays))


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
    """Layers (n, rows, cols) of the scene's own grid as GeoTIFF, compressed; GDAL reads names and unit of its bands."""
    import tifffile

    left, _, _, top = scene.bounds or (0.0, 0.0, 0.0, 0.0)
    tags: list[tuple[int, str, int, Any, bool]] = [
        (_MODEL_PIXEL_SCALE, "d", 3, (scene.cell_m, scene.cell_m, 0.0), True),
        (_MODEL_TIEPOINT, "d", 6, (0.0, 0.0, 0.0, left, top, 0.0), True),
    ]
    items = "".join(
        f'<Item name="{key}" sample="{band}" role="{key.lower()}">{escape(text)}</Item>'
        for band, name in enumerate(note.get("channels", [note["quantity"]]))
        for key, text in (("DESCRIPTION", name), ("UNITTYPE", note["unit"]))
        if text
    )
    tags.append((_GDAL_METADATA, "s", 0, f"<GDALMetadata>{items}</GDALMetadata>", True))
    if layers.dtype.kind == "f":
        tags.append((_GDAL_NODATA, "s", 0, "nan", True))
    if scene.epsg is not None:
        # GTModelType = projected, GTRasterType = pixel is area, ProjectedCSType = EPSG code.
        keys = (1, 1, 0, 3, 1024, 0, 1, 1, 1025, 0, 1, 1, _PROJECTED_CS_KEY, 0, 1, scene.epsg)
        tags.append((_GEO_KEYS, "H", len(keys), keys, True))
    put(
        out,
        lambda stream: tifffile.imwrite(
            stream,
            layers,
            photometric="minisblack",
            planarconfig="separate" if len(layers) > 1 else None,
            compression="zlib",
            extratags=tags,
            description=json.dumps(dict(note)),
            metadata=None,
        ),
    )
