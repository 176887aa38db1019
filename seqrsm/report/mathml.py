"""Formulas for HTML: Typst turns the same source that the PDF uses into MathML."""

from __future__ import annotations

import json
import re
from functools import lru_cache
from html import escape

from seqrsm.report.blocks import Equation

# The text passes as data; only ``math``, a constant of this package, is evaluated.
_SOURCE = b"""
#for equation in json(bytes(sys.inputs.equations)) [
  #math.equation(block: true, eval(equation, mode: "math"))
]
"""
_MATH = re.compile(r"<math\b.*?</math>", re.DOTALL)


@lru_cache(maxsize=8)
def equations_to_mathml(equations: tuple[Equation, ...]) -> dict[Equation, str]:
    """Return the MathML element of each equation, with its reading as ``aria-label``.

    Parameters
    ----------
    equations : tuple of Equation
        Without repetition.
    """
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
