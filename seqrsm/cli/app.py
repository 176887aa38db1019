"""The ``seqrsm`` command: every function parses, calls one thing, prints, and sets the exit code.

Heavy libraries are imported inside the command that needs them, so that ``--help`` answers at once.
"""

from __future__ import annotations

import errno
import gc
import io
import os
import shlex
import sys
import warnings
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from seqrsm import __version__
from seqrsm.cli.console import (
    EXIT_BUDGET_SPENT,
    EXIT_CLOSED_PIPE,
    EXIT_USER_ERROR,
    AsJson,
    StoppedError,
    at_end,
    display,
    fail_stopped,
    guarded,
    line,
    print_json,
    say,
    show_table,
    stop_on_signals,
)
from seqrsm.cli.scene import scene_app
from seqrsm.cli.standalone import catalog, design, parameters, schema
from seqrsm.errors import SpecError, UserError
from seqrsm.plain import counted

if TYPE_CHECKING:
    from seqrsm.analysis.results import Analysis
    from seqrsm.cli.notebook import Campaign

app = typer.Typer(
    name="seqrsm",
    help="Find the best design of a microwave remote sensor by sequential response-surface campaigns.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich" if sys.stdout.isatty() else None,  # no boxes in a pipe
)
app.add_typer(scene_app, name="scene")

Folder = Annotated[Path, typer.Argument(metavar="DIR", help="Campaign folder (contains campaign.toml).")]
Workers = Annotated[int, typer.Option(min=1, help="Simulations at the same time.")]
Cluster = Annotated[str | None, typer.Option(metavar="ADDRESS", help="Address of a dask scheduler (extra 'cluster').")]
Accepted = Annotated[
    bool,
    typer.Option(
        "--accept", help="Continue although program, simulator, scene, utility or code changed since earlier runs."
    ),
]


def _opened(folder: Path, *, accept: bool = False) -> Campaign:
    """The campaign in a folder, closed when the command ends; ``accept``: its simulator as it is now."""
    from seqrsm.cli.notebook import Campaign

    campaign = Campaign(folder)
    at_end(campaign.opened.store.leave)
    if campaign.opened.store.note:
        say(campaign.opened.store.note)
    if accept and campaign.spec.simulator is not None:
        from seqrsm.campaign.experiment import see_experiment

        see_experiment(campaign.opened.store, campaign.spec, accept=True)
    return campaign


def main() -> None:
    """Run the command of the arguments; the process ends with its exit code."""
    # Matrices here are small: threads of BLAS cost two to three times what they save, take cores from simulations, and
    # make last digits depend on the machine's cores. Set before anything imports numpy; the user's own setting stays.
    for name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    warnings.showwarning = lambda message, *_: say(f"warning: {message}")
    gc.set_threshold(50_000)  # imports, compiling and drawing make many objects that stay: a twentieth less time
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # an encoding such as Windows' for pipes lacks some of our signs
    stop_on_signals()
    try:
        try:
            app()
        finally:
            sys.stdout.flush()
    except StoppedError:  # before a command began
        try:
            fail_stopped()
        except typer.Exit as end:
            sys.exit(end.exit_code)
    except (OSError, SystemExit) as end:
        # Of a closed pipe, as that of `| head`, the parser of arguments and the console make an exit of their own.
        closed = isinstance(end, BrokenPipeError) or isinstance(end.__context__, BrokenPipeError)
        if isinstance(end, OSError) and end.errno in (errno.ENOSPC, errno.EDQUOT):
            with suppress(OSError):
                say(f"error: the output cannot be written: {end.strerror}. Free some space, and try again.")
        elif not closed:
            raise
        nobody = os.open(os.devnull, os.O_WRONLY)  # for what is still to be written
        os.dup2(nobody, 1)
        os.dup2(nobody, 2)
        sys.exit(EXIT_CLOSED_PIPE if closed else EXIT_USER_ERROR)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"seqrsm {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass


def _template_names() -> list[str]:
    from seqrsm.spec.templates import templates

    return list(templates())


@app.command()
@guarded
def init(
    folder: Annotated[Path | None, typer.Argument(metavar="DIR", help="Folder to create.")] = None,
    template: Annotated[
        str | None, typer.Option(metavar="NAME", help="Example to start from.", autocompletion=_template_names)
    ] = None,
    application: Annotated[
        list[str] | None,
        typer.Option(
            metavar="WORDS", help='Start from literature requirements for an application, such as "soil moisture".'
        ),
    ] = None,
    scene: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Your own scene, with --application (see `seqrsm scene`).")
    ] = None,
    more: Annotated[list[str] | None, typer.Argument(metavar="[WORDS]", help="Further words of --application.")] = None,
    list_templates: Annotated[bool, typer.Option("--list", help="List the templates.")] = False,
) -> None:
    """Create a campaign folder. From a template, or from literature requirements for an application."""
    from seqrsm.spec.templates import copy_template, templates

    if list_templates:
        show_table(["template", "question"], list(templates().items()), sides=("left",))
        return
    if more and len(application or ()) != 1:
        raise UserError("init creates one folder", "Write: seqrsm init DIR --template NAME.", value=" ".join(more))
    if scene is not None and not application:
        raise UserError("--scene needs --application", "Add --application WORDS.", field="--scene")
    application = application or None
    if folder is None or (template is None) == (application is None):
        raise UserError(
            "init needs a folder and one of template or application",
            "Write: seqrsm init DIR --template NAME (--list names them), or --application WORDS.",
        )
    if application is not None:
        from seqrsm.cli.show_catalog import say_made

        say_made(folder, [" ".join((*application, *(more or ())))] if more else application, scene)
        return
    assert template is not None
    copy_template(template, folder)
    say(f"created {folder} from template {template}; next: {_next_step(folder)}")


def _next_step(folder: Path) -> str:
    """What to type after init: a campaign that brings measured scores needs them first."""
    scores = sorted(folder.glob("*_scores.csv"))
    words = ["ingest", folder, *scores] if scores else ["check", folder]
    return shlex.join(["seqrsm", *map(str, words)])


@app.command()
@guarded
def check(folder: Folder, as_json: AsJson = False) -> None:
    """Check a campaign before it runs.

    Validates the specification, and estimates cost and whether the target half-width can be reached. Starts no runs.
    """
    from seqrsm.campaign.check import check_campaign, refusals
    from seqrsm.cli.blocks import show_sections
    from seqrsm.report.sections.check import check_sections

    with display("checking", inner=False) as shown:
        result = check_campaign(folder, partial(shown.count, "checking"))
    if as_json:
        print_json(result)
    else:
        show_sections(check_sections(result))
        line()
    if problems := refusals(folder, result):
        raise SpecError(*problems)
    if not as_json:
        for problem in (warned := [one.target_problem for one in result.judged if one.target_problem]):
            line(f"Warning: {problem}")
        if not warned:
            line("See the notes on the region and the scene." if result.combinations else "No problems found.")


@app.command()
@guarded
def run(
    folder: Folder,
    max_runs: Annotated[int | None, typer.Option(min=1, help="Budget of runs [default: the campaign's].")] = None,
    batch: Annotated[int | None, typer.Option(min=1, help="Runs per batch [default: the campaign's].")] = None,
    workers: Workers = 1,
    cluster: Cluster = None,
    accept: Accepted = False,
    as_json: AsJson = False,
) -> None:
    """Run a campaign to its end.

    Simulates, fits, decides and proposes until the stop rule is met or the budget is spent. After an interruption the
    same command continues.
    """
    from seqrsm.cli.show_fit import show_look

    campaign = _opened(folder, accept=accept)
    with display("reading") as shown:

        def on_look(look: Analysis) -> None:
            if not as_json:
                show_look(campaign.spec, look)
            shown.step("choosing the next runs")

        def on_step(text: str) -> None:
            if not as_json:
                say(text)
            shown.step(text)

        ended = campaign.run(
            max_runs=max_runs,
            batch=batch,
            workers=workers,
            cluster=cluster,
            on_progress=partial(shown.count, "simulating"),
            on_look=on_look,
            say=on_step,
        )
    print_json(ended.to_json()) if as_json else ended.show()
    if not ended.held:
        raise typer.Exit(EXIT_BUDGET_SPENT)


@app.command()
@guarded
def propose(
    folder: Folder,
    n: Annotated[int | None, typer.Option("-n", min=1, help="Number of runs [default: the campaign's batch].")] = None,
    source: Annotated[
        str | None, typer.Option(help="simulation, flight or best [default: simulation if there is a simulator].")
    ] = None,
    csv: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Also write a form for the flight crew to fill in.")
    ] = None,
    form: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Issue none; write the form of flights already issued.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Propose and issue the next runs."""
    from seqrsm.cli.show import run_row, show_proposals

    campaign = _opened(folder)
    if form is not None:
        if any(one is not None for one in (n, source, csv)):
            remedy = "Use --csv FILE to issue flights and write their form, or --form FILE alone."
            raise UserError("--form issues no runs: -n, --source and --csv have no effect", remedy)
        say(f"wrote {form}: {campaign.opened.write_form(form)} flights")
        return
    with display("choosing the next runs"):
        runs = campaign.issue(n, source=source, csv=csv)
    if as_json:
        print_json([run_row(run) for run in runs])
    else:
        show_proposals(campaign.spec, runs, of_source=source == "best")
    for told in campaign.remarks(n, runs):
        say(told)
    if csv is not None and all(run.source == "simulation" for run in runs):
        say("no form: none of these runs is a flight")


@app.command()
@guarded
def simulate(
    folder: Folder, workers: Workers = 1, cluster: Cluster = None, accept: Accepted = False, as_json: AsJson = False
) -> None:
    """Simulate the issued runs."""
    from seqrsm.campaign.campaign import all_failed
    from seqrsm.cli.show import run_row, show_runs

    campaign = _opened(folder, accept=accept)
    with display("simulating") as shown:
        told = partial(shown.count, "simulating")
        runs = campaign.carry_out(workers=workers, cluster=cluster, on_progress=told)
    print_json([run_row(run) for run in runs]) if as_json else show_runs(campaign.spec, runs)
    if others := campaign.opened.store.runs("running", source="simulation"):
        say(f"another command is simulating {counted(len(others), 'run')}")
    if runs and all(run.state == "failed" for run in runs):
        raise all_failed(runs)


@app.command()
@guarded
def ingest(
    folder: Folder,
    files: Annotated[
        list[Path], typer.Argument(metavar="FILE...", help="Measured scores: CSV, .xlsx (extra 'excel') or .parquet.")
    ],
    accept: Annotated[bool, typer.Option("--accept", help="Ingest rows that look wrong as they are.")] = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Report what would happen; change nothing.")] = False,
    as_json: AsJson = False,
) -> None:
    """Ingest measured scores or rankings.

    All files are ingested, or none. Suspect rows, such as a frequency in MHz under a header without unit, -9999, an
    outlying score or a duplicate row, are reported with a suggestion, and nothing is ingested without --accept.
    """
    taken = _opened(folder).ingest(*files, dry_run=dry_run, accept=accept)
    print_json(taken.to_json()) if as_json else taken.show()


@app.command()
@guarded
def void(
    folder: Folder,
    runs: Annotated[list[int] | None, typer.Argument(metavar="[RUN_ID...]")] = None,
    why: Annotated[str, typer.Option(metavar="TEXT", help="The reason, kept in the history.")] = "",
    ranking: Annotated[
        int | None, typer.Option(metavar="N", help="Void an interpreter's ranking, by number, instead of a run.")
    ] = None,
) -> None:
    """Exclude runs or a ranking from the fit. Nothing is ever deleted."""
    if bool(runs) == (ranking is not None):
        raise UserError("void excludes runs or one ranking", "Give RUN_ID, or --ranking N.")
    if runs:
        _opened(folder).opened.store.void(runs, why)
        which = ", ".join(map(str, dict.fromkeys(runs)))
        say(f"runs {which} are void: {why}" if "," in which else f"run {which} is void: {why}")
    elif ranking is not None:
        _opened(folder).opened.store.void_ranking(ranking, why)
        say(f"ranking {ranking} is void: {why}")


@app.command()
@guarded
def retry(
    folder: Folder,
    runs: Annotated[
        list[int] | None,
        typer.Argument(
            metavar="[RUN_ID...]", help="Default: all failed runs, except those whose settings are impossible."
        ),
    ] = None,
) -> None:
    """Issue failed runs again. Their attempts are reset; the next `run` or `simulate` carries them out."""
    ids = _opened(folder).opened.store.retry(runs or ())
    say(f"issued again: {', '.join(map(str, ids)) or 'no run'}")


@app.command()
@guarded
def fit(
    folder: Folder,
    application: Annotated[str | None, typer.Option(help="Application, if there are several.")] = None,
    test: Annotated[
        list[str] | None,
        typer.Option(metavar="TERMS", help="Partial F test of comma-separated factors, terms or groups; repeatable."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Show model, optimum, intervals, diagnostics."""
    campaign = _opened(folder)
    with display("sampling the posterior"):
        found = campaign.fit(application, test=test or ())
    print_json(found.to_json()) if as_json else found.show_all()


@app.command()
@guarded
def status(
    folder: Folder,
    history: Annotated[bool, typer.Option("--history", help="Every event, with time, version and seed.")] = False,
    as_json: AsJson = False,
) -> None:
    """Show runs, optimum, intervals and decision."""
    from seqrsm.campaign.status import campaign_status
    from seqrsm.cli.show_fit import show_status
    from seqrsm.spec.read import load_spec

    with display("reading"):
        result = campaign_status(folder, history=history)
    print_json(result) if as_json else show_status(load_spec(folder), result)


@app.command()
@guarded
def rehearse(
    folder: Folder,
    campaigns: Annotated[int, typer.Option(min=10, help="Campaigns to simulate.")] = 40,
    as_json: AsJson = False,
) -> None:
    """Simulate whole campaigns in advance.

    Draws surfaces from the current posterior; reports runs needed, cost and coverage under the stop rule.
    """
    from seqrsm.campaign.rehearsal import rehearse_campaign
    from seqrsm.cli.blocks import show_sections
    from seqrsm.report.sections.check import rehearsal_section

    campaign = _opened(folder)
    with display("rehearsing", inner=False) as shown:
        result = rehearse_campaign(campaign.opened, campaigns, partial(shown.count, "rehearsing"))
    print_json(result) if as_json else show_sections([rehearsal_section(result)])


@app.command()
@guarded
def tradeoff(folder: Folder, as_json: AsJson = False) -> None:
    """Measure simulation speed against accuracy. After an interruption the same command continues."""
    from seqrsm.campaign.tradeoff import measure_tradeoff
    from seqrsm.cli.blocks import show_blocks
    from seqrsm.report.sections.speed import tradeoff_blocks
    from seqrsm.spec.read import load_spec

    spec = load_spec(folder)
    with display("measuring", inner=False) as shown:
        result = measure_tradeoff(spec, partial(shown.count, "measuring"))
    units = {one.name: one.score_unit for one in spec.applications}
    print_json(result) if as_json else show_blocks(tradeoff_blocks(result, units))


@app.command()
@guarded
def candidates(
    folder: Folder,
    worlds: Annotated[
        int, typer.Option(min=4, max=1000, help="Draws of the tables (worlds), common to all sensors.")
    ] = 16,
    workers: Workers = 1,
    as_json: AsJson = False,
) -> None:
    """Compare candidate sensors with the optimum.

    Reports the probability that each [[candidate]] suffices, and which properties cost it score.
    """
    campaign = _opened(folder)
    with display("comparing", inner=False) as shown:
        found = campaign.candidates(worlds=worlds, workers=workers, progress=partial(shown.count, "comparing"))
    print_json(found.to_json()) if as_json else found.show()


@app.command()
@guarded
def report(
    folder: Folder,
    html: Annotated[Path | None, typer.Option(metavar="FILE", help="Write only this HTML file.")] = None,
    pdf: Annotated[Path | None, typer.Option(metavar="FILE", help="Write only this PDF file.")] = None,
    figures: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write each figure as SVG, PDF and PNG, and its data as CSV.")
    ] = None,
) -> None:
    """Write the report as HTML and PDF. By default both, into the campaign's reports/ folder."""
    campaign = _opened(folder)
    with display("reading") as shown:
        written = campaign.report(html, pdf, figures, step=shown.step)
    for path in written:
        if path.parent != figures:
            say(f"wrote {path}")
    if figures is not None:
        count = sum(path.parent == figures for path in written)
        say(f"wrote {count} files into {figures}; captions.csv describes each")


@app.command()
@guarded
def image(
    folder: Folder,
    out: Annotated[Path, typer.Option(metavar="FILE", help="Image to write: .png, .tif (GeoTIFF) or .npz.")],
    settings: Annotated[list[str] | None, typer.Option("--set", metavar="NAME=VALUE", help="A sensor setting.")] = None,
    mask: Annotated[str, typer.Option(metavar="NAME", help="Write a mask instead: shadow, layover or blocked.")] = "",
    threads: Annotated[int, typer.Option(min=1, max=256, help="Threads per radar image.")] = 1,
    number: Annotated[int, typer.Option(help="Image to write of several sensors or dates, from 1.")] = 1,
    as_json: AsJson = False,
) -> None:
    """Simulate one image.

    Settings not given default to the current optimum, or to the centre of the region before the first fit.
    """
    from seqrsm.campaign.images import write_image

    campaign = _opened(folder)
    with display("simulating"):
        result = write_image(campaign.opened, settings or [], out, mask=mask, threads=threads, number=number)
    print_json(result) if as_json else say(f"wrote {out}: {result['summary']}")


app.command()(design)
app.command()(catalog)
app.command()(parameters)


@app.command("help")
@guarded
def help_on(
    words: Annotated[
        list[str] | None, typer.Argument(metavar="[WORDS]", help="A topic, as in `help rankings`.")
    ] = None,
) -> None:
    """Print the guides on a topic, or list topics."""
    from seqrsm.cli.guides import about, show, topics

    if words:
        for topic in about(" ".join(words)):
            show(topic)
    else:
        for topic in topics():
            line(topic.title, 2 * (topic.level - 1))


@app.command()
@guarded
def export(
    folder: Folder,
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A .csv (runs and scores) or .json (everything).")],
) -> None:
    """Export runs and scores, or everything."""
    from seqrsm.campaign.export import export as write_all

    campaign = _opened(folder).opened
    for written in write_all(campaign.store, campaign.spec, file):
        say(f"wrote {written}")


app.command()(schema)
