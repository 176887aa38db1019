"""``campaign.toml``: the question of a campaign, its region, cost and stop rule.

The tables and keys of the file. Keys without a default are required; unknown keys are errors.

``[campaign]``
    ``name``; ``description`` (""), the subtitle of the report, with ``author`` and ``date`` (""); ``seed`` (0): an
    integer >= 0 that fixes all random numbers; ``batch`` (4): runs proposed at a time.
``[[factor]]``, one or more
    ``name``: with a simulator, a sensor parameter (:mod:`seqrsm.sensor.parameters`); ``unit`` (""; for a sensor
    parameter its own); ``scale`` ("linear" or "log"); and either ``low`` and ``high``, or ``values`` (two or more
    numbers), or ``levels`` (two or more names).
``[[constraint]]``
    ``expr``: a condition in natural units, see :mod:`seqrsm.design.constraints`.
``[[application]]``, one or more
    ``name``; ``utility``: "percent_correct", "f1 of Potatoes by field", "soil_moisture_skill", "measured" and others of
    :mod:`seqrsm.score.utilities`, or "package.module:function"; ``goal`` ("maximize", or "minimize", the default for
    errors); ``weight`` (1): its share in a compromise; ``unacceptable`` and ``ideal``: scores with desirability 0 and 1
    in a compromise, by default the worst and best of the fitted surface; ``half_width``, ``loss``: targets in place of
    those of ``[stop]``, required where applications have scores of different units; ``sufficient``: score from which a
    candidate suffices, by default that of the optimum minus the target half-width; ``catalog`` (words of the name or
    description): words the report looks up in the literature catalogue, see ``seqrsm catalog``; ``unit`` ("") of
    measured scores and of your own functions.
``[application.prior]``, below its ``[[application]]``
    Prior knowledge: ``utility = [low, high]``: the mean score at a random setting lies in this interval with
    ``probability`` (0.95); ``repeat_sd``: standard deviation of repeated runs (by the scores, from five degrees of
    freedom on; before, a tenth of that range), with the weight of ``repeat_runs`` (3) runs; ``optimum``: a table of
    numeric factors and their expected best value, as a number or ``{ value, doubt }``, the doubt being a standard
    deviation as a fraction of half the (coded) range (0.5); ``effect``: a table of numeric factors and ``[least,
    most]``: bounds on the change of the mean score from the low to the high end of the factor's range, with the
    other factors at their centre (``-inf``, ``inf``: no bound; with response = "logit" a bound is 0 or none). At
    least ``utility`` or ``effect`` is required. The prior enters the credible intervals of the optimal settings,
    the expected loss and the choice of runs; the recommended settings, the intervals of the score and the stop rule
    rest on the scores alone.
``[[consideration]]``
    Another objective of the compromise, such as cost, build time or risk: ``name``; ``expr``: its value as a function
    of the factors in natural units, with the arithmetic of constraints; ``unit`` (""); ``goal`` ("minimize");
    ``weight`` (1); ``unacceptable`` and ``ideal`` as above.
``[[candidate]]``
    A sensor that `seqrsm candidates` compares with the optimum: ``sensor``: its name as in `seqrsm catalog` (all that
    match, such as "Sentinel-1 IW"; ``*`` matches anything, "*" alone all current and planned sensors whose frequency
    and cell lie within the factors); ``polarization``: one of its sets of channels, by default the first;
    ``parameters``: a table of sensor parameters that differ. Without ``sensor``: ``name`` and ``parameters``, all
    others being those of the optimum.
``[model]``
    ``order`` (2, or 1); ``response`` ("identity" or "logit"); ``errors`` ("normal"; "student_t"; "beta_binomial":
    counts ``n`` and ``correct`` of every score, overdispersed); ``weights`` ("equal"; "se": by the inverse square
    of ``se``; "counts": scores are proportions of correct decisions, ``correct`` of ``n``, weighted by their
    variance p (1 - p) / n at the fitted value, times a factor estimated from the residuals); ``block``: column of
    measured scores that names the block, by default none; the next flights are then chosen as runs of one new
    block, whose effect has to be told from the surface, a pending batch as runs of another; ``block_effect``
    ("fixed": a constant for each block; "random": blocks are a sample, predictions are for a new one);
    ``discrepancy_sd``: prior standard deviation of the model discrepancy (flight minus simulation) as a mean over
    the region, in score units (half of it for coded coefficients of first order, a quarter for products and
    squares), by default from the standard deviation between worlds if simulations measured it and flights do not
    depart by far more, else 0.4 standard deviations of the scores.
``[simulator]``, omitted for a campaign with measured scores only
    ``engine`` ("psm" or "prm"); ``scene``: a file, relative to the campaign folder; ``table`` (none): a CSV file of
    your own sigma0 or emissivity, whose categories replace the built-in ones; ``calendar`` (none): a CSV file of your
    own courses of crops; ``calendar_shift_days`` (0): days by which the built-in ones come later; ``known_map`` (none):
    a CSV file with the confusion table of an existing cover map; ``tolerance`` (0: none): acceptable rms error of a
    simulated score, in score units; cells of the scene are then averaged as far as measured differences allow, see
    :mod:`seqrsm.campaign.tradeoff`; ``fixed``: every sensor parameter that is not a factor; ``members``: if
    ``frequency`` names a set such as "L+C", parameters of one member, including its ``engine``, as in
    ``[simulator.members.C]``. A factor ``C.resolution`` applies to that member; see :mod:`seqrsm.sensor.sets`.
``[cost]``
    ``simulation`` (1), ``flight`` (1): cost of a run, in ``unit`` (""); where sources compete for a run, one that costs
    nothing counts as a thousandth of the other.
``[stop]``
    ``half_width``: target half-width, in score units; ``interval`` ("prediction", "prediction_mean" or "confidence");
    ``replicates`` (5): m of "prediction_mean", the mean of m future runs; ``level`` (0.95): probability content of the
    intervals; ``loss`` (no limit): largest expected loss of the recommended settings against the true optimum, in score
    units; ``max_runs`` (80): budget of runs; ``guard`` ("runs": n >= 3 p or, while a quadratic is likelier than not,
    n >= p + 20; or "confirmation": confirmation runs decide); ``confirmation_runs`` (5): runs made at the optimum to
    confirm it, at least 2; ``worlds`` ("count", the default: the target applies to the whole interval; or "ignore": to
    sampling error only, without table uncertainty).
``[store]``
    ``url``: an SQLAlchemy address; by default the file ``campaign.db`` in the campaign folder. A relative
    ``sqlite:///`` path starts from that folder; put passwords of a server into ``PGPASSWORD`` or ``~/.pgpass``.
"""

from __future__ import annotations

import hashlib
import json
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path as FilePath
from typing import Any, Literal, TypeVar

from pydantic import ValidationError

from seqrsm.design.factors import Factor
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.errors import Problem, SpecError
from seqrsm.fit.error_models import ERROR_MODELS, ErrorModel
from seqrsm.scattering.readers import COVER
from seqrsm.spec import checks as spec_checks
from seqrsm.spec import sensors as spec_sensors
from seqrsm.spec.faults import Reporter
from seqrsm.spec.tables import (
    ApplicationSpec,
    CampaignTable,
    CandidateSpec,
    ConsiderationSpec,
    ConstraintTable,
    CostSpec,
    FactorTable,
    ModelSpec,
    SimulatorSpec,
    StopSpec,
    StoreTable,
    Table,
)
from seqrsm.spec.toml_lines import key_lines, line_of

SPEC_NAME = "campaign.toml"
MAX_BYTES = 1_000_000

SINGLE: Mapping[str, type[Table]] = {
    "campaign": CampaignTable,
    "model": ModelSpec,
    "simulator": SimulatorSpec,
    "cost": CostSpec,
    "stop": StopSpec,
    "store": StoreTable,
}
REPEATED: Mapping[str, type[Table]] = {
    "factor": FactorTable,
    "constraint": ConstraintTable,
    "application": ApplicationSpec,
    "consideration": ConsiderationSpec,
    "candidate": CandidateSpec,
}
REQUIRED = ("campaign", "factor", "application", "stop")


@dataclass(frozen=True, slots=True)
class CampaignSpec:
    """A valid ``campaign.toml``: attributes are its tables, and the keys of ``[campaign]``."""

    folder: FilePath
    """The campaign's folder."""

    name: str
    description: str
    seed: int
    batch: int
    region: Region
    """Factors and constraints."""
    applications: tuple[ApplicationSpec, ...]
    """In the order of the file."""

    model: ModelSpec
    simulator: SimulatorSpec | None
    """None in a campaign fed by measured scores only."""
    cost: CostSpec
    stop: StopSpec
    store_url: str | None
    """``[store] url``."""
    spec_hash: str
    """SHA-256 of the content: comments, layout, ``[store]`` and ``[[candidate]]`` do not count, defaults written out do
    not either."""
    considerations: tuple[ConsiderationSpec, ...] = ()
    """What else counts in a compromise."""
    candidates: tuple[CandidateSpec, ...] = ()
    """What the optimum is compared with."""
    author: str = ""
    date: str = ""

    @property
    def errors(self) -> ErrorModel:
        """The model of errors."""
        return ERROR_MODELS[self.model.errors]

    @property
    def of_counts(self) -> bool:
        """Whether scores count by numbers of decisions, which every run then needs."""
        return self.errors.of_counts or self.model.weights == "counts"

    @property
    def factors(self) -> tuple[Factor, ...]:
        """Factors in the order of the file."""
        return self.region.factors

    @property
    def quadratic(self) -> QuadraticModel:
        """The model in the campaign's factors, of the order of ``[model]``."""
        return QuadraticModel(self.factors, self.model.order)

    @property
    def own_source(self) -> Literal["simulation", "flight"]:
        """Where the campaign's runs come from, unless another source is asked for."""
        return "flight" if self.simulator is None else "simulation"

    @property
    def scene_path(self) -> FilePath | None:
        """The scene file, or None without a simulator."""
        return None if self.simulator is None else self.folder / self.simulator.scene

    def application(self, name: str) -> ApplicationSpec:
        """The application of this name; SpecError when there is none."""
        for application in self.applications:
            if application.name == name:
                return application
        known = ", ".join(application.name for application in self.applications)
        raise SpecError("no such application", f"Applications: {known}.", field="application", value=name)

    def stop_of(self, name: str) -> StopSpec:
        """``[stop]`` with the targets of the application of this name."""
        one = self.application(name)
        own = {key: value for key in ("half_width", "loss") if (value := getattr(one, key)) is not None}
        return self.stop.model_copy(update=own)


def load_spec(location: FilePath | str) -> CampaignSpec:
    """Read and check the specification of a campaign's folder, or of its ``campaign.toml``.

    SpecError with everything that is wrong, each with file, line, key, value and remedy.
    """
    place = FilePath(location)
    path = place / SPEC_NAME if place.is_dir() else place
    text = _read_text(path)
    raw = _parse(path, text)
    report = Reporter(str(path), key_lines(text))
    spec = _build(path.absolute().parent, raw, report)
    if report.problems or spec is None:
        raise SpecError(*sorted(report.problems, key=lambda problem: problem.line or 0))
    return spec


def _read_text(path: FilePath) -> str:
    if not path.is_file():
        remedy = "Make a campaign with: seqrsm init DIR --template NAME"
        raise SpecError("there is no such file", remedy, file=str(path))
    try:
        data = path.read_bytes()
    except OSError as error:
        raise SpecError(f"the file cannot be read: {error.strerror}", file=str(path)) from None
    if len(data) > MAX_BYTES:
        raise SpecError(f"the file is larger than {MAX_BYTES} bytes", "Is it the right one?", file=str(path))
    try:
        return data.decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        line, remedy = data.count(b"\n", 0, error.start) + 1, "Save it as UTF-8 in your editor."
        raise SpecError("the file is not UTF-8 text", remedy, file=str(path), line=line) from None


def _parse(path: FilePath, text: str) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        match = re.search(r"\(at line (\d+), column \d+\)", str(error))
        line = int(match[1]) if match else text.count("\n") + 1
        message = re.sub(r"\s*\(at .*\)$", "", str(error))
        remedy = "Text stands in quotes, lists in [ ], and each key once in its table; see https://toml.io."
        raise SpecError(f"this is not valid TOML: {message}", remedy, file=str(path), line=line) from None


_T = TypeVar("_T", bound=Table)


def _validated(model: type[_T], raw: object, path: tuple[str | int, ...], report: Reporter) -> _T | None:
    try:
        return model.model_validate(raw)
    except ValidationError as error:
        for detail in error.errors(include_url=False):
            report.invalid(path, detail, model)
        return None


def _tables(raw: Mapping[str, Any], report: Reporter) -> tuple[dict[str, Any], dict[str, list[Any]]]:
    """Every table that is right in itself; the others are None, and reported."""
    known = (*SINGLE, *REPEATED)
    for key in raw:
        if key not in known:
            report.unknown_key((key,), known)
    for key in REQUIRED:
        if key not in raw:
            header = f"[[{key}]]" if key in REPEATED else f"[{key}]"
            report.add((key,), f"the file has no {header}", f"Add a table {header}.")
    single = {}
    for key, model in SINGLE.items():
        if key in raw or key not in (*REQUIRED, "simulator"):
            single[key] = _validated(model, raw.get(key, {}), (key,), report)
    repeated: dict[str, list[Any]] = {}
    for key, model in REPEATED.items():
        tables = raw.get(key, [])
        if tables == [] and key in raw:
            report.add((key,), f"the list of [[{key}]] is empty", f"Add a table [[{key}]].")
        if not isinstance(tables, list):
            report.add((key,), f"[{key}] must be written with double brackets", f"Write [[{key}]].")
            tables = []
        for i, table in enumerate(tables):
            if isinstance(table, dict) and isinstance(table.get("name"), str):
                report.names[key, i] = table["name"]
        repeated[key] = [_validated(model, table, (key, i), report) for i, table in enumerate(tables)]
    return single, repeated


def _build(folder: FilePath, raw: Mapping[str, Any], report: Reporter) -> CampaignSpec | None:
    single, repeated = _tables(raw, report)
    region = _checked(folder, raw, single, repeated, report)
    if report.problems or region is None:
        return None
    if single["model"].response == "logit":
        for application in repeated["application"]:
            application.on_logit_scale()
    return CampaignSpec(
        **single["campaign"].model_dump(),
        folder=folder,
        region=region,
        applications=tuple(repeated["application"]),
        model=single["model"],
        simulator=single.get("simulator"),
        cost=single["cost"],
        stop=single["stop"],
        considerations=tuple(repeated["consideration"]),
        candidates=tuple(repeated["candidate"]),
        store_url=single["store"].url,
        spec_hash=_content_hash(single, repeated, region),
    )


def _checked(
    folder: FilePath,
    raw: Mapping[str, Any],
    single: Mapping[str, Any],
    repeated: Mapping[str, Sequence[Any]],
    report: Reporter,
) -> Region | None:
    """The region, and a report of everything in which tables do not fit each other."""
    right = {k: [(i, table) for i, table in enumerate(own) if table is not None] for k, own in repeated.items()}
    applications, considerations = right["application"], right["consideration"]
    sensors = spec_sensors.sensors(raw.get("simulator"))
    written = raw["factor"] if isinstance(raw.get("factor"), list) else []
    factors = spec_sensors.factors([t and t.model_dump() for t in repeated["factor"]], written, sensors, report)
    constraints = spec_checks.constraints([t and t.expr for t in repeated["constraint"]], report)
    spec_checks.different_names(report)
    names = [name for path, name in report.names.items() if path[0] == "factor"]
    if isinstance(raw.get("simulator"), dict):
        spec_checks.simulator(folder, raw["simulator"], names, report)
        spec_sensors.members(sensors, written, raw["simulator"].get("fixed"), report)
    spec_checks.goals(applications, report)
    spec_checks.targets(applications, raw.get("stop"), report)
    spec_checks.desirabilities("application", applications, report)
    spec_checks.catalogued(applications, sensors.engine, report)
    spec_checks.desirabilities("consideration", considerations, report)
    known = [factor for factor in factors if factor is not None]
    region = spec_checks.region(factors, constraints, report) if factors else None
    if len(known) == len(factors):
        spec_checks.expressions(considerations, known, region, report)
        spec_checks.knowledge(applications, known, single.get("model"), report)
    if single.get("model") is not None:
        spec_checks.model(single["model"], applications, names, simulated="simulator" in raw, report=report)
    spec_sensors.candidates(right["candidate"], sensors, names, report)
    return region


def _content_hash(single: Mapping[str, Table], repeated: Mapping[str, Sequence[Table]], region: Region) -> str:
    """See `CampaignSpec.spec_hash`."""
    content: dict[str, object] = {
        "factors": [repr(factor) for factor in region.factors],
        "constraints": [constraint.expr for constraint in region.constraints],
        "simulator": None,
    }
    content |= {key: table.model_dump(exclude_defaults=True) for key, table in single.items() if key != "store"}
    for key in ("application", "consideration"):
        content[f"{key}s"] = [table.model_dump(exclude_defaults=True) for table in repeated[key]]
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def placed(spec: CampaignSpec, problem: Problem, *path: str | int) -> Problem:
    """A problem with the place of a key in ``campaign.toml``, or of the table that it is missing from."""
    file = spec.folder / SPEC_NAME
    return replace(problem, file=str(file), line=line_of(key_lines(file.read_text(encoding="utf-8-sig")), path))


def fixed_problem(spec: CampaignSpec, problem: Problem) -> Problem:
    """A problem of a sensor's fixed parameter with its place in ``campaign.toml``."""
    if problem.field == COVER:
        return replace(placed(spec, problem, "simulator", "scene"), field="[simulator] scene")
    name = str(problem.field)
    return replace(placed(spec, problem, "simulator", "fixed", name), field=f"[simulator.fixed] {name}")
