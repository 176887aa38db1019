"""Interpreters' rankings in the store. They are kept as handed in; scores follow from all of them, and are made anew.

A new ranking changes every score of its application a little: they are relative. So scores of ranked applications are
no measurements but results, the only rows of the store that are overwritten; every change is an event.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import sqlalchemy as sa

from seqrsm.campaign.records import (
    IngestedFile,
    InterpreterEffect,
    NewScore,
    RankingRecord,
    RankingSummary,
)
from seqrsm.campaign.schema import RANKINGS, RUNS, SCORES
from seqrsm.campaign.store_connection import utc_now
from seqrsm.campaign.store_ledger import VOID_FIRST, Ledger
from seqrsm.errors import Problem, StoreError
from seqrsm.plain import plain
from seqrsm.score.ranking import Ranking, connected, fit_rankings

if TYPE_CHECKING:
    from seqrsm.score.ranking_file import MeasuredRanking

_FIELDS = tuple(column for column in RANKINGS.c if column.name != "id")
DERIVED = "Plackett-Luce"


def stored_rankings(ledger: Ledger) -> tuple[RankingRecord, ...]:
    """Every rank in the order of the files."""
    rows = ledger.connection.execute(sa.select(*_FIELDS).order_by(RANKINGS.c.id))
    return tuple(RankingRecord(*row) for row in rows)


def add_rankings(
    ledger: Ledger, file: IngestedFile, problems: list[Problem]
) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Keep the rankings of a file that are not there yet; their numbers, and the runs that had no score before."""
    if not file.rankings:
        return (), ()
    stored = stored_rankings(ledger)
    known = {_identity(rows) for rows in _by_number(stored).values()}
    number = max((row.ranking for row in stored), default=0)
    numbers: list[int] = []
    waiting: dict[int, None] = {}
    rows: list[dict[str, Any]] = []
    for ranking in file.rankings:
        _refuse_measured(ledger, ranking, file.name, problems)
        ranks = tuple(sorted((image.run_id, image.rank) for image in ranking.images))
        states = _settings_flown(ledger, ranking, file.name, problems)
        if (ranking.application, ranking.interpreter, ranking.session, ranks) in known:
            continue
        number += 1
        numbers.append(number)
        waiting.update(dict.fromkeys(run_id for run_id, state in states.items() if state != "scored"))
        rows += [
            {
                "ranking": number,
                "run_id": image.run_id,
                "application": ranking.application,
                "interpreter": ranking.interpreter,
                "session": ranking.session,
                "rank": image.rank,
                "metadata": plain(image.metadata),
                "source_file": file.name,
                "source_row": image.line,
                "reason": "",
                "ranked_at": utc_now(),
            }
            for image in ranking.images
        ]
    if rows and not problems:
        ledger.connection.execute(sa.insert(RANKINGS), rows)
    return tuple(numbers), tuple(waiting)


def void_ranking(ledger: Ledger, ranking: int, why: str) -> None:
    """Take one ranking out of the scores."""
    query = sa.select(RANKINGS.c.application, RANKINGS.c.reason).where(RANKINGS.c.ranking == ranking)
    row = ledger.connection.execute(query.limit(1)).first()
    if row is None:
        raise StoreError(
            Problem("there is no such ranking", "`seqrsm export` lists them.", field="ranking", value=ranking)
        )
    if row.reason:
        raise StoreError(Problem(f"ranking {ranking} is void already: {row.reason}", field="ranking", value=ranking))
    ledger.connection.execute(sa.update(RANKINGS).where(RANKINGS.c.ranking == ranking).values(reason=why))
    ledger.log("void ranking", [(None, {"ranking": ranking, "reason": why})])
    score_rankings(ledger, row.application)


def rescore_without(ledger: Ledger, run_id: int) -> None:
    """Make the scores anew of the applications in which a run, void now, was ranked."""
    query = sa.select(RANKINGS.c.application).where(RANKINGS.c.run_id == run_id).distinct()
    for application in ledger.connection.execute(query.order_by(RANKINGS.c.application)).scalars().all():
        score_rankings(ledger, application)


def score_rankings(ledger: Ledger, application: str) -> RankingSummary:
    """Scores of an application's runs from all rankings that count, into the store.

    Runs that no chain of rankings joins with the largest group of runs get no score: rankings say nothing of how
    they compare.
    """
    rows = [row for row in stored_rankings(ledger) if row.application == application and not row.reason]
    states = ledger.states({row.run_id for row in rows})
    rows = [row for row in rows if states[row.run_id] != "void"]
    rankings = {number: group for number, group in _by_number(rows).items() if len(group) > 1}
    run_ids = sorted({row.run_id for group in rankings.values() for row in group})
    names = list(dict.fromkeys(group[0].interpreter for group in rankings.values()))
    index = {run_id: i for i, run_id in enumerate(run_ids)}
    orders = [
        Ranking.of(names.index(group[0].interpreter), [index[row.run_id] for row in group], [row.rank for row in group])
        for group in rankings.values()
    ]
    summary = _fit(application, run_ids, names, orders)
    _write_scores(ledger, application, summary, set(run_ids))
    return summary


def _fit(application: str, run_ids: Sequence[int], names: Sequence[str], orders: Sequence[Ranking]) -> RankingSummary:
    if not orders:
        return RankingSummary(application, 0, {}, (), ())
    label = connected(orders, len(run_ids))
    main = int(np.argmax(np.bincount(label)))
    joined = np.flatnonzero(label == main)
    place = {int(image): i for i, image in enumerate(joined)}
    inside = [order for order in orders if order.groups[0][0] in place]
    heard = sorted({order.interpreter for order in inside})
    inside = [
        Ranking(heard.index(order.interpreter), tuple(tuple(place[i] for i in group) for group in order.groups))
        for order in inside
    ]
    fit = fit_rankings(inside, len(joined), len(heard))
    scores = {run_ids[i]: (float(fit.scores[k]), float(fit.se[k])) for i, k in place.items()}
    effects = []
    for k, j in enumerate(heard):
        factor = float(np.exp(1.96 * fit.sharpness_log_se[k]))
        sharpness, tau = float(fit.sharpness[k]), float(fit.agreement[k])
        count = sum(order.interpreter == k for order in inside)
        agreement = tau if np.isfinite(tau) else None
        effects.append(InterpreterEffect(names[j], count, sharpness, sharpness / factor, sharpness * factor, agreement))
    apart = tuple(run_id for i, run_id in enumerate(run_ids) if i not in place)
    return RankingSummary(application, len(inside), scores, apart, tuple(effects))


def _write_scores(ledger: Ledger, application: str, summary: RankingSummary, ranked: set[int]) -> None:
    """Insert, overwrite and take back scores so that they are those of the summary."""
    query = sa.select(SCORES.c.run_id, SCORES.c.score, SCORES.c.se).join(RUNS, RUNS.c.id == SCORES.c.run_id)
    query = query.where(SCORES.c.application == application, RUNS.c.state != "void")
    present = {row.run_id: (row.score, row.se) for row in ledger.connection.execute(query)}
    now, changed = utc_now(), 0
    for run_id, (score, se) in summary.scores.items():
        metadata = {"derived": DERIVED, "unit": "logit", "rankings": summary.rankings}
        if run_id not in present:
            ledger.add_scores(run_id, [NewScore(application, score, se, metadata=metadata)], {})
        elif present[run_id] != (score, se):
            where = (SCORES.c.run_id == run_id, SCORES.c.application == application)
            values = {"score": score, "se": se, "metadata": metadata, "scored_at": now}
            ledger.connection.execute(sa.update(SCORES).where(*where).values(**values))
            changed += 1
    for run_id in present.keys() - summary.scores.keys():
        where = (SCORES.c.run_id == run_id, SCORES.c.application == application)
        ledger.connection.execute(sa.delete(SCORES).where(*where))
        if ledger.connection.execute(sa.select(SCORES.c.id).where(SCORES.c.run_id == run_id)).first() is None:
            ledger.connection.execute(sa.update(RUNS).where(RUNS.c.id == run_id).values(state="issued", ended_at=None))
        why = "no ranking joins it with the others" if run_id in ranked else "no ranking of it is left"
        ledger.log("unscored", [(run_id, {"application": application, "reason": why})])
    detail = {"application": application, "rankings": summary.rankings, "runs": len(summary.scores), "changed": changed}
    ledger.log("rankings scored", [(None, detail)])


def _settings_flown(ledger: Ledger, ranking: MeasuredRanking, name: str, problems: list[Problem]) -> dict[int, str]:
    """States of the ranked runs; notes the settings flown where the file tells them."""
    states: dict[int, str] = {}
    for image in ranking.images:
        found = ledger.runs(RUNS.c.id == image.run_id)
        if not found or found[0].state in ("void", "failed"):
            message = f"run {image.run_id} is {found[0].state}" if found else "there is no such run"
            problems.append(Problem(message, "Rank images of proposed runs.", name, image.line, "run_id", image.run_id))
            continue
        states[image.run_id] = found[0].state
        if image.settings is None:
            continue
        if found[0].executed is None:
            values = {"executed": plain(image.settings)}
            ledger.connection.execute(sa.update(RUNS).where(RUNS.c.id == image.run_id).values(**values))
        elif dict(image.settings) != found[0].executed:
            message = f"run {image.run_id} was carried out with other settings"
            problems.append(Problem(message, VOID_FIRST, name, image.line, value=found[0].executed))
    return states


def _refuse_measured(ledger: Ledger, ranking: MeasuredRanking, name: str, problems: list[Problem]) -> None:
    query = sa.select(SCORES.c.run_id, SCORES.c.metadata).join(RUNS, RUNS.c.id == SCORES.c.run_id)
    query = query.where(SCORES.c.application == ranking.application, RUNS.c.state != "void")
    measured = [row.run_id for row in ledger.connection.execute(query) if row.metadata.get("derived") != DERIVED]
    if measured:
        message = f"run {measured[0]} has a measured score of '{ranking.application}'"
        remedy = "Scores are measured or follow from rankings: make the measured ones void first."
        problems.append(Problem(message, remedy, name, ranking.images[0].line, "rank"))


def _by_number(rows: Sequence[RankingRecord]) -> dict[int, list[RankingRecord]]:
    found: dict[int, list[RankingRecord]] = {}
    for row in rows:
        found.setdefault(row.ranking, []).append(row)
    return found


def _identity(rows: Sequence[RankingRecord]) -> tuple[str, str, str, tuple[tuple[int, float], ...]]:
    first = rows[0]
    return first.application, first.interpreter, first.session, tuple(sorted((row.run_id, row.rank) for row in rows))
