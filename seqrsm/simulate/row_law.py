"""What turns sums of echoes into pixels: beam, resolution, looks, noise and calibration of each image row."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.sensor.earth import RangeGeometry, ground_range_of_slant, range_geometry
from seqrsm.sensor.radar import RadarConfiguration
from seqrsm.simulate.echo import EchoGrid
from seqrsm.simulate.frame import RadarFrame


@dataclass(frozen=True, slots=True, eq=False)
class RowLaw:
    """Numbers of each image row.

    Attributes
    ----------
    geometry : RangeGeometry
        Flat ground in the middle of the row.
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

    geometry: RangeGeometry
    factor_w: FloatArray
    beam_cells: FloatArray
    range_width: FloatArray
    looks: FloatArray
    noise_w: FloatArray
    calibration_w: FloatArray
    reference_w: float


def row_law(frame: RadarFrame, radar: RadarConfiguration, grid: EchoGrid) -> RowLaw:
    """Numbers of each image row of one radar over one frame."""
    flat = _row_geometry(frame, radar, grid)
    slant, theta = flat.slant_range_m, flat.incidence_rad
    across = np.asarray(radar.ground_resolution_m(theta))
    single_look = across * radar.azimuth_resolution_m(slant)
    # Ground range of one bin on flat ground, so that the sum over a bin becomes that of one single-look cell.
    bin_ground = radar.range_spacing_m / (1.0 if radar.range_format == "ground" else np.sin(theta))
    constant = radar.radar_constant_w_m2() / grid.reference_range_m**4
    beam = np.full(grid.n_bins, radar.resolution_m if radar.finer_pixels else 0.0)
    if radar.aperture == "real":
        beam = np.maximum(beam, radar.azimuth_resolution_m(slant))
    factor, beam = constant * single_look * frame.cell_m / bin_ground, beam / frame.cell_m
    if frame.column_m is not None:
        # Columns of one angle: a beam is as many of them on every ring.
        column_m = flat.ground_range_m * (frame.column_m[-1] / frame.ground_range_m[-1])
        factor *= frame.cell_m / column_m
        beam = np.full(grid.n_bins, radar.azimuth_beamwidth_rad * frame.ground_range_m[-1] / frame.column_m[-1])
    centre = range_geometry(np.array([frame.centre_m]), frame.height_m, frame.curved)
    reference = radar.received_power_w(1.0, centre.incidence_rad, centre.slant_range_m, centre.look_rad)
    return RowLaw(
        geometry=flat,
        factor_w=factor,
        beam_cells=beam,
        range_width=(np.maximum(across, radar.resolution_m) if radar.finer_pixels else across) / bin_ground,
        looks=radar.looks_used(theta),
        noise_w=radar.noise_power_w(slant),
        calibration_w=radar.received_power_w(1.0, theta, slant, flat.look_rad),
        reference_w=float(reference[0]),
    )


def _row_geometry(frame: RadarFrame, radar: RadarConfiguration, grid: EchoGrid) -> RangeGeometry:
    """Flat ground in the middle of every image row."""
    position = (grid.first + 0.5 + np.arange(grid.n_bins)) * radar.range_spacing_m
    # Rows before the nadir echo exist only where terrain is displaced there; they take the angle of the innermost cell.
    least = 0.5 * min(frame.cell_m, frame.near_edge_m)
    if radar.range_format == "ground":
        ground = frame.near_edge_m + position
    else:
        edge = range_geometry(np.array([frame.near_edge_m]), frame.height_m, frame.curved)
        ground = ground_range_of_slant(edge.slant_range_m[0] + position, frame.height_m, frame.curved)
    return range_geometry(np.maximum(ground, least), frame.height_m, frame.curved)
