"""The numbers read from the print: each stands in its printed string, and bands and wavelengths agree."""

import re
import subprocess
import sys

import pytest

from seqrsm.catalog.tables import Entry, Range, load_catalog

CATALOG = load_catalog()
TABLES = {table.number: table for table in CATALOG.tables}
C_CM_GHZ = 29.9792458  # speed of light, exact by the SI
NUMBER = re.compile(r"\d*\.?\d+")


def numbers(text: str) -> set[float]:
    return {float(n) for n in NUMBER.findall(text)}


def ends(ranges: tuple[Range, ...]) -> set[float]:
    return {end for r in ranges for end in (r.low, r.high) if end is not None}


def near(values: set[float], printed: set[float]) -> bool:
    return all(any(v == pytest.approx(p, rel=1e-9) for p in printed) for v in values)


@pytest.mark.parametrize("entry", [e for e in CATALOG.entries if not e.heading], ids=lambda e: f"{e.table}-{e.number}")
def test_numbers_of_a_requirement_are_printed(entry: Entry) -> None:
    printed = numbers(entry.wavelength)
    assert near(ends(entry.wavelength_cm), printed)
    for value, text in (
        (entry.resolution_wanted_m, entry.resolution_wanted),
        (entry.resolution_accepted_m, entry.resolution_accepted),
    ):
        assert (value is None) == (text == "")
        assert value is None or numbers(text) == {value}
    assert near(ends(entry.nadir_angle_deg), numbers(entry.nadir_angle))
    days = {24.0 * d for d in ends((entry.revisit_days,) if entry.revisit_days else ())}
    hours = {n * (1.0 if "hr" in entry.auxiliary else 24.0) for n in numbers(entry.auxiliary)}
    assert near(days, hours)


@pytest.mark.parametrize("entry", [e for e in CATALOG.entries if not e.heading], ids=lambda e: f"{e.table}-{e.number}")
def test_every_printed_number_was_read_or_is_noted(entry: Entry) -> None:
    if entry.note:
        return  # what is not read is said there
    counts = {"(2 channels)": {2.0}}
    ignored = set().union(*(values for text, values in counts.items() if text in entry.wavelength))
    ghz_or_cm = ends(entry.wavelength_cm) | (ends(entry.frequency_ghz) if "GHz" in entry.wavelength else set())
    assert numbers(entry.wavelength) - ignored <= {round(v, 9) for v in ghz_or_cm}
    assert numbers(entry.nadir_angle) <= ends(entry.nadir_angle_deg)


def test_frequency_is_light_speed_over_wavelength() -> None:
    entry = next(e for e in CATALOG.entries if e.wavelength == "6-8 and 1.7-2.2")
    assert [(r.low, r.high) for r in entry.frequency_ghz] == [
        pytest.approx((C_CM_GHZ / 8, C_CM_GHZ / 6)),
        pytest.approx((C_CM_GHZ / 2.2, C_CM_GHZ / 1.7)),
    ]


def test_band_edges_in_ghz_and_in_cm_agree_but_for_the_one_noted() -> None:
    wrong = set()
    for entry in CATALOG.entries:
        if not entry.band or entry.reading or "8 GHz" in entry.application or "17 GHz" in entry.application:
            continue
        (f,), (w,) = entry.frequency_ghz, entry.wavelength_cm
        assert near(ends((f,)), {n / (1000.0 if "MHz" in entry.frequency else 1.0) for n in numbers(entry.frequency)})
        scale = 0.1 if "mm" in entry.wavelength else 100.0 if entry.wavelength.endswith(" m") else 1.0
        assert near(ends((w,)), {scale * n for n in numbers(entry.wavelength)})
        # two printed digits: half a unit of the second is up to 2.5 %, and the edges are rounded on both sides
        for ghz, cm in ((f.low, w.high), (f.high, w.low)):
            if C_CM_GHZ / ghz != pytest.approx(cm, rel=0.03):
                wrong.add((entry.table, ghz, cm))
    assert wrong == {("A.11", 5.0, 5.0)}
    assert "5.0 GHz is 6.0 cm" in TABLES["A.11"].note


def test_application_may_narrow_its_band() -> None:
    by_name = {(e.table, e.application): e.frequency_ghz for e in CATALOG.entries}
    assert by_name["A.11", "Field Boundaries (greater than 8 GHz)"] == (Range(8.0, 12.0),)
    assert by_name["A.12", "Plant Moisture (Maturation) (below 17 GHz)"] == (Range(12.0, 17.0),)


def test_named_bands_take_the_edges_of_the_radar_tables() -> None:
    debris = next(e for e in CATALOG.entries if "Debris" in e.application)
    assert set(debris.frequency_ghz) == {Range(0.225, 0.4), Range(0.4, 1.5), Range(3.9, 6.2), Range(5.0, 12.0)}


def test_damaged_print_gives_no_number() -> None:
    saline = next(e for e in CATALOG.entries if e.wavelength == "30-30 multifreq.")
    thaw = next(e for e in CATALOG.entries if "(?)" in e.nadir_angle)
    assert saline.frequency_ghz == thaw.nadir_angle_deg == ()
    assert saline.note
    assert thaw.note


@pytest.mark.parametrize(
    ("printed", "channels"),
    [
        ("HH and Cross", (("HH", "HV"),)),
        ("HH/VV/Cross", (("HH", "HV", "VV"),)),
        ("Like and Cross", (("HH", "HV"), ("HV", "VV"))),
        ("HH or VV, Cross", (("HH", "HV"), ("HV", "VV"))),
        ("VV or VV and HH", (("VV",), ("HH", "VV"))),
        ("Vertical", (("VV",),)),
        ("Multiple", ()),
        ("Single", ()),
    ],
)
def test_channels(printed: str, channels: tuple[tuple[str, ...], ...]) -> None:
    assert {e.channels for e in CATALOG.entries if e.polarization == printed} == {channels}


def test_range_prints() -> None:
    assert [str(Range(*r)) for r in ((1.0, 2.5), (3.0, 3.0), (None, 10.0), (500.0, None), (15e3, 23e3))] == [
        "1 to 2.5", "3", "< 10", "> 500", "15000 to 23000",
    ]  # fmt: skip


def test_notes_are_those_of_the_row_and_of_its_section() -> None:
    told = {e.note for e in CATALOG.entries if e.table == "A.7" and e.system == "passive"}
    assert told
    assert all(note.endswith("The two sides of one resolution cell, not a range.") for note in told)


def test_starts_without_heavy_libraries_and_reads_once() -> None:
    code = (
        "import sys\nfrom seqrsm.catalog import start, tables\nassert tables.load_catalog() is tables.load_catalog()\n"
        "start.start_ranges('soil moisture')\n"
        "print(sorted({m.split('.')[0] for m in sys.modules} & {'numpy', 'scipy', 'pandas', 'rich', 'typer'}))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
