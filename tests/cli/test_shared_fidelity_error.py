"""Scores of a cheaper rung share an error: it widens what a campaign tells of its optimum."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import t
from tiny_campaign import make_tiny

from seqrsm.analysis.belief import intervals
from seqrsm.analysis.conclude import analyse
from seqrsm.analysis.fitted import fit_application
from seqrsm.analysis.posterior import draw_coefficients
from seqrsm.analysis.results import Analysis
from seqrsm.campaign.campaign import Campaign
from seqrsm.report.figures.surfaces import predict
from seqrsm.store.records import RunRecord

BOUND = 4.0


def made_by(runs: Sequence[RunRecord], bound: float) -> list[RunRecord]:
    """The same runs, as if a rung that leaves so much out had made them all."""
    out = []
    for run in runs:
        kept = {"rung": "F0", "bias_bound": bound, "bound": bound}
        scores = tuple(replace(s, metadata={**s.metadata, "fidelity": kept, "sampling_se": 0.0}) for s in run.scores)
        out.append(replace(run, scores=scores))
    return out


def of_quadratic(analysis: Analysis) -> SimpleNamespace:
    """Intervals at the quadratic's own optimum."""
    level, replicates = analysis.optimum.level, analysis.optimum.replicates
    belief, point = analysis.belief.of_quadratic, analysis.of_quadratic.point
    mean, (confidence, prediction, _) = intervals(belief, analysis.scale, point, level, (1, replicates))
    return SimpleNamespace(mean=mean, confidence=confidence, prediction=prediction)


def test_a_shared_bound_widens_intervals_and_posterior(tmp_path: Path, tiny_scene: Path) -> None:
    campaign = Campaign.open(make_tiny(tmp_path / "shared", tiny_scene))
    while len(campaign.store.runs()) < 15:
        campaign.propose()
        campaign.simulate()
    spec, runs = campaign.spec, campaign.store.runs()
    one = spec.applications[0]
    plain, shared = (analyse(spec, one, made_by(runs, bound), ()) for bound in (0.0, BOUND))
    narrow, wide = of_quadratic(plain), of_quadratic(shared)
    # Where a process is probable, too, its intervals count the error as well.
    assert shared.optimum.confidence.half_width > np.hypot(0.8 * plain.optimum.confidence.half_width, BOUND)
    assert narrow.mean == pytest.approx(wide.mean)
    # All runs by one rung: nothing is learnt of what they share, half the bound is its standard deviation.
    fitted = fit_application(spec, one, made_by(runs, 0.0))
    quantile = t.ppf(0.5 + 0.5 * shared.optimum.level, fitted.surface.df_residual)
    wanted = np.hypot(narrow.confidence.half_width, quantile * 0.5 * BOUND)
    assert wide.confidence.half_width == pytest.approx(wanted, rel=1e-6)
    assert wide.prediction.half_width == pytest.approx(
        np.hypot(narrow.prediction.half_width, quantile * 0.5 * BOUND), rel=1e-6
    )
    assert shared.decision.half_width == pytest.approx(getattr(shared.optimum, spec.stop.interval).half_width)
    assert shared.decision.noise_floor == pytest.approx(plain.decision.noise_floor, rel=0.03)
    band = predict(shared, shared.optimum.point[None, :]).confidence  # of the report's figures
    assert float(band.half_width[0]) == pytest.approx(shared.optimum.confidence.half_width)
    searched = analyse(spec, one, made_by(runs, BOUND), (), thorough=True).study.searched
    assert searched.confidence.half_width >= wide.confidence.half_width
    assert any("may be off together, by 4 at most" in text for text in shared.warnings)
    assert not any("off together" in text for text in plain.warnings)
    # What counts it is said, too; flights and random blocks have their own rule.
    said = next(text for text in shared.warnings if "off together" in text)
    assert said.endswith("the posterior and the intervals at the optimum count that.")
    by_rung = made_by(runs, BOUND)
    flown = [
        replace(run, source="flight", scores=runs[i].scores) if i % 4 == 0 else run for i, run in enumerate(by_rung)
    ]
    flown = [
        replace(run, scores=(replace(run.scores[0], metadata={}),)) if run.source == "flight" else run for run in flown
    ]
    dealt = [replace(run, block=f"occasion {1 + i % 3}") for i, run in enumerate(by_rung)]
    for own, words in (
        (flown, "whose prior is [model] discrepancy_sd"),
        (dealt, "the intervals at the optimum count that, the posterior does not"),
    ):
        assert any("off together" in text and words in text for text in analyse(spec, one, own, ()).warnings)
    draws = [
        draw_coefficients(spec, fit_application(spec, one, made_by(runs, bound)), sampler="exact", n_draws=20_000)
        for bound in (0.0, BOUND)
    ]
    rows = fitted.model.matrix(np.zeros((1, spec.region.k)))
    spread = [float((found.terms @ rows[0]).std()) for found in draws]
    # The prior of what is shared is N(0, 1) at the fitted sigma, and scales with the sigma that is drawn.
    assert np.hypot(spread[0], 0.5 * BOUND) * 0.97 < spread[1] < np.hypot(spread[0], 0.5 * BOUND) * 1.35
