"""reports/reliability.md, put together from the sections that the reliability studies write."""

from __future__ import annotations

import os
import platform
import subprocess
from collections.abc import Sequence
from pathlib import Path

FOLDER = Path(__file__).parents[2] / "reports" / "reliability"
REPORT = FOLDER.parent / "reliability.md"
HEAD = """# Reliability, as measured

Each section is written by the study that it names; figures are from its last call. The forms of these studies that
run with the tests are in `tests/cli`, `tests/store` and `tests/security`.
"""


def write_section(name: str, title: str, lines: Sequence[str]) -> None:
    """Replace one section and put the report together anew; sections stand in the order of their names."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    (FOLDER / f"{name}.md").write_text(f"## {title}\n\n" + "\n".join(lines) + "\n", encoding="utf-8")
    parts = [path.read_text(encoding="utf-8") for path in sorted(FOLDER.glob("*.md"))]
    REPORT.write_text("\n".join([HEAD, *parts]), encoding="utf-8")


def machine() -> str:
    """The machine, and how loaded it is, in a sentence."""
    load = f", load {os.getloadavg()[0]:.1f} at the end" if hasattr(os, "getloadavg") else ""
    return f"Measured with Python {platform.python_version()} on {os.cpu_count()} cores of {platform.machine()}{load}."


def package() -> str:
    """The package that is studied, as git names its content: `git rev-parse --short HEAD:seqrsm`."""
    asked = ("git", "rev-parse", "--short", "HEAD:seqrsm")
    return subprocess.run(
        asked, check=True, stdout=subprocess.PIPE, text=True, cwd=Path(__file__).parent
    ).stdout.strip()
