"""Emissivity curves over the look angle, as read from long CSV tables and interpolated between their nodes."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import scipy

from seqrsm.arrays import FloatArray
from seqrsm.errors import Problem, ScatteringDataError
from seqrsm.scattering.curves import THETA_DEG, weakest
from seqrsm.scattering.longtable import Node, in_order, read_nodes, refuse, stated, weights_of_nodes

POLARIZATIONS: Final = ("H", "V")

_THIRD_OCTAVE: Final = 2.0 ** (1.0 / 3.0)


@dataclass(frozen=True, slots=True, eq=False)
class EmissivityCurve:
    """Nodes of one category: emissivity (91,) by (frequency [GHz], polarization), its status and note."""

    value: Mapping[tuple[float, str], FloatArray]
    status: str
    note: str
    printed: bool


def between_nodes(name: str, curve: EmissivityCurve, f: float, polarization: str, file: str) -> FloatArray:
    """A user's curve (91,) at a frequency: linear in the logarithm of frequency between nodes.

    At most a third of an octave beyond them, where it is held; ScatteringDataError says that it is further off, or that
    there is no such polarization. ``name`` of the category and ``file``, or "", are for messages.
    """
    nodes = sorted(node for node, p in curve.value if p == polarization)
    if not nodes:
        message = f"the table has no {polarization} emissivity of {name}"
        raise ScatteringDataError(message, "Add its rows", file=file or None, field="polarization")
    low, high = nodes[0] / _THIRD_OCTAVE, nodes[-1] * _THIRD_OCTAVE
    if not low <= f <= high:
        message = f"emissivity of {name} at {polarization} is known at {nodes[0]:g} to {nodes[-1]:g} GHz"
        remedy = f"Stay within {low:.4g} to {high:.4g} GHz, or add rows"
        raise ScatteringDataError(message, remedy, file=file or None, field="frequency", value=f)
    return np.asarray(weights_of_nodes(nodes, f) @ np.array([curve.value[node, polarization] for node in nodes]))


def interpolated(theta_deg: Sequence[float], value: Sequence[float]) -> FloatArray:
    """Emissivity on `THETA_DEG`: shape-preserving cubics through the nodes, held beyond the first and the last.

    Fritsch and Carlson 1980, Monotone piecewise cubic interpolation: monotone between two nodes, so it never leaves
    their values. Straight where there are only two nodes.
    """
    angle, e = np.asarray(theta_deg, dtype=np.float64), np.asarray(value, dtype=np.float64)
    at = np.clip(THETA_DEG, angle[0], angle[-1])
    out = np.asarray(scipy.interpolate.PchipInterpolator(angle, e)(at)) if angle.size > 2 else np.interp(at, angle, e)
    # The cubic's own rounding must not show at a node, nor beyond the outer ones.
    out[angle[0] >= THETA_DEG] = e[0]
    out[angle[-1] <= THETA_DEG] = e[-1]
    for a, v in zip(angle, e, strict=True):
        out[a == THETA_DEG] = v
    return np.asarray(out)


def read_curves(
    path: str | Path, *, printed: bool, needed: bool = True
) -> tuple[dict[str, EmissivityCurve], dict[str, float], dict[str, float]]:
    """Curves, field-to-field standard deviations and stated standard deviations of the mean, by category.

    Of a long CSV with the columns of `seqrsm.scattering.longtable`, ``printed`` for the shipped transcription of Table
    3. ScatteringDataError tells every wrong row, with its line and column.
    """
    problems: list[Problem] = []
    groups: dict[str, dict[tuple[float, str], list[Node]]] = defaultdict(lambda: defaultdict(list))
    nodes = read_nodes(path, "emissivity", needed=needed)
    for node in nodes:
        groups[node.category][node.frequency_ghz, node.channel].append(node)
    curves = {}
    for name, group in groups.items():
        own = [node.row for node in nodes if node.category == name]
        value = {
            key: interpolated([node.place for node in curve], [node.value for node in curve])
            for key, block in group.items()
            if (curve := in_order(block, f"{name}, {key[0]:g} GHz, {key[1]}", problems))
        }
        status = weakest(row.text("status") for row in own)
        if printed:
            note = "emissivities of Table 3, RSL TR 380-1; its 20 GHz, polarization H and moisture 0.2 are inferred"
        else:
            sources = ", ".join(sorted({row.text("source") for row in own}))
            note = f"{name}: rows of {Path(path).name} ({status}: {sources})"
        curves[name] = EmissivityCurve(value, status, note, printed)
    refuse(problems, path)
    of_fields, of_means = (stated(nodes, name, lambda node: node.category) for name in ("sd", "mean_sd"))
    return curves, of_fields, of_means
