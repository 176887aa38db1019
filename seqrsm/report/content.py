"""The report as data: from the dossier of a campaign to a tree of blocks that all faces render."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import replace

import seqrsm
from seqrsm.campaign.dossier import Dossier
from seqrsm.report.blocks import Block, Details, Equation, FigureBlock, Paragraph, Report, Section, Table
from seqrsm.report.profile import profile_text
from seqrsm.report.sections.application import application_sections, method_sections
from seqrsm.report.sections.candidates import candidate_section
from seqrsm.report.sections.compromise import compromise_section
from seqrsm.report.sections.data import question_section, run_section
from seqrsm.report.sections.literature import literature_section, printed_section
from seqrsm.report.sections.measure import measure_section
from seqrsm.report.sections.sources import (
    assumption_section,
    calendar_section,
    cover_section,
    image_section,
    provenance_section,
)
from seqrsm.report.sections.speed import speed_section
from seqrsm.report.sections.summary import result_section, summary_section
from seqrsm.report.wording import listing


def build_report(dossier: Dossier) -> Report:
    """Build the report of a campaign as it stands.

    The same for the same campaign and seed: it carries no time of day, neither of its making nor of a score.
    """
    spec, analyses, runs = dossier.spec, dossier.analyses, dossier.runs
    summary = summary_section(spec, analyses, dossier.compromise, runs, dossier.rests, dossier.rankings)
    sections: list[Section | None] = [summary]
    methods: list[Section | None] = []
    alone = dossier.compromise is None  # of one application
    if dossier.compromise is not None:
        sections.append(compromise_section(spec.region, dossier.compromise))
    for number, analysis in enumerate(analyses, 1):
        key = f"a{number}"
        parts: list[Section | None] = list(application_sections(spec, dossier.looks, analysis, key))
        parts.append(measure_section(analysis, dossier.events, spec.cost, f"{key}-measure"))
        how = method_sections(analysis, key)
        if alone:
            sections += parts
            methods += how
        else:
            title = "Optimum for this application alone"
            parts.insert(0, result_section(spec, analysis, dossier.rests, f"{key}-result", title))
            sections.append(Section(key, f"Application {analysis.application}", (), _there(parts)))
            methods.append(Section(f"{key}-methods", f"Methods of {analysis.application}", (), how))
    sections += (
        candidate_section(dossier.candidates, named=bool(spec.candidates)),
        calendar_section(dossier),
        image_section(dossier),
        literature_section(dossier),
        question_section(dossier),
        assumption_section(dossier),
    )
    methods += (
        speed_section(dossier),
        printed_section(dossier),
        cover_section(dossier),
        provenance_section(dossier),
        run_section(dossier),
    )
    shown = [*_there(sections), Section("appendix", "Appendix: methods and all runs", (), _there(methods))]
    shown = list(_once(shown, set()))
    if alone:  # The summary of one application fills a page.
        shown[1] = replace(shown[1], new_page=True)
    scored, last = sum(run.state == "scored" for run in dossier.runs), max(run.run_id for run in dossier.runs)
    return Report(
        title=f"Campaign {spec.name}",
        subtitle=spec.description or "Response surface, optimum and intervals of a sensor design",
        state=f"{scored} scored runs, up to run {last}; specification {spec.spec_hash[:12]}",
        version=seqrsm.__version__,
        sections=tuple(_numbered(shown, itertools.count(1), itertools.count(1))),
        profiles=tuple(("" if alone else one.application, profile_text(one)) for one in analyses),
        byline=", ".join(text for text in (spec.author, spec.date) if text),
    )


def _there(sections: Iterable[Section | None]) -> tuple[Section, ...]:
    return tuple(section for section in sections if section is not None)


def _once(sections: Iterable[Section], told: set[str]) -> Iterator[Section]:
    """Leave out what an earlier section tells in the same words: how something is found for a second application."""
    for section in sections:
        blocks: list[Block] = []
        for block in section.blocks:
            how = block.math if isinstance(block, Equation) else block.method if isinstance(block, Paragraph) else ""
            if how in told:
                if isinstance(block, Paragraph) and block.text:
                    blocks.append(replace(block, method=""))
                continue
            if how:
                told.add(how)
            blocks.append(block)
        yield replace(section, blocks=tuple(blocks), sections=tuple(_once(section.sections, told)))


def _numbered(sections: Iterable[Section], figures: Iterator[int], tables: Iterator[int]) -> Iterator[Section]:
    """Number figures and tables in their order; the paragraph before them refers to them.

    Where none stands before them in their section, one is put there.
    """
    for section in sections:
        blocks: list[Block] = [Paragraph(""), *section.blocks]
        found: dict[int, list[str]] = {}
        before = 0
        for place, block in enumerate(blocks):
            if isinstance(block, Paragraph) and block.tone != "warning":
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
            parts.append(f"{kind}{'s' if len(numbers) > 1 else ''}\u00a0{shown}")
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
