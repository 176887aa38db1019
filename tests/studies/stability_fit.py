"""Digits of what a campaign's analysis says, at the extremes of coding, design, noise, offset, size and scale."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from decimal import Decimal
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[1] / "reference"))
import stability_exact as ex
import test_nist as nist

from seqrsm.analysis.conclude import analyse
from seqrsm.analysis.to_json import analysis_to_json
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.errors import UserError
from seqrsm.fit.least_squares import AliasedError, fit_least_squares
from seqrsm.spec.read import CampaignSpec, load_spec
from seqrsm.store.records import RunRecord, ScoreRecord

MEASURES = ("coefficients", "standard errors", "stationary point", "answer")
"""The last: recommended settings and half-width, against the first case of an axis that should not change them."""


@dataclass
class Row:
    """One case: where it stands on its axis, digits by measure, and what the program said."""

    study: str
    x: float
    condition: float = float("nan")
    digits: dict[str, float] = field(default_factory=dict)
    does: str = ""
    answer: tuple[float, ...] = ()


def truth(k: int, seed: int = 1) -> np.ndarray:
    """Coefficients of a concave quadratic with its maximum well inside the cube, in the order of the model's terms."""
    rng = np.random.default_rng(seed)
    model = QuadraticModel(spec_of([(-1.0, 1.0)] * k).factors)
    beta = np.empty(model.p)
    for t, (a, b) in enumerate(zip(model.first, model.second, strict=True)):
        if a == b == 0:
            beta[t] = 60.0
        elif min(a, b) == 0:
            beta[t] = rng.uniform(2.0, 4.0) * rng.choice([-1, 1])
        elif a == b:
            beta[t] = -rng.uniform(6.0, 9.0)
        else:
            beta[t] = rng.uniform(0.3, 1.0) * rng.choice([-1, 1])
    return beta


def spec_of(ranges: list[tuple[float, float]], scale: str = "linear") -> CampaignSpec:
    """A campaign of measured scores."""
    factors = "".join(
        f'[[factor]]\nname = "x{i + 1}"\nlow = {low!r}\nhigh = {high!r}\nscale = "{scale}"\n'
        for i, (low, high) in enumerate(ranges)
    )
    text = (
        '[campaign]\nname = "stability"\n'
        f'{factors}[[application]]\nname = "a"\nutility = "measured"\n[stop]\nhalf_width = 1.0\n'
        "max_runs = 400\n"
    )
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "campaign.toml").write_text(text, encoding="utf-8")
        return load_spec(Path(folder))


def runs_of(spec: CampaignSpec, x: np.ndarray, y: np.ndarray) -> list[RunRecord]:
    """Scored runs at natural settings (n, k)."""
    at = "2026-01-01T00:00:00+00:00"
    return [
        RunRecord(
            run_id=i,
            batch=1,
            purpose="start",
            why="",
            source="flight",
            state="scored",
            proposed=dict(zip(spec.region.names, settings, strict=True)),
            executed=None,
            block="",
            cost=1.0,
            reason="",
            attempts=1,
            owner="",
            replaces=None,
            proposed_at=at,
            issued_at=at,
            started_at=at,
            ended_at=at,
            scores=(
                ScoreRecord(
                    run_id=i,
                    application="a",
                    score=score,
                    se=None,
                    n=None,
                    correct=None,
                    metadata={},
                    source_file="",
                    source_row=None,
                    scored_at=at,
                ),
            ),
        )
        for i, (settings, score) in enumerate(zip(x.tolist(), y.tolist(), strict=True), start=1)
    ]


def case(
    study: str, at: float, ranges: list[tuple[float, float]], x: np.ndarray, y: np.ndarray, scale: str = "linear"
) -> Row:
    """Analyse runs as `fit` does, and count digits against the exact fit of the same doubles."""
    spec = spec_of(ranges, scale)
    model = QuadraticModel(spec.factors)
    first, second = model.first.tolist(), model.second.tolist()
    row = Row(study, at)
    columns = [ex.coded(ex.exact(x[:, j]), *ends, scale) for j, ends in enumerate(ranges)]
    Z = ex.quadratic_rows(columns, first, second)
    row.condition = condition(np.array(Z, dtype=np.float64))
    reference = ex.least_squares(Z, ex.exact(y))
    # What any solver could reach that is given the columns as doubles.
    rounded = model.matrix(spec.region.code(settings(spec, x)))
    limit = ex.least_squares([ex.exact(r) for r in rounded], ex.exact(y))
    row.digits["coefficients, limit of double columns"] = ex.digits(np.array(limit.beta, dtype=float), reference.beta)
    row.digits["standard errors, limit of double columns"] = ex.digits(np.array(limit.se, dtype=float), reference.se)
    try:
        found = analyse(spec, spec.applications[0], runs_of(spec, x, y), n_draws=200)
    except UserError as error:
        row.does = f"refuses: {error.problems[0].message}"
        return row
    answer = analysis_to_json(found)
    coded = [term["coded"] for term in answer["terms"]]
    row.digits["coefficients"] = ex.digits([c["estimate"] for c in coded], reference.beta)
    row.digits["standard errors"] = ex.digits([c["se"] for c in coded], reference.se)
    if answer["stationary_point"] is not None:
        told = [answer["stationary_point"]["exact"]["coded"][name] for name in spec.region.names]
        row.digits["stationary point"] = ex.digits(told, ex.stationary(reference.beta, len(ranges), first, second))
    optimum = answer["optimum"]
    row.answer = (optimum["prediction"]["half_width"], *(optimum["coded"][name] for name in spec.region.names))
    natural = reference.mapped(natural_map(ranges, first, second, scale))
    row.digits["natural coefficients"] = ex.digits([t["natural"]["estimate"] for t in answer["terms"]], natural.beta)
    row.digits["natural standard errors"] = ex.digits([t["natural"]["se"] for t in answer["terms"]], natural.se)
    # What has to do with digits comes first: other remarks may cut it off where space is short.
    row.does = " ".join(sorted(found.warnings, key=lambda text: "extrapolation" in text))
    return row


def unchanged(rows: Iterator[Row], unit: Callable[[float], float] = lambda at: 1.0) -> Iterator[Row]:
    """Cases of an axis that should not change the answer, with the digits in which it is that of the first.

    ``unit``: of the scores, at a place on the axis.
    """
    first: tuple[Decimal, ...] = ()
    for row in rows:
        if row.answer:
            scaled = (Decimal(row.answer[0]) / Decimal(unit(row.x)), *map(Decimal, row.answer[1:]))
            first = first or scaled
            row.digits["answer"] = min(
                ex.digits(float(scaled[0]), first[:1]), ex.places(list(map(float, scaled[1:])), first[1:])
            )
        yield row


def natural_map(ranges: list[tuple[float, float]], first: list[int], second: list[int], scale: str) -> ex.Matrix:
    """Exact map from coded coefficients to those in the factors, or in their log10."""
    k = len(ranges)
    base = [[Decimal(int(i == j)) for j in range(k + 1)] for i in range(k + 1)]
    for j, ends in enumerate(ranges, start=1):
        a, b = (v / Decimal(10).ln() if scale == "log" else v for v in ex.axis(ex.exact(ends), scale))
        base[j][0], base[j][j] = -(a + b) / (b - a), 2 / (b - a)
    place = {(min(a, b), max(a, b)): t for t, (a, b) in enumerate(zip(first, second, strict=True))}
    T = [[Decimal(0)] * len(first) for _ in first]
    for t, (a, b) in enumerate(zip(first, second, strict=True)):
        for i in range(k + 1):
            for j in range(k + 1):
                T[place[min(i, j), max(i, j)]][t] += base[a][i] * base[b][j]
    return T


def condition(Z: np.ndarray) -> float:
    """Condition number with columns of unit length."""
    singular = np.linalg.svd(Z / np.linalg.norm(Z, axis=0), compute_uv=False)
    return float(singular[0] / singular[-1]) if singular[-1] > 0 else float("inf")


def coding(scale: str = "linear") -> Iterator[Row]:
    """Offset over range of both factors from 1 to 1e12, and what no coding at all would give."""
    points = np.random.default_rng(2).uniform(-1, 1, (16, 2))
    noise = np.random.default_rng(3).normal(size=16)
    beta = truth(2)
    for exponent in range(13):
        ratio = 10.0**exponent
        ranges = [(ratio, ratio + 1.0)] * 2
        spec = spec_of(ranges, scale)
        x = np.column_stack([f.decode(points[:, j]) for j, f in enumerate(spec.factors)])
        model = QuadraticModel(spec.factors)
        y = model.matrix(points) @ beta + noise
        row = case(f"coding, {scale}", ratio, ranges, x, y, scale)
        if scale == "linear":
            first, second = model.first.tolist(), model.second.tolist()
            columns = [ex.exact(x[:, j]) for j in range(2)]
            exact_natural = ex.least_squares(ex.quadratic_rows(columns, first, second), ex.exact(y))
            base = np.column_stack([np.ones(16), x])
            Z = base[:, first] * base[:, second]
            row.digits["uncoded, this solver"] = np.nan
            with suppress(AliasedError):
                fit = fit_least_squares(Z, y, model.terms)
                row.digits["uncoded, this solver"] = ex.digits(fit.estimate, exact_natural.beta)
            plain = np.linalg.lstsq(Z, y, rcond=None)[0]
            row.digits["uncoded, numpy lstsq"] = ex.digits(plain, exact_natural.beta)
        yield row


def settings(spec: CampaignSpec, x: np.ndarray) -> list[dict[str, float | str]]:
    return [dict(zip(spec.region.names, values, strict=True)) for values in x.tolist()]


def near_singular() -> Iterator[Row]:
    """The second factor follows the first but for a share that goes to 0."""
    rng = np.random.default_rng(4)
    t, u, noise = rng.uniform(-1, 1, 18), rng.uniform(-1, 1, 18), rng.normal(size=18)
    model = QuadraticModel(spec_of([(-1.0, 1.0)] * 2).factors)
    for exponent in np.arange(0.0, 9.5, 0.5):
        share = 10.0**-exponent
        x = np.column_stack([t, np.clip(t + share * (u - t), -1, 1)])
        y = model.matrix(x) @ truth(2) + noise
        yield case("near-singular design", share, [(-1.0, 1.0)] * 2, x, y)


def noise_level() -> Iterator[Row]:
    """Noise of 1e-15 to 1e12 on a surface whose range is some 10."""
    rng = np.random.default_rng(5)
    x, noise = rng.uniform(-1, 1, (20, 2)), rng.normal(size=20)
    model = QuadraticModel(spec_of([(-1.0, 1.0)] * 2).factors)
    signal = model.matrix(x) @ truth(2)
    for exponent in range(-16, 13):
        yield case("noise", 10.0**exponent, [(-1.0, 1.0)] * 2, x, signal + 10.0**exponent * noise)


def offset() -> Iterator[Row]:
    """A constant of 1 to 1e16 on every score, noise 1."""
    rng = np.random.default_rng(6)
    x, noise = rng.uniform(-1, 1, (20, 2)), rng.normal(size=20)
    model = QuadraticModel(spec_of([(-1.0, 1.0)] * 2).factors)
    y = model.matrix(x) @ truth(2) + noise
    for exponent in range(17):
        yield case("offset of the scores", 10.0**exponent, [(-1.0, 1.0)] * 2, x, y + 10.0**exponent)


def scale() -> Iterator[Row]:
    """Scores, noise included, in units from 1e-30 to 1e30."""
    rng = np.random.default_rng(7)
    x, noise = rng.uniform(-1, 1, (20, 2)), rng.normal(size=20)
    model = QuadraticModel(spec_of([(-1.0, 1.0)] * 2).factors)
    y = model.matrix(x) @ truth(2) + noise
    for exponent in range(-150, 151, 15):
        yield case("unit of the scores", 10.0**exponent, [(-1.0, 1.0)] * 2, x, y * 10.0**exponent)


def size() -> Iterator[Row]:
    """One to eight factors, p + 10 runs at random."""
    for k in range(1, 9):
        rng = np.random.default_rng(10 + k)
        ranges = [(-1.0, 1.0)] * k
        model = QuadraticModel(spec_of(ranges).factors)
        x = rng.uniform(-1, 1, (model.p + 10, k))
        y = model.matrix(x) @ truth(k) + 0.3 * rng.normal(size=len(x))
        yield case("factors", float(k), ranges, x, y)


def nist_sets() -> list[dict[str, object]]:
    """Digits of NIST's eleven linear sets, in the data's own units and, for polynomials, through coded columns."""
    rows: list[dict[str, object]] = []
    for name in nist.NAMES:
        certified, y, x = nist.load(name)
        fit = fit_least_squares(nist.model_matrix(certified, x), y, nist.terms(certified))
        row: dict[str, object] = {"set": name, "condition": fit.condition_number, "does": fit.reason or "fits"}
        exactly = max(certified["std_errors"]) == 0.0
        row["coefficients"] = nist.worst(fit.estimate, certified["coefficients"])
        row["standard errors"] = 15.0 if exactly and not fit.se.any() else nist.worst(fit.se, certified["std_errors"])
        row["s"] = 15.0 if exactly and fit.s == 0.0 else nist.digits(fit.s, certified["residual_sd"])
        if certified["model_type"] == "polynomial" and certified["intercept"] and certified["degree"] > 1:
            coded, back = nist.coded_fit(certified, y, x)
            estimate, se = nist.back_transformed(coded, back)
            row["coded condition"] = coded.condition_number
            row["coded coefficients"] = nist.worst(estimate, certified["coefficients"])
            row["coded standard errors"] = 15.0 if exactly else nist.worst(se, certified["std_errors"])
        rows.append(row)
    return rows


STUDIES = {
    "coding, linear": lambda: unchanged(coding()),
    "coding, log": lambda: unchanged(coding("log")),
    "near-singular design": near_singular,
    "noise": noise_level,
    "offset of the scores": lambda: unchanged(offset()),
    "unit of the scores": lambda: unchanged(scale(), lambda at: at),
    "factors": size,
}
