"""Common random numbers: runs are dealt out to occasions, alike settings apart, and crossed blocks leave pure error."""

from __future__ import annotations

from collections import Counter
from itertools import combinations

import numpy as np
import pytest

from seqrsm.analysis.runs import occasion_of, share_occasions, sharing, similarity
from seqrsm.design.factors import CategoricalFactor, ContinuousFactor
from seqrsm.design.region import Region
from seqrsm.fit.least_squares import fit_least_squares
from seqrsm.store.records import CONFIRMATION, NewRun, RunRecord

REGION = Region((ContinuousFactor("x", 0.0, 10.0), ContinuousFactor("y", 0.0, 1.0), CategoricalFactor("p", ("H", "V"))))


def record(run_id: int, run: NewRun, state: str = "scored") -> RunRecord:
    return RunRecord(
        run_id, 1, run.purpose, run.why, run.source, state, dict(run.settings), None, run.block, 1.0, "", 0, "", None,
        "t", None, None, None,
    )  # fmt: skip


def settings(n: int, seed: int = 0) -> list[NewRun]:
    return [NewRun(own) for own in REGION.decode(REGION.sample(n, np.random.default_rng(seed)))]


def deal(runs: list[NewRun], made: list[RunRecord], size: int) -> list[NewRun]:
    return share_occasions(runs, made, size=size, region=REGION)


@pytest.mark.parametrize(("n", "size"), [(24, 8), (24, 2), (7, 100), (1, 3)])
def test_occasions_are_no_larger_than_asked_and_hold_no_two_alike(n: int, size: int) -> None:
    dealt = deal(settings(n), [], size)
    blocks = Counter(run.block for run in dealt)
    assert max(blocks.values()) <= size
    assert all(occasion_of("simulation", block) for block in blocks)
    for one, other in combinations(dealt, 2):
        if one.block == other.block:
            gap = np.abs(REGION.code([one.settings])[0] - REGION.code([other.settings])[0])
            assert max(gap[:2]) >= 0.5  # a quarter of the range


def test_new_occasions_are_filled_in_turn() -> None:
    """Each gets settings from all over the region, as the design orders them by no chance."""
    corners = [NewRun({"x": x, "y": y, "p": "H"}) for x in (0.0, 10.0) for y in (0.0, 1.0)]
    assert [run.block for run in deal(corners, [], 2)] == ["occasion 1", "occasion 2"] * 2


def test_repeats_meet_different_occasions_also_in_later_batches() -> None:
    same = NewRun({"x": 5.0, "y": 0.5, "p": "H"})
    first = deal([same, same, same], [], 8)
    assert len({run.block for run in first}) == 3
    made = [record(i, run) for i, run in enumerate(first, start=1)]
    (again,) = deal([same], made, 8)
    assert again.block == "occasion 4"
    # A void run was simulated, too: its number would come again.
    made[0] = record(1, first[0], "void")
    assert deal([same], made, 8)[0].block == "occasion 4"
    (far,) = deal([NewRun({"x": 0.0, "y": 0.0, "p": "H"})], made, 8)
    assert far.block == "occasion 1"


def test_flights_and_confirmation_runs_share_nothing() -> None:
    own = {"x": 1.0, "y": 0.1, "p": "H"}
    runs = [NewRun(own, source="flight", block="Monday"), NewRun(own, purpose=CONFIRMATION), NewRun(own)]
    assert [run.block for run in deal(runs, [], 4)] == ["Monday", "", "occasion 1"]
    assert occasion_of("flight", "occasion 3") is None
    assert occasion_of("simulation", "occasion 0") is None
    assert occasion_of("simulation", "occasion 12") == 12


def test_only_runs_that_share_are_counted() -> None:
    dealt = deal(settings(9), [], 4)
    runs = [record(i, run) for i, run in enumerate(dealt)]
    members = Counter(run.block for run in dealt)
    assert sharing(runs) == (sum(n for n in members.values() if n > 1), sum(n > 1 for n in members.values()))
    assert sharing([record(1, run, "issued") for run in dealt]) == (0, 0)


def test_an_occasion_does_less_alike_the_further_settings_are_apart() -> None:
    """exp(-d^2 / (2 1.5^2)) of the coded distance d; another level is as far as half a range."""
    points = np.array([[0.0, 0.0, 0.0], [1.5, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 1.0, 1.0]])
    expected = np.exp([0.0, -0.5, -0.5 / 2.25, -1.5 / 2.25])
    np.testing.assert_allclose(similarity(REGION.factors, points)[0], expected, rtol=1e-14)


@pytest.mark.parametrize("seed", range(5))
def test_pure_error_across_blocks_is_the_residual_of_settings_and_blocks(seed: int) -> None:
    """Against the two-way model with every constant written out, by ordinary least squares."""
    rng = np.random.default_rng(seed)
    n, cells, blocks = 40, rng.integers(0, 14, 40), rng.integers(0, 5, 40)
    x, w = rng.normal(size=14)[cells], rng.uniform(0.5, 2.0, n)
    y = x + rng.normal(size=5)[blocks] + rng.normal(size=n)
    Z = np.column_stack([np.ones(n), x, *((blocks == b) * 1.0 - (blocks == 4) for b in range(4))])
    names = [f"block[{b}]" for b in range(4)]

    class Term:
        def __init__(self, name: str, kind: str) -> None:
            self.name, self.kind = name, kind

    fit = fit_least_squares(
        Z, y, [Term("1", "intercept"), Term("x", "linear"), *names], weights=w, setting_ids=cells.tolist(),
        block_ids=blocks.tolist(), crossed_blocks=True,
    )  # fmt: skip
    both = np.column_stack([cells[:, None] == np.unique(cells), blocks[:, None] == np.arange(5)]) * np.sqrt(w)[:, None]
    solution, _, rank, _ = np.linalg.lstsq(both, np.sqrt(w) * y, rcond=None)
    lack = fit.lack_of_fit()
    assert not isinstance(lack, str)
    assert lack.df_pe == fit.df_pure_error == n - rank
    assert lack.ss_pe == pytest.approx(np.sum((np.sqrt(w) * y - both @ solution) ** 2), rel=1e-9)
    assert lack.df_lof + lack.df_pe == fit.df_residual


def test_blocks_that_repeats_do_not_join_leave_no_pure_error() -> None:
    """Three repeats of one setting, each in a block of its own: their differences are the blocks'."""
    Z = np.column_stack([np.ones(6), [0.0, 0.0, 0.0, 1.0, 2.0, 3.0]])
    fit = fit_least_squares(
        Z, np.arange(6.0) ** 2, ["a", "b"], setting_ids=[0, 0, 0, 1, 2, 3], block_ids=[0, 1, 2, 0, 1, 2],
        crossed_blocks=True,
    )  # fmt: skip
    assert fit.df_pure_error == 0
