"""Scenes from GeoTIFF: values at known places, resampling, gaps, and what is refused with its remedy."""

from __future__ import annotations

import json
import re
import warnings

import numpy as np
import pytest
import tifffile
from PIL import Image, TiffImagePlugin
from typer.testing import CliRunner

from seqrsm.cli.app import app
from seqrsm.errors import SceneError
from seqrsm.scene.file import load_scene
from seqrsm.scene.raster import import_scene
from seqrsm.scene.scene import NO_COVER

LEGEND = "code,category,note\n1,Wheat,\n2,Trees,planted\n3,Wheat,\n9,,\n"


def write(path, values, step, left=1000.0, top=5000.0, model=1, code=31370, nodata=None, point=False, units=None):
    keys = [1, 1, 0, 0, 1024, 0, 1, model, 1025, 0, 1, 2 if point else 1, 3072 if model == 1 else 2048, 0, 1, code]
    if units:
        keys += [3076, 0, 1, units]
    keys[3] = (len(keys) - 4) // 4
    if point:
        left, top = left + step / 2, top - step / 2
    tags = [
        (33550, "d", 3, (step, step, 0.0), True),
        (33922, "d", 6, (0.0, 0.0, 0.0, left, top, 0.0), True),
        (34735, "H", len(keys), tuple(keys), True),
    ]
    if nodata is not None:
        tags.append((42113, "s", 0, str(nodata), True))
    tifffile.imwrite(path, values, extratags=tags, metadata=None)
    return path


@pytest.fixture
def files(tmp_path):
    """A plane in 10 m cells and a cover in 5 m cells that starts 20 m further east."""
    i, j = np.mgrid[0:30, 0:40]
    plane = (100.0 + 0.3 * (10.0 * j + 5.0) - 0.2 * (10.0 * i + 5.0)).astype(np.float32)
    cover = np.ones((60, 60), dtype=np.uint8)
    cover[:, 30:] = 2
    cover[:10, :10] = 9
    (tmp_path / "legend.csv").write_text(LEGEND, encoding="utf-8")
    return {
        "elevation": write(tmp_path / "z.tif", plane, 10.0),
        "cover": write(tmp_path / "c.tif", cover, 5.0, left=1020.0),
        "legend": tmp_path / "legend.csv",
    }


@pytest.mark.parametrize("point", [False, True])
def test_a_plane_keeps_its_heights_and_the_cover_its_place(files, tmp_path, point):
    if point:
        values = tifffile.imread(files["elevation"])
        files["elevation"] = write(tmp_path / "p.tif", values, 10.0, point=True)
    scene = import_scene(**files, out=tmp_path / "scene.npz")
    assert scene.cell_m == 5.0
    assert scene.shape == (60, 60)
    assert scene.bounds == (1020.0, 4700.0, 1320.0, 5000.0)
    assert scene.epsg == 31370
    assert scene.categories == ("Wheat", "Trees")
    assert scene.category_notes == {"Trees": "planted"}
    file = files["elevation"].name
    assert scene.provenance.endswith(f"legend.csv, cropped to 75 % of {file}, the ground that they share")
    i, j = np.mgrid[0:60, 0:60]
    exact = 100.0 + 0.3 * (20.0 + 5.0 * j + 2.5) - 0.2 * (5.0 * i + 2.5)
    np.testing.assert_allclose(scene.elevation_m[1:-1, :], exact[1:-1, :], atol=1e-4)
    assert (scene.cover[:10, :10] == NO_COVER).all()
    assert (scene.cover[10:, :30] == 0).all()
    assert (scene.cover[:, 30:] == 1).all()
    assert scene.scored.sum() == 3500
    assert np.array_equal(load_scene(tmp_path / "scene.npz").cover, scene.cover)


@pytest.mark.parametrize("by", ["tie point", "transformation"])
def test_cells_longer_than_wide_and_a_place_told_of_one_within(tmp_path, by):
    """Cells of 10 by 4 m; the fourth of the sixth row begins 30 m east and 20 m south of the corner."""
    told = {
        "tie point": [
            (33550, "d", 3, (10.0, 4.0, 0.0), True),
            (33922, "d", 6, (3.0, 5.0, 0.0, 1030.0, 4980.0, 0.0), True),
        ],
        "transformation": [(34264, "d", 16, (10.0, 0, 0, 1000.0, 0, -4.0, 0, 5000.0, *(0.0,) * 7, 1.0), True)],
    }
    keys = (1, 1, 0, 3, 1024, 0, 1, 1, 1025, 0, 1, 1, 3072, 0, 1, 31370)
    tags = [*told[by], (34735, "H", len(keys), keys, True)]
    i, j = np.mgrid[0:50, 0:20]
    plane = 100.0 + 0.3 * (10.0 * j + 5.0) - 0.2 * (4.0 * i + 2.0)
    tifffile.imwrite(tmp_path / "z.tif", plane.astype(np.float32), extratags=tags, metadata=None)
    tifffile.imwrite(tmp_path / "c.tif", np.where(i < 20, 1, 2).astype(np.uint8), extratags=tags, metadata=None)
    (tmp_path / "legend.csv").write_text(LEGEND, encoding="utf-8")
    found = import_scene(tmp_path / "z.tif", tmp_path / "c.tif", tmp_path / "legend.csv")
    assert (found.cell_m, found.shape, found.bounds) == (4.0, (50, 50), (1000.0, 4800.0, 1200.0, 5000.0))
    i, j = np.mgrid[0:50, 0:50]
    exact = 100.0 + 0.3 * (4.0 * j + 2.0) - 0.2 * (4.0 * i + 2.0)
    np.testing.assert_allclose(found.elevation_m[:, 2:-2], exact[:, 2:-2], atol=1e-3)
    np.testing.assert_array_equal(found.cover, np.where(i < 20, 0, 1))


def test_coarser_cells_and_gaps(files, tmp_path):
    values = tifffile.imread(files["elevation"])
    values[5, 8] = -9999.0
    files["elevation"] = write(tmp_path / "z.tif", values, 10.0, nodata=-9999)
    scene = import_scene(**files, cell_m=10.0)
    assert scene.shape == (30, 30)
    assert np.isnan(scene.elevation_m[5, 6])
    assert np.isnan(scene.elevation_m).sum() == 1
    assert not scene.scored[5, 6]


def test_cells_of_an_odd_size_lose_no_more_than_the_gap(tmp_path):
    """Their centres are no round numbers: cells right of a gap and below it were without an elevation, too."""
    (tmp_path / "legend.csv").write_text(LEGEND, encoding="utf-8")
    z = np.random.default_rng(1).uniform(20.0, 40.0, (50, 60)).astype(np.float32)
    z[20:24, 30:36] = np.nan
    place = {"step": 7.3, "left": 600000.0, "top": 5600000.0}
    elevation = write(tmp_path / "z.tif", z, **place)
    cover = write(tmp_path / "c.tif", np.ones(z.shape, np.uint8), **place)
    scene = import_scene(elevation=elevation, cover=cover, legend=tmp_path / "legend.csv")
    np.testing.assert_allclose(scene.elevation_m, z, atol=1e-4)


def test_a_raster_of_temperature_becomes_a_layer(files, tmp_path):
    i, j = np.mgrid[0:80, 0:90]
    kelvin = (290.0 + 0.05 * (4.0 * j + 2.0) + 0.02 * (4.0 * i + 2.0)).astype(np.float32)
    warm = write(tmp_path / "t.tif", kelvin, 4.0, left=1000.0, top=5010.0)
    scene = import_scene(**files, layers={"temperature": warm}, out=tmp_path / "scene.npz")
    i, j = np.mgrid[0:60, 0:60]
    exact = 290.0 + 0.05 * (20.0 + 5.0 * j + 2.5) + 0.02 * (10.0 + 5.0 * i + 2.5)
    np.testing.assert_allclose(load_scene(tmp_path / "scene.npz").temperature_k, exact, atol=1e-3)
    assert "t.tif" in scene.provenance
    short = write(tmp_path / "t.tif", kelvin[:, :60], 4.0, left=1000.0, top=5010.0)
    with pytest.raises(SceneError, match="are not known"):
        import_scene(**files, layers={"temperature": short})
    other = write(tmp_path / "t.tif", kelvin, 4.0, code=32631)
    with pytest.raises(SceneError, match="EPSG 31370 and EPSG 32631"):
        import_scene(**files, layers={"temperature": other})


@pytest.mark.parametrize(
    ("left", "top", "zone"), [(4.7, 50.9, 32631), (5.9, 50.9, 32631), (5.99, 50.9, 32632), (5.9, -20.0, 32731)]
)
def test_degrees_are_refused_with_the_remedy(files, tmp_path, left, top, zone):
    """The zone is that of the middle; 31 ends at 6 degrees east. Elevations of the nearest cell would be steps."""
    degrees = write(tmp_path / "d.tif", np.zeros((30, 150), np.float32), 0.001, left, top, model=2, code=4326)
    for layer, how in (("elevation", "bilinear"), ("cover", "near")):
        with pytest.raises(SceneError, match=rf"in degrees.*gdalwarp -t_srs EPSG:{zone} -r {how} "):
            import_scene(**{**files, layer: degrees})


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"code": 32631}, "EPSG 31370 and EPSG 32631.*gdalwarp"),
        ({"left": 9e5}, "do not overlap"),
        ({"units": 9003}, "not in metres"),
    ],
)
def test_rasters_that_do_not_fit(files, tmp_path, change, words):
    files["cover"] = write(tmp_path / "other.tif", np.ones((60, 60), np.uint8), 5.0, **change)
    with pytest.raises(SceneError, match=words):
        import_scene(**files)


def test_codes_without_a_category_and_bad_legends(files, tmp_path):
    files["cover"] = write(tmp_path / "x.tif", np.full((60, 60), 7, np.uint8), 5.0)
    with pytest.raises(SceneError, match=r"3600 cells of a code the legend lacks.*7"):
        import_scene(**files)
    for text, words in (
        ("a,b\n1,2\n", "column"),
        ("code,category\nx,Wheat\n1,A\n1,B\n", "whole number.*\n.*twice"),
        ('code,category\n1,"Wheat' + "\n2,Grass" * 20_000, r"\.csv:2: not a CSV line"),
        ("code,category\n" + "".join(f"{299 - k},C{k}\n" for k in range(300)), "300 categories, at most 255"),
    ):
        files["legend"].write_text(text, encoding="utf-8")
        with pytest.raises(SceneError, match=words):
            import_scene(**files)


def test_a_legend_that_is_not_utf_8_says_what_to_do(files):
    files["legend"].write_bytes("code,category,note\n1,Trees,Bäume\n".encode("cp1252"))
    with pytest.raises(SceneError, match=r"legend: not UTF-8 text\. Save it as UTF-8"):
        import_scene(**files)


def test_files_that_are_no_rasters(files, tmp_path):
    bad = tmp_path / "bad.tif"
    for content in (None, b"not a tiff", b""):
        if content is not None:
            bad.write_bytes(content)
        with pytest.raises(SceneError, match=r"no such raster|not a readable GeoTIFF"):
            import_scene(bad, files["cover"], files["legend"])
    tifffile.imwrite(bad, np.zeros((4, 4), np.float32))
    with pytest.raises(SceneError, match=r"has no georeference.* gdal_translate -a_srs .*placed\.tif"):
        import_scene(bad, files["cover"], files["legend"])


def test_an_ascii_grid_is_told_how_to_be_converted(files, tmp_path):
    """It names no coordinate system: the command does."""
    grid = tmp_path / "heights.asc"
    grid.write_text("ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 10\n1 2\n3 4\n")
    words = r"Convert it, .* gdal_translate -a_srs EPSG:32631 .*heights\.asc converted\.tif"
    with pytest.raises(SceneError, match=words):
        import_scene(grid, files["cover"], files["legend"])


def test_a_file_that_holds_little_of_its_raster_is_refused_at_once(files, tmp_path):
    """A damaged height of 16 million rows took 15 s to fill with nothing, and was a scene then."""
    tall = write(tmp_path / "tall.tif", np.ones((60, 60), np.uint8), 5.0)
    with tifffile.TiffFile(tall, mode="r+") as tiff:
        tiff.pages[0].tags["ImageLength"].overwrite(2_000_000)
    with pytest.raises(SceneError, match=r"holds \d+ of the \d+ parts of its raster"):
        import_scene(files["elevation"], tall, files["legend"])


def test_a_raster_that_is_no_cover_is_told_so_in_few_words(files, tmp_path):
    many = np.arange(3600).reshape(60, 60).astype(np.uint16)
    files["cover"] = write(tmp_path / "many.tif", many, 5.0)
    with pytest.raises(SceneError, match=r"more codes are missing.*Is this the raster") as caught:
        import_scene(**files)
    assert len(caught.value.problems) == 11
    files["cover"] = write(tmp_path / "heights.tif", many.astype(np.float32) + 0.25, 5.0)
    with pytest.raises(SceneError, match=r"whole numbers \(got 0.25\)"):
        import_scene(**files)
    files["cover"] = write(tmp_path / "whole.tif", np.full((60, 60), 2.0, np.float32), 5.0)
    assert import_scene(**files).categories == ("Wheat", "Trees")


def test_cells_larger_than_the_ground_and_legends_of_spreadsheets(files):
    files["legend"].write_text("code;category;note\n1;Wheat;\n2;Trees;planted, dense\n;;\n9\n", encoding="utf-8")
    assert import_scene(**files).category_notes == {"Trees": "planted, dense"}
    with pytest.raises(SceneError, match="holds no cell of 5000 m"):
        import_scene(**files, cell_m=5000.0)


def command(files, out, *more):
    given = [word for name, path in files.items() for word in (f"--{name}", str(path))]
    return CliRunner().invoke(app, ["scene", "import", *given, "--out", str(out), *more])


def test_the_command_imports_elevation_cover_moisture_and_gaps(files, tmp_path):
    j = np.mgrid[0:80, 0:90][1]
    wet = write(tmp_path / "m.tif", (0.1 + 0.001 * j).astype(np.float32), 4.0, left=1000.0, top=5010.0)
    z = tifffile.imread(files["elevation"]).copy()
    z[:6] = -9999.0
    files["elevation"] = write(tmp_path / "holed.tif", z, 10.0, nodata=-9999.0)
    result = command(files, tmp_path / "s.npz", "--moisture", str(wet))
    assert result.exit_code == 0, result.output
    scene = load_scene(tmp_path / "s.npz")
    assert np.isnan(scene.elevation_m[:8]).all()
    assert np.isfinite(scene.elevation_m[14:]).all()
    assert not scene.scored[:8].any()
    exact = 0.1 + 0.001 * ((20.0 + 5.0 * np.arange(60) + 2.5) / 4.0 - 0.5)
    np.testing.assert_allclose(scene.soil_moisture[30], exact, atol=1e-5)


def test_the_command_refuses_with_the_remedy_and_writes_nothing(files, tmp_path):
    percent = write(tmp_path / "p.tif", np.full((80, 90), 20.0, np.float32), 4.0, left=1000.0, top=5010.0)
    for change, words, more in (
        ({"legend": tmp_path / "none.csv"}, ("none.csv",), ()),
        ({"cover": tmp_path / "none.tif"}, ("none.tif",), ()),
        ({}, ("soil_moisture", "0 to 0.6", "20.0"), ("--moisture", str(percent))),
    ):
        result = command({**files, **change}, tmp_path / "s.npz", *more)
        assert result.exit_code == 2, result.output
        for word in words:
            assert word in result.stderr, result.stderr
        assert not (tmp_path / "s.npz").exists()
    result = command(files, tmp_path / "absent" / "s.npz")
    assert result.exit_code == 2
    assert "Its folder must exist and be writable" in result.stderr


def test_rasters_of_one_cell_and_of_one_row_become_scenes(files, tmp_path):
    for shape in ((1, 1), (1, 40)):
        files["elevation"] = write(tmp_path / "z1.tif", np.full(shape, 55.0, np.float32), 10.0)
        files["cover"] = write(tmp_path / "c1.tif", np.ones(shape, np.uint8), 10.0)
        result = command(files, tmp_path / "one.npz")
        assert result.exit_code == 0, result.output
        scene = load_scene(tmp_path / "one.npz")
        assert scene.shape == shape
        assert (scene.elevation_m == 55.0).all()
        shown = CliRunner().invoke(app, ["scene", "show", str(tmp_path / "one.npz"), "--json"])
        assert shown.exit_code == 0, shown.output
        assert json.loads(shown.stdout)["max_slope"] == 0.0


def test_a_single_known_cell_has_statistics_and_a_legends_faults_are_told_by_their_own_lines(files, tmp_path):
    z = np.full((30, 40), -9999.0, np.float32)
    z[15, 20] = 70.0
    files["elevation"] = write(tmp_path / "lone.tif", z, 10.0, nodata=-9999.0)
    import_scene(**files, out=tmp_path / "lone.npz", cell_m=10.0)
    assert np.isfinite(load_scene(tmp_path / "lone.npz").elevation_m).sum() == 1
    files["legend"].write_text("# by hand\n\ncode,category\nx,Wheat\n# more\n2,Trees\n2,Trees\n", encoding="utf-8")
    with pytest.raises(SceneError, match=r"csv:4: .*not a whole number[\s\S]*csv:7: .*given twice"):
        import_scene(**files)


def test_problems_of_a_layer_name_its_raster(files, tmp_path):
    values = tifffile.imread(files["elevation"])
    values[3, 4] = -32768.0
    files["elevation"] = write(tmp_path / "void.tif", values, 10.0)
    with pytest.raises(
        SceneError,
        match=r"void\.tif: elevation_m: .*no-data value in the file, for instance: gdal_edit\.py -a_nodata -32768",
    ):
        import_scene(**files)
    files["elevation"] = write(tmp_path / "cm.tif", (np.abs(tifffile.imread(files["elevation"])) + 1e2) * 1e2, 10.0)
    with pytest.raises(SceneError, match=r"cm\.tif: elevation_m: .*Turn elevations into metres"):
        import_scene(**files)
    files["elevation"] = write(tmp_path / "z.tif", np.abs(values) % 50, 10.0)
    with pytest.raises(SceneError, match=r"z\.tif: soil_moisture"):
        import_scene(**files, layers={"moisture": files["elevation"]})


def test_a_value_for_no_data_is_told_so_that_it_can_be_set(files, tmp_path):
    """-3.40282e+38 is another number than what a raster of single precision holds, and setting it would not help."""
    values = tifffile.imread(files["elevation"])
    values[3, 4] = np.finfo(np.float32).min
    for told in ("-3.40282e+38", "-3.4028234663852886e+38"):
        files["elevation"] = write(tmp_path / "void.tif", values, 10.0, nodata=told)
        if told == "-3.40282e+38":
            with pytest.raises(SceneError, match=re.escape("gdal_edit.py -a_nodata -3.4028234663852886e+38 ")):
                import_scene(**files)
    assert np.isnan(import_scene(**files).elevation_m).any()


@pytest.mark.parametrize(
    ("wild", "dtype", "nodata"),
    [(-np.inf, np.float32, "-1.7976931348623157e+308"), (1e300, np.float64, "1e300"), (-1e300, np.float64, None)],
)
def test_the_wildest_numbers_are_no_data_or_refused_without_a_librarys_word(files, tmp_path, wild, dtype, nodata):
    values = tifffile.imread(files["elevation"]).astype(dtype)
    values[3, 4] = wild
    files["elevation"] = write(tmp_path / "wild.tif", values, 10.0, nodata=nodata)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        if nodata is None:
            with pytest.raises(SceneError, match=r"wild\.tif: elevation_m: .* lie outside"):
                import_scene(**files)
        else:
            assert np.isnan(import_scene(**files).elevation_m).any()


def test_nothing_known_is_refused(files, tmp_path):
    files["elevation"] = write(tmp_path / "none.tif", np.full((30, 40), np.nan, np.float32), 10.0)
    with pytest.raises(SceneError, match=r"none\.tif: no cell has both an elevation and a category"):
        import_scene(**files, out=tmp_path / "s.npz")
    assert not (tmp_path / "s.npz").exists()


def test_a_damaged_strip_is_told_once_and_not_by_a_library(files, tmp_path, capfd):
    tags = TiffImagePlugin.ImageFileDirectory_v2()
    tags[33550], tags[33922] = (10.0, 10.0, 0.0), (0.0, 0.0, 0.0, 1000.0, 5000.0, 0.0)
    tags.tagtype |= {33550: 12, 33922: 12}
    codes = np.random.default_rng(0).integers(1, 3, (200, 200)).astype(np.uint8)
    Image.fromarray(codes).save(tmp_path / "lzw.tif", compression="tiff_lzw", tiffinfo=tags)
    whole = (tmp_path / "lzw.tif").read_bytes()
    damaged = whole[:500] + bytes(255 - byte for byte in whole[500:4000]) + whole[4000:]
    (tmp_path / "lzw.tif").write_bytes(damaged)
    with pytest.raises(SceneError, match=r"compression LZW .*; if that fails too, the file is damaged"):
        import_scene(**(files | {"cover": tmp_path / "lzw.tif"}), out=tmp_path / "scene.npz")
    assert capfd.readouterr().err == ""
