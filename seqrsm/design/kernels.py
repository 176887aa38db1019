"""Compiled coordinate exchange: the only compiled code of the design package.

Notation: a design is X (n, k) coded points, G (n, m) base columns, F (n, p) model rows (see
:class:`seqrsm.design.quadratic.QuadraticModel`); M = F'F + R with R (p, p) the precision that the prior and fixed runs
bring; D = M^-1; for a linear criterion tr(W D), E = D W D.

Moving one coordinate of one run from t0 to t0 + s changes its row by ``delta = s (b + 2 t0 e) + s^2 e`` with b of few
entries and e a unit vector. So the ratio of determinants, (1 + d_n)(1 - d_o) + d_no^2, is a quartic in s whose
coefficients cost O(k^2), and its maximum over an interval is an end or a root of a cubic: no grid, no tolerance
(Meyer & Nachtsheim 1995, Technometrics 37, 60-69, with an exact line search). A linear criterion gains a ratio of two
quartics, maximised exactly by Dinkelbach's iteration (Management Science 13, 1967, 492-498).

``layout`` is a tuple of arrays: kind (k,) 0 numeric, 1 categorical; column (k,) first base column of a factor; count
(k,) number of categorical levels; spans (s, 2) with span_at (k + 1,) the intervals and, as intervals of no length, the
levels that a factor may take; terms, own, other with term_at (k + 1,): per factor the terms it is in, its own base
column there and the other base column, or -1 for a square; first and second (p,) the base columns of each term.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np

from seqrsm.arrays import FloatArray, IntArray
from seqrsm.jit import kernel

Layout: TypeAlias = tuple[
    IntArray, IntArray, IntArray, FloatArray, IntArray, IntArray, IntArray, IntArray, IntArray, IntArray, IntArray
]
# D, E, work (2p, p), vectors (4, p): u, w, un, wn; scalars (3,): d_o, e_o, trace; c, num, den (5,), roots (3,).
Buffers: TypeAlias = tuple[
    FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray
]

_GAIN = 1e-13  # smallest relative gain of a move
_COARSE, _FINE, _END = 1e-4, 1e-6, 1e-12  # smallest gain of a pass: both stages of a local search, and the end
_MARGIN = 2e-3  # what the second stage may still gain
_PIVOT = 1e-13  # smallest pivot relative to the diagonal
_MAX_PASSES = 300


@kernel
def mix(state: np.uint64) -> np.uint64:
    """Finalizer of splitmix64 (Steele, Lea & Flood 2014): scrambles a counter into 64 random bits."""
    z = state
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


@kernel
def uniform(state: np.ndarray) -> float:
    """Next number in [0, 1) of the stream; ``state`` (1,) of uint64 is moved on."""
    state[0] = state[0] + np.uint64(0x9E3779B97F4A7C15)
    return float(mix(state[0]) >> np.uint64(11)) * (1.0 / 9007199254740992.0)


@kernel
def invert(M: FloatArray, D: FloatArray, L: FloatArray) -> float:
    """Write the inverse of a symmetric M into D by Cholesky; return log|M|, or -inf where M is numerically singular."""
    p = M.shape[0]
    logdet = 0.0
    for j in range(p):
        for i in range(j, p):
            L[i, j] = M[i, j]
    for j in range(p):
        pivot = L[j, j]
        if not pivot > _PIVOT * abs(M[j, j]) or not math.isfinite(pivot):
            return -np.inf
        logdet += math.log(pivot)
        root = math.sqrt(pivot)
        for i in range(j, p):
            L[i, j] /= root
        for c in range(j + 1, p):
            factor = L[c, j]
            for i in range(c, p):
                L[i, c] -= L[i, j] * factor
    # Rows of L^-1 below the diagonal, then D = L^-T L^-1; D doubles as work space.
    for j in range(p):
        for i in range(p):
            D[j, i] = 0.0
        D[j, j] = 1.0
        for i in range(j):
            factor = L[j, i]
            for c in range(i + 1):
                D[j, c] -= factor * D[i, c]
        for c in range(j + 1):
            D[j, c] /= L[j, j]
    for i in range(p):
        for j in range(i + 1):
            total = 0.0
            for r in range(i, p):
                total += D[r, i] * D[r, j]
            L[i, j] = total
    for i in range(p):
        for j in range(i + 1):
            D[i, j] = L[i, j]
            D[j, i] = L[i, j]
    return logdet


@kernel
def rebuild(
    F: FloatArray, R: FloatArray, W: FloatArray, D: FloatArray, E: FloatArray, work: FloatArray, linear: bool
) -> float:
    """Fill D and E from the rows anew; return the gain to be maximised: log|M|, or -log tr(W D); -inf if singular."""
    n, p = F.shape
    M = work[:p]
    for a in range(p):
        for b in range(p):
            M[a, b] = R[a, b]
    for i in range(n):
        for a in range(p):
            x = F[i, a]
            for b in range(p):
                M[a, b] += x * F[i, b]
    logdet = invert(M, D, work[p:])
    if logdet == -np.inf or not linear:
        return logdet
    trace = 0.0
    for a in range(p):
        for b in range(p):
            total = 0.0
            for c in range(p):
                total += W[a, c] * D[c, b]
            M[a, b] = total
        trace += M[a, a]
    for a in range(p):
        for b in range(p):
            E[a, b] = 0.0
        for c in range(p):
            x = D[a, c]
            for b in range(p):
                E[a, b] += x * M[c, b]
    return -math.log(trace) if trace > 0.0 else -np.inf


@kernel
def cubic_roots(c0: float, c1: float, c2: float, c3: float, roots: FloatArray) -> int:
    """Real roots of c0 + c1 s + c2 s^2 + c3 s^3; returns how many were written."""
    scale = max(abs(c0), abs(c1), abs(c2), abs(c3))
    if scale == 0.0:
        return 0
    if abs(c3) <= 1e-14 * scale:
        if abs(c2) <= 1e-14 * scale:
            if c1 == 0.0:
                return 0
            roots[0] = -c0 / c1
            return 1
        discriminant = c1 * c1 - 4.0 * c2 * c0
        if discriminant < 0.0:
            return 0
        q = -0.5 * (c1 + math.copysign(math.sqrt(discriminant), c1))
        roots[0] = q / c2
        if q == 0.0:
            return 1
        roots[1] = c0 / q
        return 2
    a, b, c = c2 / c3, c1 / c3, c0 / c3
    q = (a * a - 3.0 * b) / 9.0
    r = (2.0 * a * a * a - 9.0 * a * b + 27.0 * c) / 54.0
    if r * r < q * q * q:
        angle = math.acos(min(1.0, max(-1.0, r / math.sqrt(q * q * q)))) / 3.0
        size = -2.0 * math.sqrt(q)
        turn = 2.0943951023931953
        roots[0] = size * math.cos(angle) - a / 3.0
        roots[1] = size * math.cos(angle + turn) - a / 3.0
        roots[2] = size * math.cos(angle - turn) - a / 3.0
        return 3
    s = -math.copysign((abs(r) + math.sqrt(max(r * r - q * q * q, 0.0))) ** (1.0 / 3.0), r)
    roots[0] = (s + (q / s if s != 0.0 else 0.0)) - a / 3.0
    return 1


@kernel
def quartic(c: FloatArray, s: float) -> float:
    """Value of c[0] + c[1] s + ... + c[4] s^4."""
    return c[0] + s * (c[1] + s * (c[2] + s * (c[3] + s * c[4])))


@kernel
def quartic_maximum(c: FloatArray, low: float, high: float, roots: FloatArray) -> float:
    """Place of the largest value of a quartic on [low, high]."""
    best = low
    value = quartic(c, low)
    other = quartic(c, high)
    if other > value:
        best, value = high, other
    for index in range(cubic_roots(c[1], 2.0 * c[2], 3.0 * c[3], 4.0 * c[4], roots)):
        s = roots[index]
        if low < s < high:
            other = quartic(c, s)
            if other > value:
                best, value = s, other
    return best


@kernel
def ratio_maximum(num: FloatArray, den: FloatArray, low: float, high: float, c: FloatArray, roots: FloatArray) -> float:
    """Place of the largest num/den on [low, high] (den > 0 there but for singular designs), by Dinkelbach."""
    place = 0.0
    ratio = 0.0
    for _ in range(12):
        for power in range(5):
            c[power] = num[power] - ratio * den[power]
        s = quartic_maximum(c, low, high, roots)
        below = quartic(den, s)
        if not below > 1e-12:
            return place
        new = quartic(num, s) / below
        if not new > ratio + 1e-13 * abs(ratio):
            return place
        place, ratio = s, new
    return place


@kernel
def contrast(level: int, last: int, c: int) -> float:
    """Sum-to-zero contrast ``c`` of a level; ``last`` is the index of the last level."""
    if level == last:
        return -1.0
    return 1.0 if level == c else 0.0


@kernel
def fill_row(x: FloatArray, g: FloatArray, f: FloatArray, layout: Layout) -> None:
    """Write base columns g (m,) and model row f (p,) of a point x (k,)."""
    kind, column, count, _, _, _, _, _, _, first, second = layout
    g[0] = 1.0
    for j in range(x.size):
        if kind[j] == 0:
            g[column[j]] = x[j]
        else:
            for c in range(count[j] - 1):
                g[column[j] + c] = contrast(int(x[j]), count[j] - 1, c)
    for t in range(f.size):
        f[t] = g[first[t]] * g[second[t]]


@kernel
def numeric_change(g: FloatArray, u: FloatArray, D: FloatArray, start: int, stop: int, terms: IntArray,
                   others: IntArray, own: float) -> tuple[float, float, float, float, float]:  # fmt: skip
    """Return (b'u, e'u, b'Db, b'De, e'De) of delta = s (b + 2 t0 e) + s^2 e, with b already holding 2 t0 e."""
    bu = eu = bb = be = ee = 0.0
    for a in range(start, stop):
        ta = terms[a]
        square = others[a] < 0
        va = 2.0 * own if square else g[others[a]]
        bu += va * u[ta]
        row = 0.0
        for b in range(start, stop):
            row += (2.0 * own if others[b] < 0 else g[others[b]]) * D[ta, terms[b]]
        bb += va * row
        if square:
            eu = u[ta]
            be = row
            ee = D[ta, ta]
    return bu, eu, bb, be, ee


@kernel
def move(i: int, G: FloatArray, F: FloatArray, D: FloatArray, E: FloatArray, u: FloatArray, w: FloatArray,
         scalars: FloatArray, start: int, stop: int, terms: IntArray, first: IntArray, second: IntArray, linear: bool,
         un: FloatArray, wn: FloatArray) -> float:  # fmt: skip
    """Take over the base columns already written into G[i]: update F[i], D, E, u = D f, w = E f, scalars (d_o, e_o).

    Returns the ratio of determinants. Rank-two update by the Woodbury identity:
    D <- D - [(1 - d_o) un un' + d_no (un u' + u un') - (1 + d_n) u u'] / ratio.
    """
    p = u.size
    for c in range(p):
        un[c] = u[c]
        if linear:
            wn[c] = w[c]
    for a in range(start, stop):
        t = terms[a]
        new = G[i, first[t]] * G[i, second[t]]
        delta = new - F[i, t]
        F[i, t] = new
        if delta != 0.0:
            for c in range(p):
                un[c] += delta * D[t, c]
            if linear:
                for c in range(p):
                    wn[c] += delta * E[t, c]
    d_o = scalars[0]
    d_n = 0.0
    d_no = 0.0
    for t in range(p):
        d_n += F[i, t] * un[t]
        d_no += F[i, t] * u[t]
    ratio = (1.0 - d_o) * (1.0 + d_n) + d_no * d_no
    alpha, beta, gamma = (1.0 - d_o) / ratio, d_no / ratio, (1.0 + d_n) / ratio
    if linear:
        e_o = scalars[1]
        e_n = 0.0
        e_no = 0.0
        for t in range(p):
            e_n += F[i, t] * wn[t]
            e_no += F[i, t] * w[t]
        # S W S = un (x un + y u)' + u (y un + z u)' with S the update of D.
        x = alpha * alpha * e_n + 2.0 * alpha * beta * e_no + beta * beta * e_o
        y = alpha * beta * e_n + (beta * beta - alpha * gamma) * e_no - beta * gamma * e_o
        z = beta * beta * e_n - 2.0 * beta * gamma * e_no + gamma * gamma * e_o
        for a in range(p):
            h1 = alpha * un[a] + beta * u[a]
            h2 = beta * un[a] - gamma * u[a]
            k1 = x * un[a] + y * u[a]
            k2 = y * un[a] + z * u[a]
            k3 = alpha * wn[a] + beta * w[a]
            k4 = beta * wn[a] - gamma * w[a]
            for c in range(p):
                E[a, c] += (k1 - k3) * un[c] + (k2 - k4) * u[c] - h1 * wn[c] - h2 * w[c]
    for a in range(p):
        h1 = alpha * un[a] + beta * u[a]
        h2 = beta * un[a] - gamma * u[a]
        for c in range(p):
            D[a, c] -= h1 * un[c] + h2 * u[c]
    scalars[0] = 1.0 - (1.0 - d_o) / ratio
    for c in range(p):
        u[c] = alpha * un[c] + beta * u[c]
    if linear:
        multiply(E, F[i], w)
        scalars[1] = dot(F[i], w)
    return ratio


@kernel
def multiply(D: FloatArray, f: FloatArray, u: FloatArray) -> None:
    """Write u = D f for a symmetric D."""
    for c in range(u.size):
        u[c] = 0.0
    for a in range(f.size):
        x = f[a]
        for c in range(u.size):
            u[c] += x * D[a, c]


@kernel
def dot(f: FloatArray, u: FloatArray) -> float:
    """Scalar product."""
    total = 0.0
    for a in range(f.size):
        total += f[a] * u[a]
    return total


@kernel
def polynomials(bu: float, eu: float, bb: float, be: float, ee: float, d_o: float, den: FloatArray) -> None:
    """Ratio of determinants as a quartic in the step s; den[0] = 1."""
    den[0] = 1.0
    den[1] = 2.0 * bu
    den[2] = 2.0 * eu + (1.0 - d_o) * bb + bu * bu
    den[3] = 2.0 * (1.0 - d_o) * be + 2.0 * bu * eu
    den[4] = (1.0 - d_o) * ee + eu * eu


@kernel
def numerator(q: tuple[float, float, float, float, float], r: tuple[float, float, float, float, float], d_o: float,
              e_o: float, num: FloatArray) -> None:  # fmt: skip
    """Fall of tr(W D) times the ratio of determinants, as a quartic in the step.

    (1 - d_o) e_n + 2 d_no e_no - (1 + d_n) e_o with q = (b'u, e'u, b'Db, b'De, e'De) and r the same for w and E.
    """
    bu, eu, bb, be, ee = q
    bw, ew, ebb, ebe, eee = r
    num[0] = 0.0
    num[1] = 2.0 * bw
    num[2] = 2.0 * ew + (1.0 - d_o) * ebb + 2.0 * bu * bw - e_o * bb
    num[3] = 2.0 * (1.0 - d_o) * ebe + 2.0 * (bu * ew + eu * bw) - 2.0 * e_o * be
    num[4] = (1.0 - d_o) * eee + 2.0 * eu * ew - e_o * ee


@kernel
def make_buffers(p: int) -> Buffers:
    """Work space for a model of p terms."""
    return (
        np.zeros((p, p)),
        np.zeros((p, p)),
        np.zeros((2 * p, p)),
        np.zeros((4, p)),
        np.zeros(3),
        np.zeros(5),
        np.zeros(5),
        np.zeros(5),
        np.zeros(3),
    )


@kernel
def enter_row(i: int, F: FloatArray, linear: bool, buffers: Buffers) -> None:
    """Fill u = D f, w = E f and their products with f for row i."""
    D, E, _, vectors, scalars, _, _, _, _ = buffers
    multiply(D, F[i], vectors[0])
    scalars[0] = dot(F[i], vectors[0])
    if linear:
        multiply(E, F[i], vectors[1])
        scalars[1] = dot(F[i], vectors[1])


@kernel
def numeric_place(i: int, j: int, t0: float, spans: FloatArray, G: FloatArray, layout: Layout, linear: bool,
                  buffers: Buffers) -> tuple[float, float]:  # fmt: skip
    """Best place of numeric coordinate j of row i in the spans, and its gain: ratio - 1, or fall of the trace."""
    _, _, _, _, _, term_at, terms, _, other, _, _ = layout
    D, E, _, vectors, scalars, c, num, den, roots = buffers
    start, stop = term_at[j], term_at[j + 1]
    q = numeric_change(G[i], vectors[0], D, start, stop, terms, other, t0)
    polynomials(q[0], q[1], q[2], q[3], q[4], scalars[0], den)
    if linear:
        r = numeric_change(G[i], vectors[1], E, start, stop, terms, other, t0)
        numerator(q, r, scalars[0], scalars[1], num)
    best, place = 0.0, t0
    for index in range(spans.shape[0]):
        low, high = spans[index, 0] - t0, spans[index, 1] - t0
        step = low
        if high > low:
            step = ratio_maximum(num, den, low, high, c, roots) if linear else quartic_maximum(den, low, high, roots)
        below = quartic(den, step)
        gain = below - 1.0
        if linear:
            gain = quartic(num, step) / below if below > 1e-12 else -np.inf
        if gain > best:
            # An end is taken over as it is written, not as t0 + (end - t0).
            ends = spans[index, 1] if step == high else t0 + step
            best, place = gain, spans[index, 0] if step == low else ends
    return place, best


@kernel
def category_gain(i: int, j: int, level: int, G: FloatArray, layout: Layout, linear: bool, buffers: Buffers) -> float:
    """Gain of giving categorical factor j of row i another level: ratio - 1, or fall of the trace."""
    _, column, count, _, _, term_at, terms, own, other, _, _ = layout
    D, E, _, vectors, scalars, _, _, _, _ = buffers
    delta_u = delta_w = quad_d = quad_e = 0.0
    last = count[j] - 1
    for a in range(term_at[j], term_at[j + 1]):
        va = (contrast(level, last, own[a] - column[j]) - G[i, own[a]]) * G[i, other[a]]
        if va == 0.0:
            continue
        ta = terms[a]
        delta_u += va * vectors[0, ta]
        delta_w += va * vectors[1, ta]
        for b in range(term_at[j], term_at[j + 1]):
            vb = (contrast(level, last, own[b] - column[j]) - G[i, own[b]]) * G[i, other[b]]
            quad_d += va * vb * D[ta, terms[b]]
            quad_e += va * vb * E[ta, terms[b]]
    d_o, e_o = scalars[0], scalars[1]
    d_n, d_no = d_o + 2.0 * delta_u + quad_d, d_o + delta_u
    ratio = (1.0 - d_o) * (1.0 + d_n) + d_no * d_no
    if not linear:
        return ratio - 1.0
    if not ratio > 1e-12:
        return -np.inf
    e_n, e_no = e_o + 2.0 * delta_w + quad_e, e_o + delta_w
    return ((1.0 - d_o) * e_n + 2.0 * d_no * e_no - (1.0 + d_n) * e_o) / ratio


@kernel
def improve(i: int, j: int, spans: FloatArray, X: FloatArray, G: FloatArray, F: FloatArray, layout: Layout,
            linear: bool, buffers: Buffers) -> float:  # fmt: skip
    """Move coordinate j of row i to its best place in the spans; return the gain in log|M| or -log tr(W D)."""
    kind, column, count, _, _, term_at, terms, _, _, first, second = layout
    D, E, _, vectors, scalars, _, _, _, _ = buffers
    place, best = X[i, j], 0.0
    if kind[j] == 0:
        place, best = numeric_place(i, j, X[i, j], spans, G, layout, linear, buffers)
    else:
        for index in range(spans.shape[0]):
            if spans[index, 0] != X[i, j]:
                gain = category_gain(i, j, int(spans[index, 0]), G, layout, linear, buffers)
                if gain > best:
                    best, place = gain, spans[index, 0]
    if not best > _GAIN * (scalars[2] if linear else 1.0):
        return 0.0
    X[i, j] = place
    if kind[j] == 0:
        G[i, column[j]] = place
    else:
        for c in range(count[j] - 1):
            G[i, column[j] + c] = contrast(int(place), count[j] - 1, c)
    move(i, G, F, D, E, vectors[0], vectors[1], scalars, term_at[j], term_at[j + 1], terms, first, second, linear,
         vectors[2], vectors[3])  # fmt: skip
    if not linear:
        return math.log1p(best)
    gain = -math.log1p(-min(best / scalars[2], 1.0 - 1e-15))
    scalars[2] -= best
    return gain


@kernel
def exchange(X: FloatArray, G: FloatArray, F: FloatArray, R: FloatArray, W: FloatArray, linear: bool, layout: Layout,
             buffers: Buffers, pass_gain: float) -> float:  # fmt: skip
    """Coordinate exchange in a box, in place, until a pass gains less; return the value, -inf if singular."""
    _, _, _, spans, span_at, _, _, _, _, _, _ = layout
    D, E, work, _, scalars, _, _, _, _ = buffers
    n, k = X.shape
    value = rebuild(F, R, W, D, E, work, linear)
    for sweep in range(_MAX_PASSES):
        if not value > -np.inf:
            return -np.inf
        scalars[2] = math.exp(-value) if linear else 1.0
        gain = 0.0
        for i in range(n):
            enter_row(i, F, linear, buffers)
            for j in range(k):
                gain += improve(i, j, spans[span_at[j] : span_at[j + 1]], X, G, F, layout, linear, buffers)
        if gain < pass_gain:
            break
        # Rank-two updates drift: start from the rows again now and then.
        value = rebuild(F, R, W, D, E, work, linear) if sweep % 3 == 2 else value + gain
    return rebuild(F, R, W, D, E, work, linear)


@kernel
def random_row(x: FloatArray, layout: Layout, state: np.ndarray, centred: float) -> None:
    """Random point of the box: uniform, or with probability ``centred`` of coordinates -1, 0, 1 and any level."""
    _, _, _, spans, span_at, _, _, _, _, _, _ = layout
    coarse = uniform(state) < centred
    for j in range(x.size):
        index = span_at[j] + int(uniform(state) * (span_at[j + 1] - span_at[j]))
        low, high = spans[index, 0], spans[index, 1]
        r = uniform(state)
        x[j] = low + (0.5 * math.floor(3.0 * r) if coarse else r) * (high - low)


@kernel
def refresh(X: FloatArray, G: FloatArray, F: FloatArray, layout: Layout) -> None:
    """Fill G and F from X."""
    for i in range(X.shape[0]):
        fill_row(X[i], G[i], F[i], layout)


@kernel
def perturb(X: FloatArray, layout: Layout, state: np.ndarray) -> None:
    """Change one to four rows: a random point, a coarse point, or another place for one or two coordinates."""
    kind, _, _, _, span_at, _, _, _, _, _, _ = layout
    n, k = X.shape
    fresh = np.empty(k)
    for _ in range(1 + int(4.0 * uniform(state))):
        i = int(n * uniform(state))
        r = uniform(state)
        if r < 0.6:
            random_row(X[i], layout, state, 1.0 if r < 0.3 else 0.0)
            continue
        random_row(fresh, layout, state, 1.0)
        for _ in range(1 + int(2.0 * uniform(state))):
            j = int(k * uniform(state))
            single = span_at[j + 1] - span_at[j] == 1
            X[i, j] = -X[i, j] if kind[j] == 0 and single and uniform(state) < 0.5 else fresh[j]


@kernel
def local_search(X: FloatArray, G: FloatArray, F: FloatArray, R: FloatArray, W: FloatArray, linear: bool,
                 layout: Layout, buffers: Buffers, needed: float, fine: float) -> float:  # fmt: skip
    """Coordinate exchange; carried to the end only where it may still reach the value needed."""
    refresh(X, G, F, layout)
    value = -np.inf
    for stage in range(2):
        value = exchange(X, G, F, R, W, linear, layout, buffers, _COARSE if stage == 0 else fine)
        if not value > needed - _MARGIN:
            break
    return value


@kernel
def draw_start(X: FloatArray, G: FloatArray, F: FloatArray, R: FloatArray, W: FloatArray, layout: Layout,
               buffers: Buffers, state: np.ndarray, floor: float) -> None:  # fmt: skip
    """Random design whose log|M| exceeds the floor, or the last of 30 draws."""
    coarse = 0.5 * math.floor(3.0 * uniform(state))
    for _ in range(30):
        for i in range(X.shape[0]):
            random_row(X[i], layout, state, coarse)
        refresh(X, G, F, layout)
        if rebuild(F, R, W, buffers[0], buffers[1], buffers[2], False) > floor:
            break


@kernel
def copy_rows(X: FloatArray, out: FloatArray) -> None:
    """Write ``X`` to ``out``; ``out[:] = X`` has numba compile a message of shapes that differ, for two seconds."""
    for i in range(X.shape[0]):
        for j in range(X.shape[1]):
            out[i, j] = X[i, j]


@kernel
def search(seed: int, n: int, n_base: int, R: FloatArray, W: FloatArray, linear: bool, layout: Layout, chains: int,
           starts: int, moves: int, threshold: float, floor: float, done: IntArray,
           ) -> tuple[FloatArray, float, int]:  # fmt: skip
    """Chains of multi-start coordinate exchange, each followed by iterated local search from its best.

    Parameters
    ----------
    seed : int
        Chain c draws from the stream (seed, c).
    n, n_base : int
        Rows to choose; base columns.
    chains, starts, moves : int
        Chains; random starts and perturbations in each.
    threshold : float
        Fall of the value (log|M| or -log tr(W D)) still accepted as the next point to perturb.
    floor : float
        Starts of smaller log|M| are drawn anew.
    done : int64 array (1,)
        Written: local searches made so far.

    Returns
    -------
    X (n, k), value, and how many local searches ended at this value (to 1e-5)
    """
    k, p = layout[0].size, R.shape[0]
    buffers = make_buffers(p)
    state = np.zeros(1, dtype=np.uint64)
    X, G, F = np.zeros((n, k)), np.zeros((n, n_base)), np.zeros((n, p))
    best_X, chain_X, current_X = X.copy(), X.copy(), X.copy()
    best = chain_best = current = -np.inf
    hits = 0
    each = starts + moves
    # Every step prepares X and then passes the one call of the local search: a second one would double compilation.
    for count in range(chains * each + 1):
        chain, step = divmod(count, each)
        last = chain == chains
        done[0] = count
        if step == 0:
            state[0] = mix(mix(np.uint64(seed)) + np.uint64(chain))
            chain_best = -np.inf
        needed, fine = chain_best, _FINE
        if last:
            copy_rows(best_X, X)
            needed, fine = -np.inf, _END
        elif step < starts:
            draw_start(X, G, F, R, W, layout, buffers, state, floor)
        else:
            # Wandering is cut short now and then by a return to the best.
            if (step - starts) % 60 == 0:
                current = chain_best
                copy_rows(chain_X, current_X)
            copy_rows(current_X, X)
            perturb(X, layout, state)
            needed = current - threshold
        value = local_search(X, G, F, R, W, linear, layout, buffers, needed, fine)
        if step >= starts and value > current - threshold:
            current = value
            copy_rows(X, current_X)
        if value > chain_best:
            chain_best = value
            copy_rows(X, chain_X)
        if value > best - 1e-5 and not last:
            hits = hits + 1 if value <= best + 1e-5 else 1
        if value > best:
            best = value
            copy_rows(X, best_X)
    return best_X, best, hits


@kernel
def sweep(j: int, spans: FloatArray, counts: IntArray, X: FloatArray, R: FloatArray, W: FloatArray, linear: bool,
          layout: Layout, n_base: int) -> tuple[float, float]:  # fmt: skip
    """Move coordinate j of every row of X to its best place in that row's own spans (n, s, 2), the first counts (n,).

    Returns the gain and the value before it; the coordinate exchange of a region with constraints.
    """
    n, p = X.shape[0], R.shape[0]
    buffers = make_buffers(p)
    G, F = np.zeros((n, n_base)), np.zeros((n, p))
    refresh(X, G, F, layout)
    value = rebuild(F, R, W, buffers[0], buffers[1], buffers[2], linear)
    gain = 0.0
    if value > -np.inf:
        buffers[4][2] = math.exp(-value) if linear else 1.0
        for i in range(n):
            enter_row(i, F, linear, buffers)
            gain += improve(i, j, spans[i, : counts[i]], X, G, F, layout, linear, buffers)
    return gain, value
