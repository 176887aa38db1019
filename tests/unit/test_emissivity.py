"""Emissivity: Table 3 to the last digit, laws of polarization, independent numbers, user tables, errors that name."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from scipy import optimize

from seqrsm.errors import ScatteringDataError
from seqrsm.scattering.calendar import SHIPPED, season_depth
from seqrsm.scattering.emissivity import MOISTURE_NODES, departed, emissivity_mo82, load_emissivity_table
from seqrsm.scattering.emissivity_curves import interpolated
from seqrsm.scattering.models import permittivity_soil, permittivity_water_ulaby14, reflectivity_fresnel
from seqrsm.scattering.readers import shipped_rows
from seqrsm.scattering.sigma0 import load_sigma0_table

TABLE = load_emissivity_table()

# RSL TR 380-1, Table 3, typed from the report: 0, 10, ... 80 deg.
TABLE_3 = {
    "Swamp": (0.70, 0.69, 0.68, 0.67, 0.65, 0.62, 0.59, 0.58, 0.55),
    "Bareground": (0.85, 0.84, 0.82, 0.81, 0.78, 0.71, 0.68, 0.65, 0.60),
    "Gravel": (0.85, 0.84, 0.84, 0.83, 0.81, 0.77, 0.73, 0.64, 0.46),
    "Trees": (0.88, 0.88, 0.88, 0.87, 0.86, 0.84, 0.82, 0.80, 0.79),
    "Grass": (0.93, 0.93, 0.93, 0.93, 0.93, 0.93, 0.93, 0.93, 0.93),
    "Scrub": (0.91, 0.91, 0.90, 0.89, 0.88, 0.86, 0.84, 0.82, 0.80),
    "Hay": (0.93, 0.93, 0.93, 0.93, 0.93, 0.93, 0.94, 0.92, 0.93),
    "Oats": (0.92, 0.92, 0.92, 0.92, 0.92, 0.91, 0.90, 0.88, 0.84),
    "Corn": (0.91, 0.91, 0.90, 0.89, 0.88, 0.86, 0.84, 0.82, 0.80),
    "Wheat": (0.97, 0.97, 0.96, 0.96, 0.96, 0.96, 0.97, 0.93, 0.92),
    "Forage": (0.93, 0.93, 0.93, 0.93, 0.93, 0.93, 0.94, 0.92, 0.93),
    "Vegetables": (0.92, 0.92, 0.92, 0.91, 0.90, 0.89, 0.88, 0.87, 0.86),
    "Water": (0.41, 0.40, 0.39, 0.36, 0.31, 0.26, 0.23, 0.20, 0.18),
    "Asphalt": (0.89, 0.87, 0.84, 0.78, 0.70, 0.62, 0.52, 0.42, 0.32),
}


@pytest.mark.parametrize("name", TABLE_3)
def test_table_3_to_the_last_digit_at_its_nodes(name):
    printed = TABLE.curves[name].value[20.0, "H"][:81:10]
    np.testing.assert_array_equal(printed, TABLE_3[name])
    own = TABLE.lookup([name], 20.0, "H")
    node = int(np.flatnonzero(MOISTURE_NODES == 0.2)[0]) if own.moist[0] else 0
    np.testing.assert_allclose(own.emissivity[0, node, :81:10], TABLE_3[name], rtol=0, atol=2e-16)


@pytest.mark.parametrize("name", TABLE_3)
def test_interpolation_never_leaves_the_values_of_its_two_nodes(name):
    e = TABLE.curves[name].value[20.0, "H"]
    for k in range(8):
        between = e[10 * k : 10 * k + 11]
        assert between.min() >= min(between[0], between[-1]) - 1e-15
        assert between.max() <= max(between[0], between[-1]) + 1e-15
        assert (np.diff(between) * np.sign(between[-1] - between[0]) >= -1e-15).all()
    assert (e[80:] == e[80]).all()


@pytest.mark.parametrize("frequency", [1.4, 5.4, 10.7, 20.0, 36.0])
def test_h_and_v_meet_at_nadir_and_v_is_above_below_brewster(frequency):
    h, v = (TABLE.lookup(TABLE.curves, frequency, p).emissivity for p in "HV")
    np.testing.assert_allclose(h[..., 0], v[..., 0], rtol=1e-12)
    # Brewster's angle of the driest ground here is 60 deg and more.
    assert (v[..., :61] >= h[..., :61] - 1e-12).all()
    for e in (h, v):
        assert e.min() >= 0.0
        assert e.max() <= 1.0


@pytest.mark.parametrize("theta", [0, 40])
def test_bare_soil_darkens_with_moisture_as_radiometers_measured(theta):
    """By 3.4 K at L band for each percent by volume if bare, 2.7 K with rough and vegetated watersheds (1 to 4 GHz from
    truck and aircraft); by 70 K at 1.4 GHz, but 40 K at 10.7 GHz, from 2 to 15 % of prepared fields (Njoku and O'Neill
    1982). With the roughness of 20 GHz at all frequencies it was 1.8 K, 29 and 25 K at nadir.
    """

    def change_k(ghz, dry, wet):
        line = TABLE.lookup(["Bareground"], ghz, "H").emissivity[0, :, theta]
        return 293.0 * float(np.diff(np.interp([dry, wet], MOISTURE_NODES, line))[0])

    assert -3.4 < change_k(1.4, 0.05, 0.35) / 30.0 < -2.3
    assert -70.0 < change_k(1.4, 0.02, 0.15) < -35.0
    assert 1.3 < change_k(1.4, 0.02, 0.15) / change_k(10.7, 0.02, 0.15) < 1.75


def test_soil_moisture_darkens_soil_and_what_lets_it_through():
    look = TABLE.lookup(TABLE.curves, 1.4, "H")
    change = look.emissivity[:, -1, 30] - look.emissivity[:, 0, 30]
    for name, moist, step in zip(look.categories, look.moist, change, strict=True):
        assert (step < -0.02) == moist, name
        if not moist:
            assert step == 0.0
    # Vegetation hides the soil more at a higher frequency.
    grass = [np.ptp(TABLE.lookup(["Grass"], f, "H").emissivity[0, :, 30]) for f in (1.4, 5.4, 10.7)]
    assert grass[0] > 1.5 * grass[1] > 2.0 * grass[2]


@pytest.mark.parametrize(("day", "depth"), [(180, 0.64), (210, 0.91)])
def test_a_radiometer_sees_the_canopy_that_a_radar_sees(day, depth):
    """Maize by WOFOST for Brussels, with b = 0.15 of crops at L band in ECMWF's CMEM."""
    seasonal = TABLE.models["Corn"].tau_20ghz * 1.4 / 20.0
    assert seasonal * SHIPPED.canopy_share("Corn", day) == pytest.approx(depth, rel=0.02)
    assert seasonal == pytest.approx(season_depth("Corn", 1.4), rel=1e-12)


CANOPIES = ["Trees", "Grass", "Hay", "Oats", "Corn", "Wheat", "Forage", "Vegetables"]


@pytest.mark.parametrize("name", CANOPIES)
def test_albedo_of_a_canopy_is_the_best_for_table_3(name):
    model, theta = TABLE.models[name], np.deg2rad(np.arange(0.0, 81.0, 10.0))
    soil = permittivity_soil(20.0, np.array([0.2]))

    def rms(omega):
        own = emissivity_mo82(soil, model.roughness, model.tau_20ghz, omega, theta, "H")
        return np.sqrt(np.mean((own - TABLE_3[name]) ** 2))

    best = optimize.minimize_scalar(rms, bounds=(0.0, 0.3), method="bounded")
    assert model.omega == pytest.approx(best.x, abs=1e-3)
    (row,) = (row for row in shipped_rows("emissivity_models.csv") if row.text("category") == name)
    assert row.text("rms_of_fit") == f"{rms(model.omega):.4f}"


def test_dense_crops_hide_the_soil_above_l_band():
    """Njoku et al. 2003 (IEEE TGRS 41(2)): at 6.9 GHz soil shows through canopies of up to 1.5 kg/m2 only."""
    for name in ("Corn", "Wheat", "Vegetables"):  # 2 to 5 kg/m2
        at = {f: np.ptp(TABLE.lookup([name], f, "H").emissivity[0, 3:11, 40]) for f in (1.4, 6.9, 10.7)}
        assert at[1.4] > 0.02
        assert at[6.9] < 0.1 * at[1.4] > at[10.7]


def test_departures_hold_at_nadir_and_go_with_the_reflectivity():
    """At nadir as the tables state, H as V; elsewhere by the ratio of reflectivities, so that V departs by less."""
    stated = {row.text("category"): float(row.text("field_sd")) for row in shipped_rows("emissivity_variability.csv")}
    covers = tuple(stated)
    for f in (1.4, 10.7, 36.0):
        h, v = (TABLE.lookup(covers, f, p) for p in "HV")
        wet = h.emissivity.shape[1] * 6 // 17  # the node of 0.2 m3/m3
        for look in (h, v):
            np.testing.assert_allclose(look.field_part * (1.0 - look.emissivity[:, wet, 0]), list(stated.values()))
            np.testing.assert_allclose(
                look.mean_part * (1.0 - look.emissivity[:, wet, 0]),
                np.minimum(look.mean_sd, 1.0 - look.emissivity[:, wet, 0]),
            )
        np.testing.assert_allclose(h.field_part, v.field_part, rtol=1e-9)
        np.testing.assert_allclose(h.date_part, v.date_part, rtol=1e-9)
        apart = [departed(look.emissivity, look.field_part[:, None, None]) - look.emissivity for look in (h, v)]
        np.testing.assert_allclose(apart[0][..., 0], apart[1][..., 0], atol=1e-9)
        of_table = (1.0 - v.emissivity[..., 50]) / (1.0 - h.emissivity[..., 50])
        np.testing.assert_allclose(apart[1][..., 50] / apart[0][..., 50], of_table, rtol=1e-9)
        assert (of_table < 1.0 + 1e-9).all()
    soil = covers.index("Bareground")
    assert apart[1][soil, 6, 50] < 0.25 * apart[0][soil, 6, 50]  # of soil at 36 GHz


@pytest.mark.parametrize(
    "covers", [("Bareground", "Gravel", "Asphalt"), ("Hay", "Oats", "Corn", "Wheat", "Forage", "Vegetables")]
)
def test_covers_of_table_3_differ_as_they_reflect(covers):
    """A spread in proportion to 1 - e fits that of like covers over the angles better than a constant."""
    e = np.array([TABLE_3[name] for name in covers])
    spread, reflected = e.std(axis=0, ddof=1), 1.0 - e.mean(axis=0)

    def rms(law):
        best = spread @ law / (law @ law)
        return np.sqrt(np.mean(np.square(spread - best * law)))

    assert rms(reflected) < 0.6 * rms(np.ones(9))


def test_water_follows_the_dielectric_model():
    theta = np.deg2rad(np.arange(0.0, 81.0, 10.0))
    for f in (1.4, 10.7, 36.0):
        ratio = (1.0 - TABLE.lookup(["Water"], f, "V").emissivity[0, 0, :81:10]) / (1.0 - np.array(TABLE_3["Water"]))
        model = [reflectivity_fresnel(complex(permittivity_water_ulaby14(g, 20.0)), theta) for g in (f, 20.0)]
        np.testing.assert_allclose(ratio, model[0].v / model[1].h, rtol=1e-9)
    # Independent run of the book's code: fresh water, 20 C, 10.7 GHz, 40 deg: 0.4598 (V), 0.3034 (H).
    water = reflectivity_fresnel(complex(permittivity_water_ulaby14(10.7, 20.0)), np.deg2rad(40.0))
    assert 1.0 - water.v == pytest.approx(0.4598, abs=5e-5)
    assert 1.0 - water.h == pytest.approx(0.3034, abs=5e-5)


def test_a_swamp_reflects_as_ground_whose_permittivity_goes_with_that_of_water():
    """Under the row's layer of 0.011 Np at 20 GHz, without albedo; its roughness is the same at all frequencies."""

    def reflected(f: float) -> float:
        of_water = [abs(complex(permittivity_water_ulaby14(g, 20.0))) for g in (f, 20.0)]
        root = np.sqrt(46.56 * (1.0 + 0.15j) * of_water[0] / of_water[1])
        return abs((root - 1.0) / (root + 1.0)) ** 2 * np.exp(-2.0 * 0.011 * f / 20.0)

    for f in (1.4, 6.9, 36.5):
        found = TABLE.lookup(["Swamp"], f, "H").emissivity[0, 0, 0]
        assert 1.0 - found == pytest.approx((1.0 - TABLE_3["Swamp"][0]) * reflected(f) / reflected(20.0), rel=1e-9)


def test_angles_between_whole_degrees_are_on_straight_lines():
    found = TABLE.lookup(["Bareground", "Water"], 1.4, "V")
    angles = np.array([[0.0, 0.3, 12.75], [79.9, 90.0, 95.0]])
    wanted = [[np.interp(angles, np.arange(91), line) for line in of_cover] for of_cover in found.emissivity]
    np.testing.assert_allclose(found.at_angles(angles), wanted, rtol=1e-12)


@pytest.mark.parametrize("f", [1.4, 18.7, 36.5, 89.0, 100.0, 166.0])
def test_water_is_that_of_another_fit(f):
    """Fresh water at 20 C by Meissner and Wentz 2004 (IEEE TGRS 42(9), 1836-1849, eq. 8 to 11)."""
    t = 20.0
    static = (3.70886e4 - 8.2168e1 * t) / (4.21854e2 + t)
    first = 5.7230 + 2.2379e-2 * t - 7.1237e-4 * t**2
    slow = (45.0 + t) / (5.0478 - 7.0315e-2 * t + 6.0059e-4 * t**2)
    infinite = 3.6143 + 2.8841e-2 * t
    fast = (45.0 + t) / (1.3652e-1 + 1.4825e-3 * t + 2.4166e-4 * t**2)
    wentz = (static - first) / (1 - 1j * f / slow) + (first - infinite) / (1 - 1j * f / fast) + infinite
    ours = complex(permittivity_water_ulaby14(f, t))
    assert abs(ours - wentz) < 0.02 * abs(wentz)
    a, b = (reflectivity_fresnel(e, np.deg2rad(53.0)) for e in (ours, wentz))
    assert abs(a.h - b.h) < 0.005
    assert abs(a.v - b.v) < 0.005


def test_above_40_ghz_means_are_known_less_and_land_goes_on_without_a_step():
    """Measured land without snow is linear in frequency up to 100 GHz (Prigent et al. 2000, IEEE TGRS 38(5))."""
    names = [name for name in TABLE.curves if name not in ("Water", "Swamp")]
    at = {f: TABLE.lookup(names, f, "V") for f in (36.5, 60.0, 89.0)}
    assert (at[89.0].mean_sd == 0.05).all()
    assert (at[36.5].mean_sd == 0.03).all()
    middle = (0.5 * (x := np.array(at[36.5].emissivity)) + 0.5 * np.array(at[89.0].emissivity))[..., :60]
    assert np.abs(np.array(at[60.0].emissivity)[..., :60] - middle).max() < 0.03
    assert np.abs(np.array(at[89.0].emissivity) - x)[..., :60].max() < 0.12


def test_above_100_ghz_means_are_known_less_still_and_the_notes_say_so():
    at = {f: TABLE.lookup(list(TABLE.curves), f, "V") for f in (89.0, 166.0, 170.0)}
    assert (at[170.0].mean_sd >= 0.07).all()
    assert any("above 100 GHz" in note for note in at[166.0].notes)
    assert not any("above 100 GHz" in note for note in at[89.0].notes)
    assert np.abs(at[166.0].emissivity - at[89.0].emissivity)[..., :60].max() < 0.12


def test_smooth_bare_ground_is_fresnel():
    # Independent run of the book's code: eps 9 - 0.9j, 50 deg: 0.88854 (V), 0.59233 (H).
    assert emissivity_mo82(9 - 0.9j, 0.0, 0.0, 0.0, np.deg2rad(50.0), "V") == pytest.approx(0.88854, abs=5e-6)
    assert emissivity_mo82(9 - 0.9j, 0.0, 0.0, 0.0, np.deg2rad(50.0), "H") == pytest.approx(0.59233, abs=5e-6)


@pytest.mark.parametrize("refused", [TABLE.lookup, TABLE.refuse])
def test_missing_category_polarization_and_frequency_are_named_together(refused):
    TABLE.refuse(["Trees"], 10.0, "H", 150.0)
    with pytest.raises(ScatteringDataError) as caught:
        refused(["Trees", "Lava", "Snow"], 183.3, "HV")
    text = str(caught.value)
    for part in ("'Lava'", "'Snow'", "183.3", "'HV'"):
        assert part in text


def test_assumptions_are_told():
    notes = " ".join(TABLE.lookup(["Grass"], 1.4, "V").notes)
    assert "inferred" in notes
    assert "assumed" in notes
    assert "outside its model" in " ".join(TABLE.lookup(["Grass"], 30.0, "H").notes)
    assert TABLE.lookup(["Asphalt"], 20.0, "H").status == ("public",)
    assert TABLE.lookup(["Asphalt"], 20.0, "V").status == ("assumed",)


def test_every_shipped_row_has_a_status():
    folder = Path(__file__).parents[2] / "seqrsm" / "scattering" / "data"
    names = (
        "emissivity_table3",
        "emissivity_models",
        "emissivity_mixes",
        "emissivity_variability",
        "atmosphere_nodes",
        "atmosphere_rain",
    )
    for name in names:
        lines = [line for line in (folder / f"{name}.csv").read_text().splitlines() if not line.startswith("#")]
        rows = list(csv.DictReader(lines))
        assert rows
        assert all(row["status"] in ("public", "computed", "assumed") and row["source"] for row in rows), name


HEADER = "quantity,category,frequency_ghz,polarization,theta_deg,value,unit,status,source,sd\n"


def write(path: Path, *rows: str) -> Path:
    path.write_text(HEADER + "\n".join(rows) + "\n", encoding="utf-8")
    return path


def test_user_table_replaces_and_adds_categories(tmp_path):
    rows = [
        f"emissivity,Lava,{f},H,{t},{0.9 - t / 200 + f / 1000},1,measured,mine,0.03"
        for f in (10, 20)
        for t in (0, 40, 80)
    ]
    rows += [f"emissivity,Water,10,H,{t},0.5,1,measured,mine," for t in (0, 80)]
    table = load_emissivity_table(write(tmp_path / "own.csv", *rows))
    look = table.lookup(["Lava", "Water", "Trees"], 10.0, "H")
    assert look.emissivity[0, 0, 40] == pytest.approx(0.71)
    assert look.emissivity[1, 0, 33] == pytest.approx(0.5)
    assert look.field_part[0] * (1.0 - look.emissivity[0, 0, 0]) == pytest.approx(0.03)
    # H and V of a cover that no table knows are as related as those of the covers that one does.
    assert look.channel_correlation[0] == look.channel_correlation[2] == 0.9
    assert look.status[0] == "measured"
    middle = table.lookup(["Lava"], np.sqrt(200.0), "H").emissivity[0, 0, 0]
    assert middle == pytest.approx(0.915)
    for refused in (table.lookup, table.refuse):
        with pytest.raises(ScatteringDataError, match="no V emissivity of Lava"):
            refused(["Lava"], 10.0, "V")
        with pytest.raises(ScatteringDataError, match=r"Lava at H is known at 10 to 20 GHz"):
            refused(["Lava"], 5.0, "H")
    table.refuse(["Lava", "Trees"], 15.0, "H")


def test_a_users_sd_holds_at_the_lowest_angle_of_its_rows(tmp_path):
    rows = {"H": {50: 0.7, 60: 0.6}, "V": {50: 0.9, 60: 0.88}}
    lines = [f"emissivity,Lava,10,{p},{t},{e},1,measured,mine,0.03" for p, own in rows.items() for t, e in own.items()]
    table = load_emissivity_table(write(tmp_path / "own.csv", *lines))
    for p, at_60 in (("H", 0.04), ("V", 0.036)):
        look = table.lookup(["Lava"], 10.0, p)
        away = departed(look.emissivity, look.field_part[:, None, None]) - look.emissivity
        np.testing.assert_allclose(away[0, 0, [0, 50, 60]], [0.03, 0.03, at_60], rtol=1e-12)


def test_user_table_faults_are_told_all_at_once(tmp_path):
    path = write(
        tmp_path / "bad.csv",
        "emissivity,Lava,10,H,0,1.2,1,measured,mine,",
        "emissivity,Lava,10,HV,0,0.9,1,measured,mine,",
        "sigma0,Lava,10,H,10,0.9,1,measured,mine,",
        "emissivity,Lava,10,H,20,0.9,dB,guessed,mine,",
        "emissivity,,10,H,30,0.9,1,measured,,",
    )
    with pytest.raises(ScatteringDataError) as caught:
        load_emissivity_table(path)
    assert {p.line for p in caught.value.problems} == {2, 3, 4, 5, 6}
    twice = write(tmp_path / "twice.csv", *["emissivity,Lava,10,H,0,0.9,1,measured,mine,"] * 2)
    with pytest.raises(ScatteringDataError, match="given twice"):
        load_emissivity_table(twice)
    with pytest.raises(ScatteringDataError, match="no rows"):
        load_emissivity_table(write(tmp_path / "none.csv"))


def test_two_nodes_are_joined_by_a_straight_line():
    np.testing.assert_allclose(interpolated([0.0, 80.0], [0.9, 0.5])[:81], 0.9 - 0.005 * np.arange(81.0))


def test_a_cover_without_a_row_of_table_3_is_an_area_mean_of_covers_that_have_one(tmp_path):
    """Brightness of parts adds by area; where the parts are known at one moisture, the mixture has those of soil."""
    table = load_emissivity_table()
    for frequency_ghz, polarization in ((1.4, "V"), (20.0, "H")):
        look = table.lookup(["Settlement", "Asphalt", "Grass", "Buildings"], frequency_ghz, polarization)
        settlement, asphalt, grass, buildings = look.emissivity
        np.testing.assert_allclose(settlement, 0.45 * asphalt + 0.55 * grass, rtol=1e-12)
        np.testing.assert_array_equal(buildings, asphalt)
        assert (look.status[0], look.heating[0]) == ("assumed", pytest.approx(0.45 * 1.0 + 0.55 * 0.5))
        assert "Settlement emits as 45 % Asphalt and 55 % Grass (assumed)" in look.notes
    own = write(tmp_path / "own.csv", *(f"emissivity,Settlement,20,H,{t},0.9,1,measured,mine," for t in (0, 80)))
    assert load_emissivity_table(own).lookup(["Settlement"], 20.0, "H").status == ("measured",)


def test_every_cover_of_the_radars_table_has_an_emissivity():
    """A scene with towns is imaged by both engines."""
    table = load_emissivity_table()
    assert set(load_sigma0_table().categories) <= {*table.curves, *table.mixes}
    assert {*table.curves, *table.mixes} == set(table.spread)
