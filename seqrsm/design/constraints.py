"""Constraints between factors, written as expressions in natural units.

The text is parsed with :mod:`ast`, checked node by node against a short list, and turned into nested tuples that
:meth:`Constraint.slack` walks with numpy. Nothing is ever handed to ``eval``.
"""

from __future__ import annotations

import ast
import math
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import reduce
from typing import Any, TypeAlias

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.errors import RegionError

MAX_CHARACTERS = 500
MAX_NODES = 100
MAX_EXPONENT = 10.0
ALLOWED = (
    "Allowed are names of factors, numbers, + - * / **, < <= > >= (also chained), and, or, log log10 sqrt exp min max "
    'abs, and for a categorical factor == != in with its levels, as in: polarization in ("HH", "VV"), which in '
    "arithmetic is 1 or 0; count(frequency) is the number of parts of its level, 2 at L+C."
)

Node: TypeAlias = tuple[Any, ...]
# A value and a bound on the size of what was added up to reach it: cancellation is judged against the latter.
Sized: TypeAlias = tuple[FloatArray, FloatArray]

_ARITHMETIC: dict[type[ast.AST], str] = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/"}
_ORDER: dict[type[ast.AST], int] = {ast.LtE: 1, ast.Lt: 1, ast.GtE: -1, ast.Gt: -1}


class _Parser:
    """Turns the text of one constraint into nested tuples, or says what is wrong and where."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.numeric: set[str] = set()
        self.labels: list[tuple[str, tuple[str, ...]]] = []
        self.open_ends: list[tuple[str, float]] = []

    def fail(self, message: str, node: ast.AST | None = None) -> RegionError:
        column = getattr(node, "col_offset", None)
        where = "" if column is None else f" (column {column + 1})"
        return RegionError(f"{message}{where}", ALLOWED, field="constraint", value=self.text[:MAX_CHARACTERS])

    def parse(self) -> Node:
        if len(self.text) > MAX_CHARACTERS:
            raise self.fail(f"the expression has {len(self.text)} characters, more than {MAX_CHARACTERS}")
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                body = ast.parse(self.text.strip(), mode="eval").body
        except SyntaxError as error:
            column = "" if error.offset is None else f" at column {error.offset}"
            raise self.fail(f"this is not an expression ({error.msg}{column})") from None
        except (ValueError, MemoryError, RecursionError, OverflowError):
            raise self.fail("this is not an expression, or it is nested too deeply") from None
        if sum(1 for _ in ast.walk(body)) > MAX_NODES:
            raise self.fail(f"the expression has more than {MAX_NODES} parts")
        return self.condition(body)

    def condition(self, node: ast.AST) -> Node:
        if isinstance(node, ast.BoolOp):
            kind = "and" if isinstance(node.op, ast.And) else "or"
            return (kind, *(self.condition(value) for value in node.values))
        if not isinstance(node, ast.Compare):
            raise self.fail("a constraint must compare two sides", node)
        operands = [node.left, *node.comparators]
        pairs = [
            self.comparison(left, op, right, node)
            for left, op, right in zip(operands[:-1], node.ops, operands[1:], strict=True)
        ]
        return pairs[0] if len(pairs) == 1 else ("and", *pairs)

    def comparison(self, left: ast.expr, op: ast.cmpop, right: ast.expr, node: ast.AST) -> Node:
        sign = _ORDER.get(type(op))
        if sign is not None:
            sides = ((left, right), (right, left)) if isinstance(op, ast.Lt | ast.Gt) else ()
            for side, end in sides:
                if isinstance(end, ast.Constant):
                    self.open_ends.append((ast.unparse(side), self.constant(end)))
            low, high = (left, right) if sign > 0 else (right, left)
            return ("<=", self.number(low), self.number(high))
        if isinstance(op, (ast.Eq, ast.NotEq)):
            if isinstance(left, ast.Constant):
                left, right = right, left
            return self.membership(left, [right], isinstance(op, ast.Eq), node)
        if isinstance(op, (ast.In, ast.NotIn)) and isinstance(right, (ast.Tuple, ast.List, ast.Set)):
            return self.membership(left, list(right.elts), isinstance(op, ast.In), node)
        raise self.fail(f"the comparison '{type(op).__name__}' is not allowed", node)

    def membership(self, left: ast.AST, right: list[ast.expr], wanted: bool, node: ast.AST) -> Node:
        labels = [item.value for item in right if isinstance(item, ast.Constant) and isinstance(item.value, str)]
        if not isinstance(left, ast.Name | ast.Attribute) or len(labels) != len(right) or not labels:
            raise self.fail("==, != and in compare a categorical factor with its levels only", node)
        name = self.name(left)
        self.labels.append((name, tuple(labels)))
        return ("in", name, frozenset(labels), wanted)

    def name(self, node: ast.Name | ast.Attribute) -> str:
        if isinstance(node, ast.Attribute):
            if not isinstance(node.value, ast.Name) or node.attr.startswith("_"):
                raise self.fail("a name has one dot at most, between a sensor and its parameter", node)
            name = f"{node.value.id}.{node.attr}"
        else:
            name = node.id
        if not name.isascii() or ast.get_source_segment(self.text.strip(), node) != name:
            raise self.fail(f"the name '{name}' is not written in plain ASCII letters", node)
        return name

    def number(self, node: ast.AST) -> Node:
        if isinstance(node, ast.Constant):
            return ("number", self.constant(node))
        if isinstance(node, ast.Name | ast.Attribute):
            name = self.name(node)
            self.numeric.add(name)
            return ("name", name)
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.UAdd)):
            inner = self.number(node.operand)
            return ("negative", inner) if isinstance(node.op, ast.USub) else inner
        if isinstance(node, ast.BinOp) and type(node.op) in _ARITHMETIC:
            return (_ARITHMETIC[type(node.op)], self.number(node.left), self.number(node.right))
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
            return ("**", self.number(node.left), self.exponent(node.right))
        if isinstance(node, ast.Call):
            return self.call(node)
        if isinstance(node, ast.Compare) and (inner := self.condition(node))[0] == "in":
            return inner
        raise self.fail(f"'{type(node).__name__}' is not allowed", node)

    def call(self, node: ast.Call) -> Node:
        name = node.func.id if isinstance(node.func, ast.Name) else None
        if name == "count" and len(node.args) == 1 and isinstance(node.args[0], ast.Name | ast.Attribute):
            factor = self.name(node.args[0])
            self.labels.append((factor, ()))
            return ("count", factor)
        if name not in _FUNCTIONS or node.keywords:
            known = "log, log10, sqrt, exp, min, max, abs and count"
            raise self.fail(f"only {known} may be called, by plain arguments", node)
        several = name in ("min", "max")
        if (len(node.args) < 2) if several else (len(node.args) != 1):
            raise self.fail(f"'{name}' takes {'two or more arguments' if several else 'one argument'}", node)
        return (name, *(self.number(argument) for argument in node.args))

    def constant(self, node: ast.Constant) -> float:
        value = node.value
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise self.fail(f"{value!r:.40} is not a number", node)
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            raise self.fail("a number is too large", node)
        return number

    def exponent(self, node: ast.AST) -> float:
        """Value of a constant exponent such as 2, -0.5 or (1/3)."""
        value = self._fold(node)
        if not math.isfinite(value) or abs(value) > MAX_EXPONENT:
            raise self.fail(f"an exponent must be a number from -{MAX_EXPONENT:g} to {MAX_EXPONENT:g}", node)
        return value

    def _fold(self, node: ast.AST) -> float:
        if isinstance(node, ast.Constant):
            return self.constant(node)
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.UAdd)):
            return -self._fold(node.operand) if isinstance(node.op, ast.USub) else self._fold(node.operand)
        if isinstance(node, ast.BinOp) and isinstance(node.op, (ast.Mult, ast.Div)):
            left, right = self._fold(node.left), self._fold(node.right)
            if isinstance(node.op, ast.Mult):
                return left * right
            return left / right if right != 0.0 else math.inf
        raise self.fail("an exponent must be a plain number", node)


def _logarithm(function: Callable[[FloatArray], FloatArray]) -> Callable[[Sized], Sized]:
    def apply(argument: Sized) -> Sized:
        value, size = argument
        result = function(value)
        return result, np.abs(result) + size / np.abs(value)

    return apply


def _exponential(argument: Sized) -> Sized:
    result = np.exp(argument[0])
    return result, result * (1.0 + argument[1])


def _extreme(function: Callable[..., FloatArray]) -> Callable[..., Sized]:
    def apply(*arguments: Sized) -> Sized:
        value, size = arguments[0]
        for other, other_size in arguments[1:]:
            value, size = function(value, other), np.maximum(size, other_size)
        return value, size

    return apply


_FUNCTIONS: dict[str, Callable[..., Sized]] = {
    "log": _logarithm(np.log),
    "log10": _logarithm(np.log10),
    "sqrt": lambda a: (np.sqrt(a[0]), np.sqrt(a[1])),
    "exp": _exponential,
    "min": _extreme(np.minimum),
    "max": _extreme(np.maximum),
    "abs": lambda a: (np.abs(a[0]), a[1]),
}


def _evaluate(node: Node, settings: Mapping[str, Any]) -> Sized:
    kind = node[0]
    if kind == "number":
        return np.float64(node[1]), np.float64(abs(node[1]))  # type: ignore[return-value]
    if kind == "name":
        value = np.asarray(settings[node[1]], dtype=np.float64)
        return value, np.abs(value)
    if kind == "count":
        parts = np.asarray(np.char.count(np.asarray(settings[node[1]], dtype=np.str_), "+") + 1, dtype=np.float64)
        return parts, parts
    if kind == "in":
        _, name, labels, wanted = node
        holds = np.asarray(np.isin(np.asarray(settings[name]), sorted(labels)) == wanted, dtype=np.float64)
        return holds, holds
    if kind == "**":
        (value, size), exponent = _evaluate(node[1], settings), node[2]
        result = np.power(value, exponent)
        slope = abs(exponent) * np.power(np.abs(value), exponent - 1.0)
        return result, np.fmax(np.abs(result), slope * size)
    sized = [_evaluate(part, settings) for part in node[1:]]
    if kind == "negative":
        return -sized[0][0], sized[0][1]
    if kind in _FUNCTIONS:
        return _FUNCTIONS[kind](*sized)
    (a, size_a), (b, size_b) = sized
    if kind == "+":
        return a + b, size_a + size_b
    if kind == "-":
        return a - b, size_a + size_b
    if kind == "*":
        return a * b, size_a * size_b
    return a / b, size_a / np.abs(b) * np.maximum(1.0, size_b / np.abs(b))


def _slack(node: Node, settings: Mapping[str, Any]) -> FloatArray:
    kind = node[0]
    if kind in ("and", "or"):
        return reduce(np.minimum if kind == "and" else np.maximum, (_slack(part, settings) for part in node[1:]))
    if kind == "in":
        return 2.0 * _evaluate(node, settings)[0] - 1.0
    low, size_low = _evaluate(node[1], settings)
    high, size_high = _evaluate(node[2], settings)
    difference, size = high - low, size_low + size_high
    slack = np.where(difference == 0.0, 0.0, difference / size)
    # Beyond the range of floats only the sign is known; where a side is undefined (0/0, the root of a negative number)
    # not even that, and the setting is not allowed.
    known = np.isfinite(size) & np.isfinite(slack)
    return np.where(known, slack, np.where(difference > 0.0, 1.0, -1.0))


@dataclass(frozen=True, slots=True)
class Constraint:
    """Condition on the settings, such as ``looks <= 4 * (resolution / 12.1) ** 2``.

    RegionError names the expression, the column and what is allowed.
    """

    expr: str
    """Comparison of expressions in the factors' natural units; see ``ALLOWED``. At most 500 characters and 100 parts;
    exponents are numbers from -10 to 10."""
    numeric_names: frozenset[str] = field(init=False, repr=False, compare=False)
    labels: tuple[tuple[str, tuple[str, ...]], ...] = field(init=False, repr=False, compare=False)
    open_ends: tuple[tuple[str, float], ...] = field(init=False, repr=False, compare=False)
    _tree: Node = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not isinstance(self.expr, str) or not self.expr.strip():
            raise RegionError("a constraint is empty or no text", ALLOWED, value=self.expr)
        parser = _Parser(self.expr)
        object.__setattr__(self, "_tree", parser.parse())
        object.__setattr__(self, "numeric_names", frozenset(parser.numeric))
        object.__setattr__(self, "labels", tuple(parser.labels))
        object.__setattr__(self, "open_ends", tuple(parser.open_ends))

    @property
    def names(self) -> frozenset[str]:
        """Names of all factors in the expression."""
        return self.numeric_names | {name for name, _ in self.labels}

    def slack(self, settings: Mapping[str, Any]) -> FloatArray:
        """How far (n,) the condition is from being violated, at natural values (n,) by name; of categories, levels.

        Difference of the sides over the sum of the sizes of what was added up in them, in [-1, 1]; >= 0 is feasible.
        Smallest over ``and``, largest over ``or``; -1 where a side is undefined.
        """
        n = max((np.asarray(settings[name]).size for name in self.names), default=1)
        with np.errstate(all="ignore"):
            return np.full(n, _slack(self._tree, settings))

    def right(self, settings: Mapping[str, Any], n: int) -> FloatArray:
        """Values (n,) of the right side of a single comparison; settings as of `slack`."""
        with np.errstate(all="ignore"):
            return np.full(n, _evaluate(self._tree[2], settings)[0])


def arithmetic(text: str) -> Constraint:
    """Arithmetic in the factors' natural units, as the right side of a comparison; errors of `Constraint`."""
    return Constraint(f"0 <= (\n{text})")  # on a line of its own, so that columns told are the text's
