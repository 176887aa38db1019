"""What a report says of errors that are not normal, and of surfaces with few runs a term, against what is computed."""

from __future__ import annotations

import numpy as np
import pytest
from process_cases import bowl, spread
from scored_campaigns import analysed, campaign, numeric, specification

from seqrsm.analysis.results import Analysis
from seqrsm.report.blocks import Details, Equation, Table
from seqrsm.report.sections.model import diagnostics_section, importance_section, model_section
from seqrsm.report.sections.shape import shape_section

POINTS = np.round(spread(40, 2), 3)
NOISE = np.random.default_rng(9).standard_t(4.0, 40)
DAYS = [f"day {i}" for i in range(8)] * 5
SCORES = bowl(POINTS) + NOISE + np.tile(3.0 * np.linspace(-1.5, 1.5, 8), 5)


def made_of(place, rest: str, **more):
    return campaign(place / "c", specification(numeric(2), rest=f"[model]\n{rest}\n"), POINTS, SCORES, **more)


def of(place, rest: str, **more) -> Analysis:
    return made_of(place, rest, **more).analyse_all(n_draws=400, thorough=True)[0]


@pytest.fixture(scope="module")
def student(tmp_path_factory) -> Analysis:
    days = 'errors = "student_t"\nblock = "day"'
    return of(tmp_path_factory.mktemp("student"), days, source="flight", block=DAYS)


@pytest.fixture(scope="module")
def normal(tmp_path_factory) -> Analysis:
    return of(tmp_path_factory.mktemp("normal"), 'block = "day"', source="flight", block=DAYS)


def equations(section) -> list[str]:
    return [block.math for block in section.blocks if isinstance(block, Equation)]


def values(section, caption: str) -> dict[str, list]:
    (found,) = [b for b in section.blocks if isinstance(b, Table) and b.caption.startswith(caption)]
    return {row[0].text: [cell.value for cell in row[1:]] for row in found.rows}


def test_the_equation_of_the_model_has_the_errors_that_were_taken(student, normal, tmp_path):
    (math,) = equations(model_section(normal, "x"))
    assert '"N"(0, sigma^2)' in math
    (math,) = equations(model_section(student, "x"))
    assert "sigma t_4" in math
    assert '"N"' not in math
    for errors, law in (("normal", '"N"(0, sigma^2 \\/ w)'), ("student_t", "sigma \\/ sqrt(w) dot t_4")):
        weighted = of(tmp_path / errors, f'errors = "{errors}"\nweights = "se"', se=np.linspace(1.0, 3.0, 40))
        (math,) = equations(model_section(weighted, "x"))
        assert math.endswith(f"epsilon tilde {law}")


def test_no_equation_is_printed_for_an_interval_that_does_not_follow_it(student, normal, tmp_path):
    assert len(equations(shape_section(normal, "x"))) == 1
    random = of(tmp_path, 'block = "day"\nblock_effect = "random"', source="flight", block=DAYS)
    for one, told in ((student, "Student-t with 4 degrees of freedom"), (random, "effect of a new block")):
        section = shape_section(one, "x")
        assert equations(section) == []
        assert told in str(section.blocks[0])


def test_f_and_standard_errors_are_said_to_allow_for_weights_from_the_scores(student, normal):
    """F of Student-t errors is not the ratio of the mean squares in its table."""
    for analysis, factor in ((student, 1.4), (normal, 1.0)):
        section = model_section(analysis, "x")
        rows = values(section, "Sequential")
        (_, _, ms, f, _), (*_, ms_residual, _, _) = rows["squares"], rows["residual"]
        assert f == pytest.approx(ms / ms_residual / factor)
        root = np.sqrt(analysis.fit.weights)[:, None]
        unscaled = np.linalg.inv((analysis.fit.Z * root).T @ (analysis.fit.Z * root))
        assert analysis.fit.se**2 == pytest.approx(factor * analysis.fit.s**2 * np.diag(unscaled))
        for told in (str(section), str(importance_section(analysis, "x"))):
            assert ("1.4 times" in told) == (factor > 1.0)
        first = importance_section(analysis, "x").blocks[0]
        assert first.text == "" or first.text.endswith(". ")  # what follows is the method


def test_the_scale_of_student_errors_is_not_called_their_standard_deviation(student, normal, tmp_path):
    """With 4 degrees of freedom it is the scale times the root of 2."""
    rows = values(model_section(student, "x"), "Quality")
    (scale,), (sd,) = rows["Residual scale s"], rows["Standard deviation of a run"]
    assert sd == pytest.approx(np.sqrt(2.0) * scale)
    assert "Residual standard deviation s" not in rows
    rows = values(model_section(normal, "x"), "Quality")
    assert rows["Residual standard deviation s"] == [normal.fit.s]
    assert "Standard deviation of a run" not in rows
    assert student.blocks.sigma == pytest.approx(np.sqrt(2.0) * student.fit.s, rel=0.1)
    # Both parts of the ratio are standard deviations.
    days = student.fitted.surface.days(made_of(tmp_path, 'errors = "student_t"\nblock = "day"').spec)
    assert student.blocks.sigma_block == days.sigma_day
    assert student.blocks.ratio == pytest.approx(np.array(days.sigma_ratio_interval(0.95)) / np.sqrt(2.0))


def test_repeats_that_agree_are_not_called_wild(tmp_path):
    """Two runs on a step lie far off the quadratic, and are right."""
    points = np.repeat(np.linspace(-1.0, 1.0, 12), 2)[:, None]
    scores = np.where(points[:, 0] > 0.95, -20.0, 0.0) + 0.3 * np.random.default_rng(2).normal(size=24)
    found = analysed(tmp_path / "c", specification(numeric(1), rest='[model]\nerrors = "student_t"\n'), points, scores)
    told = str(diagnostics_section(found, "x"))
    assert "Far off the quadratic, and counted for less than a quarter of a score on it: runs 23 and 24." in told
    assert "Wild" not in told


def test_an_alternative_that_is_likelier_is_not_said_to_refute_a_quadratic(tmp_path):
    """Every function of two categories is in the model: an alternative of shrunk coefficients is no other surface."""
    factors = (
        '[[factor]]\nname = "p"\nlevels = ["a", "b", "c", "d"]\n[[factor]]\nname = "q"\nlevels = ["e", "f", "g"]\n'
    )
    points = np.array([(i, j) for i in range(4) for j in range(3)] * 3, dtype=float)
    scores = points @ [2.0, 1.0] + np.random.default_rng(1).normal(size=36)
    found = analysed(tmp_path / "c", specification(factors), points, scores)
    assert found.fitted.departure.probability > 0.0
    told = " ".join(map(str, shape_section(found, "x").blocks))
    assert "not quadratic" not in told
    assert "a Gaussian process about a quadratic of shrunk coefficients" in told


def test_curvatures_and_intervals_of_weighted_logits_have_their_unit_and_weight(tmp_path):
    text = specification(numeric(2), rest='[model]\nresponse = "logit"\n').replace('"measured"', '"percent_correct"')
    scores = 100.0 / (1.0 + np.exp(-(2.0 - np.sum(np.square(POINTS), axis=1) + 0.2 * NOISE)))
    (found,) = campaign(tmp_path / "c", text, POINTS, scores).analyse_all(n_draws=400)
    section = shape_section(found, "x")
    (canonical,) = [b.blocks[0] for b in section.blocks if isinstance(b, Details)]
    assert canonical.columns[0].unit == "logit"
    (math,) = equations(section)
    assert "sqrt(1 \\/ w_0 + z_0^top (Z^top W Z)^(-1) z_0)" in math


def test_no_quadratic_is_named_where_the_model_is_of_first_order(tmp_path):
    plane = of(tmp_path, 'order = 1\nblock = "day"', source="flight", block=DAYS)
    told = " ".join([str(section) for section in (shape_section(plane, "x"), model_section(plane, "x"))])
    assert "a Gaussian process about a first-order model of shrunk coefficients" in told
    assert "by the first-order model, not corrected" in told
    assert "quadratic" not in told


@pytest.mark.parametrize(("order", "curvature", "told"), [(1, 6.0, True), (1, 0.0, False), (2, 6.0, False)])
def test_a_plane_that_leaves_curvature_is_told_to_become_a_quadratic(tmp_path, order, curvature, told):
    """Three runs at each of nine settings, which tell scatter from what the model leaves."""
    points = np.array([(i, j) for i in (-1.0, 0.0, 1.0) for j in (-1.0, 0.0, 1.0)] * 3)
    left = np.square(points[:, 0] * points[:, 1] ** (order - 1))  # what neither has a term for
    scores = 50.0 + points @ [4.0, 2.0] - curvature * left + np.random.default_rng(2).normal(size=27)
    text = specification(numeric(2), rest=f"[model]\norder = {order}\n")
    (found,) = campaign(tmp_path / "c", text, points, scores).analyse_all(n_draws=400)
    assert (found.fit.lack_of_fit().p < 0.05) == (curvature > 0.0)
    assert len([warning for warning in found.warnings if "[model] order = 2" in warning]) == told
