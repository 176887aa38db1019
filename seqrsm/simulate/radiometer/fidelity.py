"""The fidelity planner's view of a scanning radiometer."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Final

import numpy as np
from scipy.ndimage import maximum_filter1d

from seqrsm.arrays import FloatArray
from seqrsm.scattering.emissivity import MOISTURE_NODES
from seqrsm.scene.scene import Scene
from seqrsm.scene.statistics import PYRAMID, SceneStatistics
from seqrsm.sensor.radiometer import RadiometerConfiguration
from seqrsm.sensor.scan import BEAM_STEPS_A_WIDTH
from seqrsm.simulate import bounds
from seqrsm.simulate.fidelity import (
    Effect,
    Ground,
    Plan,
    Rung,
    RungPlan,
    choose,
    effect,
    full_draws,
    sampled_effect,
    smallest,
)
from seqrsm.simulate.radiometer.prm import Meeting
from seqrsm.simulate.radiometer.sample import BEAM_POINTS

_NS_A_CELL, _NS_A_SWEEP, _NS_A_FOOTPRINT, _NS_A_DRAW, _NS_A_RUN = 44.0, 3.4, 1000.0, 120.0, 5e6
_NS_A_POINT, _NS_A_FLAT_POINT, _NS_A_CHANNEL, _NS_A_LABEL, _NS_A_SAMPLE = 30.0, 18.0, 5.0, 500.0, 4e6

_BEAM_REACH: Final = 2.4
"""Widths about a footprint in which a border counts: twice those of `bounds.quadrature_error`."""

_SPREAD_ON_BORDERS: Final = 0.25
"""Standard deviation of the share of a beam beyond a border that passes anywhere within its reach: 0.38 if straight."""

_PLACES: Final = 24
"""Places from nadir to the edge at which the steepness of the emissivity curves is looked up."""

_NO_STRIPS: Final = "beams reach over several lines, so that a strip needs more ground than it scores"

PERCENT_CORRECT: Final = "percent_correct"


def plan_radiometer(
    scene: Scene,
    statistics: SceneStatistics,
    radiometer: RadiometerConfiguration,
    met: Meeting,
    *,
    tolerance: float,
    utilities: Sequence[str],
    pixelwise: bool,
    fidelity: str = "auto",
    widening: Mapping[str, float] | None = None,
) -> Plan:
    """Choose the rung for one run of a radiometer.

    Parameters
    ----------
    scene, statistics, radiometer
        The run's.
    met : Meeting
        Of `seqrsm.simulate.radiometer.prm.meet_radiometer`.
    tolerance : float
        Accepted error [percent correct, or percent of moisture].
    utilities : sequence of str
        What is scored: the bound is the largest of theirs.
    pixelwise : bool
        Whether all of them are means over pixels.
    fidelity, widening
        As in `seqrsm.simulate.fidelity.choose`.
    """
    view = _View(scene, statistics, radiometer, met, utilities)
    relief = view.relief_effects(tolerance)
    ground = view.ground()
    rungs: list[RungPlan] = []
    common = ground.refusal() if pixelwise else "the utility needs the whole image"
    common = common or ("the report's own simulation has no noise" if radiometer.mode == "report" else "")
    hidden = view.blocked_effect(tolerance)
    beams = [view.points_effect(n, tolerance) for n in BEAM_POINTS]
    choices: tuple[tuple[Rung, tuple[Effect, ...]], ...] = (("F0", (hidden, *relief)), ("F2", (hidden,)))
    for rung, left in choices:
        found = [
            view.points_plan(rung, (*left, beam), ground, tolerance, n)
            for n, beam in zip(BEAM_POINTS, beams, strict=True)
        ]
        good = [plan for plan in found if plan.bound <= tolerance]
        best = min(good, key=lambda plan: plan.effort) if good else min(found, key=lambda plan: plan.bound)
        rungs.append(replace(best, refused=common))
    rungs.insert(1, RungPlan("F1", refused=_NO_STRIPS))
    draws = full_draws(ground, tolerance)
    n_all = ground.n_rows * ground.n_columns
    quiet = ground.draw_error(n_all, draws)
    rungs.append(
        RungPlan(
            "F3", 0.0, quiet, view.effort(draws * _NS_A_DRAW), ground.n_columns, ground.n_rows, draws, refused=common
        )
    )
    rungs.append(
        RungPlan(
            "F4",
            0.0,
            0.0,
            view.effort(_NS_A_FOOTPRINT),
            ground.n_columns,
            ground.n_rows,
            scatter=ground.draw_error(n_all, 1),
        )
    )
    beam = view.points_effect(rungs[2].points, tolerance)
    seen = sampled_effect(rungs[2], ground, tolerance, "ground between the footprints", "lines")
    once = ground.draw_error(n_all, 1)
    drawn = effect("one draw of noise", once, tolerance, "scatter of the whole image's score; F3 integrates it out")
    effects = (hidden, *relief, beam, seen, drawn, *view.other_effects(tolerance))
    return choose(rungs, effects, tolerance, fidelity, widening)


class _View:
    """The numbers of one radiometer over one scene that the tests need."""

    def __init__(
        self,
        scene: Scene,
        statistics: SceneStatistics,
        radiometer: RadiometerConfiguration,
        met: Meeting,
        utilities: Sequence[str],
    ) -> None:
        self.scene, self.statistics, self.radiometer, self.met = scene, statistics, radiometer, met
        self.utilities = utilities
        self.warm_k = radiometer.temperature_low_k
        self.edge = math.atan(float(np.abs(met.frame.across_m).max()) / met.frame.height_m)
        north_south = met.frame.quarter_turns % 2 == 0
        self.step = statistics.step_slope_north if north_south else statistics.step_slope_east
        self.across = statistics.rms_slope_north if north_south else statistics.rms_slope_east
        self.along = statistics.rms_slope_east if north_south else statistics.rms_slope_north
        self.kept = np.array([statistics.category_fractions[name] for name in scene.categories])
        self.tested = [share for share in statistics.scored_fractions.values() if share > 0.0]

    @cached_property
    def slope_of_curves(self) -> FloatArray:
        """Change of each category's brightness with angle, the worst channel (n_places, n_categories) [K/deg].

        At places equally far apart on the ground from nadir to the edge, the steepest within 2 degrees of each: what
        many places give is their mean.
        """
        changes = np.max([np.abs(np.diff(look.emissivity, axis=2)).max(axis=1) for look in self.met.lookups], axis=0)
        steepest = maximum_filter1d(changes, 5, axis=1, mode="nearest")
        far = math.tan(self.edge) * (np.arange(_PLACES) + 0.5) / _PLACES
        degree = np.minimum(np.rad2deg(np.arctan(far)).astype(np.int64), changes.shape[1] - 1)
        return np.asarray(self.warm_k * steepest[:, degree].T)

    @cached_property
    def spread_k(self) -> FloatArray:
        """Least scatter of each category's footprints [K]."""
        nedt = float(self.radiometer.nedt_k(self.warm_k))
        field = self.warm_k * np.min([look.field_sd for look in self.met.lookups], axis=0)
        return np.asarray(np.sqrt(field**2 + nedt**2 + (0.5 * self.radiometer.temperature_field_sd_k) ** 2))

    @cached_property
    def sensitivity_k(self) -> float:
        """Change of brightness with a percent of moisture, the least over its range [K]."""
        last = math.ceil(math.degrees(self.edge))
        found = []
        for look in self.met.lookups:
            if look.moist.any() and look.emissivity.shape[1] > 1:
                change = np.diff(look.emissivity[look.moist][:, :, :last], axis=1)
                found.append(np.abs(change / (100.0 * np.diff(MOISTURE_NODES)[:, None])).mean())
        return self.warm_k * float(max(found, default=0.0))

    def shifted(self, shift_k: FloatArray | float) -> float:
        """Largest change of any score that a shift of each category's brightness makes."""
        found = [0.0]
        if PERCENT_CORRECT in self.utilities:
            found.append(self.percent(shift_k))
        if any(name != PERCENT_CORRECT for name in self.utilities):
            found.append(self.moisture(shift_k))
        return max(found)

    def percent(self, shift_k: FloatArray | float) -> float:
        """Percent of footprints at most that a shift of each category's brightness moves into another class.

        (n_categories,) or, at places equally far apart on the ground, (n_places, n_categories).
        """
        return 100.0 * float((np.atleast_2d(bounds.shift_bound(shift_k, self.spread_k)) @ self.kept).mean())

    def moisture(self, shift_k: FloatArray | float) -> float:
        """Percent of moisture that a shift of each category's brightness looks like."""
        least = self.sensitivity_k
        shifts = np.atleast_2d(np.broadcast_to(shift_k, np.broadcast_shapes(np.shape(shift_k), self.kept.shape)))
        return math.sqrt(float(np.square(shifts @ self.kept).mean())) / least if least > 0.0 else math.inf

    def blocked_effect(self, tolerance: float) -> Effect:
        """What F0 and F2 leave out: ground that hides other ground."""
        top = self.statistics.high_m - self.statistics.low_m
        grazing = (self.met.frame.height_m - top) / max(float(np.abs(self.met.frame.across_m).max()), 1.0)
        seen = self.step <= grazing
        share = 0.0
        if not seen:
            rare = min(2.0 * (self.across[0] / grazing) ** 2, 1.0) if grazing > 0.0 else 1.0
            share = 100.0 * max(bounds.smith_shadow(self.across[0], self.edge), rare)
        text = f"steps up to {self.step:.3g}, rays descend by {grazing:.3g}"
        return effect("blocked ground", share, tolerance, text, proven=seen)

    def relief_effects(self, tolerance: float) -> tuple[Effect, ...]:
        """What F0 leaves out besides."""
        slope, top = self.slope_of_curves, self.statistics.high_m - self.statistics.low_m
        tilt = self.tilt_k(self.radiometer.resolution_m)
        text = f"rms slope over a footprint: {float((tilt @ self.kept).mean()):.2g} K"
        found = [effect("local incidence", self.shifted(tilt), tolerance, text)]
        lift = math.degrees(0.5 * top / self.met.frame.height_m * math.sin(self.edge) * math.cos(self.edge)) * slope
        text = f"{top:.0f} m of relief: {float((lift @ self.kept).mean()):.2g} K"
        found.append(effect("angle of raised ground", self.shifted(lift), tolerance, text))
        return tuple(found)

    def tilt_k(self, width_m: float) -> FloatArray:
        """What the slopes of ground averaged over a width change of each category's brightness [K]."""
        level = max(i for i, size in enumerate(PYRAMID) if i == 0 or size * self.scene.cell_m <= width_m)
        return math.degrees(math.hypot(self.across[level], self.along[level])) * self.slope_of_curves

    def points_effect(self, points: int, tolerance: float) -> Effect:
        """What few points for a beam cost.

        A footprint on a border of two covers is spread over the difference of the two by the borders' places, at least
        `_SPREAD_ON_BORDERS` of it, while its points err by `bounds.quadrature_error` of it: of the difference itself
        the bound does not know. Fields of one cover and slopes err as pure ground does.
        """
        width = self.radiometer.resolution_m
        mixed = bounds.mixed_share(self.statistics.boundary_density_1_m, width, width)
        part = bounds.quadrature_error(points)
        lines = _BEAM_REACH * width * self.statistics.field_boundary_density_1_m
        fields = (
            part * np.sqrt(2.0 * lines) * self.warm_k * np.min([look.field_sd for look in self.met.lookups], axis=0)
        )
        # Only what the slopes vary by within a footprint is seen by few points.
        tilt = np.sqrt(np.maximum(self.tilt_k(0.0) ** 2 - self.tilt_k(width) ** 2, 0.0) / points)
        pure = np.hypot(fields, tilt)
        found = [0.0]
        if PERCENT_CORRECT in self.utilities:
            found.append(100.0 * mixed * float(bounds.shift_bound(part, _SPREAD_ON_BORDERS)) + self.percent(pure))
        if any(name != PERCENT_CORRECT for name in self.utilities):
            found.append(self.moisture(np.hypot(pure, math.sqrt(2.0 * mixed) * part * self.contrast_k)))
        text = f"{points} points stand for the beam, {100 * mixed:.0f} % mixed footprints"
        return effect("beam by points", max(found), tolerance, text)

    def points_plan(
        self, rung: Rung, left: Sequence[Effect], ground: Ground, tolerance: float, points: int
    ) -> RungPlan:
        """F0 or F2 with so many points for a beam, ``left`` being what it leaves out."""
        bias = sum(e.bound for e in left)

        def effort(rows: int, columns: int, draws: int) -> float:
            return self.points_effort(rows * columns, draws, points, relief=rung != "F0")

        size = smallest(ground, tolerance - bias, effort, square=True)
        return size.plan(rung, bias, points=points, left_out=tuple(e.name for e in left if e.verdict != "exact"))

    @cached_property
    def contrast_k(self) -> float:
        """Standard deviation of brightness among the covers [K]."""
        mean = np.mean([look.emissivity[:, :, 0].mean(axis=1) for look in self.met.lookups], axis=0)
        centre = float(mean @ self.kept)
        return self.warm_k * math.sqrt(float(np.square(mean - centre) @ self.kept))

    def other_effects(self, tolerance: float) -> tuple[Effect, ...]:
        """Effects that every rung heeds, for the record."""
        air, height = self.met.air, self.met.frame.height_m
        least = min(float(look.emissivity[self.kept > 0.0].min()) for look in self.met.lookups)
        nadir, far = (float(air.upwelling_k(x, height) + air.transmission(x, height) * 280.0) for x in (0.0, self.edge))
        sky = (1.0 - least) * float(air.sky_k(self.edge))
        planck = 0.5 * self.radiometer.planck_offset_k
        nedt = float(self.radiometer.nedt_k(self.warm_k))
        mixed = bounds.mixed_share(self.statistics.boundary_density_1_m, *(2 * [self.radiometer.resolution_m]))
        rows = (
            ("receiver noise", self.shifted(nedt), f"{nedt:.2g} K; drawn"),
            ("air over the sweep", self.shifted(abs(far - nadir)), f"{abs(far - nadir):.2g} K; in all rungs"),
            ("reflected sky", self.shifted(sky), f"{sky:.2g} K; in all rungs"),
            ("Planck's law", self.shifted(planck), f"{planck:.2g} K; by the configuration, in all rungs"),
            ("several covers in a footprint", 100.0 * mixed, "by the density of borders; in all rungs"),
        )
        found = [effect(name, bound, tolerance, text) for name, bound, text in rows]
        text = "single precision changes a footprint's temperature by a millionth"
        found.append(effect("double precision", 0.0, tolerance, text, proven=True))
        return tuple(found)

    def taught(self) -> int:
        """Parameters that a sample teaches: of the retrieval's polynomial, or half of those of the classes."""
        d, found = len(self.met.lookups), 0
        if PERCENT_CORRECT in self.utilities:
            found = bounds.taught_by_pixels(int((self.kept > 0.0).sum()), d, covariates=1)
        if any(name != PERCENT_CORRECT for name in self.utilities):
            found = max(found, 2 + 3 * d)
        return found

    def ground(self) -> Ground:
        """Extent and correlation, for the sampling error."""
        scan, frame = self.met.scan, self.met.frame
        width = self.radiometer.resolution_m
        spread = 0.0
        if PERCENT_CORRECT in self.utilities:
            spread = 50.0
        if any(name != PERCENT_CORRECT for name in self.utilities):
            spread = max(spread, 100.0 * self.radiometer.soil_moisture_field_sd)
        return Ground(
            correlation_m=bounds.correlation_length_m(self.statistics.field_boundary_density_1_m),
            mixed=bounds.mixed_share(self.statistics.field_boundary_density_1_m, width, width),
            across_m=len(frame.elevation_m) * frame.cell_m,
            along_m=scan.n_lines * scan.advance_m,
            n_rows=len(scan.look_rad),
            n_columns=scan.n_lines,
            spread=spread,
            drawn=self.drawn(),
            scored=max(self.statistics.scored_fraction, 1e-9),
            teaching=bounds.teaching_factor(self.tested, covariates=1),
            rarest=min(self.tested, default=1.0) if PERCENT_CORRECT in self.utilities else 1.0,
            taught=self.taught(),
        )

    def drawn(self) -> float:
        """Part of the footprints' variance that noise has, at most; the rest is that of fields and borders.

        Where several fields share a footprint their mean varies less than each does.
        """
        width = self.radiometer.resolution_m
        fields = 1.0 + bounds.crossings(self.statistics.field_boundary_density_1_m, width, width)
        noise = float(self.radiometer.nedt_k(self.warm_k))
        own = np.sqrt(np.maximum(self.spread_k**2 - noise**2, 0.0) / fields)
        pairs = zip(own, self.kept, strict=True)
        return math.fsum(float(k) * bounds.undecided_share(noise, float(s)) for s, k in pairs if k > 0.0)

    def effort(self, footprint_ns: float) -> float:
        """Estimated time of the whole image, noise and score of a footprint taking so many nanoseconds [s]."""
        scan = self.met.scan
        footprints = len(scan.look_rad) * scan.n_lines
        reach_m = (len(scan.along) - 1) / BEAM_STEPS_A_WIDTH * self.radiometer.resolution_m
        sweeps = min(reach_m / scan.sweep_advance_m, scan.n_sweeps)
        cells = self.met.frame.elevation_m.size
        return 1e-9 * (_NS_A_RUN + cells * (_NS_A_CELL + sweeps * _NS_A_SWEEP) + footprints * footprint_ns)

    def points_effort(self, footprints: int, draws: int, points: int, *, relief: bool) -> float:
        """Estimated time of single footprints [s]."""
        point = (_NS_A_POINT if relief else _NS_A_FLAT_POINT) + _NS_A_CHANNEL * len(self.met.lookups)
        return 1e-9 * (_NS_A_SAMPLE + footprints * (points * point + _NS_A_LABEL + draws * _NS_A_DRAW))
