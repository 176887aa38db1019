"""`seqrsm design`: every option, checked on the points it gives, and what it says to mistakes."""

from __future__ import annotations

import csv
import json
import re
from functools import partial

import commands
import numpy as np
import pytest

call = partial(commands.call, "design")


def made(*arguments: object) -> dict:
    return json.loads(call(*arguments, "--json").stdout)


def quadratic(points) -> np.ndarray:
    x = np.asarray(points)
    k = x.shape[1]
    return np.column_stack([np.ones(len(x)), x, *(x[:, i] * x[:, j] for i in range(k) for j in range(i, k))])


def test_efficiencies_are_those_of_the_points() -> None:
    found = made("--factors", 2, "--runs", 9, "--criterion", "d")
    Z = quadratic(found["points"])
    assert found["d_value"] == pytest.approx(np.linalg.det(Z.T @ Z) ** (1 / 6) / 9)
    assert found["d_efficiency"] == pytest.approx(found["d_value"] / 0.4745937662, rel=1e-6)
    assert len(found["fraction_of_design_space"]) == 101
    assert sum(found["leverage"]) == pytest.approx(6.0)


@pytest.mark.parametrize("criterion", ["I", "A"])
def test_each_criterion_is_better_at_its_own(criterion) -> None:
    own, other = (made("--factors", 1, "--runs", 7, "--criterion", c) for c in (criterion, "D"))
    key = f"{criterion.lower()}_value"
    assert own[key] < other[key] * (1.0 + 1e-9)


def test_factors_of_every_kind_and_a_constraint(tmp_path) -> None:
    out = tmp_path / "d.csv"
    found = made(
        "--factor", "f=1:16:log", "--factor", "looks=1,2,4", "--factor", "pol=HH,HV", "--constraint", "looks <= f",
        "--runs", 18, "--csv", out,
    )  # fmt: skip
    with out.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["pol"] for row in rows] == [settings["pol"] for settings in found["settings"]]
    assert all(float(row["looks"]) <= float(row["f"]) * (1 + 1e-9) and row["looks"] in "1.0 2.0 4.0" for row in rows)
    # f is coded on its logarithm
    for point, settings in zip(found["points"], found["settings"], strict=True):
        assert settings["f"] == pytest.approx(4.0 * 4.0 ** point[0])


def test_random_order_keeps_the_design(tmp_path) -> None:
    """The same runs in other places, by the seed; the file has the rows of the screen."""
    plain = made("--factors", 2, "--runs", 9)
    mixed = made("--factors", 2, "--runs", 9, "--random-order", "--csv", tmp_path / "runs.csv")
    assert (plain["run_order"], mixed["run_order"]) == ("standard", "random")
    assert sorted(plain["points"]) == sorted(mixed["points"])
    assert plain["points"] != mixed["points"]
    assert mixed["d_value"] == pytest.approx(plain["d_value"], rel=1e-12)
    with (tmp_path / "runs.csv").open(encoding="utf-8") as stream:
        assert [[float(cell) for cell in row] for row in list(csv.reader(stream))[1:]] == mixed["points"]
    made("--factors", 3, "--runs", 13, "--csv", tmp_path / "steps.csv")
    cells = (tmp_path / "steps.csv").read_text(encoding="utf-8").replace("\n", ",").split(",")
    assert max(len(cell) for cell in cells) <= len("-0.0123456789012")  # no dust such as 0.6000000000000001
    assert made("--factors", 2, "--runs", 9, "--random-order", "--seed", 4)["points"] != mixed["points"]


def test_words(tmp_path) -> None:
    text = call("--factors", 2, "--runs", 8).stdout
    assert re.search(r"^D-efficiency against the best continuous design +0\.9612$", text, re.M)  # 0.961154 in JSON
    assert "_" not in text
    assert "of the region" in text
    call("--factors", 2, "--runs", 8, "--csv", tmp_path / "no" / "d.csv", code=2)


def test_a_file_that_is_there_stays(tmp_path) -> None:
    (tmp_path / "d.csv").write_text("mine")
    told = call("--factors", 2, "--runs", 8, "--csv", tmp_path / "d.csv", code=2).stderr
    assert "d.csv: the file exists already" in told
    assert (tmp_path / "d.csv").read_text() == "mine"


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ((), "--runs"),
        (("--runs", 9), "--factors"),
        (("--factors", 2), "--runs"),
        (("--factors", 2, "--factor", "a=1:2", "--runs", 9), "--factors"),
        (("--factor", "a", "--runs", 9), "NAME=LOW:HIGH"),
        (("--factor", "a=1:x", "--runs", 9), "a=1:x"),
        (("--factor", "a=0:1:log", "--runs", 9), "log"),
        (("--factor", "a=1:2", "--factor", "a=1:3", "--runs", 9), "a"),
        (("--factors", 2, "--runs", 9, "--criterion", "G"), "D, I, A"),
        (("--factors", 2, "--runs", 9, "--constraint", "x1 > 0.5", "--constraint", "x1 < -0.5"), "x1 < -0.5"),
        (("--factors", 2, "--runs", 9, "--constraint", "x1 <"), "constraint"),
        (("--factors", 2, "--runs", 9, "--constraint", "y > 0"), "y"),
        (("--factors", 2, "--runs", 5), "6"),
        (("--factors", 2, "--runs", 100000), "less than or equal to 1000"),
        (("--factors", 2, "--runs", 8, "--constraint", "abs(x1 - x2) <= 0.0009"), "so thin"),
    ],
)  # fmt: skip
def test_mistakes_are_named(options, named) -> None:
    message = call(*options, code=2).stderr
    assert named in message
    assert "Traceback" not in message


def test_the_centre_leaves_runs_to_choose() -> None:
    for centre in (3, 9):
        assert "--centre" in call("--factors", 1, "--runs", 3, "--centre", centre, code=2).stderr
