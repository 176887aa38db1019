"""The report of a campaign: one dossier, two faces (HTML and PDF) with the same numbers.

``content`` turns the dossier into blocks, ``html`` and ``pdf`` render them, `write_report` puts them into files.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from seqrsm.files import put
from seqrsm.progress import silent, tell

if TYPE_CHECKING:
    from seqrsm.campaign.dossier import Dossier


def write_report(
    dossier: Dossier,
    html: Path | None = None,
    pdf: Path | None = None,
    figures: Path | None = None,
    step: Callable[[str], None] = silent,
) -> tuple[Path, ...]:
    """Write the report of a campaign; a face whose path is None is not rendered.

    Folders of ``html`` and ``pdf`` are made; the folder ``figures`` takes every picture as SVG, PDF, PNG and CSV.
    ``step`` is told what is being done. Returns the files written, each put in place at once: a reader never sees half
    a file.
    """
    from seqrsm.report.content import build_report
    from seqrsm.report.figures.files import named_panels, write_figures

    step("drawing")
    report = build_report(dossier)
    panels = [panel for *_, panel in named_panels(report)]
    for count, panel in enumerate(panels):
        tell("drawing", count, len(panels))
        assert panel.svg or panel.png, panel.name  # drawn here, where progress can be told, and kept
    written = []
    if html is not None:
        from seqrsm.report.html import render_html

        step("writing HTML")
        written.append(put(html, render_html(report).encode("utf-8"), make_folder=True))
    if pdf is not None:
        from seqrsm.report.pdf import render_pdf

        step("typesetting PDF")
        written.append(put(pdf, render_pdf(report), make_folder=True))
    if figures is not None:
        step("writing figures")
        written += write_figures(report, figures)
    return tuple(written)
