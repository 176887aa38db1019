"""Bad files are refused with line, column and remedy; good ones of every dialect are read alike."""

from __future__ import annotations

import math

import pytest

from seqrsm.errors import ScoresFileError
from seqrsm.score import cells, table
from seqrsm.score.cells import FactorColumn, Measure
from seqrsm.score.flight import binomial_percent, read_scores
from seqrsm.units import unit_factor

FACTORS = (
    FactorColumn("frequency", "GHz"),
    FactorColumn("looks"),
    FactorColumn("polarization", levels=("HH", "VV", "HH+HV")),
)
CROPS = (Measure("crops", is_percent=True),)
HEADER = "frequency,looks,polarization,score"


@pytest.fixture
def read(tmp_path):
    def reader(content, measures=CROPS, factors=FACTORS):
        path = tmp_path / "scores.csv"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return read_scores(path, factors, measures)

    return reader


PLAIN = "frequency,looks,polarization,score,pilot\n1.5,4,HH+HV,73.25,Ann\n9.6,2,VV,60,\n"


@pytest.mark.parametrize(
    "content",
    [
        PLAIN,
        "\ufeff" + PLAIN,
        PLAIN.replace("\n", "\r\n"),
        PLAIN.replace("\n", "\r"),
        PLAIN.replace(",", "\t"),
        PLAIN.replace(",", ";"),
        PLAIN.replace(",", ";").replace("1.5", "1,5").replace("73.25", "73,25").replace("9.6", "9,6"),
        PLAIN.replace("HH+HV", '"HH+HV"').replace("1.5", '" 1.5 "'),
        "\n\n" + PLAIN.replace("\n9", "\n,,,,\n9"),
        PLAIN.replace(",pilot\n", ",pilot,,\n").replace("Ann\n", "Ann,,\n").replace("60,\n", "60,,,\n"),
        PLAIN.replace("frequency", "frequency [MHz]").replace("1.5", "1500").replace("9.6", "9.6e3"),
        "pilot,score,polarization,looks,frequency\nAnn,73.25,HH+HV,4,1.5\n,60,VV,2,9.6",
    ],
)
def test_dialects_say_the_same(read, content):
    first, second = read(content).scores
    assert list(first.settings) == ["frequency", "looks", "polarization"]
    assert first.settings["frequency"] == pytest.approx(1.5, rel=1e-15)
    assert (first.settings["looks"], first.settings["polarization"]) == (4.0, "HH+HV")
    assert (first.score, first.se, first.n, first.correct, first.run_id) == (73.25, None, None, None, None)
    assert first.metadata == {"pilot": "Ann"}
    assert first.application == "crops"
    assert second.settings["frequency"] == pytest.approx(9.6)
    assert second.score == 60.0


def test_a_converted_setting_is_the_number_that_people_write(read):
    """1130 MHz were 1.1300000000000001 GHz, and no repeat of a run at 1.13 GHz."""
    rows = "".join(f"{mhz},4,HH,50\n" for mhz in range(1000, 40000, 10))
    scores = read(f"frequency [MHz],looks,polarization,score\n{rows}").scores
    by_hand = [f"{mhz // 1000}.{mhz % 1000:03d}" for mhz in range(1000, 40000, 10)]
    assert [one.settings["frequency"] for one in scores] == [float(text) for text in by_hand]


def test_a_setting_in_the_factors_own_unit_is_taken_to_the_last_digit(read):
    (one,) = read("frequency,looks,polarization,score\n1.1300000000000001,4,HH,50\n").scores
    assert one.settings["frequency"] == 1.1300000000000001 != 1.13


@pytest.mark.parametrize("row", ["Mean,,,,62", ",,,,62", ",mean,,,62", ",,,Mean,62", "Mean,,,,", ",GHz,-,,%"])
def test_a_row_of_means_or_units_has_one_error(read, row):
    """It had one for each factor, and one for its label in the column of run ids."""
    with pytest.raises(ScoresFileError) as told:
        read(f"run_id,{HEADER}\n1,1,4,HH,61\n2,1,4,VV,63\n{row}\n")
    assert [str(problem) for problem in told.value.problems] == [
        "scores.csv:4: the row has no settings. Give them, or remove a line of means, totals or units; "
        "units go into the header, as frequency [GHz]."
    ]


def test_where_all_factors_are_levels_a_label_alone_is_no_setting(read):
    """A wrong level beside others is told by its column, a line of means by what it is."""
    factors = (FactorColumn("band", levels=("C", "L")), FactorColumn("polarization", levels=("HH", "VV")))
    with pytest.raises(ScoresFileError) as told:
        read("band,polarization,score\nC,HH,61\nX,VV,62\nMean,,62\n", factors=factors)
    assert [(problem.line, problem.field) for problem in told.value.problems] == [(3, "band"), (4, None)]
    assert told.value.problems[1].message == "the row has no settings"


def test_a_title_above_the_header_has_one_error(read):
    """A spreadsheet's had one for each column without a name besides, and one for the scores."""
    with pytest.raises(ScoresFileError) as told:
        read("Flights of team C,,,\n,,,\nfrequency,looks,polarization,score\n1,4,HH,61\n")
    (problem,) = told.value.problems
    assert str(problem).startswith("scores.csv:1: this line is no header: it names no factor. Begin the file with")
    assert problem.remedy.endswith("polarization. Remove what stands above it.")


def test_lines_count_blank_lines_and_quoted_breaks(read):
    content = "\n" + HEADER + ',note\n1,4,HH,50,"two\nlines"\n\n1,4,VV,51,\n'
    assert [score.line for score in read(content).scores] == [3, 6]
    assert read(content).scores[0].note == "two\nlines"


def test_counts_give_score_and_standard_error(read):
    (score,) = read("frequency,looks,polarization,n,correct\n1,4,HH,400,300\n").scores
    # p = 3/4, n = 400: sqrt(3/16/400) = sqrt(3)/80.
    assert score.score == 75.0
    assert score.se == pytest.approx(100 * math.sqrt(3) / 80)
    assert binomial_percent(10, 10) == (100.0, pytest.approx(100 * math.sqrt(0.05 * 0.95 / 10)))
    assert binomial_percent(10, 0)[1] == pytest.approx(binomial_percent(10, 10)[1])


def test_given_standard_error_is_kept_beside_counts(read):
    (score,) = read(HEADER + ",se,n,correct\n1,4,HH,75.2,2.5,400,300\n").scores
    assert (score.score, score.se, score.n, score.correct) == (75.2, 2.5, 400, 300)


def test_counts_of_another_utility_are_only_kept(read):
    (score,) = read(HEADER + ",n,correct\n1,4,HH,-3,400,300\n", [Measure("rank")]).scores
    assert (score.score, score.se, score.n) == (-3.0, None, 400)


@pytest.mark.parametrize(
    ("measure", "unit", "header"),
    [
        (Measure("crops", True, "percent"), "percent", ""),
        (Measure("crops", True, "percent"), "%", ""),
        (Measure("ice", unit="dB"), "dB", ""),
        (Measure("ice", unit="dB"), "percent", "score [dB]"),
        (Measure("ice"), "%", "score"),
    ],
)
def test_scores_may_be_given_with_their_unit_and_with_no_other(read, measure, unit, header):
    content = f"{HEADER} [{unit}]\n1,4,HH,50\n"
    if not header:
        assert read(content, [measure]).scores[0].score == 50.0
        return
    with pytest.raises(ScoresFileError) as refused:
        read(content, [measure])
    assert f"(got '{unit}')" in str(refused.value)
    assert str(refused.value).endswith(f"write the header as: {header}")


def test_several_applications(read):
    measures = [Measure("crops", True), Measure("ice")]
    content = HEADER + ",application\n1,4,HH,50,crops\n1,4,HH,-7,ice\n"
    assert [score.application for score in read(content, measures).scores] == ["crops", "ice"]


def test_unscored_rows_of_proposed_runs_are_left_for_later(read):
    file = read("run_id," + HEADER + "\n7,1,4,HH,50\n8,1,4,VV,\n")
    assert [score.run_id for score in file.scores] == [7]
    assert file.unscored == (3,)


@pytest.mark.parametrize(
    ("short", "factor", "meant"),
    [("bw", "bandwidth", "bandwidth"), ("BW_MHz", "bandwidth", "bandwidth [MHz]"), ("inc", "incidence", "incidence")],
)
def test_short_forms_of_factors_are_known(read, short, factor, meant):
    with pytest.raises(ScoresFileError, match=f"Rename the column '{short}' to '{meant}'".replace("[", r"\[")):
        read(f"{short},score\n1,50\n", factors=(FactorColumn(factor, "MHz" if factor == "bandwidth" else ""),))


def test_whole_numbers_written_as_floats(read):
    assert read("run_id," + HEADER + "\n7.0,1,4,HH,50\n").scores[0].run_id == 7


def test_content_hash_is_sha256(read):
    # Printed by coreutils: printf 'frequency,looks,polarization,score\\n1,2,HH,3\\n' | sha256sum
    assert (
        read("frequency,looks,polarization,score\n1,2,HH,3\n").sha256
        == "098477c82ec184306a06bedf37c87d34d5114ff22c264dbc8c7049a4887f2bb8"
    )


ROW = HEADER + "\n{}\n"
BAD = [
    # content, line, column, what the message or the remedy says
    (b"", None, None, "empty"),
    (b"\xef\xbb\xbf \n", None, None, "empty"),
    (HEADER, 1, None, "no scores"),
    ("run_id," + HEADER + "\n1,1,4,HH,\n", 1, None, "Fill in"),
    (PLAIN.encode("utf-16"), 1, None, "UTF-16"),
    (PLAIN.encode("utf-16-le"), 1, None, "zero bytes"),
    ((HEADER + ",note\n1,4,HH,5,gr\u00fcn\n").encode("latin-1"), 2, None, "Latin-1"),
    (b"PK\x03\x04....", 1, None, "spreadsheet"),
    (b"\x1f\x8b....", 1, None, "compressed"),
    (HEADER + '\n1,4,HH,"5\n', 2, None, "quote"),
    ("frequency [mhz],looks,polarization,score\n1,4,HH,5\n", 1, "frequency", "Did you mean MHz?"),
    ("frequency [cm],looks,polarization,score\n0,4,HH,5\n", 2, "frequency", "above 0"),
    ("freqency,looks,polarization,score\n1,4,HH,5\n", 1, "frequency", "Rename the column 'freqency'"),
    ("looks,polarization,score\n4,HH,5\n", 1, "frequency", "no column"),
    ("frequency,looks,polarization,score_percent\n1,4,HH,5\n", 1, "score", "Rename the column 'score_percent'"),
    (
        "frequency,looks,polarization,n_correct,n_total\n1,4,HH,5,200\n",
        1,
        "score",
        "counts are two columns, n and correct",
    ),
    ("frequency,looks,polarization\n1,4,HH\n", 1, "score", "no column"),
    (HEADER + ",score\n1,4,HH,5,6\n", 1, "score", "two columns"),
    (HEADER + ",\n1,4,HH,5,6\n", 1, None, "has no name"),
    ("frequency [K],looks,polarization,score\n1,4,HH,5\n", 1, "frequency", "cannot be converted"),
    ("frequency,looks [m],polarization,score\n1,4,HH,5\n", 1, "looks", "dimensionless"),
    ("frequency,looks,polarization,score [m]\n1,4,HH,5\n", 1, "score", "not the unit"),
    (ROW.format("1,4,HH"), 2, None, "3 cells, the header 4"),
    (ROW.format("1,5,4,HH,50"), 2, None, "decimal comma"),
    (ROW.format("one,4,HH,50"), 2, "frequency", "not a number"),
    (ROW.format('"1,5",4,HH,50'), 2, "frequency", "decimal point"),
    (ROW.format(",4,HH,50"), 2, "frequency", "empty"),
    (ROW.format("nan,4,HH,50"), 2, "frequency", "not a number"),
    (ROW.format("1,inf,HH,50"), 2, "looks", "not a number"),
    (ROW.format("1,1e999,HH,50"), 2, "looks", "not a number"),
    (ROW.format("1,1_0,HH,50"), 2, "looks", "not a number"),
    (ROW.format("1,0x10,HH,50"), 2, "looks", "not a number"),
    (ROW.format("1,4,HH,50 %"), 2, "score", "not a number"),
    (ROW.format("1,4,HH,"), 1, None, "Fill in"),
    (ROW.format("1,4,HH,100.1"), 2, "score", "0 to 100"),
    (ROW.format("1,4,HH,-1"), 2, "score", "0 to 100"),
    (ROW.format("1,4,hh,50"), 2, "polarization", "Did you mean 'HH'?"),
    (ROW.format("1,4,HH+VH,50"), 2, "polarization", "Did you mean 'HH+HV'"),
    (ROW.format("1,4,,50"), 2, "polarization", "empty"),
    (HEADER + ",se\n1,4,HH,50,-2\n", 2, "se", "above 0"),
    (HEADER + ",se\n1,4,HH,50,0\n", 2, "se", "Leave it empty"),
    (HEADER + ",n,correct\n1,4,HH,50,10,11\n", 2, "correct", "larger 'n'"),
    (HEADER + ",correct\n1,4,HH,50,11\n", 2, "correct", "larger 'n'"),
    (HEADER + ",n,correct\n1,4,HH,50,10,2.5\n", 2, "correct", "whole"),
    (HEADER + ",n,correct\n1,4,HH,50,0,0\n", 2, "n", "at least 1"),
    (HEADER + ",n,correct\n1,4,HH,50,100,49\n", 2, "score", "49.00 percent"),
    (HEADER + ",run_id\n1,4,HH,50,0\n", 2, "run_id", "at least 1"),
    (HEADER + ",run_id\n1,4,HH,50,3\n1,4,VV,51,3\n", 3, "run_id", "line 2"),
    (HEADER + ",source\n1,4,HH,50,moon\n", 2, "source", "flight or simulation"),
    (HEADER + ",application\n1,4,HH,50,ice\n", 2, "application", "Applications: crops"),
    ("frequency;looks;polarization;score\n1.200,5;4;HH;50\n", 2, "frequency", "thousands"),
    ("frequency;looks;polarization;score\n1,5;4;HH;50\n1.5;4;HH;50\n", 3, "frequency", "one decimal sign"),
]


@pytest.mark.parametrize(("content", "line", "column", "says"), BAD)
def test_bad_files(read, content, line, column, says):
    with pytest.raises(ScoresFileError) as caught:
        read(content)
    (problem,) = caught.value.problems
    assert problem.file == "scores.csv"
    assert (problem.line, problem.field) == (line, column)
    assert says in str(problem)
    assert problem.remedy


@pytest.mark.parametrize(("more", "says"), [("", "Add it."), (",n,correct", "n and correct make a percentage, and no")])
def test_counts_are_no_score_where_no_application_is_a_percentage(read, more, says):
    """It was told row by row that the cell of the score is empty, of which there was no column."""
    with pytest.raises(ScoresFileError) as caught:
        read(f"{HEADER.removesuffix(',score')}{more}\n1,4,HH{',9,5' if more else ''}\n", [Measure("ice", unit="dB")])
    (problem,) = caught.value.problems
    assert (problem.line, problem.field, problem.message) == (1, "score", "there is no column of scores")
    assert says in problem.remedy
    assert "or n" not in problem.remedy


def test_all_problems_at_once(read):
    with pytest.raises(ScoresFileError) as caught:
        read(HEADER + "\nx,4,HH,50\n1,4,XX,500\n1,4,HH,50\n1,y,HH,\n")
    assert [(p.line, p.field) for p in caught.value.problems] == [
        (2, "frequency"),
        (3, "polarization"),
        (3, "score"),
        (5, "looks"),
    ]


def test_endless_problems_are_cut_short(read):
    with pytest.raises(ScoresFileError) as caught:
        read(HEADER + "\n" + "x,4,HH,50\n" * 150)
    assert len(caught.value.problems) == cells.MAX_PROBLEMS + 1
    assert "50 more" in str(caught.value.problems[-1])


def test_missing_and_large_files(tmp_path, monkeypatch):
    with pytest.raises(ScoresFileError, match="no such file"):
        read_scores(tmp_path / "absent.csv", FACTORS, CROPS)
    path = tmp_path / "large.csv"
    path.write_text(PLAIN)
    monkeypatch.setattr(table, "MAX_BYTES", 10)
    with pytest.raises(ScoresFileError, match="split it"):
        read_scores(path, FACTORS, CROPS)


@pytest.mark.parametrize("header", ["wavelength [cm]", "frequency [cm]", "Wavelength (cm)"])
def test_wavelengths_are_converted(read, header):
    (score,) = read(f"{header},looks,polarization,score\n23.6057,4,HH,50\n").scores
    assert score.settings["frequency"] == pytest.approx(1.27, rel=1e-6)  # PALSAR: 1270 MHz, 23.6 cm
    assert score.metadata == {}


def test_a_wavelength_beside_the_frequency_is_a_column_of_the_users_own(read):
    (score,) = read("wavelength [cm],frequency,looks,polarization,score\n23.6,1.3,4,HH,50\n").scores
    assert score.settings["frequency"] == 1.3
    assert score.metadata == {"wavelength [cm]": "23.6"}


def test_rows_without_a_score_wait(read):
    file = read(HEADER + ",note\n1,4,HH,50,\n1,4,VV,,cloudy\n")
    assert (len(file.scores), file.unscored) == (1, (3,))


@pytest.mark.parametrize(
    ("unit", "wanted", "factor"),
    [("MHz", "GHz", 1e-3), ("Hz", "GHz", 1e-9), ("km", "m", 1e3), ("rad", "deg", 180 / math.pi), ("kW", "W", 1e3)],
)
def test_unit_factors(unit, wanted, factor):
    assert unit_factor(unit, wanted) == pytest.approx(factor, rel=1e-15)


@pytest.mark.parametrize(("unit", "wanted"), [("m", "GHz"), ("furlong", "m"), ("m", "")])
def test_units_that_do_not_fit(unit, wanted):
    assert unit_factor(unit, wanted) is None


def test_a_unit_in_the_header_is_that_of_every_row(read) -> None:
    """Of two applications in one file: 0.06 percent are no 0.06 m3/m3."""
    two = (Measure("crops", True), Measure("moisture", unit="m3/m3"))
    head = "frequency,looks,polarization,application,score"
    rows = "1,4,HH,crops,70\n1,8,HH,moisture,0.06\n"
    with pytest.raises(ScoresFileError, match="scores of 'moisture' are in m3/m3") as caught:
        read(f"{head} [%]\n{rows}", two)
    assert [(one.line, one.field, one.value) for one in caught.value.problems] == [(3, "score", "percent")]
    assert len(read(f"{head}\n{rows}", two).scores) == 2
