"""What a thorough analysis adds: the place of the optimum, averages over models, blocks, paths."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from functools import partial

import numpy as np

from seqrsm.analysis.results import Analysis, BlockStudy, PathPoint, Study, TermChoice
from seqrsm.fit.location import LocationRegion
from seqrsm.report.blocks import (
    Block,
    Cell,
    Column,
    Details,
    FigureBlock,
    Panel,
    PanelData,
    Paragraph,
    Section,
    Table,
)
from seqrsm.report.figures.study import location_key, location_panel
from seqrsm.report.figures.surfaces import MAX_PAIRS, chosen_pairs
from seqrsm.report.rounding import format_percent
from seqrsm.report.study_text import (
    LOCATION_METHODS,
    averaged_text,
    block_rows,
    block_text,
    location_caption,
    location_text,
    path_rows,
    searched_rows,
    searched_text,
)
from seqrsm.report.wording import (
    axis_label,
    capital,
    interval_text,
    level_phrase,
    number_cell,
    readable,
    readable_term,
    score_text,
    slug,
)


def searched_blocks(analysis: Analysis) -> list[Block]:
    """Intervals at the optimum that allow for its having been searched for; empty without a study."""
    study = analysis.study
    if study is None:
        return []
    rows = searched_rows(analysis, study)
    text = searched_text(analysis, study)
    if not rows:
        return [Paragraph(f"Intervals that allow for the search: {text[:1].lower()}{text[1:]}", "note")]
    columns = (Column("Interval"), Column("From, to"), Column("Half-width", analysis.score_unit, "right"))
    cells = tuple((Cell(capital(name)), Cell(ends), Cell(half)) for name, ends, half in rows)
    return [Paragraph(text), Table(columns, cells, f"Intervals after the search, {level_phrase(analysis)}")]


def location_section(analysis: Analysis, key: str) -> Section | None:
    """Where the optimum may lie, factor by factor and in pairs; None without a study."""
    study = analysis.study
    if study is None:
        return None
    if not study.locations:
        blocks: tuple[Block, ...] = (Paragraph(f"There is no confidence region of the place: {study.no_location}."),)
        return Section(f"{key}-location", "Place of the optimum", blocks)
    rows = tuple(
        (Cell(axis_label(factor)), *(Cell(location_text(region, j)) for region in study.locations))
        for j, factor in enumerate(analysis.region.factors)
    )
    columns = (Column("Factor"), *(Column(capital(LOCATION_METHODS[region.method])) for region in study.locations))
    caption = location_caption(analysis, study.locations)
    found: list[Block] = [Table(columns, rows, f"Where the optimum may lie, {level_phrase(analysis)}. {caption}")]
    found += _location_figure(analysis, study.locations)
    found += _paths(analysis, study)
    return Section(f"{key}-location", "Place of the optimum", tuple(found))


def _location_figure(analysis: Analysis, regions: Sequence[LocationRegion]) -> list[Block]:
    pairs = chosen_pairs(analysis)
    if not pairs:
        return []
    panels = []
    for x, y in pairs:
        names = [readable(analysis.region.names[j]) for j in (x, y)]
        ends = "; ".join(
            f"{LOCATION_METHODS[region.method]}: {names[0]} {location_text(region, x)}, "
            f"{names[1]} {location_text(region, y)}"
            for region in regions
        )
        panels.append(
            Panel(
                f"{names[1]} against {names[0]}",
                f"Settings that may be the best, seen along {names[0]} (across) and {names[1]} (up). {ends}.",
                svg=location_panel(analysis, regions, x, y),
                name=slug(f"location {names[1]} against {names[0]}"),
                data=partial(_location_data, analysis, regions, x, y),
            )
        )
    caption = (
        "Settings that may be the best, in pairs of factors: a point belongs to a region at some setting of the "
        f"others. Lines are hulls. {capital(location_key(regions))}; star: recommended settings."
    )
    total = len(list(itertools.combinations(analysis.region.numeric, 2)))
    if len(pairs) < total:
        caption += f" Of {total} pairs the {MAX_PAIRS} of the most important factors are drawn."
    return [FigureBlock(tuple(panels), caption)]


def _location_data(analysis: Analysis, regions: Sequence[LocationRegion], x: int, y: int) -> PanelData:
    names = [analysis.region.names[j] for j in (x, y)]
    rows = [
        (LOCATION_METHODS[region.method], float(settings[names[0]]), float(settings[names[1]]))
        for region in regions
        for settings in analysis.region.decode(region.points)
    ]
    return PanelData(("region", *(axis_label(analysis.region.factors[j]) for j in (x, y))), tuple(rows))


def _paths(analysis: Analysis, study: Study) -> list[Block]:
    found: list[Block] = []
    for title, path in (
        ("Ridge analysis: best settings at each coded distance from the centre", study.ridge),
        ("Path of steepest ascent from the centre of the region", study.steepest),
    ):
        if len(path) > 1:
            found.append(Details(title, (_path_table(analysis, path, title),)))
    return found


def _path_table(analysis: Analysis, path: Sequence[PathPoint], title: str) -> Table:
    names = [axis_label(factor) for factor in analysis.region.factors]
    columns = (
        Column("Distance", align="right"),
        *(Column(name, align="right") for name in names),
        Column("Mean score", analysis.score_unit, "right"),
        Column(""),
    )
    rows = tuple(tuple(Cell(text) for text in row) for row in path_rows(analysis, path))
    return Table(columns, rows, title)


def term_blocks(analysis: Analysis) -> list[Block]:
    """Averaging over models and blocks, folded away; empty without a study."""
    study = analysis.study
    if study is None:
        return []
    found: list[Block] = []
    if isinstance(study.terms, TermChoice):
        found.append(Details("Which terms: averages over models", _choice_blocks(analysis, study.terms)))
    if study.blocks is not None:
        found.append(Details("The recommended settings by block", _block_blocks(analysis, study.blocks)))
    return found


def _choice_blocks(analysis: Analysis, found: TermChoice) -> tuple[Block, ...]:
    order = np.argsort(-found.inclusion, kind="stable").tolist()
    rows = tuple(
        (
            Cell(readable_term(found.units[i])),
            number_cell(format_percent(float(found.inclusion[i])), float(found.inclusion[i])),
            number_cell(format_percent(float(found.prior_inclusion[i])), float(found.prior_inclusion[i])),
        )
        for i in order
    )
    columns = (Column("Term"), Column("Probability", align="right"), Column("Before the scores", align="right"))
    text = (
        f"Probability that each term belongs to the model, over hierarchical models with Zellner's g prior. "
        f"{capital(averaged_text(found, readable_term))} Averaged over models, the score at the recommended settings "
        f"is {score_text(analysis, found.mean)}, {level_phrase(analysis)} credible interval "
        f"{interval_text(analysis, found.confidence)}, of one future run {interval_text(analysis, found.prediction)}: "
        "these intervals hold the doubt about the terms, which those of one model leave out."
    )
    return (Paragraph(text), Table(columns, rows, "Terms, the most probable first", sortable=True))


def _block_blocks(analysis: Analysis, found: BlockStudy) -> tuple[Block, ...]:
    level = level_phrase(analysis)
    columns = (Column("Block"), Column("Mean"), Column(f"{level} confidence"), Column(f"{level} prediction, one run"))
    rows = tuple(tuple(Cell(text) for text in row) for row in block_rows(analysis, found))
    return (Table(columns, rows, "The recommended settings by block"), Paragraph(block_text(found)))


def largest_vif(analysis: Analysis) -> tuple[str, float] | None:
    """Term of the largest variance inflation factor, and that factor; None where there is none."""
    vif = analysis.fit.vif()
    known = [i for i in range(len(vif)) if np.isfinite(vif[i]) and analysis.fit.kinds[i] != "block"]
    if not known:
        return None
    worst = max(known, key=lambda i: float(vif[i]))
    return readable_term(analysis.fit.names[worst]), float(vif[worst])
