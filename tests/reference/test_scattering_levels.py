"""Levels and field spreads of the covers recomputed from what was measured, and the table held against it."""

from __future__ import annotations

import csv
import sys
from collections import defaultdict
from functools import lru_cache
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
import scipy

from seqrsm.scattering.models import backscatter_ulaby89_db
from seqrsm.scattering.readers import POLARIZATIONS, shipped_rows
from seqrsm.scattering.sigma0 import load_sigma0_table
from seqrsm.scattering.worlds import World
from seqrsm.scene.layers import categories_of_fields
from seqrsm.simulate.visits import ANGLE_DEG, related_fields

sys.path.insert(0, str(Path(__file__).parents[1] / "studies"))
import validate_flevoland

ALTITUDE_M, NEAR_DEG, SPACING_M = 8000.0, 20.0, 6.66
TABLE = load_sigma0_table()
GROUPS = {
    "short_vegetation": {
        "Wheat": ["Wheat", "Wheat 2", "Wheat 3"],
        "Oats": ["Barley"],
        "Vegetables": ["Stem beans", "Peas", "Beet", "Potatoes"],
        "Rapeseed": ["Rapeseed"],
    },
    "grass": {"Grass": ["Grass"], "Forage": ["Lucerne"]},
}
SITES = {
    "s1_france_w": "France W 2022-23",
    "s1_central_europe": "Central/North Europe 2017-21",
    "s1_flanders": "Flanders 2020-21",
    "s1_flevoland_potato": "Flevoland 2018",
}
FLIGHT_1991 = {
    "winter wheat": "Wheat",
    "barley": "Oats",
    "rapeseed": "Rapeseed",
    "grass": "Grass",
    "lucerne": "Forage",
    "potatoes": "Vegetables",
    "beans": "Vegetables",
    "peas": "Vegetables",
    "sugar beet": "Vegetables",
}


def data(name: str) -> list[dict[str, str]]:
    with open(Path(__file__).parent / "data" / name, encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


@lru_cache(maxsize=1)
def flevoland() -> dict[str, dict[str, str]]:
    return {row["class"]: row for row in data("flevoland_class_sigma0.csv")}


def incidence_deg(range_place: str) -> float:
    """Of a place across the swath of a flight over Flevoland."""
    slant = ALTITUDE_M / np.cos(np.deg2rad(NEAR_DEG)) + SPACING_M * float(range_place)
    return float(np.degrees(np.arccos(ALTITUDE_M / slant)))


def theta_deg(name: str) -> float:
    """Mean incidence angle of a class of the flight."""
    return incidence_deg(flevoland()[name]["mean_range_row"])


@lru_cache(maxsize=1)
def flight_1991() -> dict[str, dict[str, str]]:
    """Mean power [dB] of the samples of each crop; HV is half of the second element of a covariance matrix."""
    samples: dict[str, list[dict[str, str]]] = defaultdict(list)
    for row in data("flevoland_c_band.csv"):
        samples[row["class"]].append(row)
    return {
        crop: rows[0]
        | {
            f"{p.lower()}_dB": str(10.0 * np.log10(share * np.mean([float(row[c]) for row in rows])))
            for p, c, share in (("HH", "c11", 1.0), ("HV", "c22", 0.5), ("VV", "c33", 1.0))
        }
        for crop, rows in samples.items()
        if crop in FLIGHT_1991
    }


def formula_db(base: str, band: str, channel: str, theta: float) -> float:
    """Regression of a base class at an incidence angle [deg]."""
    parameters = next(
        [float(r.text(f"p{i}")) for i in range(1, 7)]
        for r in shipped_rows("ulaby_dobson.csv")
        if (r.text("class"), r.text("band"), r.text("polarization")) == (base, band, channel)
    )
    return float(backscatter_ulaby89_db(parameters, np.deg2rad(theta)))


def base_of(category: str) -> str:
    return "grass" if category in (*GROUPS["grass"], "Hay") else "short_vegetation"


def levels_of_1991(sentinel: dict[tuple[str, str, str], float]) -> dict[tuple[str, str, str], float]:
    """Less the course of 15 June, and less what the categories lie above Sentinel-1 on average, in VV and in HV."""
    own = {
        (crop, p): float(row[f"{p.lower()}_dB"]) - db(FLIGHT_1991[crop], 5.4, p, 40.0, day=166)
        + db(FLIGHT_1991[crop], 5.4, p, 40.0)
        for crop, row in flight_1991().items()
        for p in POLARIZATIONS
    }  # fmt: skip
    rows = [r for r in shipped_rows("levels.csv") if r.text("source") in SITES]
    above = {}
    for p in ("HV", "VV"):
        off = []
        for category in set(FLIGHT_1991.values()):
            base, crops = base_of(category), [crop for crop, of in FLIGHT_1991.items() if of == category]
            at_38 = [
                own[crop, p]
                + formula_db(base, "C", p, 38.0)
                - formula_db(base, "C", p, incidence_deg(flight_1991()[crop]["mean_range_column"]))
                for crop in crops
            ]
            by_site: dict[str, list[float]] = defaultdict(list)
            for r in rows:
                if (r.text("category"), r.text("polarization")) == (category, p):
                    by_site[r.text("source")].append(sentinel[r.text("source"), r.text("cover"), p])
            off.append(np.mean(at_38) - np.mean([np.mean(v) for v in by_site.values()]))
        above[p] = float(np.mean(off))
    above["HH"] = above["VV"]
    assert (above["VV"], above["HV"]) == (pytest.approx(3.97, abs=0.006), pytest.approx(1.84, abs=0.006))
    return {("flevoland_1991", crop, p): value - above[p] for (crop, p), value in own.items()}


def measured() -> dict[tuple[str, str, str], float]:
    """Level by (source, cover, channel)."""
    found = {}
    for name, row in flevoland().items():
        found.update({("flevoland", name.lower(), p): float(row[f"{p.lower()}_dB"]) for p in POLARIZATIONS})
    fields: dict[tuple[str, str, str], list[float]] = defaultdict(list)
    for row in data("smapvex12_lband.csv"):
        for p in POLARIZATIONS:
            if row[p]:
                fields[row["crop"].removesuffix(" (canola)"), row["field"], p].append(float(row[p]))
    for crop, p in {(crop, p) for crop, _, p in fields}:
        found["smapvex12", crop, p] = np.mean([np.mean(v) for k, v in fields.items() if (k[0], k[2]) == (crop, p)])
    months: dict[tuple[str, str, str], list[float]] = defaultdict(list)
    for row in data("sentinel1_monthly.csv"):
        months[row["site"], row["crop"], row["polarization"].replace("VH", "HV")].append(float(row["mean_db"]))
    for source, site in SITES.items():
        found.update({(source, crop, p): np.mean(v) for (s, crop, p), v in months.items() if s == site})
    return found | levels_of_1991(found)


def excess(name: str, base: str, channel: str) -> float:
    """Measured class mean less the formula of its base class at the class's mean incidence angle, L band."""
    return float(flevoland()[name][f"{channel.lower()}_dB"]) - formula_db(base, "L", channel, theta_deg(name))


def db(category: str, frequency_ghz: float, channel: str, theta: float, day: float | None = None) -> float:
    found = TABLE.lookup([category], frequency_ghz, channel, day=day)
    return float(np.interp(theta, found.theta_deg, 10.0 * np.log10(found.sigma0[0])))


def test_every_measured_level_is_what_its_source_says() -> None:
    known = measured()
    rows = [r for r in shipped_rows("levels.csv") if r.text("status") == "measured"]
    assert len(rows) == 109
    for r in rows:
        key = r.text("source"), r.text("cover"), r.text("polarization")
        assert float(r.text("sigma0_db")) == pytest.approx(known[key], abs=0.006), key
        if key[0] == "flevoland":
            name = next(n for n in flevoland() if n.lower() == key[1])
            assert float(r.text("theta_deg")) == pytest.approx(theta_deg(name), abs=0.06)
        if key[0] == "flevoland_1991":
            place = flight_1991()[key[1]]["mean_range_column"]
            assert float(r.text("theta_deg")) == pytest.approx(incidence_deg(place), abs=0.06)


def co_difference(category: str, theta: float) -> float:
    """HH less VV of the regression of the category's class in C band."""
    return formula_db(base_of(category), "C", "HH", theta) - formula_db(base_of(category), "C", "VV", theta)


def test_hh_of_c_band_differs_from_vv_half_as_on_the_only_ground_where_both_were_measured() -> None:
    """Half-way between the difference on the flight of 1991 and its mean over covers, which others have."""
    flown: dict[str, list[float]] = defaultdict(list)
    for crop, row in flight_1991().items():
        category = FLIGHT_1991[crop]
        # The course of a cereal's HH on that day is half that of VV.
        day = [db(category, 5.4, p, 40.0, day=166) - db(category, 5.4, p, 40.0) for p in ("HH", "VV")]
        there = co_difference(category, incidence_deg(row["mean_range_column"]))
        flown[category].append(float(row["hh_dB"]) - float(row["vv_dB"]) - day[0] + day[1] - there)
    middle = np.mean([np.mean(off) for off in flown.values()])
    expected = {c: 0.5 * (np.mean(off) + middle) for c, off in flown.items()} | {"Corn": middle, "Hay": middle}
    own = {c: db(c, 5.4, "HH", 38.0) - db(c, 5.4, "VV", 38.0) - co_difference(c, 38.0) for c in expected}
    assert own == pytest.approx(expected, abs=0.02)


@pytest.mark.parametrize("channel", POLARIZATIONS)
def test_l_band_is_where_the_flight_found_it(channel: str) -> None:
    """Covers of the flight: rms 2.0 dB from the table, which expects less of each than one ground has; no mean shift.

    Until levels were measured ones, crops and grass lay 5 to 11 dB below the flight.
    """
    covers = {c: names for groups in GROUPS.values() for c, names in groups.items()}
    covers |= {"Trees": ["Forest"], "Bareground": ["Bare soil"]}
    off = [
        db(c, 1.25, channel, theta_deg(n)) - float(flevoland()[n][f"{channel.lower()}_dB"])
        for c, names in covers.items()
        for n in names
    ]
    assert abs(np.mean(off)) < 1.0
    assert np.sqrt(np.mean(np.square(off))) < 2.1


def test_bare_soil_is_brighter_at_vv_than_at_hh() -> None:
    """The flight: HH less VV -3.1 dB at 40 degrees; bare soil of western France over a year, C band: -10.6 dB."""
    assert -3.1 < db("Bareground", 1.25, "HH", 40.4) - db("Bareground", 1.25, "VV", 40.4) < -1.5
    assert db("Bareground", 5.4, "VV", 38.0) == pytest.approx(-10.61, abs=1.0)
    assert db("Bareground", 5.4, "HV", 38.0) == pytest.approx(-19.74, abs=2.0)


def test_bare_soil_lies_as_near_to_i2em_as_its_error_says() -> None:
    """Oh 2004 knows no correlation length: over those of fields (8 to 20 cm) and L to X band, as far as stated."""
    off = []
    with open(Path(__file__).parent / "data" / "i2em_soil.csv", encoding="utf-8") as stream:
        for row in csv.DictReader(line for line in stream if line[0] != "#"):
            for channel in ("HH", "VV"):
                found = TABLE.lookup(("Bareground",), float(row["frequency_ghz"]), channel)
                own = 10.0 * np.log10(found.sigma0[0, int(row["theta_deg"])])
                off.append((own - float(row[f"{channel.lower()}_db"])) / found.mean_sd_db[0])
    assert len(off) == 96
    assert np.sqrt(np.mean(np.square(off))) < 1.2
    assert np.mean(np.abs(off) < 2.0) > 0.9


def test_crops_of_a_site_that_no_level_rests_on_lie_as_near_as_their_error_says() -> None:
    """C band, full canopies of mid-July: seven means, of which twice the stated error should hold all."""
    covers = {"soybean": "Vegetables", "wheat": "Wheat", "corn": "Corn"}
    off = []
    with open(Path(__file__).parent / "data" / "c_band_canopies.csv", encoding="utf-8") as stream:
        for row in csv.DictReader(line for line in stream if line[0] != "#"):
            found = TABLE.lookup((covers[row["crop"]],), 5.4, row["polarization"], day=196)
            own = 10.0 * np.log10(found.sigma0[0, int(row["theta_deg"])])
            off.append((own - float(row["sigma0_db"])) / found.mean_sd_db[0])
    assert len(off) == 7
    assert 0.5 < np.sqrt(np.mean(np.square(off))) < 1.4
    assert np.max(np.abs(off)) < 2.3


def test_crops_differ_by_themselves_at_c_band() -> None:
    """C-band differences are measured at C band, not L-band differences carried there."""
    assert db("Wheat", 5.4, "VV", 38.0) == pytest.approx(-11.1, abs=0.1)
    assert db("Corn", 5.4, "VV", 38.0) == pytest.approx(-9.8, abs=0.1)
    assert db("Vegetables", 1.25, "VV", 40.0) - db("Wheat", 1.25, "VV", 40.0) > 1.2
    assert abs(db("Vegetables", 5.4, "VV", 38.0) - db("Wheat", 5.4, "VV", 38.0)) < 1.0


def lifts() -> dict[tuple[str, str], dict[str, dict[str, float]]]:
    """Measured levels above the regressions of their classes [dB], by band and channel, cover and ground."""
    found: dict[tuple[str, str], dict[str, dict[str, list[float]]]] = defaultdict(lambda: defaultdict(dict))
    for r in shipped_rows("levels.csv"):
        if r.text("status") == "measured":
            category, channel = r.text("category"), r.text("polarization")
            band = "L" if r.text("frequency_ghz") == "1.25" else "C"
            above = float(r.text("sigma0_db")) - formula_db(
                base_of(category), band, channel, float(r.text("theta_deg"))
            )
            found[band, channel][category].setdefault(r.text("source"), []).append(above)
    return {
        place: {c: {s: float(np.mean(v)) for s, v in of.items()} for c, of in covers.items()}
        for place, covers in found.items()
    }


@pytest.mark.parametrize(("band", "ghz"), [("L", 1.25), ("C", 5.4)])
@pytest.mark.parametrize("channel", ["HV", "VV"])
def test_a_level_is_what_the_equations_of_a_mixed_model_expect_of_another_ground(band: str, ghz: float, channel: str):
    """Henderson's equations, with effects of covers that have the variance of what grounds add to each."""
    covers = lifts()[band, channel]
    rows = [(k, value) for k, of in enumerate(covers.values()) for value in of.values()]
    z = np.array([[k == j for j in range(len(covers))] for k, _ in rows], dtype=float)
    middle = np.mean([np.mean([*of.values()]) for of in covers.values()])
    effects = np.linalg.solve(z.T @ z + np.eye(len(covers)), z.T @ (np.array([value for _, value in rows]) - middle))
    for category, effect in zip(covers, effects, strict=True):
        expected = middle + effect + formula_db(base_of(category), band, channel, 40.0)
        assert db(category, ghz, channel, 40.0) == pytest.approx(expected, abs=0.02), category


@pytest.mark.parametrize("channel", POLARIZATIONS)
def test_an_assumed_level_stays_as_it_is(channel: str) -> None:
    """Hay in L band, mean of what is expected of grass and forage."""
    (row,) = (r for r in shipped_rows("levels.csv") if r.text("source") == "assumed_kin" and
              (r.text("category"), r.text("polarization")) == ("Hay", channel))  # fmt: skip
    assert db("Hay", 1.25, channel, 40.0) == pytest.approx(float(row.text("sigma0_db")), abs=0.01)
    kin = [db(category, 1.25, channel, 40.0) for category in ("Grass", "Forage")]
    assert np.mean(kin) == pytest.approx(float(row.text("sigma0_db")), abs=0.1)


def test_levels_drawn_to_their_middle_foretell_a_ground_that_was_left_out() -> None:
    """Contrasts of its covers: an error of 2.7 dB with the means of other grounds, of 2.2 dB with those drawn so."""
    left: dict[int, list[float]] = {0: [], 1: []}
    for covers in lifts().values():
        grounds = {s for of in covers.values() for s in of}
        for ground in grounds if len(grounds) > 1 else ():
            others = {c: [v for s, v in of.items() if s != ground] for c, of in covers.items()}
            middle = np.mean([np.mean(v) for v in others.values() if v])
            both = [c for c, v in others.items() if v and ground in covers[c]]
            for more, found in left.items():
                off = [covers[c][ground] - np.mean([*others[c], *[middle] * more]) for c in both]
                found += list(np.square(off - np.mean(off))) if len(both) > 1 else []
    plain, drawn = (np.sqrt(np.mean(found)) for found in left.values())
    assert drawn < 0.85 * plain


@pytest.mark.parametrize(("band", "ghz", "channels"), [("L", 1.25, POLARIZATIONS), ("C", 5.4, ("HV", "VV"))])
def test_crops_of_a_world_are_as_far_apart_as_those_of_a_measured_ground(
    band: str, ghz: float, channels: tuple[str, ...]
) -> None:
    """Variance between covers: with plain means of two grounds in L band, worlds had 1.7 times that of a ground.

    L-band flights met the weather of a date, which a run draws; C-band levels are means of months.
    """
    measured, drawn = [], []
    worlds = [TABLE.in_world(World(1979, k)) for k in range(60)]
    for channel in channels:
        covers = lifts()[band, channel]
        squares, freedom = 0.0, 0
        for ground in {s for of in covers.values() for s in of}:
            level = [
                of[ground] + formula_db(base_of(c), band, channel, 40.0) for c, of in covers.items() if ground in of
            ]
            squares, freedom = squares + np.var(level) * len(level), freedom + len(level) - 1
        measured.append(squares / freedom)
        there = [10.0 * np.log10(world.lookup([*covers], ghz, channel).sigma0[:, 40]) for world in worlds]
        of_dates = np.mean(np.square(TABLE.lookup([*covers], ghz, channel).date_sd_db)) if band == "L" else 0.0
        drawn.append(np.mean(np.var(there, axis=1, ddof=1)) + of_dates)
    assert np.mean(drawn) == pytest.approx(np.mean(measured), rel=0.2)


@pytest.mark.parametrize("channel", ["HV", "VV"])
@pytest.mark.parametrize(
    ("category", "crops"),
    [
        ("Wheat", ["winter wheat"]),
        ("Rapeseed", ["winter rapeseed"]),
        ("Vegetables", ["faba bean", "potato", "spring pea"]),
    ],
)
def test_change_from_date_to_date(category: str, crops: list[str], channel: str) -> None:
    """Months of a crop less those of all crops of the site."""
    level = {
        (r["site"], r["crop"], int(r["month"])): float(r["mean_db"])
        for r in data("sentinel1_monthly.csv")
        if r["polarization"].replace("VH", "HV") == channel
    }
    months, total, df = (5, 6, 7, 8), 0.0, 0
    for site in {s for s, _, _ in level}:
        everyone = [[x for (s, _, m), x in level.items() if (s, m) == (site, month)] for month in months]
        common = np.array([np.mean(x) if len(x) >= 3 else 0.0 for x in everyone])
        for crop in crops:
            if all((site, crop, month) in level for month in months):
                own = np.array([level[site, crop, month] for month in months]) - common
                total, df = total + float(np.sum((own - own.mean()) ** 2)), df + 3
    assert TABLE.variability[category, channel].date_sd_db == pytest.approx(np.sqrt(total / df), abs=0.006)


def test_a_settlement_is_the_mixture_of_its_parts() -> None:
    parts = TABLE.lookup(["Buildings", "Asphalt", "Grass"], 3.0, "HV").sigma0
    np.testing.assert_allclose(
        TABLE.lookup(["Settlement"], 3.0, "HV").sigma0[0, :75],
        (0.15 * parts[0] + 0.3 * parts[1] + 0.55 * parts[2])[:75],
    )


@pytest.mark.parametrize("channel", POLARIZATIONS)
@pytest.mark.parametrize(
    "category", ["Wheat", "Oats", "Vegetables", "Rapeseed", "Grass", "Forage", "Corn", "Hay", "Bareground"]
)
def test_field_spread(category: str, channel: str) -> None:
    """Spread of whole fields inside the classes, drawn to that of two grounds, and of the classes about their mean.

    Most classes of the flight have two to five fields, maize and hay none; the one field of bare soil tells nothing.
    """
    base = base_of(category)
    classes = GROUPS[base].get(category, [])
    means = [excess(name, base, channel) for name in classes]
    between = np.var(means, ddof=1) if len(means) > 1 else 0.0
    squares, freedom = (
        sum(x) for x in zip(*(squares_of_fields(name, channel) for name in classes), (0.0, 0), strict=True)
    )
    within = (PRIOR_FREEDOM * variance_of_fields(channel) + squares) / (PRIOR_FREEDOM + freedom)
    got = field_sd_db(category, channel, "field_sd_db")
    assert got == pytest.approx(np.sqrt(within + between), abs=0.006)


PRIOR_FREEDOM = 6
"""As the variances of the classes with three fields or more differ by (Smyth 2004: 6.4, 3.3 and 8.0, HH, HV, VV)."""


@lru_cache(maxsize=64)
def squares_of_fields(name: str, channel: str) -> tuple[float, int]:
    """Sum of squares of the means of a class's fields of 20 cells or more about their mean [dB2], and its freedom."""
    with np.load(validate_flevoland.OUT / "flevoland_fields.npz") as archive:
        mean = archive[f"{channel.lower()}_db"].astype(np.float64)
    labels = validate_flevoland.scene()
    place = [one.split(" (")[0] for one in labels.categories].index(name)
    own = mean[(validate_flevoland.labelled_cells() >= 20) & (categories_of_fields(labels) == place)]
    return float(np.sum((own - own.mean()) ** 2)), len(own) - 1


@lru_cache(maxsize=3)
def variance_of_fields(channel: str) -> float:
    """Mean of two grounds [dB2], HH and VV as one: crops and grass of Flevoland, what lasts of SMAPVEX12's fields."""
    crops = [name for group in GROUPS.values() for names in group.values() for name in names]
    fields: dict[tuple[str, str], list[tuple[str, list[float]]]] = defaultdict(list)
    for row in data("smapvex12_lband.csv"):
        fields[row["crop"], row["date"]].append((row["field"], [float(row[p] or "nan") for p in POLARIZATIONS]))
    left: dict[tuple[str, str], list[np.ndarray]] = defaultdict(list)
    for (crop, _), met in fields.items():
        values = np.array([x for _, x in met])
        n = np.isfinite(values).sum(axis=0)
        own = (values - np.nanmean(values, axis=0)) * np.sqrt(n / np.maximum(n - 1, 1))
        for (field, _), x in zip(met, own, strict=True):
            if len(met) > 1:
                left[crop, field].append(x)
    both = np.nanmean([x * y for days in left.values() for x, y in combinations(days, 2)], axis=0)
    of_one = []
    for p in POLARIZATIONS:
        squares, freedom = (sum(x) for x in zip(*(squares_of_fields(name, p) for name in crops), strict=True))
        of_one.append(0.5 * (squares / freedom + both[POLARIZATIONS.index(p)]))
    return float(of_one[1] if channel == "HV" else 0.5 * (of_one[0] + of_one[2]))


def field_sd_db(category: str, channel: str, column: str) -> float:
    """Of the shipped file."""
    rows = shipped_rows("variability.csv")
    return next(
        float(r.text(column)) for r in rows if (r.text("category"), r.text("polarization")) == (category, channel)
    )


@pytest.mark.parametrize("channel", POLARIZATIONS)
@pytest.mark.parametrize(
    ("category", "crop"),
    [
        ("Wheat", "winter wheat"),
        ("Oats", "winter barley"),
        ("Corn", "maize"),
        ("Rapeseed", "winter rapeseed"),
        ("Grass", "permanent grassland"),
        ("Hay", "temporary grassland"),
        ("Forage", "temporary grassland"),
    ],
)
def test_c_band_field_spread_is_that_of_the_french_parcels(category: str, crop: str, channel: str) -> None:
    """Under a closed canopy: the lasting deviation and half of the seasonal one."""
    measured = "VH" if channel == "HV" else "VV"
    row = next(r for r in data("field_deviation.csv") if (r["crop"], r["pol"]) == (crop, measured))
    expected = np.hypot(0.5 * float(row["sd_season"]), float(row["sd_permanent"]))
    assert field_sd_db(category, channel, "c_band_field_sd_db") == pytest.approx(expected, abs=0.006)


@pytest.mark.parametrize("channel", POLARIZATIONS)
def test_c_band_spread_of_vegetables_is_that_of_potato_parcels_and_of_crops(channel: str) -> None:
    """1637 parcels of one province: 0.8 dB under a closed canopy, and what crops of one ground differ by."""
    rows = [r for r in data("potato_field_sd.csv") if r["polarization"] == ("HV" if channel == "HV" else "VV")]
    closed = [float(r["sd_field_db"]) for r in rows if 173 <= int(r["day_of_year"]) <= 200]
    of_ground: dict[str, list[float]] = defaultdict(list)
    for r in shipped_rows("levels.csv"):
        if (r.text("category"), r.text("frequency_ghz"), r.text("polarization")) == ("Vegetables", "5.4", channel):
            formula = formula_db("short_vegetation", "C", channel, float(r.text("theta_deg")))
            of_ground[r.text("source")].append(float(r.text("sigma0_db")) - formula)
    between = sum(np.var(v) * len(v) for v in of_ground.values()) / sum(len(v) - 1 for v in of_ground.values())
    expected = np.sqrt(np.mean(np.square(closed)) + between)
    assert field_sd_db("Vegetables", channel, "c_band_field_sd_db") == pytest.approx(expected, abs=0.015)


def test_field_spread_goes_from_l_to_c_band() -> None:
    """Straight over the logarithm of frequency, held beyond."""
    sd = [float(TABLE.lookup(["Vegetables"], f, "VV").field_sd_db[0]) for f in (0.7, 1.25, 2.598, 5.4, 13.6)]
    assert sd == pytest.approx([2.18, 2.18, 0.5 * (2.18 + 2.28), 2.28, 2.28], abs=1e-3)
    # A cover that C band says nothing of keeps the spread of L band.
    assert {float(TABLE.lookup(["Trees"], f, "VV").field_sd_db[0]) for f in (1.25, 2.598, 5.4)} == {0.68}


def test_channels_of_fields_are_correlated_as_in_the_flight() -> None:
    """Fields of 20 cells or more about the mean of their crop; 57 degrees of freedom, so that 0.06 is one error."""
    labels = validate_flevoland.scene()
    with np.load(validate_flevoland.OUT / "flevoland_fields.npz") as archive:
        mean = np.stack([archive[name] for name in ("hh_db", "hv_db", "vv_db")])
    inside = validate_flevoland.labelled_cells() >= 20
    category = categories_of_fields(labels)
    total, freedom = np.zeros((3, 3)), 0
    for k, name in enumerate(labels.categories):
        own = mean[:, inside & (category == k)]
        if own.shape[1] < 3 or name.split(" (")[0] in ("Forest", "Bare soil", "Water", "Buildings"):
            continue
        left = own - own.mean(axis=1, keepdims=True)
        left /= left.std(axis=1, ddof=1)[:, None]
        total, freedom = total + left @ left.T, freedom + own.shape[1] - 1
    related = (total / freedom)[np.triu_indices(3, 1)]
    assert freedom == 57
    assert related.mean() == pytest.approx(TABLE.channel_correlation, abs=0.01)
    assert np.ptp(related) < 0.12  # one number for the three pairs


def test_fields_are_related_by_angle_as_in_pairs_of_images() -> None:
    """Correlations of real fields over what bands and channels say of them fall by the angle as told, within one error.

    A least-squares rate of the exponential, each pair weighted by its fields; its error from how the pairs scatter.
    """
    rows, shared = data("field_angles.csv"), TABLE.channel_correlation
    alike = [shared if {row["one"], row["other"]} == {"HH", "VV"} else 1.0 for row in rows]
    bands = [related_fields(float(row["one_ghz"]), float(row["other_ghz"])) for row in rows]
    told, (found, n, one, other) = (
        np.multiply(alike, bands),
        np.array([[float(row[key]) for key in ("correlation", "fields", "one_deg", "other_deg")] for row in rows]).T,
    )
    apart = np.abs(one - other)
    weight = np.sqrt(n)
    fit = scipy.optimize.least_squares(lambda rate: weight * (told * np.exp(-apart * rate[0]) - found), [0.01])
    error = np.sqrt(2.0 * fit.cost / (len(rows) - 1) / np.square(fit.jac).sum())
    assert fit.x[0] == pytest.approx(1.0 / ANGLE_DEG, abs=error)
    assert fit.x[0] > 3.0 * error
    assert error < 0.007
