"""The utilities that ship, a row each: what specification, engines and pages know of them is read here.

A further one is a module of this package and a row here. Functions are named and not imported, since they load the
engines, which the specification does without.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from seqrsm.own_code import own_function


@dataclass(frozen=True, slots=True)
class Utility:
    """What a score measures.

    Attributes
    ----------
    unit : str
        Of the scores; "" where the utility tells none.
    is_percent : bool
        Scores are percentages from 0 to 100.
    is_error : bool
        Scores are errors, which are made small.
    of_image : Mapping
        "module:function" by engine; none of what is measured only.
    of_set : str
        "module:function" of several images together; "" where the utility scores one alone.
    """

    unit: str = ""
    is_percent: bool = False
    is_error: bool = False
    of_image: Mapping[str, str] = field(default_factory=dict)
    of_set: str = ""


UTILITIES: Final[Mapping[str, Utility]] = {
    "percent_correct": Utility(
        "percent",
        is_percent=True,
        of_image={
            "psm": "seqrsm.score.classification:percent_correct",
            "prm": "seqrsm.score.retrieval:percent_correct_radiometer",
        },
        of_set="seqrsm.score.fusion:percent_correct_of_set",
    ),
    "retrieval_error": Utility(
        "percent",
        is_error=True,
        of_image={"prm": "seqrsm.score.retrieval:soil_moisture_error"},
    ),
    "correlation": Utility(),
    "rank": Utility(),
    "measured": Utility(),
}
"""By the names of ``campaign.toml``."""

OF_THE_USER: Final = Utility()
"""What is known of a function of the user's own."""


def of_images(engine: str) -> dict[str, Callable[..., Any]]:
    """Functions that score an image of an engine, by utility."""
    return {name: own_function(row.of_image[engine]) for name, row in UTILITIES.items() if engine in row.of_image}
