"""Exceptions of seqrsm, each named for its meaning.

::

    SeqrsmError
    ├── UserError                  the user can mend it; exit code 2
    │   ├── SpecError              campaign.toml
    │   ├── ScoresFileError        a file of measured scores
    │   ├── SceneError             a ground-truth data base
    │   ├── ScatteringDataError    a sigma0 or emissivity table
    │   ├── ConfigurationError     a sensor that cannot be built or flown
    │   ├── RegionError            factors and constraints
    │   ├── DesignError            a design that cannot be made
    │   ├── FitError               too few or unusable scores
    │   └── StoreError             the campaign's data base
    ├── OvertakenError             another process decided meanwhile; look again
    └── ConvergenceError           the sampler did not reach its rule
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Problem:
    """One thing that is wrong, where it stands, and what would be right."""

    message: str
    """What is wrong, in a sentence without the place and the remedy."""
    remedy: str = ""
    """What would be right."""
    file: str | None = None
    line: int | None = None
    field: str | None = None
    value: object | None = None
    """The place: file name, 1-based line, key or column, and the offending value as it was read."""

    def __str__(self) -> str:
        place = self.file or ""
        if self.line is not None:
            place += f":{self.line}" if place else f"line {self.line}"
        parts = [place] if place else []
        if self.field is not None:
            parts.append(self.field)
        text = ": ".join([*parts, self.message])
        if self.value is not None:
            value = list(self.value) if isinstance(self.value, tuple) else self.value
            text += f" (got {value!r})"
        return f"{text.rstrip('.')}. {self.remedy}" if self.remedy else text


class SeqrsmError(Exception):
    """Base of every exception that seqrsm raises on purpose."""


class UserError(SeqrsmError):
    """Something the user can mend; nothing was changed. The command line exits with 2.

    Parameters
    ----------
    *told : str or Problem
        Message and remedy of one `Problem`, whose place follows; or all problems, not only the first.
    file, line, field, value : optional
        As of `Problem`.
    """

    def __init__(
        self,
        *told: str | Problem,
        file: str | None = None,
        line: int | None = None,
        field: str | None = None,
        value: object | None = None,
    ) -> None:
        words = [one for one in told if isinstance(one, str)]
        self.problems: Sequence[Problem] = tuple(one for one in told if isinstance(one, Problem))
        if words:
            message, remedy = words if len(words) > 1 else (*words, "")
            self.problems = (Problem(message, remedy, file, line, field, value), *self.problems)
        super().__init__("\n".join(str(problem) for problem in self.problems))


class SpecError(UserError):
    """``campaign.toml`` is wrong."""


class ScoresFileError(UserError):
    """A file of measured scores is wrong."""


class SceneError(UserError):
    """A ground-truth data base is wrong."""


class ScatteringDataError(UserError):
    """A sigma0 or emissivity table is wrong or lacks what was asked of it."""


class ConfigurationError(UserError):
    """The sensor's parameters contradict each other or physics."""


class RegionError(UserError):
    """Factors or constraints do not describe a region."""


class DesignError(UserError):
    """The design asked for cannot be made."""


class FitError(UserError):
    """The scores do not allow the fit asked for."""


class StoreError(UserError):
    """The campaign's data base cannot be used."""


class OvertakenError(SeqrsmError):
    """What was to be written rests on a state of the campaign that another process has changed; nothing was written."""


class ConvergenceError(SeqrsmError):
    """The sampler ended before its convergence rule held; the message tells what was reached."""
