"""Common random numbers through a campaign: shared, recorded with every run, fitted as random blocks."""

from __future__ import annotations

import json
from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tiny_campaign import TINY, make_tiny
from typer.testing import CliRunner

from seqrsm.analysis.fitted import fit_application
from seqrsm.analysis.posterior import draw_coefficients
from seqrsm.analysis.surfaces import RandomBlocks, TwoSources
from seqrsm.campaign import rehearsal
from seqrsm.campaign.campaign import Campaign
from seqrsm.campaign.simulation import carry_out, task_of
from seqrsm.cli.app import app
from seqrsm.spec.read import load_spec
from seqrsm.store.records import CONFIRMATION

SHARED = TINY.replace('scene = "scene.npz"', 'scene = "scene.npz"\ncommon_random_numbers = 4')


def call(*arguments: object) -> tuple[int, str, str]:
    found = CliRunner().invoke(app, [str(a) for a in arguments])
    return found.exit_code, found.stdout, found.stderr


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory, tiny_scene: Path) -> Path:
    folder = make_tiny(tmp_path_factory.mktemp("shared") / "campaign", tiny_scene, SHARED)
    code, _, error = call("run", folder)
    assert code in (0, 3), error
    return folder


def test_every_run_says_which_occasion_it_shares(done: Path) -> None:
    runs = Campaign.open(done).store.runs("scored")
    members = defaultdict(list)
    for run in runs:
        assert (run.block == "") == (run.purpose == CONFIRMATION)
        if run.block:
            assert run.scores[0].metadata["common_random_numbers"] == int(run.block.removeprefix("occasion "))
            members[run.block].append(run.scores[0].score)
    assert max(map(len, members.values())) <= 4
    assert sum(len(own) > 1 for own in members.values()) >= 3
    # No repeat meets the same occasion again, which would give the same number.
    settings = defaultdict(list)
    for run in runs:
        settings[tuple(run.settings.items())].append(run.block or run.run_id)
    repeats = [own for own in settings.values() if len(own) > 1]
    assert repeats
    assert all(len(set(own)) == len(own) for own in repeats)


def test_the_fit_takes_occasions_as_random_blocks_whatever_the_file_says_later(done: Path) -> None:
    code, out, _ = call("fit", done, "--json")
    assert code == 0
    assert json.loads(out)["blocks"]["effect"] == "random"
    campaign = Campaign.open(done)
    runs, one = campaign.store.runs(), campaign.spec.applications[0]
    fitted = fit_application(campaign.spec, one, runs)
    assert isinstance(fitted.surface, RandomBlocks)
    assert fitted.occasions >= 3
    # Repeats stand in different occasions, and are pure error all the same; occasions are no terms of the model.
    assert fitted.fit.df_pure_error > replace(fitted.fit, crossed_blocks=False).df_pure_error
    reasons = campaign.analyse_all(one.name)[0].decision.reasons
    assert any(f"runs for {fitted.model.p} terms" in reason for reason in reasons)
    simulator = campaign.spec.simulator.model_copy(update={"common_random_numbers": None})
    off = fit_application(replace(campaign.spec, simulator=simulator), one, runs)
    np.testing.assert_array_equal(off.surface.estimate, fitted.surface.estimate)
    # A mean of future runs meets as many occasions, so that of very many is known as well as the mean itself.
    row = fitted.model.matrix(np.zeros((1, 2)))
    one_run, many = (fitted.surface.predict(row, replicates=m) for m in (1, 10**6))
    assert many.prediction.high[0] == pytest.approx(many.confidence.high[0], abs=0.05)
    assert one_run.prediction.high[0] > many.prediction.high[0] + 1.0


def test_beside_flights_occasions_are_constants_that_leave_the_flights_alone(done: Path) -> None:
    """Effects of occasions that sum to zero change no flight's surface; without the blocks they would."""
    campaign = Campaign.open(done)
    model = campaign.spec.model.model_copy(update={"discrepancy_sd": 3.0})
    spec, one = replace(campaign.spec, model=model), campaign.spec.applications[0]
    runs = [run for run in campaign.store.runs("scored") if run.purpose != CONFIRMATION]
    shared = sorted({run.block for run in runs if sum(other.block == run.block for other in runs) > 1})
    rng = np.random.default_rng(0)
    effect = dict(zip(shared, rng.normal(0.0, 20.0, len(shared)), strict=True))
    mean = sum(effect.values()) / len(effect)

    def scored(run, extra: float):
        score = replace(run.scores[0], score=run.scores[0].score + extra, metadata={})
        return replace(run, scores=(score,))

    flown = [
        replace(scored(run, -5.0 + rng.normal()), run_id=1000 + i, source="flight", block="")
        for i, run in enumerate(runs[:6])
    ]
    plain = [scored(run, 0.0) for run in runs]
    moved = [scored(run, effect.get(run.block, mean) - mean) for run in runs]
    with_flights = [fit_application(spec, one, [*own, *flown]) for own in (plain, moved)]
    plain_fit, moved_fit = (found.surface.estimate for found in with_flights)
    np.testing.assert_allclose(moved_fit, plain_fit, rtol=1e-6, atol=1e-6)
    assert isinstance(with_flights[0].surface, TwoSources)
    forgotten = [
        fit_application(spec, one, [*(replace(run, block="") for run in own), *flown]) for own in (plain, moved)
    ]
    assert np.abs(forgotten[1].surface.estimate - forgotten[0].surface.estimate).max() > 0.5


def test_a_rehearsed_run_has_the_scatter_of_occasions_too(done: Path) -> None:
    campaign = Campaign.open(done)
    (analysis,) = campaign.analyse_all()
    draws = draw_coefficients(campaign.spec, analysis.fitted, sampler="exact", n_draws=2000)
    assert draws.sigma_block is not None
    truth = rehearsal._truth(analysis, draws, np.random.default_rng(0))
    variance = float(truth.sd(analysis.optimum.point[None, :])[0]) ** 2
    assert np.min(np.abs(variance - draws.sigma**2 - draws.sigma_block**2)) < 1e-9


def test_status_and_report_say_it_in_words(done: Path) -> None:
    code, out, _ = call("status", done, "--json")
    shared = json.loads(out)["common_random_numbers"]
    assert code == 0
    assert shared["occasions"] >= 3
    assert shared["runs"] > shared["occasions"]
    words = " ".join(call("status", done)[1].split())
    assert f"shared by {shared['runs']} runs in {shared['occasions']} occasions" in words
    code, _, error = call("report", done, "--html", done / "report.html")
    assert code == 0, error
    text = " ".join((done / "report.html").read_text(encoding="utf-8").split())
    assert f"{shared['runs']} simulated runs share {shared['occasions']} occasions" in text
    assert "p to 4 simulated runs share one occasion" in text


def test_an_occasion_is_met_alike_and_another_differently(tiny_scene: Path, tmp_path: Path) -> None:
    spec = load_spec(make_tiny(tmp_path / "one", tiny_scene, SHARED))
    settings = {"polarization": "HH+HV", "resolution": 20.0}
    tasks = [task_of(spec, run, settings, occasion=n) for run, n in ((1, 3), (9, 3), (10, 4), (11, None), (12, None))]
    first, again, other, own, another = (carry_out(task).scores[0].score for task in tasks)
    assert first == again
    assert len({first, other, own, another}) == 4
    # Settings in one occasion rise and fall together; in occasions of their own they do not.
    wide = {"polarization": "HH", "resolution": 35.0}
    pairs = [
        [carry_out(task_of(spec, k + n, own, occasion=n)).scores[0].score for k, own in ((100, settings), (200, wide))]
        for n in range(1, 41)
    ]
    together = np.array(pairs)
    shuffled = np.column_stack([together[:, 0], np.roll(together[:, 1], 1)])
    assert np.corrcoef(together.T)[0, 1] > 0.2
    assert abs(np.corrcoef(shuffled.T)[0, 1]) < 0.4


@pytest.mark.parametrize("value", ["1", "0", "-3", "true", "4.0", '"8"', "100000", "nan"])
def test_a_number_of_runs_that_cannot_be_is_refused(tiny_scene: Path, tmp_path: Path, value: str) -> None:
    text = SHARED.replace("common_random_numbers = 4", f"common_random_numbers = {value}")
    code, _, error = call("check", make_tiny(tmp_path / "bad", tiny_scene, text))
    assert code == 2
    assert "common_random_numbers" in error


def test_what_blocks_cannot_do_is_refused(tiny_scene: Path, tmp_path: Path) -> None:
    text = f'{SHARED}\n[model]\nerrors = "student_t"\n'
    code, _, error = call("check", make_tiny(tmp_path / "bad", tiny_scene, text))
    assert code == 2
    assert "normal errors" in " ".join(error.split())


def test_the_hash_of_earlier_specifications_stays(tiny_scene: Path, tmp_path: Path) -> None:
    plain = load_spec(make_tiny(tmp_path / "plain", tiny_scene))
    assert "common_random_numbers" not in plain.simulator.model_dump()
    assert plain.spec_hash != load_spec(make_tiny(tmp_path / "shared", tiny_scene, SHARED)).spec_hash


def test_the_image_of_a_run_is_of_the_occasion_that_it_shares(done: Path, tmp_path: Path) -> None:
    runs = Campaign.open(done).store.runs("scored")
    run = next(r for r in runs if r.block)
    changes = [part for name, value in run.settings.items() for part in ("--set", f"{name}={value}")]
    code, out, error = call("image", done, "--run-id", run.run_id, *changes, "--out", tmp_path / "a.npz", "--json")
    assert code == 0, error
    assert json.loads(out)["scores"]["cover"] == pytest.approx(run.scores[0].score, rel=1e-12)


def test_copies_keep_the_occasions(done: Path, tmp_path: Path) -> None:
    assert call("export", done, tmp_path / "all.json")[0] == 0
    code, _, error = call("init", "--from", tmp_path / "all.json", tmp_path / "copy")
    assert code == 0, error
    blocks = [[run.block for run in Campaign.open(folder).store.runs()] for folder in (done, tmp_path / "copy")]
    assert blocks[0] == blocks[1]
