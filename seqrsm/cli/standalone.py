"""Commands that need no campaign: ``seqrsm design``, ``catalog``, ``parameters`` and ``schema``."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Annotated, Any

import typer

from seqrsm.cli.console import AsJson, display, guarded, print_json
from seqrsm.errors import UserError


@guarded
def design(
    runs: Annotated[int, typer.Option(min=1, max=1000, help="Number of runs. For more, repeat a design.")],
    factors: Annotated[
        int | None, typer.Option(min=1, max=8, help="Number of continuous factors, coded -1 to 1.")
    ] = None,
    criterion: Annotated[str, typer.Option(help="Optimality criterion: D, I or A.")] = "D",
    factor: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=...", help="Instead of --factors: x=1:10, f=1:18:log, looks=1,2,4 or pol=HH,HV."),
    ] = None,
    constraint: Annotated[
        list[str] | None, typer.Option(metavar="EXPR", help="Constraint, such as 'a + b <= 1'.")
    ] = None,
    order: Annotated[int, typer.Option(min=1, max=2, help="Order of the model.")] = 2,
    centre: Annotated[int, typer.Option(min=0, help="Runs at the centre.")] = 0,
    csv: Annotated[Path | None, typer.Option(metavar="FILE", help="Write the design as CSV.")] = None,
    random_order: Annotated[bool, typer.Option("--random-order", help="Randomize the run order.")] = False,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the search and of the random order.")] = 1979,
    as_json: AsJson = False,
) -> None:
    """Make and evaluate an optimal design without a campaign."""
    from seqrsm.cli.designs import factors_of, standalone_design, write_design
    from seqrsm.cli.show import show_design
    from seqrsm.files import see_free

    if csv is not None:
        see_free(csv)
    with display("searching"):
        result = standalone_design(
            factors_of(factors, factor or ()), constraint or (), runs=runs, criterion=criterion, order=order,
            centre=centre, seed=seed, random_order=random_order,
        )  # fmt: skip
    if csv is not None:
        write_design(csv, result)
    print_json(result) if as_json else show_design(result)


@guarded
def catalog(
    words: Annotated[
        list[str] | None,
        typer.Argument(metavar="[WORDS]", help="An application (soil moisture), sensor (Seasat) or table (A.32)."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Look up sensors and literature requirements.

    Sensors by name, and requirements of applications in Tables A.1 to A.39 of RSL TR 380-1.
    """
    from seqrsm.catalog.rendering import to_json
    from seqrsm.catalog.search import platforms_called, search, table_called
    from seqrsm.catalog.tables import load_catalog
    from seqrsm.cli import show_catalog as show
    from seqrsm.sensor import named

    asked = " ".join(words or ())
    table, whole = table_called(asked), load_catalog()
    if not asked:
        every = {"tables": whole.tables, "entries": to_json(whole.entries), "platforms": to_json(whole.platforms)}
        print_json(every) if as_json else show.show_tables()
    elif table is not None:
        print_json(to_json(whole.of(table))) if as_json else show.show_table_of(table)
    else:
        entries, platforms, sensors = search(asked), platforms_called(asked), named.sensors_called(asked)
        if not (entries or platforms or sensors):
            nearest = named.nearest_names(asked, [one.name for one in whole.platforms])
            like = f"Similar names: {', '.join(nearest)}. " if nearest else ""
            remedy = f"{like}`seqrsm catalog` lists the tables."
            raise UserError("no sensor, platform or application matches", remedy, field="WORDS", value=asked)
        if as_json:
            document = {"entries": to_json(entries), "platforms": to_json(platforms)}
            print_json({**document, "sensors": [named.to_json(one) for one in sensors]})
            return
        show.show_sensors(sensors)
        show.show_platforms(platforms)
        if entries:
            show.show_asked_for(entries, asked)


@guarded
def parameters(
    engine: Annotated[str, typer.Argument(metavar="ENGINE", help="psm (radar) or prm (radiometer).")],
    as_json: AsJson = False,
) -> None:
    """List the parameters of a sensor. Each may be a factor or be set under [simulator.fixed]."""
    from seqrsm.cli.show import show_parameters
    from seqrsm.sensor.parameters import CALENDAR, RADAR, RADIOMETER, listed
    from seqrsm.sensor.radar import RadarConfiguration
    from seqrsm.sensor.radiometer import RadiometerConfiguration
    from seqrsm.sensor.sets import Dates

    sensors = {"psm": (RADAR, RadarConfiguration), "prm": (RADIOMETER, RadiometerConfiguration)}
    if engine not in sensors:
        raise UserError("no such engine", f"Use {' or '.join(sensors)}.", field="ENGINE", value=engine)
    rows = [*listed(*sensors[engine]), *listed(CALENDAR, Dates)]
    print_json(rows) if as_json else show_parameters(rows)


@guarded
def schema(
    command: Annotated[
        list[str] | None, typer.Argument(metavar="[COMMAND]", help="Schema of this command's --json instead.")
    ] = None,
) -> None:
    """Print a JSON schema.

    Of campaign.toml, with which editors complete and check it, or of a command's --json. To use it, write it beside the
    file (seqrsm schema > campaign.schema.json) and begin that with: #:schema campaign.schema.json
    """
    from seqrsm.spec.schema import campaign_schema

    print_json(output_schema(" ".join(command)) if command else campaign_schema())


def output_schema(command: str) -> dict[str, Any]:
    """The schema, draft 2020-12, of a command's document, with the definitions that it needs.

    Tests hold every command's documents against those of ``json_schemas.json``, and no field may be missing there.
    UserError where no command of this name prints JSON.
    """
    held = json.loads(Path(__file__).with_name("json_schemas.json").read_text(encoding="utf-8"))
    if command not in held["commands"]:
        remedy = f"Use one of {', '.join(held['commands'])}; without a command, the schema is that of campaign.toml."
        raise UserError("no command of this name has --json", remedy, field="COMMAND", value=command)
    needed: dict[str, Any] = {}
    left = [held["commands"][command]]
    while left:
        for name in re.findall(r'"#/\$defs/(\w+)"', json.dumps(left.pop())):
            if name not in needed:
                needed[name] = held["$defs"][name]
                left.append(needed[name])
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"seqrsm {command} --json",
        **held["commands"][command],
        "$defs": needed,
    }
