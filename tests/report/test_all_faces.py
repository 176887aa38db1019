"""What was found is told on the terminal, on the page and on paper: every kind of block, every builder of findings."""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import math
import pkgutil
import re
from copy import copy
from pathlib import Path
from types import SimpleNamespace
from typing import get_args

import numpy as np
import pytest
from report_dossiers import flight_dossier
from report_texts import html_text, of_blocks, of_sections, pdf_text, squeezed
from test_speed_section import MEASURED, with_fidelity
from typer.testing import CliRunner

import seqrsm.report.sections
from seqrsm.analysis.belief import Departure
from seqrsm.analysis.compromise import campaign_compromise
from seqrsm.analysis.ground import RANKED, Ground
from seqrsm.analysis.results import Analysis
from seqrsm.analysis.scale import Interval
from seqrsm.analysis.study import term_test
from seqrsm.campaign.budget import Plan
from seqrsm.campaign.campaign import Campaign
from seqrsm.campaign.check import CheckResult, Judged
from seqrsm.campaign.dossier import assemble
from seqrsm.campaign.rests_on import CropCalendar
from seqrsm.cli.app import app
from seqrsm.cli.blocks import show_blocks, show_sections
from seqrsm.cli.console import ascii_signs
from seqrsm.report.blocks import (
    Block,
    Bullets,
    Cell,
    Code,
    Column,
    Definitions,
    Details,
    Equation,
    FigureBlock,
    KeyFigure,
    KeyFigures,
    LegendEntry,
    Panel,
    Paragraph,
    Report,
    Section,
    Table,
    right,
    table,
)
from seqrsm.report.content import build_report
from seqrsm.report.figures.drawing import svg_for_html
from seqrsm.report.html import render_html
from seqrsm.report.pdf import render_pdf
from seqrsm.report.sections.candidates import _note, candidate_section
from seqrsm.report.sections.check import check_sections, rehearsal_section
from seqrsm.report.sections.data import interpreter_table
from seqrsm.report.sections.measure import measure_section
from seqrsm.report.sections.model import term_test_table
from seqrsm.report.sections.shape import shape_section
from seqrsm.report.sections.sources import calendar_section
from seqrsm.report.sections.speed import speed_section, tradeoff_blocks
from seqrsm.report.wording import half_width_text
from seqrsm.spec.tables import CostSpec
from seqrsm.store.records import EventRecord, InterpreterEffect, RankingSummary

pytestmark = pytest.mark.usefixtures("few_draws")

NO_COST = CostSpec()
TWO_USES = """
[campaign]
name = "two uses"
seed = 3
[[factor]]
name = "look_angle"
unit = "deg"
low = 20.0
high = 60.0
[[factor]]
name = "polarization"
levels = ["HH", "VV", "HV"]
[[application]]
name = "crops"
utility = "percent_correct"
[[application]]
name = "moisture"
utility = "measured"
goal = "minimize"
[model]
block = "day"
[stop]
half_width = 2.0
"""

OF_EACH_KIND: tuple[Block, ...] = (
    Paragraph("A finding of 12.5 dB.", "warning", " It rests on 3 words of method."),
    Bullets(("first of 2", "second of 2")),
    KeyFigures((KeyFigure("Score", "70.1 \u00b1 0.4 percent", "of 31 runs"),)),
    table("Runs by rung", ("Rung", right("Runs", "1"), Column("More", extra=True)), [("F2", Cell("17", 17.0), "19")]),
    FigureBlock(
        lambda: (Panel("Slice", "A slice", lambda: '<svg width="9pt" height="9pt" viewBox="0 0 9 9"></svg>'),),
        "Slices through 23 places",
        legend=(LegendEntry("#000000", "crops"),),
    ),
    Equation("x + 1", "x plus 1"),
    Definitions((("steps", "4100"), ("R-hat", "1.003"))),
    Code(("seqrsm run campaign --max-runs 37",)),
    Details("Folded", (Paragraph("Inside 41 folds."), Details("Rows", (Bullets(("row 43",)),), long=True))),
)


def on_terminal(show, things, capsys) -> str:
    capsys.readouterr()
    show(things)
    return squeezed(capsys.readouterr().out)


def written(sections) -> tuple[str, str]:
    """Text of the page and of the paper that hold these sections."""
    report = Report("t", "", "", "0", tuple(sections))
    return html_text(render_html(report)), pdf_text(render_pdf(report), "t")


def without_pictures(sections):
    """The sections without what takes long to draw; pictures are looked at by the tests of the two written faces."""
    return tuple(
        dataclasses.replace(
            section,
            blocks=tuple(block for block in section.blocks if not isinstance(block, FigureBlock)),
            sections=without_pictures(section.sections),
        )
        for section in sections
    )


def in_all_faces(sections, capsys) -> None:
    """Every text of the sections stands in each face, but for what the terminal leaves out on purpose."""
    on_page, on_paper = written(sections)
    for text in of_sections(sections):
        assert squeezed(text) in on_page, text
        assert squeezed(text) in on_paper, text
    on_the_terminal(sections, capsys)


def on_the_terminal(sections, capsys) -> None:
    """Every text of the sections that is for a terminal stands there."""
    shown = on_terminal(show_sections, sections, capsys)
    told = [text for text in of_sections(sections, terminal=True) if text]
    assert told
    for text in told:
        assert squeezed(ascii_signs(text)) in shown, text


def test_every_kind_of_block_has_three_faces(capsys) -> None:
    assert {type(block) for block in OF_EACH_KIND} == set(get_args(Block))
    in_all_faces((Section("one", "Title of 47", OF_EACH_KIND),), capsys)
    shown = on_terminal(show_blocks, OF_EACH_KIND, capsys)
    for left_out in ("method", "More", "Slice", "xplus1", "43"):
        assert left_out not in shown
    assert "Warning:Afindingof12.5dB." in shown
    assert "Rows:inthereport" in shown


def test_a_section_without_anything_for_a_terminal_has_no_title_there(capsys) -> None:
    assert on_terminal(show_sections, (Section("x", "Title", (OF_EACH_KIND[4],)),), capsys) == ""


@pytest.fixture(scope="module")
def two_uses(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("uses") / "campaign"
    folder.mkdir()
    (folder / "campaign.toml").write_text(TWO_USES, encoding="utf-8")
    rng = np.random.default_rng(2)
    rows = ["look_angle,polarization,day,application,score"]
    for i in range(36):
        a, p = rng.uniform(-1, 1), i % 3
        start = f"{40 + 20 * a:.2f},{('HH', 'VV', 'HV')[p]},day{i // 12}"
        rows.append(f"{start},crops,{70 - 5 * a**2 + (3, 3, -4)[p] + rng.normal():.2f}")
        rows.append(f"{start},moisture,{5 + 2 * (a - 0.3) ** 2 + 0.3 * rng.normal():.3f}")
    (folder / "scores.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    assert CliRunner().invoke(app, ["ingest", str(folder), str(folder / "scores.csv")]).exit_code == 0
    return folder


@pytest.fixture(scope="module")
def studied(two_uses: Path, tmp_path_factory: pytest.TempPathFactory):
    """Dossier with all that a thorough look finds, a compromise, and a tie."""
    campaign = Campaign.open(two_uses)
    first, second = campaign.analyse_all(thorough=True)
    ties = ({**first.optimum.settings, "look_angle": 33.25}, {**first.optimum.settings, "polarization": "VV"})
    first = dataclasses.replace(first, optimum=dataclasses.replace(first.optimum, ties=ties))
    return dataclasses.replace(
        flight_dossier(tmp_path_factory.mktemp("flight")),
        spec=campaign.spec,
        analyses=(first, second),
        runs=campaign.store.runs(),
        compromise=campaign_compromise(campaign.spec, (first, second)),
    )


def test_every_section_of_a_report_in_all_faces(studied, capsys) -> None:
    in_all_faces(without_pictures(build_report(studied).sections), capsys)


@pytest.mark.parametrize("name", ["simulated", "flight", "many", "saturated"])
def test_every_section_of_a_report_on_the_terminal(name, request, built, capsys) -> None:
    """The written faces of these are compared with their blocks in test_report_faces."""
    on_the_terminal(built(request.getfixturevalue(name)).sections, capsys)


def test_tied_optima_are_in_all_faces(studied, capsys) -> None:
    sections = without_pictures([one for one in build_report(studied).sections if one.key == "a1"])
    in_all_faces(sections, capsys)
    found = [text for text in of_sections(sections) if text.startswith("Equally good: ")]
    assert len(found) == 1
    assert re.search(r"look angle 33.3?\d?.deg, polarization HH; look angle .*, polarization VV", found[0])


def with_departure(studied, departure):
    """The first application's settings and intervals, with another word on surfaces that are no quadratic."""
    analysis = studied.analyses[0]
    fitted = dataclasses.replace(analysis.fitted, departure=departure)
    changed = dataclasses.replace(analysis, fitted=fitted)
    return without_pictures((shape_section(changed, "crops"),))


def test_what_is_said_of_surfaces_that_are_no_quadratic_is_in_all_faces(studied, capsys) -> None:
    departure = studied.analyses[0].fitted.departure
    assert departure.process is not None
    factor = "log Bayes factor 4.2"
    alone = studied.analyses[0].region.decode(studied.analyses[0].of_quadratic.point)[0]
    for found, told in (
        (Departure(departure.process, 4.2, 0.37), f"has a probability of 37 % ({factor})"),
        (Departure(departure.process, 4.2, 0.37), f"polarization {alone['polarization']}."),
        (Departure(departure.process, 4.2, 0.0), f"The scores favour the quadratic ({factor})"),
        (
            Departure(None, float("nan"), 0.0, "it passes through every score"),
            "no alternative surface was considered: it passes through every score.",
        ),
    ):
        sections = with_departure(studied, found)
        assert "repeats at their middle" not in " ".join(of_sections(sections))
        assert squeezed(told) in squeezed(" ".join(of_sections(sections, terminal=True)))
        in_all_faces(sections, capsys)


def test_many_runs_that_count_as_repeats_are_told(studied) -> None:
    many = copy(studied.analyses[0].fitted.departure.process)
    many.gathered = True
    many.hyper = many.hyper.some(slice(20))
    text = " ".join(of_sections(with_departure(studied, Departure(many, 4.2, 0.37))))
    assert "averaged over 20 draws of its hyperparameters" in text
    assert "Near runs count as repeats at their middle, so that 250 settings are left." in text


def test_what_fit_prints_stands_in_the_report(two_uses: Path) -> None:
    """Every number that `seqrsm fit` prints on a narrow terminal is in one of the report's blocks."""
    shown = CliRunner().invoke(app, ["fit", str(two_uses)], env={"COLUMNS": "80"})
    assert shown.exit_code == 0
    text = ascii_signs(" ".join(of_sections(build_report(assemble(Campaign.open(two_uses))).sections)))
    numbers = set(re.findall(r"(?<![\w.])-?\d+\.\d+", shown.stdout))
    assert len(numbers) > 100
    assert [number for number in numbers if number not in text] == []


def test_what_is_measured_is_in_all_faces(simulated, capsys) -> None:
    measured = {"simulation": {**MEASURED["simulation"], "failures": ["no line of sight"]}}
    section = speed_section(dataclasses.replace(with_fidelity(simulated, 2, 1), tradeoff=measured))
    in_all_faces(without_pictures((section,)), capsys)
    told = " ".join(of_blocks(section.blocks, terminal=True))
    for text in ("2 x 2 cells averaged", "no line of sight"):
        assert text in told
    blocks = tuple(tradeoff_blocks(measured, dict.fromkeys(measured["simulation"]["applications"], "percent")))
    in_all_faces(without_pictures((Section("s", "S", blocks),)), capsys)


_PLANS = (
    (Plan("", 300, 27, 81, 5.25, 0.4), Plan("[model] order = 1", 300, 10, 30, 9.75, 3.1)),
    (Plan("", 28, 27, 81, math.nan, math.nan), Plan("[model] order = 1", 28, 10, 30, 14.25, 3.25)),
)


def test_what_is_known_before_the_first_run_is_in_all_faces(studied, capsys) -> None:
    other = Judged("crops", 3.604, 0.6, "simulations", 28, 81, 3, "", *_PLANS, "random quadratics", 6.0, "percent")
    result = CheckResult(
        **vars(dataclasses.replace(other, application="soil", noise=4.207, ground_share=0.7, noise_source="residuals")),
        name="polder", n_factors=3, n_terms=27, start_runs=33, max_runs=300, seconds_per_run=0.0441, cost=301.5,
        cost_unit="", notes=("Grass: assumed (assumed: me)",), covers=("Grass",),
        combinations=("gaps at 4 of 6 settings",), hardware=("gain against beam, margin 1.7: 23 dB",), others=(other,),
    )  # fmt: skip
    rehearsed = {"campaigns": 200, "rows": [("runs needed, median", "41 (33 to 57)")], "notes": ["Truths are drawn."]}
    tests = [term_test(studied.analyses[0], "look_angle")]
    in_all_faces(
        (
            *check_sections(result),
            rehearsal_section(rehearsed),
            Section("tests", "Tests", (term_test_table(studied.analyses[0], tests),)),
            _measured(studied.analyses[0]),
        ),
        capsys,
    )


def test_what_every_row_of_a_check_is_stands_once() -> None:
    """It stood after the tables of each application; which one a variance is of was to be guessed."""
    one = Judged("crops", 3.604, 0.6, "simulations", 28, 81, None, "", *_PLANS, "random quadratics", 6.0, "percent")
    soil = dataclasses.replace(one, application="soil", ground_share=0.7)
    result = CheckResult(
        **vars(soil), name="polder", n_factors=3, n_terms=27, start_runs=33, max_runs=300, seconds_per_run=math.nan,
        cost=301.5, cost_unit="", notes=(), covers=(), combinations=(), hardware=(), others=(one,),
    )  # fmt: skip
    sections = check_sections(result)
    told = str(sections)
    assert told.count("Each row: 200 simulated campaigns on random quadratics") == 1
    of_scores = dataclasses.replace(result, others=(dataclasses.replace(one, surfaces="the posterior"),))
    assert str(check_sections(of_scores)).count("Each row: 200 simulated campaigns on ") == 2
    items = dict(sections[0].blocks[0].items)
    assert (items["variance from table uncertainty, soil"], items["variance from table uncertainty, crops"]) == (
        "70 %",
        "60 %",
    )
    of_plans = one.plans[0].loss  # of quadratics, which are no worst case
    for loss, row in ((0.9 * of_plans, 0), (1.1 * of_plans, 1), (math.nan, 0)):
        other = dataclasses.replace(result, loss_departed=loss, others=())
        assert str(check_sections(other)).count("if the surface is no quadratic") == row
    fast = dict(check_sections(dataclasses.replace(result, seconds_per_run=0.003))[0].blocks[0].items)
    assert fast["simulation time here"] == "0.0030 s a run; less than 1 s for the budget"  # it said 0 s


def test_half_widths_of_covers_have_the_decimals_of_the_smallest(studied) -> None:
    """From 8 to 11, say: in one column, and the smallest with two digits. Of 11, 0.64 of its square is the ground's."""
    best = studied.analyses[0].optimum
    stretched = dataclasses.replace(best, whole=Interval(best.mean - 11.0, best.mean + 11.0))
    analysis = dataclasses.replace(studied.analyses[0], optimum=stretched)
    section = _measured(analysis)
    assert "one flight over the site would leave 8.5\xa0percent" in section.blocks[0].text
    grass, water = ([cell if isinstance(cell, str) else cell.text for cell in row] for row in section.blocks[-1].rows)
    assert grass == [
        "Grass",
        "\u00b1 2.6 dB",
        "10.4",
        "10.2",
        "0.8",
    ]  # sqrt(121 - 0.22 * 0.75 * 77.44), and of all 0.22
    assert water == ["Grass and Water", "", "8.8", "8.0", "0.5"]


def test_a_flight_over_the_site_is_told_with_its_cost(studied) -> None:
    head = _measured(studied.analyses[0], CostSpec(unit="kEUR", flight=12.5)).blocks[0]
    assert "one flight over the site (12.5\xa0kEUR) would leave" in head.text


def _measured(analysis: Analysis, cost: CostSpec = NO_COST) -> Section:
    """What to measure, where most of the interval is the ground's."""
    best = analysis.optimum
    chance = Interval(best.mean - 0.6 * best.whole.half_width, best.mean + 0.6 * best.whole.half_width)
    known = dataclasses.replace(
        analysis, optimum=dataclasses.replace(best, ground=Ground(4.0, 3.0, 16, 32, 0.6), by_chance=chance)
    )
    covers = [
        {"covers": ["Grass"], "mean_sd": 2.6, "left": 0.78, "se": 0.2},
        {"covers": ["Grass", "Water"], "mean_sd": 2.3, "left": 0.2645, "se": 0.11},
    ]
    detail = {"application": analysis.application, "settings": best.settings, "unit": "dB", "known": covers}
    older = EventRecord(2, "", "", None, None, RANKED, {name: detail[name] for name in ("application", "settings")})
    found = measure_section(known, (EventRecord(1, "", "", None, None, RANKED, detail), older), cost, "measure")
    assert found is not None
    assert measure_section(known, (older,), NO_COST, "measure") is None
    without = EventRecord(1, "", "", None, None, RANKED, {**detail, "known": []})
    (only,) = measure_section(known, (without,), NO_COST, "measure").blocks
    assert "one flight" in str(only)
    little = [{**one, "left": left} for one, left in zip(covers, (1.0, 0.9), strict=True)]
    hardly = EventRecord(1, "", "", None, None, RANKED, {**detail, "known": little})
    (only,) = measure_section(known, (hardly,), NO_COST, "measure").blocks
    least = half_width_text(known, best.whole.half_width * float(np.sqrt(1.0 - 0.1 * 0.64)))
    assert str(only.text).endswith(f"Exact knowledge of covers would leave {least} at best.")
    some = [{**one, "left": left} for one, left in zip(covers, (1.0, 0.5), strict=True)]
    told = measure_section(
        known, (EventRecord(1, "", "", None, None, RANKED, {**detail, "known": some}),), CostSpec(), "measure"
    )
    assert told is not None
    assert len(told.blocks) == len(found.blocks)  # where one cover counts the table stays
    names, shares = (["Grass"], ["Water"], ["Grass", "Water"]), (0.5, 1.0, 0.48)
    some = [{**covers[0], "covers": own, "left": left} for own, left in zip(names, shares, strict=True)]
    told = measure_section(
        known, (EventRecord(1, "", "", None, None, RANKED, {**detail, "known": some}),), CostSpec(), "measure"
    )
    assert told is not None
    assert [row[0].text for row in told.blocks[-1].rows] == ["Grass"]  # not what hardly helps
    assert measure_section(analysis, (), NO_COST, "measure") is None
    return found


def test_the_calendar_of_crops_is_drawn() -> None:
    calendar = CropCalendar(("Wheat", "Corn"), ("C VV",), np.zeros((1, 2, 365)) - 10.0, (120.0, 150.0))
    found = calendar_section(SimpleNamespace(calendar=calendar))
    assert found is not None
    ((panel,),) = (block.panels for block in found.blocks)
    assert "<svg" in panel.draw()
    assert len(panel.data().rows) == 365
    assert calendar_section(SimpleNamespace(calendar=None)) is None


COMPARED = {
    "optimum": 63.9, "sufficient": 60.0, "relative": False, "runs": 5.0, "level": 0.95, "unit": "percent",
    "candidates": [
        {
            "name": "Sentinel-1 IW GRDH, VV+VH", "how": "simulation", "score": 58.2, "difference": -5.7,
            "confidence": {"low": -6.9, "high": -4.5}, "one_ground": {"low": -11.2, "high": -0.2},
            "probability": 0.23, "recalled": ["looks"],
            "places": [{"cell_m": 44.0, "incidence_deg": 38.0, "looks": 19.4, "noise_db": -26.1, "score": 58.2}],
            "owed_to": [{"property": "channels", "difference": -4.1, "confidence": {"low": -5.0, "high": -3.2}}],
            "dates": {"used": [120.0, 132.0], "offered": 7},
        },
        {"name": "Umbra Spotlight, VV", "how": "none", "why": "its cell is too fine"},
    ],
}  # fmt: skip


def test_candidates_are_in_all_faces(capsys) -> None:
    first, fine = COMPARED["candidates"]
    other = first | {"name": "ROSE-L", "beside_first": first | {"name": "ROSE-L", "difference": -1.7}}
    found = {**COMPARED, "candidates": [first | {"again": first}, other, fine]}
    section = candidate_section({"applications": {"crops": found}})
    both = candidate_section({"applications": {"crops": COMPARED, "soil": {**COMPARED, "relative": True}}})
    assert section is not None
    assert both is not None
    in_all_faces(without_pictures((section,)), capsys)
    in_all_faces(without_pictures((both,)), capsys)
    told = " ".join(of_blocks(section.blocks, terminal=True))
    for text in (
        "60.0",
        "looks recalled, not verified",
        "could not be evaluated: its cell is too fine",
        "of 7 available",
        "\u22124.1 \u00b1 0.9",
        "The next simulated candidates less Sentinel-1 IW GRDH, VV+VH, in further draws of the tables",
        "\u22121.7",
        "19 looks; at 38\u00a0deg incidence noise \u221226.1\u00a0dB, score 58.2\u00a0percent",
    ):
        assert text in told
    wide = {"name": "AMSR2", "places": [{"cell_m": 4e4, "footprint_m": [62e3, 35e3], "incidence_deg": 55.0}]}
    assert _note(wide, 1, "percent") == "AMSR2: footprint 62.0 by 35.0\u00a0km at 55\u00a0deg."
    (panel,) = next(block for block in section.blocks if isinstance(block, FigureBlock)).panels
    assert "<svg" in panel.svg
    assert panel.data is not None
    assert panel.data().rows[0][1:4] == (-5.7, -6.9, -4.5)
    assert candidate_section(None) is None


@pytest.mark.parametrize(
    ("optimum", "within", "guess", "told"),
    [(0.38, -0.41, 0.0, True), (0.38, -0.2, 0.0, False), (0.02, 0.05, 0.06, True), (0.02, 0.03, 0.06, False)],
)
def test_a_margin_that_holds_a_guess_is_told(optimum: float, within: float, guess: float, told: bool) -> None:
    """Small scores are good where sufficient ones are above the optimum's."""
    found = {**COMPARED, "optimum": optimum, "sufficient": within, "relative": True, "guess": guess, "unit": ""}
    section = candidate_section({"applications": {"soil": found}})
    assert section is not None
    said = " ".join(of_blocks(section.blocks, terminal=True))
    assert (f"Guessing scores {guess:.3f}, which suffices by this rule" in said) == told


def test_candidates_of_scores_between_0_and_1_are_told_apart() -> None:
    row = COMPARED["candidates"][0] | {"score": 0.2043, "difference": -0.2067, "owed_to": []}
    row |= {"confidence": {"low": -0.2143, "high": -0.1991}, "one_ground": {"low": -0.38, "high": -0.05}}
    row["places"] = [{**row["places"][0], "score": 0.2043}]
    found = {**COMPARED, "optimum": 0.4184, "sufficient": 0.35, "unit": "", "candidates": [row]}
    section = candidate_section({"applications": {"crops": found}})
    assert section is not None
    told = " ".join(of_blocks(section.blocks, terminal=True))
    assert "optimum's score is 0.418" in told
    assert "score 0.204;" in told
    (cells,) = next(block for block in section.blocks if isinstance(block, Table)).rows
    assert [cell.text for cell in cells[2:5]] == ["0.204", "\u22120.207", "\u22120.214 to \u22120.199"]


def test_a_report_tells_of_the_likeliest_candidates_and_how_many_others_there_are() -> None:
    """Sixty filled four pages; the terminal lists all."""
    rows = [COMPARED["candidates"][0] | {"name": f"sensor {k}", "difference": -0.1 * k} for k in range(62)]
    rows += [COMPARED["candidates"][1] | {"name": f"fine {k}"} for k in range(23)]
    measured = {"applications": {"crops": {**COMPARED, "candidates": rows}}}
    section, whole = candidate_section(measured), candidate_section(measured, every=True)
    assert section is not None
    assert whole is not None
    (panel,) = next(block for block in section.blocks if isinstance(block, FigureBlock)).panels
    assert [row[0] for row in panel.data().rows] == [f"sensor {k}" for k in range(20)]
    assert "min-width:501px" in svg_for_html(panel.svg, "a")  # it scrolls in a narrow window and does not shrink
    assert "min-width" not in svg_for_html('<svg width="208.8pt"></svg>', "a")
    assert {len(block.rows) for block in section.blocks if isinstance(block, Table)} == {20}
    assert {len(block.rows) for block in whole.blocks if isinstance(block, Table)} == {62}
    told = " ".join(of_blocks(section.blocks, terminal=True))
    assert "Candidates not shown here: 42 less likely to suffice and 3 not evaluated; " in told
    assert "not shown here" not in " ".join(of_blocks(whole.blocks, terminal=True))


def test_interpreters_are_in_all_faces(capsys) -> None:
    people = (InterpreterEffect("Ann", 4, 1.26, 0.81, 1.96, 0.584), InterpreterEffect("Bob", 3, 0.794, 0.51, 1.2, None))
    summary = RankingSummary("clear", 7, {}, 0.1, (), people)
    in_all_faces((Section("people", "Interpreters", (interpreter_table(summary),)),), capsys)
    told = " ".join(of_blocks((interpreter_table(summary),), terminal=True))
    assert all(text in told for text in ("Ann", "1.3", "0.81 to 2.0", "0.58", "Bob", "0.79", "0.51 to 1.2"))


BY_REPORT = {
    "application_sections", "assumption_section", "compromise_section", "compromise_summary", "cover_section",
    "diagnostics_section", "first_panels", "history_section", "image_section", "importance_section",
    "interpreter_table", "literature_section", "method_sections", "model_section", "optimum_section",
    "printed_section", "provenance_section", "question_section", "result_section", "run_section",
    "shape_section", "summary_section", "surface_section",
}  # fmt: skip
BY_NAME = {
    "calendar_section", "candidate_section", "check_sections", "interpreter_table", "measure_section",
    "rehearsal_section", "speed_section", "term_test_table", "tradeoff_blocks",
}  # fmt: skip


def test_no_builder_of_findings_is_left_out() -> None:
    """A new one joins the report or a test above."""
    found = set()
    names = [one.name for one in pkgutil.iter_modules(seqrsm.report.sections.__path__, "seqrsm.report.sections.")]
    for module in (*names, "seqrsm.report.content"):
        for name, value in vars(importlib.import_module(module)).items():
            if inspect.isfunction(value) and value.__module__ == module and not name.startswith("_"):
                given = str(inspect.signature(value).return_annotation)
                if re.search(r"\b(?:Section|Block|FigureBlock|Table|Paragraph)\b", given):
                    found.add(name)
    assert found == BY_REPORT | BY_NAME


def test_a_face_that_loses_a_number_would_be_seen(capsys, monkeypatch) -> None:
    monkeypatch.setattr("seqrsm.cli.blocks.show_table", lambda *_, **__: None)
    with pytest.raises(AssertionError):
        in_all_faces((Section("one", "Title", (table("Runs", ("Rung",), [("17",)]),)),), capsys)
