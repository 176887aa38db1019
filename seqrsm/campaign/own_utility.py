"""Utility measures of the user's own: ``"module:function"``, from a file in the campaign's folder or a package."""

from __future__ import annotations

import math
import traceback
from collections.abc import Callable
from typing import Any

import numpy as np

from seqrsm.errors import Problem, SpecError, UserError
from seqrsm.own_code import own_function
from seqrsm.score.classification import UtilityScore

_FIELD = "[[application]] utility"


def find_utility(name: str) -> Callable[..., Any]:
    """The function called ``name``, "package.module:function" or "path/of/module.py:function".

    Raises
    ------
    SpecError
        It cannot be imported, whatever the reason.
    """
    try:
        return own_function(name)
    except Exception as error:  # the user's module may do anything
        text = f"the utility cannot be imported: {_words(error)}"
        remedy = "Put its module beside campaign.toml, or install its package."
        raise SpecError(Problem(text, remedy, field=_FIELD, value=name)) from error


def call_utility(name: str, image: Any, scene: Any, *, seed: int, run_id: int) -> UtilityScore:
    """Score of an image by a utility of the user's own, which returns a `UtilityScore` or a number.

    Raises
    ------
    SpecError
        It cannot be imported, raises, or returns no finite score.
    """
    function = find_utility(name)
    try:
        found = function(image, scene, seed=seed, run_id=run_id)
    except UserError:
        raise
    except Exception as error:  # the user's function may do anything
        place = traceback.extract_tb(error.__traceback__)[-1]
        text = f"the utility failed: {_words(error)}"
        remedy = f"See line {place.lineno} of {place.filename}."
        raise SpecError(Problem(text, remedy, field=_FIELD, value=name)) from error
    if isinstance(found, int | float | np.number) and not isinstance(found, bool):
        found = UtilityScore(float(found), 0.0, 0, 0, np.zeros((0, 0), dtype=np.int64), {})
    if not isinstance(found, UtilityScore):
        text = (
            f"the utility returned {type(found).__name__}, not a number or a seqrsm.score.classification.UtilityScore"
        )
        raise SpecError(Problem(text, "Return one of them.", field=_FIELD, value=name))
    if not math.isfinite(found.value):
        raise SpecError(Problem(f"the utility returned {found.value}", "Return a number.", field=_FIELD, value=name))
    return found


def _words(error: Exception) -> str:
    return f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
