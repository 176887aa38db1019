"""Single footprints of a radiometer, their beams as points, against the whole image of the same occasion."""

from __future__ import annotations

import numpy as np
import pytest

from seqrsm.campaign.engines import ENGINES
from seqrsm.scene.scene import Scene
from seqrsm.scene.synthetic import synthetic_scene
from seqrsm.simulate.bounds import quadrature_error
from seqrsm.simulate.fidelity import RungPlan
from seqrsm.simulate.radiometer.prm import meet_radiometer, simulate_radiometer
from seqrsm.simulate.radiometer.sample import BEAM_POINTS, lattice, radiometer_sample

SEED, RUN = 5, 3
COVERS = ("Water", "Trees", "Grass", "Bareground")
ALL = 10**6


def scene(relief_m: float) -> Scene:
    return synthetic_scene(240, 260, 30.0, categories=COVERS, field_m=500.0, relief_m=relief_m, exponent=3.6, seed=11)


def radiometer(**changes: float | str) -> object:
    fixed = {"bandwidth": 100.0, "noise_temperature": 0.001, "scan_period": 2.5, "altitude_m": 6000.0}
    fixed |= {"speed_m_s": 120.0, "integration_time": 8.0, **changes}
    return ENGINES["prm"].configure({"frequency": 18.0, "polarization": "H+V", "resolution": 180.0}, fixed)


def sampled(ground: Scene, sensor: object, rung: str, points: int, rows: int = ALL, columns: int = ALL) -> object:
    table = ENGINES["prm"].table("")
    met = meet_radiometer(ground, sensor, table, seed=SEED, run_id=RUN)
    plan = RungPlan(rung, rows=rows, columns=columns, points=points)
    return radiometer_sample(ground, sensor, table, met, plan, seed=SEED, run_id=RUN)


@pytest.mark.parametrize(
    ("relief_m", "rung", "changes"),
    [
        (0.0, "F0", {}),
        (0.0, "F2", {"beam": "sidelobes"}),
        (120.0, "F2", {}),
        (120.0, "F2", {"heading_deg": 180.0, "speed_m_s": 40.0}),
    ],
)
def test_footprints_by_points_are_those_of_the_image(relief_m: float, rung: str, changes: dict) -> None:
    ground, sensor = scene(relief_m), radiometer(**changes)
    image = simulate_radiometer(ground, sensor, ENGINES["prm"].table(""), seed=SEED, run_id=RUN)
    whole = image.mean_k.reshape(2, -1)
    contrast = whole.std(axis=1)
    last = np.inf
    for points in (55, 377):
        sample = sampled(ground, sensor, rung, points)
        difference = sample.values[0] - whole
        error = difference.std(axis=1)
        # Footprints are means, so that covers differ by more than they do: twice that is the covers' own contrast.
        assert (error < 3.0 * contrast * quadrature_error(points)).all()
        assert (error < 0.7 * last).all()
        # Neighbouring footprints share points of one shift: the mean is known to a tenth of one footprint's error.
        assert (np.abs(difference.mean(axis=1)) < 0.1 * error).all()
        last = error


@pytest.mark.parametrize("speed", [40.0, 120.0, 200.0])
def test_every_cell_counts_by_the_footprint_that_it_has_in_the_image(speed: float) -> None:
    ground, sensor = scene(0.0), radiometer(speed_m_s=speed)
    image = simulate_radiometer(ground, sensor, ENGINES["prm"].table(""), seed=SEED, run_id=RUN)
    sample = sampled(ground, sensor, "F2", 21)
    size = image.mean_k[0].size
    wanted = np.bincount(image.pixel_of_cell[image.pixel_of_cell >= 0], minlength=size)
    found = np.bincount(sample.pixel_of_cell[sample.pixel_of_cell >= 0], minlength=size)
    share = found.sum() / wanted.sum()
    assert share > 0.05
    outer = wanted.reshape(image.mean_k[0].shape)[[0, -1]].sum() / wanted.sum()
    assert found.reshape(image.mean_k[0].shape)[[0, -1]].sum() / found.sum() == pytest.approx(outer, rel=0.1)
    assert np.corrcoef(found, wanted)[0, 1] > 0.8
    # All ground counts alike: the shares of covers are those of the scene.
    cover = np.bincount(sample.cover[sample.pixel_of_cell >= 0], minlength=4) / found.sum()
    np.testing.assert_allclose(cover, np.bincount(ground.cover.ravel(), minlength=4) / ground.cover.size, atol=0.02)


def test_a_part_of_the_footprints_shows_what_all_show() -> None:
    ground, sensor = scene(120.0), radiometer()
    image = simulate_radiometer(ground, sensor, ENGINES["prm"].table(""), seed=SEED, run_id=RUN)
    sample = sampled(ground, sensor, "F2", 377, rows=9, columns=11)
    assert sample.values.shape == (1, 2, 99)
    line = np.round(sample.along_m / image.scan.advance_m - 0.5).astype(int)
    look = np.sqrt(sample.covariates[:, 0])
    number = np.abs(np.abs(image.scan.look_rad)[None, :] - look[:, None]).argmin(axis=1)
    mirrored = len(image.scan.look_rad) - 1 - number
    either = np.minimum(
        np.abs(image.mean_k[:, number, line] - sample.values[0]),
        np.abs(image.mean_k[:, mirrored, line] - sample.values[0]),
    )
    assert np.sqrt(np.square(either).mean()) < 2.0 * image.mean_k.std() * quadrature_error(377)


@pytest.mark.parametrize("points", BEAM_POINTS)
def test_the_lattice_errs_on_straight_borders_by_less_than_its_bound(points: int) -> None:
    """Share of a round Gaussian beam beyond a line: its distribution function, in closed form."""
    from scipy.special import ndtr, ndtri

    rng = np.random.default_rng(1)
    sigma = 1.0 / (2.0 * np.sqrt(2.0 * np.log(2.0)))
    error = []
    for _ in range(400):
        u, v = (lattice(points) + rng.random((2, 1))) % 1.0
        x, y = sigma * ndtri(np.maximum(u, 1e-12)), sigma * ndtri(np.maximum(v, 1e-12))
        angle, distance = np.pi * rng.random(), rng.uniform(-1.2, 1.2)
        beyond = (x * np.cos(angle) + y * np.sin(angle) < distance).mean()
        error.append(beyond - ndtr(distance / sigma))
    error = np.array(error)
    assert abs(error.mean()) < 4.0 * error.std() / np.sqrt(error.size)
    assert 0.3 * quadrature_error(points) < error.std() < quadrature_error(points)
