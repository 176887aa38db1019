"""The table as its user meets it: provenance, ranges, errors, a user's own file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.stats import linregress

from seqrsm.errors import ScatteringDataError
from seqrsm.scattering.readers import DATA, POLARIZATIONS, STATUSES, shipped_rows
from seqrsm.scattering.sigma0 import load_sigma0_table
from seqrsm.scattering.worlds import World

TABLE = load_sigma0_table()
FOURTEEN = (
    "Swamp", "Bareground", "Gravel", "Trees", "Grass", "Scrub", "Hay", "Oats", "Corn", "Wheat", "Forage", "Vegetables",
    "Water", "Asphalt",
)  # fmt: skip
HEADER = "quantity,category,frequency_ghz,polarization,season,theta_deg,value,sd,unit,status,source\n"


def test_every_shipped_row_has_status_and_known_source() -> None:
    citations = {row.text("source") for row in shipped_rows("sources.csv")}
    others = ("sources.csv", "atmosphere_", "emissivity_", "mean_sd")  # the radiometer's tables have tests of their own
    files = sorted(p.name for p in DATA.glob("*.csv") if not p.name.startswith(others))
    assert len(files) == 14  # mean_sd.csv argues by itself
    for name in files:
        for row in (row.cells for row in shipped_rows(name)):
            bare = "c_band" if row.get("c_band_field_sd_db") == "" else "no"  # as in L band
            statuses = [v for k, v in row.items() if k.endswith("status") and not k.startswith(bare)]
            sources = [v for k, v in row.items() if k.endswith("source") and not k.startswith(bare)]
            assert statuses, name
            assert set(statuses) <= set(STATUSES), (name, row)
            assert set(sources) <= citations, (name, row)
            assert not any(word in v for v in row.values() for word in ("recalled", "defective", "partial"))


def test_all_categories_are_there() -> None:
    assert set(FOURTEEN) <= set(TABLE.categories)
    for channel in POLARIZATIONS:
        found = TABLE.lookup(FOURTEEN, 3.0, channel)
        assert found.sigma0.shape == (14, 91)
        assert found.sigma0.dtype == np.float64
        assert np.all(found.sigma0 > 0)
        assert np.all(found.field_sd_db > 0)
        assert np.all(found.date_sd_db > 0)


def test_each_unknown_cover_is_told_and_once_what_there_is() -> None:
    with pytest.raises(ScatteringDataError) as caught:
        TABLE.lookup(["WHEAT", "Wheat", "Hops", "WHEAT"], 5.4, "VV")
    first, last = caught.value.problems
    assert (first.value, first.remedy) == ("WHEAT", "Did you mean Wheat?")
    assert (last.value, last.remedy.partition(":")[0]) == ("Hops", "The table has")


def test_notes_tell_every_assumption() -> None:
    found = TABLE.lookup(["Wheat", "Trees", "Water", "Bareground"], 2.2, "HH", wind_m_s=4.0, soil_moisture=0.35)
    text = "\n".join(found.notes)
    for words in (
        "Wheat: 2.2 GHz interpolated between 1.25 and 3 GHz (rms error 1.1 dB)",
        "Wheat: level, drawn to that of all covers, with the regression's course over angle (measured: flevoland; "
        "measured: flevoland_1991; ",
        "Trees: albedo 0.20 at 1.25 GHz, optical depth 0.6 Np at 1.25 GHz",
        "Bareground: reference moisture 0.2 m3/m3, rms height 0.01 m (assumed)",
        "Water: HH below VV by at most 15 dB (assumed)",
        "Water: wind 4 m/s",
        "Bareground: soil moisture 0.35 m3/m3 against 0.2 by Oh 2004 and Baghdadi et al. 2016 (rms height assumed)",
        "Bareground: heights of fields differ by 0.2 decades (assumed), which shows with the sine of the incidence ",
        "Wheat HH: field sd 1.57 dB (computed: l_band_fields), from C band on 1.00 dB (assumed: s1_france_w_fields)",
        "correlation of the field-to-field draws of two channels: 0.75 (computed: flevoland)",
    ):
        assert words in text
    assert [note.partition(":")[0] for note in found.notes if "decades" in note] == ["Bareground"]
    assert np.all(found.mean_sd_db > 1.2)  # interpolation in frequency adds as much


@pytest.mark.parametrize(
    ("moisture", "held"), [(0.03, ", held at 0.04 "), (0.04, " "), (0.45, " "), (0.46, ", held at 0.45 ")]
)
def test_moisture_that_makes_no_more_difference_is_told(moisture: float, held: str) -> None:
    notes = TABLE.lookup(["Bareground"], 5.4, "VV", soil_moisture=moisture).notes
    assert any(f"Oh 2004 and Baghdadi et al. 2016{held}(rms height assumed)" in note for note in notes)


def test_status_is_the_weakest() -> None:
    assert TABLE.lookup(["Bareground", "Wheat", "Corn"], 1.25, "HH").status == ("computed", "measured", "measured")
    assert TABLE.lookup(["Bareground"], 1.25, "HH", soil_moisture=0.1).status == ("assumed",)
    assert TABLE.lookup(["Wheat", "Corn", "Scrub"], 5.4, "HH").status == ("measured", "computed", "public_code")
    assert TABLE.lookup(["Wheat", "Trees"], 5.4, "VV").status == ("measured", "assumed")
    assert TABLE.lookup(["Scrub"], 9.0, "HH").status == ("assumed",)


def test_status_within_a_tenth_of_an_octave_is_that_of_the_node() -> None:
    """1.2 GHz rests on measurements at 1.25 GHz, 5.3 GHz on those at 5.4 GHz; only the error grows, from nothing."""
    for beside, away, node, sd in ((1.2, 1.1, 1.25, 0.141), (5.3, 4.5, 5.4, 0.149), (5.7, 6.5, 5.4, 0.411)):
        of_node, near, far = (TABLE.lookup(["Wheat"], f, "VV") for f in (node, beside, away))
        assert of_node.status == near.status == ("measured",) != far.status
        assert not any("(assumed)" in note for note in near.notes if f"{beside:g} GHz" in note)
        np.testing.assert_allclose(near.mean_sd_db, np.hypot(of_node.mean_sd_db, sd), rtol=0.05)
        assert near.mean_sd_db < far.mean_sd_db


@pytest.mark.parametrize("channel", POLARIZATIONS)
def test_frequency_interpolation_is_linear_in_db_over_log_frequency(channel: str) -> None:
    low, middle, high = (
        np.log(TABLE.lookup(["Wheat"], f, channel).sigma0[0, :75]) for f in (1.25, np.sqrt(1.25 * 3.0), 3.0)
    )
    assert middle == pytest.approx(0.5 * (low + high), abs=1e-9)
    shrubs = [np.log(TABLE.lookup(["Scrub"], f, channel).sigma0[0, :75]) for f in (1.25, np.sqrt(1.25 * 5.4), 5.4)]
    assert shrubs[1] == pytest.approx(0.5 * (shrubs[0] + shrubs[2]), abs=1e-9)  # no S band


def test_wind_interpolation() -> None:
    three, four, five = (np.log(TABLE.lookup(["Water"], 5.4, "VV", wind_m_s=w).sigma0[0, :75]) for w in (3, 4, 5))
    assert four == pytest.approx(0.5 * (three + five), abs=1e-9)


def test_extrapolation_reaches_one_octave_and_is_flagged() -> None:
    found = TABLE.lookup(["Wheat"], 27.2, "HH")
    assert any("27.2 GHz extrapolated beyond the node at 13.6 GHz (assumed)" in note for note in found.notes)
    assert found.mean_sd_db[0] > 2.4
    with pytest.raises(ScatteringDataError, match=r"sigma0 of Wheat is known at 1.25 to 13.6 GHz.*0.625 to 27.2 GHz"):
        TABLE.lookup(["Wheat"], 27.3, "HH")
    with pytest.raises(ScatteringDataError, match="frequency"):
        TABLE.lookup(["Wheat"], 0.6, "HH")


def test_a_table_of_one_frequency_is_told_as_one(tmp_path: Path) -> None:
    lines = ["quantity,category,frequency_ghz,polarization,theta_deg,value,unit,status,source"]
    lines += [f"sigma0,Peas,1.25,{p},{at},-12,dB,measured,ours" for p in ("HH", "HV", "VV") for at in (20, 60)]
    (tmp_path / "own.csv").write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(ScatteringDataError, match=r"sigma0 of Peas is known at 1.25 GHz \(got 5.4\)"):
        load_sigma0_table(tmp_path / "own.csv").lookup(["Peas"], 5.4, "HH")


def test_extrapolated_values(tmp_path: Path) -> None:
    """Table of -20, -14, -12 dB at 1, 4, 8 GHz: below the first slope of 3 dB/octave, above half of the line's."""
    levels = {1.0: -20.0, 4.0: -14.0, 8.0: -12.0}
    line = linregress([0.0, 2.0, 3.0], [*levels.values()]).slope
    path = tmp_path / "own.csv"
    rows = [
        f"sigma0,Wheat,{f},{p},,{t},{v - 0.1 * t},,dB,measured,me\n"
        for f, v in levels.items()
        for p in POLARIZATIONS
        for t in (60, 0, 30)  # out of order
    ]
    path.write_text(HEADER + "".join(rows), encoding="utf-8")
    table = load_sigma0_table(path)
    for frequency, level in ((0.5, -23.0), (16.0, -12.0 + 0.5 * line), (1.0, -20.0), (2.0, -17.0)):
        wheat = table.lookup(["Wheat"], frequency, "VV")
        found = 10.0 * np.log10(wheat.sigma0[0])
        # Such a table does not tell how much dates scatter.
        assert wheat.date_sd_db == TABLE.lookup(["Wheat"], 5.4, "VV").date_sd_db
        assert found[[0, 15, 30, 45]] == pytest.approx([level, level - 1.5, level - 3.0, level - 4.5])


def test_errors_name_what_is_missing() -> None:
    with pytest.raises(ScatteringDataError, match=r"no backscatter of Wheat in this season.*monsoon.*It has: spring"):
        TABLE.lookup(["Wheat"], 3.0, "HH", season="monsoon")
    with pytest.raises(ScatteringDataError, match=r"winds of 2 to 10 m/s.*12"):
        TABLE.lookup(["Water"], 3.0, "HH", wind_m_s=12.0)
    with pytest.raises(ScatteringDataError, match=r"no such polarization.*HH, HV, VV"):
        TABLE.lookup(["Wheat"], 3.0, "RR")
    with pytest.raises(ScatteringDataError) as caught:
        TABLE.lookup(["Rice", "Wheat", "Tundra"], 30.0, "HH")
    assert len(caught.value.problems) == 3
    assert str(caught.value).count("The table has: ") == 1  # which was told with each cover
    with pytest.raises(ScatteringDataError, match=r"\(got 'corn'\)\. Did you mean Corn\?"):
        TABLE.lookup(["corn"], 3.0, "HH")


def test_vh_is_hv_and_repeats_are_allowed() -> None:
    found = TABLE.lookup(["Wheat", "Wheat"], 3.0, "VH")
    np.testing.assert_array_equal(found.sigma0[0], TABLE.lookup(["Wheat"], 3.0, "HV").sigma0[0])
    np.testing.assert_array_equal(found.sigma0[0], found.sigma0[1])


def test_the_table_is_read_once() -> None:
    assert load_sigma0_table() is TABLE


def own_rows(category: str = "Wheat", channels: tuple[str, ...] = POLARIZATIONS, unit: str = "dB") -> str:
    value = {"dB": "-10", "1": "0.1"}[unit]
    return "".join(
        f"sigma0,{category},{f},{p},,{t},{value},1.5,{unit},measured,flight 7\n"
        for f in (5.0, 10.0)
        for p in channels
        for t in (20, 60)
    )


@pytest.mark.parametrize("unit", ["dB", "1"])
@pytest.mark.parametrize("mark", ["", "\ufeff"])
def test_user_table(tmp_path: Path, unit: str, mark: str) -> None:
    path = tmp_path / "own.csv"
    path.write_text(mark + "# mine\n" + HEADER + own_rows(unit=unit) + own_rows("Rice"), encoding="utf-8")
    table = load_sigma0_table(path)
    found = table.lookup(["Wheat", "Rice", "Trees"], 7.0, "HV")
    assert found.sigma0[0, 40] == pytest.approx(0.1)
    assert found.field_sd_db[:2] == pytest.approx([1.5, 1.5])
    assert found.status[0] == "measured"
    np.testing.assert_array_equal(found.sigma0[2], TABLE.lookup(["Trees"], 7.0, "HV").sigma0[0])
    with pytest.raises(ScatteringDataError, match="known at 5 to 10 GHz"):
        table.lookup(["Wheat"], 1.25, "HH")


@pytest.mark.parametrize(
    ("bad", "place"),
    [
        ("sigma0,Wheat,abc,HH,,20,-10,,dB,measured,me", r"own\.csv:2: frequency_ghz: not a number.*'abc'"),
        ('sigma0,Wheat,5,HH,,20,"-9,1",,dB,measured,me', r"2: value: not a number .*'-9,1'\)\. Use a decimal point$"),
        ("sigma0,Wheat,5,RL,,20,-10,,dB,measured,me", r"own\.csv:2: polarization: unknown"),
        ("sigma0,Wheat,5,HH,,99,-10,,dB,measured,me", r"own\.csv:2: theta_deg"),
        ("sigma0,Wheat,5,HH,,20,nan,,dB,measured,me", r"own\.csv:2: value"),
        ("sigma0,Wheat,5,HH,,20,-10,,1,measured,me", r"own\.csv:2: value: not a number from 1e-10"),
        ("sigma0,Wheat,5,HH,,20,-10,,,measured,me", r"own\.csv:2: unit"),
        ("sigma0,Wheat,5,HH,,20,-10,,dB,,me", r"own\.csv:2: status: unknown or missing"),
        ("sigma0,Wheat,5,HH,,20,-10,,dB,recalled,me", r"own\.csv:2: status"),
        ("sigma0,Wheat,5,HH,,20,-10,,dB,measured,", r"own\.csv:2: source: empty"),
        ("sigma0,,5,HH,,20,-10,,dB,measured,me", r"own\.csv:2: category: empty"),
        ("gamma0,Wheat,5,HH,,20,-10,,dB,measured,me", r"own\.csv:2: quantity"),
        ("sigma0,Wheat,5,HH,monsoon,20,-10,,dB,measured,me", r"own\.csv:2: season"),
        ("sigma0,Wheat,5,HH,,20,-10,-1,dB,measured,me", r"own\.csv:2: sd"),
        ("sigma0,Wheat,5,HH,,20", r"own\.csv:2: 6 cells, the header has 11"),
        ("sigma0,Wheat,5,HH,,20,-10,,dB,measured,me", r"own\.csv:2: theta_deg: Wheat.*1 row, at least 2"),
        ('sigma0,"Wheat,5,HH,,20,-10,,dB,measured,me', r"own\.csv:2: not a CSV line"),
    ],
)
def test_bad_user_rows(tmp_path: Path, bad: str, place: str) -> None:
    path = tmp_path / "own.csv"
    path.write_text(HEADER + bad + "\n", encoding="utf-8")
    with pytest.raises(ScatteringDataError, match=place):
        load_sigma0_table(path)


def test_channels_may_differ_from_band_to_band(tmp_path: Path) -> None:
    """A radar of HH in L band beside one of VV in C band asks for no other row."""
    path = tmp_path / "own.csv"
    rows = [f"sigma0,Hops,{f},{p},,{t},-10,,dB,measured,me\n" for f, p in ((1.25, "HH"), (5.4, "VV")) for t in (20, 60)]
    path.write_text(HEADER + "".join(rows), encoding="utf-8")
    table = load_sigma0_table(path)
    for frequency, channel, other in ((1.25, "HH", "VV"), (5.4, "VV", "HH")):
        assert table.lookup(["Hops"], frequency, channel).sigma0[0, 40] == pytest.approx(0.1)
        for near in (frequency, 3.0):
            with pytest.raises(ScatteringDataError, match=f"the table has no {other} of Hops for {near:g} GHz"):
                table.lookup(["Hops"], near, other)


def test_all_bad_rows_at_once_and_duplicates(tmp_path: Path) -> None:
    path = tmp_path / "own.csv"
    path.write_text(HEADER + own_rows() + own_rows(), encoding="utf-8")
    with pytest.raises(ScatteringDataError, match=r"theta_deg: .*: it is given twice") as caught:
        load_sigma0_table(path)
    assert len(caught.value.problems) == 24


def test_bad_files(tmp_path: Path) -> None:
    path = tmp_path / "own.csv"
    with pytest.raises(ScatteringDataError, match="cannot read the table"):
        load_sigma0_table(path)
    path.write_text("a,b\n1,2\n")
    with pytest.raises(ScatteringDataError, match="the column is missing") as caught:
        load_sigma0_table(path)
    assert any("no such column" in str(p) for p in caught.value.problems)
    path.write_text("")
    with pytest.raises(ScatteringDataError, match="empty"):
        load_sigma0_table(path)
    path.write_text(HEADER)
    with pytest.raises(ScatteringDataError, match="no rows"):
        load_sigma0_table(path)
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ScatteringDataError, match="UTF-8"):
        load_sigma0_table(path)


@pytest.mark.parametrize("mistake", ["linear", "sign"])
def test_linear_numbers_and_lost_signs_do_not_pass_as_decibels(tmp_path: Path, mistake: str) -> None:
    path = tmp_path / "own.csv"
    rows = own_rows(unit="1").replace(",1,measured", ",dB,measured") if mistake == "linear" else own_rows()
    path.write_text(HEADER + rows.replace(",-10", ",10"), encoding="utf-8")
    with pytest.raises(ScatteringDataError, match=r'every value is above 0 dB.*unit "1"'):
        load_sigma0_table(path)


def test_missing_channel_of_a_user_table(tmp_path: Path) -> None:
    path = tmp_path / "own.csv"
    path.write_text(HEADER + own_rows(channels=("HH",)), encoding="utf-8")
    table = load_sigma0_table(path)
    assert table.lookup(["Wheat"], 5.0, "HH").sigma0[0, 30] == pytest.approx(0.1)
    with pytest.raises(ScatteringDataError, match="no HV of Wheat"):
        table.lookup(["Wheat"], 5.0, "HV")


def test_a_users_numbers_stand_as_they_are(tmp_path: Path) -> None:
    # Above what the shipped models are capped at, and beyond 75 degrees, where these end.
    values = {"HH": {0: 18.0, 40: 14.0, 75: 2.0, 85: -3.0}, "HV": {0: 6.0, 40: 1.0}, "VV": {10: -80.0, 80: -90.0}}
    rows = "".join(
        f"sigma0,Wheat,5.0,{p},,{t},{v},,dB,measured,me\n" for p, nodes in values.items() for t, v in nodes.items()
    )
    path = tmp_path / "own.csv"
    path.write_text(HEADER + rows, encoding="utf-8")
    table = load_sigma0_table(path)
    for channel, nodes in values.items():
        found = 10.0 * np.log10(table.lookup(["Wheat"], 5.0, channel).sigma0[0])
        for angle, value in nodes.items():
            assert found[angle] == pytest.approx(value, abs=1e-9)
        if max(nodes) < 75:
            assert found[max(nodes) : 76] == pytest.approx(nodes[max(nodes)], abs=1e-9)
        last = max(max(nodes), 75)
        gamma = found - 10.0 * np.log10(np.cos(np.deg2rad(np.minimum(np.arange(91), 89.9))))
        if nodes[max(nodes)] > -60.0:
            assert gamma[last:90] == pytest.approx(gamma[last], abs=1e-6)
        assert found[90] <= found[last]


@pytest.mark.parametrize("sign", [";", "\t"])
def test_a_spreadsheet_with_decimal_commas_is_read_as_the_same_table(tmp_path: Path, sign: str) -> None:
    rows = ["sigma0,Wheat,5.0,HH,,20,-9.25,1.5,dB,measured,me", "sigma0,Wheat,5.0,HH,,60,-1.15e1,,dB,measured,me"]
    path = tmp_path / "own.csv"
    path.write_text(HEADER + "\n".join(rows) + "\n", encoding="utf-8")
    expected = load_sigma0_table(path).lookup(["Wheat"], 5.0, "HH").sigma0
    text = (HEADER + "\n".join(rows)).replace(",", sign).replace(".", ",").replace("\n", "\r\n")
    path.write_bytes(b"\xef\xbb\xbf" + text.encode())
    np.testing.assert_array_equal(load_sigma0_table(path).lookup(["Wheat"], 5.0, "HH").sigma0, expected)
    path.write_bytes(text.replace("-9,25", "-1.009,25").encode())
    with pytest.raises(ScatteringDataError, match=r"csv:2: value: not a number .*'-1\.009,25'"):
        load_sigma0_table(path)


def test_many_wrong_rows_are_told_with_their_number(tmp_path: Path) -> None:
    path = tmp_path / "own.csv"
    path.write_text(
        HEADER + own_rows().replace("flight 7", "flight 7; 8; 9; 10; 11; 12; 13; 14; 15; 16; 17; 18"), "utf-8"
    )
    assert load_sigma0_table(path)  # the header tells what separates cells
    path.write_text(HEADER + own_rows(unit="1").replace(",0.1,", ",-0.1,") * 10, encoding="utf-8")
    with pytest.raises(ScatteringDataError, match="70 more problems like these") as caught:
        load_sigma0_table(path)
    assert len(caught.value.problems) == 51


@pytest.mark.parametrize(
    ("channel", "sd", "mean_sd", "nadir_sd", "nadir_mean_sd"),
    [("HH", 1.0, 1.0, 2.0, 1.5), ("HV", 2.0, 2.5, 2.0, 2.5), ("VV", 3.0, 2.0, 2.0, 1.5)],
)
def test_hh_and_vv_scatter_by_the_mean_of_both_at_nadir_and_by_their_own_from_40_deg_on(
    channel: str, sd: float, mean_sd: float, nadir_sd: float, nadir_mean_sd: float, tmp_path: Path
) -> None:
    """Between by the square of the sine: fields of a user's cover, and its mean from world to world."""
    head = "quantity,category,frequency_ghz,polarization,theta_deg,value,unit,status,source,sd,mean_sd\n"
    sds = {"HH": (1.0, 1.0), "HV": (2.0, 2.5), "VV": (3.0, 2.0)}
    rows = (
        f"sigma0,Kelp,5.4,{c},{angle},{level},dB,measured,me,{sds[c][0]},{sds[c][1]}\n"
        for c in sds
        for angle, level in ((10, -5), (60, -12))
    )
    (tmp_path / "t.csv").write_text(head + "".join(rows), encoding="utf-8")
    table, world = load_sigma0_table(tmp_path / "t.csv"), World(3, 4)
    found = table.lookup(["Kelp"], 5.4, channel)
    assert (found.field_sd_db[0], found.mean_sd_db[0]) == (sd, mean_sd)
    assert found.nadir_sd_db[0] == nadir_sd
    half = 20.0 * np.pi / 180.0
    apart = (np.sin(half) / np.sin(2.0 * half)) ** 2
    for angle, own in ((0.0, 0.0), (20.0, apart), (40.0, 1.0), (65.0, 1.0)):
        of_fields, rough = found.of_fields_db(angle)
        assert of_fields[0] == pytest.approx(own * sd + (1.0 - own) * nadir_sd)
        assert rough[0] == 0.0
        met = table.in_world(world).lookup(["Kelp"], 5.4, channel)
        departed = 10.0 * np.log10(met.sigma0 / found.sigma0)[0] / world.departure("Kelp", "", 5.4, channel)
        assert departed[int(angle)] == pytest.approx(own * mean_sd + (1.0 - own) * nadir_mean_sd)
    covered = table.lookup(["Kelp"], 5.4, channel, snow="wet", snow_depth_cm=4.0)
    closed, of_soil = covered.closed[0], TABLE.lookup(["Bareground"], 5.4, channel).mean_sd_db[0]
    assert 0.2 < closed < 0.98
    assert covered.mean_sd_db[0] == pytest.approx(closed * mean_sd + (1.0 - closed) * of_soil)


def test_a_cover_with_one_channel_scatters_by_its_own_at_nadir(tmp_path: Path) -> None:
    rows = own_rows("Kelp", ("HH",)).replace("flight 7\n", "flight 7,0.7\n")
    (tmp_path / "t.csv").write_text(HEADER.replace("source\n", "source,mean_sd\n") + rows, encoding="utf-8")
    table = load_sigma0_table(tmp_path / "t.csv")
    plain, met = (one.lookup(["Kelp"], 5.0, "HH") for one in (table, table.in_world(World(3, 4))))
    departed = 10.0 * np.log10(met.sigma0 / plain.sigma0)[0] / World(3, 4).departure("Kelp", "", 5.0, "HH")
    np.testing.assert_allclose(departed[:76], 0.7)
    assert plain.nadir_sd_db == plain.field_sd_db


@pytest.mark.parametrize("channel", POLARIZATIONS)
def test_roughness_of_bare_soil_is_no_part_of_what_fields_have_at_nadir(channel: str) -> None:
    """Its part, told at 40 deg, falls with the sine; what HH and VV are left with there is the mean of both."""
    looks = {c: load_sigma0_table().lookup(["Bareground"], 5.4, c) for c in POLARIZATIONS}
    left = {c: float(look.field_sd_db[0] * np.sqrt(1.0 - look.roughness_share[0] ** 2)) for c, look in looks.items()}
    smooth, rough = looks[channel].of_fields_db(0.0)
    alike = ("HV",) if channel == "HV" else ("HH", "VV")
    assert (smooth[0], rough[0]) == (pytest.approx(np.mean([left[c] for c in alike])), 0.0)
    smooth, rough = looks[channel].of_fields_db(40.0)
    assert smooth[0] == pytest.approx(left[channel])
    assert np.hypot(smooth[0], rough[0]) == pytest.approx(looks[channel].field_sd_db[0])
