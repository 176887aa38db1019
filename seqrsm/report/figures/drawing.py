"""Drawings as SVG text that is the same bytes every time, without pyplot and without global state.

Colours are a fixed palette (after Okabe and Ito, "Color Universal Design", 2008: told apart with any colour vision and
in grey by their lightness), so that the HTML face can exchange them for brighter ones on a dark ground.
"""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Callable, Sequence
from functools import cache, partial
from typing import TYPE_CHECKING, Any

from seqrsm.report.blocks import Panel, PanelData
from seqrsm.report.wording import slug

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

INK = "#1b1f24"
MUTED = "#5c6670"
GRID = "#d5dae0"
BLUE = "#0072b2"
ORANGE = "#d55e00"
GREEN = "#009e73"
PAPER = "#fefefe"
SERIES = (BLUE, ORANGE, GREEN, INK, MUTED)

PALETTE = {
    INK: "--ink",
    MUTED: "--muted",
    GRID: "--grid",
    BLUE: "--blue",
    ORANGE: "--orange",
    GREEN: "--green",
    PAPER: "--paper",
}
"""Colour of a drawing to the name of the CSS variable that takes its place in HTML."""

SURFACE_COLORS = "cividis"
"""Colour map of fitted surfaces: even steps of lightness for every kind of colour vision."""

PANEL_WIDTH_IN = 2.9
PANEL_HEIGHT_IN = 2.1

_STYLE: Any = {
    "svg.fonttype": "path",
    "svg.hashsalt": "seqrsm",
    "mathtext.fontset": "dejavusans",
    "font.size": 8.0,
    "axes.titlesize": 9.0,
    "axes.labelsize": 8.0,
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "legend.fontsize": 7.5,
    "axes.linewidth": 0.8,
    "axes.formatter.useoffset": False,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.facecolor": "none",
    "figure.facecolor": "none",
    "savefig.facecolor": "none",
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "text.color": INK,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "grid.color": GRID,
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "axes.unicode_minus": True,
    "legend.frameon": False,
    "lines.linewidth": 1.5,
    "text.usetex": False,
    # Names that users wrote may hold a dollar sign: they are text, never formulas.
    "text.parse_math": False,
    "axes.formatter.use_mathtext": False,
    "hatch.linewidth": 0.6,
    "hatch.color": MUTED,
    "path.simplify": True,
    "contour.negative_linestyle": "solid",
}

_CJK_FONTS = (
    *("Noto Sans CJK SC", "Noto Sans CJK JP", "Source Han Sans SC", "Droid Sans Fallback", "WenQuanYi Zen Hei"),
    *("Microsoft YaHei", "Yu Gothic", "MS Gothic", "Malgun Gothic", "PingFang SC", "Hiragino Sans", "Arial Unicode MS"),
)
NO_FONT = (
    "figures show boxes for characters that no font at hand has (text and tables are complete); for Chinese, Japanese "
    "and Korean install Noto Sans CJK, and remove matplotlib's font cache"
)
"""Warning where names hold such characters."""

_PROLOGUE = re.compile(r"^.*?(?=<svg\b)", re.DOTALL)
_METADATA = re.compile(r"\s*<metadata>.*?</metadata>", re.DOTALL)
_ID = re.compile(r'\bid="([^"]+)"')
_LINK = re.compile(r'(xlink:href|href)="#([^"]+)"')
_URL = re.compile(r"url\(#([^)]+)\)")
# It would hold for the whole page; style.css has the same rule for drawings alone.
_STYLE_ELEMENT = re.compile(r"<style\b.*?</style>", re.DOTALL)
_WIDTH = re.compile(r'\swidth="([\d.]+)pt"')
_TIPS = re.compile(r"<g id=([\"'])tips:(.*?)\1>(.*?)</g>", re.DOTALL)
_MARK = re.compile(r"<use\b([^>]*)/>")
_BETWEEN = "\u241f"
_NAMESPACE = re.compile(r'\sxmlns(?::\w+)?="[^"]*"')


def draw(paint: Callable[[Axes], None], width_in: float = PANEL_WIDTH_IN, height_in: float = PANEL_HEIGHT_IN) -> str:
    """Let ``paint`` add artists to the empty axes of a figure of a size [in] and return it as SVG.

    An ``<svg>`` element without prologue, metadata and date: equal input gives equal bytes.
    """
    import matplotlib
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    with matplotlib.rc_context({**_STYLE, "font.family": _families()}), warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        figure = Figure(figsize=(width_in, height_in), layout="constrained")
        canvas = FigureCanvasSVG(figure)
        paint(figure.add_subplot())
        buffer = io.StringIO()
        # Not by savefig, which draws once more before, for boxes that nobody asks for.
        metadata = {"Date": None, "Creator": None, "Format": None, "Type": None}
        canvas.print_svg(buffer, metadata=metadata)  # type: ignore[no-untyped-call]
    for text in dict.fromkeys(NO_FONT if "Glyph" in str(one.message) else str(one.message) for one in told):
        _warn_once(text)
    return _TIPS.sub(_write_tips, _METADATA.sub("", _PROLOGUE.sub("", buffer.getvalue()))).strip()


@cache
def _warn_once(text: str) -> None:
    warnings.warn(text, stacklevel=3)


@cache
def _families() -> list[str]:
    """The fonts of drawings: one that comes with matplotlib, then those installed that have other scripts."""
    from matplotlib.font_manager import fontManager

    return ["DejaVu Sans", *(name for name in _CJK_FONTS if name in fontManager.get_font_names())]


def panel(
    title: str,
    alt: str,
    paint: Callable[[Axes], None],
    name: str,
    data: Callable[[], PanelData],
    *,
    width_in: float = PANEL_WIDTH_IN,
    height_in: float = PANEL_HEIGHT_IN,
) -> Panel:
    """Return a picture that `draw` makes when it is first asked for; ``name``, in words, names its files."""
    return Panel(title, alt, partial(draw, paint, width_in, height_in), name=slug(name), data=data)


def legend_above(axes: Axes) -> None:
    """Name lines above the axes, where they hide none."""
    axes.legend(fontsize=6.5, ncol=3, loc="lower center", bbox_to_anchor=(0.5, 1.0))


def tell(marks: Artist, texts: Sequence[str]) -> None:
    """Give each mark of a scatter a text that a browser shows while the pointer is over it.

    Marks are of one size and colour, texts in their order; marks at nan are not drawn and must have no text.
    """
    marks.set_gid("tips:" + _BETWEEN.join(text.replace(_BETWEEN, " ") for text in texts))


def _write_tips(match: re.Match[str]) -> str:
    """Turn the texts, which passed through matplotlib as an escaped identifier, into titles of the marks."""
    texts, drawn = match[2].split(_BETWEEN), match[3]
    if len(_MARK.findall(drawn)) == len(texts):
        remaining = iter(texts)
        drawn = _MARK.sub(lambda mark: f"<use{mark[1]}><title>{next(remaining)}</title></use>", drawn)
    return f"<g>{drawn}</g>"


def svg_for_html(svg: str, prefix: str) -> str:
    """Make a drawing of ``draw`` fit to stand inside an HTML page beside others.

    Identifiers get a prefix, unique in the page (or drawings would steal each other's clip paths), palette colours
    become CSS variables, and the namespace declarations that HTML does not need go.
    """
    svg = _ID.sub(lambda m: f'id="{prefix}{m[1]}"', svg)
    svg = _LINK.sub(lambda m: f'href="#{prefix}{m[2]}"', svg)
    svg = _URL.sub(lambda m: f"url(#{prefix}{m[1]})", svg)
    head, body = svg.split(">", 1)
    width = _WIDTH.search(head)
    # A point is 4/3 of a CSS pixel; a fifth larger than drawn is still in proportion with the text.
    wide = float(width[1]) if width else 0.0
    least = f";min-width:{wide * 1.2:.0f}px" if wide > 72.0 * 1.5 * PANEL_WIDTH_IN else ""  # it scrolls, to be legible
    limit = f' style="max-width:{wide * 1.6:.0f}px{least}"' if width else ""
    head = re.sub(r'\s(?:width|height)="[^"]*"', "", _NAMESPACE.sub("", head)) + limit
    svg = f"{head}>{_STYLE_ELEMENT.sub('', body)}"
    for color, variable in PALETTE.items():
        svg = svg.replace(color, f"var({variable})")
    return svg
