"""Atmosphere against the nodes of independent packages, limits, weather, and refusals."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from seqrsm.constants import COSMIC_BACKGROUND_K
from seqrsm.scattering.atmosphere import Atmosphere, cloud_db_per_kg_m2, make_atmosphere, rain_db_km
from seqrsm.scattering.readers import numbers_of, shipped_rows
from seqrsm.sensor.parameters import RADIOMETER

COLUMNS = [name for name in shipped_rows("atmosphere_nodes.csv")[0].cells if name not in ("status", "source")]
NODES = dict(zip(COLUMNS, numbers_of("atmosphere_nodes.csv", COLUMNS).T, strict=True))
MODELS = {"us_standard": "USstd", "midlatitude_summer": "MLS", "midlatitude_winter": "MLW"}


def zenith_loss_db(air: Atmosphere) -> float:
    """Loss of the whole atmosphere at the vertical [dB]."""
    return 10.0 / np.log(10.0) * float(air.depth_np.sum())


@pytest.mark.parametrize("name", MODELS)
def test_sky_and_loss_against_the_packages_numbers(name):
    # Stated accuracy of the packages among themselves: 1.3 K of sky temperature, 0.03 dB of loss.
    prefix = MODELS[name]
    for k, f in enumerate(NODES["frequency_ghz"]):
        air = make_atmosphere(float(f), atmosphere=name)
        loss = NODES[f"{prefix}_dry_db"][k] + NODES[f"{prefix}_wet_db"][k]
        assert zenith_loss_db(air) == pytest.approx(loss, rel=1e-9)
        # Above 36 GHz the heights of gases count, too, which layers take as exponential.
        most = 0.5 if f <= 36.0 else 2.5 if f <= 100.0 else 15.0 if 116.0 < f < 122.0 else 3.5
        assert float(air.sky_k(0.0)) == pytest.approx(NODES[f"{prefix}_tsky_zenith_k"][k], abs=most)


def test_radiation_of_the_air_to_space_is_that_of_the_line_model():
    """pyrtlib 1.2.0, model R20, seen from above at 89 GHz: mean radiating temperatures 270.7, 282.6 and 259.9 K."""
    for name, temperature in (("us_standard", 270.7), ("midlatitude_summer", 282.6), ("midlatitude_winter", 259.9)):
        air = make_atmosphere(89.0, atmosphere=name)
        share = 1.0 - float(air.transmission(0.0))
        assert float(air.upwelling_k(0.0)) == pytest.approx(share * temperature, abs=1.0)


def test_oxygen_hides_the_ground_and_the_windows_beside_it_show_it():
    """60 GHz: 155 dB straight up over a standard atmosphere (ITU-R P.676-13 by a second package: 154 dB)."""
    assert zenith_loss_db(make_atmosphere(60.0)) == pytest.approx(154.3, rel=0.02)
    assert float(make_atmosphere(60.0).transmission(0.0)) < 1e-15
    for f, dry, wet in zip(
        *(NODES[f"{name}"] for name in ("frequency_ghz", "P676_13_dry_db", "P676_13_wet_db")), strict=True
    ):
        if f > 100.0:
            break
        shown = 10.0 ** (-0.1 * (dry + wet))
        assert float(make_atmosphere(f).transmission(0.0)) == pytest.approx(shown, abs=0.025)


@pytest.mark.parametrize(
    ("f", "db"), [(105.0, 1.025), (113.0, 1.690), (125.0, 1.786), (150.0, 1.980), (165.5, 3.243), (170.0, 4.372)]
)
def test_loss_above_100_ghz_is_that_of_a_second_package(f, db):
    """ITU-R P.676-12 line by line over the standard atmosphere of P.835, by itur 0.4.0; vapour's continua differ."""
    assert zenith_loss_db(make_atmosphere(f)) == pytest.approx(db, rel=0.14)
    assert float(make_atmosphere(f).transmission(0.0)) == pytest.approx(10.0 ** (-0.1 * db), abs=0.04)
    assert zenith_loss_db(make_atmosphere(118.75)) > 100.0  # a line of oxygen hides the ground


def test_loss_between_nodes_lies_between_them():
    f = NODES["frequency_ghz"]
    for low, high in itertools.pairwise(f):
        ends = sorted(zenith_loss_db(make_atmosphere(float(g))) for g in (low, high))
        assert 0.99 * ends[0] <= zenith_loss_db(make_atmosphere(float(np.sqrt(low * high)))) <= ends[1] + 1e-12


def test_layers_add_up_from_ground_to_space():
    air = make_atmosphere(22.235, atmosphere="midlatitude_summer")
    theta = np.deg2rad(np.array([0.0, 40.0, 60.0]))
    # Seen from space, sky and up-welling have the same total depth; near the ground nothing is below.
    np.testing.assert_allclose(
        -10.0 * np.log10(air.transmission(theta)), zenith_loss_db(air) / np.cos(theta), rtol=1e-12
    )
    np.testing.assert_allclose(air.transmission(theta, 0.0), 1.0)
    np.testing.assert_allclose(air.upwelling_k(theta, 0.0), 0.0)
    heights = [100.0, 1000.0, 5000.0, 2e4, 8e5]
    losses = [1.0 / float(air.transmission(0.0, h)) for h in heights]
    assert losses == sorted(losses)
    # The air below a craft at 2 km is warmer than all of it together.
    low = float(air.upwelling_k(0.0, 2000.0)) / (1.0 - float(air.transmission(0.0, 2000.0)))
    whole = float(air.upwelling_k(0.0)) / (1.0 - float(air.transmission(0.0)))
    assert 270.0 < whole < low < 294.2


def test_grazing_paths_are_held_and_finite():
    air = make_atmosphere(36.0)
    sky = air.sky_k(np.deg2rad(np.array([0.0, 60.0, 75.0, 80.0, 90.0])))
    assert (np.diff(sky) >= -1e-12).all()
    assert sky[2] == pytest.approx(sky[4])


def test_no_atmosphere_leaves_space():
    air = make_atmosphere(10.0, atmosphere="none")
    assert 1.0 / float(air.transmission(1.0)) == 1.0
    assert float(air.sky_k(0.3)) == COSMIC_BACKGROUND_K


@pytest.mark.parametrize(("f", "k_h", "alpha_h", "k_v", "alpha_v"), [
    (1.0, 2.59e-5, 0.9691, 3.08e-5, 0.8592), (10.0, 0.01217, 1.2571, 0.01129, 1.2156),
    (30.0, 0.2403, 0.9485, 0.2291, 0.9129), (100.0, 1.3671, 0.6815, 1.3680, 0.6765),
])  # fmt: skip
def test_loss_of_rain_is_that_of_the_recommendations_table(f, k_h, alpha_h, k_v, alpha_v):
    """ITU-R P.838-3, table 5."""
    for rate in (2.0, 50.0):
        assert rain_db_km(f, rate) == pytest.approx(0.5 * (k_h * rate**alpha_h + k_v * rate**alpha_v), rel=5e-4)
    assert rain_db_km(f, 0.0) == 0.0
    assert rain_db_km(0.4, 5.0) == rain_db_km(1.0, 5.0)


def test_weather_adds_loss_where_its_drops_are():
    """A cloud from 1 to 2 km, rain from the ground to 3 km."""
    for height_m, of_cloud, rain_km in (
        (500.0, 0.0, 0.5), (1220.0, 0.22, 1.22), (1910.0, 0.91, 1.91), (2930.0, 1.0, 2.93), (np.inf, 1.0, 3.0)
    ):  # fmt: skip
        clear, cloud, rain = (
            -10.0 * np.log10(float(make_atmosphere(30.0, weather=w).transmission(0.0, height_m)))
            for w in ("clear", "cloud", "rain")
        )
        assert cloud - clear == pytest.approx(of_cloud * 0.3 * cloud_db_per_kg_m2(30.0), abs=1e-9)
        assert rain - cloud == pytest.approx(rain_km * rain_db_km(30.0, 5.0))


def test_a_radiometer_is_asked_for_no_air_that_is_not_known():
    limits = RADIOMETER["frequency"]
    assert (limits.low, limits.high) == (NODES["frequency_ghz"][0], NODES["frequency_ghz"][-1])
    assert set(RADIOMETER["atmosphere"].levels) == {*MODELS, "none"}
    assert min(RADIOMETER[name].low for name in ("cloud_kg_m2", "rain_mm_h")) == 0.0


def test_thick_air_shows_the_layer_nearest_to_the_observer():
    air = Atmosphere(np.array([20.0, 20.0]), np.array([300.0, 200.0]), np.array([0.0, 1.0, 2.0]), 3.0, ())
    assert float(air.upwelling_k(0.0)) == pytest.approx(200.0)
    assert float(air.upwelling_k(0.0, 1000.0)) == pytest.approx(300.0)
    assert float(air.sky_k(0.0)) == pytest.approx(300.0)
