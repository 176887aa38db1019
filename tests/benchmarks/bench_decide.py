"""Seconds of the steps between two batches, against a local search of the same surfaces in the same run.

python tests/benchmarks/bench_decide.py
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from scipy.optimize import minimize

from seqrsm.design.factors import ContinuousFactor
from seqrsm.design.optimal import start_design
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.fit.optimum import optimum, optimum_draws
from seqrsm.fit.process import Process
from seqrsm.propose.batch import propose_batch
from seqrsm.propose.cloud import Runs, propose_from_process
from seqrsm.propose.known import Evidence, Sought


def median_seconds(action: Callable[[], object], repeats: int = 5) -> float:
    action()  # compile, and fill caches
    times = []
    for _ in range(repeats):
        start = time.process_time()
        action()
        times.append(time.process_time() - start)
    return float(np.median(times))


def main() -> None:
    rng = np.random.default_rng(5)
    factors = tuple(ContinuousFactor(f"x{i}", -1.0, 1.0) for i in range(5))
    model, region = QuadraticModel(factors), Region(factors)
    betas = rng.normal(size=(1000, model.p))

    def local_searches() -> None:
        for beta in betas[:20]:
            for x0 in rng.uniform(-1.0, 1.0, (10, 5)):
                minimize(lambda x, b=beta: -float(model.matrix(x[None, :])[0] @ b), x0, bounds=[(-1.0, 1.0)] * 5)

    baseline = 50.0 * median_seconds(local_searches, 1)
    points = start_design(model, region, 40, 3, 0)
    targets, _ = optimum_draws(model, region, betas[:64])
    evidence, sought = Evidence(model.matrix(points), points), Sought(targets[0], targets)
    four = factors[:4]
    at = rng.uniform(-1.0, 1.0, (60, 4))
    scores = 80.0 - 9.0 * np.sum(at**2, axis=1) + 2.0 * rng.standard_normal(60)

    def look() -> Process:
        return Process(QuadraticModel(four), at, scores, np.ones(60), np.random.default_rng(0))

    process = look()

    def next_four() -> object:
        return propose_from_process(process, Region(four), np.zeros(4), Runs(at, np.zeros(60, dtype=bool)), 4)

    rows = [
        ("1000 optima, ten L-BFGS-B starts each (baseline)", baseline),
        ("1000 exact optima of posterior draws", median_seconds(lambda: optimum_draws(model, region, betas))),
        ("one exact optimum", median_seconds(lambda: optimum(model, region, betas[0]))),
        ("a batch of 4 proposals", median_seconds(lambda: propose_batch(model, region, evidence, sought, 4))),
        ("a process of 60 runs, four factors", median_seconds(look)),
        ("a batch of 4 proposals of it", median_seconds(next_four)),
    ]
    for label, seconds in rows:
        print(f"{label:52} {1e3 * seconds:10.2f} ms   {baseline / seconds:10.1f} x baseline")


if __name__ == "__main__":
    main()
