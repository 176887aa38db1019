"""Polygons in place of rasters: cover, parcels and ground truth; rasterised by matplotlib, too."""

from __future__ import annotations

import json

import numpy as np
import pytest
from matplotlib.path import Path as Ring
from test_scene_raster import command, write

from seqrsm.errors import SceneError
from seqrsm.scene.raster import import_scene

LEGEND = "code,category\n1,Wheat\n2,Trees\n3,Corn\n"
ROWS, COLS, CELL, LEFT, TOP = 60, 80, 10.0, 1000.0, 5000.0
EDGE = [[1000, 4400], [1800, 4400], [1800, 5000], [1000, 5000], [1000, 4400]]
HOLE = [[1205, 4605], [1303, 4588], [1350, 4733], [1212, 4790], [1205, 4605]]
STAR = [[1500, 4950], [1560, 4650], [1790, 4640], [1600, 4560], [1650, 4410], [1500, 4500], [1390, 4420], [1500, 4950]]
STAR = [[x + 0.37, y + 0.61] for x, y in STAR]  # no cell's centre lies on an edge
BEYOND = [[1700.3, 4900.4], [2500, 4800], [2500, 5600], [1700.3, 4900.4]]


def layer(path, *features, crs="urn:ogc:def:crs:EPSG::31370"):
    shapes = [
        {"type": "Feature", "properties": properties, "geometry": {"type": kind, "coordinates": coordinates}}
        for properties, kind, coordinates in features
    ]
    document = {"type": "FeatureCollection", "features": shapes}
    if crs:
        document["crs"] = {"type": "name", "properties": {"name": crs}}
    path.write_text(json.dumps(document), encoding="utf-8")
    return path


def inside(*rings):
    """Cells whose centres matplotlib finds inside an odd number of rings."""
    x, y = LEFT + (np.arange(COLS) + 0.5) * CELL, TOP - (np.arange(ROWS) + 0.5) * CELL
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    return (sum(Ring(ring).contains_points(points).astype(int) for ring in rings) % 2 == 1).reshape(ROWS, COLS)


@pytest.fixture
def files(tmp_path):
    (tmp_path / "legend.csv").write_text(LEGEND, encoding="utf-8")
    return {
        "elevation": write(tmp_path / "z.tif", np.full((ROWS, COLS), 30.0, np.float32), CELL),
        "cover": layer(
            tmp_path / "c.geojson",
            ({"code": 1, "crop": "Wheat"}, "Polygon", [EDGE, HOLE]),
            ({"code": 2.0, "crop": "Trees"}, "MultiPolygon", [[STAR], [BEYOND]]),
            ({"code": "3", "crop": "Corn"}, "Polygon", [HOLE]),
        ),
        "legend": tmp_path / "legend.csv",
    }


@pytest.mark.parametrize("parts", [{}, {"cover": "crop"}])
def test_polygons_are_burnt_where_another_program_finds_their_cells(files, parts):
    scene = import_scene(**files, parts=parts)
    expected = np.where(inside(HOLE), 2, np.where(inside(STAR) | inside(BEYOND), 1, 0))
    assert np.array_equal(scene.cover, expected)
    assert len(np.unique(expected)) == 3
    assert (scene.shape, scene.bounds, scene.epsg) == ((ROWS, COLS), (1000.0, 4400.0, 1800.0, 5000.0), 31370)


def test_burnt_area_is_that_of_the_polygon(files):
    """Shoelace formula against cells of 1 m."""
    scene = import_scene(**files, cell_m=1.0)
    x, y = np.array(HOLE, dtype=float).T
    area = abs(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1])) / 2
    assert np.sum(scene.cover == 2) == pytest.approx(area, rel=0.005)


def test_rings_that_cross_themselves_hold_what_a_ray_leaves_an_odd_number_of_times(files, tmp_path):
    """Crossings of a ray to the east, counted one edge at a time."""
    rng = np.random.default_rng(3)
    for k in range(20):
        ring = rng.uniform([900.0, 4300.0], [1900.0, 5100.0], (9, 2))
        files["cover"] = layer(
            tmp_path / f"{k}.geojson", ({"code": 1}, "Polygon", [[*ring.tolist(), ring[0].tolist()]])
        )
        x, y = np.meshgrid(LEFT + (np.arange(COLS) + 0.5) * CELL, TOP - (np.arange(ROWS) + 0.5) * CELL)
        odd = np.zeros(x.shape, dtype=bool)
        for (x1, y1), (x2, y2) in zip(ring, np.roll(ring, -1, axis=0), strict=True):
            odd ^= ((y1 > y) != (y2 > y)) & (x < x1 + (y - y1) / (y2 - y1) * (x2 - x1))
        assert np.array_equal(import_scene(**files).scored, odd)


def test_parcels_divide_a_cover(files, tmp_path):
    files["cover"] = write(tmp_path / "c.tif", np.ones((ROWS, COLS), np.uint8), CELL)
    polygons = layer(tmp_path / "p.geojson", ({"id": "a"}, "Polygon", [STAR]), ({"id": "b"}, "Polygon", [HOLE]))
    drawn = np.where(inside(HOLE), 2, np.where(inside(STAR), 1, 0)).astype(np.uint8)
    fields = import_scene(**files, layers={"parcels": polygons}).field_id
    for k in (0, 1, 2):
        assert not set(np.unique(fields[drawn == k])) & set(np.unique(fields[drawn != k]))
    assert len(np.unique(fields[drawn == 2])) == 1
    cut = import_scene(**files, layers={"parcels": polygons}, field_m=50.0).field_id
    assert len(np.unique(cut[drawn == 2])) == 1
    assert len(np.unique(cut[drawn == 0])) > 50


def test_only_truth_is_scored_and_it_overrules_the_cover(files, tmp_path):
    truth = layer(tmp_path / "t.geojson", ({"seen": "Trees"}, "Polygon", [HOLE]))
    scene = import_scene(**files, layers={"truth": truth}, parts={"truth": "seen"})
    assert np.array_equal(scene.scored, inside(HOLE))
    assert (scene.cover[inside(HOLE)] == 1).all()
    assert np.array_equal(scene.cover[~inside(HOLE)], import_scene(**files).cover[~inside(HOLE)])


WHEAT = ({"code": 1}, "Polygon", [EDGE])


@pytest.mark.parametrize(
    ("features", "crs", "words"),
    [
        ([WHEAT, ({"code": "maize"}, "Polygon", [HOLE])], "EPSG:31370", ["c.geojson: code: feature 2", "'maize'"]),
        ([WHEAT, ({"code": 1.5}, "Polygon", [HOLE])], "EPSG:31370", ["feature 2", "1.5"]),
        ([WHEAT, ({"code": 1e300}, "Polygon", [HOLE])], "EPSG:31370", ["feature 2", "1e+300"]),
        ([WHEAT, ({"code": None}, "Polygon", [HOLE])], "EPSG:31370", ["feature 2", "neither a whole number"]),
        ([({"kind": 1}, "Polygon", [HOLE])], "EPSG:31370", ["feature 1", "no such attribute", "kind"]),
        ([WHEAT, ({"code": 1}, "Point", [1, 2])], "EPSG:31370", ["feature 2", "not a polygon", "'Point'"]),
        ([({"code": 1}, "Polygon", [[[1, 2], [3, "x"]]])], "EPSG:31370", ["feature 1", "not rings of numbers"]),
        ([({"code": 1}, "Polygon", [])], "EPSG:31370", ["feature 1", "not rings of numbers"]),
        ([({"code": 7}, "Polygon", [EDGE])], "EPSG:31370", ["of a code the legend lacks"]),
        ([WHEAT], "EPSG:28992", ["EPSG 28992", "EPSG 31370", "ogr2ogr -t_srs EPSG:31370"]),
        ([WHEAT], "urn:ogc:def:crs:OGC:1.3:CRS84", ["in degrees"]),
        ([({"code": 1}, "Polygon", [[[4, 50], [5, 50], [5, 51], [4, 50]]])], None, ["in degrees", "ogr2ogr"]),
        ([({"code": 1}, "Polygon", [[[9000, 50], [9500, 50], [9500, 90]]])], "EPSG:31370", ["no polygon overlaps"]),
        ([], "EPSG:31370", ["c.geojson"]),
    ],
)
def test_spoilt_layers_are_told_in_words(files, tmp_path, features, crs, words):
    files["cover"] = layer(tmp_path / "c.geojson", *features, crs=crs)
    done = command(files, tmp_path / "s.npz")
    assert done.exit_code == 2
    for word in words:
        assert word in " ".join(done.output.split())
    assert not (tmp_path / "s.npz").exists()


@pytest.mark.parametrize(
    "text", ["", "{", "[]", "{}", '{"features": [3]}', '{"features": 3}', "\x00\xff", "[" * 100000]
)
def test_a_damaged_file_is_told_in_words(files, tmp_path, text):
    (tmp_path / "bad.geojson").write_bytes(text.encode("latin-1"))
    files["cover"] = tmp_path / "bad.geojson"
    done = command(files, tmp_path / "s.npz")
    assert done.exit_code == 2
    assert "not a readable GeoJSON layer" in " ".join(done.output.split())


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--attribute", "cover"], "no attribute is named"),
        (["--attribute", "truth=code"], "no such layer is given"),
        (["--band", "cover=1"], "a raster has bands, a vector layer has attributes"),
        (["--attribute", "elevation=code"], "a raster has bands, a vector layer has attributes"),
        (["--parcels", "absent.geojson"], "cannot read the layer"),
    ],
)
def test_wrong_options_are_told_in_words(files, tmp_path, more, words):
    done = command(files, tmp_path / "s.npz", *more)
    assert done.exit_code == 2
    assert words in " ".join(done.output.split())


@pytest.mark.parametrize("ending", ["gpkg", "shp", "fgb"])
def test_other_formats_give_the_same_scene_or_say_what_they_need(files, tmp_path, ending):
    try:
        import pyogrio
        import shapely
    except ImportError:
        files["cover"] = tmp_path / f"c.{ending}"
        with pytest.raises(SceneError, match=r"needs pyogrio and shapely.*ogr2ogr"):
            import_scene(**files)
        return
    expected = import_scene(**files)
    wkb = shapely.to_wkb(shapely.from_geojson([json.dumps(one["geometry"]) for one in features_of(files["cover"])]))
    codes = [np.array([1, 2, 3], dtype=np.int32)]
    target = tmp_path / f"c.{ending}"
    pyogrio.raw.write(
        target, wkb, codes, ["code"], geometry_type="Unknown" if ending != "shp" else "Polygon", crs="EPSG:31370"
    )
    files["cover"] = target
    # A FlatGeobuf keeps an order of its own.
    if ending != "fgb":
        assert np.array_equal(import_scene(**files).cover, expected.cover)
    else:
        assert import_scene(**files).shape == expected.shape
    target.write_bytes(target.read_bytes()[:150])
    with pytest.raises(SceneError):
        import_scene(**files)


def features_of(path):
    return json.loads(path.read_text(encoding="utf-8"))["features"]
