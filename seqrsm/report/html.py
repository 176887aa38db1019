"""The HTML face: one file that holds everything and asks the network for nothing."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Iterator
from functools import lru_cache
from importlib.resources import files
from typing import TYPE_CHECKING

from seqrsm.report.blocks import Block, Details, Equation, Report, Section
from seqrsm.report.figures.drawing import svg_for_html
from seqrsm.report.mathml import equations_to_mathml

if TYPE_CHECKING:
    from jinja2 import Environment


def render_html(report: Report) -> str:
    """Render a report as one self-contained HTML page.

    Text is escaped by the template engine; only drawings and formulas made by this package are marked as safe. A
    content security policy forbids the page to load anything and to run any script but its own.
    """
    from markupsafe import Markup

    environment = _environment()
    script = _template_text("report.js")
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    formulas = equations_to_mathml(tuple(dict.fromkeys(_equations(report.sections))))
    numbers = iter(range(10**9))

    def drawing(svg: str, alt: str) -> Markup:
        label = Markup('<svg role="img" aria-label="{}"').format(alt)
        # Own drawing: made by matplotlib from numbers; user text in it is glyph outlines.
        return Markup(svg_for_html(svg, f"f{next(numbers)}-").replace("<svg", str(label), 1))

    return environment.get_template("report.html.j2").render(
        report=report,
        style=Markup(_template_text("style.css")),
        script=Markup(script),
        script_hash=digest,
        drawing=drawing,
        unique=lambda: f"table-{next(numbers)}",
        formula=lambda equation: Markup(formulas[equation]),
        png_uri=lambda png: "data:image/png;base64," + base64.b64encode(png).decode(),
        kind=lambda block: type(block).__name__,
    )


def _equations(sections: tuple[Section, ...]) -> Iterator[Equation]:
    """Yield every equation of a report."""

    def among(blocks: tuple[Block, ...]) -> Iterator[Equation]:
        for block in blocks:
            if isinstance(block, Equation):
                yield block
            elif isinstance(block, Details):
                yield from among(block.blocks)

    for section in sections:
        yield from among(section.blocks)
        yield from _equations(section.sections)


def _template_text(name: str) -> str:
    return files("seqrsm.report").joinpath("templates").joinpath(name).read_text(encoding="utf-8")


@lru_cache(maxsize=1)
def _environment() -> Environment:
    """Jinja environment with autoescape on and undefined names as errors."""
    from jinja2 import Environment, FunctionLoader, StrictUndefined

    return Environment(
        loader=FunctionLoader(_template_text),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
