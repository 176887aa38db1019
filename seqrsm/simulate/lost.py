"""What stands for the result of a run that could not be carried out."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Lost:
    """Takes the place of a result: the processes that ran this argument died, again and again."""

    reason: str
