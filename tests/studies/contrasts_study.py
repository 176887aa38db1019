"""Do simulated scores of two settings differ as published ones that no table of seqrsm rests on?

    OPENBLAS_NUM_THREADS=1 python tests/studies/contrasts_study.py [--worlds 100] [--workers 2]

Writes ``reports/validation/contrasts.md``: the contrasts of ``contrasts.csv`` over grounds like those of their sources,
made of the scenes that ship, each in many worlds with the same draws for both settings.
"""

from __future__ import annotations

import argparse
import csv
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seqrsm.campaign.engines import score_by
from seqrsm.campaign.simulation import SimulationTask, simulate_images
from seqrsm.scattering.emissivity import MOISTURE_NODES, load_emissivity_table
from seqrsm.scene.file import load_scene
from seqrsm.scene.scene import Scene
from seqrsm.score.known_map import KnownMap

ROOT = Path(__file__).parents[2]
OUT = ROOT / "reports" / "validation"
SEED = 1985
MAP_CORRECT = 0.9  # share of ground that the optical map names correctly (assumed)

FULL = "HH+HV+VV+phase"
SEASON, LATE = "135+160+185+210+235", "190+201+212+223+234+245"
WEEKLY = "+".join(map(str, range(110, 201, 10)))
CHANNELS = ("HH", "HV", "VV")
DIGITS = {"soil_moisture_error": 3, "kappa": 2}
"""Decimals of scores that are not in percent, which have one."""

Pair = NDArray[np.float64]

BRIGHTNESS = (  # GHz, moisture from and to [m3/m3], published change of bare soil's brightness [K], source
    (1.4, 0.02, 0.15, "-70", "Njoku and O'Neill 1982 (NTRS 19830033637), prepared fields: 2 to 15 % by volume"),
    (10.7, 0.02, 0.15, "-40", "the same"),
    (
        1.4,
        0.05,
        0.35,
        "-102",
        "three radiometers of 1 to 4 GHz, truck and aircraft: -3.4 K for each percent of L band, bare",
    ),
)
WORDS = [
    "## What lies outside",
    "",
    "- End of August over the end of July. The four covers stand on both days in the calendar, which tells them",
    "  apart as well on one as on the other.",
    "- Relation of HH and VV. The source states no scores. The simulated ratio is a gain of 8 to 10 points where",
    "  the powers alone name 77 to 82 %, in place of the 93 % here.",
    "- Full polarimetry over two channels, and over one circular wave. The source names 92 % on one day. What HH",
    "  and HV have in common is taken as nothing here. One circular wave over two channels is inside.",
    "- Fields over pixels on one date. In one channel at 23 deg fields of six crops score 23 % here; the source",
    "  has a little less than 60 %. Over three dates the gain is inside.",
    "",
    "Of wrong sign on average, though inside: late July over May, where wheat and rapeseed are autumn crops (below).",
    "",
    "How much of the ground the optical map names correctly, 90 %, is assumed.",
    "",
    "## What a second incidence angle gains",
    "",
    "Mean over the worlds, with its standard error. Of soil moisture the source has 0.035 at best. Here roughness is",
    "0.3 to 0.6 of the variance between bare fields at 40 deg, and moisture shows half as much again at 23 deg as at",
    "43, so that the low angle alone tells nearly all. Of crops, seen on day 200, no published amount is at hand; day",
    "212 besides, at the same angle, is for comparison.",
    "",
]


ANGLES = (  # ground, one setting and the other
    ("bare", "C, HH, 23 and 43 deg", "C, HH, 23 deg"),
    ("bare", "C, HH+HV, 23 and 43 deg", "C, HH+HV, 23 deg"),
    ("valley", "C, VV+HV, 25 and 45 deg", "C, VV+HV, 45 deg"),
    ("valley", "C, VV+HV, 45 deg, 2 dates", "C, VV+HV, 45 deg"),
)


@dataclass(frozen=True)
class Ground:
    """A shipped scene with covers renamed, and what of it is scored."""

    campaign: str
    scored: tuple[str, ...]
    becomes: dict[str, str] = field(default_factory=dict)
    fixed: dict[str, Any] = field(default_factory=dict)
    measure: str = "percent_correct"
    by: str = " by field"
    late_days: int = 0
    note: str = ""
    engine: str = "psm"


RADAR = {"bandwidth": 50.0, "peak_power": 100.0, "altitude_m": 6000.0, "depression_angle": 50.0, "resolution": 20.0}
RADIOMETER = {
    "polarization": "H+V", "bandwidth": 25.0, "noise_temperature": 300.0, "scan_period": 1.0, "altitude_m": 1500.0,
    "speed_m_s": 60.0, "integration_time": 5.0, "resolution": 100.0, "latitude_deg": 45.0, "hour": 6.0,
    "conical_incidence_deg": 45.0, "soil_moisture_field_sd": 0.04, "soil_moisture_region_sd": 0.06,
}  # fmt: skip
ENGINES = {"psm": RADAR, "prm": RADIOMETER}
VALLEY = "langegracht-dates"
LATER = 30  # of summers in Canada (assumed)
SOWN = f", sown in May: the calendar comes {LATER} days later"
GROUNDS = {
    "valley": Ground(VALLEY, ("Wheat", "Corn", "Oats", "Vegetables", "Forage", "Grass")),
    "quebec": Ground(
        VALLEY, ("Oats", "Corn", "Vegetables", "Forage"), late_days=LATER, note=f"cereals, corn, soybean, hay{SOWN}"
    ),
    "prairie": Ground(
        VALLEY, ("Wheat", "Oats", "Rapeseed", "Vegetables"), {"Corn": "Rapeseed"}, late_days=LATER,
        note=f"wheat, barley, canola, peas and lentils{SOWN}",
    ),
    "ontario": Ground(
        VALLEY, ("Forage", "Vegetables", "Corn", "Wheat"), late_days=LATER, note=f"forage, soybean, corn, wheat{SOWN}"
    ),
    "plantation": Ground(
        VALLEY, ("Scrub", "Vegetables", "Grass"),
        {"Wheat": "Scrub", "Oats": "Scrub", "Corn": "Vegetables", "Forage": "Grass"},
        note="coffee, cotton, pasture",
    ),
    "erie": Ground(
        VALLEY, ("Wheat", "Corn", "Vegetables", "Oats", "Forage", "Grass"),
        fixed={"resolution": 25.0, "looks": 3.0, "depression_angle": 67.0, "altitude_m": 60_000.0}, late_days=LATER,
        note=f"wheat, corn, soybean, barley, alfalfa, pasture{SOWN}",
    ),
    "haryana": Ground(
        VALLEY, ("Wheat", "Rapeseed", "Vegetables", "Bareground", "Settlement", "Trees"), {"Corn": "Rapeseed"},
        fixed={"resolution": 30.0, "depression_angle": 66.0, "altitude_m": 60_000.0}, by=" by neighbourhood",
        note="crops of winter and other land cover",
    ),
    "tropics": Ground(
        "wake-radiometer", ("Settlement", "Hay", "Grass", "Scrub", "Trees", "Water"), measure="kappa",
        fixed={"resolution": 60.0, "altitude_m": 9000.0, "depression_angle": 45.0}, note="land cover",
    ),
    "bare": Ground(
        VALLEY, ("Bareground",), {"Wheat": "Bareground", "Corn": "Bareground"}, measure="soil_moisture_error",
        by="", fixed={"soil_moisture_field_sd": 0.1}, note="bare fields, 0.1 m3/m3 s.d. between them",
    ),
    "demmin": Ground(
        VALLEY, ("Wheat", "Rapeseed", "Oats", "Corn", "Vegetables", "Grass"), {"Forage": "Rapeseed"},
        note="wheat, rapeseed, barley, maize, sugar beet, grass",
    ),
    "manitoba": Ground(
        VALLEY, ("Wheat", "Oats", "Rapeseed", "Vegetables", "Forage"), {"Grass": "Rapeseed"}, late_days=LATER,
        note=f"wheat, oats, canola, soybean, forage{SOWN}",
    ),
    "hokkaido": Ground(
        VALLEY, ("Wheat", "Corn", "Vegetables"), late_days=20, note="winter wheat, maize, beans, beet and potato"
    ),
    "wheat": Ground(
        VALLEY, ("Wheat",), dict.fromkeys(("Corn", "Oats", "Vegetables", "Forage", "Grass"), "Wheat"),
        measure="soil_moisture_error", by="", engine="prm", note="wheat, 0.04 m3/m3 s.d. between fields",
    ),
    "semiarid": Ground(
        "wake-radiometer", ("Scrub", "Bareground", "Grass"),
        {"Trees": "Scrub", "Settlement": "Bareground", "Hay": "Grass"}, measure="soil_moisture_error", by="",
        fixed={"altitude_m": 3000.0, "resolution": 200.0}, engine="prm", note="grass, scrub, bare soil",
    ),
}  # fmt: skip


def on(frequency: str, polarization: str, days: str = "", **more: Any) -> dict[str, Any]:
    """Settings of a run, and ``by`` which unit of ground, where it is not that of the ground."""
    return {"frequency": frequency, "polarization": polarization, **({"days": days} if days else {}), **more}


def at(angle_deg: float) -> dict[str, float]:
    """Incidence at the middle of the scene."""
    return {"depression_angle": 90.0 - angle_deg}


def at_angles(polarization: str, *angles_deg: float, **more: Any) -> dict[str, Any]:
    """Settings of a run of C band at several incidence angles."""
    members = {f"at {angle:g}": {"frequency": "C", **at(angle)} for angle in angles_deg}
    return on("+".join(members), polarization, members=members, **more)


THREE, HIGH = (27.75, 34.20, 39.95), {"altitude_m": 60_000.0}

# Settings by name; of several, the mean or, of "best", the highest score.
SETTINGS: dict[str, tuple[dict[str, Any], ...]] = {
    "C, RH+RV, 1 July": (on("C", "RH+RV", "182"),),
    "C, RH+RV, 30 July": (on("C", "RH+RV", "211"),),
    "C, RH+RV, 27 August": (on("C", "RH+RV", "239"),),
    "C, RH+RV, 3 dates": (on("C", "RH+RV", "182+211+239"),),
    "X, HH+VV, 6 dates": (on("X", "HH+VV", "110+130+150+170+190+210"),),
    "X, HH+VV+phase, 6 dates": (on("X", "HH+VV+phase", "110+130+150+170+190+210"),),
    "C, one channel, 1 date": tuple(on("C", channel, "200") for channel in CHANNELS),
    "C, one channel, 5 dates": tuple(on("C", channel, SEASON) for channel in CHANNELS),
    "C, full, 1 date": (on("C", FULL, "200"),),
    "C, full, 5 dates": (on("C", FULL, SEASON),),
    "map and C, full, 5 dates": (on("C", FULL, SEASON),),
    "C, VV+VH, 6 dates": (on("C", "VV+VH", LATE),),
    "X, VV+VH, 6 dates": (on("X", "VV+VH", LATE),),
    "C, full and X, HH+VV, 5 dates": (on("C+X", FULL, SEASON, members={"X": {"polarization": "HH+VV"}}),),
    "X, HH+VV, January to April": (on("X", "HH+VV", "15+45+75+105"),),
    "X, HH+VV, January to June": (on("X", "HH+VV", "15+45+75+105+135+165"),),
    "L, best channel": tuple(on("L", channel) for channel in CHANNELS),
    "L, HV+VV": (on("L", "HV+VV"),),
    "L, HH+HV+VV": (on("L", "HH+HV+VV"),),
    "L, full": (on("L", FULL),),
    "C+L, full": (on("C+L", FULL),),
    "C, full": (on("C", FULL),),
    "C, HH, 12 deg": (on("C", "HH", **at(12.0), **HIGH),),
    "C, HH, 40 deg": (on("C", "HH", **at(40.0), **HIGH),),
    "C, HH, 23 deg": (on("C", "HH", **at(23.0)),),
    "C, HH+HV, 23 deg": (on("C", "HH+HV", **at(23.0)),),
    "C, HH, 23 and 43 deg": (at_angles("HH", 23.0, 43.0),),
    "C, HH+HV, 23 and 43 deg": (at_angles("HH+HV", 23.0, 43.0),),
    "C, VV+HV, 45 deg": (on("C", "VV+HV", "200", **at(45.0)),),
    "C, VV+HV, 45 deg, 2 dates": (on("C", "VV+HV", "200+212", **at(45.0)),),
    "C, VV+HV, 25 and 45 deg": (at_angles("VV+HV", 25.0, 45.0, days="200"),),
    "C, full, best of 28, 34 and 40 deg": tuple(at_angles(FULL, angle, **HIGH) for angle in THREE),
    "C, full, 28, 34 and 40 deg": (at_angles(FULL, *THREE, **HIGH),),
    "C, VV, 5 August, by field": (on("C", "VV", "217", by="field"),),
    "C, VV, 5 August, by pixel": (on("C", "VV", "217", by="pixel"),),
    "C, VV, 3 dates, by field": (on("C", "VV", "165+190+217", by="field"),),
    "C, VV, 3 dates, by pixel": (on("C", "VV", "165+190+217", by="pixel"),),
    "L, RH+RV+phase": (on("L", "RH+RV+phase"),),
    "L, two channels": tuple(on("L", both) for both in ("HH+HV", "VV+VH", "HH+VV+phase")),
    "L, HH+HV": (on("L", "HH+HV"),),
    "C, HV, 10 dates": (on("C", "HV", WEEKLY),),
    "C, VV, 10 dates": (on("C", "VV", WEEKLY),),
    "L, HV, 10 dates": (on("L", "HV", WEEKLY),),
    "L, HH, 10 dates": (on("L", "HH", WEEKLY),),
    "C, full, 30 May": (on("C", FULL, "150"),),
    "C, full, 24 July": (on("C", FULL, "205"),),
    "C, VV+VH, 2 dates": (on("C", "VV+VH", "165+225"),),
    "C, VV+VH and X, HH, 2 dates": (on("C+X", "VV+VH", "165+225", members={"X": {"polarization": "HH"}}),),
    "L+C, VV+VH, 3 dates": (on("L+C", "VV+VH", "150+180+210"),),
    "C+X, VV+VH, 3 dates": (on("C+X", "VV+VH", "150+180+210"),),
    "L+C+X, VV+VH, 3 dates": (on("L+C+X", "VV+VH", "150+180+210"),),
    "C, VV+VH, 3 dates, 4 looks, by neighbourhood": (on("C", "VV+VH", "150+180+210", by="neighbourhood", looks=4.0),),
    "C, VV+VH, 3 dates, 4 looks, by pixel": (on("C", "VV+VH", "150+180+210", by="pixel", looks=4.0),),
    "radiometer of 1.4 GHz": ({"frequency": 1.4},),
    "radiometer of 5.4 GHz": ({"frequency": 5.4},),
    "radiometer of 10.7 GHz": ({"frequency": 10.7},),
    "L+S, HH": (on("L+S", "HH"),),
    "L+S, HH+HV+VV": (on("L+S", "HH+HV+VV"),),
}


def contrasts() -> list[dict[str, str]]:
    """Rows of the file of published contrasts."""
    lines = [line for line in (OUT / "contrasts.csv").read_text(encoding="utf-8").splitlines() if line[0] != "#"]
    return list(csv.DictReader(lines))


@cache
def scene_of(name: str) -> Scene:
    """The scene of a ground."""
    ground = GROUNDS[name]
    scene = load_scene(ROOT / "campaigns" / ground.campaign / "scene.npz")
    called = [ground.becomes.get(own, own) for own in scene.categories]
    categories = tuple(dict.fromkeys(called))
    cover = scene.cover.copy()
    for old, own in enumerate(called):
        cover[scene.cover == old] = categories.index(own)
    asked = np.isin(cover, [categories.index(own) for own in ground.scored])
    return replace(scene, cover=cover, categories=categories, scored=scene.scored & asked, category_notes={})


def scores(world: int) -> dict[tuple[str, str], float]:
    """Score in a world of every ground and setting that is asked for."""
    found: dict[tuple[str, str], float] = {}
    for ground, *names in (*((row["ground"], row["other"], row["one"]) for row in contrasts()), *ANGLES):
        for name in names:
            place = ground, name
            if place not in found and name in SETTINGS:
                values, guesses = zip(*(_score(*place, settings, world) for settings in SETTINGS[name]), strict=True)
                found[place] = float(np.max(values) if "best" in name else np.mean(values))
                if name.startswith("map"):
                    found[ground, "map"] = guesses[0]
    return found


def _score(name: str, setting: str, settings: dict[str, Any], world: int) -> tuple[float, float]:
    """Of images, with the optical map besides where the setting names it, and of that map or a guess alone."""
    ground, scene = GROUNDS[name], scene_of(name)
    own = dict(settings)
    members, by = own.pop("members", {}), f" by {own.pop('by')}" if "by" in own else ground.by
    fixed = {key: value for key, value in {**ENGINES[ground.engine], **ground.fixed}.items() if key not in own}
    more: dict[str, Any] = {"members": members, "world": world, "late_days": ground.late_days}
    task = SimulationTask(ground.engine, world, SEED, own, fixed, "", "", (), **more)
    images = simulate_images(task, scene)
    known = optical_map(name, world) if setting.startswith("map") else None
    score = score_by(ground.measure + by, images, scene, seed=SEED, run_id=world, known=known)
    return score.value, score.guess


def optical_map(name: str, world: int) -> KnownMap:
    """A map that errs alike in all scored covers."""
    categories, scored = scene_of(name).categories, GROUNDS[name].scored
    wrong = [float(c in scored) * (1.0 - MAP_CORRECT) / (len(scored) - 1) for c in categories]
    share = np.tile(wrong, (len(categories), 1))
    for k, category in enumerate(categories):
        share[k, k] = MAP_CORRECT if category in scored else 1.0
    return KnownMap(categories, share / share.sum(axis=1, keepdims=True), key=world)


def span(text: str) -> Pair:
    """Least and most of "a", "a to b", "> a" or "< a"; nan of ""."""
    least, most = (-np.inf if text.startswith("<") else None), (np.inf if text.startswith(">") else None)
    ends = [float(part) for part in text.strip("<> ").split(" to ")] if text else [np.nan]
    return np.array([ends[0] if least is None else least, ends[-1] if most is None else most])


def log_odds(percent: Pair) -> Pair:
    """Logarithm of p / (1 - p)."""
    share = np.clip(np.asarray(percent) / 100.0, 0.0, 1.0)
    with np.errstate(divide="ignore"):
        return np.asarray(np.log(share) - np.log(1.0 - share))


def page(found: list[dict[tuple[str, str], float]]) -> str:
    """The page as Markdown."""
    rows, inside, right, errors = [], [], [], []
    for row in contrasts():
        ground = GROUNDS[row["ground"]]
        one, other = (np.array([world[row["ground"], row[name]] for world in found]) for name in ("one", "other"))
        digits = DIGITS.get(ground.measure, 1)
        scores = [span(row["score_one"]), span(row["score_other"])]
        stated = row["score_one"] != ""
        gain = scores[0] - scores[1][::-1] if stated else span(row["gain"])
        ratio, odds = np.full(2, np.nan), np.zeros(0)
        if ground.measure == "percent_correct":
            odds = np.exp(log_odds(one) - log_odds(other))
            ratio = np.exp(log_odds(scores[0]) - log_odds(scores[1])[::-1]) if stated else ratio
        told, simulated = (ratio, odds) if np.isfinite(ratio).any() else (gain, one - other)
        least, most = np.quantile(simulated, [0.025, 0.975])
        inside.append(bool(told[0] <= most and told[1] >= least))
        if gain[0] > 0.0 or gain[1] < 0.0 or (np.isinf(gain).any() and 0.0 in gain):
            right.append(bool(np.sign(np.median(one - other)) == np.sign(gain.sum())))
        if digits == 1:
            errors.append((one - other).std(ddof=1) / np.sqrt(len(one)))
        cells = [
            row["contrast"], row["ground"], f"{one.mean():.{digits}f}", f"{other.mean():.{digits}f}",
            _span(gain, f"+.{digits}f"), _range(one - other, f"+.{digits}f"), _span(ratio, ".2f"), _range(odds, ".2f"),
            "yes" if inside[-1] else "no",
        ]  # fmt: skip
        rows.append(f"| {' | '.join(cells)} |")
    grounds = [f"| {name} | {', '.join(g.scored)} | {g.note or 'as they are'} |" for name, g in GROUNDS.items()]
    sources = dict.fromkeys(row["source"] for row in contrasts() if len(row["source"]) > 40)
    return "\n".join(
        [
            "# Published contrasts that no table rests on",
            "",
            "Written by `python tests/studies/contrasts_study.py`.",
            "",
            f"What one setting gains over another, published and simulated in {len(found)} worlds with the same",
            "draws for both: percent correct by field, kappa by field, or error of soil moisture [m3/m3]. Grounds are",
            "shipped scenes with covers like those of the source (below). The ratio is that of the odds of a correct",
            "label, p / (1 - p), which depends less on how hard a site is. *Inside*: the published ratio, or the gain",
            "where no scores are stated, meets the range over worlds. Settings and scores are in `contrasts.csv`.",
            "",
            f"Inside: {sum(inside)} of {len(inside)}; right sign: {sum(right)} of the {len(right)} that state one.",
            f"Standard errors of mean gains: {min(errors):.1f} to {max(errors):.1f} points.",
            "",
            "| contrast | ground | one | other | published gain | simulated, median and 95 % range | published ratio "
            "| simulated | inside |",
            "|---|---|---|---|---|---|---|---|---|",
            *rows,
            "",
            *WORDS,
            *angles(found),
            "",
            "## How the brightness of bare soil changes with moisture",
            "",
            "| frequency [GHz] | moisture [m3/m3] | published [K] | table, nadir [K] | H, 40 deg [K] | source |",
            "|---|---|---|---|---|---|",
            *brightness(),
            "",
            "## Grounds",
            "",
            "Wheat and rapeseed have the course of crops sown in autumn, shifted or not: they are tall in June, where",
            "those sown in May are short.",
            "",
            "| ground | covers scored | stand for |",
            "|---|---|---|",
            *grounds,
            "",
            "## Sources",
            "",
            *(f"- {source}" for source in sources),
            "",
        ]
    )


def angles(found: list[dict[tuple[str, str], float]]) -> list[str]:
    """What a second incidence angle, or a second date, gains over the worlds, in Markdown."""
    rows = ["| ground | one | mean score | other | mean score | gain |", "|---|---|---|---|---|---|"]
    for name, *settings in ANGLES:
        one, other = (np.array([world[name, setting] for world in found]) for setting in settings)
        digits = DIGITS.get(GROUNDS[name].measure, 1)
        error = (one - other).std(ddof=1) / np.sqrt(len(one))
        gain = f"{np.mean(one - other):+.{digits + 1}f} ± {error:.{digits + 1}f}"
        means = (f"{own.mean():.{digits}f}" for own in (one, other))
        cells = (text for pair in zip(settings, means, strict=True) for text in pair)
        rows.append(f"| {name} | {' | '.join(cells)} | {gain} |")
    return rows


def brightness() -> list[str]:
    """How the brightness of bare soil at 293 K goes with its moisture, by the table, in Markdown."""
    rows = []
    for ghz, dry, wet, published, source in BRIGHTNESS:
        found = load_emissivity_table().lookup(("Bareground",), ghz, "H").emissivity[0]
        low, high = (np.array([np.interp(m, MOISTURE_NODES, line) for line in found.T]) for m in (dry, wet))
        told = " | ".join(f"{293.0 * (high - low)[angle]:.0f}" for angle in (0, 40))
        rows.append(f"| {ghz} | {dry} to {wet} | {published} | {told} | {source} |")
    return rows


def _span(ends: Pair, form: str) -> str:
    """Two numbers that may be one, half open, or none."""
    low, high = ends
    if np.isnan(low):
        return ""
    if not np.isfinite(ends).all():
        return f"{high:{form}} or less" if np.isinf(low) else f"{low:{form}} or more"
    return format(low, form) if np.isclose(low, high) else f"{low:{form}} to {high:{form}}"


def _range(values: Pair, form: str) -> str:
    if not len(values):
        return ""
    low, middle, high = np.quantile(values, [0.025, 0.5, 0.975])
    return f"{middle:{form}} ({low:{form}} to {high:{form}})"


def main() -> None:
    """Write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worlds", type=int, default=100)
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    with ProcessPoolExecutor(given.workers) as pool:
        found = list(pool.map(scores, range(given.worlds)))
    (OUT / "contrasts.md").write_text(page(found), encoding="utf-8")


if __name__ == "__main__":
    main()
