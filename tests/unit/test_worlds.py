"""What is not known of the ground: its size, its correlations, and worlds in a look-up."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from seqrsm.scattering.emissivity import MOISTURE_NODES, load_emissivity_table
from seqrsm.scattering.readers import shipped_rows
from seqrsm.scattering.sigma0 import load_sigma0_table
from seqrsm.scattering.worlds import (
    OWN,
    World,
    default_mean_sd,
    drawn_by_frequency,
    related_by_frequency,
    related_covers,
)
from seqrsm.simulate.visits import deviates, related_fields

N = 1500
WORLDS = [World(1979, k) for k in range(N)]
TABLE, EMISSIVITY = load_sigma0_table(), load_emissivity_table()


def drawn(category: str, kin: str, frequency: float, channel: str, theta: int = 40) -> np.ndarray:
    return np.array([w.departure(category, kin, frequency, channel)[theta] for w in WORLDS])


@pytest.mark.parametrize("frequency", [0.2, 1.25, 2.2, 5.4, 36.0])
@pytest.mark.parametrize(("channel", "theta"), [("HH", 40), ("HV", 10), ("VV", 70), ("H", 0), ("V", 60)])
def test_departures_are_standard_normal(frequency: float, channel: str, theta: int) -> None:
    found = drawn("Wheat", "short_vegetation", frequency, channel, theta)
    assert found.mean() == pytest.approx(0.0, abs=4.0 / np.sqrt(N))
    assert found.std() == pytest.approx(1.0, abs=4.0 / np.sqrt(2.0 * N))


def test_departures_between_nodes_are_as_large_as_at_them() -> None:
    """Without the correction for what two nodes share they would be 29 % smaller in the middle."""
    middle = 0.9 * 4.0 ** (np.arange(-1.0, 4.0) + 0.5)
    found = [World(7, k).departure("Wheat", "", f, "HH")[::30] for k in range(3000) for f in middle]
    assert np.sqrt(np.mean(np.square(found))) == pytest.approx(1.0, abs=0.012)


WHEAT = ("Wheat", "short_vegetation", 1.25, "HH", 40)
AT = {f: np.log(f / 0.9) / np.log(4.0) for f in (1.25, 1.4, 5.0)}  # nodes stand at 0.9 GHz and every two octaves
BETWEEN_L_AND_1_4_GHZ = ((1 - AT[1.25]) * (1 - AT[1.4]) + AT[1.25] * AT[1.4]) / (
    np.hypot(1 - AT[1.25], AT[1.25]) * np.hypot(1 - AT[1.4], AT[1.4])
)
BETWEEN_L_AND_5_GHZ = AT[1.25] * (2 - AT[5.0]) / (np.hypot(1 - AT[1.25], AT[1.25]) * np.hypot(2 - AT[5.0], AT[5.0] - 1))


@pytest.mark.parametrize(
    ("other", "correlation"),
    [
        (("Wheat", "short_vegetation", 1.25, "VV", 40), 0.85),
        (("Wheat", "short_vegetation", 1.25, "HV", 40), 0.75),
        (("Corn", "short_vegetation", 1.25, "HH", 40), 0.5),
        (("Grass", "grass", 1.25, "HH", 40), 0.25),
        (("Water", "", 1.25, "HH", 40), 0.25),
        (("Wheat", "short_vegetation", 1.4, "HH", 40), BETWEEN_L_AND_1_4_GHZ),
        (("Wheat", "short_vegetation", 5.0, "HH", 40), BETWEEN_L_AND_5_GHZ),
        (("Wheat", "short_vegetation", 1.25, "HH", 10), 0.5),
    ],
)
def test_correlations_are_those_stated(other: tuple, correlation: float) -> None:
    found = np.corrcoef(drawn(*WHEAT), drawn(*other))[0, 1]
    assert found == pytest.approx(correlation, abs=4.0 * (1.0 - correlation**2) / np.sqrt(N) + 0.03)


@pytest.mark.parametrize("kin", [("grass", "grass"), ("grass", "short_vegetation"), ("grass", ""), ("", "")])
def test_covers_of_a_class_are_related_as_their_departures_are(kin: tuple[str, str]) -> None:
    """As drawn for covers of two names."""
    found = np.corrcoef(drawn("Wheat", kin[0], 1.25, "HH"), drawn("Bareground", kin[1], 1.25, "HH"))[0, 1]
    assert related_covers(*kin) == pytest.approx(found, abs=4.0 * (1.0 - found**2) / np.sqrt(N))


def test_h_and_v_of_emissivity_part_as_the_square_of_the_sine() -> None:
    """By a tenth: TELSEM2, file `correlations`, has 0.94 for five classes of land at 53 deg, 19 and 37 GHz."""
    h, v = (drawn("Wheat", "", 1.4, polarization, 45) for polarization in ("H", "V"))
    assert np.corrcoef(h, v)[0, 1] == pytest.approx(1.0 - 0.1 * 0.5, abs=0.01)


def test_h_and_v_of_emissivity_meet_at_nadir() -> None:
    covers = ("Trees", "Water", "Bareground")
    one = EMISSIVITY.in_world(World(3, 7))
    h, v = (one.lookup(covers, 18.0, p).emissivity[..., 0] for p in ("H", "V"))
    np.testing.assert_allclose(h, v, atol=1e-12)
    assert np.all(np.abs(h - EMISSIVITY.lookup(covers, 18.0, "H").emissivity[..., 0]) > 1e-5)  # 0 would meet 0, too


@pytest.mark.parametrize("frequency", [1.4, 10.7])
def test_a_world_has_the_emissivity_off_by_a_part_of_what_is_reflected(frequency: float) -> None:
    """So moist soil departs by more than dry, and at 50 degrees H by more than V, as their reflectivities are."""
    for polarization in ("H", "V"):
        plain = EMISSIVITY.lookup(["Bareground"], frequency, polarization)
        one = EMISSIVITY.in_world(World(3, 7)).lookup(["Bareground"], frequency, polarization)
        away = World(3, 7).departure("Bareground", "", frequency, polarization)
        reflected = 1.0 - plain.emissivity[0]
        nadir = reflected[np.argmin(np.abs(MOISTURE_NODES - 0.2)), 0]
        np.testing.assert_allclose((1.0 - one.emissivity[0]) / reflected, np.tile(1.0 - 0.03 / nadir * away, (17, 1)))
    found = [EMISSIVITY.in_world(World(3, k)).lookup(["Wheat", "Buildings"], 36.0, "H").emissivity for k in range(200)]
    assert 0.0 <= np.min(found) < np.max(found) <= 1.0


def levels() -> dict[tuple[str, float, str], dict[str, float]]:
    """Measured level of a category by source."""
    found: dict = {}
    for r in shipped_rows("levels.csv"):
        if r.text("status") == "measured":
            key = r.text("category"), float(r.text("frequency_ghz")), r.text("polarization")
            plain = TABLE.lookup([key[0]], key[1], key[2])
            theta = float(r.text("theta_deg"))
            away = float(r.text("sigma0_db")) - np.interp(theta, plain.theta_deg, 10.0 * np.log10(plain.sigma0[0]))
            found.setdefault(key, {}).setdefault(r.text("source"), []).append(away)
    return {key: {s: float(np.mean(v)) for s, v in of.items()} for key, of in found.items()}


@pytest.mark.parametrize(
    ("channels", "frequency", "kind"),
    [(("HH", "VV"), 1.25, "HH"), (("HV",), 1.25, "HV"), (("VV",), 5.4, "VV"), (("HV",), 5.4, "HV")],
)
def test_a_measured_mean_is_as_uncertain_as_sources_differ(
    channels: tuple[str, ...], frequency: float, kind: str
) -> None:
    """What n sources and one more at the covers' mean let expect of another ground is off by its own and their error.

    Of what L-band flights differ by, a part is their dates', which a run draws besides; other sources are means of
    months. One flight has most crops there, two have some.
    """
    every = {key: [*of.values()] for key, of in levels().items() if key[1] == frequency and key[2] in channels}
    groups = {key: g for key, g in every.items() if len(g) > 1}
    variance = sum(np.var(g) * len(g) for g in groups.values()) / sum(len(g) - 1 for g in groups.values())
    dates = [TABLE.lookup([category], f, p).date_sd_db[0] ** 2 for category, f, p in groups if f < 2.0]
    n = np.mean([len(g) for g in (every if dates else groups).values()])
    for cover, apart in (("Wheat", np.mean(dates or 0.0)), (OWN, 0.0)):  # no date is drawn of a cover of one's own
        stated = default_mean_sd("sigma0", cover, "measured", frequency, kind)
        assert stated == pytest.approx(np.sqrt(variance - apart + variance / (n + 1.0)), rel=0.1)


def test_the_mean_of_a_cover_without_date_holds_what_dates_differ_by(tmp_path: Path) -> None:
    rows = [f"{name},{f},{t},-10" for name in ("Barley", "Wheat") for f in (1.25, 5.4) for t in (0, 75)]
    path = tmp_path / "own.csv"
    head = "quantity,polarization,unit,status,source,category,frequency_ghz,theta_deg,value"
    path.write_text("\n".join([head, *(f"sigma0,HH,dB,measured,me,{row}" for row in rows)]), encoding="utf-8")
    table = load_sigma0_table(path)
    for frequency, wanted in ((1.25, [2.1, 1.7]), (5.4, [1.7, 1.7])):
        found = table.lookup(["Barley", "Wheat"], frequency, "HH")
        assert found.mean_sd_db == pytest.approx(wanted)
    assert found.date_sd_db[0] == 0.0 < found.date_sd_db[1]


def test_a_world_is_the_same_wherever_it_is_looked_up() -> None:
    one = TABLE.in_world(World(1979, 4))
    both, alone = one.lookup(["Wheat", "Trees"], 3.0, "HH"), one.lookup(["Trees"], 3.0, "HH")
    np.testing.assert_array_equal(both.sigma0[1], alone.sigma0[0])
    plain = TABLE.lookup(["Wheat", "Trees"], 3.0, "HH")
    for k, kin in enumerate((("Wheat", "short_vegetation"), ("Trees", ""))):
        away = 10.0 * np.log10(both.sigma0[k] / plain.sigma0[k])
        np.testing.assert_allclose(away, plain.mean_sd_db[k] * World(1979, 4).departure(*kin, 3.0, "HH"), atol=1e-9)
    assert alone.field_sd_db[0] / plain.field_sd_db[1] == pytest.approx(World(1979, 4).field_factor("Trees"))
    spread = [
        table.lookup(["Trees"], 3.0, "H").field_part[0] for table in (EMISSIVITY.in_world(World(1979, 4)), EMISSIVITY)
    ]
    assert spread[0] / spread[1] == pytest.approx(World(1979, 4).field_factor("Trees"))
    assert len({World(1979, number).field_factor("Trees") for number in range(20)}) == 20
    assert np.abs(TABLE.in_world(World(1979, 5)).lookup(["Trees"], 3.0, "HH").sigma0 / alone.sigma0 - 1.0).max() > 0.01


def test_a_user_states_how_well_a_mean_is_known(tmp_path: Path) -> None:
    head = "quantity,category,frequency_ghz,polarization,theta_deg,value,mean_sd,unit,status,source\n"
    rows = "".join(
        f"sigma0,Wheat,{f},HH,{t},-10,{s},dB,measured,me\n" for f, s in ((5.0, 0.4), (9.0, "")) for t in (20, 60)
    )
    path = tmp_path / "own.csv"
    path.write_text(head + rows, encoding="utf-8")
    table = load_sigma0_table(path)
    assert table.lookup(["Wheat"], 5.0, "HH").mean_sd_db == pytest.approx([0.4])
    assert table.lookup(["Wheat"], 9.0, "HH").mean_sd_db == pytest.approx([1.7])
    known = rows.replace(",,dB", ",0,dB").replace(",0.4,", ",0,")
    path.write_text(head + known, encoding="utf-8")
    sure = load_sigma0_table(path)
    np.testing.assert_array_equal(
        sure.in_world(World(1, 1)).lookup(["Wheat"], 5.0, "HH").sigma0, sure.lookup(["Wheat"], 5.0, "HH").sigma0
    )
    path.write_text(
        "quantity,category,frequency_ghz,polarization,theta_deg,value,mean_sd,unit,status,source\n"
        + "".join(f"emissivity,Lawn,20,H,{t},0.9,0.01,1,measured,me\n" for t in (0, 60)),
        encoding="utf-8",
    )
    assert load_emissivity_table(path).lookup(["Lawn"], 20.0, "H").mean_sd == pytest.approx([0.01])


@pytest.mark.parametrize(
    ("one", "other", "told"), [(1.25, 1.4, 0.99), (1.25, 5.4, 0.3), (5.4, 9.6, 0.7), (1.25, 35.0, 0)]
)
def test_frequencies_are_related_as_their_draws_are(one: float, other: float, told: float) -> None:
    draws = [drawn_by_frequency(3, 7, "a test", (40_000,), ghz) for ghz in (one, other)]
    assert np.corrcoef(draws)[0, 1] == pytest.approx(related_by_frequency(one, other), abs=0.015)
    assert related_by_frequency(one, other) == pytest.approx(told, abs=0.06)
    fields = [deviates(3, 7, "fields", (40_000,), ghz, own_share=0.1) for ghz in (one, other)]
    assert np.corrcoef(fields)[0, 1] == pytest.approx(related_fields(one, other), abs=0.015)
    assert related_fields(one, one) == pytest.approx(1.0)
    assert related_fields(one, 1.001 * one) == pytest.approx(1.0, abs=2e-4)


@pytest.mark.parametrize(
    ("one", "other", "of_v", "of_h"),
    [
        (19.35, 37.0, (0.96, 0.96, 0.96, 0.96, 0.95), (0.95, 0.94, 0.94, 0.93, 0.91)),
        (37.0, 85.5, (0.79, 0.86, 0.87, 0.85, 0.82), (0.78, 0.84, 0.85, 0.83, 0.78)),
        (19.35, 85.5, (0.72, 0.78, 0.79, 0.75, 0.70), (0.72, 0.75, 0.75, 0.71, 0.65)),
    ],
)
def test_emissivities_of_two_frequencies_are_related_as_those_of_an_atlas(one, other, of_v, of_h):
    """TELSEM2, file `correlations`: departures from the mean of each of its five classes of snow-free dry land."""
    for channel, told in (("V", of_v), ("H", of_h)):
        draws = [[World(3, k).departure("Grass", "", ghz, channel)[50] for k in range(4000)] for ghz in (one, other)]
        assert np.corrcoef(draws)[0, 1] == pytest.approx(np.mean(told), abs=0.08)
