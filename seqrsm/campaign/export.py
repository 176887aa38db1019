"""Everything in the store as CSV or JSON, for other programs and for keeps; the form that a flight crew fills in."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Sequence
from dataclasses import astuple, fields
from pathlib import Path

from seqrsm import __version__
from seqrsm.campaign.guards import see_meaning
from seqrsm.design.factors import CategoricalFactor, Factor
from seqrsm.errors import StoreError
from seqrsm.files import csv_text, put, see_free
from seqrsm.plain import heading, plain
from seqrsm.score.cells import FactorColumn
from seqrsm.spec.read import SPEC_NAME, CampaignSpec
from seqrsm.store.records import KEPT, RunRecord, ScoreRecord
from seqrsm.store.store import Store

# A spreadsheet takes a cell that begins so for a formula and runs it.
_FORMULA_SIGNS = ("=", "+", "-", "@", "\t", "\r", "\n")


def export(store: Store, spec: CampaignSpec, path: Path | str) -> tuple[Path, ...]:
    """Write the whole campaign to a file; return the files written, each of which appears only when it is complete.

    ``NAME.json``: one document with specification, runs, scores, looks, events and files. ``NAME.csv``: a row for each
    score (and for each run without one), units of factors and cost in its header, which `ingest` reads back; looks,
    events and files go to ``NAME.looks.csv`` and so on beside it. UserError of settings or scores of other units than
    ``campaign.toml`` tells now, another suffix, a file that exists with other content, or a folder that cannot be
    written.
    """
    see_meaning(store, spec, store.runs())
    target = Path(path)
    if target.suffix == ".json":
        texts = {target: _json_text(store, spec)}
    elif target.suffix == ".csv":
        header, rows = run_rows(store.runs(), spec)
        texts = {target: _safe_text(_with_units(header, spec), rows)}
        for kind, record in KEPT.items():
            records = getattr(store, kind)()
            if kind == "rankings" and not records:
                continue  # few campaigns have any
            names = [column.name for column in fields(record)]
            texts[target.with_suffix(f".{kind}.csv")] = _safe_text(names, [astuple(record) for record in records])
    else:
        raise StoreError("unknown kind of export", "Name a .csv or .json file.", file=str(target))
    made = {file: text.encode("utf-8") for file, text in texts.items()}
    # One that was cut short goes on.
    see_free(*(file for file, data in made.items() if not (file.is_file() and file.read_bytes() == data)))
    for file, data in made.items():
        put(file, data)
    return tuple(made)


def _json_text(store: Store, spec: CampaignSpec) -> str:
    document = {
        "version": __version__,
        "campaign": store.info(),
        "seed": spec.seed,
        "spec_hash": spec.spec_hash,
        "campaign_toml": without_store((spec.folder / SPEC_NAME).read_bytes().decode("utf-8-sig")),
        "factors": [{"name": factor.name, "unit": factor.unit} for factor in spec.factors],
        "applications": [{"name": one.name, "unit": one.score_unit} for one in spec.applications],
        "cost_unit": spec.cost.unit,
        **{kind: plain(getattr(store, kind)()) for kind in ("runs", *KEPT)},
    }
    return json.dumps(document, indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def without_store(text: str) -> str:
    """A specification without its table ``[store]``: an export tells no address and no password."""
    return re.sub(r"(?m)^[ \t]*\[[ \t]*store[ \t]*\][^\n]*\n?(?:(?![ \t]*\[)[^\n]*\n?)*", "", text)


def run_rows(runs: Iterable[RunRecord], spec: CampaignSpec) -> tuple[list[str], list[list[object]]]:
    """Columns and rows: a row for each score, and for each run without one; the block has its column's own name."""
    factor_names, block = spec.region.names, spec.model.block
    score_names = [column.name for column in fields(ScoreRecord) if column.name != "run_id"]
    apart = ("run_id", "proposed", "executed", "scores")
    run_names = [column.name for column in fields(RunRecord) if column.name not in apart]
    proposed_names = [f"proposed_{name}" for name in factor_names]
    units = {one.name: one.score_unit for one in spec.applications}
    nothing: tuple[ScoreRecord | None, ...] = (None,)
    rows: list[list[object]] = []
    for run in runs:
        for score in run.scores or nothing:
            row: list[object] = [run.run_id, *(run.settings.get(name) for name in factor_names)]
            row += [None if score is None else getattr(score, name) for name in score_names]
            row += [run.proposed.get(name) for name in factor_names]
            row += [getattr(run, name) for name in run_names]
            row.append(None if score is None else units.get(score.application))
            rows.append(row)
    header = ["run_id", *factor_names, *score_names, *proposed_names]
    if block is not None and block not in (*header, *run_names):
        run_names[run_names.index("block")] = block
    run_names.append("score_unit")
    return header + [f"run_{name}" if name in header else name for name in run_names], rows


def _with_units(header: Sequence[str], spec: CampaignSpec) -> list[str]:
    """A header with units, ``frequency [GHz]``, of factors and cost."""
    units = dict.fromkeys(("cost", "run_cost"), spec.cost.unit)
    for factor in spec.factors:
        units |= {factor.name: factor.unit, f"proposed_{factor.name}": factor.unit}
    return [heading(name, units.get(name, "")) for name in header]


def _safe_text(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Rows as CSV in which no spreadsheet finds a formula."""
    return csv_text(map(safe_cell, row) for row in (header, *rows))


def safe_cell(value: object) -> object:
    """A cell that no spreadsheet runs: text that begins like a formula gets an apostrophe, which ingest takes away."""
    if isinstance(value, (dict, list)):
        value = json.dumps(value, ensure_ascii=False, allow_nan=False)
    if isinstance(value, str) and value.startswith(_FORMULA_SIGNS):
        return f"'{value}"
    # repr of a float reads back as the same number; a whole one has no decimals that somebody measured.
    return repr(value).removesuffix(".0") if isinstance(value, float) else value


def factor_columns(factors: Sequence[Factor]) -> list[FactorColumn]:
    """What the columns of the factors must hold in a file that comes back."""
    return [
        FactorColumn(factor.name, levels=factor.levels)
        if isinstance(factor, CategoricalFactor)
        else FactorColumn(factor.name, factor.unit)
        for factor in factors
    ]


def form_rows(spec: CampaignSpec, runs: Sequence[RunRecord]) -> tuple[list[str], list[list[object]]]:
    """Columns and rows of the form, a row for each run and application; None where somebody is to fill in.

    Factors are in their own units; the block's column has the name of ``[model] block``. Where interpreters rank images
    nobody fills in a score: the best rank, 1, would be the lowest.
    """
    measured = [one for one in spec.applications if one.utility != "rank"]
    several = ["application"] if measured and len(spec.applications) > 1 else []
    block, score = spec.model.block or "block", ("score", *(("n", "correct") if spec.of_counts else ("se",)))
    wanted = (block, *score, "note") if measured else (block, "note")
    own = [name for name in dict.fromkeys(wanted) if name not in spec.region.names]
    rows: list[list[object]] = []
    for run in runs:
        cells = {block: run.block or None, "note": run.why}
        settings = [run.proposed[name] for name in spec.region.names]
        rows += [
            [run.run_id, *([one.name] if several else []), *settings, *(cells.get(name) for name in own)]
            for one in measured or spec.applications[:1]
        ]
    return ["run_id", *several, *spec.region.names, *own], rows


def write_form(path: Path, spec: CampaignSpec, runs: Sequence[RunRecord]) -> None:
    """Write the form with units in its header; text that a spreadsheet would run as a formula is neutralised.

    UserError where the file exists, or cannot be written.
    """
    header, rows = form_rows(spec, runs)
    see_free(path)
    put(path, _safe_text(_with_units(header, spec), rows).encode("utf-8"))
