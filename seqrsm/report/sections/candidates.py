"""Candidate sensors against the optimum, ordered by the probability that they suffice."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from seqrsm.plain import heading
from seqrsm.report.blocks import Block, Bullets, Cell, FigureBlock, Head, PanelData, Paragraph, Section, right, table
from seqrsm.report.figures import drawing
from seqrsm.report.rounding import NOTHING, decimals_for, format_number, format_range, format_share, format_significant
from seqrsm.report.wording import level_text, listing, number_cell, slug, with_unit
from seqrsm.sensor.exchange import PROPERTIES

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MOST = 20  # told in a report: as many as a page holds
_NAMES = {
    "frequency_ghz": "frequency", "bandwidth_mhz": "bandwidth", "resolution_range_m": "range resolution",
    "resolution_azimuth_m": "azimuth resolution", "incidence_near_deg": "near incidence",
    "incidence_far_deg": "far incidence", "altitude_km": "altitude", "radiometric_accuracy_db": "calibration",
    "footprint_km": "footprint", "nedt_k": "noise", "integration_time_ms": "integration time",
    "revisit_days": "revisit", "rotation_rpm": "rotation",
}  # fmt: skip


def candidate_section(
    measured: Mapping[str, Any] | None, *, named: bool = False, every: bool = False
) -> Section | None:
    """Return what `seqrsm.campaign.candidates.measure_candidates` found.

    By default of the twenty most probable of each application, and how many others there are. Where it found nothing of
    this optimum, None, or what to do if the campaign names candidates.
    """
    if measured is None:
        todo = (
            "The candidates in campaign.toml have not been compared with this optimum: run `seqrsm candidates`, then "
            "write the report again."
        )
        return Section("candidates", "Candidate sensors", (Paragraph(todo, "warning"),)) if named else None
    several = len(measured["applications"]) > 1
    parts = tuple(
        Section(f"candidates-{slug(name)}", name if several else "Candidates", tuple(_blocks(name, found, every)))
        for name, found in measured["applications"].items()
    )
    title = "Candidate sensors"
    return Section("candidates", title, (), parts) if several else Section("candidates", title, parts[0].blocks)


def _blocks(name: str, found: Mapping[str, Any], every: bool) -> list[Block]:
    known = [row for row in found["candidates"] if row["how"] != "none"]
    failed = [row for row in found["candidates"] if row["how"] == "none"]
    most = len(found["candidates"]) if every else _MOST
    told = known[:most]
    unit, level = found["unit"], level_text(found["level"])
    runs = {None: "many occasions", 1.0: "one occasion"}.get(found["runs"], f"{found['runs'] or 0:g} occasions")
    runs = runs if found["runs"] == 1.0 else f"the mean of {runs}"
    enough = abs(found["sufficient"]) if found["relative"] else found["sufficient"]
    size = with_unit(format_significant(enough, 3), unit)
    rule = f"within {size} of the optimum's" if found["relative"] else f"{size} or better"
    digits = 1 if abs(found["optimum"]) > 1.0 else 3  # of percent, or of what lies between 0 and 1
    optimum = f"The optimum's score is {with_unit(format_number(found['optimum'], digits), unit)}"
    if found.get("simulated") is not None:
        simulated = with_unit(format_number(found["simulated"], digits), unit)
        optimum += f" by the fit and {simulated} on the occasions on which candidates are simulated"
    blocks: list[Block] = [
        Paragraph(
            f"A sensor suffices if its score is {rule}, for {runs} over one ground. {optimum}.",
            method=" Candidates are simulated with their own noise, angles, looks, cell and dates at the near edge, "
            "middle and far edge of their swath, on the same occasions and table draws as the optimum. Those that "
            "differ only in factors, within the region, are evaluated on the fitted surface.",
        )
    ]
    guess = found.get("guess")
    if found["relative"] and guess is not None and (guess - found["optimum"]) / found["sufficient"] <= 1.0:
        text = f"Guessing scores {with_unit(format_number(guess, digits), unit)}, which suffices by this rule: "
        text += "set `sufficient` of the application to the score that it needs."
        blocks.append(Paragraph(text, "warning"))
    if told:
        caption = "Candidates, by probability of sufficing"
        blocks += [_picture(name, told, found), _table(caption, "suffices", "optimum", told, found, digits)]
    if told and (again := told[0].get("again")):
        text = (
            f"The first of {len(known)} candidates may owe its place to chance. In further draws of the tables "
            f"{told[0]['name']} differs from the optimum by {_again(again, digits, unit, level)}, and suffices with a "
            f"probability of {format_share(again['probability'])}."
        )
        blocks.append(Paragraph(text))
        if beside := [row["beside_first"] for row in told if "beside_first" in row]:
            caption = f"The next simulated candidates less {told[0]['name']}, in further draws of the tables"
            blocks.append(_table(caption, "at least as good", "the first", beside, found, digits))
    if any(row.get("owed_to") for row in told):
        blocks.append(_owed(told, unit, digits))
    notes = [_note(row, digits, unit) for row in told]
    notes += [f"{row['name']} could not be evaluated: {row['why']}." for row in failed[:most]]
    rest = [
        f"{len(left)} {kind}"
        for left, kind in ((known[most:], "less likely to suffice"), (failed[most:], "not evaluated"))
        if left
    ]
    if rest:
        notes.append(f"Candidates not shown here: {listing(rest)}; `seqrsm candidates` lists all, with --json as data.")
    notes = [note for note in notes if note]
    return [*blocks, Bullets(tuple(notes))] if notes else blocks


def _table(
    caption: str, likely: str, other: str, rows: Sequence[Mapping[str, Any]], found: Mapping[str, Any], digits: int
) -> Block:
    unit, level = found["unit"], level_text(found["level"])
    columns: tuple[Head, ...] = (
        "Sensor",
        right(f"Pr({likely})", "%"),
        right("Score", unit),
        right(f"Difference from {other}", unit),
        right(f"Mean over grounds, {level}", unit),
        right(f"One ground, {level}", unit),
        "Method",
    )
    return table(caption, columns, (_row(row, digits) for row in rows), sortable=True)


def _row(row: Mapping[str, Any], digits: int) -> tuple[Cell, ...]:
    places = _places(row, digits)
    ends = (format_range(*_ends(row, name), places) for name in ("confidence", "one_ground"))
    return (
        Cell(row["name"]),
        number_cell(format_share(row["probability"]).removesuffix("%").strip(), row["probability"]),
        number_cell(format_number(row["score"], places), row["score"]),
        number_cell(format_number(row["difference"], places), row["difference"]),
        *(Cell(text) for text in ends),
        Cell(row["how"]),
    )


def _again(found: Mapping[str, Any], digits: int, unit: str, level: str) -> str:
    places = _places(found, digits)
    mean, one = (with_unit(format_range(*_ends(found, name), places), unit) for name in ("confidence", "one_ground"))
    difference = with_unit(format_number(found["difference"], places), unit)
    return f"{difference} ({level} interval of the mean over grounds {mean}, of one ground {one})"


def _owed(rows: Sequence[Mapping[str, Any]], unit: str, digits: int) -> Block:
    found = [row for row in rows if row.get("owed_to")]
    seen = {one["property"] for row in found for one in row["owed_to"]}
    names = [name for name in (*PROPERTIES, "dates") if name in seen]
    cells = []
    for row in found:
        own = {one["property"]: one for one in row["owed_to"]}
        cells.append((Cell(row["name"]), *(_share(own.get(name), digits) for name in names)))
    heads: tuple[Head, ...] = ("Sensor", *(right(name.capitalize(), unit) for name in names))
    caption = (
        "Change of the optimum's score when one property takes the candidate's value, with half-widths; the changes "
        "need not add up"
    )
    return table(caption, heads, cells)


def _share(one: Mapping[str, Any] | None, digits: int) -> Cell:
    if one is None:
        return Cell(NOTHING)
    low, high = _ends(one)
    half, places = 0.5 * (high - low), _places(one, digits)
    return Cell(f"{format_number(one['difference'], places)} \u00b1 {format_number(half, places)}", one["difference"])


def _places(one: Mapping[str, Any], digits: int) -> int:
    """Decimals that the confidence interval of a difference supports, at least none and one more than a score's."""
    low, high = _ends(one)
    return min(max(decimals_for(0.5 * (high - low), digits), 0), digits + 1)


def _ends(one: Mapping[str, Any], name: str = "confidence") -> tuple[float, float]:
    return one[name]["low"], one[name]["high"]


def _note(row: Mapping[str, Any], digits: int, unit: str) -> str:
    """Places of the swath, dates, and what is not checked of a sensor."""
    parts = []
    places = row.get("places") or []
    if places:
        if "footprint_m" not in places[0]:
            cells = format_significant(places[len(places) // 2]["cell_m"], 3)
            parts.append(f"cell {cells}\u00a0m")
        if "looks" in places[0]:
            angles = " / ".join(f"{one['incidence_deg']:.0f}" for one in places)
            scores = " / ".join(format_number(one["score"], digits) for one in places)
            noise = " / ".join(format_number(one["noise_db"], 1) for one in places)
            looks = format_significant(places[len(places) // 2]["looks"], 2)
            seen = f"{looks} looks; at {angles}\u00a0deg incidence noise {noise}\u00a0dB"
            parts.append(f"{seen}, score {with_unit(scores, unit)}")
        elif "footprint_m" in places[0]:
            length, width = (format_significant(1e-3 * side, 3) for side in places[0]["footprint_m"])
            parts.append(f"footprint {length} by {width}\u00a0km at {places[0]['incidence_deg']:g}\u00a0deg")
    if "scene_km" in row:
        wide, long = (format_significant(side, 3) for side in row["scene_km"])
        parts.append(f"larger than the scene of {wide} by {long}\u00a0km, which it cannot resolve")
    dates = row.get("dates")
    if dates:
        days = listing([f"{day:.0f}" for day in dates["used"]])
        offered = "" if dates["offered"] is None else f" of {dates['offered']} available in the season"
        parts.append(f"days {days}{offered}")
    for kind in ("recalled", "assumed"):
        if row.get(kind):
            what = listing([_NAMES.get(name, name) for name in row[kind]])
            parts.append(f"{what} {kind}, not verified against a source")
    return f"{row['name']}: {'; '.join(parts)}." if parts else ""


def _picture(name: str, rows: Sequence[Mapping[str, Any]], found: Mapping[str, Any]) -> FigureBlock:
    shape = {"width_in": 2.0 * drawing.PANEL_WIDTH_IN, "height_in": 0.9 + 0.32 * len(rows)}
    told = (with_unit(f"{row['difference']:.3g}", found["unit"]) for row in rows)
    alt = "; ".join(f"{row['name']}: {text}" for row, text in zip(rows, told, strict=True))
    paint, data = partial(_paint, rows, found), partial(_data, rows, found)
    panel = drawing.panel(f"Candidates against the optimum, {name}", alt, paint, f"candidates {name}", data, **shape)
    under = (
        "Each candidate's score minus the optimum's: interval of the mean over all grounds (thick) and of one ground "
        "anywhere in the swath (thin). In brackets: probability of sufficing. Dashed: sufficient."
    )
    return FigureBlock(lambda: (panel,), under, columns=1)


def _data(rows: Sequence[Mapping[str, Any]], found: Mapping[str, Any]) -> PanelData:
    names = ("difference", "mean low", "mean high", "one ground low", "one ground high")
    return PanelData(
        ("sensor", *(heading(name, found["unit"]) for name in names), "probability"),
        tuple(
            (row["name"], row["difference"], *_ends(row), *_ends(row, "one_ground"), row["probability"]) for row in rows
        ),
    )


def _paint(rows: Sequence[Mapping[str, Any]], found: Mapping[str, Any], axes: Axes) -> None:
    for k, row in enumerate(reversed(rows)):
        axes.plot(_ends(row, "one_ground"), (k, k), color=drawing.MUTED, linewidth=1.0)
        axes.plot(_ends(row), (k, k), color=drawing.BLUE, linewidth=4.0, solid_capstyle="butt")
        axes.scatter([row["difference"]], [k], s=18, color=drawing.INK, zorder=3, linewidths=0)
    axes.axvline(0.0, color=drawing.INK, linewidth=0.8)
    edge = found["sufficient"] - (0.0 if found["relative"] else found["optimum"])
    axes.axvline(edge, color=drawing.ORANGE, linestyle="--", linewidth=1.0)
    axes.set_yticks(range(len(rows)), [f"{row['name']} ({format_share(row['probability'])})" for row in reversed(rows)])
    axes.set_ylim(-0.6, len(rows) - 0.4)
    axes.set_xlabel(heading("score minus the optimum's", found["unit"]))
    axes.grid(visible=True, axis="x")
