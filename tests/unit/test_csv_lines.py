"""The small tables that users write: the same cells however a spreadsheet saves them, or an error that says where."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import pytest

from seqrsm.csv_lines import read_cells
from seqrsm.errors import SceneError

ROWS = [["name", "value", "note"], ["Wheat", "-1.5", "a, b; c"], ["Oats", "2e-1", ""], ["Corn", ".5", "x y"]]


def read(path: Path) -> list[tuple[int, list[str]]]:
    return read_cells(path, "the table", SceneError, "file")


@pytest.mark.parametrize(("separator", "point"), [(",", "."), (";", "."), (";", ","), ("\t", ","), ("\t", ".")])
def test_a_table_has_the_same_cells_however_a_spreadsheet_saves_it(tmp_path: Path, separator: str, point: str) -> None:
    text = io.StringIO()
    rows = [[row[0], row[1].replace(".", point), row[2]] for row in ROWS]
    csv.writer(text, delimiter=separator).writerows([rows[0], ["", "", ""], *rows[1:]])
    path = tmp_path / "table.csv"
    path.write_bytes(b"\xef\xbb\xbf# one, two; three\r\n\r\n" + text.getvalue().encode())
    assert read(path) == [(line, row) for line, row in zip((3, 5, 6, 7), ROWS, strict=True)]


def test_cells_lose_blanks_at_their_ends_and_commas_of_text_stay(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    path.write_text("a ; b\n 1,25;one,two\n-3,5E-2 ;1,2,3\n", encoding="utf-8")
    assert read(path) == [(1, ["a", "b"]), (2, ["1.25", "one,two"]), (3, ["-3.5E-2", "1,2,3"])]


def test_what_cannot_be_read_is_told_with_its_place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "table.csv"
    for data, place, told in (
        (b'a,b\n1,"2\n', ":2", "not a CSV line.*Close every quote"),
        ("a,b\nGr\xfcn,1\n".encode("latin-1"), "", "not UTF-8"),
        (None, "", "cannot read the table: No such file"),
    ):
        path.unlink(missing_ok=True)
        if data is not None:
            path.write_bytes(data)
        with pytest.raises(SceneError, match=told) as caught:
            read(path)
        assert str(caught.value).startswith(f"{path}{place}: ")
    monkeypatch.setattr("seqrsm.csv_lines._MAX_BYTES", 3)
    path.write_text("a,b\n", encoding="utf-8")
    with pytest.raises(SceneError, match="larger than 0 MB"):
        read(path)
