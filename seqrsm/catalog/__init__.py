"""Tables A.1 to A.39 of RSL TR 380-1 as data: what the literature asks of a microwave sensor, and what carries it.

Tables A.1 to A.20 tell which applications ask for which resolution, band, polarization, angle and revisit; A.21 to A.39
describe platforms. Everything is kept as printed, contradictions too, with the number of its table; the numbers read
from the print stand beside it. `load_catalog` reads the files once; nothing heavy is imported.
"""

from seqrsm.catalog.reader import load_catalog
from seqrsm.catalog.rendering import catalog_rows, summary, to_json
from seqrsm.catalog.search import entries_about, platforms_called, search, table_called
from seqrsm.catalog.start import StartLevels, StartRange, StartRanges, start_ranges
from seqrsm.catalog.tables import Entry, Platform, Range, Table

__all__ = [
    "Entry",
    "Platform",
    "Range",
    "StartLevels",
    "StartRange",
    "StartRanges",
    "Table",
    "catalog_rows",
    "entries_about",
    "load_catalog",
    "platforms_called",
    "search",
    "start_ranges",
    "summary",
    "table_called",
    "to_json",
]
