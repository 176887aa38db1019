"""What a simplification costs at most: closed forms of the fidelity planner, each with its source.

A cheaper model errs in two ways. What it leaves out shifts the power of a pixel by some decibels or kelvin; how far
that can move a score depends on the spread of a class, which covers or uncovers the shift (`shift_bound`). And a sample
of the ground stands for all of it (`sampling_variance`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from scipy.special import erfc

from seqrsm.arrays import FloatArray, IntArray

DB_OF_FADING: Final = 10.0 / math.log(10.0)
"""Standard deviation of one look in decibels is about this, of N looks this over sqrt(N)."""

_STEEPEST: Final = 2.0 / math.sqrt(2.0 * math.pi * math.e)
"""Twice the largest value of z phi(z), which a normal law's tail probability changes by when its scale changes."""

_MOVED: Final = 0.008
_RAREST: Final = 250.0


def shift_bound(rms_shift: FloatArray | float, spread: FloatArray | float) -> FloatArray:
    """Share of pixels at most that a random shift moves into another class.

    Two classes whose distance is 2 z spreads are told apart rightly with probability Phi(z). A shift of the pixels,
    independent of their class, widens the spread from s to sqrt(s**2 + e**2), and z falls by z (1 - s / sqrt(s**2 +
    e**2)). The slope of Phi times z is z phi(z), at most 0.242; a class between two others has two such borders.

    Parameters
    ----------
    rms_shift : float or float array
        Root-mean-square shift e, >= 0.
    spread : float or float array
        Standard deviation s of the pixels of a class without the shift, same unit, >= 0.

    Returns
    -------
    float64 array, of the arguments' common shape
        0 to 1; 1 where a class has no spread at all.
    """
    e, s = np.asarray(rms_shift, dtype=np.float64), np.asarray(spread, dtype=np.float64)
    # ln(s'/s) bounds the integral of d ln(s) z phi(z) for any distance, also for large shifts.
    wider = np.log(np.hypot(s, e) / np.where(s > 0.0, s, 1.0))
    return np.where(e <= 0.0, 0.0, np.where(s <= 0.0, 1.0, np.minimum(_STEEPEST * wider, 1.0)))


def quadrature_error(points: float) -> float:
    """Root-mean-square error of the share of a beam beyond a straight border, from so many points of equal weight.

    Fibonacci's lattice, shifted at random, in the quantiles of the beam: 0.3 n**-0.75 for borders in all directions
    that pass within 1.2 half-power widths of the axis (Monte Carlo for Gaussian and sinc beams, 21 to 377 points).
    Fields with corners, on cells an eighth of a width wide, err by twice that (`tests/physics/test_prm_points.py`).
    """
    return float(0.6 * points**-0.75)


def undecided_share(rms_draw: float, spread: float) -> float:
    """Part of a pixel's variance (right or wrong) at most that is due to its own draw of fading or noise.

    Near a border between classes a draw e decides; the mean of P (1 - P) over pixels that are spread out by s about
    two borders is at most 2 phi(0) / s times the integral of Phi (1 - Phi), which is e / sqrt(pi); over 1/4.

    Parameters
    ----------
    rms_draw : float
        Standard deviation e of the draw, >= 0.
    spread : float
        Standard deviation s of the pixels of a class without it, same unit, >= 0.

    Returns
    -------
    float
        0 to 1.
    """
    if rms_draw <= 0.0:
        return 0.0
    return min(8.0 / (math.sqrt(2.0) * math.pi) * rms_draw / spread, 1.0) if spread > 0.0 else 1.0


def smith_shadow(rms_slope: float, incidence_rad: float) -> float:
    """Share of Gaussian terrain in shadow at an incidence angle, for parallel rays.

    Smith 1967, "Geometrical shadowing of a random rough surface", IEEE Trans. Antennas Propag. 15, 668: the probability
    of being lit is [1 - erfc(m / sqrt(2) s) / 2] / (1 + L), with m = cot(incidence).

    Parameters
    ----------
    rms_slope : float
        Along the ray [1].
    incidence_rad : float
        0 to pi/2.

    Returns
    -------
    float
        0 to 1.
    """
    if rms_slope <= 0.0 or incidence_rad <= 0.0:
        return 0.0
    mu = 1.0 / math.tan(min(incidence_rad, 0.5 * math.pi - 1e-9))
    v = mu / (math.sqrt(2.0) * rms_slope)
    beyond = float(erfc(v))
    capital = 0.5 * (math.sqrt(2.0 / math.pi) * rms_slope / mu * math.exp(-min(v * v, 700.0)) - beyond)
    return min(max(1.0 - (1.0 - 0.5 * beyond) / (1.0 + capital), 0.0), 1.0)


def mixed_share(boundary_density_1_m: float, along_m: float, across_m: float) -> float:
    """Share of resolution cells that hold more than one category.

    A cell meets an isotropic set of boundaries by the mean width of its outline; for Poisson boundaries the share is
    1 - exp(-(2/pi) l (a + b)).

    Parameters
    ----------
    boundary_density_1_m : float
        Length of boundary on an area l [1/m].
    along_m, across_m : float
        Sides a, b of the cell [m].

    Returns
    -------
    float
        0 to 1.
    """
    return float(-math.expm1(-crossings(boundary_density_1_m, along_m, across_m)))


def crossings(boundary_density_1_m: float, along_m: float, across_m: float) -> float:
    """Mean number of boundaries that a resolution cell meets; arguments as in `mixed_share`."""
    return 2.0 / math.pi * boundary_density_1_m * max(along_m + across_m, 0.0)


def aggregation_shift_db(slope_db_deg: float, cot_incidence: float, lost_across: float, lost_along: float) -> float:
    """Mean power that averaging the elevations hides [dB], from the slope variance that is lost.

    -2.17 [k**2 v_across - k cot(theta) v_across + v_across + v_along] dB with k = 13.2 g, the second order of the power
    of a tilted cell.

    Parameters
    ----------
    slope_db_deg : float
        Slope of sigma0 with angle g [dB/deg].
    cot_incidence : float
    lost_across, lost_along : float
        Variance of slope in range and azimuth of the fine data base less that of the coarse one [1].

    Returns
    -------
    float
        >= 0; the sign is dropped.
    """
    k = 13.2 * slope_db_deg
    return abs(-2.17 * ((k * k - k * cot_incidence + 1.0) * lost_across + lost_along))


def sampling_variance(length_m: float, n: IntArray | int, extent_m: float) -> tuple[FloatArray, FloatArray]:
    """Variance of means along a line, over that of one point: of ``n`` equally spaced points, and of the whole line.

    For an exponential correlation of length l, and a random start: coth(h / 2 l) / n with h the step, and
    2 l / extent (both for lines much longer than l, and at most 1). The mean of the points less that of the line has
    the first less the second: see Bellhouse 1988, Handbook of Statistics 6, 125.

    Parameters
    ----------
    length_m : float
        Correlation length [m], >= 0.
    n : int or int array
        Points, >= 1.
    extent_m : float
        Of the line [m].

    Returns
    -------
    tuple of two float64 arrays of the shape of `n`
        The second is no more than the first.
    """
    count = np.asarray(n, dtype=np.float64)
    if length_m <= 0.0:
        return 1.0 / count, np.zeros_like(count)
    if math.isinf(length_m):
        return np.ones_like(count), np.ones_like(count)
    points = np.minimum(1.0 / (np.tanh(0.5 * extent_m / (count * length_m)) * count), 1.0)
    return points, np.minimum(2.0 * length_m / extent_m, points)


def correlation_length_m(boundary_density_1_m: float) -> float:
    """Length over which a mosaic's fields stay the same [m]: a line meets boundaries at a rate (2/pi) l."""
    return 0.5 * math.pi / boundary_density_1_m if boundary_density_1_m > 0.0 else math.inf


def teaching_factor(shares: Sequence[float], covariates: int = 0) -> float:
    """How much more a classifier's score errs because the sample that is tested also teaches.

    The mean of a class of share p is known from a sample as that of all pixels is, less well by 1 / sqrt(p); a class's
    borders move with it, and what they pass over changes its name. With independent classes the variances add up:
    1 + c sum(1 / p), where c is the square of the share of ground that one spread of a class's mean moves. Classes so
    rare that they have no pixels of their own count as a 250th of the ground. A mean that is a straight line in
    covariates is known as well as from so many fewer pixels: its variance is 1 + their number times larger, on average.

    Parameters
    ----------
    shares : sequence of float
        Of the ground, one for each class, 0 to 1.
    covariates : int
        That each class's mean is a line in.

    Returns
    -------
    float
        At least 1.

    Notes
    -----
    c = 0.008 covers the samples of six synthetic and four real grounds of two to ten classes
    (`tests/statistical/test_fidelity.py`; where shares are equal the factor is 1.1, at Langegracht 1.9).
    """
    return math.sqrt(1.0 + _MOVED * (1 + covariates) * math.fsum(min(1.0 / p, _RAREST) for p in shares if p > 0.0))


def taught_by_pixels(classes: int, channels: int, covariates: int = 0) -> int:
    """Pixels' worth of a classifier's loss from being taught by few: half of the parameters of its classes.

    From n pixels a classifier scores some 50 percent x this / n less than from very many (Monte Carlo at n = 256, 900
    and 3,000 with six classes in two channels: 2.7 to 3.7, 0.5 to 0.7 and 0.1 to 0.2 percent).
    """
    each = channels + channels * (channels + 1) // 2 + covariates * channels
    return max(classes * each // 2, 1)
