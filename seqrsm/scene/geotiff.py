"""Reading a GeoTIFF: one band of numbers, and where it lies on a projected grid in metres."""

from __future__ import annotations

import logging
import math
import os
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from seqrsm.arrays import AnyArray
from seqrsm.errors import SceneError
from seqrsm.plain import counted
from seqrsm.scene.scene import MAX_CELLS

_PIXEL_SCALE, _TIEPOINT, _TRANSFORM, _GEO_KEYS, _GDAL_METADATA, _NODATA = 33550, 33922, 34264, 34735, 42112, 42113
_MODEL_TYPE, _RASTER_TYPE, _PROJECTED_CS, _LINEAR_UNITS, _VERTICAL_UNITS = 1024, 1025, 3072, 3076, 4099
_GEOGRAPHIC, _PIXEL_IS_POINT, _METRE = 2, 2, 9001
_USER_DEFINED: Final = 32767
_FEET: Final = (9002, 9003)
_WHITE_IS_ZERO, _RGB = 0, 2


@dataclass(frozen=True, slots=True, eq=False)
class Raster:
    """One layer of a GeoTIFF."""

    values: AnyArray
    """(rows, cols): row 0 in the north."""
    left: float
    top: float
    """Outer corner of the first cell [m]."""
    step_x: float
    step_y: float
    """Size of a cell [m], both > 0."""
    epsg: int | None
    """Code of the projected coordinate system."""
    nodata: float | None
    """Value that stands for none."""
    scale: float = 1.0
    offset: float = 0.0
    """A number of the file times ``scale`` plus ``offset`` is what is meant; codes do without."""

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """Left, bottom, right, top [m]."""
        rows, cols = self.values.shape
        return self.left, self.top - rows * self.step_y, self.left + cols * self.step_x, self.top


def read_geotiff(path: str | Path, layer: str, band: int | None = None) -> Raster:
    """One band of a GeoTIFF in a projected coordinate system.

    ``layer`` is what the raster is for, as ``--band`` names it; ``band``, from 1, is needed where the file has several.
    The colours of a palette are left aside: its values are the places in it.

    Raises
    ------
    SceneError
        Not readable, of several bands none of which was chosen, not placed, rotated, in degrees or in feet, or too
        large.
    """
    file = str(path)
    values, tags, place = _read(file, layer, band)
    if values.ndim != 2 or not values.size or values.dtype.kind not in "iuf":
        text = f"the raster has no layer of numbers (shape {values.shape}, {values.dtype})"
        raise SceneError(text, "Convert it with gdal_translate", file=file)
    try:
        keys = _geo_keys(tags.get(_GEO_KEYS))
        placement = _placement(tags, keys, file)
    except (TypeError, ValueError, IndexError, OverflowError) as error:
        remedy = "Rewrite it, for instance with gdal_translate"
        raise SceneError(f"the file's georeference is damaged: {error}", remedy, file=file) from error
    if not all(map(math.isfinite, placement)):
        raise SceneError("the file's georeference is damaged", "Rewrite it with gdal_translate", file=file)
    item = _gdal_items(tags.get(_GDAL_METADATA), place)
    scale, offset = _number(item.get("scale")) or 1.0, _number(item.get("offset")) or 0.0
    epsg = None if keys.get(_PROJECTED_CS) in (0, _USER_DEFINED) else keys.get(_PROJECTED_CS)
    nodata = _number(tags.get(_NODATA))
    if nodata is not None and values.dtype.kind == "f":
        with np.errstate(over="ignore"):  # -1.8e308 in a file of single precision stands for -inf
            nodata = float(values.dtype.type(nodata))
    raster = Raster(values, *placement, epsg, nodata, scale, offset)
    _check_units(raster, keys, item.get("unittype", ""), layer, file)
    return raster


def _read(file: str, layer: str, band: int | None) -> tuple[AnyArray, dict[int, Any], int]:
    """Numbers of a band, tags of its page by their codes, and its place in the page, from 0."""
    import tifffile

    logging.getLogger("tifffile").setLevel(logging.CRITICAL)  # what is wrong is told below, once
    try:
        with tifffile.TiffFile(file) as tiff:
            every: list[Any] = list(tiff.pages)
            # Overviews and masks are no bands.
            pages = [page for page in every if not (page.is_reduced or page.is_mask)] or every[:1]
            tags = {tag.code: tag.value for tag in pages[0].tags.values()}
            if math.prod(pages[0].shape) > 4 * MAX_CELLS:
                raise SceneError(f"more than {4 * MAX_CELLS} cells", "Cut or coarsen the raster", file=file)
            page, place = _band(pages, file, layer, band)
            parts, held = math.prod(page.chunked), len(page.dataoffsets)
            if held < parts:
                remedy = "Copy it again from where it came from"
                raise SceneError(f"the file holds {held} of the {parts} parts of its raster", remedy, file=file)
            tags |= {tag.code: tag.value for tag in page.tags.values()}
            return _values(page, place, file), tags, place
    except FileNotFoundError as error:
        raise SceneError("no such raster", file=file) from error
    except SceneError:
        raise
    except Exception as error:  # a damaged file makes tifffile and its codecs raise whatever comes to hand
        command = f"gdal_translate -a_srs EPSG:32631 {file} converted.tif"
        remedy = f"Convert it, with the code of its own coordinate system, for instance: {command}"
        raise SceneError(f"not a readable GeoTIFF: {error}", remedy, file=file) from error


def _check_units(raster: Raster, keys: Mapping[int, int], vertical: str, layer: str, file: str) -> None:
    """Refuse a raster in degrees or feet, and elevations in feet; ``vertical``: GDAL's name of their unit."""
    left, _, _, top = raster.bounds
    if keys.get(_MODEL_TYPE) == _GEOGRAPHIC or (
        _MODEL_TYPE not in keys and raster.step_x < 0.02 and abs(left) <= 360.0
    ):
        zone = int((left + 0.5 * raster.values.shape[1] * raster.step_x + 180.0) // 6.0) + 1
        utm = (32600 if top > 0.0 else 32700) + min(max(zone, 1), 60)
        how = f"-t_srs EPSG:{utm} -r {'bilinear' if layer == 'elevation' else 'near'}"
        remedy = f"Project it to metres first, for instance: gdalwarp {how} {file} projected.tif"
        raise SceneError("the raster is in degrees", remedy, file=file, field="coordinate system")
    if keys.get(_LINEAR_UNITS, _METRE) != _METRE:
        remedy = "Project it to a system in metres with gdalwarp -t_srs"
        raise SceneError("the raster is not in metres", remedy, file=file, field="coordinate system")
    feet = keys.get(_VERTICAL_UNITS) in _FEET or vertical.strip().lower().startswith(("ft", "foot", "feet"))
    if layer == "elevation" and feet:
        remedy = f"Turn them into metres, for instance: gdal_calc.py -A {file} --calc=A*0.3048 --outfile metres.tif"
        raise SceneError("the elevations are not in metres", remedy, file=file, field="vertical unit")


def _number(text: Any) -> float | None:
    try:
        return float(str(text).strip("\x00 "))
    except ValueError:
        return None


def _band(pages: list[Any], file: str, layer: str, band: int | None) -> tuple[Any, int]:
    """Page of a file that holds the band asked for, and the place of the band in it, from 0."""
    bands = [(page, place) for page in pages for place in range(int(page.samplesperpixel))]
    n = len(bands)
    if band is None and n == 1:
        return bands[0]
    if band is not None and 1 <= band <= n:
        return bands[band - 1]
    if band is not None:
        remedy = f"Choose one from 1 to {n}" if n > 1 else f"Leave --band {layer} out"
        raise SceneError(f"the raster has {counted(n, 'band')}", remedy, file=file, value=f"{layer}={band}")
    text, choose = f"the raster has {n} bands, and {layer} is one", f"Choose it, as in --band {layer}=1"
    if layer == "cover" and pages[0].photometric == _RGB:
        text = f"the raster has {n} bands, the colours of a picture; cover is one band of codes"
        choose = f"Give the raster of codes that the picture was drawn from; or choose a band, as in --band {layer}=1"
    raise SceneError(text, f"{choose}, or cut it out: gdal_translate -b 1 {file} one.tif", file=file)


def _values(page: Any, place: int, file: str) -> AnyArray:
    """Numbers of one band of a page; of one whose compression tifffile cannot undo alone, by way of Pillow."""
    try:
        values, axes = np.asarray(page.asarray()), page.axes
    except (KeyError, ValueError, ImportError) as error:
        if "imagecodecs" not in str(error) and not isinstance(error, ImportError):
            raise
        from PIL import Image

        Image.MAX_IMAGE_PIXELS = None  # the size was looked at before
        try:
            if page.photometric == _WHITE_IS_ZERO:
                raise ValueError("the result would be inverted")
            with Image.open(file) as picture, _mute():
                picture.seek(page.index)
                values = np.asarray(picture)
        except (OSError, EOFError, ValueError) as other:
            command = f"gdal_translate -co COMPRESS=DEFLATE {file} plain.tif"
            remedy = f"Rewrite it, for instance: {command}; if that fails too, the file is damaged"
            name = getattr(page.compression, "name", page.compression)
            raise SceneError(f"compression {name} cannot be undone: {other}", remedy, file=file) from error
        axes = "YX" if values.ndim == 2 else "YXS"
    if "S" in axes:
        values = np.take(values, place, axis=axes.index("S"))
    return values.astype(np.uint8) if values.dtype == np.bool_ else values


@contextmanager
def _mute() -> Iterator[None]:
    """Keep from the terminal what a C library writes there past Python: its error is raised as well, and told once."""
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    os.close(nowhere)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)


def _gdal_items(text: Any, place: int) -> dict[str, str]:
    """Entries of the metadata that GDAL keeps for a band, by their role."""
    found = re.findall(r"<Item ([^>]*)>([^<]*)<", str(text or ""))
    items = [(dict(re.findall(r'(\w+)="([^"]*)"', attributes)), value) for attributes, value in found]
    return {own["role"]: value for own, value in items if own.get("sample") == str(place) and "role" in own}


def _geo_keys(directory: Any) -> dict[int, int]:
    """Short values of the GeoTIFF key directory."""
    words = [int(w) for w in directory] if directory is not None else []
    return {words[k]: words[k + 3] for k in range(4, len(words) - 3, 4) if words[k + 1] == 0}


def _placement(tags: Mapping[int, Any], keys: Mapping[int, int], file: str) -> tuple[float, float, float, float]:
    """Outer corner left and top, and cell sizes."""
    if _PIXEL_SCALE in tags and _TIEPOINT in tags:
        step_x, step_y = (float(v) for v in tags[_PIXEL_SCALE][:2])
        i, j, _, x, y = (float(v) for v in tags[_TIEPOINT][:5])
        left, top = x - i * step_x, y + j * step_y
    elif _TRANSFORM in tags:
        a = [float(v) for v in tags[_TRANSFORM]]
        if a[1] or a[4]:
            raise SceneError("the raster is rotated", "Straighten it with gdalwarp", file=file)
        step_x, step_y, left, top = a[0], -a[5], a[3], a[7]
    else:
        remedy = "Give it a georeference, for instance: gdal_translate -a_srs EPSG:32631 -a_ullr LEFT TOP RIGHT BOTTOM"
        raise SceneError("the file has no georeference", f"{remedy} {file} placed.tif", file=file)
    if step_x <= 0.0 or step_y <= 0.0:
        raise SceneError("the raster is not north up", "Straighten it with gdalwarp", file=file)
    if keys.get(_RASTER_TYPE) == _PIXEL_IS_POINT:
        left, top = left - 0.5 * step_x, top + 0.5 * step_y
    return left, top, step_x, step_y
