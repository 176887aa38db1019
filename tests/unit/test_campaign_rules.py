"""Small rules of a campaign, each with an example worked by hand: looks, intervals, ranks."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from seqrsm.analysis.conclude import analyse
from seqrsm.campaign.ingest import ingest_files
from seqrsm.campaign.next_runs import in_random_order
from seqrsm.campaign.tradeoff import _rank_correlation
from seqrsm.spec.read import load_spec
from seqrsm.store.database import _cut_off
from seqrsm.store.records import NewRun
from seqrsm.store.store import Store


@pytest.mark.parametrize("page_size", [512, 4096, 65536])
def test_bytes_that_a_truncated_file_lacks(tmp_path: Path, page_size: int) -> None:
    path = tmp_path / "a.db"
    connection = sqlite3.connect(path)
    connection.execute(f"PRAGMA page_size = {page_size}")
    connection.execute("CREATE TABLE t (x)")
    connection.executemany("INSERT INTO t VALUES (?)", [("y" * 400,)] * 500)
    connection.commit()
    connection.close()
    whole = path.read_bytes()
    assert _cut_off(path) == 0
    for lacking in (1, 1000, len(whole) - 200):
        path.write_bytes(whole[: len(whole) - lacking])
        assert _cut_off(path) == lacking
    path.write_bytes(whole[:60])  # within the header of 100 bytes, which alone tells how long the file was
    assert _cut_off(path) == 40


def test_rank_correlation_sees_order_alone() -> None:
    one = np.array([1.0, 2.0, 3.0, 4.0])
    assert _rank_correlation(one, np.array([1.0, 10.0, 100.0, 1000.0])) == pytest.approx(1.0)
    assert _rank_correlation(one, -np.exp(one)) == pytest.approx(-1.0)
    # Spearman's formula, 1 - 6 sum d^2 / (n (n^2 - 1)), one swap of neighbours: 1 - 12 / 60
    assert _rank_correlation(one, np.array([2.0, 1.0, 50.0, 60.0])) == pytest.approx(0.8)
    assert _rank_correlation(one, np.ones(4)) is None


SPEC = """\
[campaign]
name = "rules"
seed = 1
[[factor]]
name = "x"
low = -1.0
high = 1.0
[[factor]]
name = "y"
low = -1.0
high = 1.0
[[application]]
name = "crops"
utility = "percent_correct"
[stop]
half_width = 30.0
max_runs = 60
interval = "{interval}"
"""


def bowl(x: float, y: float) -> float:
    return 70.0 - 10.0 * ((x - 0.3) ** 2 + (y - 0.4) ** 2)


def measured(folder: Path, interval: str, surface: Callable[[float, float], float], more: str = ""):
    """A campaign of thirty scores of a surface, six of them repeats."""
    (folder / "campaign.toml").write_text(SPEC.format(interval=interval) + more, encoding="utf-8")
    rng = np.random.default_rng(4)
    rows = []
    for k, (x, y) in enumerate([*rng.uniform(-1.0, 1.0, (24, 2)), *[(0.5, 0.5)] * 6]):
        score = surface(x, y) + rng.normal()
        rows.append(f"{x},{y},{score},{k}")
    path = folder / "scores.csv"
    path.write_text("x,y,score,note\n" + "\n".join(rows) + "\n", encoding="utf-8")
    spec = load_spec(folder)
    with Store.open(folder, create=True, campaign="rules", seed=1) as store:
        ingest_files(store, spec, [path])
        return spec, store.runs()


def test_the_rule_holds_at_the_first_look_at_which_all_holds(tmp_path: Path) -> None:
    spec, runs = measured(tmp_path, "prediction", bowl)
    assert analyse(spec, spec.applications[0], runs).decision.held


def test_flights_of_a_batch_come_in_random_order() -> None:
    """Each of the six orders of three flights as often as the others (chi-squared, one in a thousand)."""
    batch = [NewRun({"x": i}, source="simulation" if i in (1, 4) else "flight") for i in range(5)]
    found = [[run.settings["x"] for run in in_random_order(batch, 7, n)] for n in range(600)]
    assert {(order[1], order[4]) for order in found} == {(1, 4)}
    orders = [tuple(order[i] for i in (0, 2, 3)) for order in found]
    counts = [orders.count(order) for order in sorted(set(orders))]
    assert len(counts) == 6
    assert stats.chisquare(counts).pvalue > 1e-3
    assert found == [[run.settings["x"] for run in in_random_order(batch, 7, n)] for n in range(600)]
    assert found != [[run.settings["x"] for run in in_random_order(batch, 8, n)] for n in range(600)]
