"""A campaign made anew from its export: the same folder, the same store, the same next step."""

from __future__ import annotations

import base64
import binascii
import hashlib
import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Any, TypeVar

from seqrsm.campaign.export import FORMAT, own_functions, without_store
from seqrsm.errors import StoreError, UserError
from seqrsm.spec.read import SPEC_NAME, load_spec
from seqrsm.spec.templates import new_folder
from seqrsm.store.records import KEPT, RunRecord, ScoreRecord, misfit
from seqrsm.store.schema import STATES
from seqrsm.store.store import Store

MAX_BYTES = 500_000_000
_AGAIN = "Export the campaign again: seqrsm export DIR FILE.json"

Record = TypeVar("Record")


def rebuild(source: Path, folder: Path, *, trust_code: bool = False) -> None:
    """Make the campaign of an export in a new folder, its database in there; all or nothing.

    Parameters
    ----------
    source : Path
        ``.json`` of `seqrsm.campaign.export`.
    folder : Path
        New, or empty.
    trust_code : bool
        Take code that comes with it, which an event then names by its hash.

    Raises
    ------
    UserError
        The folder is not empty; a file that the export only names is not there or is another one; code is not trusted.
    StoreError
        The file is no export, or damaged.
    """
    document = _read(source)
    with new_folder(folder) as part:
        _write(document, source, part, trust_code)


def _read(source: Path) -> Mapping[str, Any]:
    if not source.is_file():
        raise StoreError("there is no such file", "Check the name.", file=str(source))
    if source.stat().st_size > MAX_BYTES:
        raise StoreError(f"the file is larger than {MAX_BYTES // 1_000_000} MB", _AGAIN, file=str(source))
    try:
        document = json.loads(source.read_bytes().decode("utf-8-sig"))
        json.dumps(document, allow_nan=False)  # JSON knows no nan, and no number without end
    except (ValueError, RecursionError) as error:
        raise StoreError(f"this is not a JSON document: {error}", _AGAIN, file=str(source)) from None
    found = document.get("format") if isinstance(document, dict) else None
    if found != FORMAT:
        message = "this is not an export that this program can rebuild"
        newer = str(found).startswith(FORMAT.rstrip("0123456789"))
        remedy = "Upgrade seqrsm: pip install --upgrade seqrsm" if newer else _AGAIN
        raise StoreError(message, remedy, file=str(source), field="format", value=found)
    return dict(document)


def _write(document: Mapping[str, Any], source: Path, folder: Path, trust_code: bool) -> None:
    where = str(source)
    try:
        text, attachments = document["campaign_toml"], document["attached"]
        (folder / SPEC_NAME).write_text(without_store(text), encoding="utf-8", newline="")
        for one in attachments:
            _attach(one, source, folder)
        runs = [_run(row) for row in document["runs"]]
        kept: dict[str, Any] = {kind: [_record(made, row) for row in document[kind]] for kind, made in KEPT.items()}
        meta = {str(key): str(value) for key, value in document["campaign"].items()}
    except (KeyError, TypeError, ValueError, AttributeError, UnicodeError) as error:
        message = f"the export is damaged: {type(error).__name__} {error}"
        raise StoreError(message, _AGAIN, file=where) from None
    spec = load_spec(folder)
    if spec.spec_hash != document.get("spec_hash"):
        message = "the specification in the export does not match its runs"
        raise StoreError(message, _AGAIN, file=where, field="spec_hash")
    if spec.store_url is not None:
        message = "the specification in the export names a database of its own"
        raise StoreError(message, "Remove [store] from it.", file=where, field="campaign_toml")
    code = {str(one["path"]): str(one["sha256"]) for one in attachments if str(one["path"]).endswith(".py")}
    code |= {name: code.get(f"{name.partition(':')[0].replace('.', '/')}.py", "") for name in own_functions(spec)}
    if code and not trust_code:
        told = ", ".join(f"{name} (SHA-256 {digest})" if digest else name for name, digest in code.items())
        message = f"the campaign includes code that check, run and image would execute: {told}"
        raise UserError(message, "Read it; if you trust it, add --trust-code.", file=where)
    with Store.open(spec.folder, create=True, campaign=spec.name, seed=spec.seed) as store:
        store.restore(meta, runs, **kept)
        if code:
            store.add_event("code trusted", {"code": code}, once=("code",))


def _attach(one: Mapping[str, Any], source: Path, folder: Path) -> None:
    """Write a file of the campaign, or find it beside the export, by its hash; nothing is written outside."""
    name, digest, content = str(one["path"]), one["sha256"], one["base64"]
    place = PurePosixPath(name)
    if name.startswith("campaign."):
        raise ValueError(f"{name} is attached")
    inside = not place.is_absolute() and ".." not in place.parts and "\\" not in name and ":" not in name
    if not inside:
        if not Path(name).is_file() or _sha256(Path(name).read_bytes()) != digest:
            message = f"the campaign needs the file of SHA-256 {digest}, which is missing"
            raise UserError(message, "Restore it.", file=name)
        return
    if content is None:
        beside = source.parent / place
        if not beside.is_file():
            message = f"the export does not contain this file (SHA-256 {digest})"
            raise UserError(message, "Put it beside the export.", file=str(beside))
        data = beside.read_bytes()
    else:
        try:
            data = base64.b64decode(content, validate=True)
        except binascii.Error as error:
            raise ValueError(f"{name}: {error}") from None
    if _sha256(data) != digest:
        raise ValueError(f"{name} has a SHA-256 other than {digest}")
    target = folder / place
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_bytes(data)


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def _run(row: Mapping[str, Any]) -> RunRecord:
    run = _record(RunRecord, {**row, "scores": ()})
    if run.state not in STATES:
        raise ValueError(f"run {run.run_id} has the state {run.state!r}")
    scores = tuple(_record(ScoreRecord, {**score, "run_id": run.run_id}) for score in row["scores"])
    return replace(run, scores=scores)


def _record(kind: type[Record], row: Mapping[str, Any]) -> Record:
    record = kind(**row)
    if name := misfit(record):
        raise TypeError(f"{name} of {kind.__name__} is {row[name]!r}")
    return record
