"""The largest box without a run: against boxes known beforehand, and against random ones."""

from __future__ import annotations

import numpy as np
import pytest
from scored_campaigns import campaign, specification

from seqrsm.analysis.gap import largest_gap
from seqrsm.analysis.to_json import analysis_to_json
from seqrsm.design.constraints import Constraint
from seqrsm.design.factors import CategoricalFactor, ContinuousFactor, DiscreteFactor
from seqrsm.design.region import Region
from seqrsm.report.blocks import Paragraph
from seqrsm.report.sections.optimum import optimum_section


def region(*factors, constraints=()) -> Region:
    return Region(factors, constraints)


def test_corners_and_centre_leave_boxes_of_half_the_range():
    found = largest_gap(
        region(ContinuousFactor("a", 0.0, 10.0, "m"), ContinuousFactor("b", 1.0, 100.0, "GHz", scale="log")),
        np.array([[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0], [0.0, 0.0]]),
    )
    assert found.share == pytest.approx(0.5, abs=0.003)
    (low, high), (first, last) = found.ranges["a"], found.ranges["b"]
    assert high - low == pytest.approx(5.0, abs=0.03)
    assert last / first == pytest.approx(10.0, rel=0.02)  # half of two decades


def test_the_largest_interval_between_neighbours_in_one_factor():
    found = largest_gap(region(ContinuousFactor("a", -1.0, 1.0)), np.array([[-1.0], [-0.7], [0.3], [1.0], [0.3]]))
    assert found.share == pytest.approx(0.5, abs=0.002)
    assert found.ranges["a"] == pytest.approx((-0.7, 0.3), abs=0.005)
    found = largest_gap(region(ContinuousFactor("a", -1.0, 1.0)), np.array([[-0.5], [0.3], [1.0]]))
    assert found.ranges["a"] == pytest.approx((-0.5, 0.3), abs=0.005)


@pytest.mark.parametrize("k", [2, 3, 4])
def test_no_run_is_inside_and_no_random_box_is_much_larger(k):
    rng = np.random.default_rng(k)
    runs = rng.uniform(-1.0, 1.0, (40, k))
    where = region(*(ContinuousFactor(f"x{j}", -1.0, 1.0) for j in range(k)))
    found = largest_gap(where, runs)
    ends = np.array(list(found.ranges.values())).T
    assert not np.any(np.all((runs > ends[0] + 1e-9) & (runs < ends[1] - 1e-9), axis=1))
    assert ends[1] - ends[0] == pytest.approx(2.0 * found.share * np.ones(k))
    centres = rng.uniform(-1.0, 1.0, (100_000, k))
    nearest = np.min([np.max(np.abs(centres - run), axis=1) for run in runs], axis=0)
    assert found.share > np.max(np.minimum(nearest, 1.0 - np.max(np.abs(centres), axis=1))) - 0.005


def test_levels_within_the_box_are_named_and_those_of_categories_do_not_count():
    where = region(
        ContinuousFactor("a", 0.0, 1.0),
        DiscreteFactor("looks", (1.0, 2.0, 3.0, 4.0, 5.0)),
        CategoricalFactor("polarization", ("HH", "VV")),
    )
    at = [[a, looks, level] for a in (-1.0, 0.0, 1.0) for looks in (-1.0, 1.0) for level in (0.0, 1.0)]
    found = largest_gap(where, np.array(at))
    assert set(found.ranges) == {"a", "looks"}
    assert found.ranges["a"] == pytest.approx((0.0, 1.0), abs=0.01)
    assert found.ranges["looks"] == (2.0, 4.0)  # runs have 1 and 5


def test_centres_keep_the_constraints():
    where = region(
        ContinuousFactor("a", -1.0, 1.0), ContinuousFactor("b", -1.0, 1.0), constraints=(Constraint("a + b <= -0.5"),)
    )
    found = largest_gap(where, np.array([[-1.0, -1.0]]))
    middle = [0.5 * (low + high) for low, high in found.ranges.values()]
    assert sum(middle) <= -0.5 + 1e-6
    assert found.share == pytest.approx(0.75, abs=0.005)  # about (-0.25, -0.25)


def test_levels_alone_have_no_box():
    assert largest_gap(region(DiscreteFactor("looks", (1.0, 2.0, 4.0))), np.array([[-1.0], [1.0]])) is None


def test_report_and_json_tell_it_with_units(tmp_path) -> None:
    """Corners, middles of the edges and the centre: every box without a run has half of each range."""
    factors = '[[factor]]\nname = "x"\nunit = "m"\nlow = 0.0\nhigh = 10.0\n'
    factors += '[[factor]]\nname = "y"\nlow = 0.0\nhigh = 2.0\n'
    points = np.array([[a, b] for a in (-1.0, 0.0, 1.0) for b in (-1.0, 0.0, 1.0)] * 2)
    scores = 50.0 - points[:, 0] ** 2 + np.random.default_rng(1).normal(size=18)
    made = campaign(tmp_path / "c", specification(factors), points, scores)
    (analysis,) = made.analyse_all(thorough=True)
    told = analysis_to_json(analysis)["largest_gap"]
    assert told["share"] == pytest.approx(0.5, abs=0.01)
    assert np.ptp(told["ranges"]["x"]) == pytest.approx(5.0, abs=0.1)
    blocks = optimum_section(analysis, "score", made.spec.stop).blocks
    (text,) = [one.text for one in blocks if isinstance(one, Paragraph) and "without a run" in one.text]
    text = text.replace("\u00a0", " ")
    assert "50 % of each continuous factor's coded range: x " in text
    assert " m and y " in text
    assert "largest_gap" not in analysis_to_json(made.analyse_all()[0])
