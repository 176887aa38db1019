"""``seqrsm plan``: what so many runs can give, over the factors that are kept, the order, the target and the cost.

Every number follows from optimal designs: of N runs over the factors that are kept, h = tr(moments (Z'Z)^-1) is the
mean variance of the fitted score over the region, in those of a run, and the variances of the linear terms tell how far
the estimated optimum lies from the true one. Half-width and loss are worked out from these by the page that shows them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from seqrsm.analysis.conclude import stop_rule
from seqrsm.campaign.campaign import Campaign
from seqrsm.campaign.check import probe_noise
from seqrsm.decide.intervals import t_quantile
from seqrsm.design.factors import Factor
from seqrsm.design.moments import region_moments
from seqrsm.design.optimal import optimal_design
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.spec.read import CampaignSpec

SIZES = (1.25, 2.0, 3.5, 6.0)
"""Runs a term of the designs that are searched; between them N h, which hardly changes, is interpolated."""

_ALL_SUBSETS = 4
"""Factors of which every subset is planned; of more, all of them and all but one."""

_STARTS = 4
_MOST_DF = 400


def plan(campaign: Campaign, progress: Callable[[int, int], None] = lambda done, total: None) -> dict[str, Any]:
    """Return what runs can give in a campaign, as a JSON document; nothing is written.

    Parameters
    ----------
    campaign : Campaign
        Opened, with or without scores.
    progress : callable
        Told how many designs are searched of how many.

    Returns
    -------
    dict
        ``models``: for each set of kept factors and order the terms p and ``designs``, rows of N, h, and the sum g of
        the variances of the linear terms of numeric factors; ``t``: quantiles by degrees of freedom from 1; ``share``:
        what future runs add to h; ``s``: standard deviation of a run, None where nothing tells it, with ``source``;
        ``drop``: by how much the score falls from its best to the end of a factor; the campaign's target, budget, cost.
    """
    spec = campaign.spec
    s, drop, ground, source = _noise(campaign, progress)
    rule = stop_rule(spec, ground)
    orders = (1, 2) if any(True for _ in spec.region.numeric) else (1,)
    wanted = [(kept, order) for kept in _subsets(spec.region.k) for order in orders]
    models = []
    for done, (kept, order) in enumerate(wanted):
        progress(done, len(wanted))
        models.append(_model(spec, kept, order))
    replicates = rule.replicates_of()
    return {
        "campaign": spec.name,
        "factors": list(spec.region.names),
        "unit": spec.applications[0].unit,
        "level": spec.stop.level,
        "interval": spec.stop.interval,
        "replicates": spec.stop.replicates,
        "share": 0.0 if math.isinf(replicates) else 1.0 / replicates,
        "s": s,
        "source": source,
        "drop": drop,
        "half_width": spec.stop.half_width,
        "max_runs": spec.stop.max_runs,
        "order": spec.model.order,
        "cost": spec.cost.simulation if spec.simulator is not None else spec.cost.flight,
        "cost_unit": spec.cost.unit,
        "t": [round(float(x), 5) for x in t_quantile(np.arange(1, _MOST_DF + 1), spec.stop.level)],
        "models": models,
    }


def _subsets(k: int) -> list[tuple[int, ...]]:
    """Kept factors, all of them first."""
    sizes = range(k, 0, -1) if k <= _ALL_SUBSETS else range(k, max(k - 2, 0), -1)
    return [kept for size in sizes for kept in itertools.combinations(range(k), size)]


def _model(spec: CampaignSpec, kept: tuple[int, ...], order: int) -> dict[str, Any]:
    factors: tuple[Factor, ...] = tuple(spec.region.factors[j] for j in kept)
    names = {factor.name for factor in factors}
    # A constraint on a factor that is held fixed is one on the others only there: it is left out.
    region = Region(factors, tuple(one for one in spec.region.constraints if one.names <= names))
    model = QuadraticModel(factors, order)
    moments = region_moments(model, region)
    linear = [i for i, name in enumerate(model.term_names) if name in {factors[j].name for j in region.numeric}]
    designs = []
    for size in SIZES:
        n = max(model.p + 2, math.ceil(size * model.p))
        points = optimal_design(model, region, n, "I", seed=spec.seed % 2**31, starts=_STARTS).points
        Z = model.matrix(points)
        inverse = np.linalg.inv(Z.T @ Z)
        designs.append([n, float(np.trace(moments @ inverse)), float(np.sum(np.diagonal(inverse)[linear]))])
    designs = [[n, float(f"{h:.5g}"), float(f"{g:.5g}")] for n, h, g in designs]
    return {"kept": list(kept), "order": order, "p": model.p, "numeric": len(region.numeric), "designs": designs}


def _noise(campaign: Campaign, progress: Callable[[int, int], None]) -> tuple[float | None, float | None, float, str]:
    """Standard deviation of a run, fall of the score to the end of a factor, the ground's share, and the source."""
    spec = campaign.spec
    if campaign.store.runs("scored"):
        analysis = campaign.analyse_all(spec.applications[0].name)[0]
        spread = float(np.ptp(analysis.scale.to_score(analysis.fit.fitted)))
        if np.isfinite(analysis.fit.s) and analysis.response == "identity":
            ground = analysis.optimum.ground
            share = 0.0 if ground is None else ground.sd_ground**2 / (ground.sd_ground**2 + ground.sd_chance**2)
            return (
                analysis.fit.s,
                spread / max(len(spec.region.numeric), 1),
                share,
                f"the fit to {analysis.fit.n_runs} runs",
            )
    if spec.simulator is not None:
        noise, share, df, *_ = probe_noise(spec, progress)
        return noise, None, share, f"simulations at the centre, {df} degrees of freedom"
    return None, None, 0.0, "nothing yet: move it"
