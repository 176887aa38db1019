"""Start ranges: hand-read examples, every number traced to print, and the agreement by brute force."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seqrsm.catalog.start import StartRange, agreement, start_ranges
from seqrsm.catalog.tables import Range, load_catalog
from seqrsm.errors import UserError
from seqrsm.sensor.parameters import RADAR, RADIOMETER

CATALOG = load_catalog()
C_CM_GHZ = 29.9792458


def by_name(words: str, system: str = "active") -> dict[str, StartRange]:
    return {r.name: r for r in start_ranges(words, system=system).ranges}


def test_soil_moisture_read_by_hand() -> None:
    ranges = by_name("soil moisture")
    frequency, resolution, angle = ranges["frequency"], ranges["resolution"], ranges["depression_angle"]
    # 1-100 cm of A.16 reaches furthest on both sides; bands S and C of A.9, A.10 and every wavelength overlap at 6-8 cm
    assert frequency.ends == pytest.approx((C_CM_GHZ / 100.0, C_CM_GHZ / 1.0))
    assert frequency.agreed == pytest.approx((3.9, C_CM_GHZ / 6.0))
    assert frequency.tables == ("A.9", "A.10", "A.16", "A.17")
    # < 10, 50-100, 100-250; 30-100, 90-200, 30-90: most cover 50 to 90 and 90 to 100
    assert resolution.ends == (10.0, 250.0)
    assert (resolution.agreed, resolution.n_agreeing) == ((50.0, 100.0), 3)
    assert any("no low end" in note for note in resolution.notes)
    # nadir 0-40 and 7-17
    assert (angle.ends, angle.agreed) == ((50.0, 90.0), (73.0, 83.0))
    assert start_ranges("soil moisture").polarization.levels == ("HH", "HV", "HH+HV")


def test_best_angle_and_single_values_of_crop_classification() -> None:
    ranges = by_name("crop classification corn")
    assert ranges["frequency"].ends == (9.0, 14.2)
    assert ranges["depression_angle"].best == 40.0
    assert ranges["depression_angle"].ends == (40.0, 50.0)
    assert start_ranges("corn").polarization.levels == ("HH", "VV", "HH+VV")


def test_open_sides_are_closed_at_the_edge_of_the_tables_and_said() -> None:
    kelp = by_name("kelp")
    assert kelp["frequency"].ends == (12.0, 36.0)
    assert kelp["depression_angle"].ends == (10.0, 60.0)
    assert "Table A.12" in kelp["frequency"].notes[0]
    assert by_name("tree counts")["resolution"].ends == (0.5, 10.0)


def test_the_edges_stand_in_the_tables() -> None:
    active = [e for e in CATALOG.entries if e.system == "active"]
    angles = [end for e in active for r in e.nadir_angle_deg for end in (r.low, r.high) if end is not None]
    wanted = [e.resolution_wanted_m for e in active if e.resolution_wanted_m is not None]
    bands = {(e.system, r) for e in CATALOG.entries if e.band and not e.is_none for r in e.frequency_ghz}
    assert (min(angles), max(angles), min(wanted)) == (0.0, 80.0, 0.5)
    for system, low, high in (("active", 0.4, 36.0), ("passive", 0.4, 100.0)):
        assert min(r.low for s, r in bands if s == system) == low
        assert max(r.high for s, r in bands if s == system) == high


def test_radiometer() -> None:
    ranges = by_name("sea surface temperature", "passive")
    assert set(ranges) == {"frequency", "resolution"}
    assert ranges["frequency"].ends == (1.5, 36.0)
    assert ranges["resolution"].ends == (15e3, 23e3)
    assert start_ranges("sea surface temperature", system="passive").polarization.levels == ()


def test_nothing_printed_is_nothing() -> None:
    currents = by_name("currents")
    assert currents["frequency"].ends is None
    assert currents["frequency"].sources[0].printed == "To be Determined"
    assert currents["resolution"].notes == ("no number is printed",)


def test_sources_that_do_not_agree_have_no_agreed_part() -> None:
    resolution = by_name("hurricane damage")["resolution"]
    assert resolution.ends == (10.0, 100.0)
    assert resolution.agreed is None
    assert "no two sources agree" in resolution.notes


@pytest.mark.parametrize(
    "entry", [e for e in CATALOG.entries if not e.is_none][::7], ids=lambda e: f"{e.table}-{e.number}"
)
def test_numbers_come_from_the_sources_they_name(entry: object) -> None:
    start = start_ranges(entry.name, system=entry.system)  # type: ignore[attr-defined]
    assert entry in start.entries
    for factor in start.ranges:
        for sensor in (RADAR, RADIOMETER):
            assert factor.name not in sensor or sensor[factor.name].unit == factor.unit
        assert factor.name in (RADAR if entry.system == "active" else RADIOMETER)  # type: ignore[attr-defined]
        assert factor.scale == ("linear" if factor.unit == "deg" else "log")
        if factor.ends is None:
            assert not any(source.ranges for source in factor.sources)
            continue
        ends = {end for s in factor.sources for r in s.ranges for end in (r.low, r.high)}
        closed = any("not printed" in note for note in factor.notes)
        assert closed or set(factor.ends) <= ends
        low, high = factor.ends
        assert 0.0 <= low <= high
        if factor.agreed is not None:
            assert low <= factor.agreed[0] <= factor.agreed[1] <= high
    if start.polarization.levels:
        assert all(set(level.split("+")) <= {"HH", "HV", "VV"} for level in start.polarization.levels)


intervals = st.tuples(st.integers(0, 12), st.integers(1, 6)).map(lambda p: Range(float(p[0]), float(p[0] + p[1])))


@given(st.lists(st.lists(intervals, min_size=1, max_size=2).map(tuple), min_size=1, max_size=6))
def test_agreement_by_brute_force(sources: list[tuple[Range, ...]]) -> None:
    low, high, count = agreement(sources)
    # integer ends: the middles of the unit cells see every cover of positive length
    middles = np.arange(0.5, 19.0, 1.0)
    cover = np.array([sum(any(r.low <= x <= r.high for r in s) for s in sources) for x in middles])  # type: ignore[operator]
    assert count == cover.max()
    inside = (middles > low) & (middles < high)
    assert inside.any()
    assert (cover[inside] == count).all()
    assert middles[inside][0] == middles[cover == count][0]
    assert not (cover[middles == high + 0.5] == count).any()


def test_agreement_on_a_printed_single_value_but_not_on_a_touch() -> None:
    assert agreement([(Range(12.0, 36.0),), (Range(9.0, 9.0), Range(14.2, 14.2))]) == (14.2, 14.2, 2)
    assert agreement([(Range(30.0, 90.0),), (Range(90.0, 200.0),)])[2] == 1
    assert agreement([(Range(None, 10.0),), (Range(5.0, None),)]) == (5.0, 10.0, 2)


@pytest.mark.parametrize(
    ("words", "system", "says"),
    [
        ("soil mosture", "active", "moisture"),
        ("zzz", "active", "other words"),
        ("", "active", "soil moisture"),
        ("kelp", "passive", "no passive application"),
    ],
)
def test_errors_say_the_remedy(words: str, system: str, says: str) -> None:
    with pytest.raises(UserError, match=says):
        start_ranges(words, system=system)
