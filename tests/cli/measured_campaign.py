"""Campaigns of measured scores: factors and applications by the line, and scores of known surfaces."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from typer.testing import CliRunner

from seqrsm.cli.app import app

HEAD = '[campaign]\nname = "t"\nseed = 3\n'
X = '[[factor]]\nname = "x"\nlow = 0.0\nhigh = 10.0\n'
FREQUENCY = '[[factor]]\nname = "frequency"\nunit = "GHz"\nlow = 1.0\nhigh = 16.0\nscale = "log"\n'
POL = '[[factor]]\nname = "pol"\nlevels = ["HH", "VV"]\n'
MEASURED = '[[application]]\nname = "a"\nutility = "measured"\n'
PERCENT = '[[application]]\nname = "a"\nutility = "percent_correct"\n'
STOP = "[stop]\nhalf_width = 3.0\n"


def make(folder: Path, factors: str, rows: list[dict], model: str = "", application: str = MEASURED) -> Path:
    """A campaign folder with its scores taken in."""
    folder.mkdir()
    (folder / "campaign.toml").write_text(HEAD + factors + application + model + STOP, encoding="utf-8")
    lines = [",".join(rows[0]), *(",".join(str(value) for value in row.values()) for row in rows)]
    (folder / "scores.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    done = CliRunner().invoke(app, ["ingest", str(folder), str(folder / "scores.csv"), "--accept"])
    assert done.exit_code == 0, done.output
    return folder


def quadratic(n: int = 24, seed: int = 0, **more) -> list[dict]:
    """Scores of x and frequency, with an optimum inside."""
    rng = np.random.default_rng(seed)
    rows = []
    for i in range(n):
        a, b = (0.0, 0.0) if i % 6 == 0 else rng.uniform(-1, 1, 2)
        score = 70 - 9 * (a - 0.2) ** 2 - 6 * (b + 0.1) ** 2 + rng.normal()
        rows.append({"x": 5 + 5 * a, "frequency": 4.0 * 4.0**b, "score": round(score, 6)})
        rows[-1].update({name: values[i] for name, values in more.items()})
    return rows


def days(n: int, effect: float, seed: int) -> tuple[list[dict], np.ndarray]:
    """Scores of six days that differ, and the day of each."""
    rng = np.random.default_rng(seed)
    day = np.arange(n) % 6
    shift = effect * rng.normal(size=6)
    rows = quadratic(n, seed, block=[f"day{d}" for d in day])
    for row, d in zip(rows, day, strict=True):
        row["score"] = round(row["score"] + float(shift[d]), 6)
    return rows, day


def counted(n: int = 20) -> list[dict]:
    """Correct decisions of 200 at five values of x, with more scatter than the binomial."""
    rng = np.random.default_rng(8)
    rows = []
    for i in range(n):
        a = -1 + 2 * (i % 5) / 4
        share = 1 / (1 + np.exp(-(1.5 - 2.0 * a * a + 0.15 * rng.normal())))
        rows.append({"x": 5 + 5 * a, "n": 200, "correct": int(rng.binomial(200, share))})
    return rows
