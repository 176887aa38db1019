"""Speed against accuracy of the numbers, against closed forms and against the arrays themselves."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from seqrsm.analysis.fitted import fit_application
from seqrsm.campaign.campaign import Campaign
from seqrsm.campaign.simulation import NO_RUN, scene_at, task_of
from seqrsm.campaign.tradeoff_numerics import precision_rows, sampler_rows, search_rows, some_configurations
from seqrsm.design.optimal import optimal_design
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.fit.optimum import optimum
from seqrsm.scattering.sigma0 import load_sigma0_table
from seqrsm.scene.file import save_scene
from seqrsm.scene.synthetic import synthetic_scene
from seqrsm.simulate.radar.psm import simulate_radar

TEXT = """\
[campaign]
name = "numerics"
seed = 3
[[factor]]
name = "resolution"
low = 10.0
high = 60.0
scale = "log"
[[factor]]
name = "frequency"
low = 3.0
high = 6.0
[[application]]
name = "cover"
utility = "percent_correct"
[simulator]
engine = "psm"
scene = "scene.npz"
[simulator.fixed]
polarization = "HH"
bandwidth = 60.0
peak_power = 1000.0
depression_angle = 45.0
altitude_m = 4000.0
[stop]
half_width = 4.0
level = 0.9
"""


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    folder = tmp_path_factory.mktemp("numerics")
    (folder / "campaign.toml").write_text(TEXT, encoding="utf-8")
    save_scene(
        synthetic_scene(40, 50, 10.0, categories=("Grass", "Trees"), field_m=120.0, seed=3), folder / "scene.npz"
    )
    rng = np.random.default_rng(0)
    x, z = rng.uniform(10, 60, 25), rng.uniform(3, 6, 25)
    y = 70 - 10 * np.log(x / 20) ** 2 - 2 * (z - 4.5) ** 2 + rng.normal(size=25)
    rows = "\n".join(f"{a!r},{b!r},{c!r}" for a, b, c in zip(x.tolist(), z.tolist(), y.tolist(), strict=True))
    (folder / "scores.csv").write_text(f"resolution,frequency,score\n{rows}\n", encoding="utf-8")
    opened = Campaign.open(folder)
    opened.ingest(folder / "scores.csv")
    return opened


def test_interval_ends_of_both_samplers_and_their_errors_follow_student_t(campaign):
    spec, application = campaign.spec, campaign.spec.applications[0]
    fitted = fit_application(spec, application, campaign.store.runs())
    rows = sampler_rows(spec, application, fitted, sizes=(100, 400, 1600), pool=32_000, chains=6)
    assert {(row["method"], row["draws"]) for row in rows} == {
        (m, n) for m in ("exact", "emcee") for n in (100, 400, 1600)
    }
    assert [row["sets"] for row in rows if row["method"] == "exact"] == [320, 320, 80, 80, 20, 20]
    best = optimum(fitted.model, fitted.region, fitted.surface.estimate, "maximize")
    found = fitted.surface.predict(fitted.surface.rows(best.point[None, :]), 0.9)
    t = stats.t(fitted.surface.df_residual, found.mean[0], found.se_prediction[0])
    for row in rows:
        if row["quantity"] != "future score":
            continue
        error = np.sqrt(0.05 * 0.95 / row["draws"]) / t.pdf(t.ppf(0.05))  # of a sample quantile
        at_hand = error / np.sqrt(row["sets"])
        # a quantile of 100 draws is biased by some tenths of its error
        assert abs(row["low"] - t.ppf(0.05)) < 4 * at_hand + 0.3 * error, row
        assert abs(row["high"] - t.ppf(0.95)) < 4 * at_hand + 0.3 * error, row
        spread = 4 / np.sqrt(2 * (row["sets"] - 1)) + 0.1
        for measured in (row["error_low"], row["error_high"]):
            assert 1 - spread < measured / error < 1 + spread, row
    ends = {(row["method"], row["draws"]): row["high"] for row in rows if row["quantity"] == "utility at the optimum"}
    assert ends["exact", 1600] == pytest.approx(ends["emcee", 1600], abs=0.1)
    # the optimum of a draw is never below its value at the recommended settings
    assert ends["exact", 1600] > found.mean[0]


def test_precision_rows_are_those_of_the_images(campaign):
    spec = campaign.spec
    settings = some_configurations(spec, 2)
    impossible = {**settings[0], "resolution": 1e-4}
    rows = precision_rows(spec, [*settings, impossible], repeats=1)
    assert [row["settings"] for row in rows] == settings
    task = task_of(spec, NO_RUN, settings[1])
    one, two = (
        simulate_radar(
            scene_at(task.scene),
            task.acquisitions[0].sensor,
            load_sigma0_table(),
            seed=3,
            run_id=NO_RUN,
            precision=precision,
        ).intensity
        for precision in ("float32", "float64")
    )
    worst = np.max(np.abs(one - two) / two)
    assert rows[1]["largest_difference"] == pytest.approx(worst, rel=1e-12)
    assert 0.0 < rows[1]["median_difference"] < 1e-6 < 1e-3 > rows[1]["largest_difference"]
    assert rows[1]["score32"] == pytest.approx(rows[1]["score64"], abs=0.2)


def test_more_restarts_reach_no_less(campaign):
    spec = campaign.spec
    rows = search_rows(spec, restarts=(1, 40), searches=4)
    assert [(row["restarts"], row["searches"], row["failed"]) for row in rows] == [(1, 4, 0), (40, 4, 0)]
    assert rows[0]["least_efficiency"] <= rows[0]["efficiency"] <= rows[1]["efficiency"] <= 1.0
    model = QuadraticModel(spec.factors)
    centre = np.tile(spec.region.centre(), (3, 1))
    values = [
        optimal_design(model, spec.region, model.p + 3, seed=spec.seed + i, starts=n, fixed=centre).value
        for n in (1, 40)
        for i in range(4)
    ]
    assert rows[0]["least_efficiency"] == pytest.approx(min(values[:4]) / max(values), rel=1e-12)
