"""The summary of the report, the terminal and ``fit --json`` give one and the same numbers."""

from __future__ import annotations

import csv
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from statsmodels.api import OLS
from statsmodels.stats.outliers_influence import OLSInfluence
from typer.testing import CliRunner

from seqrsm.campaign.campaign import Campaign
from seqrsm.campaign.dossier import assemble
from seqrsm.cli.app import app
from seqrsm.report.blocks import Bullets, Details, KeyFigures, Paragraph, Table
from seqrsm.report.content import build_report
from seqrsm.report.figures.fit import read_looks
from seqrsm.report.sections.model import diagnostics_section, importance_section, model_section

TEXT = """\
[campaign]
name = "same numbers"
seed = 11
[[factor]]
name = "frequency"
unit = "GHz"
low = 1.0
high = 16.0
scale = "log"
[[factor]]
name = "resolution"
unit = "m"
low = 5.0
high = 40.0
[[factor]]
name = "polarization"
levels = ["HH", "VV"]
[[application]]
name = "crops"
utility = "percent_correct"
[cost]
flight = 12.5
[stop]
interval = "prediction_mean"
half_width = 0.7
level = 0.9
max_runs = 70
"""
NUMBER = re.compile(r"(?<![\w.])[-\u2212]?\d+(?:\.\d+)?")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("same") / "campaign"
    folder.mkdir()
    (folder / "campaign.toml").write_text(TEXT, encoding="utf-8")
    rng = np.random.default_rng(4)
    rows = ["frequency,resolution,polarization,score"]
    for i in range(40):
        t, u = rng.uniform(-1, 1, 2) if i > 5 else (0.0, 0.0)
        f, r, p = 4.0 * 4.0**t, 22.5 + 17.5 * u, ("HH", "VV")[i % 2]
        score = 71 + 2 * t - 6 * t**2 - 3 * u - 4 * u**2 + (1.5 if p == "VV" else -1.5) + rng.normal()
        rows.append(f"{f:.6f},{r:.6f},{p},{score:.4f}")
    (folder / "scores.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    assert CliRunner().invoke(app, ["ingest", str(folder), str(folder / "scores.csv")]).exit_code == 0
    return folder


@pytest.fixture(scope="module")
def document(folder: Path) -> dict:
    return json.loads(CliRunner().invoke(app, ["fit", str(folder), "--json"]).stdout)


@pytest.fixture(scope="module")
def terminal(folder: Path) -> str:
    return CliRunner().invoke(app, ["fit", str(folder)], env={"COLUMNS": ""}).stdout


@pytest.fixture(scope="module")
def summary(folder: Path) -> list:
    found = build_report(assemble(Campaign.open(folder), lambda text: None)).sections[0]
    return [block for section in (found, *found.sections) for block in section.blocks]


def plain(text: str) -> str:
    return text.replace("\u00a0", " ").replace("\u2212", "-")


def shown(text: str) -> list[float]:
    return [float(number) for number in NUMBER.findall(plain(text))]


def agree(text: str, *values: float) -> None:
    """Numbers of a text are these values, each to the last digit shown."""
    found = NUMBER.findall(plain(text))
    assert len(found) == len(values), (text, values)
    for number, value in zip(found, values, strict=True):
        step = 10.0 ** -len(number.partition(".")[2])
        assert abs(float(number) - value) <= 0.5 * step * (1 + 1e-9), (text, number, value)
        assert float(number) == value or step <= 0.1 * max(abs(value), 1.0), f"{number} shows too little of {value}"


def test_key_figures_are_those_of_the_document(summary, document):
    (figures,) = (block for block in summary if isinstance(block, KeyFigures))
    by_label = {item.label: item for item in figures.items}
    best = document["optimum"]
    agree(by_label["Mean score"].value, best["mean"])
    agree(by_label["Mean score"].detail, 90, best["confidence"]["low"], best["confidence"]["high"])
    agree(by_label["One future run"].value, best["prediction"]["low"], best["prediction"]["high"])
    agree(by_label["Stop-rule half-width"].value, document["stop"]["half_width"])
    assert document["stop"]["half_width"] == pytest.approx(best["prediction_mean"]["half_width"])
    agree(by_label["Stop-rule half-width"].detail, 0.7, 5)
    agree(by_label["Runs in the fit"].value, document["n_runs"])
    agree(by_label["Runs in the fit"].detail, document["n_terms"], 70)
    most = max(document["factors_importance"], key=lambda row: row["f"])
    assert by_label["Most important factor"].value == most["factor"]
    assert shown(by_label["Most important factor"].detail)[0] == pytest.approx(most["f"], rel=5e-3)


def test_recommended_settings_are_those_of_the_document(summary, document):
    (table,) = (block for block in summary if isinstance(block, Table))
    settings, posterior = document["optimum"]["settings"], document["posterior"]["optimum"]["settings"]
    rows = {row[0].text.partition(" [")[0]: [cell.text for cell in row] for row in table.rows}
    assert set(rows) == set(settings)
    for name in ("frequency", "resolution"):
        agree(rows[name][1], settings[name])
        low, high = shown(rows[name][2])
        assert low == pytest.approx(posterior[name]["low"], rel=0.02)
        assert high == pytest.approx(posterior[name]["high"], rel=0.02)
    assert rows["polarization"][1] == settings["polarization"]
    lead = next(block.text for block in summary if isinstance(block, Paragraph) and block.tone == "lead")
    for name in ("frequency", "resolution"):
        assert rows[name][1] in plain(lead)


def every_text(summary) -> list[str]:
    found = []
    for block in summary:
        if isinstance(block, Paragraph):
            found.append(block.text)
        elif isinstance(block, Bullets):
            found += block.items
        elif isinstance(block, KeyFigures):
            found += [text for item in block.items for text in (item.label, item.value, item.detail)]
        elif isinstance(block, Table):
            found += [cell.text for row in block.rows for cell in row]
    return found


def leaves(node) -> list[float]:
    if isinstance(node, dict):
        return [value for child in node.values() for value in leaves(child)]
    if isinstance(node, list):
        return [value for child in node for value in leaves(child)]
    if isinstance(node, str):
        return shown(node)
    return [float(node)] if isinstance(node, int | float) and not isinstance(node, bool) else []


def unknown_numbers(summary, document) -> list[str]:
    """Numbers of the summary with three digits or more that no number of the document rounds to."""
    known = np.array(leaves(document))
    known = np.concatenate([known, 100.0 * known])
    found = []
    for text in every_text(summary):
        for match in NUMBER.finditer(plain(text)):
            number = match[0]
            if len(number.strip("-").replace(".", "").lstrip("0")) < 3:
                continue
            step = 10.0 ** -len(number.partition(".")[2])
            if plain(text)[: match.start()].endswith("> "):  # a percentage that would round to 100
                shows = (known > float(number)) & (known <= 100.0)
            else:
                shows = np.abs(known - float(number)) <= 0.5 * step * (1 + 1e-9)
            if not np.any(shows):
                found.append(f"{number} in {text}")
    return found


def test_every_number_of_the_summary_is_in_the_document(summary, document):
    # the cost of the runs is the campaign's, not the fit's
    assert [text for text in unknown_numbers(summary, document) if "They cost" not in text] == []
    # The check can fail: of so many numbers some are near any other one, but not by every shift.
    missed = set()
    for shift in (1.01, 1.02, 1.05):
        moved = json.loads(json.dumps(document), parse_float=lambda text, by=shift: by * float(text) + 0.003)
        missed |= set(unknown_numbers(summary, moved))
    assert len(missed) > 5


def test_the_terminal_shows_the_numbers_of_the_summary(summary, terminal):
    (figures,) = (block for block in summary if isinstance(block, KeyFigures))
    (table,) = (block for block in summary if isinstance(block, Table))
    by_label = {item.label: plain(item.value) for item in figures.items}
    for label in ("Mean score", "One future run"):
        assert by_label[label] in terminal
    for row in table.rows:
        for cell in row[1:]:
            assert plain(cell.text) in terminal
    for block in summary:
        if isinstance(block, Bullets):
            for item in block.items:
                assert plain(item) in terminal, item
    verdict = next(plain(text) for text in every_text(summary) if "Expected loss" in text)
    loss = re.search(r"true optimum: (.*?); probability of losing more than (.*?): (.*)\.", verdict)
    assert loss is not None
    for text in loss.groups():
        assert text in terminal
    importance = plain(next(i.detail for i in figures.items if i.label == "Most important factor"))
    assert re.search(r"F = ([\d.]+)", importance)[1] in terminal


def test_tables_of_the_model_are_those_of_the_document(folder, document):
    (analysis,) = assemble(Campaign.open(folder), lambda text: None).analyses
    shares = next(block for block in importance_section(analysis, "k").blocks if isinstance(block, Table))
    of_factor = {row["factor"]: row for row in document["factors_importance"]}
    assert [column.title for column in shares.columns[-2:]] == ["Main effect", "Total effect"]
    for row in shares.rows:
        own = of_factor[row[0].text]
        agree(row[1].text, own["df"])
        agree(row[4].text, 100.0 * own["share"])
        agree(row[5].text, 100.0 * own["share_total"])
    assert any(row[4].text != row[5].text for row in shares.rows)
    details = next(block for block in model_section(analysis, "k").blocks if isinstance(block, Details))
    (terms,) = details.blocks
    assert [column.title for column in terms.columns[-2:]] == ["Posterior mean", "Posterior sd"]
    for row, fitted, drawn in zip(terms.rows, document["terms"], document["posterior"]["terms"], strict=True):
        agree(row[1].text, fitted["coded"]["estimate"])
        agree(row[2].text, fitted["coded"]["se"])
        agree(row[7].text, drawn["mean"])
        agree(row[8].text, drawn["sd"])


def test_the_share_of_small_residuals_is_that_of_statsmodels(folder):
    (analysis,) = Campaign.open(folder).analyse_all()
    found = OLSInfluence(OLS(analysis.fit.y, analysis.fit.Z).fit()).resid_studentized_external
    (told,) = (block for block in diagnostics_section(analysis, "k").blocks if isinstance(block, Bullets))
    share = f"{100.0 * np.mean(np.abs(found) <= 2.0):.0f} % of the studentised residuals lie within -2 and 2."
    assert plain(told.items[-1]) == share


def test_progress_ends_with_the_numbers_of_the_summary(folder: Path, tmp_path: Path) -> None:
    """Scores that came since the last proposal were on page 1 and not in the table of interim analyses."""
    own = tmp_path / "campaign"
    shutil.copytree(folder, own)
    form, rng = own / "form.csv", np.random.default_rng(5)
    assert CliRunner().invoke(app, ["propose", str(own), "-n", "6", "--csv", str(form)]).exit_code == 0
    header, *rows = csv.reader(form.read_text(encoding="utf-8").splitlines())
    for row in rows:
        row[header.index("score")] = f"{rng.normal(70.0, 2.0):.3f}"
    form.write_text("\n".join(",".join(row[:-1]) for row in [header, *rows]), encoding="utf-8")
    assert CliRunner().invoke(app, ["ingest", str(own), str(form)]).exit_code == 0
    dossier = assemble(Campaign.open(own))
    (analysis,) = dossier.analyses
    *_, before, last = read_looks(dossier.looks, "crops")
    assert (before.n_runs, last.n_runs) == (40, 46)
    assert (last.half_width, last.mean) == (analysis.decision.half_width, analysis.optimum.mean)
    assert last.loss == analysis.posterior.expected_regret
