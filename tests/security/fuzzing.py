"""Inputs that nobody meant to write: seeded mutations of good files, and what every reader must do with them.

A reader may accept an input or raise a `SeqrsmError`. It may not raise anything else, take longer than `LIMIT_S`, write
a file outside its folder, start a process, or open a connection.
"""

from __future__ import annotations

import io
import json
import os
import random
import signal
import struct
import sys
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import tifffile
from synthetic import synthetic_scene

from seqrsm.design.constraints import Constraint
from seqrsm.design.factors import CategoricalFactor, ContinuousFactor
from seqrsm.design.region import Region
from seqrsm.errors import SeqrsmError
from seqrsm.scattering.sigma0 import load_sigma0_table
from seqrsm.scene.file import load_scene, save_scene
from seqrsm.scene.geotiff import read_geotiff
from seqrsm.scene.raster import read_legend
from seqrsm.score.cells import FactorColumn, Measure
from seqrsm.score.flight import read_scores
from seqrsm.score.ranking_file import is_rankings_file, read_rankings
from seqrsm.spec.read import load_spec

LIMIT_S = 10.0
"""Processor time [s] that reading an input may take; ten times as much on the clock."""

TOML = """\
[campaign]
name = "fuzz"
description = "text \\u00e9 'quoted'"
seed = 1979
batch = 4
[[factor]]
name = "frequency"
unit = "GHz"
low = 1.2
high = 17.0
scale = "log"
[[factor]]
name = "looks"
values = [1, 2, 4, 8, 16]
[[factor]]
name = "polarization"
levels = ["HH", "VV", "HH+HV"]
[[constraint]]
expr = "looks <= 4 * (frequency / 12.1) ** 2 or polarization == 'HH'"
[[application]]
name = "crops"
utility = "percent_correct"
goal = "maximize"
weight = 1.0
[application.prior]
utility = [40.0, 90.0]
optimum = { frequency = { value = 5.0, doubt = 0.4 } }
effect = { looks = [0.0, inf] }
[[application]]
name = "ice"
utility = "package.module:function"
[[consideration]]
name = "cost"
expr = "frequency * 2 + looks"
[model]
order = 2
response = "logit"
block = "day"
[cost]
flight = 250.0
[stop]
interval = "prediction_mean"
half_width = 4.0
level = 0.95
max_runs = 80
[store]
url = "sqlite:///other.db"
"""
SIMULATED = """\
[campaign]
name = "fuzz"
author = "A"
date = 2026-05-01
[[factor]]
name = "frequency"
levels = ["L", "L+C"]
[[factor]]
name = "polarization"
levels = ["HH", "HH+HV"]
[[factor]]
name = "C.resolution"
unit = "m"
low = 10.0
high = 60.0
scale = "log"
[[application]]
name = "cover"
utility = "percent_correct"
sufficient = 70.0
[application.prior]
utility = [60.0, 90.0]
probability = 0.9
repeat_sd = 2.0
effect = { "C.resolution" = [-10.0, -1.0] }
optimum = { "C.resolution" = { value = 20.0, doubt = 0.5 } }
[[candidate]]
name = "C alone"
parameters = { frequency = "L+C", "C.resolution" = 30.0 }
[simulator]
engine = "psm"
scene = "scene.npz"
tolerance = 1.0
[simulator.fixed]
resolution = 20.0
bandwidth = 60.0
peak_power = 1000.0
depression_angle = 45.0
altitude_m = 4000.0
[simulator.members.C]
bandwidth = 80.0
[cost]
unit = "kEUR"
flight = 20.0
[stop]
half_width = 16.0
guard = "confirmation"
max_runs = 40
confirmation_runs = 3
"""
SCORES = (
    "run_id;frequency [MHz];looks;polarization;score;se;n;correct;application;block;source;date;note\r\n"
    '1;1500,5;4;HH;73,25;1,5;;;crops;A;flight;1979-05-12;"said ""x"""\r\n'
    ";3000;2;VV;;;400;300;crops;A;;;\r\n;9,6e3;1;HH+HV;-5;;;;ice;B;simulation;;=1+1\r\n"
)
PLAIN_SCORES = "# flown in May\nfrequency,looks,polarization,score\n1.5,4,HH,73.25\n9.6,2,VV,60\n"
RANKINGS = "run_id,interpreter,rank,session\n1,ann,1,\n2,ann,2,\n3,ann,2,\n1,bo,2,s\n3,bo,1,s\n"
LEGEND = "code,category,note\n1,Grass,green\n2,Water,\n255,,none\n"
SIGMA0 = (
    "quantity,category,frequency_ghz,polarization,season,theta_deg,value,sd,unit,status,source\n"
    "sigma0,Rice,5.3,HH,fall,20,-8.0,1.0,dB,public,me\nsigma0,Rice,5.3,HH,fall,40,-11.0,1.0,dB,public,me\n"
)
EXPRESSIONS = (
    "looks <= 4 * (frequency / 12.1) ** 2",
    "1 <= looks <= sqrt(frequency) + exp(1) - log10(looks)",
    'polarization in ("HH", "VV") and looks > 3',
    "max(frequency, looks) >= min(3, abs(-looks)) or polarization != 'HH'",
    "frequency ** -2 / (looks - looks) > 0 or looks >= 1",
)


def _words(text: str, *others: str) -> tuple[str, ...]:
    return (*text.split(), *others)


TOKENS: dict[str, tuple[str, ...]] = {
    "toml": _words(
        '[[ ]] " \' """ = nan inf -1 1e400 0 [] {} true 1979-05-27 .. [[factor]] [simulator]',
        *('engine = "psm"', 'scene = "/etc/passwd"', 'utility = "os:system"', "\x00", "\ufeff"),
    ),
    "csv": _words(
        ', ; " "" nan inf 1e999 -0 1.234,5 [GHz] ( ] \u2212 sep=; # run_id interpreter rank',
        *("\t", "\r", "\n", "=cmd|' /C calc'!A0", "\x00", "\ufeff", "9" * 400),
    ),
    "expression": _words(
        "** ( ) [ ] . __class__ lambda:0 exp( * /0 <= == 'HH' frequency looks polarization in not and or := f'{1}'",
        *(
            "1e308",
            "j",
            "{}",
            "@",
            "~",
            "%",
            "//",
            "**9**9**9",
            "<<9999999",
            "9" * 60,
            "import os",
            "\x00",
            "(" * 90,
            "-" * 90,
        ),
    ),
    "json": ("null", "{}", "[]", '"', "1e999", "-1", "../../x", "/etc/x", "true", "NaN", "\\u0000", "[" * 200),
}

ODD: tuple[Any, ...] = (
    *(None, True, 0, -1, 1, 2, 1979, 2**31, 2**63, 10**30, 0.5, -0.0, 1e-300, 1e12, 1e15, 1e308, float("inf")),
    *(float("nan"), "", " ", "x", "x" * 3000, "nan", "1", "\x00", "\u202e", ":x:", "[red]", "../../x", "/etc/passwd"),
    *("HH", "frequency", [], {}, [[]], [1, 2], ["HH"], {"x": 1}),
)
"""Values in the place of good ones."""


@dataclass(frozen=True, slots=True)
class Target:
    """A reader: good inputs to begin with, how to spoil one, and how to read it in a folder."""

    name: str
    seeds: tuple[bytes, ...]
    spoil: Callable[[bytes, random.Random], bytes]
    read: Callable[[bytes, Path], object]


@dataclass(slots=True)
class Tally:
    """What became of the inputs of a target."""

    inputs: int = 0
    accepted: int = 0
    refused: int = 0
    slowest_s: float = 0.0
    failures: list[tuple[int, str]] = field(default_factory=list)


# -- spoiling ---------------------------------------------------------------------------------------------------------


def spoil_bytes(data: bytes, rng: random.Random, tokens: tuple[str, ...] = ()) -> bytes:
    """One to six changes of bytes: flipped, cut out, doubled, moved, replaced by a token or an extreme number."""
    made = bytearray(data)
    for _ in range(rng.choice((1, 1, 1, 2, 3, 6))):
        kind = rng.randrange(8)
        at = rng.randrange(len(made) + 1)
        size = min(len(made) - at, rng.choice((1, 1, 2, 4, 16, 100)))
        if kind == 0 and at < len(made):
            made[at] ^= 1 << rng.randrange(8)
        elif kind == 1:
            del made[at : at + size]
        elif kind == 2:
            made[at:at] = made[at : at + size] * rng.choice((1, 2, 50))
        elif kind == 3:
            piece = made[at : at + size]
            del made[at : at + size]
            there = rng.randrange(len(made) + 1)
            made[there:there] = piece
        elif kind == 4:
            made[at : at + size] = rng.randbytes(size)
        elif kind == 5 and rng.random() < 0.3:
            del made[at:]
        elif kind == 6:
            made[at : at + size] = rng.choice((b"\x00", b"\xff")) * size
        elif tokens:
            token = rng.choice(tokens).encode("utf-8", "surrogatepass")
            made[at : at + rng.choice((0, size))] = token
    return bytes(made[:1_000_000])


def spoil_text(kind: str) -> Callable[[bytes, random.Random], bytes]:
    """Changes of bytes with the tokens of a format, and numbers replaced."""

    def spoil(data: bytes, rng: random.Random) -> bytes:
        if rng.random() < 0.3:
            words = data.decode("utf-8", "replace").split(" ")
            words[rng.randrange(len(words))] = rng.choice(TOKENS[kind])
            data = " ".join(words).encode("utf-8", "replace")
        return spoil_bytes(data, rng, TOKENS[kind])

    return spoil


def spoil_lines(data: bytes, rng: random.Random) -> bytes:
    """A TOML text with values replaced by others, lines lost, doubled or moved; or spoilt as any text."""
    if rng.random() < 0.3:
        return spoil_text("toml")(data, rng)
    lines = data.decode().splitlines()
    for _ in range(rng.choice((1, 1, 2, 3))):
        at, kind = rng.randrange(len(lines)), rng.randrange(6)
        name, equals, value = lines[at].partition(" = ")
        if kind == 0:
            del lines[at]
        elif kind == 1:
            lines.insert(rng.randrange(len(lines) + 1), lines[at])
        elif equals:
            odd = json.dumps(rng.choice(ODD)).replace("NaN", "nan").replace("Infinity", "inf")
            lines[at] = f"{name} = {rng.choice((odd, odd, '[' + value + ']', '-' + value))}"
    return "\n".join(lines).encode()


def spoil_tiff(data: bytes, rng: random.Random) -> bytes:
    """Tags with other codes, types, counts, places and values; or spoilt bytes."""
    if rng.random() < 0.3:
        return spoil_bytes(data, rng)
    made = bytearray(data)
    (first,) = struct.unpack_from("<I", made, 4)
    (count,) = struct.unpack_from("<H", made, first)
    for _ in range(rng.choice((1, 1, 2, 3))):
        entry = first + 2 + 12 * rng.randrange(count)
        (place,) = struct.unpack_from("<I", made, entry + 8)
        if rng.random() < 0.4 and place + 8 <= len(made):
            number = rng.choice((0.0, -1.0, 1e-300, 1e15, 1e308, float("inf"), float("nan"), rng.random() * 1e7))
            struct.pack_into("<d", made, place + 8 * rng.choice((0, 0, 1)) * (place + 16 <= len(made)), number)
            continue
        at, form = rng.choice(((0, "<H"), (2, "<H"), (4, "<I"), (8, "<I")))
        numbers = (*range(20), 255, 256, 258, 65535, 2**31 - 1, 2**31, 2**32 - 1, first, len(data), rng.getrandbits(32))
        struct.pack_into(form, made, entry + at, rng.choice(numbers) & (0xFFFF if form == "<H" else 0xFFFFFFFF))
    return bytes(made)


def spoil_archive(data: bytes, rng: random.Random) -> bytes:
    """A scene with spoilt, lost, renamed or wrongly shaped members, or a spoilt archive."""
    if rng.random() < 0.25:
        return spoil_bytes(data, rng)
    made = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED) as new:
        chosen = rng.choice(old.namelist())
        for name in old.namelist():
            content = old.read(name)
            if name == chosen:
                kind = rng.randrange(5)
                if kind == 0:
                    continue
                if kind == 1:
                    content = content[:128] + spoil_bytes(content[128:], rng)
                elif kind == 2:
                    content = spoil_bytes(content[:128], rng) + content[128:]
                elif kind == 3:
                    shape = rng.choice(((), (0,), (1,), (3, 3), (2, 2, 2), (10**10,), (10**6, 10**6)))
                    kinds = ("f8", "f4", "i8", "U5", "?", "c16", "O", "M8[s]", "V3", "u1", "S3")
                    content = _npy(shape, rng.choice(kinds), rng)
                else:
                    name = rng.choice(("../../evil.npy", "/tmp/evil.npy", name.upper(), "a" * 300 + ".npy", name[:-4]))
            new.writestr(name, content)
    return made.getvalue()


def _npy(shape: tuple[int, ...], kind: str, rng: random.Random) -> bytes:
    """A member of any shape and type; of a large one only the header."""
    header = f"{{'descr': '{'|O' if kind == 'O' else np.dtype(kind).str}', 'fortran_order': False, 'shape': {shape}, }}"
    padded = header.ljust(117) + "\n"
    size = int(np.prod(shape, dtype=float)) * np.dtype(kind).itemsize if np.prod(shape, dtype=float) < 1e3 else 64
    return b"\x93NUMPY\x01\x00" + len(padded).to_bytes(2, "little") + padded.encode() + rng.randbytes(size)


# -- readers ----------------------------------------------------------------------------------------------------------

FACTORS = (
    FactorColumn("frequency", "GHz"),
    FactorColumn("looks"),
    FactorColumn("polarization", levels=("HH", "VV", "HH+HV")),
)
MEASURES = (Measure("crops", is_percent=True), Measure("ice"))


def _file(data: bytes, folder: Path, name: str) -> Path:
    path = folder / name
    path.write_bytes(data)
    return path


def read_csv(data: bytes, folder: Path) -> object:
    """A file of scores or rankings, of a campaign with one or two applications."""
    path = _file(data, folder, "scores.csv")
    if is_rankings_file(path):
        return read_rankings(path, FACTORS, MEASURES[:1])
    return read_scores(path, FACTORS, MEASURES if b"application" in data else MEASURES[:1])


def read_expression(data: bytes, folder: Path) -> object:
    """A constraint, checked against the factors and evaluated at points."""
    del folder
    constraint = Constraint(data.decode("utf-8", "replace"))
    factors = (
        ContinuousFactor("frequency", low=1.0, high=10.0, scale="log"),
        ContinuousFactor("looks", low=1.0, high=16.0),
        CategoricalFactor("polarization", ("HH", "VV")),
    )
    region = Region(factors, (constraint,))
    return region.feasible(np.array([[0.0, 0.0, 0.0], [1.0, -1.0, 1.0], [-0.3, 0.9, 0.0]]))


def _scene_bytes() -> bytes:
    made = io.BytesIO()
    scene = synthetic_scene(8, 9, 10.0, categories=("Grass", "Trees"), field_m=40.0, relief_m=5.0, seed=3)
    folder = Path(os.environ.get("TMPDIR", "/tmp")) / f"seqrsm-fuzz-{os.getpid()}.npz"
    save_scene(scene, folder)
    made.write(folder.read_bytes())
    folder.unlink()
    return made.getvalue()


def _tiff_bytes(compression: str | None) -> bytes:
    made = io.BytesIO()
    tags = [
        (33550, "d", 3, (30.0, 30.0, 0.0), True),
        (33922, "d", 6, (0.0, 0.0, 0.0, 500000.0, 4000000.0, 0.0), True),
        (34735, "H", 16, (1, 1, 0, 3, 1024, 0, 1, 1, 1025, 0, 1, 1, 3072, 0, 1, 32633), True),
        (42113, "s", 0, "-9999", True),
    ]
    values = np.arange(56, dtype=np.float32).reshape(7, 8)
    tifffile.imwrite(made, values, extratags=tags, compression=compression, photometric="minisblack")
    return made.getvalue()


def targets(folder: Path) -> dict[str, Target]:
    """Every reader of files that users hand in; ``folder`` is for the making of seeds."""
    text = spoil_text
    _file(_scene_bytes(), folder, "scene.npz")
    made = (
        Target(
            "toml",
            (TOML.encode(), SIMULATED.encode()),
            spoil_lines,
            lambda data, at: load_spec(_file(data, at, "campaign.toml")),
        ),
        Target("csv", (SCORES.encode(), PLAIN_SCORES.encode(), RANKINGS.encode()), text("csv"), read_csv),
        Target("expression", tuple(e.encode() for e in EXPRESSIONS), text("expression"), read_expression),
        Target("npz", (_scene_bytes(),), spoil_archive, lambda data, at: load_scene(_file(data, at, "spoilt.npz"))),
        Target(
            "geotiff",
            (_tiff_bytes(None), _tiff_bytes("zlib")),
            spoil_tiff,
            lambda data, at: read_geotiff(_file(data, at, "raster.tif"), "elevation"),
        ),
        Target("legend", (LEGEND.encode(),), text("csv"), lambda data, at: read_legend(_file(data, at, "legend.csv"))),
        Target("sigma0", (SIGMA0.encode(),), text("csv"), lambda data, at: load_sigma0_table(_file(data, at, "s.csv"))),
    )
    return {target.name: target for target in made}


# -- the watch --------------------------------------------------------------------------------------------------------

_ALLOWED: list[str] = []
_STRAYS: list[str] = []
_CHANGES = ("os.remove", "os.rename", "os.mkdir", "os.rmdir", "os.symlink", "os.link", "os.chmod", "os.truncate")
_NEVER = (
    "subprocess.Popen",
    "os.system",
    "os.exec",
    "os.fork",
    "os.posix_spawn",
    "socket.connect",
    "pickle.find_class",
)


def _watch(event: str, arguments: tuple[Any, ...]) -> None:
    """Audit hook: notes what a reader may not do. It cannot be taken away, so it rests while nothing is watched."""
    if not _ALLOWED:
        return
    if event in _NEVER:
        _STRAYS.append(f"{event} {arguments!r:.200}")
    elif event == "open":
        path, _, flags = arguments
        writes = isinstance(flags, int) and flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC)
        if writes and isinstance(path, str | bytes) and not _inside(path):
            _STRAYS.append(f"open {path!r} for writing")
    elif event in _CHANGES and not _below_open_folder(arguments) and not _inside(arguments[0]):
        _STRAYS.append(f"{event} {arguments[0]!r}")


def _below_open_folder(arguments: tuple[Any, ...]) -> bool:
    """A bare name in a folder that is open already, as `shutil.rmtree` clears folders (whose own path is checked)."""
    opened = isinstance(arguments[-1], int) and arguments[-1] >= 0
    return opened and isinstance(arguments[0], str) and os.path.basename(arguments[0]) == arguments[0]


def _inside(path: object) -> bool:
    text = os.path.realpath(os.fsdecode(path)) if isinstance(path, str | bytes | os.PathLike) else ""
    return any(text.startswith(folder) for folder in _ALLOWED) or text == os.devnull or "__pycache__" in text


class HangError(BaseException):
    """The reader took longer than `LIMIT_S`; no reader may catch it."""


@contextmanager
def watched(folder: Path) -> Iterator[None]:
    """Within the block, writes outside ``folder`` are noted and a long time is an error."""

    def ring(_signal: int, _frame: FrameType | None) -> None:
        raise HangError

    before = signal.signal(signal.SIGALRM, ring), signal.signal(signal.SIGPROF, ring)
    _ALLOWED.append(os.path.realpath(folder))
    signal.setitimer(signal.ITIMER_REAL, 10.0 * LIMIT_S)
    signal.setitimer(signal.ITIMER_PROF, LIMIT_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        _ALLOWED.clear()
        signal.signal(signal.SIGALRM, before[0])
        signal.signal(signal.SIGPROF, before[1])


_hooked = False


def fuzz(target: Target, folder: Path, seeds: range) -> Tally:
    """Spoil and read, one input for each seed; every failure with its seed, by which `spoilt` gives the input again."""
    global _hooked
    if not _hooked:
        sys.addaudithook(_watch)
        _hooked = True
    import time

    tally = Tally()
    for seed in seeds:
        data = spoilt(target, seed)
        _STRAYS.clear()
        begin = time.process_time()
        try:
            with watched(folder):
                target.read(data, folder)
            tally.accepted += 1
        except SeqrsmError as error:
            tally.refused += 1
            if not str(error).strip():
                tally.failures.append((seed, "an error without a word"))
        except HangError:
            tally.failures.append((seed, f"took more than {LIMIT_S} s"))
        except Exception as error:  # whatever it is, no user should see it
            tally.failures.append((seed, f"{type(error).__name__}: {error!s:.200}"))
        tally.slowest_s = max(tally.slowest_s, time.process_time() - begin)
        tally.failures += [(seed, stray) for stray in _STRAYS]
        tally.inputs += 1
    return tally


def spoilt(target: Target, seed: int) -> bytes:
    """The input of a seed."""
    rng = random.Random(f"{target.name} {seed}")
    return target.spoil(rng.choice(target.seeds), rng)
