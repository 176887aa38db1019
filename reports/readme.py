"""Make the outputs in README.md and the guides anew: ``python reports/readme.py [--check]``.

The commands of every block that begins with three backquotes and ``console`` are run in their order in one temporary
folder, from the templates to the end, a command that occurs twice but once, and what they print takes the place of what
stands there; a comment
``<!-- lines FROM .. TO; FROM .. TO -->`` before a block keeps those parts of the last command's output, each from the
first line that begins with FROM up to, and without, the next that begins with TO. The answers of the example campaigns
come from ``reports/*/report.html``, the pictures of the walk-through go to ``reports/readme``. Lines with times and
versions differ from machine to machine; ``--check`` compares the rest.
"""

from __future__ import annotations

import html
import io
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from functools import cache
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / name for name in ("campaigns/README.md", "README.md", "reports/README.md")]
BLOCK = re.compile(r"(?:<!-- lines (?P<kept>[^>]*) -->\n)?```console\n(?P<body>.*?)```\n", re.S)
ANSWERS = re.compile(r"(<!-- answers -->\n).*?(<!-- /answers -->)", re.S)
LEAD = re.compile(r'<p class="lead">((?:Recommended for|No setting is shown) .*?), the settings with the [^<]*</p>')
COMPROMISE = re.compile(r'<p class="lead">(Recommended compromise: .*?) See ')
FIGURE = re.compile(r'<dt>(.*?)</dt><dd><span class="value">(.*?)</span> <span class="detail">(.*?)</span>')
VARIES = re.compile(r"\d s\b|\d s;|made .*Z|version|\d\.\d+ ms")
PICTURES = {"image.png": "readme/image.png", "figures/history-of-half-width.png": "readme/half-width.png"}
PICTURE_WIDTH = 760


def main(arguments: list[str]) -> int:
    """Write the pages and their pictures, or compare; 1 where they differ."""
    with tempfile.TemporaryDirectory() as folder:
        for page in PAGES:
            old = page.read_text(encoding="utf-8")
            text = BLOCK.sub(lambda match: _block(match, Path(folder)), old)
            text = ANSWERS.sub(lambda match: match[1] + _answers() + match[2], text)
            if "--check" not in arguments:
                page.write_text(text, encoding="utf-8")
            elif _lasting(text) != _lasting(old):
                return 1
        for name, target in PICTURES.items():
            if "--check" not in arguments and (Path(folder) / name).exists():
                _small(Path(folder) / name, ROOT / "reports" / target)
    return 0


def _block(match: re.Match[str], folder: Path) -> str:
    """The block with what its commands print now."""
    commands = [line[2:] for line in match["body"].splitlines() if line.startswith("$ ")]
    out = []
    for k, command in enumerate(commands):
        sys.stderr.write(f"{command}\n")
        lines: Sequence[str] = _run(command, folder)
        if match["kept"] and k == len(commands) - 1:
            lines = _parts(lines, match["kept"])
        out += [f"$ {command}", *lines]
    head = f"<!-- lines {match['kept']} -->\n" if match["kept"] else ""
    return head + "```console\n" + "\n".join(out).rstrip() + "\n```\n"


@cache
def _run(command: str, folder: Path) -> tuple[str, ...]:
    """Lines that a command prints, with `seqrsm` this one."""
    tools = folder / ".bin"
    if not tools.exists():
        tools.mkdir()
        (tools / "seqrsm").write_text(f'#!/bin/sh\nexec "{sys.executable}" -m seqrsm "$@"\n', encoding="utf-8")
        (tools / "seqrsm").chmod(0o755)
    surroundings = {**os.environ, "PATH": f"{tools}:{os.environ['PATH']}", "NO_COLOR": "1", "COLUMNS": "120"}
    surroundings["PYTHONPATH"] = f"{ROOT}:{os.environ.get('PYTHONPATH', '')}"
    done = subprocess.run(
        command, shell=True, cwd=folder, env=surroundings, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
    )
    if done.returncode not in (0, 3):
        raise SystemExit(f"{command} ended with {done.returncode}:\n{done.stdout}")
    return tuple(line.rstrip() for line in done.stdout.replace(f"{folder}/", "").rstrip("\n").splitlines())


def _parts(lines: Sequence[str], kept: str) -> list[str]:
    """Parts of an output; three dots stand where something was left out."""
    out: list[str] = []
    at = 0
    for part in kept.split("; "):
        first, _, last = part.partition(" .. ")
        start = next((i for i in range(at, len(lines)) if lines[i].strip().startswith(first)), None)
        if start is None:
            raise SystemExit(f"no line begins with {first!r}")
        stop = next((i for i in range(start + 1, len(lines)) if last and lines[i].strip().startswith(last)), len(lines))
        while stop > start and not lines[stop - 1]:
            stop -= 1
        out += ["..."] * (start > at) + list(lines[start:stop])
        at = stop
    return out + ["..."] * (at < len(lines))


def _answers() -> str:
    """What each example campaign found, in the words and digits of its report."""
    rows = []
    for file in sorted((ROOT / "reports").glob("*/report.html")):
        page = file.read_text(encoding="utf-8")
        told = [*COMPROMISE.findall(page), *(_answer(page, found) for found in LEAD.finditer(page))]
        answers = html.unescape(" ".join(told)).replace("\u00a0", " ")
        rows.append(f"* [`{file.parent.name}`]({file.parent.name}/report.pdf): {answers}\n")
    return "".join(rows)


def _answer(page: str, found: re.Match[str]) -> str:
    """What was found for one application, in two sentences."""
    figures = page[found.end() : page.index("</dl>", found.end())]
    told = {label: (value, detail) for label, value, detail in FIGURE.findall(figures)}
    return (
        f"{found[1]}. Mean score {told['Mean score'][0]}; one future run {told['One future run'][0]} "
        f"({told['One future run'][1]}); {told['Runs in the fit'][0]} runs, {told['Decision'][1]}."
    )


def _small(source: Path, target: Path) -> None:
    """A picture for the README: no wider than a page, in few colours."""
    with Image.open(source) as image:
        width = min(PICTURE_WIDTH, image.width)
        small = image.convert("RGB").resize(
            (width, round(image.height * width / image.width)), Image.Resampling.LANCZOS
        )
    out = io.BytesIO()
    small.quantize(64, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE).save(out, "PNG", optimize=True)
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_bytes(out.getvalue())


def _lasting(text: str) -> list[str]:
    return [line for line in text.splitlines() if not VARIES.search(line)]


if __name__ == "__main__":
    assert shutil.which("sh")
    sys.exit(main(sys.argv[1:]))
