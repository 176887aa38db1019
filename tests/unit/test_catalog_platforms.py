"""Platforms: geometry and antenna against their own definitions, verdicts against the stated rule."""

import math
from dataclasses import replace

import numpy as np
import pytest

from seqrsm.catalog import Entry, Quantity, Range, load_catalog, platforms_for
from seqrsm.catalog.platforms import antenna_area_m2, antenna_size_m, slant_range_m

CATALOG = load_catalog()
EARTH_M = 6_371_008.8
C_M_S = 299_792_458.0
FIT = Entry("A.16", 1, "active", "", "x", frequency_ghz=(Range(10.0, 14.0),), nadir_angle_deg=(Range(10.0, 20.0),),
            resolution_accepted_m=30.0)  # fmt: skip


def verdict(entry: Entry, table: str) -> tuple[str, str]:
    (fit,) = [f for f in platforms_for(entry) if f.platform.table == table]
    return fit.verdict, fit.checks[0].text


@pytest.mark.parametrize("altitude_m", [3e3, 1.1e6, 3.6e7])
@pytest.mark.parametrize("angle_deg", [0.0, 17.0, 50.0, 80.0])
def test_slant_range_closes_the_triangle_with_the_centre_of_the_earth(altitude_m: float, angle_deg: float) -> None:
    r = slant_range_m(altitude_m, angle_deg)
    cosines = EARTH_M**2 + r**2 + 2.0 * EARTH_M * r * math.cos(math.radians(angle_deg))
    assert cosines == pytest.approx((EARTH_M + altitude_m) ** 2, rel=1e-13)


def test_slant_range_near_the_ground_is_that_of_a_plane() -> None:
    assert slant_range_m(10.0, 60.0) == pytest.approx(20.0, rel=1e-5)


def test_area_is_where_range_and_azimuth_ambiguities_just_leave_room() -> None:
    # From the two conditions themselves: the echo of the beam's footprint fits between two pulses, and the pulses
    # sample the Doppler band 2 v / L.
    f_ghz, h_m, angle = 1.275, 800e3, math.radians(23.0)
    wavelength, r = C_M_S / (f_ghz * 1e9), slant_range_m(h_m, 23.0)
    v = math.sqrt(3.986004418e14 / (EARTH_M + h_m))
    length = 10.0
    width = antenna_area_m2(f_ghz, h_m, 23.0) / length
    prf_hz = 2.0 * v / length
    ground_swath = wavelength * r / (width * math.cos(angle))
    echo_s = 2.0 * ground_swath * math.sin(angle) / C_M_S
    assert echo_s * prf_hz == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize(("area", "resolution"), [(2.0, 30.0), (2.0, 0.25), (8.0, 1.0), (0.01, 0.5)])
def test_antenna_size_is_the_smallest_rectangle_allowed(area: float, resolution: float) -> None:
    lengths = np.linspace(1e-3, 2.0 * resolution, 200_001)
    brute = np.min(np.hypot(lengths, area / lengths))
    assert antenna_size_m(area, resolution) == pytest.approx(brute, rel=1e-6)
    assert antenna_size_m(0.0, resolution) == 0.0


def test_verdicts_follow_the_rule_at_the_one_platform_that_prints_all() -> None:
    # Table A.23: 2 m from 1100 km. Largest area of a rectangle with diagonal 2 m: 2 m2.
    edge_ghz = 1.0 * antenna_area_m2(1.0, 1100e3, 20.0) / 2.0
    assert verdict(replace(FIT, frequency_ghz=(Range(edge_ghz * 1.001, 20.0),)), "A.23")[0] == "fits"
    partly = verdict(replace(FIT, frequency_ghz=(Range(edge_ghz * 0.99, 20.0),)), "A.23")
    assert partly[0] == "in part"
    assert f"enough from {edge_ghz:.2g} GHz" in partly[1]
    assert verdict(replace(FIT, frequency_ghz=(Range(0.5, edge_ghz * 0.999),)), "A.23")[0] == "exceeds"


def test_unknown_is_never_taken_for_fitting() -> None:
    gaps = {
        "frequency": {"frequency_ghz": ()},
        "angle": {"nadir_angle_deg": ()},
        "resolution": {"resolution_accepted_m": None},
        "open": {"nadir_angle_deg": (Range(10.0, None),)},
        "low": {"frequency_ghz": (Range(None, 3.0),)},
        "one of two": {"frequency_ghz": (Range(10.0, 14.0), Range(None, 3.0))},
    }
    assert verdict(FIT, "A.23")[0] == "fits"
    for change in gaps.values():
        assert verdict(replace(FIT, **change), "A.23")[0] == "unknown"  # type: ignore[arg-type]
    assert {f.verdict for e in CATALOG.entries if e.system == "passive" for f in platforms_for(e)} == {"unknown"}
    for entry in CATALOG.entries:
        for fit in platforms_for(entry):
            numbers = fit.platform.values("antenna size") and fit.platform.values("altitude")
            assert numbers or fit.verdict == "unknown"


def test_missing_altitude_gives_the_altitude_up_to_which_it_would_fit() -> None:
    kind, text = verdict(FIT, "A.22")
    assert kind == "unknown"
    reach_km = float(text.rsplit("up to ", 1)[1].split()[0])
    sizes = [antenna_size_m(antenna_area_m2(10.0, reach_km * 1e3 * f, 20.0), 30.0) for f in (0.94, 1.06)]
    assert sizes[0] < 4.0 < sizes[1]


def test_general_limit_of_the_launcher_that_is_not_the_shuttle_holds() -> None:
    assert "at most 2 m" in verdict(FIT, "A.21")[1]
    assert "for any orbit" in verdict(replace(FIT, frequency_ghz=(Range(0.1, 0.2),)), "A.21")[1]


def test_swath_of_a_printed_data_rate() -> None:
    (fit,) = [f for f in platforms_for(FIT) if f.platform.table == "A.23"]
    rate = next(check for check in fit.checks if check.name == "data rate")
    orbit = EARTH_M + 1100e3
    ground_speed = math.sqrt(3.986004418e14 / orbit) * EARTH_M / orbit
    cells_per_s = 1e4 / 8
    swath_m = cells_per_s / (ground_speed / 30.0) * 30.0
    assert rate.verdict == "unknown"
    assert f"the swath is {float(f'{swath_m:.2g}'):g} m wide at 30 m" in rate.text


def test_footprint_of_a_radiometer() -> None:
    salinity = next(e for e in CATALOG.entries if "Salinity" in e.application)
    # L-Band, 0.4 to 1.5 GHz, 2 m from 1100 km: lambda h / D = 110 km to 412 km
    assert "footprint at nadir 110 to 410 km" in verdict(salinity, "A.23")[1]


def test_order_and_completeness() -> None:
    fits = platforms_for(FIT)
    assert {f.platform.table for f in fits} == {p.table for p in CATALOG.platforms}
    assert fits[0].verdict == "fits"
    assert fits[0].unknown == ("power", "mass", "data rate", "revisit")
    order = ["fits", "in part", "exceeds", "unknown"]
    assert [f.verdict for f in fits] == sorted((f.verdict for f in fits), key=order.index)


def test_values_by_scope() -> None:
    noss = next(p for p in CATALOG.platforms if p.table == "A.36")
    assert noss.values("mass", "satellite") == (
        Quantity("Weight", "mass", Range(3816.0, 3816.0), "kg", "satellite", ""),
    )
    pounds = sum(q.value.high or 0.0 for q in noss.values("mass") if q.unit == "lb")
    assert pounds * 0.45359237 == pytest.approx(315.7, abs=0.05)  # what the note says against the printed 305 kg
