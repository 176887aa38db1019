"""Models against values from public implementations that are not ours (scattering_vectors.csv)."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import numpy as np
import pytest

from seqrsm.scattering.atmosphere import cloud_db_per_kg_m2
from seqrsm.scattering.emissivity import emissivity_mo82
from seqrsm.scattering.models import (
    backscatter_layer_ulaby14,
    backscatter_oh04,
    backscatter_oh92,
    backscatter_ulaby89_db,
    permittivity_soil,
    permittivity_soil_dobson85,
    permittivity_water_ulaby14,
    permittivity_wet_snow_hallikainen86,
    reflectivity_fresnel,
)
from seqrsm.scattering.readers import shipped_rows
from seqrsm.scattering.sigma0 import load_sigma0_table

HERE = Path(__file__).parent / "data"
EPSILON = 6.28 - 1.53j
K_PER_GHZ = 2.0 * np.pi * 1e9 / 3e8  # the codes behind the vectors take c = 3e8 m/s


def vectors(model: str) -> list[tuple[dict[str, float], str, float]]:
    found = []
    with open(HERE / "scattering_vectors.csv", encoding="utf-8") as stream:
        for row in csv.DictReader(stream):
            if row["model"].startswith(model):
                inputs = {k: float(v) for k, v in re.findall(r"([\w']+)=([\d.]+)(?=[ ;]|$)", row["inputs"])}
                found.append((inputs, row["quantity"], float(row["value"])))
    assert found
    return found


def db(value: float) -> float:
    return float(10.0 * np.log10(value))


@pytest.mark.parametrize(("inputs", "quantity", "expected"), vectors("Oh1992"))
def test_oh92(inputs: dict[str, float], quantity: str, expected: float) -> None:
    got = backscatter_oh92(EPSILON, 9.5 * K_PER_GHZ * 3.02e-3, np.deg2rad(inputs["theta"]))
    assert db(getattr(got, quantity.split("_")[1])) == pytest.approx(expected, abs=2e-4)


@pytest.mark.parametrize(("inputs", "quantity", "expected"), vectors("Oh2004"))
def test_oh04(inputs: dict[str, float], quantity: str, expected: float) -> None:
    got = backscatter_oh04(inputs["mv"], inputs["ks"], np.deg2rad(inputs["theta"]))
    assert db(getattr(got, quantity.split("_")[1])) == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize(("inputs", "quantity", "expected"), vectors("S2RT"))
def test_layer(inputs: dict[str, float], quantity: str, expected: float) -> None:
    theta = np.deg2rad(inputs["theta"])
    ground = backscatter_oh92(EPSILON, 10.0 * K_PER_GHZ * 1e-3, theta)
    channel = quantity.split("_")[1]
    reflectivity = getattr(reflectivity_fresnel(EPSILON, theta), channel[0])
    got = backscatter_layer_ulaby14(getattr(ground, channel), reflectivity, 0.15, 1.0, theta)
    assert db(got) == pytest.approx(expected, abs=2e-4)


@pytest.mark.parametrize(("inputs", "quantity", "expected"), vectors("Fresnel smooth,".rstrip(",")))
def test_fresnel(inputs: dict[str, float], quantity: str, expected: float) -> None:
    epsilon = complex(permittivity_water_ulaby14(10.7, 20.0)) if "T" in inputs else 9.0 - 0.9j
    got = reflectivity_fresnel(epsilon, np.deg2rad(inputs["theta"]))
    assert 1.0 - getattr(got, quantity[-1]) == pytest.approx(expected, abs=6e-5 if "T" in inputs else 6e-6)


@pytest.mark.parametrize(("inputs", "quantity", "expected"), vectors("water double-Debye"))
def test_water(inputs: dict[str, float], quantity: str, expected: float) -> None:
    got = complex(permittivity_water_ulaby14(inputs["f"], 20.0))
    assert (got.real if "real" in quantity else got.imag) == pytest.approx(expected, abs=6e-5)


@pytest.mark.parametrize(("inputs", "quantity", "expected"), vectors("Dobson1985"))
def test_soil(inputs: dict[str, float], quantity: str, expected: float) -> None:
    f = inputs["f"]
    got = complex(permittivity_soil_dobson85(f, inputs["mv"], float(f >= 1.3)))
    assert (got.real if "real" in quantity else got.imag) == pytest.approx(expected, abs=6e-5)


@pytest.mark.parametrize(("inputs", "quantity", "expected"), vectors("wet snow"))
def test_wet_snow(inputs: dict[str, float], quantity: str, expected: float) -> None:
    got = complex(permittivity_wet_snow_hallikainen86(inputs["f"], inputs["rho_dry"], inputs["mv"]))
    assert (got.real if "real" in quantity else got.imag) == pytest.approx(expected, abs=6e-5)


@pytest.mark.parametrize(("inputs", "quantity", "expected"), vectors("cloud Rayleigh"))
def test_cloud(inputs: dict[str, float], quantity: str, expected: float) -> None:
    assert quantity == "kappa_db_per_km"
    # Half a percent: 0.819 of the Rayleigh formula is a rounded constant.
    assert 0.3 * cloud_db_per_kg_m2(inputs["f"]) == pytest.approx(expected, rel=5e-3, abs=6e-6)


@pytest.mark.parametrize(("inputs", "quantity", "expected"), vectors("tau-omega"))
def test_vegetation_over_ground(inputs: dict[str, float], quantity: str, expected: float) -> None:
    theta = np.deg2rad(inputs["theta"])
    # The vectors lessen the roughness by a power of the cosine; the package takes it at the angle itself.
    roughness = inputs["h"] * np.cos(theta) ** inputs["n"]
    got = emissivity_mo82(9.0 - 0.9j, roughness, inputs["tau"], inputs["omega"], theta, quantity[-1].upper())
    assert float(got) == pytest.approx(expected, abs=5.1e-5)


def test_lake_ice_has_the_backscatter_of_pure_ice() -> None:
    """The table assumes 3.15 + 0.001j; with the permittivity of the public code sigma0 moves by less than 0.12 dB."""
    for ghz in {inputs["f"] for inputs, _, _ in vectors("pure ice")}:
        parts = {q: v for inputs, q, v in vectors("pure ice") if inputs["f"] == ghz}
        published = complex(parts["eps_real"], parts["eps_imag"])
        for theta in np.deg2rad([20.0, 40.0, 60.0]):
            ours, theirs = (backscatter_oh92(eps, ghz * K_PER_GHZ * 3e-3, theta) for eps in (3.15 + 0.001j, published))
            for a, b in zip(ours, theirs, strict=True):
                assert db(a) == pytest.approx(db(b), abs=0.12)


def test_dry_snow_absorbs_as_published() -> None:
    """Absorption of the table (250 kg/m3, its own code) against that of the published permittivity (300 kg/m3)."""
    rows = shipped_rows("snow_dry.csv")
    f, absorption, real = (
        np.array([float(row.text(name)) for row in rows])
        for name in ("frequency_ghz", "absorption_per_m", "permittivity")
    )
    found = vectors("dry snow")
    for inputs, quantity, expected in found:
        ghz = inputs["f"]
        if quantity == "eps_real":
            # 1 + 1.6 density + 1.86 density**3 gives the vector, and 1.429 at the table's density.
            assert 1.0 + 1.5995 * inputs["rho"] + 1.861 * inputs["rho"] ** 3 == pytest.approx(expected, abs=3e-4)
            assert real == pytest.approx(1.0 + 1.5995 * 0.25 + 1.861 * 0.25**3, rel=0.01)
        elif f[0] <= ghz <= f[-1]:
            index = next(v for i, q, v in found if q == "eps_real" and i["f"] == ghz) ** 0.5
            theirs = ghz * K_PER_GHZ * expected / index
            assert np.exp(np.interp(np.log(ghz), np.log(f), np.log(absorption))) == pytest.approx(theirs, rel=0.07)


def shipped_regressions() -> dict[tuple[str, str, str], list[float]]:
    return {
        (r.text("class"), r.text("band"), r.text("polarization")): [float(r.text(f"p{i}")) for i in range(1, 7)]
        for r in shipped_rows("ulaby_dobson.csv")
    }


def test_ulaby_dobson_spot_checks() -> None:
    parameters = shipped_regressions()
    with open(HERE / "ulaby_dobson_spot_checks.csv", encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    assert {(r["class"], r["band"], r["pol"]) for r in rows} == set(parameters)
    for r in rows:
        for theta in range(0, 81, 10):
            got = backscatter_ulaby89_db(parameters[r["class"], r["band"], r["pol"]], np.deg2rad(theta))
            assert got == pytest.approx(float(r[f"sigma0_db_{theta}"]), abs=6e-3), (r, theta)


def test_table_gives_the_published_value_at_a_node() -> None:
    """Shrubs at C band, which nothing moves, as other regressions are. Below 20 deg HH and VV keep their mean."""
    with open(HERE / "ulaby_dobson_spot_checks.csv", encoding="utf-8") as stream:
        rows = {(r["class"], r["band"], r["pol"]): r for r in csv.DictReader(stream)}
    published, found = [], []
    for channel in ("HH", "VV"):
        row = rows["shrubs", "C", channel]
        published.append([float(row[f"sigma0_db_{theta}"]) for theta in range(0, 71, 10)])
        found.append(10.0 * np.log10(load_sigma0_table().lookup(["Scrub"], 5.4, channel).sigma0[0, 0:71:10]))
    np.testing.assert_allclose(np.array(found)[:, 2:], np.array(published)[:, 2:], atol=6e-3)
    np.testing.assert_allclose(np.mean(found, axis=0), np.mean(published, axis=0), atol=6e-3)


def test_water_table_against_cmod5n() -> None:
    """The composite model against CMOD5.N, C-VV, mean of along and across wind: the documented rms of 2.2 dB."""
    error = []
    cases: dict[tuple[float, float], list[float]] = {}
    for inputs, quantity, expected in vectors("CMOD5.N"):
        if quantity == "sigma0_vv_db":
            cases.setdefault((inputs["U10"], inputs["inc"]), []).append(10.0 ** (expected / 10.0))
    for (wind, theta), power in cases.items():
        found = load_sigma0_table().lookup(["Water"], 5.4, "VV", wind_m_s=wind)
        error.append(db(found.sigma0[0, int(theta)]) - db(float(np.mean(power))))
    assert len(error) == 12
    assert np.sqrt(np.mean(np.square(error))) < 3.0
    assert np.abs([e for e, (wind, _) in zip(error, cases, strict=True) if wind >= 3.0]).max() < 3.0


def test_water_polarization_ratio() -> None:
    """HH over VV at C band, upwind at 5 m/s: 2.0 dB rms from two measured ratios, too low by up to 3.9 at 50 deg."""
    vv = {i["inc"]: v for i, q, v in vectors("CMOD5.N") if q == "sigma0_vv_db" and (i["U10"], i["phi"]) == (5.0, 0.0)}
    table = {c: load_sigma0_table().lookup(["Water"], 5.4, c, wind_m_s=5.0).sigma0[0] for c in ("HH", "VV")}
    error = [
        db(table["HH"][int(i["inc"])]) - db(table["VV"][int(i["inc"])]) - (v - vv[i["inc"]])
        for i, _, v in vectors("CMOD5.N / ")
    ]
    assert len(error) == 8
    assert np.sqrt(np.mean(np.square(error))) < 2.3
    assert np.abs(error).max() < 4.0


@pytest.mark.parametrize(("inputs", "quantity", "expected"), vectors("RADARSAT-2 VH"))
def test_water_cross_polarization(inputs: dict[str, float], quantity: str, expected: float) -> None:
    assert quantity == "sigma0_vh_db"
    found = load_sigma0_table().lookup(["Water"], 5.4, "HV", wind_m_s=inputs["U10"])
    assert db(found.sigma0[0, int(inputs["inc"])]) == pytest.approx(expected, abs=0.02)


def mironov09(frequency_ghz: float, mv: float, clay_percent: float) -> complex:
    """Mironov, Kosolapova and Fomin 2009, IEEE TGRS 47(7), eqs. 11 to 25: another model of moist soil."""
    c, omega = clay_percent, 2.0 * np.pi * frequency_ghz * 1e9

    def index(static: float, tau: float, sigma: float) -> complex:
        debye = 4.9 + (static - 4.9) / (1.0 - 1j * omega * tau) + 1j * sigma / (omega * 8.854e-12)
        return complex(np.sqrt(debye))

    dry = complex(1.634 - 0.539e-2 * c + 0.2748e-4 * c**2, 0.03952 - 0.04038e-2 * c)
    most_bound = 0.02863 + 0.30673e-2 * c
    bound = index(79.8 - 85.4e-2 * c + 32.7e-4 * c**2, 1.062e-11 + 3.450e-14 * c, 0.3112 + 0.467e-2 * c)
    free = index(100.0, 8.5e-12, 0.3631 + 1.217e-2 * c)
    n = dry + (bound - 1.0) * min(mv, most_bound) + (free - 1.0) * max(mv - most_bound, 0.0)
    return n**2


@pytest.mark.parametrize("frequency", [1.0, 1.25, 1.4, 2.0, 3.0, 5.4, 9.6])
def test_the_loss_of_soil_is_that_of_another_model(frequency: float) -> None:
    """At 0.2 m3/m3 the imaginary part is within a fifth of Mironov's; the published step makes it 2.3 times."""
    ours, other = complex(permittivity_soil(frequency, 0.2)).imag, mironov09(frequency, 0.2, 30.0).imag
    assert ours == pytest.approx(other, rel=0.2)
    assert complex(permittivity_soil_dobson85(1.4, 0.2, 1.0)).imag > 2.2 * mironov09(1.4, 0.2, 30.0).imag


def test_the_permittivity_of_soil_has_no_step() -> None:
    f = np.geomspace(0.5, 18.0, 2000)
    assert np.abs(np.diff(np.log(permittivity_soil(f, 0.2).imag))).max() < 0.005
    assert permittivity_soil(5.3, 0.2) == permittivity_soil_dobson85(5.3, 0.2, 1.0)
