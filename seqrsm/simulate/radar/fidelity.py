"""The fidelity planner's view of a side-looking radar: what its image owes to relief, noise, mixed cells."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Final

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.constants import EARTH_RADIUS_M
from seqrsm.scene.scene import Scene
from seqrsm.scene.statistics import PYRAMID, SceneStatistics
from seqrsm.sensor.earth import range_geometry
from seqrsm.sensor.radar import RadarConfiguration
from seqrsm.simulate import bounds
from seqrsm.simulate.fidelity import (
    RUNGS,
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
from seqrsm.simulate.radar.frame import make_frame

if TYPE_CHECKING:
    from seqrsm.scattering.sigma0 import Sigma0Lookup

_SKEW: Final = 0.133
"""Distance of the chi-square law of N looks from a normal one x sqrt(N): skewness / (6 sqrt(2 pi))."""

_BOX_FOR_BEAM: Final = 0.24
"""Half of the area between a beam's pattern and a box of its width."""

_SPREAD_ON_BORDERS: Final = 0.25
"""Least standard deviation of a border's share of a pixel over the places where it may lie; 0.29 if straight."""

_NS_A_RUN, _NS_A_CELL, _NS_A_SHOWN, _NS_A_NAMED = 3e6, 2.8, 40.0, 65.0
_NS_A_GATHERED, _NS_A_POINT, _NS_A_DRAW, _NS_A_CLASS = 1.5, 5.0, 30.0, 9.0
_HALO: Final = 3.5
"""Cells on both sides of a strip that are made and not seen."""

_LEAST_SHARE: Final = 0.001
_POINTWISE: Final = ("linear", "square_law", "saturation", "compression")


def plan_radar(
    scene: Scene,
    statistics: SceneStatistics,
    radar: RadarConfiguration,
    lookups: Sequence[Sigma0Lookup],
    *,
    tolerance: float,
    pixelwise: bool,
    fidelity: str = "auto",
    widening: Mapping[str, float] | None = None,
) -> Plan:
    """Choose the rung for one run of a radar whose utility is a share of pixels in percent.

    Parameters
    ----------
    scene : Scene
    statistics : SceneStatistics
        Of the same scene.
    radar : RadarConfiguration
    lookups : sequence of Sigma0Lookup
        Backscatter of the scene's categories, one for each channel.
    tolerance : float
        Accepted error [percent].
    pixelwise : bool
        Whether every utility asked for is a mean over pixels.
    fidelity, widening
        As in `seqrsm.simulate.fidelity.choose`.

    Returns
    -------
    Plan
    """
    common = _why_not(radar, pixelwise)
    if radar.scan != "slar":
        refused = [RungPlan(rung, refused=common) for rung in RUNGS[:-1]]
        text = "ranges and bearings of the whole scene turn about one point: every effect is simulated"
        turning = (effect("turning antenna", math.inf, tolerance, text),)
        return choose([*refused, RungPlan("F4")], turning, tolerance, fidelity, widening)
    view = _View(scene, statistics, radar, lookups)
    relief = view.relief_effects(tolerance)
    ground = view.ground()
    common = common or ground.refusal()
    n_all = ground.n_rows * ground.n_columns
    rungs = []
    flat = common or _why_not_flat(radar)
    bias = min(sum(e.bound for e in relief), 100.0)
    size = smallest(ground, tolerance - bias, view.flat_effort, square=True)
    rungs.append(size.plan("F0", bias, left_out=tuple(e.name for e in relief), refused=flat))
    factors = [factor for factor in PYRAMID[1:] if not view.coarse_refusal(factor)] or PYRAMID[1:2]
    coarser = [view.strips_plan("F1", ground, tolerance, factor, common) for factor in factors]
    within = [plan for plan in coarser if plan.bound <= tolerance]
    if within:
        rungs.append(min(within, key=lambda plan: plan.effort))
    else:
        rungs.append(min(coarser, key=lambda plan: plan.bound))
    rungs.append(view.strips_plan("F2", ground, tolerance, 1, common))
    coarse = view.coarse_effect(rungs[1].coarse, tolerance)
    draws = full_draws(ground, tolerance)
    integrated = ground.draw_error(n_all, draws)
    whole_effort = view.effort(1.0, n_all, draws, 1)
    rungs.append(RungPlan("F3", 0.0, integrated, whole_effort, ground.n_columns, ground.n_rows, draws, refused=common))
    whole_effort, once = view.whole_effort(n_all), ground.draw_error(n_all, 1)
    rungs.append(RungPlan("F4", 0.0, 0.0, whole_effort, ground.n_columns, ground.n_rows, scatter=once))
    seen = sampled_effect(rungs[2], ground, tolerance, "ground between the strips", "columns of pixels")
    drawn = effect("one draw of fading", once, tolerance, "scatter of the whole image's score; F3 integrates it out")
    effects = (*relief, coarse, seen, drawn, *view.other_effects(tolerance))
    return choose(rungs, effects, tolerance, fidelity, widening)


def _why_not(radar: RadarConfiguration, pixelwise: bool) -> str:
    """Why every rung below the top is closed."""
    if not pixelwise:
        return "the utility needs the whole image"
    if radar.scan != "slar":
        return "the antenna turns"
    if radar.targets_file:
        return "cultural targets stand in the scene"
    if radar.heading_deg % 90.0 != 0.0:
        return "the heading is not along the grid"
    if radar.receiver not in _POINTWISE:
        return "the receiver's gain depends on neighbouring pixels"
    if radar.processing:
        return "the image is processed by a function of the user's"
    return ""


def _why_not_flat(radar: RadarConfiguration) -> str:
    if radar.range_format != "ground":
        return "the image is in slant range"
    if radar.aperture == "real" or radar.finer_pixels:
        return "the beam is wider than a pixel"
    if radar.receiver != "linear" or radar.adc_bits:
        return "the receiver is not linear"
    if radar.binning != "overlap":
        return "the report's nearest-element binning has a ripple of its own"
    return ""


class _View:
    """The numbers of one radar over one scene that the tests need."""

    def __init__(
        self,
        scene: Scene,
        statistics: SceneStatistics,
        radar: RadarConfiguration,
        lookups: Sequence[Sigma0Lookup],
    ) -> None:
        self.scene, self.statistics, self.radar, self.lookups = scene, statistics, radar, lookups
        frame = make_frame(scene, radar, "float32")
        own = slice(frame.pad_near, frame.pad_near + frame.n_rows)
        ends = frame.ground_range_m[own][[0, -1]]
        self.geometry = range_geometry(ends, frame.height_m, frame.curved)
        self.height_m, self.cell_m, self.n_rows = frame.height_m, frame.cell_m, frame.n_rows
        self.m = int(frame.elevation_m.shape[1])
        # Rows of the frame run along the flight; the slopes towards the radar are those across it.
        north_south = frame.quarter_turns % 2 == 0
        self.step = statistics.step_slope_north if north_south else statistics.step_slope_east
        across, along = statistics.rms_slope_north, statistics.rms_slope_east
        self.across, self.along = (across, along) if north_south else (along, across)
        self.kept = np.array([statistics.category_fractions[name] for name in scene.categories])
        self.tested = [share for share in statistics.scored_fractions.values() if share > 0.0]

    @property
    def theta(self) -> FloatArray:
        """Incidence angle at the near and the far edge [rad]."""
        return self.geometry.incidence_rad

    @cached_property
    def slope_of_curves(self) -> FloatArray:
        """Steepest change of each category's sigma0 over the swath, the worst channel [dB/deg]."""
        low, high = np.rad2deg(self.theta)
        k0, k1 = max(int(low) - 2, 0), min(int(high) + 3, 90)
        found = []
        for lookup in self.lookups:
            curve = 10.0 * np.log10(np.maximum(lookup.sigma0[:, k0 : k1 + 1], 1e-12))
            found.append(np.abs(np.diff(curve, axis=1)).max(axis=1))
        return np.asarray(np.max(found, axis=0))

    @cached_property
    def spread_db(self) -> FloatArray:
        """Least scatter of each category's pixels [dB]: among fields, and of fading."""
        looks = float(self.radar.looks_used(self.theta).max())
        fading = 0.0 if self.radar.fading == "none" else bounds.DB_OF_FADING**2 / looks
        field = np.min([lookup.field_sd_db for lookup in self.lookups], axis=0)
        return np.asarray(np.sqrt(field**2 + fading))

    def shifted(self, shift_db: FloatArray | float) -> float:
        """Percent of pixels at most that a shift of each category's power moves into another class."""
        return 100.0 * float(bounds.shift_bound(shift_db, self.spread_db) @ self.kept)

    def pixel_slope(self) -> float:
        """Root-mean-square range slope at the scale of a pixel."""
        level = max(i for i, size in enumerate(PYRAMID) if i == 0 or size * self.cell_m <= self.radar.pixel_spacing_m)
        return self.across[level]

    def relief_effects(self, tolerance: float) -> tuple[Effect, ...]:
        """What F0 leaves out."""
        theta, slope = self.theta, self.slope_of_curves
        top = self.statistics.high_m - self.statistics.low_m
        grazing = (self.height_m - top) / float(self.geometry.ground_range_m[1])
        near_tan = math.tan(float(theta[0]))
        rms = self.across[0]
        hidden = self.step <= grazing
        if hidden:
            shadow, text = 0.0, f"no step of the ground exceeds {self.step:.3g}, rays descend by {grazing:.3g}"
        else:
            # Steep steps are rarer than (rms / limit)**2 whatever their law; Smith's law is that of Gaussian slopes.
            shadow = 100.0 * max(bounds.smith_shadow(rms, float(theta[1])), _rare(rms, grazing))
            text = f"rms range slope {rms:.3g} at {math.degrees(theta[1]):.0f} deg, rays descend by {grazing:.3g}"
        effects = [effect("cast shadow", shadow, tolerance, text, proven=hidden)]
        ordered = self.step < near_tan
        if ordered:
            over, text = 0.0, f"no step of the ground exceeds tan(incidence) = {near_tan:.3g} at near range"
        else:
            over = 100.0 * _rare(rms, near_tan)
            text = f"steps up to {self.step:.3g} against tan(incidence) = {near_tan:.3g} at near range"
        effects.append(effect("layover", over, tolerance, text, proven=ordered))
        s, cot = self.pixel_slope(), 1.0 / near_tan
        tilt = s * (np.rad2deg(1.0) * slope + bounds.DB_OF_FADING * cot)
        text = f"rms slope {s:.3g} over a pixel: {float(tilt @ self.kept):.2g} dB"
        effects.append(effect("local incidence", self.shifted(tilt), tolerance, text))
        reach = float(self.geometry.slant_range_m[0])
        own = 0.5 * top / reach * (4.0 * bounds.DB_OF_FADING * math.cos(theta[0]) + np.rad2deg(1.0) * slope)
        text = f"{top:.0f} m of relief at {reach / 1000.0:.3g} km: {float(own @ self.kept):.2g} dB"
        effects.append(effect("own range and angle of raised ground", self.shifted(own), tolerance, text))
        return tuple(effects)

    def strips_plan(self, rung: Rung, ground: Ground, tolerance: float, factor: int, refused: str) -> RungPlan:
        """F1 or F2: strips of the image, on cells so many times wider."""
        left = () if factor == 1 else (self.coarse_effect(factor, tolerance),)
        bias = min(sum(e.bound for e in left), 100.0)

        def effort(r: int, c: int, d: int) -> float:
            return self.effort(c / ground.n_columns, r * c, d, factor)

        size = smallest(ground, tolerance - bias, effort, square=False)
        names = tuple(e.name for e in left)
        names += ("ground between the strips",) if size.columns < ground.n_columns else ()
        refused = refused or (self.coarse_refusal(factor) if factor > 1 else "")
        return size.plan(rung, bias, coarse=factor, left_out=names, refused=refused)

    def coarse_effect(self, factor: int, tolerance: float) -> Effect:
        """What F1 leaves out.

        Of the borders in a pixel only every so many-th cell tells: an error of their place, beside the spread of the
        places themselves, so that the difference of the categories does not matter.
        """
        level = PYRAMID.index(factor)
        lost = [max(rms[0] ** 2 - rms[level] ** 2, 0.0) for rms in (self.across, self.along)]
        cot = 1.0 / math.tan(float(self.theta[0]))
        shift = np.array([bounds.aggregation_shift_db(float(g), cot, *lost) for g in self.slope_of_curves])
        shadows = [bounds.smith_shadow(self.across[k], float(self.theta[1])) for k in (0, level)]
        cells = max((self.radar.pixel_spacing_m / (factor * self.cell_m)) ** 2, 1.0)
        place = bounds.quadrature_error(cells)
        mixed = 100.0 * self.mixed() * float(bounds.shift_bound(place, _SPREAD_ON_BORDERS))
        bound = self.shifted(shift) + 100.0 * abs(shadows[0] - shadows[1]) + mixed
        text = (
            f"{factor} x {factor} cells as one: {float(shift @ self.kept):.2g} dB of slope, {mixed:.2g} % for the "
            f"borders in a pixel of {cells:.3g} such cells"
        )
        return effect("detail below some cells", bound, tolerance, text)

    def coarse_refusal(self, factor: int) -> str:
        """Why the coarser data base cannot be used."""
        if factor * self.cell_m > 0.5 * self.radar.pixel_spacing_m:
            return f"a pixel would hold fewer than 2 x 2 cells of a data base {factor} times coarser"
        if min(self.scene.shape) < 8 * factor:
            return "the data base is too small"
        if self.radar.texture_db > 0.0:
            return "texture within fields is drawn on the data base's own cells"
        return ""

    def mixed(self) -> float:
        """Share of pixels that hold more than one category."""
        side = self.radar.pixel_spacing_m
        return bounds.mixed_share(self.statistics.boundary_density_1_m, side, side)

    def other_effects(self, tolerance: float) -> tuple[Effect, ...]:
        """Effects that every rung heeds, for the record."""
        radar, theta = self.radar, self.theta
        looks = float(radar.looks_used(theta).min())
        fading = self.shifted(bounds.DB_OF_FADING / math.sqrt(looks))
        near, far = (float(x) for x in self.geometry.slant_range_m)
        swath = 4.0 * bounds.DB_OF_FADING * math.log(far / near)
        nesz = radar.noise_equivalent_sigma0(theta, self.geometry.slant_range_m, self.geometry.look_rad)
        least = min(float(lookup.sigma0[self.kept > _LEAST_SHARE][:, _degrees(theta)].min()) for lookup in self.lookups)
        noise_db = bounds.DB_OF_FADING * float(nesz.max()) / max(least, 1e-30)
        sag = float(self.geometry.ground_range_m[1]) ** 2 / (2.0 * EARTH_RADIUS_M)
        air_db = 2.0 * radar.zenith_loss_db * float(np.ptp(1.0 / np.cos(np.minimum(theta, 1.4))))
        beam = radar.azimuth_resolution_m(float(self.geometry.slant_range_m[1])) if radar.aperture == "real" else 0.0
        bits = radar.adc_bits
        curved = "" if radar.curved else "a flat Earth was asked for; "
        changes = (
            ("fading", fading, f"{looks:.3g} looks: {bounds.DB_OF_FADING / math.sqrt(looks):.2g} dB; drawn"),
            (
                "a normal law for fading",
                min(200.0 * _SKEW / math.sqrt(looks), 100.0),
                f"its distribution is off by {_SKEW / math.sqrt(looks):.2g} at most; chi-square in all rungs",
            ),
            (
                "shape of the azimuth beam",
                100.0 * _BOX_FOR_BEAM * self.mixed() if beam > 0.0 else 0.0,
                f"{beam:.3g} m wide, counts on borders; in all rungs"
                if beam > 0.0
                else "a synthetic aperture has none",
            ),
            ("several categories in a pixel", 100.0 * self.mixed(), "by the density of borders; in all rungs"),
            ("range and gain over the swath", self.shifted(swath), f"{swath:.2g} dB from near to far; in all rungs"),
            ("receiver noise", self.shifted(noise_db), f"{noise_db:.2g} dB on the weakest category; in all rungs"),
            ("atmosphere over the swath", self.shifted(air_db), f"{air_db:.2g} dB; in all rungs"),
        )
        whole = (
            ("curvature of the Earth", radar.curved, f"{curved}{sag:.2g} m at the far edge"),
            ("azimuth beam wider than a cell", beam > self.cell_m, f"{beam:.3g} m on cells of {self.cell_m:g} m"),
            ("quantisation", bits > 0, f"{bits} bits" if bits else "no converter"),
            (
                "cultural targets",
                bool(radar.targets_file),
                "targets_file" if radar.targets_file else "none in the scene",
            ),
            ("double precision", False, "single precision changes a pixel's power by a millionth"),
        )
        found = [effect(name, bound, tolerance, text) for name, bound, text in changes]
        for name, heeded, text in whole:
            bound = math.inf if heeded else 0.0
            found.append(effect(name, bound, tolerance, f"{text}; in all rungs" if heeded else text, proven=True))
        return tuple(found)

    def ground(self) -> Ground:
        """Extent and correlation, for the sampling error."""
        side = self.radar.pixel_spacing_m
        across, along = self.n_rows * self.cell_m, self.m * self.cell_m
        pieces = 2.0 / self.radar.texture_m if self.radar.texture_db > 0.0 else 0.0
        return Ground(
            correlation_m=bounds.correlation_length_m(self.statistics.field_boundary_density_1_m),
            mixed=bounds.mixed_share(self.statistics.field_boundary_density_1_m + pieces, side, side),
            across_m=across,
            along_m=along,
            n_rows=max(math.ceil(across / side - 1e-9), 1),
            n_columns=max(math.ceil(along / side - 1e-9), 1),
            spread=50.0,
            drawn=self.drawn(),
            scored=max(self.statistics.scored_fraction, 1e-9),
            teaching=bounds.teaching_factor(self.tested),
            rarest=min(self.tested, default=1.0),
            taught=bounds.taught_by_pixels(int((self.kept > 0.0).sum()), len(self.lookups)),
        )

    def drawn(self) -> float:
        """Part of the pixels' variance that fading has, at most; the rest is that of fields and borders."""
        looks = float(self.radar.looks_used(self.theta).min())
        fading = 0.0 if self.radar.fading == "none" else bounds.DB_OF_FADING / math.sqrt(looks)
        field = np.min([lookup.field_sd_db for lookup in self.lookups], axis=0)
        pairs = zip(field, self.kept, strict=True)
        return math.fsum(float(k) * bounds.undecided_share(fading, float(s)) for s, k in pairs if k > 0.0)

    def whole_effort(self, pixels: float) -> float:
        """Estimated time of the whole image with everything on [s]."""
        channels = len(self.lookups)
        cells = self.n_rows * self.m * channels * _NS_A_CELL
        each = _NS_A_SHOWN * channels + _NS_A_NAMED * len(self.scene.categories)
        return 1e-9 * (_NS_A_RUN + cells + pixels * each)

    def effort(self, share: float, pixels: float, draws: int, coarse: int) -> float:
        """Estimated time of strips, or of all columns as strips [s]."""
        channels = len(self.lookups)
        halo = (1.0 + _HALO * coarse * self.cell_m / self.radar.pixel_spacing_m) if share < 1.0 else 1.0
        cells = self.n_rows * self.m * min(share * halo, 1.0) / coarse**2
        each = _NS_A_GATHERED + channels * _NS_A_CELL
        return 1e-9 * (_NS_A_RUN + cells * each + pixels * draws * self._drawn_ns())

    def flat_effort(self, rows: int, columns: int, draws: int) -> float:
        """Estimated time of flat pixels [s]."""
        points = min(math.floor(self.radar.pixel_spacing_m / self.cell_m) + 2, 8) ** 2
        each = points * (_NS_A_POINT + _NS_A_CELL * len(self.lookups)) + draws * self._drawn_ns()
        return 1e-9 * (_NS_A_RUN + rows * columns * each)

    def _drawn_ns(self) -> float:
        """Time of drawing and naming a pixel of a sample once [ns]."""
        return _NS_A_DRAW * len(self.lookups) + _NS_A_CLASS * len(self.scene.categories)


def _rare(rms_slope: float, limit: float) -> float:
    """Share of ground, doubled for what lies behind, whose slope passes a limit: Chebyshev's inequality."""
    return min(2.0 * (rms_slope / limit) ** 2, 1.0) if limit > 0.0 else 1.0


def _degrees(theta: FloatArray) -> slice:
    low, high = np.rad2deg(theta)
    return slice(max(int(low), 0), min(math.ceil(high), 90) + 1)
