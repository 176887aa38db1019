"""Campaigns whose scores are known beforehand, analysed by the program."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from seqrsm.analysis.results import Analysis
from seqrsm.campaign.campaign import Campaign
from seqrsm.store.records import IngestedFile, IngestedRun, NewScore


def numeric(k: int) -> str:
    return "".join(f'[[factor]]\nname = "x{i}"\nlow = -1.0\nhigh = 1.0\n' for i in range(k))


def specification(factors: str, *, application: str = "", rest: str = "", seed: int = 3) -> str:
    head = f'[campaign]\nname = "test"\nseed = {seed}\n'
    use = f'[[application]]\nname = "score"\nutility = "measured"\n{application}'
    return head + factors + use + rest + "[stop]\nhalf_width = 5.0\nmax_runs = 400\n"


def campaign(
    place: Path,
    text: str,
    points: np.ndarray,
    scores: Sequence[float],
    *,
    se: Sequence[float] | None = None,
    source: Sequence[str] | str = "simulation",
    block: Sequence[str] | str = "",
) -> Campaign:
    """With a score at each of the coded points."""
    place.mkdir(parents=True)
    (place / "campaign.toml").write_text(text, encoding="utf-8")
    made, n = Campaign.open(place), len(points)
    sources = [source] * n if isinstance(source, str) else source
    blocks = [block] * n if isinstance(block, str) else block
    runs = tuple(
        IngestedRun(
            None, settings, sources[i], blocks[i], 1.0,
            (NewScore("score", float(scores[i]), None if se is None else float(se[i])),),
        )
        for i, settings in enumerate(made.spec.region.decode(points))
    )  # fmt: skip
    made.store.ingest_files([IngestedFile("f.csv", "0", n, runs)])
    return made


def analysed(place: Path, text: str, points: np.ndarray, scores: Sequence[float], **more) -> Analysis:
    (analysis,) = campaign(place, text, points, scores, **more).analyse_all(n_draws=400)
    return analysis
