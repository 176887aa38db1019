"""Partial F tests of terms that the user names: single terms, factors, and groups (RSL TR 380-1 eq. (2-14))."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from seqrsm.campaign.analysis import Analysis
from seqrsm.errors import Problem, UserError
from seqrsm.fit.intervals import FTest

GROUPS = {
    "first order": ("linear", "category"),
    "linear": ("linear",),
    "categories": ("category",),
    "second order": ("interaction", "square"),
    "interactions": ("interaction",),
    "squares": ("square",),
    "blocks": ("block",),
    "all": ("linear", "category", "interaction", "square"),
}


@dataclass(frozen=True, slots=True)
class TermTest:
    """What was asked for, the terms that it means, and the test that all of their coefficients are zero."""

    asked: str
    terms: tuple[str, ...]
    test: FTest


def term_tests(analysis: Analysis, asked: Sequence[str]) -> tuple[TermTest, ...]:
    """Partial F test of each group asked for.

    Parameters
    ----------
    analysis : Analysis
    asked : sequence of str
        Each a list, joined by commas, of factors (all terms that hold them), terms, and `GROUPS`. Where a factor and a
        term have the same name the factor is meant; ``term:NAME`` means the term.

    Raises
    ------
    UserError
        A name that is none of these.
    """
    return tuple(_one(analysis, text) for text in asked)


def _one(analysis: Analysis, text: str) -> TermTest:
    fit, chosen = analysis.fit, set[int]()
    for name in (part.strip() for part in text.split(",")):
        found = _places(analysis, name)
        if not found:
            factors = ", ".join(analysis.region.names)
            raise UserError(
                Problem(
                    "no term, factor or group of this name",
                    f"Factors: {factors}. Groups: {', '.join(GROUPS)}. Terms: {', '.join(fit.names)}.",
                    field="--test",
                    value=name,
                )
            )
        chosen.update(found)
    places = sorted(chosen)
    return TermTest(text, tuple(fit.names[i] for i in places), fit.partial_f(places))


def _places(analysis: Analysis, name: str) -> list[int]:
    fit = analysis.fit
    if name.startswith("term:"):
        return [i for i, term in enumerate(fit.names) if term == name.removeprefix("term:")]
    if name in analysis.region.names:
        held: list[int] = np.asarray(analysis.model.factor_terms(name)).tolist()
        return held
    kinds = GROUPS.get(name.replace("-", " ").casefold())
    if kinds is not None:
        return [i for i, kind in enumerate(fit.kinds) if kind in kinds]
    return [i for i, term in enumerate(fit.names) if term == name]
