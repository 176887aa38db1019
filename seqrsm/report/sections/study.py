"""What a thorough analysis adds: blocks, and tests asked for."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from seqrsm.analysis.results import Analysis, BlockResponse, BlockStudy
from seqrsm.analysis.study import TermTest
from seqrsm.report.blocks import Block, Details, Paragraph, Table, right, table
from seqrsm.report.rounding import format_significant
from seqrsm.report.wording import (
    capital,
    interval_text,
    level_phrase,
    p_cell,
    readable_term,
    score_text,
    significant_cell,
    whole_cell,
)


def by_block(analysis: Analysis) -> list[Block]:
    """How blocks differ, and what a new one would give, folded away; empty without a study, or without blocks."""
    found = None if analysis.study is None else analysis.study.blocks
    if found is None:
        return []
    blocks: list[Block] = [Paragraph(_block_text(found))]
    if isinstance(found.new, BlockResponse):
        level, new = level_phrase(analysis), found.new
        ends = (interval_text(analysis, new.confidence), interval_text(analysis, new.prediction))
        columns = ("Mean", f"{level} confidence", f"{level} prediction, one run")
        title = "The recommended settings in a new block"
        blocks.insert(0, table(title, columns, [(score_text(analysis, new.mean), *ends)]))
    return [Details("Differences between blocks", tuple(blocks))]


def _block_text(found: BlockStudy) -> str:
    """How much blocks differ."""
    if isinstance(found.new, str):
        return f"Differences between blocks cannot be estimated: {found.new}."
    ratio = " to ".join(format_significant(end, 2) for end in found.ratio)
    text = (
        f"Blocks are {found.effect} effects. Standard deviation of a run {format_significant(found.sigma, 3)}, of the "
        f"blocks {format_significant(found.sigma_block, 3)} (restricted maximum likelihood, on the scale of the fit); "
        f"credible interval of their ratio {ratio}. A run in a new block includes that block's effect."
    )
    return f"{text} {capital(found.note)}." if found.note else text


def largest_vif(analysis: Analysis) -> tuple[str, float] | None:
    """Term of the largest variance inflation factor, and that factor; None where there is none."""
    vif = analysis.fit.vif()
    known = [i for i in range(len(vif)) if np.isfinite(vif[i]) and analysis.fit.kinds[i] != "block"]
    if not known:
        return None
    worst = max(known, key=lambda i: float(vif[i]))
    return readable_term(analysis.fit.names[worst]), float(vif[worst])


def term_test_table(tests: Sequence[TermTest]) -> Table:
    """Partial F tests that were asked for."""
    rows = (
        (
            one.asked,
            whole_cell(one.test.df),
            significant_cell(one.test.ss, 4),
            significant_cell(one.test.f, 4) if math.isfinite(one.test.f) else one.test.reason,
            p_cell(one.test.p),
            ", ".join(map(readable_term, one.terms)),
        )
        for one in tests
    )
    columns = ("Test", right("df"), right("Sum of squares"), right("F"), right("p"), "Terms")
    return table("Partial F tests", columns, rows)
