"""Whose settings and scores pictures and tables of a report show, and what is said once."""

from __future__ import annotations

import dataclasses
import math
from types import SimpleNamespace

from report_dossiers import two_uses

from seqrsm.analysis.gap import Gap
from seqrsm.campaign.images import chosen_settings
from seqrsm.report.blocks import Table
from seqrsm.report.sections import data, model
from seqrsm.report.sections.data import question_section, run_section
from seqrsm.report.sections.model import diagnostics_section
from seqrsm.report.sections.optimum import optimum_section
from seqrsm.report.sections.sources import image_section, provenance_section
from seqrsm.report.sections.summary import summary_section
from seqrsm.report.wording import format_setting, readable


def tables(section) -> list[Table]:
    return [block for block in section.blocks if isinstance(block, Table)]


def test_one_more_run_is_named_and_not_counted(simulated, monkeypatch):
    analysis = simulated.analyses[0]
    for n, end in ((3, "2 and 3"), (4, "3 and 4"), (5, "3 and 2 more")):
        found = [SimpleNamespace(run=i, reasons=()) for i in range(n)]
        monkeypatch.setattr(model, "influential_runs", lambda fit, found=found: found)
        assert f"{end}." in str(diagnostics_section(analysis, "x"))


def test_a_run_fitted_exactly_is_not_counted_where_its_influence_is_undefined(simulated, monkeypatch):
    """Of eleven runs "with Cook's distance above 4/n" nine had leverage 1 and no Cook's distance."""
    analysis = simulated.analyses[0]
    fit = dataclasses.replace(analysis.fit, leverage_one_runs=(0, 2))
    exact = dataclasses.replace(analysis, fitted=dataclasses.replace(analysis.fitted, fit=fit))
    found = [SimpleNamespace(run=i, reasons=()) for i in range(4)]
    monkeypatch.setattr(model, "influential_runs", lambda fit: found)
    text = str(diagnostics_section(exact, "x"))
    assert "runs 1 and 3 (leverage 1)" in text
    assert "2 further runs with" in text
    monkeypatch.setattr(model, "influential_runs", lambda fit: [found[0], found[2]])
    assert "Cook's distance above" not in str(diagnostics_section(exact, "x"))


def test_pictures_and_settings_are_also_of_the_compromise(flight, simulated):
    """The report recommends it: it showed the first application's optimum and said "the optimum"."""
    both = two_uses(flight)
    best = both.compromise
    assert list(chosen_settings(both.analyses, best)) == ["At the compromise", "Worst of the region"]
    assert chosen_settings(both.analyses, best)["At the compromise"] == best.settings
    alone = chosen_settings(flight.analyses, None)
    assert alone["At the optimum"] == flight.analyses[0].optimum.settings
    names = [row[0].text for row in tables(provenance_section(both))[-1].rows]
    assert names == ["compromise", *(one.application for one in both.analyses)]
    assert [row[0].text for row in tables(provenance_section(flight))[-1].rows] == names[1:2]
    shown = dataclasses.replace(simulated, analyses=simulated.analyses * 2)
    assert f"score for {simulated.analyses[0].application} of" in str(image_section(shown))


def test_no_text_says_that_all_runs_are_listed_where_the_last_are(simulated, monkeypatch):
    monkeypatch.setattr(data, "MOST_RUNS", 5)
    assert run_section(simulated).title == "The last runs"
    assert "lists them all" not in str(question_section(simulated))


def test_what_the_settings_of_each_application_rest_on_stands_with_them_alone(flight):
    both = two_uses(flight)
    rests = {one.application: {"measured": 0.4, "assumed": 0.6} for one in both.analyses}
    assert "Table values" not in str(summary_section(both.spec, both.analyses, both.compromise, both.runs, rests))
    assert "Table values" in str(summary_section(flight.spec, flight.analyses, None, flight.runs, rests))


def test_a_half_width_of_which_bounds_of_the_score_cut_a_part_is_told_as_such(simulated):
    """79.1 to 100.0 percent stood beside a half-width of 16 percent."""
    told = "before the interval is cut at the bounds of the score"
    analysis, stop = simulated.analyses[0], simulated.spec.stop

    def shown(one) -> str:
        spec = dataclasses.replace(simulated.spec, stop=stop)
        return f"{optimum_section(one, 'x', stop)} {summary_section(spec, [one], None, simulated.runs)}"

    best = analysis.optimum
    ends = {name: getattr(best, name) for name in ("confidence", "prediction", "prediction_mean", "whole", "by_chance")}
    whole = {name: dataclasses.replace(one, cut_from=math.nan) for name, one in ends.items()}
    cut = {name: one.within(-math.inf, best.mean) for name, one in whole.items()}
    assert cut["prediction"].half_width == whole["prediction"].half_width
    for intervals, times in ((whole, 0), (cut, 2)):
        found = dataclasses.replace(analysis, optimum=dataclasses.replace(best, **intervals))
        assert shown(found).count(told) == times


def test_one_value_of_a_factor_is_no_range(simulated):
    """The largest box without a run was told to be at dates 3 to 3."""
    analysis = simulated.analyses[0]
    factor = analysis.region.factors[analysis.region.numeric[0]]
    one = Gap(0.5, {factor.name: (factor.low, factor.low)})
    section = optimum_section(dataclasses.replace(analysis, gap=one), "x", simulated.spec.stop)
    alone = " ".join(str(getattr(block, "text", "")) for block in section.blocks)
    assert f"coded range: {readable(factor.name)} {format_setting(factor, factor.low)}. A peak" in alone


def test_a_score_that_tells_no_standard_error_is_not_told_as_exact(simulated):
    images = tuple(dataclasses.replace(one, score_se=0.0) for one in simulated.images)
    shown = str(image_section(dataclasses.replace(simulated, images=images)))
    assert "79.2" in shown
    assert "\u00b1" not in shown.replace("Score \u00b1 s.e.", "")
