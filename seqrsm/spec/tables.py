"""The tables of ``campaign.toml`` and the types of their keys; :mod:`seqrsm.spec.read` says what each key means."""

from __future__ import annotations

import datetime
import re
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, PrivateAttr, model_validator
from pydantic_core import PydanticCustomError

from seqrsm.fit.error_models import ERROR_MODELS
from seqrsm.fit.optimum import Goal
from seqrsm.score.utilities import OF_THE_USER, UTILITIES, Utility, asked_for, utility_of


def _is_name(text: str) -> str:
    if not re.fullmatch(r"\w(?:[\w .+-]{0,78}[\w.+-])?", text):
        raise PydanticCustomError("name", "a name has 1 to 80 letters, digits and . + - _ or inner blanks")
    return text


def _is_utility(text: str) -> str:
    if not re.fullmatch(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*:[A-Za-z_]\w*", text):
        try:
            asked_for(text)
        except ValueError as error:
            raise PydanticCustomError("utility", "{what}", {"what": str(error)}) from None
    return text


def _is_url(text: str) -> str:
    if not text.startswith(("postgresql+psycopg://", "sqlite:///")):
        raise PydanticCustomError("url", 'an address begins with "postgresql+psycopg://" or "sqlite:///"')
    return text


def _is_no_bool(value: object) -> object:
    if isinstance(value, bool):  # equal to 1 and 0 in Python, not in TOML
        raise PydanticCustomError("order", "the order is 1 or 2")
    return value


def _day(value: object) -> object:
    return value.isoformat() if isinstance(value, datetime.date) else value  # TOML has dates of its own


if TYPE_CHECKING:
    ErrorName = str
else:
    ErrorName = Literal[tuple(ERROR_MODELS)]  # one class there and the file may name it
Order = Annotated[Literal[1, 2], BeforeValidator(_is_no_bool)]
Name = Annotated[str, AfterValidator(_is_name)]
Number = Annotated[float, Field(allow_inf_nan=False)]
Bound = Annotated[float, Field(allow_inf_nan=True)]
PositiveNumber = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]


class Table(BaseModel):
    """A table: exact types, no unknown keys, never changed."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True)


class CampaignTable(Table):
    """``[campaign]``."""

    name: Name
    description: str = ""
    author: str = ""
    date: Annotated[str, BeforeValidator(_day)] = ""
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    batch: Annotated[int, Field(ge=1, le=1000)] = 4


class FactorTable(Table):
    """``[[factor]]`` as written; which keys go together is checked later."""

    name: str
    unit: str = ""
    scale: Literal["linear", "log"] = "linear"
    low: Number | None = None
    high: Number | None = None
    values: list[Number] | None = None
    levels: list[str] | None = None


class ConstraintTable(Table):
    """``[[constraint]]``."""

    expr: str


class ExpectedOptimum(Table):
    """Expected best value of a factor: ``value`` in its unit, ``doubt`` as a fraction of half its range."""

    value: Number
    doubt: PositiveNumber = 0.5


class KnowledgeSpec(Table):
    """``[application.prior]``: prior knowledge of an application, in natural terms."""

    utility: Annotated[list[Number], Field(min_length=2, max_length=2)] | None = None
    probability: Annotated[float, Field(ge=0.5, lt=1.0)] = 0.95
    repeat_sd: PositiveNumber | None = None
    repeat_runs: PositiveNumber = 3.0
    optimum: dict[str, Number | ExpectedOptimum] = Field(default_factory=dict)
    effect: dict[str, Annotated[list[Bound], Field(min_length=2, max_length=2)]] = Field(default_factory=dict)


_OF_ANY_SCALE = (UTILITIES["measured"], OF_THE_USER)


class ApplicationSpec(Table):
    """An application: what the scores measure, and whether they are maximized or minimized."""

    name: Name
    utility: Annotated[str, AfterValidator(_is_utility)]
    goal: Goal = "maximize"
    weight: PositiveNumber = 1.0
    unacceptable: Number | None = None
    ideal: Number | None = None
    half_width: PositiveNumber | None = None
    loss: PositiveNumber | None = None
    sufficient: Number | None = None
    catalog: str = ""
    unit: str = ""
    prior: KnowledgeSpec | None = None

    @model_validator(mode="before")
    @classmethod
    def _errors_are_made_small(cls, data: object) -> object:
        if isinstance(data, dict) and "goal" not in data and utility_of(str(data.get("utility"))).is_error:
            return {**data, "goal": "minimize"}
        return data

    _row: Utility = PrivateAttr()

    def model_post_init(self, context: object) -> None:
        """Look the utility up once: a look at the scores asks again and again."""
        del context
        self._row = utility_of(self.utility)

    def on_logit_scale(self) -> None:
        """Scores end at 0 and 100, also where the utility does not say so."""
        self._row = replace(self._row, least=0.0, most=100.0)

    @property
    def is_error(self) -> bool:
        """Whether scores are errors, which are made small."""
        return self._row.is_error

    @property
    def is_percent(self) -> bool:
        """Whether scores are percentages from 0 to 100."""
        return self._row.is_percent

    @property
    def may_be_percent(self) -> bool:
        """Whether scores may be percentages: they are, or neither utility nor unit says what else."""
        return self.is_percent or (self.score_unit in ("", "percent", "%") and self._row in _OF_ANY_SCALE)

    @property
    def score_limits(self) -> tuple[float, float]:
        """Least and largest score that there can be; infinite where the utility has no such ends."""
        return self._row.least, self._row.most

    @property
    def score_unit(self) -> str:
        """Unit of the scores; "" where they have none."""
        return self._row.unit or self.unit

    @property
    def has_known_unit(self) -> bool:
        """Whether the scores' unit is told, or known to be none."""
        return bool(self.score_unit or self._row.function)


class ConsiderationSpec(Table):
    """Another objective of a compromise: an exactly known function of the settings."""

    name: Name
    expr: str
    unit: str = ""
    goal: Goal = "minimize"
    weight: PositiveNumber = 1.0
    unacceptable: Number | None = None
    ideal: Number | None = None


class CandidateSpec(Table):
    """``[[candidate]]``: a sensor to compare with the optimum."""

    sensor: str = ""
    name: str = ""
    polarization: str = ""
    parameters: dict[str, Number | str] = Field(default_factory=dict)


class ModelSpec(Table):
    """The response surface."""

    order: Order = 2
    response: Literal["identity", "logit"] = "identity"
    errors: ErrorName = "normal"
    weights: Literal["equal", "se", "counts"] = "equal"
    block: str | None = None
    block_effect: Literal["fixed", "random"] = "fixed"
    discrepancy_sd: PositiveNumber | None = None


class SimulatorSpec(Table):
    """The engine, its files (paths from the campaign's folder), tolerance in score units, fixed parameters."""

    engine: Literal["psm", "prm"]
    scene: Annotated[str, Field(min_length=1)]
    table: str = ""
    calendar: str = ""
    calendar_shift_days: Annotated[int, Field(ge=-364, le=364)] = 0
    known_map: str = ""
    tolerance: NotNegative = 0.0
    fixed: dict[str, Number | str] = Field(default_factory=dict)
    members: dict[str, dict[str, Number | str]] = Field(default_factory=dict)


class CostSpec(Table):
    """Cost of one run from each source, in one ``unit`` of the user's choice."""

    unit: str = ""
    simulation: NotNegative = 1.0
    flight: NotNegative = 1.0

    @property
    def told_unit(self) -> str:
        """Unit wherever a cost is told; "" where nothing is stated: a run is the unit then, and costs are not told."""
        return self.unit or ("" if self.simulation == self.flight == 1.0 else "units")

    def of(self, source: str) -> float:
        """Of one run from this source: a measurement that is no simulation counts as a flight."""
        return self.simulation if source == "simulation" else self.flight

    def compared(self, source: str) -> float:
        """Of one run, by which its gain is divided: nothing counts as a thousandth of the dearer source."""
        return self.of(source) or 1e-3 * max(self.simulation, self.flight) or 1.0


class StopSpec(Table):
    """When the campaign stops."""

    half_width: PositiveNumber
    loss: PositiveNumber | None = None
    interval: Literal["prediction", "prediction_mean", "confidence"] = "prediction"
    replicates: Annotated[int, Field(ge=2)] = 5
    level: Annotated[float, Field(ge=0.5, le=0.9999)] = 0.95
    max_runs: Annotated[int, Field(ge=1)] = 80
    guard: Literal["runs", "confirmation"] = "runs"
    confirmation_runs: Annotated[int, Field(ge=2)] = 5
    worlds: Literal["count", "ignore"] = "count"


class StoreTable(Table):
    """``[store]``."""

    url: Annotated[str, AfterValidator(_is_url)] | None = None
