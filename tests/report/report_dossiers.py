"""Dossiers of synthetic campaigns whose true surface is known."""

from __future__ import annotations

import dataclasses
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from seqrsm.analysis.belief import Departure, Fitted
from seqrsm.analysis.compromise import campaign_compromise
from seqrsm.analysis.results import (
    Analysis,
    Confirmation,
    FactorImportance,
    OptimumEstimate,
    PosteriorSummary,
    SettingPosterior,
)
from seqrsm.analysis.runs import ScoredRuns
from seqrsm.analysis.scale import Interval, ResponseScale
from seqrsm.analysis.surfaces import surface_of
from seqrsm.campaign.dossier import Dossier
from seqrsm.campaign.images import ImagePanel
from seqrsm.decide.stopping import Look, StopRule, decide
from seqrsm.design.factors import CategoricalFactor
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.fit.canonical import stationary_point
from seqrsm.fit.conjugate import NormalInverseGamma, posterior
from seqrsm.fit.intervals import LackOfFit
from seqrsm.fit.least_squares import block_columns, fit_least_squares
from seqrsm.fit.optimum import optimum, optimum_draws
from seqrsm.scene.scene import Scene
from seqrsm.spec.read import CampaignSpec, load_spec
from seqrsm.spec.tables import SimulatorSpec
from seqrsm.store.records import EventRecord, LookRecord, RunRecord, ScoreRecord

START = datetime(2024, 5, 1, 8, 0, tzinfo=UTC)

SIMULATED = """
[campaign]
name = "crop radar"
description = "Which imaging radar tells the crops of one site apart best?"
seed = 1979
[[factor]]
name = "frequency"
unit = "GHz"
low = 1.2
high = 17.0
scale = "log"
[[factor]]
name = "depression_angle"
unit = "deg"
low = 30.0
high = 70.0
[[factor]]
name = "looks"
values = [1, 2, 4, 8, 16]
scale = "log"
[[factor]]
name = "polarization"
levels = ["HH", "VV", "HV"]
[[constraint]]
expr = "looks <= 20 - frequency"
[[application]]
name = "crop-classification"
utility = "percent_correct"
[stop]
half_width = 4.0
max_runs = 60
"""

FLIGHT = """
[campaign]
name = "flight scores"
[[factor]]
name = "altitude_step"
values = [1, 2, 3]
[[factor]]
name = "polarization"
levels = ["HH", "VV"]
[[factor]]
name = "film"
levels = ["coarse", "medium grain", "fine"]
[[application]]
name = "drainage"
utility = "measured"
goal = "minimize"
[model]
order = 1
block = "day"
[stop]
half_width = 0.5
interval = "prediction_mean"
"""

MANY = """
[campaign]
name = "six factors"
[[application]]
name = "ranking"
utility = "measured"
[stop]
half_width = 0.5
interval = "confidence"
""" + "".join(f'[[factor]]\nname = "x{i}"\nlow = 0.0\nhigh = {10 ** (i - 3)!r}\n' for i in range(6))


def load(folder: Path, text: str) -> CampaignSpec:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "campaign.toml").write_text(text, encoding="utf-8")
    return load_spec(folder)


def runs_of(spec, points, scores, se, *, source="simulation", blocks=None, batch=4):
    """Scored run records, one an hour."""
    application = spec.applications[0].name
    records = []
    for i, settings in enumerate(spec.region.decode(points)):
        at = (START + timedelta(hours=i)).isoformat()
        score = ScoreRecord(i + 1, application, float(scores[i]), se, None, None, {}, "", None, at)
        purpose = "start" if i < 24 else ("optimum", "regret", "repeat", "spread")[i % 4]
        records.append(
            RunRecord(
                run_id=i + 1,
                batch=1 if i < 24 else 2 + (i - 24) // batch,
                purpose=purpose,
                why="because",
                source=source,
                state="scored",
                proposed=settings,
                executed=settings,
                block="" if blocks is None else blocks[i],
                cost=1.0,
                reason="",
                attempts=1,
                owner="",
                replaces=None,
                proposed_at=at,
                issued_at=at,
                started_at=at,
                ended_at=at,
                scores=(score,),
            )
        )
    return records


def make_analysis(spec, runs, *, unit="", draws=800, blocks=False) -> Analysis:
    """Analysis of the identity response from run records, with the package's own estimators."""
    application, region = spec.applications[0], spec.region
    model = QuadraticModel(region.factors, spec.model.order)
    points = region.code([run.settings for run in runs])
    y = np.array([run.scores[0].score for run in runs])
    Z, terms, ids = model.matrix(points), list(model.terms), None
    if blocks:
        ids = [run.block for run in runs]
        columns, names = block_columns(ids)
        Z, terms = np.hstack([Z, columns]), [*terms, *names]
    fit = fit_least_squares(Z, y, terms, setting_ids=[tuple(row) for row in points], block_ids=ids)
    beta = fit.estimate[: model.p]
    best = optimum(model, region, beta, application.goal)
    row = model.matrix(best.point[None, :])
    stop = spec.stop
    one, several = fit.predict(row, stop.level), fit.predict(row, stop.level, replicates=stop.replicates)

    def interval(found) -> Interval:
        return Interval(float(found.low[0]), float(found.high[0]))

    estimate = OptimumEstimate(
        settings=region.decode(best.point)[0],
        point=best.point,
        at_bound=best.at_bound,
        active_constraints=best.active_constraints,
        mean=float(one.mean[0]),
        confidence=interval(one.confidence),
        prediction=interval(one.prediction),
        prediction_mean=interval(several.prediction),
        replicates=stop.replicates,
        level=stop.level,
        whole=interval(several.prediction),
        by_chance=interval(several.prediction),
    )
    lack = fit.lack_of_fit()
    rule = StopRule(interval=stop.interval, half_width=stop.half_width, level=stop.level, max_runs=stop.max_runs)
    look = Look(
        n_runs=fit.n_runs,
        n_terms=fit.n_terms,
        s=fit.s,
        df_residual=fit.df_residual,
        df_pure_error=lack.df_pe if isinstance(lack, LackOfFit) else 0,
        h=float(fit.variance_unscaled(row)[0]),
        lack_of_fit=lack.p if isinstance(lack, LackOfFit) else lack,
    )
    decision = decide(rule, look, unit=unit)
    importance = []
    for factor in region.factors:
        test = fit.partial_f(model.factor_terms(factor.name))
        importance.append(FactorImportance(factor.name, test.df, test.f, test.p))
    levels = tuple(int(best.point[i]) for i in region.categorical)
    scale = ResponseScale.of("identity", y, fit.Z)
    data = ScoredRuns(
        run_ids=np.array([run.run_id for run in runs]),
        points=points,
        scores=y,
        score_se=np.array([np.nan if run.scores[0].se is None else run.scores[0].se for run in runs]),
        sources=tuple(run.source for run in runs),
        blocks=tuple(run.block for run in runs),
        batches=np.array([run.batch for run in runs]),
        purposes=tuple(run.purpose for run in runs),
    )
    return Analysis(
        application=application.name,
        goal=application.goal,
        score_unit=unit,
        fitted=Fitted(
            application=application,
            region=region,
            model=model,
            data=data,
            scale=scale,
            fit=fit,
            surface=surface_of(spec, data, scale, fit, None),
            departure=Departure(None, float("nan"), 0.0, "the scores were drawn about a quadratic"),
        ),
        importance=tuple(importance),
        stationary=stationary_point(model, region, beta, levels) if region.numeric else None,
        of_quadratic=best,
        optimum=estimate,
        posterior=make_posterior(spec, region, model, fit, estimate, application.goal, draws),
        decision=decision,
        confirmation=None,
        warnings=(f"No error estimate: {fit.reason}.",) if fit.reason else (),
    )


def make_posterior(spec, region, model, fit, estimate, goal, draws) -> PosteriorSummary:
    p = fit.n_terms
    # Little information on every coefficient, so that a saturated fit has a posterior too.
    scale = float(np.std(fit.y)) + 1e-6
    prior = NormalInverseGamma(
        np.zeros(p), np.diag(np.where(np.arange(p) == 0, 1e-6, 1e-3)), 0.5, 0.5 * (scale / 10) ** 2
    )
    beta, sigma = posterior(fit.Z, fit.y, fit.weights, prior).draws(draws, np.random.default_rng(7))
    beta = beta[:, : model.p]
    points, values = optimum_draws(model, region, beta, goal)
    here = beta @ model.matrix(estimate.point[None, :])[0]
    future = here + sigma * np.random.default_rng(8).standard_normal(draws)
    settings = []
    for j, factor in enumerate(region.factors):
        if isinstance(factor, CategoricalFactor):
            share = {level: float(np.mean(points[:, j] == i)) for i, level in enumerate(factor.levels)}
            settings.append(SettingPosterior(factor.name, np.nan, np.nan, np.nan, np.nan, share))
        else:
            low, high = factor.decode(np.quantile(points[:, j], [0.025, 0.975]))
            mean = float(factor.decode(np.mean(points[:, j])))
            at_bound = float(np.mean(np.abs(points[:, j]) > 1 - 1e-6))
            settings.append(SettingPosterior(factor.name, mean, float(low), float(high), at_bound, {}))
    regret = np.abs(values - here)
    return PosteriorSummary(
        sampler={"method": "exact", "draws": draws},
        term_draws=beta,
        optimum_points=points,
        optimum_values=values,
        settings=tuple(settings),
        mean=float(np.mean(values)),
        credible=Interval(*(float(v) for v in np.quantile(values, [0.025, 0.975]))),
        predictive=Interval(*(float(v) for v in np.quantile(future, [0.025, 0.975]))),
        expected_regret=float(np.mean(regret)),
        p_regret_above=float(np.mean(regret > 0.25 * spec.stop.half_width)),
        regret_epsilon=0.25 * spec.stop.half_width,
    )


def look_of(analysis: Analysis, number: int, at: str) -> LookRecord:
    best = analysis.optimum
    summary = {
        "n_runs": analysis.fit.n_runs,
        "half_width": analysis.decision.half_width,
        "held": analysis.decision.held,
        "optimum": {
            "settings": best.settings,
            "mean": best.mean,
            "confidence": {"low": best.confidence.low, "high": best.confidence.high},
            "prediction": {"half_width": best.prediction.half_width},
        },
    }
    return LookRecord(number, analysis.fit.n_runs, analysis.application, summary, at)


def truth_score(points: np.ndarray) -> np.ndarray:
    """Known surface in percent over (frequency, depression angle, looks, polarization), coded."""
    f, a, n, pol = points.T
    level = np.array([0.0, -3.0, 4.0])[pol.astype(int)]
    return 74.0 + 4.0 * f - 6.0 * f**2 + 2.0 * a - 5.0 * a**2 + 5.0 * n - 2.0 * n**2 + 1.5 * f * a + level + pol * f


def simulated_dossier(folder: Path, *, n=48, draws=800) -> Dossier:
    """With a simulator, a constraint, discrete and categorical factors, images, looks, a void and a failed run."""
    spec = load(folder, SIMULATED)
    simulator = SimulatorSpec(engine="psm", scene="scene.npz", fixed={"altitude_m": 3000.0, "aperture": "synthetic"})
    spec = dataclasses.replace(spec, simulator=simulator)
    rng = np.random.default_rng(1979)
    points = spec.region.candidates(5)
    points = points[rng.permutation(len(points))[: n - 8]]
    points = np.vstack([points[:24], np.repeat(points[:4], 2, axis=0), points[24:]])
    scores = truth_score(points) + rng.normal(0.0, 1.6, len(points))
    runs = runs_of(spec, points, scores, 0.9)
    analysis = make_analysis(spec, runs, unit="percent", draws=draws)
    looks = [
        look_of(make_analysis(spec, runs[:m], unit="percent", draws=50), i + 1, runs[m - 1].ended_at)
        for i, m in enumerate(range(26, n + 1, 4))
    ]
    fresh = [72.9, 78.1, 76.0, 75.1, 77.7]
    analysis = dataclasses.replace(
        analysis,
        confirmation=Confirmation((51, 52, 53, 54, 55), tuple(fresh), 75.96, Interval(73.4, 78.5), True, "They agree."),
    )
    spoilt = dataclasses.replace(runs[0], run_id=n + 1, state="void", reason="cloud over the site", scores=())
    failed = dataclasses.replace(runs[1], run_id=n + 2, state="failed", reason="noise above signal", scores=())
    cover = np.kron(rng.integers(0, 5, (12, 16)), np.ones((60, 60))).astype(np.uint8)
    cover[:20] = 255
    grey = np.clip(40 * (cover % 5) + 40 + rng.normal(0, 25, cover.shape), 0, 255).astype(np.uint8)
    images = tuple(
        ImagePanel(
            title=title,
            settings=analysis.optimum.settings,
            engine="psm",
            channels=("HV",),
            greytone=np.stack([np.roll(grey, shift, axis=1)]),
            pixel_m=12.5,
            score=score,
            score_se=0.9,
            caption="Speckle and field-to-field backscatter were drawn at random",
        )
        for title, score, shift in (("At the optimum", 79.21, 0), ("At the worst corner", 51.3, 100))
    )
    scene = Scene(
        elevation_m=np.zeros(cover.shape, dtype=np.float32),
        cover=cover,
        categories=("bare soil", "corn", "wheat", "forest", "water"),
        field_id=cover.astype(np.int32),
        scored=cover != 255,
        cell_m=12.5,
        name="Synthetic site",
        licence="CC0",
        provenance="Made by a seeded generator",
    )
    events = tuple(
        EventRecord(i + 1, run.proposed_at, "0.1.0", 1979, run.run_id, "scored", {"score": 1.5})
        for i, run in enumerate(runs)
    )
    return Dossier(
        spec=spec,
        analyses=(analysis,),
        runs=(*runs, spoilt, failed),
        looks=tuple(looks),
        events=events,
        images=images,
        scene=scene,
        quarter_turns=0,
        assumptions=("Backscatter of wheat is that of the table's row 12, measured elsewhere.",),
        provenance={"seqrsm": "0.1.0", "seed": "1979", "sigma0 table": "sha256 abcdef0123456789" * 3},
        reproduce=("seqrsm run campaigns/crop-radar --max-runs 60", "seqrsm report campaigns/crop-radar"),
    )


def flight_dossier(folder: Path, n=24) -> Dossier:
    """Measured scores only: discrete and categorical factors, blocks, smaller is better, no looks and no images."""
    spec = load(folder, FLIGHT)
    rng = np.random.default_rng(5)
    points = spec.region.candidates(3)
    points = points[np.arange(n) % len(points)]
    blocks = [f"day {1 + i // 8}" for i in range(n)]
    scores = 5.0 + points[:, 0] - 0.8 * points[:, 1] + 0.3 * points[:, 2] + rng.normal(0, 0.3, n)
    runs = runs_of(spec, points, scores, None, source="flight", blocks=blocks)
    analysis = make_analysis(spec, runs, blocks=True)
    return Dossier(spec, (analysis,), tuple(runs), (), (), (), None, 0, (), {"seqrsm": "0.1.0"}, ("seqrsm report .",))


def many_dossier(folder: Path, *, saturated=False) -> Dossier:
    """Six numeric factors; saturated when asked: as many runs as terms."""
    spec = load(folder, MANY)
    rng = np.random.default_rng(3)
    p = QuadraticModel(spec.factors, 2).p
    points = np.clip(np.round(rng.uniform(-1.3, 1.3, (p if saturated else p + 14, 6)), 3), -1, 1)
    scores = points[:, 0] - points[:, 3] ** 2 + 0.2 * rng.standard_normal(len(points))
    runs = runs_of(spec, points, scores, None)
    analysis = make_analysis(spec, runs, draws=300)
    return Dossier(spec, (analysis,), tuple(runs), (), (), (), None, 0, (), {"seqrsm": "0.1.0"}, ("seqrsm report .",))


def two_uses(flight, **changes):
    """The dossier of flights with its application twice, under another name."""
    first, (use,) = flight.analyses[0], flight.spec.applications
    spec = dataclasses.replace(flight.spec, applications=(use, use.model_copy(update={"name": "other use"})))
    analyses = (first, dataclasses.replace(first, application="other use"))
    changes.setdefault("compromise", campaign_compromise(spec, analyses))
    return dataclasses.replace(flight, spec=spec, analyses=analyses, **changes)
