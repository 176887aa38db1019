"""The fidelity planner's decisions and the measured trade-off as tables for a terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from seqrsm.cli.console import line, show_table
from seqrsm.design.factors import Factor, settings_text

_VERDICTS = {"exact": "proven exact", "bounded": "within tolerance", "needed": "needed"}


def show_plan(factors: Sequence[Factor], plan: Mapping[str, Any]) -> None:
    """Which model of a run is used, what every other would cost in accuracy, and the verdict on each effect."""
    line(settings_text(factors, plan["settings"]))
    line(plan["why"])
    rows = [
        [
            rung["rung"] + (" *" if rung["rung"] == plan["rung"] else ""),
            rung["meaning"],
            "-" if rung["refused"] else bound_text(rung["bound"]),
            "-" if rung["refused"] else f"{1000.0 * rung['effort']:.0f} ms",
            rung["refused"] or ", ".join(rung["left_out"]) or "nothing left out",
        ]
        for rung in plan["rungs"]
    ]
    show_table(["rung", "what is made", "error at most", "about", "left out, or why not"], rows, left=True)
    if plan["effects"]:
        effects = [
            [effect["name"], _VERDICTS[effect["verdict"]], bound_text(effect["bound"]), effect["text"]]
            for effect in plan["effects"]
        ]
        show_table(["effect", "leaving it out", "changes the score by", "test"], effects, left=True)


def bound_text(bound: float | None) -> str:
    """A bound in score units; None is none."""
    return "unknown" if bound is None else f"{bound:.2g}"


def show_tradeoff(result: Mapping[str, Any]) -> None:
    """Every rung against the full simulation, then draws, precision and searches."""
    simulation = result["simulation"]
    if simulation is None:
        line(result["why"])
    else:
        for application, rows in simulation["applications"].items():
            title = f"{application}: against the full simulation (F4), tolerance {simulation['tolerance']:g}"
            columns = ["model", "time", "of F4", "bias", "rms", "largest", "bound", "rank", "lost"]
            show_table(columns, [_tradeoff_row(row) for row in rows], title=title)
        for rung, reason in simulation["refused"].items():
            line(f"{rung} cannot be used: {reason}")
        for reason in simulation["failures"]:
            line(f"A configuration could not be simulated: {reason}")
        line("time: median CPU time of a run; bias, rms, largest: error of the score on the same occasions, with the")
        line("Monte Carlo error of the bias; rank: rank correlation over configurations; lost: utility lost by taking")
        line("the best configuration by that model")
    _show_numerics(result["numerics"])


def _tradeoff_row(row: Mapping[str, Any]) -> list[str]:
    rank = row["rank_correlation"]
    return [
        row["rung"],
        f"{1000.0 * row['seconds']:.3g} ms",
        f"{100.0 * row['time_ratio']:.3g} %",
        f"{row['bias']:+.2f} ({row['bias_se']:.2f})",
        f"{row['rms_error']:.2f}",
        f"{row['largest_error']:.2f}",
        bound_text(row["bound"]),
        "-" if rank is None else f"{rank:.2f}",
        f"{row['utility_lost']:.2f} ({row['utility_lost_se']:.2f})",
    ]


def _show_numerics(numerics: Mapping[str, Any]) -> None:
    sampler = numerics.get("sampler", {})
    if "why" in sampler:
        line(f"Sampler: {sampler['why']}")
    else:
        for application, found in sampler.items():
            rows = [
                [
                    row["method"],
                    row["quantity"],
                    str(row["draws"]),
                    f"{row['error_low']:.3g}, {row['error_high']:.3g}",
                    f"{row['seconds']:.3g} s",
                ]
                for row in found
            ]
            columns = ["method", "interval of", "draws", "error of its ends", "time"]
            show_table(columns, rows, title=f"{application}: draws of the posterior", left=True)
    precision = numerics.get("precision", [])
    if precision and "why" not in precision:
        rows = [
            [
                f"{row['score32']:.4f}",
                f"{row['score64']:.4f}",
                f"{row['median_difference']:.1e}",
                f"{1000.0 * row['seconds32']:.3g} ms",
                f"{1000.0 * row['seconds64']:.3g} ms",
            ]
            for row in precision
        ]
        columns = ["score, single", "double", "median pixel difference", "time, single", "double"]
        show_table(columns, rows, title="Single against double precision")
    if numerics.get("design_search"):
        rows = [
            [
                str(row["restarts"]),
                f"{row['efficiency']:.4f}",
                f"{row['least_efficiency']:.4f}",
                f"{row['seconds']:.3g} s",
            ]
            for row in numerics["design_search"]
        ]
        show_table(["restarts", "efficiency, median", "least", "time"], rows, title="Search of the start design")
