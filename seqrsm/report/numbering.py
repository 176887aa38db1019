"""Numbers of figures and tables, and the text that refers to them."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace

from seqrsm.report.blocks import Block, Details, FigureBlock, Paragraph, Section, Table
from seqrsm.report.wording import listing


def numbered(sections: tuple[Section, ...]) -> tuple[Section, ...]:
    """Number figures and tables in their order; the paragraph before them refers to them.

    Where none stands before them in their section, one is put there.
    """
    return tuple(_numbered(sections, itertools.count(1), itertools.count(1)))


def _numbered(sections: tuple[Section, ...], figures: Iterator[int], tables: Iterator[int]) -> Iterator[Section]:
    for section in sections:
        blocks: list[Block] = [Paragraph(""), *section.blocks]
        found: dict[int, list[str]] = {}
        before = 0
        for place, block in enumerate(blocks):
            if isinstance(block, Paragraph):
                before = place
            blocks[place], names = _captioned(block, figures, tables)
            if names:
                found.setdefault(before, []).extend(names)
        for place, names in found.items():
            paragraph = blocks[place]
            assert isinstance(paragraph, Paragraph)
            see = f"See {_together(names)}."
            joined = f"{paragraph.method} {see}" if paragraph.text or paragraph.method else see
            blocks[place] = replace(paragraph, method=joined)
        shown = blocks if 0 in found else blocks[1:]
        yield replace(section, blocks=tuple(shown), sections=tuple(_numbered(section.sections, figures, tables)))


def _together(names: list[str]) -> str:
    """Names by kind: ``"Figures 3 and 4 and Table 2"``."""
    parts = []
    for kind in ("Figure", "Table"):
        numbers = [name.removeprefix(f"{kind} ") for name in names if name.startswith(kind)]
        if numbers:
            run = len(numbers) > 2 and int(numbers[-1]) - int(numbers[0]) == len(numbers) - 1
            shown = f"{numbers[0]} to {numbers[-1]}" if run else listing(numbers)
            parts.append(f"{kind}{'s' if len(numbers) > 1 else ''} {shown}")
    return " and ".join(parts)


def _captioned(block: Block, figures: Iterator[int], tables: Iterator[int]) -> tuple[Block, list[str]]:
    """Block with its number in its caption, and the names of what it holds."""
    if isinstance(block, Table):
        name = f"Table {next(tables)}"
        return replace(block, caption=f"{name}. {block.caption}"), [name]
    if isinstance(block, FigureBlock):
        name = f"Figure {next(figures)}"
        return replace(block, caption=f"{name}. {block.caption}"), [name]
    if isinstance(block, Details):
        pairs = [_captioned(one, figures, tables) for one in block.blocks]
        return replace(block, blocks=tuple(one for one, _ in pairs)), [name for _, names in pairs for name in names]
    return block, []
