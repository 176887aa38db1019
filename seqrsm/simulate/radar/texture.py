"""Texture within fields: real fields are not even inside, which matters where speckle is averaged away.

Rows, wet spots and trends make the backscatter of parts of a field differ. In the AIRSAR flight over Flevoland blocks
of 24 to 145 m scatter about the mean of their field as speckle and parts of 75 m that differ by 1 dB let them
(``reports/validation/flevoland.md``). Here each field is cut into drawn pieces, and each piece departs from its field.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING, Final

import numpy as np

from seqrsm.arrays import IntArray
from seqrsm.scattering.readers import POLARIZATIONS
from seqrsm.scene.fields import voronoi_labels
from seqrsm.scene.scene import Scene
from seqrsm.sensor.radar import GROUND_OF, RadarConfiguration
from seqrsm.simulate.radar.occasion import Occasion
from seqrsm.simulate.visits import Visit, half_lasting

if TYPE_CHECKING:
    from seqrsm.scattering.sigma0 import Sigma0Lookup

_SEED: Final = 1979
"""Of the pieces' outlines, which are the same in every run; their backscatter is drawn anew."""


@lru_cache(maxsize=6)
def pieces(scene: Scene, texture_m: float) -> tuple[Scene, IntArray]:
    """Fields cut into Voronoi pieces of ``texture_m`` [m] on average a side, at least a cell.

    The scene whose ``field_id`` numbers pieces, and the field that each piece is of (n_pieces,).
    """
    rows, cols = scene.shape
    cut = voronoi_labels(rows, cols, max(round(texture_m / scene.cell_m), 1), seed=_SEED)
    width = int(cut.max()) + 1
    found, number = np.unique(scene.field_id.astype(np.int64) * width + cut, return_inverse=True)
    piece = number.reshape(rows, cols).astype(np.int32)
    return replace(scene, field_id=piece), found // width


def ground_of(scene: Scene, radar: RadarConfiguration) -> Scene:
    """The scene as a radar's frame wants it: with pieces in place of fields where it asks for texture."""
    return pieces(scene, radar.texture_m)[0] if radar.texture_db > 0.0 else scene


def with_texture(
    occasion: Occasion,
    scene: Scene,
    radar: RadarConfiguration,
    lookups: Sequence[Sigma0Lookup],
    visit: Visit,
    *,
    seed: int,
    run_id: int,
) -> Occasion:
    """The occasion with offsets of pieces in place of those of fields; itself without texture.

    Departures are Gaussian in decibels; two channels share the part of the variance that fields do, and half of it
    lasts from date to date (assumed).

    Parameters
    ----------
    occasion : Occasion
        Of the scene's own fields.
    scene, radar, lookups, visit
        As in `seqrsm.simulate.radar.occasion.draw_occasion`.
    seed, run_id : int
        Campaign and run.
    """
    if radar.texture_db == 0.0:
        return occasion
    _, parent = pieces(scene, radar.texture_m)
    # One for all channels and one for each, as far as there are any: a row's draws do not depend on those after it.
    place = [1 + POLARIZATIONS.index(GROUND_OF[channel]) for channel in radar.channels]
    shape = (1 + max(place), len(parent))
    draws = half_lasting(visit, "texture", shape, radar.frequency_ghz, seed=seed, run_id=run_id)
    offset = occasion.field_offset_db[:, parent]
    for c, lookup in enumerate(lookups):
        shared = float(np.mean(lookup.channel_correlation))
        own = draws[place[c]]
        offset[c] += radar.texture_db * (np.sqrt(shared) * draws[0] + np.sqrt(1.0 - shared) * own)
    return replace(occasion, field_offset_db=offset)
