"""The terminal face of `seqrsm.report.blocks`: what was found, in the words and digits of the report."""

from __future__ import annotations

from collections.abc import Iterable

from seqrsm.cli.console import heading, line, show_table
from seqrsm.report.blocks import Block, Bullets, Code, Definitions, Details, KeyFigures, Paragraph, Section, Table

_RULED = (Table, KeyFigures, Definitions)


def show_sections(sections: Iterable[Section]) -> None:
    """Print sections under their titles; one that holds nothing for a terminal is left out."""
    for section in sections:
        shown = tuple(_shown(section.blocks))
        if shown or section.sections:
            heading(section.title)
        show_blocks(shown)
        show_sections(section.sections)


def show_blocks(blocks: Iterable[Block]) -> None:
    """Print blocks; an empty line sets tables off."""
    before: Block | None = None
    for block in _shown(blocks):
        if before is not None and (isinstance(before, _RULED) or isinstance(block, _RULED)):
            line()
        _show(block)
        before = block


def _shown(blocks: Iterable[Block]) -> Iterable[Block]:
    """Blocks that a terminal shows, unfolded."""
    for block in blocks:
        if isinstance(block, Details) and not block.long:
            yield from _shown(block.blocks)
        elif isinstance(block, (Bullets, Code, Definitions, Details, KeyFigures, Table)) or (
            isinstance(block, Paragraph) and block.text
        ):
            yield block


def _show(block: Block) -> None:
    if isinstance(block, Paragraph):
        line(f"Warning: {block.text}" if block.tone == "warning" else block.text)
    elif isinstance(block, Bullets):
        for item in block.items:
            line(f"- {item}")
    elif isinstance(block, KeyFigures):
        show_table((), [(item.label, item.value, item.detail) for item in block.items], sides=("left",))
    elif isinstance(block, Definitions):
        show_table((), block.items, sides=("left",))
    elif isinstance(block, Code):
        for text in block.lines:
            line(text, 4)
    elif isinstance(block, Details):
        line(f"{block.summary}: in the report (seqrsm report).")
    elif isinstance(block, Table):
        line(block.caption)
        kept = [k for k, column in enumerate(block.columns) if not column.extra]
        show_table(
            [block.columns[k].heading for k in kept],
            [[row[k].text for k in kept] for row in block.rows],
            sides=[block.columns[k].align for k in kept],
        )
