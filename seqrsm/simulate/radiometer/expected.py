"""What a radiometer's image would be expected to show, from what is known without it: cover, temperature, air."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage

from seqrsm.arrays import AnyArray, FloatArray
from seqrsm.scattering.emissivity import EmissivityLookup
from seqrsm.simulate.radiometer.frame import make_radiometer_frame, surface_temperature_k
from seqrsm.simulate.radiometer.occasion import nominal_radiometer_occasion
from seqrsm.simulate.radiometer.prm import air_over, lookups_of

if TYPE_CHECKING:
    from seqrsm.scene.scene import Scene
    from seqrsm.simulate.radiometer.result import RadiometerImage


@dataclass(frozen=True, slots=True, eq=False)
class ExpectedGround:
    """The ground of each footprint, as a map of covers and a weather service would tell it.

    Attributes
    ----------
    share : float64 array (n_pixels, n_categories)
        Of each cover in a footprint, by a Gaussian beam; 0 of all where no cell is.
    temperature_k : float64 array (n_pixels,)
        Physical temperature [K], without what the date and the fields add.
    lookups : list of EmissivityLookup
        The table's own means, one for each channel.
    air : tuple of tuple of float
        For each sample emission [K] and transmission [1] of the air below the antenna, and the sky that the ground
        reflects [K].
    planck_k : float
        As of `seqrsm.simulate.radiometer.prm.Meeting`.
    footprints_a_field : float
        Footprints that see one and the same field, 1 at least, of the field at a cell taken at random.
    samples : tuple of slice
        The pixels of each sample of a sweep, which have a look angle in common.
    """

    share: FloatArray
    temperature_k: FloatArray
    lookups: list[EmissivityLookup]
    air: tuple[tuple[float, float, float], ...]
    planck_k: float
    footprints_a_field: float
    samples: tuple[slice, ...]


def expected_ground(image: RadiometerImage, scene: Scene, pixel: AnyArray) -> ExpectedGround:
    """What is known of the ground of an image's footprints beforehand.

    Parameters
    ----------
    image : RadiometerImage
    scene : Scene
        The scene it was made of.
    pixel : int32 array (rows, columns)
        Footprint of each cell, -1 for none.
    """
    radiometer = image.radiometer
    lookups = lookups_of(scene, radiometer, image.table.in_world(None), image.day)
    frame = make_radiometer_frame(scene, radiometer, "float32")
    nominal = nominal_radiometer_occasion(radiometer, lookups, scene)
    kelvin = np.rot90(surface_temperature_k(scene, frame, radiometer, lookups[0], nominal), -frame.quarter_turns)
    n_pixels, n_categories = image.brightness_k[0].size, len(scene.categories)
    known = (pixel >= 0) & (scene.cover < n_categories)
    where = pixel[known].astype(np.int64)
    code = where * n_categories + scene.cover[known]
    counts = np.bincount(code, minlength=n_pixels * n_categories).reshape(n_pixels, n_categories)
    warm = np.bincount(where, kelvin[known], minlength=n_pixels)
    # A beam of half-power width w is a Gaussian of standard deviation 0.42 w.
    scan = image.scan
    reach = 0.42 * np.array([scan.beamwidth_rad / scan.step_rad, radiometer.footprint_m[1] / scan.advance_m])
    both = np.column_stack([counts.astype(np.float64), warm]).reshape(*image.brightness_k.shape[1:], -1)
    spread = ndimage.gaussian_filter(both, (*reach, 0.0)).reshape(n_pixels, -1)
    total = np.maximum(spread[:, :-1].sum(axis=1), 1e-9)
    kelvin_of = np.where(spread[:, -1] > 0.0, spread[:, -1] / total, 300.0)
    planck_k = radiometer.planck_used_k
    share, sky = spread[:, :-1] / total[:, None], air_over(radiometer, planck_k)
    looks, height = np.abs(scan.look_rad).tolist(), scan.height_m
    air = tuple(
        (float(sky.upwelling_k(look, height)), float(sky.transmission(look, height)), float(sky.sky_k(look)))
        for look in looks
    )
    n_samples, n_lines = image.brightness_k.shape[1:]
    samples = tuple(slice(s * n_lines, (s + 1) * n_lines) for s in range(n_samples))
    sizes = np.bincount(scene.field_id[known]).astype(np.float64)
    of_footprint = max(int(known.sum()), 1) / max(int((counts.sum(axis=1) > 0).sum()), 1)
    together = max(float(np.square(sizes).sum() / max(sizes.sum(), 1.0)) / of_footprint, 1.0)
    return ExpectedGround(share, kelvin_of, lookups, air, planck_k, together, samples)
