"""``seqrsm candidates``: which sensor that flies suffices, how far it is from the optimum, and what that is owed to.

A candidate whose every parameter is a factor within the region is judged by the fitted surface. Others are simulated
with their own noise, angles, looks, cell and dates: at the near edge, in the middle and at the far edge of the swath,
in the same worlds and on the same occasions as the optimum. Then the optimum is simulated with one property of the
candidate after another.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from seqrsm.analysis.candidates import Comparison, Sufficing, by_surface, compared
from seqrsm.analysis.ground import N_WORLDS, OCCASIONS, future_sds
from seqrsm.analysis.results import Analysis
from seqrsm.analysis.to_json import fields_to_json, interval_to_json
from seqrsm.arrays import FloatArray
from seqrsm.campaign.campaign import Campaign
from seqrsm.campaign.grounds import cells_of_ground, scores_of
from seqrsm.campaign.instruments import (
    Instrument,
    as_factors,
    cells_of,
    examine,
    instrument_of,
    middle_deg,
    mixtures,
    nearest_to,
    over_ground,
    passes,
    place_in_swath,
    rounded,
    with_parameters,
)
from seqrsm.campaign.simulation import NO_RUN, SimulationTask, bundle_tasks, ground_of, task_of
from seqrsm.design.factors import CategoricalFactor, span
from seqrsm.errors import ConfigurationError, SpecError, UserError
from seqrsm.files import get_json, put_json, see_writable
from seqrsm.fit.optimum import sign_of
from seqrsm.plain import plain
from seqrsm.progress import silent
from seqrsm.rng import generator
from seqrsm.scattering.emissivity import MEASURED_GHZ
from seqrsm.sensor.named import NamedSensor, sensors_called
from seqrsm.sensor.sets import day_of_year
from seqrsm.spec.read import SPEC_NAME, CampaignSpec
from seqrsm.spec.tables import ApplicationSpec

FILE: Final = "candidates.json"

PILOT_WORLDS: Final = 4
"""Worlds, none of those that count, in which the size of a candidate's cell is chosen."""

NEXT: Final = 3
"""Candidates after the first that are compared with it."""

_FIELDS: Final = {
    "sar": (
        *("frequency_ghz", "channels", "bandwidth_mhz", "resolution_range_m", "resolution_azimuth_m", "looks"),
        *("incidence_near_deg", "incidence_far_deg", "altitude_km", "radiometric_accuracy_db"),
    ),
    "radiometer": (
        *("frequency_ghz", "channels", "bandwidth_mhz", "footprint_km", "nedt_k", "integration_time_ms"),
        *("altitude_km", "incidence_near_deg", "rotation_rpm", "feeds"),
    ),
}


@dataclass(frozen=True, slots=True)
class Candidate:
    """One line of the answer."""

    name: str

    sensor: NamedSensor | None
    """None for one that is told by its parameters alone."""
    channels: str
    """Of a named one."""
    parameters: Mapping[str, float | str]
    """What differs, by the names of ``campaign.toml``."""


def candidates_of(spec: CampaignSpec) -> list[Candidate]:
    """Every candidate of ``campaign.toml``, each sensor once; "*" is all that are not past and fit the factors."""
    found: dict[str, Candidate] = {}
    engine = None if spec.simulator is None else spec.simulator.engine
    for table in spec.candidates:
        wanted = set(table.polarization.split("+"))
        if not table.sensor:
            found[table.name] = Candidate(table.name, None, "", table.parameters)
        for sensor in sensors_called(table.sensor):
            if engine not in (None, sensor.engine) or (table.sensor == "*" and not _fits(spec, sensor)):
                continue
            same = (own for own in sensor.channels if not table.polarization or set(own.split("+")) == wanted)
            if channels := next(same, ""):
                more = f", {table.name}" if table.name else ""
                name = f"{sensor.title}, {channels}{more}"
                found[name] = Candidate(name, sensor, channels, table.parameters)
    return list(found.values())


def _assumed(sensor: NamedSensor) -> list[str]:
    """What is assumed where a sensor is simulated."""
    above = sensor.kind == "radiometer" and sensor.values["frequency_ghz"] > MEASURED_GHZ
    told = {
        "noise": sensor.kind == "sar" and sensor.noise_rests == "assumed",
        f"one view at {sensor.conical_incidence_deg:g} deg of many": sensor.many_views,
        f"emissivity above {MEASURED_GHZ:g} GHz": above,
    }
    return [name for name, holds in told.items() if holds]


def _fits(spec: CampaignSpec, sensor: NamedSensor) -> bool:
    """Whether it is no past one, and frequency and cell lie within the ranges of the factors."""
    known = {"frequency": sensor.values["frequency_ghz"]}
    if sensor.kind == "sar" or "footprint_km" in sensor.values:
        known["resolution"] = sensor.cell_m(middle_deg(sensor))
    for factor in spec.factors:
        if factor.name in known and not isinstance(factor, CategoricalFactor):
            low, high = span(factor)
            # finer cells are averaged to any size
            if known[factor.name] > high or (factor.name == "frequency" and known[factor.name] < low):
                return False
    return sensor.status != "past"


def why_not(error: UserError) -> str:
    """Why a candidate cannot be judged: each thing once, three of many, such as covers of which its band is unknown."""
    told = list(dict.fromkeys(problem.message for problem in error.problems))
    return "; ".join(told if len(told) < 5 else [*told[:3], f"and {len(told) - 3} more"])


def measure_candidates(
    campaign: Campaign, *, worlds: int = N_WORLDS, workers: int = 1, progress: Callable[[int, int], None] = silent
) -> dict[str, Any]:
    """Compare every candidate with the optimum of every application.

    The campaign has scores enough for a surface. At least 4 ``worlds``, grounds, are drawn; ``workers`` are processes;
    ``progress`` is told of (done, all) candidates. The result is of plain values, and also written to `FILE` of the
    campaign's folder. UserError without candidates, of too few scores, or of a folder that cannot be written.
    """
    spec = campaign.spec
    wanted = candidates_of(spec)
    if not wanted:
        message, remedy = "there are no candidates", 'sensor = "Sentinel-1 IW GRDH", or sensor = "*" for all that fit.'
        if spec.candidates:
            message, remedy = (
                'no sensor of sensor = "*" fits the ranges of frequency and resolution',
                'sensor = "NAME".',
            )
        raise SpecError(message, f"Add [[candidate]] with {remedy}", file=str(spec.folder / SPEC_NAME))
    see_writable(spec.folder / FILE)
    found: dict[str, Any] = {"key": _key(spec), "worlds": worlds, "applications": {}}
    analyses = campaign.analyse_all()
    progress(0, len(wanted) * len(analyses))
    for done, analysis in enumerate(analyses):
        application = spec.application(analysis.application)
        one = _Comparer(campaign, analysis, application, worlds, workers)
        rows = []
        for number, candidate in enumerate(wanted, start=1):
            rows.append(one.row(candidate))
            progress(done * len(wanted) + number, len(wanted) * len(analyses))
        rows.sort(key=one.place)
        one.compare_again(rows)
        found["applications"][analysis.application] = {**one.head(), "candidates": rows}
    found = dict(plain(found))
    put_json(spec.folder / FILE, found)
    return found


def read_candidates(spec: CampaignSpec, analyses: Sequence[Analysis]) -> dict[str, Any] | None:
    """What was measured last; None where nothing was, of other candidates, or beside other optima than these."""
    found = get_json(spec.folder / FILE)
    try:
        same = found["key"] == _key(spec) and all(
            rounded(found["applications"][one.application]["settings"]) == rounded(one.optimum.settings)
            for one in analyses
        )
    except (KeyError, TypeError):
        return None
    return dict(found) if same else None


def _key(spec: CampaignSpec) -> list[Any]:
    return [spec.spec_hash, [[one.name, dict(one.parameters)] for one in candidates_of(spec)]]


class _Comparer:
    """One application's optimum, simulated once, and candidates beside it."""

    def __init__(
        self, campaign: Campaign, analysis: Analysis, application: ApplicationSpec, worlds: int, workers: int
    ) -> None:
        self.spec, self.analysis, self.application = campaign.spec, analysis, application
        self.workers = workers
        score, sign = application.sufficient, sign_of(analysis.goal)
        relative = score is None
        margin = self.spec.stop_of(application.name).half_width
        least, most = application.score_limits
        self.rule = Sufficing(-sign * margin if score is None else score, relative, sign, most - least)
        self.level = self.spec.stop.level
        kind = self.spec.stop.interval
        self.runs = {"prediction": 1.0, "prediction_mean": float(self.spec.stop.replicates)}.get(kind, math.inf)
        self.settings = analysis.optimum.settings
        self.optimum: FloatArray | None = None
        self.places: dict[str, list[Instrument]] = {}
        if self.spec.simulator is None:
            return
        cells = cells_of_ground(self.spec, campaign.store)
        made = bundle_tasks(self.spec, self.settings, cells, range(2 * worlds + PILOT_WORLDS))
        n, later = worlds * OCCASIONS, (worlds + PILOT_WORLDS) * OCCASIONS
        self.tasks, self.pilots, self.fresh = made[:n], made[n:later:OCCASIONS], made[later:]
        self.base = instrument_of(made[0])
        self.optimum = self._simulated([self.base], self.tasks)[0]

    def head(self) -> dict[str, Any]:
        """What is said of the optimum and the target."""
        best = self.analysis.optimum
        return {
            "settings": dict(self.settings),
            "optimum": best.mean,
            "guess": self.analysis.data.guess,
            "interval": interval_to_json(best.whole),
            "simulated": None if self.optimum is None else float(self.optimum.mean()),
            "sufficient": self.rule.score,
            "relative": self.rule.relative,
            "runs": None if math.isinf(self.runs) else self.runs,
            "level": self.level,
            "unit": self.application.score_unit,
        }

    def place(self, row: Mapping[str, Any]) -> tuple[bool, float, float]:
        """What rows are sorted by: those not judged last, then the most probable first, then the best."""
        better = self.rule.sign * row.get("difference", 0.0)
        return row["how"] == "none", -row.get("probability", 0.0), -better

    def compare_again(self, rows: Sequence[dict[str, Any]]) -> None:
        """Compare the first of several simulated ones, and the next with it, in worlds without part in their order."""
        told = [row for row in rows if row["name"] in self.places][: 1 + NEXT]
        if len(told) < 2 or told[0] is not rows[0]:
            return
        made = [[self.base], *(self.places[row["name"]] for row in told)]
        scores = self._simulated([one for places in made for one in places], self.fresh)
        optimum, first, *others = np.split(scores, np.cumsum([len(places) for places in made[:-1]]))
        as_good = replace(self.rule, score=0.0, relative=True)
        pairs = [("again", first, optimum, self.rule), *(("beside_first", one, first, as_good) for one in others)]
        for row, (key, own, other, rule) in zip(told, pairs, strict=True):
            whole = np.isfinite([*own, *other]).all(axis=(0, 2))
            if whole.sum() > 1:
                found = compared(own[:, whole], other[:, whole], rule, self.level, self.runs)
                row[key] = {"name": row["name"], "how": "simulation", **fields_to_json(found)}

    def row(self, candidate: Candidate) -> dict[str, Any]:
        """The answer for one candidate."""
        sensor = candidate.sensor
        told: dict[str, Any] = {"name": candidate.name, "how": "none"}
        if sensor is not None:
            fields = _FIELDS[sensor.kind]
            told |= {"sensor": sensor.title, "status": sensor.status}
            told["recalled"] = [name for name in fields if sensor.resting(name) == "recalled"]
            told["assumed"] = _assumed(sensor)
            told["recalled"] += ["noise"] if sensor.kind == "sar" and sensor.noise_rests == "recalled" else []
        try:
            at = self._in_region(candidate)
            if at is not None:
                return {**told, "how": "surface", **fields_to_json(self._by_surface(at, candidate)), "settings": at}
            if self.optimum is None:
                raise ConfigurationError("its settings lie outside the region, and there is no simulator")
            return {**told, "how": "simulation", **self._by_simulation(candidate, told)}
        except UserError as error:
            return {**told, "why": why_not(error)}

    def _in_region(self, candidate: Candidate) -> dict[str, float | str] | None:
        """Its settings, where factors tell all of it and lie in the region; of named ones only without a simulator."""
        own = dict(candidate.parameters)
        if candidate.sensor is not None:
            if self.optimum is not None:
                return None
            own = {**as_factors(self.spec, candidate.sensor, candidate.channels), **own}
        if not set(own) <= set(self.spec.region.names):
            return None
        settings = {**self.settings, **own}
        point = self.spec.region.code([settings])
        return settings if self.spec.region.feasible(point)[0] else None

    def _by_surface(self, settings: Mapping[str, float | str], candidate: Candidate) -> Comparison:
        """What is expected by the surface; how one ground differs from it by simulations, where there are some."""
        analysis = self.analysis
        points = self.spec.region.code([settings, self.settings])
        # Nothing tells how far measured scores of two sensors scatter alike, but for the day that they share.
        variance, of_day = analysis.sd_of_run**2, 0.0
        if common := analysis.fitted.common_sd:
            of_day = variance * (common / analysis.fitted.scatter(analysis.optimum.point)[0]) ** 2
        chance = (variance - of_day) / self.runs
        sds = np.sqrt([2.0 * chance]), np.sqrt([chance + of_day])
        if self.optimum is not None:
            own = self._simulated([self._own(candidate)], self.tasks)[0]
            whole = np.isfinite(own).all(axis=1) & np.isfinite(self.optimum).all(axis=1)
            if whole.sum() > 1:
                sds = future_sds((own - self.optimum)[whole], self.runs), future_sds(own[whole], self.runs)
        if np.isnan(sds[0]).any():
            raise ConfigurationError("nothing is known of the scatter of scores until there are more runs than terms")
        return by_surface(analysis, points, self.rule, sds, generator(self.spec.seed, 0, "candidates"))

    # -- simulated ------------------------------------------------------------------------------------------------

    def _by_simulation(self, candidate: Candidate, told: dict[str, Any]) -> dict[str, Any]:
        assert self.optimum is not None
        (places, offered), sensor = self._places(candidate), candidate.sensor
        days = places[0].days[0]
        if offered is not None and sensor is not None and sensor.resting("revisit_days") == "recalled":
            told["recalled"].append("revisit_days")
        for place in places:
            examine(place, self.tasks[0])
        scores = self._simulated(places, self.tasks)
        whole = np.isfinite(scores).all(axis=(0, 2)) & np.isfinite(self.optimum).all(axis=1)
        if whole.sum() < 2:
            raise ConfigurationError("its simulations failed")
        own, optimum = scores[:, whole], self.optimum[whole]
        result = compared(own, optimum, self.rule, self.level, self.runs)
        self.places[candidate.name] = places
        mixed_by = dict(mixtures(self.base, places[len(places) // 2]))
        owed = []
        # One occasion in each world tells enough: what it changes is told against the same.
        for name, mixed in zip(mixed_by, self._simulated(mixed_by.values(), self.tasks[::OCCASIONS]), strict=True):
            if np.isfinite(mixed[whole]).all():
                alone = compared(mixed[None, whole], optimum[:, :1], self.rule, self.level, self.runs)
                confidence = interval_to_json(alone.confidence)
                owed.append({"property": name, "difference": alone.difference, "confidence": confidence})
        rows = [{**place_in_swath(place), "score": float(one.mean())} for place, one in zip(places, own, strict=True)]
        dates = {"used": list(map(day_of_year, days)), "offered": offered} if days else None
        scene = ground_of(self.tasks[0])[0]
        sides_km = [1e-3 * scene.cell_m * cells for cells in scene.shape[::-1]]
        coarse = {"scene_km": sides_km} if rows[0]["cell_m"] > 1e3 * min(sides_km) else {}
        return {**fields_to_json(result), "places": rows, "owed_to": owed, "dates": dates, **coarse}

    def _places(self, candidate: Candidate) -> tuple[list[Instrument], int | None]:
        """The candidate at places of its swath, from near to far, and how many dates it offers, where they count."""
        sensor, own = candidate.sensor, candidate.parameters
        if sensor is None:
            return [self._own(candidate)], None
        base = nearest_to(sensor, self.base)
        days, offered = passes(self.spec, sensor, self.base.days[self.base.sensors.index(base)])

        def at(angle: float, cell_m: float) -> Instrument:
            return Instrument((over_ground(sensor, candidate.channels, own, base, angle, cell_m),), (days,))

        cells = cells_of(self.spec, sensor, base)
        if len(cells) > 1:
            tried = [at(middle_deg(sensor), size) for size in cells]
            examine(tried[0], self.tasks[0])
            scores = self.rule.sign * self._simulated(tried, self.pilots)
            cells = [cells[int(np.argmax(np.nan_to_num(scores.mean(axis=(1, 2)), nan=-np.inf)))]]
        angles = sensor.incidences_deg if sensor.kind == "sar" else (0.0,)
        return [at(angle, cells[0]) for angle in angles], offered

    def _own(self, candidate: Candidate) -> Instrument:
        """The optimum with the parameters of a candidate that has no other name."""
        return with_parameters(task_of(self.spec, NO_RUN, self.settings), candidate.parameters)

    def _simulated(self, instruments: Collection[Instrument], tasks: Sequence[SimulationTask]) -> FloatArray:
        """Scores (instruments, worlds, occasions)."""
        made = [one.task(task) for one in instruments for task in tasks]
        worlds = len({task.world for task in tasks})
        if not made:
            return np.empty((0, worlds, 1))
        scores = scores_of(made, self.application.name, self.workers)
        return scores.reshape(len(instruments), worlds, -1)
