"""What is written is read back: scores files in every dialect, campaign.toml with any names and ranges."""

from __future__ import annotations

import csv
import io
import math
import tempfile
from pathlib import Path

from hypothesis import given, settings
from hypothesis import strategies as st

from seqrsm.errors import UserError
from seqrsm.score.cells import FactorColumn, Measure
from seqrsm.score.flight import read_scores
from seqrsm.spec.read import load_spec
from seqrsm.spec.toml_lines import key_lines

LEVELS = ("HH", "VV", "HH+HV", "-45", "=x", "a;b", 'a"b', "\u00fc, \u6f22")
FACTORS = (FactorColumn("frequency", "GHz"), FactorColumn("kind", levels=LEVELS))
NUMBER = st.floats(allow_nan=False, allow_infinity=False)
TEXT = st.text(st.characters(codec="utf-8", exclude_characters="\0\r"), max_size=20).map(str.strip)
ROW = st.fixed_dictionaries(
    {
        "frequency": NUMBER,
        "kind": st.sampled_from(LEVELS),
        "score": NUMBER,
        "se": st.none() | st.floats(min_value=1e-300, allow_infinity=False, allow_nan=False),
        "note": TEXT.filter(lambda text: text[:1] != "'"),
    }
)


def attempt(function, argument):
    """What the function returns and no problems, or None and the problems of its error."""
    try:
        return function(argument), ()
    except UserError as error:
        return None, error.problems


def read_bytes(data: bytes):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scores.csv"
        path.write_bytes(data)
        return read_scores(path, FACTORS, [Measure("rank")])


@settings(max_examples=80, deadline=None)
@given(
    rows=st.lists(ROW, min_size=1, max_size=6),
    delimiter=st.sampled_from(",;\t"),
    comma=st.booleans(),
    mark=st.booleans(),
    ending=st.sampled_from(["\n", "\r\n"]),
    order=st.permutations(["frequency", "kind", "score", "se", "note"]),
)
def test_scores_are_read_back(rows, delimiter, comma, mark, ending, order):
    stream = io.StringIO(newline="")
    writer = csv.writer(stream, delimiter=delimiter, lineterminator=ending)
    writer.writerow(order)
    for row in rows:
        cells = {key: "" if value is None else str(value) for key, value in row.items()}
        if comma and delimiter != ",":
            for key in ("frequency", "score", "se"):
                cells[key] = cells[key].replace(".", ",")
        writer.writerow([cells[key] for key in order])
    scores = read_bytes(("\ufeff" * mark + stream.getvalue()).encode()).scores
    assert len(scores) == len(rows)
    for score, row in zip(scores, rows, strict=True):
        assert score.settings == {"frequency": row["frequency"], "kind": row["kind"]}
        assert (score.score, score.se, score.note) == (row["score"], row["se"], row["note"])


@settings(max_examples=80, deadline=None)
@given(st.binary(max_size=200) | st.text(max_size=200).map(str.encode))
def test_no_file_of_scores_breaks_the_reader(data):
    header = b"frequency,kind,score\n"
    for content in (data, header + data, header.replace(b",", b";") + data):
        file, problems = attempt(read_bytes, content)
        assert problems or all(math.isfinite(score.score) for score in file.scores)


SPEC = """\
[campaign]
name = "a"
[[factor]]
name = "{name}"
low = {low!r}
high = {high!r}
[[factor]]
name = "f_"
levels = {levels}
[[application]]
name = "b"
utility = "measured"
[stop]
half_width = {half_width!r}
"""
KEYS = st.from_regex(r"[a-z]{3,8}[0-9]", fullmatch=True)
PLAIN = st.floats(min_value=-1e9, max_value=1e9).map(lambda value: round(value, 6))


def load_text(text: str):
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "campaign.toml").write_bytes(text.encode())
        return load_spec(folder)


@settings(max_examples=50, deadline=None)
@given(
    name=KEYS,
    ends=st.tuples(PLAIN, PLAIN),
    levels=st.lists(KEYS, min_size=1, max_size=4),
    half_width=st.floats(min_value=-1, max_value=10),
)
def test_a_specification_is_right_or_says_where_it_is_wrong(name, ends, levels, half_width):
    low, high = ends
    text = SPEC.format(name=name, low=low, high=high, levels=levels, half_width=half_width)
    wrong = {
        line
        for line, bad in [(5, low >= high), (9, len(set(levels)) < max(2, len(levels))), (14, half_width <= 0)]
        if bad
    }
    spec, problems = attempt(load_text, text)
    assert {problem.line for problem in problems} == wrong
    if not wrong:
        assert (spec.factors[0].name, spec.factors[0].low, spec.factors[0].high) == (name, low, high)
        assert (spec.factors[1].levels, spec.stop.half_width) == (tuple(levels), half_width)


@settings(max_examples=80, deadline=None)
@given(st.text(max_size=120) | st.text("[]={}\"'.,#\nab1 -", max_size=60))
def test_no_text_breaks_the_specification(text):
    spec, problems = attempt(load_text, text)
    assert (spec is None) == bool(problems)


@settings(max_examples=80, deadline=None)
@given(st.text("[]={}\"'.,#\nab1 ", max_size=40))
def test_the_locator_knows_every_key_of_valid_toml(text):
    import tomllib

    try:
        document = tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return
    lines = key_lines(text)

    def visit(value, path):
        assert 1 <= lines[path] <= text.count("\n") + 1
        items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
        for key, inner in items:
            visit(inner, (*path, key))

    visit(document, ())
