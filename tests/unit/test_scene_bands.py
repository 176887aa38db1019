"""Rasters of several bands, palettes, compressions and units: which numbers of a GeoTIFF a scene is made of."""

from __future__ import annotations

import numpy as np
import pytest
import tifffile
from PIL import Image, TiffImagePlugin
from typer.testing import CliRunner

from seqrsm.cli.app import app
from seqrsm.errors import SceneError
from seqrsm.scene.raster import import_scene

STEP, LEFT, TOP = 10.0, 1000.0, 5000.0
KEYS = (1, 1, 0, 3, 1024, 0, 1, 1, 1025, 0, 1, 1, 3072, 0, 1, 31370)
RNG = np.random.default_rng(4)
HEIGHT = np.round(RNG.uniform(0.0, 50.0, (12, 16)), 2).astype(np.float32)
CODES = RNG.integers(1, 4, (12, 16)).astype(np.uint8)


def tags(keys=KEYS, gdal=None):
    found = [
        (33550, "d", 3, (STEP, STEP, 0.0), True),
        (33922, "d", 6, (0.0, 0.0, 0.0, LEFT, TOP, 0.0), True),
        (34735, "H", len(keys), keys, True),
    ]
    return [*found, (42112, "s", 0, gdal, True)] if gdal else found


def write(path, values, keys=KEYS, gdal=None, **options):
    tifffile.imwrite(path, values, extratags=tags(keys, gdal), metadata=None, **options)
    return path


@pytest.fixture
def files(tmp_path):
    (tmp_path / "legend.csv").write_text("code,category\n1,Wheat\n2,Trees\n3,Water\n", encoding="utf-8")
    return {
        "elevation": write(tmp_path / "z.tif", HEIGHT),
        "cover": write(tmp_path / "c.tif", CODES),
        "legend": tmp_path / "legend.csv",
    }


def bands_of(path, kind):
    """Codes as the second of three bands, written in one of the ways of TIFF."""
    layers = np.stack([CODES + 50, CODES, np.full_like(CODES, 255)])
    if kind == "pixels":
        write(path, np.moveaxis(layers, 0, 2).copy(), photometric="rgb")
    elif kind == "planes":
        write(path, layers, photometric="minisblack", planarconfig="separate")
    else:
        with tifffile.TiffWriter(path) as file:
            for k, layer in enumerate(layers):
                file.write(layer, extratags=tags() if k == 0 else [], metadata=None)
    return path


@pytest.mark.parametrize("kind", ["pixels", "planes", "pages"])
def test_several_bands_are_refused_until_one_is_chosen(files, tmp_path, kind):
    files["cover"] = bands_of(tmp_path / "rgb.tif", kind)
    with pytest.raises(SceneError, match=r"rgb\.tif: the raster has 3 bands.*--band cover=1.*gdal_translate -b 1"):
        import_scene(**files)
    scene = import_scene(**files, parts={"cover": 2})
    assert np.array_equal(scene.cover, CODES - 1)
    with pytest.raises(SceneError, match=r"3 bands \(got 'cover=4'\). Choose one from 1 to 3"):
        import_scene(**files, parts={"cover": 4})


def test_a_picture_as_cover_is_told_to_be_one(files, tmp_path):
    files["cover"] = bands_of(tmp_path / "rgb.tif", "pixels")
    with pytest.raises(SceneError, match="the colours of a picture; cover is one band of codes"):
        import_scene(**files)


def test_elevations_with_a_second_band(files, tmp_path):
    both = np.stack([HEIGHT, np.ones_like(HEIGHT)])
    files["elevation"] = write(tmp_path / "two.tif", both, photometric="minisblack", planarconfig="separate")
    with pytest.raises(SceneError, match="2 bands, and elevation is one"):
        import_scene(**files)
    assert np.array_equal(import_scene(**files, parts={"elevation": 1}).elevation_m, HEIGHT)


def test_the_command_takes_a_band(files, tmp_path):
    rgb, out = bands_of(tmp_path / "rgb.tif", "planes"), tmp_path / "s.npz"
    files["cover"] = rgb
    given = [word for layer, file in files.items() for word in (f"--{layer}", str(file))]
    command = ["scene", "import", *given, "--out", str(out)]
    for wrong, words in (
        ([], "has 3 bands"),
        (["--band", "cover=0"], "a number from 1"),
        (["--band", "2"], "no band is named"),
        (["--band", "moisture=1"], "no such layer is given"),
        (["--band", "elevation=2", "--band", "cover=2"], "the raster has 1 band "),
    ):
        done = CliRunner().invoke(app, [*command, *wrong])
        assert done.exit_code == 2
        assert words in done.output
        assert not out.exists()
    assert CliRunner().invoke(app, [*command, "--band", "cover=2"]).exit_code == 0
    assert out.exists()


def test_overviews_and_masks_are_no_bands(files, tmp_path):
    path = tmp_path / "cog.tif"
    with tifffile.TiffWriter(path) as file:
        file.write(CODES, extratags=tags(), metadata=None)
        file.write(CODES[::2, ::2], subfiletype=1, metadata=None)
        file.write(np.ones(CODES.shape, dtype=bool), subfiletype=4, photometric="mask", metadata=None)
    files["cover"] = path
    assert np.array_equal(import_scene(**files).cover, CODES - 1)


def test_the_codes_of_a_palette_are_its_places(files, tmp_path):
    colours = RNG.integers(0, 65535, (3, 256)).astype(np.uint16)
    files["cover"] = write(tmp_path / "p.tif", CODES, photometric="palette", colormap=colours)
    assert np.array_equal(import_scene(**files).cover, CODES - 1)


@pytest.mark.parametrize("predictor", [1, 2, 3])
def test_lzw_and_predictors(files, tmp_path, predictor):
    info = TiffImagePlugin.ImageFileDirectory_v2()
    info[317] = predictor
    for code, kind, _, value, _ in tags():
        info[code] = value
        info.tagtype[code] = {"d": 12, "H": 3}[kind]
    Image.fromarray(HEIGHT).save(tmp_path / "l.tif", compression="tiff_lzw", tiffinfo=info)
    with tifffile.TiffFile(tmp_path / "l.tif") as file:
        assert file.pages[0].compression == tifffile.COMPRESSION.LZW
    files["elevation"] = tmp_path / "l.tif"
    assert np.array_equal(import_scene(**files).elevation_m, HEIGHT)


def test_a_compression_that_cannot_be_undone(files, tmp_path):
    path = write(tmp_path / "z.tif", HEIGHT)
    raw = bytearray(path.read_bytes())
    with tifffile.TiffFile(path) as file:
        place = file.pages[0].tags["Compression"].valueoffset
    raw[place : place + 2] = (34887).to_bytes(2, "little")  # LERC
    path.write_bytes(raw)
    files["elevation"] = path
    with pytest.raises(SceneError, match=r"compression LERC cannot be undone.*gdal_translate -co COMPRESS=DEFLATE"):
        import_scene(**files)


def test_scale_and_offset_of_gdal(files, tmp_path):
    stored = np.round((HEIGHT - 10.0) * 100.0).astype(np.int16)
    text = (
        '<GDALMetadata><Item name="SCALE" sample="0" role="scale">0.01</Item>'
        '<Item name="OFFSET" sample="0" role="offset">10</Item></GDALMetadata>'
    )
    files["elevation"] = write(tmp_path / "s.tif", stored, gdal=text)
    np.testing.assert_allclose(import_scene(**files).elevation_m, HEIGHT, atol=1e-5)


@pytest.mark.parametrize("way", ["key", "metadata"])
def test_elevations_in_feet_are_refused(files, tmp_path, way):
    keys = (1, 1, 0, 4, *KEYS[4:], 4099, 0, 1, 9002) if way == "key" else KEYS
    text = '<GDALMetadata><Item name="UNITTYPE" sample="0" role="unittype">ft</Item></GDALMetadata>'
    files["elevation"] = write(tmp_path / "f.tif", HEIGHT, keys=keys, gdal=None if way == "key" else text)
    with pytest.raises(SceneError, match=r"not in metres.*0\.3048"):
        import_scene(**files)
