"""Utility measures of the user's own: ``"module:function"``, from a file in the campaign's folder or a package."""

from __future__ import annotations

import importlib
import importlib.util
import math
import sys
import traceback
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from seqrsm.errors import Problem, SpecError, UserError
from seqrsm.score.classification import UtilityScore

_FIELD = "[[application]] utility"


def located(folder: Path, name: str) -> str:
    """Name of a utility, its module replaced by the path of its file where that lies in the campaign's folder."""
    module, _, function = name.partition(":")
    file = folder / f"{module.replace('.', '/')}.py"
    return f"{file}:{function}" if function and file.is_file() else name


def file_of(name: str) -> str:
    """Path of the file of a `located` utility; "" for a package's or the engine's own."""
    module = name.rpartition(":")[0]
    return module if module.endswith(".py") else ""


def find_utility(name: str) -> Callable[..., Any]:
    """The function called ``name``, "package.module:function" or "path/of/module.py:function".

    Raises
    ------
    SpecError
        It cannot be imported, whatever the reason.
    """
    module, _, function = name.rpartition(":")
    try:
        if file_of(name):
            found = getattr(_module(module, Path(module).stat().st_mtime_ns), function)
        else:
            found = getattr(importlib.import_module(module), function)
        if not callable(found):
            raise TypeError(f"{function} is no function")
    except Exception as error:  # the user's module may do anything
        text = f"the utility cannot be imported: {_words(error)}"
        remedy = "Put its module beside campaign.toml, or install its package."
        raise SpecError(Problem(text, remedy, field=_FIELD, value=name)) from error
    return found  # type: ignore[no-any-return]


@lru_cache(maxsize=8)
def _module(path: str, modified_ns: int) -> ModuleType:
    """Module of a file, under a name of its own: two campaigns may each have a ``utility.py``."""
    spec = importlib.util.spec_from_file_location(f"_utility_{abs(hash((path, modified_ns)))}", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.path.insert(0, str(Path(path).parent))
    try:
        spec.loader.exec_module(module)
    finally:
        sys.path.remove(str(Path(path).parent))
    return module


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
