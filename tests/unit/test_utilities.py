"""The table of utilities against the functions that it names and the specification that reads it."""

from __future__ import annotations

import math
import re

import pytest
from pydantic import ValidationError

from seqrsm.campaign.engines import check_utility
from seqrsm.errors import SpecError
from seqrsm.own_code import own_function
from seqrsm.score.cover import ends_of
from seqrsm.score.utilities import UTILITIES, Asked, asked_for
from seqrsm.spec.tables import ApplicationSpec

SCORED = [name for name, row in UTILITIES.items() if row.function]


@pytest.mark.parametrize("name", SCORED)
def test_every_row_names_a_function_and_engines_that_are(name: str) -> None:
    row = UTILITIES[name]
    assert callable(own_function(row.function))
    if row.classifies:
        ends_of(__import__("numpy").array([3, 1]), name, [0])


@pytest.mark.parametrize("name", [*UTILITIES, "mine:worth"])
def test_the_specification_knows_goal_and_unit_by_the_row(name: str) -> None:
    covers = " of Corn" if name in UTILITIES and UTILITIES[name].of_covers else ""
    application = ApplicationSpec.model_validate({"name": "a", "utility": name + covers})
    is_error = name in ("soil_moisture_error", "area_error")
    assert (application.is_error, application.goal) == (is_error, "minimize" if is_error else "maximize")
    bounded = ("percent_correct", "class_mean_correct", "worst_class_correct", "f1", "detection")
    assert application.is_percent == (name in bounded)
    assert (application.score_unit == "percent") == (name in (*bounded, "area_error"))
    ends = dict.fromkeys(bounded, (0.0, 100.0)) | dict.fromkeys(("kappa", "correlation"), (-1.0, 1.0))
    ends |= {"soil_moisture_skill": (-math.inf, 1.0)} | dict.fromkeys(
        ("soil_moisture_error", "area_error"), (0.0, math.inf)
    )
    assert application.score_limits == ends.get(name, (-math.inf, math.inf))


def test_a_utility_is_asked_for_in_words() -> None:
    assert asked_for("percent_correct") == Asked("percent_correct", (), "pixel")
    assert asked_for("f1 of Wheat, Corn by field") == Asked("f1", ("Wheat", "Corn"), "field")


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("percent_corect", 'did you mean "percent_correct"'),
        ("joy", "your own function"),
        ("f1", "applies to named covers"),
        ("kappa of Corn", "applies to all covers"),
        ("percent_correct by parcel", "pixel, neighbourhood, segment, field"),
        ("soil_moisture_skill by field", "does not classify"),
    ],
)
def test_what_is_wrong_with_the_words_is_told(text: str, told: str) -> None:
    with pytest.raises(ValueError, match=re.escape(told)):
        asked_for(text)
    with pytest.raises(ValidationError, match=re.escape(told)):
        ApplicationSpec.model_validate({"name": "a", "utility": text})


def test_a_utility_that_the_images_cannot_be_scored_by_is_refused() -> None:
    with pytest.raises(SpecError, match="images cannot be scored"):
        check_utility("measured")
    for name in SCORED:
        covers = " of Corn" if UTILITIES[name].of_covers else ""
        check_utility(name + covers)
