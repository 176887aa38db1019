"""What ``[application.prior]`` must hold beyond the type of each key."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf, isfinite

from seqrsm.design.factors import CategoricalFactor, Factor, span
from seqrsm.spec.checks import Reporter
from seqrsm.spec.tables import ApplicationSpec, ModelSpec
from seqrsm.spec.toml_lines import Path


def knowledge(
    applications: Sequence[ApplicationSpec | None], factors: Sequence[Factor], model: ModelSpec | None, report: Reporter
) -> None:
    """What ``[application.prior]`` says is possible, and said in one place only."""
    numeric = {factor.name: factor for factor in factors if not isinstance(factor, CategoricalFactor)}
    known_factors = f"The numeric factors are {', '.join(numeric)}." if numeric else "There are none."
    for index, application in enumerate(applications):
        if application is None or application.prior is None:
            continue
        prior = application.prior
        path: Path = ("application", index, "prior")
        if prior.utility is not None:
            if model is not None and model.prior is not None:
                report.add(path, "there is a prior in [model], too", "Say it in one place.")
            _check_utility(path, prior.utility, application.is_percent, report)
        elif prior.optimum or prior.repeat_sd is not None or not prior.effect:
            remedy = "Give utility = [low, high]: the mean score at a setting taken at random."
            report.add(path, "the range of the utility is missing", remedy)
        for name in (*prior.optimum, *prior.effect):
            if name not in numeric:
                key = "optimum" if name in prior.optimum else "effect"
                report.add((*path, key, name), f"'{name}' is no numeric factor", known_factors)
        for name, expected in prior.optimum.items():
            if name not in numeric:
                continue
            value = expected if isinstance(expected, (int, float)) else expected.value
            low, high = span(numeric[name])
            if not low <= value <= high:
                remedy = f"Give a value from {low:g} to {high:g}."
                place = (*path, "optimum", name)
                report.add(place, "the optimum is expected outside the factor's range", remedy, value)
        logit = model is not None and model.response == "logit"
        for name, (least, most) in prior.effect.items():
            place = (*path, "effect", name)
            if not least < most or (least, most) == (-inf, inf):
                remedy = "Give [least, most], such as [0.0, inf] for a score that rises."
                report.add(place, "these bounds say nothing or cannot be", remedy, [least, most])
            elif logit and any(isfinite(end) and end != 0.0 for end in (least, most)):
                remedy = "Give 0 or no bound (inf): on the logit scale only the sign of an effect can be bounded."
                report.add(place, "the bounds of the effect are no signs", remedy, [least, most])


def _check_utility(path: Path, stated: Sequence[float], is_percent: bool, report: Reporter) -> None:
    low, high = stated
    inside = not is_percent or (low >= 0.0 and high <= 100.0)
    if not (low < high and inside):
        limits = ", between 0 and 100" if is_percent else ""
        report.add((*path, "utility"), "this is no range of scores", f"Give [low, high]{limits}.", [low, high])
