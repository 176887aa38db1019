"""``seqrsm candidates``: which sensor that flies suffices, how far it is from the optimum, and what that is owed to.

A candidate whose every parameter is a factor within the region is judged by the fitted surface. Others are simulated
with their own noise, angles, looks, cell and dates: at the near edge, in the middle and at the far edge of the swath,
in the same worlds and on the same occasions as the optimum. Then the optimum is simulated with one property of the
candidate after another.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Final

import numpy as np

from seqrsm.analysis.candidates import Comparison, Sufficing, by_surface, compared, future_sd
from seqrsm.analysis.ground import N_WORLDS, OCCASIONS
from seqrsm.analysis.results import Analysis
from seqrsm.arrays import FloatArray
from seqrsm.campaign.campaign import Campaign, silent
from seqrsm.campaign.engines import ENGINES, Sensor
from seqrsm.campaign.simulation import NO_RUN, SimulationTask, bundle_tasks, ground_of, task_of
from seqrsm.design.factors import CategoricalFactor, span
from seqrsm.errors import ConfigurationError, Problem, SpecError, UserError
from seqrsm.fit.optimum import sign_of
from seqrsm.plain import plain
from seqrsm.rng import generator
from seqrsm.sensor.exchange import PROPERTIES, as_parameters, exchanged
from seqrsm.sensor.named import NamedSensor, noise_equivalent_db, radar_of, radiometer_of, sensors_called
from seqrsm.sensor.radar import RadarConfiguration
from seqrsm.sensor.sets import LAST_DAY
from seqrsm.spec.read import SPEC_NAME, ApplicationSpec, CampaignSpec, CandidateSpec

FILE: Final = "candidates.json"

PILOT_WORLDS: Final = 4
"""Worlds, none of those that count, in which the size of a candidate's cell is chosen."""

_COARSER: Final = (1.0, 1.4, 2.0, 2.8, 4.0)
_FIELDS: Final = {
    "sar": (
        *("frequency_ghz", "channels", "bandwidth_mhz", "resolution_range_m", "resolution_azimuth_m", "looks"),
        *("incidence_near_deg", "incidence_far_deg", "altitude_km", "radiometric_accuracy_db"),
    ),
    "radiometer": (
        *("frequency_ghz", "channels", "bandwidth_mhz", "footprint_km", "nedt_k", "integration_time_ms"),
        "altitude_km",
    ),
}


@dataclass(frozen=True, slots=True)
class Candidate:
    """One line of the answer.

    Attributes
    ----------
    name : str
    sensor : NamedSensor or None
        None for one that is told by its parameters alone.
    channels : str
        Of a named one.
    parameters : Mapping
        What differs, by the names of ``campaign.toml``.
    """

    name: str
    sensor: NamedSensor | None
    channels: str
    parameters: Mapping[str, float | str]


@dataclass(frozen=True, slots=True)
class Instrument:
    """Sensors and their dates, as simulated: several of a set, or one."""

    sensors: tuple[Sensor, ...]
    days: tuple[tuple[float, ...], ...]

    def task(self, task: SimulationTask) -> SimulationTask:
        """The task with these sensors in place of its own."""
        told = [
            as_parameters(sensor) | ({"days": "+".join(f"{day:.12g}" for day in days)} if days else {})
            for sensor, days in zip(self.sensors, self.days, strict=True)
        ]
        if len(told) == 1:
            return replace(task, engine=_engine(self.sensors[0]), settings=told[0], fixed={}, members={})
        engines = map(_engine, self.sensors)
        members = {f"no{k}": {**own, "engine": e} for k, (own, e) in enumerate(zip(told, engines, strict=True))}
        return replace(task, settings={"frequency": "+".join(members)}, fixed={}, members=members)


def _engine(sensor: Sensor) -> str:
    return "psm" if isinstance(sensor, RadarConfiguration) else "prm"


def instrument_of(task: SimulationTask) -> Instrument:
    """The sensors of a task."""
    made = task.acquisitions
    members = dict.fromkeys(one.member for one in made)
    own = [[one for one in made if one.member == member] for member in members]
    days = tuple(tuple(one.visit.day for one in of if one.visit.day is not None) for of in own)
    return Instrument(tuple(of[0].sensor for of in own), days)


def candidates_of(spec: CampaignSpec) -> list[Candidate]:
    """Every candidate of ``campaign.toml``, each sensor once; "*" is all that are not past and fit the factors."""
    found: dict[str, Candidate] = {}
    engine = None if spec.simulator is None else spec.simulator.engine
    for table in spec.candidates:
        if not table.sensor:
            found[table.name] = Candidate(table.name, None, "", table.parameters)
        for sensor in sensors_called(table.sensor):
            if engine not in (None, sensor.engine) or (table.sensor == "*" and not _fits(spec, sensor)):
                continue
            channels = _channels(sensor, table)
            if channels:
                more = f", {table.name}" if table.name else ""
                name = f"{sensor.title}, {channels}{more}"
                found[name] = Candidate(name, sensor, channels, table.parameters)
    return list(found.values())


def _channels(sensor: NamedSensor, table: CandidateSpec) -> str:
    wanted = set(table.polarization.split("+"))
    return next((own for own in sensor.channels if not table.polarization or set(own.split("+")) == wanted), "")


def _fits(spec: CampaignSpec, sensor: NamedSensor) -> bool:
    """Whether it is no past one, and frequency and cell lie within the ranges of the factors."""
    known = {"frequency": sensor.values["frequency_ghz"]}
    if sensor.kind == "sar" or "footprint_km" in sensor.values:
        known["resolution"] = sensor.cell_m(sensor.incidences_deg[len(sensor.incidences_deg) // 2])
    for factor in spec.factors:
        if factor.name in known and not isinstance(factor, CategoricalFactor):
            low, high = span(factor)
            # finer cells are averaged to any size
            if known[factor.name] > high or (factor.name == "frequency" and known[factor.name] < low):
                return False
    return sensor.status != "past"


def measure_candidates(
    campaign: Campaign,
    *,
    sufficient: float | None = None,
    worlds: int = N_WORLDS,
    workers: int = 1,
    progress: Callable[[int, int], None] = silent,
) -> dict[str, Any]:
    """Compare every candidate with the optimum of every application.

    Parameters
    ----------
    campaign : Campaign
        With scores enough for a surface.
    sufficient : float, optional
        Score from which on a sensor suffices, in place of that of ``campaign.toml``.
    worlds : int
        Grounds that are drawn, at least 4.
    workers : int
        Processes.
    progress : callable
        Told of (done, all) candidates.

    Returns
    -------
    dict
        Plain values; also written to `FILE` of the campaign's folder.

    Raises
    ------
    UserError
        No candidates, or too few scores.
    """
    spec = campaign.spec
    wanted = candidates_of(spec)
    if not wanted:
        remedy = 'Add [[candidate]] with sensor = "Sentinel-1 IW GRDH", or sensor = "*" for all that fit.'
        raise SpecError(Problem("there are no candidates", remedy, file=str(spec.folder / SPEC_NAME)))
    found: dict[str, Any] = {"key": _key(spec), "worlds": worlds, "applications": {}}
    analyses = campaign.analyse_all()
    progress(0, len(wanted) * len(analyses))
    for done, analysis in enumerate(analyses):
        application = spec.application(analysis.application)
        one = _Comparer(campaign, analysis, application, sufficient, worlds, workers)
        rows = []
        for number, candidate in enumerate(wanted, start=1):
            rows.append(one.row(candidate))
            progress(done * len(wanted) + number, len(wanted) * len(analyses))
        rows.sort(key=one.place)
        found["applications"][analysis.application] = {**one.head(), "candidates": rows}
    found = dict(plain(found))
    draft = spec.folder / f".{FILE}.draft"
    draft.write_text(json.dumps(found, indent=1), encoding="utf-8")
    os.replace(draft, spec.folder / FILE)
    return found


def read_candidates(spec: CampaignSpec, analyses: Sequence[Analysis]) -> dict[str, Any] | None:
    """What was measured last; None where nothing was, of other candidates, or beside other optima than these."""
    try:
        found = json.loads((spec.folder / FILE).read_text(encoding="utf-8"))
        same = found["key"] == _key(spec) and all(
            _rounded(found["applications"][one.application]["settings"]) == _rounded(one.optimum.settings)
            for one in analyses
        )
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return dict(found) if same else None


def _key(spec: CampaignSpec) -> list[Any]:
    return [spec.spec_hash, [[one.name, dict(one.parameters)] for one in candidates_of(spec)]]


def _rounded(settings: Mapping[str, float | str]) -> dict[str, float | str]:
    return {name: float(f"{x:.6g}") if isinstance(x, float) else x for name, x in settings.items()}


class _Comparer:
    """One application's optimum, simulated once, and candidates beside it."""

    def __init__(
        self,
        campaign: Campaign,
        analysis: Analysis,
        application: ApplicationSpec,
        sufficient: float | None,
        worlds: int,
        workers: int,
    ) -> None:
        self.spec, self.analysis, self.application = campaign.spec, analysis, application
        self.campaign, self.workers = campaign, workers
        score = application.sufficient if sufficient is None else sufficient
        sign = sign_of(analysis.goal)
        relative = score is None
        self.rule = Sufficing(-sign * self.spec.stop.half_width if score is None else score, relative, sign)
        self.level = self.spec.stop.level
        kind = self.spec.stop.interval
        self.runs = {"prediction": 1.0, "prediction_mean": float(self.spec.stop.replicates)}.get(kind, math.inf)
        self.settings = analysis.optimum.settings
        self.optimum: FloatArray | None = None
        if self.spec.simulator is None:
            return
        cells = campaign.cells_of_ground()
        utility = tuple(u for u in task_of(self.spec, NO_RUN, self.settings).utilities if u[0] == application.name)
        made = bundle_tasks(self.spec, self.settings, cells, worlds + PILOT_WORLDS)
        made = [replace(task, utilities=utility) for task in made]
        self.tasks, self.pilots = made[: worlds * OCCASIONS], made[worlds * OCCASIONS :: OCCASIONS]
        self.base = instrument_of(made[0])
        self.optimum = self._simulated([self.base], self.tasks)[0]

    def head(self) -> dict[str, Any]:
        """What is said of the optimum and the target."""
        best = self.analysis.optimum
        return {
            "settings": dict(self.settings),
            "optimum": best.mean,
            "interval": asdict(best.whole),
            "simulated": None if self.optimum is None else float(self.optimum.mean()),
            "sufficient": self.rule.score,
            "relative": self.rule.relative,
            "runs": None if math.isinf(self.runs) else self.runs,
            "level": self.level,
            "unit": self.application.unit,
        }

    def place(self, row: Mapping[str, Any]) -> tuple[bool, float, float]:
        """What rows are sorted by: those not judged last, then the most probable first, then the best."""
        better = self.rule.sign * row.get("difference", 0.0)
        return row["how"] == "none", -row.get("probability", 0.0), -better

    def row(self, candidate: Candidate) -> dict[str, Any]:
        """The answer for one candidate."""
        sensor = candidate.sensor
        told: dict[str, Any] = {"name": candidate.name, "how": "none"}
        if sensor is not None:
            fields = _FIELDS[sensor.kind]
            told |= {"sensor": sensor.title, "status": sensor.status}
            told["recalled"] = [name for name in fields if sensor.resting(name) == "recalled"]
            told["assumed"] = ["noise"] if sensor.kind == "sar" and sensor.noise_rests == "assumed" else []
            told["recalled"] += ["noise"] if sensor.kind == "sar" and sensor.noise_rests == "recalled" else []
        try:
            at = self._in_region(candidate)
            if at is not None:
                return {**told, "how": "surface", **asdict(self._by_surface(at, candidate)), "settings": at}
            if self.optimum is None:
                raise ConfigurationError(Problem("its settings lie outside the region, and nothing can be simulated"))
            return {**told, "how": "simulation", **self._by_simulation(candidate, told)}
        except UserError as error:
            return {**told, "why": "; ".join(problem.message for problem in error.problems)}

    def _in_region(self, candidate: Candidate) -> dict[str, float | str] | None:
        """Its settings, where factors tell all of it and lie in the region; of named ones only without a simulator."""
        own = dict(candidate.parameters)
        if candidate.sensor is not None:
            if self.optimum is not None:
                return None
            own = {**_as_factors(self.spec, candidate), **own}
        if not set(own) <= set(self.spec.region.names):
            return None
        settings = {**self.settings, **own}
        point = self.spec.region.code([settings])
        return settings if self.spec.region.feasible(point)[0] else None

    def _by_surface(self, settings: Mapping[str, float | str], candidate: Candidate) -> Comparison:
        """What is expected by the surface; how one ground differs from it by simulations, where there are some."""
        analysis = self.analysis
        points = self.spec.region.code([settings, self.settings])
        terms, rng = analysis.posterior.term_draws, generator(self.spec.seed, 0, "candidates")
        sds = 0.0, analysis.optimum.prediction.half_width / 2.0 / math.sqrt(self.runs)
        if self.optimum is not None:
            own = self._simulated([self._own(candidate)], self.tasks)[0]
            whole = np.isfinite(own).all(axis=1) & np.isfinite(self.optimum).all(axis=1)
            if whole.sum() > 1:
                sds = future_sd((own - self.optimum)[whole], self.runs), future_sd(own[whole], self.runs)
        return by_surface(analysis.belief, analysis.scale, points, terms, self.rule, self.level, sds, rng)

    # -- simulated ------------------------------------------------------------------------------------------------

    def _by_simulation(self, candidate: Candidate, told: dict[str, Any]) -> dict[str, Any]:
        assert self.optimum is not None
        sensor = candidate.sensor
        base = self._nearest(candidate)
        days, offered = self._days(sensor, base)
        if sensor is None:
            places = [self._own(candidate)]
            days = places[0].days[0]
        else:
            cell = self._cell(candidate, base, days)
            at = sensor.incidences_deg if sensor.kind == "sar" else (0.0,)
            places = [Instrument((self._sensor(candidate, base, angle, cell),), (days,)) for angle in at]
            if offered is not None and sensor.resting("revisit_days") == "recalled":
                told["recalled"].append("revisit_days")
        for place in places:
            self._examine(place)
        middle = places[len(places) // 2]
        scores = self._simulated(places, self.tasks)
        whole = np.isfinite(scores).all(axis=(0, 2)) & np.isfinite(self.optimum).all(axis=1)
        if whole.sum() < 2:
            raise ConfigurationError(Problem("its simulations failed"))
        own, optimum = scores[:, whole], self.optimum[whole]
        result = compared(own, optimum, self.rule, self.level, self.runs)
        mixtures = dict(self._mixtures(middle))
        owed = []
        # One occasion in each world tells enough: what it changes is told against the same.
        for name, mixed in zip(mixtures, self._simulated(mixtures.values(), self.tasks[::OCCASIONS]), strict=True):
            if np.isfinite(mixed[whole]).all():
                alone = compared(mixed[None, whole], optimum[:, :1], self.rule, self.level, self.runs)
                owed.append({"property": name, "difference": alone.difference, "confidence": asdict(alone.confidence)})
        rows = [{**_place(place), "score": float(one.mean())} for place, one in zip(places, own, strict=True)]
        dates = {"used": list(days), "offered": offered} if days else None
        return {**asdict(result), "places": rows, "owed_to": owed, "dates": dates}

    def _simulated(self, instruments: Collection[Instrument], tasks: Sequence[SimulationTask]) -> FloatArray:
        """Scores (instruments, worlds, occasions)."""
        made = [one.task(task) for one in instruments for task in tasks]
        worlds = len({task.world for task in tasks})
        if not made:
            return np.empty((0, worlds, 1))
        scores = self.campaign.scores_of(made, self.application.name, self.workers, None)
        return scores.reshape(len(instruments), worlds, -1)

    def _nearest(self, candidate: Candidate) -> Sensor:
        """The optimum's sensor that is of the candidate's kind and nearest in frequency."""
        engine = candidate.sensor.engine if candidate.sensor is not None else _engine(self.base.sensors[0])
        own = [one for one in self.base.sensors if _engine(one) == engine]
        if not own:
            raise ConfigurationError(Problem("the optimum has no sensor of its kind"))
        wanted = own[0].frequency_ghz if candidate.sensor is None else candidate.sensor.values["frequency_ghz"]
        return min(own, key=lambda one: abs(math.log(one.frequency_ghz / wanted)))

    def _sensor(self, candidate: Candidate, base: Sensor, angle: float, cell_m: float | None) -> Sensor:
        """A named one at an incidence angle over the ground of ``base``, with the candidate's own parameters."""
        sensor, made = candidate.sensor, base
        assert sensor is not None
        if isinstance(base, RadarConfiguration):
            made = exchanged(base, radar_of(sensor, candidate.channels, angle, cell_m), PROPERTIES)
        else:
            # An aircraft sweeps as the campaign's does; the engine knows no conical scan.
            own = PROPERTIES if sensor.platform != "aircraft" else tuple(p for p in PROPERTIES if p != "angle")
            made = exchanged(base, radiometer_of(sensor, candidate.channels, cell_m), own)
        if not candidate.parameters:
            return made
        found: Sensor = ENGINES[sensor.engine].configure({**as_parameters(made), **candidate.parameters}, {})
        return found

    def _own(self, candidate: Candidate) -> Instrument:
        """The optimum with the parameters of a candidate that has no other name."""
        task, own = task_of(self.spec, NO_RUN, self.settings), candidate.parameters
        fixed = {name: value for name, value in task.fixed.items() if name not in own}
        return instrument_of(replace(task, settings={**task.settings, **own}, fixed=fixed))

    def _days(self, sensor: NamedSensor | None, base: Sensor) -> tuple[tuple[float, ...], int | None]:
        """Dates on which a sensor looks, and how many it offers between the optimum's first and last.

        It passes every so many days, first half of that after the season's first day, which is the mean over all
        phases; as many passes are used as the campaign would fly at most.
        """
        wanted = self.base.days[self.base.sensors.index(base)]
        repeat = None if sensor is None or sensor.platform == "aircraft" else sensor.values.get("revisit_days")
        if not wanted or repeat is None:
            return wanted, None
        dates = [factor for factor in self.spec.factors if factor.name.rpartition(".")[2] == "dates"]
        most = max((int(span(one)[1]) for one in dates if not isinstance(one, CategoricalFactor)), default=len(wanted))
        first, last = wanted[0], wanted[-1]
        passes = np.arange(first + 0.5 * repeat, max(last, first + 0.5 * repeat) + 1e-9, repeat)
        passes = np.minimum(passes, LAST_DAY)
        kept = passes[np.unique(np.linspace(0, len(passes) - 1, min(most, len(passes))).round().astype(int))]
        return tuple(float(day) for day in kept), len(passes)

    def _cell(self, candidate: Candidate, base: Sensor, days: tuple[float, ...]) -> float | None:
        """Side of the cell [m]: that of the campaign, at least the sensor's; where it is a factor, what scores best."""
        sensor = candidate.sensor
        assert sensor is not None
        angle = sensor.incidences_deg[len(sensor.incidences_deg) // 2]
        own = sensor.cell_m(angle)
        factor = next((f for f in self.spec.factors if f.name.rpartition(".")[2] == "resolution"), None)
        if factor is None or isinstance(factor, CategoricalFactor):
            return max(own, base.resolution_m)
        low, high = span(factor)
        sizes = [size for size in (max(own, low) * more for more in _COARSER) if size <= max(high, own)]
        tried = [Instrument((self._sensor(candidate, base, angle, size),), (days,)) for size in sizes]
        self._examine(tried[0])
        scores = self.rule.sign * self._simulated(tried, self.pilots)
        means = np.nan_to_num(scores.mean(axis=(1, 2)), nan=-np.inf)
        return sizes[int(np.argmax(means))]

    def _mixtures(self, middle: Instrument) -> Iterator[tuple[str, Instrument]]:
        """The optimum with one property of the candidate, for each in which they differ and that can be built."""
        other, days = middle.sensors[0], middle.days[0]
        for name in PROPERTIES:
            if name == "angle" and not isinstance(other, RadarConfiguration):
                continue  # an orbit's speed would smear what the campaign's scan does not
            try:
                sensors = tuple(
                    exchanged(one, other, (name,)) if type(one) is type(other) else one  # type: ignore[type-var]
                    for one in self.base.sensors
                )
            except ConfigurationError:
                continue
            if name == "frequency" and len(sensors) > 1:
                sensors = sensors[:1]  # one band in place of a set
            mixed = Instrument(sensors, self.base.days[: len(sensors)])
            if _facts(mixed) != _facts(self.base):
                yield name, mixed
        if days and any(own != days for own in self.base.days):
            yield "dates", Instrument(self.base.sensors, tuple(days for _ in self.base.days))

    def _examine(self, instrument: Instrument) -> None:
        """Refuse what cannot be simulated over the scene, with the reason."""
        task = instrument.task(self.tasks[0])
        scene, _ = ground_of(task)
        for one in task.acquisitions:
            ENGINES[one.engine].examine(scene, one.sensor, task.scattering(one.engine), one.visit.day)


_NO_IMAGE: Final = {"prf_hz", "pulse_length_us", "antenna_gain_db", "peak_power", "speed_m_s", "antenna_limit_m"}


def _facts(instrument: Instrument) -> list[dict[str, Any]]:
    """What images are made of, to six digits: the noise in place of pulses, power and gain."""
    found: list[dict[str, Any]] = []
    for sensor in instrument.sensors:
        told = {name: value for name, value in as_parameters(sensor).items() if name not in _NO_IMAGE}
        noise = round(noise_equivalent_db(sensor), 5) if isinstance(sensor, RadarConfiguration) else 0.0
        found.append({**_rounded(told), "noise": noise})
    return found


def _as_factors(spec: CampaignSpec, candidate: Candidate) -> dict[str, float | str]:
    """What a named sensor says of the factors, at the middle of its swath and in a cell that the region holds."""
    sensor = candidate.sensor
    assert sensor is not None
    angle = sensor.incidences_deg[len(sensor.incidences_deg) // 2]
    numeric = [factor for factor in spec.factors if not isinstance(factor, CategoricalFactor)]
    low = next((span(factor)[0] for factor in numeric if factor.name == "resolution"), None)
    is_radar, channels = sensor.kind == "sar", candidate.channels
    told = as_parameters(radar_of(sensor, channels, angle, low) if is_radar else radiometer_of(sensor, channels, low))
    for factor in spec.factors:
        if factor.name == "polarization" and isinstance(factor, CategoricalFactor):
            own = set(candidate.channels.split("+"))
            told["polarization"] = next((x for x in factor.levels if set(x.split("+")) == own), candidate.channels)
    return {name: told[name] for name in spec.region.names if name in told}


def _place(place: Instrument) -> dict[str, Any]:
    """Where in the swath, and with which cell, looks and noise."""
    sensor = place.sensors[0]
    found: dict[str, Any] = {"cell_m": sensor.resolution_m}
    if isinstance(sensor, RadarConfiguration):
        theta = np.array([sensor.centre_incidence_rad])
        found["incidence_deg"] = float(np.rad2deg(theta[0]))
        found["looks"] = float(sensor.looks_used(theta)[0])
        found["noise_db"] = noise_equivalent_db(sensor)
    return found
