"""The templates of ``seqrsm init``: the example campaigns, shipped with the package."""

from __future__ import annotations

import shutil
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from seqrsm.errors import UserError

_PACKAGE = Path(__file__).resolve().parents[1]

#: What a campaign writes into its own folder; a template is copied without it.
PRODUCTS = ("campaign.db*", "fits", "reports", "__pycache__")

_LAST, _PART = "campaign.toml", ".init"


def packaged(name: str) -> Path:
    """Folder ``name`` of a checkout, which an installed package holds inside itself."""
    shipped = _PACKAGE / f"_{name}"
    return shipped if shipped.is_dir() else _PACKAGE.parent / name


def templates() -> dict[str, str]:
    """Name and description of every template, by name."""
    paths = sorted(packaged("campaigns").glob("*/campaign.toml"))
    tables = {path.parent.name: tomllib.loads(path.read_text(encoding="utf-8"))["campaign"] for path in paths}
    return {name: str(table.get("description", "")) for name, table in tables.items()}


def copy_template(name: str, folder: Path) -> None:
    """Copy template ``name`` to a new folder; UserError of no such template, or a folder that is not empty."""
    if name not in templates():
        raise UserError("no such template", f"Choose one of {', '.join(templates())}.", field="--template", value=name)
    with new_folder(folder) as part:
        source = packaged("campaigns") / name
        shutil.copytree(source, part, dirs_exist_ok=True, ignore=shutil.ignore_patterns(*PRODUCTS))


@contextmanager
def new_folder(folder: Path) -> Iterator[Path]:
    """Make ``folder``, of what the block puts into the place that it is given.

    ``campaign.toml`` comes last: a folder that has one is whole, and one that a command left unfinished is made anew.
    UserError where it exists and is not empty, or cannot be made.
    """
    part, is_new = folder / _PART, not folder.exists()
    unfinished = part.exists() and not (folder / _LAST).exists()
    if not is_new and (not folder.is_dir() or (any(folder.iterdir()) and not unfinished)):
        raise UserError("the folder exists and is not empty", "Name a new folder.", file=str(folder))
    try:
        shutil.rmtree(part, ignore_errors=True)
        part.mkdir(parents=True)
        yield part
        for path in sorted(part.iterdir(), key=lambda path: path.name == _LAST):
            if path.is_dir():
                shutil.rmtree(folder / path.name, ignore_errors=True)
            path.replace(folder / path.name)
    except OSError as error:
        message = f"cannot make the folder: {error.strerror}"
        raise UserError(message, "Name another folder.", file=str(folder)) from error
    finally:
        if (folder / _LAST).exists() or set(folder.glob("*")) <= {part}:  # else it marks what is unfinished
            shutil.rmtree(part, ignore_errors=True)
        if is_new:
            with suppress(OSError):  # it stays where it is not empty
                folder.rmdir()
