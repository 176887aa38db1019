"""The compromise of a campaign: its applications, weighed with what else counts, over one region."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from seqrsm.analysis.results import Analysis
from seqrsm.analysis.scale import Interval
from seqrsm.analysis.to_json import fields_to_json
from seqrsm.arrays import FloatArray
from seqrsm.decide.compromise import Compromise, Loss, Objective, compromise
from seqrsm.design.constraints import Constraint, _evaluate
from seqrsm.design.region import Region
from seqrsm.plain import known, shallow
from seqrsm.rng import generator
from seqrsm.spec.read import CampaignSpec
from seqrsm.spec.tables import ConsiderationSpec

DRAWS = 200
"""Posterior draws of each surface that the compromise is found for."""


@dataclass(frozen=True, slots=True)
class GivenUp(Loss):
    """What one application or consideration gives up at the compromise, in its own units.

    Attributes
    ----------
    unit : str
    application : bool
        False for a consideration, whose values are exact: ``low`` and ``high`` are nan.
    own_settings : dict
        Its own optimum, natural units.
    text : str
        One sentence.
    """

    unit: str
    application: bool
    own_settings: dict[str, float | str]
    text: str

    @property
    def interval(self) -> Interval:
        """Credible interval of ``given_up``."""
        return Interval(self.low, self.high)


@dataclass(frozen=True, slots=True)
class CompromiseEstimate(Compromise):
    """The compromise in natural units.

    Attributes
    ----------
    given_up : tuple of GivenUp
        Applications first.
    settings : dict
        Natural units, by factor name.
    credible : dict
        Credible interval of each numeric factor's setting, natural units.
    level : float
    front_settings : tuple of dict
        Settings that no other beats in everything.
    """

    given_up: tuple[GivenUp, ...]
    settings: dict[str, float | str]
    credible: dict[str, Interval]
    level: float
    front_settings: tuple[dict[str, float | str], ...]

    def to_json(self) -> dict[str, Any]:
        """The compromise as a JSON document."""
        return {
            "settings": self.settings,
            "desirability": self.desirability,
            "expected_shortfall": self.expected_shortfall,
            "level": self.level,
            "settings_credible": {name: {"low": i.low, "high": i.high} for name, i in self.credible.items()},
            "given_up": [fields_to_json(row, but="own_point") for row in self.given_up],
            "pareto_front": [
                {"settings": settings, "values": values}
                for settings, values in zip(self.front_settings, self.front_values.tolist(), strict=True)
            ],
        }


def campaign_compromise(spec: CampaignSpec, analyses: Sequence[Analysis]) -> CompromiseEstimate | None:
    """The compromise over all applications and considerations; None where there is nothing to weigh."""
    if len(analyses) + len(spec.considerations) < 2 or len(analyses) < len(spec.applications):
        return None
    objectives = [_application(spec, analysis) for analysis in analyses]
    objectives += [_consideration(spec.region, table) for table in spec.considerations]
    found = compromise(spec.region, objectives, level=spec.stop.level, seed=spec.seed % 2**32)
    return _in_natural_units(spec, analyses, found)


def _application(spec: CampaignSpec, analysis: Analysis) -> Objective:
    table = spec.application(analysis.application)
    scale, belief, departure = analysis.scale, analysis.belief, analysis.fitted.departure
    draws = analysis.posterior.term_draws
    some = draws[:: max(1, len(draws) // DRAWS)][:DRAWS]
    surfaces = []
    if departure.believed is not None:
        rng = generator(spec.seed, analysis.fit.n_runs, "compromise")
        surfaces = [departure.believed.draw(rng)[0] for _ in range(round(departure.probability * len(some)))]
        some = some[: len(some) - len(surfaces)]

    def drawn(points: FloatArray) -> FloatArray:
        of_process = [surface(points) for surface in surfaces]
        return scale.to_score(np.vstack([some @ analysis.model.matrix(points).T, *of_process]))

    return Objective(
        table.name,
        table.goal,
        table.weight,
        lambda points: scale.to_score(belief.mean(points)),
        drawn,
        table.unacceptable,
        table.ideal,
    )


def _consideration(region: Region, table: ConsiderationSpec) -> Objective:
    tree = Constraint(f"0 <= ({table.expr})")._tree

    def value(points: FloatArray) -> FloatArray:
        with np.errstate(all="ignore"):
            found = np.broadcast_to(_evaluate(tree[2], region.natural(points))[0], (len(points),))
        return np.asarray(found, dtype=np.float64)

    return Objective(table.name, table.goal, table.weight, value, None, table.unacceptable, table.ideal)


def _in_natural_units(spec: CampaignSpec, analyses: Sequence[Analysis], found: Compromise) -> CompromiseEstimate:
    region, tail = spec.region, 0.5 * (1.0 - spec.stop.level)
    credible = {}
    for j in region.numeric if len(found.draw_points) else ():
        low, high = region.factors[j].decode(np.quantile(found.draw_points[:, j], [tail, 1.0 - tail]))  # type: ignore[union-attr]
        credible[region.names[j]] = Interval(float(low), float(high))
    rows = []
    for i, loss in enumerate(found.given_up):
        unit = analyses[i].score_unit if i < len(analyses) else spec.considerations[i - len(analyses)].unit
        suffix = f" {unit}" if unit else ""
        between = f"{100 * spec.stop.level:g} % credible interval {loss.low:.3g} to {loss.high:.3g}"
        tail_text = f" ({between})" if np.isfinite(loss.low) else ""
        spread = loss.high - loss.low if np.isfinite(loss.low) else loss.given_up
        rows.append(
            GivenUp(
                **shallow(loss),
                unit=unit,
                application=i < len(analyses),
                own_settings=region.decode(loss.own_point)[0],
                text=f"{loss.name}: {known(loss.value, spread)}{suffix} against "
                f"{known(loss.own_best, spread)} at its own optimum, "
                f"{loss.given_up:.3g}{suffix} given up{tail_text}.",
            )
        )
    return CompromiseEstimate(
        **shallow(found) | {"given_up": tuple(rows)},
        settings=region.decode(found.point)[0],
        credible=credible,
        level=spec.stop.level,
        front_settings=tuple(region.decode(found.front_points)),
    )
