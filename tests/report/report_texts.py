"""Texts of a report, as blocks hold them and as the faces show them."""

from __future__ import annotations

import io
import re
from html.parser import HTMLParser

from pypdf import PdfReader

from seqrsm.report.blocks import Bullets, Code, Definitions, Details, FigureBlock, KeyFigures, Paragraph, Table

VOID = {"meta", "img", "br", "hr", "link", "input"}


class Page(HTMLParser):
    """Checks that tags nest, and gathers text, tags and attributes."""

    def __init__(self, source: str) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.text: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.feed(source)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if not {"script", "style"} & set(self.open):
            self.text.append(data)


def squeezed(text: str) -> str:
    return re.sub(r"\s", "", text)


def html_text(source: str) -> str:
    return squeezed("".join(Page(source).text))


def pdf_text(data: bytes, title: str = "") -> str:
    """Text of a PDF without the running header, where that is the title alone, and footer."""
    pages = []
    for page in PdfReader(io.BytesIO(data)).pages:
        text = page.extract_text().strip().removeprefix(title)
        pages.append(re.sub(r"(?:seqrsm [\d.]+\s*page \d+ of \d+|page \d+ of \d+\s*seqrsm [\d.]+)\Z", "", text))
    return squeezed("\n".join(pages))


def of_blocks(blocks, *, terminal=False):
    """Every piece of text that the page and the paper must show; of it what a terminal must show."""
    for block in blocks:
        if isinstance(block, Paragraph):
            yield block.text
            if not terminal:
                yield block.method
        elif isinstance(block, Bullets):
            yield from block.items
        elif isinstance(block, KeyFigures):
            for item in block.items:
                yield from (item.label, item.value, item.detail)
        elif isinstance(block, Table):
            yield block.caption
            shown = [k for k, column in enumerate(block.columns) if not (terminal and column.extra)]
            yield from (block.columns[k].title for k in shown)
            yield from (row[k].text for row in block.rows for k in shown)
        elif isinstance(block, FigureBlock) and not terminal:
            yield block.caption
            yield from (panel.title for panel in block.panels)
            yield from (entry.label for entry in block.legend)
        elif isinstance(block, Definitions):
            yield from (text for pair in block.items for text in pair)
        elif isinstance(block, Code):
            yield from block.lines
        elif isinstance(block, Details):
            if terminal and block.long:
                yield block.summary
            else:
                yield from of_blocks(block.blocks, terminal=terminal)


def of_sections(sections, *, terminal=False):
    for section in sections:
        inside = [*of_blocks(section.blocks, terminal=terminal), *of_sections(section.sections, terminal=terminal)]
        if any(inside) or not terminal:
            yield section.title
        yield from inside


def strings(report):
    """Every piece of text that both written faces must show."""
    yield from (report.title, report.subtitle, report.state)
    yield from of_sections(report.sections)


def all_blocks(sections):
    for section in sections:
        for block in section.blocks:
            yield block
            if isinstance(block, Details):
                yield from block.blocks
        yield from all_blocks(section.sections)
