"""An interval in score units."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Interval:
    """A two-sided interval in score units."""

    low: float
    high: float

    @property
    def half_width(self) -> float:
        """Half of ``high - low``."""
        return 0.5 * (self.high - self.low)

    def around(self, other: Interval) -> Interval:
        """The smallest interval that holds both."""
        return Interval(min(self.low, other.low), max(self.high, other.high))
