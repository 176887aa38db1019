"""The table of utilities against the engines that score by it and the specification that reads it."""

from __future__ import annotations

import pytest

from seqrsm.campaign.engines import ENGINES
from seqrsm.score.utilities import UTILITIES, of_images
from seqrsm.spec.tables import ApplicationSpec


@pytest.mark.parametrize("engine", ENGINES)
def test_engines_score_by_the_functions_that_the_rows_name(engine: str) -> None:
    assert ENGINES[engine].utilities == of_images(engine)
    for name, function in of_images(engine).items():
        assert function.__module__.startswith("seqrsm.score."), name


def test_every_row_names_engines_that_are() -> None:
    for row in UTILITIES.values():
        assert set(row.of_image) <= set(ENGINES)


@pytest.mark.parametrize("name", [*UTILITIES, "mine:worth"])
def test_the_specification_knows_goal_and_unit_by_the_row(name: str) -> None:
    application = ApplicationSpec.model_validate({"name": "a", "utility": name})
    is_error = name == "retrieval_error"
    assert (application.is_error, application.goal) == (is_error, "minimize" if is_error else "maximize")
    assert application.is_percent == (name == "percent_correct")
    assert application.unit == ("percent" if name in ("percent_correct", "retrieval_error") else "")
