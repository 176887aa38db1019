"""Results as tables for a terminal of 80 columns; plain text when piped."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from seqrsm.cli.console import number, say, stdout, table

if TYPE_CHECKING:
    from seqrsm.campaign.analysis import Analysis, Interval
    from seqrsm.campaign.check import CheckResult
    from seqrsm.campaign.ingest import IngestReport
    from seqrsm.campaign.loop import Outcome
    from seqrsm.campaign.records import RunRecord
    from seqrsm.campaign.spec import CampaignSpec
    from seqrsm.scene.scene import Scene


def _line(text: str = "") -> None:
    stdout().print(text, markup=False)


def setting_text(value: float | str) -> str:
    """A level as people write it."""
    return value if isinstance(value, str) else f"{value:.4g}"


def settings_text(settings: Mapping[str, float | str], units: Mapping[str, str]) -> str:
    """Settings in one line, with units."""
    return ", ".join(f"{name} {setting_text(value)} {units.get(name, '')}".rstrip() for name, value in settings.items())


def _units(factors: Sequence[Any]) -> dict[str, str]:
    return {factor.name: getattr(factor, "unit", "") for factor in factors}


# -- run ----------------------------------------------------------------------------------------------------------


def show_look(analysis: Analysis) -> None:
    """One line a look, on stderr."""
    decision, best = analysis.decision, analysis.optimum
    say(
        f"{analysis.application}: {analysis.fit.n_runs:3d} runs, optimum {number(best.mean, 3)} {analysis.score_unit} "
        f"± {number(decision.half_width, 3)} at {settings_text(best.settings, _units(analysis.region.factors))}"
    )


def show_outcome(outcome: Outcome) -> None:
    """End of `seqrsm run`: recommendation, intervals, reasons, time split."""
    for analysis in outcome.analyses:
        _show_optimum(analysis)
        _show_importance(analysis)
        _line("Stop" if outcome.held else "The budget ended the campaign")
        for reason in analysis.decision.reasons:
            _line(f"  - {reason}")
        if analysis.confirmation is not None:
            _line(f"  - {analysis.confirmation.text}")
        _show_warnings(analysis.warnings)
    split = ", ".join(f"{stage} {seconds:.1f} s" for stage, seconds in outcome.seconds.items())
    _line(f"{outcome.n_scored} runs scored in all; time: {split}")


def _show_optimum(analysis: Analysis) -> None:
    best, unit = analysis.optimum, analysis.score_unit
    units = _units(analysis.region.factors)
    posterior = {row.factor: row for row in analysis.posterior.settings}
    rows = []
    for name, value in best.settings.items():
        row = posterior[name]
        if row.probabilities:
            spread = ", ".join(f"{level} {share:.0%}" for level, share in row.probabilities.items() if share >= 0.005)
            rows.append([name, setting_text(value), "", spread])
        else:
            bound = f"{row.p_at_bound:.0%} at a bound" if row.p_at_bound >= 0.005 else ""
            low_high = f"{setting_text(row.low)} to {setting_text(row.high)}"
            rows.append([name, f"{setting_text(value)} {units[name]}".rstrip(), low_high, bound])
    level = f"{best.level:.0%}"
    stdout().print(
        table(
            ["factor", "recommended", f"{level} credible", "posterior"],
            rows,
            title=f"Optimum of {analysis.application}",
        )
    )

    def shown(interval: Interval) -> str:
        return f"{number(interval.low, 4)} to {number(interval.high, 4)} (± {number(interval.half_width, 3)})"

    _line(f"Utility there: {number(best.mean, 4)} {unit}".rstrip())
    _line(f"  {level} prediction interval of one future run: {shown(best.prediction)}")
    _line(f"  {level} prediction interval of the mean of {best.replicates} runs: {shown(best.prediction_mean)}")
    _line(f"  {level} confidence interval of the mean: {shown(best.confidence)}")
    if best.at_bound:
        _line(f"  at the border of the region: {', '.join(best.at_bound)}")
    regret = analysis.posterior
    _line(
        f"  expected loss against the unknown true optimum: {number(regret.expected_regret, 2)} {unit}; "
        f"more than {number(regret.regret_epsilon, 2)} with probability {regret.p_regret_above:.0%}"
    )


def _show_importance(analysis: Analysis) -> None:
    rows = [[row.factor, str(row.df), number(row.f, 4), number(row.p, 2)] for row in analysis.importance]
    stdout().print(table(["factor", "df", "partial F", "p"], rows, title="Importance of the sensor parameters"))


def _show_warnings(warnings: Sequence[str]) -> None:
    for warning in warnings:
        _line(f"Warning: {warning}")


# -- fit ----------------------------------------------------------------------------------------------------------


def show_fit(analysis: Analysis) -> None:
    """Everything `seqrsm fit` has to say."""
    fit = analysis.fit
    interval = fit.interval(analysis.optimum.level)
    level = f"{analysis.optimum.level:.0%}"
    rows = [
        [name, number(fit.estimate[i]), number(fit.se[i], 3), number(fit.t[i], 3), number(fit.p_value[i], 2),
         f"{number(interval.low[i], 3)} to {number(interval.high[i], 3)}"]
        for i, name in enumerate(fit.names)
    ]  # fmt: skip
    title = f"Coefficients of {analysis.application}, coded units" + (
        ", logit scale" if analysis.response == "logit" else ""
    )
    stdout().print(table(["term", "estimate", "se", "t", "p", f"{level} confidence"], rows, title=title))
    _line(
        f"{fit.n_runs} runs, {fit.n_terms} terms, s = {number(fit.s)} on {fit.df_residual} df, "
        f"R2 = {number(fit.r2, 3)}, adjusted {number(fit.r2_adjusted, 3)}, predicted {number(fit.r2_predicted, 3)}"
    )
    rows = [
        [row.source, str(row.df), number(row.ss), number(row.ms), number(row.f, 3), number(row.p, 2)]
        for row in analysis.anova
    ]
    stdout().print(table(["source", "df", "SS", "MS", "F", "p"], rows, title="Analysis of variance"))
    if isinstance(analysis.lack_of_fit, str):
        _line(f"Lack of fit: {analysis.lack_of_fit}")
    _show_importance(analysis)
    if analysis.stationary is not None:
        point = analysis.stationary
        values = ", ".join(number(float(x), 3) for x in point.eigenvalues)
        where = "inside" if point.inside_region else "outside"
        _line(f"Stationary point: {point.kind}, {where} the region, eigenvalues {values}")
        if point.warning:
            _line(f"  {point.warning}")
    _show_optimum(analysis)
    sampler = analysis.posterior.sampler
    if sampler["method"] == "emcee":
        _line(
            f"Posterior by emcee: {sampler['steps']} steps, tau {number(float(sampler['tau']), 3)}, "
            f"least ESS {float(sampler['ess']):.0f}, R-hat {number(float(sampler['r_hat']), 5)}"
        )
    _show_decision(analysis)
    _show_warnings(analysis.warnings)


def _show_decision(analysis: Analysis) -> None:
    _line("Stop" if analysis.decision.held else "Go on")
    for check in analysis.decision.checks:
        mark = {True: "holds", False: "not yet", None: "unknown"}[check.holds]
        _line(f"  [{mark}] {check.text}")
    for text in analysis.decision.futility:
        _line(f"  {text}")
    if analysis.confirmation is not None:
        _line(f"  {analysis.confirmation.text}")


# -- check, status, runs ------------------------------------------------------------------------------------------


def show_check(result: CheckResult) -> None:
    """What a campaign will take."""
    rows = [
        ["factors, terms of the model", f"{result.n_factors}, {result.n_terms}"],
        ["start design", f"{result.start_runs} runs"],
        ["fewest runs to stop", f"{result.min_runs}"],
        ["budget", f"{result.max_runs} runs, cost {number(result.cost, 6)}"],
        ["one simulated run here", f"{number(result.seconds_per_run, 2)} s"],
        ["standard deviation of a run", f"{number(result.noise, 3)} ({result.noise_source})"],
    ]
    stdout().print(table([f"campaign {result.name}", ""], rows))
    for note in result.notes:
        _line(f"assumed: {note}")
    if result.target_problem:
        _line(f"Warning: {result.target_problem}")
    _line("All is in order.")


def show_status(result: Mapping[str, Any]) -> None:
    """Where the campaign stands."""
    states = ", ".join(f"{count} {state}" for state, count in result["runs"].items()) or "no run yet"
    _line(f"campaign {result['campaign']}: {states}; budget {result['max_runs']}; cost spent {result['cost_spent']:g}")
    for application in result["applications"]:
        look = application["last_look"]
        if look is None:
            _line(f"{application['name']}: no look yet")
            continue
        best = look["optimum"]
        settings = ", ".join(f"{name} {setting_text(value)}" for name, value in best["settings"].items())
        _line(f"{application['name']}: optimum {_known(best['mean'])} {application['unit']} at {settings}")
        for kind in ("prediction", "confidence"):
            _line(f"  {kind} interval ± {_known(best[kind]['half_width'])}")
        _line(f"  target: {result['interval']} ± {result['target_half_width']:g} at {result['level']:.0%}")
        _line("  stop" if look["held"] else "  go on")
        for reason in look["reasons"]:
            _line(f"  - {reason}")
    for run in result["failed"]:
        _line(f"run {run['run_id']} failed: {run['reason']}")
    for event in result.get("history", ()):
        run_id = "" if event["run_id"] is None else f" run {event['run_id']}"
        stamp = f"{event['at']} {event['version']} seed {event['seed']}"
        _line(f"{stamp} {event['kind']}{run_id} {event['detail'] or ''}".rstrip())


def _known(value: float | None) -> str:
    return "-" if value is None else number(value, 4)


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
    units = _units(spec.factors)
    for run in runs:
        _line(f"run {run.run_id:4d}  {settings_text(run.proposed, units)}")
        _line(f"          {run.purpose}: {run.why}")


def show_runs(spec: CampaignSpec, runs: Sequence[RunRecord]) -> None:
    """Runs that were carried out."""
    units = _units(spec.factors)
    for run in runs:
        found = ", ".join(f"{score.application} {number(score.score)}" for score in run.scores) or run.reason
        _line(f"run {run.run_id:4d}  {run.state}: {found}  ({settings_text(run.settings, units)})")
    _line(f"{len(runs)} runs carried out")


def show_ingest(report: IngestReport) -> None:
    """What became of a file of scores."""
    for message in report.messages:
        _line(f"{report.file}: {message}")


# -- the rest -----------------------------------------------------------------------------------------------------


def show_rehearsal(result: Mapping[str, Any]) -> None:
    """Operating characteristics of the stop rule."""
    rows = [[label, text] for label, text in result["rows"]]
    stdout().print(table([f"{result['campaigns']} rehearsed campaigns", ""], rows))
    for note in result["notes"]:
        _line(note)


def show_scene(scene: Scene, statistics: Mapping[str, Any]) -> None:
    """What a data base holds."""
    _line(f"{scene.name}: {scene.elevation_m.shape[0]} x {scene.elevation_m.shape[1]} cells of {scene.cell_m:g} m")
    _line(f"licence: {scene.licence}")
    for name, value in statistics.items():
        if name == "category_fractions":
            rows = [[category, f"{100 * share:.2f} %"] for category, share in value.items()]
            stdout().print(table(["category", "share"], rows))
        elif isinstance(value, float):
            _line(f"{name}: {number(value)}")
        elif isinstance(value, int | str):
            _line(f"{name}: {value}")


def show_design(result: Mapping[str, Any]) -> None:
    """A stand-alone design and its quality."""
    k = result["factors"]
    rows = [[str(i + 1), *(f"{x:+.4f}" for x in row)] for i, row in enumerate(result["points"])]
    stdout().print(table(["run", *(f"x{i + 1}" for i in range(k))], rows))
    for name, value in result.items():
        if isinstance(value, float):
            _line(f"{name}: {value:.6g}")
    for warning in result.get("warnings", ()):
        _line(f"Warning: {warning}")


def show_doctor(result: Mapping[str, Any]) -> None:
    """State of the environment."""
    _line(f"seqrsm {result['seqrsm']}, Python {result['python']}, {result['system']}, {result['cpus']} processors")
    _line(", ".join(f"{name} {version or 'MISSING'}" for name, version in result["packages"].items()))
    for name, version in result["extras"].items():
        _line(f"{name}: {version}")
    times = ", ".join(f"{name} {seconds:.1f} s" for name, seconds in result["warm_up_s"].items())
    _line(f"kernels are compiled in {result['kernel_cache']}: {times}")


def show_catalog(words: str) -> None:
    """What the literature asks for: a summary, then the entries as printed."""
    from seqrsm.catalog import catalog_rows, load_catalog, search, summary

    if not words:
        _columns_and_rows(catalog_rows(load_catalog()), "Tables of RSL TR 380-1, Appendix A")
        return
    found = search(words)
    if not found:
        _line(f"Nothing in Tables A.1 to A.20 names {words}. `seqrsm catalog` lists the tables.")
        return
    columns, rows = catalog_rows(summary(found))
    kept = [i for i, name in enumerate(columns) if name != "applications"]
    narrow = [columns[i] for i in kept], [[row[i] for i in kept] for row in rows]
    _columns_and_rows(narrow, f"What is asked for: {words}")
    _line("Entries, as printed")
    names, entries = catalog_rows(found)
    for entry in entries:
        cells = dict(zip(names, entry, strict=True))
        head = f"{cells.pop('table', '')} {cells.pop('category', '')}: {cells.pop('application', '')}"
        _line(f"  {head}")
        _line("      " + "; ".join(f"{name} {cell}" for name, cell in cells.items() if cell))


def _columns_and_rows(rendered: tuple[Sequence[str], Sequence[Sequence[str]]], title: str) -> None:
    columns, rows = rendered
    if rows:
        stdout().print(table(columns, rows, title=title, left=True))
