"""Runs in the slices of a report: what is moved along the surface, and what the constraints leave out."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure
from process_cases import hill, spread
from scored_campaigns import analysed, numeric, specification

from seqrsm.report.figures.optimum import paint_slice, slice_data
from seqrsm.report.figures.surfaces import line

POINTS = np.round(spread(24, 2), 3)


def scores(points: np.ndarray) -> np.ndarray:
    return hill(points) + np.random.default_rng(9).normal(size=len(points))


def test_a_run_made_on_a_slice_stands_at_its_own_score(tmp_path) -> None:
    """Also where the surface is hardly a quadratic: the quadratic's residual put runs beside the line."""
    points = np.linspace(-1.0, 1.0, 24)[:, None]
    found = analysed(tmp_path / "c", specification(numeric(1)), points, scores(points))
    assert found.fitted.departure.probability > 0.9
    drawn = line(found, 0)
    np.testing.assert_allclose(drawn.run_x, points[:, 0], atol=1e-12)
    np.testing.assert_allclose(drawn.run_score, scores(points), atol=1e-9)


def test_a_run_that_the_slice_excludes_is_left_out(tmp_path) -> None:
    """As its caption says: there is no surface that the run could be held against."""
    inside = POINTS[POINTS.sum(axis=1) <= 0.2]
    text = specification(numeric(2) + '[[constraint]]\nexpr = "x0 + x1 <= 0.2"\n')
    found = analysed(tmp_path / "c", text, inside, scores(inside))
    other = found.optimum.point[1]
    allowed = inside[:, 0] + other <= 0.2
    assert 0 < allowed.sum() < len(inside)
    drawn = line(found, 0)
    np.testing.assert_array_equal(drawn.run_ids, found.data.run_ids[allowed])
    assert drawn.run_x == pytest.approx(inside[allowed, 0])
    rows = [row for row in slice_data(found, drawn).rows if row[0].startswith("run")]
    assert [row[-1] for row in rows] == drawn.run_ids.tolist()
    axes = Figure().subplots()
    paint_slice(found, drawn, (40.0, 90.0), axes)
    assert len(axes.collections[-1].get_offsets()) == allowed.sum()


def test_runs_of_other_sources_and_blocks_are_moved_by_what_these_add(tmp_path) -> None:
    """To the flight's surface, and to the average block; what the quadratic took for them was off by several points."""
    points = np.linspace(-1.0, 1.0, 30)[:, None]
    flights = np.arange(30) % 4 == 0
    given = scores(points) + 6.0 * flights
    source = ["flight" if one else "simulation" for one in flights]
    drawn = line(analysed(tmp_path / "sources", specification(numeric(1)), points, given, source=source), 0)
    np.testing.assert_allclose(drawn.run_score[flights], given[flights], atol=1e-9)
    assert np.mean(drawn.run_score[~flights] - given[~flights]) == pytest.approx(6.0, abs=1.5)
    mixed = np.random.default_rng(4).permutation(points)
    for effect in ("fixed", "random"):
        days, added = np.repeat(["a", "b", "c"], 10), np.repeat([0.0, 4.0, -4.0], 10)
        text = specification(numeric(1), rest=f'[model]\nblock = "block"\nblock_effect = "{effect}"\n')
        found = analysed(tmp_path / effect, text, mixed, scores(mixed) + added, block=days.tolist())
        assert found.fitted.departure.probability > 0.9
        off = line(found, 0).run_score - scores(mixed)
        np.testing.assert_allclose([off[days == day].mean() for day in "abc"], 0.0, atol=1.5)
