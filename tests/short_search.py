"""Optimal designs by fewer local searches than a campaign's, where a test is not about the best design of all."""

from __future__ import annotations

from typing import Any

import pytest

from seqrsm.design import optimal


def optimal_design(*of: Any, starts: int | None = None, **options: Any) -> optimal.Design:
    with pytest.MonkeyPatch.context() as patch:
        if starts is not None:
            patch.setattr(optimal, "SEARCHES", starts)
            patch.setattr(optimal, "MANY_SEARCHES", starts)
        return optimal.optimal_design(*of, **options)
