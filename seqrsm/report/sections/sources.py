"""Simulated images and ground truth, assumptions and limits, provenance and how to reproduce."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from functools import partial
from typing import TypeAlias

import numpy as np

from seqrsm.campaign.dossier import Dossier
from seqrsm.campaign.images import ImagePanel
from seqrsm.campaign.next_runs import rounded_settings as settings_of_run
from seqrsm.report.blocks import (
    Block,
    Bullets,
    Code,
    Definitions,
    FigureBlock,
    Head,
    LegendEntry,
    Panel,
    PanelData,
    Paragraph,
    Section,
    Table,
    right,
    table,
)
from seqrsm.report.figures import drawing
from seqrsm.report.figures.fit import calendar_data, paint_calendar
from seqrsm.report.images import (
    NO_DATA,
    bar_length_m,
    category_color,
    cover_png,
    grey_png,
    picture_data,
    reduce_cover,
    reduce_grey,
    reduction,
)
from seqrsm.report.rounding import format_plain, format_plus_minus
from seqrsm.report.wording import (
    axis_label,
    capital,
    format_value,
    listing,
    readable,
    rounded_settings,
    slug,
    with_unit,
)
from seqrsm.scene.scene import Scene

_CHANNELS = ("HH", "HV", "VH", "VV")
AboutCovers: TypeAlias = dict[str, list[str]]
AboutChannels: TypeAlias = list[tuple[str, str, str]]

LIMITS = (
    "The fitted surface is valid inside the region only.",
    "The optimum is that of the fitted surface; its posterior shows how far the true optimum may be from it.",
    "Stopping on the width of an interval makes it slightly too narrow on average. The other conditions of the stop "
    "rule limit this; only confirmation runs at the recommended settings give an interval of exact coverage.",
)


def calendar_section(dossier: Dossier) -> Section | None:
    """Return backscatter of the crops over the year with the recommended dates; None for a campaign without dates."""
    calendar = dossier.calendar
    if calendar is None:
        return None
    days = listing([f"{day:.0f}" for day in calendar.days])
    panels = tuple(
        drawing.panel(
            channel,
            f"{channel} of {listing(list(calendar.crops))} over the days of the year; dates on days {days}.",
            partial(paint_calendar, calendar, k),
            f"calendar {channel}",
            partial(calendar_data, calendar, k),
        )
        for k, channel in enumerate(calendar.channels)
    )
    caption = (
        f"Simulated mean backscatter of the crops at 40 degrees incidence by day of the year. Dashed: recommended days "
        f"{days}. Individual fields deviate in level and timing."
    )
    return Section("calendar", "Crop calendar", (FigureBlock(lambda: panels, caption),))


_FRAMES = {
    "psm": ("Radar images", "Range increases downwards, azimuth across."),
    "prm": (
        "Radiometer images",
        "The scan runs down the images and the flight across; every ground cell shows the brightness of the nearest "
        "footprint, white where there is none.",
    ),
}
"""By engine: what its images are, and how they lie."""


def image_section(dossier: Dossier) -> Section | None:
    """Return the simulated images beside the ground truth; None where there are none."""
    if not dossier.images and dossier.scene is None:
        return None
    unit = dossier.analyses[0].score_unit
    count = sum(len(image.channels) for image in dossier.images) + (dossier.scene is not None)
    kinds = tuple(dict.fromkeys(image.engine for image in dossier.images))
    where = " ".join(f"{name}: {text}" if len(kinds) > 1 else text for name, text in map(_FRAMES.__getitem__, kinds))
    scale = (
        "The black bar under each image is its scale, given in the table. All images show one random occasion; the "
        "grey scale is common to all images of a channel."
    )
    if "heading_deg" in dossier.spec.region.names:
        scale += " The ground truth is rotated like the first image."
    blocks: list[Block] = [Paragraph(f"{where} {scale}")]
    panels: list[Panel] = []
    captions: list[str] = []
    legend: tuple[LegendEntry, ...] = ()
    if dossier.scene is not None:
        panels.append(_truth_panel(dossier.scene, dossier.quarter_turns, count))
        names = dossier.scene.categories
        legend = tuple(LegendEntry(category_color(i), readable(names[i])) for i in sorted(_covers(dossier.scene)))
        captions.append(f"Ground truth: {dossier.scene.name} (source and licence under Provenance).")
    for image in dossier.images:
        panels += _image_panels(dossier, image, unit, count)
        captions.append(f"{image.title}: {_ended(image.caption)}")
    columns = 4 if len(panels) > 3 else 3
    blocks.append(FigureBlock(lambda: tuple(panels), " ".join(captions), columns, legend))
    blocks.append(_picture_table(dossier, unit, count))
    return Section("images", "Simulated images and ground truth", tuple(blocks))


def _covers(scene: Scene) -> list[int]:
    """Cover categories that occur, the commonest first."""
    index, count = np.unique(scene.cover, return_counts=True)
    known = [(int(c), int(i)) for i, c in zip(index, count, strict=True) if i != NO_DATA and i < len(scene.categories)]
    return [i for _, i in sorted(known, key=lambda pair: (-pair[0], pair[1]))]


def _truth_panel(scene: Scene, quarter_turns: int, count: int) -> Panel:
    main = listing([readable(scene.categories[i]) for i in _covers(scene)[:3]])
    alt = f"Map of the ground truth of {scene.name}; the largest covers are {main}."
    cover = np.rot90(scene.cover, quarter_turns)
    factor, labels = reduction(cover.shape, count), np.full(256, "", dtype=object)
    labels[: len(scene.categories)] = [readable(name) for name in scene.categories]
    return Panel(
        "Ground truth",
        alt,
        png=cover_png(cover, scene.cell_m, factor),
        name="ground-truth",
        data=lambda: picture_data(labels[reduce_cover(cover, factor)], scene.cell_m * factor),
    )


def _image_panels(dossier: Dossier, image: ImagePanel, unit: str, count: int) -> list[Panel]:
    settings = rounded_settings(dossier.analyses[0], image.settings)
    score = _score(image, unit)
    factor = reduction(image.greytone.shape[1:], count)
    return [
        Panel(
            f"{image.title}: {channel}" if channel else image.title,
            f"Simulated image, channel {channel}, {image.title}: {settings}; score {score}.",
            png=grey_png(image.greytone[index], image.pixel_m, factor),
            name=slug(f"image {image.title} {channel}"),
            data=partial(_grey_data, image, index, factor),
        )
        for index, channel in enumerate(image.channels)
    ]


def _grey_data(image: ImagePanel, index: int, factor: int) -> PanelData:
    return picture_data(reduce_grey(image.greytone[index], factor), image.pixel_m * factor)


def _score(image: ImagePanel, unit: str) -> str:
    # A function of the user's that tells no standard error is not exact.
    return with_unit(format_plus_minus(image.score, image.score_se or math.nan), unit)


def _picture_table(dossier: Dossier, unit: str, count: int) -> Table:
    rows = []
    if dossier.scene is not None:
        cover = np.rot90(dossier.scene.cover, dossier.quarter_turns)
        size = _size_cells(cover.shape, dossier.scene.cell_m, count)
        rows.append(("Ground truth", "", "", *size))
    for image in dossier.images:
        settings = rounded_settings(dossier.analyses[0], image.settings)
        size = _size_cells(image.greytone.shape[1:], image.pixel_m, count)
        rows.append((image.title, settings, _score(image, unit), *size))
    columns: tuple[Head, ...] = (
        *("Image", "Settings", right("Score \u00b1 s.e."), "Along by across track"),
        *map(right, ("Cell or pixel", "Reduced", "Scale bar")),
    )
    use = f" for {dossier.analyses[0].application}" if len(dossier.analyses) > 1 else ""
    caption = f"Images shown; score{use} of this one occasion, with its standard error within the image"
    return table(caption, columns, rows)


def _size_cells(shape: tuple[int, ...], pixel_m: float, count: int) -> tuple[str, str, str, str]:
    """Extent, pixel, reduction and length of the scale bar of a picture."""
    rows, columns = shape
    factor = reduction(shape, count)
    return (
        f"{_length(columns * pixel_m)} by {_length(rows * pixel_m)}",
        _metres(pixel_m),
        "no" if factor == 1 else f"{factor} times",
        _length(bar_length_m(-(-columns // factor), pixel_m * factor)),
    )


def _length(metres: float) -> str:
    return f"{format_plain(float(f'{metres / 1000.0:.3g}'))} km" if metres >= 1000.0 else _metres(metres)


def _metres(metres: float) -> str:
    return f"{format_plain(float(f'{metres:.3g}'))} m"


def _sentence(text: str) -> str:
    text = text.strip()
    return _ended(capital(text))


def _ended(text: str) -> str:
    text = text.strip()
    return text if not text or text[-1] in ".!?" else f"{text}."


def assumption_section(dossier: Dossier) -> Section:
    """Return assumptions of the simulation and limits of the method."""
    blocks: list[Block] = []
    _, _, others = _grouped(dossier)
    if others:
        blocks += [Paragraph("Assumptions:"), Bullets(tuple(_sentence(text) for text in others))]
    blocks += [Paragraph("Limits of the method:"), Bullets(LIMITS)]
    return Section("assumptions", "Assumptions and limits", tuple(blocks))


def cover_section(dossier: Dossier) -> Section | None:
    """Return how the backscatter or emissivity of each cover was found; None where none was assumed."""
    about_covers, about_channels, _ = _grouped(dossier)
    blocks: list[Block] = []
    if about_covers:
        blocks.append(_cover_table(about_covers))
    if about_channels:
        blocks.append(_channel_table(about_channels))
    return Section("covers", "Assumptions for each cover", tuple(blocks)) if blocks else None


def _grouped(dossier: Dossier) -> tuple[AboutCovers, AboutChannels, tuple[str, ...]]:
    return group_notes(dossier.assumptions, () if dossier.scene is None else dossier.scene.categories)


def group_notes(notes: Iterable[str], categories: Sequence[str]) -> tuple[AboutCovers, AboutChannels, tuple[str, ...]]:
    """Sort statements of the form "category: ..." and "category channel: ..." from the others, each once.

    Statements and the cover categories that they are made on, in the order of their first mention; category, channel
    and a statement on both; statements on the whole simulation.
    """
    known = set(categories)
    covers: AboutCovers = {}
    channels: AboutChannels = []
    others: list[str] = []
    for note in dict.fromkeys(notes):
        subject, colon, text = note.partition(": ")
        head, _, tail = subject.rpartition(" ")
        if colon and subject in known:
            covers.setdefault(text, []).append(subject)  # no note is met twice, so no cover is either
        elif colon and head in known and tail in _CHANNELS:
            channels.append((head, tail, text))
        else:
            others.append(note)
    return covers, channels, tuple(others)


def _cover_table(about_covers: AboutCovers) -> Table:
    rows, covers = [], list(dict.fromkeys(name for names in about_covers.values() for name in names))
    for text, names in about_covers.items():
        everyone = len(names) > 1 and set(names) == set(covers)
        subject = "every cover" if everyone else ", ".join(readable(name) for name in names)
        rows.append((everyone, covers.index(names[0]), (subject, _sentence(text))))
    # What is said of one cover stands together, though its moistures and winds of later dates are met last.
    rows.sort(key=lambda row: row[:2])
    caption = (
        "Source of the mean backscatter of each cover, for all images of this report. In brackets its status "
        "(measured, public, public_code of a published program, computed or assumed) and its name in the data"
    )
    return table(caption, ("Cover", "Statement"), [row for *_, row in rows])


def _channel_table(about_channels: AboutChannels) -> Table:
    channels = sorted({channel for _, channel, _ in about_channels})
    covers = list(dict.fromkeys(cover for cover, _, _ in about_channels))
    texts: dict[tuple[str, str], list[str]] = {}
    for cover, channel, text in about_channels:
        texts.setdefault((cover, channel), []).append(text)
    rows = (
        (readable(cover), *("; ".join(texts.get((cover, channel), [])) for channel in channels)) for cover in covers
    )
    caption = "Standard deviation of backscatter between fields of a cover and between dates, by channel"
    return table(caption, ("Cover", *channels), rows)


def provenance_section(dossier: Dossier) -> Section:
    """Return versions, seed, data sources, history, and the commands that make this report again."""
    blocks: list[Block] = [Definitions(tuple(dossier.provenance.items()))]
    text = "Times of runs are left out: the same campaign gives the same report. seqrsm status --history lists them."
    blocks += [Paragraph("To reproduce this campaign and this report:"), Code(dossier.reproduce), Paragraph(text)]
    region, found = dossier.spec.region, [(one.application, one.optimum.point) for one in dossier.analyses]
    if dossier.compromise is not None:
        found.insert(0, ("compromise", dossier.compromise.point))
    names, points = zip(*found, strict=True)
    made = settings_of_run(region, np.array(points))
    rows = ((name, *(format_value(at[f.name]) for f in region.factors)) for name, at in zip(names, made, strict=True))
    caption = "Recommended settings as a run has them, to repeat it exactly"
    blocks.append(table(caption, ("Recommended for", *(right(axis_label(f)) for f in region.factors)), rows))
    return Section("provenance", "Provenance and how to reproduce", tuple(blocks))
