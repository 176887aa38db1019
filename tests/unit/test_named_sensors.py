"""Sensors by name: every spaceborne one builds, with its cell, looks, angle and noise."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from seqrsm.sensor.named import (
    NamedSensor,
    named_sensors,
    nearest_names,
    noise_equivalent_db,
    radar_of,
    radiometer_of,
    sensors_called,
    to_json,
)

DATA = Path(__file__).parents[1] / "reference" / "data"
BY_TITLE = {one.title: one for one in named_sensors()}
RADARS = [one for one in named_sensors() if one.kind == "sar"]
SWEEPING = {"PLMR", "ESTAR", "HUT-2D"}
RADIOMETERS = [one for one in named_sensors() if one.kind == "radiometer"]


def rows(name: str) -> list[dict[str, str]]:
    with (DATA / name).open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_titles_are_unique_and_statuses_name_columns() -> None:
    assert len(BY_TITLE) == len(named_sensors()) == 150
    for one in named_sensors():
        assert (one.derived | one.recalled) <= {*one.values, "channels"}, one.title
        assert not one.derived & one.recalled


@pytest.mark.parametrize("sensor", RADARS, ids=lambda one: one.title)
def test_every_radar_builds_with_its_looks_cell_angle_and_noise(sensor: NamedSensor) -> None:
    for channels in sensor.channels:
        for incidence in sensor.incidences_deg:
            radar = radar_of(sensor, channels, incidence)
            theta = np.array([radar.centre_incidence_rad])
            assert np.rad2deg(theta[0]) == pytest.approx(incidence, abs=0.01)
            own = sensor.values.get("resolution_range_m", 0.0), sensor.values.get("resolution_azimuth_m", 0.0)
            assert radar.resolution_m >= 0.999 * max(own)
            looks = sensor.values.get("looks", 1.0) * radar.resolution_m**2 / (own[0] * (own[1] or own[0]))
            assert radar.looks_used(theta)[0] == pytest.approx(max(looks, 1.0), rel=0.05)
            assert noise_equivalent_db(radar) == pytest.approx(sensor.noise_db(incidence), abs=1e-6)
            coarse = radar_of(sensor, channels, incidence, cell_m=3.0 * radar.resolution_m)
            assert coarse.looks_used(theta)[0] == pytest.approx(9.0 * max(looks, 1.0), rel=0.05)


@pytest.mark.parametrize("row", rows("named_sensors.csv"), ids=lambda row: f"{row['name']} {row['mode']}")
def test_settings_are_those_worked_out_beside_the_program(row: dict[str, str]) -> None:
    """Against a table that was made by hand from the same rows, its looks cut to one decimal."""
    sensor = BY_TITLE[f"{row['name']} {row['mode']}"]
    incidence = float(row["incidence_mid_deg"])
    radar = radar_of(sensor, sensor.channels[0], incidence)
    assert sensor.incidences_deg[len(sensor.incidences_deg) // 2] == pytest.approx(incidence, abs=0.01)
    assert radar.resolution_m == pytest.approx(float(row["resolution_m"]), rel=0.05)
    assert radar.looks == pytest.approx(float(row["looks"]), rel=0.05, abs=0.15)
    assert radar.depression_angle_deg == pytest.approx(float(row["depression_angle_deg"]), abs=0.02)
    if row["speed_m_s"]:
        assert radar.speed_m_s == pytest.approx(float(row["speed_m_s"]), rel=0.001)


def test_every_radiometer_builds_with_its_noise() -> None:
    for sensor in RADIOMETERS:
        made = radiometer_of(sensor, sensor.channels[0])
        angle = 0.0 if sensor.name in SWEEPING else 40.0 if sensor.name == "SMOS" else sensor.incidences_deg[0]
        assert made.conical_incidence_deg == angle
        if "effective" in sensor.notes:  # spread by the turn, across the direction of view
            assert made.footprint_m[0] == pytest.approx(1e3 * sensor.values["footprint_major_km"])
        else:
            assert made.resolution_m == pytest.approx(1e3 * sensor.values["footprint_km"])
        if made.noise_temperature_k > 0.0:
            assert made.nedt_k(300.0) == pytest.approx(sensor.values["nedt_k"], rel=1e-6)


@pytest.mark.parametrize("polarization", ["VV", "VH"])
def test_noise_of_sentinel_1_is_within_1_db_of_the_annotation(polarization: str) -> None:
    sensor = BY_TITLE["Sentinel-1 IW GRDH"]
    annotated = [row for row in rows("noise_sentinel1.csv") if row["polarization"] == polarization]
    assert len(annotated) > 60
    for incidence in {float(row["incidence_deg"]) for row in annotated}:
        found = noise_equivalent_db(radar_of(sensor, "VV+VH", incidence))
        # Where two subswaths meet either is right.
        there = [float(row["nesz_mean_db"]) for row in annotated if float(row["incidence_deg"]) == incidence]
        assert min(abs(found - level) for level in there) < 1.0, incidence


def test_calibration_is_one_standard_deviation_of_what_is_stated() -> None:
    """Sentinel-1: 1 dB at 3 sigma (product definition); NISAR: 0.9 dB at 1 sigma."""
    stated = {"Sentinel-1 IW GRDH": 1.0 / 3.0, "NISAR L DH 20+5 (GCOV 20 m)": 0.9, "Umbra Spotlight": 0.0}
    for title, sd_db in stated.items():
        sensor = BY_TITLE[title]
        assert radar_of(sensor, sensor.channels[0], 40.0).calibration_sd_db == pytest.approx(sd_db)


def test_a_beam_that_turns_keeps_its_period() -> None:
    smap = radiometer_of(BY_TITLE["SMAP L 1.41 GHz"], "H+V")
    assert smap.scan_period_s == pytest.approx(60.0 / 14.6, rel=0.01)  # revolutions a minute


def test_names_are_found_by_their_words_and_unknown_ones_get_the_nearest() -> None:
    assert [one.mode for one in sensors_called("sentinel-1 iw")] == ["IW GRDH", "IW SLC", "IW GRDM"]
    assert [one.mode for one in sensors_called("Sentinel-1 IW GRDH")] == ["IW GRDH"]
    assert {one.name for one in sensors_called("Seasat")} == {"Seasat SAR"}
    assert {one.name for one in sensors_called("tandem-x")} == {"TerraSAR-X/TanDEM-X/PAZ"}
    assert len(sensors_called("*")) == 150
    assert len(sensors_called("*quad*")) > 5
    assert sensors_called("") == sensors_called("Sentinal") == ()
    assert nearest_names("Sentinal-1")[0] == "Sentinel-1"
    assert nearest_names("NISAR L QP 40+5")[0] in {"NISAR L QP 20+5 (GCOV 20 m)", "NISAR L DH 40+5 (GCOV 10 m)"}
    assert nearest_names("TeraSAR X")[0] == "TerraSAR-X"
    assert nearest_names("qwzzy") == []


def test_json_tells_of_each_value_what_it_rests_on() -> None:
    document = to_json(BY_TITLE["Sentinel-1 IW GRDH"])
    assert document["values"]["altitude_km"] == {"value": 693.0, "status": "recalled"}
    assert document["values"]["nesz_db"] == {"value": -25.8, "status": "seen"}
    assert BY_TITLE["SAOCOM-1 Stripmap dual"].noise_rests == "seen"
    assert BY_TITLE["Umbra Spotlight"].noise_rests == "assumed"
    assert BY_TITLE["Umbra Spotlight"].noise_db(40.0) == -20.0
