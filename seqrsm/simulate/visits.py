"""When a run's sensors meet the ground, and the draws that tie their meetings together, and how moist each field is.

All sensors and dates of a run see one ground: the same fields, each with one lasting departure, one that fades with
time, and one shift of its calendar; one series of soil moisture; one year. Drawn anew at every date, fields would make
many dates look far too good. Radars at different incidence angles see fields the more differently the further apart.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy
from scipy.special import ndtr

from seqrsm.arrays import FloatArray, IntArray
from seqrsm.remember import arrays_by_thread
from seqrsm.rng import generator
from seqrsm.scattering.worlds import drawn_by_frequency, related_by_frequency
from seqrsm.scene.layers import centres_of_fields, moisture_of_fields
from seqrsm.scene.scene import Scene
from seqrsm.sensor.exchange import Sensor

OWN_OF_FIELDS: Final = 0.1
"""Share of the variance between fields that only frequencies within a fifth of an octave see alike (assumed).

Without it two bands that see nearly the same fields would tell the least difference between covers by their own.
"""

_OWN_OCTAVES: Final = 0.1

ANGLE_DEG: Final = 45.0
"""Between incidence angles at which what a radar sees of fields is related by 1/e [deg].

Of 500 fields in Argentina, Australia and Vietnam (Roßberg and Schmitt 2025, Remote Sens. Environ. 319, 114612), seen by
two radars within four days, most from different sides, 0.022 a degree is lost, with a standard error of 0.006. The
integral equation model says of bare soils of several roughnesses -0.2 to 0.65 between 23 and 43 degrees at C band and
0.7 to 1 at L band.
"""

_TO_ONE_E = 2.1461932206  # (1 + x) exp(-x) = 1/e
_NEARLY = 1.0 - 1e-9  # else days that are seconds apart have no Cholesky factor

_SLOW_SHARE, _SLOW_DAYS = 0.74, 30.0
FAST_DAYS: Final = 4.5
"""In which the weather of a date falls to 1/e of itself [d]: what rain does to soil, and to plants (assumed)."""

YEAR_DAYS: Final = 7.0
"""By which a year is early or late, in common and for each cover, standard deviation [d]."""


@dataclass(frozen=True, slots=True)
class Visit:
    """One meeting of a sensor with the ground, among all of its run."""

    days: tuple[float, ...] = ()
    """Days of all meetings of the run, rising, in the next year beyond 365; empty: one in the middle of the season."""
    number: int = 0
    """Place of this one among them."""
    member: int = 0
    """Number of the sensor among those of the run."""
    angles_deg: tuple[float, ...] = ()
    """Incidence angles of the run's radars up to this one's own, rising [deg]; empty: no other looks more steeply."""

    @property
    def day(self) -> float | None:
        """Day of the year; None where the season stands for it."""
        return self.days[self.number] if self.days else None

    def purpose(self, name: str) -> str:
        """Name of a stream of random numbers that belongs to this image alone."""
        return f"{name} {self.member} {self.number}" if self.member or self.number else name

    def dated(self, name: str) -> str:
        """Name of a stream that all sensors of this date share."""
        return f"{name} {self.number}" if self.number else name


ONCE: Final = Visit()
"""The only image of its run, in the middle of the season."""


def deviates(
    seed: int, run_id: int, purpose: str, shape: tuple[int, ...], frequency_ghz: float, own_share: float = 0.0
) -> FloatArray:
    """`drawn_by_frequency` of a run, with a share of the variance that only near frequencies have in common.

    `kept_deviates` keeps them for channels, later dates and other worlds of a run, which ask for the same.
    """
    near = drawn_by_frequency(seed, run_id, purpose, shape, frequency_ghz)
    if own_share == 0.0:
        return near
    own = drawn_by_frequency(seed, run_id, f"own {purpose}", shape, frequency_ghz, _OWN_OCTAVES)
    return np.asarray(math.sqrt(1.0 - own_share) * near + math.sqrt(own_share) * own)


kept_deviates = arrays_by_thread(most_bytes=2**26)(deviates)


def related_fields(one_ghz: float, other_ghz: float, apart_deg: float = 0.0) -> float:
    """Correlation of what two frequencies [GHz] see of fields and their parts in one channel on a date.

    ``apart_deg``: between their incidence angles [deg].
    """
    own = OWN_OF_FIELDS * related_by_frequency(one_ghz, other_ghz, _OWN_OCTAVES)
    related = (1.0 - OWN_OF_FIELDS) * related_by_frequency(one_ghz, other_ghz) + own
    return math.exp(-apart_deg / ANGLE_DEG) * related


def at_angle(visit: Visit, purpose: str, draw: Callable[[str], FloatArray]) -> FloatArray:
    """What ``draw`` makes of a purpose's name for fields, as the radar of a visit sees it at its incidence angle.

    Of the steepest radar of a run it is the draw of that name; from there each angle sees what the last one saw, less
    what the degrees between them cost.
    """
    state = draw(purpose)
    for k, apart_deg in enumerate(np.diff(visit.angles_deg), start=1):
        left = math.exp(-apart_deg / ANGLE_DEG)
        state = left * state + math.sqrt(1.0 - left**2) * draw(f"{purpose} angle {k}")
    return state


def over_dates(
    visit: Visit,
    purpose: str,
    draw: Callable[[str], FloatArray],
    memory_days: float | FloatArray,
    of: IntArray | None = None,
) -> FloatArray:
    """What ``draw`` makes of a purpose's name on a visit, `changing` up to its date; without a day the first."""
    past = visit.days[: visit.number + 1] or (0.0,)
    return changing([draw(Visit(past, t).dated(purpose)) for t in range(len(past))], past, memory_days, of)


def changing(
    draws: Sequence[FloatArray], days: Sequence[float], memory_days: float | FloatArray, of: IntArray | None = None
) -> FloatArray:
    """Last value (n,) of a smooth standard series, related by 1/e after ``memory_days``; a draw (n,) a day.

    Each value has a memory of its own, or all the same, or that which ``of`` (n,) tells by its place.

    Matérn's covariance of order 3/2 (Rasmussen and Williams 2006, eq. 4.17): what is different after hours grows with
    the time between them, not with its root, which would tell covers apart by two dates of one day.
    """
    x = _TO_ONE_E * np.abs(np.subtract.outer(days, days)) / np.asarray(memory_days)[..., None, None]
    weights = np.linalg.cholesky(np.where(x > 0.0, _NEARLY, 1.0) * (1.0 + x) * np.exp(-x))[..., -1, :].T
    each = (weight if of is None else weight[of] for weight in weights)
    return np.asarray(sum(weight * draw for weight, draw in zip(each, draws, strict=True)))


def half_lasting(
    visit: Visit, purpose: str, shape: tuple[int, ...], frequency_ghz: float, *, seed: int, run_id: int
) -> FloatArray:
    """`deviates` of fields on a visit; half of their variance all dates share, half fades as weather does (assumed)."""

    def kept(name: str) -> FloatArray:
        return kept_deviates(seed, run_id, name, shape, frequency_ghz, OWN_OF_FIELDS)

    if not visit.days:
        return kept(purpose)
    return math.sqrt(0.5) * (over_dates(visit, purpose, kept, FAST_DAYS) + kept(f"lasting {purpose}"))


def regional_moisture(visit: Visit, places_m: FloatArray, length_m: float, *, seed: int, run_id: int) -> FloatArray:
    """Standard departure (n,) of places that near ones have in common; half of it all dates share, as `half_lasting`.

    White noise under a Gaussian window on a grid of a quarter of the length.

    Parameters
    ----------
    visit : Visit
    places_m : float64 array (2, n)
        [m], 0 at least.
    length_m : float
        Distance at which the correlation is 1/e [m].
    seed, run_id : int
    """
    step = 0.25 * length_m
    # Twice the window's reach beyond the places, where the grid's ends meet.
    shape = tuple(math.ceil(float(side.max()) / step) + 16 for side in places_m)
    noise = half_lasting(visit, "regional moisture", shape, _ANY_GHZ, seed=seed, run_id=run_id)
    window = scipy.ndimage.gaussian_filter(np.eye(1, 33 * 33, 16 * 33 + 16).reshape(33, 33), 2.0)
    smooth = scipy.ndimage.gaussian_filter(noise, 2.0, mode="wrap") / math.sqrt(float(np.square(window).sum()))
    return np.asarray(scipy.ndimage.map_coordinates(smooth, places_m / step, order=1))


def moisture_share(visit: Visit, *, seed: int, run_id: int) -> float:
    """Where between its stated ends the soil moisture of a visit lies, uniform on 0 to 1.

    Over the days of a run it is a series of two parts that are left to 1/e after 30 days and 4.5 days, with 0.74 and
    0.26 of the variance: standard deviations of 0.05 and 0.03 m3/m3 where the ends lie 0.2 apart.
    """
    if not visit.days:
        return float(generator(seed, run_id, "soil moisture").random())
    past = visit.days[: visit.number + 1]
    draws = generator(seed, run_id, "soil moisture of days").standard_normal((len(past), 2))
    slow, fast = changing(list(draws), past, np.array([_SLOW_DAYS, FAST_DAYS]))
    return float(ndtr(math.sqrt(_SLOW_SHARE) * slow + math.sqrt(1.0 - _SLOW_SHARE) * fast))


def year_shift_days(n_categories: int, *, seed: int, run_id: int) -> FloatArray:
    """Days by which each category is early (negative) or late in the year of a run, (n_categories,)."""
    common, *own = generator(seed, run_id, "calendar of the year").standard_normal(1 + n_categories)
    return np.asarray(YEAR_DAYS * (common + np.array(own)))


def field_shift_days(shift_days: FloatArray, *, seed: int, run_id: int) -> FloatArray:
    """Days by which each field is early or late for its category, from their standard deviations (n_fields,)."""
    return np.asarray(shift_days * generator(seed, run_id, "calendar of fields").standard_normal(len(shift_days)))


_ANY_GHZ = 1.0  # a field's moisture is the same for all frequencies


def field_moisture(
    scene: Scene, sensor: Sensor, mean: float, visit: Visit, limits: tuple[float, float], *, seed: int, run_id: int
) -> FloatArray:
    """Moisture of each field (n_fields,) on a visit [m3/m3].

    The data base's, shifted by the date's mean less the middle of its range, or the date's mean with a departure that
    near fields share; and a departure of each field's own.

    Parameters
    ----------
    scene : Scene
    sensor : RadarConfiguration or RadiometerConfiguration
        Its ``soil_moisture_*``.
    mean : float
        Of the date [m3/m3].
    visit : Visit
    limits : tuple of float
        Least and largest [m3/m3].
    seed, run_id : int
        Campaign and run.
    """
    key = {"seed": seed, "run_id": run_id}
    level = known_moisture(scene, sensor, mean, limits)
    if level is None:
        level = np.full(scene.n_fields, mean)
        if sensor.soil_moisture_region_sd > 0.0:
            common = regional_moisture(visit, centres_of_fields(scene), sensor.soil_moisture_region_m, **key)
            level = level + sensor.soil_moisture_region_sd * common
    own = half_lasting(visit, "field moisture", (scene.n_fields,), _ANY_GHZ, **key)
    return np.asarray(np.clip(level + sensor.soil_moisture_field_sd * own, *limits))


def known_moisture(scene: Scene, sensor: Sensor, mean: float, limits: tuple[float, float]) -> FloatArray | None:
    """The data base's moisture of each field at a date's mean, that mean where it has none; None without the layer."""
    layer = moisture_of_fields(scene)
    if layer is None:
        return None
    shifted = np.clip(layer + mean - 0.5 * (sensor.soil_moisture_low + sensor.soil_moisture_high), *limits)
    return np.asarray(np.where(np.isfinite(layer), shifted, mean))


def region_spread(scene: Scene, sensor: Sensor) -> float:
    """Standard deviation of moisture that near fields share [m3/m3]: of the data base, else of the sensor's ground."""
    layer = moisture_of_fields(scene)
    return sensor.soil_moisture_region_sd if layer is None else float(np.nanstd(layer))
