"""``seqrsm report --figures``: every picture of a report as SVG, PDF and PNG, with its numbers as CSV beside it."""

from __future__ import annotations

import base64
import json
import math
import re
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

from seqrsm.files import csv_text, put
from seqrsm.progress import tell
from seqrsm.report.blocks import FigureBlock, Panel, PanelData, Report, Section, unfolded
from seqrsm.report.wording import slug

_OF_ONE = re.compile(r"a\d+(?:-methods)?$")
"""Keys of the sections of one application among several."""

_PPI = 300.0
_BITMAP_WIDTH_PT = 240.0
# Drawing and words come in as data; nothing in them is read as markup.
_SOURCE = b"""
#let about = json(bytes(sys.inputs.about))
#set document(title: about.title, description: about.alt, date: none)
#set page(width: auto, height: auto, margin: 0pt, fill: none)
#let width = if about.width == none { auto } else { about.width * 1pt }
#image(bytes(about.picture), format: about.format, width: width, alt: about.alt, scaling: "pixelated")
"""


def write_figures(report: Report, folder: Path) -> tuple[Path, ...]:
    """Write each figure of a report as NAME.svg, NAME.pdf, NAME.png and NAME.csv, and their captions.

    The folder is made if it is not there; files of the same names are replaced. Returns the files written,
    ``captions.csv`` last. The same report gives the same bytes.
    """
    import typst

    fonts = typst.Fonts()  # looked for once, not for every picture
    written: list[Path] = []
    index: list[tuple[float | str, ...]] = []
    panels = list(named_panels(report))
    for count, (name, title, caption, panel) in enumerate(panels):
        tell("writing figures", count, len(panels))
        made = {
            ".svg": _svg(panel).encode("utf-8"),
            ".pdf": _typeset(panel, title, "pdf", fonts),
            ".png": panel.png or _typeset(panel, title, "png", fonts),
        }
        if panel.data is not None:
            made[".csv"] = _csv_text(panel.data()).encode("utf-8")
        written += [put(folder / f"{name}{suffix}", data, make_folder=True) for suffix, data in made.items()]
        index.append((name, title, caption, panel.alt))
    columns = ("file", "title", "caption of its figure", "what it shows")
    captions = _csv_text(PanelData(columns, tuple(index))).encode("utf-8")
    written.append(put(folder / "captions.csv", captions, make_folder=True))
    return tuple(written)


def named_panels(report: Report) -> Iterator[tuple[str, str, str, Panel]]:
    """File stem, title, caption and panel of every picture that has a name; no stem occurs twice."""
    used: set[str] = set()
    for title, caption, prefix, panel in _panels(report.sections, ""):
        stem = f"{prefix}{panel.name}"
        name, count = stem, 1
        while name in used:
            count += 1
            name = f"{stem}-{count}"
        used.add(name)
        yield name, title, caption, panel


def _panels(sections: tuple[Section, ...], prefix: str) -> Iterator[tuple[str, str, str, Panel]]:
    for section in sections:
        figures = (block for block in unfolded(section.blocks) if isinstance(block, FigureBlock))
        for block in figures:
            for panel in block.panels:
                if panel.name:
                    legend = (f" {entry.color}: {entry.label}." for entry in block.legend)
                    yield panel.title or section.title, f"{block.caption}{''.join(legend)}", prefix, panel
        of_one = _OF_ONE.match(section.key) and section.sections
        yield from _panels(section.sections, f"{slug(section.title)}-" if of_one else prefix)


def _svg(panel: Panel) -> str:
    """Return a stand-alone SVG file; a bitmap is embedded in one."""
    if panel.svg:
        return f'<?xml version="1.0" encoding="UTF-8"?>\n{panel.svg}\n'
    width, height = struct.unpack(">II", panel.png[16:24])
    data = base64.b64encode(panel.png).decode()
    return (
        f'<?xml version="1.0" encoding="UTF-8"?>\n<svg xmlns="http://www.w3.org/2000/svg" '
        f'xmlns:xlink="http://www.w3.org/1999/xlink" viewBox="0 0 {width} {height}" width="{width}" height="{height}">'
        f'<image width="{width}" height="{height}" style="image-rendering:pixelated" '
        f'xlink:href="data:image/png;base64,{data}"/></svg>\n'
    )


def _typeset(panel: Panel, title: str, form: Literal["pdf", "png"], fonts: Any) -> bytes:
    """Set one picture on a page of its own size, a bitmap on white at 300 dots per inch."""
    import typst

    picture = list(panel.png) if panel.png else panel.svg
    about = {
        "title": title,
        "alt": panel.alt,
        "picture": picture,
        "format": "png" if panel.png else "svg",
        "width": _BITMAP_WIDTH_PT if panel.png else None,
    }
    source = _SOURCE.replace(b"fill: none", b"fill: white") if form == "png" else _SOURCE
    inputs = {"about": json.dumps(about)}
    return bytes(typst.compile(source, format=form, ppi=_PPI, font_paths=fonts, sys_inputs=inputs))


def _csv_text(data: PanelData) -> str:
    return csv_text([data.columns, *(map(_cell, row) for row in data.rows)], "\n")


def _cell(value: float | str) -> str:
    """Shortest text that gives the number back to ten digits; nothing where there is no number."""
    if isinstance(value, str):
        return value
    return f"{value:.10g}" if math.isfinite(value) else ""
