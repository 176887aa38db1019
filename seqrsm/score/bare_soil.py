"""Moisture of bare fields retrieved from a radar's backscatter, whose roughness is not known.

Optimal estimation as in `seqrsm.score.moisture`, field by field: backscatter is that of the table at each moisture,
within what fields and their parts differ by (their roughness above all), dates and the table's own means, and speckle.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from seqrsm.arrays import AnyArray, FloatArray, IntArray
from seqrsm.scattering.sigma0 import Sigma0Lookup
from seqrsm.scene.scene import Scene
from seqrsm.score import kernels_classify
from seqrsm.score.brightness import mahalanobis, posterior_mean
from seqrsm.score.evidence import Evidence, evidence_of
from seqrsm.simulate.radar.occasion import look_up, nominal_ground_state
from seqrsm.simulate.radar.result import RadarImage
from seqrsm.simulate.visits import moisture_spread
from seqrsm.units import linear_to_db

GRID: Final[FloatArray] = np.linspace(0.04, 0.52, 13)
"""Moistures at which backscatter is looked up [m3/m3]; straight lines in decibels between."""

FINE: Final[FloatArray] = np.linspace(GRID[0], GRID[-1], 97)
_DB: Final = 10.0 / math.log(10.0)
_SEEN_DB: Final = 0.1  # a category whose backscatter changes by less shows no moisture


def retrieved_fields(images: Sequence[RadarImage], scene: Scene, seed: int, run_id: int) -> tuple[FloatArray, AnyArray]:
    """Moisture of each bare field expected from its backscatter, and which field it is of every cell.

    In two steps: the date's mean from all fields, then each field's departure by that of its backscatter from the
    others'.

    Parameters
    ----------
    images : sequence of RadarImage
        Of one date; what fields differ by is taken to be independent between them. Of several dates each is a case of
        its own: a field's roughness lasts about as its moisture does, so that all dates together tell 0.03 of its
        variance more at best, and less where the table has a date's mean wrong.
    scene : Scene
    seed, run_id : int
        As of `seqrsm.score.evidence.evidence_of`.

    Returns
    -------
    float64 array (n,)
        [m3/m3]
    int32 array (rows, columns)
        Place in it; -1 for cells that are not scored, not seen or show no moisture.
    """
    evidence = evidence_of(images, scene, by="field", seed=seed, run_id=run_id)
    tables = [_tables(image, scene) for image in images]
    steps = [[look for one in at for look in one] for at in zip(*tables, strict=True)]  # the channels of all images
    first, last = (np.array([look.sigma0[:, 40] for look in steps[k]]) for k in (0, -1))
    shows = np.asarray(np.abs(_db(last) - _db(first)).max(axis=0) > _SEEN_DB)
    kind = evidence.counts.argmax(axis=1)
    bare = np.flatnonzero(shows[kind])
    place = np.full(len(kind) + 1, -1, dtype=np.int32)
    place[bare] = np.arange(len(bare))
    assert evidence.unit_of_cell is not None
    of_cell = place[evidence.unit_of_cell]
    if not len(bare):
        return np.zeros(0), of_cell
    found = [_expected_db(image, scene, evidence, bare, one) for image, one in zip(images, tables, strict=True)]
    expected = np.concatenate([one for one, _ in found])
    covariance = np.zeros((len(bare), len(expected), len(expected)))
    ends = np.cumsum([0, *(len(one) for one, _ in found)])
    for (_, own), a, b in zip(found, ends[:-1], ends[1:], strict=True):
        covariance[:, a:b, a:b] = own
    seen = evidence.features[:, bare]
    radar = images[0].radar
    low, high = radar.soil_moisture_low, radar.soil_moisture_high
    spread = moisture_spread(scene, radar)
    of_date = np.square(np.stack([look.date_sd_db[kind[bare]] for look in steps[0]]))
    of_mean = np.square(np.stack([look.mean_sd_db[kind[bare]] for look in steps[0]]))
    common = covariance + np.einsum("cn,cd->ncd", of_date + of_mean, np.eye(len(seen)))
    away = seen[:, :, None] - expected
    centre, sd = 0.5 * (low + high), math.hypot((high - low) / math.sqrt(12.0), spread)
    middle = float(posterior_mean(mahalanobis(away, common).mean(axis=0)[None], FINE, centre, sd)[0])
    at_middle = np.array([[np.interp(middle, FINE, line) for line in layer] for layer in away])
    level = np.median(at_middle, axis=1)
    departed = away - level[:, None, None]
    return posterior_mean(mahalanobis(departed, covariance), FINE, middle, max(spread, 1e-6)), of_cell


def _tables(image: RadarImage, scene: Scene) -> list[list[Sigma0Lookup]]:
    """The table's own means at each moisture of `GRID`, one for each channel."""
    assert image.table is not None
    table = image.table.in_world(None)
    _, wind = nominal_ground_state(image.radar)
    return [look_up(scene, image.radar, table, (float(m), wind), image.day) for m in GRID]


def _expected_db(
    image: RadarImage, scene: Scene, evidence: Evidence, units: IntArray, steps: list[list[Sigma0Lookup]]
) -> tuple[FloatArray, FloatArray]:
    """Backscatter with the noise (n_channels, n, n_fine) of fields at each moisture [dB], and its covariance [dB2].

    The covariance (n, n_channels, n_channels) is that of fields of one cover on one date: channels are related as the
    table has them; of the parts that fields consist of; and speckle.
    """
    n_azimuth = image.intensity.shape[2]
    rows = np.stack([image.incidence_angle_deg, image.noise_equivalent_sigma0, image.looks])
    layers = np.repeat(rows, n_azimuth, axis=1)
    unit = evidence.unit_of_cell
    assert unit is not None
    theta, noise, looks = kernels_classify.mean_of_pixels(unit, image.pixel_of_cell, layers, len(evidence.counts))[
        :, units
    ]
    kind = evidence.counts[units].argmax(axis=1)
    n_channels = len(image.radar.channels)
    found = np.empty((n_channels, len(units), len(FINE)))
    for c in range(n_channels):
        at = np.empty((len(GRID), len(units)))
        for line, step in zip(at, steps, strict=True):
            for k in np.unique(kind):
                mine = kind == k
                line[mine] = np.interp(theta[mine], step[c].theta_deg, step[c].sigma0[k])
        power = _db(at + noise)
        found[c] = [np.interp(FINE, GRID, column) for column in power.T]
    cell_area, pixel_area = scene.cell_m**2, image.range_spacing_m * image.azimuth_spacing_m
    area = evidence.counts[units].sum(axis=1) * cell_area
    n_looks = looks * np.maximum(area / pixel_area, 1.0)
    of_parts = image.radar.texture_db**2 / np.maximum(area / image.radar.texture_m**2, 1.0)
    covariance = np.empty((len(units), n_channels, n_channels))
    for a, one in enumerate(steps[0]):
        for b, other in enumerate(steps[0]):
            related = 1.0 if a == b else one.channel_correlation
            covariance[:, a, b] = related * ((one.field_sd_db * other.field_sd_db)[kind] + of_parts)
        covariance[:, a, a] += _DB**2 / n_looks
    return found, covariance


def _db(power: FloatArray) -> FloatArray:
    return linear_to_db(np.maximum(power, 1e-12))
