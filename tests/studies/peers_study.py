"""The same surfaces and budgets for seqrsm and for Bayesian-optimisation packages: ``reports/peers``.

    OMP_NUM_THREADS=1 python tests/studies/peers_study.py [--repeats 20] [--runs 40] [--peers NAME...] [--out DIR]

Packages that are not installed are left out with a word; ``--repeats 0`` only writes the page. Each starts with the
same 12 Sobol runs (seqrsm with its own start design of p + 6) and then makes batches of 4 with its defaults; its answer
is what it recommends by its own model.
A campaign that is done is kept in ``DIR/campaigns.csv``: the same command goes on where it was.
"""

from __future__ import annotations

import argparse
import csv
import importlib.metadata
import importlib.util
import logging
import os
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
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
Interval = tuple[float, float]
Answers = list[tuple[int, np.ndarray, Interval]]
"""Runs made, recommended point, 95 % interval of the mean score there (nan where the package gives none)."""
NONE = (float("nan"), float("nan"))
Score = Callable[[np.ndarray], np.ndarray]


def seqrsm(score: Score, k: int, n: int, seed: int) -> Answers:
    model, region, start = surfaces.stage(k)
    rng = np.random.default_rng(seed)
    X, y = start, score(start)
    answers = []
    while True:
        found = surfaces.fit_scores(model, region, X, y)
        low, high = found.ends("confidence")
        answers.append((len(y), found.point, (float(low), float(high))))
        if len(y) >= n:
            return answers
        new = surfaces.next_points(found, k, X, min(BATCH, n - len(y)), rng, seed * 131 + len(y))
        X, y = np.vstack([X, new]), np.append(y, score(new))


def _start(k: int, seed: int) -> np.ndarray:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return 2.0 * qmc.Sobol(k, seed=seed).random(START) - 1.0


def _within(mean: float, sd: float) -> Interval:
    """What a package whose model is a Gaussian process says of the mean score."""
    return mean - 1.96 * sd, mean + 1.96 * sd


def optuna_gp(score: Score, k: int, n: int, seed: int) -> Answers:
    import optuna

    return _optuna(score, k, n, seed, optuna.samplers.GPSampler(seed=seed))


def optuna_tpe(score: Score, k: int, n: int, seed: int) -> Answers:
    import optuna

    return _optuna(score, k, n, seed, optuna.samplers.TPESampler(seed=seed))


def _optuna(score: Score, k: int, n: int, seed: int, sampler: object) -> Answers:
    import optuna

    optuna.logging.set_verbosity(optuna.logging.ERROR)
    study = optuna.create_study(direction="maximize", sampler=sampler)
    space = {f"x{j}": optuna.distributions.FloatDistribution(-1.0, 1.0) for j in range(k)}
    start, answers = _start(k, seed), []
    for point, value in zip(start, score(start), strict=True):
        params = {f"x{j}": float(point[j]) for j in range(k)}
        study.add_trial(optuna.trial.create_trial(params=params, distributions=space, value=float(value)))
    for made in range(START, n + 1):
        best = np.array([study.best_params[f"x{j}"] for j in range(k)])
        answers.append((made, best, NONE))
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
            known = model.posterior(inputs)
            means, sd = known.mean[:, 0].numpy(), known.variance[:, 0].sqrt().numpy()
        best = int(np.argmax(means))
        answers.append((len(y), X[best], _within(float(means[best]), float(sd[best]))))
        if len(y) >= n:
            return answers
        acquisition = qLogNoisyExpectedImprovement(model, inputs)
        new, _ = optimize_acqf(acquisition, bounds, q=min(BATCH, n - len(y)), num_restarts=8, raw_samples=128)
        X, y = np.vstack([X, new.numpy()]), np.append(y, score(new.numpy()))


def ax(score: Score, k: int, n: int, seed: int) -> Answers:
    from ax.api.client import Client
    from ax.api.configs import RangeParameterConfig

    logging.disable(logging.INFO)
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
        best, predicted, *_ = client.get_best_parameterization()
        point = np.array([float(best[f"x{j}"]) for j in range(k)])
        mean, error = predicted["score"]
        answers.append((made, point, NONE if error is None else _within(float(mean), float(error))))
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
        stats = campaign.posterior_stats(known)
        means, sd = stats["score_mean"].to_numpy(dtype=float), stats["score_std"].to_numpy(dtype=float)
        best = int(np.argmax(means))
        answers.append((len(known), known.to_numpy(dtype=float)[best], _within(means[best], sd[best])))
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
        found = strategy.predict(cover)
        means, sd = found["score_pred"].to_numpy(dtype=float), found["score_sd"].to_numpy(dtype=float)
        best = int(means.argmax())
        answers.append((made, cover.to_numpy()[best], _within(means[best], sd[best])))
        if made >= n:
            return answers
        asked = strategy.ask(min(BATCH, n - made))[names]
        made += len(asked)
        new = asked.assign(score=score(asked.to_numpy(dtype=float)), valid_score=1)


PEERS: dict[str, tuple[str, Callable[[Score, int, int, int], Answers]]] = {
    "seqrsm": ("seqrsm", seqrsm),
    "Optuna TPE": ("optuna", optuna_tpe),
    "Optuna GP": ("optuna", optuna_gp),
    "BoTorch": ("botorch", botorch),
    "Ax": ("ax", ax),
    "BayBE": ("baybe", baybe),
    "BoFire": ("bofire", bofire),
}


FIELDS = ("surface", "package", "seed", "regret", "runs_to_1", "runs_to_half", "half_width", "covered", "cpu_s")


def runs_to(answers: Answers, regrets: list[float], limit: float) -> float:
    """Runs from which on the regret stays below ``limit``; inf where it does not."""
    last_bad = max((i for i, regret in enumerate(regrets) if regret > limit), default=-1)
    return answers[last_bad + 1][0] if last_bad + 1 < len(answers) else float("inf")


def campaign(name: str, peer: str, seed: int, n_runs: int, sigma: float) -> dict[str, object]:
    """One campaign of one package on one surface."""
    make, k = CASES[name]
    surface = make(np.random.default_rng(seed), k)
    rng = np.random.default_rng(seed + 1000)

    def score(points: np.ndarray) -> np.ndarray:
        return surface(points) + sigma * rng.standard_normal(len(points))

    began = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        answers = PEERS[peer][1](score, k, n_runs, seed)
    seconds = time.process_time() - began
    best = surfaces.true_optimum(surface, k)
    truths = [float(surface(point[None, :])[0]) for _, point, _ in answers]
    path = [best - truth for truth in truths]
    low, high = answers[-1][2]
    figures = (path[-1], runs_to(answers, path, 1.0), runs_to(answers, path, 0.5), 0.5 * (high - low))
    covered = float(low <= truths[-1] <= high) if np.isfinite(low) else float("nan")
    return dict(zip(FIELDS, (name, peer, seed, *figures, covered, seconds), strict=True))


HEAD = """# seqrsm beside Bayesian-optimisation packages

`OMP_NUM_THREADS=1 python tests/studies/peers_study.py --repeats {repeats} --runs {runs} --sigma {sigma:g}`
makes this page (it needs the packages, which seqrsm does not: an optional extra, never part of the
tests). Every package sees the same randomly drawn surfaces, noise of {sigma:g} points and {runs} runs: 12 Sobol runs
first (seqrsm: its start design of p + 6), then batches of 4 (Optuna: one at a time). The answer is what its own model
recommends (Optuna: its best trial; BoTorch, BayBE: the run of the largest posterior mean; Ax: its best
parameterization; BoFire: the largest posterior mean of 4096 points).

*Regret* is the true optimum less the true score at the answer: median, with the quartiles. *Runs to within 1* and *0.5*
points: from how many runs on the answer stays that good, median (never: not within the budget). *Half-width*: median of
the 95 % interval of the mean score at the answer, and in how many campaigns it *covers* the truth (Gaussian-process
packages: 1.96 posterior standard deviations). *CPU s*: a whole campaign, one thread, on a machine with other load;
median.
Versions: {versions}.

| surface | package | campaigns | regret (quartiles) | runs to within 1 | 0.5 | half-width | covers | CPU s |
|---|---|---|---|---|---|---|---|---|
"""


def write(rows: list[dict[str, str]], folder: Path, given: argparse.Namespace) -> None:
    """README.md of ``folder``."""
    versions = []
    for distribution in ("optuna", "botorch", "ax-platform", "baybe", "bofire"):
        try:
            versions.append(f"{distribution} {importlib.metadata.version(distribution)}")
        except importlib.metadata.PackageNotFoundError:
            versions.append(f"{distribution} not installed")
    lines = []
    for name in CASES:
        for peer in PEERS:
            some = [row for row in rows if (row["surface"], row["package"]) == (name, peer)]
            if not some:
                continue

            def of(key: str, some: list[dict[str, str]] = some) -> np.ndarray:
                return np.array([float(row[key]) for row in some])

            def runs(key: str) -> str:
                middle = float(np.quantile(of(key), 0.5, method="higher"))
                return f"{middle:.0f}" if np.isfinite(middle) else "never"

            quartiles = np.quantile(of("regret"), [0.25, 0.5, 0.75])
            width = np.median(of("half_width"))
            interval = f"{width:.2f} | {100 * np.mean(of('covered')):.0f} %" if np.isfinite(width) else "none | "
            lines.append(
                f"| {name} | {peer} | {len(some)} | {quartiles[1]:.2f} ({quartiles[0]:.2f}-{quartiles[2]:.2f}) | "
                f"{runs('runs_to_1')} | {runs('runs_to_half')} | {interval} | {np.median(of('cpu_s')):.2g} |"
            )
    profile(rows, folder / "profile.png")
    notes = folder / "notes.md"
    tail = "\n" + notes.read_text(encoding="utf-8") if notes.exists() else ""
    head = HEAD.format(
        repeats=len({row["seed"] for row in rows}), runs=given.runs, sigma=given.sigma, versions=", ".join(versions)
    )
    picture = """
![Share of campaigns whose answer stays within 1 point, against runs](profile.png)

Share of campaigns from that many runs on within 1 point of the optimum (a data profile: More & Wild 2009, SIAM J.
Optim. 20, 172-191); thick: `seqrsm`, whose first answer comes after p + 6 runs.
"""
    (folder / "README.md").write_text(head + "\n".join(lines) + "\n" + picture + tail, encoding="utf-8")


def profile(rows: list[dict[str, str]], path: Path) -> None:
    """Share of campaigns whose answer stays within 1 point, against the runs made."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(1, len(CASES), figsize=(15, 3.4), sharey=True, layout="constrained")
    ends = [float(row["runs_to_1"]) for row in rows]
    last = max((end for end in ends if np.isfinite(end)), default=40.0)
    for panel, name in zip(axes, CASES, strict=True):
        for number, peer in enumerate(PEERS):
            some = [row for row in rows if (row["surface"], row["package"]) == (name, peer)]
            if not some:
                continue
            reached = np.sort([float(row["runs_to_1"]) for row in some])
            share = np.arange(1, len(reached) + 1) / len(reached)
            there = np.isfinite(reached)
            x = np.concatenate([[START], reached[there], [last]])
            y = np.concatenate([[0.0], share[there], [share[there][-1] if there.any() else 0.0]])
            style = {"color": "black", "linewidth": 2.6} if peer == "seqrsm" else {"color": f"C{number}"}
            panel.step(x, 100.0 * y, where="post", label=peer, **style)
        panel.set_title(name, fontsize=10)
        panel.set_xlabel("runs")
    axes[0].set_ylabel("campaigns within 1 point [%]")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=len(PEERS), frameon=False)
    figure.savefig(path, dpi=110)
    pyplot.close(figure)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=20)
    parser.add_argument("--runs", type=int, default=40)
    parser.add_argument("--sigma", type=float, default=2.0)
    parser.add_argument("--peers", nargs="+", default=list(PEERS), choices=list(PEERS))
    parser.add_argument("--out", type=Path, default=Path("reports/peers"))
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    path, rows = given.out / "campaigns.csv", []
    if path.exists():
        with path.open(newline="", encoding="utf-8") as stream:
            rows = list(csv.DictReader(stream))
    done = {(row["surface"], row["package"], int(row["seed"])) for row in rows}
    with path.open("a", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, FIELDS)
        if not rows:
            writer.writeheader()
        for seed in range(given.repeats):
            for name in CASES:
                for peer in given.peers:
                    if (name, peer, seed) in done or importlib.util.find_spec(PEERS[peer][0]) is None:
                        continue
                    found = campaign(name, peer, seed, given.runs, given.sigma)
                    row = {key: str(value) for key, value in found.items()}
                    rows.append(row)
                    writer.writerow(row)
                    stream.flush()
                    print(*row.values(), flush=True)
    write(rows, given.out, given)


if __name__ == "__main__":
    main()
