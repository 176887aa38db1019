"""The records of an export into an empty store, as they are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import sqlalchemy as sa

from seqrsm.campaign.records import EventRecord, FileRecord, LookRecord, RankingRecord, RunRecord
from seqrsm.campaign.schema import EVENTS, FILES, LOOKS, META, METADATA, RANKINGS, RUNS, SCORES
from seqrsm.campaign.store_ledger import Ledger
from seqrsm.errors import Problem, StoreError

_CHUNK = 500


def restore(
    ledger: Ledger,
    meta: Mapping[str, str],
    runs: Sequence[RunRecord],
    looks: Sequence[LookRecord],
    events: Sequence[EventRecord],
    files: Sequence[FileRecord],
    rankings: Sequence[RankingRecord],
) -> None:
    """Insert everything; StoreError when the store is not empty or the records contradict each other."""
    connection = ledger.connection
    if connection.execute(sa.select(RUNS.c.id).limit(1)).first() or connection.execute(sa.select(EVENTS.c.id)).first():
        raise StoreError(Problem("the data base holds a campaign already", "Give this one a data base of its own."))
    rows: dict[sa.Table, list[dict[str, Any]]] = {
        # A replacement comes after what it replaces.
        RUNS: [_renamed(run, run_id="id", scores=None) for run in sorted(runs, key=lambda run: run.run_id)],
        SCORES: [asdict(score) for run in runs for score in run.scores],
        LOOKS: [_renamed(look, look="id") for look in looks],
        EVENTS: [_renamed(event, event="id") for event in events],
        FILES: [asdict(file) for file in files],
        RANKINGS: [asdict(rank) for rank in rankings],
    }
    for key, value in meta.items():
        connection.execute(sa.update(META).where(META.c.key == key).values(value=value))
    try:
        for table, values in rows.items():
            for start in range(0, len(values), _CHUNK):
                connection.execute(sa.insert(table), values[start : start + _CHUNK])
    except sa.exc.IntegrityError as error:
        raise StoreError(Problem(f"the records of the export contradict each other ({error.orig})")) from error
    if connection.dialect.name == "postgresql":
        for table in METADATA.sorted_tables:
            if "id" in table.c and table is not RUNS:
                top = sa.select(sa.func.coalesce(sa.func.max(table.c.id), 0) + 1).scalar_subquery()
                name = sa.func.pg_get_serial_sequence(table.name, "id")
                connection.execute(sa.select(sa.func.setval(name, top, False)))


def _renamed(record: Any, **names: str | None) -> dict[str, Any]:
    """Columns of a record; some under another name, some (None) left out."""
    columns = ((names.get(key, key), value) for key, value in asdict(record).items())
    return {name: value for name, value in columns if name is not None}
