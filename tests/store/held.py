"""Runs in the hands of this process, chosen by their ids; `Store.claim` takes all that wait."""

from __future__ import annotations

from collections.abc import Iterable

from seqrsm.store.database import utc_now
from seqrsm.store.store import Store, _this_process


def hold(store: Store, run_ids: Iterable[int]) -> None:
    now = utc_now()
    with store._write() as ledger:
        ledger.move(run_ids, "running", {"started_at": now, "seen_at": now, "owner": _this_process()})
