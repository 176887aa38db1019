"""Compiled coordinate exchange of designs in plots, in a box.

Notation: base columns G (n, m) and model rows F (n, p) as in :mod:`seqrsm.design.kernels`; the runs of plot w are
``plot_at[w]`` to ``plot_at[w + 1]``, s_w is the sum of their rows, c = eta / (1 + m_w eta) and

    M = F'F - sum_w c s_w s_w',    D = M^-1.

A run whose row changes by d changes M by d g' + g d' + (1 - c) d d' with g = f - c s_w, so that |M| grows by

    (1 + d'Dg)^2 + d'Dd (1 - c - g'Dg).

A factor is its base columns ``column[j]`` to ``column[j] + width[j]``; its levels are rows of ``levels`` (l, widest),
``level_at[j]`` to ``level_at[j + 1]``. A continuous one takes ``steps``, or steps of ``radius`` about where it is.
``term_at`` and ``terms`` name the terms that each factor is in; ``first`` and ``second`` their base columns.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np

from seqrsm.arrays import BoolArray, FloatArray, IntArray
from seqrsm.jit import kernel

Plan: TypeAlias = tuple[
    IntArray, BoolArray, BoolArray, IntArray, IntArray, IntArray, FloatArray, IntArray, IntArray, IntArray, IntArray
]

_GAIN = 1e-9
_PIVOT = 1e-12


@kernel
def log_determinant(M: FloatArray, L: FloatArray) -> float:
    """log|M| of a symmetric M by Cholesky, in the work space L; -inf where M is numerically singular."""
    p = M.shape[0]
    total = 0.0
    for j in range(p):
        pivot = M[j, j]
        for c in range(j):
            pivot -= L[j, c] * L[j, c]
        if not pivot > _PIVOT * abs(M[j, j]):
            return -np.inf
        root = math.sqrt(pivot)
        total += math.log(pivot)
        L[j, j] = root
        for i in range(j + 1, p):
            value = M[i, j]
            for c in range(j):
                value -= L[i, c] * L[j, c]
            L[i, j] = value / root
    return total


@kernel
def add_plot(F: FloatArray, start: int, stop: int, share: float, sign: float, M: FloatArray) -> None:
    """Add ``sign`` times the information of the runs of one plot to M; ``share`` is c."""
    p = M.shape[0]
    total = np.zeros(p)
    for i in range(start, stop):
        for a in range(p):
            total[a] += F[i, a]
            for b in range(p):
                M[a, b] += sign * F[i, a] * F[i, b]
    for a in range(p):
        for b in range(p):
            M[a, b] -= sign * share * total[a] * total[b]


@kernel
def candidate(j: int, index: int, now: float, radius: float, plan: Plan, steps: FloatArray, out: FloatArray) -> None:
    """Write base values number ``index`` of factor j to ``out``."""
    _, _, continuous, _, width, level_at, levels, _, _, _, _ = plan
    if continuous[j]:
        out[0] = steps[index] if radius == 0.0 else min(1.0, max(-1.0, now + radius * steps[index]))
    else:
        for b in range(width[j]):
            out[b] = levels[level_at[j] + index, b]


@kernel
def move_run(i: int, j: int, share: float, G: FloatArray, F: FloatArray, D: FloatArray, total: FloatArray, plan: Plan,
             steps: FloatArray, radius: float) -> float:  # fmt: skip
    """Give factor j of run i its best value, in place; returns the gain in log|M|. ``total`` is s of its plot."""
    _, _, continuous, column, width, level_at, _, term_at, terms, first, second = plan
    p = F.shape[1]
    g, u = np.empty(p), np.zeros(p)
    for a in range(p):
        g[a] = F[i, a] - share * total[a]
    for a in range(p):
        for b in range(p):
            u[b] += g[a] * D[a, b]
    gg = np.dot(g, u)
    start, stop = term_at[j], term_at[j + 1]
    trial, best_value, d = np.empty(width[j]), np.empty(width[j]), np.empty(stop - start)
    kept = G[i, column[j] : column[j] + width[j]].copy()
    best = 1.0 + _GAIN
    found = False
    for index in range(steps.size if continuous[j] else level_at[j + 1] - level_at[j]):
        candidate(j, index, kept[0], radius, plan, steps, trial)
        for b in range(width[j]):
            G[i, column[j] + b] = trial[b]
        du = dd = 0.0
        for a in range(start, stop):
            t = terms[a]
            d[a - start] = G[i, first[t]] * G[i, second[t]] - F[i, t]
            du += d[a - start] * u[t]
        for a in range(start, stop):
            row = 0.0
            for b in range(start, stop):
                row += d[b - start] * D[terms[a], terms[b]]
            dd += d[a - start] * row
        ratio = (1.0 + du) ** 2 + dd * (1.0 - share - gg)
        if ratio > best:
            best, found = ratio, True
            best_value[:] = trial
    for b in range(width[j]):
        G[i, column[j] + b] = best_value[b] if found else kept[b]
    if not found:
        return 0.0
    # D of M + d h' + h d' with h = g + (1 - c) d / 2, by the Woodbury identity.
    v, h = np.zeros(p), u
    half = 0.5 * (1.0 - share)
    for a in range(start, stop):
        t = terms[a]
        change = G[i, first[t]] * G[i, second[t]] - F[i, t]
        F[i, t] += change
        total[t] += change
        g[t] += half * change
        d[a - start] = change
        for b in range(p):
            v[b] += change * D[t, b]
    dd = dh = 0.0
    for a in range(start, stop):
        dd += d[a - start] * v[terms[a]]
    for b in range(p):
        h[b] += half * v[b]
    hh = np.dot(g, h)
    for a in range(start, stop):
        dh += d[a - start] * h[terms[a]]
    ratio = (1.0 + dh) ** 2 - dd * hh
    for a in range(p):
        for b in range(p):
            D[a, b] += (hh * v[a] * v[b] - (1.0 + dh) * (v[a] * h[b] + h[a] * v[b]) + dd * h[a] * h[b]) / ratio
    return math.log(best)


@kernel
def move_plot(w: int, j: int, share: float, G: FloatArray, F: FloatArray, M: FloatArray, plan: Plan,
              steps: FloatArray, radius: float, value: float) -> float:  # fmt: skip
    """Give factor j of all runs of plot w its best value, in place; returns log|M|. M is kept up to date."""
    plot_at, _, continuous, column, width, level_at, _, term_at, terms, first, second = plan
    start, stop = plot_at[w], plot_at[w + 1]
    p = F.shape[1]
    rest, tried, L = M.copy(), np.empty((p, p)), np.empty((p, p))
    add_plot(F, start, stop, share, -1.0, rest)
    trial, best_value = np.empty(width[j]), np.empty(width[j])
    kept = G[start, column[j] : column[j] + width[j]].copy()
    best_value[:] = kept
    best = value + _GAIN
    count = steps.size if continuous[j] else level_at[j + 1] - level_at[j]
    for index in range(count + 1):
        # The last turn writes the best.
        if index < count:
            candidate(j, index, kept[0], radius, plan, steps, trial)
        else:
            trial[:] = best_value
        for i in range(start, stop):
            for b in range(width[j]):
                G[i, column[j] + b] = trial[b]
            for a in range(term_at[j], term_at[j + 1]):
                t = terms[a]
                F[i, t] = G[i, first[t]] * G[i, second[t]]
        tried[:] = rest
        add_plot(F, start, stop, share, 1.0, tried)
        if index < count:
            reached = log_determinant(tried, L)
            if reached > best:
                best = reached
                best_value[:] = trial
    M[:] = tried
    return best if best > value + _GAIN else value


@kernel
def exchange(G: FloatArray, F: FloatArray, eta: float, ridge: float, plan: Plan, steps: FloatArray, radius: float,
             passes: int) -> float:  # fmt: skip
    """Coordinate exchange until a pass gains nothing, in place; log|M + ridge|, -inf where singular."""
    plot_at, hard, _, _, _, _, _, _, _, first, second = plan
    n, p = F.shape
    M, L = np.zeros((p, p)), np.empty((p, p))
    for i in range(n):
        for t in range(p):
            F[i, t] = G[i, first[t]] * G[i, second[t]]
    value = -np.inf
    for count in range(passes + 1):
        M[:] = 0.0
        for t in range(p):
            M[t, t] = ridge
        for w in range(plot_at.size - 1):
            size = plot_at[w + 1] - plot_at[w]
            add_plot(F, plot_at[w], plot_at[w + 1], eta / (1.0 + size * eta), 1.0, M)
        before = value
        value = log_determinant(M, L)
        if value == -np.inf or not value > before + _GAIN or count == passes:
            break
        D = np.linalg.inv(M).astype(np.float64)
        reached = value
        for w in range(plot_at.size - 1):
            start, stop = plot_at[w], plot_at[w + 1]
            share = eta / (1.0 + (stop - start) * eta)
            held = reached
            for j in range(hard.size):
                if hard[j]:
                    reached = move_plot(w, j, share, G, F, M, plan, steps, radius, reached)
            if reached > held:
                D = np.linalg.inv(M).astype(np.float64)
            total = np.zeros(p)
            for i in range(start, stop):
                total += F[i]
            old = F[start:stop].copy()
            gained = 0.0
            for i in range(start, stop):
                for j in range(hard.size):
                    if not hard[j]:
                        gained += move_run(i, j, share, G, F, D, total, plan, steps, radius)
            if gained > 0.0:
                add_plot(old, 0, stop - start, share, -1.0, M)
                add_plot(F, start, stop, share, 1.0, M)
                reached += gained
    return value
