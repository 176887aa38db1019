"""The PDF face: Typst sets the same blocks on A4 pages, tagged for accessibility (PDF/UA-1)."""

from __future__ import annotations

import json
from dataclasses import fields, is_dataclass
from importlib.resources import files
from typing import Any

from seqrsm.report.blocks import Column, FigureBlock, Panel, Report

_CALLED = ("data", "draw", "make", "profiles")
"""Fields that paper does not show: what calls give is asked for where it is needed, and profilers move."""
_ASKED: dict[type, list[str]] = {Column: ["heading"], Panel: ["svg"], FigureBlock: ["panels"]}


def render_pdf(report: Report) -> bytes:
    """Render a report as PDF/UA-1; as plain tagged PDF where a name holds a character that no font at hand can show.

    The blocks pass to Typst as JSON: text stays data there and is never read as markup. The file carries no date,
    so equal reports are equal bytes.
    """
    import matplotlib
    import typst

    template = files("seqrsm.report").joinpath("templates").joinpath("report.typ").read_bytes()
    arguments: dict[str, Any] = {
        "format": "pdf",
        "sys_inputs": {"data": json.dumps(_as_data(report), ensure_ascii=False)},
        # DejaVu Sans comes with matplotlib: the figures' own face, and signs that the text face lacks.
        "font_paths": [f"{matplotlib.get_data_path()}/fonts/ttf"],
    }
    try:
        document = typst.compile(template, pdf_standards=["ua-1"], **arguments)
    except typst.TypstError as error:
        if "could not be displayed with" not in str(error):
            raise
        document = typst.compile(template, **arguments)
    return bytes(document)


def _as_data(value: object) -> Any:
    """Turn blocks into what JSON can hold: every dataclass becomes a dictionary that names its kind."""
    if is_dataclass(value) and not isinstance(value, type):
        shown = [field.name for field in fields(value) if field.name not in _CALLED] + _ASKED.get(type(value), [])
        return {"kind": type(value).__name__, **{name: _as_data(getattr(value, name)) for name in shown}}
    if isinstance(value, tuple):
        return [_as_data(item) for item in value]
    if isinstance(value, bytes):
        return list(value)
    return value
