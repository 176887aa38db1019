"""Land drawn from a seed, for tests and studies: fields, each of one cover, on terrain with a power-law spectrum."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from seqrsm.scene.fields import connected_patches, draw_index, voronoi_labels
from seqrsm.scene.scene import Scene


def fractal_terrain(rows, cols, *, relief_m: float, seed: int):
    """Height above the lowest point [m] by spectral synthesis (Voss 1985, "Random fractal forgeries").

    The two-dimensional power spectrum falls as wavenumber ** -3.5, as that of natural land; the grid is made twice as
    large as wanted and cut, since the synthesis is periodic.
    """
    if relief_m == 0.0:
        return np.zeros((rows, cols))
    noise = np.random.default_rng(seed).standard_normal((2 * rows, 2 * cols))
    k = np.hypot(np.fft.fftfreq(2 * rows)[:, None], np.fft.rfftfreq(2 * cols))
    k[0, 0] = np.inf
    height = np.fft.irfft2(np.fft.rfft2(noise) * k**-1.75, noise.shape)[:rows, :cols]
    height -= height.min()
    return height * (relief_m / height.max())


def synthetic_scene(
    rows, cols, cell_m, *, categories: Sequence[str], field_m: float = 150.0, relief_m: float = 0.0, seed: int = 0
) -> Scene:
    """Fields of a mean side [m] on terrain of such relief; each category has as many fields on average."""
    piece = voronoi_labels(rows, cols, round(field_m / cell_m), seed=seed)
    # A draw for each piece, not for each of its cells.
    cover = draw_index(np.arange(int(piece.max()) + 1), [1.0] * len(categories), seed=seed + 1).astype(np.uint8)[piece]
    return Scene(
        elevation_m=fractal_terrain(rows, cols, relief_m=relief_m, seed=seed).astype(np.float32),
        cover=cover,
        categories=tuple(categories),
        field_id=connected_patches(piece, cover),
        scored=np.ones((rows, cols), dtype=bool),
        cell_m=cell_m,
        name=f"synthetic {rows} x {cols}, seed {seed}",
        licence="none needed: computed",
        provenance=f"Voronoi fields of {field_m:g} m, relief {relief_m:g} m, seed {seed}",
    )
