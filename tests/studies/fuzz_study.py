"""At least 100,000 spoilt inputs for every reader of files that users hand in.

    python tests/studies/fuzz_study.py                  # goes on where it was stopped
    python tests/studies/fuzz_study.py --inputs 1000000 # further seeds

Writes reports/reliability/fuzz.csv, a row for each thousand inputs, and its section of reports/reliability.md. Inputs
are made from seeds: `fuzzing.spoilt(target, seed)` gives any of them again.
"""

from __future__ import annotations

import argparse
import csv
import resource
import sys
import tempfile
import warnings
from pathlib import Path

TESTS = Path(__file__).parents[1]
sys.path[:0] = [str(Path(__file__).parent), str(TESTS / "security"), str(TESTS)]

from fuzzing import LIMIT_S, fuzz, targets  # noqa: E402
from reliability_report import FOLDER, machine, package, write_section  # noqa: E402

TABLE = FOLDER / "fuzz.csv"
COLUMNS = ("target", "first_seed", "inputs", "accepted", "refused", "slowest_s", "failures", "package")
CHUNK = 1000
MEMORY = 6 << 30
"""Address space [bytes]; what asks for more gets a MemoryError."""
SHARES = {"toml": 30, "geotiff": 25, "npz": 10, "csv": 11, "expression": 10, "legend": 2, "sigma0": 2}
"""Percent of the inputs for each target."""


def rows() -> list[dict[str, str]]:
    """What earlier calls have done."""
    if not TABLE.exists():
        return []
    with TABLE.open(newline="", encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


def carry_on(inputs: int) -> None:
    """Chunks of a thousand until every target had its share."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    now = package()
    done = {(row["target"], int(row["first_seed"])) for row in rows()}
    with tempfile.TemporaryDirectory() as name:
        every = targets(Path(name))
        for target, share in SHARES.items():
            for first in range(0, -(-inputs * share // 100 // CHUNK) * CHUNK, CHUNK):
                if (target, first) in done:
                    continue
                tally = fuzz(every[target], Path(name), range(first, first + CHUNK))
                for seed, what in tally.failures:
                    print(f"{target} seed {seed}: {what}", flush=True)
                with TABLE.open("a", newline="", encoding="utf-8") as stream:
                    writer = csv.writer(stream, lineterminator="\n")
                    if stream.tell() == 0:
                        writer.writerow(COLUMNS)
                    counts = (
                        tally.inputs,
                        tally.accepted,
                        tally.refused,
                        f"{tally.slowest_s:.3f}",
                        len(tally.failures),
                    )
                    writer.writerow([target, first, *counts, now])
            print(f"{target} done", flush=True)


def report() -> None:
    """The section of reports/reliability.md."""
    done = rows()
    total = sum(int(row["inputs"]) for row in done if row["target"] in SHARES)
    failures = sum(int(row["failures"]) for row in done if row["target"] in SHARES)
    lines = [
        f"{total} inputs, made from valid files by seeded changes of bytes, tokens, numbers, values, lines, tags and "
        f"archive members, were read. {failures} of them led "
        "to anything but acceptance or an error message: an exception of another kind, more than "
        f"{LIMIT_S:.0f} s of processor time, a file written outside the reader's folder, a process started, a "
        "connection opened, a pickle (watched by an audit hook; the address space was held to "
        f"{MEMORY >> 30} GB, so that bombs show).",
        "",
        "| reader | inputs | accepted | refused | failures | slowest [s] |",
        "|---|---|---|---|---|---|",
    ]
    for target in SHARES:
        mine = [row for row in done if row["target"] == target]
        sums = [sum(int(row[name]) for row in mine) for name in ("inputs", "accepted", "refused", "failures")]
        slowest = max((float(row["slowest_s"]) for row in mine), default=0.0)
        lines.append(f"| {target} | {' | '.join(map(str, sums))} | {slowest:.2f} |")
    packages = ", ".join(sorted({row["package"] for row in done}))
    lines += [
        "",
        f"Package: {packages} (`git rev-parse --short HEAD:seqrsm`). {machine()} "
        "Command: `python tests/studies/fuzz_study.py`.",
    ]
    write_section("4-fuzz", "Malformed input", lines)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--inputs", type=int, default=140_000)
    warnings.simplefilter("ignore")
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    carry_on(parser.parse_args().inputs)
    report()
