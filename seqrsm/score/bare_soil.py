"""Moisture of bare fields, whatever is sown, retrieved from a radar's backscatter; their roughness is not known.

Optimal estimation as in `seqrsm.score.moisture`, field by field: backscatter is that of the table at each moisture and
on the slopes of the ground, which are known, within what fields and their parts differ by (their roughness above all),
dates and the table's own means, and speckle. Pixels that show more than one field are left out, since trees and crops
beside bare soil outshine it, most of all at HV.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
import scipy

from seqrsm.arrays import AnyArray, BoolArray, FloatArray, IntArray
from seqrsm.scattering.readers import POLARIZATIONS
from seqrsm.scattering.sigma0 import Sigma0Lookup
from seqrsm.scattering.worlds import own_weights
from seqrsm.scene.scene import Scene
from seqrsm.score import kernels_classify
from seqrsm.score.brightness import mahalanobis, posterior_mean
from seqrsm.score.evidence import in_one_field, reach_pixels
from seqrsm.score.pixels import fields_of, pixels_of
from seqrsm.sensor.radar import GROUND_OF
from seqrsm.simulate.radar.occasion import look_up, nominal_ground_state
from seqrsm.simulate.radar.psm import expected_image
from seqrsm.simulate.radar.result import RadarImage
from seqrsm.simulate.visits import region_spread, related_fields
from seqrsm.units import linear_to_db

GRID: Final[FloatArray] = np.linspace(0.04, 0.52, 13)
"""Moistures at which backscatter is looked up [m3/m3]; straight lines in decibels between."""

FINE: Final[FloatArray] = np.linspace(GRID[0], GRID[-1], 97)
_DB: Final = 10.0 / math.log(10.0)
_SEEN_DB: Final = 2.5  # by which a cover's backscatter changes if half of its echo is bare soil's: 1.9 to 2.7 dB


def retrieved_fields(images: Sequence[RadarImage], scene: Scene, seed: int, run_id: int) -> tuple[FloatArray, AnyArray]:
    """Moisture of each bare field expected from its backscatter (n,) [m3/m3], and which field it is of every cell.

    In two steps: the date's mean from all fields, then each field's departure by that of its backscatter from the
    others'. A field in which no pixel lies away from the edge is left at the date's mean. Of every cell it is the place
    among the fields, int32 (rows, columns), -1 for cells that are not scored, not seen or show no moisture.

    Images are of one date; near frequencies and angles see nearly the same of what fields differ by. Of several dates
    each is a case of its own: a field's roughness lasts about as its moisture does, so that all dates together tell
    0.03 of its variance more at best, and less where the table has a date's mean wrong.
    """
    unit, counts, _ = fields_of(pixels_of(images, scene, seed=seed, run_id=run_id), scene)
    tables = [_looked_up(image, scene, image.radar.recorded, GRID) for image in images]  # the phase is left unused
    steps = [[look for one in at for look in one] for at in zip(*tables, strict=True)]  # the channels of all images
    shows = np.any([_shows(image, scene) for image in images], axis=0)
    kind = counts.argmax(axis=1)
    bare = np.flatnonzero(shows[kind])
    place = np.full(len(kind) + 1, -1, dtype=np.int32)
    place[bare] = np.arange(len(bare))
    of_cell, kind = place[unit], kind[bare]
    if not len(bare):
        return np.zeros(0), of_cell
    found = [_departures_db(image, scene, of_cell, kind, one) for image, one in zip(images, tables, strict=True)]
    away, of_speckle, of_parts, echo = (np.concatenate(layers) for layers in zip(*found, strict=True))
    covariance = _covariance(images, steps[0], kind, of_speckle, of_parts, echo)
    here = np.isfinite(away[:, :, 0])
    told, seen = here.any(axis=1), here.any(axis=0)
    away, here, looks = away[told][:, seen], here[told][:, seen], [steps[0][c] for c in np.flatnonzero(told)]
    covariance = covariance[seen][:, told][:, :, told]
    blind = ~here.T  # what a radar does not see of a field is no departure, and related to none
    covariance[blind], covariance.swapaxes(1, 2)[blind] = 0.0, 0.0
    covariance += np.einsum("nc,cd->ncd", blind, np.eye(len(away)))
    radar = images[0].radar
    low, high = radar.soil_moisture_low, radar.soil_moisture_high
    spread = math.hypot(radar.soil_moisture_field_sd, region_spread(scene, radar))
    centre, sd = 0.5 * (low + high), math.hypot((high - low) / math.sqrt(12.0), spread)
    moisture = np.full(len(bare), centre)
    if seen.any():
        of_ground = np.stack([np.hypot(look.date_sd_db, look.mean_sd_db)[kind[seen]] for look in looks])
        of_ground *= echo[told][:, seen]
        common = covariance + np.einsum("cn,cd->ncd", np.square(of_ground), np.eye(len(away)))
        cost = mahalanobis(np.where(here[:, :, None], away, 0.0), common).mean(axis=0)
        middle = float(posterior_mean(cost[None], FINE, centre, sd)[0])
        at_middle = np.array([[np.interp(middle, FINE, line) for line in layer] for layer in away])
        departed = np.where(here[:, :, None], away - np.nanmedian(at_middle, axis=1)[:, None, None], 0.0)
        moisture[:] = middle
        moisture[seen] = posterior_mean(mahalanobis(departed, covariance), FINE, middle, spread)
    return moisture, of_cell


def _shows(image: RadarImage, scene: Scene) -> BoolArray:
    """Covers (n_categories,) whose backscatter shows moisture in any channel of the band.

    Whichever the radar receives, so that all its polarizations are scored over the same ground.
    """
    change = []
    for channel in POLARIZATIONS:
        (dry,), (wet,) = _looked_up(image, scene, (channel,), GRID[[0, -1]])
        change.append(np.abs(_db(wet.sigma0[:, 40]) - _db(dry.sigma0[:, 40])))
    return np.asarray(np.max(change, axis=0) > _SEEN_DB)


def _looked_up(
    image: RadarImage, scene: Scene, channels: tuple[str, ...], moistures: FloatArray
) -> list[list[Sigma0Lookup]]:
    """The table's own means at moistures [m3/m3], one for each channel."""
    assert image.table is not None
    radar = replace(image.radar, channels=channels)
    _, wind = nominal_ground_state(radar)
    return [look_up(scene, radar, image.table.in_world(None), (float(m), wind), image.day) for m in moistures]


def _departures_db(
    image: RadarImage, scene: Scene, of_cell: AnyArray, kind: IntArray, steps: list[list[Sigma0Lookup]]
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Backscatter (n_channels, n, n_fine) of fields over what it is, with noise, at each moisture [dB].

    With the variances (n_channels, n) [dB2] of speckle and of the parts that fields consist of, and the echo's share of
    a field's power, by which noise lessens what fields differ by in decibels. ``kind`` (n,): cover of each field; nan
    for fields of which no pixel is seen away from their edges.
    """
    pixel, n_azimuth = image.pixel_of_cell, image.intensity.shape[2]
    rows = np.stack([image.incidence_angle_deg, image.noise_equivalent_sigma0, image.looks])
    assert image.table is not None
    # Slopes change the echo by decibels: it is compared with that of the same ground as the table has it.
    middle, _ = nominal_ground_state(image.radar)
    powers = replace(image.radar, channels=image.radar.recorded)
    usual = expected_image(scene, powers, image.table.in_world(None), image.day)
    ratio = image.intensity[: len(steps[0])] / np.maximum(usual.intensity, 1e-9 * float(usual.intensity.max()) or 1.0)
    layers = np.vstack([np.repeat(rows, n_azimuth, axis=1), ratio.reshape(len(ratio), -1)])
    inner = np.where(_away_from_edges(image, scene), of_cell, np.int32(-1))
    theta, noise, looks, *shown = kernels_classify.mean_of_pixels(inner, pixel, layers, len(kind))
    found, echo = np.empty((len(shown), len(kind), len(FINE))), np.empty((len(shown), len(kind)))
    for c, over in enumerate(shown):
        at = np.empty((len(GRID), len(kind)))
        for line, step in zip(at, steps, strict=True):
            for k in np.unique(kind):
                mine = kind == k
                line[mine] = np.interp(theta[mine], step[c].theta_deg, step[c].sigma0[k])
        usual_echo = np.array([np.interp(middle, GRID, column) for column in at.T])
        echo[c] = np.nan_to_num(usual_echo / np.maximum(usual_echo + noise, 1e-12))
        change = [np.interp(FINE, GRID, column) - np.interp(middle, GRID, column) for column in _db(at + noise).T]
        found[c] = _db(over)[:, None] - change
    area = np.maximum(np.bincount(inner[inner >= 0], minlength=len(kind)), 1) * scene.cell_m**2
    n_looks = looks * np.maximum(area / image.radar.resolution_m**2, 1.0)
    of_parts = image.radar.texture_db**2 / np.maximum(area / image.radar.texture_m**2, 1.0)
    shape = len(shown), len(kind)
    of_speckle = _DB**2 * scipy.special.polygamma(1, n_looks)
    return found, np.broadcast_to(of_speckle, shape), np.broadcast_to(of_parts, shape), echo


def _covariance(
    images: Sequence[RadarImage],
    looks: Sequence[Sigma0Lookup],
    kind: IntArray,
    of_speckle: FloatArray,
    of_parts: FloatArray,
    echo: FloatArray,
) -> FloatArray:
    """Covariance (n, n_channels, n_channels) [dB2] of fields of one cover, ``kind`` (n,), on one date.

    Over the channels of all images, which are related as the table has them and as their frequencies and angles see
    the same of fields and parts; with the variances of `_departures_db`.
    """
    seen_by = [(image.radar, GROUND_OF[c]) for image in images for c in image.radar.recorded]
    looks_from = [(radar.frequency_ghz, math.degrees(radar.centre_incidence_rad)) for radar, _ in seen_by]
    shared = np.array([look.channel_correlation for look in looks])[:, None]
    own = [own_weights(channel, angle) for (_, channel), (_, angle) in zip(seen_by, looks_from, strict=True)]
    drawn = np.hstack([np.sqrt(shared), np.sqrt(1.0 - shared) * own])
    related = drawn @ drawn.T
    related *= [[related_fields(f, g, abs(a - b)) for g, b in looks_from] for f, a in looks_from]
    of_fields = [look.of_fields_db(angle) for look, (_, angle) in zip(looks, looks_from, strict=True)]
    sd, rough = (echo * np.stack([one[kind] for one in every]) for every in zip(*of_fields, strict=True))
    part = echo * np.sqrt(of_parts)
    both = np.einsum("cn,dn->ncd", sd, sd) + np.einsum("cn,dn->ncd", part, part)
    alike = np.einsum("cn,dn->ncd", rough, rough) + np.einsum("cn,cd->ncd", of_speckle, np.eye(len(looks)))
    return np.asarray(related * both + alike)


def _away_from_edges(image: RadarImage, scene: Scene) -> BoolArray:
    """Whether the resolution cell about a cell's pixel (rows, columns) lies in one field: none gets another's echo."""
    pixel, radar = image.pixel_of_cell, image.radar
    known = pixel >= 0
    field = np.full(image.intensity[0].size, -1, dtype=np.int64)
    field[pixel[known]] = scene.field_id[known]
    field[pixel[known & (scene.field_id != field[pixel])]] = -2  # of several fields
    inside = in_one_field(field.reshape(image.intensity.shape[1:]), reach_pixels(radar, scene.cell_m))
    beside = scipy.ndimage.minimum_filter(known, 2 * math.ceil(radar.resolution_m / scene.cell_m - 1e-9) + 1)
    return np.asarray(beside & inside.ravel()[pixel])


def _db(power: FloatArray) -> FloatArray:
    return linear_to_db(np.maximum(power, 1e-12))
