"""Soil moisture retrieved from a radiometer's brightness, where the cover of each footprint is known.

Optimal estimation (Rodgers 2000, Inverse Methods for Atmospheric Sounding, ch. 2): the moisture of a piece of ground is
that expected from the brightness of its footprints, given what the table of emissivity says of their covers at each
moisture, how far fields, dates and the table's own means depart from that, the temperature of the ground and its error,
the receiver's noise, and how moist the ground can be. The vegetation over the soil is tau-omega
(`seqrsm.scattering.emissivity`). What the ground is without the image is told by its cover, temperature and air. Where
brightness says nothing, what is left is the guess: the mean.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy

from seqrsm.arrays import AnyArray, FloatArray
from seqrsm.scattering.atmosphere import radiation_equivalent_k
from seqrsm.scattering.emissivity import MOISTURE_NODES, EmissivityLookup
from seqrsm.scene.scene import Scene
from seqrsm.score.evidence import seen_pixels
from seqrsm.simulate.radiometer.frame import make_radiometer_frame, surface_temperature_k
from seqrsm.simulate.radiometer.occasion import nominal_radiometer_occasion
from seqrsm.simulate.radiometer.prm import air_over, lookups_of
from seqrsm.simulate.radiometer.result import RadiometerImage
from seqrsm.simulate.visits import region_spread


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
    spread = scipy.ndimage.gaussian_filter(both, (*reach, 0.0)).reshape(n_pixels, -1)
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


GRID: Final[FloatArray] = np.linspace(MOISTURE_NODES[0], MOISTURE_NODES[-1], 97)
"""Moistures that are weighed [m3/m3]."""

BLOCK_M: Final = 250.0
"""Side of the squares of ground whose mean moisture is retrieved [m]."""


def squares_of(scene: Scene, side_m: float) -> tuple[AnyArray, int]:
    """Square of ground (rows, columns) of each cell, so wide or of one cell, and how many there are."""
    size = max(side_m / scene.cell_m, 1.0)
    row, column = (np.floor(np.arange(n) / size).astype(np.int64) for n in scene.shape)
    across = int(column[-1]) + 1
    return row[:, None] * across + column, (int(row[-1]) + 1) * across


def retrieved_squares(image: RadiometerImage, scene: Scene) -> tuple[FloatArray, AnyArray]:
    """Moisture of each square of `BLOCK_M` expected from the brightness of its footprints, and each cell's square.

    In two steps: the date's mean from all footprints; then each square's departure from it, by the departure of its
    footprints' brightness from what their covers show elsewhere in the image.

    Parameters
    ----------
    image : RadiometerImage
    scene : Scene

    Returns
    -------
    float64 array (n,)
        [m3/m3]; the date's mean where no footprint shows any.
    int64 array (rows, columns)
        Place in it; -1 for cells that are not scored, not seen or whose cover shows no moisture.
    """
    pixel = seen_pixels(image)
    block, n_blocks = squares_of(scene, BLOCK_M)
    ground = expected_ground(image, scene, pixel)
    radiometer = image.radiometer
    n_channels, n_pixels = len(image.brightness_k), image.brightness_k[0].size
    spread = region_spread(scene, radiometer)
    low, high = radiometer.soil_moisture_low, radiometer.soil_moisture_high
    centre, sd = 0.5 * (low + high), math.hypot((high - low) / math.sqrt(12.0), spread)
    slopes = [_slope(image, ground, s) for s in range(len(ground.samples))]
    together, apart = (
        [_covariance(image, ground, s, slope, common=both) for s, slope in enumerate(slopes)] for both in (True, False)
    )
    costs = _costs(image, ground, np.ones((1, n_pixels)) / n_pixels, None, together)
    middle = float(posterior_mean(costs, GRID, centre, sd)[0])
    away = np.empty((n_channels, n_pixels))
    k = min(int(np.searchsorted(GRID, middle, side="right")), len(GRID) - 1) - 1
    for s, own in enumerate(ground.samples):
        low, high = np.moveaxis(_expected_k(image, ground, s, GRID[k : k + 2]), -1, 0)
        away[:, own] = image.brightness_k[:, s] - ((high - low) / (GRID[k + 1] - GRID[k]) * (middle - GRID[k]) + low)
    seen = np.isfinite(away).all(axis=0) & (ground.share.sum(axis=1) > 0.0)
    # What the table has wrong of a cover changes with the angle.
    angle = np.repeat(np.abs(image.scan.look_rad), image.brightness_k.shape[2])[:, None] / image.scan.half_angle_rad
    covers = np.hstack([ground.share * angle**n for n in range(3)])
    # A footprint's weight keeps rare covers near what the table says.
    gram = covers[seen].T @ covers[seen] + np.eye(covers.shape[1])
    level_k = (covers @ np.linalg.solve(gram, covers[seen].T @ away[:, seen].T)).T
    costs = _costs(image, ground, _weights(pixel, block, n_pixels, n_blocks), level_k, apart)
    scatter = 1.0
    if seen.any():
        wetted = [
            own + spread**2 * slope.T[:, :, None] * slope.T[:, None, :]
            for own, slope in zip(apart, slopes, strict=True)
        ]
        scatter = _scatter(ground, away - level_k, seen, wetted)
    moist = np.append(image.moist, False)[np.minimum(scene.cover, len(image.moist))]
    found = posterior_mean(costs / max(scatter, 1.0), GRID, middle, spread if spread > 0.0 else 1e-6)
    return found, np.where(scene.scored & moist & (pixel >= 0), block, -1)


def _scatter(ground: ExpectedGround, away_k: FloatArray, seen: AnyArray, covariances: list[FloatArray]) -> float:
    """Variance of the brightness (n_channels, n_pixels) about what is expected at the date's mean, over the stated one.

    Above 1 where footprints scatter by more than is accounted for: covers within them that beams weigh otherwise.
    """
    found = np.zeros(away_k.shape[1])
    for own, covariance in zip(ground.samples, covariances, strict=True):
        found[own] = mahalanobis(np.nan_to_num(away_k[:, own, None]), covariance)[:, 0]
    return float(found[seen].mean()) / len(away_k)


def _weights(pixel: AnyArray, block: AnyArray, n_pixels: int, n_blocks: int) -> scipy.sparse.csr_array:
    """How far each footprint tells of each square (n_blocks, n_pixels): 1 where one lies inside the other."""
    known = pixel >= 0
    code = block[known] * n_pixels + pixel[known]
    codes, cells = np.unique(code, return_counts=True)
    of_block, of_pixel = np.divmod(codes, n_pixels)
    in_block, in_pixel = np.bincount(block[known], minlength=n_blocks), np.bincount(pixel[known], minlength=n_pixels)
    weight = cells / np.minimum(in_block[of_block], in_pixel[of_pixel])
    return scipy.sparse.csr_array((weight, (of_block, of_pixel)), shape=(n_blocks, n_pixels))


def _costs(
    image: RadiometerImage,
    ground: ExpectedGround,
    weights: FloatArray | scipy.sparse.csr_array,
    level_k: FloatArray | None,
    covariances: list[FloatArray],
) -> FloatArray:
    """Sums (n, n_grid) of footprints' squared distances from what they would show at each moisture, by their weights.

    Brightness is higher than expected by ``level_k`` (n_channels, n_pixels); None: what footprints have in common is
    not known, and part of the distance, as the ``covariances`` of each sample's footprints have it.
    """
    total = np.zeros((weights.shape[0], len(GRID)))
    for s, own in enumerate(ground.samples):
        away = image.brightness_k[:, s, :, None] - _expected_k(image, ground, s, GRID)
        cost = mahalanobis(away - (0.0 if level_k is None else level_k[:, own, None]), covariances[s])
        total += weights[:, own] @ np.where(np.isfinite(cost), cost, 0.0)
    return total


def _expected_k(image: RadiometerImage, ground: ExpectedGround, sample: int, moisture: FloatArray) -> FloatArray:
    """Brightness (n_channels, n_lines, n) of the footprints of a sample at some moistures [K]."""
    place = (moisture - MOISTURE_NODES[0]) / (MOISTURE_NODES[1] - MOISTURE_NODES[0])
    k = np.minimum(place.astype(np.int64), len(MOISTURE_NODES) - 2)
    share, warm = ground.share[ground.samples[sample]], ground.temperature_k[ground.samples[sample]]
    up, through, sky = ground.air[sample]
    out = np.empty((len(ground.lookups), len(share), len(moisture)))
    for layer, lookup in zip(out, ground.lookups, strict=True):
        e = share @ lookup.at_angles(math.degrees(abs(image.scan.look_rad[sample])))
        if e.shape[1] > 1:
            e = e[:, k] * (1.0 - (place - k)) + e[:, k + 1] * (place - k)
        layer[:] = up + through * (e * radiation_equivalent_k(warm, ground.planck_k)[:, None] + (1.0 - e) * sky)
    return ground.planck_k / np.log1p(ground.planck_k / out) if ground.planck_k > 0.0 else out


def _slope(image: RadiometerImage, ground: ExpectedGround, sample: int) -> FloatArray:
    """Change of brightness (n_channels, n_lines) by moisture, over all of `GRID` [K / (m3/m3)]."""
    dry, wet = np.moveaxis(_expected_k(image, ground, sample, GRID[[0, -1]]), -1, 0)
    return np.asarray((wet - dry) / (GRID[-1] - GRID[0]))


def _covariance(
    image: RadiometerImage, ground: ExpectedGround, sample: int, slope_k: FloatArray, *, common: bool
) -> FloatArray:
    """Covariance (n_lines, n_channels, n_channels) of the footprints' brightness about what is expected [K2].

    Departures of fields from the table, H and V related as the table has them, and of their moisture from that of the
    square, ``slope_k`` (n_channels, n_lines) for each m3/m3; the error of their temperature; the receiver's noise; and
    where what footprints have in common is not known, the departures of dates and means, too. A footprint of several
    covers departs by the squares of their shares.
    """
    radiometer = image.radiometer
    share, warm = ground.share[ground.samples[sample]], ground.temperature_k[ground.samples[sample]]
    _, through, sky = ground.air[sample]
    own = np.square(share).sum(axis=1)
    heat = radiometer.temperature_field_sd_k**2 + (radiometer.temperature_date_sd_k**2 if common else 0.0)
    out = np.empty((len(share), len(ground.lookups), len(ground.lookups)))
    for a, one in enumerate(ground.lookups):
        for b, other in enumerate(ground.lookups):
            related = 1.0 if a == b else one.channel_correlation
            departure = related * one.field_sd * other.field_sd
            if common:
                departure = departure + related * one.date_sd * other.date_sd + one.mean_sd * other.mean_sd
            out[:, a, b] = np.square(through * (warm - sky)) * (np.square(share) @ departure) + through**2 * heat
            out[:, a, b] += slope_k[a] * slope_k[b] * np.square(radiometer.soil_moisture_field_sd) * own
            # What footprints of one field have in common, their number does not lessen.
            out[:, a, b] *= ground.footprints_a_field
        out[:, a, a] += np.square(np.nan_to_num(image.nedt_k[a, sample]))
    return out


def mahalanobis(away: FloatArray, covariance: FloatArray) -> FloatArray:
    """Squares of Mahalanobis distances (n, m) of departures (d, n, m) with covariances (n, d, d)."""
    root = np.linalg.inv(np.linalg.cholesky(covariance + 1e-9 * np.eye(len(away))))
    return np.asarray(np.square(np.einsum("nab,bnm->anm", root, away)).sum(axis=0))


def posterior_mean(costs: FloatArray, grid: FloatArray, mean: float, sd: float) -> FloatArray:
    """Posterior means (n,) on a grid (m,), from squared distances (n, m) and a Gaussian prior."""
    cost = costs + np.square((grid - mean) / sd)
    weight = np.exp(-0.5 * (cost - cost.min(axis=1, keepdims=True)))
    return np.asarray((weight @ grid) / weight.sum(axis=1))
