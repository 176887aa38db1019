"""Campaigns at the extremes, from the first proposal to the fit, as a user drives them."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from commands import call

pytestmark = pytest.mark.usefixtures("few_draws")

HEAD = '[campaign]\nname = "extreme"\nseed = 3\nbatch = {batch}\n'
APPLICATION = '[[application]]\nname = "score"\nutility = "measured"\n'


def numeric(k: int) -> str:
    return "".join(f'[[factor]]\nname = "x{i}"\nlow = -1.0\nhigh = 1.0\n' for i in range(k))


def make(folder: Path, factors: str, stop: str, more: str = "", batch: int = 4) -> Path:
    folder.mkdir()
    text = HEAD.format(batch=batch) + factors + APPLICATION + more + f"[stop]\n{stop}\n"
    (folder / "campaign.toml").write_text(text, encoding="utf-8")
    return folder


def fly(folder: Path, score: Callable[[dict, int], float], rounds: int, *options: object) -> list[dict]:
    """Propose, fill the form in, ingest, again; all rows flown."""
    flown: list[dict] = []
    for number in range(rounds):
        form = folder / f"form{number}.csv"
        call("propose", folder, "--source", "flight", "--csv", form, *options)
        with form.open(encoding="utf-8-sig", newline="") as stream:
            rows = list(csv.DictReader(stream))
        for row in rows:
            row["score"] = score({name.split(" ")[0]: value for name, value in row.items()}, len(flown))
            flown.append(row)
        with form.open("w", encoding="utf-8", newline="") as stream:
            writer = csv.DictWriter(stream, list(rows[0]))
            writer.writeheader()
            writer.writerows(rows)
        call("ingest", folder, form, "--accept")
    return flown


def noise(number: int) -> float:
    return float(np.random.default_rng([5, number]).normal())


def bowl(row: dict, number: int) -> float:
    return 80.0 - 10.0 * sum((float(v) - 0.2) ** 2 for k, v in row.items() if k.startswith("x")) + noise(number)


def fitted(folder: Path) -> dict:
    found = json.loads(call("fit", folder, "--json").stdout)
    call("status", folder)
    return found


def test_a_budget_below_the_terms_is_refused(tmp_path) -> None:
    folder = make(tmp_path / "c", numeric(4), "half_width = 2.0\nmax_runs = 10")
    for command, key in (("check", "[stop]"), ("propose", "max_runs")):
        message = call(command, folder, code=2).stderr
        assert line_of(folder, key) in message
        assert "10 runs cannot determine 15 terms" in message
        assert "max_runs" in message


def test_equal_scores_everywhere(tmp_path) -> None:
    """Rounding would give the terms signs, and a place to an optimum that is nowhere."""
    folder = make(tmp_path / "c", numeric(2), "half_width = 1.0")
    fly(folder, lambda row, number: 0.1, 2)
    found = fitted(folder)
    assert [term["coded"]["estimate"] for term in found["terms"]] == [0.1, 0.0, 0.0, 0.0, 0.0, 0.0]
    assert found["optimum"]["mean"] == 0.1
    assert found["s"] == 0.0
    assert any("All scores are equal" in text for text in found["warnings"])
    assert any("every setting is equally good" in text for text in found["warnings"])
    assert any("no factor has an effect" in text for text in found["stop"]["reasons"])
    assert found["optimum"]["at_bound"] == []
    for place in found["posterior"]["optimum"]["settings"].values():
        assert place["high"] - place["low"] > 1.8
        assert place["p_at_bound"] == 0.0
    assert "The fitted surface is flat" in call("fit", folder).stdout


def test_one_wild_score(tmp_path) -> None:
    """400 standard deviations off, in the start design: Student-t errors recover at every look and in the fit."""
    folder = make(tmp_path / "c", numeric(2), "half_width = 3.0", '[model]\nerrors = "student_t"\n')
    flown = fly(folder, lambda row, number: 500.0 if number == 3 else bowl(row, number), 4)
    found = fitted(folder)
    told = " ".join(call("fit", folder).stdout.split())
    assert "a run far from the surface counts for less here" in told
    assert f"counted for less than a quarter of a score on it: run {flown[3]['run_id']}." in told
    assert "No run is an outlier" not in told
    assert found["optimum"]["settings"]["x0"] == pytest.approx(0.2, abs=0.3)
    assert found["optimum"]["prediction"]["half_width"] < 6.0
    assert found["optimum"]["mean"] == pytest.approx(80.0, abs=2.0)


def test_categories_only_end_by_the_rule(tmp_path) -> None:
    """As many settings as terms: repeats are pure error all the same, and there is no lack of fit to test."""
    factors = '[[factor]]\nname = "q"\nlevels = ["A", "B", "C"]\n[[factor]]\nname = "p"\nlevels = ["HH", "VV"]\n'
    folder = make(tmp_path / "c", factors + "[cost]\nflight = 20.0\n", "half_width = 4.0\nmax_runs = 60")
    settings = [(q, p) for q in "ABC" for p in ("HH", "VV")] * 6
    rows = (f"{q},{p},{50.0 + 5.0 * (q == 'B') + 3.0 * (p == 'VV') + noise(i)}" for i, (q, p) in enumerate(settings))
    (folder / "s.csv").write_text("\n".join(["q,p,score", *rows]), encoding="utf-8")
    call("ingest", folder, folder / "s.csv", "--accept")
    found = fitted(folder)
    assert found["optimum"]["settings"] == {"q": "B", "p": "VV"}
    assert found["stop"]["held"], found["stop"]["reasons"]
    assert found["df_residual"] == found["n_runs"] - 6
    rehearsed = json.loads(call("rehearse", folder, "--campaigns", 10, "--json").stdout)
    assert rehearsed["numbers"]["stopped"] == 1.0
    assert rehearsed["numbers"]["cost_median"] == pytest.approx(20.0 * rehearsed["numbers"]["runs_median"], abs=10.0)


def test_without_scatter_there_is_no_half_width_to_tell_and_nothing_to_rehearse(tmp_path) -> None:
    """Told were half-widths of "± -", and intervals of rehearsed campaigns that cover nothing."""
    folder = make(tmp_path / "c", numeric(2), "half_width = 1.0")
    fly(folder, lambda row, number: 0.1, 1)
    said = call("status", folder).output
    assert "prediction interval of one future run: none yet, target ± 1" in said
    assert "± -" not in said
    refused = call("rehearse", folder, "--campaigns", 10, code=2)
    assert "the scores do not scatter" in refused.output


@pytest.mark.parametrize("effect", ["fixed", "random"])
def test_a_new_flight_day_is_tied_to_the_earlier_ones(tmp_path, effect) -> None:
    """Its effect is known about as well as its runs can tell it; of random days the second can be proposed, too."""
    model = f'[model]\nblock = "block"\nblock_effect = "{effect}"\n'
    folder = make(tmp_path / "c", numeric(2), "half_width = 3.0", model)
    days: list[list[dict]] = []

    def score(row: dict, number: int) -> float:
        row["block"] = f"day {len(days)}"
        return bowl(row, number) + 3.0 * len(days)

    for size in (12, 4, 8):
        form = folder / f"day{len(days)}.csv"
        call("propose", folder, "--source", "flight", "--csv", form, "-n", size)
        with form.open(encoding="utf-8-sig", newline="") as stream:
            rows = list(csv.DictReader(stream))
        for number, row in enumerate(rows):
            named = {name.split(" ")[0]: value for name, value in row.items()}
            row["score"] = score(named, 20 * len(days) + number)
            row["block"] = named["block"]
        with form.open("w", encoding="utf-8", newline="") as stream:
            writer = csv.DictWriter(stream, list(rows[0]))
            writer.writeheader()
            writer.writerows(rows)
        call("ingest", folder, form)
        days.append(rows)
    x, y = np.array([[float(row["x0"]), float(row["x1"])] for rows in days for row in rows]).T
    of_days = np.repeat(np.eye(3), [12, 4, 8], axis=0)[:, 1:]
    Z = np.column_stack([np.ones(24), x, y, x * y, x**2, y**2, of_days])
    of_effects = np.diag(np.linalg.inv(Z.T @ Z))[-2:]  # in units of a run's variance: 1/4 and 1/8 were all else known
    assert of_effects[0] < 0.6
    assert of_effects[1] < 0.4
    assert fitted(folder)["n_runs"] == 24


KIND = '[[factor]]\nname = "kind"\nlevels = ["a", "b"]\n'


def edited(folder: Path, old: str, new: str) -> None:
    file = folder / "campaign.toml"
    text = file.read_text(encoding="utf-8")
    assert old in text
    file.write_text(text.replace(old, new), encoding="utf-8")


def line_of(folder: Path, text: str) -> str:
    """File and line of ``campaign.toml`` on which a text stands, as errors name them."""
    lines = (folder / "campaign.toml").read_text(encoding="utf-8").splitlines()
    return f"campaign.toml:{1 + next(k for k, line in enumerate(lines) if text in line)}: "


def test_a_level_added_later_gets_the_runs_that_it_needs(tmp_path) -> None:
    """No fit knows the new level; the next runs proposed are those that tell it, and the campaign goes on."""
    folder = make(tmp_path / "c", numeric(2) + KIND, "half_width = 1\nmax_runs = 40")
    fly(folder, bowl, 2)
    edited(folder, '"b"]', '"b", "c"]')
    assert "no run has a score yet at kind c" in call("fit", folder, code=2).output
    (folder / "form0.csv").unlink()
    assert [row["kind"] for row in fly(folder, bowl, 1)] == ["c"] * 3  # its constant and its two slopes
    assert json.loads(call("fit", folder, "--json").stdout)["n_terms"] == 12
    call("propose", folder)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('name = "x1"', 'name = "height"', "height: runs 1, 2, 3, 4, 5, 6, 7, 8, ...: a factor has no value"),
        ('["a", "b"]', '["a", "d"]', "unknown level (got 'b')"),
    ],
)
def test_a_renamed_factor_or_level_names_the_runs(tmp_path, old, new, says) -> None:
    folder = make(tmp_path / "c", numeric(2) + KIND, "half_width = 1\nmax_runs = 40")
    fly(folder, bowl, 1)
    edited(folder, old, new)
    for command in ("fit", "propose", "status"):
        told = call(command, folder, code=2).output
        assert says in told
        assert "restore the factor, or void these runs" in told
        assert told.count("error:") == 1


def test_a_scale_that_runs_have_no_place_on_names_them(tmp_path) -> None:
    """The remedy was to restore a name."""
    folder = make(tmp_path / "c", numeric(2), "half_width = 1\nmax_runs = 40")
    fly(folder, bowl, 1)
    edited(folder, 'name = "x1"\nlow = -1.0\nhigh = 1.0', 'name = "x1"\nlow = 0.5\nhigh = 1.0\nscale = "log"')
    for command in ("fit", "propose", "status"):
        told = call(command, folder, code=2).output
        assert "x1: runs " in told
        assert "a logarithmic factor takes positive values only (got -1.0). campaign.toml was changed since: " in told
        assert "restore the factor, or void these runs" in told


def test_runs_from_before_a_new_factor_are_kept_by_way_of_an_export(tmp_path) -> None:
    """They held it fixed: once that is filled in, only runs that tell the new factor are missing."""
    folder = make(tmp_path / "c", numeric(2), "half_width = 1\nmax_runs = 40")
    flown = fly(folder, bowl, 1)
    edited(folder, APPLICATION, '[[factor]]\nname = "x2"\nlow = -1.0\nhigh = 1.0\n' + APPLICATION)
    told = call("fit", folder, code=2).output
    assert "x2: runs 1, 2, 3, 4, 5, 6, 7, 8, ...: a factor has no value" in told
    assert "If the factor is new, ingest them again as exported, with its value filled in." in told
    call("void", folder, *range(1, len(flown) + 1), "--why", "x2 was 0.5")
    call("export", folder, folder / "all.csv")
    with (folder / "all.csv").open(encoding="utf-8-sig", newline="") as stream:
        rows = [row | {"x2": "0.5"} for row in csv.DictReader(stream)]
    with (folder / "all.csv").open("w", encoding="utf-8", newline="") as stream:
        writer = csv.DictWriter(stream, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    call("ingest", folder, folder / "all.csv", "--accept")
    (folder / "form0.csv").unlink()
    assert len(fly(folder, bowl, 1)) < 5
    found = fitted(folder)
    assert found["n_runs"] < len(flown) + 5
    assert found["n_terms"] == 10


def test_a_factor_that_is_left_out_is_told_where_runs_differ_in_it(tmp_path) -> None:
    """Its effect is scatter from then on, which no other line of the results would say."""
    folder = make(tmp_path / "c", numeric(2) + KIND, "half_width = 1\nmax_runs = 40")
    flown = fly(folder, bowl, 2)
    assert not any("no longer a factor" in told for told in fitted(folder)["warnings"])
    edited(folder, KIND, "")
    said = "The runs differ in kind, which is no longer a factor: a, b. What it does to the score counts as scatter."
    assert sorted(fitted(folder)["warnings"])[-1] == said
    assert said in " ".join(call("fit", folder).output.split())
    call("void", folder, *(row["run_id"] for row in flown if row["kind"] == "b"), "--why", "another kind")
    assert not any("no longer a factor" in told for told in fitted(folder)["warnings"])  # the others are alike in it


def test_the_start_design_of_a_new_application_is_of_its_own_scores(tmp_path) -> None:
    """Runs that it has no score of tell nothing of it: beside them two runs seemed to do, one batch after another."""
    folder = make(tmp_path / "c", numeric(2) + KIND, "half_width = 1\nmax_runs = 80")
    fly(folder, bowl, 2)
    (folder / "form0.csv").unlink()
    edited(folder, APPLICATION, APPLICATION + APPLICATION.replace('"score"', '"late"'))
    assert "those of other applications may be scored for it, too" in call("status", folder).output
    fly(folder, bowl, 1, "-n", 2)
    assert [one["application"] for one in fitted(folder)["applications"]] == ["score", "late"]


def test_a_region_that_no_run_lies_in_is_reported(tmp_path) -> None:
    """Narrowed between the runs, by a range or a constraint; figures without a run were divided by their number."""
    folder = make(tmp_path / "c", numeric(2), "half_width = 1\nmax_runs = 40")
    fly(folder, bowl, 2)
    edited(folder, 'name = "x0"\nlow = -1.0\nhigh = 1.0', 'name = "x0"\nlow = 0.61\nhigh = 0.64')
    edited(folder, APPLICATION, '[[constraint]]\nexpr = "x1 >= -0.4 and x1 <= -0.35"\n' + APPLICATION)
    assert 0.61 <= fitted(folder)["optimum"]["settings"]["x0"] <= 0.64
    call("report", folder, "--html", folder / "r.html")
    assert "Runs outside the region" in (folder / "r.html").read_text(encoding="utf-8")
    edited(folder, "high = 0.64", "high = 0.6100064")
    for command in ("fit", "status", "propose"):
        told = " ".join(call(command, folder, code=2).output.split())
        far = "range: scored runs lie more than a hundred times the width of the range of 'x0' outside it (got [0.61,"
        assert line_of(folder, "[[factor]]") + far in told


def test_another_unit_of_a_factor_is_refused_once_there_are_runs(tmp_path) -> None:
    """The store holds numbers: 600 m would be taken for 600 km."""
    height = '[[factor]]\nname = "height"\nunit = "m"\nlow = 600\nhigh = 6000\nscale = "log"\n'
    folder = make(tmp_path / "c", height, "half_width = 1\nmax_runs = 40")
    rows = fly(folder, lambda row, n: 80.0 - (float(row["height"]) / 1000.0 - 3.0) ** 2 + noise(n), 2)
    edited(folder, 'unit = "m"\nlow = 600\nhigh = 6000', 'unit = "km"\nlow = 0.6\nhigh = 6')
    new = folder / "new.csv"
    new.write_text("height [km],score\n3.3,79\n", encoding="utf-8")
    for command in (["fit", folder], ["propose", folder], ["status", folder], ["ingest", folder, new, "--accept"]):
        told = " ".join(call(*command, code=2).output.split())
        none = f"unit: 0 of {len(rows)} scored runs lie in the range of 'height', and {len(rows)} would"
        assert line_of(folder, 'unit = "km"') + none in told
        assert "if their settings were in m (got 'km')" in told
    edited(folder, 'unit = "km"\nlow = 0.6\nhigh = 6', 'unit = "ft"\nlow = 2000\nhigh = 20000')
    told = " ".join(call("fit", folder, code=2).output.split())
    assert f"and {len(rows)} would if their settings were in m (got 'ft')" in told
    edited(folder, 'unit = "ft"\nlow = 2000\nhigh = 20000', 'unit = "m"\nlow = 100\nhigh = 500')
    assert f"Runs outside the region, included in the fit: {len(rows)}" in call("fit", folder).output  # as wanted


def test_status_warns_of_what_fit_warns_of(tmp_path) -> None:
    """An outlier is not seen in an interval, and `fit` alone told it."""
    folder = make(tmp_path / "c", numeric(2), "half_width = 1\nmax_runs = 40")
    fly(folder, bowl, 2)
    assert "Warning" not in call("status", folder).output
    wild = folder / "wild.csv"
    wild.write_text("x0,x1,score\n0.2,0.2,5\n", encoding="utf-8")
    call("ingest", folder, wild, "--accept")
    told = fitted(folder)["warnings"]
    (one,) = json.loads(call("status", folder, "--json").stdout)["applications"]
    assert one["warnings"] == told
    assert re.search(r"Warning: Run \d+ is unusual.*: .*outlier", " ".join(call("status", folder).output.split()))


def test_each_application_has_its_own_target(tmp_path) -> None:
    """Two applications with the same scores, of which one asks for less."""
    wide = 'half_width = 50\n[[application]]\nname = "other"\nutility = "measured"\nunit = "m3/m3"\nhalf_width = 0.5\n'
    folder = make(tmp_path / "c", numeric(1), "half_width = 1\nmax_runs = 40", wide)
    fly(folder, bowl, 2, "-n", 12)
    found = json.loads(call("status", folder, "--json").stdout)["applications"]
    assert [one["target_half_width"] for one in found] == [50.0, 0.5]
    assert [one["last_look"]["held"] for one in found] == [True, False]
    told = call("status", folder).output.replace("\N{NO-BREAK SPACE}", " ")
    assert "target \u00b1 0.5 m3/m3" in told
    told = call("fit", folder).output.replace("\N{NO-BREAK SPACE}", " ")
    assert ["losing more than 12.5:" in told, "losing more than 0.125 m3/m3:" in told] == [True, True]  # a quarter
    edited(folder, "half_width = 0.5\n", "half_width = 0.5\nloss = 0.2\n")
    told = call("fit", folder).output.replace("\N{NO-BREAK SPACE}", " ")
    assert ["losing more than 12.5:" in told, "losing more than 0.2 m3/m3:" in told] == [True, True]  # its own target


def test_a_renamed_application_is_told(tmp_path) -> None:
    folder = make(tmp_path / "c", numeric(2), "half_width = 1\nmax_runs = 40")
    fly(folder, bowl, 1)
    before = json.loads(call("status", folder, "--json").stdout)["runs"]
    edited(folder, 'name = "score"', 'name = "yield"')
    for command, code in (("fit", 2), ("propose", 2), ("check", 2), ("status", 0)):
        told = " ".join(call(command, folder, code=code).output.split())
        none = "application: no run has a score of 'yield'; runs have scores of 'score'. Restore the name"
        assert line_of(folder, "[[application]]") + none in told
    assert json.loads(call("status", folder, "--json").stdout)["runs"] == before


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("weights", ["equal", "se", "counts"])
@pytest.mark.parametrize("response", ["identity", "logit"])
def test_without_scores_a_fit_says_how_many_are_missing(tmp_path: Path, weights: str, response: str) -> None:
    """And nothing of a mean of an empty slice."""
    model = f'[model]\nweights = "{weights}"\nresponse = "{response}"\n'
    folder = make(tmp_path / "none", numeric(2), "half_width = 5.0", model)
    text = (folder / "campaign.toml").read_text(encoding="utf-8").replace('"measured"', '"percent_correct"')
    (folder / "campaign.toml").write_text(text, encoding="utf-8")
    assert "0 scored runs cannot determine 6 terms" in call("fit", folder, code=2).output


def test_an_application_without_scores_is_named(tmp_path) -> None:
    """Told was that no scored run determines the terms, and to fly "beside the blocks", where there are none."""
    other = '[[application]]\nname = "other"\nutility = "measured"\n'
    folder = make(tmp_path / "c", numeric(2), "half_width = 1.0", other)
    rows = [f"{a},{b},score,{a + b + 0.1 * a * b}" for a in (-1, 0, 1) for b in (-1, 0, 1)]
    (folder / "s.csv").write_text("\n".join(["x0,x1,application,score", *rows, *rows]), encoding="utf-8")
    call("ingest", folder, folder / "s.csv", "--accept")
    refused = call("fit", folder, code=2)
    assert "application 'other': 0 scored runs cannot determine 6 terms. `seqrsm propose` names" in refused.stderr
    told = call("propose", folder, "--source", "flight", "-n", 2).output
    assert "initial design: 12 runs for a model of 6 terms" in told
