"""The same surfaces and budgets for seqrsm and for Bayesian-optimisation packages; optional, never part of the tests.

    OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 python tests/benchmarks/bench_peers.py [--repeats 40] [--runs 40]

Packages that are not installed are left out with a word. Each starts with the same 12 Sobol runs and then makes batches
of 4 with its defaults; its answer is what it recommends by its own model where it has one. Printed: median true regret,
runs until the answer stays within one point of the optimum, half-width of the interval at the answer (seqrsm only: the
others give none), seconds.
"""

from __future__ import annotations

import argparse
import importlib.util
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.stats import qmc

sys.path.insert(0, str(Path(__file__).parent))
import sequential_surfaces as surfaces

START, BATCH = 12, 4
CASES = {
    "quadratic, k = 3": (surfaces.quadratic, 3),
    "quadratic, k = 5": (surfaces.quadratic, 5),
    "border, k = 4": (surfaces.border, 4),
    "saturating, k = 4": (surfaces.saturating, 4),
    "two humps, k = 2": (surfaces.two_humped, 2),
}
Answers = list[tuple[int, np.ndarray, float]]
"""Runs made, recommended point, half-width of its interval (nan where there is none)."""
Score = Callable[[np.ndarray], np.ndarray]


def seqrsm(score: Score, k: int, n: int, seed: int) -> Answers:
    model, region, start = surfaces.stage(k)
    rng = np.random.default_rng(seed)
    X, y = start, score(start)
    plan, state = surfaces.begin(k, n, True)
    answers, batch = [], 1
    while True:
        state = surfaces.step(plan, state, X, y, batch)
        found = surfaces.fit_box(state, model, region, X, y)
        answers.append((len(y), found.point, float(np.diff(found.ends("confidence"))[0]) / 2.0))
        if len(y) >= n:
            return answers
        new = surfaces.next_points(state, found, k, X, min(BATCH, n - len(y)), rng, seed * 131 + len(y))
        X, y, batch = np.vstack([X, new]), np.append(y, score(new)), batch + 1


def _start(k: int, seed: int) -> np.ndarray:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return 2.0 * qmc.Sobol(k, seed=seed).random(START) - 1.0


def optuna_gp(score: Score, k: int, n: int, seed: int) -> Answers:
    import optuna

    optuna.logging.set_verbosity(optuna.logging.ERROR)
    study = optuna.create_study(direction="maximize", sampler=optuna.samplers.GPSampler(seed=seed))
    space = {f"x{j}": optuna.distributions.FloatDistribution(-1.0, 1.0) for j in range(k)}
    start, answers = _start(k, seed), []
    for point, value in zip(start, score(start), strict=True):
        params = {f"x{j}": float(point[j]) for j in range(k)}
        study.add_trial(optuna.trial.create_trial(params=params, distributions=space, value=float(value)))
    for made in range(START, n + 1):
        best = np.array([study.best_params[f"x{j}"] for j in range(k)])
        answers.append((made, best, float("nan")))
        if made < n:
            trial = study.ask(space)
            point = np.array([[trial.params[f"x{j}"] for j in range(k)]])
            study.tell(trial, float(score(point)[0]))
    return answers


def botorch(score: Score, k: int, n: int, seed: int) -> Answers:
    import torch
    from botorch.acquisition.logei import qLogNoisyExpectedImprovement
    from botorch.fit import fit_gpytorch_mll
    from botorch.models import SingleTaskGP
    from botorch.models.transforms import Standardize
    from botorch.optim import optimize_acqf
    from gpytorch.mlls import ExactMarginalLogLikelihood

    torch.manual_seed(seed)
    X = _start(k, seed)
    y, answers = score(X), []
    bounds = torch.tensor([[-1.0] * k, [1.0] * k], dtype=torch.double)
    while True:
        inputs, targets = torch.tensor(X), torch.tensor(y)[:, None]
        model = SingleTaskGP(inputs, targets, outcome_transform=Standardize(1))
        fit_gpytorch_mll(ExactMarginalLogLikelihood(model.likelihood, model))
        with torch.no_grad():
            means = model.posterior(inputs).mean[:, 0].numpy()
        answers.append((len(y), X[int(np.argmax(means))], float("nan")))
        if len(y) >= n:
            return answers
        acquisition = qLogNoisyExpectedImprovement(model, inputs)
        new, _ = optimize_acqf(acquisition, bounds, q=min(BATCH, n - len(y)), num_restarts=8, raw_samples=128)
        X, y = np.vstack([X, new.numpy()]), np.append(y, score(new.numpy()))


def ax(score: Score, k: int, n: int, seed: int) -> Answers:
    from ax.api.client import Client
    from ax.api.configs import RangeParameterConfig

    client = Client(random_seed=seed)
    client.configure_experiment(
        [RangeParameterConfig(name=f"x{j}", parameter_type="float", bounds=(-1.0, 1.0)) for j in range(k)]
    )
    client.configure_optimization("score")
    start, answers = _start(k, seed), []
    for point, value in zip(start, score(start), strict=True):
        index = client.attach_trial({f"x{j}": float(point[j]) for j in range(k)})
        client.complete_trial(index, raw_data={"score": float(value)})
    made = START
    while True:
        best = client.get_best_parameterization()[0]
        answers.append((made, np.array([float(best[f"x{j}"]) for j in range(k)]), float("nan")))
        if made >= n:
            return answers
        for index, params in client.get_next_trials(min(BATCH, n - made)).items():
            value = score(np.array([[params[f"x{j}"] for j in range(k)]]))[0]
            client.complete_trial(index, raw_data={"score": float(value)})
            made += 1


def baybe(score: Score, k: int, n: int, seed: int) -> Answers:
    import pandas as pd
    from baybe import Campaign
    from baybe.parameters import NumericalContinuousParameter
    from baybe.searchspace import SearchSpace
    from baybe.targets import NumericalTarget
    from baybe.utils.random import set_random_seed

    set_random_seed(seed)
    names = [f"x{j}" for j in range(k)]
    space = SearchSpace.from_product([NumericalContinuousParameter(name, (-1.0, 1.0)) for name in names])
    campaign = Campaign(space, NumericalTarget("score").to_objective())
    X, answers = _start(k, seed), []
    frame = pd.DataFrame(X, columns=names).assign(score=score(X))
    while True:
        campaign.add_measurements(frame)
        known = campaign.measurements[names]
        means = campaign.posterior_stats(known)["score_mean"].to_numpy()
        answers.append((len(known), known.to_numpy(dtype=float)[int(np.argmax(means))], float("nan")))
        if len(known) >= n:
            return answers
        frame = campaign.recommend(min(BATCH, n - len(known)))[names]
        frame = frame.assign(score=score(frame.to_numpy(dtype=float)))


def bofire(score: Score, k: int, n: int, seed: int) -> Answers:
    import bofire.strategies.api as strategies
    import pandas as pd
    from bofire.data_models.domain.api import Domain
    from bofire.data_models.features.api import ContinuousInput, ContinuousOutput
    from bofire.data_models.objectives.api import MaximizeObjective
    from bofire.data_models.strategies.api import SoboStrategy

    names = [f"x{j}" for j in range(k)]
    outputs = [ContinuousOutput(key="score", objective=MaximizeObjective(w=1.0))]
    domain = Domain(inputs=[ContinuousInput(key=name, bounds=(-1.0, 1.0)) for name in names], outputs=outputs)
    strategy = strategies.map(SoboStrategy(domain=domain, seed=seed))
    X, answers = _start(k, seed), []
    y = score(X)
    cover = pd.DataFrame(2.0 * qmc.Sobol(k, seed=seed).random(4096) - 1.0, columns=names)
    new = pd.DataFrame(X, columns=names).assign(score=y, valid_score=1)
    made = len(y)
    while True:
        strategy.tell(new)
        best = int(strategy.predict(cover)["score_pred"].to_numpy().argmax())
        answers.append((made, cover.to_numpy()[best], float("nan")))
        if made >= n:
            return answers
        asked = strategy.ask(min(BATCH, n - made))[names]
        made += len(asked)
        new = asked.assign(score=score(asked.to_numpy(dtype=float)), valid_score=1)


PEERS: dict[str, tuple[str, Callable[[Score, int, int, int], Answers]]] = {
    "seqrsm": ("seqrsm", seqrsm),
    "Optuna GP": ("optuna", optuna_gp),
    "BoTorch": ("botorch", botorch),
    "Ax": ("ax", ax),
    "BayBE": ("baybe", baybe),
    "BoFire": ("bofire", bofire),
}


def runs_to(answers: Answers, regrets: list[float], limit: float) -> float:
    """Runs from which on the regret stays below ``limit``; inf where it does not."""
    last_bad = max((i for i, regret in enumerate(regrets) if regret > limit), default=-1)
    return answers[last_bad + 1][0] if last_bad + 1 < len(answers) else float("inf")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=40)
    parser.add_argument("--runs", type=int, default=40)
    parser.add_argument("--sigma", type=float, default=2.0)
    parser.add_argument("--peers", nargs="+", default=list(PEERS), choices=list(PEERS))
    given = parser.parse_args()
    print("| surface | package | regret | runs to within 1 | half-width | seconds |\n|---|---|---|---|---|---|")
    for name, (make, k) in CASES.items():
        for peer in given.peers:
            module, optimise = PEERS[peer]
            if importlib.util.find_spec(module) is None:
                print(f"| {name} | {peer} | not installed | | | |")
                continue
            regrets, needed, widths, seconds = [], [], [], []
            for seed in range(given.repeats):
                surface = make(np.random.default_rng(seed), k)
                rng = np.random.default_rng(seed + 1000)

                def score(points: np.ndarray, surface=surface, rng=rng) -> np.ndarray:
                    return surface(points) + given.sigma * rng.standard_normal(len(points))

                began = time.perf_counter()
                answers = optimise(score, k, given.runs, seed)
                seconds.append(time.perf_counter() - began)
                best = surfaces.true_optimum(surface, k)
                path = [best - float(surface(point[None, :])[0]) for _, point, _ in answers]
                regrets.append(path[-1])
                needed.append(runs_to(answers, path, 1.0))
                widths.append(answers[-1][2])
            print(
                f"| {name} | {peer} | {np.median(regrets):.2f} | {np.median(needed):.0f} | {np.median(widths):.2f} | "
                f"{np.median(seconds):.1f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
