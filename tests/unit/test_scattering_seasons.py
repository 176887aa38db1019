"""Fall, winter and snow: the snow against a radiative transfer code, the seasons against what they are made of."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from seqrsm.errors import ConfigurationError
from seqrsm.scattering.models import backscatter_oh92, permittivity_soil, permittivity_wet_snow_hallikainen86
from seqrsm.scattering.readers import POLARIZATIONS, shipped_rows
from seqrsm.scattering.seasons import snow_volume, under_snow
from seqrsm.scattering.sigma0 import load_sigma0_table
from seqrsm.scattering.worlds import World
from seqrsm.sensor.radar import RadarConfiguration, from_settings
from seqrsm.simulate.radar import occasion
from seqrsm.simulate.radar.occasion import draw_occasion
from seqrsm.simulate.visits import Visit
from seqrsm.units import linear_to_db

TABLE = load_sigma0_table()

# SMRT 1.7, IBA and DORT, 15 cm of snow of 250 kg/m3 and 0.2 mm correlation length over a black ground: VV [dB].
SMRT_VV = {
    1.25: (-65.3, -65.4, -65.6, -66.0, -66.7, -68.0),
    5.4: (-39.9, -40.0, -40.2, -40.6, -41.3, -42.6),
    9.6: (-29.9, -30.0, -30.3, -30.7, -31.4, -32.7),
    13.6: (-23.9, -24.1, -24.3, -24.7, -25.4, -26.7),
}


@pytest.mark.parametrize("frequency", SMRT_VV)
def test_dry_snow_is_that_of_a_radiative_transfer_code(frequency):
    volume, _ = snow_volume(frequency, 0.15, np.deg2rad(np.arange(10.0, 61.0, 10.0)))
    np.testing.assert_allclose(10.0 * np.log10(volume[1]), SMRT_VV[frequency], atol=0.2)


def test_snow_of_no_depth_changes_nothing_and_dry_snow_is_nearly_transparent_to_x_band():
    for snow in ("dry", "wet"):
        bare = TABLE.lookup(["Wheat"], 9.6, "HH", season="winter")
        none = TABLE.lookup(["Wheat"], 9.6, "HH", season="winter", snow=snow, snow_depth_cm=0.0)
        np.testing.assert_array_equal(none.sigma0, bare.sigma0)
        assert none.notes == bare.notes  # an empty one was among them
    for frequency, most in ((1.25, 0.01), (5.4, 0.1), (9.6, 0.3)):
        bare, dry = (
            10.0 * np.log10(TABLE.lookup(["Wheat"], frequency, "HH", season="winter", snow=s).sigma0[0, 40])
            for s in ("none", "dry")
        )
        assert abs(dry - bare) < most


def test_a_lookup_gives_the_depth_of_snow_in_cm():
    ground = [TABLE.lookup(["Wheat"], 5.4, channel, season="winter").sigma0[0] for channel in POLARIZATIONS]
    wanted, *_ = under_snow(10.0 * np.log10(ground), 5.4, "wet", 0.03)
    found = TABLE.lookup(["Wheat"], 5.4, "VV", season="winter", snow="wet", snow_depth_cm=3.0).sigma0[0]
    np.testing.assert_allclose(10.0 * np.log10(found[20:76]), wanted[2, 20:76], atol=1e-9)


def test_deep_wet_snow_hides_what_is_beneath_and_thin_snow_does_not():
    value = np.full((3, 91), -10.0)
    deep, *_ = under_snow(value, 9.6, "wet", 5.0)
    other, *_ = under_snow(value - 15.0, 9.6, "wet", 5.0)
    np.testing.assert_allclose(deep, other, atol=1e-9)
    thin, *_ = under_snow(value, 9.6, "wet", 1e-4)
    assert np.abs(thin[:, 20:60] - value[:, 20:60]).max() < 0.2


@pytest.mark.parametrize("frequency", [0.5, 1.25, 2.0, 3.0, 4.5, 5.4, 13.6])
def test_deep_wet_snow_is_that_of_ulaby_and_dobson(frequency):
    """p1 + p2 exp(-p3 t) + p4 cos(p5 t + p6) at L, S and C, straight over the logarithm of frequency between."""
    rows, theta = shipped_rows("snow_wet.csv"), np.deg2rad(np.arange(20.0, 61.0))
    found, *_ = under_snow(np.full((3, 91), -50.0), frequency, "wet", 500.0)
    for channel, level in zip(POLARIZATIONS, found, strict=True):
        own = [row for row in rows if row.text("polarization") == channel]
        nodes = [np.log(float(row.text("frequency_ghz"))) for row in own]
        p = np.array([[float(row.text(f"p{k}")) for k in range(1, 7)] for row in own])[:, :, None]
        values = p[:, 0] + p[:, 1] * np.exp(-p[:, 2] * theta) + p[:, 3] * np.cos(p[:, 4] * theta + p[:, 5])
        wanted = [np.interp(np.log(frequency), nodes, column) for column in values.T]
        np.testing.assert_allclose(level[20:61], wanted, atol=1e-6)


def test_ground_under_dry_snow_is_weakened_twice_along_the_refracted_path():
    (row,) = (row for row in shipped_rows("snow_dry.csv") if float(row.text("frequency_ghz")) == 36.0)
    per_m = float(row.text("scattering_per_m")) + float(row.text("absorption_per_m"))
    found, *_ = under_snow(np.full((3, 91), -10.0), 36.0, "dry", 0.5)
    for theta in (0, 30, 60):
        inside = np.cos(np.arcsin(np.sin(np.deg2rad(theta)) / np.sqrt(float(row.text("permittivity")))))
        # HV has no volume of its own here.
        assert found[1, theta] == pytest.approx(-10.0 - 10.0 * np.log10(np.e) * 2.0 * per_m * 0.5 / inside)


def test_a_frozen_lake_is_smooth_ice_and_frozen_ground_feels_no_moisture():
    wavenumber, theta = 2.0 * np.pi * 5.4e9 / 299792458.0, np.deg2rad([30.0, 50.0])
    ice = backscatter_oh92(3.15 + 0.001j, wavenumber * 0.003, theta)
    soils = (4.5 + 0.2j, complex(permittivity_soil(5.4, 0.2)))  # frozen, and of 0.2 m3/m3
    frozen, thawed = (backscatter_oh92(soil, wavenumber * 0.01, theta) for soil in soils)
    for k, channel in enumerate(POLARIZATIONS):
        lake, winter = TABLE.lookup(["Water", "Bareground"], 5.4, channel, season="winter").sigma0[:, [30, 50]]
        summer = TABLE.lookup(["Bareground"], 5.4, channel, soil_moisture=0.2).sigma0[0, [30, 50]]
        np.testing.assert_allclose(lake, ice[k], rtol=1e-6)
        np.testing.assert_allclose(winter / summer, frozen[k] / thawed[k], rtol=1e-6)
    for season, frozen in (("spring_summer", False), ("winter", True)):
        dry, wet = (TABLE.lookup(["Bareground"], 5.4, "VV", season=season, soil_moisture=m).sigma0 for m in (0.1, 0.3))
        assert np.array_equal(dry, wet) == frozen


@pytest.mark.parametrize("season", ["fall", "winter"])
@pytest.mark.parametrize("frequency", [1.25, 3.0, 5.4, 9.6, 13.6])
@pytest.mark.parametrize("channel", POLARIZATIONS)
def test_every_category_is_known_in_every_season_and_band(season, frequency, channel):
    found = TABLE.lookup(TABLE.categories, frequency, channel, season=season)
    level = 10.0 * np.log10(found.sigma0[:, 20:61])
    assert np.isfinite(level).all()
    assert level.max() < 3.0
    assert all(any(note.startswith(f"{c}: {season}:") for note in found.notes) for c in TABLE.categories)


def test_harvested_fields_look_like_their_soil():
    fall, soil = (
        10.0 * np.log10(TABLE.lookup([c], 5.4, "VV", season="fall", soil_moisture=0.2).sigma0[0, 35])
        for c in ("Wheat", "Bareground")
    )
    summer = 10.0 * np.log10(TABLE.lookup(["Wheat"], 5.4, "VV").sigma0[0, 35])
    share = 0.85 * 10 ** (0.1 * soil) + 0.15 * 10 ** (0.1 * (summer - 3.0))
    assert fall == pytest.approx(10.0 * np.log10(share), abs=1e-9)


def test_x_and_ku_bands_have_the_level_of_c_band():
    low, found = (TABLE.lookup(["Grass", "Wheat"], f, "HH") for f in (5.4, 9.6))
    np.testing.assert_array_equal(found.sigma0, low.sigma0)
    assert found.status == ("assumed", "assumed")
    assert any("assumed_high_bands" in note for note in found.notes)


def test_ground_under_wet_snow_is_weakened_as_a_wave_that_goes_through_it_twice():
    """Of 3 cm at nadir: the field falls with Im(k n) one way, power twice as fast, and there and back twice again."""
    n = np.sqrt(complex(permittivity_wet_snow_hallikainen86(5.4, 0.3, 3.0)))
    through = np.exp(-4.0 * (2.0 * np.pi * 5.4e9 / 299_792_458.0) * n.imag * 0.03)
    strong, deep, found = (
        10.0 ** (0.1 * under_snow(np.full((3, 91), 10.0), 5.4, "wet", depth)[0][2, 0]) for depth in (0.0, 50.0, 0.03)
    )
    assert (found - deep) / (strong - deep) == pytest.approx(through, rel=1e-6)


def test_dry_snow_takes_from_horizontal_waves_what_its_surface_reflects_twice():
    """Its volume scatters both alike; at 60 deg H loses its Fresnel reflection going in and out, V hardly any."""
    (row,) = (row for row in shipped_rows("snow_dry.csv") if float(row.text("frequency_ghz")) == 36.0)
    eps = float(row.text("permittivity"))
    (hh, vv), _ = snow_volume(36.0, 0.5, np.array([np.pi / 3.0]))
    into = np.sqrt(eps - 0.75)
    h, v = (0.5 - into) / (0.5 + into), (0.5 * eps - into) / (0.5 * eps + into)
    assert float(hh[0] / vv[0]) == pytest.approx(((1.0 - h**2) / (1.0 - v**2)) ** 2, rel=1e-9)


def test_snow_needs_a_winter():
    with pytest.raises(ConfigurationError, match="winter only"):
        RadarConfiguration(9.6, ("HH",), 30.0, 50.0, 100.0, 45.0, 6000.0, snow="dry")


CROPS = ("Wheat", "Oats", "Vegetables")


def departures(season: str, names: tuple[str, ...] = CROPS, **state: object) -> tuple[np.ndarray, np.ndarray]:
    """Standard deviation over worlds of what covers differ by [dB], and correlation of the first two's departures."""
    table = load_sigma0_table()
    own = table.lookup(names, 5.4, "VV", season=season, **state)
    db = np.array(
        [
            linear_to_db(table.in_world(World(3, k)).lookup(names, 5.4, "VV", season=season, **state).sigma0[:, 40])
            for k in range(300)
        ]
    )
    away = db - linear_to_db(own.sigma0[:, 40])
    np.testing.assert_allclose(away.std(axis=0), own.mean_sd_db, rtol=0.15)
    return (away[:, 1:] - away[:, :1]).std(axis=0), np.corrcoef(away.T)[0]


def test_what_is_not_known_of_crops_that_do_not_stand_is_the_soils() -> None:
    """They were told apart in winter by 66 % of their fields, as in summer: each departed by itself."""
    apart, related = departures("spring_summer")
    assert (apart > 1.5).all()
    assert (related[1:] < 0.75).all()
    apart, related = departures("winter", (*CROPS, "Bareground"))
    assert (apart < 0.35).all()
    assert (related > 0.99).all()
    spring, fall = (load_sigma0_table().lookup(("Bareground",), 5.4, "HH", season=s) for s in ("spring_summer", "fall"))
    np.testing.assert_array_equal(fall.of_fields_db(40.0), spring.of_fields_db(40.0))  # roughness and all
    apart, _ = departures("fall")
    assert (apart < 1.0).all()


def test_fields_and_dates_of_bare_ground_depart_alike_whatever_was_sown() -> None:
    names = (*CROPS, "Bareground")
    summer, winter = (load_sigma0_table().lookup(names, 5.4, "HV", season=s) for s in ("spring_summer", "winter"))
    np.testing.assert_array_equal(summer.closed[:3], 1.0)
    assert np.ptp(summer.field_sd_db) > 1.5
    assert np.ptp(summer.date_sd_db) > 1.5
    np.testing.assert_allclose(winter.closed, [0.05, 0.05, 0.05, 0.0], atol=1e-12)
    np.testing.assert_allclose(winter.field_sd_db, 1.6, atol=0.1)
    bare, world = ("Bareground",), World(3, 1)
    there = load_sigma0_table().in_world(world).lookup(bare, 5.4, "HV", season="winter")
    assert there.field_sd_db[0] == pytest.approx(1.6 * world.field_factor("Bareground"))
    told = [
        any(note.startswith("ground that is bare") for note in one.notes)
        for one in (winter, summer, load_sigma0_table().lookup(names, 5.4, "HV", day=300.0))
    ]
    assert told == [True, False, False]
    np.testing.assert_allclose(winter.date_sd_db, 1.0, atol=0.1)
    np.testing.assert_allclose(winter.mean_sd_db, winter.mean_sd_db[3], atol=0.1)  # frozen soil's
    assert winter.mean_sd_db[3] > summer.mean_sd_db[3]
    given = {"bandwidth": 50.0, "peak_power": 30.0, "altitude_m": 6000.0}
    one = from_settings({"frequency": 5.4, "polarization": "HV", "resolution": 20.0, "depression_angle": 50.0}, given)
    fall = load_sigma0_table().lookup(names, 5.4, "HV", season="fall")  # soil drew for itself: 1.4 dB from stubble
    for lookup, alike in ((winter, 0.99), (fall, 0.85)):
        met = [
            draw_occasion(
                one, [lookup], np.arange(4, dtype=np.uint8), (0.2, 5.0), Visit(), seed=1, run_id=k
            ).class_offset_db[0]
            for k in range(200)
        ]
        assert np.corrcoef(np.array(met).T).min() > alike


@pytest.mark.parametrize("depth_cm", [15.0, 60.0])
def test_nothing_is_seen_of_covers_under_deep_wet_snow(depth_cm: float) -> None:
    """All but trees and buildings differ by nothing at C band and above, in any world: crops were told by 57 %."""
    names = ("Wheat", "Grass", "Bareground", "Gravel")
    for world in (None, World(3, 1), World(3, 2)):
        table = load_sigma0_table().in_world(world)
        found = table.lookup(names, 9.6, "VV", season="winter", snow="wet", snow_depth_cm=depth_cm)
        assert np.ptp(linear_to_db(found.sigma0[:, 40])) < 0.1
        assert np.ptp(found.field_sd_db) < 0.1
        assert (found.closed < 0.05).all()
    clear, dry = (
        load_sigma0_table().lookup(names, 1.25, "VV", season="winter", snow=snow, snow_depth_cm=depth_cm)
        for snow in ("none", "dry")
    )
    np.testing.assert_allclose(dry.closed, clear.closed, atol=0.01)  # L band sees through
    hidden = load_sigma0_table().lookup(names, 17.0, "VV", season="winter", snow="dry", snow_depth_cm=10 * depth_cm)
    assert (hidden.closed[[1, 3]] < 0.8 * clear.closed[[1, 3]]).all()


def test_fields_that_lie_bare_relate_hh_and_vv_as_bare_soil_does() -> None:
    names = ("Bareground", "Wheat")
    soil, wheat = (
        occasion._related(5.4, TABLE, TABLE.lookup(names, 5.4, "HH", season=season)).mean
        for season in ("spring_summer", "winter")
    )
    assert abs(soil[0] - soil[1]) > 0.05
    assert wheat[1] == pytest.approx(0.05 * soil[1] + 0.95 * soil[0])


def test_bare_fields_are_as_well_known_as_bare_soil_of_ones_own(tmp_path) -> None:
    rows = [f"sigma0,Bareground,5.4,VV,winter,{theta},-12,0.3,dB,measured,me\n" for theta in (20, 60)]
    header = "quantity,category,frequency_ghz,polarization,season,theta_deg,value,mean_sd,unit,status,source\n"
    (tmp_path / "own.csv").write_text(header + "".join(rows), encoding="utf-8")
    table = load_sigma0_table(tmp_path / "own.csv")
    key = {"frequency_ghz": 5.4, "polarization": "VV", "season": "winter"}
    ours, shipped = (one.lookup(("Wheat",), **key).mean_sd_db[0] for one in (table, TABLE))
    (soil,) = TABLE.lookup(("Bareground",), **key).mean_sd_db
    assert ours == pytest.approx(shipped + 0.95 * (0.3 - soil))


def test_bare_soil_of_ones_own_departs_under_snow_as_without() -> None:
    table, key = load_sigma0_table(), ("Bareground", "winter")
    own = replace(table, curves={**table.curves, key: replace(table.curves[key], soil_share=0.0)})
    found = [
        own.in_world(World(3, k)).lookup(key[:1], 5.4, "VV", season="winter", snow="wet", snow_depth_cm=4.0)
        for k in range(600)
    ]
    assert found[0].closed[0] == 0.0
    assert np.std([linear_to_db(one.sigma0[0, 40]) for one in found]) == pytest.approx(found[0].mean_sd_db[0], rel=0.08)
