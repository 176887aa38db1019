"""Check against the literature: the optimum beside the rows of Tables A.1 to A.20 on the application.

Which words to look up, what is printed, and what agrees.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from seqrsm.analysis.results import Analysis
from seqrsm.campaign.dossier import Dossier
from seqrsm.catalog.rendering import summary
from seqrsm.catalog.search import search, words_of
from seqrsm.catalog.start import StartLevels, StartRange, StartRanges, start_ranges
from seqrsm.design.factors import CategoricalFactor, span
from seqrsm.plain import counted
from seqrsm.report.blocks import Block, Paragraph, Section, table
from seqrsm.report.rounding import NOTHING, format_plain
from seqrsm.report.wording import (
    describe_factor,
    listing,
    optimum_setting_text,
    readable,
    setting_posterior,
    setting_range_text,
    with_unit,
)
from seqrsm.sensor.parameters import RADAR, RADIOMETER
from seqrsm.sensor.radar import PHASE
from seqrsm.sensor.sets import frequency_of
from seqrsm.spec.read import CampaignSpec
from seqrsm.units import unit_factor

MAX_NAMED = 2

_LATER = (
    "The tables list what was required, and believed possible, up to 1979: a difference calls for an explanation and "
    "need not be an error."
)


#: What campaigns and the tables of 1979 call differently.
SAME_IN_THE_TABLES = {"ground cover": "land use", "land cover": "land use"}

#: Words that tell nothing of an application when they stand alone.
_GENERIC = frozenset(
    (
        "a", "an", "airborne", "and", "any", "application", "applications", "area", "best", "better", "but", "by",
        "cover", "data", "for", "frequency", "from", "good", "great", "greater", "ground", "image", "imaging", "in",
        "is", "it", "map", "mapping", "measured", "more", "of", "on", "one", "over", "percent", "radar", "radiometer",
        "real", "remote", "scene", "score", "sensing", "sensor", "simulated", "site", "surface", "system", "test",
        "than", "that", "the", "this", "to", "use", "uses", "which", "with",
    )
)  # fmt: skip

_CHANNELS = frozenset({"HH", "HV", "VH", "VV", "H", "V"})
#: Names that tell a radiometer where no simulator does.
_PASSIVE = {row.name for row in RADIOMETER.values() if row.name != row.field} - RADAR.keys()


@dataclass(frozen=True, slots=True)
class Comparison:
    """One sensor parameter: what is printed, what this campaign found, and whether the two agree."""

    parameter: str
    printed: str
    tables: str
    agreed: str
    found: str
    """Texts for a table."""
    verdict: str
    """One of "agrees", "not excluded", "differs", "not comparable" or "nothing printed"."""
    why: str
    """The verdict in a few words more."""


def looked_up(spec: CampaignSpec, application: str) -> tuple[str, str, StartRanges] | None:
    """Words that an application was looked up by, where they come from, and what is printed; None for nothing."""
    system = system_of(spec)
    # The description of a campaign of several applications may be about another of them.
    description = spec.description if len(spec.applications) == 1 else ""
    found = catalogue_words(application, description, system, spec.application(application).catalog)
    return None if found is None else (*found, start_ranges(found[0], system=system))


def comparisons(spec: CampaignSpec, analysis: Analysis, start: StartRanges) -> list[Comparison]:
    """What is printed beside what this campaign found, for each parameter of both."""
    rows = [*(_compare_range(spec, analysis, item) for item in start.ranges)]
    rows.append(_compare_levels(spec, analysis, start.polarization))
    return [row for row in rows if row is not None]


def system_of(spec: CampaignSpec) -> str:
    """Kind of sensor, "active" or "passive"."""
    passive = spec.simulator is not None and spec.simulator.engine == "prm"
    return "passive" if passive or _PASSIVE & set(spec.region.names) else "active"


def catalogue_words(name: str, description: str, system: str, wanted: str = "") -> tuple[str, str] | None:
    """Words of an application that the catalogue knows, and where they come from.

    The longest run of words of the application's name, then of the campaign's description, that some entry holds; a
    single word only if it says something alone.
    """
    if wanted and search(wanted, system=system):
        return wanted, "named in campaign.toml"
    for text, reason in ((name, "the application's name"), (description, "the campaign's description")):
        for words in _phrases(words_of(text.replace("_", " "))):
            asked = SAME_IN_THE_TABLES.get(words, words)
            if search(asked, system=system):
                same = "" if asked == words else f", which says \u201c{words}\u201d"
                return asked, reason + same
    return None


def _phrases(words: tuple[str, ...]) -> Iterator[str]:
    for length in range(min(4, len(words)), 0, -1):
        for first in range(len(words) - length + 1):
            phrase = words[first : first + length]
            says = {word for word in phrase if len(word) > 2} - _GENERIC  # "e" is in every "e.g."
            if says or " ".join(phrase) in SAME_IN_THE_TABLES:
                yield " ".join(phrase)


def _compare_range(spec: CampaignSpec, analysis: Analysis, item: StartRange) -> Comparison | None:
    factor = next((f for f in analysis.region.factors if f.name == item.name), None)
    if isinstance(factor, CategoricalFactor):
        level = str(analysis.optimum.settings[factor.name])
        found = f"{level} (of {describe_factor(factor)[1]})"
        verdict, why = _of_levels(spec, item, level, factor.levels)
    elif factor is None:
        fixed = _fixed(spec, item.name)
        if fixed is None or isinstance(fixed, str):
            return None
        found = f"{with_unit(format_plain(fixed), item.unit)}, held fixed"
        verdict, why = _verdict(item, fixed, (fixed, fixed))
    else:
        found = f"{optimum_setting_text(analysis, factor)} ({setting_range_text(analysis, factor)})"
        scale = unit_factor(factor.unit or item.unit, item.unit) or math.nan
        posterior, (low, high) = setting_posterior(analysis, factor), span(factor)
        credible = (scale * posterior.low, scale * posterior.high)
        best = scale * float(analysis.optimum.settings[factor.name])
        verdict, why = _verdict(item, best, credible, (scale * low, scale * high))
    printed, agreed = (NOTHING if ends is None else _ends(*ends, item.unit) for ends in (item.ends, item.agreed))
    return Comparison(item.name, printed, ", ".join(item.tables), agreed, found, verdict, why)


def _verdict(
    item: StartRange, value: float, credible: tuple[float, float], region: tuple[float, float] | None = None
) -> tuple[str, str]:
    """Verdict and reason on a setting, all in the table's unit; without a region it is held fixed."""
    if item.ends is None:
        return "nothing printed", "the tables print no number"
    if math.isnan(value):
        return "not comparable", "in another unit"
    if _overlap((value, value), item.ends):
        most = item.agreed is not None and item.n_agreeing > 1 and _overlap((value, value), item.agreed)
        return "agrees", "within the range most sources share" if most else "within the printed range"
    if _overlap(credible, item.ends):
        return "not excluded", "the credible interval overlaps the printed range"
    if region is None:
        return "differs", "outside the printed range, held fixed"
    if not _overlap(region, item.ends):
        return "not comparable", "the campaign's region lies outside the printed range"
    return "differs", "outside the printed range"


def _of_levels(spec: CampaignSpec, item: StartRange, level: str, levels: Sequence[str]) -> tuple[str, str]:
    """Verdict and reason on a level that is a number, a band, or a set of these."""
    members = {} if spec.simulator is None else spec.simulator.members
    parts = {part for one in levels for part in one.split("+")}
    values = {part: value for part in parts if (value := frequency_of(part, members)) is not None}
    if len(values) < len(parts):
        return "not comparable", "levels that are no numbers"
    region = min(values.values()), max(values.values())
    found = {part: _verdict(item, values[part], (values[part],) * 2, region) for part in level.split("+")}
    if len({verdict for verdict, _ in found.values()}) == 1:
        return next(iter(found.values()))
    inside = listing([part for part, (verdict, _) in found.items() if verdict == "agrees"])
    return "not excluded", f"{inside} within the printed range"


def _overlap(one: tuple[float, float], other: tuple[float, float]) -> bool:
    return one[0] <= other[1] and one[1] >= other[0]


def _fixed(spec: CampaignSpec, name: str) -> float | str | None:
    """Value that the campaign holds fixed of a parameter for every sensor, by its name or its field's; None without."""
    given = {} if spec.simulator is None else spec.simulator.fixed
    members = {} if spec.simulator is None else spec.simulator.members
    if any(name in own or f"{member}.{name}" in spec.region.names for member, own in members.items()):
        return None
    return given.get(name, given.get((RADAR.get(name) or RADIOMETER[name]).field))


def _compare_levels(spec: CampaignSpec, analysis: Analysis, item: StartLevels) -> Comparison | None:
    factor = next((f for f in analysis.region.factors if f.name == "polarization"), None)
    if isinstance(factor, CategoricalFactor):
        best = str(analysis.optimum.settings["polarization"])
        found = f"{best} (of {describe_factor(factor)[1]})"
    else:
        fixed = _fixed(spec, "polarization")
        if not isinstance(fixed, str):
            return None
        best, found = fixed, f"{fixed}, held fixed"
    printed = ", ".join(item.levels) or NOTHING
    channels = {channel for level in item.levels for channel in level.split("+")}
    own = [channel for channel in best.split("+") if channel != PHASE]  # of which the tables say nothing
    missing = [channel for channel in own if channel not in channels]
    if not set(own) <= _CHANNELS:
        verdict, why = "not comparable", "not a plain set of channels"
    elif not item.levels:
        verdict, why = "nothing printed", "the tables name no channel"
    elif any(set(level.split("+")) == set(own) for level in item.levels):
        verdict, why = "agrees", "required in this combination"
    elif not missing:
        verdict, why = "agrees", "every channel is required, though not together"
    elif len(missing) < len(own):
        verdict, why = "not excluded", f"no source requires {', '.join(missing)}"
    else:
        verdict, why = "differs", f"no source requires {', '.join(missing)}"
    return Comparison("polarization", printed, ", ".join(item.tables), NOTHING, found, verdict, why)


def _ends(low: float, high: float, unit: str) -> str:
    """A printed range; wavelengths turned into frequencies keep three digits."""
    first, last = (format_plain(float(f"{end:.3g}")) for end in (low, high))
    return with_unit(first if first == last else f"{first} to {last}", unit)


def printed_section(dossier: Dossier) -> Section | None:
    """Return what the catalogue's tables print on each application; None where they print nothing."""
    blocks: list[Block] = []
    columns = ("Parameter", "As printed", "Read as", "Tables", "Application")
    for found in (looked_up(dossier.spec, analysis.application) for analysis in dossier.analyses):
        if found is not None:
            asked, _, start = found
            rows = (
                (one.parameter, one.printed, one.read_as, ", ".join(one.tables), _some(one.applications))
                for one in summary(start.entries)
            )
            blocks.append(table(f"Entries for \u201c{asked}\u201d, as printed", columns, rows))
    if not blocks:
        return None
    return Section("printed", "Literature entries as printed", (Paragraph(_LATER), *blocks))


def literature_section(dossier: Dossier) -> Section:
    """Return the comparison with the catalogue for each application."""
    blocks = [block for analysis in dossier.analyses for block in _application(dossier, analysis)]
    return Section("literature", "Comparison with the literature", tuple(blocks))


def _application(dossier: Dossier, analysis: Analysis) -> list[Block]:
    found = looked_up(dossier.spec, analysis.application)
    kind = "radar" if system_of(dossier.spec) == "active" else "radiometer"
    if found is None:
        return [
            Paragraph(
                f"{analysis.application}: no {kind} entry of Tables A.1 to A.20 of RSL TR 380-1 matches the words of "
                "the application's name or the campaign's description. The key catalog of [[application]] sets the "
                "words to look up."
            )
        ]
    asked, reason, start = found
    compared = comparisons(dossier.spec, analysis, start)
    count = len(start.entries)
    text = (
        f"{analysis.application}: {counted(count, f'{kind} entry', f'{kind} entries')} in Tables A.1 to A.20 of "
        f"RSL TR 380-1 for \u201c{asked}\u201d ({reason}). "
    )
    rows = (
        (readable(row.parameter), row.printed, row.agreed, row.found, f"{row.verdict}: {row.why}", row.tables)
        for row in compared
    )
    columns = ("Parameter", "Literature", "Most sources", "This campaign", "Agreement", "Tables")
    caption = f"{analysis.application}: recommended settings (with credible interval or levels) and the literature"
    return [Paragraph(text + _agreement(compared)), *([table(caption, columns, rows)] if compared else [])]


def _agreement(compared: Sequence[Comparison]) -> str:
    judged = [row for row in compared if row.verdict in ("agrees", "not excluded", "differs")]
    words = [f"{readable(row.parameter)} {row.verdict}" for row in judged]
    if not words:
        return "What they print cannot be compared with this campaign's settings."
    if len(words) == 1:
        return f"One parameter can be compared: {words[0]}."
    agreeing = sum(row.verdict == "agrees" for row in judged)
    return f"{agreeing} of {len(words)} comparable parameters agree: {listing(words)}."


def _some(applications: tuple[str, ...]) -> str:
    """The first applications of a statement; the catalogue command lists all."""
    if len(applications) <= MAX_NAMED:
        return "; ".join(applications)
    return f"{'; '.join(applications[:MAX_NAMED])}; {len(applications) - MAX_NAMED} more"
