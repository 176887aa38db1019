"""Small rules of a campaign, each with an example worked by hand: which runs to repeat, two looks, intervals, ranks."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from seqrsm.analysis.conclude import analyse
from seqrsm.analysis.to_json import optimum_to_json
from seqrsm.campaign.fidelity_watch import to_repeat
from seqrsm.campaign.ingest import ingest_file
from seqrsm.campaign.next_runs import _ties_wanted, in_random_order
from seqrsm.campaign.tradeoff import _rank_correlation
from seqrsm.decide.intervals import t_quantile
from seqrsm.fit.optimum import optimum
from seqrsm.report.study_text import searched_text
from seqrsm.report.wording import mean_text, of_quadratic
from seqrsm.spec.read import load_spec
from seqrsm.store.database import _cut_off
from seqrsm.store.records import LookRecord, NewRun
from seqrsm.store.store import Store


def scored(run_id: int, rung: str, bound: float, *, source: str = "simulation", state: str = "scored", **more: float):
    fidelity = {"rung": rung, "bound": bound, **more}
    return SimpleNamespace(
        run_id=run_id, source=source, state=state, scores=(SimpleNamespace(metadata={"fidelity": fidelity}),)
    )


def test_runs_to_repeat() -> None:
    """Tolerance 2, bounds of F2 found 1.5 times too small: repeated is what passes 2 for that reason alone."""
    spec = SimpleNamespace(simulator=SimpleNamespace(fidelity="auto", tolerance=2.0))
    runs = [
        scored(1, "F2", 1.4),  # 2.1
        scored(2, "F2", 1.3),  # 1.95
        scored(3, "F4", 9.0),  # the full simulation, past the tolerance before and after
        scored(4, "F2", 1.9, widening=1.5),  # planned when this was known
        scored(5, "F2", 1.9, widening=1.2),  # when only some of it was: 2.375
        scored(6, "F2", 1.9, source="flight"),
        scored(7, "F2", 1.9, state="void"),
    ]
    assert to_repeat(spec, runs, {"F2": 1.5}) == (1, 5)
    assert to_repeat(spec, runs, {}) == ()
    spec.simulator.fidelity = "F2"
    assert to_repeat(spec, runs, {"F2": 1.5}) == ()


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


def test_one_run_in_four_ties_a_day_less_those_that_wait() -> None:
    def run(state: str, purpose: str) -> SimpleNamespace:
        return SimpleNamespace(state=state, purpose=purpose)

    days = SimpleNamespace(model=SimpleNamespace(block="day"))
    assert [_ties_wanted(days, [], n) for n in (1, 2, 4, 8, 9)] == [0, 1, 1, 2, 2]
    active = [run("issued", "tie"), run("scored", "tie"), run("issued", "optimum")]
    assert [_ties_wanted(days, active, n) for n in (4, 8)] == [0, 1]
    assert _ties_wanted(SimpleNamespace(model=SimpleNamespace(block=None)), [], 8) == 0


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


def saturating(x: float, y: float) -> float:
    return 60.0 + 25.0 * float(np.tanh(2.5 * (x + y)))


def bowl(x: float, y: float) -> float:
    return 70.0 - 10.0 * ((x - 0.3) ** 2 + (y - 0.4) ** 2)


def levelling(x: float, y: float) -> float:
    """Rises steeply from x = -1 and levels off; its top is at x = log(280 / 10) / 4 - 1 = -0.167."""
    return 20.0 + 70.0 * (1.0 - float(np.exp(-4.0 * (x + 1.0)))) - 10.0 * (x + 1.0) - 5.0 * (y - 0.4) ** 2


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
        ingest_file(store, spec, path)
        return spec, store.runs()


@pytest.mark.parametrize("interval", ["confidence", "prediction", "prediction_mean"])
def test_the_rule_watches_the_widening_of_its_own_interval(tmp_path: Path, interval: str) -> None:
    spec, runs = measured(tmp_path, interval, saturating)
    found = analyse(spec, spec.applications[0], runs, [])
    allowed = found.optimum.with_departure
    assert allowed is not None
    widening = {
        name: getattr(allowed, name).half_width / getattr(found.optimum, name).half_width
        for name in ("confidence", "prediction", "prediction_mean")
    }
    assert widening["confidence"] > 1.1 * widening["prediction"]  # or the test could not tell them apart
    assert allowed.widening == pytest.approx(widening[interval])
    assert found.decision.half_width == pytest.approx(getattr(allowed, interval).half_width)


@pytest.mark.parametrize("goal", ["maximize", "minimize"])
def test_where_a_departure_is_seen_the_settings_are_the_best_of_both_together(tmp_path: Path, goal: str) -> None:
    sign = 1.0 if goal == "maximize" else -1.0

    def surface(x: float, y: float) -> float:
        return levelling(x, y) if goal == "maximize" else 110.0 - levelling(x, y)

    spec, runs = measured(tmp_path, "prediction", surface)
    application = spec.applications[0].model_copy(update={"goal": goal})
    found = analyse(spec, application, runs, [])
    best, model = found.optimum, found.model
    assert found.region_state.box.whole
    assert best.quadratic is not None
    np.testing.assert_allclose(best.quadratic, optimum(model, found.region, found.beta, goal).point)
    loss = [levelling(-0.167, 0.4) - levelling(*point) for point in (best.point, best.quadratic)]
    assert loss[0] < 0.5 * loss[1]
    allowed = best.with_departure
    assert allowed is not None
    assert (best.mean, best.confidence, best.prediction) == (allowed.mean, allowed.confidence, allowed.prediction)
    row = model.matrix(best.point[None, :])[0]
    shift = best.mean - float(row @ found.beta)  # against eq. 2-23 at these settings
    assert sign * shift > 0.0
    assert best.confidence.low < surface(*best.point) < best.confidence.high
    plain = found.fit.predict(row[None, :], best.level).confidence
    half = 0.5 * float(plain.high[0] - plain.low[0])
    least = np.hypot(half, t_quantile(found.fit.df_residual, best.level) * abs(shift))
    assert best.confidence.half_width >= least  # chosen for it: the departure counts as an error of its size
    assert not found.decision.held
    assert {check.name: check.holds for check in found.decision.checks}["lack_of_fit"] is False
    assert found.decision.half_width == pytest.approx(allowed.prediction.half_width)
    assert "against a quadratic here" in found.warnings[0]
    told = optimum_to_json(found)
    assert told["of_quadratic"] == spec.region.decode(best.quadratic)[0]
    assert mean_text(found).startswith(f"{allowed.mean:.1f}")
    # What draws of the quadratic say is of its own optimum, and said to be so; of these settings they know no loss.
    (tmp_path / "fixed").mkdir()
    fixed, _ = measured(tmp_path / "fixed", "prediction", surface, '[model]\nregion = "fixed"\n')
    alone = analyse(fixed, application, runs, [])
    assert found.posterior.predictive == alone.posterior.predictive
    assert np.isnan([found.posterior.expected_regret, found.posterior.p_regret_above]).all()
    assert of_quadratic(found) == ", by the quadratic alone"
    study = analyse(spec, application, runs, [], thorough=True).study
    assert study is not None
    assert searched_text(found, study).startswith("At the optimum of the quadratic alone. ")


def test_the_quadratic_has_the_word_where_none_is_seen_or_the_region_is_fixed(tmp_path: Path) -> None:
    for surface, more in ((bowl, ""), (levelling, '[model]\nregion = "fixed"\n')):
        folder = tmp_path / surface.__name__
        folder.mkdir()
        spec, runs = measured(folder, "prediction", surface, more)
        found = analyse(spec, spec.applications[0], runs, [])
        assert found.optimum.quadratic is None
        assert optimum_to_json(found)["of_quadratic"] is None
        assert of_quadratic(found) == ""
        assert np.isfinite(found.posterior.expected_regret)
        np.testing.assert_allclose(found.optimum.point, optimum(found.model, found.region, found.beta).point)


def test_two_looks_count_for_the_same_region_alone(tmp_path: Path) -> None:
    spec, runs = measured(tmp_path, "prediction", bowl)
    here = {"x": [-1.0, 1.0], "y": [-1.0, 1.0]}

    def stops(**summary: object) -> bool:
        look = LookRecord(1, len(runs) - 4, "crops", summary, "")
        return analyse(spec, spec.applications[0], runs, [look]).decision.held

    assert stops(conditions_hold=True, region={"ranges": here})
    assert not stops(conditions_hold=False, region={"ranges": here})
    assert not stops(conditions_hold=True, region={"ranges": here | {"x": [0.0, 1.0]}})


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
