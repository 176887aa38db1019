"""What turns sums of echoes into pixels: beam, resolution, looks, noise and calibration of each image row."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.sensor.earth import ground_range_of_slant, range_geometry
from seqrsm.sensor.radar import RadarConfiguration
from seqrsm.simulate.radar.echo import EchoGrid
from seqrsm.simulate.radar.frame import RadarFrame


@dataclass(frozen=True, slots=True, eq=False)
class RowLaw:
    """Numbers of each image row.

    Attributes
    ----------
    slant_range_m, ground_range_m, incidence_rad : float64 array (n_range,)
        Of flat ground in the middle of the row [m, m, rad].
    factor_w : float64 array (n_range,)
        Power of a resolution cell over a bin's sum [W].
    beam_cells : float64 array (n_range,)
        Width of the azimuth average before pixels are taken [cells]; 1 or less: none.
    range_width : float64 array (n_range,)
        Width of the range response [bins].
    looks, noise_w, calibration_w : float64 array (n_range,)
        As of `RadarImage`.
    reference_w : float
        Power of flat ground of sigma0 = 1 at the centre of the swath [W].
    """

    slant_range_m: FloatArray
    ground_range_m: FloatArray
    incidence_rad: FloatArray
    factor_w: FloatArray
    beam_cells: FloatArray
    range_width: FloatArray
    looks: FloatArray
    noise_w: FloatArray
    calibration_w: FloatArray
    reference_w: float


def row_law(frame: RadarFrame, radar: RadarConfiguration, grid: EchoGrid) -> RowLaw:
    """Numbers of each image row of one radar over one frame."""
    n = grid.n_bins
    # The last entry is the centre of the swath.
    flat = range_geometry(_places(frame, radar, grid), frame.height_m, frame.curved)
    incidence, ground_range = flat.incidence_rad, flat.ground_range_m[:n]
    calibration = radar.received_power_w(1.0, incidence, flat.slant_range_m, incidence - flat.turn_rad)
    slant, theta = flat.slant_range_m[:n], incidence[:n]
    across, along = np.asarray(radar.ground_resolution_m(theta)), radar.azimuth_resolution_m(slant)
    # Ground range of one bin on flat ground, so that the sum over a bin becomes that of one single-look cell.
    bin_ground = radar.range_spacing_m / (1.0 if radar.range_format == "ground" else np.sin(theta))
    constant = radar.radar_constant_w_m2() / grid.reference_range_m**4
    beam = np.full(n, radar.resolution_m if radar.finer_pixels else 0.0)
    if radar.aperture == "real":
        beam = np.maximum(beam, along)
    factor, beam = constant * (across * along) * frame.cell_m / bin_ground, beam / frame.cell_m
    if frame.column_m is not None:
        # Columns of one angle: a beam is as many of them on every ring.
        column_m = ground_range * (frame.column_m[-1] / frame.ground_range_m[-1])
        factor *= frame.cell_m / column_m
        beam = np.full(n, radar.azimuth_beamwidth_rad * frame.ground_range_m[-1] / frame.column_m[-1])
    return RowLaw(
        slant_range_m=slant,
        ground_range_m=ground_range,
        incidence_rad=theta,
        factor_w=factor,
        beam_cells=beam,
        range_width=(np.maximum(across, radar.resolution_m) if radar.finer_pixels else across) / bin_ground,
        looks=radar.looks_used(theta),
        noise_w=radar.noise_power_w(slant),
        calibration_w=calibration[:n],
        reference_w=float(calibration[n]),
    )


def _places(frame: RadarFrame, radar: RadarConfiguration, grid: EchoGrid) -> FloatArray:
    """Ground range of the middle of every image row on flat ground, and of the centre of the swath [m]."""
    out = np.empty(grid.n_bins + 1)
    position = (grid.first + 0.5 + np.arange(grid.n_bins)) * radar.range_spacing_m
    if radar.range_format == "ground":
        ground = frame.near_edge_m + position
    else:
        edge = range_geometry(np.array([frame.near_edge_m]), frame.height_m, frame.curved)
        ground = ground_range_of_slant(edge.slant_range_m[0] + position, frame.height_m, frame.curved)
    # Rows before the nadir echo exist only where terrain is displaced there; they take the angle of the innermost cell.
    np.maximum(ground, 0.5 * min(frame.cell_m, frame.near_edge_m), out=out[:-1])
    out[-1] = frame.centre_m
    return out
