"""Drivers of :mod:`peers_study`: one campaign on a drawn surface by ``seqrsm`` itself, or by a package.

Packages begin with the same 12 Sobol points, make batches of 4 with their defaults, and answer with the settings of the
best posterior mean by their own model. ``seqrsm`` runs as its command line would run it, without a store.
"""

from __future__ import annotations

import json
import logging
import os
import sys
import tempfile
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
import numpy as np
from scipy.stats import qmc

sys.path.insert(0, str(Path(__file__).parent))
from kinds import TRIALS, Array, Drawn, Kind, highest, spread

START, BATCH = 12, 4
STOP_INTERVAL = "prediction_mean"
"""Interval of the stop rule: one new run alone scatters by more than the half-width that is asked for."""
NONE = (float("nan"), float("nan"))
Interval = tuple[float, float]


@dataclass
class Answer:
    """What a campaign ends with.

    Attributes
    ----------
    point : ndarray
        Recommended settings, coded.
    mean : float
        Mean score told of them; nan where none is told.
    confidence, prediction, prediction_mean : (low, high)
        95 % intervals of the mean there, of one new run, and of the mean of ``replicates`` new runs.
    runs : int
        Made.
    stopped : bool
        The stop rule held.
    places : dict
        Interval told of the best setting, by number of the numeric factor.
    loss, chance, limit : float
        Told: mean loss of the recommendation, and chance that it loses more than ``limit``.
    """

    point: Array
    mean: float
    confidence: Interval
    runs: int
    prediction: Interval = NONE
    prediction_mean: Interval = NONE
    replicates: int = 5
    stopped: bool = False
    places: dict[int, Interval] = field(default_factory=dict)
    loss: float = float("nan")
    chance: float = float("nan")
    limit: float = float("nan")


Driver = Callable[..., Answer]

# -- seqrsm -----------------------------------------------------------------------------------------------------------


def campaign_toml(kind: Kind, seed: int, max_runs: int) -> str:
    """``campaign.toml`` of a campaign whose scores are measured."""
    told = {"student_t": 'errors = "student_t"\n', "counts": 'weights = "counts"\n'}.get(kind.errors, "")
    told += 'block = "day"\nblock_effect = "random"\n' if kind.of_day else ""
    factors = "".join(f'[[factor]]\nname = "x{j}"\nlow = -1.0\nhigh = 1.0\n' for j in range(kind.factors))
    if kind.levels:
        levels = json.dumps([f"level {level}" for level in range(kind.levels)])
        factors += f'[[factor]]\nname = "category"\nlevels = {levels}\n'
    utility = "percent_correct" if kind.errors == "counts" else "measured"
    return (
        f'[campaign]\nname = "peers"\nseed = {seed}\nbatch = {BATCH}\n{factors}'
        f'[[application]]\nname = "score"\nutility = "{utility}"\n[model]\n{told}'
        f'[stop]\nhalf_width = 2.5\ninterval = "{STOP_INTERVAL}"\nmax_runs = {max_runs}\n'
    )


def seqrsm(drawn: Drawn, seed: int, max_runs: int, *, stops: bool = False) -> Answer:
    """As `seqrsm run` goes on; with ``stops`` until the stop rule holds."""
    from seqrsm.campaign.rehearsal import make_campaign
    from seqrsm.spec.read import load_spec
    from seqrsm.store.records import NewScore

    rng = np.random.default_rng([seed, 7])
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "campaign.toml").write_text(campaign_toml(drawn.kind, seed, max_runs), "utf-8")
        spec = load_spec(Path(folder))
    if not stops:  # an interval that no budget reaches
        spec = replace(spec, stop=spec.stop.model_copy(update={"half_width": 1e-9}))

    def score(points: Array) -> list[NewScore]:
        scores = [float(one) for one in drawn.score(points, rng)]
        if drawn.kind.errors != "counts":
            return [NewScore("score", one) for one in scores]
        return [NewScore("score", one, n=TRIALS, correct=round(one * TRIALS / 100.0)) for one in scores]

    analysis, runs = make_campaign(spec, "flight", score, n_draws=1000)
    return _told_by(analysis, spec, len(runs))


def many(drawn: Drawn, seed: int, n_runs: int) -> Answer:
    """What ``seqrsm`` tells of scores of random settings that were there before."""
    from seqrsm.campaign.campaign import Campaign

    kind, rng = drawn.kind, np.random.default_rng([seed, 13])
    points = spread(kind, n_runs, rng)
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "campaign.toml").write_text(campaign_toml(kind, seed, n_runs), "utf-8")
        scores = Path(folder) / "scores.csv"
        rows = [f"{','.join(_names(kind))},score"]
        for settings, score in zip(_settings(kind, points), drawn.score(points, rng), strict=True):
            rows.append(",".join(str(one) for one in (*settings.values(), score)))
        scores.write_text("\n".join(rows) + "\n", "utf-8")
        campaign = Campaign.open(Path(folder))
        campaign.ingest(scores, accept=True)
        (analysis,) = campaign.analyse_all(n_draws=1000)
        campaign.store.close()
        return _told_by(analysis, campaign.spec, n_runs)


def _told_by(analysis: Any, spec: Any, runs: int) -> Answer:
    """An analysis as an answer."""
    best, posterior = analysis.optimum, analysis.posterior
    names = list(spec.region.names)
    return Answer(
        point=spec.region.code([best.settings])[0],
        mean=best.mean,
        confidence=(best.confidence.low, best.confidence.high),
        prediction=(best.prediction.low, best.prediction.high),
        prediction_mean=(best.prediction_mean.low, best.prediction_mean.high),
        replicates=best.replicates,
        runs=runs,
        stopped=analysis.decision.held,
        places={names.index(one.factor): (one.low, one.high) for one in posterior.settings if not one.probabilities},
        loss=posterior.expected_regret,
        chance=posterior.p_regret_above,
        limit=posterior.regret_epsilon,
    )


# -- packages ---------------------------------------------------------------------------------------------------------


def start(kind: Kind, seed: int) -> Array:
    """Sobol points (12, columns), levels of the category in turn."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        X = 2.0 * qmc.Sobol(kind.factors, seed=seed).random(START) - 1.0
    return np.column_stack([X, np.arange(START) % kind.levels]) if kind.levels else X


def _names(kind: Kind) -> list[str]:
    return [f"x{j}" for j in range(kind.factors)] + ["category"] * bool(kind.levels)


def _settings(kind: Kind, X: Array) -> list[dict[str, float | str]]:
    """Numbers of the factors, and the level as a word."""
    return [
        {name: float(x) if name != "category" else f"level {int(x)}" for name, x in zip(_names(kind), row, strict=True)}
        for row in X
    ]


def _coded(kind: Kind, settings: list[dict[str, object]]) -> Array:
    return np.array([[float(str(one[name]).removeprefix("level ")) for name in _names(kind)] for one in settings])


def _told(mean: float, sd: float) -> Interval:
    """What a Gaussian process says of the mean score."""
    return mean - 1.96 * sd, mean + 1.96 * sd


def _process(kind: Kind, X: Array, y: Array) -> tuple[object, object]:
    """BoTorch's Gaussian process of scores, and its inputs."""
    import torch
    from botorch.fit import fit_gpytorch_mll
    from botorch.models import SingleTaskGP
    from botorch.models.transforms import Standardize
    from gpytorch.mlls import ExactMarginalLogLikelihood

    inputs = _unit(kind, X)
    model = SingleTaskGP(inputs, torch.tensor(y)[:, None], outcome_transform=Standardize(1))
    fit_gpytorch_mll(ExactMarginalLogLikelihood(model.likelihood, model))
    return model, inputs


def _unit(kind: Kind, X: Array) -> object:
    """Factors on [0, 1], and a column of zeros and ones for every level."""
    import torch

    k = kind.factors
    return torch.tensor(np.column_stack([0.5 * (X[:, :k] + 1.0), X[:, k:] == np.arange(kind.levels)]))


def _best_of_process(kind: Kind, X: Array, y: Array, model: object) -> Answer:
    import torch

    def mean(points: Array) -> Array:
        with torch.no_grad():
            return model.posterior(_unit(kind, points)).mean[:, 0].numpy()

    point = highest(mean, kind, np.vstack([X, spread(kind, 1000, np.random.default_rng(0))]))
    with torch.no_grad():
        found = model.posterior(_unit(kind, point[None, :]))
        told, sd = float(found.mean), float(found.variance.sqrt())
    return Answer(point, told, _told(told, sd), len(y))


def botorch(drawn: Drawn, seed: int, max_runs: int) -> Answer:
    """Gaussian process of standardised scores, noisy expected improvement of whole batches."""
    import torch
    from botorch.acquisition.logei import qLogNoisyExpectedImprovement
    from botorch.optim import optimize_acqf, optimize_acqf_mixed
    from botorch.sampling import SobolQMCNormalSampler

    torch.set_num_threads(1)
    torch.manual_seed(seed)
    kind, rng = drawn.kind, np.random.default_rng([seed, 7])
    k, X = kind.factors, start(kind, seed)
    y = drawn.score(X, rng)
    ends = torch.tensor([[0.0] * (k + kind.levels), [1.0] * (k + kind.levels)], dtype=torch.double)
    effort = {"num_restarts": 4, "raw_samples": 128, "options": {"maxiter": 60}}
    levels = [{k + i: float(i == level) for i in range(kind.levels)} for level in range(kind.levels)]
    while True:
        model, inputs = _process(kind, X, y)
        if len(y) >= max_runs:
            return _best_of_process(kind, X, y, model)
        sampler = SobolQMCNormalSampler(torch.Size([128]), seed=seed)
        gain, q = qLogNoisyExpectedImprovement(model, inputs, sampler=sampler), min(BATCH, max_runs - len(y))
        if kind.levels:
            new, _ = optimize_acqf_mixed(gain, ends, q, fixed_features_list=levels, **effort)
        else:
            new, _ = optimize_acqf(gain, ends, q, **effort)
        points = 2.0 * new.numpy()[:, :k] - 1.0
        if kind.levels:
            points = np.column_stack([points, np.argmax(new.numpy()[:, k:], axis=1)])
        X, y = np.vstack([X, points]), np.append(y, drawn.score(points, rng))


def optuna_gp(drawn: Drawn, seed: int, max_runs: int) -> Answer:
    """Optuna's Gaussian process; its points, and the best posterior mean of BoTorch's process of them."""
    import optuna
    import torch

    torch.set_num_threads(1)
    torch.manual_seed(seed)
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    kind, rng = drawn.kind, np.random.default_rng([seed, 7])
    study = optuna.create_study(direction="maximize", sampler=optuna.samplers.GPSampler(seed=seed))
    space: dict[str, optuna.distributions.BaseDistribution] = {
        f"x{j}": optuna.distributions.FloatDistribution(-1.0, 1.0) for j in range(kind.factors)
    }
    if kind.levels:
        space["category"] = optuna.distributions.CategoricalDistribution([f"level {i}" for i in range(kind.levels)])
    X = start(kind, seed)
    y = drawn.score(X, rng)
    for params, value in zip(_settings(kind, X), y, strict=True):
        study.add_trial(optuna.trial.create_trial(params=params, distributions=space, value=float(value)))
    while len(y) < max_runs:
        trials = [study.ask(space) for _ in range(min(BATCH, max_runs - len(y)))]
        points = _coded(kind, [trial.params for trial in trials])
        scores = drawn.score(points, rng)
        for trial, value in zip(trials, scores, strict=True):
            study.tell(trial, float(value))
        X, y = np.vstack([X, points]), np.append(y, scores)
    return _best_of_process(kind, X, y, _process(kind, X, y)[0])


def ax(drawn: Drawn, seed: int, max_runs: int) -> Answer:
    """Ax's client and the parameters that it calls best."""
    import torch
    from ax.api.client import Client
    from ax.api.configs import ChoiceParameterConfig, RangeParameterConfig

    torch.set_num_threads(1)
    logging.disable(logging.WARNING)
    kind, rng = drawn.kind, np.random.default_rng([seed, 7])
    client = Client(random_seed=seed)
    factors: list[RangeParameterConfig | ChoiceParameterConfig] = [
        RangeParameterConfig(name=f"x{j}", parameter_type="float", bounds=(-1.0, 1.0)) for j in range(kind.factors)
    ]
    if kind.levels:
        levels = [f"level {i}" for i in range(kind.levels)]
        factors.append(ChoiceParameterConfig(name="category", parameter_type="str", values=levels, is_ordered=False))
    client.configure_experiment(factors)
    client.configure_optimization("score")
    X = start(kind, seed)
    for params, value in zip(_settings(kind, X), drawn.score(X, rng), strict=True):
        client.complete_trial(client.attach_trial(params), raw_data={"score": float(value)})
    made = START
    while made < max_runs:
        trials = client.get_next_trials(min(BATCH, max_runs - made))
        scores = drawn.score(_coded(kind, list(trials.values())), rng)
        for index, value in zip(trials, scores, strict=True):
            client.complete_trial(index, raw_data={"score": float(value)})
        made += len(trials)
    best, predicted, *_ = client.get_best_parameterization()
    mean, error = predicted["score"]
    return Answer(_coded(kind, [best])[0], mean, NONE if error is None else _told(mean, error), made)


def baybe(drawn: Drawn, seed: int, max_runs: int) -> Answer:
    """BayBE's campaign and the best mean of its surrogate."""
    import pandas as pd
    import torch
    from baybe import Campaign
    from baybe.parameters import CategoricalParameter, NumericalContinuousParameter
    from baybe.searchspace import SearchSpace
    from baybe.targets import NumericalTarget
    from baybe.utils.random import set_random_seed

    torch.set_num_threads(1)
    set_random_seed(seed)
    kind, rng = drawn.kind, np.random.default_rng([seed, 7])
    factors: list[NumericalContinuousParameter | CategoricalParameter] = [
        NumericalContinuousParameter(f"x{j}", (-1.0, 1.0)) for j in range(kind.factors)
    ]
    if kind.levels:
        factors.append(CategoricalParameter("category", [f"level {i}" for i in range(kind.levels)]))
    campaign = Campaign(SearchSpace.from_product(factors), NumericalTarget("score").to_objective())
    X = start(kind, seed)
    frame = pd.DataFrame(_settings(kind, X)).assign(score=drawn.score(X, rng))
    campaign.add_measurements(frame)
    while len(X) < max_runs:
        frame = campaign.recommend(min(BATCH, max_runs - len(X)))[_names(kind)]
        points = _coded(kind, frame.to_dict("records"))
        campaign.add_measurements(frame.assign(score=drawn.score(points, rng)))
        X = np.vstack([X, points])

    def stats(points: Array, which: str) -> Array:
        found = campaign.posterior_stats(pd.DataFrame(_settings(kind, points)), stats=[which])
        return found[f"score_{which}"].to_numpy(dtype=float)

    cover = np.vstack([X, spread(kind, 500, np.random.default_rng(0))])
    point = highest(lambda points: stats(points, "mean"), kind, cover)
    mean, sd = (float(stats(point[None, :], which)[0]) for which in ("mean", "std"))
    return Answer(point, mean, _told(mean, sd), len(X))


DRIVERS: dict[str, tuple[str, Driver]] = {
    "seqrsm": ("seqrsm", seqrsm),
    "botorch": ("botorch", botorch),
    "ax": ("ax-platform", ax),
    "baybe": ("baybe", baybe),
    "optuna_gp": ("optuna", optuna_gp),
}
"""The distribution of each driver, and what runs a campaign."""
