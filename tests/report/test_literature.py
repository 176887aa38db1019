"""The optimum beside the catalogue: which words are asked, and which verdict follows from the printed numbers."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import pytest
from report_dossiers import simulated_dossier

from seqrsm.analysis.results import SettingPosterior
from seqrsm.design.factors import CategoricalFactor
from seqrsm.design.region import Region
from seqrsm.report.sections.literature import (
    _compare_levels,
    _compare_range,
    _fixed,
    catalogue_words,
    comparisons,
    literature_section,
    looked_up,
)


@pytest.mark.parametrize(
    ("name", "description", "asked"),
    [
        ("crop-classification", "", "crop classification"),
        ("ground-cover", "", "land use"),
        ("utility", "How well is soil moisture seen?", "soil moisture"),
        ("best", "radar of the site", None),
        ("mapping", "Hardly any runs, but greater use of this frequency over more applications than one", None),
        ("cover", "Radar für Straße & Feld, e.g. <b>", None),
    ],
)
def test_words_are_the_longest_the_tables_know(name, description, asked):
    found = catalogue_words(name, description, "active")
    assert (None if found is None else found[0]) == asked


def test_a_named_entry_goes_first():
    assert catalogue_words("crop-classification", "", "active", "sea ice") == ("sea ice", "named in campaign.toml")


def test_the_description_of_several_applications_is_about_none_of_them(dossier):
    one = dossier.spec.applications[0].model_copy(update={"name": "best"})
    spec = dataclasses.replace(dossier.spec, description="How well is soil moisture seen?", applications=(one,))
    assert looked_up(spec, "best")[0] == "soil moisture"
    other = one.model_copy(update={"name": "other"})
    assert looked_up(dataclasses.replace(spec, applications=(one, other)), "best") is None


def test_the_key_of_campaign_toml_is_looked_up(dossier):
    application = dossier.spec.applications[0].model_copy(update={"catalog": "soil moisture"})
    spec = dataclasses.replace(dossier.spec, applications=(application,))
    asked, reason, start = looked_up(spec, application.name)
    assert (asked, reason) == ("soil moisture", "named in campaign.toml")
    rows = comparisons(spec, dossier.analyses[0], start)
    assert {"A.16", "A.17"} <= {table for row in rows for table in row.tables.split(", ")}


@pytest.fixture(scope="module")
def dossier(tmp_path_factory):
    return simulated_dossier(tmp_path_factory.mktemp("literature"), draws=200)


def rows_of(spec, analysis):
    _, _, start = looked_up(spec, analysis.application)
    return {row.parameter: row for row in comparisons(spec, analysis, start)}


def with_optimum(dossier, name, value, low, high):
    analysis = dossier.analyses[0]
    settings = {**analysis.optimum.settings, name: value}
    rows = tuple(
        SettingPosterior(name, value, low, high, 0.0, {}) if row.factor == name else row
        for row in analysis.posterior.settings
    )
    return dataclasses.replace(
        analysis,
        optimum=dataclasses.replace(analysis.optimum, settings=settings),
        posterior=dataclasses.replace(analysis.posterior, settings=rows),
    )


# Table A.16, Crop Classification: 1 to 2 frequencies between 9 and 36 GHz with A.12; nadir angle 40 to 50, best 50.
@pytest.mark.parametrize(
    ("value", "low", "high", "verdict"),
    [(12.0, 11.0, 13.0, "agrees"), (7.0, 5.0, 9.5, "not excluded"), (3.0, 2.0, 4.0, "differs")],
)
def test_verdict_follows_from_the_printed_range(dossier, value, low, high, verdict):
    rows = rows_of(dossier.spec, with_optimum(dossier, "frequency", value, low, high))
    assert rows["frequency"].verdict == verdict
    assert rows["frequency"].printed.startswith("9 to 36")
    assert rows["frequency"].tables == "A.12, A.16"


def test_polarization_is_compared_by_channels(dossier):
    row = rows_of(dossier.spec, with_optimum(dossier, "polarization", "HV", 0.0, 0.0))["polarization"]
    assert row.verdict == "differs"
    assert "HV" in row.why
    found = rows_of(dossier.spec, with_optimum(dossier, "polarization", "VV", 0.0, 0.0))
    assert found["polarization"].verdict == "agrees"


@pytest.mark.parametrize(
    ("levels", "verdict", "why"),
    [
        (("L", "X", "L+X"), "not excluded", "X within the printed range"),
        (("L", "C", "12"), "agrees", "within the printed range"),
        (("9.6", "L+1.2"), "differs", "outside the printed range"),
        (("L", "L+P"), "not comparable", "the campaign's region lies outside"),
        (("X", "wide"), "not comparable", "no numbers"),
    ],
)
def test_a_band_or_set_of_bands_is_compared(dossier, levels, verdict, why):
    """Sets were left out: 2 of 2 comparable parameters agreed."""
    best = SimpleNamespace(settings={"frequency": levels[-1]})
    analysis = SimpleNamespace(region=Region((CategoricalFactor("frequency", levels),)), optimum=best)
    ranges = looked_up(dossier.spec, dossier.analyses[0].application)[2].ranges
    row = _compare_range(dossier.spec, analysis, next(one for one in ranges if one.name == "frequency"))
    assert (row.verdict, row.found) == (verdict, f"{levels[-1]} (of {', '.join(levels)})")
    assert why in row.why


def test_a_phase_is_not_compared(dossier):
    """The tables name channels alone."""
    item = looked_up(dossier.spec, dossier.analyses[0].application)[2].polarization
    found = []
    for best in ("HH+VV+phase", "HH+VV"):
        optimum = dataclasses.replace(dossier.analyses[0].optimum, settings={"polarization": best})
        found.append(_compare_levels(dossier.spec, dataclasses.replace(dossier.analyses[0], optimum=optimum), item))
    assert [one.found.split(" ")[0] for one in found] == ["HH+VV+phase", "HH+VV"]
    assert found[0].verdict == found[1].verdict != "not comparable"


@pytest.mark.parametrize("name", ["resolution", "resolution_m"])
def test_a_fixed_value_is_compared_by_either_of_its_names(dossier, name):
    simulator = dossier.spec.simulator.model_copy(update={"fixed": {name: 25.0}})
    row = rows_of(dataclasses.replace(dossier.spec, simulator=simulator), dossier.analyses[0])["resolution"]
    assert row.found == "25\u00a0m, held fixed"


def test_no_entry_is_said(dossier):
    (one,) = dossier.spec.applications
    applications = (one.model_copy(update={"name": "xyzzy"}),)
    spec = dataclasses.replace(dossier.spec, description="", applications=applications)
    analysis = dataclasses.replace(dossier.analyses[0], application="xyzzy")
    section = literature_section(dataclasses.replace(dossier, spec=spec, analyses=(analysis,)))
    assert "no radar entry" in section.blocks[0].text


def test_without_a_common_parameter_there_is_no_empty_table(dossier, monkeypatch):
    monkeypatch.setattr("seqrsm.report.sections.literature.comparisons", lambda *_: [])
    section = literature_section(dossier)
    assert "cannot be compared" in section.blocks[0].text
    assert len(section.blocks) == len(dossier.analyses)


@pytest.mark.parametrize("own", [{"C": {"bandwidth": 20.0}}, {"C": {"engine": "prm", "polarization": "H"}}])
def test_a_value_that_a_sensor_of_the_set_replaces_is_not_compared(dossier, own):
    """It would be said of a sensor that has another."""
    fixed = {**dossier.spec.simulator.fixed, "bandwidth": 5.0}
    simulator = dossier.spec.simulator.model_copy(update={"fixed": fixed, "members": own})
    spec = dataclasses.replace(dossier.spec, simulator=simulator)
    assert _fixed(spec, "bandwidth") == (None if "bandwidth" in own["C"] else 5.0)
