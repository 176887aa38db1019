"""Whole runs, campaigns and commands against the code as it was, each row by both in turns.

    python tests/benchmarks/bench_runs.py --before CHECKOUT [--write] [--only runs|commands]

CHECKOUT is a work tree of an earlier commit. Times of runs are the least CPU time of several, those of commands CPU
time of process and children; workers are compared by wall time. ``--write`` writes ``reports/performance-runs.md``.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import shutil
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).parents[2]
ROUNDS = int(os.environ.get("ROUNDS", "2"))

CODE = """
import json, sys, time
sys.path[:0] = [{code!r} + "/tests" + own for own in ("/benchmarks", "/physics", "")]
import numpy as np
from psm_cases import Table, radar, scene
from seqrsm.scene.file import load_scene
from seqrsm.scattering.emissivity import load_emissivity_table
from seqrsm.scattering.sigma0 import load_sigma0_table
from seqrsm.sensor import radar as radars, radiometer as radiometers
from seqrsm.simulate.radar.psm import simulate_radar
from seqrsm.simulate.radiometer.prm import simulate_radiometer
try:  # as it was before dates
    from seqrsm.score.utilities import of_images

    def score_of(image, scene, engine="psm"):
        return of_images(engine)["percent_correct"](image, scene, **key)
except ImportError:
    from seqrsm.score.cover import score_cover
    from seqrsm.score.utilities import Asked

    def score_of(image, scene, engine="psm"):
        return score_cover([image], scene, Asked("percent_correct"), **key)

def best(n, call):
    call()
    times = []
    for _ in range(n):
        start = time.process_time()
        call()
        times.append(time.process_time() - start)
    return min(times)

out = {{}}
key = dict(seed=1, run_id=1)
table = Table(tuple(np.linspace(-20.0, -6.0, 10)), 0.15)
def drawn(n, rough):
    rng = np.random.default_rng(0)
    blocks, ones = n // 40 + 1, np.ones((40, 40), dtype=np.int64)
    cover = np.kron(rng.integers(0, 10, (blocks, blocks)), ones)[:n, :n]
    field = np.kron(np.arange(blocks * blocks).reshape(blocks, blocks), ones)[:n, :n]
    z = rough * rng.normal(0.0, 1.0, (n, n)).astype(np.float32)
    return scene(z, 5.0, cover, field)
def sensor(n):
    height = max(6000.0, 5.0 * n)
    return radar(resolution_m=25.0, depression_angle_deg=40.0, altitude_m=height, prf_hz=500.0, looks=10.0)
for name, n, rough, count in (("flat 250", 250, 0.0, 60), ("flat 2000", 2000, 0.0, 5), ("flat 4000", 4000, 0.0, 3),
                              ("rough 1000", 1000, 4.0, 10)):
    s, r = drawn(n, rough), sensor(n)
    image = lambda: simulate_radar(s, r, table, **key)
    made = image()
    score_of(made, s)
    share = 1e9 / n / n
    out[name + ", image [ns a cell]"] = share * best(count, image)
    out[name + ", whole run [ns a cell]"] = share * best(count, lambda: score_of(image(), s))
    def registered():
        new = image()
        new.pixel_of_cell
    out[name + ", image and registration [ns a cell]"] = share * best(count, registered)
campaigns = {code!r} + "/campaigns/"  # its own: the cover classes have other names since
s, t = load_scene(__import__("pathlib").Path(campaigns + "langegracht-radar/scene.npz")), load_sigma0_table()
fixed = dict(bandwidth=50.0, peak_power=30.0, altitude_m=6000.0)
for resolution in (6.0, 14.0):
    settings = dict(frequency=1.25, polarization="HH+HV+VV", resolution=resolution, depression_angle=30.0)
    r = radars.from_settings(settings, fixed)
    name = f"Langegracht, {{resolution:g}} m, three channels"
    out[name + ", image [ms]"] = 1e3 * best(10, lambda: simulate_radar(s, r, t, **key))
    out[name + ", whole run [ms]"] = 1e3 * best(10, lambda: score_of(simulate_radar(s, r, t, **key), s))
s, t = load_scene(__import__("pathlib").Path(campaigns + "wake-radiometer/scene.npz")), load_emissivity_table()
fixed = dict(bandwidth=100.0, noise_temperature=500.0, scan_period=2.5, altitude_m=6000.0, speed_m_s=80.0)
r = radiometers.from_settings(dict(frequency=20.0, polarization="H+V", resolution=80.0, integration_time=8.0), fixed)
out["Wake County, image [ms]"] = 1e3 * best(10, lambda: simulate_radiometer(s, r, t, **key))
out["Wake County, whole run [ms]"] = 1e3 * best(10, lambda: score_of(simulate_radiometer(s, r, t, **key), s, "prm"))
print(json.dumps(out))
"""


def environment(code: Path, cache: str = "") -> dict[str, str]:
    own = {"PYTHONPATH": str(code), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    own["PYTHONDONTWRITEBYTECODE"] = ""  # an installed package has its bytecode: a third of a command's time else
    return {**os.environ, **own, **({"XDG_CACHE_HOME": cache} if cache else {})}


def runs(code: Path) -> dict[str, float]:
    """Rows of single runs."""
    text = CODE.format(code=str(code))
    with TemporaryDirectory() as folder:  # python -c looks for modules here first
        done = subprocess.run(
            [sys.executable, "-c", text], env=environment(code), capture_output=True, text=True, cwd=folder, check=False
        )
    if done.returncode:
        raise SystemExit(done.stderr)
    return dict(json.loads(done.stdout.splitlines()[-1]))


def command(code: Path, folder: Path, *words: str, cache: str = "") -> tuple[float, float, float]:
    """CPU and wall seconds of a command of seqrsm, and wall seconds until its first word."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    line = [sys.executable, "-m", "seqrsm", *words]
    both = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
    with subprocess.Popen(line, env=environment(code, cache), text=True, cwd=folder, **both) as process:
        told = process.stdout.readline()
        first = time.perf_counter() - start
        told += process.stdout.read()
    if process.returncode not in (0, 3):
        raise SystemExit(told)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return cpu, time.perf_counter() - start, first


def commands(code: Path, *, cold: bool) -> dict[str, float]:
    """Rows of whole commands on the first example, as the tree itself has it."""
    out = {}
    with TemporaryDirectory() as parent:
        folder = Path(parent)
        for name in ("one", "two", "first"):
            shutil.copytree(code / "campaigns" / "langegracht-radar", folder / name)
        cpu, wall, _ = command(code, folder, "run", "one")
        out["run langegracht-radar, one process [s CPU]"] = cpu
        out["run langegracht-radar, one process [s wall]"] = wall
        out["run langegracht-radar, --workers 2 [s wall]"] = command(code, folder, "run", "two", "--workers", "2")[1]
        out["fit, warm [s CPU]"] = command(code, folder, "fit", "one")[0]
        out["report, warm [s CPU]"] = command(code, folder, "report", "one")[0]
        if cold:
            cpu, _, first = command(code, folder, "run", "first", cache=parent)
            out["first run, nothing compiled [s CPU]"] = cpu
            out["first run, nothing compiled: first line [s wall]"] = first
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--before", type=Path, required=True)
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--only", choices=("runs", "commands"))
    given = parser.parse_args()
    trees = {"before": given.before.resolve(), "now": ROOT}
    found: dict[str, dict[str, float]] = {name: {} for name in trees}
    for number in range(ROUNDS):
        for name, code in trees.items():
            rows = {} if given.only == "commands" else runs(code)
            rows |= {} if given.only == "runs" else commands(code, cold=number == 0)
            for row, value in rows.items():
                found[name][row] = min(value, found[name].get(row, value))
    lines = [
        "# Whole runs and commands, before and now",
        "",
        "Written by `python tests/benchmarks/bench_runs.py --before CHECKOUT --write`, the "
        f"least of {ROUNDS} rounds in which both took turns, load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores.",
        "",
        "| what | before | now | now / before |",
        "|---|---|---|---|",
    ]
    for row, value in found["now"].items():
        old = found["before"][row]
        lines.append(f"| {row} | {old:.3g} | {value:.3g} | {value / old:.2f} |")
    text = "\n".join(lines) + "\n"
    print(text)
    if given.write:
        (ROOT / "reports" / "performance-runs.md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
