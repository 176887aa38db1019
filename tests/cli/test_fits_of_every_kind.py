"""What holds of a fit whatever its errors, blocks, weights and sources are: its document, its intervals, its words."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from measured_campaign import FREQUENCY, HEAD, MEASURED, PERCENT, POL, STOP, X, counted, days, make, quadratic
from typer.testing import CliRunner

from seqrsm.analysis.ground import Ground
from seqrsm.analysis.results import Analysis
from seqrsm.analysis.to_json import analysis_to_json
from seqrsm.campaign.campaign import Campaign
from seqrsm.cli.app import app
from seqrsm.cli.blocks import show_sections
from seqrsm.report.sections.model import _block_text, _statistics_table
from seqrsm.report.sections.optimum import optimum_section
from seqrsm.report.sections.shape import shape_section
from seqrsm.report.sections.summary import _key_figures
from seqrsm.spec.tables import StopSpec

Rows = list[dict]
NUMBER = re.compile(r"-?\d+(?:\.\d+)?")
QUADRATIC = quadratic()
BLOCKED, _ = days(24, 2.0, 2)
FLOWN = [
    row | {"source": "flight", "score": row["score"] + 2.0} if i % 3 == 1 else row | {"source": "simulation"}
    for i, row in enumerate(quadratic(24, 1))
]
KINDS: dict[str, tuple[str, Rows, str, str]] = {
    "plain": (X + FREQUENCY, QUADRATIC, "", MEASURED),
    "category": (X + POL, [row | {"pol": ("HH", "VV")[i % 2]} for i, row in enumerate(QUADRATIC)], "", MEASURED),
    "logit": (X + FREQUENCY, QUADRATIC, '[model]\nresponse = "logit"\n', PERCENT),
    "errors": (X, [row | {"se": 1 + i % 3} for i, row in enumerate(QUADRATIC)], '[model]\nweights = "se"\n', MEASURED),
    "student": (X + FREQUENCY, QUADRATIC, '[model]\nerrors = "student_t"\n', MEASURED),
    "days": (X + FREQUENCY, BLOCKED, '[model]\nblock = "block"\n', MEASURED),
    "random days": (X + FREQUENCY, BLOCKED, '[model]\nblock = "block"\nblock_effect = "random"\n', MEASURED),
    "flights": (X + FREQUENCY, FLOWN, "", MEASURED),
    "days of flights": (
        X + FREQUENCY,
        [row | {"block": f"d{i % 4}"} for i, row in enumerate(FLOWN)],
        '[model]\nblock = "block"\n',
        MEASURED,
    ),
    "wild flights": (X + FREQUENCY, FLOWN, '[model]\nerrors = "student_t"\n', MEASURED),
    "counts": (X, counted(), '[model]\nweights = "counts"\n', PERCENT),
    "scattered counts": (X, counted(), '[model]\nresponse = "logit"\nerrors = "beta_binomial"\n', PERCENT),
}


def analysed(folder: Path, factors: str, rows: Rows, model: str, application: str) -> Analysis:
    (analysis,) = Campaign.open(make(folder, factors, rows, model, application)).analyse_all()
    return analysis


@pytest.fixture(scope="module", params=KINDS)
def kind(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture(scope="module")
def analysis(kind: str, tmp_path_factory: pytest.TempPathFactory) -> Analysis:
    return analysed(tmp_path_factory.mktemp("kind") / "c", *KINDS[kind])


@pytest.fixture(scope="module")
def document(analysis: Analysis) -> dict:
    return analysis_to_json(analysis)


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> dict:
    return analysis_to_json(analysed(tmp_path_factory.mktemp("plain") / "c", *KINDS["plain"]))


def keys(document: dict) -> dict[str, set[str]]:
    """Keys of a document and of the tables in it that are there for every kind of fit."""
    tables = ("optimum", "posterior", "stop", "diagnostics")
    lists = ("terms", "anova", "factors_importance")
    return (
        {"": set(document), "in the posterior": set(document["posterior"]["optimum"])}
        | {name: set(document[name]) for name in tables}
        | {name: set(document[name][0]) for name in lists}
    )


def test_the_document_has_the_keys_of_every_other(kind: str, document: dict, plain: dict) -> None:
    found, (_, rows, _, _) = document, KINDS[kind]
    assert keys(found) == keys(plain)
    assert found["n_runs"] == len(rows) == len(found["diagnostics"]["runs"])
    assert found["n_terms"] == len(found["terms"]) == found["n_runs"] - found["df_residual"]
    names = [term["name"] for term in found["terms"]]
    of_surface = [term["name"] for term in found["posterior"]["terms"]]
    assert names[: len(of_surface)] == of_surface
    assert all(name.startswith("block[") for name in names[len(of_surface) :])  # known to the fit, not to the surface
    sources = found["sources"]
    assert (sources is None) == ("flights" not in kind)
    assert sources is None or (sources["n_flights"], sources["n_simulations"]) == (8, 16)


def test_the_mean_is_known_best_then_that_of_runs_then_one_run(kind: str, document: dict) -> None:
    best, stop, drawn = document["optimum"], document["stop"], document["posterior"]["optimum"]
    outer = (0.0, 100.0) if KINDS[kind][3] == PERCENT else (-np.inf, np.inf)
    inner = (best["mean"], best["mean"])
    for name in ("confidence", "prediction_mean", "prediction"):
        low, high = best[name]["low"], best[name]["high"]
        assert outer[0] <= low < inner[0]
        assert inner[1] < high <= outer[1]
        assert best[name]["half_width"] == pytest.approx(0.5 * (high - low))
        inner = (low, high)
    assert stop["noise_floor"] <= stop["attainable_half_width"] <= stop["half_width"]
    assert stop["half_width"] == pytest.approx(best["prediction"]["half_width"], rel=1e-12)
    assert drawn["credible"]["low"] < drawn["mean"] < drawn["credible"]["high"]


def test_the_rule_may_watch_the_interval_of_the_mean(kind: str, document: dict, tmp_path: Path) -> None:
    """No end of future runs is the mean; on days that are a sample it is still that of the average day."""
    folder = make(tmp_path / "c", *KINDS[kind])
    file = folder / "campaign.toml"
    file.write_text(file.read_text(encoding="utf-8") + 'interval = "confidence"\n', encoding="utf-8")  # of [stop]
    (analysis,) = Campaign.open(folder).analyse_all()
    best, known = analysis.optimum, document["optimum"]
    assert best.mean == known["mean"]
    assert best.whole == best.by_chance == best.confidence
    assert analysis.decision.half_width == pytest.approx(known["confidence"]["half_width"], rel=0.1)  # of other draws


@pytest.mark.parametrize("errors", ["normal", "student_t", "beta_binomial"])
def test_a_prior_far_from_the_scores_leaves_the_mean_in_its_interval(errors: str, tmp_path: Path) -> None:
    """Both rest on the scores alone."""
    factors, rows, model, application = KINDS["scattered counts" if errors == "beta_binomial" else "student"]
    prior = "[application.prior]\nutility = [1, 20]\nrepeat_sd = 1.0\nrepeat_runs = 200\n"
    folder = make(tmp_path / "c", factors, rows[:9], model.replace("student_t", errors), application + prior)
    (analysis,) = Campaign.open(folder).analyse_all()
    best = analysis.optimum
    assert best.confidence.low < best.mean < best.confidence.high


def test_a_stationary_point_far_away_has_no_settings(analysis: Analysis, capsys) -> None:
    """A logarithmic factor reads 0.0 GHz there."""
    numeric = analysis.region.numeric
    assert analysis.stationary is not None
    point = analysis.stationary.point.copy()
    point[list(numeric)] = -50.0
    at_the_end = {**analysis.fitted.region.decode([np.where(np.isfinite(point), -1.0, point)])[0]}
    moved = replace(analysis.stationary, kind="saddle", point=point)
    show_sections([shape_section(replace(analysis, stationary=moved), "")])
    told = " ".join(capsys.readouterr().out.replace("\N{NO-BREAK SPACE}", " ").split())
    for index in numeric:
        name = analysis.region.names[index]
        assert f"{name.replace('_', ' ')} far below {at_the_end[name]:.3g}" in told


def test_the_terminal_tells_the_numbers_of_the_document(analysis: Analysis, document: dict, capsys) -> None:
    show_sections([optimum_section(analysis, "", StopSpec(half_width=5.0))])
    told = capsys.readouterr().out.replace("\N{NO-BREAK SPACE}", " ").replace("\N{MINUS SIGN}", "-")
    best = document["optimum"]

    def agree(pattern: str, *values: float) -> None:
        (line,) = re.findall(rf"^ *{pattern} +(.*)$", told, flags=re.MULTILINE)
        numbers = NUMBER.findall(line)
        assert len(numbers) == len(values)
        for number, value in zip(numbers, values, strict=True):
            assert float(number) == pytest.approx(value, abs=0.501 * 10.0 ** -len(number.partition(".")[2]))

    def interval(name: str) -> tuple[float, float, float]:
        return best[name]["low"], best[name]["high"], best[name]["half_width"]

    agree("One future run", *interval("prediction"))
    agree("Mean of 5 future runs", *interval("prediction_mean"))
    agree("Mean score", *interval("confidence"))


@pytest.mark.parametrize("kind", [kind for kind, campaign in KINDS.items() if campaign[3] == MEASURED], indirect=True)
def test_the_least_of_scores_turned_over_and_doubled_in_another_order_is_the_same_twice(
    kind: str, document: dict, tmp_path: Path
) -> None:
    factors, rows, model, _ = KINDS[kind]
    order = np.random.default_rng(1).permutation(len(rows))
    turned = [rows[i] | {"score": -2.0 * rows[i]["score"]} for i in order]
    found = analysis_to_json(analysed(tmp_path / "c", factors, turned, model, MEASURED + 'goal = "minimize"\n'))
    one, other = document["optimum"], found["optimum"]
    # The draws of a process that meet other roundings may part from their twins: settings then differ a little.
    weighed = not document["departure"]["reason"]
    assert other["coded"] == pytest.approx(one["coded"], abs=0.02 if weighed else 1e-6)
    assert other["mean"] == pytest.approx(-2.0 * one["mean"], rel=1e-3 if weighed else 1e-7)
    # By a sampler, whose draws depend on the order; that of a process on its rounding only.
    drawn = 0.2 if "student_t" in model else 1e-6 if document["departure"]["reason"] else 1e-2
    for name in ("confidence", "prediction", "prediction_mean"):
        expected = np.array([one[name]["low"], one[name]["high"]])
        turned_back = np.array([other[name]["high"], other[name]["low"]]) / -2.0
        np.testing.assert_allclose(turned_back, expected, atol=drawn * one[name]["half_width"], rtol=0.0)
    for name in ("half_width", "noise_floor", "attainable_half_width"):
        assert found["stop"][name] == pytest.approx(2.0 * document["stop"][name], rel=drawn)
    importance = ([row["f"] for row in table["factors_importance"]] for table in (found, document))
    np.testing.assert_allclose(*importance, rtol=1e-6)


def test_random_days_are_no_terms_and_the_coefficients_say_what_they_are(tmp_path: Path) -> None:
    campaign = Campaign.open(make(tmp_path / "c", *KINDS["random days"]))
    (found,) = campaign.analyse_all(thorough=True)
    assert found.blocks is not None
    (terms,) = (one.detail for one in _key_figures(campaign.spec, found).items if one.label == "Runs in the fit")
    assert terms.startswith("6 terms")  # as in the reasons of the decision
    assert any("for 6 terms" in check["text"] for check in analysis_to_json(found)["stop"]["checks"])
    assert "are those of fixed blocks" in _block_text(found.blocks, "")
    # The table of least squares has more, and says of what.
    told = {row[0].text: row[1].text for row in _statistics_table(found).rows}
    assert told["Terms p, blocks included"] == str(len(analysis_to_json(found)["terms"])) != "6"


@pytest.mark.parametrize(
    ("more", "model"),
    [
        ({"block": "d"}, '[model]\nblock = "block"\n'),
        ({"block": "d"}, '[model]\nblock = "block"\nblock_effect = "random"\n'),
        ({"source": "simulation"}, ""),
        ({"source": "flight"}, "[model]\ndiscrepancy_sd = 3.0\n"),
        ({"se": 2.0}, '[model]\nweights = "se"\n'),
    ],
    ids=["one day", "one random day", "one source", "flights alone", "equal errors"],
)
def test_a_kind_that_has_nothing_to_tell_apart_is_the_plain_fit(
    plain: dict, more: dict, model: str, tmp_path: Path
) -> None:
    """Every number, to the bit; only what is warned of may differ, and one of random days is too few to stop."""
    rows = [row | more for row in QUADRATIC]
    found = analysis_to_json(analysed(tmp_path / "c", X + FREQUENCY, rows, model, MEASURED))
    too_few = {"stop"} if "random" in model else set()
    for name in sorted(plain.keys() - {"notes", "warnings"} - too_few):
        np.testing.assert_equal(found[name], plain[name], err_msg=name)
    if too_few:
        assert (plain["stop"]["held"], found["stop"]["held"]) == (True, False)
        assert [one["name"] for one in found["stop"]["checks"] if not one["holds"]] == ["blocks"]


def test_flights_of_one_day_beside_simulations_are_flights(tmp_path: Path) -> None:
    """The simulations are no other day, whose effect would take the difference between the two for its own."""
    rows = [row | {"block": "d" if row["source"] == "flight" else ""} for row in FLOWN]
    one, other = (
        analysis_to_json(analysed(tmp_path / name, X + FREQUENCY, rows, model, MEASURED))
        for name, model in (("days", '[model]\nblock = "block"\n'), ("none", ""))
    )
    for name in sorted(one):
        np.testing.assert_equal(one[name], other[name], err_msg=name)


def test_the_flights_mean_is_that_of_their_days_whatever_the_simulations_are(tmp_path: Path) -> None:
    """Days that differ by -2, 0 and 2 about flights that score 6 above the simulations."""
    model = '[model]\nblock = "block"\ndiscrepancy_sd = 6.0\n'
    days = {f"d{k}": 2.0 * (k - 1) for k in range(3)}
    rows = []
    for i, row in enumerate(quadratic(36, 1)):
        day = f"d{i // 2 % 3}" if i % 2 else ""
        rows.append({**row, "source": "flight" if day else "simulation", "block": day})
        rows[-1]["score"] += 6.0 + days[day] if day else 0.0
    found = analysed(tmp_path / "c", X + FREQUENCY, rows, model, MEASURED)
    assert found.sources is not None
    assert found.sources.difference == pytest.approx(6.0, abs=1.0)
    assert found.optimum.mean == pytest.approx(76.0, abs=1.0)
    assert found.optimum.confidence.low < 76.0 < found.optimum.confidence.high


def test_a_floor_is_told_by_its_cause(tmp_path: Path, capsys) -> None:
    """Scatter alone; with what the tables leave open where the stop rule counts that."""
    plain = analysed(tmp_path / "c", *KINDS["plain"])
    beside = replace(plain, fitted=replace(plain.fitted, ground=Ground(2.0, 1.0, 16, 32, 0.7)))
    for analysis, worlds, cause in (
        (plain, "count", "Run-to-run scatter alone gives"),
        (beside, "ignore", "Run-to-run scatter alone gives"),
        (beside, "count", "Table uncertainty and run-to-run scatter give"),
    ):
        show_sections([optimum_section(analysis, "", StopSpec(half_width=5.0, worlds=worlds))])
        assert f"{cause} the prediction interval" in " ".join(capsys.readouterr().out.split())


def test_status_gives_every_width_the_unit_of_the_scores(tmp_path: Path, monkeypatch) -> None:
    made = make(tmp_path / "c", X, quadratic(), "", MEASURED.replace('"measured"', '"measured"\nunit = "dB"'))
    campaign = Campaign.open(made)
    campaign.record_looks(campaign.analyse_all())
    campaign.store.close()
    monkeypatch.setenv("COLUMNS", "120")
    result = CliRunner().invoke(app, ["status", str(made)])
    assert result.exit_code == 0
    told = result.output.replace("\N{NO-BREAK SPACE}", " ").partition("Decision")[0]
    widths = re.findall(r"\u00b1 [\d.]+ ?(\w*)", told)
    assert len(widths) >= 2, told
    assert set(widths) == {"dB"}, told


def test_status_of_runs_that_wait_for_their_scores_looks_at_none(tmp_path: Path) -> None:
    (tmp_path / "campaign.toml").write_text(HEAD + X + MEASURED + STOP, encoding="utf-8")
    assert CliRunner().invoke(app, ["propose", str(tmp_path)]).exit_code == 0
    assert "no scored run yet" in CliRunner().invoke(app, ["status", str(tmp_path)]).output


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('utility = "measured"', 'utility = "measured"\ngoal = "minimize"'),
        ("high = 10.0", "high = 14.0"),
        ("half_width = 3.0", "half_width = 0.5"),
    ],
)
def test_status_is_of_the_specification_as_it_is_now(tmp_path, old, new) -> None:
    """`propose` records a look; after an edit that look is of another question."""
    folder = make(tmp_path / "c", X + FREQUENCY, quadratic())
    assert CliRunner().invoke(app, ["propose", str(folder), "-n", "2"]).exit_code == 0
    file = folder / "campaign.toml"
    file.write_text(file.read_text(encoding="utf-8").replace(old, new), encoding="utf-8")
    of_fit, status = (
        json.loads(CliRunner().invoke(app, [command, str(folder), "--json"]).stdout) for command in ("fit", "status")
    )
    of_status = status["applications"][0]["last_look"]
    assert of_status["optimum"]["settings"] == of_fit["optimum"]["settings"]
    assert of_status["optimum"]["prediction"] == of_fit["optimum"]["prediction"]
    assert (of_status["held"], of_status["reasons"]) == (of_fit["stop"]["held"], of_fit["stop"]["reasons"])


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        (
            'levels = ["HH", "VV"]',
            "values = [1, 2]",
            "pol: runs 1, 3, 5, 7, 9, 11, 13, 15, ...: not a finite number (got 'HH')",
        ),
        ("low = 0.0\nhigh = 10.0", 'levels = ["near", "far"]', "x: runs 1, 7, 13, 19, 25: unknown level (got 5.0)"),
    ],
)
@pytest.mark.parametrize("command", ["status", "fit", "check", "report", "propose"])
def test_a_factor_that_became_of_another_kind_is_refused(tmp_path, old, new, says, command) -> None:
    rows = [row | {"pol": ("HH", "VV")[i % 2]} for i, row in enumerate(quadratic(30))]
    folder = make(tmp_path / "c", X + FREQUENCY + POL, rows)
    file = folder / "campaign.toml"
    file.write_text(file.read_text("utf-8").replace(old, new), "utf-8")
    done = CliRunner().invoke(app, [command, str(folder)])
    assert done.exit_code == 2, done.exception
    assert says in done.stderr
    assert "campaign.toml was changed since" in done.stderr


@pytest.mark.parametrize(("goal", "word"), [("maximize", "Gain"), ("minimize", "Difference")])
def test_a_rise_of_a_score_to_be_minimized_is_no_gain(tmp_path, goal, word) -> None:
    rows = [row | {"pol": ("HH", "VV")[i % 2]} for i, row in enumerate(quadratic(30))]
    folder = make(tmp_path / "c", X + FREQUENCY + POL, rows, application=f'{MEASURED}goal = "{goal}"\n')
    shown = CliRunner().invoke(app, ["fit", str(folder)]).stdout
    title = next(text for text in shown.splitlines() if "Pr(better)" in text)
    assert (word in title, f"interval of the {word.lower()} allows" in " ".join(shown.split())) == (True, True)


@pytest.mark.parametrize(
    "kind", ["category", "logit", "errors", "student", "random days", "flights", "scattered counts"]
)
def test_prior_constraint_and_consideration_go_with_every_command(kind: str, tmp_path: Path) -> None:
    factors, rows, model, application = KINDS[kind]
    target = (
        "unacceptable = 10\nideal = 95\n[application.prior]\nutility = [50, 95]\noptimum = { x = { value = 4.0 } }\n"
    )
    more = '[[constraint]]\nexpr = "x <= 9"\n[[consideration]]\nname = "price"\nunit = "kEUR"\nexpr = "20 + x"\n'
    folder = make(tmp_path / "c", factors + more, rows, model, application + target)
    for command in ("fit", "status", "check", "report", "propose"):
        done = CliRunner().invoke(app, [command, str(folder)])
        assert isinstance(done.exception, SystemExit | None), (command, done.exception)
        assert done.exit_code in (0, 2 if command == "check" else 0), (command, done.stderr)


@pytest.mark.parametrize(("at_end", "is_told"), [(24, False), (20, True), (12, False)])
def test_scores_at_the_end_of_their_scale_are_told_unless_all_are_equal(at_end: int, is_told: bool, tmp_path) -> None:
    rows = [row | {"score": 100.0} if i < at_end else row for i, row in enumerate(QUADRATIC)]
    shown = CliRunner().invoke(app, ["fit", str(make(tmp_path / "c", X + FREQUENCY, rows, "", PERCENT))]).output
    assert (f"{at_end} of 24 scores lie at the end of their scale" in " ".join(shown.split())) == is_told
