"""The catalogue on a terminal: sensors by name, and the tables of 1979."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from seqrsm.catalog.rendering import summary
from seqrsm.catalog.tables import Entry, Platform, Table, load_catalog
from seqrsm.cli.console import display, heading, line, say, show_table
from seqrsm.errors import UserError
from seqrsm.sensor.named import NamedSensor

_MARKS = {"seen": "", "derived": "=", "recalled": "?"}
_COLUMNS = {
    "sar": (
        ("GHz", "frequency_ghz"), ("range m", "resolution_range_m"), ("azimuth m", "resolution_azimuth_m"),
        ("looks", "looks"), ("from deg", "incidence_near_deg"), ("to deg", "incidence_far_deg"),
        ("noise dB", "nesz_db"), ("worst dB", "nesz_worst_db"), ("days", "revisit_days"),
    ),
    "radiometer": (
        ("GHz", "frequency_ghz"), ("footprint km", "footprint_km"), ("noise K", "nedt_k"),
        ("ms", "integration_time_ms"), ("MHz", "bandwidth_mhz"), ("from deg", "incidence_near_deg"),
        ("to deg", "incidence_far_deg"), ("days", "revisit_days"),
    ),
}  # fmt: skip


def show_tables() -> None:
    """All tables, a line each."""
    columns = ("table", "kind", "title", "entries", "none", "note")
    rows = [(t.number, t.kind, t.title, str(t.n_entries), str(t.n_none), t.note) for t in load_catalog().tables]
    show_table(columns, rows, title="Tables of RSL TR 380-1, Appendix A", sides=("left",))


def show_table_of(table: Table) -> None:
    """One table: its applications, or its platform."""
    heading(f"Table {table.number}: {table.title or table.note}")
    rows = load_catalog().of(table)
    if rows and isinstance(rows[0], Platform):
        show_platforms([one for one in rows if isinstance(one, Platform)])
    else:
        _show_entries([one for one in rows if isinstance(one, Entry)])


def show_sensors(sensors: Sequence[NamedSensor]) -> None:
    """Sensors by name, a line each; of one alone every value, and where it was seen."""
    for kind, columns in _COLUMNS.items():
        rows = [
            [one.title, one.status, " or ".join(one.channels), *(_value(one, column) for _, column in columns)]
            for one in sensors
            if one.kind == kind
        ]
        if rows:
            heads = ["sensor", "status", "channels", *(head for head, _ in columns)]
            title = "Radars" if kind == "sar" else "Radiometers"
            show_table(heads, rows, title=title, sides=("left", "left", "left", "right"))
    if sensors:
        line("? recalled, not verified against a source; = derived from other values; - not found")
    if len(sensors) == 1:
        (one,) = sensors
        show_table(["value", "", ""], [[name, _value(one, name), one.resting(name)] for name in one.values])
        line(f"Sources: {one.sources}")
        line(f"Notes: {one.notes}")


def _value(sensor: NamedSensor, column: str) -> str:
    if column not in sensor.values:
        return "-"
    return f"{sensor.values[column]:g}{_MARKS[sensor.resting(column)]}"


def show_platforms(platforms: Sequence[Platform]) -> None:
    """Platforms of Tables A.21 to A.39, every printed line."""
    for platform in platforms:
        rows = [[item.item, item.printed or "-", item.note] for item in platform.items]
        title = f"{platform.table} {platform.name}, as printed in 1979"
        show_table(["line", "printed", "note"], rows, title=title, sides=("left",))


def show_asked_for(found: Sequence[Entry], words: str) -> None:
    """What the literature asks for: a summary, then the entries as printed."""
    columns = ("parameter", "system", "printed", "read as", "tables")
    rows = [(one.parameter, one.system, one.printed, one.read_as, ", ".join(one.tables)) for one in summary(found)]
    kept = [i for i in range(len(columns)) if any(row[i] for row in rows)]
    if rows:
        narrow = [[row[i] for i in kept] for row in rows]
        show_table([columns[i] for i in kept], narrow, title=f"Requirements for {words}", sides=("left",))
    heading("Entries as printed")
    _show_entries(found)


def _show_entries(found: Sequence[Entry]) -> None:
    for entry in found:
        printed = {
            "system": entry.system,
            "band or wavelength": entry.band or entry.wavelength,
            "frequency [GHz]": "; ".join(map(str, entry.frequency_ghz)),
            "resolution class [m]": str(entry.resolution_class_m or ""),
            "wanted [m]": entry.resolution_wanted,
            "accepted [m]": entry.resolution_accepted,
            "polarization": entry.polarization,
            "nadir angle [deg]": entry.nadir_angle,
            "revisit": entry.auxiliary,
            "note": entry.note,
        }
        line(f"{entry.table} {entry.category}: {entry.name}", 2)
        line("; ".join(f"{name} {text}" for name, text in printed.items() if text), 6)


def say_made(folder: Path, applications: Sequence[str], scene: Path | None) -> None:
    """Make a campaign from the catalogue, and say what each application is measured by."""
    from seqrsm.spec.from_catalog import engine_for, init_from_catalog, tables_text

    wanted = init_from_catalog(applications, folder, scene)
    for one in wanted:
        tables = tables_text(entry.table for entry in one.start.entries)
        how = f"measured by {one.measure.utility}"
        if not one.measure.utility:
            how = f"which no built-in utility measures: {one.measure.says}"
        say(f"created {folder} for {one.words} from {tables}, {how}")
    named = shlex.quote(str(folder))
    if engine_for(wanted):
        from seqrsm.campaign.check import settle_target

        with display("seeing what the target may be", inner=False) as shown:
            try:
                if reason := settle_target(folder, partial(shown.count, "seeing what the target may be")):
                    say(f"a wider stop target than usual was written: {reason}")
            except UserError as error:  # of a scene of one's own
                say(f"to be mended: {error}")
        say(f"see the comments in {folder}/campaign.toml; next: seqrsm check {named}")
        return
    say(f'write your own (utility = "mine:score" and a [simulator]), or measure; next: seqrsm propose {named}')
