"""What a report says of the quadratic, and of what is not the quadratic's, against the numbers beside it."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from process_cases import bowl, hill, spread
from scored_campaigns import analysed, numeric, specification

from seqrsm.campaign.dossier import _measured_assumptions
from seqrsm.fit.error_models import NORMAL
from seqrsm.report.blocks import Table
from seqrsm.report.sections.model import model_section
from seqrsm.report.sections.shape import shape_section
from seqrsm.spec.tables import SimulatorSpec


def tables(section) -> list[Table]:
    return [block for block in section.blocks if isinstance(block, Table)]


POINTS = np.round(spread(24, 2), 3)


def of_hill(place, points):
    return analysed(
        place / "c", specification(numeric(2)), points, hill(points) + np.random.default_rng(9).normal(size=24)
    )


@pytest.fixture(scope="module")
def narrow(tmp_path_factory):
    """Of a narrow top, which is hardly a quadratic; no setting is run twice."""
    return of_hill(tmp_path_factory.mktemp("narrow"), POINTS)


@pytest.fixture(scope="module")
def repeated(tmp_path_factory):
    return of_hill(tmp_path_factory.mktemp("repeated"), np.vstack([POINTS[:20], POINTS[:4]]))


def test_a_residual_that_is_not_divided_is_not_said_to_be(narrow, repeated):
    for analysis, divided in ((repeated, True), (narrow, False)):
        (anova,) = [one for one in tables(model_section(analysis, "x")) if one.caption.startswith("Sequential")]
        assert any("pure error" in str(row) for row in anova.rows) == divided
        assert ("divides into" in anova.caption) == divided


def test_what_is_the_quadratics_is_said_to_be(narrow):
    """Its curvatures and residuals were said to be of the fitted surface, which is hardly a quadratic here."""
    assert narrow.fitted.departure.probability > 0.9
    told = str(shape_section(narrow, "x"))
    assert "F tests, effects, residuals and curvatures are the quadratic's" in told
    assert "the quadratic has" in told.lower()
    assert "The fitted surface has" not in told


def test_on_a_ridge_the_settings_told_are_those_of_one_of_its_points(narrow):
    """They were told as the ridge's own, with errors that leave its length out: 7.9 (7.1 to 8.8) of 1 to 50 W."""
    ridge = dataclasses.replace(narrow.stationary, kind="ridge", flat=np.array([False, True]))
    for found, told in ((ridge, "a ridge whose point nearest to the centre lies"), (narrow.stationary, "a maximum")):
        assert f"The quadratic has {told} inside the region at" in str(
            shape_section(dataclasses.replace(narrow, stationary=found), "x")
        )


def test_the_condition_number_is_of_columns_of_unit_length(narrow):
    columns = narrow.fit.Z / np.linalg.norm(narrow.fit.Z, axis=0)
    (quality,) = [one for one in tables(model_section(narrow, "x")) if one.caption == "Quality of the fit"]
    found = {row[0].text: row[1].value for row in quality.rows}
    assert found["Condition number, columns of unit length"] == pytest.approx(np.linalg.cond(columns))


def test_the_surface_assumed_is_the_one_that_was_considered(narrow):
    campaign = SimpleNamespace(spec=SimpleNamespace(
        model=SimpleNamespace(weights="equal", response="identity", order=2), errors=NORMAL,
        simulator=None,
    ))  # fmt: skip
    quadratic = dataclasses.replace(
        narrow.fitted, departure=dataclasses.replace(narrow.fitted.departure, by_scores=0.0)
    )
    for one, process in ((narrow, True), (dataclasses.replace(narrow, fitted=quadratic), False)):
        (told,) = [text for text in _measured_assumptions(campaign, (one,)) if "polynomial" in text]
        assert ("Gaussian process" in told) == process


def test_what_a_run_draws_is_that_of_every_engine_of_a_set_and_the_label_of_a_map(narrow):
    """Beside a radar nothing was said of a radiometer, nor of a map that names most of the fields."""
    simulator = SimulatorSpec(engine="psm", scene="s.npz", members={"passive": {"engine": "prm"}}, known_map="old.csv")
    campaign = SimpleNamespace(spec=SimpleNamespace(
        model=SimpleNamespace(weights="equal", response="identity", order=2), errors=NORMAL,
        simulator=simulator, applications=[
            SimpleNamespace(name="crops", utility="kappa by field"),
            SimpleNamespace(name="finder", utility="detection of Corn"),
        ],
    ))  # fmt: skip
    told = "; ".join(_measured_assumptions(campaign, (narrow,)))
    assert "wind, fading, emissivity, temperature and soil moisture of fields and of the date, receiver noise" in told
    assert "a label of an existing map for each field" in told
    assert "old.csv, independently between fields" in told
    # Beside a map, where the measure counts ground, the classifier knows the areas.
    assert "the classifier of crops knows how common each cover is" in told
    assert "equally probable to the classifier of finder before" in told
    campaign.spec.simulator = SimulatorSpec(engine="prm", scene="s.npz")
    alone = "; ".join(_measured_assumptions(campaign, (narrow,)))
    assert "fading" not in alone
    assert "existing map" not in alone
    assert "equally probable to the classifier before" in alone
    assert "how common each cover" not in alone


def test_a_run_is_unusual_for_the_quadratic_where_there_is_another_surface(tmp_path, request):
    """Leverage, Cook's distance and residual are the quadratic's: what that cannot follow is no fault of the run."""
    scores = bowl(POINTS) + 0.3 * np.random.default_rng(9).normal(size=24)
    scores[7] += 9.0
    one = analysed(tmp_path / "two", specification(numeric(2)), POINTS, scores)
    assert one.fitted.departure.probability > 0.0
    assert [text.partition(":")[0] for text in one.warnings] == ["Run 8 is unusual for the quadratic"]
    request.getfixturevalue("least_squares_alone")
    alone = analysed(tmp_path / "one", specification(numeric(2)), POINTS, scores)
    assert [text for text in alone.warnings if "for the quadratic" in text] == []
