"""Sweeps that overlap, the lines they make, and the registration of cells against a count by brute force."""

from __future__ import annotations

import numpy as np
import pytest
from prm_cases import Table, image, radiometer, scene

RELIEF = 40.0 * np.sin(np.arange(100) / 9.0)[:, None] * np.cos(np.arange(120) / 11.0)
"""Hills of 40 m below a craft at 700 m: places shift by up to 3 cells."""


def sweep_centres(scan, part):
    """Place along the track of every sweep's axis where it crosses the look angles of ``part`` (n, n_sweeps) [m]."""
    sweep = np.arange(scan.n_sweeps)
    return scan.sweep_advance_m * (sweep + np.where(sweep % 2 == 0, part[..., None], 1.0 - part[..., None]))


@pytest.mark.parametrize(("speed", "averaged"), [(100.0, 1), (45.0, 2), (30.0, 3), (19.0, 5)])
def test_registration_is_that_of_a_search_over_all_footprints(speed, averaged):
    s = scene(RELIEF, 5.0)
    r = radiometer(speed_m_s=speed, resolution_m=50.0, altitude_m=700.0, integration_time_ms=0.1)
    found = image(s, r, Table((0.9,)))
    scan = found.scan
    assert scan.sweeps_a_line == averaged
    assert scan.n_lines == -(-scan.n_sweeps // averaged)
    height = 700.0 - float(RELIEF.astype(np.float32).mean(dtype=np.float64))
    y = (np.arange(100)[:, None] - 49.5) * 5.0
    seen_at = y * height / (height - (RELIEF - (700.0 - height)))
    phi = np.arctan(seen_at / height)
    part = np.clip(0.5 + 0.5 * phi / scan.half_angle_rad, 0.0, 1.0)
    x = np.broadcast_to((np.arange(120) + 0.5) * 5.0, phi.shape)
    centres = sweep_centres(scan, part)
    padded = np.full((*phi.shape, scan.n_lines * averaged), np.nan)
    # The last line may hold fewer sweeps; registration goes on as if it held them all.
    whole = scan.sweep_advance_m * (
        np.arange(padded.shape[-1])
        + np.where(np.arange(padded.shape[-1]) % 2 == 0, part[..., None], 1.0 - part[..., None])
    )
    padded[:] = whole
    lines = padded.reshape(*phi.shape, scan.n_lines, averaged).mean(axis=-1)
    distance = np.abs(lines - x[..., None])
    sample, line = np.divmod(found.pixel_of_cell, scan.n_lines)
    chosen = np.take_along_axis(distance, line[..., None], axis=-1)[..., 0]
    np.testing.assert_allclose(chosen, distance.min(axis=-1), atol=2e-3)
    np.testing.assert_allclose(
        np.abs(scan.look_rad[sample] - phi), np.abs(scan.look_rad[:, None, None] - phi).min(axis=0), atol=1e-6
    )
    width = 50.0 / np.cos(phi)
    along = (np.abs(centres - x[..., None]) <= 0.5 * width[..., None]).sum(axis=-1)
    across = (np.abs(scan.look_rad[:, None, None] - phi) <= 0.5 * scan.beamwidth_rad).sum(axis=0)
    expected = np.where(found.blocked, 0, along * across)
    # float32 relief moves a few cells over an edge.
    assert (found.coverage == expected).mean() > 0.995


def test_a_line_is_the_mean_of_its_sweeps_with_less_noise():
    layer = np.random.default_rng(3).uniform(280.0, 320.0, (100, 120))
    given = {"speed_m_s": 30.0, "resolution_m": 50.0, "integration_time_ms": 0.5}
    s = scene(np.zeros((100, 120)), 5.0)
    lines = image(s, radiometer(**given), Table((1.0,)), temperature_k=layer)
    sweeps = image(s, radiometer(overlap="nearest", **given), Table((1.0,)), temperature_k=layer)
    assert sweeps.scan.n_lines == lines.scan.n_sweeps == 40
    for k in range(lines.scan.n_lines):
        group = slice(3 * k, min(3 * k + 3, 40))
        n = min(3, 40 - 3 * k)
        np.testing.assert_allclose(lines.mean_k[..., k], sweeps.mean_k[..., group].mean(axis=-1), rtol=1e-12)
        expected = np.sqrt((sweeps.nedt_k[..., group] ** 2).sum(axis=-1)) / n
        np.testing.assert_allclose(lines.nedt_k[..., k], expected, rtol=1e-12)
    assert any("3 at a time are averaged" in note for note in lines.notes)
    assert any("only the nearest is used" in note for note in sweeps.notes)


def test_slower_flights_trade_lines_for_noise_as_the_square_root_of_time():
    # Ground of one temperature: the noise of the image alone is seen; four times the time gives half the noise.
    s = scene(np.zeros((200, 240)), 5.0)
    spread = []
    for speed in (100.0, 25.0):
        r = radiometer(
            resolution_m=10.0, scan_period_s=0.2, speed_m_s=speed, integration_time_ms=0.05, bandwidth_mhz=100.0
        )
        found = image(s, r, Table((0.9,)))
        error = (found.brightness_k - found.mean_k).astype(np.float64)
        assert float(error.std()) == pytest.approx(float(np.mean(found.nedt_k)), rel=5.0 / np.sqrt(2 * error.size))
        spread.append(float(error.std()))
    assert spread[0] / spread[1] == pytest.approx(2.0, rel=0.05)
