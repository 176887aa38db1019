"""Soil moisture retrieved from a radiometer's brightness, where the cover of each footprint is known.

Optimal estimation (Rodgers 2000, Inverse Methods for Atmospheric Sounding, ch. 2): the moisture of a piece of ground is
that expected from the brightness of its footprints, given what the table of emissivity says of their covers at each
moisture, how far fields, dates and the table's own means depart from that, the temperature of the ground and its error,
the receiver's noise, and how moist the ground can be. The vegetation over the soil is tau-omega
(`seqrsm.scattering.emissivity`). What the ground is without the image is told by its cover, slope, temperature and air.
Where brightness says nothing, what is left is the guess: the mean.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import scipy

from seqrsm.arrays import AnyArray, BoolArray, FloatArray
from seqrsm.scattering.atmosphere import radiation_equivalent_k
from seqrsm.scattering.curves import THETA_DEG
from seqrsm.scattering.emissivity import MOISTURE_NODES, EmissivityLookup, EmissivityTable, of_mixtures
from seqrsm.scene.scene import Scene
from seqrsm.score.pixels import seen_pixels
from seqrsm.sensor.radiometer import RadiometerConfiguration
from seqrsm.simulate.radiometer.frame import local_angle_deg, make_radiometer_frame, surface_temperature_k
from seqrsm.simulate.radiometer.occasion import nominal_radiometer_occasion
from seqrsm.simulate.radiometer.prm import air_over, lookups_of
from seqrsm.simulate.radiometer.result import RadiometerImage
from seqrsm.simulate.visits import YEAR_DAYS, region_spread


@dataclass(frozen=True, slots=True, eq=False)
class ExpectedGround:
    """The ground of each footprint, as maps of covers and elevations and a weather service would tell it."""

    share: FloatArray
    """(n_samples, n_lines, n_categories): of each cover in a footprint, by a Gaussian beam; 0 of all where no cell
    is."""
    temperature_k: FloatArray
    """(n_samples, n_lines): physical temperature [K], without what the date and the fields add."""
    angle_deg: FloatArray
    """(n_samples, n_lines): mean angle from the normal of the ground at which it is seen [deg]."""
    lookups: list[EmissivityLookup]
    """The table's own means, one for each channel; on a day, over all days by which years and fields may be late."""
    of_fields: FloatArray
    of_years: FloatArray
    """(n_channels, n_channels, n_categories, n_moistures, 91): covariance of what channels reflect of fields, and of
    all fields of a cover, as they and their year are late."""
    air: FloatArray
    """(3, n_samples): emission [K] and transmission [1] of the air below the antenna, and the sky that the ground
    reflects [K]."""
    planck_k: float
    """As of `seqrsm.simulate.radiometer.prm.Meeting`."""
    footprints_a_piece: float
    """Footprints of a square of `BLOCK_M` that see one and the same field, 1 at least, of the field at a cell taken at
    random."""


def expected_ground(image: RadiometerImage, scene: Scene, pixel: AnyArray) -> ExpectedGround:
    """What is known of the ground of an image's footprints beforehand.

    ``pixel`` (rows, columns): footprint of each cell of the scene, -1 for none.
    """
    radiometer = image.radiometer
    lookups, of_fields, of_years = _expected_lookups(scene, radiometer, image.table.in_world(None), image.day)
    frame = make_radiometer_frame(scene, radiometer, "float32")
    nominal = nominal_radiometer_occasion(radiometer, lookups, scene)
    kelvin = np.rot90(surface_temperature_k(scene, frame, radiometer, lookups[0], nominal), -frame.quarter_turns)
    n_pixels, n_categories = image.brightness_k[0].size, len(scene.categories)
    known = (pixel >= 0) & (scene.cover < n_categories)
    where = pixel[known].astype(np.int64)
    code = where * n_categories + scene.cover[known]
    counts = np.bincount(code, minlength=n_pixels * n_categories).reshape(n_pixels, n_categories)
    turned = local_angle_deg(scene, frame.quarter_turns, radiometer.altitude_m, radiometer.conical_incidence_deg)
    sums = [np.bincount(where, layer[known], minlength=n_pixels) for layer in (turned, kelvin)]
    # A beam of half-power width w is a Gaussian of standard deviation 0.42 w.
    scan = image.scan
    reach = 0.42 * np.array([scan.beamwidth_rad / scan.step_rad, radiometer.footprint_m[1] / scan.advance_m])
    both = np.column_stack([counts.astype(np.float64), *sums]).reshape(*image.brightness_k.shape[1:], -1)
    spread = scipy.ndimage.gaussian_filter(both, (*reach, 0.0))
    total = np.maximum(spread[..., :-2].sum(axis=-1), 1e-9)
    kelvin_of = np.where(spread[..., -1] > 0.0, spread[..., -1] / total, 300.0)
    planck_k = radiometer.planck_used_k
    share, sky = spread[..., :-2] / total[..., None], air_over(radiometer, planck_k)
    looks, height = np.abs(scan.look_rad), scan.height_m
    air = np.array([sky.upwelling_k(looks, height), sky.transmission(looks, height), sky.sky_k(looks)])
    of_footprint = max(int(known.sum()), 1) / max(int((counts.sum(axis=1) > 0).sum()), 1)
    sizes = np.bincount(scene.field_id[known]).astype(np.float64)
    of_piece = min(float(np.square(sizes).sum() / max(sizes.sum(), 1.0)), (BLOCK_M / scene.cell_m) ** 2)
    of_piece = max(of_piece / of_footprint, 1.0)
    angle = spread[..., -2] / total
    return ExpectedGround(share, kelvin_of, angle, lookups, of_fields, of_years, air, planck_k, of_piece)


_LATE_DAYS: Final[FloatArray] = np.linspace(-36.0, 36.0, 13)


def _expected_lookups(
    scene: Scene, radiometer: RadiometerConfiguration, table: EmissivityTable, day: float | None
) -> tuple[list[EmissivityLookup], FloatArray, FloatArray]:
    """``lookups``, ``of_fields`` and ``of_years`` of `ExpectedGround`."""
    lookups = lookups_of(scene, radiometer, table, day)
    if day is None:
        none = np.zeros((len(lookups), len(lookups), *lookups[0].emissivity.shape))
        return lookups, none, none
    names, n = scene.categories, len(scene.categories)
    late = lookups_of(scene, radiometer, table, np.repeat(day - _LATE_DAYS, n), names * len(_LATE_DAYS))
    reflected = np.array([(1.0 - look.emissivity).reshape(len(_LATE_DAYS), n, -1, THETA_DEG.size) for look in late])
    apart = _LATE_DAYS - _LATE_DAYS[:, None]
    of_field = np.exp(-0.5 * np.square(apart / np.maximum(table.calendar.shift_days(names), 0.1)[:, None, None]))
    of_field /= of_field.sum(axis=2, keepdims=True)
    of_year = np.exp(-0.25 * np.square(_LATE_DAYS / YEAR_DAYS))
    of_year /= of_year.sum()
    # c, d: channels; k: categories; y: years; s: fields; m: moistures; a: angles.
    in_year = np.einsum("kys,cskma->cykma", of_field, reflected)
    mean = np.einsum("y,cykma->ckma", of_year, in_year)
    square = np.einsum("y,kys,cskma,dskma->cdkma", of_year, of_field, reflected, reflected, optimize=True)
    of_years = np.einsum("y,cykma,dykma->cdkma", of_year, in_year, in_year)
    lookups = [replace(look, emissivity=1.0 - own) for look, own in zip(lookups, mean, strict=True)]
    return lookups, square - of_years, of_years - mean[:, None] * mean


GRID: Final[FloatArray] = np.linspace(MOISTURE_NODES[0], MOISTURE_NODES[-1], 97)
"""Moistures that are weighed [m3/m3]."""

_FOOTPRINTS: Final = 8192
"""About as many are weighed at a time, so that memory does not grow with their number."""

BLOCK_M: Final = 250.0
"""Side of the squares of ground whose mean moisture is retrieved [m]."""


def squares_of(scene: Scene, side_m: float) -> tuple[AnyArray, int]:
    """Square of ground (rows, columns) of each cell, so wide or of one cell, and how many there are."""
    size = max(side_m / scene.cell_m, 1.0)
    row, column = (np.floor(np.arange(n) / size).astype(np.int64) for n in scene.shape)
    across = int(column[-1]) + 1
    return row[:, None] * across + column, (int(row[-1]) + 1) * across


def retrieved_squares(image: RadiometerImage, scene: Scene) -> tuple[FloatArray, AnyArray]:
    """Moisture of each square of `BLOCK_M` expected from the brightness of its footprints (n,) [m3/m3].

    And each cell's square, int64 (rows, columns), -1 for cells that are not scored, not seen or whose cover shows no
    moisture. In two steps: the date's mean from all footprints; then each square's departure from it, by the departure
    of its footprints' brightness from what their covers show elsewhere in the image. Where no footprint shows any it is
    the date's mean.
    """
    pixel = seen_pixels(image)
    block, n_blocks = squares_of(scene, BLOCK_M)
    held = _held_pixels(image, pixel)
    ground = expected_ground(image, scene, held)
    radiometer = image.radiometer
    n_pixels = image.brightness_k[0].size
    spread = region_spread(scene, radiometer)
    low, high = radiometer.soil_moisture_low, radiometer.soil_moisture_high
    centre, sd = 0.5 * (low + high), math.hypot((high - low) / math.sqrt(12.0), spread)
    dry, wet = np.moveaxis(_expected_k(ground, slice(None), [0, len(MOISTURE_NODES) - 1]), -1, 0)
    slope = (wet - dry) / (MOISTURE_NODES[-1] - MOISTURE_NODES[0])
    together = _covariance(image, ground, slope, centre)
    costs = _costs(image, ground, scipy.sparse.csc_array(np.ones((1, n_pixels)) / n_pixels), None, together)
    middle = float(posterior_mean(costs, GRID, centre, sd)[0])
    weights = _weights(held, block, n_pixels, n_blocks)
    shows = ground.lookups[0].moist
    own = own_of_squares(scene, block, n_blocks, shows)
    met = weights.T @ np.column_stack([own, np.ones(n_blocks)])
    of_footprint = (met[:, 0] / np.maximum(met[:, 1], 1e-9)).reshape(ground.temperature_k.shape)
    apart = _covariance(image, ground, slope, middle, of_footprint)
    below, part = _between_nodes(np.array(middle))
    low, high = np.moveaxis(_expected_k(ground, slice(None), [int(below), int(below) + 1]), -1, 0)
    away = (image.brightness_k - (low + part * (high - low))).reshape(len(slope), -1)
    share = ground.share.reshape(n_pixels, -1)
    seen = np.isfinite(away).all(axis=0) & (share.sum(axis=1) > 0.0)
    # What the table has wrong of a cover changes with the angle.
    angle = np.repeat(np.abs(image.scan.look_rad), image.brightness_k.shape[2])[:, None] / image.scan.half_angle_rad
    covers = np.hstack([share * angle**n for n in range(3)])
    # A footprint's weight keeps rare covers near what the table says.
    gram = covers[seen].T @ covers[seen] + np.eye(covers.shape[1])
    level_k = (covers @ np.linalg.solve(gram, covers[seen].T @ away[:, seen].T)).T
    costs = _costs(image, ground, weights, level_k, apart)
    scatter = 1.0
    if seen.any():
        # Above 1 where footprints scatter by more than is accounted for: covers within them that beams weigh otherwise.
        wet = spread**2 + radiometer.soil_moisture_field_sd**2 * of_footprint
        wetted = apart + np.einsum("sl,asl,bsl->slab", wet, slope, slope)
        off = mahalanobis(np.nan_to_num(away - level_k).reshape(*slope.shape, 1), wetted)
        scatter = float(off.ravel()[seen].mean()) / len(slope)
    moist = np.append(shows, False)[np.minimum(scene.cover, len(shows))]
    departs = np.sqrt(spread**2 + radiometer.soil_moisture_field_sd**2 * own)[:, None]
    found = posterior_mean(costs / max(scatter, 1.0), GRID, middle, departs)
    return found, np.where(scene.scored & moist & (pixel >= 0), block, -1)


def _held_pixels(image: RadiometerImage, pixel: AnyArray) -> AnyArray:
    """Footprint that holds the centre of each cell, -1 where none does: in gaps the nearest tells of other ground.

    One that holds no centre, being finer than the cells, stands for those that it is nearest to.
    """
    inside = (image.coverage > 0) & (pixel >= 0)
    finer = np.bincount(pixel[inside], minlength=image.brightness_k[0].size) == 0
    return np.where(inside | ((pixel >= 0) & finer[pixel]), pixel, -1)


def own_of_squares(scene: Scene, block: AnyArray, n_blocks: int, moist: BoolArray) -> FloatArray:
    """Variance of the mean of what fields have of their own in each square (n_blocks,), over that of one field.

    1 where a square is one field, 0 where nothing is ``moist`` (n_categories,).
    """
    cells = np.append(moist, False)[np.minimum(scene.cover, len(moist))]
    counts = cells_of_pairs(block[cells], scene.field_id[cells], (n_blocks, scene.n_fields))
    squares, sizes = counts.power(2).sum(axis=1), counts.sum(axis=1)
    return np.asarray(squares / np.square(np.maximum(sizes, 1.0)))


def cells_of_pairs(first: AnyArray, second: AnyArray, shape: tuple[int, int]) -> scipy.sparse.csr_array:
    """How many cells (n,) have each pair of these two numbers, which are below ``shape``."""
    return scipy.sparse.coo_array((np.ones(len(first)), (first, second)), shape=shape).tocsr()


def _weights(pixel: AnyArray, block: AnyArray, n_pixels: int, n_blocks: int) -> scipy.sparse.csc_array:
    """How far each footprint tells of each square (n_blocks, n_pixels): 1 where one lies inside the other."""
    known = pixel >= 0
    cells = cells_of_pairs(block[known], pixel[known], (n_blocks, n_pixels)).tocoo()
    in_block, in_pixel = cells.sum(axis=1), cells.sum(axis=0)
    of_block, of_pixel = cells.coords
    weight = cells.data / np.minimum(in_block[of_block], in_pixel[of_pixel])
    return scipy.sparse.csc_array((weight, (of_block, of_pixel)), shape=(n_blocks, n_pixels))


def _costs(
    image: RadiometerImage,
    ground: ExpectedGround,
    weights: scipy.sparse.csc_array,
    level_k: FloatArray | None,
    covariance: FloatArray,
) -> FloatArray:
    """Sums (n, n_grid) of footprints' squared distances from what they would show at each moisture, by their weights.

    Brightness is higher than expected by ``level_k`` (n_channels, n_pixels); None: what footprints have in common is
    not known, and part of the distance, as their ``covariance`` has it. As the expected brightness is straight between
    nodes of moisture, squared distances are parabolas there.
    """
    n_samples, n_lines = image.brightness_k.shape[1:]
    at, across = (np.zeros((weights.shape[0], len(MOISTURE_NODES) - n)) for n in (0, 1))
    some = max(_FOOTPRINTS // n_lines, 1)
    for first in range(0, n_samples, some):
        own = slice(first, min(first + some, n_samples))
        pixels = slice(own.start * n_lines, own.stop * n_lines)
        away = image.brightness_k[:, own, :, None] - _expected_k(ground, own, range(len(MOISTURE_NODES)))
        if level_k is not None:
            away -= level_k[:, pixels].reshape(*away.shape[:-1], 1)
        away = _whitened(away, covariance[own])
        away[~np.isfinite(away)] = 0.0
        square, product = np.square(away).sum(axis=0), (away[..., :-1] * away[..., 1:]).sum(axis=0)
        at += weights[:, pixels] @ square.reshape(-1, square.shape[-1])
        across += weights[:, pixels] @ product.reshape(-1, product.shape[-1])
    k, part = _between_nodes(GRID)
    left = 1.0 - part
    return np.asarray(np.square(left) * at[:, k] + np.square(part) * at[:, k + 1] + 2.0 * left * part * across[:, k])


def _between_nodes(moisture: FloatArray) -> tuple[AnyArray, FloatArray]:
    """Node of `MOISTURE_NODES` below some moistures, and which part of the way they lie to the next."""
    place = (moisture - MOISTURE_NODES[0]) / (MOISTURE_NODES[1] - MOISTURE_NODES[0])
    k = np.clip(place.astype(np.int64), 0, len(MOISTURE_NODES) - 2)
    return k, place - k


def _expected_k(ground: ExpectedGround, own: slice, nodes: Sequence[int]) -> FloatArray:
    """Brightness (n_channels, samples, n_lines, n) of footprints of some samples at some of `MOISTURE_NODES` [K]."""
    up, through, sky = ground.air[:, own, None, None]
    warm = radiation_equivalent_k(ground.temperature_k[own], ground.planck_k)[..., None]
    out = np.empty((len(ground.lookups), *ground.temperature_k[own].shape, len(nodes)))
    for layer, lookup in zip(out, ground.lookups, strict=True):
        e = of_mixtures(lookup.at_nodes(nodes), ground.share[own], ground.angle_deg[own])
        layer[:] = up + through * (e * warm + (1.0 - e) * sky)
    return ground.planck_k / np.log1p(ground.planck_k / out) if ground.planck_k > 0.0 else out


def _covariance(
    image: RadiometerImage, ground: ExpectedGround, slope_k: FloatArray, moisture: float, own: FloatArray | None = None
) -> FloatArray:
    """Covariance (n_samples, n_lines, n_channels, n_channels) of footprints' brightness about what is expected [K2].

    Departures of fields from the table as parts of what they reflect at a ``moisture`` [m3/m3], H and V related as the
    table has them, and of their moisture from that of the square, ``slope_k`` (n_channels, n_samples, n_lines) for each
    m3/m3; the error of their temperature; the receiver's noise; and where what footprints have in common is not known,
    the departures of dates and means, too. A footprint of several covers departs by the squares of their shares.
    ``own`` (n_samples, n_lines): of `own_of_squares`, where squares are told apart; else None, in common.
    """
    common = own is None
    node, _ = _between_nodes(np.array(moisture))
    radiometer, squares = image.radiometer, np.square(ground.share)
    _, through, sky = ground.air[..., None]
    heat = radiometer.temperature_field_sd_k**2 + (radiometer.temperature_date_sd_k**2 if common else 0.0)
    # What a field has of its own is in the mean of its square, too.
    apart = squares.sum(axis=-1) if own is None else np.maximum(squares.sum(axis=-1) - own, 0.0)
    wetness = np.square(radiometer.soil_moisture_field_sd) * apart
    together = 1.0 if common else ground.footprints_a_piece
    reflected = [1.0 - look.at_nodes([int(node)]) for look in ground.lookups]
    late = ground.of_years if common else ground.of_fields
    out = np.empty((*ground.temperature_k.shape, len(slope_k), len(slope_k)))
    for a, one in enumerate(ground.lookups):
        for b, other in enumerate(ground.lookups[: a + 1]):
            related = 1.0 if a == b else one.channel_correlation
            departure = related * one.field_part * other.field_part
            if common:
                departure = departure + related * one.date_part * other.date_part + one.mean_part * other.mean_part
            departure = departure[:, None, None] * reflected[a] * reflected[b]
            departure += late[a, b][:, [min(int(node), late.shape[3] - 1)]]
            spread = of_mixtures(departure, squares, ground.angle_deg)[..., 0]
            emitted = np.square(through * (ground.temperature_k - sky)) * spread + through**2 * heat
            # What footprints of one field have in common, their number does not lessen; a date's mean has one's weight.
            out[..., a, b] = out[..., b, a] = (emitted + slope_k[a] * slope_k[b] * wetness) * together
        out[..., a, a] += np.square(np.nan_to_num(image.nedt_k[a]))
    return out


def mahalanobis(away: FloatArray, covariance: FloatArray) -> FloatArray:
    """Squares of Mahalanobis distances (..., m) of departures (d, ..., m) with covariances (..., d, d)."""
    return np.asarray(np.square(_whitened(away, covariance)).sum(axis=0))


def _whitened(away: FloatArray, covariance: FloatArray) -> FloatArray:
    """Departures (d, ..., m) with covariances (..., d, d), so turned that their squares are Mahalanobis distances."""
    root = np.linalg.inv(np.linalg.cholesky(covariance + 1e-9 * np.eye(len(away))))
    return np.asarray(np.einsum("...ab,b...m->a...m", root, away))


def posterior_mean(costs: FloatArray, grid: FloatArray, mean: float, sd: FloatArray | float) -> FloatArray:
    """Posterior means (n,) on a grid (m,), from squared distances (n, m) and a Gaussian prior, ``sd`` (n, 1) or all."""
    cost = costs + np.square((grid - mean) / np.maximum(sd, 1e-6))
    weight = np.exp(-0.5 * (cost - cost.min(axis=1, keepdims=True)))
    return np.asarray((weight @ grid) / weight.sum(axis=1))
