"""Files that are read without an error and are hardly what was meant, and near misses: the words that come."""

from __future__ import annotations

import importlib.util
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import seqrsm
from seqrsm.cli.app import app
from seqrsm.errors import ScoresFileError

SPEC = """\
[campaign]
name = "nasty"
[[factor]]
name = "frequency"
unit = "GHz"
low = 1.0
high = 12.0
scale = "log"
[[factor]]
name = "resolution"
unit = "m"
low = 5.0
high = 60.0
[[factor]]
name = "polarization"
levels = ["HH", "VV", "HH+HV"]
[[application]]
name = "crops"
utility = "{utility}"
[stop]
half_width = 3
"""
HEADER = "frequency,resolution,polarization,score"
GOOD = ["1.5,12,HH,70", "3,20,VV,72.5", "5,30,HH,68", "9,40,VV,61.25", "2,55,HH,64", "7,8,HH+HV,66.5", "4,25,HH,71.125"]
NUMBERS = "measured"
PERCENT = "percent_correct"


def text(*rows: str, header: str = HEADER) -> str:
    return "\n".join([header, *rows]) + "\n"


def wide(header: str, cell: str, *rows: str) -> str:
    """Good rows with one more cell, and further rows."""
    return text(*(f"{row},{cell}" for row in GOOD), *rows, header=f"{HEADER},{header}")


HELD = [
    # what is held back: utility, file, words
    (
        NUMBERS,
        text(*GOOD, "1500,12,HH,70", "3200,20,VV,69"),
        "frequency: far outside 1 to 12 GHz (so 1 more row: line 10)",
    ),
    (NUMBERS, text(*GOOD, "1500,12,HH,70"), "Did you mean MHz? Then write the header as: frequency [MHz]"),
    (NUMBERS, text(*GOOD, "3e9,12,HH,70"), "Did you mean Hz?"),
    (NUMBERS, text(*GOOD, "3,1200,HH,70"), "Did you mean cm?"),
    (NUMBERS, text(*GOOD, "3,0.03,HH,70"), "Did you mean km?"),
    (NUMBERS, text(*GOOD, "3,900000,HH,70"), "resolution: far outside 5 to 60 m (got 900000.0). Correct it."),
    (NUMBERS, text(*GOOD, "3,-9999,HH,70"), "resolution: far outside"),
    (NUMBERS, text(*GOOD, "3,12,HH,-9999"), "usually marks a missing value"),
    (NUMBERS, text(*GOOD, "3,12,HH,-999"), "Leave the cell empty if there is none."),
    (NUMBERS, text(*GOOD, "3,12,HH,9999"), "usually marks a missing value"),
    (NUMBERS, text(*GOOD, "3,12,HH,-32768"), "usually marks a missing value"),
    (NUMBERS, text("3,12,HH,-9999"), "usually marks a missing value"),
    (
        NUMBERS,
        text(*GOOD, "3,12,HH,7125"),
        "far from all other scores, 61.25 to 72.5 (got 7125.0). Did you mean 71.25?",
    ),
    (NUMBERS, text(*GOOD, "3,12,HH,705"), "Did you mean 70.5?"),
    (NUMBERS, text(*GOOD, "3,12,HH,0.705"), "Did you mean 70.5?"),
    (NUMBERS, text(*GOOD, "3,12,HH,-70.5"), "Did you mean 70.5?"),
    (PERCENT, text(*GOOD, "3,12,HH,0.71"), "a fraction among percentages (got 0.71). Did you mean 71 percent?"),
    (NUMBERS, text(*GOOD, GOOD[2]), "scores.csv:9: row: the same as line 4 in every column"),
    (NUMBERS, text(*GOOD, GOOD[2], GOOD[2]), "(so 1 more row: line 10)"),
    (NUMBERS, text(*GOOD, GOOD[2].replace(",", " , ")), "a true repeat must differ in a column such as date or note"),
    (NUMBERS, wide("se", "1.5", "3,12,HH,70,9999"), "se: usually marks a missing value"),
    (NUMBERS, wide("Run ID", ""), "Run ID: the column is kept as your own, but its name resembles 'run_id'"),
    (NUMBERS, wide("runid", ""), "Name it 'run_id'."),
    (NUMBERS, wide("SE", "1.5"), "Name it 'se'."),
    (NUMBERS, wide("sorce", "flight"), "Name it 'source'."),
    (NUMBERS, wide("Aplication", "crops"), "Name it 'application'."),
    (NUMBERS, wide("Block", "day 1"), "Name it 'block'."),
]
REFUSED = [
    # what is an error whatever is accepted
    (PERCENT, text(*GOOD, "3,12,HH,-9999"), "Leave the cell empty if there is no score."),
    (
        NUMBERS,
        text(*GOOD, header=HEADER.replace("score", "time")),
        "Rename the column that contains them to 'score'; unknown columns: time.",
    ),
    (NUMBERS, text(*GOOD, "3,12,HH,NA"), "Leave the cell empty if there is no value."),
    (NUMBERS, text(*GOOD, "3,12,HH,3.4e38"), "Scores up to 1e+12 are"),
    (NUMBERS, text(*GOOD, "3,12,HH,n/a"), "Leave the cell empty if there is no value."),
    (NUMBERS, text(*GOOD, "3,12,hh,70"), "Did you mean 'HH'?"),
    (NUMBERS, text(*GOOD, "3,12,HH-HV,70"), "Did you mean 'HH+HV'?"),
    (NUMBERS, wide("application", "Crops"), "Did you mean 'crops'?"),
    (NUMBERS, wide("source", "flihgt"), "Did you mean flight?"),
    (NUMBERS, wide("source", "drone"), "Any other measurement counts as a flight."),
    (
        NUMBERS,
        text(*GOOD, header=HEADER.replace("frequency", "Frequency")),
        "Rename the column 'Frequency' to 'frequency'.",
    ),
    (NUMBERS, text(*GOOD, header=HEADER.replace("frequency", "FREQ")), "Rename the column 'FREQ' to 'frequency'."),
    *(
        (NUMBERS, text(*GOOD, header=HEADER.replace(name, short)), f"Rename the column '{short}' to '{meant}'.")
        for name, short, meant in (
            ("polarization", "Pol", "polarization"),
            ("polarization", "pol.", "polarization"),
            ("resolution", "Res_m", "resolution [m]"),
            ("frequency", "Freq [MHz]", "frequency [MHz]"),
        )
    ),
    (NUMBERS, text(*GOOD, header=HEADER.replace("frequency", "frequency [ghz]")), "Did you mean GHz?"),
    (
        NUMBERS,
        text(*GOOD, header=HEADER.replace("resolution", "resolution [GHz]")),
        "Give it in m or km or cm or mm or ft.",
    ),
    (NUMBERS, text(*GOOD, header=HEADER.replace("score", "Score")), "Rename the column 'Score' to 'score'."),
    # what instruments, spreadsheets and hands add to a table
    (NUMBERS, text(*GOOD, header=HEADER.replace("frequency", '"frequency, MHz"')), "to 'frequency [MHz]'."),
    (NUMBERS, text(*GOOD[:3], HEADER, *GOOD[3:]), "scores.csv:5: this is the header again. Remove the line."),
    (NUMBERS, text("GHz,m,,percent", *GOOD), "units go into the header, as frequency [GHz]"),
    (NUMBERS, text(*GOOD, "mean,,,65.2"), "remove a line of means"),
    (NUMBERS, text(*GOOD, "3,12,HH,71 %"), "(got '71 %'). Remove the percent sign"),
    (NUMBERS, text(*GOOD, "3,12,HV+HH,70"), "Did you mean 'HH+HV'?"),
    (NUMBERS, text(*GOOD, "3,12,HH\u200b,70"), "Did you mean 'HH'?"),
    (
        NUMBERS,
        text(*GOOD[1:], header=GOOD[0]),
        "this line is no header: it names no factor. Begin the file with a line",
    ),
    (NUMBERS, text(HEADER, *GOOD, header=",,Freq,Result"), "this line is no header"),  # of merged cells
    (
        NUMBERS,
        text(*GOOD, header=HEADER.replace("resolution", "Aufl\u00f6sung (m)")),
        "Add it, or rename the one that contains it to 'resolution': Aufl\u00f6sung (m).",
    ),
    (NUMBERS, "<html><table><tr><td>1</td></tr></table></html>\n", "this line is no header"),
    (
        NUMBERS,
        text(*GOOD, '3,12,HH,"71,3"'),
        "Use a decimal point, or, in a text file, separate the cells by semicolons.",
    ),
    (NUMBERS, text(*GOOD, "3,12,HH,#DIV/0!"), "this is not a number (got '#DIV/0!')"),
    (NUMBERS, text(*GOOD, "3,12,HH,inf"), "(got 'inf'). Give a finite number"),
    (NUMBERS, text(*GOOD, "3,12,HH,=B2*2"), "this is not a number (got '=B2*2')"),
    (NUMBERS, text(*GOOD, "3,12,HH,71 \u00b1 2"), "this is not a number"),
    (NUMBERS, text(*GOOD[:3], "# rain from here", *GOOD[3:]), "the row has 1 cells, the header 4"),
    (NUMBERS, wide("score", "3"), "score: two columns have this name"),
    (NUMBERS, text(*GOOD, '3,12,"HH,70'), "Close every quote"),
]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "c").mkdir()
    return tmp_path / "c"


def ingest(folder: Path, utility: str, content: str, *options: str) -> tuple[int, str]:
    (folder / "campaign.toml").write_text(SPEC.format(utility=utility), encoding="utf-8")
    (folder / "scores.csv").write_text(content, encoding="utf-8")
    done = CliRunner().invoke(app, ["ingest", str(folder), str(folder / "scores.csv"), *options])
    assert "Traceback" not in done.output
    return done.exit_code, done.output


def scored(folder: Path) -> int:
    with_store = seqrsm.Campaign(folder)
    return len(with_store.opened.store.runs("scored"))


@pytest.mark.parametrize(("utility", "content", "says"), HELD)
def test_held_back_with_what_may_have_been_meant(folder: Path, utility: str, content: str, says: str) -> None:
    code, output = ingest(folder, utility, content)
    assert code == 2
    assert says in output
    assert "nothing was ingested" in output
    assert "--accept" in output
    assert scored(folder) == 0
    code, output = ingest(folder, utility, content, "--accept")
    assert code == 0, output
    assert scored(folder) == content.count("\n") - 1


@pytest.mark.parametrize(
    ("column", "says"),
    [
        ("Flight_Day", "Flight_Day: the column is kept as your own, but its name resembles 'flight day'"),
        ("block", "block: the campaign takes blocks from the column 'flight day'. Name it 'flight day'."),
    ],
)
def test_days_under_another_name_are_held_back(folder: Path, column: str, says: str) -> None:
    """Without its day a run counts as of one more day."""
    days = '[model]\nblock = "flight day"\n'
    (folder / "campaign.toml").write_text(SPEC.format(utility=NUMBERS) + days, encoding="utf-8")
    file = folder / "scores.csv"
    for name, code in ((column, 2), ("flight day", 0)):
        file.write_text(wide(name, "Monday"), encoding="utf-8")
        done = CliRunner().invoke(app, ["ingest", str(folder), str(file)])
        assert done.exit_code == code, done.output
        assert (says in " ".join(done.output.split())) is (code == 2)
    assert scored(folder) == len(GOOD)


@pytest.mark.parametrize(("utility", "content", "says"), REFUSED)
def test_refused_with_what_may_have_been_meant(folder: Path, utility: str, content: str, says: str) -> None:
    code, output = ingest(folder, utility, content, "--accept")
    assert code == 2
    assert says in output
    assert scored(folder) == 0


@pytest.mark.parametrize(
    ("utility", "content"),
    [
        (NUMBERS, text(*GOOD)),
        (PERCENT, text(*GOOD, "3,12,HH,0", "4,12,HH,100")),
        (  # less than 1 percent, by its counts
            PERCENT,
            text(
                *(row.rsplit(",", 1)[0] + ",150,105" for row in GOOD),
                "3,12,HH,150,1",
                header=HEADER.replace("score", "n,correct"),
            ),
        ),
        (NUMBERS, text(*GOOD, "18,4,HH,70")),  # somewhat outside the region
        (NUMBERS, text("1.5,12,HH,-99.5", "2,12,HH,-98", "3,12,HH,-99", "4,20,VV,-97", "5,9,HH,-96", "6,9,HH,-98.5")),
        (NUMBERS, text(*(row.rsplit(",", 1)[0] + ",0.5" for row in GOOD), "3,12,HH,0.501")),
        (NUMBERS, wide("date", "1979-05-12", "1.5,12,HH,70,1979-05-13")),
        (NUMBERS, wide("operator", "Ann")),
        (NUMBERS, text(*GOOD, "3,12,HH,95", "4,33,VV,20")),
        (NUMBERS, text(*GOOD).replace(",", "|")),
        (NUMBERS, text(*(f"{row},,," for row in GOOD), header=f"{HEADER},,,")),
        (NUMBERS, text(*(f"{row}," for row in GOOD))),
        (NUMBERS, text(*GOOD).replace("\n", "\r")),
        (NUMBERS, "sep=,\r\n" + text(*GOOD)),
        (NUMBERS, text(*GOOD, "3,12,HH\u00a0,70")),
    ],
)
def test_what_is_only_unusual_is_taken(folder: Path, utility: str, content: str) -> None:
    code, output = ingest(folder, utility, content)
    assert code == 0, output


def test_earlier_scores_tell_what_is_far(folder: Path) -> None:
    assert ingest(folder, NUMBERS, text(*GOOD))[0] == 0
    code, output = ingest(folder, NUMBERS, text("3,12,HH,7.05"))
    assert code == 2
    assert "Did you mean 70.5?" in output
    assert scored(folder) == len(GOOD)


def test_a_form_half_filled_in(folder: Path) -> None:
    code, output = ingest(folder, NUMBERS, text(*GOOD, "3,12,HH,", "4,12,VV,"))
    assert code == 0
    assert "2 rows have no score yet and may be ingested later (lines 9, 10)." in output
    _, output = ingest(folder, NUMBERS, text(*GOOD, "3,12,HH,"))
    assert "1 row has no score yet and may be ingested later (line 9)." in output


def frame() -> pd.DataFrame:
    rows = [row.split(",") for row in GOOD]
    found = pd.DataFrame(rows, columns=HEADER.split(","))
    return found.astype({"frequency": float, "resolution": float, "score": float})


def test_tables_in_memory_are_guarded_too(folder: Path) -> None:
    (folder / "campaign.toml").write_text(SPEC.format(utility=NUMBERS), encoding="utf-8")
    c = seqrsm.Campaign(folder)
    odd = frame()
    odd.loc[2, "score"] = -9999
    with pytest.raises(ScoresFileError, match="DataFrame:4: score: usually marks a missing value"):
        c.ingest(odd)
    assert len(c.ingest(odd, accept=True).reports[0].created) == len(GOOD)
    gaps = frame().assign(date=pd.Timestamp("1979-05-12"), n=pd.array([1, None] * 3 + [7], dtype="Int64"))
    gaps.loc[[1, 3], "score"] = np.nan
    (report,) = c.ingest(gaps.set_index("frequency")).reports
    assert (report.n_scores, report.unscored) == (len(GOOD) - 2, (3, 5))
    assert c.opened.store.runs()[-1].scores[0].metadata["date"] == "1979-05-12"


@pytest.mark.parametrize(
    ("kind", "library", "extra"), [("xlsx", "openpyxl", "excel"), ("parquet", "pyarrow", "parquet")]
)
def test_spreadsheets_and_parquet(
    folder: Path, kind: str, library: str, extra: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder / "campaign.toml").write_text(SPEC.format(utility=NUMBERS), encoding="utf-8")
    c = seqrsm.Campaign(folder)
    path = folder / f"scores.{kind}"
    if importlib.util.find_spec(library) is None:
        path.write_bytes(b"PK\x03\x04")
        with pytest.raises(ScoresFileError, match=rf"needs {library}.*seqrsm\[{extra}\]"):
            c.ingest(path)
        return
    wrong = frame().assign(score=["x", *GOOD[1:]])
    getattr(wrong, {"xlsx": "to_excel", "parquet": "to_parquet"}[kind])(path, index=False)
    with pytest.raises(ScoresFileError, match=rf"scores.{kind}:2: score: this is not a number"):
        c.ingest(path)
    if kind == "xlsx":  # a formula that failed is no score that is still to come
        frame().assign(score=["#DIV/0!", *GOOD[1:]]).to_excel(path, index=False)
        with pytest.raises(ScoresFileError, match=r"scores.xlsx:2: score: this is not a number"):
            c.ingest(path)
    getattr(frame(), {"xlsx": "to_excel", "parquet": "to_parquet"}[kind])(path, index=False)
    if kind == "xlsx":  # cells that have a format, and nothing in them
        openpyxl = importlib.import_module(library)
        book = openpyxl.load_workbook(path)
        book.active.cell(row=40, column=9).number_format = "0.00"
        book.save(path)
        real = openpyxl.load_workbook

        def warned(*given: Any, **more: Any) -> Any:
            warnings.warn("Data Validation extension is not supported and will be removed", stacklevel=2)
            return real(*given, **more)

        monkeypatch.setattr(openpyxl, "load_workbook", warned)
    c.ingest(path)
    assert [run.scores[0].score for run in c.opened.store.runs()] == frame()["score"].to_list()
    path.write_bytes(b"no such thing")
    with pytest.raises(ScoresFileError, match="cannot be read"):
        c.ingest(path)
