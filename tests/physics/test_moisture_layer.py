"""A layer of soil moisture: what it does to the echo and the emission of bare soil, and to nothing else."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from psm_cases import radar
from shorthands import still_radiometer

from seqrsm.errors import SceneError
from seqrsm.scattering.emissivity import load_emissivity_table
from seqrsm.scattering.sigma0 import load_sigma0_table
from seqrsm.scene.file import load_scene, save_scene
from seqrsm.scene.layers import coarse_scene, moisture_of_fields
from seqrsm.scene.scene import Scene
from seqrsm.sensor.radiometer import from_settings
from seqrsm.simulate.radar.psm import simulate_radar

LEVELS = (0.06, 0.12, 0.20, 0.28)


def site(layer=True):
    """Four bare fields of rising moisture over four of trees of the same."""
    field = np.kron(np.arange(8).reshape(2, 4), np.ones((30, 30), dtype=np.int32)).astype(np.int32)
    cover = (field >= 4).astype(np.uint8)
    wet = np.array([*LEVELS, *LEVELS], dtype=np.float32)[field]
    flat = np.zeros(field.shape, dtype=np.float32)
    names = ("Bareground", "Trees")
    return Scene(flat, cover, names, field, flat == 0.0, 10.0, soil_moisture=wet if layer else None)


def test_bare_fields_answer_as_the_table_says_for_their_moisture():
    table = load_sigma0_table()
    wetness = {"soil_moisture_low": 0.2, "soil_moisture_high": 0.2}
    r = radar(resolution_m=20.0, fading="none", frequency_ghz=1.25, channels=("HH",), peak_power_w=1e6, **wetness)
    wet, even = (simulate_radar(site(layer), r, table, seed=1, run_id=1) for layer in (True, False))
    change = 10.0 * np.log10(wet.mean_power[0] / even.mean_power[0])
    theta = np.rad2deg(r.centre_incidence_rad)

    def level(moisture):
        found = table.lookup(("Bareground",), 1.25, "HH", soil_moisture=moisture)
        return 10.0 * np.log10(np.interp(theta, found.theta_deg, found.sigma0[0]))

    for k, moisture in enumerate(LEVELS):
        field = change.ravel()[wet.pixel_of_cell[10:20, 30 * k + 10 : 30 * k + 20]]
        np.testing.assert_allclose(field, level(moisture) - level(0.2), atol=0.1)
        trees = change.ravel()[wet.pixel_of_cell[40:50, 30 * k + 10 : 30 * k + 20]]
        np.testing.assert_allclose(trees, 0.0, atol=1e-5)
    assert level(0.28) - level(0.06) > 2.0


def test_the_weather_of_a_run_is_added_to_the_layer():
    table = load_sigma0_table()
    r = radar(channels=("HH",), frequency_ghz=1.25, soil_moisture_low=0.1, soil_moisture_high=0.3)
    for run in range(1, 6):
        plain, wet = (simulate_radar(site(layer), r, table, seed=1, run_id=run).occasion for layer in (False, True))
        assert plain.soil_moisture == wet.soil_moisture
        change = (wet.field_offset_db - plain.field_offset_db)[0]
        assert (np.diff(change[:4]) > 0.0).all()
        assert (change[4:] == 0.0).all()
        # The field at the middle of the range is as wet as the run.
        assert change[2] == pytest.approx(0.0, abs=0.05)


def test_the_radiometer_sees_wet_fields_cold():
    settings = {
        "frequency": 1.4, "polarization": "H", "resolution": 30.0, "bandwidth": 300.0, "noise_temperature": 300.0,
        "integration_time": 5.0, "scan_period": 2.0, "altitude_m": 500.0,
    }  # fmt: skip
    image = still_radiometer(site(), from_settings(settings), load_emissivity_table(), seed=1, run_id=1)
    np.testing.assert_allclose(image.occasion.field_moisture[:4], LEVELS, atol=1e-6)
    seen = image.mean_k[0].ravel()[image.pixel_of_cell]
    level = [np.nanmean(seen[12:18, 30 * k + 12 : 30 * k + 18]) for k in range(4)]
    assert (np.diff(level) < -2.0).all()


def test_the_layer_is_kept_checked_and_averaged(tmp_path):
    save_scene(site(), tmp_path / "s.npz")
    np.testing.assert_array_equal(load_scene(tmp_path / "s.npz").soil_moisture, site().soil_moisture)
    np.testing.assert_allclose(moisture_of_fields(site()), [*LEVELS, *LEVELS], rtol=1e-6)
    assert moisture_of_fields(site(False)) is None
    np.testing.assert_array_equal(coarse_scene(site(), 2).soil_moisture, site().soil_moisture[::2, ::2])
    for bad in (0.7, -0.1, np.nan):
        layer = site().soil_moisture.copy()
        layer[3, 3] = bad
        with pytest.raises(SceneError, match="soil_moisture"):
            dataclasses.replace(site(), soil_moisture=layer)
    with pytest.raises(SceneError, match="soil_moisture"):
        dataclasses.replace(site(), soil_moisture=np.zeros((2, 2), dtype=np.float32))
