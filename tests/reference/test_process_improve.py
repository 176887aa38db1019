"""Fits with blocks and categories against process-improve; its figures stand beside the program that made them."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from seqrsm.design.factors import CategoricalFactor, ContinuousFactor
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.fit.intervals import LackOfFit
from seqrsm.fit.least_squares import block_columns, fit_least_squares

REFERENCE = Path(__file__).parent / "data" / "process_improve" / "process_improve.json"
PROBLEMS = json.loads(REFERENCE.read_text(encoding="utf-8"))["problems"]
CLOSE = {"rtol": 1e-9, "atol": 1e-11}


def our_name(theirs: str) -> str:
    """``C(P, Sum)[S.u]:E`` -> ``P[u]:E``, ``I(E ** 2)`` -> ``E^2``, ``Block1`` -> ``block[d1]``."""
    name = re.sub(r"C\(P, Sum\)\[S\.(\w)\]", r"P[\1]", theirs)
    name = re.sub(r"I\((\w) \*\* 2\)", r"\1^2", name)
    return {"Intercept": "intercept", "Block1": "block[d1]"}.get(name, name)


@pytest.mark.parametrize("number", range(len(PROBLEMS)))
def test_random_problems(number: int) -> None:
    problem = PROBLEMS[number]
    runs, new, found = problem["runs"], problem["new"], problem["found"]
    factors = tuple(
        CategoricalFactor("P", ("u", "v", "w")) if name == "P" else ContinuousFactor(name, -1.0, 1.0)
        for name in runs
        if name not in ("y", "Block")
    )
    model, region = QuadraticModel(factors), Region(factors)

    def rows(table: dict) -> np.ndarray:
        count = len(next(iter(table.values())))
        return region.code([{f.name: table[f.name][i] for f in factors} for i in range(count)])

    points, labels = rows(runs), runs.get("Block", ["all"] * len(runs["y"]))
    columns, names = block_columns(labels)
    fit = fit_least_squares(
        np.hstack([model.matrix(points), columns]),
        np.array(runs["y"]),
        [*model.terms, *names],
        setting_ids=[tuple(row) for row in points],
        block_ids=labels,
    )
    order = [fit.names.index(our_name(row["term"])) for row in found["coefficients"]]
    assert sorted(order) == list(range(fit.n_terms))
    interval = fit.interval(0.95)
    for ours, key in (
        (fit.estimate, "coefficient"),
        (fit.se, "std_error"),
        (fit.t, "t_value"),
        (interval.low, "ci_low"),
        (interval.high, "ci_high"),
    ):
        np.testing.assert_allclose(ours[order], [row[key] for row in found["coefficients"]], **CLOSE)
    np.testing.assert_allclose(fit.p_value[order], [row["p_value"] for row in found["coefficients"]], rtol=1e-7)
    summary = found["model_summary"]
    for ours, key in (
        (fit.r2, "r_squared"),
        (fit.r2_adjusted, "r_squared_adj"),
        (fit.r2_predicted, "r_squared_pred"),
        (fit.s**2, "mse_residual"),
        (fit.sst, "ss_total"),
        (fit.sse, "ss_residual"),
    ):
        np.testing.assert_allclose(ours, summary[key], rtol=1e-9)
    everything = fit.partial_f(range(1, fit.n_terms))
    np.testing.assert_allclose(everything.f, summary["f_statistic"], rtol=1e-9)
    lack, theirs = fit.lack_of_fit(), found["lack_of_fit"]
    assert isinstance(lack, LackOfFit)
    assert (lack.df_lof, lack.df_pe) == (theirs["df_lack_of_fit"], theirs["df_pure_error"])
    np.testing.assert_allclose(
        [lack.ss_lof, lack.f, lack.p], [theirs["ss_lack_of_fit"], theirs["f_statistic"], theirs["p_value"]], rtol=1e-8
    )
    # process-improve predicts for the mean block.
    predicted = fit.predict(fit.rows_with_mean_block(model.matrix(rows(new))), 0.95)
    for ours, key in (
        (predicted.mean, "predicted"),
        (predicted.confidence.low, "ci_low"),
        (predicted.confidence.high, "ci_high"),
        (predicted.prediction.low, "pi_low"),
        (predicted.prediction.high, "pi_high"),
    ):
        np.testing.assert_allclose(ours, [row[key] for row in found["predictions"]], **CLOSE)
