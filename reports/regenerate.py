"""Run every example campaign from scratch and write its report: ``python reports/regenerate.py [CAMPAIGN...]``.

Each campaign is copied to a temporary folder, carried out to its end, and reported on: reports/CAMPAIGN/report.html,
report.pdf, optimum.json (recommendation, intervals, importance, decision, compromise) and surface.png (the two most
important factors). The same version of seqrsm and of its libraries (.ci/constraints.txt) and the same seed give the
same bytes, on any day and with any number of workers; ``--check`` says whether the files that are there are these.
"""

from __future__ import annotations

import argparse
import csv
import io
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
PRODUCTS = shutil.ignore_patterns("campaign.db*", "fits", "reports", "__pycache__", "build_*.py")
PICTURE_WIDTH = 900
BUDGET_SPENT = 3


def main(arguments: list[str] | None = None) -> int:
    """Write or check the reports; 1 when a checked file differs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("campaigns", nargs="*", metavar="CAMPAIGN", help="folders under campaigns/; default is all")
    parser.add_argument("--workers", type=int, default=1, help="processes that simulate at the same time")
    parser.add_argument("--check", action="store_true", help="compare with the files that are there; write nothing")
    parser.add_argument("--out", type=Path, default=ROOT / "reports", help="where to; default is reports/")
    chosen = parser.parse_args(arguments)
    names = chosen.campaigns or [path.parent.name for path in sorted((ROOT / "campaigns").glob("*/campaign.toml"))]
    different = 0
    for name in names:
        with tempfile.TemporaryDirectory() as folder:
            made = regenerate(ROOT / "campaigns" / name, Path(folder), chosen.workers)
            for file, data in made.items():
                different += _put(chosen.out / name / file, data, chosen.check)
    return 1 if chosen.check and different else 0


def regenerate(campaign: Path, folder: Path, workers: int) -> dict[str, bytes]:
    """Carry a campaign out in a copy under ``folder``; the files of its report, by name."""
    copy = Path(shutil.copytree(campaign, folder / campaign.name, ignore=PRODUCTS))
    _say(f"{copy.name}: running")
    scores = sorted(copy.glob("*_scores.csv"))
    if scores:
        for file in scores:
            _seqrsm(folder, "ingest", copy.name, f"{copy.name}/{file.name}")
    else:
        _seqrsm(folder, "run", copy.name, "--workers", str(workers))
    if "[[candidate]]" in (copy / "campaign.toml").read_text(encoding="utf-8"):
        _seqrsm(folder, "candidates", copy.name, "--workers", str(workers), "--json")
    _say(f"{copy.name}: reporting")
    _seqrsm(folder, "report", copy.name, "--html", "report.html", "--pdf", "report.pdf", "--figures", "figures")
    made = {file: (folder / file).read_bytes() for file in ("report.html", "report.pdf")}
    made["optimum.json"] = _optimum(json.loads(_seqrsm(folder, "fit", copy.name, "--json")))
    picture = _first_surface(folder / "figures")
    if picture is not None:
        made["surface.png"] = _small(picture)
    return made


def _seqrsm(folder: Path, *arguments: str) -> str:
    """Run one command; its stdout. A budget that ended before the stop rule held is an end, too."""
    surroundings = {**os.environ, "PYTHONPATH": f"{ROOT}:{os.environ.get('PYTHONPATH', '')}"}  # not what is installed
    command = [sys.executable, "-m", "seqrsm", *arguments]
    done = subprocess.run(command, cwd=folder, env=surroundings, stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode not in (0, BUDGET_SPENT):
        raise SystemExit(f"seqrsm {' '.join(arguments)} ended with {done.returncode}")
    return done.stdout


def _optimum(document: dict[str, Any]) -> bytes:
    """What a reader would script against, without the rows of every run and term."""
    kept = (
        "application", "goal", "score_unit", "response", "n_runs", "n_terms", "s", "optimum", "factors_importance",
        "lack_of_fit", "confirmation", "stop", "warnings",
    )  # fmt: skip
    applications = document.get("applications", [document])
    short = [{key: one[key] for key in kept if key in one} for one in applications]
    found = {"applications": short}
    if "compromise" in document:
        found["compromise"] = {key: one for key, one in document["compromise"].items() if key != "pareto_front"}
    text = json.dumps(_rounded(found), indent=2, ensure_ascii=False, allow_nan=False)
    return f"{text}\n".encode()


def _rounded(value: Any) -> Any:
    """Numbers to eight digits: far beyond what they mean, short of the last bits."""
    if isinstance(value, dict):
        return {key: _rounded(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [_rounded(inner) for inner in value]
    return float(f"{value:.8g}") if isinstance(value, float) else value


def _first_surface(figures: Path) -> bytes | None:
    """Picture of the surface over the two most important factors."""
    with (figures / "captions.csv").open(encoding="utf-8", newline="") as stream:
        names = [row["file"] for row in csv.DictReader(stream)]
    for wanted in ("surface-", "slice-"):
        for name in names:
            if wanted in name:
                return (figures / f"{name}.png").read_bytes()
    return None


def _small(picture: bytes) -> bytes:
    """A picture for a README: narrower, in 128 colours."""
    with Image.open(io.BytesIO(picture)) as image:
        height = round(image.height * PICTURE_WIDTH / image.width)
        small = image.convert("RGB").resize((PICTURE_WIDTH, height), Image.Resampling.LANCZOS)
    out = io.BytesIO()
    small.quantize(128, method=Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE).save(out, "PNG", optimize=True)
    return out.getvalue()


def _put(path: Path, data: bytes, check: bool) -> bool:
    """Write a file, or compare with it; whether it is another one than before."""
    same = path.is_file() and path.read_bytes() == data
    shown = path.relative_to(ROOT) if path.is_relative_to(ROOT) else path
    _say(f"{shown}: {len(data) / 1e3:.0f} kB, {'as before' if same else 'DIFFERENT' if check else 'written'}")
    if not same and not check:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    return not same


def _say(text: str) -> None:
    sys.stderr.write(f"{text}\n")


if __name__ == "__main__":
    sys.exit(main())
