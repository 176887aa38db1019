"""Scenes from GeoTIFF rasters and vector layers, brought to one grid of square cells in metres."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from seqrsm.arrays import AnyArray, FloatArray
from seqrsm.csv_lines import read_cells
from seqrsm.errors import Problem, SceneError
from seqrsm.files import see_writable
from seqrsm.plain import counted
from seqrsm.scene.fields import connected_patches, cut_patches
from seqrsm.scene.file import save_scene
from seqrsm.scene.geotiff import Raster, read_geotiff
from seqrsm.scene.scene import HIGHEST_M, MAX_CELLS, NO_COVER, Scene
from seqrsm.scene.vector import burn_layer, is_vector

_ROWS_AT_ONCE = 256
_MOST_TOLD: Final = 10


def import_scene(
    elevation: str | Path,
    cover: str | Path,
    legend: str | Path,
    out: str | Path | None = None,
    *,
    cell_m: float | None = None,
    field_m: float | None = None,
    layers: Mapping[str, str | Path] | None = None,
    parts: Mapping[str, int | str] | None = None,
    name: str = "",
) -> Scene:
    """Scene of elevations, ground cover and a legend, with further layers where there are any.

    All are resampled to square cells over the ground that elevation and cover share: elevation and the like by
    straight lines, cover and the like by the nearest cell. Touching cells of one cover code and parcel are one field.

    Parameters
    ----------
    elevation, cover : path
        GeoTIFF files in one projected coordinate system in metres; cover may be a vector layer of polygons.
    legend : path
        CSV with columns ``code, category`` and optionally ``note``; an empty category is no data.
    out : path, optional
        Scene file to write.
    cell_m : float, optional
        Side of a cell [m]; the finer of both rasters' if not given.
    field_m : float, optional
        Mean side of a field [m]: larger patches of cover, where no parcel is known, are cut into fields of that size.
    layers : Mapping[str, path], optional
        ``"temperature"``: GeoTIFF of the ground's physical temperature [K]; it reaches at least as far.
        ``"moisture"``: the same of the soil's volumetric moisture [m3/m3].
        ``"parcels"``: GeoTIFF of parcel numbers, 0 for none, or polygons.
        ``"truth"``: GeoTIFF of cover codes seen on the ground, or polygons: they replace those of ``cover``, and only
        their cells are scored.
    parts : Mapping[str, int or str], optional
        Of each layer, the band, from 1, of a raster that has several, or the attribute of a vector layer that holds
        the number: ``code`` if not given, the polygon's place in the file for parcels.
    name : str
        Kept in the scene.

    Raises
    ------
    SceneError
        A file that cannot be read, is in degrees, does not overlap the other, or holds codes the legend lacks; a field
        smaller than a cell.
    """
    if out is not None:
        see_writable(Path(out))
    given = {"elevation": elevation, "cover": cover, **(layers or {})}
    chosen = dict(parts or {})
    _check_parts(chosen, given)
    height = read_geotiff(str(elevation), "elevation", _band_of(chosen, "elevation"))

    def read(layer: str) -> Raster:
        file, raster = str(given[layer]), read_geotiff(str(given[layer]), layer, _band_of(chosen, layer))
        if None not in (height.epsg, raster.epsg) and height.epsg != raster.epsg:
            remedy = f"Bring all to one, for instance: gdalwarp -t_srs EPSG:{height.epsg} {file} projected.tif"
            text = f"the rasters differ in coordinate system: EPSG {height.epsg} and EPSG {raster.epsg}"
            raise SceneError(text, remedy, file=file)
        return raster

    kind = height if is_vector(cover) else read("cover")
    names, notes, category_of = read_legend(legend)
    cell = min(height.step_x, height.step_y, kind.step_x, kind.step_y) if cell_m is None else cell_m
    left, top, rows, cols = _common(height, kind, cell, str(cover))
    x: FloatArray = left + (np.arange(cols, dtype=np.float64) + 0.5) * float(cell)
    y: FloatArray = top - (np.arange(rows, dtype=np.float64) + 0.5) * float(cell)
    epsg = height.epsg if height.epsg is not None else kind.epsg

    def numbers(layer: str) -> tuple[AnyArray, AnyArray]:
        """Whole numbers of a layer in the cells, and where there are any."""
        if not is_vector(given[layer]):
            return _whole_numbers(kind if layer == "cover" else read(layer), layer, x, y, str(given[layer]))
        attribute = str(chosen.get(layer, "code")) if layer != "parcels" or layer in chosen else None
        words = {names[index]: code for code, index in reversed(category_of.items()) if index != NO_COVER}
        return burn_layer(given[layer], x, y, epsg=epsg, attribute=attribute, words=words)

    codes, known = numbers("cover")
    seen: AnyArray = np.array(True)
    if "truth" in given:
        true, seen = numbers("truth")
        codes, known = np.where(seen, true, codes), known | seen
    indices = _categories(codes, known, category_of, str(legend))
    z = _bilinear(height, x, y)
    kelvin, wet = (
        _bilinear(read(layer), x, y, beyond=np.nan) if layer in given else None for layer in ("temperature", "moisture")
    )
    scored = np.isfinite(z) & (indices != NO_COVER) & seen
    if not scored.any():
        text = "no cell has both an elevation and a category"
        remedy = f"Look for what stands for no data in it and in {cover}, and at the legend's empty categories"
        raise SceneError(text, remedy, file=str(elevation))
    fields = [np.where(known, codes, 0), indices]
    if "parcels" in given:
        parcel, owned = numbers("parcels")
        fields.append(np.where(owned, parcel, 0))
    field_id = connected_patches(*fields)
    if field_m is not None:
        if not cell <= field_m <= cell * max(z.shape):
            text = f"a field is from a cell of {cell:g} m to the whole site wide"
            raise SceneError(text, field="field_m", value=field_m)
        owned = fields[2] != 0 if "parcels" in given else np.zeros(z.shape, dtype=np.bool_)
        field_id = cut_patches(field_id, round(field_m / cell), owned, seed=0)
    scene = _scene(
        given,
        height,
        elevation_m=z,
        cover=indices,
        categories=names,
        field_id=field_id,
        scored=scored,
        cell_m=float(cell),
        epsg=epsg,
        bounds=(left, top - rows * cell, left + cols * cell, top),
        name=name or Path(cover).stem,
        provenance=f"imported from {', '.join(Path(file).name for file in given.values())} and {Path(legend).name}"
        + (f", fields cut to {field_m:g} m" if field_m is not None else "")
        + _cropped({elevation: height} if kind is height else {elevation: height, cover: kind}, rows * cols * cell**2),
        category_notes=notes,
        temperature_k=kelvin,
        soil_moisture=wet,
    )
    if out is not None:
        save_scene(scene, out)
    return scene


def _cropped(rasters: Mapping[str | Path, Raster], area_m2: float) -> str:
    """How much of each raster a scene of that area has, where it is not all."""
    parts = []
    for file, raster in rasters.items():
        left, bottom, right, top = raster.bounds
        percent = f"{100.0 * area_m2 / ((right - left) * (top - bottom)):.0f} %"
        parts += [f"{percent} of {Path(file).name}"] if percent != "100 %" else []
    return f", cropped to {' and '.join(parts)}, the ground that they share" if parts else ""


_LAYERS: Final = {"elevation_m": "elevation", "temperature_k": "temperature", "soil_moisture": "moisture"}


def _scene(given: Mapping[str, str | Path], height: Raster, **layers: Any) -> Scene:
    """`Scene` whose problems name the raster that they come from."""
    try:
        return Scene(**layers)
    except SceneError as error:
        problems = []
        for problem in error.problems:
            layer = _LAYERS.get(problem.field or "")
            file = str(given.get(layer)) if layer else None
            if layer == "elevation":
                wild = _wildest(height)
                remedy = f"Set the no-data value in the file, for instance: gdal_edit.py -a_nodata {wild!r} {file}"
                # A value that stands for none is one; many are elevations in another unit.
                if (height.values == wild).mean() < 0.01 * (abs(height.values) > HIGHEST_M).mean():
                    command = f"gdal_calc.py -A {file} --calc=A/100. --outfile metres.tif"
                    remedy = f"Turn elevations into metres, of centimetres for instance: {command}"
                problem = replace(problem, remedy=remedy, value=wild)
            problems.append(replace(problem, file=file) if file else problem)
        raise SceneError(*problems) from None


def _wildest(raster: Raster) -> float:
    """Number of a raster of elevations that is furthest from any, as it stands in the file."""
    known = raster.values if raster.nodata is None else raster.values[raster.values != raster.nodata]
    return max(float(np.fmin.reduce(known, axis=None)), float(np.fmax.reduce(known, axis=None)), key=abs)


def _check_parts(chosen: Mapping[str, int | str], given: Mapping[str, str | Path]) -> None:
    """Refuse a band or attribute of a layer that is not there, or of the other sort."""
    problems = []
    for layer, part in chosen.items():
        option = "--attribute" if isinstance(part, str) else "--band"
        if layer not in given:
            remedy = f"Name one of {', '.join(given)}"
            problems.append(Problem("no such layer is given", remedy, field=option, value=layer))
        elif is_vector(given[layer]) != isinstance(part, str):
            text = "a raster has bands, a vector layer has attributes"
            problems.append(Problem(text, file=str(given[layer]), field=option, value=f"{layer}={part}"))
    if problems:
        raise SceneError(*problems)


def _band_of(chosen: Mapping[str, int | str], layer: str) -> int | None:
    return int(chosen[layer]) if layer in chosen else None


def read_legend(path: str | Path) -> tuple[tuple[str, ...], dict[str, str], dict[int, int]]:
    """Categories of a legend, notes on them, and index of the category of each code (`NO_COVER` for none).

    Raises
    ------
    SceneError
        A missing file or column, or a line with a wrong code: all at once.
    """
    file = str(path)
    index: dict[str, int] = {}
    notes: dict[str, str] = {}
    codes: dict[int, int] = {}
    problems = []
    (first, header), *lines = read_cells(path, "the legend", SceneError) or [(1, [])]
    if not {"code", "category"} <= set(header):
        raise SceneError("the legend lacks a column", "Columns: code, category, note", file=file, line=first)
    for line, cells in lines:
        row = dict.fromkeys(header, "") | dict(zip(header, cells, strict=False))
        category = row["category"]
        try:
            code = int(row["code"])
        except ValueError:
            problems.append(Problem("not a whole number", "", file, line, "code", row["code"]))
            continue
        if code in codes:
            problems.append(Problem("the code is given twice", "", file, line, "code", code))
        codes[code] = index.setdefault(category, len(index)) if category else NO_COVER
        if category and row.get("note"):
            notes[category] = row["note"]
    if not index and not problems:
        problems.append(Problem("the legend names no category", "", file))
    if len(index) > NO_COVER:
        remedy = "Give covers that are alike one category"
        problems.append(Problem(f"{len(index)} categories, at most {NO_COVER} are possible", remedy, file))
    if problems:
        raise SceneError(*problems)
    return tuple(index), notes, codes


def _common(a: Raster, b: Raster, cell: float, file: str) -> tuple[float, float, int, int]:
    """Left, top, rows and columns of the cells that both rasters cover."""
    one, two = a.bounds, b.bounds
    left, bottom = max(one[0], two[0]), max(one[1], two[1])
    right, top = min(one[2], two[2]), min(one[3], two[3])
    if not (cell > 0.0 and math.isfinite(cell)):
        raise SceneError("the cell size must be a positive number of metres", field="cell_m", value=cell)
    rows, cols = int((top - bottom) / cell + 1e-6), int((right - left) / cell + 1e-6)
    if min(right - left, top - bottom) > 0.0 and (rows < 1 or cols < 1):
        shared = f"{right - left:g} m x {top - bottom:g} m"
        text = f"the ground that the rasters share, {shared}, holds no cell of {cell:g} m"
        raise SceneError(text, "Give smaller cells, or larger rasters", file=file, field="cell_m")
    if rows < 1 or cols < 1:
        text = f"the rasters do not overlap: one spans {one}, the other {two}"
        raise SceneError(text, "Check their coordinate systems", file=file)
    if rows * cols > MAX_CELLS:
        text = f"{rows} x {cols} cells of {cell:g} m, more than {MAX_CELLS}"
        raise SceneError(text, "Give larger cells", field="cell_m", value=cell)
    return left, top, rows, cols


def _whole_numbers(raster: Raster, layer: str, x: FloatArray, y: FloatArray, file: str) -> tuple[AnyArray, AnyArray]:
    """Codes at points by the nearest cell, 0 beside them, and where they are known."""
    rows, cols = raster.values.shape
    j = np.clip(((x - raster.left) / raster.step_x).astype(np.int64), 0, cols - 1)
    i = np.clip(((raster.top - y) / raster.step_y).astype(np.int64), 0, rows - 1)
    values = raster.values[np.ix_(i, j)]
    known = np.isfinite(values)
    if raster.nodata is not None:
        known &= values != raster.nodata
    left, bottom, right, top = raster.bounds
    known &= ((y >= bottom) & (y <= top))[:, None] & ((x >= left) & (x <= right))
    codes = np.where(known, values, 0)
    if codes.dtype.kind != "f":
        return codes, known
    odd = codes[codes != np.rint(codes)]
    if odd.size:
        text, remedy = f"{layer} codes must be whole numbers", f"Is this the raster of {layer}?"
        raise SceneError(text, remedy, file=file, value=float(odd[0]))
    return codes.astype(np.int64), known


def _bilinear(raster: Raster, x: FloatArray, y: FloatArray, *, beyond: float | None = None) -> AnyArray:
    """Values at points, float32, by straight lines between cell centres, held at the rim; nan beside no data.

    Points outside the raster take ``beyond``, or hold the rim's value where it is None.
    """
    out = np.empty((len(y), len(x)), dtype=np.float32)
    with np.errstate(over="ignore", invalid="ignore"):  # of numbers so wild that the scene is refused for them
        for first in range(0, len(y), _ROWS_AT_ONCE):
            own = slice(first, first + _ROWS_AT_ONCE)
            out[own] = _bilinear_rows(raster, x, y[own])
    if beyond is not None:
        left, bottom, right, top = raster.bounds
        out[~((y >= bottom) & (y <= top))[:, None] | ~((x >= left) & (x <= right))[None, :]] = beyond
    return out


def _bilinear_rows(raster: Raster, x: FloatArray, y: FloatArray) -> FloatArray:
    rows, cols = raster.values.shape
    # Rounded, or a place a rounding error off a cell's centre would ask its neighbour, which may be without data.
    c = np.clip(np.round((x - raster.left) / raster.step_x - 0.5, 6), 0.0, cols - 1.0)
    r = np.clip(np.round((raster.top - y) / raster.step_y - 0.5, 6), 0.0, rows - 1.0)
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
            if (raster.scale, raster.offset) != (1.0, 0.0):
                part = part * raster.scale + raster.offset
            out += np.where(weight > 0.0, weight * part, 0.0)
    return out


def _categories(codes: AnyArray, known: AnyArray, category_of: Mapping[int, int], legend: str) -> AnyArray:
    """Index of the category of every cell."""
    used = np.unique(codes[known])
    missing = [int(code) for code in used if int(code) not in category_of]
    if missing:
        counts = {code: int(np.sum(known & (codes == code))) for code in missing[:_MOST_TOLD]}
        text, add = "of a code the legend lacks", "Add a line for it"
        problems = [
            Problem(f"{counted(n, 'cell')} {text}", add, legend, field="code", value=code) for code, n in counts.items()
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
