"""Write both faces of a report to files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from seqrsm.campaign.dossier import Dossier


def write_report(dossier: Dossier, html: Path | None = None, pdf: Path | None = None) -> tuple[Path, ...]:
    """Write the report of a campaign.

    Parameters
    ----------
    dossier : Dossier
        The campaign as it stands.
    html, pdf : Path, optional
        Files to be written; their folders are made. A face whose path is None is not rendered.

    Returns
    -------
    tuple of Path
        The files written, each put in place at once: a reader never sees half a file.
    """
    from seqrsm.report.content import build_report

    report = build_report(dossier)
    written = []
    if html is not None:
        from seqrsm.report.html import render_html

        written.append(_replace(html, render_html(report).encode("utf-8")))
    if pdf is not None:
        from seqrsm.report.pdf import render_pdf

        written.append(_replace(pdf, render_pdf(report)))
    return tuple(written)


def _replace(path: Path, data: bytes) -> Path:
    """Write to a neighbouring file and rename it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_name(f".{path.name}.draft")
    draft.write_bytes(data)
    draft.replace(path)
    return path
