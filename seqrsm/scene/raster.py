"""Scenes from GeoTIFF rasters: elevation and ground cover, brought to one grid of square cells in metres."""

from __future__ import annotations

import csv
import logging
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from seqrsm.arrays import AnyArray, FloatArray
from seqrsm.errors import Problem, SceneError
from seqrsm.scene.fields import connected_patches
from seqrsm.scene.scene import MAX_CELLS, NO_COVER, Scene, save_scene

_PIXEL_SCALE, _TIEPOINT, _TRANSFORM, _GEO_KEYS, _NODATA = 33550, 33922, 34264, 34735, 42113
_MODEL_TYPE, _RASTER_TYPE, _PROJECTED_CS, _LINEAR_UNITS = 1024, 1025, 3072, 3076
_GEOGRAPHIC, _PIXEL_IS_POINT, _METRE = 2, 2, 9001
_USER_DEFINED: Final = 32767
_ROWS_AT_ONCE = 256
_MOST_TOLD: Final = 10


@dataclass(frozen=True, slots=True, eq=False)
class Raster:
    """One layer of a GeoTIFF.

    Attributes
    ----------
    values : array (rows, cols)
        Row 0 in the north.
    left, top : float
        Outer corner of the first cell [m].
    step_x, step_y : float
        Size of a cell [m], both > 0.
    epsg : int or None
        Code of the projected coordinate system.
    nodata : float or None
        Value that stands for none.
    """

    values: AnyArray
    left: float
    top: float
    step_x: float
    step_y: float
    epsg: int | None
    nodata: float | None

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """Left, bottom, right, top [m]."""
        rows, cols = self.values.shape
        return self.left, self.top - rows * self.step_y, self.left + cols * self.step_x, self.top


def import_scene(
    elevation: str | Path,
    cover: str | Path,
    legend: str | Path,
    out: str | Path | None = None,
    *,
    cell_m: float | None = None,
    temperature: str | Path | None = None,
    moisture: str | Path | None = None,
    name: str = "",
    licence: str = "",
) -> Scene:
    """Scene of two or three rasters and a legend.

    All are resampled to square cells over the ground that elevation and cover share: elevation and the like by
    straight lines, cover by the nearest cell. Touching cells of one cover code are one field.

    Parameters
    ----------
    elevation, cover : path
        Single-layer GeoTIFF files in one projected coordinate system in metres.
    legend : path
        CSV with columns ``code, category`` and optionally ``note``; an empty category is no data.
    out : path, optional
        Scene file to write.
    cell_m : float, optional
        Side of a cell [m]; the finer of both rasters' if not given.
    temperature : path, optional
        Single-layer GeoTIFF of the ground's physical temperature [K] in the same system; it reaches at least as far.
    moisture : path, optional
        The same of the soil's volumetric moisture [m3/m3].
    name, licence : str
        Kept in the scene.

    Returns
    -------
    Scene

    Raises
    ------
    SceneError
        A file that cannot be read, is in degrees, does not overlap the other, or holds codes the legend lacks.
    """
    height, kind = read_geotiff(elevation), read_geotiff(cover)
    _same_system(height, kind, str(cover))
    names, notes, category_of = read_legend(legend)
    cell = min(height.step_x, height.step_y, kind.step_x, kind.step_y) if cell_m is None else cell_m
    left, top, rows, cols = _common(height, kind, cell, str(cover))
    x: FloatArray = left + (np.arange(cols, dtype=np.float64) + 0.5) * float(cell)
    y: FloatArray = top - (np.arange(rows, dtype=np.float64) + 0.5) * float(cell)
    codes, known = _nearest(kind, x, y)
    if (codes != np.rint(codes)).any():
        text = "cover codes must be whole numbers"
        remedy = "Is this the raster of ground cover?"
        raise SceneError(Problem(text, remedy, str(cover), value=float(codes[codes != np.rint(codes)][0])))
    if codes.dtype.kind not in "iu":
        codes = codes.astype(np.int64)
    indices = _categories(codes, known, category_of, str(legend))
    z = _bilinear(height, x, y)
    kelvin = None
    if temperature is not None:
        warmth = read_geotiff(temperature)
        _same_system(height, warmth, str(temperature))
        kelvin = _bilinear(warmth, x, y, beyond=np.nan)
    wet = None
    if moisture is not None:
        soil = read_geotiff(moisture)
        _same_system(height, soil, str(moisture))
        wet = _bilinear(soil, x, y, beyond=np.nan)
    files = [file for file in (elevation, cover, temperature, moisture) if file is not None]
    scene = Scene(
        elevation_m=z,
        cover=indices,
        categories=names,
        field_id=connected_patches(np.where(known, codes, 0), indices),
        scored=np.isfinite(z) & (indices != NO_COVER),
        cell_m=float(cell),
        epsg=height.epsg if height.epsg is not None else kind.epsg,
        bounds=(left, top - rows * cell, left + cols * cell, top),
        name=name or Path(cover).stem,
        licence=licence,
        provenance=f"imported from {', '.join(Path(file).name for file in files)} and {Path(legend).name}",
        category_notes=notes,
        temperature_k=kelvin,
        soil_moisture=wet,
    )
    if out is not None:
        save_scene(scene, out)
    return scene


def _same_system(one: Raster, other: Raster, file: str) -> None:
    if None not in (one.epsg, other.epsg) and one.epsg != other.epsg:
        remedy = f"Bring all to one, for instance: gdalwarp -t_srs EPSG:{one.epsg} {file} projected.tif"
        text = f"the rasters differ in coordinate system: EPSG {one.epsg} and EPSG {other.epsg}"
        raise SceneError(Problem(text, remedy, file=file))


def read_geotiff(path: str | Path) -> Raster:
    """First layer of a GeoTIFF in a projected coordinate system.

    Raises
    ------
    SceneError
        Not readable, not placed, rotated, in degrees or in feet, or too large.
    """
    import tifffile

    file = str(path)
    logging.getLogger("tifffile").setLevel(logging.CRITICAL)  # what is wrong is told below, once
    try:
        with tifffile.TiffFile(path) as tiff:
            page: Any = tiff.pages[0]
            tags = {tag.code: tag.value for tag in page.tags.values()}
            if math.prod(page.shape) > 4 * MAX_CELLS:
                raise SceneError(Problem(f"more than {4 * MAX_CELLS} cells", "Cut or coarsen the raster", file))
            values = np.asarray(page.asarray())
    except FileNotFoundError as error:
        raise SceneError(Problem("no such raster", file=file)) from error
    except SceneError:
        raise
    except Exception as error:  # a damaged file makes tifffile and its codecs raise whatever comes to hand
        raise SceneError(Problem(f"not a readable GeoTIFF: {error}", "Convert it with gdal_translate", file)) from error
    if values.ndim == 3:
        values = values[..., 0] if values.shape[-1] <= 4 else values[0]
    if values.ndim != 2 or not values.size or values.dtype.kind not in "iuf":
        text = f"the raster has no layer of numbers (shape {values.shape}, {values.dtype})"
        raise SceneError(Problem(text, "Convert it with gdal_translate", file))
    try:
        keys = _geo_keys(tags.get(_GEO_KEYS))
        left, top, step_x, step_y = _placement(tags, keys, file)
    except (TypeError, ValueError, IndexError, OverflowError) as error:
        remedy = "Write it anew, for instance with gdal_translate"
        raise SceneError(Problem(f"the file's georeference is damaged: {error}", remedy, file)) from error
    if not all(math.isfinite(value) for value in (left, top, step_x, step_y)):
        raise SceneError(Problem("the file's georeference is damaged", "Write it anew with gdal_translate", file))
    if keys.get(_MODEL_TYPE) == _GEOGRAPHIC or (_MODEL_TYPE not in keys and step_x < 0.02 and abs(left) <= 360.0):
        zone = int((left + 0.5 * values.shape[1] * step_x + 180.0) // 6.0) + 1
        utm = (32600 if top > 0.0 else 32700) + min(max(zone, 1), 60)
        remedy = f"Project it to metres first, for instance: gdalwarp -t_srs EPSG:{utm} -r near {file} projected.tif"
        raise SceneError(Problem("the raster is in degrees", remedy, file, field="coordinate system"))
    if keys.get(_LINEAR_UNITS, _METRE) != _METRE:
        remedy = "Project it to a system in metres with gdalwarp -t_srs"
        raise SceneError(Problem("the raster is not in metres", remedy, file, field="coordinate system"))
    epsg = keys.get(_PROJECTED_CS)
    try:
        nodata = float(str(tags[_NODATA]).strip("\x00 ")) if _NODATA in tags else None
    except ValueError:
        nodata = None
    return Raster(values, left, top, step_x, step_y, None if epsg in (None, 0, _USER_DEFINED) else epsg, nodata)


def read_legend(path: str | Path) -> tuple[tuple[str, ...], dict[str, str], dict[int, int]]:
    """Categories of a legend, notes on them, and index of the category of each code (`NO_COVER` for none).

    Raises
    ------
    SceneError
        A missing file or column, or a line with a wrong code: all at once.
    """
    file = str(path)
    try:
        lines = Path(path).read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise SceneError(Problem(f"cannot read the legend: {error}", file=file)) from error
    place = [k for k, line in enumerate(lines, start=1) if line.strip() and not line.startswith("#")]
    written = [lines[k - 1] for k in place]
    separator = max(",;\t", key=lambda sign: written[0].count(sign)) if written else ","
    reader = csv.DictReader(written, delimiter=separator)
    if not {"code", "category"} <= set(reader.fieldnames or ()):
        raise SceneError(Problem("the legend lacks a column", "Columns: code, category, note", file))
    names: list[str] = []
    notes: dict[str, str] = {}
    codes: dict[int, int] = {}
    problems = []
    for row in reader:
        number = place[reader.line_num - 1]
        category = (row["category"] or "").strip()
        try:
            code = int(row["code"] or "")
        except ValueError:
            problems.append(Problem("not a whole number", "", file, number, "code", row["code"]))
            continue
        if code in codes:
            problems.append(Problem("the code is given twice", "", file, number, "code", code))
        if category and category not in names:
            names.append(category)
        codes[code] = names.index(category) if category else NO_COVER
        if category and row.get("note"):
            notes[category] = str(row["note"])
    if not names and not problems:
        problems.append(Problem("the legend names no category", "", file))
    if problems:
        raise SceneError(*problems)
    return tuple(names), notes, codes


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
            raise SceneError(Problem("the raster is rotated", "Straighten it with gdalwarp", file))
        step_x, step_y, left, top = a[0], -a[5], a[3], a[7]
    else:
        raise SceneError(Problem("the file does not say where it lies", "Give a GeoTIFF with its georeference", file))
    if step_x <= 0.0 or step_y <= 0.0:
        raise SceneError(Problem("the raster is not north up", "Straighten it with gdalwarp", file))
    if keys.get(_RASTER_TYPE) == _PIXEL_IS_POINT:
        left, top = left - 0.5 * step_x, top + 0.5 * step_y
    return left, top, step_x, step_y


def _common(a: Raster, b: Raster, cell: float, file: str) -> tuple[float, float, int, int]:
    """Left, top, rows and columns of the cells that both rasters cover."""
    one, two = a.bounds, b.bounds
    left, bottom = max(one[0], two[0]), max(one[1], two[1])
    right, top = min(one[2], two[2]), min(one[3], two[3])
    if not (cell > 0.0 and math.isfinite(cell)):
        raise SceneError(Problem("the cell size must be a positive number of metres", field="cell_m", value=cell))
    rows, cols = int((top - bottom) / cell + 1e-6), int((right - left) / cell + 1e-6)
    if min(right - left, top - bottom) > 0.0 and (rows < 1 or cols < 1):
        shared = f"{right - left:g} m x {top - bottom:g} m"
        text = f"the ground that the rasters share, {shared}, holds no cell of {cell:g} m"
        raise SceneError(Problem(text, "Give smaller cells, or larger rasters", file, field="cell_m"))
    if rows < 1 or cols < 1:
        text = f"the rasters share no ground: one spans {one}, the other {two}"
        raise SceneError(Problem(text, "Check their coordinate systems", file))
    if rows * cols > MAX_CELLS:
        text = f"{rows} x {cols} cells of {cell:g} m, more than {MAX_CELLS}"
        raise SceneError(Problem(text, "Give larger cells", field="cell_m", value=cell))
    return left, top, rows, cols


def _nearest(raster: Raster, x: FloatArray, y: FloatArray) -> tuple[AnyArray, AnyArray]:
    """Values at points by the nearest cell, and where they are known."""
    rows, cols = raster.values.shape
    j = np.clip(((x - raster.left) / raster.step_x).astype(np.int64), 0, cols - 1)
    i = np.clip(((raster.top - y) / raster.step_y).astype(np.int64), 0, rows - 1)
    values = raster.values[np.ix_(i, j)]
    known = np.isfinite(values)
    if raster.nodata is not None:
        known &= values != raster.nodata
    return np.where(known, values, 0), known


def _bilinear(raster: Raster, x: FloatArray, y: FloatArray, *, beyond: float | None = None) -> AnyArray:
    """Values at points, float32, by straight lines between cell centres, held at the rim; nan beside no data.

    Points outside the raster take ``beyond``, or hold the rim's value where it is None.
    """
    out = np.empty((len(y), len(x)), dtype=np.float32)
    for first in range(0, len(y), _ROWS_AT_ONCE):
        own = slice(first, first + _ROWS_AT_ONCE)
        out[own] = _bilinear_rows(raster, x, y[own])
    if beyond is not None:
        left, bottom, right, top = raster.bounds
        out[~((y >= bottom) & (y <= top))[:, None] | ~((x >= left) & (x <= right))[None, :]] = beyond
    return out


def _bilinear_rows(raster: Raster, x: FloatArray, y: FloatArray) -> FloatArray:
    rows, cols = raster.values.shape
    c = np.clip((x - raster.left) / raster.step_x - 0.5, 0.0, cols - 1.0)
    r = np.clip((raster.top - y) / raster.step_y - 0.5, 0.0, rows - 1.0)
    i, j = np.minimum(r.astype(np.int64), max(rows - 2, 0)), np.minimum(c.astype(np.int64), max(cols - 2, 0))
    fr, fc = (r - i)[:, None], (c - j)[None, :]
    out = np.zeros((len(y), len(x)))
    for di, wr in ((0, 1.0 - fr), (1, fr)):
        for dj, wc in ((0, 1.0 - fc), (1, fc)):
            weight = wr * wc
            found = raster.values[np.ix_(np.minimum(i + di, rows - 1), np.minimum(j + dj, cols - 1))]
            part = found.astype(np.float64)
            if raster.nodata is not None:
                part[found == raster.nodata] = np.nan
            # A neighbour without weight may be without data.
            out += np.where(weight > 0.0, weight * part, 0.0)
    return out


def _categories(codes: AnyArray, known: AnyArray, category_of: Mapping[int, int], legend: str) -> AnyArray:
    """Index of the category of every cell."""
    used = np.unique(codes[known])
    missing = [int(code) for code in used if int(code) not in category_of]
    if missing:
        counts = {code: int(np.sum(known & (codes == code))) for code in missing[:_MOST_TOLD]}
        problems = [
            Problem(f"{n} cells hold a code the legend lacks", "Add a line for it", legend, field="code", value=code)
            for code, n in counts.items()
        ]
        if len(missing) > _MOST_TOLD:
            text = f"{len(missing) - _MOST_TOLD} more codes are missing"
            problems.append(Problem(text, "Is this the raster of ground cover?", legend, field="code"))
        raise SceneError(*problems)
    out = np.full(codes.shape, NO_COVER, dtype=np.uint8)
    category = np.array([category_of[int(code)] for code in used], dtype=np.uint8)
    for mine, theirs, seen in zip(out, codes, known, strict=True):
        mine[seen] = category[np.searchsorted(used, theirs[seen])]
    return out
