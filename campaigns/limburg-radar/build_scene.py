"""Build ``scene.npz`` of this campaign from the source rasters: always the same bytes.

    python build_scene.py SOURCE.npz [scene.npz]

``SOURCE.npz`` holds ``elevation_cm`` (int16, -32768 no data), ``cover`` (uint8: 0 no data, 1 to 13 as in `COVER`),
``field_2019`` (uint8, number of the field, 0 elsewhere) and ``cell_m``; see ``SCENE.md`` for where the rasters come
from and for every choice made here.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from seqrsm.arrays import AnyArray
from seqrsm.scene.fields import connected_patches, voronoi_labels
from seqrsm.scene.file import save_scene
from seqrsm.scene.scene import NO_COVER, Scene

SEED = 1979
COVER = {
    1: "Wheat", 2: "Vegetables", 3: "Vegetables", 4: "Trees", 5: "Forage", 6: "Grass", 7: "Trees", 8: "Trees",
    9: "Water", 10: "Asphalt", 11: "Gravel", 12: "Gravel", 13: "Buildings",
}  # fmt: skip
"""Category of each cover: cereals, potato, sugar beet, apple orchard, other arable, grass, orchard, forest, water, road
paved, half paved and unpaved, yards and buildings."""

PATCH_SPACING_M = 60.0  # grass, trees and the rest in pieces of 0.36 ha on average
LICENCE = (
    "CC BY 4.0: Commelin, Wesseling, Baartman and Jetten (2024), doi 10.1016/j.envsoft.2024.105960, data in "
    "mcommelin/openlisem_pesticide_model_development. See SCENE.md."
)
PROVENANCE = (
    "Built by build_scene.py from spatial_data_SL of mcommelin/openlisem_pesticide_model_development commit 45723e28. "
    f"Elevation, cover and fields of 2019 are real; pieces of grass, trees and yards are drawn (seed {SEED}). The "
    "source's coordinates are shifted, so the scene has none."
)


def build(source: Mapping[str, AnyArray]) -> Scene:
    """Scene of the source rasters."""
    use = source["cover"]
    rows, cols = use.shape
    cell_m = float(source["cell_m"])
    elevation = (source["elevation_cm"].astype(np.float64) / 100.0).astype(np.float32)
    elevation[source["elevation_cm"] == -32768] = np.nan
    categories = tuple(dict.fromkeys(COVER.values()))
    cover = np.full(use.shape, NO_COVER, dtype=np.uint8)
    for code, name in COVER.items():
        cover[use == code] = categories.index(name)
    piece = voronoi_labels(rows, cols, round(PATCH_SPACING_M / cell_m), seed=SEED)
    field = source["field_2019"].astype(np.int64)
    return Scene(
        elevation_m=elevation,
        cover=cover,
        categories=categories,
        # Real fields are never cut; what has no field number is cut into drawn pieces.
        field_id=connected_patches(cover, field, np.where(field > 0, 0, piece)),
        scored=np.isfinite(elevation) & (cover != NO_COVER),
        cell_m=cell_m,
        name="South Limburg",
        licence=LICENCE,
        provenance=PROVENANCE,
        category_notes={
            "Wheat": "the source's cereals, of whatever kind",
            "Vegetables": "potato and sugar beet",
            "Trees": "forest, orchard and apple orchard",
            "Forage": "other arable land; the crop is not told",
            "Gravel": "half paved and unpaved roads",
            "Buildings": "the source's other: farm yards and buildings",
        },
    )


def main() -> None:
    """Read the source named on the command line and write the scene."""
    if len(sys.argv) not in (2, 3):
        sys.exit(__doc__)
    target = Path(sys.argv[2]) if len(sys.argv) == 3 else Path(__file__).with_name("scene.npz")
    with np.load(sys.argv[1], allow_pickle=False) as archive:
        scene = build({name: archive[name] for name in archive.files})
    save_scene(scene, target)
    print(f"{target}: {scene.shape[0]} x {scene.shape[1]} cells, {scene.n_fields} fields")


if __name__ == "__main__":
    main()
