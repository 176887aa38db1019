"""Numbers and rows in sentences."""

from __future__ import annotations

import pytest

from seqrsm.plain import counted, few, more_rows


@pytest.mark.parametrize(("n", "ends"), [(1, "1"), (10, ", 10"), (11, ", 10, ...")])
def test_ten_numbers_are_told_and_more_are_hinted_at(n: int, ends: str) -> None:
    assert few(range(1, n + 1)).endswith(ends)


def test_further_rows_are_counted_and_told_by_their_lines() -> None:
    assert [more_rows(lines) for lines in ((), (4,), (4, 7))] == [
        "", " (so 1 more row: line 4)", " (so 2 more rows: lines 4, 7)",
    ]  # fmt: skip
    assert [counted(n, "cover") for n in (0, 1, 2)] == ["0 covers", "1 cover", "2 covers"]
    assert counted(3, "run has", "runs have") == "3 runs have"
