"""The report's section on speed and accuracy of the simulations."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from report_dossiers import flight_dossier, simulated_dossier

from seqrsm.campaign.fidelity_watch import VIOLATED
from seqrsm.campaign.records import EventRecord
from seqrsm.report.blocks import FigureBlock, Paragraph, Table
from seqrsm.report.section_speed import speed_section

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
    }
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
