"""The HTML face: one file that holds everything and asks the network for nothing.

Typst turns the same source of a formula that the PDF uses into MathML.
"""

from __future__ import annotations

import base64
import hashlib
import json
import re
from collections.abc import Callable, Iterator
from functools import lru_cache
from html import escape
from importlib.resources import files
from itertools import count
from typing import TYPE_CHECKING, Any

from seqrsm.report.blocks import Equation, Report, Section, unfolded
from seqrsm.report.figures.drawing import svg_for_html

if TYPE_CHECKING:
    from jinja2 import Template
    from markupsafe import Markup


# The text passes as data; only ``math``, a constant of this package, is evaluated.
_SOURCE = b"""
#for equation in json(bytes(sys.inputs.equations)) [
  #math.equation(block: true, eval(equation, mode: "math"))
]
"""
_MATH = re.compile(r"<math\b.*?</math>", re.DOTALL)


@lru_cache(maxsize=8)
def equations_to_mathml(equations: tuple[Equation, ...]) -> dict[Equation, str]:
    """Return the MathML element of each equation, none twice, with its reading as ``aria-label``."""
    if not equations:
        return {}
    import typst

    sources = json.dumps([equation.math for equation in equations])
    page = typst.compile(_SOURCE, format="html", sys_inputs={"equations": sources}).decode("utf-8")
    elements = _MATH.findall(page)
    if len(elements) != len(equations):
        raise RuntimeError(f"typst made {len(elements)} formulas of {len(equations)}: version 0.15 or newer is needed")
    # Fonts without a mathematics table put a combining accent beside its letter; the plain one stands right everywhere.
    elements = [element.replace("\u0302</mo>", "^</mo>") for element in elements]
    return {
        equation: element.replace("<math", f'<math aria-label="{escape(equation.alt)}"', 1)
        for equation, element in zip(equations, elements, strict=True)
    }


def render_html(report: Report) -> str:
    """Render a report as one self-contained HTML page.

    Text is escaped by the template engine; only drawings and formulas made by this package are marked as safe. A
    content security policy forbids the page to load anything and to run any script but its own.
    """
    from markupsafe import Markup

    profiles = [{"name": name, "data": Markup(data)} for name, data in report.profiles]  # escaped by its maker
    numbers = count()

    def drawing(svg: str, alt: str) -> Markup:
        label = Markup('<svg role="img" aria-label="{}"').format(alt)
        # Own drawing: made by matplotlib from numbers; user text in it is glyph outlines.
        return Markup(svg_for_html(svg, f"f{next(numbers)}-").replace("<svg", str(label), 1))

    script = _template_text("report.js") + _template_text("profiler.js")
    return _template("report.html.j2").render(
        style=Markup(_template_text("style.css")),
        script=Markup(script),
        script_hash=base64.b64encode(hashlib.sha256(script.encode()).digest()).decode(),
        report=report,
        profiles=profiles,
        **_for_blocks(report.sections, numbers, drawing),
    )


def render_sections(sections: tuple[Section, ...]) -> str:
    """Render sections for a notebook's cell, which has a style of its own; every drawing is an image."""
    from markupsafe import Markup

    def drawing(svg: str, alt: str) -> Markup:
        return Markup('<img src="{}" alt="{}">').format(_data_uri("svg+xml", svg.encode()), alt)

    context = _for_blocks(sections, count(), drawing)
    return _template("cell.html.j2").render(listed=sections, between=Markup("<br>"), **context)


def _for_blocks(
    sections: tuple[Section, ...], numbers: Iterator[int], drawing: Callable[[str, str], Markup]
) -> dict[str, Any]:
    """What the template of the blocks asks for; ``drawing``: SVG and its alternative text to what shows it."""
    from markupsafe import Markup

    formulas = equations_to_mathml(tuple(dict.fromkeys(_equations(sections))))
    return {
        "drawing": drawing,
        "unique": lambda: f"table-{next(numbers)}",
        "formula": lambda equation: Markup(formulas[equation]),
        "png_uri": lambda png: _data_uri("png", png),
        "kind": lambda block: type(block).__name__,
    }


def _data_uri(kind: str, data: bytes) -> str:
    return f"data:image/{kind};base64,{base64.b64encode(data).decode()}"


def _equations(sections: tuple[Section, ...]) -> Iterator[Equation]:
    """Yield every equation of a report."""
    for section in sections:
        yield from (block for block in unfolded(section.blocks) if isinstance(block, Equation))
        yield from _equations(section.sections)


def _template_text(name: str) -> str:
    """Text of a file of the templates."""
    return files("seqrsm.report").joinpath("templates").joinpath(name).read_text(encoding="utf-8")


@lru_cache
def _template(name: str) -> Template:
    """A template with autoescape on and undefined names as errors."""
    from jinja2 import Environment, FunctionLoader, StrictUndefined

    environment = Environment(
        loader=FunctionLoader(_template_text),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    return environment.get_template(name)
