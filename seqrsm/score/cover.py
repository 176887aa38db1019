"""How well images name the cover of the ground: by pixel, neighbourhood, segment or field, in the measures of mapping.

Every scored cell of the data base counts, so an image whose pixels straddle field borders pays for them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from seqrsm.arrays import AnyArray, BoolArray, FloatArray, IntArray
from seqrsm.errors import SceneError
from seqrsm.scene.scene import Scene
from seqrsm.score.classification import (
    Taught,
    UtilityScore,
    areas_taught,
    by_map_alone,
    cluster_ratio,
    knowing_areas,
    named,
    taught,
    trusting,
)
from seqrsm.score.evidence import Evidence, evidence_of
from seqrsm.score.known_map import KnownMap
from seqrsm.score.pixels import Image
from seqrsm.score.utilities import Asked

FALSE_ALARMS: Final = 0.05
"""Share of other ground that may be taken for the cover sought."""

_GROUPS: Final = 400  # of tiles, for a jackknife


def score_cover(
    images: Sequence[Image], scene: Scene, asked: Asked, *, seed: int, run_id: int, known: KnownMap | None = None
) -> UtilityScore:
    """Score of the covers that a Gaussian classifier names; see `seqrsm.score.classification.taught`.

    Images are of one ground, made of the scene, one at least; all are evidence together. ``seed`` and ``run_id`` key
    the split into halves: the sample of training fields is part of the run's randomness. ``known`` is a map that is
    there already: the classifier knows its labels too, and the floor is what it scores alone.

    Raises
    ------
    SceneError
        No scored cell lies in the finest image, those of one cover alone, or none of the covers asked for.
    """
    evidence = evidence_of(images, scene, by=asked.by, seed=seed, run_id=run_id, known=known)
    return score_evidence(evidence, scene.categories, asked)


def score_evidence(evidence: Evidence, categories: Sequence[str], asked: Asked) -> UtilityScore:
    """`score_cover` of what is known of each unit of ground; ``categories`` are the names of its classes.

    The standard error is over tiles. Details: ``per_class_percent``, cells named rightly by class; ``named_by``, the
    unit of ground.
    """
    unknown = [name for name in asked.covers if name not in categories]
    if unknown:
        remedy = f"The scene has {', '.join(categories)}."
        raise SceneError("no such cover", remedy, field="[[application]] utility", value=", ".join(unknown))
    covers = [categories.index(name) for name in asked.covers]
    sought, mapped = asked.name == "detection", evidence.label is not None
    laws = taught(evidence)
    if asked.knows_areas(mapped):
        error = asked.name == "area_error"
        laws = knowing_areas(laws, areas_taught(evidence, laws) if error else evidence.counts.sum(axis=0))
    if mapped:
        sign, name = -1.0 if asked.row.is_error else 1.0, "percent_correct" if sought else asked.name
        laws = trusting(evidence, laws, lambda found: sign * float(measure(found, name, covers)))

    def confusions(by: Taught) -> AnyArray:
        return _at_false_alarms(evidence, by, covers) if sought else named(evidence, by)

    by_tile = confusions(laws)
    total = by_tile.sum(axis=0)
    true = np.rint(total.sum(axis=1)).astype(np.int64)  # names drawn by lot leave no whole numbers
    if np.count_nonzero(true) == 1:
        text = f"all scored ground in the image is {categories[int(true.argmax())]}: there is nothing to tell apart"
        raise SceneError(text, "Let the swath or the mask of scored cells hold more ground.", field="utility")
    if covers and not true[covers].any():
        raise SceneError(
            "no scored cell of these covers lies in the image", field="utility", value=", ".join(asked.covers)
        )
    if asked.name == "percent_correct":
        cells = by_tile.sum(axis=(1, 2))
        value, se = cluster_ratio(np.trace(by_tile, axis1=1, axis2=2), cells)
        value, se = 100.0 * value, 100.0 * se
    else:
        value = float(measure(total, asked.name, covers))
        se = _jackknife(by_tile, asked.name, covers)
    details: dict[str, object] = {
        "named_by": asked.by,
        "per_class_percent": {categories[k]: 100.0 * float(total[k, k]) / float(n) for k, n in enumerate(true) if n},
    }
    guess, perfect = ends_of(true, asked.name, covers)
    if mapped:
        blind = by_map_alone(evidence)
        for by in (blind, knowing_areas(blind, true)):
            by_map = float(measure(confusions(by).sum(axis=0), asked.name, covers))
            guess = min(guess, by_map) if asked.row.is_error else max(guess, by_map)
    return UtilityScore(value, se, guess, perfect, int(true.sum()), len(by_tile), total, details)


def measure(confusion: IntArray | FloatArray, name: str, covers: Sequence[int] = ()) -> FloatArray:
    """A measure of confusion matrices (..., n, n), rows the truth and columns the names.

    Classes without any cell of the truth are no part of a mean. Measures are "percent_correct", "class_mean_correct",
    "worst_class_correct", and of some ``covers`` "f1", "detection" [percent]; "kappa" (Cohen 1960, Educ. Psychol. Meas.
    20, 37-46); of covers "area_error": difference of the area named and the true one, sign dropped [percent of the true
    one], of a classifier that knows the areas of the ground that taught it.
    """
    c = np.asarray(confusion, dtype=np.float64)
    right, true, named = np.diagonal(c, axis1=-2, axis2=-1), c.sum(axis=-1), c.sum(axis=-2)
    all_cells, k = true.sum(axis=-1), list(covers)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = right / true
        if name == "percent_correct":
            value = 100.0 * right.sum(axis=-1) / all_cells
        elif name == "class_mean_correct":
            value = 100.0 * np.nanmean(share, axis=-1)
        elif name == "worst_class_correct":
            value = 100.0 * np.nanmin(share, axis=-1)
        elif name == "kappa":
            by_chance = (true * named).sum(axis=-1) / all_cells**2
            value = (right.sum(axis=-1) / all_cells - by_chance) / (1.0 - by_chance)
        elif name == "f1":
            value = 100.0 * (2.0 * right / (true + named))[..., k].mean(axis=-1)
        elif name == "detection":
            value = 100.0 * c[..., k, :][..., k].sum(axis=(-2, -1)) / true[..., k].sum(axis=-1)
        else:
            wanted = true[..., k].sum(axis=-1)
            value = 100.0 * np.abs(named[..., k].sum(axis=-1) - wanted) / wanted
    return np.asarray(value)


def ends_of(true: IntArray, name: str, covers: Sequence[int] = ()) -> tuple[float, float]:
    """What a guess that looks at nothing scores by a measure, and what perfect data do.

    The guess names everything as one cover, that which scores best, or of `FALSE_ALARMS` of all ground says that it is
    the one sought; an area is guessed to be none. ``true`` (n_classes,): cells of each class; the rest as of `measure`.
    """
    share = true / true.sum()
    present = int((true > 0).sum())
    guesses = {
        "percent_correct": 100.0 * float(share.max()),
        "class_mean_correct": 100.0 / present,
        "worst_class_correct": 100.0 if present == 1 else 0.0,
        "kappa": 0.0,
        "f1": max((200.0 * share[k] / (1.0 + share[k]) for k in covers), default=0.0) / max(len(covers), 1),
        "area_error": 100.0,
        "detection": 100.0 * FALSE_ALARMS,
    }
    return float(guesses[name]), {"kappa": 1.0, "area_error": 0.0}.get(name, 100.0)


def _jackknife(by_tile: AnyArray, name: str, covers: Sequence[int]) -> float:
    """Standard error of a measure over groups of tiles, each left out in turn; nan with one tile."""
    n = min(len(by_tile), _GROUPS)
    if n < 2:
        return math.nan
    groups = np.zeros((n, *by_tile.shape[1:]))
    np.add.at(groups, np.arange(len(by_tile)) % n, by_tile)
    left = measure(groups.sum(axis=0) - groups, name, covers)
    left = left[np.isfinite(left)]
    return (
        math.sqrt((len(left) - 1) / len(left) * float(np.square(left - left.mean()).sum())) if len(left) else math.nan
    )


def _at_false_alarms(evidence: Evidence, by: Taught, covers: Sequence[int]) -> FloatArray:
    """As `named`, when the covers are favoured so much that `FALSE_ALARMS` of other ground is taken for them.

    Of units that are alike, as by the label of a map, and in a half that was not taught the covers, or nothing else, as
    many as may be are drawn by lot: a straight part of the receiver operating characteristic (Fawcett 2006, Pattern
    Recognition Letters 27(8)).
    """
    others = np.delete(np.arange(evidence.counts.shape[1]), covers)
    if not evidence.counts.sum(axis=0)[others].any():
        raise SceneError("the image has no other ground than these covers", field="utility")
    unknown = by.laws[-1][by.half[by.seen]] == -np.inf
    alone: BoolArray = unknown[:, others].all(axis=1)  # where nothing else was taught
    untaught: BoolArray = alone | unknown[:, list(covers)].all(axis=1)

    def at(bonus: float) -> IntArray:
        return named(evidence, by, covers, bonus)

    def alarms(confusion: IntArray) -> float:
        other = confusion[~untaught].sum(axis=0)[others]
        return float(other[:, list(covers)].sum() / max(int(other.sum()), 1))

    low, high = -1.0, 1.0
    while alarms(at(high)) < FALSE_ALARMS and high < 1e9:
        high *= 4.0
    while alarms(at(low)) > FALSE_ALARMS and low > -1e9:
        low *= 4.0
    for _ in range(24):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if alarms(at(middle)) < FALSE_ALARMS else (low, middle)
    few, many = at(low), at(high)
    none, every = few.copy(), np.zeros_like(few)
    none[:, :, others[0]] += few[:, :, list(covers)].sum(axis=2)
    none[:, :, list(covers)] = 0
    every[:, :, covers[0]] = few.sum(axis=2)
    few = np.where(alone[:, None, None] | (alarms(few) > FALSE_ALARMS), none, few)
    many = np.where(untaught[:, None, None] | (alarms(many) < FALSE_ALARMS), every, many)
    between = np.interp(FALSE_ALARMS, [alarms(few), alarms(many)], [0.0, 1.0])
    part = np.where(untaught, FALSE_ALARMS, between)[:, None, None]
    return np.asarray((1.0 - part) * few + part * many)
