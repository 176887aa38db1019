"""The locator against a naive reading: every key below is named after the line it stands on."""

from __future__ import annotations

import tomllib

import pytest

from seqrsm.spec.toml_lines import key_lines, line_of

TEXT = '''# comment [not.a.table]
top2 = 1
"top 3" = "a # b [x] \\" \\\\"
dotted4.inner4 = 'c:\\'
dotted5 . "x.y5" = """one "quoted"
[no7]
"""
[table8]
key9 = [1, 2,
  3,  # comment, ] with bracket
  [4, "]"], {k12 = 1, l12 = {m12 = 2}},
]
after14 = 1979-05-27 07:32:00
[table8.sub15]
key16 = 0x1F
[[array17]]
key18 = "a"
[[array17]]
key20 = \'\'\'l1
]]\'\'\'\'\'
[array17.sub22]
key23 = {a23 = "}", "b 23" = [1, {c23 = 1}]}
[[array17.deep24]]
k25 = 1
[[array17.deep24]]
k27 = -inf
'''


def _leaves(value: object, path: tuple = ()):  # type: ignore[type-arg]
    yield path
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _leaves(inner, (*path, key))
    elif isinstance(value, list):
        for index, inner in enumerate(value):
            yield from _leaves(inner, (*path, index))


def test_every_path_of_the_document_has_a_line():
    assert set(_leaves(tomllib.loads(TEXT))) == set(key_lines(TEXT))


@pytest.mark.parametrize(
    ("path", "line"),
    [
        (("top2",), 2),
        (("top 3",), 3),
        (("dotted4", "inner4"), 4),
        (("dotted5", "x.y5"), 5),
        (("table8",), 8),
        (("table8", "key9"), 9),
        (("table8", "key9", 0), 9),
        (("table8", "key9", 2), 10),
        (("table8", "key9", 3, 1), 11),
        (("table8", "key9", 4, "l12", "m12"), 11),
        (("table8", "after14"), 13),
        (("table8", "sub15", "key16"), 15),
        (("array17",), 16),
        (("array17", 0), 16),
        (("array17", 0, "key18"), 17),
        (("array17", 1), 18),
        (("array17", 1, "key20"), 19),
        (("array17", 1, "sub22"), 21),
        (("array17", 1, "sub22", "key23", "b 23", 1, "c23"), 22),
        (("array17", 1, "deep24", 0, "k25"), 24),
        (("array17", 1, "deep24", 1, "k27"), 26),
    ],
)
def test_lines(path, line):
    found = key_lines(TEXT)[path]
    assert found == line
    name = next((part for part in reversed(path) if isinstance(part, str)), "")
    assert TEXT.splitlines()[found - 1]
    if path[-1] == name:
        assert name in TEXT.splitlines()[found - 1]


def test_missing_key_gets_the_line_of_its_table():
    lines = key_lines(TEXT)
    assert line_of(lines, ("array17", 1, "absent")) == 18
    assert line_of(lines, ("nowhere", 3, "absent")) == 1


@pytest.mark.parametrize("text", ["", "\n\n", "# only\r\n", "a = 1", "a = 1\r\nb = 2\r\n"])
def test_small_texts(text):
    lines = key_lines(text)
    assert lines[()] == 1
    assert set(lines) == set(_leaves(tomllib.loads(text)))
