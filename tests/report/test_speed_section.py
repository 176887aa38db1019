"""The report's section on speed and accuracy of the simulations."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from report_dossiers import flight_dossier, simulated_dossier

from seqrsm.campaign.tradeoff import COARSENED
from seqrsm.report.blocks import Paragraph, Table
from seqrsm.report.sections.speed import speed_section, tradeoff_blocks
from seqrsm.store.records import EventRecord


def row(cells: int, ratio: float, rms: float) -> dict:
    return {
        "cells": cells, "averaged": [1, 2] if cells else [1], "configurations": 8, "occasions": 6, "seconds": 0.1,
        "time_ratio": ratio, "bias": 0.1, "bias_se": 0.05, "rms_error": rms, "largest_error": 2 * rms,
        "rank_correlation": None, "utility_lost": 0.0, "utility_lost_se": 0.1,
    }  # fmt: skip


MEASURED = {
    "simulation": {
        "applications": {"ground-cover": [row(0, 1.0, 0.0), row(2, 0.1, 0.3)]},
        "failures": [],
        "tolerance": 0.5,
    }
}


def with_fidelity(dossier, *averaged):
    """The dossier with what each of the first runs was simulated on."""
    runs = list(dossier.runs)
    for number, (run, k) in enumerate(zip(dossier.runs, averaged, strict=False)):
        own = {"averaged": k, "seconds": 0.25}
        scores = tuple(replace(score, metadata={**score.metadata, "fidelity": own}) for score in run.scores)
        runs[number] = replace(run, scores=scores)
    return replace(dossier, runs=tuple(runs))


def text_of(section) -> str:
    return " ".join(block.text for block in section.blocks if isinstance(block, Paragraph))


def test_data_bases_and_tradeoff_are_told(tmp_path: Path) -> None:
    dossier = replace(with_fidelity(simulated_dossier(tmp_path), 1, 2, 2), tradeoff=MEASURED)
    dossier = replace(dossier, runs=dossier.runs[:3])
    event = EventRecord(99, "", "", None, 1, COARSENED, {"cells": 2, "tolerance": 0.5, "rms_error": {"2": 0.31}})
    section = speed_section(replace(dossier, events=(*dossier.events, event)))
    tables = [block for block in section.blocks if isinstance(block, Table)]
    assert [[cell.text for cell in line] for line in tables[0].rows] == [
        ["full scene", "1"],
        ["2 x 2 cells averaged", "2"],
    ]
    assert "0.31" in text_of(section)
    assert "finest to the coarsest sensor of the region; the table below is of others" in text_of(section)
    alone = speed_section(replace(dossier, events=(*dossier.events, event), tradeoff=None))
    assert "finest to the coarsest sensor of the region. The intervals" in text_of(alone)
    assert [line[0].text for line in tables[1].rows] == ["all", "2 cells"]
    assert tables[1].rows[1][1].text == "1 x 1 and 2 x 2"


def test_no_section_without_a_simulator(tmp_path: Path) -> None:
    assert speed_section(flight_dossier(tmp_path)) is None


def test_each_application_is_told_in_its_own_unit_and_digits() -> None:
    small = {**row(2, 0.1, 0.0031), "bias": -0.0012, "utility_lost": 0.0007}
    applications = {"cover": [row(0, 1.0, 0.0), row(2, 0.1, 0.3)], "moisture": [small]}
    simulation = {**MEASURED["simulation"], "applications": applications, "tolerance": 0.002}
    one, other = tradeoff_blocks({"simulation": simulation}, {"cover": "percent", "moisture": "m3/m3"})
    assert [column.unit for column in one.columns[4:7]] == ["percent"] * 3
    assert [column.unit for column in other.columns[4:7]] == ["m3/m3"] * 3
    assert "accepted: 0.002 m3/m3" in other.caption.replace("\u00a0", " ")
    assert [cell.text.partition(" ")[0] for cell in other.rows[0][4:6]] == ["\u22120.0012", "0.0031"]
    assert one.rows[1][5].text == "0.30"
    assert [(column.unit, cell.text) for column, cell in zip(one.columns, one.rows[1], strict=True)][2:4] == [
        ("ms", "100"),
        ("%", "10.0"),
    ]


def test_coarser_scenes_that_average_no_cells_are_one_row() -> None:
    """ "8 cells" and "4 cells" had the numbers of "all", whose cells are no finer than the pixels need."""
    rows = [{**row(0, 1.0, 0.0), "cells": cells, "averaged": [1]} for cells in (0, 8, 4)] + [row(2, 0.9, 0.3)]
    simulation = {**MEASURED["simulation"], "applications": {"cover": rows}}
    (found,) = tradeoff_blocks({"simulation": simulation}, {"cover": "percent"})
    assert [line[0].text for line in found.rows] == ["all, 8 cells and 4 cells", "2 cells"]
    assert [line[5].text for line in found.rows] == ["0.00", "0.30"]
