"""Results as tables for a terminal of 80 columns; plain text when piped."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from seqrsm.cli.console import heading, line, number, say, show_table
from seqrsm.design.factors import setting_with_unit, settings_text

if TYPE_CHECKING:
    from seqrsm.analysis.results import Analysis
    from seqrsm.campaign.check import CheckResult
    from seqrsm.campaign.ingest import IngestReport
    from seqrsm.campaign.loop import Outcome
    from seqrsm.design.factors import Factor
    from seqrsm.scene.scene import Scene
    from seqrsm.spec.read import CampaignSpec
    from seqrsm.store.records import RunRecord


# -- run ----------------------------------------------------------------------------------------------------------


def show_look(spec: CampaignSpec, analysis: Analysis) -> None:
    """One line a look, on stderr: score, half-width against its target, and what is still missing."""
    decision = analysis.decision
    name = f"{analysis.application}: " if len(spec.applications) > 1 else ""
    missing = [check.name.replace("_", " ") for check in decision.checks if check.holds is not True]
    rest = (
        "the stop rule holds" if decision.held else f"missing: {', '.join(missing)}" if missing else "to be confirmed"
    )
    mean = f"{number(analysis.optimum.mean, 3)} {analysis.score_unit}".rstrip()
    say(
        f"{name}{analysis.fit.n_runs:4d} runs  {mean}  \u00b1 {number(decision.half_width, 3)} "
        f"(target {spec.stop.half_width:g})  {rest}"
    )


def show_outcome(outcome: Outcome) -> None:
    """End of `seqrsm run`: recommendation, intervals, reasons, time split."""
    from seqrsm.cli.show_fit import decision_heading, show_importance, show_optimum, show_warnings

    for analysis in outcome.analyses:
        show_optimum(analysis)
        show_importance(analysis)
        ended = "Decision: stop for futility" if outcome.futile else "Decision: the budget ended the campaign"
        heading(decision_heading(analysis) if outcome.held else ended)
        for reason in analysis.decision.reasons:
            line(f"- {reason}", 2)
        if analysis.confirmation is not None and analysis.confirmation.agrees:  # else the reasons say it
            line(f"- {analysis.confirmation.text}", 2)
        show_warnings(analysis.warnings)
    split = ", ".join(f"{stage} {seconds:.1f} s" for stage, seconds in outcome.seconds.items())
    line()
    line(f"{outcome.n_scored} runs scored in all; time: {split}")


# -- check, status, runs ------------------------------------------------------------------------------------------


def show_check(result: CheckResult, verbose: bool) -> None:
    """What a campaign will take."""
    rows = [
        ["factors", str(result.n_factors)],
        ["terms of the model", str(result.n_terms)],
        ["start design", f"{result.start_runs} runs"],
        ["fewest runs to stop", f"{result.min_runs}"],
        ["budget", f"{result.max_runs} runs, cost {result.cost:g}"],
    ]
    if result.seconds_per_run == result.seconds_per_run:
        total = result.seconds_per_run * result.max_runs
        rows.append(["one simulated run here", f"{number(result.seconds_per_run, 2)} s; the budget {_duration(total)}"])
    known = result.noise == result.noise
    rows.append(["standard deviation of a run", number(result.noise, 3) if known else result.noise_source])
    if known:
        rows.append(["  found from", result.noise_source])
    show_table(["", ""], rows, title=f"campaign {result.name}", left=True)
    if result.combinations:
        heading("What some settings do")
        for combination in result.combinations:
            line(f"- {combination}")
    if result.notes:
        from seqrsm.campaign.assumptions import summarise_notes

        more = "" if verbose else "; all of them with -v or --json"
        heading(f"What the simulation rests on ({len(result.notes)} statements{more})")
        for note in result.notes if verbose else summarise_notes(result.notes, result.covers):
            line(f"- {note}")
    line()
    if result.target_problem:
        line(f"Warning: {result.target_problem}")
    line("All is in order.")


def _duration(seconds: float) -> str:
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 5400.0 else f"{seconds / 3600.0:.1f} h"


_INTERVALS = {
    "prediction": "prediction interval of one future run",
    "prediction_mean": "prediction interval of the mean of several runs",
    "confidence": "confidence interval of the mean",
}


def show_status(factors: Sequence[Factor], result: Mapping[str, Any]) -> None:
    """Where the campaign stands."""
    states = ", ".join(f"{count} {state}" for state, count in result["runs"].items()) or "none yet"
    rows = [
        ["runs", states],
        ["budget", f"{result['max_runs']} runs; cost spent {result['cost_spent']:g}"],
        [
            "target",
            f"{_INTERVALS[result['interval']]}, \u00b1 {result['target_half_width']:g} at {100 * result['level']:g} %",
        ],
    ]
    if result["simulated_by"] is not None:
        rows.append(["simulated by", _simulated_by(result["simulated_by"])])
    if (shared := result["common_random_numbers"])["runs"]:
        text = f"shared by {shared['runs']} runs, in {shared['occasions']} occasions that are blocks of the fit"
        rows.append(["random numbers", text])
    show_table(["", ""], rows, title=f"campaign {result['campaign']}", left=True)
    for application in result["applications"]:
        _show_application(factors, result, application)
    for run in result["failed"]:
        line(f"run {run['run_id']} failed: {run['reason']}")
    if "history" in result:
        heading("History")
    for event in result.get("history", ()):
        run_id = "" if event["run_id"] is None else f" run {event['run_id']}"
        stamp = f"{str(event['at'])[:19].replace('T', ' ')} {event['version']} seed {event['seed']}"
        detail = ", ".join(f"{name} {value}" for name, value in (event["detail"] or {}).items())
        line(f"{stamp}  {event['kind']}{run_id}" + (f": {detail}" if detail else ""))


def _simulated_by(found: Mapping[str, Any]) -> str:
    """Runs of each rung with the largest bound, and the checks."""
    parts = [
        f"{rung} {own['runs']}" + (f" (error at most {own['bound']:.2g})" if own["bound"] > 0.0 else "")
        for rung, own in found["rungs"].items()
    ]
    checks = f"{found['checks']} checked, {found['violations'] or 'no'} bound violated"
    return f"{', '.join(parts)}; {checks}"


def _show_application(factors: Sequence[Factor], result: Mapping[str, Any], application: Mapping[str, Any]) -> None:
    look = application["last_look"]
    if look is None:
        heading(application["name"])
        line(application.get("reason") or "no scored run yet", 2)
        return
    best, unit = look["optimum"], application["unit"]
    rows = [[factor.name, setting_with_unit(factor, best["settings"][factor.name])] for factor in factors]
    show_table(["", ""], rows, title=f"{application['name']}: optimum after {look['n_runs']} runs", left=True)
    line(f"mean score {_known(best['mean'])} {unit}".rstrip())
    for kind in ("prediction", "prediction_mean", "confidence"):
        if kind in best:
            watched = f", target \u00b1 {result['target_half_width']:g}" if kind == result["interval"] else ""
            line(f"{_INTERVALS[kind]}: \u00b1 {_known(best[kind]['half_width'])}{watched}", 2)
    heading("Decision: stop" if look["held"] else "Decision: go on")
    for reason in look["reasons"]:
        line(f"- {reason}", 2)


def show_overview(found: Sequence[Mapping[str, Any]]) -> None:
    """A line for every application of several campaigns."""
    rows = []
    for one in found:
        if "error" in one:
            continue
        states, target = one["runs"], f"\u00b1 {one['target_half_width']:g}"
        waiting = sum(states.get(state, 0) for state in ("proposed", "issued", "running"))
        counts = [str(states.get("scored", 0)), str(waiting), str(states.get("failed", 0))]
        for application in one["applications"]:
            look = application["last_look"]
            unit = application["unit"]
            mean = "-" if look is None else f"{_known(look['optimum']['mean'])} {unit}".rstrip()
            width = "-" if look is None else f"\u00b1 {_known(look['half_width'])}"
            decision = "-" if look is None else "stop" if look["held"] else "go on"
            rows.append([one["folder"], *counts, application["name"], mean, width, target, decision])
    heads = ["campaign", "scored", "waiting", "failed", "application", "optimum", "half-width", "target", "decision"]
    if rows:
        show_table(heads, rows, right=1)
    for one in found:
        if "error" in one:
            line(f"{one['folder']}: {one['error']}")


def _known(value: float | None) -> str:
    return "-" if value is None else number(value, 3)


def show_templates(found: Mapping[str, str]) -> None:
    """Templates of `seqrsm init`."""
    show_table(["template", "question"], [[name, text] for name, text in found.items()], left=True)


def run_row(run: RunRecord) -> dict[str, Any]:
    """A run as JSON."""
    return {
        "run_id": run.run_id,
        "batch": run.batch,
        "state": run.state,
        "source": run.source,
        "purpose": run.purpose,
        "why": run.why,
        "settings": run.settings,
        "scores": {score.application: {"score": score.score, "se": score.se} for score in run.scores},
        "reason": run.reason,
    }


def show_proposals(spec: CampaignSpec, runs: Sequence[RunRecord]) -> None:
    """Issued runs with the reason for each."""
    for run in runs:
        line(f"run {run.run_id}: {settings_text(spec.factors, run.proposed)}")
        line(f"{run.purpose}: {run.why}", 6)


def show_runs(spec: CampaignSpec, runs: Sequence[RunRecord]) -> None:
    """Runs that were carried out."""
    for run in runs:
        found = ", ".join(f"{score.application} {number(score.score)}" for score in run.scores) or run.reason
        line(f"run {run.run_id}: {run.state}, {found} ({settings_text(spec.factors, run.settings)})")
    line(f"{len(runs)} {'run' if len(runs) == 1 else 'runs'} carried out")


def show_ingest(report: IngestReport) -> None:
    """What became of a file of scores."""
    if report.already is None:
        parts = [
            f"{len(ids)} {what}"
            for ids, what in (
                (report.matched, "proposed runs now scored"),
                (report.created, "new runs"),
                (report.unchanged, "runs that had these scores already"),
            )
            if ids
        ]
        would = "would be taken in" if report.dry_run else "taken in"
        what = "ranks" if report.ranked or report.rankings else "scores"
        if report.rankings:
            parts.append(f"rankings {report.rankings[0]} to {report.rankings[-1]}")
        line(f"{report.file}: {report.n_scores} {what} {would}: {', '.join(parts) or 'nothing new'}")
    for message in report.messages:
        line(f"{report.file}: {message}")
    for summary in report.ranked:
        show_table(
            ["interpreter", "rankings", "sharpness", "95 %", "agreement"],
            [
                [
                    one.interpreter,
                    str(one.rankings),
                    number(one.sharpness, 2),
                    f"{number(one.low, 2)} to {number(one.high, 2)}",
                    "-" if one.agreement is None else f"{one.agreement:.2f}",
                ]
                for one in summary.interpreters
            ],
            title=f"interpreters of {summary.application}",
        )


# -- the rest -----------------------------------------------------------------------------------------------------


def show_rehearsal(result: Mapping[str, Any]) -> None:
    """Operating characteristics of the stop rule."""
    rows = [[label, text] for label, text in result["rows"]]
    show_table(["", ""], rows, title=f"{result['campaigns']} rehearsed campaigns", left=True)
    for note in result["notes"]:
        line(note)


def show_scene(scene: Scene, statistics: Mapping[str, Any]) -> None:
    """What a data base holds."""
    line(f"{scene.name}: {scene.elevation_m.shape[0]} x {scene.elevation_m.shape[1]} cells of {scene.cell_m:g} m")
    line(f"licence: {scene.licence}")
    for name, value in statistics.items():
        if name == "category_fractions":
            rows = [[category, f"{100 * share:.2f} %"] for category, share in value.items()]
            show_table(["category", "share"], rows)
        elif isinstance(value, float):
            line(f"{name}: {number(value)}")
        elif isinstance(value, int | str):
            line(f"{name}: {value}")
    if scene.temperature_k is not None:
        known = scene.temperature_k[scene.valid()]
        line(f"temperature of the ground: {known.min():.1f} to {known.max():.1f} K")
    if scene.soil_moisture is not None:
        known = scene.soil_moisture[scene.valid()]
        line(f"moisture of the soil: {known.min():.3f} to {known.max():.3f} m3/m3")


def show_design(result: Mapping[str, Any]) -> None:
    """A stand-alone design and its quality."""
    plots = result.get("block") or result.get("plot")
    head = "block" if result.get("block") else "plot"
    rows = []
    for i, settings in enumerate(result["settings"]):
        cells = [value if isinstance(value, str) else f"{round(value, 4) + 0.0:.5g}" for value in settings.values()]
        rows.append([str(i + 1), *([str(plots[i])] if plots else []), *cells])
    show_table(["run", *([head] if plots else []), *result["names"]], rows)
    if result["prior_runs"]:
        line(f"together with {result['prior_runs']} runs made before:")
    for name, value in result.items():
        if isinstance(value, float):
            line(f"{name}: {value:.6g}")
    if "resolution" in result:
        line(f"resolution {result['resolution']}; {result['defining_relation']}")
    curve = result["fraction_of_design_space"]
    if curve[0] is not None:
        shares = ", ".join(f"{curve[at]:.4g} in {at} %" for at in (50, 90, 100))
        line(f"scaled prediction variance is at most {shares} of the region")
    line(f"{result['n_distinct']} distinct settings, {result['df_pure_error']} degrees of freedom of pure error")
    for warning in result.get("warnings", ()):
        line(f"Warning: {warning}")


def show_doctor(result: Mapping[str, Any]) -> None:
    """State of the environment."""
    line(f"seqrsm {result['seqrsm']}, Python {result['python']}, {result['system']}, {result['cpus']} processors")
    line(", ".join(f"{name} {version or 'MISSING'}" for name, version in result["packages"].items()))
    for name, version in result["extras"].items():
        line(f"{name}: {version}")
    times = ", ".join(f"{name} {seconds:.1f} s" for name, seconds in result["warm_up_s"].items())
    line(f"kernels are compiled in {result['kernel_cache']}: {times}")


def show_parameters(rows: Sequence[Mapping[str, Any]]) -> None:
    """Parameters of a sensor, one statement each."""
    for head, chosen in (
        ("Must be given, as factor or fixed", [row for row in rows if row["required"]]),
        ("May be left out", [row for row in rows if not row["required"]]),
    ):
        heading(head)
        for row in chosen:
            default = "" if row["default"] in (None, "") else f"; {row['default']} by default"
            never = "" if row["factor"] else "; cannot be a factor"
            line(f"- {row['name']}: {row['what']}; {row['allowed']}{default}{never}")


def show_catalog(words: str) -> None:
    """What the literature asks for: a summary, then the entries as printed."""
    from seqrsm.catalog import catalog_rows, load_catalog, search, summary

    if not words:
        _columns_and_rows(catalog_rows(load_catalog()), "Tables of RSL TR 380-1, Appendix A")
        return
    found = search(words)
    if not found:
        line(f"Nothing in Tables A.1 to A.20 names {words}. `seqrsm catalog` lists the tables.")
        return
    columns, rows = catalog_rows(summary(found))
    kept = [i for i, name in enumerate(columns) if name != "applications"]
    narrow = [columns[i] for i in kept], [[row[i] for i in kept] for row in rows]
    _columns_and_rows(narrow, f"What is asked for: {words}")
    heading("Entries, as printed")
    names, entries = catalog_rows(found)
    for entry in entries:
        cells = dict(zip(names, entry, strict=True))
        head = f"{cells.pop('table', '')} {cells.pop('category', '')}: {cells.pop('application', '')}"
        line(head, 2)
        line("; ".join(f"{name} {cell}" for name, cell in cells.items() if cell), 6)


def _columns_and_rows(rendered: tuple[Sequence[str], Sequence[Sequence[str]]], title: str) -> None:
    columns, rows = rendered
    if rows:
        show_table(columns, rows, title=title, left=True)
