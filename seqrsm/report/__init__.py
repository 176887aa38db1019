"""The report of a campaign: one dossier, two faces (HTML and PDF) with the same numbers.

``content`` turns the dossier into blocks, ``html`` and ``pdf`` render them, ``write`` puts them into files.
"""

from __future__ import annotations

from seqrsm.report.write import write_report

__all__ = ["write_report"]
