"""Least squares in 200-digit arithmetic: the reference that the stability study counts digits against.

Doubles are taken as the exact numbers they are. The normal equations square the condition number, which costs 60 of the
200 digits at a condition of 1e30; `check` compares with rational arithmetic.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal, getcontext
from fractions import Fraction

import numpy as np

getcontext().prec = 200
DIGITS = 16.0

Vector = list[Decimal]
Matrix = list[Vector]


def exact(values: Sequence[float] | np.ndarray) -> Vector:
    """Decimals of doubles, exactly."""
    return [Decimal(float(v)) for v in values]


def matmul(A: Matrix, B: Matrix) -> Matrix:
    columns = list(zip(*B, strict=True))
    return [[sum((a * b for a, b in zip(row, column, strict=True)), Decimal(0)) for column in columns] for row in A]


def solve(A: Matrix, B: Matrix) -> Matrix:
    """A^-1 B by elimination with row exchange."""
    n = len(A)
    rows = [list(a) + list(b) for a, b in zip(A, B, strict=True)]
    for i in range(n):
        pivot = max(range(i, n), key=lambda r: abs(rows[r][i]))
        rows[i], rows[pivot] = rows[pivot], rows[i]
        if rows[i][i] == 0:
            raise ZeroDivisionError("singular")
        inverse = 1 / rows[i][i]
        rows[i] = [v * inverse for v in rows[i]]
        for r in range(n):
            if r != i and rows[r][i] != 0:
                factor = rows[r][i]
                rows[r] = [v - factor * w for v, w in zip(rows[r], rows[i], strict=True)]
    return [row[n:] for row in rows]


@dataclass
class Exact:
    """Coefficients, (Z'Z)^-1 and s of a least-squares fit, in 200 digits."""

    beta: Vector
    inverse: Matrix
    s: Decimal

    @property
    def se(self) -> Vector:
        return [self.s * self.inverse[i][i].sqrt() for i in range(len(self.beta))]

    def variance(self, row: Vector) -> Decimal:
        return sum((a * b[0] for a, b in zip(row, matmul(self.inverse, [[v] for v in row]), strict=True)), Decimal(0))

    def value(self, row: Vector) -> Decimal:
        return sum((a * b for a, b in zip(row, self.beta, strict=True)), Decimal(0))

    def mapped(self, T: Matrix) -> Exact:
        """The fit of T beta."""
        transposed = [list(column) for column in zip(*T, strict=True)]
        beta = [row[0] for row in matmul(T, [[b] for b in self.beta])]
        return Exact(beta, matmul(matmul(T, self.inverse), transposed), self.s)


def least_squares(Z: Matrix, y: Vector) -> Exact:
    """Coefficients, covariance and s of y on the columns of Z."""
    n, p = len(Z), len(Z[0])
    transposed = [list(column) for column in zip(*Z, strict=True)]
    normal = matmul(transposed, Z)
    right = matmul(transposed, [[v] for v in y])
    unit = [[Decimal(int(i == j)) for j in range(p)] for i in range(p)]
    found = solve(normal, [right[i] + unit[i] for i in range(p)])
    beta, inverse = [row[0] for row in found], [row[1:] for row in found]
    r = [v - sum((a * b for a, b in zip(row, beta, strict=True)), Decimal(0)) for row, v in zip(Z, y, strict=True)]
    return Exact(beta, inverse, (sum(v * v for v in r) / (n - p)).sqrt())


def axis(x: Vector, scale: str) -> Vector:
    """The values themselves, or their natural logarithms."""
    return [v.ln() for v in x] if scale == "log" else x


def coded(x: Vector, low: float, high: float, scale: str = "linear") -> Vector:
    """A factor coded on [-1, 1]."""
    a, b = axis(exact([low, high]), scale)
    return [(2 * v - a - b) / (b - a) for v in axis(x, scale)]


def quadratic_rows(columns: Sequence[Vector], first: Sequence[int], second: Sequence[int]) -> Matrix:
    """Model rows: products of the base columns (1, x1 ... xk)."""
    base = [[Decimal(1)] * len(columns[0]), *columns]
    return [[base[a][i] * base[b][i] for a, b in zip(first, second, strict=True)] for i in range(len(columns[0]))]


def stationary(beta: Vector, k: int, first: Sequence[int], second: Sequence[int]) -> Vector:
    """Stationary point of a full quadratic in k variables."""
    _, b, B = _forms(beta, k, first, second)
    return [row[0] for row in solve([[2 * v for v in row] for row in B], [[-v] for v in b])]


def _forms(beta: Vector, k: int, first: Sequence[int], second: Sequence[int]) -> tuple[Decimal, Vector, Matrix]:
    """c, b and B of c + b'x + x'Bx."""
    c, b, B = Decimal(0), [Decimal(0)] * k, [[Decimal(0)] * k for _ in range(k)]
    for value, i, j in zip(beta, first, second, strict=True):
        i, j = min(i, j), max(i, j)
        if j == 0:
            c += value
        elif i == 0:
            b[j - 1] += value
        else:
            B[i - 1][j - 1] += value / 2
            B[j - 1][i - 1] += value / 2
    return c, b, B


def digits(found: object, reference: Sequence[Decimal]) -> float:
    """Least number of correct digits over some values, 0 to 16; nan where a value is missing."""
    least = DIGITS
    for value, true in zip(np.atleast_1d(np.asarray(found, dtype=np.float64)), reference, strict=True):
        if not np.isfinite(value):
            return float("nan")
        error = abs(Decimal(float(value)) - true) / (abs(true) if true != 0 else Decimal(1))
        least = min(least, DIGITS if error == 0 else -float(error.log10()))
    return abs(max(least, 0.0))


def places(found: object, reference: Vector) -> float:
    """Correct decimal places of coded settings, 0 to 16."""
    error = max(abs(Decimal(float(v)) - w) for v, w in zip(np.atleast_1d(found), reference, strict=True))
    return DIGITS if error == 0 else abs(min(max(-float(error.log10()), 0.0), DIGITS))


def check() -> float:
    """Digits to which the 200-digit solution of an ill-conditioned problem agrees with rational arithmetic."""
    rng = np.random.default_rng(0)
    t = rng.uniform(-1, 1, 12)
    Z = np.stack([t**0, t, t + 1e-7 * rng.uniform(-1, 1, 12), t**2], axis=1)
    y = rng.normal(size=12)
    found = least_squares([exact(row) for row in Z], exact(y))
    rows, right = [[Fraction(v) for v in row] for row in Z.tolist()], [Fraction(v) for v in y.tolist()]
    p = Z.shape[1]
    A = [[sum(r[i] * r[j] for r in rows) for j in range(p)] for i in range(p)]
    b = [sum(r[i] * v for r, v in zip(rows, right, strict=True)) for i in range(p)]
    for i in range(p):
        for j in range(i + 1, p):
            factor = A[j][i] / A[i][i]
            A[j] = [v - factor * w for v, w in zip(A[j], A[i], strict=True)]
            b[j] -= factor * b[i]
    beta = [Fraction(0)] * p
    for i in reversed(range(p)):
        beta[i] = (b[i] - sum((A[i][j] * beta[j] for j in range(i + 1, p)), Fraction(0))) / A[i][i]
    worst = max(
        abs(v - Decimal(f.numerator) / Decimal(f.denominator)) / abs(v) for v, f in zip(found.beta, beta, strict=True)
    )
    return float("inf") if worst == 0 else -float(worst.log10())
