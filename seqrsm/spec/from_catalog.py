"""``seqrsm init --application``: a campaign whose start ranges and levels are those the literature asks for.

The numbers are printed in Tables A.1 to A.20 of RSL TR 380-1. They are cut to what the engine can form an image of and
the scattering table holds; every cut is written into the file as a comment beside the tables the number comes from. An
application that no utility measures (`seqrsm.catalog.start`) becomes a campaign of measured scores.
"""

from __future__ import annotations

import math
import re
import shutil
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from seqrsm.catalog.search import words_of
from seqrsm.catalog.start import Measure, StartLevels, StartRange, StartRanges, measure_of, start_ranges
from seqrsm.constants import SPEED_OF_LIGHT_M_S
from seqrsm.errors import UserError
from seqrsm.plain import counted
from seqrsm.scene.file import load_scene
from seqrsm.scene.layers import known_heights
from seqrsm.score.utilities import asked_for
from seqrsm.sensor.parameters import RADAR
from seqrsm.spec.read import SPEC_NAME
from seqrsm.spec.templates import new_folder, packaged

SCENE_TEMPLATES = {"psm": "langegracht-radar", "prm": "crops-and-moisture"}
"""Templates whose data base a new campaign takes, by engine."""

MAX_LEVELS = 5
FREQUENCY_GHZ = (1.25, 10.8)
RESOLUTION_M = (5.0, 100.0)
DEPRESSION_DEG = (10.0, 85.0)

_NAMED = "percent_correct by field"
_ALTITUDES_M = (6000.0, 12000.0, 24000.0)
_LEAST_RATIO = 1.5
_HALF = 0.53  # of a scene's extent in range: from its middle to beyond its far end


@dataclass(frozen=True, slots=True)
class _Default:
    """Range taken where nothing is printed, limits, and what sets them."""

    low: float
    high: float
    limits: tuple[float, float]
    why: str


_DEFAULTS = {
    "psm": {
        "frequency": _Default(1.25, 10.8, FREQUENCY_GHZ, "the scattering table covers 1.25 to 10.8 GHz"),
        "resolution": _Default(6.0, 60.0, RESOLUTION_M, "the scene has cells of 5 m and fields of some 150 m"),
        "depression_angle": _Default(30.0, 60.0, DEPRESSION_DEG, ""),
    },
    "prm": {
        "frequency": _Default(1.4, 18.7, (1.0, 36.0), "the tables are reliable from 1 to 36 GHz"),
        "resolution": _Default(50.0, 250.0, (30.0, 500.0), "the scene is four kilometres wide, with cells of 10 m"),
    },
}
_MEASURED = {
    "frequency": _Default(1.25, 10.8, (0.1, 100.0), ""),
    "resolution": _Default(6.0, 60.0, (0.1, 1e5), ""),
    "depression_angle": _Default(30.0, 60.0, (0.0, 90.0), ""),
}


@dataclass(frozen=True, slots=True)
class Wanted:
    """One application of the catalogue."""

    words: str
    """As they were given, without signs."""
    start: StartRanges
    """What the catalogue says."""
    measure: Measure
    """By which utility it is scored."""


def init_from_catalog(applications: Sequence[str], folder: Path, scene: Path | None = None) -> list[Wanted]:
    """Make a campaign folder, new or empty, for applications of the catalogue, one at least.

    Their words are as `seqrsm.catalog.search` takes them; ``scene`` is the data base, by default that of a template.
    UserError where no entry holds all the words of an application, only some can be simulated, the scene lacks a cover
    that is asked for, or the folder cannot be made.
    """
    wanted = applications_of(applications)
    engine = engine_for(wanted)
    text = campaign_text(wanted, None if scene is None else _site(scene, wanted))
    with new_folder(folder) as part:
        if scene is not None:
            shutil.copyfile(scene, part / "scene.npz")
        elif engine:
            for file in ("scene.npz", "SCENE.md"):
                shutil.copyfile(packaged("campaigns") / SCENE_TEMPLATES[engine] / file, part / file)
        (part / SPEC_NAME).write_text(text, encoding="utf-8")
    return wanted


def applications_of(applications: Sequence[str]) -> list[Wanted]:
    """What the catalogue says of each application, and how it is measured; errors as of `init_from_catalog`."""
    measures = [measure_of(words) for words in applications]
    system = "passive" if any(one.engine == "prm" for one in measures) else "active"
    found = []
    for words, measure in zip(applications, measures, strict=True):
        try:
            start = start_ranges(words, system=system)
        except UserError:
            start = start_ranges(words, system="active" if system == "passive" else "passive")
        if system == "passive" and measure.utility == _NAMED:  # the target is in the unit of all
            measure = replace(measure, utility="kappa by field")
        found.append(Wanted(" ".join(words_of(words)), start, measure))
    if any(one.measure.utility for one in found) and not all(one.measure.utility for one in found):
        without = next(one for one in found if not one.measure.utility)
        remedy = "Make a separate campaign for it."
        message = f"no utility measures it: {without.measure.says}; the other applications are simulated"
        raise UserError(message, remedy, field="--application", value=without.words)
    return found


def engine_for(wanted: Sequence[Wanted]) -> str:
    """The engine of all: "prm" where one needs it, "" where scores are measured."""
    engines = {one.measure.engine for one in wanted}
    return "prm" if "prm" in engines else "".join(engines)


@dataclass(frozen=True, slots=True)
class Site:
    """A scene of the user's own: cells a side [m], its extent in range [m], and its mean and highest elevation [m]."""

    cell_m: float
    range_m: float
    ground_m: float = 0.0
    highest_m: float = 0.0

    @property
    def altitude_m(self) -> float:
        """From where a radiometer sees the edges at the angle of the template's [m], within what aircraft fly."""
        return self.above(min(max(1500.0 * self.range_m / _TEMPLATE.range_m, 1500.0), _ALTITUDES_M[-1]))

    def above(self, height_m: float) -> float:
        """Altitude of a flight line so high above the mean ground, and above all of it [m]."""
        lowest = max(height_m + self.ground_m, self.highest_m + 300.0)
        return 100.0 * math.ceil(lowest / 100.0 - 1e-9)

    def resolution(self, usual: _Default, engine: str) -> _Default:
        """Range and limits of the resolution over it: three cells or more of a radiometer's footprint."""
        if engine == "psm":
            low = max(usual.limits[0], self.cell_m)
            high, why = max(usual.limits[1], 10.0 * low), f"the scene has cells of {self.cell_m:g} m"
        else:
            low = max(usual.limits[0], 3.0 * self.cell_m)
            high = max(self.range_m / 8.0, 2.0 * low)
            why = f"the scene is {self.range_m / 1000.0:.2g} km wide, with cells of {self.cell_m:g} m"
        low, high = (float(f"{end:.3g}") for end in (low, high))
        first = max(usual.low, low) if max(usual.low, low) < high else low
        return _Default(first, min(max(usual.high, 2.0 * first), high), (low, high), why)


_TEMPLATE = Site(5.0, 3680.0)
_TEMPLATE_SITE = "# Langegracht, Flanders (see SCENE.md): put your own site here.\n"


def _site(path: Path, wanted: Sequence[Wanted]) -> Site:
    """A scene, which must have the covers that are asked for."""
    scene = load_scene(path)
    known = scene.categories
    for one in wanted:
        lacking = [name for name in (asked_for(one.measure.utility).covers if one.measure.utility else ())
                   if name not in known]  # fmt: skip
        if lacking:
            remedy = f"The scene has {', '.join(known)}."
            message = f"{one.words} is measured on {', '.join(lacking)}, which the scene lacks"
            raise UserError(message, remedy, file=str(path))
    _, mean_m, highest_m = known_heights(scene)
    return Site(scene.cell_m, scene.cover.shape[0] * scene.cell_m, mean_m, highest_m)


@dataclass(frozen=True, slots=True)
class _Chosen:
    """Range of a parameter as it goes into the file, and the comments over it."""

    name: str
    unit: str
    scale: str
    low: float
    high: float
    comments: tuple[str, ...]


def campaign_text(wanted: Sequence[Wanted], site: Site | None = None) -> str:
    """Text of campaign.toml for what the catalogue says of some applications, over the template's site or another."""
    engine = engine_for(wanted)
    both = " and ".join(one.words for one in wanted)
    chosen: dict[str, _Chosen] = {}
    for name, default in _limits(engine, site).items():
        found = [
            _choose(item, default, one.words if len(wanted) > 1 else "")
            for one in wanted for item in one.start.ranges if item.name == name
        ]  # fmt: skip
        if found:  # one range that holds those of several applications
            low, high = min(one.low for one in found), max(one.high for one in found)
            comments = tuple(comment for one in found for comment in one.comments)
            chosen[name] = replace(found[0], low=low, high=high, comments=comments)
    levels, level_comments = _levels([one.start.polarization for one in wanted]) if engine != "prm" else ((), ())
    terms = 10 + 4 * max(len(levels) - 1, 0)
    entries = {entry for one in wanted for entry in one.start.entries}
    sensor = {"psm": "airborne radar", "prm": "airborne radiometer"}.get(engine, "sensor")
    shown = " and ".join(f"`seqrsm catalog {one.words}`" for one in wanted)
    parts = [
        f"# Which {sensor} is best for {both}? Initial ranges and levels from RSL TR 380-1, Appendix A:\n"
        f"# {counted(len(entries), 'entry', 'entries')} in "
        f"{tables_text(entry.table for entry in entries)}, shown by {shown}.\n"
        "# Adjust them to your knowledge.",
        f'[campaign]\nname = "{_name(both)}"\n'
        f'description = "One {sensor} for {both}, ranges from the catalogue"\nseed = 1979\nbatch = 4',
        *(_factor_text(item) for item in chosen.values() if item.low < item.high),
        _polarization_text(levels, level_comments),
        *(_application_text(one, engine, chosen) for one in wanted),
        *_simulator_text(engine, chosen, levels, site or _TEMPLATE),
        "[stop]\n"
        'interval = "prediction_mean"  # of the mean of 5 future flights\nreplicates = 5\n'
        f"{_target_text(wanted, engine)}\nlevel = 0.95\nmax_runs = {max(120, 5 * terms)}",
    ]
    return re.sub(r"\n\n(?=# .* held fixed:|\w+ = )", "\n", "\n\n".join(part for part in parts if part)) + "\n"


def _limits(engine: str, site: Site | None) -> Mapping[str, _Default]:
    """Usual ranges and limits by parameter, of an engine over the template's site or another; of measured scores."""
    if not engine:
        return _MEASURED
    limits = dict(_DEFAULTS[engine])
    if site is not None:
        limits["resolution"] = site.resolution(limits["resolution"], engine)
    if engine == "psm":
        usual = limits["depression_angle"]
        steepest = math.degrees(math.atan(_ALTITUDES_M[-1] / (_HALF * (site or _TEMPLATE).range_m)))
        low, nadir = usual.limits[0], min(usual.limits[1], float(math.floor(steepest)))
        why = f"an aircraft sees the scene at {low:.0f} to {nadir:.0f} deg"
        limits["depression_angle"] = _Default(usual.low, min(usual.high, nadir), (low, nadir), why)
    return limits


def _name(words: str) -> str:
    return words.replace(" ", "-")[:60].strip("-")


def _application_text(one: Wanted, engine: str, chosen: Mapping[str, _Chosen]) -> str:
    told = (
        asked_for(one.measure.utility).row.words
        if one.measure.utility
        else f"No built-in utility measures it: {one.measure.says}. Ingest measured scores, or name your own function "
        'of the simulated image, "package.module:function", and add a [simulator].'
    )
    told = textwrap.fill(told, 116, initial_indent="# ", subsequent_indent="# ", break_on_hyphens=False)
    # A prior is stated in percent, as radars' utilities are.
    printed = all(item.name in chosen for item in one.start.ranges)
    prior = _knowledge_text(one.start.ranges, chosen) if one.measure.engine == "psm" and printed else ""
    # The report compares with what is printed for sensors of the campaign's kind.
    of_kind = (one.start.system == "passive") == (engine == "prm")
    literature = f'catalog = "{one.words}"' if of_kind else ""
    return (
        f'{told}\n[[application]]\nname = "{_name(one.words)}"\nutility = "{one.measure.utility or "measured"}"\n'
        f"{literature}{prior}"
    )


def _simulator_text(engine: str, chosen: Mapping[str, _Chosen], levels: tuple[str, ...], site: Site) -> list[str]:
    """The tables of the simulator; none for measured scores."""
    if not engine:
        return []
    shown = _TEMPLATE_SITE if site is _TEMPLATE else ""
    parts = [f'{shown}[simulator]\nengine = "{engine}"\nscene = "scene.npz"']
    if engine == "prm":
        parts.append(
            "# An aircraft's scanner, both polarizations.\n[simulator.fixed]\n"
            'polarization = "H+V"\nbandwidth = 25.0              # MHz\nnoise_temperature = 500.0     # K\n'
            "integration_time = 5.0        # ms\nscan_period = 1.0             # s, there and back\n"
            f"altitude_m = {site.altitude_m}\nspeed_m_s = 60.0"
        )
        return [*parts, *_fixed_text(chosen, ("H+V", ""))]
    altitude, bandwidth = _platform(chosen["resolution"], chosen["depression_angle"], _HALF * site.range_m)
    parts.append(
        "# The bandwidth resolves the finest ground resolution at the steepest angle.\n[simulator.fixed]\n"
        + f"bandwidth = {bandwidth:.1f}".ljust(29)
        + "# MHz\npeak_power = 300.0           # W\n"
        f"altitude_m = {site.above(altitude)}"
    )
    return [*parts, *_fixed_text(chosen, levels)]


def _target_text(wanted: Sequence[Wanted], engine: str) -> str:
    """The half-width: `seqrsm check` shows what can be reached, mostly what is not known of the ground; and the loss.

    Simulations are cheap enough to ask for both.
    """
    rows = [asked_for(one.measure.utility or "measured").row for one in wanted]
    percent = any(row.unit == "percent" for row in rows)
    value, unit = (14.0, "percent") if percent else (0.2, "1 is perfect") if rows[0].function else (5.0, "score units")
    text = f"half_width = {value}".ljust(30) + f"# {unit}: `seqrsm check` shows what can be reached"
    loss = f"\nloss = {1.0 if percent else 0.02}".ljust(31) + "# expected, against the best settings"
    return text + loss if engine else text


def _choose(item: StartRange, default: _Default, words: str) -> _Chosen:
    """Cut a printed range to the limits; take the default where nothing usable is printed; ``words``: for what."""
    tables = f"{words}, {tables_text(item.tables)}" if words else tables_text(item.tables)
    low, high = default.limits
    if item.ends is None:
        usual = f"{tables}: no number is printed; a usual range"
        return _Chosen(item.name, item.unit, item.scale, default.low, default.high, (usual,))
    comments = [f"{tables}: {_ends(*item.ends)} {item.unit}{_prior(item)}", *item.notes]
    first, last = max(item.ends[0], low), min(item.ends[1], high)
    if first > last:
        comments.append(f"not attainable here, {default.why}: the full range instead")
        return _Chosen(item.name, item.unit, item.scale, low, high, tuple(comments))
    if (first, last) != item.ends:
        comments.append(f"cut: {default.why}")
    if last < first * _LEAST_RATIO and item.scale == "log" and first != last:
        middle = math.sqrt(first * last)
        first, last = max(low, middle / _LEAST_RATIO), min(high, middle * _LEAST_RATIO)
        comments.append("widened slightly so that the factor can vary")
    first, last = (float(f"{end:.4g}") for end in (first, last))
    return _Chosen(item.name, item.unit, item.scale, max(first, low), min(last, high), tuple(comments))


def _prior(item: StartRange) -> str:
    """Where most sources see the optimum."""
    parts = []
    if item.agreed is not None and item.n_agreeing > 1:
        parts.append(f"most agree on {_ends(*item.agreed)}")
    if item.best is not None:
        parts.append(f"best {item.best:.4g}")
    return f" ({'; '.join(parts)})" if parts else ""


def _knowledge_text(ranges: Iterable[StartRange], chosen: Mapping[str, _Chosen]) -> str:
    """The catalogue as a prior, in comments: whoever trusts it takes the signs away."""
    expected = []
    for item in ranges:
        factor = chosen[item.name]
        value = item.best
        if value is None and item.agreed is not None and item.n_agreeing > 1:
            value = math.sqrt(math.prod(item.agreed)) if item.scale == "log" else 0.5 * sum(item.agreed)
        if value is not None and factor.low < factor.high and factor.low <= value <= factor.high:
            expected.append(f"{item.name} = {float(f'{value:.3g}')!r}")
    if not expected:
        return ""
    return (
        "\n# Where most sources place the optimum, as prior knowledge; uncomment to use it.\n"
        "# [application.prior]\n# utility = [40.0, 90.0]        # percent, mean at a random setting, 95 % interval\n"
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


def _levels(items: Sequence[StartLevels]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Levels of polarization that the engine has, and comments."""
    printed = tuple(dict.fromkeys(level for item in items for level in item.levels))
    known = tuple(level for level in printed if set(level.split("+")) <= set(RADAR["polarization"].levels))
    tables = tables_text(table for item in items for table in item.tables)
    if not known:
        return ("HH", "VV", "HH+HV"), (f"{tables}: no channel is named; usual ones",)
    comments = [f"{tables}: {', '.join(printed)}", *dict.fromkeys(note for item in items for note in item.notes)]
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


def _fixed_text(chosen: Mapping[str, _Chosen], levels: tuple[str, ...]) -> list[str]:
    """Parameters for which one value only is printed."""
    fixed = [
        f"{_comment((*item.comments, f'{item.name} [{item.unit}] held fixed:'))}{item.name} = {item.low!r}"
        for item in chosen.values()
        if item.low >= item.high
    ]
    if len(levels) == 1:
        fixed.append(f'# one channel only is printed, held fixed:\npolarization = "{levels[0]}"')
    return fixed


def _platform(resolution: _Chosen, depression: _Chosen, half_scene_m: float) -> tuple[float, float]:
    """Altitude [m] from which the steepest swath stays beside nadir, and bandwidth [MHz] for the finest resolution."""
    steepest = math.radians(depression.high)
    altitude = next((h for h in _ALTITUDES_M if h / math.tan(steepest) > half_scene_m), _ALTITUDES_M[-1])
    needed_hz = SPEED_OF_LIGHT_M_S / (2.0 * resolution.low * math.cos(steepest))
    return altitude, max(50.0, 10.0 * math.ceil(1.1 * needed_hz / 1e7))
