"""Check against the literature: the optimum beside the rows of Tables A.1 to A.20 on the application."""

from __future__ import annotations

from collections import Counter

from seqrsm.analysis.results import Analysis
from seqrsm.campaign.dossier import Dossier
from seqrsm.catalog import summary
from seqrsm.report.blocks import Block, Paragraph, Section, Table, table
from seqrsm.report.literature import Literature, literature, system_of
from seqrsm.report.wording import counted, listing, readable

MAX_NAMED = 2

_LATER = (
    "The tables list what was required, and believed possible, up to 1979: a difference calls for an explanation and "
    "need not be an error."
)


def printed_section(dossier: Dossier) -> Section | None:
    """Return what the catalogue's tables print on each application; None where they print nothing."""
    found = [literature(dossier.spec, analysis) for analysis in dossier.analyses]
    blocks: list[Block] = [_statement_table(one) for one in found if one is not None]
    if not blocks:
        return None
    return Section("printed", "Literature entries as printed", (Paragraph(_LATER), *blocks))


def literature_section(dossier: Dossier) -> Section | None:
    """Return the comparison with the catalogue for each application; None where there is no result to compare."""
    if not dossier.analyses:
        return None
    blocks: list[Block] = []
    for analysis in dossier.analyses:
        blocks += _application(dossier, analysis)
    return Section("literature", "Comparison with the literature", tuple(blocks))


def _application(dossier: Dossier, analysis: Analysis) -> list[Block]:
    found = literature(dossier.spec, analysis)
    kind = "radar" if system_of(dossier.spec) == "active" else "radiometer"
    if found is None:
        return [
            Paragraph(
                f"{analysis.application}: no {kind} entry of Tables A.1 to A.20 of RSL TR 380-1 matches the words of "
                "the application's name or the campaign's description. The key catalog of [[application]] sets the "
                "words to look up."
            )
        ]
    count = len(found.start.entries)
    text = (
        f"{analysis.application}: {counted(count, f'{kind} entry', f'{kind} entries')} in Tables A.1 to A.20 of "
        f"RSL TR 380-1 for \u201c{found.asked}\u201d ({found.reason}). "
    )
    return [Paragraph(text + _agreement(found)), _comparison_table(found, analysis)]


def _agreement(found: Literature) -> str:
    counts = Counter(row.verdict for row in found.comparisons)
    comparable = counts["agrees"] + counts["not excluded"] + counts["differs"]
    if not comparable:
        return "Their values cannot be compared with this campaign's."
    words = [
        f"{readable(row.parameter)} {row.verdict}"
        for row in found.comparisons
        if row.verdict in ("agrees", "not excluded", "differs")
    ]
    if comparable == 1:
        return f"One parameter can be compared: {words[0]}."
    return f"{counts['agrees']} of {comparable} comparable parameters agree: {listing(words)}."


def _comparison_table(found: Literature, analysis: Analysis) -> Table:
    rows = (
        (readable(row.parameter), row.printed, row.agreed, row.found, f"{row.verdict}: {row.why}", row.tables)
        for row in found.comparisons
    )
    columns = ("Parameter", "Literature", "Most sources", "This campaign", "Agreement", "Tables")
    caption = f"{analysis.application}: recommended settings (with credible interval or levels) and the literature"
    return table(caption, columns, rows)


def _some(applications: tuple[str, ...]) -> str:
    """The first applications of a statement; the catalogue command lists all."""
    if len(applications) <= MAX_NAMED:
        return "; ".join(applications)
    return f"{'; '.join(applications[:MAX_NAMED])}; {len(applications) - MAX_NAMED} more"


def _statement_table(found: Literature) -> Table:
    rows = (
        (one.parameter, one.printed, one.read_as, ", ".join(one.tables), _some(one.applications))
        for one in summary(found.start.entries)
    )
    columns = ("Parameter", "As printed", "Read as", "Tables", "Application")
    return table(f"Entries for \u201c{found.asked}\u201d, as printed", columns, rows)
