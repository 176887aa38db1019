"""The report's section on speed and accuracy of the simulations."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from report_dossiers import flight_dossier, simulated_dossier

from seqrsm.campaign.fidelity_watch import VIOLATED
from seqrsm.report.blocks import FigureBlock, Paragraph, Table
from seqrsm.report.sections.speed import pareto, speed_section
from seqrsm.store.records import EventRecord

KEPT = {"rung": "F2", "bound": 0.42, "left_out": ["ground between the strips"], "tolerance": 0.5}
CHECK = {"by": "F3", "difference": -0.31, "limit": 1.5}


def row(rung: str, ratio: float, rms: float) -> dict:
    return {
        "rung": rung, "meaning": "", "configurations": 8, "occasions": 6, "seconds": 0.1, "time_ratio": ratio,
        "bias": 0.1, "bias_se": 0.05, "rms_error": rms, "largest_error": 2 * rms, "bound": 1.0,
        "rank_correlation": None, "utility_lost": 0.0, "utility_lost_se": 0.1,
    }  # fmt: skip


MEASURED = {
    "simulation": {
        "applications": {"ground-cover": [row("F2", 0.1, 0.3), row("F4", 1.0, 0.0), row("auto", 0.1, 0.3)]},
        "refused": {"F1": "the data base is too small"},
    },
    "numerics": {
        "sampler": {
            "ground-cover": [
                {"method": "exact", "quantity": "future score", "draws": 250, "error_low": 0.65, "error_high": 0.72,
                 "seconds": 0.001}
            ]
        },
        "precision": [
            {"score32": 44.72951, "score64": 44.7295, "median_difference": 7.5e-8, "seconds32": 0.006,
             "seconds64": 0.009}
        ],
        "design_search": [{"restarts": 4, "efficiency": 0.9995, "least_efficiency": 0.98, "seconds": 0.01}],
    },
}  # fmt: skip

PLAN = {
    "why": "F2, strips: error at most 0.4 of 0.5 accepted",
    "effects": [
        {"name": "cast shadow", "verdict": "exact", "bound": 0.0, "text": "no step exceeds 0.3"},
        {"name": "fading", "verdict": "needed", "bound": 1.93, "text": "171 looks"},
        {"name": "curvature of the Earth", "verdict": "needed", "bound": None, "text": "4.7 m"},
    ],
}


def with_fidelity(dossier, kept):
    """The dossier with the planner's record beside the first scores."""
    runs = []
    for number, run in enumerate(dossier.runs):
        own = {**kept, "check": CHECK} if number == 0 else kept
        scores = tuple(replace(score, metadata={**score.metadata, "fidelity": own}) for score in run.scores)
        runs.append(replace(run, scores=scores))
    return replace(dossier, runs=tuple(runs))


def text_of(section) -> str:
    return " ".join(block.text for block in section.blocks if isinstance(block, Paragraph))


def test_rungs_checks_and_tradeoff_are_told(tmp_path: Path) -> None:
    dossier = replace(with_fidelity(simulated_dossier(tmp_path), KEPT), tradeoff=MEASURED)
    section = speed_section(dossier)
    tables = [block for block in section.blocks if isinstance(block, Table)]
    scored = sum(run.state == "scored" for run in dossier.runs)
    assert [cell.text for cell in tables[0].rows[0]][2:] == [str(scored), "0.42", "ground between the strips"]
    assert "0.31" in text_of(section)
    assert "No bound was violated" in text_of(section)
    assert [line[0].text for line in tables[1].rows] == ["F2", "F4", "planner"]
    (figure,) = [block for block in section.blocks if isinstance(block, FigureBlock)]
    assert "<svg" in figure.panels[0].svg
    assert figure.panels[0].data().rows[0][:2] == ("F2", 0.1)


def test_a_violated_bound_is_a_warning(tmp_path: Path) -> None:
    dossier = with_fidelity(simulated_dossier(tmp_path), KEPT)
    event = EventRecord(99, "", "", None, 1, VIOLATED, {"rung": "F2", "factor": 2.0})
    section = speed_section(replace(dossier, events=(*dossier.events, event)))
    (warning,) = [block for block in section.blocks if isinstance(block, Paragraph) and block.tone == "warning"]
    assert "F2 by a factor of 2" in warning.text
    assert "was not run" in text_of(section)


def test_no_section_without_a_simulator(tmp_path: Path) -> None:
    assert speed_section(flight_dossier(tmp_path)) is None


def test_verdicts_on_the_effects_are_told_in_words(tmp_path: Path) -> None:
    section = speed_section(replace(simulated_dossier(tmp_path), plan=PLAN))
    (table,) = [block for block in section.blocks if isinstance(block, Table)]
    assert [[cell.text for cell in line] for line in table.rows] == [
        ["cast shadow", "proven to change nothing", "0", "no step exceeds 0.3"],
        ["fading", "needed", "1.9", "171 looks"],
        ["curvature of the Earth", "needed", "no bound", "4.7 m"],
    ]
    assert PLAN["why"] in table.caption


def test_sampler_precision_and_design_search_are_told(tmp_path: Path) -> None:
    dossier = replace(simulated_dossier(tmp_path), tradeoff=MEASURED)
    tables = [block for block in speed_section(dossier).blocks if isinstance(block, Table)][-3:]
    assert [cell.text for cell in tables[0].rows[0]][:4] == ["exact", "future score", "250", "0.65 and 0.72"]
    assert [cell.text for cell in tables[1].rows[0]][:3] == ["44.7295", "44.7295", "7.5e-08"]
    assert [cell.text for cell in tables[2].rows[0]][:3] == ["4", "0.9995", "0.9800"]


def test_a_campaign_of_flights_has_the_tables_of_its_numbers(tmp_path: Path) -> None:
    measured = {
        "simulation": None,
        "why": "no simulator",
        "numerics": MEASURED["numerics"] | {"precision": {"why": ""}},
    }
    section = speed_section(replace(flight_dossier(tmp_path), tradeoff=measured))
    assert len([block for block in section.blocks if isinstance(block, Table)]) == 2


def test_models_that_another_beats_are_off_the_front() -> None:
    rows = [row("F0", 0.1, 2.0), row("F1", 0.3, 3.0), row("F2", 0.4, 0.5), row("F3", 1.5, 0.1), row("F4", 1.0, 0.0)]
    assert [one["rung"] for one in pareto([*rows, row("auto", 0.05, 0.01)])] == ["F0", "F2", "F4"]
