"""Measured scores and rankings into the store, within one transaction: matched, added, recognised, or all refused.

Interpreters' rankings are kept as handed in; scores follow from all of them, and are made anew. A new ranking changes
every score of its application a little: they are relative. So scores of ranked applications are no measurements but
results, the only rows of the store that are overwritten; every change is an event.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import sqlalchemy as sa

from seqrsm.errors import Problem, StoreError
from seqrsm.plain import more_rows, plain
from seqrsm.score.ranking import Ranking, connected, fit_rankings
from seqrsm.store.database import utc_now
from seqrsm.store.ledger import VOID_FIRST, Ledger
from seqrsm.store.records import (
    DERIVED,
    EqualRow,
    FileRecord,
    IngestedFile,
    IngestedRun,
    IngestOutcome,
    InterpreterEffect,
    NewRun,
    NewScore,
    RankingRecord,
    RankingSummary,
    RunRecord,
    ScoreRecord,
)
from seqrsm.store.schema import FILES, RANKINGS, RUNS, SCORES

if TYPE_CHECKING:
    from seqrsm.score.ranking_file import MeasuredRanking


def ingest_files(ledger: Ledger, files: Sequence[IngestedFile]) -> tuple[IngestOutcome, ...]:
    """Match measured scores to runs, make runs for those nobody proposed; StoreError with every problem."""
    problems: list[Problem] = []
    outcomes = tuple(_ingest(ledger, file, problems) for file in files)
    if problems:
        raise StoreError(*problems)
    return outcomes


def _ingest(ledger: Ledger, file: IngestedFile, problems: list[Problem]) -> IngestOutcome:
    same = tuple(ledger.records(FileRecord, FILES, FILES.c.sha256 == file.sha256))
    already = same[0] if same else None
    query = sa.select(RUNS.c.replaces, RUNS.c.id).where(RUNS.c.replaces.is_not(None))
    heirs = {row.replaces: row.id for row in ledger.connection.execute(query)}
    void = {run.run_id for run in ledger.runs(RUNS.c.state == "void")} - heirs.keys()
    # The same content may bring back what was made void since.
    if already is not None and not (void and any(run.run_id is None or run.run_id in void for run in file.runs)):
        return IngestOutcome(already=already)
    before, batch = len(problems), ledger.last_batch() + 1
    rows = _Rows(ledger, file, heirs, problems)
    for run in file.runs:
        rows.take(run)
    rows.refuse_strange()
    _create(ledger, rows.fresh, batch)
    numbers, n_ranks, ranked_runs = add_rankings(ledger, file, problems)
    if len(problems) > before:
        return IngestOutcome()
    applications = dict.fromkeys(ranking.application for ranking in file.rankings)
    ranked = tuple(score_rankings(ledger, application) for application in applications) if numbers else ()
    row = {"name": file.name, "sha256": file.sha256, "row_count": file.row_count}
    scored = bool(rows.matched or rows.created)
    if already is None:
        ledger.connection.execute(sa.insert(FILES).values(**row, ingested_at=utc_now()))
    elif not (scored or any(row.state == "void" for row in rows.equal)):
        return IngestOutcome(already=already)
    if already is None or scored:
        detail = {**row, "matched": rows.matched, "created": rows.created}
        ledger.log("ingested", [(None, {**detail, **({"rankings": numbers} if numbers else {})})])
    return IngestOutcome(
        n_new=rows.n_new + n_ranks,
        matched=tuple(rows.matched) + ranked_runs,
        created=tuple(rows.created),
        replaced=tuple(rows.replaced),
        unchanged=tuple(rows.unchanged),
        equal=tuple(rows.equal),
        moved=tuple(rows.moved),
        rankings=numbers,
        ranked=ranked,
    )


class _Rows:
    """What becomes of a file's rows of measured scores, as `IngestOutcome` has it, one row after another."""

    def __init__(
        self, ledger: Ledger, file: IngestedFile, heirs: Mapping[int | None, int], problems: list[Problem]
    ) -> None:
        self._ledger, self._name, self._problems = ledger, file.name, problems
        self._heirs = heirs  # of void runs, by their ids
        nameless = any(run.run_id is None for run in file.runs)
        self._known = _KnownRuns(ledger.runs(sa.true())) if nameless else None
        self._ranked = set(ledger.connection.execute(sa.select(RANKINGS.c.application).distinct()).scalars())
        self._first = ledger.next_id()
        self._strange: list[tuple[int | None, int]] = []
        self.fresh: list[tuple[IngestedRun, RunRecord | None]] = []
        self.n_new = 0
        self.matched: list[int] = []
        self.created: list[int] = []
        self.replaced: list[tuple[int, int]] = []
        self.unchanged: list[int] = []
        self.equal: list[EqualRow] = []
        self.moved: list[int] = []

    def take(self, run: IngestedRun) -> None:
        """Add a row's scores to the run that it names; what is to be a new run is kept in `fresh`."""
        _refuse_ranked(self._ranked, run, self._name, self._problems)
        run, twin = self._without_known(run)
        wanted = run.run_id if twin is None else twin.run_id
        while twin is None and wanted in self._heirs:
            wanted = self._heirs[wanted]
        found = () if wanted is None else self._ledger.runs(RUNS.c.id == wanted)
        old = found[0] if found else None
        if twin is not None and (twin.state == "void" or not run.scores):
            self.unchanged.append(twin.run_id)
        elif wanted is not None and old is None:
            self._strange.append((run.scores[0].source_row, wanted))
        elif old is None or old.state == "void":
            self.created.append(self._first + len(self.fresh))
            self.n_new += len(run.scores)
            self.fresh.append((run, old))
            if old is not None:
                self.replaced.append((old.run_id, self.created[-1]))
        elif added := _match(self._ledger, run, old, self._name, self._problems):
            self.n_new += added
            self.matched.append(old.run_id)
            if dict(run.settings) != old.proposed:
                self.moved.append(old.run_id)
        else:
            self.unchanged.append(run.run_id or old.run_id)

    def _without_known(self, run: IngestedRun) -> tuple[IngestedRun, RunRecord | None]:
        """A row without the scores that earlier files brought, and the run that has them; None: there is none."""
        if self._known is None or run.run_id is not None:
            return run, None
        twin = again = self._known.take(run)
        while again is not None:
            new = tuple(score for score in run.scores if again.score_of(score.application) is None)
            old = [score for score in run.scores if score not in new]
            self.equal += [EqualRow(score.source_row, again.run_id, again.state) for score in old]
            run = replace(run, scores=new)
            # An earlier file may have told the scores of this run as those of several.
            again = self._known.take(run) if new else None
        return run, twin

    def refuse_strange(self) -> None:
        """Note rows that name no run."""
        if self._strange:
            (line, wanted), *others = self._strange
            message = "there is no such run" + more_rows([row for row, _ in others])
            remedy = "Give the id of a proposed run, or leave the cell empty for a run nobody proposed."
            if self._first == 1:  # as of an export
                remedy = "This campaign has no runs yet: remove the column run_id, and rows of void runs."
            self._problems.append(Problem(message, remedy, self._name, line, "run_id", wanted))


_ROUNDED = 0.5
"""Percent by which a score may differ from that of its counts; a file is refused where it differs more."""


class _KnownRuns:
    """Measured runs of earlier files, each to be taken once by a row that says the same.

    A file that was saved anew, or has grown, or has lost its run ids, brings its rows again: a row that has the same
    settings, block and scores, and the same in every column that both have, is that row. Real repeats differ, at least
    in the date or a note, or stand in one file, where each row takes another run.
    """

    def __init__(self, runs: Iterable[RunRecord]) -> None:
        self._free: dict[object, list[RunRecord]] = {}
        for run in runs:
            for key in {_key(run.settings, score) for score in run.scores if score.source_file}:
                self._free.setdefault(key, []).append(run)
        self._taken: set[int] = set()

    def take(self, new: IngestedRun) -> RunRecord | None:
        """The run that ``new`` repeats; it is not given again."""
        for run in self._free.get(_key(new.settings, new.scores[0]), ()):
            if run.run_id not in self._taken and new.block in ("", run.block) and _repeats(new.scores, run):
                self._taken.add(run.run_id)
                return run
        return None


def _key(settings: Mapping[str, float | str], score: NewScore | ScoreRecord) -> object:
    return tuple(sorted(settings.items())), score.application


def _repeats(scores: Sequence[NewScore], run: RunRecord) -> bool:
    """Whether a run has these scores, as far as it has scores of their applications."""
    pairs = [(new, old) for new in scores if (old := run.score_of(new.application)) is not None]
    return bool(pairs) and all(
        _same_number(new, old)
        and all(old.metadata[name] == value for name, value in new.metadata.items() if name in old.metadata)
        for new, old in pairs
    )


def _same_number(new: NewScore, old: ScoreRecord) -> bool:
    """Whether the scores are equal, or percentages of the same counts, of which one may be rounded."""
    if _is_share(new) and _is_share(old):
        return (new.n, new.correct) == (old.n, old.correct)
    pairs = ((new.score, old.score), (new.se, old.se), (new.n, old.n), (new.correct, old.correct))
    return all(one == other for one, other in pairs if one is not None and other is not None)


def _is_share(score: NewScore | ScoreRecord) -> bool:
    if score.n is None or score.correct is None:
        return False
    return abs(score.score - 100.0 * score.correct / score.n) <= _ROUNDED


def _made_elsewhere(run_id: int, settings: Mapping[str, float | str], name: str, line: int | None) -> Problem:
    """A row of other settings than its run was made at."""
    told = ", ".join(f"{key} {value if isinstance(value, str) else f'{value:g}'}" for key, value in settings.items())
    return Problem(f"run {run_id} was made at other settings: {told}", VOID_FIRST, name, line)


def _match(ledger: Ledger, run: IngestedRun, old: RunRecord, name: str, problems: list[Problem]) -> int:
    """Add measured scores to a proposed run; how many: 0 when they are there already or cannot be added."""
    faults, fresh = ledger.new_scores(old.run_id, run.scores)
    if (old.executed is not None or old.state == "scored") and dict(run.settings) != old.settings:
        faults.append(_made_elsewhere(old.run_id, old.settings, name, run.scores[0].source_row))
    problems += faults
    if faults or not fresh:
        return 0
    values = {"executed": plain(run.settings), "source": run.source or old.source, "block": run.block or old.block}
    if values["source"] != old.source:
        values["cost"] = run.cost
    ledger.add_scores(old.run_id, fresh, values)
    return len(fresh)


def _create(ledger: Ledger, fresh: Sequence[tuple[IngestedRun, RunRecord | None]], batch: int) -> None:
    """Insert runs that nobody proposed, and runs in the place of void ones, with their scores."""
    if not fresh:
        return
    made, values = [], []
    for run, old in fresh:
        if old is None:
            made.append(NewRun(run.settings, "measured", "measured without a proposal", run.source or "flight"))
        else:
            why = f"takes the place of run {old.run_id}, which is void"
            made.append(NewRun(old.proposed, old.purpose, why, run.source or old.source))
        other: dict[str, Any] = {
            "state": "scored",
            "ended_at": utc_now(),
            "executed": plain(run.settings),
            "block": run.block or ("" if old is None else old.block),
            "cost": float(run.cost),
            "replaces": None if old is None else old.run_id,
        }
        values.append(other)
    ids = ledger.add_runs(made, batch=batch, made=values)
    ledger.insert_scores([(run_id, score) for run_id, (run, _) in zip(ids, fresh, strict=True) for score in run.scores])


def _refuse_ranked(ranked: set[str], run: IngestedRun, name: str, problems: list[Problem]) -> None:
    """An application's scores are measured, or come from rankings; they cannot be both."""
    for score in run.scores:
        if score.application in ranked:
            message = f"the scores of '{score.application}' come from rankings"
            remedy = "Give rankings: run_id, interpreter, rank."
            problems.append(Problem(message, remedy, file=name, line=score.source_row, field="score"))


def add_rankings(
    ledger: Ledger, file: IngestedFile, problems: list[Problem]
) -> tuple[tuple[int, ...], int, tuple[int, ...]]:
    """Keep the rankings of a file that are not there yet: their numbers, ranks, and the runs without a score before."""
    if not file.rankings:
        return (), 0, ()
    stored = tuple(ledger.records(RankingRecord, RANKINGS))
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
    return tuple(numbers), len(rows), tuple(waiting)


def void_ranking(ledger: Ledger, ranking: int, why: str) -> None:
    """Take one ranking out of the scores."""
    query = sa.select(RANKINGS.c.application, RANKINGS.c.reason).where(RANKINGS.c.ranking == ranking)
    row = ledger.connection.execute(query.limit(1)).first()
    if row is None:
        raise StoreError("there is no such ranking", "`seqrsm export` lists them.", field="ranking", value=ranking)
    if row.reason:
        raise StoreError(f"ranking {ranking} is already void: {row.reason}", field="ranking", value=ranking)
    ledger.connection.execute(sa.update(RANKINGS).where(RANKINGS.c.ranking == ranking).values(reason=why))
    ledger.log("void ranking", [(None, {"ranking": ranking, "reason": why})])
    score_rankings(ledger, row.application)


def rescore_without(ledger: Ledger, run_id: int) -> None:
    """Make the scores anew of the applications in which a run, void now, was ranked."""
    query = sa.select(RANKINGS.c.application).where(RANKINGS.c.run_id == run_id).distinct()
    for application in ledger.connection.execute(query.order_by(RANKINGS.c.application)).scalars().all():
        score_rankings(ledger, application)


def score_rankings(ledger: Ledger, application: str) -> RankingSummary:
    """Make the scores of an application's runs those of all rankings that count: insert, overwrite and take back."""
    summary = ranking_summary(ledger, application)
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
        why = "no ranking joins it with the others" if run_id in summary.apart else "no ranking of it is left"
        ledger.log("unscored", [(run_id, {"application": application, "reason": why})])
    detail = {"application": application, "rankings": summary.rankings, "runs": len(summary.scores), "changed": changed}
    ledger.log("rankings scored", [(None, detail)])
    return summary


def ranking_summary(ledger: Ledger, application: str) -> RankingSummary:
    """What all rankings of an application that count say.

    Runs that no chain of rankings joins with the largest group of runs get no score: rankings say nothing of how
    they compare.
    """
    where = (RANKINGS.c.application == application, RANKINGS.c.reason == "")
    rows = list(ledger.records(RankingRecord, RANKINGS, *where))
    ranked = {run.run_id: run for run in ledger.runs(RUNS.c.id.in_({row.run_id for row in rows}))}
    rows = [row for row in rows if ranked[row.run_id].state != "void"]
    rankings = {number: group for number, group in _by_number(rows).items() if len(group) > 1}
    run_ids = sorted({row.run_id for group in rankings.values() for row in group})
    names = list(dict.fromkeys(group[0].interpreter for group in rankings.values()))
    index = {run_id: i for i, run_id in enumerate(run_ids)}
    orders = [
        Ranking.of(names.index(group[0].interpreter), [index[row.run_id] for row in group], [row.rank for row in group])
        for group in rankings.values()
    ]
    return _fit(application, [ranked[run_id] for run_id in run_ids], names, orders)


def _fit(name: str, runs: Sequence[RunRecord], names: Sequence[str], orders: Sequence[Ranking]) -> RankingSummary:
    if not orders:
        return RankingSummary(name, 0, {}, 0.0, (), ())
    label = connected(orders, len(runs))
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
    # Later batches are better: the mean of all would move between the looks of a campaign.
    first = min(runs[i].batch for i in place)
    zero = np.mean([fit.scores[k] for i, k in place.items() if runs[i].batch == first])
    scores = {runs[i].run_id: (float(fit.scores[k] - zero), float(fit.se[k])) for i, k in place.items()}
    effects = []
    for k, j in enumerate(heard):
        factor = float(np.exp(1.96 * fit.sharpness_log_se[k]))
        sharpness, tau = float(fit.sharpness[k]), float(fit.agreement[k])
        count = sum(order.interpreter == k for order in inside)
        agreement = tau if np.isfinite(tau) else None
        effects.append(InterpreterEffect(names[j], count, sharpness, sharpness / factor, sharpness * factor, agreement))
    apart = tuple(run.run_id for i, run in enumerate(runs) if i not in place)
    return RankingSummary(name, len(inside), scores, fit.scale_se, apart, tuple(effects))


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
            ledger.log_settings(image.run_id, image.settings)
        elif dict(image.settings) != found[0].executed:
            problems.append(_made_elsewhere(image.run_id, found[0].executed, name, image.line))
    return states


def _refuse_measured(ledger: Ledger, ranking: MeasuredRanking, name: str, problems: list[Problem]) -> None:
    query = sa.select(SCORES.c.run_id, SCORES.c.metadata).join(RUNS, RUNS.c.id == SCORES.c.run_id)
    query = query.where(SCORES.c.application == ranking.application, RUNS.c.state != "void")
    measured = [row.run_id for row in ledger.connection.execute(query) if row.metadata.get("derived") != DERIVED]
    if measured:
        message = f"run {measured[0]} has a measured score of '{ranking.application}'"
        remedy = "Scores are measured or come from rankings: make the measured ones void first."
        problems.append(Problem(message, remedy, name, ranking.images[0].line, "rank"))


def _by_number(rows: Sequence[RankingRecord]) -> dict[int, list[RankingRecord]]:
    found: dict[int, list[RankingRecord]] = {}
    for row in rows:
        found.setdefault(row.ranking, []).append(row)
    return found


def _identity(rows: Sequence[RankingRecord]) -> tuple[str, str, str, tuple[tuple[int, float], ...]]:
    first = rows[0]
    return first.application, first.interpreter, first.session, tuple(sorted((row.run_id, row.rank) for row in rows))
