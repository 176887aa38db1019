"""Functions of the user's own, by name: from a file in the campaign's folder, or from an installed package."""

from __future__ import annotations

import importlib
import importlib.util
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from copy import copy
from dataclasses import fields
from functools import lru_cache
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

import numpy as np

T = TypeVar("T")


def located(folder: Path, name: str) -> str:
    """Name "module:function", its module replaced by the path of its file where that lies in the campaign's folder."""
    module, _, function = name.partition(":")
    file = folder / f"{module.replace('.', '/')}.py"
    return f"{file}:{function}" if function and file.is_file() else name


def file_of(name: str) -> str:
    """Path of the file of a `located` function; "" for one of a package or of the program's own."""
    module = name.rpartition(":")[0]
    return module if module.endswith(".py") else ""


def import_remedy(error: BaseException) -> str:
    """What to do about an error of `own_function`: the module is not found, or it is wrong."""
    lacking = isinstance(error, ModuleNotFoundError)
    return "Put its module beside campaign.toml, or install its package." if lacking else "Correct the module."


def own_function(name: str) -> Callable[..., Any]:
    """The function called ``name``, "package.module:function" or "path/of/module.py:function".

    Raises
    ------
    Exception
        Whatever the import of the module raises, for the caller to tell; TypeError where it has no such function.
    """
    module, _, function = name.rpartition(":")
    own = file_of(name)
    holder = _module(module, Path(module).stat().st_mtime_ns) if own else importlib.import_module(module)
    found = getattr(holder, function, None)
    if not callable(found):
        raise TypeError(f"the module has no function {function}")
    return found  # type: ignore[no-any-return]


def not_writable(thing: T) -> T:
    """The same image or scene with arrays that cannot be written: other utilities and later runs use them, too."""

    def shown(value: Any) -> Any:
        if isinstance(value, np.ndarray):
            value = value.view()
            value.flags.writeable = False
        elif callable(value):  # that makes an array when it is asked for
            return lambda: shown(value())
        return value

    same = copy(thing)
    for one in fields(thing):  # type: ignore[arg-type]
        object.__setattr__(same, one.name, shown(getattr(thing, one.name)))
    return same


@contextmanager
def contained() -> Iterator[None]:
    """Call the user's own function herein: what it does to this process ends with it.

    A copy that it forks and leaves would go on as the command does, and write to the same store. A folder that it
    changes to would get the results, where their names are relative.
    """
    process = os.getpid()
    try:
        folder = os.getcwd()
    except OSError:  # it is no more
        folder = ""
    try:
        yield
    finally:
        if os.getpid() != process:
            os._exit(1)
        if folder:
            os.chdir(folder)


@lru_cache(maxsize=8)
def _module(path: str, modified_ns: int) -> ModuleType:
    """Module of a file, under a name of its own: two campaigns may each have a ``utility.py``."""
    spec = importlib.util.spec_from_file_location(f"_own_{abs(hash((path, modified_ns)))}", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.path.insert(0, str(Path(path).parent))
    try:
        spec.loader.exec_module(module)
    finally:
        sys.path.remove(str(Path(path).parent))
    return module
