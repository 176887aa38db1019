"""Commands that work on one campaign at once double nothing and keep to the budget, wherever one meets the other.

Here at some of the moments; at all of them: tests/studies/hands_study.py.
"""

from __future__ import annotations

import pytest
from interleaving import command, found, interleaved, made, without_engine
from postgres_server import wipe

pytestmark = pytest.mark.usefixtures("few_draws")


@pytest.fixture(autouse=True)
def engine(monkeypatch):
    without_engine(monkeypatch)


@pytest.mark.parametrize("others", [["propose"], ["propose"] * 3])
def test_one_start_design_whoever_proposes(tmp_path, url, others):
    assert interleaved(tmp_path / "c", "propose", others, moment=1, url=url)
    runs, _ = found(tmp_path / "c")
    assert len(runs) == 9
    assert {run[1] for run in runs} == {1}


@pytest.mark.parametrize(("others", "step"), [(["run"], 13), (["run"] * 3, 23), (["simulate"], 23), (["propose"], 23)])
def test_the_same_end_whoever_works_beside(tmp_path, others, step):
    command("run", made(tmp_path / "calm"))
    expected = found(tmp_path / "calm")
    moment = 8  # between reading and deciding
    while interleaved(tmp_path / str(moment), "run", others, moment):
        runs, looks = found(tmp_path / str(moment))  # within the budget
        assert {run[3] for run in runs} == {"scored"}, moment
        assert others == ["propose"] or (runs, looks) == expected, moment
        moment += step
    assert moment > 50


@pytest.mark.parametrize("others", [["run"], ["simulate"]])
def test_the_same_end_on_a_server(tmp_path, postgres, others):
    command("run", made(tmp_path / "calm"))
    expected = found(tmp_path / "calm")
    for moment in (8, 31):
        wipe(postgres)
        assert interleaved(tmp_path / str(moment), "run", others, moment, postgres)
        assert found(tmp_path / str(moment)) == expected
