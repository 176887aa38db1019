"""Polygons of a vector layer, burnt to a grid: GeoJSON by itself, other formats by pyogrio (the extra ``vector``)."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from seqrsm.arrays import BoolArray, FloatArray, IntArray
from seqrsm.errors import Problem, SceneError

_GEOJSON: Final = (".geojson", ".json")

_MOST_TOLD: Final = 10
_WIDEST_DEGREES: Final = 360.0
_LARGEST: Final = 2**53


def is_vector(path: str | Path) -> bool:
    """Whether a file is a vector layer, by the end of its name."""
    return Path(path).suffix.lower() in (*_GEOJSON, ".gpkg", ".shp", ".fgb")


def burn_layer(
    path: str | Path, x: FloatArray, y: FloatArray, *, epsg: int | None, attribute: str | None, words: Mapping[str, int]
) -> tuple[IntArray, BoolArray]:
    """Numbers of a layer's polygons in the cells whose centres lie in them, and the cells that lie in one.

    int64 and bool (rows, cols); where polygons overlap, the later holds. The layer is GeoJSON; or GeoPackage, shapefile
    or FlatGeobuf where pyogrio and shapely are installed.

    Parameters
    ----------
    x, y : arrays (cols,), (rows,)
        Centres of the cells [m], eastward and southward.
    epsg : int or None
        Coordinate system that the layer must be in.
    attribute : str or None
        Attribute that holds a whole number or one of ``words``; None: polygons are numbered 1, 2, 3, ...
    words : Mapping[str, int]
        Numbers that words stand for.

    Raises
    ------
    SceneError
        A file that cannot be read, is in degrees or in another system, has other shapes than polygons, or values that
        are no numbers: all of these at once.
    """
    file = str(path)
    features, system = _geojson(file) if Path(path).suffix.lower() in _GEOJSON else _by_pyogrio(file)
    number = np.zeros((len(y), len(x)), dtype=np.int64)
    known = np.zeros(number.shape, dtype=np.bool_)
    problems: list[Problem] = []
    widest = 0.0
    for k, (properties, geometry) in enumerate(features, start=1):
        try:
            edges = _edges(geometry)
            value = k if attribute is None else _whole(properties, attribute, words)
        except SceneError as error:
            message, found = error.problems[0].message, error.problems[0].value
            problems.append(Problem(f"feature {k}: {message}", error.problems[0].remedy, file, None, attribute, found))
            continue
        widest = max(widest, float(np.abs(edges).max()))
        _burn(edges, x, y, value, number, known)
    _check_system(system, epsg, widest, file)
    if problems:
        more = len(problems) - _MOST_TOLD
        rest = [Problem(f"{more} more features are wrong", file=file)] if more > 0 else []
        raise SceneError(*problems[:_MOST_TOLD], *rest)
    if not known.any():
        raise SceneError("no polygon overlaps the elevations", "Is it of the same site?", file=file)
    return number, known


def _geojson(file: str) -> tuple[list[tuple[Any, Any]], str]:
    """Properties and geometry of each feature, and the name of the coordinate system."""
    try:
        document = json.loads(Path(file).read_text(encoding="utf-8-sig"))
        system = ((document.get("crs") or {}).get("properties") or {}).get("name") or ""
        return [(dict(one.get("properties") or {}), one.get("geometry")) for one in document["features"]], str(system)
    except OSError as error:
        raise SceneError(f"cannot read the layer: {error.strerror}", file=file) from error
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        remedy = "Give a FeatureCollection of polygons"
        raise SceneError(f"not a readable GeoJSON layer: {error!r}", remedy, file=file) from error


def _by_pyogrio(file: str) -> tuple[list[tuple[Any, Any]], str]:
    """The same of any format that GDAL reads."""
    try:
        import pyogrio
        import shapely
    except ImportError as error:
        remedy = f"pip install 'seqrsm[vector]', or: ogr2ogr -f GeoJSON layer.geojson {file}"
        raise SceneError("this format needs pyogrio and shapely", remedy, file=file) from error
    try:
        names = [str(name) for name, _ in pyogrio.list_layers(file)]
        if len(names) == 1:
            meta, _, shapes, columns = pyogrio.raw.read(file, force_2d=True)
            geometries = [json.loads(text or "null") for text in shapely.to_geojson(shapely.from_wkb(shapes))]
            attributes = [dict(zip(meta["fields"], row, strict=True)) for row in zip(*columns, strict=True)]
            return list(zip(attributes or [{}] * len(geometries), geometries, strict=True)), str(meta["crs"] or "")
    except Exception as error:  # a damaged file makes GDAL and GEOS raise whatever comes to hand
        raise SceneError(f"not a readable vector layer: {error}", "Rewrite it", file=file) from error
    remedy = f"Cut one out: ogr2ogr one.gpkg {file} LAYER"
    raise SceneError(f"the file has {len(names)} layers: {', '.join(names)}", remedy, file=file)


def _check_system(system: str, epsg: int | None, widest: float, file: str) -> None:
    """Refuse a layer in degrees or in another system than the elevations."""
    found = re.search(r"EPSG:(?:[\d.]*:)?(\d+)$", system)
    own = 4326 if "CRS84" in system else int(found.group(1)) if found else None
    target = f"EPSG:{epsg}" if epsg is not None else "EPSG:CODE"
    remedy = f"Bring it to the elevations' system: ogr2ogr -t_srs {target} projected.geojson {file}"
    if (own is None and widest <= _WIDEST_DEGREES) or (own is not None and 4000 < own < 5000):
        raise SceneError("the layer is in degrees", remedy, file=file, field="coordinate system")
    if None not in (own, epsg) and own != epsg:
        raise SceneError(f"the layer is in EPSG {own}, the elevations in EPSG {epsg}", remedy, file=file)


def _edges(geometry: Any) -> FloatArray:
    """Edges (n, 2, 2) of all rings of a polygon or of several: from and to, x and y."""
    kind = geometry.get("type") if isinstance(geometry, dict) else None
    if kind not in ("Polygon", "MultiPolygon"):
        raise SceneError("not a polygon", "Keep polygons only", value=kind)
    try:
        parts: Sequence[Any] = [geometry["coordinates"]] if kind == "Polygon" else geometry["coordinates"]
        rings = [np.asarray([point[:2] for point in ring], dtype=np.float64) for part in parts for ring in part]
        edges = np.concatenate([np.stack([ring, np.roll(ring, -1, axis=0)], axis=1) for ring in rings])
        whole = edges.shape[1:] == (2, 2) and min(map(len, rings)) >= 3 and bool(np.isfinite(edges).all())
    except (ValueError, TypeError, KeyError):
        whole = False
    if not whole:
        raise SceneError("its coordinates are not rings of numbers", "Redraw it")
    return edges


def _whole(properties: Mapping[str, Any], attribute: str, words: Mapping[str, int]) -> int:
    """Whole number of an attribute, or the one that its word stands for."""
    if attribute not in properties:
        remedy = f"Choose one with --attribute: {', '.join(properties) or 'the layer has none'}"
        raise SceneError("no such attribute", remedy)
    value = properties[attribute]
    try:
        if str(value) in words:
            return words[str(value)]
        if float(value) == int(float(value)) and abs(float(value)) < _LARGEST and not isinstance(value, bool):
            return int(float(value))
    except (ValueError, TypeError, OverflowError):
        pass
    raise SceneError("neither a whole number nor a category of the legend", value=value)


def _burn(edges: FloatArray, x: FloatArray, y: FloatArray, value: int, number: IntArray, known: BoolArray) -> None:
    """Set ``number`` and ``known`` in the cells whose centres lie inside an odd number of rings.

    Along a row, every edge that crosses it turns outside into inside, or back, from there on eastward.
    """
    low, high = edges[:, :, 1].min(axis=1), edges[:, :, 1].max(axis=1)
    # A row is crossed where low <= y < high: an end that two edges share counts once.
    first, last = np.searchsorted(-y, -high, side="right"), np.searchsorted(-y, -low, side="right")
    n = last - first
    edge = np.repeat(np.arange(len(edges)), n)
    if not edge.size:
        return
    row = np.arange(edge.size) - np.repeat(np.cumsum(n) - n, n) + first[edge]
    (x1, y1), (x2, y2) = edges[edge, 0].T, edges[edge, 1].T
    col = np.searchsorted(x, x1 + (y[row] - y1) * (x2 - x1) / (y2 - y1))
    top, left = int(row.min()), int(col.min())
    turns = np.zeros((int(row.max()) - top + 1, int(col.max()) - left + 1), dtype=np.int32)
    np.add.at(turns, (row - top, col - left), 1)
    # Beyond the last crossing all is outside, so that the last column, which may lie off the grid, holds nothing.
    inside = np.cumsum(turns, axis=1)[:, :-1] % 2 == 1
    own = np.s_[top : top + inside.shape[0], left : left + inside.shape[1]]
    number[own][inside], known[own][inside] = value, True
