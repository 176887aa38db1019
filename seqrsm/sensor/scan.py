"""Scan of a radiometer: what period, speed, beam and integration time make of one flight over a scene.

The craft flies over the middle line; the antenna sweeps from the left edge to the right edge and back while the craft
moves on, so the lines zigzag: RSL TR 380-1 chapter 3.3.3. Footprints are square at nadir, and with the look angle phi
from the vertical longer (h (tan(phi + beta/2) - tan(phi - beta/2))) and wider (resolution / cos phi).

A conical scan draws arcs ahead of the craft at one incidence angle. The rows of its image are successive turns, the
columns footprints of one turn, all alike: an ellipse longest in the direction of view, wider by what the beam moves
while it integrates. The scene lies in the middle of the arc, which is taken as straight there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from scipy.special import erf

from seqrsm.arrays import FloatArray
from seqrsm.csv_lines import read_cells
from seqrsm.errors import ConfigurationError, Problem
from seqrsm.sensor.parameters import RADIOMETER
from seqrsm.sensor.radiometer import RadiometerConfiguration

BEAM_STEPS_A_WIDTH: Final = 128
"""Steps of the table of a beam's running integral in one half-power beamwidth."""

LARGE_ANTENNA: Final = "the beam needs a large antenna"
_REACH: Final = {"box": 0.5, "gaussian": 1.75, "sidelobes": 8.0}
_MOST_FOOTPRINTS: Final = 20_000_000
_MOST_BEAMWIDTHS: Final = 1e4  # of a measured pattern from its axis: 180 deg of a beam of 0.018 deg
_WIDEST_RAD: Final = math.radians(RADIOMETER["scan_half_angle_deg"].high)
_LARGE_ANTENNA_M: Final = 2.0  # more than a rigid one of Tables A.21 and A.23
_FAR_M: Final = 1e9  # a scene of 100 km is as wide from there as it is long, to 1e-8


@dataclass(frozen=True, slots=True, eq=False)
class ScanGeometry:
    """The scan over one scene."""

    height_m: float
    """Flight line above the mean ground [m]."""
    from_m: float
    """Height from which the angles below are told [m]: `height_m`; for a conical scan so far off that footprints are
    alike."""
    beamwidth_rad: float
    half_angle_rad: float
    """Half-power beamwidth across the rows; reach of the sweep to either side [rad], inf for a conical scan."""
    sweep_advance_m: float
    advance_m: float
    """Way flown from one sweep to the next, and from one line of the image to the next [m]; on a cone that from
    footprint to footprint along the arc."""
    dwell_ms: float
    """Time in which the beam moves by its own width [ms]."""
    smear: float
    """Way the beam moves while it integrates [beamwidths]."""
    look_rad: FloatArray
    """(n_samples,): angle from the vertical at which each footprint of a line is seen, left edge first, nadir 0
    [rad]."""
    place_rad: FloatArray
    """(n_samples,): where they lie, as an angle at `from_m` [rad]: `look_rad` of a sweep."""
    step_rad: float
    """Between footprints [rad]."""
    n_sweeps: int
    sweeps_a_line: int
    n_lines: int
    """Sweeps over the scene; sweeps averaged into one line of the image; lines."""
    along: FloatArray
    """(n,): running integral of the beam along the track at steps of 1 / BEAM_STEPS_A_WIDTH from -reach to +reach."""
    across: FloatArray
    """(m,): the same across the rows; the one of the two in the direction of the sweep is spread by the smear."""
    notes: tuple[str, ...]
    """What the combination does: gaps, overlap, idle time, smear."""


def scan_geometry(
    radiometer: RadiometerConfiguration, height_m: float, across_m: float, along_m: float
) -> ScanGeometry:
    """Scan of a radiometer at a height over the mean ground [m] of a scene, wide across and long along the track [m].

    Raises
    ------
    ConfigurationError
        Flight line in the ground, an antenna larger than the craft carries, an integration longer than a sweep, gaps
        where they are refused, more footprints than can be simulated.
    """
    if height_m <= 0.0:
        text = "the flight line is not above the ground"
        raise ConfigurationError(text, "Increase the altitude", field="altitude_m", value=radiometer.altitude_m)
    if radiometer.conical:
        return _conical_geometry(radiometer, height_m, across_m, along_m)
    beta = radiometer.beamwidth_rad(height_m)
    edge = math.atan(0.5 * across_m / height_m)
    half_angle = math.radians(radiometer.scan_half_angle_deg) or edge
    sweep_time = 0.5 * radiometer.scan_period_s
    advance = radiometer.speed_m_s * sweep_time
    rate = 2.0 * half_angle / sweep_time
    dwell_ms = 1e3 * beta / rate
    smear = radiometer.integration_time_ms / dwell_ms
    problems = _problems(radiometer, height_m, advance, sweep_time)
    if half_angle < 0.25 * beta and radiometer.scan_half_angle_deg > 0.0:
        text, degrees = "the sweep is narrower than half a beam", math.degrees(half_angle)
        problems.append(Problem(text, "Increase the scan angle", field="scan_half_angle_deg", value=degrees))
    step = beta * max(1.0, smear)
    n_samples = max(int(2.0 * half_angle / step * (1.0 + 1e-9)), 1)
    # An odd number keeps one footprint at nadir.
    n_samples += 1 - n_samples % 2
    n_sweeps = max(math.ceil(along_m / advance * (1.0 - 1e-9)), 1)
    averaged = radiometer.overlap == "average"
    sweeps_a_line = max(int(radiometer.resolution_m / advance * (1.0 + 1e-9)), 1) if averaged else 1
    _refuse(problems, n_sweeps, n_samples)
    along = beam_integral(radiometer)
    look_rad = np.asarray((np.arange(n_samples) - 0.5 * (n_samples - 1)) * step, dtype=np.float64)
    scan = ScanGeometry(
        height_m=height_m,
        from_m=height_m,
        beamwidth_rad=beta,
        half_angle_rad=half_angle,
        sweep_advance_m=advance,
        advance_m=advance * sweeps_a_line,
        dwell_ms=dwell_ms,
        smear=smear,
        look_rad=look_rad,
        place_rad=look_rad,
        step_rad=step,
        n_sweeps=n_sweeps,
        sweeps_a_line=sweeps_a_line,
        n_lines=math.ceil(n_sweeps / sweeps_a_line),
        along=along,
        across=smeared(along, smear),
        notes=(),
    )
    return replace(scan, notes=(*_large_antenna(radiometer, height_m), *_notes(radiometer, scan, edge - 0.5 * beta)))


def _conical_geometry(
    radiometer: RadiometerConfiguration, height_m: float, ahead_m: float, across_m: float
) -> ScanGeometry:
    """Scan on a cone over a scene so long in the direction of view and so wide square to it [m]."""
    length, width = radiometer.footprint_m
    period, radius = radiometer.scan_period_s, radiometer.reach_m(height_m)[1]
    advance = radiometer.speed_m_s * period
    dwell_ms = 1e3 * width * period / (2.0 * math.pi * radius)
    smear = radiometer.integration_time_ms / dwell_ms
    problems = _problems(radiometer, height_m, advance, period)
    n_samples = max(int(ahead_m / advance * (1.0 + 1e-9)), 1)
    n_samples += 1 - n_samples % 2
    # Spread evenly, or a scene narrower than a footprint would lie beside it.
    n_lines = max(round(across_m / (width * max(1.0, smear))), 1)
    _refuse(problems, n_lines, n_samples)
    behind = radius - math.sqrt(max(radius**2 - min(0.5 * across_m, radius) ** 2, 0.0))
    beam = beam_integral(radiometer)
    covered = f"turns {advance:.4g} m apart see {length:.4g} m each"
    return ScanGeometry(
        height_m=height_m,
        from_m=_FAR_M,
        beamwidth_rad=length / _FAR_M,
        half_angle_rad=math.inf,
        sweep_advance_m=across_m / n_lines,
        advance_m=across_m / n_lines,
        dwell_ms=dwell_ms,
        smear=smear,
        look_rad=np.full(n_samples, math.radians(radiometer.conical_incidence_deg)),
        place_rad=np.asarray((np.arange(n_samples) - 0.5 * (n_samples - 1)) * advance / _FAR_M, dtype=np.float64),
        step_rad=advance / _FAR_M,
        n_sweeps=n_lines,
        sweeps_a_line=1,
        n_lines=n_lines,
        along=smeared(beam, smear),
        across=beam,
        notes=(
            *_large_antenna(radiometer, height_m),
            f"conical scan: a beam of {length:.4g} by {width:.4g} m moves {smear * width:.4g} m while it integrates; "
            f"{covered}{', gaps between' if advance > length else ''}",
            f"arc of the scan: it lies {behind:.3g} m farther back at the scene's sides, which is left out",
        ),
    )


def _refuse(problems: list[Problem], n_sweeps: int, n_samples: int) -> None:
    """Raise the problems, and that of too many footprints."""
    if n_samples * n_sweeps > _MOST_FOOTPRINTS:
        text = f"{n_sweeps} sweeps of {n_samples} footprints are more than {_MOST_FOOTPRINTS}"
        problems.append(Problem(text, "Use a coarser resolution or a longer period", field="resolution"))
    if problems:
        raise ConfigurationError(*problems)


def _problems(radiometer: RadiometerConfiguration, height_m: float, advance: float, sweep_time: float) -> list[Problem]:
    """What makes the scan impossible."""
    problems = []
    covered = radiometer.footprint_m[0]
    antenna = radiometer.antenna_m(height_m)
    if antenna > radiometer.antenna_limit_m * (1.0 + 1e-9):
        finest = 1.22 * radiometer.wavelength_m * radiometer.reach_m(height_m)[0] / radiometer.antenna_limit_m
        finest *= radiometer.resolution_m / radiometer.footprint_m[1]
        text = f"this beam needs an antenna of {antenna:.3g} m, more than the {radiometer.antenna_limit_m:g} m allowed"
        remedy = f"Use a resolution of at least {finest:.4g} m, a higher frequency or a lower flight"
        problems.append(Problem(text, remedy, field="resolution", value=radiometer.resolution_m))
    if radiometer.integration_time_ms > 1e3 * sweep_time:
        text = f"the integration time exceeds a sweep of {1e3 * sweep_time:.4g} ms: no footprint is resolved"
        remedy = "Reduce the integration time, or increase the scan period"
        problems.append(Problem(text, remedy, field="integration_time", value=radiometer.integration_time_ms))
    if radiometer.gaps == "refuse" and advance > covered * (1.0 + 1e-9):
        text = f"sweeps lie {advance:.4g} m apart and cover {covered:.4g} m each: gaps at nadir"
        limit = radiometer.scan_period_s * covered / advance
        remedy = f"Use a period of at most {limit:.4g} s, a coarser resolution or a slower craft"
        problems.append(Problem(text, remedy, field="scan_period", value=radiometer.scan_period_s))
    return problems


def _large_antenna(radiometer: RadiometerConfiguration, height_m: float) -> tuple[str, ...]:
    """The antenna that the beam needs, where it is large and nobody has said what the craft carries."""
    antenna = radiometer.antenna_m(height_m)
    if antenna <= _LARGE_ANTENNA_M or radiometer.antenna_limit_m < RADIOMETER["antenna_limit_m"].high:
        return ()
    return (f"{LARGE_ANTENNA}: {antenna:.3g} m; give antenna_limit_m, the largest that the craft carries",)


def _notes(radiometer: RadiometerConfiguration, scan: ScanGeometry, outermost: float) -> tuple[str, ...]:
    """What the combination of parameters does, in words; ``outermost``: beam that sees the edges of the scene [rad]."""
    notes = []
    advance, smear, half_angle = scan.sweep_advance_m, scan.smear, scan.half_angle_rad
    covered = radiometer.resolution_m / advance
    if covered < 1.0 - 1e-9:
        notes.append(
            f"gaps at nadir: sweeps {advance:.4g} m apart cover {radiometer.resolution_m:.4g} m each "
            f"({100.0 * covered:.0f} %); unseen ground takes the value of the nearest footprint"
        )
    elif covered > 1.0 + 1e-9:
        several = f"{scan.sweeps_a_line} at a time are averaged into a line"
        used = several if scan.sweeps_a_line > 1 else "only the nearest is used"
        notes.append(f"overlap at nadir: each point is seen by {covered:.3g} sweeps; {used}")
    if smear > 1.0:
        notes.append(
            f"smear: an integration of {radiometer.integration_time_ms:.4g} ms exceeds the dwell of "
            f"{scan.dwell_ms:.4g} ms: footprints are {smear:.3g} beams long"
        )
    elif 0.0 < smear < 0.5:
        idle = f"{100.0 * (1.0 - smear):.0f} % of the dwell of {scan.dwell_ms:.4g} ms"
        notes.append(f"idle time: {idle} is not integrated")
    if half_angle < outermost:
        notes.append("narrow sweep: it does not reach the edges of the scene; ground beyond it is not scored")
    if half_angle > _WIDEST_RAD:
        degrees, longer = math.degrees(half_angle), 1.0 / math.cos(half_angle) ** 2
        notes.append(
            f"wide sweep: the scene ends {degrees:.3g} deg from nadir, where footprints are {longer:.3g} times "
            "as long; fly higher, or limit scan_half_angle_deg"
        )
    return tuple(notes)


def beam_integral(radiometer: RadiometerConfiguration) -> FloatArray:
    """Running integral (2 n + 1,) of the antenna pattern along one axis, from 0 to 1.

    At steps of 1 / `BEAM_STEPS_A_WIDTH` beamwidths, centred on the beam's axis; the pattern is cut at the ends.

    Raises
    ------
    ConfigurationError
        The file of a measured pattern cannot be used.
    """
    beam = radiometer.beam
    if beam == "measured":
        return _measured_integral(radiometer.beam_file)
    reach = _REACH[beam]
    n = round(reach * BEAM_STEPS_A_WIDTH)
    u = np.arange(-n, n + 1) / BEAM_STEPS_A_WIDTH
    if beam == "box":
        return np.asarray(u + 0.5)
    if beam == "gaussian":
        total = erf(2.0 * math.sqrt(math.log(2.0)) * u)
        return np.asarray(0.5 + 0.5 * total / total[-1])
    # (sin x / x)**2 falls to one half at x = 1.39156.
    return _normalised(np.sinc(2.0 * 1.391557378 / math.pi * u) ** 2)


def _normalised(pattern: FloatArray) -> FloatArray:
    total = np.concatenate([[0.0], np.cumsum(0.5 * (pattern[1:] + pattern[:-1]))])
    return np.asarray(total / total[-1])


def _measured_integral(path: str) -> FloatArray:
    """Running integral of a pattern read from CSV: angle in half-power beamwidths, linear power gain."""
    name, field, columns = Path(path).name, "beam_file", ["angle_beamwidths", "gain"]
    remedy = f"Give columns {','.join(columns)}: rising angles and a power ratio >= 0, not dB, in at least 5 rows"
    (line, header), *rows = read_cells(path, "the pattern", ConfigurationError, field) or [(1, [])]
    if header != columns:
        raise ConfigurationError(
            "no antenna pattern", remedy, file=name, line=line, field=field, value=",".join(header)
        )
    points: list[tuple[float, float]] = []
    problems = []
    for line, row in rows:
        try:
            angle, gain = map(float, row)
        except ValueError:
            angle = gain = math.nan
        if not (abs(angle) <= _MOST_BEAMWIDTHS and 0.0 <= gain < math.inf and (not points or angle > points[-1][0])):
            problems.append(Problem("not a point of a pattern", remedy, name, line, field, ",".join(row)))
        else:
            points.append((angle, gain))
    if not problems and (len(points) < 5 or max(gain for _, gain in points) == 0.0):
        problems.append(Problem("too few points of a pattern, or all 0", remedy, name, field=field))
    if problems:
        raise ConfigurationError(*problems)
    angles, gains = np.array(points).T
    n = math.ceil(float(np.abs(angles).max()) * BEAM_STEPS_A_WIDTH)
    u = np.arange(-n, n + 1) / BEAM_STEPS_A_WIDTH
    return _normalised(np.interp(u, angles, gains, left=0.0, right=0.0))


def smeared(integral: FloatArray, smear: float) -> FloatArray:
    """Running integral of a pattern that moves by ``smear`` beamwidths while it integrates.

    The mean of the integral over the way, from the integral's own integral: exact for a piecewise linear one.
    """
    if smear <= 0.0:
        return integral
    step = 1.0 / BEAM_STEPS_A_WIDTH
    reach = 0.5 * (len(integral) - 1) * step
    n = math.ceil((reach + 0.5 * smear) / step)
    u: FloatArray = np.asarray(np.arange(-n, n + 1) * step, dtype=np.float64)
    nodes = (np.arange(len(integral)) - 0.5 * (len(integral) - 1)) * step
    second = np.concatenate([[0.0], np.cumsum(0.5 * (integral[1:] + integral[:-1]) * step)])

    def antiderivative(x: FloatArray) -> FloatArray:
        k = np.clip(((x + reach) / step).astype(np.int64), 0, len(integral) - 2)
        f = np.clip((x - nodes[k]) / step, 0.0, 1.0)
        inside = second[k] + step * f * (integral[k] + 0.5 * f * (integral[k + 1] - integral[k]))
        return np.asarray(np.where(x <= -reach, 0.0, np.where(x >= reach, second[-1] + (x - reach), inside)))

    return np.asarray((antiderivative(u + 0.5 * smear) - antiderivative(u - 0.5 * smear)) / smear)
