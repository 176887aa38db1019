"""Simulated images and ground truth as small PNG bitmaps with a scale bar, and as numbers."""

from __future__ import annotations

import io
from collections.abc import Sequence

import numpy as np

from seqrsm.arrays import AnyArray, FloatArray
from seqrsm.report.blocks import PanelData

MAX_WIDTH = 600
MAX_HEIGHT = 900
ALL_PIXELS = 1_100_000
"""Pixels of all pictures of a report together: speckle hardly compresses, and a report is to stay below 2 MB."""

NO_DATA = 255
NO_DATA_COLOR = "#ffffff"

CATEGORY_COLORS = (
    "#332288", "#ddcc77", "#117733", "#cc6677", "#88ccee", "#aa4499", "#999933", "#44aa99", "#882255",
    "#661100", "#6699cc", "#bbbbbb", "#e69f00", "#000000", "#f0e442", "#7f3f3f",
)  # fmt: skip
"""Paul Tol's "muted" scheme (SRON/EPS/TN/09-002), then further colours told apart by lightness."""


def category_color(index: int) -> str:
    """Colour of a cover category; they repeat after the last."""
    return CATEGORY_COLORS[index % len(CATEGORY_COLORS)]


def reduction(shape: Sequence[int], pictures: int = 1) -> int:
    """Whole factor by which each of so many ``pictures`` of one shape is reduced to stay within the limits above."""
    rows, columns = shape
    crowding = int(np.ceil(np.sqrt(rows * columns * pictures / ALL_PIXELS)))
    return max(1, -(-columns // MAX_WIDTH), -(-rows // MAX_HEIGHT), crowding)


def reduce_grey(grey: AnyArray, factor: int) -> AnyArray:
    """Mean over blocks of ``factor`` pixels; blocks at the far edges may be smaller."""
    if factor == 1:
        return np.asarray(grey, dtype=np.uint8)
    sums = _block_sums(np.asarray(grey, dtype=np.float64), factor)
    counts = _block_sums(np.ones(grey.shape), factor)
    return np.rint(sums / counts).astype(np.uint8)


def _block_sums(values: FloatArray, factor: int) -> FloatArray:
    by_row = np.add.reduceat(values, np.arange(0, values.shape[0], factor), axis=0)
    total: FloatArray = np.add.reduceat(by_row, np.arange(0, values.shape[1], factor), axis=1)
    return total


def reduce_cover(cover: AnyArray, factor: int) -> AnyArray:
    """Every ``factor``-th cell of a cover map: categories have no mean."""
    return np.asarray(cover, dtype=np.uint8)[::factor, ::factor]


def grey_png(grey: AnyArray, pixel_m: float, factor: int) -> bytes:
    """Encode a greytone image (rows, columns) of uint8, reduced by ``factor``, with a scale bar under it."""
    small = reduce_grey(grey, factor)
    bar = _scale_bar(small.shape[1], pixel_m * factor, background=255, ink=0)
    return _png(np.vstack([small, bar]))


def cover_png(cover: AnyArray, cell_m: float, factor: int) -> bytes:
    """Encode a cover map (rows, columns) of category indices, reduced by ``factor``, with a scale bar under it."""
    small = reduce_cover(cover, factor)
    # 254 is the bar's ink: no scene has that many categories.
    bar = _scale_bar(small.shape[1], cell_m * factor, background=NO_DATA, ink=NO_DATA - 1)
    palette = [category_color(index) for index in range(NO_DATA - 1)]
    return _png(np.vstack([small, bar]), [*palette, "#000000", NO_DATA_COLOR])


def bar_length_m(columns: int, pixel_m: float) -> float:
    """Length [m] of the scale bar: the largest 1, 2 or 5 times a power of ten within a third of the width."""
    third = columns * pixel_m / 3.0
    power = 10.0 ** np.floor(np.log10(third))
    return float(max(step * power for step in (1.0, 2.0, 5.0) if step * power <= third * (1.0 + 1e-12)))


def _scale_bar(columns: int, pixel_m: float, background: int, ink: int) -> AnyArray:
    height = max(1, columns // 100)
    strip = np.full((3 * height, columns), background, dtype=np.uint8)
    strip[height : 2 * height, : max(1, round(bar_length_m(columns, pixel_m) / pixel_m))] = ink
    return strip


def _png(pixels: AnyArray, palette: Sequence[str] = ()) -> bytes:
    """Encode 8-bit grey levels, or indices of colours, as PNG: no metadata, so equal input gives equal bytes."""
    from PIL import Image, ImageColor

    image = Image.fromarray(pixels)
    if palette:
        image = image.convert("P")
        image.putpalette([part for color in palette for part in ImageColor.getrgb(color)])
    stream = io.BytesIO()
    image.save(stream, "PNG")
    return stream.getvalue()


def picture_data(pixels: AnyArray, pixel_m: float) -> PanelData:
    """Pixels of a bitmap: a row for each range, a column for each azimuth, in metres from the near left corner."""
    columns = ("across track [m] \\ along track [m]", *(f"{pixel_m * j:.10g}" for j in range(pixels.shape[1])))
    rows = tuple((pixel_m * i, *line) for i, line in enumerate(pixels.tolist()))
    return PanelData(columns, rows)
