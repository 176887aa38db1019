"""The fidelity planner: the cheapest model of a run whose error is proven to stay within the campaign's tolerance.

The ladder, cheapest first. All rungs draw the same occasion of a run (fields, date, moisture, training ground); they
differ in how much of the image they make and in what of the ground they heed.

========  ==========================================================================================
``F0``    no image: single pixels of ground taken as flat, fading or noise drawn several times
``F1``    strips of a radar's image, on a data base of wider cells
``F2``    strips of a radar's image at full resolution; single footprints of a radiometer on the ground as it lies
``F3``    the whole image, fading or noise drawn several times, so that it is integrated out of the score
``F4``    the whole image with one draw of fading, receiver, and everything else
========  ==========================================================================================

Each effect gets a verdict from the scene's statistics and the sensor. The bound of a rung is the sum of what it leaves
out and of one standard error of looking at a part of the ground; its sizes are chosen as small as the tolerance allows.
Functions of their arguments alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from typing import Any, Final, Literal, NamedTuple

import numpy as np

from seqrsm.arrays import BoolArray, FloatArray, IntArray
from seqrsm.errors import ConfigurationError, Problem
from seqrsm.rng import generator
from seqrsm.simulate import bounds

Rung = Literal["F0", "F1", "F2", "F3", "F4"]
Verdict = Literal["exact", "bounded", "needed"]

RUNGS: Final[tuple[Rung, ...]] = ("F0", "F1", "F2", "F3", "F4")

MEANINGS: Final[Mapping[str, str]] = {
    "F0": "single pixels of flat ground, no image",
    "F1": "strips of the image on a coarser data base",
    "F2": "strips or single footprints of the image at full resolution",
    "F3": "the whole image, fading or noise integrated out",
    "F4": "the whole image with everything drawn once",
}

DRAWS: Final = (1, 2, 4, 8)
"""How often fading may be drawn in the cheaper rungs."""

FULL_DRAWS: Final = 8
"""Most draws where fading is integrated out over the whole image."""

WORTHWHILE: Final = 0.7
"""A cheaper rung is taken where it is expected to need no more of the full simulation's time than this part."""

QUIET: Final = 0.4
"""Part of the tolerance that the draws of a whole image may leave."""

CHECKED_SHARE: Final = 0.05
"""Share of runs that the next rung makes too, to hold the difference against the bounds."""

CHECK_LIMIT: Final = 3.0
"""Standard errors of sampling that such a difference may reach beyond what is left out."""

LEAST_SCORED: Final = 30.0
"""Fewest scored pixels that a sample is expected to hold: where little is scored, fewer could miss all of it."""

LEAST_OF_CLASS: Final = 30.0
"""Fewest pixels of the rarest class that a sample is expected to hold. A class that few pixels teach takes much of the
ground from the others or none, by chance, and the score jumps with it."""

LEAST_COLUMNS: Final = 8
"""Fewest strips: their scatter is known to a third."""

_CHOICES: Final = 300
"""Most numbers of columns that are weighed against each other."""


@dataclass(frozen=True, slots=True)
class Effect:
    """What leaving one effect out would do to the score.

    Attributes
    ----------
    name : str
    verdict : {"exact", "bounded", "needed"}
        Proven to change nothing; changes the score by no more than `bound`, within the tolerance; or more than that.
    bound : float
        Largest change of the score [score units]; inf where no bound is known.
    text : str
        The test and its numbers.
    """

    name: str
    verdict: Verdict
    bound: float
    text: str


@dataclass(frozen=True, slots=True)
class RungPlan:
    """How one rung would make a run's score.

    Attributes
    ----------
    rung : str
    bias : float
        Sum of the bounds of what it leaves out [score units].
    sampling : float
        Standard error of looking at a part of the ground, at most [score units].
    effort : float
        Estimated time [s]; ranks rungs, and is no promise.
    columns, rows : int
        Pixels along the flight and across that are taken.
    draws : int
        Of fading or noise.
    coarse : int
        Cells of the data base along a side of one cell of the coarser one.
    points : int
        That stand for the beam of a radiometer's footprint; 0 where the beam is whole.
    left_out : tuple of str
        Names of the effects it leaves out.
    scatter : float
        Standard error of its own draw of fading or noise, where that belongs to the run [score units]; 0 elsewhere.
    refused : str
        Why it cannot be used at all, "" if it can.
    """

    rung: Rung
    bias: float = 0.0
    sampling: float = 0.0
    effort: float = 0.0
    columns: int = 0
    rows: int = 0
    draws: int = 1
    coarse: int = 1
    points: int = 0
    left_out: tuple[str, ...] = ()
    scatter: float = 0.0
    refused: str = ""

    @property
    def bound(self) -> float:
        """Bias and standard error together [score units]."""
        return self.bias + self.sampling


@dataclass(frozen=True, slots=True)
class Plan:
    """What the planner decided for one run.

    Attributes
    ----------
    chosen : RungPlan
    rungs : tuple of RungPlan
        All, cheapest model first.
    effects : tuple of Effect
    tolerance : float
        Accepted error [score units].
    why : str
        The decision in words.
    """

    chosen: RungPlan
    rungs: tuple[RungPlan, ...]
    effects: tuple[Effect, ...]
    tolerance: float
    why: str

    def next_rung(self) -> RungPlan | None:
        """The next rung above the chosen one that is no worse and takes no longer than the top; None at the top."""
        limit, top = max(self.tolerance, self.chosen.bound), self.rungs[-1]
        above = self.rungs[RUNGS.index(self.chosen.rung) + 1 :]
        good = (plan for plan in above if not plan.refused and plan.bound <= limit and plan.effort <= top.effort)
        return next(good, None)

    def of(self, rung: str) -> RungPlan:
        """Plan of one rung."""
        return self.rungs[RUNGS.index(rung)]

    def record(self) -> dict[str, Any]:
        """What is kept with a score: plain numbers and names."""
        chosen = self.chosen
        return {
            "rung": chosen.rung,
            "bound": round(chosen.bound, 6),
            "bias_bound": round(chosen.bias, 6),
            "sampling_bound": round(chosen.sampling, 6),
            "left_out": list(chosen.left_out),
            "tolerance": self.tolerance,
        }

    def to_json(self) -> dict[str, Any]:
        """All of it as a JSON document; None stands for no bound."""
        rungs = [
            {**asdict(plan), "bound": plan.bound, "meaning": MEANINGS[plan.rung], "left_out": list(plan.left_out)}
            for plan in self.rungs
        ]
        effects = [{**asdict(effect), "bound": _finite(effect.bound)} for effect in self.effects]
        for row in rungs:
            for name in ("bias", "sampling", "scatter", "bound"):
                row[name] = _finite(float(row[name]))
        return {
            "rung": self.chosen.rung,
            "bound": _finite(self.chosen.bound),
            "tolerance": self.tolerance,
            "why": self.why,
            "rungs": rungs,
            "effects": effects,
        }


def _finite(x: float) -> float | None:
    return x if math.isfinite(x) else None


def effect(name: str, bound: float, tolerance: float, text: str, *, proven: bool = False) -> Effect:
    """Effect with the verdict that its bound earns; "exact" only by proof, not because a number came out as zero."""
    verdict: Verdict = "exact" if proven and bound == 0.0 else "bounded" if bound <= tolerance else "needed"
    return Effect(name, verdict, bound, text)


def sampled_effect(plan: RungPlan, ground: Ground, tolerance: float, name: str, what: str) -> Effect:
    """What a sample of the ground does not see, for the record."""
    text = f"{plan.columns} of {ground.n_columns} {what} are looked at: standard error"
    return effect(name, plan.sampling, tolerance, text, proven=plan.sampling == 0.0)


def choose(
    rungs: Sequence[RungPlan],
    effects: Sequence[Effect],
    tolerance: float,
    fidelity: str = "auto",
    widening: Mapping[str, float] | None = None,
) -> Plan:
    """Take the cheapest rung whose bound meets the tolerance.

    Parameters
    ----------
    rungs : sequence of RungPlan
        One for each of `RUNGS`, in that order.
    effects : sequence of Effect
    tolerance : float
        Accepted error [score units], > 0.
    fidelity : "auto" or a rung
        A rung takes the decision out of the planner's hands.
    widening : Mapping, optional
        Factor by which a rung's bound was seen to be too small, >= 1.

    Returns
    -------
    Plan

    Raises
    ------
    ConfigurationError
        The rung asked for cannot be used.
    """
    factors = widening or {}
    widened = tuple(_widened(plan, factors.get(plan.rung, 1.0)) for plan in rungs)
    if fidelity != "auto":
        asked = widened[RUNGS.index(fidelity)]
        if asked.refused:
            remedy = 'Use "auto" or "F4"'
            raise ConfigurationError(Problem(f"{fidelity}: {asked.refused}", remedy, field="fidelity", value=fidelity))
        why = f"{fidelity} was asked for; its error is at most {_shown(asked.bound)}"
        return Plan(asked, widened, tuple(effects), tolerance, why)
    limit = WORTHWHILE * widened[-1].effort
    good = [plan for plan in widened[:-1] if not plan.refused and plan.bound <= tolerance and plan.effort <= limit]
    good.append(widened[-1])
    chosen = min(good, key=lambda plan: (plan.effort, -RUNGS.index(plan.rung)))
    return Plan(chosen, widened, tuple(effects), tolerance, _why(chosen, widened, tolerance))


def _widened(plan: RungPlan, factor: float) -> RungPlan:
    return plan if factor == 1.0 else replace(plan, bias=plan.bias * factor, sampling=plan.sampling * factor)


def _why(chosen: RungPlan, rungs: Sequence[RungPlan], tolerance: float) -> str:
    parts = [f"{chosen.rung}, {MEANINGS[chosen.rung]}: error at most {_shown(chosen.bound)} of {tolerance:g} accepted"]
    for plan in rungs[: RUNGS.index(chosen.rung)]:
        if plan.refused:
            parts.append(f"{plan.rung} cannot be used: {plan.refused}")
        elif plan.bound > tolerance:
            parts.append(f"{plan.rung} could be off by {_shown(plan.bound)}")
        else:
            parts.append(f"{plan.rung} would save no time here")
    return "; ".join(parts)


def _shown(bound: float) -> str:
    return f"{bound:.2g}" if math.isfinite(bound) else "an unknown amount"


def checked(seed: int, run_id: int) -> bool:
    """Whether the choice for a run is checked by the next rung: a twentieth of the runs, drawn by their id."""
    return bool(generator(seed, run_id, "fidelity check").random() < CHECKED_SHARE)


def largest_difference(one: RungPlan, other: RungPlan) -> float:
    """How far the scores of two rungs may differ before a bound is called violated [score units]."""
    return one.bias + other.bias + CHECK_LIMIT * math.hypot(one.sampling, other.sampling, other.scatter)


def full_draws(ground: Ground, tolerance: float) -> int:
    """Draws of fading for a whole image that leave next to no scatter of their own."""
    n = ground.n_rows * ground.n_columns
    wanted = (ground.draw_error(n, 1) / (QUIET * tolerance)) ** 2
    return int(min(max(math.ceil(wanted), 1), FULL_DRAWS))


@dataclass(frozen=True, slots=True)
class Ground:
    """What the sampling error of an image depends on.

    Attributes
    ----------
    correlation_m : float
        Over which the fields stay the same [m].
    mixed : float
        Share of pixels that hold more than one category.
    across_m, along_m : float
        Extent of the image [m].
    n_rows, n_columns : int
        Its pixels across and along the flight.
    spread : float
        Largest standard deviation of one pixel's part in the score [score units].
    drawn : float
        Part of that variance at most that is due to the draw of fading or noise, 0 to 1.
    scored : float
        Share of the ground that is scored, above 0: the other pixels tell nothing.
    teaching : float
        Factor by which the error grows because the sample also teaches, `bounds.teaching_factor`.
    rarest : float
        Share of the scored ground that the rarest class has, where classes are told apart; else 1.
    taught : int
        Parameters that the sample teaches: few pixels teach worse, a bias of `spread` x this / pixels.
    """

    correlation_m: float
    mixed: float
    across_m: float
    along_m: float
    n_rows: int
    n_columns: int
    spread: float
    drawn: float = 1.0
    scored: float = 1.0
    teaching: float = 1.0
    rarest: float = 1.0
    taught: int = 0

    def sampling_errors(self, rows: IntArray, columns: IntArray, draws: IntArray) -> FloatArray:
        """Standard errors of a score from so many rows and columns of pixels against that of all [score units].

        A pixel of one field shares its luck with that field, which the sample may give too much or too little room; one
        on a border has its own, none of it where all pixels are taken; and of either the draws of fading have a part.
        Few pixels also teach worse: with q parameters by q / n of the error, q half of those of a classifier's classes.
        """
        pixels = (rows * columns).astype(np.float64)
        part = pixels / (self.n_rows * self.n_columns)
        points, whole = np.ones(pixels.shape), np.ones(pixels.shape)
        for n, full, extent in ((columns, self.n_columns, self.along_m), (rows, self.n_rows, self.across_m)):
            at_points, over_line = bounds.sampling_variance(self.correlation_m, n, extent)
            points *= np.where(n >= full, over_line, at_points)
            whole *= over_line
        places = np.maximum(points - whole, 0.0)
        borders = np.maximum((1.0 - part) / pixels, places)
        fading = 1.0 / (pixels * draws)
        pure, mixed = (x + self.drawn * np.maximum(fading - x, 0.0) for x in (places, borders))
        scatter = np.sqrt(((1.0 - self.mixed) * pure + self.mixed * mixed) / self.scored)
        error = self.spread * (self.teaching * scatter + self.taught * (1.0 - part) / (pixels * self.scored))
        return np.asarray(np.where((part < 1.0) & self._short(pixels), np.inf, error))

    def refusal(self) -> str:
        """Why no part of the ground can stand for it; "" where it can."""
        n = self.n_rows * self.n_columns * self.scored
        if n < LEAST_SCORED:
            return f"only {n:.2g} pixels are scored"
        short = self._short(np.array([n / self.scored]))[0]
        return f"the rarest cover fills {n * self.rarest:.2g} pixels only" if short else ""

    def _short(self, pixels: FloatArray) -> BoolArray:
        scored = pixels * self.scored
        rare = scored * self.rarest < LEAST_OF_CLASS if self.rarest < 1.0 else np.zeros(pixels.shape, dtype=np.bool_)
        return np.asarray((scored < LEAST_SCORED) | rare)

    def draw_error(self, pixels: int, draws: int) -> float:
        """Standard error that so many draws of fading on so many pixels leave [score units]."""
        return self.teaching * self.spread * math.sqrt(self.drawn / (pixels * draws * self.scored))


class Size(NamedTuple):
    """Part of the ground that a rung takes; time as estimated [s], sampling error in score units."""

    effort: float
    rows: int
    columns: int
    draws: int
    sampling: float

    def plan(self, rung: Rung, bias: float, **more: Any) -> RungPlan:
        """Plan of the rung that takes it; ``more``: other fields."""
        size: dict[str, Any] = self._asdict()
        return RungPlan(rung, bias, **size, **more)


def smallest(ground: Ground, allowed: float, effort: Callable[[int, int, int], float], *, square: bool) -> Size:
    """Part of the ground of least effort whose sampling error is allowed.

    Parameters
    ----------
    ground : Ground
    allowed : float
        [score units]
    effort : callable
        (rows, columns, draws) -> time.
    square : bool
        Thin out in both directions alike; otherwise all rows are kept.

    Returns
    -------
    Size
        All rows and columns where nothing less will do.
    """
    rows, columns, draws, errors = _errors(ground, square)
    enough = errors <= allowed
    enough[:, -1] = True
    found: list[Size] = []
    for k, (at, d) in enumerate(zip(enough.argmax(axis=1).tolist(), draws, strict=True)):
        r, c = int(rows[at]), int(columns[at])
        found.append(Size(effort(r, c, d), r, c, d, float(errors[k, at])))
    return min(found)


@lru_cache(maxsize=8)
def _errors(ground: Ground, square: bool) -> tuple[IntArray, IntArray, tuple[int, ...], FloatArray]:
    """Rows, columns, draws that may be taken, and the sampling error of each (n_draws, n), falling along the last axis.

    All numbers of columns there are, or `_CHOICES` in equal ratios.
    """
    least, most = min(LEAST_COLUMNS, ground.n_columns), ground.n_columns
    columns = np.unique(np.rint(np.geomspace(least, most, _CHOICES)).astype(np.int64))
    rows = np.full(columns.shape, ground.n_rows)
    if square:
        wanted = np.rint(columns * (ground.across_m / ground.along_m)).astype(np.int64)
        rows = np.clip(wanted, 1, ground.n_rows)
    draws = DRAWS if ground.drawn > 0.0 else (1,)
    return rows, columns, draws, ground.sampling_errors(rows, columns, np.array(draws)[:, None])
