"""Bitmaps: read back by an independent decoder."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

from seqrsm.report.images import (
    ALL_PIXELS,
    MAX_HEIGHT,
    MAX_WIDTH,
    bar_length_m,
    category_color,
    cover_png,
    grey_png,
    reduction,
)


def test_grey_pixels_survive():
    grey = np.random.default_rng(0).integers(0, 256, (40, 50)).astype(np.uint8)
    with Image.open(io.BytesIO(grey_png(grey, 10.0, reduction(grey.shape)))) as image:
        assert np.array_equal(np.asarray(image)[:40], grey)


def test_large_images_are_block_means():
    grey = np.random.default_rng(1).integers(0, 256, (901, 1250)).astype(np.uint8)
    factor = reduction(grey.shape)
    assert factor == 3
    with Image.open(io.BytesIO(grey_png(grey, 10.0, reduction(grey.shape)))) as image:
        pixels = np.asarray(image)
    assert pixels.shape[1] == 417
    assert pixels.shape[1] <= MAX_WIDTH
    assert pixels.shape[0] <= MAX_HEIGHT + 40
    assert pixels[5, 7] == round(float(grey[15:18, 21:24].mean()))
    assert pixels[0, 416] == round(float(grey[0:3, 1248:1250].mean()))


def test_cover_has_the_colours_of_its_legend():
    cover = np.random.default_rng(2).choice(np.array([0, 1, 2, 255], dtype=np.uint8), (20, 120))
    with Image.open(io.BytesIO(cover_png(cover, 5.0, 1))) as image:
        colors = np.asarray(image.convert("RGB"))
    for index in (0, 1, 2):
        here = np.unique(colors[:20][cover == index], axis=0)
        assert ["#{:02x}{:02x}{:02x}".format(*color) for color in here] == [category_color(index)]
    assert np.all(colors[:20][cover == 255] == 255)


@pytest.mark.parametrize(
    ("columns", "pixel", "bar"), [(300, 10.0, 1000.0), (600, 10.0, 2000.0), (100, 3.0, 100.0), (15, 60.0, 200.0)]
)
def test_scale_bar_is_a_round_length_within_a_third(columns, pixel, bar):
    assert bar_length_m(columns, pixel) == bar
    grey = np.full((30, columns), 128, dtype=np.uint8)
    with Image.open(io.BytesIO(grey_png(grey, pixel, 1))) as image:
        pixels = np.asarray(image)
    rows = np.count_nonzero(pixels == 0, axis=1)
    assert rows.max() == round(bar / pixel)
    assert np.count_nonzero(rows) <= max(1, columns // 100)  # a bar, also under a picture of few pixels


def test_many_pictures_share_the_pixels_of_a_report():
    factor = reduction((900, 600), 12)
    assert 12 * -(-900 // factor) * -(-600 // factor) <= ALL_PIXELS
