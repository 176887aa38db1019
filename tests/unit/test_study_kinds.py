"""The kinds of surfaces of the studies: their tops against closed forms, their noise, their shapes."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "studies"))
import kinds

CLOSED = {
    "quadratic, k = 3": 90.0, "quadratic, k = 5": 90.0, "student": 90.0, "counts": 90.0, "asymmetric": 85.0,
    "unequal noise": 85.0, "ridge": 85.0, "categories": 85.0, "sparse": 85.0,
}  # fmt: skip


@pytest.mark.parametrize("name", CLOSED)
def test_tops_that_are_known(name: str) -> None:
    for seed in range(3):
        assert kinds.true_top(kinds.KINDS[name].draw(seed)) == pytest.approx(CLOSED[name], abs=1e-5)


def test_top_of_the_cliff_lies_before_its_edge() -> None:
    x = np.linspace(-1.0, 1.0, 200_001)
    for seed in range(5):
        drawn = kinds.KINDS["cliff"].draw(seed)
        place, top = kinds.true_optimum(drawn)
        along = np.column_stack([x, np.tile(place[1:], (len(x), 1))])
        values = drawn.value(along)
        assert top == pytest.approx(values.max(), abs=1e-6)
        steepest = x[np.argmin(np.diff(values))]
        assert 0.2 <= steepest <= 0.6
        assert place[0] < steepest
        before, after = (values[np.searchsorted(x, steepest + step)] for step in (-0.1, 0.1))
        assert 18.0 < before - after < 25.0


@pytest.mark.parametrize("name", ["border, k = 3", "saturating, k = 3", "two humps", "plateau", "cubic"])
def test_nothing_is_above_the_top(name: str) -> None:
    kind = kinds.KINDS[name]
    for seed in range(3):
        drawn = kind.draw(seed)
        place, top = kinds.true_optimum(drawn)
        X = kinds.spread(kind, 50_000, np.random.default_rng(seed + 100))
        assert np.all(drawn.value(X) <= top)
        assert top == pytest.approx(float(drawn.value(place[None, :])[0]))
        found = kinds.highest(drawn.value, kind, X[:2000])
        assert top - float(drawn.value(found[None, :])[0]) < 0.1


def test_third_order_adds_three_to_five_points() -> None:
    grid = kinds.spread(kinds.KINDS["cubic"], 20_000, np.random.default_rng(0))
    grid = np.vstack([grid, np.sign(grid)])
    for seed in range(5):
        drawn = kinds.KINDS["cubic"].draw(seed)
        odd = 0.5 * (drawn.value(grid) - drawn.value(-grid))  # of first and third order alone
        half = 0.5 * (drawn.value(0.5 * grid) - drawn.value(-0.5 * grid))
        third = (odd - 2.0 * half) / 0.75
        assert 2.5 < np.max(np.abs(third)) < 5.1


@pytest.mark.parametrize("kind", kinds.KINDS.values(), ids=lambda kind: kind.name)
def test_shapes_and_noise(kind: kinds.Kind) -> None:
    """Scores scatter about the true means by what ``noise_sd`` says; another seed is another surface."""
    drawn = kind.draw(0)
    X = kinds.spread(kind, 5, np.random.default_rng(1))
    assert X.shape == (5, kind.factors + bool(kind.levels))
    means, sd = drawn.value(X), drawn.noise_sd(X)
    assert means.shape == sd.shape == (5,)
    assert np.array_equal(kind.draw(0).value(X), means)
    assert not np.allclose(kind.draw(1).value(X), means)
    rng = np.random.default_rng(2)
    scores = drawn.score(np.tile(X, (4000, 1)), rng).reshape(4000, 5)
    if kind.of_day:  # runs of one day have its effect in common
        days = np.array([drawn.score(X[:1], rng)[0] for _ in range(4000)]) - means[0]
        assert np.std(days) == pytest.approx(np.hypot(kind.of_day, sd[0]), rel=0.06)
        scores -= np.mean(scores - means)
    assert np.all(np.abs(scores.mean(axis=0) - means) < 5.0 * sd / np.sqrt(4000))
    assert scores.std(axis=0) == pytest.approx(sd, rel=0.2 if kind.errors == "student_t" else 0.06)


def test_poor_scores_scatter_more_where_noise_is_unequal() -> None:
    assert kinds.unequal(np.array([85.0, 73.0, 0.0])) == pytest.approx([1.0, 2.0, 5.0])
    assert kinds.counts(np.array([50.0, 90.0])) == pytest.approx([2.5, 1.5])
