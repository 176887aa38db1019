"""The templates of ``seqrsm init``: the example campaigns, shipped with the package."""

from __future__ import annotations

import shutil
import tomllib
from pathlib import Path

from seqrsm.errors import Problem, UserError

_PACKAGE = Path(__file__).resolve().parents[1]

#: What a campaign writes into its own folder; a template is copied without it.
PRODUCTS = ("campaign.db*", "fits", "reports", "__pycache__")


def template_folder() -> Path:
    """Folder of the templates: inside an installed package, or ``campaigns/`` of a checkout."""
    shipped = _PACKAGE / "_campaigns"
    return shipped if shipped.is_dir() else _PACKAGE.parent / "campaigns"


def templates() -> dict[str, str]:
    """Name and description of every template, by name."""
    found = {}
    for path in sorted(template_folder().glob("*/campaign.toml")):
        found[path.parent.name] = str(
            tomllib.loads(path.read_text(encoding="utf-8"))["campaign"].get("description", "")
        )
    return found


def copy_template(name: str, folder: Path) -> None:
    """Copy template ``name`` to the new folder ``folder``.

    Raises
    ------
    UserError
        No such template, or the folder exists and is not empty.
    """
    if name not in templates():
        raise UserError(
            Problem("no such template", f"Choose one of {', '.join(templates())}.", field="--template", value=name)
        )
    new_folder(folder)
    try:
        shutil.copytree(template_folder() / name, folder, dirs_exist_ok=True, ignore=shutil.ignore_patterns(*PRODUCTS))
    except OSError as error:
        raise UserError(
            Problem(f"cannot make the folder: {error.strerror}", "Name another folder.", file=str(folder))
        ) from error


def new_folder(folder: Path) -> None:
    """Make ``folder``.

    Raises
    ------
    UserError
        It exists and is not empty, or cannot be made.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise UserError(Problem("the folder exists and is not empty", "Name a new folder.", file=str(folder)))
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(
            Problem(f"cannot make the folder: {error.strerror}", "Name another folder.", file=str(folder))
        ) from error
