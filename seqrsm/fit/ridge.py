"""Paths over a fitted quadratic: ridge analysis, steepest ascent.

Notation as in :mod:`seqrsm.fit.canonical`: ``c + x'b + x'Bx`` in the q numeric factors, coded.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from seqrsm.arrays import FloatArray
from seqrsm.fit.optimum import Goal, sign_of


@dataclass(frozen=True, slots=True)
class Path:
    """Points along a path from the centre.

    Attributes
    ----------
    distance : ndarray (n,)
        Coded distance from the origin of the path.
    points : ndarray (n, q)
        Coded numeric factors.
    values : ndarray (n,)
        Fitted values.
    multipliers : ndarray (n,)
        The Lagrange multiplier mu of a ridge path; nan where it has none.
    """

    distance: FloatArray
    points: FloatArray
    values: FloatArray
    multipliers: FloatArray


def _sphere_multiplier(gaps: FloatArray, projected: FloatArray, radius: float) -> float | None:
    """Distance s > 0 of mu from the leading eigenvalue so that ``|x| = radius``; None in the hard case.

    ``|x|^2 = 1/4 sum projected_i^2 / (s + gap_i)^2`` with gap_i = l_max - l_i >= 0.
    """
    norm = float(np.linalg.norm(projected))
    if norm == 0.0:
        return None
    top = norm / (2.0 * radius)
    lead = gaps <= 1e-14 * max(float(gaps.max(initial=0.0)), top)
    low = float(np.linalg.norm(projected[lead])) / (2.0 * radius)
    if low <= 1e-13 * top:
        rest = ~lead
        if 0.5 * float(np.linalg.norm(projected[rest] / gaps[rest])) <= radius:
            return None
        low = np.finfo(float).tiny

    def excess(log_s: float) -> float:
        return float(np.log(0.5 * np.linalg.norm(projected / (np.exp(log_s) + gaps))) - np.log(radius))

    # One part in 1e12 to either side: at the ends the excess is zero but for rounding.
    low, top = low * (1.0 - 1e-12), top * (1.0 + 1e-12)
    return float(np.exp(brentq(excess, np.log(low), np.log(top), xtol=1e-15, rtol=8.9e-16)))


def ridge_path(
    constant: float, linear: FloatArray, quadratic: FloatArray, radii: FloatArray, goal: Goal = "maximize"
) -> Path:
    """Ridge analysis: the best point on spheres around the centre.

    The maximum on ``|x| = R`` is ``x(mu) = -(B - mu I)^-1 b / 2`` with ``mu`` at or above the largest eigenvalue. When
    b has no component along the leading eigenvector and R is large (the hard case), ``mu`` equals that eigenvalue and a
    multiple of the eigenvector is added; of the two equal solutions the one whose largest component of that eigenvector
    is positive is given.

    Parameters
    ----------
    constant, linear, quadratic : float, ndarray (q,), ndarray (q, q)
        ``c + x'b + x'Bx``, B symmetric.
    radii : ndarray (n,)
        Coded distances, >= 0.
    goal : "maximize" or "minimize"

    Returns
    -------
    Path
    """
    sign = sign_of(goal)
    values, vectors = np.linalg.eigh(sign * quadratic)
    values, vectors = values[::-1], vectors[:, ::-1]
    projected = vectors.T @ (sign * linear)
    gaps = values[0] - values
    radii = np.asarray(radii, dtype=np.float64)
    points = np.zeros((len(radii), len(linear)))
    multipliers = np.full(len(radii), np.nan)
    for i, radius in enumerate(radii):
        if radius <= 0.0:
            continue
        s = _sphere_multiplier(gaps, projected, float(radius))
        if s is not None:
            along = 0.5 * projected / (s + gaps)
            multipliers[i] = sign * (values[0] + s)
        else:
            lead = gaps <= 1e-14 * max(float(gaps.max()), 1.0e-300)
            along = np.where(lead, 0.0, 0.5 * projected / np.where(lead, 1.0, gaps))
            axis = vectors[:, 0] * np.sign(vectors[np.argmax(np.abs(vectors[:, 0])), 0])
            along = along + vectors.T @ axis * np.sqrt(max(radius**2 - float(along @ along), 0.0))
            multipliers[i] = sign * values[0]
        points[i] = vectors @ along
    return Path(radii, points, _values(constant, linear, quadratic, points), multipliers)


def steepest_path(
    constant: float, linear: FloatArray, quadratic: FloatArray, distances: FloatArray, goal: Goal = "maximize"
) -> Path:
    """Path of steepest ascent (or descent) from the centre.

    For a first-order surface this is the straight line along the gradient; for a second-order one it is the ridge path,
    as in R's rsm.

    Parameters
    ----------
    constant, linear, quadratic : float, ndarray (q,), ndarray (q, q)
        ``c + x'b + x'Bx``; a B of zeros is a first-order surface.
    distances : ndarray (n,)
        Coded distances, >= 0.
    goal : "maximize" or "minimize"

    Returns
    -------
    Path
    """
    if np.any(quadratic != 0.0):
        return ridge_path(constant, linear, quadratic, distances, goal)
    norm = float(np.linalg.norm(linear))
    direction = np.zeros_like(linear) if norm == 0.0 else sign_of(goal) * linear / norm
    distances = np.asarray(distances, dtype=np.float64)
    points = distances[:, None] * direction
    return Path(distances, points, _values(constant, linear, quadratic, points), np.full(len(distances), np.nan))


def _values(constant: float, linear: FloatArray, quadratic: FloatArray, points: FloatArray) -> FloatArray:
    values: FloatArray = constant + points @ linear + np.sum((points @ quadratic) * points, axis=1)
    return values
