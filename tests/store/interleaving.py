"""Two commands on one campaign, one of them stopped before a transaction of its own while the other works."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from seqrsm.analysis import conclude
from seqrsm.campaign import campaign as campaign_module
from seqrsm.campaign import experiment, loop, simulation, simulator_checks
from seqrsm.campaign.campaign import Campaign
from seqrsm.campaign.grounds import Grounds
from seqrsm.campaign.loop import run_campaign
from seqrsm.errors import UserError
from seqrsm.simulate import runner
from seqrsm.store import store as store_module
from seqrsm.store.database import Database
from seqrsm.store.records import CONFIRMATION, NewScore

SPEC = """\
[campaign]
name = "test"
seed = 3
[[factor]]
name = "x"
low = -1.0
high = 1.0
[[application]]
name = "score"
utility = "measured"
[stop]
half_width = 1.5
interval = "prediction_mean"
guard = "confirmation"
confirmation_runs = 3
max_runs = 16
"""
_TOLD = ("run_id", "batch", "purpose", "source", "state", "proposed", "executed", "block", "cost")


class WaitsError(Exception):
    """The command would wait for the one that is stopped: it is let go of, as by Ctrl-C."""


def bowl(settings: dict, run_id: int) -> float:
    noise = float(np.random.default_rng([7, run_id]).normal())
    return 80.0 - 10.0 * (float(settings["x"]) - 0.2) ** 2 + 0.5 * noise


def without_engine(monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs are scored by `bowl`; an analysis of equal runs, which is a pure function of them, is made once."""
    # What is imported while the names are others would keep those.
    for name in ("dossier", "images", "tradeoff", "check"):
        importlib.import_module(f"seqrsm.campaign.{name}")

    def carry(_function: Any, tasks: Any, *_: Any) -> Iterator[tuple[int, Any]]:
        for index, task in enumerate(tasks):
            scores = (NewScore("score", bowl(task.settings, task.run_id)),)
            yield index, SimpleNamespace(run_id=task.run_id, scores=scores, failure="", fault="", check=None)

    real, made = conclude.analyse, {}

    def analyse(spec: Any, application: Any, runs: Any, **options: Any) -> Any:
        told = [
            (*(getattr(run, name) for name in _TOLD), [(s.application, s.score) for s in run.scores]) for run in runs
        ]
        key = repr((spec.spec_hash, application.name, told, sorted(options.items())))
        if key not in made:
            made[key] = real(spec, application, runs, **options)
        return made[key]

    for module in (conclude, campaign_module):
        monkeypatch.setattr(module, "analyse", analyse)
    monkeypatch.setattr(runner, "run_many", carry)
    monkeypatch.setattr(loop, "check_simulator", lambda spec: None)
    monkeypatch.setattr(
        simulation, "task_of", lambda spec, run_id, settings, *_: SimpleNamespace(run_id=run_id, settings=settings)
    )
    monkeypatch.setattr(simulator_checks, "see_parameters", lambda spec: None)
    monkeypatch.setattr(experiment, "experiment_of", lambda spec: {"seqrsm": "stub"})
    monkeypatch.setattr(Grounds, "measure", lambda *_: None)
    monkeypatch.setattr(Grounds, "rank", lambda *_: None)
    monkeypatch.setattr(loop, "rests_on", lambda *_: {})


def made(folder: Path, text: str = SPEC, url: str | None = None) -> Path:
    folder.mkdir(exist_ok=True)
    store = f'[store]\nurl = "{url}"\n' if url else ""
    (folder / "campaign.toml").write_text(text + store, encoding="utf-8")
    return folder


@contextmanager
def elsewhere() -> Iterator[None]:
    """What is done in the block is done by another process, which waits for nobody."""

    def wait(_: float) -> None:
        raise WaitsError

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(store_module, "_this_process", lambda: "elsewhere:1:other")
        patch.setattr(loop.time, "sleep", wait)
        yield


def transactions(monkeypatch: pytest.MonkeyPatch, before: Callable[[int], None]) -> None:
    """Call ``before`` with its number, from 1, before each reading or writing transaction but those it makes itself."""
    count, inside = [0], [False]

    def counted(real: Any) -> Any:
        @contextmanager
        def transaction(self: Database) -> Iterator[Any]:
            if not inside[0]:
                count[0] += 1
                inside[0] = True
                try:
                    before(count[0])
                finally:
                    inside[0] = False
            with real(self) as connection:
                yield connection

        return transaction

    for name in ("read", "write"):
        monkeypatch.setattr(Database, name, counted(getattr(Database, name)))


def command(name: str, folder: Path, *refusals: type[Exception]) -> None:
    """A command of its own process, which may end by ``refusals``."""
    campaign = Campaign.open(folder)
    try:
        with suppress(*refusals):
            if name == "run":
                run_campaign(campaign)
            elif name == "propose":
                campaign.propose(source="simulation")
            elif name == "simulate":
                campaign.simulate()
    finally:
        campaign.store.close()


def interleaved(folder: Path, first: str, others: Sequence[str], moment: int, url: str | None = None) -> bool:
    """Let others come before the transaction of this number of a command, and bring a `run` to its end.

    False when the command has no so many transactions.
    """
    made(folder, url=url)
    met = []

    def before(n: int) -> None:
        if n == moment:
            met.append(n)
            for name in others:
                with elsewhere(), suppress(WaitsError):
                    command(name, folder, UserError)

    with pytest.MonkeyPatch.context() as patch:
        transactions(patch, before)
        command(first, folder, *(() if first == "run" else (UserError,)))  # nobody else may end a `run` with an error
    if first == "run":
        command("run", folder)
    return bool(met)


def found(folder: Path) -> tuple[Any, Any]:
    """Runs, and looks, without times."""
    campaign = Campaign.open(folder)
    runs = [
        (run.run_id, run.batch, run.purpose, run.state, tuple(run.proposed.items()), [s.score for s in run.scores])
        for run in campaign.store.runs()
    ]
    looks = [(look.after_run, look.application, look.summary) for look in campaign.store.looks()]
    used = [run for run in campaign.store.runs() if run.state != "void" and run.purpose != CONFIRMATION]
    campaign.store.close()
    assert len(used) <= campaign.spec.stop.max_runs
    return runs, looks
