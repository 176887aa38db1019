"""What is told at the recommended settings beside the truth there: cases of the study of intervals.

Every data set goes through the program's whole analysis: quadratic and process, the choice of settings, and what is
taken off for the choice. The control is the interval of RSL TR 380-1 eq. (2-17) at the quadratic's own best settings,
taken as fixed beforehand.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from statistics_cases import COMPARED, LEVEL, Row, surface

from seqrsm.analysis.conclude import analyse
from seqrsm.analysis.results import Analysis
from seqrsm.campaign.rehearsal import scored_run
from seqrsm.decide.sources import discrepancy_sd
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.fit.robust import STUDENT_DF
from seqrsm.spec.read import CampaignSpec, load_spec
from seqrsm.store.records import NewRun, NewScore

SIGMA, DISCREPANCY_SD = 0.5, 0.5
RUNS = {2: 16, 3: 24, 4: 36}
CASES = {
    "normal errors": "",
    "Student-t errors": 'errors = "student_t"\n',
    "random days": 'block = "day"\nblock_effect = "random"\n',
    "flights and simulations": f"discrepancy_sd = {DISCREPANCY_SD}\n",
}
"""What ``[model]`` says of each."""


def specification(k: int, name: str) -> CampaignSpec:
    """Of k factors from -1 to 1 and one measured score."""
    factors = "".join(f'[[factor]]\nname = "x{j}"\nlow = -1.0\nhigh = 1.0\n' for j in range(k))
    text = (
        f'[campaign]\nname = "told"\nseed = 1\n{factors}[[application]]\nname = "score"\nutility = "measured"\n'
        f"[model]\n{CASES[name]}[stop]\nhalf_width = 1.0\nmax_runs = 100\n"
    )
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "campaign.toml").write_text(text, "utf-8")
        return load_spec(Path(folder))


def analysed(spec: CampaignSpec, points: np.ndarray, y: np.ndarray, flown: np.ndarray, day: np.ndarray) -> Analysis:
    """All that the program says of scores (n,) at coded points (n, k)."""
    runs = []
    for i, settings in enumerate(spec.region.decode(points)):
        made = NewRun(settings, "start", source="flight" if flown[i] else "simulation", block=f"{day[i]}")
        runs.append(scored_run(i + 1, 1, made, NewScore("score", float(y[i]))))
    return analyse(spec, spec.applications[0], runs, n_draws=1000)


def scores(
    name: str, model: QuadraticModel, points: np.ndarray, beta: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """True coefficients, scores, which are flights, days, and what 1000 future runs add to the truth.

    Days: eight, the ratio of standard deviations from its prior cut at 10, the future run on a new one; the mean is
    that of the average day. Sources: a third are flights, whose surface differs by a draw from the prior.
    """
    n, new = len(points), 1000
    Z, none = model.matrix(points), np.zeros(n, dtype=int)
    if name == "Student-t errors":
        y = Z @ beta + SIGMA * rng.standard_t(STUDENT_DF, size=n)
        return beta, y, none > 0, none, SIGMA * rng.standard_t(STUDENT_DF, new)
    if name == "random days":
        ratio = float(np.tan(0.5 * np.pi * rng.uniform(0.0, 2.0 / np.pi * np.arctan(10.0))))
        day = np.arange(n) % 8
        y = Z @ beta + SIGMA * (ratio * rng.normal(size=8)[day] + rng.normal(size=n))
        return beta, y, none > 0, day, SIGMA * np.hypot(ratio, 1.0) * rng.normal(size=new)
    if name == "flights and simulations":
        flown = np.arange(n) % 3 == 0
        truth = beta + discrepancy_sd(model, DISCREPANCY_SD) * rng.normal(size=model.p)
        y = np.where(flown, Z @ truth, Z @ beta) + SIGMA * rng.normal(size=n)
        return truth, y, flown, none, SIGMA * rng.normal(size=new)
    return beta, Z @ beta + SIGMA * rng.normal(size=n), none > 0, none, SIGMA * rng.normal(size=new)


def at_the_optimum(sets: int, k: int, name: str = "normal errors") -> Iterator[Row]:
    """Mean and one run at the recommended settings; how far the mean told is off on average stands in the name."""
    spec = specification(k, name)
    for c, curvature in enumerate((12.0, 2.0, 1.0, 0.0)):
        model, _, points, beta = surface(k, RUNS[k], SIGMA * curvature)
        rng = np.random.default_rng([k, c])
        found = np.zeros((sets, 5))
        for i in range(sets):
            truth, y, flown, day, added = scores(name, model, points, beta, rng)
            one = analysed(spec, points, y, flown, day)
            best, alone = one.optimum, one.of_quadratic.point[None, :]
            at, there = (float((model.matrix(point) @ truth)[0]) for point in (best.point[None, :], alone))
            t, new = one.fitted.surface.predict(model.matrix(alone), LEVEL).confidence, at + added
            found[i] = (
                best.confidence.low <= at <= best.confidence.high,
                np.mean((best.prediction.low <= new) & (new <= best.prediction.high)),
                t.low[0] <= there <= t.high[0],
                (best.mean - at) / SIGMA,
                best.optimism / SIGMA,
            )
        mean, new_run, plain, bias, off = found.mean(axis=0)
        what = f"k = {k}, {name}, curvature {curvature:g} sigma"
        yield Row(
            f"mean; {what}; bias {bias:+.2f} sigma, {off:.2f} taken off", mean, LEVEL, True, sets, COMPARED, plain
        )
        yield Row(f"one run; {what}", new_run, LEVEL, True, sets)
