"""What the store gives and takes: frozen records without any data base in them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from types import UnionType
from typing import TYPE_CHECKING, Any, TypeAlias, get_args, get_origin, get_type_hints

if TYPE_CHECKING:
    from seqrsm.score.ranking_file import MeasuredRanking

Settings: TypeAlias = dict[str, float | str]

WAITING = ("issued", "running")
"""States of runs that are still to be scored."""

CONFIRMATION = "confirmation"
"""Purpose of the fresh runs at the recommended settings; they stay out of the fit."""

DERIVED = "Plackett-Luce"
"""Mark, in their metadata, of scores that are no measurements but results of rankings."""


@dataclass(frozen=True, slots=True)
class NewRun:
    """A run to be proposed."""

    settings: Mapping[str, float | str]
    """Natural units, by factor name."""
    purpose: str = ""
    why: str = ""
    """Short word ("start", "optimum", "repeat", ...) and a sentence."""
    source: str = "simulation"
    """Either "simulation" or "flight": who is to carry it out."""
    cost: float = 1.0
    """In the campaign's cost unit."""
    block: str = ""
    """Block label, "" where there are no blocks."""


@dataclass(frozen=True, slots=True)
class NewScore:
    """The score of one application in a run."""

    application: str
    """Name in campaign.toml."""
    score: float
    """Finite, in score units."""
    se: float | None = None
    """Standard error, > 0, in score units."""
    n: int | None = None
    correct: int | None = None
    """Binomial counts."""
    metadata: Mapping[str, Any] = field(default_factory=dict)
    """Anything that JSON can hold; numpy values are converted, nan becomes null."""
    source_file: str = ""
    source_row: int | None = None
    """Where it was read; the row is the line of the file."""


@dataclass(frozen=True, slots=True)
class ScoreRecord:
    """A stored score; attributes as of `NewScore`, with the run and the time (UTC, ISO 8601)."""

    run_id: int
    application: str
    score: float
    se: float | None
    n: int | None
    correct: int | None
    metadata: dict[str, Any]
    source_file: str
    source_row: int | None
    scored_at: str


@dataclass(frozen=True, slots=True)
class RunRecord:
    """A stored run; ``purpose``, ``why``, ``source``, ``block`` and ``cost`` as of `NewRun`, times UTC, ISO 8601."""

    run_id: int
    """From 1 in the order of proposal; never a hash of settings, so repeats are ordinary runs."""
    batch: int
    """From 1."""
    purpose: str
    why: str
    source: str

    state: str
    """One of "issued", "running", "scored", "failed" and "void"."""
    proposed: Settings
    executed: Settings | None
    """Settings asked for, and those really flown or simulated where they were recorded."""
    block: str
    cost: float

    reason: str = ""
    """Why it failed or was made void."""
    attempts: int = 0
    """How often it was begun."""
    owner: str = ""
    """Process that runs it, "host:pid:token", "" otherwise."""
    replaces: int | None = None
    """The void run whose place it takes."""
    proposed_at: str = ""
    issued_at: str | None = None
    started_at: str | None = None
    ended_at: str | None = None

    seen_at: str | None = None
    """When the process that runs it last said so."""
    fault: str = ""
    """Where a failure lies: "settings", "machine" or "unknown"; "" where it did not fail, and of older failures."""
    scores: tuple[ScoreRecord, ...] = ()
    """One for each application scored, in the order of scoring."""

    @property
    def settings(self) -> Settings:
        """Executed settings where recorded, else the proposed ones."""
        return self.proposed if self.executed is None else self.executed

    def score_of(self, application: str) -> ScoreRecord | None:
        """The score of an application, or None."""
        return next((score for score in self.scores if score.application == application), None)


@dataclass(frozen=True, slots=True)
class LookRecord:
    """What one look at the data found."""

    look: int
    """From 1."""
    after_run: int
    """Number of scored runs that the look was based on."""
    application: str
    """Name in campaign.toml."""
    summary: dict[str, Any]
    """The analysis in short; plain JSON values, null for what was undefined."""
    looked_at: str
    """UTC, ISO 8601."""


@dataclass(frozen=True, slots=True)
class EventRecord:
    """One change: number from 1, time (UTC, ISO 8601), program version, campaign seed, run, kind, details, and hash.

    The hash is that of the event and the one before; see `seqrsm.store.chain`.
    """

    event: int
    at: str
    version: str
    seed: int | None
    run_id: int | None
    kind: str
    detail: dict[str, Any]
    hash: str = ""


@dataclass(frozen=True, slots=True)
class FileRecord:
    """A file of measured scores that was taken in: name, SHA-256 of its bytes, rows of scores, time."""

    name: str
    sha256: str
    row_count: int
    ingested_at: str


@dataclass(frozen=True, slots=True)
class IngestedRun:
    """One run's measured scores on their way into the store."""

    run_id: int | None
    """The proposal it carries out; None for a run nobody proposed."""
    settings: Mapping[str, float | str]
    """Executed settings, natural units."""
    source: str
    """Either "flight" or "simulation"; "" keeps what was proposed (a new run is a flight)."""
    block: str
    """Block label; "" keeps what was proposed."""
    cost: float
    """Cost of a new run."""
    scores: tuple[NewScore, ...]
    """Different applications, at least one."""


@dataclass(frozen=True, slots=True)
class IngestedFile:
    """A file on its way into the store: name, SHA-256 of its bytes, rows of scores or ranks, and what they say."""

    name: str
    sha256: str
    row_count: int
    runs: tuple[IngestedRun, ...] = ()
    rankings: tuple[MeasuredRanking, ...] = ()


@dataclass(frozen=True, slots=True)
class RankingRecord:
    """A stored rank: number of the ranking from 1, its image's run, and ``reason``, "" while the ranking counts."""

    ranking: int
    run_id: int
    application: str
    interpreter: str
    session: str
    rank: float
    metadata: dict[str, Any]
    source_file: str
    source_row: int | None
    reason: str
    ranked_at: str


KEPT = {"looks": LookRecord, "events": EventRecord, "files": FileRecord, "rankings": RankingRecord}
"""What a store keeps beside the runs, by the methods that give it."""


@dataclass(frozen=True, slots=True)
class EqualRow:
    """A row without a run id that says exactly what a run says already: its line, the run, and the run's state."""

    line: int | None
    run_id: int
    state: str


@dataclass(frozen=True, slots=True)
class InterpreterEffect:
    """How sharply an interpreter tells images apart: 1 for the average, with a 95 % interval; Kendall's tau-b."""

    interpreter: str
    rankings: int
    sharpness: float
    low: float
    high: float
    agreement: float | None


@dataclass(frozen=True, slots=True)
class RankingSummary:
    """What an application's rankings say."""

    application: str

    rankings: int
    """That count."""
    scores: dict[int, tuple[float, float]]
    """Score of each run that the rankings join, from the mean of the first batch, and its standard error, from the mean
    of all [logit]."""
    scale_se: float
    """Relative standard error of the distance between scores, which all have in common."""
    apart: tuple[int, ...]
    """Runs that no chain of rankings joins with these: they have no score yet."""
    interpreters: tuple[InterpreterEffect, ...]


@dataclass(frozen=True, slots=True)
class IngestOutcome:
    """What became of the rows: ids of the runs."""

    n_new: int = 0
    """New scores, or ranks."""
    matched: tuple[int, ...] = ()
    """Issued runs that now have scores."""
    created: tuple[int, ...] = ()
    """New runs, replacements of void ones included."""
    replaced: tuple[tuple[int, int], ...] = ()
    """Void run and the new run in its place."""
    unchanged: tuple[int, ...] = ()
    """Runs, as the file names them, that had exactly these scores already, or whose replacement had."""
    equal: tuple[EqualRow, ...] = ()
    """Rows without a run id that were recognised as scores of an earlier file."""
    moved: tuple[int, ...] = ()
    """Proposed runs that were carried out at other settings."""
    rankings: tuple[int, ...] = ()
    """New rankings."""
    ranked: tuple[RankingSummary, ...] = ()
    """What the rankings say now, one for each application that has new ones."""
    already: FileRecord | None = None
    """The same content was taken in before: nothing was done."""


@lru_cache
def typed(kind: Any) -> tuple[tuple[str, tuple[type, ...]], ...]:
    """Fields of a record, with the types that each may have, its own first: a whole number is a float, too."""
    found = []
    for name, hint in get_type_hints(kind).items():
        parts = get_args(hint) if isinstance(hint, UnionType) else (hint,)
        found.append((name, tuple(get_origin(part) or part for part in parts) + (int,) * (float in parts)))
    return tuple(found)


def misfit(record: Any) -> str:
    """Name of a field whose value is not of the type that the record asks for; "" where all are."""
    for name, kinds in typed(record.__class__):
        value = getattr(record, name)
        large = type(value) is int and float not in kinds and abs(value) >= 2**63
        if large or type(value) not in kinds:
            return name
    return ""
