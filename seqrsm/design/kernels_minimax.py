"""Compiled descent on the largest prediction variance: all coordinates of a design move together.

Notation as in :mod:`seqrsm.design.kernels`: G (n, m) base columns of a design, F (n, p) model rows, M = F'F + R,
D = M^-1, v(z) = z'Dz. The soft maximum over places z_c is the mean of v^q to the power 1/q; its logarithm is minimised
within the box by a projected limited-memory BFGS method (Nocedal & Wright 2006, Numerical Optimization, 7.2 and 16.7).
Constraints are half-spaces, linear about where a run is, that a run may leave at a price of q times distance squared.
"""

from __future__ import annotations

import math

import numpy as np

from seqrsm.arrays import FloatArray, IntArray
from seqrsm.jit import kernel

_RIDGE = 1e-10  # share of the mean diagonal of M added to it: a singular design has a huge variance, not none
_LIGHT = 1e-9  # places of less weight are left out of the slope
_MEMORY = 8
_HALVINGS = 12
_LONGEST = 0.5  # longest move of a coordinate in one step


@kernel
def model_rows(G: FloatArray, first: IntArray, second: IntArray, F: FloatArray) -> None:
    """Write the model rows F (n, p) of the base columns G (n, m)."""
    for i in range(G.shape[0]):
        for t in range(first.size):
            F[i, t] = G[i, first[t]] * G[i, second[t]]


@kernel
def covariance(F: FloatArray, R: FloatArray) -> FloatArray:
    """(F'F + R)^-1 with a ridge that only a singular design feels."""
    M = R + F.T @ F
    p = M.shape[0]
    ridge = _RIDGE * np.trace(M) / p
    for t in range(p):
        M[t, t] += ridge
    D: FloatArray = np.linalg.inv(M).astype(np.float64)
    return D


@kernel
def soft_maximum(G: FloatArray, free: IntArray, first: IntArray, second: IntArray, R: FloatArray, places: FloatArray,
                 power: float, F: FloatArray, slope: FloatArray) -> float:  # fmt: skip
    """Logarithm of the soft maximum over the places (m, p); its slope (n, c) in the base columns ``free`` (c,)."""
    model_rows(G, first, second, F)
    n, p = F.shape
    D = covariance(F, R)
    P = places @ D
    m = places.shape[0]
    v = np.empty(m)
    top = 0.0
    for a in range(m):
        total = 0.0
        for t in range(p):
            total += P[a, t] * places[a, t]
        v[a] = total
        top = max(top, total)
    slope[:] = 0.0
    if not (top > 0.0 and math.isfinite(top)):
        return np.inf
    total = 0.0
    heavy = 0
    for a in range(m):
        share = math.exp(power * math.log(max(v[a], 1e-300) / top))
        total += share
        if share > _LIGHT:
            root = math.sqrt(share / v[a])
            for t in range(p):
                P[heavy, t] = root * P[a, t]
            heavy += 1
    Q = P[:heavy]
    pulled = (F @ Q.T) @ Q
    for i in range(n):
        for t in range(p):
            weight = -2.0 * pulled[i, t] / total
            for c in range(free.size):
                if first[t] == free[c]:
                    slope[i, c] += weight * G[i, second[t]]
                if second[t] == free[c]:
                    slope[i, c] += weight * G[i, first[t]]
    return math.log(top) + math.log(total / m) / power


@kernel
def outside(G: FloatArray, free: IntArray, normals: FloatArray, offsets: FloatArray, price: float, slope: FloatArray
            ) -> float:  # fmt: skip
    """Price of leaving the half-spaces normals x <= offsets, (n, h, c) and (n, h); its slope is added to ``slope``."""
    total = 0.0
    for i in range(normals.shape[0]):
        for h in range(normals.shape[1]):
            beyond = -offsets[i, h]
            for c in range(free.size):
                beyond += normals[i, h, c] * G[i, free[c]]
            if beyond > 0.0:
                total += price * beyond * beyond
                for c in range(free.size):
                    slope[i, c] += 2.0 * price * beyond * normals[i, h, c]
    return total


@kernel
def descend(G: FloatArray, free: IntArray, first: IntArray, second: IntArray, R: FloatArray, places: FloatArray,
            normals: FloatArray, offsets: FloatArray, power: float, iterations: int, tolerance: float
            ) -> float:  # fmt: skip
    """Lower the soft maximum (and the price of leaving the half-spaces), in place; returns its logarithm.

    Ends after so many iterations, or where two in turn gain less than ``tolerance``.
    """
    n, c = G.shape[0], free.size
    size = n * c
    F = np.empty((n, first.size))
    trial = G.copy()
    slope, new_slope = np.zeros((n, c)), np.zeros((n, c))
    steps, changes = np.zeros((_MEMORY, size)), np.zeros((_MEMORY, size))
    curvature, alpha = np.zeros(_MEMORY), np.zeros(_MEMORY)
    way = np.zeros(size)
    kept, newest, idle = 0, 0, 0
    value = soft_maximum(G, free, first, second, R, places, power, F, slope)
    value += outside(G, free, normals, offsets, power, slope)
    if not math.isfinite(value):
        return value
    for _ in range(iterations):
        g = slope.reshape(size)
        held = np.zeros(size, dtype=np.bool_)
        for s in range(size):
            x = G[s // c, free[s % c]]
            held[s] = (x <= -1.0 and g[s] > 0.0) or (x >= 1.0 and g[s] < 0.0)
            way[s] = 0.0 if held[s] else -g[s]
        for back in range(kept):
            b = (newest - back) % _MEMORY
            alpha[b] = np.dot(steps[b], way) / curvature[b]
            way -= alpha[b] * changes[b]
        if kept:
            way *= curvature[newest] / np.dot(changes[newest], changes[newest])
        for back in range(kept - 1, -1, -1):
            b = (newest - back) % _MEMORY
            way += (alpha[b] - np.dot(changes[b], way) / curvature[b]) * steps[b]
        fall, longest = 0.0, 0.0
        for s in range(size):
            if held[s]:
                way[s] = 0.0
            fall += way[s] * g[s]
            longest = max(longest, abs(way[s]))
        if not fall < 0.0:
            kept, fall, longest = 0, 0.0, 0.0
            for s in range(size):
                way[s] = 0.0 if held[s] else -g[s]
                fall += way[s] * g[s]
                longest = max(longest, abs(way[s]))
            if not fall < 0.0:
                break
        reach = min(1.0, _LONGEST / longest) if kept else min(1.0, 0.1 / longest)
        reached = np.inf
        for _ in range(_HALVINGS):
            gained = 0.0
            for s in range(size):
                i, j = s // c, free[s % c]
                trial[i, j] = min(1.0, max(-1.0, G[i, j] + reach * way[s]))
                gained += g[s] * (trial[i, j] - G[i, j])
            reached = soft_maximum(trial, free, first, second, R, places, power, F, new_slope)
            reached += outside(trial, free, normals, offsets, power, new_slope)
            if reached <= value + 1e-4 * gained:
                break
            reach *= 0.4
        if not reached < value:
            if kept == 0:
                break
            kept = 0
            continue
        newest = (newest + 1) % _MEMORY if kept else 0
        product, length, width = 0.0, 0.0, 0.0
        for s in range(size):
            i, j = s // c, free[s % c]
            step = trial[i, j] - G[i, j]
            change = new_slope[i, s % c] - slope[i, s % c]
            steps[newest, s], changes[newest, s] = step, change
            product += step * change
            length += step * step
            width += change * change
        if product > 1e-10 * math.sqrt(length * width):
            curvature[newest] = product
            kept = min(kept + 1, _MEMORY)
        else:
            kept = 0
        idle = idle + 1 if value - reached < tolerance else 0
        value = reached
        G[:] = trial
        slope[:] = new_slope
        if idle == 2:
            break
    return value


@kernel
def climb(X: FloatArray, free: IntArray, first: IntArray, second: IntArray, D: FloatArray, sweeps: int,
          values: FloatArray) -> None:  # fmt: skip
    """Move the base columns X (m, b) of places to local maxima of z'Dz in the box, in place; their values (m,).

    One coordinate at a time by Newton steps, none longer than a quarter: a step to the best place of a line would
    leave the hill.
    """
    p = first.size
    z, u, slope = np.empty(p), np.empty(p), np.empty(p)
    for a in range(X.shape[0]):
        x = X[a]
        for t in range(p):
            z[t] = x[first[t]] * x[second[t]]
        for s in range(p):
            u[s] = 0.0
        for t in range(p):
            for s in range(p):
                u[s] += D[t, s] * z[t]
        for _ in range(sweeps):
            farthest = 0.0
            for j in free:
                g = h = 0.0
                for t in range(p):
                    slope[t] = 0.0
                    if first[t] == j:
                        slope[t] += x[second[t]]
                    if second[t] == j:
                        slope[t] += x[first[t]]
                        if first[t] == j:
                            h += 2.0 * u[t]
                    g += slope[t] * u[t]
                for t in range(p):
                    if slope[t] != 0.0:
                        for s in range(p):
                            if slope[s] != 0.0:
                                h += slope[t] * D[t, s] * slope[s]
                step = -g / h if h < 0.0 else math.copysign(0.25, g)
                step = min(0.25, max(-0.25, step))
                place = min(1.0, max(-1.0, x[j] + step))
                farthest = max(farthest, abs(place - x[j]))
                x[j] = place
                for t in range(p):
                    if first[t] == j or second[t] == j:
                        new = x[first[t]] * x[second[t]]
                        if new != z[t]:
                            for s in range(p):
                                u[s] += (new - z[t]) * D[t, s]
                            z[t] = new
            if farthest < 1e-6:
                break
        values[a] = np.dot(z, u)
