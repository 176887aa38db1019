"""Image of a scanning radiometer, with all that a score or a record needs of it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from seqrsm.arrays import AnyArray, BoolArray
from seqrsm.scattering.emissivity import EmissivityTable
from seqrsm.sensor.radiometer import RadiometerConfiguration
from seqrsm.sensor.scan import ScanGeometry
from seqrsm.simulate.radiometer.occasion import RadiometerOccasion


@dataclass(frozen=True, slots=True, eq=False)
class RadiometerImage:
    """Image of a scanning radiometer: footprints of a line (left edge first), lines along the flight."""

    brightness_k: AnyArray
    """(n_channels, n_samples, n_lines): calibrated antenna temperature with the receiver's noise [K]; nan where nothing
    is seen."""
    mean_k: AnyArray
    nedt_k: AnyArray
    """As `brightness_k`: its expectation, and the standard deviation of the noise [K]."""
    scan: ScanGeometry

    pixel_of_cell: AnyArray
    """(rows, cols): nearest footprint ``sample * n_lines + line`` of each cell of the scene; -1 without data or beyond
    the sweep."""
    coverage: AnyArray
    """(rows, cols): half-power footprints, smeared by the integration, that hold the cell's centre; 0 for cells never
    seen."""
    blocked: BoolArray
    """(rows, cols): cells hidden from the antenna."""
    radiometer: RadiometerConfiguration
    occasion: RadiometerOccasion

    table: EmissivityTable
    """That the ground was looked up in."""
    day: float | None
    """Day of the year, where the image has one."""
    quarter_turns: int
    """``numpy.rot90(scene layer, quarter_turns)`` has the image's orientation."""
    notes: tuple[str, ...]
    """Assumptions, and what the scan does."""

    def record(self, categories: Sequence[str]) -> Mapping[str, object]:
        """What is kept with a score: plain numbers and names."""
        scan = self.scan
        return {
            "engine": "prm",
            "nedt_k": [round(float(np.nanmedian(layer)), 4) for layer in self.nedt_k],
            "beamwidth_deg": round(math.degrees(self.radiometer.beamwidth_rad(scan.height_m)), 5),
            "lines_and_samples": [scan.n_lines, len(scan.look_rad)],
            "advance_m": round(scan.advance_m, 4),
            "sweeps_a_line": scan.sweeps_a_line,
            "dwell_ms": round(scan.dwell_ms, 5),
            "smear_beams": round(scan.smear, 5),
            "covered_percent": round(100.0 * float((self.coverage > 0).mean()), 3),
            "blocked_percent": round(100.0 * float(self.blocked.mean()), 3),
            "occasion": dict(self.occasion.record(self.radiometer.channels, categories)),
            "scan_notes": list(scan.notes),
        }
