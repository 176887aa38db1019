"""A campaign of 10,000 runs: time and memory of the commands.

    python tests/studies/load_study.py

Writes its section of reports/reliability.md. Times are of the whole command in a process of its own, start of
Python and imports included; the least of two.
"""

from __future__ import annotations

import os
import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from reliability_report import machine, write_section

RUNS = 10_000
MEMORY_MB = 1000
LIMITS = {"status": 1.0, "fit": 2.0, "report": 30.0}
SPEC = """\
[campaign]
name = "large"
seed = 3
[[factor]]
name = "frequency"
unit = "GHz"
low = 1.0
high = 17.0
scale = "log"
[[factor]]
name = "resolution"
unit = "m"
low = 5.0
high = 50.0
scale = "log"
[[factor]]
name = "polarization"
levels = ["HH", "VV", "HV"]
[[application]]
name = "crops"
utility = "percent_correct"
[model]
block = "day"
[stop]
half_width = 2.0
max_runs = 20000
"""


def write_campaign(folder: Path, n: int, rng: random.Random) -> Path:
    """A campaign whose scores are quadratic in the coded factors, with noise and ten flight days."""
    folder.mkdir(parents=True)
    (folder / "campaign.toml").write_text(SPEC, encoding="utf-8")
    rows = []
    for k in range(n):
        x, y, level = rng.uniform(-1, 1), rng.uniform(-1, 1), rng.randrange(3)
        score = 70 - 8 * (x - 0.2) ** 2 - 6 * (y + 0.3) ** 2 + 3 * level + 2 * x * y + rng.gauss(0, 3)
        frequency, resolution = 17 ** ((x + 1) / 2), 5 * 10 ** ((y + 1) / 2)
        rows.append(f"{frequency:.6g},{resolution:.6g},{('HH', 'VV', 'HV')[level]},{score:.3f},day {k % 10},{k}")
    header = "frequency,resolution,polarization,score,day,number\n"
    (folder / "scores.csv").write_text(header + "\n".join(rows) + "\n", encoding="utf-8")
    return folder


def timed(*arguments: object) -> tuple[float, float, float]:
    """Wall clock [s], processor time [s] and largest memory [MB] of a command."""
    command = [sys.executable, "-m", "seqrsm", *map(str, arguments)]
    begin = time.monotonic()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    err = process.stderr.read() if process.stderr else b""
    _, status, usage = os.wait4(process.pid, 0)
    if os.waitstatus_to_exitcode(status) != 0:
        raise SystemExit(err.decode())
    return time.monotonic() - begin, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024


def best(*arguments: object, repeats: int = 2) -> tuple[float, float, float]:
    """Least wall clock and processor time, largest memory."""
    found = [timed(*arguments) for _ in range(repeats)]
    return min(f[0] for f in found), min(f[1] for f in found), max(f[2] for f in found)


def missed(rows: list[tuple[str, float, float, float, str]]) -> str:
    """Which limits do not hold, by processor time and memory."""
    slow = [what for what, _, cpu, _, limit in rows if limit and cpu > float(limit.split()[0])]
    large = [what for what, _, _, memory, _ in rows if memory > MEMORY_MB]
    late = f"Above target, by processor time: {', '.join(slow) or 'none'}."
    return f"{late} More than {MEMORY_MB} MB: {', '.join(large) or 'none'}."


def main() -> None:
    """Measure, and write the section."""
    rng = random.Random(1)
    rows: list[tuple[str, float, float, float, str]] = []
    with tempfile.TemporaryDirectory() as name:
        folder = write_campaign(Path(name) / "large", RUNS, rng)
        bare = best("--version")
        rows.append(("`--version` (start of Python alone)", *bare, ""))
        rows.append((f"`ingest` of {RUNS} rows", *timed("ingest", folder, folder / "scores.csv"), ""))
        for command in ("status", "status --history", "fit", "propose", "export"):
            rest = [folder / "all.json"] if command == "export" else []
            words = command.split()
            limit = LIMITS.get(command)
            measured = best(words[0], folder, *words[1:], *rest, repeats=1 if command in ("propose", "fit") else 2)
            rows.append((f"`{command}`", *measured, f"{limit:g} s" if limit else ""))
            print(rows[-1], flush=True)
        rows.append(("`report`", *timed("report", folder), f"{LIMITS['report']:g} s"))
        print(rows[-1], flush=True)
    lines = [
        f"A campaign of {RUNS} measured runs, two continuous factors, one of three levels, ten blocks. Whole",
        "commands, including start of Python and imports: least wall-clock and processor time, largest memory. The",
        "machine was shared, so processor time is the better measure.",
        "",
        "| command | wall clock [s] | processor [s] | memory [MB] | target |",
        "|---|---|---|---|---|",
        *(f"| {what} | {wall:.2f} | {cpu:.2f} | {memory:.0f} | {limit} |" for what, wall, cpu, memory, limit in rows),
        "",
        missed(rows),
        "",
        f"{machine()} Command: `python tests/studies/load_study.py`.",
    ]
    write_section("5-load", "Load", lines)


if __name__ == "__main__":
    main()
