"""``seqrsm init --application``: a campaign whose start ranges and levels are those the literature asks for.

The numbers are printed in Tables A.1 to A.20 of RSL TR 380-1. They are cut to what the engine can form an image of and
the scattering table holds; every cut is written into the file as a comment beside the tables the number comes from.
"""

from __future__ import annotations

import math
import re
import shutil
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from seqrsm.catalog import StartLevels, StartRange, StartRanges, start_ranges
from seqrsm.catalog.search import words_of
from seqrsm.constants import SPEED_OF_LIGHT_M_S
from seqrsm.sensor.parameters import RADAR
from seqrsm.spec.read import SPEC_NAME
from seqrsm.spec.templates import new_folder, template_folder

SCENE_TEMPLATE = "langegracht-radar"
"""Template whose data base the new campaign takes."""

MAX_LEVELS = 5
FREQUENCY_GHZ = (1.25, 10.8)
RESOLUTION_M = (5.0, 100.0)
DEPRESSION_DEG = (10.0, 85.0)

_ALTITUDES_M = (6000.0, 12000.0, 24000.0)
_LEAST_RATIO = 1.5


@dataclass(frozen=True, slots=True)
class _Default:
    """Range taken where nothing is printed, limits, and what sets them."""

    low: float
    high: float
    limits: tuple[float, float]
    why: str


_DEFAULTS = {
    "frequency": _Default(1.25, 10.8, FREQUENCY_GHZ, "the scattering table knows 1.25 to 10.8 GHz"),
    "resolution": _Default(6.0, 60.0, RESOLUTION_M, "the scene has cells of 5 m and fields of some 150 m"),
    "depression_angle": _Default(
        30.0, 60.0, DEPRESSION_DEG, "nearer to nadir than 85 deg no aircraft's swath covers the scene"
    ),
}


def init_from_catalog(words: str, folder: Path) -> StartRanges:
    """Make a campaign folder for an application of the catalogue.

    Parameters
    ----------
    words : str
        Words of the application, as `seqrsm.catalog.search` takes them.
    folder : Path
        New, or empty.

    Returns
    -------
    StartRanges
        What the catalogue says.

    Raises
    ------
    UserError
        No radar entry holds all the words, or the folder cannot be made.
    """
    start = start_ranges(words, system="active")
    text = campaign_text(start)
    source = template_folder() / SCENE_TEMPLATE
    with new_folder(folder) as part:
        for file in ("scene.npz", "SCENE.md"):
            shutil.copyfile(source / file, part / file)
        (part / SPEC_NAME).write_text(text, encoding="utf-8")
    return start


@dataclass(frozen=True, slots=True)
class _Chosen:
    """Range of a parameter as it goes into the file, and the comments over it."""

    name: str
    unit: str
    scale: str
    low: float
    high: float
    comments: tuple[str, ...]


def campaign_text(start: StartRanges) -> str:
    """Text of campaign.toml for what the catalogue says."""
    words = " ".join(words_of(start.words))  # no sign that would end a string or a comment
    name = words.replace(" ", "-")[:60].strip("-")
    chosen = [_choose(item) for item in start.ranges]
    by_name = {item.name: item for item in chosen}
    altitude, bandwidth = _platform(by_name["resolution"], by_name["depression_angle"])
    levels, level_comments = _levels(start.polarization)
    terms = 10 + 4 * (len(levels) - 1)
    count = len(start.entries)
    parts = [
        f"# Which airborne radar is best for {words}? Start ranges and levels from RSL TR 380-1, Appendix A:\n"
        f"# {count} {'entry' if count == 1 else 'entries'} in {tables_text(entry.table for entry in start.entries)}, "
        f"shown by `seqrsm catalog {words}`.\n# Widen or narrow them as you know better.",
        f'[campaign]\nname = "{name}"\n'
        f'description = "Radar for {words}, ranges from the catalogue, simulated over the Langegracht scene"\n'
        "seed = 1979\nbatch = 4",
        *(_factor_text(item) for item in chosen if item.low < item.high),
        _polarization_text(levels, level_comments),
        "# The engine scores how well the covers of the scene are told apart. For another utility name your own\n"
        '# function, "package.module:function", or fly and take measured scores in ("measured").\n'
        f'[[application]]\nname = "{name}"\nutility = "percent_correct"\ngoal = "maximize"\n'
        f'catalog = "{words}"{_knowledge_text(start.ranges, by_name)}',
        '# Langegracht, Flanders (see SCENE.md): put your own site here.\n[simulator]\nengine = "psm"\n'
        'scene = "scene.npz"',
        "# The bandwidth resolves the finest ground resolution at the steepest angle.\n[simulator.fixed]\n"
        f"bandwidth = {bandwidth:.1f}            # MHz\npeak_power = 300.0           # W\naltitude_m = {altitude:.1f}",
        *_fixed_text(chosen, levels),
        "[stop]\n"
        'interval = "prediction_mean"  # of the mean of 5 future flights\nreplicates = 5\n'
        f"half_width = 14.0             # percent, mostly what is not known of the ground: `seqrsm check` says\n"
        "level = 0.95\n"
        f"max_runs = {max(120, 5 * terms)}",
    ]
    return re.sub(r"\n\n(?=# .* held fixed:|\w+ = )", "\n", "\n\n".join(part for part in parts if part)) + "\n"


def _choose(item: StartRange) -> _Chosen:
    """Cut a printed range to the limits; take the default where nothing usable is printed."""
    default = _DEFAULTS[item.name]
    tables = tables_text(item.tables)
    low, high = default.limits
    comments = []
    if item.low is None or item.high is None:
        comments.append(f"{tables}: no number is printed; a usual range")
        return _Chosen(item.name, item.unit, item.scale, default.low, default.high, tuple(comments))
    comments.append(f"{tables}: {_ends(item.low, item.high)} {item.unit}{_prior(item)}")
    comments += item.notes
    first, last = max(item.low, low), min(item.high, high)
    if first > last:
        comments.append(f"out of reach here, {default.why}: the whole of it instead")
        return _Chosen(item.name, item.unit, item.scale, low, high, tuple(comments))
    if (first, last) != (item.low, item.high):
        comments.append(f"cut: {default.why}")
    if last < first * _LEAST_RATIO and item.scale == "log" and first != last:
        middle = math.sqrt(first * last)
        first, last = max(low, middle / _LEAST_RATIO), min(high, middle * _LEAST_RATIO)
        comments.append("widened a little, so that the factor has something to vary")
    first, last = (float(f"{end:.4g}") for end in (first, last))
    return _Chosen(item.name, item.unit, item.scale, max(first, low), min(last, high), tuple(comments))


def _prior(item: StartRange) -> str:
    """Where most sources see the optimum."""
    parts = []
    if item.agreed_low is not None and item.agreed_high is not None and item.n_agreeing > 1:
        parts.append(f"most agree on {_ends(item.agreed_low, item.agreed_high)}")
    if item.best is not None:
        parts.append(f"best {item.best:.4g}")
    return f" ({'; '.join(parts)})" if parts else ""


def _knowledge_text(ranges: Iterable[StartRange], chosen: Mapping[str, _Chosen]) -> str:
    """The catalogue as a prior, in comments: whoever trusts it takes the signs away."""
    expected = []
    for item in ranges:
        factor = chosen[item.name]
        value = item.best
        if value is None and item.agreed_low is not None and item.agreed_high is not None and item.n_agreeing > 1:
            middle = 0.5 * (item.agreed_low + item.agreed_high)
            value = math.sqrt(item.agreed_low * item.agreed_high) if item.scale == "log" else middle
        if value is not None and factor.low < factor.high and factor.low <= value <= factor.high:
            expected.append(f"{item.name} = {float(f'{value:.3g}')!r}")
    if not expected:
        return ""
    return (
        "\n# Where most sources see the optimum, as prior knowledge; take the signs # away to use it.\n"
        "# [application.prior]\n# utility = [40.0, 90.0]        # percent correct at a setting taken at random, 95 %\n"
        f"# optimum = {{ {', '.join(expected)} }}"
    )


def _ends(low: float, high: float) -> str:
    return f"{low:.3g}" if low == high else f"{low:.3g} to {high:.3g}"


def _factor_text(item: _Chosen) -> str:
    scale = '\nscale = "log"' if item.scale == "log" else ""
    return (
        f'{_comment(item.comments)}[[factor]]\nname = "{item.name}"\nunit = "{item.unit}"\n'
        f"low = {item.low!r}\nhigh = {item.high!r}{scale}"
    )


def tables_text(numbers: Iterable[str]) -> str:
    """Tables in order, each once: "Table A.16", "Tables A.3, A.16"."""
    ordered = sorted(set(numbers), key=lambda number: int(number.removeprefix("A.")))
    if not ordered:
        return "Tables A.1 to A.20"
    return f"{'Table' if len(ordered) == 1 else 'Tables'} {', '.join(ordered)}"


def _comment(lines: tuple[str, ...]) -> str:
    return "".join(f"# {line}\n" for line in lines)


def _levels(item: StartLevels) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Levels of polarization that the engine has, and comments."""
    known = tuple(level for level in item.levels if set(level.split("+")) <= set(RADAR["polarization"].levels))
    tables = tables_text(item.tables)
    if not known:
        return ("HH", "VV", "HH+HV"), (f"{tables}: no channel is named; usual ones",)
    comments = [f"{tables}: {', '.join(item.levels)}", *item.notes]
    if len(known) > MAX_LEVELS:
        # Sets hold what their channels hold: the last single channels are the least loss.
        kept = [level for level in known if "+" in level] + [level for level in known if "+" not in level]
        known = tuple(level for level in known if level in kept[:MAX_LEVELS])
        comments.append(f"cut to {MAX_LEVELS} levels: each costs 4 more terms")
    return known, tuple(comments)


def _polarization_text(levels: tuple[str, ...], comments: tuple[str, ...]) -> str:
    if len(levels) < 2:
        return ""
    listed = ", ".join(f'"{level}"' for level in levels)
    return f'{_comment(comments)}[[factor]]\nname = "polarization"\nlevels = [{listed}]'


def _fixed_text(chosen: list[_Chosen], levels: tuple[str, ...]) -> list[str]:
    """Parameters for which one value only is printed."""
    fixed = [
        f"{_comment((*item.comments, f'{item.name} [{item.unit}] held fixed:'))}{item.name} = {item.low!r}"
        for item in chosen
        if item.low >= item.high
    ]
    if len(levels) == 1:
        fixed.append(f'# one channel only is printed, held fixed:\npolarization = "{levels[0]}"')
    return fixed


def _platform(resolution: _Chosen, depression: _Chosen) -> tuple[float, float]:
    """Altitude [m] from which the steepest swath stays beside nadir, and bandwidth [MHz] for the finest resolution."""
    half_scene_m = 1950.0
    steepest = math.radians(depression.high)
    altitude = next((h for h in _ALTITUDES_M if h / math.tan(steepest) > half_scene_m), _ALTITUDES_M[-1])
    needed_hz = SPEED_OF_LIGHT_M_S / (2.0 * resolution.low * math.cos(steepest))
    return altitude, max(50.0, 10.0 * math.ceil(1.1 * needed_hz / 1e7))
