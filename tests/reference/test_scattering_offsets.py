"""Crop offsets and field spreads recomputed from the measured Flevoland class values."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from seqrsm.scattering.models import backscatter_ulaby89_db
from seqrsm.scattering.readers import DATA, POLARIZATIONS, read_rows

ALTITUDE_M, NEAR_DEG, SPACING_M = 8000.0, 20.0, 6.66
GROUPS = {
    "short_vegetation": {
        "Wheat": ["Wheat", "Wheat 2", "Wheat 3"],
        "Oats": ["Barley"],
        "Vegetables": ["Stem beans", "Peas", "Beet", "Potatoes"],
    },
    "grass": {"Grass": ["Grass"], "Forage": ["Lucerne"]},
}
OFFSET_COLUMNS = ("category", "frequency_ghz", "polarization", "offset_db", "status", "source")


def flevoland() -> dict[str, dict[str, str]]:
    with open(Path(__file__).parent / "data" / "flevoland_class_sigma0.csv", encoding="utf-8") as stream:
        return {row["class"]: row for row in csv.DictReader(stream)}


def excess(name: str, base: str, channel: str) -> float:
    """Measured class mean less the formula of its base class at the class's mean incidence angle, L band."""
    row = flevoland()[name]
    slant = ALTITUDE_M / np.cos(np.deg2rad(NEAR_DEG)) + SPACING_M * float(row["mean_range_row"])
    theta = np.arccos(ALTITUDE_M / slant)
    columns = ("class", "band", "frequency_ghz", "polarization", "p1", "p2", "p3", "p4", "p5", "p6", "status", "source")
    parameters = next(
        [float(r.text(f"p{i}")) for i in range(1, 7)]
        for r in read_rows(DATA / "ulaby_dobson.csv", columns)
        if (r.text("class"), r.text("band"), r.text("polarization")) == (base, "L", channel)
    )
    return float(row[f"{channel.lower()}_dB"]) - float(backscatter_ulaby89_db(parameters, theta))


def shipped() -> dict[tuple[str, float, str], float]:
    return {
        (r.text("category"), float(r.text("frequency_ghz")), r.text("polarization")): float(r.text("offset_db"))
        for r in read_rows(DATA / "category_offsets.csv", OFFSET_COLUMNS)
    }


@pytest.mark.parametrize("channel", POLARIZATIONS)
@pytest.mark.parametrize("base", list(GROUPS))
def test_differences_between_measured_crops_are_kept(base: str, channel: str) -> None:
    offsets = shipped()
    measured = {c: np.mean([excess(n, base, channel) for n in names]) for c, names in GROUPS[base].items()}
    first = next(iter(measured))
    for category, value in measured.items():
        got = offsets[category, 1.25, channel] - offsets[first, 1.25, channel]
        assert got == pytest.approx(value - measured[first], abs=0.011)


@pytest.mark.parametrize("channel", POLARIZATIONS)
@pytest.mark.parametrize("frequency_ghz", [1.25, 3.0, 5.4])
@pytest.mark.parametrize("group", [("Wheat", "Oats", "Vegetables", "Corn"), ("Grass", "Forage", "Hay")])
def test_offsets_leave_the_class_mean(group: tuple[str, ...], frequency_ghz: float, channel: str) -> None:
    offsets = shipped()
    assert np.mean([offsets[c, frequency_ghz, channel] for c in group]) == pytest.approx(0.0, abs=0.01)


def test_offsets_shrink_with_frequency_as_documented() -> None:
    offsets = shipped()
    for (category, frequency, channel), value in offsets.items():
        if category != "Swamp":
            expected = offsets[category, 1.25, channel] * (1.25 / frequency) ** 0.15
            assert value == pytest.approx(expected, abs=0.011)


def test_only_measured_crops_at_l_band_are_called_computed() -> None:
    measured = {"Rapeseed", *(c for group in GROUPS.values() for c in group)}
    for r in read_rows(DATA / "category_offsets.csv", OFFSET_COLUMNS):
        computed = r.text("category") in measured and r.text("frequency_ghz") == "1.25"
        assert r.text("status") == ("computed" if computed else "assumed")


@pytest.mark.parametrize("channel", POLARIZATIONS)
@pytest.mark.parametrize(
    ("category", "base"),
    [
        ("Wheat", "short_vegetation"),
        ("Vegetables", "short_vegetation"),
        ("Oats", "short_vegetation"),
        ("Forage", "grass"),
    ],
)
def test_field_spread(category: str, base: str, channel: str) -> None:
    """Pooled spread inside the classes and spread of the classes about their mean."""
    rows = [flevoland()[name] for name in GROUPS[base][category]]
    n = np.array([float(row["n_cells_sd"]) for row in rows])
    sd = np.array([float(row[f"{channel.lower()}_sd_dB"]) for row in rows])
    means = [excess(row["class"], base, channel) for row in rows]
    between = np.var(means, ddof=1) if len(means) > 1 else 0.0
    columns = (
        "category",
        "polarization",
        "field_sd_db",
        "field_status",
        "field_source",
        "date_sd_db",
        "date_status",
        "date_source",
    )
    got = next(
        float(r.text("field_sd_db"))
        for r in read_rows(DATA / "variability.csv", columns)
        if (r.text("category"), r.text("polarization")) == (category, channel)
    )
    assert got == pytest.approx(np.sqrt(np.average(sd**2, weights=n) + between), abs=0.006)
