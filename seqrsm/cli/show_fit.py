"""What was found in the scores, on the terminal: all of it with the summary last, a look in a line, where it stands."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from seqrsm.analysis.compromise import CompromiseEstimate
from seqrsm.analysis.ground import RANKED
from seqrsm.analysis.results import Analysis
from seqrsm.analysis.study import TermTest
from seqrsm.cli.blocks import show_blocks, show_sections
from seqrsm.cli.console import heading, line, say, show_table
from seqrsm.cli.show import known_text
from seqrsm.decide.stopping import interval_names
from seqrsm.plain import counted
from seqrsm.report.blocks import Section
from seqrsm.report.rounding import (
    decimals_for,
    format_against,
    format_number,
    format_plain,
    format_significant,
    width_digits,
)
from seqrsm.report.sections.application import application_sections, method_sections
from seqrsm.report.sections.compromise import compromise_section
from seqrsm.report.sections.measure import measure_section
from seqrsm.report.sections.model import importance_section, term_test_table
from seqrsm.report.sections.summary import FLAT, result_section, summary_section
from seqrsm.report.wording import (
    cost_texts,
    ground_name,
    parts_of_width,
    readable,
    readable_text,
    targets_text,
    told_settings,
    watched_interval,
    with_unit,
)
from seqrsm.spec.read import CampaignSpec
from seqrsm.store.records import WAITING

if TYPE_CHECKING:
    from seqrsm.campaign.campaign import Campaign
    from seqrsm.campaign.loop import Outcome


def show_fit(
    campaign: Campaign,
    analyses: Sequence[Analysis],
    tests: Sequence[Sequence[TermTest]],
    compromise: CompromiseEstimate | None,
) -> None:
    """What `seqrsm fit` says before the summary; ``tests`` are those that were asked for of each analysis."""
    spec, looks = campaign.spec, campaign.looks(analyses)
    for analysis, asked in zip(analyses, tests, strict=True):
        if len(analyses) > 1:
            heading(f"Application {analysis.application}")
        show_sections(method_sections(analysis, ""))
        show_sections(application_sections(spec, looks, analysis, ""))
        if asked:
            line()
            show_blocks([term_test_table(analysis, asked)])
    if compromise is not None:
        show_sections(result_section(spec, one, {}, "", one.application) for one in analyses)
        show_sections([compromise_section(spec.region, compromise)])


def show_outcome(campaign: Campaign, outcome: Outcome) -> None:
    """End of `seqrsm run`: importance, recommendation, intervals, reasons, time split."""
    several = len(outcome.analyses) > 1

    def named(section: Section, analysis: Analysis) -> Section:
        return replace(section, title=f"{section.title}, {analysis.application}") if several else section

    show_sections(named(importance_section(analysis, ""), analysis) for analysis in outcome.analyses)
    runs, spec = campaign.store.runs(), campaign.spec
    if outcome.compromise is not None:
        rests = outcome.rests
        show_sections(result_section(spec, one, rests, "", one.application) for one in outcome.analyses)
    show_sections([summary_section(spec, outcome.analyses, outcome.compromise, runs, outcome.rests)])
    events = campaign.store.events(kind=RANKED)
    measure = ((measure_section(analysis, events, spec.cost, "measure"), analysis) for analysis in outcome.analyses)
    show_sections([named(section, analysis) for section, analysis in measure if section is not None])
    line()
    if not outcome.held:
        used, budget, waiting = campaign.store.n_used(), spec.stop.max_runs, sum(run.state in WAITING for run in runs)
        part = f", {used} of the campaign's {budget} runs," if used < budget else ""
        unscored = f" {counted(waiting, 'issued run has', 'issued runs have')} no score yet." if waiting else ""
        line(f"The budget{part} was spent before the stop rule was met.{unscored}")
    split = ", ".join(f"{stage} {seconds:.1f} s" for stage, seconds in outcome.seconds.items())
    line(f"{outcome.n_scored} runs scored in total; time: {split}")


def show_look(spec: CampaignSpec, analysis: Analysis) -> None:
    """One line per interim analysis, on stderr: score, half-width against its target, conditions not met."""
    decision = analysis.decision
    name = f"{analysis.application}: " if len(spec.applications) > 1 else ""
    words = {"guess": "better than the map" if analysis.known_map else "better than a guess"}
    missing = [words.get(one.name, one.name.replace("_", " ")) for one in decision.checks if one.holds is not True]
    rest = "stop rule met" if decision.held else f"not met: {', '.join(missing)}" if missing else "to be confirmed"
    mean = with_unit(format_significant(analysis.optimum.mean, 3), analysis.score_unit)
    stop = spec.stop_of(analysis.application)
    if stop.loss is not None:
        loss = format_against(analysis.posterior.expected_regret, stop.loss, 2)
        rest = f"loss {loss} (target {stop.loss:g})  {rest}"
    say(
        f"{name}{analysis.fit.n_runs:4d} runs  {mean}  "
        f"\u00b1 {format_against(decision.half_width, stop.half_width, 3)} "
        f"(target {stop.half_width:g}{parts_of_width(analysis)})  {rest}"
    )


def show_status(spec: CampaignSpec, result: Mapping[str, Any]) -> None:
    """Where the campaign stands."""
    states = ", ".join(f"{count} {state}" for state, count in result["runs"].items()) or "none yet"
    unit, target, loss = spec.cost.told_unit, targets_text(spec, "half_width"), targets_text(spec, "loss")
    spent = f"; cost spent {''.join(cost_texts(result, unit))}" if unit else ""
    rows = [
        ["runs", states],
        ["budget", f"{result['max_runs']} runs{spent}"],
        ["target", f"{100 * result['level']:g} % {watched_interval(spec.stop)}, \u00b1 {target}"],
    ]
    if loss:
        rows.append(["", f"expected loss, at most {loss}"])
    if result["simulated_by"]:
        scenes = (f"{counted(one['runs'], 'run')} ({ground_name(one['averaged'])})" for one in result["simulated_by"])
        rows.append(["simulated", ", ".join(scenes)])
    show_table((), rows, title=f"campaign {result['campaign']}", sides=("left",))
    for application in result["applications"]:
        _show_application(spec, result, application)
    for run in result["failed"]:
        line(f"run {run['run_id']} failed: {run['reason']}")
    if "history" in result:
        heading("History")
    for event in result.get("history", ()):
        run_id = "" if event["run_id"] is None else f" run {event['run_id']}"
        stamp = f"{str(event['at'])[:19].replace('T', ' ')} {event['version']} seed {event['seed']}"
        told = (event["detail"] or {}).items()
        detail = _detail_text({name: value for name, value in told if not name.endswith("_digest")})
        line(f"{stamp}  {event['kind']}{run_id}" + (f": {detail}" if detail else ""))


def _detail_text(value: object) -> str:
    """What an event keeps, in a line: of tables in a list their number, which ``--json`` has in full."""
    if isinstance(value, Mapping):
        return ", ".join(f"{readable(str(name))} {_detail_text(one)}" for name, one in value.items())
    if isinstance(value, list):
        if any(isinstance(one, list | Mapping) for one in value):
            return f"({len(value)}; in --json)"
        return " ".join(map(_detail_text, value))
    return f"{value:.12g}" if isinstance(value, float) else str(value)


def _show_application(spec: CampaignSpec, result: Mapping[str, Any], application: Mapping[str, Any]) -> None:
    look = application["last_look"]
    if look is None:
        heading(application["name"])
        earlier = "; those of other applications may be scored for it, too" if result["runs"].get("scored") else ""
        line(application.get("reason") or f"no scored run yet{earlier}", 2)
        return
    best, unit = look["optimum"], application["unit"]
    target, limit = application["target_half_width"], application["target_loss"]
    known = look.get("settings_spread", {}).items()
    spreads = {name: math.nan if spread is None else spread for name, spread in known}
    told = told_settings(spec.region, best["settings"], spreads)
    rows = [[readable(f.name), with_unit(told[f.name], f.unit)] for f in spec.factors]
    show_table((), rows, title=f"{application['name']}: optimum after {look['n_runs']} runs", sides=("left",))
    half = best["confidence"]["half_width"]  # which decides the digits, as in the report
    mean = format_number(best["mean"], decimals_for(0.5 * half)) if half else known_text(best["mean"])
    line(f"mean score {with_unit(mean, unit)}")
    replicates = best.get("prediction_mean", {}).get("replicates", spec.stop.replicates)
    one_ground = best.get("ground") is not None and spec.stop.worlds == "count" and result["interval"] == "confidence"
    for kind, words in interval_names(replicates, one_ground).items():
        if kind in best:
            watched = kind == result["interval"]  # as the report: three digits of what is held against the target
            width = look["half_width"] if watched else best[kind]["half_width"]
            digits = 3 if watched or width is None else width_digits(width)
            wide = "none yet" if width is None else f"\u00b1 {with_unit(known_text(width, digits, target), unit)}"
            line(f"{words}: {wide}" + f", target \u00b1 {with_unit(format_plain(target), unit)}" * watched, 2)
    if limit is not None:
        loss = with_unit(known_text(look["expected_loss"], 2, limit), unit)
        line(f"expected loss: {loss}, target at most {with_unit(format_plain(limit), unit)}", 2)
    for text in application["warnings"]:
        if not text.startswith(FLAT):  # which is among the reasons
            line(f"Warning: {readable_text(text, spec.region.names)}")
    heading(f"Decision: {look.get('decision', 'Stop' if look['held'] else 'Continue').lower()}")
    for reason in look["reasons"]:
        line(f"- {reason}", 2)
