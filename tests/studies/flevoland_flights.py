"""Do intervals for flights hold over Flevoland, for campaigns that know its classes only as a table would?

    OPENBLAS_NUM_THREADS=1 python tests/studies/flevoland_flights.py [--campaigns 12] [--workers 2]

Each campaign simulates the labelled fields from class means as two other grounds would give them, one draw: the
flight's own means are left out. Real AIRSAR scores (``campaigns/flevoland``) are then taken in as flights, and those
that are left test the prediction interval of a flight. Writes ``reports/validation/flevoland_flights.md``.
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
from validate_flevoland import (
    CELL_M,
    EFFECTIVE,
    TEXTURE_DB,
    TEXTURE_M,
    class_rows,
    field_spread_db,
    flight_scores,
    scene,
)

from seqrsm.campaign.campaign import Campaign
from seqrsm.campaign.loop import run_campaign
from seqrsm.scattering.worlds import World
from seqrsm.scene.file import save_scene
from seqrsm.store.records import IngestedFile, IngestedRun, NewScore

OUT = Path(__file__).parents[2] / "reports" / "validation" / "flevoland_flights.md"
RUNS, LOOKS, LEVEL = 48, (0, 8, 20), 0.95
MEAN_SD_DB = {"HH": 2.1, "HV": 3.1, "VV": 2.1}
"""Of a measured L-band mean, and of its date, which these classes do not draw: seqrsm/scattering/data/mean_sd.csv."""
GROUNDS = 2  # whose mean such a row is
NO_CROPS = ("Forest", "Bare soil", "Water", "Buildings")
KNOWN_M = 97.0  # coarser cells hold much of the ground between the labelled fields, which is drawn
SPEC = f"""
[campaign]
name = "flevoland-both"
seed = {{seed}}
batch = 4
[[factor]]
name = "polarization"
levels = ["HH", "HV", "VV", "HH+HV", "HV+VV", "HH+VV", "HH+HV+VV"]
[[factor]]
name = "looks"
low = {4.0 * EFFECTIVE}
high = {2304.0 * EFFECTIVE}
scale = "log"
[[factor]]
name = "resolution"
unit = "m"
low = 12.1
high = 290.4
scale = "log"
[[constraint]]
expr = "looks <= {4.01 * EFFECTIVE} * (resolution / {CELL_M}) ** 2"
[[application]]
name = "crops"
utility = "percent_correct"
[simulator]
engine = "psm"
scene = "scene.npz"
table = "classes.csv"
[simulator.fixed]
frequency = 1.25
bandwidth = 60.0
peak_power = 6000.0
depression_angle = 45.0
altitude_m = 8000.0
speed_m_s = 200.0
texture_db = {TEXTURE_DB}
texture_m = {TEXTURE_M}
[stop]
half_width = 0.5
level = {LEVEL}
max_runs = {RUNS}
"""
Settings = list[dict[str, float | str]]
Rows = list[dict[str, float]]
Choice = Callable[[Settings], np.ndarray]


def channels_left_out(settings: Settings) -> np.ndarray:
    """Whether the radar records HH and HV alone."""
    return np.array([one["polarization"] == "HH+HV" for one in settings])


def fine_left_out(settings: Settings) -> np.ndarray:
    """Whether cells are finer than 40 m."""
    return np.array([float(one["resolution"]) < 40.0 for one in settings])


KINDS: dict[str, tuple[bool, Choice | None]] = {
    "as proposed": (True, None),
    "at random": (False, None),
    "at random, none of HH+HV; tested there": (False, channels_left_out),
    "at random, none below 40 m; tested there": (False, fine_left_out),
}


def classes(seed: int) -> str:
    """Long table of the class means as two other grounds would give them: one draw, given the means of this ground.

    Means of a crop on three grounds are exchangeable about the crop's own, so that the other two are expected nearer to
    the mean of all crops than those of this ground. A table drawn about this ground's own means would have crops
    further apart than any ground has. The table draws the means of the other two to that of all crops by as much, as
    `seqrsm.scattering.levels` does. Other covers likewise, among all.
    """
    lines = ["quantity,category,frequency_ghz,polarization,theta_deg,value,sd,mean_sd,unit,status,source"]
    crop = np.array([row["class"] not in NO_CROPS for row in class_rows()])
    names, world = [f"{row['class']} (flight)" for row in class_rows()], World(2**20 + seed, 0)
    for channel, sd in MEAN_SD_DB.items():
        here = np.array([float(row[f"{channel.lower()}_dB"]) for row in class_rows()])
        departure = np.array([world.departure(name, "", 1.25, channel)[40] for name in names])
        ground = sd**2 / (1.0 + 1.0 / (GROUNDS + 1))
        values = np.empty(len(here))
        for mine, among in ((crop, crop), (~crop, np.full(len(here), True))):
            kept = 1.0 - ground / here[among].var(ddof=1)
            spread = (ground * (kept + 1.0 / GROUNDS)) ** 0.5
            there = here[among].mean() + kept * (here - here[among].mean()) + spread * departure
            middle = there[among].mean()
            values[mine] = (middle + GROUNDS * kept / (1.0 + (GROUNDS - 1) * kept) * (there - middle))[mine]
        for name, value, fields in zip(names, values, field_spread_db(channel), strict=True):
            rest = f"{value:.3f},{fields:.3f},{sd},dB,measured,AIRSAR"
            lines += [f"sigma0,{name},1.25,{channel},{theta},{rest}" for theta in (0, 75)]
    return "\n".join(lines) + "\n"


def look(campaign: Campaign, points: np.ndarray, settings: Settings, real: np.ndarray, tested: np.ndarray) -> dict:
    """Interval at the recommended settings, and how intervals do on real scores that were not taken in."""
    (analysis,) = campaign.analyse_all(n_draws=400)
    best, index = analysis.optimum, np.flatnonzero(tested)
    found = analysis.fitted.bands(points[index], LEVEL)
    hit = (real[index] >= found.prediction.low) & (real[index] <= found.prediction.high)
    known = np.array([float(settings[i]["resolution"]) <= KNOWN_M for i in index])
    same = np.flatnonzero(points[:, 0] == best.point[0])
    nearest = same[int(np.argmin(np.sum((points[same, 1:] - best.point[1:]) ** 2, axis=1)))]
    return {
        "half": best.prediction.half_width,
        "mean": best.mean,
        "real": float(real[nearest]),
        "lost": float(real.max() - real[nearest]),
        "covered": float(hit.mean()),
        "known": float(hit[known].mean()),
    }


def flown(folder: Path, seed: int, asked: bool, left_out: Choice | None, settings: Settings, real: np.ndarray) -> Rows:
    """Looks after 0, 8 and 20 flights."""
    made = Campaign.open(folder)
    points = made.spec.region.code(settings)
    never = np.zeros(len(real), dtype=bool) if left_out is None else left_out(settings)
    taken, rng, looks = np.zeros(len(real), dtype=bool), np.random.default_rng(seed), []
    for n in range(0, LOOKS[-1] + 1, 4):
        if n in LOOKS:
            looks.append(look(made, points, settings, real, never if left_out else ~taken))
        if asked:
            wanted = []
            for run in made.propose(4, source="flight"):
                target = made.spec.region.code([run.proposed])[0]
                far = np.sum((points[:, 1:] - target[1:]) ** 2, axis=1) + 10.0 * (points[:, 0] != target[0])
                far[taken] = np.inf
                wanted.append(int(np.argmin(far)))
                taken[wanted[-1]] = True
                made.store.void(run.run_id, "flown at the nearest configuration of the recording")
        else:
            wanted = rng.choice(np.flatnonzero(~taken & ~never), 4, replace=False).tolist()
        taken[wanted] = True
        runs = tuple(
            IngestedRun(None, settings[i], "flight", "", 1.0, (NewScore("crops", float(real[i])),)) for i in wanted
        )
        made.store.ingest_files([IngestedFile(f"flights {n}", f"flights {n}", len(runs), runs)])
    return looks


def campaign(seed: int) -> dict[str, Rows]:
    """One campaign of simulations, then flights of each kind."""
    settings, real = [], []
    for polarization, looks, resolution, score in flight_scores():
        settings.append({"polarization": polarization, "looks": looks * EFFECTIVE, "resolution": resolution})
        real.append(score)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "simulated"
        folder.mkdir()
        save_scene(scene(), folder / "scene.npz")
        (folder / "classes.csv").write_text(classes(seed), encoding="utf-8")
        (folder / "campaign.toml").write_text(SPEC.format(seed=1979 + seed), encoding="utf-8")
        run_campaign(Campaign.open(folder))
        found = {}
        for k, (name, (asked, left_out)) in enumerate(KINDS.items()):
            own = shutil.copytree(folder, Path(place) / str(k))
            more = SPEC.format(seed=1979 + seed).replace(f"max_runs = {RUNS}", "max_runs = 400")
            (own / "campaign.toml").write_text(more, encoding="utf-8")
            found[name] = flown(own, seed, asked, left_out, settings, np.array(real))
    return found


HEAD = """# Simulation and flights together: Flevoland

Written by `python tests/studies/flevoland_flights.py --campaigns {campaigns}`. Each campaign simulates {runs} runs over
the labelled fields, every run in a world of its own, from class means as two other grounds let expect them, one draw,
known to 2.1 dB (HV 3.1 dB) on a date: the flight's own means are left out. Real AIRSAR scores are then taken in as
flights; those of the 196 configurations that are left test the 95 % prediction interval of a flight. *Covered*: share
of them inside, mean over campaigns and its standard error; *up to 97 m*: of those alone, since coarser cells hold much
of the ground between the labelled fields, which is drawn. *Half-width*, *predicted* and *real there* are of the
recommended settings and the configuration nearest to them; *lost*: the best real score less that one. One recording
gives all real scores: they share its speckle and its fields.
"""


def page(found: list[dict[str, Rows]]) -> str:
    """The page."""
    lines = [
        HEAD.format(campaigns=len(found), runs=RUNS),
        "| flights | taken in | covered [%] | up to 97 m [%] | half-width | predicted | real there | lost |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name in KINDS:
        for k, n in enumerate(LOOKS):
            rows = [one[name][k] for one in found]

            def share(key: str, rows: Rows = rows) -> str:
                values = 100.0 * np.array([row[key] for row in rows])
                return f"{values.mean():.0f} ± {values.std(ddof=1) / len(values) ** 0.5:.0f}"

            told = " | ".join(f"{np.mean([row[key] for row in rows]):.1f}" for key in ("half", "mean", "real", "lost"))
            lines.append(f"| {name} | {n} | {share('covered')} | {share('known')} | {told} |")
    notes = OUT.with_name("flevoland_flights_notes.md")
    return "\n".join(lines) + "\n\n" + (notes.read_text(encoding="utf-8") if notes.exists() else "")


def main() -> None:
    """Run the campaigns, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--campaigns", type=int, default=12)
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    with ProcessPoolExecutor(given.workers) as pool:
        OUT.write_text(page(list(pool.map(campaign, range(given.campaigns)))), encoding="utf-8")


if __name__ == "__main__":
    main()
