"""What long work tells while it works, and that listening changes no result."""

from __future__ import annotations

import dataclasses
import itertools
from types import SimpleNamespace

import numpy as np
import pytest
from short_search import optimal_design
from shorthands import sample_posterior

from seqrsm import progress
from seqrsm.campaign import grounds
from seqrsm.campaign.campaign import _told
from seqrsm.design.constraints import Constraint
from seqrsm.design.factors import ContinuousFactor
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region

Task = dataclasses.make_dataclass("Task", ["utilities", "score"])
FACTORS = tuple(ContinuousFactor(name, -1.0, 1.0) for name in "xyz")


def heard_of(work):
    told = []
    with progress.listening(lambda *what: told.append(what)):
        result = work()
    return result, told


def rising(told, label):
    """(done, total) of a label, never falling and never beyond the total."""
    counts = [(done, total) for what, done, total in told if what == label]
    assert counts
    assert all(0 <= done <= total for done, total in counts)
    assert all(a[0] <= b[0] for a, b in itertools.pairwise(counts))
    return counts


def test_simulations_of_other_grounds_are_counted(monkeypatch):
    """On two million cells they took ten minutes, of which nothing was told."""
    monkeypatch.setattr(grounds, "carry_out", lambda task: SimpleNamespace(scores=[SimpleNamespace(score=task.score)]))
    scores, told = heard_of(lambda: grounds.scores_of([Task((), 3.0), Task((), 4.0)], "crops"))
    assert scores.tolist() == [3.0, 4.0]
    assert told == [("simulating other grounds", 1, 2), ("simulating other grounds", 2, 2)]


@pytest.mark.parametrize("constraints", [(), (Constraint("x + y <= 0.5"),)])
def test_a_search_tells_its_count_and_finds_the_same_design(constraints):
    region, model = Region(FACTORS, constraints), QuadraticModel(FACTORS)

    def work():
        return optimal_design(model, region, 13, seed=3, starts=30)

    silent = work()
    loud, told = heard_of(work)
    np.testing.assert_array_equal(loud.points, silent.points)
    counts = rising(told, "searching the design")
    assert counts[-1][1] == silent.starts


def test_a_sampler_tells_its_steps_and_draws_the_same():
    rng = np.random.default_rng(0)
    Z = np.column_stack([np.ones(20), rng.uniform(-1, 1, (20, 2))])
    y = Z @ [60.0, 2.0, -1.0] + rng.normal(size=20)
    silent = sample_posterior(Z, y, seed=1)
    loud, told = heard_of(lambda: sample_posterior(Z, y, seed=1))
    np.testing.assert_array_equal(loud.draws, silent.draws)
    assert rising(told, "sampling the posterior")[-1][0] <= silent.steps


def test_nobody_hears_outside_and_inside_a_silence():
    told = []
    progress.tell("a", 1, 2)
    with progress.listening(lambda *what: told.append(what)):
        progress.tell("b", 1, 2)
        with progress.listening(None):
            progress.tell("c", 1, 2)
        progress.tell("d", 2, 2)
    assert told == [("b", 1, 2), ("d", 2, 2)]


def test_runs_done_one_at_a_time_are_told_of_all_and_never_more_than_there_are():
    """Three of five are done when the next is; one that the machine failed comes again, beyond the two issued."""
    heard = []
    for before, n, done, more in ((3, 5, 1, 1), (2, 2, 1, 1), (0, 5, 2, 5)):
        _told(lambda *told: heard.append(told), before, n, done, more)
    assert heard == [(4, 5), (3, 3), (2, 5)]
