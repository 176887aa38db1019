"""Rows that were read without an error and are hardly what was meant: told before anything is taken in.

A frequency in MHz under a header without unit, -9999 for no value, a percentage as a fraction, a decimal point that
slipped, a row that stands twice, a day in another notation, the score of a void run, a column whose name is nearly one
that has a meaning.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.campaign.experiment import see_utilities
from seqrsm.design.factors import CategoricalFactor, NumericFactor, span
from seqrsm.design.region import ROUNDING
from seqrsm.errors import Problem, SpecError
from seqrsm.plain import few, more_rows
from seqrsm.score.cells import WORDS_FOR_NOTHING, is_sentinel
from seqrsm.score.flight import OPTIONAL, MeasuredScore, ScoresFile
from seqrsm.spec.read import CampaignSpec, placed
from seqrsm.store.records import WAITING, IngestedFile, RankingRecord, RunRecord
from seqrsm.store.store import Store
from seqrsm.units import unit_factor, units_like

_NO_REGION = 300.0
"""Coded distance of runs at which nothing is learned of a region, and rounding shows."""
FAR = 3.0
"""Coded distance from the centre beyond which a setting is far outside: the region's own width beyond its edge."""
_ROUNDED_ENDS = 0.02
"""Share of a range by which its ends may have been rounded when its unit was changed."""
_CLOSE = 5.0
"""Ratio below which two units are close: a metre has 3.3 feet."""
_LEAST_TIMES = 3
"""Flights of a day, with a run each, may be two."""
_LEAST_SCORES = 6
_SPREADS = 10.0
"""A score is far from the others when it is so many of their standard deviations (by quartiles) from their median."""
_LEAST_SPREAD = 0.02
"""Of the median: scores that hardly differ are no measure of what is far."""

_DAY = re.compile(r"(\d{1,4})([-/.])(\d{1,2})\2(\d{2,4})(?:[T ][0:.]+)?")
"""A day as spreadsheets write it: 2026-02-03, 03.02.2026, 2/3/26."""
_TIME = re.compile(r"(.*\d)[T ]+\d{1,2}:\d{2}\S*(?: ?[ap]m)?", re.IGNORECASE)
"""A day with the time: 2026-02-03T09:30:00+02:00, 2/3/26 9:30 am."""
_DIGITS = re.compile(r"(?<!\d)(\d{4})(\d{2})(\d{2})(?!\d)")
"""A day as files are named by it: 20260203."""
_IDLE = re.compile(r"[\s_]|(?<![\d.])0+(?=\d)|(?<=\d)\.0+(?![\d.])")
"""What may differ in a name: blanks, and the zeros of 07 and 7.0."""

_Found = Iterator[tuple[MeasuredScore, str, object, str, str]]
"""Row, column, value, what is wrong with it, and what may have been meant."""


def suspects(spec: CampaignSpec, file: ScoresFile, runs: Sequence[RunRecord]) -> list[Problem]:
    """What looks wrong in a file of scores beside the runs of earlier ones, alike rows together."""
    scored = [run for run in runs if run.state == "scored"]
    problems = []
    for own, meant in file.near:
        text = f"the column is kept as your own, but its name resembles '{meant}'"
        text = f"the campaign takes blocks from the column '{meant}'" if own == "block" else text
        problems.append(Problem(text, f"Name it '{meant}'.", file.name, field=own))
    groups: dict[tuple[str, str, str], list[tuple[MeasuredScore, object]]] = {}
    for row, column, value, message, hint in (
        *_settings(spec, file),
        *_scores(spec, file, scored),
        *_blocks(spec, file, runs),
        *_times(spec, file),
        *_twice(file),
        *_corrections(spec, file, scored),
        *_void(file, runs),
        *_waiting(file, runs),
        *_told_void(file),
        *_to_be_simulated(file, runs if spec.simulator else ()),
    ):
        groups.setdefault((column, message, hint), []).append((row, value))
    for (column, message, hint), rows in groups.items():
        first, value = rows[0]
        more = more_rows([row.line for row, _ in rows[1:]])
        problems.append(Problem(message + more, hint, file.name, first.line, column, value))
    return problems


def _correct(what: object) -> str:
    return f"If this corrects it, first: seqrsm void DIR {what} --why TEXT"


def ranking_suspects(file: IngestedFile, stored: Sequence[RankingRecord]) -> Iterator[Problem]:
    """Rankings of images that the same interpreter has ranked in the same session: corrected or extended ones."""
    earlier: dict[tuple[int, str, str, str], dict[int, float]] = {}
    for row in stored:
        if not row.reason:
            earlier.setdefault((row.ranking, row.application, row.interpreter, row.session), {})[row.run_id] = row.rank
    for new in file.rankings:
        ranks = {image.run_id: image.rank for image in new.images}
        whose = new.application, new.interpreter, new.session
        same = {number: old for (number, *who), old in earlier.items() if tuple(who) == whose}
        for number, old in same.items():
            if ranks not in same.values() and (ranks.keys() <= old.keys() or ranks.keys() >= old.keys()):
                message = f"{new.interpreter} has ranked these images before, in ranking {number}"
                hint = f"{_correct(f'--ranking {number}')}. Else name a session."
                yield Problem(message, hint, file.name, new.images[0].line, "interpreter", new.interpreter)


def see_meaning(store: Store, spec: CampaignSpec, runs: Sequence[RunRecord]) -> None:
    """Refuse settings in another unit and scores of another utility than ``campaign.toml`` tells now, see there."""
    see_units(spec, runs)
    see_utilities(store, spec, runs)


def see_units(spec: CampaignSpec, runs: Sequence[RunRecord]) -> None:
    """Refuse a unit that is not the one of the settings in the store, which are numbers, and a slip in a range.

    SpecError where of the scored runs some lie outside the factor's range, and none would in another unit; or all, and
    few would. Or some are so far away that rounding shows.
    """
    for k, factor in enumerate(spec.factors):
        if isinstance(factor, CategoricalFactor):
            continue
        found = (run.settings.get(factor.name, "") for run in runs if run.state == "scored")
        values = [value for value in found if not isinstance(value, str)]  # once a level: refused where it is coded
        inside = {
            unit: sum(_fits(factor, value, unit, _ROUNDED_ENDS) for value in values)
            for unit in (factor.unit, *units_like(factor.unit))
        }
        own, n = inside.pop(factor.unit), len(values)
        for unit, others in inside.items():
            # A region may move off all runs: into another that close units also give, for a good reason.
            if own < others == n if own else 2 * others > n and not _close(unit, factor.unit):
                message = f"{own} of {n} scored runs lie in the range of '{factor.name}', and {others} would if their"
                message, remedy = f"{message} settings were in {unit}", "Restore unit and range, or void the runs."
                problem = Problem(message, remedy, field="unit", value=factor.unit)
                raise SpecError(placed(spec, problem, "factor", k, "unit"))
        codable = [value for value in values if value > 0.0 or factor.scale == "linear"]
        if np.max(np.abs(factor.code(codable)), initial=0.0) > _NO_REGION:
            message = f"scored runs lie more than a hundred times the width of the range of '{factor.name}' outside it"
            problem = Problem(message, "Restore it, or void those runs.", field="range", value=span(factor))
            raise SpecError(placed(spec, problem, "factor", k))


def _settings(spec: CampaignSpec, file: ScoresFile) -> _Found:
    for factor in spec.factors:
        if isinstance(factor, CategoricalFactor):
            continue
        low, high = span(factor)
        for row in file.scores:
            value = float(row.settings[factor.name])
            coded = abs(float(factor.code([value])[0]))
            if coded <= 1.0 + ROUNDING:
                continue
            unit = next((one for one in units_like(factor.unit) if _fits(factor, value, one)), "")
            if coded > FAR or (unit and not _close(unit, factor.unit)):
                where = f"far outside {low:g} to {high:g} {factor.unit}".rstrip()
                meant = f"Did you mean {unit}? Then write the header as: {factor.name} [{unit}]"
                yield row, factor.name, value, where, meant if unit else "Correct it."


def _fits(factor: NumericFactor, value: float, unit: str, margin: float = 0.0) -> bool:
    """Whether the value would lie within the range, and a share ``margin`` of it beyond, if it were in this unit."""
    low, high = span(factor)
    scale, beyond = unit_factor(unit, factor.unit), margin * (high - low)
    return scale is not None and low - beyond <= value * scale <= high + beyond


def _close(unit: str, other: str) -> bool:
    """Whether units differ so little that a setting just outside the region would lie inside it in the other."""
    scale = unit_factor(unit, other)
    return scale is not None and 1.0 / _CLOSE < scale < _CLOSE


def _scores(spec: CampaignSpec, file: ScoresFile, runs: Sequence[RunRecord]) -> _Found:
    for application in spec.applications:
        known = [score.score for run in runs if (score := run.score_of(application.name)) is not None]
        rows = [row for row in file.scores if row.application == application.name]
        new = [row.score for row in rows]
        values = np.array([*new, *known])
        percent = application.score_unit in ("percent", "%") and application.goal == "maximize"
        fractions = percent and min(values, default=0.0) >= 0.0 and 0.0 < max(values, default=0.0) <= 1.0
        far = _far(values) & (not application.is_percent)  # a percentage has bounds, and near them scores crowd
        for row, is_far in zip(rows, far, strict=False):
            alone, found = len(values) < _LEAST_SCORES, None
            if is_sentinel(row.score) and (is_far or alone) and not application.is_percent:
                found = "usually marks a missing value", "Leave the cell empty if there is none."
            elif application.is_percent and row.n is None and 0.0 < row.score <= 1.0 and np.median(values) > 5.0:
                found = "a fraction among percentages", f"Did you mean {100 * row.score:g} percent?"
            elif fractions:
                found = "no score is above 1 percent", "Are they fractions? Give percentages."
            elif is_far:
                others = np.delete(values, np.flatnonzero(far))
                ends = f"{others.min():g} to {others.max():g}"
                found = f"far from all other scores, {ends}", _slip(row.score, others)
            if found is not None:
                yield row, "score", row.score, *found
        for row in rows:
            if spec.of_counts and row.n is None:
                yield row, "n", None, "no counts, which [model] needs", "Give n and correct."
            if row.se is not None and is_sentinel(row.se):
                yield row, "se", row.se, "usually marks a missing value", "Leave the cell empty if it is unknown."


def _far(values: FloatArray) -> np.ndarray:
    """Which of the scores are far from most of them; none where they are few."""
    if len(values) < _LEAST_SCORES:
        return np.zeros(len(values), dtype=np.bool_)
    low, middle, high = np.quantile(values, [0.25, 0.5, 0.75])
    spread = max((high - low) / 1.349, _LEAST_SPREAD * abs(middle))
    return np.abs(values - middle) > _SPREADS * spread if spread > 0.0 else np.zeros(len(values), dtype=np.bool_)


def _slip(score: float, others: FloatArray) -> str:
    """What a score may have been meant to be: a power of ten away, or of the other sign."""
    for factor in (0.1, 0.01, 0.001, 10.0, 100.0, 1000.0, -1.0):
        if others.min() <= score * factor <= others.max():
            return f"Did you mean {score * factor:g}?"
    return "Correct it."


def block_of(spec: CampaignSpec, score: MeasuredScore) -> str:
    """What stands in a row's column of blocks."""
    column = spec.model.block
    if column is None or column == "block":
        return score.block
    if column in ("source", "date", "note"):
        return str(getattr(score, column))
    return score.metadata.get(column, "")


def _blocks(spec: CampaignSpec, file: ScoresFile, runs: Sequence[RunRecord]) -> _Found:
    """Blocks that differ from an earlier one by notation alone: each would be a day of its own; flights without one."""
    column, by_id = spec.model.block or "", {run.run_id: run for run in runs}
    known = [block for block in dict.fromkeys(run.block for run in runs) if block]
    for row in file.scores if column else ():
        block, run = block_of(spec, row), by_id.get(row.run_id or 0)
        other = block if block in known else next((one for one in known if _alike(one, block)), "")
        none = not block or (not other and block.casefold() in WORDS_FOR_NOTHING)
        if run is not None and is_moved(spec, row, run):
            hint = _correct(run.run_id)
            own = f"the block '{run.block}'" if run.block else "no block"
            yield row, column, block, f"run {run.run_id} is of {own}", hint
        elif none and row.source != "simulation" and not (run and run.block):
            message, hint = "no block", "Fill it in: of merged cells only the first row has the content."
            if column not in (*OPTIONAL, *row.metadata):
                own = f", or name a column of yours so: {', '.join(row.metadata)}" if row.metadata else "."
                message, hint = "there is no such column", f"Add it{own}"
            yield row, column, block or None, message, hint
        elif block and not other:
            known.append(block)
        elif other != block:
            message = f"the block '{other}' differs by case, blanks or notation alone"
            yield row, column, block, message, f"Write {other}."


def _times(spec: CampaignSpec, file: ScoresFile) -> _Found:
    """Blocks that are the times of single runs, which leave no two runs of a day to tell how days differ."""
    of_day: dict[tuple[str, str], list[tuple[str, MeasuredScore]]] = {}
    for row in file.scores if spec.model.block else ():
        if told := _TIME.fullmatch(block := block_of(spec, row)):
            of_day.setdefault((told[1], row.application), []).append((block, row))
    for (day, _), rows in of_day.items():
        if len({block for block, _ in rows}) == len(rows) >= _LEAST_TIMES:
            message = f"each run of {day} has a time of its own, and so a block of its own"
            for block, row in rows:
                yield row, spec.model.block or "", block, message, "Write the day alone."


def is_moved(spec: CampaignSpec, score: MeasuredScore, run: RunRecord) -> bool:
    """Whether a row says that its run, which is scored, is of another block."""
    block = block_of(spec, score)
    return bool(spec.model.block and block) and run.state == "scored" and not _alike(run.block, block)


def _alike(one: str, other: str) -> bool:
    """Whether texts differ at most in case, blanks, or the notation of a day; of 3.2. and 2.3. neither is the other."""
    days = [_DAY.fullmatch(_DIGITS.sub(r"\1-\2-\3", text.strip())) for text in (one, other)]
    if not (days[0] and days[1]):
        return _IDLE.sub("", one.casefold()) == _IDLE.sub("", other.casefold())
    numbers = [[int(day[k]) % 2000 for k in (1, 3, 4)] for day in days if day]
    same = days[0][2] == days[1][2] and (len(days[0][1]) == 4) == (len(days[1][1]) == 4)
    return numbers[0] == numbers[1] if same else sorted(numbers[0]) == sorted(numbers[1])


def _twice(file: ScoresFile) -> _Found:
    """Rows that say the same as an earlier one in every column."""
    first: dict[str, int] = {}
    for row in file.scores:
        line = first.setdefault(repr(replace(row, line=0)), row.line)
        if line != row.line:
            hint = "Remove it; a true repeat must differ in a column such as date or note."
            yield row, "row", None, f"the same as line {line} in every column", hint


def _corrections(spec: CampaignSpec, file: ScoresFile, runs: Sequence[RunRecord]) -> _Found:
    """Rows of an earlier date or block that differ from a run there in the score, or in notation, alone."""
    for row in file.scores:
        block = block_of(spec, row)
        told = {**row.metadata, **{key: text for key in ("date", "note") if (text := getattr(row, key))}}
        for run in runs if row.run_id is None else ():
            old = run.score_of(row.application)
            if old is None or not old.source_file or run.settings != row.settings or not _alike(run.block, block):
                continue
            shared = [(text, old.metadata[name]) for name, text in told.items() if name in old.metadata]
            dated = block or ("date" in told and "date" in old.metadata)
            if dated and all(text == other or _alike(text, str(other)) for text, other in shared):
                found = f"run {run.run_id} has score {old.score:g} and the rest is the same"
                hint = _correct(run.run_id)
                if old.score == row.score:
                    found = f"run {run.run_id} has this score, and the rest is the same but for notation or se"
                    hint = "Remove the row, or write it as before"
                yield row, "score", row.score, found, f"{hint}. A true repeat must differ in a column such as note."
                break


def _void(file: ScoresFile, runs: Sequence[RunRecord]) -> _Found:
    """Scores of void runs that no other run has replaced: a form that comes again still has them."""
    replaced = {run.replaces for run in runs}
    void = {run.run_id: run for run in runs if run.state == "void" and run.run_id not in replaced}
    for row in file.scores:
        run = void.get(row.run_id or 0)
        old = run.score_of(row.application) if run is not None else None
        if run is not None and old is not None and old.score == row.score:
            found = f"run {run.run_id} is void ({run.reason}) and had this score"
            yield row, "score", row.score, found, "Leave the cell empty, or use --accept to make it count again."


def _told_void(file: ScoresFile) -> _Found:
    """Scores of runs that a column of the user's own, a note, or the state in an export calls void."""
    for row in file.scores:
        told = {**row.metadata, "note": row.note}
        for column, text in told.items():
            if text.casefold().startswith(("void", "invalid")):
                message, hint = "the run is told to be void and has a score", "Empty its score, or remove the row."
                yield row, column, text, message, hint


def _waiting(file: ScoresFile, runs: Sequence[RunRecord]) -> _Found:
    """Scores without a run id of flights that were proposed: as new runs they would leave them to be flown again."""
    waiting = [run for run in runs if run.state in WAITING and run.source == "flight"]
    rows = [row for row in file.scores if row.run_id is None and row.source != "simulation"]
    meant = [run.run_id for run in waiting if any(row.settings == run.proposed for row in rows)]
    hint = f"Give the run ids ({few(meant)}) in a column run_id, or use --accept if these are other flights"
    for row in rows:
        if any(row.settings == run.proposed for run in waiting):
            yield row, "run_id", None, "settings of a flight that waits for its score", hint


def _to_be_simulated(file: ScoresFile, runs: Sequence[RunRecord]) -> _Found:
    """Scores without a source of runs that were proposed as simulations: as flights they would count as simulated."""
    own = {run.run_id for run in runs if run.source == "simulation" and run.state != "scored"}
    for row in file.scores:
        if row.run_id in own and not row.source:
            hint = "If it was flown, add a column source with the word flight."
            yield row, "run_id", row.run_id, "this run was proposed as a simulation", hint
