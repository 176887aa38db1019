"""Laws that any backscatter obeys, held against the models and the whole table."""

from __future__ import annotations

import numpy as np
import pytest

from seqrsm.scattering.curves import limit_db, moisture_change_db
from seqrsm.scattering.models import backscatter_layer_ulaby14, backscatter_oh04, backscatter_oh92, reflectivity_fresnel
from seqrsm.scattering.sigma0 import load_sigma0_table
from seqrsm.scattering.worlds import World

TABLE = load_sigma0_table()
FREQUENCIES = (0.65, 1.25, 2.0, 3.0, 5.4, 9.6, 10.7)
SURFACES = ("Bareground", "Gravel", "Asphalt", "Water")
THETA = np.deg2rad(np.arange(0.0, 90.0, 0.5))


def db(category: str, frequency: float, channel: str, **state: float) -> np.ndarray:
    return 10.0 * np.log10(TABLE.lookup([category], frequency, channel, **state).sigma0[0])


@pytest.mark.parametrize("frequency", FREQUENCIES)
@pytest.mark.parametrize("category", SURFACES)
@pytest.mark.parametrize("moisture", [0.05, 0.2, 0.29])
def test_surfaces_depolarize_little(category: str, frequency: float, moisture: float) -> None:
    hh, hv, vv = (db(category, frequency, p, soil_moisture=moisture) for p in ("HH", "HV", "VV"))
    free = hv > -59.999
    assert np.all(hv[free] <= np.minimum(hh, vv)[free] - 3.0 + 1e-9)


@pytest.mark.parametrize("frequency", FREQUENCIES)
@pytest.mark.parametrize("category", TABLE.categories)
def test_cross_stays_below_co_and_caps_hold(category: str, frequency: float) -> None:
    hh, hv, vv = (db(category, frequency, p) for p in ("HH", "HV", "VV"))
    free = hv > -59.999
    assert np.all(hv[free] < np.minimum(hh, vv)[free])
    cap = 20.0 if category == "Water" else 12.0
    assert max(hh.max(), vv.max()) <= cap + 1e-9
    assert hv.max() <= -3.0 + 1e-9
    assert min(hh.min(), hv.min(), vv.min()) >= -60.0 - 1e-9


@pytest.mark.parametrize("world", [None, World(1, 2)])
@pytest.mark.parametrize("frequency", [0.65, 1.25, 3.0, 5.4, 17.0])
def test_polarizations_meet_at_nadir(frequency: float, world: World | None) -> None:
    """Ground that is the same from all sides cannot tell H from V there, in any world."""
    hh, vv = (TABLE.in_world(world).lookup(TABLE.categories, frequency, p).sigma0 for p in ("HH", "VV"))
    apart_db = 10.0 * np.abs(np.log10(hh / vv))
    np.testing.assert_allclose(apart_db[:, 0], 0.0, atol=1e-9)
    assert (apart_db[:, 2] < 0.013 * apart_db[:, 20].max()).all()  # (sin 2 / sin 20)^2 is 0.0104


@pytest.mark.parametrize("frequency", [1.25, 3.0, 5.4])
@pytest.mark.parametrize("category", TABLE.categories)
@pytest.mark.parametrize("channel", ["HH", "HV", "VV"])
def test_backscatter_falls_with_incidence(category: str, frequency: float, channel: str) -> None:
    value = db(category, frequency, channel)
    rise = value[:61] - np.minimum.accumulate(value[:61])
    # What the published regressions allow themselves; walls send HH and VV apart by 4.8 dB in L band, alike at nadir.
    assert rise.max() < (2.4 if category == "Buildings" else 1.6)


@pytest.mark.parametrize("category", TABLE.categories)
def test_grazing_is_constant_gamma(category: str) -> None:
    sigma0 = TABLE.lookup([category], 3.0, "VV").sigma0[0]
    angle = np.arange(75, 88)
    gamma = sigma0[angle] / np.cos(np.deg2rad(angle))
    assert gamma == pytest.approx(np.full(angle.size, gamma[0]), rel=1e-9)
    assert sigma0[90] == pytest.approx(1e-6)
    assert abs(10.0 * np.log10(sigma0[75] / sigma0[74])) < 1.0  # and goes on from the curve before


@pytest.mark.parametrize("epsilon", [2.0 + 0j, 4.0 - 0.1j, 9.0 - 0.9j, 60.0 + 30.0j])
def test_fresnel(epsilon: complex) -> None:
    r = reflectivity_fresnel(epsilon, THETA)
    assert np.all(r.v <= r.h + 1e-12)  # emissivity e_v >= e_h
    assert r.h[0] == pytest.approx(r.v[0], rel=1e-12)
    assert np.all(np.diff(r.h) > 0)
    assert np.all((r.h >= 0) & (r.h <= 1) & (r.v >= 0) & (r.v <= 1))


def test_brewster_angle() -> None:
    brewster = np.arctan(np.sqrt(5.0))
    assert reflectivity_fresnel(5.0 + 0j, brewster).v == pytest.approx(0.0, abs=1e-20)


def test_reflection_and_transmission_add_up_to_one() -> None:
    """Energy flux through a lossless boundary, from the transmitted amplitudes (an independent formula)."""
    n, theta = 2.5, np.deg2rad(40.0)
    inner = np.arcsin(np.sin(theta) / n)
    ratio = n * np.cos(inner) / np.cos(theta)
    t_h = 2.0 * np.cos(theta) / (np.cos(theta) + n * np.cos(inner))
    t_v = 2.0 * np.cos(theta) / (n * np.cos(theta) + np.cos(inner))
    r = reflectivity_fresnel(n**2 + 0j, theta)
    assert r.h + ratio * t_h**2 == pytest.approx(1.0)
    assert r.v + ratio * t_v**2 == pytest.approx(1.0)


def test_rough_surface_models() -> None:
    theta = np.deg2rad(np.arange(5.0, 71.0))
    for model in (backscatter_oh92(9.0 - 0.9j, 0.8, theta), backscatter_oh04(0.2, 0.8, theta)):
        assert np.all(model.hh <= model.vv)
        assert np.all(model.hv < model.hh)
        assert np.all(np.diff(model.vv) < 0)
    smooth, rough = (backscatter_oh92(9.0 - 0.9j, ks, theta) for ks in (0.3, 1.5))
    assert np.all(rough.vv > smooth.vv)


def test_layer_limits() -> None:
    theta = np.deg2rad(40.0)
    assert backscatter_layer_ulaby14(0.07, 0.4, 0.1, 0.0, theta) == pytest.approx(0.07)  # no layer: the ground
    deep = 0.75 * 0.1 * np.cos(theta)  # opaque layer: half-space of Rayleigh scatterers
    assert backscatter_layer_ulaby14(0.07, 0.4, 0.1, 50.0, theta) == pytest.approx(deep)


def test_wetter_soil_is_brighter() -> None:
    values = [db("Bareground", 3.0, "VV", soil_moisture=mv)[40] for mv in (0.05, 0.1, 0.2, 0.29)]
    assert np.all(np.diff(values) > 0)
    assert db("Bareground", 3.0, "VV", soil_moisture=0.45)[40] == pytest.approx(
        db("Bareground", 3.0, "VV", soil_moisture=0.5)[40], abs=0.02
    )


@pytest.mark.parametrize(
    ("angle", "oh_deg", "baghdadi_deg"), [(5, 10.0, 18.0), (14, 14.0, 18.0), (40, 40.0, 40.0), (80, 70.0, 57.0)]
)
@pytest.mark.parametrize(
    ("moisture", "oh_mv", "percent"), [(0.1, 0.1, 10.0), (0.01, 0.04, 4.0), (0.35, 0.291, 35.0), (0.6, 0.291, 45.0)]
)
def test_moisture_and_angle_are_held_at_the_edges_of_each_models_range(
    angle: int, oh_deg: float, baghdadi_deg: float, moisture: float, oh_mv: float, percent: float
) -> None:
    ks, theta = 2.0 * np.pi * 3e9 / 299792458.0 * 0.01, np.deg2rad(oh_deg)
    prepared = 10.0 * np.log10(backscatter_oh04(oh_mv, ks, theta).hh / backscatter_oh04(0.2, ks, theta).hh)
    farmed = 10.0 * 0.009 * (percent - 20.0) / np.tan(np.deg2rad(baghdadi_deg))
    assert moisture_change_db(3.0, 0.01, moisture, 0.2)[0, angle] == pytest.approx(0.5 * (prepared + farmed))


@pytest.mark.parametrize(("channel", "slope"), [("HH", 0.009), ("HV", 0.011), ("VV", 0.008)])
def test_moisture_of_farmed_fields_shows_as_measured_at_low_angles(channel: str, slope: float) -> None:
    """Images: 0.2 to 0.3 dB a percent at 20 degrees, half of that at 40; prepared fields: 0.13 to 0.19 at both."""
    drier, wetter = (db("Bareground", 5.4, channel, soil_moisture=mv)[[20, 40]] for mv in (0.1, 0.2))
    told = 0.1 * (wetter - drier)
    theta = np.deg2rad([20.0, 40.0])
    ks, c = 2.0 * np.pi * 5.4e9 / 299792458.0 * 0.01, {"HH": 0, "HV": 1, "VV": 2}[channel]
    wet, dry = (np.stack(backscatter_oh04(mv, ks, theta))[c] for mv in (0.2, 0.1))
    prepared, farmed = np.log10(wet / dry), 10.0 * slope / np.tan(theta)
    assert np.all((told > np.minimum(prepared, farmed)) & (told < np.maximum(prepared, farmed)))
    assert told[0] > 1.25 * told[1]


def test_rougher_water_is_brighter_away_from_nadir_and_darker_at_it() -> None:
    calm, windy = (db("Water", 5.4, "VV", wind_m_s=w) for w in (3.0, 10.0))
    assert windy[40] > calm[40] + 3.0
    assert windy[0] < calm[0]


def test_forest_anchor() -> None:
    """L-HH of forest: -8.3 dB near 48 degrees over Flevoland; tropical forest has -6 to -7 near 38 (JERS-1)."""
    assert db("Trees", 1.25, "HH")[48] == pytest.approx(-8.26, abs=0.5)
    assert -8.5 < db("Trees", 1.25, "HH")[38] < -6.0


def test_cross_polarization_of_water_goes_by_the_logarithm_of_the_wind() -> None:
    """The RADARSAT-2 VH function at 3, 5 and 10 m/s [dB]; straight lines between, and on to 2 m/s."""
    told = {25: (-41.37, -36.62, -30.18), 35: (-42.05, -37.58, -31.51), 45: (-42.73, -38.55, -32.86)}
    for wind, parts in ((2.0, (0, 1)), (3.0, (0, 1)), (7.0, (1, 2)), (10.0, (1, 2))):
        share = np.log(wind / (3.0, 5.0, 10.0)[parts[0]]) / np.log((3.0, 5.0, 10.0)[parts[1]] / (3.0, 5.0)[parts[0]])
        for theta, level in told.items():
            wanted = level[parts[0]] + share * (level[parts[1]] - level[parts[0]])
            assert db("Water", 5.4, "HV", wind_m_s=wind)[theta] == pytest.approx(wanted, abs=0.02)


def test_mixture_is_linear_in_power() -> None:
    """Half a cell of each category: the mean of the powers, which in dB exceeds the mean of the dB (Jensen)."""
    found = TABLE.lookup(["Trees", "Asphalt"], 1.25, "HH")
    mixed = 10.0 * np.log10(found.sigma0[:, 40].mean())
    each = 10.0 * np.log10(found.sigma0[:, 40])
    assert mixed == pytest.approx(each.max() - 3.0, abs=0.02)
    assert mixed > each.mean() + 8.0


def test_limits_settle_the_ends() -> None:
    flat = np.full((3, 91), 30.0)
    land, sea = limit_db(flat, surface=False, water=False), limit_db(flat, surface=True, water=True)
    assert (land[0, 0], land[1, 0], sea[0, 0]) == (12.0, -3.0, 20.0)
    assert np.isnan(limit_db(np.full((3, 91), np.nan), surface=False, water=False)).all()


def test_hh_and_vv_keep_their_mean_from_20_deg_down_and_part_as_the_square_of_the_sine() -> None:
    angle = np.arange(91.0)
    given = np.stack([-5.0 - 0.1 * angle, -20.0 - 0.1 * angle, -9.0 - 0.2 * angle])
    before = given.copy()
    hh, hv, vv = limit_db(given, surface=False, water=False)
    np.testing.assert_array_equal(given, before)  # it may be a row of the table
    np.testing.assert_allclose((hh + vv)[:70], (given[0] + given[2])[:70])
    apart = 6.0 * (np.sin(np.deg2rad(angle[:21])) / np.sin(np.deg2rad(20.0))) ** 2  # 4 dB at nadir, 6 dB at 20 deg
    np.testing.assert_allclose((hh - vv)[:21], apart, atol=1e-12)
    np.testing.assert_allclose([hh[20:70], vv[20:70], hv[20:70]], given[[0, 2, 1], 20:70])
    # Of a table with one of them alone nothing is known of the other.
    given[2] = np.nan
    alone = limit_db(given, surface=False, water=False)
    np.testing.assert_allclose(alone[0, :70], given[0, :70])
    assert np.isnan(alone[2]).all()
