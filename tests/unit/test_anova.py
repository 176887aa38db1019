"""Analysis of variance: closed forms and additivity."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from seqrsm.fit.intervals import LackOfFit, group_index, pure_error, sequential_ss
from seqrsm.fit.least_squares import block_columns, fit_least_squares


def two_factor(seed: int = 0) -> tuple[np.ndarray, np.ndarray, list[Any], list[tuple[float, float]]]:
    rng = np.random.default_rng(seed)
    points = [(a, b) for a in (-1.0, 0.0, 1.0) for b in (-1.0, 0.0, 1.0)] * 2
    a, b = np.array(points).T
    Z = np.column_stack([np.ones(18), a, b, a * b, a * a, b * b])
    kinds = ["intercept", "linear", "linear", "interaction", "square", "square"]
    terms = [SimpleNamespace(name=f"z{i}", kind=kind) for i, kind in enumerate(kinds)]
    return Z, 10 + Z @ np.array([0, 2, 1, 1, -3, 0]) + rng.normal(0, 1, 18), terms, points


def test_orthogonal_factorial_by_contrasts() -> None:
    """On the 3x3 factorial twice, the sum of squares of a factor is (sum of x y)^2 / sum of x^2."""
    Z, y, terms, points = two_factor()
    rows = {r.source: r for r in fit_least_squares(Z, y, terms, setting_ids=points).anova()}
    linear = sum(float(Z[:, i] @ y) ** 2 / 12 for i in (1, 2))
    assert rows["first order"].ss == pytest.approx(linear, rel=1e-12)
    assert rows["interactions"].ss == pytest.approx(float(Z[:, 3] @ y) ** 2 / 8, rel=1e-12)
    assert rows["total"].ss == pytest.approx(float(np.sum((y - y.mean()) ** 2)), rel=1e-13)
    pairs = y.reshape(2, 9)
    assert rows["pure error"].ss == pytest.approx(float(np.sum((pairs[0] - pairs[1]) ** 2)) / 2, rel=1e-12)
    assert (rows["pure error"].df, rows["lack of fit"].df, rows["residual"].df) == (9, 3, 12)


def test_the_table_adds_up_and_f_is_scipys() -> None:
    Z, y, terms, points = two_factor(4)
    w = np.random.default_rng(1).uniform(0.3, 3, 18)
    rows = {r.source: r for r in fit_least_squares(Z, y, terms, weights=w, setting_ids=points).anova()}
    parts = [rows[s] for s in ("first order", "interactions", "squares", "residual")]
    assert rows["total"].ss == pytest.approx(sum(r.ss for r in parts), rel=1e-12)
    assert rows["residual"].ss == pytest.approx(rows["lack of fit"].ss + rows["pure error"].ss, rel=1e-12)
    for name in ("first order", "interactions", "squares"):
        row = rows[name]
        assert row.f == pytest.approx(row.ms / rows["residual"].ms, rel=1e-13)
        assert row.p == pytest.approx(stats.f.sf(row.f, row.df, 12), rel=1e-9)


@pytest.mark.parametrize("inflation", [1.0, 1.4])
def test_f_of_the_last_term_alone_is_the_square_of_its_t(inflation: float) -> None:
    """Student-t errors, too: their weights come from the scores, which widens standard errors."""
    Z, y, terms, _ = two_factor(2)
    fit = fit_least_squares(Z[:, :5], y, terms[:5], inflation=inflation)
    row = next(row for row in fit.anova() if row.source == "squares")
    assert (row.f, row.p) == pytest.approx((float(fit.t[-1]) ** 2, float(fit.p_value[-1])), rel=1e-9)


def test_weighted_pure_error_by_definition() -> None:
    y, w = np.array([1.0, 3.0, 10.0, 10.5, 7.0]), np.array([1.0, 3.0, 2.0, 2.0, 5.0])
    df, ss, groups = pure_error(y, w, np.array([0, 0, 1, 1, 2]), None)
    # weighted means 2.5 and 10.25: 1 * 1.5^2 + 3 * 0.5^2 + 2 * 2 * 0.25^2
    assert (df, groups) == (2, 3)
    assert ss == pytest.approx(2.25 + 0.75 + 0.25, rel=1e-14)


def test_repeats_on_different_days_are_no_pure_error() -> None:
    y = np.array([5.0, 9.0, 5.0, 9.0])
    same_setting = np.zeros(4, dtype=np.int64)
    assert pure_error(y, np.ones(4), same_setting, None)[:2] == (3, 16.0)
    assert pure_error(y, np.ones(4), same_setting, np.array([0, 1, 0, 1]))[:2] == (2, 0.0)


def test_block_row_comes_first_and_takes_the_day_effect() -> None:
    Z, y, terms, points = two_factor()
    days = ["a"] * 9 + ["b"] * 9
    columns, names = block_columns(days)
    fit = fit_least_squares(
        np.hstack([Z, columns]), y + 4.0 * columns[:, 0], [*terms, *names], setting_ids=points, block_ids=days
    )
    rows = fit.anova()
    assert rows[0].source == "blocks"
    means = (y + 4.0 * columns[:, 0]).reshape(2, 9).mean(axis=1)
    assert rows[0].ss == pytest.approx(4.5 * (means[0] - means[1]) ** 2, rel=1e-12)
    assert fit.lack_of_fit() == "no setting was run twice in one block, so there is no pure error to test against"


def test_lack_of_fit_reasons() -> None:
    Z, y, terms, points = two_factor()
    assert isinstance(fit_least_squares(Z, y, terms, setting_ids=points).lack_of_fit(), LackOfFit)
    assert "not known" in str(fit_least_squares(Z, y, terms).lack_of_fit())
    repeated = np.tile(y[:9], 2)
    assert "pure error is zero" in str(fit_least_squares(Z, repeated, terms, setting_ids=points).lack_of_fit())
    full = np.column_stack([Z, Z[:, 1] * Z[:, 5], Z[:, 2] * Z[:, 4], Z[:, 4] * Z[:, 5]])
    extra = [*terms, *(SimpleNamespace(name=f"e{i}", kind="interaction") for i in range(3))]
    assert "all means" in str(fit_least_squares(full, y, extra, setting_ids=points).lack_of_fit())


def test_sequential_sums_of_squares_equal_differences_of_fits() -> None:
    rng = np.random.default_rng(3)
    X, y = rng.normal(size=(30, 9)), rng.normal(size=30)
    groups = [X[:, :2], X[:, 2:3], X[:, 3:7], X[:, [0, 7]], X[:, 8:]]
    parts = sequential_ss(groups, y)
    assert [df for df, _ in parts] == [2, 1, 4, 1, 1]
    left = float(y @ y)
    columns = np.zeros((30, 0))
    for group, (_, ss) in zip(groups, parts, strict=True):
        columns = np.hstack([columns, group])
        sse = float(np.sum((y - columns @ np.linalg.lstsq(columns, y, rcond=None)[0]) ** 2))
        assert ss == pytest.approx(left - sse, rel=1e-9)
        left = sse


def test_group_index() -> None:
    assert group_index(["b", "a", "b"]).tolist() == [0, 1, 0]  # type: ignore[union-attr]
    assert group_index(None) is None


def test_pure_error_is_taken_within_the_blocks_that_the_columns_tell_apart() -> None:
    """Repeats on different days differ by the days: without block_ids the block columns say which they are."""
    rng = np.random.default_rng(12)
    points = np.repeat(rng.uniform(-1, 1, (6, 1)), 4, axis=0)
    days = ["a", "a", "b", "b"] * 6
    columns, names = block_columns(days)
    Z = np.hstack([np.ones((24, 1)), points, columns])
    terms = [SimpleNamespace(name="1", kind="intercept"), SimpleNamespace(name="x", kind="linear"), *names]
    y = 5.0 * columns[:, 0] + rng.normal(size=24)
    ids = [tuple(row) for row in points]
    fit = fit_least_squares(Z, y, terms, setting_ids=ids)
    told = fit_least_squares(Z, y, terms, setting_ids=ids, block_ids=days)
    assert fit.lack_of_fit() == told.lack_of_fit()
    assert fit.lack_of_fit().df_pe == 12
